//! Parquet files that say what they are and can be held against themselves: any columns, hashes of data and metadata in the footer.
//!
//! The rows of a file are cut into the same pages however they came, so that the same rows give the same bytes.

use crate::StoreError;
use crate::record::schema::{self, PAGE, key};
use crate::whole_file::{WholeFile, hash_of};
use arrow_array::{Array, RecordBatch};
use arrow_schema::{ArrowError, SchemaRef};
use ledger::Hash;
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use parquet::arrow::{ArrowWriter, encode_arrow_schema};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, ParquetMetaDataReader};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A Parquet file in the making: `x.parquet.tmp` until [`TableWriter::finish`]. Dropped before, it leaves nothing behind.
pub(crate) struct TableWriter {
    path: PathBuf,
    schema: SchemaRef,
    parquet: ArrowWriter<WholeFile>,
    metadata: BTreeMap<String, String>,
    /// Rows that do not make a page yet.
    waiting: Vec<RecordBatch>,
    waiting_rows: usize,
    /// Rows so far.
    pub(crate) rows: u64,
    /// Readings without a value so far.
    pub(crate) unavailable: u64,
    /// Time of the first and the last row, microseconds UTC.
    pub(crate) span_us: Option<(i64, i64)>,
    readings: Vec<usize>,
}

/// Length, hash and metadata of a file that is whole.
pub(crate) struct Written {
    pub(crate) bytes: u64,
    pub(crate) hash: Hash,
}

impl TableWriter {
    pub(crate) fn create(
        path: &Path,
        schema: &SchemaRef,
        mut metadata: BTreeMap<String, String>,
    ) -> Result<TableWriter, StoreError> {
        let unwritable = unwritable(path);
        let file = WholeFile::create(path)?;
        let properties = schema::properties(schema, &metadata).map_err(&unwritable)?;
        // The library adds this pair by itself; the digest has to cover it.
        metadata.insert(key::ARROW_SCHEMA.to_owned(), encode_arrow_schema(schema));
        let is_reading = |k: &usize| schema.field(*k).metadata().contains_key(key::SCALE);
        Ok(TableWriter {
            path: path.to_owned(),
            metadata,
            parquet: ArrowWriter::try_new(file, Arc::clone(schema), Some(properties)).map_err(&unwritable)?,
            waiting: Vec::new(),
            waiting_rows: 0,
            rows: 0,
            unavailable: 0,
            span_us: None,
            readings: (0..schema.fields().len()).filter(is_reading).collect(),
            schema: Arc::clone(schema),
        })
    }

    /// Adds rows, in order of time.
    pub(crate) fn write(&mut self, batch: &RecordBatch) -> Result<(), StoreError> {
        let mut batch = batch.clone();
        while batch.num_rows() > 0 {
            let taken = batch.num_rows().min(PAGE - self.waiting_rows);
            self.waiting.push(batch.slice(0, taken));
            self.waiting_rows += taken;
            batch = batch.slice(taken, batch.num_rows() - taken);
            if self.waiting_rows == PAGE {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), StoreError> {
        let page = match self.waiting.as_slice() {
            [] => return Ok(()),
            [one] => one.clone(),
            several => arrow_select::concat::concat_batches(&self.schema, several).map_err(refused(&self.path))?,
        };
        self.waiting.clear();
        self.waiting_rows = 0;
        self.rows += page.num_rows() as u64;
        self.unavailable += self.readings.iter().map(|k| page.column(*k).null_count() as u64).sum::<u64>();
        let time = crate::segment::time_of;
        if let (Some(first), Some(last)) = (time(&page, 0), time(&page, page.num_rows() - 1)) {
            self.span_us = Some((self.span_us.map_or(first, |(from, _)| from), last));
        }
        self.parquet.write(&page).map_err(unwritable(&self.path))
    }

    /// Ends the file with what became known on the way, and makes it last: content, name, folder.
    pub(crate) fn finish(&mut self) -> Result<(), StoreError> {
        self.flush()?;
        self.parquet.flush().map_err(unwritable(&self.path))?;
        self.parquet.sync().map_err(StoreError::io("write", &self.path))
    }

    /// After [`TableWriter::finish`]: the metadata that became known on the way, the digests, the name.
    pub(crate) fn close(mut self, late: &[(&str, String)]) -> Result<Written, StoreError> {
        let (length, data) = self.parquet.inner().so_far();
        let mut late: BTreeMap<String, String> = late.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
        late.insert(key::DATA.to_owned(), format!("{length} {data}"));
        let mut all = self.metadata;
        all.extend(late.clone());
        late.insert(key::DIGEST.to_owned(), schema::digest(&all).to_string());
        for (key, value) in late {
            self.parquet.append_key_value_metadata(KeyValue::new(key, value));
        }
        let (bytes, hash) = self.parquet.into_inner().map_err(unwritable(&self.path))?.finish()?;
        Ok(Written { bytes, hash })
    }
}

/// A Parquet file of ours, opened, held against the hashes it carries.
#[derive(Debug)]
pub struct Table {
    path: PathBuf,
    file: File,
    arrow: ArrowReaderMetadata,
    metadata: BTreeMap<String, String>,
    rows: u64,
}

impl Table {
    /// Opens a file. `check` looks at what it says about itself before its content is held against the hashes.
    pub(crate) fn open_if(
        path: &Path,
        check: impl FnOnce(&BTreeMap<String, String>) -> Result<(), String>,
    ) -> Result<Table, StoreError> {
        let not_ours = |what: String| StoreError::NotARecord {
            path: path.to_owned(),
            what,
        };
        let mut file = File::open(path).map_err(StoreError::io("open", path))?;
        let mut mark = [0; 4];
        let marked = file.read_exact(&mut mark).is_ok() && mark == *b"PAR1";
        if !marked {
            return Err(not_ours("it does not begin as a Parquet file".to_owned()));
        }
        // First what the footer alone says, with a decoder that only gives errors; the Arrow schema inside the metadata is decoded by
        // one that panics on a flipped bit, so the metadata is held against its digest before.
        let footer = guarded(path, || ParquetMetaDataReader::new().parse_and_finish(&file))?;
        let pairs = footer.file_metadata().key_value_metadata().into_iter().flatten();
        let metadata: BTreeMap<String, String> = pairs
            .map(|kv| (kv.key.clone(), kv.value.clone().unwrap_or_default()))
            .collect();
        check(&metadata).map_err(not_ours)?;
        check_hashes(&mut file, &metadata).map_err(|what| StoreError::Damaged {
            path: path.to_owned(),
            what,
        })?;
        let rows = u64::try_from(footer.file_metadata().num_rows()).unwrap_or(0);
        let arrow = guarded(path, || {
            ArrowReaderMetadata::try_new(Arc::new(footer), ArrowReaderOptions::new())
        })?;
        Ok(Table {
            path: path.to_owned(),
            file,
            arrow,
            metadata,
            rows,
        })
    }

    /// Opens a table of any columns that was made from segments, and holds its content against the hashes it carries.
    ///
    /// # Errors
    /// It cannot be opened, it is no Parquet file, it is cut or changed, or it is not ours.
    pub fn open(path: &Path) -> Result<Table, StoreError> {
        Table::open_if(path, |_| Ok(()))
    }

    /// Everything that the file says about itself, by key.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }
    /// Its columns.
    pub fn schema(&self) -> &SchemaRef {
        self.arrow.schema()
    }
    /// The hash of the file.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn hash(&self) -> Result<Hash, StoreError> {
        crate::whole_file::hash_of_file(&self.path)
    }
    /// The number of its first row in a recording of several files.
    pub fn first_row(&self) -> u64 {
        let said = self.metadata.get(crate::segment::FIRST_ROW);
        said.and_then(|n| n.parse().ok()).unwrap_or(0)
    }
    /// The number of rows.
    pub fn len(&self) -> u64 {
        self.rows
    }
    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// All rows, some thousand at a time.
    ///
    /// # Errors
    /// The file is damaged; each item may say so too, when the damage is met later, and is the last one then.
    pub fn batches(&self) -> Result<impl Iterator<Item = Result<RecordBatch, StoreError>> + use<>, StoreError> {
        let path = self.path.clone();
        let mut reader = Some(guarded(&path, || {
            ParquetRecordBatchReaderBuilder::new_with_metadata(self.file.try_clone()?, self.arrow.clone())
                .with_batch_size(PAGE)
                .build()
        })?);
        Ok(std::iter::from_fn(move || {
            let open = reader.as_mut()?;
            let next = guarded(&path, || Ok(open.next().transpose()?)).transpose()?;
            if next.is_err() {
                reader = None;
            }
            Some(next)
        }))
    }
}

/// Runs the Parquet decoder on bytes of unknown health. Damage by accident is found by the hashes before; a file made to hurt may still
/// bring the decoder to a panic, and that is a damaged file and not a fault of ours.
pub(crate) fn guarded<T>(path: &Path, work: impl FnOnce() -> parquet::errors::Result<T>) -> Result<T, StoreError> {
    let damaged = |what: String| StoreError::Damaged {
        path: path.to_owned(),
        what,
    };
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => done.map_err(|e| damaged(e.to_string())),
        Err(_) => Err(damaged("the Parquet decoder gave up on it".to_owned())),
    }
}

/// Holds metadata and data against the hashes in the metadata.
fn check_hashes(file: &mut File, metadata: &BTreeMap<String, String>) -> Result<(), String> {
    let said = |key: &str| metadata.get(key).ok_or_else(|| format!("its metadata has no {key}"));
    if *said(key::DIGEST)? != schema::digest(metadata).to_string() {
        return Err("its metadata is not what was written".to_owned());
    }
    let data = said(key::DATA)?;
    let (length, hash) = data
        .split_once(' ')
        .ok_or("its metadata does not tell the hash of its data")?;
    let length = length
        .parse()
        .map_err(|_| "its metadata does not tell the length of its data")?;
    file.rewind().map_err(|e| e.to_string())?;
    let found = hash_of(&mut file.take(length)).map_err(|e| e.to_string())?;
    if found.to_string() == hash {
        Ok(())
    } else {
        Err("its rows are not what was written".to_owned())
    }
}

fn unwritable(path: &Path) -> impl Fn(ParquetError) -> StoreError + use<> {
    let path = path.to_owned();
    move |e| StoreError::Unwritable {
        path: path.clone(),
        what: e.to_string(),
    }
}

fn refused(path: &Path) -> impl Fn(ArrowError) -> StoreError + use<> {
    crate::segment::unwritable(path)
}

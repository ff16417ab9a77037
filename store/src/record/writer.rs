//! Writes a record row by row, in constant memory.

use super::schema::{self, Header, PAGE, key};
use crate::StoreError;
use crate::whole_file::WholeFile;
use arrow_array::builder::{Int32Builder, Int64Builder, TimestampMicrosecondBuilder, UInt8Builder};
use arrow_array::{ArrayRef, RecordBatch};
use ledger::{Event, Hash};
use machine::{CHANNELS, Sample};
use parquet::arrow::{ArrowWriter, encode_arrow_schema};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use units::{Tick, Timestamp};

/// A record in the making: `x.parquet.tmp` until [`Writer::finish`]. Dropped before, it leaves nothing behind.
///
/// The same header, rows and events give the same bytes.
pub struct Writer {
    path: PathBuf,
    start: Timestamp,
    parquet: ArrowWriter<WholeFile>,
    metadata: BTreeMap<String, String>,
    rows: Rows,
    written: u64,
    first: Option<Tick>,
    last: Option<Tick>,
    unavailable: u64,
}

/// A record that is whole and on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finished {
    /// Where.
    pub path: PathBuf,
    /// Number of rows.
    pub rows: u64,
    /// Time of the first and the last row, microseconds UTC; `None` without rows.
    pub span_us: Option<(i64, i64)>,
    /// Length of the file.
    pub bytes: u64,
    /// Hash of the file.
    pub hash: Hash,
    /// Readings that were not a number or did not fit into their column; they stand as null.
    pub unavailable: u64,
}

impl Writer {
    /// Starts a record that will stand at `path`.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, header: &Header) -> Result<Writer, StoreError> {
        let unwritable = unwritable(path);
        let file = WholeFile::create(path)?;
        let properties = schema::properties(header).map_err(&unwritable)?;
        let mut metadata = schema::metadata(header);
        // The library adds this pair by itself; the digest has to cover it.
        metadata.insert(key::ARROW_SCHEMA.to_owned(), encode_arrow_schema(&schema::arrow_schema()));
        Ok(Writer {
            path: path.to_owned(),
            start: header.start,
            metadata,
            parquet: ArrowWriter::try_new(file, schema::arrow_schema(), Some(properties)).map_err(&unwritable)?,
            rows: Rows::new(),
            written: 0,
            first: None,
            last: None,
            unavailable: 0,
        })
    }

    /// Adds one row.
    ///
    /// # Errors
    /// Its tick is not later than the last one's, a number does not fit, or the disk refuses. A row that was refused is not in the
    /// record.
    pub fn write(&mut self, sample: &Sample) -> Result<(), StoreError> {
        if let Some(last) = self.last
            && sample.tick <= last
        {
            return Err(StoreError::OutOfOrder {
                path: self.path.clone(),
                last,
                found: sample.tick,
            });
        }
        let too_large = |column, value: u64| StoreError::TooLarge {
            path: self.path.clone(),
            column,
            value,
        };
        let number = |column, value: u32| i32::try_from(value).map_err(|_| too_large(column, u64::from(value)));
        let tick = i64::try_from(sample.tick.0).map_err(|_| too_large(schema::TICK, sample.tick.0))?;
        // i64 nanoseconds, as `Timestamp::at` counts them, end in 2262.
        let at = tick
            .checked_mul(1_000_000)
            .and_then(|ns| ns.checked_add(self.start.0))
            .ok_or_else(|| too_large(schema::TS, sample.tick.0))?;
        let step = number(schema::STEP, sample.step.0)?;
        let workingstep = number(schema::WORKINGSTEP, sample.workingstep.0)?;
        let tool = number(schema::TOOL, sample.tool.0)?;

        let rows = &mut self.rows;
        rows.ts.append_value(Timestamp(at).micros());
        rows.tick.append_value(tick);
        rows.step.append_value(step);
        rows.workingstep.append_value(workingstep);
        rows.tool.append_value(tool);
        rows.phase.append_value(sample.phase as u8);
        rows.quality.append_value(sample.quality as u8);
        for (channel, column) in CHANNELS.iter().zip(&mut rows.channels) {
            let quanta = (channel.read)(sample) / channel.scale;
            if quanta.abs() <= f64::from(i32::MAX) {
                column.append_value(channel.quantise(sample));
            } else {
                column.append_null();
                self.unavailable += 1;
            }
        }
        self.first = self.first.or(Some(sample.tick));
        self.last = Some(sample.tick);
        self.written += 1;
        if self.written.is_multiple_of(PAGE as u64) {
            self.flush()?;
        }
        Ok(())
    }

    /// Number of rows so far.
    pub fn rows(&self) -> u64 {
        self.written
    }

    /// Ends the record with all events of the job and makes it last: content, name, folder. From here on it can be catalogued.
    ///
    /// # Errors
    /// The disk refuses; there is no file then.
    pub fn finish(mut self, events: &[Event]) -> Result<Finished, StoreError> {
        self.flush()?;
        let unwritable = unwritable(&self.path);
        self.parquet.flush().map_err(&unwritable)?;
        self.parquet.sync().map_err(StoreError::io("write", &self.path))?;
        let (length, data) = self.parquet.inner().so_far();
        let mut late = BTreeMap::from([
            (key::ROWS, self.written.to_string()),
            (key::UNAVAILABLE, self.unavailable.to_string()),
            (
                key::EVENTS,
                serde_json::to_string(events).expect("events are maps with text keys, always JSON"),
            ),
            (key::DATA, format!("{length} {data}")),
        ]);
        let mut all = self.metadata;
        all.extend(late.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
        late.insert(key::DIGEST, schema::digest(&all).to_string());
        for (key, value) in late {
            self.parquet.append_key_value_metadata(KeyValue::new(key.to_owned(), value));
        }
        let (bytes, hash) = self.parquet.into_inner().map_err(unwritable)?.finish()?;
        let micros = |tick: Tick| self.start.at(tick).micros();
        Ok(Finished {
            path: self.path,
            rows: self.written,
            span_us: self.first.zip(self.last).map(|(first, last)| (micros(first), micros(last))),
            bytes,
            hash,
            unavailable: self.unavailable,
        })
    }

    fn flush(&mut self) -> Result<(), StoreError> {
        let unwritable = unwritable(&self.path);
        let batch = self.rows.take().map_err(|e| unwritable(e.into()))?;
        self.parquet.write(&batch).map_err(unwritable)
    }
}

fn unwritable(path: &Path) -> impl Fn(ParquetError) -> StoreError + use<> {
    let path = path.to_owned();
    move |e| StoreError::Unwritable {
        path: path.clone(),
        what: e.to_string(),
    }
}

/// Rows that were not given to the encoder yet, at most a page of them.
struct Rows {
    ts: TimestampMicrosecondBuilder,
    tick: Int64Builder,
    step: Int32Builder,
    workingstep: Int32Builder,
    tool: Int32Builder,
    phase: UInt8Builder,
    quality: UInt8Builder,
    channels: Vec<Int32Builder>,
}

impl Rows {
    fn new() -> Rows {
        Rows {
            ts: TimestampMicrosecondBuilder::with_capacity(PAGE).with_timezone("UTC"),
            tick: Int64Builder::with_capacity(PAGE),
            step: Int32Builder::with_capacity(PAGE),
            workingstep: Int32Builder::with_capacity(PAGE),
            tool: Int32Builder::with_capacity(PAGE),
            phase: UInt8Builder::with_capacity(PAGE),
            quality: UInt8Builder::with_capacity(PAGE),
            channels: CHANNELS.iter().map(|_| Int32Builder::with_capacity(PAGE)).collect(),
        }
    }

    /// Takes the rows out, in the order of the schema.
    fn take(&mut self) -> Result<RecordBatch, arrow_schema::ArrowError> {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.ts.finish()),
            Arc::new(self.tick.finish()),
            Arc::new(self.step.finish()),
            Arc::new(self.workingstep.finish()),
            Arc::new(self.tool.finish()),
            Arc::new(self.phase.finish()),
            Arc::new(self.quality.finish()),
        ];
        columns.extend(self.channels.iter_mut().map(|c| Arc::new(c.finish()) as ArrayRef));
        RecordBatch::try_new(schema::arrow_schema(), columns)
    }
}

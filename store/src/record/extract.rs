//! A part of a record as a record of its own: some channels, some time.

use super::schema::{self, key};
use super::{Finished, Reader};
use crate::StoreError;
use crate::whole_file::WholeFile;
use arrow_array::cast::AsArray;
use arrow_array::types::TimestampMicrosecondType;
use arrow_array::{Array, RecordBatch};
use arrow_schema::Schema;
use parquet::arrow::{ArrowWriter, encode_arrow_schema};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Of what an extract was taken: the hash of the record, in the file's metadata.
const EXTRACT_OF: &str = "toolmark.extract_of_sha256";

/// Writes the rows of `span` (microseconds UTC) of a record, with the columns of time and place and the given channels, as a record at
/// `to`. It carries all events of the job, and the hash of the record it was taken from.
///
/// # Errors
/// The record is damaged, or `to` cannot be written. A channel that the record does not have is left out; ask
/// [`Reader::columns`] before.
pub fn extract(record: &Reader, channels: &[&str], span: Range<i64>, to: &Path) -> Result<Finished, StoreError> {
    let unwritable = |e: ParquetError| StoreError::Unwritable {
        path: to.to_owned(),
        what: e.to_string(),
    };
    let file = WholeFile::create(to)?;
    let wanted = |name: &str| !record.columns().iter().any(|c| c.name == name) || channels.contains(&name);
    let whole = record.arrow_schema();
    let columns: Vec<usize> = (0..whole.fields().len()).filter(|k| wanted(whole.field(*k).name())).collect();
    let arrow = Arc::new(Schema::new(
        columns.iter().map(|k| Arc::clone(&whole.fields()[*k])).collect::<Vec<_>>(),
    ));
    let properties = schema::properties(record.header()).map_err(unwritable)?;
    let mut parquet = ArrowWriter::try_new(file, Arc::clone(&arrow), Some(properties)).map_err(unwritable)?;
    let (mut rows, mut unavailable, mut span_us) = (0, 0, None);
    for batch in record.batches()? {
        let batch = batch?;
        let ts = batch
            .arrow()
            .column_by_name(schema::TS)
            .expect("checked when the batch was made");
        let ts = ts.as_primitive::<TimestampMicrosecondType>();
        // Rows rise in time: what is wanted is one piece.
        let from = ts.values().partition_point(|t| *t < span.start);
        let until = ts.values().partition_point(|t| *t < span.end);
        if from >= until {
            continue;
        }
        let (first, last) = (ts.value(from), ts.value(until - 1));
        span_us = Some((span_us.map_or(first, |(first, _)| first), last));
        let part = batch.arrow().slice(from, until - from);
        let part = columns.iter().map(|k| Arc::clone(part.column(*k))).collect();
        let part = RecordBatch::try_new(Arc::clone(&arrow), part).map_err(|e| unwritable(e.into()))?;
        rows += part.num_rows() as u64;
        unavailable += part.columns().iter().map(|c| c.null_count() as u64).sum::<u64>();
        parquet.write(&part).map_err(unwritable)?;
    }
    parquet.flush().map_err(unwritable)?;
    parquet.sync().map_err(StoreError::io("write", to))?;
    let (length, data) = parquet.inner().so_far();
    let base = schema::metadata(record.header());
    let of_this_file = [key::ROWS, key::UNAVAILABLE, key::DATA, key::DIGEST, key::ARROW_SCHEMA];
    // What the source says of itself goes on being true, but for what is said of its rows.
    let mut late: BTreeMap<String, String> = record
        .metadata()
        .iter()
        .filter(|(k, _)| !base.contains_key(*k) && !of_this_file.contains(&k.as_str()))
        .map(|(k, v)| (k.clone(), v.clone()))
        .collect();
    late.insert(EXTRACT_OF.to_owned(), record.hash()?.to_string());
    late.insert(key::ROWS.to_owned(), rows.to_string());
    late.insert(key::UNAVAILABLE.to_owned(), unavailable.to_string());
    late.insert(key::DATA.to_owned(), format!("{length} {data}"));
    let mut all = base;
    all.insert(key::ARROW_SCHEMA.to_owned(), encode_arrow_schema(&arrow));
    all.extend(late.clone());
    late.insert(key::DIGEST.to_owned(), schema::digest(&all).to_string());
    for (key, value) in late {
        parquet.append_key_value_metadata(KeyValue::new(key, value));
    }
    let (bytes, hash) = parquet.into_inner().map_err(unwritable)?.finish()?;
    Ok(Finished {
        path: to.to_owned(),
        rows,
        span_us,
        bytes,
        hash,
        unavailable,
    })
}

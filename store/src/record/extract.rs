//! A part of a record as a record of its own: some channels, some time.

use super::schema::{self, key};
use super::{Finished, Reader, writer};
use crate::StoreError;
use crate::table::TableWriter;
use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::TimestampMicrosecondType;
use arrow_schema::Schema;
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
    let wanted = |name: &str| !record.columns().iter().any(|c| c.name == name) || channels.contains(&name);
    let whole = record.arrow_schema();
    let columns: Vec<usize> = (0..whole.fields().len()).filter(|k| wanted(whole.field(*k).name())).collect();
    let arrow = Arc::new(Schema::new(
        columns.iter().map(|k| Arc::clone(&whole.fields()[*k])).collect::<Vec<_>>(),
    ));
    // What the source says of itself goes on being true, but for what is said of its rows.
    let of_its_rows = [
        key::ROWS,
        key::UNAVAILABLE,
        key::EVENTS,
        key::DATA,
        key::DIGEST,
        key::ARROW_SCHEMA,
    ];
    let mut metadata = record.metadata().clone();
    metadata.retain(|key, _| !of_its_rows.contains(&key.as_str()));
    metadata.insert(EXTRACT_OF.to_owned(), record.hash()?.to_string());
    let mut table = TableWriter::create(to, &arrow, metadata)?;
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
        if from < until {
            let part = batch.arrow().slice(from, until - from);
            let part = columns.iter().map(|k| Arc::clone(part.column(*k))).collect();
            let part = RecordBatch::try_new(Arc::clone(&arrow), part).map_err(|e| StoreError::Unwritable {
                path: to.to_owned(),
                what: e.to_string(),
            })?;
            table.write(&part)?;
        }
    }
    writer::finish(to, table, &record.events()?, &[])
}

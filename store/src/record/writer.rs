//! Writes a record row by row, in constant memory.

use super::rows::SampleRows;
use super::schema::{self, Header, PAGE, key};
use crate::StoreError;
use crate::segment::{Layout, Rows as _};
use crate::table::TableWriter;
use arrow_array::RecordBatch;
use ledger::{Event, Hash};
use machine::Sample;
use std::path::{Path, PathBuf};

/// A record in the making: `x.parquet.tmp` until [`Writer::finish`]. Dropped before, it leaves nothing behind.
///
/// The same header, rows and events give the same bytes. What is written here is on disk when it is finished and not before; a run on a
/// machine goes through a [`crate::segment::Recorder`].
pub struct Writer {
    path: PathBuf,
    table: TableWriter,
    rows: SampleRows,
    written: u64,
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
        Ok(Writer {
            path: path.to_owned(),
            table: TableWriter::create(path, &schema::arrow_schema(), schema::metadata(header))?,
            rows: SampleRows::new(header.start, path),
            written: 0,
        })
    }

    /// Adds one row.
    ///
    /// # Errors
    /// Its tick is not later than the last one's, a number does not fit, or the disk refuses. A row that was refused is not in the
    /// record.
    pub fn write(&mut self, sample: &Sample) -> Result<(), StoreError> {
        self.rows.push(sample)?;
        self.written += 1;
        if self.rows.len() == PAGE {
            self.table.write(&self.rows.take()?)?;
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
        self.table.write(&self.rows.take()?)?;
        finish(&self.path, self.table, events, &[])
    }
}

/// Writes a record of other channels than our machine's, by columns: what was recorded elsewhere.
pub struct ColumnsWriter {
    path: PathBuf,
    table: TableWriter,
}

impl ColumnsWriter {
    /// Starts a record that will stand at `path`. The layout is one of [`Layout::samples`].
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, header: &Header, layout: &Layout) -> Result<ColumnsWriter, StoreError> {
        Ok(ColumnsWriter {
            path: path.to_owned(),
            table: TableWriter::create(path, &layout.schema(), schema::metadata(header))?,
        })
    }

    /// Adds rows, in order of time.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&mut self, batch: &RecordBatch) -> Result<(), StoreError> {
        self.table.write(batch)
    }

    /// Ends the record with all events of its job and makes it last.
    ///
    /// # Errors
    /// The disk refuses; there is no file then.
    pub fn finish(self, events: &[Event]) -> Result<Finished, StoreError> {
        finish(&self.path, self.table, events, &[])
    }
}

/// Ends a table as a record: events and counts go into its metadata.
pub(crate) fn finish(
    path: &Path,
    mut table: TableWriter,
    events: &[Event],
    more: &[(&str, String)],
) -> Result<Finished, StoreError> {
    table.finish()?;
    let (rows, span_us, unavailable) = (table.rows, table.span_us, table.unavailable);
    let mut late = vec![
        (key::ROWS, rows.to_string()),
        (key::UNAVAILABLE, unavailable.to_string()),
        (
            key::EVENTS,
            serde_json::to_string(events).expect("events are maps with text keys, always JSON"),
        ),
    ];
    late.extend_from_slice(more);
    let written = table.close(&late)?;
    Ok(Finished {
        path: path.to_owned(),
        rows,
        span_us,
        bytes: written.bytes,
        hash: written.hash,
        unavailable,
    })
}

//! A recording as a row of segments in a folder of its own: `0001.segment`, `0002.segment`, ...
//!
//! A segment is closed when it is long enough, or given up when its disk failed a sync. Rows are numbered through all of them, so that
//! what stands in two (written to the first, and again to the second after the first's sync failed) is counted once.

use super::disk::Disk;
use super::gap::Gap;
use super::writer::{Options, Writer};
use crate::StoreError;
use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows and gaps that were added and not acknowledged.
enum Piece {
    Rows(RecordBatch),
    Gap(Gap),
}

/// The segments of one recording, being written.
pub(super) struct Parts {
    disk: Arc<dyn Disk>,
    folder: PathBuf,
    schema: SchemaRef,
    metadata: BTreeMap<String, String>,
    compress: bool,
    /// Rows of a segment.
    longest: u64,
    number: u32,
    writer: Option<Writer>,
    waiting: Vec<Piece>,
    acknowledged: u64,
    rows: u64,
}

impl Parts {
    pub(super) fn begin(
        disk: Arc<dyn Disk>,
        folder: &Path,
        schema: SchemaRef,
        metadata: BTreeMap<String, String>,
        compress: bool,
        longest: u64,
    ) -> Result<Parts, StoreError> {
        let mut parts = Parts {
            disk,
            folder: folder.to_owned(),
            schema,
            metadata,
            compress,
            longest,
            number: 0,
            writer: None,
            waiting: Vec::new(),
            acknowledged: 0,
            rows: 0,
        };
        parts.open()?;
        Ok(parts)
    }

    /// The segment in work; makes the next one when there is none, with everything in it that still waits.
    fn open(&mut self) -> Result<&mut Writer, StoreError> {
        let writer = match self.writer.take() {
            Some(writer) => writer,
            None => {
                let options = Options {
                    first_row: self.acknowledged,
                    compress: self.compress,
                };
                let path = self.folder.join(format!("{:04}.segment", self.number + 1));
                let mut writer = Writer::begin(&*self.disk, &path, &self.schema, &self.metadata, &options)?;
                self.number += 1;
                for piece in &self.waiting {
                    match piece {
                        Piece::Rows(batch) => writer.append(batch)?,
                        Piece::Gap(gap) => writer.gap(gap)?,
                    }
                }
                writer
            }
        };
        Ok(self.writer.insert(writer))
    }

    pub(super) fn append(&mut self, batch: RecordBatch) -> Result<(), StoreError> {
        if let Some(writer) = &mut self.writer {
            writer.append(&batch)?;
        }
        self.rows += batch.num_rows() as u64;
        self.waiting.push(Piece::Rows(batch));
        Ok(())
    }

    pub(super) fn gap(&mut self, gap: Gap) -> Result<(), StoreError> {
        if let Some(writer) = &mut self.writer {
            writer.gap(&gap)?;
        }
        self.waiting.push(Piece::Gap(gap));
        Ok(())
    }

    /// Rows that were added and not acknowledged.
    pub(super) fn unacknowledged(&self) -> u64 {
        self.rows - self.acknowledged
    }

    /// Makes everything that was added last. Gives the acknowledged rows, and a segment that this closed.
    pub(super) fn sync(&mut self) -> Result<(u64, Option<PathBuf>), StoreError> {
        let synced = self.open()?.sync();
        self.give_up_after_a_failed_sync(synced)?;
        self.acknowledged = self.rows;
        self.waiting.clear();
        let closed = match &mut self.writer {
            Some(writer) if writer.rows() - writer.first_row() >= self.longest => Some(writer.path().to_owned()),
            _ => None,
        };
        if closed.is_some() {
            self.end()?;
        }
        Ok((self.acknowledged, closed))
    }

    /// Makes everything last and ends the segment in work.
    pub(super) fn end(&mut self) -> Result<(), StoreError> {
        if self.writer.is_none() && self.waiting.is_empty() && self.number > 0 {
            return Ok(());
        }
        let ended = self.open()?.end();
        self.give_up_after_a_failed_sync(ended)?;
        self.acknowledged = self.rows;
        self.waiting.clear();
        self.writer = None;
        Ok(())
    }

    /// After a failed sync nobody knows what is on the medium, and the next sync of the same file may say that all is well: the kernel
    /// tells an error once. So the segment stays as it is, and what was not acknowledged goes into a new one.
    fn give_up_after_a_failed_sync(&mut self, done: Result<u64, StoreError>) -> Result<u64, StoreError> {
        if let Err(StoreError::Io { doing: "sync", .. }) = &done {
            self.writer = None;
        }
        done
    }
}

//! Appends frames to one segment file. For sources that wait for their acknowledgement themselves; a sampling thread uses
//! [`super::Recorder`].

use super::disk::{Disk, DiskFile};
use super::frame::{self, Kind, MAGIC};
use super::gap::Gap;
use crate::StoreError;
use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::TimestampMicrosecondType;
use arrow_ipc::writer::StreamEncoder;
use arrow_schema::{ArrowError, SchemaRef};
use ledger::Event;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How a segment is written.
#[derive(Clone, Debug)]
pub struct Options {
    /// Number of the first row of this segment in its recording.
    pub first_row: u64,
    /// Compress rows with zstd: fewer bytes for the disk, more work before each write.
    pub compress: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            first_row: 0,
            compress: true,
        }
    }
}

/// Key of a segment's metadata: number of its first row in its recording.
pub(crate) const FIRST_ROW: &str = "toolmark.first_row";
/// Rows of a frame, at most.
pub(crate) const FRAME_ROWS: usize = 8192;
/// The column that tells the time of a row, when there is one.
pub(crate) const TS: &str = "ts";

/// A segment in the making. Rows are *appended* (in memory), then *acknowledged* (on the medium) by [`Writer::sync`].
pub struct Writer {
    path: PathBuf,
    schema: SchemaRef,
    encoder: StreamEncoder,
    compressor: Option<zstd::bulk::Compressor<'static>>,
    file: Box<dyn DiskFile>,
    /// Frames that are not on the medium yet.
    waiting: Vec<u8>,
    /// Bytes that are.
    length: u64,
    seq: u64,
    first_row: u64,
    rows: u64,
    acknowledged: u64,
    ended: bool,
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Writer({}, {} rows)", self.path.display(), self.rows)
    }
}

impl Writer {
    /// Starts a segment: its head, schema and metadata are on the medium when this returns. The metadata is what the finished Parquet
    /// file will say about itself.
    ///
    /// # Errors
    /// The file is there already, or the disk refuses.
    pub fn begin(
        disk: &dyn Disk,
        path: &Path,
        schema: &SchemaRef,
        metadata: &BTreeMap<String, String>,
        options: &Options,
    ) -> Result<Writer, StoreError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        if !folder.is_dir() {
            std::fs::create_dir_all(folder).map_err(StoreError::io("create", folder))?;
            // The name of the folder must last as well, or all that is in it is gone with it.
            crate::whole_file::sync_folder_of(folder)?;
        }
        let mut said: std::collections::HashMap<String, String> = metadata.clone().into_iter().collect();
        said.insert(FIRST_ROW.to_owned(), options.first_row.to_string());
        let schema = Arc::new(schema.as_ref().clone().with_metadata(said));
        let encoder = StreamEncoder::try_new(&schema).map_err(unwritable(path))?;
        let compressor = options.compress.then(|| zstd::bulk::Compressor::new(1)).transpose();
        let mut writer = Writer {
            path: path.to_owned(),
            encoder,
            compressor: compressor.map_err(StoreError::io("compress", path))?,
            file: disk.create(path).map_err(StoreError::io("create", path))?,
            waiting: MAGIC.to_vec(),
            length: 0,
            seq: 0,
            first_row: options.first_row,
            rows: options.first_row,
            acknowledged: options.first_row,
            ended: false,
            schema,
        };
        // An empty batch makes the encoder say the schema.
        let ipc = writer.encoder.encode(&RecordBatch::new_empty(Arc::clone(&writer.schema)));
        let ipc = ipc.map_err(unwritable(path))?;
        writer.put(0, Kind::Schema, |out| {
            ipc.iter().for_each(|part| out.extend_from_slice(part));
            Ok(())
        })?;
        let begun = writer
            .sync()
            .and_then(|_| disk.sync_folder(folder).map_err(StoreError::io("sync", folder)));
        match begun {
            Ok(()) => Ok(writer),
            Err(error) => {
                // A file without a schema is of no use to anybody.
                let _ = disk.remove(path);
                Err(error)
            }
        }
    }

    /// Adds rows. They are in memory until [`Writer::sync`].
    ///
    /// # Errors
    /// They are not of this segment's schema.
    pub fn append(&mut self, batch: &RecordBatch) -> Result<(), StoreError> {
        if batch.num_rows() > FRAME_ROWS {
            let pieces = (0..batch.num_rows()).step_by(FRAME_ROWS);
            return pieces
                .map(|at| batch.slice(at, FRAME_ROWS.min(batch.num_rows() - at)))
                .try_for_each(|piece| self.append(&piece));
        }
        if batch.num_rows() == 0 {
            return Ok(());
        }
        // The metadata of the schema is the segment's own business; its columns must be the same.
        let batch = RecordBatch::try_new(Arc::clone(&self.schema), batch.columns().to_vec()).map_err(unwritable(&self.path))?;
        let ipc = self.encoder.encode(&batch).map_err(unwritable(&self.path))?;
        let (first, count) = (self.rows, batch.num_rows() as u64);
        let t_first = time_of(&batch, 0).unwrap_or(0);
        let head = |out: &mut Vec<u8>| {
            out.extend(first.to_le_bytes());
            out.extend((count as u32).to_le_bytes());
        };
        match self.compressor.take() {
            Some(mut compressor) => {
                let whole: Vec<u8> = ipc.iter().flat_map(|part| part.as_slice()).copied().collect();
                let packed = compressor.compress(&whole).map_err(StoreError::io("compress", &self.path));
                self.compressor = Some(compressor);
                let packed = packed?;
                self.put(t_first, Kind::CompressedBatch, |out| {
                    head(out);
                    out.extend((whole.len() as u32).to_le_bytes());
                    out.extend(packed);
                    Ok(())
                })?;
            }
            None => self.put(t_first, Kind::Batch, |out| {
                head(out);
                ipc.iter().for_each(|part| out.extend_from_slice(part));
                Ok(())
            })?,
        }
        self.rows += count;
        Ok(())
    }

    /// Says that rows are missing here.
    ///
    /// # Errors
    /// The segment has ended.
    pub fn gap(&mut self, gap: &Gap) -> Result<(), StoreError> {
        let text = serde_json::to_vec(gap).expect("numbers and a word are always JSON");
        self.put(0, Kind::Gap, |out| {
            out.extend(text);
            Ok(())
        })
    }

    /// Keeps an event among the rows.
    ///
    /// # Errors
    /// The segment has ended.
    pub fn event(&mut self, event: &Event) -> Result<(), StoreError> {
        let text = serde_json::to_vec(event).expect("events are maps with text keys, always JSON");
        self.put(event.at().micros(), Kind::Event, |out| {
            out.extend(text);
            Ok(())
        })
    }

    /// One write and one sync for everything that was added since the last one. Gives the number of rows that are acknowledged now,
    /// counted from the recording's first.
    ///
    /// # Errors
    /// The disk refuses. Nothing more is acknowledged then, what was added stays in memory, and the next call tries again; after an
    /// error of the sync itself (not of the write) a segment must be given up, because nobody knows what a second sync would mean.
    pub fn sync(&mut self) -> Result<u64, StoreError> {
        if !self.waiting.is_empty() {
            if let Err(error) = self.file.write_at(self.length, &self.waiting) {
                // What a full disk took of it is no frame; the next try writes over it in any case.
                let _ = self.file.cut(self.length);
                return Err(StoreError::io("write", &self.path)(error));
            }
            self.file.sync().map_err(StoreError::io("sync", &self.path))?;
            self.length += self.waiting.len() as u64;
            self.waiting.clear();
        }
        self.acknowledged = self.rows;
        Ok(self.acknowledged)
    }

    /// Ends the segment; everything is on the medium when this returns.
    ///
    /// # Errors
    /// The disk refuses; calling again tries again.
    pub fn end(&mut self) -> Result<u64, StoreError> {
        if !self.ended {
            let rows = self.rows.to_le_bytes();
            self.put(0, Kind::End, |out| {
                out.extend(rows);
                Ok(())
            })?;
            self.ended = true;
        }
        self.sync()
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// Rows so far, counted from the recording's first.
    pub fn rows(&self) -> u64 {
        self.rows
    }
    /// Number of its first row, counted the same way.
    pub fn first_row(&self) -> u64 {
        self.first_row
    }
    /// Rows that are on the medium, counted the same way.
    pub fn acknowledged(&self) -> u64 {
        self.acknowledged
    }
    /// Bytes on the medium.
    pub fn bytes(&self) -> u64 {
        self.length
    }

    fn put(
        &mut self,
        t_first: i64,
        kind: Kind,
        fill: impl FnOnce(&mut Vec<u8>) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        if self.ended {
            return Err(StoreError::Unwritable {
                path: self.path.clone(),
                what: "the segment has ended".to_owned(),
            });
        }
        if !frame::put(&mut self.waiting, self.seq, t_first, kind, fill)? {
            // Dictionaries that went into it would be missing in the frames behind it.
            self.ended = true;
            return Err(StoreError::Unwritable {
                path: self.path.clone(),
                what: format!(
                    "rows of more than {} MiB in one frame: give them in smaller batches",
                    frame::LONGEST >> 20
                ),
            });
        }
        self.seq += 1;
        Ok(())
    }
}

/// The time of a row, microseconds UTC, by its column `ts`.
pub(crate) fn time_of(batch: &RecordBatch, row: usize) -> Option<i64> {
    let ts = batch.column_by_name(TS)?.as_primitive_opt::<TimestampMicrosecondType>()?;
    (row < ts.len()).then(|| ts.value(row))
}

pub(crate) fn unwritable(path: &Path) -> impl Fn(ArrowError) -> StoreError + use<> {
    let path = path.to_owned();
    move |e| StoreError::Unwritable {
        path: path.clone(),
        what: e.to_string(),
    }
}

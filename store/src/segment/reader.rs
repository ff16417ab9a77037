//! Reads a segment back, whole or not: up to the first byte that is not as it was written.

use super::frame::{self, BadFrame, Frame, HEAD, Kind, MAGIC};
use super::gap::Gap;
use super::writer::{FIRST_ROW, time_of};
use crate::StoreError;
use arrow_array::RecordBatch;
use arrow_buffer::Buffer;
use arrow_ipc::reader::StreamDecoder;
use arrow_schema::{ArrowError, SchemaRef};
use ledger::Event;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// What is in a segment file.
#[derive(Clone, Debug)]
pub struct Recovered {
    /// The file.
    pub path: PathBuf,
    /// Its columns; metadata of the recording is in [`Recovered::metadata`].
    pub schema: SchemaRef,
    /// What was known of the recording when it began.
    pub metadata: BTreeMap<String, String>,
    /// Number of its first row in the recording.
    pub first_row: u64,
    /// Number of rows that are whole.
    pub rows: u64,
    /// Rows that were lost while it was written, in order.
    pub gaps: Vec<Gap>,
    /// Events among the rows, in order.
    pub events: Vec<Event>,
    /// What stands behind the last whole frame and cannot be read.
    pub lost: Option<Lost>,
    /// True when its writer ended it. False for one that is being written, or whose writer went away.
    pub ended: bool,
    /// Bytes up to the end of the last whole frame.
    pub whole: u64,
}

/// The part of a segment that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lost {
    /// Where it begins.
    pub at_byte: u64,
    /// How long it is. How many rows were in it nobody knows.
    pub bytes: u64,
    /// What was found there.
    pub why: BadFrame,
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes from byte {} on are lost: {}", self.bytes, self.at_byte, self.why)
    }
}

impl Lost {
    /// True when the bytes cannot have been acknowledged: a power loss or a kill cut the last write, or left zeros in its place. Anything
    /// else is damage to what was once good.
    pub fn is_unfinished_write(&self) -> bool {
        matches!(self.why, BadFrame::Cut { .. } | BadFrame::Zeros)
    }
}

/// Reads a segment: checks every frame, and says what is there and what is lost. Rows come from [`Recovered::batches`].
///
/// # Errors
/// The file cannot be read at all, or its head is not that of a segment.
pub fn read(path: &Path) -> Result<Recovered, StoreError> {
    let mut frames = Frames::open(path)?;
    let damaged = |what: String| StoreError::Damaged {
        path: path.to_owned(),
        what,
    };
    let schema = match frames.next(path)? {
        Step::Frame(first) if first.kind == Kind::Schema => {
            let (mut decoder, payload) = (StreamDecoder::new(), first.payload.to_vec());
            guarded(|| decoder.decode(&mut payload.into())).map_err(&damaged)?;
            decoder
                .schema()
                .ok_or_else(|| damaged("its first frame has no schema".to_owned()))?
        }
        Step::Frame(_) => return Err(damaged("it does not begin with its schema".to_owned())),
        Step::Bad(lost) => return Err(damaged(format!("its schema: {}", lost.why))),
        Step::End => return Err(damaged("it has no schema".to_owned())),
    };
    let metadata: BTreeMap<String, String> = schema.metadata().clone().into_iter().collect();
    let first_row = metadata.get(FIRST_ROW).and_then(|text| text.parse().ok());
    let first_row = first_row.ok_or_else(|| damaged(format!("its metadata has no {FIRST_ROW}")))?;
    let mut found = Recovered {
        path: path.to_owned(),
        schema: schema.as_ref().clone().with_metadata(Default::default()).into(),
        metadata,
        first_row,
        rows: 0,
        gaps: Vec::new(),
        events: Vec::new(),
        lost: None,
        ended: false,
        whole: frames.at,
    };
    loop {
        let at = frames.at;
        let length = frames.length;
        let bad = |why| Lost {
            at_byte: at,
            bytes: length - at,
            why,
        };
        match frames.next(path)? {
            Step::End => break,
            Step::Bad(lost) => {
                found.lost = Some(lost);
                break;
            }
            Step::Frame(_) if found.ended => {
                found.lost = Some(bad(BadFrame::BehindTheEnd));
                break;
            }
            Step::Frame(frame) => match found.take(&frame) {
                Ok(()) => {}
                Err(what) => {
                    found.lost = Some(bad(BadFrame::Content(what)));
                    break;
                }
            },
        }
        found.whole = frames.at;
    }
    if found.ended && found.lost.as_ref().is_some_and(|lost| lost.why != BadFrame::BehindTheEnd) {
        // Whatever stands there, it is behind the end, and no row of the segment.
        found.lost.iter_mut().for_each(|lost| lost.why = BadFrame::BehindTheEnd);
    }
    Ok(found)
}

impl Recovered {
    fn take(&mut self, frame: &Frame<'_>) -> Result<(), String> {
        match frame.kind {
            Kind::Schema => return Err("a second schema".to_owned()),
            Kind::Batch | Kind::CompressedBatch => {
                let (first, count, _) = batch_head(frame.payload)?;
                let expected = self.first_row + self.rows;
                if first != expected {
                    return Err(format!("rows from {first} on stand where {expected} was expected"));
                }
                self.rows += u64::from(count);
            }
            Kind::Gap => self
                .gaps
                .push(serde_json::from_slice(frame.payload).map_err(|e| e.to_string())?),
            Kind::Event => self
                .events
                .push(serde_json::from_slice(frame.payload).map_err(|e| e.to_string())?),
            Kind::End => {
                let said = frame.payload.try_into().map(u64::from_le_bytes).map_err(|e| e.to_string())?;
                if said != self.first_row + self.rows {
                    return Err(format!(
                        "its end tells of {said} rows, and {} are there",
                        self.first_row + self.rows
                    ));
                }
                self.ended = true;
            }
        }
        Ok(())
    }

    /// The whole rows, in order, as they were appended.
    ///
    /// # Errors
    /// The file is gone; each item may say that it changed, and is the last one then.
    pub fn batches(&self) -> Result<impl Iterator<Item = Result<RecordBatch, StoreError>> + use<>, StoreError> {
        let mut frames = Frames::open(&self.path)?;
        let (path, whole, mut decoder, mut over) = (self.path.clone(), self.whole, StreamDecoder::new(), false);
        Ok(std::iter::from_fn(move || {
            while !over && frames.at < whole {
                let next = match frames.next(&path) {
                    Ok(Step::Frame(frame)) => decode(&mut decoder, &frame),
                    Ok(Step::Bad(lost)) => Err(lost.to_string()),
                    Ok(Step::End) => Err("it became shorter while it was read".to_owned()),
                    Err(error) => {
                        over = true;
                        return Some(Err(error));
                    }
                };
                match next {
                    Ok(None) => {}
                    Ok(Some(batch)) => return Some(Ok(batch)),
                    Err(what) => {
                        over = true;
                        let path = path.clone();
                        return Some(Err(StoreError::Damaged { path, what }));
                    }
                }
            }
            None
        }))
    }

    /// Time of the first and the last row, microseconds UTC; `None` without rows or times. Reads the file.
    ///
    /// # Errors
    /// As [`Recovered::batches`].
    pub fn span_us(&self) -> Result<Option<(i64, i64)>, StoreError> {
        let mut span = None;
        for batch in self.batches()? {
            let batch = batch?;
            let (first, last) = (time_of(&batch, 0), time_of(&batch, batch.num_rows().saturating_sub(1)));
            if let (Some(first), Some(last)) = (first, last) {
                span = Some((span.map_or(first, |(from, _)| from), last));
            }
        }
        Ok(span)
    }
}

/// First row, count, and the rest.
fn batch_head(payload: &[u8]) -> Result<(u64, u32, &[u8]), String> {
    let (first, rest) = payload.split_first_chunk::<8>().ok_or("a batch without its head")?;
    let (count, rest) = rest.split_first_chunk::<4>().ok_or("a batch without its head")?;
    Ok((u64::from_le_bytes(*first), u32::from_le_bytes(*count), rest))
}

fn decode(decoder: &mut StreamDecoder, frame: &Frame<'_>) -> Result<Option<RecordBatch>, String> {
    let ipc = match frame.kind {
        Kind::Gap | Kind::Event | Kind::End => return Ok(None),
        Kind::Schema => frame.payload.to_vec(),
        Kind::Batch => batch_head(frame.payload)?.2.to_vec(),
        Kind::CompressedBatch => {
            let (_, _, rest) = batch_head(frame.payload)?;
            let (length, packed) = rest.split_first_chunk::<4>().ok_or("a batch without its length")?;
            let length = u32::from_le_bytes(*length) as usize;
            if length > frame::LONGEST {
                return Err(format!("a batch of {length} bytes, which none has"));
            }
            zstd::bulk::decompress(packed, length).map_err(|e| e.to_string())?
        }
    };
    let mut ipc: Buffer = ipc.into();
    let mut batch = None;
    while !ipc.is_empty() && batch.is_none() {
        // The empty batch that came with the schema may come out here: the decoder gives a batch without a body with the bytes behind it.
        batch = guarded(|| decoder.decode(&mut ipc))?.filter(|batch| batch.num_rows() > 0);
    }
    if frame.kind == Kind::Schema {
        return Ok(None);
    }
    let batch = batch.ok_or("a frame of rows holds none")?;
    let said = batch_head(frame.payload)?.1;
    if batch.num_rows() != said as usize || !ipc.is_empty() {
        return Err(format!("a frame of {said} rows holds {}", batch.num_rows()));
    }
    let plain = batch.schema().as_ref().clone().with_metadata(Default::default());
    let batch = RecordBatch::try_new(plain.into(), batch.columns().to_vec());
    batch.map(Some).map_err(|e| e.to_string())
}

/// Checksums find damage by accident; a file made to hurt may still bring the decoder to a panic, and that is no fault of ours.
fn guarded<T>(work: impl FnOnce() -> Result<T, ArrowError>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => done.map_err(|e| e.to_string()),
        Err(_) => Err("the Arrow decoder gave up on it".to_owned()),
    }
}

/// The frames of a file, one in memory at a time.
struct Frames {
    file: BufReader<File>,
    /// Where the next frame begins.
    at: u64,
    length: u64,
    seq: u64,
    bytes: Vec<u8>,
}

enum Step<'a> {
    Frame(Frame<'a>),
    Bad(Lost),
    End,
}

impl Frames {
    fn open(path: &Path) -> Result<Frames, StoreError> {
        let mut file = File::open(path).map_err(StoreError::io("open", path))?;
        let length = file.metadata().map_err(StoreError::io("read", path))?.len();
        let mut magic = [0; MAGIC.len()];
        let read = file.read_exact(&mut magic);
        if read.is_err() || magic != MAGIC {
            return Err(StoreError::Damaged {
                path: path.to_owned(),
                what: "it does not begin as a segment".to_owned(),
            });
        }
        Ok(Frames {
            file: BufReader::with_capacity(1 << 16, file),
            at: MAGIC.len() as u64,
            length,
            seq: 0,
            bytes: Vec::new(),
        })
    }

    fn next(&mut self, path: &Path) -> Result<Step<'_>, StoreError> {
        let left = self.length.saturating_sub(self.at);
        if left == 0 {
            return Ok(Step::End);
        }
        let bad = |at_byte, why| {
            Step::Bad(Lost {
                at_byte,
                bytes: left,
                why,
            })
        };
        let mut prefix = [0; 8];
        if left < prefix.len() as u64 {
            let mut rest = vec![0; left as usize];
            self.file.read_exact(&mut rest).map_err(StoreError::io("read", path))?;
            let why = if rest.iter().all(|b| *b == 0) {
                BadFrame::Zeros
            } else {
                BadFrame::Cut {
                    there: left,
                    needed: HEAD as u64,
                }
            };
            return Ok(bad(self.at, why));
        }
        self.file.read_exact(&mut prefix).map_err(StoreError::io("read", path))?;
        let whole = match frame::length(&prefix, left) {
            Ok(whole) => whole,
            Err(why) => return Ok(bad(self.at, why)),
        };
        self.bytes.clear();
        self.bytes.extend(prefix);
        self.bytes.resize(whole, 0);
        self.file
            .read_exact(&mut self.bytes[prefix.len()..])
            .map_err(StoreError::io("read", path))?;
        let at = self.at;
        match frame::get(&self.bytes, self.seq) {
            Ok(frame) => {
                self.at += whole as u64;
                self.seq += 1;
                Ok(Step::Frame(frame))
            }
            Err(why) => {
                // A write that was cut may have left zeros inside what its length says.
                Ok(bad(at, why))
            }
        }
    }
}

/// Copies everything behind the last whole frame aside, as `x.segment.lost`, and cuts it off. Gives the place of the copy; `None` when
/// there was nothing but zeros.
///
/// # Errors
/// The disk refuses; the segment is as it was then.
pub fn cut(found: &Recovered) -> Result<Option<PathBuf>, StoreError> {
    let path = &found.path;
    let Some(lost) = &found.lost else {
        return Ok(None);
    };
    let mut file = File::options()
        .read(true)
        .write(true)
        .open(path)
        .map_err(StoreError::io("open", path))?;
    file.seek(SeekFrom::Start(lost.at_byte))
        .map_err(StoreError::io("read", path))?;
    let mut bytes = Vec::new();
    // What is kept is for a person to look at; a damaged frame early in a long segment must not ask for the memory of the house.
    (&mut file)
        .take(frame::LONGEST as u64)
        .read_to_end(&mut bytes)
        .map_err(StoreError::io("read", path))?;
    let mut aside = None;
    if bytes.iter().any(|b| *b != 0) {
        let mut name = path.as_os_str().to_owned();
        name.push(".lost");
        let name = PathBuf::from(name);
        let mut copy = crate::whole_file::WholeFile::create(&name)?;
        std::io::Write::write_all(&mut copy, &bytes).map_err(StoreError::io("write", &name))?;
        copy.finish()?;
        aside = Some(name);
    }
    file.set_len(found.whole).map_err(StoreError::io("cut", path))?;
    file.sync_all().map_err(StoreError::io("sync", path))?;
    Ok(aside)
}

//! The roll-up file: what it holds, how it lies on disk, and how a part of it is read.
//!
//! ```text
//! "TMRU" version:u32                              8 bytes
//! frame ...                                       length:u32 crc32c:u32 payload, little-endian
//!     for each block of buckets of a level: its times, then each channel's readings
//! frame                                           the directory: JSON that says where every frame stands
//! place of the directory:u64 crc32c of it:u32 "TMRU"
//! ```
//!
//! A level's buckets come in blocks of [`BLOCK`], one frame a channel, so that one curve of one hour is read without the rest of the day.
//! Numbers are told relative to their neighbours and packed by [`super::numbers`].

use super::numbers::{put, signed, take, unsigned};
use crate::StoreError;
use crate::record::Column;
use ledger::Hash;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Buckets of a frame: at 256 rows a bucket and 1 kHz, 17 minutes of the finest level.
pub(super) const BLOCK: usize = 4096;
pub(super) const MARK: &[u8; 4] = b"TMRU";
const VERSION: u32 = 1;
/// Place, check and mark at the end.
const END: usize = 16;
/// Length and check before a payload.
const HEAD: usize = 8;

/// What a roll-up says about itself and where its frames stand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Directory {
    /// SHA-256 of the record file it was made from.
    pub record: String,
    /// The machine's name.
    pub machine: String,
    /// True when a simulator made the rows.
    pub simulated: bool,
    /// Rows of the record.
    pub rows: u64,
    /// Two rows further apart than this have missing time between them, microseconds.
    pub gap_us: i64,
    /// The columns of readings.
    pub channels: Vec<ChannelText>,
    /// Stretches of rows with one workingstep, in order.
    pub stretches: Vec<Stretch>,
    /// The finest level first; each level's blocks in order.
    pub levels: Vec<Vec<BlockText>>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ChannelText {
    pub name: String,
    pub unit: String,
    pub scale: f64,
    pub offset: f64,
}

/// Rows that followed each other in one workingstep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Stretch {
    /// Its number.
    pub workingstep: i32,
    /// Place of its first row in the record, from 0.
    pub first_row: u64,
    /// How many rows.
    pub rows: u64,
    /// Time of its first row, microseconds UTC.
    pub first_us: i64,
    /// Time of its last row.
    pub last_us: i64,
}

/// Where a block of buckets stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BlockText {
    /// How many buckets.
    pub buckets: usize,
    /// Place of its first row in the record.
    pub first_row: u64,
    /// Time of its first row, microseconds UTC.
    pub first_us: i64,
    /// Time of its last row.
    pub last_us: i64,
    /// Where its first frame, that of the times, begins.
    pub at: u64,
    /// Lengths of the payloads: times, then each channel.
    pub lengths: Vec<u32>,
}

/// When the buckets of a block were, and how many rows they sum up.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Times {
    /// Time of the first row of each, microseconds UTC.
    pub first_us: Vec<i64>,
    /// Time of the last row of each.
    pub last_us: Vec<i64>,
    /// Place of the first row of each in the record; one more than buckets, the last being the end.
    pub row: Vec<u64>,
    /// How often time is missing between two rows inside of each.
    pub gaps: Vec<u32>,
    /// True where the rows of a bucket are all equally far apart: their times need not be read.
    pub even: Vec<bool>,
}

/// One channel's readings in the buckets of a block, in raw numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Readings {
    /// The summary of each bucket.
    pub buckets: Vec<Summary>,
}

/// What a bucket tells of one channel, in raw numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Summary {
    /// Readings that are there; without any the rest is 0.
    pub count: u64,
    /// Rows whose reading is unavailable.
    pub missing: u64,
    /// The least.
    pub min: i32,
    /// The greatest.
    pub max: i32,
    /// The first that is there.
    pub first: i32,
    /// The last that is there.
    pub last: i32,
    /// The sum of all.
    pub sum: i64,
}

impl Summary {
    /// Takes in what came after.
    pub(crate) fn add(&mut self, next: &Summary) {
        self.missing += next.missing;
        if next.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = Summary {
                missing: self.missing,
                ..*next
            };
            return;
        }
        self.count += next.count;
        self.min = self.min.min(next.min);
        self.max = self.max.max(next.max);
        self.last = next.last;
        self.sum += next.sum;
    }

    /// Takes in one row.
    pub(crate) fn add_reading(&mut self, reading: Option<i32>) {
        match reading {
            None => self.missing += 1,
            Some(raw) if self.count == 0 => {
                *self = Summary {
                    count: 1,
                    missing: self.missing,
                    min: raw,
                    max: raw,
                    first: raw,
                    last: raw,
                    sum: i64::from(raw),
                };
            }
            Some(raw) => {
                self.count += 1;
                self.min = self.min.min(raw);
                self.max = self.max.max(raw);
                self.last = raw;
                self.sum += i64::from(raw);
            }
        }
    }
}

impl Times {
    pub(super) fn starting_at(row: u64) -> Times {
        Times {
            row: vec![row],
            ..Times::default()
        }
    }

    pub(super) fn len(&self) -> usize {
        self.first_us.len()
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let before = |k: usize| if k == 0 { self.first_us[0] } else { self.last_us[k - 1] };
        let n = self.len();
        // As what differs from the bucket before: rows at a steady pace take no bits.
        put(&mut out, changes((0..n).map(|k| self.first_us[k].wrapping_sub(before(k)))));
        put(
            &mut out,
            changes((0..n).map(|k| self.last_us[k].wrapping_sub(self.first_us[k]))),
        );
        put(&mut out, changes((0..n).map(|k| (self.row[k + 1] - self.row[k]) as i64)));
        put(&mut out, self.gaps.iter().map(|&g| u64::from(g)));
        put(&mut out, self.even.iter().map(|&e| u64::from(!e)));
        out
    }

    fn decode(mut bytes: &[u8], block: &BlockText) -> Option<Times> {
        let n = block.buckets;
        let bytes = &mut bytes;
        let [since, length, rows] = [take(bytes, n)?, take(bytes, n)?, take(bytes, n)?].map(values);
        let [gaps, uneven] = [take(bytes, n)?, take(bytes, n)?];
        let mut times = Times::default();
        let (mut at, mut row) = (block.first_us, block.first_row);
        times.row.push(row);
        for k in 0..n {
            let first = at.wrapping_add(since[k]);
            at = first.wrapping_add(length[k]);
            times.first_us.push(first);
            times.last_us.push(at);
            row = row.checked_add(u64::try_from(rows[k]).ok()?)?;
            times.row.push(row);
            times.gaps.push(u32::try_from(gaps[k]).ok()?);
            times.even.push(uneven[k] == 0);
        }
        bytes.is_empty().then_some(times)
    }
}

impl Readings {
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let all = &self.buckets;
        put(&mut out, all.iter().map(|b| b.missing));
        // A bucket without a reading says so by its missing rows; it stands nowhere, so that the next one is told relative to the last
        // that does.
        let there = || all.iter().filter(|b| b.count > 0);
        let mut before = 0i64;
        put(
            &mut out,
            there().map(|b| {
                let since = i64::from(b.first) - before;
                before = i64::from(b.last);
                unsigned(since)
            }),
        );
        put(&mut out, there().map(|b| unsigned(i64::from(b.last) - i64::from(b.first))));
        put(
            &mut out,
            there().map(|b| (i64::from(b.first.min(b.last)) - i64::from(b.min)) as u64),
        );
        put(
            &mut out,
            there().map(|b| (i64::from(b.max) - i64::from(b.first.max(b.last))) as u64),
        );
        // Noise lies evenly about the middle of its range, a path about its chord: whichever is shorter.
        let sums = EXPECTED.map(|expected| {
            let mut sums = Vec::new();
            put(&mut sums, there().map(|b| unsigned(b.sum.wrapping_sub(expected(b)))));
            sums
        });
        let best = usize::from(sums[1].len() < sums[0].len());
        out.push(best as u8);
        out.extend_from_slice(&sums[best]);
        out
    }

    fn decode(mut bytes: &[u8], times: &Times) -> Option<Readings> {
        let bytes = &mut bytes;
        let missing = take(bytes, times.len())?;
        let rows = |k: usize| times.row[k + 1] - times.row[k];
        let there = (0..times.len()).filter(|&k| missing[k] < rows(k)).count();
        let [since, length, below, above] = [
            take(bytes, there)?,
            take(bytes, there)?,
            take(bytes, there)?,
            take(bytes, there)?,
        ];
        let (&best, rest) = bytes.split_first()?;
        *bytes = rest;
        let expected_sum = EXPECTED.get(usize::from(best))?;
        let sum = take(bytes, there)?;
        let mut buckets = Vec::with_capacity(times.len());
        let (mut at, mut n) = (0i64, 0);
        for (k, &missing) in missing.iter().enumerate() {
            let count = rows(k).checked_sub(missing)?;
            let mut bucket = Summary {
                missing,
                ..Summary::default()
            };
            if count > 0 {
                let raw = |number: i64| i32::try_from(number).ok();
                let first = at.checked_add(signed(since[n]))?;
                at = first.checked_add(signed(length[n]))?;
                bucket = Summary {
                    count,
                    missing,
                    first: raw(first)?,
                    last: raw(at)?,
                    min: raw(first.min(at).checked_sub_unsigned(below[n])?)?,
                    max: raw(first.max(at).checked_add_unsigned(above[n])?)?,
                    sum: 0,
                };
                bucket.sum = expected_sum(&bucket).wrapping_add(signed(sum[n]));
                n += 1;
            }
            buckets.push(bucket);
        }
        bytes.is_empty().then_some(Readings { buckets })
    }
}

/// Each number as what it differs by from the one before, small where it is small.
fn changes(numbers: impl Iterator<Item = i64>) -> impl Iterator<Item = u64> {
    let mut before = 0i64;
    numbers.map(move |number| unsigned(number.wrapping_sub(std::mem::replace(&mut before, number))))
}

/// The way back.
fn values(changes: Vec<u64>) -> Vec<i64> {
    let mut at = 0i64;
    let add = |change: u64| {
        at = at.wrapping_add(signed(change));
        at
    };
    changes.into_iter().map(add).collect()
}

/// What the sum of a bucket may be expected to be; what it differs by is what is kept.
const EXPECTED: [fn(&Summary) -> i64; 2] = [|b| middle(b.min, b.max, b.count), |b| middle(b.first, b.last, b.count)];

fn middle(a: i32, b: i32, count: u64) -> i64 {
    ((i128::from(a) + i128::from(b)) * i128::from(count) / 2) as i64
}

/// The start of a roll-up file.
pub(super) fn head() -> [u8; 8] {
    let mut head = [0; 8];
    head[..4].copy_from_slice(MARK);
    head[4..].copy_from_slice(&VERSION.to_le_bytes());
    head
}

/// A payload with its length and check.
pub(super) fn frame(payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(HEAD + payload.len());
    frame.extend((payload.len() as u32).to_le_bytes());
    frame.extend(crc32c::crc32c(payload).to_le_bytes());
    frame.extend(payload);
    frame
}

/// The end of a roll-up file whose directory stands at `at`.
pub(super) fn end(at: u64) -> [u8; END] {
    let mut end = [0; END];
    end[..8].copy_from_slice(&at.to_le_bytes());
    end[8..12].copy_from_slice(&crc32c::crc32c(&at.to_le_bytes()).to_le_bytes());
    end[12..].copy_from_slice(MARK);
    end
}

/// An open roll-up.
#[derive(Debug)]
pub struct Rollup {
    path: PathBuf,
    bytes: Bytes,
    pub(super) directory: Directory,
}

#[derive(Debug)]
enum Bytes {
    File(Mutex<File>),
    Memory(Vec<u8>),
}

impl Rollup {
    /// Opens a roll-up file.
    ///
    /// # Errors
    /// It cannot be opened, or it is cut or changed.
    pub fn open(path: &Path) -> Result<Rollup, StoreError> {
        let file = File::open(path).map_err(StoreError::io("open", path))?;
        let length = file.metadata().map_err(StoreError::io("read", path))?.len();
        Self::of(path, Bytes::File(Mutex::new(file)), length)
    }

    /// A roll-up that was made in memory, of rows that have no file yet; `path` names them in messages.
    pub(crate) fn in_memory(path: &Path, bytes: Vec<u8>) -> Result<Rollup, StoreError> {
        let length = bytes.len() as u64;
        Self::of(path, Bytes::Memory(bytes), length)
    }

    fn of(path: &Path, bytes: Bytes, length: u64) -> Result<Rollup, StoreError> {
        let mut rollup = Rollup {
            path: path.to_owned(),
            bytes,
            directory: Directory::nothing(),
        };
        let cut = || rollup.damaged("it is cut, or no roll-up");
        let end_at = length.checked_sub(END as u64).ok_or_else(cut)?;
        if rollup.read(0, 8)? != head() {
            return Err(rollup.damaged("it does not begin as a roll-up of this version"));
        }
        let last = rollup.read(end_at, END)?;
        let at = u64::from_le_bytes(last[..8].try_into().expect("8 bytes"));
        if last != end(at) {
            return Err(cut());
        }
        let payload = end_at
            .checked_sub(at)
            .and_then(|n| n.checked_sub(HEAD as u64))
            .ok_or_else(cut)?;
        let text = rollup.frame(at, usize::try_from(payload).map_err(|_| cut())?)?;
        rollup.directory = serde_json::from_slice(&text).map_err(|e| rollup.damaged(format!("its directory: {e}")))?;
        let whole = |blocks: &Vec<BlockText>| {
            let full =
                |(k, b): (usize, &BlockText)| b.buckets == BLOCK || (k + 1 == blocks.len() && (1..BLOCK).contains(&b.buckets));
            !blocks.is_empty() && blocks.iter().enumerate().all(full)
        };
        if !rollup.directory.levels.iter().all(whole) {
            return Err(rollup.damaged("its directory makes no sense"));
        }
        Ok(rollup)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// The hash of the record file it sums up; `None` for rows that have no file yet.
    pub fn record(&self) -> Option<Hash> {
        Hash::parse(&self.directory.record)
    }
    /// The number of rows it sums up.
    pub fn rows(&self) -> u64 {
        self.directory.rows
    }
    /// Two rows further apart than this have missing time between them, microseconds.
    pub fn gap_us(&self) -> i64 {
        self.directory.gap_us
    }
    /// Time of its first and last row, microseconds UTC; `None` without rows.
    pub fn span_us(&self) -> Option<(i64, i64)> {
        let finest = self.directory.levels.first()?;
        Some((finest.first()?.first_us, finest.last()?.last_us))
    }
    /// The columns of readings.
    pub fn columns(&self) -> Vec<Column> {
        (0..self.directory.channels.len()).map(|k| self.column(k)).collect()
    }
    pub(crate) fn column(&self, channel: usize) -> Column {
        let text = &self.directory.channels[channel];
        Column {
            name: text.name.clone(),
            unit: text.unit.clone(),
            scale: text.scale,
            offset: text.offset,
        }
    }
    pub(crate) fn channel(&self, name: &str) -> Option<usize> {
        self.directory.channels.iter().position(|c| c.name == name)
    }
    pub(crate) fn stretches(&self) -> &[Stretch] {
        &self.directory.stretches
    }

    /// Reads all of it and holds every frame against its check.
    ///
    /// # Errors
    /// The first damage.
    pub fn check(&self) -> Result<(), StoreError> {
        for (level, blocks) in self.directory.levels.iter().enumerate() {
            for block in 0..blocks.len() {
                let times = self.times(level, block)?;
                for channel in 0..self.directory.channels.len() {
                    self.readings(level, block, channel, &times)?;
                }
            }
        }
        Ok(())
    }

    /// The blocks of the finest level that touch a span.
    pub(crate) fn blocks_between(&self, from_us: i64, to_us: i64) -> impl Iterator<Item = usize> + use<> {
        let blocks = self.directory.levels.first().map_or(&[][..], Vec::as_slice);
        let touches = |b: &BlockText| b.last_us >= from_us && b.first_us < to_us;
        let inside: Vec<usize> = (0..blocks.len()).filter(|&k| touches(&blocks[k])).collect();
        inside.into_iter()
    }

    pub(crate) fn times(&self, level: usize, block: usize) -> Result<Times, StoreError> {
        let text = &self.directory.levels[level][block];
        let payload = self.part(text, 0)?;
        Times::decode(&payload, text).ok_or_else(|| self.damaged("the times of its buckets make no sense"))
    }

    pub(crate) fn readings(&self, level: usize, block: usize, channel: usize, times: &Times) -> Result<Readings, StoreError> {
        let payload = self.part(&self.directory.levels[level][block], channel + 1)?;
        Readings::decode(&payload, times).ok_or_else(|| self.damaged("the readings of its buckets make no sense"))
    }

    /// The payload of the `n`-th frame of a block.
    fn part(&self, block: &BlockText, n: usize) -> Result<Vec<u8>, StoreError> {
        let length = *block
            .lengths
            .get(n)
            .ok_or_else(|| self.damaged("its directory lacks a frame"))?;
        let before: u64 = block.lengths[..n].iter().map(|&l| u64::from(l) + HEAD as u64).sum();
        self.frame(block.at.saturating_add(before), length as usize)
    }

    fn frame(&self, at: u64, length: usize) -> Result<Vec<u8>, StoreError> {
        let mut bytes = self.read(at, HEAD + length)?;
        let payload = bytes.split_off(HEAD);
        let (said, check) = bytes.split_at(4);
        if said != (payload.len() as u32).to_le_bytes() || check != crc32c::crc32c(&payload).to_le_bytes() {
            return Err(self.damaged(format!("the frame at byte {at} is not what was written")));
        }
        Ok(payload)
    }

    fn read(&self, at: u64, length: usize) -> Result<Vec<u8>, StoreError> {
        match &self.bytes {
            Bytes::File(file) => {
                let mut bytes = vec![0; length];
                let mut file = file.lock().expect("no reader panics while it holds the file");
                let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes));
                match read {
                    Ok(()) => Ok(bytes),
                    Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Err(self.damaged("it is cut")),
                    Err(e) => Err(StoreError::io("read", &self.path)(e)),
                }
            }
            Bytes::Memory(all) => usize::try_from(at)
                .ok()
                .and_then(|at| all.get(at..at.checked_add(length)?))
                .map(<[u8]>::to_vec)
                .ok_or_else(|| self.damaged("it is cut")),
        }
    }

    pub(crate) fn damaged(&self, what: impl Into<String>) -> StoreError {
        StoreError::DamagedRollup {
            path: self.path.clone(),
            what: what.into(),
        }
    }
}

impl Directory {
    fn nothing() -> Directory {
        Directory {
            record: String::new(),
            machine: String::new(),
            simulated: false,
            rows: 0,
            gap_us: 0,
            channels: Vec::new(),
            stretches: Vec::new(),
            levels: Vec::new(),
        }
    }
}

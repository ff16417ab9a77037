//! Makes a roll-up: rows in, buckets out, in one pass and constant memory.

use super::file::{BLOCK, BlockText, ChannelText, Directory, Readings, Stretch, Summary, Times, end, frame, head};
use super::{BUCKET, FAN, Rollup};
use crate::record::{Column, Reader, columns_of, schema};
use crate::whole_file::WholeFile;
use crate::{StoreError, segment};
use arrow_array::cast::AsArray;
use arrow_array::types::{Int32Type, TimestampMicrosecondType};
use arrow_array::{Array, Int32Array, RecordBatch};
use ledger::Hash;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A roll-up that is whole and on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Built {
    /// Where.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// The hash of the file.
    pub hash: Hash,
    /// Rows of the record it sums up.
    pub rows: u64,
}

/// Rows that tell how far apart rows usually are.
const FIRST_ROWS: usize = 8192;
/// A level with no more buckets than this gets no coarser one above it.
const FEW: usize = 4 * FAN;

/// Makes the roll-up of a record file at `to`; what stood there is replaced when the new one is whole. `record_hash` is the hash of the
/// record file, as the catalogue has it. The same record gives the same bytes.
///
/// # Errors
/// The record cannot be read, or the disk refuses; `to` is as it was then.
pub fn build(record: &Path, record_hash: Hash, to: &Path) -> Result<Built, StoreError> {
    let reader = Reader::open(record)?;
    let header = reader.header();
    let about = About {
        record: record_hash.to_string(),
        machine: header.machine.clone(),
        simulated: header.simulated,
    };
    let failed = |e| StoreError::io("write", to)(e);
    let mut builder = Builder::new(WholeFile::create(to)?, about, reader.columns()).map_err(failed)?;
    for batch in reader.batches()? {
        builder.push(batch?.arrow()).map_err(failed)?;
    }
    let rows = builder.rows;
    let (bytes, hash) = builder.finish().map_err(failed)?.finish()?;
    Ok(Built {
        path: to.to_owned(),
        bytes,
        hash,
        rows,
    })
}

/// The roll-up of a segment, in memory: what is still written to has no file of its own yet.
pub(crate) fn of_segment(segment: &Path) -> Result<Rollup, StoreError> {
    let found = segment::read(segment)?;
    let columns = columns_of(&found.schema).map_err(|what| StoreError::NotARecord {
        path: segment.to_owned(),
        what,
    })?;
    let in_memory = "memory takes what it is given";
    let mut builder = Builder::new(Vec::new(), About::default(), &columns).expect(in_memory);
    for batch in found.batches()? {
        builder.push(&batch?).expect(in_memory);
    }
    Rollup::in_memory(segment, builder.finish().expect(in_memory))
}

/// Whose rows they are.
#[derive(Clone, Debug, Default)]
pub(crate) struct About {
    /// SHA-256 of the record file; empty for rows that have none yet.
    pub record: String,
    /// The machine's name.
    pub machine: String,
    /// True when a simulator made the rows.
    pub simulated: bool,
}

/// A roll-up in the making.
pub(crate) struct Builder<W> {
    out: W,
    at: u64,
    directory: Directory,
    /// Rows that wait until it is known how far apart rows usually are.
    waiting: Vec<Rows>,
    waiting_rows: usize,
    gap_known: bool,
    open: Bucket,
    levels: Vec<Level>,
    rows: u64,
}

/// Some rows: when, in which workingstep, and the raw readings of every channel.
struct Rows {
    at_us: Vec<i64>,
    workingstep: Int32Array,
    channels: Vec<Int32Array>,
}

/// A bucket in the making, of rows or of finer buckets.
#[derive(Default)]
struct Bucket {
    /// Rows, or finer buckets, that are in it.
    parts: usize,
    rows: u64,
    first_us: i64,
    last_us: i64,
    gaps: u32,
    /// The distance between its rows, as the first two have it.
    step_us: Option<i64>,
    even: bool,
    channels: Vec<Summary>,
}

/// The buckets of a level that are not on disk yet.
struct Level {
    times: Times,
    channels: Vec<Readings>,
    /// Buckets that there are, on disk or not.
    total: usize,
    blocks: Vec<BlockText>,
    /// The bucket of the next coarser level that takes in these.
    parent: Bucket,
}

impl<W: Write> Builder<W> {
    pub(crate) fn new(mut out: W, about: About, columns: &[Column]) -> io::Result<Builder<W>> {
        out.write_all(&head())?;
        let channel = |c: &Column| ChannelText {
            name: c.name.clone(),
            unit: c.unit.clone(),
            scale: c.scale,
            offset: c.offset,
        };
        Ok(Builder {
            out,
            at: head().len() as u64,
            directory: Directory {
                record: about.record,
                machine: about.machine,
                simulated: about.simulated,
                rows: 0,
                gap_us: 0,
                channels: columns.iter().map(channel).collect(),
                stretches: Vec::new(),
                levels: Vec::new(),
            },
            waiting: Vec::new(),
            waiting_rows: 0,
            gap_known: false,
            open: Bucket::default(),
            levels: Vec::new(),
            rows: 0,
        })
    }

    /// Takes in rows of a record, in order. They have its columns.
    pub(crate) fn push(&mut self, batch: &RecordBatch) -> io::Result<()> {
        let column = |name: &str| batch.column_by_name(name).expect("a record has this column");
        let rows = Rows {
            at_us: column(schema::TS)
                .as_primitive::<TimestampMicrosecondType>()
                .values()
                .to_vec(),
            workingstep: column(schema::WORKINGSTEP).as_primitive::<Int32Type>().clone(),
            channels: self
                .directory
                .channels
                .iter()
                .map(|c| column(&c.name).as_primitive::<Int32Type>().clone())
                .collect(),
        };
        if self.gap_known {
            return self.take(&rows);
        }
        self.waiting_rows += rows.at_us.len();
        self.waiting.push(rows);
        if self.waiting_rows > FIRST_ROWS {
            self.take_waiting()
        } else {
            Ok(())
        }
    }

    /// Ends the roll-up and gives back what it was written to.
    pub(crate) fn finish(mut self) -> io::Result<W> {
        self.take_waiting()?;
        self.close()?;
        let mut level = 0;
        while level < self.levels.len() {
            let parent = std::mem::take(&mut self.levels[level].parent);
            let coarser = self.levels[level].total > FEW;
            if coarser && parent.parts > 0 {
                self.push_bucket(level + 1, parent)?;
            }
            self.write_block(level)?;
            let blocks = std::mem::take(&mut self.levels[level].blocks);
            self.directory.levels.push(blocks);
            if !coarser {
                break;
            }
            level += 1;
        }
        self.directory.rows = self.rows;
        let text = serde_json::to_vec(&self.directory).expect("a directory of numbers and texts is always JSON");
        let at = self.at;
        self.put(&text)?;
        self.out.write_all(&end(at))?;
        Ok(self.out)
    }

    fn take_waiting(&mut self) -> io::Result<()> {
        if !self.gap_known {
            self.directory.gap_us = gap_of(self.waiting.iter().flat_map(|r| &r.at_us).copied());
            self.gap_known = true;
        }
        for rows in std::mem::take(&mut self.waiting) {
            self.take(&rows)?;
        }
        Ok(())
    }

    fn take(&mut self, rows: &Rows) -> io::Result<()> {
        let (mut from, count) = (0, rows.at_us.len());
        while from < count {
            let workingstep = rows.workingstep.value(from);
            if !self.belongs(rows.at_us[from], workingstep) {
                self.close()?;
            }
            if self.open.parts == 0 {
                self.begin(rows.at_us[from], workingstep);
            }
            let mut to = from;
            while to < count && self.open.parts < BUCKET && self.belongs(rows.at_us[to], rows.workingstep.value(to)) {
                self.note(rows.at_us[to]);
                to += 1;
            }
            for (summary, readings) in self.open.channels.iter_mut().zip(&rows.channels) {
                summary.add(&summary_of(readings, from, to));
            }
            from = to;
            if self.open.parts == BUCKET {
                self.close()?;
            }
        }
        Ok(())
    }

    /// True when a row goes into the bucket that is open: no time is missing before it, and the workingstep is the same. So gaps and
    /// workingsteps stay visible when the rows themselves are gone.
    fn belongs(&self, at: i64, workingstep: i32) -> bool {
        let same_workingstep = self.directory.stretches.last().is_some_and(|s| s.workingstep == workingstep);
        self.open.parts == 0 || (same_workingstep && at.saturating_sub(self.open.last_us) <= self.directory.gap_us)
    }

    fn begin(&mut self, at: i64, workingstep: i32) {
        self.open = Bucket {
            first_us: at,
            last_us: at,
            even: true,
            channels: vec![Summary::default(); self.directory.channels.len()],
            ..Bucket::default()
        };
        let stretches = &mut self.directory.stretches;
        if stretches.last().is_none_or(|s| s.workingstep != workingstep) {
            stretches.push(Stretch {
                workingstep,
                first_row: self.rows,
                rows: 0,
                first_us: at,
                last_us: at,
            });
        }
    }

    /// Counts a row into the open bucket.
    fn note(&mut self, at: i64) {
        let open = &mut self.open;
        if open.parts > 0 {
            let since = at - open.last_us;
            open.even &= *open.step_us.get_or_insert(since) == since;
        }
        open.last_us = at;
        open.parts += 1;
        open.rows += 1;
        self.rows += 1;
        let stretch = self.directory.stretches.last_mut().expect("begun with the bucket");
        stretch.rows += 1;
        stretch.last_us = at;
    }

    /// Ends the open bucket.
    fn close(&mut self) -> io::Result<()> {
        let open = std::mem::take(&mut self.open);
        if open.parts > 0 { self.push_bucket(0, open) } else { Ok(()) }
    }

    fn push_bucket(&mut self, n: usize, bucket: Bucket) -> io::Result<()> {
        if self.levels.len() == n {
            self.levels.push(Level::new(self.directory.channels.len()));
        }
        let gap_us = self.directory.gap_us;
        let level = &mut self.levels[n];
        level.push(&bucket);
        level.parent.add(bucket, gap_us);
        let parent = (level.parent.parts == FAN).then(|| std::mem::take(&mut level.parent));
        if level.times.len() == BLOCK {
            self.write_block(n)?;
        }
        parent.map_or(Ok(()), |parent| self.push_bucket(n + 1, parent))
    }

    /// Writes the buckets of a level that wait.
    fn write_block(&mut self, n: usize) -> io::Result<()> {
        let Some(level) = self.levels.get_mut(n).filter(|l| l.times.len() > 0) else {
            return Ok(());
        };
        let end_row = *level.times.row.last().expect("one more than buckets");
        let times = std::mem::replace(&mut level.times, Times::starting_at(end_row));
        let readings: Vec<Vec<u8>> = level.channels.iter_mut().map(|c| std::mem::take(c).encode()).collect();
        let mut block = BlockText {
            buckets: times.len(),
            first_row: times.row[0],
            first_us: times.first_us[0],
            last_us: times.last_us[times.len() - 1],
            at: self.at,
            lengths: Vec::with_capacity(readings.len() + 1),
        };
        for payload in std::iter::once(times.encode()).chain(readings) {
            block.lengths.push(payload.len() as u32);
            self.put(&payload)?;
        }
        self.levels[n].blocks.push(block);
        Ok(())
    }

    fn put(&mut self, payload: &[u8]) -> io::Result<()> {
        let frame = frame(payload);
        self.at += frame.len() as u64;
        self.out.write_all(&frame)
    }
}

impl Bucket {
    /// Takes in a finer bucket.
    fn add(&mut self, finer: Bucket, gap_us: i64) {
        self.parts += 1;
        if self.parts == 1 {
            *self = Bucket {
                parts: 1,
                // Only the finest level is read row by row.
                even: false,
                ..finer
            };
            return;
        }
        let gap = finer.first_us.saturating_sub(self.last_us) > gap_us;
        self.gaps += finer.gaps + u32::from(gap);
        self.rows += finer.rows;
        self.last_us = finer.last_us;
        for (summary, finer) in self.channels.iter_mut().zip(&finer.channels) {
            summary.add(finer);
        }
    }
}

impl Level {
    fn new(channels: usize) -> Level {
        Level {
            times: Times::starting_at(0),
            channels: vec![Readings::default(); channels],
            total: 0,
            blocks: Vec::new(),
            parent: Bucket::default(),
        }
    }

    fn push(&mut self, bucket: &Bucket) {
        let times = &mut self.times;
        let row = times.row.last().expect("one more than buckets") + bucket.rows;
        times.row.push(row);
        times.first_us.push(bucket.first_us);
        times.last_us.push(bucket.last_us);
        times.gaps.push(bucket.gaps);
        times.even.push(bucket.even);
        for (readings, summary) in self.channels.iter_mut().zip(&bucket.channels) {
            readings.buckets.push(*summary);
        }
        self.total += 1;
    }
}

/// What rows `from..to` of a channel come to.
pub(super) fn summary_of(readings: &Int32Array, from: usize, to: usize) -> Summary {
    let raw = &readings.values()[from..to];
    let mut summary = Summary::default();
    if readings.null_count() > 0 {
        (from..to).for_each(|k| summary.add_reading(readings.is_valid(k).then(|| readings.value(k))));
    } else if let (Some(&first), Some(&last)) = (raw.first(), raw.last()) {
        // Each in a loop of its own: these the compiler turns into vector instructions.
        summary = Summary {
            count: raw.len() as u64,
            missing: 0,
            min: raw.iter().copied().fold(first, i32::min),
            max: raw.iter().copied().fold(first, i32::max),
            first,
            last,
            sum: raw.iter().map(|&r| i64::from(r)).sum(),
        };
    }
    summary
}

/// From which distance on time is missing between two rows: half more than the distance that all but one in twenty of a record's first
/// rows keep. A record at 1 kHz shows a single lost row; one that an agent gave with jitter is not torn into pieces.
fn gap_of(times_us: impl Iterator<Item = i64>) -> i64 {
    let mut before = None;
    let mut distances: Vec<i64> = times_us.filter_map(|at| Some(at - before.replace(at)?)).collect();
    if distances.is_empty() {
        return 0;
    }
    let nearly_all = (distances.len() - 1) * 19 / 20;
    let (_, usual, _) = distances.select_nth_unstable(nearly_all);
    *usual + *usual / 2
}

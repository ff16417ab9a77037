//! Goes through a roll-up in the order of time, as coarsely as may be and as finely as must be.

use super::FAN;
use super::file::{BLOCK, Readings, Rollup, Summary, Times};
use crate::StoreError;

/// A bucket as it is met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bucket {
    /// Time of its first row, microseconds UTC.
    pub first_us: i64,
    /// Time of its last row.
    pub last_us: i64,
    /// Place of its first row in the record.
    pub row: u64,
    /// How many rows.
    pub rows: u64,
    /// How often time is missing between two of its rows.
    pub gaps: u32,
    /// True when its rows are all equally far apart.
    pub even: bool,
    /// What its readings come to.
    pub summary: Summary,
    /// 0 for the finest.
    pub level: usize,
}

/// What to do with a bucket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// It was taken, or is of no interest.
    Done,
    /// Look at the finer buckets that it is made of. The finest are made of none.
    Finer,
}

/// Shows the buckets of one channel to `look`, from the coarsest level on, those of `from_us..to_us` only.
///
/// # Errors
/// The roll-up is damaged or not readable, or `look` fails.
pub(crate) fn walk(
    rollup: &Rollup,
    channel: usize,
    from_us: i64,
    to_us: i64,
    look: &mut dyn FnMut(Bucket) -> Result<Next, StoreError>,
) -> Result<(), StoreError> {
    let levels = &rollup.directory.levels;
    let Some(coarsest) = levels.len().checked_sub(1) else {
        return Ok(());
    };
    let mut walk = Walk {
        rollup,
        channel,
        from_us,
        to_us,
        blocks: levels.iter().map(|_| None).collect(),
        look,
    };
    walk.visit(coarsest, 0, usize::MAX)
}

struct Walk<'a> {
    rollup: &'a Rollup,
    channel: usize,
    from_us: i64,
    to_us: i64,
    /// The block of each level that was read last.
    blocks: Vec<Option<(usize, Times, Readings)>>,
    look: &'a mut dyn FnMut(Bucket) -> Result<Next, StoreError>,
}

impl Walk<'_> {
    fn visit(&mut self, level: usize, from: usize, to: usize) -> Result<(), StoreError> {
        let total: usize = self.rollup.directory.levels[level].iter().map(|b| b.buckets).sum();
        let mut n = from;
        while n < to.min(total) {
            let block = n / BLOCK;
            let text = &self.rollup.directory.levels[level][block];
            if text.last_us < self.from_us {
                n = (block + 1) * BLOCK;
                continue;
            }
            if text.first_us >= self.to_us {
                return Ok(());
            }
            let bucket = self.bucket(level, block, n % BLOCK)?;
            if bucket.first_us >= self.to_us {
                return Ok(());
            }
            if bucket.last_us >= self.from_us && (self.look)(bucket)? == Next::Finer && level > 0 {
                self.visit(level - 1, n * FAN, (n + 1) * FAN)?;
            }
            n += 1;
        }
        Ok(())
    }

    fn bucket(&mut self, level: usize, block: usize, k: usize) -> Result<Bucket, StoreError> {
        if !matches!(&self.blocks[level], Some((n, ..)) if *n == block) {
            let times = self.rollup.times(level, block)?;
            let readings = self.rollup.readings(level, block, self.channel, &times)?;
            self.blocks[level] = Some((block, times, readings));
        }
        let (_, times, readings) = self.blocks[level].as_ref().expect("read above");
        Ok(Bucket {
            first_us: times.first_us[k],
            last_us: times.last_us[k],
            row: times.row[k],
            rows: times.row[k + 1] - times.row[k],
            gaps: times.gaps[k],
            even: times.even[k],
            summary: readings.buckets[k],
            level,
        })
    }
}

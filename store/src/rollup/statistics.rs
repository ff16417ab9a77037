//! What the workingsteps of a job came to: from the roll-ups alone, because their buckets end where a workingstep ends.

use super::envelope::known_channel;
use super::file::Summary;
use super::walk::{Next, walk};
use crate::{DataDirectory, JobId, Of, Span, StoreError};
use std::collections::BTreeMap;
use units::{Timestamp, WorkingstepId};

/// A workingstep as it was executed.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkingstepStatistics {
    /// Which one.
    pub workingstep: WorkingstepId,
    /// Time of its first row.
    pub first: Timestamp,
    /// Time of its last row. When it was left and taken up again, what was done in between lies inside.
    pub last: Timestamp,
    /// Its rows.
    pub rows: u64,
    /// The channels that were asked for, in that order.
    pub channels: Vec<ChannelStatistics>,
}

/// A channel in a workingstep, in the unit of the channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelStatistics {
    /// Which channel.
    pub channel: String,
    /// Its unit, in MTConnect's words.
    pub unit: String,
    /// Readings that are there.
    pub count: u64,
    /// Rows whose reading is unavailable.
    pub missing: u64,
    /// The least reading; `None` without readings.
    pub min: Option<f64>,
    /// The greatest.
    pub max: Option<f64>,
    /// The mean of all readings.
    pub mean: Option<f64>,
}

/// A workingstep in the making.
struct Sums {
    first_us: i64,
    last_us: i64,
    rows: u64,
    channels: Vec<Sum>,
}

#[derive(Clone, Default)]
struct Sum {
    count: u64,
    missing: u64,
    min: Option<f64>,
    max: Option<f64>,
    sum: f64,
}

impl DataDirectory {
    /// Count, least, greatest and mean of channels in each workingstep of a job, in the order of their numbers. Workingstep 0 is what
    /// belongs to none.
    ///
    /// # Errors
    /// No record of the job has such a channel, a file is damaged, or the disk refuses.
    pub fn workingstep_statistics(&self, job: JobId, channels: &[&str]) -> Result<Vec<WorkingstepStatistics>, StoreError> {
        self.job(job)?;
        self.with_sources(Of::Job(job), Span::ALL.micros(), |sources| {
            let units: Vec<String> = channels.iter().map(|c| known_channel(sources, c)).collect::<Result<_, _>>()?;
            let mut all: BTreeMap<i32, Sums> = BTreeMap::new();
            for source in sources {
                let rollup = &source.rollup;
                for stretch in rollup.stretches() {
                    let sums = all.entry(stretch.workingstep).or_insert_with(|| Sums {
                        first_us: stretch.first_us,
                        last_us: stretch.last_us,
                        rows: 0,
                        channels: vec![Sum::default(); channels.len()],
                    });
                    sums.first_us = sums.first_us.min(stretch.first_us);
                    sums.last_us = sums.last_us.max(stretch.last_us);
                    sums.rows += stretch.rows;
                }
                for (n, name) in channels.iter().enumerate() {
                    let Some(channel) = rollup.channel(name) else {
                        for stretch in rollup.stretches() {
                            all.get_mut(&stretch.workingstep).expect("made above").channels[n].missing += stretch.rows;
                        }
                        continue;
                    };
                    let column = rollup.column(channel);
                    let mut stretches = rollup.stretches().iter().peekable();
                    walk(rollup, channel, i64::MIN, i64::MAX, &mut |bucket| {
                        let end = bucket.row + bucket.rows;
                        while stretches.next_if(|s| s.first_row + s.rows <= bucket.row).is_some() {}
                        let Some(stretch) = stretches.peek() else {
                            return Err(rollup.damaged("it has buckets of no workingstep"));
                        };
                        if stretch.first_row + stretch.rows < end {
                            return match bucket.level {
                                0 => Err(rollup.damaged("a bucket belongs to two workingsteps")),
                                _ => Ok(Next::Finer),
                            };
                        }
                        let sums = all.get_mut(&stretch.workingstep).expect("made above");
                        sums.channels[n].add(&bucket.summary, &column);
                        Ok(Next::Done)
                    })?;
                }
            }
            let at = |us: i64| Timestamp(us.saturating_mul(1000));
            let told = |(workingstep, sums): (&i32, &Sums)| WorkingstepStatistics {
                workingstep: WorkingstepId(workingstep.unsigned_abs()),
                first: at(sums.first_us),
                last: at(sums.last_us),
                rows: sums.rows,
                channels: (channels.iter().zip(&units).zip(&sums.channels))
                    .map(|((channel, unit), sum)| sum.told(channel, unit))
                    .collect(),
            };
            Ok(all.iter().map(told).collect())
        })
    }
}

impl Sum {
    fn add(&mut self, raw: &Summary, column: &crate::record::Column) {
        self.missing += raw.missing;
        if raw.count == 0 {
            return;
        }
        self.count += raw.count;
        let (min, max) = column.ordered(raw.min, raw.max);
        self.min = Some(self.min.map_or(min, |m| m.min(min)));
        self.max = Some(self.max.map_or(max, |m| m.max(max)));
        self.sum += raw.sum as f64 * column.scale + raw.count as f64 * column.offset;
    }

    fn told(&self, channel: &str, unit: &str) -> ChannelStatistics {
        ChannelStatistics {
            channel: channel.to_owned(),
            unit: unit.to_owned(),
            count: self.count,
            missing: self.missing,
            min: self.min,
            max: self.max,
            mean: (self.count > 0).then(|| self.sum / self.count as f64),
        }
    }
}

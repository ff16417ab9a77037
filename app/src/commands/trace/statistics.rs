//! Numbers of a job's channels, whole and by workingstep, in one pass over its records.

use crate::failure::Failure;
use crate::shop;
use serde::Serialize;
use std::collections::BTreeMap;
use store::record::Reader;

/// How many points of a channel a line of text shows.
pub const WIDTH: usize = 48;

/// Numbers of a channel over some rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Numbers {
    /// Readings.
    pub count: u64,
    /// Rows whose reading was not available.
    pub unavailable: u64,
    /// Smallest reading.
    pub min: Option<f64>,
    /// Largest reading.
    pub max: Option<f64>,
    /// Mean.
    pub mean: Option<f64>,
    /// Root of the mean square.
    pub rms: Option<f64>,
    #[serde(skip)]
    sum: f64,
    #[serde(skip)]
    squares: f64,
}

impl Numbers {
    fn add(&mut self, reading: Option<f64>) {
        let Some(x) = reading else {
            self.unavailable += 1;
            return;
        };
        self.count += 1;
        self.min = Some(self.min.map_or(x, |m| m.min(x)));
        self.max = Some(self.max.map_or(x, |m| m.max(x)));
        self.sum += x;
        self.squares += x * x;
        let count = self.count as f64;
        self.mean = Some(self.sum / count);
        self.rms = Some((self.squares / count).sqrt());
    }
}

/// A channel of a job.
#[derive(Clone, Debug, Serialize)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Over the whole job.
    #[serde(flatten)]
    pub all: Numbers,
    /// By workingstep; 0 stands for rows outside of any.
    pub workingsteps: BTreeMap<u32, Numbers>,
    /// Means of equal pieces of the job's time; `None` where nothing was read.
    pub course: Vec<Option<f64>>,
}

/// A piece of time of which rows are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// The last row before, nanoseconds UTC.
    pub from_ns: i64,
    /// The first row after.
    pub to_ns: i64,
    /// Rows that are missing.
    pub rows: u64,
}

/// What the records of a job hold.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    /// Its channels, in the order of the record.
    pub channels: Vec<Channel>,
    /// First and last row of each workingstep, nanoseconds UTC, and how many there are.
    pub workingsteps: BTreeMap<u32, (i64, i64, u64)>,
    /// Where rows are missing.
    pub missing: Vec<Missing>,
}

/// Reads all records of a job.
///
/// # Errors
/// A record is damaged.
pub fn of(readers: &[Reader], span_us: (i64, i64)) -> Result<Statistics, Failure> {
    let mut done = Statistics::default();
    let mut sums: Vec<[(f64, u64); WIDTH]> = Vec::new();
    let mut last: Option<(u64, i64)> = None;
    let length = (span_us.1 - span_us.0).max(1) as i128;
    for reader in readers {
        for column in reader.columns() {
            if !done.channels.iter().any(|c| c.name == column.name) {
                done.channels.push(Channel {
                    name: column.name.clone(),
                    unit: column.unit.clone(),
                    all: Numbers::default(),
                    workingsteps: BTreeMap::new(),
                    course: Vec::new(),
                });
                sums.push([(0.0, 0); WIDTH]);
            }
        }
        for batch in reader.batches().map_err(shop::failure)? {
            let batch = batch.map_err(shop::failure)?;
            let rows = batch.rows();
            for row in &rows {
                if let Some((tick, at)) = last
                    && row.tick.0 > tick + 1
                {
                    done.missing.push(Missing {
                        from_ns: at,
                        to_ns: row.at.0,
                        rows: row.tick.0 - tick - 1,
                    });
                }
                last = Some((row.tick.0, row.at.0));
                let seen = done.workingsteps.entry(row.workingstep.0).or_insert((row.at.0, row.at.0, 0));
                (seen.1, seen.2) = (row.at.0, seen.2 + 1);
            }
            for (channel, sums) in done.channels.iter_mut().zip(&mut sums) {
                let Some(values) = batch.values(&channel.name) else {
                    continue;
                };
                for (row, value) in rows.iter().zip(values) {
                    channel.all.add(value);
                    channel.workingsteps.entry(row.workingstep.0).or_default().add(value);
                    let place = i128::from(row.at.micros() - span_us.0) * WIDTH as i128 / (length + 1);
                    if let (Some(x), Ok(place)) = (value, usize::try_from(place)) {
                        let piece = &mut sums[place.min(WIDTH - 1)];
                        *piece = (piece.0 + x, piece.1 + 1);
                    }
                }
            }
        }
    }
    for (channel, sums) in done.channels.iter_mut().zip(sums) {
        channel.course = sums.iter().map(|(sum, n)| (*n > 0).then(|| sum / *n as f64)).collect();
    }
    Ok(done)
}

/// A course as one line of text, from the lowest mark to the highest; a blank where nothing was read.
pub fn line(course: &[Option<f64>]) -> String {
    const MARKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let known = || course.iter().flatten();
    let low = known().copied().fold(f64::INFINITY, f64::min);
    let high = known().copied().fold(f64::NEG_INFINITY, f64::max);
    let mark = |x: f64| {
        let share = if high > low { (x - low) / (high - low) } else { 0.0 };
        MARKS[((share * 8.0) as usize).min(7)]
    };
    course.iter().map(|x| x.map_or(' ', mark)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_some_readings() {
        let mut numbers = Numbers::default();
        [Some(3.0), None, Some(-4.0)].into_iter().for_each(|x| numbers.add(x));
        assert_eq!((numbers.count, numbers.unavailable), (2, 1));
        assert_eq!((numbers.min, numbers.max, numbers.mean), (Some(-4.0), Some(3.0), Some(-0.5)));
        assert_eq!(numbers.rms, Some(12.5f64.sqrt()));
    }

    #[test]
    fn a_course_is_drawn_between_its_own_ends() {
        assert_eq!(line(&[Some(0.0), None, Some(0.5), Some(1.0)]), "▁ ▅█");
        assert_eq!(line(&[Some(7.0), Some(7.0)]), "▁▁");
        assert_eq!(line(&[None]), " ");
    }
}

//! How late servo cycles began: a histogram of fixed size that the realtime thread writes and any other reads.

use serde::Serialize;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Each octave of lateness has this many buckets, as a power of two: a figure is right within 3 %.
const PARTS: u32 = 5;
/// Lateness of 2^37 ns, two minutes, and more is in the last bucket.
const OCTAVES: u32 = 37;
const BUCKETS: usize = ((OCTAVES - PARTS + 1) << PARTS) as usize;
/// One servo cycle.
const PERIOD: Duration = Duration::from_millis(1);

/// How punctual a realtime thread was.
#[derive(Default)]
pub struct Punctuality {
    /// How late cycles began.
    pub cycles: Lateness,
    /// How late the system woke the thread for them, which it asks for a little before their time.
    pub wake_ups: Lateness,
}

/// Lateness of every cycle so far. Writing is two additions to memory that is there; nothing is allocated and nobody waits.
pub struct Lateness {
    buckets: [AtomicU64; BUCKETS],
    worst: AtomicU64,
    missed: AtomicU64,
}

impl Default for Lateness {
    fn default() -> Self {
        Lateness {
            buckets: [const { AtomicU64::new(0) }; BUCKETS],
            worst: AtomicU64::new(0),
            missed: AtomicU64::new(0),
        }
    }
}

impl Lateness {
    /// A cycle began this long after its time.
    pub fn add(&self, late: Duration) {
        let nanoseconds = u64::try_from(late.as_nanos()).unwrap_or(u64::MAX);
        self.buckets[bucket(nanoseconds)].fetch_add(1, Relaxed);
        self.worst.fetch_max(nanoseconds, Relaxed);
        if late >= PERIOD {
            self.missed.fetch_add(1, Relaxed);
        }
    }

    /// What it comes to now.
    pub fn summary(&self) -> Summary {
        let counts: Vec<u64> = self.buckets.iter().map(|count| count.load(Relaxed)).collect();
        let cycles = counts.iter().sum();
        let worst = self.worst.load(Relaxed);
        let share = |part: f64| {
            let (mut seen, wanted) = (0, (cycles as f64 * part).ceil() as u64);
            let found = counts.iter().position(|count| {
                seen += count;
                seen >= wanted.max(1)
            });
            found.map_or(0, |index| upper_edge(index).min(worst)) as f64 / 1000.0
        };
        Summary {
            cycles,
            p50_us: share(0.5),
            p99_us: share(0.99),
            p999_us: share(0.999),
            max_us: worst as f64 / 1000.0,
            missed: self.missed.load(Relaxed),
            histogram: bars(&counts),
        }
    }
}

/// Lateness in figures, microseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Cycles that were run.
    pub cycles: u64,
    /// Half of them began no later than this.
    pub p50_us: f64,
    /// 99 % of them.
    pub p99_us: f64,
    /// 99.9 % of them.
    pub p999_us: f64,
    /// The latest.
    pub max_us: f64,
    /// Cycles that began a whole cycle late or more: late ticks, which the controller counts too.
    pub missed: u64,
    /// How many began below each power of two.
    pub histogram: Vec<Bar>,
}

/// One bar of the histogram.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bar {
    /// Cycles below this, and not below half of it, microseconds.
    pub below_us: u64,
    /// How many.
    pub cycles: u64,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} cycles, late by p50 {:.0} us, p99 {:.0} us, p99.9 {:.0} us, at most {:.0} us; {} a whole cycle or more",
            self.cycles, self.p50_us, self.p99_us, self.p999_us, self.max_us, self.missed
        )
    }
}

impl Summary {
    /// The histogram as lines for a person: one bar for each power of two that has cycles.
    pub fn bars(&self) -> Vec<String> {
        let most = self.histogram.iter().map(|bar| bar.cycles).max().unwrap_or(1).max(1);
        let line = |bar: &Bar| {
            // A logarithm: a few late cycles among a million are what is looked for.
            let length = ((bar.cycles as f64).ln_1p() / (most as f64).ln_1p() * 40.0).round() as usize;
            format!("  < {:>8} us {:>10} {}", bar.below_us, bar.cycles, "#".repeat(length))
        };
        self.histogram.iter().map(line).collect()
    }
}

fn bucket(nanoseconds: u64) -> usize {
    let octave = 63 - (nanoseconds | 1).leading_zeros();
    if octave < PARTS {
        return nanoseconds as usize;
    }
    let part = (nanoseconds >> (octave - PARTS)) & ((1 << PARTS) - 1);
    let index = ((u64::from(octave - PARTS + 1)) << PARTS) + part;
    (index as usize).min(BUCKETS - 1)
}

/// The first lateness that is above all of a bucket, ns.
fn upper_edge(index: usize) -> u64 {
    let next = index as u64 + 1;
    let octave = next >> PARTS;
    if octave == 0 {
        return next;
    }
    ((1 << PARTS) + (next & ((1 << PARTS) - 1))) << (octave - 1)
}

/// Counts below 1, 2, 4 ... us, without the empty ends.
fn bars(counts: &[u64]) -> Vec<Bar> {
    let mut bars: Vec<Bar> = Vec::new();
    for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        // A bucket that reaches over a whole microsecond belongs above it.
        let below_us = upper_edge(index).div_ceil(1000).next_power_of_two();
        match bars.last_mut() {
            Some(bar) if bar.below_us == below_us => bar.cycles += count,
            _ => bars.push(Bar { below_us, cycles: count }),
        }
    }
    bars
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lateness_is_in_a_bucket_that_holds_it_within_three_percent() {
        let mut before = 0;
        for nanoseconds in (0..200_000u64).chain((18..36).flat_map(|k| [(1 << k) - 1, 1 << k, (1 << k) + 12_345])) {
            let index = bucket(nanoseconds);
            let above = upper_edge(index);
            assert!(nanoseconds < above, "{nanoseconds} is not below {above}");
            assert!(
                (above - nanoseconds) as f64 <= 1.0 + nanoseconds as f64 * 0.032,
                "{nanoseconds} {above}"
            );
            if nanoseconds < 200_000 {
                assert!(index >= before, "{nanoseconds}");
                before = index;
            }
        }
        assert_eq!(bucket(u64::MAX), BUCKETS - 1);
    }

    #[test]
    fn the_summary_is_what_sorting_all_of_them_would_say() {
        let lateness = Lateness::default();
        assert_eq!((lateness.summary().cycles, lateness.summary().p99_us), (0, 0.0));
        for k in 1..=1000u64 {
            lateness.add(Duration::from_micros(if k == 1000 { 5000 } else { k % 20 + 1 }));
        }
        let summary = lateness.summary();
        assert_eq!((summary.cycles, summary.missed, summary.max_us), (1000, 1, 5000.0));
        for (found, true_value) in [(summary.p50_us, 11.0), (summary.p99_us, 20.0), (summary.p999_us, 20.0)] {
            assert!(found >= true_value && found <= true_value * 1.032, "{found} {true_value}");
        }
        assert_eq!(summary.histogram.iter().map(|bar| bar.cycles).sum::<u64>(), 1000);
        assert_eq!(summary.bars().len(), summary.histogram.len());
        println!("{summary}\n{}", summary.bars().join("\n"));
    }
}

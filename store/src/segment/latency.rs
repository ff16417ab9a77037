//! How long rows wait until they are acknowledged: a histogram of fixed size.
//!
//! Buckets grow with the value, sixteen to each doubling: a time is known to 6 %, from a microsecond to days, in 4 KiB.

use std::fmt;
use std::time::Duration;

/// Buckets to each doubling.
const STEPS: usize = 16;
/// Doublings above the first sixteen microseconds: up to 2^36 us, nineteen hours. Longer ones count as that.
const DOUBLINGS: usize = 32;

/// Times, counted in buckets.
#[derive(Clone, PartialEq, Eq)]
pub struct Latencies {
    buckets: [u64; STEPS * (DOUBLINGS + 1)],
    count: u64,
    longest_us: u64,
}

impl Default for Latencies {
    fn default() -> Self {
        Latencies {
            buckets: [0; STEPS * (DOUBLINGS + 1)],
            count: 0,
            longest_us: 0,
        }
    }
}

impl Latencies {
    /// Counts `times` waits of `us` microseconds.
    pub fn add(&mut self, us: u64, times: u64) {
        self.buckets[bucket_of(us)] += times;
        self.count += times;
        self.longest_us = self.longest_us.max(us);
    }

    /// How many were counted.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest of all.
    pub fn longest(&self) -> Duration {
        Duration::from_micros(self.longest_us)
    }

    /// The time that `share` (0 to 1) of the waits did not exceed, to 6 % above; zero when nothing was counted.
    pub fn quantile(&self, share: f64) -> Duration {
        let wanted = (share.clamp(0.0, 1.0) * self.count as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (bucket, times) in self.buckets.iter().enumerate() {
            seen += times;
            if seen >= wanted {
                return Duration::from_micros(upper_end_of(bucket).min(self.longest_us));
            }
        }
        Duration::ZERO
    }
}

impl fmt::Display for Latencies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |d: Duration| d.as_secs_f64() * 1000.0;
        write!(
            f,
            "{} rows acknowledged: p50 {:.1} ms, p90 {:.1} ms, p99 {:.1} ms, p99.9 {:.1} ms, longest {:.1} ms",
            self.count,
            ms(self.quantile(0.5)),
            ms(self.quantile(0.9)),
            ms(self.quantile(0.99)),
            ms(self.quantile(0.999)),
            ms(self.longest())
        )
    }
}

impl fmt::Debug for Latencies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

fn bucket_of(us: u64) -> usize {
    if us < STEPS as u64 {
        return us as usize;
    }
    // The highest bit says which doubling, the four bits behind it which step of that.
    let doubling = us.ilog2() as usize - 4;
    let step = (us >> doubling) as usize - STEPS;
    (STEPS * (doubling + 1) + step).min(STEPS * (DOUBLINGS + 1) - 1)
}

fn upper_end_of(bucket: usize) -> u64 {
    let (doubling, step) = (bucket / STEPS, bucket % STEPS);
    if doubling == 0 {
        return step as u64;
    }
    ((STEPS + step + 1) as u64) * (1 << (doubling - 1)) - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn half_of_a_thousand_waits_is_at_their_middle() {
        let mut waits = Latencies::default();
        (1..=1000).for_each(|ms| waits.add(ms * 1000, 1));
        let middle = waits.quantile(0.5).as_secs_f64();
        assert!((0.5..0.532).contains(&middle), "{middle}");
        assert_eq!(waits.longest(), Duration::from_secs(1));
        assert_eq!(waits.quantile(1.0), Duration::from_secs(1));
        assert_eq!(Latencies::default().quantile(0.99), Duration::ZERO);
    }

    proptest! {
        #[test]
        fn a_wait_is_known_to_six_percent(us in 0_u64..1 << 36) {
            let bucket = bucket_of(us);
            let end = upper_end_of(bucket);
            prop_assert!(end >= us && end - us <= us / 16, "{us} in a bucket up to {end}");
            prop_assert!(bucket == 0 || upper_end_of(bucket - 1) < us);
        }

        #[test]
        fn no_wait_is_too_long_to_be_counted(us: u64) {
            Latencies::default().add(us, 1);
        }
    }
}

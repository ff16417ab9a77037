//! Three clocks, three types: [`Tick`] (servo cycles), [`crate::Seconds`] (durations in formulas) and [`Timestamp`] (UTC, in records).
//! Only the shell reads a real clock; the core is told.

use crate::{Seconds, TICK};
use core::ops::{Add, AddAssign, Sub};

/// A count of servo cycles of 1 ms since the machine was switched on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tick(pub u64);

impl Tick {
    /// The time since tick 0.
    pub fn seconds(self) -> Seconds {
        Seconds(self.0 as f64 * TICK.0)
    }
}
impl Add<u64> for Tick {
    type Output = Tick;
    fn add(self, cycles: u64) -> Tick {
        Tick(self.0 + cycles)
    }
}
impl AddAssign<u64> for Tick {
    fn add_assign(&mut self, cycles: u64) {
        self.0 += cycles;
    }
}
impl Sub for Tick {
    type Output = u64;
    /// Cycles from `earlier` to `self`; 0 when `earlier` is later.
    fn sub(self, earlier: Tick) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

/// A point in time: nanoseconds since 1970-01-01T00:00:00Z, without leap seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// The moment of `tick` on a machine whose tick 0 was at `self`.
    pub fn at(self, tick: Tick) -> Timestamp {
        Timestamp(self.0 + tick.0 as i64 * 1_000_000)
    }
    /// The duration from `earlier` to `self`, negative when `earlier` is later.
    pub fn since(self, earlier: Timestamp) -> Seconds {
        // A damaged record may hold times centuries apart.
        Seconds((i128::from(self.0) - i128::from(earlier.0)) as f64 * 1e-9)
    }
    /// Whole microseconds, the resolution of the record's time column.
    pub fn micros(self) -> i64 {
        self.0.div_euclid(1000)
    }
}
impl Add<Seconds> for Timestamp {
    type Output = Timestamp;
    fn add(self, duration: Seconds) -> Timestamp {
        Timestamp(self.0.saturating_add(nanoseconds(duration)))
    }
}

/// Whole nanoseconds; a cast of a float saturates.
fn nanoseconds(duration: Seconds) -> i64 {
    libm::round(duration.0 * 1e9) as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_is_a_millisecond_of_utc() {
        assert_eq!(Timestamp(5).at(Tick(3)), Timestamp(3_000_005));
        assert_eq!(Timestamp(3_000_000).since(Timestamp(0)), Seconds(0.003));
    }

    #[test]
    fn times_at_the_two_ends_of_the_range_are_584_years_apart() {
        let apart = Timestamp(i64::MAX).since(Timestamp(i64::MIN));
        assert!((apart.0 / (365.25 * 86_400.0) - 584.5).abs() < 0.1);
        assert_eq!(Timestamp(i64::MAX) + Seconds(1.0), Timestamp(i64::MAX));
    }
}

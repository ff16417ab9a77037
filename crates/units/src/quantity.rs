//! Numbers with their unit.
//!
//! Only the products and quotients that the motion formulas need exist; anything else has to go through `.0`, where a reader sees it.

use core::fmt;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $unit:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(pub f64);

        impl $name {
            /// Nothing of it.
            pub const ZERO: $name = $name(0.0);
            /// The unit as it is printed behind the number.
            pub const UNIT: &'static str = $unit;

            /// Size without sign.
            pub fn abs(self) -> Self { $name(self.0.abs()) }
            /// The smaller of two.
            pub fn min(self, other: Self) -> Self { $name(self.0.min(other.0)) }
            /// The larger of two.
            pub fn max(self, other: Self) -> Self { $name(self.0.max(other.0)) }
            /// False for infinities and not-a-number.
            pub fn is_finite(self) -> bool { self.0.is_finite() }
        }
        impl Add for $name { type Output = Self; fn add(self, o: Self) -> Self { $name(self.0 + o.0) } }
        impl Sub for $name { type Output = Self; fn sub(self, o: Self) -> Self { $name(self.0 - o.0) } }
        impl Neg for $name { type Output = Self; fn neg(self) -> Self { $name(-self.0) } }
        impl AddAssign for $name { fn add_assign(&mut self, o: Self) { self.0 += o.0 } }
        impl SubAssign for $name { fn sub_assign(&mut self, o: Self) { self.0 -= o.0 } }
        impl Mul<f64> for $name { type Output = Self; fn mul(self, k: f64) -> Self { $name(self.0 * k) } }
        impl Mul<$name> for f64 { type Output = $name; fn mul(self, q: $name) -> $name { $name(self * q.0) } }
        impl Div<f64> for $name { type Output = Self; fn div(self, k: f64) -> Self { $name(self.0 / k) } }
        impl Div for $name { type Output = f64; fn div(self, o: Self) -> f64 { self.0 / o.0 } }
        impl Sum for $name { fn sum<I: Iterator<Item = Self>>(items: I) -> Self { items.fold(Self::ZERO, Add::add) } }
        impl fmt::Display for $name {
            /// The number, with the precision asked for, and its unit: `format!("{:.3}", Millimetres(1.5))` is `1.500 mm`.
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(&self.0, f)?;
                f.write_str(concat!(" ", $unit))
            }
        }
    };
}

quantity!(/// A length or a coordinate.
    Millimetres, "mm");
quantity!(/// A duration in formulas; never a point in time.
    Seconds, "s");
quantity!(/// A speed along an axis or a path. Feeds per minute are divided by 60 where they are read.
    MmPerSec, "mm/s");
quantity!(/// An acceleration.
    MmPerSec2, "mm/s^2");
quantity!(/// A jerk: how fast an acceleration changes.
    MmPerSec3, "mm/s^3");
quantity!(/// An angle.
    Radians, "rad");
quantity!(/// Spindle speed in revolutions per minute, the unit of every S word; never negative, the direction is told apart.
    Rpm, "rev/min");

impl Mul<Seconds> for MmPerSec {
    type Output = Millimetres;
    fn mul(self, t: Seconds) -> Millimetres {
        Millimetres(self.0 * t.0)
    }
}
impl Mul<Seconds> for MmPerSec2 {
    type Output = MmPerSec;
    fn mul(self, t: Seconds) -> MmPerSec {
        MmPerSec(self.0 * t.0)
    }
}
impl Mul<Seconds> for MmPerSec3 {
    type Output = MmPerSec2;
    fn mul(self, t: Seconds) -> MmPerSec2 {
        MmPerSec2(self.0 * t.0)
    }
}
impl Div<Seconds> for Millimetres {
    type Output = MmPerSec;
    fn div(self, t: Seconds) -> MmPerSec {
        MmPerSec(self.0 / t.0)
    }
}
impl Div<MmPerSec> for Millimetres {
    type Output = Seconds;
    fn div(self, v: MmPerSec) -> Seconds {
        Seconds(self.0 / v.0)
    }
}
impl Div<MmPerSec2> for MmPerSec {
    type Output = Seconds;
    fn div(self, a: MmPerSec2) -> Seconds {
        Seconds(self.0 / a.0)
    }
}

impl Millimetres {
    /// A length read in inches.
    pub fn from_inches(inches: f64) -> Self {
        Millimetres(inches * crate::MM_PER_INCH)
    }
}

impl MmPerSec {
    /// A feed read per minute, the way F words and STEP-NC files give it.
    pub fn from_mm_per_min(feed: f64) -> Self {
        MmPerSec(feed / 60.0)
    }
    /// The same feed per minute, the way a machinist reads it.
    pub fn mm_per_min(self) -> f64 {
        self.0 * 60.0
    }
}

/// Distance needed to stop from `speed` at a constant `deceleration`.
pub fn stopping_distance(speed: MmPerSec, deceleration: MmPerSec2) -> Millimetres {
    speed * (speed / deceleration) / 2.0
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::format;

    #[test]
    fn a_feed_per_minute_is_converted_once_and_prints_with_its_unit() {
        assert_eq!(format!("{:.1}", MmPerSec::from_mm_per_min(600.0)), "10.0 mm/s");
        assert_eq!(Millimetres::from_inches(2.0), Millimetres(50.8));
    }

    #[test]
    fn stopping_from_500_mm_per_s_at_3000_mm_per_s2_takes_41_7_mm() {
        assert_eq!(
            format!("{:.1}", stopping_distance(MmPerSec(500.0), MmPerSec2(3000.0))),
            "41.7 mm"
        );
    }
}

//! Numbers as controls read them: a fixed number of decimals, no exponent, no minus zero.

/// How a control writes a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decimals {
    /// Digits behind the point, at most.
    pub places: u32,
    /// A whole number keeps its point: `10.`; without it some controls read least increments.
    pub point: bool,
    /// A plus before what is not negative.
    pub plus: bool,
}

/// Largest value that is written, in the last decimal: beyond, a double no longer holds every increment, and no control goes there.
const LARGEST: f64 = 9.0e15;

/// A value in whole units of its last decimal: what a control will believe it is. `None` when it is not finite or too large.
pub fn units_of(value: f64, places: u32) -> Option<i64> {
    let scaled = libm::round(value * scale(places));
    // Away from rounding to infinity and from values that no longer count in ones.
    (scaled.is_finite() && scaled.abs() < LARGEST).then_some(scaled as i64)
}

/// Units of the last decimal in one.
pub fn scale(places: u32) -> f64 {
    10_i64.pow(places.min(15)) as f64
}

impl Decimals {
    /// So many digits, and a point only where there are some.
    pub const fn plain(places: u32) -> Decimals {
        Decimals {
            places,
            point: false,
            plus: false,
        }
    }

    /// The same with the point of whole numbers.
    pub const fn pointed(places: u32) -> Decimals {
        Decimals {
            point: true,
            ..Decimals::plain(places)
        }
    }

    /// The same with a sign.
    pub const fn signed(places: u32) -> Decimals {
        Decimals {
            plus: true,
            ..Decimals::plain(places)
        }
    }

    /// A number in units of the last decimal, as text.
    pub fn spell(&self, units: i64) -> String {
        let sign = match (units < 0, self.plus) {
            (true, _) => "-",
            (false, true) => "+",
            (false, false) => "",
        };
        let digits = format!("{:0width$}", units.unsigned_abs(), width = self.places as usize + 1);
        let (whole, fraction) = digits.split_at(digits.len() - self.places as usize);
        let fraction = fraction.trim_end_matches('0');
        match (fraction.is_empty(), self.point) {
            (true, true) => format!("{sign}{whole}."),
            (true, false) => format!("{sign}{whole}"),
            (false, _) => format!("{sign}{whole}.{fraction}"),
        }
    }

    /// A value as text; `None` when it is not finite or too large.
    pub fn write(&self, value: f64) -> Option<String> {
        units_of(value, self.places).map(|units| self.spell(units))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FANUC: Decimals = Decimals {
        places: 3,
        point: true,
        plus: false,
    };

    #[test]
    fn numbers_have_neither_exponent_nor_minus_zero() {
        for (value, text) in [
            (0.0, "0."),
            (-0.0, "0."),
            (-0.0004, "0."),
            (0.0005, "0.001"),
            (-0.0005, "-0.001"),
            (1e-7, "0."),
            (12.0, "12."),
            (-0.5, "-0.5"),
            (99999.999, "99999.999"),
            (123_456_789.25, "123456789.25"),
        ] {
            assert_eq!(FANUC.write(value).as_deref(), Some(text), "{value}");
        }
        assert_eq!(FANUC.write(f64::NAN), None);
        assert_eq!(FANUC.write(f64::INFINITY), None);
        assert_eq!(FANUC.write(1e300), None);
    }

    #[test]
    fn whole_numbers_lose_their_point_only_where_the_control_allows_it() {
        let siemens = Decimals {
            places: 4,
            point: false,
            plus: false,
        };
        let heidenhain = Decimals { plus: true, ..siemens };
        assert_eq!(siemens.write(10.0).as_deref(), Some("10"));
        assert_eq!(heidenhain.write(10.0).as_deref(), Some("+10"));
        assert_eq!(heidenhain.write(-0.25).as_deref(), Some("-0.25"));
        let whole = Decimals {
            places: 0,
            point: false,
            plus: false,
        };
        assert_eq!(whole.write(2500.4).as_deref(), Some("2500"));
    }
}

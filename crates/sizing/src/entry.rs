//! Numbers as people type them at a machine, and lengths as people read them.

use std::fmt;
use thiserror::Error;
use units::{MM_PER_INCH, Millimetres};

/// A unit that people measure in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Millimetres.
    Mm,
    /// Inches.
    Inch,
}

impl Unit {
    /// A length that was read in this unit.
    pub fn length(self, number: f64) -> Millimetres {
        match self {
            Unit::Mm => Millimetres(number),
            Unit::Inch => Millimetres::from_inches(number),
        }
    }
    /// A length in this unit, as words: 3.2351 in, 20.015 mm. A tenth of the finest step of a control is the last digit.
    pub fn words(self, length: Millimetres) -> String {
        let (number, fewest, most) = match self {
            Unit::Mm => (length.0, 3, 4),
            Unit::Inch => (length.0 / MM_PER_INCH, 4, 5),
        };
        let text = format!("{number:.most$}");
        let text = if text.ends_with('0') {
            format!("{number:.fewest$}")
        } else {
            text
        };
        // -0.0000 is no number that a person should see.
        let text = if text.bytes().all(|b| b"-0.".contains(&b)) {
            text.trim_start_matches('-')
        } else {
            &text
        };
        format!("{text} {self}")
    }
    /// The other one.
    pub fn other(self) -> Unit {
        match self {
            Unit::Mm => Unit::Inch,
            Unit::Inch => Unit::Mm,
        }
    }
}
impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unit::Mm => "mm",
            Unit::Inch => "in",
        })
    }
}

/// Why a text is not a size.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NotASize {
    /// Nothing was typed.
    #[error("no size was entered: type what the gauge shows")]
    Empty,
    /// Not digits with one decimal point.
    #[error("{0:?} is not a number: type digits and one decimal point, like 20.015")]
    NotANumber(String),
    /// Two separators: one of them may group thousands.
    #[error("{0:?} has both `,` and `.`: type the size with a decimal point only")]
    BothSeparators(String),
    /// A comma before exactly three digits may be a decimal comma or group thousands.
    #[error("{text:?} may mean {decimal} or {grouped}: type it with a decimal point")]
    Ambiguous {
        /// What was typed.
        text: String,
        /// The one meaning.
        decimal: String,
        /// The other.
        grouped: String,
    },
}

/// Reads a number: digits, a sign, one decimal point or comma. No exponent, no grouping, no guessing.
///
/// # Errors
/// The text is not such a number, or it has two meanings and the person must be asked.
pub fn number(text: &str) -> Result<f64, NotASize> {
    let typed = text.trim();
    if typed.is_empty() {
        return Err(NotASize::Empty);
    }
    let digits = typed.strip_prefix(['+', '-']).unwrap_or(typed);
    let commas = digits.matches(',').count();
    let points = digits.matches('.').count();
    if commas > 0 && points > 0 {
        return Err(NotASize::BothSeparators(typed.to_owned()));
    }
    let plain =
        digits.bytes().all(|b| b.is_ascii_digit() || b == b',' || b == b'.') && digits.bytes().any(|b| b.is_ascii_digit());
    if !plain || commas + points > 1 {
        return Err(NotASize::NotANumber(typed.to_owned()));
    }
    if let Some((whole, part)) = digits.split_once(',') {
        // `0,125` and `1250,125` cannot be groups of thousands; `20,015` can.
        if part.len() == 3 && (1..=3).contains(&whole.len()) && !whole.starts_with('0') {
            return Err(NotASize::Ambiguous {
                text: typed.to_owned(),
                decimal: typed.replace(',', "."),
                grouped: typed.replace(',', ""),
            });
        }
    }
    match typed.replace(',', ".").parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(NotASize::NotANumber(typed.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[track_caller]
    fn check(text: &str, expected: &str) {
        let found = number(text).map_or_else(|e| e.to_string(), |n| n.to_string());
        assert!(found.starts_with(expected), "{text:?}: {found}");
    }

    #[test]
    fn sizes_are_read_as_a_gauge_or_a_person_writes_them() {
        check("3.2351", "3.2351");
        check(" 20,01 \r\n", "20.01");
        check("0,125", "0.125");
        check("1250,125", "1250.125");
        check("+.5", "0.5");
        check("5.", "5");
        check("-1", "-1");
    }

    #[test]
    fn what_has_two_meanings_is_asked_and_what_has_none_is_refused() {
        check("", "no size was entered");
        check("  ", "no size was entered");
        check("20,015", "\"20,015\" may mean 20.015 or 20015");
        check("1,234.5", "\"1,234.5\" has both");
        check("1.234.567", "\"1.234.567\" is not a number");
        for odd in [
            "abc", "nan", "inf", "1e3", "0x10", "20 015", "--1", "+-1", "1-", ".", ",", "3.2mm", "٣", "1'000",
        ] {
            check(odd, &format!("{odd:?} is not a number"));
        }
        let beyond = "9".repeat(400);
        check(&beyond, &format!("{beyond:?} is not a number"));
    }

    #[test]
    fn lengths_are_shown_with_the_digits_of_their_unit() {
        assert_eq!(Unit::Inch.words(Unit::Inch.length(3.2351)), "3.2351 in");
        assert_eq!(Unit::Mm.words(Millimetres(20.015)), "20.015 mm");
        assert_eq!(Unit::Mm.words(Millimetres(-0.0229)), "-0.0229 mm");
        assert_eq!(Unit::Mm.words(Millimetres(-1e-9)), "0.000 mm");
    }

    proptest! {
        #[test]
        fn no_text_panics_and_what_is_read_is_finite(text in ".{0,40}") {
            if let Ok(n) = number(&text) {
                prop_assert!(n.is_finite());
            }
        }
        #[test]
        fn every_decimal_reads_back(n in -1e6..1e6_f64) {
            prop_assert_eq!(number(&n.to_string()), Ok(n));
        }
    }
}

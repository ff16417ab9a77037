//! DPRNT and BPRNT: numbers as the control prints them.

/// A number in its field: digits before and behind the point, with a place for the sign in front.
pub(crate) fn printed(value: f64, whole: u8, decimals: u8, no_zeros: bool, grows: bool) -> String {
    let (whole, decimals) = (usize::from(whole), usize::from(decimals));
    let scale = libm::pow(10.0, decimals as f64);
    // Half away from zero in the decimal sense: 12.3455 counts as a half although its binary value may lie below.
    let scaled = value.abs() * scale;
    let counted = libm::floor(scaled + 0.5 + scaled.max(1.0) * 1e-12).min(1e30) as u128;
    let negative = value < 0.0 && counted > 0;
    let unit = 10_u128.pow(decimals as u32);
    let mut front = (counted / unit).to_string();
    if front.len() > whole && !grows {
        front = front[front.len() - whole..].to_owned();
    }
    let front = front.trim_start_matches('0');
    let front = if front.is_empty() && whole > 0 { "0" } else { front };
    let sign = if negative {
        "-"
    } else if no_zeros {
        ""
    } else {
        " "
    };
    let blanks = if no_zeros { 0 } else { whole.saturating_sub(front.len()) };
    let mut text = format!("{sign}{:blanks$}{front}", "");
    if decimals > 0 {
        text.push_str(&format!(".{:0decimals$}", counted % unit));
    }
    text
}

/// A number times ten to the decimals as four bytes, high byte first, each as the character of that number; `None` when it takes more.
pub(crate) fn binary(value: f64, decimals: u8) -> Option<String> {
    let scaled = libm::round(value * libm::pow(10.0, f64::from(decimals)));
    let fits = (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&scaled);
    fits.then(|| (scaled as i32).to_be_bytes().iter().map(|b| char::from(*b)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fill_their_field_as_the_manual_shows() {
        for (value, field, no_zeros, expected) in [
            (12.34567, (3, 3), true, "12.346"),
            (-7.5, (3, 3), true, "-7.500"),
            (123.456, (2, 0), true, "23"),
            (12.34567, (4, 3), false, "   12.346"),
            (-7.5, (4, 3), false, "-   7.500"),
            (123.456, (2, 0), false, " 23"),
            (0.0, (2, 0), false, "  0"),
            (-0.0001, (2, 2), true, "0.00"),
            (1002.0, (3, 0), true, "2"),
            (0.0005, (1, 3), true, "0.001"),
            (0.5, (0, 2), true, ".50"),
        ] {
            assert_eq!(
                printed(value, field.0, field.1, no_zeros, false),
                expected,
                "{value} {field:?}"
            );
        }
        assert_eq!(printed(123.456, 2, 0, true, true), "123");
        assert_eq!(binary(-1.0, 0).as_deref(), Some("\u{ff}\u{ff}\u{ff}\u{ff}"));
        assert_eq!(binary(0.4096, 4).as_deref(), Some("\0\0\u{10}\0"));
        assert_eq!(binary(1e9, 1), None);
    }
}

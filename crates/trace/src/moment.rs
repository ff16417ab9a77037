//! Days and times as RFC 3339 writes them: `2026-11-20`, `2026-11-20T06:00:00Z`, `2026-11-20T07:00:00.5+01:00`.

/// True for a day, or a time with its offset from UTC; both have to be in the calendar.
pub(crate) fn is_moment(text: &str) -> bool {
    read(text).is_some()
}

fn read(text: &str) -> Option<()> {
    let mut rest = text.as_bytes();
    let year = number(&mut rest, 4)?;
    byte(&mut rest, b"-")?;
    let month = number(&mut rest, 2)?;
    byte(&mut rest, b"-")?;
    let day = number(&mut rest, 2)?;
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match month {
        2 if leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    within(day, 1, days)?;
    if rest.is_empty() {
        return Some(());
    }
    byte(&mut rest, b"Tt ")?;
    within(number(&mut rest, 2)?, 0, 23)?;
    byte(&mut rest, b":")?;
    within(number(&mut rest, 2)?, 0, 59)?;
    byte(&mut rest, b":")?;
    // A leap second is the 60th.
    within(number(&mut rest, 2)?, 0, 60)?;
    if byte(&mut rest, b".").is_some() {
        number(&mut rest, 1)?;
        while number(&mut rest, 1).is_some() {}
    }
    if byte(&mut rest, b"Zz").is_none() {
        byte(&mut rest, b"+-")?;
        within(number(&mut rest, 2)?, 0, 23)?;
        byte(&mut rest, b":")?;
        within(number(&mut rest, 2)?, 0, 59)?;
    }
    rest.is_empty().then_some(())
}

/// A number of so many digits.
fn number(rest: &mut &[u8], digits: usize) -> Option<u32> {
    let (digits, behind) = rest.split_at_checked(digits)?;
    let number = digits
        .iter()
        .try_fold(0, |number, digit| Some(number * 10 + char::from(*digit).to_digit(10)?))?;
    *rest = behind;
    Some(number)
}

fn byte(rest: &mut &[u8], any_of: &[u8]) -> Option<()> {
    let (first, behind) = rest.split_first()?;
    any_of.contains(first).then(|| *rest = behind)
}

fn within(number: u32, least: u32, most: u32) -> Option<()> {
    (least..=most).contains(&number).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_or_a_time_with_its_offset_is_a_moment_and_nothing_else_is() {
        for moment in [
            "2026-11-20",
            "2024-02-29",
            "2000-02-29",
            "2026-11-20T06:00:00Z",
            "2026-11-20t06:00:00z",
            "2026-11-20 06:00:00.125+01:00",
            "2016-12-31T23:59:60Z",
            "0000-01-01T00:00:00-00:00",
        ] {
            assert!(is_moment(moment), "{moment}");
        }
        for none in [
            "",
            "yesterday",
            "20.11.2026",
            "2026-11",
            "2026-1-2",
            "2026-13-01",
            "2026-00-01",
            "2026-02-29",
            "1900-02-29",
            "2026-04-31",
            "2026-11-00",
            "2026-11-20T",
            "2026-11-20T06:00",
            "2026-11-20T06:00:00",
            "2026-11-20T24:00:00Z",
            "2026-11-20T06:60:00Z",
            "2026-11-20T06:00:61Z",
            "2026-11-20T06:00:00.Z",
            "2026-11-20T06:00:00+1:00",
            "2026-11-20T06:00:00+24:00",
            "2026-11-20T06:00:00Z ",
            " 2026-11-20",
            "+026-11-20",
            "2026-11-２０",
            "2026-11-20T06:00:00Zulu",
        ] {
            assert!(!is_moment(none), "{none}");
        }
    }
}

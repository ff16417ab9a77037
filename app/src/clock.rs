//! The only place that reads a real clock, and the words for times.

use crate::failure::Failure;
use units::Timestamp;

/// The start of a run: what `--start` says, else now.
///
/// # Errors
/// `--start` is no RFC 3339 time.
pub fn start_time(given: Option<&str>) -> Result<Timestamp, Failure> {
    match given {
        None => nanoseconds(jiff_std::Timestamp::now()),
        Some(text) => {
            let parsed: jiff_std::Timestamp = text
                .parse()
                .map_err(|error| Failure::usage(format_args!("--start {text}: {error}; write it like 2026-11-21T08:30:00Z")))?;
            nanoseconds(parsed)
        }
    }
}

fn nanoseconds(at: jiff_std::Timestamp) -> Result<Timestamp, Failure> {
    i64::try_from(at.as_nanosecond()).map(Timestamp).map_err(|_| {
        Failure::usage(format_args!(
            "the time {at} is outside the years 1678 to 2261 that records can hold"
        ))
    })
}

/// UTC, for files: `2026-11-21T08:30:00.25Z`.
pub fn utc(at: Timestamp) -> String {
    instant(at).to_string()
}

fn instant(at: Timestamp) -> jiff_std::Timestamp {
    jiff_std::Timestamp::from_nanosecond(i128::from(at.0)).expect("every 64-bit count of nanoseconds is a time jiff can hold")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_given_start_is_kept_to_the_nanosecond() {
        let at = start_time(Some("2026-11-21T08:30:00.000000001Z")).expect("a good time");
        assert_eq!(utc(at), "2026-11-21T08:30:00.000000001Z");
    }

    #[test]
    fn a_start_that_is_no_time_says_how_to_write_one() {
        let failure = start_time(Some("tomorrow")).expect_err("no time");
        assert!(
            failure.message.contains("write it like 2026-11-21T08:30:00Z"),
            "{}",
            failure.message
        );
    }
}

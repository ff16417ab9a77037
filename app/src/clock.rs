//! The only place that reads a real clock, and the words for times.

use crate::failure::Failure;
use units::{Seconds, Timestamp};

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
    let outside = || {
        Failure::usage(format_args!(
            "the time {at} is outside the years 1678 to 2261 that records can hold"
        ))
    };
    let start = i64::try_from(at.as_nanosecond()).map_err(|_| outside())?;
    // The count of nanoseconds ends in April 2262: what is left after 2261 is for the run itself.
    if at >= "2262-01-01T00:00:00Z".parse().expect("a time") {
        return Err(outside());
    }
    Ok(Timestamp(start))
}

/// UTC, for files: `2026-11-21T08:30:00.25Z`.
pub fn utc(at: Timestamp) -> String {
    instant(at).to_string()
}

/// Local time, for people: `2026-11-21 09:30:00`.
pub fn local(at: Timestamp) -> String {
    let zoned = instant(at).to_zoned(jiff_std::tz::TimeZone::system());
    zoned.strftime("%Y-%m-%d %H:%M:%S").to_string()
}

/// Reads an RFC 3339 time; `None` for anything else.
pub fn parse(text: &str) -> Option<Timestamp> {
    let at: jiff_std::Timestamp = text.parse().ok()?;
    i64::try_from(at.as_nanosecond()).ok().map(Timestamp)
}

/// How far the system clock was from what it is kept by, as the kernel last heard; `None` where nothing keeps it.
#[cfg(target_os = "linux")]
pub fn sync_offset() -> Option<Seconds> {
    #[expect(unsafe_code, reason = "no safe wrapper of it exists in a crate that is in the house")]
    // SAFETY: all zeros is a `timex` that asks and sets nothing; it is written during the call only and lives longer.
    let (state, told) = unsafe {
        let mut told: libc::timex = std::mem::zeroed();
        (libc::adjtimex(&raw mut told), told)
    };
    let unit = if told.status & libc::STA_NANO != 0 { 1e-9 } else { 1e-6 };
    (state >= 0 && told.status & libc::STA_UNSYNC == 0).then_some(Seconds(told.offset as f64 * unit))
}

/// Elsewhere nobody is asked.
#[cfg(not(target_os = "linux"))]
pub fn sync_offset() -> Option<Seconds> {
    None
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
    fn a_start_so_late_that_the_run_would_not_fit_is_refused() {
        start_time(Some("2261-12-31T23:59:59Z")).expect("the last second");
        let failure = start_time(Some("2262-04-11T23:47:16Z")).expect_err("no room for a run");
        assert!(failure.message.contains("1678 to 2261"), "{}", failure.message);
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

//! RFC 3339 dates to and from [`Timestamp`].

use units::Timestamp;

/// Reads `2015-12-21T16:06:36.655Z`, with any offset and any number of fractional digits (nanoseconds are kept).
///
/// MTConnect says UTC; old adapters leave the `Z` away, which is read as UTC too. `None` for anything else, and for dates outside the
/// years 1678 to 2262, which 64 bits of nanoseconds cannot hold.
pub fn parse(text: &str) -> Option<Timestamp> {
    let text = text.trim();
    let instant = match text.parse::<jiff::Timestamp>() {
        Ok(instant) => instant,
        Err(_) => text
            .parse::<jiff::civil::DateTime>()
            .ok()?
            .to_zoned(jiff::tz::TimeZone::UTC)
            .ok()?
            .timestamp(),
    };
    i64::try_from(instant.as_nanosecond()).ok().map(Timestamp)
}

/// The date in UTC with as many fractional digits as it needs: `2015-12-21T16:06:36.655Z`.
pub fn format(at: Timestamp) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(at.0))
        .map(|instant| instant.to_string())
        .expect("64 bits of nanoseconds are the years 1678 to 2262")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_date_comes_back_to_the_nanosecond() {
        for text in [
            "2015-12-21T16:06:36.655Z",
            "1969-12-31T23:59:59.000000001Z",
            "2026-01-01T00:00:00Z",
        ] {
            assert_eq!(format(parse(text).expect("a date")), text);
        }
    }

    #[test]
    fn offsets_are_followed_and_a_missing_zone_is_utc() {
        assert_eq!(parse("2020-01-01T02:00:00+02:00"), parse("2020-01-01T00:00:00Z"));
        assert_eq!(parse("2020-01-01T00:00:00.5"), parse("2020-01-01T00:00:00.500Z"));
    }

    #[test]
    fn what_is_no_date_is_none() {
        for text in ["", "yesterday", "2015-13-01T00:00:00Z", "9999-01-01T00:00:00Z", "12:00"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}

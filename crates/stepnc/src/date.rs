//! Dates of STEP and timestamps of the house: [`read`] and [`Civil`].
//!
//! STEP splits a moment into CALENDAR_DATE, LOCAL_TIME and an offset from UTC; the order of its arguments is year, day, month.

use crate::aim::Aim;
use units::Timestamp;

/// A moment in the Gregorian calendar, UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Civil {
    pub(crate) year: i64,
    pub(crate) month: u32,
    pub(crate) day: u32,
    pub(crate) hour: u32,
    pub(crate) minute: u32,
    /// Nanoseconds of the minute.
    pub(crate) nanos: u64,
}

/// The moment as people and RFC 3339 write it, UTC, to the second.
pub(crate) fn words(moment: Timestamp) -> String {
    let Civil {
        year,
        month,
        day,
        hour,
        minute,
        nanos,
    } = Civil::of(moment);
    format!(
        "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{:02}Z",
        nanos / 1_000_000_000
    )
}

const SECOND: i64 = 1_000_000_000;
const DAY: i64 = 86_400 * SECOND;

impl Civil {
    pub(crate) fn of(moment: Timestamp) -> Self {
        let (days, rest) = (moment.0.div_euclid(DAY), moment.0.rem_euclid(DAY));
        // Days to date by 400-year eras that begin in March (H. Hinnant, "chrono-compatible low-level date algorithms").
        let z = days + 719_468;
        let (era, day_of_era) = (z.div_euclid(146_097), z.rem_euclid(146_097));
        let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let shifted_month = (5 * day_of_year + 2) / 153;
        let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
        let month = if shifted_month < 10 {
            shifted_month + 3
        } else {
            shifted_month - 9
        };
        Self {
            year: year_of_era + era * 400 + i64::from(month <= 2),
            month: month as u32,
            day: day as u32,
            hour: (rest / (3600 * SECOND)) as u32,
            minute: (rest / (60 * SECOND) % 60) as u32,
            nanos: (rest % (60 * SECOND)) as u64,
        }
    }

    /// `None` when the numbers are no date, or one beyond the years 1678 to 2262.
    pub(crate) fn timestamp(self) -> Option<Timestamp> {
        let valid = (1..=12).contains(&self.month) && (1..=31).contains(&self.day) && self.hour < 24 && self.minute < 60;
        if !valid || !(1600..2400).contains(&self.year) {
            return None;
        }
        let year = self.year - i64::from(self.month <= 2);
        let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
        let shifted_month = (i64::from(self.month) + 9) % 12;
        let day_of_year = (153 * shifted_month + 2) / 5 + i64::from(self.day) - 1;
        let days = era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468;
        let of_day = (i64::from(self.hour) * 60 + i64::from(self.minute)) * 60 * SECOND + self.nanos as i64;
        days.checked_mul(DAY)?.checked_add(of_day).map(Timestamp)
    }

    /// Seconds of the minute as a STEP real.
    pub(crate) fn seconds(self) -> String {
        let (whole, nanos) = (self.nanos / SECOND as u64, self.nanos % SECOND as u64);
        let fraction = format!("{nanos:09}");
        format!("{whole}.{}", fraction.trim_end_matches('0'))
    }

    /// RFC 3339, whole seconds: the time stamp of a header.
    pub(crate) fn rfc_3339(self) -> String {
        format!(
            "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z",
            self.year,
            self.month,
            self.day,
            self.hour,
            self.minute,
            self.nanos / SECOND as u64
        )
    }
}

/// The moment of a DATE_AND_TIME; `None` when it is not complete.
pub(crate) fn read(aim: Aim, id: u64) -> Option<Timestamp> {
    let both = aim.instance(id).ok()?;
    let date = aim.instance(both.argument(0).reference()?).ok()?;
    let time = aim.instance(both.argument(1).reference()?).ok()?;
    let whole = |value: &part21::Value, default: Option<f64>| {
        let number = value.number().or(default)?;
        (0.0..10_000.0).contains(&number).then_some(number as u32)
    };
    let seconds = time.argument(2).number().unwrap_or(0.0).clamp(0.0, 60.0);
    let local = Civil {
        year: i64::from(whole(date.argument(0), None)?),
        day: whole(date.argument(1), None)?,
        month: whole(date.argument(2), None)?,
        hour: whole(time.argument(0), None)?,
        minute: whole(time.argument(1), Some(0.0))?,
        nanos: libm::round(seconds * 1e9) as u64,
    };
    let zone = time.argument(3).reference().and_then(|id| aim.instance(id).ok());
    let ahead = zone.map_or(0, |zone| {
        let minutes = zone.argument(0).number().unwrap_or(0.0) * 60.0 + zone.argument(1).number().unwrap_or(0.0);
        let sense = match zone.argument(2).enumeration() {
            Some("AHEAD") => 1,
            Some("BEHIND") => -1,
            _ => 0,
        };
        sense * minutes.clamp(0.0, 1440.0) as i64 * 60 * SECOND
    });
    let local = local.timestamp()?;
    Some(Timestamp(local.0.checked_sub(ahead)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_day_of_four_centuries_comes_back() {
        for day in (-140_000..100_000).step_by(7) {
            let Some(moment) = i64::checked_mul(day, DAY).map(Timestamp) else {
                continue;
            };
            let moment = Timestamp(moment.0.saturating_add(12 * 3600 * SECOND + 34));
            if let Some(back) = Civil::of(moment).timestamp() {
                assert_eq!(back, moment);
            }
        }
    }

    #[test]
    fn a_moment_is_written_to_the_nanosecond() {
        let civil = Civil::of(Timestamp(1_795_257_001_250_000_000));
        assert_eq!(
            (civil.rfc_3339().as_str(), civil.seconds().as_str()),
            ("2026-11-21T10:30:01Z", "1.25")
        );
    }
}

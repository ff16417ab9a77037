//! Units as functions and conditions write them, and the one unit in which each quantity is compared and recorded.

use std::fmt;

/// What a number measures; its unit in conditions and records is [`Dimension::unit`], in MTConnect's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Dimension {
    /// A count or a ratio without unit.
    None,
    /// mm
    Length,
    /// s
    Time,
    /// mm/s
    Speed,
    /// mm/s^2
    Acceleration,
    /// rev/min
    RotarySpeed,
    /// rad/s^2
    AngularAcceleration,
    /// %
    Percent,
    /// A
    Current,
    /// W
    Power,
    /// N
    Force,
    /// Nm
    Torque,
    /// Pa
    Pressure,
    /// degrees Celsius
    Temperature,
    /// l/s
    Flow,
    /// dB
    Level,
    /// Hz
    Frequency,
}

impl Dimension {
    /// The unit in records: MTConnect 2.7's name of it; empty for a plain number.
    pub const fn unit(self) -> &'static str {
        match self {
            Dimension::None => "",
            Dimension::Length => "MILLIMETER",
            Dimension::Time => "SECOND",
            Dimension::Speed => "MILLIMETER/SECOND",
            Dimension::Acceleration => "MILLIMETER/SECOND^2",
            Dimension::RotarySpeed => "REVOLUTION/MINUTE",
            Dimension::AngularAcceleration => "RADIAN/SECOND^2",
            Dimension::Percent => "PERCENT",
            Dimension::Current => "AMPERE",
            Dimension::Power => "WATT",
            Dimension::Force => "NEWTON",
            Dimension::Torque => "NEWTON_METER",
            Dimension::Pressure => "PASCAL",
            Dimension::Temperature => "CELSIUS",
            Dimension::Flow => "LITER/SECOND",
            Dimension::Level => "DECIBEL",
            Dimension::Frequency => "HERTZ",
        }
    }

    /// The same as a person writes it in a condition.
    pub const fn symbol(self) -> &'static str {
        match self {
            Dimension::None => "",
            Dimension::Length => "mm",
            Dimension::Time => "s",
            Dimension::Speed => "mm/s",
            Dimension::Acceleration => "mm/s2",
            Dimension::RotarySpeed => "rpm",
            Dimension::AngularAcceleration => "rad/s2",
            Dimension::Percent => "%",
            Dimension::Current => "A",
            Dimension::Power => "W",
            Dimension::Force => "N",
            Dimension::Torque => "Nm",
            Dimension::Pressure => "Pa",
            Dimension::Temperature => "C",
            Dimension::Flow => "l/s",
            Dimension::Level => "dB",
            Dimension::Frequency => "Hz",
        }
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Dimension::None => "a number without unit",
            other => other.symbol(),
        })
    }
}

/// A unit that may be written: its spelling, what it measures, and what one of it is in the unit of records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// As written; case does not matter but where two would be alike otherwise.
    pub spelling: &'static str,
    /// What it measures.
    pub dimension: Dimension,
    /// value in records = number * factor
    pub factor: f64,
}

const fn unit(spelling: &'static str, dimension: Dimension, factor: f64) -> Unit {
    Unit {
        spelling,
        dimension,
        factor,
    }
}

/// Every unit that is understood. Inches are there, because programs of inch shops write them.
pub const UNITS: &[Unit] = &[
    unit("mm", Dimension::Length, 1.0),
    unit("um", Dimension::Length, 1e-3),
    unit("m", Dimension::Length, 1e3),
    unit("in", Dimension::Length, 25.4),
    unit("inch", Dimension::Length, 25.4),
    unit("s", Dimension::Time, 1.0),
    unit("ms", Dimension::Time, 1e-3),
    unit("min", Dimension::Time, 60.0),
    unit("h", Dimension::Time, 3600.0),
    unit("mm/s", Dimension::Speed, 1.0),
    unit("mm/min", Dimension::Speed, 1.0 / 60.0),
    unit("m/s", Dimension::Speed, 1e3),
    unit("m/min", Dimension::Speed, 1e3 / 60.0),
    unit("in/min", Dimension::Speed, 25.4 / 60.0),
    unit("mm/s2", Dimension::Acceleration, 1.0),
    unit("m/s2", Dimension::Acceleration, 1e3),
    unit("rpm", Dimension::RotarySpeed, 1.0),
    unit("rev/min", Dimension::RotarySpeed, 1.0),
    unit("1/min", Dimension::RotarySpeed, 1.0),
    unit("rad/s2", Dimension::AngularAcceleration, 1.0),
    unit("%", Dimension::Percent, 1.0),
    unit("percent", Dimension::Percent, 1.0),
    unit("A", Dimension::Current, 1.0),
    unit("W", Dimension::Power, 1.0),
    unit("kW", Dimension::Power, 1e3),
    unit("N", Dimension::Force, 1.0),
    unit("kN", Dimension::Force, 1e3),
    unit("Nm", Dimension::Torque, 1.0),
    unit("N.m", Dimension::Torque, 1.0),
    unit("Pa", Dimension::Pressure, 1.0),
    unit("kPa", Dimension::Pressure, 1e3),
    unit("MPa", Dimension::Pressure, 1e6),
    unit("bar", Dimension::Pressure, 1e5),
    unit("C", Dimension::Temperature, 1.0),
    unit("degC", Dimension::Temperature, 1.0),
    unit("l/s", Dimension::Flow, 1.0),
    unit("l/min", Dimension::Flow, 1.0 / 60.0),
    unit("dB", Dimension::Level, 1.0),
    unit("Hz", Dimension::Frequency, 1.0),
    unit("kHz", Dimension::Frequency, 1e3),
];

/// The unit of that spelling; as written first, then without regard to case, for G-code in capitals.
pub fn find(spelling: &str) -> Option<&'static Unit> {
    let exact = UNITS.iter().find(|unit| unit.spelling == spelling);
    exact.or_else(|| UNITS.iter().find(|unit| unit.spelling.eq_ignore_ascii_case(spelling)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_units_are_told_apart_by_case_alone() {
        for (k, a) in UNITS.iter().enumerate() {
            for b in &UNITS[..k] {
                assert!(!a.spelling.eq_ignore_ascii_case(b.spelling), "{} {}", a.spelling, b.spelling);
            }
        }
    }

    #[test]
    fn every_dimension_is_written_in_its_own_unit() {
        for unit in UNITS {
            let own = find(unit.dimension.symbol()).expect("in the list");
            assert_eq!((own.dimension, own.factor), (unit.dimension, 1.0));
        }
    }
}

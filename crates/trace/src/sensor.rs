//! Names of sensors and of the values that every machine has: one name in the program, the log, the agent and the conditions.
//!
//! `<component>.<MTConnect type>[.<subtype>][.<statistic>]`, as `X.LOAD`, `S1.ROTARY_VELOCITY.ACTUAL`, `X.LOAD.MAXIMUM`. The names of
//! the `get_<x>` functions are aliases (`drive_load`), and `position` is the encoder's. Whether a machine has a sensor is
//! asked elsewhere; here is only what a name means.

use crate::functions::MEASURES;
use crate::unit::Dimension;
use std::fmt;

/// Where a quantity is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// At each linear axis: `X`, `Y`, `Z`.
    Axis,
    /// At the spindle: `S1`.
    Spindle,
    /// Once for the machine, under this name: `PATH`, `COOLANT`, `TOOL`.
    One(&'static str),
}

/// What is kept of the cycles between two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Statistic {
    /// The last value.
    #[default]
    Last,
    /// The smallest.
    Minimum,
    /// The largest.
    Maximum,
    /// The mean.
    Average,
    /// The root of the mean square.
    Rms,
}

impl Statistic {
    /// All of them.
    pub const ALL: [Statistic; 5] = [
        Statistic::Last,
        Statistic::Minimum,
        Statistic::Maximum,
        Statistic::Average,
        Statistic::Rms,
    ];

    /// The word of `its_statistic`.
    pub const fn word(self) -> &'static str {
        match self {
            Statistic::Last => "last",
            Statistic::Minimum => "min",
            Statistic::Maximum => "max",
            Statistic::Average => "avg",
            Statistic::Rms => "rms",
        }
    }

    /// The last part of a stream's name; the last value has none.
    pub const fn suffix(self) -> &'static str {
        match self {
            Statistic::Last => "",
            Statistic::Minimum => "MINIMUM",
            Statistic::Maximum => "MAXIMUM",
            Statistic::Average => "AVERAGE",
            Statistic::Rms => "RMS",
        }
    }
}

/// One stream: a quantity at a component.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Sensor {
    /// `X`, `S1`, `PATH`.
    pub component: String,
    /// Type and subtype: `POSITION.ACTUAL`.
    pub quantity: String,
    /// What it is over the cycles of a sample.
    pub statistic: Statistic,
}

impl Sensor {
    /// Component, type and subtype: the name of the stream of single cycles.
    pub fn stream(&self) -> String {
        format!("{}.{}", self.component, self.quantity)
    }

    /// The place of its axis among X, Y, Z.
    pub fn linear_axis(&self) -> Option<usize> {
        AXES.iter().position(|axis| *axis == self.component)
    }

    /// What it measures; `None` for a type that is in no table here.
    pub fn dimension(&self) -> Option<Dimension> {
        let kind = self.quantity.split('.').next()?;
        TYPES.iter().find(|(name, _)| *name == kind).map(|(_, dimension)| *dimension)
    }
}

impl fmt::Display for Sensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.component, self.quantity)?;
        match self.statistic {
            Statistic::Last => Ok(()),
            other => write!(f, ".{}", other.suffix()),
        }
    }
}

/// MTConnect 2.7 types that machines of this kind report, and what they measure.
pub const TYPES: &[(&str, Dimension)] = &[
    ("ACCELERATION", Dimension::Acceleration),
    ("AMPERAGE", Dimension::Current),
    ("AMPERAGE_AC", Dimension::Current),
    ("AMPERAGE_DC", Dimension::Current),
    ("ANGULAR_ACCELERATION", Dimension::AngularAcceleration),
    ("AXIAL_CUTTING_DEPTH", Dimension::Length),
    ("AXIS_FEEDRATE", Dimension::Speed),
    ("CUTTING_SPEED", Dimension::Speed),
    ("DISPLACEMENT", Dimension::Length),
    ("FILL_LEVEL", Dimension::Percent),
    ("FLOW", Dimension::Flow),
    ("LINEAR_FORCE", Dimension::Force),
    ("LOAD", Dimension::Percent),
    ("PATH_FEEDRATE", Dimension::Speed),
    ("POSITION", Dimension::Length),
    ("PRESSURE", Dimension::Pressure),
    ("RADIAL_CUTTING_DEPTH", Dimension::Length),
    ("ROTARY_VELOCITY", Dimension::RotarySpeed),
    ("SOUND_LEVEL", Dimension::Level),
    ("TEMPERATURE", Dimension::Temperature),
    ("TORQUE", Dimension::Torque),
    ("WATTAGE", Dimension::Power),
];

/// Values that every machine of ours has, whatever its sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Predefined {
    /// Seconds since the present workingstep began.
    WorkingstepTime,
    /// Seconds since its operation began.
    OperationTime,
    /// Seconds since the program began.
    ProgramTime,
    /// 0 automatic, 1 MDI, 2 jog.
    Mode,
    /// Number of the tool in the spindle.
    Tool,
    /// Feed override, %.
    FeedOverride,
    /// Distance of the encoders' position from the commanded one, mm.
    PathDeviation,
    /// True while the alarm with this number is active.
    Alarm(u16),
}

/// Their names in conditions; `alarm[n]` is one more.
pub const PREDEFINED: &[(&str, Predefined, Dimension, &str)] = &[
    (
        "ws_time",
        Predefined::WorkingstepTime,
        Dimension::Time,
        "time since the workingstep began",
    ),
    (
        "op_time",
        Predefined::OperationTime,
        Dimension::Time,
        "time since the operation began",
    ),
    (
        "prog_time",
        Predefined::ProgramTime,
        Dimension::Time,
        "time since the program began",
    ),
    ("mode", Predefined::Mode, Dimension::None, "0 automatic, 1 MDI, 2 jog"),
    ("tool", Predefined::Tool, Dimension::None, "number of the tool in the spindle"),
    ("feed_override", Predefined::FeedOverride, Dimension::Percent, "feed override"),
    (
        "path_deviation",
        Predefined::PathDeviation,
        Dimension::Length,
        "distance of the encoders' position from the commanded one",
    ),
];

/// What a name in a condition means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// A value that every machine has.
    Predefined(Predefined),
    /// A sensor.
    Sensor(Sensor),
    /// A quantity with one stream for each axis: which of them is not said.
    Several(Vec<Sensor>),
    /// Nothing here is called so.
    Unknown,
}

/// What a name in a condition means, with or without `sensor:` or `trace:` before it.
pub fn meaning(name: &str) -> Meaning {
    let small = name.to_ascii_lowercase();
    let predefined = small.strip_prefix("trace:").unwrap_or(&small);
    if let Some(index) = predefined.strip_prefix("alarm[").and_then(|rest| rest.strip_suffix(']')) {
        return match index.parse() {
            Ok(id @ 1..=999) => Meaning::Predefined(Predefined::Alarm(id)),
            _ => Meaning::Unknown,
        };
    }
    if !small.starts_with("sensor:")
        && let Some((_, value, ..)) = PREDEFINED.iter().find(|(name, ..)| *name == predefined)
    {
        return Meaning::Predefined(*value);
    }
    if small.starts_with("trace:") {
        return Meaning::Unknown;
    }
    match streams(name, &[]) {
        Ok(found) if found.len() == 1 => Meaning::Sensor(found.into_iter().next().expect("there is one")),
        Ok(found) => Meaning::Several(found),
        Err(_) => Meaning::Unknown,
    }
}

/// Why a name is no stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoStream {
    /// What is wrong with it.
    pub message: String,
    /// What to write.
    pub remedy: String,
}

/// The streams that `its_sensors` (one name of it) and `its_axes` name together.
///
/// # Errors
/// The name is neither an alias nor of the form `component.TYPE`, or axes are given where there is none to choose.
pub fn streams(name: &str, axes: &[String]) -> Result<Vec<Sensor>, NoStream> {
    let small = name.to_ascii_lowercase();
    let plain = small.strip_prefix("sensor:").unwrap_or(&small);
    let (base, statistic) = without_statistic(plain);
    let of = |component: &str, quantity: &str| Sensor {
        component: component.to_ascii_uppercase(),
        quantity: quantity.to_ascii_uppercase(),
        statistic,
    };
    let refuse = |message: String, remedy: &str| {
        Err(NoStream {
            message,
            remedy: remedy.to_owned(),
        })
    };
    let alias = match base {
        "position" => MEASURES.iter().find(|m| m.name == "encoder_position"),
        other => MEASURES.iter().find(|m| m.name == other),
    };
    if let Some(measure) = alias {
        return match (measure.component, axes) {
            (Component::Axis, []) => Ok(AXES.iter().map(|axis| of(axis, measure.quantity)).collect()),
            (Component::Axis, axes) => Ok(once(axes.iter().map(|axis| of(axis, measure.quantity)))),
            (Component::Spindle, []) => Ok(vec![of("S1", measure.quantity)]),
            (Component::Spindle, spindles) => Ok(once(spindles.iter().map(|s| of(s, measure.quantity)))),
            (Component::One(component), []) => Ok(vec![of(component, measure.quantity)]),
            (Component::One(_), _) => refuse(format!("{name} is measured once, not at each axis"), "leave its_axes out"),
        };
    }
    let known = |word: &str| TYPES.iter().any(|(kind, _)| kind.eq_ignore_ascii_case(word));
    let first = base.split('.').next().unwrap_or_default();
    match (known(first), base.split_once('.'), axes) {
        (true, _, []) => refuse(
            format!("{name} does not say of what it is the {first}"),
            "write the component before it, as in X.LOAD, or give its_axes",
        ),
        (true, _, axes) => Ok(once(axes.iter().map(|axis| of(axis, base)))),
        (false, Some(_), axes) if !axes.is_empty() => refuse(
            format!("{name} names its component already"),
            "leave its_axes out, or the component",
        ),
        (false, Some((component, quantity)), _) if !component.is_empty() && !quantity.is_empty() => {
            Ok(vec![of(component, quantity)])
        }
        _ => refuse(
            format!("nothing is called {name}"),
            "write component.TYPE as in X.LOAD or S1.ROTARY_VELOCITY.ACTUAL, or an alias as drive_load",
        ),
    }
}

/// Each stream once, in the order named: functions take sets of them (`its_axes=X,x` is X).
pub(crate) fn once(named: impl IntoIterator<Item = Sensor>) -> Vec<Sensor> {
    let mut all: Vec<Sensor> = Vec::new();
    for sensor in named {
        if !all.contains(&sensor) {
            all.push(sensor);
        }
    }
    all
}

const AXES: [&str; 3] = ["X", "Y", "Z"];

fn without_statistic(name: &str) -> (&str, Statistic) {
    for statistic in Statistic::ALL {
        if statistic != Statistic::Last
            && let Some((base, last)) = name.rsplit_once('.')
            && last.eq_ignore_ascii_case(statistic.suffix())
        {
            return (base, statistic);
        }
    }
    (name, Statistic::Last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(name: &str, axes: &[&str], expected: &str) {
        let axes: Vec<String> = axes.iter().map(ToString::to_string).collect();
        let shown = match streams(name, &axes) {
            Ok(found) => found.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "),
            Err(refused) => refused.message,
        };
        assert_eq!(shown, expected);
    }

    #[test]
    fn both_forms_with_and_without_axes_name_the_same_streams() {
        check("LOAD", &["X", "z"], "X.LOAD Z.LOAD");
        check("drive_load", &["X", "Z"], "X.LOAD Z.LOAD");
        check("drive_load", &[], "X.LOAD Y.LOAD Z.LOAD");
        check("sensor:x.load", &[], "X.LOAD");
        check("position", &["Z"], "Z.POSITION.ACTUAL");
        check("interpolated_position", &["Z"], "Z.POSITION.COMMANDED");
        check("coolant_pressure", &[], "COOLANT.PRESSURE");
        check("X.LOAD.MAXIMUM", &[], "X.LOAD.MAXIMUM");
        check("spindle_speed", &[], "S1.ROTARY_VELOCITY.ACTUAL");
    }

    #[test]
    fn names_that_are_no_streams_say_why() {
        check("LOAD", &[], "LOAD does not say of what it is the load");
        check("X.LOAD", &["Y"], "X.LOAD names its component already");
        check(
            "coolant_pressure",
            &["X"],
            "coolant_pressure is measured once, not at each axis",
        );
        check("nonsense", &[], "nothing is called nonsense");
        check(".", &[], "nothing is called .");
    }

    #[test]
    fn a_name_in_a_condition_is_a_predefined_value_a_sensor_or_too_many() {
        assert_eq!(meaning("WS_TIME"), Meaning::Predefined(Predefined::WorkingstepTime));
        assert_eq!(meaning("trace:alarm[7]"), Meaning::Predefined(Predefined::Alarm(7)));
        assert_eq!(meaning("trace:nothing"), Meaning::Unknown);
        assert!(matches!(meaning("sensor:X.LOAD"), Meaning::Sensor(s) if s.to_string() == "X.LOAD"));
        assert!(matches!(meaning("drive_load"), Meaning::Several(all) if all.len() == 3));
    }
}

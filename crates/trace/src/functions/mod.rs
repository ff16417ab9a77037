//! Every function of the vocabulary: one file each, and one line in [`FUNCTIONS`].
//!
//! A file holds the function's row of the table: its keys, its words for the manual, an example, and what its line becomes
//! ([`Call`]). The manual page, the schema's mapping table, the contract tests and the post-processor's table walk the slice.

pub mod clear_alarm;
pub mod display_message;
pub mod get_execution_time;
pub mod get_operator_data;
pub mod get_time;
pub mod log_coolant_data;
pub mod log_coolant_type;
pub mod log_event;
pub mod log_nc_events;
pub mod log_nc_machine_data;
pub mod log_operator_data;
pub mod log_tool_data;
pub mod measures;
pub mod read_sensor_value;
pub mod set_alarm;
pub mod set_edit_access_level;
pub mod start_sensor_recording;
pub mod start_synchronized_action;
pub mod start_tool_logging;
pub mod stop_sensor_recording;
pub mod stop_synchronized_action;
pub mod stop_tool_logging;

use crate::function::{Argument, Function};
use crate::sensor::{NoStream, Sensor, streams};
use crate::unit::Dimension;
use crate::value::{Kind, Sampling, Value};
use plan::Expression;
use std::fmt;
use units::Millimetres;

pub use log_coolant_data::Coolant;
pub use measures::{MEASURES, Measure};
pub use set_alarm::{Alarm, Reaction, ResetBy};
pub use start_sensor_recording::Recording;
pub use start_synchronized_action::{Frequency, SynchronizedAction};

/// Every function, in the order of the manual.
pub const FUNCTIONS: &[&Definition] = &[
    &get_time::FUNCTION,
    &get_execution_time::FUNCTION,
    &log_nc_events::FUNCTION,
    &log_tool_data::FUNCTION,
    &start_tool_logging::FUNCTION,
    &stop_tool_logging::FUNCTION,
    &log_nc_machine_data::FUNCTION,
    &log_coolant_type::FUNCTION,
    &log_coolant_data::FUNCTION,
    &set_alarm::FUNCTION,
    &clear_alarm::FUNCTION,
    &log_event::FUNCTION,
    &get_operator_data::FUNCTION,
    &log_operator_data::FUNCTION,
    &set_edit_access_level::FUNCTION,
    &read_sensor_value::FUNCTION,
    &start_sensor_recording::FUNCTION,
    &stop_sensor_recording::FUNCTION,
    &display_message::FUNCTION,
    &measures::cutting_speed::GET,
    &measures::cutting_speed::POINTS_OF,
    &measures::spindle_speed::GET,
    &measures::spindle_speed::POINTS_OF,
    &measures::feedrate::GET,
    &measures::feedrate::POINTS_OF,
    &measures::axis_speed::GET,
    &measures::axis_speed::POINTS_OF,
    &measures::axis_acceleration::GET,
    &measures::axis_acceleration::POINTS_OF,
    &measures::bearing_acceleration::GET,
    &measures::bearing_acceleration::POINTS_OF,
    &measures::spindle_acceleration::GET,
    &measures::spindle_acceleration::POINTS_OF,
    &measures::axial_cutting_depth::GET,
    &measures::axial_cutting_depth::POINTS_OF,
    &measures::radial_cutting_depth::GET,
    &measures::radial_cutting_depth::POINTS_OF,
    &measures::coolant_pressure::GET,
    &measures::coolant_pressure::POINTS_OF,
    &measures::coolant_level::GET,
    &measures::coolant_level::POINTS_OF,
    &measures::coolant_temperature::GET,
    &measures::coolant_temperature::POINTS_OF,
    &measures::coolant_flow::GET,
    &measures::coolant_flow::POINTS_OF,
    &measures::interpolated_position::GET,
    &measures::interpolated_position::POINTS_OF,
    &measures::encoder_position::GET,
    &measures::encoder_position::POINTS_OF,
    &measures::axis_displacement::GET,
    &measures::axis_displacement::POINTS_OF,
    &measures::motor_current::GET,
    &measures::motor_current::POINTS_OF,
    &measures::motor_power::GET,
    &measures::motor_power::POINTS_OF,
    &measures::drive_load::GET,
    &measures::drive_load::POINTS_OF,
    &measures::machine_force::GET,
    &measures::machine_force::POINTS_OF,
    &measures::motor_torque::GET,
    &measures::motor_torque::POINTS_OF,
    &measures::tool_tip_temperature::GET,
    &measures::tool_tip_temperature::POINTS_OF,
    &measures::tool_tip_vibration::GET,
    &measures::tool_tip_vibration::POINTS_OF,
    &measures::acoustic_emission::GET,
    &measures::acoustic_emission::POINTS_OF,
    &measures::tool_wear::GET,
    &measures::tool_wear::POINTS_OF,
    &start_synchronized_action::FUNCTION,
    &stop_synchronized_action::FUNCTION,
];

/// The row of the function with that name, whatever its case; the seed's second spellings are names too.
pub fn find(name: &str) -> Option<&'static Definition> {
    let is = |candidate: &str| candidate.eq_ignore_ascii_case(name);
    FUNCTIONS.iter().copied().find(|d| is(d.name) || d.also.iter().any(|a| is(a)))
}

/// One function of the vocabulary.
#[derive(Clone, Copy)]
pub struct Definition {
    /// Its name.
    pub name: &'static str,
    /// Other names under which it is read.
    pub also: &'static [&'static str],
    /// The block of the reference that it belongs to.
    pub block: Block,
    /// Its keys, in groups that several functions share.
    pub groups: &'static [&'static [Key]],
    /// What it does, in a sentence or two.
    pub doc: &'static str,
    /// What its record holds.
    pub record: &'static str,
    /// A whole line.
    pub example: &'static str,
    /// It may be an action of a synchronized action.
    pub is_action: bool,
    /// The quantity of a `get_<x>` or `get_<x>_points`.
    pub measure: Option<&'static Measure>,
    /// What a line of it becomes.
    pub call: fn(&Arguments<'_>) -> Call,
}

impl fmt::Debug for Definition {
    /// Its name: the rest is in the table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Definition {
    /// Its keys, in the order of the manual.
    pub fn keys(&self) -> impl Iterator<Item = &'static Key> + use<> {
        self.groups.iter().flat_map(|group| group.iter())
    }

    /// The key that is written so: its own name, the name without `its_`, or with it; case does not matter.
    pub fn key(&self, written: &str) -> Option<&'static Key> {
        let bare = |name: &str| name.strip_prefix("its_").unwrap_or(name).to_owned();
        let wanted = bare(&written.to_ascii_lowercase());
        self.keys().find(|key| bare(key.name) == wanted)
    }
}

/// The blocks of the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// Time, tool, machine, coolant, operator, alarm, event.
    General,
    /// Values of sensors.
    Sensors,
    /// Conditions with actions.
    SynchronizedActions,
}

/// A key of a function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// The attribute of the EXPRESS schema.
    pub name: &'static str,
    /// What it takes.
    pub kind: Kind,
    /// A line without it is an error.
    pub required: bool,
    /// What it is, in a few words.
    pub doc: &'static str,
}

impl Key {
    /// A value that it takes, for messages.
    pub(crate) fn example(&self) -> String {
        match self.kind {
            Kind::Text | Kind::List => "...".to_owned(),
            Kind::Moment => "2026-11-20".to_owned(),
            Kind::Integer(from, _) => from.to_string(),
            Kind::Number(dimension) => format!("1{}", dimension.symbol()),
            Kind::State => "ON".to_owned(),
            Kind::Word(words) => words.first().copied().unwrap_or_default().to_owned(),
            Kind::Condition => "\"ws_time > 3600 s\"".to_owned(),
            Kind::Actions => "\"get_time\"".to_owned(),
            Kind::Sampling => "10".to_owned(),
            Kind::Reference => "#anchor".to_owned(),
        }
    }
}

const fn key(name: &'static str, kind: Kind, doc: &'static str) -> Key {
    Key {
        name,
        kind,
        required: false,
        doc,
    }
}

const fn required(name: &'static str, kind: Kind, doc: &'static str) -> Key {
    Key {
        name,
        kind,
        required: true,
        doc,
    }
}

/// Of every function.
const LOG: &[Key] = &[key(
    "its_log",
    Kind::Text,
    "the stream of the record; by default the enclosing workplan's",
)];
/// Of every function with a single value.
const SINGLE: &[Key] = &[
    key(
        "its_variable",
        Kind::Text,
        "NC variable that gets the value, in the unit of records whatever the program's; without it the value is recorded only",
    ),
    key(
        "its_log",
        Kind::Text,
        "the stream of the record; by default the enclosing workplan's",
    ),
];
/// Of functions that cannot do without a sensor.
const REQUIRED: &[Key] = &[key(
    "required",
    Kind::State,
    "ON: without the sensor the program is refused (T-05)",
)];
const DIRECTION: &[Key] = &[
    key(
        "with_direction",
        Kind::State,
        "record the direction of the commanded path with it",
    ),
    REQUIRED[0],
];
const POINTS: &[Key] = &[
    key("its_points", Kind::Reference, "curve or points where to record"),
    key(
        "number_of_points",
        Kind::Integer(1, 2_147_483_647),
        "how many values; spread evenly without its_points",
    ),
    key(
        "tolerance",
        Kind::Number(Dimension::Length),
        "how near a point the tool has to pass; by default 0.05 mm",
    ),
];
const AXIS: &[Key] = &[
    key("its_axis", Kind::Text, "the axis; by default all of them"),
    key("its_axes", Kind::List, "several axes"),
];
const SPINDLE: &[Key] = &[key("its_spindle", Kind::Text, "the spindle; by default S1")];
/// Of motors, which turn spindles too.
const MOTOR: &[Key] = &[
    AXIS[0],
    AXIS[1],
    key("its_spindle", Kind::Text, "the motor of a spindle, as S1"),
    key("its_channel", Kind::Integer(1, 16), "all motors of a channel together"),
];
const FRAME: &[Key] = &[key(
    "frame",
    Kind::Word(&["machine", "work", "tool_tip"]),
    "machine: the gauge point as the axes show it (default); work: the tool's tip in the program's frame; tool_tip: the tip in the machine's frame. All in mm, X of a lathe as a radius",
)];
const ENCODER: &[Key] = &[key(
    "its_encoder",
    Kind::Integer(1, 2),
    "first or second measuring system; by default 1",
)];
const TOLERANCE: &[Key] = &[key(
    "its_tolerance",
    Kind::Number(Dimension::Length),
    "the record says whether the value is within",
)];
const CIRCUIT: &[Key] = &[key("its_circuit", Kind::Text, "flood, through_tool, ...")];
const SENSOR_ID: &[Key] = &[key("its_sensor_id", Kind::Text, "which sensor, where there are several")];
const BAND: &[Key] = &[key("band", Kind::Text, "frequencies, as 100-5000 in Hz")];
const CRITERION: &[Key] = &[key("criterion", Kind::Text, "what the wear is measured by")];

/// A name by which functions that belong together find each other. Case does not matter: controls write in capitals.
#[derive(Clone, Debug, Default)]
pub struct TraceId(pub String);

impl PartialEq for TraceId {
    fn eq(&self, other: &Self) -> bool {
        self.0.eq_ignore_ascii_case(&other.0)
    }
}
impl Eq for TraceId {}
impl PartialOrd for TraceId {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for TraceId {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.to_ascii_lowercase().cmp(&other.0.to_ascii_lowercase())
    }
}
impl fmt::Display for TraceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What a line says to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Call {
    /// The present moment.
    GetTime {
        /// What it is called.
        label: Option<String>,
    },
    /// How long something took.
    GetExecutionTime {
        /// Name or `#entity`; `None` is the last completed workingstep.
        executable: Option<String>,
    },
    /// Record the control's events, or no more.
    LogNcEvents {
        /// Its name.
        id: TraceId,
        /// From here on, or no more.
        on: bool,
        /// Kinds; none is all.
        kinds: Vec<String>,
    },
    /// What the tool table holds.
    LogToolData {
        /// Number of the tool; `None` is the one in the spindle.
        tool: Option<String>,
    },
    /// Record every tool that comes in.
    StartToolLogging {
        /// Its name.
        id: TraceId,
    },
    /// No more.
    StopToolLogging {
        /// As at its start.
        id: TraceId,
    },
    /// Which machine this is.
    LogNcMachineData {
        /// Items; none is the standard set.
        items: Vec<String>,
    },
    /// Which coolant.
    LogCoolantType,
    /// Data of the coolant, as the line declares them.
    LogCoolantData(Coolant),
    /// Raise an alarm.
    SetAlarm(Alarm),
    /// End one.
    ClearAlarm {
        /// Its number.
        id: u16,
    },
    /// Write an event.
    LogEvent {
        /// A word.
        kind: String,
        /// A sentence.
        text: Option<String>,
        /// Variables.
        values: Vec<String>,
    },
    /// A text for the operator.
    DisplayMessage {
        /// What is shown.
        text: String,
    },
    /// Who is signed in.
    GetOperatorData,
    /// Record every sign-in, or no more.
    LogOperatorData {
        /// Its name.
        id: TraceId,
        /// From here on, or no more.
        on: bool,
    },
    /// Who may edit what follows.
    SetEditAccessLevel {
        /// 1 to 10; `None` is the default again.
        level: Option<u8>,
        /// It holds to the end of its workplan only.
        workplan_only: bool,
    },
    /// One sample.
    ReadSensorValue {
        /// Stream or alias.
        sensor: String,
        /// Axes for a name without component.
        axes: Vec<String>,
    },
    /// Record sensors.
    StartSensorRecording(Recording),
    /// No more.
    StopSensorRecording {
        /// As at its start.
        id: TraceId,
    },
    /// `get_<x>`: one value.
    Get(Measurement),
    /// `get_<x>_points`: values along what follows.
    GetPoints(Measurement),
    /// Check a condition.
    StartSynchronizedAction(SynchronizedAction),
    /// No more.
    StopSynchronizedAction {
        /// As at its start.
        id: TraceId,
    },
    /// A function that is in no table: kept and shown.
    Unknown,
}

/// A measurement that a `get_<x>` or `get_<x>_points` asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// What is measured.
    pub measure: &'static Measure,
    /// Axes or spindles; none is all of them.
    pub at: Vec<String>,
    /// With the direction of the commanded path.
    pub with_direction: bool,
    /// Anchor or entity of the points.
    pub points: Option<String>,
    /// How many values.
    pub number_of_points: Option<u32>,
    /// How near a point the tool has to pass; of a displacement: within what it is good.
    pub tolerance: Option<Millimetres>,
    /// Frame of the coordinates.
    pub frame: CoordinateFrame,
    /// Frame, encoder, circuit and what else is said of it.
    pub details: Vec<(&'static str, String)>,
}

impl Measurement {
    /// The streams that it means.
    ///
    /// # Errors
    /// It names an axis for something that has none, or one that its frame has not.
    pub fn streams(&self) -> Result<Vec<Sensor>, NoStream> {
        let mut found = streams(self.measure.name, &self.at)?;
        if self.frame != CoordinateFrame::Machine
            && let Some(other) = found.iter().find(|sensor| sensor.linear_axis().is_none())
        {
            return Err(NoStream {
                message: format!("{} has no coordinate in the frame {}", other.component, self.frame.word()),
                remedy: "name the axes X, Y, Z, or leave frame out".to_owned(),
            });
        }
        // The second measuring system is a sensor of its own.
        if self.details.iter().any(|(key, value)| *key == "its_encoder" && value == "2") {
            found.iter_mut().for_each(|sensor| sensor.quantity.push_str(".2"));
        }
        Ok(found)
    }
}

/// The frame in which coordinates are told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CoordinateFrame {
    /// The gauge point in the machine's frame: what the axes show.
    #[default]
    Machine,
    /// The tip of the tool in the frame of the work: what the program says.
    Work,
    /// The tip of the tool in the machine's frame.
    ToolTip,
}

impl CoordinateFrame {
    /// The word of `frame`.
    pub const fn word(self) -> &'static str {
        match self {
            CoordinateFrame::Machine => "machine",
            CoordinateFrame::Work => "work",
            CoordinateFrame::ToolTip => "tool_tip",
        }
    }

    /// The name of a stream in this frame: `X.POSITION.ACTUAL@WORK`.
    pub fn named(self, sensor: &Sensor) -> String {
        match self {
            CoordinateFrame::Machine => sensor.to_string(),
            other => format!("{sensor}@{}", other.word().to_ascii_uppercase()),
        }
    }
}

/// What was given, for the functions' files.
pub struct Arguments<'a>(pub(crate) &'a [Argument]);

impl Arguments<'_> {
    fn value(&self, key: &str) -> Option<&Value> {
        self.0.iter().find(|a| a.key == key).map(|a| &a.value)
    }
    pub(crate) fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }
    pub(crate) fn text(&self, key: &str) -> Option<String> {
        match self.value(key)? {
            Value::Text(text) | Value::Reference(text) => Some(text.clone()),
            _ => None,
        }
    }
    fn id(&self, key: &str) -> TraceId {
        TraceId(self.text(key).unwrap_or_default())
    }
    fn integer(&self, key: &str) -> Option<i64> {
        match self.value(key)? {
            Value::Integer(number) => Some(*number),
            _ => None,
        }
    }
    fn small(&self, key: &str) -> u16 {
        self.integer(key).and_then(|n| u16::try_from(n).ok()).unwrap_or_default()
    }
    fn number(&self, key: &str) -> Option<f64> {
        match self.value(key)? {
            Value::Number(number, _) => Some(*number),
            _ => None,
        }
    }
    fn state(&self, key: &str) -> bool {
        matches!(self.value(key), Some(Value::State(true)))
    }
    fn word(&self, key: &str) -> Option<&'static str> {
        match self.value(key)? {
            Value::Word(word) => Some(word),
            _ => None,
        }
    }
    fn list(&self, key: &str) -> Vec<String> {
        match self.value(key) {
            Some(Value::List(names)) => names.clone(),
            _ => vec![],
        }
    }
    fn sampling(&self, key: &str) -> Sampling {
        match self.value(key) {
            Some(Value::Sampling(sampling)) => sampling.clone(),
            _ => Sampling::default(),
        }
    }
    fn condition(&self, key: &str) -> Option<Expression> {
        match self.value(key)? {
            Value::Condition(condition) => Some(condition.clone()),
            _ => None,
        }
    }
    fn actions(&self, key: &str) -> Vec<Function> {
        match self.value(key) {
            Some(Value::Actions(actions)) => actions.clone(),
            _ => vec![],
        }
    }
    fn measurement(&self, measure: &'static Measure) -> Measurement {
        let mut at = self.list("its_axes");
        at.extend(self.text("its_axis"));
        at.extend(self.text("its_spindle"));
        // A channel is MTConnect's component Path.
        at.extend(self.integer("its_channel").map(|channel| match channel {
            1 => "PATH".to_owned(),
            other => format!("PATH{other}"),
        }));
        let details = self
            .0
            .iter()
            .filter(|a| ["frame", "its_encoder", "its_circuit", "its_sensor_id", "band", "criterion"].contains(&a.key));
        Measurement {
            measure,
            at,
            with_direction: self.state("with_direction"),
            points: self.text("its_points"),
            number_of_points: self.integer("number_of_points").and_then(|n| u32::try_from(n).ok()),
            tolerance: self.number("tolerance").or(self.number("its_tolerance")).map(Millimetres),
            frame: match self.word("frame") {
                Some("work") => CoordinateFrame::Work,
                Some("tool_tip") => CoordinateFrame::ToolTip,
                _ => CoordinateFrame::Machine,
            },
            details: details.map(|a| (a.key, a.value.to_string())).collect(),
        }
    }
}

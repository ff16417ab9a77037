//! What stands in the log of a run: one kind of event for each thing that is no motion, its data by name.
//!
//! Every event carries `step` (the step it belongs to, 0 is none) and `tick` besides its own data. A step's event stands at the tick at
//! which the machine had done everything before it: what it says is in force for all samples of later steps. Lengths are mm; a frame's
//! `origin` and `rotation` (rows) take the set-up into the machine.
//!
//! | kind | data |
//! |---|---|
//! | `job-started` | `program_sha256`, `seed`, `machine`, `source` (`SIMULATED`, or the driver's name); `taken_up` where it begins elsewhere |
//! | `begin` | `level`, `name`, `entity`, `derived`, `maximum_deviation_mm`; of a workingstep also `workingstep`, its number in the samples |
//! | `end` | `level` |
//! | `frame` | `name`, `origin`, `rotation`, `assumed` |
//! | `tool-offset` | `number`, `geometry`, `wear`, `assumed` |
//! | `tool` | `number`, `name`, `diameter_mm` |
//! | `spindle` | `direction` (`cw`, `ccw`, `stopped`), `speed_rpm` or `surface_mm_s` and `limit_rpm` |
//! | `coolant` | `flood`, `mist`, `through` |
//! | `path-mode` | `mode` (`exact-stop`, `exact-path`, `tolerance`), `tolerance_mm` |
//! | `dwell` | `time_s` |
//! | `message` | `text` |
//! | `stop` | `kind` (`program`, `optional`) |
//! | `register` | `register` (`tool 5 wear X`, `G54 X`, `#501`), `before`, `after`: written by the program, null is vacant; `file`, `line` of it |
//! | `nc-function` | `kind`, `name`, `text`, `properties` |
//! | `question` | `question`, `answer` |
//! | `alarm` | `number`, `code`, `text` |
//! | `hold`, `cycle-start`, `homing` | |
//! | `override` | `feed_percent`, `rapid_percent`, `spindle_percent` |
//! | `controlled-stop`, `stopped` | `cause`, `axis`: begins, and has come to rest |
//! | `emergency-stop`, `emergency-stop-released` | |
//! | `fault` | `cause`, `axis` |
//! | `late` | `lost_ticks` |
//! | `starved`, `following-warning`, `in-position-timeout`, `encoder-bridged`, `spindle-limited`, `off-path-stop`, `record-gap` | `count` since the last such event |
//! | `job-ended` | `ended`, `text`, `commands`, `completed`, `discarded` |

use machine::{FaultCause, StopCause};
use plan::{Alarm, Answer, Level, PathMode, Question, SpindleMode, SpindleState, Step, StepKind, StopKind};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use units::{Machine, Setup, Transform, Vector};

/// An event's own data by name.
pub type Detail = BTreeMap<String, Value>;

/// Kind and data of a step's event; `None` for motion.
pub fn of_step(step: &Step) -> Option<(&'static str, Detail)> {
    let (kind, data) = match &step.kind {
        StepKind::Move(_) | StepKind::MachineMove(_) => return None,
        StepKind::Dwell(time) => ("dwell", json!({ "time_s": time.0 })),
        StepKind::Tool(tool) => (
            "tool",
            json!({ "number": tool.number.0, "name": tool.name, "diameter_mm": tool.diameter.map(|d| d.0) }),
        ),
        StepKind::ToolOffset(offset) => (
            "tool-offset",
            json!({
                "number": offset.number,
                "geometry": offset.geometry.xyz,
                "wear": offset.wear.xyz,
                "assumed": offset.assumed,
            }),
        ),
        StepKind::Spindle(spindle) => ("spindle", of_spindle(spindle)),
        StepKind::Coolant(c) => ("coolant", json!({ "flood": c.flood, "mist": c.mist, "through": c.through })),
        StepKind::Frame(frame) => (
            "frame",
            json!({
                "name": frame.name,
                "origin": frame.machine_from_setup.origin,
                "rotation": frame.machine_from_setup.rotation,
                "assumed": frame.assumed,
            }),
        ),
        StepKind::PathMode(mode) => (
            "path-mode",
            match mode {
                PathMode::ExactStop => json!({ "mode": "exact-stop" }),
                PathMode::ExactPath => json!({ "mode": "exact-path" }),
                PathMode::Tolerance(t) => json!({ "mode": "tolerance", "tolerance_mm": t.map(|t| t.0) }),
            },
        ),
        StepKind::Begin(marker) => (
            "begin",
            json!({
                "level": level_word(marker.level),
                "name": marker.name,
                "entity": marker.entity,
                "derived": marker.derived,
                "maximum_deviation_mm": marker.maximum_deviation.map(|d| d.0),
            }),
        ),
        StepKind::End(level) => ("end", json!({ "level": level_word(*level) })),
        StepKind::Message(text) => ("message", json!({ "text": text })),
        StepKind::Stop(kind) => (
            "stop",
            json!({ "kind": match kind { StopKind::Program => "program", StopKind::Optional => "optional" } }),
        ),
        StepKind::Register(change) => (
            "register",
            json!({ "register": change.register.name(), "before": change.before, "after": change.after }),
        ),
        StepKind::NcFunction(function) => (
            "nc-function",
            json!({
                "kind": function.kind,
                "name": function.name,
                "text": function.text,
                "properties": function.properties,
            }),
        ),
    };
    Some((kind, detail(data)))
}

/// The word for a level of structure.
pub fn level_word(level: Level) -> &'static str {
    match level {
        Level::Program => "program",
        Level::Workplan => "workplan",
        Level::Workingstep => "workingstep",
        Level::Operation => "operation",
        Level::Toolpath => "toolpath",
    }
}

/// Reads a frame back from a `frame` event's data; `None` when it is not there or not a frame.
pub fn frame_of(detail: &Detail) -> Option<Transform<Machine, Setup>> {
    let mut read = Transform::shift(numbers(detail.get("origin")?)?);
    let rows = detail.get("rotation")?.as_array()?;
    for (row, value) in read.rotation.iter_mut().zip(rows) {
        *row = numbers(value)?;
    }
    (rows.len() == 3).then_some(read)
}

/// Reads geometry and wear back from a `tool-offset` event's data; `None` when they are not there.
pub fn tool_offset_of(detail: &Detail) -> Option<(Vector<Machine>, Vector<Machine>)> {
    let read = |name: &str| Some(Vector::from_xyz(numbers(detail.get(name)?)?));
    Some((read("geometry")?, read("wear")?))
}

fn numbers(value: &Value) -> Option<[f64; 3]> {
    let list = value.as_array()?;
    match list.as_slice() {
        [x, y, z] => Some([x.as_f64()?, y.as_f64()?, z.as_f64()?]),
        _ => None,
    }
}

fn of_spindle(spindle: &SpindleState) -> Value {
    let (direction, mode) = match spindle {
        SpindleState::Stopped => return json!({ "direction": "stopped" }),
        SpindleState::Oriented => return json!({ "direction": "stopped", "oriented": true }),
        SpindleState::Clockwise(mode) => ("cw", mode),
        SpindleState::Counterclockwise(mode) => ("ccw", mode),
    };
    match mode {
        SpindleMode::Revolutions(n) => json!({ "direction": direction, "speed_rpm": n.0 }),
        SpindleMode::Surface { speed, limit } => {
            json!({ "direction": direction, "surface_mm_s": speed.0, "limit_rpm": limit.0 })
        }
    }
}

/// Data of a `question` event.
pub(crate) fn of_question(question: &Question, answer: Answer) -> Detail {
    let asked = match question {
        Question::OptionalStop => json!("optional stop"),
        Question::Condition(condition) => json!(format!("{condition:?}")),
        Question::Number(name) => json!(name),
        Question::Skip { to, .. } => json!({ "skip_on_the_way_to": to.xyz }),
    };
    let answered = match answer {
        Answer::Number(value) => json!(value),
        Answer::Truth(truth) => json!(truth),
        Answer::Place(place) => json!(place.map(|p| p.xyz)),
        Answer::Unknown => json!("unknown"),
        Answer::NotAsked => json!("not asked"),
    };
    detail(json!({ "question": asked, "answer": answered }))
}

/// Data of an `alarm` event.
pub(crate) fn of_alarm(alarm: &Alarm) -> Detail {
    detail(json!({ "number": alarm.number, "code": alarm.diagnostic.code, "text": alarm.to_string() }))
}

/// Data of a `controlled-stop` or `stopped` event.
pub(crate) fn of_stop(cause: StopCause) -> Detail {
    let axis = match cause {
        StopCause::SoftLimit { axis } | StopCause::Jump { axis } => Some(axis),
        _ => None,
    };
    detail(json!({ "cause": cause.to_string(), "axis": axis.map(axis_word) }))
}

/// Data of a `fault` event.
pub(crate) fn of_fault(cause: FaultCause) -> Detail {
    let axis = match cause {
        FaultCause::FollowingError { axis } | FaultCause::Encoder { axis } | FaultCause::Homing { axis } => Some(axis),
        _ => None,
    };
    detail(json!({ "cause": cause.to_string(), "axis": axis.map(axis_word) }))
}

/// The letter of an axis.
pub(crate) fn axis_word(axis: u8) -> &'static str {
    ["X", "Y", "Z"].get(usize::from(axis)).copied().unwrap_or("?")
}

/// The members of a JSON object; what is null is left out.
pub(crate) fn detail(data: Value) -> Detail {
    match data {
        Value::Object(members) => members.into_iter().filter(|(_, value)| !value.is_null()).collect(),
        _ => Detail::new(),
    }
}

//! What a machine recorded, as plain data, whatever file it came from.
//!
//! Points are where the machine was; [`InForce`] is what the machine itself said was set there: its frame and tool offset, taken from
//! the job's events. Nothing here is trusted to be in order: the rebuild puts it in order and says what it had to leave out.

use plan::{Diagnostic, FrameChange, ToolOffset};
use serde_json::Value;
use std::collections::BTreeMap;
use units::{StepId, Timestamp, Transform, Vector};

/// One recorded run.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Where the machine was.
    pub points: Vec<RecordPoint>,
    /// The frame of the points.
    pub frame: RecordFrame,
    /// Where it came from; goes into the as-executed file.
    pub source: String,
    /// True when a simulator made it.
    pub simulated: bool,
    /// Stretches in which nothing was recorded.
    pub gaps: Vec<RecordGap>,
    /// What was set on the machine, in order of time; empty when the record does not say.
    pub events: Vec<InForce>,
}

/// One place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordPoint {
    /// When.
    pub at: Timestamp,
    /// X, Y, Z, mm, in the recording's frame.
    pub position: [f64; 3],
    /// The step in execution; [`StepId::NONE`] when the record does not know.
    pub step: StepId,
    /// Order of the points: rises with time. The position in the file will do.
    pub sequence: u64,
}

/// The frame of a recording, as it or its owner states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordFrame {
    /// Gauge-point axis positions from home.
    Machine,
    /// Tool-tip positions in the set-up in force.
    Setup,
    /// Nobody says: frame and offset are fitted to the plan and marked `estimated`.
    Unknown,
}

/// A stretch without points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordGap {
    /// Last thing known before.
    pub from: Timestamp,
    /// First thing known after.
    pub to: Timestamp,
    /// Why, in words: `the agent said UNAVAILABLE`.
    pub cause: String,
}

/// Something that is in force on the machine from a moment on, until the next of its kind.
#[derive(Clone, Debug, PartialEq)]
pub struct InForce {
    /// From when.
    pub at: Timestamp,
    /// The step that set it; [`StepId::NONE`] when it was set before the program began.
    pub step: StepId,
    /// What.
    pub setting: Setting,
}

/// What can be in force.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A work offset or set-up.
    Frame(FrameChange),
    /// A tool offset with its geometry and wear.
    ToolOffset(ToolOffset),
}

impl InForce {
    /// Reads an event of a job: kind `frame` with `name`, `origin` [x, y, z], `rotation` (rows) and `assumed`, or kind `tool-offset`
    /// with `number`, `geometry`, `wear` and `assumed`; both with the `step` that set them. `None` for other kinds.
    ///
    /// # Errors
    /// A field is missing or has another shape; the diagnostic names it.
    pub fn from_event(kind: &str, detail: &BTreeMap<String, Value>, at: Timestamp) -> Option<Result<InForce, Diagnostic>> {
        let setting = match kind {
            "frame" => frame(detail).map(Setting::Frame),
            "tool-offset" => tool_offset(detail).map(Setting::ToolOffset),
            _ => return None,
        };
        let step = detail
            .get("step")
            .and_then(Value::as_u64)
            .and_then(|step| u32::try_from(step).ok());
        Some(match setting {
            Ok(setting) => Ok(InForce {
                at,
                step: StepId(step.unwrap_or(0)),
                setting,
            }),
            Err(field) => Err(Diagnostic::warning(
                "bad-event",
                format!("the event `{kind}` has no usable `{field}`: it was left out, and offsets may be taken from the plan"),
            )),
        })
    }
}

fn frame(detail: &BTreeMap<String, Value>) -> Result<FrameChange, &'static str> {
    let mut machine_from_setup = Transform::shift(triple(detail.get("origin")).ok_or("origin")?);
    if let Some(rows) = detail.get("rotation") {
        let rows = rows.as_array().filter(|rows| rows.len() == 3).ok_or("rotation")?;
        for (row, value) in machine_from_setup.rotation.iter_mut().zip(rows) {
            *row = triple(Some(value)).ok_or("rotation")?;
        }
    }
    Ok(FrameChange {
        name: detail.get("name").and_then(Value::as_str).unwrap_or_default().to_owned(),
        machine_from_setup,
        assumed: detail.get("assumed").and_then(Value::as_bool).unwrap_or(false),
    })
}

fn tool_offset(detail: &BTreeMap<String, Value>) -> Result<ToolOffset, &'static str> {
    let number = detail
        .get("number")
        .and_then(Value::as_u64)
        .and_then(|n| u32::try_from(n).ok());
    let wear = match detail.get("wear") {
        None => [0.0; 3],
        some => triple(some).ok_or("wear")?,
    };
    Ok(ToolOffset {
        number: number.ok_or("number")?,
        geometry: Vector::from_xyz(triple(detail.get("geometry")).ok_or("geometry")?),
        wear: Vector::from_xyz(wear),
        assumed: detail.get("assumed").and_then(Value::as_bool).unwrap_or(false),
    })
}

fn triple(value: Option<&Value>) -> Option<[f64; 3]> {
    let values = value?.as_array().filter(|values| values.len() == 3)?;
    let mut triple = [0.0; 3];
    for (to, from) in triple.iter_mut().zip(values) {
        *to = from.as_f64().filter(|c| c.is_finite())?;
    }
    Some(triple)
}

/// A recording in order, ready for the work.
pub(crate) struct Ordered {
    pub(crate) points: Vec<RecordPoint>,
    /// What had to be done to it, in words.
    pub(crate) findings: Vec<String>,
}

/// Coordinates beyond this are no places on a machine, mm: ten kilometres.
const FAR: f64 = 1e7;

impl Recording {
    /// Points by rising sequence and time. Points without a finite place are left out; where time runs backwards, as few points as
    /// possible are left out so that it does not.
    pub(crate) fn ordered(&self) -> Ordered {
        let mut findings = Vec::new();
        let sound = |p: &&RecordPoint| p.position.iter().all(|c| c.is_finite() && c.abs() < FAR);
        let mut points: Vec<RecordPoint> = self.points.iter().filter(sound).copied().collect();
        let unsound = self.points.len() - points.len();
        if unsound > 0 {
            findings.push(format!(
                "{unsound} samples have no place that a machine can be at; they were left out"
            ));
        }
        // Sequence numbers order the points when they tell them apart; otherwise time does.
        let unordered = points.windows(2).filter(|w| w[1].sequence < w[0].sequence).count();
        let mut numbers: Vec<u64> = points.iter().map(|p| p.sequence).collect();
        numbers.sort_unstable();
        if numbers.windows(2).all(|w| w[0] < w[1]) {
            points.sort_by_key(|p| p.sequence);
            if unordered > 0 {
                findings.push(format!(
                    "{unordered} samples were not in the order of their sequence numbers; they were sorted"
                ));
            }
        } else {
            let unordered = points.windows(2).filter(|w| w[1].at < w[0].at).count();
            points.sort_by_key(|p| p.at);
            if unordered > 0 {
                findings.push(format!("{unordered} samples were not in the order of time; they were sorted"));
            }
        }
        let kept = longest_rising(&points);
        if kept.len() < points.len() {
            let dropped = points.len() - kept.len();
            findings.push(format!(
                "{dropped} samples have a time that contradicts the order of the others; they were left out"
            ));
            points = kept.into_iter().map(|k| points[k]).collect();
        }
        Ordered { points, findings }
    }
}

/// Indices of a longest run of points whose times never fall (patience sorting).
fn longest_rising(points: &[RecordPoint]) -> Vec<usize> {
    let mut tails: Vec<usize> = Vec::new();
    let mut before: Vec<usize> = vec![usize::MAX; points.len()];
    for (k, point) in points.iter().enumerate() {
        let at = tails.partition_point(|tail| points[*tail].at <= point.at);
        if at > 0 {
            before[k] = tails[at - 1];
        }
        if at == tails.len() {
            tails.push(k);
        } else {
            tails[at] = k;
        }
    }
    let mut kept = Vec::with_capacity(tails.len());
    let mut next = tails.last().copied().unwrap_or(usize::MAX);
    while next != usize::MAX {
        kept.push(next);
        next = before[next];
    }
    kept.reverse();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn recording(rows: &[(i64, u64)]) -> Recording {
        Recording {
            points: rows
                .iter()
                .map(|(at, sequence)| RecordPoint {
                    at: Timestamp(*at),
                    position: [*at as f64, 0.0, 0.0],
                    step: StepId::NONE,
                    sequence: *sequence,
                })
                .collect(),
            frame: RecordFrame::Setup,
            source: String::new(),
            simulated: false,
            gaps: Vec::new(),
            events: Vec::new(),
        }
    }

    #[track_caller]
    fn check(rows: &[(i64, u64)], times: &[i64], findings: usize) {
        let ordered = recording(rows).ordered();
        assert_eq!(ordered.points.iter().map(|p| p.at.0).collect::<Vec<_>>(), times);
        assert_eq!(ordered.findings.len(), findings, "{:?}", ordered.findings);
    }

    #[test]
    fn sequence_numbers_order_the_points() {
        check(&[(30, 3), (10, 1), (20, 2)], &[10, 20, 30], 1);
    }

    #[test]
    fn equal_sequence_numbers_leave_it_to_time() {
        check(&[(30, 0), (10, 0), (20, 0)], &[10, 20, 30], 1);
    }

    #[test]
    fn one_wild_time_costs_one_sample() {
        check(&[(10, 1), (99_000, 2), (20, 3), (30, 4)], &[10, 20, 30], 1);
    }

    #[test]
    fn events_give_frames_and_offsets_and_a_missing_field_is_named() {
        let detail = |value: Value| -> BTreeMap<String, Value> { serde_json::from_value(value).expect("an object") };
        let frame =
            detail(json!({"name": "G55", "origin": [1, 2, 3], "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "step": 7}));
        let read = InForce::from_event("frame", &frame, Timestamp(5))
            .expect("a frame")
            .expect("whole");
        assert_eq!(read.step, StepId(7));
        let Setting::Frame(frame) = read.setting else {
            panic!("a frame")
        };
        assert_eq!(frame.machine_from_setup.rotation[0], [0.0, -1.0, 0.0]);
        let offset = detail(json!({"number": 3, "geometry": [0, 0, 120.5], "wear": [0, 0, -0.02], "assumed": true}));
        let read = InForce::from_event("tool-offset", &offset, Timestamp(5))
            .expect("an offset")
            .expect("whole");
        let Setting::ToolOffset(offset) = read.setting else {
            panic!("an offset")
        };
        assert_eq!((offset.number, offset.wear.xyz[2], offset.assumed), (3, -0.02, true));
        let broken = detail(json!({"number": 3}));
        let error = InForce::from_event("tool-offset", &broken, Timestamp(5))
            .expect("an offset")
            .expect_err("broken");
        assert!(error.message.contains("geometry"), "{error}");
        assert!(InForce::from_event("job-started", &broken, Timestamp(5)).is_none());
    }
}

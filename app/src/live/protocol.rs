//! What a CAM add-in says and hears, one JSON object a line. `docs/live-job.md` is the same for its author.

use serde::{Deserialize, Serialize};

/// What an add-in says.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Said {
    /// Who it is and what it makes: the first line.
    Connect(Connect),
    /// The machine may begin: from here on it cuts what is there while more comes.
    Start {},
    /// One operation.
    Operation(Box<Operation>),
    /// Stop on the path; `resume` goes on.
    Hold {},
    /// Go on after a hold.
    Resume {},
    /// Stop on the path for good.
    Stop {},
    /// There are no more operations.
    End {},
}

/// Who an add-in is, and what all its operations have in common.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Connect {
    /// Name and release of the add-in, for the log.
    pub client: String,
    /// Name of the job.
    pub job: String,
    /// The work offset that all points are written in.
    #[serde(default = "first_offset")]
    pub work_offset: String,
}

fn first_offset() -> String {
    "G54".to_owned()
}

/// One operation: a tool, how it turns, and where it goes. Lengths are mm, points are of the tool's tip in the work offset.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operation {
    /// Its name: the workingstep's.
    pub name: String,
    /// With what.
    pub tool: Tool,
    /// How it turns; without it the spindle stands, and nothing is cut.
    pub spindle: Option<Spindle>,
    /// Feed moves with a standing spindle are meant: to scribe, to touch.
    #[serde(default)]
    pub standing_spindle: bool,
    /// Which outlets are open; all are closed when nothing is said.
    #[serde(default)]
    pub coolant: Coolant,
    /// How far corners may be rounded; the machine's own tolerance when nothing is said.
    pub tolerance_mm: Option<f64>,
    /// Where it goes.
    pub moves: Vec<Go>,
}

/// A tool.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tool {
    /// By which the magazine knows it.
    pub number: u32,
    /// Words for people.
    #[serde(default)]
    pub name: String,
    /// Cutting diameter.
    pub diameter_mm: Option<f64>,
    /// From tip to gauge point. The machine's own where it knows the tool; the two have to agree.
    pub length_mm: Option<f64>,
}

/// How the spindle turns.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spindle {
    /// Speed.
    pub rpm: f64,
    /// Seen from the spindle towards the workpiece.
    #[serde(default)]
    pub direction: Turn,
}

/// A direction of turning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Turn {
    /// Clockwise.
    #[default]
    Cw,
    /// Counterclockwise.
    Ccw,
}

/// Which outlets are open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Coolant {
    /// Flood.
    pub flood: bool,
    /// Mist.
    pub mist: bool,
    /// Through the spindle.
    pub through: bool,
}

/// One move from where the tip is.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Go {
    /// As fast as the axes can, straight.
    Rapid {
        /// Where to.
        to: [f64; 3],
    },
    /// Straight at a feed.
    Line {
        /// Where to.
        to: [f64; 3],
        /// How fast.
        feed_mm_min: f64,
    },
    /// A part of a circle, or a helix.
    Arc {
        /// Where to; where the tip is already is a whole turn.
        to: [f64; 3],
        /// A point of its axis.
        centre: [f64; 3],
        /// Direction of its axis.
        #[serde(default = "up")]
        normal: [f64; 3],
        /// Seen from the tip of `normal`.
        direction: Turn,
        /// How fast.
        feed_mm_min: f64,
    },
    /// Stand still.
    Dwell {
        /// How long.
        time_s: f64,
    },
}

fn up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// What an add-in hears.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Heard {
    /// The answer to `connect`.
    Connected(Connected),
    /// An operation is part of the job.
    Accepted {
        /// Which, from 1.
        operation: usize,
        /// Its name.
        name: String,
        /// Steps that it is planned in.
        steps: usize,
    },
    /// What was said cannot be done, and changed nothing.
    Refused {
        /// Number of the line, from 1.
        line: u64,
        /// What is wrong, and what to do.
        why: String,
    },
    /// How far the machine is.
    Progress(Progress),
    /// The job is over, and this is the last line.
    Done(Done),
}

/// What the machine is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Connected {
    /// Its name.
    pub machine: String,
    /// True when it is a simulated one.
    pub simulated: bool,
    /// Lowest and highest place of each axis, machine frame; `null` where there is no such axis.
    pub travel_mm: [Option<[f64; 2]>; 3],
    /// Highest speed of each axis.
    pub v_max_mm_s: [Option<f64>; 3],
    /// Highest spindle speed.
    pub spindle_max_rpm: f64,
    /// Origin of the work offset of the job in the machine.
    pub work_offset_mm: [f64; 3],
    /// Where the gauge point stands, machine frame.
    pub position_mm: [f64; 3],
    /// Tools in the magazine and their lengths.
    pub tools: Vec<KnownTool>,
}

/// A tool that the machine knows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KnownTool {
    /// By which it is called.
    pub number: u32,
    /// Words for people.
    pub name: String,
    /// From tip to gauge point, wear included.
    pub length_mm: f64,
    /// Cutting diameter.
    pub diameter_mm: Option<f64>,
}

/// How far the machine is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// What the controller is doing.
    pub state: String,
    /// The operation in execution, from 1; 0 is none.
    pub operation: u32,
    /// Operations that are part of the job.
    pub operations: usize,
    /// Machine time since its beginning.
    pub time_s: f64,
    /// Where the gauge point is by the encoders, machine frame.
    pub position_mm: [f64; 3],
    /// Largest distance of an axis from where it shall be, so far.
    pub worst_following_error_mm: f64,
}

/// How a job ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Done {
    /// One word: `completed`, `stopped` ...
    pub ended: String,
    /// In a sentence.
    pub text: String,
    /// Plan against run: `good`, `out of tolerance` ...
    pub verdict: Option<String>,
    /// Where plan, record, report and as-executed program are, on the machine's computer.
    pub folder: Option<String>,
}

/// Reads a line.
///
/// # Errors
/// What was expected, with the column.
pub fn read(line: &str) -> Result<Said, String> {
    serde_json::from_str(line).map_err(|error| {
        let text = error.to_string();
        // There is one line; its number is known better outside.
        let what = text.split(" at line ").next().unwrap_or(&text);
        format!("column {}: {what}", error.column())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_operation_is_one_line() {
        let line = r#"{"operation":{"name":"face","tool":{"number":1,"length_mm":120.0},"spindle":{"rpm":6000},"coolant":{"flood":true},
            "moves":[{"rapid":{"to":[0,0,5]}},{"line":{"to":[0,0,-1],"feed_mm_min":300}},
            {"arc":{"to":[10,0,-1],"centre":[5,0,-1],"direction":"cw","feed_mm_min":600}},{"dwell":{"time_s":0.5}}]}}"#;
        let Ok(Said::Operation(operation)) = read(line) else {
            panic!("{:?}", read(line));
        };
        assert_eq!(
            (
                operation.moves.len(),
                operation.coolant.flood,
                operation.spindle.map(|s| s.direction)
            ),
            (4, true, Some(Turn::Cw))
        );
        assert_eq!(read(r#"{"start":{}}"#), Ok(Said::Start {}));
    }

    #[track_caller]
    fn check_refused(line: &str, expected: &str) {
        let why = read(line).expect_err(expected);
        assert!(why.contains(expected), "{why}");
    }

    #[test]
    fn what_is_no_line_of_the_language_says_what_was_expected() {
        check_refused("start", "column 1: expected value");
        check_refused(
            r#"{"begin":{}}"#,
            "unknown variant `begin`, expected one of `connect`, `start`",
        );
        check_refused(r#"{"start":{"now":1}}"#, "unknown field `now`");
        check_refused(r#"{"connect":{"client":"a"}}"#, "missing field `job`");
        check_refused(
            r#"{"operation":{"name":"a","tool":{"number":-1},"moves":[]}}"#,
            "expected u32",
        );
        check_refused(
            r#"{"operation":{"name":"a","tool":{"number":1},"moves":[{"line":{"to":[0,0],"feed_mm_min":1}}]}}"#,
            "invalid length 2",
        );
        check_refused(
            r#"{"operation":{"name":"a","tool":{"number":1},"moves":[{"rapid":{"to":[0,0,1e999]}}]}}"#,
            "number out of range",
        );
        check_refused("", "column 0");
    }
}

//! What really happened, as plain data: made by the rebuild, written by STEP-NC, drawn by the report.
//!
//! Points are tool-tip points in the frame of the planned toolpath they twin, offsets taken out, so that plan and run can be laid on
//! top of each other.

use units::{Millimetres, MmPerSec, Point, Seconds, Setup, Timestamp, ToolNumber};

/// One run of one program.
#[derive(Clone, Debug, PartialEq)]
pub struct AsExecuted {
    /// Its name in the file: `run 1`.
    pub name: String,
    /// Where the record came from: the agent's address, or `SIMULATED` with machine and seed.
    pub source: String,
    /// True when a simulator made the record.
    pub simulated: bool,
    /// First sample.
    pub start: Timestamp,
    /// Last sample.
    pub end: Timestamp,
    /// Time spent removing material: feed moves only.
    pub worktime: Seconds,
    /// How it ended, when it did not end well.
    pub exception: Option<String>,
    /// The STEP instance of the main workplan it is a run of; `None` without a plan.
    pub plan: Option<u64>,
    /// Its workingsteps, in the order of execution.
    pub workingsteps: Vec<ExecutedWorkingstep>,
}

/// One workingstep as it was run.
#[derive(Clone, Debug, PartialEq)]
pub struct ExecutedWorkingstep {
    /// The plan's name, or one made for the record.
    pub name: String,
    /// The STEP instance it is a run of.
    pub plan: Option<u64>,
    /// The workplans around it, outer first: name and STEP instance.
    pub within: Vec<(String, Option<u64>)>,
    /// First sample.
    pub start: Timestamp,
    /// Last sample.
    pub end: Timestamp,
    /// Time spent on feed moves.
    pub worktime: Seconds,
    /// The time the plan asks for, when the plan was timed.
    pub planned: Option<Seconds>,
    /// How it ended, when it did not end well.
    pub exception: Option<String>,
    /// The tool in the spindle.
    pub tool: Option<ToolNumber>,
    /// The verdict's number: distance from planned path over the feed moves.
    pub deviation: Option<Deviation>,
    /// Its toolpaths, in order.
    pub toolpaths: Vec<ExecutedToolpath>,
    /// Anything measured about it.
    pub results: Vec<ResultValue>,
}

/// One toolpath as it was run.
#[derive(Clone, Debug, PartialEq)]
pub struct ExecutedToolpath {
    /// The plan's name, or one made for the record.
    pub name: String,
    /// The STEP instance it is a run of.
    pub plan: Option<u64>,
    /// Rapid, feed or dwell.
    pub kind: PathKind,
    /// First sample.
    pub start: Timestamp,
    /// Last sample.
    pub end: Timestamp,
    /// Where the tip was, in order.
    pub points: Vec<ExecutedPoint>,
    /// Mean path speed over the path.
    pub speed: MmPerSec,
    /// Distance from the planned path.
    pub deviation: Option<Deviation>,
}

/// What a toolpath is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PathKind {
    /// Not cutting, as fast as the axes can.
    Rapid,
    /// Cutting, at a feed.
    Feed,
    /// Standing.
    Dwell,
}

impl PathKind {
    /// The word of the JSON contract.
    pub fn word(self) -> &'static str {
        match self {
            PathKind::Rapid => "rapid",
            PathKind::Feed => "feed",
            PathKind::Dwell => "dwell",
        }
    }
}

/// One recorded place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExecutedPoint {
    /// When.
    pub at: Timestamp,
    /// Where.
    pub position: Point<Setup>,
}

/// Distances between run and plan, never negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// The largest.
    pub max: Millimetres,
    /// 95 % of the samples are nearer than this.
    pub p95: Millimetres,
    /// Root of the mean square.
    pub rms: Millimetres,
    /// Number of samples behind the figures.
    pub samples: u64,
}

/// A measured or computed value that belongs to a workingstep.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultValue {
    /// What it is.
    pub name: String,
    /// The number.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// `measured`, `derived`, `estimated` ...
    pub quality: String,
    /// When it was true.
    pub at: Timestamp,
}

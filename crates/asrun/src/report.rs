//! The report as data: the JSON contract of `rebuild` and `compare`, and what a page needs to draw it.
//!
//! Lengths are millimetres, times seconds, speeds millimetres per second. A missing number is `null`: it was not measured.

use serde::Serialize;

/// Deviations, verdicts and findings of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the run: `run 1`.
    pub name: String,
    /// Name of the program; empty without a plan.
    pub program: String,
    /// Where the record came from.
    pub source: String,
    /// True when a simulator made the record.
    pub simulated: bool,
    /// First sample, nanoseconds UTC.
    pub start_ns: i64,
    /// Last sample, nanoseconds UTC.
    pub end_ns: i64,
    /// Samples that were used.
    pub samples: u64,
    /// Samples that lie nowhere on the plan.
    pub unmatched: u64,
    /// Unbroken runs of feed samples.
    pub feed_runs: u64,
    /// Unbroken runs of rapid samples.
    pub rapid_runs: u64,
    /// The word over all workingsteps.
    pub verdict: Verdict,
    /// The strictest tolerance in use.
    pub tolerance_mm: f64,
    /// Where it came from.
    pub tolerance_source: ToleranceSource,
    /// One for each time a workingstep was run, and one for each that was not, in the order of execution.
    pub workingsteps: Vec<WorkingstepReport>,
    /// One for each executed toolpath.
    pub toolpaths: Vec<ToolpathReport>,
    /// How the record was worked on.
    pub settings: Settings,
    /// What a person should know, in sentences with numbers.
    pub findings: Vec<String>,
}

/// How a run, or a workingstep, came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Verdict {
    /// p95 of the feed moves is within the tolerance.
    #[serde(rename = "good")]
    Good,
    /// Nothing was there to judge by: no plan, or no feed sample.
    #[serde(rename = "not judged")]
    NotJudged,
    /// What was run is good, and something of the plan was not run.
    #[serde(rename = "incomplete")]
    Incomplete,
    /// p95 of the feed moves is beyond the tolerance.
    #[serde(rename = "out of tolerance")]
    OutOfTolerance,
}

impl Verdict {
    /// The word of the JSON contract.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Good => "good",
            Verdict::NotJudged => "not judged",
            Verdict::Incomplete => "incomplete",
            Verdict::OutOfTolerance => "out of tolerance",
        }
    }
}

/// Where a tolerance came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ToleranceSource {
    /// The program's path maximum deviation.
    #[serde(rename = "path maximum deviation")]
    Path,
    /// The caller gave it.
    #[serde(rename = "given")]
    Given,
    /// Nobody gave one: 0.05 mm.
    #[serde(rename = "default")]
    Default,
}

/// One workingstep, as run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkingstepReport {
    /// The plan's name, or one made for the record.
    pub name: String,
    /// Its STEP instance in the plan.
    pub id: Option<u64>,
    /// False when the record has nothing of it.
    pub executed: bool,
    /// Lengths over feeds.
    pub time_planned_s: Option<f64>,
    /// From its first to its last sample.
    pub time_real_s: Option<f64>,
    /// Largest distance of a feed sample from its planned path.
    pub dev_max_mm: Option<f64>,
    /// 95 % of the feed samples are nearer.
    pub dev_p95_mm: Option<f64>,
    /// Root of the mean square over the feed samples.
    pub dev_rms_mm: Option<f64>,
    /// Feed samples behind these numbers.
    pub samples: u64,
    /// Tool and wear offsets that were taken out, and the set-up, in words.
    pub offsets: String,
    /// What it is judged by.
    pub tolerance_mm: f64,
    /// Where that came from.
    pub tolerance_source: ToleranceSource,
    /// Its own word.
    pub verdict: Verdict,
    /// The feed sample that is furthest off.
    pub worst: Option<Worst>,
    /// A shift that explains the deviation.
    pub shift: Option<Shift>,
    /// Real over planned feed, the median of steady samples.
    pub feed_ratio: Option<f64>,
    /// What to draw.
    pub plot: Plot,
}

/// Where a workingstep is furthest off.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Worst {
    /// Seconds since the first sample of the record.
    pub time_s: f64,
    /// Tool tip in the set-up.
    pub place: [f64; 3],
    /// Distance from the plan.
    pub dev_mm: f64,
    /// Name of the toolpath.
    pub toolpath: String,
}

/// A rigid shift of run against plan, in the set-up frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shift {
    /// From plan to run.
    pub vector_mm: [f64; 3],
    /// p95 with it.
    pub p95_before_mm: f64,
    /// p95 with it taken out.
    pub p95_after_mm: f64,
}

/// One executed toolpath.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ToolpathReport {
    /// Its STEP instance in the plan.
    pub id: Option<u64>,
    /// The plan's name, or one made for the record.
    pub name: String,
    /// Index into the report's workingsteps.
    pub workingstep: usize,
    /// `rapid`, `feed` or `dwell`.
    pub kind: &'static str,
    /// Samples on it.
    pub samples: u64,
    /// Largest distance from the planned path.
    pub dev_max_mm: Option<f64>,
    /// 95 % of the samples are nearer.
    pub dev_p95_mm: Option<f64>,
    /// Mean speed along it.
    pub speed_mm_s: f64,
}

/// How a record was worked on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// `by step`, `by position and time`, `by speed`, `by id`.
    pub matching: &'static str,
    /// `machine` or `setup`.
    pub frame: &'static str,
    /// `stated` or `estimated`.
    pub frame_quality: &'static str,
    /// What was added to the record's positions to lay them on the plan; only with an estimated frame.
    pub shift_mm: Option<[f64; 3]>,
    /// Median time between samples.
    pub interval_s: f64,
    /// Noise of the positions as seen in the record itself.
    pub noise_mm: f64,
    /// Without a plan: faster than this is rapid.
    pub threshold_mm_s: Option<f64>,
    /// Without a plan: share of the spread of speeds that the two classes explain, 0 to 1; above 0.9 they are clearly apart.
    pub separation: Option<f64>,
}

/// Lines to draw, thinned to what a page can show.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Plot {
    /// The planned path.
    pub plan: Vec<PlotLine>,
    /// The executed path.
    pub executed: Vec<PlotLine>,
    /// Feed samples: seconds since the first sample of the record, distance from plan in mm. The largest of each stretch is kept.
    pub deviation: Vec<[f64; 2]>,
    /// Seconds since the first sample of the record, speed in mm/s.
    pub speed: Vec<[f64; 2]>,
}

/// A polyline.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlotLine {
    /// `rapid`, `feed` or `dwell`.
    pub kind: &'static str,
    /// Tool tip in the set-up, mm.
    pub points: Vec<[f64; 3]>,
}

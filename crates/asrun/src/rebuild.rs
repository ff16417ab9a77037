//! A record becomes the run it was: cut into the plan's toolpaths, measured against them, told in words.

mod in_force;
mod judge;
mod measure;

use crate::align::Spot;
use crate::flat::{Flat, Space};
use crate::labels::{Label, by_position, noise_of};
use crate::planned::{PlanEnd, PlannedProgram};
use crate::recording::{RecordFrame, RecordPoint, Recording};
use crate::report::{Report, Settings, ToleranceSource};
use crate::vec3::{V3, add, distance, quantile};
use in_force::{FrameFit, Offsets};
use plan::executed::{AsExecuted, PathKind};
use units::{Millimetres, MmPerSec2, StepId, Timestamp};

pub(crate) use judge::judge;

/// How a record is rebuilt.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Name of the run in the file: `run 1`.
    pub name: String,
    /// Tolerance where the program gives none; 0.05 mm marked `default` when this is `None` too.
    pub tolerance: Option<Millimetres>,
    /// Acceleration along the path that the machine is about good for. Only weighs how likely a way between two samples is; a factor
    /// of three does no harm.
    pub acceleration: MmPerSec2,
    /// Points in each drawing of the report.
    pub most_plot_points: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            name: "run 1".to_owned(),
            tolerance: None,
            acceleration: MmPerSec2(2000.0),
            most_plot_points: 2000,
        }
    }
}

/// What a rebuild gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Rebuild {
    /// The run, for a STEP-NC file.
    pub executed: AsExecuted,
    /// Its numbers, verdict and findings.
    pub report: Report,
}

/// The tolerance when nobody gives one.
pub const DEFAULT_TOLERANCE: Millimetres = Millimetres(0.05);

/// Rebuilds a run from its record. With a plan the record is cut into the plan's toolpaths and measured against them; without one it is
/// cut into feed and rapid runs by speed.
///
/// Never fails: what cannot be told is told as a finding, and a record without samples gives an empty run that is not judged.
pub fn rebuild(plan: Option<&PlannedProgram>, record: &Recording, options: &Options) -> Rebuild {
    match plan {
        Some(plan) => with_plan(plan, record, options),
        None => crate::speed::without_plan(record, options),
    }
}

/// A sample with all that is known about it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub(crate) at: Timestamp,
    /// Seconds since the first sample.
    pub(crate) time: f64,
    /// Tool tip in the set-up of its toolpath; for samples on no toolpath the place as recorded.
    pub(crate) tip: V3,
    /// The place as recorded, whatever set-up and offsets are in force.
    pub(crate) recorded: V3,
    pub(crate) label: Label,
}

fn with_plan(plan: &PlannedProgram, record: &Recording, options: &Options) -> Rebuild {
    let ordered = record.ordered();
    let mut findings = ordered.findings;
    findings.extend(plan_findings(plan));
    let points = ordered.points;
    let spots = spots_of(&points, [0.0; 3]);
    let noise = noise_of(&spots);
    let by_step = points.iter().any(|p| plan.toolpath_of(p.step).is_some());
    let fitted = FrameFit::of(plan, record.frame, &spots, options, &mut findings);
    let spots = if fitted.shift.is_some() {
        spots_of(&points, fitted.shift.unwrap_or_default())
    } else {
        spots
    };
    let labels = if by_step {
        by_steps(plan, &points)
    } else {
        let mut flat = Flat::new(plan, fitted.space, options.acceleration.0);
        by_position(plan, &mut flat, &spots, noise, options.acceleration.0)
    };
    let offsets = Offsets::new(plan, &record.events, &points, &labels);
    let samples: Vec<Sample> = points
        .iter()
        .zip(&spots)
        .zip(&labels)
        .map(|((point, spot), label)| Sample {
            at: point.at,
            time: spot.time,
            tip: match (label, fitted.space) {
                (Label::On(toolpath), Space::Gauge) => offsets.tip(plan, *toolpath, spot.place),
                _ => spot.place,
            },
            recorded: spot.place,
            label: *label,
        })
        .collect();
    let settings = Settings {
        matching: if by_step { "by step" } else { "by position and time" },
        frame: match fitted.space {
            Space::Tip => "setup",
            Space::Gauge => "machine",
        },
        frame_quality: if record.frame == RecordFrame::Unknown {
            "estimated"
        } else {
            "stated"
        },
        shift_mm: fitted.shift,
        interval_s: interval_of(&spots),
        noise_mm: noise,
        threshold_mm_s: None,
        separation: None,
    };
    findings.extend(stale(&spots, plan, &labels));
    findings.extend(gaps(record, points.first().map(|p| p.at)));
    let context = Context {
        source: &record.source,
        simulated: record.simulated,
        settings,
        findings,
        timed: true,
        offsets: Some(&offsets),
    };
    judge(plan, &samples, context, options)
}

/// What [`judge`] needs to know besides the samples.
pub(crate) struct Context<'a> {
    pub(crate) source: &'a str,
    pub(crate) simulated: bool,
    pub(crate) settings: Settings,
    pub(crate) findings: Vec<String>,
    /// True when each sample was timed where it was taken; in a STEP-NC file only the ends of a toolpath are.
    pub(crate) timed: bool,
    pub(crate) offsets: Option<&'a Offsets>,
}

pub(crate) fn spots_of(points: &[RecordPoint], shift: V3) -> Vec<Spot> {
    let start = points.first().map_or(Timestamp(0), |p| p.at);
    points
        .iter()
        .map(|p| Spot {
            time: p.at.since(start).0,
            place: add(p.position, shift),
        })
        .collect()
}

pub(crate) fn interval_of(spots: &[Spot]) -> f64 {
    let mut intervals: Vec<f64> = spots
        .windows(2)
        .map(|w| w[1].time - w[0].time)
        .filter(|dt| *dt > 0.0)
        .collect();
    quantile(&mut intervals, 0.5)
}

fn plan_findings(plan: &PlannedProgram) -> Option<String> {
    match &plan.ended {
        PlanEnd::Complete => None,
        PlanEnd::Alarm(alarm) => Some(format!("the program alarms and is compared up to there: {alarm}")),
        PlanEnd::TooLong => {
            Some("the program is too long to be compared whole; it is compared up to where it was read".to_owned())
        }
    }
}

/// Labels for a record that knows its steps.
fn by_steps(plan: &PlannedProgram, points: &[RecordPoint]) -> Vec<Label> {
    let last = plan.toolpaths.last().map_or(StepId::NONE, |t| t.steps.1);
    points
        .iter()
        .map(|point| match plan.toolpath_of(point.step) {
            Some(toolpath) => Label::On(toolpath),
            // A tool change, a spindle start, the end: part of the program, and no toolpath.
            None if point.step != StepId::NONE && (point.step <= last || plan.ended == PlanEnd::Complete) => Label::Between,
            None => Label::Nowhere,
        })
        .collect()
}

fn gaps(record: &Recording, start: Option<Timestamp>) -> Option<String> {
    let longest = record.gaps.iter().max_by_key(|g| g.to.0.saturating_sub(g.from.0))?;
    let start = start?;
    Some(format!(
        "the record has {} gap{}; the longest is {:.1} s, {:.1} s after the first sample ({})",
        record.gaps.len(),
        if record.gaps.len() == 1 { "" } else { "s" },
        longest.to.since(longest.from).0,
        longest.from.since(start).0,
        longest.cause
    ))
}

/// Positions that stood still to the last digit inside a feed move and then jumped ahead: the source gave old values.
fn stale(spots: &[Spot], plan: &PlannedProgram, labels: &[Label]) -> Option<String> {
    let mut k = 0;
    let mut found: Option<(usize, f64, f64, f64)> = None;
    while k + 1 < spots.len() {
        let begin = k;
        while k + 1 < spots.len() && spots[k + 1].place == spots[begin].place {
            k += 1;
        }
        let frozen = k - begin;
        if frozen >= 2
            && k + 1 < spots.len()
            && let Label::On(toolpath) = labels[k]
            && labels[k + 1] == labels[k]
            && plan.toolpaths[toolpath].kind == PathKind::Feed
        {
            let feed = plan.segments[plan.toolpaths[toolpath].segments.start].speed.0;
            let jump = distance(spots[k].place, spots[k + 1].place);
            let (last, whole) = (spots[k + 1].time - spots[k].time, spots[k + 1].time - spots[begin].time);
            if jump > 3.0 * feed * last && jump > 0.5 * feed * whole {
                let (count, ..) = found.unwrap_or((0, 0.0, 0.0, 0.0));
                let longest = found.map_or((whole - last, jump, spots[begin].time), |(_, t, j, at)| {
                    if whole - last > t {
                        (whole - last, jump, spots[begin].time)
                    } else {
                        (t, j, at)
                    }
                });
                found = Some((count + 1, longest.0, longest.1, longest.2));
            }
        }
        k += 1;
    }
    let (count, time, jump, at) = found?;
    Some(format!(
        "stale data {count} times: positions stood still for up to {time:.2} s inside a feed move and then jumped {jump:.2} mm ({at:.1} s after the first sample)"
    ))
}

/// Unbroken runs of feed and of rapid; standing in between breaks nothing.
pub(crate) fn runs_of(kinds: impl Iterator<Item = PathKind>) -> (u64, u64) {
    let (mut feed, mut rapid) = (0, 0);
    let mut last = None;
    for kind in kinds.filter(|k| *k != PathKind::Dwell) {
        if last != Some(kind) {
            match kind {
                PathKind::Feed => feed += 1,
                _ => rapid += 1,
            }
            last = Some(kind);
        }
    }
    (feed, rapid)
}

pub(crate) fn tolerance_of(path: Option<Millimetres>, options: &Options) -> (Millimetres, ToleranceSource) {
    match (path, options.tolerance) {
        (Some(tolerance), _) => (tolerance, ToleranceSource::Path),
        (None, Some(tolerance)) => (tolerance, ToleranceSource::Given),
        (None, None) => (DEFAULT_TOLERANCE, ToleranceSource::Default),
    }
}

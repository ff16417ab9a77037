//! A record becomes the run it was: cut into the plan's toolpaths, measured against them, told in words.

use crate::align::Spot;
use crate::curve;
use crate::flat::{Flat, Space};
use crate::labels::{Label, by_position, noise_of, speed};
use crate::planned::{PlanEnd, PlannedProgram};
use crate::plot::{peaks, thin};
use crate::recording::{InForce, RecordFrame, RecordPoint, Recording, Setting};
use crate::report::{
    Plot, PlotLine, Report, Settings, Shift, ToleranceSource, ToolpathReport, Verdict, WorkingstepReport, Worst,
};
use crate::shift::{Foot, fit};
use crate::vec3::{V3, add, distance, length, quantile, sub};
use plan::executed::{AsExecuted, Deviation, ExecutedPoint, ExecutedToolpath, ExecutedWorkingstep, PathKind};
use plan::{Path, ToolOffset};
use units::{Millimetres, MmPerSec, MmPerSec2, Point, Seconds, Setup, StepId, Timestamp};

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

/// The frame of a record, stated or fitted.
struct FrameFit {
    space: Space,
    /// What is added to positions; `None` when the frame was stated.
    shift: Option<V3>,
}

impl FrameFit {
    fn of(plan: &PlannedProgram, frame: RecordFrame, spots: &[Spot], options: &Options, findings: &mut Vec<String>) -> FrameFit {
        match frame {
            RecordFrame::Machine => FrameFit {
                space: Space::Gauge,
                shift: None,
            },
            RecordFrame::Setup => FrameFit {
                space: Space::Tip,
                shift: None,
            },
            RecordFrame::Unknown => {
                let mut best: Option<(f64, FrameFit)> = None;
                for space in [Space::Tip, Space::Gauge] {
                    let flat = Flat::new(plan, space, options.acceleration.0);
                    if let Some((score, shift)) = crate::coarse::fit_shift(&flat, spots)
                        && best.as_ref().is_none_or(|(least, _)| score < least * 0.8 - 1e-3)
                    {
                        best = Some((
                            score,
                            FrameFit {
                                space,
                                shift: Some(shift),
                            },
                        ));
                    }
                }
                let Some((score, fit)) = best else {
                    return FrameFit {
                        space: Space::Tip,
                        shift: Some([0.0; 3]),
                    };
                };
                let [x, y, z] = fit.shift.unwrap_or_default();
                let name = if fit.space == Space::Tip { "set-up" } else { "machine" };
                findings.push(format!(
                    "the record does not state its frame: {name} positions shifted by X {x:+.3} Y {y:+.3} Z {z:+.3} mm lie on the plan best (estimated; 80 % of the samples then lie within {score:.3} mm); a shifted set-up cannot be told from it"
                ));
                fit
            }
        }
    }
}

/// Tool offsets and frames that were in force on the machine, for each toolpath.
pub(crate) struct Offsets {
    tool: Vec<ToolOffset>,
    /// True when the record's own events told it, not the plan.
    told: Vec<bool>,
    frame: Vec<Option<plan::FrameChange>>,
}

impl Offsets {
    fn new(plan: &PlannedProgram, events: &[InForce], points: &[RecordPoint], labels: &[Label]) -> Offsets {
        let n = plan.toolpaths.len();
        let mut began: Vec<Option<Timestamp>> = vec![None; n];
        for (point, label) in points.iter().zip(labels) {
            if let Label::On(toolpath) = label {
                began[*toolpath].get_or_insert(point.at);
            }
        }
        let mut offsets = Offsets {
            tool: Vec::with_capacity(n),
            told: vec![false; n],
            frame: Vec::with_capacity(n),
        };
        let mut sorted: Vec<&InForce> = events.iter().collect();
        sorted.sort_by_key(|e| (e.at, e.step));
        for (toolpath, planned) in plan.toolpaths.iter().enumerate() {
            let in_force = |event: &&&InForce| {
                if event.step != StepId::NONE {
                    event.step <= planned.steps.0
                } else {
                    began[toolpath].is_none_or(|at| event.at <= at)
                }
            };
            let mut tool = None;
            let mut frame = None;
            for event in sorted.iter().filter(in_force) {
                match &event.setting {
                    Setting::Frame(f) => frame = Some(f.clone()),
                    Setting::ToolOffset(o) => tool = Some(*o),
                }
            }
            offsets.told[toolpath] = tool.is_some();
            offsets.tool.push(tool.unwrap_or(planned.tool_offset));
            offsets.frame.push(frame);
        }
        offsets
    }

    /// Tool tip in the plan's own set-up.
    fn tip(&self, plan: &PlannedProgram, toolpath: usize, gauge: V3) -> V3 {
        (plan.machine_from_setup(toolpath).inverse() * (Point::from_xyz(gauge) - self.tool[toolpath].total())).xyz
    }

    /// What was taken out, in words.
    fn words(&self, plan: &PlannedProgram, toolpaths: &[usize]) -> String {
        let mut all: Vec<String> = Vec::new();
        for &toolpath in toolpaths {
            let offset = &self.tool[toolpath];
            let mut words = String::new();
            let frame = plan.frame_name(toolpath);
            if !frame.is_empty() {
                words += frame;
                if plan.toolpaths[toolpath].frame.is_some_and(|f| plan.frames[f].assumed) {
                    words += " (assumed)";
                }
                words += ", ";
            }
            if offset.number == 0 && offset.total().xyz == [0.0; 3] {
                words += "no tool offset";
            } else {
                let axes = |v: V3| {
                    let parts: Vec<String> = ["X", "Y", "Z"]
                        .iter()
                        .zip(v)
                        .filter(|(_, c)| *c != 0.0)
                        .map(|(a, c)| format!("{a} {c:.3}"))
                        .collect();
                    if parts.is_empty() { "0".to_owned() } else { parts.join(" ") }
                };
                words += &format!(
                    "offset {} geometry {} wear {} mm",
                    offset.number,
                    axes(offset.geometry.xyz),
                    axes(offset.wear.xyz)
                );
                if offset.assumed {
                    words += " (assumed)";
                }
            }
            if !self.told[toolpath] {
                words += " (by the plan)";
            }
            if !all.contains(&words) {
                all.push(words);
            }
        }
        all.join("; ")
    }

    /// Where the machine's own frame was another one than the plan's.
    fn frame_findings(&self, plan: &PlannedProgram, toolpaths: &[usize], workingstep: &str, findings: &mut Vec<String>) {
        for &toolpath in toolpaths {
            let Some(real) = &self.frame[toolpath] else { continue };
            let planned = plan.machine_from_setup(toolpath);
            let off = sub(real.machine_from_setup.origin, planned.origin);
            let turned = angle(&real.machine_from_setup.rotation, &planned.rotation);
            let name = if real.name.is_empty() {
                plan.frame_name(toolpath)
            } else {
                &real.name
            };
            let mut parts: Vec<String> = ["X", "Y", "Z"]
                .iter()
                .zip(off)
                .filter(|(_, c)| c.abs() >= 5e-4)
                .map(|(a, c)| format!("{:.3} mm off in {a} ({c:+.3})", c.abs()))
                .collect();
            if turned > 1e-4 {
                parts.push(format!("turned by {:.3} degrees", turned.to_degrees()));
            }
            if !parts.is_empty() {
                let text = format!(
                    "set-up {name} of workingstep '{workingstep}' was {} on the machine",
                    parts.join(" and ")
                );
                if !findings.contains(&text) {
                    findings.push(text);
                }
            }
        }
    }
}

/// Angle between two rotations.
fn angle(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> f64 {
    let trace: f64 = (0..3).map(|r| (0..3).map(|c| a[r][c] * b[r][c]).sum::<f64>()).sum();
    libm::acos(((trace - 1.0) / 2.0).clamp(-1.0, 1.0))
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

/// Numbers over the distances of some samples; `None` for none.
fn deviation(distances: &[f64]) -> Option<Deviation> {
    if distances.is_empty() {
        return None;
    }
    let mut sorted = distances.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    // Nearest rank: the smallest value that at least 95 % do not exceed.
    let rank = (sorted.len() * 95).div_ceil(100).max(1) - 1;
    let squares: f64 = sorted.iter().map(|d| d * d).sum();
    Some(Deviation {
        max: Millimetres(sorted[sorted.len() - 1]),
        p95: Millimetres(sorted[rank]),
        rms: Millimetres((squares / sorted.len() as f64).sqrt()),
        samples: sorted.len() as u64,
    })
}

/// Distance of a tip from the planned path of its toolpath. At an end of it the neighbours count too: in a blended corner the machine is
/// on neither.
fn off_path(plan: &PlannedProgram, flat: &Flat, toolpath: usize, tip: V3) -> Option<Off> {
    let own = foot(plan, flat, toolpath, tip)?;
    let mut least = own.distance;
    if own.at_end {
        let has_length = |t: &usize| !flat.toolpaths[*t].is_empty();
        let neighbours = [
            (0..toolpath).rev().find(has_length),
            (toolpath + 1..plan.toolpaths.len()).find(has_length),
        ];
        for neighbour in neighbours.into_iter().flatten() {
            // The neighbour may be in another set-up: the machine's frame joins them.
            let there = if plan.toolpaths[neighbour].frame == plan.toolpaths[toolpath].frame {
                tip
            } else {
                let machine = plan.machine_from_setup(toolpath) * Point::from_xyz(tip);
                (plan.machine_from_setup(neighbour).inverse() * machine).xyz
            };
            if let Some(other) = foot(plan, flat, neighbour, there) {
                least = least.min(other.distance);
            }
        }
    }
    Some(Off {
        distance: least,
        segment: own.segment,
        u: own.u,
    })
}

/// How far a sample is from its path, and which move it is on.
#[derive(Clone, Copy)]
struct Off {
    distance: f64,
    /// `None` in a dwell.
    segment: Option<u32>,
    /// Where on that move, 0 to 1.
    u: f64,
}

struct PathFoot {
    distance: f64,
    segment: Option<u32>,
    u: f64,
    place: V3,
    direction: V3,
    /// The nearest place is the toolpath's first or last.
    at_end: bool,
}

fn foot(plan: &PlannedProgram, flat: &Flat, toolpath: usize, tip: V3) -> Option<PathFoot> {
    let range = flat.toolpaths[toolpath].clone();
    if range.is_empty() {
        // A dwell, or moves without a length.
        let place = plan.toolpaths[toolpath].place?.xyz;
        return Some(PathFoot {
            distance: distance(place, tip),
            segment: None,
            u: 0.0,
            place,
            direction: [0.0; 3],
            at_end: true,
        });
    }
    let hit = flat.nearest(tip, range.clone(), f64::MAX.sqrt(), None)?;
    let chord = &flat.chords[hit.chord as usize];
    let path = &plan.segments[chord.segment as usize].path;
    let width = chord.u[1] - chord.u[0];
    let (u, off) = curve::nearest(path, tip, flat.u_at(&hit), chord.u[0] - width, chord.u[1] + width);
    let first = hit.chord as usize == range.start && u <= chord.u[0] + 1e-9;
    let last = hit.chord as usize + 1 == range.end && u >= chord.u[1] - 1e-9;
    Some(PathFoot {
        distance: off,
        segment: Some(chord.segment),
        u,
        place: path.at(u).xyz,
        direction: curve::direction(path, u).unwrap_or_default(),
        at_end: first || last,
    })
}

/// One run of a workingstep: which samples, and which runs of toolpaths.
struct Pass {
    workingstep: usize,
    /// Runs of samples of one toolpath: toolpath and indices of samples.
    runs: Vec<(usize, Vec<usize>)>,
}

/// Cuts samples into passes of workingsteps and runs of toolpaths.
fn passes(plan: &PlannedProgram, samples: &[Sample]) -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    // The toolpath of the sample before, links between workingsteps included.
    let mut last: Option<usize> = None;
    for (k, sample) in samples.iter().enumerate() {
        let Label::On(toolpath) = sample.label else { continue };
        let before = last.replace(toolpath);
        let Some(workingstep) = plan.toolpaths[toolpath].workingstep else {
            continue;
        };
        let again = before.is_some_and(|before| toolpath < before);
        let same = passes.last().is_some_and(|p| p.workingstep == workingstep) && !again;
        if !same {
            passes.push(Pass {
                workingstep,
                runs: Vec::new(),
            });
        }
        let pass = passes.last_mut().expect("just made");
        match pass.runs.last_mut() {
            Some((running, indices)) if *running == toolpath && before == Some(toolpath) => indices.push(k),
            _ => pass.runs.push((toolpath, vec![k])),
        }
    }
    passes
}

/// Time that belongs to some samples: half of the way to each neighbour, nothing across a pause in the record.
fn time_of(samples: &[Sample], indices: impl Iterator<Item = usize>, longest: f64) -> f64 {
    let half = |a: usize, b: usize| {
        let dt = samples[b].time - samples[a].time;
        if dt <= longest { dt / 2.0 } else { 0.0 }
    };
    indices
        .map(|k| (if k > 0 { half(k - 1, k) } else { 0.0 }) + (if k + 1 < samples.len() { half(k, k + 1) } else { 0.0 }))
        .sum()
}

/// Measures labelled samples against the plan and tells what it finds.
pub(crate) fn judge(plan: &PlannedProgram, samples: &[Sample], context: Context<'_>, options: &Options) -> Rebuild {
    let Context {
        source,
        simulated,
        settings,
        mut findings,
        timed,
        offsets,
    } = context;
    let flat = Flat::new(plan, Space::Tip, options.acceleration.0);
    let longest = 20.0 * settings.interval_s.max(1e-3);
    let (start, end) = (
        samples.first().map_or(Timestamp(0), |s| s.at),
        samples.last().map_or(Timestamp(0), |s| s.at),
    );
    let offs: Vec<Option<Off>> = samples
        .iter()
        .map(|sample| {
            sample
                .label
                .toolpath()
                .and_then(|toolpath| off_path(plan, &flat, toolpath, sample.tip))
        })
        .collect();
    let distances: Vec<Option<f64>> = offs.iter().map(|off| off.map(|off| off.distance)).collect();
    let passes = passes(plan, samples);
    let mut executed: Vec<ExecutedWorkingstep> = Vec::new();
    let mut reports: Vec<WorkingstepReport> = Vec::new();
    let mut toolpath_reports: Vec<ToolpathReport> = Vec::new();
    let mut late_findings: Vec<String> = Vec::new();
    for pass in &passes {
        let planned = &plan.workingsteps[pass.workingstep];
        let feed: Vec<usize> = pass
            .runs
            .iter()
            .filter(|(t, _)| plan.toolpaths[*t].kind == PathKind::Feed)
            .flat_map(|(_, indices)| indices.iter().copied())
            .collect();
        let feed_distances: Vec<f64> = feed.iter().filter_map(|k| distances[*k]).collect();
        let deviation_here = deviation(&feed_distances);
        let mut toolpaths = Vec::new();
        for (toolpath, indices) in &pass.runs {
            let run = executed_toolpath(plan, samples, &distances, *toolpath, indices);
            toolpath_reports.push(ToolpathReport {
                id: run.plan,
                name: run.name.clone(),
                workingstep: reports.len(),
                kind: run.kind.word(),
                samples: indices.len() as u64,
                dev_max_mm: run.deviation.map(|d| d.max.0),
                dev_p95_mm: run.deviation.map(|d| d.p95.0),
                speed_mm_s: run.speed.0,
            });
            toolpaths.push(run);
        }
        let first = pass
            .runs
            .first()
            .and_then(|(_, i)| i.first())
            .map_or(start, |k| samples[*k].at);
        let last = pass.runs.last().and_then(|(_, i)| i.last()).map_or(end, |k| samples[*k].at);
        let (tolerance, tolerance_source) = tolerance_of(planned.maximum_deviation, options);
        let verdict = match &deviation_here {
            None => Verdict::NotJudged,
            Some(d) if d.p95 > tolerance => Verdict::OutOfTolerance,
            Some(_) => Verdict::Good,
        };
        let own: Vec<usize> = pass.runs.iter().map(|(t, _)| *t).collect();
        let name = &planned.name;
        if let Some(offsets) = offsets {
            offsets.frame_findings(plan, &own, name, &mut late_findings);
        }
        let shift = shift_of(plan, &flat, samples, &feed, &distances);
        if let Some(shift) = &shift {
            let [x, y, z] = shift.vector_mm;
            late_findings.push(format!(
                "workingstep '{name}': a shift of X {x:+.3} Y {y:+.3} Z {z:+.3} mm in its set-up explains the deviation: p95 {:.3} mm with it, {:.3} mm without",
                shift.p95_before_mm, shift.p95_after_mm
            ));
        }
        let worst = feed
            .iter()
            .filter_map(|k| distances[*k].map(|d| (*k, d)))
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .map(|(k, d)| Worst {
                time_s: samples[k].time,
                place: samples[k].tip,
                dev_mm: d,
                toolpath: samples[k]
                    .label
                    .toolpath()
                    .map_or(String::new(), |t| plan.toolpaths[t].name.clone()),
            });
        if let (Some(worst), Verdict::OutOfTolerance, Some(d)) = (&worst, verdict, &deviation_here) {
            let [x, y, z] = worst.place;
            late_findings.push(format!(
                "workingstep '{name}' is out of tolerance: p95 {:.3} mm against {:.3} mm; worst {:.3} mm on '{}' at X {x:.3} Y {y:.3} Z {z:.3}, {:.1} s after the first sample",
                d.p95.0, tolerance.0, worst.dev_mm, worst.toolpath, worst.time_s
            ));
        }
        let feed_ratio = timed
            .then(|| feed_ratio(plan, samples, &offs, pass, &settings, options.acceleration.0))
            .flatten();
        if let Some(ratio) = feed_ratio.filter(|r| r.lowest > 1.05 || r.highest < 0.95) {
            late_findings.push(format!(
                "workingstep '{name}' ran at {:.0} % of the planned feed",
                ratio.median * 100.0
            ));
        }
        let worktime = Seconds(time_of(samples, feed.iter().copied(), longest));
        reports.push(WorkingstepReport {
            name: name.clone(),
            id: planned.entity,
            executed: !feed.is_empty() || !has_feed(plan, pass.workingstep),
            time_planned_s: Some(planned.time.0),
            time_real_s: Some(last.since(first).0),
            dev_max_mm: deviation_here.map(|d| d.max.0),
            dev_p95_mm: deviation_here.map(|d| d.p95.0),
            dev_rms_mm: deviation_here.map(|d| d.rms.0),
            samples: deviation_here.map_or(0, |d| d.samples),
            offsets: offsets.map_or(String::new(), |o| o.words(plan, &own)),
            tolerance_mm: tolerance.0,
            tolerance_source,
            verdict,
            worst,
            shift,
            feed_ratio: feed_ratio.map(|r| r.median),
            plot: plot_of(plan, samples, &distances, pass, options.most_plot_points),
        });
        executed.push(ExecutedWorkingstep {
            name: name.clone(),
            plan: planned.entity,
            within: planned.within.clone(),
            start: first,
            end: last,
            worktime,
            planned: Some(planned.time),
            exception: None,
            tool: planned.tool,
            deviation: deviation_here,
            toolpaths,
            results: Vec::new(),
        });
    }
    findings.append(&mut late_findings);
    let incomplete = coverage(plan, samples, &passes, &settings, &mut findings, &mut executed);
    for (at, planned) in plan.workingsteps.iter().enumerate() {
        if !passes.iter().any(|p| p.workingstep == at) && has_motion(plan, at) {
            let (tolerance, tolerance_source) = tolerance_of(planned.maximum_deviation, options);
            reports.push(not_executed(planned, tolerance, tolerance_source));
        }
    }
    let unmatched = samples.iter().filter(|s| s.label == Label::Nowhere).count() as u64;
    let before = samples.iter().take_while(|s| s.label == Label::Nowhere).count();
    // Every record begins a moment before its program.
    let a_moment = unmatched == before as u64 && unmatched * 1000 <= samples.len() as u64;
    if plan.toolpaths.is_empty() {
        findings.push("the program moves nothing: there is nothing to hold the record against".to_owned());
    } else if unmatched > 0 && !a_moment {
        let share = 100.0 * unmatched as f64 / samples.len().max(1) as f64;
        findings.push(format!(
            "{unmatched} of {} samples ({share:.1} %) lie nowhere on the plan, {before} of them before its first toolpath",
            samples.len()
        ));
        if share > 50.0 && settings.frame_quality == "stated" {
            findings.push(
                "most samples do not lie on the plan: is it the right program, and is the record's frame and unit as stated? Leave the frame open to have it fitted"
                    .to_owned(),
            );
        }
    }
    let judged: Vec<&WorkingstepReport> = reports.iter().filter(|w| w.executed).collect();
    let verdict = if judged.iter().any(|w| w.verdict == Verdict::OutOfTolerance) {
        Verdict::OutOfTolerance
    } else if !judged.iter().any(|w| w.verdict == Verdict::Good) {
        Verdict::NotJudged
    } else if incomplete {
        Verdict::Incomplete
    } else {
        Verdict::Good
    };
    let (tolerance, tolerance_source) = judged
        .iter()
        .filter(|w| w.samples > 0)
        .map(|w| (w.tolerance_mm, w.tolerance_source))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or_else(|| {
            let (t, s) = tolerance_of(None, options);
            (t.0, s)
        });
    let (feed_runs, rapid_runs) = runs_of(
        samples
            .iter()
            .filter_map(|s| s.label.toolpath())
            .map(|t| plan.toolpaths[t].kind),
    );
    let all_feed = samples
        .iter()
        .enumerate()
        .filter(|(_, s)| s.label.toolpath().is_some_and(|t| plan.toolpaths[t].kind == PathKind::Feed))
        .map(|(k, _)| k);
    let worktime = Seconds(time_of(samples, all_feed, longest));
    let report = Report {
        name: options.name.clone(),
        program: plan.name.clone(),
        source: source.to_owned(),
        simulated,
        start_ns: start.0,
        end_ns: end.0,
        samples: samples.len() as u64,
        unmatched,
        feed_runs,
        rapid_runs,
        verdict,
        tolerance_mm: tolerance,
        tolerance_source,
        workingsteps: reports,
        toolpaths: toolpath_reports,
        settings,
        findings,
    };
    let executed = AsExecuted {
        name: options.name.clone(),
        source: source.to_owned(),
        simulated,
        start,
        end,
        worktime,
        exception: incomplete.then(|| "not all of the program was executed".to_owned()),
        plan: plan.main_workplan,
        workingsteps: executed,
    };
    Rebuild { executed, report }
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

fn not_executed(
    planned: &crate::planned::PlannedWorkingstep,
    tolerance: Millimetres,
    tolerance_source: ToleranceSource,
) -> WorkingstepReport {
    WorkingstepReport {
        name: planned.name.clone(),
        id: planned.entity,
        executed: false,
        time_planned_s: Some(planned.time.0),
        time_real_s: None,
        dev_max_mm: None,
        dev_p95_mm: None,
        dev_rms_mm: None,
        samples: 0,
        offsets: String::new(),
        tolerance_mm: tolerance.0,
        tolerance_source,
        verdict: Verdict::NotJudged,
        worst: None,
        shift: None,
        feed_ratio: None,
        plot: Plot::default(),
    }
}

fn has_feed(plan: &PlannedProgram, workingstep: usize) -> bool {
    plan.workingsteps[workingstep]
        .toolpaths
        .iter()
        .any(|t| plan.toolpaths[*t].kind == PathKind::Feed)
}

fn has_motion(plan: &PlannedProgram, workingstep: usize) -> bool {
    plan.workingsteps[workingstep]
        .toolpaths
        .iter()
        .any(|t| !plan.toolpaths[*t].segments.is_empty() && !plan.toolpaths[*t].derived)
}

fn executed_toolpath(
    plan: &PlannedProgram,
    samples: &[Sample],
    distances: &[Option<f64>],
    toolpath: usize,
    indices: &[usize],
) -> ExecutedToolpath {
    let planned = &plan.toolpaths[toolpath];
    let points: Vec<ExecutedPoint> = indices
        .iter()
        .map(|k| ExecutedPoint {
            at: samples[*k].at,
            position: curve::point(samples[*k].tip),
        })
        .collect();
    let own: Vec<f64> = indices.iter().filter_map(|k| distances[*k]).collect();
    let way: f64 = points.windows(2).map(|w| w[0].position.distance(w[1].position)).sum();
    let (start, end) = (samples[indices[0]].at, samples[indices[indices.len() - 1]].at);
    let time = end.since(start).0;
    ExecutedToolpath {
        name: planned.name.clone(),
        plan: planned.entity,
        kind: planned.kind,
        start,
        end,
        points,
        speed: MmPerSec(if time > 0.0 { way / time } else { 0.0 }),
        deviation: deviation(&own),
    }
}

/// Real over planned feed, and the range that the median lies in with about 95 % certainty.
#[derive(Clone, Copy)]
struct FeedRatio {
    median: f64,
    lowest: f64,
    highest: f64,
}

/// Real over planned feed: the median over pairs of samples on the same move, far enough apart that their noise does not matter. Near the
/// ends of a move the machine speeds up, slows down and stands; pairs there say nothing about the feed.
fn feed_ratio(
    plan: &PlannedProgram,
    samples: &[Sample],
    offs: &[Option<Off>],
    pass: &Pass,
    settings: &Settings,
    acceleration: f64,
) -> Option<FeedRatio> {
    let mut ratios = Vec::new();
    for (toolpath, indices) in &pass.runs {
        let planned = &plan.toolpaths[*toolpath];
        if planned.kind != PathKind::Feed {
            continue;
        }
        let slowest = plan.segments[planned.segments.clone()]
            .iter()
            .map(|s| s.speed.0)
            .fold(f64::INFINITY, f64::min);
        let step = (slowest * settings.interval_s).max(1e-9);
        let apart = ((30.0 * settings.noise_mm / step).ceil() as usize).clamp(1, 100);
        for (k, &first) in indices.iter().enumerate() {
            let Some(&second) = indices.get(k + apart) else { break };
            let (Some(from), Some(to)) = (offs[first], offs[second]) else {
                continue;
            };
            let Some(segment) = from.segment.filter(|s| Some(*s) == to.segment && second == first + apart) else {
                continue;
            };
            let (a, b) = (&samples[first], &samples[second]);
            let move_ = &plan.segments[segment as usize];
            let (path, feed) = (&move_.path, move_.speed.0);
            let ramp = feed * feed / acceleration + 3.0 * settings.noise_mm;
            let steady = |tip: V3| distance(tip, path.start().xyz) > ramp && distance(tip, path.end().xyz) > ramp;
            let dt = b.time - a.time;
            // Down a hole and up again is one line: only what goes ahead on it is this move for certain.
            let slack = 3.0 * settings.noise_mm / path.length().max(1e-9);
            let no_turn = |w: &[usize]| matches!((offs[w[0]], offs[w[1]]), (Some(p), Some(q)) if q.u >= p.u - slack);
            let ahead = to.u > from.u && indices[k..=k + apart].windows(2).all(no_turn);
            if dt > 0.0 && ahead && steady(a.tip) && steady(b.tip) {
                ratios.push(way(path, from.u, to.u) / dt / feed);
            }
        }
    }
    if ratios.len() < 5 {
        return None;
    }
    let median = quantile(&mut ratios, 0.5);
    ratios.sort_unstable_by(f64::total_cmp);
    // Of n values, about sqrt(n)/2 more or fewer than half lie below the true median; twice that is rarely exceeded.
    let (n, spread) = (ratios.len(), (ratios.len() as f64).sqrt());
    let rank = |r: f64| r.clamp(0.0, (n - 1) as f64) as usize;
    Some(FeedRatio {
        median,
        lowest: ratios[rank((n as f64 / 2.0 - spread).floor())],
        highest: ratios[rank((n as f64 / 2.0 + spread).ceil())],
    })
}

/// Length of a path between two places of it: round a circle, not across.
fn way(path: &Path<Setup>, from: f64, to: f64) -> f64 {
    match path {
        Path::Line { .. } | Path::Arc(_) => (to - from).abs() * path.length(),
        Path::Spline(_) => {
            let places: Vec<V3> = (0..=16)
                .map(|k| path.at(from + (to - from) * f64::from(k) / 16.0).xyz)
                .collect();
            places.windows(2).map(|w| distance(w[0], w[1])).sum()
        }
    }
}

/// Looks for a shift that explains the deviation of a workingstep's feed samples.
fn shift_of(plan: &PlannedProgram, flat: &Flat, samples: &[Sample], feed: &[usize], distances: &[Option<f64>]) -> Option<Shift> {
    const MOST: usize = 3000;
    if feed.len() < 8 {
        return None;
    }
    let stride = feed.len().div_ceil(MOST);
    let chosen: Vec<usize> = feed
        .iter()
        .copied()
        .step_by(stride)
        .filter(|k| distances[*k].is_some())
        .collect();
    let before = deviation(&chosen.iter().filter_map(|k| distances[*k]).collect::<Vec<_>>())?;
    if before.p95.0 < 0.005 {
        return None;
    }
    let tips: Vec<V3> = chosen.iter().map(|k| samples[*k].tip).collect();
    let shift = fit(&tips, [0.0; 3], 12, &mut |k, place| {
        let toolpath = samples[chosen[k]].label.toolpath()?;
        let foot = foot(plan, flat, toolpath, place)?;
        // At an end of the path the nearest place says nothing: another sample may lie beyond it.
        (!foot.at_end).then_some(Foot {
            place: foot.place,
            direction: foot.direction,
        })
    });
    let after: Vec<f64> = chosen
        .iter()
        .zip(&tips)
        .filter_map(|(k, tip)| Some(off_path(plan, flat, samples[*k].label.toolpath()?, sub(*tip, shift))?.distance))
        .collect();
    let after = deviation(&after)?;
    (length(shift) > 0.004 && after.p95.0 < 0.5 * before.p95.0).then_some(Shift {
        vector_mm: shift,
        p95_before_mm: before.p95.0,
        p95_after_mm: after.p95.0,
    })
}

/// Says what of the plan was not executed, or more than once; true when something is missing.
fn coverage(
    plan: &PlannedProgram,
    samples: &[Sample],
    passes: &[Pass],
    settings: &Settings,
    findings: &mut Vec<String>,
    executed: &mut [ExecutedWorkingstep],
) -> bool {
    let mut missing = false;
    let mut seen = vec![false; plan.toolpaths.len()];
    for sample in samples {
        if let Label::On(toolpath) = sample.label {
            seen[toolpath] = true;
        }
    }
    let mut invisible = 0u32;
    for (at, planned) in plan.workingsteps.iter().enumerate() {
        if !has_motion(plan, at) {
            continue;
        }
        let name = &planned.name;
        let own: Vec<usize> = (0..passes.len()).filter(|p| passes[*p].workingstep == at).collect();
        // Rapids alone do no work: the machine may have passed there on its way.
        let worked = planned
            .toolpaths
            .iter()
            .any(|t| seen[*t] && plan.toolpaths[*t].kind == PathKind::Feed);
        if own.is_empty() || (has_feed(plan, at) && !worked) {
            missing = true;
            for p in own {
                executed[p].exception = Some("not executed: no feed move was recorded".to_owned());
            }
            findings.push(format!("workingstep '{name}' was not executed"));
            continue;
        }
        if own.len() > 1 {
            let times = if own.len() == 2 {
                "twice".to_owned()
            } else {
                format!("{} times", own.len())
            };
            findings.push(format!("workingstep '{name}' was begun {times}"));
        }
        let mut lost = Vec::new();
        for &toolpath in &planned.toolpaths {
            let path = &plan.toolpaths[toolpath];
            if seen[toolpath] || path.derived || (path.segments.is_empty() && path.kind != PathKind::Dwell) {
                continue;
            }
            // A path shorter than the time between samples can pass unseen.
            if path.time.0 < 2.5 * settings.interval_s {
                invisible += 1;
            } else if path.kind == PathKind::Feed {
                lost.push(path.name.clone());
            }
        }
        if !lost.is_empty() {
            missing = true;
            let shown = lost.iter().take(5).cloned().collect::<Vec<_>>().join("', '");
            let more = if lost.len() > 5 {
                format!(" and {} more", lost.len() - 5)
            } else {
                String::new()
            };
            let text = format!("workingstep '{name}' has no sample on '{shown}'{more}: not executed, or not recorded");
            for p in own {
                executed[p].exception = Some(text.clone());
            }
            findings.push(text);
        }
    }
    let order: Vec<usize> = passes.iter().map(|p| p.workingstep).collect();
    if let Some(back) = order.windows(2).find(|w| w[1] < w[0]) {
        findings.push(format!(
            "workingstep '{}' was run after '{}', against the order of the plan",
            plan.workingsteps[back[1]].name, plan.workingsteps[back[0]].name
        ));
    }
    if invisible > 0 {
        findings.push(format!(
            "{invisible} toolpaths are shorter than the time between two samples and have none"
        ));
    }
    missing
}

fn plot_of(plan: &PlannedProgram, samples: &[Sample], distances: &[Option<f64>], pass: &Pass, most: usize) -> Plot {
    let planned = plan.workingsteps[pass.workingstep]
        .toolpaths
        .iter()
        .filter(|t| !plan.toolpaths[**t].segments.is_empty())
        .map(|t| {
            let mut points: Vec<V3> = Vec::new();
            for segment in &plan.segments[plan.toolpaths[*t].segments.clone()] {
                segment.path.flatten(0.02, 2000, |_, p| {
                    if points.last() != Some(&p.xyz) {
                        points.push(p.xyz);
                    }
                });
            }
            PlotLine {
                kind: plan.toolpaths[*t].kind.word(),
                points,
            }
        })
        .collect();
    let executed = pass
        .runs
        .iter()
        .map(|(toolpath, indices)| PlotLine {
            kind: plan.toolpaths[*toolpath].kind.word(),
            points: indices.iter().map(|k| samples[*k].tip).collect(),
        })
        .collect();
    let all = || {
        pass.runs
            .iter()
            .flat_map(|(t, indices)| indices.iter().map(move |k| (*t, *k)))
    };
    let off = all()
        .filter(|(t, _)| plan.toolpaths[*t].kind == PathKind::Feed)
        .filter_map(|(_, k)| distances[k].map(|d| [samples[k].time, d]))
        .collect();
    let speeds = all()
        .filter(|(_, k)| *k > 0 && samples[k - 1].label.toolpath().is_some())
        .map(|(_, k)| {
            let spot = |s: &Sample| Spot {
                time: s.time,
                place: s.tip,
            };
            [samples[k].time, speed(&spot(&samples[k - 1]), &spot(&samples[k]))]
        })
        .collect();
    Plot {
        plan: thin(planned, most),
        executed: thin(executed, most),
        deviation: peaks(off, most),
        speed: peaks(speeds, most),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::Arc;
    use units::{Radians, Vector};

    #[test]
    fn between_far_samples_on_an_arc_the_way_is_the_arc_and_not_the_chord() {
        let arc = Path::Arc(Arc {
            from: Point::new(10.0, 0.0, 0.0),
            centre: Point::ORIGIN,
            normal: Vector::Z,
            sweep: Radians(6.0),
            rise: 0.0,
        });
        assert!((way(&arc, 0.0, 0.25) - 15.0).abs() < 1e-9);
    }
}

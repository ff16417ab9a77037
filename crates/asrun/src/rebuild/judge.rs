//! Labelled samples become workingsteps, verdicts and findings.

use super::measure::{Off, Pass, deviation, feed_ratio, off_path, passes, shift_of, time_of};
use super::{Context, Options, Rebuild, Sample, runs_of, tolerance_of};
use crate::align::Spot;
use crate::curve;
use crate::flat::{Flat, Space};
use crate::labels::{Label, speed};
use crate::planned::PlannedProgram;
use crate::plot::{peaks, thin};
use crate::report::{Plot, PlotLine, Report, Settings, ToleranceSource, ToolpathReport, Verdict, WorkingstepReport, Worst};
use crate::vec3::V3;
use plan::executed::{AsExecuted, ExecutedPoint, ExecutedToolpath, ExecutedWorkingstep, PathKind};
use units::{Millimetres, MmPerSec, Seconds, Timestamp};

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
            // A tip jumps where another offset comes into force; the machine does not.
            let spot = |s: &Sample| Spot {
                time: s.time,
                place: s.recorded,
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

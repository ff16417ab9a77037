//! A plan against an as-executed run that is in a file already: the same numbers, findings and verdict as a rebuild gives.

use crate::align::Spot;
use crate::flat::{Flat, Space};
use crate::labels::{Label, by_position, noise_of};
use crate::planned::PlannedProgram;
use crate::rebuild::{Context, Options, Sample, interval_of, judge};
use crate::report::{Report, Settings};
use plan::executed::{AsExecuted, ExecutedToolpath, ExecutedWorkingstep};

/// Holds an executed run against its plan. Its points are tool-tip points in the plan's set-ups, offsets taken out.
///
/// Executed toolpaths that name the planned one they twin are held against that; a run of which none does is matched by position and
/// time.
pub fn compare(plan: &PlannedProgram, executed: &AsExecuted, options: &Options) -> Report {
    let start = executed
        .workingsteps
        .iter()
        .flat_map(|w| &w.toolpaths)
        .flat_map(|t| &t.points)
        .map(|p| p.at)
        .next()
        .unwrap_or(executed.start);
    let mut findings = Vec::new();
    let mut samples: Vec<Sample> = Vec::new();
    let mut unknown = 0u32;
    let mut known = 0u32;
    let mut after = 0;
    for workingstep in &executed.workingsteps {
        for toolpath in &workingstep.toolpaths {
            let twin = twin_of(plan, workingstep, toolpath, after);
            match twin {
                Some(twin) => {
                    known += 1;
                    after = twin;
                }
                None => unknown += 1,
            }
            let label = twin.map_or(Label::Nowhere, Label::On);
            samples.extend(toolpath.points.iter().filter(|p| p.position.is_finite()).map(|p| Sample {
                at: p.at,
                time: p.at.since(start).0,
                tip: p.position.xyz,
                recorded: p.position.xyz,
                label,
            }));
        }
    }
    // Runs share the point at which one ends and the next begins; times may not fall.
    samples.sort_by_key(|s| s.at);
    let spots: Vec<Spot> = samples
        .iter()
        .map(|s| Spot {
            time: s.time,
            place: s.tip,
        })
        .collect();
    let noise = noise_of(&spots);
    let by_id = known > 0;
    if by_id && unknown > 0 {
        findings.push(format!(
            "{unknown} executed toolpaths do not name a planned toolpath that exists; they are not compared"
        ));
    }
    if !by_id && !samples.is_empty() {
        findings.push("the run does not name the planned toolpaths it twins; it was matched by position and time".to_owned());
        let mut flat = Flat::new(plan, Space::Tip, options.acceleration.0);
        let labels = by_position(plan, &mut flat, &spots, noise, options.acceleration.0);
        for (sample, label) in samples.iter_mut().zip(labels) {
            sample.label = label;
        }
    }
    let settings = Settings {
        matching: if by_id { "by id" } else { "by position and time" },
        frame: "setup",
        frame_quality: "stated",
        shift_mm: None,
        interval_s: interval_of(&spots),
        noise_mm: noise,
        threshold_mm_s: None,
        separation: None,
    };
    let options = Options {
        name: executed.name.clone(),
        ..options.clone()
    };
    let context = Context {
        source: &executed.source,
        simulated: executed.simulated,
        settings,
        findings,
        timed: false,
        offsets: None,
    };
    judge(plan, &samples, context, &options).report
}

/// The planned toolpath that an executed one twins: by STEP instance, the first at or after the one before (a loop runs the same
/// toolpath again); without an instance, by kind and name inside the workingstep's twin.
fn twin_of(plan: &PlannedProgram, workingstep: &ExecutedWorkingstep, toolpath: &ExecutedToolpath, after: usize) -> Option<usize> {
    let fits = |k: &usize| {
        let planned = &plan.toolpaths[*k];
        match toolpath.plan {
            Some(id) => planned.entity == Some(id) && planned.kind == toolpath.kind,
            None => {
                let around = planned.workingstep.map(|w| &plan.workingsteps[w]);
                planned.kind == toolpath.kind
                    && planned.name == toolpath.name
                    && around.is_some_and(|w| match workingstep.plan {
                        Some(id) => w.entity == Some(id),
                        None => w.name == workingstep.name,
                    })
            }
        }
    };
    (after..plan.toolpaths.len())
        .find(fits)
        .or_else(|| (0..after.min(plan.toolpaths.len())).find(fits))
}

//! How long it takes to rebuild an hour sampled every 100 ms: `cargo run --release -p asrun --example hour`.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "this measures time")]

#[path = "../tests/simulator/mod.rs"]
mod simulator;

use asrun::{Options, RecordFrame, rebuild};
use simulator::{Dice, Sampling, Script, part, run, sample};
use std::time::Instant;

fn main() {
    // Parts one after the other until the run lasts an hour.
    let mut script = Script::default();
    let mut seed = 0;
    let mut minutes = 0.0;
    while minutes < 60.0 {
        let one = part(&mut Dice(seed));
        minutes += run(&one, 1.0).len() as f64 / 60_000.0;
        for step in one.steps {
            script.push(step.kind);
        }
        seed += 1;
    }
    let truth = run(&script, 1.0);
    for (frame, with_steps, name) in [
        (RecordFrame::Machine, false, "matched by position and time"),
        (RecordFrame::Machine, true, "cut by step"),
        (RecordFrame::Unknown, false, "frame unknown, fitted"),
    ] {
        let sampling = Sampling {
            milliseconds: 100.0,
            jitter: 0.3,
            noise: 0.002,
            frame,
            with_steps,
        };
        let (record, _) = sample(&truth, &sampling, &mut Dice(1));
        let begin = Instant::now();
        let plan = script.plan();
        let planned = begin.elapsed();
        let begin = Instant::now();
        let result = rebuild(Some(&plan), &record, &Options::default());
        println!(
            "{name}: {} samples over {:.0} min, {} toolpaths: {:.3} s, and {:.3} s to read the plan; verdict {}, {} unmatched",
            result.report.samples,
            truth.len() as f64 / 60_000.0,
            plan.toolpaths.len(),
            begin.elapsed().as_secs_f64(),
            planned.as_secs_f64(),
            result.report.verdict.word(),
            result.report.unmatched
        );
        if with_steps {
            let begin = Instant::now();
            let result = rebuild(None, &record, &Options::default());
            println!("{}", result.report.findings[0]);
            println!(
                "without a plan: {} feed and {} rapid runs: {:.3} s",
                result.report.feed_runs,
                result.report.rapid_runs,
                begin.elapsed().as_secs_f64()
            );
        }
    }
}

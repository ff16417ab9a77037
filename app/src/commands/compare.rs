//! `toolmark compare`: a run that is in a file already against its plan.

use super::rebuild::planned;
use super::{Done, print_json, tolerance};
use crate::cli::{Common, CompareArgs};
use crate::failure::{Exit, Failure};
use crate::program::Program;
use crate::report;
use asrun::Verdict;

/// Runs the command.
///
/// # Errors
/// A file cannot be read, is not STEP-NC, or holds no run.
pub fn compare(args: &CompareArgs, common: &Common) -> Done {
    let tolerance = tolerance(args.tolerance)?;
    let plan = Program::open(&args.plan, common.dialect.as_deref(), None)?;
    let other = match &args.as_executed {
        Some(path) => Some(Program::open(path, None, None)?),
        None => None,
    };
    let holder = other.as_ref().unwrap_or(&plan);
    let Some(file) = holder.step_nc() else {
        return Err(Failure::unreadable(format_args!(
            "{}: runs are kept in STEP-NC files; this is not one",
            holder.path.display()
        )));
    };
    let runs = stepnc::twin::read(file, plan.step_nc().unwrap_or(file));
    let wanted = args.run.unwrap_or(runs.len());
    let Some(found) = wanted.checked_sub(1).and_then(|k| runs.get(k)) else {
        let name = holder.path.display();
        return Err(match runs.len() {
            0 => Failure::unreadable(format_args!("{name}: it holds no run: no executable has a twin start")),
            1 => Failure::usage(format_args!("--run {wanted}: {name} holds one run")),
            n => Failure::usage(format_args!("--run {wanted}: {name} holds runs 1 to {n}")),
        });
    };
    let options = asrun::Options {
        tolerance,
        ..asrun::Options::default()
    };
    let report = asrun::compare(&planned(&plan, common)?, &found.run, &options);
    if common.json {
        print_json(&report)?;
    } else {
        report::print(&report, common.units.unwrap_or_default());
    }
    let judged = args.tolerance.is_some() && matches!(report.verdict, Verdict::OutOfTolerance | Verdict::Incomplete);
    Ok(if judged { Exit::Negative } else { Exit::Good })
}

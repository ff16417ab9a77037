//! `toolmark run`: check, plan, execute, record, rebuild, report.

use super::check::{print, travels, worst};
use super::{Done, print_json, tolerance};
use crate::cli::{Common, RunArgs};
use crate::cycle_start::{self, Checked};
use crate::execution::{Order, run as execute};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::program::{Program, machine_for, named_machine};
use crate::survey::{State, checks, minutes, survey};
use crate::{clock, functions, report, say, shop};
use asrun::Verdict;
use cell::{Ended, Fault, WorkingstepSelector};
use ledger::Action;
use serde_json::json;
use units::Seconds;

/// Runs the command.
///
/// # Errors
/// The program or machine cannot be read, the check fails, or a file cannot be written.
pub fn run(args: &RunArgs, common: &Common) -> Done {
    let tolerance = tolerance(args.tolerance)?;
    let thinned = args.as_mtconnect.as_deref().map(thinning).transpose()?;
    let shifted = args.plant_shift.as_deref().map(planted_shift).transpose()?;
    let start = clock::start_time(common.start.as_deref())?;
    let mut program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    let machine = machine_for(&common.machine, program.turns())?;
    let mut directory = shop::data_directory(common)?;
    shop::retain(&mut directory, &machine, start)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::Run, &mut directory, start)?;
    let who = acting.name.clone();
    directory.take_over(&machine, &who, start).map_err(shop::failure)?;
    let tables = directory.tables(&machine).map_err(shop::failure)?;
    program.variables = directory.variables(&machine).map_err(shop::failure)?;

    let found = survey(program.stream(&tables)?, &tables, shop::limits(&machine));
    let mut all = checks(&found, travels(&machine), &tables);
    functions::checks(
        &functions::look(&program, &tables)?,
        acting.level.map(ledger::Level::number),
        &mut all,
    );
    if !common.json {
        all.iter().filter(|c| c.state != State::Ok).for_each(print);
    }
    if worst(&all) == State::Fail {
        let why: Vec<String> = all
            .iter()
            .filter(|c| c.state == State::Fail)
            .map(|c| c.text.clone())
            .collect();
        return Err(Failure::negative(format_args!(
            "the check failed, nothing was moved: {}",
            why.join("; ")
        )));
    }
    if let Some((number, _)) = &shifted
        && *number > found.workingsteps
    {
        return Err(Failure::usage(format_args!(
            "--plant-shift {number}: the program has {} workingsteps",
            found.workingsteps
        )));
    }
    let checked = Checked {
        path: &program.path,
        hash: program.hash,
        what: "run",
        asked: args.edited_outside.map(Into::into),
    };
    let edited = cycle_start::check(&checked, &machine, &acting, &mut directory, common, start)?;
    if let Some(sentence) = &edited {
        shop::notice(sentence);
    }
    let faults = shifted.map(planted).into_iter().collect();
    let order = Order {
        program: &program,
        machine: &machine,
        tables,
        seed: common.seed,
        start,
        faults,
        thinned,
        out: args.out.as_deref(),
        tolerance,
        fast: args.fast,
        who: &who,
        level: acting.level.map(ledger::Level::number),
        found: edited.clone(),
    };
    let done = execute(&order, &mut directory, None)?;
    let good = done.outcome.ended == Ended::Completed
        && !matches!(done.rebuild.report.verdict, Verdict::OutOfTolerance | Verdict::Incomplete);
    if common.json {
        print_json(&json!({
            "ended": done.outcome.ended.word(),
            "text": done.outcome.ended.text(),
            "machine_time_s": done.outcome.time.0,
            "rows": done.record.rows,
            "gaps": done.gaps,
            "digest": done.outcome.digest.to_string(),
            "folder": done.folder,
            "checks": all,
            "report": done.rebuild.report,
            "printed": done.printed.lines,
            "functions": done.printed.functions,
            "by": acting.json(),
            "edited_outside": edited,
        }))?;
    } else {
        say(&format!(
            "SIMULATED run of {} on {}: {} in {} of machine time, {} rows recorded",
            program.name,
            machine.name,
            done.outcome.ended.text(),
            minutes(done.outcome.time.0),
            done.record.rows
        ));
        for gap in &done.gaps {
            say(&format!("warning: the record has a gap: {gap}"));
        }
        report::print(&done.rebuild.report, common.units.unwrap_or_default());
        for line in &done.printed.lines {
            say(&format!("  printed: {line}"));
        }
        functions::print(&done.printed.functions);
        let folder = done.folder.display();
        say(&format!(
            "files: {folder}/as-executed.stpnc, report.html, report.json, record.parquet"
        ));
    }
    Ok(if good { Exit::Good } else { Exit::Negative })
}

/// The longest interval and jitter of a recording, ms: no agent is asked less often.
const HOUR_MS: u64 = 3_600_000;

/// `100` or `100,20`: interval and jitter in milliseconds.
fn thinning(text: &str) -> Result<(u64, Seconds), Failure> {
    let (interval, jitter) = text.split_once(',').unwrap_or((text, "0"));
    let interval = interval.trim().parse::<u64>().ok().filter(|ms| (1..=HOUR_MS).contains(ms));
    let jitter = jitter.trim().parse::<f64>().ok();
    let jitter = jitter.filter(|ms| (0.0..=HOUR_MS as f64).contains(ms));
    match (interval, jitter) {
        (Some(interval), Some(jitter)) => Ok((interval, Seconds(jitter / 1000.0))),
        _ => Err(Failure::usage(format_args!(
            "--as-mtconnect {text}: milliseconds were expected, at most an hour of them, like 100 or 100,20"
        ))),
    }
}

/// `4:0.12,0,0`: the n-th workingstep and the shift of its work offset, mm.
fn planted_shift(text: &str) -> Result<(u32, [f64; 3]), Failure> {
    let expected = || Failure::usage(format_args!("--plant-shift {text}: N:X,Y,Z was expected, like 4:0.12,0,0"));
    let (number, shift) = text.split_once(':').ok_or_else(expected)?;
    let number = number.trim().parse().ok().filter(|n| *n > 0).ok_or_else(expected)?;
    let parts: Vec<f64> = shift
        .split(',')
        .map(|p| p.trim().parse())
        .collect::<Result<_, _>>()
        .map_err(|_| expected())?;
    let shift = <[f64; 3]>::try_from(parts).map_err(|_| expected())?;
    // A joke of a shift would leave the machine; the fault is for practice with small ones.
    if shift.iter().any(|s| s.is_nan() || s.abs() > 50.0) {
        return Err(Failure::usage(format_args!("--plant-shift {text}: at most 50 mm")));
    }
    Ok((number, shift))
}

fn planted((number, shift): (u32, [f64; 3])) -> Fault {
    Fault::SetupShift {
        workingstep: WorkingstepSelector::Number(number),
        shift,
    }
}

//! `toolmark check`: everything that can be known before cycle start.

use super::{Done, print_json};
use crate::cli::{Common, ProgramArgs};
use crate::failure::Exit;
use crate::people::Acting;
use crate::program::{Program, machine_for, named_machine};
use crate::survey::{Check, State, checks, survey};
use crate::{cycle_start, functions, say, shop};
use serde_json::json;
use store::MachineFile;
use store::machine_file::EditedOutside;
use units::{Axis, Millimetres};

/// Runs the command.
///
/// # Errors
/// The program or the machine file cannot be read.
pub fn check(args: &ProgramArgs, common: &Common) -> Done {
    let mut program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    let machine = machine_for(&common.machine, program.turns())?;
    let shop::InForce {
        tables,
        variables,
        source,
    } = shop::in_force(common, &machine)?;
    program.variables = variables;
    let mut found = survey(program.stream(&tables)?, &tables, shop::limits(&machine));
    if let Some(step_nc) = program.step_nc() {
        let known: Vec<&str> = found.remarks.iter().map(|remark| remark.code).collect();
        let mut violations = stepnc::problems::violations(step_nc);
        violations.retain(|violation| !known.contains(&violation.code));
        found.remarks.extend(violations);
    }
    let mut all = checks(&found, travels(&machine), &tables);
    let level = match shop::directory_to_look(common)? {
        None => Some(ledger::Level::HIGHEST),
        Some(directory) => Acting::of(&directory, common)?.level,
    };
    let functions = functions::look(&program, &tables)?;
    functions::checks(&functions, level, &mut all);
    if let Some(directory) = shop::directory_to_look(common)?
        && let Some(known) = directory.known_program(&program.path).map_err(shop::failure)?
        && let Some(text) = cycle_start::difference(&program.path, program.hash, &known)
    {
        let refused = machine.edited_outside == EditedOutside::Refuse;
        all.push(Check {
            state: if refused { State::Fail } else { State::Warning },
            name: "program",
            text,
        });
    }
    let worst = worst(&all);
    let (dialect, because) = program.dialect();
    if common.json {
        print_json(&json!({
            "program": program.name,
            "machine": machine.name,
            "dialect": { "name": dialect, "because": because },
            "offsets": source,
            "checks": all,
            "verdict": worst,
            "time_s": found.statistics.time.0,
        }))?;
    } else {
        say(&format!("{} on {} ({dialect}: {because})", program.name, machine.name));
        say(&format!(" {source}"));
        all.iter().for_each(print);
        say(match worst {
            State::Ok => "ready",
            State::Warning => "can be run; look at the warnings first",
            State::Fail => "must not be run like this",
        });
    }
    Ok(if worst == State::Fail { Exit::Negative } else { Exit::Good })
}

/// Travel of each axis.
pub fn travels(machine: &MachineFile) -> [Option<(Millimetres, Millimetres)>; 3] {
    Axis::ALL.map(|a| machine.axis(a).map(|axis| (axis.travel_min, axis.travel_max)))
}

/// The worst state of some checks.
pub fn worst(all: &[Check]) -> State {
    let has = |state| all.iter().any(|c| c.state == state);
    if has(State::Fail) {
        State::Fail
    } else if has(State::Warning) {
        State::Warning
    } else {
        State::Ok
    }
}

/// One line of a check.
pub fn print(check: &Check) {
    let word = match check.state {
        State::Ok => "ok     ",
        State::Warning => "warning",
        State::Fail => "FAIL   ",
    };
    say(&format!(" {word}  {:10} {}", check.name, check.text));
}

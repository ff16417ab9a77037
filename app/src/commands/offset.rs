//! `toolmark offset`: the work offsets of a machine as they are now, and changes of them.

use super::registers::{self, InForce, Setting, axes, cell, diameters, machine_meant};
use super::tool::UndoArgs;
use super::{Done, print_json};
use crate::cli::Common;
use crate::failure::{Exit, Failure};
use crate::say;
use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use store::{MachineFile, Register};
use units::Axis;

/// `toolmark offset ...`
#[derive(Debug, Subcommand)]
pub enum OffsetCommand {
    /// The work offsets and who changed them last. Lengths in --units; --json in mm.
    List,
    /// Set axes of a work offset, in --units, machine frame: home is 0. X of a lathe is a diameter. All of them are set or none.
    #[command(after_help = SET_HELP)]
    Set(SetArgs),
    /// Take a change back, as long as no program ran on the machine since.
    Undo(UndoArgs),
}

const SET_HELP: &str = "\
G54 to G59 and 'G54.1 P1' to 'G54.1 P300' are there on every machine; a set-up of a STEP-NC program by its name takes --new first.
  toolmark offset set G54 --x -412.5 --y -300 --z -480.02 --reason 'vice moved'";

/// `toolmark offset set`
#[derive(Debug, Args)]
pub struct SetArgs {
    /// G54, or the name of a set-up.
    pub name: String,
    /// The machine has no offset of that name yet.
    #[arg(long)]
    pub new: bool,
    /// Where the set-up's X 0 is; a lathe's as a diameter.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub x: Option<String>,
    /// Where its Y 0 is.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub y: Option<String>,
    /// Where its Z 0 is.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub z: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// Wrong usage, no right to it, or the data directory is in use.
pub fn offset(command: &OffsetCommand, common: &Common) -> Done {
    let machine = machine_meant(common)?;
    match command {
        OffsetCommand::List => list(&machine, common),
        OffsetCommand::Set(args) => set(&machine, args, common),
        OffsetCommand::Undo(args) => registers::undo(&machine, args.event, "offset", common),
    }
}

fn set(machine: &MachineFile, args: &SetArgs, common: &Common) -> Done {
    let (values, _) = registers::in_force(common, machine)?;
    let there = names(machine, &values);
    let name = of_the_control(&args.name).unwrap_or_else(|| args.name.trim().to_owned());
    let known = there.contains(&name) || of_the_control(&name).is_some();
    if !known && !args.new {
        let all: Vec<&str> = there.iter().map(String::as_str).collect();
        return Err(Failure::usage(format_args!(
            "{} has no work offset {name:?}; it has {} and those of the control, G54 to G59 and G54.1 P1 to P300. \
             A set-up that is new takes --new",
            machine.name,
            all.join(", ")
        )));
    }
    if name.is_empty() || name.chars().count() > 200 || name.chars().any(char::is_control) {
        return Err(Failure::usage(format_args!("{name:?} cannot be the name of a work offset")));
    }
    let all = [("x", &args.x, Axis::X), ("y", &args.y, Axis::Y), ("z", &args.z, Axis::Z)];
    let given = all.into_iter().filter_map(|(option, text, axis)| {
        Some(Setting {
            register: Register::WorkOffset {
                name: name.clone(),
                axis,
            },
            option,
            text: text.clone()?,
        })
    });
    registers::set(machine, &given.collect::<Vec<_>>(), common)
}

/// A work offset that every control has, as it is called here: `G54`, `G54.1 P3`.
fn of_the_control(name: &str) -> Option<String> {
    let upper = name.trim().to_ascii_uppercase();
    if matches!(upper.as_str(), "G54" | "G55" | "G56" | "G57" | "G58" | "G59") {
        return Some(upper);
    }
    let number = upper.strip_prefix("G54.1")?.trim_start().strip_prefix('P')?;
    let plain = number.bytes().all(|b| b.is_ascii_digit());
    let number: u32 = number.parse().ok().filter(|n| plain && (1..=300).contains(n))?;
    Some(format!("G54.1 P{number}"))
}

fn names(machine: &MachineFile, values: &InForce) -> BTreeSet<String> {
    let set = values.keys().filter_map(|register| match register {
        Register::WorkOffset { name, .. } => Some(name.clone()),
        _ => None,
    });
    machine.work_offsets.keys().cloned().chain(set).collect()
}

fn list(machine: &MachineFile, common: &Common) -> Done {
    let (values, told) = registers::in_force(common, machine)?;
    let axes = axes(machine);
    let of = |name: &str, axis: Axis| {
        let name = name.to_owned();
        values.get(&Register::WorkOffset { name, axis }).copied()
    };
    let events = |name: &str| {
        let all: Vec<u64> = axes.iter().filter_map(|(axis, _)| of(name, *axis)?.1).collect();
        all.into_iter()
    };
    let all = names(machine, &values);
    if common.json {
        let offsets: Vec<Value> = (all.iter())
            .map(|name| {
                let place: Map<String, Value> = (axes.iter())
                    .map(|(axis, letter)| (letter.clone(), of(name, *axis).map_or(0.0, |v| v.0).into()))
                    .collect();
                json!({ "name": name, "offset_mm": place, "changed": told.newest(events(name)) })
            })
            .collect();
        print_json(&json!({
            "machine": machine.name,
            "kind": super::machine::kind_word(machine.kind),
            "unit": "mm",
            "diameters": diameters(machine),
            "offsets": offsets,
        }))?;
        return Ok(Exit::Good);
    }
    say(&format!(
        "work offsets of {}, machine frame, lengths in {}",
        machine.name,
        registers::unit_of(common)
    ));
    let sign = |axis: Axis| if machine.counts_diameters(axis) { " dia" } else { "" };
    let head: String = axes
        .iter()
        .map(|(axis, letter)| format!("{:>12}", format!("{letter}{}", sign(*axis))))
        .collect();
    say(&format!("{:<16}{head}  changed", "name"));
    for name in &all {
        let cells: String = (axes.iter())
            .map(|(axis, _)| format!("{:>12}", cell(Some(of(name, *axis).map_or(0.0, |v| v.0)), common)))
            .collect();
        say(format!("{name:<16}{cells}  {}", told.newest_words(events(name))).trim_end());
    }
    Ok(Exit::Good)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_of_the_control_are_known_however_they_are_written() {
        for (text, name) in [
            ("g54", Some("G54")),
            (" G59 ", Some("G59")),
            ("G54.1P3", Some("G54.1 P3")),
            ("g54.1 p300", Some("G54.1 P300")),
            ("G54.1 P0", None),
            ("G54.1 P301", None),
            ("G54.1 P+3", None),
            ("G60", None),
            ("G45", None),
            ("", None),
        ] {
            assert_eq!(of_the_control(text).as_deref(), name, "{text}");
        }
    }
}

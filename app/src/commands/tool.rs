//! `toolmark tool`: the tools of a machine as they are now, geometry and wear apart, and changes of them.

use super::registers::{self, InForce, Setting, Told, axes, cell, diameters, machine_meant};
use super::{Done, print_json};
use crate::cli::Common;
use crate::failure::{Exit, Failure};
use crate::say;
use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use store::{MachineFile, Register};
use units::{Axis, ToolNumber};

/// `toolmark tool ...`
#[derive(Debug, Subcommand)]
pub enum ToolCommand {
    /// The tools with geometry, wear, diameter, radius, and who changed them last. Lengths in --units; --json in mm.
    List,
    /// Set values of a tool, in --units. X of a lathe is a diameter, as on the control. All of them are set or none.
    #[command(after_help = SET_HELP)]
    Set(Box<SetArgs>),
    /// Take a change back, as long as no program ran on the machine since.
    Undo(UndoArgs),
}

const SET_HELP: &str = "\
Wear takes level 5, or level 3 where it changes by more than 0.5 mm at once; everything else takes level 3.
  toolmark tool set 5 --wear-z -0.02 --reason 'measured 0.02 deep'
  toolmark tool set 12 --new --length 104.55 --diameter 10 --reason 'new holder'";

/// `toolmark tool set`
#[derive(Debug, Args)]
pub struct SetArgs {
    /// Number of the tool.
    #[arg(value_parser = clap::value_parser!(u32).range(1..=9999))]
    pub number: u32,
    /// The machine has no such tool yet.
    #[arg(long)]
    pub new: bool,
    /// From tip to gauge point along X; a lathe's as a diameter.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub geometry_x: Option<String>,
    /// From tip to gauge point along Y.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub geometry_y: Option<String>,
    /// From tip to gauge point along Z: the length of a milling tool.
    #[arg(long, value_name = "LENGTH", visible_alias = "length", allow_hyphen_values = true)]
    pub geometry_z: Option<String>,
    /// Correction along X since it was measured; a lathe's as a diameter.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub wear_x: Option<String>,
    /// Correction along Y.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub wear_y: Option<String>,
    /// Correction along Z.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub wear_z: Option<String>,
    /// Cutting diameter.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub diameter: Option<String>,
    /// Radius of compensation: a mill's D, or the nose radius.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub radius: Option<String>,
    /// Correction of the radius.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    pub radius_wear: Option<String>,
    /// Where the imaginary tip of a turning tool lies, 0 to 9.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    pub tip_direction: Option<String>,
}

/// `toolmark tool undo`
#[derive(Debug, Args)]
pub struct UndoArgs {
    /// Number of the change, as `list` and `set` show it.
    pub event: u64,
}

/// Runs the command.
///
/// # Errors
/// Wrong usage, no right to it, or the data directory is in use.
pub fn tool(command: &ToolCommand, common: &Common) -> Done {
    let machine = machine_meant(common)?;
    match command {
        ToolCommand::List => list(&machine, common),
        ToolCommand::Set(args) => set(&machine, args, common),
        ToolCommand::Undo(args) => registers::undo(&machine, args.event, "tool", common),
    }
}

fn set(machine: &MachineFile, args: &SetArgs, common: &Common) -> Done {
    let tool = ToolNumber(args.number);
    let (values, _) = registers::in_force(common, machine)?;
    let known = machine.tools.contains_key(&tool) || numbers(machine, &values).contains(&tool);
    match (known, args.new) {
        (false, false) => {
            let all: Vec<String> = numbers(machine, &values).iter().map(|n| n.0.to_string()).collect();
            return Err(Failure::usage(format_args!(
                "{} has no tool {}; it has {}. A tool that is new takes --new",
                machine.name,
                tool.0,
                all.join(", ")
            )));
        }
        (true, true) => {
            return Err(Failure::usage(format_args!(
                "{} has tool {} already: leave --new out to change it",
                machine.name, tool.0
            )));
        }
        _ => {}
    }
    let geometry = |axis| Register::ToolGeometry { tool, axis };
    let wear = |axis| Register::ToolWear { tool, axis };
    let all = [
        ("geometry-x", &args.geometry_x, geometry(Axis::X)),
        ("geometry-y", &args.geometry_y, geometry(Axis::Y)),
        ("geometry-z", &args.geometry_z, geometry(Axis::Z)),
        ("wear-x", &args.wear_x, wear(Axis::X)),
        ("wear-y", &args.wear_y, wear(Axis::Y)),
        ("wear-z", &args.wear_z, wear(Axis::Z)),
        ("diameter", &args.diameter, Register::ToolDiameter(tool)),
        ("radius", &args.radius, Register::ToolRadius(tool)),
        ("radius-wear", &args.radius_wear, Register::ToolRadiusWear(tool)),
        ("tip-direction", &args.tip_direction, Register::ToolTipDirection(tool)),
    ];
    let given = all.into_iter().filter_map(|(option, text, register)| {
        Some(Setting {
            register,
            option,
            text: text.clone()?,
        })
    });
    registers::set(machine, &given.collect::<Vec<_>>(), common)
}

/// The tools that a machine has, in the machine file or since.
fn numbers(machine: &MachineFile, values: &InForce) -> BTreeSet<ToolNumber> {
    let in_registers = values.keys().filter_map(tool_of);
    machine.tools.keys().copied().chain(in_registers).collect()
}

fn tool_of(register: &Register) -> Option<ToolNumber> {
    match register {
        Register::ToolGeometry { tool, .. } | Register::ToolWear { tool, .. } => Some(*tool),
        Register::ToolDiameter(tool)
        | Register::ToolRadius(tool)
        | Register::ToolRadiusWear(tool)
        | Register::ToolTipDirection(tool) => Some(*tool),
        Register::WorkOffset { .. } => None,
    }
}

fn list(machine: &MachineFile, common: &Common) -> Done {
    let (values, told) = registers::in_force(common, machine)?;
    let all = numbers(machine, &values);
    if common.json {
        let tools: Vec<Value> = all.iter().map(|tool| tool_json(machine, *tool, &values, &told)).collect();
        print_json(&json!({
            "machine": machine.name,
            "kind": super::machine::kind_word(machine.kind),
            "unit": "mm",
            "diameters": diameters(machine),
            "tools": tools,
        }))?;
        return Ok(Exit::Good);
    }
    let axes = axes(machine);
    let sign = |axis: Axis| if machine.counts_diameters(axis) { " dia" } else { "" };
    let head: Vec<String> = ["geom", "wear"]
        .iter()
        .flat_map(|word| {
            axes.iter()
                .map(move |(axis, letter)| format!("{:>11}", format!("{word} {letter}{}", sign(*axis))))
        })
        .collect();
    say(&format!(
        "tools of {}, lengths in {}",
        machine.name,
        registers::unit_of(common)
    ));
    say(&format!(
        "{:>4} {:<24}{}{:>10}{:>10}{:>10} {:>3}  changed",
        "no",
        "name",
        head.concat(),
        "diameter",
        "radius",
        "rad wear",
        "tip"
    ));
    for tool in &all {
        let of = |register: &Register| values.get(register).map(|v| v.0);
        let name = machine.tools.get(tool).map_or("", |t| t.name.as_str());
        let mut line = format!("{:>4} {:<24}", tool.0, shortened(name));
        for wear in [false, true] {
            for (axis, _) in &axes {
                let register = if wear {
                    Register::ToolWear {
                        tool: *tool,
                        axis: *axis,
                    }
                } else {
                    Register::ToolGeometry {
                        tool: *tool,
                        axis: *axis,
                    }
                };
                line.push_str(&format!("{:>11}", cell(of(&register).or(Some(0.0)), common)));
            }
        }
        let tip = of(&Register::ToolTipDirection(*tool)).map_or_else(String::new, |t| t.to_string());
        line.push_str(&format!(
            "{:>10}{:>10}{:>10} {tip:>3}",
            cell(of(&Register::ToolDiameter(*tool)), common),
            cell(of(&Register::ToolRadius(*tool)), common),
            cell(of(&Register::ToolRadiusWear(*tool)), common),
        ));
        let changed = told.newest_words(events_of(*tool, &values));
        say(format!("{line}  {changed}").trim_end());
    }
    Ok(Exit::Good)
}

fn shortened(name: &str) -> String {
    if name.chars().count() <= 23 {
        name.to_owned()
    } else {
        name.chars().take(22).chain(['…']).collect()
    }
}

fn events_of(tool: ToolNumber, values: &InForce) -> impl Iterator<Item = u64> + '_ {
    let own = values.iter().filter(move |(register, _)| tool_of(register) == Some(tool));
    own.filter_map(|(_, (_, event))| *event)
}

fn tool_json(machine: &MachineFile, tool: ToolNumber, values: &InForce, told: &Told) -> Value {
    let of = |register: Register| values.get(&register).map(|v| v.0);
    let mut geometry = Map::new();
    let mut wear = Map::new();
    for (axis, letter) in axes(machine) {
        geometry.insert(
            letter.clone(),
            of(Register::ToolGeometry { tool, axis }).unwrap_or(0.0).into(),
        );
        wear.insert(letter, of(Register::ToolWear { tool, axis }).unwrap_or(0.0).into());
    }
    json!({
        "number": tool.0,
        "name": machine.tools.get(&tool).map(|t| t.name.as_str()),
        "geometry_mm": geometry,
        "wear_mm": wear,
        "diameter_mm": of(Register::ToolDiameter(tool)),
        "radius_mm": of(Register::ToolRadius(tool)),
        "radius_wear_mm": of(Register::ToolRadiusWear(tool)),
        "tip_direction": of(Register::ToolTipDirection(tool)),
        "changed": told.newest(events_of(tool, values)),
    })
}

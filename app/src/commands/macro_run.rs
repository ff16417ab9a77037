//! `toolmark macro run`: a program interpreted and nothing else; no machine, no planner.

use super::{Done, print_json};
use crate::cli::{Common, MacroRunArgs};
use crate::failure::{Exit, Failure};
use crate::files::{FileSource, FolderResolver};
use crate::program::{Kind, Program};
use crate::say;
use gcode::Setup;
use gcode::interpretation::{AlarmKind, Interpretation, MachineKind, Unit, interpret_file};
use std::path::Path;

/// Moves shown in the text answer; JSON holds all.
const SHOWN_MOVES: usize = 20;

/// Runs the command.
///
/// # Errors
/// The program or the set-up cannot be read.
pub fn macro_run(args: &MacroRunArgs, common: &Common) -> Done {
    let program = Program::open(&args.program, common.dialect.as_deref(), None)?;
    let Kind::Gcode { profile, because } = &program.kind else {
        return Err(Failure::usage(format_args!(
            "{} is no G-code but {}: macro run interprets G-code; give --dialect if it is",
            args.program.display(),
            program.dialect().0
        )));
    };
    let mut setup = match &args.setup {
        Some(file) => read_setup(file)?,
        None => Setup {
            machine: if profile.turning {
                MachineKind::Lathe
            } else {
                MachineKind::Mill
            },
            control: Some(profile.name.to_owned()),
            ..Setup::default()
        },
    };
    setup.most_blocks_at_rest = args.most_blocks.or(setup.most_blocks_at_rest);
    // What the person says on the command line wins over the set-up, and the set-up over what the text looks like.
    let (profile, because) = match (&args.setup, &common.dialect) {
        (Some(file), None) => {
            let named = setup
                .profile()
                .map_err(|found| Failure::unreadable(format_args!("{}: {found}", file.display())))?;
            (named, "the set-up says so")
        }
        _ => (*profile, because.as_str()),
    };
    let source =
        FileSource::open(&args.program).map_err(|e| Failure::unreadable(format_args!("{}: {e}", args.program.display())))?;
    let resolver = Box::new(FolderResolver::beside(&args.program));
    let found = interpret_file(Box::new(source), &program.name, profile, resolver, &setup)
        .map_err(|found| Failure::unreadable(format_args!("{found}")))?;
    if common.json {
        print_json(&found)?;
    } else {
        say(&format!("{} read as {} ({because})", program.name, profile.name));
        tell(&found, profile.turning);
    }
    Ok(if found.alarm.is_some() { Exit::Negative } else { Exit::Good })
}

fn read_setup(file: &Path) -> Result<Setup, Failure> {
    let name = file.display();
    let text = std::fs::read_to_string(file).map_err(|e| Failure::unreadable(format_args!("{name}: {e}")))?;
    let setup: Setup = serde_json::from_str(&text).map_err(|e| {
        let words = e.to_string();
        let what = words.split(" at line ").next().unwrap_or_default();
        let (line, column) = (e.line().max(1), e.column().max(1));
        Failure::unreadable(format_args!("{name}:{line}:{column}: {what}; {SETUP_FORM}"))
    })?;
    setup
        .parameters()
        .map_err(|found| Failure::unreadable(format_args!("{name}: {}; {SETUP_FORM}", found.message)))?;
    Ok(setup)
}

const SETUP_FORM: &str =
    "an object was expected, like {\"machine\":\"lathe\",\"units\":\"inch\",\"params\":{\"6001.5\":1},\"vars\":{\"2005\":0.001}}";

fn tell(found: &Interpretation, turning: bool) {
    for remark in &found.remarks {
        say(&format!(" {remark}"));
    }
    let unit = match found.unit {
        Unit::Mm => "mm",
        Unit::Inch => "inch",
    };
    let letters: &[&str] = if turning { &["X", "Z"] } else { &["X", "Y", "Z"] };
    let axes = |row: &[f64]| -> String {
        let places = letters.iter().zip(&row[1..]);
        places.map(|(letter, value)| format!(" {letter}{value}")).collect()
    };
    say(&format!(" path       {} moves, {unit}", found.path.len()));
    for row in found.path.iter().take(SHOWN_MOVES) {
        say(&format!("            G{}{}", row[0], axes(row)));
    }
    if found.path.len() > SHOWN_MOVES {
        say(&format!(
            "            ... {} more; --json shows all",
            found.path.len() - SHOWN_MOVES
        ));
    }
    for (number, value) in &found.vars {
        let value = value.map_or_else(|| "vacant".to_owned(), |v| v.to_string());
        let name = found.names.get(number).map_or_else(String::new, |n| format!("  {n}"));
        say(&format!(" #{number:<9} {value}{name}"));
    }
    for (number, name) in found.names.iter().filter(|(n, _)| !found.vars.contains_key(n)) {
        say(&format!(" #{number:<9} vacant  {name}"));
    }
    for line in &found.output {
        say(&format!(" printed    {line}"));
    }
    for stop in &found.stops {
        say(&format!(" stop       #3006={} {}", stop.number, stop.message));
    }
    if let Some(tool) = found.tool {
        say(&format!(" tool       T{tool}"));
    }
    let (Some(alarm), Some(fault)) = (&found.alarm, &found.fault) else {
        say(" ended      without an alarm");
        return;
    };
    let number = match (alarm.kind, alarm.number) {
        (AlarmKind::Macro, n) => format!("alarm {} (#3000={n})", 3000 + n),
        (AlarmKind::Program, 0) => "stopped".to_owned(),
        (AlarmKind::Program, n) => format!("alarm PS{n:03}"),
    };
    let mut place = format!("{}:{}:{}", fault.file, fault.line, fault.column);
    if fault.program > 0 {
        place += &format!(", O{:04}", fault.program);
    }
    if fault.block > 0 {
        place += &format!(", N{} or behind it", fault.block);
    }
    say(&format!(" {number}: {} ({place}); {}", fault.text, fault.remedy));
}

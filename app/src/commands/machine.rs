//! `toolmark machine`: the machine file made, and what a machine comes to, value by value with the place that each has it from.

use super::registers::{self, machine_meant};
use super::{Done, print_json};
use crate::cli::Common;
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::{clock, say, shop};
use clap::{Args, Subcommand, ValueEnum};
use ledger::{Action, Hash};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use store::machine_file::BUILT_IN;
use store::machine_told::Told;
use store::{MachineFile, MachineKind, Register, WholeFile};
use units::Axis;

/// `toolmark machine ...`
#[derive(Debug, Subcommand)]
pub enum MachineCommand {
    /// Write a machine file to start from, with comments and the unit in every key. In the data directory it is the machine of every
    /// command that gets no --machine.
    Init(InitArgs),
    /// Every value of a machine and where it comes from: a line of its file, a default, or a change in the data directory.
    Show,
}

/// `toolmark machine init`
#[derive(Debug, Args)]
pub struct InitArgs {
    /// What to begin with.
    #[arg(value_enum, default_value_t = Kind::SimMill)]
    pub kind: Kind,
    /// Its name: in records, and in the paths of its offsets [default: the kind].
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Where to [default: machine.toml of the data directory].
    #[arg(long, value_name = "F.toml")]
    pub out: Option<PathBuf>,
}

/// A machine that is built in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// The simulated mill.
    SimMill,
    /// The simulated lathe.
    SimLathe,
}

/// The name of the machine file in a data directory.
pub const FILE: &str = "machine.toml";

/// `mill` or `lathe`.
pub fn kind_word(kind: MachineKind) -> &'static str {
    match kind {
        MachineKind::Mill => "mill",
        MachineKind::Lathe => "lathe",
    }
}

/// Runs the command.
///
/// # Errors
/// The file is there already or cannot be written, a value of it cannot be, or no right to it.
pub fn machine(command: &MachineCommand, common: &Common) -> Done {
    match command {
        MachineCommand::Init(args) => init(args, common),
        MachineCommand::Show => show(common),
    }
}

/// The machine file of the data directory, when there is one: the machine of whoever gives no `--machine`.
pub fn of_the_data_directory(common: &Common) -> Option<String> {
    let path = shop::data_path(common).ok()?.join(FILE);
    path.is_file().then(|| path.to_str().map(str::to_owned)).flatten()
}

fn init(args: &InitArgs, common: &Common) -> Done {
    let (built_in, text) = BUILT_IN[match args.kind {
        Kind::SimMill => 0,
        Kind::SimLathe => 1,
    }];
    let name = args.name.as_deref().unwrap_or(built_in);
    let text = text_for(built_in, text, name);
    // The name is the one thing that a person gave.
    let machine = MachineFile::parse(&text, FILE).map_err(|e| {
        Failure::usage(format_args!(
            "--name {name:?}: {}",
            shop::failure(e).message.trim_start_matches("error: ")
        ))
    })?;
    let path = match &args.out {
        Some(out) => {
            write_new(out, &text)?;
            out.clone()
        }
        None => {
            let at = clock::start_time(common.start.as_deref())?;
            let mut directory = shop::data_directory(common)?;
            let acting = Acting::of(&directory, common)?;
            acting.must(Action::WriteMachineFile, &mut directory, at)?;
            let path = directory.root().join(FILE);
            write_new(&path, &text)?;
            let mut detail = acting.detail();
            detail.insert("name".to_owned(), name.into());
            detail.insert("made_from".to_owned(), built_in.into());
            detail.insert("sha256".to_owned(), Hash::of(text.as_bytes()).to_string().into());
            directory.append(at, "machine-file-written", detail).map_err(shop::failure)?;
            path
        }
    };
    if common.json {
        print_json(&json!({ "file": path, "name": machine.name, "kind": kind_word(machine.kind), "made_from": built_in }))?;
    } else {
        say(&format!(
            "{} holds machine {}, made from {built_in}",
            path.display(),
            machine.name
        ));
        say(&match args.out {
            None => "it is the machine of every command that gets no --machine; look at it with toolmark machine show".to_owned(),
            Some(_) => format!(
                "use it with --machine {0}; look at it with toolmark machine show --machine {0}",
                path.display()
            ),
        });
    }
    Ok(Exit::Good)
}

/// A built-in machine's text under another name and head.
fn text_for(built_in: &str, text: &str, name: &str) -> String {
    let rest = text.find("\nkind").map_or(text, |at| &text[at + 1..]);
    // A JSON string is a TOML string, but for the name of the character 127.
    let quoted = Value::from(name).to_string().replace('\u{7f}', "\\u007f");
    format!(
        "# Machine file of toolmark, made from {built_in}. The unit of every quantity stands in its key; a key that nobody knows is an error.\n\
         # `toolmark machine show` tells every value with the line it stands in. Tools and work offsets here are those of the first day:\n\
         # what was changed since stands in the data directory, see `toolmark tool list` and `toolmark offset list`.\n\
         name = {quoted}\n{rest}"
    )
}

/// Writes a file that is not there yet.
fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    if path.symlink_metadata().is_ok() {
        return Err(Failure::usage(format_args!(
            "{} is there already: edit it, move it away, or give another place with --out",
            path.display()
        )));
    }
    let mut file = WholeFile::create(path).map_err(shop::failure)?;
    file.write_all(text.as_bytes()).map_err(|e| Failure::writing(path, e))?;
    file.finish().map_err(shop::failure).map(|_| ())
}

/// One value, as it is in force.
struct Shown {
    key: String,
    value: String,
    from: String,
    line: Option<u32>,
    event: Option<u64>,
    in_file: Option<String>,
}

fn show(common: &Common) -> Done {
    // Read anew and whole: a wrong value is refused here, with its line.
    let machine = machine_meant(common)?;
    let (file, text) = source_of(common)?;
    let told = MachineFile::told(&text, &file).map_err(shop::failure)?;
    let (values, events) = registers::in_force(common, &machine)?;
    let mut live: BTreeMap<String, (f64, u64)> = BTreeMap::new();
    for (register, (value, event)) in &values {
        if let (Some(event), Some(key)) = (event, key_of(register)) {
            live.insert(key, (*value, *event));
        }
    }
    let mut shown: Vec<Shown> = told.iter().map(|told| of_file(told, &file, &mut live, &events)).collect();
    for (key, (value, event)) in live {
        // The first values of the file are there under their own keys; what is left came later. A zero for an axis that the file leaves
        // out is the first day's too.
        let Some(from) = changed(&events, event) else { continue };
        shown.push(Shown {
            key,
            value: value.to_string(),
            from,
            line: None,
            event: Some(event),
            in_file: None,
        });
    }
    for (key, value) in machine.defaults() {
        let is_there = told.iter().any(|t| t.key == key || t.key.starts_with(&format!("{key}.")));
        if !is_there {
            shown.push(Shown {
                key,
                value,
                from: "default".to_owned(),
                line: None,
                event: None,
                in_file: None,
            });
        }
    }
    if common.json {
        let all: Vec<Value> = shown
            .iter()
            .map(|s| {
                json!({ "key": s.key, "value": s.value, "from": s.from, "line": s.line, "event": s.event, "in_file": s.in_file })
            })
            .collect();
        print_json(&json!({
            "machine": machine.name,
            "kind": kind_word(machine.kind),
            "file": file,
            "diameters": registers::diameters(&machine),
            "values": all,
        }))?;
        return Ok(Exit::Good);
    }
    say(&format!(
        "machine {} ({}), from {file}",
        machine.name,
        kind_word(machine.kind)
    ));
    if machine.counts_diameters(Axis::X) {
        say("X of tools and work offsets counts diameters; travel, speed and acceleration are of the slide");
    }
    for one in &shown {
        let mut line = format!("{:<40} = {:<16} {}", one.key, one.value, one.from);
        if let Some(in_file) = &one.in_file {
            line.push_str(&format!("; the file says {in_file}"));
        }
        say(&line);
    }
    Ok(Exit::Good)
}

/// What the machine's text is called, and the text.
fn source_of(common: &Common) -> Result<(String, String), Failure> {
    let wanted = if common.machine == "sim" {
        "sim-mill"
    } else {
        common.machine.as_str()
    };
    match BUILT_IN.iter().find(|(name, _)| *name == wanted) {
        Some((name, text)) => Ok((format!("{name} (built in)"), (*text).to_owned())),
        None => std::fs::read_to_string(wanted)
            .map(|text| (wanted.to_owned(), text))
            .map_err(|e| Failure::unreadable(format_args!("{wanted}: {e}"))),
    }
}

fn of_file(told: &Told, file: &str, live: &mut BTreeMap<String, (f64, u64)>, events: &registers::Told) -> Shown {
    let in_line = Shown {
        key: told.key.clone(),
        value: told.value.clone(),
        from: format!(
            "{}:{}",
            Path::new(file).file_name().map_or(file.into(), |n| n.to_string_lossy()),
            told.line
        ),
        line: Some(told.line),
        event: None,
        in_file: None,
    };
    let Some((value, event)) = live.remove(&told.key) else {
        return in_line;
    };
    let is_the_same = told.value.replace('_', "").parse::<f64>().ok() == Some(value);
    match changed(events, event) {
        Some(from) => Shown {
            value: value.to_string(),
            from,
            event: Some(event),
            in_file: Some(format!("{} in line {}", told.value, told.line)),
            ..in_line
        },
        // The file was edited after the first day: what was taken over then is in force.
        None if !is_the_same => Shown {
            value: value.to_string(),
            from: "data directory, taken over on the first day".to_owned(),
            event: Some(event),
            in_file: Some(format!("{} in line {}", told.value, told.line)),
            ..in_line
        },
        None => in_line,
    }
}

/// Where a value of the data directory comes from; `None` when it is the machine file's own, taken over.
fn changed(events: &registers::Told, event: u64) -> Option<String> {
    let words = events.newest_words(std::iter::once(event));
    (!words.is_empty()).then(|| format!("data directory, {words}"))
}

/// The key of the machine file that begins a register.
fn key_of(register: &Register) -> Option<String> {
    Some(match register {
        Register::ToolGeometry { tool, axis } => format!("tools[{}].geometry_{}_mm", tool.0, axis.letter()),
        Register::ToolDiameter(tool) => format!("tools[{}].diameter_mm", tool.0),
        Register::ToolRadius(tool) => format!("tools[{}].radius_mm", tool.0),
        Register::ToolTipDirection(tool) => format!("tools[{}].tip_direction", tool.0),
        Register::ToolWear { tool, axis } => format!("tools[{}].wear_{}_mm", tool.0, axis.letter()),
        Register::ToolRadiusWear(tool) => format!("tools[{}].radius_wear_mm", tool.0),
        Register::WorkOffset { name, axis } => {
            let bare = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
            let name = if bare { name.clone() } else { format!("{name:?}") };
            format!("work_offsets.{name}.{}_mm", axis.letter())
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_file_that_was_made_is_read_whatever_its_name() {
        for (built_in, text) in BUILT_IN {
            for name in ["mill-3", "Fräse \"3\"", "a\\b'c", "李", "x = 1 # no", "\u{7f}x"] {
                let made = text_for(built_in, text, name);
                let read = MachineFile::parse(&made, FILE);
                if name.contains('\u{7f}') {
                    assert!(read.is_err());
                    continue;
                }
                let mut expected = MachineFile::parse(text, FILE).expect("built in");
                expected.name = name.to_owned();
                assert_eq!(read.expect(name), expected);
            }
        }
    }
}

//! `toolmark size generate`: macro programs for a real control. Nothing is written that was not proven first.

use super::Bench;
use super::args::{GenerateArgs, MethodName};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::{files, say, shop};
use gcode::interpretation::MachineKind;
use gcode::{Interpretation, Setup, interpret};
use serde_json::json;
use sizing::Unit;
use sizing::control::Control;
use sizing::generate::{Generated, Method, SetupEnd, call, insert, t_word};
use std::collections::BTreeMap;
use std::path::Path;
use store::MachineFile;
use store::machine_file::MachineKind as KindOfMachine;

/// Runs the command.
pub(super) fn generate(args: &GenerateArgs, common: &Common) -> Done {
    let control = control(&args.control)?;
    let directory = shop::data_directory(common)?;
    let bench = Bench::open(&directory, common)?;
    if let Some(turns) = turns(&bench, common)?
        && turns == control.mill
    {
        let kind = |turns: bool| if turns { "lathe" } else { "mill" };
        return Err(Failure::usage(format_args!(
            "job {} is for {}, a {}, and {} is the control of a {}: choose another --control",
            bench.job.name,
            bench.kept.machine,
            kind(turns),
            control.name,
            kind(!control.mill)
        )));
    }
    let method = match args.method {
        MethodName::TWord => Method::TWord,
        MethodName::G65 => Method::G65,
    };
    let end = if args.called { SetupEnd::M99 } else { SetupEnd::M30 };
    let negative = |e: sizing::generate::GenerateError| Failure::negative(format_args!("error: {e}"));
    let generated = sizing::generate::generate(&bench.job, &control, method, end).map_err(negative)?;
    let mut written: Vec<(String, String)> = std::iter::once(&generated.setup)
        .chain(&generated.macros)
        .map(|program| (program.file_name(), program.file()))
        .collect();

    let mut proof = cell::proof::prove(&generated, &control, args.entries as usize);
    match &args.program {
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|e| Failure::unreadable(format_args!("{}: {e}; a part program was expected", path.display())))?;
            let changed = insert::insert(&text, &generated, &control)
                .map_err(|e| Failure::negative(format_args!("error: {}: {e}", path.display())))?;
            match same_run(&text, &changed, &generated, &control) {
                Ok(situation) => proof.situations.push(situation),
                Err(difference) => {
                    proof.different += 1;
                    proof.differences.push(difference);
                }
            }
            let name = path
                .file_name()
                .map_or("program.nc".into(), |n| n.to_string_lossy().into_owned());
            if written.iter().any(|(known, _)| *known == name) {
                return Err(Failure::usage(format_args!(
                    "{}: the part program has the name of a generated one; rename it, or give the job another number",
                    path.display()
                )));
            }
            written.push((name, changed));
        }
        None => written.push(("INSERT.txt".to_owned(), to_insert(&generated, &control))),
    }
    if !proof.holds() {
        if common.json {
            print_json(&json!({ "released": false, "proof": proof.json() }))?;
        }
        return Err(Failure::negative(format_args!(
            "{}error: the programs differ from the law of sizing, so nothing was written",
            proof.text()
        )));
    }
    written.push(("proof.txt".to_owned(), proof.text()));
    let report = serde_json::to_string_pretty(&proof.json()).expect("a proof is JSON");
    written.push(("proof.json".to_owned(), report + "\n"));
    release(&args.out, &written)?;

    let names: Vec<&str> = written.iter().map(|(name, _)| name.as_str()).collect();
    if common.json {
        print_json(&json!({
            "released": true,
            "control": control.name,
            "method": match method { Method::TWord => "t-word", Method::G65 => "g65" },
            "job": generated.job,
            "files": names,
            "folder": args.out,
            "variables": generated.layout.names,
            "proof": proof.json(),
        }))?;
    } else {
        say(proof.text().trim_end());
        say(&format!("released to {}: {}", args.out.display(), names.join(", ")));
        for (k, dimension) in (1..).zip(&generated.dimensions) {
            let place = match method {
                Method::TWord => format!("#{}", generated.layout.entry + k),
                Method::G65 => {
                    let offset = call::entry_offset(&generated.dimensions, k as usize - 1, &control);
                    format!("{} of offset {offset}", dimension.column)
                }
            };
            say(&format!("  {} is entered in {place}", dimension.name));
        }
        if method == Method::TWord {
            say("  the control needs parameter 6001.5 (TCS): T words call O9000");
        }
    }
    Ok(Exit::Good)
}

/// Whether the machine of the job turns, where that is known: by its file, or by its name when it is simulated.
fn turns(bench: &Bench, common: &Common) -> Result<Option<bool>, Failure> {
    let named = crate::program::named_machine(&common.machine)?.filter(|m| m.name == bench.kept.machine);
    let simulated = || {
        let kinds = [KindOfMachine::Lathe, KindOfMachine::Mill].into_iter();
        kinds.map(MachineFile::simulated).find(|m| m.name == bench.kept.machine)
    };
    Ok(named.or_else(simulated).map(|m| m.kind == KindOfMachine::Lathe))
}

/// A built-in control, or a profile of the person's own.
fn control(wanted: &str) -> Result<Control, Failure> {
    if let Some(known) = Control::find(wanted) {
        return Ok(known);
    }
    let path = Path::new(wanted);
    if !path.exists() {
        let names: Vec<String> = Control::built_in().into_iter().map(|c| c.name).collect();
        return Err(Failure::usage(format_args!(
            "--control {wanted}: neither a file nor one of {}",
            names.join(", ")
        )));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Failure::unreadable(format_args!("{wanted}: {e}")))?;
    let control = Control::parse(&text, wanted).map_err(|e| Failure::unreadable_diagnostic(&e))?;
    if gcode::profile::by_name(&control.dialect).is_none_or(|p| p.turning == control.mill) {
        return Err(Failure::unreadable(format_args!(
            "{wanted}: dialect {:?} is no {}'s that is known here: {}",
            control.dialect,
            if control.mill { "mill" } else { "lathe" },
            if control.mill { "fanuc-mill" } else { "fanuc-lathe" }
        )));
    }
    Ok(control)
}

/// What the part program needs, for a person to put in.
fn to_insert(generated: &Generated, control: &Control) -> String {
    match generated.method {
        Method::TWord => format!(
            "At the head of the part program, before its first block:\n{}\n{}",
            t_word::job_line(control, generated.job),
            match control.mill {
                true => "T in a block of its own before M6: a T word calls behind the other words of its block.\n",
                false => "",
            }
        ),
        Method::G65 => {
            let mut text = String::from("In the part program, each before the turret index of its offset:\n");
            for (k, dimension) in (1..).zip(&generated.dimensions) {
                let line = call::call(k, &generated.dimensions, generated.job, control);
                let blanks = if control.mill { "" } else { ".." };
                text.push_str(&format!("before T{blanks}{:02}: {line}\n", control.called_by(dimension)));
            }
            text
        }
    }
}

/// The changed program, with its macros and nothing entered, makes the same moves as the program that was given.
fn same_run(given: &str, changed: &str, generated: &Generated, control: &Control) -> Result<String, String> {
    let run = |text: String, ready: bool| {
        let mut vars = BTreeMap::new();
        if ready {
            vars.insert(generated.layout.job, Some(f64::from(generated.job)));
            vars.insert(generated.layout.taken, Some(0.0));
        }
        interpret(
            &text,
            &Setup {
                machine: match control.mill {
                    true => MachineKind::Mill,
                    false => MachineKind::Lathe,
                },
                units: match generated.unit {
                    Unit::Mm => gcode::interpretation::Unit::Mm,
                    Unit::Inch => gcode::interpretation::Unit::Inch,
                },
                params: match (generated.method, ready) {
                    (Method::TWord, true) => BTreeMap::from([("6001.5".to_owned(), 1.0)]),
                    _ => BTreeMap::new(),
                },
                vars,
                control: Some(control.dialect.clone()),
                ..Setup::default()
            },
        )
    };
    let before = run(given.to_owned(), false);
    if let Some(fault) = &before.fault {
        return Ok(format!(
            "not proven: the part program itself does not come to its end here (line {}: {})",
            fault.line, fault.text
        ));
    }
    // The macros go before the end of the tape.
    let end = changed
        .rfind('%')
        .filter(|at| changed[..*at].trim() != "")
        .unwrap_or(changed.len());
    let mut whole = changed[..end].trim_end().to_owned();
    whole.push('\n');
    generated.macros.iter().for_each(|m| whole.push_str(&m.text));
    let after = run(whole, true);
    if let Some(fault) = &after.fault {
        return Err(format!(
            "the changed part program stops in line {}: {}",
            fault.line, fault.text
        ));
    }
    let told = |run: &Interpretation| (run.path.clone(), run.tool, run.output.clone());
    if told(&before) == told(&after) {
        Ok(format!(
            "the part program with nothing entered makes the same {} moves as before",
            after.path.len()
        ))
    } else {
        Err(format!(
            "the changed part program makes other moves: {} and not {}, last tool {:?} and not {:?}",
            after.path.len(),
            before.path.len(),
            after.tool,
            before.tool
        ))
    }
}

fn release(folder: &Path, written: &[(String, String)]) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|e| Failure::writing(folder, e))?;
    written
        .iter()
        .try_for_each(|(name, text)| files::write(&folder.join(name), text.as_bytes()))
}

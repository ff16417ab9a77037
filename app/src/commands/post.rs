//! `toolmark post`: a program in the words of a control.

use super::{Done, print_json};
use crate::cli::{Common, PostArgs};
use crate::failure::{Exit, Failure};
use crate::program::{Kind, Program, machine_for, named_machine};
use crate::{files, say, shop};
use ::post::source::{Interpreted, elsewhere, lengths, other_variables};
use ::post::{CONTROLS, Grade, Options, Posted};
use gcode::GcodeProgram;
use plan::flow::StructuredProgram;
use plan::{Diagnostic, Severity, Tables};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::sync::Arc;
use stepnc::{StreamOptions, StructuredStream};
use units::{Machine, Setup, Transform};

/// Runs the command.
///
/// # Errors
/// The program cannot be read, or says what the control cannot; or the file cannot be written.
pub fn post(args: &PostArgs, common: &Common) -> Done {
    let program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    let Written { posted, text, about } = posted(args, &program, &common.machine)?;
    match &args.out {
        Some(out) => files::write(out, &text)?,
        None if common.json => {}
        None => std::io::stdout()
            .write_all(&text)
            .map_err(|e| Failure::machine(format_args!("stdout: {e}")))?,
    }
    tell(args, common, about, &posted, &text)?;
    let refused = posted.functions.iter().any(|row| row.grade == Grade::Refused);
    Ok(if refused { Exit::Negative } else { Exit::Good })
}

/// A program in the words of a control.
pub struct Written {
    /// What came of it.
    pub posted: Posted,
    /// The program.
    pub text: Vec<u8>,
    /// The control, in words.
    pub about: &'static str,
}

/// Writes an open program for the control of the arguments; `machine` is as for `--machine`.
///
/// # Errors
/// The arguments make no sense, or the program says what the control cannot.
pub fn posted(args: &PostArgs, program: &Program, machine: &str) -> Result<Written, Failure> {
    let control = ::post::by_name(&args.control).ok_or_else(|| {
        let names: Vec<&str> = CONTROLS.iter().map(|control| control.name()).collect();
        Failure::usage(format_args!(
            "--control {} is unknown; known are {}",
            args.control,
            names.join(", ")
        ))
    })?;
    if !(args.chord.is_finite() && args.chord >= 1e-4) {
        return Err(Failure::usage(format_args!(
            "--chord {}: a length of 0.0001 mm or more was expected",
            args.chord
        )));
    }
    let turning = program.turns();
    let machine = machine_for(machine, turning)?;
    let tables = store::registers::tables(&machine, &BTreeMap::new()).map_err(shop::failure)?;
    let mut head = Vec::new();
    let (dialect, because) = program.dialect();
    if program.step_nc().is_none() {
        head.push(format!("READ AS {dialect}: {because}"));
        head.push("SUBPROGRAMS AND CYCLES ARE WRITTEN OUT, VALUES OF VARIABLES ARE THOSE OF THE PROGRAM".to_owned());
    }
    // Conditions of STEP-NC are kept whatever was asked for.
    if args.as_interpreted && program.step_nc().is_none() {
        head.push("AS INTERPRETED: BRANCHES AND VALUES OF THE MACHINE ARE AS THEY CAME WITHOUT A MACHINE".to_owned());
    }
    let bases = bases(program, &mut head);
    let options = Options {
        number: args.number,
        source: program.name.clone(),
        turning,
        chord: args.chord,
        check_every: args.check_every,
        bases,
        lengths: lengths(&elsewhere(&tables, 0, turning)),
        head,
    };
    let mut text = Vec::new();
    let done = ::post::post(
        control,
        &mut |pass| open(program, &tables, pass, args.as_interpreted),
        &options,
        &mut |line| text.extend_from_slice(line.as_bytes()),
    );
    let posted = done.map_err(|found| Failure {
        exit: Exit::Negative,
        message: found.to_string(),
    })?;
    if !args.as_interpreted
        && let Some(found) = posted
            .remarks
            .iter()
            .find(|remark| ["cutter-compensation-zero", "nose-radius-zero"].contains(&remark.code))
    {
        return Err(Failure {
            exit: Exit::Negative,
            message: format!(
                "{}",
                Diagnostic {
                    severity: Severity::Error,
                    remedy: "the path beside the contour is worked out here: give a machine file with the radius, set it in the program \
                             (G10 L12), or post with --as-interpreted"
                        .to_owned(),
                    ..found.clone()
                }
            ),
        });
    }
    Ok(Written {
        posted,
        text,
        about: control.about(),
    })
}

/// The program for a pass.
fn open(
    program: &Program,
    tables: &Tables,
    pass: usize,
    as_interpreted: bool,
) -> Result<Box<dyn StructuredProgram>, Box<Diagnostic>> {
    let tables = elsewhere(tables, pass, program.turns());
    let unreadable = |failure: Failure| Box::new(Diagnostic::error("unreadable", failure.message));
    match &program.kind {
        Kind::StepNc(step_nc) => {
            // Set-ups lie where the file says; what it does not say makes no difference to its paths.
            let options = StreamOptions {
                tables: Tables {
                    work_offsets: BTreeMap::new(),
                    ..tables
                },
                ..StreamOptions::default()
            };
            Ok(Box::new(StructuredStream::new(Arc::clone(step_nc), options)))
        }
        Kind::Gcode { .. } => {
            let variables = if as_interpreted {
                BTreeMap::new()
            } else {
                other_variables(pass)
            };
            let gcode = program.gcode_with(&tables, variables).map_err(unreadable)?;
            Ok(Box::new(Interpreted::new(gcode, decided, as_interpreted)))
        }
        Kind::CutterLocation => {
            let apt = program.cutter_location(&tables).map_err(unreadable)?;
            Ok(Box::new(Interpreted::new(apt, |_| None, as_interpreted)))
        }
    }
}

fn decided(program: &GcodeProgram) -> Option<String> {
    program.decided().map(|(line, by)| format!("line {line}: {by}"))
}

/// Where the set-ups of a STEP-NC program lie, for the head and for the points.
fn bases(program: &Program, head: &mut Vec<String>) -> BTreeMap<String, Transform<Machine, Setup>> {
    let mut bases = BTreeMap::new();
    let Some(step_nc) = program.step_nc() else { return bases };
    let Some(plan) = step_nc.plan() else { return bases };
    step_nc.walk(plan.main_workplan, &mut |executable, enabled| {
        if let Some(setup) = &executable.setup
            && enabled
            && let Some(place) = setup.machine_from_setup
            && !bases.contains_key(&setup.name)
        {
            let [x, y, z] = place.origin.map(|c| (c * 1e4).round() / 1e4);
            head.push(format!(
                "SET-UP {}: ORIGIN X{x} Y{y} Z{z} OF THE MACHINE, SAYS THE FILE",
                setup.name
            ));
            bases.insert(setup.name.clone(), place);
        }
    });
    bases
}

fn tell(args: &PostArgs, common: &Common, about: &str, posted: &Posted, text: &[u8]) -> Result<(), Failure> {
    let remarks: Vec<&Diagnostic> = posted
        .remarks
        .iter()
        .filter(|remark| !remark.code.starts_with("missing-"))
        .collect();
    if common.json {
        let program = match args.out {
            Some(_) => None,
            None => Some(String::from_utf8_lossy(text).into_owned()),
        };
        return print_json(&json!({
            "control": args.control,
            "file": args.out,
            "program": program,
            "lines": posted.lines,
            "functions": posted.functions,
            "notices": posted.notices,
            "verify_at_commissioning": posted.verify,
            "tools": posted.tools.iter().map(|(number, name)| json!({ "number": number, "name": name })).collect::<Vec<_>>(),
            "work_offsets": posted.work_offsets,
            "remarks": remarks,
        }));
    }
    let mut lines = vec![match &args.out {
        Some(out) => format!("{}: {} lines for {about}", out.display(), posted.lines),
        None => format!("{} lines for {about}", posted.lines),
    }];
    let width = posted.functions.iter().map(|row| row.name.len()).max().unwrap_or(0).max(28);
    if !posted.functions.is_empty() {
        lines.push(format!(" {:width$} {:16} {:>5}  {}", "function", "grade", "times", "reason"));
    }
    for row in &posted.functions {
        let mark = if row.verified { "" } else { "verify at commissioning: " };
        lines.push(format!(
            " {:width$} {:16} {:>5}  {mark}{}",
            row.name,
            row.grade.word(),
            row.count,
            row.reason
        ));
    }
    lines.extend(posted.notices.iter().map(|notice| format!(" note       {notice}")));
    lines.extend(posted.verify.iter().map(|form| format!(" verify at commissioning: {form}")));
    lines.extend(
        remarks
            .iter()
            .filter(|remark| remark.severity != Severity::Remark)
            .map(|remark| format!(" {remark}")),
    );
    for line in lines {
        match args.out {
            Some(_) => say(&line),
            None => eprintln!("{line}"),
        }
    }
    Ok(())
}

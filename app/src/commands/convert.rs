//! `toolmark convert`: a program of another kind as STEP-NC.

use super::{Done, print_json};
use crate::cli::{Common, ConvertArgs};
use crate::clock;
use crate::failure::{Exit, Failure};
use crate::program::{Kind, Program, machine_for, named_machine};
use crate::survey::beforehand;
use crate::{files, say, shop};
use plan::{Next, ProgramStream, Severity, StepKind, Tables};
use serde_json::json;
use std::collections::BTreeMap;
use stepnc::FunctionForm;
use stepnc::write::{ConvertError, WriteOptions};

/// Runs the command.
///
/// # Errors
/// The program cannot be read or run to its end, is STEP-NC already, or the file cannot be written.
pub fn convert(args: &ConvertArgs, common: &Common) -> Done {
    let program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    if program.step_nc().is_some() {
        return Err(Failure::usage(format_args!(
            "{} is a STEP file already; toolmark edit changes one",
            args.program.display()
        )));
    }
    let machine = machine_for(&common.machine, program.turns())?;
    let tables = store::registers::tables(&machine, &BTreeMap::new()).map_err(shop::failure)?;
    let written = clock::start_time(common.start.as_deref())?;
    let stem = args.program.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let options = WriteOptions {
        name: args.name.clone().or(stem).unwrap_or_else(|| "program".to_owned()),
        made_from: program.name.clone(),
        written,
        author: shop::operator(common),
        writer: "toolmark".to_owned(),
        inches: in_inches(&program, &tables)?,
        turning: program.turns(),
        tables: tables.clone(),
        functions: function_form(args.aim_strict),
    };
    let mut stream = program.stream(&tables)?;
    let file = stepnc::write::convert(&mut *stream, &options, &mut beforehand).map_err(|error| match error {
        ConvertError::Alarm(alarm) => (*alarm).into(),
        other => Failure::negative(format_args!("error: {}: {other}", program.name)),
    })?;
    files::write(&args.out, &file.bytes)?;
    let remarks = stream.diagnostics();
    for remark in remarks.iter().filter(|remark| remark.severity != Severity::Remark) {
        eprintln!("{remark}");
    }
    for notice in &file.notices {
        shop::notice(notice);
    }
    let (dialect, because) = program.dialect();
    if common.json {
        print_json(&json!({
            "file": args.out,
            "workingsteps": file.workingsteps,
            "toolpaths": file.toolpaths,
            "tools": file.tools,
            "units": if options.inches { "inch" } else { "mm" },
            "dialect": { "name": dialect, "because": because },
            "remarks": remarks,
        }))?;
    } else {
        say(&format!(
            "{}: {} workingsteps, {} toolpaths, {} tools from {} ({dialect}: {because})",
            args.out.display(),
            file.workingsteps,
            file.toolpaths,
            file.tools,
            program.name
        ));
    }
    Ok(Exit::Good)
}

/// How functions are written.
pub(super) fn function_form(aim_strict: bool) -> FunctionForm {
    if aim_strict {
        FunctionForm::AimStrict
    } else {
        FunctionForm::Mapping
    }
}

/// The unit in force at the program's first move.
fn in_inches(program: &Program, tables: &Tables) -> Result<bool, Failure> {
    match &program.kind {
        Kind::Gcode { .. } => {
            let mut stream = program.gcode(tables)?;
            let mut answer = None;
            loop {
                match stream.next(answer.take()) {
                    Next::Step(step) if matches!(step.kind, StepKind::Move(_)) => return Ok(stream.in_inches()),
                    Next::Step(_) => {}
                    Next::Ask(question) => answer = Some(beforehand(&question)),
                    Next::End | Next::Alarm(_) => return Ok(stream.in_inches()),
                }
            }
        }
        Kind::CutterLocation => Ok(program.cutter_location(tables)?.in_inches()),
        Kind::StepNc(_) => Ok(false),
    }
}

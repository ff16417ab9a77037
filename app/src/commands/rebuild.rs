//! `toolmark rebuild`: a record becomes as-executed STEP-NC.

use super::{Done, print_json, tolerance};
use crate::cli::{Common, DisplayUnits, PlacementName, RebuildArgs};
use crate::execution::as_executed;
use crate::failure::{Exit, Failure};
use crate::link::driven::{self, Driven};
use crate::printed::Printed;
use crate::program::{Program, machine_for, named_machine};
use crate::recording::{self, Said};
use crate::report::{self, Page};
use crate::survey::beforehand;
use crate::{clock, files, say, shop};
use asrun::{PlanOptions, PlannedProgram, Verdict};
use plan::Severity;
use std::collections::BTreeMap;
use std::path::Path;
use stepnc::twin::{Placement, TwinOptions};

/// The answer as JSON.
#[derive(serde::Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    report: &'a asrun::Report,
    #[serde(skip_serializing_if = "Option::is_none")]
    driven: Option<&'a Driven>,
}

/// Runs the command.
///
/// # Errors
/// Plan or record cannot be read, or a file cannot be written.
pub fn rebuild(args: &RebuildArgs, common: &Common) -> Done {
    let (plan_file, record_file) = match (&args.files[..], args.no_plan) {
        ([record], true) => (None, record),
        ([plan, record], false) => (Some(plan), record),
        ([_], false) => {
            return Err(Failure::usage(
                "PLAN and RECORD were expected; without a plan say so: toolmark rebuild --no-plan RECORD",
            ));
        }
        _ => return Err(Failure::usage("with --no-plan there is only the RECORD")),
    };
    let tolerance = tolerance(args.tolerance)?;
    let said = Said {
        frame: args.frame,
        units: (common.units == Some(DisplayUnits::Inch)).then_some(DisplayUnits::Inch),
        device: args.device.clone(),
    };
    // A job of the data directory, unless there is a file of that name.
    let job = record_file
        .to_str()
        .filter(|name| *name == "last" || name.parse::<u32>().is_ok());
    let (record, found) = match job.filter(|_| !record_file.exists()) {
        Some(job) => recording::read_job(&shop::data_path(common)?, job, &said)?,
        None => recording::read(record_file, &said)?,
    };
    for diagnostic in found.iter().filter(|d| d.severity != Severity::Remark) {
        eprintln!("{diagnostic}");
    }
    let driven = driven_in(record_file);
    let options = asrun::Options {
        name: args.name.clone().unwrap_or_else(|| "run 1".to_owned()),
        tolerance,
        ..asrun::Options::default()
    };
    let program = match plan_file {
        None => None,
        Some(file) => Some(Program::open(
            file,
            common.dialect.as_deref(),
            named_machine(&common.machine)?.as_ref(),
        )?),
    };
    let mut rebuilt = match &program {
        None => asrun::rebuild(None, &record, &options),
        Some(program) => {
            let plan = planned(program, common)?;
            asrun::rebuild(Some(&plan), &record, &options)
        }
    };
    let placement = match args.placement {
        PlacementName::Project | PlacementName::External => Placement::Project,
        PlacementName::Workplan => Placement::Workplan,
    };
    let twin = TwinOptions {
        placement,
        ..TwinOptions::at(written_at(common, rebuilt.executed.end)?)
    };
    // What was cut off a recording is missing in the run: the report says so, and the exit code.
    let damaged = found.iter().filter(|d| d.severity == Severity::Error);
    rebuilt.report.findings.splice(0..0, damaged.map(ToString::to_string));
    let bytes = match &program {
        Some(program) if args.placement == PlacementName::External => {
            let Some(plan) = program.step_nc() else {
                return Err(Failure::usage("--as external: only a STEP-NC plan has anchors"));
            };
            let saved = stepnc::twin::write_beside(plan, &program.name, &rebuilt.executed, &twin)
                .map_err(|e| Failure::negative(format_args!("error: {e}")))?;
            saved.notices.iter().for_each(|notice| shop::notice(notice));
            saved.bytes
        }
        Some(program) => as_executed(program, &rebuilt.executed, &twin)?,
        None => stepnc::write_new(&rebuilt.executed, &twin).map_err(|e| Failure::negative(format_args!("error: {e}")))?,
    };
    files::write(&args.out, &bytes)?;
    let report = &rebuilt.report;
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder).map_err(|e| Failure::writing(folder, e))?;
        let name = program.as_ref().map_or("", |p| p.name.as_str());
        let page = Page {
            course: None,
            driven: driven.as_ref(),
            printed: &Printed::default(),
            recorded: &[],
            program: name,
            machine: &record.source,
            ended: None,
            provenance: vec![],
            report,
        };
        report::write(&page, folder)?;
    }
    if common.json {
        print_json(&Told {
            report,
            driven: driven.as_ref(),
        })?;
    } else {
        for line in driven.iter().flat_map(Driven::lines) {
            say(&format!("  {line}"));
        }
        report::print(report, common.units.unwrap_or_default());
        say(&format!("file: {}", args.out.display()));
    }
    let judged = args.tolerance.is_some() && matches!(report.verdict, Verdict::OutOfTolerance | Verdict::Incomplete);
    let damaged = found.iter().any(|d| d.severity == Severity::Error);
    Ok(if judged || damaged { Exit::Negative } else { Exit::Good })
}

/// What a controller that kept the record itself says of the run; `None` for any other recording.
fn driven_in(record: &Path) -> Option<Driven> {
    let reader = store::record::Reader::open(record).ok()?;
    serde_json::from_str(reader.metadata().get(driven::METADATA_KEY)?).ok()
}

/// The plan of a program for comparison, on the machine that the settings mean.
///
/// # Errors
/// The machine cannot be read, or the program cannot be run to its end.
pub fn planned(program: &Program, common: &Common) -> Result<PlannedProgram, Failure> {
    let machine = machine_for(&common.machine, program.turns())?;
    let tables = store::registers::tables(&machine, &BTreeMap::new()).map_err(shop::failure)?;
    let mut stream = program.stream(&tables)?;
    let options = PlanOptions {
        rapid: shop::limits(&machine).v_max,
        ..PlanOptions::default()
    };
    let plan = PlannedProgram::read(&mut *stream, &program.name, &options, &mut beforehand);
    if let asrun::PlanEnd::Alarm(alarm) = &plan.ended {
        return Err((**alarm).clone().into());
    }
    Ok(plan)
}

/// The time stamp of a written file: `--start` when given, so that the same call gives the same bytes, else the end of the record.
fn written_at(common: &Common, end: units::Timestamp) -> Result<units::Timestamp, Failure> {
    match &common.start {
        Some(text) => clock::start_time(Some(text)),
        None => Ok(end),
    }
}

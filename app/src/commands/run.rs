//! `toolmark run`: check, plan, execute, record, rebuild, report.

use super::check::{print, travels, worst};
use super::trace::living;
use super::{Done, print_json, tolerance};
use crate::cli::{Common, LinkName, RunArgs};
use crate::cycle_start::{self, Checked};
use crate::execution::{Asked, Drives, Order, Run, Work, run as execute};
use crate::failure::{Exit, Failure};
use crate::link::remote::{Machine, Remote, plan_of_its_own};
use crate::link::text_run::{Begins, REPORT_PORT};
use crate::link::{address, certificates, driving, text_run};
use crate::overriding::Overriding;
use crate::people::{self, Acting};
use crate::program::{Program, machine_for, named_machine};
use crate::survey::{Check, State, checks, minutes, survey, survey_on};
use crate::taking_up::{self, TakeUp, TakenUp};
use crate::{clock, functions, report, say, shop};
use asrun::Verdict;
use cell::{Ended, Fault, WorkingstepSelector};
use ledger::Action;
use motion::Trajectory;
use plan::tables::Missing;
use plan::{ProgramStream, Tables};
use serde_json::json;
use std::path::Path;
use store::DataDirectory;
use store::machine_file::{self, MachineFile};
use units::{Point, Seconds, Timestamp, ToolNumber};

/// Runs the command.
///
/// # Errors
/// The program or machine cannot be read, the check fails, or a file cannot be written.
pub fn run(args: &RunArgs, common: &Common) -> Done {
    let tolerance = tolerance(args.tolerance)?;
    let overriding = overriding_of(args)?;
    let approach = approach_of(args, common)?;
    let thinned = args.as_mtconnect.as_deref().map(thinning).transpose()?;
    let shifted = args.plant_shift.as_deref().map(planted_shift).transpose()?;
    let start = clock::start_time(common.start.as_deref())?;
    let behind = address::is_address(&common.machine);
    if behind && args.fast {
        return Err(Failure::usage(
            "--fast is for the simulated world in this process; a controller runs in real time",
        ));
    }
    let named = if behind { None } else { named_machine(&common.machine)? };
    let mut program = Program::open(&args.program, common.dialect.as_deref(), named.as_ref())?;
    let asked = people::shown_to_others(common);
    if args.link == LinkName::Text {
        if !overriding.is_nothing() || approach.is_some() {
            return Err(Failure::usage(
                "--link text: the protocol has no word for overrides, nor for a way back to the path; use the default link",
            ));
        }
        return run_over_text(args, &mut program, common);
    }
    let driver = Driver::connect(
        common,
        args.machine_file.as_deref(),
        program.turns(),
        &format!("{} of {asked}", program.name),
    )?;
    let machine = driver.machine.clone();
    let stop = super::stopped_by_signals()?;
    let mut directory = shop::data_directory(common)?;
    shop::retain(&mut directory, &machine, start)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::Run, &mut directory, start)?;
    let who = acting.name.clone();
    directory.take_over(&machine, &who, start).map_err(shop::failure)?;
    let mut tables = directory.tables(&machine).map_err(shop::failure)?;
    let in_spindle = driver.place(&mut tables, args.home)?;
    program.variables = directory.variables(&machine).map_err(shop::failure)?;

    let take_up = taken_up(args, &program, &tables, &machine, (&acting, &mut directory), start)?;
    let found = survey_on(
        stream_of(&program, &tables, take_up.as_ref())?,
        &tables,
        shop::limits(&machine),
        Some((&shop::parameters(&machine), in_spindle)),
    );
    let mut all = checks(&found, travels(&machine), &tables);
    let asked = functions::look_at(&mut *stream_of(&program, &tables, take_up.as_ref())?, &program);
    functions::checks(&asked, acting.level, &mut all);
    if asked.all_modes {
        // One of the reasons below when it is refused; here it comes into the log.
        let _ = acting.ask(Action::StartAllModes, &mut directory, start)?;
    }
    if !common.json {
        all.iter().filter(|c| c.state != State::Ok).for_each(print);
    }
    check_passed(&all)?;
    if let Some((number, _)) = &shifted
        && *number > found.workingsteps
    {
        return Err(Failure::usage(format_args!(
            "--plant-shift {number}: the program has {} workingsteps",
            found.workingsteps
        )));
    }
    if shifted.is_some() && !driver.is_simulated() {
        return Err(Failure::usage("--plant-shift is for practice on simulated machines only"));
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
    let told = take_up
        .as_ref()
        .map(|take_up| tell_take_up(take_up, &program, &tables, (&acting, &mut directory), start))
        .transpose()?;
    let order = Order {
        work: Work::Program(&program),
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
        drives: drives_of(&driver),
        stop: Some(&stop),
        person: acting.json(),
        found: edited.clone(),
        asked: Asked {
            take_up: take_up.as_ref().zip(told.as_ref()),
            overriding,
            plan: Some(&found.remaining),
            approach,
        },
    };
    let done = execute(&order, &mut directory, None).map_err(|failure| and_how_to_go_on(failure, args, behind))?;
    tell_outcome(&done, &program.name, &machine, &all, (&acting, edited.as_deref()), common)
}

/// Refuses a program that failed its check, with all reasons.
fn check_passed(all: &[Check]) -> Result<(), Failure> {
    if worst(all) != State::Fail {
        return Ok(());
    }
    let failed = all.iter().filter(|c| c.state == State::Fail);
    let why: Vec<&str> = failed.map(|c| c.text.as_str()).collect();
    Err(Failure::negative(format_args!(
        "the check failed, nothing was moved: {}",
        why.join("; ")
    )))
}

/// The program, from where it is taken up.
fn stream_of<'a>(
    program: &'a Program,
    tables: &Tables,
    take_up: Option<&TakeUp>,
) -> Result<Box<dyn ProgramStream + 'a>, Failure> {
    let whole = program.stream(tables)?;
    Ok(match take_up {
        Some(take_up) => Box::new(take_up.stream(whole)?),
        None => whole,
    })
}

/// Where the program is taken up, if it is: only by somebody who may. A run that begins at the beginning is told what was left before.
fn taken_up(
    args: &RunArgs,
    program: &Program,
    tables: &Tables,
    machine: &MachineFile,
    (acting, directory): (&Acting, &mut DataDirectory),
    start: Timestamp,
) -> Result<Option<TakeUp>, Failure> {
    if args.from.is_some() || args.resume.is_some() {
        acting.must(Action::Restart, directory, start)?;
    }
    let found = match (&args.from, &args.resume) {
        (Some(step), _) => taking_up::from(step, program, tables, machine)?,
        (None, Some(job)) => taking_up::resumed(job, program, tables, machine, directory)?,
        (None, None) => {
            if let Some(left) = taking_up::left_over(program, tables, machine, directory)? {
                shop::notice(&left);
            }
            return Ok(None);
        }
    };
    if found.is_none() {
        shop::notice("nothing moves before that step: the program is run from its beginning");
    }
    Ok(found)
}

/// Tells the log and the person where the program is taken up.
fn tell_take_up(
    take_up: &TakeUp,
    program: &Program,
    tables: &Tables,
    (acting, directory): (&Acting, &mut DataDirectory),
    start: Timestamp,
) -> Result<TakenUp, Failure> {
    let told = take_up.told(program.stream(tables)?, acting)?;
    let mut detail = acting.detail();
    detail.insert("program".to_owned(), program.name.as_str().into());
    detail.insert("program_sha256".to_owned(), program.hash.to_string().into());
    detail.insert("at".to_owned(), told.at.as_str().into());
    detail.insert("step".to_owned(), told.step.into());
    detail.insert("after_job".to_owned(), told.after_job.into());
    detail.insert("restored".to_owned(), told.restored.clone().into());
    detail.insert("left_out".to_owned(), told.left_out.clone().into());
    directory
        .append(start, Action::Restart.word(), detail)
        .map_err(shop::failure)?;
    shop::notice(&told.line());
    if let Some(left_out) = told.left_out_line() {
        shop::notice(&left_out);
    }
    Ok(told)
}

/// A run that its machine was lost to is taken up by another one.
fn and_how_to_go_on(mut failure: Failure, args: &RunArgs, behind: bool) -> Failure {
    if behind && failure.exit == Exit::Machine {
        failure.message += &format!(
            "\nnothing resumes by itself: when the machine is there again, look at it and at the part; then toolmark run {} with the same \
             machine and --resume last takes the job up where it was",
            args.program.display()
        );
    }
    failure
}

/// Overrides and holds that the command line asks for.
fn overriding_of(args: &RunArgs) -> Result<Overriding, Failure> {
    let overriding = Overriding::of(
        args.feed_override.as_deref(),
        args.rapid_override.as_deref(),
        args.spindle_override.as_deref(),
        args.overrides.as_deref(),
    )?;
    let is_zero = overriding.constant.is_some_and(|o| o.feed == 0 || o.rapid == 0);
    if is_zero && overriding.script.is_empty() {
        return Err(Failure::usage(
            "an override of 0 % for the whole run never comes to its end; turn it up later with --overrides F, or use hold and resume there",
        ));
    }
    Ok(overriding)
}

/// How far from its path the machine may be led back.
fn approach_of(args: &RunArgs, common: &Common) -> Result<Option<f64>, Failure> {
    let behind = address::is_address(&common.machine);
    if args.overrides.is_some() && behind {
        return Err(Failure::usage(
            "--overrides is a script for simulated runs in this process; a machine behind tcp:// has its own switches, and --feed-override holds for a whole run",
        ));
    }
    match args.approach {
        None => Ok(None),
        Some(_) if !behind => Err(Failure::usage("--approach is for a machine behind tcp://")),
        Some(distance) if distance > 0.0 && distance <= MOST_APPROACH => Ok(Some(distance)),
        Some(distance) => Err(Failure::usage(format_args!(
            "--approach {distance}: a length above 0 and up to {MOST_APPROACH} mm was expected; from further away --resume takes the job up from above"
        ))),
    }
}

/// From further away than this nobody is led straight back to a path, mm.
const MOST_APPROACH: f64 = 100.0;

/// A run over the published text protocol: the plan goes out, and the record is the controller's.
fn run_over_text(args: &RunArgs, program: &mut Program, common: &Common) -> Done {
    if !address::is_address(&common.machine) {
        return Err(Failure::usage(
            "--link text is for a machine behind tcp://; start toolmark controller --link text",
        ));
    }
    if args.as_mtconnect.is_some() || args.plant_shift.is_some() || args.out.is_some() || args.tolerance.is_some() {
        return Err(Failure::usage(
            "--out, --tolerance, --as-mtconnect and --plant-shift need a record, which the text protocol does not bring: toolmark controller --link text --record DIR keeps it",
        ));
    }
    let machine = machine_file_behind(common, args.machine_file.as_deref(), program.turns())?;
    let start = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::Run, &mut directory, start)?;
    directory.take_over(&machine, &acting.name, start).map_err(shop::failure)?;
    let mut tables = directory.tables(&machine).map_err(shop::failure)?;
    // The protocol has no word for whether the machine is real: nothing that is not known of it is assumed.
    tables.missing = Missing::Fail;
    program.variables = directory.variables(&machine).map_err(shop::failure)?;
    let take_up = taken_up(args, program, &tables, &machine, (&acting, &mut directory), start)?;
    let stream = || stream_of(program, &tables, take_up.as_ref());
    let found = survey(stream()?, &tables, shop::limits(&machine));
    let mut all = checks(&found, travels(&machine), &tables);
    functions::checks_of_text_link(&functions::look_at(&mut *stream()?, program), &mut all);
    if !common.json {
        all.iter().filter(|c| c.state != State::Ok).for_each(print);
    }
    check_passed(&all)?;
    let stop = super::stopped_by_signals()?;
    let lengths = tables
        .tools
        .iter()
        .map(|(n, tool)| (n.0, tool.geometry.0.xyz[2] + tool.wear.0.xyz[2]))
        .collect();
    let told = take_up
        .as_ref()
        .map(|take_up| tell_take_up(take_up, program, &tables, (&acting, &mut directory), start))
        .transpose()?;
    let mut source = Trajectory::new(stream()?, tables.position, shop::limits(&machine));
    let port = args.report_port.or(machine.link.report_port).unwrap_or(REPORT_PORT);
    let address = address::read(&common.machine)?;
    let begins = match &take_up {
        Some(take_up) => Begins::AtHome(take_up.stream(program.stream(&tables)?)?.tool()),
        None => Begins::Here,
    };
    let parameters = shop::parameters(&machine);
    let done = text_run::run(&address, port, (&parameters, begins), lengths, &mut source, &stop)?;
    let losses = done.losses.lines();
    if common.json {
        print_json(&json!({
            "link": "text",
            "ended": if done.ended.is_some() { "stopped" } else { "sent" },
            "text": done.ended.as_deref().unwrap_or("every line went out"),
            "lines": done.lines,
            "commands": done.commands,
            "told": done.told,
            "losses": losses,
            "restart": told,
            "checks": all,
        }))?;
    } else {
        say(&format!(
            "{} over the text protocol to {address}: {}, {} movement lines",
            program.name,
            done.ended.as_deref().unwrap_or("every line went out"),
            done.lines
        ));
        losses.iter().chain(&done.told).for_each(|line| say(&format!("  {line}")));
        say("  the record is with the controller (--record DIR): toolmark rebuild PROGRAM RECORD --out F.stpnc --report DIR");
    }
    Ok(if done.ended.is_none() { Exit::Good } else { Exit::Negative })
}

/// The file of a machine behind an address.
///
/// # Errors
/// It cannot be read.
pub fn machine_file_behind(common: &Common, file: Option<&Path>, turns: bool) -> Result<MachineFile, Failure> {
    if let Some(path) = file {
        return MachineFile::open(path).map_err(shop::failure);
    }
    let own = shop::data_path(common)?.join("machine.toml");
    if own.is_file() {
        MachineFile::open(&own).map_err(shop::failure)
    } else {
        machine_for("sim", turns)
    }
}

/// The machine of a run: its file, and the link to it where it is somewhere else.
pub struct Driver {
    /// Its file.
    pub machine: MachineFile,
    behind: Option<(Remote, Machine)>,
}

/// Who moves the axes of an order.
pub fn drives_of(driver: &Driver) -> Drives<'_> {
    match &driver.behind {
        None => Drives::World,
        Some((remote, machine)) => Drives::Behind(remote, machine),
    }
}

impl Driver {
    /// The machine that `--machine` means; a controller is connected to, as `name`.
    ///
    /// # Errors
    /// The machine file cannot be read, nobody answers, or the controller's machine is another one.
    pub fn connect(common: &Common, file: Option<&Path>, turns: bool, name: &str) -> Result<Driver, Failure> {
        if !address::is_address(&common.machine) {
            if file.is_some() {
                return Err(Failure::usage(
                    "--machine-file is for a machine behind tcp://; --machine takes a file itself",
                ));
            }
            let machine = machine_for(&common.machine, turns)?;
            if let machine_file::Driver::Card(_) = machine.driver {
                return Err(Failure::usage(format_args!(
                    "'{}' is moved by its card: start toolmark controller --machine {}, then run with --machine tcp://127.0.0.1 (to try it on the simulator, \
                     take a copy of the file with driver = \"sim\" and without [card])",
                    machine.name, common.machine
                )));
            }
            return Ok(Driver { machine, behind: None });
        }
        let address = address::read(&common.machine)?;
        let machine = machine_file_behind(common, file, turns)?;
        let loopback = address.resolve()?.iter().all(|a| a.ip().is_loopback());
        let client = certificates::for_connecting(&address.host, loopback, &machine.link)?;
        // Each run is a plan of its own: it begins where the machine stands now.
        let asking = client.clone();
        let connected = Remote::connect(&address, client, name, plan_of_its_own(name)?, &shop::parameters(&machine));
        let (remote, found) = connected.map_err(|mut failure| {
            if failure.message.contains("other limits") {
                let kind = if turns { "program turns" } else { "program mills" };
                failure.message.push_str(&format!(
                    " (here it is '{}': the {kind}); --machine-file names another",
                    machine.name
                ));
            }
            failure
        })?;
        if found.name != machine.name {
            shop::notice(&format!(
                "{address} is '{}'; the plan is made for '{}', which has the same limits",
                found.name, machine.name
            ));
        }
        // Said before anything moves: a machine that holds for a condition of another program is a riddle.
        match living::left_behind(&address, asking.as_ref(), name) {
            Ok(left) => left.iter().for_each(|left| shop::notice(left)),
            Err(failure) => shop::notice(&format!(
                "what earlier runs have left in the machine is not known: {}",
                failure.message
            )),
        }
        Ok(Driver {
            machine,
            behind: Some((remote, found)),
        })
    }

    /// Puts the place where the machine stands into the tables: that is where a plan begins. Gives the tool that it has. Where `home` allows
    /// it a machine that does not know where its axes are looks for its references first; at a simulated one somebody does it.
    ///
    /// # Errors
    /// The machine does not become ready.
    pub fn place(&self, tables: &mut Tables, home: bool) -> Result<ToolNumber, Failure> {
        let Some((remote, _)) = &self.behind else {
            return Ok(ToolNumber(0));
        };
        if !self.is_simulated() {
            // Whatever file the plan is made from: what a real machine has is known or nothing moves.
            tables.missing = Missing::Fail;
        }
        let report = driving::make_ready(remote, home || self.is_simulated())?;
        tables.position = Point::from_xyz(report.sample.commanded);
        Ok(report.sample.tool)
    }

    /// True when nothing of it is real.
    pub fn is_simulated(&self) -> bool {
        drives_of(self).is_simulated()
    }
}

/// Says how a run ended.
///
/// # Errors
/// The answer is no JSON.
pub fn tell_outcome(
    done: &Run,
    program: &str,
    machine: &MachineFile,
    all: &[Check],
    (acting, edited): (&Acting, Option<&str>),
    common: &Common,
) -> Done {
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
            "driven": done.driven,
            "restart": done.course.restart,
            "time": done.course.time,
            "overrides": done.course.overridden.overrides,
            "holds": done.course.overridden.holds,
            "held_s": done.course.overridden.held_s,
            "functions": done.printed.functions,
            "by": acting.json(),
            "edited_outside": edited,
        }))?;
    } else {
        say(&format!(
            "{}run of {program} on {}: {} in {} of machine time, {} rows recorded",
            if done.rebuild.report.simulated { "SIMULATED " } else { "" },
            machine.name,
            done.outcome.ended.text(),
            minutes(done.outcome.time.0),
            done.record.rows
        ));
        if let Some(driven) = &done.driven {
            driven.lines().iter().for_each(|line| say(&format!("  {line}")));
        }
        done.course.lines().iter().for_each(|line| say(&format!("  {line}")));
        for gap in &done.gaps {
            say(&format!("warning: the record has a gap: {gap}"));
        }
        report::print(&done.rebuild.report, common.units.unwrap_or_default());
        for line in &done.printed.lines {
            say(&format!("  printed: {line}"));
        }
        functions::print(&done.printed.functions);
        let folder = done.folder.display();
        let recorded = done.printed.functions.iter().any(|told| told.data.contains_key("streams"));
        let values = if recorded { ", functions.parquet" } else { "" };
        say(&format!(
            "files: {folder}/as-executed.stpnc, report.html, report.json, record.parquet{values}"
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

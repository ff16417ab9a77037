//! `toolmark live`: a job from a CAM add-in, cut while its operations are still coming.

use super::run::{Driver, drives_of, tell_outcome};
use super::{Done, stopped_by_signals, tolerance};
use crate::cli::{Common, LiveArgs};
use crate::execution::{Asked, Order, Work, run as execute};
use crate::failure::{Exit, Failure};
use crate::live::job::LiveJob;
use crate::live::program::{LivePlan, write_options};
use crate::live::protocol::{self, Connected, Heard, KnownTool};
use crate::live::server::{Heading, PROGRESS, Session, attend};
use crate::people::{self, Acting};
use crate::{clock, say, shop};
use ledger::Action;
use plan::Tables;
use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;
use store::MachineFile;
use units::Axis;

/// Runs the command.
///
/// # Errors
/// The machine cannot be had, the socket cannot be listened on, or a file cannot be written.
pub fn live(args: &LiveArgs, common: &Common) -> Done {
    let tolerance = tolerance(args.tolerance)?;
    if !args.listen.ip().is_loopback() {
        return Err(Failure::usage(format_args!(
            "--listen {}: whoever can reach it could move the machine; a live job is for programs on this computer, 127.0.0.1",
            args.listen
        )));
    }
    let start = clock::start_time(common.start.as_deref())?;
    let asked = people::shown_to_others(common);
    let driver = Driver::connect(common, args.machine_file.as_deref(), false, &format!("live job of {asked}"))?;
    let stop = stopped_by_signals()?;
    let machine = &driver.machine;
    let mut directory = shop::data_directory(common)?;
    shop::retain(&mut directory, machine, start)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::Run, &mut directory, start)?;
    let who = acting.name.clone();
    directory.take_over(machine, &who, start).map_err(shop::failure)?;
    let mut tables = directory.tables(machine).map_err(shop::failure)?;
    driver.place(&mut tables, args.home)?;

    let cannot = |e: std::io::Error| {
        Failure::machine(format_args!(
            "{} cannot be listened on: {e}; --listen takes another",
            args.listen
        ))
    };
    let listener = TcpListener::bind(args.listen).map_err(cannot)?;
    let address = listener.local_addr().map_err(cannot)?;
    if common.json {
        say(&serde_json::json!({ "address": address.to_string(), "machine": machine.name }).to_string());
    } else {
        say(&format!("{} waits for operations on {address}", machine.name));
    }
    let Some(session) = Session::accept(&listener, &stop).map_err(cannot)? else {
        return Ok(Exit::Good);
    };
    // One job, one add-in: others are turned away by the system.
    drop(listener);
    let Some(connect) = session.introduced() else {
        return Err(Failure::machine("the add-in has gone before it said who it is"));
    };
    let options = write_options(&connect.job, &connect.client, &who, start);
    let plan = match LivePlan::new(machine.clone(), tables.clone(), &connect.work_offset, options) {
        Ok(plan) => plan,
        Err(why) => {
            session.refuse(&why);
            session.close();
            return Err(Failure::usage(why));
        }
    };
    session.tell(&Heard::Connected(connected(
        machine,
        &tables,
        &connect.work_offset,
        driver.is_simulated(),
    )));
    let job = LiveJob::new(&connect.job, &connect.client, start, plan);

    let (to_heading, headings) = mpsc::channel();
    let over = AtomicBool::new(false);
    let done = std::thread::scope(|scope| {
        let (session, job, over) = (&session, &job, &over);
        scope.spawn(move || attend(session, job, &|heading| to_heading.send(heading).unwrap_or_default()));
        let ended = (|| {
            if !begins(&headings, &stop) {
                return Err(Failure::negative("error: the job ended before the machine could begin"));
            }
            scope.spawn(move || {
                while !over.load(Relaxed) {
                    session.tell(&Heard::Progress(job.progress()));
                    std::thread::sleep(PROGRESS);
                }
            });
            let order = Order {
                work: Work::Live(job),
                machine,
                tables,
                seed: common.seed,
                start,
                faults: vec![],
                thinned: None,
                out: args.out.as_deref(),
                tolerance,
                fast: false,
                who: &who,
                drives: drives_of(&driver),
                stop: Some(&stop),
                person: acting.json(),
                found: None,
                asked: Asked::default(),
            };
            execute(&order, &mut directory, None)
        })();
        over.store(true, Relaxed);
        job.close();
        let told = match &ended {
            Ok(run) => protocol::Done {
                ended: run.outcome.ended.word().to_owned(),
                text: run.outcome.ended.text(),
                verdict: Some(run.rebuild.report.verdict.word().to_owned()),
                folder: Some(run.folder.display().to_string()),
            },
            Err(failure) => protocol::Done {
                ended: "failed".to_owned(),
                text: failure.message.clone(),
                verdict: None,
                folder: None,
            },
        };
        // The last progress is before the last word.
        std::thread::sleep(PROGRESS + Duration::from_millis(20));
        session.tell(&Heard::Done(told));
        session.close();
        ended
    })?;
    tell_outcome(&done, job.name(), machine, &[], (&acting, None), common)
}

/// Waits until the machine may begin; false when it is not to.
fn begins(headings: &mpsc::Receiver<Heading>, stop: &AtomicBool) -> bool {
    loop {
        match headings.recv_timeout(Duration::from_millis(50)) {
            Ok(Heading::Started) => return true,
            Ok(Heading::Over) | Err(RecvTimeoutError::Disconnected) => return false,
            Err(RecvTimeoutError::Timeout) if stop.load(Relaxed) => return false,
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

fn connected(machine: &MachineFile, tables: &Tables, offset: &str, simulated: bool) -> Connected {
    let known = |(number, tool): (&units::ToolNumber, &plan::ToolEntry)| KnownTool {
        number: number.0,
        name: tool.name.clone(),
        length_mm: tool.geometry.0.xyz[2] + tool.wear.0.xyz[2],
        diameter_mm: tool.diameter.map(|d| d.0),
    };
    Connected {
        machine: machine.name.clone(),
        simulated,
        travel_mm: Axis::ALL.map(|axis| machine.axis(axis).map(|a| [a.travel_min.0, a.travel_max.0])),
        v_max_mm_s: Axis::ALL.map(|axis| machine.axis(axis).map(|a| a.v_max.0)),
        spindle_max_rpm: machine.spindle.max.0,
        work_offset_mm: tables.work_offsets.get(offset).map_or([0.0; 3], |frame| frame.origin),
        position_mm: tables.position.xyz,
        tools: tables.tools.iter().map(known).collect(),
    }
}

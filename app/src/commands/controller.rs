//! `toolmark controller`: the machine side of the set-point link.

use super::{Done, print_json};
use crate::cli::{Common, ControllerArgs, LinkName};
use crate::controller::drives::Drives;
use crate::controller::gamepad::{Gamepad, Pad};
use crate::controller::realtime::{AtOnce, Privileges, Punctuality, Servo, every_cycle};
use crate::controller::recording::Recording;
use crate::controller::serving::{Served, serve};
use crate::controller::text_serving;
use crate::failure::{Exit, Failure};
use crate::link::certificates;
use crate::link::text_run::REPORT_PORT;
use crate::program::machine_for;
use crate::{say, shop};
use cell::link::{LinkReceiver, MachineCard, TextReceiver};
use machine::link::Follower;
use machine::{Quality, RealtimeHalf, Request};
use serde_json::json;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc;
use store::MachineFile;

/// Where a controller listens when nothing says another port.
pub const PORT: u16 = 7450;

/// Runs the command.
///
/// # Errors
/// The machine file cannot be read, the address cannot be listened on, or may not be without certificates.
pub fn controller(args: &ControllerArgs, common: &Common) -> Done {
    let machine = machine_for(&common.machine, false)?;
    let parameters = shop::parameters(&machine);
    parameters
        .check()
        .map_err(|e| Failure::unreadable(format_args!("{}: {e}", machine.name)))?;
    let stop = super::stopped_by_signals()?;
    if args.until_stdin_ends {
        let stop = Arc::clone(&stop);
        std::thread::spawn(move || {
            // Whatever is said there is for nobody.
            let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
            stop.store(true, Relaxed);
        });
    }
    let ip: IpAddr = args.listen;
    let server = certificates::for_listening(ip, &machine.link)?;
    let listener = listen(args, &machine, ip)?;

    let pad = match &args.pad {
        None => Pad::None,
        Some(path) => Pad::Gamepad(Box::new(Gamepad::open(path).map_err(|e| {
            Failure::machine(format_args!(
                "--pad {}: {e}; ls -l /dev/input/by-id shows what is plugged in",
                path.display()
            ))
        })?)),
    };
    let text = args.link == LinkName::Text;
    if text && !ip.is_loopback() {
        return Err(Failure::usage(format_args!(
            "{ip}: the text protocol has neither encryption nor checksums; it is for programs on this computer, 127.0.0.1"
        )));
    }
    let drives = Drives::of(&machine, &parameters, common.seed)?;
    let quality = drives.quality();
    // Real drives go on while this computer is away; simulated ones wait.
    let made_up = if quality == Quality::Simulated {
        machine.late_ticks_made_up
    } else {
        0
    };
    let mut half = RealtimeHalf::with_pad(&parameters, drives, pad, quality);
    half.made_up_for(made_up);
    let (mut servo, mut ends) = Servo::new(half, (!text).then(Follower::new));
    let _ = ends.at_once.push(AtOnce::Request(Request::PowerOn));
    let (punctuality, ended) = (Arc::new(Punctuality::default()), Arc::new(AtomicBool::new(false)));
    let (to_privileges, privileges) = mpsc::channel();
    let realtime = std::thread::spawn({
        let (punctuality, ended) = (Arc::clone(&punctuality), Arc::clone(&ended));
        move || {
            let taken = Privileges::take();
            let _ = to_privileges.send((taken.to_string(), taken.lacks(), taken.complete()));
            every_cycle(&punctuality, &ended, made_up.into(), |tick, late| {
                servo.late_cycle(tick, late)
            });
        }
    });
    let (has, lacks, complete) = privileges
        .recv()
        .expect("the realtime thread says what it has before anything else");
    tell_start(&listener, &machine, quality, (&has, &lacks, complete), made_up, common)?;

    let served = if text {
        let mut recording = match &args.record {
            None => None,
            Some(folder) => {
                let address = listener.local_addr().map(|a| format!("tcp://{a}")).unwrap_or_default();
                Some(Recording::into(
                    folder,
                    &machine.name,
                    &address,
                    quality == Quality::Simulated,
                )?)
            }
        };
        let place = text_serving::Place {
            listener: &listener,
            report_port: args.report_port.or(machine.link.report_port).unwrap_or(REPORT_PORT),
            attended: quality == Quality::Simulated,
        };
        let receiver = TextReceiver::new(&parameters);
        let served = text_serving::serve(&place, receiver, ends, &mut recording, &stop, &mut |line| eprintln!("{line}"));
        if let Some(line) = recording.as_mut().and_then(Recording::end) {
            eprintln!("{line}");
        }
        served
    } else {
        if args.record.is_some() {
            eprintln!("notice: --record is for the text protocol; over the default link the driving side has every sample");
        }
        let receiver = LinkReceiver::new(MachineCard::new(&machine.name, quality, &parameters));
        serve(&listener, server.as_ref(), receiver, ends, &stop, &mut |line| {
            eprintln!("{line}")
        })
    };
    ended.store(true, Relaxed);
    realtime.join().expect("the realtime thread does not panic");
    tell_end(&served, &punctuality, common)?;
    Ok(if served.at_rest { Exit::Good } else { Exit::Machine })
}

fn listen(args: &ControllerArgs, machine: &MachineFile, ip: IpAddr) -> Result<TcpListener, Failure> {
    let port = args.port.or(machine.link.port).unwrap_or(PORT);
    let address = SocketAddr::new(ip, port);
    let failed = |e: std::io::Error| {
        Failure::machine(format_args!(
            "{address} cannot be listened on: {e}; is another controller running? --port takes another"
        ))
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    Ok(listener)
}

fn tell_start(
    listener: &TcpListener,
    machine: &MachineFile,
    quality: Quality,
    (has, lacks, complete): (&str, &[String], bool),
    made_up: u32,
    common: &Common,
) -> Result<(), Failure> {
    let address = listener
        .local_addr()
        .map_err(|e| Failure::machine(format_args!("the address is not known: {e}")))?;
    if common.json {
        let told = json!({
            "address": format!("tcp://{address}"),
            "machine": machine.name,
            "simulated": quality == Quality::Simulated,
            "realtime": has,
            "punctual": complete,
            "lacks": lacks,
            "late_ticks_made_up": made_up,
            "late_ticks_allowed": machine.late_ticks_allowed,
        });
        say(&told.to_string());
    } else {
        let simulated = if quality == Quality::Simulated { " (SIMULATED)" } else { "" };
        say(&format!("{}{simulated} listens on tcp://{address}", machine.name));
    }
    eprintln!("realtime task: {has}");
    lacks.iter().for_each(|line| eprintln!("warning: {line}"));
    let without = if complete {
        ""
    } else {
        "without these rights cycles come late more often; "
    };
    eprintln!("{without}{}", late_cycles(made_up, machine.late_ticks_allowed));
    Ok(())
}

/// What becomes of late cycles, for a person.
fn late_cycles(made_up: u32, allowed: u32) -> String {
    if made_up == 0 {
        return format!(
            "up to {allowed} late cycles in a row are tolerated (late_ticks_allowed of the machine file), after more comes a controlled stop"
        );
    }
    format!(
        "up to {made_up} late cycles in a row are tolerated, because simulated drives wait for them (late_ticks_made_up of the machine file); \
         after more comes a controlled stop, and all are counted"
    )
}

fn tell_end(served: &Served, punctuality: &Punctuality, common: &Common) -> Result<(), Failure> {
    let (summary, wake_ups) = (punctuality.cycles.summary(), punctuality.wake_ups.summary());
    let counters = &served.counters;
    if common.json {
        return print_json(&json!({
            "at_rest": served.at_rest,
            "senders": served.senders,
            "refused": served.refused,
            "link_losses": served.losses,
            "late_ticks": counters.late_ticks,
            "late_gaps": counters.late_gaps,
            "starvations": counters.starvations,
            "lost_reports": served.lost_reports,
            "lateness": summary,
            "wake_ups": wake_ups,
        }));
    }
    say(&format!(
        "{}: {} late ticks in {} gaps; {} senders, {} refused, {} times the link was lost",
        if served.at_rest {
            "stopped at rest"
        } else {
            "the machine did not come to rest"
        },
        counters.late_ticks,
        counters.late_gaps,
        served.senders,
        served.refused,
        served.losses,
    ));
    say(&summary.to_string());
    summary.bars().iter().for_each(|line| say(line));
    Ok(())
}

//! A run over the published text protocol: lines out on one connection, a few lines back on another one that the controller opens.
//!
//! There is no account of what is done and no sample in the protocol. So the record of such a run is the controller's own
//! (`toolmark controller --link text --record DIR`), and what is known here is what was sent and what could not be carried.

use super::address::Address;
use super::socket::Socket;
use crate::failure::Failure;
use crate::progress::Progress;
use cell::link::{Losses, TextSender};
use cell::{CommandSource, Output};
use machine::link::text::Told;
use machine::{Command, MachineParameters, Request};
use plan::{Answer, Question};
use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use units::Tick;

/// How often the loop looks.
const LOOK: Duration = Duration::from_millis(1);
/// How long one address is tried.
const CONNECT: Duration = Duration::from_secs(5);
/// Where the reports are listened for when nothing says another port.
pub const REPORT_PORT: u16 = 7451;
/// A connection is kept so long behind the last line: what was sent ahead is still being executed, and who leaves stops the machine.
const LAST_LINES: Duration = Duration::from_millis(600);

/// What is known of a run over the text protocol.
#[derive(Debug, Default)]
pub struct TextRun {
    /// Commands of the plan that went out.
    pub commands: u64,
    /// Movement lines that went out.
    pub lines: u64,
    /// What came back, in words.
    pub told: Vec<String>,
    /// What could not be carried.
    pub losses: Losses,
    /// Why it ended early; `None` when everything went out.
    pub ended: Option<String>,
}

/// Sends a plan.
///
/// # Errors
/// Nobody answers, or the connection ends.
pub fn run(
    address: &Address,
    report_port: u16,
    parameters: &MachineParameters,
    lengths: BTreeMap<u32, f64>,
    source: &mut dyn CommandSource,
    stop: &AtomicBool,
) -> Result<TextRun, Failure> {
    let here = address.resolve()?;
    let failed = |e: std::io::Error| {
        Failure::machine(format_args!(
            "{address}: {e}; is toolmark controller --link text running there?"
        ))
    };
    if here.iter().any(|a| !a.ip().is_loopback()) {
        return Err(Failure::usage(format_args!(
            "{address}: the text protocol has neither encryption nor checksums and goes to this computer only; use the default link"
        )));
    }
    let any: IpAddr = if here[0].is_ipv4() {
        [127, 0, 0, 1].into()
    } else {
        [0, 0, 0, 0, 0, 0, 0, 1].into()
    };
    let reports = TcpListener::bind(SocketAddr::new(any, report_port)).map_err(|e| {
        Failure::machine(format_args!(
            "port {report_port} for the controller's reports cannot be listened on: {e}; --report-port takes another"
        ))
    })?;
    reports.set_nonblocking(true).map_err(failed)?;
    let stream = TcpStream::connect_timeout(&here[0], CONNECT).map_err(failed)?;
    let mut socket = Socket::new(stream, None).map_err(failed)?;
    let mut back: Option<Socket> = None;
    let mut sender = TextSender::new(parameters, lengths);
    let mut run = TextRun::default();
    let (mut waiting, mut over, mut answer): (Option<Command>, bool, Option<Answer>) = (None, false, None);
    let mut progress = Progress::new("sending");
    let began = Instant::now();
    let (mut bytes, mut out) = (Vec::new(), Vec::new());
    let mut stop_asked = false;
    while run.ended.is_none() {
        let now = Tick(u64::try_from(began.elapsed().as_millis()).unwrap_or(u64::MAX));
        // The planner gives what the sender has room for.
        while !over {
            if let Some(command) = waiting.take()
                && let Err(command) = sender.push(command)
            {
                waiting = Some(command);
                break;
            }
            if !source.is_ready() {
                break;
            }
            match source.next(answer.take()) {
                Output::Command(command) => {
                    over = matches!(command, Command::End { .. });
                    waiting = Some(command);
                    if over && let Some(command) = waiting.take() {
                        // There is always room for the last one, sooner or later.
                        over = sender.push(command).is_ok();
                        waiting = (!over).then_some(command);
                    }
                }
                Output::Passed(_) => {}
                Output::Ask(Question::OptionalStop) => answer = Some(Answer::Truth(false)),
                Output::Ask(question) => {
                    run.ended = Some(format!(
                        "the program asks {question:?}, and the text protocol brings no answers: use the default link"
                    ));
                    break;
                }
                Output::End => {
                    let command = Command::End {
                        step: units::StepId::NONE,
                    };
                    over = sender.push(command).is_ok();
                    if !over {
                        waiting = Some(command);
                    }
                    if waiting.is_none() {
                        break;
                    }
                }
                Output::Alarm(alarm) => {
                    run.ended = Some(alarm.to_string());
                    break;
                }
            }
        }
        if (stop.load(Relaxed) || run.ended.is_some()) && !stop_asked {
            stop_asked = true;
            sender.request(Request::Stop);
        }
        if let Ok((stream, _)) = reports.accept() {
            back = Socket::new(stream, None).ok();
        }
        if let Some(socket) = &mut back {
            bytes.clear();
            let gone = socket.read(&mut bytes).is_err();
            match sender.receive(&bytes) {
                Ok(told) => run.told.extend(told.iter().map(words)),
                Err(why) => run.ended = Some(why.to_string()),
            }
            if gone {
                back = None;
            }
        }
        // What the controller does not take stays in the socket: it is not asked for more.
        let written = socket.flush().map_err(failed)?;
        if written {
            out.clear();
            match sender.output(now, &mut out) {
                Ok(()) => socket.write(&out).map_err(failed)?,
                Err(why) => run.ended = Some(why.to_string()),
            }
        }
        bytes.clear();
        if socket.read(&mut bytes).is_err() {
            return Err(Failure::machine(format_args!(
                "{address}: the controller closed the connection: another one drives the machine, it ended, or it was started without --link text"
            )));
        }
        progress.at(|| format!("{} lines", sender.lines()));
        if sender.ended() && written && out.is_empty() {
            break;
        }
        if sender.paused() {
            // Somebody stands at the simulated machine; at a real one the person starts again.
            sender.request(Request::CycleStart);
        }
        std::thread::sleep(LOOK);
    }
    if stop_asked && run.ended.is_none() {
        run.ended = Some("controlled stop: stop was asked".to_owned());
    }
    if sender.emergency_stop() {
        run.ended = Some("emergency stop".to_owned());
    }
    // What was given up is stopped by the controller when this connection goes; what is complete is waited for.
    let until = Instant::now() + LAST_LINES;
    while Instant::now() < until && socket.flush().is_ok() {
        std::thread::sleep(LOOK);
    }
    socket.close();
    (run.lines, run.commands, run.losses) = (sender.lines(), sender.sent(), sender.losses().clone());
    Ok(run)
}

fn words(told: &Told) -> String {
    String::from_utf8_lossy(told.text().bytes()).trim_end().to_owned()
}

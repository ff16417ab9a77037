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
use machine::link::text::{Line, Told};
use machine::{Command, MachineParameters, Request};
use plan::{Answer, Question};
use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use units::{Tick, ToolNumber};

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

/// Where a run over the text protocol begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Begins {
    /// Where the machine is taken to stand, with whatever tool.
    Here,
    /// At home, with this tool and its length in force: a run before may have left the machine anywhere, and nothing in the protocol tells
    /// where.
    AtHome(Option<ToolNumber>),
}

/// Sends a plan.
///
/// # Errors
/// Nobody answers, or the connection ends.
pub fn run(
    address: &Address,
    report_port: u16,
    (parameters, begins): (&MachineParameters, Begins),
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
    let mut sender = TextSender::new(parameters, lengths.clone());
    if let Begins::AtHome(tool) = begins {
        let mut ends = Ends {
            socket: &mut socket,
            reports: &reports,
            back: &mut back,
            stop,
        };
        let length = ends.bring_home(address, &mut sender, tool)?;
        sender = TextSender::new(parameters, lengths).with_length(length);
    }
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

/// The two connections before a run.
struct Ends<'a> {
    socket: &'a mut Socket,
    reports: &'a TcpListener,
    back: &'a mut Option<Socket>,
    stop: &'a AtomicBool,
}

/// How often the machine is asked to go home: after a stop it waits for a person, and does not hear it.
const ASKED_HOME: u32 = 6;
/// How long the machine may take for `M1` and `M0` alone.
const BEGIN_AND_END: Duration = Duration::from_millis(700);
/// And for the way home, or a tool change, before it is asked again.
const WAY_HOME: Duration = Duration::from_secs(6);

impl Ends<'_> {
    /// Takes the machine home, changes the tool there and takes it home again; gives the length that is in force then. So neither the place
    /// nor the tool of the run before matters.
    fn bring_home(&mut self, address: &Address, sender: &mut TextSender, tool: Option<ToolNumber>) -> Result<u32, Failure> {
        self.home(address, sender, &[Line::MachiningBegins, Line::MachiningEnds])?;
        let Some(tool) = tool else { return Ok(0) };
        let line = sender.tool_line(tool);
        let length = match line {
            Line::Tool { length, .. } => length,
            _ => 0,
        };
        let change = [
            Line::MachiningBegins,
            Line::OperationBegins { coolant: false },
            line,
            Line::OperationEnds,
            Line::MachiningEnds,
        ];
        self.home(address, sender, &change)?;
        Ok(length)
    }

    /// Says `before`, and asks for home until the machine says that it is there.
    fn home(&mut self, address: &Address, sender: &mut TextSender, before: &[Line]) -> Result<(), Failure> {
        for _ in 0..ASKED_HOME {
            self.say(address, before)?;
            self.hear(address, sender, BEGIN_AND_END)?;
            self.say(address, &[Line::Home])?;
            if self.hear(address, sender, WAY_HOME)? {
                return Ok(());
            }
        }
        Err(Failure::machine(format_args!(
            "{address}: the machine does not say that it is at home: look at it, and reset it if it stopped; nothing was machined"
        )))
    }

    fn say(&mut self, address: &Address, lines: &[Line]) -> Result<(), Failure> {
        let failed = |e: std::io::Error| Failure::machine(format_args!("{address}: {e}"));
        for line in lines {
            self.socket.write(line.text().bytes()).map_err(failed)?;
        }
        self.socket.flush().map(|_| ()).map_err(failed)
    }

    /// Listens so long; true at once when the machine is at home.
    fn hear(&mut self, address: &Address, sender: &mut TextSender, longest: Duration) -> Result<bool, Failure> {
        let until = Instant::now() + longest;
        let mut bytes = Vec::new();
        while Instant::now() < until {
            if let Ok((stream, _)) = self.reports.accept() {
                *self.back = Socket::new(stream, None).ok();
            }
            if let Some(socket) = self.back.as_mut() {
                bytes.clear();
                let gone = socket.read(&mut bytes).is_err();
                let told = sender
                    .receive(&bytes)
                    .map_err(|why| Failure::machine(format_args!("{address}: {why}")))?;
                if told.contains(&Told::Home) {
                    return Ok(true);
                }
                if gone {
                    *self.back = None;
                }
            }
            bytes.clear();
            if self.socket.flush().is_err() || self.socket.read(&mut bytes).is_err() {
                return Err(Failure::machine(format_args!(
                    "{address}: the controller closed the connection: another one drives the machine, or it ended"
                )));
            }
            if self.stop.load(Relaxed) || sender.emergency_stop() {
                return Err(Failure::machine(format_args!(
                    "{address}: stopped before anything was machined"
                )));
            }
            std::thread::sleep(LOOK);
        }
        Ok(false)
    }
}

fn words(told: &Told) -> String {
    String::from_utf8_lossy(told.text().bytes()).trim_end().to_owned()
}

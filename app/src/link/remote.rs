//! A machine behind the default link: a thread of its own speaks with the controller, so that planning and recording make nobody wait.
//!
//! Its other end takes commands and requests as a machine's queue would, and gives the machine's reports. A connection that is cut is
//! made again; the machine has stopped on its path meanwhile, and goes on when a person gives cycle start.

use super::address::Address;
use super::certificates::Client;
use super::socket::Socket;
use crate::clock;
use crate::failure::Failure;
use cell::link::{LinkError, LinkSender, Load, SenderStatus};
use ledger::Hash;
use machine::link::message::Refusal;
use machine::link::{Loaded, PlanId};
use machine::watch::Firing;
use machine::{Command, MachineParameters, Quality, Report, Request};
use std::collections::VecDeque;
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TryRecvError, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use units::Tick;

/// Commands between planner and link at most.
const COMMANDS: usize = 1024;
/// Reports between link and recorder at most, sixteen seconds: beyond it they wait with the controller, which counts what it loses.
const REPORTS: usize = 16_384;
/// Reports that wait for a recorder that is even later, two minutes: what comes then is a counted gap.
const MOST_BEHIND: usize = 120_000;
/// How long one address is tried.
const CONNECT: Duration = Duration::from_secs(5);
/// Between two tries to get back to a controller that was there.
const AGAIN: Duration = Duration::from_millis(300);
/// After so long without it the run is over.
const GIVEN_UP: Duration = Duration::from_secs(30);
/// A machine that is kept for a run that died is waited for so long: five seconds, and until it stands.
const KEPT: Duration = Duration::from_secs(30);
/// How long the controller may take to say who it is.
const GREETING: Duration = Duration::from_secs(5);
/// An alert of TLS 1.0 to 1.3, as its record begins: the answer to whoever speaks without.
const TLS_ALERT: [u8; 2] = [0x15, 0x03];
/// How often the thread looks.
const LOOK: Duration = Duration::from_millis(1);

/// What the controller says of its machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Its name.
    pub name: String,
    /// What its measurements are worth.
    pub quality: Quality,
}

/// The name of a run's plan on the link, which no other run has: one that was killed may have had the same name and the same `--start`, and the
/// controller would take this one for its continuation.
///
/// # Errors
/// The clock is outside the years that there are.
pub fn plan_of_its_own(name: &str) -> Result<PlanId, Failure> {
    let now = clock::start_time(None)?;
    let process = std::process::id();
    Ok(PlanId(Hash::of(format!("{name} {} {process}", now.0).as_bytes()).0))
}

/// One cycle of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// Its report.
    pub report: Report,
    /// The conditions that fired in it.
    pub firings: Vec<Firing>,
}

/// What both threads know.
#[derive(Default)]
struct Shared {
    machine: Option<Machine>,
    status: SenderStatus,
    lost_reports: u64,
    lost_firings: u64,
    begun_anew: u64,
    /// Times the connection was cut.
    cuts: u64,
    /// Times the controller gave this side the machine.
    leases: u64,
    ended: Option<String>,
    /// Another one that is gone has the machine yet.
    waits: bool,
    /// The newest report, whoever else gets it.
    last: Option<Report>,
    /// Every report is wanted from here on.
    recording: bool,
    /// How far from the path the machine may be led back to it, mm.
    approach: f64,
    /// Nobody wants anything of the machine any more.
    over: bool,
}

/// A machine behind the link.
pub struct Remote {
    commands: Option<SyncSender<Command>>,
    requests: SyncSender<Request>,
    /// As many as the program has conditions, which the machine's room bounds.
    loads: Sender<Load>,
    loaded: Receiver<Loaded>,
    reports: Receiver<Heard>,
    shared: Arc<Mutex<Shared>>,
    thread: Option<JoinHandle<()>>,
    /// Where it is, for messages.
    pub address: Address,
}

impl Remote {
    /// Connects, and waits until the controller has said who it is. `name` is what another one will read who wants to drive the machine too.
    /// One that died has the machine for some seconds yet: its end is waited for, and said.
    ///
    /// # Errors
    /// Nobody answers, the controller takes somebody else's set-points, or it is another machine than `parameters` say.
    pub fn connect(
        address: &Address,
        client: Option<Client>,
        name: &str,
        plan: PlanId,
        parameters: &MachineParameters,
    ) -> Result<(Remote, Machine), Failure> {
        let to = address.resolve()?;
        let (commands, from_commands) = sync_channel(COMMANDS);
        let (requests, from_requests) = sync_channel(64);
        let (to_reports, reports) = sync_channel(REPORTS);
        let (loads, from_loads) = channel();
        let (to_loaded, loaded) = channel();
        let shared = Arc::new(Mutex::new(Shared::default()));
        let speaker = Speaker {
            to,
            client,
            // One sender for the whole run, through every cut. A job that is taken up by another process is a new plan with steps of its own,
            // so there is nothing that a sender before had done or heard of ([`LinkSender::known_done`], [`LinkSender::known_fired`]).
            sender: LinkSender::new(name, plan, parameters),
            commands: from_commands,
            requests: from_requests,
            loads: from_loads,
            loaded: to_loaded,
            reports: to_reports,
            shared: Arc::clone(&shared),
            began: Instant::now(),
            kept_since: None,
            heard_of: None,
            linked: false,
            cut_at: None,
            command: None,
            report: VecDeque::new(),
            not_kept: 0,
            firings_not_kept: 0,
            over: false,
        };
        let thread = std::thread::spawn(move || speaker.speak());
        let remote = Remote {
            commands: Some(commands),
            requests,
            loads,
            loaded,
            reports,
            shared,
            thread: Some(thread),
            address: address.clone(),
        };
        let until = Instant::now() + CONNECT + GREETING;
        loop {
            let (machine, ended, waits) = {
                let shared = remote.lock();
                (shared.machine.clone(), shared.ended.clone(), shared.waits)
            };
            match (machine, ended) {
                (_, Some(why)) => return Err(Failure::machine(format_args!("{address}: {why}"))),
                (Some(machine), None) => return Ok((remote, machine)),
                (None, None) if !waits && Instant::now() > until => {
                    let why = "it does not say who it is: is it a toolmark controller, and with the default link?";
                    return Err(Failure::machine(format_args!("{address}: {why}")));
                }
                (None, None) => std::thread::sleep(LOOK),
            }
        }
    }

    /// Takes the next command, as a machine's queue would.
    ///
    /// # Errors
    /// Gives it back when there are enough.
    pub fn push(&self, command: Command) -> Result<(), Command> {
        match &self.commands {
            None => Err(command),
            Some(commands) => commands.try_send(command).map_err(|error| match error {
                TrySendError::Full(back) | TrySendError::Disconnected(back) => back,
            }),
        }
    }

    /// Asks for something. Sixty-four requests that nobody has taken are enough: the rest is dropped, and the caller asks again.
    pub fn request(&self, request: Request) {
        let _ = self.requests.try_send(request);
    }

    /// Lets the machine go back to its path straight and slowly from so far away, mm, when a person gives cycle start after a stop.
    pub fn allow_approach(&self, distance: f64) {
        self.lock().approach = distance;
    }

    /// Gives the machine a condition or a tool to know.
    pub fn load(&self, load: Load) {
        // The other end is there as long as the link is, and its end is told with the next report.
        let _ = self.loads.send(load);
    }

    /// The next answer to one, in the order in which they were given.
    pub fn loaded(&self) -> Option<Loaded> {
        self.loaded.try_recv().ok()
    }

    /// The next report, waited for so long at most.
    ///
    /// # Errors
    /// The link is over for good, and why.
    pub fn report(&self, longest: Duration) -> Result<Option<Heard>, Failure> {
        match self.reports.recv_timeout(longest) {
            Ok(heard) => Ok(Some(heard)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => {
                let why = self
                    .lock()
                    .ended
                    .clone()
                    .unwrap_or_else(|| "the link ended without a word".to_owned());
                Err(Failure::machine(format_args!("{}: {why}", self.address)))
            }
        }
    }

    /// The newest report: before the record begins, the others are of no interest.
    ///
    /// # Errors
    /// The link is over for good, and why.
    pub fn last_report(&self) -> Result<Option<Report>, Failure> {
        let shared = self.lock();
        match &shared.ended {
            Some(why) => Err(Failure::machine(format_args!("{}: {why}", self.address))),
            None => Ok(shared.last),
        }
    }

    /// From here on every report is kept for [`Remote::report`].
    pub fn begin_record(&self) {
        self.lock().recording = true;
    }

    /// How far sender and machine are, and how often the connection was cut.
    pub fn status(&self) -> (SenderStatus, u64) {
        let shared = self.lock();
        (shared.status, shared.cuts)
    }

    /// Times the controller gave this side the machine: once, and again after each cut.
    pub fn leases(&self) -> u64 {
        self.lock().leases
    }

    /// Reports that were lost, in all.
    pub fn lost_reports(&self) -> u64 {
        self.lock().lost_reports
    }

    /// Firings of conditions that were lost, in all.
    pub fn lost_firings(&self) -> u64 {
        self.lock().lost_firings
    }

    /// Times that the controller knew nothing of the run any more, in all.
    pub fn begun_anew(&self) -> u64 {
        self.lock().begun_anew
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        // Each change is one assignment: it is whole whoever panicked.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Remote {
    /// Gives the machine back.
    fn drop(&mut self) {
        self.commands = None;
        self.lock().over = true;
        if let Some(thread) = self.thread.take() {
            // What it had to say it has said in `ended`.
            let _ = thread.join();
        }
    }
}

/// The thread that speaks with the controller.
struct Speaker {
    to: Vec<SocketAddr>,
    client: Option<Client>,
    sender: LinkSender,
    commands: Receiver<Command>,
    requests: Receiver<Request>,
    loads: Receiver<Load>,
    loaded: Sender<Loaded>,
    reports: SyncSender<Heard>,
    shared: Arc<Mutex<Shared>>,
    began: Instant,
    /// Since when the machine is kept for another one that is gone.
    kept_since: Option<Instant>,
    /// When the controller was there last; `None` before it was.
    heard_of: Option<Instant>,
    /// The present connection has the lease.
    linked: bool,
    /// Since when there is none.
    cut_at: Option<Instant>,
    /// A command that the sender had no place for.
    command: Option<Command>,
    /// Reports that the recorder had no place for.
    report: VecDeque<Heard>,
    /// Reports for which there was no place here.
    not_kept: u64,
    /// Firings that went with them.
    firings_not_kept: u64,
    /// Nobody wants anything of the machine any more.
    over: bool,
}

impl Speaker {
    fn speak(mut self) {
        let why = loop {
            match self.connected() {
                Ok(socket) => match self.on(socket) {
                    Ok(()) => break None,
                    Err(why) if why.is_kept && self.heard_of.is_none() && self.may_wait(&why.text) => {
                        self.sender.disconnected(self.now())
                    }
                    Err(why) if why.is_final => break Some(why.text),
                    // Before it ever answered there is nothing to come back to.
                    Err(why) if self.heard_of.is_none() => break Some(why.text),
                    Err(why) => {
                        eprintln!(
                            "notice: the link to the controller is cut: {}; the machine stops on its path",
                            why.text
                        );
                        self.cut_at.get_or_insert_with(Instant::now);
                        self.sender.disconnected(self.now());
                        let mut shared = self.lock();
                        shared.cuts += 1;
                        shared.status.linked = false;
                    }
                },
                Err(text) if self.heard_of.is_none_or(|at| at.elapsed() > GIVEN_UP) => break Some(text),
                Err(_) => {}
            }
            if self.over || self.lock().over {
                break None;
            }
            std::thread::sleep(AGAIN);
        };
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.ended = Some(why.unwrap_or_else(|| "the run was over".to_owned()));
    }

    /// The machine is kept for another one that is gone: it is said once, and waited for.
    fn may_wait(&mut self, why: &str) -> bool {
        if self.kept_since.is_none() {
            eprintln!("notice: {why}; waiting for it");
            self.lock().waits = true;
        }
        self.kept_since.get_or_insert_with(Instant::now).elapsed() < KEPT
    }

    fn now(&self) -> Tick {
        Tick(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX))
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn connected(&self) -> Result<Socket, String> {
        dial(&self.to, self.client.as_ref())
    }

    /// Speaks on one connection until it ends, or the run.
    fn on(&mut self, mut socket: Socket) -> Result<(), Cut> {
        self.sender.connected(self.now());
        self.linked = false;
        let (mut bytes, mut out) = (Vec::new(), Vec::new());
        loop {
            bytes.clear();
            let read = socket.read(&mut bytes);
            self.is_of_this_kind(&bytes, read.is_err())?;
            // What came before the end counts: a refusal is the last word of a connection.
            let now = self.now();
            self.sender.receive(now, &bytes)?;
            read?;
            self.take_over();
            out.clear();
            self.sender.output(now, &mut out)?;
            socket.write(&out)?;
            let written = socket.flush()?;
            if self.over && written {
                socket.close();
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Says what is wrong where one side speaks encrypted and the other does not: in the words of the link that is only rubbish, or nothing.
    fn is_of_this_kind(&self, bytes: &[u8], over: bool) -> Result<(), Cut> {
        if self.heard_of.is_some() {
            return Ok(());
        }
        speaks_alike(self.client.is_some(), bytes, over).map_err(|text| Cut {
            is_final: true,
            is_kept: false,
            text: text.to_owned(),
        })
    }

    /// From the run to the sender, and back.
    fn take_over(&mut self) {
        let linked = self.sender.status().linked;
        if linked {
            self.heard_of = Some(Instant::now());
            if let Some(since) = self.kept_since.take() {
                eprintln!("notice: the machine is free after {:.1} s", since.elapsed().as_secs_f64());
                self.lock().waits = false;
            }
        }
        if linked && !std::mem::replace(&mut self.linked, linked) {
            self.lock().leases += 1;
            if let Some(since) = self.cut_at.take() {
                eprintln!(
                    "notice: the link to the controller is back after {:.1} s",
                    since.elapsed().as_secs_f64()
                );
            }
        }
        loop {
            if self.command.is_none() {
                match self.commands.try_recv() {
                    Ok(command) => self.command = Some(command),
                    Err(TryRecvError::Empty | TryRecvError::Disconnected) => break,
                }
            }
            if let Some(command) = self.command.take()
                && let Err(back) = self.sender.push(command)
            {
                self.command = Some(back);
                break;
            }
        }
        while let Ok(load) = self.loads.try_recv() {
            self.sender.load(load);
        }
        while let Some(answer) = self.sender.loaded() {
            // Nobody waits for it any more when the run is over.
            let _ = self.loaded.send(answer);
        }
        while let Ok(request) = self.requests.try_recv() {
            self.sender.request(request);
        }
        let approach = self.lock().approach;
        self.sender.allow_approach(approach);
        if !self.over && self.lock().over {
            self.over = true;
            self.sender.finish();
        }
        let recording = self.lock().recording;
        let mut last = None;
        while let Some(report) = self.sender.report() {
            last = Some(report);
            let until = report.sample.tick;
            let firings: Vec<Firing> = std::iter::from_fn(|| self.sender.firing(until)).collect();
            if recording && self.report.len() < MOST_BEHIND {
                self.report.push_back(Heard { report, firings });
            } else if recording {
                self.not_kept += 1;
                self.firings_not_kept += firings.len() as u64;
            }
        }
        while let Some(report) = self.report.pop_front() {
            if let Err(TrySendError::Full(back)) = self.reports.try_send(report) {
                self.report.push_front(back);
                break;
            }
        }
        let (status, lost) = (self.sender.status(), self.sender.lost_reports());
        let lost_firings = self.sender.lost_firings() + self.firings_not_kept;
        let machine = self.sender.machine().map(|welcome| Machine {
            name: welcome.machine.text().to_owned(),
            quality: welcome.quality,
        });
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        (shared.status, shared.lost_reports, shared.machine) = (status, lost + self.not_kept, machine);
        (shared.lost_firings, shared.begun_anew) = (lost_firings, self.sender.begun_anew());
        shared.last = last.or(shared.last);
    }
}

/// A connection to a controller.
///
/// # Errors
/// Nobody is there, in words.
pub fn dial(to: &[SocketAddr], client: Option<&Client>) -> Result<Socket, String> {
    let mut last = "there is no such host".to_owned();
    for address in to {
        let made = TcpStream::connect_timeout(address, CONNECT).and_then(|stream| {
            let tls = client.map(Client::connection).transpose()?;
            Socket::new(stream, tls)
        });
        match made {
            Ok(socket) => return Ok(socket),
            Err(error) => last = format!("{error}: is toolmark controller running there?"),
        }
    }
    Err(last)
}

/// Says what is wrong where one side speaks encrypted and the other does not, by the first bytes that came.
///
/// # Errors
/// It is so, in words.
pub fn speaks_alike(encrypted: bool, bytes: &[u8], over: bool) -> Result<(), &'static str> {
    match encrypted {
        false if bytes.starts_with(&TLS_ALERT) => Err(
            "it takes encrypted connections only: give certificate, key and authority in [link] of the machine file (--machine-file)",
        ),
        true if over && bytes.is_empty() => Err(
            "it closed the encrypted connection before it said who it is: it has no certificates itself, or does not take this \
                 side's; what it says where it runs tells which",
        ),
        _ => Ok(()),
    }
}

/// Why a connection ended.
struct Cut {
    is_final: bool,
    /// The machine is kept for another one that is gone.
    is_kept: bool,
    text: String,
}

impl From<LinkError> for Cut {
    fn from(error: LinkError) -> Self {
        Cut {
            is_final: error.is_final(),
            is_kept: matches!(error, LinkError::Refused(Refusal::Left { .. })),
            text: error.to_string(),
        }
    }
}

impl From<std::io::Error> for Cut {
    fn from(error: std::io::Error) -> Self {
        Cut {
            is_final: false,
            is_kept: false,
            text: error.to_string(),
        }
    }
}

//! The office's side of the link: takes what the office half would push into the machine's queue, and gives the reports that it would
//! take from there.
//!
//! Blocks go out as the machine has room for them, each with a stop tail. When the machine had to use one, or lost its queue, the sender
//! finds the place at which it stands on the plan, and goes on from there once a person gives cycle start: what was in force is brought
//! about again (spindle, coolant), then the machine gets back onto the plan along its path.

mod beginning;
mod blocks;
mod hearing;

use blocks::Stretch;

use super::error::LinkError;
use super::loads::{Load, Loads};
use super::scaled::{Pose, Posed, RampEnd, Scaler};
use super::stock::{Stock, needs_rest};
use super::wire::{Came, Wired};
use machine::link::message::{
    AXES, BLOCK, BlockHead, HEARTBEAT, Hello, LOOK_AHEAD, ReportsHead, SILENCE, SenderHeartbeat, TAIL, UNITS, Welcome,
};
use machine::link::{Entry, Kind, LimitsHash, Loaded, Name, PlanId, Reader, Status, Urgent, Wire};
use machine::watch::{Firing, FiringKind};
use machine::{Command, MachineParameters, Report, Request, State, StopCause};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use units::Tick;

/// Smaller blocks wait for more: each has a tail.
const WORTH_SENDING: usize = 32;
/// Cycles without a new command after which what is there is all there is for now.
const DRY: u64 = 20;
/// Reports after which the controller is told that they have come.
const TELL_REPORTS: u64 = 100;
/// Cycles of the plan beyond what is known to be done in which the machine may stand.
const SEARCHED: u64 = 700;
/// A machine this near to the path is on it, mm.
const ON_PATH: f64 = 0.05;

/// How far the sender and its machine are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SenderStatus {
    /// A session is open on the present connection.
    pub linked: bool,
    /// The machine stands, or will, and goes on only after [`Request::CycleStart`].
    pub waits_for_start: bool,
    /// Cycle start was given, and the machine stands this far from the path, mm: [`LinkSender::allow_approach`] lets it go back.
    pub displaced: Option<f64>,
    /// Commands of the plan that are done.
    pub done: u64,
    /// Path length at the last set-point that is done, mm.
    pub path_length: f64,
    /// Entries on their way to the machine or in its queue.
    pub ahead: u64,
    /// Blocks sent.
    pub blocks: u64,
    /// Times the machine was led back onto the plan.
    pub resumed: u64,
    /// Of those, times from beside the path.
    pub approaches: u64,
    /// Cycle starts that were asked for without a connection, and not kept: a start that comes late is none.
    pub starts_not_sent: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    Apart,
    Greeting,
    Linked,
}

/// The office's side of the link.
#[derive(Clone, Debug)]
pub struct LinkSender {
    name: Name,
    plan: PlanId,
    parameters: MachineParameters,
    line: Line,
    wired: Wired,
    session: u32,
    welcome: Option<Welcome>,
    status: Status,
    stock: Stock,
    stretch: Stretch,
    /// Blocks may be sent.
    streaming: bool,
    /// The first beginning needs no person: it is the start of the run.
    first_begin: bool,
    start_asked: bool,
    /// Cycle start goes out when enough of the stretch is there.
    start_when_taken: bool,
    began_at: Tick,
    allowed_approach: f64,
    displaced: Option<f64>,
    urgent: VecDeque<Urgent>,
    unacknowledged: Vec<(u32, Urgent)>,
    reports: VecDeque<Report>,
    next_report: u64,
    told_reports: u64,
    firings: VecDeque<Firing>,
    next_firing: u64,
    /// Conditions that have fired, as far as was heard.
    fired: BTreeSet<u16>,
    /// Conditions that somebody has ended by hand, with how many commands were done then: they are not taken up again.
    ended: BTreeMap<u16, u64>,
    /// What sessions before the present one had lost.
    lost_before: (u64, u64),
    /// Sessions that a controller began which knew nothing of the one before.
    begun_anew: u64,
    loads: Loads,
    last: Option<Report>,
    pushed: bool,
    pushed_at: Tick,
    finishing: bool,
    counts: SenderStatus,
}

impl LinkSender {
    /// A sender of one plan. `name` is what another sender will read while this one has the lease.
    pub fn new(name: &str, plan: PlanId, parameters: &MachineParameters) -> Self {
        LinkSender {
            name: Name::new(name),
            plan,
            parameters: *parameters,
            line: Line::Apart,
            wired: Wired::new(Tick(0)),
            session: 0,
            welcome: None,
            status: Status::default(),
            stock: Stock::new(),
            stretch: Stretch::default(),
            streaming: false,
            first_begin: true,
            start_asked: false,
            start_when_taken: false,
            began_at: Tick(0),
            allowed_approach: ON_PATH,
            displaced: None,
            urgent: VecDeque::new(),
            unacknowledged: Vec::new(),
            reports: VecDeque::new(),
            next_report: 0,
            told_reports: 0,
            firings: VecDeque::new(),
            next_firing: 0,
            fired: BTreeSet::new(),
            ended: BTreeMap::new(),
            lost_before: (0, 0),
            begun_anew: 0,
            loads: Loads::default(),
            last: None,
            pushed: false,
            pushed_at: Tick(0),
            finishing: false,
            counts: SenderStatus::default(),
        }
    }

    /// So many commands of the plan were done when it was left: for a sender that is started again and a controller that was, too, and knows
    /// nothing. A controller that knows more is believed.
    pub fn known_done(&mut self, count: u64) {
        self.stock.done(count);
    }

    /// These conditions had fired when the plan was left: for the same. A machine that was reset or started again does not fire one a second
    /// time that fires once.
    pub fn known_fired(&mut self, watches: impl IntoIterator<Item = u16>) {
        self.fired.extend(watches);
    }

    /// Conditions that have fired, for [`LinkSender::known_fired`] of the next sender of this plan.
    pub fn fired(&self) -> &BTreeSet<u16> {
        &self.fired
    }

    /// Times that the controller knew nothing of what it had been given: it was started again, or another sender had it. What it had not
    /// told until then is lost, nobody knows how much; its conditions are taken up again when the machine goes on.
    pub fn begun_anew(&self) -> u64 {
        self.begun_anew
    }

    /// Takes the next command of the plan, as the machine's queue would.
    ///
    /// # Errors
    /// Gives it back when there are enough: keep it and try again.
    pub fn push(&mut self, command: Command) -> Result<(), Command> {
        self.stock.push(command)?;
        self.pushed = true;
        Ok(())
    }

    /// A request of a person, or of the office for one.
    pub fn request(&mut self, request: Request) {
        match request {
            Request::CycleStart if !self.streaming => self.start_asked = true,
            Request::CycleStart if self.line != Line::Linked => self.counts.starts_not_sent += 1,
            request => self.urgent.push_back(Urgent::Request(request)),
        }
    }

    /// The next report of the machine.
    pub fn report(&mut self) -> Option<Report> {
        self.reports.pop_front()
    }

    /// The oldest firing up to a cycle that was not taken yet: those of a cycle belong to its report.
    pub fn firing(&mut self, until: Tick) -> Option<Firing> {
        self.firings.pop_front_if(|firing| firing.tick <= until)
    }

    /// Firings that were lost on the way, in all.
    pub fn lost_firings(&self) -> u64 {
        self.lost_before.1 + self.status.lost_firings
    }

    /// Takes a condition or a tool that the machine is to know. Nothing of the plan goes out before all that was taken until then is
    /// decided; what is given while it runs is for commands that are given after its answer ([`LinkSender::loaded`]).
    pub fn load(&mut self, load: Load) {
        self.loads.push(load);
    }

    /// The next answer to a load, in the order in which they were given.
    pub fn loaded(&mut self) -> Option<Loaded> {
        self.loads.answer()
    }

    /// Reports that were lost on the way, in all: a gap in the record.
    pub fn lost_reports(&self) -> u64 {
        self.lost_before.0 + self.status.lost_reports
    }

    /// Lets the machine go back to the path straight and slowly (10 mm/s) from so far away, mm. What lies between is for the person to know.
    pub fn allow_approach(&mut self, distance: f64) {
        self.allowed_approach = distance.max(ON_PATH);
    }

    /// The plan is over, or given up: the lease is given back with the next output.
    pub fn finish(&mut self) {
        self.finishing = true;
    }

    /// What the machine said of itself.
    pub fn machine(&self) -> Option<&Welcome> {
        self.welcome.as_ref()
    }

    /// How far it is.
    pub fn status(&self) -> SenderStatus {
        SenderStatus {
            linked: self.line == Line::Linked,
            waits_for_start: !self.streaming && !self.first_begin && !self.stock.is_over(),
            displaced: self.displaced,
            done: self.stock.count_done(),
            path_length: self.status.path_length,
            ahead: self.stretch.sent.saturating_sub(self.stretch.first),
            ..self.counts
        }
    }

    /// A connection is there.
    pub fn connected(&mut self, now: Tick) {
        self.wired = Wired::new(now);
        self.line = Line::Greeting;
    }

    /// It is gone. A stop or a hold that may not have arrived is sent again on the next one.
    pub fn disconnected(&mut self, _now: Tick) {
        self.line = Line::Apart;
        (self.start_asked, self.start_when_taken) = (false, false);
        let unheard = self.unacknowledged.drain(..).map(|(_, urgent)| urgent);
        let again: Vec<Urgent> = unheard.chain(self.urgent.drain(..)).collect();
        for urgent in again {
            match urgent {
                Urgent::Request(Request::Stop | Request::Hold) => self.urgent.push_back(urgent),
                Urgent::Request(Request::CycleStart) => self.counts.starts_not_sent += 1,
                _ => {}
            }
        }
    }

    /// Bytes came.
    ///
    /// # Errors
    /// The connection is to be closed.
    pub fn receive(&mut self, now: Tick, bytes: &[u8]) -> Result<(), LinkError> {
        if self.line == Line::Apart {
            return Ok(());
        }
        let mut bytes = bytes;
        while let Some(came) = self.wired.next(now, &mut bytes)? {
            self.frame(&came)?;
        }
        let heard = self.wired.acknowledged;
        self.unacknowledged.retain(|(sequence, _)| *sequence > heard);
        Ok(())
    }

    /// Appends what is to be written.
    ///
    /// # Errors
    /// The machine has been silent for too long: the connection is to be closed.
    pub fn output(&mut self, now: Tick, out: &mut Vec<u8>) -> Result<(), LinkError> {
        if std::mem::take(&mut self.pushed) {
            self.pushed_at = now;
        }
        if self.line == Line::Apart {
            return Ok(());
        }
        if now.0.saturating_sub(self.wired.heard.0) > SILENCE {
            return Err(LinkError::Silent);
        }
        if self.line == Line::Greeting {
            self.greet(now, out);
            return Ok(());
        }
        self.tell_urgent(now, out);
        self.tell_loads(now, out);
        self.begin(now, out);
        self.tell_blocks(now, out);
        if self.finishing {
            self.wired.send(now, Kind::Goodbye, out, |_| {});
            self.line = Line::Apart;
            return Ok(());
        }
        let quiet = now.0.saturating_sub(self.wired.spoke.0) >= HEARTBEAT;
        if quiet || self.next_report >= self.told_reports + TELL_REPORTS {
            let heartbeat = SenderHeartbeat {
                reports: self.next_report,
                firings: self.next_firing,
            };
            self.told_reports = self.next_report;
            self.wired.send(now, Kind::Heartbeat, out, |to| heartbeat.write(to));
        }
        Ok(())
    }

    fn greet(&mut self, now: Tick, out: &mut Vec<u8>) {
        let hello = Hello {
            units: UNITS,
            axes: AXES,
            name: self.name,
            plan: self.plan,
            limits: LimitsHash::of(&self.parameters),
            session: self.session,
            reports: self.next_report,
            firings: self.next_firing,
        };
        if !self.wired.spoken() {
            self.wired.send(now, Kind::Hello, out, |to| hello.write(to));
        }
    }
}

/// What goes to the machine.
impl LinkSender {
    fn tell_urgent(&mut self, now: Tick, out: &mut Vec<u8>) {
        while let Some(urgent) = self.urgent.pop_front() {
            self.say(now, urgent, out);
        }
        let there = self.status.epoch == self.stretch.epoch
            && self.status.taken > 0
            && self.status.taken >= self.stretch.sent.min(BLOCK as u64);
        if self.start_when_taken && there {
            self.start_when_taken = false;
            self.say(now, Urgent::Request(Request::CycleStart), out);
        }
    }

    fn say(&mut self, now: Tick, urgent: Urgent, out: &mut Vec<u8>) {
        let sequence = self.wired.send(now, Kind::Urgent, out, |to| urgent.write(to));
        self.unacknowledged.push((sequence, urgent));
    }

    fn tell_loads(&mut self, now: Tick, out: &mut Vec<u8>) {
        while let Some((number, load)) = self.loads.next() {
            self.wired.send(now, Kind::Load, out, |to| load.write(number, to));
        }
    }
}

//! The office's side of the link: takes what the office half would push into the machine's queue, and gives the reports that it would
//! take from there.
//!
//! Blocks go out as the machine has room for them, each with a stop tail. When the machine had to use one, or lost its queue, the sender
//! finds the place at which it stands on the plan, and goes on from there once a person gives cycle start: what was in force is brought
//! about again (spindle, coolant), then the machine gets back onto the plan along its path.

use super::error::LinkError;
use super::loads::{Load, Loads};
use super::scaled::{Pose, Posed, RampEnd, Scaler};
use super::stock::{Stock, needs_rest};
use super::wire::{Came, Wired};
use machine::link::message::{
    AXES, BLOCK, BlockHead, HEARTBEAT, Hello, LOOK_AHEAD, ReportsHead, SILENCE, SenderHeartbeat, TAIL, UNITS, Welcome,
};
use machine::link::{Entry, Kind, LimitsHash, Loaded, Name, PlanId, Reader, Status, Urgent, Wire};
use machine::watch::Firing;
use machine::{Command, MachineParameters, Report, Request, State, StopCause};
use std::collections::{BTreeSet, VecDeque};
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

/// What is being sent since the machine stood last.
#[derive(Clone, Debug, Default)]
struct Stretch {
    epoch: u32,
    /// Not yet executed, from entry `first` on; those of the plan are put here when they are needed.
    entries: VecDeque<Posed>,
    first: u64,
    /// Set-points before the first of them.
    cycle: u64,
    /// Entries sent.
    sent: u64,
    /// The command of the plan that follows the last entry.
    next: u64,
    /// The last set-point before the first entry was a rest.
    rested: bool,
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
            waits_for_start: !self.streaming && !self.first_begin,
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

/// What comes from the machine.
impl LinkSender {
    fn frame(&mut self, came: &Came) -> Result<(), LinkError> {
        match (self.line, came.header.kind) {
            (Line::Greeting, Kind::Welcome) => self.welcomed(came.message()?),
            (Line::Greeting, Kind::Refusal) => Err(LinkError::Refused(came.message()?)),
            (Line::Greeting, _) => Err(LinkError::Rules("a controller answers a hello first")),
            (Line::Linked, Kind::Heartbeat) => self.hear(came.message()?),
            (Line::Linked, Kind::Reports) => self.hear_reports(came),
            (Line::Linked, _) => Err(LinkError::Rules("only a sender sends such a frame")),
            (Line::Apart, _) => Ok(()),
        }
    }

    fn welcomed(&mut self, welcome: Welcome) -> Result<(), LinkError> {
        if welcome.limits != LimitsHash::of(&self.parameters) {
            return Err(LinkError::Limits {
                machine: welcome.machine.text().to_owned(),
                found: welcome.limits,
            });
        }
        self.line = Line::Linked;
        if self.session != 0 && !welcome.continues {
            self.begun_anew += 1;
            self.lost_before = (self.lost_reports(), self.lost_firings());
        }
        self.session = welcome.session;
        self.wired.session = welcome.session;
        self.welcome = Some(welcome);
        let status = welcome.status;
        let same_plan = welcome.plan == self.plan;
        self.loads.connected(welcome.continues);
        if welcome.continues {
            if status.needs_resume || welcome.epoch != self.stretch.epoch || !self.streaming {
                self.streaming = false;
            } else {
                self.stretch.sent = welcome.wanted.clamp(self.stretch.first, self.stretch.sent);
            }
        } else {
            self.streaming = false;
            (self.next_report, self.next_firing) = (status.reports, status.firings);
            if let Some(done) = status.done.filter(|_| same_plan) {
                self.stock.done(done);
            }
            self.first_begin &= self.stock.count_done() == 0;
        }
        // The next stretch must not be taken for an older one.
        if !self.streaming {
            self.stretch.epoch = self.stretch.epoch.max(welcome.epoch).max(status.epoch);
        }
        self.status = Status {
            epoch: u32::MAX,
            ..status
        };
        Ok(())
    }

    fn hear_reports(&mut self, came: &Came) -> Result<(), LinkError> {
        let mut reader = Reader::new(&came.payload);
        let wrong = |error| came.wrong(error);
        let head = ReportsHead::read(&mut reader).map_err(wrong)?;
        for number in (head.first..).take(usize::from(head.count)) {
            let report = Report::read(&mut reader).map_err(wrong)?;
            if number >= self.next_report {
                self.next_report = number + 1;
                self.last = Some(report);
                self.reports.push_back(report);
            }
        }
        for number in (head.first_firing..).take(usize::from(head.firings)) {
            let firing = Firing::read(&mut reader).map_err(wrong)?;
            if number >= self.next_firing {
                self.next_firing = number + 1;
                if firing.known {
                    self.fired.insert(firing.watch);
                }
                self.firings.push_back(firing);
            }
        }
        reader.end().map_err(wrong)?;
        self.hear(head.status)
    }

    fn hear(&mut self, status: Status) -> Result<(), LinkError> {
        self.status = status;
        if status.session != self.session {
            return Ok(());
        }
        self.loads.hear(&status.loads)?;
        if let Some(done) = status.done {
            self.stock.done(done);
        }
        if status.epoch != self.stretch.epoch || !self.streaming {
            return Ok(());
        }
        while self.stretch.first < status.executed.min(self.stretch.sent) {
            if let Some(Posed { entry, .. }) = self.stretch.entries.pop_front()
                && let Command::SetPoint(set_point) = entry.command
            {
                self.stretch.cycle += 1;
                self.stretch.rested = set_point.velocity == [0.0; 3];
            }
            self.stretch.first += 1;
        }
        if status.needs_resume {
            self.streaming = false;
            self.start_when_taken = false;
        }
        Ok(())
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

    /// Begins where the machine stands, when it may.
    fn begin(&mut self, now: Tick, out: &mut Vec<u8>) {
        if self.streaming {
            // It did not take it: it was not at rest after all.
            if self.status.epoch != self.stretch.epoch && now.0.saturating_sub(self.began_at.0) > SILENCE {
                self.streaming = false;
            }
            return;
        }
        let Some(report) = self.last.filter(|_| self.start_asked || self.first_begin) else {
            return;
        };
        let ready = report.state == State::Ready;
        let stands = matches!(report.state, State::Held | State::Paused | State::Stopped(StopCause::Starved));
        let known = self.stock.count_done() > 0;
        if !self.loads.all_decided() {
            return;
        }
        if !(ready || (stands && known)) || self.is_filling(now) {
            return;
        }
        let Some((entries, next)) = self.way_on(&report) else {
            return;
        };
        let done = self.stock.count_done();
        self.stretch = Stretch {
            epoch: self.stretch.epoch.wrapping_add(1),
            entries: entries.into(),
            first: 0,
            cycle: 0,
            sent: 0,
            next,
            rested: true,
        };
        self.counts.resumed += u64::from(!self.first_begin);
        self.start_when_taken = !ready;
        (self.streaming, self.first_begin, self.start_asked, self.began_at) = (true, false, false, now);
        let epoch = self.stretch.epoch;
        self.say(now, Urgent::Resume { epoch, done }, out);
    }

    /// True while more of the plan is to be expected that is needed to begin.
    fn is_filling(&self, now: Tick) -> bool {
        let done = self.stock.count_done();
        let enough = self.stock.end() > done + SEARCHED;
        let dry = now.0.saturating_sub(self.pushed_at.0) >= DRY;
        done > 0 && !enough && !(dry && self.stock.end() > done)
    }

    /// What leads from where the machine stands onto the plan, and the command of the plan that follows.
    fn way_on(&mut self, report: &Report) -> Option<(Vec<Posed>, u64)> {
        let done = self.stock.count_done();
        let position = report.sample.commanded;
        let scaler = Scaler::new(&self.stock, &self.parameters);
        let base = self.stock.last_done_cycle();
        // No motion is known of, but there may have been some: sender and controller may both have died in the first one.
        let unknown = || scaler.first_place(SEARCHED, position, ON_PATH, done);
        let place = match base {
            Some(base) => Some(scaler.nearest(base, SEARCHED, position)?),
            None => unknown().filter(|_| !self.first_begin),
        };
        let Some((mut phase, distance)) = place else {
            // What is done is switching, and it is done again only on a machine that knows nothing of it.
            let entries = self.ready_again(done, report).into_iter().filter(|_| done > 0).collect();
            return Some((entries, done + 1));
        };
        if distance > ON_PATH {
            if distance > self.allowed_approach {
                self.displaced = Some(distance);
                return None;
            }
            // Back to where the plan was left, or begins.
            phase = base.unwrap_or(0) as f64;
        }
        let lead = scaler.lead(phase, position, done);
        if lead.end != RampEnd::Done {
            return None;
        }
        self.counts.approaches += u64::from(distance > ON_PATH);
        self.displaced = None;
        let passed = self
            .stock
            .set_point(libm::floor(phase) as u64)
            .map_or(done, |(_, number)| number.max(done));
        let mut entries = self.passed_orders(done, passed);
        // Nothing is in force before the first command.
        if passed > 0 {
            entries.extend(self.ready_again(passed, report));
        }
        let next = lead.entries.last().map_or(passed, |e| e.entry.done) + 1;
        entries.extend(lead.entries);
        Some((entries, next))
    }

    /// Brings about what is in force where so many commands are done.
    fn ready_again(&self, done: u64, report: &Report) -> Vec<Posed> {
        let in_force = self.stock.in_force(done);
        let mut commands = in_force.commands(report.sample.tool);
        // On a machine that was reset or started again conditions of its program are over. It may be reset as late as now.
        commands.extend(in_force.watch_commands(&self.fired));
        commands.into_iter().map(|command| standing(command, done)).collect()
    }

    /// Orders for watches between what is done and where the machine stands: drives that stopped by themselves went past them.
    fn passed_orders(&self, done: u64, passed: u64) -> Vec<Posed> {
        let between = (done + 1..=passed).filter_map(|number| Some((number, *self.stock.command(number)?)));
        between
            .filter(|(_, command)| matches!(command, Command::Watch { .. }))
            .map(|(number, command)| standing(command, number))
            .collect()
    }

    fn tell_blocks(&mut self, now: Tick, out: &mut Vec<u8>) {
        while self.streaming {
            let executed = if self.status.epoch == self.stretch.epoch {
                self.status.executed
            } else {
                0
            };
            let credit = (executed + LOOK_AHEAD).saturating_sub(self.stretch.sent);
            let from = (self.stretch.sent - self.stretch.first) as usize;
            let most = from + (credit as usize).min(BLOCK);
            self.stretch.provide(&self.stock, most);
            let mut end = most.min(self.stretch.entries.len());
            let dry = now.0.saturating_sub(self.pushed_at.0) >= DRY;
            let mut tail = self.tail_after(end);
            if tail.is_none() && !dry {
                // As far as it comes to rest by itself.
                end = (from + 1..end)
                    .rev()
                    .find(|&end| !self.stretch.moves_before(end))
                    .unwrap_or(from);
                tail = Some(Vec::new());
            }
            let tail = tail.unwrap_or_default();
            let rests = !self.stretch.moves_before(end);
            if end == from || (end - from < WORTH_SENDING && !rests && !(dry && self.stretch.next >= self.stock.end())) {
                return;
            }
            self.tell_block(now, from, end, &tail, out);
        }
    }

    fn tell_block(&mut self, now: Tick, from: usize, end: usize, tail: &[Entry], out: &mut Vec<u8>) {
        let s = &self.stretch;
        let set_points = s.entries.range(..from).filter(|e| is_set_point(e)).count() as u64;
        let head = BlockHead {
            epoch: s.epoch,
            first: s.sent,
            cycle: s.cycle + set_points,
            body: (end - from) as u16,
            tail: tail.len() as u16,
        };
        let body = s.entries.range(from..end);
        self.wired.send(now, Kind::Block, out, |to| {
            head.write(to);
            body.for_each(|posed| posed.entry.write(to));
            tail.iter().for_each(|entry| entry.write(to));
        });
        self.stretch.sent += (end - from) as u64;
        self.counts.blocks += 1;
    }

    /// The stop tail behind the first `end` entries; `None`: the plan is not known far enough. Empty where they end at rest.
    fn tail_after(&mut self, end: usize) -> Option<Vec<Entry>> {
        let mut tail = Vec::new();
        if !self.stretch.moves_before(end) {
            return Some(tail);
        }
        for index in end.. {
            self.stretch.provide(&self.stock, index + 1);
            let posed = *self.stretch.entries.get(index)?;
            if needs_rest(&posed.entry.command) {
                // The controller brings what is left of the speed to rest itself: it is less than an axis can take away in a cycle.
                return Some(Vec::new());
            }
            tail.push(posed.entry);
            if let Command::SetPoint(set_point) = posed.entry.command {
                if set_point.velocity == [0.0; 3] {
                    return Some(tail);
                }
                let ramp = Scaler::new(&self.stock, &self.parameters).tail(posed.pose, posed.entry.done);
                if ramp.end == RampEnd::NoPlan {
                    return None;
                }
                tail.extend(ramp.entries.iter().map(|posed| posed.entry));
                tail.truncate(TAIL);
                return Some(tail);
            }
        }
        None
    }
}

impl Stretch {
    /// Has so many entries, as far as the plan is known.
    fn provide(&mut self, stock: &Stock, count: usize) {
        while self.entries.len() < count {
            let Some(command) = stock.command(self.next) else { return };
            let phase = match self.entries.back() {
                _ if is(command) => stock.cycle_of(self.next) as f64,
                Some(before) => before.pose.phase,
                None => 0.0,
            };
            self.entries.push_back(Posed {
                entry: Entry {
                    command: *command,
                    done: self.next,
                },
                pose: Pose { phase, rate: 1.0 },
            });
            self.next += 1;
        }
    }

    /// True when the path is in motion behind the first `end` entries.
    fn moves_before(&self, end: usize) -> bool {
        for posed in self.entries.range(..end).rev() {
            match posed.entry.command {
                Command::SetPoint(s) => return s.velocity != [0.0; 3],
                command if needs_rest(&command) => return false,
                _ => {}
            }
        }
        !self.rested
    }
}

/// An entry of a machine that stands.
fn standing(command: Command, done: u64) -> Posed {
    Posed {
        entry: Entry { command, done },
        pose: Pose { phase: 0.0, rate: 0.0 },
    }
}

fn is(command: &Command) -> bool {
    matches!(command, Command::SetPoint(_))
}

fn is_set_point(posed: &Posed) -> bool {
    is(&posed.entry.command)
}

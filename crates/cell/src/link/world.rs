//! The simulated world with a link between its two halves: sender and office on one side, receiver, follower and machine on the other,
//! and a wire with faults between them. The person stands at the machine and gives cycle start after a stop.

mod fault;

pub use fault::LinkFault;

use super::channel::Way;
use super::loads::{Load, number_of};
use super::receiver::{Connection, LinkReceiver, MachineCard};
use super::sender::LinkSender;
use crate::office::{Ended, OfficeHalf, Operator};
use crate::sink::RecordSink;
use crate::source::CommandSource;
use ledger::Chain;
use machine::link::{Follower, Loaded, Order, PlanId};
use machine::watch::FiringKind;
use machine::{MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, State};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use trace::record::Recorder;
use trace::survey::Found;
use units::{Machine, Millimetres, Point, Tick, Timestamp, ToolNumber};

/// What a linked world is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkedConfig {
    /// Decides every noise, on the machine and on the wire.
    pub seed: u64,
    /// The moment of tick 0.
    pub start: Timestamp,
    /// The machine.
    pub machine: MachineParameters,
    /// Where its axes stand.
    pub position: Point<Machine>,
    /// The plan's id.
    pub plan: PlanId,
    /// Cycles that bytes are under way, at least and at most.
    pub delay: (u64, u64),
    /// Reports that go together.
    pub batch: usize,
    /// The person.
    pub operator: Operator,
    /// What goes wrong.
    pub faults: Vec<LinkFault>,
    /// After a run that ended with a fault or a stop the person acknowledges it, and starts the same program again where it was left: so
    /// many times at most.
    pub restarts: u32,
}

impl Default for LinkedConfig {
    /// A small machining centre at its home on a wire without delay or faults, reports one by one, a person who waits 50 cycles.
    fn default() -> Self {
        LinkedConfig {
            seed: 1,
            start: Timestamp(0),
            machine: MachineParameters::small_machining_centre(),
            position: Point::ORIGIN,
            plan: PlanId([1; 32]),
            delay: (0, 0),
            batch: 1,
            operator: Operator {
                optional_stop: false,
                cycle_start_after: Some(50),
            },
            faults: Vec::new(),
            restarts: 0,
        }
    }
}

/// Cycles between a closed connection and the next.
const RECONNECT: u64 = 20;
/// Cycles for which the person looks at a machine that waits.
const LOOKING: u64 = 100;
/// Distance from which the person lets a machine go back to its path, mm: a first motion as far as the queue reaches, and the drives' stop.
const LET_BACK: f64 = 200.0;

/// What the functions of a program come to: what a look through it gave, a recorder made with that, and the diameters of tools.
pub type Functions = (Found, Recorder, Vec<(ToolNumber, Millimetres)>);

/// A machine, a wire and an office.
pub struct LinkedWorld<'a, S> {
    config: LinkedConfig,
    program: Box<dyn Fn() -> S + 'a>,
    functions: Option<Box<dyn Fn() -> Functions + 'a>>,
    /// Loads that are not the office's: their answers have to be these.
    beforehand: VecDeque<Loaded>,
    /// The sender has what the office wants loaded.
    load_given: bool,
    office: Option<(OfficeHalf<'static, S>, LinkSender)>,
    realtime: Box<RealtimeHalf<Plant>>,
    /// The controller's process runs.
    controls: bool,
    follower: Box<Follower>,
    held_order: Option<Order>,
    receiver: LinkReceiver,
    to_machine: Way,
    to_office: Way,
    connection: Option<Connection>,
    connections: Connection,
    connect_at: Tick,
    unreachable_until: Tick,
    sender_back_at: Option<Tick>,
    controller_back_at: Option<Tick>,
    ending: bool,
    now: Tick,
    waited: u64,
    /// Times that drives were left alone in motion.
    pub left_alone: u64,
    last: Option<Report>,
    restarts: u32,
    /// Times that senders before the present one led the machine back onto its plan, and of those, from beside the path.
    earlier: (u64, u64),
    /// Commands that are known to be done, and conditions that are known to have fired.
    known_done: u64,
    known_fired: BTreeSet<u16>,
    /// Firings that the machine made, by condition.
    made: BTreeMap<u16, u64>,
    /// The person acknowledges what stopped the machine.
    resets: bool,
}

impl<'a, S: CommandSource> LinkedWorld<'a, S> {
    /// A world in which nothing has happened yet; `program` gives the plan from its beginning, each time the same.
    pub fn new(config: LinkedConfig, program: impl Fn() -> S + 'a) -> Self {
        let plant = Plant::new(&config.machine, config.position, config.seed);
        let realtime = started(&config, plant);
        let mut world = LinkedWorld {
            receiver: LinkReceiver::new(card(&config)),
            to_machine: Way::new(config.delay, config.seed ^ 0x6f74),
            to_office: Way::new(config.delay, config.seed ^ 0x6d6f_7266),
            program: Box::new(program),
            functions: None,
            beforehand: VecDeque::new(),
            load_given: false,
            office: None,
            realtime,
            controls: true,
            follower: Box::new(Follower::new()),
            held_order: None,
            connection: None,
            connections: 0,
            connect_at: Tick(0),
            unreachable_until: Tick(0),
            sender_back_at: None,
            controller_back_at: None,
            ending: false,
            now: Tick(0),
            waited: 0,
            left_alone: 0,
            last: None,
            restarts: 0,
            earlier: (0, 0),
            known_done: 0,
            known_fired: BTreeSet::new(),
            made: BTreeMap::new(),
            resets: false,
            config,
        };
        world.start_sender();
        world
    }

    /// Does what the functions of the program say, as [`crate::World::with_functions`]; each sender that is started asks for them anew.
    pub fn with_functions(mut self, functions: impl Fn() -> Functions + 'a) -> Self {
        self.functions = Some(Box::new(functions));
        self.start_sender();
        self
    }

    /// The next tick.
    pub fn now(&self) -> Tick {
        self.now
    }

    /// A request of a person at the sender.
    pub fn request(&mut self, request: Request) {
        if let Some((_, sender)) = &mut self.office {
            sender.request(request);
        }
    }

    /// Firings that the machine made, whoever heard of them, by condition.
    pub fn firings_made(&self) -> &BTreeMap<u16, u64> {
        &self.made
    }

    /// The sender, while it runs.
    pub fn sender(&self) -> Option<&LinkSender> {
        self.office.as_ref().map(|o| &o.1)
    }

    /// The office half, while it runs.
    pub fn office(&self) -> Option<&OfficeHalf<'static, S>> {
        self.office.as_ref().map(|o| &o.0)
    }

    /// The machine's last cycle, whoever heard of it.
    pub fn reported(&self) -> Option<&Report> {
        self.last.as_ref()
    }

    /// The receiver.
    pub fn receiver(&self) -> &LinkReceiver {
        &self.receiver
    }

    /// The realtime half.
    pub fn realtime(&self) -> &RealtimeHalf<Plant> {
        &self.realtime
    }

    /// The realtime end of the link.
    pub fn follower(&self) -> &Follower {
        &self.follower
    }

    /// One cycle. `seen` looks at what the controller commands; the sink gets what the office hears. Gives how the run ended, if it has.
    pub fn advance(&mut self, sink: &mut dyn RecordSink, seen: &mut dyn FnMut(&Report)) -> Option<Ended> {
        let late = self.disturb();
        self.connect();
        if let Some((office, sender)) = &mut self.office {
            while let Some(answer) = sender.loaded() {
                match self.beforehand.pop_front() {
                    // More tools than it has places for: their cutting speeds are unavailable.
                    Some(Loaded::Tool) => {}
                    Some(expected) => assert_eq!(answer, expected, "the program's numbers are the machine's"),
                    None => {
                        self.load_given = false;
                        number_of(answer).into_iter().for_each(|number| office.loaded(number));
                    }
                }
            }
            office.refill(|command| sender.push(command));
            if !self.load_given
                && let Some((line, compiled)) = office.to_load()
            {
                self.load_given = true;
                sender.load(Load::condition(line, compiled));
            }
        }
        self.exchange();
        if late {
            self.now += 1;
            return None;
        }
        if self.controls {
            self.cycle(seen);
        }
        self.exchange();
        let mut ended = None;
        if let Some((office, sender)) = &mut self.office {
            office.machine_begun_anew(sender.begun_anew(), sink);
            while let Some(report) = sender.report() {
                while let Some(firing) = sender.firing(report.sample.tick) {
                    office.fired(firing);
                }
                if let Some(request) = office.receive(&report, None, sink) {
                    sender.request(request);
                }
            }
            office.firings_lost(sender.lost_firings());
            office.reports_lost(sender.lost_reports(), self.now, sink);
            ended = office.ended().cloned();
            self.person();
        }
        if matches!(ended, Some(Ended::Fault(_) | Ended::Stopped(_))) && self.restarts < self.config.restarts {
            self.restarts += 1;
            self.end_sender();
            self.sender_back_at = Some(self.now + LOOKING);
            self.resets = true;
            ended = None;
        }
        if self.resets && self.controls {
            self.realtime.request(Request::Reset);
            self.resets = !self.last.is_some_and(|r| r.state == State::Ready);
        }
        self.now += 1;
        ended
    }

    fn start_sender(&mut self) {
        let config = &self.config;
        let mut office = OfficeHalf::new((self.program)(), config.operator, config.start, Chain::default());
        let mut sender = LinkSender::new("the office", config.plan, &config.machine);
        (self.load_given, self.beforehand) = (false, VecDeque::new());
        if let Some((found, recorder, diameters)) = self.functions.as_ref().map(|functions| functions()) {
            office = office.with_functions(recorder);
            for (tool, diameter) in diameters {
                sender.load(Load::Tool { tool, diameter });
                self.beforehand.push_back(Loaded::Tool);
            }
            for (number, (line, compiled)) in (0..).zip(&found.conditions) {
                sender.load(Load::condition(line, compiled));
                self.beforehand.push_back(Loaded::Watch(number));
            }
        }
        sender.known_done(self.known_done);
        sender.known_fired(self.known_fired.iter().copied());
        self.office = Some((office, sender));
    }

    fn end_sender(&mut self) {
        if let Some((_, sender)) = self.office.take() {
            let status = sender.status();
            self.earlier.0 += status.resumed;
            self.earlier.1 += status.approaches;
            // What the record of the run holds.
            self.known_done = self.known_done.max(status.done);
            self.known_fired.extend(sender.fired());
        }
        self.close();
    }

    /// Times that the machine was led back onto its plan, and of those, from beside the path.
    pub fn resumed(&self) -> (u64, u64) {
        let status = self.sender().map(LinkSender::status).unwrap_or_default();
        (self.earlier.0 + status.resumed, self.earlier.1 + status.approaches)
    }

    /// One servo cycle, as the realtime thread makes it.
    fn cycle(&mut self, seen: &mut dyn FnMut(&Report)) {
        while let Some(urgent) = self.receiver.urgent() {
            self.follower.take_urgent(urgent, &mut self.realtime);
        }
        while let Some(order) = self.held_order.take().or_else(|| self.receiver.order()) {
            if let Err(back) = self.follower.take(order, &mut self.realtime) {
                self.held_order = Some(back);
                break;
            }
        }
        self.realtime.tick(self.now);
        self.follower.after_tick(&mut self.realtime);
        while let Some(told) = self.follower.lives(&mut self.realtime) {
            self.receiver.lives(self.now, told);
        }
        while let Some(report) = self.realtime.report() {
            while let Some(firing) = self.realtime.firing(report.sample.tick) {
                *self.made.entry(firing.watch).or_default() += u64::from(firing.kind == FiringKind::Fired);
                self.receiver.fired(firing);
            }
            seen(&report);
            self.last = Some(report);
            self.receiver
                .reported(self.follower.translated(report), self.follower.status());
        }
        if self.ending && self.last.is_some_and(|r| r.state == State::Off) {
            self.ending = false;
            self.end_controller();
        } else if self.ending
            && self
                .last
                .is_some_and(|r| r.state == State::Ready || matches!(r.state, State::Stopped(_)))
        {
            self.realtime.request(Request::PowerOff);
        }
    }

    /// Lets this tick's faults happen; true when the servo cycle is lost.
    fn disturb(&mut self) -> bool {
        let now = self.now;
        let mut late = false;
        for fault in self.config.faults.clone() {
            match fault {
                LinkFault::Cut { at, ticks, noticed } if at == now => {
                    (self.unreachable_until, self.connect_at) = (now + ticks, now + ticks);
                    self.to_machine.cut();
                    self.to_office.cut();
                    if noticed {
                        self.close();
                        self.connect_at = now + ticks;
                    }
                }
                LinkFault::Stall { at, ticks } if at == now => {
                    self.to_machine.hold_until(now + ticks);
                    self.to_office.hold_until(now + ticks);
                }
                LinkFault::Damaged { at, to_machine, damage } if at == now => {
                    if to_machine {
                        &mut self.to_machine
                    } else {
                        &mut self.to_office
                    }
                    .damage(damage);
                }
                LinkFault::SenderKilled { at, ticks } if at == now && self.office.is_some() => {
                    self.end_sender();
                    self.sender_back_at = Some(now + ticks);
                }
                LinkFault::ControllerRestarted { at, ticks, orderly } if at == now && self.controls => {
                    self.controller_back_at = Some(now + ticks);
                    if orderly {
                        self.ending = true;
                        self.realtime.request(Request::Stop);
                    } else {
                        self.left_alone += u64::from(self.last.is_some_and(|r| r.sample.path_speed > 0.0));
                        self.end_controller();
                    }
                }
                LinkFault::LateTicks { at, count } => late |= now >= at && now.0 < at.0 + count,
                _ => {}
            }
        }
        if self.sender_back_at.is_some_and(|at| at <= now) {
            self.sender_back_at = None;
            self.start_sender();
        }
        if !self.controls && self.controller_back_at.is_some_and(|at| at <= now) {
            self.controller_back_at = None;
            self.controls = true;
        }
        late
    }

    /// The controller's process is over; the next one will know nothing, and find the axes where they are.
    fn end_controller(&mut self) {
        self.close();
        self.controls = false;
        let plant = self.realtime.drive().clone();
        self.realtime = started(&self.config, plant);
        *self.follower = Follower::new();
        self.held_order = None;
        self.receiver = LinkReceiver::new(card(&self.config));
        self.connect_at = self.controller_back_at.unwrap_or(self.now) + 1;
    }

    fn connect(&mut self) {
        let both = self.office.is_some() && self.controls;
        if self.connection.is_some() || !both || self.now < self.connect_at || self.now < self.unreachable_until {
            return;
        }
        self.connections += 1;
        self.connection = Some(self.connections);
        self.to_machine.cut();
        self.to_office.cut();
        self.receiver.connected(self.connections, self.now);
        if let Some((_, sender)) = &mut self.office {
            sender.connected(self.now);
        }
    }

    fn close(&mut self) {
        if let Some(connection) = self.connection.take() {
            self.receiver.disconnected(connection, self.now);
            if let Some((_, sender)) = &mut self.office {
                sender.disconnected(self.now);
            }
        }
        self.connect_at = self.now + RECONNECT;
    }

    /// Bytes go to and fro until there are none for this cycle.
    fn exchange(&mut self) {
        if self.controls {
            self.receiver.pass(self.now);
        }
        let reaches = self.now >= self.unreachable_until;
        for _ in 0..8 {
            let Some(connection) = self.connection else { return };
            let mut broken = false;
            let (mut there, mut back) = (Vec::new(), Vec::new());
            if let Some((_, sender)) = &mut self.office {
                broken |= sender.output(self.now, &mut there).is_err();
            }
            if self.controls {
                broken |= !self.receiver.output(connection, self.now, &mut back);
            }
            if reaches {
                self.to_machine.send(self.now, there);
                self.to_office.send(self.now, back);
            }
            let mut moved = false;
            while let Some(bytes) = self.to_machine.arrive(self.now) {
                moved = true;
                self.receiver.receive(connection, self.now, &bytes);
            }
            while let Some(bytes) = self.to_office.arrive(self.now) {
                moved = true;
                if let Some((_, sender)) = &mut self.office {
                    broken |= sender.receive(self.now, &bytes).is_err();
                }
            }
            if broken {
                self.close();
                return;
            }
            if !moved {
                return;
            }
        }
    }

    /// The person sees a machine that waits, and lets it go on.
    fn person(&mut self) {
        let Some((_, sender)) = &mut self.office else { return };
        let status = sender.status();
        let stands = self.last.is_some_and(|r| r.state == State::Ready || r.state == State::Held);
        self.waited = if status.waits_for_start && status.linked && stands {
            self.waited + 1
        } else {
            0
        };
        if self.waited >= LOOKING && self.config.operator.cycle_start_after.is_some() {
            self.waited = 0;
            if status.displaced.is_some() {
                sender.allow_approach(LET_BACK);
            }
            sender.request(Request::CycleStart);
        }
    }
}

fn card(config: &LinkedConfig) -> MachineCard {
    MachineCard {
        batch: config.batch,
        ..MachineCard::new("sim-mill", Quality::Simulated, &config.machine)
    }
}

fn started(config: &LinkedConfig, plant: Plant) -> Box<RealtimeHalf<Plant>> {
    let mut realtime = Box::new(RealtimeHalf::new(&config.machine, plant, Quality::Simulated));
    realtime.request(Request::PowerOn);
    realtime
}

//! The default link with sound frames in a wrong order or at a wrong time: held back, dropped, given twice, from before a cut or a restart.

use cell::link::{LinkReceiver, LinkSender, Load, MachineCard};
use machine::link::{FRAME, Follower, FrameReader, Header, PlanId, write_frame};
use machine::watch::{Frequency, Operation, Relation, WatchOrder};
use machine::{Command, MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, SetPoint, State};
use std::collections::VecDeque;
use units::{Point, StepId, Tick};

/// Where the plan ends, mm along X; it goes there straight.
const END: f64 = 20.0;
/// A controller that was started again stands where its encoders say; drives that were left alone run on a little.
const NEAR: f64 = 0.1;

/// Cycles of one input at most.
const CYCLES: u32 = 4_000;

/// Each byte is something that happens. Whatever does, the axes stay on the plan's line and no faster than they can.
pub fn run(bytes: &[u8]) {
    let mut bench = Bench::new();
    for &byte in bytes {
        bench.happen(byte % 16, byte / 16);
        if bench.now >= Tick(u64::from(CYCLES)) {
            break;
        }
    }
    bench.pass(400);
}

/// A whole frame on its way.
type Whole = (Header, Vec<u8>);

/// One direction of a connection. What comes out is numbered anew, so that only the content is out of order.
struct Way {
    reader: Box<FrameReader>,
    sent: u32,
    shelf: VecDeque<Whole>,
    last: Option<Whole>,
    hold: u8,
    drop: u8,
}

impl Way {
    fn new() -> Self {
        Way {
            reader: Box::new(FrameReader::new()),
            sent: 0,
            shelf: VecDeque::new(),
            last: None,
            hold: 0,
            drop: 0,
        }
    }

    /// A new connection; what lies on the shelf is of an old one.
    fn connected(&mut self) {
        (self.reader, self.sent) = (Box::new(FrameReader::new()), 0);
    }

    fn pass(&mut self, mut bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        while let Ok(Some(frame)) = self.reader.feed(&mut bytes) {
            let whole = (frame.header, frame.payload.to_vec());
            if self.drop > 0 {
                self.drop -= 1;
            } else if self.hold > 0 {
                self.hold -= 1;
                self.shelf.push_back(whole);
            } else {
                self.last = Some(whole.clone());
                out.extend(self.numbered(&whole));
            }
        }
        out
    }

    fn numbered(&mut self, (header, payload): &Whole) -> Vec<u8> {
        self.sent += 1;
        let header = Header {
            sequence: self.sent,
            ..*header
        };
        let mut bytes = vec![0; FRAME];
        let length = write_frame(&mut bytes, &header, |to| to.put(payload)).expect("it was a frame");
        bytes.truncate(length);
        bytes
    }
}

struct Bench {
    machine: MachineParameters,
    plan: Vec<Command>,
    next: usize,
    sender: LinkSender,
    receiver: LinkReceiver,
    follower: Box<Follower>,
    half: Box<RealtimeHalf<Plant>>,
    to_machine: Way,
    to_sender: Way,
    connection: Option<u32>,
    connections: u32,
    now: Tick,
    held: Option<machine::link::Order>,
    last: Option<Report>,
}

impl Bench {
    fn new() -> Self {
        let machine = MachineParameters::small_machining_centre();
        let plant = Plant::new(&machine, Point::ORIGIN, 1);
        Bench {
            plan: plan(),
            next: 0,
            sender: sender(&machine),
            receiver: receiver(&machine),
            follower: Box::new(Follower::new()),
            half: powered(&machine, plant),
            to_machine: Way::new(),
            to_sender: Way::new(),
            connection: None,
            connections: 0,
            now: Tick(0),
            held: None,
            last: None,
            machine,
        }
    }

    fn happen(&mut self, what: u8, much: u8) {
        match what {
            0..=5 => self.pass(u32::from(much + 1) << what),
            6 => self.to_machine.hold = much + 1,
            7 => self.late(|shelf| shelf.pop_front()),
            8 => self.late(|shelf| shelf.pop_back()),
            9 => {
                if let Some(last) = self.to_machine.last.clone() {
                    self.deliver(&last);
                }
            }
            10 => self.to_machine.drop = much % 4 + 1,
            11 => self.cut(),
            12 => {
                self.cut();
                let plant = self.half.drive().clone();
                self.half = powered(&self.machine, plant);
                (self.receiver, *self.follower, self.held) = (receiver(&self.machine), Follower::new(), None);
                self.last = None;
            }
            13 => self.sender.request(match much % 5 {
                0 | 1 => Request::CycleStart,
                2 => Request::Hold,
                3 => Request::Stop,
                _ => Request::Reset,
            }),
            14 => {
                self.cut();
                (self.sender, self.next) = (sender(&self.machine), 0);
            }
            _ => {
                self.to_sender.drop = much % 2;
                if let Some(last) = self.to_sender.last.clone() {
                    let bytes = self.to_sender.numbered(&last);
                    if self.connection.is_some() && self.sender.receive(self.now, &bytes).is_err() {
                        self.cut();
                    }
                }
            }
        }
    }

    fn late(&mut self, take: impl FnOnce(&mut VecDeque<Whole>) -> Option<Whole>) {
        if let Some(whole) = take(&mut self.to_machine.shelf) {
            self.deliver(&whole);
        }
    }

    fn deliver(&mut self, whole: &Whole) {
        let bytes = self.to_machine.numbered(whole);
        if let Some(connection) = self.connection {
            self.receiver.receive(connection, self.now, &bytes);
        }
    }

    fn cut(&mut self) {
        if let Some(connection) = self.connection.take() {
            self.receiver.disconnected(connection, self.now);
            self.sender.disconnected(self.now);
        }
    }

    fn pass(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.connect();
            self.exchange();
            self.cycle();
            self.exchange();
            while self.sender.report().is_some() {}
            while self.sender.firing(self.now).is_some() {}
            while self.sender.loaded().is_some() {}
            let ready = self.last.is_some_and(|r| matches!(r.state, State::Ready | State::Held));
            if self.sender.status().waits_for_start && ready && self.now.0.is_multiple_of(100) {
                self.sender.allow_approach(NEAR);
                self.sender.request(Request::CycleStart);
            }
            self.now += 1;
        }
    }

    fn connect(&mut self) {
        if self.connection.is_none() && self.now.0.is_multiple_of(20) {
            self.connections += 1;
            self.connection = Some(self.connections);
            self.receiver.connected(self.connections, self.now);
            self.sender.connected(self.now);
            self.to_machine.connected();
            self.to_sender.connected();
        }
    }

    fn exchange(&mut self) {
        while let Some(command) = self.plan.get(self.next)
            && self.sender.push(*command).is_ok()
        {
            self.next += 1;
        }
        self.receiver.pass(self.now);
        let Some(connection) = self.connection else { return };
        let (mut there, mut back) = (Vec::new(), Vec::new());
        let mut broken = self.sender.output(self.now, &mut there).is_err();
        let there = self.to_machine.pass(&there);
        self.receiver.receive(connection, self.now, &there);
        broken |= !self.receiver.output(connection, self.now, &mut back);
        let back = self.to_sender.pass(&back);
        broken |= self.sender.receive(self.now, &back).is_err();
        if broken {
            self.cut();
        }
    }

    fn cycle(&mut self) {
        while let Some(urgent) = self.receiver.urgent() {
            self.follower.take_urgent(urgent, &mut self.half);
        }
        while let Some(order) = self.held.take().or_else(|| self.receiver.order()) {
            if let Err(back) = self.follower.take(order, &mut self.half) {
                self.held = Some(back);
                break;
            }
        }
        self.half.tick(self.now);
        self.follower.after_tick(&mut self.half);
        while let Some(report) = self.half.report() {
            while let Some(firing) = self.half.firing(report.sample.tick) {
                self.receiver.fired(firing);
            }
            let place = report.sample.commanded;
            let on_line = (-NEAR..=END + NEAR).contains(&place[0]) && place[1].abs() < NEAR && place[2].abs() < NEAR;
            assert!(on_line, "{place:?} at {:?}, {:?}", report.sample.tick, report.state);
            if let Some(before) = self.last {
                let way = (place[0] - before.sample.commanded[0]).abs();
                assert!(way <= 0.502, "{way} mm at {:?}, {:?}", report.sample.tick, report.state);
            }
            assert_eq!(report.counters.off_path_stops, 0, "{:?}", report.sample.tick);
            self.last = Some(report);
            let (told, status) = (self.follower.translated(report), self.follower.status());
            self.receiver.reported(told, status);
        }
        while self.receiver.notice().is_some() {}
    }
}

fn receiver(machine: &MachineParameters) -> LinkReceiver {
    LinkReceiver::new(MachineCard::new("mill", Quality::Simulated, machine))
}

fn powered(machine: &MachineParameters, plant: Plant) -> Box<RealtimeHalf<Plant>> {
    let mut half = Box::new(RealtimeHalf::new(machine, plant, Quality::Simulated));
    half.request(Request::PowerOn);
    half
}

/// A sender that has a condition and a tool to load before it begins.
fn sender(machine: &MachineParameters) -> LinkSender {
    let mut sender = LinkSender::new("fuzz", PlanId([7; 32]), machine);
    let x = machine::watch::signal("X.POSITION.ACTUAL").expect("a signal");
    sender.load(Load::Watch {
        frequency: Frequency::EveryEdge,
        all_modes: false,
        operations: vec![Operation::Compare(x, Relation::Greater, END / 2.0)],
        alarms: vec![],
        line: "start_synchronized_action its_id=1".to_owned(),
    });
    sender
}

/// Straight along X, from rest to rest and a second time, with something to wait for in between.
fn plan() -> Vec<Command> {
    let step = StepId(1);
    let order = WatchOrder::Start(0);
    let mut plan = vec![Command::Watch { order, step }];
    let (acceleration, half, mut length) = (1000.0, END / 2.0, 0.0);
    for part in 0..2 {
        let from = half * f64::from(part);
        // Speeds up over the first half of the way, and slows down over the other.
        let ramp = (half / acceleration).sqrt();
        let cycles = (2.0 * ramp / 0.001).floor() as u32;
        let real = f64::from(cycles) * 0.001 / 2.0;
        let acceleration = half / (real * real);
        for n in 1..=cycles {
            let t = f64::from(n) * 0.001;
            let left = 2.0 * real - t;
            let (s, v, a) = if t <= real {
                (acceleration * t * t / 2.0, acceleration * t, acceleration)
            } else if n < cycles {
                (half - acceleration * left * left / 2.0, acceleration * left, -acceleration)
            } else {
                (half, 0.0, 0.0)
            };
            length = from + s;
            plan.push(Command::SetPoint(SetPoint {
                position: [length, 0.0, 0.0],
                velocity: [v, 0.0, 0.0],
                acceleration: [a, 0.0, 0.0],
                step,
                path_length: length,
                path_speed: v,
                ..SetPoint::default()
            }));
        }
        plan.push(Command::Dwell { cycles: 20, step });
    }
    assert!((length - END).abs() < 1e-9, "the plan ends at {length}");
    plan.push(Command::End { step });
    plan
}

#[cfg(test)]
mod tests {
    use super::*;

    // Once a cycle start behind a cut began a plan again that was over, and the machine waited for the rest of it.
    #[test]
    fn in_order_and_over_a_cut_the_plan_is_machined_to_its_end_and_a_cycle_start_behind_it_begins_nothing() {
        for cut in [None, Some(400), Some(900)] {
            let mut bench = Bench::new();
            if let Some(cycles) = cut {
                bench.pass(cycles);
                bench.cut();
            }
            bench.pass(2_000);
            bench.cut();
            bench.pass(50);
            bench.sender.request(Request::CycleStart);
            bench.pass(300);
            let last = bench.last.expect("a report");
            assert_eq!((last.sample.commanded[0], last.state), (END, State::Ready), "{cut:?}");
            assert_eq!(bench.half.watches().loaded(), 1);
        }
    }
}

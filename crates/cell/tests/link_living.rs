//! What lives in a machine behind the link: listed and ended by who does not drive it, while another one does and after that.

use cell::link::{Answer, LinkAsker, LinkReceiver, LinkSender, Load, MachineCard};
use machine::link::{Asked, Follower, Order, PlanId};
use machine::watch::{AlarmOrder, Firing, FiringKind, Frequency, Operation, Reaction, Relation, ResetBy, WatchOrder, signal};
use machine::{Command, ControlPad, MachineParameters, PadState, Plant, Quality, RealtimeHalf, Report, Request, State};
use std::cell::RefCell;
use std::rc::Rc;
use units::{Point, StepId, Tick};

const STEP: StepId = StepId(1);

/// A pad whose emergency stop somebody else presses.
#[derive(Clone, Default)]
struct Pad(Rc<RefCell<PadState>>);

impl ControlPad for Pad {
    fn read(&mut self, _now: Tick) -> Option<PadState> {
        Some(*self.0.borrow())
    }
}

/// A controller: realtime thread and receiving task, without a wire between.
struct Controller {
    receiver: LinkReceiver,
    follower: Box<Follower>,
    half: Box<RealtimeHalf<Plant, Pad>>,
    pad: Pad,
    waiting: Option<Order>,
    now: Tick,
    last: Option<Report>,
    connections: u32,
}

impl Controller {
    fn new() -> Controller {
        let parameters = MachineParameters::small_machining_centre();
        let plant = Plant::new(&parameters, Point::ORIGIN, 1);
        let pad = Pad::default();
        let mut half = Box::new(RealtimeHalf::with_pad(&parameters, plant, pad.clone(), Quality::Simulated));
        half.request(Request::PowerOn);
        Controller {
            receiver: LinkReceiver::new(MachineCard::new("mill 3", Quality::Simulated, &parameters)),
            follower: Box::new(Follower::new()),
            half,
            pad,
            waiting: None,
            now: Tick(0),
            last: None,
            connections: 0,
        }
    }

    fn cycle(&mut self) {
        self.receiver.pass(self.now);
        while let Some(urgent) = self.receiver.urgent() {
            self.follower.take_urgent(urgent, &mut self.half);
        }
        while let Some(order) = self.waiting.take().or_else(|| self.receiver.order()) {
            if let Err(back) = self.follower.take(order, &mut self.half) {
                self.waiting = Some(back);
                break;
            }
        }
        self.half.tick(self.now);
        self.follower.after_tick(&mut self.half);
        while let Some(report) = self.half.report() {
            while let Some(firing) = self.half.firing(report.sample.tick) {
                self.receiver.fired(firing);
            }
            self.last = Some(report);
            let (report, status) = (self.follower.translated(report), self.follower.status());
            self.receiver.reported(report, status);
        }
        // A few in each cycle, as the realtime thread has places for them.
        for _ in 0..64 {
            let Some(told) = self.follower.lives(&mut self.half) else {
                break;
            };
            self.receiver.lives(self.now, told);
        }
        self.now += 1;
    }

    fn connect(&mut self) -> u32 {
        self.connections += 1;
        self.receiver.connected(self.connections, self.now);
        self.connections
    }

    /// Asks on a connection of its own, and lets cycles pass until the answer is there.
    fn ask(&mut self, what: Asked) -> Answer {
        let connection = self.connect();
        let mut asker = LinkAsker::new("maria", what, self.now);
        for _ in 0..2_000 {
            let (mut there, mut back) = (Vec::new(), Vec::new());
            asker.output(self.now, &mut there);
            there
                .chunks(3)
                .for_each(|piece| self.receiver.receive(connection, self.now, piece));
            self.cycle();
            let open = self.receiver.output(connection, self.now, &mut back);
            let mut whole = None;
            for piece in back.chunks(7) {
                whole = whole.or(asker.receive(self.now, piece).expect("an answer"));
            }
            if let Some(answer) = whole {
                assert!(!open, "who has its answer is sent home");
                self.receiver.disconnected(connection, self.now);
                return answer;
            }
        }
        panic!("no answer");
    }

    fn list(&mut self) -> Vec<(u32, bool, String, String)> {
        let answer = self.ask(Asked::Living);
        assert_eq!(answer.machine, "mill 3");
        let lived = answer.lived.into_iter();
        lived
            .map(|lived| (lived.living.mark, lived.living.all_modes, lived.by, lived.line))
            .collect()
    }

    fn notices(&mut self) -> Vec<String> {
        std::iter::from_fn(|| self.receiver.notice()).map(|n| n.to_string()).collect()
    }
}

/// A run of a plan, sender and connection.
struct Run {
    sender: LinkSender,
    connection: u32,
    plan: Vec<Command>,
    firings: Vec<Firing>,
}

impl Run {
    fn of(number: u8, controller: &mut Controller, loads: Vec<Load>, plan: Vec<Command>) -> Run {
        let name = format!("plate {number} of jo");
        let mut sender = LinkSender::new(&name, PlanId([number; 32]), &MachineParameters::small_machining_centre());
        loads.into_iter().for_each(|load| sender.load(load));
        sender.connected(controller.now);
        Run {
            sender,
            connection: controller.connect(),
            plan,
            firings: Vec::new(),
        }
    }

    fn cycle(&mut self, controller: &mut Controller) {
        while let Some(command) = self.plan.first() {
            if self.sender.push(*command).is_err() {
                break;
            }
            self.plan.remove(0);
        }
        let (mut there, mut back) = (Vec::new(), Vec::new());
        self.sender.output(controller.now, &mut there).expect("the controller speaks");
        controller.receiver.receive(self.connection, controller.now, &there);
        controller.cycle();
        controller.receiver.output(self.connection, controller.now, &mut back);
        self.sender.receive(controller.now, &back).expect("good bytes");
        while let Some(report) = self.sender.report() {
            while let Some(firing) = self.sender.firing(report.sample.tick) {
                self.firings.push(firing);
            }
        }
    }

    fn cycles(&mut self, controller: &mut Controller, count: u64) {
        (0..count).for_each(|_| self.cycle(controller));
    }

    fn end(mut self, controller: &mut Controller) -> Vec<Firing> {
        self.sender.finish();
        self.cycles(controller, 3);
        controller.receiver.disconnected(self.connection, controller.now);
        assert_eq!(controller.receiver.holder(), None);
        self.firings
    }
}

fn load(frequency: Frequency, all_modes: bool, line: &str, alarms: Vec<AlarmOrder>) -> Load {
    let x = signal("X.POSITION.ACTUAL").expect("a signal");
    Load::Watch {
        frequency,
        all_modes,
        operations: vec![Operation::Compare(x, Relation::Greater, -10_000.0)],
        alarms,
        line: line.to_owned(),
    }
}

fn say(order: WatchOrder) -> Command {
    Command::Watch { order, step: STEP }
}

/// A plan that starts some and waits for so long.
fn starting(numbers: &[u16], cycles: u32) -> Vec<Command> {
    let starts = numbers.iter().map(|number| say(WatchOrder::Start(*number)));
    let rest = [Command::Dwell { cycles, step: STEP }, Command::End { step: STEP }];
    starts.chain(rest).collect()
}

#[test]
fn what_lives_is_listed_while_another_one_drives_and_after_its_run_and_is_ended_by_its_number() {
    let mut controller = Controller::new();
    assert_eq!(controller.list(), []);
    let loads = vec![
        load(Frequency::Whenever, false, "automatic", vec![]),
        load(Frequency::WhenOnce, true, "once", vec![]),
        load(Frequency::Whenever, true, "not started", vec![]),
        load(Frequency::Whenever, true, &"long ".repeat(300), vec![]),
    ];
    let mut run = Run::of(1, &mut controller, loads, starting(&[3, 0, 1], 600));
    run.cycles(&mut controller, 200);
    let jo = || "plate 1 of jo".to_owned();
    let long = format!("{} ...", &"long ".repeat(300)[..996]);
    // In the order of the loads, whoever was started first.
    assert_eq!(
        controller.list(),
        [
            (1, false, jo(), "automatic".to_owned()),
            (2, true, jo(), "once".to_owned()),
            (4, true, jo(), long.clone())
        ]
    );
    run.cycles(&mut controller, 600);
    run.end(&mut controller);
    // Automatic is over with its program; the rest is there, and nobody drives.
    let answer = controller.ask(Asked::Living);
    let [once, often] = &answer.lived[..] else {
        panic!("{answer:?}")
    };
    assert_eq!((once.living.mark, once.living.fired), (2, 1));
    assert!(often.living.fired > 500, "{often:?}");
    assert!(answer.now - often.living.since >= often.living.fired - 1, "{answer:?}");
    // It goes on, heard by nobody.
    (0..50).for_each(|_| controller.cycle());
    let later = controller.ask(Asked::Living);
    assert!(later.lived[1].living.fired >= often.living.fired + 50, "{later:?}");

    // The next program has its own, and its numbers go on.
    let mut run = Run::of(
        2,
        &mut controller,
        vec![load(Frequency::Whenever, true, "second", vec![])],
        starting(&[0], 600),
    );
    run.cycles(&mut controller, 200);
    let marks: Vec<u32> = controller.list().iter().map(|lived| lived.0).collect();
    assert_eq!(marks, [2, 4, 5]);
    controller.notices();
    let ended = controller.ask(Asked::End { mark: 4 });
    assert_eq!((ended.lived.len(), &ended.lived[0].line), (1, &long));
    assert!(ended.lived[0].living.fired > later.lived[1].living.fired);
    assert_eq!(controller.notices(), [format!("'maria' ended synchronized action 4: {long}")]);
    // Not twice, nor what never was, nor what has no number.
    for mark in [4, 3, 99, 0, u32::MAX] {
        assert_eq!(controller.ask(Asked::End { mark }).lived, []);
    }
    run.cycles(&mut controller, 600);
    let firings = run.end(&mut controller);
    assert!(
        firings.iter().all(|firing| firing.kind == FiringKind::Fired),
        "it was of another run"
    );
    let left: Vec<u32> = controller.list().iter().map(|lived| lived.0).collect();
    assert_eq!(left, [2, 5]);
    controller.half.request(Request::PowerOff);
    assert_eq!(controller.list(), [], "without power nothing goes on");
}

#[test]
fn a_run_hears_that_what_it_started_was_ended_and_does_not_take_it_up_again() {
    let mut controller = Controller::new();
    let loads = vec![
        load(Frequency::Whenever, true, "one", vec![]),
        load(Frequency::Whenever, false, "automatic", vec![]),
    ];
    let mut run = Run::of(1, &mut controller, loads, starting(&[0, 1], 3_000));
    run.cycles(&mut controller, 200);
    assert_eq!(controller.ask(Asked::End { mark: 2 }).lived, [], "it ends with its program");
    assert_eq!(controller.ask(Asked::End { mark: 1 }).lived.len(), 1);
    run.cycles(&mut controller, 200);
    let ended = |firings: &[Firing], kind| firings.iter().filter(|f| f.watch == 0 && f.kind == kind).count();
    assert_eq!(ended(&run.firings, FiringKind::Ended), 1);
    let fired = ended(&run.firings, FiringKind::Fired);
    assert!(fired > 50);
    // Whatever brings the machine back to its plan.
    controller.half.watches().obey(WatchOrder::TakeUp { watch: 0, fired: true });
    run.cycles(&mut controller, 50);
    assert_eq!(ended(&run.firings, FiringKind::Fired), fired);
    // But the program's own start is a start.
    controller.half.watches().obey(WatchOrder::Start(0));
    run.cycles(&mut controller, 50);
    assert!(ended(&run.firings, FiringKind::Fired) > fired);
    assert_eq!(controller.list().len(), 2);
}

#[test]
fn an_emergency_stop_does_not_end_it_and_it_goes_on_firing() {
    let mut controller = Controller::new();
    let alarm = AlarmOrder::Set {
        alarm: 7,
        reaction: Reaction::None,
        reset_by: ResetBy::Acknowledge,
    };
    let loads = vec![load(Frequency::Whenever, true, "always", vec![alarm])];
    let mut run = Run::of(1, &mut controller, loads, starting(&[0], 100));
    run.cycles(&mut controller, 400);
    run.end(&mut controller);
    let fired = |controller: &mut Controller| controller.ask(Asked::Living).lived[0].living.fired;
    controller.pad.0.borrow_mut().emergency_stop = true;
    (0..20).for_each(|_| controller.cycle());
    let pressed = fired(&mut controller);
    (0..500).for_each(|_| controller.cycle());
    assert_eq!(controller.last.map(|report| report.state), Some(State::EmergencyStop));
    assert!(fired(&mut controller) >= pressed + 500 && controller.half.watches().alarm(7));
    controller.pad.0.borrow_mut().emergency_stop = false;
    (0..20).for_each(|_| controller.cycle());
    controller.half.request(Request::Reset);
    (0..20).for_each(|_| controller.cycle());
    assert_eq!(controller.last.map(|report| report.state), Some(State::Ready));
    assert!(fired(&mut controller) >= pressed + 540);
}

#[test]
fn as_many_as_a_machine_takes_are_listed_a_few_in_each_cycle() {
    let mut controller = Controller::new();
    let loads = (0..4096).map(|n| load(Frequency::WhenOnce, n % 2 == 0, &format!("action {n}"), vec![]));
    let mut run = Run::of(1, &mut controller, loads.collect(), starting(&Vec::from_iter(0..4096), 2_000));
    while controller.half.watches().running() < 4096 && controller.now < Tick(20_000) {
        run.cycle(&mut controller);
    }
    let listed = controller.list();
    assert_eq!(listed.len(), 4096);
    for (n, (mark, all_modes, _, line)) in listed.iter().enumerate() {
        assert_eq!(
            (*mark as usize, *all_modes, line),
            (n + 1, n % 2 == 0, &format!("action {n}"))
        );
    }
    // Every second place is empty then, and a list passes over them.
    run.cycles(&mut controller, 3_000);
    run.end(&mut controller);
    let listed = controller.list();
    assert_eq!((listed.len(), listed[0].0, listed[2047].0), (2048, 1, 4095));
}

#[test]
fn several_who_ask_at_once_are_all_answered_and_a_new_plan_in_between_spoils_no_list() {
    let mut controller = Controller::new();
    let loads = (0..200).map(|n| load(Frequency::Whenever, true, &format!("action {n}"), vec![]));
    let mut run = Run::of(1, &mut controller, loads.collect(), starting(&Vec::from_iter(0..200), 10));
    run.cycles(&mut controller, 500);
    run.end(&mut controller);
    let questions = [
        Asked::Living,
        Asked::End { mark: 200 },
        Asked::Living,
        Asked::End { mark: 200 },
    ];
    let mut askers: Vec<_> = questions
        .iter()
        .cycle()
        .take(40)
        .map(|what| (controller.connect(), LinkAsker::new("maria", *what, controller.now), None))
        .collect();
    let mut next = None;
    for cycle in 0..400 {
        for (connection, asker, answer) in &mut askers {
            let (mut there, mut back) = (Vec::new(), Vec::new());
            asker.output(controller.now, &mut there);
            controller.receiver.receive(*connection, controller.now, &there);
            controller.receiver.output(*connection, controller.now, &mut back);
            if answer.is_none() {
                *answer = asker.receive(controller.now, &back).expect("an answer");
            }
        }
        if cycle == 3 {
            // In the middle of the list.
            next = Some(Run::of(2, &mut controller, vec![], starting(&[], 10)));
        }
        match &mut next {
            Some(run) => run.cycle(&mut controller),
            None => controller.cycle(),
        }
    }
    let mut ended = 0;
    for ((_, _, answer), what) in askers.iter().zip(questions.iter().cycle()) {
        let lived = &answer.as_ref().unwrap_or_else(|| panic!("no answer to {what:?}")).lived;
        match what {
            Asked::Living => assert!(lived.len() == 199 || lived.len() == 200, "{}", lived.len()),
            Asked::End { .. } => ended += lived.len(),
        }
    }
    assert_eq!(ended, 1, "it was ended once");
    assert_eq!(controller.list().len(), 199);
}

#[test]
fn who_asks_drives_nothing_on_that_connection_and_who_drives_does_not_ask_on_it() {
    use machine::link::message::small_frame;
    use machine::link::{Kind, Name};
    let mut controller = Controller::new();
    let inquiry = machine::link::asking::Inquiry {
        name: Name::new("maria"),
        what: Asked::Living,
    };
    let frame = |sequence, session| {
        let (bytes, length) = small_frame(Kind::Inquiry, session, sequence, 0, &inquiry);
        bytes[..length].to_vec()
    };
    let connection = controller.connect();
    controller.receiver.receive(connection, Tick(0), &frame(1, 0));
    controller.receiver.receive(connection, Tick(0), &frame(2, 0));
    assert_eq!(
        controller.notices(),
        ["connection 1 was closed: the other side broke the rules of the link: who asks says nothing else on a connection"]
    );
    // Gone before its answer: nobody minds.
    controller.receiver.disconnected(connection, Tick(0));
    (0..10).for_each(|_| controller.cycle());
    let mut run = Run::of(1, &mut controller, vec![], starting(&[], 10));
    run.cycles(&mut controller, 5);
    controller.notices();
    // Its own frames went before: what comes with their numbers is passed over.
    controller.receiver.receive(run.connection, controller.now, &frame(4_000, 1));
    assert!(controller.notices()[0].contains("frame 4000 came"));
}

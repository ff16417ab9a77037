//! The published text protocol over a whole run: to the letter, and what happens when it is damaged.
#![allow(clippy::disallowed_methods, reason = "SEED picks one random run")]

mod common;

use cell::Output;
use cell::link::channel::{Damage, Way};
use cell::link::{TextNotice, TextOrder, TextReceiver, TextSender};
use cell::source::Planned;
use common::{Writer, small_program};
use expect_test::expect;
use machine::link::text::{Line, LineReader};
use machine::pad::Mode;
use machine::{Command, MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, SetPoint, State};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::{BTreeMap, VecDeque};
use units::{Point, Tick};

fn machine() -> MachineParameters {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = units::Seconds(0.3);
    machine
}

fn commands(program: &Planned) -> VecDeque<Command> {
    let commands = program.outputs.iter().filter_map(|o| match o {
        Output::Command(command) => Some(*command),
        _ => None,
    });
    let mut commands: VecDeque<Command> = commands.collect();
    if !matches!(commands.back(), Some(Command::End { .. })) {
        commands.push_back(Command::End { step: units::StepId(0) });
    }
    commands
}

/// Sender and machine with a wire between them.
struct TextWorld {
    commands: VecDeque<Command>,
    sender: Option<TextSender>,
    receiver: TextReceiver,
    half: Box<RealtimeHalf<Plant>>,
    way: Way,
    connection: Option<u32>,
    now: Tick,
    held: Option<TextOrder>,
    transcript: Vec<String>,
    seen: LineReader,
    last: Option<Report>,
    late: u64,
    notices: Vec<TextNotice>,
    refused: Option<String>,
    spindle: Vec<Command>,
}

impl TextWorld {
    fn new(program: &Planned, seed: u64, delay: (u64, u64)) -> Self {
        let parameters = machine();
        let mut half = Box::new(RealtimeHalf::new(
            &parameters,
            Plant::new(&parameters, Point::ORIGIN, seed),
            Quality::Simulated,
        ));
        half.request(Request::PowerOn);
        let mut receiver = TextReceiver::new(&parameters);
        assert!(receiver.connected(1));
        TextWorld {
            commands: commands(program),
            sender: Some(TextSender::new(&parameters, BTreeMap::from([(1, 34.4)]))),
            receiver,
            half,
            way: Way::new(delay, seed),
            connection: Some(1),
            now: Tick(0),
            held: None,
            transcript: Vec::new(),
            seen: LineReader::new(),
            last: None,
            late: 0,
            notices: Vec::new(),
            refused: None,
            spindle: Vec::new(),
        }
    }

    /// One millisecond; the report of the cycle, if it took place.
    fn advance(&mut self) -> Option<Report> {
        let now = self.now;
        self.now += 1;
        if let Some(sender) = &mut self.sender {
            while let Some(command) = self.commands.pop_front() {
                if let Err(back) = sender.push(command) {
                    self.commands.push_front(back);
                    break;
                }
            }
            let mut bytes = Vec::new();
            if let Err(refusal) = sender.output(now, &mut bytes) {
                self.refused = Some(refusal.to_string());
                sender.request(Request::Stop);
            }
            for &byte in &bytes {
                if let Some(Ok(line)) = self.seen.take(byte) {
                    self.note(&line);
                }
            }
            if self.connection.is_some() {
                self.way.send(now, bytes);
            }
        }
        while self.receiver.reads()
            && let Some(bytes) = self.way.arrive(now)
        {
            if let Some(connection) = self.connection {
                self.receiver.receive(connection, &bytes);
            }
        }
        while let Some(request) = self.receiver.urgent() {
            self.held = None;
            self.half.request(request);
        }
        if self.late > 0 {
            self.late -= 1;
            return None;
        }
        while let Some(order) = self.held.take().or_else(|| self.receiver.order()) {
            match order {
                TextOrder::Command(command) => {
                    if self.half.push(command).is_err() {
                        self.held = Some(order);
                        break;
                    }
                    if matches!(
                        command,
                        Command::Spindle { .. } | Command::Tool { .. } | Command::ToolLength { .. }
                    ) {
                        self.spindle.push(command);
                    }
                }
                other => {
                    if let Some(request) = other.request() {
                        self.half.request(request);
                    }
                }
            }
        }
        self.half.tick(now);
        let report = self.half.report()?;
        self.receiver.reported(&report);
        self.tell();
        while let Some(notice) = self.receiver.notice() {
            self.notices.push(notice);
        }
        self.last = Some(report);
        Some(report)
    }

    fn tell(&mut self) {
        while let Some(told) = self.receiver.told() {
            let text = told.text();
            let line = String::from_utf8_lossy(text.bytes()).trim_end().to_owned();
            self.transcript.push(format!("          {line}"));
            if let Some(sender) = &mut self.sender {
                sender.receive(text.bytes()).expect("our own line");
            }
        }
    }

    /// Writes a line down; of movements in a row the first and the last.
    fn note(&mut self, line: &Line) {
        let text = String::from_utf8_lossy(line.text().bytes()).into_owned();
        if !matches!(line, Line::Movement(_)) {
            return self.transcript.push(text);
        }
        let before = self.transcript.len();
        let moved =
            |line: Option<&String>| line.is_some_and(|l| l.starts_with(|c: char| c == '-' || c == '.' || c.is_ascii_digit()));
        if moved(self.transcript.last()) && before > 1 && moved(self.transcript.get(before - 2)) {
            let last = self.transcript.len() - 1;
            self.transcript[last] = format!("... {text}");
        } else if moved(self.transcript.last()) {
            self.transcript.push(format!("... {text}"));
        } else {
            self.transcript.push(text);
        }
    }

    fn is_over(&self) -> bool {
        let ended = self.sender.as_ref().is_none_or(TextSender::ended);
        ended
            && self
                .last
                .is_some_and(|r| r.idle && matches!(r.state, State::Ready) || r.state.needs_a_person())
    }
}

/// A program of one operation: a tool, a speed, coolant, two moves and a dwell.
fn one_operation() -> Planned {
    let mut w = Writer::default();
    w.tool(1, 10.0);
    w.spindle(6000.0);
    w.coolant(true);
    w.begin("face");
    w.go([10.0, 0.0, -2.0], 100.0);
    w.command(Command::Dwell {
        cycles: 5,
        step: units::StepId(1),
    });
    w.go([10.0, 20.0, -2.0], 60.0);
    w.end();
    w.coolant(false);
    w.begin("hole");
    w.go([10.0, 20.0, 5.0], 400.0);
    w.end();
    w.finish()
}

#[test]
fn a_whole_run_is_in_the_order_of_the_source() {
    let mut world = TextWorld::new(&one_operation(), 1, (0, 0));
    // Before: the person sets up by jog.
    for line in [
        TextSender::mode(Mode::Jog { axis: 0 }),
        Line::JogFeed(150),
        Line::Spindle(60),
        Line::Home,
        Line::Automatic,
    ] {
        world.note(&line);
        world.receiver.receive(1, line.text().bytes());
    }
    while let Some(order) = world.receiver.order() {
        world.transcript.push(format!("          machine: {order:?}"));
    }
    // What the pad and the homing will say of themselves.
    world.half.tick(Tick(0));
    let mut report = world.half.report().expect("one");
    for (mode, stopped, home) in [
        (Some(Mode::Jog { axis: 0 }), false, false),
        (None, true, false),
        (None, false, true),
        (Some(Mode::Auto), false, false),
    ] {
        report.notices.mode = mode;
        (report.notices.joystick_stopped, report.notices.home_reached) = (stopped, home);
        report.sample.actual = [45.334, -3.0, 12.5];
        world.receiver.reported(&report);
        world.tell();
    }
    world.now = Tick(1);
    while !world.is_over() {
        world.advance();
        assert!(world.now.0 < 20_000, "does not end: {:?}", world.notices);
    }
    assert_eq!(world.last.map(|r| r.state), Some(State::Ready));
    let losses = world
        .sender
        .as_ref()
        .map(|s| s.losses().lines().join("\n"))
        .unwrap_or_default();
    expect![[r#"
        JX@
        F150@
        S60@
        H@
        A@
                  machine: Mode(Jog { axis: 0 })
                  machine: JogFeed(150)
                  machine: Spindle(Clockwise(Rpm(5647.058823529412)))
                  machine: Home
                  machine: Mode(Auto)
                  JX
                  45334 -3000 12500
                  H
                  A
        M1@
        P1@
        T1 34@
        S64@
        0 1 0 0 0 0@
        ... 0 10000 0 20000 0 -36000@
        #@
        P0@
        0 10000 0 20000 1 -35999@
        ... 0 10000 0 20000 0 -29000@
        #@
        M0@

        tool 1: its length of 34.4 mm went out as 34 mm; Z is not moved by it
        spindle speeds are off by up to 23.5 rev/min: there are 255 of them
        places are off by up to 0.0005 mm: they are whole pulses
    "#]]
    .assert_eq(&format!("{}\n\n{losses}\n", world.transcript.join("\n")));
}

#[test]
fn an_emergency_stop_ends_the_run_on_both_sides() {
    let mut world = TextWorld::new(&one_operation(), 1, (0, 2));
    while world.last.is_none_or(|r| r.sample.commanded[0] < 3.0) {
        world.advance();
    }
    assert_eq!(world.last.map(|r| r.state), Some(State::Running));
    world.half.drive_mut().set_emergency_stop(true);
    for _ in 0..300 {
        world.advance();
    }
    world.half.drive_mut().set_emergency_stop(false);
    for _ in 0..10 {
        world.advance();
    }
    assert!(world.sender.as_ref().is_some_and(TextSender::ended));
    assert_eq!(
        world.transcript[world.transcript.len() - 2..],
        ["          E1", "          E0"]
    );
    let at = world.last.map(|r| {
        (
            r.state,
            r.sample.spindle_speed.abs() < 100.0 || r.orders.spindle == machine::SpindleCommand::Stop,
        )
    });
    assert_eq!(at, Some((State::EmergencyStopReleased, true)));
}

#[test]
fn a_stop_is_decelerating_lines_then_the_end_of_operation_and_machining() {
    let mut world = TextWorld::new(&one_operation(), 1, (0, 2));
    while world.last.is_none_or(|r| r.sample.commanded[0] < 3.0) {
        world.advance();
    }
    if let Some(sender) = &mut world.sender {
        sender.request(Request::Stop);
    }
    while !world.is_over() {
        world.advance();
        assert!(world.now.0 < 20_000, "does not end: {:?}", world.notices);
    }
    assert_eq!(world.last.map(|r| r.state), Some(State::Ready), "{:?}", world.notices);
    let last = &world.transcript[world.transcript.len() - 3..];
    assert!(last[0].starts_with("... 0 ") && last[0].contains(" 0 "), "{last:?}");
    assert_eq!(last[1..], ["#@", "M0@"]);
    assert_eq!(world.half.controller().counters().starvations, 0);
}

#[test]
fn a_stop_while_a_tool_of_another_length_is_changed_stands_where_it_is() {
    let mut world = TextWorld::new(&one_operation(), 1, (0, 0));
    while world.last.is_none_or(|r| r.state != State::Waiting(machine::Wait::Tool)) {
        world.advance();
    }
    world.receiver.disconnected(1);
    world.sender = None;
    for _ in 0..500 {
        world.advance();
    }
    let at = world.last.map(|r| (r.state, r.sample.commanded[2].round()));
    assert_eq!(at, Some((State::Stopped(machine::StopCause::Asked), 34.0)));
}

#[test]
fn a_spindle_to_the_left_is_refused_and_the_step_named() {
    let mut w = Writer::default();
    w.go([5.0, 0.0, 0.0], 50.0);
    w.command(Command::Spindle {
        spindle: machine::SpindleCommand::Counterclockwise(units::Rpm(500.0)),
        step: units::StepId(9),
    });
    let mut world = TextWorld::new(&w.finish(), 1, (0, 0));
    for _ in 0..600 {
        world.advance();
    }
    expect!["step 9: the text protocol turns the spindle clockwise only: use the default link for M4"]
        .assert_eq(world.refused.as_deref().unwrap_or(""));
    assert_eq!(world.last.map(|r| r.state), Some(State::Ready));
}

#[test]
fn a_second_client_is_refused_and_the_first_goes_on() {
    let mut receiver = TextReceiver::new(&machine());
    assert!(receiver.connected(1) && !receiver.connected(2));
    receiver.receive(2, b"M1@P1@");
    assert!(!receiver.machining());
    receiver.disconnected(2);
    receiver.receive(1, b"M1@P1@");
    assert!(receiver.machining());
    let notices: Vec<String> = std::iter::from_fn(|| receiver.notice()).map(|n| n.to_string()).collect();
    assert_eq!(
        notices,
        [
            "connection 1 drives the machine",
            "connection 2 was refused: another one drives the machine"
        ]
    );
}

/// What the lines before a bad one come to, and what is said of that one.
#[track_caller]
fn check_stop(lines: &str, said: &str) {
    let mut receiver = TextReceiver::new(&machine());
    receiver.connected(1);
    receiver.receive(1, lines.as_bytes());
    let notices: Vec<String> = std::iter::from_fn(|| receiver.notice())
        .skip(1)
        .map(|n| n.to_string())
        .collect();
    assert_eq!(notices, [format!("controlled stop: {said}")]);
    let asked: Vec<Request> = std::iter::from_fn(|| receiver.urgent()).collect();
    assert_eq!(
        asked,
        if lines.starts_with("M1") {
            vec![Request::Stop]
        } else {
            vec![]
        }
    );
    assert_eq!(receiver.order(), None);
}

#[test]
fn what_must_not_be_followed_is_a_controlled_stop_and_says_where() {
    check_stop(
        "M1@P0@0 0 0 0 0 0@255 501 0 0 0 0@0 1500 0 0 0 0@",
        "line 5: X moves 999 pulses in a millisecond, which is faster than it can",
    );
    check_stop(
        "M1@P0@0 0 0 0 0 0@0 0 100 3 0 0@",
        "line 4: Y moves 3 pulses, and its speed 100 says otherwise",
    );
    check_stop(
        "M1@P0@0 0 0 0 0 0@2 2 0 0 0 0@#@",
        "line 5: the last movement has to come to rest (speeds 0) before",
    );
    check_stop("M1@P0@0 0 0 0 0@", "line 3, column 10: a position in pulses was expected");
    check_stop(
        "M1@P0@A@",
        "line 3, column 1: between P and # only movements, T, S and # may stand: end the operation with # before",
    );
    check_stop(
        "M1@0 0 0 0 0 0@",
        "line 2, column 1: a movement outside an operation: send P1 or P0 before",
    );
    check_stop(
        "M1@P0@300 0 0 0 0 0@",
        "line 3, column 1: a speed of -255 to 255 was expected",
    );
    check_stop("M1@H@", "line 2: this is not for the time between M1 and M0");
    check_stop("P0@", "line 1: send M1 before");
    check_stop("Q@", "line 1, column 1: no line begins with 'Q'");
    check_stop("S256@", "line 1, column 2: a number of 0 to 255 was expected");
}

#[test]
fn any_split_of_the_bytes_gives_the_same_lines() {
    let text = b"A@JX@\r\nF150@S60@M1@P1@T1 34@ S150@ 0 0 0 0 0 -34000@0 1\t0 0 0 -34000 @#@M0@H@";
    let read = |pieces: usize| {
        let mut receiver = TextReceiver::new(&machine());
        receiver.connected(1);
        text.chunks(pieces).for_each(|piece| receiver.receive(1, piece));
        let orders: Vec<TextOrder> = std::iter::from_fn(|| receiver.order()).collect();
        let notices: Vec<TextNotice> = std::iter::from_fn(|| receiver.notice()).collect();
        (orders, notices)
    };
    let whole = read(text.len());
    assert_eq!((whole.0.len(), whole.1.len()), (16, 1), "{whole:?}");
    for pieces in 1..text.len() {
        assert_eq!(read(pieces), whole);
    }
}

// -- faults

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Cut,
    Stall,
    Damaged,
    Twice,
    Missing,
    SenderKilled,
    ControllerRestarted,
    LateTicks,
}

/// What came of a kind of fault.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    runs: u64,
    completed: u64,
    stopped: u64,
    starved: u64,
    waits: u64,
    faults: u64,
    unnoticed: u64,
    wrong_path: u64,
    wrong_switching: u64,
    furthest: f64,
}

/// The places of a plan, for asking how far another is from it.
fn distance(plan: &[SetPoint], from: &mut usize, p: [f64; 3]) -> f64 {
    let mut best = (f64::INFINITY, *from);
    let place = |n: usize| if n == 0 { [0.0; 3] } else { plan[n - 1].position };
    for n in from.saturating_sub(50)..(*from + 300).min(plan.len()) {
        let (a, b) = (place(n), place(n + 1));
        let d: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let t: [f64; 3] = std::array::from_fn(|k| p[k] - a[k]);
        let length: f64 = d.iter().map(|x| x * x).sum();
        let u = if length > 0.0 {
            (0..3).map(|k| t[k] * d[k]).sum::<f64>() / length
        } else {
            0.0
        };
        let beside = (0..3).map(|k| (t[k] - u.clamp(0.0, 1.0) * d[k]).powi(2)).sum::<f64>().sqrt();
        if beside < best.0 - 1e-9 {
            best = (beside, n);
        }
    }
    *from = best.1;
    best.0
}

#[test]
fn a_damaged_text_link_ends_in_a_defined_stop_and_what_cannot_be_noticed_is_counted() {
    let number = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<u64>().ok());
    let seeds: Vec<u64> = number("SEED").map_or_else(|| (1..=number("SEEDS").unwrap_or(100)).collect(), |seed| vec![seed]);
    let program = small_program();
    let plan: Vec<SetPoint> = commands(&program)
        .iter()
        .filter_map(|c| if let Command::SetPoint(s) = c { Some(*s) } else { None })
        .collect();
    let switching = {
        let mut world = TextWorld::new(&program, 1, (0, 0));
        while !world.is_over() {
            world.advance();
        }
        world.spindle
    };
    let mut rows: BTreeMap<Kind, Row> = BTreeMap::new();
    for &seed in &seeds {
        let mut dice = ChaCha8Rng::seed_from_u64(seed);
        let mut up_to = |n: u64| dice.next_u64() % n;
        let kinds = [
            Kind::Cut,
            Kind::Stall,
            Kind::Damaged,
            Kind::Twice,
            Kind::Missing,
            Kind::SenderKilled,
            Kind::ControllerRestarted,
            Kind::LateTicks,
        ];
        let (kind, at, noticed) = (kinds[up_to(8) as usize], 1 + up_to(4500), up_to(2) == 0);
        let damage = if up_to(2) == 0 { Damage::Bit } else { Damage::Bytes };
        let late = 1 + up_to(10);
        let mut world = TextWorld::new(&program, seed, (seed % 3, seed % 7));
        let row = rows.entry(kind).or_default();
        let (mut place, mut furthest, mut before) = (0, 0.0f64, None);
        let mut still = 0;
        while !world.is_over() && still < 3_000 && world.now.0 < 60_000 {
            if world.now.0 == at {
                match kind {
                    Kind::Cut => {
                        world.way.cut();
                        if let Some(connection) = world.connection.take()
                            && noticed
                        {
                            world.receiver.disconnected(connection);
                        }
                    }
                    Kind::Stall => world.way.hold_until(world.now + 100),
                    Kind::Damaged => world.way.damage(damage),
                    Kind::Twice => world.way.damage(Damage::Twice),
                    Kind::Missing => world.way.damage(Damage::Missing),
                    Kind::SenderKilled => {
                        world.sender = None;
                        if let Some(connection) = world.connection.take() {
                            world.receiver.disconnected(connection);
                        }
                    }
                    Kind::ControllerRestarted => {
                        // It stops on the path before it ends; what comes after it speaks to nobody.
                        world.half.request(Request::Stop);
                        world.connection = None;
                        world.sender = None;
                    }
                    Kind::LateTicks => world.late = late,
                }
            }
            let Some(report) = world.advance() else { continue };
            if before == Some(report.sample.commanded) {
                still += 1;
            } else {
                still = 0;
                // Over the start the tool is changed, and the gauge point taken back to where it was.
                let [x, y, _] = report.sample.commanded;
                if report.orders.mode == machine::DriveMode::Follow && (x, y) != (0.0, 0.0) {
                    furthest = furthest.max(distance(&plan, &mut place, report.sample.commanded));
                }
            }
            before = Some(report.sample.commanded);
        }
        let state = world.last.map(|r| r.state);
        let counters = world.half.controller().counters();
        assert_eq!(
            counters.off_path_stops, 0,
            "seed {seed}, {kind:?} at {at}: {state:?} {:?}",
            world.notices
        );
        row.runs += 1;
        row.furthest = row.furthest.max(furthest);
        let told = world.notices.iter().any(|n| matches!(n, TextNotice::Stopped(_)));
        match state {
            Some(State::Ready) if !told => row.completed += 1,
            Some(State::Stopped(machine::StopCause::Starved)) => row.starved += 1,
            Some(State::Stopped(_)) => row.stopped += 1,
            // A stop asked of a machine at rest that has nothing to do.
            Some(State::Ready) => row.stopped += 1,
            Some(State::Waiting(machine::Wait::Commands)) => row.waits += 1,
            Some(State::Fault(machine::FaultCause::Drive)) => row.faults += 1,
            other => panic!(
                "seed {seed}, {kind:?} at {at}: no defined end: {other:?}, {:?}",
                world.notices
            ),
        }
        let wrong_path = furthest > 0.05;
        let wrong_switching = !switching.starts_with(&world.spindle);
        row.wrong_path += u64::from(wrong_path);
        row.wrong_switching += u64::from(wrong_switching);
        row.unnoticed += u64::from((wrong_path || wrong_switching) && !told);
        if seeds.len() == 1 {
            println!(
                "{kind:?} at {at}: {state:?}, {furthest} mm, {:?} {:?}",
                world.notices, world.spindle
            );
        }
    }
    println!(
        "\n| text link, fault | runs | completed | stop, said why | starved on the path | waits at rest | drives' own stop | path > 0.05 mm | wrong switching | of these unnoticed | furthest, mm |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for (kind, r) in &rows {
        println!(
            "| {kind:?} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {:.4} |",
            r.runs,
            r.completed,
            r.stopped,
            r.starved,
            r.waits,
            r.faults,
            r.wrong_path,
            r.wrong_switching,
            r.unnoticed,
            r.furthest
        );
    }
    let sound = |kind: &Kind| !matches!(kind, Kind::Damaged | Kind::Twice | Kind::Missing);
    for (kind, row) in rows.iter().filter(|(kind, _)| sound(kind)) {
        assert_eq!((row.wrong_path, row.wrong_switching), (0, 0), "{kind:?}");
    }
}

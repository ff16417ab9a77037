//! The published text protocol over a whole run: to the letter, and what must not be followed.

mod common;
#[path = "common/text_world.rs"]
mod text_world;

use cell::link::{TextNotice, TextOrder, TextReceiver, TextSender};
use cell::source::Planned;
use common::Writer;
use expect_test::expect;
use machine::link::text::Line;
use machine::pad::Mode;
use machine::{Command, Request, State};
use text_world::{TextWorld, machine};
use units::Tick;

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
    // Each step is one that the axis can do, and its speed says nothing else; one after the other they are not.
    check_stop(
        "M1@P0@0 0 0 0 0 0@0 4 0 0 0 0@0 8 0 0 0 0@0 4 0 0 0 0@",
        "line 6: X moves -4 pulses after 4, which is a harder start or stop than it can do",
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

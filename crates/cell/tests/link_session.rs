//! Who may drive the machine over the link, and what either side says to bytes that are not the other's.

use cell::link::{LinkError, LinkReceiver, LinkSender, MachineCard};
use expect_test::expect;
use machine::link::message::{BlockHead, Hello, UNITS};
use machine::link::{
    Entry, Follower, FrameReader, Header, Kind, LimitsHash, Name, Order, PlanId, Refusal, Urgent, UrgentOrder, Wire, write_frame,
};
use machine::{Command, MachineParameters, Plant, Quality, RealtimeHalf, Request, SetPoint, State};
use units::{MmPerSec, Point, Tick};

const PLAN: PlanId = PlanId([7; 32]);

fn machine() -> MachineParameters {
    MachineParameters::small_machining_centre()
}

fn receiver() -> LinkReceiver {
    LinkReceiver::new(MachineCard::new("mill 3", Quality::Simulated, &machine()))
}

/// Connects a sender and lets both speak until nobody has anything to say; the error on which the sender gives up.
fn meet(receiver: &mut LinkReceiver, connection: u32, sender: &mut LinkSender, now: Tick) -> Result<(), LinkError> {
    receiver.connected(connection, now);
    sender.connected(now);
    talk(receiver, connection, sender, now)
}

fn talk(receiver: &mut LinkReceiver, connection: u32, sender: &mut LinkSender, now: Tick) -> Result<(), LinkError> {
    for _ in 0..4 {
        let (mut there, mut back) = (Vec::new(), Vec::new());
        sender.output(now, &mut there)?;
        // Any split will do.
        there.chunks(7).for_each(|piece| receiver.receive(connection, now, piece));
        receiver.pass(now);
        receiver.output(connection, now, &mut back);
        for piece in back.chunks(5) {
            sender.receive(now, piece)?;
        }
    }
    Ok(())
}

fn notices(receiver: &mut LinkReceiver) -> String {
    let all: Vec<String> = std::iter::from_fn(|| receiver.notice()).map(|n| n.to_string()).collect();
    all.join("\n")
}

#[test]
fn a_second_writer_is_refused_with_the_name_of_the_holder() {
    let mut receiver = receiver();
    let mut first = LinkSender::new("planning office", PLAN, &machine());
    let mut second = LinkSender::new("somebody else", PlanId([8; 32]), &machine());
    assert_eq!(meet(&mut receiver, 1, &mut first, Tick(0)), Ok(()));
    let refused = meet(&mut receiver, 2, &mut second, Tick(10)).expect_err("there is a holder");
    assert!(refused.is_final());
    expect!["the machine is driven by 'planning office': wait until it is done"].assert_eq(&refused.to_string());
    assert!(
        !receiver.output(2, Tick(11), &mut Vec::new()),
        "its connection is to be closed"
    );
    assert_eq!(receiver.holder(), Some("planning office"));
    // Done: the lease is free.
    first.finish();
    assert_eq!(talk(&mut receiver, 1, &mut first, Tick(20)), Ok(()));
    receiver.disconnected(1, Tick(21));
    assert_eq!(meet(&mut receiver, 3, &mut second, Tick(30)), Ok(()));
    expect![[r#"
        'planning office' drives the machine
        'somebody else' was refused: the machine is driven by 'planning office': wait until it is done
        'planning office' is done
        'somebody else' drives the machine"#]]
    .assert_eq(&notices(&mut receiver));
}

#[test]
fn the_holder_comes_back_at_once_and_another_one_only_after_the_lease() {
    let mut receiver = receiver();
    let mut first = LinkSender::new("planning office", PLAN, &machine());
    let mut second = LinkSender::new("somebody else", PlanId([8; 32]), &machine());
    assert_eq!(meet(&mut receiver, 1, &mut first, Tick(0)), Ok(()));
    let session = first.machine().map(|w| w.session);
    receiver.disconnected(1, Tick(50));
    first.disconnected(Tick(50));
    let kept = meet(&mut receiver, 2, &mut second, Tick(60)).expect_err("it may come back");
    expect!["the machine is kept for 'planning office', which is gone: it is free in some seconds, when it stands"]
        .assert_eq(&kept.to_string());
    receiver.disconnected(2, Tick(60));
    assert_eq!(meet(&mut receiver, 3, &mut first, Tick(70)), Ok(()));
    assert_eq!(first.machine().map(|w| (Some(w.session), w.continues)), Some((session, true)));
    // The same program started again has no session, and its name and plan.
    receiver.disconnected(3, Tick(80));
    let mut again = LinkSender::new("planning office", PLAN, &machine());
    assert_eq!(meet(&mut receiver, 4, &mut again, Tick(90)), Ok(()));
    assert_eq!(again.machine().map(|w| (w.continues, w.plan)), Some((false, PLAN)));
    receiver.disconnected(4, Tick(100));
    assert!(meet(&mut receiver, 5, &mut second, Tick(4_000)).is_err());
    assert_eq!(meet(&mut receiver, 6, &mut second, Tick(6_000)), Ok(()));
}

#[test]
fn a_plan_for_other_limits_is_refused() {
    let mut receiver = receiver();
    let mut other = machine();
    other.axes[1].v_max = MmPerSec(499.0);
    let mut sender = LinkSender::new("planning office", PLAN, &other);
    let refused = meet(&mut receiver, 1, &mut sender, Tick(0)).expect_err("other limits");
    expect!["'mill 3' has other limits than the plan was made for: use its machine file on both sides"]
        .assert_eq(&refused.to_string());
}

#[test]
fn both_sides_give_up_a_silent_other_and_the_machine_hears_of_it_once() {
    let mut receiver = receiver();
    let mut sender = LinkSender::new("planning office", PLAN, &machine());
    assert_eq!(meet(&mut receiver, 1, &mut sender, Tick(0)), Ok(()));
    while receiver.urgent().is_some() {}
    for now in 1..=300 {
        receiver.pass(Tick(now));
        assert!(receiver.output(1, Tick(now), &mut Vec::new()));
        assert_eq!(sender.output(Tick(now), &mut Vec::new()), Ok(()));
    }
    assert_eq!(receiver.urgent(), None);
    assert_eq!(sender.output(Tick(301), &mut Vec::new()), Err(LinkError::Silent));
    for now in 301..400 {
        receiver.pass(Tick(now));
    }
    assert_eq!((receiver.urgent(), receiver.urgent()), (Some(UrgentOrder::LinkLost), None));
    assert!(!receiver.output(1, Tick(400), &mut Vec::new()));
}

#[test]
fn heartbeats_keep_an_idle_link() {
    let mut receiver = receiver();
    let mut sender = LinkSender::new("planning office", PLAN, &machine());
    assert_eq!(meet(&mut receiver, 1, &mut sender, Tick(0)), Ok(()));
    for now in 1..3_000 {
        assert_eq!(talk(&mut receiver, 1, &mut sender, Tick(now)), Ok(()), "at {now}");
    }
    assert!(sender.status().linked);
    assert_eq!(receiver.counts().losses, 0);
}

/// Frames as somebody else would write them.
struct Forger {
    sequence: u32,
}

impl Forger {
    fn frame(&mut self, kind: Kind, session: u32, payload: impl Fn(&mut machine::link::Writer<'_>)) -> Vec<u8> {
        self.sequence += 1;
        let mut bytes = vec![0; 48 * 1024];
        let header = Header {
            kind,
            session,
            sequence: self.sequence,
            acknowledged: 0,
        };
        let length = write_frame(&mut bytes, &header, payload).expect("it fits");
        bytes.truncate(length);
        bytes
    }

    fn hello(&mut self) -> Vec<u8> {
        let hello = Hello {
            units: UNITS,
            axes: 3,
            name: Name::new("forger"),
            plan: PLAN,
            limits: LimitsHash::of(&machine()),
            session: 0,
            reports: 0,
            firings: 0,
        };
        self.frame(Kind::Hello, 0, |to| hello.write(to))
    }
}

/// What the controller says to frames after a good hello; nothing of them must reach the machine.
#[track_caller]
fn check_refused(frames: impl Fn(&mut Forger) -> Vec<u8>, said: &str) {
    let mut receiver = receiver();
    receiver.connected(1, Tick(0));
    let mut forger = Forger { sequence: 0 };
    receiver.receive(1, Tick(0), &forger.hello());
    notices(&mut receiver);
    let bytes = frames(&mut forger);
    receiver.receive(1, Tick(1), &bytes);
    assert_eq!(notices(&mut receiver), format!("connection 1 was closed: {said}"));
    assert_eq!(receiver.order(), None);
    assert!(!receiver.output(1, Tick(1), &mut Vec::new()));
    // Nothing more is read there.
    receiver.receive(1, Tick(2), &forger.hello());
    assert_eq!(notices(&mut receiver), "");
}

fn block(first: u64, cycle: u64, body: u16, tail: u16, entries: usize) -> impl Fn(&mut machine::link::Writer<'_>) {
    move |to| {
        let head = BlockHead {
            epoch: 0,
            first,
            cycle,
            body,
            tail,
        };
        head.write(to);
        let entry = Entry {
            command: Command::SetPoint(SetPoint::default()),
            done: 1,
        };
        (0..entries).for_each(|_| entry.write(to));
    }
}

#[test]
fn frames_against_the_rules_close_the_connection_and_reach_nothing() {
    let rules = |what: &str| format!("the other side broke the rules of the link: {what}");
    check_refused(
        |f| f.frame(Kind::Block, 1, block(5, 0, 1, 0, 1)),
        &rules("a block does not follow the one before"),
    );
    check_refused(
        |f| f.frame(Kind::Block, 1, block(0, 3, 1, 0, 1)),
        &rules("a block does not follow the one before"),
    );
    check_refused(
        |f| f.frame(Kind::Block, 1, block(0, 0, 65, 0, 65)),
        &rules("a block is longer than blocks are"),
    );
    check_refused(
        |f| f.frame(Kind::Block, 1, block(0, 0, 1, 251, 252)),
        &rules("a block is longer than blocks are"),
    );
    check_refused(
        |f| f.frame(Kind::Block, 9, block(0, 0, 1, 0, 1)),
        &rules("a frame of another session"),
    );
    check_refused(|f| f.hello(), &rules("a frame of another session"));
    check_refused(
        |f| f.frame(Kind::Reports, 1, |_| {}),
        &rules("only a controller sends such a frame"),
    );
    check_refused(
        |f| f.frame(Kind::Block, 1, block(0, 0, 2, 0, 1)),
        "byte 96 of the connection: in the frame, byte 135: a byte was expected",
    );
    check_refused(
        |f| f.frame(Kind::Block, 1, block(0, 0, 1, 0, 2)),
        "byte 96 of the connection: in the frame, byte 135: the end of the frame was expected",
    );
    check_refused(
        |f| f.frame(Kind::Urgent, 1, |to| 77u8.write(to)),
        "byte 96 of the connection: in the frame, byte 0: the number of a Urgent was expected",
    );
    check_refused(
        |f| {
            f.sequence += 1;
            f.frame(Kind::Heartbeat, 1, |to| 0u64.write(to))
        },
        "frame 2 is missing: frame 3 came",
    );
}

#[test]
fn bytes_that_are_no_frame_are_named_with_their_place() {
    #[track_caller]
    fn check(bytes: &[u8], said: &str) {
        let mut reader = FrameReader::new();
        let mut rest = bytes;
        let error = loop {
            match reader.feed(&mut rest) {
                Ok(Some(_)) => {}
                Ok(None) => panic!("no error"),
                Err(error) => break error,
            }
        };
        assert_eq!(error.to_string(), said);
    }
    let mut forger = Forger { sequence: 0 };
    let good = forger.hello();
    check(
        b"GET / HTTP/1.1\r\n",
        "byte 0 of the connection: no frame has 542393671 bytes: is the other side a toolmark?",
    );
    check(
        &[0; 30],
        "byte 0 of the connection: no frame has 0 bytes: is the other side a toolmark?",
    );
    let mut flipped = [good.clone(), good.clone()].concat();
    let at = good.len() + 40;
    flipped[at] ^= 1;
    let error = {
        let mut reader = FrameReader::new();
        let mut rest = &flipped[..];
        assert!(matches!(reader.feed(&mut rest), Ok(Some(_))));
        reader.feed(&mut rest).expect_err("damaged")
    };
    assert_eq!(error.offset, good.len() as u64);
    assert!(error.to_string().contains("damaged frame"), "{error}");
    let mut newer = good.clone();
    newer[6] = 9;
    let end = newer.len() - 4;
    let checksum = machine::link::crc::crc32c(&newer[..end]);
    newer[end..].copy_from_slice(&checksum.to_le_bytes());
    check(
        &newer,
        "byte 0 of the connection: the other side speaks version 9 of the link, this one 3: use the same release on both",
    );
}

#[test]
fn a_frame_that_comes_twice_is_passed_over() {
    let mut receiver = receiver();
    receiver.connected(1, Tick(0));
    let mut forger = Forger { sequence: 0 };
    let hello = forger.hello();
    let block = forger.frame(Kind::Block, 1, block(0, 0, 2, 0, 2));
    receiver.receive(1, Tick(0), &[hello.clone(), hello, block.clone(), block].concat());
    let orders: Vec<Order> = std::iter::from_fn(|| receiver.order()).collect();
    assert_eq!(
        (orders.len(), receiver.counts().duplicates, receiver.counts().broken),
        (3, 2, 0)
    );
}

#[test]
fn a_refusal_reads_like_a_sentence() {
    expect!["the other side means other units or axes: use the same release on both"].assert_eq(&Refusal::Units.to_string());
}

#[test]
fn cycle_start_is_not_passed_on_while_nobody_is_there() {
    let parameters = machine();
    let mut half = Box::new(RealtimeHalf::new(
        &parameters,
        Plant::new(&parameters, Point::ORIGIN, 1),
        Quality::Simulated,
    ));
    let mut follower = Box::new(Follower::new());
    half.request(Request::PowerOn);
    half.tick(Tick(0));
    follower.after_tick(&mut half);
    let session = UrgentOrder::NewSession {
        session: 1,
        same_plan: false,
    };
    follower.take_urgent(session, &mut half);
    follower.take_urgent(UrgentOrder::Urgent(Urgent::Resume { epoch: 1, done: 0 }), &mut half);
    let pause = Entry {
        command: Command::Pause { step: units::StepId(1) },
        done: 1,
    };
    assert_eq!(follower.take(Order::Block { epoch: 1, first: 0 }, &mut half), Ok(()));
    assert_eq!(follower.take(Order::Body { epoch: 1, entry: pause }, &mut half), Ok(()));
    (1..20).for_each(|now| half.tick(Tick(now)));
    assert_eq!(half.controller().state(), State::Paused);
    follower.take_urgent(UrgentOrder::LinkLost, &mut half);
    follower.take_urgent(UrgentOrder::Urgent(Urgent::Request(Request::CycleStart)), &mut half);
    assert_eq!(half.controller().state(), State::Paused);
    follower.take_urgent(UrgentOrder::LinkBack, &mut half);
    follower.take_urgent(UrgentOrder::Urgent(Urgent::Request(Request::CycleStart)), &mut half);
    assert_ne!(half.controller().state(), State::Paused);
}

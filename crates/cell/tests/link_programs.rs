//! Programs of all kinds over the link end as they end without it, and a person at the machine is obeyed through it.

mod common;

use cell::link::world::{LinkFault, LinkedConfig, LinkedWorld};
use cell::sink::Kept;
use cell::source::Planned;
use cell::{Ended, Output, World, WorldConfig};
use common::{Writer, small_program};
use machine::{Command, CoolantOutlets, MachineParameters, Overrides, Request, SetPoint, State, StopCause};
use plan::{Alarm, Diagnostic, Question, StepKind, StopKind};
use units::{Rpm, StepId, Tick};

fn machine() -> MachineParameters {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = units::Seconds(0.3);
    machine
}

fn config(delay: (u64, u64)) -> LinkedConfig {
    LinkedConfig {
        machine: machine(),
        delay,
        batch: 10,
        ..LinkedConfig::default()
    }
}

fn direct(program: Planned) -> (Ended, Kept) {
    let config = WorldConfig {
        machine: machine(),
        operator: LinkedConfig::default().operator,
        ..WorldConfig::default()
    };
    let mut kept = Kept::default();
    let outcome = World::new(config, program).expect("a sound machine").run(&mut kept);
    (outcome.ended, kept)
}

fn linked(config: LinkedConfig, program: &Planned) -> (Ended, Kept) {
    let mut world = LinkedWorld::new(config, || program.clone());
    let mut kept = Kept::default();
    loop {
        if let Some(ended) = world.advance(&mut kept, &mut |_| {}) {
            return (ended, kept);
        }
        let status = (world.sender().map(|s| s.status()), world.follower().status());
        assert!(
            world.now().0 < 120_000,
            "does not end: {status:?}, {:?}",
            world.realtime().controller().state()
        );
    }
}

/// Rows in which the machine is given a new place.
fn path(kept: &Kept) -> Vec<[u64; 3]> {
    let mut path: Vec<[u64; 3]> = kept.samples.iter().map(|s| s.commanded.map(f64::to_bits)).collect();
    path.dedup();
    path
}

fn kinds(kept: &Kept) -> Vec<String> {
    kept.events
        .iter()
        .map(|e| e.kind.clone())
        .filter(|k| k != "job-started")
        .collect()
}

/// The same end, places and events with and without a link, on wires fast and slow.
#[track_caller]
fn check(program: Planned, ended: &Ended) {
    let (direct_ended, direct) = direct(program.clone());
    assert_eq!(&direct_ended, ended);
    for delay in [(0, 0), (3, 9), (40, 60)] {
        let (linked_ended, linked) = linked(config(delay), &program);
        assert_eq!(linked_ended, direct_ended, "delay {delay:?}");
        assert_eq!(kinds(&linked), kinds(&direct), "delay {delay:?}");
        assert!(path(&linked) == path(&direct), "another path with a delay of {delay:?}");
    }
}

#[test]
fn an_empty_program_and_one_without_motion_end() {
    check(Writer::default().finish(), &Ended::Completed);
    let mut w = Writer::default();
    w.tool(2, 8.0);
    w.spindle(1000.0);
    w.pass(StepKind::Message("hello".to_owned()));
    check(w.finish(), &Ended::Completed);
}

#[test]
fn switching_along_the_path_is_done_where_it_stands() {
    let mut w = Writer::default();
    w.spindle(3000.0);
    w.go([20.0, 0.0, 0.0], 50.0);
    let mut program = w.finish();
    let mut outputs = std::mem::take(&mut program.outputs);
    for (at, command) in [
        (60, Command::SpindleSpeed(Rpm(3200.0))),
        (120, Command::SpindleSpeed(Rpm(3400.0))),
        (
            180,
            Command::Coolant {
                outlets: CoolantOutlets {
                    flood: true,
                    ..CoolantOutlets::default()
                },
                step: StepId(2),
            },
        ),
        (
            240,
            Command::Workingstep {
                workingstep: units::WorkingstepId(4),
                step: StepId(2),
            },
        ),
    ] {
        outputs.insert(at, Output::Command(command));
    }
    program.outputs = outputs;
    check(program.clone(), &Ended::Completed);
    let fastest = |kept: &Kept| kept.samples.iter().map(|s| s.spindle_speed).fold(0.0, f64::max);
    let undisturbed = fastest(&direct(program.clone()).1);
    assert!(undisturbed > 3_250.0, "{undisturbed}");
    // And once each when the link is cut among them.
    for at in [560u64, 600, 640, 700, 760] {
        let faults = vec![LinkFault::Cut {
            at: Tick(at),
            ticks: 900,
            noticed: true,
        }];
        let (ended, kept) = linked(
            LinkedConfig {
                faults,
                ..config((1, 3))
            },
            &program,
        );
        assert_eq!(ended, Ended::Completed, "cut at {at}");
        let last = kept
            .samples
            .iter()
            .rev()
            .find(|s| s.workingstep.0 == 4)
            .map(|s| s.commanded[0]);
        assert!(last.is_some_and(|x| x > 19.9), "cut at {at}: {last:?}");
        assert!(fastest(&kept) > undisturbed - 5.0, "cut at {at}: {}", fastest(&kept));
    }
}

#[test]
fn stops_pauses_and_questions_wait_for_the_person() {
    let mut w = Writer::default();
    w.go([5.0, 0.0, 0.0], 100.0);
    let step = w.pass(StepKind::Stop(StopKind::Program));
    w.command(Command::Pause { step });
    w.go([5.0, 5.0, 0.0], 100.0);
    w.say(Output::Ask(Question::OptionalStop));
    w.go([0.0, 0.0, 0.0], 100.0);
    w.say(Output::Ask(Question::Number("X.POSITION.ACTUAL".to_owned())));
    check(w.finish(), &Ended::Completed);
}

#[test]
fn what_stops_a_program_stops_it_over_the_link_too() {
    // Beyond the travel.
    let mut w = Writer::default();
    w.go([0.0, 0.0, 990.0], 400.0);
    w.go([0.0, 0.0, 1010.0], 50.0);
    check(w.finish(), &Ended::Stopped(StopCause::SoftLimit { axis: 2 }));
    // A jump.
    let mut w = Writer::default();
    w.go([10.0, 0.0, 0.0], 100.0);
    w.command(Command::SetPoint(SetPoint {
        position: [11.0, 0.0, 0.0],
        ..SetPoint::default()
    }));
    check(w.finish(), &Ended::Stopped(StopCause::Jump { axis: 0 }));
    // An alarm, at rest.
    let alarm = Alarm {
        number: 3006,
        diagnostic: Diagnostic::error("alarm", "BROKEN TOOL"),
    };
    let mut w = Writer::default();
    w.go([10.0, 0.0, 0.0], 100.0);
    w.say(Output::Alarm(alarm.clone()));
    check(w.finish(), &Ended::Alarm(Box::new(alarm)));
}

#[test]
fn a_path_that_ends_in_motion_is_stopped_on() {
    let mut w = Writer::default();
    w.go([60.0, 0.0, 0.0], 100.0);
    let mut program = w.finish();
    program.outputs.truncate(300);
    let (ended, kept) = linked(config((1, 5)), &program);
    assert_eq!(ended, Ended::Stopped(StopCause::SwitchInMotion));
    let all: Vec<f64> = kept.samples.iter().map(|s| s.commanded[0]).collect();
    assert!(
        all.windows(2).all(|pair| pair[1] >= pair[0] && pair[1] - pair[0] < 0.11),
        "it does not go back, nor jump"
    );
}

#[test]
fn holds_overrides_and_stops_of_a_person_go_through_and_the_path_is_kept() {
    let plan = path(&direct(small_program()).1);
    for seed in 1..=12u64 {
        let faults = if seed % 3 == 0 {
            vec![LinkFault::Stall {
                at: Tick(900 + 150 * seed),
                ticks: 600,
            }]
        } else {
            Vec::new()
        };
        let mut world = LinkedWorld::new(
            LinkedConfig {
                faults,
                seed,
                ..config((1, 8))
            },
            small_program,
        );
        let mut kept = Kept::default();
        let mut states = Vec::new();
        let ended = loop {
            let now = world.now().0;
            let feed = [30, 150, 0, 70, 100][((now / 300 + seed) % 5) as usize];
            if now > 600 && now.is_multiple_of(300) && now < 4_000 {
                world.request(Request::Override(Overrides {
                    feed,
                    rapid: feed.min(100),
                    spindle: 100,
                }));
            }
            if now == 4_000 {
                world.request(Request::Override(Overrides::default()));
            }
            if now == 1_000 + 77 * seed {
                world.request(Request::Hold);
            }
            let ended = world.advance(&mut kept, &mut |report| {
                if states.last() != Some(&report.state) {
                    states.push(report.state);
                }
            });
            if let Some(ended) = ended {
                break ended;
            }
            assert!(now < 120_000, "seed {seed} does not end: {states:?}");
        };
        assert_eq!(ended, Ended::Completed, "seed {seed}: {states:?}");
        assert!(states.contains(&State::Held), "seed {seed}: {states:?}");
        assert_eq!(path(&kept).last(), plan.last(), "seed {seed}");
        // The rectangles have straight sides: a place beside them has two coordinates that no side has.
        let places: Vec<[f64; 3]> = kept.samples.iter().map(|s| s.commanded).collect();
        let sides = [[10.0, 30.0, 15.0, 23.0], [10.0, 25.0, 15.0, 21.0], [20.0, -1.0, -2.0, 20.0]];
        let off = |p: &[f64; 3]| (0..3).filter(|&k| sides[k].iter().all(|s| (p[k] - s).abs() > 1e-9)).count();
        let beside = places
            .iter()
            .filter(|p| p[2] < 19.0 && p[0] > 9.99 && p[1] > 9.99 && off(p) > 1)
            .count();
        assert_eq!(beside, 0, "seed {seed}");
    }
}

#[test]
fn a_second_job_on_the_same_controller_begins_from_nothing() {
    use cell::link::{LinkReceiver, LinkSender, MachineCard};
    use machine::link::{Follower, PlanId};
    use machine::{Plant, Quality, RealtimeHalf};
    let parameters = machine();
    let plant = Plant::new(&parameters, units::Point::ORIGIN, 1);
    let mut half = Box::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated));
    half.request(Request::PowerOn);
    let mut follower = Box::new(Follower::new());
    let mut receiver = LinkReceiver::new(MachineCard::new("mill", Quality::Simulated, &parameters));
    let mut now = Tick(0);
    for job in 1..=3u32 {
        let mut w = Writer::default();
        // Each job goes there and back.
        w.go([f64::from(job), 0.0, 0.0], 20.0);
        w.go([0.0, 0.0, 0.0], 20.0);
        let commands: Vec<Command> = w
            .finish()
            .outputs
            .into_iter()
            .filter_map(|o| if let Output::Command(c) = o { Some(c) } else { None })
            .collect();
        let count = commands.len() as u64;
        let mut commands = commands.into_iter();
        let mut waiting = None;
        let mut sender = LinkSender::new("office", PlanId([job as u8; 32]), &parameters);
        receiver.connected(job, now);
        sender.connected(now);
        let (mut furthest, mut first, mut last) = (0.0f64, None, None);
        for _ in 0..3_000 {
            while let Some(command) = waiting.take().or_else(|| commands.next()) {
                if let Err(back) = sender.push(command) {
                    waiting = Some(back);
                    break;
                }
            }
            let (mut there, mut back) = (Vec::new(), Vec::new());
            sender.output(now, &mut there).expect("linked");
            receiver.receive(job, now, &there);
            while let Some(urgent) = receiver.urgent() {
                follower.take_urgent(urgent, &mut half);
            }
            while let Some(order) = receiver.order() {
                if let Err(order) = follower.take(order, &mut half) {
                    receiver.give_back(order);
                    break;
                }
            }
            half.tick(now);
            follower.after_tick(&mut half);
            while let Some(report) = half.report() {
                receiver.reported(follower.translated(report), follower.status());
            }
            receiver.pass(now);
            receiver.output(job, now, &mut back);
            sender.receive(now, &back).expect("linked");
            while let Some(report) = sender.report() {
                first.get_or_insert(report.counters);
                furthest = furthest.max(report.sample.commanded[0]);
                last = Some(report.counters);
            }
            now += 1;
        }
        assert_eq!(first.map(|c| (c.completed, c.accepted)), Some((0, 0)), "job {job}");
        assert_eq!(
            last.map(|c| c.completed),
            Some(count),
            "job {job}: {:?} {:?}",
            half.controller().state(),
            sender.status()
        );
        assert!((furthest - f64::from(job)).abs() < 1e-9, "job {job}: {furthest}");
        sender.finish();
        let mut there = Vec::new();
        sender.output(now, &mut there).expect("linked");
        receiver.receive(job, now, &there);
        receiver.disconnected(job, now);
        // The program is not ended by an end command here: the person does it.
        while let Some(urgent) = receiver.urgent() {
            follower.take_urgent(urgent, &mut half);
        }
        half.request(Request::Stop);
        // The last set-point of a job is at rest but for rounding: the controller takes its time over it.
        for _ in 0..400 {
            half.tick(now);
            follower.after_tick(&mut half);
            half.request(Request::Reset);
            now += 1;
        }
        assert_eq!(half.controller().state(), State::Ready, "job {job}");
        while half.report().is_some() {}
    }
}

//! The simulated world as a whole: repeatable, complete, and safe whatever goes wrong.
#![allow(clippy::disallowed_methods, reason = "SEED picks one random run")]

mod common;

use cell::sink::Kept;
use cell::{Ended, Fault, Operator, Outcome, Output, World, WorldConfig};
use common::{Writer, small_program};
use ledger::Hash;
use machine::{Command, MachineParameters, Phase, Quality, StopCause};
use plan::{Alarm, Answer, Diagnostic, Question, StepKind, StopKind};
use units::{Tick, Timestamp, ToolNumber, WorkingstepId};

fn config() -> WorldConfig {
    let mut machine = MachineParameters::small_machining_centre();
    // Short, so that debug builds have less to wait for.
    machine.tool_change = units::Seconds(0.3);
    WorldConfig {
        start: Timestamp(1_700_000_000_000_000_000),
        machine,
        program_hash: Hash::of(b"small program"),
        ..WorldConfig::default()
    }
}

fn run(config: WorldConfig, source: cell::source::Planned) -> (Outcome, Kept) {
    let mut kept = Kept::default();
    let outcome = World::new(config, source).expect("a sound machine").run(&mut kept);
    (outcome, kept)
}

#[test]
fn a_program_runs_to_its_end_and_every_step_has_its_tick() {
    let (outcome, kept) = run(config(), small_program());
    assert_eq!(outcome.ended, Ended::Completed);
    assert_eq!((outcome.counters.completed, outcome.outstanding), (outcome.commands, 0));
    for k in 0..3 {
        let error = |s: &&machine::Sample| (s.commanded[k] - s.actual[k]).abs();
        let worst = kept
            .samples
            .iter()
            .max_by(|a, b| error(a).total_cmp(&error(b)))
            .expect("it ran");
        println!(
            "axis {k}: worst following error {:.4} mm at tick {}, {worst:?}",
            error(&worst),
            worst.tick.0
        );
    }
    assert!(outcome.worst_following_error < 0.05, "{} mm", outcome.worst_following_error);
    assert_eq!(ledger::verify(&kept.events), Ok(outcome.chain));
    let kinds: Vec<&str> = kept.events.iter().map(|e| e.kind.as_str()).collect();
    expect_test::expect![[r#"
        [
            "job-started",
            "frame",
            "tool",
            "tool-offset",
            "spindle",
            "coolant",
            "begin",
            "end",
            "begin",
            "end",
            "job-ended",
        ]
    "#]]
    .assert_debug_eq(&kinds);
    // All of a workingstep's rows lie between its begin and its end.
    let tick_of = |n: usize| kept.events[n].detail["tick"].as_u64().expect("a number");
    for (begin, end, number) in [(6, 7, 1), (8, 9, 2)] {
        let ticks: Vec<u64> = kept
            .samples
            .iter()
            .filter(|s| s.workingstep == WorkingstepId(number))
            .map(|s| s.tick.0)
            .collect();
        assert_eq!(kept.events[begin].detail["workingstep"], number);
        // Its turn may come within the cycle in which it moves already.
        let first = *ticks.first().expect("it has rows");
        assert!(first == tick_of(begin) || first == tick_of(begin) + 1);
        assert!(ticks.last() <= Some(&(tick_of(end) + 1)));
        assert_eq!(
            kept.events[begin].at_ns,
            1_700_000_000_000_000_000 + tick_of(begin) as i64 * 1_000_000
        );
    }
    assert!(kept.samples.iter().all(|s| s.quality == Quality::Simulated));
    assert_eq!(kept.samples.len() as u64, outcome.samples);
    // The tool is in the spindle before the first workingstep begins.
    assert!(kept.samples.iter().all(|s| s.workingstep.0 == 0 || s.tool == ToolNumber(1)));
}

#[test]
fn the_same_seed_gives_the_same_bytes_in_debug_and_release() {
    let (first, _) = run(config(), small_program());
    let (again, _) = run(config(), small_program());
    assert_eq!(first, again);
    let (other, _) = run(WorldConfig { seed: 2, ..config() }, small_program());
    assert_ne!(first.digest, other.digest);
    println!("digest {}", first.digest);
    expect_test::expect!["c534ebd4aeaf88b99f6b17358e1d8998b974b08a1c9e53e2bb63106de5d0eea9"].assert_eq(&first.digest.to_string());
}

#[test]
fn running_in_slices_is_the_same_run() {
    let (whole, _) = run(config(), small_program());
    let mut world = World::new(config(), small_program()).expect("a sound machine");
    let sliced = loop {
        if let Some(outcome) = world.advance(7, &mut ()) {
            break outcome;
        }
    };
    assert_eq!(whole, sliced);
}

/// What must hold whatever goes wrong.
fn check_invariants(seed: u64, config: &WorldConfig, outcome: &Outcome, kept: &Kept) {
    let about = || format!("SEED={seed}, {:?}: {:?}", config.faults, outcome.ended);
    assert_eq!(ledger::verify(&kept.events), Ok(outcome.chain), "{}", about());
    let c = outcome.counters;
    assert_eq!(c.accepted, outcome.commands, "{}", about());
    assert_eq!(c.accepted, c.completed + c.discarded + outcome.outstanding, "{}", about());
    if outcome.ended == Ended::Completed {
        assert_eq!(c.completed, outcome.commands, "{}", about());
    }
    let faulted = matches!(outcome.ended, Ended::Fault(_) | Ended::EmergencyStop);
    let bound = config.machine.following_fault.0;
    let glitch = |tick: Tick| {
        config.faults.iter().any(|f| match f {
            Fault::EncoderGlitch { at, ticks, .. } => tick >= *at && tick - *at <= *ticks + 1,
            _ => false,
        })
    };
    for s in &kept.samples {
        for k in 0..3 {
            let axis = &config.machine.axes[k];
            let error = (s.commanded[k] - s.actual[k]).abs();
            let moving_by_program = matches!(s.phase, Phase::Running | Phase::Waiting | Phase::Paused | Phase::Stopped);
            assert!(
                !moving_by_program || error <= bound || glitch(s.tick),
                "{} mm in {s:?}: {}",
                error,
                about()
            );
            assert!(
                s.commanded[k] >= axis.lowest.0 && s.commanded[k] <= axis.highest.0,
                "{}",
                about()
            );
        }
    }
    // The last 10 ms: at rest.
    let tail = &kept.samples[kept.samples.len().saturating_sub(10)..];
    for k in 0..3 {
        let places = || tail.iter().filter(|s| !glitch(s.tick)).map(|s| s.actual[k]);
        let moved = places().fold(f64::MIN, f64::max) - places().fold(f64::MAX, f64::min);
        assert!(moved <= 0.005, "axis {k} still moves {moved} mm: {}", about());
    }
    // Every row that the program moved lies on the program's lines, or the stop says otherwise.
    if c.off_path_stops == 0 && !faulted {
        let lines = lines_of(small_program());
        for s in &kept.samples {
            let off = lines
                .iter()
                .map(|(a, b)| distance(s.commanded, *a, *b))
                .fold(f64::MAX, f64::min);
            assert!(off < 0.002, "{off} mm off the path in {s:?}: {}", about());
        }
    }
}

fn lines_of(program: cell::source::Planned) -> Vec<([f64; 3], [f64; 3])> {
    let mut rests = vec![[0.0; 3]];
    for output in program.outputs {
        if let Output::Command(Command::SetPoint(s)) = output
            && s.velocity == [0.0; 3]
        {
            rests.push(s.position);
        }
    }
    rests.windows(2).map(|w| (w[0], w[1])).collect()
}

fn distance(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let sub = |u: [f64; 3], v: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| u[k] - v[k]) };
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (d, e) = (sub(b, a), sub(p, a));
    let t = (dot(e, d) / dot(d, d).max(1e-12)).clamp(0.0, 1.0);
    let off = sub(e, d.map(|x| x * t));
    dot(off, off).sqrt()
}

#[test]
fn a_hundred_seeds_of_faults_break_nothing() {
    let seeds = match std::env::var("SEED") {
        Ok(seed) => vec![seed.parse().expect("SEED is a number")],
        Err(_) => {
            let count = std::env::var("SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(100);
            // 328: an axis that crept at 0.8 mm/s after a drive fault was taken for standing.
            (1..=count).chain([328]).collect::<Vec<u64>>()
        }
    };
    let mut endings = std::collections::BTreeMap::<&str, u32>::new();
    for seed in &seeds {
        let config = WorldConfig {
            seed: *seed,
            faults: Fault::from_seed(*seed, Tick(5000)),
            operator: Operator {
                optional_stop: false,
                cycle_start_after: Some(200),
            },
            ..config()
        };
        let (outcome, kept) = run(config.clone(), small_program());
        check_invariants(*seed, &config, &outcome, &kept);
        *endings.entry(outcome.ended.word()).or_default() += 1;
    }
    println!("{endings:?}");
    if seeds.len() == 100 {
        // The dice are thrown so that all of these happen; if not, the test has lost its teeth.
        for word in ["completed", "stopped", "emergency-stop", "fault"] {
            assert!(endings.contains_key(word), "{endings:?}");
        }
    }
}

#[test]
fn a_link_that_stalls_for_good_time_and_comes_back_finishes_the_program() {
    let config = WorldConfig {
        faults: vec![Fault::LinkStall {
            at: Tick(2500),
            ticks: 1500,
        }],
        operator: Operator {
            cycle_start_after: Some(100),
            ..Operator::default()
        },
        ..config()
    };
    let (outcome, kept) = run(config.clone(), small_program());
    assert_eq!(outcome.ended, Ended::Completed);
    assert!(kept.events.iter().any(|e| e.kind == "cycle-start"));
    check_invariants(0, &config, &outcome, &kept);
    // And without a person it ends there, at rest.
    let nobody = WorldConfig {
        operator: Operator::default(),
        ..config
    };
    let (outcome, _) = run(nobody, small_program());
    assert_eq!(outcome.ended, Ended::Stopped(StopCause::Starved));
}

#[test]
fn a_question_is_answered_at_rest_after_everything_before_it() {
    let mut w = Writer::default();
    w.go([30.0, 0.0, 0.0], 100.0);
    w.say(Output::Ask(Question::Number("#5041".to_owned())));
    w.go([0.0, 0.0, 0.0], 100.0);
    let mut seen = Vec::new();
    let mut world = World::new(config(), w.finish())
        .expect("a sound machine")
        .answered_by(Box::new(|question, sample| {
            seen.push((question.clone(), sample.actual[0]));
            Answer::Number(Some(sample.actual[0]))
        }));
    let mut kept = Kept::default();
    let outcome = world.run(&mut kept);
    drop(world);
    assert_eq!(outcome.ended, Ended::Completed);
    assert_eq!(seen.len(), 1);
    assert!((seen[0].1 - 30.0).abs() < 0.01, "{seen:?}");
    let event = kept.events.iter().find(|e| e.kind == "question").expect("it was asked");
    assert_eq!(event.detail["question"], "#5041");
}

#[test]
fn an_alarm_lets_what_came_before_be_done_and_stops_for_good() {
    let mut w = Writer::default();
    w.spindle(3000.0);
    w.go([30.0, 0.0, 0.0], 100.0);
    let alarm = Alarm::from(Diagnostic::error("test", "no such tool"));
    w.say(Output::Alarm(alarm.clone()));
    let (outcome, kept) = run(config(), w.finish());
    assert_eq!(outcome.ended, Ended::Alarm(Box::new(alarm)));
    let last = kept.samples.last().expect("it ran");
    assert!((last.actual[0] - 30.0).abs() < 0.01);
    assert_eq!(kept.events.iter().filter(|e| e.kind == "alarm").count(), 1);
    // At once, too.
    let mut w = Writer::default();
    w.say(Output::Alarm(Alarm::from(Diagnostic::error("test", "empty"))));
    assert!(matches!(run(config(), w.finish()).0.ended, Ended::Alarm(_)));
}

#[test]
fn an_alarm_in_the_middle_of_a_motion_is_still_an_alarm_and_a_stop_on_the_path() {
    let mut w = Writer::default();
    w.go([60.0, 0.0, 0.0], 100.0);
    let mut program = w.finish();
    program.outputs.truncate(300);
    program
        .outputs
        .push_back(Output::Alarm(Alarm::from(Diagnostic::error("test", "broken off"))));
    let (outcome, _) = run(config(), program);
    assert!(matches!(outcome.ended, Ended::Alarm(_)), "{:?}", outcome.ended);
    assert_eq!(outcome.counters.off_path_stops, 0);
}

#[test]
fn a_program_stop_waits_for_the_person() {
    let program = || {
        let mut w = Writer::default();
        w.go([10.0, 0.0, 0.0], 100.0);
        let step = w.pass(StepKind::Stop(StopKind::Program));
        w.command(Command::Pause { step });
        w.go([20.0, 0.0, 0.0], 100.0);
        w.finish()
    };
    assert_eq!(run(config(), program()).0.ended, Ended::Waiting);
    let operator = Operator {
        cycle_start_after: Some(500),
        ..Operator::default()
    };
    let (outcome, kept) = run(WorldConfig { operator, ..config() }, program());
    assert_eq!(outcome.ended, Ended::Completed);
    let paused = kept.samples.iter().filter(|s| s.phase == Phase::Paused).count();
    assert!((500..505).contains(&paused), "{paused}");
    assert!(kept.events.iter().any(|e| e.kind == "stop"));
}

#[test]
fn an_empty_program_ends() {
    let (outcome, _) = run(config(), cell::source::Planned::default());
    assert_eq!(outcome.ended, Ended::Completed);
}

#[test]
fn a_machine_that_cannot_be_is_refused() {
    let mut bad = config();
    bad.machine.axes[2].mechanics.inertia = 0.0;
    let error = World::new(bad, cell::source::Planned::default()).err().expect("refused");
    assert_eq!(error.to_string(), "axis Z: mechanics.inertia is 0, it has to be above 0");
}

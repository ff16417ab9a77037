//! A person at the simulated machine: the control pad by script, homing before a run, overrides while it runs.

mod common;

use cell::sink::Kept;
use cell::{CommandSource, Ended, Operator, Outcome, Output, World, WorldConfig};
use common::{Writer, small_program};
use machine::{Mode, Overrides, PadState, Phase, Request};
use plan::Answer;
use units::{Millimetres, Point, Tick};

fn jog(axis: u8, joystick: f64) -> PadState {
    PadState {
        selector: Mode::Jog { axis },
        joystick,
        feed: 60,
        emergency_stop: false,
        dead_man: true,
    }
}

fn somebody_there() -> WorldConfig {
    WorldConfig {
        operator: Operator {
            cycle_start_after: Some(50),
            ..Operator::default()
        },
        ..WorldConfig::default()
    }
}

fn kinds(kept: &Kept) -> Vec<&str> {
    kept.events.iter().map(|e| e.kind.as_str()).collect()
}

#[test]
fn a_run_waits_for_the_selector_and_the_selector_waits_for_the_run() {
    let script = [
        (Tick(0), jog(0, 0.0)),
        (Tick(100), jog(0, 1.0)),
        (Tick(400), jog(0, 0.0)),
        (Tick(900), jog(0, -1.0)),
        (Tick(1200), jog(0, 0.0)),
        (Tick(2000), PadState::default()),
        // While machining nobody listens to it.
        (Tick(3000), jog(2, 1.0)),
    ];
    let mut kept = Kept::default();
    let mut w = Writer::default();
    w.rectangle("pocket", [5.0, 5.0], [10.0, 10.0], -1.0);
    let mut world = World::new(somebody_there(), w.finish()).expect("sound").with_pad(script);
    let Some(outcome) = world.advance(20_000, &mut kept) else {
        panic!(
            "does not end: {:?}, {:?}",
            world.realtime().controller().state(),
            kept.samples.last()
        );
    };
    // The joystick brought the axis back to where it began; anywhere else the first set-point would be a jump and not executed.
    let first = |phase: Phase| kept.samples.iter().position(|s| s.phase == phase);
    assert!(
        first(Phase::Jogging).is_some_and(|at| (100..140).contains(&at)),
        "{:?}",
        first(Phase::Jogging)
    );
    assert!(kept.samples[..2000].iter().all(|s| s.phase != Phase::Running));
    let running = kept.samples.iter().filter(|s| s.phase == Phase::Running);
    assert!(running.clone().all(|s| s.tick >= Tick(2000)));
    let back = kept.samples.last().map(|s| s.commanded[0].abs());
    assert!(
        outcome.ended == Ended::Completed && back.is_some_and(|x| (x - 5.0).abs() < 1e-9),
        "{:?}",
        outcome.ended
    );
}

#[test]
fn machines_that_count_from_power_on_are_homed_by_who_is_there_before_the_program_runs() {
    let mut config = somebody_there();
    config.machine.absolute_encoders = false;
    for axis in &mut config.machine.axes {
        axis.highest = Millimetres(100.0);
        axis.homing.reference = Millimetres(90.0);
    }
    config.position = Point::from_xyz([10.0, -40.0, 30.0]);
    let mut kept = Kept::default();
    let outcome = World::new(config.clone(), small_program()).expect("sound").run(&mut kept);
    assert_eq!(outcome.ended, Ended::Completed);
    let homing = kinds(&kept).iter().position(|k| *k == "homing").expect("it is told");
    assert!(kept.events[homing].detail["tick"].as_u64() < Some(200));
    let first = kept.samples.iter().position(|s| s.phase == Phase::Running).expect("it ran");
    assert!(kept.samples[..first].iter().any(|s| s.phase == Phase::Homing));
    assert!(
        (0..3).all(|k| kept.samples[first].actual[k].abs() < 0.05),
        "{:?}",
        kept.samples[first]
    );
    // Nobody there: it says why it does not begin.
    config.operator = Operator::default();
    let outcome = World::new(config, small_program()).expect("sound").run(&mut ());
    assert_eq!(outcome.ended, Ended::NotHomed);
    assert!(outcome.ended.text().contains("home it"), "{}", outcome.ended.text());
}

/// A source that tells which overrides it was asked for.
struct Told {
    inner: cell::source::Planned,
    asked: std::rc::Rc<std::cell::RefCell<Vec<(f64, f64)>>>,
}

impl CommandSource for Told {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        self.inner.next(answer)
    }
    fn set_override(&mut self, feed: f64, rapid: f64) {
        self.asked.borrow_mut().push((feed, rapid));
    }
}

#[test]
fn an_override_is_told_and_only_what_is_above_100_percent_is_planned_anew() {
    let asked = std::rc::Rc::default();
    let source = Told {
        inner: small_program(),
        asked: std::rc::Rc::clone(&asked),
    };
    let mut world = World::new(somebody_there(), source).expect("sound");
    let mut kept = Kept::default();
    let mut outcome: Option<Outcome> = None;
    for (feed, rapid) in [(50, 100), (150, 50), (120, 25), (80, 100), (100, 100)] {
        world.advance(900, &mut kept);
        world.request(Request::Override(Overrides {
            feed,
            rapid,
            spindle: 90,
        }));
    }
    while outcome.is_none() {
        outcome = world.advance(1000, &mut kept);
    }
    assert_eq!(outcome.map(|o| o.ended), Some(Ended::Completed));
    assert_eq!(*asked.borrow(), [(1.5, 1.0), (1.2, 1.0), (1.0, 1.0)]);
    let told: Vec<Option<u64>> = kept
        .events
        .iter()
        .filter(|e| e.kind == "override")
        .map(|e| e.detail["feed_percent"].as_u64())
        .collect();
    assert_eq!(told, [50, 150, 120, 80, 100].map(Some));
}

#[test]
fn the_pads_emergency_stop_ends_a_run_and_the_same_script_gives_the_same_bytes() {
    let run = || {
        let script = [
            (Tick(0), PadState::default()),
            (
                Tick(4000),
                PadState {
                    emergency_stop: true,
                    ..PadState::default()
                },
            ),
        ];
        let mut kept = Kept::default();
        let outcome = World::new(somebody_there(), small_program())
            .expect("sound")
            .with_pad(script)
            .run(&mut kept);
        (outcome, kept)
    };
    let (outcome, kept) = run();
    assert_eq!(outcome.ended, Ended::EmergencyStop);
    let last = kept.samples.last().expect("it ran");
    assert!(last.velocity.iter().all(|v| v.abs() < 1.0) && last.tick < Tick(4500));
    assert_eq!(run().0, outcome);
}

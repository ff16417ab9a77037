//! The real planner in the world: corners, bends and long looks ahead, with everything that can go wrong.
#![allow(
    clippy::disallowed_methods,
    reason = "SEED picks one random run, and tests may square a number"
)]

#[path = "common/program.rs"]
mod common;
#[path = "common/path.rs"]
mod path;

use cell::sink::Kept;
use cell::{Ended, Fault, Operator, Outcome, ShiftedSetup, WorkingstepSelector, World, WorldConfig};
use common::{LENGTH, ORIGIN};
use machine::{MachineParameters, Phase};
use motion::{Limits, Trajectory};
use path::PathIndex;
use plan::{ProgramStream, StepKind};
use units::{Millimetres, Seconds, Tick, WorkingstepId};

fn limits(machine: &MachineParameters) -> Limits {
    Limits {
        v_max: machine.axes.map(|a| a.v_max),
        a_max: machine.axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    }
}

fn config() -> WorldConfig {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = Seconds(0.2);
    WorldConfig {
        machine,
        ..WorldConfig::default()
    }
}

fn run(config: WorldConfig, program: Box<dyn ProgramStream>) -> (Outcome, Kept) {
    let mut kept = Kept::default();
    let source = Trajectory::new(program, config.position, limits(&config.machine));
    let outcome = World::new(config, source).expect("a sound machine").run(&mut kept);
    (outcome, kept)
}

#[test]
fn a_planned_program_runs_to_its_end_undisturbed() {
    let (outcome, kept) = run(config(), Box::new(common::program(1)));
    assert_eq!(outcome.ended, Ended::Completed);
    let c = outcome.counters;
    assert_eq!((c.completed, c.starvations, c.following_warnings), (outcome.commands, 0, 0));
    println!(
        "{:.2} s, following error {:.4} mm",
        outcome.time.0, outcome.worst_following_error
    );
    let last = kept.samples.last().expect("it ran").commanded;
    let end = [ORIGIN[0], ORIGIN[1], ORIGIN[2] + 50.0 + LENGTH];
    assert!((0..3).all(|k| (last[k] - end[k]).abs() < 1e-9), "{last:?}");
    let begun: Vec<&str> = kept
        .events
        .iter()
        .filter(|e| e.kind == "begin")
        .filter_map(|e| e.detail["name"].as_str())
        .collect();
    assert_eq!(begun, ["square", "helix", "zig-zag"]);
}

#[test]
fn the_rebuild_reads_what_is_in_force_from_the_log() {
    let (_, kept) = run(config(), Box::new(common::program(1)));
    let read: Vec<asrun::Setting> = kept
        .events
        .iter()
        .filter_map(|e| asrun::InForce::from_event(&e.kind, &e.detail, e.at()))
        .map(|in_force| in_force.expect("a sound event").setting)
        .collect();
    let said = common::program(1).0.into_iter().filter_map(|kind| match kind {
        StepKind::Frame(frame) => Some(asrun::Setting::Frame(frame)),
        StepKind::ToolOffset(offset) => Some(asrun::Setting::ToolOffset(offset)),
        _ => None,
    });
    assert_eq!(read, said.collect::<Vec<_>>());
    assert_eq!(read.len(), 2);
}

#[test]
fn the_same_seed_gives_the_same_bytes_with_the_planner_too() {
    let (first, _) = run(config(), Box::new(common::program(1)));
    let (again, _) = run(config(), Box::new(common::program(1)));
    assert_eq!(first, again);
}

#[test]
fn a_shifted_set_up_moves_one_workingstep_and_nothing_else() {
    let shift = [0.3, -0.2, 0.0];
    let shifted = ShiftedSetup::new(
        Box::new(common::program(1)),
        WorkingstepSelector::Name("helix".to_owned()),
        shift,
    );
    let (outcome, kept) = run(config(), Box::new(shifted));
    assert_eq!(outcome.ended, Ended::Completed, "{:?}", outcome.ended);
    let (_, right) = run(config(), Box::new(common::program(1)));
    // Only where it is deep: a workingstep's way in begins where the one before ended.
    let middle = |kept: &Kept, number: u32| -> [f64; 2] {
        let rows = || {
            kept.samples
                .iter()
                .filter(|s| s.workingstep == WorkingstepId(number) && s.commanded[2] < ORIGIN[2] + LENGTH - 0.9)
        };
        std::array::from_fn(|k| {
            let low = rows().map(|s| s.commanded[k]).fold(f64::MAX, f64::min);
            let high = rows().map(|s| s.commanded[k]).fold(f64::MIN, f64::max);
            (low + high) / 2.0
        })
    };
    for number in [1, 2, 3] {
        let (a, b) = (middle(&kept, number), middle(&right, number));
        for k in 0..2 {
            let expected = if number == 2 { shift[k] } else { 0.0 };
            assert!(
                (a[k] - b[k] - expected).abs() < 0.01,
                "workingstep {number}: {a:?} against {b:?}"
            );
        }
    }
}

#[test]
fn a_hundred_seeds_of_faults_break_nothing_with_the_planner_either() {
    let seeds = match std::env::var("SEED") {
        Ok(seed) => vec![seed.parse().expect("SEED is a number")],
        Err(_) => {
            let count = std::env::var("SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(100);
            (1..=count).collect::<Vec<u64>>()
        }
    };
    let (_, right) = run(config(), Box::new(common::program(1)));
    let path = PathIndex::new(right.samples.iter().map(|s| s.commanded));
    let mut endings = std::collections::BTreeMap::<&str, u32>::new();
    let mut worst: f64 = 0.0;
    for seed in seeds {
        let config = WorldConfig {
            seed,
            faults: Fault::from_seed(seed, Tick(7000)),
            operator: Operator {
                cycle_start_after: Some(100),
                ..Operator::default()
            },
            ..config()
        };
        let (outcome, kept) = run(config.clone(), Box::new(common::program(1)));
        let about = || {
            format!(
                "SEED={seed}, {:?}: {:?}, {:?}",
                config.faults, outcome.ended, outcome.counters
            )
        };
        let c = outcome.counters;
        assert_eq!(ledger::verify(&kept.events), Ok(outcome.chain), "{}", about());
        assert_eq!(c.accepted, c.completed + c.discarded + outcome.outstanding, "{}", about());
        assert_eq!(c.off_path_stops, 0, "{}", about());
        for s in &kept.samples {
            if matches!(s.phase, Phase::Running | Phase::Paused | Phase::Waiting | Phase::Stopped) {
                let off = path.distance(s.commanded);
                worst = worst.max(off);
                assert!(off < 0.001, "{off} mm off the path at {s:?}: {}", about());
            }
        }
        *endings.entry(outcome.ended.word()).or_default() += 1;
    }
    println!("{endings:?}, at most {worst:.5} mm from the undisturbed path");
}

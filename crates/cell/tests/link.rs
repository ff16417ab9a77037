//! The link between the two halves: a run through it is the same run, and whatever happens to it the axes stay on the path.
#![allow(clippy::disallowed_methods, reason = "SEED picks one random run")]

mod common;

use cell::link::world::{LinkedConfig, LinkedWorld};
use cell::sink::Kept;
use cell::source::Planned;
use cell::{Ended, World, WorldConfig};
use common::small_program;
use machine::{MachineParameters, Sample};

fn machine() -> MachineParameters {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = units::Seconds(0.3);
    machine
}

/// The run without a link.
fn direct(program: Planned) -> (Ended, Kept) {
    let config = WorldConfig {
        machine: machine(),
        operator: LinkedConfig::default().operator,
        ..WorldConfig::default()
    };
    let mut kept = Kept::default();
    let outcome = World::new(config, program).expect("a sound machine").run(&mut kept);
    kept.events.remove(0);
    (outcome.ended, kept)
}

/// The run through a link.
fn linked(config: LinkedConfig, program: impl Fn() -> Planned) -> (Ended, Kept) {
    let mut world = LinkedWorld::new(config, program);
    let mut kept = Kept::default();
    loop {
        if let Some(ended) = world.advance(&mut kept, &mut |_| {}) {
            return (ended, kept);
        }
        assert!(
            world.now().0 < 60_000,
            "does not end: {:?}",
            world.sender().map(|s| s.status())
        );
    }
}

#[test]
fn a_run_through_a_faultless_link_gives_the_same_record_bit_by_bit() {
    let (ended, direct) = direct(small_program());
    let config = LinkedConfig {
        machine: machine(),
        ..LinkedConfig::default()
    };
    let (ended_linked, linked) = linked(config, small_program);
    assert_eq!((ended_linked, &ended), (Ended::Completed, &Ended::Completed));
    assert_eq!(linked.samples.len(), direct.samples.len());
    for (a, b) in linked.samples.iter().zip(&direct.samples) {
        assert_eq!(a, b);
    }
    let plain = |kept: &Kept| {
        kept.events
            .iter()
            .map(|e| (e.kind.clone(), e.detail.clone()))
            .collect::<Vec<_>>()
    };
    assert_eq!(plain(&linked), plain(&direct));
}

/// Rows in which the machine is given a new place.
fn path(kept: &Kept) -> Vec<[u64; 3]> {
    let places = kept.samples.iter().map(|s: &Sample| s.commanded.map(f64::to_bits));
    let mut path: Vec<[u64; 3]> = places.collect();
    path.dedup();
    path
}

#[test]
fn a_late_wire_makes_the_run_later_and_not_another() {
    let (_, direct) = direct(small_program());
    for delay in [(1, 1), (0, 7), (10, 30)] {
        let config = LinkedConfig {
            machine: machine(),
            delay,
            batch: 10,
            ..LinkedConfig::default()
        };
        let (ended, linked) = linked(config, small_program);
        assert_eq!(ended, Ended::Completed, "delay {delay:?}");
        assert_eq!(path(&linked), path(&direct), "delay {delay:?}");
    }
}

//! Every kind of fault of a link in every phase of a run: homing, tool change, spindle, a cut, a thread, a dwell, a pause, a hold, going on.

mod common;
#[path = "common/judge.rs"]
mod judge;

use cell::Ended;
use cell::link::channel::Damage;
use cell::link::world::{LinkFault, LinkedConfig, LinkedWorld};
use cell::source::Planned;
use common::Writer;
use judge::{kind, machine, machined_in};
use machine::{Command, MachineParameters, Request, SetPoint, State, Wait};
use std::collections::BTreeMap;
use units::{Millimetres, MmPerSec, StepId, Tick};

/// When a person holds the feed.
const HOLD: Tick = Tick(1_900);

/// Something of everything, and a hold in the second cut.
fn program() -> Planned {
    let mut w = Writer::default();
    let step = StepId(1);
    w.frame([0.0; 3]);
    w.tool(1, 10.0);
    w.spindle(1000.0);
    w.coolant(true);
    w.begin("cut");
    w.go([6.0, 3.0, -1.0], 60.0);
    w.end();
    w.begin("thread");
    w.go([6.0, 3.0, -6.0], 20.0);
    w.end();
    w.command(Command::Dwell { cycles: 120, step });
    w.begin("cut again");
    w.go([26.0, 3.0, -6.0], 30.0);
    w.end();
    w.command(Command::Pause { step });
    w.go([0.0, 0.0, 0.0], 300.0);
    let mut program = w.finish();
    let mut thread = false;
    for output in &mut program.outputs {
        match output {
            cell::Output::Passed(step) => {
                if let plan::StepKind::Begin(marker) = &step.kind {
                    thread = marker.name == "thread";
                }
            }
            // No override acts on it.
            cell::Output::Command(Command::SetPoint(SetPoint { planned_override, .. })) if thread => *planned_override = 0.0,
            _ => {}
        }
    }
    program
}

/// A machine that looks for its references first: near them, and at home in the plan's beginning.
fn homing() -> MachineParameters {
    let mut machine = machine();
    machine.absolute_encoders = false;
    for axis in &mut machine.axes {
        axis.homing.search = MmPerSec(100.0);
        axis.homing.slow_search = MmPerSec(20.0);
        axis.homing.reference = Millimetres(8.0);
        axis.homing.home = Millimetres(0.0);
    }
    machine
}

fn config(machine: MachineParameters, faults: Vec<LinkFault>) -> LinkedConfig {
    LinkedConfig {
        machine,
        faults,
        delay: (0, 3),
        batch: 10,
        restarts: 5,
        ..LinkedConfig::default()
    }
}

fn hold(world: &mut LinkedWorld<'_, Planned>) {
    if world.now() == HOLD {
        world.request(Request::Hold);
    }
}

/// The cycles of each phase in a run without faults: the first, the middle and the last.
fn phases(parameters: MachineParameters) -> BTreeMap<&'static str, [u64; 3]> {
    let program = program();
    let mut phases: BTreeMap<&str, [u64; 3]> = BTreeMap::new();
    let (mut before, mut dwelt) = (State::Off, false);
    let held = parameters.absolute_encoders;
    let v = machined_in(config(parameters, vec![]), &program, false, |world| {
        if held {
            hold(world);
        }
        let state = world.realtime().controller().state();
        let z = world.reported().map_or(0.0, |report| report.sample.commanded[2]);
        // The thread is what goes down before the dwell; the way back goes through the same heights.
        dwelt |= state == State::Waiting(Wait::Dwell);
        let threads = !dwelt && z < -1.0 && z > -6.0;
        let name = match state {
            State::Homing { .. } => "homing",
            State::Waiting(Wait::Tool | Wait::ToolAway) => "tool change",
            State::Waiting(Wait::Spindle) => "spindle",
            State::Waiting(Wait::Dwell) => "dwell",
            State::Paused => "pause",
            State::Holding => "slowing down to a hold",
            State::Held => "hold",
            State::Resuming => "going on",
            State::Running if threads => "thread",
            State::Running if matches!(before, State::Held) => "gone on",
            State::Running => "cut",
            _ => "other",
        };
        before = state;
        let at = world.now().0;
        let phase = phases.entry(name).or_insert([at, at, at]);
        phase[2] = at;
        phase[1] = (phase[0] + at) / 2;
    });
    assert_eq!((v.ended, v.left, v.beside), (Some(Ended::Completed), 0, 0));
    phases
}

/// Every kind of fault at a moment, some of them together.
fn faults(at: u64) -> Vec<Vec<LinkFault>> {
    let at = Tick(at);
    let cut = |ticks, noticed| LinkFault::Cut { at, ticks, noticed };
    let damaged = |to_machine, damage| LinkFault::Damaged { at, to_machine, damage };
    let restarted = |ticks, orderly| LinkFault::ControllerRestarted { at, ticks, orderly };
    let stall = LinkFault::Stall { at, ticks: 100 };
    let killed = LinkFault::SenderKilled { at, ticks: 500 };
    let late = |count| LinkFault::LateTicks { at, count };
    let mut all = vec![
        vec![cut(60, true)],
        vec![cut(700, false)],
        vec![stall],
        vec![killed],
        vec![restarted(200, true)],
        vec![restarted(200, false)],
        vec![late(4)],
        vec![late(8)],
        vec![stall, damaged(true, Damage::Missing), late(3)],
        vec![killed, restarted(900, true)],
        vec![cut(100, true), late(8), damaged(true, Damage::Twice)],
    ];
    for damage in [Damage::Bit, Damage::Bytes, Damage::Twice, Damage::Missing, Damage::Swapped] {
        all.extend([true, false].map(|to_machine| vec![damaged(to_machine, damage)]));
    }
    all
}

#[track_caller]
fn check(machine: &MachineParameters, phases: &[(&'static str, u64)]) {
    let program = program();
    let mut bad = Vec::new();
    let mut rows: BTreeMap<(&str, String), [u64; 3]> = BTreeMap::new();
    for &(phase, at) in phases {
        for faults in faults(at) {
            let kinds: Vec<_> = faults.iter().map(kind).collect();
            let held = machine.absolute_encoders;
            let v = machined_in(config(*machine, faults), &program, false, |world| {
                if held {
                    hold(world);
                }
            });
            let good = v.ended == Some(Ended::Completed)
                && (v.left, v.beside, v.off_path_stops) == (0, 0, 0)
                && v.acceleration <= 1.05
                && v.back <= 1.0
                && v.skipped <= 10.0;
            if !good {
                bad.push(format!("{phase}, {kinds:?} at {at}: {v:?}"));
            }
            let row = rows.entry((phase, kinds.join(" + "))).or_default();
            *row = [row[0] + 1, row[1] + u64::from(good), row[2] + v.stops];
        }
    }
    println!("\n| phase | fault | runs | finished, nothing wrong | stops |\n|---|---|---|---|---|");
    for ((phase, kinds), [runs, good, stops]) in &rows {
        println!("| {phase} | {kinds} | {runs} | {good} | {stops} |");
    }
    assert!(bad.is_empty(), "{} of {}:\n{}", bad.len(), rows.len(), bad.join("\n"));
}

#[test]
fn any_fault_in_any_phase_of_a_run_moves_nothing_wrong_and_the_part_is_finished() {
    let found = phases(machine());
    let wanted = [
        "cut",
        "dwell",
        "going on",
        "gone on",
        "hold",
        "pause",
        "slowing down to a hold",
        "spindle",
        "thread",
        "tool change",
    ];
    for phase in wanted {
        assert!(found.contains_key(phase), "no {phase} in {found:?}");
    }
    let all: Vec<_> = wanted.iter().map(|phase| (*phase, found[phase][1])).collect();
    check(&machine(), &all);
}

#[test]
fn any_fault_while_the_machine_looks_for_its_references_leaves_it_able_to_begin() {
    let [first, middle, last] = phases(homing())["homing"];
    assert!(last > first + 100, "{first} {last}");
    check(&homing(), &[("homing begins", first), ("homing", middle)]);
}

//! How long the parts of a program take, as the planner has it.

use crate::cli::Common;
use crate::failure::Failure;
use crate::program::{Program, machine_for};
use crate::progress::Progress;
use crate::shop;
use crate::survey::beforehand;
use motion::{Output, Trajectory};
use plan::inspection::{Inspection, Node};
use plan::{Level, StepKind};
use std::collections::BTreeMap;
use units::TICK;

/// So many cycles are planned for a look at a program, at most: ten hours of machining.
const MOST_TICKS: u64 = 36_000_000;

/// Plans the program on the machine and writes the time of each part into the tree; the answer is a remark about where it stopped, if it did.
///
/// What is executed twice has the time of both. A program that needs an answer from the running machine is planned up to there.
///
/// # Errors
/// There is no such machine, or the program cannot be read again.
pub fn add_planned_times(program: &Program, common: &Common, tree: &mut Inspection) -> Result<Option<String>, Failure> {
    if tree.summary.toolpaths == 0 {
        return Ok(None); // nothing moves, and why is among the problems
    }
    let machine = machine_for(&common.machine, program.turns())?;
    let tables = store::registers::tables(&machine, &BTreeMap::new()).map_err(shop::failure)?;
    let mut trajectory = Trajectory::new(program.stream(&tables)?, tables.position, shop::limits(&machine));
    let mut progress = Progress::new("planning");
    let mut times: BTreeMap<(bool, u64), f64> = BTreeMap::new();
    let mut open: Vec<(Level, u64, u64)> = vec![];
    let mut tick = 0u64;
    let mut answer = None;
    let stopped = loop {
        match trajectory.next(answer.take()) {
            Output::Command(machine::Command::SetPoint(_)) => {
                tick += 1;
                if tick > MOST_TICKS {
                    break Some("the planned times end after ten hours of machining".to_owned());
                }
                progress.at(|| format!("{:.0} s of motion", tick as f64 * TICK.0));
            }
            Output::Command(machine::Command::Dwell { cycles, .. }) => tick += u64::from(cycles),
            Output::Command(_) => {}
            Output::Passed(step) => match step.kind {
                StepKind::Begin(marker) => {
                    let id = marker.entity.or_else(|| line_of(&step.origin)).unwrap_or(0);
                    open.push((marker.level, id, tick));
                }
                StepKind::End(level) => {
                    if let Some(place) = open.iter().rposition(|part| part.0 == level) {
                        for (level, id, began) in open.drain(place..) {
                            *times.entry((level == Level::Toolpath, id)).or_default() += (tick - began) as f64 * TICK.0;
                        }
                    }
                }
                _ => {}
            },
            Output::Ask(question) => answer = Some(beforehand(&question)),
            Output::End => break None,
            Output::Alarm(alarm) => {
                let what = &alarm.diagnostic.message;
                let seconds = tick as f64 * TICK.0;
                break Some(match seconds < 0.05 {
                    true => format!("not planned, because the program stops before it moves: {what}"),
                    false => format!("planned up to {seconds:.1} s, where the program stops: {what}"),
                });
            }
        }
    };
    for node in &mut tree.tree {
        fill(node, &times);
    }
    Ok(stopped)
}

fn line_of(origin: &plan::Origin) -> Option<u64> {
    match origin.place {
        plan::Place::Text { line, .. } => Some(u64::from(line)),
        _ => None,
    }
}

fn fill(node: &mut Node, times: &BTreeMap<(bool, u64), f64>) {
    if node.enabled && !node.twin {
        node.time_s = times.get(&(false, node.id)).copied();
        for path in &mut node.toolpaths {
            path.time_s = times.get(&(true, path.id)).copied();
        }
    }
    node.children.iter_mut().for_each(|child| fill(child, times));
}

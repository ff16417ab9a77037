//! Where in the program the machine is, for every record: workplan, workingstep, operation, toolpath, and how long parts took.

use crate::functions::CoordinateFrame;
use crate::sensor::Sensor;
use machine::{MachineParameters, Phase, Sample};
use plan::{Level, Step, StepKind};
use serde_json::{Map, Value, json};
use units::{Machine, Point, Setup, Tick, Transform, Vector};

/// Completed parts that are remembered, for `get_execution_time`.
const REMEMBERED: usize = 1024;

/// The place in the program.
#[derive(Clone, Debug, Default)]
pub(super) struct Context {
    open: Vec<Open>,
    done: Vec<Done>,
    program_began: Option<Tick>,
    machine_from_setup: Option<Transform<Machine, Setup>>,
    offset: Option<Vector<Machine>>,
    planned: Option<(u32, f64)>,
    /// Edit levels that return: each at the end of the workplan of this depth.
    levels: Vec<(usize, Option<u8>)>,
}

#[derive(Clone, Debug)]
struct Open {
    level: Level,
    name: String,
    entity: Option<u64>,
    began: Tick,
    in_cut: u64,
}

/// A part that is completed.
#[derive(Clone, Debug)]
pub(super) struct Done {
    pub name: String,
    entity: Option<u64>,
    level: Level,
    pub begin: Tick,
    pub end: Tick,
    /// Cycles of feed motion with the spindle turning.
    pub in_cut: u64,
}

/// What has coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coordinates {
    /// Where the path says.
    Commanded,
    /// Where the encoders say.
    Actual,
    /// From the one to the other.
    Displacement,
}

impl Coordinates {
    /// Of a sensor; `None` when it measures something else, or nothing here does.
    pub(super) fn of(sensor: &Sensor) -> Option<Coordinates> {
        match sensor.quantity.as_str() {
            "POSITION.COMMANDED" => Some(Coordinates::Commanded),
            "POSITION.ACTUAL" => Some(Coordinates::Actual),
            "DISPLACEMENT" => Some(Coordinates::Displacement),
            _ => None,
        }
    }
}

/// What has ended, for what ends with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scope {
    /// The workplan at this depth, from 1.
    Workplan(usize),
    /// A path.
    Path,
}

impl Context {
    /// Follows a step; gives what ended with it.
    pub(super) fn follow(&mut self, step: &Step, tick: Tick) -> Option<Scope> {
        match &step.kind {
            StepKind::Begin(marker) => {
                if marker.level == Level::Program {
                    self.program_began = Some(tick);
                }
                self.open.push(Open {
                    level: marker.level,
                    name: marker.name.clone(),
                    entity: marker.entity,
                    began: tick,
                    in_cut: 0,
                });
                None
            }
            StepKind::End(level) => {
                let depth = self.depth();
                let at = self.open.iter().rposition(|open| open.level == *level)?;
                for open in self.open.drain(at..) {
                    self.done.push(Done {
                        name: open.name,
                        entity: open.entity,
                        level: open.level,
                        begin: open.began,
                        end: tick,
                        in_cut: open.in_cut,
                    });
                }
                let over = self.done.len().saturating_sub(REMEMBERED);
                self.done.drain(..over);
                match level {
                    Level::Workplan => Some(Scope::Workplan(depth)),
                    Level::Toolpath => Some(Scope::Path),
                    _ => None,
                }
            }
            StepKind::Frame(frame) => {
                self.machine_from_setup = Some(frame.machine_from_setup);
                None
            }
            StepKind::ToolOffset(offset) => {
                self.offset = Some(offset.total());
                None
            }
            StepKind::Tool(tool) => {
                self.planned = tool.diameter.map(|diameter| (tool.number.0, diameter.0));
                None
            }
            _ => None,
        }
    }

    /// Counts a cycle of feed motion: the spindle turns, and the path is no faster than a feed can be.
    pub(super) fn cycle(&mut self, sample: &Sample, machine: &MachineParameters) {
        let cuts = sample.phase == Phase::Running
            && sample.spindle_speed != 0.0
            && sample.path_speed > 0.0
            && sample.path_speed <= machine.cutting.fastest_feed.0;
        if cuts {
            self.open.iter_mut().for_each(|open| open.in_cut += 1);
        }
        if sample.phase == Phase::Running && self.program_began.is_none() {
            self.program_began = Some(sample.tick);
        }
    }

    /// How many workplans are open.
    pub(super) fn depth(&self) -> usize {
        self.open.iter().filter(|open| open.level == Level::Workplan).count()
    }

    pub(super) fn program_began(&self) -> Option<Tick> {
        self.program_began
    }

    pub(super) fn planned_diameter(&self) -> Option<(u32, f64)> {
        self.planned
    }

    /// An edit level takes the place of `outer`: in the open workplan only, or for the rest of the program.
    pub(super) fn level_is_of_workplan(&mut self, of_workplan: bool, outer: Option<u8>) {
        if of_workplan {
            self.levels.push((self.depth(), outer));
        } else {
            self.levels.clear();
        }
    }

    /// The level that returns with the end of a scope, if one does.
    pub(super) fn level_returns(&mut self, scope: Scope) -> Option<Option<u8>> {
        let Scope::Workplan(depth) = scope else { return None };
        let at = self.levels.iter().position(|(of, _)| *of >= depth)?;
        self.levels.drain(at..).next().map(|(_, outer)| outer)
    }

    /// A completed part by name or `#entity`; without one the last completed workingstep.
    pub(super) fn execution(&self, wanted: Option<&str>) -> Option<&Done> {
        let is = |done: &&Done| match wanted {
            None => done.level == Level::Workingstep,
            Some(wanted) => {
                let entity = wanted.strip_prefix('#').and_then(|n| n.parse::<u64>().ok());
                done.name == wanted || (entity.is_some() && done.entity == entity)
            }
        };
        self.done.iter().rev().find(is)
    }

    /// The tool tip in the set-up; `None` before a frame was said.
    pub(super) fn tip(&self, gauge: [f64; 3]) -> Option<[f64; 3]> {
        let frame = self.machine_from_setup?;
        let offset = self.offset.unwrap_or(Vector::ZERO);
        Some((frame.inverse() * (Point::from_xyz(gauge) - offset)).xyz)
    }

    /// A place, or a distance, of a cycle in a frame; `None` before the work's frame was said.
    pub(super) fn coordinates(&self, sample: &Sample, quantity: Coordinates, frame: CoordinateFrame) -> Option<[f64; 3]> {
        let place = |gauge: [f64; 3]| match frame {
            CoordinateFrame::Machine => Some(gauge),
            CoordinateFrame::ToolTip => Some((Point::<Machine>::from_xyz(gauge) - self.offset.unwrap_or(Vector::ZERO)).xyz),
            CoordinateFrame::Work => self.tip(gauge),
        };
        match quantity {
            Coordinates::Commanded => place(sample.commanded),
            Coordinates::Actual => place(sample.actual),
            Coordinates::Displacement => {
                let (actual, commanded) = (place(sample.actual)?, place(sample.commanded)?);
                Some(std::array::from_fn(|k| actual[k] - commanded[k]))
            }
        }
    }

    /// Adds the place to a record.
    pub(super) fn add_to(&self, data: &mut Map<String, Value>, tool: u32) {
        let plans: Vec<&str> = self
            .open
            .iter()
            .filter(|open| open.level == Level::Workplan)
            .map(|open| open.name.as_str())
            .collect();
        let inner = |level: Level| {
            self.open
                .iter()
                .rev()
                .find(|open| open.level == level)
                .map(|open| open.name.clone())
        };
        let place = json!({
            "workplan": (!plans.is_empty()).then(|| plans.join("/")),
            "workingstep": inner(Level::Workingstep),
            "operation": inner(Level::Operation),
            "toolpath": self.open.iter().rev().find(|o| o.level == Level::Toolpath).and_then(|o| o.entity),
            "tool": tool,
        });
        data.insert("place".to_owned(), Value::Object(super::object(place)));
    }
}

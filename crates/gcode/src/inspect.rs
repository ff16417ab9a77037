//! The tree of a program, made by reading its stream once: structure, toolpaths, tools, and what was found wrong.
//!
//! It knows only [`plan::ProgramStream`]: where a program has no toolpaths of its own, a toolpath is a longest run of rapid moves, a
//! longest run of feed moves, or a dwell, within a workingstep. Kept is a summary for each toolpath, never the moves.

use plan::{Answer, Diagnostic, Feed, Level, Next, Place, ProgramStream, Speed, SpindleState, Step, StepKind};
use serde::Serialize;
use std::collections::BTreeSet;
use units::Millimetres;

/// What `toolmark inspect --json` prints for a program. Lengths in mm, speeds in mm/s.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// `gcode`.
    pub kind: &'static str,
    /// The family of controls it is read as.
    pub schema: String,
    /// `mm` or `inch`, as the program's words are.
    pub units: &'static str,
    /// Counts over the whole.
    pub summary: Summary,
    /// The program and its parts.
    pub tree: Vec<Node>,
    /// What was found wrong, odd or assumed; an alarm is the last of it.
    pub problems: Vec<Diagnostic>,
}

/// Counts over a program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Workingsteps that are run.
    pub workingsteps_enabled: u32,
    /// Workingsteps that are not; G-code has none.
    pub workingsteps_disabled: u32,
    /// Rapid runs, feed runs and dwells.
    pub toolpaths: u32,
    /// Rapid runs.
    pub rapids: u32,
    /// Dwells.
    pub dwells: u32,
    /// Different tools called.
    pub tools: u32,
    /// Functions whose meaning is not the motion's.
    pub nc_functions: u32,
}

/// A part of the structure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Node {
    /// Line of the block that began it; 0 for the whole program.
    pub id: u64,
    /// `program`, `workplan`, `workingstep`, `operation`.
    #[serde(rename = "type")]
    pub level: &'static str,
    /// Its name.
    pub name: String,
    /// False when it is not run.
    pub enabled: bool,
    /// Number of the tool in the spindle when its first toolpath began.
    pub tool: Option<u32>,
    /// Its parts.
    pub children: Vec<Node>,
    /// Its own toolpaths.
    pub toolpaths: Vec<Toolpath>,
}

/// A run of moves of one kind, or a dwell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Toolpath {
    /// Line of its first block.
    pub id: u64,
    /// `rapid`, `feed` or `dwell`.
    pub kind: &'static str,
    /// Highest feed of the run; `None` for rapids and dwells, and for feeds in inverse time.
    pub feed_mm_s: Option<f64>,
    /// Spindle speed at its start.
    pub spindle_rpm: f64,
    /// `cw`, `ccw` or `stopped`.
    pub spindle_direction: &'static str,
    /// Length of its paths; moves of machine axes (G28, G53) have none here.
    pub length_mm: f64,
}

/// Reads a whole stream, from its beginning, and sums it up. Questions are answered as a machine with its switches off would: optional
/// stops do not stop, everything else is unknown. The stream is rewound before; `schema` and `in_inches` are asked of it at the end.
pub fn inspect<P: ProgramStream>(program: &mut P, schema: &str, in_inches: impl FnOnce(&P) -> bool) -> Inspection {
    program.rewind();
    let mut reading = Reading::default();
    let mut answer = None;
    let alarm = loop {
        match program.next(answer.take()) {
            Next::Step(step) => reading.follow(&step),
            Next::Ask(plan::Question::OptionalStop) => answer = Some(Answer::Truth(false)),
            Next::Ask(_) => answer = Some(Answer::Unknown),
            Next::End => break None,
            Next::Alarm(alarm) => break Some(alarm.diagnostic),
        }
    };
    while reading.open.len() > 1 {
        reading.close();
    }
    reading.end_run();
    let mut problems = program.diagnostics().to_vec();
    problems.extend(alarm);
    Inspection {
        kind: "gcode",
        schema: schema.to_owned(),
        units: if in_inches(program) { "inch" } else { "mm" },
        summary: Summary {
            tools: reading.tools.len() as u32,
            ..reading.summary
        },
        tree: reading.open.pop().map(|root| root.children).unwrap_or_default(),
        problems,
    }
}

/// What is known while the stream is read.
struct Reading {
    /// The parts that are open, outer first; the first is a root that holds the tree.
    open: Vec<Node>,
    run: Option<Toolpath>,
    summary: Summary,
    tools: BTreeSet<u32>,
    tool: Option<u32>,
    spindle: SpindleState,
}

impl Default for Reading {
    fn default() -> Self {
        Reading {
            open: vec![node(0, "root", String::new())],
            run: None,
            summary: Summary::default(),
            tools: BTreeSet::new(),
            tool: None,
            spindle: SpindleState::Stopped,
        }
    }
}

fn node(id: u64, level: &'static str, name: String) -> Node {
    Node {
        id,
        level,
        name,
        enabled: true,
        tool: None,
        children: Vec::new(),
        toolpaths: Vec::new(),
    }
}

impl Reading {
    fn follow(&mut self, step: &Step) {
        let id = match step.origin.place {
            Place::Text { line, .. } => u64::from(line),
            Place::Entity(id) => id,
            Place::Given => 0,
        };
        match &step.kind {
            StepKind::Move(m) => {
                let radius = Millimetres(m.path.start().xyz[0]);
                let (kind, feed) = match m.speed {
                    Speed::Rapid => ("rapid", None),
                    Speed::Feed(Feed::PerTime(v)) => ("feed", Some(v.0)),
                    Speed::Feed(Feed::PerRevolution(f) | Feed::Thread(plan::Thread { advance: f, .. })) => {
                        ("feed", Some(f.0 * self.spindle.revolutions(radius).0 / 60.0))
                    }
                    Speed::Feed(Feed::WholeMove(_)) => ("feed", None),
                };
                self.moved(id, kind, feed, m.path.length(), radius);
            }
            StepKind::MachineMove(_) => self.moved(id, "rapid", None, 0.0, Millimetres(0.0)),
            StepKind::Dwell(_) => {
                self.end_run();
                self.begin_run(id, "dwell", Millimetres(0.0));
                self.end_run();
            }
            StepKind::Tool(tool) => {
                self.tool = Some(tool.number.0);
                self.tools.insert(tool.number.0);
            }
            StepKind::Spindle(state) => self.spindle = *state,
            StepKind::Begin(marker) => {
                self.end_run();
                let level = match marker.level {
                    Level::Program => "program",
                    Level::Workplan => "workplan",
                    Level::Workingstep => {
                        self.summary.workingsteps_enabled += 1;
                        "workingstep"
                    }
                    Level::Operation => "operation",
                    Level::Toolpath => return,
                };
                self.open.push(node(marker.entity.unwrap_or(id), level, marker.name.clone()));
            }
            StepKind::End(level) => {
                self.end_run();
                if *level != Level::Toolpath && self.open.len() > 1 {
                    self.close();
                }
            }
            StepKind::NcFunction(function) if function.is_of_the_control() => {}
            StepKind::NcFunction(_) => self.summary.nc_functions += 1,
            StepKind::Coolant(_)
            | StepKind::ToolOffset(_)
            | StepKind::Frame(_)
            | StepKind::PathMode(_)
            | StepKind::Register(_)
            | StepKind::Message(_)
            | StepKind::Stop(_) => {}
        }
    }

    fn moved(&mut self, id: u64, kind: &'static str, feed: Option<f64>, length: f64, radius: Millimetres) {
        if self.run.as_ref().is_some_and(|run| run.kind != kind) {
            self.end_run();
        }
        if self.run.is_none() {
            self.begin_run(id, kind, radius);
        }
        if let Some(run) = &mut self.run {
            run.length_mm += length;
            run.feed_mm_s = match (run.feed_mm_s, feed) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(b),
            };
        }
    }

    fn begin_run(&mut self, id: u64, kind: &'static str, radius: Millimetres) {
        self.run = Some(Toolpath {
            id,
            kind,
            feed_mm_s: None,
            spindle_rpm: self.spindle.revolutions(radius).0,
            spindle_direction: match self.spindle {
                SpindleState::Stopped | SpindleState::Oriented => "stopped",
                SpindleState::Clockwise(_) => "cw",
                SpindleState::Counterclockwise(_) => "ccw",
            },
            length_mm: 0.0,
        });
    }

    fn end_run(&mut self) {
        let Some(run) = self.run.take() else { return };
        self.summary.toolpaths += 1;
        match run.kind {
            "rapid" => self.summary.rapids += 1,
            "dwell" => self.summary.dwells += 1,
            _ => {}
        }
        if let Some(part) = self.open.last_mut() {
            part.tool = part.tool.or(self.tool);
            part.toolpaths.push(run);
        }
    }

    fn close(&mut self) {
        self.end_run();
        if let (Some(part), Some(around)) = (self.open.pop(), self.open.last_mut()) {
            around.children.push(part);
        }
    }
}

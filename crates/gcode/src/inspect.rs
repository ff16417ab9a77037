//! The tree of a program, made by reading its stream once: structure, toolpaths, tools, and what was found wrong.
//!
//! It knows only [`plan::ProgramStream`]: where a program has no toolpaths of its own, a toolpath is a longest run of rapid moves, a
//! longest run of feed moves, or a dwell, within a workingstep. Kept is a summary for each toolpath, never the moves.

pub use plan::inspection::{Inspection, Node, PathEntry, Problem, Summary, ToolName};
use plan::{Answer, Feed, Level, Next, Place, ProgramStream, Speed, SpindleMode, SpindleState, Step, StepKind};
use std::collections::BTreeSet;
use units::Millimetres;

/// Reads a whole stream, from its beginning, and sums it up. Questions are answered as a machine with its switches off would: optional
/// stops do not stop, there is no probe, and everything else is not asked. The stream is rewound before; `schema` and `in_inches` are asked of it at the end.
pub fn inspect<P: ProgramStream>(program: &mut P, schema: &str, in_inches: impl FnOnce(&P) -> bool) -> Inspection {
    program.rewind();
    let mut reading = Reading::default();
    let mut answer = None;
    let alarm = loop {
        match program.next(answer.take()) {
            Next::Step(step) => reading.follow(&step),
            Next::Ask(plan::Question::OptionalStop) => answer = Some(Answer::Truth(false)),
            Next::Ask(plan::Question::Skip { .. }) => answer = Some(Answer::Unknown),
            Next::Ask(_) => answer = Some(Answer::NotAsked),
            Next::End => break None,
            Next::Alarm(alarm) => break Some(alarm.diagnostic),
        }
    };
    while reading.open.len() > 1 {
        reading.close();
    }
    reading.end_run();
    let problems = program.diagnostics().iter().chain(&alarm).map(Problem::from).collect();
    Inspection {
        kind: "gcode",
        schema: schema.to_owned(),
        units: if in_inches(program) { "inch" } else { "mm" },
        summary: Summary {
            tools: reading.tools.len() as u64,
            ..reading.summary
        },
        tree: reading.open.pop().map(|root| root.children).unwrap_or_default(),
        tools: Vec::new(),
        dimensions: Vec::new(),
        problems,
    }
}

/// What is known while the stream is read.
struct Reading {
    /// The parts that are open, outer first; the first is a root that holds the tree.
    open: Vec<Node>,
    run: Option<PathEntry>,
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

fn node(id: u64, level: &str, name: String) -> Node {
    Node {
        id,
        kind: level.to_owned(),
        name,
        enabled: true,
        ..Node::default()
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
            run.length_mm = run.length_mm.map(|sum| sum + length);
            run.feed_mm_s = match (run.feed_mm_s, feed) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(b),
            };
        }
    }

    fn begin_run(&mut self, id: u64, kind: &'static str, radius: Millimetres) {
        let surface = match self.spindle {
            SpindleState::Clockwise(SpindleMode::Surface { speed, .. })
            | SpindleState::Counterclockwise(SpindleMode::Surface { speed, .. }) => Some(speed.0),
            _ => None,
        };
        self.run = Some(PathEntry {
            id,
            kind,
            spindle_rpm: Some(self.spindle.revolutions(radius).0),
            surface_speed_mm_s: surface,
            spindle_direction: Some(match self.spindle {
                SpindleState::Stopped | SpindleState::Oriented => "stopped",
                SpindleState::Clockwise(_) => "cw",
                SpindleState::Counterclockwise(_) => "ccw",
            }),
            length_mm: Some(0.0),
            ..PathEntry::default()
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
            part.tool = part.tool.take().or(self.tool.map(ToolName::Number));
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

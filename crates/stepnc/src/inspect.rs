//! The tree of a program as plain data: what `toolmark inspect --json` prints. The field names are the command's contract.

use crate::model::{Executable, ExecutableKind, FeedSetting, Function, Program, SpindleSetting, Tool, Toolpath, ToolpathKind};
use plan::{Diagnostic, Diagnostics, Severity};
use serde::Serialize;
use std::collections::BTreeSet;
use units::Millimetres;

/// A whole file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// `step-nc`, or `iso-14649` for a file that is recognised only.
    pub kind: &'static str,
    /// The name in FILE_SCHEMA.
    pub schema: String,
    /// Unit in which the toolpaths are written: `mm`, `inch`, `mixed`, `other` or `none`. Figures in here are in mm all the same.
    pub units: &'static str,
    /// Counts over the plans; over the twins when the file has no plan.
    pub summary: Summary,
    /// The main workplans of all projects, plans and twins.
    pub tree: Vec<Node>,
    /// What was wrong or odd, one entry a kind.
    pub problems: Vec<ProblemEntry>,
}

/// Counts of a program. What is executed twice counts twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Workingsteps that are enabled, their parents included.
    pub workingsteps_enabled: u64,
    /// Workingsteps that are not.
    pub workingsteps_disabled: u64,
    /// Toolpaths of the enabled ones, dwells included.
    pub toolpaths: u64,
    /// Rapid ones among them.
    pub rapids: u64,
    /// Dwells among them.
    pub dwells: u64,
    /// Tools that the file describes; some writers repeat a tool for each operation, which counts once.
    pub tools: u64,
    /// Functions of the control in the tree.
    pub nc_functions: u64,
}

/// An executable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Node {
    /// Its instance.
    pub id: u64,
    /// `workplan`, `workingstep`, `selective`, `parallel`, `non-sequential`, `if`, `while`, `assignment`, `nc-function`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its name.
    pub name: String,
    /// False when it or a parent is disabled.
    pub enabled: bool,
    /// The tool of its operation or function: its number, or its name when that is no number.
    pub tool: Option<ToolName>,
    /// What is below it, in order.
    pub children: Vec<Node>,
    /// The toolpaths of its operation, in order.
    pub toolpaths: Vec<PathEntry>,
    /// The project, on the main workplan of one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub project: Option<String>,
    /// True when it tells what happened.
    #[serde(skip_serializing_if = "is_false")]
    pub twin: bool,
    /// The planned executable of a twin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin_of: Option<u64>,
    /// Where the planned executable is, when it is in another file: `plan.stpnc#main`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin_of_uri: Option<String>,
    /// The operation of a workingstep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operation: Option<OperationEntry>,
    /// The function, of a function.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub function: Option<FunctionEntry>,
    /// The set-up that begins here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setup: Option<String>,
}

/// How a tool is called.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum ToolName {
    /// Its number.
    Number(u32),
    /// Its name, when there is no number in it.
    Name(String),
}

/// An operation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OperationEntry {
    /// Its instance.
    pub id: u64,
    /// The entity.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Its variant.
    pub variant: String,
}

/// A function of the control.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FunctionEntry {
    /// The kind.
    pub kind: String,
    /// Its text.
    pub text: String,
}

/// A toolpath.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PathEntry {
    /// Its instance.
    pub id: u64,
    /// `rapid`, `feed` or `dwell`.
    pub kind: &'static str,
    /// Its name.
    pub name: String,
    /// The feed, a constant multiplier included; nothing on rapid paths and dwells.
    pub feed_mm_s: Option<f64>,
    /// Spindle speed; 0 when it stands, nothing when the file does not say or gives a surface speed.
    pub spindle_rpm: Option<f64>,
    /// `cw`, `ccw` or `stopped`.
    pub spindle_direction: Option<&'static str>,
    /// Length of the curve; nothing when it cannot be read.
    pub length_mm: Option<f64>,
    /// How long a dwell takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dwell_s: Option<f64>,
    /// `approach`, `lift`, `contact` ...
    #[serde(skip_serializing_if = "String::is_empty")]
    pub trajectory: String,
    /// How far the machine may leave the path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maximum_deviation_mm: Option<f64>,
}

/// One kind of problem.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ProblemEntry {
    /// The kind.
    pub code: &'static str,
    /// `remark`, `warning` or `error`.
    pub severity: Severity,
    /// What was found, and what to do.
    pub message: String,
    /// First place; 0 when unknown.
    pub line: u32,
    /// First place; 0 when unknown.
    pub column: u32,
    /// How often.
    pub count: u32,
}

impl From<&Diagnostic> for ProblemEntry {
    fn from(diagnostic: &Diagnostic) -> Self {
        let mut message = diagnostic.message.clone();
        if let Some(id) = diagnostic.entity {
            message = format!("#{id}: {message}");
        }
        if !diagnostic.remedy.is_empty() {
            message = format!("{message}; {}", diagnostic.remedy);
        }
        ProblemEntry {
            code: diagnostic.code,
            severity: diagnostic.severity,
            message,
            line: diagnostic.line,
            column: diagnostic.column,
            count: diagnostic.count,
        }
    }
}

fn is_false(value: &bool) -> bool {
    !value
}

/// Nodes of one tree, at most: shared executables can make a small file's tree endless.
const MOST_NODES: u64 = 1_000_000;
const DEEPEST: usize = 100;

/// Reads a whole program, curves included.
pub fn inspect(program: &Program) -> Inspection {
    let mut inspector = Inspector {
        program,
        problems: Diagnostics::new(),
        summary: Summary {
            tools: program.tools().iter().map(|tool| &tool.name).collect::<BTreeSet<_>>().len() as u64,
            ..Summary::default()
        },
        nodes: 0,
        counted: false,
        units: Vec::new(),
        only_twins: program.plan().is_none(),
    };
    for diagnostic in program.diagnostics() {
        inspector.problems.add(diagnostic.clone());
    }
    let mut tree = Vec::new();
    for project in program.projects() {
        inspector.counted = inspector.only_twins || !project.is_twin;
        let mut node = inspector.node(project.main_workplan, true, &mut Vec::new());
        if let Some(node) = &mut node {
            node.project = Some(project.name.clone());
        }
        tree.extend(node);
    }
    Inspection {
        kind: if program.is_iso_14649() { "iso-14649" } else { "step-nc" },
        schema: program.schema().to_string(),
        units: unit_word(&inspector.units),
        summary: inspector.summary,
        tree,
        problems: inspector.problems.as_slice().iter().map(ProblemEntry::from).collect(),
    }
}

/// The word for the lengths of one unit in mm that toolpaths have.
fn unit_word(units: &[f64]) -> &'static str {
    match units {
        [] => "none",
        [1.0] => "mm",
        [25.4] => "inch",
        [_] => "other",
        _ => "mixed",
    }
}

struct Inspector<'p> {
    program: &'p Program,
    problems: Diagnostics,
    summary: Summary,
    nodes: u64,
    /// Does the project at hand count in the summary?
    counted: bool,
    /// Millimetres in the units that toolpaths are written in.
    units: Vec<f64>,
    /// Is there nothing else to count?
    only_twins: bool,
}

impl<'p> Inspector<'p> {
    fn node(&mut self, id: u64, parent_enabled: bool, above: &mut Vec<u64>) -> Option<Node> {
        let program = self.program;
        self.nodes += 1;
        if above.contains(&id) || above.len() > DEEPEST || self.nodes > MOST_NODES {
            let fault = crate::aim::Fault::new(
                id,
                "endless-tree",
                "an executable contains itself, or the tree is too large to show",
                "remove the cycle",
            );
            program.note(&mut self.problems, Severity::Error, &fault);
            return None;
        }
        let Some(executable) = program.executable(id) else {
            let fault = crate::aim::Fault::new(id, "not-executable", "a child is not in the file, or is no executable", "");
            program.note(&mut self.problems, Severity::Warning, &fault);
            return None;
        };
        let enabled = parent_enabled && executable.enabled;
        above.push(id);
        let children = executable
            .children()
            .into_iter()
            .filter_map(|child| self.node(child, enabled, above))
            .collect();
        above.pop();
        let operation = match executable.kind {
            ExecutableKind::Workingstep { operation, .. } => operation,
            _ => None,
        };
        let user = match executable.kind {
            ExecutableKind::Function(_) => Some(id),
            _ => operation,
        };
        let tool = self.tool(executable, user);
        let toolpaths = self.toolpaths(operation, tool);
        self.count(executable, enabled, &toolpaths);
        Some(Node {
            id,
            kind: executable.kind_word().to_string(),
            name: executable.name.clone(),
            enabled,
            tool: tool.map(|tool| match tool.number {
                Some(number) => ToolName::Number(number.0),
                None => ToolName::Name(tool.name.clone()),
            }),
            children,
            toolpaths,
            project: None,
            twin: executable.twin.is_some(),
            twin_of: executable.twin.as_ref().and_then(|twin| twin.plan),
            twin_of_uri: executable
                .twin
                .as_ref()
                .and_then(|twin| program.file().external(twin.plan?))
                .map(str::to_string),
            operation: operation
                .and_then(|id| program.operation(id))
                .map(|operation| OperationEntry {
                    id: operation.id,
                    kind: operation.kind.clone(),
                    name: operation.name.clone(),
                    variant: operation.variant.clone(),
                }),
            function: match &executable.kind {
                ExecutableKind::Function(Function { kind, text, .. }) => Some(FunctionEntry {
                    kind: kind.clone(),
                    text: text.clone(),
                }),
                _ => None,
            },
            setup: executable.setup.as_ref().map(|setup| setup.name.clone()),
        })
    }

    /// The tool of an operation; what a twin leaves out is its plan's.
    fn tool(&self, executable: &Executable, user: Option<u64>) -> Option<&'p Tool> {
        let program = self.program;
        let own = user.and_then(|user| program.tool_of(user));
        own.or_else(|| {
            let planned = program.executable(executable.twin.as_ref()?.plan?)?;
            match planned.kind {
                ExecutableKind::Workingstep { operation, .. } => program.tool_of(operation?),
                _ => None,
            }
        })
    }

    fn count(&mut self, executable: &Executable, enabled: bool, toolpaths: &[PathEntry]) {
        if !self.counted || (executable.twin.is_some() && !self.only_twins) {
            return;
        }
        let summary = &mut self.summary;
        match executable.kind {
            ExecutableKind::Workingstep { .. } if enabled => {
                summary.workingsteps_enabled += 1;
                summary.toolpaths += toolpaths.len() as u64;
                summary.rapids += toolpaths
                    .iter()
                    .filter(|path| path.kind == ToolpathKind::Rapid.word())
                    .count() as u64;
                summary.dwells += toolpaths
                    .iter()
                    .filter(|path| path.kind == ToolpathKind::Dwell.word())
                    .count() as u64;
            }
            ExecutableKind::Workingstep { .. } => summary.workingsteps_disabled += 1,
            ExecutableKind::Function(_) => summary.nc_functions += 1,
            _ => {}
        }
    }

    fn toolpaths(&mut self, operation: Option<u64>, tool: Option<&Tool>) -> Vec<PathEntry> {
        let program = self.program;
        let Some(operation) = operation.and_then(|id| program.operation(id)) else {
            return Vec::new();
        };
        let mut entries = Vec::with_capacity(operation.toolpaths.len());
        for &id in &operation.toolpaths {
            let toolpath = program.toolpath(id);
            for fault in &toolpath.faults {
                program.note(&mut self.problems, Severity::Error, fault);
            }
            entries.push(self.path(&toolpath, operation.technology, tool));
        }
        entries
    }

    fn path(&mut self, toolpath: &Toolpath, inherited: Option<u64>, tool: Option<&Tool>) -> PathEntry {
        let program = self.program;
        let own = toolpath.technology.and_then(|id| program.technology(id));
        let inherited = inherited.and_then(|id| program.technology(id));
        let technology = own.or(inherited);
        for fault in technology.map_or(&[][..], |technology| &technology.faults) {
            program.note(&mut self.problems, Severity::Warning, fault);
        }
        let (spindle_rpm, spindle_direction) = match technology.and_then(|technology| technology.spindle) {
            None => (None, None),
            Some(SpindleSetting::Stopped) => (Some(0.0), Some("stopped")),
            Some(SpindleSetting::Revolutions { speed, clockwise }) => (Some(speed.0), Some(if clockwise { "cw" } else { "ccw" })),
            Some(SpindleSetting::Surface { clockwise, .. }) => (None, Some(if clockwise { "cw" } else { "ccw" })),
        };
        let per_revolution = |length: Millimetres, teeth: f64| spindle_rpm.map(|rpm| length.0 * teeth * rpm / 60.0);
        let feed = match (toolpath.kind, technology.and_then(|technology| technology.feed)) {
            (ToolpathKind::Feed, Some(FeedSetting::PerTime(speed))) => Some(speed.0),
            (ToolpathKind::Feed, Some(FeedSetting::PerRevolution(length))) => per_revolution(length, 1.0),
            (ToolpathKind::Feed, Some(FeedSetting::PerTooth(length))) => tool
                .and_then(|tool| tool.teeth)
                .and_then(|teeth| per_revolution(length, teeth)),
            _ => None,
        };
        let constant_factor = toolpath.profile.as_ref().and_then(|profile| {
            let (first, last) = (profile.points.first()?.1, profile.points.last()?.1);
            (profile.points.len() <= 2 && first == last).then_some(first)
        });
        PathEntry {
            id: toolpath.id,
            kind: toolpath.kind.word(),
            name: toolpath.name.clone(),
            feed_mm_s: feed.map(|feed| feed * constant_factor.unwrap_or(1.0)),
            spindle_rpm,
            spindle_direction,
            length_mm: self.length(toolpath),
            dwell_s: match toolpath.dwell {
                Some(crate::model::Dwell::Time(time)) => Some(time.0),
                Some(crate::model::Dwell::Revolutions(turns)) => {
                    spindle_rpm.filter(|rpm| *rpm > 0.0).map(|rpm| turns / rpm * 60.0)
                }
                None => None,
            },
            trajectory: toolpath.trajectory.clone(),
            maximum_deviation_mm: toolpath.maximum_deviation.map(|deviation| deviation.0),
        }
    }

    fn length(&mut self, toolpath: &Toolpath) -> Option<f64> {
        if toolpath.kind == ToolpathKind::Dwell {
            return Some(0.0);
        }
        let program = self.program;
        let pieces = match program.pieces(toolpath) {
            Ok(pieces) => pieces,
            Err(fault) => {
                program.note(&mut self.problems, Severity::Error, &fault);
                return None;
            }
        };
        if let Ok(units) = program.units_of(toolpath)
            && !self.units.contains(&units.millimetres)
        {
            self.units.push(units.millimetres);
        }
        let mut sum = 0.0;
        for piece in pieces {
            match piece {
                Ok(piece) => sum += piece.length(),
                Err(mut fault) => {
                    if fault.entity == 0 {
                        fault.entity = toolpath.id;
                    }
                    program.note(&mut self.problems, Severity::Error, &fault);
                    return None;
                }
            }
        }
        Some(sum)
    }
}

//! The tree of a program as plain data ([`plan::inspection`]): what `toolmark inspect` prints.
//!
//! Lengths of all curves are added up, so every curve is read; what cannot be read is a problem in the answer.

use crate::dimensions::StatedLimits;
use crate::model::{Executable, ExecutableKind, FeedSetting, Function, Program, SpindleSetting, Tool, Toolpath, ToolpathKind};
pub use plan::inspection::{
    DimensionEntry, FeatureEntry, FunctionEntry, Inspection, NamedValue, Node, OperationEntry, PathEntry, Problem, Quantity,
    Summary, ToolEntry, ToolName,
};
use plan::{Diagnostics, Severity};
use std::collections::BTreeSet;
use units::Millimetres;

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
            node.values.splice(0..0, project.values.iter().cloned());
        }
        tree.extend(node);
    }
    let dimensions = inspector.dimensions();
    Inspection {
        kind: if program.is_iso_14649() { "iso-14649" } else { "step-nc" },
        schema: program.schema().to_string(),
        units: unit_word(&inspector.units),
        summary: inspector.summary,
        tree,
        tools: program.tools().iter().map(tool_entry).collect(),
        dimensions,
        problems: inspector.problems.as_slice().iter().map(Problem::from).collect(),
    }
}

fn feature_entry(feature: &crate::model::Feature) -> FeatureEntry {
    FeatureEntry {
        id: feature.id,
        kind: feature.kinds.join(" "),
        name: feature.name.clone(),
        values: feature.values.clone(),
    }
}

fn tool_name(tool: &Tool) -> ToolName {
    match tool.number {
        Some(number) => ToolName::Number(number.0),
        None => ToolName::Name(tool.name.clone()),
    }
}

fn tool_entry(tool: &Tool) -> ToolEntry {
    ToolEntry {
        id: tool.id,
        tool: tool_name(tool),
        name: tool.name.clone(),
        kind: tool.kind.clone(),
        values: tool.values.clone(),
    }
}

/// What a node shows besides its children: the set-up's frames first, then what the file says.
fn values_of(program: &Program, executable: &Executable) -> Vec<NamedValue> {
    let mut values = Vec::new();
    if let Some(setup) = &executable.setup {
        let place = |name: &str, origin: [f64; 3]| NamedValue::new(name, Quantity::Place { place_mm: origin });
        values.extend(
            setup
                .machine_from_setup
                .map(|frame| place("set-up origin in the machine", frame.origin)),
        );
        values.extend(
            setup
                .setup_from_part
                .map(|frame| place("workpiece in the set-up", frame.origin)),
        );
        values.extend(
            setup
                .security_plane
                .map(|height| NamedValue::measure("security plane", height.0, "mm")),
        );
        if let Some(fixture) = &setup.fixture {
            values.push(NamedValue::text("fixture", &fixture.name));
            values.extend(fixture.values.iter().cloned().map(|mut value| {
                value.name = format!("fixture: {}", value.name);
                value
            }));
        }
    }
    // In ISO 14649 it is the place of the feature, which the feature says.
    values.extend(executable.orientation.filter(|_| !program.is_iso_14649()).map(|frame| {
        let [x, y, z] = frame.origin;
        let turned = if frame.is_shift() { "" } else { ", turned" };
        NamedValue::text("toolpath orientation", format!("moved by ({x} {y} {z}){turned}"))
    }));
    values.extend(
        executable
            .security_plane
            .map(|height| NamedValue::measure("security plane", height.0, "mm")),
    );
    if let Some(twin) = &executable.twin {
        let mut text = |name: &str, text: Option<String>| values.extend(text.map(|text| NamedValue::text(name, text)));
        text("twin start", twin.start.map(crate::date::words));
        text("twin end", twin.end.map(crate::date::words));
        text("twin source", twin.source.clone());
        text("twin exception", twin.exception.clone());
        values.extend(twin.worktime.map(|time| NamedValue::measure("twin worktime", time.0, "s")));
    }
    values.extend(executable.values.iter().cloned());
    values
}

/// The condition or assignment of an executable, for people.
fn condition_of(executable: &Executable) -> Option<String> {
    let said = |expression: &Result<plan::Expression, String>| match expression {
        Ok(expression) => expression.to_string(),
        Err(why) => format!("(not readable: {why})"),
    };
    match &executable.kind {
        ExecutableKind::If { condition, .. } | ExecutableKind::While { condition, .. } => Some(said(condition)),
        ExecutableKind::Assignment { variable, value } => Some(format!("{variable} = {}", said(value))),
        ExecutableKind::Function(function) => function.condition.as_ref().map(said),
        _ => None,
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
    fn dimensions(&mut self) -> Vec<DimensionEntry> {
        let found = crate::dimensions::dimensions(self.program);
        for diagnostic in found.diagnostics {
            self.problems.add(diagnostic);
        }
        let sizes = found.dimensions.into_iter().map(|stated| {
            let (lower, upper, fit) = match stated.limits {
                StatedLimits::Deviations { lower, upper } => (Some(lower.0), Some(upper.0), None),
                StatedLimits::Fit(fit) => (None, None, Some(fit)),
                StatedLimits::None => (None, None, None),
            };
            DimensionEntry {
                id: stated.id,
                kind: stated.word,
                of: stated.aspects.into_iter().map(|(_, name)| name).collect(),
                nominal_mm: stated.nominal.map(|nominal| nominal.0),
                lower_mm: lower,
                upper_mm: upper,
                fit,
                tolerance_mm: None,
            }
        });
        let zones = found.geometric.into_iter().map(|zone| DimensionEntry {
            id: zone.id,
            kind: zone.entity.to_lowercase().replace('_', " "),
            of: zone.aspect.map(|(_, name)| name).into_iter().collect(),
            tolerance_mm: zone.magnitude.map(|magnitude| magnitude.0),
            ..DimensionEntry::default()
        });
        sizes.chain(zones).collect()
    }

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
        if program.is_instruction(id) {
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
            tool: tool.map(tool_name),
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
                    values: operation.values.clone(),
                }),
            function: match &executable.kind {
                ExecutableKind::Function(Function { kind, text, .. }) => Some(FunctionEntry {
                    kind: kind.clone(),
                    text: text.clone(),
                }),
                _ => None,
            },
            setup: executable.setup.as_ref().map(|setup| setup.name.clone()),
            condition: condition_of(executable),
            features: executable
                .features
                .iter()
                .filter_map(|&id| program.feature(id))
                .map(feature_entry)
                .collect(),
            values: values_of(program, executable),
            time_s: None,
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
            feed_mm_rev: match (toolpath.kind, technology.and_then(|technology| technology.feed)) {
                (ToolpathKind::Feed, Some(FeedSetting::PerRevolution(length))) => Some(length.0 * constant_factor.unwrap_or(1.0)),
                _ => None,
            },
            surface_speed_mm_s: match technology.and_then(|technology| technology.spindle) {
                Some(SpindleSetting::Surface { speed, .. }) => Some(speed.0),
                _ => None,
            },
            time_s: None,
        }
    }

    fn length(&mut self, toolpath: &Toolpath) -> Option<f64> {
        if toolpath.kind == ToolpathKind::Dwell {
            return Some(0.0);
        }
        if toolpath.is_connection() {
            return None; // as long as from where the tool is to the next path
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

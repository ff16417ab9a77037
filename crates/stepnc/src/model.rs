//! What a STEP-NC file says, in the words of the shop: [`Program`].
//!
//! The structure (projects, executables, operations, technologies, tools) is read at once; toolpaths and their curves are read when
//! they are asked for, because they are nearly all of a file. Identifiers are those of the file, so that a diagnostic, a record and an
//! as-executed model can point at the same thing.

mod read;

use crate::aim::{Aim, Fault};
use crate::arm;
use crate::curve::{self, Pieces};
use crate::unit::ContextUnits;
use part21::{File, ReadError};
use plan::inspection::NamedValue;
use plan::{CoolantState, Diagnostic, Diagnostics, Expression, Path, Severity, SpeedProfile};
use std::collections::{BTreeMap, BTreeSet};
use units::{Machine, Millimetres, MmPerSec, Part, Rpm, Seconds, Timestamp, ToolNumber, Transform};

/// A STEP-NC file that has been read.
pub struct Program {
    name: String,
    file: File,
    schema: String,
    projects: Vec<Project>,
    executables: BTreeMap<u64, Executable>,
    operations: BTreeMap<u64, Operation>,
    technologies: BTreeMap<u64, Technology>,
    functions: BTreeMap<u64, MachineFunctions>,
    tools: Vec<Tool>,
    tool_of: BTreeMap<u64, usize>,
    features: BTreeMap<u64, Feature>,
    /// Toolpaths of operations that only move: rapid, whatever they say of themselves.
    rapid_paths: BTreeSet<u64>,
    /// Values that variables have before the program.
    initial_values: BTreeMap<String, f64>,
    iso_14649: bool,
    contexts: BTreeMap<u64, Result<ContextUnits, Fault>>,
    diagnostics: Diagnostics,
}

/// One machining project, or, in a file without one of a plan, a workplan that nobody refers to.
#[derive(Clone, Debug, PartialEq)]
pub struct Project {
    /// The MACHINING_PROJECT; `None` when the file has none and the workplan stands for it.
    pub id: Option<u64>,
    /// Its name for people.
    pub name: String,
    /// The main workplan.
    pub main_workplan: u64,
    /// True when it tells what happened and not what shall happen.
    pub is_twin: bool,
    /// Owner, release date, approval, workpiece and whatever else the file says of it.
    pub values: Vec<NamedValue>,
}

/// A node of the program's tree: something that is executed. Its children are entity identifiers, so a shared one is shared.
#[derive(Clone, Debug, PartialEq)]
pub struct Executable {
    /// Its instance.
    pub id: u64,
    /// Its name for people; not unique.
    pub name: String,
    /// What it is.
    pub kind: ExecutableKind,
    /// What the file says of this one; a disabled parent disables it all the same.
    pub enabled: bool,
    /// Moves the toolpaths below it (toolpath orientation).
    pub orientation: Option<Transform<units::Setup, units::Setup>>,
    /// The set-up that begins here.
    pub setup: Option<Setup>,
    /// Height above which nothing is in the way, in the frame of its set-up.
    pub security_plane: Option<Millimetres>,
    /// Present when it tells what happened.
    pub twin: Option<TwinFacts>,
    /// The features that a workingstep makes, by their instances; see [`Program::feature`].
    pub features: Vec<u64>,
    /// People, machines, approvals, dates and results: what the file says of it besides.
    pub values: Vec<NamedValue>,
}

/// A feature of the workpiece that a workingstep makes. Nothing is computed from it; it is there to be read.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Its instance.
    pub id: u64,
    /// Its name for people.
    pub name: String,
    /// Its entity names: `ROUND_HOLE`; of a complex instance those that say what it is.
    pub kinds: Vec<String>,
    /// Its dimensions and other data.
    pub values: Vec<NamedValue>,
}

/// The kinds of executables.
#[derive(Clone, Debug, PartialEq)]
pub enum ExecutableKind {
    /// In this order.
    Workplan(Vec<u64>),
    /// One operation on one feature.
    Workingstep {
        /// The operation; `None` when the file has none.
        operation: Option<u64>,
        /// True for a turning workingstep.
        turning: bool,
    },
    /// One of these: the first enabled one.
    Selective(Vec<u64>),
    /// All at the same time.
    Parallel(Vec<u64>),
    /// All, in any order.
    NonSequential(Vec<u64>),
    /// By a condition.
    If {
        /// The condition, or why it cannot be read.
        condition: Result<Expression, String>,
        /// When it is true.
        then: Option<u64>,
        /// When it is not.
        otherwise: Option<u64>,
    },
    /// As long as a condition holds.
    While {
        /// The condition, or why it cannot be read.
        condition: Result<Expression, String>,
        /// What is repeated.
        body: Option<u64>,
    },
    /// Gives a variable a value.
    Assignment {
        /// The variable's name; empty when it cannot be read.
        variable: String,
        /// The value, or why it cannot be read.
        value: Result<Expression, String>,
    },
    /// A function of the control.
    Function(Function),
    /// A description that the standard does not know; kept and reported.
    Unknown(String),
}

/// A function of the control (MACHINING_NC_FUNCTION).
#[derive(Clone, Debug, PartialEq)]
pub struct Function {
    /// The kind as the file names it: `display message`, `extended function` ...
    pub kind: String,
    /// The text of a message or of an extended function; empty otherwise.
    pub text: String,
    /// Its property `condition`: an expression, or why it cannot be read.
    pub condition: Option<Result<Expression, String>>,
    /// Other named data.
    pub properties: BTreeMap<String, String>,
}

/// When and by what an executable was executed.
#[derive(Clone, Debug, PartialEq)]
pub struct TwinFacts {
    /// Begin.
    pub start: Option<Timestamp>,
    /// End.
    pub end: Option<Timestamp>,
    /// The planned executable, or what a REFERENCE section names.
    pub plan: Option<u64>,
    /// Where the data came from.
    pub source: Option<String>,
    /// Time spent removing material.
    pub worktime: Option<Seconds>,
    /// How it ended, when it did not end well.
    pub exception: Option<String>,
}

/// A set-up: where the frame of the toolpaths lies in the machine, and where the workpiece lies in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// The product definition of the set-up.
    pub id: u64,
    /// Its name.
    pub name: String,
    /// The set-up's origin in machine coordinates; `None` when the file does not say it.
    pub machine_from_setup: Option<Transform<Machine, units::Setup>>,
    /// Where the workpiece lies, when the file says it.
    pub setup_from_part: Option<Transform<units::Setup, Part>>,
    /// Height above which nothing is in the way.
    pub security_plane: Option<Millimetres>,
    /// What holds the workpiece.
    pub fixture: Option<Fixture>,
}

/// A fixture as a set-up uses it.
#[derive(Clone, Debug, PartialEq)]
pub struct Fixture {
    /// The MACHINING_FIXTURE_USAGE.
    pub id: u64,
    /// Its name.
    pub name: String,
    /// Where it is mounted (`mount reference`) and where the workpiece is in it (`workpiece reference`), in its own frame, and more.
    pub values: Vec<NamedValue>,
}

/// What a workingstep does.
#[derive(Clone, Debug, PartialEq)]
pub struct Operation {
    /// Its instance.
    pub id: u64,
    /// Its name for people.
    pub name: String,
    /// The entity: `DRILLING_OPERATION`.
    pub kind: String,
    /// The variant: `drilling`, `roughing`.
    pub variant: String,
    /// Its toolpaths in the order of execution.
    pub toolpaths: Vec<u64>,
    /// Technology for toolpaths that have none of their own.
    pub technology: Option<u64>,
    /// Machine functions for toolpaths that have none of their own.
    pub functions: Option<u64>,
    /// Depths, allowances, planes, strategies: its attributes by the words of the file.
    pub values: Vec<NamedValue>,
}

/// Feed and spindle speed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Technology {
    /// The feed, in one of the ways the file may give it.
    pub feed: Option<FeedSetting>,
    /// The spindle; `None` leaves it as it is.
    pub spindle: Option<SpindleSetting>,
    /// Why feed or spindle cannot be read, with the entity; used when the value is needed.
    pub(crate) faults: Vec<Fault>,
}

/// A feed as STEP-NC gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FeedSetting {
    /// Speed of the tool along the path.
    PerTime(MmPerSec),
    /// Path for each revolution.
    PerRevolution(Millimetres),
    /// Path for each tooth of the tool.
    PerTooth(Millimetres),
}

/// A spindle as STEP-NC gives it: the file's sign is positive for counterclockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpindleSetting {
    /// It stands.
    Stopped,
    /// Revolutions.
    Revolutions {
        /// How fast.
        speed: Rpm,
        /// M3: clockwise, seen from the spindle towards the workpiece.
        clockwise: bool,
    },
    /// Speed of the surface at the edge.
    Surface {
        /// How fast.
        speed: MmPerSec,
        /// Never faster than this.
        limit: Option<Rpm>,
        /// M3.
        clockwise: bool,
    },
}

/// Coolant and whatever else runs along a path.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MachineFunctions {
    /// Which outlets are open.
    pub coolant: CoolantState,
    /// Named conditions along the path (`other functions`): name and mode; equal names joined by a comma.
    pub others: BTreeMap<String, String>,
}

/// A tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Tool {
    /// Its instance.
    pub id: u64,
    /// Its identifier, usually the tool number.
    pub name: String,
    /// The number in the identifier or the magazine place; `None` when there is none.
    pub number: Option<ToolNumber>,
    /// `endmill`, `twist drill` ...
    pub kind: String,
    /// Cutting diameter.
    pub diameter: Option<Millimetres>,
    /// Overall assembly length.
    pub length: Option<Millimetres>,
    /// Number of teeth.
    pub teeth: Option<f64>,
    /// Operations and functions that use it.
    pub users: Vec<u64>,
    /// All that the file says of it: dimensions with their limits, teeth, hand of cut, place in the magazine, life of its edges.
    pub values: Vec<NamedValue>,
}

/// What a toolpath does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToolpathKind {
    /// Not cutting, as fast as the axes can.
    Rapid,
    /// At a feed.
    Feed,
    /// Standing still.
    Dwell,
}

impl ToolpathKind {
    /// The word of the JSON contract.
    pub fn word(self) -> &'static str {
        match self {
            ToolpathKind::Rapid => "rapid",
            ToolpathKind::Feed => "feed",
            ToolpathKind::Dwell => "dwell",
        }
    }
}

/// A toolpath without its curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Toolpath {
    /// Its instance.
    pub id: u64,
    /// Its name for people.
    pub name: String,
    /// Rapid, feed or dwell.
    pub kind: ToolpathKind,
    /// The entity's own description: `cutter location trajectory` ...
    pub description: String,
    /// `approach`, `lift`, `contact` ...; empty when the file says nothing.
    pub trajectory: String,
    /// Its own technology; the operation's holds when there is none.
    pub technology: Option<u64>,
    /// Its own machine functions; the operation's hold when there are none.
    pub functions: Option<u64>,
    /// Multiplier of the feed along the path.
    pub profile: Option<SpeedProfile>,
    /// How long a dwell takes.
    pub dwell: Option<Dwell>,
    /// How far the machine may leave the path.
    pub maximum_deviation: Option<Millimetres>,
    /// True when the curve is run from its end to its beginning.
    pub reversed: bool,
    /// True when the tool axis is not the Z of the path everywhere.
    pub tilted: bool,
    /// When it was run, in a twin.
    pub twin: Option<TwinFacts>,
    /// What else the file says of it: priority, what it removes.
    pub values: Vec<NamedValue>,
    /// The curve and the representation that holds it.
    pub(crate) curve: Option<(u64, u64)>,
    /// The context of the curve, which has its units.
    pub(crate) context: Option<u64>,
    /// What could not be read.
    pub(crate) faults: Vec<Fault>,
}

/// How long a dwell takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dwell {
    /// This long.
    Time(Seconds),
    /// This many turns of the spindle.
    Revolutions(f64),
}

/// Problems of the file by which instances are lost.
const DAMAGE: [&str; 8] = [
    "truncated",
    "truncated-instance",
    "unterminated-string",
    "parentheses",
    "missing-semicolon",
    "syntax",
    "identifier",
    "unknown-text",
];

impl Program {
    /// Reads a file; `name` is what diagnostics call it.
    ///
    /// # Errors
    /// When the bytes are no Part 21 file. A Part 21 file without a program reads as one without projects, and says so.
    pub fn read(name: &str, bytes: Vec<u8>) -> Result<Self, ReadError> {
        let file = File::read(bytes)?;
        let mut program = Program {
            name: name.to_string(),
            schema: file.schemas().into_iter().next().unwrap_or_default(),
            projects: Vec::new(),
            executables: BTreeMap::new(),
            operations: BTreeMap::new(),
            technologies: BTreeMap::new(),
            functions: BTreeMap::new(),
            tools: Vec::new(),
            tool_of: BTreeMap::new(),
            features: BTreeMap::new(),
            rapid_paths: BTreeSet::new(),
            initial_values: BTreeMap::new(),
            iso_14649: arm::is_arm(&file),
            contexts: BTreeMap::new(),
            diagnostics: Diagnostics::new(),
            file,
        };
        for problem in program.file.problems() {
            // An instance that could not be read may be the link to a toolpath: what is left would run without it.
            let severity = if DAMAGE.contains(&problem.code) {
                Severity::Error
            } else {
                Severity::Warning
            };
            let mut diagnostic = Diagnostic::new(severity, problem.code, problem.message.clone())
                .in_file(name)
                .at_line(small(problem.line), small(problem.column))
                .remedy("the rest of the file was read; repair this place or export again");
            diagnostic.count = small(problem.count);
            program.diagnostics.add(diagnostic);
        }
        if program.iso_14649 {
            program.take(arm::read(&program));
        } else {
            read::Builder::default().run(&mut program);
        }
        Ok(program)
    }

    /// The file's name as it was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The file below.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// The name in FILE_SCHEMA, upper case.
    pub fn schema(&self) -> &str {
        &self.schema
    }

    /// True for an ISO 14649 file, which stores the objects as they are (ARM) and not as AP238 does (AIM).
    pub fn is_iso_14649(&self) -> bool {
        self.iso_14649
    }

    fn take(&mut self, arm: arm::Arm) {
        self.projects = arm.projects;
        self.executables = arm.executables;
        self.operations = arm.operations;
        self.technologies = arm.technologies;
        self.functions = arm.functions;
        self.features = arm.features;
        self.rapid_paths = arm.rapid_paths;
        self.initial_values = arm.variables;
        for tool in arm.tools.into_values() {
            self.add_tool(tool);
        }
        for diagnostic in arm.found.as_slice() {
            self.diagnostics.add(diagnostic.clone());
        }
    }

    fn add_tool(&mut self, tool: Tool) {
        for &user in &tool.users {
            self.tool_of.insert(user, self.tools.len());
        }
        self.tools.push(tool);
    }

    /// The projects in the order of the file: plans and twins.
    pub fn projects(&self) -> &[Project] {
        &self.projects
    }

    /// The first project that says what shall happen.
    pub fn plan(&self) -> Option<&Project> {
        self.projects.iter().find(|project| !project.is_twin)
    }

    /// An executable.
    pub fn executable(&self, id: u64) -> Option<&Executable> {
        self.executables.get(&id)
    }

    /// An operation.
    pub fn operation(&self, id: u64) -> Option<&Operation> {
        self.operations.get(&id)
    }

    /// A technology.
    pub fn technology(&self, id: u64) -> Option<&Technology> {
        self.technologies.get(&id)
    }

    /// Machine functions.
    pub fn functions(&self, id: u64) -> Option<&MachineFunctions> {
        self.functions.get(&id)
    }

    /// A feature.
    pub fn feature(&self, id: u64) -> Option<&Feature> {
        self.features.get(&id)
    }

    /// Does it tell a person how to set up, or what is made, and is no step of the program?
    pub(crate) fn is_instruction(&self, id: u64) -> bool {
        let aim = self.aim();
        let of_kind = |keyword| aim.is(id, keyword);
        of_kind("MACHINING_FEATURE_PROCESS")
            || of_kind("MACHINING_OPERATOR_INSTRUCTION")
            || (of_kind("MACHINING_PROCESS_EXECUTABLE") && !self.executables.contains_key(&id))
    }

    /// The values that variables have before the program, by their names.
    pub fn initial_values(&self) -> &BTreeMap<String, f64> {
        &self.initial_values
    }

    /// The tools of the file, by identifier of their instances.
    pub fn tools(&self) -> &[Tool] {
        &self.tools
    }

    /// The tool that an operation or a function uses.
    pub fn tool_of(&self, user: u64) -> Option<&Tool> {
        self.tool_of.get(&user).map(|&place| &self.tools[place])
    }

    /// What was odd in the file's structure.
    pub fn diagnostics(&self) -> &[Diagnostic] {
        self.diagnostics.as_slice()
    }

    /// The first sign that parts of the file are lost; such a program can be looked at and is not run.
    pub fn damage(&self) -> Option<&Diagnostic> {
        self.diagnostics
            .as_slice()
            .iter()
            .find(|diagnostic| DAMAGE.contains(&diagnostic.code))
    }

    /// True when an enabled workingstep of a plan turns: then the program is a lathe's.
    pub fn turns(&self) -> bool {
        let mut turning = false;
        for project in self.projects.iter().filter(|project| !project.is_twin) {
            self.walk(project.main_workplan, &mut |executable, enabled| {
                if let ExecutableKind::Workingstep {
                    operation,
                    turning: turns,
                } = &executable.kind
                {
                    let operation = operation.and_then(|id| self.operation(id));
                    let by_operation = operation.is_some_and(Operation::turns);
                    turning |= enabled && (*turns || by_operation);
                }
            });
        }
        turning
    }

    /// Calls `visit` for an executable and everything below it, each once, with whether it is enabled.
    pub fn walk(&self, root: u64, visit: &mut dyn FnMut(&Executable, bool)) {
        let mut seen = BTreeSet::new();
        let mut stack = vec![(root, true)];
        while let Some((id, enabled)) = stack.pop() {
            let Some(executable) = self.executables.get(&id) else {
                continue;
            };
            if !seen.insert(id) {
                continue;
            }
            let enabled = enabled && executable.enabled;
            visit(executable, enabled);
            stack.extend(executable.children().into_iter().rev().map(|child| (child, enabled)));
        }
    }

    /// A toolpath; its attributes are read from the file now.
    pub fn toolpath(&self, id: u64) -> Toolpath {
        let mut toolpath = Toolpath::new(id);
        if self.iso_14649 {
            arm::read_toolpath(self, &mut toolpath);
        } else {
            read::read_toolpath(self, &mut toolpath);
        }
        if self.rapid_paths.contains(&id) || toolpath.is_connection() {
            toolpath.kind = match toolpath.kind {
                ToolpathKind::Dwell => ToolpathKind::Dwell,
                _ => ToolpathKind::Rapid,
            };
        }
        toolpath
    }

    /// The pieces of a toolpath's curve in the order in which the tool runs them, in the frame and order of the path, lengths in mm.
    ///
    /// # Errors
    /// Each piece may be a [`Diagnostic`] instead: then the curve ends there.
    pub fn path<'p>(&'p self, toolpath: &'p Toolpath) -> impl Iterator<Item = Result<Path<units::Setup>, Box<Diagnostic>>> + 'p {
        let (pieces, fault) = match self.pieces(toolpath) {
            Ok(pieces) => (Some(pieces), None),
            Err(fault) => (None, Some(Err(fault))),
        };
        fault.into_iter().chain(pieces.into_iter().flatten()).map(|piece| {
            piece.map_err(|mut fault| {
                if fault.entity == 0 {
                    fault.entity = toolpath.id;
                }
                Box::new(self.diagnostic(Severity::Error, &fault))
            })
        })
    }

    pub(crate) fn pieces(&self, toolpath: &Toolpath) -> Result<Pieces<'_>, Fault> {
        let Some((_, curve)) = toolpath.curve else {
            return Err(Fault::new(
                toolpath.id,
                "no-curve",
                format!("toolpath '{}' ({}) has no curve", toolpath.name, toolpath.description),
                "export toolpaths as cutter location trajectories with a basic curve",
            ));
        };
        let units = self.units_of(toolpath)?;
        Ok(Pieces::new(self.aim(), curve, units, toolpath.reversed))
    }

    /// The units in which a toolpath's curve is written.
    pub(crate) fn units_of(&self, toolpath: &Toolpath) -> Result<ContextUnits, Fault> {
        if self.iso_14649 {
            return Ok(arm::UNITS);
        }
        let context = toolpath.context.ok_or_else(|| {
            Fault::new(
                toolpath.id,
                "no-length-unit",
                format!(
                    "the curve of toolpath '{}' stands in no context with a length unit",
                    toolpath.name
                ),
                "give its representation a geometric context",
            )
        })?;
        match self.contexts.get(&context) {
            Some(units) => units.clone(),
            None => self.aim().context_units(context),
        }
    }

    pub(crate) fn aim(&self) -> Aim<'_> {
        Aim::new(&self.file)
    }

    pub(crate) fn contexts(&self) -> impl Iterator<Item = (u64, ContextUnits)> + '_ {
        self.contexts
            .iter()
            .filter_map(|(id, units)| Some((*id, *units.as_ref().ok()?)))
    }

    /// A fault with file, line and column.
    pub(crate) fn diagnostic(&self, severity: Severity, fault: &Fault) -> Diagnostic {
        let mut diagnostic = Diagnostic::new(severity, fault.code, fault.message.clone())
            .in_file(self.name.clone())
            .remedy(fault.remedy);
        if fault.entity != 0 {
            diagnostic = diagnostic.at_entity(fault.entity);
            if let Some(row) = self.file.row(fault.entity) {
                let place = self.file.position(self.file.offset(row));
                diagnostic = diagnostic.at_line(small(place.line), small(place.column));
            }
        }
        diagnostic
    }

    /// Adds a fault to `all`, computing its place only for the first of its kind.
    pub(crate) fn note(&self, all: &mut Diagnostics, severity: Severity, fault: &Fault) {
        if all.as_slice().iter().any(|known| known.code == fault.code) {
            all.add(Diagnostic::new(severity, fault.code, String::new()));
        } else {
            all.add(self.diagnostic(severity, fault));
        }
    }
}

impl Operation {
    /// True when it turns: by its entity, or because it is one of ISO 14649-12.
    pub fn turns(&self) -> bool {
        let beginnings = ["FACING_", "CONTOURING_", "GROOVING_", "THREADING_", "CUTTING_IN", "KNURLING"];
        self.kind.contains("TURNING") || beginnings.iter().any(|beginning| self.kind.starts_with(beginning))
    }

    /// True when it only moves the tool from here to there.
    pub fn is_rapid_movement(&self) -> bool {
        matches!(self.kind.as_str(), "MACHINING_RAPID_MOVEMENT" | "RAPID_MOVEMENT")
    }
}

impl Toolpath {
    /// One of which nothing is known yet.
    fn new(id: u64) -> Self {
        Toolpath {
            id,
            name: String::new(),
            kind: ToolpathKind::Feed,
            description: String::new(),
            trajectory: String::new(),
            technology: None,
            functions: None,
            profile: None,
            dwell: None,
            maximum_deviation: None,
            reversed: false,
            tilted: false,
            twin: None,
            values: Vec::new(),
            curve: None,
            context: None,
            faults: Vec::new(),
        }
    }

    /// True for a connection that says how to come to the next path and not along which curve.
    pub fn is_connection(&self) -> bool {
        self.curve.is_none() && self.description.starts_with("connect ")
    }
}

impl Executable {
    /// An enabled workplan without anything in it, to be filled.
    pub(crate) fn new(id: u64, name: String) -> Self {
        Executable {
            id,
            name,
            kind: ExecutableKind::Workplan(Vec::new()),
            enabled: true,
            orientation: None,
            setup: None,
            security_plane: None,
            twin: None,
            features: Vec::new(),
            values: Vec::new(),
        }
    }

    /// What is directly below it, in order; of an `If` the true branch first.
    pub fn children(&self) -> Vec<u64> {
        match &self.kind {
            ExecutableKind::Workplan(children)
            | ExecutableKind::Selective(children)
            | ExecutableKind::Parallel(children)
            | ExecutableKind::NonSequential(children) => children.clone(),
            ExecutableKind::If { then, otherwise, .. } => then.iter().chain(otherwise).copied().collect(),
            ExecutableKind::While { body, .. } => body.iter().copied().collect(),
            ExecutableKind::Workingstep { .. }
            | ExecutableKind::Assignment { .. }
            | ExecutableKind::Function(_)
            | ExecutableKind::Unknown(_) => Vec::new(),
        }
    }

    /// The kind as `inspect` calls it.
    pub fn kind_word(&self) -> &str {
        match &self.kind {
            ExecutableKind::Workplan(_) => "workplan",
            ExecutableKind::Workingstep { .. } => "workingstep",
            ExecutableKind::Selective(_) => "selective",
            ExecutableKind::Parallel(_) => "parallel",
            ExecutableKind::NonSequential(_) => "non-sequential",
            ExecutableKind::If { .. } => "if",
            ExecutableKind::While { .. } => "while",
            ExecutableKind::Assignment { .. } => "assignment",
            ExecutableKind::Function(_) => "nc-function",
            ExecutableKind::Unknown(_) => "unknown",
        }
    }
}

/// What to say when workingsteps have operations without toolpaths: they are shown, and what they would need is not made up.
pub(crate) fn feature_based(executables: &BTreeMap<u64, Executable>, operations: &BTreeMap<u64, Operation>) -> Option<Fault> {
    let mut steps = 0;
    let mut bare: Vec<u64> = Vec::new();
    for executable in executables.values().filter(|executable| executable.twin.is_none()) {
        let ExecutableKind::Workingstep { operation, .. } = executable.kind else {
            continue;
        };
        steps += 1;
        let operation = operation.and_then(|id| operations.get(&id));
        bare.extend(
            operation
                .filter(|o| o.toolpaths.is_empty() && !o.is_rapid_movement())
                .map(|o| o.id),
        );
    }
    let message = format!(
        "{} of {steps} workingsteps are described by features and have no toolpaths: they are shown and cannot be run",
        bare.len()
    );
    let remedy = "let a CAM system compute their toolpaths; none are made up here";
    Some(Fault::new(*bare.first()?, "feature-based", message, remedy))
}

/// The number of a tool in `7`, `T07`, `Tool 7`, `T5 face mill`, `3: drill`; none in `12 mm R0.5` or `MILL 18MM`, which describe it.
pub(crate) fn number_in(text: &str) -> Option<ToolNumber> {
    let text = text.trim();
    let from_digits = text.trim_start_matches(|c: char| !c.is_ascii_digit());
    let before = text[..text.len() - from_digits.len()].trim_matches(|c: char| !c.is_alphanumeric());
    let digits = from_digits.bytes().take_while(u8::is_ascii_digit).count();
    let behind = &from_digits[digits..];
    let words = [
        "t",
        "tool",
        "tool number",
        "tool no",
        "nr",
        "no",
        "pocket",
        "station",
        "place",
        "werkzeug",
    ];
    let is_number = match before.to_ascii_lowercase().as_str() {
        // A bare number is one only when nothing or a mark comes behind it.
        "" => behind.is_empty() || behind.starts_with([':', ',', ';']),
        word => words.contains(&word) && !behind.starts_with(|c: char| c.is_alphanumeric() || c == '.'),
    };
    is_number
        .then(|| from_digits[..digits].parse().ok().map(ToolNumber))
        .flatten()
}

pub(crate) fn small(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_number_is_told_from_a_description() {
        for (text, number) in [
            ("7", Some(7)),
            ("T07", Some(7)),
            (" Tool 12 ", Some(12)),
            ("T5 face mill", Some(5)),
            ("T3-DRILL", Some(3)),
            ("3: drill 5 mm", Some(3)),
            ("12 mm R0.5", None),
            ("MILL 18MM", None),
            ("12.5", None),
            ("T2.5", None),
            ("fly cutter", None),
            ("99999999999", None),
            ("", None),
        ] {
            assert_eq!(number_in(text), number.map(ToolNumber), "{text:?}");
        }
    }
}

//! What a STEP-NC file says, in the words of the shop: [`Program`].
//!
//! The structure (projects, executables, operations, technologies, tools) is read at once; toolpaths and their curves are read when
//! they are asked for, because they are nearly all of a file. Identifiers are those of the file, so that a diagnostic, a record and an
//! as-executed model can point at the same thing.

use crate::aim::{Aim, Fault, Links, text};
use crate::curve::{self, Pieces};
use crate::date;
use crate::expression;
use crate::unit::{self, ContextUnits};
use part21::{File, ReadError};
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
    contexts: BTreeMap<u64, Result<ContextUnits, Fault>>,
    diagnostics: Diagnostics,
}

/// One machining project, or, in a file without any, a workplan that nobody refers to.
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    /// The kind as the file names it: `display message`, `extended function` ...
    pub kind: String,
    /// The text of a message or of an extended function; empty otherwise.
    pub text: String,
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
            contexts: BTreeMap::new(),
            diagnostics: Diagnostics::new(),
            file,
        };
        for problem in program.file.problems() {
            let mut diagnostic = Diagnostic::warning(problem.code, problem.message.clone())
                .in_file(name)
                .at_line(small(problem.line), small(problem.column))
                .remedy("the rest of the file was read; repair this place or export again");
            diagnostic.count = small(problem.count);
            program.diagnostics.add(diagnostic);
        }
        if program.is_iso_14649() {
            program.report_iso_14649();
        } else {
            Builder::default().run(&mut program);
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

    /// True for an ISO 14649 (ARM) file, which is recognised and not run.
    pub fn is_iso_14649(&self) -> bool {
        self.schema == "MACHINING_SCHEMA"
            || self.schema == "MILLING_SCHEMA"
            || self.schema == "TURNING_SCHEMA"
            || self.schema == "COMBINED_SCHEMA"
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
                    let by_operation = operation.is_some_and(|operation| operation.kind.contains("TURNING"));
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
        read_toolpath(self, id)
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

    fn report_iso_14649(&mut self) {
        let count = |name: &str| self.file.by_keyword(name).count();
        let message = format!(
            "this is an ISO 14649 file (ARM): {} workplans, {} workingsteps, {} toolpath lists; it is recognised and cannot be run yet",
            count("WORKPLAN"),
            count("MACHINING_WORKINGSTEP") + count("TURNING_WORKINGSTEP"),
            count("TOOLPATH_LIST")
        );
        let remedy = if count("TOOLPATH_LIST") == 0 {
            "it holds features and no toolpaths; let a CAM system plan them and export ISO 10303-238 (AIM)"
        } else {
            "export it as ISO 10303-238 (AIM)"
        };
        let place = self
            .file
            .header()
            .iter()
            .find(|entry| entry.keyword == "FILE_SCHEMA")
            .map_or(0, |entry| entry.span.start);
        let place = self.file.position(place);
        self.diagnostics.add(
            Diagnostic::error("iso-14649", message)
                .in_file(self.name.clone())
                .at_line(small(place.line), small(place.column))
                .remedy(remedy),
        );
    }
}

impl Executable {
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

pub(crate) fn small(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// Reads the structure of a file; faults become warnings, because what is never executed hurts nobody.
#[derive(Default)]
struct Builder {
    found: Diagnostics,
    /// Executables that somebody executes.
    used: BTreeSet<u64>,
}

const WORKPLAN: &str = "MACHINING_WORKPLAN";
const SEQUENCE: &str = "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP";
const BRANCH: &str = "MACHINING_PROCESS_BRANCH_RELATIONSHIP";
const CONCURRENT: &str = "MACHINING_PROCESS_CONCURRENT_RELATIONSHIP";
const BODY: &str = "MACHINING_PROCESS_BODY_RELATIONSHIP";

impl Builder {
    fn run(mut self, program: &mut Program) {
        let aim = Aim::new(&program.file);
        for row in aim.file.by_keyword("GLOBAL_UNIT_ASSIGNED_CONTEXT") {
            let id = aim.file.id(row);
            program.contexts.insert(id, aim.context_units(id));
        }
        for row in aim.file.by_keyword("MACHINING_TECHNOLOGY") {
            program
                .technologies
                .insert(aim.file.id(row), technology(aim, aim.file.id(row)));
        }
        for row in aim.file.by_keyword("MACHINING_FUNCTIONS") {
            program.functions.insert(aim.file.id(row), functions(aim, aim.file.id(row)));
        }
        for row in aim.file.by_keyword("MACHINING_TOOL") {
            match tool(aim, aim.file.id(row)) {
                Ok((tool, faults)) => {
                    for fault in faults {
                        program.note(&mut self.found, Severity::Warning, &fault);
                    }
                    for &user in &tool.users {
                        program.tool_of.insert(user, program.tools.len());
                    }
                    program.tools.push(tool);
                }
                Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
            }
        }
        let mut executables = BTreeMap::new();
        let mut operations = BTreeMap::new();
        for keyword in [
            WORKPLAN,
            "MACHINING_WORKINGSTEP",
            "MACHINING_PROCESS_EXECUTABLE",
            "MACHINING_NC_FUNCTION",
        ] {
            for row in aim.file.by_keyword(keyword) {
                match self.executable(program, aim.file.id(row), keyword, &mut operations) {
                    Ok(Some(executable)) => {
                        self.used.extend(executable.children());
                        executables.insert(executable.id, executable);
                    }
                    Ok(None) => {}
                    Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
                }
            }
        }
        let projects = self.projects(program, &executables);
        program.executables = executables;
        program.operations = operations;
        program.projects = projects;
        self.check_structure(program);
        for diagnostic in self.found.as_slice() {
            program.diagnostics.add(diagnostic.clone());
        }
    }

    fn projects(&mut self, program: &Program, executables: &BTreeMap<u64, Executable>) -> Vec<Project> {
        let aim = program.aim();
        let is_twin = |id: &u64| executables.get(id).is_some_and(|executable| executable.twin.is_some());
        let mut projects = Vec::new();
        for row in aim.file.by_keyword("MACHINING_PROJECT") {
            let id = aim.file.id(row);
            let Ok(product) = aim.parsed(row) else { continue };
            let main = aim
                .users_by(id, "PRODUCT_DEFINITION_FORMATION", 2)
                .flat_map(|(formation, _)| aim.users_by(formation, "PRODUCT_DEFINITION", 2))
                .flat_map(|(definition, _)| aim.users_by(definition, "PROCESS_PRODUCT_ASSOCIATION", 2))
                .filter_map(|(_, association)| association.argument(3).reference())
                .filter_map(|process| aim.instance(process).ok())
                .filter(|process| text(process.argument(0)) == "machining")
                .find_map(|process| process.argument(2).reference());
            let name = [product.argument(1), product.argument(0)]
                .map(text)
                .into_iter()
                .find(|name| !name.is_empty());
            match main {
                Some(main) if executables.contains_key(&main) => projects.push(Project {
                    id: Some(id),
                    name: name.unwrap_or_default().into_owned(),
                    main_workplan: main,
                    is_twin: is_twin(&main),
                }),
                _ => program.note(
                    &mut self.found,
                    Severity::Warning,
                    &Fault::new(
                        id,
                        "project-without-workplan",
                        "a machining project has no main workplan",
                        "tie it to one by a 'machining' process",
                    ),
                ),
            }
        }
        if projects.is_empty() {
            for executable in executables.values() {
                if matches!(executable.kind, ExecutableKind::Workplan(_)) && !self.used.contains(&executable.id) {
                    projects.push(Project {
                        id: None,
                        name: executable.name.clone(),
                        main_workplan: executable.id,
                        is_twin: executable.twin.is_some(),
                    });
                }
            }
            if let Some(first) = projects.first() {
                program.note(
                    &mut self.found,
                    Severity::Remark,
                    &Fault::new(
                        first.main_workplan,
                        "no-project",
                        "the file has no machining project: workplans that nobody executes stand for it",
                        "",
                    ),
                );
            } else {
                let message = format!("the file has no machining program in it (schema {})", program.schema);
                self.found.add(
                    Diagnostic::error("no-program", message)
                        .in_file(program.name.clone())
                        .remedy("a STEP-NC file has a machining project or a workplan; a plain STEP model has neither"),
                );
            }
        }
        projects
    }

    fn check_structure(&mut self, program: &Program) {
        for executable in program.executables.values() {
            if matches!(&executable.kind, ExecutableKind::Workplan(children) if children.is_empty()) && executable.twin.is_none()
            {
                let fault = Fault::new(
                    executable.id,
                    "empty-workplan",
                    format!("workplan '{}' is empty", executable.name),
                    "",
                );
                program.note(&mut self.found, Severity::Remark, &fault);
            }
            if let ExecutableKind::Unknown(description) = &executable.kind {
                let message = format!("an executable of the unknown kind '{description}': it is kept and cannot be run");
                let fault = Fault::new(executable.id, "unknown-executable", message, "");
                program.note(&mut self.found, Severity::Warning, &fault);
            }
        }
    }

    fn executable(
        &mut self,
        program: &Program,
        id: u64,
        keyword: &str,
        operations: &mut BTreeMap<u64, Operation>,
    ) -> Result<Option<Executable>, Fault> {
        let aim = program.aim();
        let instance = aim.instance(id)?;
        let (name, description) = (
            text(instance.argument(0)).into_owned(),
            text(instance.argument(1)).into_owned(),
        );
        let links = aim.links(id);
        let kind = match (keyword, description.as_str()) {
            (WORKPLAN, _) => ExecutableKind::Workplan(self.children(program, id, &links, SEQUENCE)),
            ("MACHINING_WORKINGSTEP", _) => {
                let operation = links.related("MACHINING_OPERATION_RELATIONSHIP");
                if let Some(operation) = operation
                    && !operations.contains_key(&operation)
                {
                    match read_operation(aim, operation) {
                        Ok(read) => {
                            operations.insert(operation, read);
                        }
                        Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
                    }
                }
                ExecutableKind::Workingstep {
                    operation,
                    turning: description == "turning",
                }
            }
            ("MACHINING_NC_FUNCTION", _) => ExecutableKind::Function(function(aim, &description, &links)),
            (_, "selective") => ExecutableKind::Selective(self.children(program, id, &links, BRANCH)),
            (_, "parallel") => ExecutableKind::Parallel(self.children(program, id, &links, CONCURRENT)),
            (_, "non-sequential") => ExecutableKind::NonSequential(self.children(program, id, &links, BODY)),
            (_, "if statement") => {
                let branch = |name: &str| {
                    let found = links
                        .relations
                        .iter()
                        .find(|relation| relation.keyword == BRANCH && relation.name == name);
                    found.map(|relation| relation.related)
                };
                ExecutableKind::If {
                    condition: expression::of_property(aim, &links, "condition"),
                    then: branch("true branch"),
                    otherwise: branch("false branch"),
                }
            }
            (_, "while statement") => ExecutableKind::While {
                condition: expression::of_property(aim, &links, "condition"),
                body: self.children(program, id, &links, BODY).first().copied(),
            },
            (_, "assignment") => ExecutableKind::Assignment {
                variable: expression::variable_name(aim, &links, "lvalue").unwrap_or_default(),
                value: expression::of_property(aim, &links, "rvalue"),
            },
            (_, "setup instructions") => return Ok(None),
            _ => ExecutableKind::Unknown(description),
        };
        let enabled = property_text(aim, &links, "enabled").is_none_or(|value| value != "disabled");
        let mut note = |fault: &Fault| program.note(&mut self.found, Severity::Warning, fault);
        let orientation = match links
            .property("toolpath orientation")
            .map(|property| placed(program, property))
        {
            Some(Ok(orientation)) => orientation.map(|(_, frame)| frame),
            Some(Err(fault)) => return Err(fault),
            None => None,
        };
        let mut setup = None;
        for (_, process) in links.processes.iter().filter(|(name, _)| name == "setup") {
            match read_setup(program, *process) {
                Ok(read) => setup = setup.or(read),
                Err(fault) => note(&fault),
            }
        }
        let security_plane = match links
            .property("security plane")
            .map(|property| plane_height(program, property))
        {
            Some(Ok(height)) => height,
            Some(Err(fault)) => {
                note(&fault);
                None
            }
            None => None,
        };
        Ok(Some(Executable {
            id,
            name,
            kind,
            enabled,
            orientation,
            setup,
            security_plane,
            twin: twin_facts(aim, &links, false),
        }))
    }

    /// The children by the relationship that the standard asks for, or, with a remark, by a relative of it.
    fn children(&mut self, program: &Program, id: u64, links: &Links, keyword: &str) -> Vec<u64> {
        let exact = links.in_sequence(keyword);
        if !exact.is_empty() {
            return exact;
        }
        for relative in [SEQUENCE, BRANCH, CONCURRENT, BODY] {
            let found = links.in_sequence(relative);
            if !found.is_empty() {
                let message = format!("children are tied by {relative} instead of {keyword}");
                program.note(
                    &mut self.found,
                    Severity::Remark,
                    &Fault::new(id, "child-relationship", message, ""),
                );
                return found;
            }
        }
        Vec::new()
    }
}

/// The text of a property's first item.
fn property_text(aim: Aim, links: &Links, name: &str) -> Option<String> {
    let representation = aim.representation(links.property(name)?).ok()?;
    aim.description(*representation.items.first()?)
}

/// The placement in a representation: the item named `orientation`, else the first; with its units.
fn placed(program: &Program, representation: u64) -> Result<Option<(u64, Transform<units::Setup, units::Setup>)>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let mut placements: Vec<u64> = representation
        .items
        .iter()
        .copied()
        .filter(|&item| curve::is_placement(aim, item))
        .collect();
    placements.sort_by_key(|&item| aim.item_name(item) != "orientation");
    let Some(&item) = placements.first() else { return Ok(None) };
    let units = context(program, &representation)?;
    Ok(Some((item, curve::placement(aim, item, units.millimetres)?)))
}

fn context(program: &Program, representation: &crate::aim::Representation) -> Result<ContextUnits, Fault> {
    let id = representation.context.unwrap_or(representation.id);
    match program.contexts.get(&id) {
        Some(units) => units.clone(),
        None => program.aim().context_units(id),
    }
}

fn plane_height(program: &Program, representation: u64) -> Result<Option<Millimetres>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let Some(&plane) = representation.items.iter().find(|&&item| aim.keyword(item) == "PLANE") else {
        return Ok(None);
    };
    let units = context(program, &representation)?;
    let plane = aim.instance(plane)?;
    let Some(position) = plane.argument(1).reference() else {
        return Ok(None);
    };
    let frame = curve::placement(aim, position, units.millimetres)?;
    Ok(Some(Millimetres(frame.origin[2])))
}

fn read_setup(program: &Program, process: u64) -> Result<Option<Setup>, Fault> {
    let aim = program.aim();
    let definition = aim
        .users_by(process, "PROCESS_PRODUCT_ASSOCIATION", 3)
        .find_map(|(_, association)| association.argument(2).reference());
    let Some(definition) = definition else { return Ok(None) };
    let formation = aim.instance(definition)?.argument(2).reference();
    let product = formation.and_then(|formation| aim.instance(formation).ok()?.argument(2).reference());
    let name = product.and_then(|product| aim.instance(product).ok());
    let name = name.map(|product| text(product.argument(0)).into_owned()).unwrap_or_default();

    let mut machine_from_setup = None;
    for (shape, instance) in aim.users_by(definition, "PRODUCT_DEFINITION_SHAPE", 2) {
        if text(instance.argument(0)) != "orientation" {
            continue;
        }
        for (_, link) in aim.users_by(shape, "SHAPE_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference()
                && let Some((_, frame)) = placed(program, representation)?
            {
                machine_from_setup = Some(retarget(&frame));
            }
        }
    }
    let mut security_plane = None;
    for (property, instance) in aim.users_by(definition, "PROPERTY_DEFINITION", 2) {
        if text(instance.argument(0)) != "security plane" {
            continue;
        }
        for (_, link) in aim.users_by(property, "PROPERTY_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference() {
                security_plane = plane_height(program, representation)?.or(security_plane);
            }
        }
    }
    Ok(Some(Setup {
        id: definition,
        name,
        machine_from_setup,
        setup_from_part: workpiece_placement(program, definition),
        security_plane,
    }))
}

/// The same numbers read as a transform into the machine.
fn retarget<T: units::Frame, S: units::Frame>(frame: &Transform<units::Setup, units::Setup>) -> Transform<T, S> {
    let mut out = Transform::IDENTITY;
    out.rotation = frame.rotation;
    out.origin = frame.origin;
    out
}

/// Where the workpiece lies in the set-up: item 1 is a frame in the workpiece, item 2 where that frame is in the set-up.
fn workpiece_placement(program: &Program, setup: u64) -> Option<Transform<units::Setup, Part>> {
    let aim = program.aim();
    let (relation, _) = aim.users_by(setup, "MACHINING_SETUP_WORKPIECE_RELATIONSHIP", 3).next()?;
    let (shape, _) = aim.users_by(relation, "PRODUCT_DEFINITION_SHAPE", 2).next()?;
    let (_, link) = aim.users_by(shape, "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", 1).next()?;
    let relationship = aim.instance(link.argument(0).reference()?).ok()?;
    let transformation = relationship
        .part("REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")?
        .first()?
        .reference()?;
    let shapes = relationship.part("REPRESENTATION_RELATIONSHIP")?;
    let units_of = |n: usize| {
        let representation = aim.representation(shapes.get(n)?.reference()?).ok()?;
        context(program, &representation).ok()
    };
    let (part_units, setup_units) = (units_of(2)?, units_of(3)?);
    let transformation = aim.instance(transformation).ok()?;
    let in_part = curve::placement(aim, transformation.argument(2).reference()?, part_units.millimetres).ok()?;
    let in_setup = curve::placement(aim, transformation.argument(3).reference()?, setup_units.millimetres).ok()?;
    Some(retarget(&(in_setup * in_part.inverse())))
}

fn read_operation(aim: Aim, id: u64) -> Result<Operation, Fault> {
    let instance = aim.instance(id)?;
    let links = aim.links(id);
    Ok(Operation {
        id,
        name: text(instance.argument(0)).into_owned(),
        kind: aim.keyword(id).to_string(),
        variant: text(instance.argument(1)).into_owned(),
        toolpaths: links.in_sequence("MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP"),
        technology: links.related("MACHINING_TECHNOLOGY_RELATIONSHIP"),
        functions: links.related("MACHINING_FUNCTIONS_RELATIONSHIP"),
    })
}

fn technology(aim: Aim, id: u64) -> Technology {
    let links = aim.links(id);
    let mut technology = Technology::default();
    if let Some(representation) = links.property("feedrate") {
        match feed(aim, representation) {
            Ok(feed) => technology.feed = feed,
            Err(fault) => technology.faults.push(fault),
        }
    }
    if let Some(representation) = links.property("spindle") {
        match spindle(aim, representation) {
            Ok(spindle) => technology.spindle = spindle,
            Err(fault) => technology.faults.push(fault),
        }
    }
    technology
}

fn feed(aim: Aim, representation: u64) -> Result<Option<FeedSetting>, Fault> {
    let representation = aim.representation(representation)?;
    for &item in &representation.items {
        let name = aim.item_name(item);
        let name = if name.is_empty() { representation.name.clone() } else { name };
        let measure = aim.measure(item)?;
        // Older files write every feed as a plain speed: the unit tells, the name only tells teeth from revolutions.
        let feed = match measure.dimension {
            unit::SPEED => FeedSetting::PerTime(MmPerSec(measure.value)),
            unit::PER_REVOLUTION | unit::LENGTH if name == "feed per tooth" => FeedSetting::PerTooth(Millimetres(measure.value)),
            unit::PER_REVOLUTION => FeedSetting::PerRevolution(Millimetres(measure.value)),
            unit::LENGTH if name == "feed per revolution" => FeedSetting::PerRevolution(Millimetres(measure.value)),
            _ => {
                let message = format!("the unit of '{name}' is no feed's");
                return Err(Fault::new(
                    item,
                    "feed-unit",
                    message,
                    "give the feed in length per time or per revolution",
                ));
            }
        };
        return Ok(Some(feed));
    }
    Ok(None)
}

fn spindle(aim: Aim, representation: u64) -> Result<Option<SpindleSetting>, Fault> {
    let representation = aim.representation(representation)?;
    let mut surface = None;
    let mut limit = None;
    for &item in &representation.items {
        let name = aim.item_name(item);
        let measure = aim.measure(item)?;
        let per_minute = match measure.dimension {
            [0, -1, 0, 1] | [0, -1, 0, 0] => Some(measure.value * 60.0),
            [0, -1, 1, 0] => Some(measure.value * 60.0 / std::f64::consts::TAU),
            _ => None,
        };
        match (per_minute, measure.dimension) {
            (Some(speed), _) if name == "maximum rotational speed" => limit = Some(Rpm(speed.abs())),
            (Some(0.0), _) => return Ok(Some(SpindleSetting::Stopped)),
            (Some(speed), _) => {
                return Ok(Some(SpindleSetting::Revolutions {
                    speed: Rpm(speed.abs()),
                    clockwise: speed < 0.0,
                }));
            }
            (None, unit::SPEED) => surface = Some(measure.value),
            _ => {
                let message = format!("the unit of '{name}' is no spindle speed's");
                return Err(Fault::new(
                    item,
                    "spindle-unit",
                    message,
                    "give it in revolutions per time, or as a surface speed",
                ));
            }
        }
    }
    Ok(surface.map(|speed| match speed {
        0.0 => SpindleSetting::Stopped,
        _ => SpindleSetting::Surface {
            speed: MmPerSec(speed.abs()),
            limit,
            clockwise: speed < 0.0,
        },
    }))
}

fn functions(aim: Aim, id: u64) -> MachineFunctions {
    let links = aim.links(id);
    let says = |property: &str, value: &str| property_text(aim, &links, property).is_some_and(|text| text == value);
    let on = says("coolant", "coolant on");
    let kind = property_text(aim, &links, "coolant type").unwrap_or_default();
    let mut functions = MachineFunctions {
        coolant: CoolantState {
            flood: on && (kind.is_empty() || kind == "flood"),
            mist: says("mist", "mist on") || (on && kind == "mist"),
            through: says("through spindle coolant", "through spindle coolant on") || (on && kind == "through tool"),
        },
        others: BTreeMap::new(),
    };
    let others = links.property("other functions").and_then(|id| aim.representation(id).ok());
    for item in others.map(|others| others.items).unwrap_or_default() {
        let mode = aim.description(item).unwrap_or_default();
        functions
            .others
            .entry(aim.item_name(item))
            .and_modify(|modes| {
                modes.push(',');
                modes.push_str(&mode);
            })
            .or_insert(mode);
    }
    functions
}

fn tool(aim: Aim, id: u64) -> Result<(Tool, Vec<Fault>), Fault> {
    let instance = aim.instance(id)?;
    let links = aim.links(id);
    let name = text(instance.argument(0)).into_owned();
    let mut faults = Vec::new();
    let mut tool = Tool {
        id,
        number: number_in(&name).or_else(|| number_in(&property_text(aim, &links, "tool position")?)),
        name,
        kind: text(instance.argument(1)).into_owned(),
        diameter: None,
        length: None,
        teeth: None,
        users: instance.argument(2).references().collect(),
    };
    for (_, representation, _) in links.properties.iter().filter(|property| property.0 == "tool body") {
        for &item in &aim.representation(*representation)?.items {
            let name = aim.item_name(item);
            let outcome = match name.as_str() {
                "effective cutting diameter" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.diameter = Some(Millimetres(mm))),
                "overall assembly length" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.length = Some(Millimetres(mm))),
                "number of effective teeth" => aim
                    .measure_of(item, unit::NUMBER, &name)
                    .map(|teeth| tool.teeth = Some(teeth)),
                _ => Ok(()),
            };
            faults.extend(outcome.err());
        }
    }
    Ok((tool, faults))
}

/// The number in `7`, `T07` or `Tool 7`.
fn number_in(text: &str) -> Option<ToolNumber> {
    let start = text.find(|c: char| c.is_ascii_digit())?;
    let digits: String = text[start..].chars().take_while(char::is_ascii_digit).collect();
    let behind = &text[start + digits.len()..];
    if behind.contains(|c: char| c.is_ascii_digit()) {
        return None; // `12 mm R0.5` is a description
    }
    digits.parse().ok().map(ToolNumber)
}

fn function(aim: Aim, description: &str, links: &Links) -> Function {
    let mut function = Function {
        kind: description.to_string(),
        text: String::new(),
        properties: BTreeMap::new(),
    };
    for (name, representation, _) in &links.properties {
        let Ok(representation) = aim.representation(*representation) else {
            continue;
        };
        let Some(&item) = representation.items.first() else { continue };
        let value = aim
            .measure(item)
            .map(|measure| part21::text::real(measure.value))
            .ok()
            .or_else(|| aim.description(item))
            .unwrap_or_default();
        match name.as_str() {
            // The mapping table says 'description', the local rule of the AIM 'function text': files have either.
            "message text" | "description" | "function text" => function.text = aim.description(item).unwrap_or_default(),
            "enabled" | "toolpath orientation" | "security plane" => {}
            _ => {
                function.properties.insert(name.clone(), value);
            }
        }
    }
    function
}

/// What makes an executable a twin; `None` without a start, unless `any` fact will do (toolpaths).
fn twin_facts(aim: Aim, links: &Links, any: bool) -> Option<TwinFacts> {
    let moment = |role: &str| {
        let found = links.dates.iter().find(|(name, _)| name == role)?;
        date::read(aim, found.1)
    };
    let start = moment("twin start");
    let is_twin = links.dates.iter().any(|(role, _)| role == "twin start");
    let plan = links.related("MACHINING_TWIN_RELATIONSHIP");
    if !is_twin && !(any && plan.is_some()) {
        return None;
    }
    let worktime = links.property("twin worktime").and_then(|id| aim.representation(id).ok());
    let worktime = worktime.and_then(|found| aim.measure_of(*found.items.first()?, unit::TIME, "twin worktime").ok());
    Some(TwinFacts {
        start,
        end: moment("twin end"),
        plan,
        source: property_text(aim, links, "twin source"),
        worktime: worktime.map(Seconds),
        exception: property_text(aim, links, "twin exception"),
    })
}

fn read_toolpath(program: &Program, id: u64) -> Toolpath {
    let aim = program.aim();
    let mut toolpath = Toolpath {
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
        curve: None,
        context: None,
        faults: Vec::new(),
    };
    let instance = match aim.instance(id) {
        Ok(instance) => instance,
        Err(fault) => {
            toolpath.faults.push(fault);
            return toolpath;
        }
    };
    toolpath.name = text(instance.argument(0)).into_owned();
    toolpath.description = text(instance.argument(1)).into_owned();
    let links = aim.links(id);
    toolpath.technology = links.related("MACHINING_TECHNOLOGY_RELATIONSHIP");
    toolpath.functions = links.related("MACHINING_FUNCTIONS_RELATIONSHIP");
    toolpath.twin = twin_facts(aim, &links, true);
    toolpath.trajectory = property_text(aim, &links, "trajectory type").unwrap_or_default();
    toolpath.reversed = property_text(aim, &links, "direction").is_some_and(|direction| direction == "end to beginning");
    let mut read = || -> Result<(), Fault> {
        if let Some(representation) = links.property("basic curve") {
            let representation = aim.representation(representation)?;
            toolpath.curve = representation.items.first().map(|&curve| (representation.id, curve));
            toolpath.context = representation.context;
        }
        if let Some(representation) = links.property("tool axis")
            && let Some(&curve) = aim.representation(representation)?.items.first()
        {
            toolpath.tilted = curve::is_tilted(aim, curve);
        }
        if let Some(representation) = links.property("dwell") {
            toolpath.dwell = dwell(aim, representation)?;
        }
        if let Some(representation) = links.property("speed profile") {
            match speed_profile(aim, representation)? {
                None => toolpath.kind = ToolpathKind::Rapid,
                profile => toolpath.profile = profile,
            }
        }
        if let Some(representation) = links.property("path maximum deviation")
            && let Some(&item) = aim.representation(representation)?.items.first()
        {
            let deviation = aim.measure_of(item, unit::LENGTH, "path maximum deviation")?;
            toolpath.maximum_deviation = Some(Millimetres(deviation.abs()));
        }
        Ok(())
    };
    let outcome = read();
    toolpath.faults.extend(outcome.err());
    if toolpath.description == "feedstop" {
        toolpath.kind = ToolpathKind::Dwell;
    }
    toolpath
}

fn dwell(aim: Aim, representation: u64) -> Result<Option<Dwell>, Fault> {
    let representation = aim.representation(representation)?;
    let Some(&item) = representation.items.first() else {
        return Ok(None);
    };
    let measure = aim.measure(item)?;
    let revolutions = representation.name == "dwell revolution" || aim.item_name(item) == "dwell revolution";
    match measure.dimension {
        unit::TIME if measure.value >= 0.0 => Ok(Some(Dwell::Time(Seconds(measure.value)))),
        unit::NUMBER | unit::REVOLUTIONS if revolutions && measure.value >= 0.0 => Ok(Some(Dwell::Revolutions(measure.value))),
        _ => Err(Fault::new(
            item,
            "dwell",
            "a dwell is neither a time nor revolutions",
            "give the dwell as a time",
        )),
    }
}

/// The multiplier along a path; `None` is rapid.
fn speed_profile(aim: Aim, representation: u64) -> Result<Option<SpeedProfile>, Fault> {
    let representation = aim.representation(representation)?;
    let fault = |message: &str| {
        Fault::new(
            representation.id,
            "speed-profile",
            message,
            "use 'rapid', a ratio or a curve of numbers",
        )
    };
    let Some(&item) = representation.items.first() else {
        return Err(fault("a speed profile is empty"));
    };
    if aim.keyword(item) == "DESCRIPTIVE_REPRESENTATION_ITEM" {
        return match aim.description(item).as_deref() {
            Some("rapid") => Ok(None),
            _ => Err(fault("the only speed that has a name is 'rapid'")),
        };
    }
    if aim.is(item, "BOUNDED_CURVE")
        || aim.keyword(item) == "POLYLINE"
        || aim.keyword(item).ends_with("_CURVE")
        || aim.is(item, "B_SPLINE_CURVE_WITH_KNOTS")
    {
        let numbers = curve::numbers_along(aim, item)?;
        let last = (numbers.len() - 1).max(1) as f64;
        let points = numbers
            .into_iter()
            .enumerate()
            .map(|(n, factor)| (n as f64 / last, factor))
            .collect();
        return Ok(Some(SpeedProfile { points }));
    }
    let ratio = aim.measure_of(item, unit::NUMBER, "a speed profile")?;
    if ratio <= 0.0 {
        return Err(fault("a feed multiplier is not above 0"));
    }
    Ok(Some(SpeedProfile {
        points: vec![(0.0, ratio), (1.0, ratio)],
    }))
}

//! Runs a program: [`StepNcStream`] walks the tree and says one step at a time.
//!
//! **Frames.** A path's points stay as the file writes them. The frame step before them is
//! `machine_from_setup = set-up origin . toolpath orientations`, the orientations of all executables around, outer first, the origin
//! of the nearest set-up. So plan, record and as-executed paths are in the frame of the path's own numbers. The standard does not say
//! whether the placement of the workpiece moves paths as well; here it does not (the set-up is the frame that paths are written in),
//! and [`PathFrame`] is the one switch for files that mean the other.
//!
//! **What is added.** Where a path does not begin at the end of the last one a rapid link is put in, marked `derived`: up, across, down (on a
//! lathe out in X, along, in), as a straight one could go through the part. Spindle and coolant rest for a tool change and at the end. Tool, spindle,
//! coolant and path tolerance are said when they change. `other functions` along a path become one [`RawNcFunction`] of that kind
//! behind the path's beginning; they end with the path. Two of them are the stream's own: exact stop and another tool offset, see
//! [`crate::write`].
//!
//! **Order.** Parallel and non-sequential executables are executed in the order of the file, one after the other, and a remark names it; of a
//! selective one the first that is enabled. Conditions and assignments are worked out when the stream comes to them; what only the
//! machine knows is asked for.
//!
//! **What is not run.** Curves of contact points, tilted tool axes and everything broken end in an alarm that names the instance, its
//! line and what to do. A connection without a curve (`connect direct`) is the link to the next path.

mod conditions;
mod deciding;
mod frame;
mod functions;
mod path;
mod setting;
mod structure;

pub use structure::StructuredStream;

use deciding::{EXPRESSION_REMEDY, names, substitute, truth, writes_the_machine};

use crate::aim::Fault;
use crate::curve::{Pieces, PiecesState};
use crate::model::{
    Dwell, Executable, ExecutableKind, FeedSetting, Function, Operation, Program, Project, SpindleSetting, Tool, Toolpath,
    ToolpathKind,
};
use plan::flow::Flow;
use plan::line::is_of_the_machine;
use plan::tables::Missing;
use plan::{
    Alarm, Answer, CoolantState, Diagnostic, Diagnostics, Expression, Feed, FileId, FrameChange, Level, Marker, Move, Next,
    Origin, Path, PathMode, Place, ProgramStream, Question, RawNcFunction, Severity, Speed, SpeedProfile, SpindleMode,
    SpindleState, Step, StepKind, StopKind, Tables, ToolCall, ToolOffset,
};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use units::{Machine, Millimetres, Point, Rpm, Seconds, Setup, StepId, ToolNumber, Transform};

/// In which frame the numbers of toolpaths are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PathFrame {
    /// The set-up's: the usual reading.
    #[default]
    Setup,
    /// The workpiece's: the placement of the workpiece in the set-up moves the paths too.
    Workpiece,
}

/// How a program is run.
#[derive(Clone, Debug)]
pub struct StreamOptions {
    /// The MACHINING_PROJECT to run; the first one that is no twin when `None`.
    pub project: Option<u64>,
    /// Tools and offsets of the machine. A work offset of the set-up's name goes before the set-up's origin in the file.
    pub tables: Tables,
    /// How the numbers of toolpaths are read.
    pub path_frame: PathFrame,
    /// The spindle of the machine turns no faster, revolutions per minute: the limit of a surface speed that has none in the file.
    pub spindle_limit: Rpm,
}

impl Default for StreamOptions {
    fn default() -> Self {
        Self {
            project: None,
            tables: Tables::empty(),
            path_frame: PathFrame::Setup,
            spindle_limit: Rpm(4000.0),
        }
    }
}

/// A STEP-NC program as a stream.
pub struct StepNcStream {
    program: Arc<Program>,
    options: StreamOptions,
    run: Run,
}

/// Everything that a rewind forgets.
struct Run {
    last_step: u32,
    tasks: Vec<Task>,
    queue: VecDeque<(Origin, Said)>,
    /// Both ways of each branch are told; see [`StructuredStream`].
    structured: bool,
    place: TipPlace,
    pending: Option<Pending>,
    alarm: Option<Alarm>,
    diagnostics: Diagnostics,
    scopes: Vec<u64>,
    variables: BTreeMap<String, f64>,
    gauge: Point<Machine>,
    frame: Option<Transform<Machine, Setup>>,
    /// The set-up of that frame. Two may lie at one place in the file, and elsewhere at the machine.
    setup: Option<String>,
    tool: Option<ToolNumber>,
    offset: ToolOffset,
    /// The offset of the tool in the spindle; a path may ask for another one.
    own_offset: ToolOffset,
    /// `None` where it depends on the way that was taken.
    spindle: Option<SpindleState>,
    coolant: Option<CoolantState>,
    path_mode: Option<PathMode>,
    /// Height in the set-up that the next link has to reach: a connection over the security plane was passed.
    clearance: Option<Millimetres>,
}

/// What waits to be told.
enum Said {
    Step(StepKind),
    /// Only where the structure is told.
    Flow(Flow),
}

/// Where the tip is when the structure is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TipPlace {
    /// Where the last path ended.
    Known,
    /// It depends on the way that was taken, or on where the machine stood.
    Anywhere,
    /// Out of the way.
    Lifted,
}

/// What is left to do, innermost last.
enum Task {
    Start,
    Execute(u64),
    Sequence {
        children: Vec<u64>,
        next: usize,
    },
    Loop(u64),
    Toolpaths {
        operation: u64,
        next: usize,
    },
    Path(Box<OpenPath>),
    /// The border behind a branch or a loop's body that was told.
    Meet(Box<structure::Meeting>),
    /// Ends what `scopes` has last, and its marker.
    Close(Option<Level>, u64),
    End(Level, u64),
    Finish,
}

/// A toolpath that is being run.
struct OpenPath {
    toolpath: Toolpath,
    pieces: PiecesState,
    speed: Speed,
    /// The multiplier and the whole length it is spread over.
    profile: Option<(SpeedProfile, f64)>,
    travelled: f64,
}

/// A question that was asked.
enum Pending {
    OptionalStop(u64),
    /// The value of `asked`, for what an assignment still has to work out.
    Assignment {
        executable: u64,
        asked: String,
        value: Expression,
    },
    Branch {
        executable: u64,
        expression: Expression,
    },
    Loop {
        executable: u64,
        expression: Expression,
    },
}

/// Executables inside executables, at most: no plan for people is deeper, and each level costs a look at all above it.
const DEEPEST: usize = 1000;

/// Turns of a loop, or other structure, without a single step: then it will never have one.
const MOST_IDLE: u32 = 1_000_000;

impl StepNcStream {
    /// The stream of a program.
    pub fn new(program: Arc<Program>, options: StreamOptions) -> Self {
        let run = Run::new(&program, &options);
        Self { program, options, run }
    }

    /// The program it runs.
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }
}

impl StepNcStream {
    /// The next thing, `None` when a border of the flow stands first in the queue.
    fn next_said(&mut self, answer: Option<Answer>) -> Option<Next> {
        let mut walker = Walker {
            program: &self.program,
            options: &self.options,
            run: &mut self.run,
        };
        if let Some(pending) = walker.run.pending.take() {
            match walker.answered(pending, answer) {
                Ok(None) => {}
                Ok(Some(question)) => return Some(Next::Ask(question)),
                Err(fault) => walker.fail(&fault),
            }
        }
        let mut idle = 0;
        loop {
            if let Some((_, Said::Flow(_))) = walker.run.queue.front() {
                return None;
            }
            if let Some((origin, Said::Step(kind))) = walker.run.queue.pop_front() {
                walker.run.last_step = walker.run.last_step.saturating_add(1);
                return Some(Next::Step(Step {
                    id: StepId(walker.run.last_step),
                    origin,
                    kind,
                }));
            }
            if let Some(alarm) = &walker.run.alarm {
                return Some(Next::Alarm(alarm.clone()));
            }
            idle += 1;
            let Some(task) = walker.run.tasks.pop() else {
                return Some(Next::End);
            };
            let entity = task.entity();
            let outcome = walker.advance(task);
            match outcome {
                Ok(None) if idle > MOST_IDLE => {
                    walker.fail(&Fault::new(
                        entity,
                        "endless-loop",
                        "the program runs in a circle without doing anything",
                        "correct its structure",
                    ));
                }
                Ok(None) => {}
                Ok(Some(question)) => return Some(Next::Ask(question)),
                Err(fault) => walker.fail(&fault),
            }
        }
    }
}

impl ProgramStream for StepNcStream {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        self.next_said(answer)
            .expect("borders of the flow are queued only where the structure is told")
    }

    fn rewind(&mut self) {
        self.run = Run::new(&self.program, &self.options);
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.run.diagnostics.as_slice()
    }

    fn file_name(&self, _file: FileId) -> &str {
        self.program.name()
    }
}

impl Run {
    fn new(program: &Program, options: &StreamOptions) -> Self {
        let mut diagnostics = Diagnostics::new();
        for diagnostic in program.diagnostics() {
            diagnostics.add(diagnostic.clone());
        }
        Run {
            last_step: 0,
            tasks: vec![Task::Start],
            queue: VecDeque::new(),
            structured: false,
            place: TipPlace::Known,
            pending: None,
            alarm: None,
            diagnostics,
            scopes: Vec::new(),
            variables: program.initial_values().clone(),
            gauge: options.tables.position,
            frame: None,
            setup: None,
            tool: None,
            offset: ToolOffset::NONE,
            own_offset: ToolOffset::NONE,
            spindle: Some(SpindleState::Stopped),
            coolant: Some(CoolantState::default()),
            path_mode: Some(PathMode::Tolerance(None)),
            clearance: None,
        }
    }
}

impl Task {
    fn entity(&self) -> u64 {
        match self {
            Task::Execute(id) | Task::Loop(id) | Task::Close(_, id) | Task::End(_, id) => *id,
            Task::Toolpaths { operation, .. } => *operation,
            Task::Path(open) => open.toolpath.id,
            Task::Start | Task::Sequence { .. } | Task::Finish | Task::Meet(_) => 0,
        }
    }
}

/// The stream's parts, borrowed apart.
struct Walker<'s> {
    program: &'s Program,
    options: &'s StreamOptions,
    run: &'s mut Run,
}

type Outcome = Result<Option<Question>, Fault>;

impl<'s> Walker<'s> {
    fn fail(&mut self, fault: &Fault) {
        let diagnostic = self.program.diagnostic(Severity::Error, fault);
        if !self.run.diagnostics.as_slice().iter().any(|known| known.code == fault.code) {
            self.run.diagnostics.add(diagnostic.clone());
        }
        self.run.alarm = Some(Alarm::from(diagnostic));
    }

    fn say(&mut self, entity: u64, kind: StepKind) {
        let place = if entity == 0 { Place::Given } else { Place::Entity(entity) };
        self.run
            .queue
            .push_back((Origin { file: FileId(0), place }, Said::Step(kind)));
    }

    fn begin(&mut self, level: Level, entity: u64, name: &str, maximum_deviation: Option<Millimetres>) {
        let marker = Marker {
            level,
            name: name.to_string(),
            entity: (entity != 0).then_some(entity),
            maximum_deviation,
            derived: false,
        };
        self.say(entity, StepKind::Begin(marker));
    }

    fn advance(&mut self, task: Task) -> Outcome {
        match task {
            Task::Start => self.start(),
            Task::Execute(id) => self.execute(id),
            Task::Sequence { children, next } => {
                if let Some(&child) = children.get(next) {
                    self.run.tasks.push(Task::Sequence {
                        children,
                        next: next + 1,
                    });
                    self.run.tasks.push(Task::Execute(child));
                }
                Ok(None)
            }
            Task::Loop(id) => self.turn(id),
            Task::Toolpaths { operation, next } => {
                let program = self.program;
                if let Some(operation) = program.operation(operation)
                    && let Some(&id) = operation.toolpaths.get(next)
                {
                    self.run.tasks.push(Task::Toolpaths {
                        operation: operation.id,
                        next: next + 1,
                    });
                    self.open(operation, program.toolpath(id))?;
                }
                Ok(None)
            }
            Task::Path(open) => self.travel(*open).map(|()| None),
            Task::Meet(meeting) => {
                self.meet(*meeting);
                Ok(None)
            }
            Task::Close(level, id) => {
                self.run.scopes.pop();
                if let Some(level) = level {
                    self.say(id, StepKind::End(level));
                }
                Ok(None)
            }
            Task::End(level, id) => {
                self.say(id, StepKind::End(level));
                Ok(None)
            }
            Task::Finish => {
                self.rest();
                self.say(0, StepKind::End(Level::Program));
                Ok(None)
            }
        }
    }

    fn start(&mut self) -> Outcome {
        let program = self.program;
        if let Some(damage) = program.damage() {
            // The place of the damage, not of an instance.
            self.run.alarm = Some(Alarm::from(Diagnostic {
                remedy:
                    "the file is damaged and parts of it may be missing: it can be inspected, and is not run; export it again"
                        .into(),
                ..damage.clone()
            }));
            return Ok(None);
        }
        let wanted = |project: &&Project| match self.options.project {
            Some(id) => project.id == Some(id) || project.main_workplan == id,
            None => !project.is_twin,
        };
        let Some(project) = program.projects().iter().find(wanted) else {
            return Err(Fault::new(
                0,
                "no-program",
                "the file has no machining program to run",
                "open a STEP-NC file with a project or a workplan",
            ));
        };
        // Also where only the machine decides whether the program comes by: it is known now, and nothing has moved.
        let mut found = None;
        program.walk(project.main_workplan, &mut |executable, enabled| {
            if let ExecutableKind::Assignment { variable, .. } = &executable.kind
                && enabled
                && is_of_the_machine(variable)
            {
                found.get_or_insert_with(|| writes_the_machine(executable, variable));
            }
        });
        if let Some(fault) = found {
            return Err(fault);
        }
        self.begin(Level::Program, project.id.unwrap_or(0), &project.name, None);
        if self.run.structured {
            self.say_initial_values();
        }
        self.run.tasks.push(Task::Finish);
        self.run.tasks.push(Task::Execute(project.main_workplan));
        Ok(None)
    }

    fn execute(&mut self, id: u64) -> Outcome {
        let program = self.program;
        let Some(executable) = program.executable(id) else {
            if program.is_instruction(id) {
                return Ok(None); // for the person who sets up, before the program
            }
            return Err(Fault::new(
                id,
                "not-executable",
                "what should be executed is no executable, or is not in the file",
                "repair the workplan",
            ));
        };
        // What has happened is not done again, unless it is the twin itself that shall be run.
        let in_twin = self
            .run
            .scopes
            .first()
            .is_none_or(|&root| program.executable(root).is_some_and(|root| root.twin.is_some()));
        if !executable.enabled || (executable.twin.is_some() && !in_twin) {
            return Ok(None);
        }
        if self.run.scopes.len() >= DEEPEST {
            let message = format!("executables are nested more than {DEEPEST} deep");
            return Err(Fault::new(id, "nesting", message, "flatten the workplans"));
        }
        if self.run.scopes.contains(&id) {
            return Err(Fault::new(
                id,
                "endless-tree",
                format!("'{}' contains itself", executable.name),
                "remove the cycle",
            ));
        }
        let unsupported = |code, what: String, remedy| Err(Fault::new(id, code, what, remedy));
        match &executable.kind {
            ExecutableKind::Workplan(children) => {
                self.enter(executable, Some(Level::Workplan));
                self.run.tasks.push(Task::Sequence {
                    children: children.clone(),
                    next: 0,
                });
            }
            ExecutableKind::NonSequential(children) | ExecutableKind::Parallel(children) => {
                self.say_order(executable);
                self.enter(executable, None);
                self.run.tasks.push(Task::Sequence {
                    children: children.clone(),
                    next: 0,
                });
            }
            ExecutableKind::Selective(children) => {
                self.enter(executable, None);
                let enabled = |child: &&u64| program.executable(**child).is_some_and(|child| child.enabled);
                self.run
                    .tasks
                    .extend(children.iter().find(enabled).map(|&child| Task::Execute(child)));
            }
            ExecutableKind::If {
                condition,
                then,
                otherwise,
            } if self.run.structured => {
                let expression = structure::readable(executable, condition)?;
                self.enter(executable, None);
                self.both_ways(id, expression, *then, *otherwise);
            }
            ExecutableKind::While { condition, body } if self.run.structured => {
                let expression = structure::readable(executable, condition)?;
                self.enter(executable, None);
                self.the_body(id, expression, *body);
            }
            ExecutableKind::If { condition, .. } => {
                let expression = self.condition(executable, condition)?;
                self.enter(executable, None);
                return match truth(&expression) {
                    Some(truth) => self.branch(executable, truth).map(|()| None),
                    None => {
                        self.run.pending = Some(Pending::Branch {
                            executable: id,
                            expression: expression.clone(),
                        });
                        Ok(Some(Question::Condition(expression)))
                    }
                };
            }
            ExecutableKind::While { .. } => {
                self.enter(executable, None);
                self.run.tasks.push(Task::Loop(id));
            }
            ExecutableKind::Assignment { variable, value } => {
                let value = match value {
                    Ok(value) if self.run.structured => value.clone(),
                    Ok(value) => substitute(value, &self.run.variables),
                    Err(why) => {
                        return unsupported(
                            "assignment",
                            format!("the value of '{}' cannot be read: {why}", executable.name),
                            EXPRESSION_REMEDY,
                        );
                    }
                };
                if variable.is_empty() {
                    return unsupported(
                        "assignment",
                        format!("'{}' assigns to no variable with a name", executable.name),
                        EXPRESSION_REMEDY,
                    );
                }
                if is_of_the_machine(variable) {
                    return Err(writes_the_machine(executable, variable));
                }
                if self.run.structured {
                    let variable = variable.clone();
                    self.say_flow(id, Flow::Assign { variable, value });
                    return Ok(None);
                }
                return self.assign(executable, variable, value);
            }
            ExecutableKind::Function(function) => return self.function(executable, function),
            ExecutableKind::Workingstep { operation, .. } => {
                let operation = operation.and_then(|id| program.operation(id)).ok_or_else(|| {
                    Fault::new(
                        id,
                        "no-operation",
                        format!("workingstep '{}' has no operation", executable.name),
                        "give it one, or disable the workingstep",
                    )
                })?;
                self.enter(executable, Some(Level::Workingstep));
                self.begin(Level::Operation, operation.id, &operation.name, None);
                self.run.tasks.push(Task::End(Level::Operation, operation.id));
                if operation.toolpaths.is_empty() && operation.is_rapid_movement() {
                    let message = format!("rapid movement '{}' says not where to, and is passed over", operation.name);
                    let fault = Fault::new(operation.id, "no-place", message, "give it a toolpath");
                    program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
                    return Ok(None);
                }
                if operation.toolpaths.is_empty() {
                    return unsupported(
                        "no-toolpaths",
                        format!("operation '{}' ({}) has no toolpaths", operation.name, operation.kind),
                        "let the CAM system compute them; none are made up here",
                    );
                }
                self.run.tasks.push(Task::Toolpaths {
                    operation: operation.id,
                    next: 0,
                });
                self.tool_for(operation)?;
            }
            ExecutableKind::Unknown(description) => {
                return unsupported(
                    "unknown-executable",
                    format!("'{}' is an executable of the unknown kind '{description}'", executable.name),
                    "disable it, or use one of the kinds of ISO 10303-238",
                );
            }
        }
        Ok(None)
    }

    /// Opens a scope (set-up, orientation) and what closes it again.
    fn enter(&mut self, executable: &Executable, level: Option<Level>) {
        self.run.scopes.push(executable.id);
        if let Some(level) = level {
            self.begin(level, executable.id, &executable.name, None);
        }
        self.run.tasks.push(Task::Close(level, executable.id));
    }

    /// What has no order of its own is executed in the order of the file, and that is said.
    fn say_order(&mut self, executable: &Executable) {
        let program = self.program;
        let names = executable
            .children()
            .into_iter()
            .filter_map(|child| program.executable(child));
        let names: Vec<String> = names
            .filter(|child| child.enabled)
            .map(|child| format!("'{}'", child.name))
            .collect();
        let (code, asks) = match executable.kind {
            ExecutableKind::Parallel(_) => (
                "parallel-order",
                "asks for several things at the same time: this machine has one channel, and does",
            ),
            _ => ("non-sequential-order", "leaves the order open: it is"),
        };
        let message = format!("'{}' {asks} {}", executable.name, names.join(", then "));
        program.note(
            &mut self.run.diagnostics,
            Severity::Remark,
            &Fault::new(executable.id, code, message, ""),
        );
    }

    /// One turn of a while statement: asks, or decides by itself.
    fn turn(&mut self, id: u64) -> Outcome {
        let program = self.program;
        let Some(executable) = program.executable(id) else {
            return Ok(None);
        };
        let ExecutableKind::While { condition, .. } = &executable.kind else {
            return Ok(None);
        };
        let expression = self.condition(executable, condition)?;
        match truth(&expression) {
            Some(truth) => {
                self.again(executable, truth);
                Ok(None)
            }
            None => {
                self.run.pending = Some(Pending::Loop {
                    executable: id,
                    expression: expression.clone(),
                });
                Ok(Some(Question::Condition(expression)))
            }
        }
    }
}

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
//! behind the path's beginning; they end with the path.
//!
//! **What is not run.** Parallel executables, curves of contact points, tilted tool axes and everything broken end in an alarm that
//! names the instance, its line and what to do.

use crate::aim::Fault;
use crate::curve::{Pieces, PiecesState};
use crate::model::{
    Dwell, Executable, ExecutableKind, FeedSetting, Function, Operation, Program, Project, SpindleSetting, Tool, Toolpath,
    ToolpathKind,
};
use crate::write;
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
}

impl Default for StreamOptions {
    fn default() -> Self {
        Self {
            project: None,
            tables: Tables::empty(),
            path_frame: PathFrame::Setup,
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
    queue: VecDeque<(Origin, StepKind)>,
    pending: Option<Pending>,
    alarm: Option<Alarm>,
    diagnostics: Diagnostics,
    scopes: Vec<u64>,
    variables: BTreeMap<String, f64>,
    gauge: Point<Machine>,
    frame: Option<Transform<Machine, Setup>>,
    tool: Option<ToolNumber>,
    offset: ToolOffset,
    /// The offset of the tool in the spindle; a path may ask for another one.
    own_offset: ToolOffset,
    spindle: SpindleState,
    coolant: CoolantState,
    path_mode: PathMode,
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
    Branch { executable: u64, expression: Expression },
    Loop { executable: u64, expression: Expression },
}

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

impl ProgramStream for StepNcStream {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        let mut walker = Walker {
            program: &self.program,
            options: &self.options,
            run: &mut self.run,
        };
        if let Some(pending) = walker.run.pending.take() {
            match walker.answered(pending, answer) {
                Ok(None) => {}
                Ok(Some(question)) => return Next::Ask(question),
                Err(fault) => walker.fail(&fault),
            }
        }
        let mut idle = 0;
        loop {
            if let Some((origin, kind)) = walker.run.queue.pop_front() {
                walker.run.last_step = walker.run.last_step.saturating_add(1);
                return Next::Step(Step {
                    id: StepId(walker.run.last_step),
                    origin,
                    kind,
                });
            }
            if let Some(alarm) = &walker.run.alarm {
                return Next::Alarm(alarm.clone());
            }
            idle += 1;
            let Some(task) = walker.run.tasks.pop() else {
                return Next::End;
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
                Ok(Some(question)) => return Next::Ask(question),
                Err(fault) => walker.fail(&fault),
            }
        }
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
            pending: None,
            alarm: None,
            diagnostics,
            scopes: Vec::new(),
            variables: BTreeMap::new(),
            gauge: options.tables.position,
            frame: None,
            tool: None,
            offset: ToolOffset::NONE,
            own_offset: ToolOffset::NONE,
            spindle: SpindleState::Stopped,
            coolant: CoolantState::default(),
            path_mode: PathMode::Tolerance(None),
        }
    }
}

impl Task {
    fn entity(&self) -> u64 {
        match self {
            Task::Execute(id) | Task::Loop(id) | Task::Close(_, id) | Task::End(_, id) => *id,
            Task::Toolpaths { operation, .. } => *operation,
            Task::Path(open) => open.toolpath.id,
            Task::Start | Task::Sequence { .. } | Task::Finish => 0,
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
        self.run.queue.push_back((Origin { file: FileId(0), place }, kind));
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
            if program.is_iso_14649() {
                return Err(Fault::new(
                    0,
                    "iso-14649",
                    "an ISO 14649 file (ARM) cannot be run yet",
                    "export it as ISO 10303-238 (AIM) with toolpaths",
                ));
            }
            return Err(Fault::new(
                0,
                "no-program",
                "the file has no machining program to run",
                "open a STEP-NC file with a project or a workplan",
            ));
        };
        self.begin(Level::Program, project.id.unwrap_or(0), &project.name, None);
        self.run.tasks.push(Task::Finish);
        self.run.tasks.push(Task::Execute(project.main_workplan));
        Ok(None)
    }

    fn execute(&mut self, id: u64) -> Outcome {
        let program = self.program;
        let Some(executable) = program.executable(id) else {
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
            ExecutableKind::NonSequential(children) => {
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
            ExecutableKind::Parallel(_) => {
                return unsupported(
                    "parallel",
                    format!(
                        "'{}' asks for several things at the same time, which is not supported yet",
                        executable.name
                    ),
                    "put its parts into a workplan one after the other",
                );
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
                    Ok(value) => substitute(value, &self.run.variables),
                    Err(why) => {
                        return unsupported(
                            "assignment",
                            format!("the value of '{}' cannot be read: {why}", executable.name),
                            EXPRESSION_REMEDY,
                        );
                    }
                };
                match value.evaluate(&|_| None) {
                    Ok(plan::Value::Number(number)) if !variable.is_empty() => {
                        self.run.variables.insert(variable.clone(), number);
                    }
                    Ok(_) => {
                        return unsupported(
                            "assignment",
                            format!("'{}' assigns no number to a named variable", executable.name),
                            EXPRESSION_REMEDY,
                        );
                    }
                    Err(why) => {
                        return unsupported(
                            "assignment",
                            format!(
                                "'{}' needs a value that only the machine knows, which is not supported yet: {why}",
                                executable.name
                            ),
                            "put the value into the condition that uses the variable",
                        );
                    }
                }
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

    fn condition(&self, executable: &Executable, condition: &Result<Expression, String>) -> Result<Expression, Fault> {
        match condition {
            Ok(expression) => Ok(substitute(expression, &self.run.variables)),
            Err(why) => Err(Fault::new(
                executable.id,
                "condition",
                format!("the condition of '{}' cannot be read: {why}", executable.name),
                EXPRESSION_REMEDY,
            )),
        }
    }

    fn branch(&mut self, executable: &Executable, truth: bool) -> Result<(), Fault> {
        if let ExecutableKind::If { then, otherwise, .. } = &executable.kind {
            let chosen = if truth { then } else { otherwise };
            self.run.tasks.extend(chosen.map(Task::Execute));
        }
        Ok(())
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

    fn again(&mut self, executable: &Executable, truth: bool) {
        if let ExecutableKind::While { body: Some(body), .. } = &executable.kind
            && truth
        {
            self.run.tasks.push(Task::Loop(executable.id));
            self.run.tasks.push(Task::Execute(*body));
        }
    }

    fn answered(&mut self, pending: Pending, answer: Option<Answer>) -> Outcome {
        let (entity, question) = match &pending {
            Pending::OptionalStop(id) => (*id, Question::OptionalStop),
            Pending::Branch { executable, expression } | Pending::Loop { executable, expression } => {
                (*executable, Question::Condition(expression.clone()))
            }
        };
        let truth = match answer {
            Some(Answer::Truth(truth)) => truth,
            None => {
                self.run.pending = Some(pending);
                return Ok(Some(question));
            }
            Some(_) => {
                return Err(Fault::new(
                    entity,
                    "no-answer",
                    "the machine cannot say whether the condition is true",
                    "check the names in the condition, or whether this machine has that sensor",
                ));
            }
        };
        let program = self.program;
        match pending {
            Pending::OptionalStop(id) => {
                if truth {
                    self.say(id, StepKind::Stop(StopKind::Optional));
                }
            }
            Pending::Branch { executable, .. } => {
                if let Some(executable) = program.executable(executable) {
                    self.branch(executable, truth)?;
                }
            }
            Pending::Loop { executable, .. } => {
                if let Some(executable) = program.executable(executable) {
                    self.again(executable, truth);
                }
            }
        }
        Ok(None)
    }

    fn function(&mut self, executable: &Executable, function: &Function) -> Outcome {
        let (program, id) = (self.program, executable.id);
        match function.kind.as_str() {
            "display message" => self.say(id, StepKind::Message(function.text.clone())),
            "program stop" => self.say(id, StepKind::Stop(StopKind::Program)),
            "optional stop" => {
                self.run.pending = Some(Pending::OptionalStop(id));
                return Ok(Some(Question::OptionalStop));
            }
            "load tool" => {
                let tool = program.tool_of(id).ok_or_else(|| {
                    Fault::new(
                        id,
                        "no-tool",
                        format!(
                            "'{}' loads a tool and no MACHINING_TOOL names it as its user",
                            executable.name
                        ),
                        "add it to the users of the tool",
                    )
                })?;
                self.change_tool(id, tool)?;
            }
            "unload tool" => {
                self.rest();
                self.run.tool = Some(ToolNumber(0));
                self.run.offset = ToolOffset::NONE;
                self.run.own_offset = ToolOffset::NONE;
                self.say(
                    id,
                    StepKind::Tool(ToolCall {
                        number: ToolNumber(0),
                        name: String::new(),
                        diameter: None,
                    }),
                );
                self.say(id, StepKind::ToolOffset(ToolOffset::NONE));
            }
            _ => self.say(
                id,
                StepKind::NcFunction(RawNcFunction {
                    kind: function.kind.clone(),
                    name: executable.name.clone(),
                    text: function.text.clone(),
                    properties: function.properties.clone(),
                }),
            ),
        }
        Ok(None)
    }

    /// Stops spindle and coolant where they run.
    fn rest(&mut self) {
        if self.run.spindle != SpindleState::Stopped {
            self.run.spindle = SpindleState::Stopped;
            self.say(0, StepKind::Spindle(SpindleState::Stopped));
        }
        if self.run.coolant != CoolantState::default() {
            self.run.coolant = CoolantState::default();
            self.say(0, StepKind::Coolant(CoolantState::default()));
        }
    }

    fn tool_for(&mut self, operation: &Operation) -> Result<(), Fault> {
        let program = self.program;
        match program.tool_of(operation.id) {
            Some(tool) => self.change_tool(operation.id, tool),
            None if operation.kind == "MACHINING_RAPID_MOVEMENT" => Ok(()),
            None if self.run.tool.is_some_and(|tool| tool != ToolNumber(0)) => {
                let message = format!("operation '{}' names no tool: the one in the spindle is used", operation.name);
                let fault = Fault::new(operation.id, "no-tool", message, "add the operation to the users of its tool");
                program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
                Ok(())
            }
            None if self.options.tables.missing == Missing::Assume => {
                let message = format!(
                    "operation '{}' has no tool and none was loaded: one of no length is assumed",
                    operation.name
                );
                let remedy = "add the operation to the users of a MACHINING_TOOL, or load a tool before";
                program.note(
                    &mut self.run.diagnostics,
                    Severity::Warning,
                    &Fault::new(operation.id, "no-tool", message, remedy),
                );
                Ok(())
            }
            None => Err(Fault::new(
                operation.id,
                "no-tool",
                format!("operation '{}' has no tool", operation.name),
                "add the operation to the users of a MACHINING_TOOL, or load a tool before",
            )),
        }
    }

    fn change_tool(&mut self, entity: u64, tool: &Tool) -> Result<(), Fault> {
        let program = self.program;
        let number = tool.number.ok_or_else(|| {
            Fault::new(
                tool.id,
                "tool-number",
                format!("tool '{}' ({}) has no number", tool.name, tool.kind),
                "give the number in its identifier or as its tool position",
            )
        })?;
        if self.run.tool == Some(number) {
            return Ok(());
        }
        let offset = self.offset_of(tool.id, number, &tool.kind)?;
        self.rest();
        self.run.tool = Some(number);
        self.run.offset = offset;
        self.run.own_offset = offset;
        self.say(
            entity,
            StepKind::Tool(ToolCall {
                number,
                name: tool.kind.clone(),
                diameter: tool.diameter,
            }),
        );
        self.say(entity, StepKind::ToolOffset(offset));
        Ok(())
    }

    /// The offset that the machine's table has under a number.
    fn offset_of(&mut self, entity: u64, number: ToolNumber, kind: &str) -> Result<ToolOffset, Fault> {
        let program = self.program;
        let entry = self.options.tables.tools.get(&number);
        let offset = match (entry, self.options.tables.missing) {
            (Some(entry), _) => ToolOffset {
                number: number.0,
                geometry: entry.geometry.0,
                wear: entry.wear.0,
                assumed: false,
            },
            (None, Missing::Assume) => {
                let message = format!("tool {number} is not in the tool table: its length is assumed to be 0");
                let fault = Fault::new(entity, "tool-table", message, "enter the tool with its length");
                program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
                ToolOffset {
                    number: number.0,
                    assumed: true,
                    ..ToolOffset::NONE
                }
            }
            (None, Missing::Fail) => {
                let message = format!("tool {number} ({kind}) is not in the tool table");
                return Err(Fault::new(entity, "tool-table", message, "enter the tool with its length"));
            }
        };
        Ok(offset)
    }

    /// The tool offset of a path: its tool's, or the one that it asks for.
    fn offset_for(&mut self, entity: u64, condition: Option<&String>) -> Result<ToolOffset, Fault> {
        match condition.map(|mode| (mode.as_str(), mode.parse::<u32>())) {
            None => Ok(self.run.own_offset),
            Some(("off", _)) => Ok(ToolOffset::NONE),
            Some((_, Ok(number))) => self.offset_of(entity, ToolNumber(number), "tool offset"),
            Some((mode, Err(_))) => Err(Fault::new(
                entity,
                "tool-offset",
                format!("'{mode}' is no tool offset"),
                "write 'off' or the offset's number",
            )),
        }
    }

    /// The frame of the paths at this place of the tree, with its name and whether its origin was assumed.
    ///
    /// The remark about it, if any, is for when the frame is said.
    fn frame(&self) -> Result<(FrameChange, Option<(Severity, Fault)>), Fault> {
        let program = self.program;
        let around: Vec<&Executable> = self.run.scopes.iter().filter_map(|&id| program.executable(id)).collect();
        let setup = around.iter().rev().find_map(|executable| executable.setup.as_ref());
        let name = setup.map(|setup| setup.name.clone()).unwrap_or_default();
        let table = self.options.tables.work_offsets.get(&name).copied();
        let in_file = setup.and_then(|setup| setup.machine_from_setup);
        let entity = setup.map(|setup| setup.id).or(self.run.scopes.first().copied()).unwrap_or(0);
        let remark = |message: String, remedy| Fault::new(entity, "setup-origin", message, remedy);
        let (no_origin, no_origin_remedy) = match setup {
            Some(_) => (
                format!("the set-up '{name}' has no origin"),
                "enter a work offset of this name",
            ),
            None => (
                "the program has no set-up that says where its paths lie in the machine".to_string(),
                "give its workplan a set-up with an origin",
            ),
        };
        let (origin, found) = match (table, in_file, self.options.tables.missing) {
            (Some(table), Some(in_file), _) if table != in_file => {
                let message = format!("the work offset '{name}' of the machine is used, not the set-up's origin in the file");
                (table, Some((Severity::Remark, remark(message, ""))))
            }
            (Some(table), _, _) => (table, None),
            (None, Some(in_file), _) => (in_file, None),
            // A part without a place is assumed to be clamped where G54 says, as a machinist would; without one, at home.
            (None, None, Missing::Assume) => {
                let clamped = self.options.tables.work_offsets.get("G54").copied();
                let assumed = if clamped.is_some() {
                    "G54 of the machine"
                } else {
                    "the machine's origin"
                };
                let fault = remark(format!("{no_origin}: {assumed} is assumed"), no_origin_remedy);
                (clamped.unwrap_or(Transform::IDENTITY), Some((Severity::Warning, fault)))
            }
            (None, None, Missing::Fail) => {
                return Err(remark(
                    format!("the set-up '{name}' has no origin"),
                    "enter a work offset of this name",
                ));
            }
        };
        let placement = setup.and_then(|setup| setup.setup_from_part);
        let orientations = around.iter().filter_map(|executable| executable.orientation.as_ref());
        let change = FrameChange {
            name,
            machine_from_setup: machine_from_path(origin, placement, orientations, self.options.path_frame),
            assumed: table.is_none() && in_file.is_none(),
        };
        Ok((change, found))
    }

    /// Says everything that must be in force for a toolpath, the link to its start, and its beginning.
    fn open(&mut self, operation: &Operation, toolpath: Toolpath) -> Result<(), Fault> {
        let program = self.program;
        let id = toolpath.id;
        if let Some(fault) = toolpath.faults.first() {
            return Err(fault.clone());
        }
        let refuse = |code, message: String, remedy| Err(Fault::new(id, code, message, remedy));
        if toolpath.kind != ToolpathKind::Dwell {
            if toolpath.description == "cutter contact trajectory" {
                return refuse(
                    "cutter-contact",
                    format!("toolpath '{}' gives contact points and not the tool tip", toolpath.name),
                    "export cutter location trajectories",
                );
            }
            if toolpath.description == "axis trajectory" {
                return refuse(
                    "axis-trajectory",
                    format!("toolpath '{}' moves single axes, which is not supported yet", toolpath.name),
                    "export cutter location trajectories",
                );
            }
            if toolpath.tilted {
                return refuse(
                    "tool-axis",
                    format!(
                        "toolpath '{}' tilts the tool, which this three-axis stream cannot",
                        toolpath.name
                    ),
                    "export the path with the tool axis along Z",
                );
            }
        }
        let technology = toolpath
            .technology
            .or(operation.technology)
            .and_then(|id| program.technology(id));
        let tool = program.tool_of(operation.id);
        let (frame, found) = self.frame()?;
        if self.run.frame != Some(frame.machine_from_setup) {
            if let Some((severity, fault)) = found {
                program.note(&mut self.run.diagnostics, severity, &fault);
            }
            self.run.frame = Some(frame.machine_from_setup);
            self.say(id, StepKind::Frame(frame.clone()));
        }
        if let Some(technology) = technology {
            if let Some(fault) = technology.faults.first() {
                return Err(fault.clone());
            }
            if let Some(spindle) = technology.spindle {
                let spindle = spindle_state(id, spindle, tool, operation)?;
                if spindle != self.run.spindle {
                    self.run.spindle = spindle;
                    self.say(id, StepKind::Spindle(spindle));
                }
            }
        }
        let functions = toolpath
            .functions
            .or(operation.functions)
            .and_then(|id| program.functions(id));
        if let Some(functions) = functions
            && functions.coolant != self.run.coolant
        {
            self.run.coolant = functions.coolant;
            self.say(id, StepKind::Coolant(functions.coolant));
        }
        let condition = |name: &str| functions.and_then(|functions| functions.others.get(name));
        let offset = self.offset_for(id, condition(write::TOOL_OFFSET))?;
        if offset != self.run.offset {
            self.run.offset = offset;
            self.say(id, StepKind::ToolOffset(offset));
        }
        // Half of what the path allows is the planner's to round corners with, the other half is left to the servo.
        let path_mode = match condition(write::EXACT_STOP).map(String::as_str) {
            Some("on") => PathMode::ExactStop,
            _ => PathMode::Tolerance(toolpath.maximum_deviation.map(|most| most * 0.5)),
        };
        if path_mode != self.run.path_mode && toolpath.kind != ToolpathKind::Dwell {
            self.run.path_mode = path_mode;
            self.say(id, StepKind::PathMode(path_mode));
        }
        let mut properties = functions.map(|functions| functions.others.clone()).unwrap_or_default();
        properties.retain(|name, _| name != write::TOOL_OFFSET && name != write::EXACT_STOP);
        let others = (!properties.is_empty()).then(|| {
            StepKind::NcFunction(RawNcFunction {
                kind: "other functions".into(),
                name: toolpath.name.clone(),
                text: String::new(),
                properties,
            })
        });
        if toolpath.kind == ToolpathKind::Dwell {
            let time = match toolpath.dwell {
                Some(Dwell::Time(time)) => time,
                Some(Dwell::Revolutions(turns)) => {
                    let speed = self.run.spindle.revolutions(Millimetres::ZERO);
                    if speed.0 <= 0.0 {
                        return refuse(
                            "dwell",
                            "a dwell counts revolutions and the spindle stands".into(),
                            "give the dwell as a time",
                        );
                    }
                    Seconds(turns / speed.0 * 60.0)
                }
                None => {
                    return refuse(
                        "dwell",
                        format!("feedstop '{}' has no dwell time", toolpath.name),
                        "give it one",
                    );
                }
            };
            self.begin(Level::Toolpath, id, &toolpath.name, None);
            self.run.queue.extend(others.map(|kind| (entity_origin(id), kind)));
            self.say(id, StepKind::Dwell(time));
            self.say(id, StepKind::End(Level::Toolpath));
            return Ok(());
        }
        let speed = match toolpath.kind {
            ToolpathKind::Rapid => Speed::Rapid,
            _ => Speed::Feed(feed(id, &toolpath, technology.and_then(|technology| technology.feed), tool)?),
        };
        let profile = match &toolpath.profile {
            None => None,
            Some(profile) => {
                let mut length = 0.0;
                for piece in program.pieces(&toolpath)? {
                    length += piece.map_err(|fault| placed(fault, id))?.length();
                }
                Some((profile.clone(), length))
            }
        };
        let mut pieces = program.pieces(&toolpath)?;
        let mut first = pieces.next().transpose().map_err(|fault| placed(fault, id))?;
        if let Some(first) = &mut first {
            // A mill lifts the tool off along Z, a lathe along X.
            let retract_axis = if operation.kind.contains("TURNING") { 0 } else { 2 };
            self.link(id, frame.machine_from_setup, first, speed, retract_axis);
        }
        self.begin(Level::Toolpath, id, &toolpath.name, toolpath.maximum_deviation);
        self.run.queue.extend(others.map(|kind| (entity_origin(id), kind)));
        let mut open = OpenPath {
            pieces: pieces.into_state(),
            speed,
            profile,
            travelled: 0.0,
            toolpath,
        };
        if let Some(first) = first {
            self.go(&mut open, first);
        }
        self.run.tasks.push(Task::Path(Box::new(open)));
        Ok(())
    }

    /// Moves from where the tip is to where a path begins: rapid, out along the retract axis to the farther of the two, across, in.
    ///
    /// A gap within the rounding of the file is no link: a line begins where the tip is, any other piece is reached at its own speed.
    fn link(
        &mut self,
        id: u64,
        machine_from_setup: Transform<Machine, Setup>,
        first: &mut Path<Setup>,
        speed: Speed,
        retract_axis: usize,
    ) {
        let tip = machine_from_setup.inverse() * (self.run.gauge - self.run.offset.total());
        let start = first.start();
        let gap = tip.distance(start);
        if gap <= 1e-6 {
            return;
        }
        if gap <= ROUNDING
            && let Path::Line { from, .. } = first
        {
            *from = tip;
            return;
        }
        let clear = tip.xyz[retract_axis].max(start.xyz[retract_axis]);
        let above = |place: Point<Setup>| {
            let mut place = place;
            place.xyz[retract_axis] = clear;
            place
        };
        let (speed, corners) = match gap <= ROUNDING {
            true => (speed, [tip, tip, start]),
            false => (Speed::Rapid, [above(tip), above(start), start]),
        };
        let mut from = tip;
        for to in corners {
            if from.distance(to) > 1e-9 {
                self.say(
                    id,
                    StepKind::Move(Move {
                        path: Path::Line { from, to },
                        speed,
                        profile: None,
                        derived: true,
                    }),
                );
                from = to;
            }
        }
        self.run.gauge = machine_from_setup * start + self.run.offset.total();
    }

    fn travel(&mut self, mut open: OpenPath) -> Result<(), Fault> {
        let id = open.toolpath.id;
        let mut pieces = Pieces::resume(self.program.aim(), open.pieces);
        let piece = pieces.next();
        open.pieces = pieces.into_state();
        match piece {
            None => self.say(id, StepKind::End(Level::Toolpath)),
            Some(Err(fault)) => return Err(placed(fault, id)),
            Some(Ok(piece)) => {
                self.go(&mut open, piece);
                self.run.tasks.push(Task::Path(Box::new(open)));
            }
        }
        Ok(())
    }

    fn go(&mut self, open: &mut OpenPath, path: Path<Setup>) {
        let profile = open.profile.as_ref().map(|(profile, total)| {
            let length = path.length();
            let from = if *total > 0.0 { open.travelled / total } else { 0.0 };
            open.travelled += length;
            let to = if *total > 0.0 { open.travelled / total } else { 1.0 };
            part_of(profile, from, to)
        });
        if let Some(frame) = self.run.frame {
            self.run.gauge = frame * path.end() + self.run.offset.total();
        }
        self.say(
            open.toolpath.id,
            StepKind::Move(Move {
                path,
                speed: open.speed,
                profile,
                derived: false,
            }),
        );
    }
}

/// Gaps between paths up to this come from rounded coordinates (four decimals in inches), mm.
const ROUNDING: f64 = 0.0026;

const EXPRESSION_REMEDY: &str = "use comparisons and arithmetic over numbers and named variables";

fn entity_origin(id: u64) -> Origin {
    Origin {
        file: FileId(0),
        place: Place::Entity(id),
    }
}

fn placed(mut fault: Fault, toolpath: u64) -> Fault {
    if fault.entity == 0 {
        fault.entity = toolpath;
    }
    fault
}

/// The one place where frames are put together; see the module's text.
fn machine_from_path<'o>(
    machine_from_setup: Transform<Machine, Setup>,
    setup_from_part: Option<Transform<Setup, units::Part>>,
    orientations: impl Iterator<Item = &'o Transform<Setup, Setup>>,
    reading: PathFrame,
) -> Transform<Machine, Setup> {
    let mut frame = machine_from_setup;
    if let (PathFrame::Workpiece, Some(placement)) = (reading, setup_from_part) {
        let mut moved: Transform<Setup, Setup> = Transform::IDENTITY;
        (moved.rotation, moved.origin) = (placement.rotation, placement.origin);
        frame = frame * moved;
    }
    orientations.fold(frame, |frame, orientation| frame * *orientation)
}

fn spindle_state(path: u64, setting: SpindleSetting, tool: Option<&Tool>, operation: &Operation) -> Result<SpindleState, Fault> {
    let turning = |clockwise: bool, mode: SpindleMode| match clockwise {
        true => SpindleState::Clockwise(mode),
        false => SpindleState::Counterclockwise(mode),
    };
    match setting {
        SpindleSetting::Stopped => Ok(SpindleState::Stopped),
        SpindleSetting::Revolutions { speed, clockwise } => Ok(turning(clockwise, SpindleMode::Revolutions(speed))),
        SpindleSetting::Surface { speed, limit, clockwise } if operation.kind.contains("TURNING") => {
            let limit = limit.ok_or_else(|| {
                Fault::new(
                    path,
                    "surface-speed",
                    "a surface speed has no maximum rotational speed: it would be endless in the centre",
                    "give the technology a maximum rotational speed",
                )
            })?;
            Ok(turning(clockwise, SpindleMode::Surface { speed, limit }))
        }
        SpindleSetting::Surface { speed, limit, clockwise } => {
            // Milling: the edge turns with the tool, so its diameter makes revolutions of it.
            let diameter = tool
                .and_then(|tool| tool.diameter)
                .filter(|diameter| diameter.0 > 0.0)
                .ok_or_else(|| {
                    Fault::new(
                        path,
                        "surface-speed",
                        "a cutting speed needs the cutting diameter of the tool, which is not in the file",
                        "give the tool its effective cutting diameter, or the spindle speed in revolutions",
                    )
                })?;
            let revolutions = Rpm(speed.0 / (std::f64::consts::PI * diameter.0) * 60.0);
            let revolutions = limit.map_or(revolutions, |limit| revolutions.min(limit));
            Ok(turning(clockwise, SpindleMode::Revolutions(revolutions)))
        }
    }
}

fn feed(path: u64, toolpath: &Toolpath, feed: Option<FeedSetting>, tool: Option<&Tool>) -> Result<Feed, Fault> {
    let feed = match feed {
        Some(FeedSetting::PerTime(speed)) => Feed::PerTime(speed),
        Some(FeedSetting::PerRevolution(length)) => Feed::PerRevolution(length),
        Some(FeedSetting::PerTooth(length)) => {
            let teeth = tool.and_then(|tool| tool.teeth).ok_or_else(|| {
                Fault::new(
                    path,
                    "feed-per-tooth",
                    "a feed per tooth needs the number of teeth of the tool, which is not in the file",
                    "give the tool its number of effective teeth",
                )
            })?;
            Feed::PerRevolution(length * teeth)
        }
        None => {
            return Err(Fault::new(
                path,
                "no-feed",
                format!("toolpath '{}' cuts and its technology has no feed", toolpath.name),
                "give the technology of the path or of its operation a feed, or mark the path as rapid",
            ));
        }
    };
    let size = match feed {
        Feed::PerTime(speed) => speed.0,
        Feed::PerRevolution(length) | Feed::Thread(plan::Thread { advance: length, .. }) => length.0,
        Feed::WholeMove(time) => time.0,
    };
    if size <= 0.0 {
        return Err(Fault::new(
            path,
            "no-feed",
            format!("toolpath '{}' cuts with a feed of 0", toolpath.name),
            "give its technology a feed, or mark the path as rapid",
        ));
    }
    Ok(feed)
}

/// The part of a profile between two fractions of the whole path, spread over 0 to 1.
fn part_of(profile: &SpeedProfile, from: f64, to: f64) -> SpeedProfile {
    let width = to - from;
    let mut points = vec![(0.0, profile.factor(from))];
    if width > 0.0 {
        let inside = profile.points.iter().filter(|point| point.0 > from && point.0 < to);
        points.extend(inside.map(|point| ((point.0 - from) / width, point.1)));
    }
    points.push((1.0, profile.factor(to)));
    SpeedProfile { points }
}

/// The expression with the variables that the program itself has given values.
fn substitute(expression: &Expression, variables: &BTreeMap<String, f64>) -> Expression {
    let inside = |inner: &Expression| Box::new(substitute(inner, variables));
    match expression {
        Expression::Name(name) => match variables.get(name) {
            Some(&number) => Expression::Number(number, None),
            None => expression.clone(),
        },
        Expression::Not(inner) => Expression::Not(inside(inner)),
        Expression::Negate(inner) => Expression::Negate(inside(inner)),
        Expression::Binary(operator, left, right) => Expression::Binary(*operator, inside(left), inside(right)),
        Expression::Number(..) | Expression::Truth(_) => expression.clone(),
    }
}

/// The value of a condition that needs nothing from the machine.
fn truth(expression: &Expression) -> Option<bool> {
    match expression.evaluate(&|_| None) {
        Ok(plan::Value::Truth(truth)) => Some(truth),
        _ => None,
    }
}

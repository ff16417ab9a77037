//! New STEP-NC files: [`convert`] runs a program of any kind and writes what it does as AP238 edition 3.
//!
//! What a [`plan::ProgramStream`] says becomes one project with one workplan; each tool of the program, and each operation that it names,
//! becomes a workingstep with one operation; what is cut with the same feed, spindle and coolant becomes one toolpath. Lines are
//! polylines, arcs stay arcs. A work offset is a set-up of its name, with its origin; several of them are nested workplans; a shift of an
//! offset (G52, G92) is the toolpath orientation of the workingsteps in it. Stops, messages and functions stand between workingsteps,
//! and cut them in two where a program has them in the middle.
//!
//! **What planning needs and the standard does not name** is said as `other functions` of the path ([`EXACT_STOP`], [`TOOL_OFFSET`]),
//! its own way for conditions that it does not list; [`crate::StepNcStream`] understands them. So a plan of the new file is the plan of
//! the program it was made from.
//!
//! **What is not written**: what a program writes into registers of the machine, and feeds of rapid moves. What cannot be written is told in
//! [`Written::notices`].

mod curve;
mod expression;
mod path;
mod sheet;
mod tools;
mod workplans;

use crate::function_form::FunctionForm;
use part21::text::encode;
use plan::{
    Alarm, Answer, CoolantState, Feed, FrameChange, Level, MachineMove, Move, Next, Path, PathMode, ProgramStream, Question,
    RawNcFunction, Speed, SpindleMode, SpindleState, StepKind, StopKind, Tables, ToolCall, ToolOffset,
};
use sheet::{Sheet, SpeedUnit};
use std::collections::{BTreeMap, BTreeSet};
use tools::UsedTool;
use units::{Machine, Millimetres, Point, Seconds, Setup, Timestamp, ToolNumber, Transform};

/// Name of the `other functions` item of a path whose moves each end at rest; its mode is `on`.
pub const EXACT_STOP: &str = "exact stop";
/// Name of the `other functions` item of a path that runs with another tool offset than its tool's own: `off`, or the offset's number.
pub const TOOL_OFFSET: &str = "tool offset";

/// What the writer cannot know from the program.
#[derive(Clone, Debug)]
pub struct WriteOptions {
    /// Name of the project and the file.
    pub name: String,
    /// What it was made from, for the header's description.
    pub made_from: String,
    /// The time stamp of the header.
    pub written: Timestamp,
    /// Who stands behind it, for the header.
    pub author: String,
    /// The program that writes.
    pub writer: String,
    /// Write lengths in inches.
    pub inches: bool,
    /// The program turns.
    pub turning: bool,
    /// The machine whose offsets the program is read with.
    pub tables: Tables,
    /// How functions of the program stand in it.
    pub functions: FunctionForm,
}

/// A new file.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// How many workingsteps it has.
    pub workingsteps: u32,
    /// How many toolpaths, dwells included.
    pub toolpaths: u32,
    /// Tools in use.
    pub tools: u32,
    /// What the program says and the file does not.
    pub notices: Vec<String>,
}

/// Why a program cannot be written as STEP-NC.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// It cannot be run to its end.
    #[error("{0}")]
    Alarm(Box<Alarm>),
    /// It moves nothing.
    #[error("the program moves nothing: a workplan needs at least one workingstep or function")]
    Empty,
    /// A coordinate is infinite or not a number.
    #[error("a move of '{0}' has a coordinate that is not a finite number")]
    NotFinite(String),
}

/// Runs a program to its end and writes it as a new file. `answer` speaks for the machine; optional stops become functions and are not
/// asked for.
///
/// # Errors
/// When the program alarms, or does nothing that could be written.
pub fn convert(
    stream: &mut dyn ProgramStream,
    options: &WriteOptions,
    answer: &mut dyn FnMut(&Question) -> Answer,
) -> Result<Written, ConvertError> {
    let mut writer = Writer::new(options);
    let mut reply = None;
    loop {
        match stream.next(reply.take()) {
            Next::Step(step) => writer.take(step.kind)?,
            Next::Ask(Question::OptionalStop) => {
                writer.function("optional stop", "optional stop", &BTreeMap::new());
                reply = Some(Answer::Truth(false));
            }
            Next::Ask(question) => {
                writer
                    .notices
                    .insert("the program asks the machine on its way; the file holds what it does without an answer".to_string());
                reply = Some(answer(&question));
            }
            Next::End => break,
            Next::Alarm(alarm) => return Err(ConvertError::Alarm(Box::new(alarm))),
        }
    }
    writer.finish()
}

/// Feed and spindle of a path; numbers by their bits, so that equal ones are one instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Technology {
    /// `None` on a rapid path: the feed of its neighbours is written, which the standard asks for and nobody uses.
    feed: Option<FeedKey>,
    spindle: SpindleKey,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct FeedKey {
    per_revolution: bool,
    synchronized: bool,
    /// mm/s, or mm for each revolution.
    value: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum SpindleKey {
    Stopped,
    /// Rev/min; clockwise is negative, as the standard has it.
    Revolutions(u64),
    /// mm/s with the same sign, and the limit in rev/min.
    Surface(u64, u64),
}

/// Coolant and conditions of a path.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Functions {
    outlets: [bool; 3],
    oriented: bool,
    others: Vec<(&'static str, String)>,
}

/// What two moves must have in common to be one toolpath.
#[derive(Clone, Debug, PartialEq)]
struct PathKey {
    rapid: bool,
    technology: Technology,
    functions: Functions,
    maximum_deviation: Option<f64>,
}

struct OpenPath {
    key: PathKey,
    pieces: Vec<Path<Setup>>,
}

/// A workingstep that is being filled.
struct OpenStep {
    name: String,
    tool: Option<usize>,
    base: usize,
    orientation: Option<Transform<Setup, Setup>>,
    /// Identifier, technology and functions of each path.
    paths: Vec<(u64, Technology, Functions)>,
    feeds: u32,
    /// All feed moves so far went straight along the tool.
    drills: bool,
    rapids: u32,
    dwells: u32,
}

/// A work offset as a set-up.
struct Base {
    name: String,
    machine_from_setup: Transform<Machine, Setup>,
    assumed: bool,
    /// Highest place of a rapid move: nothing is in the way there.
    highest: f64,
}

struct Writer<'o> {
    options: &'o WriteOptions,
    sheet: Sheet,
    feature: u64,
    workpiece: u64,
    workpiece_shape: u64,
    workpiece_origin: u64,
    // Where the machine is and what is in force.
    gauge: Point<Machine>,
    frame: Option<FrameChange>,
    offset: ToolOffset,
    tool: Option<usize>,
    /// The tool in the spindle has been used, or its loading has been written.
    tool_told: bool,
    spindle: SpindleState,
    coolant: CoolantState,
    path_mode: PathMode,
    // What is open.
    title: String,
    titles: BTreeMap<String, u32>,
    path: Option<OpenPath>,
    step: Option<OpenStep>,
    /// Technology and functions of the path before, to see what a stop leaves running.
    last: Option<(Technology, Functions)>,
    // What is done.
    bases: Vec<Base>,
    children: Vec<(usize, u64)>,
    tools: Vec<UsedTool>,
    technology_links: Vec<(u64, Technology)>,
    functions: BTreeMap<Functions, u64>,
    workingsteps: u32,
    toolpaths: u32,
    notices: BTreeSet<String>,
    /// Registers that the program writes.
    registers: BTreeSet<String>,
}

impl<'o> Writer<'o> {
    fn new(options: &'o WriteOptions) -> Self {
        let mut sheet = Sheet::new(options.inches);
        let name = encode(&options.name);
        let (product_context, definition_context, context) = (sheet.product_context, sheet.definition_context, sheet.context);
        let product = sheet.add(format!("PRODUCT({name},{name},$,(#{product_context}))"));
        let formation = sheet.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{product})"));
        let workpiece = sheet.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"));
        let shape = sheet.add(format!("PRODUCT_DEFINITION_SHAPE('','',#{workpiece})"));
        let workpiece_origin = sheet.frame("origin", &Transform::<Setup, Setup>::IDENTITY);
        let workpiece_shape = sheet.add(format!("SHAPE_REPRESENTATION('',(#{workpiece_origin}),#{context})"));
        sheet.add(format!("SHAPE_DEFINITION_REPRESENTATION(#{shape},#{workpiece_shape})"));
        // Nothing is known of the part's features: all workingsteps are on one that stands for the toolpaths.
        let instance = sheet.add(format!(
            "INSTANCED_FEATURE('toolpath feature','toolpath','','toolpath',#{shape},.T.)"
        ));
        let feature = sheet.add("MACHINING_FEATURE_PROCESS('','machining','','')");
        let process = sheet.add(format!("PROPERTY_PROCESS('machining','machining',#{feature},'')"));
        sheet.add(format!("PROCESS_PROPERTY_ASSOCIATION('','machining',#{process},#{instance})"));
        Writer {
            options,
            sheet,
            feature,
            workpiece,
            workpiece_shape,
            workpiece_origin,
            gauge: options.tables.position,
            frame: None,
            offset: ToolOffset::NONE,
            tool: None,
            tool_told: true,
            spindle: SpindleState::Stopped,
            coolant: CoolantState::default(),
            path_mode: PathMode::Tolerance(None),
            title: options.name.clone(),
            titles: BTreeMap::new(),
            path: None,
            step: None,
            last: None,
            bases: Vec::new(),
            children: Vec::new(),
            tools: Vec::new(),
            technology_links: Vec::new(),
            functions: BTreeMap::new(),
            workingsteps: 0,
            toolpaths: 0,
            notices: BTreeSet::new(),
            registers: BTreeSet::new(),
        }
    }

    fn take(&mut self, kind: StepKind) -> Result<(), ConvertError> {
        match kind {
            StepKind::Move(go) => return self.go(go),
            StepKind::MachineMove(MachineMove { to }) => return self.machine_move(to),
            StepKind::Dwell(time) => self.dwell(time),
            StepKind::Tool(call) => self.change_tool(&call),
            StepKind::ToolOffset(offset) => self.offset = offset,
            StepKind::Spindle(spindle) => self.spindle = spindle,
            StepKind::Coolant(coolant) => self.coolant = coolant,
            StepKind::Frame(frame) => {
                self.close_path();
                self.frame = Some(frame);
            }
            StepKind::PathMode(mode) => self.path_mode = mode,
            StepKind::Begin(marker) => match marker.level {
                Level::Workingstep => {
                    self.close_step();
                    self.title = marker.name;
                }
                Level::Operation if !marker.name.is_empty() => {
                    self.close_step();
                    self.title = marker.name;
                }
                Level::Toolpath => self.close_path(),
                _ => {}
            },
            StepKind::End(Level::Workingstep) => self.close_step(),
            StepKind::End(_) => {}
            StepKind::Message(text) => {
                let text = BTreeMap::from([("message text", text)]);
                self.function("message", "display message", &text);
            }
            StepKind::Stop(StopKind::Program) => {
                self.function("program stop", "program stop", &BTreeMap::new());
            }
            StepKind::Stop(StopKind::Optional) => {
                self.function("optional stop", "optional stop", &BTreeMap::new());
            }
            StepKind::Register(change) => {
                self.registers.insert(change.register.name());
            }
            StepKind::NcFunction(RawNcFunction {
                kind,
                name,
                text,
                condition,
                ..
            }) => {
                let name = if name.is_empty() { kind } else { name };
                let form = self.options.functions;
                let id = self.function(&name, form.kind(), &BTreeMap::from([(form.property(), text)]));
                match condition {
                    Some(Ok(condition)) => {
                        let representation = self.sheet.condition(&condition);
                        self.sheet.property(id, "condition", representation);
                    }
                    Some(Err(why)) => {
                        self.notices.insert(format!(
                            "the typed condition of '{name}' cannot be read and is left out: {why}"
                        ));
                    }
                    None => {}
                }
            }
        }
        Ok(())
    }

    // ---- moves

    fn machine_from_setup(&self) -> Transform<Machine, Setup> {
        self.frame
            .as_ref()
            .map_or(Transform::IDENTITY, |frame| frame.machine_from_setup)
    }

    fn tip(&self) -> Point<Setup> {
        self.machine_from_setup().inverse() * (self.gauge - self.offset.total())
    }

    fn change_tool(&mut self, call: &ToolCall) {
        self.close_step();
        self.tell_tool();
        if call.number == ToolNumber(0) {
            self.tool = None;
            self.tool_told = true;
            self.function("unload tool", "unload tool", &BTreeMap::new());
            return;
        }
        let known = self.tools.iter().position(|tool| tool.number == call.number);
        self.tool = Some(known.unwrap_or_else(|| {
            self.tools.push(UsedTool::new(call));
            self.tools.len() - 1
        }));
        self.tool_told = false;
        self.last = None;
    }

    /// A tool that was called and not used is loaded by a function.
    fn tell_tool(&mut self) {
        if self.tool_told {
            return;
        }
        self.tool_told = true;
        if let Some(tool) = self.tool {
            let name = format!("load tool {}", self.tools[tool].number.0);
            let id = self.sheet.add(format!("MACHINING_NC_FUNCTION('{name}','load tool','','')"));
            self.tools[tool].users.push(id);
            let base = self.base();
            self.children.push((base, id));
        }
    }

    fn function(&mut self, name: &str, kind: &str, properties: &BTreeMap<&str, String>) -> u64 {
        self.close_path();
        // What stands still at a stop has to be told before it.
        let now = (self.technology(None), self.conditions(false));
        let changed = self.last.as_ref().is_some_and(|(technology, functions)| {
            technology.spindle != now.0.spindle || functions.outlets != now.1.outlets || functions.oriented != now.1.oriented
        });
        if changed && kind != "unload tool" {
            self.dwell(Seconds::ZERO);
        }
        self.close_step();
        self.tell_tool();
        let id = self
            .sheet
            .add(format!("MACHINING_NC_FUNCTION({},'{kind}','','')", encode(name)));
        for (name, text) in properties {
            let representation = self.sheet.says(text);
            self.sheet.property(id, name, representation);
        }
        let base = self.base();
        self.children.push((base, id));
        id
    }

    /// The set-up in force, and by how much the frame is shifted in it.
    fn base(&mut self) -> usize {
        let frame = self.frame.clone().unwrap_or(FrameChange {
            name: String::new(),
            machine_from_setup: Transform::IDENTITY,
            assumed: true,
        });
        // A shifted offset is told as `G54 G52`.
        let name = SHIFTS
            .iter()
            .fold(frame.name.as_str(), |name, shift| name.strip_suffix(shift).unwrap_or(name));
        if let Some(known) = self.bases.iter().position(|base| base.name == name) {
            return known;
        }
        let table = self.options.tables.work_offsets.get(name);
        self.bases.push(Base {
            machine_from_setup: table.copied().unwrap_or(frame.machine_from_setup),
            name: name.to_string(),
            assumed: frame.assumed,
            highest: f64::NEG_INFINITY,
        });
        self.bases.len() - 1
    }

    fn open_step(&mut self) {
        let base = self.base();
        let shift = self.bases[base].machine_from_setup.inverse();
        let mut orientation: Transform<Setup, Setup> = Transform::IDENTITY;
        let found: Transform<Setup, Setup> = shift * self.machine_from_setup();
        (orientation.rotation, orientation.origin) = (found.rotation, found.origin.map(|c| libm::round(c * 1e10) / 1e10));
        let orientation = (orientation != Transform::IDENTITY).then_some(orientation);
        if let Some(step) = &self.step
            && (step.base, step.orientation) == (base, orientation)
        {
            return;
        }
        self.close_step();
        let times = self.titles.entry(self.title.clone()).or_insert(0);
        *times += 1;
        let name = match *times {
            1 => self.title.clone(),
            n => format!("{} ({n})", self.title),
        };
        self.tool_told = true;
        self.step = Some(OpenStep {
            name,
            tool: self.tool,
            base,
            orientation,
            paths: Vec::new(),
            feeds: 0,
            drills: !self.options.turning,
            rapids: 0,
            dwells: 0,
        });
    }

    fn close_step(&mut self) {
        self.close_path();
        let Some(step) = self.step.take() else { return };
        if step.paths.is_empty() {
            return;
        }
        self.workingsteps += 1;
        let name = encode(&step.name);
        let kind = match (step.feeds, self.options.turning) {
            (0, _) => "MACHINING_RAPID_MOVEMENT",
            (_, true) => "CONTOURING_TURNING_OPERATION",
            _ if step.drills => "DRILLING_OPERATION",
            _ => "FREEFORM_MILLING_OPERATION",
        };
        let variant = match kind {
            "MACHINING_RAPID_MOVEMENT" => "",
            "DRILLING_OPERATION" => "drilling",
            _ => "finishing",
        };
        let operation = self.sheet.add(format!("{kind}({name},'{variant}','','')"));
        for (n, (path, ..)) in step.paths.iter().enumerate() {
            self.sheet.add(format!(
                "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{operation},#{path},{}.)",
                n + 1
            ));
        }
        if let Some(tool) = step.tool {
            self.tools[tool].users.push(operation);
        }
        // The operation has what its first cut has; other paths say what is different.
        let first_cut = step.paths.iter().find(|(_, technology, _)| technology.feed.is_some());
        let (_, technology, functions) = first_cut.unwrap_or(&step.paths[0]).clone();
        let functions_id = self.functions_of(&functions);
        self.sheet.add(format!(
            "MACHINING_FUNCTIONS_RELATIONSHIP('','',#{operation},#{functions_id})"
        ));
        self.technology_links.push((operation, technology));
        for (path, own_technology, own_functions) in step.paths {
            if own_technology != technology {
                self.technology_links.push((path, own_technology));
            }
            if own_functions != functions {
                let id = self.functions_of(&own_functions);
                self.sheet
                    .add(format!("MACHINING_FUNCTIONS_RELATIONSHIP('','',#{path},#{id})"));
            }
        }
        let id = self.sheet.add(format!("MACHINING_WORKINGSTEP({name},'machining','','')"));
        self.sheet
            .add(format!("MACHINING_OPERATION_RELATIONSHIP('','machining',#{id},#{operation})"));
        let feature = self.feature;
        self.sheet
            .add(format!("MACHINING_FEATURE_RELATIONSHIP('','machining',#{id},#{feature})"));
        if let Some(orientation) = step.orientation {
            let placement = self.sheet.frame("", &orientation);
            let context = self.sheet.context;
            let representation = self.sheet.add(format!("REPRESENTATION('',(#{placement}),#{context})"));
            self.sheet.property(id, "toolpath orientation", representation);
        }
        self.children.push((step.base, id));
    }

    fn functions_of(&mut self, functions: &Functions) -> u64 {
        if let Some(&id) = self.functions.get(functions) {
            return id;
        }
        let turning = self.options.turning;
        let [flood, mist, through] = functions.outlets;
        let sheet = &mut self.sheet;
        let id = sheet.add(format!(
            "MACHINING_FUNCTIONS('','{}','','')",
            if turning { "turning" } else { "milling" }
        ));
        let mut says = |property: &str, text: &str| {
            let representation = sheet.says(text);
            sheet.property(id, property, representation);
        };
        let on = flood || (turning && (mist || through));
        says("coolant", if on { "coolant on" } else { "coolant off" });
        if turning {
            // One kind at a time: the standard has no more for turning.
            let kind = [(through, "through tool"), (mist, "mist"), (flood, "flood")];
            if let Some((_, kind)) = kind.into_iter().find(|(open, _)| *open) {
                says("coolant type", kind);
            }
            if [flood, mist, through].into_iter().filter(|open| *open).count() > 1 {
                self.notices
                    .insert("several coolant outlets are open at once; STEP-NC has one kind of coolant for turning".to_string());
            }
        } else {
            if mist {
                says("mist", "mist on");
            }
            if through {
                says("through spindle coolant", "through spindle coolant on");
            }
        }
        if functions.oriented {
            let direction = sheet.direction([1.0, 0.0, 0.0]);
            let context = sheet.context;
            let representation = sheet.add(format!("REPRESENTATION('',(#{direction}),#{context})"));
            sheet.property(id, "oriented spindle stop", representation);
        }
        if !functions.others.is_empty() {
            let items: Vec<String> = functions
                .others
                .iter()
                .map(|(name, mode)| {
                    format!(
                        "#{}",
                        sheet.add(format!("DESCRIPTIVE_REPRESENTATION_ITEM('{name}',{})", encode(mode)))
                    )
                })
                .collect();
            let no_units = sheet.no_units;
            let representation = sheet.add(format!("REPRESENTATION('',({}),#{no_units})", items.join(",")));
            sheet.property(id, "other functions", representation);
        }
        self.functions.insert(functions.clone(), id);
        id
    }

    // ---- the end
}

/// What follows the name of a work offset that a program has shifted, the last one first.
const SHIFTS: [&str; 2] = [" G92", " G52"];
/// Gaps up to this are rounding of a program's numbers, mm; the planner closes as much.
const ROUNDING: f64 = 0.05;
/// Shorter moves have no direction, mm.
const NO_LENGTH: f64 = 1e-9;
/// How far an exact path is left, mm: the planner's figure for G61.
const EXACT_PATH: f64 = 0.0005;

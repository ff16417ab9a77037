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
mod sheet;
mod tools;

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
            StepKind::Stop(StopKind::Program) => self.function("program stop", "program stop", &BTreeMap::new()),
            StepKind::Stop(StopKind::Optional) => self.function("optional stop", "optional stop", &BTreeMap::new()),
            StepKind::Register(change) => {
                self.registers.insert(change.register.name());
            }
            StepKind::NcFunction(RawNcFunction { kind, name, text, .. }) => {
                let name = if name.is_empty() { kind } else { name };
                self.function(&name, "extended function", &BTreeMap::from([("description", text)]));
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

    fn go(&mut self, go: Move) -> Result<(), ConvertError> {
        if !go.path.is_sound() {
            return Err(ConvertError::NotFinite(self.title.clone()));
        }
        let rapid = go.speed == Speed::Rapid;
        let feed = match go.speed {
            Speed::Rapid => None,
            Speed::Feed(feed) => self.feed(feed, &go.path),
        };
        if go.profile.is_some() {
            self.notices
                .insert("a multiplier of the feed along a move is left out".to_string());
        }
        let mut path = go.path;
        // A line begins where the last move really ended, as the planner has it too.
        let tip = self.tip();
        if let Path::Line { from, .. } = &mut path
            && from.distance(tip) <= ROUNDING
        {
            *from = tip;
        }
        self.gauge = self.machine_from_setup() * path.end() + self.offset.total();
        if path.length() <= NO_LENGTH {
            return Ok(());
        }
        let exact_stop = self.path_mode == PathMode::ExactStop;
        self.add_piece(path, rapid, feed, exact_stop);
        Ok(())
    }

    /// A move to a place of the machine is a rapid path to where that is in the set-up.
    fn machine_move(&mut self, to: [Option<Millimetres>; 3]) -> Result<(), ConvertError> {
        let from = self.tip();
        for (axis, target) in to.into_iter().enumerate() {
            if let Some(target) = target {
                self.gauge.xyz[axis] = target.0;
            }
        }
        let path = Path::Line { from, to: self.tip() };
        if !path.is_sound() {
            return Err(ConvertError::NotFinite(self.title.clone()));
        }
        if path.length() > NO_LENGTH {
            self.close_path();
            self.add_piece(path, true, None, true);
            self.close_path();
        }
        Ok(())
    }

    fn feed(&self, feed: Feed, path: &Path<Setup>) -> Option<FeedKey> {
        let (value, per_revolution, synchronized) = match feed {
            Feed::PerTime(speed) => (speed.0, false, false),
            Feed::WholeMove(time) => (path.length() / time.0, false, false),
            Feed::PerRevolution(length) => (length.0, true, false),
            Feed::Thread(thread) => (thread.advance.0, true, true),
        };
        // The standard knows a feed for each revolution in turning only; elsewhere the spindle's own speed makes a speed of it.
        let (value, per_revolution) = match self.spindle {
            SpindleState::Clockwise(SpindleMode::Revolutions(n))
            | SpindleState::Counterclockwise(SpindleMode::Revolutions(n))
                if per_revolution && !self.options.turning =>
            {
                (value * n.0 / 60.0, false)
            }
            _ => (value, per_revolution),
        };
        (value.is_finite() && value > 0.0).then_some(FeedKey {
            per_revolution,
            synchronized,
            value: value.to_bits(),
        })
    }

    fn technology(&self, feed: Option<FeedKey>) -> Technology {
        let signed = |clockwise: bool, value: f64| if clockwise { -value } else { value }.to_bits();
        let of = |clockwise: bool, mode: SpindleMode| match mode {
            SpindleMode::Revolutions(n) => SpindleKey::Revolutions(signed(clockwise, n.0)),
            SpindleMode::Surface { speed, limit } => SpindleKey::Surface(signed(clockwise, speed.0), limit.0.to_bits()),
        };
        let spindle = match self.spindle {
            SpindleState::Stopped | SpindleState::Oriented => SpindleKey::Stopped,
            SpindleState::Clockwise(mode) => of(true, mode),
            SpindleState::Counterclockwise(mode) => of(false, mode),
        };
        Technology { feed, spindle }
    }

    fn conditions(&self, exact_stop: bool) -> Functions {
        let mut others = Vec::new();
        if exact_stop {
            others.push((EXACT_STOP, "on".to_string()));
        }
        // Without a tool that is said as well: the stream asks for one otherwise.
        let own = self.tool.map(|tool| self.tools[tool].number.0);
        if Some(self.offset.number) != own {
            let number = match self.offset.number {
                0 => "off".to_string(),
                number => number.to_string(),
            };
            others.push((TOOL_OFFSET, number));
        }
        Functions {
            outlets: [self.coolant.flood, self.coolant.mist, self.coolant.through],
            oriented: self.spindle == SpindleState::Oriented,
            others,
        }
    }

    fn add_piece(&mut self, piece: Path<Setup>, rapid: bool, feed: Option<FeedKey>, exact_stop: bool) {
        self.open_step();
        let along_tool = |piece: &Path<Setup>| matches!(piece, Path::Line { from, to } if (to.xyz[0] - from.xyz[0]).abs() + (to.xyz[1] - from.xyz[1]).abs() < 1e-9);
        if curve::is_flattened(&piece) {
            self.notices.insert(
                "a helix that does not stand on the XY plane has no curve in STEP-NC: chords within 0.0005 mm stand for it"
                    .to_string(),
            );
        }
        let base = self.base();
        if rapid {
            self.bases[base].highest = self.bases[base].highest.max(piece.start().xyz[2]).max(piece.end().xyz[2]);
        }
        let key = PathKey {
            rapid,
            technology: self.technology(feed),
            functions: self.conditions(exact_stop),
            maximum_deviation: match self.path_mode {
                PathMode::ExactStop | PathMode::Tolerance(None) => None,
                // Half of what a path allows is the planner's.
                PathMode::Tolerance(Some(tolerance)) => Some(tolerance.0 * 2.0),
                PathMode::ExactPath => Some(EXACT_PATH * 2.0),
            },
        };
        if let Some(step) = &mut self.step
            && !rapid
        {
            step.drills &= along_tool(&piece);
        }
        match &mut self.path {
            Some(open) if open.key == key => open.pieces.push(piece),
            _ => {
                self.close_path();
                self.path = Some(OpenPath {
                    key,
                    pieces: vec![piece],
                });
            }
        }
    }

    fn close_path(&mut self) {
        let Some(open) = self.path.take() else { return };
        let Some(step) = &mut self.step else { return };
        let name = if open.key.rapid {
            step.rapids += 1;
            format!("rapid {}", step.rapids)
        } else {
            step.feeds += 1;
            format!("cut {}", step.feeds)
        };
        let sheet = &mut self.sheet;
        let curve = curve::curve(sheet, &open.pieces);
        let id = sheet.add(format!("MACHINING_TOOLPATH('{name}','cutter location trajectory','','')"));
        let context = sheet.context;
        let representation = sheet.add(format!("REPRESENTATION('',(#{curve}),#{context})"));
        sheet.property(id, "basic curve", representation);
        let required = sheet.says("required");
        sheet.property(id, "priority", required);
        if open.key.rapid {
            let rapid = sheet.rapid();
            sheet.property(id, "speed profile", rapid);
        }
        if let Some(deviation) = open.key.maximum_deviation {
            let item = sheet.length_item("path maximum deviation", Millimetres(deviation));
            let no_units = sheet.no_units;
            let representation = sheet.add(format!("REPRESENTATION('',(#{item}),#{no_units})"));
            sheet.property(id, "path maximum deviation", representation);
        }
        self.told(id, open.key.technology, open.key.functions);
    }

    /// A path that stands still.
    fn dwell(&mut self, time: Seconds) {
        self.close_path();
        self.open_step();
        let Some(step) = &mut self.step else { return };
        step.dwells += 1;
        let name = format!("dwell {}", step.dwells);
        let sheet = &mut self.sheet;
        let id = sheet.add(format!("MACHINING_TOOLPATH('{name}','feedstop','','')"));
        let item = sheet.time_item("dwell time", time);
        let no_units = sheet.no_units;
        let representation = sheet.add(format!(
            "MACHINING_DWELL_TIME_REPRESENTATION('dwell time',(#{item}),#{no_units})"
        ));
        sheet.property(id, "dwell", representation);
        let required = sheet.says("required");
        sheet.property(id, "priority", required);
        let (technology, functions) = (self.technology(None), self.conditions(false));
        self.told(id, technology, functions);
    }

    fn told(&mut self, id: u64, technology: Technology, functions: Functions) {
        self.toolpaths += 1;
        self.last = Some((technology, functions.clone()));
        if let Some(step) = &mut self.step {
            step.paths.push((id, technology, functions));
        }
    }

    // ---- structure

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

    fn function(&mut self, name: &str, kind: &str, properties: &BTreeMap<&str, String>) {
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

    fn finish(mut self) -> Result<Written, ConvertError> {
        self.close_step();
        self.tell_tool();
        if self.children.is_empty() {
            return Err(ConvertError::Empty);
        }
        if !self.registers.is_empty() {
            let names: Vec<String> = std::mem::take(&mut self.registers).into_iter().collect();
            self.notices.insert(format!(
                "the program writes registers of the machine ({}); STEP-NC has none: they are left out, and moves are as they made them",
                names.join(", ")
            ));
        }
        self.technologies();
        self.workplans();
        let tools = std::mem::take(&mut self.tools);
        let used = || tools.iter().filter(|tool| !tool.users.is_empty());
        for tool in used() {
            tool.write(&mut self.sheet, self.options.turning, &self.options.tables);
        }
        let options = self.options;
        Ok(Written {
            tools: used().count() as u32,
            bytes: self.sheet.into_file(
                &format!("made from {}", options.made_from),
                &options.name,
                options.written,
                &options.author,
                &options.writer,
            ),
            workingsteps: self.workingsteps,
            toolpaths: self.toolpaths,
            notices: self.notices.into_iter().collect(),
        })
    }

    /// Technologies come last: a rapid path before the first cut is told the feed of that cut.
    fn technologies(&mut self) {
        let links = std::mem::take(&mut self.technology_links);
        let mut resolved: Vec<(u64, Technology)> = Vec::with_capacity(links.len());
        let mut next = None;
        for &(owner, technology) in links.iter().rev() {
            next = technology.feed.or(next);
            let feed = technology.feed.or(next);
            resolved.push((owner, Technology { feed, ..technology }));
        }
        resolved.reverse();
        let mut before = None;
        let mut known: BTreeMap<Technology, u64> = BTreeMap::new();
        for (owner, mut technology) in resolved {
            technology.feed = technology.feed.or(before);
            before = technology.feed;
            // Without a single feed in the whole program there is none to tell.
            if technology.feed.is_none() && technology.spindle == SpindleKey::Stopped {
                continue;
            }
            let id = match known.get(&technology) {
                Some(&id) => id,
                None => {
                    let id = self.write_technology(technology);
                    known.insert(technology, id);
                    id
                }
            };
            self.sheet
                .add(format!("MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{owner},#{id})"));
        }
    }

    fn write_technology(&mut self, technology: Technology) -> u64 {
        let turning = self.options.turning;
        let sheet = &mut self.sheet;
        let (per_unit, no_units) = (sheet.millimetres_per_unit(), sheet.no_units);
        let kind = if turning { "turning" } else { "milling" };
        let id = sheet.add(format!("MACHINING_TECHNOLOGY('','{kind}','','')"));
        let feed = technology.feed.unwrap_or(FeedKey {
            per_revolution: false,
            synchronized: false,
            value: 0,
        });
        let value = f64::from_bits(feed.value) / per_unit;
        let (name, item) = if feed.per_revolution {
            let name = "feed per revolution";
            (name, sheet.speed_item(name, value, SpeedUnit::LengthPerRevolution))
        } else {
            let name = "feed speed";
            (name, sheet.speed_item(name, value * 60.0, SpeedUnit::LengthPerMinute))
        };
        let representation = sheet.add(format!("MACHINING_FEED_SPEED_REPRESENTATION('{name}',(#{item}),#{no_units})"));
        sheet.property(id, "feedrate", representation);
        let (name, items) = match technology.spindle {
            SpindleKey::Stopped => (
                "spindle speed",
                vec![("rotational speed", 0.0, SpeedUnit::RevolutionsPerMinute)],
            ),
            SpindleKey::Revolutions(n) => (
                "spindle speed",
                vec![("rotational speed", f64::from_bits(n), SpeedUnit::RevolutionsPerMinute)],
            ),
            SpindleKey::Surface(speed, limit) => (
                "cutting speed",
                vec![
                    ("surface speed", f64::from_bits(speed) * 0.06, SpeedUnit::MetresPerMinute),
                    (
                        "maximum rotational speed",
                        f64::from_bits(limit),
                        SpeedUnit::RevolutionsPerMinute,
                    ),
                ],
            ),
        };
        let items: Vec<String> = items
            .into_iter()
            .map(|(name, value, unit)| format!("#{}", sheet.speed_item(name, value, unit)))
            .collect();
        let representation = sheet.add(format!(
            "MACHINING_SPINDLE_SPEED_REPRESENTATION('{name}',({}),#{no_units})",
            items.join(",")
        ));
        sheet.property(id, "spindle", representation);
        if feed.synchronized {
            let synchronized = sheet.says("synchronized");
            let name = if turning {
                "synchronize spindle with z feed"
            } else {
                "synchronize spindle with feed"
            };
            sheet.property(id, name, synchronized);
        }
        id
    }

    /// One workplan with the set-up, or one for each run of executables in the same set-up.
    fn workplans(&mut self) {
        let children = std::mem::take(&mut self.children);
        let bases = std::mem::take(&mut self.bases);
        let main = self
            .sheet
            .add(format!("MACHINING_WORKPLAN({},'','','')", encode(&self.options.name)));
        let setups: Vec<u64> = bases.iter().map(|base| self.setup(base)).collect();
        let only = children.iter().all(|(base, _)| *base == children[0].0);
        if only {
            self.begins(main, setups[children[0].0]);
            self.sequence(main, children.iter().map(|(_, child)| *child));
        } else {
            let mut plans = Vec::new();
            for run in children.chunk_by(|a, b| a.0 == b.0) {
                let base = run[0].0;
                let name = encode(&bases[base].name);
                let plan = self.sheet.add(format!("MACHINING_WORKPLAN({name},'','','')"));
                self.begins(plan, setups[base]);
                self.sequence(plan, run.iter().map(|(_, child)| *child));
                plans.push(plan);
            }
            self.sequence(main, plans.into_iter());
        }
        let (product_context, definition_context, workpiece) =
            (self.sheet.product_context, self.sheet.definition_context, self.workpiece);
        let name = encode(&self.options.name);
        let sheet = &mut self.sheet;
        let project = sheet.add(format!("MACHINING_PROJECT({name},{name},$,(#{product_context}))"));
        let formation = sheet.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{project})"));
        let definition = sheet.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"));
        let process = sheet.add(format!("PRODUCT_DEFINITION_PROCESS('machining','',#{main},'')"));
        sheet.add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{definition},#{process})"));
        sheet.add(format!(
            "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP('','workpiece','',#{definition},#{workpiece})"
        ));
    }

    fn sequence(&mut self, plan: u64, children: impl Iterator<Item = u64>) {
        for (n, child) in children.enumerate() {
            self.sheet.add(format!(
                "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{child},{}.)",
                n + 1
            ));
        }
    }

    fn begins(&mut self, plan: u64, setup: u64) {
        let process = self.sheet.add(format!("PRODUCT_DEFINITION_PROCESS('setup','',#{plan},'')"));
        self.sheet
            .add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{setup},#{process})"));
    }

    fn setup(&mut self, base: &Base) -> u64 {
        let (product_context, definition_context, context) =
            (self.sheet.product_context, self.sheet.definition_context, self.sheet.context);
        let (workpiece, workpiece_shape, workpiece_origin) = (self.workpiece, self.workpiece_shape, self.workpiece_origin);
        let sheet = &mut self.sheet;
        let name = encode(if base.name.is_empty() { "set-up" } else { &base.name });
        let product = sheet.add(format!("MACHINING_SETUP({name},{name},$,(#{product_context}))"));
        let formation = sheet.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{product})"));
        let setup = sheet.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"));
        let height = if base.highest.is_finite() { base.highest } else { 0.0 };
        let placement = sheet.placement("", [0.0, 0.0, height], [0.0, 0.0, 1.0], Some([1.0, 0.0, 0.0]));
        let plane = sheet.add(format!("PLANE('',#{placement})"));
        let representation = sheet.add(format!("REPRESENTATION('',(#{plane}),#{context})"));
        let property = sheet.add(format!("PROPERTY_DEFINITION('security plane','',#{setup})"));
        sheet.add(format!("PROPERTY_DEFINITION_REPRESENTATION(#{property},#{representation})"));
        // An assumed offset is nobody's: the next machine has its own.
        let place = if base.assumed {
            Transform::IDENTITY
        } else {
            base.machine_from_setup
        };
        let origin = sheet.frame("orientation", &place);
        let there = sheet.frame("workpiece", &Transform::<Setup, Setup>::IDENTITY);
        let shape_representation = sheet.add(format!("SHAPE_REPRESENTATION('',(#{origin},#{there}),#{context})"));
        if !base.assumed {
            let shape = sheet.add(format!("PRODUCT_DEFINITION_SHAPE('orientation','',#{setup})"));
            sheet.add(format!("SHAPE_DEFINITION_REPRESENTATION(#{shape},#{shape_representation})"));
        }
        let relation = sheet.add(format!(
            "MACHINING_SETUP_WORKPIECE_RELATIONSHIP('','workpiece setup','',#{setup},#{workpiece})"
        ));
        let shape = sheet.add(format!("PRODUCT_DEFINITION_SHAPE('','',#{relation})"));
        let transformation = sheet.add(format!("ITEM_DEFINED_TRANSFORMATION('','',#{workpiece_origin},#{there})"));
        let relationship = sheet.add(format!(
            "(REPRESENTATION_RELATIONSHIP('','',#{workpiece_shape},#{shape_representation}) \
             REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{transformation}) SHAPE_REPRESENTATION_RELATIONSHIP())"
        ));
        sheet.add(format!("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relationship},#{shape})"));
        setup
    }
}

/// What follows the name of a work offset that a program has shifted, the last one first.
const SHIFTS: [&str; 2] = [" G92", " G52"];
/// Gaps up to this are rounding of a program's numbers, mm; the planner closes as much.
const ROUNDING: f64 = 0.05;
/// Shorter moves have no direction, mm.
const NO_LENGTH: f64 = 1e-9;
/// How far an exact path is left, mm: the planner's figure for G61.
const EXACT_PATH: f64 = 0.0005;

//! A program goes through twice: once to know what its head has to say, once to be written.
//!
//! The two passes are given machines that stand at different places. What comes out differently depends on where the machine stood or
//! where a work offset lies, and cannot be said in the coordinates of a program: it is refused, not guessed.

use crate::control::Control;
use crate::control::work_number;
use crate::fingerprint::Fingerprint;
use crate::functions::Tracing;
use crate::grade::Row;
use crate::sheet::{Refusal, Sheet};
use crate::statement::{Head, Statement};
use crate::threading::Tap;
use plan::flow::{Flow, Part, StructuredProgram};
use plan::{
    CoolantState, Diagnostic, FrameChange, Level, MachineMove, Origin, PathMode, Place, SpindleState, Step, StepKind, ToolOffset,
};
use std::collections::{BTreeMap, BTreeSet};
use units::{Machine, Setup, ToolNumber, Transform};

/// What the person who posts says.
#[derive(Clone, Debug)]
pub struct Options {
    /// The program's number, where programs have numbers; else one is found in its name.
    pub number: Option<u32>,
    /// The file it is made from.
    pub source: String,
    /// X words are diameters: a lathe.
    pub turning: bool,
    /// Splines and what a control has no words for become chords within this, mm.
    pub chord: f64,
    /// Conditions that a control can only check between blocks are checked every so many moves.
    pub check_every: u32,
    /// Where the work offsets or set-ups of these names lie: points are written from there, parallel to the machine's axes.
    pub bases: BTreeMap<String, Transform<Machine, Setup>>,
    /// Lengths of tools by offset number, to tell G43 from G44.
    pub lengths: BTreeMap<ToolNumber, f64>,
    /// Lines for the head that the caller knows: where set-ups lie, what was worked out on the way.
    pub head: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            number: None,
            source: String::new(),
            turning: false,
            chord: 0.005,
            check_every: 20,
            bases: BTreeMap::new(),
            lengths: BTreeMap::new(),
            head: Vec::new(),
        }
    }
}

/// What became of a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Posted {
    /// Its functions, each kind and verdict once.
    pub functions: Vec<Row>,
    /// What is said about the program as a whole.
    pub notices: Vec<String>,
    /// Forms of words that have to be verified at commissioning.
    pub verify: Vec<String>,
    /// Tools and the program's words for them.
    pub tools: BTreeMap<u32, String>,
    /// Work offsets and what they stand for.
    pub work_offsets: BTreeMap<String, String>,
    /// Lines written.
    pub lines: u64,
    /// What the reader found.
    pub remarks: Vec<Diagnostic>,
}

/// Opens the program for a pass, 0 or 1: the same program on machines that stand elsewhere.
pub type Open<'o> = dyn FnMut(usize) -> Result<Box<dyn StructuredProgram>, Box<Diagnostic>> + 'o;

/// Writes a program for a control; `out` is given each line with its end.
///
/// # Errors
/// The program cannot be read to its end, or says something that the control cannot.
pub fn post(
    control: &dyn Control,
    open: &mut Open<'_>,
    options: &Options,
    out: &mut dyn FnMut(&str),
) -> Result<Posted, Box<Diagnostic>> {
    // What turns out to begin on one way of a branch and to end on another is not written when the program is looked through again.
    let mut across = BTreeSet::new();
    let known = loop {
        let mut nowhere = |_: &str| {};
        let mut program = open(0)?;
        let mut first = Posting::new(control, options, &mut nowhere, None, across.clone());
        first.run(program.as_mut())?;
        let known = first.known();
        if known.across.is_empty() {
            break known;
        }
        across.extend(known.across);
    };
    let fingerprint = known.fingerprint;
    let mut program = open(1)?;
    let mut second = Posting::new(control, options, out, Some(known), across);
    second.run(program.as_mut())?;
    let again = second.known();
    if !again.fingerprint.is_like(&fingerprint) {
        return Err(Box::new(
            Diagnostic::error(
                "depends-on-machine",
                "the program does something else on a machine that stands elsewhere, has other work offsets or tool lengths, or keeps \
                 other values in its variables",
            )
            .in_file(options.source.clone())
            .remedy("begin with absolute coordinates behind reference points, set offsets at the machine, and set variables before use"),
        ));
    }
    Ok(Posted {
        functions: again.functions,
        notices: again.notices,
        verify: again.verify,
        tools: again.tools,
        work_offsets: again.work_offsets,
        lines: again.lines,
        remarks: program.diagnostics().to_vec(),
    })
}

/// What the first pass found out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Known {
    pub(crate) name: String,
    pub(crate) functions: Vec<Row>,
    pub(crate) notices: Vec<String>,
    pub(crate) verify: Vec<String>,
    pub(crate) tools: BTreeMap<u32, String>,
    pub(crate) work_offsets: BTreeMap<String, String>,
    pub(crate) variables: Vec<String>,
    /// The program asks how long workingsteps, operations or itself take.
    pub(crate) timers: [bool; 3],
    pub(crate) logs: bool,
    /// It sets tolerances of paths.
    pub(crate) tolerances: bool,
    /// Functions that begin and end on different ways of a branch.
    pub(crate) across: BTreeSet<String>,
    pub(crate) fingerprint: Fingerprint,
    pub(crate) lines: u64,
}

/// One pass.
pub(crate) struct Posting<'c, 's> {
    pub(crate) control: &'c dyn Control,
    pub(crate) options: &'c Options,
    pub(crate) sheet: Sheet<'s>,
    pub(crate) before: Option<Known>,
    pub(crate) found: Known,
    pub(crate) tracing: Tracing,
    /// Functions that are left out because of the ways they are on.
    pub(crate) across: BTreeSet<String>,
    /// Where the control has each axis, in units of words.
    pub(crate) at: [Option<i64>; 3],
    /// Axes that the next move names whatever the control believes.
    pub(crate) force: [bool; 3],
    /// Moves that are left of coming down from out of the way.
    pub(crate) lifted: u8,
    pub(crate) base_from_setup: Transform<Setup, Setup>,
    /// Where work offsets and set-ups lie, as far as it is known.
    bases: BTreeMap<String, [f64; 3]>,
    pub(crate) path_mode: PathMode,
    works: BTreeMap<String, u32>,
    work: Option<u32>,
    pub(crate) tool: u32,
    offset: ToolOffset,
    pub(crate) spindle: SpindleState,
    coolant: Option<CoolantState>,
    pub(crate) here: Option<Origin>,
    pub(crate) levels: Vec<Level>,
    pub(crate) tap: Option<Tap>,
    /// Moves since conditions were looked at.
    pub(crate) moves: u32,
    started: bool,
    pub(crate) fingerprint: Fingerprint,
}

impl<'c, 's> Posting<'c, 's> {
    pub(crate) fn new(
        control: &'c dyn Control,
        options: &'c Options,
        out: &'s mut dyn FnMut(&str),
        before: Option<Known>,
        across: BTreeSet<String>,
    ) -> Self {
        Posting {
            control,
            options,
            sheet: Sheet::new(control.paper(), options.turning, out),
            before,
            found: Known::default(),
            tracing: Tracing::default(),
            across,
            at: [None; 3],
            force: [false; 3],
            lifted: 0,
            base_from_setup: Transform::IDENTITY,
            bases: options.bases.iter().map(|(name, base)| (name.clone(), base.origin)).collect(),
            path_mode: PathMode::Tolerance(None),
            works: BTreeMap::new(),
            work: None,
            tool: 0,
            offset: ToolOffset::NONE,
            spindle: SpindleState::Stopped,
            coolant: None,
            here: None,
            levels: Vec::new(),
            tap: None,
            moves: 0,
            started: false,
            fingerprint: Fingerprint::default(),
        }
    }

    fn known(self) -> Known {
        let (notices, verify) = self.sheet.remarks();
        Known {
            notices: notices.to_vec(),
            verify: verify.to_vec(),
            variables: {
                let mut all: Vec<(&String, &u32)> = self.sheet.variables().iter().collect();
                all.sort_by_key(|(_, number)| **number);
                all.iter().map(|(name, _)| (*name).clone()).collect()
            },
            across: self.tracing.ways.across,
            fingerprint: self.fingerprint,
            lines: self.sheet.lines(),
            ..self.found
        }
    }

    fn run(&mut self, program: &mut dyn StructuredProgram) -> Result<(), Box<Diagnostic>> {
        loop {
            let part = match program.next_part() {
                Ok(part) => part,
                Err(alarm) if alarm.diagnostic.file.is_empty() => {
                    return Err(Box::new(alarm.diagnostic.in_file(self.options.source.clone())));
                }
                Err(alarm) => return Err(Box::new(alarm.diagnostic)),
            };
            let Some(part) = part else { break };
            let (origin, done) = match part {
                Part::Step(step) => {
                    self.here = Some(step.origin);
                    (step.origin, self.step(&step))
                }
                Part::Flow(origin, flow) => {
                    self.here = Some(origin);
                    (origin, self.flow(&flow))
                }
            };
            done.and_then(|()| self.sheet.checked())
                .map_err(|refusal| self.placed(refusal, Some(origin), program))?;
        }
        let end = self.end().and_then(|()| self.sheet.checked());
        end.map_err(|refusal| self.placed(refusal, None, program))
    }

    /// A refusal with its place.
    fn placed(&self, refusal: Refusal, origin: Option<Origin>, program: &dyn StructuredProgram) -> Box<Diagnostic> {
        let message = format!("{}: {}", self.control.name(), refusal.message);
        let mut diagnostic = Diagnostic::error(refusal.code, message).remedy(refusal.remedy);
        diagnostic = diagnostic.in_file(self.options.source.clone());
        if let Some(origin) = origin {
            diagnostic = diagnostic.in_file(program.file_name(origin.file));
            match origin.place {
                Place::Text { line, .. } => diagnostic = diagnostic.at_line(line, 1),
                Place::Entity(entity) => diagnostic = diagnostic.at_entity(entity),
                Place::Given => {}
            }
        }
        Box::new(diagnostic)
    }

    pub(crate) fn write(&mut self, statement: &Statement<'_>) -> Result<(), Refusal> {
        self.begin("")?;
        self.mark(statement);
        self.control.write(statement, &mut self.sheet)
    }

    /// Takes what a statement makes the machine do into the fingerprint; moves are taken in where they are told.
    fn mark(&mut self, statement: &Statement<'_>) {
        match statement {
            // What the register held before is the machine's.
            Statement::Register(change) => {
                self.fingerprint.word(&change.register);
                self.fingerprint.number(change.after.unwrap_or(f64::MIN));
            }
            Statement::Machine(to) => to.iter().flatten().for_each(|to| self.fingerprint.number(*to)),
            Statement::Dwell(time) => self.fingerprint.number(*time),
            Statement::Tool { .. }
            | Statement::Offset { .. }
            | Statement::Spindle(_)
            | Statement::Coolant { .. }
            | Statement::Work(_)
            | Statement::PathMode(_)
            | Statement::Stop(_)
            | Statement::Message(_) => self.fingerprint.word(statement),
            _ => {}
        }
    }

    /// The head, once; `name` is the program's.
    fn begin(&mut self, name: &str) -> Result<(), Refusal> {
        if self.started {
            return Ok(());
        }
        self.started = true;
        name.clone_into(&mut self.found.name);
        // The first pass does not know what the head will say, and its lines are not compared.
        let known = self.before.clone().unwrap_or_default();
        let name = if name.is_empty() { self.options.source.as_str() } else { name };
        let head = Head {
            name: name.to_owned(),
            number: self.options.number.unwrap_or_else(|| number_in(name)),
            source: self.options.source.clone(),
            text: crate::head::text(self.control, &known, self.options),
            logs: known.logs,
        };
        self.control.write(&Statement::Begin(&head), &mut self.sheet)?;
        for variable in &known.variables {
            self.sheet.variable(variable);
        }
        self.sheet.modal.tolerances = known.tolerances;
        if known.timers[2] {
            self.start_timer(2);
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), Refusal> {
        self.begin("")?;
        self.finish_tap()?;
        self.close_functions()?;
        self.control.write(&Statement::End, &mut self.sheet)
    }

    fn step(&mut self, step: &Step) -> Result<(), Refusal> {
        if self.tap.is_some() && self.tapping(&step.kind)? {
            return Ok(());
        }
        match &step.kind {
            StepKind::Begin(marker) if marker.level == Level::Program => {
                self.levels.push(Level::Program);
                self.begin(&marker.name)
            }
            StepKind::Begin(marker) => {
                self.levels.push(marker.level);
                if marker.level != Level::Toolpath && !marker.name.is_empty() {
                    let word = match marker.level {
                        Level::Workplan => "WORKPLAN ",
                        Level::Workingstep if !marker.derived => "WORKINGSTEP ",
                        Level::Operation => "OPERATION ",
                        _ => "",
                    };
                    self.write(&Statement::Section(&format!("{word}{}", marker.name)))?;
                }
                self.level_begins(marker.level);
                Ok(())
            }
            StepKind::End(level) => {
                if let Some(at) = self.levels.iter().rposition(|open| open == level) {
                    self.levels.truncate(at);
                }
                self.level_ends(*level)
            }
            StepKind::Move(go) => {
                self.travel(go)?;
                self.moves += 1;
                if self.moves >= self.options.check_every && self.lifted == 0 {
                    self.check_between_blocks()?;
                }
                Ok(())
            }
            StepKind::MachineMove(MachineMove { to }) => self.machine_move(to.map(|to| to.map(|to| to.0))),
            StepKind::Dwell(time) => {
                if !(time.0.is_finite() && time.0 >= 0.0) {
                    return Err(Refusal::new(
                        "dwell",
                        format!("a dwell of {} s", time.0),
                        "correct the program",
                    ));
                }
                self.write(&Statement::Dwell(time.0))
            }
            StepKind::Tool(call) => {
                let number = call.number.0;
                self.tool = number;
                if number > 0 {
                    self.found.tools.entry(number).or_insert_with(|| call.name.clone());
                }
                self.write(&Statement::Tool {
                    number,
                    name: &call.name,
                })?;
                self.offset = ToolOffset::NONE;
                self.tool_changed()
            }
            StepKind::ToolOffset(offset) => self.tool_offset(offset),
            StepKind::Spindle(state) => {
                self.spindle = *state;
                self.write(&Statement::Spindle(*state))
            }
            StepKind::Coolant(now) => {
                let before = self.coolant.replace(*now);
                self.write(&Statement::Coolant { before, now: *now })
            }
            StepKind::Frame(frame) => self.frame(frame),
            StepKind::PathMode(mode) => {
                self.path_mode = *mode;
                self.found.tolerances |= matches!(mode, PathMode::Tolerance(Some(_)));
                self.write(&Statement::PathMode(*mode))
            }
            StepKind::Message(text) => {
                if text.len() > 100 {
                    // What a screen has no room for stands in the program.
                    self.write(&Statement::Comment(text))?;
                }
                self.write(&Statement::Message(text))
            }
            StepKind::Stop(kind) => self.write(&Statement::Stop(*kind)),
            StepKind::Register(change) => {
                if let (plan::Register::WorkOffset { name, axis }, Some(after)) = (&change.register, change.after) {
                    if let Some(base) = self.bases.get_mut(name) {
                        base[*axis] = after;
                    }
                    // The tool stands, and its coordinate is another; a Siemens goes by the new origin when it is called again.
                    if work_number(name).is_none_or(|number| self.work.is_none_or(|work| work == number)) {
                        self.at[*axis] = None;
                        self.work = None;
                    }
                }
                self.write(&Statement::Register(change))
            }
            StepKind::NcFunction(function) => self.function(function),
        }
    }

    fn flow(&mut self, flow: &Flow) -> Result<(), Refusal> {
        self.finish_tap()?;
        let ways = &mut self.tracing.ways;
        match flow {
            Flow::If(_) | Flow::While(_) => ways.part(),
            Flow::Otherwise => {
                ways.meet();
                ways.part();
            }
            Flow::EndIf | Flow::EndWhile => ways.meet(),
            Flow::Assign { .. } | Flow::Retract => {}
        }
        match flow {
            Flow::If(condition) => self.border(&Statement::If(condition)),
            Flow::Otherwise => self.border(&Statement::Else),
            Flow::EndIf => self.border(&Statement::EndIf),
            Flow::While(condition) => self.border(&Statement::While(condition)),
            Flow::EndWhile => self.border(&Statement::EndWhile),
            Flow::Assign { variable, value } => {
                self.sheet.variable(variable);
                self.write(&Statement::Assign { variable, value })
            }
            Flow::Retract => {
                self.write(&Statement::Retract)?;
                self.at = [None; 3];
                self.lifted = 2;
                Ok(())
            }
        }
    }

    /// Ways part or meet: nothing that was written before is relied on behind it.
    fn border(&mut self, statement: &Statement<'_>) -> Result<(), Refusal> {
        self.sheet.modal.forget();
        self.write(statement)?;
        self.sheet.modal.forget();
        self.at = [None; 3];
        self.work = None;
        self.coolant = None;
        Ok(())
    }

    fn machine_move(&mut self, to: [Option<f64>; 3]) -> Result<(), Refusal> {
        let mut words = [None; 3];
        for k in 0..3 {
            if self.options.turning && k == 1 {
                continue;
            }
            words[k] = to[k].map(|to| if self.options.turning && k == 0 { 2.0 * to } else { to });
            if to[k].is_some() {
                self.at[k] = None;
            }
        }
        if words == [None; 3] {
            return Ok(());
        }
        self.write(&Statement::Machine(words))
    }

    fn tool_offset(&mut self, offset: &ToolOffset) -> Result<(), Refusal> {
        if offset.number == u32::MAX {
            return Err(Refusal::new(
                "tool-offset",
                "which tool is in the spindle depends on the way that was taken",
                "let the workingstep behind the branch name its tool",
            ));
        }
        self.offset = *offset;
        // The tip is elsewhere now in the coordinates that moves are written in.
        for k in if self.options.turning { [0, 2] } else { [2, 2] } {
            self.at[k] = None;
        }
        let length = self.options.lengths.get(&ToolNumber(offset.number)).copied().unwrap_or(0.0);
        let negative = !self.options.turning && length * offset.geometry.xyz[2] < 0.0;
        self.write(&Statement::Offset {
            number: offset.number,
            negative,
        })
    }

    fn frame(&mut self, frame: &FrameChange) -> Result<(), Refusal> {
        // `G54 G52`: a shift on top of G54, from which points are written.
        let name = match frame.name.split_once(" G52").or_else(|| frame.name.split_once(" G92")) {
            Some((base, _)) => base.to_owned(),
            None => frame.name.clone(),
        };
        let origin = frame.machine_from_setup.origin;
        if work_number(&name).is_some() && name == frame.name {
            self.bases.insert(name.clone(), origin);
        }
        let base = self.bases.get(&name).copied().unwrap_or(origin);
        let rotation = frame.machine_from_setup.rotation;
        let upright = (rotation[2][2] - 1.0).abs() < 1e-12;
        let straight = upright && (rotation[0][0] - 1.0).abs() < 1e-12;
        if !upright || (self.options.turning && !straight) {
            return Err(Refusal::new(
                "tool-axis",
                format!("set-up '{name}' is turned against the machine so that its Z is not the tool's"),
                "clamp the part so that the tool's axis is the set-up's Z, or let a CAM system write this side",
            ));
        }
        let mut base_from_setup = Transform::<Setup, Setup>::IDENTITY;
        base_from_setup.rotation = rotation;
        for k in 0..3 {
            base_from_setup.origin[k] = origin[k] - base[k];
        }
        // The control's coordinates go on; only what our points mean has changed.
        self.base_from_setup = base_from_setup;
        let number = match work_number(&name) {
            Some(number) => {
                if let Some((other, _)) = self.works.iter().find(|(other, taken)| **taken == number && **other != name) {
                    return Err(Refusal::new(
                        "work-offset",
                        format!("set-up '{other}' stands for {name} already"),
                        "name all set-ups G54, G55 ..., or none of them",
                    ));
                }
                self.works.insert(name.clone(), number);
                number
            }
            None => {
                let next = (1..)
                    .find(|free| !self.works.values().any(|taken| taken == free))
                    .unwrap_or(u32::MAX);
                *self.works.entry(name.clone()).or_insert(next)
            }
        };
        if self.work != Some(number) {
            self.at = [None; 3];
            self.work = Some(number);
            let words = self.control.work_name(number);
            let meaning = if name.is_empty() {
                "the program's set-up".to_owned()
            } else {
                name
            };
            self.found.work_offsets.insert(words, meaning);
            self.write(&Statement::Work(number))?;
        }
        Ok(())
    }
}

/// The number that a program's name has: `O1200 FLANGE`; 1000 when it has none that a control takes.
fn number_in(name: &str) -> u32 {
    let digits = name.strip_prefix(['O', 'o']).unwrap_or_default();
    let end = digits.bytes().take_while(u8::is_ascii_digit).count();
    digits[..end]
        .parse()
        .ok()
        .filter(|number| (1..=7999).contains(number))
        .unwrap_or(1000)
}

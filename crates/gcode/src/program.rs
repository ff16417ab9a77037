//! [`GcodeProgram`]: a text file as a [`plan::ProgramStream`].

mod again;
mod contour;

use crate::acting::{Act, act};
use crate::awaited::number_of;
use crate::block::Block;
use crate::evaluate::Stack;
use crate::expression::DEEPEST_STACK;
use crate::fault::Site;
use crate::flow::{Frame, Loop, Repetition};
use crate::interpreter::{Flow, Interpreter, Item};
use crate::line::{Kind, Line, Reading};
use crate::listing::{File, Kept, KeptLines, Place, Targets, is_named};
use crate::macro_b::Value;
use crate::parameters::Parameters;
use crate::profile::Profile;
use crate::text::{LONGEST_LINE, Line as Raw, LineError, Lines, characters};
use plan::{
    Alarm, Answer, ByteSource, Diagnostic, FileId, Next, Origin, ProgramStream, Question, Resolver, Severity, Step, StepKind,
    StopKind, Tables,
};
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use units::{Machine, Millimetres, Point, Rpm, StepId};

/// What the machine's settings and switches say about reading a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Block-skip switches that are on: bit 0 is `/` and `/1`, bit 8 is `/9`.
    pub block_skip: u16,
    /// What a length without a decimal point means.
    pub whole_numbers: WholeNumbers,
    /// Variables that hold something when the program starts; others are vacant.
    pub variables: BTreeMap<u32, f64>,
    /// How far the two radii of an arc may always differ; more is allowed on large arcs: 0.1 % of the radius, up to 0.5 mm.
    pub arc_tolerance: Millimetres,
    /// Highest spindle speed that is assumed when a program with constant surface speed names none.
    pub spindle_limit: Rpm,
    /// The T word's first pair chooses a lathe's tool geometry, the second only its wear (Fanuc parameter 5002.1, LGN=1); else the second
    /// pair chooses both.
    pub geometry_by_station: bool,
    /// Where G30, G30 P3 and G30 P4 go; `None` when the machine has no such place. Parameters 1241 to 1243 say it by axis: `1241/X`.
    pub references: [Option<Point<Machine>>; 3],
    /// Fanuc parameter 6004.0 turned round: `Some(true)` is NAT=0, angles from 0 to 360. `None` is the family's default.
    pub angles_from_zero: Option<bool>,
    /// Control parameters.
    pub parameters: Parameters,
    /// Blocks in a row without motion, dwell or stop after which a program counts as endless.
    pub most_blocks_at_rest: u64,
    /// Jumps back in all after which a program counts as endless.
    pub most_jumps_back: u64,
    /// Inches before the first G20 or G21.
    pub inches: bool,
    /// The main program comes from a line and is not in the control's memory: its branches and loops are alarm 123.
    pub by_line: bool,
    /// Takes down every move, printed line and stop for [`GcodeProgram::into_trace`].
    pub trace: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            block_skip: 0,
            whole_numbers: WholeNumbers::Units,
            variables: BTreeMap::new(),
            arc_tolerance: Millimetres(0.01),
            spindle_limit: Rpm(4000.0),
            geometry_by_station: false,
            references: [None; 3],
            angles_from_zero: None,
            parameters: Parameters::default(),
            most_blocks_at_rest: 100_000_000,
            most_jumps_back: 100_000_000,
            inches: false,
            by_line: false,
            trace: false,
        }
    }
}

/// What `X100` means where `X100.` is 100 mm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WholeNumbers {
    /// 100 mm (Fanuc parameter 3401.0 DPI=1). The default: read the other way, a forgotten point makes moves a thousand times too
    /// short without anybody noticing.
    Units,
    /// 100 least increments, 0.1 mm (DPI=0).
    Increments,
}

/// Lines looked through for the program's number before the first block.
const HEADER_LINES: u32 = 100;

/// What a program did, taken down while it was read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Variables that hold something.
    pub variables: BTreeMap<u32, Value>,
    /// Moves: G number and end point in the work system, in the program's unit.
    pub path: Vec<Vec<f64>>,
    /// Printed lines.
    pub output: Vec<String>,
    /// Names given by SETVN.
    pub names: BTreeMap<u32, String>,
    /// Stops by `#3006`.
    pub stops: Vec<crate::interpretation::Stop>,
    /// Last T value.
    pub tool: Option<u32>,
}

/// A program of G-code, read as it is asked for.
///
/// Each step's origin is the line that made it. The workingsteps it tells are derived: one for each tool change, named after the tool
/// and the comment before it; G-code itself has no such structure.
pub struct GcodeProgram {
    pub(crate) files: Vec<File>,
    /// The file being read.
    pub(crate) current: usize,
    /// Where the program being read begins; jumps stay in it.
    pub(crate) body: Place,
    pub(crate) frames: Vec<Frame>,
    pub(crate) loops: Vec<Loop>,
    pub(crate) kept: KeptLines,
    pub(crate) targets: Targets,
    /// The kept line executed next; else the next one of the text.
    pub(crate) next_kept: Option<u32>,
    /// Lines up to this byte are kept: they are gone through again.
    pub(crate) keep_until: u64,
    /// The line being executed.
    pub(crate) here: Here,
    /// It waits for an answer and is executed again.
    pub(crate) again: Option<Raw>,
    /// The line executed next is one that waited for an answer.
    waits: bool,
    /// The program is over; before its end is told, answers are waited for.
    ending: bool,
    pub(crate) repetition: Repetition,
    /// Programs that were called before.
    pub(crate) called: BTreeSet<(usize, u64)>,
    pub(crate) resolver: Box<dyn Resolver>,
    block: Block,
    line: Line,
    stack: Box<Stack>,
    pub(crate) reading: Reading,
    pub(crate) interpreter: Interpreter,
    asked: Option<(Origin, Question)>,
    pub(crate) alarm: Option<Alarm>,
    pub(crate) ended: bool,
    /// No block of the program being read was executed yet.
    pub(crate) at_start: bool,
    any_block: bool,
    last_step: u32,
    /// Blocks since something moved.
    blocks_at_rest: u64,
    tables: Tables,
    program_name: String,
    /// Where the program starts in file 0: behind the leader.
    pub(crate) start: Place,
}

/// The line being executed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Here {
    pub place: Place,
    pub after: Place,
    pub number: u32,
    pub length: u32,
    /// The kept line it is.
    pub kept: Option<u32>,
}

impl GcodeProgram {
    /// Opens a program. `name` is the file's name for messages; `tables` are what the machine has ready.
    ///
    /// # Errors
    /// The file is empty, cannot be read, or is no text.
    pub fn open(
        source: Box<dyn ByteSource>,
        name: &str,
        profile: &'static Profile,
        resolver: Box<dyn Resolver>,
        tables: Tables,
        options: Options,
    ) -> Result<GcodeProgram, Box<Diagnostic>> {
        let mut lines = Lines::new(source);
        if lines.length() == 0 {
            return Err(Box::new(
                Diagnostic::error("empty-file", "the file is empty")
                    .in_file(name)
                    .at_line(1, 1)
                    .remedy("choose another file"),
            ));
        }
        let mut interpreter = Interpreter::new(profile, &options, &tables, name);
        let reading = Reading {
            macros: interpreter.macros,
            block_skip: options.block_skip,
        };
        let (offset, before) = leader(&mut lines).map_err(|e| Box::new(line_error(e).in_file(name)))?;
        let start = Place { offset, lines: before };
        let program_name = header(&mut lines, start, name, &reading)?;
        lines.seek(start.offset, start.lines);
        interpreter.begin(program_name.clone());
        Ok(GcodeProgram {
            files: vec![File {
                name: name.to_owned(),
                lines,
                programs: None,
            }],
            current: 0,
            body: start,
            frames: Vec::new(),
            loops: Vec::new(),
            kept: KeptLines::default(),
            targets: Targets::default(),
            next_kept: None,
            keep_until: 0,
            here: Here::default(),
            again: None,
            waits: false,
            ending: false,
            repetition: Repetition::default(),
            called: BTreeSet::new(),
            resolver,
            block: Block::new(),
            line: Line::default(),
            stack: Box::new([0.0; DEEPEST_STACK]),
            reading,
            interpreter,
            asked: None,
            alarm: None,
            ended: false,
            at_start: true,
            any_block: false,
            last_step: 0,
            blocks_at_rest: 0,
            tables,
            program_name,
            start,
        })
    }

    /// The family of controls it is read as.
    pub fn profile(&self) -> &'static Profile {
        self.interpreter.profile
    }

    /// What a macro variable holds now.
    pub fn variable(&self, number: u32) -> Value {
        match self.interpreter.memory.has(number) {
            true => self.interpreter.memory.read(number),
            false => self.interpreter.system_variable(number).map_or(Value::Vacant, Value::of),
        }
    }

    /// O number of the program being executed and the sequence number executed last; 0 where there is none.
    pub fn place(&self) -> (u32, u32) {
        let number = self.interpreter.program_number;
        (if is_named(number) { 0 } else { number }, self.interpreter.last_n)
    }

    /// What was taken down on the way, with the variables as they stand; empty without [`Options::trace`].
    pub fn into_trace(mut self) -> Trace {
        // Locals are those of the main program, also when an alarm came in a macro.
        if let Some(main) = self.frames.iter_mut().find_map(|f| f.saved.take()) {
            self.interpreter.memory.enter(&main);
        }
        let mut trace = std::mem::take(&mut self.interpreter.trace);
        trace.variables.extend(self.interpreter.written_variables());
        for number in (1..34).chain(100..200).chain(500..1000) {
            let value = self.interpreter.memory.read(number);
            if value != Value::Vacant {
                trace.variables.insert(number, value);
            }
        }
        trace.names = std::mem::take(&mut self.interpreter.names);
        trace
    }

    /// The first line where the program's way was decided by a value or a switch, and by what: `IF`, `WHILE`, block skip.
    pub fn decided(&self) -> Option<(u32, &'static str)> {
        self.interpreter.decided
    }

    /// True when the program's lengths are in inches now.
    pub fn in_inches(&self) -> bool {
        self.interpreter.inches
    }

    #[inline]
    fn number_step(&mut self, origin: Origin, kind: StepKind) -> Next {
        match self.last_step.checked_add(1) {
            Some(id) => {
                self.last_step = id;
                Next::Step(Step {
                    id: StepId(id),
                    origin,
                    kind,
                })
            }
            None => {
                let alarm = Alarm::from(Diagnostic::error(
                    "too-many-steps",
                    "the program has more than 4294967295 steps",
                ));
                self.alarm = Some(alarm.clone());
                Next::Alarm(alarm)
            }
        }
    }

    /// Takes the answer to the question that was asked; `None` asks again.
    fn answered(&mut self, answer: Option<Answer>) -> Option<Next> {
        let (origin, question) = self.asked.take()?;
        let Some(answer) = answer else {
            self.asked = Some((origin, question.clone()));
            return Some(Next::Ask(question));
        };
        match (&question, answer) {
            (Question::OptionalStop, Answer::Truth(true)) => Some(self.number_step(origin, StepKind::Stop(StopKind::Optional))),
            (Question::OptionalStop, Answer::Truth(false)) => None,
            (Question::Skip { .. }, answer) => {
                self.interpreter.origin = origin;
                self.interpreter.skip_answered(&question, answer);
                None
            }
            (Question::Number(name), Answer::Number(Some(value))) => {
                self.interpreter.answer(name, value);
                None
            }
            (Question::Number(name), Answer::Unknown | Answer::Number(None)) if number_of(name).is_some() => {
                self.unknown_variable(name);
                None
            }
            (Question::Number(name), answer @ (Answer::Unknown | Answer::NotAsked)) => {
                let (value, assumed) = self.interpreter.own_count(name);
                match answer {
                    Answer::NotAsked => self.interpreter.assume(name, value, assumed),
                    _ => self.interpreter.answer(name, value),
                }
                let (severity, code) = match assumed {
                    true => (Severity::Warning, "answer-assumed"),
                    false => (Severity::Remark, "own-count"),
                };
                let site = Site {
                    text: b"",
                    number: self.here.number,
                };
                let of_a_function = number_of(name).is_some();
                self.interpreter.note(severity, code, site, 0, || match assumed {
                    true if of_a_function => (
                        format!("a function writes {name} while the program runs: here it keeps what it held"),
                        "look at what the program does for other values".to_owned(),
                    ),
                    true => (
                        format!("nobody answers for {name}: 0 is assumed"),
                        "look at what the program does for other values".to_owned(),
                    ),
                    false => (
                        format!("{name} is the program's own count: no machine was asked"),
                        String::new(),
                    ),
                });
                None
            }
            _ => {
                let message = match &question {
                    Question::OptionalStop => "the machine does not know whether its optional-stop switch is on".to_owned(),
                    other => format!("the machine has no answer to {other:?}"),
                };
                let diagnostic = Diagnostic::error("no-answer", message)
                    .in_file(self.file_name(origin.file))
                    .at_line(self.here.number, 1)
                    .remedy("set the switch or the sensor, or take the question out of the program");
                self.alarm = Some(diagnostic.into());
                None
            }
        }
    }

    /// The machine has no value of a variable that a function writes. To go on with what it held would be to cut with it; but a program
    /// that only keeps it comes to its end.
    fn unknown_variable(&mut self, name: &str) {
        let line = match self.next_kept {
            Some(index) => &self.kept.get(index).line,
            None => &self.line,
        };
        let number = self.here.number;
        if self.interpreter.unknown_in_contour(name, line) {
            return;
        }
        if self
            .interpreter
            .may_stay_unknown(name, if self.ending { None } else { Some(line) })
        {
            let (value, _) = self.interpreter.own_count(name);
            self.interpreter.answer(name, value);
            let site = Site { text: b"", number };
            return self.interpreter.note(Severity::Warning, "variable-kept", site, 0, || {
                (
                    format!("the machine has no value of {name}, which a function writes: it keeps what it held"),
                    "do not let the next program rely on it".to_owned(),
                )
            });
        }
        let diagnostic = Diagnostic::error(
            "no-answer",
            format!("the machine has no value of {name}: the function that writes it was not done yet, or could not measure"),
        )
        .in_file(self.files[self.current].name.clone())
        .at_line(number, 1)
        .remedy("read it by a function of its own before, and see in the log why that has no value");
        self.alarm = Some(diagnostic.into());
    }

    /// A fault that a cycle met while it was told is an alarm of the cycle's line.
    fn raise_late_fault(&mut self) {
        let Some(fault) = self.interpreter.compensation.fault.take() else {
            return;
        };
        let origin = self.interpreter.origin;
        let number = match origin.place {
            plan::Place::Text { line, .. } => line,
            _ => 0,
        };
        let name = self.file_name(origin.file).to_owned();
        self.alarm = Some(fault.into_alarm(&name, Site { text: b"", number }));
    }

    /// Reads and executes one line.
    fn advance(&mut self) {
        if std::mem::take(&mut self.ending) {
            return self.end_program();
        }
        if let Some(index) = self.next_kept {
            return self.go_through_kept(index);
        }
        self.waits = false;
        let waited = self.again.take();
        let raw = match waited {
            Some(raw) => raw,
            None => {
                let (offset, lines) = self.files[self.current].lines.position();
                let raw = match self.files[self.current].lines.next() {
                    Ok(Some(raw)) => raw,
                    Ok(None) => return self.end_of_text(None),
                    Err(error) => {
                        self.alarm = Some(line_error(error).in_file(self.files[self.current].name.clone()).into());
                        return;
                    }
                };
                let after = self.files[self.current].lines.position();
                self.here = Here {
                    place: Place { offset, lines },
                    after: Place {
                        offset: after.0,
                        lines: after.1,
                    },
                    number: raw.number,
                    length: raw.length(),
                    kept: None,
                };
                raw
            }
        };
        self.count_block();
        self.interpreter.origin = origin(self.current, &self.here);
        let file = &self.files[self.current];
        let site = Site {
            text: file.lines.bytes(raw),
            number: raw.number,
        };
        if waited.is_none()
            && let Err(fault) = self.line.read(site.text, &self.reading)
        {
            self.alarm = Some(fault.into_alarm(&file.name, site));
            return;
        }
        match self.line.kind {
            Kind::Blank => {
                self.block.comment = self.line.comment;
                self.interpreter.comment_line(&self.block, self.line.function, site);
                return self.keep_line(raw);
            }
            Kind::TapeMark if self.at_start => return,
            Kind::TapeMark => return self.end_of_text(Some(self.here.number)),
            Kind::Words | Kind::Statement => {}
        }
        if let Some((number, _)) = self.line.program {
            if !self.at_start {
                return self.end_of_text(Some(self.here.number)); // the next program of the file
            }
            self.interpreter.program_number = number;
        }
        self.at_start = false;
        self.any_block = true;
        self.interpreter.close_comments();
        if waited.is_none() {
            self.interpreter.take_functions(&self.line, site);
        }
        let result = act(&mut self.interpreter, &mut self.block, &self.line, site, &mut self.stack);
        let waits = matches!(&result, Err(fault) if fault.ask.is_some());
        if !waits {
            self.keep_line(raw);
        }
        let file = &self.files[self.current];
        let site = Site {
            text: file.lines.bytes(raw),
            number: raw.number,
        };
        match result {
            Ok(Act::Flow(Flow::NextBlock)) => self.interpreter.forget_answers(),
            Err(fault) => match fault.ask {
                Some(question) => {
                    self.again = Some(raw);
                    self.wait_for(question);
                }
                None => self.alarm = Some(fault.into_alarm(&file.name, site)),
            },
            // What follows moves the window: the text is no longer needed but for the column of a fault.
            Ok(act) => {
                let text = site.text.to_vec();
                let site = Site {
                    text: &text,
                    number: self.here.number,
                };
                self.follow(Ok(act), site);
            }
        }
    }

    /// Keeps the line being executed when it is gone through again.
    fn keep_line(&mut self, raw: Raw) {
        if self.here.place.offset >= self.keep_until {
            return;
        }
        let (here, origin) = (self.here, self.interpreter.origin);
        let (line, text) = (&self.line, self.files[self.current].lines.bytes(raw));
        let keep = |index| Kept {
            text: text.into(),
            line: line.clone(),
            here: Here {
                kept: Some(index),
                ..here
            },
            origin,
            next: Cell::new(None),
            jump: Cell::new(None),
        };
        if !self.kept.keep(self.current, keep, here.place.offset) {
            self.keep_until = 0;
        }
    }

    /// The line waits for an answer: everything said before is done first.
    pub(crate) fn wait_for(&mut self, question: Question) {
        self.interpreter.settle();
        self.raise_late_fault();
        self.waits = true;
        self.interpreter.push(Item::Ask(self.interpreter.origin, question));
    }

    /// An endless program ends here: blocks that move nothing are counted.
    #[inline]
    fn count_block(&mut self) {
        self.blocks_at_rest += 1;
        self.interpreter.nominal += NOMINAL_BLOCK;
        if self.blocks_at_rest > self.interpreter.options.most_blocks_at_rest {
            let most = self.interpreter.options.most_blocks_at_rest;
            let message = format!("{most} blocks in a row moved nothing: the program does not come to an end");
            self.endless(message);
        }
    }

    pub(crate) fn endless(&mut self, message: String) {
        let diagnostic = Diagnostic::error("endless-program", message)
            .in_file(self.files[self.current].name.clone())
            .at_line(self.here.number, 1)
            .remedy("look at what shall end the loop");
        self.alarm.get_or_insert(diagnostic.into());
    }

    /// The text is over: end of file, `%`, or the next program.
    pub(crate) fn end_of_text(&mut self, line: Option<u32>) {
        self.interpreter.tell_function();
        let number = match line {
            Some(number) => number,
            None => self.files[self.current].lines.position().1,
        };
        let name = self.files[self.current].name.clone();
        if !self.frames.is_empty() {
            let diagnostic = Diagnostic::error("no-return", "the subprogram ends without M99")
                .in_file(name)
                .at_line(number, 1)
                .remedy("end it with M99");
            self.alarm = Some(diagnostic.into());
            return;
        }
        if !self.any_block {
            let diagnostic = Diagnostic::error("empty-program", "there is no block in this program")
                .in_file(name)
                .at_line(number.max(1), 1)
                .remedy("choose another file");
            self.alarm = Some(diagnostic.into());
            return;
        }
        let site = Site { text: b"", number };
        self.interpreter.note(Severity::Warning, "no-program-end", site, 0, || {
            ("the program ends without M30 or M2".to_owned(), "end it with M30".to_owned())
        });
        self.end_program();
    }

    /// The main program is over where no M30 asked for what has to be known then.
    pub(crate) fn end_program(&mut self) {
        if let Some(question) = self.interpreter.kept_to_ask() {
            self.ending = true;
            return self.wait_for(question);
        }
        self.interpreter.finish();
        self.ended = true;
    }
}

impl ProgramStream for GcodeProgram {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        if let Some(next) = self.answered(answer) {
            return next;
        }
        loop {
            let goes_out = !self.interpreter.out.is_empty() || self.alarm.is_some() || self.ended;
            if goes_out && let Some((origin, kind)) = self.interpreter.untold_write() {
                return self.number_step(origin, kind);
            }
            match self.interpreter.out.pop_front() {
                Some(Item::Step(origin, kind)) => {
                    if let StepKind::Dwell(time) = kind {
                        self.interpreter.nominal += time.0;
                    }
                    if matches!(
                        kind,
                        StepKind::Move(_) | StepKind::MachineMove(_) | StepKind::Dwell(_) | StepKind::Stop(_)
                    ) {
                        self.blocks_at_rest = 0;
                    }
                    return self.number_step(origin, kind);
                }
                Some(Item::Ask(origin, question)) => {
                    self.asked = Some((origin, question.clone()));
                    return Next::Ask(question);
                }
                None => {}
            }
            if self.interpreter.go_on() {
                self.raise_late_fault();
                continue;
            }
            if let Some(alarm) = &self.alarm {
                self.interpreter.say_kept(self.here.number);
                return Next::Alarm(alarm.clone());
            }
            if self.ended {
                return Next::End;
            }
            self.advance();
        }
    }

    fn rewind(&mut self) {
        let (profile, options) = (self.interpreter.profile, self.interpreter.options.clone());
        self.interpreter = Interpreter::new(profile, &options, &self.tables, &self.files[0].name);
        self.interpreter.begin(self.program_name.clone());
        self.frames.clear();
        self.loops.clear();
        self.repetition = Repetition::default();
        (self.current, self.last_step, self.blocks_at_rest, self.keep_until) = (0, 0, 0, 0);
        (self.asked, self.alarm, self.again, self.next_kept) = (None, None, None, None);
        (self.ended, self.at_start, self.any_block) = (false, true, false);
        (self.waits, self.ending) = (false, false);
        self.body = self.start;
        self.files[0].lines.seek(self.start.offset, self.start.lines);
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.interpreter.remarks.as_slice()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.files.get(usize::from(file.0)).map_or("", |f| f.name.as_str())
    }
}

/// Time that a block is taken to need where no machine is asked, s.
const NOMINAL_BLOCK: f64 = 0.001;

fn origin(file: usize, here: &Here) -> Origin {
    Origin {
        file: FileId(file as u16),
        place: plan::Place::Text {
            line: here.number,
            start: here.place.offset,
            length: here.length,
        },
    }
}

fn line_error(error: LineError) -> Diagnostic {
    match error {
        LineError::Read(why) => Diagnostic::error("unreadable", format!("the file cannot be read: {why}")),
        LineError::TooLong { number } => {
            Diagnostic::error("line-too-long", format!("this line has more than {LONGEST_LINE} bytes"))
                .at_line(number, 1)
                .remedy("is this a program? break long blocks up")
        }
        LineError::Binary { number, column } => Diagnostic::error("binary-file", "a byte 0: this is no text")
            .at_line(number, column)
            .remedy("choose a program file"),
    }
}

/// Where the program starts: behind a leader, which is any text before the first `%` that does not look like blocks.
pub(crate) fn leader(lines: &mut Lines) -> Result<(u64, u32), LineError> {
    const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
    let mut first = (0, 0);
    while let Some(line) = lines.next()? {
        let text = lines.bytes(line);
        let text = match text.strip_prefix(BYTE_ORDER_MARK) {
            Some(rest) if line.number == 1 => {
                first = (BYTE_ORDER_MARK.len() as u64, 0);
                rest
            }
            _ => text,
        };
        let text = text.trim_ascii();
        if text.first() == Some(&b'%') {
            return Ok(lines.position());
        }
        let is_block = match text {
            [] => false,
            [b'(' | b'#' | b'/' | b'[' | b'<', ..] => true,
            [letter, digit, ..] => letter.is_ascii_alphabetic() && (digit.is_ascii_digit() || *digit == b'.'),
            _ => false,
        };
        if is_block || line.number >= HEADER_LINES {
            break;
        }
    }
    Ok(first)
}

/// The program's name: its number with the comment beside it, else the file's.
fn header(lines: &mut Lines, start: Place, file: &str, reading: &Reading) -> Result<String, Box<Diagnostic>> {
    lines.seek(start.offset, start.lines);
    let mut first = Line::default();
    let mut empty = true;
    let in_file = |error| Box::new(line_error(error).in_file(file));
    while let Some(line) = lines.next().map_err(in_file)? {
        let text = lines.bytes(line);
        empty &= text.trim_ascii().is_empty();
        // What is wrong with a line is told when it is executed.
        if first.read(text, reading).is_err() {
            return Ok(file.to_owned());
        }
        match first.kind {
            Kind::Blank | Kind::TapeMark if line.number < HEADER_LINES => {}
            Kind::Words => {
                return Ok(match (first.program, first.comment) {
                    (Some((number, at)), _) if is_named(number) => characters(&text[at..]).trim().to_owned(),
                    (Some((number, _)), None) => format!("O{number:04}"),
                    (Some((number, _)), Some((from, to))) => format!("O{number:04} {}", characters(&text[from..to]).trim()),
                    (None, _) => file.to_owned(),
                });
            }
            _ => return Ok(file.to_owned()),
        }
    }
    if empty {
        return Err(Box::new(
            Diagnostic::error("empty-file", "there is no program in this file")
                .in_file(file)
                .at_line(1, 1)
                .remedy("choose another file"),
        ));
    }
    Ok(file.to_owned())
}

//! [`GcodeProgram`]: a text file as a [`plan::ProgramStream`].

mod contour;

use crate::block::{Block, Kind, check_behind_assignment};
use crate::fault::{Fault, Site};
use crate::interpreter::{Flow, Interpreter, Item};
use crate::macro_b::{Reader, Value};
use crate::profile::Profile;
use crate::text::{LONGEST_LINE, Line, LineError, Lines, characters};
use plan::{
    Alarm, Answer, ByteSource, Diagnostic, FileId, Next, Origin, Place, ProgramStream, Question, Resolver, Severity, Step,
    StepKind, StopKind, Tables,
};
use std::collections::BTreeMap;
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
    /// Where G30 goes; `None` when the machine has no such place.
    pub second_reference: Option<Point<Machine>>,
    /// Fanuc parameter 6004.0 turned round: `Some(true)` is NAT=0, angles from 0 to 360. `None` is the family's default.
    pub angles_from_zero: Option<bool>,
    /// Inches before the first G20 or G21.
    pub inches: bool,
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
            second_reference: None,
            angles_from_zero: None,
            inches: false,
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

/// Subprograms inside subprograms (Fanuc 16i: alarm 077 beyond).
const DEEPEST_CALL: usize = 4;
/// Files a program may be made of.
const MOST_FILES: usize = 256;
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
    files: Vec<File>,
    /// The file being read.
    current: usize,
    calls: Vec<Call>,
    resolver: Box<dyn Resolver>,
    block: Block,
    interpreter: Interpreter,
    asked: Option<(Origin, Question)>,
    alarm: Option<Alarm>,
    ended: bool,
    /// No block of the program being read was executed yet.
    at_start: bool,
    any_block: bool,
    last_step: u32,
    tables: Tables,
    program_name: String,
    /// Where the program starts in file 0: behind the leader.
    start: (u64, u32),
}

struct File {
    name: String,
    lines: Lines,
    /// Where each program of this file begins; made when the first one is looked for.
    programs: Option<BTreeMap<u32, (u64, u32)>>,
}

struct Call {
    return_file: usize,
    return_to: (u64, u32),
    body: (u64, u32),
    times_left: u32,
    /// Number of the program that called.
    caller: u32,
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
        let start = leader(&mut lines).map_err(|e| Box::new(line_error(e).in_file(name)))?;
        let program_name = header(&mut lines, start, name, &interpreter)?;
        lines.seek(start.0, start.1);
        interpreter.begin(program_name.clone());
        Ok(GcodeProgram {
            files: vec![File {
                name: name.to_owned(),
                lines,
                programs: None,
            }],
            current: 0,
            calls: Vec::new(),
            resolver,
            block: Block::new(),
            interpreter,
            asked: None,
            alarm: None,
            ended: false,
            at_start: true,
            any_block: false,
            last_step: 0,
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
        use crate::macro_b::Variables;
        self.interpreter.read(number).unwrap_or(Value::Vacant)
    }

    /// O number of the program being executed and the sequence number executed last; 0 where there is none.
    pub fn place(&self) -> (u32, u32) {
        (self.interpreter.program_number, self.interpreter.last_n)
    }

    /// What was taken down on the way, with the variables as they stand; empty without [`Options::trace`].
    pub fn into_trace(self) -> Trace {
        let mut trace = self.interpreter.trace;
        for number in (1..34).chain(100..200).chain(500..1000) {
            let value = self.interpreter.memory.read(number);
            if value != Value::Vacant {
                trace.variables.insert(number, value);
            }
        }
        trace
    }

    /// True when the program's lengths are in inches now.
    pub fn in_inches(&self) -> bool {
        self.interpreter.inches
    }

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
        match answer {
            None => {
                self.asked = Some((origin, question.clone()));
                Some(Next::Ask(question))
            }
            Some(answer) if matches!(question, Question::Skip { .. }) => {
                self.interpreter.origin = origin;
                self.interpreter.skip_answered(&question, answer);
                None
            }
            Some(Answer::Truth(true)) => Some(self.number_step(origin, StepKind::Stop(StopKind::Optional))),
            Some(Answer::Truth(false)) => None,
            Some(Answer::Number(_) | Answer::Place(_) | Answer::Unknown) => {
                let line = match origin.place {
                    Place::Text { line, .. } => line,
                    _ => 0,
                };
                let diagnostic = Diagnostic::error(
                    "no-answer",
                    "the machine does not know whether its optional-stop switch is on",
                )
                .in_file(self.file_name(origin.file))
                .at_line(line, 1)
                .remedy("set the switch, or take M1 out");
                self.alarm = Some(diagnostic.into());
                None
            }
        }
    }

    /// A fault that a cycle met while it was told is an alarm of the cycle's line.
    fn raise_late_fault(&mut self) {
        let Some(fault) = self.interpreter.compensation.fault.take() else {
            return;
        };
        let origin = self.interpreter.origin;
        let number = match origin.place {
            Place::Text { line, .. } => line,
            _ => 0,
        };
        let name = self.file_name(origin.file).to_owned();
        self.alarm = Some(fault.into_alarm(&name, Site { text: b"", number }));
    }

    /// Reads and executes one line.
    fn advance(&mut self) {
        let line = match self.files[self.current].lines.next() {
            Ok(Some(line)) => line,
            Ok(None) => return self.end_of_text(None),
            Err(error) => {
                self.alarm = Some(line_error(error).in_file(self.files[self.current].name.clone()).into());
                return;
            }
        };
        let file = &self.files[self.current];
        let site = Site {
            text: file.lines.bytes(line),
            number: line.number,
        };
        self.interpreter.origin = origin(self.current, line);
        let kind = self.block.read(site.text, self.interpreter.reading(), &self.interpreter);
        let result = match kind {
            Err(fault) => Err(fault),
            Ok(Kind::Blank) => {
                self.interpreter.comment_line(&self.block, site);
                return;
            }
            Ok(Kind::TapeMark) if self.at_start => return,
            Ok(Kind::TapeMark) => return self.end_of_text(Some(line)),
            Ok(Kind::Assignment { at }) => {
                self.at_start = false;
                self.any_block = true;
                self.interpreter.close_comments();
                assign(&mut self.interpreter, site, at).map(|()| Flow::NextBlock)
            }
            Ok(Kind::Words) => {
                if let Some((number, _)) = self.block.program {
                    if !self.at_start {
                        return self.end_of_text(Some(line)); // the next program of the file
                    }
                    self.interpreter.program_number = number;
                }
                self.at_start = false;
                self.any_block = true;
                self.interpreter.close_comments();
                self.interpreter.show_message(&self.block, site);
                self.interpreter.execute(&mut self.block, site)
            }
        };
        match result {
            Ok(Flow::NextBlock) => {}
            Ok(Flow::End) => self.ended = true,
            Ok(Flow::Contour(request)) => self.read_contour(request, line.number),
            Ok(Flow::Call { program, times, at }) => {
                // Looking for the subprogram moves the window, so the place is taken down first.
                let (name, column) = (file.name.clone(), site.column(at));
                if let Err(fault) = self.call(program, times) {
                    let mut alarm = fault.into_alarm(
                        &name,
                        Site {
                            text: b"",
                            number: line.number,
                        },
                    );
                    alarm.diagnostic.column = column;
                    self.alarm = Some(alarm);
                }
            }
            Ok(Flow::Return) => match self.calls.pop() {
                Some(mut call) => {
                    self.at_start = true;
                    call.times_left -= 1;
                    if call.times_left > 0 {
                        self.files[self.current].lines.seek(call.body.0, call.body.1);
                        self.calls.push(call);
                    } else {
                        self.at_start = false;
                        self.interpreter.program_number = call.caller;
                        self.current = call.return_file;
                        self.files[self.current].lines.seek(call.return_to.0, call.return_to.1);
                    }
                }
                None => {
                    let fault = Fault::not_there_yet(0, "M99 in the main program, which runs for ever,");
                    self.alarm = Some(fault.into_alarm(&file.name, site));
                }
            },
            Err(fault) => self.alarm = Some(fault.into_alarm(&file.name, site)),
        }
    }

    /// The text is over: end of file, `%`, or the next program.
    fn end_of_text(&mut self, line: Option<Line>) {
        let number = match line {
            Some(line) => line.number,
            None => self.files[self.current].lines.position().1,
        };
        let name = self.files[self.current].name.clone();
        if !self.calls.is_empty() {
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
        self.interpreter.finish();
        self.ended = true;
    }

    /// Goes to a subprogram: of this file, of the main file, or one that the resolver finds.
    fn call(&mut self, program: u32, times: u32) -> Result<(), Box<Fault>> {
        if times == 0 {
            return Ok(());
        }
        if self.calls.len() >= DEEPEST_CALL {
            let message = format!("subprograms are nested more than {DEEPEST_CALL} deep");
            return Err(Fault::new(0, 77, "call-depth", message, "call it from a shallower level"));
        }
        let return_to = self.files[self.current].lines.position();
        let return_file = self.current;
        let mut found = None;
        for file in [self.current, 0] {
            if let Some(body) = self.program_in(file, program) {
                found = Some((file, body));
                break;
            }
        }
        self.files[self.current].lines.seek(return_to.0, return_to.1);
        let (file, body) = match found {
            Some(found) => found,
            None => self.open_program(program)?,
        };
        self.calls.push(Call {
            return_file,
            return_to,
            body,
            times_left: times,
            caller: self.interpreter.program_number,
        });
        self.current = file;
        self.files[file].lines.seek(body.0, body.1);
        self.at_start = true;
        Ok(())
    }

    /// Where program `number` begins in a file. Looks through the file once.
    fn program_in(&mut self, file: usize, number: u32) -> Option<(u64, u32)> {
        let file = &mut self.files[file];
        if file.programs.is_none() {
            let mut programs = BTreeMap::new();
            file.lines.seek(0, 0);
            loop {
                let before = file.lines.position();
                let Ok(Some(line)) = file.lines.next() else { break };
                if let Some(found) = program_number(file.lines.bytes(line)) {
                    programs.entry(found).or_insert(before);
                }
            }
            file.programs = Some(programs);
        }
        file.programs.as_ref()?.get(&number).copied()
    }

    fn open_program(&mut self, number: u32) -> Result<(usize, (u64, u32)), Box<Fault>> {
        let name = format!("O{number:04}");
        if let Some(known) = self.files.iter().position(|f| f.name == name) {
            return Ok((known, (0, 0)));
        }
        let source = match self.resolver.open(&name) {
            Some(source) if self.files.len() < MOST_FILES => source,
            _ => {
                return Err(Fault::new(
                    0,
                    78,
                    "no-such-program",
                    format!("there is no program {name}"),
                    "put it into this file, or beside it",
                ));
            }
        };
        self.files.push(File {
            name,
            lines: Lines::new(source),
            programs: None,
        });
        Ok((self.files.len() - 1, (0, 0)))
    }
}

impl ProgramStream for GcodeProgram {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        if let Some(next) = self.answered(answer) {
            return next;
        }
        loop {
            match self.interpreter.out.pop_front() {
                Some(Item::Step(origin, kind)) => return self.number_step(origin, kind),
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
        self.calls.clear();
        (self.current, self.last_step) = (0, 0);
        (self.asked, self.alarm) = (None, None);
        (self.ended, self.at_start, self.any_block) = (false, true, false);
        self.files[0].lines.seek(self.start.0, self.start.1);
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.interpreter.remarks.as_slice()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.files.get(usize::from(file.0)).map_or("", |f| f.name.as_str())
    }
}

/// Carries out the assignment whose `#` is at byte `at`.
fn assign(interpreter: &mut Interpreter, site: Site<'_>, at: usize) -> Result<(), Box<Fault>> {
    let assignment = Reader::new(site.text, at, interpreter.macros, interpreter).assignment()?;
    check_behind_assignment(site.text, assignment.end)?;
    interpreter.assign(assignment.variable, assignment.value, at, assignment.end, site)
}

fn origin(file: usize, line: Line) -> Origin {
    Origin {
        file: FileId(file as u16),
        place: Place::Text {
            line: line.number,
            start: line.offset,
            length: line.length(),
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
fn leader(lines: &mut Lines) -> Result<(u64, u32), LineError> {
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
            [b'(' | b'#' | b'/' | b'[', ..] => true,
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
fn header(lines: &mut Lines, start: (u64, u32), file: &str, interpreter: &Interpreter) -> Result<String, Box<Diagnostic>> {
    lines.seek(start.0, start.1);
    let mut block = Block::new();
    let mut empty = true;
    let in_file = |error| Box::new(line_error(error).in_file(file));
    while let Some(line) = lines.next().map_err(in_file)? {
        let text = lines.bytes(line);
        empty &= text.trim_ascii().is_empty();
        match block.read(text, interpreter.reading(), interpreter) {
            Ok(Kind::Blank | Kind::TapeMark) if line.number < HEADER_LINES => {}
            Ok(Kind::Words) => {
                return Ok(match (block.program, block.comment) {
                    (Some((number, _)), None) => format!("O{number:04}"),
                    (Some((number, _)), Some((from, to))) => format!("O{number:04} {}", characters(&text[from..to]).trim()),
                    (None, _) => file.to_owned(),
                });
            }
            // What is wrong with a line is told when it is executed.
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

/// The number of the program that this line begins: `O1234`, `:1234`.
fn program_number(text: &[u8]) -> Option<u32> {
    let rest = match text.trim_ascii_start() {
        [b'O' | b'o' | b':', rest @ ..] => rest,
        _ => return None,
    };
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    match digits {
        1..=8 => Some(rest[..digits].iter().fold(0, |n, d| n * 10 + u32::from(d - b'0'))),
        _ => None,
    }
}

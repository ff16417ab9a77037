//! What is in force while a program is read, and the order in which the parts of a block take effect.
//!
//! [`Interpreter::execute`] is the place where a block gets its meaning; moves are in `motion`, work and tool offsets in `offsets`.
//! Lengths in here are millimetres, X of a lathe is a radius: words are converted by [`Interpreter::length`] and the factors of the
//! profile's axis words, and nowhere else.

mod codes;
mod feed;
mod tools;

use crate::awaited::Awaited;
use crate::block::{Block, Code, Word, set_of};
use crate::calls::ModalCall;
use crate::compensation::Compensation;
use crate::corner::Corner;
use crate::cycles::drilling::Cycle;
use crate::cycles::roughing::ContourRequest;
use crate::cycles::turning::Single;
use crate::cycles::{Expansion, TurningCycles};
use crate::fault::{Fault, Outcome, Site};
use crate::interruption::Interruption;
use crate::listing::{is_named, named_program};
use crate::macro_b::{MacroRules, Memory};
use crate::offsets::{WorkFrame, WorkKey};
use crate::parameters::Settings;
use crate::profile::{FeedMode, G, M, Motion, Once, Plane, Profile, Side};
use crate::program::{Options, Trace, WholeNumbers};
use crate::shaping::Shaping;
use crate::text::characters;
use plan::{
    CoolantState, Diagnostic, Diagnostics, Feed, FileId, Level, Marker, Missing, Origin, PathMode, Place, Question, Severity,
    SpindleMode, SpindleState, StepKind, StopKind, Tables, ToolCall, ToolOffset,
};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use units::{MM_PER_INCH, Millimetres, MmPerSec, Rpm, ToolNumber};

/// What a block gives, in order.
#[derive(Clone, Debug)]
pub(crate) enum Item {
    Step(Origin, StepKind),
    Ask(Origin, Question),
}

/// What happens behind a block.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Flow {
    NextBlock,
    End,
    /// G70 to G73: the contour is read, then the cycle begins.
    Contour(Box<ContourRequest>),
    /// M98, at this byte.
    Call {
        program: u32,
        times: u32,
        at: usize,
    },
    /// M99, M99 P.
    Return {
        to: Option<u32>,
        at: usize,
    },
    /// M97 of Haas: the blocks from this sequence number on, as a subprogram.
    LocalCall {
        block: u32,
        times: u32,
        at: usize,
    },
}

/// Most items one block may give; a drilling block that gives more has a wrong Q or K.
pub(crate) const MOST_ITEMS: usize = 50_000;

/// The state of a program being read.
pub(crate) struct Interpreter {
    pub profile: &'static Profile,
    /// The profile's letters as a set.
    known_letters: u32,
    pub macros: MacroRules,
    pub options: Options,
    pub tables: Tables,
    pub memory: Memory,
    pub remarks: Diagnostics,
    pub file: String,
    pub out: VecDeque<Item>,
    pub origin: Origin,
    /// The first line where the program's way was decided by a value or a switch, and by what.
    pub decided: Option<(u32, &'static str)>,

    /// Where the tip is in the frame in force.
    pub tip: [f64; 3],
    pub frame: WorkFrame,
    pub offset: ToolOffset,
    /// Sign of G43/G44; 0 with G49.
    pub length_sign: i8,
    pub h: u32,
    pub d: u32,

    pub motion: Motion,
    pub motion_said: bool,
    pub plane: Plane,
    pub inches: bool,
    pub units_said: bool,
    pub incremental: bool,
    pub absolute_centres: bool,
    pub feed_mode: FeedMode,
    /// In force, in the unit of the feed mode: mm/s, mm, or seconds.
    pub feed: Option<f64>,
    /// F as written, in mm: the lead of a thread.
    pub last_f: Option<f64>,
    /// The last move was a thread: another one goes on without waiting for the spindle's mark.
    pub threading: bool,
    pub side: Side,
    pub cycle: Option<Cycle>,
    pub compensation: Compensation,
    pub corner: Corner,
    pub shaping: Shaping,
    /// A cycle that is being told, pass by pass; no line is read before it is over.
    pub expansion: Option<Box<dyn Expansion>>,
    pub turning_cycles: TurningCycles,
    /// Where the last G31 stopped.
    pub skip_position: [f64; 3],
    pub return_to_r: bool,
    pub path_mode: PathMode,

    pub turning: Turning,
    pub revolutions: f64,
    /// Surface speed in mm/s, when G96 is in force.
    pub surface: Option<f64>,
    pub surface_speed: f64,
    pub spindle_limit: Option<Rpm>,
    pub spindle: SpindleState,
    pub rigid_tapping: bool,
    pub coolant: CoolantState,

    pub tool: Option<u32>,
    /// Called by a T word, with the program's words for it; M6 puts it in.
    pub preselected: Option<(u32, String)>,
    /// Comments of the last run of comment lines since the last move.
    comments: Vec<String>,
    comments_closed: bool,
    /// A function of the traceability vocabulary that may go on in the next line, and where it began.
    pub(crate) function: Option<(Origin, String)>,
    /// Functions behind a move that is held.
    pub(crate) functions: VecDeque<(Origin, StepKind)>,
    /// Variables that functions write while the program runs, as far as nobody has asked for them.
    pub(crate) awaited: Vec<Awaited>,
    /// Those of them that the machine had no value of when a cycle with a contour asked.
    pub unknown: BTreeSet<u32>,
    workingstep_open: bool,
    pub program_name: String,
    pub program_number: u32,
    /// Names of called programs that have one, by the number that stands for it.
    pub program_names: BTreeMap<u32, String>,
    pub last_m: u16,
    pub last_n: u32,
    /// S as programmed last.
    pub last_s: Option<f64>,

    pub settings: Settings,
    /// Names that SETVN gave to variables.
    pub names: BTreeMap<u32, String>,
    /// System variables that are mere storage, and what was given before the start.
    pub given: BTreeMap<u32, f64>,
    /// System variables that were given or written, for the report.
    pub written: BTreeSet<u32>,
    /// What the machine answered for the line being executed.
    pub answers: BTreeMap<String, f64>,
    /// What was put last in place of answers where there is no machine.
    pub assumed: BTreeMap<String, f64>,
    /// How often that was a mere assumption, and whether it was since the last jump back.
    pub assumptions: u64,
    pub assumed_since_jump: bool,
    pub last_powered: Option<f64>,
    /// Seconds since power on at which #3001 was 0.
    pub timer_zero: f64,
    /// Seconds that pass where no machine is asked.
    pub nominal: f64,
    pub printer_open: bool,
    /// Modal calls in force, outer first, and how many of them are running.
    pub modal: Vec<ModalCall>,
    pub modal_running: usize,
    pub interruption: Interruption,
    /// In a program that a code called: such codes are plain there.
    pub in_code_call: bool,
    /// The block has moved an axis.
    pub moved: bool,
    /// Something moved since the read-ahead was stopped.
    pub moved_since_stop: bool,
    /// How far the programmed place is from the tip: offsets that came into force since the axis was named.
    pub carried: [f64; 3],
    pub trace: Trace,
}

/// What M3, M4, M5 said last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turning {
    Stopped,
    Clockwise,
    Counterclockwise,
}

/// Codes of a block that act after its words are known.
#[derive(Default)]
struct Said {
    motion: bool,
    once: Option<(Once, usize)>,
    exact_stop: bool,
    drill: bool,
    work: Option<(WorkKey, usize)>,
    length: Option<(i8, usize)>,
    side: Option<(Side, usize)>,
    surface: Option<bool>,
    path: Option<(PathMode, usize)>,
}

impl Interpreter {
    pub(crate) fn new(profile: &'static Profile, options: &Options, tables: &Tables, file: &str) -> Self {
        let mut macros = profile.macros;
        let angles = options.angles_from_zero.or(options.parameters.bit(6004, 0).map(|nat| !nat));
        if let Some(from_zero) = angles {
            macros.angles_from_zero = from_zero;
        }
        let memory = Memory::new(macros);
        let mut new = Interpreter {
            profile,
            known_letters: set_of(profile.letters),
            macros,
            options: options.clone(),
            tables: tables.clone(),
            memory,
            remarks: Diagnostics::new(),
            file: file.to_owned(),
            out: VecDeque::new(),
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            decided: None,
            tip: [0.0; 3],
            frame: WorkFrame::default(),
            offset: ToolOffset::NONE,
            length_sign: 0,
            h: 0,
            d: 0,
            motion: Motion::Rapid,
            motion_said: false,
            plane: profile.plane,
            inches: options.inches,
            units_said: options.inches,
            incremental: false,
            absolute_centres: false,
            feed_mode: if profile.turning {
                FeedMode::PerRevolution
            } else {
                FeedMode::PerMinute
            },
            feed: None,
            last_f: None,
            threading: false,
            side: Side::On,
            cycle: None,
            compensation: Compensation::default(),
            corner: Corner::default(),
            shaping: Shaping::default(),
            expansion: None,
            turning_cycles: TurningCycles::default(),
            skip_position: [0.0; 3],
            return_to_r: false,
            path_mode: PathMode::Tolerance(None),
            turning: Turning::Stopped,
            revolutions: 0.0,
            surface: None,
            surface_speed: 0.0,
            spindle_limit: None,
            spindle: SpindleState::Stopped,
            rigid_tapping: false,
            coolant: CoolantState::default(),
            tool: None,
            preselected: None,
            comments: Vec::new(),
            comments_closed: false,
            function: None,
            functions: VecDeque::new(),
            awaited: Vec::new(),
            unknown: BTreeSet::new(),
            workingstep_open: false,
            program_name: file.to_owned(),
            program_number: 0,
            program_names: BTreeMap::new(),
            last_m: 0,
            last_n: 0,
            last_s: None,
            settings: Settings::of(&options.parameters),
            names: BTreeMap::new(),
            given: BTreeMap::new(),
            written: BTreeSet::new(),
            answers: BTreeMap::new(),
            assumed: BTreeMap::new(),
            assumptions: 0,
            assumed_since_jump: false,
            last_powered: None,
            timer_zero: 0.0,
            nominal: 0.0,
            printer_open: false,
            modal: Vec::new(),
            modal_running: 0,
            interruption: Interruption::default(),
            in_code_call: false,
            moved: false,
            moved_since_stop: false,
            carried: [0.0; 3],
            trace: Trace::default(),
        };
        new.tip = new.tables.position.xyz;
        match options.parameters.bit(3401, 0) {
            Some(true) => new.options.whole_numbers = WholeNumbers::Units,
            Some(false) => new.options.whole_numbers = WholeNumbers::Increments,
            None => {}
        }
        new.given(options);
        new
    }

    /// Variables that hold something at the start.
    fn given(&mut self, options: &Options) {
        for (number, value) in &options.variables {
            if let Err(fault) = self.give(*number, *value) {
                self.remarks.add(
                    Diagnostic::warning(
                        "variable-given",
                        format!("#{number} = {value} before the start: {}", fault.message),
                    )
                    .in_file(self.file.clone())
                    .remedy("give it to another variable"),
                );
            }
        }
        // What was there before the program is no change of it.
        self.out.clear();
        self.memory.kept_writes.clear();
    }

    /// The machine's answer for the line being executed.
    pub(crate) fn answer(&mut self, name: &str, value: f64) {
        self.memory.changes += 1;
        self.take_answer(name, value);
    }

    /// What is put in place of an answer where there is no machine to ask. Nothing changes by it as long as it is the same.
    pub(crate) fn assume(&mut self, name: &str, value: f64, assumed: bool) {
        let before = self.assumed.insert(name.to_owned(), value);
        if before.is_some_and(|before| before.to_bits() != value.to_bits()) {
            self.memory.changes += 1;
        }
        self.assumptions += u64::from(assumed);
        // Whether an interruption comes is asked at every line, and decides about no loop.
        self.assumed_since_jump |= assumed && name != crate::interruption::SIGNAL;
        self.take_answer(name, value);
    }

    fn take_answer(&mut self, name: &str, value: f64) {
        if name == "EQUIPMENT_TIMER.POWERED" {
            self.last_powered = Some(value);
        }
        self.answers.insert(name.to_owned(), value);
        self.take_awaited(name, value);
    }

    /// The line is done: the next one asks anew.
    #[inline]
    pub(crate) fn forget_answers(&mut self) {
        if !self.answers.is_empty() {
            self.answers.clear();
        }
    }

    /// What decides about the next blocks besides variables.
    pub(crate) fn fingerprint(&self) -> [f64; 12] {
        let switches = [
            self.inches,
            self.incremental,
            self.absolute_centres,
            self.return_to_r,
            self.cycle.is_some(),
            self.surface.is_some(),
            self.printer_open,
            self.shaping.is_plain(),
        ];
        let switches = switches.iter().fold(0, |bits, on| bits * 2 + u32::from(*on));
        [
            self.tip[0],
            self.tip[1],
            self.tip[2],
            f64::from(switches),
            f64::from(self.motion as u8) + 16.0 * f64::from(self.plane as u8) + 256.0 * f64::from(self.side as u8),
            self.feed.unwrap_or(-1.0),
            f64::from(self.tool.unwrap_or(u32::MAX)) + f64::from(self.offset.number) * 1e10,
            f64::from(self.h) * 1e4 + f64::from(self.d) + f64::from(self.length_sign) * 1e9,
            self.frame.origin()[0],
            self.frame.origin()[1],
            self.frame.origin()[2],
            self.modal.len() as f64 + self.surface.unwrap_or(self.revolutions) * 1e3,
        ]
    }

    /// The steps before the first block: the program begins, in the frame of G54.
    pub(crate) fn begin(&mut self, program_name: String) {
        self.program_name.clone_from(&program_name);
        self.emit(StepKind::Begin(Marker {
            level: Level::Program,
            name: program_name,
            entity: None,
            maximum_deviation: None,
            derived: false,
        }));
        self.first_frame();
    }

    /// The steps behind the last block: everything off, everything closed.
    pub(crate) fn finish(&mut self) {
        self.interrupt_compensation();
        self.turning = Turning::Stopped;
        self.say_spindle();
        self.set_coolant(CoolantState::default());
        if self.workingstep_open {
            self.workingstep_open = false;
            self.emit(StepKind::End(Level::Workingstep));
        }
        self.emit(StepKind::End(Level::Program));
    }

    #[inline]
    pub(crate) fn emit(&mut self, kind: StepKind) {
        self.push(Item::Step(self.origin, kind));
    }

    /// Notes a finding about this line; its text is made only the first time.
    pub(crate) fn note(
        &mut self,
        severity: Severity,
        code: &'static str,
        site: Site<'_>,
        at: usize,
        text: impl FnOnce() -> (String, String),
    ) {
        if !self.remarks.count_again(code) {
            let (message, remedy) = text();
            self.remarks.add(
                Diagnostic::new(severity, code, message)
                    .in_file(self.file.clone())
                    .at_line(site.number, site.column(at))
                    .remedy(remedy),
            );
        }
    }

    /// What is missing in the tables: a warning where it may be assumed, else an alarm.
    pub(crate) fn missing(&mut self, code: &'static str, site: Site<'_>, at: usize, what: &str, instead: &str) -> Outcome<()> {
        match self.tables.missing {
            Missing::Assume => {
                self.note(Severity::Warning, code, site, at, || {
                    (
                        format!("{what} is not in the tables: {instead} is assumed"),
                        "enter it before cutting".to_owned(),
                    )
                });
                Ok(())
            }
            Missing::Fail => Err(Fault::new(
                at,
                0,
                code,
                format!("{what} is not in the tables"),
                "enter it first",
            )),
        }
    }

    // ---- words

    /// Millimetres for each unit of the program.
    pub(crate) fn unit(&self) -> f64 {
        if self.inches { MM_PER_INCH } else { 1.0 }
    }

    /// The length a word means, mm.
    pub(crate) fn length(&mut self, letter: u8, word: Word, site: Site<'_>) -> f64 {
        let increment = self.profile.increment[usize::from(self.inches)];
        let mut value = word.value;
        if word.computed {
            if self.profile.rounds_words {
                value = round_to(value, increment);
            }
        } else if !word.has_point && self.profile.point_matters && value != 0.0 {
            let written = value;
            let counted = written * increment;
            let unit = if self.inches { "inch" } else { "mm" };
            let (read, other) = match self.options.whole_numbers {
                WholeNumbers::Units => (written, counted),
                WholeNumbers::Increments => (counted, written),
            };
            self.note(Severity::Warning, "no-decimal-point", site, word.at, || {
                let letter = char::from(letter);
                (
                    format!("{letter}{written} has no decimal point: read as {read} {unit}, other settings of the control read {other} {unit}"),
                    format!("write {letter}{written}. if {written} {unit} is meant"),
                )
            });
            value = read;
        }
        value * self.unit()
    }

    /// A whole number from a word.
    pub(crate) fn whole(word: Word, letter: char, highest: u32) -> Outcome<u32> {
        let value = if word.computed { libm::round(word.value) } else { word.value };
        if !(0.0..=f64::from(highest)).contains(&value) || libm::trunc(value) != value {
            return Err(Fault::new(
                word.at,
                0,
                "word-range",
                format!("expected a whole number from 0 to {highest} behind {letter}, found {value}"),
                "correct the number",
            ));
        }
        Ok(value as u32)
    }

    /// The program that a P word names.
    pub(crate) fn program_of(word: Word) -> Outcome<u32> {
        match named_program(word.value) {
            Some(number) => Ok(number),
            None => Self::whole(word, 'P', 99_999_999),
        }
    }

    // ---- the block

    /// Executes a block of words.
    pub(crate) fn execute(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<Flow> {
        if let Some(n) = block.take(b'N') {
            self.last_n = n.value as u32;
        }
        let said = self.read_codes(block, site)?;
        block.check_once()?;
        self.check_letters(block)?;
        let m_codes;
        let m_codes = match block.has_m() {
            true => {
                m_codes = block.m_codes();
                &m_codes.0[..m_codes.1]
            }
            false => &[],
        };

        self.set_feed(block, site)?;
        self.set_spindle(block, &said, m_codes, site)?;
        self.set_tool(block, site)?;
        for m in m_codes {
            self.before_motion(*m, block, site)?;
        }
        if let Some((mode, at)) = said.path {
            self.set_path_mode(mode, at, block, site)?;
        }
        if let Some((key, at)) = said.work {
            self.select_work_offset(key, at, site)?;
        }
        self.set_length_offset(block, said.length, site)?;
        self.set_side(block, said.side, site)?;

        match said.once {
            Some((once, at)) => self.once(once, at, block, site)?,
            None => self.move_tip(block, said.exact_stop, site)?,
        }
        self.note_unused(block, site);
        if let Some(fault) = self.compensation.fault.take() {
            return Err(fault);
        }
        if let Some(request) = self.turning_cycles.request.take() {
            return Ok(Flow::Contour(Box::new(request)));
        }
        if m_codes.is_empty() {
            return Ok(Flow::NextBlock);
        }
        self.go_on_to_the_end()?;
        self.after_motion(m_codes, block, site)
    }

    // ---- the rest

    fn note_unused(&mut self, block: &Block, site: Site<'_>) {
        if let Some((letter, word)) = block.unused() {
            self.note(Severity::Warning, "word-unused", site, word.at, || {
                (
                    format!("{letter}{} has no meaning in this block and is left out", word.value),
                    "take it out, or add the code it belongs to".to_owned(),
                )
            });
        }
        if let Some(at) = block.semicolon {
            self.note(Severity::Warning, "semicolon", site, at, || {
                (
                    "text behind ; is taken as a comment".to_owned(),
                    "give the block a line of its own".to_owned(),
                )
            });
        }
    }
}

/// A value rounded to the least input increment, half away from zero in the decimal sense: 1.2345 counts as a half although its binary
/// value lies below.
pub(crate) fn round_to(value: f64, increment: f64) -> f64 {
    // Multiplying by the reciprocal, a whole number, keeps decimals decimal: 1235 / 1000 is the double nearest to 1.235.
    let steps_per_unit = libm::round(1.0 / increment);
    let steps = value.abs() * steps_per_unit;
    let rounded = libm::floor(steps + 0.5 + steps.max(1.0) * 1e-10);
    libm::copysign(rounded / steps_per_unit, value)
}

pub(crate) fn missing_word(at: usize, code: &str, word: &str) -> Box<Fault> {
    Fault::new(at, 0, "word-missing", format!("{code} without {word}"), format!("add {word}"))
}

pub(crate) fn g_name(code: u16) -> String {
    match (code / 10, code % 10) {
        _ if code == u16::MAX => "such a G code".to_owned(),
        (whole, 0) => format!("G{whole}"),
        (whole, tenth) => format!("G{whole}.{tenth}"),
    }
}

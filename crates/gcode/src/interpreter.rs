//! What is in force while a program is read, and the order in which the parts of a block take effect.
//!
//! [`Interpreter::execute`] is the place where a block gets its meaning; moves are in `motion`, work and tool offsets in `offsets`.
//! Lengths in here are millimetres, X of a lathe is a radius: words are converted by [`Interpreter::length`] and the factors of the
//! profile's axis words, and nowhere else.

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
        if name == "EQUIPMENT_TIMER.POWERED" {
            self.last_powered = Some(value);
        }
        self.memory.changes += 1;
        self.answers.insert(name.to_owned(), value);
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

    /// Takes the block's G codes: modal ones are in force at once, others are handed on.
    fn read_codes(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<Said> {
        let mut said = Said::default();
        let mut groups = 0_u32;
        let mut index = 0;
        while let Some(code) = block.g(index) {
            index += 1;
            let at = code.at;
            let Some(meaning) = self.meaning(code.code) else {
                return Err(Fault::new(
                    at,
                    10,
                    "unknown-g",
                    format!("the {} control knows no {}", self.profile.name, g_name(code.code)),
                    "take it out, or choose another dialect",
                ));
            };
            if let Some(group) = meaning.group() {
                if groups >> group & 1 == 1 {
                    return Err(Fault::new(
                        at,
                        0,
                        "g-group",
                        format!("{} contradicts another code of its group in this block", g_name(code.code)),
                        "keep one of them, or make two blocks",
                    ));
                }
                groups |= 1 << group;
            }
            match meaning {
                G::Motion(motion) => {
                    self.motion = motion;
                    self.motion_said = true;
                    self.cycle = None;
                    self.turning_cycles.single = None;
                    said.motion = true;
                }
                G::Plane(plane) => self.plane = plane,
                G::Incremental(on) => self.incremental = on,
                G::AbsoluteCentres(on) => self.absolute_centres = on,
                G::Feed(mode) => {
                    if self.feed_mode != mode {
                        self.feed = None; // an F of another kind means another thing
                    }
                    self.feed_mode = mode;
                }
                G::Inches(on) => {
                    self.inches = on;
                    self.units_said = true;
                }
                G::Side(side) => said.side = Some((side, at)),
                G::Length(sign) => said.length = Some((sign, at)),
                G::Drill(kind) => {
                    said.drill = true;
                    self.begin_cycle(kind, code.code / 10, false);
                }
                G::SideDrill(kind) => {
                    said.drill = true;
                    self.begin_cycle(kind, code.code / 10, true);
                }
                G::Single(kind) => {
                    self.cycle = None;
                    self.motion_said = true;
                    if self.turning_cycles.single.is_none_or(|s| s.kind != kind) {
                        self.turning_cycles.single = Some(Single::new(kind));
                    }
                }
                G::DrillEnd => self.cycle = None,
                G::ReturnToR(on) => self.return_to_r = on,
                G::Work(number) => {
                    self.only_unshaped(code.code, at)?;
                    said.work = Some((WorkKey::Standard(number), at));
                }
                G::MoreWork => {
                    let Some(p) = block.take(b'P') else {
                        return Err(missing_word(at, "G54.1", "P"));
                    };
                    said.work = Some((WorkKey::More(Self::whole(p, 'P', 300)?.max(1) as u16), at));
                }
                G::Path(mode) => said.path = Some((mode, at)),
                G::SurfaceSpeed(on) => said.surface = Some(on),
                G::Polar(on) => self.set_polar(on),
                G::RotationOff => self.end_rotation(),
                G::Once(Once::ExactStop) => said.exact_stop = true,
                G::Once(once) => {
                    if matches!(
                        once,
                        Once::Home | Once::SecondReference | Once::SetPosition | Once::LocalShift
                    ) {
                        self.only_unshaped(code.code, at)?;
                    }
                    said.once = Some((once, at));
                }
                G::Harmless(why) => {
                    block.use_all_but(b"XYZUWIJKFSTHD");
                    self.note(Severity::Remark, "accepted", site, at, || {
                        (
                            format!("{} ({why}) is accepted and changes nothing here", g_name(code.code)),
                            String::new(),
                        )
                    });
                }
                G::NotYet(what) => return Err(Fault::not_there_yet(at, what)),
            }
        }
        // A motion code and a cycle in one block: the cycle is what the axis words are for, the code stays for afterwards.
        if said.motion && said.drill {
            said.motion = false;
        }
        Ok(said)
    }

    fn meaning(&self, code: u16) -> Option<G> {
        let codes = self.profile.g;
        codes.binary_search_by_key(&code, |(c, _)| *c).ok().map(|i| codes[i].1)
    }

    fn check_letters(&self, block: &Block) -> Outcome<()> {
        match block.outside(self.known_letters) {
            None => Ok(()),
            Some((letter, word)) => Err(Fault::new(
                word.at,
                9,
                "unknown-letter",
                format!("the {} control knows no word {letter}", self.profile.name),
                "take it out, or choose another dialect",
            )),
        }
    }

    fn set_feed(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        if self.feed_mode == FeedMode::InverseTime {
            self.feed = None; // must stand in every block
        }
        let Some(f) = block.take(b'F') else { return Ok(()) };
        if f.value < 0.0 {
            return Err(Fault::new(f.at, 0, "feed-negative", "a feed cannot be negative", "correct F"));
        }
        if f.value == 0.0 {
            self.feed = None;
            self.note(Severity::Warning, "feed-zero", site, f.at, || {
                (
                    "F0 takes the feed away".to_owned(),
                    "write a feed before the next cutting move".to_owned(),
                )
            });
            return Ok(());
        }
        self.last_f = Some(f.value * self.unit());
        self.feed = Some(match self.feed_mode {
            FeedMode::PerMinute => f.value * self.unit() / 60.0,
            FeedMode::PerRevolution => f.value * self.unit(),
            FeedMode::InverseTime => 60.0 / f.value,
        });
        Ok(())
    }

    /// The feed in force.
    pub(crate) fn feed(&self, at: usize) -> Outcome<Feed> {
        let Some(feed) = self.feed else {
            let remedy = match self.feed_mode {
                FeedMode::PerMinute => "write F, the feed a minute",
                FeedMode::PerRevolution => "write F, the feed a revolution",
                FeedMode::InverseTime => "with G93 every cutting block has its own F",
            };
            return Err(Fault::new(at, 11, "no-feed", "a cutting move without a feed", remedy));
        };
        Ok(match self.feed_mode {
            FeedMode::PerMinute => Feed::PerTime(MmPerSec(feed)),
            FeedMode::PerRevolution => {
                if self.turning == Turning::Stopped && !self.rigid_tapping {
                    return Err(Fault::new(
                        at,
                        0,
                        "spindle-stopped",
                        "a feed per revolution while the spindle stands: the axes would never move",
                        "start the spindle with M3 or M4 first",
                    ));
                }
                Feed::PerRevolution(Millimetres(feed))
            }
            FeedMode::InverseTime => Feed::WholeMove(units::Seconds(feed)),
        })
    }

    // ---- spindle and coolant

    fn set_spindle(&mut self, block: &mut Block, said: &Said, m_codes: &[Code], site: Site<'_>) -> Outcome<()> {
        if let Some(on) = said.surface {
            match (on, self.surface) {
                (true, None) => self.surface = Some(self.surface_speed),
                (false, Some(_)) => {
                    // G97 without S goes on at the speed that turns now.
                    self.revolutions = self.spindle.revolutions(Millimetres(self.tip[0])).0;
                    self.surface = None;
                }
                _ => {}
            }
            if on
                && !self.profile.turning
                && let Some(d) = block.take(b'D')
            {
                self.spindle_limit = Some(Rpm(d.value.max(0.0)));
            }
        }
        let limits = matches!(said.once, Some((Once::SetPosition, _)));
        if let Some(s) = block.take(b'S') {
            if s.value < 0.0 {
                return Err(Fault::new(
                    s.at,
                    0,
                    "speed-negative",
                    "a spindle speed cannot be negative",
                    "use M4 to turn the other way",
                ));
            }
            self.last_s = Some(s.value);
            if limits {
                self.spindle_limit = Some(Rpm(s.value));
            } else if self.surface.is_some() {
                // m/min, or ft/min with G20
                self.surface_speed = s.value * if self.inches { 304.8 } else { 1000.0 } / 60.0;
                self.surface = Some(self.surface_speed);
            } else {
                self.revolutions = s.value;
            }
        }
        let mut oriented = self.spindle == SpindleState::Oriented;
        for m in m_codes {
            match self.m_meaning(*m)? {
                M::Clockwise => self.start_spindle(Turning::Clockwise, m.at, site),
                M::Counterclockwise => self.start_spindle(Turning::Counterclockwise, m.at, site),
                M::SpindleStop => self.turning = Turning::Stopped,
                M::RigidTapping => self.rigid_tapping = true,
                M::Orient => {
                    self.orient();
                    oriented = true;
                }
                _ => {}
            }
        }
        if self.turning != Turning::Stopped && self.surface.is_some() && self.spindle_limit.is_none() {
            let limit = self.options.spindle_limit;
            self.spindle_limit = Some(limit);
            self.note(Severity::Warning, "no-spindle-limit", site, 0, || {
                (
                    format!("surface speed without a highest spindle speed: {:.0} is assumed", limit),
                    "write G50 S before G96".to_owned(),
                )
            });
        }
        // An oriented spindle stays so until something turns it.
        if !(oriented && self.turning == Turning::Stopped) {
            self.say_spindle();
        }
        Ok(())
    }

    fn start_spindle(&mut self, way: Turning, at: usize, site: Site<'_>) {
        self.turning = way;
        self.rigid_tapping = false;
        if self.surface.unwrap_or(self.revolutions) == 0.0 {
            self.note(Severity::Warning, "no-spindle-speed", site, at, || {
                (
                    "the spindle is started without a speed".to_owned(),
                    "write S before M3 or M4".to_owned(),
                )
            });
        }
    }

    /// Tells the spindle's state when it differs from what was told last.
    pub(crate) fn say_spindle(&mut self) {
        let mode = match self.surface {
            Some(speed) => SpindleMode::Surface {
                speed: MmPerSec(speed),
                limit: self.spindle_limit.unwrap_or(self.options.spindle_limit),
            },
            None => SpindleMode::Revolutions(match self.spindle_limit {
                Some(limit) => Rpm(self.revolutions).min(limit),
                None => Rpm(self.revolutions),
            }),
        };
        let state = match self.turning {
            Turning::Stopped => SpindleState::Stopped,
            Turning::Clockwise => SpindleState::Clockwise(mode),
            Turning::Counterclockwise => SpindleState::Counterclockwise(mode),
        };
        if state != self.spindle {
            self.spindle = state;
            self.emit(StepKind::Spindle(state));
        }
    }

    fn set_coolant(&mut self, state: CoolantState) {
        if state != self.coolant {
            self.coolant = state;
            self.emit(StepKind::Coolant(state));
        }
    }

    // ---- M codes

    fn m_meaning(&self, m: Code) -> Outcome<M> {
        let codes = self.profile.m;
        match codes.binary_search_by_key(&m.code, |(c, _)| *c) {
            Ok(i) => Ok(codes[i].1),
            Err(_) if m.code == 97 && self.macros.local_subprograms => Ok(M::LocalCall),
            Err(_) if matches!(m.code, 96 | 97) && self.macros.fanuc_ranges => Err(Fault::new(
                m.at,
                113,
                "not-available",
                format!(
                    "M{}: interruption macros are not available, parameter 6003.7 (MUS) is 0",
                    m.code
                ),
                "set 6003.7, or call the macro where it is needed, by G65",
            )),
            Err(_) => Err(Fault::new(
                m.at,
                0,
                "unknown-m",
                format!("the {} control knows no M{}", self.profile.name, m.code),
                "take it out, or choose another dialect",
            )),
        }
    }

    fn before_motion(&mut self, m: Code, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        self.last_m = m.code;
        let was = self.coolant;
        match self.m_meaning(m)? {
            M::Mist => self.set_coolant(CoolantState { mist: true, ..was }),
            M::Flood => self.set_coolant(CoolantState { flood: true, ..was }),
            M::ThroughCoolant => self.set_coolant(CoolantState { through: true, ..was }),
            M::CoolantOff => self.set_coolant(CoolantState::default()),
            M::ToolChange if !self.profile.tool_change_after_motion => self.change_tool(m.at, block, site)?,
            M::Harmless(why) => {
                block.use_all_but(b"XYZUWIJKFSTHD");
                self.note(Severity::Remark, "accepted", site, m.at, || {
                    (
                        format!("M{} ({why}) is accepted and changes nothing here", m.code),
                        String::new(),
                    )
                });
            }
            M::Call | M::Return | M::LocalCall => block.use_all_but(b"XYZUWIJKFSTHD"),
            _ => {}
        }
        Ok(())
    }

    fn after_motion(&mut self, m_codes: &[Code], block: &mut Block, site: Site<'_>) -> Outcome<Flow> {
        let mut flow = Flow::NextBlock;
        for m in m_codes {
            match self.m_meaning(*m)? {
                M::ToolChange if self.profile.tool_change_after_motion => self.change_tool(m.at, block, site)?,
                M::Stop => {
                    self.moved_since_stop = false;
                    self.emit(StepKind::Stop(StopKind::Program));
                }
                M::OptionalStop => self.push(Item::Ask(self.origin, Question::OptionalStop)),
                M::End => {
                    self.finish();
                    flow = Flow::End;
                }
                M::Call => flow = self.call(m.at, block)?,
                M::LocalCall => {
                    let Some(p) = block.take(b'P') else {
                        return Err(missing_word(m.at, "M97", "P, the sequence number to go on from,"));
                    };
                    let times = block.take(b'L').map(|l| Self::whole(l, 'L', 9999)).transpose()?;
                    flow = Flow::LocalCall {
                        block: Self::whole(p, 'P', 99_999)?,
                        times: times.unwrap_or(1),
                        at: m.at,
                    };
                }
                M::Return => {
                    let to = block.take(b'P').map(|p| Self::whole(p, 'P', 99_999)).transpose()?;
                    flow = Flow::Return { to, at: m.at };
                }
                _ => {}
            }
        }
        Ok(flow)
    }

    /// M98: `P1234`, `P1234 L3`, or count and number in one word, `P31234`.
    fn call(&self, at: usize, block: &mut Block) -> Outcome<Flow> {
        let Some(p) = block.take(b'P') else {
            return Err(Fault::new(
                at,
                76,
                "word-missing",
                "M98 without P",
                "write the number of the subprogram: M98 P1234",
            ));
        };
        let number = Self::program_of(p)?;
        let repeats = block.take(b'L').map(|l| Self::whole(l, 'L', 9999)).transpose()?;
        let (program, times) = match repeats {
            Some(times) => (number, times),
            None if number > 9999 && !is_named(number) => (number % 10_000, number / 10_000),
            None => (number, 1),
        };
        Ok(Flow::Call { program, times, at })
    }

    // ---- tools

    fn set_tool(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(t) = block.take(b'T') else { return Ok(()) };
        if self.profile.turning {
            let value = Self::whole(t, 'T', 9999)?;
            self.trace.tool = Some(value);
            let (station, offset) = (value / 100, value % 100);
            if station != 0 && self.tool != Some(station) {
                let words = self.tool_words(block, site);
                self.put_tool(station, words, t.at, site)?;
            }
            return self.select_turning_offset(offset, t.at, site);
        }
        let number = Self::whole(t, 'T', 99_999_999)?;
        self.trace.tool = Some(number);
        let words = self.tool_words(block, site);
        self.preselected = Some((number, words));
        Ok(())
    }

    fn change_tool(&mut self, at: usize, block: &Block, site: Site<'_>) -> Outcome<()> {
        let Some((number, mut words)) = self.preselected.clone() else {
            return Err(Fault::new(
                at,
                0,
                "no-tool",
                "M6 without a tool: no T word came before",
                "write T and the tool's number before M6",
            ));
        };
        if words.is_empty() {
            words = self.tool_words(block, site);
        }
        self.put_tool(number, words, at, site)
    }

    fn put_tool(&mut self, number: u32, words: String, at: usize, site: Site<'_>) -> Outcome<()> {
        let entry = self.tables.tools.get(&ToolNumber(number)).cloned();
        if entry.is_none() && number != 0 {
            self.missing("missing-tool", site, at, &format!("tool {number}"), "a tool of that number")?;
        }
        let entry = entry.unwrap_or_default();
        // A tool is never changed with the spindle turning, whatever the program says.
        if !self.profile.turning {
            self.turning = Turning::Stopped;
            self.say_spindle();
        }
        let name = if words.is_empty() { entry.name } else { words };
        self.begin_workingstep(step_name(number, &name));
        self.comments.clear();
        self.tool = Some(number);
        self.emit(StepKind::Tool(ToolCall {
            number: ToolNumber(number),
            name,
            diameter: entry.diameter,
        }));
        Ok(())
    }

    /// The program's words for a tool: the comment of this block, or the first of the comment lines right before.
    fn tool_words(&self, block: &Block, site: Site<'_>) -> String {
        match block.comment {
            Some((start, end)) => characters(&site.text[start..end]).trim().to_owned(),
            None => self.comments.first().cloned().unwrap_or_default(),
        }
    }

    /// Takes note of a line that holds only a comment, or nothing.
    pub(crate) fn comment_line(&mut self, block: &Block, site: Site<'_>) {
        const MOST: usize = 8;
        let Some((start, end)) = block.comment else { return };
        if self.show_message(block, site) {
            return;
        }
        let bytes = &site.text[start..end];
        if self.comments_closed {
            self.comments.clear();
            self.comments_closed = false;
        }
        if self.comments.len() < MOST {
            let text = characters(&bytes[..bytes.len().min(200)]);
            let text = text.trim();
            if !text.is_empty() {
                self.comments.push(text.to_owned());
            }
        }
    }

    /// Tells the operator what a `(MSG,...)` comment says; false when the block has none.
    pub(crate) fn show_message(&mut self, block: &Block, site: Site<'_>) -> bool {
        let Some((start, end)) = block.comment.filter(|_| self.profile.message_comments) else {
            return false;
        };
        let bytes = &site.text[start..end];
        let is_message = bytes.get(..4).is_some_and(|b| b.eq_ignore_ascii_case(b"MSG,"));
        if is_message {
            self.emit(StepKind::Message(characters(&bytes[4..]).trim().to_owned()));
        }
        is_message
    }

    /// A line that is no comment was met: the next comment line begins a new run.
    pub(crate) fn close_comments(&mut self) {
        self.comments_closed = true;
    }

    /// The tip moves: comments before it are no longer about the next tool.
    pub(crate) fn forget_comments(&mut self) {
        if !self.comments.is_empty() {
            self.comments.clear();
        }
    }

    // ---- structure

    pub(crate) fn begin_workingstep(&mut self, name: String) {
        if self.workingstep_open {
            self.emit(StepKind::End(Level::Workingstep));
        }
        self.workingstep_open = true;
        self.emit(StepKind::Begin(Marker {
            level: Level::Workingstep,
            name,
            entity: None,
            maximum_deviation: None,
            derived: true,
        }));
    }

    /// Moves before the first tool call are a workingstep too, named after the program.
    pub(crate) fn ensure_workingstep(&mut self) {
        if !self.workingstep_open {
            self.begin_workingstep(self.program_name.clone());
        }
    }

    // ---- the rest

    fn set_path_mode(&mut self, mode: PathMode, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mode = match mode {
            PathMode::Tolerance(_) if self.profile.tolerance_word => match block.take(b'P') {
                Some(p) if p.value < 0.0 => {
                    return Err(Fault::new(at, 0, "word-range", "a tolerance cannot be negative", "correct P"));
                }
                Some(p) => PathMode::Tolerance(Some(Millimetres(self.length(b'P', p, site)))),
                None => PathMode::Tolerance(None),
            },
            other => other,
        };
        if mode != self.path_mode {
            self.path_mode = mode;
            self.emit(StepKind::PathMode(mode));
        }
        Ok(())
    }

    fn once(&mut self, once: Once, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        match once {
            Once::Rotate => self.begin_rotation(at, block, site),
            Once::Scale => self.begin_scale(at, block, site),
            Once::ScaleOff => {
                self.end_scale();
                Ok(())
            }
            Once::Mirror => self.begin_mirror(at, block, site),
            Once::MirrorOff => {
                self.end_mirror(block);
                Ok(())
            }
            Once::Dwell => self.dwell(at, block, site),
            Once::SetOffset => self.set_offset(at, block, site),
            Once::Home => self.home(at, [0.0; 3], block, site),
            Once::SecondReference => self.second_reference(at, block, site),
            Once::LocalShift => self.local_shift(at, block, site),
            Once::MachineCoordinates => self.machine_move(at, block, site),
            Once::SetPosition => self.set_position(block, site),
            Once::ClearPosition => {
                self.clear_position();
                Ok(())
            }
            Once::ExactStop => Ok(()), // handled with the move
            Once::Skip => self.skip(at, block, site),
            Once::Contour(cycle) => self.contour_cycle(cycle, at, block, site),
            Once::PeckColumns(deep) => self.peck_cycle(deep, at, block, site),
            Once::ThreadCycle => self.thread_cycle(at, block, site),
        }
    }

    fn dwell(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let seconds = if let Some(p) = block.take(b'P') {
            if p.has_point && !self.profile.dwell_point_too {
                self.note(Severity::Warning, "dwell-point", site, p.at, || {
                    (
                        format!(
                            "P with a point is read as {} seconds; some controls read milliseconds or alarm",
                            p.value
                        ),
                        "write P without a point for milliseconds".to_owned(),
                    )
                });
            }
            p.value * self.dwell_factor(p)
        } else if let Some(x) = block.take(b'X').or_else(|| block.take(b'U')) {
            x.value
        } else {
            return Err(missing_word(at, "G4", "P"));
        };
        if seconds < 0.0 {
            return Err(Fault::new(
                at,
                0,
                "dwell-negative",
                "a dwell cannot be negative",
                "correct the time",
            ));
        }
        if seconds > 0.0 {
            self.emit(StepKind::Dwell(units::Seconds(seconds)));
        }
        Ok(())
    }

    /// Seconds for each unit of a dwell's P.
    pub(crate) fn dwell_factor(&self, p: Word) -> f64 {
        if p.has_point && !self.profile.dwell_point_too {
            1.0
        } else {
            self.profile.dwell_unit
        }
    }

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

/// `T1 3" FACE MILL`; a comment that begins with the tool's number is name enough.
fn step_name(number: u32, words: &str) -> String {
    let call = format!("T{number}");
    match words.strip_prefix(&call) {
        Some(rest) if !rest.starts_with(|c: char| c.is_ascii_digit()) => words.to_owned(),
        _ if words.is_empty() => call,
        _ => format!("{call} {words}"),
    }
}

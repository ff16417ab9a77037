//! Cutter-location files: what a CAM system gives to a post-processor, as NX and others write it in the words of APT.
//!
//! [`AptProgram`] is a [`plan::ProgramStream`]: it gives tool calls, spindle, coolant, lines, arcs and expanded drilling cycles, a
//! workingstep for each `TOOL PATH`. Places are those of the tool tip in the set-up G54. A file that needs more than three axes, or motion
//! that only an APT processor can work out (`GOFWD`, `TLON`), is refused with its line; statements that nobody here knows are
//! remarked once a kind.
//!
//! Read on: [`statement`] for the text, `acting` for what statements do, `cycle` for drilling.

mod acting;
mod cycle;
pub mod statement;

use plan::{
    Alarm, Answer, ByteSource, CoolantState, Diagnostic, Diagnostics, FileId, FrameChange, Level, Marker, Next, Origin, Place,
    ProgramStream, Question, ReadError, Severity, SpindleState, Step, StepKind, Tables, ToolOffset,
};
use std::collections::{BTreeMap, VecDeque};
use units::{Machine, Point, Setup, StepId, ToolNumber, Transform};

/// A cutter-location file as a stream.
pub struct AptProgram {
    name: String,
    text: String,
    tables: Tables,
    run: Run,
}

/// Everything that a rewind forgets.
struct Run {
    at: usize,
    line: u32,
    begun: bool,
    ended: bool,
    last_step: u32,
    queue: VecDeque<(Origin, StepKind)>,
    origin: Origin,
    asking: bool,
    alarm: Option<Alarm>,
    found: Diagnostics,
    state: State,
}

/// What is in force.
struct State {
    /// Millimetres in the file's unit of length.
    unit: f64,
    gauge: Point<Machine>,
    first_system: Option<Transform<Setup, Setup>>,
    frame: Transform<Machine, Setup>,
    offset: ToolOffset,
    tool: Option<ToolNumber>,
    tool_name: String,
    tool_words: String,
    diameter: Option<f64>,
    numbers: BTreeMap<String, u32>,
    tool_due: bool,
    rapid: bool,
    feed: Option<Feed>,
    spindle: SpindleState,
    /// The last speed, for `SPINDL/ON`.
    speed: SpindleState,
    coolant: CoolantState,
    circle: Option<Circle>,
    cycle: Option<cycle::Cycle>,
    open: bool,
}

/// A feed in the file's words.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Feed {
    /// mm/s.
    PerTime(f64),
    /// mm.
    PerRevolution(f64),
}

/// The circle that the next place is reached on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Circle {
    centre: [f64; 3],
    axis: [f64; 3],
    radius: f64,
    turns: f64,
}

/// Why a statement cannot be done.
struct Fault {
    code: &'static str,
    message: String,
    remedy: &'static str,
}

impl AptProgram {
    /// Opens a file; `name` is what messages call it.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn open(mut source: Box<dyn ByteSource>, name: &str, tables: Tables) -> Result<AptProgram, ReadError> {
        let length = usize::try_from(source.length()).map_err(|_| ReadError("it does not fit into memory".into()))?;
        let mut bytes = vec![0; length];
        let count = source.read_at(0, &mut bytes)?;
        bytes.truncate(count);
        // Names may be in any old encoding; what the tool does is in ASCII.
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let run = Run::new(&tables);
        Ok(AptProgram {
            name: name.to_string(),
            text,
            tables,
            run,
        })
    }

    /// True when a file says that it is in inches.
    pub fn in_inches(&self) -> bool {
        let (mut at, mut line) = (0, 1);
        while let Some(statement) = statement::next(&self.text, &mut at, &mut line) {
            if statement.major == "UNITS" {
                return statement.words.iter().any(|word| word.to_ascii_uppercase().starts_with("IN"));
            }
        }
        false
    }

    /// True when these first bytes of a file look like a cutter-location file: statements of it with their slash, and no words of G-code.
    pub fn looks_like(head: &[u8]) -> bool {
        let text = String::from_utf8_lossy(head);
        let mut known = 0;
        for line in text.lines().take(60).map(str::trim_start) {
            let mut letters = line.chars();
            let is_code = letters.next().is_some_and(|c| c == '%' || c.is_ascii_alphabetic());
            if is_code && (line.starts_with('%') || letters.next().is_some_and(|c| c.is_ascii_digit())) {
                return false;
            }
            // `GOTO` alone is a word of macro programs too.
            let major = line.split_once('/').map_or("", |(major, _)| major.trim_end());
            known += u32::from(acting::MAJORS.contains(&major.to_ascii_uppercase().as_str()));
        }
        known >= 2 || (known == 1 && text.lines().count() < 60)
    }

    fn begin(&mut self) {
        self.run.begun = true;
        let g54 = self.tables.work_offsets.get("G54").copied();
        self.run.state.frame = g54.unwrap_or(Transform::IDENTITY);
        self.say(StepKind::Begin(marker(Level::Program, self.name.clone())));
        self.say(StepKind::Frame(FrameChange {
            name: "G54".into(),
            machine_from_setup: self.run.state.frame,
            assumed: g54.is_none(),
        }));
        if g54.is_none() {
            let message = "the machine has no work offset G54: its origin is assumed";
            self.note(Severity::Warning, "work-offset", message, "enter G54");
        }
    }

    fn end(&mut self) {
        self.run.ended = true;
        if self.run.state.spindle != SpindleState::Stopped {
            self.say(StepKind::Spindle(SpindleState::Stopped));
        }
        if self.run.state.coolant != CoolantState::default() {
            self.say(StepKind::Coolant(CoolantState::default()));
        }
        if self.run.state.open {
            self.say(StepKind::End(Level::Workingstep));
        }
        self.say(StepKind::End(Level::Program));
    }

    fn say(&mut self, kind: StepKind) {
        let origin = self.run.origin;
        self.run.queue.push_back((origin, kind));
    }

    fn note(&mut self, severity: Severity, code: &'static str, message: &str, remedy: &str) {
        let line = match self.run.origin.place {
            Place::Text { line, .. } => line,
            _ => 1,
        };
        self.run.found.add(
            Diagnostic::new(severity, code, message)
                .in_file(self.name.clone())
                .at_line(line, 1)
                .remedy(remedy),
        );
    }
}

fn marker(level: Level, name: String) -> Marker {
    Marker {
        level,
        name,
        entity: None,
        maximum_deviation: None,
        derived: false,
    }
}

impl Run {
    fn new(tables: &Tables) -> Self {
        Run {
            at: 0,
            line: 1,
            begun: false,
            ended: false,
            last_step: 0,
            queue: VecDeque::new(),
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            asking: false,
            alarm: None,
            found: Diagnostics::new(),
            state: State {
                unit: 1.0,
                gauge: tables.position,
                first_system: None,
                frame: Transform::IDENTITY,
                offset: ToolOffset::NONE,
                tool: None,
                tool_name: String::new(),
                tool_words: String::new(),
                diameter: None,
                numbers: BTreeMap::new(),
                tool_due: false,
                rapid: false,
                feed: None,
                spindle: SpindleState::Stopped,
                speed: SpindleState::Stopped,
                coolant: CoolantState::default(),
                circle: None,
                cycle: None,
                open: false,
            },
        }
    }
}

impl ProgramStream for AptProgram {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        if self.run.asking {
            match answer {
                None => return Next::Ask(Question::OptionalStop),
                Some(answer) => {
                    self.run.asking = false;
                    if answer == Answer::Truth(true) {
                        self.say(StepKind::Stop(plan::StopKind::Optional));
                    }
                }
            }
        }
        if !self.run.begun {
            self.begin();
        }
        loop {
            if let Some((origin, kind)) = self.run.queue.pop_front() {
                self.run.last_step = self.run.last_step.saturating_add(1);
                let id = StepId(self.run.last_step);
                return Next::Step(Step { id, origin, kind });
            }
            if let Some(alarm) = &self.run.alarm {
                return Next::Alarm(alarm.clone());
            }
            if self.run.ended {
                return Next::End;
            }
            let Some(statement) = statement::next(&self.text, &mut self.run.at, &mut self.run.line) else {
                self.end();
                continue;
            };
            self.run.origin.place = Place::Text {
                line: statement.line,
                start: statement.span.0,
                length: statement.span.1,
            };
            match self.act(&statement) {
                Ok(false) => {}
                Ok(true) => {
                    self.run.asking = true;
                    // What was said before comes first; nothing was, or the queue would not have been empty.
                    return Next::Ask(Question::OptionalStop);
                }
                Err(fault) => {
                    let found = Diagnostic::error(fault.code, fault.message)
                        .in_file(self.name.clone())
                        .at_line(statement.line, 1)
                        .remedy(fault.remedy);
                    self.run.found.add(found.clone());
                    self.run.alarm = Some(Alarm::from(found));
                }
            }
        }
    }

    fn rewind(&mut self) {
        self.run = Run::new(&self.tables);
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.run.found.as_slice()
    }

    fn file_name(&self, _file: FileId) -> &str {
        &self.name
    }
}

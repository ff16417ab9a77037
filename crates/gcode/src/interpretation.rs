//! A program interpreted and nothing else: no machine, no planner, no files. What `macro run` shows and generated macros are proven with.
//!
//! [`interpret`] is a pure function from a program's text and a [`Setup`] to an [`Interpretation`]. The machine's answers are the
//! program's own count: an axis is where the program has sent it, and time passes by dwells, feeds and a millisecond a block.

use crate::macro_b::Value;
use crate::parameters::Parameters;
use crate::profile::{self, Profile};
use crate::program::{GcodeProgram, Options};
use plan::{Alarm, Answer, Diagnostic, MemorySource, Next, NoOtherFiles, ProgramStream, Question, Resolver, Tables};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a program is started with, as `reference/macro-cases.md` writes it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Setup {
    /// What kind of machine: it chooses the family of controls unless `control` names one.
    pub machine: MachineKind,
    /// The unit before the first G20 or G21.
    pub units: Unit,
    /// Control parameters by number, `"6050"`, or number and bit, `"6001.5"`.
    pub params: BTreeMap<String, f64>,
    /// Variables set before the start, by number; system variables too.
    pub vars: BTreeMap<u32, Option<f64>>,
    /// A family of controls by its name in [`crate::PROFILES`].
    pub control: Option<String>,
    /// Block-skip switches that are on: 1 to 9.
    pub block_skip: Vec<u8>,
    /// The program comes from a line (DNC): its branches and loops are alarm 123.
    pub by_line: bool,
    /// With M96 in force the interruption signal is asked for before each block: at which of these askings, from 1, it is on.
    pub interrupts: Vec<u32>,
    /// Blocks in a row without a move after which it counts as endless.
    pub most_blocks_at_rest: Option<u64>,
}

/// Mill or lathe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MachineKind {
    /// Axes X Y Z, G90 and G91.
    #[default]
    Mill,
    /// Axes X Z, X in diameter, U and W incremental: G-code system A.
    Lathe,
}

/// Unit of lengths in a program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Millimetres, least increment 0.001.
    #[default]
    Mm,
    /// Inches, least increment 0.0001.
    Inch,
}

/// What became of a program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Interpretation {
    /// What stopped it; `None` when it came to its end.
    pub alarm: Option<ControlAlarm>,
    /// The same with place, values and remedy.
    pub fault: Option<FaultReport>,
    /// Variables at the end, locals those of the main program: all that hold something, and all that were given or written. A number
    /// that is not there is vacant.
    pub vars: BTreeMap<u32, Option<f64>>,
    /// Every axis move: 0 to 3 for G0 to G3, and the end point in the work system, in the program's unit; X of a lathe as diameter.
    pub path: Vec<Vec<f64>>,
    /// Lines printed by DPRNT and BPRNT.
    pub output: Vec<String>,
    /// Names given by SETVN.
    pub names: BTreeMap<u32, String>,
    /// Stops by `#3006` in order.
    pub stops: Vec<Stop>,
    /// Last T value passed to the turret or magazine.
    pub tool: Option<u32>,
    /// The unit in force at the end.
    pub unit: Unit,
    /// What was found odd or assumed on the way.
    pub remarks: Vec<Diagnostic>,
}

/// An alarm as the control counts them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ControlAlarm {
    /// Whose number it is.
    #[serde(rename = "type")]
    pub kind: AlarmKind,
    /// `PS`: the control's number, 0 for a fault that controls have no number for. `MACRO`: n of `#3000=n`.
    pub number: u32,
    /// The text of `#3000=n(text)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

/// Whose number an alarm has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum AlarmKind {
    /// The control's.
    #[serde(rename = "PS")]
    Program,
    /// `#3000`'s.
    #[serde(rename = "MACRO")]
    Macro,
}

/// Where and why a program stopped.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultReport {
    /// A short name of the kind, stable for scripts.
    pub code: String,
    /// What was found, with the values.
    pub text: String,
    /// What to do.
    pub remedy: String,
    /// O number of the program being executed; 0 when it has none.
    pub program: u32,
    /// The last sequence number executed; 0 when there was none.
    pub block: u32,
    /// The file's name.
    pub file: String,
    /// 1-based line of the file.
    pub line: u32,
    /// 1-based column.
    pub column: u32,
}

/// A stop by `#3006=n(text)`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stop {
    /// n.
    pub number: u32,
    /// The text.
    pub message: String,
}

/// Interprets a program that stands in one text.
pub fn interpret(text: &str, setup: &Setup) -> Interpretation {
    match setup.parameters().and_then(|_| setup.profile()) {
        Ok(profile) => {
            let source = Box::new(MemorySource(text.as_bytes().to_vec()));
            let options = Options {
                trace: true,
                ..setup.options()
            };
            let opened = GcodeProgram::open(source, "program", profile, Box::new(NoOtherFiles), Tables::empty(), options);
            match opened {
                Ok(program) => finish(program, &setup.interrupts),
                Err(found) => Interpretation::stopped(&Alarm::from(*found), (0, 0)),
            }
        }
        Err(found) => Interpretation::stopped(&Alarm::from(found), (0, 0)),
    }
}

/// Interprets a program in a file; `resolver` finds the other programs it calls.
///
/// # Errors
/// It cannot be read, or the set-up names an unknown control or parameter.
pub fn interpret_file(
    source: Box<dyn plan::ByteSource>,
    name: &str,
    profile: &'static Profile,
    resolver: Box<dyn Resolver>,
    setup: &Setup,
) -> Result<Interpretation, Box<Diagnostic>> {
    setup.parameters().map_err(Box::new)?;
    let options = Options {
        trace: true,
        ..setup.options()
    };
    GcodeProgram::open(source, name, profile, resolver, Tables::empty(), options)
        .map(|program| finish(program, &setup.interrupts))
}

impl Setup {
    /// The family of controls it means.
    ///
    /// # Errors
    /// `control` names none.
    pub fn profile(&self) -> Result<&'static Profile, Diagnostic> {
        let name = match (&self.control, self.machine) {
            (Some(name), _) => name.as_str(),
            (None, MachineKind::Mill) => "fanuc-mill",
            (None, MachineKind::Lathe) => "fanuc-lathe",
        };
        profile::by_name(name).ok_or_else(|| {
            let known: Vec<&str> = profile::PROFILES.iter().map(|p| p.name).collect();
            Diagnostic::error("unknown-control", format!("control '{name}' is unknown"))
                .remedy(format!("known are {}", known.join(", ")))
        })
    }

    /// Its control parameters.
    ///
    /// # Errors
    /// A key is no parameter.
    pub fn parameters(&self) -> Result<Parameters, Diagnostic> {
        let mut all = Parameters::default();
        for (key, value) in &self.params {
            all.set(key, *value)
                .map_err(|message| Diagnostic::error("unknown-parameter", message))?;
        }
        Ok(all)
    }

    /// What it says to the reader; parameters that [`Setup::parameters`] refuses count for nothing.
    pub fn options(&self) -> Options {
        Options {
            parameters: self.parameters().unwrap_or_default(),
            variables: self.vars.iter().filter_map(|(n, v)| v.map(|v| (*n, v))).collect(),
            inches: self.units == Unit::Inch,
            by_line: self.by_line,
            block_skip: self.block_skip.iter().fold(0, |bits, n| bits | 1 << (n.clamp(&1, &9) - 1)),
            most_blocks_at_rest: self.most_blocks_at_rest.unwrap_or(Options::default().most_blocks_at_rest),
            ..Options::default()
        }
    }
}

impl Interpretation {
    fn stopped(alarm: &Alarm, place: (u32, u32)) -> Self {
        Interpretation {
            alarm: Some(control_alarm(alarm)),
            fault: Some(fault_report(alarm, place)),
            vars: BTreeMap::new(),
            path: Vec::new(),
            output: Vec::new(),
            names: BTreeMap::new(),
            stops: Vec::new(),
            tool: None,
            unit: Unit::Mm,
            remarks: Vec::new(),
        }
    }
}

/// Runs a program to its end and takes down what it did.
fn finish(mut program: GcodeProgram, interrupts: &[u32]) -> Interpretation {
    let mut answer = None;
    let mut asked = 0;
    let alarm = loop {
        match program.next(answer.take()) {
            Next::Step(_) => {}
            Next::Ask(Question::Number(name)) if name == crate::interruption::SIGNAL => {
                asked += 1;
                answer = Some(Answer::Number(Some(f64::from(u8::from(interrupts.contains(&asked))))));
            }
            Next::Ask(question) => answer = Some(of_its_own(&question)),
            Next::End => break None,
            Next::Alarm(alarm) => break Some(alarm),
        }
    };
    let unit = if program.in_inches() { Unit::Inch } else { Unit::Mm };
    let remarks = program.diagnostics().to_vec();
    let place = program.place();
    let traced = program.into_trace();
    let number = |value: Value| match value {
        Value::Vacant => None,
        Value::Number(n) => Some(n),
    };
    Interpretation {
        alarm: alarm.as_ref().map(control_alarm),
        fault: alarm.as_ref().map(|a| fault_report(a, place)),
        vars: traced.variables.into_iter().map(|(n, v)| (n, number(v))).collect(),
        path: traced.path,
        output: traced.output,
        names: traced.names,
        stops: traced.stops,
        tool: traced.tool,
        unit,
        remarks,
    }
}

/// The optional-stop switch is off; all else the program counts by itself.
fn of_its_own(question: &Question) -> Answer {
    match question {
        Question::OptionalStop => Answer::Truth(false),
        Question::Condition(_) | Question::Number(_) => Answer::NotAsked,
        Question::Skip { .. } => Answer::Unknown,
    }
}

fn control_alarm(alarm: &Alarm) -> ControlAlarm {
    match alarm.diagnostic.code {
        "macro-alarm" => ControlAlarm {
            kind: AlarmKind::Macro,
            number: alarm.number.saturating_sub(3000),
            message: Some(alarm.diagnostic.message.clone()),
        },
        _ => ControlAlarm {
            kind: AlarmKind::Program,
            number: alarm.number,
            message: None,
        },
    }
}

fn fault_report(alarm: &Alarm, (program, block): (u32, u32)) -> FaultReport {
    let d = &alarm.diagnostic;
    FaultReport {
        code: d.code.to_owned(),
        text: d.message.clone(),
        remedy: d.remedy.clone(),
        program,
        block,
        file: d.file.clone(),
        line: d.line,
        column: d.column,
    }
}

//! Traceability functions on a control: what it has of its own first, then what plain variables, its log and checks between blocks can
//! do, else a recorder beside it. Each gets a grade; nothing is native that the reference does not name.

mod around;
mod checks;
mod ways;

use crate::grade::{Grade, Row, Verdict};
use crate::letters::pieces;
use crate::posting::Posting;
use crate::sheet::Refusal;
use crate::statement::Statement;
use plan::expression::Operator;
use plan::{Expression, Level, Place, RawNcFunction};
use std::collections::{BTreeMap, BTreeSet};
use trace::functions::{CoordinateFrame, Frequency, Recording, SynchronizedAction};
use trace::sensor::{Sensor, Statistic, streams};
use trace::{Call, Function};

/// Longest text, and most values, in a line of a log.
const LONGEST_TEXT: usize = 60;
const MOST_VALUES: usize = 3;

/// How a program comes by a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Reading {
    /// By a variable of the control.
    Value(Source),
    /// Only from outside the program; by what.
    Outside(&'static str),
    /// Not at all; why.
    Nothing(&'static str),
}

impl Reading {
    /// A plain variable that a manual has.
    pub fn known(text: impl Into<String>) -> Reading {
        Reading::Value(Source::of(text).verified())
    }

    /// A plain variable to be verified.
    pub fn unsure(text: impl Into<String>) -> Reading {
        Reading::Value(Source::of(text))
    }
}

/// Where nothing is known.
pub const NO_SOURCE: Reading = Reading::Nothing("no source for it is known on this control");
/// Sensors that are the shop's.
pub const OWN_SENSOR: Reading = Reading::Outside("a sensor of its own beside the control");

/// A value as a control's program reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The variable.
    pub text: String,
    /// Lines that have to stand before its use.
    pub before: Vec<String>,
    /// In the unit of records it is `text * factor`.
    pub factor: f64,
    /// It is known from a manual.
    pub verified: bool,
    /// It may stand in a synchronized action.
    pub realtime: bool,
}

impl Source {
    /// A plain variable, not in the servo cycle, not verified.
    pub fn of(text: impl Into<String>) -> Self {
        Source {
            text: text.into(),
            before: Vec::new(),
            factor: 1.0,
            verified: false,
            realtime: false,
        }
    }

    /// The same, as a manual has it.
    pub fn verified(self) -> Self {
        Source { verified: true, ..self }
    }

    /// Its text in the unit of records.
    pub fn in_records(&self, (open, close): (&str, &str)) -> String {
        if self.factor == 1.0 {
            return self.text.clone();
        }
        let inverse = 1.0 / self.factor;
        if (inverse - inverse.round()).abs() < 1e-9 {
            format!("{open}{}/{}.{close}", self.text, inverse.round())
        } else {
            format!("{open}{}*{}{close}", self.text, self.factor)
        }
    }
}

/// A part of a line of the log.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// As it is.
    Text(String),
    /// A value by its name and the control's variable.
    Value(String, Source),
}

/// Why a coordinate is not posted: a control's variable is the axis's, and must not be taken for the tip's place.
pub fn of_a_frame(frame: CoordinateFrame) -> String {
    format!("coordinates in the frame {} are worked out beside the program", frame.word())
}

/// What functions have begun and not ended.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracing {
    tool_logging: BTreeSet<String>,
    /// By kind and id, as [`ways::span`] has them.
    checks: BTreeMap<String, Check>,
    /// Recordings and actions that the control itself does, by kind and id, with the number of workplans that were open at their start.
    native: BTreeMap<String, (Function, usize)>,
    /// What stops the recordings and actions along the present path: lines of functions.
    along_path: Vec<String>,
    /// How many checks were begun.
    counted: u32,
    /// What begins and ends on which way of a branch.
    pub(crate) ways: ways::Ways,
}

/// Something that is looked at between blocks.
#[derive(Clone, Debug)]
enum Check {
    Poll {
        values: Vec<(Sensor, Source)>,
        /// How many were open where it began: it ends with the innermost.
        workplans: usize,
        number: u32,
    },
    Action {
        action: SynchronizedAction,
        number: u32,
    },
}

impl Check {
    /// They are looked at in the order of their starts.
    fn number(&self) -> u32 {
        match self {
            Check::Poll { number, .. } | Check::Action { number, .. } => *number,
        }
    }
}

impl Posting<'_, '_> {
    /// Posts a function of the program.
    pub(crate) fn function(&mut self, raw: &RawNcFunction) -> Result<(), Refusal> {
        if raw.kind == RawNcFunction::PRINT {
            return self.printed(&raw.text);
        }
        if raw.kind == RawNcFunction::VARIABLE_NAME {
            self.sheet.notice("names that the program gives to variables are left out");
            return Ok(());
        }
        if raw.kind == "other functions" {
            return self.along_path(raw);
        }
        if !trace::is_line(&raw.text) {
            let name = if raw.kind == "extended function" {
                &raw.text
            } else {
                &raw.kind
            };
            let name = name.clone();
            self.write(&Statement::Comment(&format!("NOT POSTED: {name} {}", raw.name)))?;
            self.count(
                &name,
                &Verdict::refused("no word of the vocabulary: put in by hand what the control has for it"),
            );
            return Ok(());
        }
        for read in trace::functions_of(raw) {
            match read {
                Ok(function) => self.traced(&function)?,
                Err(found) => {
                    return Err(Refusal::new(
                        "trace-line",
                        format!("a function cannot be read: {found}"),
                        "correct the line",
                    ));
                }
            }
        }
        Ok(())
    }

    /// Posts a function and takes down its grade.
    pub(crate) fn traced(&mut self, function: &Function) -> Result<(), Refusal> {
        // Without the prefix: a reader of the vocabulary would take the comment for a function of its own.
        self.write(&Statement::Comment(&format!("FUNCTION {}", function.without_prefix())))?;
        let verdict = match self.written(function) {
            Ok(verdict) => verdict,
            // What a control cannot write of one function does not stop the program: nothing of its motion depends on it.
            Err(refusal) => Verdict::refused(format!("{}; {}", refusal.message, refusal.remedy)),
        };
        if matches!(verdict.grade, Grade::External | Grade::Refused) {
            let word = verdict.grade.word();
            self.write(&Statement::Comment(&format!("{word}: {}", verdict.reason)))?;
        }
        self.count(&function.name, &verdict);
        Ok(())
    }

    pub(super) fn count(&mut self, name: &str, verdict: &Verdict) {
        let known = self.found.functions.iter_mut().find(|row| {
            row.name == name && row.grade == verdict.grade && row.reason == verdict.reason && row.verified == verdict.verified
        });
        if let Some(row) = known {
            row.count += 1;
            return;
        }
        let place = match self.here.map(|origin| origin.place) {
            Some(Place::Entity(entity)) => format!("#{entity}"),
            Some(Place::Text { line, .. }) => format!("line {line}"),
            _ => String::new(),
        };
        self.found.functions.push(Row {
            name: name.to_owned(),
            grade: verdict.grade,
            reason: verdict.reason.clone(),
            verified: verdict.verified,
            count: 1,
            place,
        });
    }

    pub(super) fn written(&mut self, function: &Function) -> Result<Verdict, Refusal> {
        if let Some((span, _)) = ways::span(&function.call) {
            if self.across.contains(&span) {
                return Ok(Verdict::external(format!(
                    "it begins or ends on one way of a branch, or in a loop, and not on the other: which way was taken is known at the \
                     machine only: {}",
                    self.control.recorder()
                )));
            }
            let workplans = self.workplans();
            self.tracing.ways.pass(&function.call, workplans);
        }
        self.asks_for_time(function);
        if let Some(verdict) = self.control.function(function, &mut self.sheet)? {
            self.remember(function, &verdict);
            let silent = matches!(function.call, Call::DisplayMessage { .. });
            self.found.logs |= !silent && matches!(verdict.grade, Grade::Native | Grade::BlockBoundary);
            return Ok(verdict);
        }
        let recorder = self.control.recorder();
        match &function.call {
            Call::GetExecutionTime { executable: None } => self.value_of("trace:last_ws_time", "WORKINGSTEP TIME", function),
            Call::GetExecutionTime { executable: Some(_) } => Ok(Verdict::external(format!(
                "the time of another executable than the last workingstep: {recorder}"
            ))),
            Call::LogToolData { tool } => match tool.as_deref().map(str::parse) {
                Some(Err(_)) => Ok(Verdict::external(format!("the tool has a name and no number: {recorder}"))),
                Some(Ok(number)) => self.tool_log(Some(number)),
                None => self.tool_log(None),
            },
            Call::StartToolLogging { id } => {
                let first = self.tool_log_verdict()?;
                if first.grade == Grade::BlockBoundary {
                    self.tracing.tool_logging.insert(id.0.to_ascii_lowercase());
                }
                Ok(Verdict {
                    reason: format!("{}; written in at every tool change", first.reason),
                    ..first
                })
            }
            Call::StopToolLogging { id } => match self.tracing.tool_logging.remove(&id.0.to_ascii_lowercase()) {
                true => Ok(Verdict::between_blocks(true, "tool changes behind it are not logged")),
                false => Ok(Verdict::external("its start was not posted as tool logging of the program")),
            },
            Call::LogEvent { kind, text, values } => {
                let mut items = vec![Item::Text(format!("EVENT {kind} {}", text.clone().unwrap_or_default()))];
                for value in values {
                    let source = crate::condition::source_of(value, self.control, &mut self.sheet)?;
                    items.push(Item::Value(value.clone(), source));
                }
                self.logged(&items, "")
            }
            Call::LogCoolantData(_) if !function.arguments.is_empty() => {
                let line = function.without_prefix();
                self.logged(&[Item::Text(line)], "as declared in the line; ")
            }
            Call::LogCoolantData(_) | Call::LogCoolantType => Ok(Verdict::external(format!(
                "which coolant is in the machine is entered at its panel: {recorder}"
            ))),
            Call::LogNcMachineData { .. } => Ok(Verdict::external(format!(
                "serial number, model and brand are no variables of the program: {recorder}"
            ))),
            Call::LogNcEvents { .. } => Ok(Verdict::external(format!(
                "the program does not see the control's events: {recorder}"
            ))),
            Call::GetOperatorData | Call::LogOperatorData { .. } => Ok(Verdict::external(format!(
                "the program does not know who is signed in: {recorder}"
            ))),
            Call::ClearAlarm { .. } => Ok(Verdict::refused(
                "a program does not take an alarm back: the operator acknowledges it",
            )),
            Call::ReadSensorValue { sensor, axes } => {
                let streams =
                    streams(sensor, axes).map_err(|no| Refusal::new("sensor", no.message, "correct the sensor's name"))?;
                self.values_of(&streams, function)
            }
            Call::Get(measurement) if measurement.frame != CoordinateFrame::Machine => {
                Ok(Verdict::external(format!("{}: {recorder}", of_a_frame(measurement.frame))))
            }
            Call::Get(measurement) => {
                let streams = measurement
                    .streams()
                    .map_err(|no| Refusal::new("sensor", no.message, "correct the axis"))?;
                self.values_of(&streams, function)
            }
            Call::GetPoints(measurement) => {
                let streams = measurement
                    .streams()
                    .map_err(|no| Refusal::new("sensor", no.message, "correct the axis"))?;
                for stream in &streams {
                    if let Reading::Nothing(why) = self.control.reading(&stream.stream(), self.options.turning) {
                        return Ok(Verdict::refused(format!("{stream}: {why}")));
                    }
                }
                Ok(Verdict::external(format!(
                    "values at places along a path are taken in the servo cycle: {recorder}"
                )))
            }
            Call::StartSensorRecording(recording) => self.poll(recording, recorder),
            Call::StopSensorRecording { .. } | Call::StopSynchronizedAction { .. } => self.stopped(&function.call),
            Call::StartSynchronizedAction(action) => self.check(action),
            Call::SetAlarm(_) | Call::GetTime { .. } | Call::SetEditAccessLevel { .. } | Call::DisplayMessage { .. } => {
                Ok(Verdict::refused("the control has nothing for it"))
            }
            Call::Unknown => Ok(Verdict::refused("the function is in no vocabulary; it stands as a comment")),
        }
    }

    /// Timers that the function reads have to run.
    fn asks_for_time(&mut self, function: &Function) {
        let mut names = Vec::new();
        match &function.call {
            Call::GetExecutionTime { .. } => self.found.timers[0] = true,
            Call::StartSynchronizedAction(action) => collect_names(action.condition.as_ref(), &mut names),
            _ => {}
        }
        for name in names {
            let name = name.to_ascii_lowercase();
            let name = name.strip_prefix("trace:").unwrap_or(&name);
            for (timer, known) in ["ws_time", "op_time", "prog_time"].iter().enumerate() {
                if name == *known {
                    self.found.timers[timer] = true;
                    // Before its level begins a timer would hold what an earlier program left in it.
                    let level = [Level::Workingstep, Level::Operation, Level::Program][timer];
                    if !self.levels.contains(&level) {
                        self.start_timer(timer);
                    }
                }
            }
        }
    }

    fn remember(&mut self, function: &Function, verdict: &Verdict) {
        if verdict.grade != Grade::Native {
            return;
        }
        match ways::span(&function.call) {
            Some((span, true)) => {
                self.tracing.native.insert(span, (function.clone(), self.workplans()));
            }
            Some((span, false)) => {
                self.tracing.native.remove(&span);
            }
            None => {}
        }
    }

    // ---- the log

    pub(super) fn logged(&mut self, items: &[Item], reason: &str) -> Result<Verdict, Refusal> {
        self.begin_log();
        let mut by_log = true;
        for line in self.lines_of(items) {
            by_log &= self.control.log(&line, &mut self.sheet)?;
        }
        let known = items.iter().all(|item| match item {
            Item::Value(_, source) => source.verified,
            Item::Text(_) => true,
        });
        Ok(Verdict::between_blocks(
            by_log && known,
            format!("{reason}written by the program when its block is read"),
        ))
    }

    /// Long text and many values in as many lines as they take: the line of a control is short.
    fn lines_of(&self, items: &[Item]) -> Vec<Vec<Item>> {
        let mut lines: Vec<Vec<Item>> = vec![Vec::new()];
        let mut values = 0;
        for item in items {
            match item {
                Item::Text(text) => {
                    let text = self.sheet.paper().letters.write(text);
                    for (k, piece) in pieces(&text, LONGEST_TEXT).into_iter().enumerate() {
                        if k > 0 {
                            lines.push(Vec::new());
                        }
                        lines.last_mut().expect("there is one").push(Item::Text(piece));
                    }
                }
                Item::Value(..) => {
                    if values == MOST_VALUES {
                        values = 0;
                        lines.push(Vec::new());
                    }
                    values += 1;
                    lines.last_mut().expect("there is one").push(item.clone());
                }
            }
        }
        lines
    }

    fn begin_log(&mut self) {
        self.found.logs = true;
    }

    /// What the program prints of its own.
    fn printed(&mut self, text: &str) -> Result<(), Refusal> {
        let verdict = self.logged(&[Item::Text(text.to_owned())], "a line that the program prints; ")?;
        self.sheet
            .notice("values in printed lines are those that they had when the program was posted");
        self.count("print", &verdict);
        Ok(())
    }

    fn values_of(&mut self, streams: &[Sensor], function: &Function) -> Result<Verdict, Refusal> {
        let recorder = self.control.recorder();
        let mut items = vec![Item::Text(function.name.clone())];
        for sensor in streams {
            if sensor.statistic != Statistic::Last {
                return Ok(Verdict::external(format!("{sensor} is taken over many cycles: {recorder}")));
            }
            match self.control.reading(&sensor.stream(), self.options.turning) {
                Reading::Value(source) => items.push(Item::Value(sensor.stream(), source)),
                Reading::Outside(by) => return Ok(Verdict::external(format!("{sensor}: {by}"))),
                Reading::Nothing(why) => return Ok(Verdict::refused(format!("{sensor}: {why}"))),
            }
        }
        self.fill_variable(function, &items)?;
        self.logged(&items, "")
    }

    fn value_of(&mut self, stream: &str, label: &str, function: &Function) -> Result<Verdict, Refusal> {
        match self.control.reading(stream, self.options.turning) {
            Reading::Value(source) => {
                let items = [Item::Value(label.to_owned(), source)];
                self.fill_variable(function, &items)?;
                self.logged(&items, "")
            }
            Reading::Outside(by) => Ok(Verdict::external(by)),
            Reading::Nothing(why) => Ok(Verdict::refused(why)),
        }
    }

    /// The variable that a function asks for gets its value.
    fn fill_variable(&mut self, function: &Function, items: &[Item]) -> Result<(), Refusal> {
        let Some(variable) = &function.variable else { return Ok(()) };
        let mut sources = items.iter().filter_map(|item| match item {
            Item::Value(_, source) => Some(source),
            Item::Text(_) => None,
        });
        let (Some(source), None) = (sources.next(), sources.next()) else {
            return Err(Refusal::new(
                "its-variable",
                format!("{} has several values and one variable", function.name),
                "name one axis",
            ));
        };
        let source = source.clone();
        let number = self.sheet.variable(variable);
        let name = self.control.variable(number)?;
        let text = source.in_records(self.control.paper().brackets);
        self.assign(&name, &source, &text);
        Ok(())
    }

    /// A variable gets the value of a source, spelled as `text`.
    pub(super) fn assign(&mut self, variable: &str, source: &Source, text: &str) {
        for line in &source.before {
            self.sheet.line(line);
        }
        if let Some(stop) = self.control.before_reading(text) {
            self.sheet.line(stop);
        }
        let line = self.control.assignment(variable, text);
        self.sheet.line(&line);
    }

    pub(super) fn tool_log(&mut self, tool: Option<u32>) -> Result<Verdict, Refusal> {
        let Some(values) = self.control.tool_data(tool) else {
            return Ok(Verdict::external(format!(
                "the tool table is no variable of the program: {}",
                self.control.recorder()
            )));
        };
        // Without a tool the table has no row to read.
        let known = if tool.is_none() && self.tool == 0 { 1 } else { values.len() };
        let mut items = vec![Item::Text("TOOL".to_owned())];
        for (name, reading) in values.into_iter().take(known) {
            if let Reading::Value(source) = reading {
                items.push(Item::Value(name.to_owned(), source));
            }
        }
        self.logged(&items, "number and table values; life and asset are the recorder's; ")
    }

    /// What a line at each tool change will be, without writing one.
    fn tool_log_verdict(&mut self) -> Result<Verdict, Refusal> {
        let mut nowhere = |_: &str| {};
        let mut aside = Posting::new(self.control, self.options, &mut nowhere, None, BTreeSet::new());
        aside.tool = 1;
        let verdict = aside.tool_log(None);
        self.found.logs |= verdict.is_ok();
        verdict
    }

    /// A tool came in.
    pub(crate) fn tool_changed(&mut self) -> Result<(), Refusal> {
        if self.tracing.tool_logging.is_empty() {
            return Ok(());
        }
        self.tool_log(None).map(|_| ())
    }
}

/// `drive-load-x` along a path is the stream `X.LOAD`.
fn alias(name: &str) -> String {
    let plain = name.replace('-', "_");
    if let Some((quantity, axis)) = plain.rsplit_once('_')
        && axis.len() == 1
        && let Ok(found) = streams(quantity, &[axis.to_owned()])
        && let [sensor] = found.as_slice()
    {
        return sensor.to_string();
    }
    plain
}

/// The streams of a recording.
///
/// # Errors
/// A name that is none.
pub(crate) fn streams_of(recording: &Recording) -> Result<Vec<Sensor>, Refusal> {
    let mut all = Vec::new();
    for sensor in &recording.sensors {
        let found =
            streams(sensor, &recording.axes).map_err(|no| Refusal::new("sensor", no.message, "correct the sensor's name"))?;
        all.extend(found);
    }
    Ok(all)
}

/// Ids are compared without case.
fn key(id: &str) -> String {
    id.to_ascii_lowercase()
}

/// The variable that remembers what happened before, if the frequency needs one.
fn flags(frequency: Frequency, number: u32) -> Vec<String> {
    match frequency {
        Frequency::None | Frequency::Whenever => Vec::new(),
        Frequency::From | Frequency::When | Frequency::Every => vec![format!("(check {number})")],
    }
}

fn collect_names(expression: Option<&Expression>, names: &mut Vec<String>) {
    match expression {
        Some(Expression::Name(name)) => names.push(name.clone()),
        Some(Expression::Not(inner) | Expression::Negate(inner)) => collect_names(Some(inner), names),
        Some(Expression::Binary(_, left, right)) => {
            collect_names(Some(left), names);
            collect_names(Some(right), names);
        }
        Some(Expression::Number(..) | Expression::Truth(_)) | None => {}
    }
}

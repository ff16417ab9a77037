//! Traceability functions on a control: what it has of its own first, then what plain variables, its log and checks between blocks can
//! do, else a recorder beside it. Each gets a grade; nothing is native that the reference does not name.

use crate::grade::{Grade, Row, Verdict};
use crate::posting::Posting;
use crate::sheet::Refusal;
use crate::statement::Statement;
use plan::expression::Operator;
use plan::{Expression, Level, Place, RawNcFunction};
use std::collections::{BTreeMap, BTreeSet};
use trace::functions::{Frequency, Recording, SynchronizedAction};
use trace::sensor::{Sensor, Statistic, streams};
use trace::{Call, Function};

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

/// What functions have begun and not ended.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracing {
    tool_logging: BTreeSet<String>,
    checks: BTreeMap<String, Check>,
    /// Recordings and actions that the control itself does, by id, with the number of workplans that were open at their start.
    native: BTreeMap<String, (Function, usize)>,
    /// Recordings along the present path.
    along_path: Vec<String>,
    /// How many levels were open where something that ends with its workplan began.
    counted: u32,
}

/// Something that is looked at between blocks.
#[derive(Clone, Debug)]
enum Check {
    Poll {
        values: Vec<(Sensor, Source)>,
        workplans: usize,
    },
    Action {
        action: SynchronizedAction,
        number: u32,
    },
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
        match trace::parse(&raw.text) {
            Ok(function) => self.traced(&function),
            Err(found) => Err(Refusal::new(
                "trace-line",
                format!("a function cannot be read: {found}"),
                "correct the line",
            )),
        }
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

    fn count(&mut self, name: &str, verdict: &Verdict) {
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

    fn written(&mut self, function: &Function) -> Result<Verdict, Refusal> {
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
            Call::StopSensorRecording { id } | Call::StopSynchronizedAction { id } => Ok(self.stopped(&id.0)),
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
        match &function.call {
            Call::StartSensorRecording(recording) => {
                self.tracing
                    .native
                    .insert(key(&recording.id.0), (function.clone(), self.workplans()));
            }
            Call::StartSynchronizedAction(action) => {
                self.tracing
                    .native
                    .insert(key(&action.id.0), (function.clone(), self.workplans()));
            }
            Call::StopSensorRecording { id } | Call::StopSynchronizedAction { id } => {
                self.tracing.native.remove(&key(&id.0));
            }
            _ => {}
        }
    }

    // ---- the log

    fn logged(&mut self, items: &[Item], reason: &str) -> Result<Verdict, Refusal> {
        self.begin_log();
        for item in items {
            if let Item::Value(_, source) = item {
                for line in &source.before {
                    self.sheet.line(line);
                }
            }
        }
        let by_log = self.control.log(items, &mut self.sheet)?;
        let known = items.iter().all(|item| match item {
            Item::Value(_, source) => source.verified,
            Item::Text(_) => true,
        });
        Ok(Verdict::between_blocks(
            by_log && known,
            format!("{reason}written by the program when its block is read"),
        ))
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
        self.into_variable(function, &items)?;
        self.logged(&items, "")
    }

    fn value_of(&mut self, stream: &str, label: &str, function: &Function) -> Result<Verdict, Refusal> {
        match self.control.reading(stream, self.options.turning) {
            Reading::Value(source) => {
                let items = [Item::Value(label.to_owned(), source)];
                self.into_variable(function, &items)?;
                self.logged(&items, "")
            }
            Reading::Outside(by) => Ok(Verdict::external(by)),
            Reading::Nothing(why) => Ok(Verdict::refused(why)),
        }
    }

    /// The variable that a function asks for gets its value.
    fn into_variable(&mut self, function: &Function, items: &[Item]) -> Result<(), Refusal> {
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
    fn assign(&mut self, variable: &str, source: &Source, text: &str) {
        for line in &source.before {
            self.sheet.line(line);
        }
        if let Some(stop) = self.control.before_reading(text) {
            self.sheet.line(stop);
        }
        let line = self.control.assignment(variable, text);
        self.sheet.line(&line);
    }

    fn tool_log(&mut self, tool: Option<u32>) -> Result<Verdict, Refusal> {
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
        let mut aside = Posting::new(self.control, self.options, &mut nowhere, None);
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

    // ---- between blocks

    fn poll(&mut self, recording: &Recording, recorder: &str) -> Result<Verdict, Refusal> {
        if !self.control.polls() {
            return Ok(Verdict::external(recorder));
        }
        let streams = streams_of(recording)?;
        let mut values = Vec::new();
        for sensor in streams {
            match self.control.reading(&sensor.stream(), self.options.turning) {
                Reading::Value(source) if recording.statistic == Statistic::Last => values.push((sensor, source)),
                Reading::Value(_) => {
                    return Ok(Verdict::external(format!(
                        "minimum, maximum and means are taken in the servo cycle: {recorder}"
                    )));
                }
                Reading::Outside(by) => return Ok(Verdict::external(format!("{sensor}: {by}"))),
                Reading::Nothing(why) => return Ok(Verdict::refused(format!("{sensor}: {why}"))),
            }
        }
        let verified = values.iter().all(|(_, source)| source.verified);
        let workplans = self.workplans();
        self.tracing
            .checks
            .insert(key(&recording.id.0), Check::Poll { values, workplans });
        self.found.logs = true;
        self.check_now(&key(&recording.id.0))?;
        Ok(Verdict::between_blocks(
            verified,
            format!(
                "one sample about every {} moves and at the ends of paths instead of the sampling asked for",
                self.options.check_every
            ),
        ))
    }

    fn check(&mut self, action: &SynchronizedAction) -> Result<Verdict, Refusal> {
        let recorder = self.control.recorder();
        if !self.control.checks() {
            return Ok(Verdict::external(format!(
                "conditions are checked in the servo cycle outside the program: {recorder}"
            )));
        }
        // Look first, so that a check that cannot be written leaves nothing behind.
        if let Some(condition) = &action.condition
            && let Err(refusal) = self.readable(condition)
        {
            return Ok(Verdict::external(format!("{}; {recorder}", refusal.message)));
        }
        for function in &action.actions {
            if let Some(why) = self.not_between_blocks(function) {
                return Ok(Verdict::external(format!("{} as an action: {why}", function.name)));
            }
        }
        self.tracing.counted += 1;
        let number = self.tracing.counted;
        for flag in flags(action.frequency, number) {
            let value = Expression::Number(0.0, None);
            self.sheet.variable(&flag);
            self.control.write(
                &Statement::Assign {
                    variable: &flag,
                    value: &value,
                },
                &mut self.sheet,
            )?;
        }
        let id = key(&action.id.0);
        self.tracing.checks.insert(
            id.clone(),
            Check::Action {
                action: action.clone(),
                number,
            },
        );
        self.check_now(&id)?;
        let scope = if action.all_modes {
            "; only while this program runs"
        } else {
            ""
        };
        Ok(Verdict::between_blocks(
            false,
            format!(
                "checked about every {} moves and at the ends of paths, when the block is read{scope}",
                self.options.check_every
            ),
        ))
    }

    /// Every name of the condition has a value between blocks.
    fn readable(&mut self, condition: &Expression) -> Result<(), Refusal> {
        let mut names = Vec::new();
        collect_names(Some(condition), &mut names);
        for name in names {
            crate::condition::source_of(&name, self.control, &mut self.sheet)?;
        }
        Ok(())
    }

    fn not_between_blocks(&self, function: &Function) -> Option<String> {
        let streams = match &function.call {
            Call::ReadSensorValue { sensor, axes } => streams(sensor, axes),
            Call::Get(measurement) => measurement.streams(),
            Call::SetAlarm(_) | Call::LogEvent { .. } | Call::GetTime { .. } => return None,
            Call::LogToolData { tool: None } => return None,
            Call::DisplayMessage { .. } => return None,
            _ => return Some("not between blocks of a program".to_owned()),
        };
        let streams = match streams {
            Ok(streams) => streams,
            Err(no) => return Some(no.message),
        };
        streams
            .iter()
            .find_map(|stream| match self.control.reading(&stream.stream(), self.options.turning) {
                Reading::Value(_) => None,
                Reading::Outside(why) | Reading::Nothing(why) => Some(format!("{stream}: {why}")),
            })
    }

    /// Looks at everything that is looked at between blocks.
    pub(crate) fn check_between_blocks(&mut self) -> Result<(), Refusal> {
        let ids: Vec<String> = self.tracing.checks.keys().cloned().collect();
        ids.iter().try_for_each(|id| self.check_now(id))
    }

    fn check_now(&mut self, id: &str) -> Result<(), Refusal> {
        match self.tracing.checks.get(id).cloned() {
            None => Ok(()),
            Some(Check::Poll { values, .. }) => {
                let mut items = vec![Item::Text(format!("RECORDING {id}"))];
                items.extend(
                    values
                        .into_iter()
                        .map(|(sensor, source)| Item::Value(sensor.stream(), source)),
                );
                self.logged(&items, "").map(|_| ())
            }
            Some(Check::Action { action, number }) => self.check_action(&action, number),
        }
    }

    /// The table of frequencies, in statements that every control has.
    fn check_action(&mut self, action: &SynchronizedAction, number: u32) -> Result<(), Refusal> {
        let flag = flags(action.frequency, number).pop().unwrap_or_default();
        let is = |value: f64| {
            Expression::Binary(
                Operator::Equal,
                Box::new(Expression::Name(flag.clone())),
                Box::new(Expression::Number(value, None)),
            )
        };
        let set = |posting: &mut Self, value: f64| {
            let value = Expression::Number(value, None);
            let assign = Statement::Assign {
                variable: &flag,
                value: &value,
            };
            posting.control.write(&assign, &mut posting.sheet)
        };
        let condition = action.condition.clone().unwrap_or(Expression::Truth(true));
        match action.frequency {
            Frequency::None => self.actions(action),
            Frequency::Whenever => {
                self.say(&Statement::If(&condition))?;
                self.actions(action)?;
                self.say(&Statement::EndIf)
            }
            Frequency::When => {
                // The flag first: once it has fired the condition is no longer looked at.
                self.say(&Statement::If(&is(0.0)))?;
                self.say(&Statement::If(&condition))?;
                set(self, 1.0)?;
                self.actions(action)?;
                self.say(&Statement::EndIf)?;
                self.say(&Statement::EndIf)
            }
            Frequency::From => {
                self.say(&Statement::If(&condition))?;
                set(self, 1.0)?;
                self.say(&Statement::EndIf)?;
                self.say(&Statement::If(&is(1.0)))?;
                self.actions(action)?;
                self.say(&Statement::EndIf)
            }
            Frequency::Every => {
                self.say(&Statement::If(&condition))?;
                self.say(&Statement::If(&is(0.0)))?;
                set(self, 1.0)?;
                self.actions(action)?;
                self.say(&Statement::EndIf)?;
                self.say(&Statement::Else)?;
                set(self, 0.0)?;
                self.say(&Statement::EndIf)
            }
        }
    }

    fn say(&mut self, statement: &Statement<'_>) -> Result<(), Refusal> {
        self.control.write(statement, &mut self.sheet)
    }

    fn actions(&mut self, action: &SynchronizedAction) -> Result<(), Refusal> {
        for function in &action.actions {
            self.written(function)?;
        }
        Ok(())
    }

    fn stopped(&mut self, id: &str) -> Verdict {
        match self.tracing.checks.remove(&key(id)) {
            Some(_) => Verdict::between_blocks(true, "it is looked at no more"),
            None => Verdict::external("as its start"),
        }
    }

    // ---- the structure around

    pub(crate) fn start_timer(&mut self, timer: usize) {
        for line in self.control.start_timer(timer) {
            self.sheet.line(&line);
        }
    }

    pub(crate) fn level_begins(&mut self, level: Level) {
        let timers = self.before.as_ref().map(|known| known.timers).unwrap_or_default();
        match level {
            Level::Workingstep if timers[0] => self.start_timer(0),
            Level::Operation if timers[1] => self.start_timer(1),
            _ => {}
        }
    }

    pub(crate) fn level_ends(&mut self, level: Level) -> Result<(), Refusal> {
        match level {
            Level::Toolpath => {
                self.check_between_blocks()?;
                for id in std::mem::take(&mut self.tracing.along_path) {
                    let line = format!("trace:1 stop_sensor_recording its_function_id={id}");
                    if let Ok(stop) = trace::parse(&line) {
                        self.traced(&stop)?;
                    }
                }
                Ok(())
            }
            Level::Workingstep => {
                let timers = self.before.as_ref().map(|known| known.timers).unwrap_or_default();
                if timers[0]
                    && let Reading::Value(source) = self.control.reading("trace:ws_time", self.options.turning)
                    && let Reading::Value(kept) = self.control.reading("trace:last_ws_time", self.options.turning)
                {
                    self.assign(&kept.text, &source, &source.text);
                }
                Ok(())
            }
            Level::Workplan => self.workplan_ends(),
            _ => Ok(()),
        }
    }

    /// Workplans that are open.
    fn workplans(&self) -> usize {
        self.levels.iter().filter(|level| **level == Level::Workplan).count()
    }

    /// A recording ends with the workplan that its start stands in.
    fn workplan_ends(&mut self) -> Result<(), Refusal> {
        let open = self.workplans();
        let ends = |found: &(Function, usize)| found.1 > open && matches!(found.0.call, Call::StartSensorRecording(_));
        let native = self.tracing.native.iter().filter(|(_, found)| ends(found));
        let ids: Vec<String> = native.map(|(id, _)| id.clone()).collect();
        for id in ids {
            self.stop_by_itself(&id, "WORKPLAN")?;
        }
        self.tracing
            .checks
            .retain(|_, check| !matches!(check, Check::Poll { workplans, .. } if *workplans > open));
        Ok(())
    }

    /// What was started and not stopped ends with the program: its stop is written, so that the control does not go on with it.
    pub(crate) fn close_functions(&mut self) -> Result<(), Refusal> {
        let ids: Vec<String> = self.tracing.native.keys().cloned().collect();
        for id in ids {
            self.stop_by_itself(&id, "PROGRAM")?;
        }
        self.tracing.checks.clear();
        Ok(())
    }

    fn stop_by_itself(&mut self, id: &str, end: &str) -> Result<(), Refusal> {
        let Some((function, _)) = self.tracing.native.remove(id) else {
            return Ok(());
        };
        let line = match &function.call {
            Call::StartSensorRecording(recording) => {
                format!("trace:1 stop_sensor_recording its_function_id=\"{}\"", recording.id)
            }
            // An action of all modes outlives the program; that is what it is for.
            Call::StartSynchronizedAction(action) if !action.all_modes => {
                format!("trace:1 stop_synchronized_action its_id=\"{}\"", action.id)
            }
            _ => return Ok(()),
        };
        if let Ok(stop) = trace::parse(&line) {
            self.write(&Statement::Comment(&format!("END OF THE {end}: {} {id}", function.name)))?;
            self.control.function(&stop, &mut self.sheet)?;
        }
        Ok(())
    }

    /// Conditions that run along the present path.
    fn along_path(&mut self, raw: &RawNcFunction) -> Result<(), Refusal> {
        for (name, mode) in &raw.properties {
            let line = format!("{name} {mode}");
            if trace::is_line(name) || trace::is_line(mode) {
                let line = if trace::is_line(name) { name } else { mode };
                let function =
                    trace::parse(line).map_err(|found| Refusal::new("trace-line", found.to_string(), "correct the line"))?;
                if let Call::StartSensorRecording(recording) = &function.call {
                    self.tracing.along_path.push(recording.id.0.clone());
                }
                self.traced(&function)?;
            } else if name == "trace.record" {
                let id = format!("path{}", self.sheet.own_number());
                let every = raw.properties.get("trace.sampling").map(String::as_str).unwrap_or_default();
                let factor: u32 = every.split_whitespace().find_map(|word| word.parse().ok()).unwrap_or(1);
                let sensors: Vec<String> = mode.split(',').map(|sensor| alias(sensor.trim())).collect();
                let line = format!(
                    "trace:1 start_sensor_recording its_function_id={id} its_sensors={} its_sampling={factor}",
                    sensors.join(",")
                );
                match trace::parse(&line) {
                    Ok(function) => {
                        self.tracing.along_path.push(id);
                        self.traced(&function)?;
                    }
                    Err(found) => return Err(Refusal::new("trace-line", found.to_string(), "correct the path's condition")),
                }
            } else if name != "trace.sampling" {
                self.write(&Statement::Comment(&format!("NOT POSTED ALONG THIS PATH: {line}")))?;
                self.count(
                    name,
                    &Verdict::refused("no word of the vocabulary: put in by hand what the control has for it"),
                );
            }
        }
        Ok(())
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

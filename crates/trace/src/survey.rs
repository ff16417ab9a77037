//! The functions of a program looked at before it runs: what can be known to go wrong, and what this machine cannot give.
//!
//! Fed with the steps of a look through the program, in order; the codes are those of the manual's table of errors. A function inside a
//! branch that the look did not take is seen when it runs.

use crate::compile::{Compiled, compile, signal_of};
use crate::functions::{Call, TraceId};
use crate::sensor::{Meaning, Sensor, meaning, streams};
use crate::{Function, Sampling, is_line, parse};
use plan::{Diagnostic, Diagnostics, Expression, Level, Place, RawNcFunction, Severity, Step, StepKind};
use std::collections::{BTreeMap, BTreeSet};

/// What a look through a program found of its functions.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    file: String,
    /// Names of functions with how often they came.
    counts: BTreeMap<String, u32>,
    /// Conditions by the line that starts them.
    compiled: BTreeMap<String, Compiled>,
    /// In the order in which they came.
    order: Vec<String>,
    /// Streams that were asked for and this machine has not.
    missing: BTreeSet<String>,
    /// What is active: kind and id, and the depth of workplans in which it began.
    active: BTreeMap<(Kind, TraceId), usize>,
    /// What was ever started.
    started: BTreeSet<(Kind, TraceId)>,
    depth: usize,
    /// Inside an operation that the program itself has.
    inside_operation: bool,
    diagnostics: Diagnostics,
    all_modes: bool,
    operations: usize,
    /// Geometry that recordings name, and what is to be said when the file has it not.
    points: Vec<(String, Diagnostic)>,
}

/// Functions that are started and stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Recording,
    Tools,
    Events,
    Operators,
    Synchronized,
}

impl Kind {
    fn word(self) -> &'static str {
        match self {
            Kind::Recording => "sensor recording",
            Kind::Tools => "tool logging",
            Kind::Events => "event logging",
            Kind::Operators => "operator logging",
            Kind::Synchronized => "synchronized action",
        }
    }
}

/// What the functions of a program come to.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Names of functions with how often they came, unknown ones too.
    pub counts: BTreeMap<String, u32>,
    /// Conditions in the order in which they are met first: the canonical line, and what is loaded.
    pub conditions: Vec<(String, Compiled)>,
    /// Streams that this machine cannot give.
    pub missing: Vec<String>,
    /// What is wrong, odd or missing.
    pub diagnostics: Vec<Diagnostic>,
    /// An action goes on in all modes: somebody with the right to that has to be signed in.
    pub all_modes: bool,
    /// Geometry that recordings name, and what is to be said when the file has it not.
    pub points: Vec<(String, Diagnostic)>,
}

impl Found {
    /// With what is wrong about geometry, now that it is known which the file has.
    pub fn with_geometry(mut self, has: impl Fn(&str) -> bool) -> Self {
        let missing = std::mem::take(&mut self.points).into_iter().filter(|(name, _)| !has(name));
        self.diagnostics.extend(missing.map(|(_, said)| said));
        self
    }
}

impl Survey {
    /// Nothing seen yet; `file` is how findings call the program.
    pub fn new(file: impl Into<String>) -> Self {
        Survey {
            file: file.into(),
            ..Survey::default()
        }
    }

    /// The next step.
    pub fn step(&mut self, step: &Step) {
        match &step.kind {
            StepKind::Begin(marker) => match marker.level {
                Level::Workplan => self.depth += 1,
                Level::Operation => self.inside_operation = !marker.derived,
                _ => {}
            },
            StepKind::End(Level::Workplan) => {
                self.depth = self.depth.saturating_sub(1);
                self.end_scope(self.depth + 1, step);
            }
            StepKind::End(Level::Operation) => self.inside_operation = false,
            StepKind::NcFunction(function) => self.function(function, step),
            _ => {}
        }
    }

    /// What is begun and not over here: recordings, logging, synchronized actions. Each by its kind and id, in order.
    pub fn begun(&self) -> impl Iterator<Item = (&'static str, &TraceId)> {
        self.active.keys().map(|(kind, id)| (kind.word(), id))
    }

    /// The program is over.
    pub fn finish(mut self) -> Found {
        let open: Vec<_> = self.active.keys().cloned().collect();
        for (kind, id) in open {
            let found = Diagnostic::remark("T-04", format!("{} {id} has no stop: the program's end ends it", kind.word()));
            self.diagnostics.add(found.in_file(self.file.clone()));
        }
        if !self.missing.is_empty() {
            let names: Vec<&str> = self.missing.iter().map(String::as_str).collect();
            let found = Diagnostic::warning("T-05", format!("this machine has no {}", names.join(", ")))
                .remedy("their values are recorded as unavailable, and conditions on them are never fulfilled");
            self.diagnostics.add(found.in_file(self.file.clone()));
        }
        let mut compiled = self.compiled;
        Found {
            counts: self.counts,
            conditions: self
                .order
                .into_iter()
                .filter_map(|line| compiled.remove(&line).map(|c| (line, c)))
                .collect(),
            missing: self.missing.into_iter().collect(),
            diagnostics: self.diagnostics.as_slice().to_vec(),
            all_modes: self.all_modes,
            points: self.points,
        }
    }

    fn function(&mut self, raw: &RawNcFunction, step: &Step) {
        if raw.is_of_the_control() {
            return;
        }
        let along_a_path = raw.kind == ALONG;
        for line in lines(raw) {
            match parse(&line) {
                Err(found) => self.diagnostics.add(self.placed(*found, step)),
                Ok(function) => {
                    *self.counts.entry(function.name.clone()).or_default() += 1;
                    if self.inside_operation && !along_a_path {
                        self.say(
                            Severity::Error,
                            "T-12",
                            format!("{} stands between two paths of an operation", function.name),
                            "put it along a path (other functions), or between the workingsteps",
                            step,
                        );
                    }
                    self.meaning(&function, step, along_a_path);
                }
            }
        }
    }

    fn meaning(&mut self, function: &Function, step: &Step, along_a_path: bool) {
        self.variable(function, step);
        self.sensors(function, step);
        self.points(function, step);
        self.evenly(function, step);
        match &function.call {
            Call::Unknown => {
                let meant = crate::meant(&function.name).map_or_else(String::new, |name| format!("did you mean {name}?"));
                let text = format!(
                    "the function {} is unknown here: it is kept and shown, and does nothing",
                    function.name
                );
                self.say(Severity::Warning, "trace-unknown", text, &meant, step);
            }
            Call::StartSensorRecording(recording) if !along_a_path => self.start(Kind::Recording, &recording.id, step),
            Call::StopSensorRecording { id } => self.stop(Kind::Recording, id, step),
            Call::StartToolLogging { id } => self.start(Kind::Tools, id, step),
            Call::StopToolLogging { id } => self.stop(Kind::Tools, id, step),
            Call::LogNcEvents { id, on: true, kinds } => {
                self.kinds(kinds, step);
                self.start(Kind::Events, id, step);
            }
            Call::LogNcEvents { id, on: false, .. } => self.stop(Kind::Events, id, step),
            Call::LogOperatorData { id, on: true } => self.start(Kind::Operators, id, step),
            Call::LogOperatorData { id, on: false } => self.stop(Kind::Operators, id, step),
            Call::StopSynchronizedAction { id } => self.stop(Kind::Synchronized, id, step),
            Call::StartSynchronizedAction(action) => {
                if !along_a_path {
                    self.start(Kind::Synchronized, &action.id, step);
                }
                self.all_modes |= action.all_modes;
                match compile(action) {
                    Err(refused) => self.say(Severity::Error, refused.code, refused.message, &refused.remedy, step),
                    Ok(compiled) => {
                        self.missing.extend(compiled.missing.iter().cloned());
                        for inner in &action.actions {
                            self.variable(inner, step);
                            self.sensors(inner, step);
                        }
                        self.keep(function.to_string(), compiled, step);
                    }
                }
            }
            _ => {}
        }
    }

    /// A kind that no event has is a slip of the pen: nothing would be recorded of it.
    fn kinds(&mut self, kinds: &[String], step: &Step) {
        let known = |kind: &&String| crate::record::CONTROL_EVENTS.iter().any(|k| k.eq_ignore_ascii_case(kind));
        for kind in kinds.iter().filter(|kind| !known(kind)) {
            let text = format!("log_nc_events names '{kind}', and the control has no such event: nothing is recorded of it");
            let remedy = format!("its events are {}", crate::record::CONTROL_EVENTS.join(", "));
            self.say(Severity::Warning, "trace-events", text, &remedy, step);
        }
    }

    /// What a function writes has to be a variable of the program, and one.
    fn variable(&mut self, function: &Function, step: &Step) {
        let Some(variable) = &function.variable else { return };
        if is_of_the_machine(variable) {
            let text = format!("{} writes {variable}, which is the machine's", function.name);
            self.say(Severity::Error, "T-07", text, "give a variable of the program", step);
        } else if meaning(variable) != Meaning::Unknown {
            let text = format!(
                "{} writes a variable {variable}; in conditions of synchronized actions that name is the machine's value",
                function.name
            );
            self.say(Severity::Warning, "T-07-name", text, "give the variable another name", step);
        }
        if let Ok(several) = wanted(function)
            && several.len() > 1
        {
            let text = format!(
                "{} gives {} values, which do not fit the one variable {variable}",
                function.name,
                several.len()
            );
            self.say(Severity::Error, "T-06", text, "name one axis", step);
        }
    }

    /// Geometry that a recording names has to be in the file.
    fn points(&mut self, function: &Function, step: &Step) {
        let Some(curve) = function.points() else { return };
        let text = format!(
            "{} records at #{curve}, and the file has no points of that name",
            function.name
        );
        let missing = Diagnostic::error("T-06", text).remedy(
            "name an anchor or a polyline of the file; where there is none (G-code), sample by distance:, count: or cycles",
        );
        self.points.push((curve.to_owned(), self.placed(missing, step)));
    }

    /// Values that are spread evenly are kept in memory to the end of their scope.
    fn evenly(&mut self, function: &Function, step: &Step) {
        let count = match &function.call {
            Call::StartSensorRecording(recording) => match recording.sampling {
                Sampling::ByCount(count) => Some(count),
                _ => None,
            },
            Call::GetPoints(measurement) if measurement.points.is_none() => measurement.number_of_points,
            _ => None,
        };
        if let Some(count) = count.filter(|count| *count > MOST_EVENLY) {
            let text = format!(
                "{} spreads {count} values evenly, and {MOST_EVENLY} are the most",
                function.name
            );
            self.say(Severity::Error, "T-09", text, "sample by cycles, time: or distance:", step);
        }
    }

    fn keep(&mut self, line: String, compiled: Compiled, step: &Step) {
        if self.compiled.contains_key(&line) {
            return;
        }
        self.operations += compiled.operations.len();
        let (most, room) = (machine::watch::CONDITIONS, machine::watch::OPERATIONS);
        if self.order.len() >= most || self.operations > room {
            let text = format!(
                "the program has more conditions than the cycle takes: {} with {} operations, {most} with {room} are the most",
                self.order.len() + 1,
                self.operations
            );
            self.say(Severity::Error, "T-09", text, "take some out", step);
            return;
        }
        self.order.push(line.clone());
        self.compiled.insert(line, compiled);
    }

    fn sensors(&mut self, function: &Function, step: &Step) {
        match wanted(function) {
            Err((message, remedy)) => self.say(Severity::Error, "T-05", message, &remedy, step),
            Ok(sensors) => {
                let missing: Vec<String> = sensors
                    .iter()
                    .filter(|s| signal_of(s).is_none())
                    .map(ToString::to_string)
                    .collect();
                if function.value("required") == Some(&crate::Value::State(true)) && !missing.is_empty() {
                    let text = format!("{} requires {}, and this machine has none", function.name, missing.join(", "));
                    self.say(
                        Severity::Error,
                        "T-05-required",
                        text,
                        "run it on a machine with that sensor",
                        step,
                    );
                }
                self.missing.extend(missing);
            }
        }
    }

    fn start(&mut self, kind: Kind, id: &TraceId, step: &Step) {
        let key = (kind, id.clone());
        if self.active.contains_key(&key) {
            self.say(
                Severity::Error,
                "T-02",
                format!("{} {id} is started while it is active", kind.word()),
                "stop it first, or give another id",
                step,
            );
            return;
        }
        self.started.insert(key.clone());
        self.active.insert(key, self.depth);
    }

    fn stop(&mut self, kind: Kind, id: &TraceId, step: &Step) {
        let key = (kind, id.clone());
        if self.active.remove(&key).is_some() {
            return;
        }
        let (severity, why) = if self.started.contains(&key) {
            (Severity::Warning, "is not active any more here")
        } else {
            (Severity::Error, "was never started on this path")
        };
        self.say(
            severity,
            "T-01",
            format!("{} {id} is stopped and {why}", kind.word()),
            "start it before, or take the stop out",
            step,
        );
    }

    /// A workplan is over: recordings that began in it are.
    fn end_scope(&mut self, depth: usize, step: &Step) {
        let over: Vec<_> = self
            .active
            .iter()
            .filter(|((kind, _), began)| *kind == Kind::Recording && **began >= depth)
            .map(|(key, _)| key.clone())
            .collect();
        for key in over {
            self.active.remove(&key);
            let text = format!("{} {} has no stop: its workplan's end ends it", key.0.word(), key.1);
            self.say(Severity::Remark, "T-04", text, "", step);
        }
    }

    fn say(&mut self, severity: Severity, code: &'static str, message: String, remedy: &str, step: &Step) {
        let found = Diagnostic::new(severity, code, message).remedy(remedy);
        self.diagnostics.add(self.placed(found, step));
    }

    /// With the place of the step: a column within the line is told when the step is an entity.
    fn placed(&self, mut found: Diagnostic, step: &Step) -> Diagnostic {
        let column = found.column;
        found = found.in_file(self.file.clone());
        (found.line, found.column) = (0, 0);
        match step.origin.place {
            // `(trace:1 ...`: the line begins behind the bracket.
            Place::Text { line, .. } => found.at_line(line, column + 1),
            Place::Entity(id) => {
                if column > 0 {
                    found.message = format!("column {column} of the function: {}", found.message);
                }
                found.at_entity(id)
            }
            Place::Given => found,
        }
    }
}

/// Most values that a recording spreads evenly over its scope: it keeps eight times as many until it ends.
pub const MOST_EVENLY: u32 = 100_000;

/// True for the name of a variable that is bound to the machine: nobody writes it.
pub fn is_of_the_machine(variable: &str) -> bool {
    let small = variable.to_ascii_lowercase();
    small.starts_with("sensor:") || small.starts_with("trace:")
}

/// The kind of a function along a path.
pub const ALONG: &str = "other functions";

/// Name of a condition along a path that names sensors to record; what stands under it are aliases with axes, as `drive-load-x`.
pub const ALONG_RECORD: &str = "trace.record";
/// Name of the one that says when: `every 4 cycles`, or what `its_sampling` takes.
pub const ALONG_SAMPLING: &str = "trace.sampling";

/// The lines of the vocabulary in a function as the program has it: its text, or what stands along a path.
///
/// Along a path a line is the name of a condition, or its mode; several of one name come joined by commas. The short form of
/// [`ALONG_RECORD`] becomes the recording that it means.
pub fn lines(raw: &RawNcFunction) -> Vec<String> {
    if raw.kind != ALONG {
        return if is_line(&raw.text) {
            vec![with_variables(raw)]
        } else {
            vec![]
        };
    }
    let mut found = Vec::new();
    for (name, mode) in &raw.properties {
        if is_line(name) {
            found.push(name.clone());
        } else if is_line(mode) {
            let mut rest = mode.as_str();
            while let Some(at) = rest[1..].find(",trace:") {
                found.push(rest[..=at].to_owned());
                rest = &rest[at + 2..];
            }
            found.push(rest.to_owned());
        }
    }
    if let Some(sensors) = raw.properties.get(ALONG_RECORD) {
        let sensors: Vec<String> = sensors.split(',').map(along_sensor).collect();
        let sampling = raw.properties.get(ALONG_SAMPLING).map_or_else(String::new, |said| {
            let words: Vec<&str> = said.split_whitespace().collect();
            match words[..] {
                ["every", n, "cycles" | "cycle"] => format!(" its_sampling={n}"),
                _ => format!(" its_sampling={}", said.replace(' ', "")),
            }
        });
        found.push(format!(
            "{} start_sensor_recording its_function_id=path its_sensors={}{sampling}",
            crate::PREFIX,
            sensors.join(",")
        ));
    }
    found
}

/// The line with the present values of the program's variables in its condition: a condition is made when it is started, and what the
/// program assigns later changes it no more.
fn with_variables(raw: &RawNcFunction) -> String {
    let value = |name: &str| -> Option<f64> {
        let value = raw.properties.get(&format!("{}{name}", RawNcFunction::VARIABLE))?;
        (meaning(name) == Meaning::Unknown).then(|| value.parse().ok())?
    };
    if !raw.properties.keys().any(|name| name.starts_with(RawNcFunction::VARIABLE)) {
        return raw.text.clone();
    }
    let Ok(mut function) = parse(&raw.text) else {
        return raw.text.clone();
    };
    let mut changed = false;
    for argument in &mut function.arguments {
        if let crate::Value::Condition(condition) = &mut argument.value {
            changed |= put_in(condition, &value);
        }
    }
    if changed { function.to_string() } else { raw.text.clone() }
}

/// Puts values in the place of names; true when there was one.
fn put_in(expression: &mut Expression, value: &dyn Fn(&str) -> Option<f64>) -> bool {
    match expression {
        Expression::Name(name) => match value(name) {
            Some(number) => {
                *expression = Expression::Number(number, None);
                true
            }
            None => false,
        },
        Expression::Not(inner) | Expression::Negate(inner) => put_in(inner, value),
        Expression::Binary(_, left, right) => put_in(left, value) | put_in(right, value),
        Expression::Number(..) | Expression::Truth(_) => false,
    }
}

/// `drive-load-x` is the drive load of X; anything else is a name as it stands.
fn along_sensor(written: &str) -> String {
    let written = written.trim();
    let name = written.replace('-', "_");
    if let Some((alias, axis)) = name.rsplit_once('_')
        && axis.len() <= 2
        && let Ok(found) = streams(alias, &[axis.to_ascii_uppercase()])
        && let Some(sensor) = found.first()
    {
        return sensor.to_string();
    }
    name
}

/// The streams that a function asks for.
///
/// # Errors
/// What is wrong with a name, and what to write.
pub fn wanted(function: &Function) -> Result<Vec<Sensor>, (String, String)> {
    let found = match &function.call {
        Call::ReadSensorValue { sensor, axes } => streams(sensor, axes),
        Call::StartSensorRecording(recording) => recording
            .sensors
            .iter()
            .map(|name| streams(name, &recording.axes))
            .collect::<Result<Vec<_>, _>>()
            .map(|all| all.concat()),
        Call::Get(measurement) | Call::GetPoints(measurement) => measurement.streams(),
        _ => Ok(vec![]),
    };
    found.map_err(|refused| (refused.message, refused.remedy))
}

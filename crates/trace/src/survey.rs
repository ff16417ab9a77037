//! The functions of a program looked at before it runs: what can be known to go wrong, and what this machine cannot give.
//!
//! Fed with the steps of a look through the program, in order; the codes are those of the manual's table of errors. A function inside a
//! branch that the look did not take is seen when it runs.

use crate::compile::{Compiled, compile, signal_of};
use crate::function::CONDITION;
use crate::functions::{Call, TraceId};
use crate::ids::{Clash, Ids, Kind, started};
pub use crate::lines::{ALONG, ALONG_RECORD, ALONG_SAMPLING};
use crate::sensor::{Meaning, Sensor, meaning, once, streams};
use crate::{Function, Sampling, functions_of};
use plan::{Diagnostic, Diagnostics, Level, Place, RawNcFunction, Severity, Step, StepKind};
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
    /// What is active here.
    ids: Ids,
    /// What was ever started.
    started: BTreeSet<(Kind, TraceId)>,
    /// Inside an operation that the program itself has.
    inside_operation: bool,
    diagnostics: Diagnostics,
    all_modes: bool,
    operations: usize,
    /// Geometry that recordings name, and what is to be said when the file has it not.
    points: Vec<(String, Diagnostic)>,
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
    /// What the program starts somewhere, each by its kind and id.
    pub started: Vec<(&'static str, TraceId)>,
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
                Level::Workplan => self.ids.workplan_begins(),
                Level::Operation => self.inside_operation = !marker.derived,
                _ => {}
            },
            StepKind::End(Level::Workplan) => {
                for (kind, id) in self.ids.workplan_ends() {
                    let text = format!("{} {id} has no stop: its workplan's end ends it", kind.word());
                    self.say(Severity::Remark, "T-04", text, "", step);
                }
            }
            StepKind::End(Level::Toolpath) => drop(self.ids.path_ends()),
            StepKind::End(Level::Operation) => self.inside_operation = false,
            StepKind::NcFunction(function) => self.function(function, step),
            _ => {}
        }
    }

    /// What is begun and not over here: recordings, logging, synchronized actions. Each by its kind and id, in order.
    pub fn begun(&self) -> impl Iterator<Item = (&'static str, &TraceId)> {
        self.ids.begun().map(|(kind, id)| (kind.word(), id))
    }

    /// The program is over.
    pub fn finish(mut self) -> Found {
        for (kind, id) in self.ids.begun() {
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
            started: self.started.into_iter().map(|(kind, id)| (kind.word(), id)).collect(),
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
        for read in functions_of(raw) {
            match read {
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
                    if raw.condition.is_some() && function.definition.is_some_and(|d| d.key(CONDITION).is_none()) {
                        let text = format!("{} takes no condition: the file's typed one is not looked at", function.name);
                        self.say(Severity::Warning, "T-06-condition", text, "take it out", step);
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
        self.id(function, step, along_a_path);
        match &function.call {
            Call::Unknown => {
                let meant = crate::meant(&function.name).map_or_else(String::new, |name| format!("did you mean {name}?"));
                let text = format!(
                    "the function {} is unknown here: it is kept and shown, and does nothing",
                    function.name
                );
                self.say(Severity::Warning, "trace-unknown", text, &meant, step);
            }
            Call::LogNcEvents { on: true, kinds, .. } => self.kinds(kinds, step),
            Call::StartSynchronizedAction(action) => {
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

    /// Its id is free when it starts something, and its own when it stops it.
    fn id(&mut self, function: &Function, step: &Step, along_a_path: bool) {
        let clash = self.ids.follow(&function.call, along_a_path).err();
        if let Some((kind, id)) = started(&function.call).filter(|_| clash.is_none()) {
            self.started.insert((kind, id.clone()));
        }
        let Some(clash) = clash else { return };
        let (severity, why) = match &clash {
            Clash::Stopped(id, kind, _) if self.started.contains(&(*kind, id.clone())) => {
                (Severity::Warning, "is not active any more here")
            }
            _ => (Severity::Error, "was never started on this path"),
        };
        self.say(severity, clash.code(), clash.text(why), &clash.remedy(), step);
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

pub use plan::line::is_of_the_machine;

/// The streams that a function asks for: a set, so one that is named twice, by an alias too, is taken once.
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
    found.map(once).map_err(|refused| (refused.message, refused.remedy))
}

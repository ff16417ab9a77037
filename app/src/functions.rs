//! Functions of the traceability vocabulary in a run: what the shell knows for them, where their rows go, and what is told of them.

mod sentence;

pub use sentence::{digits, symbol};

use crate::execution::{Order, Work};
use crate::failure::Failure;
use crate::program::Program;
use crate::survey::{Check, State, beforehand, with_code};
use crate::{clock, say, shop};
use ledger::{Action, Event, Level};
use plan::executed::{AsExecuted, ResultValue};
use plan::{Next, ProgramStream, Severity, Tables};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::functions::{FunctionRow, FunctionRows, StreamName, Streams};
use store::segment::{Offered, Pace, Recorder as Segments, Settings};
use store::{DataDirectory, JobId, MachineFile};
use trace::record::{BY_ITSELF, EVENT, Known, Row, Stream};
use trace::survey::{Found, Survey};
use units::{Millimetres, Timestamp, ToolNumber};

/// Looks a program through for its functions, without planning it.
///
/// # Errors
/// It cannot be read.
pub fn look(program: &Program, tables: &Tables) -> Result<Found, Failure> {
    Ok(look_at(&mut *program.stream(tables)?, program))
}

/// The same for the part of a program that a stream gives.
pub fn look_at(stream: &mut dyn ProgramStream, program: &Program) -> Found {
    let mut survey = Survey::new(&program.name);
    let mut answer = None;
    loop {
        match stream.next(answer.take()) {
            Next::Step(step) => survey.step(&step),
            Next::Ask(question) => answer = Some(beforehand(&question)),
            // What stops the program is found by its check.
            Next::End | Next::Alarm(_) => break,
        }
    }
    let mut found = survey.finish();
    if let Some(step_nc) = program.step_nc() {
        // A step of a STEP file knows its instance; a person looks for the line.
        let unplaced = found.diagnostics.iter_mut().filter(|diagnostic| diagnostic.line == 0);
        for diagnostic in unplaced {
            let row = diagnostic.entity.and_then(|entity| step_nc.file().row(entity));
            if let Some(row) = row {
                let place = step_nc.file().position(step_nc.file().offset(row));
                diagnostic.line = u32::try_from(place.line).unwrap_or(u32::MAX);
                diagnostic.column = u32::try_from(place.column).unwrap_or(u32::MAX);
            }
        }
    }
    if found.points.is_empty() {
        return found;
    }
    let points = program.step_nc().map(|p| p.named_points()).unwrap_or_default();
    found.with_geometry(|name| points.contains_key(name))
}

/// The lines of a check about functions; `level` is the level of who acts.
pub fn checks(found: &Found, level: Option<Level>, all: &mut Vec<Check>) {
    if found.counts.is_empty() && found.diagnostics.is_empty() {
        return;
    }
    let mut say = |state, text: String| {
        all.push(Check {
            name: "functions",
            state,
            text,
        });
    };
    let counts: Vec<String> = found
        .counts
        .iter()
        .map(|(name, n)| if *n == 1 { name.clone() } else { format!("{name} {n} times") })
        .collect();
    if !counts.is_empty() {
        say(State::Ok, counts.join(", "));
    }
    for diagnostic in &found.diagnostics {
        let state = match diagnostic.severity {
            Severity::Remark => State::Ok,
            Severity::Warning => State::Warning,
            Severity::Error => State::Fail,
        };
        say(state, with_code(diagnostic, diagnostic.to_string()));
    }
    if found.all_modes
        && let Err(refused) = ledger::may(level, Action::StartAllModes)
    {
        say(State::Fail, format!("T-11: {refused}: such an action outlives the program"));
    }
}

/// The lines of a check about functions where the text protocol drives the machine, which has no word for any of them.
pub fn checks_of_text_link(found: &Found, all: &mut Vec<Check>) {
    let reacts = |name: &str| matches!(name, "start_synchronized_action" | "set_alarm");
    let (stopping, other): (Vec<&String>, Vec<&String>) = found.counts.keys().partition(|name| reacts(name));
    let mut say = |state, text: String| {
        all.push(Check {
            name: "functions",
            state,
            text,
        });
    };
    if !stopping.is_empty() {
        let text = format!(
            "the program has conditions or alarms that the machine acts on ({}), and the text protocol has no word for them: run it over \
             the default link (toolmark controller without --link text, toolmark run without it), or take them out",
            stopping.into_iter().cloned().collect::<Vec<_>>().join(", ")
        );
        say(State::Fail, text);
    }
    if !other.is_empty() {
        let text = format!(
            "the text protocol brings no measurements back, so nothing is recorded of {}: use the default link for that",
            other.into_iter().cloned().collect::<Vec<_>>().join(", ")
        );
        say(State::Warning, text);
    }
}

/// What a run knows of machine, tools and operator.
pub fn known(order: &Order<'_>) -> Known {
    let machine = order.machine;
    Known {
        machine: object(of_machine(machine, &order.tables, order.drives.is_simulated())),
        operator: {
            let mut operator = object(order.person.clone());
            operator.insert("name".to_owned(), Value::from(order.who));
            // What says nothing of the person stays out: texts that nobody gave, and that nothing is claimed.
            operator.retain(|key, value| *value != "" && *value != false && key != "local");
            if !operator.contains_key("role") {
                operator.insert("role".to_owned(), Value::from("operator"));
            }
            operator
        },
        coolant: object(of_coolant(&machine.coolant)),
        tools: order
            .tables
            .tools
            .iter()
            .map(|(number, tool)| {
                let data = json!({
                    "name": tool.name,
                    "length_mm": tool.geometry.0.xyz[2],
                    "geometry_mm": tool.geometry.0.xyz,
                    "wear_mm": tool.wear.0.xyz,
                    "diameter_mm": tool.diameter.map(|d| d.0),
                    "radius_mm": tool.diameter.map(|d| d.0 / 2.0),
                    "usage_position": "unavailable",
                    "life_used": "unavailable",
                    "asset_id": format!("{}/T{}", machine.name, number.0),
                });
                (number.0, object(data))
            })
            .collect(),
        points: match order.work {
            Work::Program(program) => program.step_nc().map(|p| p.named_points()).unwrap_or_default(),
            Work::Live(_) => Default::default(),
        },
    }
}

fn of_machine(machine: &MachineFile, tables: &Tables, simulated: bool) -> Value {
    let axes: Vec<String> = units::Axis::ALL
        .into_iter()
        .filter(|axis| machine.axis(*axis).is_some())
        .map(|axis| axis.letter().to_ascii_uppercase().to_string())
        .collect();
    let plate = &machine.nameplate;
    let said = |item: &Option<String>| item.clone().unwrap_or_else(|| "unavailable".to_owned());
    let (kind, turns) = match machine.kind {
        store::MachineKind::Mill => ("mill", "the tool turns"),
        store::MachineKind::Lathe => ("lathe", "the part turns"),
    };
    // Work offsets may be frames of any direction: the origin is what a shop calls the offset.
    let offsets = tables
        .work_offsets
        .iter()
        .map(|(name, frame)| (name.clone(), json!(frame.origin)));
    // The time in records is the start of the run and the servo cycles since; a simulation asks no clock of the computer's.
    let (clock, sync_offset) = if simulated {
        ("start of the run, simulated cycles since", None)
    } else {
        ("system clock at the start, servo cycles since", clock::sync_offset())
    };
    json!({
        "name": machine.name,
        "model": plate.model.as_ref().unwrap_or(&machine.name),
        "kind": kind,
        "brand": said(&plate.brand),
        "serial_number": said(&plate.serial_number),
        "control": machine.control.map_or("toolmark", |c| c.word()),
        "kinematics": format!("linear axes {}, {turns}", axes.join(" ")),
        "clock_source": clock,
        "sync_offset_s": sync_offset.map_or_else(|| json!("unavailable"), |offset| json!(offset.0)),
        "software": format!("toolmark {}", env!("CARGO_PKG_VERSION")),
        "axes": axes,
        "work_offsets_mm": offsets.collect::<Map<_, _>>(),
        "source": if simulated { "SIMULATED" } else { "controller" },
    })
}

fn of_coolant(coolant: &store::Coolant) -> Value {
    json!({
        "product": coolant.product, "kind": coolant.kind, "concentration_percent": coolant.concentration_percent,
        "ph": coolant.ph, "batch": coolant.batch, "filled": coolant.filled,
    })
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members.into_iter().filter(|(_, value)| !value.is_null()).collect(),
        _ => Map::new(),
    }
}

/// The diameters of tools, for cutting speeds.
pub fn diameters(tables: &Tables) -> Vec<(ToolNumber, Millimetres)> {
    tables
        .tools
        .iter()
        .filter_map(|(n, tool)| Some((*n, tool.diameter?)))
        .collect()
}

/// Takes values of recordings to the disk; nothing is made before the first comes.
pub struct Values {
    folder: PathBuf,
    target: PathBuf,
    start: Timestamp,
    streams: Streams,
    segments: Option<Segments<FunctionRows>>,
    failed: Option<Failure>,
    pace: Pace,
}

impl Values {
    /// For a job whose values are made in `making` and kept in `folder`.
    pub fn new(making: PathBuf, folder: &Path, start: Timestamp, pace: Pace) -> Values {
        Values {
            folder: making,
            target: folder.join(store::functions::FILE),
            start,
            streams: Streams::default(),
            segments: None,
            failed: None,
            pace,
        }
    }

    /// A value.
    pub fn take(&mut self, row: &Row, stream: &Stream) {
        if self.failed.is_some() {
            return;
        }
        self.streams.know(row.stream, || StreamName {
            run: stream.run,
            recording: stream.id.clone(),
            stream: stream.name.clone(),
            unit: stream.unit.to_owned(),
            derived: stream.derived,
        });
        if self.segments.is_none() {
            let rows = FunctionRows::new(self.start, &self.target, self.streams.clone());
            match Segments::begin(&self.folder, rows, BTreeMap::new(), &Settings::new(self.pace)) {
                Ok(begun) => self.segments = Some(begun),
                Err(error) => self.failed = Some(shop::failure(error)),
            }
        }
        let Some(segments) = &mut self.segments else { return };
        let offered = segments.offer(&FunctionRow {
            tick: row.tick,
            stream: row.stream,
            value: row.value.unwrap_or(f64::NAN),
            quality: row.quality,
            step: row.step,
            workingstep: row.workingstep,
            tool: row.tool,
        });
        match offered {
            // A missed value is counted in a gap of its file.
            Offered::Taken | Offered::Missed => {}
        }
    }

    /// Closes the recording and keeps it as a file of the job; gives the file, if there is one.
    ///
    /// # Errors
    /// The disk refused.
    pub fn end(self, directory: &mut DataDirectory, job: JobId, at: Timestamp) -> Result<Option<PathBuf>, Failure> {
        if let Some(failed) = self.failed {
            return Err(failed);
        }
        let Some(segments) = self.segments else { return Ok(None) };
        segments.end().map_err(shop::failure)?;
        let merged = directory.keep_values(job, &self.target, at).map_err(shop::failure)?;
        for gap in merged.iter().flat_map(|merged| &merged.gaps) {
            eprintln!("warning: the values of recordings have a gap: {gap}");
        }
        Ok(merged.map(|merged| merged.finished.path))
    }
}

/// A record of a function, for report and screen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Told {
    /// Seconds since the job began.
    pub t_s: f64,
    /// The function.
    pub function: String,
    /// One sentence.
    pub text: String,
    /// All of it.
    pub data: BTreeMap<String, Value>,
}

/// True for a record that a function of the program made; every job has one of its machine besides.
pub fn is_of_the_program(event: &Event) -> bool {
    event.kind == EVENT && !event.detail.contains_key(BY_ITSELF)
}

/// The records of functions among the events of a run.
pub fn told<'e>(events: impl IntoIterator<Item = &'e Event>) -> Vec<Told> {
    let mut start = None;
    let mut all = Vec::new();
    for event in events {
        let start = *start.get_or_insert(event.at_ns);
        if is_of_the_program(event) {
            all.push(Told {
                t_s: (event.at_ns - start) as f64 / 1e9,
                function: event.detail.get("function").map_or_else(String::new, sentence::plain),
                text: sentence::of(&event.detail),
                data: event.detail.clone(),
            });
        }
    }
    all
}

/// Records that are shown on the screen; all of them are in report and log.
const SHOWN: usize = 20;

/// The records on the screen.
pub fn print(all: &[Told]) {
    for told in all.iter().take(SHOWN) {
        say(&format!("  {:>9.3} s  {:26} {}", told.t_s, told.function, told.text));
    }
    if all.len() > SHOWN {
        say(&format!(
            "  ... {} more records of functions: toolmark trace show last --events",
            all.len() - SHOWN
        ));
    }
}

/// Alarms that functions set, as a reader of the report has to know them.
pub fn alarms(all: &[Told]) -> Vec<String> {
    let mut found = Vec::new();
    for told in all {
        let actions = told.data.get("actions").and_then(Value::as_array);
        let records = actions.into_iter().flatten().filter_map(Value::as_object);
        let own: Map<String, Value> = told.data.clone().into_iter().collect();
        for record in std::iter::once(&own).chain(records) {
            if record.get("state") == Some(&Value::from("set")) {
                let word = |key: &str| record.get(key).map_or_else(String::new, sentence::plain);
                found.push(format!(
                    "the program set alarm {} '{}' at {:.3} s; its reaction: {}",
                    word("alarm"),
                    word("text"),
                    told.t_s,
                    word("reaction").replace('_', " ")
                ));
            }
        }
    }
    found
}

/// Puts single values on the workingstep of the run during which, or before which, they were taken.
pub fn results(events: &[Event], run: &mut AsExecuted) {
    for event in events.iter().filter(|e| e.kind == EVENT) {
        let at = event.at();
        let mut values = Vec::new();
        gather(
            &event.detail.iter().map(|(k, v)| (k.clone(), v.clone())).collect(),
            &mut values,
        );
        if values.is_empty() {
            continue;
        }
        let place = run.workingsteps.iter().rposition(|w| w.start <= at).unwrap_or(0);
        let Some(workingstep) = run.workingsteps.get_mut(place) else {
            continue;
        };
        for (name, value, unit, quality) in values {
            workingstep.results.push(ResultValue {
                name,
                value,
                unit,
                quality,
                at,
            });
        }
    }
}

/// The numbers of a record: name, value, unit, quality.
fn gather(data: &Map<String, Value>, found: &mut Vec<(String, f64, String, String)>) {
    let text = |from: &Map<String, Value>, key: &str| from.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let function = text(data, "function");
    for one in data.get("values").and_then(Value::as_array).into_iter().flatten() {
        if let (Some(members), Some(value)) = (one.as_object(), one.get("value").and_then(Value::as_f64)) {
            found.push((
                text(members, "stream"),
                value,
                text(members, "unit"),
                text(members, "quality"),
            ));
        }
    }
    for (key, unit) in [("duration_s", "SECOND"), ("since_program_began_ms", "MILLISECOND")] {
        if let Some(value) = data.get(key).and_then(Value::as_f64) {
            let label = data.get("label").or(data.get("executable")).and_then(Value::as_str);
            let name = label.map_or_else(|| function.clone(), |label| format!("{function} {label}"));
            found.push((name, value, unit.to_owned(), text(data, "quality")));
        }
    }
    for action in data.get("actions").and_then(Value::as_array).into_iter().flatten() {
        if let Some(members) = action.as_object() {
            gather(members, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_record_of_a_machine_holds_its_nameplate_offsets_and_clock() {
        let text = format!(
            "{}\n[nameplate]\nbrand = \"Krone\"\nserial_number = \"77-1\"\n[coolant]\nproduct = \"Oil 46\"\nph = 9.0\n",
            include_str!("../../store/machines/sim-mill.toml")
        );
        let machine = MachineFile::parse(&text, "m.toml").expect("a good file");
        let mut tables = Tables::empty();
        tables
            .work_offsets
            .insert("G54".to_owned(), units::Transform::shift([-500.0, -350.0, -1.5]));
        let told = of_machine(&machine, &tables, true);
        let expected = [
            ("brand", json!("Krone")),
            ("model", json!("sim-mill")),
            ("serial_number", json!("77-1")),
            ("control", json!("toolmark")),
            ("kinematics", json!("linear axes X Y Z, the tool turns")),
            ("work_offsets_mm", json!({ "G54": [-500.0, -350.0, -1.5] })),
            ("clock_source", json!("start of the run, simulated cycles since")),
            ("sync_offset_s", json!("unavailable")),
        ];
        for (key, value) in expected {
            assert_eq!(told[key], value, "{key}");
        }
        assert_eq!(
            Value::Object(object(of_coolant(&machine.coolant))),
            json!({ "product": "Oil 46", "ph": 9.0 })
        );
        let real = of_machine(&machine, &tables, false);
        assert_eq!(real["clock_source"], "system clock at the start, servo cycles since");
    }
}

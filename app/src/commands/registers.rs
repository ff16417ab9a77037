//! What `toolmark tool` and `toolmark offset` share: values of the machine's tables in force, set by people, each change with who, why,
//! before and after.
//!
//! The machine file holds the values of the first day; from the first change on they live in the data directory.

use super::{Done, print_json};
use crate::cli::{Common, DisplayUnits};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::program::machine_for;
use crate::{clock, say, shop};
use ledger::{Action, ChangeRequest, Event};
use serde_json::{Value, json};
use sizing::{Applied, Unit, entry};
use std::collections::BTreeMap;
use store::{MachineFile, Register, registers};
use units::{Axis, Millimetres};

/// A wear beyond this is no wear: the tool is another one, or the digit is in the wrong place. mm, of the tip.
const MOST_WEAR: f64 = 10.0;
/// A change of wear beyond this at once is a slip of the finger more often than a correction. mm, of the tip.
const LARGEST_STEP: f64 = 0.5;
/// Nothing that turns in a spindle is thicker, mm.
const MOST_DIAMETER: f64 = 1000.0;

/// A value in force, and the event that set it; `None` for the machine file's.
pub type InForce = BTreeMap<Register, (f64, Option<u64>)>;

/// The machine that is meant. `sim` may be two machines: without a program it is the mill.
///
/// # Errors
/// There is no such machine.
pub fn machine_meant(common: &Common) -> Result<MachineFile, Failure> {
    machine_for(&common.machine, false)
}

/// The values in force, and where they come from. Changes nothing.
///
/// # Errors
/// A process works in the data directory, or it cannot be read.
pub fn in_force(common: &Common, machine: &MachineFile) -> Result<(InForce, Told), Failure> {
    let mut values: InForce = (registers::first_day(machine).into_iter())
        .map(|(register, value)| (register, (value, None)))
        .collect();
    let mut told = Told::default();
    if let Some(directory) = shop::directory_to_look(common)? {
        for (register, (value, event)) in directory.registers(machine).map_err(shop::failure)? {
            if let Some(event) = directory.event(event).map_err(shop::failure)? {
                told.0.insert(event.sequence, event);
            }
            values.insert(register, (value, Some(event)));
        }
    }
    Ok((values, told))
}

/// The events behind the values.
#[derive(Default)]
pub struct Told(BTreeMap<u64, Event>);

impl Told {
    /// The newest of some events that is no first value from the machine file, for JSON.
    pub fn newest(&self, events: impl Iterator<Item = u64>) -> Option<Value> {
        let event = self.newest_event(events)?;
        Some(json!({
            "event": event.sequence,
            "at": clock::utc(event.at()),
            "who": event.detail.get("who"),
            "why": event.detail.get("why"),
        }))
    }

    /// The same in words.
    pub fn newest_words(&self, events: impl Iterator<Item = u64>) -> String {
        let text = |event: &Event, name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        self.newest_event(events).map_or_else(String::new, |event| {
            format!(
                "{} {}: {} (event {})",
                clock::local(event.at()),
                text(event, "who"),
                text(event, "why"),
                event.sequence
            )
        })
    }

    fn newest_event(&self, events: impl Iterator<Item = u64>) -> Option<&Event> {
        let is_first = |event: &Event| event.detail.get("before").is_some_and(Value::is_null) && first_value(event);
        events.max().and_then(|n| self.0.get(&n)).filter(|event| !is_first(event))
    }
}

fn first_value(event: &Event) -> bool {
    let why = event.detail.get("why").and_then(Value::as_str);
    why.is_some_and(|why| why.starts_with("first value from the machine file"))
}

/// A value to be set, as it was typed.
pub struct Setting {
    /// Which.
    pub register: Register,
    /// The option, for messages.
    pub option: &'static str,
    /// What was typed.
    pub text: String,
}

/// The unit of what is typed and shown.
pub fn unit_of(common: &Common) -> Unit {
    match common.units.unwrap_or_default() {
        DisplayUnits::Mm => Unit::Mm,
        DisplayUnits::Inch => Unit::Inch,
    }
}

/// Sets values: all of them or none.
///
/// # Errors
/// A number that cannot be, nobody stands behind it, no right to it, or the data directory is in use.
pub fn set(machine: &MachineFile, settings: &[Setting], common: &Common) -> Done {
    if settings.is_empty() {
        return Err(Failure::usage("nothing was given to be set; --help lists what can be"));
    }
    let mut wanted = Vec::new();
    for setting in settings {
        wanted.push((setting, checked(machine, setting, unit_of(common))?));
    }
    let why = common.reason.as_deref().map(str::trim).filter(|why| !why.is_empty());
    let why = why.ok_or_else(|| Failure::usage("a change needs a reason: give --reason TEXT"))?;
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let acting = Acting::of(&directory, common)?;
    for (setting, _) in &wanted {
        acting.must(action_of(&setting.register), &mut directory, at)?;
    }
    directory.take_over(machine, &acting.name, at).map_err(shop::failure)?;
    let mut requests = Vec::new();
    for (setting, to) in &wanted {
        let path = setting.register.of(machine);
        let present = directory.value(&path).map_err(shop::failure)?;
        let step = (to - present.unwrap_or(0.0)).abs() / counts(machine, &setting.register);
        if is_wear(&setting.register) && step > LARGEST_STEP {
            acting.must(Action::SetLargeWear, &mut directory, at)?;
        }
        if present == Some(*to) {
            continue;
        }
        requests.push(ChangeRequest {
            path,
            to: *to,
            expected: present,
            who: acting.name.clone(),
            why: why.to_owned(),
            when: at,
        });
    }
    let changes = directory.change_values(&requests).map_err(shop::failure)?;
    let made: Vec<Made> = (requests.iter().zip(&changes))
        .map(|(request, change)| Made {
            path: request.path.clone(),
            before: change.before,
            after: change.after,
            event: change.event.sequence,
        })
        .collect();
    tell(machine, &made, &acting, why, common)
}

/// A change that was made.
struct Made {
    path: String,
    before: Option<f64>,
    after: f64,
    event: u64,
}

fn tell(machine: &MachineFile, made: &[Made], acting: &Acting, why: &str, common: &Common) -> Done {
    if common.json {
        let all: Vec<Value> = (made.iter())
            .map(|m| {
                let change = m.after - m.before.unwrap_or(0.0);
                let change = (change * 1e9).round() / 1e9;
                json!({ "register": m.path, "before": m.before, "after": m.after, "change": change, "event": m.event })
            })
            .collect();
        print_json(&json!({
            "machine": machine.name,
            "changes": all,
            "unit": "mm",
            "by": acting.json(),
            "why": why,
        }))?;
        return Ok(Exit::Good);
    }
    if made.is_empty() {
        say("nothing was changed: it is so already");
    }
    for m in made {
        let shown = |value: Option<f64>| value.map_or_else(|| "not set".to_owned(), |v| shown(&m.path, v, common));
        let diameter = if counts_a_diameter(machine, &m.path) {
            " (diameter)"
        } else {
            ""
        };
        say(&format!(
            "{}{diameter}: {} -> {}, by {}; {why} (event {})",
            m.path,
            shown(m.before),
            shown(Some(m.after)),
            acting.words(),
            m.event
        ));
    }
    Ok(Exit::Good)
}

/// A value in the unit of `--units`; a tip direction has none.
fn shown(path: &str, value: f64, common: &Common) -> String {
    if path.ends_with("_mm") {
        unit_of(common).words(Millimetres(value))
    } else {
        value.to_string()
    }
}

fn counts_a_diameter(machine: &MachineFile, path: &str) -> bool {
    let inside = path.strip_prefix(&format!("{}/", machine.name)).and_then(Register::parse);
    inside.is_some_and(|register| counts(machine, &register) > 1.5)
}

/// 2 where a register counts diameters, else 1.
fn counts(machine: &MachineFile, register: &Register) -> f64 {
    let axis = match register {
        Register::ToolGeometry { axis, .. } | Register::ToolWear { axis, .. } | Register::WorkOffset { axis, .. } => Some(*axis),
        _ => None,
    };
    if axis.is_some_and(|axis| machine.counts_diameters(axis)) {
        2.0
    } else {
        1.0
    }
}

fn is_wear(register: &Register) -> bool {
    matches!(register, Register::ToolWear { .. } | Register::ToolRadiusWear(_))
}

/// What a change of a register asks for.
fn action_of(register: &Register) -> Action {
    match register {
        register if is_wear(register) => Action::SetWear,
        Register::WorkOffset { .. } => Action::SetWorkOffset,
        _ => Action::SetGeometry,
    }
}

/// The number that was typed, mm, in the range of its register.
fn checked(machine: &MachineFile, setting: &Setting, unit: Unit) -> Result<f64, Failure> {
    let Setting { register, option, text } = setting;
    let wrong = |what: String| Failure::usage(format_args!("--{option} {text}: {what}"));
    let number = entry::number(text).map_err(|e| wrong(e.to_string()))?;
    let is_length = !matches!(register, Register::ToolTipDirection(_));
    // What a control shows is a decimal number: the dust of the conversion from inches is none.
    let value = if is_length {
        (unit.length(number).0 * 1e9).round() / 1e9
    } else {
        number
    };
    let outside = |low: f64, high: f64, why: &str| {
        let words = |mm: f64| unit.words(Millimetres(mm));
        wrong(format!("{} to {} can be: {why}", words(low), words(high)))
    };
    let within = |low: f64, high: f64, why: &str| {
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(outside(low, high, why))
        }
    };
    let travel = |axis: Axis| {
        let file = machine
            .axis(axis)
            .ok_or_else(|| wrong(format!("{} has no axis {axis}", machine.name)))?;
        let factor = counts(machine, register);
        Ok::<_, Failure>((file.travel_min.0 * factor, file.travel_max.0 * factor))
    };
    let factor = counts(machine, register);
    let wear = "more is no wear but another tool: set its geometry";
    match register {
        Register::ToolGeometry { axis, .. } => {
            let (low, high) = travel(*axis)?;
            let length = high - low;
            within(-length, length, &format!("a tool is not longer than the travel of {axis}"))
        }
        Register::ToolWear { axis, .. } => {
            travel(*axis)?;
            within(-MOST_WEAR * factor, MOST_WEAR * factor, wear)
        }
        Register::ToolRadiusWear(_) => within(-MOST_WEAR, MOST_WEAR, wear),
        Register::ToolDiameter(_) if value <= 0.0 => Err(wrong("a cutting diameter is above 0".to_owned())),
        Register::ToolDiameter(_) => within(0.0, MOST_DIAMETER, "no tool is thicker"),
        Register::ToolRadius(_) => within(0.0, MOST_DIAMETER / 2.0, "no tool is thicker, and none is thinner than 0"),
        Register::ToolTipDirection(_) if value.fract() == 0.0 && (0.0..=9.0).contains(&value) => Ok(value),
        Register::ToolTipDirection(_) => Err(wrong("a tip direction is a whole number from 0 to 9".to_owned())),
        Register::WorkOffset { axis, .. } => {
            let (low, high) = travel(*axis)?;
            let length = high - low;
            within(
                low - length,
                high + length,
                &format!("the gauge point of {axis} reaches {low} to {high} mm, and the tip is at most its travel away from it"),
            )
        }
    }
}

/// Takes one change back, as long as nothing was run with it and the value is still the one it set.
///
/// # Errors
/// There is no such change, it cannot be taken back any more, or no right to it.
pub fn undo(machine: &MachineFile, sequence: u64, what: &str, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let event = directory.event(sequence).map_err(shop::failure)?;
    let applied = event.as_ref().and_then(Applied::from_event);
    let prefix = format!("{}/{what}/", machine.name);
    let inside = |applied: &Applied| Register::parse(applied.register.strip_prefix(&format!("{}/", machine.name))?);
    let found = applied
        .filter(|a| a.register.starts_with(&prefix))
        .and_then(|a| Some((inside(&a)?, a)));
    let Some((register, applied)) = found else {
        return Err(Failure::usage(format_args!(
            "event {sequence} changed no {what} of {}: toolmark {what} list shows the numbers of the last changes",
            machine.name
        )));
    };
    let acting = Acting::of(&directory, common)?;
    acting.must(action_of(&register), &mut directory, at)?;
    let negative = |message: String| Failure::negative(format_args!("error: {message}"));
    if event.as_ref().is_some_and(first_value) {
        return Err(negative(format!(
            "event {sequence} is the first value, from the machine file: set another one"
        )));
    }
    if applied.before.is_none() && matches!(register, Register::ToolDiameter(_)) {
        return Err(negative(format!(
            "{} was not set before event {sequence}, and a diameter of 0 is none: set the right one",
            applied.register
        )));
    }
    let present = directory.value(&applied.register).map_err(shop::failure)?;
    let cut = directory.has_run_since(&machine.name, sequence).map_err(shop::failure)?;
    let reason = common.reason.clone().unwrap_or_default();
    let request = sizing::undo(&applied, present, cut, &acting.name, &reason, at).map_err(|e| match e {
        sizing::UndoError::NoReason(_) => Failure::usage(e),
        sizing::UndoError::HasCut(_) => negative(format!(
            "a program has run on {} since event {sequence}: it stays in the history; set the value anew",
            machine.name
        )),
        sizing::UndoError::ChangedSince { .. } => negative(e.to_string()),
    })?;
    let change = directory.change_value(&request).map_err(shop::failure)?;
    let made = Made {
        path: request.path.clone(),
        before: change.before,
        after: change.after,
        event: change.event.sequence,
    };
    tell(machine, &[made], &acting, &request.why, common)
}

/// A length as a cell of a table; blank where there is none.
pub fn cell(value: Option<f64>, common: &Common) -> String {
    let words = value.map(|mm| unit_of(common).words(Millimetres(mm)));
    words.map_or_else(String::new, |words| words.split(' ').next().unwrap_or_default().to_owned())
}

/// The axes that a machine has, with their letter.
pub fn axes(machine: &MachineFile) -> Vec<(Axis, String)> {
    let there = Axis::ALL.into_iter().filter(|axis| machine.axis(*axis).is_some());
    there.map(|axis| (axis, axis.letter().to_string())).collect()
}

/// Axes that count diameters, for JSON.
pub fn diameters(machine: &MachineFile) -> Vec<String> {
    let counting = Axis::ALL.into_iter().filter(|axis| machine.counts_diameters(*axis));
    counting.map(|axis| axis.letter().to_string()).collect()
}

//! What the functions of a program do while it runs: recordings, single values, alarms, and what is told of each.
//!
//! The office half hands in every cycle and every step whose turn has come; out come records for the event log ([`Told`]) and rows of
//! recordings ([`Row`]). Each record says its function, its cycle, its unit and quality, and the place in the program. It never asks the
//! outside world: what it needs to know of machine, operator and tools is in [`Known`].

mod at_once;
mod context;
mod program;
mod recording;

pub use recording::{Row, Stream};

use crate::compile::{Compiled, compile, signal_of, signal_of_predefined, unit_of};
use crate::functions::{Alarm, Call, Coolant, Frequency, Reaction, ResetBy, SynchronizedAction, TraceId};
use crate::ids::Ids;
use crate::sensor::{Meaning, Sensor, meaning};
use crate::survey::{ALONG, Found, is_of_the_machine, wanted};
use crate::{Function, functions_of, parse};
use context::Context;
use machine::watch::{AlarmOrder, Firing, FiringKind, Readings, SIGNALS, Situation, WatchOrder};
use machine::{MachineParameters, Quality, Sample, State, StopCause};
use plan::{RawNcFunction, Step, StepKind, Value as PlanValue};
use recording::{Ended, Recordings, Seen};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use units::{StepId, TICK, Tick, Timestamp};

/// A record for the event log.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// The cycle.
    pub tick: Tick,
    /// The step that says so, or in which it happened.
    pub step: StepId,
    /// What is told; `function` names the function.
    pub data: Map<String, Value>,
}

/// The kind of the events that are records of functions.
pub const EVENT: &str = "trace";

/// Kinds of events of the control itself, which `log_nc_events` records.
pub const CONTROL_EVENTS: &[&str] = &[
    "alarm",
    "controlled-stop",
    "cycle-start",
    "emergency-stop",
    "emergency-stop-released",
    "encoder-bridged",
    "fault",
    "following-warning",
    "hold",
    "in-position-timeout",
    "late",
    "off-path-stop",
    "spindle-limited",
    "starved",
    "stop",
    "stopped",
];

/// A record that no function of the program asked for has this member: when it is made.
pub const BY_ITSELF: &str = "by_itself";

/// Events of one synchronized action in a second at most; more are counted.
const EVENTS_A_SECOND: u32 = 10;

/// What the shell knows of the shop.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// The machine: brand, model, serial number, control, version, axes, ...
    pub machine: Map<String, Value>,
    /// Who is signed in: name, role, level, how identified.
    pub operator: Map<String, Value>,
    /// What was entered of the coolant.
    pub coolant: Map<String, Value>,
    /// The tool table, by number.
    pub tools: BTreeMap<u32, Map<String, Value>>,
    /// Points in the program's geometry, by the name that a line gives, in the set-up's frame, mm.
    pub points: BTreeMap<String, Vec<[f64; 3]>>,
}

/// Does what the functions of a program say.
#[derive(Debug)]
pub struct Recorder {
    known: Known,
    parameters: MachineParameters,
    start: Timestamp,
    readings: Readings,
    sample: Sample,
    before: Option<Sample>,
    context: Context,
    recordings: Recordings,
    /// Watches by the line that starts them.
    numbers: BTreeMap<String, u16>,
    /// Which ids are taken, as far as the program was read.
    ahead: Ids,
    /// Which watch an id means there.
    watches: BTreeMap<TraceId, u16>,
    /// Which ids are taken where the machine is.
    ids: Ids,
    actions: BTreeMap<u16, Action>,
    alarms: BTreeMap<u16, Active>,
    /// Reactions whose effect is still to be seen.
    effects: Vec<(u16, Tick, Reaction)>,
    tool_logging: BTreeMap<TraceId, u64>,
    event_logging: BTreeMap<TraceId, (Vec<String>, u64)>,
    operator_logging: BTreeMap<TraceId, u64>,
    /// What is in variables of the program, as far as functions told or wrote it; `None` where one was to write and had no value.
    variables: BTreeMap<String, Option<f64>>,
    level: Option<u8>,
    /// Watches that were loaded and run, or ran.
    next_run: u32,
    /// The machine has left the program, by a reset or a restart: actions and recordings wait until it is taken up again.
    waits: bool,
    /// What is in all modes outlives the run.
    machine_goes_on: bool,
    told: Vec<Told>,
    state: State,
    /// The first cycle was heard of.
    opened: bool,
}

/// A synchronized action that was started.
#[derive(Clone, Debug)]
struct Action {
    does: SynchronizedAction,
    runs: bool,
    run: u32,
    fired: u64,
    window: Tick,
    in_window: u32,
    suppressed: u64,
    streams: Vec<u32>,
}

/// An alarm that is active.
#[derive(Clone, Debug)]
struct Active {
    alarm: Alarm,
    since: Tick,
    repeated: u64,
    told: Tick,
}

impl Recorder {
    /// A recorder for a run that begins at `start`. `found` is what the look through the program gave; its conditions are to be loaded in
    /// the same order ([`Recorder::loaded`]).
    pub fn new(parameters: &MachineParameters, start: Timestamp, known: Known, found: &Found) -> Self {
        let mut readings = Readings::new();
        for (number, tool) in &known.tools {
            if let Some(diameter) = tool.get("diameter_mm").and_then(Value::as_f64) {
                // More tools than it has places for: their cutting speeds are unavailable.
                readings.know_tool(*number, diameter);
            }
        }
        let numbers = found.conditions.iter().enumerate();
        Recorder {
            known,
            parameters: *parameters,
            start,
            readings,
            sample: Sample::default(),
            before: None,
            context: Context::default(),
            recordings: Recordings::default(),
            numbers: numbers
                .filter_map(|(k, (line, _))| Some((line.clone(), u16::try_from(k).ok()?)))
                .collect(),
            ahead: Ids::default(),
            watches: BTreeMap::new(),
            ids: Ids::default(),
            actions: BTreeMap::new(),
            alarms: BTreeMap::new(),
            effects: Vec::new(),
            tool_logging: BTreeMap::new(),
            event_logging: BTreeMap::new(),
            operator_logging: BTreeMap::new(),
            variables: BTreeMap::new(),
            level: None,
            next_run: 1,
            waits: false,
            machine_goes_on: false,
            told: Vec::new(),
            state: State::Off,
            opened: false,
        }
    }

    /// What the machine has to be told with a step, in order with the path; a condition that is not loaded yet is given to be loaded.
    pub fn orders(&mut self, step: &Step) -> Vec<Order> {
        match &step.kind {
            StepKind::Begin(marker) => match marker.level {
                plan::Level::Workplan => self.ahead.workplan_begins(),
                plan::Level::Operation => return vec![Order::Say(WatchOrder::OperationBegins)],
                _ => {}
            },
            StepKind::End(plan::Level::Workplan) => drop(self.ahead.workplan_ends()),
            StepKind::End(plan::Level::Operation) => return vec![Order::Say(WatchOrder::OperationEnds)],
            StepKind::End(plan::Level::Toolpath) => {
                let over = self.ahead.path_ends().into_iter();
                return over.filter_map(|(_, id)| self.stop_of(&id)).collect();
            }
            StepKind::NcFunction(raw) => {
                let along = raw.kind == ALONG;
                return functions_of(raw)
                    .into_iter()
                    .flatten()
                    .flat_map(|function| self.orders_of(&function, along))
                    .collect();
            }
            _ => {}
        }
        vec![]
    }

    fn orders_of(&mut self, function: &Function, along: bool) -> Vec<Order> {
        match self.ahead.follow(&function.call, along) {
            Ok(()) => self.order(function),
            // It is told when its turn comes.
            Err(_) => vec![],
        }
    }

    fn order(&mut self, function: &Function) -> Vec<Order> {
        match &function.call {
            Call::StartSynchronizedAction(action) => {
                let line = function.to_string();
                match self.numbers.get(&line).copied() {
                    Some(number) => {
                        self.watches.insert(action.id.clone(), number);
                        vec![Order::Say(WatchOrder::Start(number))]
                    }
                    None => compile(action).map_or(vec![], |compiled| vec![Order::Load(line, compiled)]),
                }
            }
            Call::StopSynchronizedAction { id } => self.stop_of(id).into_iter().collect(),
            call => crate::compile::alarm_order(call)
                .map(|order| Order::Say(WatchOrder::Alarm(order)))
                .into_iter()
                .collect(),
        }
    }

    /// Stops the watch that an id means.
    fn stop_of(&mut self, id: &TraceId) -> Option<Order> {
        self.watches.remove(id).map(|number| Order::Say(WatchOrder::Stop(number)))
    }

    /// A condition was loaded under a number; gives what the machine has to be told now.
    pub fn loaded(&mut self, line: &str, number: u16) -> Vec<Order> {
        self.numbers.insert(line.to_owned(), number);
        parse(line).map_or(vec![], |function| self.order(&function))
    }

    /// A condition could not be loaded: it is told, and does nothing.
    pub fn not_loaded(&mut self, line: &str, why: &str, tick: Tick) {
        self.error("T-09", tick, self.sample.step, json!({ "line": line, "why": why }));
    }

    /// A step whose turn has come.
    pub fn step(&mut self, step: &Step, tick: Tick) {
        match &step.kind {
            StepKind::Begin(marker) if marker.level == plan::Level::Operation => self.readings.operation(tick, true),
            StepKind::Begin(marker) if marker.level == plan::Level::Workplan => self.ids.workplan_begins(),
            StepKind::End(plan::Level::Operation) => self.readings.operation(tick, false),
            StepKind::End(plan::Level::Workplan) => drop(self.ids.workplan_ends()),
            StepKind::End(plan::Level::Toolpath) => {
                for (_, id) in self.ids.path_ends() {
                    self.end_action(&id, tick, "end of the path");
                }
            }
            _ => {}
        }
        let ended = self.context.follow(step, tick);
        if let Some(scope) = ended {
            let over = self.recordings.end_scope(scope, tick);
            self.tell_ended(over, step.id);
            if let Some(outer) = self.context.level_returns(scope) {
                self.level = outer;
            }
        }
        if let StepKind::NcFunction(raw) = &step.kind {
            self.functions(raw, step.id, tick);
        }
    }

    /// A cycle. Call it for every report, before the steps of its cycle are told.
    pub fn cycle(&mut self, sample: &Sample, situation: Situation) {
        self.readings.take(sample, &self.parameters, situation);
        self.before = Some(self.sample);
        self.sample = *sample;
        self.context.cycle(sample, &self.parameters);
        if !self.opened {
            self.opened = true;
            self.open(sample.tick);
        }
        if self.before.is_some_and(|b| b.tool != sample.tool) && !self.tool_logging.is_empty() {
            self.tool_changed(sample);
        }
    }

    /// The record of every job begins with the machine that it is of, asked for or not.
    fn open(&mut self, tick: Tick) {
        if self.known.machine.is_empty() {
            return;
        }
        let mut data = self.known.machine.clone();
        data.insert("function".to_owned(), Value::from("log_nc_machine_data"));
        data.insert(BY_ITSELF.to_owned(), Value::from("job start"));
        self.tell(tick, StepId::NONE, data);
    }

    /// Takes the samples of a cycle, behind the steps and firings of it.
    pub fn take_samples(&mut self) {
        if self.waits {
            return;
        }
        let previous = self.before.filter(|b| b.tick + 1 == self.sample.tick);
        let over = self.recordings.cycle(Seen {
            sample: &self.sample,
            previous: previous.as_ref(),
            readings: &self.readings,
            context: &self.context,
        });
        self.tell_ended(over, self.sample.step);
    }

    /// A watch has fired in this cycle.
    pub fn fired(&mut self, firing: &Firing) {
        let tick = firing.tick;
        let of_the_program = self.actions.get(&firing.watch).is_some_and(|a| !a.does.all_modes);
        if self.waits && of_the_program {
            self.take_up(tick);
        }
        let Some(mut action) = self.actions.get(&firing.watch).cloned() else {
            return;
        };
        if firing.kind == FiringKind::Ended {
            // Its id stays taken until the program's own stop, which may have been read already.
            action.runs = false;
            self.tell_action_end(&action, tick, "by hand, from the list of what lives in the machine");
            self.actions.insert(firing.watch, action);
            return;
        }
        if firing.kind == FiringKind::Unknown {
            let data = json!({ "id": action.does.id.0, "why": "a sensor of the condition is unavailable" });
            self.error("T-05", tick, self.sample.step, data);
            return;
        }
        action.fired += 1;
        if action.in_window == 0 || tick - action.window >= 1000 {
            (action.window, action.in_window) = (tick, 0);
        }
        action.in_window += 1;
        // A condition that chatters about its limit has an edge in every other cycle: EVERY is held back like the others.
        let often = action.does.frequency != Frequency::When;
        let mut quiet = often && action.in_window > EVENTS_A_SECOND;
        let mut results = Vec::new();
        let mut slot = 0;
        for function in action.does.actions.clone() {
            // Values go into the sample stream at full rate, whatever the log takes.
            if let Ok(sensors) = wanted(&function) {
                for sensor in sensors {
                    if action.streams.len() <= slot {
                        let id = format!("action {}", action.does.id);
                        action.streams.push(self.recordings.declare(action.run, &id, &sensor));
                    }
                    let value = self.value_of(&sensor);
                    self.recordings.row(action.streams[slot], &self.sample, value);
                    slot += 1;
                }
            }
            let told = !quiet || alarm_of(&function).is_some();
            // A variable is written each time, whatever the log takes: the program goes on with it.
            if told || function.variable.is_some() {
                let mut result = self.perform(&function, tick);
                if !told {
                    continue;
                }
                match result.get("state").and_then(Value::as_str) {
                    // Told once in a second at most.
                    Some("repeated") if result.get("repeated").is_none_or(Value::is_null) => continue,
                    // What became of an alarm is told, however much is held back.
                    Some("set" | "cleared") => quiet = false,
                    _ => {}
                }
                result.insert("function".to_owned(), Value::from(function.name.clone()));
                results.push(Value::Object(result));
            }
        }
        if quiet {
            action.suppressed += 1;
        } else {
            let mut data = object(json!({
                "function": "start_synchronized_action",
                "id": action.does.id.0,
                "state": "fired",
                "frequency": action.does.frequency.word(),
                "condition": action.does.condition.as_ref().map(crate::condition::print),
                "cycle_of_condition": tick.0,
                "fired": action.fired,
                "actions": results,
            }));
            if action.suppressed > 0 {
                data.insert("not_told".to_owned(), Value::from(action.suppressed));
                action.suppressed = 0;
            }
            self.tell(tick, self.sample.step, data);
        }
        self.actions.insert(firing.watch, action);
    }

    /// The machine's state after a cycle: effects of reactions, and what ends with a program. `over`: the program is, all of it is done.
    pub fn state(&mut self, state: State, tick: Tick, over: bool) {
        let before = std::mem::replace(&mut self.state, state);
        if before == state {
            return;
        }
        let slows = matches!(state, State::Holding | State::Held | State::WaitingThenHold(_))
            || matches!(state, State::Stopping(StopCause::Asked) | State::Stopped(StopCause::Asked));
        if slows {
            for (alarm, condition, reaction) in std::mem::take(&mut self.effects) {
                let data = json!({
                    "function": "set_alarm", "state": "effect", "alarm": alarm, "reaction": reaction.word(),
                    "cycle_of_condition": condition.0, "cycle_of_effect": tick.0,
                });
                self.tell(tick, self.sample.step, object(data));
            }
        }
        if state == State::Running && matches!(before, State::Held | State::Holding | State::Paused) {
            self.end_alarms(tick, "cycle start", |by| by == ResetBy::Acknowledge);
        }
        if state == State::Ready && !matches!(before, State::Off | State::Ready) {
            if over {
                self.program_ends(tick, "program end");
            } else {
                self.interrupt(tick, "reset");
                self.end_alarms(tick, "reset", |by| by != ResetBy::Function);
            }
        }
        let follows = matches!(
            state,
            State::Running | State::Resuming | State::Waiting(_) | State::Holding | State::WaitingThenHold(_)
        );
        if self.waits && follows {
            self.take_up(tick);
        }
    }

    /// The controller was started again, and knows nothing of what it did: its alarms are over, and the program waits to be taken up again.
    pub fn started_again(&mut self, tick: Tick) {
        let why = "the controller was started again";
        self.interrupt(tick, why);
        self.end_alarms(tick, why, |_| true);
    }

    /// The machine is there when the run is over, and what is in all modes goes on in it. Without this it ends with the run.
    pub fn on_a_machine_that_goes_on(mut self) -> Self {
        self.machine_goes_on = true;
        self
    }

    /// The run is over, however: what is still open is told as ended, or as going on without it.
    pub fn finish(&mut self, tick: Tick) {
        self.program_ends(tick, "end of the run");
        for (_, action) in std::mem::take(&mut self.actions) {
            if action.runs && self.machine_goes_on {
                let data = json!({
                    "function": "start_synchronized_action", "id": action.does.id.0, "state": "goes on", "run": action.run,
                    "why": "it is in all modes, and the machine goes on", "fired": action.fired,
                });
                self.tell(tick, self.sample.step, object(data));
            } else if action.runs {
                self.tell_action_end(&action, tick, "the machine was simulated for this run and ended with it");
            }
        }
    }

    /// Cycles whose reports were lost: each recording has a gap.
    pub fn lost(&mut self, cycles: u64, tick: Tick) {
        if self.recordings.lost(cycles) {
            self.error("T-10", tick, self.sample.step, json!({ "lost_cycles": cycles }));
        }
    }

    /// Firings that found no place on their way (T-09).
    pub fn lost_firings(&mut self, count: u64, tick: Tick) {
        self.error("T-09", tick, self.sample.step, json!({ "lost_firings": count }));
    }

    /// An event of the control, for `log_nc_events`.
    pub fn control_event(&mut self, kind: &str, data: &BTreeMap<String, Value>, tick: Tick, step: StepId) {
        let mut told = Vec::new();
        for (id, (kinds, count)) in &mut self.event_logging {
            if kinds.is_empty() || kinds.iter().any(|k| k.eq_ignore_ascii_case(kind)) {
                *count += 1;
                told.push(json!({ "function": "log_nc_events", "id": id.0, "kind": kind, "data": data }));
            }
        }
        for data in told {
            self.tell(tick, step, object(data));
        }
    }

    /// The present value of a name in a condition of the program: a variable that a function wrote, a sensor, a predefined value.
    pub fn lookup(&self, name: &str) -> Option<PlanValue> {
        if let Some(value) = self.variables.get(&variable_called(name)) {
            return value.map(PlanValue::Number);
        }
        match meaning(name) {
            Meaning::Predefined(crate::sensor::Predefined::Alarm(id)) => Some(PlanValue::Truth(self.alarms.contains_key(&id))),
            Meaning::Predefined(value) => self.readings.value(signal_of_predefined(value)?).map(PlanValue::Number),
            Meaning::Sensor(sensor) => self.value_of(&sensor).map(PlanValue::Number),
            Meaning::Several(_) | Meaning::Unknown => None,
        }
    }

    /// Records since the last call, in order.
    pub fn take_told(&mut self) -> Vec<Told> {
        std::mem::take(&mut self.told)
    }

    /// Rows of recordings since the last call, in order.
    pub fn take_rows(&mut self) -> Vec<Row> {
        self.recordings.take_rows()
    }

    /// The stream of a row.
    pub fn stream(&self, number: u32) -> Option<&Stream> {
        self.recordings.stream(number)
    }

    fn value_of(&self, sensor: &Sensor) -> Option<f64> {
        self.readings.value(signal_of(sensor)?)
    }
}

/// What the machine has to be told.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// An order in the queue.
    Say(WatchOrder),
    /// Load this condition first, under the line that starts it, then ask again.
    Load(String, Compiled),
}

/// The name that a variable is kept under. G-code's have numbers, which may be written with zeros before them: `#0100` is `#100`.
fn variable_called(written: &str) -> String {
    let number = written.strip_prefix('#').and_then(|digits| digits.parse::<u32>().ok());
    number.map_or_else(|| written.to_owned(), |number| format!("#{number}"))
}

fn alarm_of(function: &Function) -> Option<AlarmOrder> {
    crate::compile::alarm_order(&function.call)
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members.into_iter().filter(|(_, value)| !value.is_null()).collect(),
        _ => Map::new(),
    }
}

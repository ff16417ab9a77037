//! What the functions of the program do when their turn comes.

use super::*;
use crate::ids::Clash;
use crate::lines::lines_of;
use plan::written::written;

/// What every element has that nobody has given a level: any operator may edit it.
const DEFAULT_LEVEL: u8 = 10;

/// Functions of the program.
impl Recorder {
    pub(super) fn functions(&mut self, raw: &RawNcFunction, step: StepId, tick: Tick) {
        self.know_variables(raw);
        for read in functions_of(raw) {
            match read {
                Ok(function) => {
                    let before = self.told.len();
                    self.function(&function, raw.kind == ALONG, step, tick);
                    if let Some(log) = &function.log {
                        for told in &mut self.told[before..] {
                            told.data.insert("log".to_owned(), Value::from(log.clone()));
                        }
                    }
                }
                // A branch that the look through the program did not take: nobody was told before.
                Err(found) => self.error(found.code, tick, step, json!({ "line": raw.text, "why": found.message })),
            }
        }
    }

    /// What the program itself has put into variables that a function names. What the function writes has no value until it does: the old
    /// one would answer for a measurement that failed. An action writes later, and until then its variable holds what the program put there.
    fn know_variables(&mut self, raw: &RawNcFunction) {
        let known = raw.properties.iter().filter_map(|(property, value)| {
            let name = property.strip_prefix(RawNcFunction::VARIABLE)?;
            Some((variable_called(name), Some(value.parse().ok()?)))
        });
        self.variables.extend(known);
        for line in lines_of(raw) {
            let once = written(line).into_iter().filter(|variable| !variable.again);
            let names = once.map(|variable| variable.name).filter(|name| !is_of_the_machine(name));
            self.variables.extend(names.map(|name| (variable_called(&name), None)));
        }
    }

    pub(super) fn function(&mut self, function: &Function, along: bool, step: StepId, tick: Tick) {
        let name = function.name.clone();
        if let Err(clash) = self.ids.follow(&function.call, along) {
            let (Clash::Started(id, ..) | Clash::Stopped(id, ..)) = &clash;
            let data = json!({ "function": name, "id": id.0, "why": clash.text("is not active") });
            return self.error(clash.code(), tick, step, data);
        }
        match &function.call {
            Call::Unknown => {
                self.tell(
                    tick,
                    step,
                    object(json!({ "function": name, "state": "unknown", "text": function.unread })),
                );
            }
            Call::LogNcEvents { id, on: true, kinds } => {
                self.event_logging.insert(id.clone(), (kinds.clone(), 0));
                self.switched(&name, id, None, (step, tick));
            }
            Call::LogNcEvents { id, on: false, .. } => {
                let count = self.event_logging.remove(id).map_or(0, |(_, count)| count);
                self.switched(&name, id, Some(count), (step, tick));
            }
            Call::StartToolLogging { id } => {
                self.tool_logging.insert(id.clone(), 0);
                self.switched(&name, id, None, (step, tick));
            }
            Call::StopToolLogging { id } => {
                let count = self.tool_logging.remove(id).unwrap_or(0);
                self.switched(&name, id, Some(count), (step, tick));
            }
            Call::LogOperatorData { id, on: true } => {
                self.operator_logging.insert(id.clone(), 1);
                self.switched(&name, id, None, (step, tick));
                let mut data = self.operator();
                data.insert("function".to_owned(), Value::from(name));
                data.insert("id".to_owned(), Value::from(id.0.clone()));
                self.tell(tick, step, data);
            }
            Call::LogOperatorData { id, on: false } => {
                let count = self.operator_logging.remove(id).unwrap_or(0);
                self.switched(&name, id, Some(count), (step, tick));
            }
            Call::SetEditAccessLevel { level, workplan_only } => {
                let data = json!({
                    "function": name, "old": self.level.unwrap_or(DEFAULT_LEVEL), "new": level.unwrap_or(DEFAULT_LEVEL),
                    "scope": if *workplan_only { "workplan" } else { "rest_of_program" },
                    "default": DEFAULT_LEVEL, "from_step": step.0,
                });
                let outer = std::mem::replace(&mut self.level, *level);
                self.context.level_is_of_workplan(*workplan_only, outer);
                self.tell(tick, step, object(data));
            }
            Call::StartSensorRecording(recording) => {
                let wanted = wanted(function);
                self.start_recording(&name, recording::Wanted::of(recording, along), wanted, (step, tick));
            }
            Call::GetPoints(measurement) => {
                let id = TraceId(format!("{name} {}", self.next_run));
                let wanted = wanted(function);
                self.start_recording(
                    &name,
                    recording::Wanted::of_points(measurement, id, along),
                    wanted,
                    (step, tick),
                );
            }
            Call::StopSensorRecording { id } => match self.recordings.stop(id, tick) {
                Some(ended) => self.tell_ended(vec![ended], step),
                None => self.error("T-01", tick, step, json!({ "function": name, "id": id.0 })),
            },
            Call::StartSynchronizedAction(action) => self.start_action(function, action, (step, tick)),
            Call::StopSynchronizedAction { id } => {
                if !self.end_action(id, tick, "stop") {
                    // It could not be loaded (T-09), so it never ran; or it was ended by hand.
                    self.error("T-01", tick, step, json!({ "function": name, "id": id.0 }));
                }
            }
            _ => {
                let mut data = self.perform(function, tick);
                data.insert("function".to_owned(), Value::from(name));
                self.tell(tick, step, data);
            }
        }
    }

    /// Logging is on, or off after so many records.
    fn switched(&mut self, name: &str, id: &TraceId, records: Option<u64>, (step, tick): (StepId, Tick)) {
        let state = if records.is_none() { "on" } else { "off" };
        let data = json!({ "function": name, "id": id.0, "state": state, "records": records });
        self.tell(tick, step, object(data));
    }

    /// Ends the action that has this id; false when none runs.
    pub(super) fn end_action(&mut self, id: &TraceId, tick: Tick, why: &str) -> bool {
        let Some(action) = self.actions.values_mut().find(|a| a.runs && a.does.id == *id) else {
            return false;
        };
        action.runs = false;
        let action = action.clone();
        self.tell_action_end(&action, tick, why);
        true
    }

    pub(super) fn start_recording(
        &mut self,
        name: &str,
        wanted: recording::Wanted,
        sensors: Result<Vec<Sensor>, (String, String)>,
        (step, tick): (StepId, Tick),
    ) {
        let id = wanted.id.clone();
        let sensors = match sensors {
            Ok(sensors) => sensors,
            Err((message, _)) => return self.error("T-05", tick, step, json!({ "function": name, "id": id.0, "why": message })),
        };
        let points = match wanted.points() {
            None => vec![],
            Some(curve) => match self.known.points.get(curve) {
                Some(points) => points.clone(),
                None => {
                    let why = format!("the file has no points at #{curve}");
                    return self.error("T-06", tick, step, json!({ "function": name, "id": id.0, "why": why }));
                }
            },
        };
        let run = self.next_run;
        let depth = self.context.depth();
        match self.recordings.start(wanted, sensors, points, run, depth, tick) {
            None => self.error("T-02", tick, step, json!({ "function": name, "id": id.0 })),
            Some(begun) => {
                self.next_run += 1;
                let mut data = object(begun);
                data.insert("function".to_owned(), Value::from(name));
                self.tell(tick, step, data);
            }
        }
    }

    pub(super) fn start_action(&mut self, function: &Function, action: &SynchronizedAction, (step, tick): (StepId, Tick)) {
        let Some(number) = self.numbers.get(&function.to_string()).copied() else {
            return self.error("T-09", tick, step, json!({ "function": function.name, "id": action.id.0 }));
        };
        let run = self.next_run;
        self.next_run += 1;
        self.actions.insert(
            number,
            Action {
                does: action.clone(),
                runs: true,
                run,
                fired: 0,
                window: tick,
                in_window: 0,
                suppressed: 0,
                streams: vec![],
            },
        );
        let data = json!({
            "function": function.name, "id": action.id.0, "state": "started", "run": run,
            "scope": if action.all_modes { "ALL" } else { "AUTOMATIC" },
            "frequency": action.frequency.word(),
            "condition": action.condition.as_ref().map(crate::condition::print),
        });
        self.tell(tick, step, object(data));
    }

    pub(super) fn tell_action_end(&mut self, action: &Action, tick: Tick, why: &str) {
        let data = json!({
            "function": "stop_synchronized_action", "id": action.does.id.0, "state": "ended", "run": action.run,
            "why": why, "fired": action.fired, "not_told": (action.suppressed > 0).then_some(action.suppressed),
        });
        self.tell(tick, self.sample.step, object(data));
    }

    /// The machine has left the program: what belongs to it waits. A count goes on where it is when the program does.
    pub(super) fn interrupt(&mut self, tick: Tick, why: &'static str) {
        if !std::mem::replace(&mut self.waits, true) {
            self.tell_waiting("stop", "interrupted", tick, Some(why));
        }
    }

    /// The machine goes on with the program: what waited goes on with it.
    pub(super) fn take_up(&mut self, tick: Tick) {
        if std::mem::take(&mut self.waits) {
            self.tell_waiting("start", "taken up again", tick, None);
        }
    }

    fn tell_waiting(&mut self, verb: &str, state: &str, tick: Tick, why: Option<&str>) {
        let mut told = Vec::new();
        for action in self.actions.values().filter(|a| a.runs && !a.does.all_modes) {
            told.push(json!({
                "function": format!("{verb}_synchronized_action"), "id": action.does.id.0, "state": state, "run": action.run,
                "why": why, "fired": action.fired,
            }));
        }
        for (id, run, samples) in self.recordings.open() {
            told.push(json!({
                "function": format!("{verb}_sensor_recording"), "id": id.0, "state": state, "run": run,
                "why": why, "samples": samples,
            }));
        }
        for data in told {
            self.tell(tick, self.sample.step, object(data));
        }
    }

    pub(super) fn program_ends(&mut self, tick: Tick, why: &'static str) {
        self.waits = false;
        let over = self.recordings.end_all(why);
        self.tell_ended(over, self.sample.step);
        let mut ended = Vec::new();
        for action in self.actions.values_mut().filter(|a| a.runs && !a.does.all_modes) {
            action.runs = false;
            ended.push(action.clone());
        }
        for action in ended {
            self.tell_action_end(&action, tick, why);
        }
    }

    pub(super) fn tell_ended(&mut self, over: Vec<Ended>, step: StepId) {
        for ended in over {
            self.tell(ended.tick, step, object(ended.data));
        }
    }

    pub(super) fn tool_changed(&mut self, sample: &Sample) {
        let ids: Vec<TraceId> = self.tool_logging.keys().cloned().collect();
        for id in ids {
            if let Some(count) = self.tool_logging.get_mut(&id) {
                *count += 1;
            }
            let mut data = self.tool(sample.tool.0);
            data.insert("function".to_owned(), Value::from("start_tool_logging"));
            data.insert("id".to_owned(), Value::from(id.0));
            self.tell(sample.tick, sample.step, data);
        }
    }

    pub(super) fn end_alarms(&mut self, tick: Tick, why: &str, ends: impl Fn(ResetBy) -> bool) {
        let over: Vec<u16> = self
            .alarms
            .iter()
            .filter(|(_, a)| ends(a.alarm.reset_by))
            .map(|(id, _)| *id)
            .collect();
        for id in over {
            let mut data = self.clear(id, tick);
            data.insert("function".to_owned(), Value::from("set_alarm"));
            data.insert("why".to_owned(), Value::from(why));
            self.tell(tick, self.sample.step, data);
        }
    }

    pub(super) fn error(&mut self, code: &str, tick: Tick, step: StepId, data: Value) {
        let mut data = object(data);
        data.insert("error".to_owned(), Value::from(code));
        data.entry("function".to_owned()).or_insert(Value::from(""));
        self.tell(tick, step, data);
    }

    pub(super) fn tell(&mut self, tick: Tick, step: StepId, mut data: Map<String, Value>) {
        self.context.add_to(&mut data, self.sample.tool.0);
        self.told.push(Told { tick, step, data });
    }
}

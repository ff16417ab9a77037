//! What is done at once, by the program or as an action: times, values, alarms, data of tool, machine, coolant and operator.

use super::context::Coordinates;
use super::*;
use crate::functions::CoordinateFrame;

/// What is done at once, by the program or as an action.
impl Recorder {
    pub(super) fn perform(&mut self, function: &Function, tick: Tick) -> Map<String, Value> {
        match &function.call {
            Call::GetTime { label } => {
                let now = self.start.at(tick);
                // In whole milliseconds first: nanoseconds since 1970 are more than a double counts in ones.
                let milliseconds = now.0.div_euclid(1_000_000) as f64 + now.0.rem_euclid(1_000_000) as f64 / 1e6;
                self.write(function, Some(milliseconds));
                let began = self.context.program_began().unwrap_or(Tick(0));
                object(json!({
                    "label": label, "unix_ms": milliseconds, "unit": "MILLISECOND", "quality": self.quality(false),
                    "since_program_began_ms": (tick - began) as f64 * TICK.0 * 1e3,
                }))
            }
            Call::GetExecutionTime { executable } => match self.context.execution(executable.as_deref()).cloned() {
                Some(done) => {
                    let duration = (done.end - done.begin) as f64 * TICK.0;
                    self.write(function, Some(duration));
                    object(json!({
                        "executable": done.name, "begin_ns": self.start.at(done.begin).0, "end_ns": self.start.at(done.end).0,
                        "duration_s": duration, "in_cut_s": done.in_cut as f64 * TICK.0, "unit": "SECOND",
                        "quality": self.quality(false), "in_cut_quality": "estimated",
                    }))
                }
                None => {
                    self.write(function, None);
                    object(
                        json!({ "executable": executable, "quality": "unavailable", "why": "nothing of that name is completed" }),
                    )
                }
            },
            Call::LogToolData { tool } => {
                let number = tool
                    .as_ref()
                    .map_or(Some(self.sample.tool.0), |t| t.trim_start_matches(['T', 't']).parse().ok());
                match number {
                    Some(number) => self.tool(number),
                    None => object(json!({ "tool": tool, "quality": "unavailable", "why": "it is no number of a tool" })),
                }
            }
            Call::LogNcMachineData { items } => {
                let mut data = Map::new();
                if items.is_empty() {
                    data.clone_from(&self.known.machine);
                }
                for item in items {
                    let value = self.known.machine.get(item).cloned();
                    data.insert(item.clone(), value.unwrap_or(Value::from("unavailable")));
                }
                data
            }
            Call::LogCoolantType => {
                let mut data = self.coolant(&Coolant::default());
                data.retain(|key, _| ["product", "kind", "quality"].contains(&key.as_str()));
                data
            }
            Call::LogCoolantData(declared) => self.coolant(declared),
            Call::SetAlarm(alarm) => self.set(alarm, tick),
            Call::ClearAlarm { id } => self.clear(*id, tick),
            Call::LogEvent { kind, text, values } => {
                let values: Map<String, Value> = values
                    .iter()
                    .map(|name| {
                        let value = match self.lookup(name) {
                            Some(PlanValue::Number(number)) => json!(number),
                            Some(PlanValue::Truth(truth)) => json!(truth),
                            None => json!("unavailable"),
                        };
                        (name.clone(), value)
                    })
                    .collect();
                let values = (!values.is_empty()).then_some(values);
                object(json!({ "kind": kind, "text": text, "values": values }))
            }
            Call::DisplayMessage { text } => object(json!({ "text": text })),
            Call::GetOperatorData => self.operator(),
            Call::ReadSensorValue { .. } | Call::Get(_) => self.values(function),
            _ => Map::new(),
        }
    }

    pub(super) fn values(&mut self, function: &Function) -> Map<String, Value> {
        let sensors = match wanted(function) {
            Ok(sensors) => sensors,
            Err((why, _)) => {
                self.write(function, None);
                return object(json!({ "error": "T-05", "why": why, "quality": "unavailable" }));
            }
        };
        let mut all = Vec::new();
        let frame = match &function.call {
            Call::Get(measurement) => measurement.frame,
            _ => CoordinateFrame::Machine,
        };
        for sensor in &sensors {
            let value = self.value_in(frame, sensor);
            let unit = Some(unit_of(sensor)).filter(|unit| !unit.is_empty());
            let derived = frame != CoordinateFrame::Machine || signal_of(sensor).is_some_and(|s| SIGNALS[usize::from(s)].derived);
            let quality = if value.is_some() {
                self.quality(derived)
            } else {
                "unavailable"
            };
            let mut one = object(json!({ "stream": frame.named(sensor), "value": value, "unit": unit, "quality": quality }));
            if derived {
                one.insert("derived".to_owned(), Value::from(true));
            }
            if let Call::Get(measurement) = &function.call
                && let (Some(limit), Some(value)) = (measurement.tolerance, value)
            {
                one.insert("within_tolerance".to_owned(), Value::from(value.abs() <= limit.0));
            }
            all.push(Value::Object(one));
        }
        let mut data = Map::new();
        match sensors.as_slice() {
            [only] => {
                let value = self.value_in(frame, only);
                self.write(function, value);
            }
            _ if function.variable.is_some() => {
                self.write(function, None);
                data.insert("error".to_owned(), Value::from("T-06"));
                data.insert(
                    "why".to_owned(),
                    Value::from("several values do not fit one variable: name one axis"),
                );
            }
            _ => {}
        }
        data.insert("values".to_owned(), Value::Array(all));
        if let Call::Get(measurement) = &function.call {
            for (key, value) in &measurement.details {
                data.insert((*key).to_owned(), Value::from(value.clone()));
            }
            if measurement.with_direction {
                data.insert("direction".to_owned(), json!(self.direction()));
            }
        }
        data
    }

    /// The unit tangent of the commanded path; `None` at rest.
    pub(super) fn direction(&self) -> Option<[f64; 3]> {
        super::recording::direction(self.before.as_ref()?, &self.sample)
    }

    /// The present value of a sensor, coordinates in a frame.
    fn value_in(&self, frame: CoordinateFrame, sensor: &Sensor) -> Option<f64> {
        match (frame, Coordinates::of(sensor), sensor.linear_axis()) {
            (CoordinateFrame::Machine, ..) | (_, None, _) | (.., None) => self.value_of(sensor),
            (frame, Some(quantity), Some(axis)) => Some(self.context.coordinates(&self.sample, quantity, frame)?[axis]),
        }
    }

    /// Puts a value into the variable of a function. Without one the variable has none: what it held before is not what was asked for.
    pub(super) fn write(&mut self, function: &Function, value: Option<f64>) {
        if let Some(variable) = &function.variable
            && !is_of_the_machine(variable)
        {
            self.variables.insert(variable_called(variable), value);
        }
    }

    pub(super) fn set(&mut self, alarm: &Alarm, tick: Tick) -> Map<String, Value> {
        if let Some(active) = self.alarms.get_mut(&alarm.id) {
            active.repeated += 1;
            let told = tick - active.told >= 1000;
            if told {
                active.told = tick;
            }
            return object(json!({
                "alarm": alarm.id, "state": "repeated", "repeated": told.then_some(active.repeated), "since_cycle": active.since.0,
            }));
        }
        self.alarms.insert(
            alarm.id,
            Active {
                alarm: alarm.clone(),
                since: tick,
                repeated: 0,
                told: tick,
            },
        );
        let mut data = object(json!({
            "alarm": alarm.id, "text": alarm.text, "reaction": alarm.reaction.word(), "reset_by": alarm.reset_by.word(),
            "state": "set", "cycle_of_condition": tick.0,
        }));
        if alarm.reaction == Reaction::None {
            data.insert("cycle_of_effect".to_owned(), Value::from(tick.0));
        } else {
            self.effects.push((alarm.id, tick, alarm.reaction));
        }
        data
    }

    pub(super) fn clear(&mut self, id: u16, tick: Tick) -> Map<String, Value> {
        match self.alarms.remove(&id) {
            Some(active) => object(json!({
                "alarm": id, "text": active.alarm.text, "state": "cleared", "active_s": (tick - active.since) as f64 * TICK.0,
                "repeated": (active.repeated > 0).then_some(active.repeated),
            })),
            None => object(json!({ "alarm": id, "error": "T-03", "why": "the alarm is not active" })),
        }
    }

    pub(super) fn tool(&self, number: u32) -> Map<String, Value> {
        let mut data = self.known.tools.get(&number).cloned().unwrap_or_default();
        if data.is_empty() {
            data.insert("quality".to_owned(), Value::from("unavailable"));
            data.insert("why".to_owned(), Value::from("the tool table has no such tool"));
        } else if let Some((_, planned)) = self.context.planned_diameter().filter(|(n, _)| *n == number)
            && let Some(real) = data.get("diameter_mm").and_then(Value::as_f64)
            && (real - planned).abs() > 1e-6
        {
            data.insert("planned_diameter_mm".to_owned(), Value::from(planned));
            data.insert("differs_from_plan".to_owned(), Value::from(true));
        }
        data.entry("quality").or_insert_with(|| Value::from(self.quality(false)));
        data.insert("tool_number".to_owned(), Value::from(number));
        data
    }

    pub(super) fn operator(&self) -> Map<String, Value> {
        let mut data = self.known.operator.clone();
        if data.is_empty() {
            data.insert("quality".to_owned(), Value::from("unavailable"));
            data.insert("why".to_owned(), Value::from("nobody is signed in"));
        }
        data
    }

    pub(super) fn coolant(&self, declared: &Coolant) -> Map<String, Value> {
        let mut data = self.known.coolant.clone();
        let said = object(json!({
            "product": declared.product, "kind": declared.kind, "concentration_percent": declared.concentration,
            "ph": declared.ph, "batch": declared.batch, "filled": declared.filled,
        }));
        data.extend(said);
        let quality = if data.is_empty() { "unavailable" } else { "declared" };
        data.insert("quality".to_owned(), Value::from(quality));
        data
    }

    /// What a value of this machine is worth.
    pub(super) fn quality(&self, derived: bool) -> &'static str {
        match (self.sample.quality, derived) {
            (Quality::Simulated, _) => "simulated",
            (Quality::Stale, _) => "stale",
            (Quality::Unavailable, _) => "unavailable",
            (Quality::Good, true) => "derived",
            (Quality::Good, false) => "ok",
        }
    }
}

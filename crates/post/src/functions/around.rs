//! Functions and the structure around them: timers of workingsteps, conditions along a path, recordings that end with their workplan.

use super::*;

impl Posting<'_, '_> {
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
                for line in std::mem::take(&mut self.tracing.along_path) {
                    self.traced(&read(&line)?)?;
                }
                Ok(())
            }
            Level::Workingstep => {
                // G-code has no paths whose ends are looked at.
                if self.moves > 0 {
                    self.check_between_blocks()?;
                }
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
    pub(super) fn workplans(&self) -> usize {
        self.levels.iter().filter(|level| **level == Level::Workplan).count()
    }

    /// A recording ends with the workplan that its start stands in.
    pub(super) fn workplan_ends(&mut self) -> Result<(), Refusal> {
        let open = self.workplans();
        self.tracing.ways.workplan_ends(open);
        let ends = |found: &(Function, usize)| found.1 > open && matches!(found.0.call, Call::StartSensorRecording(_));
        let native = self.tracing.native.iter().filter(|(_, found)| ends(found));
        let ids: Vec<String> = native.map(|(id, _)| id.clone()).collect();
        for id in ids {
            self.stop_by_itself(&id, "WORKPLAN")?;
        }
        if self
            .tracing
            .checks
            .values()
            .any(|check| matches!(check, Check::Poll { workplans, .. } if *workplans > open))
        {
            self.check_between_blocks()?;
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
        self.check_between_blocks()?;
        self.tracing.checks.clear();
        Ok(())
    }

    pub(super) fn stop_by_itself(&mut self, id: &str, end: &str) -> Result<(), Refusal> {
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
            self.write(&Statement::Comment(&format!(
                "END OF THE {end}: {} {}",
                function.name,
                id.split_once(' ').map_or(id, |(_, id)| id)
            )))?;
            self.control.function(&stop, &mut self.sheet)?;
        }
        Ok(())
    }

    /// Conditions that run along the present path.
    pub(super) fn along_path(&mut self, raw: &RawNcFunction) -> Result<(), Refusal> {
        for line in plan::line::along(&raw.properties) {
            let function = read(line)?;
            let quoted = |id: &str| format!("\"{}\"", id.replace('"', "\"\""));
            // What stands along a path ends with it.
            self.tracing.along_path.extend(match &function.call {
                Call::StartSensorRecording(recording) => Some(format!(
                    "trace:1 stop_sensor_recording its_function_id={}",
                    quoted(&recording.id.0)
                )),
                Call::StartSynchronizedAction(action) => {
                    Some(format!("trace:1 stop_synchronized_action its_id={}", quoted(&action.id.0)))
                }
                _ => None,
            });
            self.traced(&function)?;
        }
        for (name, mode) in &raw.properties {
            let line = format!("{name} {mode}");
            if trace::is_line(name) || trace::is_line(mode) {
                continue;
            }
            if name == "trace.record" {
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
                        let stop = format!("trace:1 stop_sensor_recording its_function_id={id}");
                        self.tracing.along_path.push(stop);
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

/// What a line of a path says.
fn read(line: &str) -> Result<Function, Refusal> {
    trace::parse(line).map_err(|found| Refusal::new("trace-line", found.to_string(), "correct the line"))
}

//! Conditions and recordings that are looked at between blocks: one variable for what happened before, and the table of frequencies in
//! statements that every control has.

use super::*;

impl Posting<'_, '_> {
    pub(super) fn poll(&mut self, recording: &Recording, recorder: &str) -> Result<Verdict, Refusal> {
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
        self.tracing.counted += 1;
        let check = Check::Poll {
            values,
            workplans: self.workplans(),
            number: self.tracing.counted,
        };
        let span = format!("recording {}", key(&recording.id.0));
        self.tracing.checks.insert(span.clone(), check);
        self.found.logs = true;
        self.check_now(&span)?;
        Ok(Verdict::between_blocks(
            verified,
            format!(
                "one sample about every {} moves and at the ends of paths instead of the sampling asked for",
                self.options.check_every
            ),
        ))
    }

    pub(super) fn check(&mut self, action: &SynchronizedAction) -> Result<Verdict, Refusal> {
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
        let id = format!("action {}", key(&action.id.0));
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
    pub(super) fn readable(&mut self, condition: &Expression) -> Result<(), Refusal> {
        let mut names = Vec::new();
        collect_names(Some(condition), &mut names);
        for name in names {
            crate::condition::source_of(&name, self.control, &mut self.sheet)?;
        }
        Ok(())
    }

    pub(super) fn not_between_blocks(&self, function: &Function) -> Option<String> {
        let streams = match &function.call {
            Call::ReadSensorValue { sensor, axes } => streams(sensor, axes),
            Call::Get(measurement) if measurement.frame != CoordinateFrame::Machine => {
                return Some(of_a_frame(measurement.frame));
            }
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
        self.moves = 0;
        let mut checks: Vec<(u32, String)> = self
            .tracing
            .checks
            .iter()
            .map(|(id, check)| (check.number(), id.clone()))
            .collect();
        checks.sort();
        checks.iter().try_for_each(|(_, id)| self.check_now(id))
    }

    pub(super) fn check_now(&mut self, id: &str) -> Result<(), Refusal> {
        match self.tracing.checks.get(id).cloned() {
            None => Ok(()),
            Some(Check::Poll { values, .. }) => {
                let mut items = vec![Item::Text(id.to_owned())];
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
    pub(super) fn check_action(&mut self, action: &SynchronizedAction, number: u32) -> Result<(), Refusal> {
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

    pub(super) fn say(&mut self, statement: &Statement<'_>) -> Result<(), Refusal> {
        self.control.write(statement, &mut self.sheet)
    }

    pub(super) fn actions(&mut self, action: &SynchronizedAction) -> Result<(), Refusal> {
        for function in &action.actions {
            self.written(function)?;
        }
        Ok(())
    }

    /// It ends, and is looked at once more before: the last time may be many moves ago.
    pub(super) fn stopped(&mut self, stop: &Call) -> Result<Verdict, Refusal> {
        let span = ways::span(stop).map(|(span, _)| span).unwrap_or_default();
        self.check_now(&span)?;
        Ok(match self.tracing.checks.remove(&span) {
            Some(_) => Verdict::between_blocks(true, "it is looked at no more"),
            None => Verdict::external("as its start"),
        })
    }
}

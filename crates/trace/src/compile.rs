//! Conditions and actions made into what the realtime half evaluates: operations in postfix order, numbers in the units of records.
//!
//! Everything that could go wrong in a cycle goes wrong here: unknown names, units that do not fit, a number where a truth is due. A
//! sensor that this machine has not is no error: its value is never known, and that is said (T-05).

use crate::functions::{Frequency, Reaction, ResetBy, SynchronizedAction};
use crate::sensor::{Meaning, PREDEFINED, Predefined, Sensor, meaning};
use crate::unit::{self, Dimension};
use crate::{Call, Function};
use machine::watch::{self, AlarmOrder, NO_SENSOR, Operation, Relation};
use plan::Expression;
use plan::expression::Operator;

/// A synchronized action as the realtime half takes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Compiled {
    /// When it fires.
    pub frequency: watch::Frequency,
    /// It goes on in every mode.
    pub all_modes: bool,
    /// The condition.
    pub operations: Vec<Operation>,
    /// What it does to alarms.
    pub alarms: Vec<AlarmOrder>,
    /// Sensors that it looks at and this machine has not.
    pub missing: Vec<String>,
}

impl Compiled {
    /// The same, as [`machine::Watches::load`] takes it.
    pub fn watch(&self) -> watch::Watch<'_> {
        watch::Watch {
            frequency: self.frequency,
            all_modes: self.all_modes,
            condition: &self.operations,
            alarms: &self.alarms,
        }
    }
}

/// Why a synchronized action cannot be compiled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// T-06, T-08 or T-09.
    pub code: &'static str,
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub remedy: String,
}

fn refuse<T>(code: &'static str, message: impl Into<String>, remedy: impl Into<String>) -> Result<T, Refused> {
    Err(Refused {
        code,
        message: message.into(),
        remedy: remedy.into(),
    })
}

/// Compiles a synchronized action.
///
/// # Errors
/// T-06: the condition makes no sense. T-08: an action that may not be one. T-09: more than the realtime half takes.
pub fn compile(action: &SynchronizedAction) -> Result<Compiled, Refused> {
    let frequency = match action.frequency {
        Frequency::None => watch::Frequency::NoKeyword,
        Frequency::Whenever => watch::Frequency::Whenever,
        Frequency::From => watch::Frequency::FromFirst,
        Frequency::When => watch::Frequency::WhenOnce,
        Frequency::Every => watch::Frequency::EveryEdge,
    };
    let mut compiler = Compiler::default();
    match (&action.condition, action.frequency) {
        (None, Frequency::None) => {}
        (Some(_), Frequency::None) => {
            return refuse(
                "T-06",
                format!("synchronized action {} has a condition and no frequency", action.id),
                "give its_frequency: WHENEVER, FROM, WHEN or EVERY",
            );
        }
        (None, frequency) => {
            return refuse(
                "T-06",
                format!(
                    "synchronized action {} says {} and has no condition",
                    action.id,
                    frequency.word()
                ),
                "give its_condition, or leave its_frequency out: every cycle",
            );
        }
        (Some(condition), _) => {
            if !matches!(compiler.expression(condition)?, Type::Truth) {
                return refuse(
                    "T-06",
                    "the condition is a number, neither true nor false",
                    "compare it with something",
                );
            }
            watch::condition::check(&compiler.operations).or_else(|bad| {
                let code = match bad {
                    watch::BadCondition::TooLong | watch::BadCondition::TooDeep => "T-09",
                    _ => "T-06",
                };
                refuse(code, bad.text(), "split it into several synchronized actions")
            })?;
        }
    }
    let mut alarms = Vec::new();
    for function in &action.actions {
        may_be_action(function)?;
        alarms.extend(alarm_order(&function.call));
    }
    if alarms.len() > watch::ALARMS_OF_A_WATCH {
        return refuse(
            "T-09",
            format!(
                "synchronized action {} sets or clears {} alarms; {} is the most",
                action.id,
                alarms.len(),
                watch::ALARMS_OF_A_WATCH
            ),
            "split it into several",
        );
    }
    Ok(Compiled {
        frequency,
        all_modes: action.all_modes,
        operations: compiler.operations,
        alarms,
        missing: compiler.missing,
    })
}

/// T-08: only what records, and alarms, may be an action.
fn may_be_action(function: &Function) -> Result<(), Refused> {
    match (&function.call, function.definition) {
        (Call::Unknown, _) => {
            let meant = crate::meant(&function.name).map_or_else(String::new, |name| format!(": did you mean {name}?"));
            refuse(
                "T-08",
                format!("the action {} is unknown{meant}", function.name),
                "actions are read_sensor_value, get_..., log_..., set_alarm, clear_alarm and display_message",
            )
        }
        (_, Some(definition)) if definition.is_action => Ok(()),
        _ => refuse(
            "T-08",
            format!("{} cannot be an action", function.name),
            "actions are read_sensor_value, get_..., log_..., set_alarm, clear_alarm and display_message",
        ),
    }
}

/// What a function does to an alarm of the machine.
pub fn alarm_order(call: &Call) -> Option<AlarmOrder> {
    match call {
        Call::SetAlarm(alarm) => Some(AlarmOrder::Set {
            alarm: alarm.id,
            reaction: match alarm.reaction {
                Reaction::None => watch::Reaction::None,
                Reaction::FeedHold => watch::Reaction::FeedHold,
                Reaction::StopAfterOperation => watch::Reaction::StopAfterOperation,
                Reaction::StopNow => watch::Reaction::StopNow,
            },
            reset_by: match alarm.reset_by {
                ResetBy::Function => watch::ResetBy::Function,
                ResetBy::Acknowledge => watch::ResetBy::Acknowledge,
                ResetBy::Reset => watch::ResetBy::Reset,
            },
        }),
        Call::ClearAlarm { id } => Some(AlarmOrder::Clear { alarm: *id }),
        _ => None,
    }
}

/// The signal of a stream; `None` when this machine has no such sensor.
pub fn signal_of(sensor: &Sensor) -> Option<u8> {
    let name = sensor.stream();
    // The record calls the current by one name, whatever the drive is fed with.
    let name = name.replace(".AMPERAGE_AC", ".AMPERAGE").replace(".AMPERAGE_DC", ".AMPERAGE");
    watch::signal(&name)
}

/// The unit of a stream in records, in MTConnect's words where it has one; empty for a plain number.
pub fn unit_of(sensor: &Sensor) -> &'static str {
    match (sensor.dimension(), signal_of(sensor)) {
        (Some(dimension), _) => dimension.unit(),
        // What the control says of itself is of no type of MTConnect's.
        (None, Some(signal)) => watch::SIGNALS[usize::from(signal)].unit,
        (None, None) => "",
    }
}

/// The signal of a predefined value; alarms are none.
pub fn signal_of_predefined(value: Predefined) -> Option<u8> {
    let name = PREDEFINED.iter().find(|(_, v, ..)| *v == value)?.0;
    watch::signal(&format!("trace:{name}"))
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Type {
    Truth,
    /// `None`: a plain number takes the unit of what it is compared with.
    Number(Option<Dimension>),
}

#[derive(Default)]
struct Compiler {
    operations: Vec<Operation>,
    missing: Vec<String>,
}

impl Compiler {
    fn expression(&mut self, expression: &Expression) -> Result<Type, Refused> {
        match expression {
            Expression::Number(number, None) => {
                self.operations.push(Operation::Constant(*number));
                Ok(Type::Number(None))
            }
            Expression::Number(number, Some(written)) => {
                let Some(unit) = unit::find(written) else {
                    return refuse(
                        "T-06",
                        format!("'{written}' is no unit that is known here"),
                        "write mm, s, %, rpm, ...",
                    );
                };
                self.operations.push(Operation::Constant(number * unit.factor));
                Ok(Type::Number(Some(unit.dimension)))
            }
            Expression::Truth(truth) => {
                self.operations.push(Operation::Truth(*truth));
                Ok(Type::Truth)
            }
            Expression::Name(name) => self.name(name),
            Expression::Not(inner) => {
                self.truth(inner, "not")?;
                self.operations.push(Operation::Not);
                Ok(Type::Truth)
            }
            Expression::Negate(inner) => {
                let dimension = self.number(inner, "minus")?;
                self.operations.push(Operation::Negate);
                Ok(Type::Number(dimension))
            }
            Expression::Binary(operator, left, right) => self.binary(*operator, left, right),
        }
    }

    fn binary(&mut self, operator: Operator, left: &Expression, right: &Expression) -> Result<Type, Refused> {
        let word = operator.to_string().to_lowercase();
        let logic = match operator {
            Operator::And => Some(Operation::And),
            Operator::Or => Some(Operation::Or),
            Operator::Xor => Some(Operation::Xor),
            _ => None,
        };
        if let Some(logic) = logic {
            self.truth(left, &word)?;
            self.truth(right, &word)?;
            self.operations.push(logic);
            return Ok(Type::Truth);
        }
        let relation = match operator {
            Operator::Less => Some(Relation::Less),
            Operator::LessOrEqual => Some(Relation::LessOrEqual),
            Operator::Greater => Some(Relation::Greater),
            Operator::GreaterOrEqual => Some(Relation::GreaterOrEqual),
            Operator::Equal => Some(Relation::Equal),
            Operator::NotEqual => Some(Relation::NotEqual),
            _ => None,
        };
        let start = self.operations.len();
        let first = self.expression(left)?;
        if first == Type::Truth && matches!(relation, Some(Relation::Equal | Relation::NotEqual)) {
            // Two truths are equal when they are not either-or.
            self.truth(right, &word)?;
            self.operations.push(Operation::Xor);
            if relation == Some(Relation::Equal) {
                self.operations.push(Operation::Not);
            }
            return Ok(Type::Truth);
        }
        let first = as_number(first, &word)?;
        let second = self.number(right, &word)?;
        if let Some(relation) = relation {
            same(first, second, &word)?;
            self.relate(start, relation);
            return Ok(Type::Truth);
        }
        let (operation, dimension) = match operator {
            Operator::Add => (Operation::Add, same(first, second, &word)?),
            Operator::Subtract => (Operation::Subtract, same(first, second, &word)?),
            // A product with a plain number keeps the other's unit; two quantities make one that has no unit to check.
            Operator::Multiply => (Operation::Multiply, first.xor(second)),
            _ => (Operation::Divide, if second.is_some() { None } else { first }),
        };
        self.operations.push(operation);
        Ok(Type::Number(dimension))
    }

    /// A signal against a number is one operation.
    fn relate(&mut self, start: usize, relation: Relation) {
        let turned = match relation {
            Relation::Less => Relation::Greater,
            Relation::LessOrEqual => Relation::GreaterOrEqual,
            Relation::Greater => Relation::Less,
            Relation::GreaterOrEqual => Relation::LessOrEqual,
            same => same,
        };
        let fused = match self.operations[start..] {
            [Operation::Signal(signal), Operation::Constant(number)] => Some(Operation::Compare(signal, relation, number)),
            [Operation::Constant(number), Operation::Signal(signal)] => Some(Operation::Compare(signal, turned, number)),
            _ => None,
        };
        match fused {
            Some(fused) => {
                self.operations.truncate(start);
                self.operations.push(fused);
            }
            None => self.operations.push(Operation::Relate(relation)),
        }
    }

    fn name(&mut self, name: &str) -> Result<Type, Refused> {
        match meaning(name) {
            Meaning::Predefined(Predefined::Alarm(id)) => {
                self.operations.push(Operation::Alarm(id));
                Ok(Type::Truth)
            }
            Meaning::Predefined(value) => {
                let dimension = PREDEFINED.iter().find(|(_, v, ..)| *v == value).map(|(_, _, d, _)| *d);
                self.operations
                    .push(Operation::Signal(signal_of_predefined(value).unwrap_or(NO_SENSOR)));
                Ok(Type::Number(dimension.filter(|d| *d != Dimension::None)))
            }
            Meaning::Sensor(sensor) => {
                if sensor.statistic != crate::sensor::Statistic::Last {
                    return refuse(
                        "T-06",
                        format!("{name} is a statistic over a sample; a condition sees single cycles"),
                        format!("write {}", sensor.stream()),
                    );
                }
                let signal = signal_of(&sensor);
                if signal.is_none() {
                    self.missing.push(sensor.to_string());
                }
                self.operations.push(Operation::Signal(signal.unwrap_or(NO_SENSOR)));
                Ok(Type::Number(sensor.dimension()))
            }
            Meaning::Several(all) => {
                let first = all.first().map(ToString::to_string).unwrap_or_default();
                refuse(
                    "T-06",
                    format!("{name} is measured at several places, and the condition does not say which"),
                    format!("write {first}, or another of them"),
                )
            }
            Meaning::Unknown => refuse(
                "T-06",
                format!("nothing is called {name}"),
                "write a sensor as X.LOAD, an alias as coolant_pressure, a predefined value as ws_time, or a variable that the program has given a value before",
            ),
        }
    }

    fn truth(&mut self, expression: &Expression, word: &str) -> Result<(), Refused> {
        match self.expression(expression)? {
            Type::Truth => Ok(()),
            Type::Number(_) => refuse("T-06", format!("'{word}' stands between numbers"), "compare them first"),
        }
    }

    fn number(&mut self, expression: &Expression, word: &str) -> Result<Option<Dimension>, Refused> {
        let kind = self.expression(expression)?;
        as_number(kind, word)
    }
}

fn as_number(kind: Type, word: &str) -> Result<Option<Dimension>, Refused> {
    match kind {
        Type::Number(dimension) => Ok(dimension),
        Type::Truth => refuse(
            "T-06",
            format!("'{word}' needs numbers, and finds true or false"),
            "use and, or, not",
        ),
    }
}

/// The unit that both have; a plain number has the other's.
fn same(first: Option<Dimension>, second: Option<Dimension>, word: &str) -> Result<Option<Dimension>, Refused> {
    match (first, second) {
        (Some(a), Some(b)) if a != b => refuse(
            "T-06",
            format!("'{word}' stands between {a} and {b}"),
            format!("write the number in {a}"),
        ),
        (a, b) => Ok(a.or(b)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse;
    use machine::watch::signal;

    #[track_caller]
    fn condition(text: &str) -> Result<Compiled, String> {
        let line = format!(
            "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"{text}\" its_actions=\"get_time\""
        );
        let function = parse(&line).expect("a line");
        let Call::StartSynchronizedAction(action) = &function.call else {
            panic!("{function:?}")
        };
        compile(action).map_err(|refused| format!("{} {}", refused.code, refused.message))
    }

    #[test]
    fn a_comparison_of_a_signal_with_a_number_is_one_operation_in_the_unit_of_records() {
        let load = signal("X.LOAD").expect("a signal");
        let time = signal("trace:ws_time").expect("a signal");
        let compiled = condition("1 h < ws_time and X.LOAD >= 80 %").expect("compiles");
        assert_eq!(
            compiled.operations,
            [
                Operation::Compare(time, Relation::Greater, 3600.0),
                Operation::Compare(load, Relation::GreaterOrEqual, 80.0),
                Operation::And,
            ]
        );
    }

    #[test]
    fn truths_are_compared_and_numbers_are_reckoned_with() {
        assert!(condition("alarm[3] = (X.LOAD > 10)").is_ok());
        assert!(condition("X.LOAD + Y.LOAD > 2 * Z.LOAD").is_ok());
        assert!(condition("X.POSITION.ACTUAL - X.POSITION.COMMANDED > 0.01").is_ok());
        assert!(condition("true").is_ok());
    }

    #[test]
    fn a_sensor_that_this_machine_has_not_is_never_known_and_named() {
        let compiled = condition("coolant_pressure < 2 bar or S2.LOAD > 1").expect("compiles");
        assert_eq!(compiled.missing, ["COOLANT.PRESSURE", "S2.LOAD"]);
        assert_eq!(
            compiled.operations[0],
            Operation::Compare(NO_SENSOR, Relation::Less, 200_000.0)
        );
    }

    #[test]
    fn what_makes_no_sense_is_t_06() {
        for (text, expected) in [
            ("ws_time > 3 mm", "T-06 '>' stands between s and mm"),
            ("X.LOAD", "T-06 the condition is a number, neither true nor false"),
            ("X.LOAD and true", "T-06 'and' stands between numbers"),
            ("alarm[1] > 3", "T-06 '>' needs numbers, and finds true or false"),
            (
                "drive_load > 3",
                "T-06 drive_load is measured at several places, and the condition does not say which",
            ),
            ("humidity > 3", "T-06 nothing is called humidity"),
            (
                "X.LOAD.MAXIMUM > 3",
                "T-06 X.LOAD.MAXIMUM is a statistic over a sample; a condition sees single cycles",
            ),
            ("trace:x > 3", "T-06 nothing is called trace:x"),
        ] {
            assert_eq!(condition(text), Err(expected.to_owned()), "{text}");
        }
    }

    #[track_caller]
    fn refused(line: &str, expected: &str) {
        let function = parse(line).expect("a line");
        let Call::StartSynchronizedAction(action) = &function.call else {
            panic!("{function:?}")
        };
        let refused = compile(action).expect_err("refused");
        assert_eq!(format!("{} {}", refused.code, refused.message), expected);
    }

    #[test]
    fn what_cannot_be_an_action_is_t_08_and_too_many_alarms_are_t_09() {
        let start = "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL";
        refused(
            &format!("{start} its_actions=\"start_sensor_recording its_function_id=1 its_sensors=X.LOAD\""),
            "T-08 start_sensor_recording cannot be an action",
        );
        refused(
            &format!("{start} its_actions=\"get_tmie\""),
            "T-08 the action get_tmie is unknown: did you mean get_time?",
        );
        let alarms = ["\"clear_alarm its_alarm_id=1\""; 5].join(",");
        refused(
            &format!("{start} its_actions={alarms}"),
            "T-09 synchronized action 1 sets or clears 5 alarms; 4 is the most",
        );
        refused(
            &format!("{start} its_frequency=WHEN its_actions=\"get_time\""),
            "T-06 synchronized action 1 says WHEN and has no condition",
        );
        refused(
            &format!("{start} its_condition=\"true\" its_actions=\"get_time\""),
            "T-06 synchronized action 1 has a condition and no frequency",
        );
        refused(
            &format!(
                "{start} its_actions=\"start_synchronized_action its_id=2 its_mode_scope=ALL its_actions=\"\"get_time\"\"\""
            ),
            "T-08 start_synchronized_action cannot be an action",
        );
    }
}

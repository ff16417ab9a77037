//! The condition that a STEP-NC file has as an expression beside the line of its function.
//!
//! The file may say it in the line (`its_condition`), as a typed expression, or both ways; then both have to say the same. Two are the same
//! when they are in one form: numbers in the units of records, names without prefix and alias, comparisons turned one way, chains of one
//! operator without brackets. The order of operands stays, but for `=` and `<>`.

use crate::condition;
use crate::function::{CONDITION, Function};
use crate::sensor::{Meaning, PREDEFINED, Predefined, meaning};
use crate::unit;
use plan::expression::Operator;
use plan::{Diagnostic, Expression};

/// The function with its condition: the line's, or the typed one where the line has none.
///
/// # Errors
/// T-06: the typed one cannot be read, or the two differ.
pub(crate) fn joined(function: Function, typed: &Result<Expression, String>) -> Result<Function, Box<Diagnostic>> {
    if function
        .definition
        .is_none_or(|definition| definition.key(CONDITION).is_none())
    {
        return Ok(function);
    }
    let typed = match typed {
        Ok(typed) => folded(&alarms_as_truths(typed)),
        Err(why) => {
            let text = format!("the typed condition of {} cannot be read: {why}", function.name);
            return Err(Box::new(Diagnostic::error("T-06", text).remedy(
                "write comparisons, and, or, xor, not and arithmetic over numbers and named variables",
            )));
        }
    };
    match function.condition() {
        None => Ok(function.clone().with_condition(typed).unwrap_or(function)),
        Some(line) if same(&normal(line), &normal(&typed)) => Ok(function),
        Some(line) => {
            let text = format!(
                "the line of {} says the condition \"{}\", and the file's typed condition says \"{}\"",
                function.name,
                condition::print(line),
                condition::print(&typed)
            );
            Err(Box::new(
                Diagnostic::error("T-06", text).remedy("make both the same, or take one of them out"),
            ))
        }
    }
}

/// STEP-NC's variables are numbers, an alarm is a truth: 1 while it is active, as a file has to write it.
fn alarms_as_truths(expression: &Expression) -> Expression {
    let inside = |inner: &Expression| Box::new(alarms_as_truths(inner));
    match expression {
        Expression::Binary(operator @ (Operator::Equal | Operator::NotEqual), left, right) => {
            let (alarm, number) = match (&**left, &**right) {
                (Expression::Name(name), Expression::Number(number, None))
                | (Expression::Number(number, None), Expression::Name(name))
                    if matches!(meaning(name), Meaning::Predefined(Predefined::Alarm(_))) =>
                {
                    (Expression::Name(name.clone()), *number)
                }
                _ => return Expression::Binary(*operator, inside(left), inside(right)),
            };
            match (number, operator) {
                (1.0, Operator::Equal) | (0.0, Operator::NotEqual) => alarm,
                (0.0, Operator::Equal) | (1.0, Operator::NotEqual) => Expression::Not(Box::new(alarm)),
                // It is neither: compiling it says what is wrong.
                _ => expression.clone(),
            }
        }
        Expression::Binary(operator, left, right) => Expression::Binary(*operator, inside(left), inside(right)),
        Expression::Not(inner) => Expression::Not(inside(inner)),
        Expression::Negate(inner) => Expression::Negate(inside(inner)),
        Expression::Number(..) | Expression::Truth(_) | Expression::Name(_) => expression.clone(),
    }
}

/// With the sign in the number, as a line is read.
pub(crate) fn folded(expression: &Expression) -> Expression {
    let inside = |inner: &Expression| Box::new(folded(inner));
    match expression {
        Expression::Negate(inner) => match folded(inner) {
            Expression::Number(number, unit) => Expression::Number(-number, unit),
            other => Expression::Negate(Box::new(other)),
        },
        Expression::Not(inner) => Expression::Not(inside(inner)),
        Expression::Binary(operator, left, right) => Expression::Binary(*operator, inside(left), inside(right)),
        Expression::Number(..) | Expression::Truth(_) | Expression::Name(_) => expression.clone(),
    }
}

/// An expression in the one form.
#[derive(Clone, Debug, PartialEq)]
enum Normal {
    Number(f64),
    Truth(bool),
    Name(String),
    Not(Box<Normal>),
    Negate(Box<Normal>),
    /// Operands of one `and`, `or` or `xor`.
    Chain(Operator, Vec<Normal>),
    Binary(Operator, Box<Normal>, Box<Normal>),
}

fn normal(expression: &Expression) -> Normal {
    match expression {
        Expression::Number(number, unit) => {
            let factor = unit.as_deref().and_then(unit::find).map_or(1.0, |unit| unit.factor);
            Normal::Number(number * factor)
        }
        Expression::Truth(truth) => Normal::Truth(*truth),
        Expression::Name(name) => Normal::Name(plain(name)),
        Expression::Not(inner) => Normal::Not(Box::new(normal(inner))),
        Expression::Negate(inner) => match normal(inner) {
            Normal::Number(number) => Normal::Number(-number),
            other => Normal::Negate(Box::new(other)),
        },
        Expression::Binary(operator @ (Operator::And | Operator::Or | Operator::Xor), left, right) => {
            let mut all = Vec::new();
            for side in [left, right] {
                match normal(side) {
                    Normal::Chain(inner, parts) if inner == *operator => all.extend(parts),
                    other => all.push(other),
                }
            }
            Normal::Chain(*operator, all)
        }
        Expression::Binary(operator, left, right) => {
            let (left, right) = (Box::new(normal(left)), Box::new(normal(right)));
            match operator {
                Operator::Greater => Normal::Binary(Operator::Less, right, left),
                Operator::GreaterOrEqual => Normal::Binary(Operator::LessOrEqual, right, left),
                other => Normal::Binary(*other, left, right),
            }
        }
    }
}

/// One name for all that mean the same; a variable of the program keeps its own.
fn plain(name: &str) -> String {
    match meaning(name) {
        Meaning::Predefined(Predefined::Alarm(id)) => format!("trace:alarm[{id}]"),
        Meaning::Predefined(value) => {
            let known = PREDEFINED.iter().find(|(_, v, ..)| *v == value);
            known.map_or_else(|| name.to_owned(), |(name, ..)| format!("trace:{name}"))
        }
        Meaning::Sensor(sensor) => sensor.to_string(),
        Meaning::Several(_) | Meaning::Unknown => name.to_owned(),
    }
}

fn same(a: &Normal, b: &Normal) -> bool {
    match (a, b) {
        (Normal::Number(a), Normal::Number(b)) => same_number(*a, *b),
        (Normal::Not(a), Normal::Not(b)) | (Normal::Negate(a), Normal::Negate(b)) => same(a, b),
        (Normal::Chain(one, a), Normal::Chain(other, b)) => {
            one == other && a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        (Normal::Binary(one, a, b), Normal::Binary(other, c, d)) => {
            let turned = matches!(one, Operator::Equal | Operator::NotEqual) && same(a, d) && same(b, c);
            one == other && ((same(a, c) && same(b, d)) || turned)
        }
        (a, b) => a == b,
    }
}

/// Equal but for what changing the unit leaves in the last digits.
fn same_number(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-12 * a.abs().max(b.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse;

    fn line(condition: Option<&str>) -> Function {
        let condition = condition.map_or(String::new(), |text| format!("its_condition=\"{text}\" "));
        let text = format!(
            "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN {condition}its_actions=get_time"
        );
        parse(&text).expect("a line")
    }

    fn typed(text: &str) -> Result<Expression, String> {
        Ok(condition::parse(text).expect("a condition"))
    }

    #[track_caller]
    fn alike(text: &str, other: &str) {
        let function = joined(line(Some(text)), &typed(other)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(function, line(Some(text)), "the line stays as it is");
    }

    #[track_caller]
    fn differ(text: &str, other: &str) {
        let found = joined(line(Some(text)), &typed(other)).expect_err("they differ");
        assert_eq!(found.code, "T-06");
        assert!(found.message.contains(text) && found.message.contains(other), "{found}");
    }

    #[test]
    fn what_means_the_same_is_the_same() {
        alike("ws_time > 3600 s", "ws_time > 3600");
        alike("ws_time > 1 h", "trace:ws_time > 3600");
        alike("1 h < WS_TIME", "ws_time > 60 min");
        alike("X.LOAD >= 80 %", "80 <= sensor:x.load");
        alike("position_limit = X.LOAD", "X.LOAD = position_limit");
        alike("coolant_pressure < 2 bar", "COOLANT.PRESSURE < 200000");
        alike("a > 1 and (b > 2 and c > 3)", "a > 1 and b > 2 and c > 3");
        alike("alarm[3]", "trace:alarm[3] = 1");
        alike("not alarm[3]", "0 = alarm[3]");
        alike("not alarm[3]", "alarm[3] <> 1");
        alike("X.POSITION.ACTUAL > -5 mm", "X.POSITION.ACTUAL > -5");
        alike("spindle_speed > 100 rpm", "S1.ROTARY_VELOCITY.ACTUAL > 100");
    }

    #[test]
    fn what_means_something_else_is_t_06_with_both_texts() {
        differ("ws_time > 3600 s", "ws_time > 1800");
        differ("ws_time > 3600 s", "ws_time >= 3600");
        differ("ws_time > 3600 s", "op_time > 3600");
        differ("ws_time > 3600 s", "ws_time < 3600");
        differ("a > 1 and b > 2", "b > 2 and a > 1");
        differ("a > 1 and b > 2", "a > 1 or b > 2");
        differ("a > 1 or b > 2 and c > 3", "(a > 1 or b > 2) and c > 3");
        differ("a - b > 1", "b - a > 1");
        differ("not (a > 1)", "a > 1");
        differ("TIME_LIMIT > 1", "time_limit > 1");
        differ("X.LOAD > 1", "Y.LOAD > 1");
    }

    #[test]
    fn where_the_line_has_none_the_typed_one_is_the_condition() {
        let function = joined(line(None), &typed("80 <= sensor:x.load")).expect("joined");
        let crate::Call::StartSynchronizedAction(action) = &function.call else {
            panic!("{function:?}")
        };
        assert_eq!(action.condition, typed("80 <= sensor:x.load").ok());
        assert_eq!(parse(&function.to_string()).as_ref(), Ok(&function));
        let minus = Expression::Negate(Box::new(Expression::Number(5.0, None)));
        let less = Expression::Binary(Operator::Less, Box::new(Expression::Name("X.LOAD".into())), Box::new(minus));
        let function = joined(line(None), &Ok(less)).expect("joined");
        assert_eq!(function.condition(), typed("X.LOAD < -5").as_ref().ok());
    }

    #[test]
    fn one_that_cannot_be_read_is_t_06_whatever_the_line_says() {
        for text in [None, Some("X.LOAD > 3")] {
            let found = joined(line(text), &Err("#7 holds no number".to_owned())).expect_err("not readable");
            assert_eq!((found.code, found.message.contains("#7 holds no number")), ("T-06", true));
        }
    }
}

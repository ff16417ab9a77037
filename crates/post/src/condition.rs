//! Conditions and values in a control's words: as an expression where it has them, else as comparisons with jumps.

use crate::control::Control;
use crate::functions::{Reading, Source};
use crate::number::Decimals;
use crate::sheet::{Refusal, Sheet};
use plan::Expression;
use plan::expression::Operator;
use trace::sensor::{Meaning, Predefined, meaning};

/// How a control writes expressions.
pub struct Style {
    /// Its operators; one that is missing is refused.
    pub operators: &'static [(Operator, &'static str)],
    /// Brackets.
    pub brackets: (&'static str, &'static str),
    /// What negates a truth before its brackets.
    pub not: Option<&'static str>,
    /// Truth and its opposite.
    pub truth: Option<(&'static str, &'static str)>,
    /// Numbers.
    pub numbers: Decimals,
    /// Only values that the servo cycle has, in a synchronized action.
    pub realtime: bool,
}

/// The value of a name on a control.
///
/// # Errors
/// The control cannot read it.
pub fn source_of(name: &str, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<Source, Refusal> {
    let bound = ["sensor:", "trace:"].iter().any(|prefix| {
        name.get(..prefix.len())
            .is_some_and(|start| start.eq_ignore_ascii_case(prefix))
    });
    if !bound && sheet.variables().contains_key(name) {
        return variable_of(name, control, sheet);
    }
    let stream = match meaning(name) {
        Meaning::Sensor(sensor) => sensor.to_string(),
        Meaning::Predefined(value) => key_of(value),
        Meaning::Several(_) => {
            return Err(Refusal::new(
                "condition",
                format!("'{name}' is a value for each axis, and a condition needs one"),
                "name the axis, as in X.LOAD",
            ));
        }
        Meaning::Unknown if bound => {
            return Err(Refusal::new(
                "condition",
                format!("'{name}' is no sensor and no predefined value"),
                "correct its name",
            ));
        }
        // A variable of the program that nothing in it sets.
        Meaning::Unknown => {
            let source = variable_of(name, control, sheet)?;
            let text = &source.text;
            sheet.notice(format!(
                "variable '{name}' is {text}: the program does not set it; set it before the start"
            ));
            return Ok(source);
        }
    };
    match control.reading(&stream, sheet.turning) {
        Reading::Value(source) => Ok(source),
        Reading::Outside(why) | Reading::Nothing(why) => Err(Refusal::new(
            "condition",
            format!("'{name}' cannot be read by a program of {}: {why}", control.name()),
            "let the program decide by something else, or run it on a control that has this value",
        )),
    }
}

fn variable_of(name: &str, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<Source, Refusal> {
    let number = sheet.variable(name);
    Ok(Source {
        verified: true,
        ..Source::of(control.variable(number)?)
    })
}

/// The key under which controls know a predefined value: `trace:ws_time`.
pub fn key_of(value: Predefined) -> String {
    match value {
        Predefined::Alarm(id) => format!("trace:alarm[{id}]"),
        other => {
            let row = trace::sensor::PREDEFINED.iter().find(|(_, known, ..)| *known == other);
            format!("trace:{}", row.map_or("", |row| row.0))
        }
    }
}

/// A number with its unit, in the unit of records.
fn number(value: f64, unit: Option<&str>) -> Result<f64, Refusal> {
    match unit {
        None => Ok(value),
        Some(unit) => match trace::unit::find(unit) {
            Some(found) => Ok(value * found.factor),
            None => Err(Refusal::new(
                "condition",
                format!("'{unit}' is no unit that is known here"),
                "write s, mm, %, ...",
            )),
        },
    }
}

/// The expression as the control writes it, and whether every word of it is known from a manual.
///
/// # Errors
/// A name that cannot be read, an operator that the control does not have.
pub fn spell(
    expression: &Expression,
    style: &Style,
    control: &dyn Control,
    sheet: &mut Sheet<'_>,
) -> Result<(String, bool), Refusal> {
    Ok(match expression {
        Expression::Number(value, unit) => (sheet.number(number(*value, unit.as_deref())?, style.numbers)?, true),
        Expression::Truth(truth) => match style.truth {
            Some((yes, no)) => (if *truth { yes } else { no }.to_owned(), true),
            None => return Err(unsaid("TRUE and FALSE", control)),
        },
        Expression::Name(name) => {
            let source = source_of(name, control, sheet)?;
            if style.realtime && !source.realtime {
                return Err(Refusal::new(
                    "condition",
                    format!("'{name}' is read ahead of the motion and not in the servo cycle"),
                    "use a value of the servo cycle",
                ));
            }
            for line in &source.before {
                sheet.line(line);
            }
            (source.in_records(style.brackets), source.verified)
        }
        Expression::Not(inner) => {
            let Some(not) = style.not else {
                return Err(unsaid("NOT", control));
            };
            let (text, verified) = spell(inner, style, control, sheet)?;
            (format!("{not}{}{text}{}", style.brackets.0, style.brackets.1), verified)
        }
        Expression::Negate(inner) => {
            let (text, verified) = spell(inner, style, control, sheet)?;
            (format!("-{}{text}{}", style.brackets.0, style.brackets.1), verified)
        }
        Expression::Binary(operator, left, right) => {
            let Some((_, word)) = style.operators.iter().find(|(known, _)| known == operator) else {
                return Err(unsaid(&operator.to_string(), control));
            };
            let mut side = |side: &Expression| -> Result<(String, bool), Refusal> {
                let (text, verified) = spell(side, style, control, sheet)?;
                Ok(match side {
                    Expression::Binary(..) => (format!("{}{text}{}", style.brackets.0, style.brackets.1), verified),
                    _ => (text, verified),
                })
            };
            let (left, right) = (side(left)?, side(right)?);
            (format!("{}{word}{}", left.0, right.0), left.1 && right.1)
        }
    })
}

fn unsaid(what: &str, control: &dyn Control) -> Refusal {
    Refusal::new(
        "expression",
        format!("{} has no {what} in its expressions", control.name()),
        "write the condition with comparisons",
    )
}

/// The same condition without a `NOT`: comparisons are turned round instead.
pub fn without_not(condition: &Expression, when: bool) -> Expression {
    let both = |operator, left: &Expression, right: &Expression| {
        let side = |e: &Expression| Box::new(without_not(e, when));
        Expression::Binary(operator, side(left), side(right))
    };
    match condition {
        Expression::Not(inner) => without_not(inner, !when),
        Expression::Truth(truth) => Expression::Truth(*truth == when),
        Expression::Binary(Operator::And, left, right) => both(if when { Operator::And } else { Operator::Or }, left, right),
        Expression::Binary(Operator::Or, left, right) => both(if when { Operator::Or } else { Operator::And }, left, right),
        Expression::Binary(Operator::Xor, left, right) => Expression::Binary(
            Operator::Xor,
            Box::new(without_not(left, when)),
            Box::new(without_not(right, true)),
        ),
        Expression::Binary(operator, left, right) => match negated(*operator).filter(|_| !when) {
            Some(other) => Expression::Binary(other, left.clone(), right.clone()),
            None => condition.clone(),
        },
        Expression::Name(_) if !when => Expression::Binary(
            Operator::Equal,
            Box::new(condition.clone()),
            Box::new(Expression::Number(0.0, None)),
        ),
        other => other.clone(),
    }
}

/// One comparison and where to go when it holds.
pub struct Comparison {
    /// Equal, not equal, less, ...
    pub operator: Operator,
    /// As the control writes it.
    pub left: String,
    /// The same.
    pub right: String,
    /// A label.
    pub to: u32,
}

/// How a control jumps.
pub trait Jumps {
    /// How it writes the sides of comparisons.
    fn style(&self) -> &Style;
    /// Goes somewhere when a comparison holds.
    fn jump(&self, comparison: &Comparison, sheet: &mut Sheet<'_>);
    /// Goes somewhere.
    fn go(&self, to: u32, sheet: &mut Sheet<'_>);
    /// Here it comes out.
    fn place(&self, label: u32, sheet: &mut Sheet<'_>);
}

/// Jumps to `to` when the condition is `when`; else goes on behind. Gives whether every word is known from a manual.
///
/// # Errors
/// The condition cannot be said.
pub fn jump_if(
    condition: &Expression,
    when: bool,
    to: u32,
    (jumps, control): (&dyn Jumps, &dyn Control),
    sheet: &mut Sheet<'_>,
) -> Result<bool, Refusal> {
    let with = (jumps, control);
    match condition {
        Expression::Truth(truth) => {
            if *truth == when {
                jumps.go(to, sheet);
            }
            Ok(true)
        }
        Expression::Not(inner) => jump_if(inner, !when, to, with, sheet),
        Expression::Binary(operator @ (Operator::And | Operator::Or), left, right) => {
            // `And` is false as soon as one side is; `Or` is true as soon as one side is.
            if (*operator == Operator::And) != when {
                let left = jump_if(left, when, to, with, sheet)?;
                Ok(jump_if(right, when, to, with, sheet)? && left)
            } else {
                let past = sheet.label();
                let left = jump_if(left, !when, past, with, sheet)?;
                let right = jump_if(right, when, to, with, sheet)?;
                jumps.place(past, sheet);
                Ok(left && right)
            }
        }
        Expression::Binary(operator @ (Operator::Xor | Operator::Equal | Operator::NotEqual), left, right)
            if *operator == Operator::Xor || is_truth(left) || is_truth(right) =>
        {
            let differ = *operator != Operator::Equal;
            let both = |a: &Expression, b: Expression| Expression::Binary(Operator::And, Box::new(a.clone()), Box::new(b));
            let not = |e: &Expression| Expression::Not(Box::new(e.clone()));
            let either = Expression::Binary(
                Operator::Or,
                Box::new(both(left, not(right))),
                Box::new(both(&not(left), (**right).clone())),
            );
            jump_if(&either, when == differ, to, with, sheet)
        }
        Expression::Binary(operator, left, right) if negated(*operator).is_some() => {
            let mut sides = Vec::new();
            let mut verified = true;
            for side in [left, right] {
                let (text, known) = spell(side, jumps.style(), control, sheet)?;
                verified &= known;
                sides.push(match **side {
                    Expression::Binary(..) => format!("{}{text}{}", jumps.style().brackets.0, jumps.style().brackets.1),
                    _ => text,
                });
            }
            let right = sides.pop().unwrap_or_default();
            let left = sides.pop().unwrap_or_default();
            let operator = if when {
                *operator
            } else {
                negated(*operator).unwrap_or(*operator)
            };
            jumps.jump(
                &Comparison {
                    operator,
                    left,
                    right,
                    to,
                },
                sheet,
            );
            Ok(verified)
        }
        // A number that stands for a truth: 0 is false.
        Expression::Name(_) => {
            let zero = Box::new(Expression::Number(0.0, None));
            let is = Expression::Binary(Operator::NotEqual, Box::new(condition.clone()), zero);
            jump_if(&is, when, to, with, sheet)
        }
        _ => Err(Refusal::new(
            "condition",
            format!("'{condition}' is a number and no condition"),
            "compare it with something",
        )),
    }
}

fn is_truth(expression: &Expression) -> bool {
    match expression {
        Expression::Truth(_) | Expression::Not(_) => true,
        Expression::Binary(operator, ..) => {
            negated(*operator).is_some() || matches!(operator, Operator::And | Operator::Or | Operator::Xor)
        }
        Expression::Number(..) | Expression::Name(_) | Expression::Negate(_) => false,
    }
}

/// The comparison that holds when this one does not.
fn negated(operator: Operator) -> Option<Operator> {
    Some(match operator {
        Operator::Equal => Operator::NotEqual,
        Operator::NotEqual => Operator::Equal,
        Operator::Less => Operator::GreaterOrEqual,
        Operator::GreaterOrEqual => Operator::Less,
        Operator::Greater => Operator::LessOrEqual,
        Operator::LessOrEqual => Operator::Greater,
        _ => return None,
    })
}

//! What may stand behind a key, and how it is read and printed.

use crate::fault::{Fault, fault, nearest};
use crate::function::Function;
use crate::moment::is_moment;
use crate::unit::{self, Dimension};
use crate::{condition, function};
use plan::Expression;
use std::fmt;
use units::{Millimetres, Seconds};

/// What kind of value a key takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A name or a text; in double quotes where it has blanks or commas.
    Text,
    /// A day or a time, RFC 3339.
    Moment,
    /// A whole number in these bounds.
    Integer(i64, i64),
    /// A number; its unit may be written and is the one of records else.
    Number(Dimension),
    /// `ON` or `OFF`, also `TRUE` or `FALSE`.
    State,
    /// One of these words.
    Word(&'static [&'static str]),
    /// Names, with commas between them.
    List,
    /// A condition in double quotes.
    Condition,
    /// Function lines in double quotes, with commas between them.
    Actions,
    /// `10`, `time:20ms`, `distance:0.5mm`, `count:200` or `points:#anchor`.
    Sampling,
    /// `#anchor`: geometry in the file, or `#123`: an entity of it.
    Reference,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::Text => f.write_str("text"),
            Kind::Moment => f.write_str("day or time, as 2026-11-20 or 2026-11-20T06:00:00Z"),
            Kind::Integer(1, 2_147_483_647) => f.write_str("whole number from 1"),
            Kind::Integer(from, to) => write!(f, "whole number {from} to {to}"),
            Kind::Number(Dimension::None) => f.write_str("number from 0"),
            Kind::Number(Dimension::Percent) => f.write_str("number from 0 to 100, %"),
            Kind::Number(dimension) => write!(f, "number from 0, {dimension}"),
            Kind::State => f.write_str("ON or OFF"),
            Kind::Word(words) => f.write_str(&words.join(", ")),
            Kind::List => f.write_str("names with commas"),
            Kind::Condition => f.write_str("condition in quotes"),
            Kind::Actions => f.write_str("function lines in quotes"),
            Kind::Sampling => f.write_str("10, time:20ms, distance:0.5mm, count:200 or points:#anchor"),
            Kind::Reference => f.write_str("#anchor or #entity"),
        }
    }
}

/// When samples are taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Sampling {
    /// Every n-th servo cycle, counted from the cycle in which the function took effect.
    ByCycle(u32),
    /// At this interval.
    ByTime(Seconds),
    /// Each time this distance along the path is done.
    ByDistance(Millimetres),
    /// When the tool passes the next point of a curve or set of points, within the tolerance.
    ByPoints {
        /// The anchor or entity of the geometry.
        curve: String,
        /// How near it has to pass.
        tolerance: Option<Millimetres>,
    },
    /// So many, spread evenly over the scope.
    ByCount(u32),
}

impl Default for Sampling {
    fn default() -> Self {
        Sampling::ByCycle(1)
    }
}

impl fmt::Display for Sampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Sampling::ByCycle(factor) => write!(f, "{factor}"),
            Sampling::ByTime(interval) => write!(f, "time:{}s", interval.0),
            Sampling::ByDistance(step) => write!(f, "distance:{}mm", step.0),
            Sampling::ByPoints { curve, tolerance: None } => write!(f, "points:#{curve}"),
            Sampling::ByPoints {
                curve,
                tolerance: Some(near),
            } => write!(f, "points:#{curve}:{}mm", near.0),
            Sampling::ByCount(samples) => write!(f, "count:{samples}"),
        }
    }
}

/// A value that was read.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A name or a text.
    Text(String),
    /// A whole number.
    Integer(i64),
    /// A number in the unit of records.
    Number(f64, Dimension),
    /// On or off.
    State(bool),
    /// A word of the key's list, as the list spells it.
    Word(&'static str),
    /// Names.
    List(Vec<String>),
    /// A condition.
    Condition(Expression),
    /// What is done.
    Actions(Vec<Function>),
    /// When samples are taken.
    Sampling(Sampling),
    /// Geometry or an entity, without its `#`.
    Reference(String),
}

/// One item of a list as written: its characters, its column, and whether it stood in quotes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Item {
    pub text: String,
    pub column: u32,
    pub quoted: bool,
}

impl Item {
    fn first_column(&self) -> u32 {
        self.column + u32::from(self.quoted)
    }
}

/// Makes a value of the items behind `key=`.
pub(crate) fn read(key: &str, kind: Kind, items: &[Item]) -> Result<Value, Box<Fault>> {
    let bad = |item: &Item, what: &str| {
        fault(
            "trace-value",
            item.column,
            format!("'{}' is not what {key} takes", item.text),
            format!("write {what}"),
        )
    };
    let single = || match items {
        [item] => Ok(item),
        [_, second, ..] => fault(
            "trace-value",
            second.column,
            format!("{key} takes one value"),
            "put it in double quotes when it has a comma",
        ),
        [] => unreachable!("the line's reader gives at least one item"),
    };
    Ok(match kind {
        Kind::Text => match single()? {
            item if item.text.trim().is_empty() => return bad(item, "a text that is not blank"),
            item => Value::Text(item.text.clone()),
        },
        Kind::Moment => match single()? {
            item if is_moment(&item.text) => Value::Text(item.text.clone()),
            item => return bad(item, &format!("a {kind}")),
        },
        Kind::Reference => {
            let item = single()?;
            let name = item.text.strip_prefix('#').unwrap_or(&item.text);
            match name {
                "" => return bad(item, "#anchor or #entity"),
                name if item.quoted || name.contains(['#', ':']) => return bad(item, &format!("{kind} instead of {name}")),
                name => Value::Reference(name.to_owned()),
            }
        }
        Kind::Integer(from, to) => {
            let item = single()?;
            match item.text.parse::<i64>() {
                Ok(number) if (from..=to).contains(&number) => Value::Integer(number),
                _ => return bad(item, &format!("a {kind}")),
            }
        }
        Kind::Number(dimension) => {
            let item = single()?;
            // What functions take are sizes and shares: none is below zero, and no share is more than the whole.
            let most = if dimension == Dimension::Percent {
                100.0
            } else {
                f64::INFINITY
            };
            match number(&item.text, dimension).filter(|n| (0.0..=most).contains(n)) {
                Some(number) => Value::Number(number, dimension),
                None => return bad(item, &format!("a {kind}")),
            }
        }
        Kind::State => {
            let item = single()?;
            match item.text.to_ascii_lowercase().as_str() {
                "on" | "true" | ".t." => Value::State(true),
                "off" | "false" | ".f." => Value::State(false),
                _ => return bad(item, "ON or OFF"),
            }
        }
        Kind::Word(words) => {
            let item = single()?;
            match words.iter().find(|word| word.eq_ignore_ascii_case(&item.text)) {
                Some(word) => Value::Word(word),
                None => {
                    let all = words.join(", ");
                    let meant = nearest(&item.text, words.iter().copied());
                    let remedy = meant.map_or(format!("one of {all}"), |word| format!("{word}, or another of {all}"));
                    return bad(item, &remedy);
                }
            }
        }
        Kind::List => {
            if let Some(empty) = items.iter().find(|item| item.text.is_empty()) {
                return bad(empty, "a name between the commas");
            }
            Value::List(items.iter().map(|item| item.text.clone()).collect())
        }
        Kind::Condition => {
            let item = single()?;
            Value::Condition(condition::parse(&item.text).map_err(|found| found.shifted(item.first_column() - 1))?)
        }
        Kind::Actions => {
            let mut actions = Vec::new();
            for item in items {
                let action = function::read_action(&item.text).map_err(|found| found.shifted(item.first_column() - 1))?;
                actions.push(action);
            }
            Value::Actions(actions)
        }
        Kind::Sampling => {
            let item = single()?;
            match sampling(&item.text) {
                Some(sampling) => Value::Sampling(sampling),
                None => return bad(item, &kind.to_string()),
            }
        }
    })
}

fn sampling(text: &str) -> Option<Sampling> {
    let count = |text: &str| text.parse::<u32>().ok().filter(|n| *n >= 1);
    let above_zero = |text: &str, dimension| number(text, dimension).filter(|n| *n > 0.0);
    let Some((word, rest)) = text.split_once(':') else {
        return count(text).map(Sampling::ByCycle);
    };
    match word.to_ascii_lowercase().as_str() {
        "cycle" => count(rest).map(Sampling::ByCycle),
        "time" => above_zero(rest, Dimension::Time).map(|t| Sampling::ByTime(Seconds(t))),
        "distance" => above_zero(rest, Dimension::Length).map(|d| Sampling::ByDistance(Millimetres(d))),
        "count" => count(rest).map(Sampling::ByCount),
        "points" => {
            let rest = rest.strip_prefix('#')?;
            let (curve, tolerance) = match rest.split_once(':') {
                None => (rest, None),
                Some((curve, near)) => (curve, Some(Millimetres(above_zero(near, Dimension::Length)?))),
            };
            (!curve.is_empty()).then(|| Sampling::ByPoints {
                curve: curve.to_owned(),
                tolerance,
            })
        }
        _ => None,
    }
}

/// A number with or without unit, in the unit of records.
fn number(text: &str, dimension: Dimension) -> Option<f64> {
    let ends = |end: usize| text[..end].parse::<f64>().ok().map(|number| (end, number));
    let (end, number) = (1..=text.len())
        .rev()
        .filter(|end| text.is_char_boundary(*end))
        .find_map(ends)?;
    let factor = match text[end..].trim() {
        "" => 1.0,
        written => unit::find(written).filter(|unit| unit.dimension == dimension)?.factor,
    };
    Some(number * factor).filter(|n| n.is_finite())
}

impl fmt::Display for Value {
    /// As it stands behind `=`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Text(text) => f.write_str(&quoted_where_needed(text)),
            Value::Integer(number) => write!(f, "{number}"),
            Value::Number(number, dimension) => write!(f, "{number}{}", dimension.symbol()),
            Value::State(on) => f.write_str(if *on { "ON" } else { "OFF" }),
            Value::Word(word) => f.write_str(word),
            Value::List(names) => {
                let names: Vec<String> = names.iter().map(|name| quoted_where_needed(name)).collect();
                f.write_str(&names.join(","))
            }
            Value::Condition(expression) => f.write_str(&quoted(&condition::print(expression))),
            Value::Actions(actions) => {
                let lines: Vec<String> = actions.iter().map(|action| quoted(&action.without_prefix())).collect();
                f.write_str(&lines.join(","))
            }
            Value::Sampling(sampling) => write!(f, "{sampling}"),
            Value::Reference(name) => write!(f, "#{name}"),
        }
    }
}

fn quoted_where_needed(text: &str) -> String {
    let plain = |c: char| !c.is_whitespace() && !c.is_control() && !matches!(c, '"' | ',' | '=' | '(' | ')' | '[' | ']');
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        quoted(text)
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

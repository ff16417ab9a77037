//! Programs of a few steps, made by hand: what a reader would say of them.

#![allow(dead_code, reason = "each test takes what it needs")]

use plan::{Expression, FileId, Level, Marker, Origin, Place, RawNcFunction, Step, StepKind};
use std::collections::BTreeMap;
use trace::survey::{Found, Survey};
use units::StepId;

/// What a step says; its number is its place.
pub enum Say<'s> {
    /// A part begins.
    Begin(Level, &'s str),
    /// The innermost part of a level ends.
    End(Level),
    /// A function, as its text.
    Function(&'s str),
    /// A function, as its text, with a condition as an expression beside it.
    Typed(&'s str, Option<Result<Expression, String>>),
    /// A line along a path.
    Along(&'s str),
    /// Anything else.
    Kind(StepKind),
}

/// The steps, each in the line of its number.
pub fn steps(said: &[Say<'_>]) -> Vec<Step> {
    let raw = |kind: &str, text: &str, properties: BTreeMap<String, String>| {
        StepKind::NcFunction(RawNcFunction {
            kind: kind.to_owned(),
            name: String::new(),
            text: text.to_owned(),
            condition: None,
            properties,
        })
    };
    let kind = |say: &Say<'_>| match say {
        Say::Begin(level, name) => StepKind::Begin(Marker {
            level: *level,
            name: (*name).to_owned(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        }),
        Say::End(level) => StepKind::End(*level),
        Say::Function(line) => raw(RawNcFunction::EXTENDED, &format!("trace:1 {line}"), BTreeMap::new()),
        Say::Typed(line, condition) => StepKind::NcFunction(RawNcFunction {
            kind: RawNcFunction::EXTENDED.to_owned(),
            name: String::new(),
            text: format!("trace:1 {line}"),
            condition: condition.clone(),
            properties: BTreeMap::new(),
        }),
        Say::Along(line) => {
            let properties = BTreeMap::from([(format!("trace:1 {line}"), String::new())]);
            raw(trace::survey::ALONG, "", properties)
        }
        Say::Kind(kind) => kind.clone(),
    };
    let step = |(at, say): (usize, &Say<'_>)| Step {
        id: StepId(at as u32 + 1),
        origin: Origin {
            file: FileId(0),
            place: Place::Text {
                line: at as u32 + 1,
                start: 0,
                length: 1,
            },
        },
        kind: kind(say),
    };
    said.iter().enumerate().map(step).collect()
}

/// What a look through them finds.
pub fn look(said: &[Say<'_>]) -> Found {
    let mut survey = Survey::new("p");
    steps(said).iter().for_each(|step| survey.step(step));
    survey.finish()
}

//! The one way in which a process value changes.

use crate::{Chain, Event};
use serde_json::Value;
use std::collections::BTreeMap;
use thiserror::Error;
use units::Timestamp;

/// Values that a run depends on, by path: `tool/5/wear/x_mm`, `offset/G54/z_mm`. The unit stands in the path.
pub trait Registers {
    /// The present value; `None` when it was never set.
    fn get(&self, path: &str) -> Option<f64>;
    /// Sets it. Called by [`change`] alone.
    fn set(&mut self, path: &str, value: f64);
}

impl Registers for BTreeMap<String, f64> {
    fn get(&self, path: &str) -> Option<f64> {
        BTreeMap::get(self, path).copied()
    }
    fn set(&mut self, path: &str, value: f64) {
        self.insert(path.to_owned(), value);
    }
}

/// What somebody wants changed.
#[derive(Clone, Debug, PartialEq)]
pub struct ChangeRequest {
    /// Which value.
    pub path: String,
    /// What it shall be.
    pub to: f64,
    /// What the asker believes it is now; a change from another value is refused, so that nothing is applied twice.
    pub expected: Option<f64>,
    /// Who asks.
    pub who: String,
    /// Why.
    pub why: String,
    /// When.
    pub when: Timestamp,
}

/// The line of a program that asks for a change, in a run that is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProgramLine {
    /// Number of the job that runs it.
    pub job: i64,
    /// The file that the line stands in.
    pub file: String,
    /// Its line; `None` when the program has none (STEP-NC).
    pub line: Option<u32>,
}

/// A change that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The value before; `None` when it was never set.
    pub before: Option<f64>,
    /// The value after.
    pub after: f64,
    /// Its record.
    pub event: Event,
}

/// Why a change was refused; nothing was changed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ChangeError {
    /// The value is not what the asker saw.
    #[error("{path} is {found:?}, not {expected:?}: somebody changed it meanwhile; look again")]
    Stale {
        /// Which value.
        path: String,
        /// What the asker saw.
        expected: Option<f64>,
        /// What it is.
        found: Option<f64>,
    },
    /// Not a number that a register can hold.
    #[error("{path} cannot become {to}")]
    NotFinite {
        /// Which value.
        path: String,
        /// What was asked.
        to: f64,
    },
    /// A change without a person or a reason is none.
    #[error("a change of {0} needs who and why: give --operator and --reason")]
    Anonymous(String),
}

/// Changes one process value and records it. Nothing else in the house sets a register.
///
/// # Errors
/// The value is not what the asker saw, the new one is not finite, or nobody stands behind it.
pub fn change(registers: &mut dyn Registers, chain: &mut Chain, request: &ChangeRequest) -> Result<Change, ChangeError> {
    apply(registers, chain, request, None)
}

/// [`change`], asked for by a running program: the event says in which job, and on which line.
///
/// # Errors
/// As [`change`].
pub fn change_by_program(
    registers: &mut dyn Registers,
    chain: &mut Chain,
    request: &ChangeRequest,
    line: &ProgramLine,
) -> Result<Change, ChangeError> {
    apply(registers, chain, request, Some(line))
}

fn apply(
    registers: &mut dyn Registers,
    chain: &mut Chain,
    request: &ChangeRequest,
    program: Option<&ProgramLine>,
) -> Result<Change, ChangeError> {
    let path = &request.path;
    if request.who.trim().is_empty() || request.why.trim().is_empty() {
        return Err(ChangeError::Anonymous(path.clone()));
    }
    if !request.to.is_finite() {
        return Err(ChangeError::NotFinite {
            path: path.clone(),
            to: request.to,
        });
    }
    let before = registers.get(path);
    if before != request.expected {
        return Err(ChangeError::Stale {
            path: path.clone(),
            expected: request.expected,
            found: before,
        });
    }
    registers.set(path, request.to);
    let mut detail = BTreeMap::from([
        ("path".to_owned(), Value::from(path.as_str())),
        ("before".to_owned(), before.map_or(Value::Null, Value::from)),
        ("after".to_owned(), Value::from(request.to)),
        ("who".to_owned(), Value::from(request.who.as_str())),
        ("why".to_owned(), Value::from(request.why.as_str())),
    ]);
    if let Some(program) = program {
        detail.insert("job".to_owned(), Value::from(program.job));
        detail.insert("file".to_owned(), Value::from(program.file.as_str()));
        if let Some(line) = program.line {
            detail.insert("line".to_owned(), Value::from(line));
        }
    }
    let event = chain.append(request.when, "change", detail);
    Ok(Change {
        before,
        after: request.to,
        event,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(to: f64, expected: Option<f64>) -> ChangeRequest {
        ChangeRequest {
            path: "tool/5/wear/x_mm".into(),
            to,
            expected,
            who: "Maria".into(),
            why: "measured 20.02".into(),
            when: Timestamp(1),
        }
    }

    #[test]
    fn a_change_says_who_why_before_and_after() {
        let (mut values, mut chain) = (BTreeMap::from([("tool/5/wear/x_mm".to_owned(), 0.1)]), Chain::default());
        let done = change(&mut values, &mut chain, &request(0.08, Some(0.1))).expect("allowed");
        assert_eq!((done.before, done.after), (Some(0.1), 0.08));
        assert_eq!(done.event.detail["who"], "Maria");
        assert_eq!(values["tool/5/wear/x_mm"], 0.08);
    }

    #[test]
    fn a_change_by_a_program_says_its_job_and_line() {
        let (mut values, mut chain) = (BTreeMap::new(), Chain::default());
        let line = ProgramLine {
            job: 7,
            file: "O9000.nc".into(),
            line: Some(12),
        };
        let done = change_by_program(&mut values, &mut chain, &request(0.08, None), &line).expect("allowed");
        assert_eq!(
            (&done.event.detail["job"], &done.event.detail["line"]),
            (&7.into(), &12.into())
        );
        assert_eq!(done.event.kind, "change");
        let by_hand = change(&mut values, &mut chain, &request(0.1, Some(0.08))).expect("allowed");
        assert_eq!(by_hand.event.detail.get("job"), None);
    }

    #[test]
    fn the_same_request_cannot_be_applied_twice() {
        let (mut values, mut chain) = (BTreeMap::new(), Chain::default());
        let once = request(0.08, None);
        change(&mut values, &mut chain, &once).expect("the first time");
        assert!(matches!(
            change(&mut values, &mut chain, &once),
            Err(ChangeError::Stale { .. })
        ));
        assert_eq!(chain.sequence, 1);
    }
}

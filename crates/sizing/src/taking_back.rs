//! Taking a change back: undone while no part was cut with it, answered by an opposite one afterwards.

use ledger::{ChangeRequest, Event};
use thiserror::Error;
use units::Timestamp;

/// A change that was made, as its event tells.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// The number of its event.
    pub sequence: u64,
    /// The register's path.
    pub register: String,
    /// What stood there before; `None` when it was never set.
    pub before: Option<f64>,
    /// What it was changed to.
    pub after: f64,
}

impl Applied {
    /// Reads the event of a change; `None` for any other event.
    pub fn from_event(event: &Event) -> Option<Applied> {
        let detail = |name: &str| event.detail.get(name);
        (event.kind == "change").then_some(())?;
        Some(Applied {
            sequence: event.sequence,
            register: detail("path")?.as_str()?.to_owned(),
            before: detail("before")?.as_f64(),
            after: detail("after")?.as_f64()?,
        })
    }
}

/// Why a change cannot be taken back like this.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum UndoError {
    /// Nobody says why.
    #[error("taking back entry {0} needs a reason: give --reason")]
    NoReason(u64),
    /// The register was changed again since.
    #[error(
        "entry {sequence} set {register} to {after} mm, but it is {found:?} now: a later change built on it; undo that one first, or enter a new size"
    )]
    ChangedSince {
        /// The entry.
        sequence: u64,
        /// The register.
        register: String,
        /// What the entry set.
        after: f64,
        /// What stands there.
        found: Option<f64>,
    },
    /// A part was cut with it.
    #[error("the tool has cut with entry {0} since: it stays in the history; make the opposite entry, with a reason")]
    HasCut(u64),
}

/// Takes a change back as if it had not been made: the register gets the value from before. Only while no part was cut with it.
///
/// `present` is what stands in the register now, `has_cut` whether the tool has cut with the change in force.
///
/// # Errors
/// No reason was given, a part was cut with it, or the register was changed again since.
pub fn undo(
    applied: &Applied,
    present: Option<f64>,
    has_cut: bool,
    who: &str,
    reason: &str,
    when: Timestamp,
) -> Result<ChangeRequest, UndoError> {
    if reason.trim().is_empty() {
        return Err(UndoError::NoReason(applied.sequence));
    }
    if has_cut {
        return Err(UndoError::HasCut(applied.sequence));
    }
    if present != Some(applied.after) {
        return Err(UndoError::ChangedSince {
            sequence: applied.sequence,
            register: applied.register.clone(),
            after: applied.after,
            found: present,
        });
    }
    Ok(ChangeRequest {
        path: applied.register.clone(),
        // A register that was never set counts as 0.
        to: applied.before.unwrap_or(0.0),
        expected: present,
        who: who.to_owned(),
        why: format!("undo of entry {}: {}", applied.sequence, reason.trim()),
        when,
    })
}

/// Answers a change by the opposite one, on top of whatever was changed since.
///
/// # Errors
/// No reason was given.
pub fn opposite(
    applied: &Applied,
    present: Option<f64>,
    who: &str,
    reason: &str,
    when: Timestamp,
) -> Result<ChangeRequest, UndoError> {
    if reason.trim().is_empty() {
        return Err(UndoError::NoReason(applied.sequence));
    }
    let change = applied.after - applied.before.unwrap_or(0.0);
    let to = libm::round((present.unwrap_or(0.0) - change) * 1e9) / 1e9;
    Ok(ChangeRequest {
        path: applied.register.clone(),
        to,
        expected: present,
        who: who.to_owned(),
        why: format!("opposite of entry {}: {}", applied.sequence, reason.trim()),
        when,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ledger::{Chain, Registers, change};
    use std::collections::BTreeMap;

    /// A register that a change took from `before` to -0.0009.
    fn changed(before: Option<f64>) -> (BTreeMap<String, f64>, Chain, Applied) {
        let mut registers: BTreeMap<String, f64> = before.into_iter().map(|b| ("r".to_owned(), b)).collect();
        let mut chain = Chain::default();
        let request = ChangeRequest {
            path: "r".into(),
            to: -0.0009,
            expected: before,
            who: "Maria".into(),
            why: "measured".into(),
            when: Timestamp(1),
        };
        let event = change(&mut registers, &mut chain, &request).expect("allowed").event;
        let applied = Applied::from_event(&event).expect("a change");
        (registers, chain, applied)
    }

    #[test]
    fn undo_gives_back_what_was_there_and_is_itself_in_the_log() {
        for before in [Some(0.25), None] {
            let (mut registers, mut chain, applied) = changed(before);
            let request = undo(
                &applied,
                Registers::get(&registers, "r"),
                false,
                "Maria",
                "wrong part",
                Timestamp(2),
            )
            .expect("safe");
            assert_eq!(request.why, "undo of entry 1: wrong part");
            let undone = change(&mut registers, &mut chain, &request).expect("allowed");
            assert_eq!((registers["r"], undone.event.sequence), (before.unwrap_or(0.0), 2));
        }
    }

    #[test]
    fn undo_is_refused_when_it_would_hide_something() {
        let (.., applied) = changed(Some(0.0));
        let undo =
            |present, has_cut, reason| undo(&applied, present, has_cut, "Maria", reason, Timestamp(2)).map_err(|e| e.to_string());
        assert_eq!(
            undo(Some(-0.0009), false, " "),
            Err("taking back entry 1 needs a reason: give --reason".to_owned())
        );
        assert!(
            undo(Some(-0.0009), true, "oops")
                .expect_err("cut")
                .contains("make the opposite entry")
        );
        assert!(
            undo(Some(-0.002), false, "oops")
                .expect_err("changed")
                .contains("but it is Some(-0.002) now")
        );
    }

    #[test]
    fn an_opposite_entry_keeps_what_came_after() {
        let (.., applied) = changed(Some(0.0011));
        let request = opposite(&applied, Some(-0.0049), "Maria", "gauge was off", Timestamp(3)).expect("with a reason");
        assert_eq!((request.to, request.expected), (-0.0029, Some(-0.0049)));
    }

    #[test]
    fn other_events_are_no_changes() {
        let event = Chain::default().append(Timestamp(0), "job-started", BTreeMap::new());
        assert_eq!(Applied::from_event(&event), None);
    }
}

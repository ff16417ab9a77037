//! Holds, removals and roll-ups held against what the log tells of them.

use crate::rollup::Rollup;
use crate::verify::{Finding, finding};
use crate::{DataDirectory, StoreError, whole_file};
use ledger::Event;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What the directory's chain says of holds and removals.
#[derive(Default)]
pub(crate) struct ToldOfRetention {
    /// Jobs on hold, with the event that put them there: its number, time, who, why.
    held: BTreeMap<i64, ToldHold>,
    /// Records that retention removes or has removed, by their place in the catalogue.
    removals: BTreeMap<i64, ToldRemoval>,
}

type ToldHold = (u64, i64, String, String);

struct ToldRemoval {
    event: u64,
    state: &'static str,
    at_ns: i64,
    why: String,
    rollup: Option<String>,
}

impl ToldOfRetention {
    /// Takes in the next event of the chain.
    pub(crate) fn hear(&mut self, event: &Event) {
        let number = |name: &str| event.detail.get(name).and_then(Value::as_i64);
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        match (event.kind.as_str(), number("job"), number("record")) {
            ("job-held", Some(job), _) => {
                let hold = (event.sequence, event.at_ns, text("who"), text("why"));
                self.held.insert(job, hold);
            }
            ("job-released", Some(job), _) => drop(self.held.remove(&job)),
            ("record-removal-begun", _, Some(record)) => {
                let rollup = event.detail.get("rollup_sha256").and_then(Value::as_str);
                let begun = ToldRemoval {
                    event: event.sequence,
                    state: "marked",
                    at_ns: event.at_ns,
                    why: text("why"),
                    rollup: rollup.map(str::to_owned),
                };
                self.removals.insert(record, begun);
            }
            ("record-removed", _, Some(record)) => {
                if let Some(begun) = self.removals.get_mut(&record) {
                    (begun.event, begun.state, begun.at_ns) = (event.sequence, "removed", event.at_ns);
                }
            }
            ("record-removal-withdrawn", _, Some(record)) => drop(self.removals.remove(&record)),
            _ => {}
        }
    }

    /// True for a record that retention may have taken.
    pub(crate) fn is_removed(&self, record: i64) -> bool {
        self.removals.contains_key(&record)
    }
}

impl DataDirectory {
    pub(crate) fn verify_retention(&self, told: &ToldOfRetention, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        self.verify_holds_and_removals(told, findings)?;
        self.verify_rollups(told, findings)
    }

    /// Holds and removals are what the log tells of them.
    fn verify_holds_and_removals(&self, told: &ToldOfRetention, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let holds = || -> rusqlite::Result<BTreeMap<i64, ToldHold>> {
            let mut statement = self.database.prepare("SELECT job, event, at_ns, who, why FROM holds")?;
            let rows = statement.query_map([], |row| {
                let event = row.get::<_, i64>(1)?.unsigned_abs();
                Ok((row.get(0)?, (event, row.get(2)?, row.get(3)?, row.get(4)?)))
            })?;
            rows.collect()
        };
        let holds = holds().map_err(self.failed())?;
        for job in holds.keys().chain(told.held.keys()).collect::<BTreeSet<_>>() {
            match (holds.get(job), told.held.get(job)) {
                (Some(kept), Some(said)) if kept == said => {}
                (Some(_), _) => findings.push(finding(
                    format!("hold of job {job} (table holds)"),
                    "is not what the log tells",
                )),
                (None, _) => findings.push(finding(
                    format!("hold of job {job} (table holds)"),
                    "is gone, and nobody released it",
                )),
            }
        }
        type Row = (String, u64, i64, String, Option<String>);
        let removals = || -> rusqlite::Result<BTreeMap<i64, Row>> {
            let mut statement = self
                .database
                .prepare("SELECT record, state, event, at_ns, why, rollup_sha256 FROM removals")?;
            let rows = statement.query_map([], |row| {
                let event = row.get::<_, i64>(2)?.unsigned_abs();
                Ok((row.get(0)?, (row.get(1)?, event, row.get(3)?, row.get(4)?, row.get(5)?)))
            })?;
            rows.collect()
        };
        let removals = removals().map_err(self.failed())?;
        for record in removals.keys().chain(told.removals.keys()).collect::<BTreeSet<_>>() {
            match (removals.get(record), told.removals.get(record)) {
                (Some((state, event, at_ns, why, rollup)), Some(said))
                    if (state.as_str(), *event, *at_ns) == (said.state, said.event, said.at_ns)
                        && (why, rollup) == (&said.why, &said.rollup) => {}
                _ => findings.push(finding(
                    format!("removal of record {record} (table removals)"),
                    "is not what the log tells",
                )),
            }
        }
        Ok(())
    }

    fn verify_rollups(&self, told: &ToldOfRetention, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        for row in self.records()? {
            let path = self.rollup_path(&row);
            let what = format!("roll-up {}", path.display());
            let removal = told.removals.get(&(row.sequence as i64));
            if let Some(said) = removal.and_then(|r| r.rollup.as_ref()) {
                // The rows are gone: what is left of them is held against the log.
                match whole_file::hash_of_file(&path) {
                    Ok(hash) if hash.to_string() == *said => {}
                    Ok(_) => findings.push(finding(what, "is not what was kept when its record was removed")),
                    Err(e) => findings.push(finding(what, e)),
                }
            } else if path.exists()
                && let Err(error) = Rollup::open(&path).and_then(|rollup| rollup.check())
            {
                findings.push(finding(what, error));
            }
        }
        Ok(())
    }
}

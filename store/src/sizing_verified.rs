//! Jobs of sizes and their entries held against what the log tells of them.

use crate::verify::{Finding, finding};
use crate::{DataDirectory, StoreError};
use ledger::{Event, Hash};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What the directory's chain says of sizing, by the number of the event.
#[derive(Default)]
pub(crate) struct ToldOfSizing {
    jobs: BTreeMap<i64, ToldJob>,
    entries: BTreeMap<i64, ToldEntry>,
}

/// Machine, diameters, name, hash of the text.
type ToldJob = [String; 4];
/// Job and dimension.
type ToldEntry = (i64, String);

impl ToldOfSizing {
    /// Takes in the next event of the chain.
    pub(crate) fn hear(&mut self, event: &Event) {
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        let sequence = event.sequence as i64;
        if event.kind == "size-job" {
            let job = ["machine", "diameters", "name", "text_sha256"].map(text);
            self.jobs.insert(sequence, job);
        } else if event.kind.starts_with("size-") {
            let job = event.detail.get("job").and_then(Value::as_i64).unwrap_or_default();
            self.entries.insert(sequence, (job, text("dimension")));
        }
    }
}

impl DataDirectory {
    pub(crate) fn verify_sizing(&self, told: &ToldOfSizing, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let jobs = || -> rusqlite::Result<BTreeMap<i64, ToldJob>> {
            let mut statement = self
                .database
                .prepare("SELECT event, machine, diameters, name, text FROM sizing_jobs")?;
            let rows = statement.query_map([], |row| {
                let text: String = row.get(4)?;
                let job = [row.get(1)?, row.get(2)?, row.get(3)?, Hash::of(text.as_bytes()).to_string()];
                Ok((row.get(0)?, job))
            })?;
            rows.collect()
        };
        let entries = || -> rusqlite::Result<BTreeMap<i64, ToldEntry>> {
            let mut statement = self.database.prepare("SELECT event, job, dimension FROM sizing_entries")?;
            let rows = statement.query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?;
            rows.collect()
        };
        let (jobs, entries) = (jobs().map_err(self.failed())?, entries().map_err(self.failed())?);
        compare("size job", "sizing_jobs", &jobs, &told.jobs, findings);
        compare("size entry", "sizing_entries", &entries, &told.entries, findings);
        Ok(())
    }
}

fn compare<T: PartialEq>(word: &str, table: &str, rows: &BTreeMap<i64, T>, told: &BTreeMap<i64, T>, findings: &mut Vec<Finding>) {
    for event in rows.keys().chain(told.keys()).collect::<BTreeSet<_>>() {
        let what = format!("{word} {event} (table {table})");
        match (rows.get(event), told.get(event)) {
            (Some(row), Some(said)) if row == said => {}
            (Some(_), Some(_)) => findings.push(finding(what, "is not what the log tells")),
            (Some(_), None) => findings.push(finding(what, "no event of the log tells of it")),
            (None, _) => findings.push(finding(what, "is gone")),
        }
    }
}

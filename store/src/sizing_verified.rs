//! Jobs of sizes and entries held against the events that tell of them.

use crate::verify::{Finding, finding};
use crate::{DataDirectory, StoreError};
use ledger::{Event, Hash};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What the directory's chain says of sizes: rows by the number of their event, in words.
#[derive(Default)]
pub(crate) struct ToldOfSizing {
    jobs: Rows,
    entries: Rows,
}

type Rows = BTreeMap<i64, String>;

impl ToldOfSizing {
    /// Takes in the next event of the chain.
    pub(crate) fn hear(&mut self, event: &Event) {
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default();
        let number = event.sequence as i64;
        if event.kind == "size-job" {
            let words = job_words(text("machine"), text("diameters"), text("name"), text("text_sha256"));
            self.jobs.insert(number, words);
        } else if event.kind.starts_with("size-") {
            let job = event.detail.get("sizing_job").and_then(Value::as_i64).unwrap_or_default();
            self.entries.insert(number, entry_words(job, text("dimension")));
        }
    }
}

fn job_words(machine: &str, diameters: &str, name: &str, text_sha256: &str) -> String {
    format!("{name:?} on {machine:?}, diameters {diameters:?}, text {text_sha256}")
}

fn entry_words(job: i64, dimension: &str) -> String {
    format!("{dimension:?} of job {job}")
}

impl DataDirectory {
    /// Jobs of sizes and entries are what the log tells of them.
    pub(crate) fn verify_sizing(&self, told: &ToldOfSizing, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let jobs = || -> rusqlite::Result<Rows> {
            let mut statement = self
                .database
                .prepare("SELECT event, machine, diameters, name, text FROM sizing_jobs")?;
            let rows = statement.query_map([], |row| {
                let text: [String; 4] = [row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?];
                let [machine, diameters, name, text] = text;
                let hash = Hash::of(text.as_bytes()).to_string();
                Ok((row.get(0)?, job_words(&machine, &diameters, &name, &hash)))
            })?;
            rows.collect()
        };
        let entries = || -> rusqlite::Result<Rows> {
            let mut statement = self.database.prepare("SELECT event, job, dimension FROM sizing_entries")?;
            let rows = statement.query_map([], |row| {
                Ok((row.get(0)?, entry_words(row.get(1)?, &row.get::<_, String>(2)?)))
            })?;
            rows.collect()
        };
        compare("sizing_jobs", &told.jobs, &jobs().map_err(self.failed())?, findings);
        compare("sizing_entries", &told.entries, &entries().map_err(self.failed())?, findings);
        Ok(())
    }
}

fn compare(table: &str, told: &Rows, kept: &Rows, findings: &mut Vec<Finding>) {
    for event in told.keys().chain(kept.keys()).collect::<BTreeSet<_>>() {
        let what = format!("row of event {event} (table {table})");
        match (told.get(event), kept.get(event)) {
            (Some(said), Some(found)) if said == found => {}
            (Some(said), Some(found)) => findings.push(finding(what, format!("is {found}, but the log tells {said}"))),
            (Some(said), None) => findings.push(finding(what, format!("is gone; the log tells {said}"))),
            (None, _) => findings.push(finding(what, "was never told")),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::DataDirectory;
    use crate::sizing::{NewSize, SizingJob};
    use serde_json::Value;
    use std::collections::BTreeMap;
    use units::Timestamp;

    #[test]
    fn a_row_that_was_changed_behind_our_back_is_found() {
        for (sql, row) in [
            ("UPDATE sizing_jobs SET text = 'other'", "row of event 1 (table sizing_jobs)"),
            ("UPDATE sizing_jobs SET diameters = ''", "row of event 1 (table sizing_jobs)"),
            (
                "UPDATE sizing_entries SET dimension = 'B'",
                "row of event 2 (table sizing_entries)",
            ),
            ("DELETE FROM sizing_entries", "row of event 2 (table sizing_entries)"),
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
            let job = SizingJob {
                id: 0,
                machine: "sim-lathe".into(),
                diameters: "x".into(),
                name: "SHAFT".into(),
                text: "name = \"SHAFT\"".into(),
            };
            let job = directory.load_sizing_job(&job, "Maria", Timestamp(1)).expect("kept");
            let entry = NewSize {
                job: job.id,
                kind: "size-entered",
                at: Timestamp(2),
                detail: BTreeMap::from([("dimension".to_owned(), Value::from("A"))]),
                change: None,
            };
            directory.keep_size(&entry, &mut |_| {}).expect("kept");
            assert_eq!(directory.verify().expect("reads"), []);
            let triggers =
                "DROP TRIGGER sizing_jobs_stay; DROP TRIGGER sizing_entries_stay; DROP TRIGGER sizing_entries_are_kept;";
            directory.database.execute_batch(triggers).expect("dropped");
            directory.database.execute_batch(sql).expect("changed");
            let found = directory.verify().expect("reads");
            assert!(found.iter().any(|f| f.what == row), "{sql}: {found:?}");
        }
    }
}

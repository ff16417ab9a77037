//! Jobs whose sizes are entered, and the entries: kept as events of the directory's chain, with the change of the register in the same
//! transaction.
//!
//! What an entry means is the `sizing` crate's; here it is a kind and its detail.

use crate::events::{apply_change, insert_event};
use crate::{DataDirectory, StoreError};
use ledger::{Change, ChangeRequest, Event, Hash};
use rusqlite::{OptionalExtension, Row, params};
use serde_json::Value;
use std::collections::BTreeMap;
use units::Timestamp;

/// A job whose sizes are entered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SizingJob {
    /// Its number: of the event that loaded it.
    pub id: u64,
    /// The machine.
    pub machine: String,
    /// The axes whose registers count diameters: `x`.
    pub diameters: String,
    /// Its name.
    pub name: String,
    /// The job file as it was loaded.
    pub text: String,
}

/// An entry to be kept.
#[derive(Clone, Debug)]
pub struct NewSize<'a> {
    /// The job.
    pub job: u64,
    /// Kind of its event: `size-...`.
    pub kind: &'a str,
    /// When.
    pub at: Timestamp,
    /// Its detail; `dimension` must be there.
    pub detail: BTreeMap<String, Value>,
    /// The change of the register, where there is one.
    pub change: Option<&'a ChangeRequest>,
}

/// What was written last of an entry: between any two of these the power may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Written {
    /// Nothing yet.
    Nothing,
    /// The event of the change.
    ChangeEvent,
    /// The register.
    Register,
    /// The event of the entry.
    EntryEvent,
    /// The entry's row.
    Entry,
    /// All of it is on disk.
    Committed,
}

impl Written {
    /// All of them, in order.
    pub const ALL: [Written; 6] = [
        Written::Nothing,
        Written::ChangeEvent,
        Written::Register,
        Written::EntryEvent,
        Written::Entry,
        Written::Committed,
    ];
}

impl DataDirectory {
    /// Keeps a job; it is the one in force on its machine from now on.
    ///
    /// # Errors
    /// The disk refuses; nothing was written then.
    pub fn load_sizing_job(&mut self, new: &SizingJob, who: &str, at: Timestamp) -> Result<SizingJob, StoreError> {
        let id = self.in_transaction(|transaction, chain| {
            let detail = BTreeMap::from([
                ("machine".to_owned(), Value::from(new.machine.as_str())),
                ("diameters".to_owned(), Value::from(new.diameters.as_str())),
                ("name".to_owned(), Value::from(new.name.as_str())),
                (
                    "text_sha256".to_owned(),
                    Value::from(Hash::of(new.text.as_bytes()).to_string()),
                ),
                ("who".to_owned(), Value::from(who)),
            ]);
            let event = chain.append(at, "size-job", detail);
            insert_event(transaction, crate::Log::Directory, &event)?;
            transaction.execute(
                "INSERT INTO sizing_jobs (event, machine, diameters, name, text) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![event.sequence as i64, new.machine, new.diameters, new.name, new.text],
            )?;
            Ok(event.sequence)
        })?;
        Ok(SizingJob { id, ..new.clone() })
    }

    /// The job in force on a machine, or on any: the last one that was loaded.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn sizing_job(&self, machine: Option<&str>) -> Result<Option<SizingJob>, StoreError> {
        let read = |row: &Row<'_>| {
            Ok(SizingJob {
                id: row.get::<_, i64>("event")? as u64,
                machine: row.get("machine")?,
                diameters: row.get("diameters")?,
                name: row.get("name")?,
                text: row.get("text")?,
            })
        };
        self.database
            .query_row(
                "SELECT * FROM sizing_jobs WHERE ?1 IS NULL OR machine = ?1 ORDER BY event DESC LIMIT 1",
                [machine],
                read,
            )
            .optional()
            .map_err(self.failed())
    }

    /// Keeps an entry and makes its change: all of it or nothing. `written` is told after each write; it is for tests of power loss.
    ///
    /// # Errors
    /// `ledger::change` refuses the change, or the disk does; nothing was written then.
    pub fn keep_size(
        &mut self,
        new: &NewSize<'_>,
        written: &mut dyn FnMut(Written),
    ) -> Result<(Event, Option<Change>), StoreError> {
        let failed = self.failed();
        let transaction = self
            .database
            .transaction_with_behavior(rusqlite::TransactionBehavior::Immediate)
            .map_err(&failed)?;
        let mut chain = crate::events::end_of(&transaction, crate::Log::Directory).map_err(&failed)??;
        written(Written::Nothing);
        let mut change = None;
        let mut detail = new.detail.clone();
        detail.insert("job".to_owned(), new.job.into());
        if let Some(request) = new.change {
            let made = apply_change(&transaction, &mut chain, (request, None), &failed, &mut || {
                written(Written::ChangeEvent)
            })?;
            written(Written::Register);
            detail.insert("change".to_owned(), made.event.sequence.into());
            change = Some(made);
        }
        let dimension = detail.get("dimension").and_then(Value::as_str).unwrap_or_default().to_owned();
        let event = chain.append(new.at, new.kind, detail);
        insert_event(&transaction, crate::Log::Directory, &event).map_err(&failed)?;
        written(Written::EntryEvent);
        transaction
            .execute(
                "INSERT INTO sizing_entries (event, job, dimension) VALUES (?1, ?2, ?3)",
                params![event.sequence as i64, new.job as i64, dimension],
            )
            .map_err(&failed)?;
        written(Written::Entry);
        transaction.commit().map_err(&failed)?;
        written(Written::Committed);
        Ok((event, change))
    }

    /// The events of a job's entries, in order.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn sizes(&self, job: u64) -> Result<Vec<Event>, StoreError> {
        let failed = self.failed();
        let mut statement = self
            .database
            .prepare(
                "SELECT events.* FROM sizing_entries JOIN events ON events.log = 0 AND events.sequence = sizing_entries.event
                 WHERE sizing_entries.job = ?1 ORDER BY sizing_entries.event",
            )
            .map_err(&failed)?;
        let rows = statement
            .query_map([job as i64], |row| Ok(crate::events::event_of(crate::Log::Directory, row)))
            .map_err(&failed)?;
        rows.map(|row| row.map_err(&failed)?).collect()
    }

    /// The changes of one register from event `from` on, whoever made them.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn changes_of(&self, path: &str, from: u64) -> Result<Vec<Event>, StoreError> {
        self.told("kind = 'change' AND json_extract(detail, '$.path') = ?1", path, from)
    }

    /// True when a job was started on this machine after event `from`: its tools may have cut since.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn has_run_since(&self, machine: &str, from: u64) -> Result<bool, StoreError> {
        let started = self.told(
            "kind = 'job-started' AND json_extract(detail, '$.machine') = ?1",
            machine,
            from + 1,
        )?;
        Ok(!started.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATH: &str = "sim-lathe/tool/5/wear/x_mm";

    fn job(directory: &mut DataDirectory) -> SizingJob {
        let new = SizingJob {
            id: 0,
            machine: "sim-lathe".into(),
            diameters: "x".into(),
            name: "SHAFT".into(),
            text: "name = \"SHAFT\"".into(),
        };
        directory.load_sizing_job(&new, "Maria", Timestamp(1)).expect("kept")
    }

    fn request(to: f64, expected: Option<f64>) -> ChangeRequest {
        ChangeRequest {
            path: PATH.into(),
            to,
            expected,
            who: "Maria".into(),
            why: "measured".into(),
            when: Timestamp(2),
        }
    }

    fn entry<'a>(job: &SizingJob, change: Option<&'a ChangeRequest>) -> NewSize<'a> {
        NewSize {
            job: job.id,
            kind: "size-entered",
            at: Timestamp(2),
            detail: BTreeMap::from([("dimension".to_owned(), Value::from("DIM A"))]),
            change,
        }
    }

    #[test]
    fn an_entry_and_its_change_are_kept_together_and_verify() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let job = job(&mut directory);
        let mut seen = Vec::new();
        let change = request(-0.02, None);
        let (event, made) = directory
            .keep_size(&entry(&job, Some(&change)), &mut |w| seen.push(w))
            .expect("kept");
        assert_eq!(seen, Written::ALL);
        assert_eq!(made.expect("a change").event.sequence, event.sequence - 1);
        directory.keep_size(&entry(&job, None), &mut |_| {}).expect("kept");
        assert_eq!(directory.value(PATH).expect("reads"), Some(-0.02));
        assert_eq!(directory.sizes(job.id).expect("reads").len(), 2);
        assert_eq!(directory.sizing_job(Some("sim-lathe")).expect("reads"), Some(job));
        assert_eq!(directory.sizing_job(Some("other")).expect("reads"), None);
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_refused_change_keeps_no_entry() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let job = job(&mut directory);
        let stale = request(1.0, Some(7.0));
        assert!(directory.keep_size(&entry(&job, Some(&stale)), &mut |_| {}).is_err());
        assert_eq!(directory.sizes(job.id).expect("reads"), []);
        assert_eq!(directory.value(PATH).expect("reads"), None);
    }

    #[test]
    fn jobs_and_entries_cannot_be_changed_by_hand() {
        for sql in [
            "UPDATE sizing_jobs SET text = ''",
            "DELETE FROM sizing_jobs",
            "UPDATE sizing_entries SET dimension = 'X'",
            "DELETE FROM sizing_entries",
            "INSERT INTO sizing_entries VALUES (77, 1, 'DIM A')",
            "INSERT INTO sizing_jobs VALUES (77, 'm', '', 'n', 't')",
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
            let job = job(&mut directory);
            directory.keep_size(&entry(&job, None), &mut |_| {}).expect("kept");
            assert!(directory.database.execute_batch(sql).is_err(), "{sql}");
        }
    }
}

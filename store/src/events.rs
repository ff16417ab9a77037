//! The chained log and the process values in SQLite.
//!
//! A process value and the event that tells of its change are one transaction: after a power loss both are there or neither is. The
//! end of a chain is read from the database inside each transaction and never kept in memory, where a failed commit would leave it
//! wrong.

use crate::{DataDirectory, JobId, StoreError};
use ledger::{Chain, Change, ChangeRequest, Event, Hash, ProgramLine};
use rusqlite::{Connection, OptionalExtension, Row, TransactionBehavior, params};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use units::Timestamp;

/// Which chain of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Log {
    /// The data directory's own: jobs, changes of process values, catalogue.
    Directory,
    /// What happened in one job: a chain of its own, so that the same run tells the same events in any data directory.
    Job(JobId),
}

impl Log {
    pub(crate) fn number(self) -> i64 {
        match self {
            Log::Directory => 0,
            Log::Job(job) => job.0,
        }
    }
}
impl fmt::Display for Log {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Log::Directory => f.write_str("the log of the data directory"),
            Log::Job(job) => write!(f, "the log of job {job}"),
        }
    }
}

/// What an event of a job changes elsewhere.
pub(crate) type Effect<'a> = dyn FnMut(&Connection, &mut Chain, &Event) -> Result<(), StoreError> + 'a;

impl DataDirectory {
    /// Changes one process value: the value and its event, in one transaction. When this returns, both are on disk.
    ///
    /// # Errors
    /// `ledger::change` refuses it (the value is not what the asker saw, nobody stands behind it), or the disk does. Nothing was
    /// changed then; asking again is safe, because `expected` refuses a change that was made after all.
    pub fn change_value(&mut self, request: &ChangeRequest) -> Result<Change, StoreError> {
        let mut changes = self.change_values(std::slice::from_ref(request))?;
        Ok(changes.remove(0))
    }

    /// Changes several process values, all or none.
    ///
    /// # Errors
    /// The first refusal; nothing was changed then.
    pub fn change_values(&mut self, requests: &[ChangeRequest]) -> Result<Vec<Change>, StoreError> {
        self.must_hold()?;
        let failed = self.failed();
        let transaction = self
            .database
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(&failed)?;
        let mut chain = end_of(&transaction, Log::Directory).map_err(&failed)??;
        let mut changes = Vec::with_capacity(requests.len());
        for request in requests {
            let change = apply_change(&transaction, &mut chain, (request, None), &failed, &mut || {})?;
            changes.push(change);
        }
        transaction.commit().map_err(&failed)?;
        Ok(changes)
    }

    /// A process value in force; `None` when it was never set.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn value(&self, path: &str) -> Result<Option<f64>, StoreError> {
        read_value(&self.database, path).map_err(self.failed())
    }

    /// All process values under a prefix, by path: `values("sim-mill/")`.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn values(&self, prefix: &str) -> Result<BTreeMap<String, f64>, StoreError> {
        let all = |connection: &Connection| -> rusqlite::Result<BTreeMap<String, f64>> {
            let mut statement =
                connection.prepare("SELECT path, value FROM registers WHERE substr(path, 1, length(?1)) = ?1 ORDER BY path")?;
            statement.query_map([prefix], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        all(&self.database).map_err(self.failed())
    }

    /// Writes an event into the directory's own chain.
    ///
    /// # Errors
    /// The disk refuses; nothing was written then.
    pub fn append(&mut self, at: Timestamp, kind: &str, detail: BTreeMap<String, Value>) -> Result<Event, StoreError> {
        self.in_transaction(|transaction, chain| {
            let event = chain.append(at, kind, detail);
            insert_event(transaction, Log::Directory, &event)?;
            Ok(event)
        })
    }

    /// Keeps events that a job's own chain made, in order, all or none.
    ///
    /// # Errors
    /// They do not continue what is kept of this job, the job is not running, or the disk refuses.
    pub fn append_job_events(&mut self, job: JobId, events: &[Event]) -> Result<(), StoreError> {
        self.append_events_with(job, events, &mut |_, _, _| Ok(()))
    }

    /// [`DataDirectory::append_job_events`], with what an event changes elsewhere: `effect` is called behind each event, in the same
    /// transaction, with the end of the directory's own chain.
    pub(crate) fn append_events_with(&mut self, job: JobId, events: &[Event], effect: &mut Effect<'_>) -> Result<(), StoreError> {
        self.running_job(job)?;
        let failed = self.failed();
        let log = Log::Job(job);
        self.must_hold()?;
        let transaction = self
            .database
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(&failed)?;
        let mut chain = end_of(&transaction, log).map_err(&failed)??;
        let mut directory = end_of(&transaction, Log::Directory).map_err(&failed)??;
        for event in events {
            chain.follow(event).map_err(|broken| StoreError::Broken { log, broken })?;
            insert_event(&transaction, log, event).map_err(&failed)?;
            effect(&transaction, &mut directory, event)?;
        }
        transaction.commit().map_err(&failed)
    }

    /// The events of a chain from number `from` on, at most `limit` of them.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable. Whether the chain is whole is asked by [`DataDirectory::verify`].
    pub fn events(&self, log: Log, from: u64, limit: usize) -> Result<Vec<Event>, StoreError> {
        let failed = self.failed();
        let mut statement = self
            .database
            .prepare("SELECT * FROM events WHERE log = ?1 AND sequence >= ?2 ORDER BY sequence LIMIT ?3")
            .map_err(&failed)?;
        let rows = statement
            .query_map(
                params![log.number(), from as i64, i64::try_from(limit).unwrap_or(i64::MAX)],
                |row| Ok(event_of(log, row)),
            )
            .map_err(&failed)?;
        rows.map(|row| row.map_err(&failed)?).collect()
    }

    /// The last event of a chain.
    ///
    /// # Errors
    /// The disk refuses, or the row is not readable.
    pub fn last_event(&self, log: Log) -> Result<Option<Event>, StoreError> {
        last_event(&self.database, log).map_err(self.failed())?.transpose()
    }

    /// Checks that the last event of the directory's chain is whole before anything is chained to it.
    pub(crate) fn check_last_event(&self) -> Result<(), StoreError> {
        let Some(event) = self.last_event(Log::Directory)? else {
            return Ok(());
        };
        let mut before = Chain {
            sequence: event.sequence.saturating_sub(1),
            hash: Hash::parse(&event.previous).unwrap_or_default(),
        };
        before.follow(&event).map_err(|broken| StoreError::Broken {
            log: Log::Directory,
            broken,
        })
    }

    /// Runs one transaction that may append to the directory's chain.
    pub(crate) fn in_transaction<T>(
        &mut self,
        work: impl FnOnce(&Connection, &mut Chain) -> rusqlite::Result<T>,
    ) -> Result<T, StoreError> {
        self.must_hold()?;
        let failed = self.failed();
        let transaction = self
            .database
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(&failed)?;
        let mut chain = end_of(&transaction, Log::Directory).map_err(&failed)??;
        let done = work(&transaction, &mut chain).map_err(&failed)?;
        transaction.commit().map_err(&failed)?;
        Ok(done)
    }
}

/// Changes one value within a transaction, for a person or for a line of a program; `between` is called when its event is written and
/// the value is not.
pub(crate) fn apply_change(
    connection: &Connection,
    chain: &mut Chain,
    (request, by_program): (&ChangeRequest, Option<&ProgramLine>),
    failed: &dyn Fn(rusqlite::Error) -> StoreError,
    between: &mut dyn FnMut(),
) -> Result<Change, StoreError> {
    // The ledger sees the one value that it may change; what it left there is what is written.
    let mut values = BTreeMap::new();
    if let Some(value) = read_value(connection, &request.path).map_err(failed)? {
        values.insert(request.path.clone(), value);
    }
    let change = match by_program {
        None => ledger::change(&mut values, chain, request)?,
        Some(line) => ledger::change_by_program(&mut values, chain, request, line)?,
    };
    insert_event(connection, Log::Directory, &change.event).map_err(failed)?;
    between();
    for (path, value) in &values {
        connection
            .execute(
                "INSERT INTO registers (path, value, event) VALUES (?1, ?2, ?3)
                 ON CONFLICT (path) DO UPDATE SET value = excluded.value, event = excluded.event",
                params![path, value, change.event.sequence as i64],
            )
            .map_err(failed)?;
    }
    Ok(change)
}

pub(crate) fn read_value(connection: &Connection, path: &str) -> rusqlite::Result<Option<f64>> {
    connection
        .prepare_cached("SELECT value FROM registers WHERE path = ?1")?
        .query_row([path], |row| row.get(0))
        .optional()
}

pub(crate) fn insert_event(connection: &Connection, log: Log, event: &Event) -> rusqlite::Result<()> {
    let detail = serde_json::to_string(&event.detail).expect("a map with text keys is always JSON");
    connection
        .prepare_cached(
            "INSERT INTO events (log, sequence, at_ns, kind, detail, previous, hash) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
        )?
        .execute(params![
            log.number(),
            event.sequence as i64,
            event.at_ns,
            event.kind,
            detail,
            event.previous,
            event.hash
        ])?;
    Ok(())
}

fn last_event(connection: &Connection, log: Log) -> rusqlite::Result<Option<Result<Event, StoreError>>> {
    connection
        .prepare_cached("SELECT * FROM events WHERE log = ?1 ORDER BY sequence DESC LIMIT 1")?
        .query_row([log.number()], |row| Ok(event_of(log, row)))
        .optional()
}

/// The end of a chain as the database has it.
pub(crate) fn end_of(connection: &Connection, log: Log) -> rusqlite::Result<Result<Chain, StoreError>> {
    let Some(event) = last_event(connection, log)? else {
        return Ok(Ok(Chain::default()));
    };
    Ok(event.and_then(|event| match Hash::parse(&event.hash) {
        Some(hash) => Ok(Chain {
            sequence: event.sequence,
            hash,
        }),
        None => Err(StoreError::BadEvent {
            log,
            sequence: event.sequence as i64,
            what: "its hash is not 64 hexadecimal digits".to_owned(),
        }),
    }))
}

pub(crate) fn event_of(log: Log, row: &Row<'_>) -> Result<Event, StoreError> {
    let sequence: i64 = row.get("sequence").unwrap_or_default();
    let bad = |what: String| StoreError::BadEvent { log, sequence, what };
    let read = || -> rusqlite::Result<(i64, String, String, String, String)> {
        Ok((
            row.get("at_ns")?,
            row.get("kind")?,
            row.get("detail")?,
            row.get("previous")?,
            row.get("hash")?,
        ))
    };
    let (at_ns, kind, detail, previous, hash) = read().map_err(|e| bad(e.to_string()))?;
    Ok(Event {
        sequence: u64::try_from(sequence).map_err(|e| bad(e.to_string()))?,
        at_ns,
        kind,
        detail: serde_json::from_str(&detail).map_err(|e| bad(e.to_string()))?,
        previous,
        hash,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn request(path: &str, to: f64, expected: Option<f64>) -> ChangeRequest {
        ChangeRequest {
            path: path.into(),
            to,
            expected,
            who: "Maria".into(),
            why: "measured".into(),
            when: Timestamp(5),
        }
    }

    fn open(folder: &tempfile::TempDir) -> DataDirectory {
        DataDirectory::open(folder.path(), "test").expect("free")
    }

    #[test]
    fn a_change_is_there_after_reopening_with_its_event() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        let change = directory
            .change_value(&request("m/tool/5/wear/x_mm", -0.0229, None))
            .expect("allowed");
        drop(directory);
        let directory = open(&folder);
        assert_eq!(directory.value("m/tool/5/wear/x_mm").expect("reads"), Some(-0.0229));
        assert_eq!(directory.events(Log::Directory, 1, 10).expect("reads"), [change.event]);
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_request_made_twice_is_applied_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        directory.change_value(&request("a", 1.0, None)).expect("the first time");
        let twice = directory.change_value(&request("a", 1.0, None)).expect_err("stale");
        assert!(
            matches!(twice, StoreError::Change(ledger::ChangeError::Stale { .. })),
            "{twice}"
        );
        assert_eq!(
            directory.last_event(Log::Directory).expect("reads").map(|e| e.sequence),
            Some(1)
        );
    }

    #[test]
    fn of_several_changes_all_are_made_or_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        let refused = directory.change_values(&[request("a", 1.0, None), request("b", f64::NAN, None)]);
        assert!(refused.is_err());
        assert_eq!(directory.values("").expect("reads"), BTreeMap::new());
        assert_eq!(directory.last_event(Log::Directory).expect("reads"), None);
        directory
            .change_values(&[request("a", 1.0, None), request("a", 2.0, Some(1.0))])
            .expect("one after the other");
        assert_eq!(directory.value("a").expect("reads"), Some(2.0));
    }

    #[track_caller]
    fn check_refused(sql: &str, because: &str) {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        directory.change_value(&request("a", 1.0, None)).expect("allowed");
        directory.append(Timestamp(6), "noted", BTreeMap::new()).expect("written");
        let refused = directory.database.execute_batch(sql).expect_err(sql);
        assert!(refused.to_string().contains(because), "{sql}: {refused}");
        assert_eq!(directory.verify().expect("verifies"), [], "{sql}");
    }

    #[test]
    fn events_and_values_cannot_be_changed_by_hand() {
        check_refused("UPDATE events SET kind = 'x' WHERE sequence = 1", "cannot be changed");
        check_refused("DELETE FROM events", "cannot be deleted");
        check_refused(
            "INSERT OR REPLACE INTO events SELECT * FROM events WHERE sequence = 1",
            "must follow",
        );
        check_refused(
            "INSERT INTO events SELECT log, 9, at_ns, kind, detail, hash, hash FROM events WHERE sequence = 2",
            "must follow",
        );
        check_refused("UPDATE registers SET value = 7", "changes with its event only");
        check_refused("UPDATE registers SET value = 7, event = 2", "changes with its event only");
        check_refused("INSERT INTO registers VALUES ('b', 1, 1)", "changes with its event only");
        check_refused("INSERT OR REPLACE INTO registers VALUES ('a', 7, 1)", "process values");
        check_refused("DELETE FROM registers", "cannot be deleted");
    }

    #[test]
    fn a_last_event_changed_behind_our_back_is_found_on_opening() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        directory.change_value(&request("a", 1.0, None)).expect("allowed");
        directory
            .database
            .execute_batch("DROP TRIGGER events_stay; UPDATE events SET detail = replace(detail, 'Maria', 'Mario')")
            .expect("as a forger would");
        drop(directory);
        let refused = DataDirectory::open(folder.path(), "test").expect_err("broken");
        assert!(
            refused.to_string().contains("event 1 was changed after it was written"),
            "{refused}"
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// JSON text is what is kept, so a number must come back with all its bits or the chain would not verify.
        #[test]
        fn any_number_keeps_its_bits_and_its_chain(numbers in proptest::collection::vec(proptest::num::f64::NORMAL | proptest::num::f64::ZERO, 1..20)) {
            let folder = tempfile::tempdir().expect("a folder");
            let mut directory = open(&folder);
            let mut before = None;
            for number in numbers {
                directory.change_value(&request("a", number, before)).expect("allowed");
                before = Some(number);
            }
            drop(directory);
            let directory = open(&folder);
            prop_assert_eq!(directory.verify().expect("verifies"), []);
            prop_assert_eq!(directory.value("a").expect("reads"), before);
        }
    }
}

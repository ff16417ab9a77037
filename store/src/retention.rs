//! Retention: raw records go by age or when the disk fills up; what they came to stays for ever.
//!
//! A machine that records 20 channels at 1 kHz fills 187 GB in a year. So the rows of old records are removed and their roll-ups are
//! kept. Three steps, so that a process killed at any moment leaves nothing half removed:
//!
//! 1. marked: the roll-up is whole on disk, and the catalogue and the log say that the file goes and why;
//! 2. the file is deleted, and its folder synced;
//! 3. removed: catalogue and log say that it is gone.
//!
//! What is marked is taken up again by the next [`DataDirectory::retain`]. A record whose job is on hold is never marked, nor one whose program still runs.
//! A recording of observations has no roll-up: when its rows go by age, its catalogue row and its events are what stays.
//! Files outside of the data directory (`run --out`) belong to whoever asked for them there: they are neither counted nor removed.

use crate::catalogue::CatalogueRow;
use crate::events::insert_event;
use crate::whole_file::{hash_of_file, sync_folder_of};
use crate::{DataDirectory, JobId, JobState, Log, Of, StoreError};
use rusqlite::{OptionalExtension, params};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use units::Timestamp;

/// What is kept, and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retention {
    /// Records whose last row is older than this are removed, days.
    pub raw_days: f64,
    /// What the data directory may take; above 80 % of it the oldest records go. `None` for no limit.
    pub quota_bytes: Option<u64>,
}

impl Default for Retention {
    fn default() -> Self {
        Retention {
            raw_days: 90.0,
            quota_bytes: None,
        }
    }
}

/// A record that was removed.
#[derive(Clone, Debug, PartialEq)]
pub struct Removal {
    /// The record, as the catalogue keeps it.
    pub record: CatalogueRow,
    /// Why, in words.
    pub why: String,
}

/// What a call of [`DataDirectory::retain`] came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Retained {
    /// What was removed.
    pub removed: Vec<Removal>,
    /// Records that are to go and stay, because what their rows come to cannot be kept: damaged, or taken away by hand. With the reason.
    pub left: Vec<(CatalogueRow, String)>,
}

/// Above this part of the quota the oldest records go.
const FULL: f64 = 0.8;
const DAY_NS: f64 = 86_400e9;

impl DataDirectory {
    /// Removes the rows of records that are too old, or that are the oldest when the data directory is too full, and gives what was
    /// removed. Also ends what an earlier call began.
    ///
    /// # Errors
    /// The disk refuses; what was removed until then is told by the log.
    pub fn retain(&mut self, retention: &Retention, now: Timestamp) -> Result<Retained, StoreError> {
        self.must_hold()?;
        let mut retained = Retained::default();
        for record in self.marked_removals()? {
            retained.removed.push(self.remove_marked(record, now)?);
        }
        let oldest_ns = now.0 as f64 - retention.raw_days * DAY_NS;
        let limit = retention.quota_bytes.map(|quota| (quota as f64 * FULL) as u64);
        let mut taken = if limit.is_some() { bytes_below(self.root()) } else { 0 };
        for record in self.removable()? {
            let last = self.last_moment(&record)?;
            let why = if (last as f64) * 1e3 < oldest_ns {
                format!("its last row is more than {} days old", retention.raw_days)
            } else if let Some(limit) = limit.filter(|limit| taken > *limit) {
                format!(
                    "the data directory takes {taken} bytes, more than 80 % of its quota ({limit} bytes), and this is the oldest"
                )
            } else {
                continue;
            };
            // A record that cannot be rolled up must not keep others from going, or a machine from recording.
            let rollup = match self.roll_up(&record) {
                Ok(rollup) => rollup,
                Err(error) => {
                    retained.left.push((record, error.to_string()));
                    continue;
                }
            };
            taken = taken.saturating_sub(record.bytes);
            self.mark(&record, rollup.as_deref(), &why, now)?;
            retained.removed.push(self.remove_marked(record, now)?);
        }
        Ok(retained)
    }

    /// Records that retention has removed, oldest first.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn removals(&self) -> Result<Vec<Removal>, StoreError> {
        let all = || -> rusqlite::Result<Vec<Removal>> {
            let mut statement = self.database.prepare(
                "SELECT records.*, removals.why FROM removals JOIN records ON records.sequence = removals.record
                 WHERE removals.state = 'removed' ORDER BY removals.event",
            )?;
            let rows = statement.query_map([], |row| {
                Ok(Removal {
                    record: self.catalogue_row_of(row)?,
                    why: row.get("why")?,
                })
            })?;
            rows.collect()
        };
        all().map_err(self.failed())
    }

    /// Catalogued records that have rows in a span, by the time of their first row.
    pub(crate) fn records_with_rows(&self, of: Of<'_>, from_us: i64, to_us: i64) -> Result<Vec<CatalogueRow>, StoreError> {
        let (machine, job) = match of {
            Of::Machine(machine) => (Some(machine), None),
            Of::Job(job) => (None, Some(job.0)),
        };
        let all = || -> rusqlite::Result<Vec<CatalogueRow>> {
            let mut statement = self.database.prepare_cached(match of {
                Of::Machine(_) => {
                    "SELECT * FROM records WHERE machine = ?1 AND ?2 IS NULL AND last_us >= ?3 AND first_us < ?4 ORDER BY first_us, sequence"
                }
                Of::Job(_) => {
                    "SELECT * FROM records WHERE ?1 IS NULL AND job = ?2 AND last_us >= ?3 AND first_us < ?4 ORDER BY first_us, sequence"
                }
            })?;
            let rows = statement.query_map(params![machine, job, from_us, to_us], |row| self.catalogue_row_of(row))?;
            rows.collect()
        };
        all().map_err(self.failed())
    }

    /// True when the rows of a record are not there any more and need not be: removed by age, or written over by a later record of the
    /// same name.
    pub(crate) fn is_raw_gone(&self, record: &CatalogueRow) -> Result<bool, StoreError> {
        let asked = || -> rusqlite::Result<bool> {
            let state: Option<String> = self
                .database
                .prepare_cached("SELECT state FROM removals WHERE record = ?1")?
                .query_row([record.sequence as i64], |row| row.get(0))
                .optional()?;
            Ok(state.is_some())
        };
        Ok(asked().map_err(self.failed())? || self.is_written_over(record)?)
    }

    /// True when a later record was given the same name.
    fn is_written_over(&self, record: &CatalogueRow) -> Result<bool, StoreError> {
        let text = &record.text;
        let asked = || -> rusqlite::Result<i64> {
            self.database
                .prepare_cached("SELECT count(*) FROM records WHERE path = ?1 AND sequence > ?2")?
                .query_row(params![text, record.sequence as i64], |row| row.get(0))
        };
        Ok(asked().map_err(self.failed())? > 0)
    }

    /// Records that are marked and not yet told as removed.
    pub(crate) fn marked_removals(&self) -> Result<Vec<CatalogueRow>, StoreError> {
        let all = || -> rusqlite::Result<Vec<CatalogueRow>> {
            let mut statement = self.database.prepare(
                "SELECT records.* FROM removals JOIN records ON records.sequence = removals.record
                 WHERE removals.state = 'marked' ORDER BY removals.event",
            )?;
            statement.query_map([], |row| self.catalogue_row_of(row))?.collect()
        };
        all().map_err(self.failed())
    }

    /// Records that may be removed, oldest first.
    fn removable(&self) -> Result<Vec<CatalogueRow>, StoreError> {
        let held: BTreeSet<JobId> = self.holds()?.into_iter().map(|h| h.job).collect();
        let mut running = BTreeSet::new();
        for job in self.jobs()?.into_iter().filter(|job| job.state == JobState::Running) {
            // The recording of an agent may go on for years; what of it is catalogued is done with.
            if self.recorded_by(job.id)?.is_none() {
                running.insert(job.id);
            }
        }
        let mut records = Vec::new();
        for record in self.records()? {
            let kept = held.contains(&record.job) || running.contains(&record.job);
            // A path of another place keeps its root when it is written down.
            let is_ours = record.path.starts_with(self.root());
            if !kept && is_ours && !self.is_raw_gone(&record)? {
                records.push(record);
            }
        }
        records.sort_by_key(|record| (record.span_us.map_or(i64::MAX, |(_, last)| last), record.sequence));
        Ok(records)
    }

    /// The moment, microseconds UTC, from which a record's age counts: its last row, or when it was catalogued, whatever is later. An
    /// agent's clock may be years behind, and what was recorded today is not old.
    fn last_moment(&self, record: &CatalogueRow) -> Result<i64, StoreError> {
        let Some((_, last)) = record.span_us else {
            return Ok(i64::MAX);
        };
        if self.recorded_by(record.job)?.is_none() {
            return Ok(last);
        }
        let catalogued: Option<i64> = self
            .database
            .query_row(
                "SELECT at_ns FROM events WHERE log = 0 AND kind = 'record-catalogued' AND json_extract(detail, '$.sequence') = ?1",
                [record.sequence as i64],
                |row| row.get(0),
            )
            .optional()
            .map_err(self.failed())?;
        Ok(last.max(catalogued.map_or(last, |ns| ns.div_euclid(1000))))
    }

    /// Step 1, after the roll-up was made or found whole. When this returns, the file may go.
    fn mark(&mut self, record: &CatalogueRow, rollup: Option<&Path>, why: &str, now: Timestamp) -> Result<(), StoreError> {
        let rollup = rollup
            .map(|path| hash_of_file(path).map(|hash| hash.to_string()))
            .transpose()?;
        self.in_transaction(|transaction, chain| {
            let mut detail = detail_of(record);
            detail.insert("why".to_owned(), Value::from(why));
            detail.insert("rollup_sha256".to_owned(), Value::from(rollup.clone()));
            let event = chain.append(now, "record-removal-begun", detail);
            insert_event(transaction, Log::Directory, &event)?;
            transaction.execute(
                "INSERT INTO removals (record, state, at_ns, why, rollup_sha256, event) VALUES (?1, 'marked', ?2, ?3, ?4, ?5)",
                params![record.sequence as i64, now.0, why, rollup, event.sequence as i64],
            )
        })?;
        Ok(())
    }

    /// Steps 2 and 3.
    fn remove_marked(&mut self, record: CatalogueRow, now: Timestamp) -> Result<Removal, StoreError> {
        let removed = match self.is_written_over(&record)? {
            // The name belongs to a later record now.
            true => Ok(()),
            false => std::fs::remove_file(&record.path),
        };
        match removed {
            Ok(()) => sync_folder_of(&record.path)?,
            // Killed between the two steps; the folder was synced, or is now.
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                if record.path.parent().is_some_and(Path::is_dir) {
                    sync_folder_of(&record.path)?;
                }
            }
            Err(e) => return Err(StoreError::io("remove", &record.path)(e)),
        }
        let why = self.in_transaction(|transaction, chain| {
            let event = chain.append(now, "record-removed", detail_of(&record));
            insert_event(transaction, Log::Directory, &event)?;
            transaction.execute(
                "UPDATE removals SET state = 'removed', at_ns = ?2, event = ?3 WHERE record = ?1",
                params![record.sequence as i64, now.0, event.sequence as i64],
            )?;
            transaction.query_row(
                "SELECT why FROM removals WHERE record = ?1",
                [record.sequence as i64],
                |row| row.get(0),
            )
        })?;
        Ok(Removal { record, why })
    }
}

fn detail_of(record: &CatalogueRow) -> BTreeMap<String, Value> {
    BTreeMap::from([
        ("record".to_owned(), Value::from(record.sequence)),
        ("job".to_owned(), Value::from(record.job.0)),
        ("sha256".to_owned(), Value::from(record.hash.to_string())),
    ])
}

/// What all files below a folder take.
fn bytes_below(folder: &Path) -> u64 {
    let length = |path: &std::path::PathBuf| path.metadata().map_or(0, |m| m.len());
    crate::verify::files_below(folder).iter().map(length).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Header, Writer};
    use crate::{Ending, NewJob};
    use machine::Sample;
    use units::Tick;

    const NOW: Timestamp = Timestamp(1_795_132_800_000_000_000);

    /// A job of long ago with a record of 1000 rows.
    fn with_an_old_record(folder: &Path) -> (DataDirectory, CatalogueRow) {
        let mut directory = DataDirectory::open(folder, "test").expect("free");
        let new = NewJob {
            program: "plate.stpnc",
            program_hash: ledger::Hash::of(b"plate"),
            machine: "sim-mill",
            seed: 7,
            start: Timestamp(0),
            folder: None,
            who: "Maria",
        };
        let job = directory.begin_job(&new).expect("begins").id;
        let header = Header {
            machine: "sim-mill".into(),
            simulated: true,
            start: Timestamp(0),
            seed: 7,
        };
        let path = directory.record_path("sim-mill", Timestamp(0), job);
        let mut writer = Writer::create(&path, &header).expect("made");
        for tick in 0..1000 {
            let sample = Sample {
                tick: Tick(tick),
                ..Sample::default()
            };
            writer.write(&sample).expect("written");
        }
        let finished = writer.finish(&[]).expect("finished");
        let row = directory.catalogue(job, &finished, Timestamp(0)).expect("catalogued");
        directory.end_job(job, Timestamp(0), Ending::Done).expect("ends");
        (directory, row)
    }

    fn reopened(directory: DataDirectory, folder: &Path) -> DataDirectory {
        drop(directory);
        DataDirectory::open(folder, "test").expect("free")
    }

    #[test]
    fn a_removal_that_was_cut_short_is_whole_at_every_step_and_is_taken_up_again() {
        for file_went in [false, true] {
            let folder = tempfile::tempdir().expect("a folder");
            let (mut directory, row) = with_an_old_record(folder.path());
            let rollup = directory.roll_up(&row).expect("made");
            directory.mark(&row, rollup.as_deref(), "it is old", NOW).expect("marked");
            if file_went {
                std::fs::remove_file(&row.path).expect("removed");
            }
            let mut directory = reopened(directory, folder.path());
            assert_eq!(directory.verify().expect("verifies"), []);
            assert_eq!(directory.removals().expect("reads"), []);
            let removed = directory.retain(&Retention::default(), NOW).expect("goes on").removed;
            assert_eq!(removed.iter().map(|r| r.why.as_str()).collect::<Vec<_>>(), ["it is old"]);
            assert!(!row.path.exists());
            let mut directory = reopened(directory, folder.path());
            assert_eq!(directory.verify().expect("verifies"), []);
            assert_eq!(
                directory.retain(&Retention::default(), NOW).expect("done"),
                Retained::default()
            );
        }
    }

    #[test]
    fn a_hold_withdraws_a_removal_that_has_not_taken_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let (mut directory, row) = with_an_old_record(folder.path());
        let rollup = directory.roll_up(&row).expect("made");
        directory.mark(&row, rollup.as_deref(), "it is old", NOW).expect("marked");
        let mut directory = reopened(directory, folder.path());
        directory.hold_job(row.job, "Maria", "the part came back", NOW).expect("held");
        assert_eq!(
            directory.retain(&Retention::default(), NOW).expect("nothing"),
            Retained::default()
        );
        assert!(row.path.exists());
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_damaged_record_stays_and_keeps_no_other_from_going() {
        let folder = tempfile::tempdir().expect("a folder");
        let (mut directory, row) = with_an_old_record(folder.path());
        std::fs::remove_file(directory.rollup_path(&row)).expect("removed");
        std::fs::write(&row.path, "PAR1").expect("damaged");
        let retained = directory.retain(&Retention::default(), NOW).expect("goes on");
        assert_eq!(retained.removed, []);
        assert_eq!(retained.left.len(), 1);
        assert!(retained.left[0].1.contains("is damaged or cut"), "{}", retained.left[0].1);
        assert!(row.path.exists());
    }

    #[test]
    fn holds_and_removals_cannot_be_changed_by_hand() {
        let folder = tempfile::tempdir().expect("a folder");
        let (mut directory, row) = with_an_old_record(folder.path());
        directory.hold_job(row.job, "Maria", "the part came back", NOW).expect("held");
        for (sql, because) in [
            ("DELETE FROM holds", "released with its event only"),
            ("UPDATE holds SET why = 'x'", "cannot be changed"),
            ("INSERT INTO removals VALUES (1, 'removed', 0, 'x', NULL, 1)", "a record"),
        ] {
            let refused = directory.database.execute_batch(sql).expect_err(sql);
            assert!(refused.to_string().contains(because), "{sql}: {refused}");
        }
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_hold_that_was_taken_away_behind_our_back_is_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let (mut directory, row) = with_an_old_record(folder.path());
        directory.hold_job(row.job, "Maria", "the part came back", NOW).expect("held");
        directory
            .database
            .execute_batch("DROP TRIGGER holds_end_with_an_event; DELETE FROM holds")
            .expect("as a forger would");
        let findings = directory.verify().expect("verifies");
        let findings: Vec<String> = findings.iter().map(ToString::to_string).collect();
        let expected = [
            "trigger holds_end_with_an_event: is gone",
            "hold of job 1 (table holds): is gone, and nobody released it",
        ];
        assert_eq!(findings, expected);
    }
}

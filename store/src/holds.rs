//! Holds: jobs whose records stay whatever their age, because a customer asked, or a part came back.

use crate::events::insert_event;
use crate::{DataDirectory, JobId, Log, StoreError};
use rusqlite::params;
use serde_json::Value;
use std::collections::BTreeMap;
use units::Timestamp;

/// A job on hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hold {
    /// The job.
    pub job: JobId,
    /// Since when.
    pub at: Timestamp,
    /// Who put it on hold.
    pub who: String,
    /// Why.
    pub why: String,
}

impl DataDirectory {
    /// Puts a job on hold: from here on none of its records is removed. A removal that was begun and has not taken the file yet is
    /// withdrawn.
    ///
    /// # Errors
    /// There is no such job, it is on hold already, nobody stands behind it or no reason is given, or the disk refuses.
    pub fn hold_job(&mut self, job: JobId, who: &str, why: &str, at: Timestamp) -> Result<Hold, StoreError> {
        self.job(job)?;
        stands_behind(who, why)?;
        if let Some(hold) = self.holds()?.into_iter().find(|h| h.job == job) {
            return Err(StoreError::HeldAlready(hold));
        }
        let marked = self.marked_removals()?;
        let spared: Vec<u64> = (marked.iter())
            .filter(|row| row.job == job && row.path.exists())
            .map(|row| row.sequence)
            .collect();
        self.in_transaction(|transaction, chain| {
            for record in &spared {
                let detail = BTreeMap::from([
                    ("record".to_owned(), Value::from(*record)),
                    ("why".to_owned(), Value::from("its job was put on hold")),
                ]);
                let event = chain.append(at, "record-removal-withdrawn", detail);
                insert_event(transaction, Log::Directory, &event)?;
                transaction.execute("DELETE FROM removals WHERE record = ?1", [*record as i64])?;
            }
            let event = chain.append(at, "job-held", detail(job, who, why));
            insert_event(transaction, Log::Directory, &event)?;
            transaction.execute(
                "INSERT INTO holds (job, at_ns, who, why, event) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![job.0, at.0, who, why, event.sequence as i64],
            )
        })?;
        Ok(Hold {
            job,
            at,
            who: who.to_owned(),
            why: why.to_owned(),
        })
    }

    /// Releases a job: its records age as all others do.
    ///
    /// # Errors
    /// There is no such job, it is not on hold, nobody stands behind it or no reason is given, or the disk refuses.
    pub fn release_job(&mut self, job: JobId, who: &str, why: &str, at: Timestamp) -> Result<(), StoreError> {
        self.job(job)?;
        stands_behind(who, why)?;
        if self.holds()?.iter().all(|h| h.job != job) {
            return Err(StoreError::NotHeld(job));
        }
        self.in_transaction(|transaction, chain| {
            let event = chain.append(at, "job-released", detail(job, who, why));
            insert_event(transaction, Log::Directory, &event)?;
            transaction.execute("DELETE FROM holds WHERE job = ?1", [job.0])
        })?;
        Ok(())
    }

    /// All jobs on hold, by number.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn holds(&self) -> Result<Vec<Hold>, StoreError> {
        let all = || -> rusqlite::Result<Vec<Hold>> {
            let mut statement = self.database.prepare("SELECT job, at_ns, who, why FROM holds ORDER BY job")?;
            let rows = statement.query_map([], |row| {
                Ok(Hold {
                    job: JobId(row.get(0)?),
                    at: Timestamp(row.get(1)?),
                    who: row.get(2)?,
                    why: row.get(3)?,
                })
            })?;
            rows.collect()
        };
        all().map_err(self.failed())
    }
}

fn detail(job: JobId, who: &str, why: &str) -> BTreeMap<String, Value> {
    BTreeMap::from([
        ("job".to_owned(), Value::from(job.0)),
        ("who".to_owned(), Value::from(who)),
        ("why".to_owned(), Value::from(why)),
    ])
}

fn stands_behind(who: &str, why: &str) -> Result<(), StoreError> {
    if who.trim().is_empty() || why.trim().is_empty() {
        return Err(StoreError::NobodyStandsBehind);
    }
    Ok(())
}

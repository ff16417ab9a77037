//! Holds everything in a data directory against everything else: chains, values, catalogue, files.

use crate::events::end_of;
use crate::retention_verified::ToldOfRetention;
use crate::{DataDirectory, JobId, Log, StoreError, catalogue, whole_file};
use ledger::{Chain, Event};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Something that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What: the event, the value, the file.
    pub what: String,
    /// How it differs.
    pub problem: String,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.what, self.problem)
    }
}

/// How many events are in memory at a time.
const WINDOW: usize = 1000;

/// What the directory's chain says ought to be.
#[derive(Default)]
struct Told {
    values: BTreeMap<String, (f64, u64)>,
    records: Vec<BTreeMap<String, Value>>,
    ended: BTreeMap<i64, (u64, String)>,
    retention: ToldOfRetention,
}

impl DataDirectory {
    /// Checks everything that is kept: every event against its chain, every process value against the event that set it, the end of
    /// every job's chain, every catalogue row against its event, every record file against its hash, every roll-up against its checks.
    /// A record that retention removed is not missing; its roll-up is held against the hash that the log has of it. Gives what is wrong;
    /// an empty list is good.
    ///
    /// # Errors
    /// The disk refuses to be read at all.
    pub fn verify(&self) -> Result<Vec<Finding>, StoreError> {
        let mut findings = Vec::new();
        let mut told = Told::default();
        self.verify_chain(Log::Directory, &mut findings, |event| told.hear(event))?;
        for job in self.jobs_with_events()? {
            self.verify_chain(Log::Job(job), &mut findings, |_| {})?;
        }
        self.verify_values(&told, &mut findings)?;
        self.verify_job_ends(&told, &mut findings)?;
        self.verify_records(&told, &mut findings)?;
        self.verify_retention(&told.retention, &mut findings)?;
        Ok(findings)
    }

    fn verify_chain(&self, log: Log, findings: &mut Vec<Finding>, mut hear: impl FnMut(&Event)) -> Result<(), StoreError> {
        let mut end = Chain::default();
        loop {
            let events = match self.events(log, end.sequence + 1, WINDOW) {
                Ok(events) => events,
                Err(StoreError::BadEvent { sequence, what, .. }) => {
                    findings.push(finding(log, format!("event {sequence} is not readable: {what}")));
                    return Ok(());
                }
                Err(other) => return Err(other),
            };
            for event in &events {
                if let Err(broken) = end.follow(event) {
                    findings.push(finding(log, broken));
                    return Ok(());
                }
                hear(event);
            }
            if events.len() < WINDOW {
                return Ok(());
            }
        }
    }

    fn verify_values(&self, told: &Told, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let kept = || -> rusqlite::Result<Vec<(String, f64, i64)>> {
            let mut statement = self
                .database
                .prepare("SELECT path, value, event FROM registers ORDER BY path")?;
            statement
                .query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?
                .collect()
        };
        let kept = kept().map_err(self.failed())?;
        let paths: BTreeSet<&str> = kept.iter().map(|(path, ..)| path.as_str()).collect();
        for (path, value, event) in &kept {
            match told.values.get(path) {
                Some((said, by)) if said == value && *by as i64 == *event => {}
                Some((said, by)) => findings.push(finding(
                    format!("value {path}"),
                    format!("is {value} by event {event}, but its last change is to {said} by event {by}"),
                )),
                None => findings.push(finding(format!("value {path}"), format!("is {value}, but no event sets it"))),
            }
        }
        for (path, (said, by)) in &told.values {
            if !paths.contains(path.as_str()) {
                findings.push(finding(
                    format!("value {path}"),
                    format!("is gone; event {by} set it to {said}"),
                ));
            }
        }
        Ok(())
    }

    fn verify_job_ends(&self, told: &Told, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        for (&job, (count, hash)) in &told.ended {
            let log = Log::Job(JobId(job));
            match end_of(&self.database, log).map_err(self.failed())? {
                Ok(end) if end.sequence == *count && end.hash.to_string() == *hash => {}
                Ok(end) => findings.push(finding(
                    log,
                    format!(
                        "has {} events with another end than the {count} it had when the job ended",
                        end.sequence
                    ),
                )),
                // Told by the check of the chain itself.
                Err(_) => {}
            }
        }
        Ok(())
    }

    fn verify_records(&self, told: &Told, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let rows = || -> rusqlite::Result<Vec<BTreeMap<String, Value>>> {
            let mut statement = self.database.prepare("SELECT * FROM records ORDER BY sequence")?;
            statement.query_map([], catalogue::detail_of)?.collect()
        };
        let rows = rows().map_err(self.failed())?;
        for n in 0..rows.len().max(told.records.len()) {
            let what = format!("catalogue row {}", n + 1);
            match (rows.get(n), told.records.get(n)) {
                (Some(row), Some(said)) if row == said => {}
                (Some(_), Some(_)) => findings.push(finding(what, "is not the row that was put in")),
                (Some(_), None) => findings.push(finding(what, "was never put in by the log")),
                (None, _) => findings.push(finding(what, "is gone")),
            }
        }
        // A later run may write the same path again (`run --out DIR` twice): the newest row of a path speaks for it.
        let newest: BTreeMap<String, (i64, &Value)> = rows
            .iter()
            .filter_map(|row| Some((row["path"].as_str()?.to_owned(), (row["sequence"].as_i64()?, &row["sha256"]))))
            .collect();
        for (text, (sequence, said)) in &newest {
            let path = self.path_from_text(text);
            let what = format!("record {}", path.display());
            if told.retention.is_removed(*sequence) && !path.exists() {
                continue;
            }
            match whole_file::hash_of_file(&path) {
                Ok(hash) if said.as_str() == Some(hash.to_string().as_str()) => {}
                Ok(_) => findings.push(finding(what, "its content is not what was recorded")),
                Err(e) => findings.push(finding(what, e)),
            }
        }
        for path in files_below(&self.root().join("records")) {
            let text = self.path_to_text(&path)?;
            if !newest.contains_key(&text) {
                findings.push(finding(
                    format!("record {}", path.display()),
                    "is not in the catalogue: its job was interrupted while it was written, or it was put here by hand",
                ));
            }
        }
        Ok(())
    }

    fn jobs_with_events(&self) -> Result<Vec<JobId>, StoreError> {
        let all = || -> rusqlite::Result<Vec<JobId>> {
            let mut statement = self
                .database
                .prepare("SELECT DISTINCT log FROM events WHERE log <> 0 ORDER BY log")?;
            statement.query_map([], |row| row.get(0).map(JobId))?.collect()
        };
        all().map_err(self.failed())
    }
}

impl Told {
    fn hear(&mut self, event: &Event) {
        let detail = &event.detail;
        let text = |name: &str| detail.get(name).and_then(Value::as_str);
        self.retention.hear(event);
        match event.kind.as_str() {
            "change" => {
                if let (Some(path), Some(after)) = (text("path"), detail.get("after").and_then(Value::as_f64)) {
                    self.values.insert(path.to_owned(), (after, event.sequence));
                }
            }
            "record-catalogued" => self.records.push(detail.clone()),
            "job-ended" => {
                let number = |name: &str| detail.get(name).and_then(Value::as_i64);
                if let (Some(job), Some(count), Some(hash)) = (number("job"), number("events"), text("last_hash")) {
                    self.ended.insert(job, (count.unsigned_abs(), hash.to_owned()));
                }
            }
            _ => {}
        }
    }
}

pub(crate) fn finding(what: impl std::fmt::Display, problem: impl std::fmt::Display) -> Finding {
    Finding {
        what: what.to_string(),
        problem: problem.to_string(),
    }
}

pub(crate) fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                Ok(kind) if kind.is_file() => files.push(entry.path()),
                _ => {}
            }
        }
    }
    files.sort();
    files
}

//! Holds everything in a data directory against everything else: the database's pages, its tables and triggers, every row of every
//! table, every file.
//!
//! What is exempt, because it carries nothing that was recorded: free space in SQLite's pages and the counters of its head, the index of
//! its write-ahead log (`-shm`), `lock` and `server.json`, and `machine.toml`, which people edit.

use crate::directory::DATABASE;
use crate::events::end_of;
use crate::people_verified::ToldOfPeople;
use crate::retention_verified::ToldOfRetention;
use crate::sizing_verified::ToldOfSizing;
use crate::{
    DataDirectory, JobId, JobState, Log, StoreError, Table, backup, catalogue, kept, schema, segment, server_notice, whole_file,
};
use ledger::{Chain, Event, Hash};
use rusqlite::types::ValueRef;
use rusqlite::{Connection, Row};
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Something that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What: the row with its table, the file.
    pub what: String,
    /// How it differs.
    pub problem: String,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.what, self.problem)
    }
}

/// What a check of everything gave.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Verification {
    /// What is not as it was written; empty is good.
    pub findings: Vec<Finding>,
    /// What a person may want to know, and is no sign of a change: unfinished files that nothing refers to.
    pub remarks: Vec<Finding>,
    /// Events of all chains.
    pub events: u64,
    /// Jobs.
    pub jobs: u64,
    /// Process values.
    pub values: u64,
    /// Records in the catalogue.
    pub records: u64,
    /// Files held against their hash.
    pub files: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Number of the last event in the directory's chain.
    pub last_event: u64,
    /// Its hash: written down elsewhere, it shows whether the end of the chain was cut later.
    pub last_event_sha256: String,
}

/// How many events are in memory at a time.
const WINDOW: usize = 1000;

/// The tables whose every row is held against something. A table that is not here is a finding of its own: a new one belongs in here
/// with its check.
const CHECKED: &[&str] = &[
    "events",
    "holds",
    "jobs",
    "operators",
    "programs",
    "records",
    "registers",
    "removals",
    "sizing_entries",
    "sizing_jobs",
    "sqlite_sequence",
];

/// What the directory's chain says ought to be.
#[derive(Default)]
struct Told {
    values: BTreeMap<String, (f64, u64)>,
    records: Vec<BTreeMap<String, Value>>,
    started: BTreeMap<i64, (i64, BTreeMap<String, Value>)>,
    ended: BTreeMap<i64, JobEnd>,
    files: BTreeMap<String, kept::KeptFile>,
    retention: ToldOfRetention,
    sizing: ToldOfSizing,
    people: ToldOfPeople,
}

struct JobEnd {
    at_ns: i64,
    state: String,
    events: u64,
    last_hash: String,
}

/// Opens a data directory or a backup to read it and checks everything in it. A database that is too damaged to be opened is a finding.
///
/// # Errors
/// A process works in it; it is no data directory; its database is newer than this program; the disk refuses to be read at all.
pub fn verify(root: &Path, progress: impl FnMut(&str)) -> Result<Verification, StoreError> {
    match DataDirectory::read(root) {
        Ok(directory) => directory.verify_all(progress),
        Err(error @ (StoreError::Database { .. } | StoreError::NotOurs { .. })) => Ok(Verification {
            findings: vec![finding(DATABASE, error)],
            ..Verification::default()
        }),
        Err(other) => Err(other),
    }
}

impl DataDirectory {
    /// Checks everything that is kept, as [`DataDirectory::verify_all`], and gives what is wrong; an empty list is good.
    ///
    /// # Errors
    /// The disk refuses to be read at all.
    pub fn verify(&self) -> Result<Vec<Finding>, StoreError> {
        Ok(self.verify_all(|_| {})?.findings)
    }

    /// Checks everything that is kept: the database's pages, tables and triggers; every event against its chain; every process value
    /// against the event that set it; every job against the events of its beginning and its end; every catalogue row against its event;
    /// every file against its hash; a backup against its manifest.
    ///
    /// # Errors
    /// A file cannot be read at all.
    pub fn verify_all(&self, mut progress: impl FnMut(&str)) -> Result<Verification, StoreError> {
        let mut done = Verification::default();
        if let Some(problem) = &self.wal_problem {
            let said = finding(format!("{DATABASE}-wal"), &problem.text);
            // Who works here has taken the log up to where it is whole, and the event of the opening tells of what was not. Who only
            // reads cannot know whether a kill left it so or a hand.
            if self.is_held() && problem.at_the_end {
                done.remarks.push(said);
            } else {
                done.findings.push(said);
            }
        }
        progress(DATABASE);
        let mut told = Told::default();
        // SQLite says which page is damaged and then nothing more of the rows on it: what is told so far counts.
        if let Err(error) = self.verify_database(&mut told, &mut done) {
            match error {
                StoreError::Database { source, .. } => done.findings.push(finding(DATABASE, source)),
                other => return Err(other),
            }
        }
        self.verify_files(&told, &mut done, &mut progress)?;
        self.verify_manifest(&mut done, &mut progress)?;
        Ok(done)
    }

    fn verify_database(&self, told: &mut Told, done: &mut Verification) -> Result<(), StoreError> {
        self.verify_pages(&mut done.findings).map_err(self.failed())?;
        self.verify_schema(&mut done.findings).map_err(self.failed())?;
        let end = self.verify_chain(Log::Directory, done, |event| {
            told.hear(event);
            if let Some(file) = self.kept_file_of(event).filter(|_| event.kind == kept::FILE_KEPT) {
                told.files.insert(file.text.clone(), file);
            }
        })?;
        (done.last_event, done.last_event_sha256) = (end.sequence, end.hash.to_string());
        for log in self.job_logs()? {
            self.verify_chain(log, done, |_| {})?;
            if let Log::Job(job) = log
                && !told.started.contains_key(&job.0)
            {
                let what = format!("{log} (table events, log {job})");
                done.findings
                    .push(finding(what, "there is no such job in the log of the data directory"));
            }
        }
        self.verify_values(told, done)?;
        self.verify_jobs(told, done)?;
        self.verify_records(told, done)?;
        self.verify_retention(&told.retention, &mut done.findings)?;
        self.verify_sizing(&told.sizing, &mut done.findings)?;
        self.verify_people(&told.people, &mut done.findings)
    }

    /// SQLite's own check: pages, their order, indexes, types, constraints.
    fn verify_pages(&self, findings: &mut Vec<Finding>) -> rusqlite::Result<()> {
        let mut statement = self.database.prepare("PRAGMA integrity_check")?;
        let said: Vec<String> = statement.query_map([], |row| row.get(0))?.collect::<rusqlite::Result<_>>()?;
        findings.extend(said.iter().filter(|s| *s != "ok").map(|s| finding(DATABASE, s)));
        let mut statement = self.database.prepare("PRAGMA foreign_key_check")?;
        let said: Vec<(String, Option<i64>)> = statement
            .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
            .collect::<rusqlite::Result<_>>()?;
        findings.extend(said.iter().map(|(table, row)| {
            let what = format!("table {table}, row {}", row.map_or_else(String::new, |n| n.to_string()));
            finding(what, "refers to a row that is not there")
        }));
        Ok(())
    }

    /// Tables, indexes and triggers as this program makes them: a trigger that was taken away would let events be changed.
    fn verify_schema(&self, findings: &mut Vec<Finding>) -> rusqlite::Result<()> {
        let list = |connection: &Connection| -> rusqlite::Result<BTreeMap<(String, String), Option<String>>> {
            let mut statement = connection.prepare("SELECT type, name, sql FROM sqlite_schema")?;
            statement
                .query_map([], |row| Ok(((row.get(0)?, row.get(1)?), row.get(2)?)))?
                .collect()
        };
        let (expected, found) = (list(&schema::fresh()?)?, list(&self.database)?);
        for (key @ (kind, name), sql) in &expected {
            match found.get(key) {
                Some(other) if other == sql => {}
                Some(_) => findings.push(finding(format!("{kind} {name}"), "is not as this program makes it")),
                None => findings.push(finding(format!("{kind} {name}"), "is gone")),
            }
        }
        for (kind, name) in found.keys().filter(|key| !expected.contains_key(*key)) {
            findings.push(finding(format!("{kind} {name}"), "was not made by this program"));
        }
        for (kind, name) in expected.keys() {
            if kind == "table" && !CHECKED.contains(&name.as_str()) {
                findings.push(finding(format!("table {name}"), "its rows are not checked by this program"));
            }
        }
        Ok(())
    }

    /// Follows a chain to its end. Past a broken event it goes on from what stands there, so that every changed row is named.
    fn verify_chain(&self, log: Log, done: &mut Verification, mut hear: impl FnMut(&Event)) -> Result<Chain, StoreError> {
        let what = format!("{log} (table events, log {})", log.number());
        let mut end = Chain::default();
        let mut statement = self
            .database
            .prepare("SELECT * FROM events WHERE log = ?1 AND sequence > ?2 ORDER BY sequence LIMIT ?3")
            .map_err(self.failed())?;
        let mut last = i64::MIN;
        loop {
            let rows = statement
                .query_map(rusqlite::params![log.number(), last, WINDOW as i64], |row| {
                    Ok((
                        row.get::<_, i64>("sequence")?,
                        crate::events::event_of(log, row),
                        text_of(row, "detail"),
                    ))
                })
                .and_then(Iterator::collect::<rusqlite::Result<Vec<_>>>)
                .map_err(self.failed())?;
            for (sequence, event, text) in &rows {
                last = *sequence;
                done.events += 1;
                let event = match event {
                    Ok(event) => event,
                    Err(error) => {
                        let problem = match error {
                            StoreError::BadEvent { what, .. } => what.clone(),
                            other => other.to_string(),
                        };
                        done.findings
                            .push(finding(&what, format!("event {sequence} is not readable: {problem}")));
                        end.sequence = sequence.unsigned_abs();
                        continue;
                    }
                };
                match end.follow(event) {
                    // The chain is over the content; the text must be the one that was written, blank by blank.
                    Ok(()) => {
                        let written = serde_json::to_string(&event.detail).expect("a map with text keys is always JSON");
                        if text.as_deref() != Some(&written) {
                            done.findings.push(finding(
                                &what,
                                format!("event {sequence} was changed after it was written: its detail is spelt otherwise"),
                            ));
                        }
                        hear(event);
                    }
                    Err(broken) => {
                        done.findings.push(finding(&what, broken));
                        end = Chain {
                            sequence: event.sequence,
                            hash: Hash::parse(&event.hash).unwrap_or_default(),
                        };
                    }
                }
            }
            if rows.len() < WINDOW {
                return Ok(end);
            }
        }
    }

    fn verify_values(&self, told: &Told, done: &mut Verification) -> Result<(), StoreError> {
        let findings = &mut done.findings;
        let kept = || -> rusqlite::Result<Vec<(String, f64, i64)>> {
            let mut statement = self
                .database
                .prepare("SELECT path, value, event FROM registers ORDER BY path")?;
            statement
                .query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?
                .collect()
        };
        let kept = kept().map_err(self.failed())?;
        done.values = kept.len() as u64;
        let paths: BTreeSet<&str> = kept.iter().map(|(path, ..)| path.as_str()).collect();
        for (path, value, event) in &kept {
            match told.values.get(path) {
                Some((said, by)) if said == value && *by as i64 == *event => {}
                Some((said, by)) => findings.push(finding(
                    format!("value {path} (table registers)"),
                    format!("is {value} by event {event}, but its last change is to {said} by event {by}"),
                )),
                None => findings.push(finding(
                    format!("value {path} (table registers)"),
                    format!("is {value}, but no event sets it"),
                )),
            }
        }
        for (path, (said, by)) in &told.values {
            if !paths.contains(path.as_str()) {
                findings.push(finding(
                    format!("value {path} (table registers)"),
                    format!("is gone; event {by} set it to {said}"),
                ));
            }
        }
        Ok(())
    }

    fn verify_jobs(&self, told: &Told, done: &mut Verification) -> Result<(), StoreError> {
        let rows = || -> rusqlite::Result<BTreeMap<i64, BTreeMap<String, Value>>> {
            let mut statement = self.database.prepare("SELECT * FROM jobs ORDER BY id")?;
            statement
                .query_map([], |row| Ok((row.get("id")?, job_detail(row)?)))?
                .collect()
        };
        let rows = rows().map_err(self.failed())?;
        done.jobs = rows.len() as u64;
        let ids: BTreeSet<i64> = rows.keys().chain(told.started.keys()).copied().collect();
        for id in ids {
            let what = format!("job {id} (table jobs)");
            let (row, (at, said)) = match (rows.get(&id), told.started.get(&id)) {
                (Some(row), Some(said)) => (row, said),
                (Some(_), None) => {
                    done.findings.push(finding(what, "no event of the log begins it"));
                    continue;
                }
                (None, _) => {
                    done.findings.push(finding(what, "is gone"));
                    continue;
                }
            };
            // The row as the two events of the job tell it.
            let ended = told.ended.get(&id);
            let mut expected: BTreeMap<String, Value> = ["program", "program_sha256", "machine", "folder"]
                .into_iter()
                .map(|name| (name.to_owned(), said.get(name).cloned().unwrap_or_default()))
                .collect();
            let seed = said.get("seed").map(Value::to_string).unwrap_or_default();
            expected.insert("seed".to_owned(), seed.into());
            expected.insert("start_ns".to_owned(), (*at).into());
            expected.insert("end_ns".to_owned(), ended.map_or(Value::Null, |end| end.at_ns.into()));
            let state = ended.map_or(JobState::Running.word(), |end| &end.state);
            expected.insert("state".to_owned(), state.into());
            for (column, value) in &expected {
                let found = row.get(column).unwrap_or(&Value::Null);
                if found != value {
                    let problem = format!("{column} is {found}, the log says {value}");
                    done.findings.push(finding(&what, problem));
                }
            }
        }
        // SQLite's memory of the last number it gave out.
        let given: Option<i64> = self
            .database
            .query_row("SELECT max(seq) FROM sqlite_sequence WHERE name = 'jobs'", [], |row| {
                row.get(0)
            })
            .map_err(self.failed())?;
        let last = told.started.keys().last().copied();
        if given.unwrap_or(0) != last.unwrap_or(0) {
            done.findings.push(finding(
                "the last number of a job (table sqlite_sequence)",
                format!("is {}, the log says {}", given.unwrap_or(0), last.unwrap_or(0)),
            ));
        }
        self.verify_job_ends(told, &mut done.findings)
    }

    fn verify_job_ends(&self, told: &Told, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        for (&job, said) in &told.ended {
            let log = Log::Job(JobId(job));
            match end_of(&self.database, log).map_err(self.failed())? {
                Ok(end) if end.sequence == said.events && end.hash.to_string() == said.last_hash => {}
                Ok(end) => findings.push(finding(
                    format!("{log} (table events, log {job})"),
                    format!(
                        "has {} events with another end than the {} it had when the job ended",
                        end.sequence, said.events
                    ),
                )),
                // Told by the check of the chain itself.
                Err(_) => {}
            }
        }
        Ok(())
    }

    fn verify_records(&self, told: &Told, done: &mut Verification) -> Result<(), StoreError> {
        let rows = || -> rusqlite::Result<Vec<BTreeMap<String, Value>>> {
            let mut statement = self.database.prepare("SELECT * FROM records ORDER BY sequence")?;
            statement.query_map([], catalogue::detail_of)?.collect()
        };
        let rows = rows().map_err(self.failed())?;
        done.records = rows.len() as u64;
        for n in 0..rows.len().max(told.records.len()) {
            let what = format!("catalogue row {} (table records)", n + 1);
            match (rows.get(n), told.records.get(n)) {
                (Some(row), Some(said)) if row == said => {}
                (Some(_), Some(_)) => done.findings.push(finding(what, "is not the row that was put in")),
                (Some(_), None) => done.findings.push(finding(what, "was never put in by the log")),
                (None, _) => done.findings.push(finding(what, "is gone")),
            }
        }
        Ok(())
    }

    /// Every file that the log tells of against its hash, and every file that lies here against the log.
    fn verify_files(&self, told: &Told, done: &mut Verification, progress: &mut dyn FnMut(&str)) -> Result<(), StoreError> {
        // A later run may write the same path again (`run --out DIR` twice): what was told last of a path speaks for it.
        let records = told.records.iter().filter_map(|row| {
            let text = |name: &str| row.get(name).and_then(Value::as_str);
            Some((text("path")?.to_owned(), ("record", text("sha256")?.to_owned())))
        });
        let files = told.files.values().map(|f| (f.text.clone(), ("file", f.hash.to_string())));
        let newest: BTreeMap<String, (&str, String)> = files.chain(records).collect();
        let removed: BTreeSet<&str> = (1..)
            .zip(&told.records)
            .filter(|(sequence, _)| told.retention.is_removed(*sequence))
            .filter_map(|(_, row)| row.get("sha256")?.as_str())
            .collect();
        // A roll-up stands under the hash of its record; its own checks were looked at with the tables.
        let rollup = |row: &BTreeMap<String, Value>| Some(self.rollup_path_of(row.get("sha256")?.as_str()?));
        let mut known: BTreeSet<PathBuf> = told.records.iter().filter_map(rollup).collect();
        for (text, (word, said)) in &newest {
            progress(text);
            let path = self.place_of(text, said);
            if removed.contains(said.as_str()) && !path.exists() {
                continue;
            }
            let what = format!("{word} {}", path.display());
            match whole_file::hash_of_file(&path) {
                Ok(hash) if hash.to_string() == *said => {
                    done.files += 1;
                    done.bytes += path.metadata().map_or(0, |m| m.len());
                }
                Ok(_) => done.findings.push(finding(what, "its content is not what was recorded")),
                Err(StoreError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                    done.findings.push(finding(what, "is gone"));
                }
                Err(e) => done.findings.push(finding(what, e)),
            }
            known.insert(path);
        }
        let is_backup = self.root().join(backup::MANIFEST).exists();
        for path in files_below(self.root()) {
            let short = path.strip_prefix(self.root()).expect("it was found below");
            if known.contains(&path) || short.to_str().is_some_and(is_of_the_directory_itself) {
                continue;
            }
            let what = format!("file {}", path.display());
            if short.starts_with("segments") {
                self.verify_segment(&path, what, done)?;
            } else if path.extension().is_some_and(|e| e == "tmp") {
                done.remarks
                    .push(finding(what, "is unfinished and nothing refers to it; it can be removed"));
            } else if is_backup {
                // A later backup leaves what the data directory has no more; the manifest speaks for the rest.
            } else {
                done.findings.push(finding(
                    what,
                    "the log tells nothing of it: its job was interrupted while it was written, or it was put here by hand",
                ));
            }
        }
        Ok(())
    }

    /// A piece of a recording in the making. It carries its own checksums, and becomes a record of the catalogue when its job ends or
    /// the next process works here.
    fn verify_segment(&self, path: &Path, what: String, done: &mut Verification) -> Result<(), StoreError> {
        let kind = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let damage = match kind {
            "segment" => match segment::read(path) {
                Ok(found) => found
                    .lost
                    .filter(|lost| !lost.is_unfinished_write())
                    .map(|lost| lost.to_string()),
                Err(StoreError::Damaged { what, .. }) => Some(what),
                Err(other) => return Err(other),
            },
            "parquet" => match Table::open(path) {
                Ok(_) => None,
                Err(StoreError::Damaged { what, .. } | StoreError::NotARecord { what, .. }) => Some(what),
                Err(other) => return Err(other),
            },
            "lost" => {
                done.remarks.push(finding(
                    what,
                    "holds bytes that could not be read after a power loss; it can be removed",
                ));
                return Ok(());
            }
            "tmp" | "rollup" => None,
            _ => Some("the log tells nothing of it: it was put here by hand".to_owned()),
        };
        match damage {
            Some(problem) => done.findings.push(finding(what, problem)),
            None => done.remarks.push(finding(
                what,
                "belongs to a recording that was interrupted; the next command that works here makes a record of it",
            )),
        }
        Ok(())
    }

    /// A backup against its manifest: every byte of every file, the database's too.
    fn verify_manifest(&self, done: &mut Verification, progress: &mut dyn FnMut(&str)) -> Result<(), StoreError> {
        if !self.root().join(backup::MANIFEST).exists() {
            return Ok(());
        }
        let manifest = match backup::Manifest::read(self.root()) {
            Ok(manifest) => manifest,
            Err(error) => {
                done.findings.push(finding(backup::MANIFEST, error));
                return Ok(());
            }
        };
        for (path, problem) in manifest.check(self.root(), |path| progress(path))? {
            let what = format!("backup file {}", self.root().join(&path).display());
            done.findings.push(finding(what, problem));
        }
        if (manifest.last_event, &manifest.last_event_sha256) != (done.last_event, &done.last_event_sha256) {
            done.findings.push(finding(
                "the log of the data directory (table events, log 0)",
                format!(
                    "ends with event {}, the manifest says event {} with another hash",
                    done.last_event, manifest.last_event
                ),
            ));
        }
        let paths = manifest.paths();
        for path in files_below(self.root()) {
            let short = path.strip_prefix(self.root()).expect("it was found below");
            if short
                .to_str()
                .is_none_or(|p| p != backup::MANIFEST && p != backup::UNFINISHED && !paths.contains(p))
            {
                let what = format!("file {}", path.display());
                done.remarks.push(finding(
                    what,
                    "is not in the manifest: an earlier backup left it, or it was put here by hand",
                ));
            }
        }
        Ok(())
    }

    fn job_logs(&self) -> Result<Vec<Log>, StoreError> {
        let all = || -> rusqlite::Result<Vec<Log>> {
            let mut statement = self
                .database
                .prepare("SELECT DISTINCT log FROM events WHERE log <> 0 ORDER BY log")?;
            statement
                .query_map([], |row| row.get(0).map(|n| Log::Job(JobId(n))))?
                .collect()
        };
        all().map_err(self.failed())
    }
}

/// A job's row by column, in the form in which its events tell it.
fn job_detail(row: &Row<'_>) -> rusqlite::Result<BTreeMap<String, Value>> {
    let mut detail = BTreeMap::new();
    for name in ["program", "program_sha256", "machine", "seed", "state", "folder"] {
        detail.insert(name.to_owned(), Value::from(row.get::<_, String>(name)?));
    }
    for name in ["start_ns", "end_ns"] {
        let number: Option<i64> = row.get(name)?;
        detail.insert(name.to_owned(), number.map_or(Value::Null, Value::from));
    }
    Ok(detail)
}

fn text_of(row: &Row<'_>, column: &str) -> Option<String> {
    match row.get_ref(column) {
        Ok(ValueRef::Text(bytes)) => String::from_utf8(bytes.to_vec()).ok(),
        _ => None,
    }
}

/// Files that are not told of one by one: the database, which is checked by itself, the lock and its notice, the marks of a backup, and
/// the machine file, which people edit.
pub(crate) fn is_of_the_directory_itself(path: &str) -> bool {
    let database = path
        .strip_prefix(DATABASE)
        .is_some_and(|rest| ["", "-wal", "-shm", "-journal"].contains(&rest));
    let others = [
        "lock",
        server_notice::FILE,
        "machine.toml",
        backup::MANIFEST,
        backup::UNFINISHED,
        backup::RESTORING,
    ];
    database || others.contains(&path)
}

impl Told {
    fn hear(&mut self, event: &Event) {
        let detail = &event.detail;
        let text = |name: &str| detail.get(name).and_then(Value::as_str);
        self.retention.hear(event);
        self.sizing.hear(event);
        self.people.hear(event);
        match event.kind.as_str() {
            "change" => {
                if let (Some(path), Some(after)) = (text("path"), detail.get("after").and_then(Value::as_f64)) {
                    self.values.insert(path.to_owned(), (after, event.sequence));
                }
            }
            "job-started" => {
                if let Some(job) = detail.get("job").and_then(Value::as_i64) {
                    self.started.insert(job, (event.at_ns, detail.clone()));
                }
            }
            "record-catalogued" => self.records.push(detail.clone()),
            "job-ended" => {
                let number = |name: &str| detail.get(name).and_then(Value::as_i64);
                if let (Some(job), Some(count), Some(hash)) = (number("job"), number("events"), text("last_hash")) {
                    let end = JobEnd {
                        at_ns: event.at_ns,
                        state: text("state").unwrap_or_default().to_owned(),
                        events: count.unsigned_abs(),
                        last_hash: hash.to_owned(),
                    };
                    self.ended.insert(job, end);
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

/// Every file below a folder, in order.
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

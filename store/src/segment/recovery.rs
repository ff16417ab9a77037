//! Recordings in the data directory: where they are made, how they become records of the catalogue, and what is done with those that a
//! killed process left.
//!
//! ```text
//! segments/job-000007/0001.parquet  0002.segment     a recording in the making
//! segments/lost/job-000007-0002.segment.lost         bytes that could not be read, kept for a person to look at
//! ```

use super::compact::{self, Merged};
use super::gap::Gap;
use super::reader::{cut, read};
use crate::record::{Finished, Reader, schema::key};
use crate::{DataDirectory, Job, JobId, JobState, Log, RecoveredValues, StoreError, whole_file};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// What became of a recording that a dead process left.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recovery {
    /// The record that was made of it; `None` when nothing of it was readable.
    pub record: Option<PathBuf>,
    /// Records before it, of a recording in several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub earlier: Vec<PathBuf>,
    /// Its rows; of a recording in several records, those of all.
    pub rows: u64,
    /// Time of the last one, microseconds UTC.
    pub last_us: Option<i64>,
    /// Rows that were lost while it was made.
    pub gaps: Vec<Gap>,
    /// What could not be read, by segment.
    pub lost: Vec<String>,
    /// Where the bytes are that could not be read.
    pub aside: Vec<PathBuf>,
    /// What the functions of its program had recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<RecoveredValues>,
}

impl fmt::Display for Recovery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.record, self.last_us) {
            (Some(record), Some(last)) => {
                let last = jiff::Timestamp::from_microsecond(last).map_or_else(|_| format!("{last} us"), |t| t.to_string());
                write!(
                    f,
                    "{} rows up to {last} were on disk and are kept as {}",
                    self.rows,
                    record.display()
                )?;
                if !self.earlier.is_empty() {
                    write!(f, " and {} records before it", self.earlier.len())?;
                }
            }
            (Some(record), None) => write!(f, "no row of it was on disk; {} is its empty record", record.display())?,
            (None, _) if self.lost.is_empty() => write!(f, "its recording had not begun on disk")?,
            (None, _) => write!(f, "nothing of its recording is readable")?,
        }
        self.gaps.iter().try_for_each(|gap| write!(f, "; {gap}"))?;
        self.lost.iter().try_for_each(|lost| write!(f, "; {lost}"))?;
        if let Some(values) = &self.values {
            match &values.file {
                Some(file) => write!(f, "; {} values of its functions are kept as {}", values.rows, file.display())?,
                None => write!(f, "; no value of its functions was on disk")?,
            }
            values.lost.iter().try_for_each(|lost| write!(f, "; {lost}"))?;
        }
        self.aside
            .iter()
            .try_for_each(|path| write!(f, " (kept as {})", path.display()))
    }
}

impl DataDirectory {
    /// Where recordings are in the making.
    pub fn segments(&self) -> PathBuf {
        self.root().join("segments")
    }

    /// Where the recording of a job is in the making.
    pub fn recording_folder(&self, job: JobId) -> PathBuf {
        self.segments().join(format!("job-{:06}", job.0))
    }

    /// Ends the recording of a job as a record: one Parquet file at `target` with the events of the job, its catalogue row, and then the
    /// segments go. Killed anywhere, [`DataDirectory::recover`] does the rest.
    ///
    /// # Errors
    /// The disk refuses. Nothing is lost then: the segments are removed last.
    pub fn keep_recording(
        &mut self,
        job: JobId,
        target: &Path,
        events: &[ledger::Event],
        at: Timestamp,
    ) -> Result<Merged, StoreError> {
        let folder = self.recording_folder(job);
        let merged = compact::merge(&folder, target, events, &[])?;
        self.catalogue(job, &merged.finished, at)?;
        compact::discard(&folder)?;
        Ok(merged)
    }

    /// Jobs of other processes that left a recording: interrupted, or failed before it could be kept.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn left_recordings(&self) -> Result<Vec<JobId>, StoreError> {
        let jobs = self.jobs()?.into_iter();
        Ok(jobs
            .map(|job| job.id)
            .filter(|job| !self.begun.contains(job) && self.recording_folder(*job).is_dir())
            .collect())
    }

    /// Makes a record of what a dead process left of a job's recording: cuts it at the first bad frame (what is cut off is kept aside),
    /// compacts what is whole, catalogues it with an event that says what was lost, removes the segments. Done already, or killed on the
    /// way, it gives the same. `None` when the job left no recording.
    ///
    /// # Errors
    /// The disk refuses, or the job runs in this process. The recording is as it was then, and the next call goes on.
    pub fn recover(&mut self, job: JobId) -> Result<Option<Recovery>, StoreError> {
        let folder = self.recording_folder(job);
        if self.begun.contains(&job) || !folder.is_dir() {
            return Ok(None);
        }
        let job = self.job(job)?;
        // First of all: they stand in the recording's folder, which goes at the end.
        let values = self.recover_values(&job)?;
        let mut recovery = if self.recorded_by(job.id)?.is_some() {
            self.recover_parts(&job, &folder)?
        } else {
            match self.kept_record(&job)? {
                Some(recovery) => recovery,
                None => self.recover_from(&job, &folder)?,
            }
        };
        recovery.aside = self.keep_aside(&folder, &format!("job-{:06}", job.id.0))?;
        if values.is_some() {
            let of_values = self.keep_aside(&self.values_folder(job.id), &format!("job-{:06}-functions", job.id.0))?;
            recovery.aside.extend(of_values);
        }
        recovery.values = values;
        compact::discard(&folder)?;
        Ok(Some(recovery))
    }

    /// The job's record, when it was catalogued before the process died.
    fn kept_record(&self, job: &Job) -> Result<Option<Recovery>, StoreError> {
        let row = self.records()?.into_iter().rev().find(|row| row.job == job.id);
        let row = row.filter(|row| whole_file::hash_of_file(&row.path).is_ok_and(|hash| hash == row.hash));
        Ok(row.map(|row| Recovery {
            record: Some(row.path),
            rows: row.rows,
            last_us: row.span_us.map(|(_, last)| last),
            ..Recovery::default()
        }))
    }

    /// The job's record file, when the process died between its last byte and its catalogue row: all of the recording is in it.
    fn finished_record(&self, job: &Job) -> Result<Option<(Finished, Vec<Gap>)>, StoreError> {
        // The folder may be one that an earlier run of the same program wrote to.
        let path = job.folder.join("record.parquet");
        let Ok(reader) = Reader::open(&path) else {
            return Ok(None);
        };
        let header = reader.header();
        let of_the_job = (&header.machine, header.start, header.seed) == (&job.machine, job.start, job.seed);
        let hash = reader.hash()?;
        if !of_the_job || self.records()?.iter().any(|row| row.hash == hash) {
            return Ok(None);
        }
        let gaps = reader.metadata().get(key::GAPS).map_or("[]", String::as_str);
        match serde_json::from_str(gaps) {
            Ok(gaps) => Ok(Some((reader.finished()?, gaps))),
            Err(_) => Ok(None),
        }
    }

    fn recover_from(&mut self, job: &Job, folder: &Path) -> Result<Recovery, StoreError> {
        // A process that was killed before its recording had a head leaves a folder with nothing in it.
        let events = self.events(Log::Job(job.id), 1, usize::MAX)?;
        let target = self.record_path(&job.machine, job.start, job.id);
        let why = match job.state {
            JobState::Running => "interrupted",
            JobState::Over(ending) => JobState::Over(ending).word(),
        };
        let (record, gaps, lost) = match self.finished_record(job)? {
            Some((finished, gaps)) => (Some(finished), gaps, Vec::new()),
            None => match compact::merge(folder, &target, &events, &[("toolmark.recovered", why.to_owned())]) {
                Ok(merged) => (Some(merged.finished), merged.gaps, merged.lost),
                Err(StoreError::Damaged { .. }) => (None, Vec::new(), unreadable(folder)?),
                Err(other) => return Err(other),
            },
        };
        let lost: Vec<String> = lost
            .iter()
            .map(|(path, what)| format!("{}: {what}", path.file_name().unwrap_or_default().to_string_lossy()))
            .collect();
        let last_us = record.as_ref().and_then(|r| r.span_us).map(|(_, last)| last);
        let recovery = Recovery {
            rows: record.as_ref().map_or(0, |r| r.rows),
            last_us,
            gaps,
            lost,
            aside: Vec::new(),
            values: None,
            earlier: Vec::new(),
            record: record.as_ref().map(|r| r.path.clone()),
        };
        let at = last_us.and_then(|us| us.checked_mul(1000)).map_or(job.start, Timestamp);
        let detail = self.recovery_detail(job, &recovery)?;
        match &record {
            Some(record) => drop(self.catalogue_with(job.id, record, at, Some(("recording-recovered", detail)))?),
            None => drop(self.append(at, "recording-recovered", detail)?),
        }
        Ok(recovery)
    }

    pub(crate) fn recovery_detail(&self, job: &Job, recovery: &Recovery) -> Result<BTreeMap<String, Value>, StoreError> {
        let record = recovery.record.as_deref().map(|path| self.path_to_text(path)).transpose()?;
        Ok(BTreeMap::from([
            ("job".to_owned(), Value::from(job.id.0)),
            ("record".to_owned(), record.map_or(Value::Null, Value::from)),
            ("rows".to_owned(), Value::from(recovery.rows)),
            ("last_us".to_owned(), recovery.last_us.map_or(Value::Null, Value::from)),
            (
                "gaps".to_owned(),
                serde_json::to_value(&recovery.gaps).expect("numbers and words are always JSON"),
            ),
            ("lost".to_owned(), Value::from(recovery.lost.clone())),
        ]))
    }

    /// Copies what cannot be read of the segments to `segments/lost/`.
    fn keep_aside(&self, folder: &Path, called: &str) -> Result<Vec<PathBuf>, StoreError> {
        let place = self.segments().join("lost");
        let mut kept = Vec::new();
        for path in compact::paths(folder)? {
            let name = format!("{called}-{}", path.file_name().unwrap_or_default().to_string_lossy());
            let from = match read(&path) {
                _ if path.extension().is_some_and(|e| e != "segment") => continue,
                Ok(found) => match cut(&found)? {
                    Some(aside) => aside,
                    None => continue,
                },
                // The head is damaged: all of it goes aside, unless there is nothing in it.
                Err(StoreError::Damaged { .. }) if holds_something(&path)? => path,
                Err(StoreError::Damaged { .. }) => continue,
                Err(other) => return Err(other),
            };
            std::fs::create_dir_all(&place).map_err(StoreError::io("create", &place))?;
            let to = place.join(format!("{}.lost", name.trim_end_matches(".lost")));
            std::fs::rename(&from, &to).map_err(StoreError::io("rename", &from))?;
            whole_file::sync_folder_of(&to)?;
            kept.push(to);
        }
        Ok(kept)
    }
}

fn unreadable(folder: &Path) -> Result<Vec<(PathBuf, String)>, StoreError> {
    let mut found = Vec::new();
    for path in compact::paths(folder)? {
        if let Err(what) = compact::Part::open_either(&path)? {
            found.push((path, what));
        }
    }
    Ok(found)
}

fn holds_something(path: &Path) -> Result<bool, StoreError> {
    let bytes = std::fs::read(path).map_err(StoreError::io("read", path))?;
    Ok(bytes.iter().any(|b| *b != 0))
}

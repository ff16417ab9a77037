//! Values of the functions of a program in the data directory: where they are made, how they become a file of their job, and what a
//! killed process left of them.
//!
//! ```text
//! segments/job-000007/functions/0001.segment                    values in the making, beside the job's recording
//! records/sim-mill/2026-11-20/job-000007.functions.parquet      values of a killed job
//! ```
//!
//! A run that ends keeps them in its own folder. Those of a killed run go beside its recovered record: the folder may hold the files of an
//! earlier run of the same program, which are evidence.

use crate::functions::FILE;
use crate::segment::{Merged, compact};
use crate::{DataDirectory, Job, JobId, StoreError, whole_file};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// What became of the values that the functions of a killed job had recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecoveredValues {
    /// Their file; `None` when nothing of them was readable.
    pub file: Option<PathBuf>,
    /// How many they are.
    pub rows: u64,
    /// Gaps, and what could not be read.
    pub lost: Vec<String>,
}

impl DataDirectory {
    /// Where the values of a job's functions are in the making.
    pub fn values_folder(&self, job: JobId) -> PathBuf {
        self.recording_folder(job).join("functions")
    }

    /// Ends the values of a job as a file at `target`, told in the log; `None` when nothing was recorded. Killed anywhere,
    /// [`DataDirectory::recover`] does the rest.
    ///
    /// # Errors
    /// The disk refuses. Nothing is lost then: the segments are removed last.
    pub fn keep_values(&mut self, job: JobId, target: &Path, at: Timestamp) -> Result<Option<Merged>, StoreError> {
        let folder = self.values_folder(job);
        if !folder.is_dir() {
            return Ok(None);
        }
        let merged = compact::merge(&folder, target, &[], &[])?;
        self.keep_files(job, &[target.to_owned()], at)?;
        compact::discard(&folder)?;
        Ok(Some(merged))
    }

    /// The file with the values of a job's functions, as the log tells of it; `None` when there are none, or a later job wrote its own
    /// over them.
    ///
    /// # Errors
    /// The log cannot be read.
    pub fn values_of(&self, job: JobId) -> Result<Option<PathBuf>, StoreError> {
        let is_of_values = |path: &Path| path.to_string_lossy().ends_with(FILE);
        let mut kept = self.kept_files()?.into_iter();
        Ok(kept
            .find(|file| file.job == Some(job) && is_of_values(&file.path))
            .map(|file| file.path))
    }

    /// Makes a file of the values that a dead process left of a job. Done already, or killed on the way, it gives the same; `None` when
    /// the job left none. Its segments stay for [`DataDirectory::recover`] to look at.
    pub(crate) fn recover_values(&mut self, job: &Job) -> Result<Option<RecoveredValues>, StoreError> {
        let folder = self.values_folder(job.id);
        if !folder.is_dir() || compact::paths(&folder)?.is_empty() {
            return Ok(None);
        }
        // Killed behind `keep_values`: all of them are in a file that the log tells of.
        if let Some(kept) = self.kept_files()?.into_iter().find(|file| {
            file.job == Some(job.id)
                && file.path.to_string_lossy().ends_with(FILE)
                && whole_file::hash_of_file(&file.path).is_ok_and(|hash| hash == file.hash)
        }) {
            let mut rows = 0;
            crate::functions::read(&kept.path, &mut |_| rows += 1)?;
            let (file, lost) = (Some(kept.path), vec![]);
            return Ok(Some(RecoveredValues { file, rows, lost }));
        }
        let target = self.record_path(&job.machine, job.start, job.id).with_extension(FILE);
        let mut found = RecoveredValues {
            file: None,
            rows: 0,
            lost: vec![],
        };
        let mut at = job.start;
        match compact::merge(&folder, &target, &[], &[("toolmark.recovered", "interrupted".to_owned())]) {
            Ok(merged) => {
                found.rows = merged.finished.rows;
                found.lost.extend(merged.gaps.iter().map(ToString::to_string));
                found.lost.extend(
                    merged
                        .lost
                        .iter()
                        .map(|(path, what)| format!("{}: {what}", path.file_name().unwrap_or_default().to_string_lossy())),
                );
                let last = merged.finished.span_us.and_then(|(_, last)| last.checked_mul(1000));
                at = last.map_or(at, |ns| at.max(Timestamp(ns)));
                self.keep_files(job.id, std::slice::from_ref(&target), at)?;
                found.file = Some(target);
            }
            // Killed before the first frame: there is no value in it, and what else it holds goes aside.
            Err(StoreError::Damaged { what, .. }) => found.lost.push(what),
            Err(other) => return Err(other),
        }
        let file = found.file.as_deref().map(|path| self.path_to_text(path)).transpose()?;
        let detail = BTreeMap::from([
            ("job".to_owned(), Value::from(job.id.0)),
            ("file".to_owned(), file.map_or(Value::Null, Value::from)),
            ("rows".to_owned(), Value::from(found.rows)),
            ("lost".to_owned(), Value::from(found.lost.clone())),
        ]);
        self.append(at, "values-recovered", detail)?;
        Ok(Some(found))
    }
}

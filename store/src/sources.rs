//! Where the rows of a machine or of a job lie: record files with their roll-ups, in the order of time.

use crate::catalogue::CatalogueRow;
use crate::rollup::{self, Rollup};
use crate::{DataDirectory, JobId, StoreError};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// Whose rows are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of<'a> {
    /// All of a machine, whatever the job.
    Machine(&'a str),
    /// Those of one job.
    Job(JobId),
}

/// From a moment, up to but without another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The first moment that is inside.
    pub from: Timestamp,
    /// The first moment that is not inside any more.
    pub to: Timestamp,
}

impl Span {
    /// Everything that records can hold.
    pub const ALL: Span = Span {
        from: Timestamp(i64::MIN),
        to: Timestamp(i64::MAX),
    };

    /// The same in the microseconds of records.
    pub(crate) fn micros(self) -> (i64, i64) {
        // A row at a whole microsecond is inside from the first microsecond that is not before.
        let up = |at: Timestamp| at.0.div_euclid(1000) + i64::from(at.0.rem_euclid(1000) > 0);
        (up(self.from), up(self.to))
    }
}

/// The rows of one record file.
pub(crate) struct Source {
    pub rollup: Rollup,
    pub raw: Raw,
}

/// Where the rows themselves are.
pub(crate) enum Raw {
    /// In a record file.
    File(PathBuf),
    /// Nowhere: retention removed them, or a later run wrote over the file.
    Gone,
}

impl Source {
    /// Time of its first and last row.
    pub(crate) fn span_us(&self) -> (i64, i64) {
        self.rollup.span_us().expect("sources without rows are left out")
    }
}

impl DataDirectory {
    /// Does `work` over everything that has rows in a span. A roll-up that is not there or is damaged is made anew when its record is
    /// still there.
    pub(crate) fn with_sources<T>(
        &self,
        of: Of<'_>,
        (from_us, to_us): (i64, i64),
        mut work: impl FnMut(&[Source]) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let mut mended = BTreeSet::new();
        loop {
            let sources = self.sources(of, from_us, to_us)?;
            let done = work(&sources);
            match done {
                Err(StoreError::DamagedRollup { path, what }) => {
                    let source = sources.iter().find(|s| s.rollup.path() == path);
                    match source.map(|s| (s.rollup.record(), &s.raw)) {
                        Some((Some(hash), Raw::File(record))) if mended.insert(path.clone()) => {
                            rollup::build(record, hash, &path)?;
                        }
                        _ => return Err(StoreError::DamagedRollup { path, what }),
                    }
                }
                done => return done,
            }
        }
    }

    pub(crate) fn sources(&self, of: Of<'_>, from_us: i64, to_us: i64) -> Result<Vec<Source>, StoreError> {
        let mut sources = Vec::new();
        for row in self.records_with_rows(of, from_us, to_us)? {
            let raw = if self.is_raw_gone(&row)? {
                Raw::Gone
            } else {
                Raw::File(row.path.clone())
            };
            if let Some(rollup) = self.rollup_of(&row, &raw)? {
                sources.push(Source { rollup, raw });
            }
        }
        Ok(sources)
    }

    /// Where the roll-up of a record stands: by the hash of the record, so that it belongs to that content whatever becomes of the name.
    pub fn rollup_path(&self, record: &CatalogueRow) -> PathBuf {
        self.root().join("rollups").join(format!("{}.rollup", record.hash))
    }

    /// Makes the roll-up of a catalogued record, unless it is there and whole. `None` for a record without rows or of another layout,
    /// which has none.
    ///
    /// # Errors
    /// The record cannot be read, or the disk refuses.
    pub fn roll_up(&self, record: &CatalogueRow) -> Result<Option<PathBuf>, StoreError> {
        let raw = if self.is_raw_gone(record)? {
            Raw::Gone
        } else {
            Raw::File(record.path.clone())
        };
        let Some(rollup) = self.rollup_of(record, &raw)? else {
            return Ok(None);
        };
        match (rollup.check(), &raw) {
            (Ok(()), _) => {}
            (Err(StoreError::DamagedRollup { .. }), Raw::File(path)) => {
                rollup::build(path, record.hash, rollup.path())?;
            }
            (Err(error), _) => return Err(error),
        }
        Ok(Some(rollup.path().to_owned()))
    }

    fn rollup_of(&self, record: &CatalogueRow, raw: &Raw) -> Result<Option<Rollup>, StoreError> {
        if record.rows == 0 {
            return Ok(None);
        }
        let path = self.rollup_path(record);
        let open = |path: &Path| -> Result<Rollup, StoreError> {
            let rollup = Rollup::open(path)?;
            if rollup.record() == Some(record.hash) {
                Ok(rollup)
            } else {
                Err(rollup.damaged("it is of another record"))
            }
        };
        match (open(&path), raw) {
            (Ok(rollup), _) => Ok(Some(rollup)),
            (Err(error), Raw::File(raw)) if is_mendable(&error) => match rollup::build(raw, record.hash, &path) {
                Ok(_) => open(&path).map(Some),
                Err(StoreError::NotARecord { .. }) => Ok(None),
                Err(error) => Err(error),
            },
            (Err(error), _) => Err(error),
        }
    }
}

/// True when a roll-up is not there or not whole.
fn is_mendable(error: &StoreError) -> bool {
    match error {
        StoreError::DamagedRollup { .. } => true,
        StoreError::Io { source, .. } => source.kind() == std::io::ErrorKind::NotFound,
        _ => false,
    }
}

//! Where the rows of a machine or of a job lie, in the order of time: catalogued record files with their roll-ups, and the parts of
//! recordings that are still in the making. A recording whose record is in the catalogue is read from there, so that no row comes twice
//! while its parts are being removed.

use crate::catalogue::CatalogueRow;
use crate::record::{Column, Pages, columns_of};
use crate::rollup::{self, Rollup};
use crate::{DataDirectory, JobId, StoreError, segment, whole_file};
use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;
use rusqlite::OptionalExtension;
use std::collections::BTreeSet;
use std::ops::Range;
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

/// The rows of one file.
pub(crate) struct Source {
    pub rollup: Rollup,
    pub raw: Raw,
}

/// Where the rows themselves are.
pub(crate) enum Raw {
    /// In a record file.
    File(PathBuf),
    /// In a segment that is still written to, or was a moment ago.
    Segment(PathBuf),
    /// Nowhere: retention removed them, or a later run wrote over the file.
    Gone,
}

/// A file whose rows are being read.
pub(crate) enum OpenRaw {
    Pages(Pages),
    Segment(Box<segment::Recovered>, Vec<Column>),
}

/// Rows, some thousand at a time.
pub(crate) type Batches = Box<dyn Iterator<Item = Result<RecordBatch, StoreError>>>;

impl Raw {
    /// Opens the file; `None` when there is none.
    pub(crate) fn open(&self) -> Result<Option<OpenRaw>, StoreError> {
        Ok(match self {
            Raw::Gone => None,
            Raw::File(path) => Some(OpenRaw::Pages(Pages::open(path)?)),
            // Compacted meanwhile: the same rows at the same places.
            Raw::Segment(path) if !path.exists() => Some(OpenRaw::Pages(Pages::open(&path.with_extension("parquet"))?)),
            Raw::Segment(path) => {
                let found = segment::read(path)?;
                let columns = columns_of(&found.schema).map_err(|what| StoreError::NotARecord {
                    path: path.clone(),
                    what,
                })?;
                Some(OpenRaw::Segment(Box::new(found), columns))
            }
        })
    }
}

impl OpenRaw {
    pub(crate) fn path(&self) -> &Path {
        match self {
            OpenRaw::Pages(pages) => pages.path(),
            OpenRaw::Segment(found, _) => &found.path,
        }
    }

    /// The columns of readings.
    pub(crate) fn columns(&self) -> &[Column] {
        match self {
            OpenRaw::Pages(pages) => pages.columns(),
            OpenRaw::Segment(_, columns) => columns,
        }
    }

    /// All columns, as Arrow has them.
    pub(crate) fn schema(&self) -> &SchemaRef {
        match self {
            OpenRaw::Pages(pages) => pages.schema(),
            OpenRaw::Segment(found, _) => &found.schema,
        }
    }

    /// Rows among which are all with a time in `from_us..to_us`.
    pub(crate) fn rows_near(&self, from_us: i64, to_us: i64) -> Range<u64> {
        match self {
            OpenRaw::Pages(pages) => pages.rows_near(from_us, to_us),
            OpenRaw::Segment(found, _) => 0..found.rows,
        }
    }

    /// Rows by place, with the columns that are named, or more.
    pub(crate) fn read(&self, rows: Range<u64>, names: &[&str]) -> Result<Batches, StoreError> {
        match self {
            OpenRaw::Pages(pages) => Ok(Box::new(pages.read(rows, names)?)),
            OpenRaw::Segment(found, _) => {
                let (mut batches, mut at) = (found.batches()?, 0);
                Ok(Box::new(std::iter::from_fn(move || {
                    while at < rows.end {
                        let batch = match batches.next()? {
                            Ok(batch) => batch,
                            Err(error) => return Some(Err(error)),
                        };
                        let end = at + batch.num_rows() as u64;
                        let (from, to) = (rows.start.clamp(at, end), rows.end.clamp(at, end));
                        let part = batch.slice((from - at) as usize, (to - from) as usize);
                        at = end;
                        if part.num_rows() > 0 {
                            return Some(Ok(part));
                        }
                    }
                    None
                })))
            }
        }
    }
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
        for job in self.jobs_in_the_making(of)? {
            sources.extend(self.parts_of(job)?.into_iter().filter(|part| {
                let (first, last) = part.span_us();
                last >= from_us && first < to_us
            }));
        }
        sources.sort_by_key(|source| source.span_us().0);
        Ok(sources)
    }

    /// From the first row to the last one that there is; `None` without rows.
    ///
    /// # Errors
    /// The disk refuses, or a file is damaged.
    pub fn extent(&self, of: Of<'_>) -> Result<Option<Span>, StoreError> {
        let records = self.records_with_rows(of, i64::MIN, i64::MAX)?;
        let mut spans: Vec<(i64, i64)> = records.iter().filter_map(|record| record.span_us).collect();
        for job in self.jobs_in_the_making(of)? {
            spans.extend(self.parts_of(job)?.iter().map(Source::span_us));
        }
        let at = |us: i64| Timestamp(us.saturating_mul(1000));
        let first = spans.iter().map(|s| s.0).min();
        let last = spans.iter().map(|s| s.1).max();
        Ok(first.zip(last).map(|(first, last)| Span {
            from: at(first),
            to: at(last.saturating_add(1)),
        }))
    }

    /// Jobs with a recording that is no catalogued record yet.
    fn jobs_in_the_making(&self, of: Of<'_>) -> Result<Vec<JobId>, StoreError> {
        let mut jobs = match of {
            Of::Job(job) => vec![self.job(job)?],
            Of::Machine(machine) => self.jobs()?.into_iter().filter(|job| job.machine == machine).collect(),
        };
        jobs.retain(|job| self.recording_folder(job.id).is_dir());
        let mut open = Vec::new();
        for job in jobs {
            if self.records_with_rows(Of::Job(job.id), i64::MIN, i64::MAX)?.is_empty() {
                open.push(job.id);
            }
        }
        Ok(open)
    }

    /// The parts of a recording in the making. A table of observations has none: its rows are no samples.
    fn parts_of(&self, job: JobId) -> Result<Vec<Source>, StoreError> {
        let mut parts = Vec::new();
        for path in segment::paths(&self.recording_folder(job))? {
            let made = if path.extension().is_some_and(|e| e == "parquet") {
                let at = path.with_extension("rollup");
                let rollup = match Rollup::open(&at) {
                    Err(error) if is_mendable(&error) => {
                        rollup::build(&path, whole_file::hash_of_file(&path)?, &at).and_then(|_| Rollup::open(&at))
                    }
                    opened => opened,
                };
                rollup.map(|rollup| Source {
                    rollup,
                    raw: Raw::File(path),
                })
            } else {
                rollup::of_segment(&path).map(|rollup| Source {
                    rollup,
                    raw: Raw::Segment(path),
                })
            };
            match made {
                Ok(part) if part.rollup.rows() > 0 => parts.push(part),
                Ok(_) | Err(StoreError::NotARecord { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(parts)
    }

    /// Where the roll-up of a record stands: by the hash of the record, so that it belongs to that content whatever becomes of the name.
    pub fn rollup_path(&self, record: &CatalogueRow) -> PathBuf {
        self.rollup_path_of(&record.hash.to_string())
    }

    pub(crate) fn rollup_path_of(&self, hash: &str) -> PathBuf {
        self.root().join("rollups").join(format!("{hash}.rollup"))
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
            // It had none when its rows were removed.
            (Err(error), Raw::Gone) if is_mendable(&error) && self.was_removed_without_rollup(record)? => Ok(None),
            (Err(error), _) => Err(error),
        }
    }

    fn was_removed_without_rollup(&self, record: &CatalogueRow) -> Result<bool, StoreError> {
        let asked: Option<Option<String>> = self
            .database
            .prepare_cached("SELECT rollup_sha256 FROM removals WHERE record = ?1")
            .and_then(|mut rows| rows.query_row([record.sequence as i64], |row| row.get(0)).optional())
            .map_err(self.failed())?;
        Ok(asked == Some(None))
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

//! Recordings of agents: one job each, and many record files, each catalogued by itself while the recording goes on.
//!
//! A recording lasts until somebody stops it, so its record cannot wait for its end. Each segment that is full becomes a Parquet file
//! of its own (a part), and its catalogue row comes with an event that says how far the recording is: instance and sequence of the
//! agent. With the newest of these events the same agent is recorded on, by another process and as another job, without doubles.
//!
//! ```text
//! segments/job-000007/0003.segment                          what is being recorded
//! records/mill-3/2026-11-22/job-000007-0002.parquet         what is catalogued
//! ```
//!
//! A part has no roll-up: observations come when something changes, and a roll-up is made of rows at even distances.

use crate::events::insert_event;
use crate::observations::{self, GAP, Reached};
use crate::record::Finished;
use crate::segment::{Recovery, compact, read};
use crate::{CatalogueRow, DataDirectory, Job, JobId, Log, NewJob, StoreError, Table, whole_file};
use arrow_array::cast::AsArray;
use ledger::Hash;
use rusqlite::OptionalExtension;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// Kind of the event that begins a recording.
const BEGUN: &str = "recording-begun";
/// Kind of the event that comes with the catalogue row of a part.
const PART: &str = "recording-part";
/// Kind of the event that says how far the agent had told everything when a recording was ended.
const ENDED: &str = "recording-ended";
/// In the metadata of segment and part: when the segment was begun, nanoseconds UTC. Its day is the part's folder.
const BEGUN_NS: &str = "toolmark.begun_ns";
/// In the metadata of a part whose recorder was killed.
const RECOVERED: &str = "toolmark.recovered";

/// What is recorded: the same agent and the same data items are one recording, continued.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Which agent: `agent HOST:PORT/DEVICE`.
    pub source: String,
    /// Which of its data items, as the agent was asked for them; empty for all.
    pub items: String,
}

/// A recording that begins.
#[derive(Clone, Debug)]
pub struct NewRecording<'a> {
    /// What is recorded.
    pub of: &'a Recorded,
    /// The device: the folder of its files.
    pub device: &'a str,
    /// When it begins.
    pub start: Timestamp,
    /// Who starts it.
    pub who: &'a str,
    /// The job that it goes on from, and where.
    pub from: Option<(JobId, Reached)>,
}

/// A part that is a whole file and not catalogued yet.
#[derive(Clone, Debug)]
pub struct Part {
    /// The file.
    pub finished: Finished,
    /// How far it goes; `None` without rows.
    pub reached: Option<Reached>,
    /// Its gaps.
    pub gaps: u64,
    /// What of its segment could not be read.
    pub lost: Option<String>,
}

/// Makes the Parquet file of a closed segment at `target`. Rows from number `until` on stand in a later segment, and are left out: the
/// segment was given up after its disk failed. The segment stays.
///
/// # Errors
/// The disk refuses, or nothing of the segment is readable; there is no file then.
pub fn part_of(segment: &Path, until: u64, target: &Path) -> Result<Part, StoreError> {
    make_part(segment, until, target, &[])
}

fn make_part(segment: &Path, until: u64, target: &Path, more: &[(String, String)]) -> Result<Part, StoreError> {
    let merged = compact::part_until(segment, until, target, more)?;
    let (reached, gaps) = tail_of(target)?;
    Ok(Part {
        finished: merged.finished,
        reached,
        gaps,
        lost: merged.lost.into_iter().map(|(_, what)| what).next(),
    })
}

/// Where the recording goes on behind a part, and the number of its gaps.
fn tail_of(part: &Path) -> Result<(Option<Reached>, u64), StoreError> {
    let damaged = |what: String| StoreError::Damaged {
        path: part.to_owned(),
        what,
    };
    let (mut reached, mut gaps) = (None, 0);
    for batch in Table::open(part)?.batches()? {
        let batch = batch?;
        let category = batch.column_by_name("category").and_then(|c| c.as_string_opt::<i32>());
        let category = category.ok_or_else(|| damaged("it has no column category".to_owned()))?;
        gaps += category.iter().filter(|c| *c == Some(GAP)).count() as u64;
        let last = batch.slice(batch.num_rows().saturating_sub(1), batch.num_rows().min(1));
        reached = observations::rows(&last)
            .map_err(damaged)?
            .last()
            .map(Reached::after)
            .or(reached);
    }
    Ok((reached, gaps))
}

impl DataDirectory {
    /// Registers a recording: a job, with the event that says of what.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn begin_recording(&mut self, new: &NewRecording<'_>) -> Result<Job, StoreError> {
        let job = self.begin_job(&NewJob {
            program: &new.of.source,
            // There are no bytes of a program; what was asked for stands in their place.
            program_hash: Hash::of(format!("{}\n{}", new.of.source, new.of.items).as_bytes()),
            machine: new.device,
            seed: 0,
            start: new.start,
            folder: None,
            who: new.who,
        })?;
        let mut detail = new.of.detail(job.id);
        if let Some((from, reached)) = &new.from {
            detail.insert("goes_on_from_job".to_owned(), Value::from(from.0));
            detail.extend(reached_detail(reached));
        }
        self.append(new.start, BEGUN, detail)?;
        Ok(job)
    }

    /// What a job records; `None` for the run of a program.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn recorded_by(&self, job: JobId) -> Result<Option<Recorded>, StoreError> {
        self.database
            .query_row(
                "SELECT json_extract(detail, '$.source'), json_extract(detail, '$.items') FROM events
                 WHERE log = 0 AND kind = ?1 AND json_extract(detail, '$.job') = ?2",
                rusqlite::params![BEGUN, job.0],
                |row| {
                    Ok(Recorded {
                        source: row.get(0)?,
                        items: row.get(1)?,
                    })
                },
            )
            .optional()
            .map_err(self.failed())
    }

    /// The last job that recorded something of that, and how far it came.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn recording_reached(&self, of: &Recorded) -> Result<Option<(JobId, Reached)>, StoreError> {
        self.database
            .query_row(
                "SELECT json_extract(detail, '$.job'), json_extract(detail, '$.instance'), json_extract(detail, '$.next'),
                        json_extract(detail, '$.last_ns') FROM events
                 WHERE log = 0 AND kind IN (?1, ?2) AND json_extract(detail, '$.source') = ?3
                   AND json_extract(detail, '$.items') = ?4 AND json_type(detail, '$.next') IS NOT NULL
                 ORDER BY sequence DESC LIMIT 1",
                [PART, ENDED, &of.source, &of.items],
                |row| {
                    // Instance ids have all 64 bits: they are kept as decimal texts.
                    let number = |k: usize| -> rusqlite::Result<u64> {
                        let text: String = row.get(k)?;
                        let odd = || rusqlite::Error::InvalidColumnType(k, "next".to_owned(), rusqlite::types::Type::Text);
                        text.parse().map_err(|_| odd())
                    };
                    let reached = Reached {
                        instance: number(1)?,
                        next: number(2)?,
                        last: row.get::<_, Option<i64>>(3)?.map(Timestamp),
                    };
                    Ok((JobId(row.get(0)?), reached))
                },
            )
            .optional()
            .map_err(self.failed())
    }

    /// Pairs for the metadata of a recording's segment that is begun at `at`.
    pub fn segment_metadata(of: &Recorded, at: Timestamp) -> BTreeMap<String, String> {
        BTreeMap::from([
            ("toolmark.source".to_owned(), of.source.clone()),
            ("toolmark.items".to_owned(), of.items.clone()),
            (BEGUN_NS.to_owned(), at.0.to_string()),
        ])
    }

    /// Where the part goes that is made of a segment: `records/<device>/<day>/job-000007-0001.parquet`.
    ///
    /// # Errors
    /// The segment cannot be read.
    pub fn part_path(&self, job: &Job, segment: &Path) -> Result<PathBuf, StoreError> {
        Ok(self.part_path_of(job, segment, &read(segment)?.metadata))
    }

    fn part_path_of(&self, job: &Job, segment: &Path, metadata: &BTreeMap<String, String>) -> PathBuf {
        let begun = metadata.get(BEGUN_NS).and_then(|ns| ns.parse().ok()).map(Timestamp);
        let whole = self.record_path(&job.machine, begun.unwrap_or(job.start), job.id);
        let number = segment.file_stem().unwrap_or_default().to_string_lossy();
        whole.with_file_name(format!("job-{:06}-{number}.parquet", job.id.0))
    }

    /// Catalogues a part, tells in the same transaction how far the recording is, and removes its segment. Killed anywhere,
    /// [`DataDirectory::recover`] does the rest.
    ///
    /// # Errors
    /// The disk refuses; the catalogue does not know the part then.
    pub fn keep_part(&mut self, job: JobId, segment: &Path, part: &Part, at: Timestamp) -> Result<CatalogueRow, StoreError> {
        let row = self.catalogue_part(job, part, at)?;
        // One that cannot be removed now is recognised as catalogued later; an error here would be taken for one of the catalogue.
        let _ = compact::remove(segment);
        Ok(row)
    }

    fn catalogue_part(&mut self, job: JobId, part: &Part, at: Timestamp) -> Result<CatalogueRow, StoreError> {
        let of = self.recorded_by(job)?.ok_or(StoreError::NoSuchJob(job))?;
        let mut detail = of.detail(job);
        detail.insert("record".to_owned(), self.path_to_text(&part.finished.path)?.into());
        detail.insert("gaps".to_owned(), part.gaps.into());
        detail.insert("roll_up".to_owned(), "none: observations are not at even distances".into());
        if let Some(lost) = &part.lost {
            detail.insert("lost".to_owned(), lost.as_str().into());
        }
        if let Some(reached) = &part.reached {
            detail.extend(reached_detail(reached));
        }
        self.catalogue_with(job, &part.finished, at, Some((PART, detail)))
    }

    /// Ends a recording whose parts are all catalogued: how far the agent had told everything, and what is left of its segments goes.
    ///
    /// # Errors
    /// A part is not catalogued yet, or the disk refuses.
    pub fn end_recording(
        &mut self,
        job: JobId,
        reached: Option<Reached>,
        at: Timestamp,
        ending: crate::Ending,
    ) -> Result<(), StoreError> {
        let of = self.recorded_by(job)?.ok_or(StoreError::NoSuchJob(job))?;
        let folder = self.recording_folder(job);
        let row = self.job(job)?;
        for segment in if folder.is_dir() { compact::paths(&folder)? } else { vec![] } {
            let found = read(&segment)?;
            if found.rows > 0 && !self.is_catalogued(job, &self.part_path_of(&row, &segment, &found.metadata))? {
                return Err(StoreError::Unwritable {
                    path: segment,
                    what: "it is not in the catalogue yet".to_owned(),
                });
            }
        }
        let mut detail = of.detail(job);
        if let Some(reached) = &reached {
            detail.extend(reached_detail(reached));
        }
        self.in_transaction(|transaction, chain| insert_event(transaction, Log::Directory, &chain.append(at, ENDED, detail)))?;
        self.end_job(job, at, ending)?;
        compact::discard(&folder)
    }

    /// Makes parts of the segments that a dead recorder left, each once.
    pub(crate) fn recover_parts(&mut self, job: &Job, folder: &Path) -> Result<Recovery, StoreError> {
        let mut recovery = Recovery::default();
        let mut segments = Vec::new();
        for path in compact::paths(folder)? {
            match read(&path) {
                Ok(found) => segments.push(found),
                Err(StoreError::Damaged { what, .. }) => recovery.lost.push(format!("{}: {what}", name_of(&path))),
                Err(other) => return Err(other),
            }
        }
        for (k, found) in segments.iter().enumerate() {
            // After a failed sync the rows that were not acknowledged came again, into the next segment.
            let until = segments[k + 1..]
                .iter()
                .map(|later| later.first_row)
                .min()
                .unwrap_or(u64::MAX);
            if let Some(lost) = &found.lost {
                recovery.lost.push(format!("{}: {lost}", name_of(&found.path)));
            }
            let target = self.part_path_of(job, &found.path, &found.metadata);
            if self.is_catalogued(job.id, &target)? || found.rows == 0 || until <= found.first_row {
                continue;
            }
            let more = [(RECOVERED.to_owned(), "interrupted".to_owned())];
            let part = make_part(&found.path, until, &target, &more)?;
            let begun = found.metadata.get(BEGUN_NS).and_then(|ns| ns.parse().ok()).map(Timestamp);
            let last = part.finished.span_us.map(|(_, last)| Timestamp(last.saturating_mul(1000)));
            // The clock of the recorder, where it is later than the agent's: nothing tells when the recorder was killed.
            let at = job.start.max(begun.unwrap_or(job.start)).max(last.unwrap_or(job.start));
            self.catalogue_part(job.id, &part, at)?;
        }
        for row in self.records()?.into_iter().filter(|row| row.job == job.id) {
            recovery.rows += row.rows;
            recovery.last_us = recovery.last_us.max(row.span_us.map(|(_, last)| last));
            recovery.earlier.extend(recovery.record.replace(row.path));
        }
        let at = recovery.last_us.map_or(job.start, |us| Timestamp(us.saturating_mul(1000)));
        let detail = self.recovery_detail(job, &recovery)?;
        self.append(at, "recording-recovered", detail)?;
        Ok(recovery)
    }

    /// True when the part is in the catalogue as it stands on the disk.
    fn is_catalogued(&self, job: JobId, part: &Path) -> Result<bool, StoreError> {
        let row = self
            .records()?
            .into_iter()
            .rev()
            .find(|row| row.job == job && row.path == part);
        Ok(row.is_some_and(|row| whole_file::hash_of_file(&row.path).is_ok_and(|hash| hash == row.hash)))
    }
}

impl Recorded {
    fn detail(&self, job: JobId) -> BTreeMap<String, Value> {
        BTreeMap::from([
            ("job".to_owned(), Value::from(job.0)),
            ("source".to_owned(), Value::from(self.source.as_str())),
            ("items".to_owned(), Value::from(self.items.as_str())),
        ])
    }
}

fn reached_detail(reached: &Reached) -> [(String, Value); 3] {
    [
        ("instance".to_owned(), Value::from(reached.instance.to_string())),
        ("next".to_owned(), Value::from(reached.next.to_string())),
        ("last_ns".to_owned(), reached.last.map_or(Value::Null, |at| Value::from(at.0))),
    ]
}

fn name_of(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

//! Jobs: one run of one program each, and what is left of those that a power loss ended.

use crate::events::{end_of, insert_event};
use crate::segment::Recovery;
use crate::{DataDirectory, Log, StoreError};
use ledger::{Event, Hash};
use rusqlite::{OptionalExtension, Row, params};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// The number of a job in its data directory, from 1.
///
/// It says how many jobs ran here before, so it does not belong into anything that must be the same for the same run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(pub i64);

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// How a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobState {
    /// It runs, or it was interrupted and nobody has said so yet.
    Running,
    /// It is over.
    Over(Ending),
}

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It came to its end.
    Done,
    /// By an alarm, a stop or a fault.
    Failed,
    /// The process that ran it went away.
    Interrupted,
}

impl JobState {
    const ALL: [JobState; 4] = [
        JobState::Running,
        JobState::Over(Ending::Done),
        JobState::Over(Ending::Failed),
        JobState::Over(Ending::Interrupted),
    ];
    /// The word in table and JSON.
    pub fn word(self) -> &'static str {
        match self {
            JobState::Running => "running",
            JobState::Over(Ending::Done) => "done",
            JobState::Over(Ending::Failed) => "failed",
            JobState::Over(Ending::Interrupted) => "interrupted",
        }
    }
    fn from_word(word: &str) -> Option<JobState> {
        Self::ALL.into_iter().find(|s| s.word() == word)
    }
}

/// What is known of a job when it begins.
#[derive(Clone, Debug)]
pub struct NewJob<'a> {
    /// The program's name.
    pub program: &'a str,
    /// The hash of the program's bytes.
    pub program_hash: Hash,
    /// The machine's name.
    pub machine: &'a str,
    /// The seed of a simulated run.
    pub seed: u64,
    /// When it begins.
    pub start: Timestamp,
    /// Where its files go; `None` for `jobs/<job>/` in the data directory.
    pub folder: Option<&'a Path>,
    /// Who starts it.
    pub who: &'a str,
}

/// A job as it is listed.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Its number.
    pub id: JobId,
    /// The program's name.
    pub program: String,
    /// The hash of the program's bytes.
    pub program_hash: Hash,
    /// The machine's name.
    pub machine: String,
    /// The seed of a simulated run.
    pub seed: u64,
    /// When it began.
    pub start: Timestamp,
    /// When it ended.
    pub end: Option<Timestamp>,
    /// How it stands.
    pub state: JobState,
    /// Where its files are.
    pub folder: PathBuf,
}

/// A job whose process went away in the middle of it: after a power loss the person must be told where.
#[derive(Clone, Debug, PartialEq)]
pub struct Interrupted {
    /// The job.
    pub job: Job,
    /// True for the recording of an agent, false for the run of a program.
    pub is_recording: bool,
    /// The last thing that was kept of it.
    pub last_event: Option<Event>,
    /// The last program step that an event of it names by `step`.
    pub last_step: Option<u64>,
    /// Unfinished files in its folder and at its record's place; nothing refers to them.
    pub unfinished: Vec<PathBuf>,
    /// Its record, when that is whole and only the catalogue does not know it yet: open it with [`crate::record::Reader`] and hand its
    /// `finished()` to [`DataDirectory::catalogue`].
    pub uncatalogued: Option<PathBuf>,
    /// What became of its recording; filled by [`DataDirectory::recover_interrupted`].
    pub recovery: Option<Recovery>,
    /// Why its recording could not be made a record yet: it is kept, and the next start tries again.
    pub not_recovered: Option<String>,
}

/// What other processes left behind.
#[derive(Debug)]
pub struct Left {
    /// Jobs that were interrupted, with what became of their recordings.
    pub interrupted: Vec<Interrupted>,
    /// What became of recordings of jobs that had ended, but could not keep them: their disk was full, or they were killed at the very
    /// end.
    pub of_jobs_over: Vec<(JobId, Result<Recovery, StoreError>)>,
}

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let job = &self.job;
        write!(
            f,
            "job {} ({} on {}), started {}, was interrupted",
            job.id,
            job.program,
            job.machine,
            utc(job.start)
        )?;
        if let Some(step) = self.last_step {
            write!(f, " at step {step} or later")?;
        }
        match &self.last_event {
            Some(event) => write!(f, "; the last that is known of it is `{}` at {}", event.kind, utc(event.at()))?,
            None => write!(f, "; nothing of it was kept")?,
        }
        if let Some(recovery) = &self.recovery {
            write!(f, "; {recovery}")?;
        }
        if let Some(why) = &self.not_recovered {
            write!(f, "; its recording is kept, but no record could be made of it yet: {why}")?;
        }
        for path in &self.unfinished {
            write!(f, "; {} is unfinished", path.display())?;
        }
        if self.is_recording {
            return write!(f, ". toolmark record of the same agent goes on where it was");
        }
        write!(
            f,
            ". Nothing resumes by itself: look at machine and part before the next start; then toolmark run PROGRAM --resume {} takes it up there",
            job.id
        )
    }
}

fn utc(at: Timestamp) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(at.0)).map_or_else(|_| format!("{} ns", at.0), |t| t.to_string())
}

impl DataDirectory {
    /// Registers a job that begins, makes its folder, and tells so in the log.
    ///
    /// # Errors
    /// The disk refuses, or the folder's name is not Unicode.
    pub fn begin_job(&mut self, new: &NewJob<'_>) -> Result<Job, StoreError> {
        let given = new.folder.map(|folder| self.path_to_text(folder)).transpose()?;
        let id = self.in_transaction(|transaction, chain| {
            transaction.execute(
                "INSERT INTO jobs (program, program_sha256, machine, seed, start_ns, state, folder)
                 VALUES (?1, ?2, ?3, ?4, ?5, 'running', '')",
                params![
                    new.program,
                    new.program_hash.to_string(),
                    new.machine,
                    new.seed.to_string(),
                    new.start.0
                ],
            )?;
            let id = JobId(transaction.last_insert_rowid());
            let folder = given.unwrap_or_else(|| format!("jobs/{:06}", id.0));
            transaction.execute("UPDATE jobs SET folder = ?2 WHERE id = ?1", params![id.0, folder])?;
            let detail = BTreeMap::from([
                ("job".to_owned(), Value::from(id.0)),
                ("program".to_owned(), Value::from(new.program)),
                ("program_sha256".to_owned(), Value::from(new.program_hash.to_string())),
                ("machine".to_owned(), Value::from(new.machine)),
                ("seed".to_owned(), Value::from(new.seed)),
                ("folder".to_owned(), Value::from(folder)),
                ("who".to_owned(), Value::from(new.who)),
            ]);
            let event = chain.append(new.start, "job-started", detail);
            insert_event(transaction, Log::Directory, &event)?;
            Ok(id)
        })?;
        self.begun.insert(id);
        let job = self.job(id)?;
        if let Err(error) = std::fs::create_dir_all(&job.folder) {
            // It never began: the next start must not call it interrupted.
            self.end_job(id, new.start, Ending::Failed)?;
            return Err(StoreError::io("create", &job.folder)(error));
        }
        Ok(job)
    }

    /// Says that a job is over. The end of its own chain is told with it, so that nothing can be cut off it unseen.
    ///
    /// # Errors
    /// It is over already, or the disk refuses.
    pub fn end_job(&mut self, id: JobId, end: Timestamp, ending: Ending) -> Result<(), StoreError> {
        self.running_job(id)?;
        let failed = self.failed();
        let state = JobState::Over(ending);
        let last = end_of(&self.database, Log::Job(id)).map_err(failed)??;
        self.in_transaction(|transaction, chain| {
            transaction.execute(
                "UPDATE jobs SET state = ?2, end_ns = ?3 WHERE id = ?1",
                params![id.0, state.word(), end.0],
            )?;
            let detail = BTreeMap::from([
                ("job".to_owned(), Value::from(id.0)),
                ("state".to_owned(), Value::from(state.word())),
                ("events".to_owned(), Value::from(last.sequence)),
                ("last_hash".to_owned(), Value::from(last.hash.to_string())),
            ]);
            let event = chain.append(end, "job-ended", detail);
            insert_event(transaction, Log::Directory, &event)
        })?;
        self.begun.remove(&id);
        Ok(())
    }

    /// Jobs that ran when their process went away. They stay on this list until somebody has seen them and [`DataDirectory::end_job`]
    /// says [`Ending::Interrupted`].
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn interrupted_jobs(&self) -> Result<Vec<Interrupted>, StoreError> {
        let jobs = self
            .jobs()?
            .into_iter()
            .filter(|job| job.state == JobState::Running && !self.begun.contains(&job.id));
        jobs.map(|job| {
            let log = Log::Job(job.id);
            let step: Option<i64> = self
                .database
                .query_row(
                    "SELECT json_extract(detail, '$.step') FROM events
                     WHERE log = ?1 AND json_type(detail, '$.step') = 'integer' ORDER BY sequence DESC LIMIT 1",
                    [log.number()],
                    |row| row.get(0),
                )
                .optional()
                .map_err(self.failed())?;
            let record = self.record_path(&job.machine, job.start, job.id);
            let known = self.records()?.iter().any(|row| row.path == record);
            let mut unfinished: Vec<PathBuf> = [crate::whole_file::temporary_name(&record)]
                .into_iter()
                .filter(|p| p.exists())
                .collect();
            unfinished.extend(unfinished_files(&job.folder));
            Ok(Interrupted {
                last_event: self.last_event(log)?,
                last_step: step.and_then(|s| u64::try_from(s).ok()),
                unfinished,
                uncatalogued: (record.exists() && !known).then_some(record),
                recovery: None,
                not_recovered: None,
                is_recording: self.recorded_by(job.id)?.is_some(),
                job,
            })
        })
        .collect()
    }

    /// Makes records of all recordings that dead processes left, and says which jobs were interrupted. A recording that cannot be made a
    /// record now (a full disk) is kept, and is said; [`DataDirectory::end_job`] is for the others.
    ///
    /// # Errors
    /// The disk refuses to be read at all.
    pub fn recover_interrupted(&mut self) -> Result<Left, StoreError> {
        let mut done = BTreeMap::new();
        for job in self.left_recordings()? {
            done.insert(job, self.recover(job));
        }
        let mut interrupted = self.interrupted_jobs()?;
        for found in &mut interrupted {
            match done.remove(&found.job.id) {
                Some(Ok(recovery)) => found.recovery = recovery,
                Some(Err(error)) => found.not_recovered = Some(error.to_string()),
                None => {}
            }
        }
        let of_jobs_over = done.into_iter().filter_map(|(job, done)| match done {
            Ok(recovery) => Some((job, Ok(recovery?))),
            Err(error) => Some((job, Err(error))),
        });
        Ok(Left {
            interrupted,
            of_jobs_over: of_jobs_over.collect(),
        })
    }

    /// All jobs, oldest first.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn jobs(&self) -> Result<Vec<Job>, StoreError> {
        let all = || -> rusqlite::Result<Vec<Job>> {
            let mut statement = self.database.prepare("SELECT * FROM jobs ORDER BY id")?;
            statement.query_map([], |row| self.job_of(row))?.collect()
        };
        all().map_err(self.failed())
    }

    /// One job.
    ///
    /// # Errors
    /// There is no such job, or the disk refuses.
    pub fn job(&self, id: JobId) -> Result<Job, StoreError> {
        self.database
            .query_row("SELECT * FROM jobs WHERE id = ?1", [id.0], |row| self.job_of(row))
            .optional()
            .map_err(self.failed())?
            .ok_or(StoreError::NoSuchJob(id))
    }

    pub(crate) fn running_job(&self, id: JobId) -> Result<Job, StoreError> {
        let job = self.job(id)?;
        match job.state {
            JobState::Running => Ok(job),
            JobState::Over(_) => Err(StoreError::JobIsOver(id)),
        }
    }

    fn job_of(&self, row: &Row<'_>) -> rusqlite::Result<Job> {
        let text = |column: &str| row.get::<_, String>(column);
        let odd = |column: &str| rusqlite::Error::InvalidColumnType(0, column.to_owned(), rusqlite::types::Type::Text);
        Ok(Job {
            id: JobId(row.get("id")?),
            program: text("program")?,
            program_hash: Hash::parse(&text("program_sha256")?).ok_or_else(|| odd("program_sha256"))?,
            machine: text("machine")?,
            seed: text("seed")?.parse().map_err(|_| odd("seed"))?,
            start: Timestamp(row.get("start_ns")?),
            end: row.get::<_, Option<i64>>("end_ns")?.map(Timestamp),
            state: JobState::from_word(&text("state")?).ok_or_else(|| odd("state"))?,
            folder: self.path_from_text(&text("folder")?),
        })
    }
}

/// `.tmp` files in a folder; a folder that is gone has none.
fn unfinished_files(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|e| e == "tmp"))
        .collect();
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use ledger::Chain;

    fn new_job() -> NewJob<'static> {
        NewJob {
            program: "plate.stpnc",
            program_hash: Hash::of(b"program"),
            machine: "sim-mill",
            seed: u64::MAX,
            start: Timestamp(1_795_132_800_000_000_000),
            folder: None,
            who: "Maria",
        }
    }

    #[test]
    fn a_job_that_came_to_its_end_is_no_notice() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let job = directory.begin_job(&new_job()).expect("begins");
        assert!(job.folder.ends_with("jobs/000001") && job.folder.is_dir());
        assert_eq!(job.seed, u64::MAX);
        assert_eq!(directory.interrupted_jobs().expect("reads"), []);
        directory
            .end_job(job.id, Timestamp(1_795_132_801_000_000_000), Ending::Done)
            .expect("ends");
        assert!(matches!(
            directory.end_job(job.id, Timestamp(0), Ending::Done),
            Err(StoreError::JobIsOver(_))
        ));
        drop(directory);
        let directory = DataDirectory::open(folder.path(), "test").expect("free");
        assert_eq!(directory.interrupted_jobs().expect("reads"), []);
        assert_eq!(directory.job(job.id).expect("reads").state, JobState::Over(Ending::Done));
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn the_next_start_says_which_job_was_interrupted_and_where_until_it_is_seen() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let job = directory.begin_job(&new_job()).expect("begins");
        let mut chain = Chain::default();
        let at = Timestamp(job.start.0 + 2_000_000_000);
        let events = [
            chain.append(job.start, "tool", BTreeMap::from([("step".to_owned(), 12.into())])),
            chain.append(at, "coolant", BTreeMap::new()),
        ];
        directory.append_job_events(job.id, &events).expect("kept");
        std::fs::write(job.folder.join("record.parquet.tmp"), "half").expect("written");
        drop(directory);

        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let found = directory.interrupted_jobs().expect("reads");
        let text = found[0].to_string();
        assert!(
            text.starts_with(
                "job 1 (plate.stpnc on sim-mill), started 2026-11-20T00:00:00Z, was interrupted at step 12 or later; \
                 the last that is known of it is `coolant` at 2026-11-20T00:00:02Z; "
            ),
            "{text}"
        );
        assert!(text.contains("record.parquet.tmp is unfinished"), "{text}");
        directory.end_job(job.id, at, Ending::Interrupted).expect("seen");
        assert_eq!(directory.interrupted_jobs().expect("reads"), []);
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn events_that_do_not_continue_a_job_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let job = directory.begin_job(&new_job()).expect("begins").id;
        let mut chain = Chain::default();
        let [one, two, three] = [1, 2, 3].map(|k| chain.append(Timestamp(k), "test", BTreeMap::new()));
        directory
            .append_job_events(job, std::slice::from_ref(&one))
            .expect("the first");
        assert!(matches!(
            directory.append_job_events(job, &[two.clone(), one]),
            Err(StoreError::Broken { .. })
        ));
        assert!(matches!(
            directory.append_job_events(job, &[three]),
            Err(StoreError::Broken { .. })
        ));
        directory.append_job_events(job, &[two]).expect("the second");
        assert_eq!(directory.events(Log::Job(job), 1, 10).expect("reads").len(), 2);
    }
}

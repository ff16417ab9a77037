//! `toolmark trace`: what was recorded, looked at and never changed; and what lives in a controller.
//!
//! All verbs open the directory to read it, so that they work on a backup and on a medium that cannot be written, and never while a
//! process works in it. The exception is the end of an action that lives in a controller ([`living`]).

mod actions;
mod export;
mod list;
pub mod living;
mod mdf;
mod observations;
mod show;
mod statistics;
mod verify;

use super::Done;
use crate::cli::{Common, TraceArgs, TraceCommand};
use crate::failure::Failure;
use crate::link::address;
use crate::shop;
use ledger::Event;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::record::Reader;
use store::{CatalogueRow, DataDirectory, Hold, Job, JobId, Log, Recorded};
use units::Timestamp;

/// Runs the command.
///
/// # Errors
/// There is no such directory or job, or it cannot be read.
pub fn trace(args: &TraceArgs, common: &Common) -> Done {
    let root = |dir: &Option<PathBuf>| match dir {
        Some(dir) => Ok(dir.clone()),
        None => shop::data_path(common),
    };
    match &args.what {
        TraceCommand::List { dir } => list::list(&root(dir)?, common),
        TraceCommand::Show { job, dir, events } => show::show(&root(dir)?, job, *events, common),
        TraceCommand::Actions { job, dir, machine_file } => {
            let of_a_controller = address::is_address(&common.machine);
            match job {
                Some(_) if of_a_controller => Err(Failure::usage(
                    "the actions of a job are in the data directory, those that live now in the controller: give JOB or --machine tcp://..., \
                     not both",
                )),
                Some(_) if machine_file.is_some() => Err(Failure::usage(
                    "--machine-file is for a machine behind tcp://: the actions of a job are in the data directory",
                )),
                Some(job) => actions::actions(&root(dir)?, job, common),
                None if of_a_controller => living::list(machine_file.as_deref(), common),
                None => Err(Failure::usage(
                    "give the number of a job, or `last`; or --machine tcp://HOST:PORT for the actions that live in a controller",
                )),
            }
        }
        TraceCommand::End { which, machine_file } => living::end(which, machine_file.as_deref(), common),
        TraceCommand::Export {
            job,
            dir,
            out,
            from,
            to,
            channels,
        } => {
            let wanted = export::Wanted {
                out,
                from: from.as_deref(),
                to: to.as_deref(),
                channels,
            };
            export::export(&root(dir)?, job, &wanted, common)
        }
        TraceCommand::Verify { dir } => verify::verify(&root(dir)?, common),
    }
}

/// A job with what belongs to it.
struct Found {
    job: Job,
    events: Vec<Event>,
    records: Vec<CatalogueRow>,
    /// Records whose rows cannot be read any more, by their place in the catalogue, and why.
    gone: BTreeMap<u64, String>,
    hold: Option<Hold>,
    verdict: Option<String>,
    /// The agent that it recorded; `None` for the run of a program.
    recorded: Option<Recorded>,
}

/// The record files of a job, by its number or `last`, oldest first, to be read while nobody works in the directory. With them whose
/// rows are gone, and why.
///
/// # Errors
/// There is no such job, or nothing of it is there.
pub fn record_files(root: &Path, job: &str) -> Result<(Vec<PathBuf>, Vec<String>), Failure> {
    let directory = shop::read_data(root)?;
    let found = find(&directory, job)?;
    let files: Vec<PathBuf> = found.readable().map(|row| row.path.clone()).collect();
    let gone = found.records.iter().filter_map(|row| {
        let why = found.gone.get(&row.sequence)?;
        Some(format!("{}: {why}", shown(root, &row.path)))
    });
    let gone: Vec<String> = gone.collect();
    if files.is_empty() {
        let why = if gone.is_empty() {
            "it has no record".to_owned()
        } else {
            gone.join("; ")
        };
        return Err(Failure::unreadable(format_args!("job {}: {why}", found.job.id)));
    }
    Ok((files, gone))
}

impl Found {
    /// How long it ran, seconds; up to the last that is known of it when nobody ended it.
    fn duration(&self) -> f64 {
        let recorded = self
            .records
            .iter()
            .filter_map(|r| r.span_us)
            .map(|(_, last)| last * 1000)
            .max();
        let told = self.events.last().map(|e| e.at_ns);
        let end = self.job.end.map(|end| end.0).into_iter().chain(recorded).chain(told).max();
        end.map_or(0.0, |end| (end - self.job.start.0).max(0) as f64 / 1e9)
    }

    fn rows(&self) -> u64 {
        self.records.iter().map(|r| r.rows).sum()
    }

    /// The records whose rows are there.
    fn readable(&self) -> impl Iterator<Item = &CatalogueRow> {
        self.records.iter().filter(|r| !self.gone.contains_key(&r.sequence))
    }
}

/// The job that a person names: by number, or the last one.
///
/// # Errors
/// There is no such job, or the data directory cannot be read.
pub fn job_named(directory: &DataDirectory, name: &str) -> Result<Job, Failure> {
    let jobs = directory.jobs().map_err(shop::failure)?;
    let known = match (jobs.first(), jobs.last()) {
        (Some(first), Some(last)) => format!("the data directory holds jobs {} to {}", first.id, last.id),
        _ => "the data directory holds no jobs yet".to_owned(),
    };
    let wanted = match name {
        "last" => jobs.last().map(|job| job.id),
        number => {
            let number = number
                .parse()
                .map_err(|_| Failure::usage(format_args!("{name}: the number of a job or `last` was expected; {known}")))?;
            Some(JobId(number))
        }
    };
    let job = wanted.and_then(|id| jobs.into_iter().find(|job| job.id == id));
    job.ok_or_else(|| Failure::usage(format_args!("there is no job {name}; {known}: toolmark trace list")))
}

fn find(directory: &DataDirectory, name: &str) -> Result<Found, Failure> {
    let job = job_named(directory, name)?;
    Everything::of(directory)?.with(directory, job)
}

/// What belongs to all jobs, read once.
struct Everything {
    records: Vec<CatalogueRow>,
    gone: BTreeMap<u64, String>,
    holds: Vec<Hold>,
    verdicts: Verdicts,
}

impl Everything {
    fn of(directory: &DataDirectory) -> Result<Everything, Failure> {
        let records = directory.records().map_err(shop::failure)?;
        let removals = directory.removals().map_err(shop::failure)?;
        let mut gone: BTreeMap<u64, String> = removals.into_iter().map(|r| (r.record.sequence, r.why)).collect();
        // `run --out DIR` twice: the newest record of a path speaks for it.
        let mut newest = BTreeMap::new();
        for row in &records {
            if let Some(older) = newest.insert(&row.path, row.sequence) {
                gone.insert(older, "a later run wrote another record to the same place".to_owned());
            }
        }
        Ok(Everything {
            gone,
            holds: directory.holds().map_err(shop::failure)?,
            verdicts: Verdicts::of(directory)?,
            records,
        })
    }

    fn with(&self, directory: &DataDirectory, job: Job) -> Result<Found, Failure> {
        let records: Vec<CatalogueRow> = self.records.iter().filter(|r| r.job == job.id).cloned().collect();
        let gone = self.gone.iter().filter(|(n, _)| records.iter().any(|r| r.sequence == **n));
        Ok(Found {
            gone: gone.map(|(n, why)| (*n, why.clone())).collect(),
            hold: self.holds.iter().find(|hold| hold.job == job.id).cloned(),
            verdict: self.verdicts.of_job(job.id),
            events: events_of(directory, job.id)?,
            recorded: directory.recorded_by(job.id).map_err(shop::failure)?,
            records,
            job,
        })
    }
}

fn events_of(directory: &DataDirectory, job: JobId) -> Result<Vec<Event>, Failure> {
    let mut events: Vec<Event> = Vec::new();
    loop {
        let from = events.last().map_or(1, |e| e.sequence + 1);
        let more = directory.events(Log::Job(job), from, 1000).map_err(shop::failure)?;
        if more.is_empty() {
            return Ok(events);
        }
        events.extend(more);
    }
}

/// The verdict of each job, out of the report that it wrote.
struct Verdicts(Vec<store::KeptFile>);

impl Verdicts {
    fn of(directory: &DataDirectory) -> Result<Verdicts, Failure> {
        let mut kept = directory.kept_files().map_err(shop::failure)?;
        kept.retain(|file| file.path.ends_with("report.json"));
        Ok(Verdicts(kept))
    }

    /// `None` when the job wrote no report; a report that is gone or was changed says no verdict.
    fn of_job(&self, job: JobId) -> Option<String> {
        let file = self.0.iter().find(|file| file.job == Some(job))?;
        let bytes = std::fs::read(&file.path).ok();
        let Some(bytes) = bytes.filter(|bytes| ledger::Hash::of(bytes) == file.hash) else {
            return Some("report gone or changed".to_owned());
        };
        let report: serde_json::Value = serde_json::from_slice(&bytes).ok()?;
        Some(report.get("verdict")?.as_str()?.to_owned())
    }
}

/// Opens a record of the catalogue and holds it against its row.
fn open(row: &CatalogueRow) -> Result<Reader, Failure> {
    let reader = Reader::open(&row.path).map_err(shop::failure)?;
    if reader.hash().map_err(shop::failure)? != row.hash {
        return Err(changed(row));
    }
    Ok(reader)
}

fn changed(row: &CatalogueRow) -> Failure {
    Failure::unreadable(format_args!(
        "{}: its content is not what was recorded (catalogue row {}); take it from a backup: toolmark trace verify names all \
         that was changed",
        row.path.display(),
        row.sequence
    ))
}

/// A path as it is shown: short where it lies in the directory.
fn shown(root: &Path, path: &Path) -> String {
    let whole = std::path::absolute(root).unwrap_or_else(|_| root.to_owned());
    path.strip_prefix(&whole).unwrap_or(path).display().to_string()
}

/// Seconds since a job's start.
fn seconds_since(start: Timestamp, at_ns: i64) -> f64 {
    (at_ns - start.0) as f64 / 1e9
}

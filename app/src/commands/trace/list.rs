//! `toolmark trace list`: the jobs and their recordings, oldest first.

use super::{Everything, Found, shown};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::Exit;
use crate::survey::minutes;
use crate::{clock, functions, say, shop};
use serde_json::{Value, json};
use std::path::Path;

/// Runs the command.
///
/// # Errors
/// There is no data directory, a process works in it, or it cannot be read.
pub fn list(root: &Path, common: &Common) -> Done {
    let directory = shop::read_data(root)?;
    let everything = Everything::of(&directory)?;
    let mut all = Vec::new();
    for job in directory.jobs().map_err(shop::failure)? {
        all.push(everything.with(&directory, job)?);
    }
    if common.json {
        let jobs: Vec<Value> = all.iter().map(|found| brief(root, found)).collect();
        print_json(&json!({ "data": root, "jobs": jobs }))?;
        return Ok(Exit::Good);
    }
    if all.is_empty() {
        say("no job was recorded yet; run one: toolmark run PROGRAM --fast");
        return Ok(Exit::Good);
    }
    say(&format!(
        "{:>5}  {:24} {:12} {:19}  {:>9} {:>9} {:>7}  {:11} {:4} verdict",
        "job", "program", "machine", "start", "duration", "rows", "missing", "state", "hold"
    ));
    for found in &all {
        let job = &found.job;
        say(&format!(
            "{:>5}  {:24} {:12} {:19}  {:>9} {:>9} {:>7}  {:11} {:4} {}{}",
            job.id.0,
            job.program,
            job.machine,
            clock::local(job.start),
            minutes(found.duration()),
            found.rows(),
            missing_rows(found).map_or_else(|| "-".to_owned(), |n| n.to_string()),
            job.state.word(),
            if found.hold.is_some() { "yes" } else { "" },
            found.verdict.as_deref().unwrap_or("-"),
            if found.gone.is_empty() { "" } else { ", rows gone" }
        ));
    }
    say("missing: rows that a record of one row each millisecond lacks; more of a job: toolmark trace show JOB");
    Ok(Exit::Good)
}

/// Rows that are lost between the first and the last of each record; `None` without rows.
///
/// The records of runs hold a row each servo cycle of 1 ms.
fn missing_rows(found: &Found) -> Option<u64> {
    // Observations come when something changes.
    if found.recorded.is_some() {
        return None;
    }
    let spans = found.records.iter().filter_map(|r| Some((r.span_us?, r.rows)));
    spans
        .map(|((first, last), rows)| (((last - first) / 1000 + 1).unsigned_abs()).saturating_sub(rows))
        .reduce(|a, b| a + b)
}

/// A job as JSON, without its samples.
pub fn brief(root: &Path, found: &Found) -> Value {
    let job = &found.job;
    let micros = |us: i64| clock::utc(units::Timestamp(us * 1000));
    let records: Vec<Value> = found
        .records
        .iter()
        .map(|r| {
            json!({
                "sequence": r.sequence,
                "path": shown(root, &r.path),
                "rows": r.rows,
                "bytes": r.bytes,
                "sha256": r.hash.to_string(),
                "gone": found.gone.get(&r.sequence),
                "first": r.span_us.map(|(first, _)| micros(first)),
                "last": r.span_us.map(|(_, last)| micros(last)),
            })
        })
        .collect();
    json!({
        "job": job.id.0,
        "kind": if found.recorded.is_some() { "recording" } else { "run" },
        "program": job.program,
        "program_sha256": job.program_hash.to_string(),
        "machine": job.machine,
        "seed": job.seed,
        "start": clock::utc(job.start),
        "end": job.end.map(clock::utc),
        "duration_s": found.duration(),
        "state": job.state.word(),
        "verdict": found.verdict,
        "folder": shown(root, &job.folder),
        "events": found.events.len(),
        "functions": found.events.iter().filter(|e| functions::is_of_the_program(e)).count(),
        "rows": found.rows(),
        "hold": found.hold.as_ref().map(|h| json!({ "since": clock::utc(h.at), "who": h.who, "why": h.why })),
        "missing_rows": missing_rows(found),
        "records": records,
    })
}

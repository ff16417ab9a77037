//! `toolmark size undo` and `toolmark size new-tool`.

use super::args::{NewToolArgs, UndoArgs};
use super::{Bench, number_in, shown_in, unit_name};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::{clock, say, shop};
use ledger::{Action, ChangeRequest};
use serde_json::json;
use sizing::Applied;
use sizing::history::{Row, What};
use std::collections::BTreeSet;
use store::DataDirectory;
use units::{Millimetres, Timestamp};

/// Runs `undo`.
pub(super) fn undo(args: &UndoArgs, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let who = who_may(&mut directory, at, common)?;
    let mut bench = Bench::open(&directory, common)?;
    let entry = bench
        .history
        .iter()
        .find(|r| r.entry == args.entry && r.what == What::Entered)
        .cloned();
    let Some(entry) = entry else {
        return Err(Failure::usage(format_args!(
            "{} is no accepted entry of job {}: `toolmark size history` shows their numbers",
            args.entry, bench.job.name
        )));
    };
    let negative = |message: String| Failure::negative(format_args!("error: {message}"));
    if let Some(done) = bench.history.iter().find(|r| r.of == Some(entry.entry)) {
        return Err(negative(format!(
            "entry {} was taken back already, by entry {}",
            entry.entry, done.entry
        )));
    }
    if entry.change() == 0.0 {
        return Err(negative(format!(
            "entry {} changed nothing: there is nothing to take back",
            entry.entry
        )));
    }
    let applied = Applied {
        sequence: entry.entry,
        register: entry.register.clone(),
        before: entry.before_mm,
        after: entry.after_mm.unwrap_or(0.0),
    };
    let present = directory.value(&entry.register).map_err(shop::failure)?;
    let reason = common.reason.clone().unwrap_or_default();
    let cut = has_cut(&bench, &directory, &entry)?;
    let (what, request) = if args.opposite {
        (What::Opposed, sizing::opposite(&applied, present, &who, &reason, at))
    } else {
        (What::Undone, sizing::undo(&applied, present, cut, &who, &reason, at))
    };
    let request = request.map_err(|e| match e {
        sizing::UndoError::NoReason(_) => Failure::usage(e),
        sizing::UndoError::HasCut(_) => negative(format!("{e}: toolmark size undo {} --opposite --reason TEXT", entry.entry)),
        sizing::UndoError::ChangedSince { .. } => negative(e.to_string()),
    })?;
    let dimension = bench.dimension(&entry.dimension)?.clone();
    let row = Row {
        before_mm: present,
        after_mm: Some(request.to),
        of: Some(entry.entry),
        ..Row::new(what, &dimension, &who, &request.why, at)
    };
    let row = bench.keep(&mut directory, &row, Some(&request))?;
    tell(&bench, &[row], common)
}

/// Who takes an entry back or tells of a new tool: somebody who may.
fn who_may(directory: &mut DataDirectory, at: Timestamp, common: &Common) -> Result<String, Failure> {
    let acting = Acting::of(directory, common)?;
    acting.must(Action::EnterSize, directory, at)?;
    Ok(acting.name)
}

/// A part was cut with an entry in force: a program was run on the machine since, or a later part was measured.
fn has_cut(bench: &Bench, directory: &DataDirectory, entry: &Row) -> Result<bool, Failure> {
    let later = |r: &Row| r.entry > entry.entry && r.what == What::Entered && r.register == entry.register && r.part > entry.part;
    Ok(bench.history.iter().any(later)
        || directory
            .has_run_since(&bench.kept.machine, entry.entry)
            .map_err(shop::failure)?)
}

/// Runs `new-tool`.
pub(super) fn new_tool(args: &NewToolArgs, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let who = who_may(&mut directory, at, common)?;
    let mut bench = Bench::open(&directory, common)?;
    let rows = put_in(&mut bench, &mut directory, args.offset, &who, common.reason.as_deref(), at)?;
    if rows.is_empty() {
        return Err(Failure::usage(format_args!(
            "job {} has no dimension on offset {}",
            bench.job.name, args.offset
        )));
    }
    tell(&bench, &rows, common)
}

/// A new tool at an offset: the wear registers of its dimensions begin at 0, and their trends begin anew.
///
/// # Errors
/// The disk refuses.
pub fn put_in(
    bench: &mut Bench,
    directory: &mut DataDirectory,
    offset: u32,
    who: &str,
    reason: Option<&str>,
    at: Timestamp,
) -> Result<Vec<Row>, Failure> {
    let why = reason.unwrap_or("a new tool was put in").to_owned();
    let mut rows = Vec::new();
    let mut done = BTreeSet::new();
    for dimension in bench.job.dimensions.clone().iter().filter(|d| d.offset == offset) {
        let before = directory.value(&dimension.register).map_err(shop::failure)?;
        let request = ChangeRequest {
            path: dimension.register.clone(),
            to: 0.0,
            expected: before,
            who: who.to_owned(),
            why: why.clone(),
            when: at,
        };
        // Two dimensions may share a register, which is set to 0 once.
        let change = done.insert(dimension.register.clone()) && before.is_some_and(|b| b != 0.0);
        let row = Row {
            before_mm: before,
            after_mm: Some(0.0),
            ..Row::new(What::NewTool, dimension, who, &why, at)
        };
        rows.push(bench.keep(directory, &row, change.then_some(&request))?);
    }
    Ok(rows)
}

fn tell(bench: &Bench, rows: &[Row], common: &Common) -> Done {
    let mut answers = Vec::new();
    for row in rows {
        let dimension = shown_in(bench.dimension(&row.dimension)?, common);
        let (before, after) = (row.before_mm.unwrap_or(0.0), row.after_mm.unwrap_or(0.0));
        if common.json {
            answers.push(json!({
                "accepted": true,
                "dimension": dimension.name,
                "register": row.register,
                "before": number_in(dimension.unit, before),
                "after": number_in(dimension.unit, after),
                "change": number_in(dimension.unit, row.change()),
                "unit": unit_name(dimension.unit),
                "entry": row.entry,
                "of": row.of,
                "who": row.who,
                "why": row.why,
            }));
        } else {
            let words = |mm| dimension.unit.words(Millimetres(mm));
            say(&format!(
                "{}: {} {} -> {}; {} (entry {})",
                dimension.name,
                row.register,
                words(before),
                words(after),
                row.why,
                row.entry
            ));
        }
    }
    match (common.json, answers.len()) {
        (false, _) => {}
        (true, 1) => print_json(&answers[0])?,
        (true, _) => print_json(&json!({ "accepted": true, "entries": answers }))?,
    }
    Ok(Exit::Good)
}

//! `toolmark edit`: single changes of a STEP-NC file, one after the other, each on what the one before it gave. `guard` says who may.

pub mod guard;

use super::{Done, print_json};
use crate::cli::{Cli, Common, EditArgs};
use crate::failure::{Exit, Failure};
use crate::program::Program;
use crate::{files, say, shop};
use clap::CommandFactory;
use guard::Guard;
use ledger::Hash;
use serde_json::json;
use stepnc::edit::{ChangeError, Insert, ProgramEdits, Target};
use stepnc::select::{SelectError, select, select_spot};
use units::MmPerSec;

/// One change, as it was asked for.
#[derive(Clone, Debug)]
pub struct Change {
    /// The option.
    what: &'static str,
    /// Its values.
    words: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// The file is no STEP-NC, a path means nothing or several things, a part cannot be changed so, or the file cannot be written.
pub fn edit(args: &EditArgs, common: &Common) -> Done {
    let program = Program::open(&args.program, None, None)?;
    let Some(step_nc) = program.step_nc() else {
        return Err(Failure::usage(format_args!(
            "{}: only STEP-NC files are edited; G-code is text",
            args.program.display()
        )));
    };
    let changes = changes(args);
    if step_nc.projects().is_empty() && !changes.is_empty() {
        let found = step_nc.diagnostics().first();
        return Err(found.map_or_else(
            || Failure::unreadable(format_args!("{}: it holds no program", program.name)),
            Failure::unreadable_diagnostic,
        ));
    }
    let original = step_nc.file().bytes();
    let mut bytes = original.to_vec();
    let mut notices: Vec<String> = Vec::new();
    // Without a change there is nothing to be guarded or told.
    let mut guard = if changes.is_empty() {
        None
    } else {
        Some(Guard::open(&program, common)?)
    };
    for change in &changes {
        let before = stepnc::Program::read(&program.name, bytes)
            .map_err(|error| Failure::unreadable(format_args!("{}: {error}", args.program.display())))?;
        let mut edits = ProgramEdits::new(&before);
        edits.write_functions(super::convert::function_form(args.aim_strict));
        apply(&before, &mut edits, change)?;
        let saved = edits.save().map_err(|error| refused(change, error))?;
        for notice in saved.notices {
            if !notices.contains(&notice) {
                notices.push(notice);
            }
        }
        bytes = match &mut guard {
            Some(guard) => guard.pass(&before, saved.bytes, change)?,
            None => saved.bytes,
        };
    }
    let changed = bytes != original;
    let event = match &mut guard {
        Some(guard) if changed => Some(guard.write(&args.out, original, &bytes)?),
        _ => {
            files::write(&args.out, &bytes)?;
            None
        }
    };
    notices.extend(guard.as_ref().and_then(|guard| guard.edited_outside.clone()));
    for notice in &notices {
        shop::notice(notice);
    }
    if common.json {
        print_json(&json!({
            "file": args.out,
            "changed": changed,
            "edits": changes.iter().map(|change| json!({ "edit": change.what, "of": change.words })).collect::<Vec<_>>(),
            "operator": guard.as_ref().map_or_else(|| shop::operator(common), |guard| guard.acting.name.clone()),
            "by": guard.as_ref().map(|guard| guard.acting.json()),
            "reason": common.reason,
            "told": guard.as_ref().map(|guard| &guard.told),
            "event": event.as_ref().map(|event| event.sequence),
            "before_sha256": program.hash.to_string(),
            "after_sha256": Hash::of(&bytes).to_string(),
        }))?;
    } else {
        let what = match (changes.len(), changed) {
            (0, _) => "nothing was asked for: the same bytes".to_owned(),
            (n, false) => format!("{n} edits that change nothing: the same bytes"),
            (1, true) => "1 edit".to_owned(),
            (n, true) => format!("{n} edits"),
        };
        let told = event.map_or_else(String::new, |event| format!(" (event {} of the log)", event.sequence));
        say(&format!("{}: {what}{told}", args.out.display()));
    }
    Ok(Exit::Good)
}

/// The changes in the order in which they stand on the command line, which the parsed arguments no longer tell.
fn changes(args: &EditArgs) -> Vec<Change> {
    let matches = Cli::command().get_matches();
    let matches = matches.subcommand_matches("edit").unwrap_or(&matches);
    let mut found: Vec<(usize, Change)> = Vec::new();
    let mut take = |what: &'static str, id: &str, values: &[String], each: usize| {
        let places: Vec<usize> = matches.indices_of(id).into_iter().flatten().collect();
        for (n, words) in values.chunks(each).enumerate() {
            let place = places.get(n * each).copied().unwrap_or(usize::MAX);
            let words = words.to_vec();
            found.push((place, Change { what, words }));
        }
    };
    take("enable", "enable", &args.enable, 1);
    take("disable", "disable", &args.disable, 1);
    take("feed", "feed", &args.feed, 1);
    take("insert", "insert", &args.insert, 2);
    take("delete", "delete", &args.delete, 1);
    take("move", "moves", &args.moves, 1);
    take("rename", "rename", &args.rename, 1);
    found.sort_by_key(|(place, _)| *place);
    found.into_iter().map(|(_, change)| change).collect()
}

fn apply(program: &stepnc::Program, edits: &mut ProgramEdits<'_>, change: &Change) -> Result<(), Failure> {
    let first = change.words[0].as_str();
    let done = match change.what {
        "enable" => edits.enable(part(program, change, first)?, true),
        "disable" => edits.enable(part(program, change, first)?, false),
        "delete" => edits.delete(spot(program, change, first)?),
        "insert" => {
            let at = target(program, change, first)?;
            let text = change.words[1].as_str();
            if trace::is_line(text)
                && let Err(found) = trace::parse(text)
            {
                return Err(Failure::usage(format_args!(
                    "--insert {first} '{text}': {found}; nothing was written"
                )));
            }
            let what = Insert::from_text(text);
            edits.insert(at, &name_of(&what), &what).map(|_| ())
        }
        "rename" => {
            let (of, name) = halves(program, change, "NAME")?;
            edits.rename(part(program, change, of)?, name)
        }
        "move" => {
            let (from, to) = halves(program, change, "P")?;
            let (from, to) = (spot(program, change, from)?, target(program, change, to)?);
            edits.move_to(from, to)
        }
        _ => {
            let (of, feed) = halves(program, change, "MM_MIN")?;
            let number = feed.trim().parse::<f64>().ok().filter(|feed| *feed > 0.0 && feed.is_finite());
            let Some(per_minute) = number else {
                return Err(Failure::usage(format_args!(
                    "--feed {first}: '{feed}' is no feed in mm/min; a number above 0 was expected, like 600"
                )));
            };
            edits.set_feed(part(program, change, of)?, MmPerSec(per_minute / 60.0))
        }
    };
    done.map_err(|error| refused(change, error))
}

/// `P=VALUE`. Names may hold `=` as well: the split is where the left side is called something.
fn halves<'c>(program: &stepnc::Program, change: &'c Change, value: &str) -> Result<(&'c str, &'c str), Failure> {
    let text = change.words[0].as_str();
    let splits: Vec<(&str, &str)> = text
        .match_indices('=')
        .map(|(at, _)| (&text[..at], &text[at + 1..]))
        .collect();
    let known = |(left, _): &&(&str, &str)| !matches!(select(program, left), Err(SelectError::NotFound(_)));
    match splits.iter().find(known).or(splits.first()) {
        Some(split) => Ok(*split),
        None => Err(Failure::usage(format_args!(
            "--{} {text}: P={value} was expected",
            change.what
        ))),
    }
}

fn part(program: &stepnc::Program, change: &Change, path: &str) -> Result<stepnc::select::Part, Failure> {
    select(program, path).map_err(|error| Failure::usage(format_args!("--{}: {error}", change.what)))
}

fn spot(program: &stepnc::Program, change: &Change, path: &str) -> Result<stepnc::select::Spot, Failure> {
    select_spot(program, path).map_err(|error| Failure::usage(format_args!("--{}: {error}", change.what)))
}

/// Before a part, or with a slash behind it at its end.
fn target(program: &stepnc::Program, change: &Change, path: &str) -> Result<Target, Failure> {
    match path.strip_suffix('/').filter(|head| !head.ends_with('\\')) {
        Some(around) => part(program, change, around).map(Target::EndOf),
        None => spot(program, change, path).map(Target::Before),
    }
}

/// The name of a new function: its kind, or the word behind `trace:1`.
fn name_of(what: &Insert) -> String {
    match what {
        Insert::Function(text) => {
            let words = text.split_whitespace().find(|word| !word.starts_with("trace:"));
            words.unwrap_or("function").chars().take(60).collect()
        }
        Insert::Message(_) => "message".to_owned(),
        Insert::ProgramStop => "program stop".to_owned(),
        Insert::OptionalStop => "optional stop".to_owned(),
        Insert::Workplan(name) => name.clone(),
    }
}

fn refused(change: &Change, error: ChangeError) -> Failure {
    Failure::usage(format_args!("--{} {}: {error}", change.what, change.words[0]))
}

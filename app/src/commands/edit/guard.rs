//! Who may make an edit, and what the log tells of it.
//!
//! Every part of a program has a level (`stepnc::levels`); an edit asks for the strongest level that it touches, gives or takes away. A
//! refused edit writes nothing and stands in the log as T-11; one that is made stands there as a named difference with both hashes.

use super::Change;
use crate::cli::Common;
use crate::cycle_start::{self, Checked};
use crate::failure::Failure;
use crate::people::Acting;
use crate::program::Program;
use crate::{clock, shop};
use ledger::{Action, Event, Hash, Level};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use stepnc::edit::ProgramEdits;
use stepnc::levels::{Levels, Needed, SetLevel, needed, reclassified};
use stepnc::select::{Part, select};
use stepnc::{ExecutableKind, FeedSetting};
use store::{DataDirectory, ProgramEdit, WholeFile};
use units::Timestamp;

/// Reads the text of an extended function for what it says of levels.
pub fn read_level(text: &str) -> Option<Result<SetLevel, String>> {
    if !trace::is_line(text) {
        return None;
    }
    match trace::parse(text) {
        Ok(function) => match function.call {
            trace::Call::SetEditAccessLevel { level, workplan_only } => Some(Ok(SetLevel { level, workplan_only })),
            _ => None,
        },
        Err(found) => {
            // A slip in a line that was meant to guard must not open what it guards.
            let lower = text.to_lowercase();
            let meant = ["access_level", "acces_level", "authorization_level"]
                .iter()
                .any(|word| lower.contains(word));
            meant.then(|| Err(found.message.clone()))
        }
    }
}

/// The levels of a program.
pub fn levels_of(program: &stepnc::Program) -> Levels {
    Levels::of(program, &read_level)
}

/// Edits of one file by one person.
pub struct Guard<'a> {
    directory: DataDirectory,
    /// Who edits.
    pub acting: Acting,
    at: Timestamp,
    why: String,
    program: &'a Program,
    /// The named differences so far.
    pub told: Vec<Value>,
    /// The program as the last change left it.
    last: Option<stepnc::Program>,
    /// A sentence about the file when it was edited outside before.
    pub edited_outside: Option<String>,
}

impl<'a> Guard<'a> {
    /// Opens the log for edits of a program.
    ///
    /// # Errors
    /// Nobody who may edit at all, no reason where there are operators, an edit made outside that the machine file refuses, or the data
    /// directory is in use.
    pub fn open(program: &'a Program, common: &Common) -> Result<Guard<'a>, Failure> {
        let at = clock::start_time(common.start.as_deref())?;
        let mut directory = shop::data_directory(common)?;
        let acting = Acting::of(&directory, common)?;
        acting.must(Action::Edit(Level::LOWEST), &mut directory, at)?;
        let why = common.reason.as_deref().map(str::trim).unwrap_or_default().to_owned();
        if why.is_empty() && !acting.is_local {
            return Err(Failure::usage(
                "an edit needs a reason where there are operators: give --reason TEXT",
            ));
        }
        let machine = crate::program::machine_for(&common.machine, program.turns())?;
        let checked = Checked {
            path: &program.path,
            hash: program.hash,
            what: "edit",
            asked: None,
        };
        let edited_outside = cycle_start::check(&checked, &machine, &acting, &mut directory, common, at)?;
        Ok(Guard {
            directory,
            acting,
            at,
            why,
            program,
            told: Vec::new(),
            last: None,
            edited_outside,
        })
    }

    /// Lets one change pass, or refuses it; gives the bytes with the classifications that follow from it.
    ///
    /// # Errors
    /// T-11: somebody with a stronger level has to make it. The changed file cannot be read.
    pub fn pass(&mut self, before: &stepnc::Program, bytes: Vec<u8>, change: &Change) -> Result<Vec<u8>, Failure> {
        let read = |bytes: Vec<u8>| {
            stepnc::Program::read(&self.program.name, bytes)
                .map_err(|error| Failure::unreadable(format_args!("{}: {error}", self.program.path.display())))
        };
        let (old, mut after) = (levels_of(before), read(bytes.clone())?);
        let (mut new, mut bytes) = (levels_of(&after), bytes);
        let classes = reclassified(&old, &new);
        if !classes.is_empty() {
            let mut edits = ProgramEdits::new(&after);
            edits.classify(&classes).map_err(|error| super::refused(change, error))?;
            bytes = edits.save().map_err(|error| super::refused(change, error))?.bytes;
            after = read(bytes.clone())?;
            new = levels_of(&after);
        }
        let touched = touched(before, change);
        let asked = needed((before, &old), (&after, &new), &touched);
        let level = Level::new(asked.level).unwrap_or(Level::HIGHEST);
        let name = name_of(before, asked.part)
            .or_else(|| name_of(&after, asked.part))
            .unwrap_or_default();
        if let Err(refused) = ledger::may(self.acting.level, Action::Edit(level)) {
            let (part, why) = (asked.part, because(&asked, old.unreadable().get(&asked.part)));
            let said = self.acting.refusal(refused);
            let mut detail = self.acting.detail();
            detail.extend([
                ("code".to_owned(), Value::from("T-11")),
                ("file".to_owned(), self.program.path.display().to_string().into()),
                ("sha256".to_owned(), self.program.hash.to_string().into()),
                ("edit".to_owned(), change.what.into()),
                ("of".to_owned(), json!(change.words)),
                ("part".to_owned(), part.into()),
                ("name".to_owned(), name.as_str().into()),
                ("needed".to_owned(), level.number().into()),
                ("why".to_owned(), self.why.as_str().into()),
            ]);
            self.directory
                .append(self.at, "edit-refused", detail)
                .map_err(shop::failure)?;
            return Err(Failure {
                exit: said.exit,
                message: format!(
                    "error: T-11: --{} {}: '{name}' (#{part}) {why} level {level}; {}; nothing was written",
                    change.what,
                    change.words.join(" "),
                    said.message.trim_start_matches("error: ")
                ),
            });
        }
        let mut told = json!({
            "edit": change.what,
            "of": change.words,
            "level": level.number(),
        });
        if let Some((part, _)) = touched.first() {
            told["part"] = json!({ "id": part.id(), "name": name_of(before, part.id()) });
            told["before"] = words_of(before, *part, change);
            told["after"] = words_of(&after, *part, change);
        }
        if !classes.is_empty() {
            told["classified"] = (classes.iter())
                .map(|(id, level)| json!({ "part": id, "level": level }))
                .collect();
        }
        self.told.push(told);
        self.last = Some(after);
        Ok(bytes)
    }

    /// Writes the edited file, with its event before it takes its name.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&mut self, out: &Path, before: &[u8], after: &[u8]) -> Result<Event, Failure> {
        let writing = |error: &dyn std::fmt::Display| Failure::writing(out, error);
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            return Err(writing(&format_args!("there is no folder {}", folder.display())));
        }
        // A link stays a link, and a file keeps who may read it.
        let place = out.canonicalize().unwrap_or_else(|_| out.to_owned());
        let permissions = place.metadata().map(|found| found.permissions()).ok();
        let mut file = WholeFile::create(&place).map_err(|e| writing(&e))?;
        file.write_all(after).and_then(|()| file.flush()).map_err(|e| writing(&e))?;
        let mut by: BTreeMap<String, Value> = self.acting.detail();
        by.insert("why".to_owned(), self.why.as_str().into());
        if let (Some(first), Some(last)) = (self.program.step_nc(), &self.last) {
            by.insert("instances".to_owned(), instances(first, last));
        }
        let event = self.directory.keep_edit(&ProgramEdit {
            from: &self.program.path,
            to: &place,
            before: Hash::of(before),
            after: Hash::of(after),
            edits: json!(self.told),
            by,
            at: self.at,
        });
        let event = event.map_err(shop::failure)?;
        file.finish().map_err(|e| writing(&e))?;
        if let Some(permissions) = permissions.filter(|_| place.is_file()) {
            std::fs::set_permissions(&place, permissions).map_err(|e| writing(&e))?;
        }
        Ok(event)
    }
}

fn because(asked: &Needed, unreadable: Option<&String>) -> String {
    match (unreadable, asked.by_boundary) {
        (Some(why), _) => format!("would set a level and cannot be read ({why}), which counts as"),
        (None, true) => "would have another level by that, and that asks for".to_owned(),
        (None, false) => "asks for".to_owned(),
    }
}

/// The parts that a change names, and whether it changes what is below them too.
fn touched(program: &stepnc::Program, change: &Change) -> Vec<(Part, bool)> {
    let first = change.words[0].as_str();
    let path = match change.what {
        "insert" => return Vec::new(),
        "enable" | "disable" | "delete" => first,
        _ => super::halves(program, change, "").map_or(first, |(of, _)| of),
    };
    // A shared part is one part, wherever it stands.
    let part = select(program, path)
        .ok()
        .or_else(|| super::spot(program, change, path).ok().map(|spot| spot.part));
    part.map(|part| (part, change.what != "rename")).into_iter().collect()
}

fn name_of(program: &stepnc::Program, id: u64) -> Option<String> {
    match program.executable(id) {
        Some(executable) => Some(executable.name.clone()),
        None if program.operation(id).is_some() => program.operation(id).map(|operation| operation.name.clone()),
        None => program.file().row(id).map(|_| program.toolpath(id).name),
    }
}

/// What a change is about, as it stands in a program.
fn words_of(program: &stepnc::Program, part: Part, change: &Change) -> Value {
    let id = part.id();
    let is_there = program.file().row(id).is_some();
    match change.what {
        _ if !is_there => Value::Null,
        "rename" | "delete" => json!(name_of(program, id)),
        "enable" | "disable" => program
            .executable(id)
            .map_or(Value::Null, |e| json!({ "enabled": e.enabled })),
        "feed" => json!({ "feeds_mm_min": feeds(program, part) }),
        "move" => json!({ "in": parents(program, id) }),
        _ => Value::Null,
    }
}

/// The feeds of a toolpath, or of all below a part, mm/min, each once.
fn feeds(program: &stepnc::Program, part: Part) -> Vec<f64> {
    let mut found: Vec<f64> = Vec::new();
    let mut take = |technology: Option<u64>| {
        let feed = technology.and_then(|id| program.technology(id)).and_then(|t| t.feed);
        if let Some(FeedSetting::PerTime(feed)) = feed {
            // Thousandths of a millimetre a minute are more than any file means.
            let per_minute = (feed.0 * 60.0 * 1e3).round() / 1e3;
            if !found.contains(&per_minute) {
                found.push(per_minute);
            }
        }
    };
    match part {
        Part::Toolpath(id) => take(program.toolpath(id).technology),
        Part::Executable(root) => program.walk(root, &mut |executable, _| {
            let ExecutableKind::Workingstep { operation, .. } = executable.kind else {
                return;
            };
            if let Some(operation) = operation.and_then(|id| program.operation(id)) {
                take(operation.technology);
                operation
                    .toolpaths
                    .iter()
                    .for_each(|path| take(program.toolpath(*path).technology));
            }
        }),
    }
    found
}

/// The names of what a part stands in.
fn parents(program: &stepnc::Program, id: u64) -> Vec<String> {
    let mut found = Vec::new();
    for project in program.projects() {
        program.walk(project.main_workplan, &mut |executable, _| {
            let operation = match executable.kind {
                ExecutableKind::Workingstep { operation, .. } => operation.and_then(|id| program.operation(id)),
                _ => None,
            };
            if executable.children().contains(&id) || operation.is_some_and(|o| o.toolpaths.contains(&id)) {
                found.push(executable.name.clone());
            }
        });
    }
    found
}

/// How many changed instances are written out, and how much of each.
const MOST_INSTANCES: usize = 100;
const MOST_OF_EACH: usize = 1000;

/// The instances that differ, as the file spells them: the difference to the last byte of the data.
fn instances(before: &stepnc::Program, after: &stepnc::Program) -> Value {
    fn text(program: &stepnc::Program, id: u64) -> Option<&[u8]> {
        let file = program.file();
        Some(&file.bytes()[file.span(file.row(id)?)])
    }
    let shown = |bytes: Option<&[u8]>| {
        bytes.map(|bytes| {
            let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MOST_OF_EACH)]);
            if bytes.len() > MOST_OF_EACH {
                format!("{text}...")
            } else {
                text.into_owned()
            }
        })
    };
    let ids = |program: &stepnc::Program| -> Vec<u64> {
        let file = program.file();
        file.rows().map(|row| file.id(row)).collect()
    };
    let all: std::collections::BTreeSet<u64> = ids(before).into_iter().chain(ids(after)).collect();
    let mut count = 0;
    let mut differing = Vec::new();
    for id in all {
        let (old, new) = (text(before, id), text(after, id));
        if old != new {
            count += 1;
            if differing.len() < MOST_INSTANCES {
                differing.push(json!({ "id": id, "before": shown(old), "after": shown(new) }));
            }
        }
    }
    json!({ "count": count, "first": differing })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_is_meant_to_guard_and_has_a_slip_is_no_open_door() {
        let read = |text| read_level(text).map(|r| r.map(|s| (s.level, s.workplan_only)).map_err(|_| ()));
        assert_eq!(read("trace:1 set_edit_access_level its_level=4"), Some(Ok((Some(4), false))));
        assert_eq!(
            read("trace:1 set_authorization_level level=2 scope=workplan"),
            Some(Ok((Some(2), true)))
        );
        assert_eq!(read("trace:1 set_edit_access_level"), Some(Ok((None, false))));
        assert_eq!(read("trace:1 set_edit_access_level its_level=11"), Some(Err(())));
        assert_eq!(read("trace:2 set_edit_access_level its_level=4"), Some(Err(())));
        assert_eq!(read("trace:1 get_time"), None);
        assert_eq!(read("trace:1 no_such_function its_level=4"), None);
        assert_eq!(read("set_edit_access_level its_level=4"), None);
        assert_eq!(read(""), None);
    }
}

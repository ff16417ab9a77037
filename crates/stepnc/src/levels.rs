//! Edit access levels: who may change which part of a program. [`Levels`] says what each part asks for, [`needed`] what an edit asks for.
//!
//! A level comes from two places, and the stronger one counts. A `set_edit_access_level` function holds from its place for the rest of
//! the program, or, with the scope workplan, to the end of the workplan that it stands in. A security classification named `edit access
//! level` says it of a part itself, wherever that is moved to. Levels go from 1, the strongest, to 10; a part of which nothing says
//! anything has 10.
//!
//! A function counts unless it is disabled itself. Below a disabled part it counts to the end of that part: what is guarded there stays
//! guarded when it is enabled again, and the parts behind it are as they run.
//!
//! How the text of a function is read is the caller's: this crate knows what a program consists of, not what its functions mean.

use crate::model::{ExecutableKind, Program};
use crate::select::Part;
use std::collections::{BTreeMap, BTreeSet};

/// The level of what nothing speaks of.
pub const DEFAULT: u8 = 10;
/// Name of the security classification that holds a level.
pub const CLASSIFICATION: &str = "edit access level";

/// A `set_edit_access_level` function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetLevel {
    /// The level, 1 to 10; `None` is back to the default.
    pub level: Option<u8>,
    /// True when it ends with the workplan that it stands in.
    pub workplan_only: bool,
}

/// Reads the text of an extended function: `None` when it sets no level; an error when it would, and cannot be understood.
pub type ReadLevel<'r> = dyn Fn(&str) -> Option<Result<SetLevel, String>> + 'r;

/// What a part asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartLevel {
    /// The level.
    pub level: u8,
    /// What its place asks for, without its own classification.
    pub by_place: u8,
    /// The function that its place has it from; `None` for the default.
    pub by: Option<u64>,
}

/// The level of each part of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    executables: BTreeMap<u64, PartLevel>,
    /// What classifications say, of anything.
    classified: BTreeMap<u64, u8>,
    /// Functions that would set a level and cannot be understood, and why.
    unreadable: BTreeMap<u64, String>,
}

impl Levels {
    /// Reads the levels of a program.
    pub fn of(program: &Program, read: &ReadLevel<'_>) -> Levels {
        let mut levels = Levels {
            classified: classified(program),
            ..Levels::default()
        };
        for project in program.projects() {
            let mut walk = Walk {
                program,
                read,
                levels: &mut levels,
                rest: NOTHING,
                workplans: Vec::new(),
                above: BTreeSet::new(),
                visited: 0,
            };
            walk.part(project.main_workplan);
        }
        levels
    }

    /// What an executable or an operation asks for.
    pub fn executable(&self, id: u64) -> PartLevel {
        let own = self.classified.get(&id).copied().unwrap_or(DEFAULT);
        let place = self.executables.get(&id).copied().unwrap_or(PartLevel {
            level: DEFAULT,
            by_place: DEFAULT,
            by: None,
        });
        PartLevel {
            level: place.level.min(own),
            ..place
        }
    }

    /// What a part asks for; a toolpath asks for what its workingsteps ask for, or more.
    pub fn part(&self, program: &Program, part: Part) -> u8 {
        let own = self.executable(part.id()).level;
        let Part::Toolpath(id) = part else {
            return own;
        };
        let of_operation = |operation: u64| {
            let holds = program.operation(operation).is_some_and(|o| o.toolpaths.contains(&id));
            holds.then(|| self.executable(operation).level)
        };
        let steps = self
            .executables
            .keys()
            .filter_map(|&step| match program.executable(step)?.kind {
                ExecutableKind::Workingstep { operation, .. } => Some(self.executable(step).level.min(of_operation(operation?)?)),
                _ => None,
            });
        steps.fold(own, u8::min)
    }

    /// The strongest level of a part and of all below it, and what has it.
    pub fn strongest_below(&self, program: &Program, part: Part) -> (u8, u64) {
        let mut strongest = (self.part(program, part), part.id());
        let mut ask = |level: u8, id: u64| {
            if level < strongest.0 {
                strongest = (level, id);
            }
        };
        if let Part::Executable(root) = part {
            program.walk(root, &mut |executable, _| {
                ask(self.executable(executable.id).level, executable.id);
                if let ExecutableKind::Workingstep {
                    operation: Some(operation),
                    ..
                } = executable.kind
                {
                    ask(self.executable(operation).level, operation);
                    let paths = program.operation(operation).map_or(&[][..], |o| &o.toolpaths);
                    for path in paths.iter().filter(|path| self.classified.contains_key(path)) {
                        ask(self.executable(*path).level, *path);
                    }
                }
            });
        }
        strongest
    }

    /// The strongest level anywhere in the program, and what has it.
    pub fn strongest(&self) -> (u8, u64) {
        let places = self.executables.iter().map(|(id, at)| (at.level, *id));
        let own = self.classified.iter().map(|(id, level)| (*level, *id));
        places.chain(own).min().unwrap_or((DEFAULT, 0))
    }

    /// Functions that would set a level and cannot be understood, and why: they count as level 1.
    pub fn unreadable(&self) -> &BTreeMap<u64, String> {
        &self.unreadable
    }

    /// What a classification says of a part.
    pub fn classification(&self, id: u64) -> Option<u8> {
        self.classified.get(&id).copied()
    }

    fn ids(&self) -> impl Iterator<Item = u64> + '_ {
        self.executables.keys().copied()
    }
}

/// What an edit asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needed {
    /// The level.
    pub level: u8,
    /// The part that asks for it.
    pub part: u64,
    /// True when that part was not touched by itself: its level would be another one, or was.
    pub by_boundary: bool,
}

/// The strongest level that an edit asks for: of what it touches, with all below that, before and after; of what is new or gone; and of
/// everything whose level changes, by that which is the stronger of before and after.
pub fn needed(before: (&Program, &Levels), after: (&Program, &Levels), touched: &[(Part, bool)]) -> Needed {
    let mut needed = Needed {
        level: DEFAULT,
        part: touched.first().map_or(0, |(part, _)| part.id()),
        by_boundary: false,
    };
    let mut ask = |level: u8, part: u64, by_boundary: bool| {
        if level < needed.level {
            needed = Needed {
                level,
                part,
                by_boundary,
            };
        }
    };
    for (program, levels) in [before, after] {
        for (part, with_all_below) in touched {
            let (level, id) = if *with_all_below {
                levels.strongest_below(program, *part)
            } else {
                (levels.part(program, *part), part.id())
            };
            ask(level, id, false);
        }
    }
    let all: BTreeSet<u64> = before.1.ids().chain(after.1.ids()).collect();
    for id in all {
        let (was, is) = (before.1.executables.contains_key(&id), after.1.executables.contains_key(&id));
        let (old, new) = (before.1.executable(id).level, after.1.executable(id).level);
        match (was, is) {
            (true, true) if old != new => ask(old.min(new), id, true),
            (true, false) => ask(old, id, false),
            (false, true) => ask(new, id, false),
            _ => {}
        }
    }
    needed
}

/// The parts whose classification has to follow a level function that came, went or was moved: part, and its level from now on.
///
/// Only what the functions decide is touched: a part whose classification says something else than its place did keeps it.
pub fn reclassified(before: &Levels, after: &Levels) -> Vec<(u64, Option<u8>)> {
    let mut changes = Vec::new();
    for (&id, now) in &after.executables {
        let was = before.executables.get(&id);
        let moved = was.is_none_or(|was| (was.by, was.by_place) != (now.by, now.by_place));
        let wanted = now.by.map(|_| now.by_place).filter(|level| *level < DEFAULT);
        let own = after.classified.get(&id).copied();
        let from_place = was.and_then(|was| was.by.map(|_| was.by_place));
        if moved && own != wanted && (own.is_none() || own == from_place) {
            changes.push((id, wanted));
        }
    }
    changes
}

/// What the security classifications of a file say: the strongest of each part.
fn classified(program: &Program) -> BTreeMap<u64, u8> {
    let mut found = BTreeMap::new();
    for assignment in assignments(program) {
        for id in assignment.items {
            let level = found.entry(id).or_insert(assignment.level);
            *level = assignment.level.min(*level);
        }
    }
    found
}

/// An assignment of an edit access level in a file.
pub(crate) struct Assignment {
    pub(crate) id: u64,
    pub(crate) classification: u64,
    pub(crate) level_instance: u64,
    pub(crate) level: u8,
    pub(crate) items: Vec<u64>,
}

pub(crate) fn assignments(program: &Program) -> Vec<Assignment> {
    let aim = program.aim();
    let keyword = "APPLIED_SECURITY_CLASSIFICATION_ASSIGNMENT";
    let rows = aim.file.by_keyword(keyword).filter(|&row| aim.file.keyword(row) == keyword);
    let read = |id: u64| -> Option<Assignment> {
        let assignment = aim.instance(id).ok()?;
        let classification = assignment.argument(0).reference()?;
        let said = aim.instance(classification).ok()?;
        let name = said.argument(0).text().unwrap_or_default();
        if !name.trim().eq_ignore_ascii_case(CLASSIFICATION) {
            return None;
        }
        let level_instance = said.argument(2).reference()?;
        let level = aim.instance(level_instance).ok()?;
        let number = level.argument(0).text().and_then(|text| text.trim().parse::<u8>().ok());
        Some(Assignment {
            id,
            classification,
            level_instance,
            // A level that cannot be read guards like the strongest one, until somebody who may repairs it.
            level: number.filter(|n| (1..=DEFAULT).contains(n)).unwrap_or(1),
            items: assignment.argument(1).references().collect(),
        })
    };
    rows.filter_map(|row| read(aim.file.id(row))).collect()
}

/// A level and the function that set it.
#[derive(Clone, Copy)]
struct Held {
    level: u8,
    by: Option<u64>,
}

const NOTHING: Held = Held {
    level: DEFAULT,
    by: None,
};

struct Walk<'w> {
    program: &'w Program,
    read: &'w ReadLevel<'w>,
    levels: &'w mut Levels,
    /// For the rest of the program.
    rest: Held,
    /// By the workplans around, the innermost last.
    workplans: Vec<Option<Held>>,
    above: BTreeSet<u64>,
    visited: u64,
}

/// More than this many visits is a file in which workplans are shared over and over; the rest of it is level 1 then.
const MOST_VISITS: u64 = 2_000_000;

impl Walk<'_> {
    fn in_force(&self) -> Held {
        let innermost = self.workplans.iter().rev().find_map(|held| *held);
        innermost.unwrap_or(self.rest)
    }

    fn part(&mut self, id: u64) {
        let Some(executable) = self.program.executable(id) else {
            return;
        };
        if !self.above.insert(id) {
            return;
        }
        self.visited += 1;
        let lost = self.visited > MOST_VISITS;
        let held = if lost { Held { level: 1, by: None } } else { self.in_force() };
        let mut level = held.level;
        let before = (!executable.enabled).then(|| (self.rest, self.workplans.clone()));
        if let ExecutableKind::Function(function) = &executable.kind
            && let Some(set) = (self.read)(&function.text)
        {
            let set = set.unwrap_or_else(|why| {
                self.levels.unreadable.insert(id, why);
                SetLevel {
                    level: Some(1),
                    workplan_only: false,
                }
            });
            // Whoever takes it out lowers what it guards, and whoever takes out a return to the default raises it.
            level = level.min(set.level.unwrap_or(DEFAULT));
            if executable.enabled {
                self.set(id, set);
            }
        }
        self.put(id, level, held);
        if !lost {
            let is_workplan = matches!(executable.kind, ExecutableKind::Workplan(_));
            if is_workplan {
                self.workplans.push(None);
            }
            for child in executable.children() {
                self.part(child);
            }
            if is_workplan {
                self.workplans.pop();
            }
        }
        if let Some((rest, workplans)) = before {
            (self.rest, self.workplans) = (rest, workplans);
        }
        self.above.remove(&id);
    }

    fn set(&mut self, id: u64, set: SetLevel) {
        let held = match set.level {
            Some(level) => Held { level, by: Some(id) },
            None => NOTHING,
        };
        match self.workplans.last_mut().filter(|_| set.workplan_only) {
            Some(innermost) => *innermost = Some(held),
            None => {
                self.rest = held;
                self.workplans.iter_mut().for_each(|around| *around = None);
            }
        }
    }

    /// A part that is executed at several places asks for the strongest of them.
    fn put(&mut self, id: u64, level: u8, held: Held) {
        let new = PartLevel {
            level,
            by_place: held.level,
            by: held.by,
        };
        let kept = self.levels.executables.entry(id).or_insert(new);
        if new.level < kept.level {
            *kept = new;
        }
    }
}

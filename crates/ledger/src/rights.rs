//! Who may do what: one table of actions and levels, and the one function that every command asks.
//!
//! Levels go from 1, the highest, to 10. Not signed in is no level, and not the lowest one. An element of a program has a level of its
//! own, which is part of the action [`Action::Edit`].

use std::fmt;
use std::fmt::Write;
use thiserror::Error;

/// A level of rights: 1 is the highest, 10 the lowest. The smaller number is the stronger level, and compares so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Level(u8);

impl Level {
    /// May do everything.
    pub const HIGHEST: Level = Level(1);
    /// What a new operator has, what a lapsed qualification counts as, and what a program asks that says nothing of levels.
    pub const LOWEST: Level = Level(10);

    /// A level by its number; `None` outside 1 to 10.
    pub const fn new(number: u8) -> Option<Level> {
        if matches!(number, 1..=10) { Some(Level(number)) } else { None }
    }
    /// Its number.
    pub const fn number(self) -> u8 {
        self.0
    }
    /// All of them, the highest first.
    pub fn all() -> impl Iterator<Item = Level> {
        (1..=10).map(Level)
    }
    /// True when somebody with this level may do what asks for `needed`.
    pub fn reaches(self, needed: Level) -> bool {
        self <= needed
    }
    /// The stronger of two.
    pub fn stronger(self, other: Level) -> Level {
        self.min(other)
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Something that a person asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    /// Look at anything.
    Look,
    /// STOP, and feed hold: whoever sees the danger.
    Stop,
    /// Cycle start, homing and jog.
    Run,
    /// Cycle start in the middle of a program: a wrong place is a crash.
    Restart,
    /// Cycle start of a program with synchronized actions that outlive it (ALL MODES).
    StartAllModes,
    /// End a synchronized action of ALL MODES by hand.
    EndAllModes,
    /// Run a program that was edited outside although the machine file refuses that.
    AcceptOutsideEdit,
    /// Change an element of a program that asks for this level.
    Edit(Level),
    /// Enter a measured size, take an entry back, tell of a new tool.
    EnterSize,
    /// A size whose correction is beyond the largest single step.
    ExceedStep,
    /// Say which sizes are entered, with their targets and windows.
    DeclareSizes,
    /// Set the wear of a tool.
    SetWear,
    /// Set a wear by more than the largest step at once.
    SetLargeWear,
    /// Set length, diameter or radius of a tool.
    SetGeometry,
    /// Set a work offset.
    SetWorkOffset,
    /// Keep the records of a job whatever their age.
    Hold,
    /// Let them age again.
    Release,
    /// Record another machine's agent into the data directory.
    Record,
    /// Copy the whole data directory.
    Backup,
    /// Make a data directory of a backup, where there is none.
    Restore,
    /// Write a program in another form, or a recording to a file.
    Convert,
    /// Write the machine file.
    WriteMachineFile,
    /// Make an operator, change a level, take a level away.
    Assign,
}

impl Action {
    /// Every action; an element's level stands for all of them.
    pub const ALL: [Action; 23] = [
        Action::Look,
        Action::Stop,
        Action::Run,
        Action::Restart,
        Action::StartAllModes,
        Action::EndAllModes,
        Action::AcceptOutsideEdit,
        Action::Edit(Level::LOWEST),
        Action::EnterSize,
        Action::ExceedStep,
        Action::DeclareSizes,
        Action::SetWear,
        Action::SetLargeWear,
        Action::SetGeometry,
        Action::SetWorkOffset,
        Action::Hold,
        Action::Release,
        Action::Record,
        Action::Backup,
        Action::Restore,
        Action::Convert,
        Action::WriteMachineFile,
        Action::Assign,
    ];

    /// The level that it asks for; `None` when nobody needs to be signed in for it.
    pub fn needs(self) -> Option<Level> {
        let number = match self {
            Action::Edit(level) => return Some(level),
            Action::Run | Action::EnterSize | Action::Hold | Action::Record => 10,
            Action::StartAllModes => 6,
            Action::Restart | Action::SetWear | Action::SetWorkOffset => 5,
            Action::EndAllModes => 4,
            Action::AcceptOutsideEdit | Action::ExceedStep | Action::DeclareSizes => 3,
            Action::SetLargeWear | Action::SetGeometry | Action::Release => 3,
            Action::WriteMachineFile | Action::Assign => 2,
            Action::Look | Action::Stop | Action::Backup | Action::Restore | Action::Convert => return None,
        };
        Some(Level(number))
    }

    /// Why nobody needs to be signed in for it; `None` where somebody does.
    pub fn why_free(self) -> Option<&'static str> {
        match self {
            Action::Look => Some("who looks changes nothing"),
            Action::Stop => Some("whoever sees the danger stops the machine"),
            Action::Backup => Some("a copy changes nothing, and one that waits for a person is not made"),
            Action::Restore => Some("it makes a data directory where there is none, and nothing can ask who may in none"),
            Action::Convert => Some("it writes a new file and changes nothing that is kept"),
            _ => None,
        }
    }

    /// What it is, in words: `to set the wear of a tool`.
    pub fn words(self) -> &'static str {
        match self {
            Action::Look => "to look",
            Action::Stop => "to stop or hold the feed",
            Action::Run => "to run a program",
            Action::Restart => "to start in the middle of a program",
            Action::StartAllModes => "to start a program with actions in all modes",
            Action::EndAllModes => "to end an action of all modes",
            Action::AcceptOutsideEdit => "to run a program that was edited outside",
            Action::Edit(_) => "to edit this part of the program",
            Action::EnterSize => "to enter a size, or take one back",
            Action::ExceedStep => "to exceed the largest single step",
            Action::DeclareSizes => "to say which sizes are entered",
            Action::SetWear => "to set the wear of a tool",
            Action::SetLargeWear => "to change a wear so much at once",
            Action::SetGeometry => "to set the geometry of a tool",
            Action::SetWorkOffset => "to set a work offset",
            Action::Hold => "to put a job on hold",
            Action::Release => "to release a job",
            Action::Record => "to record a machine into the data directory",
            Action::Backup => "to make a backup",
            Action::Restore => "to restore a backup",
            Action::Convert => "to convert a program or a recording",
            Action::WriteMachineFile => "to write the machine file",
            Action::Assign => "to make operators and give levels",
        }
    }

    /// Its word in the log: `set-wear`.
    pub fn word(self) -> &'static str {
        match self {
            Action::Look => "look",
            Action::Stop => "stop",
            Action::Run => "run",
            Action::Restart => "restart",
            Action::StartAllModes => "start-all-modes",
            Action::EndAllModes => "end-all-modes",
            Action::AcceptOutsideEdit => "accept-outside-edit",
            Action::Edit(_) => "edit",
            Action::EnterSize => "enter-size",
            Action::ExceedStep => "exceed-step",
            Action::DeclareSizes => "declare-sizes",
            Action::SetWear => "set-wear",
            Action::SetLargeWear => "set-large-wear",
            Action::SetGeometry => "set-geometry",
            Action::SetWorkOffset => "set-work-offset",
            Action::Hold => "hold",
            Action::Release => "release",
            Action::Record => "record",
            Action::Backup => "backup",
            Action::Restore => "restore",
            Action::Convert => "convert",
            Action::WriteMachineFile => "write-machine-file",
            Action::Assign => "assign",
        }
    }
}

/// Somebody may not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub struct NotAllowed {
    /// What was asked for.
    pub action: Action,
    /// Who asked; `None` is not signed in.
    pub level: Option<Level>,
    /// What it takes.
    pub needed: Level,
}

impl fmt::Display for NotAllowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let least = match self.needed {
            Level::HIGHEST => "level 1".to_owned(),
            Level::LOWEST => "an operator who is signed in".to_owned(),
            level => format!("level {level} or better"),
        };
        write!(f, "{} takes {least}, and ", self.action.words())?;
        match self.level {
            Some(level) => write!(f, "this is level {level}"),
            None => f.write_str("nobody is signed in"),
        }
    }
}

/// The one question: may somebody with this level do that? `None` is not signed in.
///
/// # Errors
/// No: with what it takes.
pub fn may(level: Option<Level>, action: Action) -> Result<(), NotAllowed> {
    match (level, action.needs()) {
        (_, None) => Ok(()),
        (Some(level), Some(needed)) if level.reaches(needed) => Ok(()),
        (_, Some(needed)) => Err(NotAllowed { action, level, needed }),
    }
}

/// The whole table as text, for the manual and its test: a line an action, a column a level, and behind what is free the reason.
pub fn table() -> String {
    let mut text = String::from("action                  -  1  2  3  4  5  6  7  8  9 10\n");
    let mut line = |name: &str, action: Action| {
        let levels = std::iter::once(None).chain(Level::all().map(Some));
        let marks: String = levels
            .map(|level| if may(level, action).is_ok() { "  +" } else { "  ." })
            .collect();
        let why = action.why_free().map_or_else(String::new, |why| format!("  {why}"));
        let _ = writeln!(text, "{name:<22}{marks}{why}");
    };
    for action in Action::ALL {
        match action {
            Action::Edit(_) => Level::all().for_each(|level| line(&format!("edit (element {level})"), Action::Edit(level))),
            action => line(action.word(), action),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_one_to_ten_and_nothing_else() {
        assert_eq!(Level::new(0), None);
        assert_eq!(Level::new(11), None);
        assert_eq!(Level::all().filter_map(|l| Level::new(l.number())).count(), 10);
        assert_eq!(Level::HIGHEST.stronger(Level::LOWEST), Level::HIGHEST);
    }

    #[test]
    fn who_is_not_signed_in_may_do_what_changes_nothing_and_stop() {
        for action in Action::ALL {
            let free = [Action::Look, Action::Stop, Action::Backup, Action::Restore, Action::Convert];
            assert_eq!(may(None, action).is_ok(), free.contains(&action), "{action:?}");
            assert_eq!(action.why_free().is_some(), free.contains(&action), "{action:?} says why");
            assert!(may(Some(Level::HIGHEST), action).is_ok(), "{action:?}");
        }
    }

    #[test]
    fn a_stronger_level_may_all_that_a_weaker_one_may() {
        let levels: Vec<Level> = Level::all().collect();
        for action in Action::ALL.into_iter().chain(Level::all().map(Action::Edit)) {
            for pair in levels.windows(2) {
                assert!(
                    may(Some(pair[0]), action).is_ok() || may(Some(pair[1]), action).is_err(),
                    "{action:?}"
                );
            }
        }
    }

    #[test]
    fn a_refusal_says_what_it_takes() {
        let said = |level: Option<u8>, action| may(level.and_then(Level::new), action).expect_err("no").to_string();
        assert_eq!(
            said(Some(7), Action::SetWear),
            "to set the wear of a tool takes level 5 or better, and this is level 7"
        );
        assert_eq!(
            said(None, Action::Run),
            "to run a program takes an operator who is signed in, and nobody is signed in"
        );
        assert_eq!(
            said(Some(2), Action::Edit(Level::HIGHEST)),
            "to edit this part of the program takes level 1, and this is level 2"
        );
    }
}

//! How much of a function a control can do.

use serde::Serialize;
use std::fmt;

/// The grades, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Grade {
    /// The control does it by itself, as the function means it.
    Native,
    /// Done by statements between blocks: not in the servo cycle, and where the control reads ahead, before the tool is there.
    BlockBoundary,
    /// The program cannot; a recorder beside the control can.
    External,
    /// Nobody can on this control, or not as this line asks.
    Refused,
}

impl Grade {
    /// The word of the JSON contract.
    pub const fn word(self) -> &'static str {
        match self {
            Grade::Native => "native",
            Grade::BlockBoundary => "block-boundary",
            Grade::External => "external",
            Grade::Refused => "refused",
        }
    }
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// How a function was posted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The grade.
    pub grade: Grade,
    /// Why, and what it means for the record.
    pub reason: String,
    /// Every word that was written for it is known from a manual; else it has to be verified at commissioning.
    pub verified: bool,
}

impl Verdict {
    /// Done by the control itself.
    pub fn native(verified: bool, reason: impl Into<String>) -> Self {
        Verdict {
            grade: Grade::Native,
            reason: reason.into(),
            verified,
        }
    }
    /// Done between blocks.
    pub fn between_blocks(verified: bool, reason: impl Into<String>) -> Self {
        Verdict {
            grade: Grade::BlockBoundary,
            reason: reason.into(),
            verified,
        }
    }
    /// Left to a recorder; nothing was written that could be wrong.
    pub fn external(reason: impl Into<String>) -> Self {
        Verdict {
            grade: Grade::External,
            reason: reason.into(),
            verified: true,
        }
    }
    /// Not done.
    pub fn refused(reason: impl Into<String>) -> Self {
        Verdict {
            grade: Grade::Refused,
            reason: reason.into(),
            verified: true,
        }
    }
}

/// A row of the table: functions of one name with one verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Row {
    /// The function's name, or the kind of an executable that no vocabulary knows.
    pub name: String,
    /// Its grade.
    pub grade: Grade,
    /// Why.
    pub reason: String,
    /// False: verify at commissioning.
    pub verified: bool,
    /// How many times the program has it.
    pub count: u32,
    /// Where it stands first: `#123`, or the line.
    pub place: String,
}

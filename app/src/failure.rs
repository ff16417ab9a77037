//! How a command ends when it does not end well: what is said, and with which exit code.

use plan::{Alarm, Diagnostic};
use std::fmt;

/// The exit codes of every command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done and good.
    Good = 0,
    /// Done, and the verdict is negative: check failed, alarm, out of tolerance.
    Negative = 1,
    /// Wrong usage.
    Usage = 2,
    /// The input cannot be read.
    Unreadable = 3,
    /// Machine, network or lock.
    Machine = 4,
}

/// Exit code of a fault of ours, set by the panic hook.
pub const OUR_FAULT: u8 = 70;

/// What stopped a command.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// With which code to end.
    pub exit: Exit,
    /// What happened, where, and what to do; one line a finding.
    pub message: String,
}

impl Failure {
    /// The command was called wrongly.
    pub fn usage(message: impl fmt::Display) -> Self {
        Failure {
            exit: Exit::Usage,
            message: format!("error: {message}"),
        }
    }
    /// An input cannot be read.
    pub fn unreadable(message: impl fmt::Display) -> Self {
        Failure {
            exit: Exit::Unreadable,
            message: format!("error: {message}"),
        }
    }
    /// An input cannot be read, as its reader says.
    pub fn unreadable_diagnostic(diagnostic: &Diagnostic) -> Self {
        Failure {
            exit: Exit::Unreadable,
            message: diagnostic.to_string(),
        }
    }
    /// The machine, the network, the disk or a lock.
    pub fn machine(message: impl fmt::Display) -> Self {
        Failure {
            exit: Exit::Machine,
            message: format!("error: {message}"),
        }
    }
    /// The work was done and its outcome is bad.
    pub fn negative(message: impl fmt::Display) -> Self {
        Failure {
            exit: Exit::Negative,
            message: message.to_string(),
        }
    }
    /// A file could not be written.
    pub fn writing(path: &std::path::Path, error: impl fmt::Display) -> Self {
        Failure::machine(format_args!(
            "{} cannot be written: {error}; check the folder and the free space",
            path.display()
        ))
    }
}

impl From<Alarm> for Failure {
    fn from(alarm: Alarm) -> Self {
        Failure::negative(alarm)
    }
}

impl From<&Diagnostic> for Failure {
    fn from(diagnostic: &Diagnostic) -> Self {
        Failure::negative(diagnostic)
    }
}

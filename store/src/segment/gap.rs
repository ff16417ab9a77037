//! Gaps: rows that are not there, and why.

use serde::{Deserialize, Serialize};

/// Rows that were lost between two that are there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// The first lost one: tick of a record, sequence of an agent.
    pub from: u64,
    /// The last lost one.
    pub to: u64,
    /// How many, as they were counted when they were lost.
    pub count: u64,
    /// Why.
    pub cause: Cause,
}

/// Why rows were lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// The ring between sampling and disk was full: the disk was too slow.
    RingFull,
    /// The disk was full.
    DiskFull,
    /// The disk refused for another reason.
    DiskFailed,
    /// The source had thrown them away before they were asked for, or was not reached.
    Source,
    /// The row could not be kept: a number that no column holds, or a tick that does not rise.
    Unreadable,
    /// Bytes of a segment were damaged.
    Damage,
}

impl Cause {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            Cause::RingFull => "the disk was too slow",
            Cause::DiskFull => "the disk was full",
            Cause::DiskFailed => "the disk refused",
            Cause::Source => "the source did not give them",
            Cause::Unreadable => "they could not be kept",
            Cause::Damage => "a file was damaged",
        }
    }
}

impl std::fmt::Display for Gap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Gap { from, to, count, cause } = self;
        write!(f, "{count} rows from {from} to {to} are missing: {}", cause.text())
    }
}

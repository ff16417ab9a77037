//! What could not be had: a stretch of the agent's numbers without observations.

use units::Timestamp;

/// A stretch that is missing from a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Which start of the agent the numbers belong to: its `instanceId`.
    pub instance: u64,
    /// The first number that is missing.
    pub from_sequence: u64,
    /// The last number that is missing; `None` when nobody knows any more.
    pub to_sequence: Option<u64>,
    /// Why.
    pub cause: GapCause,
    /// Time of the last observation before it, when there is one.
    pub from: Option<Timestamp>,
    /// Time of the first observation after it, when there is one.
    pub to: Option<Timestamp>,
}

/// Why a stretch is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GapCause {
    /// The agent's buffer had no place for it any more when it was asked for.
    Overrun,
    /// The agent was started anew, and its buffer with it.
    AgentRestart,
    /// The agent's answer cannot be read.
    Unreadable,
    /// It could not be written when it came, and was gone when it could be.
    NotStored,
}

impl GapCause {
    /// As records and answers have it.
    pub fn word(self) -> &'static str {
        match self {
            GapCause::Overrun => "overrun",
            GapCause::AgentRestart => "agent-restart",
            GapCause::Unreadable => "unreadable",
            GapCause::NotStored => "not-stored",
        }
    }

    /// The cause of that word.
    pub fn of(word: &str) -> Option<GapCause> {
        [
            GapCause::Overrun,
            GapCause::AgentRestart,
            GapCause::Unreadable,
            GapCause::NotStored,
        ]
        .into_iter()
        .find(|cause| cause.word() == word)
    }
}

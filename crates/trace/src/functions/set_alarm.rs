//! `set_alarm`.

use super::{Block, Call, Definition, LOG, key, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "set_alarm",
    also: &[],
    block: Block::General,
    groups: &[
        &[
            required("its_alarm_id", Kind::Integer(1, 999), "its number"),
            required("its_text", Kind::Text, "what the operator reads"),
            key(
                "its_reaction",
                Kind::Word(&["none", "feed_hold", "stop_after_operation", "stop_now"]),
                "what the machine does; by default none",
            ),
            key(
                "reset_by",
                Kind::Word(&["function", "acknowledge", "reset"]),
                "what ends it; by default acknowledge",
            ),
        ],
        LOG,
    ],
    doc: "Raises an alarm. The same number while it is active updates nothing and is counted.",
    record: "number, text, reaction, cycle of the condition, cycle of the effect",
    example: "trace:1 set_alarm its_alarm_id=1 its_text=\"over time\" its_reaction=feed_hold",
    is_action: true,
    measure: None,
    call: |given| {
        Call::SetAlarm(Alarm {
            id: given.small("its_alarm_id"),
            text: given.text("its_text").unwrap_or_default(),
            reaction: match given.word("its_reaction") {
                Some("feed_hold") => Reaction::FeedHold,
                Some("stop_after_operation") => Reaction::StopAfterOperation,
                Some("stop_now") => Reaction::StopNow,
                _ => Reaction::None,
            },
            reset_by: match given.word("reset_by") {
                Some("function") => ResetBy::Function,
                Some("reset") => ResetBy::Reset,
                _ => ResetBy::Acknowledge,
            },
        })
    },
};

/// An alarm of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Its number, 1 to 999.
    pub id: u16,
    /// What the operator reads.
    pub text: String,
    /// What the machine does.
    pub reaction: Reaction,
    /// What ends it.
    pub reset_by: ResetBy,
}

/// What the machine does at an alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reaction {
    /// Nothing.
    #[default]
    None,
    /// It slows down on the path; cycle start goes on.
    FeedHold,
    /// It waits for cycle start where the present operation ends.
    StopAfterOperation,
    /// A controlled stop, for good.
    StopNow,
}

impl Reaction {
    /// The word of `its_reaction`.
    pub const fn word(self) -> &'static str {
        match self {
            Reaction::None => "none",
            Reaction::FeedHold => "feed_hold",
            Reaction::StopAfterOperation => "stop_after_operation",
            Reaction::StopNow => "stop_now",
        }
    }
}

/// What ends an alarm besides `clear_alarm`, which always does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResetBy {
    /// Nothing else.
    Function,
    /// The operator, who goes on or acknowledges.
    #[default]
    Acknowledge,
    /// A reset of the control.
    Reset,
}

impl ResetBy {
    /// The word of `reset_by`.
    pub const fn word(self) -> &'static str {
        match self {
            ResetBy::Function => "function",
            ResetBy::Acknowledge => "acknowledge",
            ResetBy::Reset => "reset",
        }
    }
}

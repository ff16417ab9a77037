//! What lives in the machine, asked by somebody who does not drive it: the question, the answer, and the realtime thread's part of it.
//!
//! The realtime thread tells numbers only, a few in each cycle ([`Lives`]). The words that belong to them stay with the receiving task, which
//! had them with the load.

use super::message::Name;
use super::wire::{wire_enum, wire_struct};
use crate::watch::{Living, Watches};
use units::Tick;

/// Ends that the realtime thread is asked for and has not answered at most.
pub const ENDS_UNDER_WAY: usize = 16;
/// Places of watches that one step of a list looks at.
const PLACES: usize = 256;

/// Somebody asks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inquiry {
    /// Who, in the words that the controller's own log has.
    pub name: Name,
    /// What.
    pub what: Asked,
}
wire_struct!(Inquiry { name, what });

/// What is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// What lives in the machine.
    Living,
    /// That it ends something.
    End {
        /// By its number on the list.
        mark: u32,
    },
}
wire_enum!(Asked {
    1 = Living,
    2 = End { mark },
});

/// The beginning of an answer; behind it stand `count` of [`AnswerEntry`], each with its words. What was asked to end stands there as it was
/// at its end, or nothing does: nothing of all modes lives under that number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnswerHead {
    /// The machine's name.
    pub machine: Name,
    /// The machine's cycle.
    pub now: Tick,
    /// How many follow in this frame.
    pub count: u16,
    /// No frame follows.
    pub last: bool,
}
wire_struct!(AnswerHead {
    machine,
    now,
    count,
    last
});

/// Something that lives in the machine. Behind it stands the line that started it, its length in bytes before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnswerEntry {
    /// What the machine knows of it.
    pub living: Living,
    /// Whose run loaded it.
    pub by: Name,
}
wire_struct!(AnswerEntry { living, by });

/// What the realtime thread tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lives {
    /// A list begins; what came of one before it does not count.
    Begin,
    /// This lives.
    One(Living),
    /// The list is whole.
    Whole,
    /// What was to be ended is over.
    Ended {
        /// The mark that was said.
        mark: u32,
        /// It as it was; `None`: nothing of all modes has this mark.
        what: Option<Living>,
    },
}

/// A list in the making.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sweep {
    /// None.
    Over,
    /// One is to begin.
    Asked,
    /// It goes on at this place.
    At(usize),
}

impl Sweep {
    /// The next of it; `None`: it is over, or this step came to nothing that runs.
    pub fn next(&mut self, watches: &Watches) -> Option<Lives> {
        let from = match *self {
            Sweep::Over => return None,
            Sweep::Asked => {
                *self = Sweep::At(0);
                return Some(Lives::Begin);
            }
            Sweep::At(from) => from,
        };
        let (found, next) = watches.living(from, PLACES);
        if found.is_none() && next >= watches.places() {
            *self = Sweep::Over;
            return Some(Lives::Whole);
        }
        *self = Sweep::At(next);
        found.map(Lives::One)
    }
}

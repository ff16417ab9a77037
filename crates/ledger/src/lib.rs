//! The chained log: what happened, in order, so that nobody can change it afterwards without being seen.
//!
//! Every [`Event`] carries its sequence number and the hash of its predecessor. Every change of a process value (a tool offset, a work
//! offset, a setting) goes through one function, [`change`], and is an event: who, when, why, before, after. The store only keeps what
//! this crate makes; it invents no events of its own.
//!
//! Who may ask for what is here too, because whoever changes something asks it first: [`rights`] is the table of actions and levels,
//! [`operator`] says who has which.
//!
//! Why a crate of its own: machine, sizing, trace and store all write events and none of them may own the chain
//! (`docs/decisions/0001-ledger.md`).

mod change;
mod event;
pub mod operator;
pub mod rights;

pub use change::{Change, ChangeError, ChangeRequest, ProgramLine, Registers, change, change_by_program};
pub use event::{Broken, Chain, Event, Hash, Hashing, verify};
pub use operator::Operator;
pub use rights::{Action, Level, NotAllowed, may};

//! Measured size in, offset change out.
//!
//! A person types what the gauge says, and nothing else. Target, sign, register and the window of believable entries come from the
//! [`Dimension`]; [`enter`] checks the entry, works out the change and says in words what it will do; the result carries a
//! `ledger::ChangeRequest`, because this crate changes nothing itself. [`undo`] and [`opposite`] take a change back.
//!
//! The law, for a register that counts as the size does (a diameter offset and a diameter): `wear := wear + (target - measured)`, for
//! outside and inside alike, because the register moves the tip and not the wall; half of it for a register that counts radii; with the
//! other sign where a larger register makes the size smaller.
//!
//! Read on: [`job`] for the file in which a job declares its sizes, [`dimension`] for what it declares, [`proposal`] for one
//! made from a design, [`entry`] for reading a number as
//! people type it, [`correction`] for checks and law, [`taking_back`] for undo, [`history`] for what is kept of an entry, [`trend`] for
//! what several tell together, [`control`] and [`generate`] for macro programs of real controls.

pub mod control;
pub mod correction;
pub mod dimension;
pub mod entry;
pub mod generate;
pub mod history;
pub mod job;
pub mod proposal;
pub mod taking_back;
pub mod trend;

pub use correction::{Correction, Entry, EntryError, Others, Present, Verdict, enter};
pub use dimension::{Column, Conflict, Dimension, DimensionError, Kind, Response, Role, one_controls_each_register};
pub use entry::{NotASize, Unit};
pub use job::{Job, MachineAxes};
pub use taking_back::{Applied, UndoError, opposite, undo};

//! G-code of mills and lathes, with Custom Macro B: text in, the one program stream out.
//!
//! The main type is [`GcodeProgram`], a [`plan::ProgramStream`] over a file of any size: it is read in windows, block by block, and a
//! block's steps are handed on before the next one is read. Families of controls are data ([`PROFILES`]); [`detect()`] guesses the family
//! and says why. [`inspect`](inspect::inspect) makes the tree of any program stream.
//!
//! What it deliberately does not do yet, and alarms about with line and column: threads with a variable lead, corners beside arcs, and
//! compensation inside cycles of a mill.
//!
//! Read on: [`program`] for the stream, `interpreter` for the meaning of a block, `cycles` for blocks that stand for many moves,
//! `compensation` for the path beside the contour, `shaping` for rotation and the like, [`macro_b`] for the values of macros, `flow` for jumps, loops and calls,
//! [`interpret`] for a program without a machine, [`profile`] for what differs between controls.

mod acting;
mod arc;
mod awaited;
mod block;
mod calls;
mod compensation;
mod corner;
mod cycles;
pub mod detect;
mod evaluate;
mod expression;
mod fault;
mod flow;
pub mod inspect;
pub mod interpretation;
mod interpreter;
mod interruption;
mod line;
mod listing;
pub mod macro_b;
mod motion;
mod offsets;
pub mod parameters;
mod printing;
pub mod profile;
pub mod program;
mod shaping;
mod statement;
mod system_variables;
mod text;

pub use detect::{Detected, detect};
pub use interpretation::{Interpretation, Setup, interpret};
pub use macro_b::Value;
pub use parameters::Parameters;
pub use profile::{PROFILES, Profile};
pub use program::{GcodeProgram, Options, WholeNumbers};

//! Whole programs for other controls: motion, tools, technology, control flow and the traceability functions.
//!
//! [`post()`] reads a [`plan::flow::StructuredProgram`] twice, once for what the head has to say, and writes it for a [`Control`] of
//! [`CONTROLS`]. Branches and loops are kept in the control's own words. Every function gets a grade ([`Grade`]); what is native stands
//! in the reference, and words that no manual was at hand for are marked: verify at commissioning.
//!
//! What it deliberately does not do: radius compensation (paths are those of the tool's centre), tilted planes, more than one channel.
//! What cannot be said on a control is refused with its place and never left out in silence.
//!
//! Read on: [`statement`] for what there is to say, a file of [`controls`] for how one control says it, [`functions`] for grades,
//! [`table`] for the manual's table.

mod alike;
pub mod condition;
pub mod control;
pub mod controls;
mod fingerprint;
pub mod functions;
pub mod grade;
mod head;
mod iso;
mod letters;
mod macro_b;
mod motion;
mod number;
mod posting;
mod sheet;
pub mod source;
pub mod statement;
pub mod table;
mod threading;

pub use control::Control;
pub use controls::{CONTROLS, by_name};
pub use grade::{Grade, Row, Verdict};
pub use letters::Letters;
pub use number::Decimals;
pub use posting::{Open, Options, Posted, post};
pub use sheet::{Modal, Paper, Refusal, Sheet, Way};

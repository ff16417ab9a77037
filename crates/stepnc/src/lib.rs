//! STEP-NC (ISO 10303-238, "AP238"): a machining program that says what is machined and not only how axes move.
//!
//! [`Program::read`] opens the stored form (AIM) of editions 1 to 3 and answers in the words of the shop: projects, workplans,
//! workingsteps, operations, toolpaths, tools, set-ups. [`StepNcStream`] runs it as a [`plan::ProgramStream`]. [`inspect`] gives the
//! tree that `toolmark inspect` prints. [`twin`] writes what really happened back into the file and reads it again.
//!
//! Readers are tolerant: what is odd becomes one [`plan::Diagnostic`] a kind, what cannot be run becomes an alarm when the stream comes
//! to it, and nothing that the file does not say is made up. ISO 14649 (ARM) files are recognised and not run.
//!
//! Read on: [`model`] for what a program consists of, [`stream`] for running it, [`twin`] for as-executed models.

mod aim;
mod arm;
pub mod curve;
mod date;
pub mod dimensions;
pub mod edit;
mod expression;
pub mod inspect;
pub mod model;
mod named;
pub mod problems;
pub mod select;
pub mod stream;
pub mod twin;
mod unit;
pub mod write;

pub use model::{
    Dwell, Executable, ExecutableKind, Feature, FeedSetting, Fixture, Function, MachineFunctions, Operation, Program, Project,
    Setup, SpindleSetting, Technology, Tool, Toolpath, ToolpathKind, TwinFacts,
};
pub use part21::ReadError;
pub use plan::inspection::{NamedValue, Quantity};
pub use stream::{PathFrame, StepNcStream, StreamOptions};
pub use twin::write_new;

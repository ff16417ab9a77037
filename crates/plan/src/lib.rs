//! The narrow waist of the house: what a machining program *does*, whatever it was written in.
//!
//! A reader (STEP-NC, G-code, a live job) is a [`ProgramStream`]: it is asked for the next [`Step`] and may ask back. The planner, the
//! recorder and the rebuild know only this crate. It knows neither STEP nor G-code, and it opens nothing: text comes through a
//! [`ByteSource`], other files through a [`Resolver`].
//!
//! Read on: [`stream`] for the conversation, [`step`] for what a program can ask of a machine, [`path`] for geometry, [`modal`] for
//! what is in force, [`flow`] for a program with both ways of its branches, [`executed`] for the model of what really happened,
//! [`diagnostic`] for remarks about somebody's file, [`inspection`] for the tree of a program as plain data.

pub mod comment;
pub mod diagnostic;
pub mod executed;
pub mod expression;
pub mod flow;
pub mod inspection;
pub mod line;
pub mod modal;
pub mod path;
pub mod step;
pub mod stream;
pub mod tables;
pub mod written;

pub use diagnostic::{Alarm, Diagnostic, Diagnostics, Severity};
pub use expression::{Expression, Value};
pub use modal::Modal;
pub use path::{Arc, Path, Spline};
pub use step::{
    CoolantState, Feed, FileId, FrameChange, Level, MachineMove, Marker, Move, Origin, PathMode, Place, RawNcFunction, Register,
    RegisterChange, Speed, SpeedProfile, SpindleMode, SpindleState, Step, StepKind, StopKind, Thread, ToolCall, ToolOffset,
};
pub use stream::{
    Answer, ByteSource, MemorySource, Next, NoOtherFiles, ProgramStream, Question, ReadError, Resolver, restart_at,
};
pub use tables::{Missing, Tables, ToolEntry};

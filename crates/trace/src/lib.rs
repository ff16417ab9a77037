//! The traceability functions of a program: what they are, how they are written, and what they mean.
//!
//! A function is one line, `trace:1 get_time its_label="first part"`: the text of an extended NC function in STEP-NC, a condition along a
//! path, or a comment in G-code. [`parse`] makes a [`Function`] of it, `to_string` writes it again; [`FUNCTIONS`] is every one there is,
//! from which the manual, the schema's mapping table and the tests are made.
//!
//! [`survey::Survey`] looks at a program before it runs, [`compile`] makes conditions of the realtime half's kind, and
//! [`record::Recorder`] does, cycle by cycle, what the functions say.
//!
//! Read on: [`functions`] for the vocabulary, [`sensor`] for the names of values, [`comment`] for G-code.

pub mod comment;
pub mod compile;
pub mod condition;
mod fault;
mod function;
pub mod functions;
mod ids;
mod lines;
mod moment;
pub mod record;
pub mod sensor;
pub mod survey;
mod typed;
pub mod unit;
mod value;

pub use function::{Argument, Function, PREFIX, meant, parse};
pub use functions::{Call, Definition, FUNCTIONS};
pub use lines::functions as functions_of;
pub use plan::line::is_line;
pub use value::{Kind, Sampling, Value};

//! ISO 10303-21, the text form of STEP files: read, look up, change a little, write back.
//!
//! [`File::read`] takes the bytes and indexes them in one pass: where each instance stands, which keyword it has, and who refers to
//! whom. Parameters are parsed when they are asked for ([`File::instance`]), so that a file of some hundred megabytes opens in
//! seconds and costs little more memory than its bytes. Broken instances are reported as [`Problem`]s and left out of the index;
//! reading goes on at the next one. [`Edits`] changes single instances and leaves every other byte as it was.
//!
//! The crate knows no schema: what a keyword means is the business of its users. It opens no files; it is useful alone.
//!
//! ```
//! let text = "ISO-10303-21;HEADER;ENDSEC;DATA;#1=POINT('a',(0.,1.5));#2=LINE(#1,$);ENDSEC;END-ISO-10303-21;";
//! let file = part21::File::read(text.as_bytes().to_vec())?;
//! let line = file.by_keyword("LINE").next().expect("the file has one");
//! assert_eq!(file.id(line), 2);
//! assert_eq!(file.inverse(1), &[line]);
//! # Ok::<(), part21::ReadError>(())
//! ```
//!
//! Read on: [`mod@file`] for the index and its queries, [`value`] for parameters, [`text`] for strings and numbers, [`edit`] for saving.

mod column;
pub mod edit;
pub mod file;
mod keywords;
pub mod problem;
mod scan;
pub mod text;
pub mod value;

pub use edit::{EditError, Edits, Saved};
pub use file::{Anchor, DataSection, External, ExternalName, File, HeaderEntry, Row};
pub use problem::{Position, Problem, ReadError};
pub use value::{Instance, Record, Value};

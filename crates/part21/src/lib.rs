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
//! use part21::{Edits, File, Value};
//!
//! let text = "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('DEMO'));\nENDSEC;\nDATA;\n\
//!             #1=POINT('a',(0.,1.5));\n#2=LINE(#1,$);\n#3=BROKEN('no end);\n#4=(NAMED('x')LENGTH(2.5));\nENDSEC;\nEND-ISO-10303-21;\n";
//! let file = File::read(text.as_bytes().to_vec())?;
//!
//! // What is broken is named, and the rest is there.
//! let problem = &file.problems()[0];
//! assert_eq!((problem.code, problem.line, problem.column), ("unterminated-string", 8, 11));
//! assert_eq!(file.len(), 3);
//!
//! // Who refers to the point?
//! let line = file.by_keyword("LINE").next().expect("the file has one");
//! assert_eq!((file.id(line), file.inverse(1)), (2, &[line][..]));
//!
//! // Parameters are parsed now.
//! let point = file.instance(file.row(1).expect("it is there")).expect("it is well formed");
//! assert_eq!(point.argument(1).items()[1].number(), Some(1.5));
//! let complex = file.instance(file.row(4).expect("it is there")).expect("it is well formed");
//! assert_eq!(complex.part("LENGTH"), Some(&[Value::Real(2.5)][..]));
//!
//! // A change touches its own bytes only.
//! let mut edits = Edits::new(&file);
//! edits.replace(line, "LINE(#1,.T.)")?;
//! let saved = edits.save()?;
//! assert_eq!(saved.bytes, text.replace("#2=LINE(#1,$);", "#2=LINE(#1,.T.);").into_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is read
//!
//! Editions 1 to 3: strings in all encodings, comments and print directives anywhere, complex instances, user-defined entities, identifiers
//! up to 2^64 - 1, several DATA sections, ANCHOR and REFERENCE sections with their tags, SIGNATURE sections (kept, not verified; a changed
//! file loses them with a notice). Reading takes time in proportion to the bytes, whatever they are, and at its peak about a third of the
//! file's size besides the bytes themselves.
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

//! What was wrong in a file, and where: [`Problem`] for everything reading can live with, [`ReadError`] for what it cannot.

use std::collections::BTreeMap;
use std::fmt;

/// A place in a file as an editor shows it: both numbers start at 1, columns count bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Line, from 1.
    pub line: u64,
    /// Byte in the line, from 1.
    pub column: u64,
}

impl Position {
    /// The place of `offset` in `bytes`; counts the lines, so ask for the few places a person will see.
    pub fn of(bytes: &[u8], offset: usize) -> Self {
        let before = &bytes[..offset.min(bytes.len())];
        let line = before.iter().filter(|&&byte| byte == b'\n').count() as u64 + 1;
        let line_start = before
            .iter()
            .rposition(|&byte| byte == b'\n')
            .map_or(0, |newline| newline + 1);
        Self {
            line,
            column: (before.len() - line_start) as u64 + 1,
        }
    }
}

/// One kind of mistake in a file, at its first place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The kind, a stable word such as `unterminated-string`.
    pub code: &'static str,
    /// What is wrong, in a sentence for the person who has the file.
    pub message: String,
    /// Byte offset of the first place.
    pub offset: u64,
    /// Line of the first place, from 1.
    pub line: u64,
    /// Byte in that line, from 1.
    pub column: u64,
    /// How often this kind was met.
    pub count: u64,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "line {}, column {}: {} [{}]",
            self.line, self.column, self.message, self.code
        )?;
        if self.count > 1 {
            write!(f, " ({} times)", self.count)?;
        }
        Ok(())
    }
}

/// Why bytes cannot be read as a Part 21 file at all.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// There are no bytes.
    #[error("the file is empty")]
    Empty,
    /// The bytes are not text.
    #[error("the file is binary, not a STEP text file (byte {byte:#04x} at offset {offset})")]
    Binary {
        /// The first byte that no text holds.
        byte: u8,
        /// Where it stands.
        offset: u64,
    },
    /// The bytes are text of another kind.
    #[error("this is not a STEP file: it begins with {beginning:?} instead of ISO-10303-21;")]
    NotPart21 {
        /// The first characters of the file.
        beginning: String,
    },
    /// More than 2^32 instances or references.
    #[error("the file has more than 4 294 967 295 instances or references")]
    TooLarge,
}

/// Problems by kind, the first place of each kind kept.
#[derive(Default)]
pub(crate) struct Problems(BTreeMap<&'static str, (usize, String, u64)>);

impl Problems {
    pub(crate) fn add(&mut self, code: &'static str, offset: usize, message: impl FnOnce() -> String) {
        self.0
            .entry(code)
            .and_modify(|entry| entry.2 += 1)
            .or_insert_with(|| (offset, message(), 1));
    }

    /// The problems in the order of the file.
    pub(crate) fn finish(self, bytes: &[u8]) -> Vec<Problem> {
        let mut list: Vec<Problem> = self
            .0
            .into_iter()
            .map(|(code, (offset, message, count))| {
                let Position { line, column } = Position::of(bytes, offset);
                Problem {
                    code,
                    message,
                    offset: offset as u64,
                    line,
                    column,
                    count,
                }
            })
            .collect();
        list.sort_by_key(|problem| problem.offset);
        list
    }
}

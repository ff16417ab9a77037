//! What stops a program, on its way to becoming a [`plan::Alarm`]: known by its byte in the line until the line's place is added.

use plan::{Alarm, Diagnostic, Question};

/// A result of reading or executing part of a block.
pub(crate) type Outcome<T> = Result<T, Box<Fault>>;

/// Why a block cannot be executed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fault {
    /// The control's alarm number; 0 when it has none.
    pub number: u32,
    /// The kind, stable for scripts.
    pub code: &'static str,
    pub message: String,
    pub remedy: String,
    /// The byte of the line it is about, from 0.
    pub at: usize,
    /// It is no fault: the block waits until the machine has answered this, and is executed again.
    pub ask: Option<Question>,
}

impl Fault {
    pub(crate) fn new(
        at: usize,
        number: u32,
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Box<Self> {
        Box::new(Fault {
            number,
            code,
            message: message.into(),
            remedy: remedy.into(),
            at,
            ask: None,
        })
    }

    /// Something that real controls know and this reader does not yet.
    pub(crate) fn not_there_yet(at: usize, what: &str) -> Box<Self> {
        Fault::new(
            at,
            0,
            "not-there-yet",
            format!("{what} is not there yet"),
            "leave it out, or write the moves out by the CAM system",
        )
    }

    /// The alarm, with file, line and column.
    pub(crate) fn into_alarm(self, file: &str, site: Site<'_>) -> Alarm {
        Alarm {
            number: self.number,
            diagnostic: Diagnostic::error(self.code, self.message)
                .in_file(file)
                .at_line(site.number, site.column(self.at))
                .remedy(self.remedy),
        }
    }
}

/// The line being executed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Site<'a> {
    /// Its bytes without the line end.
    pub text: &'a [u8],
    /// Its 1-based number.
    pub number: u32,
}

impl Site<'_> {
    /// The 1-based column, in characters, of a byte: comments may be UTF-8 or one byte a character (cp1252).
    pub(crate) fn column(&self, at: usize) -> u32 {
        let before = &self.text[..at.min(self.text.len())];
        let characters = std::str::from_utf8(before).map_or(before.len(), |s| s.chars().count());
        u32::try_from(characters).unwrap_or(u32::MAX - 1) + 1
    }
}

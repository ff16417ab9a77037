//! Changing a file: [`Edits`] collects changes, [`Edits::save`] writes the bytes; everything else stays as it was.
//!
//! Text that is put in is checked to be well formed first: readers are tolerant, writers are strict.

use crate::file::{File, Row};
use crate::problem::Problem;
use crate::value::Parser;
use std::collections::BTreeMap;
use std::ops::Range;

/// Why a change was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// The new text is no entity with parameters.
    #[error("{text:?} is not an instance: {reason}")]
    Syntax {
        /// The text that was given.
        text: String,
        /// Why it cannot be written.
        reason: String,
    },
    /// Nothing can be added to a file whose DATA section has no end.
    #[error("the DATA section has no end (the file is truncated): repair the file first")]
    NoDataSection,
    /// There is no such header entry or parameter.
    #[error("the header has no {keyword} with parameter {parameter}")]
    NoHeaderEntry {
        /// The entry asked for.
        keyword: String,
        /// The parameter asked for, from 0.
        parameter: usize,
    },
    /// There is no such parameter.
    #[error("#{id} has no parameter {parameter} that could be set")]
    NoParameter {
        /// The instance.
        id: u64,
        /// The parameter asked for, from 0.
        parameter: usize,
    },
    /// Identifiers are used up.
    #[error("no identifier is left above #{0}")]
    NoIdentifier(u64),
}

/// The bytes of a saved file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saved {
    /// What to write.
    pub bytes: Vec<u8>,
    /// What the person should know, such as a dropped signature.
    pub notices: Vec<String>,
}

/// Changes to a file, not yet written.
pub struct Edits<'f> {
    file: &'f File,
    /// By start: what stands there instead.
    changes: BTreeMap<usize, (usize, String)>,
    appended: String,
    next_id: u64,
}

impl<'f> Edits<'f> {
    /// No changes.
    pub fn new(file: &'f File) -> Self {
        Self {
            file,
            changes: BTreeMap::new(),
            appended: String::new(),
            next_id: file.highest_id().saturating_add(1),
        }
    }

    /// Replaces what stands behind `#id=` with `body`, such as `POINT('',(0.,1.))`, without semicolon.
    ///
    /// # Errors
    /// When `body` is not well formed.
    pub fn replace(&mut self, row: Row, body: &str) -> Result<(), EditError> {
        check(body)?;
        let span = self.file.span(row);
        self.forget(&span);
        self.put(span, format!("#{}={body};", self.file.id(row)));
        Ok(())
    }

    /// Sets one parameter of an instance and leaves every other byte of it as it was; `part` names the part of a complex instance,
    /// `literal` is written as it is.
    ///
    /// # Errors
    /// When there is no such parameter, or `literal` is no value.
    pub fn set_parameter(&mut self, row: Row, part: Option<&str>, parameter: usize, literal: &str) -> Result<(), EditError> {
        check(&format!("X({literal})"))?;
        let span = self.parameter_span(row, part, parameter).ok_or(EditError::NoParameter {
            id: self.file.id(row),
            parameter,
        })?;
        self.put(span, literal.into());
        Ok(())
    }

    /// A parameter of an instance as the file spells it; changes that are not saved yet do not show.
    pub fn parameter(&self, row: Row, part: Option<&str>, parameter: usize) -> Option<&'f str> {
        std::str::from_utf8(&self.file.bytes()[self.parameter_span(row, part, parameter)?]).ok()
    }

    fn parameter_span(&self, row: Row, part: Option<&str>, parameter: usize) -> Option<Range<usize>> {
        let mut parser = Parser::new(self.file.bytes(), self.file.span(row).start);
        parser.expect(b'#').ok()?;
        parser.digits()?;
        parser.expect(b'=').ok()?;
        parser.skip_blanks();
        match part {
            None => {
                parser.keyword();
            }
            Some(wanted) => {
                parser.expect(b'(').ok()?;
                loop {
                    parser.skip_blanks();
                    let keyword = parser.keyword();
                    if keyword == wanted {
                        break;
                    }
                    parser.expect(b'(').ok()?;
                    parser.list().ok()?;
                }
            }
        }
        parser.expect(b'(').ok()?;
        nth_value(&mut parser, parameter)
    }

    /// Takes an instance out, with its line when it has one of its own. Who refers to it is the caller's business.
    pub fn delete(&mut self, row: Row) {
        let mut span = self.file.span(row);
        let bytes = self.file.bytes();
        let line_starts = span.start == 0 || bytes[span.start - 1] == b'\n';
        let rest = &bytes[span.end..];
        let newline = if rest.starts_with(b"\r\n") {
            2
        } else {
            usize::from(rest.starts_with(b"\n"))
        };
        if line_starts {
            span.end += newline;
        }
        self.forget(&span);
        self.put(span, String::new());
    }

    /// Adds an instance with a new identifier, which is the answer.
    ///
    /// # Errors
    /// When `body` is not well formed.
    pub fn append(&mut self, body: &str) -> Result<u64, EditError> {
        check(body)?;
        let id = self.next_id;
        self.next_id = id.checked_add(1).ok_or(EditError::NoIdentifier(id))?;
        self.appended.push_str(&format!("#{id}={body};{}", self.newline()));
        Ok(id)
    }

    /// The identifier that the next appended instance gets.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    /// Sets a parameter of a header entry, for example parameter 1 of `FILE_NAME`, the time stamp; `literal` as it is written.
    ///
    /// # Errors
    /// When there is no such parameter, or `literal` is no value.
    pub fn set_header(&mut self, keyword: &str, parameter: usize, literal: &str) -> Result<(), EditError> {
        let missing = || EditError::NoHeaderEntry {
            keyword: keyword.into(),
            parameter,
        };
        check(&format!("X({literal})"))?;
        let entry = self
            .file
            .header()
            .iter()
            .find(|entry| entry.keyword == keyword)
            .ok_or_else(missing)?;
        let mut parser = Parser::new(self.file.bytes(), entry.span.start);
        parser.keyword();
        parser.expect(b'(').map_err(|_| missing())?;
        let span = nth_value(&mut parser, parameter).ok_or_else(missing)?;
        self.put(span, literal.into());
        Ok(())
    }

    /// True when saving would give other bytes.
    pub fn is_changed(&self) -> bool {
        !self.changes.is_empty() || !self.appended.is_empty()
    }

    /// The file's bytes with the changes; without any, the very bytes that were read.
    ///
    /// # Errors
    /// When there are new instances and no place for them.
    pub fn save(&self) -> Result<Saved, EditError> {
        let bytes = self.file.bytes();
        if !self.is_changed() {
            return Ok(Saved {
                bytes: bytes.to_vec(),
                notices: Vec::new(),
            });
        }
        let mut spans: Vec<(Range<usize>, &str)> = self
            .changes
            .iter()
            .map(|(&start, (end, text))| (start..*end, text.as_str()))
            .collect();
        if !self.appended.is_empty() {
            let end = self.file.data_sections().last().and_then(|section| section.end);
            let end = end.ok_or(EditError::NoDataSection)?;
            spans.push((end..end, &self.appended));
        }
        let mut notices = Vec::new();
        for span in &self.file.signatures {
            spans.push((span.clone(), ""));
        }
        if self.file.is_signed() {
            notices.push("the file was signed; the signature is dropped, because it signs bytes that have changed".into());
        }
        spans.sort_by_key(|(span, _)| span.start);
        let mut out = Vec::with_capacity(bytes.len() + self.appended.len());
        let mut copied = 0;
        for (span, text) in spans {
            out.extend_from_slice(&bytes[copied..span.start.max(copied)]);
            out.extend_from_slice(text.as_bytes());
            copied = span.end.max(copied);
        }
        out.extend_from_slice(&bytes[copied..]);
        Ok(Saved { bytes: out, notices })
    }

    /// Changes inside of `span` that were asked for before.
    fn forget(&mut self, span: &Range<usize>) {
        self.changes.retain(|start, _| !span.contains(start));
    }

    fn put(&mut self, span: Range<usize>, text: String) {
        self.changes.insert(span.start, (span.end, text));
    }

    /// What follows an appended instance: the line end that the file uses; nothing when its ENDSEC begins no line, so that taking the
    /// instance out again leaves no trace.
    fn newline(&self) -> &'static str {
        let bytes = self.file.bytes();
        let end = self.file.data_sections().last().and_then(|section| section.end);
        if end.is_some_and(|end| end > 0 && bytes[end - 1] != b'\n') {
            return "";
        }
        match bytes.iter().position(|&byte| byte == b'\n') {
            Some(place) if place > 0 && bytes[place - 1] == b'\r' => "\r\n",
            _ => "\n",
        }
    }
}

impl From<EditError> for Problem {
    fn from(error: EditError) -> Self {
        Problem {
            code: "edit",
            message: error.to_string(),
            offset: 0,
            line: 0,
            column: 0,
            count: 1,
        }
    }
}

/// Where the `n`-th value of the list at the parser stands; its `(` is read.
fn nth_value(parser: &mut Parser, n: usize) -> Option<Range<usize>> {
    for at in 0.. {
        parser.skip_blanks();
        let start = parser.at;
        parser.value().ok()?;
        if at == n {
            return Some(start..parser.at);
        }
        parser.expect(b',').ok()?;
    }
    None
}

fn check(body: &str) -> Result<(), EditError> {
    let text = format!("{body};");
    let mut parser = Parser::new(text.as_bytes(), 0);
    let outcome = parser.instance();
    let syntax = |reason: String| EditError::Syntax {
        text: body.chars().take(200).collect(),
        reason,
    };
    match outcome {
        Err(fault) => Err(syntax(format!("{} (character {})", fault.message, fault.offset + 1))),
        Ok(_) if parser.at != text.len() => Err(syntax("there is more than one".into())),
        Ok(_) => Ok(()),
    }
}

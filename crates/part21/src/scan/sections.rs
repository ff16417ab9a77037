//! What a file holds besides instances: its beginning, its header, and the sections of edition 3.

use super::Scanner;
use crate::file::{Anchor, DataSection, External, ExternalName, HeaderEntry};
use crate::problem::ReadError;
use crate::text::string_end;
use crate::value::{Fault, Parser, Value};

/// Where the text begins (behind a byte order mark), or why this is no Part 21 file.
pub(super) fn begin(bytes: &[u8]) -> Result<usize, ReadError> {
    let start = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    if bytes.len() == start {
        return Err(ReadError::Empty);
    }
    let mut text = Parser::new(bytes, start);
    text.skip_blanks();
    let rest = &bytes[text.at..];
    let is = |word: &[u8]| rest.len() >= word.len() && rest[..word.len()].eq_ignore_ascii_case(word);
    if is(b"ISO-10303-21") || is(b"HEADER;") {
        return Ok(start);
    }
    let sample = &bytes[..bytes.len().min(4096)];
    if let Some(offset) = sample
        .iter()
        .position(|&byte| byte == 0 || (byte < 0x20 && !byte.is_ascii_whitespace() && byte != 0x0b))
    {
        return Err(ReadError::Binary {
            byte: sample[offset],
            offset: offset as u64,
        });
    }
    if rest.is_empty() {
        return Err(ReadError::Empty);
    }
    Err(ReadError::NotPart21 {
        beginning: String::from_utf8_lossy(&rest[..rest.len().min(40)]).into_owned(),
    })
}

impl Scanner<'_> {
    pub(super) fn open_data(&mut self, parameters: Vec<Value<'static>>, start: usize) {
        self.out.data_sections.push(DataSection {
            parameters,
            start,
            end: None,
        });
    }

    pub(super) fn data_start(&mut self, at: usize) {
        self.text.skip_blanks();
        let mut parameters = Vec::new();
        if self.text.peek() == Some(b'(') {
            self.text.at += 1;
            match self.text.list() {
                Ok(values) => parameters = values.into_iter().map(Value::into_owned).collect(),
                Err(fault) => self.out.problems.add("data-parameters", fault.offset, || {
                    format!("the parameters of a DATA section cannot be read: {}", fault.message)
                }),
            }
        }
        self.end_of_entry();
        self.open_data(parameters, at);
    }

    pub(super) fn header_entry(&mut self) {
        let start = self.text.at;
        let record = self.text.record();
        match record.and_then(|record| self.text.expect(b';').map(|()| record)) {
            Ok(record) => {
                let span = start..self.text.at;
                self.out.header.push(HeaderEntry {
                    keyword: record.keyword.into_owned(),
                    arguments: record.arguments.into_iter().map(Value::into_owned).collect(),
                    span,
                });
            }
            Err(fault) => {
                self.out.problems.add("header", fault.offset, || {
                    format!("a header entry cannot be read: {}", fault.message)
                });
                self.text.at = fault.offset.max(start + 1).min(self.text.bytes.len());
                self.skip_to_next();
            }
        }
    }

    pub(super) fn anchor(&mut self) {
        let start = self.text.at;
        match self.anchor_entry(start) {
            Ok(anchor) => self.out.anchors.push(anchor),
            Err(fault) => {
                let message = || format!("an anchor cannot be read, expected <name>=value;: {}", fault.message);
                self.out.problems.add("anchor", fault.offset, message);
                self.text.at = fault.offset.max(start + 1);
                self.skip_entry();
            }
        }
    }

    fn anchor_entry(&mut self, offset: usize) -> Result<Anchor, Fault> {
        let Value::Resource(name) = self.text.value()? else {
            return self.text.fault("anchor", "the name stands in no angle brackets");
        };
        self.text.expect(b'=')?;
        Ok(Anchor {
            name: name.into_owned(),
            value: self.text.value()?.into_owned(),
            tags: self.tags()?,
            offset,
        })
    }

    /// `{name:value}` as often as it stands there, and the semicolon.
    fn tags(&mut self) -> Result<Vec<(String, Value<'static>)>, Fault> {
        let mut tags = Vec::new();
        loop {
            self.text.skip_blanks();
            if self.text.peek() != Some(b'{') {
                self.text.expect(b';')?;
                return Ok(tags);
            }
            self.text.at += 1;
            self.text.skip_blanks();
            let start = self.text.at;
            let colon = self.text.bytes[start..].iter().take(1000).position(|&byte| byte == b':');
            let Some(length) = colon else {
                return self.text.fault("tag", "a tag is written {name:value}");
            };
            let name = String::from_utf8_lossy(&self.text.bytes[start..start + length])
                .trim()
                .to_owned();
            self.text.at = start + length + 1;
            let value = self.text.value()?.into_owned();
            self.text.expect(b'}')?;
            tags.push((name, value));
        }
    }

    pub(super) fn external(&mut self) {
        let start = self.text.at;
        match self.external_entry(start) {
            Ok(external) => {
                if let ExternalName::Entity(id) = external.name {
                    self.out.highest_id = self.out.highest_id.max(id);
                }
                self.out.externals.push(external);
            }
            Err(fault) => {
                let message = || {
                    format!(
                        "a reference cannot be read, expected #1=<uri>; or @1=<uri>;: {}",
                        fault.message
                    )
                };
                self.out.problems.add("reference-section", fault.offset, message);
                self.text.at = fault.offset.max(start + 1);
                self.skip_entry();
            }
        }
    }

    fn external_entry(&mut self, offset: usize) -> Result<External, Fault> {
        let name = match self.text.value()? {
            Value::Reference(id) => ExternalName::Entity(id),
            Value::ValueReference(id) => ExternalName::Value(id),
            _ => return self.text.fault("reference-section", "neither #1 nor @1 stands before ="),
        };
        self.text.expect(b'=')?;
        let Value::Resource(uri) = self.text.value()? else {
            return self
                .text
                .fault("reference-section", "what is behind = stands in no angle brackets");
        };
        Ok(External {
            name,
            uri: uri.into_owned(),
            tags: self.tags()?,
            offset,
        })
    }

    /// To behind the next semicolon outside strings.
    pub(super) fn skip_entry(&mut self) {
        while let Some(byte) = self.text.peek() {
            self.text.at += 1;
            match byte {
                b';' => return,
                b'\'' => self.text.at = string_end(self.text.bytes, self.text.at).unwrap_or(self.text.at),
                b'\n' if self.begins_entry(self.text.at) => return,
                _ => {}
            }
        }
    }

    pub(super) fn signature(&mut self, start: usize) {
        let rest = &self.text.bytes[self.text.at..];
        match rest.windows(7).position(|window| window == b"ENDSEC;") {
            Some(length) => self.text.at += length + 7,
            None => {
                self.out
                    .problems
                    .add("signature", start, || "a SIGNATURE section is not closed by ENDSEC;".into());
                self.text.at = self.text.bytes.len();
            }
        }
        self.out.signatures.push(start..self.text.at);
    }
}

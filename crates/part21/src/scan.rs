//! The one pass over a file: sections, instances, keywords and references.
//!
//! It looks at each byte once and parses no parameters. References are kept as a byte stream of differences (target minus own
//! identifier, variable length): they are near their users, so most take one or two bytes, and the peak stays below half the file.

mod sections;

use crate::column::Column;
use crate::file::{Anchor, DataSection, External, HeaderEntry};
use crate::keywords::Keywords;
use crate::problem::{Problems, ReadError};
use crate::text::{closes, string_end};
use crate::value::{Parser, is_word};
use std::ops::Range;

pub(crate) struct Scan {
    pub(crate) ids: Column,
    pub(crate) offsets: Column,
    pub(crate) keywords: Vec<u16>,
    pub(crate) names: Keywords,
    /// Per instance, in file order: differences as variable-length numbers from 1, then 0.
    pub(crate) forward: Vec<u8>,
    pub(crate) reference_count: u64,
    pub(crate) ascending: bool,
    pub(crate) highest_id: u64,
    pub(crate) header: Vec<HeaderEntry>,
    pub(crate) data_sections: Vec<DataSection>,
    pub(crate) anchors: Vec<Anchor>,
    pub(crate) externals: Vec<External>,
    pub(crate) signatures: Vec<Range<usize>>,
    pub(crate) unclosed_comment: Option<usize>,
    pub(crate) problems: Problems,
}

pub(crate) fn scan(bytes: &[u8]) -> Result<Scan, ReadError> {
    let start = sections::begin(bytes)?;
    let mut scanner = Scanner {
        text: Parser::new(bytes, start),
        out: Scan {
            ids: Column::new(),
            offsets: Column::new(),
            keywords: Vec::new(),
            names: Keywords::new(),
            forward: Vec::new(),
            reference_count: 0,
            ascending: true,
            highest_id: 0,
            header: Vec::new(),
            data_sections: Vec::new(),
            anchors: Vec::new(),
            externals: Vec::new(),
            signatures: Vec::new(),
            unclosed_comment: None,
            problems: Problems::default(),
        },
        previous_id: None,
        lost_strings: 0,
    };
    scanner.sections();
    let mut out = scanner.out;
    out.unclosed_comment = scanner.text.unclosed_comment;
    if let Some(start) = out.unclosed_comment {
        out.problems.add("unterminated-comment", start, || {
            "a comment is not closed: it is read as one to the end of its line".into()
        });
    }
    if u32::try_from(out.ids.len()).is_err() || u32::try_from(out.reference_count).is_err() {
        return Err(ReadError::TooLarge);
    }
    out.ids.shrink();
    out.offsets.shrink();
    out.keywords.shrink_to_fit();
    Ok(out)
}

struct Scanner<'a> {
    text: Parser<'a>,
    out: Scan,
    previous_id: Option<u64>,
    /// Strings without an end that were searched for one to the end of the file.
    lost_strings: u32,
}

/// So many strings without an end are searched for the next instance on their line; a file of more is no file of lines.
const MOST_LOST_STRINGS: u32 = 64;

#[derive(Clone, Copy, PartialEq)]
enum Section {
    None,
    Header,
    Anchor,
    Reference,
    Data,
}

/// What a byte of an instance's body means to the scan.
const CLASS: [bool; 256] = {
    let mut class = [false; 256];
    class[b'\'' as usize] = true;
    class[b'#' as usize] = true;
    class[b'/' as usize] = true;
    class[b'(' as usize] = true;
    class[b')' as usize] = true;
    class[b';' as usize] = true;
    class
};

/// How the scan of a body ended.
enum Body {
    /// Behind its semicolon.
    Whole,
    /// It is broken, reported, and the cursor is where reading goes on.
    Broken,
}

impl Scanner<'_> {
    fn sections(&mut self) {
        let mut section = Section::None;
        let mut opened_at = self.text.at;
        let mut ended = false;
        loop {
            self.text.skip_blanks();
            let at = self.text.at;
            let Some(byte) = self.text.peek() else { break };
            if byte == b'#' && section != Section::Reference {
                if section != Section::Data {
                    self.out
                        .problems
                        .add("outside-section", at, || "an instance stands outside any DATA section".into());
                    self.open_data(Vec::new(), at);
                    section = Section::Data;
                    opened_at = at;
                }
                self.instance();
                continue;
            }
            match section {
                Section::Anchor if byte == b'<' => {
                    self.anchor();
                    continue;
                }
                Section::Reference if byte == b'#' || byte == b'@' => {
                    self.external();
                    continue;
                }
                _ => {}
            }
            let word_start = self.text.at;
            while self.text.peek().is_some_and(|b| is_word(b) || b == b'-' || b == b'!') {
                self.text.at += 1;
            }
            let word = self.text.bytes[word_start..self.text.at].to_ascii_uppercase();
            match word.as_slice() {
                b"ISO-10303-21" => self.end_of_entry(),
                b"HEADER" => {
                    section = Section::Header;
                    opened_at = at;
                    self.end_of_entry();
                }
                b"ANCHOR" => {
                    section = Section::Anchor;
                    opened_at = at;
                    self.end_of_entry();
                }
                b"REFERENCE" => {
                    section = Section::Reference;
                    opened_at = at;
                    self.end_of_entry();
                }
                b"DATA" => {
                    section = Section::Data;
                    opened_at = at;
                    self.data_start(at);
                }
                b"SIGNATURE" => self.signature(at),
                b"ENDSEC" => {
                    if section == Section::Data
                        && let Some(data) = self.out.data_sections.last_mut()
                    {
                        data.end = Some(at);
                    }
                    section = Section::None;
                    self.end_of_entry();
                }
                b"END-ISO-10303-21" => {
                    ended = true;
                    if section != Section::None {
                        self.out.problems.add("missing-endsec", at, || {
                            "ENDSEC; is missing before the end of the file".into()
                        });
                        if section == Section::Data
                            && let Some(data) = self.out.data_sections.last_mut()
                        {
                            data.end = Some(at);
                        }
                    }
                    section = Section::None;
                    self.end_of_entry();
                }
                _ if section == Section::Header && !word.is_empty() => {
                    self.text.at = word_start;
                    self.header_entry();
                }
                _ => {
                    self.out.problems.add("unknown-text", at, || {
                        "text that is neither a section nor an instance: left alone, and not read".into()
                    });
                    self.text.at = self.text.at.max(at + 1);
                    self.skip_to_next();
                }
            }
        }
        let length = self.text.bytes.len();
        if section != Section::None {
            self.out.problems.add("truncated", length, || {
                "the file ends inside a section: its end is missing, so instances may be".into()
            });
        } else if !ended {
            self.out.problems.add("missing-end", length, || {
                "END-ISO-10303-21; is missing: the file may be truncated".into()
            });
        }
        if self.out.data_sections.is_empty() {
            self.out
                .problems
                .add("no-data", opened_at, || "the file has no DATA section".into());
        }
    }

    /// Skips to behind the semicolon that ends a section keyword.
    fn end_of_entry(&mut self) {
        let at = self.text.at;
        if self.text.expect(b';').is_err() {
            self.out.problems.add("missing-semicolon", at, || {
                "a semicolon is missing behind a section keyword".into()
            });
        }
    }

    /// After text that cannot be read: to behind the next semicolon, or to a line that begins with `#`.
    fn skip_to_next(&mut self) {
        while let Some(byte) = self.text.peek() {
            match byte {
                b';' => {
                    self.text.at += 1;
                    return;
                }
                b'\n' if self.begins_entry(self.text.at + 1) => return,
                _ => self.text.at += 1,
            }
        }
    }

    /// Does an instance (`#12=`) or `ENDSEC` begin at `at`, blanks of the same line aside?
    fn begins_entry(&self, at: usize) -> bool {
        let bytes = self.text.bytes;
        let mut ahead = Parser::new(bytes, at);
        // No further than the line: each of a million empty lines is asked.
        let skip = |ahead: &mut Parser| {
            while ahead.peek().is_some_and(|byte| matches!(byte, b' ' | b'\t' | b'\r')) {
                ahead.at += 1;
            }
        };
        skip(&mut ahead);
        if bytes[ahead.at.min(bytes.len())..].starts_with(b"ENDSEC") {
            return true;
        }
        if ahead.peek() != Some(b'#') {
            return false;
        }
        ahead.at += 1;
        if ahead.digits().is_none() {
            return false;
        }
        skip(&mut ahead);
        ahead.peek() == Some(b'=')
    }

    /// An instance whose `#` is at the cursor.
    fn instance(&mut self) {
        let start = self.text.at;
        self.text.at += 1;
        self.text.skip_blanks();
        let Some(id) = self.text.digits() else {
            self.out
                .problems
                .add("identifier", start, || "# without a number, or with one beyond 2^64".into());
            return self.skip_to_next();
        };
        self.out.highest_id = self.out.highest_id.max(id);
        self.text.skip_blanks();
        if self.text.peek() != Some(b'=') {
            self.out
                .problems
                .add("syntax", self.text.at, || format!("= is missing behind #{id}"));
            return self.skip_to_next();
        }
        self.text.at += 1;
        self.text.skip_blanks();
        let keyword_start = self.text.at;
        let complex = self.text.peek() == Some(b'(');
        if !complex {
            if self.text.peek() == Some(b'!') {
                self.text.at += 1;
            }
            while self.text.peek().is_some_and(is_word) {
                self.text.at += 1;
            }
        }
        let keyword = keyword_start..self.text.at;
        if !complex && keyword.is_empty() {
            self.out
                .problems
                .add("syntax", keyword_start, || format!("#{id} has no entity name"));
            return self.skip_to_next();
        }
        let (stream, references) = (self.out.forward.len(), self.out.reference_count);
        if let Body::Broken = self.body(id, start) {
            self.out.forward.truncate(stream);
            self.out.reference_count = references;
            return;
        }
        self.out.forward.push(0);
        let number = if complex {
            let names = part_names(&self.text.bytes[keyword_start..self.text.at]);
            self.out.names.number_of(&names)
        } else {
            self.out.names.number_of(&self.text.bytes[keyword])
        };
        if number == crate::keywords::UNKNOWN {
            self.out.problems.add("entity-names", start, || {
                "an instance without entity name, or more than 65 000 different names".into()
            });
        }
        self.out.ids.push(id);
        self.out.offsets.push(start as u64);
        self.out.keywords.push(number);
        self.out.ascending &= self.previous_id.is_none_or(|previous| previous < id);
        self.previous_id = Some(id);
    }

    /// Scans to behind the semicolon that ends instance `id`, noting the references.
    fn body(&mut self, id: u64, instance: usize) -> Body {
        let bytes = self.text.bytes;
        let mut at = self.text.at;
        let mut depth = 0i64;
        loop {
            while at < bytes.len() && !CLASS[usize::from(bytes[at])] {
                at += 1;
            }
            let Some(&byte) = bytes.get(at) else {
                self.text.at = at;
                self.out.problems.add("truncated-instance", instance, || {
                    format!("the file ends inside instance #{id}")
                });
                return Body::Broken;
            };
            match byte {
                b'\'' => match self.string_end(at + 1) {
                    Ok(end) => at = end,
                    Err(resume) => {
                        self.out.problems.add("unterminated-string", at, || {
                            format!("a string in #{id} is not closed: the instance is skipped")
                        });
                        self.text.at = resume;
                        return Body::Broken;
                    }
                },
                b'#' => {
                    let start = at;
                    at += 1;
                    while bytes.get(at) == Some(&b' ') {
                        at += 1;
                    }
                    let mut target = 0u64;
                    let mut digits = 0;
                    while let Some(digit @ b'0'..=b'9') = bytes.get(at) {
                        target = target.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
                        at += 1;
                        digits += 1;
                    }
                    if matches!(bytes.get(at), Some(b'=' | b' ')) && self.begins_entry(start) {
                        self.out.problems.add("missing-semicolon", start, || {
                            format!("instance #{id} is not closed: it is skipped")
                        });
                        self.text.at = start;
                        return Body::Broken;
                    }
                    if (1..=20).contains(&digits) {
                        self.refer(target.wrapping_sub(id));
                    }
                }
                b'/' if bytes.get(at + 1) == Some(&b'*') => {
                    self.text.at = at;
                    self.text.skip_blanks();
                    at = self.text.at;
                }
                b'(' => {
                    depth += 1;
                    at += 1;
                }
                b')' => {
                    depth -= 1;
                    at += 1;
                }
                b';' => {
                    self.text.at = at + 1;
                    if depth == 0 {
                        return Body::Whole;
                    }
                    if bytes[..at].ends_with(b"ENDSEC") {
                        self.text.at = at - 6;
                    }
                    self.out.problems.add("parentheses", at, || {
                        format!("the parentheses of #{id} do not pair: the instance is skipped")
                    });
                    return Body::Broken;
                }
                _ => at += 1,
            }
        }
    }

    /// The offset behind a string's closing apostrophe, or, when it has none, where reading can go on.
    ///
    /// A string may be broken over lines, but a line that begins like an instance tells that the apostrophe was forgotten.
    fn string_end(&mut self, start: usize) -> Result<usize, usize> {
        let bytes = self.text.bytes;
        let mut at = start;
        loop {
            match bytes.get(at) {
                None => return Err(self.behind_lost_string(start)),
                Some(b'\'') if closes(bytes, start, at) => return Ok(at + 1),
                Some(b'\n') if self.begins_entry(at + 1) => return Err(at + 1),
                Some(_) => at += 1,
            }
        }
    }

    /// Where to go on when a string runs to the end of the file: files without line breaks have the next instance behind a semicolon.
    fn behind_lost_string(&mut self, start: usize) -> usize {
        let bytes = self.text.bytes;
        self.lost_strings += 1;
        if self.lost_strings > MOST_LOST_STRINGS {
            return bytes.len();
        }
        let next = (start..bytes.len()).find(|&at| bytes[at] == b';' && self.begins_entry(at + 1));
        next.map_or(bytes.len(), |at| at + 1)
    }

    /// Notes a reference by its difference to the user's identifier.
    fn refer(&mut self, difference: u64) {
        let signed = difference as i64;
        let mut number = ((signed << 1) ^ (signed >> 63)) as u64;
        if number == u64::MAX {
            return; // 2^63 away: no file, only an attack
        }
        number += 1;
        while number >= 0x80 {
            self.out.forward.push(number as u8 | 0x80);
            number >>= 7;
        }
        self.out.forward.push(number as u8);
        self.out.reference_count += 1;
    }
}

/// The next difference of the stream at `at`, which moves on; `None` at the end of an instance.
pub(crate) fn next_reference(forward: &[u8], at: &mut usize, id: u64) -> Option<u64> {
    let mut number = 0u64;
    let mut shift = 0;
    while let Some(&byte) = forward.get(*at) {
        *at += 1;
        number |= u64::from(byte & 0x7f) << shift;
        shift += 7;
        if byte < 0x80 {
            break;
        }
    }
    let zigzag = number.checked_sub(1)?;
    let signed = (zigzag >> 1) as i64 ^ -((zigzag & 1) as i64);
    Some(id.wrapping_add(signed as u64))
}

/// The names of a complex instance's parts, blank-separated, from its text.
fn part_names(text: &[u8]) -> Vec<u8> {
    let mut parser = Parser::new(text, 0);
    let mut names = Vec::new();
    let mut depth = 0u32;
    loop {
        parser.skip_blanks();
        match parser.peek() {
            None => return names,
            Some(b'(') => {
                depth += 1;
                parser.at += 1;
            }
            Some(b')') => {
                depth = depth.saturating_sub(1);
                parser.at += 1;
            }
            Some(b'\'') => parser.at = string_end(text, parser.at + 1).unwrap_or(text.len()),
            Some(byte) if depth == 1 && (is_word(byte) || byte == b'!') => {
                if !names.is_empty() {
                    names.push(b' ');
                }
                names.extend_from_slice(parser.keyword().as_bytes());
            }
            Some(_) => parser.at += 1,
        }
    }
}

//! The parts of a `multipart/x-mixed-replace` or `multipart/mixed` body: one document each, until the agent stops.
//!
//! Agents differ: the boundary stands in quotes or not, the header's parameter already has the two leading dashes or not, parts have a
//! `Content-length` or end at the next boundary, their headers are in any case. [`PartReader`] takes all of it, and keeps at most one
//! document in memory.

use super::http::shown;

/// A part: a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// As sent; empty when there is none.
    pub content_type: String,
    /// Its bytes.
    pub body: Vec<u8>,
}

/// Why bytes are no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MultipartError(pub String);

impl std::fmt::Display for MultipartError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The boundary that a content type names; `None` when it is no multipart type.
pub fn boundary_of(content_type: &str) -> Option<String> {
    let (kind, parameters) = content_type.split_once(';')?;
    if !kind.trim().to_ascii_lowercase().starts_with("multipart/") {
        return None;
    }
    parameters.split(';').find_map(|parameter| {
        let (name, value) = parameter.split_once('=')?;
        let value = value.trim().trim_matches('"');
        (name.trim().eq_ignore_ascii_case("boundary") && !value.is_empty()).then(|| value.to_owned())
    })
}

/// Longest line of a part's headers.
const LONGEST_LINE: usize = 8 << 10;
/// Most lines before the first boundary, or of a part's headers.
const MOST_LINES: usize = 200;

/// Reads parts one after the other.
#[derive(Debug)]
pub struct PartReader {
    boundary: String,
    /// What stands before a part; known when the first one was seen.
    delimiter: Option<Vec<u8>>,
    state: State,
    buffer: Vec<u8>,
    /// Everything before it is read.
    at: usize,
    /// No boundary begins before it.
    searched: usize,
    lines: usize,
    longest: usize,
}

#[derive(Clone, Debug)]
enum State {
    /// At the beginning of a line, before a boundary.
    Outside,
    Headers {
        length: Option<usize>,
        content_type: String,
    },
    Body {
        length: Option<usize>,
        content_type: String,
    },
    Finished,
}

impl PartReader {
    /// A reader of parts of at most `longest` bytes.
    pub fn new(boundary: &str, longest: usize) -> PartReader {
        PartReader {
            boundary: boundary.to_owned(),
            delimiter: None,
            state: State::Outside,
            buffer: Vec::new(),
            at: 0,
            searched: 0,
            lines: 0,
            longest,
        }
    }

    /// Takes bytes of the body; ask for parts until there is none before giving more.
    pub fn receive(&mut self, bytes: &[u8]) {
        // What is read makes place, so that the buffer stays at about one document.
        if self.at > 0 {
            self.buffer.drain(..self.at);
            self.searched = self.searched.saturating_sub(self.at);
            self.at = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// The agent said that no part comes any more.
    pub fn is_finished(&self) -> bool {
        matches!(self.state, State::Finished)
    }

    /// The next whole part; `None` when more bytes are needed.
    ///
    /// # Errors
    /// The bytes are no parts, or one is longer than allowed.
    pub fn next_part(&mut self) -> Result<Option<Part>, MultipartError> {
        loop {
            match self.state.clone() {
                State::Finished => return Ok(None),
                State::Outside => {
                    let Some(line) = self.line()? else { return Ok(None) };
                    self.counted()?;
                    match self.met(&line) {
                        Some(false) => {
                            self.lines = 0;
                            self.state = State::Headers {
                                length: None,
                                content_type: String::new(),
                            };
                        }
                        Some(true) => self.state = State::Finished,
                        None => {}
                    }
                }
                State::Headers {
                    mut length,
                    mut content_type,
                } => {
                    let Some(line) = self.line()? else { return Ok(None) };
                    self.counted()?;
                    let line = String::from_utf8_lossy(&line).into_owned();
                    if line.is_empty() {
                        self.lines = 0;
                        self.searched = self.at;
                        self.state = State::Body { length, content_type };
                        continue;
                    }
                    if let Some((name, value)) = line.split_once(':') {
                        if name.trim().eq_ignore_ascii_case("content-length") {
                            let value = value.trim();
                            let said = value
                                .parse()
                                .map_err(|_| MultipartError(format!("a part's length is {value:?}")))?;
                            length = Some(said);
                        } else if name.trim().eq_ignore_ascii_case("content-type") {
                            content_type = value.trim().to_owned();
                        }
                    }
                    self.state = State::Headers { length, content_type };
                }
                State::Body { length, content_type } => {
                    let body = match length {
                        Some(length) => self.body_of(length)?,
                        None => self.body_before_boundary()?,
                    };
                    let Some(body) = body else { return Ok(None) };
                    self.state = State::Outside;
                    return Ok(Some(Part { content_type, body }));
                }
            }
        }
    }

    fn body_of(&mut self, length: usize) -> Result<Option<Vec<u8>>, MultipartError> {
        if length > self.longest {
            return Err(self.too_long());
        }
        if self.buffer.len() - self.at < length {
            return Ok(None);
        }
        let body = self.buffer[self.at..self.at + length].to_vec();
        self.at += length;
        Ok(Some(body))
    }

    fn body_before_boundary(&mut self) -> Result<Option<Vec<u8>>, MultipartError> {
        let delimiter = self.delimiter.clone().unwrap_or_default();
        let mut from = self.searched.max(self.at);
        loop {
            let found = find(&self.buffer[from..], &delimiter).map(|k| from + k);
            match found {
                // A boundary begins its line.
                Some(place) if place > self.at && self.buffer[place - 1] != b'\n' => from = place + 1,
                Some(place) => {
                    let mut body = self.buffer[self.at..place].to_vec();
                    // The line's end before a boundary belongs to the boundary.
                    if body.last() == Some(&b'\n') {
                        body.pop();
                    }
                    if body.last() == Some(&b'\r') {
                        body.pop();
                    }
                    self.at = place;
                    return Ok(Some(body));
                }
                None => {
                    if self.buffer.len() - self.at > self.longest {
                        return Err(self.too_long());
                    }
                    self.searched = self
                        .buffer
                        .len()
                        .saturating_sub(delimiter.len())
                        .max(from.min(self.buffer.len()));
                    return Ok(None);
                }
            }
        }
    }

    fn too_long(&self) -> MultipartError {
        MultipartError(format!("a document is longer than {} bytes", self.longest))
    }

    fn counted(&mut self) -> Result<(), MultipartError> {
        self.lines += 1;
        if self.lines > MOST_LINES {
            return Err(MultipartError(format!("no boundary {:?} comes", self.boundary)));
        }
        Ok(())
    }

    /// Whether a line is the boundary, and the last one.
    fn met(&mut self, line: &[u8]) -> Option<bool> {
        let plain = self.boundary.as_bytes();
        // By the book two dashes stand before it; agents that put them into the header already do not repeat them.
        let candidates = match &self.delimiter {
            Some(known) => vec![known.clone()],
            None if plain.starts_with(b"--") => vec![[b"--", plain].concat(), plain.to_vec()],
            None => vec![[b"--", plain].concat()],
        };
        for candidate in candidates {
            if let Some(rest) = line.strip_prefix(candidate.as_slice()) {
                let rest = rest.trim_ascii();
                if rest.is_empty() || rest == b"--" {
                    self.delimiter = Some(candidate);
                    return Some(rest == b"--");
                }
            }
        }
        None
    }

    /// A whole line without its end.
    fn line(&mut self) -> Result<Option<Vec<u8>>, MultipartError> {
        let rest = &self.buffer[self.at..];
        match rest.iter().position(|b| *b == b'\n') {
            Some(end) if end <= LONGEST_LINE => {
                let line = rest[..end].strip_suffix(b"\r").unwrap_or(&rest[..end]).to_vec();
                self.at += end + 1;
                Ok(Some(line))
            }
            None if rest.len() <= LONGEST_LINE => Ok(None),
            _ => Err(MultipartError(format!(
                "no boundary {:?} comes, but {}",
                self.boundary,
                shown(rest)
            ))),
        }
    }
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    let first = *wanted.first()?;
    let mut from = 0;
    while let Some(k) = bytes[from..].iter().position(|b| *b == first) {
        if bytes[from + k..].starts_with(wanted) {
            return Some(from + k);
        }
        from += k + 1;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(boundary: &str, body: &[u8], size: usize) -> Result<Vec<String>, MultipartError> {
        let mut reader = PartReader::new(boundary, 1000);
        let mut parts = Vec::new();
        for piece in body.chunks(size) {
            reader.receive(piece);
            while let Some(part) = reader.next_part()? {
                parts.push(format!("{}|{}", part.content_type, String::from_utf8_lossy(&part.body)));
            }
        }
        Ok(parts)
    }

    #[test]
    fn the_boundary_is_found_in_quotes_and_without_and_only_in_multipart_types() {
        for (kind, expected) in [
            ("multipart/x-mixed-replace;boundary=abc", Some("abc")),
            ("Multipart/Mixed; charset=x; Boundary=\"--abc\"", Some("--abc")),
            ("multipart/mixed", None),
            ("multipart/mixed; boundary=", None),
            ("text/xml; boundary=abc", None),
        ] {
            assert_eq!(boundary_of(kind).as_deref(), expected, "{kind}");
        }
    }

    #[test]
    fn parts_come_with_and_without_length_and_with_any_spelling_in_pieces_of_any_size() {
        let bodies = [
            (
                "abc",
                "\r\n--abc\r\nContent-type: text/xml\r\nContent-length: 4\r\n\r\n<a/>\r\n--abc\r\nContent-type: text/xml\r\nContent-length: 4\r\n\r\n<b/>\r\n--abc--\r\n",
            ),
            (
                "--abc",
                "--abc\nCONTENT-TYPE: text/xml\ncontent-LENGTH: 4\n\n<a/>\n--abc\ncontent-type: text/xml\nContent-Length:4\n\n<b/>\n",
            ),
            (
                "--abc",
                "----abc\r\ncontent-type:text/xml\r\n\r\n<a/>\r\n----abc\r\nContent-type: text/xml\r\n\r\n<b/>\r\n----abc--",
            ),
            (
                "abc",
                "a preamble\r\n--abc\r\nContent-type: text/xml\r\n\r\n<a/>\r\n--abc\r\nContent-type: text/xml\r\n\r\n<b/>\r\n--abc\r\n",
            ),
        ];
        for (boundary, body) in bodies {
            for size in [1, 2, 5, 1000] {
                let parts = read(boundary, body.as_bytes(), size).expect("parts");
                assert_eq!(parts, ["text/xml|<a/>", "text/xml|<b/>"], "{body} by {size}");
            }
        }
    }

    #[test]
    fn a_boundary_inside_a_line_is_none() {
        let body = "--abc\n\n<a>x--abc\n</a>\n--abc\n";
        assert_eq!(read("abc", body.as_bytes(), 3).expect("a part"), ["|<a>x--abc\n</a>"]);
    }

    #[test]
    fn too_long_a_part_and_no_boundary_at_all_are_refused() {
        assert!(read("abc", b"--abc\nContent-length: 2000\n\n", 100).is_err());
        assert!(read("abc", &[&b"--abc\n\n"[..], &[b'x'; 2000]].concat(), 100).is_err());
        assert!(read("abc", &[b'x'; 20_000], 100).is_err());
        assert!(read("abc", &b"x\n".repeat(1000), 100).is_err());
        assert!(read("abc", b"--abc\nContent-length: many\n\n", 100).is_err());
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader(bytes in prop::collection::vec(prop::sample::select(b"-abc\r\n: 1Content-length".to_vec()), 0..300), size in 1usize..50) {
            let _ = read("abc", &bytes, size);
            let _ = read("abc", &[&b"--abc\n\n"[..], &bytes].concat(), size);
        }
    }
}

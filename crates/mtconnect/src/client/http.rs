//! HTTP/1.1 answers, as far as an agent gives them: head, then a body by length, in chunks, or until the connection ends.
//!
//! [`ResponseReader`] takes bytes as they come and gives [`HttpEvent`]s; it keeps the head and nothing of the body. It does not follow
//! redirections, undo compressions (none is asked for) or keep cookies.

/// Longest head, and longest line that gives the size of a chunk; agents send some hundred bytes.
const LONGEST_HEAD: usize = 64 << 10;

/// Status line and headers of an answer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// 200.
    pub status: u16,
    /// As sent; empty when there is none.
    pub content_type: String,
    /// True when the server closes after this answer, or the answer's end is the end of the connection.
    pub closes: bool,
    /// Where a redirection leads; empty when there is none.
    pub location: String,
}

/// A piece of an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HttpEvent<'a> {
    /// An answer begins.
    Head(Head),
    /// Bytes of its body.
    Body(&'a [u8]),
    /// It is complete; the next bytes begin another one.
    End,
}

/// Why bytes are no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpError(pub String);

impl std::fmt::Display for HttpError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Reads answers one after the other.
#[derive(Debug, Default)]
pub struct ResponseReader {
    state: State,
    /// The line being read.
    line: Vec<u8>,
    /// Bytes of the head so far.
    head_length: usize,
}

#[derive(Debug, Default)]
enum State {
    #[default]
    StatusLine,
    Headers(Head, Framing),
    Length(u64),
    ChunkSize,
    Chunk(u64),
    AfterChunk,
    Trailers,
    UntilClose,
    Broken,
}

#[derive(Clone, Copy, Debug)]
enum Framing {
    Unsaid,
    Length(u64),
    Chunked,
}

impl ResponseReader {
    /// The next event; takes what it read from the front of `bytes`. `None` when all is read and more is needed.
    ///
    /// # Errors
    /// The bytes are no HTTP answer. The reader is of no use after that.
    pub fn next<'a>(&mut self, bytes: &mut &'a [u8]) -> Result<Option<HttpEvent<'a>>, HttpError> {
        let found = self.step(bytes);
        if found.is_err() {
            self.state = State::Broken;
        }
        found
    }

    /// The connection ended: true when that is a good end, between answers or of an answer that lasts until the connection ends.
    pub fn may_end(&self) -> bool {
        matches!(self.state, State::UntilClose) || (matches!(self.state, State::StatusLine) && self.line.is_empty())
    }

    fn step<'a>(&mut self, bytes: &mut &'a [u8]) -> Result<Option<HttpEvent<'a>>, HttpError> {
        loop {
            match std::mem::take(&mut self.state) {
                State::Broken => {
                    self.state = State::Broken;
                    return Err(HttpError("the connection was given up".to_owned()));
                }
                State::StatusLine => {
                    self.state = State::StatusLine;
                    // Garbage has no lines: it is told by its first bytes.
                    let expected = b"HTTP/";
                    let seen = self.line.iter().chain(bytes.iter()).take(expected.len());
                    if seen.zip(expected).any(|(a, b)| a != b) && !self.blank_before(bytes) {
                        return Err(HttpError(format!(
                            "it does not begin with HTTP/1.1 but with {}",
                            shown(bytes)
                        )));
                    }
                    let Some(line) = self.take_line(bytes)? else { return Ok(None) };
                    if line.is_empty() {
                        continue; // a blank line too many after the answer before
                    }
                    self.head_length = line.len();
                    let head = status_line(&line)?;
                    self.state = State::Headers(head, Framing::Unsaid);
                }
                State::Headers(mut head, mut framing) => {
                    let Some(line) = self.take_line(bytes)? else {
                        self.state = State::Headers(head, framing);
                        return Ok(None);
                    };
                    if !line.is_empty() {
                        self.head_length += line.len();
                        if self.head_length > LONGEST_HEAD {
                            return Err(HttpError(format!("its headers are longer than {LONGEST_HEAD} bytes")));
                        }
                        header(&line, &mut head, &mut framing)?;
                        self.state = State::Headers(head, framing);
                        continue;
                    }
                    if head.status < 200 {
                        continue; // 100 Continue: the answer itself comes next
                    }
                    self.state = match framing {
                        // These have no body, whatever the headers say (RFC 9112 section 6.3).
                        _ if head.status == 204 || head.status == 304 => State::Length(0),
                        Framing::Chunked => State::ChunkSize,
                        Framing::Length(length) => State::Length(length),
                        Framing::Unsaid => {
                            head.closes = true;
                            State::UntilClose
                        }
                    };
                    return Ok(Some(HttpEvent::Head(head)));
                }
                State::Length(0) => return Ok(Some(HttpEvent::End)),
                State::Length(left) => {
                    let (piece, rest) = cut(bytes, left);
                    self.state = State::Length(left - piece.len() as u64);
                    *bytes = rest;
                    return Ok((!piece.is_empty()).then_some(HttpEvent::Body(piece)));
                }
                State::ChunkSize => {
                    self.state = State::ChunkSize;
                    let Some(line) = self.take_line(bytes)? else { return Ok(None) };
                    // `1a2b;extension=x`
                    let digits = line.split(';').next().unwrap_or_default().trim();
                    let size = u64::from_str_radix(digits, 16)
                        .ok()
                        .filter(|_| digits.bytes().all(|b| b.is_ascii_hexdigit()))
                        .ok_or_else(|| HttpError(format!("the size of a chunk is {}", shown(line.as_bytes()))))?;
                    self.state = if size == 0 { State::Trailers } else { State::Chunk(size) };
                    self.head_length = 0;
                }
                State::Chunk(0) => self.state = State::AfterChunk,
                State::Chunk(left) => {
                    let (piece, rest) = cut(bytes, left);
                    self.state = State::Chunk(left - piece.len() as u64);
                    *bytes = rest;
                    return Ok((!piece.is_empty()).then_some(HttpEvent::Body(piece)));
                }
                State::AfterChunk => {
                    self.state = State::AfterChunk;
                    let Some(line) = self.take_line(bytes)? else { return Ok(None) };
                    if !line.is_empty() {
                        return Err(HttpError(format!(
                            "a chunk is longer than it said, by {}",
                            shown(line.as_bytes())
                        )));
                    }
                    self.state = State::ChunkSize;
                }
                State::Trailers => {
                    self.state = State::Trailers;
                    let Some(line) = self.take_line(bytes)? else { return Ok(None) };
                    self.head_length += line.len();
                    if self.head_length > LONGEST_HEAD {
                        return Err(HttpError(format!("its trailers are longer than {LONGEST_HEAD} bytes")));
                    }
                    if line.is_empty() {
                        self.state = State::StatusLine;
                        return Ok(Some(HttpEvent::End));
                    }
                }
                State::UntilClose => {
                    self.state = State::UntilClose;
                    let piece = std::mem::take(bytes);
                    return Ok((!piece.is_empty()).then_some(HttpEvent::Body(piece)));
                }
            }
        }
    }

    fn blank_before(&self, bytes: &[u8]) -> bool {
        let first = self.line.first().or(bytes.first());
        first.is_none_or(|b| *b == b'\r' || *b == b'\n')
    }

    /// A whole line without its end, which is CR LF or LF alone.
    fn take_line(&mut self, bytes: &mut &[u8]) -> Result<Option<String>, HttpError> {
        let end = bytes.iter().position(|b| *b == b'\n');
        let (piece, rest) = bytes.split_at(end.map_or(bytes.len(), |at| at + 1));
        *bytes = rest;
        self.line.extend_from_slice(piece);
        if self.line.len() > LONGEST_HEAD {
            return Err(HttpError(format!("a line of its head is longer than {LONGEST_HEAD} bytes")));
        }
        if end.is_none() {
            return Ok(None);
        }
        let line = std::mem::take(&mut self.line);
        Ok(Some(String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned()))
    }
}

fn cut(bytes: &[u8], left: u64) -> (&[u8], &[u8]) {
    bytes.split_at(bytes.len().min(usize::try_from(left).unwrap_or(usize::MAX)))
}

/// `HTTP/1.1 200 OK`
fn status_line(line: &str) -> Result<Head, HttpError> {
    let mut words = line.split_whitespace();
    let version = words.next().unwrap_or_default();
    let status = words.next().and_then(|w| w.parse().ok()).filter(|s| (100..600).contains(s));
    match (version.strip_prefix("HTTP/1."), status) {
        (Some(minor), Some(status)) => Ok(Head {
            status,
            // HTTP/1.0 closes unless it says otherwise.
            closes: minor == "0",
            ..Head::default()
        }),
        _ => Err(HttpError(format!("its first line is {}", shown(line.as_bytes())))),
    }
}

fn header(line: &str, head: &mut Head, framing: &mut Framing) -> Result<(), HttpError> {
    let Some((name, value)) = line.split_once(':') else {
        return Err(HttpError(format!("a header line is {}", shown(line.as_bytes()))));
    };
    let value = value.trim();
    match name.trim().to_ascii_lowercase().as_str() {
        "content-type" => head.content_type = value.to_owned(),
        "location" => head.location = value.to_owned(),
        "connection" => {
            head.closes = match value.to_ascii_lowercase().as_str() {
                "close" => true,
                "keep-alive" => false,
                _ => head.closes,
            }
        }
        "transfer-encoding" if value.to_ascii_lowercase().ends_with("chunked") => *framing = Framing::Chunked,
        // A length beside chunks does not count (RFC 9112 section 6.3).
        "content-length" if !matches!(framing, Framing::Chunked) => {
            let length = value
                .parse()
                .map_err(|_| HttpError(format!("its content length is {}", shown(value.as_bytes()))))?;
            *framing = Framing::Length(length);
        }
        _ => {}
    }
    Ok(())
}

/// The beginning of some bytes, for a message.
pub(crate) fn shown(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(40)]);
    format!("{text:?}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What comes out of an answer that arrives in pieces of that size: status, type, body, whether it ended.
    fn read(answer: &[u8], size: usize) -> Result<(u16, String, Vec<u8>, bool), HttpError> {
        let mut reader = ResponseReader::default();
        let (mut head, mut body, mut ended) = (Head::default(), Vec::new(), false);
        for mut piece in answer.chunks(size) {
            while let Some(event) = reader.next(&mut piece)? {
                match event {
                    HttpEvent::Head(h) => head = h,
                    HttpEvent::Body(b) => body.extend_from_slice(b),
                    HttpEvent::End => ended = true,
                }
            }
        }
        Ok((head.status, head.content_type, body, ended || reader.may_end()))
    }

    #[test]
    fn three_framings_give_the_same_body_in_pieces_of_any_size() {
        let answers = [
            "HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: 11\r\n\r\nhello world",
            "HTTP/1.1 200 OK\ncontent-type: text/xml\ntransfer-encoding: chunked\n\n5\nhello\n6;x=y\n world\n0\nEtag: 1\n\n",
            "HTTP/1.1 100 Continue\r\n\r\nHTTP/1.0 200 OK\r\nCONTENT-TYPE: text/xml\r\n\r\nhello world",
        ];
        for answer in answers {
            for size in [1, 2, 3, 7, 1000] {
                let read = read(answer.as_bytes(), size).expect("an answer");
                assert_eq!(
                    read,
                    (200, "text/xml".to_owned(), b"hello world".to_vec(), true),
                    "{answer} by {size}"
                );
            }
        }
    }

    #[test]
    fn an_answer_cut_short_has_no_end() {
        let (_, _, body, ended) = read(b"HTTP/1.1 200 OK\r\nContent-Length: 11\r\n\r\nhello", 100).expect("so far good");
        assert_eq!((body.as_slice(), ended), (&b"hello"[..], false));
    }

    #[test]
    fn what_is_no_answer_is_named_by_its_first_bytes() {
        let error = read(b"SSH-2.0-OpenSSH_9.2\r\n", 100).expect_err("not HTTP");
        assert!(error.0.contains("SSH-2.0"), "{error}");
        for bad in [
            "HTTP/2 200\r\n\r\n",
            "HTTP/1.1 OK\r\n\r\n",
            "HTTP/1.1 200 OK\r\nno header\r\n\r\n",
            "HTTP/1.1 200 OK\r\ncontent-length: -1\r\n\r\n",
            "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n+5\r\nhello\r\n0\r\n\r\n",
            "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n5\r\nhello!\r\n0\r\n\r\n",
        ] {
            assert!(read(bad.as_bytes(), 100).is_err(), "{bad}");
        }
    }

    #[test]
    fn an_endless_head_is_refused() {
        let mut answer = b"HTTP/1.1 200 OK\r\n".to_vec();
        answer.extend(b"a: b\r\n".repeat(20_000));
        assert!(read(&answer, 1000).is_err());
        assert!(read(&[&b"HTTP/1.1 200 "[..], &[b'x'; 70_000]].concat(), 1000).is_err());
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader(bytes in prop::collection::vec(any::<u8>(), 0..300), size in 1usize..50) {
            let _ = read(&bytes, size);
            let _ = read(&[&b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n"[..], &bytes].concat(), size);
        }
    }
}

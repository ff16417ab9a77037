//! The program's bytes: lines out of a window that moves over the file, numbers, and the characters of comments.
//!
//! Nothing here keeps more of the file than one window, whatever its size.

use plan::{ByteSource, ReadError};

/// Longest line that is read, bytes. Controls stop at a few hundred; comments of CAM systems are longer.
pub(crate) const LONGEST_LINE: usize = 16 * 1024;
/// Bytes asked for at once.
const WINDOW: usize = 128 * 1024;

/// A line inside the window of [`Lines`]; good until the next one is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Line {
    start: usize,
    end: usize,
    /// 1-based.
    pub number: u32,
    /// Of its first byte in the file.
    pub offset: u64,
}

impl Line {
    /// Bytes without the line end.
    pub(crate) fn length(&self) -> u32 {
        (self.end - self.start) as u32
    }
}

/// Why there is no next line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum LineError {
    /// The file can no longer be read.
    Read(ReadError),
    /// A line without end.
    TooLong { number: u32 },
    /// A byte 0: this is no text.
    Binary { number: u32, column: u32 },
}

/// Lines of a file, read in windows.
pub(crate) struct Lines {
    source: Box<dyn ByteSource>,
    window: Vec<u8>,
    /// Where the next line starts in the window.
    next: usize,
    /// Where the window starts in the file.
    offset: u64,
    number: u32,
    at_end: bool,
    has_zero_byte: bool,
}

impl Lines {
    pub(crate) fn new(source: Box<dyn ByteSource>) -> Self {
        Lines {
            source,
            window: Vec::new(),
            next: 0,
            offset: 0,
            number: 0,
            at_end: false,
            has_zero_byte: false,
        }
    }

    /// Length of the file, bytes.
    pub(crate) fn length(&self) -> u64 {
        self.source.length()
    }

    /// Goes to the line that starts at `offset`; the line read next gets the number after `lines_before`.
    pub(crate) fn seek(&mut self, offset: u64, lines_before: u32) {
        // What is in the window is not read again.
        if (self.offset..=self.offset + self.window.len() as u64).contains(&offset) && !self.window.is_empty() {
            (self.next, self.number) = ((offset - self.offset) as usize, lines_before);
            return;
        }
        self.window.clear();
        (self.next, self.offset, self.number) = (0, offset, lines_before);
        (self.at_end, self.has_zero_byte) = (false, false);
    }

    /// Where the line read next starts, and how many lines lie before it.
    pub(crate) fn position(&self) -> (u64, u32) {
        (self.offset + self.next as u64, self.number)
    }

    /// The next line; `None` at the end of the file.
    pub(crate) fn next(&mut self) -> Result<Option<Line>, LineError> {
        loop {
            let rest = &self.window[self.next..];
            if let Some(length) = line_end(rest) {
                return self.line(length, 1).map(Some);
            }
            if rest.len() > LONGEST_LINE {
                return Err(LineError::TooLong { number: self.number + 1 });
            }
            if self.at_end {
                return match rest.len() {
                    0 => Ok(None),
                    length => self.line(length, 0).map(Some),
                };
            }
            self.fill()?;
        }
    }

    fn line(&mut self, length: usize, line_end: usize) -> Result<Line, LineError> {
        self.number = self.number.saturating_add(1);
        let start = self.next;
        let mut end = start + length;
        if length > LONGEST_LINE {
            return Err(LineError::TooLong { number: self.number });
        }
        if self.has_zero_byte
            && let Some(at) = self.window[start..end].iter().position(|b| *b == 0)
        {
            let column = at as u32 + 1;
            return Err(LineError::Binary {
                number: self.number,
                column,
            });
        }
        self.next = end + line_end;
        while end > start && self.window[end - 1] == b'\r' {
            end -= 1;
        }
        Ok(Line {
            start,
            end,
            number: self.number,
            offset: self.offset + start as u64,
        })
    }

    /// Moves the window so that it starts at the next line, and reads on behind what it has.
    fn fill(&mut self) -> Result<(), LineError> {
        self.window.drain(..self.next);
        self.offset += self.next as u64;
        self.next = 0;
        let kept = self.window.len();
        self.window.resize(kept + WINDOW, 0);
        let read = self.source.read_at(self.offset + kept as u64, &mut self.window[kept..]);
        let count = match read {
            Ok(count) => count.min(WINDOW),
            Err(why) => {
                self.window.truncate(kept);
                return Err(LineError::Read(why));
            }
        };
        self.window.truncate(kept + count);
        self.at_end = count == 0;
        self.has_zero_byte = self.window.contains(&0);
        Ok(())
    }

    /// The bytes of the line read last, without its end; nothing after a [`Lines::seek`].
    pub(crate) fn bytes(&self, line: Line) -> &[u8] {
        self.window.get(line.start..line.end).unwrap_or_default()
    }
}

/// The first line feed. Lines are short: eight bytes at a time beat a search that has to get going first.
#[inline]
fn line_end(bytes: &[u8]) -> Option<usize> {
    const ONES: u64 = u64::MAX / 255;
    let (chunks, rest) = bytes.as_chunks::<8>();
    for (index, chunk) in chunks.iter().enumerate() {
        let differs = u64::from_le_bytes(*chunk) ^ (ONES * b'\n' as u64);
        // The lowest bit of this is the high bit of the first byte that is 0; higher ones may be wrong.
        let zero = differs.wrapping_sub(ONES) & !differs & (ONES << 7);
        if zero != 0 {
            return Some(8 * index + zero.trailing_zeros() as usize / 8);
        }
    }
    let at = rest.iter().position(|b| *b == b'\n')?;
    Some(bytes.len() - rest.len() + at)
}

/// A number without sign, as a program writes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Number {
    pub value: f64,
    pub has_point: bool,
    /// The byte behind it.
    pub end: usize,
}

/// The number that starts at byte `at`: `12`, `12.`, `.5`, `12.5`; `None` when there is none or it has more than 18 digits.
#[inline]
pub(crate) fn number_at(text: &[u8], at: usize) -> Option<Number> {
    let mut mantissa: u64 = 0;
    let mut end = at;
    let mut digits = |end: &mut usize| {
        while let Some(byte) = text.get(*end) {
            let digit = byte.wrapping_sub(b'0');
            if digit > 9 {
                break;
            }
            mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
            *end += 1;
        }
    };
    digits(&mut end);
    let mut count = end - at;
    let mut decimals = 0;
    let has_point = text.get(end) == Some(&b'.');
    if has_point {
        end += 1;
        let point = end;
        digits(&mut end);
        decimals = end - point;
        count += decimals;
    }
    if count == 0 {
        return None;
    }
    // Both operands are exact up to 2^53 and 10^22, so the quotient is the nearest double to what was written.
    let value = match TENS.get(decimals) {
        Some(ten) if count <= 18 && mantissa <= 1 << 53 => mantissa as f64 / ten,
        _ => long_number(&text[at..end])?,
    };
    Some(Number { value, has_point, end })
}

/// A number of many digits; leading zeros carry nothing: `X000000000000000000001.` is 1.
#[cold]
fn long_number(written: &[u8]) -> Option<f64> {
    let significant = written.iter().filter(|b| **b != b'.').skip_while(|b| **b == b'0');
    if significant.count() > 18 {
        return None;
    }
    std::str::from_utf8(written).ok()?.parse().ok()
}

const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

/// The characters of a comment: UTF-8 where it is that, else Windows code page 1252, which contains ISO 8859-1's letters.
pub(crate) fn characters(bytes: &[u8]) -> String {
    const HIGH: [char; 32] = [
        '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}', '‘', '’', '“',
        '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
    ];
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes
            .iter()
            .map(|b| match b {
                0x80..=0x9f => HIGH[usize::from(b - 0x80)],
                _ => char::from(*b),
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::MemorySource;

    fn lines_of(text: &[u8]) -> Vec<String> {
        let mut lines = Lines::new(Box::new(MemorySource(text.to_vec())));
        let mut all = Vec::new();
        loop {
            match lines.next() {
                Ok(Some(line)) => all.push(format!("{}@{} {}", line.number, line.offset, characters(lines.bytes(line)))),
                Ok(None) => return all,
                Err(e) => {
                    all.push(format!("{e:?}"));
                    return all;
                }
            }
        }
    }

    #[test]
    fn lines_end_in_lf_or_cr_lf_and_know_their_place() {
        assert_eq!(lines_of(b"G0\r\n\nX1\r\nM30"), ["1@0 G0", "2@4 ", "3@5 X1", "4@9 M30"]);
    }

    #[test]
    fn a_line_feed_is_found_wherever_it_stands() {
        for length in 0..40 {
            let mut text = vec![b'\n' + 1; length];
            assert_eq!(line_end(&text), None);
            for at in (0..length).rev() {
                text[at] = b'\n';
                assert_eq!(line_end(&text), Some(at));
            }
        }
    }

    #[test]
    fn a_line_across_two_windows_is_whole() {
        let mut text = Vec::new();
        for k in 0..40_000 {
            text.extend_from_slice(format!("G1 X{k}.\n").as_bytes());
        }
        let lines = lines_of(&text);
        assert_eq!(lines.len(), 40_000);
        assert!(lines[39_999].ends_with("G1 X39999."));
        assert!(lines.iter().enumerate().all(|(k, l)| l.ends_with(&format!("G1 X{k}."))));
    }

    #[test]
    fn a_byte_zero_and_an_endless_line_are_told_with_their_line() {
        assert_eq!(lines_of(b"G0\nX\0"), ["1@0 G0", "Binary { number: 2, column: 2 }"]);
        assert_eq!(lines_of(&[b'X'; 20_000]), ["TooLong { number: 1 }"]);
    }

    #[test]
    fn numbers_are_the_nearest_double_to_what_is_written() {
        for text in [
            "0.1",
            "123.456",
            "-",
            ".",
            ".5",
            "5.",
            "1.2345",
            "999999.999999",
            "000000000000000000000.25",
            "0.000000000000000000000000000012345",
            "9007199254740993",
            "9007199254.740993",
            "123456789012345.678",
            "0.999999999999999999",
        ] {
            let expected = text.parse::<f64>().ok();
            assert_eq!(number_at(text.as_bytes(), 0).map(|n| n.value), expected, "{text}");
        }
        assert_eq!(number_at(b"1234567890123456789", 0), None);
    }

    #[test]
    fn comments_are_read_as_utf_8_or_code_page_1252() {
        assert_eq!(characters(b"90\xb0 \x80 \xd8"), "90° € Ø");
        assert_eq!(characters("Ø".as_bytes()), "Ø");
    }
}

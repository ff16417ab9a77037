//! One line of a program, taken apart: words with their values, G and M codes, the comment, or a macro statement.
//!
//! A [`Block`] is filled again and again; reading a line allocates nothing. Meaning is given to it elsewhere.

use crate::fault::{Fault, Outcome};
use crate::macro_b::{MacroRules, Reader, Value, Variables};
use crate::text::number_at;

/// A word's number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Word {
    pub value: f64,
    pub has_point: bool,
    /// The value was computed: it is rounded to the increment and needs no point.
    pub computed: bool,
    /// The byte of its letter.
    pub at: usize,
}

/// A G or M code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Code {
    /// The number, for G codes times ten.
    pub code: u16,
    /// The byte of its letter.
    pub at: usize,
}

/// What a line holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Nothing, or comments only.
    Blank,
    /// Words.
    Words,
    /// An assignment whose `#` is at this byte.
    Assignment { at: usize },
    /// `%`.
    TapeMark,
}

const MOST_CODES: usize = 16;

/// The parts of a line.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    words: [Word; 26],
    present: u32,
    used: u32,
    g: [Code; MOST_CODES],
    g_count: usize,
    m: [Code; MOST_CODES],
    m_count: usize,
    /// Bytes between the parentheses of the first comment.
    pub comment: Option<(usize, usize)>,
    /// Program number, from an O word.
    pub program: Option<(u32, usize)>,
    /// Text behind `;` was left out, from this byte on.
    pub semicolon: Option<usize>,
    /// A letter that stands twice, and the byte of its second word.
    twice: Option<(u8, usize)>,
}

/// What the block reader has to know of the control.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    pub macros: MacroRules,
    /// Switches of block skip: bit n-1 for `/n`.
    pub block_skip: u16,
}

fn bit(letter: u8) -> u32 {
    1 << (letter - b'A')
}

impl Block {
    pub(crate) fn new() -> Self {
        Block {
            words: [Word::default(); 26],
            present: 0,
            used: 0,
            g: [Code::default(); MOST_CODES],
            g_count: 0,
            m: [Code::default(); MOST_CODES],
            m_count: 0,
            comment: None,
            program: None,
            semicolon: None,
            twice: None,
        }
    }

    /// The word of that letter; asking counts as using it.
    pub(crate) fn take(&mut self, letter: u8) -> Option<Word> {
        self.used |= bit(letter);
        self.look(letter)
    }

    /// The word of that letter, without using it.
    pub(crate) fn look(&self, letter: u8) -> Option<Word> {
        (self.present & bit(letter) != 0).then(|| self.words[usize::from(letter - b'A')])
    }

    /// True when a word of one of these letters is there.
    pub(crate) fn has_any(&self, letters: &[u8]) -> bool {
        letters.iter().any(|l| self.present & bit(*l) != 0)
    }

    /// Counts all words but these as used.
    pub(crate) fn use_all_but(&mut self, letters: &[u8]) {
        self.used |= !letters.iter().fold(0, |mask, l| mask | bit(*l));
    }

    /// The first word that nothing in the block uses.
    pub(crate) fn unused(&self) -> Option<(char, Word)> {
        let left = self.present & !self.used;
        (left != 0).then(|| {
            let index = left.trailing_zeros() as u8;
            (char::from(b'A' + index), self.words[usize::from(index)])
        })
    }

    /// Refuses a block in which a letter stands twice.
    pub(crate) fn check_once(&self) -> Outcome<()> {
        match self.twice {
            None => Ok(()),
            Some((letter, at)) => Err(Fault::new(
                at,
                0,
                "word-twice",
                format!("{} stands twice in this block", char::from(letter)),
                "keep one of them, or make two blocks",
            )),
        }
    }

    pub(crate) fn g(&self, index: usize) -> Option<Code> {
        self.g[..self.g_count].get(index).copied()
    }

    pub(crate) fn m_codes(&self) -> ([Code; MOST_CODES], usize) {
        (self.m, self.m_count)
    }

    /// Reads a line.
    pub(crate) fn read<V: Variables>(&mut self, text: &[u8], reading: Reading, variables: &V) -> Outcome<Kind> {
        (self.present, self.used, self.g_count, self.m_count) = (0, 0, 0, 0);
        (self.comment, self.program, self.semicolon, self.twice) = (None, None, None, None);
        let mut at = 0;
        let mut any = false;
        while let Some(byte) = text.get(at).copied() {
            match byte {
                b' ' | b'\t' | b'\r' => at += 1,
                b'a'..=b'z' | b'A'..=b'Z' => {
                    let letter = byte.to_ascii_uppercase();
                    at = self.word(text, at, letter, reading, variables)?;
                    any = true;
                }
                b'(' => {
                    let Some(length) = text[at..].iter().position(|b| *b == b')') else {
                        return Err(Fault::new(
                            at,
                            0,
                            "comment-open",
                            "the comment that begins here has no end",
                            "put ) at its end, in the same line",
                        ));
                    };
                    self.comment.get_or_insert((at + 1, at + length));
                    at += length + 1;
                }
                b'#' => {
                    if any && self.present & !bit(b'N') != 0 || self.g_count + self.m_count > 0 {
                        return Err(mixed(at));
                    }
                    return Ok(Kind::Assignment { at });
                }
                b'/' => {
                    let (number, end) = match text.get(at + 1) {
                        Some(d @ b'1'..=b'9') => (d - b'0', at + 2),
                        _ => (1, at + 1),
                    };
                    if reading.block_skip >> (number - 1) & 1 == 1 {
                        break;
                    }
                    at = end;
                }
                b';' => {
                    self.semicolon = text[at + 1..].iter().any(|b| !matches!(b, b' ' | b'\t')).then_some(at);
                    break;
                }
                b'%' if !any => return Ok(Kind::TapeMark),
                _ => return Err(stray(text, at)),
            }
        }
        Ok(if any { Kind::Words } else { Kind::Blank })
    }

    /// Reads the word whose letter is at `at`, and gives the byte behind it.
    fn word<V: Variables>(&mut self, text: &[u8], at: usize, letter: u8, reading: Reading, variables: &V) -> Outcome<usize> {
        let mut next = at + 1;
        while let Some(b' ' | b'\t') = text.get(next) {
            next += 1;
        }
        let mut negative = false;
        let mut first = next;
        if let Some(sign @ (b'+' | b'-')) = text.get(next) {
            negative = *sign == b'-';
            first += 1;
        }
        let mut word = Word { at, ..Word::default() };
        let end;
        match text.get(first) {
            Some(b'0'..=b'9' | b'.') => {
                let Some(number) = number_at(text, first) else {
                    return Err(Fault::new(
                        first,
                        3,
                        "number",
                        format!(
                            "the number behind {} is a lone point or has more than 18 digits",
                            char::from(letter)
                        ),
                        "write a number such as 12.5",
                    ));
                };
                word.value = if negative { -number.value } else { number.value };
                word.has_point = number.has_point;
                end = number.end;
            }
            Some(b'#' | b'[' | b'+' | b'-' | b' ' | b'\t') => {
                if matches!(letter, b'N' | b'O') {
                    return Err(Fault::new(
                        first,
                        114,
                        "macro-format",
                        format!("{} takes no variable", char::from(letter)),
                        "write the number",
                    ));
                }
                let mut reader = Reader::new(text, next, reading.macros, variables);
                let value = reader.word_value()?;
                end = reader.end();
                let Value::Number(value) = value else {
                    return Ok(end); // vacant: the word is not there
                };
                word.value = if matches!(letter, b'G' | b'M' | b'S' | b'T') {
                    libm::round(value)
                } else {
                    value
                };
                word.computed = true;
            }
            Some(c) if c.is_ascii_alphabetic() => return Err(keyword(text, at)),
            _ => return Err(without_number(letter, at)),
        }
        self.put(letter, word)?;
        Ok(end)
    }

    fn put(&mut self, letter: u8, word: Word) -> Outcome<()> {
        let at = word.at;
        match letter {
            b'G' => {
                let tenfold = libm::round(word.value * 10.0);
                let fits = (0.0..=9999.0).contains(&tenfold) && (tenfold / 10.0 - word.value).abs() < 1e-9;
                let code = if fits { tenfold as u16 } else { u16::MAX };
                push(&mut self.g, &mut self.g_count, Code { code, at })
            }
            b'M' => {
                let fits = (0.0..=9999.0).contains(&word.value) && libm::trunc(word.value) == word.value;
                let code = if fits { word.value as u16 } else { u16::MAX };
                push(&mut self.m, &mut self.m_count, Code { code, at })
            }
            b'O' => {
                if !(0.0..=99_999_999.0).contains(&word.value) || word.has_point {
                    return Err(Fault::new(
                        at,
                        0,
                        "program-number",
                        "this is no program number",
                        "write O and 1 to 8 digits",
                    ));
                }
                self.program = Some((word.value as u32, at));
                Ok(())
            }
            _ => {
                if self.present & bit(letter) != 0 {
                    // Told when the block is executed: the arguments of a macro call may repeat I, J and K.
                    self.twice.get_or_insert((letter, at));
                    return Ok(());
                }
                self.present |= bit(letter);
                self.words[usize::from(letter - b'A')] = word;
                Ok(())
            }
        }
    }
}

fn push(codes: &mut [Code; MOST_CODES], count: &mut usize, code: Code) -> Outcome<()> {
    match codes.get_mut(*count) {
        Some(place) => {
            *place = code;
            *count += 1;
            Ok(())
        }
        None => Err(Fault::new(
            code.at,
            0,
            "too-many-codes",
            format!("more than {MOST_CODES} codes in one block"),
            "make two blocks",
        )),
    }
}

/// What may follow an assignment: nothing but blanks and comments.
pub(crate) fn check_behind_assignment(text: &[u8], end: usize) -> Outcome<()> {
    let mut at = end;
    while let Some(byte) = text.get(at) {
        match byte {
            b' ' | b'\t' | b'\r' => at += 1,
            b'(' => match text[at..].iter().position(|b| *b == b')') {
                Some(length) => at += length + 1,
                None => {
                    return Err(Fault::new(
                        at,
                        0,
                        "comment-open",
                        "the comment that begins here has no end",
                        "put ) at its end, in the same line",
                    ));
                }
            },
            b';' => return Ok(()),
            c if c.is_ascii_alphabetic() || *c == b'#' => return Err(mixed(at)),
            _ => {
                return Err(Fault::new(
                    at,
                    114,
                    "macro-format",
                    format!("expected an operator or the end of the block, found {}", shown(*byte)),
                    "correct the macro statement",
                ));
            }
        }
    }
    Ok(())
}

fn mixed(at: usize) -> Box<Fault> {
    Fault::new(
        at,
        127,
        "macro-and-nc",
        "a macro statement and other words in one block",
        "give the macro statement a block of its own",
    )
}

fn without_number(letter: u8, at: usize) -> Box<Fault> {
    Fault::new(
        at,
        5,
        "word-without-number",
        format!("there is no number behind {}", char::from(letter.to_ascii_uppercase())),
        "complete the word or take it out",
    )
}

/// Words of more than one letter.
const KEYWORDS: [&str; 19] = [
    "IF", "THEN", "WHILE", "DO", "END", "GOTO", "SETVN", "POPEN", "PCLOS", "DPRNT", "BPRNT", "ELSE", "SUB", "CALL", "ENDSUB",
    "ENDIF", "ENDWHILE", "REPEAT", "RETURN",
];

/// Why two letters stand together.
fn keyword(text: &[u8], at: usize) -> Box<Fault> {
    let letters = text[at..].iter().take_while(|c| c.is_ascii_alphabetic()).count();
    let written = text[at..at + letters].to_ascii_uppercase();
    let known = KEYWORDS
        .iter()
        .find(|k| k.as_bytes() == written || (written.len() >= 2 && k.len() > 2 && k.as_bytes().starts_with(&written)));
    match known {
        Some(keyword) => Fault::not_there_yet(at, &format!("the macro statement {keyword}")),
        None if letters == 1 => without_number(text[at], at),
        None => Fault::new(
            at,
            5,
            "word-without-number",
            format!(
                "expected a number behind {}, found {}",
                char::from(text[at].to_ascii_uppercase()),
                String::from_utf8_lossy(&written)
            ),
            "a word is a letter and a number; put remarks in ( )",
        ),
    }
}

fn stray(text: &[u8], at: usize) -> Box<Fault> {
    let byte = text[at];
    let remedy = match byte {
        b')' => "put ( before the comment; a comment ends at its first )",
        b'0'..=b'9' | b'.' | b'-' | b'+' => "put a letter before the number",
        b'[' | b']' | b'*' | b'=' => "expressions stand behind a letter: X[#1*2]",
        _ => "put remarks in ( ); is this a program of another kind?",
    };
    let message = format!("expected a word or a comment, found {}", shown(byte));
    Fault::new(at, 9, "stray-character", message, remedy)
}

fn shown(byte: u8) -> String {
    if byte.is_ascii_graphic() {
        char::from(byte).to_string()
    } else {
        format!("byte {byte}")
    }
}

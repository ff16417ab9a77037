//! One line of a program, taken apart: words with their numbers or expressions, the comment, or a macro statement.
//!
//! A [`Line`] is filled again and again; reading a plain line allocates nothing. The lines of a loop are kept, so that its text is read
//! once. Values of variables come in when it is executed.

use crate::expression::{Code, Expression, Parser};
use crate::fault::{Fault, Outcome};
use crate::listing::{name_at, number_of_name, word_of_name};
use crate::macro_b::MacroRules;
use crate::statement::{Statement, is_keyword, mixed, no_keyword, open_comment, shown, statement};
use crate::text::number_at;

/// What a line holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Nothing, or comments only.
    #[default]
    Blank,
    /// Words.
    Words,
    /// A macro statement.
    Statement,
    /// `%`.
    TapeMark,
}

/// Where a word's number comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Source {
    Number(f64),
    Expression(Expression),
}

/// A word as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SaidWord {
    /// A small letter stands for a corner's word, `,C`.
    pub letter: u8,
    pub has_point: bool,
    /// The byte of its letter.
    pub at: u32,
    pub source: Source,
}

/// A line taken apart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Line {
    pub kind: Kind,
    pub words: Vec<SaidWord>,
    pub code: Code,
    pub statement: Option<Statement>,
    /// Sequence number at its head.
    pub sequence: Option<u32>,
    /// Program number, from an O word or behind a colon.
    pub program: Option<(u32, usize)>,
    /// Bytes between the parentheses of the first comment.
    pub comment: Option<(usize, usize)>,
    /// Where the text of the first comment begins that is one of the traceability vocabulary.
    pub function: Option<usize>,
    /// Text behind `;` was left out, from this byte on.
    pub semicolon: Option<usize>,
    /// A switch decides whether it, or a part of it, is executed; it is off.
    pub skippable: bool,
}

/// What the line reader has to know of the control.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    pub macros: MacroRules,
    /// Switches of block skip: bit n-1 for `/n`.
    pub block_skip: u16,
}

impl Line {
    /// Reads a line. Nothing of an earlier one is left, also behind an error.
    pub(crate) fn read(&mut self, text: &[u8], reading: &Reading) -> Outcome<()> {
        self.words.clear();
        if self.statement.is_some() || !self.code.is_empty() {
            self.code.clear();
            self.statement = None;
        }
        (self.sequence, self.program, self.comment, self.semicolon) = (None, None, None, None);
        self.function = None;
        self.skippable = false;
        self.kind = Kind::Blank;
        let mut at = 0;
        while let Some(byte) = text.get(at).copied() {
            match byte {
                b' ' | b'\t' | b'\r' => at += 1,
                b'a'..=b'z' | b'A'..=b'Z' => {
                    if text.get(at + 1).is_some_and(u8::is_ascii_alphabetic) {
                        if !is_keyword(text, at) {
                            return Err(no_keyword(text, at));
                        }
                        return self.macro_statement(text, at, &reading.macros);
                    }
                    at = self.word(text, at, byte.to_ascii_uppercase(), &reading.macros)?;
                    self.kind = Kind::Words;
                }
                b'(' => {
                    let Some(length) = text[at..].iter().position(|b| *b == b')') else {
                        return Err(open_comment(at));
                    };
                    self.take_comment(text, at + 1, at + length);
                    at += length + 1;
                }
                b'#' => return self.macro_statement(text, at, &reading.macros),
                b'[' if text[at + 1..].trim_ascii_start().first() == Some(&b'#') => {
                    return self.macro_statement(text, at, &reading.macros);
                }
                b'/' => {
                    let (number, end) = match text.get(at + 1) {
                        Some(d @ b'1'..=b'9') => (d - b'0', at + 2),
                        _ => (1, at + 1),
                    };
                    if reading.block_skip >> (number - 1) & 1 == 1 {
                        break;
                    }
                    self.skippable = true;
                    at = end;
                }
                b';' => {
                    self.semicolon = text[at + 1..].iter().any(|b| !matches!(b, b' ' | b'\t')).then_some(at);
                    break;
                }
                b',' if text
                    .get(at + 1)
                    .is_some_and(|c| matches!(c.to_ascii_uppercase(), b'C' | b'R' | b'A')) =>
                {
                    let letter = text[at + 1].to_ascii_lowercase();
                    at = self.word(text, at + 1, letter, &reading.macros)?;
                    self.kind = Kind::Words;
                }
                b':' if self.kind == Kind::Blank && text.get(at + 1).is_some_and(u8::is_ascii_digit) => {
                    at = self.word(text, at, b'O', &reading.macros)?;
                    self.kind = Kind::Words;
                }
                b'<' if reading.macros.named_programs => {
                    let Some((name, end)) = name_at(text, at) else {
                        return Err(Fault::new(
                            at,
                            114,
                            "macro-format",
                            "this is no name of a program",
                            "write < >, and 1 to 32 letters, digits, + - _ . between",
                        ));
                    };
                    if self.words.is_empty() {
                        // At the head of its line it is the program's own name.
                        self.program = Some((number_of_name(name), at));
                    } else {
                        self.words.push(SaidWord {
                            letter: b'P',
                            has_point: false,
                            at: at as u32,
                            source: Source::Number(word_of_name(name)),
                        });
                    }
                    self.kind = Kind::Words;
                    at = end;
                }
                b'%' if self.kind == Kind::Blank => {
                    self.kind = Kind::TapeMark;
                    return Ok(());
                }
                _ => return Err(stray(text, at)),
            }
        }
        Ok(())
    }

    fn macro_statement(&mut self, text: &[u8], at: usize, rules: &MacroRules) -> Outcome<()> {
        if self.words.iter().any(|w| w.letter != b'N') {
            return Err(mixed(at));
        }
        let (statement, behind) = statement(text, at, rules, &mut self.code)?;
        // What is printed, and names, may hold any characters; elsewhere a bracket begins a comment, in the middle of an expression too.
        let from = match statement {
            Statement::Print { .. } | Statement::SetNames { .. } => behind,
            _ => at,
        };
        self.take_comments(text, from, text.len());
        self.statement = Some(statement);
        self.kind = Kind::Statement;
        Ok(())
    }

    /// The comments of a part of the line, up to a semicolon.
    fn take_comments(&mut self, text: &[u8], from: usize, end: usize) {
        let mut at = from;
        while let Some(open) = text[at..end].iter().position(|b| matches!(b, b'(' | b';')) {
            let open = at + open;
            let length = text[open..end].iter().position(|b| *b == b')');
            let Some(length) = length.filter(|_| text[open] == b'(') else {
                return;
            };
            self.take_comment(text, open + 1, open + length);
            at = open + length + 1;
        }
    }

    /// The bytes between the parentheses of a comment.
    fn take_comment(&mut self, text: &[u8], from: usize, to: usize) {
        self.comment.get_or_insert((from, to));
        let word = text[from..to].trim_ascii_start().get(..6);
        if self.function.is_none() && word.is_some_and(|word| word.eq_ignore_ascii_case(b"trace:")) {
            self.function = Some(from);
        }
    }

    /// Reads the word whose letter is at `at`, and gives the byte behind it.
    fn word(&mut self, text: &[u8], at: usize, letter: u8, rules: &MacroRules) -> Outcome<usize> {
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
        let (source, has_point, end) = match text.get(first) {
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
                let value = if negative { -number.value } else { number.value };
                (Source::Number(value), number.has_point, number.end)
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
                let mut parser = Parser::new(text, next, rules, &mut self.code);
                let expression = parser.word_value()?;
                let end = parser.at;
                self.take_comments(text, next, end);
                (Source::Expression(expression), false, end)
            }
            Some(c) if c.is_ascii_alphabetic() => return Err(no_keyword(text, at)),
            _ => {
                return Err(Fault::new(
                    at,
                    5,
                    "word-without-number",
                    format!("there is no number behind {}", char::from(letter.to_ascii_uppercase())),
                    "complete the word or take it out",
                ));
            }
        };
        match (letter, source) {
            // O names a program at the head of its line only.
            (b'O', Source::Number(value)) if self.words.iter().all(|w| w.letter == b'N') => {
                if !(0.0..=99_999_999.0).contains(&value) || has_point {
                    return Err(Fault::new(
                        at,
                        0,
                        "program-number",
                        "this is no program number",
                        "write O and 1 to 8 digits",
                    ));
                }
                self.program = Some((value as u32, at));
            }
            _ => {
                if let (b'N', Source::Number(value), None) = (letter, source, self.sequence)
                    && self.words.is_empty()
                {
                    self.sequence = Some(value as u32);
                }
                self.words.push(SaidWord {
                    letter,
                    has_point,
                    at: at as u32,
                    source,
                });
            }
        }
        Ok(end)
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

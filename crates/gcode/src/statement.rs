//! Macro statements, taken apart once: assignment, branches, loops, names and printing.

use crate::expression::{Code, Expression, Parser, Target, is_name};
use crate::fault::{Fault, Outcome};
use crate::macro_b::MacroRules;

/// A macro statement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Statement {
    /// `#i=value`; `end` is the byte behind the value.
    Assign {
        target: Target,
        value: Expression,
        at: usize,
        end: usize,
    },
    /// `GOTO n`.
    Goto { number: Expression, at: usize },
    /// `IF [condition] GOTO n`, `IF [condition] THEN statement`.
    If { condition: Expression, then: Box<Statement> },
    /// `WHILE [condition] DO m`, `DO m`.
    Do {
        condition: Option<Expression>,
        label: u8,
        at: usize,
    },
    /// `END m`.
    End { label: u8, at: usize },
    /// `SETVN n[NAME,NAME]`.
    SetNames {
        first: Expression,
        names: Vec<String>,
        at: usize,
    },
    /// `POPEN`.
    OpenPrinter,
    /// `PCLOS`.
    ClosePrinter,
    /// `DPRNT[...]`, `BPRNT[...]`.
    Print { binary: bool, pieces: Vec<Piece>, at: usize },
}

/// A part of a printed line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Piece {
    Text(String),
    /// A variable with digits before and behind the point.
    Number {
        value: Expression,
        whole: u8,
        decimals: u8,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keyword {
    If,
    Then,
    While,
    Do,
    End,
    Goto,
    SetNames,
    Open,
    Close,
    Print,
    BinaryPrint,
}

const KEYWORDS: [(&str, Keyword); 11] = [
    ("IF", Keyword::If),
    ("THEN", Keyword::Then),
    ("WHILE", Keyword::While),
    ("DO", Keyword::Do),
    ("END", Keyword::End),
    ("GOTO", Keyword::Goto),
    ("SETVN", Keyword::SetNames),
    ("POPEN", Keyword::Open),
    ("PCLOS", Keyword::Close),
    ("DPRNT", Keyword::Print),
    ("BPRNT", Keyword::BinaryPrint),
];

/// Words of other dialects that a reader should hear of by their name.
const OTHERS: [&str; 8] = ["ELSE", "SUB", "CALL", "ENDSUB", "ENDIF", "ENDWHILE", "REPEAT", "RETURN"];

/// True when two letters at `at` begin a macro statement.
pub(crate) fn is_keyword(text: &[u8], at: usize) -> bool {
    keyword_at(text, at).is_some()
}

fn letters_at(text: &[u8], at: usize) -> &[u8] {
    let count = text[at..].iter().take_while(|c| c.is_ascii_alphabetic()).count();
    &text[at..at + count]
}

/// The keyword that stands at `at`, and the byte behind it.
fn keyword_at(text: &[u8], at: usize) -> Option<(Keyword, usize)> {
    let letters = letters_at(text, at).to_ascii_uppercase();
    if letters.len() < 2 {
        return None;
    }
    if letters.starts_with(b"THEN") {
        return Some((Keyword::Then, at + 4)); // another statement may follow without a blank
    }
    KEYWORDS
        .iter()
        .find(|(full, _)| is_name(&letters, full))
        .map(|(_, keyword)| (*keyword, at + letters.len()))
}

/// Why two letters stand together.
pub(crate) fn no_keyword(text: &[u8], at: usize) -> Box<Fault> {
    let letters = letters_at(text, at).to_ascii_uppercase();
    let shown = String::from_utf8_lossy(&letters).into_owned();
    if letters.len() == 1 {
        return Fault::new(
            at,
            5,
            "word-without-number",
            format!("there is no number behind {shown}"),
            "complete the word or take it out",
        );
    }
    if OTHERS.contains(&shown.as_str()) {
        return Fault::not_there_yet(at, &format!("the macro statement {shown}"));
    }
    Fault::new(
        at,
        5,
        "word-without-number",
        format!(
            "expected a number behind {}, found {shown}",
            char::from(text[at].to_ascii_uppercase())
        ),
        "a word is a letter and a number; put remarks in ( )",
    )
}

/// Reads the statement that begins at `at`: at its `#`, its `[#`, or its keyword; gives the byte behind it too. Nothing but comments may
/// follow.
pub(crate) fn statement(text: &[u8], at: usize, rules: &MacroRules, code: &mut Code) -> Outcome<(Statement, usize)> {
    let mut parser = Parser::new(text, at, rules, code);
    let statement = parser.statement(false)?;
    let behind = parser.at;
    check_behind(text, behind)?;
    Ok((statement, behind))
}

impl Parser<'_> {
    fn statement(&mut self, conditional: bool) -> Outcome<Statement> {
        let at = self.at_next();
        if matches!(self.peek(), Some(b'#' | b'[')) {
            return self.assignment();
        }
        let Some((keyword, behind)) = keyword_at(self.text, at) else {
            return match self.peek() {
                Some(c) if c.is_ascii_alphabetic() => Err(mixed(at)),
                _ => Err(self.format_error("expected a macro statement", "write an assignment or GOTO")),
            };
        };
        self.at = behind;
        match keyword {
            Keyword::Goto => self.goto(at),
            Keyword::If if !conditional => {
                let condition = self.condition()?;
                let at = self.at_next();
                match keyword_at(self.text, at) {
                    Some((Keyword::Goto, behind)) => {
                        self.at = behind;
                        let then = Box::new(self.goto(at)?);
                        Ok(Statement::If { condition, then })
                    }
                    Some((Keyword::Then, behind)) => {
                        self.at = behind;
                        let then = Box::new(self.statement(true)?);
                        Ok(Statement::If { condition, then })
                    }
                    _ => Err(self.format_error(
                        "expected GOTO or THEN behind the condition",
                        "write IF[...]GOTO n or IF[...]THEN #1=0",
                    )),
                }
            }
            Keyword::While if !conditional => {
                let condition = self.condition()?;
                let at = self.at_next();
                match keyword_at(self.text, at) {
                    Some((Keyword::Do, behind)) => {
                        self.at = behind;
                        self.loop_at(Some(condition), at)
                    }
                    _ => Err(self.format_error("expected DO behind the condition", "write WHILE[...]DO1")),
                }
            }
            Keyword::Do if !conditional => self.loop_at(None, at),
            Keyword::End if !conditional => {
                let label = self.label(at)?;
                Ok(Statement::End { label, at })
            }
            Keyword::SetNames => self.names(at),
            Keyword::Open => Ok(Statement::OpenPrinter),
            Keyword::Close => Ok(Statement::ClosePrinter),
            Keyword::Print => self.print(false, at),
            Keyword::BinaryPrint => self.print(true, at),
            Keyword::Then => {
                self.at = at;
                Err(self.format_error("THEN without IF", "write IF[...]THEN #1=0"))
            }
            _ => {
                self.at = at;
                Err(self.format_error(
                    "IF, WHILE, DO and END cannot stand behind THEN",
                    "jump over a part of the program with GOTO instead",
                ))
            }
        }
    }

    fn assignment(&mut self) -> Outcome<Statement> {
        let at = self.at_next();
        let target = self.target()?;
        if self.peek() != Some(b'=') {
            return Err(self.format_error("expected = behind the variable", "a macro statement reads #100=expression"));
        }
        self.at += 1;
        let end = self.at;
        let value = self.value()?;
        Ok(Statement::Assign { target, value, at, end })
    }

    fn goto(&mut self, at: usize) -> Outcome<Statement> {
        match self.peek() {
            Some(b'0'..=b'9' | b'#' | b'[' | b'.' | b'+' | b'-') => {
                let number = self.value()?;
                Ok(Statement::Goto { number, at })
            }
            _ => Err(Fault::new(
                at,
                128,
                "goto-number",
                "GOTO without a sequence number",
                "write GOTO and 1 to 99999, a variable or [expression]",
            )),
        }
    }

    fn loop_at(&mut self, condition: Option<Expression>, at: usize) -> Outcome<Statement> {
        let label = self.label(at)?;
        Ok(Statement::Do { condition, label, at })
    }

    /// The number behind DO and END.
    fn label(&mut self, at: usize) -> Outcome<u8> {
        self.peek();
        let digits = self.text[self.at..].iter().take_while(|c| c.is_ascii_digit()).count();
        let label = &self.text[self.at..self.at + digits];
        let number = label
            .iter()
            .fold(0_u32, |n, d| n.saturating_mul(10).saturating_add(u32::from(d - b'0')));
        self.at += digits;
        if digits == 0 || !(1..=3).contains(&number) || self.text.get(self.at) == Some(&b'.') {
            let found = match self.text.get(self.at) {
                _ if digits > 0 => number.to_string(),
                Some(c) if c.is_ascii_graphic() => char::from(*c).to_string(),
                _ => "nothing".to_owned(),
            };
            return Err(Fault::new(
                at,
                126,
                "loop-number",
                format!("the number of a loop is 1, 2 or 3, found {found}"),
                "write DO1, DO2 or DO3, and END with the same number",
            ));
        }
        Ok(number as u8)
    }

    /// Behind SETVN: `501[DIM A,DIM B]`.
    fn names(&mut self, at: usize) -> Outcome<Statement> {
        if self.peek() == Some(b'#') {
            self.at += 1;
        }
        let first = self.word_value()?;
        let inside = self.inside_brackets("SETVN 501[NAME,NAME]")?;
        let text = crate::text::characters(inside);
        let names = text.split(',').map(|n| n.trim().to_uppercase()).collect();
        Ok(Statement::SetNames { first, names, at })
    }

    /// The bytes between `[` and the next `]`.
    fn inside_brackets(&mut self, example: &str) -> Outcome<&[u8]> {
        if self.peek() != Some(b'[') {
            return Err(self.format_error("expected [", &format!("write {example}")));
        }
        let from = self.at + 1;
        match self.text[from..].iter().position(|c| *c == b']') {
            Some(length) => {
                self.at = from + length + 1;
                Ok(&self.text[from..from + length])
            }
            None => {
                self.at = self.text.len();
                Err(self.format_error(&format!("expected ] for the [ in column {from}"), "close the bracket"))
            }
        }
    }

    /// Behind DPRNT or BPRNT: `[TEXT*#1[33]]`.
    fn print(&mut self, binary: bool, at: usize) -> Outcome<Statement> {
        if self.peek() != Some(b'[') {
            return Err(self.format_error("expected [", "write DPRNT[TEXT#1[33]]"));
        }
        let open = self.at + 1;
        self.at += 1;
        let mut pieces = Vec::new();
        let mut text = String::new();
        loop {
            match self.text.get(self.at).copied() {
                Some(b']') => {
                    self.at += 1;
                    break;
                }
                Some(b'*') => {
                    text.push(' ');
                    self.at += 1;
                }
                Some(b'#') => {
                    if !text.is_empty() {
                        pieces.push(Piece::Text(std::mem::take(&mut text)));
                    }
                    let value = self.word_value()?;
                    let (whole, decimals) = self.field(binary)?;
                    pieces.push(Piece::Number { value, whole, decimals });
                }
                Some(b' ' | b'\t') => self.at += 1,
                Some(c) if c.is_ascii_graphic() => {
                    text.push(char::from(c.to_ascii_uppercase()));
                    self.at += 1;
                }
                Some(_) => return Err(self.format_error("this character cannot be printed", "use A-Z 0-9 + - / . and *")),
                None => {
                    return Err(self.format_error(&format!("expected ] for the [ in column {open}"), "close the bracket"));
                }
            }
        }
        if !text.is_empty() {
            pieces.push(Piece::Text(text));
        }
        Ok(Statement::Print { binary, pieces, at })
    }

    /// `[cd]`: digits before and behind the point; `[d]` of BPRNT.
    fn field(&mut self, binary: bool) -> Outcome<(u8, u8)> {
        self.peek();
        let at = self.at;
        let inside = self.inside_brackets("#1[33]")?;
        let mut digits = inside.iter().filter(|c| !c.is_ascii_whitespace());
        let field = match (digits.next(), digits.next(), digits.next()) {
            (Some(d @ b'0'..=b'9'), None, None) if binary => (0, d - b'0'),
            (Some(c @ b'0'..=b'9'), Some(d @ b'0'..=b'9'), None) if !binary => (c - b'0', d - b'0'),
            _ => (0, u8::MAX),
        };
        if field.1 == u8::MAX || (!binary && !(1..=15).contains(&(field.0 + field.1))) {
            return Err(Fault::new(
                at,
                114,
                "macro-format",
                if binary {
                    "expected one digit in the bracket: the decimals"
                } else {
                    "expected two digits in the bracket: 1 to 15 places before and behind the point together"
                },
                if binary { "write #1[3]" } else { "write #1[33]" },
            ));
        }
        Ok(field)
    }
}

/// What may follow a macro statement: nothing but blanks and comments.
fn check_behind(text: &[u8], end: usize) -> Outcome<()> {
    let mut at = end;
    while let Some(byte) = text.get(at) {
        match byte {
            b' ' | b'\t' | b'\r' => at += 1,
            b'(' => match text[at..].iter().position(|b| *b == b')') {
                Some(length) => at += length + 1,
                None => return Err(open_comment(at)),
            },
            b';' => return Ok(()),
            c if c.is_ascii_alphabetic() && !letters_at(text, at)[1..].is_empty() => {
                let word = String::from_utf8_lossy(letters_at(text, at)).into_owned();
                return Err(match keyword_at(text, at) {
                    Some(_) => mixed(at),
                    None => Fault::new(
                        at,
                        114,
                        "macro-format",
                        format!("{word} is no operator"),
                        "operators are EQ NE GT GE LT LE AND OR XOR MOD + - * /",
                    ),
                });
            }
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

pub(crate) fn open_comment(at: usize) -> Box<Fault> {
    Fault::new(
        at,
        0,
        "comment-open",
        "the comment that begins here has no end",
        "put ) at its end, in the same line",
    )
}

pub(crate) fn mixed(at: usize) -> Box<Fault> {
    Fault::new(
        at,
        127,
        "macro-and-nc",
        "a macro statement and other words in one block",
        "give the macro statement a block of its own",
    )
}

pub(crate) fn shown(byte: u8) -> String {
    if byte.is_ascii_graphic() {
        char::from(byte).to_string()
    } else {
        format!("byte {byte}")
    }
}

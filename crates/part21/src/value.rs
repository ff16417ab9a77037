//! Parameters of an instance: [`Value`], parsed when asked for.
//!
//! Parsing borrows from the file where it can. It accepts what files really hold (reals without a point before the exponent, blanks
//! and comments anywhere) and gives a fault with the offset where it cannot go on.

use crate::text;
use std::borrow::Cow;
use std::fmt;

/// One parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'a> {
    /// A whole number.
    Integer(i64),
    /// A number with a point or an exponent, or a whole number beyond 64 bits.
    Real(f64),
    /// A string, decoded.
    String(Cow<'a, str>),
    /// `.NAME.`, without the points.
    Enumeration(Cow<'a, str>),
    /// `"0A1F"`: the hexadecimal digits.
    Binary(Cow<'a, str>),
    /// `#id`.
    Reference(u64),
    /// `@id`, a value of the REFERENCE section (edition 3).
    ValueReference(u64),
    /// `#NAME`, an instance that the schema names (edition 3); the name in upper case.
    EntityConstant(Cow<'a, str>),
    /// `@NAME`, a value that the schema names (edition 3); the name in upper case.
    ValueConstant(Cow<'a, str>),
    /// `<uri>`, in ANCHOR sections (edition 3).
    Resource(Cow<'a, str>),
    /// `( , , )`.
    List(Vec<Value<'a>>),
    /// `KEYWORD(..)`, a value that names its type.
    Typed(Cow<'a, str>, Vec<Value<'a>>),
    /// `$`.
    Unset,
    /// `*`.
    Derived,
}

/// One part of an instance: a keyword with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Record<'a> {
    /// The entity's name in upper case; a user-defined one begins with `!`.
    pub keyword: Cow<'a, str>,
    /// Its parameters in order.
    pub arguments: Vec<Value<'a>>,
}

/// One instance.
#[derive(Clone, Debug, PartialEq)]
pub enum Instance<'a> {
    /// `#1=KEYWORD(..)`.
    Simple(Record<'a>),
    /// `#1=(A() B(..))`, parts in the order of the file.
    Complex(Vec<Record<'a>>),
}

impl<'a> Instance<'a> {
    /// The parts: one of a simple instance.
    pub fn records(&self) -> &[Record<'a>] {
        match self {
            Instance::Simple(record) => std::slice::from_ref(record),
            Instance::Complex(records) => records,
        }
    }

    /// The parameters of the part named `keyword` (upper case).
    pub fn part(&self, keyword: &str) -> Option<&[Value<'a>]> {
        let record = self.records().iter().find(|record| record.keyword == keyword)?;
        Some(&record.arguments)
    }

    /// The `n`-th parameter of a simple instance, counted from 0; [`Value::Unset`] when there are fewer.
    pub fn argument(&self, n: usize) -> &Value<'a> {
        match self {
            Instance::Simple(record) => record.arguments.get(n).unwrap_or(&Value::Unset),
            Instance::Complex(_) => &Value::Unset,
        }
    }
}

impl<'a> Value<'a> {
    /// The number of an integer, a real, or a typed value that holds one (`LENGTH_MEASURE(2.5)`).
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Integer(n) => Some(*n as f64),
            Value::Real(x) => Some(*x),
            Value::Typed(_, arguments) => match arguments.as_slice() {
                [only] => only.number(),
                _ => None,
            },
            _ => None,
        }
    }

    /// The text of a string, or of a typed value that holds one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Value::String(text) => Some(text),
            Value::Typed(_, arguments) => match arguments.as_slice() {
                [only] => only.text(),
                _ => None,
            },
            _ => None,
        }
    }

    /// The identifier of a reference.
    pub fn reference(&self) -> Option<u64> {
        match self {
            Value::Reference(id) => Some(*id),
            _ => None,
        }
    }

    /// The items of a list; nothing for any other value.
    pub fn items(&self) -> &[Value<'a>] {
        match self {
            Value::List(items) => items,
            _ => &[],
        }
    }

    /// The references directly in a list.
    pub fn references(&self) -> impl Iterator<Item = u64> + '_ {
        self.items().iter().filter_map(Value::reference)
    }

    /// The name of an enumeration value: `T` for `.T.`.
    pub fn enumeration(&self) -> Option<&str> {
        match self {
            Value::Enumeration(name) => Some(name),
            _ => None,
        }
    }

    /// True for `.T.`, false for `.F.`.
    pub fn boolean(&self) -> Option<bool> {
        match self.enumeration()? {
            "T" => Some(true),
            "F" => Some(false),
            _ => None,
        }
    }

    /// The same value, borrowing nothing.
    pub fn into_owned(self) -> Value<'static> {
        let own = |text: Cow<'a, str>| Cow::Owned(text.into_owned());
        let own_all = |values: Vec<Value<'a>>| values.into_iter().map(Value::into_owned).collect();
        match self {
            Value::Integer(n) => Value::Integer(n),
            Value::Real(x) => Value::Real(x),
            Value::String(t) => Value::String(own(t)),
            Value::Enumeration(t) => Value::Enumeration(own(t)),
            Value::Binary(t) => Value::Binary(own(t)),
            Value::Reference(id) => Value::Reference(id),
            Value::ValueReference(id) => Value::ValueReference(id),
            Value::EntityConstant(t) => Value::EntityConstant(own(t)),
            Value::ValueConstant(t) => Value::ValueConstant(own(t)),
            Value::Resource(t) => Value::Resource(own(t)),
            Value::List(values) => Value::List(own_all(values)),
            Value::Typed(keyword, values) => Value::Typed(own(keyword), own_all(values)),
            Value::Unset => Value::Unset,
            Value::Derived => Value::Derived,
        }
    }
}

impl fmt::Display for Value<'_> {
    /// The value as Part 21 text.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |f: &mut fmt::Formatter<'_>, values: &[Value]| {
            f.write_str("(")?;
            for (n, value) in values.iter().enumerate() {
                let comma = if n > 0 { "," } else { "" };
                write!(f, "{comma}{value}")?;
            }
            f.write_str(")")
        };
        match self {
            Value::Integer(n) => write!(f, "{n}"),
            Value::Real(x) => f.write_str(&text::real(*x)),
            Value::String(t) => f.write_str(&text::encode(t)),
            Value::Enumeration(t) => write!(f, ".{t}."),
            Value::Binary(t) => write!(f, "\"{t}\""),
            Value::Reference(id) => write!(f, "#{id}"),
            Value::ValueReference(id) => write!(f, "@{id}"),
            Value::EntityConstant(t) => write!(f, "#{t}"),
            Value::ValueConstant(t) => write!(f, "@{t}"),
            Value::Resource(t) => write!(f, "<{t}>"),
            Value::List(values) => list(f, values),
            Value::Typed(keyword, values) => {
                f.write_str(keyword)?;
                list(f, values)
            }
            Value::Unset => f.write_str("$"),
            Value::Derived => f.write_str("*"),
        }
    }
}

/// Why parameters could not be parsed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) code: &'static str,
    pub(crate) message: String,
    pub(crate) offset: usize,
}

/// Lists deeper than this are refused: no schema nests so far, and the stack is finite.
const DEEPEST: u32 = 100;

pub(crate) struct Parser<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) at: usize,
    /// The first comment that is never closed: from it on, a comment that begins ends with its line.
    pub(crate) unclosed_comment: Option<usize>,
    depth: u32,
}

impl<'a> Parser<'a> {
    pub(crate) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self {
            bytes,
            at,
            unclosed_comment: None,
            depth: 0,
        }
    }

    pub(crate) fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    /// Skips blanks, comments, and the print directives `\N\` and `\F\`, which separate tokens as blanks do.
    ///
    /// A comment that is never closed takes its line only: what follows may still be read.
    pub(crate) fn skip_blanks(&mut self) {
        loop {
            match self.peek() {
                Some(byte) if byte.is_ascii_whitespace() || byte == 0x0b => self.at += 1,
                Some(b'/') if self.bytes.get(self.at + 1) == Some(&b'*') => self.skip_comment(),
                Some(b'\\') if matches!(self.bytes[self.at..], [b'\\', b'N' | b'F', b'\\', ..]) => self.at += 3,
                _ => return,
            }
        }
    }

    /// Skips the comment at the cursor.
    fn skip_comment(&mut self) {
        let start = self.at;
        let inside = &self.bytes[start + 2..];
        // One search finds that there is no end; the others need not look again.
        if self.unclosed_comment.is_none_or(|first| start < first) {
            if let Some(length) = inside.windows(2).position(|pair| pair == b"*/") {
                self.at = start + 2 + length + 2;
                return;
            }
            self.unclosed_comment = Some(start);
        }
        let line = inside.iter().position(|&byte| byte == b'\n').unwrap_or(inside.len());
        self.at = start + 2 + line;
    }

    pub(crate) fn fault<T>(&self, code: &'static str, message: impl Into<String>) -> Result<T, Fault> {
        Err(Fault {
            code,
            message: message.into(),
            offset: self.at,
        })
    }

    pub(crate) fn expect(&mut self, byte: u8) -> Result<(), Fault> {
        self.skip_blanks();
        if self.peek() == Some(byte) {
            self.at += 1;
            return Ok(());
        }
        let found = self
            .peek()
            .map_or("the end of the text".into(), |found| format!("{:?}", char::from(found)));
        self.fault("syntax", format!("expected {:?}, found {found}", char::from(byte)))
    }

    pub(crate) fn digits(&mut self) -> Option<u64> {
        let start = self.at;
        while self.peek().is_some_and(|byte| byte.is_ascii_digit()) {
            self.at += 1;
        }
        std::str::from_utf8(&self.bytes[start..self.at]).ok()?.parse().ok()
    }

    /// A keyword, upper-cased, `!` included; empty when there is none.
    pub(crate) fn keyword(&mut self) -> Cow<'a, str> {
        let start = self.at;
        if self.peek() == Some(b'!') {
            self.at += 1;
        }
        while self.peek().is_some_and(is_word) {
            self.at += 1;
        }
        upper(&self.bytes[start..self.at])
    }

    /// What stands behind `#id=`, up to and with the semicolon.
    pub(crate) fn instance(&mut self) -> Result<Instance<'a>, Fault> {
        self.skip_blanks();
        let instance = if self.peek() == Some(b'(') {
            self.at += 1;
            let mut records = Vec::new();
            loop {
                self.skip_blanks();
                if self.peek() == Some(b')') {
                    self.at += 1;
                    break Instance::Complex(records);
                }
                records.push(self.record()?);
            }
        } else {
            Instance::Simple(self.record()?)
        };
        self.expect(b';')?;
        Ok(instance)
    }

    pub(crate) fn record(&mut self) -> Result<Record<'a>, Fault> {
        self.skip_blanks();
        let keyword = self.keyword();
        if keyword.is_empty() {
            return self.fault("syntax", "expected an entity name");
        }
        self.expect(b'(')?;
        let arguments = self.list()?;
        Ok(Record { keyword, arguments })
    }

    /// The items of a list whose `(` is read, up to and with its `)`.
    pub(crate) fn list(&mut self) -> Result<Vec<Value<'a>>, Fault> {
        if self.depth >= DEEPEST {
            return self.fault("nesting", "lists are nested more than 100 deep");
        }
        self.depth += 1;
        let mut items = Vec::new();
        self.skip_blanks();
        if self.peek() == Some(b')') {
            self.at += 1;
            self.depth -= 1;
            return Ok(items);
        }
        loop {
            items.push(self.value()?);
            self.skip_blanks();
            match self.peek() {
                Some(b',') => self.at += 1,
                Some(b')') => {
                    self.at += 1;
                    self.depth -= 1;
                    return Ok(items);
                }
                _ => return self.fault("syntax", "expected a comma or a closing parenthesis"),
            }
        }
    }

    pub(crate) fn value(&mut self) -> Result<Value<'a>, Fault> {
        self.skip_blanks();
        let Some(byte) = self.peek() else {
            return self.fault("syntax", "the text ends where a value should be");
        };
        match byte {
            b'\'' => self.string(),
            b'(' => {
                self.at += 1;
                Ok(Value::List(self.list()?))
            }
            b'$' => {
                self.at += 1;
                Ok(Value::Unset)
            }
            b'*' => {
                self.at += 1;
                Ok(Value::Derived)
            }
            b'#' | b'@' => {
                self.at += 1;
                self.skip_blanks(); // seen between # and its number
                if self.peek().is_some_and(|next| next.is_ascii_alphabetic()) {
                    let name = self.keyword();
                    return Ok(match byte {
                        b'#' => Value::EntityConstant(name),
                        _ => Value::ValueConstant(name),
                    });
                }
                match self.digits() {
                    Some(id) if byte == b'#' => Ok(Value::Reference(id)),
                    Some(id) => Ok(Value::ValueReference(id)),
                    None => self.fault("reference", "a reference needs a number below 2^64"),
                }
            }
            b'.' if self.bytes.get(self.at + 1).is_some_and(|next| !next.is_ascii_digit()) => {
                let name = self.enclosed(b'.')?;
                Ok(Value::Enumeration(upper(name)))
            }
            b'"' => Ok(Value::Binary(String::from_utf8_lossy(self.enclosed(b'"')?))),
            b'<' => {
                let name = self.enclosed(b'>')?;
                Ok(Value::Resource(String::from_utf8_lossy(name)))
            }
            b'0'..=b'9' | b'+' | b'-' | b'.' => self.number(),
            _ if is_word(byte) || byte == b'!' => {
                let keyword = self.keyword();
                self.expect(b'(')?;
                let arguments = self.list()?;
                Ok(Value::Typed(keyword, arguments))
            }
            _ => self.fault("syntax", format!("{:?} begins no value", char::from(byte))),
        }
    }

    /// The bytes between the delimiter at the cursor and `close`, on one line.
    fn enclosed(&mut self, close: u8) -> Result<&'a [u8], Fault> {
        let start = self.at + 1;
        let rest = &self.bytes[start..];
        match rest.iter().position(|&byte| byte == close || byte == b'\n') {
            Some(length) if rest[length] == close => {
                self.at = start + length + 1;
                Ok(&rest[..length])
            }
            _ => self.fault("syntax", format!("a closing {:?} is missing", char::from(close))),
        }
    }

    fn string(&mut self) -> Result<Value<'a>, Fault> {
        let start = self.at + 1;
        let Some(end) = text::string_end(self.bytes, start) else {
            return self.fault("unterminated-string", "a string is not closed");
        };
        self.at = end;
        Ok(Value::String(text::decode(&self.bytes[start..end - 1])))
    }

    fn number(&mut self) -> Result<Value<'a>, Fault> {
        let start = self.at;
        while self
            .peek()
            .is_some_and(|byte| byte.is_ascii_digit() || matches!(byte, b'+' | b'-' | b'.' | b'E' | b'e'))
        {
            self.at += 1;
        }
        let Ok(text) = std::str::from_utf8(&self.bytes[start..self.at]) else {
            return self.fault("number", "not a number");
        };
        if !text.contains(['.', 'E', 'e'])
            && let Ok(whole) = text.parse()
        {
            return Ok(Value::Integer(whole));
        }
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Value::Real(number)),
            _ => {
                self.at = start;
                self.fault("number", format!("{text:?} is not a number"))
            }
        }
    }
}

pub(crate) fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

fn upper(name: &[u8]) -> Cow<'_, str> {
    let text = String::from_utf8_lossy(name);
    if text.bytes().any(|byte| byte.is_ascii_lowercase()) {
        return Cow::Owned(text.to_ascii_uppercase());
    }
    text
}

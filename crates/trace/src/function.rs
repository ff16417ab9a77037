//! One function of a program: its line read, and printed again.
//!
//! `trace:1 <function> key=value ...`: keys are the attribute names of the EXPRESS schema, `its_` may be left out. An unknown key is an
//! error; an unknown function is kept and shown.

use crate::fault::{Fault, fault, nearest};
use crate::functions::{Arguments, Call, Definition, FUNCTIONS, Key, find};
use crate::value::{self, Item, Value};
use plan::line::is_line;
use plan::{Diagnostic, Expression};
use std::fmt;

/// What every line begins with; the number is the grammar's version.
pub const PREFIX: &str = "trace:1";

/// The key of a condition.
pub(crate) const CONDITION: &str = "its_condition";

/// A function of a program.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name as the table spells it; as written when it is in no table.
    pub name: String,
    /// Its row of the table; `None` for one that is unknown here.
    pub definition: Option<&'static Definition>,
    /// What was given, in the order written.
    pub arguments: Vec<Argument>,
    /// What is to be done.
    pub call: Call,
    /// The variable that the value goes into (`its_variable`).
    pub variable: Option<String>,
    /// The stream that it goes to (`its_log`); by default the enclosing workplan's.
    pub log: Option<String>,
    /// Everything behind the name of an unknown function, as written; empty for one that is known.
    pub unread: String,
}

/// A key and its value.
#[derive(Clone, Debug, PartialEq)]
pub struct Argument {
    /// The attribute's name as the table spells it.
    pub key: &'static str,
    /// Its value.
    pub value: Value,
    /// Where the key stands in the line, 1-based, in characters.
    pub column: u32,
}

/// Reads a line that begins with `trace:1`.
///
/// # Errors
/// What is wrong, with the column in the line. An unknown function is no error.
pub fn parse(text: &str) -> Result<Function, Box<Diagnostic>> {
    read_line(text).map_err(|found| Box::new(found.diagnostic()))
}

impl Function {
    /// The value of a key; `None` when it was not given.
    pub fn value(&self, key: &str) -> Option<&Value> {
        self.arguments.iter().find(|a| a.key == key).map(|a| &a.value)
    }

    /// The anchor or entity of the geometry at which it records, if it names one.
    pub fn points(&self) -> Option<&str> {
        match &self.call {
            Call::StartSensorRecording(recording) => match &recording.sampling {
                crate::Sampling::ByPoints { curve, .. } => Some(curve),
                _ => None,
            },
            Call::GetPoints(measurement) => measurement.points.as_deref(),
            _ => None,
        }
    }

    /// The same with a condition that its line does not have; `None` for a function that takes none.
    pub(crate) fn with_condition(mut self, condition: Expression) -> Option<Self> {
        let key = self.definition?.key(CONDITION)?.name;
        self.arguments.push(Argument {
            key,
            value: Value::Condition(condition),
            column: 0,
        });
        Some(self.called_again())
    }

    /// The same with its condition changed.
    pub(crate) fn with_changed_condition(mut self, change: impl Fn(&mut Expression)) -> Self {
        for argument in &mut self.arguments {
            if let Value::Condition(condition) = &mut argument.value {
                change(condition);
            }
        }
        self.called_again()
    }

    /// The condition that it has.
    pub(crate) fn condition(&self) -> Option<&Expression> {
        match self.value(CONDITION)? {
            Value::Condition(condition) => Some(condition),
            _ => None,
        }
    }

    /// What is to be done, anew from the arguments.
    fn called_again(mut self) -> Self {
        if let Some(definition) = self.definition {
            self.call = (definition.call)(&Arguments(&self.arguments));
        }
        self
    }

    /// The line without `trace:1`, as actions are written.
    pub fn without_prefix(&self) -> String {
        let mut line = self.name.clone();
        for argument in &self.arguments {
            line.push_str(&format!(" {}={}", argument.key, argument.value));
        }
        if !self.unread.is_empty() {
            line.push(' ');
            line.push_str(&self.unread);
        }
        line
    }
}

/// The same name and the same arguments; where they stood does not matter.
impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        let same = |(a, b): (&Argument, &Argument)| a.key == b.key && a.value == b.value;
        self.name == other.name
            && self.unread == other.unread
            && self.arguments.len() == other.arguments.len()
            && self.arguments.iter().zip(&other.arguments).all(same)
    }
}

impl fmt::Display for Function {
    /// The line that [`parse`] reads back.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{PREFIX} {}", self.without_prefix())
    }
}

fn read_line(text: &str) -> Result<Function, Box<Fault>> {
    let mut line = Line::new(text);
    line.blanks();
    let column = line.column();
    let prefix = line.word();
    if !prefix.eq_ignore_ascii_case(PREFIX) {
        let message = if prefix.to_ascii_lowercase().starts_with("trace:") {
            format!("'{prefix}' is another version of the grammar than {PREFIX}")
        } else {
            format!("expected {PREFIX}, found '{prefix}'")
        };
        return fault(
            "trace-version",
            column,
            message,
            format!("write {PREFIX} and the function's name"),
        );
    }
    read_function(line)
}

/// An action: the same without the prefix, which is not an error.
pub(crate) fn read_action(text: &str) -> Result<Function, Box<Fault>> {
    if is_line(text) {
        return read_line(text);
    }
    read_function(Line::new(text))
}

fn read_function(mut line: Line) -> Result<Function, Box<Fault>> {
    line.blanks();
    let column = line.column();
    let written = line.word();
    if written.is_empty() || written.contains('=') {
        return fault(
            "trace-function",
            column,
            "the function's name is missing",
            format!("write {PREFIX}, a name as get_time, then key=value"),
        );
    }
    let Some(definition) = find(&written) else {
        return Ok(Function {
            unread: line.rest().trim().to_owned(),
            call: Call::Unknown,
            name: written,
            definition: None,
            arguments: vec![],
            variable: None,
            log: None,
        });
    };
    let mut arguments: Vec<Argument> = Vec::new();
    loop {
        line.blanks();
        if line.is_over() {
            break;
        }
        let column = line.column();
        let (key, items) = line.argument(definition)?;
        if arguments.iter().any(|a| a.key == key.name) {
            return fault("trace-key", column, format!("{} is given twice", key.name), "give it once");
        }
        arguments.push(Argument {
            key: key.name,
            value: value::read(key.name, key.kind, &items)?,
            column,
        });
    }
    let end = line.column();
    let given = Arguments(&arguments);
    if let Some(missing) = definition.keys().find(|key| key.required && !given.has(key.name)) {
        return fault(
            "trace-key",
            end,
            format!("{} needs {}", definition.name, missing.name),
            format!("add {}={}", missing.name, missing.example()),
        );
    }
    Ok(Function {
        name: definition.name.to_owned(),
        definition: Some(definition),
        call: (definition.call)(&given),
        variable: given.text("its_variable"),
        log: given.text("its_log"),
        arguments,
        unread: String::new(),
    })
}

struct Line {
    characters: Vec<char>,
    at: usize,
}

impl Line {
    fn new(text: &str) -> Self {
        Line {
            characters: text.chars().collect(),
            at: 0,
        }
    }
    fn column(&self) -> u32 {
        self.at as u32 + 1
    }
    fn is_over(&self) -> bool {
        self.at >= self.characters.len()
    }
    fn peek(&self) -> Option<char> {
        self.characters.get(self.at).copied()
    }
    fn blanks(&mut self) {
        while self.peek().is_some_and(char::is_whitespace) {
            self.at += 1;
        }
    }
    fn word(&mut self) -> String {
        self.until(char::is_whitespace)
    }
    fn rest(&mut self) -> String {
        self.until(|_| false)
    }
    fn until(&mut self, end: impl Fn(char) -> bool) -> String {
        let start = self.at;
        while self.peek().is_some_and(|c| !end(c)) {
            self.at += 1;
        }
        self.characters[start..self.at].iter().collect()
    }

    /// `key=value`, with the values of a list apart.
    fn argument(&mut self, definition: &'static Definition) -> Result<(&'static Key, Vec<Item>), Box<Fault>> {
        let column = self.column();
        let written = self.until(|c| c.is_whitespace() || c == '=');
        let Some(key) = definition.key(&written) else {
            let keys: Vec<&str> = definition.keys().map(|key| key.name).collect();
            let meant = nearest(&written, keys.iter().copied());
            let remedy = meant.map_or_else(|| format!("its keys are {}", keys.join(", ")), |key| format!("write {key}"));
            return fault(
                "trace-key",
                column,
                format!("{} has no key '{written}'", definition.name),
                remedy,
            );
        };
        self.blanks();
        if self.peek() != Some('=') {
            return fault(
                "trace-key",
                self.column(),
                format!("expected = after {}", key.name),
                format!("write {}={}", key.name, key.example()),
            );
        }
        self.at += 1;
        let mut items = Vec::new();
        loop {
            self.blanks();
            items.push(self.item(key)?);
            let here = self.at;
            self.blanks();
            if self.peek() == Some(',') {
                self.at += 1;
            } else {
                self.at = here;
                return Ok((key, items));
            }
        }
    }

    fn item(&mut self, key: &Key) -> Result<Item, Box<Fault>> {
        let column = self.column();
        if self.peek() != Some('"') {
            let mut text = self.until(|c| c.is_whitespace() || matches!(c, ',' | '"'));
            if self.peek() == Some('"') {
                return fault(
                    "trace-value",
                    self.column(),
                    format!("a quotation mark inside the value of {}", key.name),
                    "put all of the value in quotes",
                );
            }
            // `0.5 mm`: the unit may stand apart.
            if matches!(key.kind, value::Kind::Number(_)) {
                let here = self.at;
                self.blanks();
                let next = self.until(|c| c.is_whitespace() || matches!(c, ',' | '"' | '='));
                if self.peek() != Some('=') && crate::unit::find(&next).is_some() {
                    text.push_str(&next);
                } else {
                    self.at = here;
                }
            }
            if text.is_empty() {
                return fault(
                    "trace-value",
                    column,
                    format!("{} has no value", key.name),
                    format!("write {}={}", key.name, key.example()),
                );
            }
            return Ok(Item {
                text,
                column,
                quoted: false,
            });
        }
        self.at += 1;
        let mut text = String::new();
        loop {
            match self.peek() {
                None => {
                    return fault(
                        "trace-value",
                        column,
                        "the text that begins here has no end",
                        "close it with a double quote; a quote inside is written twice",
                    );
                }
                Some('"') if self.characters.get(self.at + 1) == Some(&'"') => {
                    text.push('"');
                    self.at += 2;
                }
                Some('"') => {
                    self.at += 1;
                    return Ok(Item {
                        text,
                        column,
                        quoted: true,
                    });
                }
                Some(c) => {
                    text.push(c);
                    self.at += 1;
                }
            }
        }
    }
}

/// The names of all functions, for what a person may have meant.
pub fn meant(name: &str) -> Option<&'static str> {
    nearest(name, FUNCTIONS.iter().map(|definition| definition.name))
}

//! Variables that functions of the program write while it runs (`its_variable=#100`): the program is read ahead, so a line that uses one
//! waits until the machine has said what is in it. One that no line uses keeps nothing waiting.
//!
//! What an action writes again and again belongs to the machine until the action is stopped: a line that assigns to it would say nothing
//! about what is in it a moment later, so it is refused. Locals belong to the frame of a call and not to the machine; no action writes them.

use crate::expression::Op;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::Interpreter;
use crate::line::{Line, Source};
use crate::macro_b::{KEPT, LOCALS, Refusal, VACANT};
use plan::written::{is_action, written};
use plan::{Diagnostic, Origin, Place, Question, RawNcFunction, Severity};
use std::collections::BTreeMap;

/// A variable whose value only the machine knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Awaited {
    number: u32,
    /// The id of the action that writes it whenever it is done: every line that uses it asks. `None`: a function has written it once.
    action: Option<String>,
}

impl Interpreter {
    /// A function is told: what it writes is not known here any more.
    pub(crate) fn await_written(&mut self, line: &str, origin: Origin) {
        if let Some(id) = stopped_action(line) {
            self.action_ends(&id);
        }
        let found = |message: String, remedy: &str| {
            let found = Diagnostic::error("T-06", message).in_file(self.file.clone()).remedy(remedy);
            match origin.place {
                Place::Text { line, .. } => found.at_line(line, 1),
                _ => found,
            }
        };
        for variable in written(line) {
            // Another name is one of the record's own, which log_event tells.
            if !variable.name.starts_with('#') {
                continue;
            }
            let Some(number) = number_of(&variable.name).filter(|number| self.memory.has(*number)) else {
                self.remarks.add(found(
                    format!("a function writes {}, which is no plain variable", variable.name),
                    "let it write #100-#199 or #500-#999, and copy from there",
                ));
                continue;
            };
            if variable.again && (number as usize) < LOCALS {
                self.remarks.add(found(
                    format!("an action writes #{number}, which is another variable in every macro that is called"),
                    "let it write #100-#199 or #500-#999, and copy from there",
                ));
                continue;
            }
            let action = variable.again.then(|| value_of(line, "id").unwrap_or_default());
            if action.is_none() && self.is_written_by_an_action(number) {
                continue;
            }
            self.awaited
                .retain(|a| a.number != number || (a.action.is_some() && a.action != action));
            self.awaited.push(Awaited { number, action });
        }
    }

    /// An action is stopped: what it wrote last stays.
    fn action_ends(&mut self, id: &str) {
        for index in (0..self.awaited.len()).rev() {
            if self.awaited[index].action.as_deref() == Some(id) {
                let number = self.awaited.remove(index).number;
                if !self.awaited.iter().any(|awaited| awaited.number == number) {
                    self.awaited.push(Awaited { number, action: None });
                }
            }
        }
    }

    fn is_written_by_an_action(&self, number: u32) -> bool {
        self.awaited.iter().any(|a| a.number == number && a.action.is_some())
    }

    /// The present values of the variables that a line names, for its record. Of an action those that it writes: they hold them until it is
    /// done for the first time.
    pub(crate) fn present_values(&self, line: &str) -> BTreeMap<String, String> {
        let of_action = is_action(line).then(|| written(line));
        let is_wanted = |number: u32| {
            let Some(written) = &of_action else { return true };
            written.iter().any(|written| number_of(&written.name) == Some(number))
        };
        let numbers = line.match_indices('#').filter_map(|(at, _)| {
            let digits = &line[at..];
            let end = digits[1..]
                .find(|c: char| !c.is_ascii_digit())
                .map_or(digits.len(), |end| end + 1);
            number_of(&digits[..end])
        });
        numbers
            .filter(|number| is_wanted(*number) && self.memory.has(*number) && !self.awaited.iter().any(|a| a.number == *number))
            .filter_map(|number| Some((number, self.memory.values().get(number as usize).copied()?)))
            .filter(|(_, value)| !value.is_nan())
            .map(|(number, value)| (format!("{}#{number}", RawNcFunction::VARIABLE), value.to_string()))
            .collect()
    }

    /// The program itself writes a variable: what a function wrote before is over. What an action goes on writing is not the program's.
    #[inline]
    pub(crate) fn await_no_more(&mut self, number: u32, at: usize) -> Outcome<()> {
        if self.awaited.is_empty() {
            return Ok(());
        }
        self.take_from_machine(number, at)
    }

    fn take_from_machine(&mut self, number: u32, at: usize) -> Outcome<()> {
        if self.is_written_by_an_action(number) {
            return Err(Fault::new(
                at,
                0,
                "T-06",
                format!("an action writes #{number} whenever it is done: what is assigned here is lost then"),
                format!("copy #{number} into another variable first and use that, or stop the action before"),
            ));
        }
        self.awaited.retain(|awaited| awaited.number != number);
        Ok(())
    }

    /// What a line has to ask the machine before it is executed.
    #[inline]
    pub(crate) fn awaited_by(&self, line: &Line) -> Option<Refusal> {
        if self.awaited.is_empty() { None } else { self.asked_by(line) }
    }

    fn asked_by(&self, line: &Line) -> Option<Refusal> {
        let any = reads_a_contour(line);
        let ends = ends_the_program(line);
        // Locals change with every call; what is kept has to be known when the program is over.
        let uses = |number: u32| (number as usize) < LOCALS || any || (ends && KEPT.contains(&number)) || reads(line, number);
        self.first_unanswered(uses).map(Refusal::asks)
    }

    /// Asks for a variable that an expression has come upon.
    #[inline]
    pub(crate) fn asks_for(&self, number: u32) -> Result<(), Refusal> {
        if self.awaited.is_empty() {
            return Ok(());
        }
        match self.first_unanswered(|awaited| awaited == number) {
            Some(question) => Err(Refusal::asks(question)),
            None => Ok(()),
        }
    }

    /// The machine has no value of a variable that the blocks of a contour may use: true when the line asks only because of these, and goes
    /// on. They are looked at when they are read.
    pub(crate) fn unknown_in_contour(&mut self, name: &str, line: &Line) -> bool {
        let Some(number) = number_of(name).filter(|number| *number as usize >= LOCALS) else {
            return false;
        };
        if !reads_a_contour(line) || reads(line, number) {
            return false;
        }
        // It is awaited still: whoever uses it asks again.
        self.answers.insert(name.to_owned(), VACANT);
        self.unknown.insert(number);
        true
    }

    /// What a block of a contour uses without anybody having a value of it. It cannot wait: its cycle is being begun.
    pub(crate) fn unknown_to_contour(&self, line: &Line) -> Outcome<()> {
        let used = |a: &&Awaited| self.unknown.contains(&a.number) && reads(line, a.number);
        match self.awaited.iter().find(used) {
            Some(a) => Err(no_answer_in_contour(&format!("#{}", a.number))),
            None => Ok(()),
        }
    }

    fn first_unanswered(&self, uses: impl Fn(u32) -> bool) -> Option<Question> {
        let used = self.awaited.iter().filter(|awaited| uses(awaited.number));
        let mut names = used.map(|awaited| format!("#{}", awaited.number));
        names.find(|name| !self.answers.contains_key(name)).map(Question::Number)
    }

    /// What has to be asked when the program is over: what is kept for the next one.
    pub(crate) fn kept_to_ask(&self) -> Option<Question> {
        self.first_unanswered(|number| KEPT.contains(&number))
    }

    /// Whether the program may come to its end although the machine has no value of a variable: it is kept and used no more, and an action
    /// writes it, which may never have been done, or the program alarms by itself. `line` is the one that asks; `None` is the text's end.
    pub(crate) fn may_stay_unknown(&self, name: &str, line: Option<&Line>) -> bool {
        let Some(number) = number_of(name).filter(|number| KEPT.contains(number)) else {
            return false;
        };
        let used = line.is_some_and(|line| may_read_any(line) || reads(line, number));
        let alarms = line.is_some_and(|line| line.statement.is_some());
        !used && (alarms || self.is_written_by_an_action(number))
    }

    /// The program has ended by an alarm and the machine is not asked any more: says which kept variables it does not know.
    pub(crate) fn say_kept(&mut self, line: u32) {
        let kept = |a: &Awaited| KEPT.contains(&a.number);
        let names: Vec<String> = self
            .awaited
            .iter()
            .filter(|a| kept(a))
            .map(|a| format!("#{}", a.number))
            .collect();
        if names.is_empty() || !self.macros.fanuc_ranges {
            return;
        }
        self.awaited.retain(|a| !kept(a));
        let site = Site { text: b"", number: line };
        self.note(Severity::Warning, "variable-kept", site, 0, || {
            (
                format!(
                    "the program ended before it asked for what functions wrote: {} keep what they held",
                    names.join(", ")
                ),
                "do not let the next program rely on it".to_owned(),
            )
        });
    }

    /// The machine has answered for one of them.
    pub(crate) fn take_awaited(&mut self, name: &str, value: f64) {
        let Some(number) = number_of(name) else { return };
        self.memory.put(number, value, self.origin);
        self.unknown.remove(&number);
        self.awaited
            .retain(|awaited| awaited.number != number || awaited.action.is_some());
    }
}

/// The number of a variable that a line of the vocabulary names: `#100`.
pub(crate) fn number_of(name: &str) -> Option<u32> {
    name.strip_prefix('#')?.parse().ok()
}

/// A block of a contour that would have to wait for the machine.
pub(crate) fn no_answer_in_contour(name: &str) -> Box<Fault> {
    Fault::new(
        0,
        0,
        "no-answer",
        format!("a block of the contour uses {name}, and the machine has no value of it"),
        "copy it into a variable of the program before the cycle, and use that",
    )
}

/// The id of the action that a line stops.
fn stopped_action(line: &str) -> Option<String> {
    let name = line.split_whitespace().nth(1)?;
    name.eq_ignore_ascii_case("stop_synchronized_action")
        .then(|| value_of(line, "id"))
        .flatten()
}

/// The value of a key outside of quotes, in capitals: ids are told apart without regard to them. Its prefix `its_` may be left out.
fn value_of(line: &str, key: &str) -> Option<String> {
    let capitals = line.to_ascii_uppercase();
    let key = key.to_ascii_uppercase();
    let mut before = ' ';
    let mut quoted = false;
    for (at, c) in capitals.char_indices() {
        if !quoted && before.is_whitespace() {
            let word = &capitals[at..];
            let value = word.strip_prefix("ITS_").unwrap_or(word).strip_prefix(&key);
            if let Some(value) = value.and_then(|rest| rest.trim_start().strip_prefix('=')) {
                let value = value.trim_start();
                let end = |c: char| c == '"' || c.is_whitespace();
                let value = value.strip_prefix('"').unwrap_or(value);
                return Some(value.split(end).next().unwrap_or_default().to_owned());
            }
        }
        quoted ^= c == '"';
        before = c;
    }
    None
}

/// A variable that is found by its name or by the value of another may be any.
fn may_read_any(line: &Line) -> bool {
    line.code.ops().iter().any(|op| matches!(op, Op::Indirect | Op::Named(_))) || reads_a_contour(line)
}

fn reads(line: &Line, number: u32) -> bool {
    let reads = |op: &Op| matches!(op, Op::Memory(n) | Op::WithMemory(_, n) if u32::from(*n) == number);
    line.code.ops().iter().any(reads)
}

/// G70 to G73 of a lathe read lines that are no longer executed one by one.
fn reads_a_contour(line: &Line) -> bool {
    let cycle = |value: f64| (70.0..74.0).contains(&value);
    line.words
        .iter()
        .any(|word| matches!((word.letter, word.source), (b'G', Source::Number(value)) if cycle(value)))
}

fn ends_the_program(line: &Line) -> bool {
    let end = |value: f64| value == 2.0 || value == 30.0;
    line.words
        .iter()
        .any(|word| matches!((word.letter, word.source), (b'M', Source::Number(value)) if end(value)))
}

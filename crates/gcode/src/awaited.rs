//! Variables that functions of the program write while it runs (`its_variable=#100`): the program is read ahead, so a line that uses one
//! waits until the machine has said what is in it. One that no line uses keeps nothing waiting.

use crate::expression::Op;
use crate::interpreter::Interpreter;
use crate::line::{Line, Source};
use crate::macro_b::{KEPT, LOCALS, Refusal};
use plan::written::{is_action, written};
use plan::{Diagnostic, Origin, Place, Question, RawNcFunction};
use std::collections::BTreeMap;

/// A variable whose value only the machine knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Awaited {
    number: u32,
    /// An action writes it whenever it is done, so every line that uses it asks.
    again: bool,
}

impl Interpreter {
    /// A function is told: what it writes is not known here any more.
    pub(crate) fn await_written(&mut self, line: &str, origin: Origin) {
        for variable in written(line) {
            let Some(number) = number_of(&variable.name) else { continue };
            if !self.memory.has(number) {
                let found = Diagnostic::error("T-06", format!("a function writes #{number}, which is no plain variable"))
                    .in_file(self.file.clone())
                    .remedy("let it write #100-#199 or #500-#999, and copy from there");
                self.remarks.add(match origin.place {
                    Place::Text { line, .. } => found.at_line(line, 1),
                    _ => found,
                });
                continue;
            }
            self.await_no_more(number);
            self.awaited.push(Awaited {
                number,
                again: variable.again,
            });
        }
    }

    /// The present values of the variables that a line names, for its record. A condition is no record.
    pub(crate) fn present_values(&self, line: &str) -> BTreeMap<String, String> {
        if is_action(line) {
            return BTreeMap::new();
        }
        let numbers = line.match_indices('#').filter_map(|(at, _)| {
            let digits = &line[at..];
            let end = digits[1..]
                .find(|c: char| !c.is_ascii_digit())
                .map_or(digits.len(), |end| end + 1);
            number_of(&digits[..end])
        });
        numbers
            .filter(|number| self.memory.has(*number) && !self.awaited.iter().any(|a| a.number == *number))
            .filter_map(|number| Some((number, self.memory.values().get(number as usize).copied()?)))
            .filter(|(_, value)| !value.is_nan())
            .map(|(number, value)| (format!("{}#{number}", RawNcFunction::VARIABLE), value.to_string()))
            .collect()
    }

    /// The program itself writes a variable: what a function wrote before is over.
    #[inline]
    pub(crate) fn await_no_more(&mut self, number: u32) {
        if !self.awaited.is_empty() {
            self.awaited.retain(|awaited| awaited.number != number);
        }
    }

    /// What a line has to ask the machine before it is executed.
    #[inline]
    pub(crate) fn awaited_by(&self, line: &Line) -> Option<Refusal> {
        if self.awaited.is_empty() { None } else { self.asked_by(line) }
    }

    fn asked_by(&self, line: &Line) -> Option<Refusal> {
        let ops = line.code.ops();
        // A variable that is found by its name or by the value of another may be any.
        let any = ops.iter().any(|op| matches!(op, Op::Indirect | Op::Named(_))) || reads_a_contour(line);
        let ends = ends_the_program(line);
        let uses = |awaited: &&Awaited| {
            let reads = |op: &Op| matches!(op, Op::Memory(n) | Op::WithMemory(_, n) if u32::from(*n) == awaited.number);
            // Locals change with every call; what is kept has to be known when the program is over.
            (awaited.number as usize) < LOCALS || any || (ends && KEPT.contains(&awaited.number)) || ops.iter().any(reads)
        };
        let name = self.awaited.iter().filter(uses).map(|awaited| format!("#{}", awaited.number));
        let unanswered = name.into_iter().find(|name| !self.answers.contains_key(name))?;
        Some(Refusal::asks(Question::Number(unanswered)))
    }

    /// The machine has answered for one of them.
    pub(crate) fn take_awaited(&mut self, name: &str, value: f64) {
        let Some(number) = number_of(name) else { return };
        self.memory.put(number, value, self.origin);
        self.awaited.retain(|awaited| awaited.number != number || awaited.again);
    }
}

/// The number of a variable that a line of the vocabulary names: `#100`.
pub(crate) fn number_of(name: &str) -> Option<u32> {
    name.strip_prefix('#')?.parse().ok()
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

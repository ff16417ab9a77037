//! Executing one line: its macro statement, or its words with what they call.

use crate::block::Block;
use crate::calls::{Calling, ProgramCall};
use crate::evaluate::{Stack, evaluate, no_such_name, variable_number};
use crate::expression::{Expression, Target};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Flow, Interpreter};
use crate::line::{Kind, Line, Source};
use crate::listing::{name_at, named_program};
use crate::macro_b::plain;
use crate::printing;
use crate::statement::{Piece, Statement};
use plan::{RawNcFunction, Severity, StepKind};
use std::collections::BTreeMap;

/// What happens behind a line.
pub(crate) enum Act {
    /// As the block's codes say.
    Flow(Flow),
    Call(Box<ProgramCall>),
    Goto {
        number: u32,
        at: usize,
    },
    /// DO, and whether its body is gone through now.
    Do {
        enters: bool,
        label: u8,
        at: usize,
    },
    EndDo {
        label: u8,
        at: usize,
    },
}

/// Executes a line that holds words or a macro statement.
#[inline]
pub(crate) fn act(
    interpreter: &mut Interpreter,
    block: &mut Block,
    line: &Line,
    site: Site<'_>,
    stack: &mut Stack,
) -> Outcome<Act> {
    if let Some(refusal) = interpreter.awaited_by(line) {
        return Err(refusal.at(0));
    }
    if line.skippable {
        interpreter.decided.get_or_insert((site.number, "a block-skip switch (/)"));
    }
    if let Some(statement) = &line.statement {
        if let Some(n) = line.sequence {
            interpreter.last_n = n;
        }
        return interpreter.macro_statement(statement, line, site, stack);
    }
    debug_assert_eq!(line.kind, Kind::Words);
    act_words(interpreter, block, line, site, stack)
}

fn act_words(interpreter: &mut Interpreter, block: &mut Block, line: &Line, site: Site<'_>, stack: &mut Stack) -> Outcome<Act> {
    block.fill(line, &interpreter.macros, &*interpreter, stack)?;
    if interpreter.macros.named_programs {
        interpreter.learn_names(line, site);
    }
    if interpreter.settings.interruptions
        && let Some(call) = interpreter.interrupted(site)?
    {
        return Ok(Act::Call(call));
    }
    interpreter.show_message(block, site);
    interpreter.moved = false;
    let mut behind = None;
    if interpreter.may_call() {
        if let Some(n) = line.sequence {
            interpreter.last_n = n;
        }
        match interpreter.calling(block, line, stack)? {
            Calling::Plain => {}
            Calling::Call(None) => return Ok(Act::Flow(Flow::NextBlock)),
            Calling::Call(Some(call)) => return Ok(Act::Call(call)),
            Calling::Behind(call) => {
                if block.is_empty() {
                    return Ok(Act::Call(call));
                }
                behind = Some(call);
            }
        }
    }
    let flow = interpreter.execute(block, site)?;
    match (flow, behind) {
        (Flow::NextBlock, Some(call)) => Ok(Act::Call(call)),
        (Flow::NextBlock, None) if interpreter.moved && !interpreter.modal.is_empty() => match interpreter.modal_call() {
            Some(call) => Ok(Act::Call(call)),
            None => Ok(Act::Flow(Flow::NextBlock)),
        },
        (flow, _) => Ok(Act::Flow(flow)),
    }
}

impl Interpreter {
    /// What loops are made of is looked at first.
    #[inline]
    fn macro_statement(&mut self, statement: &Statement, line: &Line, site: Site<'_>, stack: &mut Stack) -> Outcome<Act> {
        match statement {
            Statement::Assign {
                target: Target::Memory(number),
                value,
                at,
                ..
            } => {
                let value = self.evaluated(line, *value, stack)?;
                self.await_no_more(u32::from(*number), *at)?;
                self.memory.put(u32::from(*number), value, self.origin);
                Ok(Act::Flow(Flow::NextBlock))
            }
            Statement::Do { condition, label, at } => {
                let enters = match condition {
                    Some(condition) => {
                        self.decided.get_or_insert((site.number, "WHILE"));
                        self.evaluated(line, *condition, stack)? != 0.0
                    }
                    None => true,
                };
                Ok(Act::Do {
                    enters,
                    label: *label,
                    at: *at,
                })
            }
            Statement::End { label, at } => Ok(Act::EndDo { label: *label, at: *at }),
            other => self.other_statement(other, line, site, stack),
        }
    }

    fn other_statement(&mut self, statement: &Statement, line: &Line, site: Site<'_>, stack: &mut Stack) -> Outcome<Act> {
        let next = Ok(Act::Flow(Flow::NextBlock));
        match statement {
            Statement::Do { .. } | Statement::End { .. } => self.macro_statement(statement, line, site, stack),
            Statement::Assign { target, value, at, end } => {
                let value = self.evaluated(line, *value, stack)?;
                let number = self.target_number(target, line, *at, stack)?;
                self.assign(number, value, *at, *end, site)?;
                next
            }
            Statement::If { condition, then } => {
                self.decided.get_or_insert((site.number, "IF"));
                if self.evaluated(line, *condition, stack)? == 0.0 {
                    return next;
                }
                self.macro_statement(then, line, site, stack)
            }
            Statement::Goto { number, at } => {
                let number = plain(self.evaluated(line, *number, stack)?);
                let whole = libm::round(number);
                if !(1.0..=99_999.0).contains(&whole) {
                    return Err(Fault::new(
                        *at,
                        128,
                        "goto-number",
                        format!("GOTO {number}: sequence numbers are 1 to 99999"),
                        "check the value before it is used",
                    ));
                }
                Ok(Act::Goto {
                    number: whole as u32,
                    at: *at,
                })
            }
            Statement::SetNames { first, names, at } => {
                let first = variable_number(plain(self.evaluated(line, *first, stack)?), *at)?;
                self.set_names(first, names, *at, site)?;
                next
            }
            Statement::OpenPrinter => {
                self.printer_open = true;
                next
            }
            Statement::ClosePrinter => {
                self.printer_open = false;
                next
            }
            Statement::Print { binary, pieces, at } => {
                self.print(*binary, pieces, line, *at, site, stack)?;
                next
            }
        }
    }

    fn evaluated(&self, line: &Line, expression: Expression, stack: &mut Stack) -> Outcome<f64> {
        evaluate(&line.code, expression, &self.macros, self, stack)
    }

    fn target_number(&self, target: &Target, line: &Line, at: usize, stack: &mut Stack) -> Outcome<u32> {
        use crate::evaluate::Variables;
        match target {
            Target::Memory(number) => Ok(u32::from(*number)),
            Target::Variable(number) => Ok(*number),
            Target::Indirect(expression) => variable_number(plain(self.evaluated(line, *expression, stack)?), at),
            Target::Named(name) => {
                let name = &line.code.names[usize::from(*name)];
                self.named(name).ok_or_else(|| no_such_name(name, at))
            }
        }
    }

    /// SETVN.
    fn set_names(&mut self, first: u32, names: &[String], at: usize, site: Site<'_>) -> Outcome<()> {
        for (number, name) in (first..).zip(names) {
            if !(500..=999).contains(&number) {
                return Err(Fault::new(
                    at,
                    115,
                    "macro-variable",
                    format!("SETVN {number}: only #500 to #999 have names"),
                    "name a variable of that range",
                ));
            }
            let longest = self.macros.longest_name;
            let short: String = name.chars().take(longest).collect();
            if short != *name {
                self.note(Severity::Warning, "name-cut", site, at, || {
                    (
                        format!("the name {name} has more than {longest} characters: {short} is kept"),
                        "choose a shorter one".to_owned(),
                    )
                });
            }
            self.memory.changes += 1;
            let properties = BTreeMap::from([
                ("variable".to_owned(), number.to_string()),
                ("name".to_owned(), short.clone()),
            ]);
            self.names.insert(number, short);
            self.emit(StepKind::NcFunction(RawNcFunction {
                kind: RawNcFunction::VARIABLE_NAME.to_owned(),
                name: "SETVN".to_owned(),
                text: String::new(),
                condition: None,
                properties,
            }));
        }
        Ok(())
    }

    /// DPRNT, BPRNT.
    fn print(
        &mut self,
        binary: bool,
        pieces: &[Piece],
        line: &Line,
        at: usize,
        site: Site<'_>,
        stack: &mut Stack,
    ) -> Outcome<()> {
        let mut text = String::new();
        for piece in pieces {
            match piece {
                Piece::Text(words) => text.push_str(words),
                Piece::Number { value, whole, decimals } => {
                    let value = plain(self.evaluated(line, *value, stack)?);
                    text.push_str(&match binary {
                        true => printing::binary(value, *decimals).ok_or_else(|| {
                            Fault::new(
                                at,
                                110,
                                "print-overflow",
                                format!("{value} with {decimals} decimals is more than 32 bits hold"),
                                "print fewer decimals, or check the value first",
                            )
                        })?,
                        false => printing::printed(
                            value,
                            *whole,
                            *decimals,
                            self.settings.prints_no_zeros,
                            self.macros.printed_field_grows,
                        ),
                    });
                }
            }
        }
        if !self.printer_open {
            self.note(Severity::Warning, "printer-closed", site, at, || {
                (
                    "a line is printed without POPEN: Fanuc controls want the port opened first".to_owned(),
                    "write POPEN before and PCLOS behind".to_owned(),
                )
            });
        }
        if self.options.trace {
            self.trace.output.push(text.clone());
        }
        let end = if self.settings.prints_returns { "\r\n" } else { "\n" };
        self.emit(StepKind::NcFunction(RawNcFunction {
            kind: RawNcFunction::PRINT.to_owned(),
            name: if binary { "BPRNT" } else { "DPRNT" }.to_owned(),
            text: text + end,
            condition: None,
            properties: BTreeMap::new(),
        }));
        Ok(())
    }

    /// Keeps the names of programs that a line calls: a program of that name may be a file of its own.
    fn learn_names(&mut self, line: &Line, site: Site<'_>) {
        for word in &line.words {
            if let Source::Number(value) = word.source
                && let Some(number) = named_program(value)
                && let Some((name, _)) = name_at(site.text, word.at as usize)
            {
                let name = || String::from_utf8_lossy(name).into_owned();
                self.program_names.entry(number).or_insert_with(name);
            }
        }
    }

    /// True when a block's words may be a call.
    fn may_call(&self) -> bool {
        self.macros.fanuc_ranges
    }
}

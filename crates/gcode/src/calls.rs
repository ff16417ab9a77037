//! Calls of programs: by G65, G66 and G66.1, by M98, and by G, M, T, S and B codes that parameters tie to a program.

use crate::block::{Block, Word};
use crate::evaluate::{Stack, evaluate};
use crate::fault::{Fault, Outcome};
use crate::interpreter::Interpreter;
use crate::line::{Line, Source};
use crate::macro_b::{LOCALS, Locals, VACANT};
use crate::profile::FeedMode;
use crate::program::WholeNumbers;

/// A program that a block calls.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ProgramCall {
    pub program: u32,
    pub times: u32,
    /// The byte of the calling word.
    pub at: usize,
    /// Arguments of a macro, which gets a level of its own; `None` for a subprogram.
    pub locals: Option<Box<Locals>>,
    /// Called by a G, M, T, S or B code: such codes are plain inside.
    pub by_code: bool,
    /// Called by the n-th modal call, counted from 0: its locals stay from call to call.
    pub modal: Option<usize>,
    /// The caller goes on with the block that calls: an interruption comes before it.
    pub interrupts: bool,
}

impl ProgramCall {
    /// A plain call of a subprogram, once.
    pub(crate) fn subprogram(program: u32, at: usize) -> Self {
        ProgramCall {
            program,
            times: 1,
            at,
            locals: None,
            by_code: false,
            modal: None,
            interrupts: false,
        }
    }
}

/// A modal call in force.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ModalCall {
    pub program: u32,
    pub times: u32,
    /// Set in its G66 block, and as the last run left them.
    pub locals: Box<Locals>,
    /// G66.1: every block calls, and its words are the arguments.
    pub every_block: bool,
    pub by_code: bool,
}

/// Modal calls inside modal calls; one more is alarm 122.
const DEEPEST_MODAL: usize = 4;

/// What a block's words mean before they are executed.
pub(crate) enum Calling {
    /// Nothing is called.
    Plain,
    /// The block was a call and nothing else; `None`: it only changed the modal calls.
    Call(Option<Box<ProgramCall>>),
    /// What is left in the block is executed, then this is called.
    Behind(Box<ProgramCall>),
}

/// A word with its value, in the order of the block.
pub(crate) struct Argument {
    letter: u8,
    word: Word,
}

impl Interpreter {
    /// Finds what a block calls.
    pub(crate) fn calling(&mut self, block: &mut Block, line: &Line, stack: &mut Stack) -> Outcome<Calling> {
        let mut index = 0;
        while let Some(code) = block.g(index) {
            index += 1;
            match code.code {
                650 | 660 | 661 if self.macros.fanuc_ranges => return self.g65(code.code, code.at, line, stack),
                670 if self.macros.fanuc_ranges => {
                    self.modal.pop();
                    block.drop_g(670);
                    if block.is_empty() {
                        return Ok(Calling::Call(None));
                    }
                    index = 0;
                }
                _ if self.in_code_call || self.settings.g_calls.is_empty() => {}
                code_times_ten => {
                    let call = self
                        .settings
                        .g_calls
                        .iter()
                        .find(|c| u32::from(c.code) * 10 == u32::from(code_times_ten))
                        .copied();
                    if let Some(call) = call {
                        let given = self.given_words(line, stack)?;
                        let (locals, _, times) = self.arguments(&given, Some((b'G', code.at)), code.at, false)?;
                        if call.modal {
                            return self.begin_modal(call.program, times, locals, false, true, code.at);
                        }
                        return Ok(Calling::Call(Some(Box::new(ProgramCall {
                            times,
                            locals: Some(locals),
                            by_code: true,
                            ..ProgramCall::subprogram(call.program, code.at)
                        }))));
                    }
                }
            }
        }
        if let Some(every) = self.modal.last()
            && every.every_block
            && self.modal_running == 0
            && !self.ends_or_returns(block)
        {
            let (program, times) = (every.program, every.times);
            let given = self.given_words(line, stack)?;
            let locals = self.every_word(&given)?;
            return Ok(Calling::Call(Some(Box::new(ProgramCall {
                times,
                locals: Some(locals),
                modal: Some(self.modal.len() - 1),
                ..ProgramCall::subprogram(program, 0)
            }))));
        }
        if self.settings.interruptions && self.arms(block, line, stack)? {
            return Ok(Calling::Call(None));
        }
        if self.in_code_call {
            return Ok(Calling::Plain);
        }
        self.other_codes(block, line, stack)
    }

    /// M, T, S and B codes.
    fn other_codes(&mut self, block: &mut Block, line: &Line, stack: &mut Stack) -> Outcome<Calling> {
        let subprogram = |program, at| ProgramCall {
            by_code: true,
            ..ProgramCall::subprogram(program, at)
        };
        if !self.settings.m_calls.is_empty() || !self.settings.m_subprograms.is_empty() {
            let (codes, count) = block.m_codes();
            let head = line.words.iter().find(|w| w.letter != b'N').map(|w| w.at as usize);
            for code in &codes[..count] {
                if let Some(call) = self.settings.m_calls.iter().find(|c| c.code == code.code).copied()
                    && head == Some(code.at)
                {
                    let given = self.given_words(line, stack)?;
                    let (locals, _, times) = self.arguments(&given, Some((b'M', code.at)), code.at, false)?;
                    return Ok(Calling::Call(Some(Box::new(ProgramCall {
                        times,
                        locals: Some(locals),
                        ..subprogram(call.program, code.at)
                    }))));
                }
                if let Some(call) = self.settings.m_subprograms.iter().find(|c| c.code == code.code).copied() {
                    let times = match block.take(b'L') {
                        Some(l) => Self::whole(l, 'L', 9999)?,
                        None => 1,
                    };
                    block.drop_m(code.code);
                    block.drop_word(b'L');
                    return Ok(Calling::Behind(Box::new(ProgramCall {
                        times,
                        ..subprogram(call.program, code.at)
                    })));
                }
            }
        }
        let called = [
            (self.settings.t_calls, b'T', 149, 9000),
            (self.settings.s_calls, b'S', 147, 9029),
            (self.settings.b_calls, b'B', 146, 9028),
        ];
        for (on, letter, variable, program) in called {
            if on && let Some(word) = block.look(letter) {
                block.drop_word(letter);
                self.memory.put(variable, word.value, self.origin);
                return Ok(Calling::Behind(Box::new(subprogram(program, word.at))));
            }
        }
        Ok(Calling::Plain)
    }

    /// G65, G66, G66.1.
    fn g65(&mut self, code: u16, at: usize, line: &Line, stack: &mut Stack) -> Outcome<Calling> {
        let given = self.given_words(line, stack)?;
        let (locals, program, times) = self.arguments(&given, Some((b'G', at)), at, true)?;
        let Some(program) = program else {
            let name = crate::interpreter::g_name(code);
            return Err(Fault::new(
                at,
                76,
                "word-missing",
                format!("{name} without P"),
                format!("write the number of the macro: {name} P9100"),
            ));
        };
        match code {
            650 => Ok(Calling::Call(Some(Box::new(ProgramCall {
                times,
                locals: Some(locals),
                ..ProgramCall::subprogram(program, at)
            })))),
            _ => self.begin_modal(program, times, locals, code == 661, false, at),
        }
    }

    fn begin_modal(
        &mut self,
        program: u32,
        times: u32,
        locals: Box<Locals>,
        every_block: bool,
        by_code: bool,
        at: usize,
    ) -> Outcome<Calling> {
        if self.modal.len() >= DEEPEST_MODAL {
            return Err(Fault::new(
                at,
                122,
                "modal-call-depth",
                format!("modal calls are nested more than {DEEPEST_MODAL} deep"),
                "end one with G67 first",
            ));
        }
        self.modal.push(ModalCall {
            program,
            times,
            locals,
            every_block,
            by_code,
        });
        Ok(Calling::Call(None))
    }

    /// What a modal call does behind a block that moved.
    pub(crate) fn modal_call(&self) -> Option<Box<ProgramCall>> {
        let index = self.modal.len().checked_sub(1 + self.modal_running)?;
        let call = &self.modal[index];
        (!call.every_block).then(|| {
            Box::new(ProgramCall {
                times: call.times,
                locals: Some(call.locals.clone()),
                by_code: call.by_code,
                modal: Some(index),
                ..ProgramCall::subprogram(call.program, 0)
            })
        })
    }

    /// The words of a line that are not vacant, in their order.
    pub(crate) fn given_words(&self, line: &Line, stack: &mut Stack) -> Outcome<Vec<Argument>> {
        let mut given = Vec::with_capacity(line.words.len());
        for said in &line.words {
            let (value, computed) = match said.source {
                Source::Number(value) => (value, false),
                Source::Expression(e) => (evaluate(&line.code, e, &self.macros, self, stack)?, true),
            };
            if !value.is_nan() {
                given.push(Argument {
                    letter: said.letter,
                    word: Word {
                        value,
                        has_point: said.has_point,
                        computed,
                        at: said.at as usize,
                    },
                });
            }
        }
        Ok(given)
    }

    /// Locals from the words of a call, with the program and the repetitions. `calling` is the calling word, which is no argument.
    pub(crate) fn arguments(
        &self,
        given: &[Argument],
        calling: Option<(u8, usize)>,
        at: usize,
        takes_program: bool,
    ) -> Outcome<(Box<Locals>, Option<u32>, u32)> {
        let mut locals = Box::new([VACANT; LOCALS]);
        let (mut program, mut times) = (None, 1);
        let (mut set, mut last) = (0_usize, 0_usize);
        for argument in given {
            let Argument { letter, word } = *argument;
            if calling == Some((letter, word.at)) {
                continue;
            }
            match letter {
                b'N' if word.at < at => continue, // the sequence number of the block
                b'P' if takes_program => {
                    program = Some(Self::program_of(word)?);
                    continue;
                }
                b'L' => {
                    times = Self::whole(word, 'L', 99_999_999)?;
                    continue;
                }
                _ => {}
            }
            let Some(first_kind) = local_of(letter) else {
                return Err(Fault::new(
                    word.at,
                    129,
                    "argument-letter",
                    format!("{} cannot be an argument of a macro", char::from(letter.to_ascii_uppercase())),
                    "use A B C D E F H I J K M Q R S T U V W X Y Z",
                ));
            };
            let mut variable = first_kind;
            if let b'I' | b'J' | b'K' = letter
                && !self.settings.first_arguments
            {
                // A repeated or out-of-order I, J or K begins the next set of the second kind; the first set is the same in both.
                let place = usize::from(letter - b'I') + 1;
                if place <= last {
                    set += 1;
                }
                last = place;
                variable = 3 + 3 * set + place;
                if variable >= LOCALS {
                    return Err(Fault::new(
                        word.at,
                        129,
                        "argument-letter",
                        "more than ten sets of I J K",
                        "hand the rest over in common variables",
                    ));
                }
            }
            locals[variable] = self.argument_value(letter, word);
        }
        Ok((locals, program, times))
    }

    /// The words of a block with G66.1 in force.
    fn every_word(&self, given: &[Argument]) -> Outcome<Box<Locals>> {
        let mut locals = Box::new([VACANT; LOCALS]);
        let mut codes = 28;
        for Argument { letter, word } in given {
            let variable = match letter {
                b'G' if codes > 32 => continue,
                b'G' => {
                    codes += 1;
                    codes - 1
                }
                b'L' => 10,
                b'N' => 14,
                b'P' => 16,
                letter => match local_of(*letter) {
                    Some(variable) => variable,
                    None => continue,
                },
            };
            locals[variable] = self.argument_value(*letter, *word);
        }
        Ok(locals)
    }

    /// What a macro sees of an argument: without a point it may count least increments.
    fn argument_value(&self, letter: u8, word: Word) -> f64 {
        let whole = !word.has_point && !word.computed && self.options.whole_numbers == WholeNumbers::Increments;
        if !whole || !self.profile.point_matters {
            return word.value;
        }
        let increment = self.profile.increment[usize::from(self.inches)];
        match letter {
            b'F' if self.feed_mode == FeedMode::PerRevolution => word.value * if self.inches { 0.0001 } else { 0.01 },
            b'F' if self.inches => word.value * 0.01,
            b'D' | b'E' | b'F' | b'H' | b'M' | b'S' | b'T' | b'G' | b'L' | b'N' | b'P' => word.value,
            _ => word.value * increment,
        }
    }

    fn ends_or_returns(&self, block: &Block) -> bool {
        let (codes, count) = block.m_codes();
        codes[..count].iter().any(|m| matches!(m.code, 0 | 1 | 2 | 30 | 98 | 99))
    }
}

/// The local variable of an argument of the first kind.
fn local_of(letter: u8) -> Option<usize> {
    Some(match letter {
        b'A' => 1,
        b'B' => 2,
        b'C' => 3,
        b'I' => 4,
        b'J' => 5,
        b'K' => 6,
        b'D' => 7,
        b'E' => 8,
        b'F' => 9,
        b'H' => 11,
        b'M' => 13,
        b'Q' => 17,
        b'R' => 18,
        b'S' => 19,
        b'T' => 20,
        b'U' => 21,
        b'V' => 22,
        b'W' => 23,
        b'X' => 24,
        b'Y' => 25,
        b'Z' => 26,
        _ => return None,
    })
}

//! What a sender gives to be loaded, and what became of it: sent in order, a few at a time, and again after a cut as far as no answer has
//! come.

use super::error::LinkError;
use super::words;
use machine::link::loading::{LOADS_UNDER_WAY, Loads as Answers};
use machine::link::message::{LoadHead, LoadWhat};
use machine::link::{Loaded, Wire, Writer};
use machine::watch::condition::LONGEST;
use machine::watch::{ALARMS_OF_A_WATCH, AlarmOrder, BadCondition, Frequency, LoadError, Operation};
use std::collections::VecDeque;
use trace::compile::Compiled;
use units::{Millimetres, ToolNumber};

/// Something that the machine is to know before it is told of it.
#[derive(Clone, Debug, PartialEq)]
pub enum Load {
    /// A condition.
    Watch {
        /// When it fires.
        frequency: Frequency,
        /// It goes on in every mode.
        all_modes: bool,
        /// The condition.
        operations: Vec<Operation>,
        /// What it does to alarms.
        alarms: Vec<AlarmOrder>,
        /// The line of the program that starts it, for whoever asks what lives in the machine.
        line: String,
    },
    /// The diameter of a tool, for cutting speeds.
    Tool {
        /// Which tool.
        tool: ToolNumber,
        /// Its diameter.
        diameter: Millimetres,
    },
}

impl Load {
    /// A condition, and the line that starts it.
    pub fn condition(line: &str, compiled: &Compiled) -> Self {
        Load::Watch {
            frequency: compiled.frequency,
            all_modes: compiled.all_modes,
            operations: compiled.operations.clone(),
            alarms: compiled.alarms.clone(),
            line: words::bounded(line),
        }
    }

    /// Writes it as a frame carries it.
    pub(super) fn write(&self, number: u32, to: &mut Writer<'_>) {
        match self {
            Load::Tool { tool, diameter } => {
                let (tool, diameter) = (*tool, *diameter);
                let what = LoadWhat::Tool { tool, diameter };
                LoadHead { number, what }.write(to);
            }
            Load::Watch {
                frequency,
                all_modes,
                operations,
                alarms,
                line,
            } => {
                // What is longer was refused when it was given.
                let what = LoadWhat::Watch {
                    frequency: *frequency,
                    all_modes: *all_modes,
                    operations: operations.len() as u8,
                    alarms: alarms.len() as u8,
                };
                LoadHead { number, what }.write(to);
                operations.iter().for_each(|operation| operation.write(to));
                alarms.iter().for_each(|order| order.write(to));
                words::write(line, to);
            }
        }
    }
}

/// The answer to a condition, as [`machine::Watches::load`] gives it; `None`: it is that to a tool.
pub fn number_of(answer: Loaded) -> Option<Result<u16, LoadError>> {
    match answer {
        Loaded::Watch(number) => Some(Ok(number)),
        Loaded::Refused(why) => Some(Err(why)),
        Loaded::Tool | Loaded::NoPlaceForTool => None,
    }
}

/// Loads of one plan.
#[derive(Clone, Debug, Default)]
pub(super) struct Loads {
    loads: Vec<Load>,
    /// Sent, and decided, in the present session.
    told: u32,
    decided: u32,
    /// The answers, by number.
    answers: Vec<Loaded>,
    /// What was given and has had no answer yet.
    given: VecDeque<Given>,
}

#[derive(Clone, Copy, Debug)]
enum Given {
    /// The load with this number.
    Load(u32),
    /// It is longer than anything that goes to a machine.
    Refused(LoadError),
}

impl Loads {
    pub fn push(&mut self, load: Load) {
        let given = match &load {
            Load::Watch { operations, .. } if operations.len() > LONGEST => {
                Given::Refused(LoadError::Condition(BadCondition::TooLong))
            }
            Load::Watch { alarms, .. } if alarms.len() > ALARMS_OF_A_WATCH => Given::Refused(LoadError::Alarms),
            _ => {
                self.loads.push(load);
                Given::Load(self.loads.len() as u32 - 1)
            }
        };
        self.given.push_back(given);
    }

    /// The next answer, in the order in which they were given.
    pub fn answer(&mut self) -> Option<Loaded> {
        let answer = match *self.given.front()? {
            Given::Refused(why) => Loaded::Refused(why),
            Given::Load(number) => *self.answers.get(number as usize)?,
        };
        self.given.pop_front();
        Some(answer)
    }

    /// A connection is there; `continues`: the machine has what was sent before.
    pub fn connected(&mut self, continues: bool) {
        if !continues {
            self.decided = 0;
        }
        self.told = self.decided;
    }

    /// The next to be sent, with its number.
    pub fn next(&mut self) -> Option<(u32, &Load)> {
        if self.told - self.decided >= LOADS_UNDER_WAY {
            return None;
        }
        let load = self.loads.get(self.told as usize)?;
        self.told += 1;
        Some((self.told - 1, load))
    }

    /// The machine has decided some of them.
    pub fn hear(&mut self, answers: &Answers) -> Result<(), LinkError> {
        while self.decided < answers.decided {
            let number = self.decided;
            let Some(answer) = answers.answer(number).filter(|_| (number as usize) < self.loads.len()) else {
                return Err(LinkError::Rules("an answer to a condition that was not given"));
            };
            match self.answers.get(number as usize) {
                None => self.answers.push(answer),
                Some(before) if *before == answer => {}
                Some(_) => return Err(LinkError::Conditions { number }),
            }
            self.decided += 1;
        }
        // What was sent before a cut, too.
        self.told = self.told.max(self.decided);
        Ok(())
    }

    pub fn all_decided(&self) -> bool {
        self.decided as usize == self.loads.len()
    }
}

//! Conditions on their way into the machine: they come in parts, because one whole condition is larger than all else that goes to the
//! realtime thread, and each is answered with its number or with why it is refused.
//!
//! A plan numbers what it loads from 0. A sender that is back after a cut sends again what it has no answer for; what the machine has
//! decided already is passed over, so nothing is loaded twice. A sender that was started again with the same plan gets the same answers.

use super::wire::{wire_enum, wire_struct};
use crate::drive::CyclicDrive;
use crate::pad::ControlPad;
use crate::realtime::RealtimeHalf;
use crate::watch::condition::LONGEST;
use crate::watch::signal::TOOLS;
use crate::watch::{ALARMS_OF_A_WATCH, AlarmOrder, BadCondition, CONDITIONS, Frequency, LoadError, Operation, Watch};
use units::{Millimetres, ToolNumber};

/// Loads without an answer at most.
pub const LOADS_UNDER_WAY: u32 = 16;
/// Loads of one plan at most: more find no place, whatever they are.
pub const MOST_LOADS: usize = CONDITIONS + TOOLS;

/// What became of a load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loaded {
    /// The tool's diameter is known.
    #[default]
    Tool,
    /// There is no place for more tools: its cutting speed is unavailable.
    NoPlaceForTool,
    /// The condition has this number.
    Watch(u16),
    /// The condition is not loaded, and why.
    Refused(LoadError),
}
wire_enum!(Loaded {
    0 = Tool,
    1 = NoPlaceForTool,
    2 = Watch(number),
    3 = Refused(why),
});

/// The answers of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Loads {
    /// Loads below this number are decided.
    pub decided: u32,
    /// The last answers, that of load n at n modulo their count.
    pub last: [Loaded; LOADS_UNDER_WAY as usize],
}
wire_struct!(Loads { decided, last });

impl Loads {
    /// The answer to a load; `None`: it is not decided, or so long ago that it must have been heard.
    pub fn answer(&self, number: u32) -> Option<Loaded> {
        let kept = number < self.decided && self.decided - number <= LOADS_UNDER_WAY;
        kept.then(|| self.last[(number % LOADS_UNDER_WAY) as usize])
    }
}

/// What goes to the realtime thread, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadPart {
    /// A condition begins.
    Watch {
        /// When it fires.
        frequency: Frequency,
        /// It goes on in every mode.
        all_modes: bool,
        /// By which mark it is asked for, from 1 on.
        mark: u32,
    },
    /// One of its operations.
    Operation(Operation),
    /// One of its orders for alarms.
    Alarm(AlarmOrder),
    /// It is whole.
    Whole {
        /// The number of the load.
        number: u32,
    },
    /// The diameter of a tool.
    Tool {
        /// The number of the load.
        number: u32,
        /// Which tool.
        tool: ToolNumber,
        /// Its diameter.
        diameter: Millimetres,
    },
}

/// The realtime end: puts conditions together, without an allocator.
#[derive(Clone, Debug)]
pub(super) struct Loading {
    frequency: Frequency,
    all_modes: bool,
    mark: u32,
    operations: [Operation; LONGEST],
    length: usize,
    alarms: [AlarmOrder; ALARMS_OF_A_WATCH],
    orders: usize,
    /// More came than there is place for.
    too_long: bool,
    /// The answers of this plan, for a sender that is started again.
    answers: [Loaded; MOST_LOADS],
    decided: usize,
}

impl Loading {
    pub const fn new() -> Self {
        Loading {
            frequency: Frequency::NoKeyword,
            all_modes: false,
            mark: 0,
            operations: [Operation::Not; LONGEST],
            length: 0,
            alarms: [AlarmOrder::Clear { alarm: 0 }; ALARMS_OF_A_WATCH],
            orders: 0,
            too_long: false,
            answers: [Loaded::Tool; MOST_LOADS],
            decided: 0,
        }
    }

    /// Another plan: nothing of it is decided.
    pub fn new_plan(&mut self) {
        self.decided = 0;
    }

    /// Takes a part; `loads` are the answers that the sender hears.
    pub fn take<D: CyclicDrive, P: ControlPad>(&mut self, part: LoadPart, loads: &mut Loads, half: &mut RealtimeHalf<D, P>) {
        match part {
            LoadPart::Watch {
                frequency,
                all_modes,
                mark,
            } => {
                (self.frequency, self.all_modes, self.mark) = (frequency, all_modes, mark);
                (self.length, self.orders, self.too_long) = (0, 0, false);
            }
            LoadPart::Operation(operation) => match self.operations.get_mut(self.length) {
                Some(place) => {
                    *place = operation;
                    self.length += 1;
                }
                None => self.too_long = true,
            },
            LoadPart::Alarm(order) => match self.alarms.get_mut(self.orders) {
                Some(place) => {
                    *place = order;
                    self.orders += 1;
                }
                None => self.too_long = true,
            },
            LoadPart::Whole { number } => {
                let answer = self.known(number, loads).unwrap_or_else(|| self.load(half));
                self.answer(number, answer, loads);
            }
            LoadPart::Tool { number, tool, diameter } => {
                let answer = self.known(number, loads).unwrap_or_else(|| {
                    if half.know_tool(tool, diameter) {
                        Loaded::Tool
                    } else {
                        Loaded::NoPlaceForTool
                    }
                });
                self.answer(number, answer, loads);
            }
        }
    }

    /// The answer where nothing is to be done any more.
    fn known(&self, number: u32, loads: &Loads) -> Option<Loaded> {
        let at = number as usize;
        if number != loads.decided {
            // It was answered already: what is answered now is not used.
            return Some(Loaded::default());
        }
        if at >= MOST_LOADS {
            return Some(Loaded::Refused(LoadError::Full));
        }
        (at < self.decided).then(|| self.answers[at])
    }

    fn answer(&mut self, number: u32, answer: Loaded, loads: &mut Loads) {
        if number != loads.decided {
            return;
        }
        if let Some(place) = self.answers.get_mut(number as usize) {
            *place = answer;
            self.decided = self.decided.max(number as usize + 1);
        }
        loads.last[(number % LOADS_UNDER_WAY) as usize] = answer;
        loads.decided += 1;
    }

    fn load<D: CyclicDrive, P: ControlPad>(&self, half: &mut RealtimeHalf<D, P>) -> Loaded {
        if self.too_long {
            return Loaded::Refused(LoadError::Condition(BadCondition::TooLong));
        }
        let watch = Watch {
            frequency: self.frequency,
            all_modes: self.all_modes,
            condition: &self.operations[..self.length],
            alarms: &self.alarms[..self.orders],
        };
        match half.watches().load(&watch) {
            Ok(number) => {
                half.watches().mark(number, self.mark);
                Loaded::Watch(number)
            }
            Err(why) => Loaded::Refused(why),
        }
    }
}

//! Watches: conditions of a program, evaluated in every servo cycle without an allocator, and what the machine does at once about them.
//!
//! They are loaded before the program starts ([`Watches::load`]: bounded, checked, never again questioned), started and stopped by
//! [`WatchOrder`]s in order with the path, and evaluated in the order in which they were started. What a watch does to the machine (an
//! alarm and its reaction) happens here, in the same cycle; what it records is the office half's, which hears of each firing.
//!
//! Read on: [`mod@signal`] for what can be looked at, [`mod@condition`] for the operations, [`mod@living`] for what runs and its end by hand.

mod alarms;
pub mod condition;
pub mod living;
pub mod signal;

pub use alarms::{AlarmOrder, Reaction, ResetBy};
pub use condition::{BadCondition, Operation, Relation};
pub use living::Living;
pub use signal::{Mode, NO_SENSOR, Readings, SIGNALS, Signal, Situation, WatchCost, signal};

use crate::Ring;
use alarms::Alarms;
use condition::{Deciding, Packed, evaluate, evaluate_all, only_comparisons};
use living::Life;
use units::{StepId, Tick};

/// Highest number of an alarm of a program.
pub const MOST_ALARMS: u16 = 999;
/// Alarms that one watch may set or clear.
pub const ALARMS_OF_A_WATCH: usize = 4;
/// Firings that wait for the office half at most.
pub const FIRINGS: usize = 1024;
/// Of those, places that only a watch with an alarm gets: when there is no room for all, what is only recorded goes first.
pub const RESERVED: usize = 128;
/// Different numbers in all conditions together.
pub const CONSTANTS: usize = 8192;
/// The conditions of one machine.
pub const CONDITIONS: usize = 4096;
/// Operations of all of them.
pub const OPERATIONS: usize = 24_576;

/// When a watch fires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frequency {
    /// In every cycle; it has no condition.
    #[default]
    NoKeyword,
    /// In every cycle in which the condition is true.
    Whenever,
    /// From the first such cycle on.
    FromFirst,
    /// In the first such cycle; then the condition is no longer checked.
    WhenOnce,
    /// In each cycle in which it becomes true.
    EveryEdge,
}

/// What a program says to its watches, in order with the path. Takes no time and needs no rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchOrder {
    /// Start the watch with this number.
    Start(u16),
    /// Take up a watch that ran before a reset or before the controller was started again. One that runs still runs on; another one goes
    /// on with what it knew of itself. A machine that knows nothing of it is told whether it had fired.
    TakeUp {
        /// Its number.
        watch: u16,
        /// It had fired, as far as anybody heard.
        fired: bool,
    },
    /// Stop it.
    Stop(u16),
    /// Do something to an alarm.
    Alarm(AlarmOrder),
    /// An operation begins here.
    OperationBegins,
    /// It ends.
    OperationEnds,
    /// One is under way: it begins here on a machine that does not know since when.
    OperationUnderWay,
}

/// A watch as it is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Watch<'w> {
    /// When it fires.
    pub frequency: Frequency,
    /// It goes on when the program is over, and in every mode; else only while a program runs in automatic.
    pub all_modes: bool,
    /// Its condition; empty with [`Frequency::NoKeyword`].
    pub condition: &'w [Operation],
    /// What it does to alarms, at most [`ALARMS_OF_A_WATCH`].
    pub alarms: &'w [AlarmOrder],
}

/// Why a watch is not loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadError {
    /// Its condition cannot be evaluated in every cycle.
    Condition(BadCondition),
    /// There is no place for another watch, its operations or its numbers.
    Full,
    /// It has a condition and no frequency, or the reverse.
    Frequency,
    /// It does more to alarms than [`ALARMS_OF_A_WATCH`], or to one that cannot exist.
    Alarms,
}

impl LoadError {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            LoadError::Condition(bad) => bad.text(),
            LoadError::Full => "the machine has no room for more conditions",
            LoadError::Frequency => "a condition needs a frequency, and a frequency other than none a condition",
            LoadError::Alarms => "it does more to alarms than a condition may, or to one that does not exist",
        }
    }
}

/// A watch has fired, could not be decided, or was ended by hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Firing {
    /// The cycle of the condition.
    pub tick: Tick,
    /// Which watch.
    pub watch: u16,
    /// What.
    pub kind: FiringKind,
}

/// What is told of a watch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FiringKind {
    /// It has fired.
    Fired,
    /// Its condition became unknown: a sensor went away. Told once each time.
    Unknown,
    /// Somebody ended it by hand ([`Watches::end`]).
    Ended,
}

/// What one cycle of all watches comes to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// The strongest reaction that is due now.
    pub reaction: Reaction,
    /// Operations that were evaluated: what it cost, counted.
    pub operations: u32,
}

/// Things that are counted and never only happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchCounters {
    /// Firings that found no place on their way to the office half.
    pub lost_firings: u64,
    /// Orders for watches that are not loaded, already run, or do not run.
    pub refused_orders: u64,
}

/// All watches of a machine.
#[derive(Clone, Debug)]
pub struct Watches<const CONDITIONS: usize = { self::CONDITIONS }, const OPERATIONS: usize = { self::OPERATIONS }> {
    slots: [Slot; CONDITIONS],
    /// What each does to alarms when it fires. Apart from the slots: these are read in every cycle and have to stay in the cache.
    orders: [Orders; CONDITIONS],
    /// What is asked for by name, for the same reason.
    lives: [Life; CONDITIONS],
    loaded: usize,
    /// Those before this place are of programs before the present one, whose first has number 0.
    base: usize,
    operations: [Packed; OPERATIONS],
    used: usize,
    constants: [f64; CONSTANTS],
    numbers: usize,
    /// The numbers of those that run, in the order of their start.
    running: [u16; CONDITIONS],
    runs: usize,
    /// The last cycle.
    now: Tick,
    alarms: Alarms,
    stop_after_operation: bool,
    firings: Ring<Firing, FIRINGS>,
    counters: WatchCounters,
}

/// What a watch does to alarms.
type Orders = [Option<AlarmOrder>; ALARMS_OF_A_WATCH];

/// One watch.
#[derive(Clone, Copy, Debug)]
struct Slot {
    first: u32,
    length: u16,
    /// So many comparisons, all of which have to hold, stand first and are all there is; 0 where it is another condition.
    comparisons: u16,
    /// Of these the one that was false last: it is looked at first, and while it stays false nothing else need be.
    deciding: Deciding,
    frequency: Frequency,
    all_modes: bool,
    runs: bool,
    /// From, When: the condition was true once. Every: it was true in the cycle before.
    latch: bool,
    /// It was started since it was loaded: `latch` is its own.
    started: bool,
    /// Every: it was true before, nobody knows until when. The next cycle that can be decided says what it is, and fires nothing.
    settling: bool,
    unknown: bool,
    /// Where it goes when the program before it is forgotten.
    place: u16,
}

impl Slot {
    /// A cycle in which its condition is false changes nothing of it, and nothing fires.
    #[inline(always)]
    fn stays_as_it_is_while_false(&self) -> bool {
        match self.frequency {
            Frequency::NoKeyword => false,
            Frequency::Whenever | Frequency::WhenOnce => !self.unknown,
            Frequency::FromFirst => !self.unknown & !self.latch,
            Frequency::EveryEdge => !self.unknown & !self.latch & !self.settling,
        }
    }
}

const EMPTY: Slot = Slot {
    first: 0,
    length: 0,
    comparisons: 0,
    deciding: Deciding::NOTHING,
    frequency: Frequency::NoKeyword,
    all_modes: false,
    runs: false,
    latch: false,
    started: false,
    settling: false,
    unknown: false,
    place: 0,
};

impl<const CONDITIONS: usize, const OPERATIONS: usize> Default for Watches<CONDITIONS, OPERATIONS> {
    fn default() -> Self {
        Watches::new()
    }
}

/// Before the program.
impl<const CONDITIONS: usize, const OPERATIONS: usize> Watches<CONDITIONS, OPERATIONS> {
    /// None.
    pub const fn new() -> Self {
        assert!(CONDITIONS <= 1 << 16);
        Watches {
            slots: [EMPTY; CONDITIONS],
            orders: [[None; ALARMS_OF_A_WATCH]; CONDITIONS],
            lives: [Life::NONE; CONDITIONS],
            loaded: 0,
            base: 0,
            operations: [const { Packed::NONE }; OPERATIONS],
            used: 0,
            constants: [0.0; CONSTANTS],
            numbers: 0,
            running: [0; CONDITIONS],
            runs: 0,
            now: Tick(0),
            alarms: Alarms {
                active: [0; 16],
                acknowledge: [0; 16],
                reset: [0; 16],
            },
            stop_after_operation: false,
            firings: Ring::new(),
            counters: WatchCounters {
                lost_firings: 0,
                refused_orders: 0,
            },
        }
    }

    /// Loads a watch and gives its number. It does not run yet.
    ///
    /// # Errors
    /// Why it cannot be; nothing of it is kept.
    pub fn load(&mut self, watch: &Watch<'_>) -> Result<u16, LoadError> {
        if watch.condition.is_empty() != (watch.frequency == Frequency::NoKeyword) {
            return Err(LoadError::Frequency);
        }
        if !watch.condition.is_empty() {
            condition::check(watch.condition).map_err(LoadError::Condition)?;
        }
        let possible = |order: &AlarmOrder| match order {
            AlarmOrder::Set { alarm, .. } | AlarmOrder::Clear { alarm } => (1..=MOST_ALARMS).contains(alarm),
        };
        if watch.alarms.len() > ALARMS_OF_A_WATCH || !watch.alarms.iter().all(possible) {
            return Err(LoadError::Alarms);
        }
        let end = self.used + watch.condition.len();
        if self.loaded == CONDITIONS || end > OPERATIONS {
            return Err(LoadError::Full);
        }
        let numbers_before = self.numbers;
        for (at, operation) in watch.condition.iter().enumerate() {
            let packed = Packed::of(*operation, |value| constant(&mut self.constants, &mut self.numbers, value));
            match packed {
                Some(packed) => self.operations[self.used + at] = packed,
                None => {
                    self.numbers = numbers_before;
                    return Err(LoadError::Full);
                }
            }
        }
        let comparisons = only_comparisons(&mut self.operations[self.used..end]);
        self.slots[self.loaded] = Slot {
            first: self.used as u32,
            comparisons,
            length: watch.condition.len() as u16,
            frequency: watch.frequency,
            all_modes: watch.all_modes,
            ..EMPTY
        };
        self.orders[self.loaded] = core::array::from_fn(|k| watch.alarms.get(k).copied());
        self.lives[self.loaded] = Life::NONE;
        self.used = end;
        self.loaded += 1;
        Ok((self.loaded - 1 - self.base) as u16)
    }

    /// How many of the present program are loaded.
    pub fn loaded(&self) -> usize {
        self.loaded - self.base
    }

    /// Another program: its watches have numbers from 0 on. Of those before only what runs in every mode is kept. It goes on, and what it
    /// does to alarms is done; its firings are told to nobody, because the run that would record them is over.
    pub fn new_program(&mut self) {
        self.program_ends();
        self.firings.clear();
        for (place, slot) in (0..).zip(self.slots[..self.loaded].iter_mut().filter(|slot| slot.runs)) {
            slot.place = place;
        }
        for number in &mut self.running[..self.runs] {
            *number = self.slots[usize::from(*number)].place;
        }
        // Each goes to a place that is its own or before it: those behind are not touched yet.
        let mut used = 0;
        for at in 0..self.loaded {
            let slot = self.slots[at];
            if !slot.runs {
                continue;
            }
            let (first, length) = (slot.first as usize, usize::from(slot.length));
            self.operations.copy_within(first..first + length, used);
            self.slots[usize::from(slot.place)] = Slot {
                first: used as u32,
                ..slot
            };
            self.orders[usize::from(slot.place)] = self.orders[at];
            self.lives[usize::from(slot.place)] = self.lives[at];
            used += length;
        }
        (self.loaded, self.base, self.used) = (self.runs, self.runs, used);
        for slot in &mut self.slots[self.loaded..] {
            slot.runs = false;
        }
        self.forget_constants();
    }

    /// Lets go of numbers that no operation has any more.
    fn forget_constants(&mut self) {
        const WORDS: usize = CONSTANTS / 64;
        let mut used = [0u64; WORDS];
        let place = |constant: u16| (usize::from(constant) / 64 % WORDS, u32::from(constant) % 64);
        for constant in self.operations[..self.used]
            .iter()
            .filter_map(|operation| operation.constant())
        {
            let (word, bit) = place(constant);
            used[word] |= 1 << bit;
        }
        let mut before = [0u16; WORDS];
        let mut kept = 0u16;
        for (word, before) in used.iter().zip(&mut before) {
            *before = kept;
            kept += word.count_ones() as u16;
        }
        let moved = |constant: u16| {
            let (word, bit) = place(constant);
            before[word] + (used[word] & ((1 << bit) - 1)).count_ones() as u16
        };
        for operation in &mut self.operations[..self.used] {
            if let Some(constant) = operation.constant() {
                *operation = operation.with_constant(moved(constant));
            }
        }
        for at in 0..self.numbers as u16 {
            let (word, bit) = place(at);
            if used[word] & (1 << bit) != 0 {
                self.constants[usize::from(moved(at))] = self.constants[usize::from(at)];
            }
        }
        self.numbers = usize::from(kept);
    }
}

/// The place of a number among the constants; found again when it is there already, so that a thousand conditions at 80 % need one.
fn constant(constants: &mut [f64; CONSTANTS], numbers: &mut usize, value: f64) -> Option<u16> {
    let known = constants[..*numbers]
        .iter()
        .rposition(|known| known.to_bits() == value.to_bits());
    let at = known.unwrap_or(*numbers);
    *constants.get_mut(at)? = value;
    *numbers = (*numbers).max(at + 1);
    u16::try_from(at).ok()
}

/// While it runs.
impl<const CONDITIONS: usize, const OPERATIONS: usize> Watches<CONDITIONS, OPERATIONS> {
    /// Does what the program says; gives the reaction of an alarm that it sets.
    pub fn obey(&mut self, order: WatchOrder) -> Reaction {
        match order {
            WatchOrder::Start(number) => self.start(number),
            WatchOrder::TakeUp { watch, fired } => self.take_up(watch, fired),
            WatchOrder::Stop(number) => self.stop(number),
            WatchOrder::Alarm(order) => {
                let reaction = self.alarms.obey(order);
                return self.react(reaction);
            }
            WatchOrder::OperationBegins | WatchOrder::OperationUnderWay => {}
            WatchOrder::OperationEnds => return self.operation_ends(),
        }
        Reaction::None
    }

    /// The present operation is over: a stop that was asked for its end is due.
    pub fn operation_ends(&mut self) -> Reaction {
        if core::mem::take(&mut self.stop_after_operation) {
            Reaction::FeedHold
        } else {
            Reaction::None
        }
    }

    /// One cycle of all that run, on the values of this cycle.
    pub fn cycle(&mut self, now: Tick, readings: &Readings, mode: Mode) -> Verdict {
        let mut verdict = Verdict::default();
        self.now = now;
        let values = readings.values();
        for at in 0..self.runs {
            let number = self.running[at];
            let slot = &mut self.slots[usize::from(number)];
            let over = slot.frequency == Frequency::WhenOnce && slot.latch;
            if over || (mode != Mode::Automatic && !slot.all_modes) {
                continue;
            }
            if slot.deciding.is_false(values) && slot.stays_as_it_is_while_false() {
                verdict.operations += 1;
                continue;
            }
            let decided = slot.frequency == Frequency::NoKeyword || (slot.frequency == Frequency::FromFirst && slot.latch);
            let truth = if decided {
                1.0
            } else {
                let first = slot.first as usize;
                verdict.operations += u32::from(slot.length);
                let operations = self.operations.get(first..first + usize::from(slot.length)).unwrap_or(&[]);
                match operations.get(..usize::from(slot.comparisons)) {
                    Some(all) if !all.is_empty() => {
                        let (truth, deciding) = evaluate_all(all, &self.constants, values);
                        slot.deciding = deciding;
                        truth
                    }
                    _ => {
                        let alarms = &self.alarms;
                        evaluate(operations, &self.constants, values, |alarm| alarms.is_active(alarm))
                    }
                }
            };
            if truth.is_nan() {
                if !core::mem::replace(&mut slot.unknown, true) {
                    self.tell(now, number, FiringKind::Unknown);
                }
                continue;
            }
            slot.unknown = false;
            let holds = truth == 1.0;
            let before = slot.latch;
            let edge = slot.frequency == Frequency::EveryEdge;
            if core::mem::replace(&mut slot.settling, false) && edge {
                slot.latch = holds;
                continue;
            }
            slot.latch = holds || (before && !edge);
            if holds && !(edge && before) {
                let reaction = self.fire(now, number);
                verdict.reaction = verdict.reaction.max(reaction);
            }
        }
        verdict
    }

    /// Cycle start: alarms that wait for it are over.
    pub fn acknowledge(&mut self) {
        self.alarms.end(|alarms| &alarms.acknowledge);
    }

    /// A reset: alarms that wait for it are over, and so is the program.
    pub fn reset(&mut self) {
        self.alarms.end(|alarms| &alarms.reset);
        self.program_ends();
    }

    /// The power is off: nothing goes on.
    pub fn power_off(&mut self) {
        self.program_ends();
        for number in &self.running[..self.runs] {
            self.slots[usize::from(*number)].runs = false;
        }
        self.runs = 0;
    }

    /// The program is over: so is what belongs to automatic.
    pub fn program_ends(&mut self) {
        self.stop_after_operation = false;
        let mut kept = 0;
        for at in 0..self.runs {
            let number = self.running[at];
            let slot = &mut self.slots[usize::from(number)];
            if slot.all_modes {
                self.running[kept] = number;
                kept += 1;
            } else {
                slot.runs = false;
            }
        }
        self.runs = kept;
    }

    /// The oldest firing that was not taken yet.
    pub fn firing(&mut self) -> Option<Firing> {
        self.firings.pop()
    }

    /// The same, left in place.
    pub fn next_firing(&self) -> Option<&Firing> {
        self.firings.front()
    }

    /// True while the alarm is active.
    pub fn alarm(&self, alarm: u16) -> bool {
        self.alarms.is_active(alarm)
    }

    /// How many run.
    pub fn running(&self) -> usize {
        self.runs
    }

    /// What was counted.
    pub fn counters(&self) -> WatchCounters {
        self.counters
    }

    fn start(&mut self, number: u16) {
        let at = self.base + usize::from(number);
        if at >= self.loaded || self.slots[at].runs {
            self.counters.refused_orders += 1;
            return;
        }
        let slot = &mut self.slots[at];
        (slot.latch, slot.settling, slot.unknown) = (false, false, false);
        slot.deciding = Deciding::NOTHING;
        self.lives[at].begin(self.now);
        self.run(at);
    }

    fn take_up(&mut self, number: u16, fired: bool) {
        let at = self.base + usize::from(number);
        if at >= self.loaded {
            self.counters.refused_orders += 1;
            return;
        }
        let slot = &mut self.slots[at];
        // What a person has ended stays so, whoever knows it.
        if slot.runs || self.lives[at].ended {
            return;
        }
        if !slot.started {
            self.lives[at].begin(self.now);
        }
        match slot.frequency {
            // What has fired stays so, whoever knows it.
            Frequency::WhenOnce | Frequency::FromFirst => slot.latch |= fired,
            Frequency::EveryEdge if !slot.started => slot.settling = fired,
            Frequency::EveryEdge | Frequency::NoKeyword | Frequency::Whenever => {}
        }
        self.run(at);
    }

    fn run(&mut self, at: usize) {
        let slot = &mut self.slots[at];
        (slot.runs, slot.started) = (true, true);
        self.running[self.runs] = at as u16;
        self.runs += 1;
    }

    fn stop(&mut self, number: u16) {
        if !self.take_off(self.base + usize::from(number)) {
            self.counters.refused_orders += 1;
        }
    }

    /// Takes what runs off the list; false where it does not run.
    fn take_off(&mut self, slot: usize) -> bool {
        let Some(at) = self.running[..self.runs]
            .iter()
            .position(|running| usize::from(*running) == slot)
        else {
            return false;
        };
        self.running.copy_within(at + 1..self.runs, at);
        self.runs -= 1;
        self.slots[slot].runs = false;
        true
    }

    fn fire(&mut self, now: Tick, watch: u16) -> Reaction {
        self.tell(now, watch, FiringKind::Fired);
        self.lives[usize::from(watch)].fired += 1;
        let mut strongest = Reaction::None;
        for order in self.orders[usize::from(watch)].into_iter().flatten() {
            let reaction = self.alarms.obey(order);
            strongest = strongest.max(self.react(reaction));
        }
        strongest
    }

    /// What is due now; what is due where the operation ends is kept.
    fn react(&mut self, reaction: Reaction) -> Reaction {
        if reaction == Reaction::StopAfterOperation {
            self.stop_after_operation = true;
            return Reaction::None;
        }
        reaction
    }

    fn tell(&mut self, tick: Tick, slot: u16, kind: FiringKind) {
        let Some(number) = usize::from(slot).checked_sub(self.base) else {
            return;
        };
        let firing = Firing {
            tick,
            watch: number as u16,
            kind,
        };
        let alarms = self.orders[usize::from(slot)][0].is_some();
        let room = if alarms || kind == FiringKind::Ended { 0 } else { RESERVED };
        if self.firings.free() <= room || self.firings.push(firing).is_err() {
            self.counters.lost_firings += 1;
        }
    }
}

/// An order with the step that says so, as the controller hands it on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ordered {
    /// What is to be done.
    pub order: WatchOrder,
    /// The step that says so.
    pub step: StepId,
}

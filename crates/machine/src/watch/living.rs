//! What lives in the machine: the watches that run, as numbers that mean the same from one program to the next, and their end by hand.
//!
//! What runs in all modes outlives its program, and the places of watches are those of a program. So each is given a mark when it is loaded,
//! by whoever keeps its words; here there are only numbers.

use super::{FiringKind, Watches};
use units::Tick;

/// A watch that runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Living {
    /// What whoever loaded it calls it; 0 where nobody gave it a mark.
    pub mark: u32,
    /// It goes on when its program is over, and in every mode.
    pub all_modes: bool,
    /// The last cycle before its first.
    pub since: Tick,
    /// How often it has fired since then.
    pub fired: u64,
}

/// What is known of a watch besides what each cycle needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Life {
    mark: u32,
    since: Tick,
    pub fired: u64,
    /// It was ended by hand: only its program's own start begins it again.
    pub ended: bool,
}

impl Life {
    pub const NONE: Life = Life {
        mark: 0,
        since: Tick(0),
        fired: 0,
        ended: false,
    };

    /// It is started.
    pub fn begin(&mut self, now: Tick) {
        (self.since, self.fired, self.ended) = (now, 0, false);
    }
}

impl<const CONDITIONS: usize, const OPERATIONS: usize> Watches<CONDITIONS, OPERATIONS> {
    /// Says by which mark a watch of the present program is asked for, from 1 on.
    pub fn mark(&mut self, number: u16, mark: u32) {
        let at = self.base + usize::from(number);
        if let Some(life) = self.lives[..self.loaded].get_mut(at) {
            life.mark = mark;
        }
    }

    /// The next watch that runs at this place or behind it, and the place behind that. The order is that of loading; it is another one only
    /// after [`Watches::new_program`]. At most `places` places are looked at: beyond them stands `None` and the place to go on at.
    pub fn living(&self, from: usize, places: usize) -> (Option<Living>, usize) {
        let end = self.loaded.min(from.saturating_add(places));
        match (from..end).find(|at| self.slots[*at].runs) {
            Some(at) => (Some(self.living_at(at)), at + 1),
            None => (None, end),
        }
    }

    /// How many places there are for [`Watches::living`].
    pub fn places(&self) -> usize {
        self.loaded
    }

    /// Ends a watch of all modes by hand; gives it as it was. One of a program ends with its program: `None`, as where none has that mark.
    /// Its run hears of it, if that is the present one.
    pub fn end(&mut self, mark: u32) -> Option<Living> {
        let has = |at: &usize| mark != 0 && self.slots[*at].runs && self.slots[*at].all_modes && self.lives[*at].mark == mark;
        let at = (0..self.loaded).find(has)?;
        let living = self.living_at(at);
        self.lives[at].ended = true;
        self.take_off(at);
        self.tell(self.now, at as u16, FiringKind::Ended);
        Some(living)
    }

    fn living_at(&self, at: usize) -> Living {
        let life = &self.lives[at];
        Living {
            mark: life.mark,
            all_modes: self.slots[at].all_modes,
            since: life.since,
            fired: life.fired,
        }
    }
}

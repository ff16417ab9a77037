//! Alarms of a program: a bit for each, what the machine does at one, and what ends it.

/// What the machine does at an alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Nothing.
    #[default]
    None,
    /// A hold where the present operation ends.
    StopAfterOperation,
    /// A hold now.
    FeedHold,
    /// A controlled stop now.
    StopNow,
}

/// What ends an alarm besides the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResetBy {
    /// Nothing.
    Function,
    /// Cycle start, or a reset.
    #[default]
    Acknowledge,
    /// A reset.
    Reset,
}

/// What is done to an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmOrder {
    /// It is set; one that is set stays as it is.
    Set {
        /// 1 to 999.
        alarm: u16,
        /// What the machine does.
        reaction: Reaction,
        /// What ends it.
        reset_by: ResetBy,
    },
    /// It is cleared.
    Clear {
        /// 1 to 999.
        alarm: u16,
    },
}

/// A bit for each alarm.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Alarms {
    pub(super) active: [u64; 16],
    /// Cycle start ends it.
    pub(super) acknowledge: [u64; 16],
    /// A reset ends it.
    pub(super) reset: [u64; 16],
}

impl Alarms {
    pub(super) const fn bit(alarm: u16) -> (usize, u64) {
        ((alarm as usize >> 6) % 16, 1 << (alarm % 64))
    }
    pub(super) fn is_active(&self, alarm: u16) -> bool {
        let (word, bit) = Self::bit(alarm);
        self.active[word] & bit != 0
    }
    /// The reaction that is due: none when the alarm was set already.
    pub(super) fn obey(&mut self, order: AlarmOrder) -> Reaction {
        match order {
            AlarmOrder::Clear { alarm } => {
                let (word, bit) = Self::bit(alarm);
                self.active[word] &= !bit;
                Reaction::None
            }
            AlarmOrder::Set { alarm, .. } if self.is_active(alarm) => Reaction::None,
            AlarmOrder::Set {
                alarm,
                reaction,
                reset_by,
            } => {
                let (word, bit) = Self::bit(alarm);
                self.active[word] |= bit;
                for (set, by) in [
                    (&mut self.acknowledge, reset_by == ResetBy::Acknowledge),
                    (&mut self.reset, reset_by != ResetBy::Function),
                ] {
                    set[word] = if by { set[word] | bit } else { set[word] & !bit };
                }
                reaction
            }
        }
    }
    pub(super) fn end(&mut self, by: fn(&Self) -> &[u64; 16]) {
        let ended = *by(self);
        for (active, ended) in self.active.iter_mut().zip(ended) {
            *active &= !ended;
        }
    }
}

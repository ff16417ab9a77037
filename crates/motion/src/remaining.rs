//! How long a program still takes: its plan made beforehand, kept as time over path length in constant memory.
//!
//! [`RemainingTime`] is fed with the outputs of a [`crate::Trajectory`] of its own, under the limits that the run is planned with, and then
//! answers for any place. It knows what the plan knows: motion and dwells. Waits for the spindle, for a tool or for an answer of the machine
//! take time that no plan has, and so does what overrides and holds do; [`RemainingTime::at_this_pace`] takes what the run took so far into
//! account.

use crate::{Output, Trajectory};
use machine::Command;
use plan::{Answer, Question};
use units::{Seconds, StepId, TICK};

/// Marks that are kept at most; then every other one goes. A place between two marks is told by a straight line, so a remaining time is
/// off by less than the time between two: a two-thousandth of the program.
const MOST_MARKS: usize = 4096;

/// Share of a job from which on its pace is told from what it took.
const PACED_FROM: f64 = 0.02;

/// A place of the plan: path length, mm, its step, and the cycles up to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Mark {
    path_length: f64,
    step: StepId,
    cycles: u64,
}

/// How long a program still takes.
#[derive(Clone, Debug, PartialEq)]
pub struct RemainingTime {
    /// None of their numbers falls.
    marks: Vec<Mark>,
    /// Cycles between two marks.
    every: u64,
    end: Mark,
    whole: bool,
}

impl Default for RemainingTime {
    fn default() -> Self {
        RemainingTime {
            marks: vec![Mark::default()],
            every: 1,
            end: Mark::default(),
            whole: false,
        }
    }
}

impl RemainingTime {
    /// Plans a whole program. What it asks is answered by `answer`; where that has none, the plan ends, and
    /// [`RemainingTime::is_whole`] says so.
    pub fn of(mut trajectory: Trajectory<'_>, mut answer: impl FnMut(&Question) -> Option<Answer>) -> RemainingTime {
        let mut remaining = RemainingTime::default();
        let mut given = None;
        loop {
            let output = trajectory.next(given.take());
            remaining.add(&output);
            match output {
                Output::End | Output::Alarm(_) => return remaining,
                Output::Ask(question) => match answer(&question) {
                    Some(answer) => given = Some(answer),
                    None => return remaining,
                },
                Output::Command(_) | Output::Passed(_) => {}
            }
        }
    }

    /// Takes the next output of the plan, for who makes it a part at a time.
    pub fn add(&mut self, output: &Output) {
        match output {
            Output::Command(Command::SetPoint(point)) => self.go(point.path_length, point.step, 1),
            Output::Command(Command::Dwell { cycles, step }) => {
                // Both ends, so that the time of a long one is not spread over the path beside it.
                self.mark();
                self.go(self.end.path_length, *step, u64::from(*cycles));
                self.mark();
            }
            Output::End => self.whole = true,
            _ => {}
        }
    }

    fn go(&mut self, path_length: f64, step: StepId, cycles: u64) {
        self.end = Mark {
            path_length: path_length.max(self.end.path_length),
            step: step.max(self.end.step),
            cycles: self.end.cycles + cycles,
        };
        if self.end.cycles >= self.last() + self.every {
            self.mark();
        }
    }

    fn last(&self) -> u64 {
        self.marks.last().map_or(0, |mark| mark.cycles)
    }

    fn mark(&mut self) {
        if self.end.cycles > self.last() {
            self.marks.push(self.end);
        }
        while self.marks.len() > MOST_MARKS {
            self.every *= 2;
            let (every, end) = (self.every, self.end.cycles);
            let mut last = 0;
            // A mark stays where the next one is far, too: that is a dwell.
            let kept: Vec<bool> = (0..self.marks.len())
                .map(|k| {
                    let next = self.marks.get(k + 1).map_or(end, |mark| mark.cycles);
                    let keep = k == 0 || self.marks[k].cycles >= last + every || next >= self.marks[k].cycles + 2 * every;
                    if keep {
                        last = self.marks[k].cycles;
                    }
                    keep
                })
                .collect();
            let mut kept = kept.into_iter();
            self.marks.retain(|_| kept.next().unwrap_or(true));
        }
    }

    /// True when the program was planned to its end; otherwise it takes longer than is said here.
    pub fn is_whole(&self) -> bool {
        self.whole
    }

    /// The time of all motion and dwells.
    pub fn total(&self) -> Seconds {
        Seconds(self.end.cycles as f64 * TICK.0)
    }

    /// Planned time from the start to where the path has this length ([`machine::SetPoint::path_length`]), mm, in this step: in a dwell that
    /// of its end, and before it that of its beginning.
    pub fn until(&self, step: StepId, path_length: f64) -> Seconds {
        let reached = |mark: &Mark| (mark.path_length, mark.step) <= (path_length, step);
        let after = self.marks.partition_point(reached);
        let Some(before) = after.checked_sub(1).map(|k| self.marks[k]) else {
            return Seconds(0.0);
        };
        let next = self.marks.get(after).copied().unwrap_or(self.end);
        let share = if next.path_length > before.path_length {
            ((path_length - before.path_length) / (next.path_length - before.path_length)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        Seconds((before.cycles as f64 + share * (next.cycles - before.cycles) as f64) * TICK.0)
    }

    /// Planned time from where the path has this length, mm, in this step, to the end.
    pub fn after(&self, step: StepId, path_length: f64) -> Seconds {
        Seconds((self.total().0 - self.until(step, path_length).0).max(0.0))
    }

    /// The same if the run goes on at the pace it had: `taken` is what it took so far. At the very start the pace is that of the plan.
    pub fn at_this_pace(&self, step: StepId, path_length: f64, taken: Seconds) -> Seconds {
        let (planned, after) = (self.until(step, path_length), self.after(step, path_length));
        if planned.0 < PACED_FROM * self.total().0 || !(taken.0 > 0.0 && taken.0.is_finite()) {
            return after;
        }
        Seconds(after.0 * taken.0 / planned.0)
    }
}

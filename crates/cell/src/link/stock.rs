//! The part of the plan that the sender keeps: from the last set-point that the machine has done to as far as it was planned.
//!
//! Commands have their number in the plan, from 1: the count that is done with them. Set-points have theirs besides, from 1, which is
//! planned time in cycles.

use machine::watch::WatchOrder;
use machine::{Command, CoolantOutlets, SetPoint, SpindleCommand};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use units::{StepId, ToolNumber, WorkingstepId};

/// Commands beyond what is done that are kept at most: what may be under way, its tail, and enough to begin anew.
const KEPT: u64 = 1_500;

/// What is in force besides motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InForce {
    /// The tool in the spindle.
    pub tool: ToolNumber,
    /// The spindle.
    pub spindle: SpindleCommand,
    /// The coolant.
    pub coolant: CoolantOutlets,
    /// The workingstep.
    pub workingstep: WorkingstepId,
    /// Conditions that were started, in that order, each with the number of the command that did it.
    pub watches: Vec<(u16, u64)>,
    /// An operation has begun.
    pub in_operation: bool,
    /// The step of it all.
    pub step: StepId,
}

impl InForce {
    fn follow(&mut self, number: u64, command: &Command) {
        match *command {
            Command::SetPoint(s) => self.step = s.step,
            Command::Spindle { spindle, step } => (self.spindle, self.step) = (spindle, step),
            Command::SpindleSpeed(speed) => {
                self.spindle = match self.spindle {
                    SpindleCommand::Stop => SpindleCommand::Stop,
                    SpindleCommand::Clockwise(_) => SpindleCommand::Clockwise(speed),
                    SpindleCommand::Counterclockwise(_) => SpindleCommand::Counterclockwise(speed),
                };
            }
            Command::Coolant { outlets, step } => (self.coolant, self.step) = (outlets, step),
            Command::Tool { tool, step } => (self.tool, self.step) = (tool, step),
            Command::Workingstep { workingstep, step } => (self.workingstep, self.step) = (workingstep, step),
            Command::Watch { order, .. } => self.follow_watch(number, order),
            Command::Dwell { step, .. } | Command::Pause { step } | Command::ToolLength { step, .. } => self.step = step,
            Command::End { step } => {
                (self.spindle, self.coolant, self.step) = (SpindleCommand::Stop, CoolantOutlets::default(), step);
                self.watches.clear();
                self.in_operation = false;
            }
        }
    }

    fn follow_watch(&mut self, number: u64, order: WatchOrder) {
        match order {
            WatchOrder::Start(watch) | WatchOrder::TakeUp { watch, .. } => {
                if self.watches.iter().all(|(started, _)| *started != watch) {
                    self.watches.push((watch, number));
                }
            }
            WatchOrder::Stop(watch) => self.watches.retain(|(started, _)| *started != watch),
            WatchOrder::OperationBegins | WatchOrder::OperationUnderWay => self.in_operation = true,
            WatchOrder::OperationEnds => self.in_operation = false,
            // One that is set stays with the machine; a reset by a person has ended it.
            WatchOrder::Alarm(_) => {}
        }
    }

    /// What takes the conditions up again on a machine on which they are over; those in `fired` had fired. Those in `ended` were ended by hand
    /// when so many commands were done and stay so, if the program has not started them again since. On one that only stopped they run on where they are, and this changes nothing.
    pub fn watch_commands<'f>(
        &'f self,
        fired: &'f BTreeSet<u16>,
        ended: &'f BTreeMap<u16, u64>,
    ) -> impl Iterator<Item = Command> + 'f {
        let step = self.step;
        let begins = self.in_operation.then_some(WatchOrder::OperationUnderWay);
        let is_over = |&(watch, started): &(u16, u64)| ended.get(&watch).is_some_and(|done| *done >= started);
        let starts = self.watches.iter().filter(move |started| !is_over(started));
        let starts = starts.map(|&(watch, _)| WatchOrder::TakeUp {
            watch,
            fired: fired.contains(&watch),
        });
        begins
            .into_iter()
            .chain(starts)
            .map(move |order| Command::Watch { order, step })
    }

    /// The commands that bring it about, in the order in which a machine is got ready. The tool only where another one is in.
    pub fn commands(&self, tool: ToolNumber) -> Vec<Command> {
        let step = self.step;
        let mut commands = Vec::new();
        if self.tool != tool {
            commands.push(Command::Tool { tool: self.tool, step });
        }
        commands.push(Command::Workingstep {
            workingstep: self.workingstep,
            step,
        });
        commands.push(Command::Spindle {
            spindle: self.spindle,
            step,
        });
        commands.push(Command::Coolant {
            outlets: self.coolant,
            step,
        });
        commands
    }
}

/// A stretch of a plan.
#[derive(Clone, Debug, Default)]
pub struct Stock {
    commands: VecDeque<Command>,
    /// Number of the first kept command.
    first: u64,
    /// Numbers of the kept set-points among the commands.
    set_points: VecDeque<u64>,
    /// Number of the first kept set-point among set-points.
    first_cycle: u64,
    /// In force before the first kept command.
    in_force: InForce,
    done: u64,
}

impl Stock {
    /// A plan of which nothing is known yet.
    pub fn new() -> Self {
        Stock {
            first: 1,
            first_cycle: 1,
            ..Stock::default()
        }
    }

    /// Adds the next command of the plan. What is done already is passed over.
    ///
    /// # Errors
    /// Gives it back when there are enough.
    pub fn push(&mut self, command: Command) -> Result<(), Command> {
        if self.end() > self.done + KEPT {
            return Err(command);
        }
        if matches!(command, Command::SetPoint(_)) {
            self.set_points.push_back(self.end());
        }
        self.commands.push_back(command);
        self.trim();
        Ok(())
    }

    /// So many commands are done; it never falls.
    pub fn done(&mut self, count: u64) {
        self.done = self.done.max(count);
        self.trim();
    }

    /// How many commands are done.
    pub fn count_done(&self) -> u64 {
        self.done
    }

    /// True when the end of the program is done, and nothing follows it.
    pub fn is_over(&self) -> bool {
        self.done + 1 == self.end() && matches!(self.command(self.done), Some(Command::End { .. }))
    }

    /// The number after the last command.
    pub fn end(&self) -> u64 {
        self.first + self.commands.len() as u64
    }

    /// The command of a number.
    pub fn command(&self, number: u64) -> Option<&Command> {
        self.commands.get(usize::try_from(number.checked_sub(self.first)?).ok()?)
    }

    /// The set-point of a cycle, and its number among the commands.
    pub fn set_point(&self, cycle: u64) -> Option<(&SetPoint, u64)> {
        let number = *self
            .set_points
            .get(usize::try_from(cycle.checked_sub(self.first_cycle)?).ok()?)?;
        match self.command(number) {
            Some(Command::SetPoint(set_point)) => Some((set_point, number)),
            _ => None,
        }
    }

    /// The cycle of the last kept set-point up to a command.
    pub fn cycle_of(&self, number: u64) -> u64 {
        let before = self.set_points.partition_point(|&n| n <= number) as u64;
        (self.first_cycle + before).saturating_sub(1)
    }

    /// The cycle of the last set-point that is done; `None`: there was none, or it is not known yet.
    pub fn last_done_cycle(&self) -> Option<u64> {
        let kept = self.set_points.partition_point(|&number| number <= self.done) as u64;
        (kept > 0).then(|| self.first_cycle + kept - 1)
    }

    /// What is in force where so many commands are done.
    pub fn in_force(&self, done: u64) -> InForce {
        let mut in_force = self.in_force.clone();
        let count = usize::try_from((done + 1).saturating_sub(self.first)).unwrap_or(usize::MAX);
        for (number, command) in (self.first..).zip(self.commands.iter().take(count)) {
            in_force.follow(number, command);
        }
        in_force
    }

    /// True when the path is at rest at the set-point of a cycle: it stands there, or a command that needs rest comes next.
    pub fn rests_at(&self, cycle: u64) -> bool {
        let Some((set_point, number)) = self.set_point(cycle) else {
            return false;
        };
        let next = (number + 1..).map_while(|n| self.command(n));
        set_point.velocity == [0.0; 3] || next.take_while(|c| !matches!(c, Command::SetPoint(_))).any(needs_rest)
    }

    /// Lets go of all before the last set-point that is done.
    fn trim(&mut self) {
        let Some(keep) = self.last_done_cycle() else { return };
        while self.first_cycle < keep {
            self.set_points.pop_front();
            self.first_cycle += 1;
        }
        let Some(&number) = self.set_points.front() else { return };
        while self.first < number {
            if let Some(command) = self.commands.pop_front() {
                self.in_force.follow(self.first, &command);
            }
            self.first += 1;
        }
    }
}

/// True for commands that the machine executes at rest.
pub fn needs_rest(command: &Command) -> bool {
    match command {
        Command::SetPoint(_)
        | Command::SpindleSpeed(_)
        | Command::Coolant { .. }
        | Command::Workingstep { .. }
        | Command::Watch { .. }
        | Command::ToolLength { .. } => false,
        Command::Spindle { .. } | Command::Tool { .. } | Command::Dwell { .. } | Command::Pause { .. } | Command::End { .. } => {
            true
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_ended_by_hand_is_taken_up_again_only_where_the_program_has_started_it_since() {
        let say = |order| Command::Watch { order, step: StepId(1) };
        let mut stock = Stock::new();
        for order in [
            WatchOrder::Start(3),
            WatchOrder::Start(4),
            WatchOrder::Stop(3),
            WatchOrder::Start(3),
        ] {
            stock.push(say(order)).expect("room");
        }
        let taken_up = |done: u64, ended: &[(u16, u64)]| -> Vec<u16> {
            let ended = ended.iter().copied().collect();
            let in_force = stock.in_force(done);
            let commands: Vec<Command> = in_force.watch_commands(&BTreeSet::new(), &ended).collect();
            let watch = |command| match command {
                Command::Watch {
                    order: WatchOrder::TakeUp { watch, .. },
                    ..
                } => Some(watch),
                _ => None,
            };
            commands.into_iter().filter_map(watch).collect()
        };
        assert_eq!(taken_up(2, &[]), [3, 4]);
        assert_eq!(taken_up(2, &[(3, 2)]), [4], "ended where it runs");
        assert_eq!(taken_up(4, &[(3, 2)]), [4, 3], "the program has started it again");
        assert_eq!(taken_up(4, &[(3, 4)]), [4], "and that was ended too");
    }
}

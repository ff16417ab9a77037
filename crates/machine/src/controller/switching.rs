//! Commands that are not set-points: spindle, coolant, tool, dwell, and waiting for them.

use super::*;

impl Controller {
    /// Executes a command that is not a set-point.
    pub(super) fn begin(&mut self, command: Command) {
        let mut work = None;
        match command {
            Command::SetPoint(_) => {}
            Command::Spindle { spindle, step } => {
                self.step = step;
                self.spindle = self.limited(spindle);
                work = Some((
                    Wait::Spindle,
                    seconds_in_cycles(self.parameters.spindle.time_out.0),
                    self.tool,
                ));
            }
            Command::SpindleSpeed(speed) => {
                self.spindle = self.limited(match self.spindle {
                    SpindleCommand::Stop => SpindleCommand::Stop,
                    SpindleCommand::Clockwise(_) => SpindleCommand::Clockwise(speed),
                    SpindleCommand::Counterclockwise(_) => SpindleCommand::Counterclockwise(speed),
                });
            }
            Command::Coolant { outlets, step } => {
                self.step = step;
                self.coolant = outlets;
            }
            Command::Tool { tool, step } => {
                self.step = step;
                self.hand.left_at = self.here.position;
                self.hand.lengthened = self.length.next - self.length.now;
                work = Some((Wait::ToolAway, 0, tool));
            }
            Command::ToolLength { length, step } => {
                self.step = step;
                self.length.next = length;
            }
            Command::Dwell { cycles, step } => {
                self.step = step;
                work = Some((Wait::Dwell, u64::from(cycles), self.tool));
            }
            Command::Workingstep { workingstep, step } => {
                self.step = step;
                self.workingstep = workingstep;
            }
            Command::Watch { order, step } => {
                // One cycle takes no more than its instant commands, and each cycle hands them all on.
                let _ = self.watch_orders.push(Ordered { order, step });
            }
            Command::Pause { step } => {
                self.step = step;
                self.happen(Event::Pause);
            }
            Command::End { step } => {
                self.step = step;
                self.happen(Event::ProgramEnd);
            }
        }
        match work {
            None => self.counters.completed += 1,
            Some((Wait::ToolAway, _, tool)) => {
                self.in_work = Some(Work {
                    wait: Wait::ToolAway,
                    cycles: 0,
                    tool,
                });
                self.commanded = self.here.position;
                if self.is_at_tool_place() {
                    self.exchange_tool(tool);
                } else {
                    self.happen(Event::Wait(Wait::ToolAway));
                }
            }
            Some((wait, cycles, tool)) => self.wait(wait, cycles, tool),
        }
    }

    /// The axes are where tools are changed.
    fn exchange_tool(&mut self, tool: ToolNumber) {
        let time = if tool == self.tool {
            0
        } else {
            seconds_in_cycles(self.parameters.tool_change.0)
        };
        self.wait(Wait::Tool, time, tool);
    }

    /// After a cycle start, spindle and coolant come back before the path goes on.
    pub(super) fn restore(&mut self, cycles: u64, feedback: &Feedback) {
        if self.state != State::Resuming {
            return;
        }
        self.restoring = self.restoring.saturating_sub(cycles);
        if self.spindle_is_there(feedback.spindle_speed) {
            self.happen(Event::Restored);
        } else if self.restoring == 0 {
            self.happen(Event::Fault(FaultCause::Spindle));
        }
    }

    /// True at rest before a thread as long as the spindle is not at the speed that the thread was planned for: its override does not act.
    pub(super) fn waits_for_thread(&mut self, cycles: u64, feedback: &Feedback) -> bool {
        let at_rest = self.fraction == 0.0 && is_rest(&self.here);
        let next = self.next_set_point().filter(|next| next.is_locked());
        let Some(tie) = next.map(|next| next.tie).filter(|_| at_rest && self.state == State::Running) else {
            self.thread_waits = 0;
            return false;
        };
        if core::mem::take(&mut self.thread.has_begun) {
            return false;
        }
        let is_there = self.spindle_is_there(feedback.spindle_speed);
        if tie.is_some() && self.thread_waits == 0 {
            self.angle.acknowledge();
        }
        if is_there && tie.is_none_or(|tie| self.meets_the_mark(tie)) {
            (self.thread_waits, self.standing, self.thread.has_begun) = (0, true, true);
            return false;
        }
        self.thread_waits += cycles;
        if self.thread_waits > seconds_in_cycles(self.parameters.spindle.time_out.0) {
            self.happen(if is_there {
                Event::Stop(StopCause::Starved)
            } else {
                Event::Fault(FaultCause::Spindle)
            });
        }
        true
    }

    /// The command that was just taken needs time.
    pub(super) fn wait(&mut self, wait: Wait, cycles: u64, tool: ToolNumber) {
        self.in_work = Some(Work { wait, cycles, tool });
        self.happen(Event::Wait(wait));
    }

    /// True when every axis is as near to the set-point that was reached last as the window says.
    pub(super) fn is_in_position(&self) -> bool {
        (0..3).all(|k| (self.here.position[k] - self.last_position[k]).abs() <= self.parameters.in_position.0)
    }

    /// Goes on with a command that takes time. A stop abandons a dwell or a spindle wait; a tool change is finished in any case, and a
    /// set-point was reached already.
    pub(super) fn go_on_with_work(&mut self, cycles: u64, feedback: &Feedback) {
        let Some(work) = self.in_work else { return };
        let stopping = matches!(self.state, State::Stopping(_));
        let left = work.cycles.saturating_sub(cycles);
        self.in_work = Some(Work { cycles: left, ..work });
        let done = match work.wait {
            Wait::Tool => left == 0,
            Wait::Position => {
                let there = self.is_in_position();
                self.counters.in_position_time_outs += u64::from(!there && left == 0 && !stopping);
                there || left == 0 || stopping
            }
            _ if stopping => {
                self.in_work = None;
                self.counters.discarded += 1;
                return;
            }
            Wait::Spindle => {
                let there = self.spindle_is_there(feedback.spindle_speed);
                if !there && left == 0 {
                    self.happen(Event::Fault(FaultCause::Spindle));
                }
                there
            }
            Wait::ToolAway => self.stands() && self.is_at_tool_place(),
            Wait::ToolBack => self.stands() && self.is_back_from_tool_change(),
            Wait::Dwell | Wait::Commands => left == 0,
        };
        if !done {
            return;
        }
        match work.wait {
            Wait::ToolAway => return self.exchange_tool(work.tool),
            Wait::Tool => {
                self.tool = work.tool;
                self.length.now = self.length.next;
                if !stopping && !self.is_back_from_tool_change() {
                    return self.wait(Wait::ToolBack, 0, work.tool);
                }
                if stopping {
                    // The path is not gone on with: it stands where tools are changed, and not where the path was left.
                    self.stand_at(self.commanded);
                } else if self.hand.lengthened != 0.0 {
                    self.go_on_from_tool_change();
                }
            }
            Wait::ToolBack => self.go_on_from_tool_change(),
            _ => {}
        }
        if matches!(work.wait, Wait::Tool | Wait::ToolBack) && !stopping && !self.spindle_is_there(feedback.spindle_speed) {
            // The change stopped the spindle; it comes back before the program goes on.
            let cycles = seconds_in_cycles(self.parameters.spindle.time_out.0);
            self.wait(Wait::Spindle, cycles, work.tool);
            return;
        }
        self.in_work = None;
        self.counters.completed += 1;
        self.happen(Event::WaitOver);
    }

    pub(super) fn spindle_is_there(&self, speed: f64) -> bool {
        let (target, tolerance) = match self.spindle_order() {
            SpindleCommand::Stop => (0.0, 0.0),
            SpindleCommand::Clockwise(n) => (n.0, self.parameters.spindle.tolerance * n.0),
            SpindleCommand::Counterclockwise(n) => (-n.0, self.parameters.spindle.tolerance * n.0),
        };
        (speed - target).abs() <= tolerance.max(SPINDLE_AT_SPEED)
    }

    /// What the spindle is to do: what is programmed, by its override.
    pub(super) fn spindle_order(&self) -> SpindleCommand {
        let share = if self.is_threading() {
            1.0
        } else {
            self.overrides.spindle_fraction()
        };
        let scaled = |n: Rpm| Rpm((n.0 * share).min(self.parameters.spindle.highest.0));
        match self.spindle {
            SpindleCommand::Stop => SpindleCommand::Stop,
            SpindleCommand::Clockwise(n) => SpindleCommand::Clockwise(scaled(n)),
            SpindleCommand::Counterclockwise(n) => SpindleCommand::Counterclockwise(scaled(n)),
        }
    }

    /// True on a thread, and at rest before one: the spindle override does not act.
    pub(super) fn is_threading(&self) -> bool {
        let next_is_locked = self.next_set_point().is_some_and(SetPoint::is_locked);
        self.thread.turn.is_some() || next_is_locked || (self.here.is_locked() && !is_rest(&self.here))
    }

    /// A spindle command within what the spindle can do; a faster one is counted.
    pub(super) fn limited(&mut self, spindle: SpindleCommand) -> SpindleCommand {
        let highest = self.parameters.spindle.highest;
        let mut limit = |n: Rpm| {
            self.counters.spindle_limited += u64::from(n > highest);
            Rpm(within(n.0, 0.0, highest.0))
        };
        match spindle {
            SpindleCommand::Stop => SpindleCommand::Stop,
            SpindleCommand::Clockwise(n) => SpindleCommand::Clockwise(limit(n)),
            SpindleCommand::Counterclockwise(n) => SpindleCommand::Counterclockwise(limit(n)),
        }
    }
}

//! Beginning where the machine stands: finding that place on the plan, and what leads from there onto the plan's own set-points.

use super::*;

impl LinkSender {
    /// Begins where the machine stands, when it may.
    pub(super) fn begin(&mut self, now: Tick, out: &mut Vec<u8>) {
        if self.streaming {
            // It did not take it: it was not at rest after all.
            if self.status.epoch != self.stretch.epoch && now.0.saturating_sub(self.began_at.0) > SILENCE {
                self.streaming = false;
            }
            return;
        }
        if self.stock.is_over() {
            // There is nothing to go on with: spindle and coolant of a program that is over are not brought about again.
            self.start_asked = false;
            return;
        }
        let Some(report) = self.last.filter(|_| self.start_asked || self.first_begin) else {
            return;
        };
        let ready = report.state == State::Ready;
        let stands = matches!(report.state, State::Held | State::Paused | State::Stopped(StopCause::Starved));
        let known = self.stock.count_done() > 0;
        if !self.loads.all_decided() {
            return;
        }
        if !(ready || (stands && known)) || self.is_filling(now) {
            return;
        }
        let Some((entries, next)) = self.way_on(&report) else {
            return;
        };
        let done = self.stock.count_done();
        self.stretch = Stretch {
            epoch: self.stretch.epoch.wrapping_add(1),
            entries: entries.into(),
            first: 0,
            cycle: 0,
            sent: 0,
            next,
            rested: true,
        };
        self.counts.resumed += u64::from(!self.first_begin);
        self.start_when_taken = !ready;
        (self.streaming, self.first_begin, self.start_asked, self.began_at) = (true, false, false, now);
        let epoch = self.stretch.epoch;
        self.say(now, Urgent::Resume { epoch, done }, out);
    }

    /// True while more of the plan is to be expected that is needed to begin.
    pub(super) fn is_filling(&self, now: Tick) -> bool {
        let done = self.stock.count_done();
        let enough = self.stock.end() > done + SEARCHED;
        let dry = now.0.saturating_sub(self.pushed_at.0) >= DRY;
        done > 0 && !enough && !(dry && self.stock.end() > done)
    }

    /// What leads from where the machine stands onto the plan, and the command of the plan that follows.
    pub(super) fn way_on(&mut self, report: &Report) -> Option<(Vec<Posed>, u64)> {
        let done = self.stock.count_done();
        let position = report.sample.commanded;
        let scaler = Scaler::new(&self.stock, &self.parameters);
        let base = self.stock.last_done_cycle();
        // No motion is known of, but there may have been some: sender and controller may both have died in the first one.
        let unknown = || scaler.first_place(SEARCHED, position, ON_PATH, done);
        let place = match base {
            Some(base) => Some(scaler.nearest(base, SEARCHED, position)?),
            None => unknown().filter(|_| !self.first_begin),
        };
        let Some((mut phase, distance)) = place else {
            // What is done is switching, and it is done again only on a machine that knows nothing of it.
            let entries = self.ready_again(done, report).into_iter().filter(|_| done > 0).collect();
            return Some((entries, done + 1));
        };
        if distance > ON_PATH {
            if distance > self.allowed_approach {
                self.displaced = Some(distance);
                return None;
            }
            // Back to where the plan was left, or begins.
            phase = base.unwrap_or(0) as f64;
        }
        let lead = scaler.lead(phase, position, done);
        if lead.end != RampEnd::Done {
            return None;
        }
        self.counts.approaches += u64::from(distance > ON_PATH);
        self.displaced = None;
        let passed = self
            .stock
            .set_point(libm::floor(phase) as u64)
            .map_or(done, |(_, number)| number.max(done));
        let mut entries = self.passed_orders(done, passed);
        // Nothing is in force before the first command.
        if passed > 0 {
            entries.extend(self.ready_again(passed, report));
        }
        let next = lead.entries.last().map_or(passed, |e| e.entry.done) + 1;
        entries.extend(lead.entries);
        Some((entries, next))
    }

    /// Brings about what is in force where so many commands are done.
    pub(super) fn ready_again(&self, done: u64, report: &Report) -> Vec<Posed> {
        let in_force = self.stock.in_force(done);
        let mut commands = in_force.commands(report.sample.tool);
        // On a machine that was reset or started again conditions of its program are over. It may be reset as late as now.
        commands.extend(in_force.watch_commands(&self.fired, &self.ended));
        commands.into_iter().map(|command| standing(command, done)).collect()
    }

    /// Orders for watches between what is done and where the machine stands: drives that stopped by themselves went past them.
    pub(super) fn passed_orders(&self, done: u64, passed: u64) -> Vec<Posed> {
        let between = (done + 1..=passed).filter_map(|number| Some((number, *self.stock.command(number)?)));
        between
            .filter(|(_, command)| matches!(command, Command::Watch { .. }))
            .map(|(number, command)| standing(command, number))
            .collect()
    }
}

/// An entry of a machine that stands.
fn standing(command: Command, done: u64) -> Posed {
    Posed {
        entry: Entry { command, done },
        pose: Pose { phase: 0.0, rate: 0.0 },
    }
}

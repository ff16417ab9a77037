//! Blocks: as much of the plan as the machine has room for, each with its stop tail.

use super::*;

/// What is being sent since the machine stood last.
#[derive(Clone, Debug, Default)]
pub(super) struct Stretch {
    pub(super) epoch: u32,
    /// Not yet executed, from entry `first` on; those of the plan are put here when they are needed.
    pub(super) entries: VecDeque<Posed>,
    pub(super) first: u64,
    /// Set-points before the first of them.
    pub(super) cycle: u64,
    /// Entries sent.
    pub(super) sent: u64,
    /// The command of the plan that follows the last entry.
    pub(super) next: u64,
    /// The last set-point before the first entry was a rest.
    pub(super) rested: bool,
}

impl LinkSender {
    pub(super) fn tell_blocks(&mut self, now: Tick, out: &mut Vec<u8>) {
        while self.streaming {
            let executed = if self.status.epoch == self.stretch.epoch {
                self.status.executed
            } else {
                0
            };
            let credit = (executed + LOOK_AHEAD).saturating_sub(self.stretch.sent);
            let from = (self.stretch.sent - self.stretch.first) as usize;
            let most = from + (credit as usize).min(BLOCK);
            self.stretch.provide(&self.stock, most);
            let mut end = most.min(self.stretch.entries.len());
            let dry = now.0.saturating_sub(self.pushed_at.0) >= DRY;
            let mut tail = self.tail_after(end);
            if tail.is_none() && !dry {
                // As far as it comes to rest by itself.
                end = (from + 1..end)
                    .rev()
                    .find(|&end| !self.stretch.moves_before(end))
                    .unwrap_or(from);
                tail = Some(Vec::new());
            }
            let tail = tail.unwrap_or_default();
            let rests = !self.stretch.moves_before(end);
            if end == from || (end - from < WORTH_SENDING && !rests && !(dry && self.stretch.next >= self.stock.end())) {
                return;
            }
            self.tell_block(now, from, end, &tail, out);
        }
    }

    pub(super) fn tell_block(&mut self, now: Tick, from: usize, end: usize, tail: &[Entry], out: &mut Vec<u8>) {
        let s = &self.stretch;
        let set_points = s.entries.range(..from).filter(|e| is_set_point(e)).count() as u64;
        let head = BlockHead {
            epoch: s.epoch,
            first: s.sent,
            cycle: s.cycle + set_points,
            body: (end - from) as u16,
            tail: tail.len() as u16,
        };
        let body = s.entries.range(from..end);
        self.wired.send(now, Kind::Block, out, |to| {
            head.write(to);
            body.for_each(|posed| posed.entry.write(to));
            tail.iter().for_each(|entry| entry.write(to));
        });
        self.stretch.sent += (end - from) as u64;
        self.counts.blocks += 1;
    }

    /// The stop tail behind the first `end` entries; `None`: the plan is not known far enough. Empty where they end at rest.
    pub(super) fn tail_after(&mut self, end: usize) -> Option<Vec<Entry>> {
        let mut tail = Vec::new();
        if !self.stretch.moves_before(end) {
            return Some(tail);
        }
        for index in end.. {
            self.stretch.provide(&self.stock, index + 1);
            let posed = *self.stretch.entries.get(index)?;
            if needs_rest(&posed.entry.command) {
                // The controller brings what is left of the speed to rest itself: it is less than an axis can take away in a cycle.
                return Some(Vec::new());
            }
            tail.push(posed.entry);
            if let Command::SetPoint(set_point) = posed.entry.command {
                if set_point.velocity == [0.0; 3] {
                    return Some(tail);
                }
                let ramp = Scaler::new(&self.stock, &self.parameters).tail(posed.pose, posed.entry.done);
                if ramp.end == RampEnd::NoPlan {
                    return None;
                }
                tail.extend(ramp.entries.iter().map(|posed| posed.entry));
                tail.truncate(TAIL);
                return Some(tail);
            }
        }
        None
    }
}

impl Stretch {
    /// Has so many entries, as far as the plan is known.
    pub(super) fn provide(&mut self, stock: &Stock, count: usize) {
        while self.entries.len() < count {
            let Some(command) = stock.command(self.next) else { return };
            let phase = match self.entries.back() {
                _ if is(command) => stock.cycle_of(self.next) as f64,
                Some(before) => before.pose.phase,
                None => 0.0,
            };
            self.entries.push_back(Posed {
                entry: Entry {
                    command: *command,
                    done: self.next,
                },
                pose: Pose { phase, rate: 1.0 },
            });
            self.next += 1;
        }
    }

    /// True when the path is in motion behind the first `end` entries.
    pub(super) fn moves_before(&self, end: usize) -> bool {
        for posed in self.entries.range(..end).rev() {
            match posed.entry.command {
                Command::SetPoint(s) => return s.velocity != [0.0; 3],
                command if needs_rest(&command) => return false,
                _ => {}
            }
        }
        !self.rested
    }
}

fn is(command: &Command) -> bool {
    matches!(command, Command::SetPoint(_))
}

fn is_set_point(posed: &Posed) -> bool {
    is(&posed.entry.command)
}

//! Taking commands out of the queue again before anything of them is begun: for the link, whose stop tails give way to what comes after
//! them, and which begins anew where the machine stands.

use super::Controller;
use crate::Command;

impl Controller {
    /// Takes back the last `count` commands of the queue. False, and nothing is changed, when some of them are not in it any more.
    pub fn withdraw(&mut self, count: usize) -> bool {
        if self.queue.len() < count {
            return false;
        }
        for _ in 0..count {
            self.queue.pop_back();
        }
        self.counters.accepted -= count as u64;
        if self.barrier.is_some_and(|(index, _)| index >= self.queue.len()) {
            self.barrier = None;
        }
        if count > 0 {
            let last = (0..self.queue.len()).rev().find_map(|index| match self.queue.get(index) {
                Some(Command::SetPoint(set_point)) => Some(*set_point),
                _ => None,
            });
            self.tail = last.unwrap_or(self.here);
        }
        true
    }

    /// Empties the queue, as a reset does, and leaves the state as it is: what comes next begins where the axes are commanded to stand.
    /// False, and nothing is changed, while they move or something is in work.
    pub fn forget_queue(&mut self) -> bool {
        let can = self.stands() && self.in_work.is_none() && !self.synchronise;
        if can {
            self.forget_program();
        }
        can
    }
}

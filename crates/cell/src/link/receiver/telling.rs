//! What is told: the status, and reports with what fired in their cycles, kept until they are acknowledged.

use super::*;

/// What is told.
impl LinkReceiver {
    pub(super) fn told_status(&self) -> Status {
        Status {
            reports: self.next_report,
            lost_reports: self.lost_reports,
            firings: self.next_firing,
            lost_firings: self.status.lost_firings + self.lost_firings,
            ..self.status
        }
    }

    pub(super) fn tell_reports(&mut self, now: Tick, side: &mut Side, out: &mut Vec<u8>) {
        loop {
            let from = (self.next_report - self.first_report) as usize;
            let waiting = self.reports.len().saturating_sub(from);
            if waiting < self.card.batch.max(1) {
                return;
            }
            let mut count = waiting.min(REPORTS_IN_A_FRAME);
            let mut firings = self.firings_up_to(from + count);
            while count > 1 && firings > FIRINGS_IN_A_FRAME {
                count -= 1;
                firings = self.firings_up_to(from + count);
            }
            // After a gap there may be more for one report: the rest goes with the next.
            let firings = firings.min(FIRINGS_IN_A_FRAME);
            let head = ReportsHead {
                status: self.told_status(),
                first: self.next_report,
                count: count as u16,
                first_firing: self.next_firing,
                firings: firings as u16,
            };
            let fired = (self.next_firing - self.first_firing) as usize;
            side.wired.send(now, Kind::Reports, out, |to| {
                head.write(to);
                self.reports.range(from..from + count).for_each(|report| report.write(to));
                self.firings.range(fired..fired + firings).for_each(|firing| firing.write(to));
            });
            self.next_report += count as u64;
            self.next_firing += firings as u64;
        }
    }

    /// Firings to be sent that belong to cycles before the report at `end` among those that are kept.
    pub(super) fn firings_up_to(&self, end: usize) -> usize {
        let Some(last) = self.reports.get(end.wrapping_sub(1)) else {
            return 0;
        };
        let sent = (self.next_firing - self.first_firing) as usize;
        let due = self.firings.partition_point(|firing| firing.tick <= last.sample.tick);
        due.saturating_sub(sent)
    }

    /// The sender has the firings below this number.
    pub(super) fn forget_firings(&mut self, below: u64) {
        let has = below.min(self.first_firing + self.firings.len() as u64);
        while self.first_firing < has {
            self.firings.pop_front();
            self.first_firing += 1;
        }
        self.next_firing = self.next_firing.max(self.first_firing);
    }

    /// The sender has the reports below this number.
    pub(super) fn forget_reports(&mut self, below: u64) {
        let has = below.min(self.first_report + self.reports.len() as u64);
        while self.first_report < has {
            self.reports.pop_front();
            self.first_report += 1;
        }
        self.next_report = self.next_report.max(self.first_report);
    }
}

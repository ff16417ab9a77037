//! What comes from the machine: that it is there, its reports and how far it is.

use super::*;

/// What comes from the machine.
impl LinkSender {
    pub(super) fn frame(&mut self, came: &Came) -> Result<(), LinkError> {
        match (self.line, came.header.kind) {
            (Line::Greeting, Kind::Welcome) => self.welcomed(came.message()?),
            (Line::Greeting, Kind::Refusal) => Err(LinkError::Refused(came.message()?)),
            (Line::Greeting, _) => Err(LinkError::Rules("a controller answers a hello first")),
            (Line::Linked, Kind::Heartbeat) => self.hear(came.message()?),
            (Line::Linked, Kind::Reports) => self.hear_reports(came),
            (Line::Linked, _) => Err(LinkError::Rules("only a sender sends such a frame")),
            (Line::Apart, _) => Ok(()),
        }
    }

    pub(super) fn welcomed(&mut self, welcome: Welcome) -> Result<(), LinkError> {
        if welcome.limits != LimitsHash::of(&self.parameters) {
            return Err(LinkError::Limits {
                machine: welcome.machine.text().to_owned(),
                found: welcome.limits,
            });
        }
        self.line = Line::Linked;
        if self.session != 0 && !welcome.continues {
            self.begun_anew += 1;
            self.lost_before = (self.lost_reports(), self.lost_firings());
        }
        self.session = welcome.session;
        self.wired.session = welcome.session;
        self.welcome = Some(welcome);
        let status = welcome.status;
        let same_plan = welcome.plan == self.plan;
        self.loads.connected(welcome.continues);
        if welcome.continues {
            if status.needs_resume || welcome.epoch != self.stretch.epoch || !self.streaming {
                self.streaming = false;
            } else {
                self.stretch.sent = welcome.wanted.clamp(self.stretch.first, self.stretch.sent);
            }
        } else {
            self.streaming = false;
            (self.next_report, self.next_firing) = (status.reports, status.firings);
            if let Some(done) = status.done.filter(|_| same_plan) {
                self.stock.done(done);
            }
            self.first_begin &= self.stock.count_done() == 0;
        }
        // The next stretch must not be taken for an older one.
        if !self.streaming {
            self.stretch.epoch = self.stretch.epoch.max(welcome.epoch).max(status.epoch);
        }
        self.status = Status {
            epoch: u32::MAX,
            ..status
        };
        Ok(())
    }

    pub(super) fn hear_reports(&mut self, came: &Came) -> Result<(), LinkError> {
        let mut reader = Reader::new(&came.payload);
        let wrong = |error| came.wrong(error);
        let head = ReportsHead::read(&mut reader).map_err(wrong)?;
        for number in (head.first..).take(usize::from(head.count)) {
            let report = Report::read(&mut reader).map_err(wrong)?;
            if number >= self.next_report {
                self.next_report = number + 1;
                self.last = Some(report);
                self.reports.push_back(report);
            }
        }
        for number in (head.first_firing..).take(usize::from(head.firings)) {
            let firing = Firing::read(&mut reader).map_err(wrong)?;
            if number >= self.next_firing {
                self.next_firing = number + 1;
                match firing.kind {
                    FiringKind::Fired => {
                        self.fired.insert(firing.watch);
                        // The program has started it once more.
                        self.ended.remove(&firing.watch);
                    }
                    FiringKind::Ended => {
                        let done = head.status.done.unwrap_or(self.stock.count_done());
                        self.ended.insert(firing.watch, done);
                    }
                    FiringKind::Unknown => {}
                }
                self.firings.push_back(firing);
            }
        }
        reader.end().map_err(wrong)?;
        self.hear(head.status)
    }

    pub(super) fn hear(&mut self, status: Status) -> Result<(), LinkError> {
        self.status = status;
        if status.session != self.session {
            return Ok(());
        }
        self.loads.hear(&status.loads)?;
        if let Some(done) = status.done {
            self.stock.done(done);
        }
        if status.epoch != self.stretch.epoch || !self.streaming {
            return Ok(());
        }
        while self.stretch.first < status.executed.min(self.stretch.sent) {
            if let Some(Posed { entry, .. }) = self.stretch.entries.pop_front()
                && let Command::SetPoint(set_point) = entry.command
            {
                self.stretch.cycle += 1;
                self.stretch.rested = set_point.velocity == [0.0; 3];
            }
            self.stretch.first += 1;
        }
        if status.needs_resume {
            self.streaming = false;
            self.start_when_taken = false;
        }
        Ok(())
    }
}

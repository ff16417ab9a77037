//! What came: who may drive the machine, blocks, loads and what does not wait.

use super::*;

/// What came.
impl LinkReceiver {
    pub(super) fn frame(&mut self, connection: Connection, now: Tick, side: &mut Side, came: &Came) -> Result<(), LinkError> {
        if side.asked {
            return Err(LinkError::Rules("who asks says nothing else on a connection"));
        }
        if !side.greeted {
            return match came.header.kind {
                Kind::Hello => self.hello(connection, now, side, &came.message()?),
                Kind::Inquiry => {
                    self.inquire(connection, side, came.message()?);
                    Ok(())
                }
                _ => Err(LinkError::Rules("a connection begins with a hello")),
            };
        }
        if came.header.session != side.wired.session {
            return Err(LinkError::Rules("a frame of another session"));
        }
        match came.header.kind {
            Kind::Block => self.block(came),
            Kind::Urgent => {
                let urgent = came.message()?;
                if let Urgent::Resume { epoch, .. } = urgent {
                    (self.epoch, self.wanted, self.cycle) = (epoch, 0, 0);
                    self.orders.clear();
                }
                self.urgent.push_back(UrgentOrder::Urgent(urgent));
                Ok(())
            }
            Kind::Load => self.load(came),
            Kind::Heartbeat => {
                let SenderHeartbeat { reports, firings } = came.message()?;
                self.forget_reports(reports);
                self.forget_firings(firings);
                Ok(())
            }
            Kind::Goodbye => {
                side.closing = true;
                if let Some(lease) = self.lease.take() {
                    self.urgent.push_back(UrgentOrder::LinkLost);
                    self.notices.push_back(Notice::Done {
                        name: lease.name.text().to_owned(),
                    });
                }
                Ok(())
            }
            Kind::Hello => Err(LinkError::Rules("a second hello on one connection")),
            Kind::Inquiry => Err(LinkError::Rules("who drives does not ask on the same connection")),
            Kind::Welcome | Kind::Refusal | Kind::Reports | Kind::Answer => {
                Err(LinkError::Rules("only a controller sends such a frame"))
            }
        }
    }

    pub(super) fn hello(&mut self, connection: Connection, now: Tick, side: &mut Side, hello: &Hello) -> Result<(), LinkError> {
        if let Some(why) = self.objection(now, hello) {
            side.wired.send(now, Kind::Refusal, &mut side.out, |to| why.write(to));
            side.closing = true;
            self.notices.push_back(Notice::Refused {
                name: hello.name.text().to_owned(),
                why,
            });
            return Ok(());
        }
        let before = self.lease.take();
        if let Some(old) = before.as_ref().and_then(|l| l.connection)
            && let Some(side) = self.sides.get_mut(&old)
        {
            side.closing = true;
        }
        let continues = before
            .as_ref()
            .is_some_and(|l| l.session == hello.session && hello.session != 0);
        let plan_before = before.as_ref().map_or(PlanId::default(), |l| l.plan);
        if continues {
            self.urgent.push_back(UrgentOrder::LinkBack);
            // It says what it has; the rest is sent again.
            self.forget_reports(hello.reports);
            self.forget_firings(hello.firings);
        } else {
            self.sessions += 1;
            self.urgent.push_back(UrgentOrder::NewSession {
                session: self.sessions,
                same_plan: plan_before == hello.plan,
            });
            if plan_before != hello.plan {
                self.register.new_plan(&mut self.urgent);
            }
            self.orders.clear();
            // What was reported to the one before and not taken by it is lost to the record: of its own plan it shall hear so.
            let untaken = self.reports.len() as u64;
            let unheard = self.firings.len() as u64;
            self.forget_reports(u64::MAX);
            self.forget_firings(u64::MAX);
            self.lost_reports = if plan_before == hello.plan { untaken } else { 0 };
            self.lost_firings = if plan_before == hello.plan { unheard } else { 0 };
        }
        (self.next_report, self.next_firing) = (self.first_report, self.first_firing);
        let session = if continues { hello.session } else { self.sessions };
        self.lease = Some(Lease {
            name: hello.name,
            plan: hello.plan,
            session,
            connection: Some(connection),
            heard: now,
            lost: false,
        });
        side.greeted = true;
        side.wired.session = session;
        let mut status = self.told_status();
        status.needs_resume |= !continues;
        let welcome = Welcome {
            machine: Name::new(&self.card.name),
            quality: self.card.quality,
            limits: self.card.limits,
            session,
            plan: plan_before,
            continues,
            epoch: self.epoch,
            wanted: self.wanted,
            status,
        };
        side.wired.send(now, Kind::Welcome, &mut side.out, |to| welcome.write(to));
        self.notices.push_back(Notice::Taken {
            name: hello.name.text().to_owned(),
            continues,
        });
        Ok(())
    }

    /// Why a sender is not taken.
    pub(super) fn objection(&self, now: Tick, hello: &Hello) -> Option<Refusal> {
        if hello.units != UNITS || hello.axes != AXES {
            return Some(Refusal::Units);
        }
        if hello.limits != self.card.limits {
            return Some(Refusal::Limits {
                machine: Name::new(&self.card.name),
                limits: self.card.limits,
            });
        }
        let lease = self.lease.as_ref()?;
        let side = lease.connection.and_then(|c| self.sides.get(&c));
        let heard = side.map_or(lease.heard, |s| s.wired.heard);
        let silent_for = now.0.saturating_sub(heard.0);
        let gone = side.is_none_or(|s| s.closing) || silent_for > SILENCE;
        let itself = hello.session != 0 && hello.session == lease.session;
        // A sender that was started again has the same name and plan, and no session.
        let again = hello.name == lease.name && hello.plan == lease.plan;
        let free = gone && (itself || again || (silent_for > LEASE && self.standing));
        let holder = lease.name;
        (!free).then_some(if gone {
            Refusal::Left { holder }
        } else {
            Refusal::Busy { holder }
        })
    }

    /// A condition or a tool: in parts to the realtime thread, past the set-points, which do not wait for it.
    pub(super) fn load(&mut self, came: &Came) -> Result<(), LinkError> {
        let mut reader = Reader::new(&came.payload);
        let wrong = |error| came.wrong(error);
        let LoadHead { number, what } = LoadHead::read(&mut reader).map_err(wrong)?;
        let mut parts = Vec::new();
        match what {
            LoadWhat::Tool { tool, diameter } => parts.push(LoadPart::Tool { number, tool, diameter }),
            LoadWhat::Watch {
                frequency,
                all_modes,
                operations,
                alarms,
            } => {
                if usize::from(operations) > LONGEST || usize::from(alarms) > ALARMS_OF_A_WATCH {
                    return Err(LinkError::Rules("a condition is longer than conditions are"));
                }
                let mut rest = Vec::new();
                for _ in 0..operations {
                    rest.push(LoadPart::Operation(Wire::read(&mut reader).map_err(wrong)?));
                }
                for _ in 0..alarms {
                    rest.push(LoadPart::Alarm(Wire::read(&mut reader).map_err(wrong)?));
                }
                let line = words::read(&mut reader).map_err(wrong)?;
                reader.end().map_err(wrong)?;
                let by = self.lease.as_ref().map_or(Name::new(""), |lease| lease.name);
                let mark = self.register.loads(number, all_modes, line, by);
                parts.push(LoadPart::Watch {
                    frequency,
                    all_modes,
                    mark,
                });
                parts.append(&mut rest);
                parts.push(LoadPart::Whole { number });
            }
        }
        reader.end().map_err(wrong)?;
        self.urgent.extend(parts.into_iter().map(UrgentOrder::Load));
        Ok(())
    }

    pub(super) fn block(&mut self, came: &Came) -> Result<(), LinkError> {
        let mut reader = Reader::new(&came.payload);
        let wrong = |error| came.wrong(error);
        let head = BlockHead::read(&mut reader).map_err(wrong)?;
        if usize::from(head.body) > BLOCK || usize::from(head.tail) > TAIL {
            return Err(LinkError::Rules("a block is longer than blocks are"));
        }
        // All of it is read before any of it is used.
        let mut entries = Vec::with_capacity(usize::from(head.body) + usize::from(head.tail));
        for _ in 0..head.body + head.tail {
            entries.push(Entry::read(&mut reader).map_err(wrong)?);
        }
        reader.end().map_err(wrong)?;
        if head.epoch != self.epoch {
            // On its way when the sender began anew.
            return Ok(());
        }
        if head.first != self.wanted || head.cycle != self.cycle {
            return Err(LinkError::Rules("a block does not follow the one before"));
        }
        // A tail that has not been handed over yet has given way already.
        while matches!(self.orders.back(), Some(Order::Tail { .. })) {
            self.orders.pop_back();
        }
        let epoch = head.epoch;
        let (body, tail) = entries.split_at(usize::from(head.body));
        self.orders.push_back(Order::Block {
            epoch,
            first: head.first,
        });
        self.orders.extend(body.iter().map(|&entry| Order::Body { epoch, entry }));
        self.orders.extend(tail.iter().map(|&entry| Order::Tail { epoch, entry }));
        self.wanted += body.len() as u64;
        self.cycle += body.iter().filter(|e| matches!(e.command, Command::SetPoint(_))).count() as u64;
        self.counts.blocks += 1;
        Ok(())
    }
}

//! Each observation once, in order, or a gap: what an answer says is held against how far the recording is.

use super::{AHEAD, After, Ask, Client, Ending, Event, Position};
use crate::client::document::Told;
use crate::client::gap::{Gap, GapCause};
use crate::streams::Header;
use plan::Diagnostic;
use units::Timestamp;

impl Client {
    /// Where the agent's buffer begins and ends: where to begin, and what is lost.
    pub(super) fn learned(&mut self, header: Header) -> After {
        let first = header.first_sequence.max(1);
        let next = if header.next_sequence > 0 {
            header.next_sequence
        } else {
            u64::MAX
        };
        self.buffer_size = header.buffer_size;
        self.counters.agent_last = header.last_sequence;
        let begins_anew = |p: &Position| p.instance != header.instance || p.next > next;
        let begin = match self.position {
            None => {
                let from = self.query.from.map_or(first, |from| from.max(1));
                if from > next {
                    let message = format!("the agent is at sequence {next}: {from} does not exist yet; give --from up to {next}");
                    return After::Stop(Ending::Refused(message));
                }
                Position {
                    instance: header.instance,
                    next: from,
                    last: None,
                }
            }
            Some(position) if begins_anew(&position) => {
                self.open_gap(Gap {
                    instance: position.instance,
                    from_sequence: position.next,
                    to_sequence: None,
                    cause: GapCause::AgentRestart,
                    from: position.last,
                    to: None,
                });
                self.newest.clear();
                Position {
                    instance: header.instance,
                    next: 1,
                    ..position
                }
            }
            Some(position) => position,
        };
        self.position = Some(begin);
        // A small buffer that fills quickly has moved on again whenever its beginning is asked for: behind two such chases each further
        // one begins an eighth of the buffer later, at the newest number at last.
        let has_moved = begin.next < first;
        self.chases = if has_moved { self.chases + 1 } else { 0 };
        let later = (next.saturating_sub(first)).saturating_mul(u64::from(self.chases.saturating_sub(2).min(8))) / 8;
        let from = if next == u64::MAX { first } else { first + later };
        self.lost_before(from);
        self.ask = Ask::Sample;
        self.events.push_back(Event::Agent(header));
        After::Ask
    }

    /// A chase may have skipped what the agent still has, when it went quiet meanwhile: that is asked for after all.
    fn skipped(&mut self, header: &Header) -> Option<u64> {
        let position = self.position?;
        let gap = self.open_gaps.last_mut()?;
        let is_before = gap.instance == position.instance && gap.to_sequence?.checked_add(1)? == position.next;
        let from = header.first_sequence.max(1).max(gap.from_sequence);
        if !is_before || gap.cause == GapCause::Unreadable || from >= position.next {
            return None;
        }
        gap.to_sequence = Some(from - 1);
        if from == gap.from_sequence {
            self.open_gaps.pop();
        }
        Some(from)
    }

    pub(super) fn looks_back(&mut self, header: &Header) -> bool {
        if self.looked_back {
            return false;
        }
        let Some(from) = self.skipped(header) else { return false };
        self.looked_back = true;
        self.position = self.position.map(|p| Position { next: from, ..p });
        self.chases = 0;
        true
    }

    /// The agent has nothing before `first` any more, or will not when it is asked.
    fn lost_before(&mut self, first: u64) {
        let Some(position) = self.position.filter(|p| p.next < first) else {
            return;
        };
        self.open_gap(Gap {
            instance: position.instance,
            from_sequence: position.next,
            to_sequence: Some(first - 1),
            cause: self.blame.unwrap_or(GapCause::Overrun),
            from: position.last,
            to: None,
        });
        self.position = Some(Position { next: first, ..position });
    }

    pub(super) fn open_gap(&mut self, gap: Gap) {
        // The buffer moves on while we ask where it begins: that is one gap.
        if let Some(before) = self.open_gaps.last_mut()
            && before.instance == gap.instance
            && before.cause == gap.cause
            && before
                .to_sequence
                .is_some_and(|to| to.checked_add(1) == Some(gap.from_sequence))
        {
            before.to_sequence = gap.to_sequence;
            return;
        }
        self.open_gaps.push(gap);
    }

    pub(super) fn observed(&mut self, header: &Header, mut told: Vec<Told>) {
        // Documents group observations by component: the numbers give the order.
        told.sort_by_key(|t| t.sequence);
        let first_told = told.first().map_or(u64::MAX, |t| t.sequence);
        self.lost_before(header.first_sequence.min(first_told));
        let Some(position) = self.position else { return };
        let before = told.len();
        told.dedup_by_key(|t| t.sequence);
        told.retain(|t| t.sequence >= position.next);
        self.counters.doubles += (before - told.len()) as u64;
        self.counters.observations += told.len() as u64;
        self.counters.heartbeats += u64::from(before == 0);
        self.counters.agent_last = header.last_sequence.max(told.last().map_or(0, |t| t.sequence));
        self.failures = 0;
        self.broken = (0, 0);
        self.look_at_times(header, &told);
        if let Some(first) = told.first() {
            (self.chases, self.looked_back) = (0, false);
            for mut gap in self.open_gaps.drain(..) {
                gap.to = Some(first.at);
                self.events.push_back(Event::Gap(gap));
            }
            self.blame = None;
        }
        let next = told.last().map_or(0, |t| t.sequence.saturating_add(1));
        self.position = Some(Position {
            next: position.next.max(header.next_sequence).max(next),
            last: told.last().map(|t| t.at).or(position.last),
            ..position
        });
        if !told.is_empty() {
            self.events.push_back(Event::Observations(told));
        }
    }

    /// Clocks are set, and run ahead: such times are kept as they are, and said.
    fn look_at_times(&mut self, header: &Header, told: &[Told]) {
        self.newest
            .resize(self.items.all().len().max(self.newest.len()), Timestamp(i64::MIN));
        for t in told {
            let newest = &mut self.newest[t.item as usize];
            if t.at < *newest {
                let message = format!(
                    "sequence {} of {} is {:.3} s older than the one before it: a clock was set back; its time is kept as it is",
                    t.sequence,
                    self.items.get(t.item).id,
                    newest.since(t.at).0
                );
                self.diagnostics
                    .add(Diagnostic::warning("time-backwards", message).in_file(self.query.authority()));
            }
            *newest = t.at;
            if header.created.is_some_and(|created| t.at.0.saturating_sub(created.0) > AHEAD) {
                let message = format!(
                    "sequence {} of {} is from after its document was made: a clock is ahead; its time is kept as it is",
                    t.sequence,
                    self.items.get(t.item).id,
                );
                self.diagnostics
                    .add(Diagnostic::warning("time-ahead", message).in_file(self.query.authority()));
            }
        }
    }
}

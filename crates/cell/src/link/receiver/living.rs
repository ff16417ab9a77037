//! What lives in the machine, for those who ask and do not drive: the words of what was loaded are kept here, the numbers come from the
//! realtime thread.

use super::*;
use crate::link::words;
use machine::link::asking::{AnswerEntry, AnswerHead, Asked, ENDS_UNDER_WAY, Inquiry, Lives};
use machine::link::loading::MOST_LOADS;
use machine::watch::Living;
use std::collections::BTreeSet;

/// Of one frame of an answer; each with its words is below 1.1 kB.
const ENTRIES_IN_A_FRAME: usize = 32;

/// The words of what was loaded, and who asks for them.
///
/// Bounded: it holds what the present plan has loaded, and what of plans before was still running when the present one began.
#[derive(Clone, Debug, Default)]
pub(super) struct Register {
    known: BTreeMap<u32, Known>,
    /// Marks of the present plan, by the number of their load: what comes again after a cut is the same.
    of_plan: BTreeMap<u32, u32>,
    last_mark: u32,
    /// How many plans there were.
    plans: u64,
    list: Option<List>,
    /// Those who came when a list was in the making already.
    next: Vec<Connection>,
    /// What the realtime thread is ending, and what waits for that.
    ending: VecDeque<End>,
    ends: VecDeque<End>,
    /// The machine's cycle.
    pub(super) now: Tick,
}

#[derive(Clone, Debug)]
struct Known {
    line: String,
    by: Name,
    all_modes: bool,
}

/// A list that the realtime thread is making.
#[derive(Clone, Debug)]
struct List {
    /// For whom.
    asked: Vec<Connection>,
    found: Vec<Living>,
    /// Plans there were when it was asked for.
    plans: u64,
}

#[derive(Clone, Copy, Debug)]
struct End {
    asked: Connection,
    by: Name,
    mark: u32,
}

impl Register {
    /// Another plan: of those before only what may be running is kept, and what is running is found out.
    pub(super) fn new_plan(&mut self, urgent: &mut VecDeque<UrgentOrder>) {
        self.of_plan.clear();
        self.known.retain(|_, known| known.all_modes);
        self.plans += 1;
        self.begin_list(urgent);
    }

    /// The mark of a load of the present plan; its words are kept. 0 where the machine will refuse it, because there are too many.
    pub(super) fn loads(&mut self, number: u32, all_modes: bool, line: String, by: Name) -> u32 {
        if number as usize >= MOST_LOADS {
            return 0;
        }
        let next = self.last_mark + 1;
        let mark = *self.of_plan.entry(number).or_insert(next);
        self.last_mark = self.last_mark.max(mark);
        self.known.insert(mark, Known { line, by, all_modes });
        mark
    }

    fn begin_list(&mut self, urgent: &mut VecDeque<UrgentOrder>) {
        if self.list.is_none() {
            urgent.push_back(UrgentOrder::Living);
            self.list = Some(List {
                asked: std::mem::take(&mut self.next),
                found: Vec::new(),
                plans: self.plans,
            });
        }
    }

    fn begin_ends(&mut self, urgent: &mut VecDeque<UrgentOrder>) {
        while self.ending.len() < ENDS_UNDER_WAY
            && let Some(end) = self.ends.pop_front()
        {
            urgent.push_back(UrgentOrder::End { mark: end.mark });
            self.ending.push_back(end);
        }
    }

    fn entry(&self, living: Living) -> (AnswerEntry, &str) {
        let known = self.known.get(&living.mark);
        let by = known.map_or(Name::new(""), |known| known.by);
        (AnswerEntry { living, by }, known.map_or("", |known| known.line.as_str()))
    }

    /// Lets go of the words of what does not run any more.
    fn forget(&mut self, list: &List) {
        // One that was asked for before the present plan may not know of what started between.
        if list.plans == self.plans {
            let found: BTreeSet<u32> = list.found.iter().map(|living| living.mark).collect();
            let own: BTreeSet<u32> = self.of_plan.values().copied().collect();
            self.known.retain(|mark, _| found.contains(mark) || own.contains(mark));
        }
    }
}

/// Those who ask.
impl LinkReceiver {
    pub(super) fn inquire(&mut self, connection: Connection, side: &mut Side, inquiry: Inquiry) {
        side.asked = true;
        match inquiry.what {
            Asked::Living => {
                self.register.next.push(connection);
                self.register.begin_list(&mut self.urgent);
            }
            Asked::End { mark } => {
                self.register.ends.push_back(End {
                    asked: connection,
                    by: inquiry.name,
                    mark,
                });
                self.register.begin_ends(&mut self.urgent);
            }
        }
    }

    /// The realtime thread tells what lives in the machine ([`machine::link::Follower::lives`]).
    pub fn lives(&mut self, now: Tick, told: Lives) {
        match (told, &mut self.register.list) {
            (Lives::Begin, Some(list)) => list.found.clear(),
            (Lives::One(living), Some(list)) => list.found.push(living),
            (Lives::Whole, list) => {
                let Some(list) = list.take() else { return };
                self.register.forget(&list);
                for connection in &list.asked {
                    self.answer(*connection, now, &list.found);
                }
                if !self.register.next.is_empty() || list.plans != self.register.plans {
                    self.register.begin_list(&mut self.urgent);
                }
            }
            (Lives::Ended { mark, what }, _) => {
                let Some(end) = self.register.ending.pop_front() else { return };
                if let Some(living) = what {
                    let (_, line) = self.register.entry(living);
                    self.notices.push_back(Notice::Ended {
                        name: end.by.text().to_owned(),
                        mark,
                        line: line.to_owned(),
                    });
                }
                self.answer(end.asked, now, what.as_slice());
                self.register.begin_ends(&mut self.urgent);
            }
            // A list that nobody asked for.
            (Lives::Begin | Lives::One(_), None) => {}
        }
    }

    /// Tells one who asked, and closes the connection.
    fn answer(&mut self, connection: Connection, now: Tick, lived: &[Living]) {
        let Some(side) = self.sides.get_mut(&connection) else {
            // Gone meanwhile.
            return;
        };
        let machine = Name::new(&self.card.name);
        let frames = lived.len().div_ceil(ENTRIES_IN_A_FRAME).max(1);
        for frame in 0..frames {
            let from = frame * ENTRIES_IN_A_FRAME;
            let entries = &lived[from..lived.len().min(from + ENTRIES_IN_A_FRAME)];
            let head = AnswerHead {
                machine,
                now: self.register.now,
                count: entries.len() as u16,
                last: frame + 1 == frames,
            };
            side.wired.send(now, Kind::Answer, &mut side.out, |to| {
                head.write(to);
                for living in entries {
                    let (entry, line) = self.register.entry(*living);
                    entry.write(to);
                    words::write(line, to);
                }
            });
        }
        side.closing = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_what_does_not_run_are_let_go_of_however_many_programs_there_are() {
        let (mut register, mut urgent) = (Register::default(), VecDeque::new());
        let mut runs = Vec::new();
        for plan in 0..500u32 {
            register.new_plan(&mut urgent);
            // One of each plan before is still running.
            let mut list = register.list.take().expect("it finds out what runs");
            let living = |mark| Living {
                mark,
                ..Living::default()
            };
            list.found = runs.iter().copied().map(living).collect();
            register.forget(&list);
            for number in 0..10 {
                let mark = register.loads(number, number % 2 == 0, format!("{plan} {number}"), Name::new("jo"));
                assert_eq!(mark, plan * 10 + number + 1);
                // After a cut it comes again.
                assert_eq!(register.loads(number, number % 2 == 0, String::new(), Name::new("jo")), mark);
            }
            if plan % 100 == 0 {
                runs.push(plan * 10 + 1);
            }
            assert!(register.known.len() <= 10 + runs.len(), "{}", register.known.len());
        }
        assert_eq!(register.loads(u32::MAX, true, "one too many".to_owned(), Name::new("jo")), 0);
        assert_eq!(register.known.len(), 10 + runs.len());
    }
}

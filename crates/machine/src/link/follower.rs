//! The realtime end of the link: puts blocks into the machine's queue, takes stop tails out again when the next block has come, and
//! keeps account of how far the plan is.
//!
//! It stands between the queue that the receiving task fills and the [`RealtimeHalf`], in the realtime thread: what it has to decide,
//! it decides from what is there, and if the receiving task dies, the tail is in the machine's queue already.

use super::asking::{ENDS_UNDER_WAY, Lives, Sweep};
use super::loading::{LoadPart, Loading, Loads};
use super::message::{Entry, Status, Urgent};
use crate::controller::{Counters, QUEUE};
use crate::drive::CyclicDrive;
use crate::pad::ControlPad;
use crate::realtime::{RealtimeHalf, Report};
use crate::ring::Ring;
use crate::state::{State, StopCause, Wait};
use crate::{Command, Request};

/// What the receiving task hands over, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// A block begins: the tail of the one before it is superseded.
    Block {
        /// Of which epoch.
        epoch: u32,
        /// The number of its first entry.
        first: u64,
    },
    /// An entry of its body.
    Body {
        /// Of which epoch.
        epoch: u32,
        /// The entry.
        entry: Entry,
    },
    /// An entry of its stop tail.
    Tail {
        /// Of which epoch.
        epoch: u32,
        /// The entry.
        entry: Entry,
    },
}

/// What the receiving task hands over past the queue of orders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UrgentOrder {
    /// From the sender.
    Urgent(Urgent),
    /// A sender that the machine does not know is there: what is queued is not its own.
    NewSession {
        /// Its session.
        session: u32,
        /// It sends the plan that was being executed: what is done of it is done.
        same_plan: bool,
    },
    /// The sender is silent, or has gone: a controlled stop.
    LinkLost,
    /// It is back in its own session.
    LinkBack,
    /// A part of what it loads.
    Load(LoadPart),
    /// Tell what lives in the machine ([`Follower::lives`]).
    Living,
    /// End what has this mark, and tell it.
    End {
        /// Which.
        mark: u32,
    },
}

/// Where the plan is when a queued command is done.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    done: u64,
    /// Path length, for a set-point.
    path_length: Option<f64>,
}

/// The realtime end of a link.
#[derive(Clone, Debug)]
pub struct Follower {
    /// One for each command in the machine's queue or in work.
    marks: Ring<Mark, { QUEUE + 4 }>,
    /// Commands at the end of the machine's queue that are a stop tail.
    tail: usize,
    status: Status,
    /// What of the machine's counters was accounted for.
    completed: u64,
    discarded: u64,
    /// What was counted before the plan.
    before: Counters,
    lost_firings_before: u64,
    loading: Loading,
    sweep: Sweep,
    /// What became of what was to be ended.
    ended: Ring<Lives, ENDS_UNDER_WAY>,
    lost: bool,
    /// The stop tail was used: when it has come to rest the machine is held.
    on_tail: bool,
    /// Blocks of which the tail was in use already when they came.
    too_late: u64,
}

impl Default for Follower {
    fn default() -> Self {
        Follower::new()
    }
}

impl Follower {
    /// Before the first session.
    pub const fn new() -> Self {
        Follower {
            marks: Ring::new(),
            tail: 0,
            status: Status {
                epoch: 0,
                taken: 0,
                executed: 0,
                done: None,
                path_length: 0.0,
                needs_resume: true,
                session: 0,
                reports: 0,
                lost_reports: 0,
                loads: NO_LOADS,
                firings: 0,
                lost_firings: 0,
            },
            completed: 0,
            discarded: 0,
            before: ZERO,
            lost_firings_before: 0,
            loading: Loading::new(),
            sweep: Sweep::Over,
            ended: Ring::new(),
            lost: true,
            on_tail: false,
            too_late: 0,
        }
    }

    /// Carries an order out.
    ///
    /// # Errors
    /// Gives it back when the machine does not take it now: keep it, and everything behind it, and try again.
    pub fn take<D: CyclicDrive, P: ControlPad>(&mut self, order: Order, half: &mut RealtimeHalf<D, P>) -> Result<(), Order> {
        let (Order::Block { epoch, .. } | Order::Body { epoch, .. } | Order::Tail { epoch, .. }) = order;
        if epoch != self.status.epoch || self.status.needs_resume {
            // The sender hears of it in the status, and sends it again from where the machine stands.
            return Ok(());
        }
        match order {
            Order::Block { first, .. } => {
                if first != self.status.taken {
                    self.status.needs_resume = true;
                } else if half.withdraw(self.tail) {
                    for _ in 0..self.tail {
                        self.marks.pop_back();
                    }
                    self.tail = 0;
                } else {
                    self.too_late += 1;
                    self.use_tail();
                }
            }
            Order::Body { entry, .. } => {
                half.push(entry.command).map_err(|_| order)?;
                self.mark(&entry);
                self.status.taken += 1;
            }
            Order::Tail { entry, .. } => {
                half.push(entry.command).map_err(|_| order)?;
                self.mark(&entry);
                self.tail += 1;
            }
        }
        Ok(())
    }

    /// Carries out what does not wait.
    pub fn take_urgent<D: CyclicDrive, P: ControlPad>(&mut self, order: UrgentOrder, half: &mut RealtimeHalf<D, P>) {
        match order {
            // Nobody goes on along a queue that leads nowhere, or while nobody is there to send more.
            UrgentOrder::Urgent(Urgent::Request(Request::CycleStart)) if self.status.needs_resume || self.lost => {}
            UrgentOrder::Urgent(Urgent::Request(request)) => half.request(request),
            UrgentOrder::Urgent(Urgent::Resume { epoch, done }) => {
                if can_begin_anew(half.controller().state()) && half.forget_queue() {
                    self.account(half);
                    self.marks.clear();
                    (self.tail, self.on_tail) = (0, false);
                    self.status = Status {
                        epoch,
                        taken: 0,
                        executed: 0,
                        done: Some(done),
                        needs_resume: false,
                        ..self.status
                    };
                }
            }
            UrgentOrder::NewSession { session, same_plan } => {
                self.status.session = session;
                self.status.needs_resume = true;
                self.lost = false;
                // Its loads begin with the first again.
                self.status.loads = NO_LOADS;
                if !same_plan {
                    (self.status.done, self.status.path_length) = (Some(0), 0.0);
                    self.before = half.controller().counters();
                    self.loading.new_plan();
                    half.new_program();
                    // Their places are other ones now.
                    if self.sweep != Sweep::Over {
                        self.sweep = Sweep::Asked;
                    }
                    self.lost_firings_before = half.watches().counters().lost_firings;
                    self.status.lost_firings = 0;
                }
                hold(half);
            }
            UrgentOrder::LinkLost => {
                self.lost = true;
                hold(half);
            }
            UrgentOrder::LinkBack => self.lost = false,
            UrgentOrder::Load(part) => self.loading.take(part, &mut self.status.loads, half),
            UrgentOrder::Living => self.sweep = Sweep::Asked,
            UrgentOrder::End { mark } => {
                let what = half.watches().end(mark);
                // There are never more under way than it has places for.
                let _ = self.ended.push(Lives::Ended { mark, what });
            }
        }
    }

    /// After each tick: brings the account up to date.
    pub fn after_tick<D: CyclicDrive, P: ControlPad>(&mut self, half: &mut RealtimeHalf<D, P>) {
        self.account(half);
        self.status.lost_firings = half.watches().counters().lost_firings - self.lost_firings_before;
        if self.tail > 0 && self.marks.len() < self.tail {
            self.use_tail();
        }
        if half.controller().is_idle()
            && (self.on_tail || self.lost)
            && half.controller().state() == State::Waiting(Wait::Commands)
        {
            // A stop that nobody asked for ends as one that somebody did: only cycle start leads on.
            half.request(Request::Hold);
        }
    }

    /// The next thing to be told of what lives in the machine; `None`: nothing was asked, or no more in this cycle. Ask a few times in each:
    /// so many places are looked at at most.
    pub fn lives<D: CyclicDrive, P: ControlPad>(&mut self, half: &mut RealtimeHalf<D, P>) -> Option<Lives> {
        self.ended.pop().or_else(|| self.sweep.next(half.watches()))
    }

    /// How far everything is. The numbers of reports are the receiving task's.
    pub fn status(&self) -> Status {
        self.status
    }

    /// A report as the sender shall see it: its counts are those of the plan, and of nothing before it.
    pub fn translated(&self, report: Report) -> Report {
        let mut counters = since(&report.counters, &self.before);
        if let Some(done) = self.status.done {
            counters.completed = done;
        }
        Report { counters, ..report }
    }

    /// Blocks that came when the stop tail before them was in use.
    pub fn too_late(&self) -> u64 {
        self.too_late
    }

    fn use_tail(&mut self) {
        self.on_tail = true;
        self.status.needs_resume = true;
    }

    fn mark(&mut self, entry: &Entry) {
        let path_length = match entry.command {
            Command::SetPoint(s) => Some(s.path_length),
            _ => None,
        };
        let mark = Mark {
            done: entry.done,
            path_length,
        };
        // There is a place for each place of the machine's queue.
        let _ = self.marks.push(mark);
    }

    /// Takes off the list what the machine has done or thrown away.
    fn account<D: CyclicDrive, P: ControlPad>(&mut self, half: &RealtimeHalf<D, P>) {
        let counters = half.controller().counters();
        let completed = counters.completed - self.completed;
        let discarded = counters.discarded - self.discarded;
        (self.completed, self.discarded) = (counters.completed, counters.discarded);
        for _ in 0..completed {
            if let Some(mark) = self.marks.pop() {
                self.status.done = Some(mark.done);
                self.status.path_length = mark.path_length.unwrap_or(self.status.path_length);
                self.status.executed += 1;
            }
        }
        if discarded > 0 {
            for _ in 0..discarded {
                self.marks.pop();
            }
            // What was to come after it is not there any more.
            self.status.needs_resume = true;
        }
        let in_body = self.status.taken;
        self.status.executed = self.status.executed.min(in_body);
    }
}

const NO_LOADS: Loads = Loads {
    decided: 0,
    last: [super::loading::Loaded::Tool; super::loading::LOADS_UNDER_WAY as usize],
};

const ZERO: Counters = Counters {
    accepted: 0,
    completed: 0,
    discarded: 0,
    late_ticks: 0,
    late_gaps: 0,
    starved_ticks: 0,
    starvations: 0,
    off_path_stops: 0,
    bridged_readings: 0,
    following_warnings: 0,
    in_position_time_outs: 0,
    spindle_limited: 0,
};

/// What was counted between two moments.
fn since(now: &Counters, before: &Counters) -> Counters {
    Counters {
        // Stop tails are taken back, so this one can fall.
        accepted: now.accepted.saturating_sub(before.accepted),
        completed: now.completed - before.completed,
        discarded: now.discarded - before.discarded,
        late_ticks: now.late_ticks - before.late_ticks,
        late_gaps: now.late_gaps - before.late_gaps,
        starved_ticks: now.starved_ticks - before.starved_ticks,
        starvations: now.starvations - before.starvations,
        off_path_stops: now.off_path_stops - before.off_path_stops,
        bridged_readings: now.bridged_readings - before.bridged_readings,
        following_warnings: now.following_warnings - before.following_warnings,
        in_position_time_outs: now.in_position_time_outs - before.in_position_time_outs,
        spindle_limited: now.spindle_limited - before.spindle_limited,
    }
}

/// A controlled stop on the path; what the machine does at rest is finished first.
fn hold<D: CyclicDrive, P: ControlPad>(half: &mut RealtimeHalf<D, P>) {
    if matches!(
        half.controller().state(),
        State::Running | State::Waiting(_) | State::Resuming
    ) {
        half.request(Request::Hold);
    }
}

/// States in which the queue may be replaced by another beginning at the place where the axes stand.
fn can_begin_anew(state: State) -> bool {
    matches!(
        state,
        State::Ready | State::Held | State::Paused | State::Waiting(Wait::Commands) | State::Stopped(StopCause::Starved)
    )
}

//! The realtime task: one thread that wakes up each millisecond by the monotonic clock, runs one servo cycle, and sleeps again.
//!
//! What goes in and out passes through bounded lock-free rings ([`rtrb`]): the thread never waits for another one and allocates nothing.
//! A cycle that begins late is counted ([`Punctuality`]); when whole cycles were lost the machine hears of it by its tick number, and takes
//! set-points by their time. Privileges ([`Privileges`]) make it punctual; without them the same code runs and says what it lacks.
//!
//! `app/benches/realtime.rs` measures this very file.

pub mod lateness;
pub mod privileges;

pub use lateness::Punctuality;
pub use privileges::Privileges;

use machine::link::{Follower, Lives, Order, Status, UrgentOrder};
use machine::watch::Firing;
use machine::{Command, ControlPad, CyclicDrive, NoPad, RealtimeHalf, Report, Request};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;
use units::Tick;

/// One servo cycle.
pub const PERIOD: Duration = Duration::from_millis(1);
/// So long before its time a cycle's sleep ends, and what is left is waited for awake: a kernel without realtime patches, on a processor that
/// somebody else works on, is no later than that in 98 of 100 cases. It costs a processor a fifteenth of its time.
const AWAKE_BEFORE: Duration = Duration::from_micros(100);
/// Commands that wait in the ring at most. The controller's own queue stands behind it.
pub const COMMANDS: usize = 256;
/// Requests that wait at most: a person is slower than a cycle.
pub const REQUESTS: usize = 64;
/// Reports that wait for the sending task at most, two seconds: it is an ordinary thread and may be late itself.
pub const REPORTS: usize = 2048;
/// Firings of conditions that wait with them at most; the machine keeps some more, and counts what it loses.
pub const FIRINGS: usize = 4096;
/// What lives in the machine, told to who asked: so many wait at most.
pub const LIVES: usize = 256;
/// So many of them in one cycle: four thousand take a quarter of a second, and no cycle is late for it.
const LIVES_A_CYCLE: usize = 16;

/// Cycle after cycle until `stop`: sleeps until shortly before the beginning of each by the monotonic clock, waits awake for it, counts how
/// late it was, and calls `cycle` with its number and with how many from it on are made up for.
///
/// After lost cycles the numbers go on by the clock: real drives went on meanwhile. Simulated ones stand still when their computer is away,
/// so up to `made_up` lost cycles in a row are run then, one after another, and the motion is what it would have been.
pub fn every_cycle(punctuality: &Punctuality, stop: &AtomicBool, made_up: u64, mut cycle: impl FnMut(Tick, u64)) {
    let began = clock::now();
    let mut tick = 0u64;
    while !stop.load(Relaxed) {
        cycle(Tick(tick), 0);
        tick += 1;
        let due = began + Duration::from_millis(tick);
        let awake = due.saturating_sub(AWAKE_BEFORE);
        clock::sleep_until(awake);
        let mut now = clock::now();
        punctuality.wake_ups.add(now.saturating_sub(awake));
        while now < due {
            std::hint::spin_loop();
            now = clock::now();
        }
        let late = now - due;
        punctuality.cycles.add(late);
        let lost = u64::try_from(late.as_nanos() / PERIOD.as_nanos()).unwrap_or(0);
        if lost <= made_up {
            for k in 0..lost {
                cycle(Tick(tick + k), if k == 0 { lost } else { 0 });
            }
        }
        tick += lost;
    }
}

/// What goes to the machine in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Queued {
    /// From the default link, with the account of how far the plan is.
    Order(Order),
    /// From anybody else.
    Command(Command),
}

/// What does not wait behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AtOnce {
    /// From the default link.
    Order(UrgentOrder),
    /// A person's request, or the controller's own.
    Request(Request),
}

/// One cycle as the other tasks hear of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// The cycle.
    pub report: Report,
    /// How far the plan of the default link is.
    pub status: Status,
}

/// The realtime half with its ends of the rings.
pub struct Servo<D, P = NoPad> {
    // On the heap: their queues are large for a stack.
    half: Box<RealtimeHalf<D, P>>,
    /// The realtime end of the default link, where that is spoken.
    follower: Option<Box<Follower>>,
    queued: Consumer<Queued>,
    at_once: Consumer<AtOnce>,
    told: Producer<Told>,
    firings: Producer<Firing>,
    lives: Producer<Lives>,
    /// Taken from the ring, and the machine had no place for it.
    waiting: Option<Queued>,
    lost_reports: Arc<AtomicU64>,
}

/// The other ends.
pub struct Ends {
    /// What the machine is to do; full is an answer, and the sender gets no credit.
    pub queued: Producer<Queued>,
    /// What overtakes it.
    pub at_once: Producer<AtOnce>,
    /// One report a cycle.
    pub told: Consumer<Told>,
    /// What fired: all of a cycle is there before its report is. Where no default link drives the machine there is none.
    pub firings: Consumer<Firing>,
    /// What lives in the machine, where somebody has asked.
    pub lives: Consumer<Lives>,
    /// Reports that found no place: a gap, counted.
    pub lost_reports: Arc<AtomicU64>,
}

impl<D: CyclicDrive, P: ControlPad> Servo<D, P> {
    /// Joins a machine to rings; `follower` where the default link drives it.
    pub fn new(half: RealtimeHalf<D, P>, follower: Option<Follower>) -> (Servo<D, P>, Ends) {
        let (to_queued, queued) = RingBuffer::new(COMMANDS);
        let (to_at_once, at_once) = RingBuffer::new(REQUESTS);
        let (told, from_told) = RingBuffer::new(REPORTS);
        let (firings, from_firings) = RingBuffer::new(FIRINGS);
        let (lives, from_lives) = RingBuffer::new(LIVES);
        let lost_reports = Arc::new(AtomicU64::new(0));
        let servo = Servo {
            half: Box::new(half),
            follower: follower.map(Box::new),
            queued,
            at_once,
            told,
            firings,
            lives,
            waiting: None,
            lost_reports: Arc::clone(&lost_reports),
        };
        let ends = Ends {
            queued: to_queued,
            at_once: to_at_once,
            told: from_told,
            firings: from_firings,
            lives: from_lives,
            lost_reports,
        };
        (servo, ends)
    }

    /// One servo cycle, and how many come too late from this one on. See [`Servo::cycle`].
    pub fn late_cycle(&mut self, now: Tick, late: u64) {
        self.half.count_late(late);
        self.cycle(now);
    }

    /// One servo cycle. No allocation, no lock, and no call of the system but for the clock, and for what drives it: a register file takes a
    /// read and a write of some bytes.
    pub fn cycle(&mut self, now: Tick) {
        while let Ok(at_once) = self.at_once.pop() {
            match (at_once, &mut self.follower) {
                (AtOnce::Request(request), _) => self.half.request(request),
                (AtOnce::Order(order), Some(follower)) => follower.take_urgent(order, &mut self.half),
                // Nobody speaks the default link here.
                (AtOnce::Order(_), None) => {}
            }
        }
        while let Some(queued) = self.waiting.take().or_else(|| self.queued.pop().ok()) {
            let back = match (queued, &mut self.follower) {
                (Queued::Command(command), _) => self.half.push(command).err().map(Queued::Command),
                (Queued::Order(order), Some(follower)) => follower.take(order, &mut self.half).err().map(Queued::Order),
                (Queued::Order(_), None) => None,
            };
            if back.is_some() {
                self.waiting = back;
                break;
            }
        }
        self.half
            .tick_by(now, &mut || u64::try_from(clock::now().as_nanos()).unwrap_or(u64::MAX));
        if let Some(follower) = &mut self.follower {
            follower.after_tick(&mut self.half);
            for _ in 0..LIVES_A_CYCLE {
                if self.lives.is_full() {
                    break;
                }
                let Some(lives) = follower.lives(&mut self.half) else { break };
                // There was a place, and nobody else fills it.
                let _ = self.lives.push(lives);
            }
        }
        while !self.told.is_full() && self.tell_firings() {
            let Some(report) = self.half.report() else { break };
            let told = match &self.follower {
                Some(follower) => Told {
                    report: follower.translated(report),
                    status: follower.status(),
                },
                None => Told {
                    report,
                    status: Status::default(),
                },
            };
            // There was a place, and nobody else fills it.
            let _ = self.told.push(told);
        }
        self.lost_reports.store(self.half.lost_reports(), Relaxed);
    }

    /// Tells what fired up to the cycle of the next report; false when there was no place for all of it.
    fn tell_firings(&mut self) -> bool {
        let Some(until) = self.half.next_report().map(|report| report.sample.tick) else {
            return true;
        };
        if self.follower.is_none() {
            return true;
        }
        while !self.firings.is_full() {
            let Some(firing) = self.half.firing(until) else { return true };
            // There was a place, and nobody else fills it.
            let _ = self.firings.push(firing);
        }
        self.half.watches().next_firing().is_none_or(|firing| firing.tick > until)
    }
}

#[cfg(target_os = "linux")]
mod clock {
    use rustix::thread::{ClockId, clock_nanosleep_absolute};
    use rustix::time::{Timespec, clock_gettime};
    use std::time::Duration;

    /// The monotonic clock.
    pub fn now() -> Duration {
        let at = clock_gettime(ClockId::Monotonic);
        Duration::new(at.tv_sec.unsigned_abs(), u32::try_from(at.tv_nsec).unwrap_or(0))
    }

    /// Sleeps until a moment of that clock, however long the last cycle took.
    pub fn sleep_until(due: Duration) {
        let at = Timespec {
            tv_sec: due.as_secs().cast_signed(),
            tv_nsec: due.subsec_nanos().into(),
        };
        // A signal ends the sleep early; the next one is to the same moment.
        while clock_nanosleep_absolute(ClockId::Monotonic, &at).is_err() {
            if now() >= due {
                return;
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod clock {
    use std::sync::OnceLock;
    use std::time::{Duration, Instant};

    static FIRST: OnceLock<Instant> = OnceLock::new();

    /// Since the first call.
    pub fn now() -> Duration {
        FIRST.get_or_init(Instant::now).elapsed()
    }

    /// As near as the standard library comes.
    pub fn sleep_until(due: Duration) {
        std::thread::sleep(due.saturating_sub(now()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{MachineParameters, Plant, Quality, SetPoint, State};
    use units::{Point, StepId};

    fn servo() -> (Servo<Plant>, Ends) {
        let parameters = MachineParameters::small_machining_centre();
        let plant = Plant::new(&parameters, Point::ORIGIN, 1);
        Servo::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated), None)
    }

    #[test]
    fn cycles_are_numbered_by_the_clock_and_every_one_is_counted() {
        let (punctuality, stop) = (Punctuality::default(), AtomicBool::new(false));
        let mut seen = Vec::new();
        every_cycle(&punctuality, &stop, 0, |tick, _| {
            if seen.len() == 3 {
                // Four cycles and a half are lost here: the number of the next is later by at least so many.
                std::thread::sleep(Duration::from_micros(4_500));
            }
            seen.push(tick.0);
            if seen.len() == 10 {
                stop.store(true, Relaxed);
            }
        });
        assert_eq!((seen[0], punctuality.cycles.summary().cycles), (0, 10));
        assert!(seen.windows(2).all(|pair| pair[0] < pair[1]), "{seen:?}");
        assert!(seen[4] >= seen[3] + 4, "{seen:?}");
        assert!(punctuality.cycles.summary().missed >= 1);
    }

    #[test]
    fn simulated_drives_wait_for_cycles_that_come_late_and_those_are_counted() {
        let (punctuality, stop) = (Punctuality::default(), AtomicBool::new(false));
        let (mut servo, mut ends) = servo();
        let mut seen = Vec::new();
        every_cycle(&punctuality, &stop, 500, |tick, late| {
            if seen.len() == 3 {
                std::thread::sleep(Duration::from_micros(9_500));
            }
            servo.late_cycle(tick, late);
            seen.push(tick.0);
            if seen.len() == 40 {
                stop.store(true, Relaxed);
            }
        });
        assert!(
            seen.windows(2).all(|pair| pair[0] + 1 == pair[1]),
            "none is passed over: {seen:?}"
        );
        let mut last = None;
        while let Ok(told) = ends.told.pop() {
            last = Some(told.report.counters);
        }
        let last = last.expect("a report each cycle");
        assert!(last.late_ticks >= 8 && last.late_gaps >= 1, "{last:?}");
    }

    #[test]
    fn who_is_away_for_longer_finds_the_numbers_of_the_clock() {
        let (punctuality, stop) = (Punctuality::default(), AtomicBool::new(false));
        let mut seen = Vec::new();
        every_cycle(&punctuality, &stop, 5, |tick, late| {
            assert!(late <= 5, "{late}");
            if seen.len() == 3 {
                std::thread::sleep(Duration::from_micros(9_500));
            }
            seen.push(tick.0);
            if seen.len() == 10 {
                stop.store(true, Relaxed);
            }
        });
        // On a busy computer the sleep may fall into cycles that are being made up for: what comes after them is later then.
        assert!(seen.windows(2).any(|pair| pair[1] >= pair[0] + 9), "{seen:?}");
    }

    #[test]
    fn a_full_ring_keeps_what_it_could_not_take_and_nothing_is_lost() {
        let (mut servo, mut ends) = servo();
        ends.at_once.push(AtOnce::Request(Request::PowerOn)).expect("a place");
        servo.cycle(Tick(0));
        let dwell = Command::Dwell {
            cycles: 1,
            step: StepId(1),
        };
        let (mut given, mut tick) = (0u64, 1);
        while given < 2000 {
            match ends.queued.push(Queued::Command(dwell)) {
                Ok(()) => given += 1,
                Err(_) => {
                    servo.cycle(Tick(tick));
                    tick += 1;
                }
            }
            while ends.told.pop().is_ok() {}
        }
        let mut last = None;
        for _ in 0..10_000 {
            servo.cycle(Tick(tick));
            tick += 1;
            last = ends.told.pop().ok();
        }
        let last = last.expect("a report each cycle").report;
        assert_eq!((last.counters.completed, last.counters.discarded), (2000, 0));
    }

    #[test]
    fn reports_that_nobody_takes_are_counted_and_the_machine_goes_on() {
        let (mut servo, mut ends) = servo();
        ends.at_once.push(AtOnce::Request(Request::PowerOn)).expect("a place");
        let cycles = REPORTS as u64 + 1000;
        for tick in 0..cycles {
            servo.cycle(Tick(tick));
        }
        let lost = ends.lost_reports.load(Relaxed);
        let mut had = 0;
        let mut state = State::Off;
        while let Ok(told) = ends.told.pop() {
            had += 1;
            state = told.report.state;
        }
        assert_eq!(
            (had, lost),
            (REPORTS as u64, cycles - REPORTS as u64 - machine::realtime::REPORTS as u64)
        );
        assert_eq!(state, State::Ready);
    }

    #[test]
    fn a_request_overtakes_the_commands_before_it() {
        let (mut servo, mut ends) = servo();
        for request in [Request::PowerOn, Request::Stop] {
            ends.at_once.push(AtOnce::Request(request)).expect("a place");
        }
        for k in 0..50 {
            let at = SetPoint {
                position: [0.0; 3],
                step: StepId(k),
                ..SetPoint::default()
            };
            ends.queued.push(Queued::Command(Command::SetPoint(at))).expect("a place");
        }
        servo.cycle(Tick(0));
        ends.at_once.push(AtOnce::Request(Request::PowerOff)).expect("a place");
        servo.cycle(Tick(1));
        let mut states = Vec::new();
        while let Ok(told) = ends.told.pop() {
            states.push(told.report.state);
        }
        assert_eq!(states.last(), Some(&State::Off), "{states:?}");
    }
}

//! The realtime task: one thread that wakes up each millisecond by the monotonic clock, runs one servo cycle, and sleeps again.
//!
//! What goes in and out passes through bounded lock-free rings ([`rtrb`]): the thread never waits for another one and allocates nothing.
//! A cycle that begins late is counted ([`Lateness`]); when whole cycles were lost the machine hears of it by its tick number, and takes
//! set-points by their time. Privileges ([`Privileges`]) make it punctual; without them the same code runs and says what it lacks.
//!
//! `app/benches/realtime.rs` measures this very file.

pub mod lateness;
pub mod privileges;

pub use lateness::{Lateness, Summary};
pub use privileges::Privileges;

use machine::{Command, CyclicDrive, RealtimeHalf, Report, Request};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;
use units::Tick;

/// One servo cycle.
pub const PERIOD: Duration = Duration::from_millis(1);
/// Commands that wait in the ring at most. The controller's own queue stands behind it.
pub const COMMANDS: usize = 256;
/// Requests that wait at most: a person is slower than a cycle.
pub const REQUESTS: usize = 64;
/// Reports that wait for the sending task at most, two seconds: it is an ordinary thread and may be late itself.
pub const REPORTS: usize = 2048;

/// Cycle after cycle until `stop`: sleeps until the beginning of each by the monotonic clock, counts how late it was, and calls `cycle`
/// with its number. After lost cycles the numbers go on by the clock.
pub fn every_cycle(lateness: &Lateness, stop: &AtomicBool, mut cycle: impl FnMut(Tick)) {
    let began = clock::now();
    let mut tick = 0u64;
    while !stop.load(Relaxed) {
        cycle(Tick(tick));
        tick += 1;
        let due = began + Duration::from_millis(tick);
        clock::sleep_until(due);
        let late = clock::now().saturating_sub(due);
        lateness.add(late);
        tick += u64::try_from(late.as_nanos() / PERIOD.as_nanos()).unwrap_or(0);
    }
}

/// The realtime half with its ends of the rings.
pub struct Servo<D> {
    // On the heap: its queues are large for a stack.
    half: Box<RealtimeHalf<D>>,
    commands: Consumer<Command>,
    requests: Consumer<Request>,
    reports: Producer<Report>,
    /// Taken from the ring, and the controller had no place for it.
    waiting: Option<Command>,
    lost_reports: Arc<AtomicU64>,
}

/// The other ends.
pub struct Ends {
    /// Commands for the machine; full is an answer, and the sender gets no credit.
    pub commands: Producer<Command>,
    /// Requests of people; they overtake commands.
    pub requests: Producer<Request>,
    /// One report a cycle.
    pub reports: Consumer<Report>,
    /// Reports that found no place: a gap, counted.
    pub lost_reports: Arc<AtomicU64>,
}

impl<D: CyclicDrive> Servo<D> {
    /// Joins a machine to rings.
    pub fn new(half: RealtimeHalf<D>) -> (Servo<D>, Ends) {
        let (to_commands, commands) = RingBuffer::new(COMMANDS);
        let (to_requests, requests) = RingBuffer::new(REQUESTS);
        let (reports, from_reports) = RingBuffer::new(REPORTS);
        let lost_reports = Arc::new(AtomicU64::new(0));
        let servo = Servo {
            half: Box::new(half),
            commands,
            requests,
            reports,
            waiting: None,
            lost_reports: Arc::clone(&lost_reports),
        };
        let ends = Ends {
            commands: to_commands,
            requests: to_requests,
            reports: from_reports,
            lost_reports,
        };
        (servo, ends)
    }

    /// One servo cycle. No allocation, no lock, no call of the system.
    pub fn cycle(&mut self, now: Tick) {
        while let Ok(request) = self.requests.pop() {
            self.half.request(request);
        }
        while let Some(command) = self.waiting.take().or_else(|| self.commands.pop().ok()) {
            if let Err(back) = self.half.push(command) {
                self.waiting = Some(back);
                break;
            }
        }
        self.half.tick(now);
        while !self.reports.is_full() {
            let Some(report) = self.half.report() else { break };
            // There was a place, and nobody else fills it.
            let _ = self.reports.push(report);
        }
        self.lost_reports.store(self.half.lost_reports(), Relaxed);
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
        Servo::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated))
    }

    #[test]
    fn cycles_are_numbered_by_the_clock_and_every_one_is_counted() {
        let (lateness, stop) = (Lateness::default(), AtomicBool::new(false));
        let mut seen = Vec::new();
        every_cycle(&lateness, &stop, |tick| {
            if seen.len() == 3 {
                // Four cycles and a half are lost here: the number of the next is later by at least so many.
                std::thread::sleep(Duration::from_micros(4_500));
            }
            seen.push(tick.0);
            if seen.len() == 10 {
                stop.store(true, Relaxed);
            }
        });
        assert_eq!((seen[0], lateness.summary().cycles), (0, 10));
        assert!(seen.windows(2).all(|pair| pair[0] < pair[1]), "{seen:?}");
        assert!(seen[4] >= seen[3] + 4, "{seen:?}");
        assert!(lateness.summary().missed >= 1);
    }

    #[test]
    fn a_full_ring_keeps_what_it_could_not_take_and_nothing_is_lost() {
        let (mut servo, mut ends) = servo();
        ends.requests.push(Request::PowerOn).expect("a place");
        servo.cycle(Tick(0));
        let dwell = Command::Dwell {
            cycles: 1,
            step: StepId(1),
        };
        let (mut given, mut tick) = (0u64, 1);
        while given < 2000 {
            match ends.commands.push(dwell) {
                Ok(()) => given += 1,
                Err(_) => {
                    servo.cycle(Tick(tick));
                    tick += 1;
                }
            }
            while ends.reports.pop().is_ok() {}
        }
        let mut last = None;
        for _ in 0..10_000 {
            servo.cycle(Tick(tick));
            tick += 1;
            last = ends.reports.pop().ok();
        }
        let last = last.expect("a report each cycle");
        assert_eq!((last.counters.completed, last.counters.discarded), (2000, 0));
    }

    #[test]
    fn reports_that_nobody_takes_are_counted_and_the_machine_goes_on() {
        let (mut servo, mut ends) = servo();
        ends.requests.push(Request::PowerOn).expect("a place");
        let cycles = REPORTS as u64 + 1000;
        for tick in 0..cycles {
            servo.cycle(Tick(tick));
        }
        let lost = ends.lost_reports.load(Relaxed);
        let mut had = 0;
        let mut state = State::Off;
        while let Ok(report) = ends.reports.pop() {
            had += 1;
            state = report.state;
        }
        assert_eq!((had, lost), (REPORTS as u64, cycles - REPORTS as u64 - machine::realtime::REPORTS as u64));
        assert_eq!(state, State::Ready);
    }

    #[test]
    fn a_request_overtakes_the_commands_before_it() {
        let (mut servo, mut ends) = servo();
        for request in [Request::PowerOn, Request::Stop] {
            ends.requests.push(request).expect("a place");
        }
        for k in 0..50 {
            let at = SetPoint {
                position: [0.0; 3],
                step: StepId(k),
                ..SetPoint::default()
            };
            ends.commands.push(Command::SetPoint(at)).expect("a place");
        }
        servo.cycle(Tick(0));
        ends.requests.push(Request::PowerOff).expect("a place");
        servo.cycle(Tick(1));
        let mut states = Vec::new();
        while let Ok(report) = ends.reports.pop() {
            states.push(report.state);
        }
        assert_eq!(states.last(), Some(&State::Off), "{states:?}");
    }
}

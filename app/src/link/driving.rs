//! A run on a machine behind the link: in real time, with the office half on this side.

pub use super::driven::Driven;
use super::driven::{OnLink, Watched};
use super::own_count::OwnCount;
use super::remote::{Heard, Remote};
use crate::failure::Failure;
use crate::foreseen::Foresight;
use crate::progress::Progress;
use crate::survey::minutes;
use cell::events::Detail;
use cell::link::{Load, number_of};
use cell::sim::Outcome;
use cell::sink::RunDigest;
use cell::{CommandSource, OfficeHalf, RecordSink};
use ledger::Event;
use machine::watch::{Firing, LoadError};
use machine::{Counters, Overrides, Quality, Report, Request, Sample, State};
use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use trace::record::{Row, Stream};
use units::Tick;

/// How often the planner gives more, when reports come more seldom.
const LOOK: Duration = Duration::from_millis(5);
/// How long a machine may take to become ready.
const BECOMING_READY: Duration = Duration::from_secs(3);

/// How long a machine that stands may take to say so after a stop, and a link to come back.
const STOPPING_AT_REST: Duration = Duration::from_millis(500);
/// A stop is asked for again while the machine still moves: it may have begun only then.
const STOP_AGAIN: Duration = Duration::from_secs(1);

/// How long a machine may take for one condition of a program.
const LOADING: Duration = Duration::from_secs(10);

/// Makes the machine ready for a new run: acknowledges what the last one left, looks for its references where it does not know where its
/// axes are and `home` allows it, and waits until it stands ready.
///
/// # Errors
/// It does not become ready: the emergency stop is pressed, a fault stays, or another has to do something there.
pub fn make_ready(remote: &Remote, home: bool) -> Result<Report, Failure> {
    let mut began = Instant::now();
    let mut asked: Option<(Request, Instant)> = None;
    loop {
        let last = remote.last_report()?;
        let state = last.map(|report| report.state);
        let request = match state {
            Some(State::Ready) => {
                if let Some(report) = last {
                    return Ok(report);
                }
                None
            }
            Some(State::Off) => Some(Request::PowerOn),
            // It finds its references before it does anything else.
            Some(State::NotHomed) if home => Some(Request::Home),
            Some(State::Homing { .. }) => {
                // It takes as long as its axes are: what fails is a fault there.
                began = Instant::now();
                None
            }
            // What a run left that died, or another one that was held: it is given up, by who starts a new one.
            Some(State::Held | State::Paused) => Some(Request::Stop),
            Some(state) if state.needs_a_person() && state != State::EmergencyStop => Some(Request::Reset),
            _ => None,
        };
        if let Some(request) = request
            && asked.is_none_or(|(before, at)| before != request || at.elapsed() > Duration::from_millis(200))
        {
            remote.request(request);
            asked = Some((request, Instant::now()));
        }
        if began.elapsed() > BECOMING_READY {
            if state == Some(State::NotHomed) {
                return Err(Failure::machine(format_args!(
                    "{}: the machine does not know where its axes are: home it at its pad, or let the run begin with it (--home); nothing was \
                     moved",
                    remote.address
                )));
            }
            let state = state.map_or_else(|| "it does not report".to_owned(), |state| format!("its state is {state:?}"));
            return Err(Failure::machine(format_args!(
                "{}: the machine does not become ready: {state}; release the emergency stop and look at the machine",
                remote.address
            )));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a run on a link needs beside the office half.
pub struct Drive<'a, 'p> {
    /// The link.
    pub remote: &'a Remote,
    /// A person wants the machine to stop.
    pub stop: &'a AtomicBool,
    /// Hold or go on, from whoever may ask for it.
    pub requests: &'a dyn Fn() -> Option<Request>,
    /// What the machine is to know before anything moves: the program's conditions, numbered from 0, and the diameters of its tools.
    pub loads: Vec<Load>,
    /// Overrides for the whole run; what was in force before comes back at its end.
    pub overrides: Option<Overrides>,
    /// How far from the path the machine may be led back to it by itself, mm.
    pub approach: Option<f64>,
    /// How far the run is on its plan.
    pub far: &'a RefCell<Foresight<'p>>,
    /// Hears of every cycle.
    pub watch: &'a dyn Fn(&Report),
}

/// Loads what the program needs, and waits until the machine has it.
///
/// # Errors
/// The machine does not take a condition: without it nothing is run.
fn load(remote: &Remote, loads: &[Load]) -> Result<(), Failure> {
    loads.iter().for_each(|load| remote.load(load.clone()));
    let mut number = 0;
    for load in loads {
        let asked = Instant::now();
        let answer = loop {
            if let Some(answer) = remote.loaded() {
                break answer;
            }
            // Says why when the link is over.
            remote.last_report()?;
            if asked.elapsed() > LOADING {
                return Err(Failure::machine(format_args!(
                    "{}: the controller does not answer to the program's conditions; nothing was moved, start it again",
                    remote.address
                )));
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        let why = match (load, number_of(answer)) {
            // More tools than it has places for: their cutting speeds are unavailable.
            (Load::Tool { .. }, None) => continue,
            (Load::Watch { .. }, Some(Ok(given))) if given == number => {
                number += 1;
                continue;
            }
            (_, Some(Err(why))) => why.text(),
            _ => "it has another number there",
        };
        return Err(Failure::machine(format_args!(
            "{}: the controller does not take condition {} of the program: {why}; nothing was moved",
            remote.address,
            u32::from(number) + 1
        )));
    }
    Ok(())
}

/// Keeps what has happened: the tick, the caller's sink, and whether the run is over.
pub type Keep<'k, K> = dyn FnMut(Tick, &mut K, bool) -> Result<(), Failure> + 'k;

/// Runs to the end. `started` is the data of the run's first event.
///
/// # Errors
/// The link is over for good, or something could not be kept.
pub fn run<S: CommandSource, K: RecordSink>(
    drive: &Drive<'_, '_>,
    mut office: OfficeHalf<'_, S>,
    started: Detail,
    sink: &mut K,
    keep: &mut Keep<'_, K>,
) -> Result<(Outcome, Driven), Failure> {
    let remote = drive.remote;
    load(remote, &drive.loads)?;
    if let Some(distance) = drive.approach {
        remote.allow_approach(distance);
    }
    let overrides = drive.overrides.map(|wanted| Turned::to(remote, wanted)).transpose()?;
    remote.begin_record();
    let mut seen = Seen::new(sink);
    office.tell("job-started", Tick(0), started, &mut seen);
    let mut progress = Progress::new("running");
    let mut own = OwnCount::default();
    let mut now = Tick(0);
    let mut stopping: Option<Stopping> = None;
    let mut told_displaced = false;
    let mut kept_at = 0;
    // The machine has what the office wants loaded, and has not answered yet.
    let mut loading = false;
    loop {
        while let Some(answer) = remote.loaded() {
            loading = false;
            office.loaded(number_of(answer).unwrap_or(Err(LoadError::Full)));
        }
        office.refill(|command| remote.push(command));
        if !loading && let Some((line, compiled)) = office.to_load() {
            loading = true;
            remote.load(Load::condition(line, compiled));
        }
        office.machine_begun_anew(remote.begun_anew(), &mut seen);
        let mut wait = LOOK;
        while let Some(Heard { report, firings }) = remote.report(wait)? {
            wait = Duration::ZERO;
            let report = own.report(report, Instant::now());
            now = report.sample.tick;
            seen.report(&report, remote.status().0.ahead);
            (drive.watch)(&report);
            for firing in firings {
                let tick = own.tick(firing.tick);
                office.fired(Firing { tick, ..firing });
            }
            if let Some(request) = office.receive(&report, None, &mut seen) {
                remote.request(request);
            }
            if office.ended().is_some() {
                break;
            }
        }
        office.firings_lost(remote.lost_firings());
        office.reports_lost(remote.lost_reports(), now, &mut seen);
        if drive.stop.load(Relaxed) {
            let stopping = stopping.get_or_insert_with(|| {
                eprintln!(
                    "notice: controlled stop on the path; a second Ctrl-C ends this program at once, and the machine stops by itself"
                );
                remote.request(Request::Stop);
                Stopping::at(Instant::now())
            });
            match stopping.next(
                remote.status().0.linked,
                own.newest().map(|report| report.state),
                Instant::now(),
            ) {
                Next::Wait => {}
                Next::AskAgain => remote.request(Request::Stop),
                Next::IsCut => return Err(cut_while_stopping(remote)),
                Next::IsOver => own
                    .newest()
                    .into_iter()
                    .for_each(|report| office.stopped_at_rest(&report, &mut seen)),
            }
        }
        while let Some(request) = (drive.requests)() {
            remote.request(request);
        }
        let ended = office.ended().is_some();
        if ended || now.0 >= kept_at + 100 {
            kept_at = now.0;
            keep(now, seen.sink, ended)?;
        }
        let status = remote.status().0;
        drive.far.borrow_mut().at(now, seen.last.as_ref(), status.path_length);
        match status.displaced {
            Some(distance) if !told_displaced => {
                told_displaced = true;
                eprintln!("notice: {}", displaced(distance));
            }
            None => told_displaced = false,
            _ => {}
        }
        let depth = status.ahead;
        progress.at(|| {
            format!(
                "{}{} of machine time, buffer {depth} ms, following error {:.4} mm, {} late ticks",
                drive.far.borrow().words(),
                minutes(now.seconds().0),
                seen.watched.worst_following_error(),
                seen.counters.late_ticks
            )
        });
        if let Some(ended) = office.ended() {
            if let Some(overrides) = overrides {
                overrides.back(remote);
            }
            let (status, cuts) = remote.status();
            let ticks = Tick(now.0 + 1);
            let outcome = Outcome {
                ended: ended.clone(),
                ticks,
                time: ticks.seconds(),
                samples: seen.samples,
                commands: office.commands(),
                outstanding: office.commands().saturating_sub(seen.counters.completed),
                counters: seen.counters,
                worst_following_error: seen.watched.worst_following_error(),
                chain: office.chain(),
                digest: seen.digest.hash(),
            };
            let on = OnLink {
                link: "default",
                controller: remote.address.to_string(),
                leases: remote.leases(),
                cuts,
                resumed: status.resumed,
            };
            return Ok((outcome, seen.watched.driven(&seen.counters, on)));
        }
    }
}

/// A stop that a person has asked for, until the office hears that the machine has made it.
struct Stopping {
    asked: Instant,
    /// Since when the machine stands without the program, or is not heard of.
    idle: Option<Instant>,
    cut: Option<Instant>,
}

/// What is to be done about it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Next {
    /// The machine is stopping, or says that it has.
    Wait,
    /// It moves, as if it had not heard.
    AskAgain,
    /// It stands ready and there is nothing that a stop could end: it was started again and waits for cycle start, or has not begun.
    IsOver,
    /// There is no link: the controller is dead, or far.
    IsCut,
}

impl Stopping {
    fn at(asked: Instant) -> Stopping {
        Stopping {
            asked,
            idle: None,
            cut: None,
        }
    }

    /// With the link there or not, and the machine's last state.
    fn next(&mut self, linked: bool, state: Option<State>, now: Instant) -> Next {
        let lasts = |since: &mut Option<Instant>, is_so: bool| {
            *since = is_so.then(|| since.unwrap_or(now));
            since.is_some_and(|at| now - at >= STOPPING_AT_REST)
        };
        if lasts(&mut self.cut, !linked) {
            return Next::IsCut;
        }
        let stands = matches!(state, Some(State::Ready | State::NotHomed | State::Off));
        if lasts(&mut self.idle, linked && stands) {
            return Next::IsOver;
        }
        let is_on_its_way = matches!(
            state,
            None | Some(
                State::Stopping(_) | State::Stopped(_) | State::Fault(_) | State::EmergencyStop | State::EmergencyStopReleased
            )
        );
        if linked && !stands && !is_on_its_way && now - self.asked >= STOP_AGAIN {
            self.asked = now;
            return Next::AskAgain;
        }
        Next::Wait
    }
}

/// What is said when a person ends a run whose controller is not there.
fn cut_while_stopping(remote: &Remote) -> Failure {
    Failure::machine(format_args!(
        "{}: stop was asked while the link to the controller is cut. Without its driver a controller stops the machine on its path by itself; \
         nobody here knows where it stands: look at it",
        remote.address
    ))
}

/// What is said when the machine stands beside its path and does not go back by itself.
fn displaced(distance: f64) -> String {
    format!(
        "the machine stands {distance:.2} mm from its path and does not go on. Look at what lies between. Then stop this run (Ctrl-C) and take \
         the job up from above with toolmark run ... --resume last; or run with --approach {}, which lets it go straight back at 10 mm/s \
         from so far away",
        (distance + 1.0).ceil()
    )
}

/// Overrides of the machine that were turned for a run.
struct Turned {
    before: Overrides,
}

impl Turned {
    /// Turns them, and waits until they are in force.
    fn to(remote: &Remote, wanted: Overrides) -> Result<Turned, Failure> {
        let asked = Instant::now();
        let before = remote
            .last_report()?
            .map_or_else(Overrides::default, |report| report.overrides);
        remote.request(Request::Override(wanted));
        while remote
            .last_report()?
            .is_none_or(|report| report.overrides != wanted.limited())
        {
            if asked.elapsed() > BECOMING_READY {
                return Err(Failure::machine(format_args!(
                    "{}: the machine does not take the overrides; nothing was moved",
                    remote.address
                )));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(Turned { before })
    }

    fn back(self, remote: &Remote) {
        remote.request(Request::Override(self.before));
    }
}

/// The caller's sink, with the run looking on.
struct Seen<'s, K> {
    sink: &'s mut K,
    digest: RunDigest,
    samples: u64,
    last: Option<Sample>,
    counters: Counters,
    watched: Watched,
}

impl<'s, K> Seen<'s, K> {
    fn new(sink: &'s mut K) -> Self {
        Seen {
            sink,
            digest: RunDigest::default(),
            samples: 0,
            last: None,
            counters: Counters::default(),
            watched: Watched::default(),
        }
    }

    fn report(&mut self, report: &Report, depth: u64) {
        self.counters = report.counters;
        self.last = Some(report.sample);
        self.watched.see(&report.sample, report.state == State::Running, depth);
    }
}

impl<K: RecordSink> RecordSink for Seen<'_, K> {
    fn sample(&mut self, sample: &Sample) {
        self.samples += 1;
        self.digest.sample(sample);
        self.sink.sample(sample);
    }
    fn event(&mut self, event: &Event) {
        self.digest.event(event);
        self.sink.event(event);
    }
    fn recorded(&mut self, row: &Row, stream: &Stream) {
        self.digest.recorded(row, stream);
        self.sink.recorded(row, stream);
    }
}

/// What the log calls the origin of a record.
pub fn source_word(quality: Quality) -> &'static str {
    match quality {
        Quality::Simulated => "SIMULATED",
        _ => "controller",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::StopCause;

    #[test]
    fn a_stop_that_was_asked_ends_the_run_whatever_the_machine_and_the_link_are_doing() {
        let began = Instant::now();
        let after = |ms| began + Duration::from_millis(ms);
        // It brakes, and says that it stands: the office ends the run.
        let mut stopping = Stopping::at(began);
        for ms in (0..5000).step_by(5) {
            let state = if ms < 200 {
                State::Stopping(StopCause::Asked)
            } else {
                State::Stopped(StopCause::Asked)
            };
            assert_eq!(stopping.next(true, Some(state), after(ms)), Next::Wait);
        }
        // It was started again and stands ready; a moment of it is nothing.
        let mut stopping = Stopping::at(began);
        assert_eq!(stopping.next(true, Some(State::Ready), after(0)), Next::Wait);
        assert_eq!(stopping.next(true, Some(State::Running), after(400)), Next::Wait);
        assert_eq!(stopping.next(true, Some(State::Running), after(1000)), Next::AskAgain);
        assert_eq!(stopping.next(true, Some(State::Ready), after(1100)), Next::Wait);
        assert_eq!(stopping.next(true, Some(State::Ready), after(1600)), Next::IsOver);
        // Nobody is there; a cut that is over is none.
        let mut stopping = Stopping::at(began);
        assert_eq!(stopping.next(false, Some(State::Running), after(0)), Next::Wait);
        assert_eq!(
            stopping.next(true, Some(State::Stopping(StopCause::Asked)), after(300)),
            Next::Wait
        );
        assert_eq!(stopping.next(false, None, after(400)), Next::Wait);
        assert_eq!(stopping.next(false, None, after(900)), Next::IsCut);
    }
}

//! The simulated world: both halves on one thread, from one seed, as fast as it goes.
//!
//! Time is a tick count and noise comes from the seed, so the same configuration and program give the same bytes in every output:
//! [`Outcome::digest`] is one hash over all of them. Everything that leaves a world is marked SIMULATED.

pub mod measure;
pub mod pad;

pub use pad::ScriptedPad;

use crate::events::{Detail, detail};
use crate::faults::Fault;
use crate::office::{Answers, Ended, OfficeHalf, Operator};
use crate::sink::{RecordSink, RunDigest};
use crate::source::CommandSource;
use ledger::{Chain, Event, Hash};
use machine::{Counters, MachineParameters, PadState, ParameterError, Plant, Quality, RealtimeHalf, Request, Sample};
use serde_json::json;
use trace::record::{Recorder, Row, Stream};
use trace::survey::Found;
use units::{Machine, Millimetres, Point, Seconds, Tick, Timestamp, ToolNumber};

/// What a world is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldConfig {
    /// Decides every noise.
    pub seed: u64,
    /// The moment of tick 0.
    pub start: Timestamp,
    /// The machine.
    pub machine: MachineParameters,
    /// Its name in the log.
    pub machine_name: String,
    /// Where its axes stand.
    pub position: Point<Machine>,
    /// Hash of the program, for the log.
    pub program_hash: Hash,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// The person at the machine.
    pub operator: Operator,
    /// The log to go on with; the default begins a new one.
    pub chain: Chain,
}

impl Default for WorldConfig {
    /// Seed 1, 1970, a small machining centre at its home, nobody there, nothing wrong.
    fn default() -> Self {
        WorldConfig {
            seed: 1,
            start: Timestamp(0),
            machine: MachineParameters::small_machining_centre(),
            machine_name: "sim-mill".to_owned(),
            position: Point::ORIGIN,
            program_hash: Hash::default(),
            faults: Vec::new(),
            operator: Operator::default(),
            chain: Chain::default(),
        }
    }
}

/// A run from its first to its last tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub ended: Ended,
    /// The tick after the last.
    pub ticks: Tick,
    /// Simulated time.
    pub time: Seconds,
    /// Rows that went to the sink.
    pub samples: u64,
    /// Commands that the machine took.
    pub commands: u64,
    /// Commands that it still has: neither done nor thrown away.
    pub outstanding: u64,
    /// What it counted; [`Counters::completed`] of the commands are done.
    pub counters: Counters,
    /// Largest following error of any axis, mm.
    pub worst_following_error: f64,
    /// The end of the log.
    pub chain: Chain,
    /// One hash over all rows and events, in order.
    pub digest: Hash,
}

/// A machine and its office, simulated.
pub struct World<'a, S> {
    config: WorldConfig,
    // On the heap: its queues are large for a stack.
    realtime: Box<RealtimeHalf<Plant, ScriptedPad>>,
    office: OfficeHalf<'a, S>,
    now: Tick,
    start: Detail,
    begun: bool,
    samples: u64,
    worst_following_error: f64,
    digest: RunDigest,
}

impl<'a, S: CommandSource> World<'a, S> {
    /// A world in which nothing has happened yet.
    ///
    /// # Errors
    /// The machine's parameters make no machine.
    pub fn new(config: WorldConfig, source: S) -> Result<Self, ParameterError> {
        config.machine.check()?;
        let plant = Plant::new(&config.machine, config.position, config.seed);
        let mut realtime = Box::new(RealtimeHalf::with_pad(
            &config.machine,
            plant,
            ScriptedPad::default(),
            Quality::Simulated,
        ));
        realtime.request(Request::PowerOn);
        Ok(World {
            office: OfficeHalf::new(source, config.operator, config.start, config.chain),
            config,
            realtime,
            now: Tick(0),
            start: Detail::new(),
            begun: false,
            samples: 0,
            worst_following_error: 0.0,
            digest: RunDigest::default(),
        })
    }

    /// Does what the functions of the program say: its conditions are loaded into the machine, its recordings go to the sink.
    ///
    /// `found` is what a look through the program gave, and what `recorder` was made with. Conditions that find no place are told when
    /// their turn comes.
    pub fn with_functions(mut self, found: &Found, recorder: Recorder, diameters: &[(ToolNumber, Millimetres)]) -> Self {
        for (tool, diameter) in diameters {
            // More tools than it has places for: their cutting speeds are unavailable.
            self.realtime.know_tool(*tool, *diameter);
        }
        for (_, compiled) in &found.conditions {
            // The look through the program counted them against the machine's room already.
            let _ = self.realtime.watches().load(&compiled.watch());
        }
        self.office = self.office.with_functions(recorder);
        self
    }

    /// Says more in the run's first event.
    pub fn with_start(mut self, more: Detail) -> Self {
        self.start = more;
        self
    }

    /// Answers the program's questions other than the optional stop.
    pub fn answered_by(mut self, answers: Answers<'a>) -> Self {
        self.office = self.office.answered_by(answers);
        self
    }

    /// Puts a control pad at the machine, which shows what a script says: each state from its tick on, in order of ticks.
    pub fn with_pad(mut self, script: impl IntoIterator<Item = (Tick, PadState)>) -> Self {
        *self.realtime.pad_mut() = ScriptedPad::new(script);
        self
    }

    /// Runs to the end.
    pub fn run(&mut self, sink: &mut dyn RecordSink) -> Outcome {
        loop {
            if let Some(outcome) = self.advance(1_000, sink) {
                return outcome;
            }
        }
    }

    /// Runs for a number of ticks, or to the end: then it gives the outcome, and again each time it is asked.
    pub fn advance(&mut self, ticks: u64, sink: &mut dyn RecordSink) -> Option<Outcome> {
        let mut sink = Watched {
            sink,
            digest: &mut self.digest,
            samples: &mut self.samples,
            worst_following_error: &mut self.worst_following_error,
        };
        if !self.begun {
            self.begun = true;
            let mut data = detail(json!({
                "program_sha256": self.config.program_hash.to_string(),
                "seed": self.config.seed,
                "machine": self.config.machine_name,
                "source": "SIMULATED",
            }));
            data.append(&mut self.start);
            self.office.tell("job-started", self.now, data, &mut sink);
        }
        for _ in 0..ticks {
            if self.office.ended().is_some() {
                break;
            }
            let lost = disturb(&self.config.faults, self.now, &mut self.realtime);
            if lost > 0 {
                self.now += lost;
                continue;
            }
            if !stalled(&self.config.faults, self.now) {
                let realtime = &mut self.realtime;
                self.office.refill(|command| realtime.push(command));
                if let Some((_, compiled)) = self.office.to_load() {
                    let number = realtime.watches().load(&compiled.watch());
                    self.office.loaded(number);
                }
            }
            self.realtime.tick(self.now);
            let truth = self.realtime.drive().true_position();
            while let Some(report) = self.realtime.report() {
                while let Some(firing) = self.realtime.firing(report.sample.tick) {
                    self.office.fired(firing);
                }
                if let Some(request) = self.office.receive(&report, Some(truth), &mut sink) {
                    self.realtime.request(request);
                }
            }
            self.office.firings_lost(self.realtime.watches().counters().lost_firings);
            self.office.reports_lost(self.realtime.lost_reports(), self.now, &mut sink);
            self.now += 1;
        }
        self.outcome()
    }

    /// A request of a person at the machine, from outside the configuration.
    pub fn request(&mut self, request: Request) {
        self.realtime.request(request);
    }

    /// Somebody else stands at the machine from here on, or does something else.
    pub fn attended_by(&mut self, operator: Operator) {
        self.office.attended_by(operator);
    }

    /// The machine, to look at and to disturb.
    pub fn realtime(&mut self) -> &mut RealtimeHalf<Plant, ScriptedPad> {
        &mut self.realtime
    }

    /// The next tick.
    pub fn now(&self) -> Tick {
        self.now
    }

    /// Where the commands come from.
    pub fn source(&self) -> &S {
        self.office.source()
    }

    fn outcome(&self) -> Option<Outcome> {
        let controller = self.realtime.controller();
        self.office.ended().map(|ended| Outcome {
            ended: ended.clone(),
            ticks: self.now,
            time: self.now.seconds(),
            samples: self.samples,
            commands: self.office.commands(),
            outstanding: controller.outstanding(),
            counters: controller.counters(),
            worst_following_error: self.worst_following_error,
            chain: self.office.chain(),
            digest: self.digest.hash(),
        })
    }
}

/// Lets the faults of this tick happen; gives the number of servo cycles that are lost now.
fn disturb(faults: &[Fault], now: Tick, realtime: &mut RealtimeHalf<Plant, ScriptedPad>) -> u64 {
    let mut lost = 0;
    for fault in faults {
        let since = |at: Tick| (now >= at).then(|| now - at);
        match *fault {
            Fault::LostTicks { at, count } if now == at => lost = lost.max(u64::from(count)),
            Fault::EncoderGlitch { at, ticks, axis, pulses } => match since(at) {
                Some(0) => realtime.drive_mut().set_encoder_error(axis, pulses),
                Some(n) if n == ticks => realtime.drive_mut().set_encoder_error(axis, 0),
                _ => {}
            },
            Fault::FrictionSpike { at, ticks, axis, factor } => match since(at) {
                Some(0) => realtime.drive_mut().set_friction_factor(axis, factor),
                Some(n) if n == ticks => realtime.drive_mut().set_friction_factor(axis, 1.0),
                _ => {}
            },
            Fault::FeedHold { at, ticks } => match since(at) {
                Some(0) => realtime.request(Request::Hold),
                Some(n) if n == ticks => realtime.request(Request::CycleStart),
                _ => {}
            },
            Fault::ControlledStop { at } if now == at => realtime.request(Request::Stop),
            Fault::EmergencyStop { at } if now == at => realtime.drive_mut().set_emergency_stop(true),
            // The office's and the program's: see `stalled`, `faults::planted` and `measure`.
            Fault::LinkStall { .. } | Fault::ToolWear { .. } | Fault::SetupShift { .. } => {}
            Fault::LostTicks { .. } | Fault::ControlledStop { .. } | Fault::EmergencyStop { .. } => {}
        }
    }
    lost
}

fn stalled(faults: &[Fault], now: Tick) -> bool {
    faults
        .iter()
        .any(|fault| matches!(*fault, Fault::LinkStall { at, ticks } if now >= at && now - at < ticks))
}

/// The caller's sink, with the world looking on.
struct Watched<'s> {
    sink: &'s mut dyn RecordSink,
    digest: &'s mut RunDigest,
    samples: &'s mut u64,
    worst_following_error: &'s mut f64,
}

impl RecordSink for Watched<'_> {
    fn sample(&mut self, sample: &Sample) {
        *self.samples += 1;
        for k in 0..3 {
            let error = (sample.commanded[k] - sample.actual[k]).abs();
            *self.worst_following_error = self.worst_following_error.max(error);
        }
        self.digest.sample(sample);
        self.sink.sample(sample);
    }
    fn event(&mut self, event: &Event) {
        self.digest.event(event);
        self.sink.event(event);
    }
    fn truth(&mut self, sample: &Sample, position: [f64; 3]) {
        self.sink.truth(sample, position);
    }
    fn recorded(&mut self, row: &Row, stream: &Stream) {
        self.digest.recorded(row, stream);
        self.sink.recorded(row, stream);
    }
}

//! Threads and rigid taps go by the spindle's angle, whatever the spindle does.
//!
//! What pitch errors may be, when the spindle's acceleration jumps by A (turns/s^2). Between the commanded path and lead times the true angle
//! stand
//! - the encoder: a count, lead / 4096;
//! - the tracking filter, three poles at w = -ln 0.85 / 1 ms = 162/s: its angle is off by A t^2 exp(-wt) / 2, at most 0.27 A / w^2, and its
//!   speed by A (t + w t^2) exp(-wt), at most 0.84 A / w, and 3 A / w^2 in sum;
//! - the loop that takes out what path and angle are apart, with gain G: of an error of the speed it leaves at most 0.84 A / (w G), and never
//!   more than that sum;
//! - the axes, whose acceleration changes by 0.6 of their jerk J: a wanted jump by lead A is there after t = lead A / (0.6 J); lead A t^2 / 6 is
//!   lost until then, and as much again until it is won back.
//!
//! [`bound`] is their sum. A is the torque that brakes the spindle by its inertia.

#![allow(clippy::disallowed_methods, reason = "SEED picks one random run")]

use machine::Counters;
use machine::{
    Command, FaultCause, MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, SetPoint, SpindleCommand, State,
    StopCause, Tie,
};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use units::{Point, Rpm, StepId, Tick};

const T: f64 = 0.001;
/// The plan uses less than the axes have: 3000 mm/s^2 and 50 000 mm/s^3.
const A: f64 = 2500.0;
const J: f64 = 45_000.0;

/// Commanded path against true angle, mm, at a spindle speed (turns/s) and its acceleration that comes and goes at once (turns/s^2).
fn bound(lead: f64, turns_s: f64, turns_s2: f64) -> f64 {
    let jerk = 0.6 * 50_000.0;
    let w = -libm::log(0.85) / T;
    let gain = (0.35 * (jerk / (lead * turns_s) / 0.02).sqrt()).min(150.0);
    let late = lead * turns_s2 / jerk;
    let filter = 0.27 / (w * w) + (0.84 / (w * gain)).min(3.0 / (w * w));
    lead / 4096.0 + lead * turns_s2 * (filter + late * late / 3.0)
}

/// From rest to rest along Z with limited jerk.
fn stroke(from: f64, to: f64, at: f64, speed: f64, step: u64, tie: Option<Tie>) -> Vec<Command> {
    let (length, way) = ((to - from).abs(), (to - from).signum());
    // Jerk, no constant acceleration: 2 sqrt(v / j) while that is below the highest acceleration, else a trapezium.
    let ramp = if speed <= A * A / J {
        2.0 * (speed / J).sqrt()
    } else {
        speed / A + A / J
    };
    let top = if speed <= A * A / J { (speed * J).sqrt() } else { A };
    let rise = top / J;
    let up = |t: f64| {
        if t <= rise {
            (J * t * t * t / 6.0, J * t * t / 2.0, J * t)
        } else if t <= ramp - rise {
            let u = t - rise;
            let (s, v) = (J * rise * rise * rise / 6.0, J * rise * rise / 2.0);
            (s + v * u + top * u * u / 2.0, v + top * u, top)
        } else {
            let l = ramp - t;
            (
                speed * ramp / 2.0 - (speed * l - J * l * l * l / 6.0),
                speed - J * l * l / 2.0,
                J * l,
            )
        }
    };
    let total = length / speed + ramp;
    assert!(total > 2.0 * ramp, "a test's stroke");
    (1..=(total / T).ceil() as u32)
        .map(|n| {
            let t = (f64::from(n) * T).min(total);
            let (s, v, a) = if t < ramp {
                up(t)
            } else if t > total - ramp {
                let (s, v, a) = up(total - t);
                (length - s, v, -a)
            } else {
                (speed * (t - ramp / 2.0), speed, 0.0)
            };
            let v = if t == total { 0.0 } else { v };
            Command::SetPoint(SetPoint {
                position: [0.0, 0.0, from + way * s],
                velocity: [0.0, 0.0, way * v],
                acceleration: [0.0, 0.0, if t == total { 0.0 } else { way * a }],
                step: StepId(step as u32),
                path_length: at + s,
                path_speed: v,
                planned_override: if tie.is_some() { 0.0 } else { 1.0 },
                rapid: tie.is_none(),
                tie,
            })
        })
        .collect()
}

fn spindle(rpm: f64) -> Command {
    Command::Spindle {
        spindle: match rpm {
            0.0 => SpindleCommand::Stop,
            n if n > 0.0 => SpindleCommand::Clockwise(Rpm(n)),
            n => SpindleCommand::Counterclockwise(Rpm(-n)),
        },
        step: StepId(9),
    }
}

/// One row of what is looked at: tick, commanded and measured Z, the spindle's true turns and the step.
#[derive(Clone, Copy, Debug)]
struct Row {
    commanded: f64,
    actual: f64,
    turns: f64,
    step: u64,
    report: Report,
}

struct Bench {
    half: Box<RealtimeHalf<Plant>>,
    now: Tick,
    queue: VecDeque<Command>,
    rows: Vec<Row>,
    /// Braking torque on the spindle in each cycle, Nm.
    dips: Box<dyn FnMut(u64) -> f64>,
}

impl Bench {
    fn new(parameters: &MachineParameters, commands: Vec<Command>) -> Bench {
        let plant = Plant::new(parameters, Point::ORIGIN, 7);
        let mut bench = Bench {
            half: Box::new(RealtimeHalf::new(parameters, plant, Quality::Simulated)),
            now: Tick(0),
            queue: commands.into(),
            rows: Vec::new(),
            dips: Box::new(|_| 0.0),
        };
        bench.half.request(Request::PowerOn);
        bench
    }

    fn cycle(&mut self) -> Row {
        while self.half.controller().free() > 0
            && let Some(command) = self.queue.pop_front()
        {
            if let Err(back) = self.half.push(command) {
                self.queue.push_front(back);
                break;
            }
        }
        let dip = (self.dips)(self.now.0);
        self.half.drive_mut().set_spindle_dip(dip);
        self.half.tick(self.now);
        self.now += 1;
        let report = self.half.report().expect("each cycle has one");
        let row = Row {
            commanded: report.sample.commanded[2],
            actual: report.sample.actual[2],
            turns: self.half.drive().spindle_angle(),
            step: u64::from(report.sample.step.0),
            report,
        };
        self.rows.push(row);
        row
    }

    fn run_until(&mut self, longest: u64, what: &str, done: impl Fn(&Row) -> bool) -> Row {
        for _ in 0..longest {
            let row = self.cycle();
            if done(&row) {
                return row;
            }
        }
        panic!("{what}: not in {longest} ms: {:?}", self.rows.last());
    }

    fn run_to_end(&mut self) -> &mut Self {
        self.run_until(60_000, "end", |r| {
            r.report.state == State::Ready && r.report.counters.completed > 10
        });
        self
    }

    /// The state once the axes stand by themselves.
    fn comes_to(&mut self, longest: u64, state: State) -> Row {
        self.run_until(longest, &format!("{state:?}"), |r| r.report.state == state)
    }

    fn counters(&self) -> Counters {
        self.half.controller().counters()
    }

    /// Speed and acceleration are within the limits. The jerk is within 6 % (what holds and overrides may use) but for single cycles, where
    /// the plan uses all of it and the rate changes on top.
    #[track_caller]
    fn check_limits(&self, parameters: &MachineParameters, seed: u64) {
        let z = &parameters.axes[2];
        let p: Vec<f64> = self.rows.iter().map(|r| r.commanded).collect();
        let speeds = p.windows(2).map(|w| (w[1] - w[0]) / T / z.v_max.0);
        let accelerations = p.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]) / (T * T) / z.a_max.0);
        let jerks = p
            .windows(4)
            .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]) / (T * T * T) / z.j_max.0);
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |m: f64, v| m.max(v.abs()));
        let (v, a) = (most(&mut speeds.into_iter()), most(&mut accelerations.into_iter()));
        let over = jerks.clone().filter(|j| j.abs() > 1.06).count();
        let worst = most(&mut jerks.into_iter());
        assert!(v <= 1.0 && a <= 1.0, "seed {seed}: speed {v}, acceleration {a} of the limits");
        assert!(
            over * 500 <= p.len() && worst <= 1.4,
            "seed {seed}: jerk {worst} of its limit, {over} of {} cycles over",
            p.len()
        );
    }
}

fn dips(seed: u64, torque: f64) -> Box<dyn FnMut(u64) -> f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut now, mut until) = (0.0, 0);
    Box::new(move |tick| {
        if tick >= until {
            let part = (random.next_u32() % 1000) as f64 / 1000.0;
            now = if random.next_u32() % 3 == 0 { 0.0 } else { part * torque };
            until = tick + 20 + u64::from(random.next_u32() % 200);
        }
        // Chatter on top.
        now * (0.95 + 0.1 * f64::from(random.next_u32() % 1000) / 1000.0)
    })
}

fn seeds(count: u64) -> std::ops::Range<u64> {
    match std::env::var("SEED").ok().and_then(|s| s.parse().ok()) {
        Some(seed) => seed..seed + 1,
        None => 1..1 + count,
    }
}

/// Passes of a thread down to -40, each at another speed of going back, so that it begins anywhere.
fn passes(lead: f64, rpm: f64, count: u64, start: f64) -> Vec<Command> {
    let tie = Tie {
        lead,
        revolutions: rpm.abs() / 60.0,
        start: Some(start),
    };
    let mut program = vec![spindle(rpm)];
    for pass in 0..count {
        let at = 100.0 * pass as f64;
        program.extend(stroke(0.0, -40.0, at, tie.speed(), 10 + pass, Some(tie)));
        program.extend(stroke(-40.0, 0.0, at + 40.0, 37.0 + 11.3 * pass as f64, 9, None));
    }
    program.push(Command::End { step: StepId(9) });
    program
}

/// Commanded and measured phase (path less lead times angle) of the rows of a step between two depths, mm.
fn phases(bench: &Bench, step: u64, lead: f64, way: f64, depths: [f64; 2]) -> Vec<[f64; 2]> {
    let rows = bench
        .rows
        .iter()
        .filter(|r| r.step == step && (depths[0]..depths[1]).contains(&-r.commanded));
    rows.map(|r| [r.commanded, r.actual].map(|z| -z - lead * way * r.turns))
        .collect()
}

/// How far from the groove of whole turns a phase is, mm.
fn off_groove(phase: f64, lead: f64, start: f64) -> f64 {
    let turns = (phase + lead * start) / lead;
    (turns - turns.round()) * lead
}

#[test]
fn every_pass_meets_the_same_groove_and_keeps_its_pitch_whatever_sags() {
    for seed in seeds(24) {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x7a11);
        let mut pick = |from: f64, to: f64| from + (to - from) * f64::from(random.next_u32() % 10_000) / 1e4;
        let (lead, rpm, start) = (pick(0.5, 3.0), pick(300.0, 1500.0), pick(0.0, 1.0));
        let rpm = if seed % 2 == 0 { -rpm } else { rpm };
        let parameters = MachineParameters::small_machining_centre();
        let mut bench = Bench::new(&parameters, passes(lead, rpm, 3, start));
        // Up to 20 % slower: the drive holds its speed by inertia / response for each rad/s.
        let torque = 0.2 * rpm.abs() / 60.0 * TAU * parameters.spindle.inertia / parameters.spindle.response.0;
        bench.dips = dips(seed, torque);
        bench.run_to_end();
        let limit = bound(lead, rpm.abs() / 60.0, torque / parameters.spindle.inertia / TAU);
        let mut of_all: Vec<f64> = Vec::new();
        for pass in 0..3 {
            let found = phases(&bench, 10 + pass, lead, rpm.signum(), [12.0, 36.0]);
            assert!(found.len() > 100);
            let worst = found.iter().map(|p| off_groove(p[0], lead, start).abs()).fold(0.0, f64::max);
            let measured = found.iter().map(|p| off_groove(p[1], lead, start).abs()).fold(0.0, f64::max);
            of_all.extend(found.iter().map(|p| off_groove(p[0], lead, start)));
            assert!(worst <= limit, "seed {seed}: {worst} over {limit}");
            // The axis itself follows within some more.
            assert!(measured <= limit + 0.01, "seed {seed}: {measured}");
        }
        let (low, high) = of_all.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(high - low <= 2.0 * limit, "seed {seed}: passes {low} to {high}");
        bench.check_limits(&parameters, seed);
        assert_eq!((bench.counters().off_path_stops, bench.counters().starvations), (0, 0));
    }
}

fn tap(lead: f64, rpm: f64, depth: f64, holes: u64) -> Vec<Command> {
    let down = Tie {
        lead,
        revolutions: rpm.abs() / 60.0,
        start: Some(0.0),
    };
    let up = Tie { start: None, ..down };
    let mut program = vec![spindle(rpm)];
    for hole in 0..holes {
        let at = 1000.0 * hole as f64;
        program.extend(stroke(0.0, -depth, at, down.speed(), 10 + hole, Some(down)));
        program.push(spindle(-rpm));
        program.extend(stroke(-depth, 0.0, at + depth, up.speed(), 10 + hole, Some(up)));
        program.push(spindle(rpm));
    }
    program.push(Command::End { step: StepId(9) });
    program
}

#[test]
fn a_rigid_tap_follows_the_spindle_through_its_standstill_and_back() {
    for seed in seeds(24) {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x7a9);
        let mut pick = |from: f64, to: f64| from + (to - from) * f64::from(random.next_u32() % 10_000) / 1e4;
        let (lead, rpm, depth) = (pick(0.5, 2.0), pick(200.0, 1500.0), pick(15.0, 30.0));
        let rpm = if seed % 2 == 0 { -rpm } else { rpm };
        let parameters = MachineParameters::small_machining_centre();
        let mut bench = Bench::new(&parameters, tap(lead, rpm, depth, 2));
        let torque = 0.1 * rpm.abs() / 60.0 * TAU * parameters.spindle.inertia / parameters.spindle.response.0;
        bench.dips = dips(seed, torque);
        bench.run_to_end();
        let limit = bound(
            lead,
            rpm.abs() / 60.0,
            (torque / parameters.spindle.inertia + parameters.spindle.reversal) / TAU,
        );
        for hole in 0..2 {
            let found = phases(&bench, 10 + hole, lead, rpm.signum(), [depth * 0.5, f64::MAX]);
            let worst = found.iter().map(|p| off_groove(p[0], lead, 0.0).abs()).fold(0.0, f64::max);
            let deepest = bench
                .rows
                .iter()
                .filter(|r| r.step == 10 + hole)
                .map(|r| -r.commanded)
                .fold(0.0, f64::max);
            assert!(worst <= limit, "seed {seed}: {worst} over {limit}");
            assert!((deepest - depth).abs() < 0.2 * lead, "seed {seed}: {deepest} for {depth}");
        }
        bench.check_limits(&parameters, seed);
    }
}

/// The largest distance between path and angle of all rows of a step behind a depth, mm.
fn worst_phase(bench: &Bench, step: u64, lead: f64, depth: f64) -> f64 {
    let found = phases(bench, step, lead, 1.0, [depth, f64::MAX]);
    assert!(found.len() > 50);
    found.iter().map(|p| off_groove(p[0], lead, 0.0).abs()).fold(0.0, f64::max)
}

#[test]
fn a_hold_in_a_tap_acts_when_it_is_out_of_the_hole_and_the_spindle_override_does_nothing() {
    let parameters = MachineParameters::small_machining_centre();
    let mut bench = Bench::new(&parameters, tap(1.0, 600.0, 15.0, 1));
    bench.run_until(5000, "in the hole", |r| r.commanded < -8.0);
    bench.half.request(Request::Hold);
    bench.half.request(Request::Override(machine::Overrides {
        feed: 20,
        rapid: 20,
        spindle: 50,
    }));
    let row = bench.comes_to(10_000, State::Held);
    assert!(row.commanded.abs() < 1e-6, "{row:?}");
    let deepest = bench.rows.iter().map(|r| -r.commanded).fold(0.0, f64::max);
    assert!((deepest - 15.0).abs() < 0.2, "{deepest}");
    assert!(worst_phase(&bench, 10, 1.0, 2.0) < 0.01);
    bench.half.request(Request::CycleStart);
    bench.run_until(20_000, "end", |r| r.report.state == State::Ready);
}

#[test]
fn a_stop_in_a_thread_stops_spindle_and_axes_together() {
    for moment in [-4.0, -9.0] {
        let parameters = MachineParameters::small_machining_centre();
        let mut bench = Bench::new(&parameters, tap(1.0, 600.0, 25.0, 1));
        bench.run_until(5000, "in the hole", |r| r.commanded < moment);
        bench.half.request(Request::Stop);
        let row = bench.comes_to(2000, State::Stopped(StopCause::Asked));
        assert!(
            row.report.sample.spindle_speed.abs() < 5.0 && row.commanded > -25.0,
            "{row:?}"
        );
        // From where it was asked to the standstill, path and angle stay together.
        assert!(
            worst_phase(&bench, 10, 1.0, 2.0) < 0.02,
            "{}",
            worst_phase(&bench, 10, 1.0, 2.0)
        );
        bench.check_limits(&parameters, 0);
    }
}

#[test]
fn without_a_spindle_encoder_or_its_index_a_thread_is_a_fault_with_its_name_and_nothing_moves() {
    let mut blind = MachineParameters::small_machining_centre();
    blind.spindle.encoder_counts = 0.0;
    let mut bench = Bench::new(&blind, passes(1.0, 600.0, 1, 0.0));
    bench.comes_to(5000, State::Fault(FaultCause::SpindleAngle));
    assert!(bench.rows.iter().all(|r| r.commanded == 0.0));

    let parameters = MachineParameters::small_machining_centre();
    let mut bench = Bench::new(&parameters, passes(1.0, 600.0, 1, 0.0));
    bench.half.drive_mut().set_spindle_encoder_fault(false, true);
    bench.comes_to(5000, State::Fault(FaultCause::SpindleIndex));
    assert!(bench.rows.iter().all(|r| r.commanded == 0.0));
}

#[test]
fn a_spindle_or_an_encoder_that_is_lost_in_a_thread_is_a_fault_with_its_name() {
    type Break = fn(&mut Bench);
    let cases: [(Break, FaultCause); 3] = [
        (
            |b| b.half.drive_mut().set_spindle_encoder_fault(true, false),
            FaultCause::SpindleAngle,
        ),
        (
            |b| b.half.drive_mut().set_spindle_encoder_fault(false, true),
            FaultCause::SpindleIndex,
        ),
        (|b| b.dips = Box::new(|_| 15.0), FaultCause::SpindleLost),
    ];
    for (breaks, cause) in cases {
        let parameters = MachineParameters::small_machining_centre();
        let mut bench = Bench::new(&parameters, passes(1.0, 600.0, 1, 0.0));
        bench.run_until(5000, "in the thread", |r| r.commanded < -10.0);
        breaks(&mut bench);
        bench.comes_to(1000, State::Fault(cause));
        let row = bench.run_until(1000, "at rest", |r| r.report.sample.velocity[2].abs() < 1.0);
        assert_eq!(row.report.orders.spindle, SpindleCommand::Stop);
        assert!(row.actual > -20.0);
    }
}

#[test]
fn a_thread_that_never_reaches_its_lead_or_cannot_turn_round_is_refused_before_it_begins() {
    // A stroke of 1 mm has no room for 1500 rev/min to stop in.
    let mut program = vec![spindle(1500.0)];
    let down = Tie {
        lead: 1.0,
        revolutions: 25.0,
        start: Some(0.0),
    };
    program.extend(stroke(0.0, -3.0, 0.0, 25.0, 10, Some(down)));
    program.push(spindle(-1500.0));
    program.extend(stroke(-3.0, 0.0, 3.0, 25.0, 10, Some(Tie { start: None, ..down })));
    let parameters = MachineParameters::small_machining_centre();
    let mut bench = Bench::new(&parameters, program);
    bench.comes_to(5000, State::Stopped(StopCause::ThreadTooShort));
    assert!(bench.rows.iter().all(|r| r.commanded == 0.0));
    // The plan is slower than the lead from end to end.
    let mut program = vec![spindle(600.0)];
    let tie = Tie {
        lead: 3.0,
        revolutions: 10.0,
        start: Some(0.0),
    };
    program.extend(stroke(0.0, -10.0, 0.0, 20.0, 10, Some(tie)));
    let mut bench = Bench::new(&parameters, program);
    bench.comes_to(5000, State::Stopped(StopCause::ThreadTooShort));
    assert!(bench.rows.iter().all(|r| r.commanded == 0.0));
}

#[test]
fn an_emergency_stop_in_a_tap_acts_at_once() {
    let parameters = MachineParameters::small_machining_centre();
    for moment in [-5.0, -14.5] {
        let mut bench = Bench::new(&parameters, tap(1.0, 600.0, 15.0, 1));
        bench.run_until(5000, "in the hole", |r| r.commanded < moment);
        bench.half.drive_mut().set_emergency_stop(true);
        let row = bench.cycle();
        assert_eq!(
            (row.report.state, row.report.orders.spindle),
            (State::EmergencyStop, SpindleCommand::Stop)
        );
        bench.half.drive_mut().set_emergency_stop(false);
        bench.comes_to(10, State::EmergencyStopReleased);
        bench.run_until(3000, "at rest", |r| r.report.sample.velocity[2].abs() < 1.0);
        for _ in 0..200 {
            bench.cycle();
        }
        bench.queue.clear();
        bench.half.request(Request::Reset);
        bench.comes_to(10, State::Ready);
    }
}

#[test]
fn lost_cycles_in_a_thread_cost_no_pitch() {
    let parameters = MachineParameters::small_machining_centre();
    let mut bench = Bench::new(&parameters, passes(1.25, 800.0, 1, 0.0));
    for n in 0..60_000 {
        if n % 97 == 0 {
            bench.now += 3;
        }
        if bench.cycle().commanded < -39.0 {
            break;
        }
    }
    assert!(bench.counters().late_ticks > 50);
    // A step over four cycles is as long as four: what is commanded is late by the rounding of its middle.
    let worst = worst_phase(&bench, 10, 1.25, 12.0);
    assert!(worst < 0.01, "{worst}");
}

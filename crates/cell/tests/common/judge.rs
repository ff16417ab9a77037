//! What a machine over a link was told, held against the plan.
#![allow(dead_code, reason = "each test uses a part of it")]

use cell::link::channel::Damage;
use cell::link::world::{LinkFault, LinkedConfig, LinkedWorld};
use cell::source::Planned;
use cell::{Ended, Output};
use machine::{Command, MachineParameters, Report, SetPoint, State};

pub fn machine() -> MachineParameters {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = units::Seconds(0.3);
    machine
}

/// The set-points of a plan, in order.
pub fn set_points(program: &Planned) -> Vec<SetPoint> {
    let commands = program.outputs.iter().filter_map(|o| match o {
        Output::Command(Command::SetPoint(s)) => Some(*s),
        _ => None,
    });
    commands.collect()
}

/// The tolerance of a workingstep that says nothing, mm.
pub const TOLERANCE: f64 = 0.05;

/// What the machine was told, held against the plan.
#[derive(Debug, Default)]
pub struct Verdict {
    pub ended: Option<Ended>,
    pub ticks: u64,
    /// Rows in which the machine was given a new place: a set-point of the plan, bit by bit; one on its path at a scaled time; one within
    /// the tolerance; on the way back after drives had stopped by themselves; beside it.
    pub bit_equal: u64,
    pub scaled: u64,
    pub within: u64,
    pub approaching: u64,
    pub beside: u64,
    /// How far the furthest of `scaled` is from the path, mm, and of `approaching`.
    pub furthest: f64,
    pub furthest_back: f64,
    /// Cycles of the plan that were passed over, and gone back to, at most.
    pub skipped: f64,
    pub back: f64,
    /// Acceleration of the commanded places over the axis's limit, at most.
    pub acceleration: f64,
    pub off_path_stops: u64,
    pub stops: u64,
    pub resumed: u64,
    pub approaches: u64,
    pub left_alone: u64,
    pub too_late: u64,
    /// Cycles of the plan that were not come to.
    pub left: u64,
}

/// Follows the commanded places along a plan.
pub struct Judge<'a> {
    plan: &'a [SetPoint],
    /// Cycles of the plan behind the machine: 0 is where it stood.
    pub phase: f64,
    before: Option<Report>,
    /// What moves is no plan: the machine looks for its references.
    by_hand: bool,
    speed: [f64; 3],
    pub verdict: Verdict,
}

impl<'a> Judge<'a> {
    pub fn new(plan: &'a [SetPoint]) -> Self {
        Judge {
            plan,
            phase: 0.0,
            before: None,
            by_hand: true,
            speed: [f64::NAN; 3],
            verdict: Verdict::default(),
        }
    }

    /// Where a place is on the plan near the present phase, and how far beside it, mm.
    fn locate(&self, p: [f64; 3]) -> (f64, f64) {
        let from = (self.phase as usize).saturating_sub(3);
        let mut best = (self.phase, f64::INFINITY);
        let place = |n: usize| if n == 0 { [0.0; 3] } else { self.plan[n - 1].position };
        for n in from..(from + 720).min(self.plan.len()) {
            let (a, b) = (place(n), place(n + 1));
            let d: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
            let t: [f64; 3] = std::array::from_fn(|k| p[k] - a[k]);
            let length: f64 = d.iter().map(|x| x * x).sum();
            let u = if length > 0.0 {
                (0..3).map(|k| t[k] * d[k]).sum::<f64>() / length
            } else {
                0.0
            };
            let u = u.clamp(0.0, 1.0);
            let off: [f64; 3] = std::array::from_fn(|k| t[k] - u * d[k]);
            let beside = off.iter().map(|x| x * x).sum::<f64>().sqrt();
            if beside < best.1 - 1e-9 {
                best = (n as f64 + u, beside);
            }
            // There, and the path may come by again.
            if beside < 1e-7 && n as f64 + 1.0 >= self.phase {
                break;
            }
        }
        best
    }

    pub fn see(&mut self, report: &Report) {
        let v = &mut self.verdict;
        v.ticks = report.sample.tick.0;
        v.off_path_stops = report.counters.off_path_stops;
        // Drives that were left alone for too long stop by themselves, and not on the path.
        v.left_alone += u64::from(matches!(
            report.state,
            State::Fault(machine::FaultCause::Drive | machine::FaultCause::Away { .. })
        ));
        let begins = |s: State| {
            matches!(
                s,
                State::Holding | State::Stopping(_) | State::Held | State::WaitingThenHold(_)
            )
        };
        let stopped = self.before.is_some_and(|b| !begins(b.state)) && begins(report.state);
        v.stops += u64::from(stopped);
        let p = report.sample.commanded;
        let moves = self.before.is_some_and(|b| b.sample.commanded != p);
        let follows = self.before.is_some_and(|b| report.sample.tick - b.sample.tick == 1);
        self.by_hand = match report.state {
            State::Off | State::Ready | State::NotHomed | State::Homing { .. } => true,
            // However it came to it.
            State::Stopping(_) | State::Stopped(_) | State::Fault(_) => self.by_hand,
            _ => false,
        };
        if report.orders.mode == machine::DriveMode::Follow && !self.by_hand && moves {
            let (phase, beside) = self.locate(p);
            let index = phase.round() as usize;
            let equal = phase > 0.5 && self.plan[index - 1].position.map(f64::to_bits) == p.map(f64::to_bits);
            let v = &mut self.verdict;
            if equal {
                v.bit_equal += 1;
            } else if beside < 0.002 {
                v.scaled += 1;
                v.furthest = v.furthest.max(beside);
            } else if v.left_alone > 0 && beside > TOLERANCE {
                v.approaching += 1;
                v.furthest_back = v.furthest_back.max(beside);
            } else if beside <= TOLERANCE {
                v.within += 1;
                v.furthest = v.furthest.max(beside);
            } else {
                v.beside += 1;
                v.furthest = v.furthest.max(beside);
            }
            if beside < 0.002 && v.left_alone == 0 {
                v.skipped = v.skipped.max(phase - self.phase - 1.0);
                v.back = v.back.max(self.phase - phase);
            }
            if beside < 0.002 {
                self.phase = phase;
            }
        }
        // A controller that was started again stands where its encoders say, and the plan is held against that: near a rest a micrometre is
        // a few cycles.
        if report.orders.mode != machine::DriveMode::Follow && moves {
            let (phase, beside) = self.locate(p);
            if beside < TOLERANCE {
                self.phase = self.phase.min(phase);
            }
        }
        let speed: [f64; 3] = match self.before {
            Some(b) if follows => std::array::from_fn(|k| (p[k] - b.sample.commanded[k]) / 0.001),
            _ => [f64::NAN; 3],
        };
        let v = &mut self.verdict;
        for (now, before) in speed.iter().zip(self.speed) {
            // Not a number where a cycle is missing: then nothing can be said.
            let ratio = ((now - before) / 0.001).abs() / 3000.0;
            if report.orders.mode == machine::DriveMode::Follow {
                v.acceleration = v.acceleration.max(ratio);
            }
        }
        self.speed = speed;
        self.before = Some(*report);
    }
}

pub fn machined(faults: Vec<LinkFault>, seed: u64, delay: (u64, u64), tell: bool) -> Verdict {
    machined_of(&crate::common::small_program(), faults, seed, delay, tell)
}

pub fn machined_of(program: &Planned, faults: Vec<LinkFault>, seed: u64, delay: (u64, u64), tell: bool) -> Verdict {
    let config = LinkedConfig {
        machine: machine(),
        seed,
        delay,
        batch: 10,
        faults,
        restarts: 5,
        ..LinkedConfig::default()
    };
    machined_in(config, program, tell, |_| {})
}

/// The same in any world; `each` sees it before every cycle.
pub fn machined_in(
    config: LinkedConfig,
    program: &Planned,
    tell: bool,
    mut each: impl FnMut(&mut LinkedWorld<'_, Planned>),
) -> Verdict {
    let plan = set_points(program);
    let mut world = LinkedWorld::new(config, || program.clone());
    let mut judge = Judge::new(&plan);
    let mut ended = None;
    let mut before = State::Off;
    while ended.is_none() && world.now().0 < 90_000 {
        each(&mut world);
        judge.verdict.left_alone += world.left_alone;
        let mut seen = |report: &Report| {
            if tell && report.state != before {
                println!(
                    "{:6} {:?} at {:?}",
                    report.sample.tick.0, report.state, report.sample.commanded
                );
                before = report.state;
            }
            judge.see(report);
        };
        ended = world.advance(&mut (), &mut seen);
    }
    if tell {
        println!(
            "{:?} at {}\n{:?}\n{:?}",
            ended,
            world.now().0,
            world.sender().map(|s| s.status()),
            world.follower().status()
        );
    }
    let left = (plan.len() as f64 - judge.phase).round() as u64;
    let mut v = judge.verdict;
    v.left = left;
    v.ended = ended;
    v.too_late = world.follower().too_late();
    (v.resumed, v.approaches) = world.resumed();
    v
}

pub fn kind(fault: &LinkFault) -> &'static str {
    match fault {
        LinkFault::Cut { noticed: true, .. } => "cut, noticed",
        LinkFault::Cut { noticed: false, .. } => "cut, only silence",
        LinkFault::Stall { ticks: ..=100, .. } => "stall of at most 100 ms",
        LinkFault::Stall { .. } => "stall of more than 100 ms",
        LinkFault::Damaged { damage, .. } => match damage {
            Damage::Bit => "a bit",
            Damage::Bytes => "corrupted bytes",
            Damage::Twice => "duplicated bytes",
            Damage::Missing => "missing bytes",
            Damage::Swapped => "reordered bytes",
        },
        LinkFault::SenderKilled { .. } => "sender killed",
        LinkFault::ControllerRestarted { orderly: true, .. } => "controller restarted, asked to",
        LinkFault::ControllerRestarted { orderly: false, .. } => "controller killed",
        LinkFault::LateTicks { .. } => "late ticks",
    }
}

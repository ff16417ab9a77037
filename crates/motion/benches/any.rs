//! Random programs under a limit of jerk: `cargo bench -p motion --bench any -- COUNT FIRST_SEED`.
//!
//! Lines, arcs, helices, dense chords, tiny moves, reversals and scans in all path modes, with limits alike or per axis. Looks at the
//! set-points as an outsider would: backward differences for speed, acceleration and jerk, and the last point. A limit that is exceeded by
//! more than 0.1 % is printed and makes the exit code 1.
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock and its arguments"
)]

#[path = "../tests/support/mod.rs"]
mod support;

use motion::Limits;
use plan::{Arc, Path, PathMode, StepKind};
use std::f64::consts::TAU;
use support::{feed_move, line, plan, program};
use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, Radians, Vector};

struct Dice(u64);

impl Dice {
    fn throw(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z ^ (z >> 31)
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.throw() >> 11) as f64 / (1u64 << 53) as f64
    }
    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[(self.throw() % list.len() as u64) as usize]
    }
}

struct Program {
    steps: Vec<StepKind>,
    at: [f64; 3],
    feed: f64,
}

impl Program {
    fn line(&mut self, to: [f64; 3]) {
        let to = to.map(|c| libm::round(c * 1e5) / 1e5);
        if to != self.at {
            self.steps.push(feed_move(line(self.at, to), self.feed));
        }
        self.at = to;
    }
    fn arc(&mut self, radius: f64, begin: f64, sweep: f64, rise: f64) {
        let [x, y, z] = self.at;
        let path = Path::Arc(Arc {
            from: Point::from_xyz(self.at),
            centre: Point::new(x - radius * libm::cos(begin), y - radius * libm::sin(begin), z),
            normal: Vector::Z,
            sweep: Radians(sweep),
            rise,
        });
        self.at = path.end().xyz;
        self.steps.push(feed_move(path, self.feed));
    }
}

fn any(dice: &mut Dice) -> (&'static str, Program) {
    let kind = dice.of(&["lines", "dense", "arcs", "helix", "tiny", "back", "scan", "mixed"]);
    let p = dice.of(&[0.0, 0.001, 0.01, 0.05, 0.5]);
    let mode = dice.of(&[PathMode::ExactPath, PathMode::ExactStop, PathMode::Tolerance(None)]);
    let within = PathMode::Tolerance((p > 0.0).then_some(Millimetres(p)));
    let mode = if dice.between(0.0, 1.0) < 0.6 { within } else { mode };
    let mut program = Program {
        steps: vec![StepKind::PathMode(mode)],
        at: [0.0; 3],
        feed: dice.of(&[60.0, 600.0, 3000.0, 6000.0, 15000.0, 30000.0]),
    };
    let count = 1 + (dice.throw() % 39) as usize;
    let off = |program: &Program, x: f64, y: f64, z: f64| [program.at[0] + x, program.at[1] + y, program.at[2] + z];
    match kind {
        "lines" => {
            for _ in 0..count {
                let z = if dice.between(0.0, 1.0) < 0.5 {
                    0.0
                } else {
                    dice.between(-5.0, 5.0)
                };
                let to = off(&program, dice.between(-30.0, 30.0), dice.between(-30.0, 30.0), z);
                program.line(to);
            }
        }
        "dense" => {
            let (a, b, c) = (dice.between(2.0, 40.0), dice.between(2.0, 30.0), dice.between(0.0, 5.0));
            let (f, g) = (dice.of(&[1.0, 2.0, 3.0]), dice.of(&[1.0, 2.0, 3.0]));
            let step = dice.of(&[0.02, 0.1, 0.3]);
            let curve = |u: f64| {
                [
                    a * libm::sin(f * u),
                    b * (libm::sin(g * u + 0.5) - libm::sin(0.5)),
                    c * (libm::cos(3.0 * u) - 1.0),
                ]
            };
            let mut u = 0.0;
            for _ in 0..50 + dice.throw() % 1450 {
                let (p, q) = (curve(u), curve(u + 1e-4));
                let speed = (0..3).map(|k| (q[k] - p[k]) * (q[k] - p[k])).sum::<f64>().sqrt() / 1e-4;
                u += step / speed.max(0.5);
                program.line(curve(u));
            }
        }
        "arcs" => {
            for _ in 0..count % 8 + 1 {
                let radius = dice.of(&[0.1, 0.5, 2.0, 5.0, 20.0, 80.0]);
                let sweep = dice.of(&[-1.0, 1.0]) * dice.between(0.1, 6.2);
                program.arc(radius, dice.between(0.0, TAU), sweep, 0.0);
            }
        }
        "helix" => {
            let sweep = dice.of(&[-1.0, 1.0]) * dice.between(0.5, 6.2);
            let radius = dice.of(&[1.0, 5.0, 20.0]);
            program.arc(radius, dice.between(0.0, TAU), sweep, dice.between(-5.0, 5.0));
            let to = off(&program, 10.0, 0.0, 0.0);
            program.line(to);
        }
        "tiny" => {
            for _ in 0..count * 5 {
                let size = dice.of(&[1e-4, 1e-3, 0.01, 0.1, 1.0, 20.0]);
                let to = off(&program, dice.between(-size, size), dice.between(-size, size), 0.0);
                program.line(to);
            }
        }
        "back" => {
            for k in 0..count {
                let way = dice.of(&[0.05, 1.0, 10.0, 50.0]) * if k % 2 == 1 { 1.0 } else { -1.0 };
                let to = off(&program, way, 0.0, 0.0);
                program.line(to);
            }
        }
        "scan" => {
            for row in 0..3 {
                for k in 0..60 {
                    let x = 0.3 * f64::from(if row % 2 == 0 { k } else { 59 - k });
                    let y = f64::from(row);
                    program.line([x, y, 2.0 * libm::sin(x / 3.0) * libm::cos(y)]);
                }
            }
        }
        _ => {
            for _ in 0..count {
                match dice.throw() % 20 {
                    0 => program.steps.push(StepKind::PathMode(PathMode::ExactPath)),
                    1 => program.steps.push(StepKind::PathMode(PathMode::ExactStop)),
                    2 => program.steps.push(StepKind::PathMode(within)),
                    3 => program.feed = dice.of(&[300.0, 9000.0]),
                    _ => {}
                }
                if dice.between(0.0, 1.0) < 0.5 {
                    let to = off(&program, dice.between(-10.0, 10.0), dice.between(-10.0, 10.0), 0.0);
                    program.line(to);
                } else {
                    let sweep = dice.of(&[-1.0, 1.0]) * dice.between(0.1, 6.2);
                    let radius = dice.of(&[0.3, 3.0, 15.0]);
                    program.arc(radius, dice.between(0.0, TAU), sweep, 0.0);
                }
            }
        }
    }
    (kind, program)
}

fn main() -> std::process::ExitCode {
    let mut numbers = std::env::args().skip(1).filter_map(|a| a.parse::<u64>().ok());
    let (count, first) = (numbers.next().unwrap_or(60), numbers.next().unwrap_or(0));
    let all = std::env::args().any(|a| a == "all");
    let (mut over, mut slow) = (0, vec![]);
    for seed in first..first + count {
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1);
        let (kind, any) = any(&mut dice);
        let alike = dice.between(0.0, 1.0) < 0.5;
        let mut each = |one: f64, list: &[f64]| -> [f64; 3] {
            if alike {
                [one; 3]
            } else {
                std::array::from_fn(|_| dice.of(list))
            }
        };
        let v = each(500.0, &[100.0, 300.0, 500.0]);
        let a = each(3000.0, &[500.0, 2000.0, 3000.0, 8000.0]);
        let j = each(50_000.0, &[5000.0, 50_000.0, 300_000.0]);
        let tolerance = dice.of(&[0.001, 0.01, 0.05]);
        let limits = Limits {
            v_max: v.map(MmPerSec),
            a_max: a.map(MmPerSec2),
            j_max: Some(j.map(MmPerSec3)),
            tolerance: Millimetres(tolerance),
        };
        let (moves, end) = (any.steps.len() - 1, any.at);
        let began = std::time::Instant::now();
        let planned = plan(program(any.steps), [0.0; 3], limits);
        let took = began.elapsed().as_secs_f64();
        let s = planned.statistics;
        let worst = [
            s.worst_speed_ratio,
            s.worst_acceleration_ratio,
            s.worst_jerk_ratio.unwrap_or(0.0),
        ];
        let last = planned.points.last().map_or([0.0; 3], |p| p.position);
        let ends = (0..3).all(|k| (last[k] - end[k]).abs() < 1e-6);
        let good = worst.iter().all(|w| *w <= 1.001) && ends;
        over += u64::from(!good);
        slow.push((s.blocks as f64 / took, s.time.0 / took, kind, seed));
        if !good || all {
            println!(
                "seed {seed} {kind}: {moves} moves, {:.3} s, v {:.4} a {:.4} j {:.4}, deviation {:.4}, {:.0} blocks/s, {:.1} times real time{}",
                s.time.0,
                worst[0],
                worst[1],
                worst[2],
                s.max_deviation.0,
                s.blocks as f64 / took,
                s.time.0 / took,
                if ends { "" } else { ", NOT AT THE END" },
            );
        }
    }
    slow.sort_by(|a, b| a.0.total_cmp(&b.0));
    println!("{over} of {count} over a limit; fewest blocks a second:");
    for (blocks, real, kind, seed) in slow.iter().take(8) {
        println!("  {blocks:.0} ({real:.1} times real time): {kind}, seed {seed}");
    }
    if over == 0 {
        std::process::ExitCode::SUCCESS
    } else {
        std::process::ExitCode::FAILURE
    }
}

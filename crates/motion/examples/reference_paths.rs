//! Cycle times on the six reference paths, beside the time-optimal reference and LinuxCNC: `cargo run --release -p motion --example
//! reference_paths`.
//!
//! Machine: 500 mm/s, 3000 mm/s^2 per axis, tolerance 0.01 mm. References: TOPP-RA (v, a limits, exact path) and LinuxCNC 2.9
//! (G64 P0.01 Q0) as measured for this project; seconds.
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "an example that measures itself reads a clock"
)]

#[path = "../tests/support/mod.rs"]
mod support;

use plan::{Arc, Path, PathMode, StepKind};
use std::f64::consts::PI;
use support::{feed_move, jerk_limited, line, plan, polyline, program};
use units::{Millimetres, Point, Radians, Vector};

fn arc(from: [f64; 3], centre: [f64; 3], sweep: f64) -> Path<units::Setup> {
    Path::Arc(Arc {
        from: Point::from_xyz(from),
        centre: Point::from_xyz(centre),
        normal: Vector::Z,
        sweep: Radians(sweep),
        rise: 0.0,
    })
}

/// Chords of equal length along a curve, rounded to 5 decimals.
fn chords(curve: impl Fn(f64) -> [f64; 3], end: f64, step: f64) -> Vec<[f64; 3]> {
    let fine = 2_000_000;
    let round = |p: [f64; 3]| p.map(|c| (c * 1e5).round() / 1e5);
    let mut points = vec![round(curve(0.0))];
    let (mut last, mut length) = (curve(0.0), 0.0);
    for k in 1..=fine {
        let p = curve(end * f64::from(k) / f64::from(fine));
        length += ((p[0] - last[0]).powi(2) + (p[1] - last[1]).powi(2) + (p[2] - last[2]).powi(2)).sqrt();
        last = p;
        if length >= step {
            points.push(round(p));
            length -= step;
        }
    }
    points.push(round(curve(end)));
    points
}

fn main() {
    let tolerance = PathMode::Tolerance(Some(Millimetres(0.01)));
    let spiral = chords(
        |u| {
            let r = 2.0 + 2.0 * u / (2.0 * PI);
            [r * u.cos(), r * u.sin(), 0.0]
        },
        23.0 * PI,
        0.1,
    );
    let liss = chords(
        |u| [40.0 * u.sin(), 25.0 * (2.0 * u + 0.5).sin(), 5.0 * (3.0 * u).cos()],
        2.0 * PI,
        0.1,
    );
    let mut scan = vec![];
    for row in 0..=10 {
        for k in 0..=300 {
            let k = if row % 2 == 0 { k } else { 300 - k };
            let (x, y) = (f64::from(k) * 0.2, f64::from(row));
            scan.push([x, y, 2.0 * (2.0 * PI * x / 20.0).sin() * (2.0 * PI * y / 30.0).cos()]);
        }
    }
    let zig: Vec<[f64; 3]> = (0..=10)
        .map(|k| [10.0 * f64::from((k + 1) / 2), 10.0 * f64::from(k / 2), 0.0])
        .collect();
    let rsq = |feed: f64| -> Vec<StepKind> {
        let q = PI / 2.0;
        let paths = vec![
            line([5., 0., 0.], [55., 0., 0.]),
            arc([55., 0., 0.], [55., 5., 0.], q),
            line([60., 5., 0.], [60., 55., 0.]),
            arc([60., 55., 0.], [55., 55., 0.], q),
            line([55., 60., 0.], [5., 60., 0.]),
            arc([5., 60., 0.], [5., 55., 0.], q),
            line([0., 55., 0.], [0., 5., 0.]),
            arc([0., 5., 0.], [5., 5., 0.], q),
        ];
        paths.into_iter().map(|p| feed_move(p, feed)).collect()
    };
    let circ = |feed: f64| vec![feed_move(arc([20., 0., 0.], [0.; 3], 2.0 * PI), feed)];

    println!("path    feed   blocks    time   TOPP-RA  ratio  LinuxCNC  deviation  v ratio  a ratio  j ratio  blocks/s");
    for (feed, references) in [
        (
            6000.0,
            [
                (2.347, 2.407),
                (1.290, 1.392),
                (9.799, 10.068),
                (2.846, 3.046),
                (7.568, 7.653),
                (1.294, 1.360),
            ],
        ),
        (
            30000.0,
            [
                (1.061, 1.173),
                (0.583, 0.858),
                (4.617, 10.412),
                (1.131, 3.067),
                (4.649, 6.346),
                (1.116, 1.197),
            ],
        ),
    ] {
        let cases = [
            ("rsq", [5., 0., 0.], rsq(feed)),
            ("circ", [20., 0., 0.], circ(feed)),
            ("spiral", spiral[0], polyline(&spiral, feed, tolerance)),
            ("liss", liss[0], polyline(&liss, feed, tolerance)),
            ("scan", scan[0], polyline(&scan, feed, tolerance)),
            ("zig", zig[0], polyline(&zig, feed, tolerance)),
        ];
        for ((name, start, steps), (optimum, linuxcnc)) in cases.into_iter().zip(references) {
            if std::env::args().nth(1).is_some_and(|only| only != name) {
                continue;
            }
            let began = std::time::Instant::now();
            let planned = plan(program(steps), start, jerk_limited(0.01));
            let took = began.elapsed().as_secs_f64();
            let s = planned.statistics;
            println!(
                "{name:7} {feed:5.0} {:8} {:7.3} {optimum:8.3} {:7.3} {linuxcnc:8.3} {:10.4} {:8.5} {:8.5} {:8.5} {:9.0}",
                s.blocks,
                s.time.0,
                s.time.0 / optimum,
                s.max_deviation.0,
                s.worst_speed_ratio,
                s.worst_acceleration_ratio,
                s.worst_jerk_ratio.unwrap_or(0.0),
                s.blocks as f64 / took
            );
        }
    }
}

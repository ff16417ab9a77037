//! Cycle times on the six reference paths under a limit of jerk, beside the references and LinuxCNC: `cargo bench -p motion --bench planner`;
//! with `-- --picture F.svg` speed, acceleration and jerk over time are drawn; `-- --blocks N` streams N blocks of 0.1 mm instead and prints
//! the memory on the way.
//!
//! Machine: 500 mm/s, 3000 mm/s^2, 50 000 mm/s^3 per axis, tolerance 0.01 mm. References, seconds: TOPP-RA (speed and acceleration only,
//! exact path, so a lower bound without a limit of jerk); a sequential linear program under speed, acceleration and jerk over the exact
//! curve, where there is one (for the scan: its rows from rest to rest, its links as exact stops, less the overlap of 20 corners); our own
//! planner on the smoothed path with a grid four times as fine and all of the limits, which agrees with the sequential linear program to
//! 0.6 % where there is one, or the exit code is 1; LinuxCNC 2.9, which limits no jerk, with the better of its two settings; and LinuxCNC
//! 2.10 with its limit of jerk, where it was measured. A limit that is not kept, or a time above what the planner has to reach, makes the
//! exit code 1 too.
//!
//! Blocks a second are of the processor's time, which other work on the machine lengthens too, but less than the clock's.
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock and writes a picture"
)]

#[path = "../tests/support/mod.rs"]
mod support;

use motion::Trajectory;
use plan::{Arc, Path, PathMode, StepKind};
use std::f64::consts::PI;
use support::{Generated, Planned, all_of, feed_move, jerk_limited, line, plan, polyline, program, reference};
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

fn main() -> std::process::ExitCode {
    let blocks = std::env::args().skip_while(|a| a != "--blocks").nth(1);
    if let Some(blocks) = blocks.and_then(|n| n.parse().ok()) {
        return stream(blocks);
    }
    let picture = std::env::args().skip_while(|a| a != "--picture").nth(1);
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

    println!(
        "path     feed blocks   time  no jerk TOPP-RA jerk ref  ratio fine grid  ratio LinuxCNC 2.9 2.10 jerk to reach deviation v ratio a ratio j ratio blocks/s"
    );
    let mut drawn = String::new();
    let mut good = true;
    for (feed, rows) in [(6000.0, &ROWS_6000), (30000.0, &ROWS_30000)] {
        let cases = [
            ("rsq", [5., 0., 0.], rsq(feed)),
            ("circ", [20., 0., 0.], circ(feed)),
            ("spiral", spiral[0], polyline(&spiral, feed, tolerance)),
            ("liss", liss[0], polyline(&liss, feed, tolerance)),
            ("scan", scan[0], polyline(&scan, feed, tolerance)),
            ("zig", zig[0], polyline(&zig, feed, tolerance)),
        ];
        for ((name, start, steps), row) in cases.into_iter().zip(rows) {
            let began = processor_time();
            let planned = plan(program(steps.clone()), start, jerk_limited(0.01));
            let took = processor_time() - began;
            let fine = Trajectory::new(Box::new(program(steps.clone())), Point::from_xyz(start), jerk_limited(0.01));
            let fine = all_of(fine.with_fine_grid(4.0)).statistics.time.0;
            let without = plan(program(steps), start, reference(0.01)).statistics.time.0;
            let s = planned.statistics;
            let (time, jerk) = (s.time.0, s.worst_jerk_ratio.unwrap_or(0.0));
            let reference = row.jerk.map_or("-".to_owned(), |j| format!("{j:.3}"));
            let ratio = row.jerk.map_or("-".to_owned(), |j| format!("{:.4}", time / j));
            let kept = [s.worst_speed_ratio, s.worst_acceleration_ratio, jerk]
                .iter()
                .all(|r| *r <= 1.001)
                && s.max_deviation.0 <= 0.01;
            let reached = row.to_reach.is_none_or(|most| time <= most) && time <= 1.05 * fine;
            let agrees = name == "scan" || row.jerk.is_none_or(|j| (fine / j - 1.0).abs() < 0.006);
            good &= kept && reached && agrees;
            println!(
                "{name:7} {feed:5.0} {:6} {time:6.3} {without:8.3} {:7.3} {reference:>8} {ratio:>6} {fine:9.3} {:6.4} {:12.3} {:>9} {:>8} {:9.4} {:7.4} {:7.4} {jerk:7.4} {:8.0}{}{}{}",
                s.blocks,
                row.toppra,
                time / fine,
                row.linuxcnc,
                row.linuxcnc_jerk.map_or("-".to_owned(), |t| format!("{t:.3}")),
                row.to_reach.map_or("-".to_owned(), |m| format!("{m:.3}")),
                s.max_deviation.0,
                s.worst_speed_ratio,
                s.worst_acceleration_ratio,
                s.blocks as f64 / took,
                if kept { "" } else { "  LIMIT NOT KEPT" },
                if reached { "" } else { "  TOO SLOW" },
                if agrees { "" } else { "  REFERENCES DIFFER" },
            );
            draw(&mut drawn, &format!("{name} F{feed:.0}: {time:.3} s"), &planned);
        }
    }
    if let Some(name) = picture {
        let rows = drawn.matches("<g ").count();
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1240\" height=\"{}\" font-family=\"sans-serif\" font-size=\"11\"><rect \
             width=\"100%\" height=\"100%\" fill=\"white\"/>{drawn}</svg>\n",
            rows.div_ceil(3) * 130
        );
        if let Err(error) = std::fs::write(&name, svg) {
            println!("{name}: {error}");
            good = false;
        }
    }
    if good {
        std::process::ExitCode::SUCCESS
    } else {
        std::process::ExitCode::FAILURE
    }
}

/// Seconds that the processor has worked for this process.
fn processor_time() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let nanoseconds: Option<f64> = stat.split(' ').next().and_then(|n| n.parse().ok());
    nanoseconds.map_or_else(
        || std::time::SystemTime::UNIX_EPOCH.elapsed().map_or(0.0, |t| t.as_secs_f64()),
        |n| n * 1e-9,
    )
}

/// Resident memory, MB.
fn resident() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: Option<f64> = stat.split(' ').nth(1).and_then(|n| n.parse().ok());
    pages.map_or(f64::NAN, |n| n * 4096.0 / 1e6)
}

/// A wavy surface of so many chords of 0.1 mm from a generator, in rows that turn without a corner.
fn stream(blocks: u32) -> std::process::ExitCode {
    let at = |k: u32| {
        let s = f64::from(k) * 0.1;
        let (row, along) = ((s / 200.0).floor(), s % 200.0);
        // There along a line, back along the next one, with half circles of 2 mm between them.
        let turn = PI * 2.0;
        let (x, y) = if along < 200.0 - turn {
            (along, 0.0)
        } else {
            let u = (along - 200.0 + turn) / 2.0;
            (200.0 - turn + 2.0 * u.sin(), 2.0 * (1.0 - u.cos()))
        };
        let x = if row % 2.0 == 0.0 { x } else { 200.0 - turn - x };
        [x, 4.0 * row + y, 2.0 * (x / 15.0).sin()]
    };
    let steps = Generated::new(move |k| (k < blocks).then(|| feed_move(line(at(k), at(k + 1)), 12_000.0)));
    let mut trajectory = Trajectory::new(Box::new(steps), Point::from_xyz(at(0)), jerk_limited(0.01));
    let (began, mut next, mut first) = (processor_time(), blocks / 10, None);
    println!("  blocks  blocks/s  resident MB  time of the motion  j ratio");
    loop {
        match trajectory.next(None) {
            motion::Output::Command(_) => {}
            motion::Output::End => break,
            _ => return std::process::ExitCode::FAILURE,
        }
        let s = trajectory.statistics();
        if s.blocks >= u64::from(next) {
            let (took, memory) = (processor_time() - began, resident());
            first.get_or_insert(memory);
            println!(
                "{:8} {:9.0} {memory:12.1} {:19.1} {:8.4}",
                s.blocks,
                s.blocks as f64 / took,
                s.time.0,
                s.worst_jerk_ratio.unwrap_or(0.0)
            );
            next += blocks / 10;
        }
    }
    let flat = first.is_none_or(|first| resident() < 1.2 * first + 2.0);
    if flat && trajectory.statistics().worst_jerk_ratio.is_some_and(|j| j <= 1.001) {
        std::process::ExitCode::SUCCESS
    } else {
        println!("NOT FLAT, OR OVER A LIMIT");
        std::process::ExitCode::FAILURE
    }
}

/// What others take, and what has to be reached.
struct Row {
    toppra: f64,
    jerk: Option<f64>,
    linuxcnc: f64,
    linuxcnc_jerk: Option<f64>,
    to_reach: Option<f64>,
}

const fn row(toppra: f64, jerk: Option<f64>, linuxcnc: f64, linuxcnc_jerk: Option<f64>, to_reach: Option<f64>) -> Row {
    Row {
        toppra,
        jerk,
        linuxcnc,
        linuxcnc_jerk,
        to_reach,
    }
}

const ROWS_6000: [Row; 6] = [
    row(2.347, None, 2.407, Some(4.293), Some(1.15 * 2.347)),
    row(1.290, Some(1.347), 1.392, Some(4.026), Some(1.05 * 1.347)),
    row(9.799, Some(9.900), 9.846, None, Some(1.05 * 9.900)),
    row(2.846, Some(2.904), 2.861, Some(51.51), Some(1.05 * 2.904)),
    row(7.568, Some(SCAN_6000), 7.614, None, None),
    row(1.294, None, 1.342, None, Some(1.75)),
];
const ROWS_30000: [Row; 6] = [
    row(1.061, None, 1.173, Some(3.262), None),
    row(0.583, Some(0.664), 0.858, Some(4.026), Some(1.05 * 0.664)),
    row(4.617, Some(4.816), 5.147, None, Some(1.05 * 4.816)),
    row(1.131, Some(1.240), 1.403, Some(10.43), Some(1.05 * 1.240)),
    row(4.649, Some(SCAN_30000), 5.449, Some(34.76), None),
    row(1.116, None, 1.162, Some(1.771), Some(1.75)),
];

/// Rows from rest to rest by the sequential linear program, 10 links of 1 mm at 0.0862 s, less 20 overlaps of 18.9 ms.
const SCAN_6000: f64 = SCAN_ROWS_6000 + 10.0 * 0.086_177 - 20.0 * 0.0189;
const SCAN_30000: f64 = 6.4076 + 10.0 * 0.086_177 - 20.0 * 0.0189;
const SCAN_ROWS_6000: f64 = 7.8504;

/// Speed, acceleration and jerk of the axis that has most of each, as shares of the limits, over time.
fn draw(drawn: &mut String, title: &str, planned: &Planned) {
    use std::fmt::Write;
    let count = drawn.matches("<g ").count();
    let (x, y) = ((count % 3) * 410 + 10, (count / 3) * 130 + 20);
    let points: Vec<[f64; 3]> = planned.points.iter().map(|p| p.position).collect();
    let n = points.len();
    let at = |k: usize, back: usize, axis: usize| points[k.saturating_sub(back)][axis];
    let _ = write!(
        drawn,
        "<g transform=\"translate({x},{y})\"><text y=\"-6\">{title} (speed, acceleration, jerk)</text><rect width=\"390\" height=\"100\" fill=\"none\" stroke=\"#999\"/>"
    );
    for (order, colour) in [(3, "#e0b0b0"), (2, "#80a0e0"), (1, "#000000")] {
        let mut line = String::new();
        for column in 0..390 {
            let (from, to) = (column * n / 390, ((column + 1) * n / 390).max(column * n / 390 + 1).min(n));
            let mut most = 0.0f64;
            for k in from..to {
                for axis in 0..3 {
                    let p = |back| at(k, back, axis);
                    most = most.max(match order {
                        1 => (p(0) - p(1)).abs() / 1e-3 / 500.0,
                        2 => (p(0) - 2.0 * p(1) + p(2)).abs() / 1e-6 / 3000.0,
                        _ => (p(0) - 3.0 * p(1) + 3.0 * p(2) - p(3)).abs() / 1e-9 / 50_000.0,
                    });
                }
            }
            let _ = write!(line, "{column},{:.1} ", 100.0 - 100.0 * most.min(1.0));
        }
        let _ = write!(drawn, "<polyline points=\"{line}\" fill=\"none\" stroke=\"{colour}\"/>");
    }
    let _ = write!(drawn, "</g>");
}

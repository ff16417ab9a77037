//! Cycle times on the six reference paths, and on a spline, under a limit of jerk, beside the references and LinuxCNC: `cargo bench -p motion --bench planner`;
//! with `-- --picture F.svg` speed, and acceleration and jerk of each axis, are drawn over time; `-- --blocks N` streams N blocks of 0.1 mm instead and prints
//! the memory on the way; `-- --slow` plans short chords at low feeds.
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

#[path = "picture/mod.rs"]
mod picture;

use motion::Trajectory;
use picture::{Panel, Picture};
use plan::{Arc, Path, PathMode, Spline, StepKind};
use std::f64::consts::PI;
use support::{Generated, all_of, feed_move, jerk_limited, line, plan, polyline, program, reference};
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
    if std::env::args().any(|a| a == "--slow") {
        return slow();
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

    // The wave groove of the corpus.
    let wave = |feed: f64| {
        let poles = [
            [55.0, 10.0, -1.5],
            [60.0, 25.0, -1.5],
            [68.0, 2.0, -1.5],
            [76.0, 28.0, -1.5],
            [84.0, 5.0, -1.5],
            [92.0, 22.0, -2.0],
            [93.0, 40.0, -2.0],
            [90.0, 50.0, -2.0],
        ];
        let spline = Path::Spline(Spline {
            degree: 3,
            poles: poles.map(Point::from_xyz).to_vec(),
            weights: vec![],
            knots: vec![0., 0., 0., 0., 1., 2., 3., 4., 5., 5., 5., 5.],
        });
        vec![feed_move(spline, feed)]
    };

    println!(
        "| path | feed | blocks | time | budget | verdict | jerk reference | times it | fine grid | times it | TOPP-RA | no jerk | LinuxCNC 2.9 | \
         2.10, jerk | deviation | v, a, j of the limits | blocks/s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let mut drawn = Picture::default();
    let mut good = true;
    for (column, (feed, rows)) in [(6000.0, &ROWS_6000), (30000.0, &ROWS_30000)].into_iter().enumerate() {
        let cases = [
            ("rsq", [5., 0., 0.], rsq(feed)),
            ("circ", [20., 0., 0.], circ(feed)),
            ("spiral", spiral[0], polyline(&spiral, feed, tolerance)),
            ("liss", liss[0], polyline(&liss, feed, tolerance)),
            ("scan", scan[0], polyline(&scan, feed, tolerance)),
            ("zig", zig[0], polyline(&zig, feed, tolerance)),
            ("spline", [55.0, 10.0, -1.5], wave(feed)),
        ];
        for (line, ((name, start, steps), row)) in cases.into_iter().zip(rows).enumerate() {
            let began = processor_time();
            let planned = plan(program(steps.clone()), start, jerk_limited(0.01));
            let took = processor_time() - began;
            let fine = Trajectory::new(Box::new(program(steps.clone())), Point::from_xyz(start), jerk_limited(0.01));
            let fine = all_of(fine.with_fine_grid(4.0)).statistics.time.0;
            let without = plan(program(steps), start, reference(0.01)).statistics.time.0;
            let s = planned.statistics;
            let (time, jerk) = (s.time.0, s.worst_jerk_ratio.unwrap_or(0.0));
            let kept = [s.worst_speed_ratio, s.worst_acceleration_ratio, jerk]
                .iter()
                .all(|r| *r <= 1.001)
                && s.max_deviation.0 <= row.deviation;
            let budget = row.to_reach.unwrap_or(1.05 * fine);
            let reached = time <= budget && time <= 1.05 * fine;
            let agrees = name == "scan" || row.jerk.is_none_or(|j| (fine / j - 1.0).abs() < 0.01);
            good &= kept && reached && agrees;
            let verdict = match (kept, reached, agrees) {
                (true, true, true) if name == "scan" => "pass *",
                (true, true, true) => "pass",
                (false, ..) => "LIMIT NOT KEPT",
                (_, false, _) => "TOO SLOW",
                (.., false) => "REFERENCES DIFFER",
            };
            let number = |t: Option<f64>| t.map_or("-".to_owned(), |t| format!("{t:.3}"));
            println!(
                "| {} | {feed:.0} | {} | {time:.3} | {budget:.3} | {verdict} | {} | {} | {fine:.3} | {:.4} | {} | {without:.3} | {} | {} | {:.5} \
                 | {:.4}, {:.4}, {jerk:.4} | {:.0} |",
                row.name,
                s.blocks,
                number(row.jerk),
                row.jerk.map_or("-".to_owned(), |j| format!("{:.4}", time / j)),
                time / fine,
                number(row.toppra),
                number(row.linuxcnc),
                number(row.linuxcnc_jerk),
                s.max_deviation.0,
                s.worst_speed_ratio,
                s.worst_acceleration_ratio,
                s.blocks as f64 / took,
            );
            let beside = row
                .linuxcnc
                .map(|t| format!("LinuxCNC 2.9 (no limit of jerk) {t:.3} s"))
                .into_iter();
            let beside = beside.chain(row.linuxcnc_jerk.map(|t| format!("2.10 (jerk) {t:.3} s")));
            let remark: Vec<String> = [format!("reference {:.3} s", row.jerk.unwrap_or(fine))]
                .into_iter()
                .chain(beside)
                .collect();
            let places: Vec<[f64; 3]> = planned.points.iter().map(|p| p.position).collect();
            drawn.add(&Panel {
                title: &format!("{} F{feed:.0}: {time:.3} s", row.name),
                remark: &remark.join("; "),
                good: kept && reached,
                places: &places,
                at: (line, column),
                feed: feed / 60.0,
                limits: [500.0, 3000.0, 50_000.0],
            });
        }
    }
    println!(
        "\n* LinuxCNC's times of the scan keep no limit of jerk, and no plan that keeps it is as fast: neither the reference nor the fine grid is. \
         The budget is 1.05 times the fine grid, as it is wherever no other is named."
    );
    if let Some(name) = picture {
        let svg = drawn.svg(
            "Plans under a limit of jerk",
            "500 mm/s, 3000 mm/s&#178;, 50 000 mm/s&#179; each axis; path tolerance 0.01 mm; backward differences of the set-points, 1 ms",
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

/// Short chords at low feeds: how many blocks a second of the processor's time, and how many times faster than they are executed.
fn slow() -> std::process::ExitCode {
    println!(
        "| path | feed | blocks | blocks/s | times real time | set-points/s | j of the limit |\n|---|---|---|---|---|---|---|"
    );
    let circle = |chord: f64| -> Vec<[f64; 3]> {
        let at = |k: u32| (f64::from(k) * chord, f64::from(k) * chord * 0.01);
        (0..4000).map(at).map(|(turn, z)| [turn.cos(), turn.sin(), z]).collect()
    };
    // Corners of any angle.
    let corners = |chord: f64| -> Vec<[f64; 3]> {
        let (mut at, mut turn) = ([0.0, 0.0, 0.0], 0.0f64);
        (0..2000u32)
            .map(|k| {
                turn += f64::from(k.wrapping_mul(2_654_435_761) >> 16) * 1e-4;
                at = [at[0] + chord * turn.cos(), at[1] + chord * turn.sin(), 0.0];
                at
            })
            .collect()
    };
    for (name, feed, points) in [
        ("circle, chords of 0.01", 6.0, circle(0.01)),
        ("circle, chords of 0.01", 60.0, circle(0.01)),
        ("circle, chords of 0.1", 60.0, circle(0.1)),
        ("corners every 0.003", 60.0, corners(0.003)),
        ("corners every 0.01", 60.0, corners(0.01)),
        ("corners every 0.1", 60.0, corners(0.1)),
        ("corners every 0.1", 600.0, corners(0.1)),
    ] {
        let steps = polyline(&points, feed, PathMode::Tolerance(Some(Millimetres(0.01))));
        let began = processor_time();
        let s = plan(program(steps), points[0], jerk_limited(0.01)).statistics;
        let took = processor_time() - began;
        let rates = [s.blocks as f64 / took, s.time.0 / took, s.samples as f64 / took];
        println!(
            "| {name} | {feed:.0} | {} | {:.0} | {:.0} | {:.0} | {:.3} |",
            s.blocks,
            rates[0],
            rates[1],
            rates[2],
            s.worst_jerk_ratio.unwrap_or(0.0)
        );
    }
    std::process::ExitCode::SUCCESS
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
    name: &'static str,
    toppra: Option<f64>,
    jerk: Option<f64>,
    linuxcnc: Option<f64>,
    linuxcnc_jerk: Option<f64>,
    to_reach: Option<f64>,
    deviation: f64,
}

const fn row(
    name: &'static str,
    toppra: f64,
    jerk: Option<f64>,
    linuxcnc: f64,
    linuxcnc_jerk: Option<f64>,
    to_reach: Option<f64>,
) -> Row {
    Row {
        name,
        toppra: Some(toppra),
        jerk,
        linuxcnc: Some(linuxcnc),
        linuxcnc_jerk,
        to_reach,
        deviation: 0.01,
    }
}

/// A spline is kept within a micrometre.
const fn spline(jerk: f64) -> Row {
    Row {
        name: "spline",
        toppra: None,
        jerk: Some(jerk),
        linuxcnc: None,
        linuxcnc_jerk: None,
        to_reach: Some(1.05 * jerk),
        deviation: 0.001,
    }
}

const ROWS_6000: [Row; 7] = [
    row("rounded square", 2.347, None, 2.407, Some(4.293), Some(1.15 * 2.347)),
    row("circle", 1.290, Some(1.347), 1.392, Some(4.026), Some(1.05 * 1.347)),
    row("spiral", 9.799, Some(9.900), 9.846, None, Some(1.05 * 9.900)),
    row("Lissajous", 2.846, Some(2.904), 2.861, Some(51.51), Some(1.05 * 2.904)),
    row("scan", 7.568, Some(SCAN_6000), 7.614, None, None),
    row("zig-zag", 1.294, None, 1.342, None, Some(1.75)),
    spline(0.99791),
];
const ROWS_30000: [Row; 7] = [
    row("rounded square", 1.061, None, 1.173, Some(3.262), None),
    row("circle", 0.583, Some(0.664), 0.858, Some(4.026), Some(1.05 * 0.664)),
    row("spiral", 4.617, Some(4.816), 5.147, None, Some(1.05 * 4.816)),
    row("Lissajous", 1.131, Some(1.240), 1.403, Some(10.43), Some(1.05 * 1.240)),
    row("scan", 4.649, Some(SCAN_30000), 5.449, Some(34.76), None),
    row("zig-zag", 1.116, None, 1.162, Some(1.771), Some(1.75)),
    spline(0.77649),
];

/// Rows from rest to rest by the sequential linear program, 10 links of 1 mm at 0.0862 s, less 20 overlaps of 18.9 ms.
const SCAN_6000: f64 = SCAN_ROWS_6000 + 10.0 * 0.086_177 - 20.0 * 0.0189;
const SCAN_30000: f64 = 6.4076 + 10.0 * 0.086_177 - 20.0 * 0.0189;
const SCAN_ROWS_6000: f64 = 7.8504;

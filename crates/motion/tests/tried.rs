//! Paths that somebody who doubts the planner would try, under a limit of jerk: limits within 0.1 %, the deviation within the tolerance as
//! measured from the outside, the last point exact, and the time against what is possible.

mod support;

use motion::Trajectory;
use plan::{Arc, Path, PathMode, StepKind};
use std::f64::consts::{PI, TAU};
use support::{all_of, distance, feed_move, jerk_limited, line, planned, program};
use units::{Millimetres, Point, Radians, Setup, Vector};

const P01: PathMode = PathMode::Tolerance(Some(Millimetres(0.01)));
const FEEDS: [f64; 2] = [6000.0, 30_000.0];

fn arc(from: [f64; 3], centre: [f64; 2], sweep: f64, rise: f64) -> Path<Setup> {
    Path::Arc(Arc {
        from: Point::from_xyz(from),
        centre: Point::new(centre[0], centre[1], from[2]),
        normal: Vector::Z,
        sweep: Radians(sweep),
        rise,
    })
}

fn chords(points: &[[f64; 3]]) -> Vec<Path<Setup>> {
    points.windows(2).map(|p| line(p[0], p[1])).collect()
}

/// Points of a curve, rounded to so many decimals.
fn points(curve: impl Fn(f64) -> [f64; 3], count: u32, decimals: i32) -> Vec<[f64; 3]> {
    let unit = 10f64.powi(decimals);
    let at = |k: u32| curve(f64::from(k) / f64::from(count));
    (0..=count).map(|k| at(k).map(|x| (x * unit).round() / unit)).collect()
}

/// At both feeds within the tolerance, and no slower than these times.
#[track_caller]
fn check(paths: &[Path<Setup>], most: [f64; 2]) {
    for (feed, most) in FEEDS.into_iter().zip(most) {
        let planned = planned(paths, feed, P01);
        let off = distance(&planned, paths);
        let time = planned.statistics.time.0;
        println!("F{feed}: {time:.4} s of {most:.4} s, {off:.5} mm off");
        assert!(off <= 0.01 + 1e-6, "F{feed}: {off} mm off the path");
        assert!(planned.statistics.max_deviation.0 <= 0.01);
        assert!(time <= most, "F{feed}: {time} s, not {most} s");
    }
}

/// The same against our own planner on a grid four times as fine with all of the limits.
#[track_caller]
fn check_against_fine_grid(paths: &[Path<Setup>]) {
    let fine = FEEDS.map(|feed| {
        let moves = paths.iter().map(|path| feed_move(path.clone(), feed));
        let steps = std::iter::once(StepKind::PathMode(P01)).chain(moves).collect();
        let trajectory = Trajectory::new(
            Box::new(program(steps)),
            Point::from_xyz(paths[0].start().xyz),
            jerk_limited(0.01),
        );
        all_of(trajectory.with_fine_grid(4.0)).statistics.time.0
    });
    check(paths, fine.map(|time| 1.02 * time + 0.002));
}

#[test]
fn a_circle_in_four_arcs_is_the_circle() {
    let quarter = |k: u32| {
        let (sin, cos) = (f64::from(k) * PI / 2.0).sin_cos();
        arc([20.0 * cos, 20.0 * sin, 0.0], [0.0; 2], PI / 2.0, 0.0)
    };
    check(&(0..4).map(quarter).collect::<Vec<_>>(), [1.01 * 1.347, 1.01 * 0.664]);
}

#[test]
fn a_helix_is_within_a_hundredth_of_the_jerk_reference() {
    let helix = arc([10.0, 0.0, 0.0], [0.0; 2], 3.0 * TAU, 15.0);
    check(&[helix], [1.01 * HELIX[0], 1.01 * HELIX[1]]);
}

#[test]
fn a_clothoid_of_chords_is_within_a_hundredth_of_the_jerk_reference() {
    // The curvature goes from -0.1/mm to 0.1/mm over 100 mm: direction 0.001 s^2.
    let mut at = [0.0f64; 2];
    let mut half = vec![[0.0; 3]];
    for k in 0..50_000 {
        let s = (f64::from(k) + 0.5) * 0.001;
        let (sin, cos) = (0.001 * s * s).sin_cos();
        at = [at[0] + 0.001 * cos, at[1] + 0.001 * sin];
        if k % 100 == 99 {
            half.push([at[0], at[1], 0.0]);
        }
    }
    let before = half.iter().skip(1).rev().map(|p| [-p[0], -p[1], 0.0]);
    let whole: Vec<[f64; 3]> = before.chain(half.iter().copied()).collect();
    check(&chords(&whole), [1.01 * CLOTHOID[0], 1.01 * CLOTHOID[1]]);
}

#[test]
fn a_spiral_of_tiny_arcs_is_a_spiral() {
    // Arcs of half a millimetre that meet the spiral's radius of curvature in their middle, and each other nearly tangentially.
    let spiral = |u: f64| [(2.0 + u / PI) * u.cos(), (2.0 + u / PI) * u.sin(), 0.0];
    let (mut u, mut paths) = (0.0f64, vec![]);
    while u < 10.0 * PI {
        let r = 2.0 + u / PI;
        let next = u + 0.5 / r;
        let (a, b, m) = (spiral(u), spiral(next), spiral(0.5 * (u + next)));
        // The circle through three places.
        let (bx, by, mx, my) = (b[0] - a[0], b[1] - a[1], m[0] - a[0], m[1] - a[1]);
        let d = 2.0 * (bx * my - by * mx);
        let (b2, m2) = (bx * bx + by * by, mx * mx + my * my);
        let (x, y) = ((my * b2 - by * m2) / d, (bx * m2 - mx * b2) / d);
        let sweep = 2.0 * (0.5 * b2.sqrt() / (x * x + y * y).sqrt()).asin();
        paths.push(arc(a, [a[0] + x, a[1] + y], sweep, 0.0));
        u = next;
    }
    check_against_fine_grid(&paths);
}

#[test]
fn a_star_is_rounded_within_the_tolerance() {
    let at = |k: u32| {
        let (sin, cos) = (f64::from(k) * 0.8 * PI).sin_cos();
        [30.0 * cos, 30.0 * sin, 0.0]
    };
    check_against_fine_grid(&chords(&(0..=5).map(at).collect::<Vec<_>>()));
}

#[test]
fn one_tiny_jog_in_a_long_straight_costs_little() {
    let mut points: Vec<[f64; 3]> = (0..=100)
        .map(|k| [f64::from(k), if k > 50 { 0.005 } else { 0.0 }, 0.0])
        .collect();
    // Within a twentieth of a millimetre.
    points.insert(51, [50.05, 0.005, 0.0]);
    // Without it 1.089 s and 0.427 s.
    check(&chords(&points), [1.10, 0.60]);
}

#[test]
fn there_and_back_is_as_fast_as_stops() {
    let paths: Vec<_> = (0..10)
        .map(|k| {
            let (a, b) = if k % 2 == 0 { (0.0, 10.0) } else { (10.0, 0.0) };
            line([a, 0.0, 0.0], [b, 0.0, 0.0])
        })
        .collect();
    // Exact: 0.189443 s and 0.185664 s each.
    check(&paths, [10.0 * 0.189443 * 1.02, 10.0 * 0.185664 * 1.02]);
}

#[test]
fn a_very_short_last_block_is_reached() {
    for tiny in [4e-4, 1e-5, 2e-6] {
        let paths = [line([0.0; 3], [50.0, 0.0, 0.0]), line([50.0, 0.0, 0.0], [50.0, tiny, 0.0])];
        check(&paths, [0.5895 * 1.02 + 0.03, 0.3251 * 1.02 + 0.03]);
        let ahead = [
            line([0.0; 3], [50.0, 0.0, 0.0]),
            line([50.0, 0.0, 0.0], [50.0 + tiny, 0.0, 0.0]),
        ];
        check(&ahead, [0.5895 * 1.02, 0.3251 * 1.02]);
    }
}

#[test]
fn tangent_arcs_of_very_different_radii_are_passed() {
    // Radius 50, then 0.5, then 50 again, all to the left and tangent.
    let (sin, cos) = 0.4f64.sin_cos();
    let first = arc([0.0; 3], [0.0, 50.0], 0.4, 0.0);
    let place = first.end().xyz;
    let second = arc(place, [place[0] - 0.5 * sin, place[1] + 0.5 * cos], 2.0, 0.0);
    let place = second.end().xyz;
    let (sin, cos) = 2.4f64.sin_cos();
    let third = arc(place, [place[0] - 50.0 * sin, place[1] + 50.0 * cos], 0.4, 0.0);
    check_against_fine_grid(&[first, second, third]);
}

#[test]
fn noise_in_the_fifth_decimal_of_chords_costs_nothing() {
    let mut state = 7u64;
    let mut noise = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % 3) as f64 * 1e-5 - 1e-5
    };
    let circle = points(|u| [20.0 * (TAU * u).cos(), 20.0 * (TAU * u).sin(), 0.0], 1257, 5);
    let noisy: Vec<[f64; 3]> = circle.iter().map(|p| [p[0] + noise(), p[1] + noise(), 0.0]).collect();
    check(&chords(&noisy), [1.02 * 1.347, 1.02 * 0.664]);
}

#[test]
fn blocks_without_length_change_nothing() {
    let circle = points(|u| [20.0 * (TAU * u).cos(), 20.0 * (TAU * u).sin(), 0.0], 1257, 5);
    let doubled: Vec<[f64; 3]> = circle.iter().flat_map(|p| [*p, *p, *p]).collect();
    for feed in FEEDS {
        let [one, other] = [&circle, &doubled].map(|points| planned(&chords(points), feed, P01));
        assert_eq!(one.points.len(), other.points.len());
        let same = one.points.iter().zip(&other.points).all(|(a, b)| a.position == b.position);
        assert!(same, "F{feed}");
    }
}

#[test]
fn two_hundred_metres_arrive_to_the_micrometre() {
    let paths = [
        line([0.0; 3], [120_000.0, 0.0, 0.0]),
        line([120_000.0, 0.0, 0.0], [120_000.0, 80_000.0, 0.0]),
    ];
    let planned = planned(&paths, 30_000.0, P01);
    let time = planned.statistics.time.0;
    // Each leg: at 500 mm/s, and 500/3000 + 3000/50000 s for speeding up and slowing down.
    let stops = 400.0 + 2.0 * (500.0 / 3000.0 + 0.06);
    assert!(time < 1.003 * stops && time > stops, "{time} s");
}

#[test]
fn arcs_of_a_hundredth_of_a_millimetre_are_travelled() {
    // A full circle between two lines that touch it, and a row of half circles.
    let circle = [
        line([-5.0, 0.0, 0.0], [0.0; 3]),
        arc([0.0; 3], [0.0, 0.01], TAU, 0.0),
        line([0.0; 3], [5.0, 0.0, 0.0]),
    ];
    check_against_fine_grid(&circle);
    let row: Vec<_> = (0..40)
        .map(|k| {
            let x = 0.02 * f64::from(k);
            arc([x, 0.0, 0.0], [x + 0.01, 0.0], if k % 2 == 0 { PI } else { -PI }, 0.0)
        })
        .collect();
    check_against_fine_grid(&row);
}

/// Seconds at both feeds, from a sequential linear program under speed, acceleration and jerk over the exact curve.
const HELIX: [f64; 2] = [1.98294, 1.22522];
const CLOTHOID: [f64; 2] = [1.08363, 0.55912];

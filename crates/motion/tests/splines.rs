//! Splines under a limit of jerk are kept as what they are: within a micrometre, whatever the tolerance, and as fast as they can be.

mod support;

use plan::{Path, PathMode, SpeedProfile, Spline, StepKind};
use support::{distance, feed_move, jerk_limited, line, plan, planned, program};
use units::{Millimetres, Point, Setup};

/// Farthest that a set-point may be from its spline, mm, whatever the tolerance.
const KEPT: f64 = 0.001;

fn spline(degree: usize, poles: &[[f64; 3]], weights: &[f64], knots: &[f64]) -> Path<Setup> {
    Path::Spline(Spline {
        degree,
        poles: poles.iter().copied().map(Point::from_xyz).collect(),
        weights: weights.to_vec(),
        knots: knots.to_vec(),
    })
}

/// Knots 0, 1, 2 ... that begin and end at the first and the last pole.
fn clamped(degree: usize, poles: &[[f64; 3]]) -> Path<Setup> {
    let spans = poles.len() - degree;
    let inner = (1..spans).map(|k| k as f64);
    let knots: Vec<f64> = std::iter::repeat_n(0.0, degree + 1)
        .chain(inner)
        .chain(std::iter::repeat_n(spans as f64, degree + 1))
        .collect();
    spline(degree, poles, &[], &knots)
}

const P01: PathMode = PathMode::Tolerance(Some(Millimetres(0.01)));

/// The spline is kept, and no slower than this many seconds.
#[track_caller]
fn check(path: Path<Setup>, mm_per_min: f64, most: f64) -> f64 {
    check_within(KEPT, path, mm_per_min, most)
}

#[track_caller]
fn check_within(kept: f64, path: Path<Setup>, mm_per_min: f64, most: f64) -> f64 {
    let paths = [path];
    let planned = planned(&paths, mm_per_min, P01);
    let off = distance(&planned, &paths);
    let s = planned.statistics;
    println!(
        "{mm_per_min}: {:.4} s of {most:.4}, off {off:.6} (said {:.6}), j {:.4}",
        s.time.0,
        s.max_deviation.0,
        s.worst_jerk_ratio.unwrap_or(0.0)
    );
    assert!(off <= kept, "{off} mm from its spline");
    assert!(s.max_deviation.0 <= kept, "says {}", s.max_deviation.0);
    assert!(s.time.0 <= most, "{} s, not {most} s", s.time.0);
    s.time.0
}

#[test]
fn smooth_splines_are_as_fast_as_the_jerk_reference_and_within_a_micrometre() {
    // References: sequential linear program under speed, acceleration and jerk over the exact curve.
    let wave = [
        [55.0, 10.0, -1.5],
        [60.0, 25.0, -1.5],
        [68.0, 2.0, -1.5],
        [76.0, 28.0, -1.5],
        [84.0, 5.0, -1.5],
        [92.0, 22.0, -2.0],
        [93.0, 40.0, -2.0],
        [90.0, 50.0, -2.0],
    ];
    let cubic: Vec<[f64; 3]> = (0..24)
        .map(f64::from)
        .map(|k| [7.0 * k, 12.0 * (1.3 * k).sin(), 3.0 * (0.9 * k).cos()])
        .collect();
    let quintic: Vec<[f64; 3]> = (0..19)
        .map(f64::from)
        .map(|k| [40.0 * (0.35 * k).sin(), 25.0 * (0.7 * k + 0.5).sin(), 5.0 * (1.05 * k).cos()])
        .collect();
    let bezier = [[0., 0., 0.], [30., 0., 0.], [0., 40., 5.], [40., 40., 5.]];
    for (path, times) in [
        (clamped(3, &wave), [0.99791, 0.77649]),
        (clamped(3, &cubic), [2.58379, 1.7163]),
        (clamped(5, &quintic), [2.64693, 1.17267]),
        (clamped(3, &bezier), [0.74276, 0.44315]),
    ] {
        for (feed, reference) in [6000.0, 30_000.0].into_iter().zip(times) {
            check(path.clone(), feed, 1.05 * reference);
        }
    }
}

/// A full circle of radius 20 in four rational arcs, double knots between them.
fn rational_circle() -> Path<Setup> {
    let h = 0.5f64.sqrt();
    spline(
        2,
        &[
            [20., 0., 0.],
            [20., 20., 0.],
            [0., 20., 0.],
            [-20., 20., 0.],
            [-20., 0., 0.],
            [-20., -20., 0.],
            [0., -20., 0.],
            [20., -20., 0.],
            [20., 0., 0.],
        ],
        &[1., h, 1., h, 1., h, 1., h, 1.],
        &[0., 0., 0., 1., 1., 2., 2., 3., 3., 4., 4., 4.],
    )
}

#[test]
fn a_circle_as_a_rational_spline_is_as_fast_as_the_circle() {
    // Its parameter steps at its knots; its curvature does not.
    check(rational_circle(), 6000.0, 1.347 * 1.01);
    check(rational_circle(), 30_000.0, 0.664 * 1.01);
}

#[test]
fn where_the_curvature_of_a_spline_steps_it_is_eased_within_a_micrometre() {
    let poles: Vec<[f64; 3]> = (0..14)
        .map(f64::from)
        .map(|k| [8.0 * k, 9.0 * (1.7 * k).sin(), 0.0])
        .collect();
    // Degree 2 steps at each knot, and so does degree 3 at double knots.
    check(clamped(2, &poles), 6000.0, 1.65);
    check(clamped(2, &poles), 30_000.0, 1.55);
    let double = [0., 0., 0., 0., 1., 1., 2., 2., 3., 3., 4., 4., 5., 5., 6., 6., 6., 6.];
    check(spline(3, &poles, &[], &double), 6000.0, 1.62);
}

#[test]
fn knots_as_dense_as_chords_cost_nothing() {
    // The same cubic with a knot every tenth of a millimetre: its poles are the curve but for the curvature.
    let dense: Vec<[f64; 3]> = (0..=1000)
        .map(|k| f64::from(k) * 0.1)
        .map(|x| [x, 4.0 * (x / 6.0).sin(), (x / 9.0).cos()])
        .collect();
    let sparse: Vec<[f64; 3]> = (0..=100)
        .map(f64::from)
        .map(|x| [x, 4.0 * (x / 6.0).sin(), (x / 9.0).cos()])
        .collect();
    let one = check(clamped(3, &sparse), 12_000.0, 0.82);
    let other = check(clamped(3, &dense), 12_000.0, 0.82);
    assert!((one / other - 1.0).abs() < 0.02, "{one} s and {other} s");
}

#[test]
fn degenerate_splines_are_travelled() {
    let p = [[0., 0., 0.], [10., 0., 0.], [10., 10., 2.], [20., 10., 2.], [20., 0., 0.]];
    // Double and triple poles at the ends and inside, a cusp, a loop, poles that do not move on, a line, high degree, wild knots and weights.
    let doubled = [p[0], p[0], p[1], p[2], p[2]];
    let tripled = [p[0], p[0], p[0], p[1], p[2], p[3], p[3], p[3]];
    let inner = [p[0], p[1], p[2], p[2], p[2], p[3], p[4]];
    let cusp = [[0., 0., 0.], [20., 20., 0.], [0., 20., 0.], [20., 0., 0.]];
    let near_cusp = [[0., 0., 0.], [20., 20., 0.], [0.0001, 20., 0.], [20., 0., 0.]];
    let looped = [[0., 0., 0.], [40., 20., 0.], [-20., 20., 0.], [20., 0., 0.]];
    let straight = [[0., 0., 0.], [1., 1., 0.], [5., 5., 0.], [20., 20., 0.]];
    let back = [[0., 0., 0.], [20., 0., 0.], [-10., 0., 0.], [10., 0., 0.]];
    let high: Vec<[f64; 3]> = (0..16)
        .map(f64::from)
        .map(|k| [4.0 * k, 10.0 * (k * 0.9).sin(), 0.0])
        .collect();
    let tiny = p.map(|p| p.map(|x| x * 1e-4));
    let cases = [
        ("doubled", clamped(3, &doubled)),
        ("tripled", clamped(3, &tripled)),
        ("inner", clamped(3, &inner)),
        ("cusp", clamped(3, &cusp)),
        ("nearly a cusp", clamped(3, &near_cusp)),
        ("loop", clamped(3, &looped)),
        ("straight", clamped(3, &straight)),
        ("there and back", clamped(3, &back)),
        ("of degree 15", clamped(15, &high)),
        ("tiny", clamped(3, &tiny)),
        (
            "of wild knots",
            spline(3, &p, &[], &[0., 0., 0., 0., 1e-6, 1e3, 1e3, 1e3, 1e3]),
        ),
        (
            "of wild weights",
            spline(2, &p, &[1., 1e3, 1e-3, 50., 1.], &[0., 0., 0., 1., 2., 3., 3., 3.]),
        ),
        ("not clamped", spline(3, &p, &[], &[0., 1., 2., 3., 4., 5., 6., 7., 8.])),
    ];
    for (name, path) in cases {
        println!("{name}");
        // Where it turns at a place it is a corner, which is rounded within the tolerance.
        let kept = if ["inner", "of wild knots", "of wild weights"].contains(&name) {
            0.01
        } else {
            KEPT
        };
        for feed in [600.0, 6000.0] {
            check_within(kept, path.clone(), feed, path.length() / feed * 60.0 + 2.0);
        }
    }
}

#[test]
fn between_lines_a_spline_is_left_only_at_its_ends() {
    // Its curvature steps where the lines meet it.
    let bezier = clamped(3, &[[0., 0., 0.], [15., 0., 0.], [20., 5., 0.], [20., 20., 0.]]);
    let paths = [
        line([-30., 0., 0.], [0.; 3]),
        bezier.clone(),
        line([20., 20., 0.], [20., 50., 0.]),
    ];
    let none = PathMode::Tolerance(Some(Millimetres(0.0)));
    for mode in [P01, PathMode::ExactPath, PathMode::ExactStop, none] {
        let planned = planned(&paths, 12_000.0, mode);
        let most = if mode == P01 { 0.01 } else { 0.0005 };
        assert!(distance(&planned, &paths) <= most + 1e-6);
        assert!(planned.statistics.max_deviation.0 <= most);
    }
}

#[test]
fn a_polyline_written_as_a_spline_has_the_tolerance_of_a_polyline() {
    let points: Vec<[f64; 3]> = (0..=400)
        .map(|k| f64::from(k) * 0.01 * std::f64::consts::PI)
        .map(|u| [20.0 * u.cos(), 20.0 * u.sin(), 0.0])
        .collect();
    let as_spline = planned(&[clamped(1, &points)], 12_000.0, P01).statistics;
    let chords: Vec<Path<Setup>> = points.windows(2).map(|p| line(p[0], p[1])).collect();
    let as_chords = planned(&chords, 12_000.0, P01).statistics;
    assert!((as_spline.time.0 / as_chords.time.0 - 1.0).abs() < 1e-6);
    assert!(
        as_spline.max_deviation.0 <= 0.01 && as_chords.max_deviation.0 > KEPT,
        "the tolerance is used"
    );
}

#[test]
fn a_feed_that_steps_along_a_spline_is_kept_to_its_place() {
    let path = clamped(3, &[[0., 0., 0.], [30., 0., 0.], [60., 30., 0.], [90., 30., 0.]]);
    let mut step = feed_move(path, 6000.0);
    let StepKind::Move(m) = &mut step else {
        unreachable!("it is a move")
    };
    // Of the length: the middle third is travelled at a fifth of the feed.
    let points = vec![(0.0, 1.0), (0.34, 1.0), (0.34, 0.2), (0.66, 0.2), (0.66, 1.0), (1.0, 1.0)];
    m.profile = Some(SpeedProfile { points });
    let planned = plan(program(vec![step]), [0.0; 3], jerk_limited(0.01));
    let whole = planned.statistics.path_length.0;
    let fastest = |from: f64, to: f64| {
        let inside = planned
            .points
            .iter()
            .filter(|p| p.path_length > from * whole && p.path_length < to * whole);
        inside.map(|p| p.path_speed).fold(0.0, f64::max)
    };
    assert!(fastest(0.345, 0.655) < 20.1, "{}", fastest(0.345, 0.655));
    assert!(fastest(0.1, 0.3) > 95.0 && fastest(0.7, 0.9) > 95.0);
}

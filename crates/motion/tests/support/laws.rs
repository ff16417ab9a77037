//! The laws themselves: limits of speed, acceleration and jerk, tolerance, end point, order.

use super::{Planned, plan, program, reference};
use motion::{Limits, Output};
use plan::{Arc, Path, PathMode, StepKind};
use units::{MmPerSec3, Point, Radians, Setup, Vector};

/// Distance from a place to programmed paths, given as chords that stay within 0.01 um of them.
pub fn distance(place: [f64; 3], chords: &[Vec<Point<Setup>>]) -> f64 {
    let p = Point::<Setup>::from_xyz(place);
    let to_chord = |c: &[Point<Setup>]| {
        let d = c[1] - c[0];
        let t = if d.dot(d) > 0.0 {
            ((p - c[0]).dot(d) / d.dot(d)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        p.distance(c[0].toward(c[1], t))
    };
    chords
        .iter()
        .flat_map(|path| path.windows(2).map(to_chord))
        .fold(f64::INFINITY, f64::min)
}

pub fn chords(path: &Path<Setup>) -> Vec<Point<Setup>> {
    let mut points = vec![];
    path.flatten(1e-5, 20_000, |_, p| points.push(p));
    points
}

pub fn paths_of(steps: &[StepKind]) -> Vec<Path<Setup>> {
    steps
        .iter()
        .filter_map(|s| {
            if let StepKind::Move(m) = s {
                Some(m.path.clone())
            } else {
                None
            }
        })
        .collect()
}

/// How far each step may be left, by its index: the mode in force; with exact stop it may be rounded where it begins.
pub fn tolerances(steps: &[StepKind], default: f64) -> Vec<f64> {
    let mut mode = PathMode::Tolerance(None);
    steps
        .iter()
        .map(|step| {
            if let StepKind::PathMode(m) = step {
                mode = *m;
            }
            match mode {
                PathMode::ExactStop | PathMode::ExactPath => 0.0005,
                PathMode::Tolerance(t) => t.map_or(default, |t| t.0),
            }
        })
        .collect()
}

#[track_caller]
pub fn check_laws(steps: Vec<StepKind>, start: [f64; 3], tolerance: f64) -> Planned {
    check_laws_with(steps, start, reference(tolerance))
}

/// The laws without a limit of jerk, and with one that the axes need 60 ms to use up.
#[track_caller]
pub fn check_laws_with(steps: Vec<StepKind>, start: [f64; 3], limits: Limits) -> Planned {
    let j_max = Some(limits.a_max.map(|a| MmPerSec3(a.0 / 0.06)));
    check_laws_of_one(steps.clone(), start, Limits { j_max, ..limits });
    check_laws_of_one(steps, start, limits)
}

/// The same for programs that a test makes many of: their limits of jerk have a test with fewer of them, because it plans for longer.
#[track_caller]
pub fn check_laws_without_jerk(steps: Vec<StepKind>, start: [f64; 3], limits: Limits) -> Planned {
    check_laws_of_one(steps, start, limits)
}

#[track_caller]
pub fn check_laws_of_one(steps: Vec<StepKind>, start: [f64; 3], limits: Limits) -> Planned {
    let planned = plan(program(steps.clone()), start, limits);
    let tolerances = tolerances(&steps, limits.tolerance.0);
    let s = planned.statistics;
    assert!(
        matches!(planned.others.last(), Some(Output::End)),
        "{:?}",
        planned.others.last()
    );
    assert!(s.worst_speed_ratio <= 1.001, "speed {}", s.worst_speed_ratio);
    assert!(
        s.worst_acceleration_ratio <= 1.001,
        "acceleration {}",
        s.worst_acceleration_ratio
    );
    assert!(s.worst_jerk_ratio.unwrap_or(0.0) <= 1.001, "jerk {:?}", s.worst_jerk_ratio);
    let paths = paths_of(&steps);
    if let (Some(last), Some(path)) = (planned.points.last(), paths.iter().rfind(|p| p.length() > 1e-9)) {
        assert_eq!(last.position, path.end().xyz, "the end point is exact");
        assert_eq!(last.velocity, [0.0; 3]);
    }
    // The places that are furthest from the path are those in corners, where the machine is slow: many samples are in them.
    let step = (planned.points.len() / 200).max(1);
    let chords: Vec<_> = paths.iter().map(chords).collect();
    for p in planned.points.iter().step_by(step) {
        let d = distance(p.position, &chords);
        let tolerance = tolerances[p.step.0 as usize - 1];
        assert!(
            d <= tolerance.max(1e-4) + 2e-5,
            "{d} mm off the path, {tolerance} allowed, at {p:?}"
        );
    }
    assert!(
        planned.points.windows(2).all(|p| p[0].path_length <= p[1].path_length),
        "path length never falls"
    );
    assert!(
        planned.points.windows(2).all(|p| p[0].step <= p[1].step),
        "steps come in order"
    );
    planned
}

pub fn arc(from: Point<Setup>, centre: [f64; 3], sweep: f64, rise: f64) -> Path<Setup> {
    Path::Arc(Arc {
        from,
        centre: Point::from_xyz(centre),
        normal: Vector::Z,
        sweep: Radians(sweep),
        rise,
    })
}

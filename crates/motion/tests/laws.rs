//! What holds for every program: limits, tolerance, end point, order.

mod support;

use motion::{Limits, Output};
use plan::{CoolantState, Feed, Move, Path, PathMode, Speed, Spline, StepKind};
use proptest::prelude::*;
use support::laws::*;
use support::{polyline, reference};
use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, Setup, Vector};

/// Moves that follow each other: a line somewhere, an arc round somewhere, a tiny chord, a spline.
fn moves() -> impl Strategy<Value = Vec<StepKind>> {
    let place = prop::array::uniform3(-40.0..40.0f64);
    let one = (0..6u8, place, 0.3..6.0f64, 300.0..40000.0f64, prop::bool::weighted(0.15));
    prop::collection::vec(one, 1..40).prop_map(|items| {
        let mut at = Point::<Setup>::ORIGIN;
        let mut steps = vec![];
        for (kind, to, size, feed, rapid) in items {
            let target = Point::from_xyz(to);
            let path = match kind {
                0 | 1 => Path::Line { from: at, to: target },
                2 | 3 => {
                    let short = (target - at).unit().unwrap_or(Vector::X) * (size * 0.05);
                    Path::Line {
                        from: at,
                        to: at + short,
                    }
                }
                4 => {
                    let centre = (at + Vector::new(size, size * 0.3, 0.0)).xyz;
                    arc(
                        at,
                        centre,
                        if to[0] > 0.0 { size } else { -size },
                        if to[1] > 20.0 { 2.0 } else { 0.0 },
                    )
                }
                _ => Path::Spline(Spline {
                    degree: 3,
                    poles: vec![
                        at,
                        at + Vector::new(size, 0.0, 0.0),
                        target + Vector::new(0.0, size, 0.0),
                        target,
                    ],
                    weights: vec![],
                    knots: vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
                }),
            };
            at = path.end();
            let speed = if rapid {
                Speed::Rapid
            } else {
                Speed::Feed(Feed::PerTime(MmPerSec(feed / 60.0)))
            };
            steps.push(StepKind::Move(Move {
                path,
                speed,
                profile: None,
                derived: false,
            }));
        }
        steps
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn any_program_keeps_its_limits_and_its_tolerance(steps in moves(), tolerance in prop::sample::select(vec![0.001, 0.01, 0.1])) {
        check_laws_without_jerk(steps, [0.0; 3], reference(tolerance));
    }

    #[test]
    fn axes_may_differ_and_modes_and_marks_may_stand_anywhere(
        steps in moves(),
        speeds in prop::array::uniform3(1.0..3.3f64), accelerations in prop::array::uniform3(1.7..4.3f64),
        between in prop::collection::vec(0..9u8, 40),
    ) {
        let limits = Limits {
            v_max: speeds.map(|v| MmPerSec(libm::pow(10.0, v))),
            a_max: accelerations.map(|a| MmPerSec2(libm::pow(10.0, a))),
            j_max: None,
            tolerance: Millimetres(0.01),
        };
        let mut mixed = vec![];
        for (step, between) in steps.into_iter().zip(between) {
            mixed.extend(match between {
                0 => Some(StepKind::PathMode(PathMode::ExactStop)),
                1 => Some(StepKind::PathMode(PathMode::ExactPath)),
                2 => Some(StepKind::PathMode(PathMode::Tolerance(Some(Millimetres(1.0))))),
                3 => Some(StepKind::PathMode(PathMode::Tolerance(None))),
                4 => Some(StepKind::Message("here".into())),
                5 => Some(StepKind::Coolant(CoolantState::default())),
                _ => None,
            });
            mixed.push(step);
        }
        let others: Vec<u32> = mixed.iter().zip(1..).filter(|(s, _)| !matches!(s, StepKind::Move(_))).map(|(_, id)| id).collect();
        let planned = check_laws_without_jerk(mixed, [0.0; 3], limits);
        let passed: Vec<u32> = planned
            .others
            .iter()
            .filter_map(|o| if let Output::Passed(step) = o { Some(step.id.0) } else { None })
            .collect();
        prop_assert_eq!(passed, others);
    }

    #[test]
    fn dense_chords_of_any_curve_keep_limits_and_tolerance(
        radius in 0.5..30.0f64, step in 0.02..0.6f64, wobble in 0.0..0.4f64, feed in 100.0..60000.0f64,
    ) {
        let points: Vec<[f64; 3]> = (0..300)
            .map(|k| {
                let u = f64::from(k) * step / radius;
                let r = radius + wobble * libm::sin(7.0 * u);
                [libm::round(r * libm::cos(u) * 1e4) / 1e4, libm::round(r * libm::sin(u) * 1e4) / 1e4, 0.1 * u]
            })
            .collect();
        check_laws_without_jerk(polyline(&points, feed, PathMode::Tolerance(Some(Millimetres(0.01)))), points[0], reference(0.01));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    #[test]
    fn any_program_keeps_its_limits_of_jerk_and_its_tolerance(
        steps in moves(), tolerance in prop::sample::select(vec![0.0, 0.001, 0.01, 0.1, 2.0]),
        speeds in prop::array::uniform3(1.5..2.8f64), accelerations in prop::array::uniform3(2.5..4.0f64),
        jerks in prop::array::uniform3(4.0..5.5f64), modes in prop::collection::vec(0..9u8, 40),
    ) {
        let limits = Limits {
            v_max: speeds.map(|v| MmPerSec(libm::pow(10.0, v))),
            a_max: accelerations.map(|a| MmPerSec2(libm::pow(10.0, a))),
            j_max: Some(jerks.map(|j| MmPerSec3(libm::pow(10.0, j)))),
            tolerance: Millimetres(tolerance),
        };
        let mut mixed = vec![];
        for (step, mode) in steps.into_iter().take(12).zip(modes) {
            mixed.extend(match mode {
                0 => Some(StepKind::PathMode(PathMode::ExactStop)),
                1 => Some(StepKind::PathMode(PathMode::ExactPath)),
                2 => Some(StepKind::PathMode(PathMode::Tolerance(Some(Millimetres(0.05))))),
                3 => Some(StepKind::Coolant(CoolantState::default())),
                _ => None,
            });
            mixed.push(step);
        }
        check_laws_of_one(mixed, [0.0; 3], limits);
    }

    #[test]
    fn dense_chords_of_any_curve_keep_limits_of_jerk_and_tolerance(
        radius in 0.5..30.0f64, step in 0.02..0.6f64, wobble in 0.0..0.4f64, feed in 1000.0..60000.0f64,
        digits in prop::sample::select(vec![1e3, 1e5]),
    ) {
        let points: Vec<[f64; 3]> = (0..200)
            .map(|k| {
                let u = f64::from(k) * step / radius;
                let r = radius + wobble * libm::sin(7.0 * u);
                [r * libm::cos(u), r * libm::sin(u), 0.1 * u].map(|x| libm::round(x * digits) / digits)
            })
            .collect();
        let limits = support::jerk_limited(0.01);
        check_laws_of_one(polyline(&points, feed, PathMode::Tolerance(Some(Millimetres(0.01)))), points[0], limits);
    }
}

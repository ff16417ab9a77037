//! Overrides above 100 %, rapids and threads: what a set-point says of them, and what planning again in flight keeps.

mod support;

use machine::{Command, SetPoint};
use motion::{Limits, Output, Trajectory};
use plan::{Arc, Feed, Move, Path, PathMode, Speed, SpindleMode, SpindleState, StepKind, Thread};
use proptest::prelude::*;
use support::{Generated, feed_move, jerk_limited, line, polyline, program, reference};
use units::{Millimetres, MmPerSec, Point, Radians, Rpm, Setup, Vector};

/// All set-points of a program; before the one with that number the override is set.
fn run(steps: Vec<StepKind>, limits: Limits, changes: &[(usize, f64)]) -> (Vec<SetPoint>, motion::Statistics) {
    let start = steps.iter().find_map(|s| match s {
        StepKind::Move(m) => Some(m.path.start().xyz),
        _ => None,
    });
    let start = Point::from_xyz(start.unwrap_or_default());
    let mut trajectory = Trajectory::new(Box::new(program(steps)), start, limits);
    let mut points = vec![];
    loop {
        for (_, feed) in changes.iter().filter(|(at, _)| *at == points.len()) {
            trajectory.set_override(*feed, 1.0);
        }
        match trajectory.next(None) {
            Output::Command(Command::SetPoint(point)) => points.push(point),
            Output::End => return (points, trajectory.statistics()),
            Output::Alarm(alarm) => panic!("{alarm}"),
            _ => {}
        }
    }
}

fn long_line(feed: f64) -> Vec<StepKind> {
    vec![feed_move(line([0.0; 3], [400.0, 0.0, 0.0]), feed)]
}

#[test]
fn an_override_of_200_percent_takes_hold_within_half_a_second_of_what_was_given_out() {
    for at in [1, 40, 700, 3000] {
        let (points, statistics) = run(long_line(3000.0), jerk_limited(0.01), &[(at, 2.0)]);
        let fast = points.iter().position(|p| p.path_speed > 99.0).expect("it becomes fast");
        assert!(fast <= at + 500, "changed at {at}, fast at {fast}");
        assert!(points[..at].iter().all(|p| p.planned_override == 1.0 && p.path_speed < 50.1));
        assert_eq!(points[fast].planned_override, 2.0);
        assert_eq!(points.last().expect("some").position, [400.0, 0.0, 0.0]);
        assert!(statistics.worst_jerk_ratio.unwrap_or(0.0) <= 1.001 && statistics.worst_acceleration_ratio <= 1.001);
    }
}

#[test]
fn a_set_point_says_which_override_it_was_planned_for() {
    // Taken back, what is laid stays as fast as it was and says so; what comes behind it is slower.
    let corners: Vec<[f64; 3]> = (0..600).map(|k| [f64::from(k), 0.0, 0.0]).collect();
    let steps = polyline(&corners, 3000.0, PathMode::Tolerance(None));
    let (points, statistics) = run(steps, jerk_limited(0.01), &[(500, 2.0), (1200, 1.0)]);
    for point in &points {
        assert!(point.path_speed <= 50.1 * point.planned_override, "{point:?}");
    }
    assert!(points.iter().any(|p| p.planned_override == 2.0) && points[points.len() - 100].planned_override == 1.0);
    assert!(statistics.worst_jerk_ratio.unwrap_or(0.0) <= 1.001);
}

#[test]
fn without_a_limit_of_jerk_an_override_is_for_the_moves_behind_the_look_ahead() {
    let points: Vec<[f64; 3]> = (0..400).map(|k| [f64::from(k), 0.0, 0.0]).collect();
    let steps = polyline(&points, 3000.0, PathMode::Tolerance(None));
    let (points, _) = run(steps, reference(0.01), &[(300, 1.5)]);
    let fast = points.iter().position(|p| p.path_speed > 74.0).expect("it becomes fast");
    assert!((300..800).contains(&fast), "{fast}");
    for point in &points {
        assert!(point.path_speed <= 50.1 * point.planned_override.max(1.0), "{point:?}");
    }
    assert_eq!(points.last().expect("some").position, [399.0, 0.0, 0.0]);
}

#[test]
fn below_100_percent_the_plan_stays_and_what_is_no_number_is_not_taken() {
    let (as_programmed, _) = run(long_line(3000.0), jerk_limited(0.01), &[]);
    for feed in [0.0, 0.5, 1.0, -3.0, f64::NAN, f64::INFINITY] {
        let (points, _) = run(long_line(3000.0), jerk_limited(0.01), &[(100, feed)]);
        assert_eq!(points, as_programmed, "{feed}");
    }
    let (most, _) = run(long_line(3000.0), jerk_limited(0.01), &[(100, 7.0)]);
    assert_eq!(most[4000].planned_override, 2.0);
}

#[test]
fn a_rapid_says_so_and_no_override_makes_it_faster() {
    for limits in [jerk_limited(0.01), reference(0.01)] {
        let rapid = |from, to| {
            StepKind::Move(Move {
                path: line(from, to),
                speed: Speed::Rapid,
                profile: None,
                derived: false,
            })
        };
        let steps = vec![
            rapid([0.0; 3], [30.0, 0.0, 0.0]),
            feed_move(line([30.0, 0.0, 0.0], [40.0, 0.0, 0.0]), 3000.0),
            rapid([40.0, 0.0, 0.0], [0.0; 3]),
        ];
        let (points, _) = run(steps, limits, &[(0, 2.0)]);
        for point in points {
            assert_eq!(point.rapid, point.step.0 != 2, "{point:?}");
            assert_eq!(point.planned_override, if point.rapid { 1.0 } else { 2.0 });
        }
    }
}

#[test]
fn a_thread_is_planned_at_pitch_times_revolutions_and_no_override_is_for_it() {
    for limits in [jerk_limited(0.01), reference(0.01)] {
        let cut = StepKind::Move(Move {
            path: line([0.0; 3], [0.0, 0.0, -30.0]),
            speed: Speed::Feed(Feed::Thread(Thread {
                advance: Millimetres(1.5),
                start: Some(Radians(0.0)),
            })),
            profile: None,
            derived: false,
        });
        let spindle = StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(1000.0))));
        let steps = vec![spindle, cut, feed_move(line([0.0, 0.0, -30.0], [5.0, 0.0, -30.0]), 600.0)];
        let (points, _) = run(steps, limits, &[(0, 2.0)]);
        let fastest = |step: u32| {
            points
                .iter()
                .filter(|p| p.step.0 == step)
                .map(|p| p.path_speed)
                .fold(0.0, f64::max)
        };
        assert!((fastest(2) - 25.0).abs() < 0.1, "{}", fastest(2));
        assert!((fastest(3) - 20.0).abs() < 0.1, "{}", fastest(3));
        for point in &points {
            assert_eq!(point.is_locked(), point.step.0 == 2, "{point:?}");
        }
    }
}

#[test]
fn a_stream_without_end_keeps_its_memory_when_the_override_changes_all_the_time() {
    let steps = Generated::new(|k: u32| {
        let at = |k: u32| [f64::from(k % 500) * 0.1, f64::from(k / 500) * 0.1, 0.0];
        (k < 6000).then(|| feed_move(line(at(k), at(k + 1)), 6000.0))
    });
    let mut trajectory = Trajectory::new(Box::new(steps), Point::ORIGIN, jerk_limited(0.01));
    let mut samples = 0u32;
    loop {
        if samples.is_multiple_of(97) {
            trajectory.set_override([1.0, 2.0, 1.3][(samples / 97 % 3) as usize], 1.0);
        }
        match trajectory.next(None) {
            Output::Command(_) => samples += 1,
            Output::End => break,
            other => panic!("{other:?}"),
        }
    }
    let worst = trajectory.statistics();
    assert!(
        worst.worst_jerk_ratio.unwrap_or(0.0) <= 1.001 && worst.worst_acceleration_ratio <= 1.001,
        "{worst:?}"
    );
}

/// Lines and arcs one behind the other, some of them rapids.
fn moves() -> impl Strategy<Value = Vec<StepKind>> {
    let one = (0..5u8, prop::array::uniform3(-30.0..30.0f64), 0.3..6.0f64, 300.0..12000.0f64);
    prop::collection::vec(one, 2..14).prop_map(|items| {
        let mut at = Point::<Setup>::ORIGIN;
        let mut steps = vec![];
        for (kind, to, size, feed) in items {
            let target = Point::from_xyz(to);
            let path = match kind {
                0..2 => Path::Line { from: at, to: target },
                2 => Path::Line {
                    from: at,
                    to: at + (target - at).unit().unwrap_or(Vector::X) * (0.05 * size),
                },
                _ => Path::Arc(Arc {
                    from: at,
                    centre: at + Vector::new(size, size * 0.3, 0.0),
                    normal: Vector::Z,
                    sweep: Radians(if to[0] > 0.0 { size } else { -size }),
                    rise: 0.0,
                }),
            };
            at = path.end();
            let speed = match kind {
                1 => Speed::Rapid,
                _ => Speed::Feed(Feed::PerTime(MmPerSec::from_mm_per_min(feed))),
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
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn any_overrides_at_any_moments_keep_the_limits_and_the_end(
        steps in moves(), changes in prop::collection::vec((0..4000usize, 0.0..2.0f64), 1..8),
    ) {
        let end = steps.iter().rev().find_map(|s| if let StepKind::Move(m) = s { Some(m.path.end().xyz) } else { None });
        let (points, statistics) = run(steps, jerk_limited(0.02), &changes);
        prop_assert!(statistics.worst_speed_ratio <= 1.001, "{:?}", statistics);
        prop_assert!(statistics.worst_acceleration_ratio <= 1.001, "{:?}", statistics);
        prop_assert!(statistics.worst_jerk_ratio.unwrap_or(0.0) <= 1.001, "{:?}", statistics);
        prop_assert!(statistics.max_deviation.0 <= 0.02);
        prop_assert_eq!(Some(points[points.len() - 1].position), end);
        prop_assert!(points.windows(2).all(|p| p[0].path_length <= p[1].path_length && p[0].step <= p[1].step));
    }
}

#[test]
fn a_thread_says_its_tie_and_begins_and_ends_at_rest_and_one_that_is_too_fast_is_refused() {
    let cut = |from: [f64; 3], to: [f64; 3], start: Option<f64>| {
        StepKind::Move(Move {
            path: line(from, to),
            speed: Speed::Feed(Feed::Thread(Thread {
                advance: Millimetres(1.5),
                start: start.map(Radians),
            })),
            profile: None,
            derived: false,
        })
    };
    let spindle = |n: f64| StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(n))));
    for limits in [jerk_limited(0.01), reference(0.01)] {
        let (points, _) = run(
            vec![
                spindle(1000.0),
                feed_move(line([0.0, 0.0, 10.0], [0.0; 3]), 600.0),
                cut([0.0; 3], [0.0, 0.0, -30.0], Some(std::f64::consts::PI)),
                cut([0.0, 0.0, -30.0], [0.0, 0.0, -40.0], None),
                feed_move(line([0.0, 0.0, -40.0], [0.0, 0.0, -50.0]), 600.0),
            ],
            limits,
            &[],
        );
        for point in &points {
            let tie = point.tie.map(|tie| (tie.lead, tie.revolutions, tie.start));
            let expected = match point.step.0 {
                3 => Some((1.5, 1000.0 / 60.0, Some(0.5))),
                4 => Some((1.5, 1000.0 / 60.0, None)),
                _ => None,
            };
            assert_eq!(tie, expected, "{point:?}");
        }
        let rests: Vec<f64> = points.iter().filter(|p| p.path_speed == 0.0).map(|p| p.position[2]).collect();
        let near = |z: f64| rests.iter().any(|at| (at - z).abs() < 1e-6);
        // The second cut follows on without a rest.
        assert!(near(0.0) && near(-40.0) && !near(-30.0), "{rests:?}");

        let mut trajectory = Trajectory::new(
            Box::new(program(vec![spindle(30_000.0), cut([0.0; 3], [0.0, 0.0, -30.0], None)])),
            Point::ORIGIN,
            limits,
        );
        let said = loop {
            match trajectory.next(None) {
                Output::Alarm(alarm) => break alarm.diagnostic.code,
                Output::End => panic!("750 mm/s of 500"),
                _ => {}
            }
        };
        assert_eq!(said, "thread-too-fast");
    }
}

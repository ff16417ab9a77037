//! Single programs, each for one thing that is true of what comes out of it.

#![allow(clippy::disallowed_methods, reason = "the count of the long run comes from the environment")]

mod support;

use machine::{Command, SetPoint};
use motion::{Limits, Output};
use plan::{
    Alarm, Answer, CoolantState, Feed, FrameChange, Level, Marker, Move, Path, PathMode, Speed, SpeedProfile, SpindleMode,
    SpindleState, Spline, StepKind, ToolOffset,
};
use support::laws::*;
use support::{Generated, feed_move, line, plan, polyline, program, reference};
use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, Rpm, Seconds, Setup, Transform, Vector, WorkingstepId};

#[test]
fn a_rest_in_the_bend_of_a_short_last_move_keeps_the_jerk() {
    // The constant jerk of the last interval was not looked at inside it, where the corner before it still bends the path.
    let points = [[0.0; 3], [5.0, 3.0, -2.0], [5.0007, 3.0014, -1.9997]];
    let limits = Limits {
        j_max: Some([MmPerSec3(193_630.0); 3]),
        ..Limits::uniform(MmPerSec(38.0), MmPerSec2(1047.0), Millimetres(0.05))
    };
    check_laws_of_one(polyline(&points, 300.0, PathMode::Tolerance(None)), [0.0; 3], limits);
}

#[test]
fn a_zigzag_rounds_its_corners_while_one_axis_stops_and_the_other_starts() {
    let points: Vec<[f64; 3]> = (0..=10)
        .map(|k| [10.0 * f64::from((k + 1) / 2), 10.0 * f64::from(k / 2), 0.0])
        .collect();
    // 10 exact stops would take 1.894 s and 1.857 s; the overlap of 2 (6 d sqrt(1/2) / j)^(1/3) in each of 9 corners takes 0.170 s away.
    for (feed, most) in [(6000.0, 1.75), (30000.0, 1.72)] {
        let steps = polyline(&points, feed, PathMode::Tolerance(Some(Millimetres(0.01))));
        let planned = check_laws_of_one(steps, [0.0; 3], support::jerk_limited(0.01));
        assert!(planned.statistics.time.0 < most, "{} s at F{feed}", planned.statistics.time.0);
    }
}

#[test]
fn a_circle_is_as_fast_as_the_jerk_allows() {
    // References: a sequential linear program over the exact circle, 0.3 % above the optimum of a straight line.
    for (feed, optimum) in [(6000.0, 1.347), (30000.0, 0.664)] {
        let circle = arc(Point::new(20.0, 0.0, 0.0), [0.0; 3], std::f64::consts::TAU, 0.0);
        let planned = check_laws_of_one(vec![feed_move(circle, feed)], [20.0, 0.0, 0.0], support::jerk_limited(0.01));
        let time = planned.statistics.time.0;
        assert!(
            (0.99 * optimum..1.01 * optimum + 0.001).contains(&time),
            "{time} s for {optimum} s"
        );
    }
}

#[test]
fn a_program_without_steps_ends_at_once() {
    let planned = plan(program(vec![]), [1.0, 2.0, 3.0], reference(0.01));
    assert_eq!(planned.points, vec![]);
    assert_eq!(planned.others, vec![Output::End]);
}

#[test]
fn a_reversal_comes_to_rest_at_the_turning_point() {
    let steps = polyline(
        &[[0.; 3], [10., 0., 0.], [0.; 3]],
        6000.0,
        PathMode::Tolerance(Some(Millimetres(0.1))),
    );
    let planned = check_laws(steps, [0.0; 3], 0.1);
    let furthest = planned.points.iter().map(|p| p.position[0]).fold(0.0, f64::max);
    assert!((9.998..=10.0).contains(&furthest), "{furthest}");
}

#[test]
fn a_rapid_meets_a_feed_at_rest_in_the_corner() {
    let rapid = StepKind::Move(Move {
        path: line([0.; 3], [10., 0., 0.]),
        speed: Speed::Rapid,
        profile: None,
        derived: false,
    });
    let steps = vec![rapid, feed_move(line([10., 0., 0.], [10., 10., 0.]), 3000.0)];
    let planned = check_laws(steps, [0.0; 3], 0.1);
    let off_corner = planned
        .points
        .iter()
        .filter(|p| p.position[1] > 0.0)
        .all(|p| p.position[0] == 10.0);
    assert!(off_corner, "the feed runs exactly along its own line");
}

#[test]
fn exact_stop_reaches_every_corner_and_exact_path_stays_within_half_a_pulse() {
    let points = [[0.; 3], [10., 0., 0.], [10., 10., 0.], [20., 10., 0.]];
    let nearest = |mode| {
        let planned = check_laws(polyline(&points, 6000.0, mode), [0.; 3], 0.01);
        points.map(|c| {
            planned
                .points
                .iter()
                .map(|p| Point::<Setup>::from_xyz(p.position).distance(Point::from_xyz(c)))
                .fold(1.0, f64::min)
        })
    };
    assert!(nearest(PathMode::ExactStop).iter().all(|d| *d < 0.002));
    let planned = plan(
        program(polyline(&points, 6000.0, PathMode::ExactPath)),
        [0.; 3],
        reference(0.01),
    );
    assert!(planned.statistics.max_deviation <= Millimetres(0.0005));
}

#[test]
fn a_slower_feed_holds_from_its_first_millimetre() {
    let steps = vec![
        feed_move(line([0.; 3], [50., 0., 0.]), 12000.0),
        feed_move(line([50., 0., 0.], [60., 0., 0.]), 600.0),
    ];
    let planned = check_laws(steps, [0.; 3], 0.01);
    let too_fast = planned
        .points
        .iter()
        .filter(|p| p.position[0] > 50.0 + 1e-9)
        .map(|p| p.path_speed)
        .fold(0.0, f64::max);
    assert!(too_fast <= 10.0 * 1.001, "{too_fast}");
}

#[test]
fn a_full_circle_is_a_circle() {
    let steps = vec![feed_move(
        arc(Point::new(20.0, 0.0, 0.0), [0.0; 3], std::f64::consts::TAU, 0.0),
        6000.0,
    )];
    let planned = check_laws(steps, [20.0, 0.0, 0.0], 0.01);
    assert!(
        planned
            .points
            .iter()
            .all(|p| (Point::<Setup>::from_xyz(p.position).distance(Point::ORIGIN) - 20.0).abs() < 1e-9)
    );
    assert!((planned.statistics.path_length.0 - 125.66).abs() < 0.01);
}

#[test]
fn every_step_passes_once_in_order_between_the_moves_around_it() {
    let marker = |level, name: &str| {
        StepKind::Begin(Marker {
            level,
            name: name.into(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        })
    };
    let steps = vec![
        marker(Level::Workingstep, "one"),
        feed_move(line([0.; 3], [5., 0., 0.]), 3000.0),
        StepKind::Coolant(CoolantState {
            flood: true,
            ..CoolantState::default()
        }),
        feed_move(line([5., 0., 0.], [10., 0., 0.]), 3000.0),
        StepKind::End(Level::Workingstep),
        marker(Level::Workingstep, "two"),
        feed_move(line([10., 0., 0.], [10., 5., 0.]), 3000.0),
        StepKind::Dwell(Seconds(0.0105)),
        StepKind::End(Level::Workingstep),
    ];
    let mut trajectory = motion::Trajectory::new(Box::new(program(steps)), Point::ORIGIN, reference(0.01));
    let mut seen = vec![];
    let mut last: Option<SetPoint> = None;
    loop {
        match trajectory.next(None) {
            Output::Command(Command::SetPoint(p)) => last = Some(p),
            Output::End => break,
            Output::Passed(step) => seen.push(format!("{} at {:.0?}", step.id, last.map_or([0.0; 3], |p| p.position))),
            Output::Command(c) => seen.push(format!("{c:?}").split([' ', '(']).next().unwrap_or_default().to_owned()),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(
        seen.join("\n"),
        "step 1 at [0, 0, 0]\nWorkingstep\nstep 3 at [5, 0, 0]\nCoolant\nstep 5 at [10, 0, 0]\nWorkingstep\nstep 6 at [10, 0, 0]\n\
         Workingstep\nstep 8 at [10, 5, 0]\nDwell\nstep 9 at [10, 5, 0]\nWorkingstep"
    );
    assert!(
        trajectory.statistics().time.0 > 0.2,
        "coolant and markers do not stop the motion, the dwell is counted"
    );
}

#[test]
fn workingsteps_are_counted_from_one_and_none_is_zero() {
    let begin = || {
        StepKind::Begin(Marker {
            level: Level::Workingstep,
            name: String::new(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        })
    };
    let planned = plan(
        program(vec![begin(), StepKind::End(Level::Workingstep), begin()]),
        [0.; 3],
        reference(0.01),
    );
    let ids: Vec<u32> = planned
        .others
        .iter()
        .filter_map(|o| match o {
            Output::Command(Command::Workingstep {
                workingstep: WorkingstepId(n),
                ..
            }) => Some(*n),
            _ => None,
        })
        .collect();
    assert_eq!(ids, [1, 0, 2]);
}

#[test]
fn a_question_comes_when_everything_before_it_was_given_out() {
    let steps = [
        feed_move(line([0.; 3], [5., 0., 0.]), 3000.0),
        feed_move(line([5., 0., 0.], [9., 0., 0.]), 3000.0),
    ];
    let mut stream = Generated::new(|k| steps.get(k as usize).cloned());
    stream.ask_at = Some(1);
    let mut trajectory = motion::Trajectory::new(Box::new(stream), Point::ORIGIN, reference(0.01));
    let mut last = [0.0; 3];
    loop {
        match trajectory.next(None) {
            Output::Command(Command::SetPoint(p)) => last = p.position,
            Output::Ask(_) => break,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(last, [5.0, 0.0, 0.0]);
    assert!(
        matches!(trajectory.next(None), Output::Ask(_)),
        "asked again until it is answered"
    );
    let mut end = false;
    let mut answer = Some(Answer::Truth(false));
    while !end {
        match trajectory.next(answer.take()) {
            Output::Command(Command::SetPoint(p)) => last = p.position,
            Output::End => end = true,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(last, [9.0, 0.0, 0.0]);
}

#[test]
fn frames_and_tool_offsets_place_the_gauge_point() {
    let frame = FrameChange {
        name: "G54".into(),
        machine_from_setup: Transform::shift([-400.0, -200.0, -300.0]),
        assumed: false,
    };
    let offset = ToolOffset {
        number: 1,
        geometry: Vector::new(0.0, 0.0, 95.0),
        wear: Vector::new(0.0, 0.0, 0.02),
        assumed: false,
    };
    let steps = vec![
        StepKind::Frame(frame),
        StepKind::ToolOffset(offset),
        feed_move(line([0., 0., 10.], [0., 0., 0.]), 3000.0),
    ];
    let planned = plan(program(steps), [-400.0, -200.0, -194.98], reference(0.01));
    let end = planned.points.last().expect("it moves").position;
    assert!((end[2] - (-300.0 + 95.02)).abs() < 1e-9, "{end:?}");
}

fn alarm_of(steps: Vec<StepKind>) -> Alarm {
    match plan(program(steps), [0.; 3], reference(0.01)).others.pop() {
        Some(Output::Alarm(alarm)) => alarm,
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_cannot_be_moved_is_an_alarm_that_says_why() {
    let spinning = SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(600.0)));
    let per_rev = |path| {
        StepKind::Move(Move {
            path,
            speed: Speed::Feed(Feed::PerRevolution(Millimetres(0.2))),
            profile: None,
            derived: false,
        })
    };
    assert_eq!(
        alarm_of(vec![feed_move(line([0.; 3], [f64::NAN, 0., 0.]), 600.0)])
            .diagnostic
            .code,
        "bad-geometry"
    );
    assert_eq!(
        alarm_of(vec![feed_move(line([1., 0., 0.], [2., 0., 0.]), 600.0)])
            .diagnostic
            .code,
        "path-gap"
    );
    assert_eq!(
        alarm_of(vec![feed_move(line([0.; 3], [2., 0., 0.]), 0.0)]).diagnostic.code,
        "bad-feed"
    );
    assert_eq!(
        alarm_of(vec![per_rev(line([0.; 3], [2., 0., 0.]))]).diagnostic.code,
        "feed-without-spindle"
    );
    let planned = plan(
        program(vec![StepKind::Spindle(spinning), per_rev(line([0.; 3], [20., 0., 0.]))]),
        [0.; 3],
        reference(0.01),
    );
    assert!((planned.points[500].path_speed - 2.0).abs() < 0.01, "0.2 mm at 10 rev/s");
}

#[test]
fn a_thread_goes_at_its_lead_times_the_revolutions() {
    let thread = Move {
        path: line([0.; 3], [0., 0., -40.]),
        speed: Speed::Feed(Feed::Thread(plan::Thread {
            advance: Millimetres(1.5),
            start: Some(units::Radians(0.0)),
        })),
        profile: None,
        derived: false,
    };
    let spinning = SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(600.0)));
    let planned = plan(
        program(vec![StepKind::Spindle(spinning), StepKind::Move(thread)]),
        [0.; 3],
        reference(0.01),
    );
    let middle = planned.points[planned.points.len() / 2].path_speed;
    assert!((middle - 15.0).abs() < 0.01, "1.5 mm at 10 rev/s, found {middle}");
}

#[test]
fn with_constant_surface_speed_the_spindle_follows_the_radius() {
    let surface = SpindleMode::Surface {
        speed: MmPerSec(2000.0),
        limit: Rpm(3000.0),
    };
    let facing = Move {
        path: line([30., 0., 0.], [1., 0., 0.]),
        speed: Speed::Feed(Feed::PerRevolution(Millimetres(0.2))),
        profile: None,
        derived: false,
    };
    let planned = plan(
        program(vec![
            StepKind::Spindle(SpindleState::Clockwise(surface)),
            StepKind::Move(facing),
        ]),
        [30., 0., 0.],
        reference(0.01),
    );
    let told: Vec<f64> = planned
        .others
        .iter()
        .filter_map(|o| {
            if let Output::Command(Command::SpindleSpeed(n)) = o {
                Some(n.0)
            } else {
                None
            }
        })
        .collect();
    assert!(told.windows(2).all(|n| n[0] < n[1]), "it only rises towards the centre");
    assert_eq!(told.last(), Some(&3000.0), "and stops at its limit");
    let fastest = planned.points.iter().map(|p| p.path_speed).fold(0.0, f64::max);
    assert!((fastest - 10.0).abs() < 0.05, "0.2 mm at 3000 rev/min: {fastest}");
}

#[test]
fn a_long_program_passes_through_a_bounded_window() {
    // The stream is a function: what the planner keeps is all there is. 200 000 chords here, 10 million in the soak.
    let count: u32 = std::env::var("BLOCKS").ok().and_then(|v| v.parse().ok()).unwrap_or(200_000);
    let place = |k: u32| {
        let u = f64::from(k) * 0.004;
        [25.0 * libm::cos(u), 25.0 * libm::sin(u), 0.0]
    };
    let stream = Generated::new(move |k| (k < count).then(|| feed_move(line(place(k), place(k + 1)), 12000.0)));
    let mut trajectory = motion::Trajectory::new(Box::new(stream), Point::from_xyz(place(0)), reference(0.01));
    let mut samples = 0u64;
    loop {
        match trajectory.next(None) {
            Output::Command(_) => samples += 1,
            Output::End => break,
            other => panic!("{other:?}"),
        }
    }
    let s = trajectory.statistics();
    assert_eq!(s.blocks, u64::from(count));
    assert_eq!(s.samples, samples);
    let seconds = f64::from(count) * 0.1 / 200.0;
    assert!(
        (s.time.0 - seconds).abs() < 0.02 * seconds,
        "as fast as the feed: {} s",
        s.time.0
    );
}

fn spline(degree: usize, poles: &[[f64; 3]], knots: &[f64]) -> Path<Setup> {
    Path::Spline(Spline {
        degree,
        poles: poles.iter().copied().map(Point::from_xyz).collect(),
        weights: vec![],
        knots: knots.to_vec(),
    })
}

#[test]
fn a_short_curve_between_two_rests_is_travelled_and_not_jumped_over() {
    // One look at the limits each 0.05 rad made these curves one interval, which has no speed when it begins and ends at rest.
    let flat = arc(Point::ORIGIN, [0.0, 100.0, 0.0], 0.04, 0.0);
    let straight = spline(
        3,
        &[[0.; 3], [10., 0., 0.], [20., 0., 0.], [30., 0., 0.]],
        &[0., 0., 0., 0., 1., 1., 1., 1.],
    );
    for (path, optimum) in [
        (flat, 2.0 * libm::sqrt(4.0 / 3000.0)),
        (straight, 2.0 * libm::sqrt(30.0 / 3000.0)),
    ] {
        let planned = check_laws(vec![feed_move(path, 30000.0)], [0.0; 3], 0.01);
        let time = planned.statistics.time.0;
        assert!((optimum..1.05 * optimum + 0.002).contains(&time), "{time} s for {optimum}");
    }
}

#[test]
fn an_inner_corner_of_a_spline_is_a_corner() {
    let polyline = spline(
        1,
        &[[0.; 3], [10., 0., 0.], [10., 10., 0.], [0., 10., 0.]],
        &[0., 0., 1., 2., 3., 3.],
    );
    check_laws(vec![feed_move(polyline, 12000.0)], [0.0; 3], 0.01);
}

#[test]
fn double_poles_at_the_ends_of_a_spline_are_no_jump() {
    let poles = [[0.; 3], [0.; 3], [10., 0., 0.], [10., 10., 0.], [10., 10., 0.]];
    let path = spline(3, &poles, &[0., 0., 0., 0., 1., 2., 2., 2., 2.]);
    check_laws(vec![feed_move(path, 12000.0)], [0.0; 3], 0.01);
}

#[test]
fn the_stricter_of_two_modes_rounds_the_corner_between_them() {
    let mode = |t| StepKind::PathMode(t);
    for strict in [
        PathMode::ExactPath,
        PathMode::ExactStop,
        PathMode::Tolerance(Some(Millimetres(0.001))),
    ] {
        let steps = vec![
            mode(PathMode::Tolerance(Some(Millimetres(1.0)))),
            feed_move(line([0.; 3], [10., 0., 0.]), 6000.0),
            mode(strict),
            feed_move(line([10., 0., 0.], [10., 10., 0.]), 6000.0),
        ];
        let planned = check_laws(steps, [0.; 3], 0.01);
        assert!(planned.statistics.max_deviation <= Millimetres(0.001), "{strict:?}");
    }
}

#[test]
fn a_step_of_a_speed_profile_is_a_step_of_the_speed() {
    let profile = SpeedProfile {
        points: vec![(0.0, 1.0), (0.51, 1.0), (0.51, 0.1), (0.53, 0.1), (0.53, 1.0)],
    };
    let path = line([0.; 3], [100., 0., 0.]);
    let speed = Speed::Feed(Feed::PerTime(MmPerSec(100.0)));
    let steps = vec![StepKind::Move(Move {
        path,
        speed,
        profile: Some(profile),
        derived: false,
    })];
    let planned = check_laws(steps, [0.; 3], 0.01);
    let slow = planned
        .points
        .iter()
        .filter(|p| (51.0 + 1e-9..53.0 - 1e-9).contains(&p.position[0]));
    assert!(slow.map(|p| p.path_speed).fold(0.0, f64::max) <= 10.01);
    assert!(planned.statistics.time.0 < 1.3, "only there: {}", planned.statistics.time.0);
}

#[test]
fn many_moves_without_length_are_a_way_all_the_same() {
    let place = |k: u32| [f64::from(k) * 0.9e-9, 0.0, 0.0];
    let stream = Generated::new(move |k| (k < 300_000).then(|| feed_move(line(place(k), place(k + 1)), 600.0)));
    let limits = Limits::uniform(MmPerSec(500.0), MmPerSec2(50.0), Millimetres(0.01));
    let planned = plan(stream, [0.; 3], limits);
    assert!(
        planned.statistics.worst_acceleration_ratio <= 1.001,
        "{:?}",
        planned.statistics
    );
    assert_eq!(planned.points.last().map(|p| p.position), Some(place(300_000)));
}

#[test]
fn chords_of_unequal_length_are_as_fast_as_the_tolerance_allows() {
    let (mut at, mut points) = ([0.0; 3], vec![[0.0; 3]]);
    for k in 0..200 {
        let (sin, cos) = libm::sincos(0.005 * f64::from(k));
        let length = if k % 2 == 0 { 1.0 } else { 2.0 };
        at = [at[0] + length * cos, at[1] + length * sin, 0.0];
        points.push(at);
    }
    let steps = polyline(&points, 24000.0, PathMode::Tolerance(Some(Millimetres(0.01))));
    let planned = check_laws(steps, [0.; 3], 0.01);
    // 300 mm at 400 mm/s, and the time to get there and to rest again; while it does, the bends take their share of the acceleration.
    let optimum = 300.0 / 400.0 + 400.0 / 3000.0;
    assert!(planned.statistics.time.0 < 1.08 * optimum, "{} s", planned.statistics.time.0);
}

#[test]
fn a_surface_speed_holds_from_its_spindle_command_on() {
    let surface = SpindleMode::Surface {
        speed: MmPerSec(2000.0),
        limit: Rpm(3000.0),
    };
    let steps = vec![
        feed_move(line([0.; 3], [30., 0., 0.]), 3000.0),
        StepKind::Spindle(SpindleState::Clockwise(surface)),
        feed_move(line([30., 0., 0.], [10., 0., 0.]), 3000.0),
        StepKind::Spindle(SpindleState::Stopped),
    ];
    let planned = check_laws(steps, [0.; 3], 0.01);
    let is_speed = |o: &Output| matches!(o, Output::Command(Command::SpindleSpeed(_)));
    let command = planned
        .others
        .iter()
        .position(|o| matches!(o, Output::Command(Command::Spindle { .. })));
    assert!(command < planned.others.iter().position(is_speed), "not before");
    assert!(
        planned.others.iter().filter(|o| is_speed(o)).count() > 10,
        "and to the end of the motion"
    );
}

#[test]
fn a_circle_that_begins_a_rounding_away_ends_where_it_was_programmed() {
    for sweep in [std::f64::consts::TAU, 1.0, 4.0] {
        let path = arc(Point::new(20.0, 0.0, 0.0), [0.0; 3], sweep, 1.0);
        let planned = plan(
            program(vec![feed_move(path.clone(), 3000.0)]),
            [20.01, -0.01, 0.01],
            reference(0.01),
        );
        let end = planned.points.last().map_or([0.0; 3], |p| p.position);
        assert!(Point::<Setup>::from_xyz(end).distance(path.end()) < 1e-9, "{end:?}");
        assert!(planned.statistics.worst_acceleration_ratio <= 1.001);
        let chords = [chords(&path)];
        let furthest = planned
            .points
            .iter()
            .map(|p| distance(p.position, &chords))
            .fold(0.0, f64::max);
        assert!(furthest <= 2.0 * 0.018, "{furthest}");
    }
}

#[test]
fn a_program_of_remarks_passes_through_a_bounded_window() {
    let read = std::cell::Cell::new(0);
    let stream = Generated::new(|k| {
        read.set(k);
        match k {
            0 => Some(feed_move(line([0.; 3], [1., 0., 0.]), 600.0)),
            _ => (k < 100_000).then(|| StepKind::Message("on".into())),
        }
    });
    let mut trajectory = motion::Trajectory::new(Box::new(stream), Point::ORIGIN, reference(0.01));
    while !matches!(trajectory.next(None), Output::Passed(_)) {}
    assert!(
        read.get() < 20_000,
        "the first remark comes out before {} are read",
        read.get()
    );
}

#[test]
fn a_circle_that_starts_across_a_weak_axis_keeps_its_limits() {
    // At its start the path has no speed in Y and all its bend there; rounding decided how fast the first interval might end.
    let limits = Limits {
        v_max: [MmPerSec(1660.0); 3],
        a_max: [MmPerSec2(528.360_411_7), MmPerSec2(460.307_571), MmPerSec2(14046.0)],
        j_max: None,
        tolerance: Millimetres(0.1),
    };
    for radius in [0.5, 1.14, 5.128_535, 20.0, 60.0] {
        let top = [0.0, radius, 0.0];
        let circle = arc(Point::from_xyz(top), [0.0; 3], std::f64::consts::TAU, -1.128);
        let steps = vec![
            feed_move(line([0.545, radius, 0.0], top), 300_000.0),
            feed_move(circle, 19_437.0),
        ];
        check_laws_with(steps, [0.545, radius, 0.0], limits);
    }
}

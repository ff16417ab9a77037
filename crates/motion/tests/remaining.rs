//! The remaining time from a plan made beforehand.

mod support;

use machine::Command;
use motion::{Output, RemainingTime, Trajectory};
use plan::StepKind;
use support::{Generated, feed_move, jerk_limited, line, program};
use units::{Point, Seconds};

/// A job of unequal parts: fast and slow ones, dwells, corners.
fn part(k: u32) -> StepKind {
    let at = |k: u32| [f64::from(k % 200), f64::from(k / 200 % 2), f64::from(k / 400) * 0.01];
    match k % 37 {
        36 => StepKind::Dwell(Seconds(0.4)),
        _ => feed_move(
            line(at(k - k / 37), at(k + 1 - k / 37)),
            if k < 3000 { 12_000.0 } else { 900.0 },
        ),
    }
}

#[test]
fn after_a_tenth_of_a_job_the_remaining_time_is_true_to_2_percent() {
    let steps = || Box::new(Generated::new(|k| (k < 4000).then(|| part(k))));
    let remaining = RemainingTime::of(Trajectory::new(steps(), Point::ORIGIN, jerk_limited(0.01)), |_| None);
    assert!(remaining.is_whole());
    let mut run = Trajectory::new(steps(), Point::ORIGIN, jerk_limited(0.01));
    let (mut tick, mut places) = (0u64, vec![]);
    loop {
        match run.next(None) {
            Output::Command(Command::SetPoint(point)) => {
                tick += 1;
                places.push((tick, point.step, point.path_length));
            }
            Output::Command(Command::Dwell { cycles, .. }) => tick += u64::from(cycles),
            Output::End => break,
            _ => {}
        }
    }
    assert_eq!(remaining.total(), Seconds(tick as f64 * 1e-3));
    for (at, step, path_length) in places.into_iter().filter(|place| place.0 * 10 > tick) {
        let left = (tick - at) as f64 * 1e-3;
        let off = (remaining.after(step, path_length).0 - left).abs();
        // Near the end 2 % are less than the step of the table.
        assert!(off <= 0.02 * left + 0.25, "{off} s of {left} s");
        let paced = remaining.at_this_pace(step, path_length, Seconds(at as f64 * 2e-3)).0;
        assert!(
            (paced - 2.0 * left).abs() <= 0.04 * left + 0.5,
            "{paced} s of {left} s at half the pace"
        );
    }
}

#[test]
fn an_empty_program_takes_no_time_and_one_that_asks_is_not_whole() {
    let empty = RemainingTime::of(
        Trajectory::new(Box::new(program(vec![])), Point::ORIGIN, jerk_limited(0.01)),
        |_| None,
    );
    assert!(empty.is_whole() && empty.total() == Seconds(0.0) && empty.after(units::StepId(2), 3.0) == Seconds(0.0));
    let mut asks = Generated::new(|k| (k < 20).then(|| part(k)));
    asks.ask_at = Some(10);
    let asked = RemainingTime::of(Trajectory::new(Box::new(asks), Point::ORIGIN, jerk_limited(0.01)), |_| None);
    assert!(!asked.is_whole() && asked.total().0 > 0.0);
}

#[test]
fn the_table_of_a_long_program_stays_small() {
    let mut remaining = RemainingTime::default();
    for k in 0..3_000_000u64 {
        let point = machine::SetPoint {
            step: units::StepId((k / 100_000) as u32 * 2),
            path_length: k as f64 * 0.02,
            ..machine::SetPoint::default()
        };
        remaining.add(&Output::Command(Command::SetPoint(point)));
        if k.is_multiple_of(100_000) {
            let dwell = Command::Dwell {
                cycles: 50_000,
                step: units::StepId((k / 100_000) as u32 * 2 + 1),
            };
            remaining.add(&Output::Command(dwell));
        }
    }
    assert_eq!(remaining.total(), Seconds(4500.0));
    // Right behind a dwell its time is over, right before it it is not.
    let (before, behind) = (
        remaining.until(units::StepId(19), 1_000_000.0 * 0.02 - 30.0).0,
        remaining.until(units::StepId(22), 1_000_000.0 * 0.02 + 30.0).0,
    );
    assert!(
        (before - 1498.5).abs() < 3.0 && (behind - 1551.5).abs() < 3.0,
        "{before} {behind}"
    );
    assert!(format!("{remaining:?}").len() < 300_000);
}

//! How much is searched for one set-point, in Newton steps times intervals: no clock is needed to tell slow from endless.

use super::JerkPlanner;
use crate::Limits;
use crate::planner::Planned;
use crate::smooth::{Corner, Piece};
use plan::Path;
use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, StepId};

/// For one set-point while the axes move: what an override in flight lets the machine wait for. 64 000 is the most that was seen, a slow move of
/// 35 s planned again whole, 19 steps over 3368 intervals. More is a window that is too long.
const MOST: u64 = 70_000;

/// For the first one, before anything moves. Until an override changes, a window is as long as it may be ([`super::stretch`]), because two
/// programs that differ by a last digit are alike only within one: here 3572 intervals, 26 steps over each, 92 872.
const MOST_AT_REST: u64 = 100_000;

fn limits(v: f64, a: f64, j: f64) -> Limits {
    Limits {
        j_max: Some([MmPerSec3(j); 3]),
        ..Limits::uniform(MmPerSec(v), MmPerSec2(a), Millimetres(0.01))
    }
}

fn line(from: [f64; 3], to: [f64; 3], feed: f64, corner: Corner) -> Piece {
    let path = Path::Line {
        from: Point::from_xyz(from),
        to: Point::from_xyz(to),
    };
    Piece {
        length: path.length(),
        path,
        feed,
        feed_factors: vec![],
        rapid: false,
        tie: None,
        step: StepId(1),
        corner,
    }
}

/// What a motion took: its set-points, what was searched for the first and the most for another one, and where it ended.
struct Taken {
    points: usize,
    first: u64,
    most: u64,
    end: [f64; 3],
}

/// Gives all of a motion out; `scale` says what the feeds are multiplied with from a set-point on.
fn run(limits: &Limits, pieces: Vec<Piece>, scale: impl Fn(usize) -> f64) -> Taken {
    let j_max = limits.j_max.expect("these have one").map(|j| j.0);
    let mut planner = JerkPlanner::new(limits, j_max, pieces[0].path.start().xyz);
    let work = |planner: &JerkPlanner| planner.legs.iter().map(|leg| leg.stretch.work()).sum::<u64>();
    let mut taken = Taken {
        points: 0,
        first: 0,
        most: 0,
        end: [f64::NAN; 3],
    };
    let mut last_scale = 1.0;
    let mut pieces = pieces.into_iter();
    loop {
        let wanted = scale(taken.points);
        if wanted != last_scale {
            planner.set_feed_scale(wanted);
            last_scale = wanted;
        }
        let before = work(&planner);
        let next = planner.next();
        let searched = work(&planner).saturating_sub(before);
        let most = if taken.points == 0 {
            &mut taken.first
        } else {
            &mut taken.most
        };
        *most = searched.max(*most);
        match next {
            Some(Planned::SetPoint(point)) => {
                taken.points += 1;
                taken.end = point.position;
            }
            Some(Planned::Mark) => {}
            None => match pieces.next() {
                Some(piece) => planner.push(piece),
                None if planner.last.is_some() => planner.finish(),
                None => {
                    println!(
                        "{} set-points; steps times intervals: {} for the first, at most {}",
                        taken.points, taken.first, taken.most
                    );
                    return taken;
                }
            },
        }
    }
}

#[test]
fn an_override_above_100_percent_on_a_slow_long_move_is_planned_with_bounded_work() {
    let limits = limits(500.0, 3000.0, 50_000.0);
    let to = [60.0, 35.0, -10.0];
    let moves = vec![line([0.0; 3], to, 2.0, Corner::Stop)];
    let taken = run(&limits, moves, |at| [1.0, 1.3, 2.0][at / 211 % 3]);
    assert_eq!(taken.end, to);
    assert!(taken.first <= MOST_AT_REST, "{} for the first set-point", taken.first);
    assert!(taken.most <= MOST, "{} for one set-point", taken.most);
}

#[test]
fn a_move_is_as_easy_to_plan_after_many_changes_of_the_override_as_before() {
    let limits = limits(500.0, 3000.0, 50_000.0);
    let to = [40.0, 0.0, 0.0];
    let moves = vec![line([0.0; 3], to, 2.0, Corner::Stop)];
    // Each change made the intervals of what is not laid yet ten times shorter, down to none.
    let taken = run(&limits, moves, |at| 1.0 + (at / 90 % 5) as f64 * 0.2);
    assert_eq!(taken.end, to);
    assert!(taken.first <= MOST_AT_REST, "{} for the first set-point", taken.first);
    assert!(taken.most <= MOST, "{} for one set-point", taken.most);
}

#[test]
fn a_stop_that_is_longer_than_a_window_can_be_is_planned_to_its_end() {
    // 40 s to the full speed, in intervals of 2.5 ms.
    let lazy = limits(1000.0, 25.0, 10.0);
    let to = [30_000.0, 0.0, 0.0];
    let taken = run(&lazy, vec![line([0.0; 3], to, 1000.0, Corner::Stop)], |_| 1.0);
    assert_eq!(taken.end, to);
    // Into chords of a micrometre at a speed whose stop takes thousands of them.
    let at = |k: u32| [60.0 + f64::from(k) * 1e-3, 0.0, 0.0];
    let within = Corner::Within(0.01);
    let mut moves = vec![line([0.0; 3], at(0), 300.0, within)];
    moves.extend((0..30_000).map(|k| line(at(k), at(k + 1), 300.0, within)));
    let taken = run(&limits(500.0, 3000.0, 50_000.0), moves, |_| 1.0);
    assert_eq!(taken.end, at(30_000));
}

#[test]
fn an_override_in_any_of_the_last_cycles_of_a_move_leaves_an_end() {
    let limits = limits(500.0, 3000.0, 50_000.0);
    let to = [3.0, 1.0, 0.0];
    let moves = || vec![line([0.0; 3], to, 20.0, Corner::Stop)];
    let whole = run(&limits, moves(), |_| 1.0).points;
    for left in 0..60 {
        let taken = run(&limits, moves(), |at| if at + left >= whole { 2.0 } else { 1.0 });
        assert_eq!(taken.end, to, "{left}");
        assert!(taken.points <= whole + 1, "{left}");
    }
}

//! A last digit of a coordinate: the plan stays the same but for last digits.

mod support;

use plan::{Arc, Path, PathMode, StepKind};
use support::{feed_move, jerk_limited, line, plan, polyline, program};
use units::{Millimetres, Point, Radians, Setup, Vector};

/// Largest distance between two plans at the same cycle, mm, and how their numbers of set-points differ.
fn apart(a: &[machine::SetPoint], b: &[machine::SetPoint]) -> (f64, usize) {
    let distance = |(a, b): (&machine::SetPoint, &machine::SetPoint)| {
        Point::<Setup>::from_xyz(a.position).distance(Point::from_xyz(b.position))
    };
    (a.iter().zip(b).map(distance).fold(0.0, f64::max), a.len().abs_diff(b.len()))
}

#[track_caller]
fn check(name: &str, program_of: impl Fn(f64) -> Vec<StepKind>) {
    let start = |steps: &[StepKind]| {
        let path = steps.iter().find_map(|s| {
            if let StepKind::Move(m) = s {
                Some(m.path.start().xyz)
            } else {
                None
            }
        });
        path.expect("it moves")
    };
    let plans: Vec<_> = [0.0, 1e-12, -3e-12, 1e-10]
        .map(|off| {
            let steps = program_of(off);
            let from = start(&steps);
            plan(program(steps), from, jerk_limited(0.01)).points
        })
        .into();
    for other in &plans[1..] {
        let (far, count) = apart(&plans[0], other);
        assert!(far < 1e-7 && count <= 1, "{name}: {far} mm apart, {count} cycles");
    }
}

#[test]
fn a_last_digit_of_a_coordinate_changes_last_digits_of_the_plan() {
    let within = PathMode::Tolerance(Some(Millimetres(0.01)));
    for feed in [600.0, 6000.0, 30000.0] {
        check(&format!("wave F{feed}"), |off| {
            let points: Vec<[f64; 3]> = (0..600)
                .map(|k| {
                    let u = f64::from(k) * 0.01;
                    let wobble = if k % 7 == 0 { off } else { -off };
                    [
                        20.0 * libm::sin(u) + wobble,
                        15.0 * libm::sin(2.0 * u + 0.5) - wobble,
                        2.0 * libm::cos(3.0 * u),
                    ]
                })
                .collect();
            polyline(&points, feed, within)
        });
        check(&format!("corners F{feed}"), |off| {
            let points: Vec<[f64; 3]> = (0..40)
                .map(|k| {
                    [
                        f64::from((k + 1) / 2) * 3.1 + off,
                        f64::from(k / 2 % 3) * 4.3 - off * f64::from(k % 2),
                        0.0,
                    ]
                })
                .collect();
            polyline(&points, feed, within)
        });
        check(&format!("arcs F{feed}"), |off| {
            let mut at = Point::<Setup>::new(off, 0.0, 0.0);
            let mut steps = vec![StepKind::PathMode(within)];
            for k in 0..12 {
                let to = at + Vector::new(7.0 + off, 3.0, 0.0);
                steps.push(feed_move(line(at.xyz, to.xyz), feed));
                let path = Path::Arc(Arc {
                    from: to,
                    centre: to + Vector::new(-1.2, 2.8, 0.0),
                    normal: Vector::Z,
                    sweep: Radians(1.1 + 0.2 * f64::from(k)),
                    rise: 0.0,
                });
                at = path.end();
                steps.push(feed_move(path, feed));
            }
            steps
        });
    }
}

//! Arcs and helices from the words of a block: by centre (I J K) or by radius (R), in any plane.
//!
//! Written numbers are rounded, so the two radii of an arc never quite agree. A small disagreement is spread so that the curve ends
//! exactly where the program says and keeps one radius; a large one is refused.

use crate::profile::Plane;
use plan::{Arc, Path};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use units::{Point, Radians, Setup, Vector};

/// How a block gives the circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Circle {
    /// Its centre in the plane, mm.
    Centre([f64; 2]),
    /// Its radius, mm; negative takes the longer way round.
    Radius(f64),
}

/// Everything about an arc but the control's name for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Request {
    pub from: [f64; 3],
    pub to: [f64; 3],
    pub plane: Plane,
    pub counterclockwise: bool,
    pub circle: Circle,
    /// Turns begun: 1 is less than or just a full circle.
    pub turns: u32,
    /// Smallest disagreement of the radii that is ever refused, mm.
    pub tolerance: f64,
}

/// One or two paths that together are the arc, and how far the program's radii disagree.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Solved {
    pub first: Path<Setup>,
    pub second: Option<Path<Setup>>,
    /// Difference of the radii at start and end, mm.
    pub mismatch: f64,
}

/// Why there is no such arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ArcFault {
    /// Start and centre are the same place.
    NoRadius,
    /// The radii at start and end differ by more than rounding can explain.
    DoesNotClose { start: f64, end: f64, allowed: f64 },
    /// The end is farther away than twice the radius.
    TooFar { distance: f64, radius: f64 },
    /// Given by radius, and the end is the start.
    NoWay,
}

/// Two places closer than this in the plane are one: a full circle. Far below any control's increment, far above what adding up
/// incremental moves loses.
const SAME_PLACE: f64 = 1e-7;

/// Disagreement that rounding can explain: the given tolerance, or 0.1 % of the radius up to 0.5 mm.
fn allowed(radius: f64, tolerance: f64) -> f64 {
    tolerance.max((radius * 1e-3).min(0.5))
}

pub(crate) fn solve(request: Request) -> Result<Solved, ArcFault> {
    let [a, b, _] = request.plane.axes();
    let start = [request.from[a], request.from[b]];
    let end = [request.to[a], request.to[b]];
    let chord = subtract(end, start);
    let distance = length(chord);
    match request.circle {
        Circle::Radius(radius) => {
            if distance <= SAME_PLACE {
                return Err(ArcFault::NoWay);
            }
            let beyond = distance / 2.0 - radius.abs();
            let mismatch = if beyond > 0.0 { beyond } else { 0.0 };
            if mismatch > allowed(radius.abs(), request.tolerance) {
                return Err(ArcFault::TooFar { distance, radius });
            }
            let height = libm::sqrt((radius * radius - distance * distance / 4.0).max(0.0));
            // The centre of a counterclockwise arc of less than half a circle lies left of its chord.
            let left = request.counterclockwise == (radius > 0.0);
            let toward = height / distance * if left { 1.0 } else { -1.0 };
            let centre = [
                (start[0] + end[0]) / 2.0 - chord[1] * toward,
                (start[1] + end[1]) / 2.0 + chord[0] * toward,
            ];
            Ok(Solved {
                first: request.piece(request.from, request.to, centre, request.sweep(start, end, centre)),
                second: None,
                mismatch,
            })
        }
        Circle::Centre(centre) => {
            let (radius, end_radius) = (length(subtract(start, centre)), length(subtract(end, centre)));
            if radius <= SAME_PLACE {
                return Err(ArcFault::NoRadius);
            }
            if distance <= SAME_PLACE {
                let turns = f64::from(request.turns) * TAU;
                let sweep = if request.counterclockwise { turns } else { -turns };
                return Ok(Solved {
                    first: request.piece(request.from, request.to, centre, sweep),
                    second: None,
                    mismatch: 0.0,
                });
            }
            let mismatch = (radius - end_radius).abs();
            let allowed = allowed(radius, request.tolerance);
            if mismatch > allowed {
                let (start, end) = (radius, end_radius);
                return Err(ArcFault::DoesNotClose { start, end, allowed });
            }
            let even = even_centre(start, end, centre);
            let sweep = request.sweep(start, end, even);
            let moved = length(subtract(even, centre));
            if sweep.abs() <= PI + 1e-9 || moved <= 1e-3 {
                return Ok(Solved {
                    first: request.piece(request.from, request.to, even, sweep),
                    second: None,
                    mismatch,
                });
            }
            // Nearly a full circle with a short chord: moving the centre along the chord would carry the far side away by many times
            // the disagreement. So go round the programmed centre, and spread the disagreement over the last quarter only.
            let sweep = request.sweep(start, end, centre);
            let last = FRAC_PI_2 * sweep.signum();
            let share = (sweep - last) / sweep;
            let (sin, cos) = libm::sincos(sweep - last);
            let out = subtract(start, centre);
            let joint = [
                centre[0] + out[0] * cos - out[1] * sin,
                centre[1] + out[0] * sin + out[1] * cos,
            ];
            let [a, b, c] = request.plane.axes();
            let mut middle = request.from;
            (middle[a], middle[b]) = (joint[0], joint[1]);
            middle[c] += (request.to[c] - request.from[c]) * share;
            let even = even_centre(joint, end, centre);
            let quarter = Request { turns: 1, ..request }.sweep(joint, end, even);
            Ok(Solved {
                first: request.piece(request.from, middle, centre, sweep - last),
                second: Some(request.piece(middle, request.to, even, quarter)),
                mismatch,
            })
        }
    }
}

impl Request {
    /// Angle from start to end about a centre, in the direction asked for; never 0.
    fn sweep(&self, start: [f64; 2], end: [f64; 2], centre: [f64; 2]) -> f64 {
        let (s, e) = (subtract(start, centre), subtract(end, centre));
        let angle = libm::atan2(s[0] * e[1] - s[1] * e[0], s[0] * e[0] + s[1] * e[1]);
        let more = f64::from(self.turns.max(1) - 1) * TAU;
        match self.counterclockwise {
            true if angle <= 0.0 => angle + TAU + more,
            true => angle + more,
            false if angle >= 0.0 => angle - TAU - more,
            false => angle - more,
        }
    }

    fn piece(&self, from: [f64; 3], to: [f64; 3], centre: [f64; 2], sweep: f64) -> Path<Setup> {
        let [a, b, c] = self.plane.axes();
        let mut middle = from;
        (middle[a], middle[b]) = (centre[0], centre[1]);
        let mut normal = [0.0; 3];
        normal[c] = 1.0;
        Path::Arc(Arc {
            from: Point::from_xyz(from),
            centre: Point::from_xyz(middle),
            normal: Vector::from_xyz(normal),
            sweep: Radians(sweep),
            rise: to[c] - from[c],
        })
    }
}

/// The place nearest to `centre` that is as far from `start` as from `end`.
fn even_centre(start: [f64; 2], end: [f64; 2], centre: [f64; 2]) -> [f64; 2] {
    let chord = subtract(end, start);
    let middle = [(start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0];
    let along = subtract(centre, middle);
    let share = (along[0] * chord[0] + along[1] * chord[1]) / (chord[0] * chord[0] + chord[1] * chord[1]);
    [centre[0] - chord[0] * share, centre[1] - chord[1] * share]
}

fn subtract(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length(v: [f64; 2]) -> f64 {
    libm::sqrt(v[0] * v[0] + v[1] * v[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn request(from: [f64; 3], to: [f64; 3], counterclockwise: bool, circle: Circle) -> Request {
        Request {
            from,
            to,
            plane: Plane::Xy,
            counterclockwise,
            circle,
            turns: 1,
            tolerance: 0.01,
        }
    }

    fn sweep_of(path: &Path<Setup>) -> f64 {
        match path {
            Path::Arc(arc) => arc.sweep.0.to_degrees(),
            _ => f64::NAN,
        }
    }

    #[test]
    fn a_negative_radius_takes_the_longer_way() {
        let (from, to) = ([10.0, 0.0, 0.0], [0.0, 10.0, 0.0]);
        for (counterclockwise, radius, degrees) in [
            (true, 10.0, 90.0),
            (true, -10.0, 270.0),
            (false, 10.0, -90.0),
            (false, -10.0, -270.0),
        ] {
            let solved = solve(request(from, to, counterclockwise, Circle::Radius(radius))).expect("an arc");
            assert!(
                (sweep_of(&solved.first) - degrees).abs() < 1e-9,
                "{counterclockwise} {radius}"
            );
        }
    }

    #[test]
    fn an_arc_whose_radii_differ_is_refused_with_both() {
        let refused = solve(request([10.0, 0.0, 0.0], [0.0, 10.5, 0.0], true, Circle::Centre([0.0, 0.0])));
        assert_eq!(
            refused,
            Err(ArcFault::DoesNotClose {
                start: 10.0,
                end: 10.5,
                allowed: 0.01
            })
        );
        let far = solve(request([0.0; 3], [10.0, 0.0, 0.0], true, Circle::Radius(4.9)));
        assert_eq!(
            far,
            Err(ArcFault::TooFar {
                distance: 10.0,
                radius: 4.9
            })
        );
    }

    #[test]
    fn a_nearly_full_circle_that_does_not_quite_close_stays_near_its_centre() {
        // 827-9999-904-FIXT.NC, N114: X-.0084 Y-.1581 I-.16 from X-.0081 Y-.1681, in inches, here clockwise the long way.
        let k = 25.4;
        let solved = solve(request(
            [-0.0081 * k, -0.1681 * k, 0.0],
            [-0.0084 * k, -0.1581 * k, 1.0],
            false,
            Circle::Centre([-0.1681 * k, -0.1681 * k]),
        ))
        .expect("an arc");
        let second = solved.second.expect("the rest is spread over the last quarter");
        assert!(solved.first.end().distance(second.start()) < 1e-9);
        assert!(second.end().distance(Point::new(-0.0084 * k, -0.1581 * k, 1.0)) < 1e-9);
        for u in [0.0, 0.3, 0.7, 1.0] {
            for path in [&solved.first, &second] {
                let p = path.at(u).xyz;
                let r = length(subtract([p[0], p[1]], [-0.1681 * k, -0.1681 * k]));
                assert!((r - 0.16 * k).abs() < 2.0 * solved.mismatch, "{r}");
            }
        }
    }

    proptest! {
        /// Whatever the plane, the way and the form: the end is reached and the radius is the same all along.
        #[test]
        fn an_arc_reaches_its_end_at_one_radius(
            centre in prop::array::uniform3(-100.0..100.0_f64),
            radius in 0.05..200.0_f64,
            start in 0.0..TAU,
            sweep in 0.001..6.25_f64,
            rise in -20.0..20.0_f64,
            counterclockwise: bool,
            plane in prop::sample::select(vec![Plane::Xy, Plane::Zx, Plane::Yz]),
            by_radius: bool,
            error in -0.004..0.004_f64,
        ) {
            let [a, b, c] = plane.axes();
            let on_circle = |angle: f64, r: f64, height: f64| {
                let mut p = centre;
                p[a] += r * libm::cos(angle);
                p[b] += r * libm::sin(angle);
                p[c] += height;
                p
            };
            let way = if counterclockwise { sweep } else { -sweep };
            let from = on_circle(start, radius, 0.0);
            let end_radius = if by_radius { radius } else { radius + error };
            let to = on_circle(start + way, end_radius, rise);
            prop_assume!(length(subtract([to[a], to[b]], [from[a], from[b]])) > 1e-3);
            let circle = if by_radius {
                Circle::Radius(if sweep > PI { -radius } else { radius })
            } else {
                Circle::Centre([centre[a], centre[b]])
            };
            let solved = solve(Request { from, to, plane, counterclockwise, circle, turns: 1, tolerance: 0.01 }).expect("an arc");
            let last = solved.second.as_ref().unwrap_or(&solved.first);
            prop_assert!(solved.first.start().distance(Point::from_xyz(from)) < 1e-9);
            prop_assert!(last.end().distance(Point::from_xyz(to)) < 1e-6, "{:?} {:?}", last.end(), to);
            let mut travelled = 0.0;
            for path in [Some(&solved.first), solved.second.as_ref()].into_iter().flatten() {
                let Path::Arc(arc) = path else { panic!("not an arc") };
                travelled += arc.sweep.0;
                for u in [0.0, 0.25, 0.5, 0.75, 1.0] {
                    let p = path.at(u).xyz;
                    let r = length(subtract([p[a], p[b]], [arc.centre.xyz[a], arc.centre.xyz[b]]));
                    prop_assert!((r - arc.radius()).abs() < 1e-9 * (1.0 + radius));
                }
            }
            prop_assert_eq!(travelled > 0.0, counterclockwise);
            if !by_radius && radius > 1.0 {
                prop_assert!((travelled - way).abs() < 0.1, "{} {}", travelled, way);
            }
        }

        #[test]
        fn a_full_circle_comes_back(x in -50.0..50.0_f64, y in -50.0..50.0_f64, counterclockwise: bool, turns in 1_u32..5) {
            prop_assume!(x.abs() + y.abs() > 0.1);
            let from = [1.0, 2.0, 3.0];
            let to = [1.0, 2.0, 3.0 - f64::from(turns)];
            let solved = solve(Request {
                turns,
                ..request(from, to, counterclockwise, Circle::Centre([1.0 + x, 2.0 + y]))
            }).expect("an arc");
            prop_assert!((sweep_of(&solved.first).abs() - 360.0 * f64::from(turns)).abs() < 1e-9);
            prop_assert!(solved.first.end().distance(Point::from_xyz(to)) < 1e-9);
        }
    }
}

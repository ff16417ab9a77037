//! Where the offset paths of two neighbouring moves meet.

use super::{Offset, V2, alarm};
use crate::fault::Outcome;
use crate::profile::Plane;
use plan::Path;
use std::f64::consts::{PI, TAU};
use units::{Point, Setup};

/// Where two neighbouring offset moves meet: the end of the first, places between, and the start of the second is the last of all.
pub(super) struct Joint {
    pub end: V2,
    pub via: [Option<V2>; 3],
}

/// Where two moves of one offset meet at `corner`.
pub(super) fn joint(first: &Path<Setup>, second: &Path<Setup>, corner: V2, offset: Offset) -> Outcome<Joint> {
    let plane = offset.plane;
    let (t1, t2) = (tangent(plane, first, 1.0), tangent(plane, second, 0.0));
    let (end, start) = (beside(corner, t1, offset), beside(corner, t2, offset));
    let turn = cross(t1, t2) * offset.side;
    let radius = offset.radius;
    if turn.abs() < 1e-9 && dot(t1, t2) > 0.0 {
        return Ok(Joint { end, via: [None; 3] });
    }
    if turn > 0.0 {
        let meeting = meeting(curve_of(first, offset), curve_of(second, offset), corner).ok_or_else(|| {
            alarm(
                33,
                "compensation-no-intersection",
                "the offset paths of this move and the one before it do not meet inside their corner",
                "use a smaller tool, or change the contour",
            )
        })?;
        return Ok(Joint {
            end: meeting,
            via: [None; 3],
        });
    }
    let straight = |p: &Path<Setup>| !matches!(p, Path::Arc(_));
    let cosine = dot(t1, t2);
    if cosine >= -1e-9 {
        // The tangents meet at P + r (n1 + n2) / (1 + n1 n2).
        let (n1, n2) = (normal(t1, offset.side), normal(t2, offset.side));
        let k = radius / (1.0 + cosine);
        let tip = [corner[0] + (n1[0] + n2[0]) * k, corner[1] + (n1[1] + n2[1]) * k];
        return Ok(match (straight(first), straight(second)) {
            (true, true) => Joint {
                end: tip,
                via: [None; 3],
            },
            (true, false) => Joint {
                end: tip,
                via: [Some(start), None, None],
            },
            (false, true) => Joint {
                end,
                via: [Some(tip), None, None],
            },
            (false, false) => Joint {
                end,
                via: [Some(tip), Some(start), None],
            },
        });
    }
    // On by the radius, across, and back by the radius; an arc has its own end, a line is lengthened.
    let past = [end[0] + t1[0] * radius, end[1] + t1[1] * radius];
    let ahead = [start[0] - t2[0] * radius, start[1] - t2[1] * radius];
    let last = (!straight(second)).then_some(start);
    Ok(match straight(first) {
        true => Joint {
            end: past,
            via: [Some(ahead), last, None],
        },
        false => Joint {
            end,
            via: [Some(past), Some(ahead), last],
        },
    })
}

/// Refuses an arc whose inner side is smaller than the tool.
pub(super) fn check_arc(path: &Path<Setup>, offset: Offset) -> Outcome<()> {
    match path {
        Path::Arc(arc) if arc.radius() - offset.side * arc.sweep.0.signum() * offset.radius <= 1e-9 => Err(alarm(
            41,
            "compensation-interference",
            format!(
                "an arc of radius {:.4} mm is too small for a tool of radius {:.4} mm on its inner side",
                arc.radius(),
                offset.radius
            ),
            "use a smaller tool, or check the radius in the offset table",
        )),
        _ => Ok(()),
    }
}

/// An offset curve, as far as it takes to meet another.
#[derive(Clone, Copy)]
enum Curve {
    Line { through: V2, along: V2 },
    Circle { centre: V2, radius: f64 },
}

fn curve_of(path: &Path<Setup>, offset: Offset) -> Curve {
    let plane = offset.plane;
    match path {
        Path::Arc(arc) => {
            let [a, b, _] = plane.axes();
            Curve::Circle {
                centre: [arc.centre.xyz[a], arc.centre.xyz[b]],
                radius: arc.radius() - offset.side * arc.sweep.0.signum() * offset.radius,
            }
        }
        other => {
            let along = tangent(plane, other, 0.0);
            Curve::Line {
                through: beside(point(plane, other, 0.0), along, offset),
                along,
            }
        }
    }
}

/// The meeting point of two curves that is nearest to `corner`.
fn meeting(first: Curve, second: Curve, corner: V2) -> Option<V2> {
    let found: Vec<V2> = match (first, second) {
        (Curve::Line { through: p, along: d }, Curve::Line { through: q, along: e }) => {
            let turn = cross(d, e);
            if turn.abs() < 1e-12 {
                return None;
            }
            let k = cross(subtract(q, p), e) / turn;
            vec![[p[0] + d[0] * k, p[1] + d[1] * k]]
        }
        (Curve::Line { through, along }, Curve::Circle { centre, radius })
        | (Curve::Circle { centre, radius }, Curve::Line { through, along }) => line_and_circle(through, along, centre, radius),
        (Curve::Circle { centre: c1, radius: r1 }, Curve::Circle { centre: c2, radius: r2 }) => {
            let between = subtract(c2, c1);
            let apart = length(between);
            if apart < 1e-12 {
                return None;
            }
            let along = (apart * apart + r1 * r1 - r2 * r2) / (2.0 * apart);
            let square = r1 * r1 - along * along;
            let height = if square < -1e-9 {
                return None;
            } else {
                libm::sqrt(square.max(0.0))
            };
            let e = [between[0] / apart, between[1] / apart];
            [1.0, -1.0]
                .map(|s| {
                    [
                        c1[0] + e[0] * along - e[1] * height * s,
                        c1[1] + e[1] * along + e[0] * height * s,
                    ]
                })
                .to_vec()
        }
    };
    found
        .into_iter()
        .min_by(|p, q| length(subtract(*p, corner)).total_cmp(&length(subtract(*q, corner))))
}

/// Where a line meets a circle; none, one or two places.
fn line_and_circle(through: V2, along: V2, centre: V2, radius: f64) -> Vec<V2> {
    let k = dot(subtract(centre, through), along);
    let foot = [through[0] + along[0] * k, through[1] + along[1] * k];
    let square = radius * radius - dot(subtract(foot, centre), subtract(foot, centre));
    if square < -1e-9 {
        return Vec::new();
    }
    let half = libm::sqrt(square.max(0.0));
    [half, -half]
        .map(|h| [foot[0] + along[0] * h, foot[1] + along[1] * h])
        .to_vec()
}

pub(super) fn point(plane: Plane, path: &Path<Setup>, u: f64) -> V2 {
    let [a, b, _] = plane.axes();
    let p = if u == 0.0 { path.start() } else { path.end() };
    [p.xyz[a], p.xyz[b]]
}

/// Direction in the plane, length 1.
pub(super) fn tangent(plane: Plane, path: &Path<Setup>, u: f64) -> V2 {
    let [a, b, _] = plane.axes();
    let d = path.derivatives(u).0.xyz;
    let (x, y) = (d[a], d[b]);
    let l = libm::sqrt(x * x + y * y);
    if l > 0.0 { [x / l, y / l] } else { [0.0, 0.0] }
}

pub(super) fn length_in(plane: Plane, path: &Path<Setup>) -> f64 {
    match path {
        Path::Arc(arc) => arc.radius() * arc.sweep.0.abs(),
        other => length(subtract(point(plane, other, 1.0), point(plane, other, 0.0))),
    }
}

fn normal(t: V2, side: f64) -> V2 {
    [-t[1] * side, t[0] * side]
}

/// The place of the centre square to a path through `p` in direction `t`.
pub(super) fn beside(p: V2, t: V2, offset: Offset) -> V2 {
    let n = normal(t, offset.side);
    [p[0] + n[0] * offset.radius, p[1] + n[1] * offset.radius]
}

/// Angle from `from` to `to` about a centre, -PI to PI.
pub(super) fn turned(centre: V2, from: V2, to: V2) -> f64 {
    let (f, t) = (subtract(from, centre), subtract(to, centre));
    let angle = libm::atan2(cross(f, t), dot(f, t));
    if angle > PI { angle - TAU } else { angle }
}

pub(super) fn subtract(a: V2, b: V2) -> V2 {
    [a[0] - b[0], a[1] - b[1]]
}
pub(super) fn dot(a: V2, b: V2) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
fn cross(a: V2, b: V2) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
fn length(v: V2) -> f64 {
    libm::sqrt(dot(v, v))
}
pub(super) fn distance3(a: [f64; 3], b: [f64; 3]) -> f64 {
    Point::<Setup>::from_xyz(a).distance(Point::from_xyz(b))
}

//! A move of the programmed path as the smooth curve needs it: a line, an arc or a part of a spline over its length,
//! and its feed.

use super::vector::{V3, add_scaled, minus, scaled};
use crate::smooth::{Piece, SLOWEST_SHARE};
use plan::Path;
use units::StepId;

/// Place and the first three derivatives by `s`.
pub(super) type Place = [V3; 4];

/// A move of the programmed path.
#[derive(Debug)]
pub(super) struct Span {
    /// Where it begins, mm along the stretch.
    pub(super) start: f64,
    /// Its length, mm.
    pub(super) length: f64,
    shape: Shape,
    /// Fastest path speed, mm/s, and its factors as in [`Piece::feed_factors`].
    feed: f64,
    factors: Vec<(f64, f64)>,
    /// No multiplier of feeds is for it.
    locked: bool,
    /// How far it may be left, mm.
    pub(super) tolerance: f64,
    /// The step in whose name it is travelled.
    pub(super) step: StepId,
}

#[derive(Debug)]
enum Shape {
    Line {
        from: V3,
        along: V3,
    },
    /// Circle or helix; `turn` and `rise` for each millimetre of length.
    Round {
        centre: V3,
        out: V3,
        side: V3,
        normal: V3,
        turn: f64,
        rise: f64,
    },
    /// Part of a spline: a polynomial of the share of the length, from `from` on.
    Curve {
        from: V3,
        terms: [V3; 5],
        over: f64,
    },
}

/// Share of a part of a spline after which limits are looked at again.
const CURVE_DETAIL: f64 = 0.25;

impl Span {
    /// The span of a line, an arc or a part of a spline that begins at `start`.
    pub(super) fn of(piece: &Piece, start: f64) -> Span {
        let length = piece.length;
        let shape = match &piece.path {
            Path::Arc(arc) if arc.radius() > 0.0 => {
                let out = (arc.from - arc.centre).xyz;
                Shape::Round {
                    centre: arc.centre.xyz,
                    out,
                    side: arc.normal.cross(arc.from - arc.centre).xyz,
                    normal: arc.normal.xyz,
                    turn: arc.sweep.0 / length,
                    rise: arc.rise / length,
                }
            }
            // What [`super::splines`] makes.
            Path::Spline(spline) if spline.degree == 5 && spline.poles.len() == 6 => {
                let from = spline.poles[0].xyz;
                let p: [V3; 6] = std::array::from_fn(|k| minus(spline.poles[k].xyz, from));
                let sum = |weights: &[f64]| {
                    let mut sum = [0.0; 3];
                    p[1..].iter().zip(weights).for_each(|(p, w)| add_scaled(&mut sum, *p, *w));
                    sum
                };
                Shape::Curve {
                    from,
                    terms: [
                        sum(&[5.0]),
                        sum(&[-20.0, 10.0]),
                        sum(&[30.0, -30.0, 10.0]),
                        sum(&[-20.0, 30.0, -20.0, 5.0]),
                        sum(&[5.0, -10.0, 10.0, -5.0, 1.0]),
                    ],
                    over: 1.0 / length,
                }
            }
            path => {
                let (from, to) = (path.start().xyz, path.end().xyz);
                Shape::Line {
                    from,
                    along: scaled(minus(to, from), 1.0 / length),
                }
            }
        };
        Span {
            start,
            length,
            shape,
            feed: piece.feed,
            factors: piece.feed_factors.clone(),
            locked: piece.tie.is_some() || piece.rapid,
            tolerance: piece.corner.tolerance(),
            step: piece.step,
        }
    }

    /// Place and derivatives of the programmed path, `x` mm from the start of the span.
    pub(super) fn at(&self, x: f64) -> Place {
        match &self.shape {
            Shape::Line { from, along } => {
                let mut place = *from;
                add_scaled(&mut place, *along, x);
                [place, *along, [0.0; 3], [0.0; 3]]
            }
            Shape::Round {
                centre,
                out,
                side,
                normal,
                turn,
                rise,
            } => {
                let (sin, cos) = libm::sincos(turn * x);
                let round =
                    |a: f64, b: f64, up: f64| -> V3 { std::array::from_fn(|k| out[k] * a + side[k] * b + normal[k] * up) };
                let mut place = round(cos, sin, rise * x);
                add_scaled(&mut place, *centre, 1.0);
                let (w, w2) = (*turn, turn * turn);
                [
                    place,
                    round(-w * sin, w * cos, *rise),
                    round(-w2 * cos, -w2 * sin, 0.0),
                    round(w2 * w * sin, -w2 * w * cos, 0.0),
                ]
            }
            Shape::Curve { from, terms, over } => {
                let w = x * over;
                let (over2, over3) = (over * over, over * over * over);
                let [a, b, c, d, e] = terms;
                let each = |of: &dyn Fn(usize) -> f64| -> V3 { std::array::from_fn(of) };
                [
                    each(&|k| from[k] + w * (a[k] + w * (b[k] + w * (c[k] + w * (d[k] + w * e[k]))))),
                    each(&|k| over * (a[k] + w * (2.0 * b[k] + w * (3.0 * c[k] + w * (4.0 * d[k] + w * 5.0 * e[k]))))),
                    each(&|k| over2 * (2.0 * b[k] + w * (6.0 * c[k] + w * (12.0 * d[k] + w * 20.0 * e[k])))),
                    each(&|k| over3 * (6.0 * c[k] + w * (24.0 * d[k] + w * 60.0 * e[k]))),
                ]
            }
        }
    }

    /// True for a line.
    pub(super) fn is_line(&self) -> bool {
        matches!(self.shape, Shape::Line { .. })
    }

    /// True for a part of a spline.
    pub(super) fn is_curve(&self) -> bool {
        matches!(self.shape, Shape::Curve { .. })
    }

    /// How far the bend may be looked at ahead, mm: along a line or an arc it does not change.
    pub(super) fn detail(&self) -> f64 {
        match self.shape {
            Shape::Curve { .. } => CURVE_DETAIL * self.length,
            Shape::Line { .. } | Shape::Round { .. } => f64::INFINITY,
        }
    }

    /// Lowest feed between two lengths from its start, mm/s; `scale` is the multiplier of feeds.
    pub(super) fn feed_between(&self, from: f64, to: f64, scale: f64) -> f64 {
        if self.locked || scale == 1.0 {
            self.programmed_between(from, to)
        } else {
            scale * self.programmed_between(from, to)
        }
    }

    fn programmed_between(&self, from: f64, to: f64) -> f64 {
        if self.factors.is_empty() {
            return self.feed;
        }
        let highest = self.factors.iter().map(|f| f.1).fold(0.0, f64::max);
        crate::smooth::slowest_feed(&self.factors, self.feed, from / self.length, to / self.length)
            .max(SLOWEST_SHARE * highest * self.feed)
    }

    /// Lengths from its start at which its feed changes its slope.
    pub(super) fn feed_places(&self) -> impl Iterator<Item = f64> + '_ {
        self.factors.iter().map(|f| f.0 * self.length)
    }

    /// True when the feed is the same all along it.
    pub(super) fn has_one_feed(&self) -> bool {
        self.factors.is_empty()
    }
}

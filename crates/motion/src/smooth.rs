//! Programmed paths become one curve with a continuous tangent.
//!
//! [`Smoother`] takes moves one at a time and gives [`Segment`]s. A corner is rounded by a blend that takes at most half of each
//! neighbour, so that corners do not depend on each other and ten million blocks pass through a window of two. The distance between
//! corner and blend is the deviation, and it stays within the tolerance. Where nothing may be rounded (exact stop, reversal, change
//! between rapid and feed) the curve has a node at which the machine comes to rest.

use crate::blend::Blend;
use plan::Path;
use units::{Machine, Point, StepId, Vector};

/// Largest distance from the programmed path in exact-path mode, mm: half a pulse of an encoder with 1000 pulses a millimetre, so no
/// measured position can tell.
pub const EXACT_PATH_TOLERANCE: f64 = 0.0005;

/// Turns smaller than this (rad) are rounding of the program's numbers and need no blend: at 500 mm/s the speed of an axis steps by
/// less than 0.1 % of what 3000 mm/s^2 change in one cycle.
const STRAIGHT: f64 = 1e-6;

/// Turns larger than this (rad, 170 degrees) are reversals: a blend would be a needle.
const REVERSAL: f64 = 2.967;

/// A move, in machine coordinates, as the smoother needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Where along.
    pub path: Path<Machine>,
    /// Length of the path, mm.
    pub length: f64,
    /// Fastest path speed, mm/s; infinite for rapids.
    pub feed: f64,
    /// Multiplier of the feed at equal distances along the path, first at its start, last at its end; empty is 1.
    pub feed_factors: Vec<f64>,
    /// Rapid or feed.
    pub rapid: bool,
    /// The step it came from.
    pub step: StepId,
    /// How its end may be rounded.
    pub corner: Corner,
}

/// How the corner behind a move may be treated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Corner {
    /// Come to rest in it.
    Stop,
    /// Round it, not further away than this, mm.
    Within(f64),
}

/// A curve of the smoothed path over a parameter range.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// A straight line from a place along a vector, parameter 0 to 1.
    Line(Point<Machine>, Vector<Machine>),
    /// A blend.
    Blend(Blend),
    /// A programmed arc or spline.
    Programmed(Box<Path<Machine>>),
}

impl Curve {
    /// The place at `u`.
    pub fn at(&self, u: f64) -> Point<Machine> {
        match self {
            Curve::Line(from, along) => *from + *along * u,
            Curve::Blend(blend) => blend.at(u),
            Curve::Programmed(path) => path.at(u),
        }
    }
    /// First and second derivative by `u`, mm.
    pub fn derivatives(&self, u: f64) -> (Vector<Machine>, Vector<Machine>) {
        match self {
            Curve::Line(_, along) => (*along, Vector::ZERO),
            Curve::Blend(blend) => blend.derivatives(u),
            Curve::Programmed(path) => path.derivatives(u),
        }
    }
}

/// A part of the smoothed path.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// The curve.
    pub curve: Curve,
    /// The parameters, rising, at which the limits are looked at; the first and the last are the ends of what is travelled.
    pub borders: Vec<f64>,
    /// Path speed allowed, mm/s, at each border, or one for all.
    pub feed: Vec<f64>,
    /// The step in whose name it is travelled.
    pub step: StepId,
    /// The machine comes to rest at its end, which is exactly here.
    pub rest_at_end: Option<Point<Machine>>,
}

/// What the smoother gives.
#[derive(Clone, Debug, PartialEq)]
pub enum Smoothed {
    /// A part of the path.
    Segment(Segment),
    /// Between the parts around it stood this, as the caller gave it to [`Smoother::mark`].
    Mark(usize),
}

/// The stage that rounds corners. Give it moves and marks in order; take what it gives.
#[derive(Debug, Default)]
pub struct Smoother {
    /// The last move, whose corner is not known yet, the parameter it starts at, and the marks that stand behind it.
    pending: Option<(Piece, f64)>,
    marks: Vec<usize>,
    /// Largest distance so far between a corner and its blend, mm.
    pub max_deviation: f64,
}

impl Smoother {
    /// A step that is no motion stands here; it will come out between the right parts, as a number the caller chose.
    pub fn mark(&mut self, mark: usize, out: &mut impl FnMut(Smoothed)) {
        if self.pending.is_some() {
            self.marks.push(mark)
        } else {
            out(Smoothed::Mark(mark))
        }
    }

    /// The next move.
    pub fn push(&mut self, next: Piece, out: &mut impl FnMut(Smoothed)) {
        let Some((last, from)) = self.pending.take() else {
            self.pending = Some((next, 0.0));
            return;
        };
        match self.round(&last, &next) {
            Join::Stop => {
                emit(&last, from, 1.0, true, out);
                self.give_marks(out);
                self.pending = Some((next, 0.0));
            }
            Join::Straight => {
                emit(&last, from, 1.0, false, out);
                self.give_marks(out);
                self.pending = Some((next, 0.0));
            }
            Join::Blend { blend, leave, enter } => {
                emit(&last, from, leave, false, out);
                let feed = vec![last.feed_at(1.0).min(next.feed_at(0.0))];
                // In the middle one step ends and the next begins.
                let part = |range: [f64; 2], step| {
                    let mut borders = vec![range[0]];
                    halve(&|u| blend.derivatives(u), range[0], range[1], 6, &mut borders);
                    Smoothed::Segment(Segment {
                        curve: Curve::Blend(blend),
                        borders,
                        feed: feed.clone(),
                        step,
                        rest_at_end: None,
                    })
                };
                out(part([0.0, 0.5], last.step));
                self.give_marks(out);
                out(part([0.5, 1.0], next.step));
                self.pending = Some((next, enter));
            }
        }
    }

    /// The motion ends here, at rest.
    pub fn finish(&mut self, out: &mut impl FnMut(Smoothed)) {
        if let Some((last, from)) = self.pending.take() {
            emit(&last, from, 1.0, true, out);
        }
        self.give_marks(out);
    }

    fn give_marks(&mut self, out: &mut impl FnMut(Smoothed)) {
        self.marks.drain(..).for_each(|m| out(Smoothed::Mark(m)));
    }

    fn round(&mut self, last: &Piece, next: &Piece) -> Join {
        let corner = last.path.end();
        let (Some(out), Some(into)) = (last.path.derivatives(1.0).0.unit(), next.path.derivatives(0.0).0.unit()) else {
            return Join::Stop;
        };
        let turn = libm::atan2(out.cross(into).length(), out.dot(into));
        let Corner::Within(tolerance) = last.corner else {
            return Join::Stop;
        };
        // A rapid meets a feed at rest: a rapid must not cut a corner into the material.
        if last.rapid != next.rapid || turn > REVERSAL {
            return Join::Stop;
        }
        if turn < STRAIGHT {
            return Join::Straight;
        }
        if tolerance <= 0.0 {
            return Join::Stop;
        }
        // For two lines with legs d the middle of the parabola is d sin(turn/2)/2 away from the corner.
        let reach = 2.0 * tolerance / libm::sin(turn / 2.0);
        let mut legs = [(last.length / 2.0).min(reach), (next.length / 2.0).min(reach)];
        // Very unequal legs put all the bend at the short end.
        legs = [legs[0].min(2.0 * legs[1]), legs[1].min(2.0 * legs[0])];
        for _ in 0..40 {
            let leave = 1.0 - last.fraction_of(legs[0], 1.0);
            let enter = next.fraction_of(legs[1], 0.0);
            let (start, end) = (last.path.at(leave), next.path.at(enter));
            let (Some(out), Some(into)) = (last.path.derivatives(leave).0.unit(), next.path.derivatives(enter).0.unit()) else {
                return Join::Stop;
            };
            let blend = Blend::round(start, out, corner, end, into);
            let deviation = deviation(&blend, last, leave, next, enter, corner);
            if deviation <= tolerance {
                self.max_deviation = self.max_deviation.max(deviation);
                return Join::Blend { blend, leave, enter };
            }
            legs = legs.map(|d| d * 0.8);
        }
        Join::Stop
    }
}

enum Join {
    Stop,
    Straight,
    Blend { blend: Blend, leave: f64, enter: f64 },
}

impl Piece {
    /// The part of the parameter range that is about `distance` long at the end (`at` 1) or the start (`at` 0) of the path.
    fn fraction_of(&self, distance: f64, at: f64) -> f64 {
        let speed = match &self.path {
            Path::Line { .. } | Path::Arc(_) => self.length,
            // On a spline the parameter is not the length; half the range is the most that a corner may take.
            Path::Spline(_) => self.path.derivatives(at).0.length(),
        };
        (distance / speed).min(0.5)
    }

    fn feed_at(&self, fraction: f64) -> f64 {
        let factors = &self.feed_factors;
        let Some(last) = factors.len().checked_sub(1).filter(|n| *n > 0) else {
            return self.feed * factors.first().copied().unwrap_or(1.0);
        };
        let at = fraction.clamp(0.0, 1.0) * last as f64;
        let k = (at as usize).min(last - 1);
        self.feed * (factors[k] + (factors[k + 1] - factors[k]) * (at - k as f64))
    }
}

/// Gives the part of a move that its corners left.
fn emit(piece: &Piece, from: f64, to: f64, stop_at_end: bool, out: &mut impl FnMut(Smoothed)) {
    let left = (to - from) * piece.length;
    if left <= 1e-9 && !stop_at_end {
        return;
    }
    // 0.05 rad (3 degrees) between looks at the limits: in between, an axis's acceleration can exceed them by 0.03 %.
    let (curve, mut borders) = match &piece.path {
        Path::Line { from: start, to: end } => (Curve::Line(*start, *end - *start), vec![from, to]),
        Path::Arc(arc) => {
            let parts = (arc.sweep.0.abs() * (to - from) / 0.05) as usize + 1;
            (Curve::Programmed(Box::new(piece.path.clone())), evenly([from, to], parts))
        }
        Path::Spline(spline) => (
            Curve::Programmed(Box::new(piece.path.clone())),
            spline_borders(&piece.path, spline, from, to),
        ),
    };
    let mut feed = vec![piece.feed_at(0.0)];
    if piece.feed_factors.len() > 1 {
        if borders.len() < 33 {
            borders = evenly([from, to], 64);
        }
        feed = borders.iter().map(|u| piece.feed_at(*u)).collect();
    }
    out(Smoothed::Segment(Segment {
        curve,
        borders,
        feed,
        step: piece.step,
        rest_at_end: stop_at_end.then(|| piece.path.end()),
    }));
}

/// Borders of equal parts of a range.
fn evenly(range: [f64; 2], parts: usize) -> Vec<f64> {
    (0..=parts)
        .map(|k| {
            if k == parts {
                range[1]
            } else {
                range[0] + (range[1] - range[0]) * k as f64 / parts as f64
            }
        })
        .collect()
}

/// Borders of a spline such that between two of them direction, parameter speed and second derivative change little: at the knots, and
/// between them wherever halving is needed.
fn spline_borders(path: &Path<Machine>, spline: &plan::Spline<Machine>, from: f64, to: f64) -> Vec<f64> {
    let (low, high) = (spline.knots[spline.degree], spline.knots[spline.poles.len()]);
    let mut borders = vec![from];
    let inner = spline
        .knots
        .iter()
        .map(|k| (k - low) / (high - low))
        .filter(|u| *u > from + 1e-9 && *u < to - 1e-9);
    for end in inner.chain([to]) {
        let start = *borders.last().unwrap_or(&from);
        if end > start {
            halve(&|u| path.derivatives(u), start, end, 12, &mut borders);
        }
    }
    borders
}

/// Adds the borders inside (`from`, `to`] to `borders`; at most 2^`depth` of them.
fn halve(derivatives: &dyn Fn(f64) -> (Vector<Machine>, Vector<Machine>), from: f64, to: f64, depth: u8, borders: &mut Vec<f64>) {
    let middle = (from + to) / 2.0;
    // A hair inside, so that a knot's jump of the second derivative counts for the right side.
    let hair = (to - from) * 1e-6;
    let [a, m, b] = [from + hair, middle, to - hair].map(derivatives);
    let turn = libm::atan2(a.0.cross(b.0).length(), a.0.dot(b.0));
    let speeds = [a.0.length(), m.0.length(), b.0.length()];
    let fastest = speeds.iter().copied().fold(0.0, f64::max);
    let slowest = speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let bend = a.1.length().max(b.1.length());
    let even = turn < 0.05 && slowest > 0.95 * fastest && (b.1 - a.1).length() < 0.2 * bend.max(0.05 * fastest / (to - from));
    if depth == 0 || even || fastest * (to - from) < 1e-3 {
        borders.push(to);
    } else {
        halve(derivatives, from, middle, depth - 1, borders);
        halve(derivatives, middle, to, depth - 1, borders);
    }
}

/// Largest distance between a blend and what it replaces, both ways, mm.
fn deviation(blend: &Blend, last: &Piece, leave: f64, next: &Piece, enter: f64, corner: Point<Machine>) -> f64 {
    let both_lines = matches!((&last.path, &next.path), (Path::Line { .. }, Path::Line { .. }));
    if both_lines {
        // An upper bound, exact for equal legs; the dense chords of a curve come through here a hundred thousand times a second.
        return corner.distance(blend.at(0.5));
    }
    let from_corner = nearest(corner, &|u| blend.at(u), 0.5);
    // Each place of the blend against both programmed curves.
    (1..16).fold(from_corner, |worst, k| {
        let u = f64::from(k) / 16.0;
        let place = blend.at(u);
        let a = nearest(place, &|t| last.path.at(leave + (1.0 - leave) * t), u.min(0.5) * 2.0);
        let b = nearest(place, &|t| next.path.at(enter * t), (u.max(0.5) - 0.5) * 2.0);
        worst.max(a.min(b))
    })
}

/// Distance from a place to a short curve over 0..1, by halving steps around a first guess.
fn nearest(place: Point<Machine>, curve: &dyn Fn(f64) -> Point<Machine>, guess: f64) -> f64 {
    let (mut at, mut step) = (guess, 0.25);
    let mut best = place.distance(curve(at));
    while step > 1e-4 {
        let mut moved = false;
        for u in [(at - step).max(0.0), (at + step).min(1.0)] {
            let d = place.distance(curve(u));
            if d < best {
                (best, at, moved) = (d, u, true);
            }
        }
        if !moved {
            step /= 2.0;
        }
    }
    best
}

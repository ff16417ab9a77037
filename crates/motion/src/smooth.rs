//! Programmed paths become one curve with a continuous tangent.
//!
//! [`Smoother`] takes moves one at a time and gives [`Segment`]s. A corner is rounded by a blend that takes at most half of each
//! neighbour, so that corners do not depend on each other and ten million blocks pass through a window of two. The distance between
//! corner and blend is the deviation, and it stays within the tolerance. Where nothing may be rounded (exact stop, reversal, change
//! between rapid and feed) the curve has a node at which the machine comes to rest.

use crate::Limits;
use crate::blend::Blend;
use machine::Tie;
use plan::Path;
use units::{Machine, Point, StepId, TICK, Vector};

/// Largest distance from the programmed path in exact-path mode, mm: half a pulse of an encoder with 1000 pulses a millimetre, so no
/// measured position can tell.
pub const EXACT_PATH_TOLERANCE: f64 = 0.0005;

/// Turns smaller than this (rad) are rounding of the program's numbers and need no blend, unless the axes are so fast and so weak that
/// the step of speed would show; see [`Smoother::new`].
const STRAIGHT: f64 = 1e-6;

/// Share of the acceleration limit that a turn without a blend may take in one cycle.
const STRAIGHT_SHARE: f64 = 0.0003;

/// A derivative shorter than this share of the length of the path gives no direction.
const NO_DIRECTION: f64 = 1e-6;

/// Feeds below this share of a move's fastest are held at places, not everywhere between them: a feed that falls to 0 along the path
/// would never arrive.
pub(crate) const SLOWEST_SHARE: f64 = 0.01;

/// Largest ratio of the feeds at both ends of an interval. In between the square of the speed is linear, so the speed is above the
/// linear feed by at most 0.05 %.
const FEED_STEP: f64 = 1.06;

/// Turns larger than this (rad, 170 degrees) are reversals: a blend would be a needle.
pub(crate) const REVERSAL: f64 = 2.967;

/// A move, in machine coordinates, as the smoother needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Where along.
    pub path: Path<Machine>,
    /// Length of the path, mm.
    pub length: f64,
    /// Fastest path speed, mm/s; infinite for rapids.
    pub feed: f64,
    /// Path parameters, never falling, and the multiplier of the feed there; linear between, the same parameter twice is a step; empty
    /// is 1.
    pub feed_factors: Vec<(f64, f64)>,
    /// Rapid or feed.
    pub rapid: bool,
    /// No override is for it: its feed is tied to the spindle.
    pub tie: Option<Tie>,
    /// The step it came from.
    pub step: StepId,
    /// How its end may be rounded.
    pub corner: Corner,
}

impl Piece {
    /// False where one of both is a thread that begins or ends between them: the machine waits there for the angle of the spindle.
    pub(crate) fn goes_on_from(&self, last: &Piece) -> bool {
        match (last.tie, self.tie) {
            (None, None) => true,
            (Some(_), Some(tie)) => tie.start.is_none() || last.step == self.step,
            _ => false,
        }
    }
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
#[derive(Debug)]
pub struct Smoother {
    /// Turns smaller than this need no blend, rad.
    straight: f64,
    /// The last move, whose corner is not known yet, the parameter it starts at, and the marks that stand behind it.
    pending: Option<(Piece, f64)>,
    marks: Vec<usize>,
    /// Largest distance so far between a corner and its blend, mm.
    pub max_deviation: f64,
}

impl Smoother {
    /// Nothing pending. A turn by t at speed v steps an axis's speed by at most v t; the sum over all axes and the weakest of them
    /// decide which turn is small.
    pub fn new(limits: &Limits) -> Smoother {
        let fastest = libm::sqrt(limits.v_max.iter().map(|v| v.0 * v.0).sum());
        let weakest = limits.a_max.iter().map(|a| a.0).fold(f64::INFINITY, f64::min);
        Smoother {
            straight: STRAIGHT.min(STRAIGHT_SHARE * weakest * TICK.0 / fastest),
            pending: None,
            marks: vec![],
            max_deviation: 0.0,
        }
    }

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
                let feed = vec![last.slowest_feed(leave, 1.0).min(next.slowest_feed(0.0, enter))];
                // In the middle one step ends and the next begins.
                let part = |range: [f64; 2], step| {
                    let mut borders = vec![range[0]];
                    halve(&|u| blend.derivatives(u), range[0], range[1], 8, &mut borders);
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
        // Double poles at the end of a spline: it has no direction there, or one that rounding made.
        let [leaving, arriving] = [last.path.derivatives(1.0).0, next.path.derivatives(0.0).0].map(|d| d.length());
        if leaving < NO_DIRECTION * last.length || arriving < NO_DIRECTION * next.length {
            return Join::Stop;
        }
        let (Some(out), Some(into)) = (last.path.derivatives(1.0).0.unit(), next.path.derivatives(0.0).0.unit()) else {
            return Join::Stop;
        };
        let turn = libm::atan2(out.cross(into).length(), out.dot(into));
        if last.corner == Corner::Stop {
            return Join::Stop;
        }
        // A blend leaves both paths, so the stricter of both decides.
        let tolerance = last.corner.tolerance().min(next.corner.tolerance());
        // A rapid meets a feed at rest: a rapid must not cut a corner into the material.
        if last.rapid != next.rapid || !next.goes_on_from(last) || turn > REVERSAL {
            return Join::Stop;
        }
        if turn < self.straight {
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
        // Where a feed falls to nothing the machine stands anyway.
        if last.feed_at(1.0) <= 0.0 || next.feed_at(0.0) <= 0.0 {
            return Join::Stop;
        }
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

impl Corner {
    /// How far the path may be left at either end, mm. A move that stops at its end is still followed closely from its start.
    pub(crate) fn tolerance(self) -> f64 {
        match self {
            Corner::Stop => EXACT_PATH_TOLERANCE,
            Corner::Within(tolerance) => tolerance,
        }
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

    /// Feed at a parameter; the lower one where it steps.
    pub(crate) fn feed_at(&self, u: f64) -> f64 {
        feed_at(&self.feed_factors, self.feed, u)
    }

    /// Lowest feed in a range of the parameter.
    fn slowest_feed(&self, from: f64, to: f64) -> f64 {
        slowest_feed(&self.feed_factors, self.feed, from, to)
    }
}

fn feed_at(points: &[(f64, f64)], feed: f64, u: f64) -> f64 {
    // From a hair before to a hair after: a border that was computed may miss the step by a last digit.
    let (before, after) = (
        points.partition_point(|p| p.0 < u - 1e-12),
        points.partition_point(|p| p.0 <= u + 1e-12),
    );
    let here = points[before..after].iter().map(|p| p.1).reduce(f64::min);
    let neighbours = (before.checked_sub(1).map(|i| points[i]), points.get(after));
    feed * match (here, neighbours) {
        (Some(factor), _) => factor,
        (None, (Some(a), Some(b))) => a.1 + (b.1 - a.1) * (u - a.0) / (b.0 - a.0),
        (None, (Some(p), None)) => p.1,
        (None, (None, Some(p))) => p.1,
        (None, (None, None)) => 1.0,
    }
}

/// Lowest feed in a range of the parameter, of a move with these factors.
pub(crate) fn slowest_feed(points: &[(f64, f64)], feed: f64, from: f64, to: f64) -> f64 {
    let inside = points.iter().filter(|p| p.0 > from && p.0 < to);
    inside
        .map(|p| feed * p.1)
        .fold(feed_at(points, feed, from).min(feed_at(points, feed, to)), f64::min)
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
    if !matches!(curve, Curve::Line(..)) {
        borders = graded(&borders, &[from, to], left);
    }
    let mut feed = vec![piece.feed];
    if !piece.feed_factors.is_empty() {
        borders = feed_borders(piece, &borders, left);
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

/// Adds borders, so that intervals grow away from the `anchors` by at most a third. There the machine may come to rest or change its
/// speed, and one interval has one acceleration: in a long one it would creep all the way, and in a single one from rest to rest it
/// could not move at all.
fn graded(borders: &[f64], anchors: &[f64], length: f64) -> Vec<f64> {
    let range = borders[borders.len() - 1] - borders[0];
    // 0.02 mm is what 3000 mm/s^2 move in 4 ms.
    let least = range * (0.02 / length).clamp(0.002, 0.25);
    let mut finer = vec![borders[0]];
    for pair in borders.windows(2) {
        let mut at = pair[0];
        loop {
            let near = |u: f64| anchors.iter().map(|a| (a - u).abs()).fold(f64::INFINITY, f64::min);
            // Towards an anchor the far end of the interval is what counts.
            let away = (near(at) * 0.3).max(least);
            let step = away.min((near(at + away) * 0.4).max(least));
            if at + 1.5 * step >= pair[1] {
                break;
            }
            at += step;
            finer.push(at);
        }
        finer.push(pair[1]);
    }
    finer
}

/// Adds borders, so that the feed is linear in each interval and changes little in it.
fn feed_borders(piece: &Piece, borders: &[f64], length: f64) -> Vec<f64> {
    let (from, to) = (borders[0], borders[borders.len() - 1]);
    let hair = 1e-9 * (to - from);
    let points = &piece.feed_factors;
    let mut all: Vec<f64> = borders.to_vec();
    all.extend(points.iter().map(|p| p.0).filter(|u| *u > from + hair && *u < to - hair));
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| *a - *b <= hair);
    if let Some(last) = all.last_mut() {
        *last = to;
    }
    let steps = points.windows(2).filter(|p| p[0].0 == p[1].0).map(|p| p[0].0);
    let anchors: Vec<f64> = steps.chain([from, to]).collect();
    let graded = graded(&all, &anchors, length);
    let floor = SLOWEST_SHARE * points.iter().map(|p| p.1).fold(0.0, f64::max) * piece.feed;
    let mut finer = vec![from];
    for pair in graded.windows(2) {
        // A hair inside, so that a step at a border does not count as a slope.
        let inside = 1e-6 * (pair[1] - pair[0]);
        let (a, b) = (
            piece.feed_at(pair[0] + inside).max(floor),
            piece.feed_at(pair[1] - inside).max(floor),
        );
        let parts = (libm::fabs(libm::log(b / a)) / libm::log(FEED_STEP)) as usize + 1;
        // Equal ratios of the feed, which is linear in u: then no part changes by more than the step.
        for k in 1..parts {
            let feed = a * libm::pow(b / a, k as f64 / parts as f64);
            finer.push(pair[0] + (pair[1] - pair[0]) * (feed - a) / (b - a));
        }
        finer.push(pair[1]);
    }
    finer
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
    let even = turn < 0.05 && slowest > 0.98 * fastest && (b.1 - a.1).length() < 0.05 * bend.max(0.05 * fastest / (to - from));
    if depth == 0 || even || fastest * (to - from) < 1e-5 {
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
        // Where the parabola is equally far from the corner along both lines. An upper bound both ways, exact for equal legs, and with
        // unequal ones not confused by the length that they differ in; the dense chords of a curve come through here a hundred thousand
        // times a second.
        let legs = [0.0, 1.0].map(|u| libm::sqrt(corner.distance(blend.at(u))));
        return corner.distance(blend.at(legs[0] / (legs[0] + legs[1])));
    }
    let from_corner = nearest(corner, &|u| blend.at(u), 0.5);
    // Each place of the blend against both programmed curves.
    let off = |u: f64| {
        let place = blend.at(u);
        let a = nearest(place, &|t| last.path.at(leave + (1.0 - leave) * t), u.min(0.5) * 2.0);
        let b = nearest(place, &|t| next.path.at(enter * t), (u.max(0.5) - 0.5) * 2.0);
        a.min(b)
    };
    let (mut worst, mut at) =
        (1..16)
            .map(|k| f64::from(k) / 16.0)
            .map(|u| (off(u), u))
            .fold(
                (from_corner, 0.5),
                |worst, found| if found.0 > worst.0 { found } else { worst },
            );
    // Where the nearer of both changes the distance has a peak, which lies between two looks.
    let mut step = 1.0 / 32.0;
    while step > 1e-3 {
        let found = [at - step, at + step].map(|u| (off(u.clamp(0.0, 1.0)), u));
        let further = if found[0].0 > found[1].0 { found[0] } else { found[1] };
        if further.0 > worst {
            (worst, at) = further;
        } else {
            step /= 2.0;
        }
    }
    worst
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

//! The smooth curve of one stretch from rest to rest: the programmed spans, and what is added at their joints.
//!
//! The parameter is the programmed length `s`, mm. The curve has a continuous second derivative by `s` and a bounded third one, so time can
//! be laid along it under a limit of jerk. It is computed where it is asked for; nothing is fitted, and what a joint adds is local.
//!
//! How far a joint reaches is decided in [`Course::settle`], as soon as enough of the path behind it is known: as far as the tolerance
//! allows, all joints added up.

use super::kernel::{
    EASING_PEAK, EASING_PLACE, Jet, ROUNDING_PEAK, SWING_PEAK, TURNING, easing, rounding, rounding_value, rounding_value_over,
    swing,
};
use super::span::{Place, Span};
use super::vector::{V3, add_scaled, length, minus};
use crate::smooth::{Corner, EXACT_PATH_TOLERANCE, Piece};
use std::collections::VecDeque;

/// Neighbours on each side that a joint may reach: the work for a place is bounded by it.
const REACH: usize = 24;

/// Farthest reach of a joint, mm, and how often the tolerance where that is more. What takes longer to pass than a jerk limit takes to
/// build up an acceleration gains nothing.
const FARTHEST: f64 = 12.0;
const FARTHEST_SHARE: f64 = 7.0;

/// Share of the tolerance that a joint plans with before neighbours of unequal reach are added up.
const SHARE: f64 = 0.9;

/// How exactly the largest reach is found, as a share.
const REACH_ERROR: f64 = 1e-8;

/// Share of a reach within which two places are the same.
const HAIR: f64 = 1e-7;

/// Ratio between the reaches that are tried.
const FINER: f64 = 0.75;
const NEARER: f64 = 0.96;

/// How a span goes on from the one before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Onset {
    /// A move begins.
    Move,
    /// Inside a spline, where direction and curvature go on.
    Smooth,
    /// Inside a spline, where they may step.
    Inside,
}

/// How far what is added inside a spline may leave it, mm: splines are kept, whatever the tolerance.
const INSIDE: f64 = 0.0009;

/// Length of the step of the tangent from which on a place inside a spline is a corner, for which the tolerance is.
const KINK: f64 = 1e-3;

/// Where a span begins: what steps there.
#[derive(Clone, Copy, Debug)]
struct Joint {
    s: f64,
    turn: V3,
    bend: V3,
    sizes: [f64; 2],
    half: f64,
    /// Something steps inside a spline.
    inside: bool,
    /// Nothing steps, inside a spline.
    is_smooth: bool,
}

/// Turns from here on (the length of the step of the tangent; 29 degrees) are corners: the machine all but stops in them.
const CORNER: f64 = 0.5;

impl Joint {
    fn is_corner(&self) -> bool {
        self.sizes[0] >= CORNER
    }

    /// What is added to the path for each step of the tangent.
    fn rounding(&self, d: f64) -> Jet {
        if self.is_corner() {
            swing(d, self.half)
        } else {
            rounding(d, self.half)
        }
    }

    /// Its value alone, if it reached so far.
    fn rounding_value(&self, d: f64, half: f64) -> f64 {
        if self.is_corner() {
            swing(d, half)[0]
        } else {
            rounding_value(d, half)
        }
    }

    fn peak(&self) -> f64 {
        if self.is_corner() { SWING_PEAK } else { ROUNDING_PEAK }
    }
}

/// Sides of a place.
#[derive(Clone, Copy)]
enum Side {
    Before,
    Behind,
}

/// Adds what a joint makes of a place; what its third derivative has on one side only is `missing` on the other.
#[inline(always)]
fn add_jet(place: &mut Place, missing: &mut V3, mut jet: Jet, step: V3, only: Option<Side>) {
    match only {
        None => {}
        Some(Side::Behind) => add_scaled(missing, step, -jet[3]),
        Some(Side::Before) => {
            add_scaled(missing, step, jet[3]);
            jet[3] = 0.0;
        }
    }
    for n in 0..4 {
        add_scaled(&mut place[n], step, jet[n]);
    }
}

/// What a joint near another one adds to the path there.
#[derive(Clone, Copy, Default)]
struct Near {
    d: f64,
    is_corner: bool,
    turn: V3,
    bend: Option<V3>,
}

/// One stretch.
#[derive(Debug, Default)]
pub(super) struct Course {
    spans: VecDeque<Span>,
    /// One for each span; the first of a stretch steps by nothing.
    joints: VecDeque<Joint>,
    /// Joints whose reach is final, and those that were checked with all that reach them, counted from the first kept.
    settled: usize,
    /// Length known, mm.
    pub(super) length: f64,
    /// Largest distance from the programmed path, mm.
    pub(super) deviation: f64,
    /// Largest tolerance of a span, mm.
    loosest: f64,
}

impl Course {
    /// Adds a move: a line, an arc or a part of a spline.
    pub(super) fn push(&mut self, piece: &Piece, onset: Onset) {
        let length = piece.length;
        let span = Span::of(piece, self.length);
        let (turn, bend) = match self.spans.back() {
            None => ([0.0; 3], [0.0; 3]),
            Some(_) if onset == Onset::Smooth => ([0.0; 3], [0.0; 3]),
            Some(last) => {
                let [_, a1, a2, _] = last.at(last.length);
                let [_, b1, b2, _] = span.at(0.0);
                (minus(b1, a1), minus(b2, a2))
            }
        };
        let sizes = [turn, bend].map(super::vector::length);
        // Also the arcs of a spline that was cut at a knot.
        let of_one = self
            .spans
            .back()
            .is_some_and(|last| last.step == span.step && last.is_curve() && span.is_curve());
        self.joints.push_back(Joint {
            s: self.length,
            turn,
            bend,
            sizes,
            half: 0.0,
            inside: (onset == Onset::Inside || of_one) && onset != Onset::Smooth && sizes[0] < KINK,
            is_smooth: onset == Onset::Smooth,
        });
        self.length += length;
        self.loosest = self.loosest.max(span.tolerance);
        self.spans.push_back(span);
    }

    /// Number of spans that are kept.
    pub(super) fn len(&self) -> usize {
        self.spans.len()
    }

    /// Up to here the curve is final.
    pub(super) fn settled_to(&self, closed: bool) -> f64 {
        if closed {
            return self.length;
        }
        // What is not settled may still reach back, over REACH joints and no further than a joint ever does.
        let by_count = self.settled.checked_sub(REACH + 1).map_or(0.0, |k| self.joints[k].s);
        let by_length = self.joints.get(self.settled).map_or(0.0, |j| j.s - self.farthest());
        by_count.max(by_length).max(0.0)
    }

    /// Decides how far joints reach. With `closed` the stretch ends where it does now.
    pub(super) fn settle(&mut self, closed: bool) {
        let count = self.joints.len();
        let end = self.length;
        let first = self.settled;
        let mut reach: Vec<f64> = self.joints.iter().map(|j| j.half).collect();
        for k in first..count {
            reach[k] = self.widest(k, end, &reach);
        }
        // Two neighbours differ by no more than their distance, so that the smooth part beside a sharp corner does not reach over it.
        let gap = |k: usize| self.joints[k].s - self.joints[k - 1].s;
        for k in first.max(1)..count {
            reach[k] = reach[k].min(reach[k - 1] + gap(k));
        }
        for k in (first.max(1)..count.saturating_sub(1)).rev() {
            reach[k] = reach[k].min(reach[k + 1] + gap(k + 1));
        }
        let from = first.saturating_sub(REACH);
        for round in 0..40 {
            let mut fits = true;
            for k in from..count {
                let joint = &self.joints[k];
                // An easing is largest beside its joint.
                let aside = if joint.sizes[1] > 0.0 { EASING_PLACE * reach[k] } else { 0.0 };
                let here = self.tolerance_at(k);
                let places = [
                    (joint.s, here),
                    (joint.s + 0.5 * self.spans[k].length, self.spans[k].tolerance),
                    (joint.s - aside, here),
                    (joint.s + aside, here),
                ];
                let places = places.into_iter().take(if aside > 0.0 { 4 } else { 2 });
                for (place, tolerance) in places {
                    let [all, inside] = self.off(k, place, &reach).map(length);
                    if all > tolerance || inside > INSIDE {
                        fits = false;
                        let (low, high) = (k.saturating_sub(REACH).max(first), (k + REACH + 1).min(count));
                        let shrink = if round < 20 { 0.8 } else { 0.5 };
                        for j in low..high {
                            if (self.joints[j].s - place).abs() < reach[j] {
                                reach[j] *= shrink;
                            }
                        }
                    }
                }
            }
            if fits {
                break;
            }
        }
        let last = if closed {
            count
        } else {
            let far = self.joints.partition_point(|j| j.s < end - 2.0 * self.farthest());
            count.saturating_sub(3 * REACH).max(far.saturating_sub(1)).max(first)
        };
        for (k, half) in reach.iter().enumerate().take(last).skip(first) {
            // Where nothing steps there is nothing to look at.
            self.joints[k].half = if self.joints[k].is_smooth { 0.0 } else { *half };
            let s = self.joints[k].s;
            let aside = if self.joints[k].sizes[1] > 0.0 {
                EASING_PLACE * half
            } else {
                0.0
            };
            for place in [s, s - aside, s + aside].into_iter().take(if aside > 0.0 { 3 } else { 1 }) {
                self.deviation = self.deviation.max(length(self.off(k, place, &reach)[0]));
            }
        }
        self.settled = last.max(first);
    }

    /// No joint reaches further, mm.
    fn farthest(&self) -> f64 {
        FARTHEST.max(FARTHEST_SHARE * self.loosest)
    }

    /// How far the path may be left where span `k` begins.
    fn tolerance_at(&self, k: usize) -> f64 {
        let here = self.spans[k].tolerance;
        k.checked_sub(1).map_or(here, |before| here.min(self.spans[before].tolerance))
    }

    /// The largest reach of joint `k` with which it and its neighbours, all reaching as far, stay within the tolerance at it.
    fn widest(&self, k: usize, end: f64, found: &[f64]) -> f64 {
        let joint = &self.joints[k];
        // Alone it may use all of it.
        let share = if joint.is_corner() { 0.995 } else { SHARE };
        let within = self.tolerance_at(k);
        let tolerance = share * if joint.inside { within.min(INSIDE) } else { within };
        let count = self.joints.len();
        let neighbour = |other: Option<&Joint>, else_to: f64| other.map_or((else_to - joint.s).abs(), |o| (o.s - joint.s).abs());
        let by_count = neighbour(k.checked_sub(REACH).and_then(|j| self.joints.get(j)), 0.0)
            .min(neighbour(self.joints.get(k + REACH), end))
            .min(FARTHEST.max(FARTHEST_SHARE * tolerance))
            .min(joint.s)
            .min(end - joint.s);
        // Those that may reach here, by how far away they are.
        let (low, high) = (k.saturating_sub(REACH), (k + REACH + 1).min(count));
        let mut near = [Near::default(); 2 * REACH + 1];
        let mut few = 0;
        for other in self.joints.range(low..high) {
            let d = joint.s - other.s;
            if d.abs() < by_count {
                near[few] = Near {
                    d,
                    is_corner: other.is_corner(),
                    turn: other.turn,
                    bend: (other.sizes[1] > 0.0).then_some(other.bend),
                };
                few += 1;
            }
        }
        let near = &near[..few];
        let off = |half: f64| {
            let mut off = [0.0; 3];
            let over = 2.0 / half;
            for Near {
                d,
                is_corner,
                turn,
                bend,
            } in near
            {
                if d.abs() < half {
                    let value = if *is_corner {
                        swing(*d, half)[0]
                    } else {
                        rounding_value_over(*d, 0.5 * half, over)
                    };
                    add_scaled(&mut off, *turn, value);
                    if let Some(bend) = bend {
                        add_scaled(&mut off, *bend, easing(*d, half)[0]);
                    }
                }
            }
            // An easing is 0 at its own joint, and largest beside it.
            length(off).max(joint.sizes[1] * EASING_PEAK * half * half) / tolerance
        };
        // An even bend has its neighbour's reach.
        let like = k.checked_sub(1).map_or(0.0, |before| 1.02 * found[before]);
        let mut half = if like > 0.0 { like.min(by_count) } else { by_count };
        if half <= 0.0 {
            return 0.0;
        }
        let mut load = off(half);
        if load <= 1.0 && half < by_count {
            half = by_count;
            load = off(half);
        }
        if load <= 1.0 {
            return half;
        }
        // What is off grows with the reach of one corner, and with the square of the reach over a bend.
        let mut over = (half, load);
        let mut finer = if half < by_count { NEARER } else { FINER };
        for _ in 0..40 {
            if load <= 1.0 {
                break;
            }
            over = (half, load);
            let alone = joint.sizes[0] * joint.peak() * half / tolerance;
            half *= finer.min(if alone > 1.0 { 1.02 / alone } else { 1.0 }).max(0.9 / load);
            if half < 1e-9 {
                return 0.0;
            }
            load = off(half);
            finer = FINER;
        }
        if load > 1.0 {
            return 0.0;
        }
        // The reach itself, not a step of the search: neighbours on an even bend have to reach evenly, and a last digit of a coordinate must
        // not make another curve. Between two reaches the load is about a power of the reach.
        let mut within = (half, load);
        let (mut low, mut high) = (libm::log(load.max(1e-9)), libm::log(over.1));
        let mut last = None;
        for _ in 0..12 {
            if over.0 < within.0 * (1.0 + REACH_ERROR) || within.1 > 1.0 - REACH_ERROR {
                break;
            }
            let share = (-low / (high - low)).clamp(0.02, 0.98);
            let middle = within.0 * libm::pow(over.0 / within.0, share);
            let there = off(middle);
            let log = libm::log(there.max(1e-9));
            // A side that stays twice counts half (Illinois), so that both close in.
            if there <= 1.0 {
                (within, low) = ((middle, there), log);
                high *= if last == Some(true) { 0.5 } else { 1.0 };
            } else {
                (over, high) = ((middle, there), log);
                low *= if last == Some(false) { 0.5 } else { 1.0 };
            }
            last = Some(there <= 1.0);
        }
        within.0
    }

    /// What the joints around span `k` add at `s`, with these reaches; and what those inside splines do of it.
    fn off(&self, k: usize, s: f64, reach: &[f64]) -> [V3; 2] {
        let (low, high) = (k.saturating_sub(REACH), (k + REACH + 1).min(self.joints.len()));
        let (mut off, mut inside) = ([0.0; 3], [0.0; 3]);
        for (joint, half) in self.joints.range(low..high).zip(&reach[low..high]) {
            let d = s - joint.s;
            if d.abs() < *half {
                let to = if joint.inside { &mut inside } else { &mut off };
                add_scaled(to, joint.turn, joint.rounding_value(d, *half));
                if joint.sizes[1] > 0.0 {
                    add_scaled(to, joint.bend, easing(d, *half)[0]);
                }
            }
        }
        add_scaled(&mut off, inside, 1.0);
        [off, inside]
    }

    /// The span that `s` lies in, as an index into what is kept.
    pub(super) fn span_at(&self, s: f64) -> usize {
        self.spans.partition_point(|span| span.start <= s).saturating_sub(1)
    }

    /// Slowest feed between two lengths, mm/s.
    pub(super) fn feed_between(&self, from: f64, to: f64, scale: f64) -> f64 {
        let first = self.span_at(from);
        let on_the_way = self
            .spans
            .range(first..)
            .enumerate()
            .take_while(|(k, span)| *k == 0 || span.start < to);
        let feeds = on_the_way.map(|(_, span)| {
            let (begin, end) = ((from - span.start).max(0.0), (to - span.start).min(span.length));
            span.feed_between(begin.min(span.length), end, scale)
        });
        feeds.fold(f64::INFINITY, f64::min)
    }

    /// A span by its index.
    pub(super) fn span(&self, k: usize) -> &Span {
        &self.spans[k]
    }

    /// The curve at `s`, which lies in span `k`.
    pub(super) fn at(&self, k: usize, s: f64) -> Place {
        self.sides(k, s).0
    }

    /// The curve at `s`, which lies in span `k`, and its third derivative just before: it steps where a support ends and where an arc does.
    pub(super) fn sides(&self, k: usize, s: f64) -> (Place, V3) {
        let span = &self.spans[k];
        let mut place = span.at(s - span.start);
        // What the third derivative just before is more than that behind.
        let mut missing = match k.checked_sub(1).map(|k| &self.spans[k]) {
            Some(last) if s <= span.start && !(last.is_line() && span.is_line()) => minus(last.at(last.length)[3], place[3]),
            _ => [0.0; 3],
        };
        let (low, high) = (k.saturating_sub(REACH), (k + REACH + 1).min(self.joints.len()));
        for joint in self.joints.range(low..high) {
            let d = s - joint.s;
            if d.abs() < joint.half * (1.0 + HAIR) {
                let most = joint.half * (1.0 - HAIR);
                // On the end of its support it is on one side, whatever the last digit.
                let (d, only) = match d {
                    _ if d > most => (most, Some(Side::Before)),
                    _ if d < -most => (-most, Some(Side::Behind)),
                    _ => (d, None),
                };
                add_jet(&mut place, &mut missing, joint.rounding(d), joint.turn, only);
                if joint.sizes[1] > 0.0 {
                    add_jet(&mut place, &mut missing, easing(d, joint.half), joint.bend, only);
                }
            }
        }
        add_scaled(&mut missing, place[3], 1.0);
        (place, missing)
    }

    /// Shortest reach of the joints whose support holds `s`, and where the next support begins or ends.
    pub(super) fn detail_at(&self, k: usize, s: f64) -> (f64, f64) {
        let (low, high) = (k.saturating_sub(REACH), (k + REACH + 1).min(self.joints.len()));
        let (mut shortest, mut next) = (f64::INFINITY, f64::INFINITY);
        for joint in self.joints.range(low..high).filter(|j| j.half > 0.0) {
            let (begin, end) = (joint.s - joint.half, joint.s + joint.half);
            // A last digit does not tell two places apart.
            let hair = 10.0 * HAIR * joint.half;
            if begin > s + hair {
                next = next.min(begin);
            } else if end > s + hair {
                shortest = shortest.min(joint.half);
                next = next.min(end);
            }
        }
        (shortest, next)
    }

    /// Places between two lengths at which the third derivative steps: where the supports of corners and of steps of curvature end, and
    /// where these turn.
    pub(super) fn steps_between(&self, from: f64, to: f64) -> Vec<f64> {
        let reach = self.farthest();
        let low = self.joints.partition_point(|j| j.s < from - reach);
        let mut places: Vec<f64> = vec![];
        for joint in self.joints.range(low..).take_while(|j| j.s <= to + reach) {
            let eased = joint.sizes[1] > 0.0;
            if joint.half > 0.0 && (eased || joint.is_corner()) {
                places.extend([joint.s - joint.half, joint.s, joint.s + joint.half]);
                if eased {
                    let turn = joint.half * (1.0 - TURNING);
                    places.extend([joint.s - turn, joint.s + turn]);
                }
            }
        }
        places.retain(|s| *s > from && *s <= to);
        places.sort_by(f64::total_cmp);
        places
    }

    /// Forgets the spans that nothing from `s` on needs.
    pub(super) fn forget_before(&mut self, s: f64) {
        let keep = self.span_at(s).saturating_sub(2 * REACH + 2).min(self.settled);
        self.spans.drain(..keep);
        self.joints.drain(..keep);
        self.settled -= keep;
    }
}

/// True when two moves that follow each other can be passed without a rest.
pub(super) fn is_passable(last: &Piece, next: &Piece) -> bool {
    if last.corner == Corner::Stop || last.rapid != next.rapid || !next.goes_on_from(last) {
        return false;
    }
    let tangents = [last.path.derivatives(1.0).0, next.path.derivatives(0.0).0];
    let [Some(out), Some(into)] = tangents.map(units::Vector::unit) else {
        return false;
    };
    let turn = libm::atan2(out.cross(into).length(), out.dot(into));
    let tolerance = last.corner.tolerance().min(next.corner.tolerance());
    turn <= crate::smooth::REVERSAL && tolerance >= LEAST_TOLERANCE
}

/// Below this (mm) a corner is a stop: rounding it would gain less than a cycle.
const LEAST_TOLERANCE: f64 = EXACT_PATH_TOLERANCE / 100.0;

//! What the limits allow along the curve, looked at where they change, and how fast it could be travelled about.

use super::super::vector::length;
use super::{DETAIL, Stretch, TURN, forward};

/// A place at which limits were looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub(super) s: f64,
    /// Largest b here, and between here and the next one.
    pub(super) cap: f64,
    pub(super) cap_behind: f64,
    /// Acceleration and jerk along the path that the axes have here.
    pub(super) acceleration: f64,
    pub(super) jerk: f64,
    /// Longest interval between here and the next one.
    pub(super) detail: f64,
    /// A border of the grid has to be here.
    pub(super) border: bool,
    /// b^(3/4) that can be reached, with and without the rest at the end of what is known.
    pub(super) rising: f64,
    pub(super) open: f64,
    pub(super) ending: f64,
    /// The same as `open`, grown on where the speed stays as it is: how far it is to where it changes.
    pub(super) steady: f64,
}

impl Stretch {
    /// Looks at the limits along the part of the curve that is final.
    pub(super) fn look(&mut self) {
        let scale = self.feed_scale;
        let to = self.course.settled_to(self.closed);
        let mut s = self.sights.back().map_or(0.0, |sight| sight.s);
        if self.sights.is_empty() {
            let sight = self.sight(0, 0.0, false);
            self.sights.push_back(sight);
        }
        let mut k = self.course.span_at(s);
        while s < to {
            let (shortest, sharper) = self.course.detail_at(k, s);
            let span = self.course.span(k);
            let end = span.start + span.length;
            let mut next = (s + DETAIL / self.fineness * shortest).min(sharper);
            // Also a support that begins a hair away is a step forward.
            next = next.max(s + forward(s));
            if !span.is_line() {
                let place = self.course.at(k, s);
                let bend = length(place[2]) / length(place[1]).max(1e-9);
                next = next.min(s + (0.3 / bend.max(1e-6)).min(span.detail()));
            }
            let detail = span.detail();
            let mut border = false;
            let span = self.course.span(k);
            if !span.has_one_feed() {
                let inside = s - span.start;
                let tiny = 1e-9 * span.length;
                let places = span.feed_places().filter(|x| *x > inside + tiny && *x < span.length - tiny);
                let first = places.fold(f64::INFINITY, f64::min) + span.start;
                // A feed that changes along the path is followed in steps of its own.
                next = next.min(s + (0.04 * span.length).max(0.01));
                if first <= next {
                    (next, border) = (first, true);
                }
            }
            if next >= end * (1.0 - 1e-15) {
                // Into the next span: a border where the feed steps or a curve begins.
                let stop_here = k + 1 >= self.course.len() || {
                    let other = self.course.span(k + 1);
                    let feeds = (
                        span.feed_between(span.length, span.length, scale),
                        other.feed_between(0.0, 0.0, scale),
                    );
                    (feeds.0 - feeds.1).abs() > 1e-9 * feeds.0.min(feeds.1)
                        || !other.is_line()
                        || !span.is_line()
                        || !other.has_one_feed()
                };
                if stop_here {
                    next = end;
                    border = true;
                }
            }
            next = next.min(to);
            if next >= to {
                border |= self.closed;
            }
            let before = k;
            while k + 1 < self.course.len() && self.course.span(k + 1).start <= next {
                k += 1;
            }
            // What holds on the way.
            let feed = (before..=k).map(|i| {
                let span = self.course.span(i);
                let (from, to) = ((s - span.start).max(0.0), (next - span.start).min(span.length));
                if i > before && to <= 0.0 {
                    f64::INFINITY
                } else {
                    span.feed_between(from, to, scale)
                }
            });
            let feed = feed.fold(f64::INFINITY, f64::min);
            let sight = self.sight(k, next, border);
            let (a, b) = (self.sights.back_mut().expect("there is one"), sight);
            a.detail = (shortest * DETAIL).min(TURN * a.detail.min(b.detail)).min(detail) / self.fineness;
            a.cap_behind = feed * feed;
            self.sights.push_back(sight);
            s = next;
        }
    }

    /// The limits at a place. Its detail is the radius there, until what is behind it is known.
    pub(super) fn sight(&self, k: usize, s: f64, border: bool) -> Sight {
        let place = self.course.at(k, s);
        let [_, q1, q2, q3] = place;
        let (mut cap, mut acceleration, mut jerk) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (v, a, j) = (self.v_max[axis], self.a_max[axis], self.j_max[axis]);
            let over = 1.0 / q1[axis].abs().max(1e-12);
            cap = cap.min(v * over * v * over).min(a / q2[axis].abs().max(1e-300));
            let third = j / q3[axis].abs().max(1e-300);
            if third < 1e15 {
                cap = cap.min(libm::cbrt(third * third));
            }
            acceleration = acceleration.min(a * over);
            jerk = jerk.min(j * over);
        }
        let span = self.course.span(k);
        let x = (s - span.start).clamp(0.0, span.length);
        let feed = span.feed_between(x, x, self.feed_scale);
        let speed = length(q1).max(1e-9);
        Sight {
            s,
            cap: cap.min(feed * feed / (speed * speed)),
            cap_behind: f64::INFINITY,
            acceleration,
            jerk,
            detail: speed / length(q2).max(1e-12),
            border,
            rising: 0.0,
            open: 0.0,
            ending: 0.0,
            steady: 0.0,
        }
    }

    /// How fast the path could be travelled about: from rest b^(3/4) grows linearly with s at a constant jerk, and b does at a constant
    /// acceleration.
    pub(super) fn estimate(&mut self) {
        let grow = |y: f64, a: &Sight, b: &Sight| {
            let d = b.s - a.s;
            let by_jerk = y + growth(a, b) * d;
            let by_acceleration = libm::cbrt(y) * y + 2.0 * a.acceleration.min(b.acceleration) * d;
            by_jerk.min(three_quarters(by_acceleration))
        };
        let n = self.sights.len();
        let cap = |sight: &Sight, before: Option<&Sight>| {
            three_quarters(
                sight
                    .cap
                    .min(sight.cap_behind)
                    .min(before.map_or(f64::INFINITY, |b| b.cap_behind)),
            )
        };
        let caps: Vec<f64> = (0..n)
            .map(|i| cap(&self.sights[i], i.checked_sub(1).map(|b| &self.sights[b])))
            .collect();
        if self.grid.is_empty() {
            self.sights[0].rising = 0.0;
        }
        for i in 1..n {
            let y = grow(self.sights[i - 1].rising, &self.sights[i - 1], &self.sights[i]);
            self.sights[i].rising = y.min(caps[i]);
        }
        let last = n - 1;
        self.sights[last].ending = 0.0;
        self.sights[last].open = if self.closed { 0.0 } else { self.sights[last].rising };
        for i in (0..last).rev() {
            let (a, b) = (self.sights[i], self.sights[i + 1]);
            let top = a.rising.min(caps[i]);
            self.sights[i].ending = grow(b.ending, &a, &b).min(top);
            self.sights[i].open = grow(b.open, &a, &b).min(top);
        }
        // The first sight was known before.
        let alike = |x: f64, y: f64| (x - y).abs() <= 1e-6 * x.max(y);
        for i in 1..n {
            let flat =
                alike(self.sights[i].open, caps[i]) && alike(caps[i], caps[i - 1]) && (i == last || alike(caps[i], caps[i + 1]));
            let grown = self.sights[i - 1].steady
                + growth(&self.sights[i - 1], &self.sights[i]) * (self.sights[i].s - self.sights[i - 1].s);
            self.sights[i].steady = if flat {
                grown.max(self.sights[i].open)
            } else {
                self.sights[i].open
            };
        }
        self.sights[last].steady = self.sights[last].steady.min(self.sights[last].open);
        for i in (1..last).rev() {
            let (a, b) = (&self.sights[i], &self.sights[i + 1]);
            let grown = b.steady + growth(a, b) * (b.s - a.s);
            self.sights[i].steady = a.steady.min(grown.max(a.open));
        }
    }

    /// Estimated b^(3/4) at `s` between two sights, and its growth there.
    pub(super) fn between(a: &Sight, b: &Sight, s: f64) -> (f64, f64) {
        let slope = growth(a, b);
        let y = (a.open + slope * (s - a.s)).min(b.open + slope * (b.s - s));
        let b2 = |y: f64| libm::cbrt(y) * y;
        let acceleration = a.acceleration.min(b.acceleration);
        let by_acceleration = (b2(a.open) + 2.0 * acceleration * (s - a.s)).min(b2(b.open) + 2.0 * acceleration * (b.s - s));
        let cap = a.cap_behind;
        let y = y.min(three_quarters(by_acceleration.min(cap).max(0.0)));
        (y, slope)
    }
}

/// Growth of b^(3/4) with s at a constant jerk from rest: 3/4-th power of 6^(4/3)/4 j^(2/3).
pub(super) fn growth(a: &Sight, b: &Sight) -> f64 {
    2.1213 * libm::sqrt(a.jerk.min(b.jerk))
}

pub(super) fn three_quarters(b: f64) -> f64 {
    let root = libm::sqrt(b);
    root * libm::sqrt(root)
}

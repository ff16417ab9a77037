//! One stretch from rest to rest: its curve, what the limits allow along it, and the plan in a receding window.
//!
//! Four positions run along the stretch, each behind the one before: the path that is known, the part of the curve that is final, the grid
//! on which the plan is made, and what is planned for good. The window reaches from the last to the grid's end, where it is at rest; only
//! what that rest does not slow down is kept.

use super::course::{Course, Place};
use super::solver::{Begin, Border, Interval, Motion, Window};
use super::vector::length;
use crate::Limits;
use crate::smooth::Piece;
use std::collections::VecDeque;

/// Share of the limits that is planned with; the rest covers what happens between two borders.
const USED: f64 = 0.9980;

/// Largest load between two borders that is left as it is.
const TOLERATED: f64 = 1.0018;

/// Times that a window is solved again with less of the limits where more than them was used between borders.
const MOST_ROUNDS: u32 = 9;

/// Shares of an interval at which it is looked at.
const PLACES: [f64; 2] = [0.33, 0.67];

/// Time of an interval where the speed changes, s, and where it stays.
const INTERVAL: f64 = 0.0025;
const CRUISE: f64 = 0.010;

/// Largest growth of b^(3/4) in one interval: a third of what the speed grows by in it is lost to the mean jerk.
const GROWTH: f64 = 0.15;

/// Parts of the reach of a joint, and turn of the path in rad, after which limits are looked at again.
const DETAIL: f64 = 0.2;
const TURN: f64 = 0.10;

/// Time of the first interval from rest at the full jerk, s.
const FIRST: f64 = 0.004;

/// Stopping distances from the end of the grid within which nothing is planned for good: where the path bends the axes have less to brake
/// with.
const STOPS: f64 = 2.2;

/// Times to build up the acceleration within which nothing is planned for good.
const SWINGS: f64 = 2.5;

/// Share of the jerk with which a rest is approached that is only the end of what is known.
const PROVISIONAL: f64 = 0.3;

/// Intervals of a window at most.
const MOST_INTERVALS: usize = 4000;

/// Spans of which a stretch holds more only where nothing can be planned without.
const MOST_SPANS: usize = 60_000;

/// A place at which limits were looked at.
#[derive(Clone, Copy, Debug)]
struct Sight {
    s: f64,
    /// Largest b here, and between here and the next one.
    cap: f64,
    cap_behind: f64,
    /// Acceleration and jerk along the path that the axes have here.
    acceleration: f64,
    jerk: f64,
    /// Longest interval between here and the next one.
    detail: f64,
    /// A border of the grid has to be here.
    border: bool,
    /// b^(3/4) that can be reached, with and without the rest at the end of what is known.
    rising: f64,
    open: f64,
    ending: f64,
    /// The same as `open`, grown on where the speed stays as it is: how far it is to where it changes.
    steady: f64,
}

/// A border of the grid and the interval behind it.
#[derive(Clone, Copy, Debug)]
struct Cell {
    s: f64,
    border: Border,
    interval: Interval,
    /// Estimated b.
    estimate: f64,
}

/// A part of the planned motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase {
    /// Where it begins and its length, mm.
    pub(super) s: f64,
    pub(super) width: f64,
    pub(super) law: Law,
    /// Duration, s.
    pub(super) time: f64,
}

/// How s goes in a phase.
#[derive(Clone, Copy, Debug)]
pub(super) enum Law {
    /// b is quadratic: the second derivative of s by time is g + h (s - start); begins with this speed.
    Quadratic {
        speed: f64,
        g: f64,
        h: f64,
    },
    /// From rest, or to rest, at this constant third derivative.
    FromRest(f64),
    ToRest(f64),
}

/// A stretch being planned.
#[derive(Debug)]
pub(super) struct Stretch {
    pub(super) course: Course,
    v_max: [f64; 3],
    a_max: [f64; 3],
    j_max: [f64; 3],
    sights: VecDeque<Sight>,
    grid: VecDeque<Cell>,
    /// The plan up to the second cell of the grid is given out; `false`: it begins at rest.
    moving: bool,
    grid_end: f64,
    pub(super) closed: bool,
    /// All of it has been planned.
    pub(super) planned: bool,
    pub(super) phases: VecDeque<Phase>,
    /// Length ahead that a round needs, mm, and the fastest feed that was seen.
    needed: f64,
    fastest: f64,
}

impl Stretch {
    pub(super) fn new(limits: &Limits, j_max: [f64; 3]) -> Stretch {
        Stretch {
            course: Course::default(),
            v_max: limits.v_max.map(|v| v.0 * USED),
            a_max: limits.a_max.map(|a| a.0 * USED),
            j_max: j_max.map(|j| j * USED),
            sights: VecDeque::new(),
            grid: VecDeque::new(),
            moving: false,
            grid_end: 0.0,
            closed: false,
            planned: false,
            phases: VecDeque::new(),
            needed: 0.0,
            fastest: 0.0,
        }
    }

    /// Adds a move.
    pub(super) fn push(&mut self, piece: &Piece) {
        self.course.push(piece);
        let top = piece.feed_factors.iter().map(|f| f.1).reduce(f64::max).unwrap_or(1.0);
        let axes = length(self.v_max);
        self.fastest = self.fastest.max(axes.min(piece.feed * top));
        let least = |limits: [f64; 3]| limits.into_iter().fold(f64::INFINITY, f64::min);
        let (v, a, j) = (self.fastest, least(self.a_max), least(self.j_max));
        self.needed = self
            .needed
            .max(6.0 * (0.5 * v * v / a + v * (0.5 * a / j).min(libm::sqrt(v / j))) + 10.0);
    }

    /// True when a round of planning can be made without knowing more.
    pub(super) fn is_full(&self) -> bool {
        let done = self.grid.front().map_or(0.0, |c| c.s);
        self.course.length - done > self.needed || self.course.len() > MOST_SPANS
    }

    /// Makes phases of what is known, if that is enough.
    pub(super) fn plan(&mut self) {
        if self.planned || !(self.closed || self.is_full()) {
            return;
        }
        let crowded = self.course.len() > MOST_SPANS;
        self.course.settle(self.closed);
        self.look();
        self.estimate();
        self.lay_grid(crowded);
        let given = self.solve(crowded);
        if given == 0 && !self.closed {
            self.needed *= 1.6;
        }
        if let Some(first) = self.grid.front() {
            let s = first.s;
            while self.sights.len() > 2 && self.sights[1].s <= self.grid_end {
                self.sights.pop_front();
            }
            // The sampler is behind the plan.
            let sampled = self.phases.front().map_or(s, |p| p.s).min(s);
            self.course.forget_before(sampled);
        }
    }

    /// Looks at the limits along the part of the curve that is final.
    fn look(&mut self) {
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
            let mut next = (s + DETAIL * shortest).min(sharper);
            // Also a support that begins a hair away is a step forward.
            next = next.max(s + 1e-10);
            if !span.is_line() {
                let place = self.course.at(k, s);
                let bend = length(place[2]) / length(place[1]).max(1e-9);
                next = next.min(s + 0.3 / bend.max(1e-6));
            }
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
                    let feeds = (span.feed_between(span.length, span.length), other.feed_between(0.0, 0.0));
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
                    span.feed_between(from, to)
                }
            });
            let feed = feed.fold(f64::INFINITY, f64::min);
            let sight = self.sight(k, next, border);
            let (a, b) = (self.sights.back_mut().expect("there is one"), sight);
            a.detail = (shortest * DETAIL).min(TURN * a.detail.min(b.detail));
            a.cap_behind = feed * feed;
            self.sights.push_back(sight);
            s = next;
        }
    }

    /// The limits at a place. Its detail is the radius there, until what is behind it is known.
    fn sight(&self, k: usize, s: f64, border: bool) -> Sight {
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
        let feed = span.feed_between(x, x);
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
    fn estimate(&mut self) {
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
    fn between(a: &Sight, b: &Sight, s: f64) -> (f64, f64) {
        let slope = growth(a, b);
        let y = (a.open + slope * (s - a.s)).min(b.open + slope * (b.s - s));
        let b2 = |y: f64| libm::cbrt(y) * y;
        let acceleration = a.acceleration.min(b.acceleration);
        let by_acceleration = (b2(a.open) + 2.0 * acceleration * (s - a.s)).min(b2(b.open) + 2.0 * acceleration * (b.s - s));
        let cap = a.cap_behind;
        let y = y.min(three_quarters(by_acceleration.min(cap).max(0.0)));
        (y, slope)
    }

    /// Lays borders of the grid as far as the end of what is known has no influence; all the way when it is the end of the stretch.
    fn lay_grid(&mut self, crowded: bool) {
        let n = self.sights.len();
        if n < 2 {
            return;
        }
        let to = if self.closed || crowded {
            self.sights[n - 1].s
        } else {
            let free = (0..n)
                .rev()
                .find(|i| self.sights[*i].ending >= self.sights[*i].open * (1.0 - 1e-9) && self.sights[*i].open > 0.0);
            free.map_or(self.grid_end, |i| self.sights[i].s)
        };
        if self.grid.is_empty() {
            let cell = self.cell(0.0, 0.0);
            self.grid.push_back(cell);
            self.grid_end = 0.0;
        }
        // The last cell is the end of the grid.
        let (start, end) = (self.sights[0].s, self.sights[n - 1].s);
        let total = end - start;
        let mut i = 0;
        let mut s = self.grid_end;
        while s < to && self.grid.len() < MOST_INTERVALS {
            while i + 2 < n && self.sights[i + 1].s <= s {
                i += 1;
            }
            let width = self.width_at(i, s, to, total);
            let mut next = s + width;
            // Not over a place that has to be a border, and nothing tiny before it.
            let mut m = i + 1;
            while m < n {
                let other = &self.sights[m];
                if other.s > next + 0.5 * width {
                    break;
                }
                if (other.border || m + 1 == n || other.s >= to) && other.s > s {
                    next = if other.s > next { s + 0.5 * (other.s - s) } else { other.s };
                    break;
                }
                m += 1;
            }
            let next = next.min(to);
            let (y, _) = {
                let mut m = i;
                while m + 2 < n && self.sights[m + 1].s <= next {
                    m += 1;
                }
                Self::between(&self.sights[m], &self.sights[m + 1], next)
            };
            let mut cell = self.cell(next, libm::cbrt(y) * y);
            let behind = self.grid.back_mut().expect("it begins with one");
            behind.interval.width = next - s;
            let mut cap = f64::INFINITY;
            for sight in self.sights.range(i..).take_while(|sight| sight.s < next) {
                cap = cap.min(sight.cap_behind);
            }
            behind.interval.share = 1.0;
            // The feed is that of the path; where the curve cuts a corner s runs a little faster than the path.
            let speed = |c: &Cell| {
                c.border
                    .acceleration
                    .iter()
                    .zip(&self.a_max)
                    .map(|(r, a)| r[1] * a)
                    .map(|q| q * q)
                    .sum::<f64>()
            };
            behind.interval.cap = (cap / speed(behind).max(speed(&cell)).max(1e-18)).min(behind.border.cap.max(cell.border.cap));
            let here = cap / speed(&cell).max(1e-18);
            cell.border.cap = cell.border.cap.min(here);
            behind.border.cap = behind.border.cap.min(cap / speed(behind).max(1e-18));
            self.grid.push_back(cell);
            s = next;
        }
        self.grid_end = s;
    }

    /// How wide an interval may be that begins at `s` behind sight `i`.
    fn width_at(&self, i: usize, s: f64, to: f64, total: f64) -> f64 {
        let n = self.sights.len();
        let wide = |i: usize, s: f64| {
            let (a, b) = (&self.sights[i], &self.sights[i + 1]);
            let (y, slope) = Self::between(a, b, s);
            let v = libm::cbrt(y);
            let v = v * v;
            let steady = (a.steady + slope * (s - a.s)).min(b.steady + slope * (b.s - s)).max(y);
            let time = (INTERVAL * steady / y.max(1e-30)).clamp(INTERVAL, CRUISE);
            (v * time).min(GROWTH * steady / slope).min(a.detail)
        };
        let first = {
            let (a, b) = (&self.sights[0], &self.sights[1]);
            (a.jerk.min(b.jerk) * FIRST * FIRST * FIRST / 6.0).min(total / 300.0)
        };
        // The last interval has a constant jerk of s, so it must not be wider than the bends there.
        let mut last = first;
        for (a, b) in self.sights.iter().zip(self.sights.iter().skip(1)).rev() {
            if b.s <= to - last {
                break;
            }
            last = last.min(a.detail.max(to - b.s));
        }
        if self.closed && to - s <= 1.5 * last {
            return if to - s <= 1.01 * last { to - s } else { 0.5 * (to - s) };
        }
        let here = wide(i, s);
        // From rest.
        let mut width = if here <= 0.0 || (s == 0.0 && !self.moving && self.grid.len() == 1) {
            let (a, b) = (&self.sights[i], &self.sights[i + 1]);
            (a.jerk.min(b.jerk) * FIRST * FIRST * FIRST / 6.0)
                .min(total / 300.0)
                .min(a.detail)
        } else {
            here
        };
        // Where the speed falls the end of the interval decides.
        for _ in 0..3 {
            let mut m = i;
            let end = s + width;
            let mut narrow = width;
            while m + 2 < n && self.sights[m + 1].s <= end {
                m += 1;
                narrow = narrow.min(self.sights[m].detail.max(self.sights[m].s - s));
            }
            let there = wide(m, end.min(self.sights[n - 1].s));
            let closing = if self.closed {
                (to - end).max(0.0).max(last)
            } else {
                f64::INFINITY
            };
            let by_speed = there.max(last.min(closing)).max(0.2 * here.min(width));
            narrow = narrow.min(by_speed);
            if narrow >= width {
                break;
            }
            width = narrow;
        }
        width
    }

    /// The limits at a border of the grid.
    fn cell(&self, s: f64, estimate: f64) -> Cell {
        let k = self.course.span_at(s).min(self.course.len().saturating_sub(1));
        let place = self.course.at(k, s);
        let [_, q1, q2, q3] = place;
        let mut cap = f64::INFINITY;
        let mut border = Border::default();
        for axis in 0..3 {
            let (v, a, j) = (self.v_max[axis], self.a_max[axis], self.j_max[axis]);
            let over = v / q1[axis].abs().max(1e-9);
            cap = cap.min(over * over);
            border.acceleration[axis] = [q2[axis] / a, q1[axis] / a];
            border.jerk[axis] = [q3[axis] / j, 3.0 * q2[axis] / j, q1[axis] / j];
        }
        border.cap = cap;
        Cell {
            s,
            border,
            interval: Interval::default(),
            estimate,
        }
    }

    /// Plans the window and gives out what the rest at its end does not slow down. Gives the number of intervals given out.
    fn solve(&mut self, crowded: bool) -> usize {
        let n = self.grid.len().saturating_sub(1);
        if n < 4 {
            return 0;
        }
        let at_end = self.closed && self.grid_end >= self.course.length;
        let begin = if self.moving { Begin::Moving } else { Begin::Rest };
        let fixed = if self.moving { 2 } else { 0 };
        let mut borders: Vec<Border> = self.grid.iter().map(|c| c.border).collect();
        let mut intervals: Vec<Interval> = self.grid.iter().take(n).map(|c| c.interval).collect();
        self.rest_caps(&mut borders, &intervals, begin, at_end);
        for k in 1..n {
            intervals[k].cap = intervals[k].cap.min(borders[k].cap.max(borders[k + 1].cap));
        }
        self.guess(&borders, &mut intervals, begin, fixed);
        let between = self.between_borders(&intervals);
        for (interval, between) in intervals.iter_mut().zip(&between) {
            for border in between.iter().flatten() {
                interval.cap = interval.cap.min(border.cap);
            }
        }
        let mut rounds = 0;
        loop {
            let mut window = Window {
                borders: &borders,
                intervals: &mut intervals,
                begin,
            };
            window.solve();
            rounds += 1;
            // What happens between the borders.
            let mut tightened = false;
            for i in 1..n - 1 {
                let load = load_between(&window, i, &between[i]);
                if load > TOLERATED && rounds < MOST_ROUNDS {
                    // What a few rounds did not mend is taken harder.
                    let more = 1.5 + 0.5 * f64::from(rounds);
                    window.intervals[i].share *= (1.0 - more * (load - 1.0)).max(0.5);
                    tightened = true;
                }
            }
            if !tightened {
                break;
            }
        }
        let upto = if at_end {
            n
        } else {
            let free = self.slowed_from(&intervals, n);
            if crowded { free.max(n / 2) } else { free }
        };
        let first = if self.moving { 1 } else { 0 };
        if !at_end && upto < first + 4 {
            for (cell, interval) in self.grid.iter_mut().zip(&intervals) {
                cell.interval = *interval;
            }
            return 0;
        }
        let window = Window {
            borders: &borders,
            intervals: &mut intervals,
            begin,
        };
        for i in first..upto {
            let phase = phase(&window, i, self.grid[i].s, at_end);
            self.phases.push_back(phase);
        }
        for (cell, interval) in self.grid.iter_mut().zip(&intervals) {
            cell.interval = *interval;
        }
        if at_end {
            self.planned = true;
            self.grid.clear();
        } else {
            self.grid.drain(..upto - 1);
            self.moving = true;
        }
        upto - first
    }

    /// A motion within all limits to begin the search with: what was planned before, and behind it a creep.
    fn guess(&self, borders: &[Border], intervals: &mut [Interval], begin: Begin, fixed: usize) {
        let known = intervals.iter().rposition(|i| i.value > 0.0).map_or(0, |k| k + 1).max(fixed);
        let mut creep = f64::INFINITY;
        for k in known..intervals.len() {
            let (border, interval) = (&borders[k + 1], &intervals[k]);
            creep = creep.min(border.cap).min(interval.cap);
            for axis in 0..3 {
                let [x, y] = border.acceleration[axis].map(f64::abs);
                creep = creep.min(1.0 / (x + y / interval.width));
                let [x, y, z] = border.jerk[axis].map(f64::abs);
                let most = 1.0 / (x + y / interval.width + z / (interval.width * interval.width));
                creep = creep.min(libm::cbrt(most * most));
            }
        }
        creep *= 0.3;
        let mut before = f64::INFINITY;
        for _ in 0..40 {
            for interval in &mut intervals[known..] {
                interval.value = creep;
            }
            let mut window = Window {
                borders,
                intervals,
                begin,
            };
            let worst = window.worst_from(known.saturating_sub(3));
            // What does not become less is not the creep's.
            if worst < 0.9995 || worst > 0.98 * before {
                break;
            }
            before = worst;
            creep *= 0.3;
        }
    }

    /// The first interval from which on the rest at the end of the grid may slow the plan down: nearer to it than a few times what it takes
    /// to stop.
    fn slowed_from(&self, intervals: &[Interval], n: usize) -> usize {
        let (mut left, mut time) = (0.0, 0.0);
        for k in (0..n).rev() {
            let (cell, interval) = (&self.grid[k], &intervals[k]);
            left += interval.width;
            let (mut a, mut j) = (f64::INFINITY, f64::INFINITY);
            for axis in 0..3 {
                a = a.min(1.0 / cell.border.acceleration[axis][1].abs().max(1e-15));
                j = j.min(1.0 / cell.border.jerk[axis][2].abs().max(1e-18));
            }
            let v = libm::sqrt(interval.value);
            let stop = if v < a * a / j {
                v * libm::sqrt(v / j)
            } else {
                0.5 * v * (v / a + a / j)
            };
            // As fast as it could go if the end were not there.
            time += interval.width / libm::sqrt(cell.estimate.max(self.grid[k + 1].estimate).max(interval.value));
            if left > STOPS * stop && time > SWINGS * a / j && n - k > 8 {
                return k;
            }
        }
        0
    }

    /// Largest b at the first and last inner border by the jerk of the intervals at rest.
    ///
    /// Where the grid goes on later the end is slower: the same coefficients then have to do without the constant jerk.
    fn rest_caps(&self, borders: &mut [Border], intervals: &[Interval], begin: Begin, at_end: bool) {
        let n = intervals.len();
        let mut limit = |at: usize, rest: usize, width: f64, direction: f64, share: f64| {
            // With b = 1 there: s is a cube of the time, so t = 3 width / speed.
            let t = 3.0 * width;
            let (g, third) = (direction * 2.0 / t, 2.0 / (t * t));
            let (mut jerk, mut acceleration) = (0.0f64, 0.0f64);
            let mut look = |border: &Border, time: f64| {
                let v2 = time * time * time * time;
                for row in &border.jerk {
                    jerk = jerk.max((row[0] * v2 * time * time + row[1] * time * time * time * g + row[2] * third).abs());
                }
                for row in &border.acceleration {
                    acceleration = acceleration.max((row[0] * v2 + row[1] * time * g).abs());
                }
            };
            look(&borders[at], 1.0);
            look(&borders[rest], 0.0);
            let bent = |border: &Border| border.jerk.iter().any(|r| r[0] != 0.0 || r[1] != 0.0);
            if bent(&borders[at]) || bent(&borders[rest]) {
                for k in 1..8 {
                    let time = f64::from(k) / 8.0;
                    let s = self.grid[rest].s + direction * width * time * time * time;
                    look(&self.cell(s, 0.0).border, time);
                }
            }
            let most = share / jerk.max(1e-300);
            borders[at].cap = borders[at]
                .cap
                .min(libm::cbrt(most * most))
                .min(1.0 / acceleration.max(1e-300));
        };
        if begin == Begin::Rest {
            limit(1, 0, intervals[0].width, 1.0, 1.0);
        }
        limit(n - 1, n, intervals[n - 1].width, -1.0, if at_end { 1.0 } else { PROVISIONAL });
    }

    /// The limits inside intervals, where they are others than at their borders.
    fn between_borders(&self, intervals: &[Interval]) -> Vec<Option<[Border; 2]>> {
        // Straight ahead nothing happens between borders that does not happen at them.
        let bent = |border: &Border| border.jerk.iter().any(|r| r[0] != 0.0 || r[1] != 0.0);
        (0..intervals.len())
            .map(|i| {
                let cell = &self.grid[i];
                (bent(&cell.border) || bent(&self.grid[i + 1].border))
                    .then(|| PLACES.map(|share| self.cell(cell.s + share * intervals[i].width, 0.0).border))
            })
            .collect()
    }

    /// The place at `s`, and the step there.
    pub(super) fn place(&self, s: f64) -> (Place, units::StepId) {
        let k = self.course.span_at(s);
        (self.course.at(k, s), self.course.span(k).step)
    }
}

/// Largest load of acceleration and jerk inside interval `i`.
fn load_between(window: &Window<'_>, i: usize, between: &Option<[Border; 2]>) -> f64 {
    let Some(between) = between else { return 0.0 };
    let (here, next) = (window.motion(i), window.motion(i + 1));
    let h = (next.g - here.g) / window.intervals[i].width;
    let mut worst = 0.0f64;
    for (share, border) in PLACES.into_iter().zip(between) {
        let d = share * window.intervals[i].width;
        let motion = Motion {
            b: here.b + 2.0 * here.g * d + h * d * d,
            g: here.g + h * d,
        };
        let root = libm::sqrt(motion.b.max(0.0));
        for axis in 0..3 {
            let [x, y] = border.acceleration[axis];
            worst = worst.max((x * motion.b + y * motion.g).abs());
            let [x, y, z] = border.jerk[axis];
            worst = worst.max((x * motion.b + y * motion.g + z * h).abs() * root);
        }
    }
    worst
}

/// Growth of b^(3/4) with s at a constant jerk from rest: 3/4-th power of 6^(4/3)/4 j^(2/3).
fn growth(a: &Sight, b: &Sight) -> f64 {
    2.1213 * libm::sqrt(a.jerk.min(b.jerk))
}

fn three_quarters(b: f64) -> f64 {
    let root = libm::sqrt(b);
    root * libm::sqrt(root)
}

/// The motion in interval `i` that begins at `s`.
fn phase(window: &Window<'_>, i: usize, s: f64, at_end: bool) -> Phase {
    let n = window.intervals.len();
    let width = window.intervals[i].width;
    if i == 0 {
        let v = libm::sqrt(window.motion(1).b);
        let time = 3.0 * width / v;
        return Phase {
            s,
            width,
            law: Law::FromRest(6.0 * width / (time * time * time)),
            time,
        };
    }
    if i + 1 == n && at_end {
        let v = libm::sqrt(window.motion(n - 1).b);
        let time = 3.0 * width / v;
        return Phase {
            s,
            width,
            law: Law::ToRest(6.0 * width / (time * time * time)),
            time,
        };
    }
    let (here, next) = (window.motion(i), window.motion(i + 1));
    let h = (next.g - here.g) / width;
    let (v, end) = (libm::sqrt(here.b), libm::sqrt(next.b));
    let law = Law::Quadratic { speed: v, g: here.g, h };
    let mut time = 2.0 * width / (v + end);
    for _ in 0..30 {
        let (x, speed, _) = law.at(time);
        let change = (width - x) / speed.max(1e-3 * v.min(end));
        time += change;
        if change.abs() <= 1e-15 * time {
            break;
        }
    }
    Phase { s, width, law, time }
}

impl Law {
    /// Length, speed and acceleration after a time in the phase; to rest, length is counted from the phase's beginning too.
    pub(super) fn at(&self, t: f64) -> (f64, f64, f64) {
        match *self {
            Law::Quadratic { speed, g, h } => {
                let z = h * t * t;
                // sinh(sqrt z)/sqrt z, and (cosh(sqrt z) - 1)/z; for negative z the same series is sin and cos.
                let (sine, cosine) = if z.abs() < 1.0 {
                    let mut term = 1.0;
                    let (mut sine, mut cosine) = (0.0, 0.0);
                    let mut k = 1.0;
                    while k < 24.0 {
                        sine += term;
                        cosine += term / (k + 1.0);
                        term *= z / ((k + 1.0) * (k + 2.0));
                        k += 2.0;
                    }
                    (sine, cosine)
                } else if z > 0.0 {
                    let w = libm::sqrt(z);
                    (libm::sinh(w) / w, (libm::cosh(w) - 1.0) / z)
                } else {
                    let w = libm::sqrt(-z);
                    (libm::sin(w) / w, (libm::cos(w) - 1.0) / z)
                };
                let x = speed * t * sine + g * t * t * cosine;
                (x, speed * (1.0 + z * cosine) + g * t * sine, g + h * x)
            }
            Law::FromRest(j) => (j * t * t * t / 6.0, 0.5 * j * t * t, j * t),
            Law::ToRest(j) => (j * t * t * t / 6.0, 0.5 * j * t * t, -j * t),
        }
    }
}

impl Phase {
    /// Length from its beginning, speed and acceleration along the path, `t` after it began.
    pub(super) fn at(&self, t: f64) -> (f64, f64, f64) {
        if let Law::ToRest(_) = self.law {
            let (left, speed, change) = self.law.at((self.time - t).max(0.0));
            (self.width - left, speed, change)
        } else {
            self.law.at(t)
        }
    }
}

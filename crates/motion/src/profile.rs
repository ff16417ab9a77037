//! The fastest speed along a smooth path, under the limits of every axis, in a receding window.
//!
//! The path is a sequence of short intervals of a curve parameter `u`. With b = (du/dt)^2 and e = d(b)/du / 2 = d2u/dt2, axis k has
//! speed q'_k sqrt(b) and acceleration q''_k b + q'_k e (Bobrow, Dubowsky and Gibson 1985; Verscheure and others 2009). b is linear in
//! u inside an interval, so e is constant there and u(t) is a parabola: nothing has to be inverted or integrated numerically.
//!
//! Two sweeps (Pham and Pham, TOPP-RA, 2018): backwards, the largest b at each border from which the end of the window can still be
//! reached at rest; forwards, the largest b that can be reached. The window's end is always at rest, so more path only ever allows more
//! speed: what was given out stays true. On a straight line the limits are constant, and the profile inside one interval is the exact
//! trapezoid; on curves an interval is so short that one acceleration is enough.

use crate::Limits;
use crate::smooth::{Curve, Segment};
use plan::Path;
use std::collections::VecDeque;
use std::rc::Rc;
use units::{Machine, StepId, Vector};

/// Share of the limits that is planned with: the rest covers what happens between two borders of a curve.
const USED: f64 = 0.9995;

/// A short part of the smoothed path.
#[derive(Clone, Debug)]
struct Interval {
    curve: Rc<Curve>,
    from: f64,
    width: f64,
    /// q' and q'' of each axis at the start, the middle and the end.
    first: [[f64; 3]; 3],
    second: [[f64; 3]; 3],
    /// Length of q' at both ends.
    norm: [f64; 2],
    /// Largest b at both ends by speed limits and feed.
    cap: [f64; 2],
    /// The limits are the same along it.
    straight: bool,
    /// Largest b at its start from which the window's end can be reached.
    reachable: f64,
    rest_at_end: Option<[f64; 3]>,
    step: StepId,
}

/// Something that stands between two parts of the path, by the number its owner gave it.
pub type Mark = usize;

/// A part of the motion with constant d2u/dt2.
#[derive(Clone, Debug)]
pub struct Phase {
    /// The curve that is travelled.
    pub curve: Rc<Curve>,
    /// Parameter at its start.
    pub u: f64,
    /// du/dt at its start.
    pub rate: f64,
    /// d2u/dt2, constant.
    pub change: f64,
    /// Duration, s.
    pub time: f64,
    /// Parameter at its end.
    pub end: f64,
    /// The step in whose name it is travelled.
    pub step: StepId,
}

/// What the profile gives, in order.
#[derive(Clone, Debug)]
pub enum Profiled {
    /// A part of the motion.
    Phase(Phase),
    /// The motion rests at this place, the end of what this step says.
    Rest([f64; 3], StepId),
    /// This stands here.
    Mark(Mark),
}

enum Entry {
    Interval(Box<Interval>),
    Mark(Mark),
}

/// Where two intervals meet: the curve on one side of it, and |q'| there.
type Border = (Rc<Curve>, f64);

/// b is a square of a rate of the parameter, so on another curve the same speed has another b; on the same curve nothing has to be
/// turned over, not even where q' is 0.
fn converted(b: f64, from: &Border, to: &Border) -> f64 {
    if Rc::ptr_eq(&from.0, &to.0) {
        b
    } else if from.1 > 0.0 && to.1 > 0.0 {
        let scale = from.1 / to.1;
        b * scale * scale
    } else {
        0.0
    }
}

/// Places inside an interval at which its speed limits are looked at.
const PLACES: [f64; 5] = [0.125, 0.25, 0.5, 0.75, 0.875];

/// Entries that the window holds at most: some 30 MB. Only a machine so fast and so weak that it takes tens of metres to stop gets
/// less look-ahead by it, and is then slower than it could be, but never outside its limits.
const MOST: usize = 100_000;

/// The window.
pub struct Profile {
    v_max: [f64; 3],
    a_max: [f64; 3],
    window: VecDeque<Entry>,
    /// Length of path in the window, mm, and how much of it came since the last backward sweep.
    length: f64,
    fresh: f64,
    /// Where the last interval that was given out ends, and b there.
    entry: Option<(Border, f64)>,
    /// Fastest feed in the window's recent past, mm/s: how far has to be looked ahead.
    fastest: f64,
    closed: bool,
    out: VecDeque<Profiled>,
}

impl Profile {
    /// An empty window, at rest.
    pub fn new(limits: &Limits) -> Profile {
        Profile {
            v_max: limits.v_max.map(|v| v.0 * USED),
            a_max: limits.a_max.map(|a| a.0 * USED),
            window: VecDeque::new(),
            length: 0.0,
            fresh: 0.0,
            entry: None,
            fastest: 0.0,
            closed: false,
            out: VecDeque::new(),
        }
    }

    /// Adds path at the end of the window.
    pub fn push(&mut self, segment: Segment) {
        self.closed = false;
        let curve = Rc::new(segment.curve);
        let straight_line = matches!(*curve, Curve::Line(..));
        let is_spline = matches!(&*curve, Curve::Programmed(path) if matches!(**path, Path::Spline(_)));
        let last = segment.borders.len().saturating_sub(2);
        let mut before = None;
        for (k, border) in segment.borders.windows(2).enumerate() {
            let (from, width) = (border[0], border[1] - border[0]);
            // At a knot of a spline the second derivative may step; each interval looks at it from its own side.
            let hair = if is_spline { 1e-7 * width } else { 0.0 };
            let start = before.take().unwrap_or_else(|| curve.derivatives(from + hair));
            let [middle, end] = if straight_line {
                [start; 2]
            } else {
                [width / 2.0, width - hair].map(|d| curve.derivatives(from + d))
            };
            let feed = |i: usize| *segment.feed.get(i).or(segment.feed.last()).unwrap_or(&f64::INFINITY);
            let norm = [start.0.length(), end.0.length()];
            let feeds = [feed(k), feed(k + 1)];
            let cap = self.caps([start, middle, end], feeds);
            let speed = (cap[0].sqrt() * norm[0]).max(cap[1].sqrt() * norm[1]);
            self.fastest = self.fastest.max(speed);
            let interval = Interval {
                curve: Rc::clone(&curve),
                from,
                width,
                first: [start.0.xyz, middle.0.xyz, end.0.xyz],
                second: [start.1.xyz, middle.1.xyz, end.1.xyz],
                norm,
                cap,
                straight: straight_line && feeds[0] == feeds[1],
                reachable: 0.0,
                rest_at_end: segment.rest_at_end.filter(|_| k == last).map(|p| p.xyz),
                step: segment.step,
            };
            self.length += interval.length();
            self.fresh += interval.length();
            self.window.push_back(Entry::Interval(Box::new(interval)));
            before = (!is_spline).then_some(end);
        }
    }

    /// Largest b at both ends of an interval by the speed of each axis and the feed, such that they hold everywhere between: b is linear
    /// there, and the speed that an axis allows grows faster than that towards a place where the path turns away from the axis.
    fn caps(&self, derivatives: [(Vector<Machine>, Vector<Machine>); 3], feeds: [f64; 2]) -> [f64; 2] {
        let [first, middle, last] = derivatives.map(|(first, _)| first);
        let at = |first: Vector<Machine>, feed: f64| {
            let axes = (0..3)
                .filter(|k| first.xyz[*k] != 0.0)
                .map(|k| self.v_max[k] / first.xyz[k].abs())
                .fold(f64::INFINITY, f64::min);
            let rate = axes.min(feed / first.length().max(f64::MIN_POSITIVE));
            rate * rate
        };
        let mut caps = [at(first, feeds[0]), at(last, feeds[1])];
        if first == middle && first == last {
            return caps;
        }
        // Places between, from q' at three of them, which is exact for lines, blends and cubic splines. With different feeds at its ends
        // the interval was made for them.
        let between = PLACES.map(|u| {
            let q = first * ((1.0 - u) * (1.0 - 2.0 * u)) + middle * (4.0 * u * (1.0 - u)) + last * (u * (2.0 * u - 1.0));
            let feed = libm::sqrt(feeds[0] * feeds[0] * (1.0 - u) + feeds[1] * feeds[1] * u);
            (u, at(q, feed))
        });
        let lowest = between.iter().map(|p| p.1).fold(caps[0].min(caps[1]), f64::min);
        let low = usize::from(caps[1] < caps[0]);
        caps[low] = caps[low].min(lowest);
        for (u, cap) in between {
            let share = if low == 0 { u } else { 1.0 - u };
            caps[1 - low] = caps[1 - low].min(caps[low] + (cap - caps[low]) / share);
        }
        caps
    }

    /// Puts a mark at the end of the window.
    pub fn mark(&mut self, mark: Mark) {
        self.window.push_back(Entry::Mark(mark));
    }

    /// No more path comes before the machine is at rest.
    pub fn close(&mut self) {
        self.closed = true;
    }

    /// True when the window is so long that its start can be given out without knowing more.
    pub fn is_full(&self) -> bool {
        (self.length > self.look_ahead() && self.fresh > 0.5 * self.look_ahead()) || self.window.len() > MOST
    }

    /// Length that has to be known ahead, mm: more than twice the stopping distance along the slowest axis, so that a path that bends
    /// while it stops is covered too.
    fn look_ahead(&self) -> f64 {
        let slowest = self.a_max.iter().copied().fold(f64::INFINITY, f64::min).max(1e-3);
        1.0 + 2.5 * self.fastest * self.fastest / (2.0 * slowest)
    }

    /// The next part; `None` when more path is needed, or, after [`Profile::close`], when everything was given out.
    pub fn advance(&mut self) -> Option<Profiled> {
        if self.out.is_empty() {
            self.plan();
        }
        self.out.pop_front()
    }

    /// True when nothing is left to give out.
    pub fn is_empty(&self) -> bool {
        self.out.is_empty() && self.window.is_empty()
    }

    /// Sweeps back, then gives out the start of the window: all of it when closed, else down to one look-ahead.
    fn plan(&mut self) {
        if self.window.is_empty() || !(self.closed || self.is_full()) {
            return;
        }
        self.sweep_back();
        let keep = if self.closed { 0.0 } else { self.look_ahead() };
        // A window that is full by number goes down to half, so that the next backward sweep is paid for by as many new entries.
        let most = if self.window.len() > MOST { MOST / 2 } else { MOST };
        self.fresh = 0.0;
        while let Some(entry) = self.window.pop_front() {
            match entry {
                Entry::Mark(mark) => self.out.push_back(Profiled::Mark(mark)),
                Entry::Interval(interval) => {
                    let length = interval.length();
                    // One look-ahead stays behind it, however long it is itself.
                    if !self.closed && self.length - length < keep && self.window.len() < most {
                        self.window.push_front(Entry::Interval(interval));
                        break;
                    }
                    self.length -= length;
                    let next = self.window.iter().find_map(|e| match e {
                        Entry::Interval(i) => Some((i.start(), i.reachable)),
                        Entry::Mark(_) => None,
                    });
                    self.forward(&interval, next.as_ref());
                }
            }
        }
        if self.window.is_empty() {
            self.length = 0.0;
            self.fastest = 0.0;
        }
    }

    /// Largest b at each start from which the window's end can be reached at rest; stops where nothing changes any more.
    fn sweep_back(&mut self) {
        let mut next: Option<(Border, f64)> = None;
        for entry in self.window.iter_mut().rev() {
            let Entry::Interval(interval) = entry else { continue };
            let at_end = end_limit(interval, next.as_ref());
            let reachable = if interval.straight {
                let e = straight_acceleration(&self.a_max, &interval.first[0]);
                interval.cap[0].min(at_end + 2.0 * e * interval.width)
            } else {
                interval.controllable(&self.a_max, at_end)
            };
            let unchanged = (reachable - interval.reachable).abs() <= 1e-13 * reachable;
            interval.reachable = reachable;
            if unchanged && reachable > 0.0 {
                break;
            }
            next = Some((interval.start(), reachable));
        }
    }

    /// Gives out one interval, as fast as its start, its limits and the rest of the window allow.
    fn forward(&mut self, interval: &Interval, next: Option<&(Border, f64)>) {
        let arriving = self
            .entry
            .take()
            .map_or(0.0, |(border, b)| converted(b, &border, &interval.start()));
        let start = arriving.min(interval.reachable);
        let at_end = end_limit(interval, next);
        let end = if interval.straight {
            let e = straight_acceleration(&self.a_max, &interval.first[0]);
            let end = at_end.min(start + 2.0 * e * interval.width);
            self.trapezoid(interval, start, end, e);
            end
        } else {
            let end = interval.fastest_end(&self.a_max, start, at_end);
            if start + end > 0.0 {
                self.give(interval, interval.from, interval.width, start, end);
            } else {
                // From rest to rest in one interval: up to the middle and down again.
                let e = interval.acceleration_from_rest(&self.a_max);
                let half = interval.width / 2.0;
                self.give(interval, interval.from, half, 0.0, 2.0 * e * half);
                self.give(interval, interval.from + half, half, 2.0 * e * half, 0.0);
            }
            end
        };
        self.entry = Some((interval.end(), end));
        if let Some(place) = interval.rest_at_end {
            self.out.push_back(Profiled::Rest(place, interval.step));
        }
    }

    /// The exact profile on a straight interval: up, along at the cap, down.
    fn trapezoid(&mut self, interval: &Interval, start: f64, end: f64, e: f64) {
        let width = interval.width;
        let cap = interval.cap[0];
        let peak = ((start + end) / 2.0 + e * width).min(cap).max(start.max(end));
        let up = ((peak - start) / (2.0 * e)).clamp(0.0, width);
        let down = ((peak - end) / (2.0 * e)).clamp(0.0, width - up);
        let along = width - up - down;
        self.give(interval, interval.from, up, start, peak);
        self.give(interval, interval.from + up, along, peak, peak);
        self.give(interval, interval.from + up + along, down, peak, end);
    }

    fn give(&mut self, interval: &Interval, from: f64, width: f64, start: f64, end: f64) {
        let rates = (start.max(0.0).sqrt(), end.max(0.0).sqrt());
        if width <= 0.0 || rates.0 + rates.1 <= 0.0 {
            return;
        }
        let time = 2.0 * width / (rates.0 + rates.1);
        self.out.push_back(Profiled::Phase(Phase {
            curve: Rc::clone(&interval.curve),
            u: from,
            rate: rates.0,
            change: (rates.1 - rates.0) / time,
            time,
            end: from + width,
            step: interval.step,
        }));
    }
}

/// Largest b at an interval's end: its own cap, and what its successor can take.
fn end_limit(interval: &Interval, next: Option<&(Border, f64)>) -> f64 {
    match next {
        Some((border, reachable)) if interval.rest_at_end.is_none() => {
            interval.cap[1].min(converted(*reachable, border, &interval.end()))
        }
        _ => 0.0,
    }
}

/// Largest d2u/dt2 along a straight line.
fn straight_acceleration(a_max: &[f64; 3], along: &[f64; 3]) -> f64 {
    (0..3)
        .filter(|k| along[*k] != 0.0)
        .map(|k| a_max[k] / along[k].abs())
        .fold(f64::INFINITY, f64::min)
}

impl Interval {
    fn start(&self) -> Border {
        (Rc::clone(&self.curve), self.norm[0])
    }
    fn end(&self) -> Border {
        (Rc::clone(&self.curve), self.norm[1])
    }

    /// A d2u/dt2 with which the middle can be reached from rest, and the end at rest from there, within the limits and the caps.
    fn acceleration_from_rest(&self, a_max: &[f64; 3]) -> f64 {
        // b is at most e times the width, so |q'' b + q' e| is at most e times this.
        let need = |k: usize| {
            (0..3)
                .map(|place| self.second[place][k].abs() * self.width + self.first[place][k].abs())
                .fold(0.0, f64::max)
        };
        let by_axes = (0..3)
            .map(|k| (need(k), a_max[k]))
            .filter(|(need, _)| *need > 0.0)
            .map(|(need, a)| a / need)
            .fold(f64::INFINITY, f64::min);
        by_axes.min(self.cap[0].max(self.cap[1]) / self.width)
    }

    /// Its length, mm; by the trapezoid rule, which is enough for a look-ahead.
    fn length(&self) -> f64 {
        self.width * (self.norm[0] + self.norm[1]) / 2.0
    }

    /// The acceleration limits at three places as half planes p x + r y <= a in x = b at the start and y = b at the end.
    fn half_planes(&self, a_max: &[f64; 3]) -> [(f64, f64, f64); 18] {
        let half = 0.5 / self.width;
        let mut planes = [(0.0, 0.0, 0.0); 18];
        for k in 0..3 {
            for (place, share) in [0.0, 0.5, 1.0].into_iter().enumerate() {
                let e = self.first[place][k] * half;
                let bend = self.second[place][k];
                let (p, r) = (bend * (1.0 - share) - e, bend * share + e);
                planes[6 * k + 2 * place] = (p, r, a_max[k]);
                planes[6 * k + 2 * place + 1] = (-p, -r, a_max[k]);
            }
        }
        planes
    }

    /// Range of x that a y allows.
    fn starts(planes: &[(f64, f64, f64); 18], y: f64, cap: f64) -> (f64, f64) {
        let (mut low, mut high) = (0.0f64, cap);
        for (p, r, a) in planes {
            let room = a - r * y;
            if *p > 0.0 {
                high = high.min(room / p);
            } else if *p < 0.0 {
                low = low.max(room / p);
            } else if room < 0.0 {
                high = f64::NEG_INFINITY;
            }
        }
        (low, high)
    }

    /// Largest b at the start for which the end can be left with at most `at_end`.
    ///
    /// The largest x over y is a concave function of y, so when the greatest y is not the best, halving finds the best one.
    fn controllable(&self, a_max: &[f64; 3], at_end: f64) -> f64 {
        let planes = self.half_planes(a_max);
        let highest = |y: f64| {
            let (low, high) = Self::starts(&planes, y, self.cap[0]);
            (low <= high).then_some(high)
        };
        let feasible = |y: f64| highest(y).is_some();
        // y = 0 is always feasible: x = 0 is at rest.
        let mut top = at_end;
        if !feasible(top) {
            let (mut good, mut bad) = (0.0, top);
            for _ in 0..50 {
                let middle = (good + bad) / 2.0;
                if feasible(middle) { good = middle } else { bad = middle }
            }
            top = good;
        }
        let value = |y: f64| highest(y).unwrap_or(0.0);
        let at_top = value(top);
        if at_top >= self.cap[0] || value(top * (1.0 - 1e-6)) <= at_top {
            return at_top;
        }
        let (mut low, mut high) = (0.0, top);
        for _ in 0..60 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if value(a) < value(b) { low = a } else { high = b }
        }
        value(low).max(value(high)).max(at_top)
    }

    /// Largest b at the end that can be reached from `start` and is at most `at_end`.
    fn fastest_end(&self, a_max: &[f64; 3], start: f64, at_end: f64) -> f64 {
        let mut high = at_end;
        let mut low = 0.0f64;
        for (p, r, a) in self.half_planes(a_max) {
            // Where the path turns away from an axis, r is nearly 0 and the start may use up the axis: what rounding leaves of the room,
            // divided by r, would forbid every end.
            let room = a * (1.0 + 1e-9) - p * start;
            if r > 0.0 {
                high = high.min(room / r);
            } else if r < 0.0 {
                low = low.max(room / r);
            }
        }
        // Rounding can turn the range over by a last digit; the end is then what both agree on nearly.
        high.max(low.min(at_end)).max(0.0)
    }
}

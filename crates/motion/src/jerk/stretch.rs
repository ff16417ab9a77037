//! One stretch from rest to rest: its curve, what the limits allow along it, and the plan in a receding window.
//!
//! Four positions run along the stretch, each behind the one before: the path that is known, the part of the curve that is final
//! ([`sights`]), the grid on which the plan is made ([`grid`]), and what is planned for good ([`window`]). The window reaches from the last
//! to the grid's end, where it is at rest; only what that rest does not slow down is kept.
//!
//! What is kept are [`Phase`]s. Those that the sampler has not begun can be taken back and planned again for another feed.

mod grid;
mod phase;
mod sights;
mod window;

use super::course::{Course, Place};
use super::solver::{Border, Interval, Search};
use super::vector::length;
use crate::Limits;
use crate::smooth::Piece;
pub(super) use phase::Phase;
use sights::Sight;
use std::collections::VecDeque;

/// Share of the limits that is planned with; the rest covers what happens between two borders.
const USED: f64 = 0.9980;

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

/// Intervals of a window at most.
const MOST_INTERVALS: usize = 4000;

/// Spans of which a stretch holds more only where nothing can be planned without.
const MOST_SPANS: usize = 60_000;

/// Time at the fastest feed and spans that a window is made of where that is more than it needs: what its end slows down is solved twice,
/// so longer windows cost less.
const AHEAD: f64 = 0.8;
const SPANS_AHEAD: usize = 3000;

/// A border of the grid and the interval behind it.
#[derive(Clone, Copy, Debug)]
struct Cell {
    s: f64,
    border: Border,
    interval: Interval,
    /// Estimated b.
    estimate: f64,
}

/// A stretch being planned.
#[derive(Debug)]
pub(super) struct Stretch {
    pub(super) course: Course,
    v_max: [f64; 3],
    a_max: [f64; 3],
    j_max: [f64; 3],
    /// Multiplier of the programmed feeds.
    feed_scale: f64,
    sights: VecDeque<Sight>,
    grid: VecDeque<Cell>,
    /// The plan up to the second cell of the grid is given out; `false`: it begins at rest.
    moving: bool,
    grid_end: f64,
    pub(super) closed: bool,
    /// All of it has been planned.
    pub(super) planned: bool,
    pub(super) phases: VecDeque<Phase>,
    /// The fastest programmed speed that was seen, and how often more length than usual a round needs.
    fastest: f64,
    patience: f64,
    search: Search,
}

impl Stretch {
    pub(super) fn new(limits: &Limits, j_max: [f64; 3], feed_scale: f64) -> Stretch {
        Stretch {
            course: Course::default(),
            v_max: limits.v_max.map(|v| v.0 * USED),
            a_max: limits.a_max.map(|a| a.0 * USED),
            j_max: j_max.map(|j| j * USED),
            feed_scale,
            sights: VecDeque::new(),
            grid: VecDeque::new(),
            moving: false,
            grid_end: 0.0,
            closed: false,
            planned: false,
            phases: VecDeque::new(),
            fastest: 0.0,
            patience: 1.0,
            search: Search::default(),
        }
    }

    /// Adds a move.
    pub(super) fn push(&mut self, piece: &Piece) {
        self.course.push(piece);
        let top = piece.feed_factors.iter().map(|f| f.1).reduce(f64::max).unwrap_or(1.0);
        self.fastest = self.fastest.max(piece.feed * top);
    }

    /// True when a round of planning can be made without knowing more.
    pub(super) fn is_full(&self) -> bool {
        let done = self.grid.front().map_or(0.0, |c| c.s);
        let known = self.course.length - done;
        let least = |limits: [f64; 3]| limits.into_iter().fold(f64::INFINITY, f64::min);
        let v = length(self.v_max).min(self.fastest * self.feed_scale);
        let (a, j) = (least(self.a_max), least(self.j_max));
        let stop = 0.5 * v * v / a + v * (0.5 * a / j).min(libm::sqrt(v / j));
        let needed = (6.0 * stop + 10.0) * self.patience;
        let spans = self.course.len();
        known > needed && (known > needed + v * AHEAD || spans > SPANS_AHEAD) || spans > MOST_SPANS
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
        self.patience = if given == 0 { self.patience * 1.6 } else { 1.0 };
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

    /// Plans what the sampler has not begun again, with another multiplier of the programmed feeds.
    ///
    /// The phase at hand and the coefficient of the one behind it stay: they determine speed and acceleration where the new plan begins.
    pub(super) fn replan(&mut self, feed_scale: f64) {
        if feed_scale == self.feed_scale {
            return;
        }
        let slower = feed_scale < self.feed_scale;
        self.feed_scale = feed_scale;
        let begun = self.moving || !self.phases.is_empty();
        if !begun {
            self.grid.clear();
            self.sights.clear();
            self.grid_end = 0.0;
            return;
        }
        // What is planned is faster than it has to be; the machine slows it down, and there is no way to be slower at once.
        if slower {
            return;
        }
        let fixed = match (self.phases.front(), self.phases.get(1)) {
            (Some(here), Some(next)) if !next.ends_at_rest() => [(here.s, here.interval()), (next.s, next.interval())],
            // Less than two phases before a rest: it is over before anything could change.
            _ if self.planned => return,
            _ => [0, 1].map(|k| (self.grid[k].s, self.grid[k].interval)),
        };
        self.phases.truncate(1);
        self.planned = false;
        self.moving = true;
        let cells = fixed.map(|(s, interval)| Cell {
            interval,
            ..self.cell(s, interval.value)
        });
        let (s, value) = (fixed[1].0 + fixed[1].1.width, fixed[1].1.value);
        let end = self.cell(s, value);
        self.grid = VecDeque::from([cells[0], cells[1], end]);
        self.grid_end = s;
        let mut sight = self.sight(self.course.span_at(s), s, false);
        sight.rising = sights::three_quarters(value);
        self.sights = VecDeque::from([sight]);
    }

    /// The place at `s`, and the step there.
    pub(super) fn place(&self, s: f64) -> (Place, units::StepId) {
        let k = self.course.span_at(s);
        (self.course.at(k, s), self.course.span(k).step)
    }
}

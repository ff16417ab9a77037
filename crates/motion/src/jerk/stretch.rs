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

use super::course::{Course, Onset};
use super::limits::{Border, Interval};
use super::solver::Search;
use super::span::Place;
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

/// Phases to the rest from which on it is worth while to plan again.
const LEAST_AGAIN: usize = 12;

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
    /// The multiplier of the programmed feeds that the interval was laid for.
    feed_scale: f64,
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
    /// The override has changed on the way.
    replanned: bool,
    /// How many times finer than usual the grid is.
    fineness: f64,
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

/// The least that looking and laying go forward from `s`, mm: more than the last digit of any length, so that they end.
fn forward(s: f64) -> f64 {
    f64::max(1e-10, 1e-15 * s)
}

impl Stretch {
    pub(super) fn new(limits: &Limits, j_max: [f64; 3], feed_scale: f64, fineness: f64) -> Stretch {
        // Between the borders of a fine grid nothing happens.
        let used = if fineness > 1.0 { 1.0 } else { USED };
        Stretch {
            course: Course::default(),
            v_max: limits.v_max.map(|v| v.0 * used),
            a_max: limits.a_max.map(|a| a.0 * used),
            j_max: j_max.map(|j| j * used),
            feed_scale,
            replanned: false,
            fineness,
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
    pub(super) fn push(&mut self, piece: &Piece, onset: Onset) {
        self.course.push(piece, onset);
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
        // A reference is one window.
        self.fineness == 1.0 && known > needed && (known > needed + v * AHEAD || spans > SPANS_AHEAD) || spans > MOST_SPANS
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
    /// The phase at hand and the coefficient of the one behind it stay: they determine speed and acceleration where the new plan begins. The
    /// grid stays too, and the plan as it was is what the search begins with.
    pub(super) fn replan(&mut self, feed_scale: f64) {
        let faster = feed_scale / self.feed_scale;
        if faster == 1.0 {
            return;
        }
        self.feed_scale = feed_scale;
        self.replanned = true;
        if self.phases.is_empty() && !self.moving {
            self.grid.clear();
            self.sights.clear();
            self.grid_end = 0.0;
            return;
        }
        // What lies behind the grid is looked at again.
        while self.sights.len() > 1 && self.sights.back().is_some_and(|sight| sight.s > self.grid_end) {
            self.sights.pop_back();
        }
        // As if nothing behind the last one were known yet: looking on from it makes its detail finer each time.
        if let Some(last) = self.sights.back() {
            let k = self.course.span_at(last.s).min(self.course.len().saturating_sub(1));
            let fresh = self.sight(k, last.s, last.border);
            if let Some(last) = self.sights.back_mut() {
                (last.cap, last.detail) = (fresh.cap, fresh.detail);
            }
        }
        // Slower: what is laid is faster than it has to be. The machine slows it down, for every phase tells what it was planned for.
        if faster < 1.0 {
            return;
        }
        // The last few are over in some hundredths of a second, and too few to be a window.
        if self.planned && self.phases.len() < LEAST_AGAIN {
            return;
        }
        if let Some(first) = self.sights.front_mut() {
            first.rising *= faster * libm::sqrt(faster);
        }
        let mut cells: VecDeque<Cell> = self.phases.iter().map(|phase| self.cell_of(phase)).collect();
        if self.planned {
            cells.push_back(self.cell(self.grid_end, 0.0));
        } else {
            cells.extend(self.grid.iter().skip(usize::from(!cells.is_empty())));
        }
        for cell in &mut cells {
            cell.feed_scale = feed_scale;
            cell.estimate = (cell.estimate * faster * faster).max(cell.interval.value);
            let border = self.cell(cell.s, 0.0).border;
            cell.border = border;
        }
        for k in 1..cells.len() {
            let (mut behind, mut cell) = (cells[k - 1], cells[k]);
            let feed = self.course.feed_between(behind.s, cell.s, feed_scale);
            self.cap(&mut behind, &mut cell, feed * feed);
            (cells[k - 1], cells[k]) = (behind, cell);
        }
        self.grid = cells;
        self.phases.truncate(1);
        self.planned = false;
        self.moving = true;
    }

    /// The cell of the grid that a phase was made of.
    fn cell_of(&self, phase: &Phase) -> Cell {
        let interval = phase.interval();
        Cell {
            interval,
            ..self.cell(phase.s, interval.value)
        }
    }

    /// Newton steps times intervals so far.
    #[cfg(test)]
    pub(super) fn work(&self) -> u64 {
        self.search.work
    }

    /// The place at `s`, and the step there.
    pub(super) fn place(&self, s: f64) -> (Place, units::StepId) {
        let k = self.course.span_at(s);
        (self.course.at(k, s), self.course.span(k).step)
    }
}

//! The planner under a limit of jerk.
//!
//! 1. [`course`]: the programmed path becomes a curve with a continuous second and a bounded third derivative, within the tolerance. Splines
//!    become curves over their length ([`splines`]), corners are rounded, steps of curvature eased, and dense chords become the curve they stand for, by the same means: [`kernel`].
//! 2. [`stretch`]: what the limits allow along that curve, a grid whose step follows the speed, and a receding window that is at rest at
//!    its end.
//! 3. [`solver`]: the fastest motion in the window.
//!
//! [`JerkPlanner`] joins them from rest to rest and looks at the motion every millisecond.

#![allow(
    clippy::needless_range_loop,
    reason = "an index is a border of the grid or a joint, and speaks of several lists at once"
)]

mod course;
mod kernel;
mod limits;
mod matrix;
mod solver;
mod span;
mod splines;
mod stretch;
mod vector;
#[cfg(test)]
mod work;

use crate::Limits;
use crate::planner::Planned;
use crate::smooth::Piece;
use course::{Onset, is_passable};
use machine::SetPoint;
use plan::Path;
use std::collections::VecDeque;
use stretch::Stretch;
use units::{StepId, TICK};

/// A stretch and what stands on it.
struct Leg {
    stretch: Stretch,
    /// Marks by the length at which they stand.
    marks: VecDeque<f64>,
    end: [f64; 3],
    last_step: StepId,
}

/// Moves and marks in, set-points and marks out.
pub(crate) struct JerkPlanner {
    limits: Limits,
    j_max: [f64; 3],
    legs: VecDeque<Leg>,
    /// The last move of the last leg, while that is open.
    last: Option<Piece>,
    ready: VecDeque<Planned>,
    /// Time in the phase at hand at the last set-point, s; and how much of the cycle is still to be walked.
    within: f64,
    left: f64,
    moving: bool,
    path_length: f64,
    position: [f64; 3],
    deviation: f64,
    feed_scale: f64,
    /// How many times finer than usual the grid is.
    pub(crate) fineness: f64,
    /// What the set-point at hand was planned for.
    planned_override: f64,
}

impl JerkPlanner {
    /// Nothing planned; the axes stand at `position`.
    pub(crate) fn new(limits: &Limits, j_max: [f64; 3], position: [f64; 3]) -> JerkPlanner {
        JerkPlanner {
            limits: *limits,
            j_max,
            legs: VecDeque::new(),
            last: None,
            ready: VecDeque::new(),
            within: 0.0,
            left: TICK.0,
            moving: false,
            path_length: 0.0,
            position,
            deviation: 0.0,
            feed_scale: 1.0,
            fineness: 1.0,
            planned_override: 1.0,
        }
    }

    /// The next move.
    pub(crate) fn push(&mut self, piece: Piece) {
        if let Path::Spline(_) = &piece.path {
            let (parts, off) = splines::of(&piece);
            self.deviation = self.deviation.max(off);
            parts.into_iter().for_each(|part| self.push_one(part.piece, part.onset));
        } else {
            self.push_one(piece, Onset::Move);
        }
    }

    fn push_one(&mut self, piece: Piece, onset: Onset) {
        let passable = onset == Onset::Smooth || self.last.as_ref().is_some_and(|last| is_passable(last, &piece));
        if !passable {
            self.finish();
            self.legs.push_back(Leg {
                stretch: Stretch::new(&self.limits, self.j_max, self.feed_scale, self.fineness),
                marks: VecDeque::new(),
                end: [0.0; 3],
                last_step: piece.step,
            });
        }
        let leg = self.legs.back_mut().expect("one is open");
        leg.stretch.push(&piece, onset);
        leg.end = piece.path.end().xyz;
        leg.last_step = piece.step;
        self.last = Some(piece);
    }

    /// Programmed feeds are multiplied by `scale` from where the sampler is on, as far as the motion at hand allows.
    pub(crate) fn set_feed_scale(&mut self, scale: f64) {
        self.feed_scale = scale;
        for leg in &mut self.legs {
            leg.stretch.replan(scale);
        }
    }

    /// Something stands here that is no motion.
    pub(crate) fn mark(&mut self) {
        match self.legs.back_mut() {
            Some(leg) => leg.marks.push_back(leg.stretch.course.length),
            None => self.ready.push_back(Planned::Mark),
        }
    }

    /// The motion ends here, at rest.
    pub(crate) fn finish(&mut self) {
        if self.last.take().is_some()
            && let Some(leg) = self.legs.back_mut()
        {
            leg.stretch.closed = true;
        }
    }

    /// The next thing; `None` when more path is needed, or, behind [`JerkPlanner::finish`], when everything was given out.
    pub(crate) fn next(&mut self) -> Option<Planned> {
        loop {
            if let Some(ready) = self.ready.pop_front() {
                return Some(ready);
            }
            let leg = self.legs.front_mut()?;
            let Some(phase) = leg.stretch.phases.front() else {
                if leg.stretch.planned {
                    let (end, step) = (leg.end, leg.last_step);
                    let marks = leg.marks.len();
                    self.deviation = self.deviation.max(leg.stretch.course.deviation);
                    self.legs.pop_front();
                    let rest = self.rest(end, step);
                    self.ready.extend(rest.map(Planned::SetPoint));
                    self.ready.extend((0..marks).map(|_| Planned::Mark));
                    continue;
                }
                leg.stretch.plan();
                if leg.stretch.phases.is_empty() && !leg.stretch.planned && !leg.stretch.closed {
                    return None;
                }
                continue;
            };
            let rest = phase.time - self.within;
            self.moving = true;
            if rest < self.left {
                self.left -= rest.max(0.0);
                self.within = 0.0;
                leg.stretch.phases.pop_front();
                continue;
            }
            let t = self.within + self.left;
            let (x, speed, change) = phase.at(t);
            let s = phase.s + x.min(phase.width);
            if leg.marks.front().is_some_and(|mark| *mark <= s) {
                leg.marks.pop_front();
                return Some(Planned::Mark);
            }
            self.within = t;
            self.left = TICK.0;
            let ([position, q1, q2, _], step) = leg.stretch.place(s);
            let velocity: [f64; 3] = std::array::from_fn(|k| q1[k] * speed);
            let acceleration = std::array::from_fn(|k| q2[k] * speed * speed + q1[k] * change);
            self.planned_override = phase.feed_scale;
            return Some(Planned::SetPoint(self.set_point(position, velocity, acceleration, step)));
        }
    }

    /// The motion stands still: the set-point at rest in `end`, when the axes are not there yet.
    pub(crate) fn rest(&mut self, end: [f64; 3], step: StepId) -> Option<SetPoint> {
        let moved = self.moving;
        self.moving = false;
        self.within = 0.0;
        self.left = TICK.0;
        moved.then(|| self.set_point(end, [0.0; 3], [0.0; 3], step))
    }

    fn set_point(&mut self, position: [f64; 3], velocity: [f64; 3], acceleration: [f64; 3], step: StepId) -> SetPoint {
        self.path_length += vector::length(vector::minus(position, self.position));
        self.position = position;
        SetPoint {
            position,
            velocity,
            acceleration,
            step,
            path_length: self.path_length,
            path_speed: vector::length(velocity),
            planned_override: self.planned_override,
            ..SetPoint::default()
        }
    }

    /// Length given out so far, mm.
    pub(crate) fn path_length(&self) -> f64 {
        self.path_length
    }

    /// Largest distance so far from the programmed path, mm.
    pub(crate) fn max_deviation(&self) -> f64 {
        let open = self.legs.iter().map(|leg| leg.stretch.course.deviation);
        open.fold(self.deviation, f64::max)
    }
}

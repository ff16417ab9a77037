//! The planned motion, looked at every servo cycle.

use crate::profile::Phase;
use machine::SetPoint;
use units::{StepId, TICK};

/// Walks through phases and gives a set-point each millisecond; a motion may begin and end between two of them.
#[derive(Debug, Default)]
pub struct Sampler {
    phase: Option<Phase>,
    /// Time inside the phase at the last set-point, s; and how much of the cycle is still to be walked.
    within: f64,
    left: f64,
    path_length: f64,
    last: Option<[f64; 3]>,
    moving: bool,
}

/// What the sampler needs or gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sampled {
    /// A set-point.
    SetPoint(SetPoint),
    /// Give the next phase, or say that there is none by [`Sampler::rest`].
    Hungry,
}

impl Sampler {
    /// The axes stand here; the next motion starts from it.
    pub fn new(position: [f64; 3]) -> Sampler {
        Sampler {
            left: TICK.0,
            last: Some(position),
            ..Sampler::default()
        }
    }

    /// The next phase of the motion.
    pub fn feed(&mut self, phase: Phase) {
        self.phase = Some(phase);
        self.within = 0.0;
    }

    /// The next set-point, if the phase at hand reaches to it.
    pub fn tick(&mut self) -> Sampled {
        let Some(phase) = &self.phase else { return Sampled::Hungry };
        let rest = phase.time - self.within;
        if rest < self.left {
            self.left -= rest.max(0.0);
            self.moving = true;
            self.phase = None;
            return Sampled::Hungry;
        }
        self.within += self.left;
        self.left = TICK.0;
        self.moving = true;
        let t = self.within;
        let rate = phase.rate + phase.change * t;
        let u = (phase.u + phase.rate * t + 0.5 * phase.change * t * t).min(phase.end);
        let (first, second) = phase.curve.derivatives(u);
        let position = phase.curve.at(u).xyz;
        let velocity = (first * rate).xyz;
        let acceleration = (second * (rate * rate) + first * phase.change).xyz;
        let path_speed = (first * rate).length();
        let step = phase.step;
        Sampled::SetPoint(self.set_point(position, velocity, acceleration, path_speed, step))
    }

    /// The motion stands still: the set-point at rest in `end`, when the axes are not there yet. It falls on a cycle of its own, so that the
    /// machine can see it and wait there until the axes are in position.
    pub fn rest(&mut self, end: [f64; 3], step: StepId) -> Option<SetPoint> {
        let moved = self.moving;
        self.phase = None;
        self.moving = false;
        self.left = TICK.0;
        moved.then(|| self.set_point(end, [0.0; 3], [0.0; 3], 0.0, step))
    }

    fn set_point(
        &mut self,
        position: [f64; 3],
        velocity: [f64; 3],
        acceleration: [f64; 3],
        path_speed: f64,
        step: StepId,
    ) -> SetPoint {
        if let Some(last) = self.last {
            let d: [f64; 3] = std::array::from_fn(|k| position[k] - last[k]);
            self.path_length += (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        }
        self.last = Some(position);
        SetPoint {
            position,
            velocity,
            acceleration,
            step,
            path_length: self.path_length,
            path_speed,
            ..SetPoint::default()
        }
    }

    /// Length given out so far, mm, as the sum of the distances between set-points.
    pub fn path_length(&self) -> f64 {
        self.path_length
    }
}

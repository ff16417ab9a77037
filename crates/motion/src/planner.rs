//! Two planners behind one face: with a limit of jerk, and without one.

use crate::Limits;
use crate::jerk::JerkPlanner;
use crate::profile::{Profile, Profiled};
use crate::sample::{Sampled, Sampler};
use crate::smooth::{Piece, Smoothed, Smoother};
use machine::SetPoint;
use units::StepId;

/// What a planner gives, in order.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Planned {
    SetPoint(SetPoint),
    /// The next of what the caller marked stands here.
    Mark,
}

/// Moves and marks in, set-points and marks out.
pub(crate) enum Planner {
    /// Limits of speed and acceleration.
    Accelerated(Box<Accelerated>),
    /// Limits of jerk as well.
    Jerk(Box<JerkPlanner>),
}

/// Smoothing, profile and sampling without a limit of jerk.
pub(crate) struct Accelerated {
    smoother: Smoother,
    profile: Profile,
    sampler: Sampler,
    feed_scale: f64,
}

impl Planner {
    /// The planner that these limits ask for; the axes stand at `position`.
    pub(crate) fn new(limits: &Limits, position: [f64; 3]) -> Planner {
        match limits.j_max {
            Some(j_max) => Planner::Jerk(Box::new(JerkPlanner::new(limits, j_max.map(|j| j.0), position))),
            None => Planner::Accelerated(Box::new(Accelerated {
                smoother: Smoother::new(limits),
                profile: Profile::new(limits),
                sampler: Sampler::new(position),
                feed_scale: 1.0,
            })),
        }
    }

    /// The next move.
    pub(crate) fn push(&mut self, mut piece: Piece) {
        match self {
            Planner::Accelerated(planner) => {
                if !piece.rapid && piece.tie.is_none() {
                    piece.feed *= planner.feed_scale;
                }
                let Accelerated { smoother, profile, .. } = &mut **planner;
                smoother.push(piece, &mut |s| forward(profile, s));
            }
            Planner::Jerk(planner) => planner.push(piece),
        }
    }

    /// Multiplies programmed feeds from here on: without a limit of jerk those of moves that are still to come, with one everything that has
    /// not been given out.
    pub(crate) fn set_feed_scale(&mut self, scale: f64) {
        match self {
            Planner::Accelerated(planner) => planner.feed_scale = scale,
            Planner::Jerk(planner) => planner.set_feed_scale(scale),
        }
    }

    /// The multiplier for the next move, where set-points do not tell theirs.
    pub(crate) fn feed_scale_of_next(&self) -> Option<f64> {
        match self {
            Planner::Accelerated(planner) => Some(planner.feed_scale),
            Planner::Jerk(_) => None,
        }
    }

    /// Something that is no motion stands here.
    pub(crate) fn mark(&mut self) {
        match self {
            Planner::Accelerated(planner) => {
                let Accelerated { smoother, profile, .. } = &mut **planner;
                smoother.mark(0, &mut |s| forward(profile, s));
            }
            Planner::Jerk(planner) => planner.mark(),
        }
    }

    /// The motion ends here, at rest.
    pub(crate) fn finish(&mut self) {
        match self {
            Planner::Accelerated(planner) => {
                let Accelerated { smoother, profile, .. } = &mut **planner;
                smoother.finish(&mut |s| forward(profile, s));
                profile.close();
            }
            Planner::Jerk(planner) => planner.finish(),
        }
    }

    /// The next thing; `None` when more path is needed, or, behind [`Planner::finish`], when everything was given out.
    pub(crate) fn next(&mut self) -> Option<Planned> {
        match self {
            Planner::Accelerated(planner) => planner.next(),
            Planner::Jerk(planner) => planner.next(),
        }
    }

    /// The set-point at rest in `end`, when the axes are not there yet.
    pub(crate) fn rest(&mut self, end: [f64; 3], step: StepId) -> Option<SetPoint> {
        match self {
            Planner::Accelerated(planner) => planner.sampler.rest(end, step),
            Planner::Jerk(planner) => planner.rest(end, step),
        }
    }

    /// Length given out so far, mm.
    pub(crate) fn path_length(&self) -> f64 {
        match self {
            Planner::Accelerated(planner) => planner.sampler.path_length(),
            Planner::Jerk(planner) => planner.path_length(),
        }
    }

    /// Largest distance so far between the smoothed and the programmed path, mm.
    pub(crate) fn max_deviation(&self) -> f64 {
        match self {
            Planner::Accelerated(planner) => planner.smoother.max_deviation,
            Planner::Jerk(planner) => planner.max_deviation(),
        }
    }
}

impl Accelerated {
    fn next(&mut self) -> Option<Planned> {
        loop {
            if let Sampled::SetPoint(point) = self.sampler.tick() {
                return Some(Planned::SetPoint(point));
            }
            match self.profile.advance()? {
                Profiled::Phase(phase) => self.sampler.feed(phase),
                Profiled::Rest(place, step) => {
                    if let Some(point) = self.sampler.rest(place, step) {
                        return Some(Planned::SetPoint(point));
                    }
                }
                Profiled::Mark(_) => return Some(Planned::Mark),
            }
        }
    }
}

fn forward(profile: &mut Profile, smoothed: Smoothed) {
    match smoothed {
        Smoothed::Segment(segment) => profile.push(segment),
        Smoothed::Mark(mark) => profile.mark(mark),
    }
}

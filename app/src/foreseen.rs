//! How long a run was foreseen to take, while it runs and in its report.
//!
//! What is foreseen is [`motion::RemainingTime`] of the plan made beforehand, with what tool changes and the spindle take put into it.

use machine::{Phase, Sample};
use motion::RemainingTime;
use serde::Serialize;
use units::{Seconds, StepId, Tick};

use crate::survey::minutes;

/// How far a run is on its plan.
pub struct Foresight<'a> {
    plan: Option<&'a RemainingTime>,
    step: StepId,
    path_length: f64,
    now: Tick,
    moves: bool,
    /// An override was turned: the pace is not that of the plan.
    turned: bool,
    after_a_tenth: Option<f64>,
}

/// What was foreseen and what it was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Foreseen {
    /// At the start, s.
    pub foreseen_s: f64,
    /// When a tenth of it was done, at the pace up to there where an override was turned, s.
    pub foreseen_after_a_tenth_s: Option<f64>,
    /// What it took, s.
    pub real_s: f64,
    /// How much longer it took than was foreseen at the start, percent.
    pub real_against_foreseen_percent: Option<f64>,
    /// And than was foreseen after a tenth.
    pub real_against_tenth_percent: Option<f64>,
}

impl<'a> Foresight<'a> {
    /// Of a plan to its end; without one nothing is foreseen.
    pub fn of(plan: Option<&'a RemainingTime>) -> Foresight<'a> {
        Foresight {
            plan: plan.filter(|plan| plan.is_whole() && plan.total().0 > 0.0),
            step: StepId::NONE,
            path_length: 0.0,
            now: Tick(0),
            moves: false,
            turned: false,
            after_a_tenth: None,
        }
    }

    /// The machine is here now; `sample` is its last row.
    pub fn at(&mut self, now: Tick, sample: Option<&Sample>, path_length: f64) {
        // Neither goes back: a step of none is one between two.
        let step = sample.map_or(StepId::NONE, |sample| sample.step);
        (self.now, self.step) = (now, step.max(self.step));
        self.moves = sample.is_some_and(|sample| sample.phase == Phase::Running && sample.path_speed > 0.0);
        self.turned |= sample.is_some_and(|sample| sample.overrides.feed != 100 || sample.overrides.rapid != 100);
        self.path_length = path_length.max(self.path_length);
        if let Some(plan) = self.plan
            && self.after_a_tenth.is_none()
            && self.moves
            && plan.until(self.step, self.path_length).0 >= plan.total().0 / 10.0
        {
            self.after_a_tenth = Some(now.seconds().0 + self.remaining(plan).0);
        }
    }

    fn remaining(&self, plan: &RemainingTime) -> Seconds {
        if !self.moves || !self.turned {
            // A tool change, a dwell or a hold counts as done where it begins, and so says nothing of the pace. Without an override what
            // was lost up to here was lost once, waiting, and what is left takes what was planned.
            return plan.after(self.step, self.path_length);
        }
        plan.at_this_pace(self.step, self.path_length, self.now.seconds())
    }

    /// For the progress line: `31 %, 1:20 min left, `; empty where nothing is foreseen.
    pub fn words(&self) -> String {
        let Some(plan) = self.plan else { return String::new() };
        let done = 100.0 * plan.until(self.step, self.path_length).0 / plan.total().0;
        format!("{done:.0} %, {} left, ", minutes(self.remaining(plan).0))
    }

    /// What was foreseen of a run that took so long; `None` without a plan.
    pub fn told(&self, real: Seconds) -> Option<Foreseen> {
        let plan = self.plan?;
        let against = |foreseen: f64| (foreseen > 0.0).then(|| 100.0 * (real.0 / foreseen - 1.0));
        Some(Foreseen {
            foreseen_s: plan.total().0,
            foreseen_after_a_tenth_s: self.after_a_tenth,
            real_s: real.0,
            real_against_foreseen_percent: against(plan.total().0),
            real_against_tenth_percent: self.after_a_tenth.and_then(against),
        })
    }
}

impl Foreseen {
    /// In a sentence.
    pub fn line(&self) -> String {
        let of = |percent: Option<f64>| percent.map_or_else(String::new, |p| format!(" ({p:+.1} %)"));
        let tenth = self.foreseen_after_a_tenth_s.map_or_else(String::new, |s| {
            format!(", {s:.1} s after a tenth{}", of(self.real_against_tenth_percent))
        });
        format!(
            "time: {:.1} s; foreseen were {:.1} s at the start{}{tenth}",
            self.real_s,
            self.foreseen_s,
            of(self.real_against_foreseen_percent)
        )
    }
}

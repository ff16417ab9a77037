//! How fast time runs along the path: holds, stops, a queue that runs dry, and the overrides.
//!
//! With s(t) the plan and tau the time along it, the machine is at s(tau), dtau/dt = `rate`. Of an axis q:
//! v = q' rate, a = q'' rate^2 + q' rate', j = q''' rate^3 + 3 q'' rate rate' + q' rate''. The plan keeps its limits at rate 1, so any
//! constant rate below it does, and what a change may take is what is left of them.

use super::path::between;
use super::*;
use crate::follow::follow;

/// Part of an axis's acceleration that a rise of the rate may always use: beside a plan that uses all of it, it would never be 1 again.
const LEAST_RISE: f64 = 0.02;
/// A rate this near to what is wanted is it.
const SAME_RATE: f64 = 1e-6;
/// Set-points ahead that are looked at for what bends soon, cycles: the time in which a change of the rate can be taken back.
const BENDS_AHEAD: usize = 24;
/// Part of the axes' jerk with which a change of the rate is begun and taken back; the rest is for the bends of the plan.
const JERK_SHARE: f64 = 0.6;
/// A spindle that is faster than planned is followed up to this.
const MOST_RATE: f64 = 1.3;
/// What is tried, from the fastest change (0) towards taking it back (1).
const TRIED: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 0.95];
/// Times the limits of acceleration and jerk of an axis that a change of the rate may use, by differences of the commanded places. The third
/// difference of a motion within its limits is a mean of its jerk over three cycles, so it has no excess of its own; the plan uses up to
/// 1.001 of the limits, and the cubic between its set-points is off their curve by some millionths of a millimetre.
const MOST_ACCELERATION: f64 = 1.005;
const MOST_JERK: f64 = 1.01;
/// How much more than what taking it back takes a change may take, where that is over the limits already.
const NO_WORSE: f64 = 1.0005;
/// Cycles behind the last change of the rate whose differences still see it.
const BEHIND: u32 = 3;

impl Controller {
    /// Chooses the rate for the end of the coming cycle; gives that of its beginning.
    pub(super) fn choose_rate(&mut self) -> f64 {
        self.leave_trail();
        let planned = self.planned();
        let speed = length(planned.velocity);
        let short = self.is_short(speed);
        if short && let Some((_, cause)) = self.barrier {
            self.happen(Event::Stop(cause));
        }
        let starved = short && self.state == State::Running;
        let slowed = starved && speed > 0.0;
        self.counters.starved_ticks += u64::from(slowed);
        self.counters.starvations += u64::from(slowed && !self.starving);
        self.starving = slowed;
        let tie = self.next_set_point().and_then(|next| next.tie);
        self.highest_rate = if tie.is_some() { self.possible_rate() } else { 1.0 };
        let wanted = match tie {
            Some(tie) => self.thread_rate(tie, &planned, self.highest_rate),
            None => self.wanted_rate(),
        };
        let target = match self.state {
            State::Running if !starved => wanted,
            // A hold waits for the end of a thread; a stop does not.
            State::Holding if !short && self.is_threading() => wanted,
            _ => 0.0,
        };
        // At rest any rate is as good as another: nothing jumps.
        if self.standing && self.fraction == 0.0 && is_rest(&self.here) {
            (self.rate, self.rate_change) = (target, 0.0);
            return target;
        }
        let before = self.rate;
        let mut change = self.next_change(&planned, target);
        if short && target == 0.0 {
            // There is this much path and no more.
            change = change.min(-self.needed_fall());
        }
        let after = before + change * TICK.0;
        (self.rate, self.rate_change) = match after {
            _ if (after - target).abs() <= SAME_RATE => (target, 0.0),
            ..0.0 => (0.0, 0.0),
            _ if after >= self.highest_rate => (self.highest_rate, 0.0),
            _ => (after, change),
        };
        before
    }

    /// The highest rate at which the plan ahead keeps the limits of the axes; at least that at which it was made.
    fn possible_rate(&self) -> f64 {
        let mut rate = MOST_RATE;
        let mut before = &self.here;
        let ahead = (0..BENDS_AHEAD).map_while(|index| self.queue.get(index));
        let set_points = ahead.filter_map(|command| match command {
            Command::SetPoint(s) => Some(s),
            _ => None,
        });
        for s in set_points {
            for (k, axis) in self.parameters.axes.iter().enumerate() {
                let jerk = (s.acceleration[k] - before.acceleration[k]).abs() / TICK.0;
                rate = rate
                    .min(axis.v_max.0 / s.velocity[k].abs())
                    .min(libm::sqrt(MOST_ACCELERATION * axis.a_max.0 / s.acceleration[k].abs()))
                    .min(libm::cbrt(MOST_JERK * axis.j_max.0 / jerk));
            }
            before = s;
        }
        rate.max(1.0)
    }

    /// Keeps the last three places that were commanded, the newest first.
    pub(super) fn leave_trail(&mut self) {
        self.trail = if self.standing {
            [self.commanded; 3]
        } else {
            [self.commanded, self.trail[0], self.trail[1]]
        };
    }

    /// The rate that the overrides ask for here. Never above 1: a plan is as fast as the axes can; for more the office plans anew.
    pub(super) fn wanted_rate(&self) -> f64 {
        let Some(next) = self.next_set_point() else {
            return 1.0;
        };
        if next.is_locked() {
            return 1.0;
        }
        let share = if next.rapid {
            self.overrides.rapid_fraction()
        } else {
            self.overrides.feed_fraction()
        };
        (share / next.planned_override).min(1.0)
    }

    /// The next rate': towards the wanted rate as fast as the axes can.
    fn next_change(&self, planned: &Planned, target: f64) -> f64 {
        let mut jerk = 1.0 / (TICK.0 * TICK.0);
        let (mut fall, mut rise) = (1.0 / TICK.0, 1.0 / TICK.0);
        for (k, axis) in self.parameters.axes.iter().enumerate() {
            let v = planned.velocity[k].abs();
            if v > 1e-9 {
                // The acceleration of the plan, positive along the motion.
                let along = self.rate * self.rate * planned.acceleration[k] * planned.velocity[k].signum();
                jerk = jerk.min(JERK_SHARE * axis.j_max.0 / v);
                fall = fall.min(((axis.a_max.0 + along) / v).max(0.0));
                rise = rise.min(((axis.a_max.0 - along) / v).max(LEAST_RISE * axis.a_max.0 / v));
            }
            if self.is_jerky {
                // Nothing can be foreseen; where it bends, the bend changes with the rate: |3 q'' rate rate'| <= j.
                let bend = 3.0 * self.bend_ahead(k, planned) * self.rate;
                fall = fall.min(axis.j_max.0 / bend);
                rise = rise.min(axis.j_max.0 / bend);
            }
        }
        let fastest = follow((self.rate, self.rate_change), target, (-fall, rise), jerk, TICK.0);
        if self.is_jerky {
            return fastest;
        }
        if fastest == self.rate_change && fastest == 0.0 {
            return 0.0;
        }
        let back = taken_back(self.rate_change, jerk);
        let tried = TRIED.map(|part| fastest + (back - fastest) * part);
        if let Some(change) = tried.into_iter().find(|change| self.load(*change, 1.0) <= 1.0) {
            return change;
        }
        // Where the plan itself is over a limit, a change must not make it more.
        let most = self.load(back, f64::INFINITY) * NO_WORSE;
        let no_worse = |change: &f64| most > 1.0 && self.load(*change, most) <= most;
        tried.into_iter().find(no_worse).unwrap_or(back)
    }

    /// What an axis has at most of what it may have, if rate' becomes `change` now and is taken back from the next cycle on: the differences
    /// of the places that will be commanded. Where that was 1 or less it stays so, because taking it back stays possible. Not looked at
    /// farther than to the first load above `most`.
    fn load(&self, mut change: f64, most: f64) -> f64 {
        let (mut rate, mut at, mut trail) = (self.rate, self.fraction, self.trail);
        let mut here = &self.here;
        let mut set_points = (0..self.ahead())
            .map_while(|index| self.queue.get(index).filter(|command| !needs_rest(command)))
            .filter_map(|command| match command {
                Command::SetPoint(s) => Some(s),
                _ => None,
            });
        let (mut worst, mut behind) = (0.0f64, 0);
        let Some(mut next) = set_points.next() else {
            return worst;
        };
        while worst <= most && behind <= BEHIND {
            let after = (rate + change * TICK.0).clamp(0.0, self.highest_rate.max(self.rate));
            at += (rate + after) / 2.0;
            while at >= 1.0 {
                at -= 1.0;
                here = next;
                // Behind a rest any rate is as good as another.
                next = match set_points.next() {
                    Some(s) if !is_rest(here) => s,
                    _ => return worst,
                };
            }
            let planned = between(here, next, at);
            let mut jerk = 1.0 / (TICK.0 * TICK.0);
            for (k, axis) in self.parameters.axes.iter().enumerate() {
                let [p1, p2, p3] = trail.map(|place| place[k]);
                let p = planned.position[k];
                let a = (p - 2.0 * p1 + p2) / (TICK.0 * TICK.0);
                let j = (p - 3.0 * p1 + 3.0 * p2 - p3) / (TICK.0 * TICK.0 * TICK.0);
                worst = worst
                    .max(a.abs() / (axis.a_max.0 * MOST_ACCELERATION))
                    .max(j.abs() / (axis.j_max.0 * MOST_JERK));
                let v = planned.velocity[k].abs();
                if v > 1e-9 {
                    jerk = jerk.min(JERK_SHARE * axis.j_max.0 / v);
                }
            }
            trail = [planned.position, trail[0], trail[1]];
            // The rate ends at 0 and at its highest, whatever it changes by.
            let ends = after == 0.0 || after == self.highest_rate;
            rate = after;
            change = if ends { 0.0 } else { taken_back(change, jerk) };
            behind += u32::from(change == 0.0);
        }
        worst
    }

    /// The largest acceleration of an axis in the plan from here on for a little while, mm/s^2.
    fn bend_ahead(&self, axis: usize, planned: &Planned) -> f64 {
        let ahead = (0..BENDS_AHEAD).map_while(|index| self.queue.get(index));
        ahead.fold(planned.acceleration[axis].abs(), |most, command| match command {
            Command::SetPoint(s) => most.max(s.acceleration[axis].abs()),
            _ => most,
        })
    }

    /// How the rate has to fall to be 0 on what is left of the path, 1/s: from r at a constant fall it takes r^2 / (2 fall) of planned time.
    fn needed_fall(&self) -> f64 {
        let left = self.ahead() as f64 - 2.0 - self.fraction;
        self.rate * self.rate / (2.0 * left.max(0.5) * TICK.0)
    }

    /// Queued commands that may be executed.
    pub(super) fn ahead(&self) -> usize {
        self.barrier.map_or(self.queue.len(), |(index, _)| index)
    }

    /// True when so few set-points are left that the machine has to slow down now to stop on them.
    pub(super) fn is_short(&self, speed: f64) -> bool {
        let ahead = self.ahead();
        let needed = self.stopping_cycles(speed) + LEAST_AHEAD;
        if ahead as f64 >= needed || (ahead == 0 && self.barrier.is_none() && self.resting(&self.here)) {
            return false;
        }
        // Few, but the path comes to rest by itself: not at a slow set-point from which it speeds up.
        let speed_at = |index: Option<usize>| match index.map(|i| self.queue.get(i)) {
            None => length(self.here.velocity),
            Some(Some(Command::SetPoint(s))) => length(s.velocity),
            Some(_) => 0.0,
        };
        let rests = |index: usize| match self.queue.get(index) {
            Some(Command::SetPoint(s)) => self.resting(s) && speed_at(index.checked_sub(1)) >= length(s.velocity),
            Some(command) => needs_rest(command),
            None => false,
        };
        let at_rest_already = self.resting(&self.here) && self.next_set_point().is_none();
        let comes_to_rest = (0..ahead).rev().any(rests) || at_rest_already;
        !comes_to_rest
    }

    /// Planned cycles that a stop from the present rate may pass over, where the plan's speed is this, mm/s.
    fn stopping_cycles(&self, speed: f64) -> f64 {
        let weakest = |limit: fn(&AxisParameters) -> f64| self.parameters.axes.iter().map(limit).fold(f64::INFINITY, f64::min);
        let (a, j) = (weakest(|x| x.a_max.0), weakest(|x| x.j_max.0));
        let v = self.rate * speed;
        // At constant deceleration r^2 v / (2 a), twice that for bends; with the jerk half of r (v / a + a / j), and a quarter more.
        let time = if v >= a * a / j {
            v / a + a / j
        } else {
            2.0 * libm::sqrt(v / j)
        };
        self.rate * (v / a).max(0.625 * time) / TICK.0
    }
}

/// A rate' on its way back to 0 by `jerk` each second.
fn taken_back(change: f64, jerk: f64) -> f64 {
    let left = change.abs() - jerk * TICK.0;
    if left > 0.0 { left.copysign(change) } else { 0.0 }
}

//! How fast time runs along the path: holds, stops, a queue that runs dry, and the overrides.
//!
//! With s(t) the plan and tau the time along it, the machine is at s(tau), dtau/dt = `rate`. Of an axis q:
//! v = q' rate, a = q'' rate^2 + q' rate', j = q''' rate^3 + 3 q'' rate rate' + q' rate''. The plan keeps its limits at rate 1, so any
//! constant rate below it does, and what a change may take is what is left of them.

use super::*;
use crate::follow::follow;

/// Part of an axis's acceleration that a rise of the rate may always use: beside a plan that uses all of it, it would never be 1 again.
const LEAST_RISE: f64 = 0.02;
/// A rate this near to what is wanted is it.
const SAME_RATE: f64 = 1e-6;
/// Set-points ahead that are looked at for what bends soon, cycles: the time in which a change of the rate can be taken back.
const BENDS_AHEAD: usize = 24;
/// Part of the axes' jerk that a change of the rate may use beside the plan's own.
const JERK_SHARE: f64 = 0.9;

/// What a change of the rate may be: rate', 1/s, and rate'', 1/s^2.
struct Room {
    fall: f64,
    rise: f64,
    jerk: f64,
}

impl Controller {
    /// Chooses the rate for the end of the coming cycle; gives that of its beginning.
    pub(super) fn choose_rate(&mut self) -> f64 {
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
        let target = match self.state {
            State::Running if !starved => self.wanted_rate(),
            // A hold waits for the end of a thread; a stop does not.
            State::Holding if !short && self.is_threading() => self.wanted_rate(),
            _ => 0.0,
        };
        // At rest any rate is as good as another: nothing jumps.
        if self.standing && self.fraction == 0.0 && is_rest(&self.here) {
            (self.rate, self.rate_change) = (target, 0.0);
            return target;
        }
        let before = self.rate;
        let room = self.room(&planned);
        let mut change = follow((before, self.rate_change), target, (-room.fall, room.rise), room.jerk, TICK.0);
        if short && target == 0.0 {
            // There is this much path and no more.
            change = change.min(-self.needed_fall());
        }
        let after = before + change * TICK.0;
        let there = (after - target).abs() <= SAME_RATE || (target == 0.0 && after < 0.0);
        (self.rate, self.rate_change) = if there { (target, 0.0) } else { (after, change) };
        before
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

    /// What the axes have left for a change of the rate.
    fn room(&self, planned: &Planned) -> Room {
        let rate = self.rate;
        let mut room = Room {
            fall: 1.0 / TICK.0,
            rise: 1.0 / TICK.0,
            jerk: 1.0 / (TICK.0 * TICK.0),
        };
        for (k, axis) in self.parameters.axes.iter().enumerate() {
            let (v, a_max, j_max) = (planned.velocity[k].abs(), axis.a_max.0, axis.j_max.0 * JERK_SHARE);
            if v > 1e-9 {
                // The acceleration of the plan, positive along the motion.
                let along = rate * rate * planned.acceleration[k] * planned.velocity[k].signum();
                room.fall = room.fall.min(((a_max + along) / v).max(0.0));
                room.rise = room.rise.min(((a_max - along) / v).max(LEAST_RISE * a_max / v));
                room.jerk = room.jerk.min(j_max / v);
            }
            // Where it bends, the bend changes with the rate: |3 q'' rate rate'| <= j.
            let bend = 3.0 * self.bend_ahead(k, planned) * rate;
            if bend > 0.0 {
                room.fall = room.fall.min(j_max / bend);
                room.rise = room.rise.min(j_max / bend);
            }
        }
        room
    }

    /// The largest acceleration of an axis in the plan from here on for a little while, mm/s^2.
    fn bend_ahead(&self, axis: usize, planned: &Planned) -> f64 {
        let ahead = (0..BENDS_AHEAD).map_while(|index| self.queue.get(index));
        ahead.fold(planned.acceleration[axis].abs(), |most, command| match command {
            Command::SetPoint(s) if s.acceleration[axis].abs() > most => s.acceleration[axis].abs(),
            _ => most,
        })
    }

    /// How the rate has to fall to be 0 on what is left of the path, 1/s: from r at a constant fall it takes r^2 / (2 fall) of planned time.
    fn needed_fall(&self) -> f64 {
        let left = self.ahead() as f64 - 2.0 - self.fraction;
        self.rate * self.rate / (2.0 * left.max(0.5) * TICK.0)
    }

    /// Queued commands that may be executed.
    fn ahead(&self) -> usize {
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

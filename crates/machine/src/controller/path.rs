//! Motion along the queue: time along the path, what stops it, and where the plan is between two set-points.

use super::*;

/// Motion along the queue.
impl Controller {
    /// Moves on by a number of cycles and gives the commanded acceleration, mm/s^2.
    pub(super) fn advance(&mut self, cycles: u64, feedback: &Feedback) -> [f64; 3] {
        self.go_on_with_work(cycles, feedback);
        self.restore(cycles, feedback);
        if let Some(acceleration) = self.by_hand(cycles, feedback) {
            return acceleration;
        }
        let too_few =
            self.state == State::Waiting(Wait::Commands) && self.barrier.is_none() && self.rate == 0.0 && self.is_short(0.0);
        if !self.queue.is_empty() && self.in_work.is_none() && !too_few {
            self.happen(Event::Work);
        }
        let has_a_path = matches!(self.state, State::Running | State::Holding | State::Stopping(_));
        if !has_a_path || self.in_work.is_some() || self.waits_for_thread(cycles, feedback) {
            return self.stand();
        }
        if self.astray {
            return self.brake_astray();
        }
        if self.here.tie.is_some() && self.thread.turn.is_none() {
            self.see_turn(&self.planned());
        }
        if let Some(turn) = self.thread.turn.take() {
            return self.turn_round(turn, cycles);
        }
        let before = self.choose_rate();
        // From a rest the drives get the feed-forward of the first set-point in the cycle before it, as of every other.
        let at_rest = core::mem::take(&mut self.standing) && self.fraction == 0.0 && is_rest(&self.here);
        let begins = at_rest && self.next_set_point().is_some();
        // The rate changes evenly over the first of the cycles.
        let whole = (cycles - u64::from(begins)) as f64;
        self.fraction += if begins {
            self.rate * whole
        } else {
            // A thread begins by the angle of its spindle, within a cycle.
            let early = core::mem::take(&mut self.thread.early);
            ((before + self.rate) / 2.0 + self.rate * (whole - 1.0) + early).max(0.0)
        };
        self.consume();
        if self.fraction > 0.0 && !self.resting(&self.here) && self.next_set_point().is_none() {
            self.end_of_path(self.barrier.map_or(StopCause::OffPath, |(_, cause)| cause));
        }
        if self.astray {
            return self.brake_astray();
        }
        if self.rate == 0.0 {
            self.came_to_rest();
        }
        let planned = self.planned();
        let rate = self.rate;
        let change = (rate - before) / TICK.0;
        self.commanded = planned.position;
        self.commanded_velocity = planned.velocity.map(|v| v * rate);
        self.path_speed = planned.path_speed * rate;
        let coming = self.coming_acceleration(&planned);
        core::array::from_fn(|k| coming[k] * rate * rate + planned.velocity[k] * change)
    }

    pub(super) fn stand(&mut self) -> [f64; 3] {
        self.standing = true;
        self.rate_change = 0.0;
        self.commanded_velocity = [0.0; 3];
        self.path_speed = 0.0;
        [0.0; 3]
    }

    /// Time along the path has come to a standstill.
    pub(super) fn came_to_rest(&mut self) {
        let between = self.fraction > 0.0 || !self.resting(&self.here);
        if self.state == State::Running && self.wanted_rate() > 0.0 {
            self.happen(if between {
                Event::Stop(StopCause::Starved)
            } else {
                Event::Wait(Wait::Commands)
            });
        }
        self.happen(Event::AtRest);
    }

    /// Takes from the queue what is due.
    pub(super) fn consume(&mut self) {
        let mut instant = 0;
        while self.fraction >= 1.0 {
            if let Some((0, cause)) = self.barrier {
                self.end_of_path(cause);
                return;
            }
            match self.queue.front().copied() {
                None => {
                    if self.resting(&self.here) {
                        self.fraction = 0.0;
                        self.happen(Event::Wait(Wait::Commands));
                    } else {
                        self.end_of_path(StopCause::OffPath);
                    }
                    return;
                }
                Some(Command::SetPoint(next)) => {
                    self.pop();
                    self.here = next;
                    self.step = next.step;
                    self.fraction -= 1.0;
                    // A hold or a stop comes to rest here by itself.
                    if self.state == State::Running && is_rest(&next) && !self.is_in_position() {
                        self.fraction = 0.0;
                        let time_out = self.parameters.in_position_time_out;
                        self.wait(Wait::Position, seconds_in_cycles(time_out.0), self.tool);
                        return;
                    }
                    self.counters.completed += 1;
                    // A thread is begun by the angle of its spindle, however fast the axes got here.
                    if is_rest(&self.here) && self.next_set_point().is_some_and(SetPoint::is_locked) {
                        self.fraction = 0.0;
                        return;
                    }
                }
                Some(command) if needs_rest(&command) => {
                    self.fraction = 0.0;
                    if self.state == State::Running {
                        self.pop();
                        self.begin(command);
                    } else {
                        self.rate = 0.0;
                    }
                    return;
                }
                Some(command) => {
                    if instant == INSTANT_COMMANDS {
                        self.fraction = 1.0;
                        return;
                    }
                    instant += 1;
                    self.pop();
                    self.begin(command);
                }
            }
        }
        // What is said behind a set-point belongs to its cycle.
        while instant < INSTANT_COMMANDS && !matches!(self.barrier, Some((0, _))) {
            let Some(command @ Command::Watch { .. }) = self.queue.front().copied() else {
                return;
            };
            instant += 1;
            self.pop();
            self.begin(command);
        }
    }

    /// Nothing more can be executed here.
    pub(super) fn end_of_path(&mut self, cause: StopCause) {
        self.happen(Event::Stop(cause));
        self.fraction = 0.0;
        if self.resting(&self.here) {
            self.rate = 0.0;
        } else {
            self.counters.off_path_stops += 1;
            self.astray = true;
        }
    }

    /// Brakes along the present direction at the highest deceleration that no axis exceeds.
    pub(super) fn brake_astray(&mut self) -> [f64; 3] {
        let velocity = self.commanded_velocity;
        let speed = length(velocity);
        let mut deceleration = f64::INFINITY;
        for (k, v) in velocity.iter().enumerate() {
            if *v != 0.0 {
                deceleration = deceleration.min(self.parameters.axes[k].a_max.0 * speed / v.abs());
            }
        }
        let left = (speed - deceleration * TICK.0).max(0.0);
        let share = if speed > 0.0 && left > 0.0 { left / speed } else { 0.0 };
        let mut acceleration = [0.0; 3];
        for k in 0..3 {
            let after = velocity[k] * share;
            self.commanded[k] += (velocity[k] + after) / 2.0 * TICK.0;
            acceleration[k] = (after - velocity[k]) / TICK.0;
            self.commanded_velocity[k] = after;
        }
        self.path_speed = left;
        if share == 0.0 {
            let rate = 0.0;
            self.stand_at(self.commanded);
            self.rate = rate;
            self.happen(Event::AtRest);
        }
        acceleration
    }

    pub(super) fn pop(&mut self) {
        self.queue.pop();
        if let Some((index, _)) = &mut self.barrier {
            *index = index.saturating_sub(1);
        }
    }

    /// Where the plan is now: on the last set-point, or between it and the next by Hermite's cubic.
    pub(super) fn planned(&self) -> Planned {
        let next = if self.fraction > 0.0 { self.next_set_point() } else { None };
        between(
            &self.here,
            next.unwrap_or(&self.here),
            if next.is_some() { self.fraction } else { 0.0 },
        )
    }

    /// Mean acceleration of the plan over the cycle to come, mm/s^2 of planned time.
    ///
    /// The orders are for that cycle. With the acceleration of the set-point just reached, the feed-forward would be a cycle late wherever
    /// the plan begins or ends to accelerate: 3 mm/s of speed at 3000 mm/s^2, and a following error of 20 um.
    pub(super) fn coming_acceleration(&self, planned: &Planned) -> [f64; 3] {
        if self.in_work.is_some() {
            return [0.0; 3];
        }
        match self.next_set_point() {
            Some(next) => core::array::from_fn(|k| (next.velocity[k] - self.here.velocity[k]) / TICK.0),
            None if is_rest(&self.here) => [0.0; 3],
            None => planned.acceleration,
        }
    }

    /// The set-point that the present one is left towards; `None` when the path ends here.
    pub(super) fn next_set_point(&self) -> Option<&SetPoint> {
        let usable = self.barrier.map_or(self.queue.len(), |(index, _)| index);
        let ahead = (0..usable.min(INSTANT_COMMANDS as usize + 1)).map_while(|index| self.queue.get(index));
        for command in ahead {
            match command {
                Command::SetPoint(next) => return Some(next),
                other if needs_rest(other) => return None,
                _ => {}
            }
        }
        None
    }

    /// True when a set-point is as good as standing: an axis can take away its speed within a cycle.
    pub(super) fn resting(&self, set_point: &SetPoint) -> bool {
        (0..3).all(|k| set_point.velocity[k].abs() <= self.parameters.axes[k].a_max.0 * TICK.0)
    }
}

/// Where the plan is a part of a cycle behind `a`, on the way to `b`: Hermite's cubic.
pub(super) fn between(a: &SetPoint, b: &SetPoint, u: f64) -> Planned {
    if u <= 0.0 {
        return Planned {
            position: a.position,
            velocity: a.velocity,
            acceleration: a.acceleration,
            path_speed: a.path_speed,
        };
    }
    let between = |from: f64, to: f64| from + (to - from) * u;
    let (u2, u3) = (u * u, u * u * u);
    Planned {
        position: core::array::from_fn(|k| {
            let (p, q) = (a.position[k], b.position[k]);
            let (m, n) = (a.velocity[k] * TICK.0, b.velocity[k] * TICK.0);
            (2.0 * u3 - 3.0 * u2 + 1.0) * p + (u3 - 2.0 * u2 + u) * m + (3.0 * u2 - 2.0 * u3) * q + (u3 - u2) * n
        }),
        velocity: core::array::from_fn(|k| between(a.velocity[k], b.velocity[k])),
        acceleration: core::array::from_fn(|k| between(a.acceleration[k], b.acceleration[k])),
        path_speed: between(a.path_speed, b.path_speed),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn without_any_path_left_it_brakes_along_its_direction_and_never_holds_the_last_speed() {
        let mut controller = Controller::new(&MachineParameters::small_machining_centre());
        controller.state = State::Running;
        controller.here.velocity = [300.0, 400.0, 0.0];
        controller.commanded_velocity = controller.here.velocity;
        let feedback = Feedback::default();
        let mut speeds = std::vec![500.0];
        while controller.state != State::Stopped(StopCause::OffPath) {
            controller.advance(1, &feedback);
            let v = controller.commanded_velocity;
            assert!((v[0] * 4.0 - v[1] * 3.0).abs() < 1e-9, "left its direction: {v:?}");
            speeds.push(length(v));
            assert!(speeds.len() < 1000, "does not stop");
        }
        // Y limits: 3000 mm/s^2 of its 4/5 share are 3750 along the direction.
        for pair in speeds.windows(2) {
            assert!(pair[0] - pair[1] > 0.0 && pair[0] - pair[1] < 3.751);
        }
        assert_eq!((controller.counters.off_path_stops, controller.stands()), (1, true));
        assert!((length(controller.commanded) - 500.0 * 500.0 / 2.0 / 3750.0).abs() < 0.01);
    }
}

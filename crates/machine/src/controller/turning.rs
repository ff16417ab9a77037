//! A rigid tap: the spindle is slowed, turned round and brought back to speed, and the axes follow its angle through its standstill.
//!
//! It begins where the plan is still at its lead, so early that the spindle comes to a standstill where the path ends, and it ends where the
//! plan of the way back is at its lead again. In between the place on the line is lead times angle, below the programmed ground of the hole
//! too, should the spindle go farther: a tap that is held back breaks.

use super::*;
use crate::follow::follow;

/// Part of the axes' limits that turning the spindle round may use.
const SHARE: f64 = 0.5;
/// The same of their jerk when they follow it.
const FOLLOWING: f64 = 0.9;
/// How much of what path and angle are apart is taken out, 1/s.
const GAIN: f64 = 100.0;
/// A spindle as slow as this stands, turns each second.
const STANDS: f64 = 0.05;
/// How far a line may be off a straight one, mm.
const STRAIGHT: f64 = 1e-3;
/// How much softer and harder than usual the spindle may be slowed to stand where the stroke ends.
const SOFTER: f64 = 0.7;
const HARDER: f64 = 1.4;
/// How long before its end a stroke is to turn round, turns: what a changing load adds to it goes past the end.
const BEFORE_END: f64 = 0.05;
/// Cycles that turning round is foreseen for at most: what takes a spindle longer needs a slower one.
const LONGEST: u32 = 2000;

/// Turning round at the end of a stroke.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    ahead: Ahead,
    tie: Tie,
    rotation: f64,
    /// Where the spindle is when the path is at its end, turns in the direction of the stroke.
    at_end: f64,
    /// What is left of the stroke, mm; behind its end it is negative, on the way back positive again.
    left: f64,
    /// How fast that falls, mm/s, and how fast that changes, mm/s^2.
    speed: f64,
    acceleration: f64,
    /// What the spindle is told, turns each second, positive as in the stroke, and how fast that changes.
    told: (f64, f64),
    /// It is being slowed.
    slows: bool,
    /// The end of the stroke and the order to turn round were taken out of the queue.
    is_back: bool,
}

/// The end of a stroke, as the queue shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ahead {
    end: [f64; 3],
    way: [f64; 3],
    path_at_end: f64,
    /// Cycles for which the spindle stands there.
    dwell: u64,
    /// How it turns then; `None` when it only stops.
    spindle: Option<SpindleCommand>,
    /// The way back reaches its lead, or is not seen so far.
    reaches_lead: bool,
}

impl Controller {
    /// What the spindle is told while it is being turned round.
    pub(super) fn turning_order(&self) -> Option<SpindleCommand> {
        let turn = self.thread.turn.as_ref()?;
        let told = turn.rotation * turn.told.0;
        Some(match Rpm((60.0 * told.abs()).min(self.parameters.spindle.highest.0)) {
            Rpm(0.0) => SpindleCommand::Stop,
            n if told > 0.0 => SpindleCommand::Clockwise(n),
            n => SpindleCommand::Counterclockwise(n),
        })
    }

    /// The end of this stroke, where the spindle is turned round in the thread; `None` when that is not so, or not seen yet.
    pub(super) fn turn_ahead(&self) -> Option<Ahead> {
        let tie = self.next_set_point()?.tie?;
        let mut commands = (0..self.ahead()).map_while(|index| self.queue.get(index));
        let end = commands.by_ref().find_map(|command| match command {
            Command::SetPoint(s) if s.tie.is_none_or(|other| other.lead != tie.lead) => Some(None),
            Command::SetPoint(s) if is_rest(s) => Some(Some(*s)),
            command if needs_rest(command) => Some(None),
            _ => None,
        })??;
        let (mut dwell, mut spindle) = (0, None);
        for command in commands {
            match command {
                Command::Dwell { cycles, .. } if spindle.is_none() => dwell += u64::from(*cycles),
                Command::Spindle { spindle: back, .. } if spindle.is_none() && self.turns_round(*back) => spindle = Some(*back),
                command if needs_rest(command) => return None,
                Command::SetPoint(s) => {
                    let back = s.tie.filter(|other| other.lead == tie.lead && other.start.is_none())?;
                    let at_lead = Self::is_at_lead(s.path_speed, &back);
                    if at_lead || is_rest(s) {
                        return spindle.and_then(|spindle| self.ahead_to(&end, dwell, Some(spindle), at_lead));
                    }
                }
                _ => {}
            }
        }
        spindle.and_then(|spindle| self.ahead_to(&end, dwell, Some(spindle), true))
    }

    fn turns_round(&self, spindle: SpindleCommand) -> bool {
        matches!(
            (self.spindle, spindle),
            (SpindleCommand::Clockwise(_), SpindleCommand::Counterclockwise(_))
                | (SpindleCommand::Counterclockwise(_), SpindleCommand::Clockwise(_))
        )
    }

    /// The same when the way there is straight.
    fn ahead_to(&self, end: &SetPoint, dwell: u64, spindle: Option<SpindleCommand>, reaches_lead: bool) -> Option<Ahead> {
        let way: [f64; 3] = core::array::from_fn(|k| end.position[k] - self.here.position[k]);
        let (straight, next) = (length(way), self.next_set_point()?);
        let first: [f64; 3] = core::array::from_fn(|k| next.position[k] - self.here.position[k]);
        let along = end.path_length - next.path_length + length(first);
        (straight > 0.0 && (along - straight).abs() <= STRAIGHT).then(|| Ahead {
            end: end.position,
            way: way.map(|w| w / straight),
            path_at_end: end.path_length,
            dwell,
            spindle,
            reaches_lead,
        })
    }

    /// True when a stroke is long enough to come to its lead and for the spindle to stop after that; `behind` is its run-in.
    pub(super) fn has_room(&self, ahead: &Ahead, behind: f64) -> bool {
        let Some(tie) = self.next_set_point().and_then(|next| next.tie) else {
            return true;
        };
        // A run-in is about as long as it is behind.
        let stroke = ahead.path_at_end - self.path_here();
        ahead.reaches_lead
            && stroke > 1.2 * behind + tie.lead * self.turns_to_stop(&tie, ahead, (tie.revolutions, 0.0), tie.revolutions)
    }

    /// Acceleration, turns/s^2, and its change, turns/s^3, with which the spindle is turned round.
    fn reversal(&self, tie: &Tie, way: [f64; 3]) -> (f64, f64) {
        let (a, j) = self.limits_along(way);
        let own = self.parameters.spindle.reversal / core::f64::consts::TAU;
        (own.min(SHARE * a / tie.lead), SHARE * j / tie.lead)
    }

    /// What the axes can do along a direction, mm/s^2 and mm/s^3.
    fn limits_along(&self, way: [f64; 3]) -> (f64, f64) {
        let axes = self.parameters.axes.iter().zip(way);
        axes.fold((f64::INFINITY, f64::INFINITY), |(a, j), (axis, w)| {
            let w = w.abs().max(1e-9);
            (a.min(axis.a_max.0 / w), j.min(axis.j_max.0 / w))
        })
    }

    /// How far the spindle turns until it stands, from when it is begun to be slowed, turns. It follows its command by its drive's time
    /// constant; what it is slower under load stays so.
    fn turns_to_stop(&self, tie: &Tie, ahead: &Ahead, told: (f64, f64), speed: f64) -> f64 {
        let (a, j) = self.reversal(tie, ahead.way);
        let goes_back = ahead.spindle.is_some() && ahead.dwell == 0;
        let target = if goes_back { -tie.revolutions } else { 0.0 };
        let (mut command, mut change) = told;
        // It lags behind what it is told, and what is more than that is load.
        let lag = change * self.parameters.spindle.response.0;
        let mut follows = command - lag;
        let load = follows - speed;
        let mut turns = 0.0;
        for _ in 0..LONGEST {
            change = follow((command, change), target, (-a, a), j, TICK.0);
            command += change * TICK.0;
            let before = follows;
            follows += (command - follows) * (TICK.0 / self.parameters.spindle.response.0).min(1.0);
            let now = (before + follows) / 2.0 - load;
            if now <= STANDS {
                break;
            }
            turns += now * TICK.0;
        }
        turns
    }

    /// Begins to turn round when it is time.
    pub(super) fn see_turn(&mut self, planned: &Planned) {
        let (Some(tie), Some(rotation)) = (self.here.tie, self.rotation()) else {
            return;
        };
        if !Self::is_at_lead(planned.path_speed, &tie) {
            return;
        }
        let stops = matches!(self.state, State::Stopping(_));
        let Some(ahead) = (if stops { self.straight_ahead() } else { self.turn_ahead() }) else {
            return;
        };
        let left = ahead.path_at_end - self.path_here();
        let speed = rotation * self.angle.speed;
        let in_a_cycle = tie.speed() * TICK.0;
        let leaves_lead = self
            .next_set_point()
            .is_none_or(|next| !Self::is_at_lead(next.path_speed, &tie));
        let (a, j) = self.reversal(&tie, ahead.way);
        // It turns no faster meanwhile, and not for longer than this: no need to look closely.
        let longest = speed / a + a / j + 3.0 * self.parameters.spindle.response.0;
        if !stops && !leaves_lead && left > tie.lead * speed.max(tie.revolutions) * longest + 2.0 * in_a_cycle {
            return;
        }
        let told = (tie.revolutions, 0.0);
        let needed = tie.lead * self.turns_to_stop(&tie, &ahead, told, speed);
        if stops && left < needed {
            // No room to stop with the spindle: the path is stopped on its own.
            return;
        }
        if !stops && !ahead.reaches_lead {
            self.happen(Event::Stop(StopCause::ThreadTooShort));
            return;
        }
        if !stops && left > needed + 2.0 * in_a_cycle && !leaves_lead {
            return;
        }
        self.thread.turn = Some(Turn {
            ahead,
            tie,
            rotation,
            at_end: rotation * self.angle.turns + (left - planned.path_speed * self.rate * TICK.0) / tie.lead,
            left,
            speed: planned.path_speed * self.rate,
            acceleration: planned.path_speed * self.rate_change,
            told,
            slows: stops,
            is_back: false,
        });
    }

    /// What the queue shows of a straight thread, to stop on it.
    fn straight_ahead(&self) -> Option<Ahead> {
        let tie = self.next_set_point()?.tie?;
        let commands = (0..self.ahead()).map_while(|index| self.queue.get(index));
        let end = commands
            .map_while(|command| match command {
                Command::SetPoint(s) if s.tie.is_some_and(|other| other.lead == tie.lead) => Some(Some(s)),
                command if needs_rest(command) || matches!(command, Command::SetPoint(_)) => None,
                _ => Some(None),
            })
            .flatten()
            .last()?;
        self.ahead_to(end, 0, None, true)
    }

    /// One cycle of turning round; gives the commanded acceleration, mm/s^2.
    pub(super) fn turn_round(&mut self, mut turn: Turn, cycles: u64) -> [f64; 3] {
        let time = cycles as f64 * TICK.0;
        self.leave_trail();
        let (tie, rotation) = (turn.tie, turn.rotation);
        let stops = matches!(self.state, State::Stopping(_)) || turn.ahead.spindle.is_none();
        let turns = rotation * self.angle.turns;
        let speed = rotation * self.angle.speed;
        let left_by_angle = tie.lead * (turn.at_end - turns);

        // The spindle. It is to stand a little before the end: past it is worse.
        let aim = left_by_angle - BEFORE_END * tie.lead;
        if !turn.slows {
            let needed = tie.lead * self.turns_to_stop(&tie, &turn.ahead, turn.told, speed);
            turn.slows = stops || aim <= needed + tie.speed() * time / 2.0;
        }
        let (mut a, j) = self.reversal(&tie, turn.ahead.way);
        if turn.slows && !stops && turn.speed > 0.0 && aim > 0.0 {
            // The load changes meanwhile: harder or softer, to stand where the stroke ends.
            let needed = tie.lead * self.turns_to_stop(&tie, &turn.ahead, turn.told, speed);
            a *= within(needed / aim, SOFTER, HARDER);
        }
        let target = match turn.slows {
            false => tie.revolutions,
            true if stops || turn.ahead.dwell > 0 => 0.0,
            true => -tie.revolutions,
        };
        let change = follow(turn.told, target, (-a, a), j, time);
        turn.told = (turn.told.0 + change * time, change);
        if (turn.told.0 - target).abs() < 1e-9 {
            turn.told = (target, 0.0);
        }
        let stands = turn.slows && speed.abs() < STANDS;
        if stands && turn.told.0 == 0.0 {
            turn.ahead.dwell = turn.ahead.dwell.saturating_sub(cycles);
        }

        // The axes.
        let apart = turn.left - turn.speed * time - left_by_angle;
        let wanted = tie.lead * rotation * (self.angle.speed + self.angle.acceleration * time) + GAIN * apart;
        let (a, j) = self.limits_along(turn.ahead.way);
        let acceleration = follow((turn.speed, turn.acceleration), wanted, (-a, a), FOLLOWING * j, time);
        let after = turn.speed + acceleration * time;
        turn.left -= (turn.speed + after) / 2.0 * time;
        (turn.speed, turn.acceleration) = (after, acceleration);
        self.thread.error = left_by_angle - turn.left;
        self.commanded = core::array::from_fn(|k| turn.ahead.end[k] - turn.ahead.way[k] * turn.left);
        self.commanded_velocity = turn.ahead.way.map(|w| w * after);
        self.path_speed = after.abs();
        let acceleration = turn.ahead.way.map(|w| w * acceleration);

        if stops {
            self.thread.turn = Some(turn);
            if stands && turn.told.0 == 0.0 && after.abs() < tie.lead * STANDS {
                // What is left of its speed an axis takes away in a cycle.
                let error = self.thread.error;
                self.stand_at(self.commanded);
                self.thread.error = error;
                self.rate = 0.0;
                self.happen(Event::AtRest);
            }
            return acceleration;
        }
        self.follow_turn(&mut turn);
        if turn.is_back && self.is_back_at_lead(&turn) {
            return self.leave_turn(&turn, acceleration);
        }
        self.thread.turn = Some(turn);
        acceleration
    }

    /// Takes from the queue what is behind the axes.
    fn follow_turn(&mut self, turn: &mut Turn) {
        if !turn.is_back && turn.slows && turn.speed < 0.0 {
            turn.is_back = true;
            let mut is_told = false;
            // The rest of the stroke, a dwell, and the order to turn round.
            while !is_told && let Some(command) = self.queue.front().copied() {
                is_told = matches!(command, Command::Spindle { .. });
                self.take_of_turn(command);
            }
        }
        let reached = turn.ahead.path_at_end + if turn.is_back { turn.left } else { -turn.left };
        let mut instant = 0;
        while let Some(command) = self.queue.front().copied() {
            match command {
                Command::SetPoint(s) if s.path_length > reached || (is_rest(&s) && !turn.is_back) => break,
                command if needs_rest(&command) || instant == INSTANT_COMMANDS => break,
                command => self.take_of_turn(command),
            }
            instant += 1;
        }
        if turn.is_back && self.next_set_point().is_none() {
            // Nobody says how far back: out of the hole, and stop.
            self.happen(Event::Stop(StopCause::OffPath));
        }
    }

    fn take_of_turn(&mut self, command: Command) {
        self.pop();
        match command {
            Command::SetPoint(s) => {
                self.here = s;
                self.step = s.step;
            }
            Command::Spindle { spindle, step } => {
                self.step = step;
                self.spindle = self.limited(spindle);
            }
            Command::Dwell { step, .. } => self.step = step,
            // What is counted there is counted by it.
            other => return self.begin(other),
        }
        self.counters.completed += 1;
    }

    fn is_back_at_lead(&self, turn: &Turn) -> bool {
        let at_lead = |s: &SetPoint| s.tie.is_some_and(|tie| Self::is_at_lead(s.path_speed, &tie));
        let is_fast = -turn.speed > 0.9 * turn.tie.speed() && (turn.told.0 + turn.tie.revolutions).abs() < 1e-6;
        let leaves = self.next_set_point().is_some_and(|next| !at_lead(next));
        at_lead(&self.here) && (is_fast || leaves)
    }

    /// From here on the plan of the way back is gone by again.
    fn leave_turn(&mut self, turn: &Turn, acceleration: [f64; 3]) -> [f64; 3] {
        let reached = turn.ahead.path_at_end + turn.left;
        let (from, to) = (
            self.here.path_length,
            self.next_set_point().map_or(f64::INFINITY, |next| next.path_length),
        );
        self.fraction = within((reached - from) / (to - from), 0.0, 1.0 - 1e-9);
        self.rate = -turn.speed / self.here.path_speed;
        self.rate_change = -turn.acceleration / self.here.path_speed;
        self.thread.turn = None;
        self.thread.tie = self.here.tie;
        self.thread.law = Some((turn.ahead.path_at_end, -turn.at_end));
        acceleration
    }
}

//! Threads: time along the path goes by the angle of the spindle.
//!
//! A pass begins at rest, by the index mark: so much before the angle at which the program wants it that path length is lead times angle
//! from where the plan has reached its lead. That law is the same on every pass, at whatever speed. From there on the rate of time follows the
//! measured speed of the spindle, and what path and angle are apart is taken out by [`Controller::thread_rate`].
//!
//! A rigid tap does not stop at the ground of its hole while the spindle turns on: [`super::turning`].

use super::*;

/// Part of its speed at which a plan has reached its lead.
const AT_LEAD: f64 = 0.995;
/// Part of the planned spindle speed below which the spindle is lost, and cycles for which it may be.
const LOST: f64 = 0.25;
const LOST_FOR: u64 = 20;
/// How much of what path and angle are apart is taken out, 1/s; and at most by this part of the speed.
const GAIN: f64 = 150.0;
const MOST_CORRECTION: f64 = 0.05;

/// What a thread keeps from cycle to cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thread {
    /// The tie that the law below is for.
    pub tie: Option<Tie>,
    /// The law: at this path length, mm, the spindle is at this angle, turns in its direction of rotation.
    pub law: Option<(f64, f64)>,
    /// It began in this cycle.
    pub has_begun: bool,
    /// The pass began so much before the cycle in which it is to begin, cycles of the plan, not positive.
    pub early: f64,
    /// Cycles for which the spindle was nearly at a standstill.
    pub lost_for: u64,
    /// How far path is ahead of angle, mm; not a number where nothing is tied.
    pub error: f64,
    /// Where the spindle is turned round.
    pub turn: Option<super::turning::Turn>,
}

impl Default for Thread {
    fn default() -> Self {
        Thread {
            tie: None,
            law: None,
            has_begun: false,
            early: 0.0,
            lost_for: 0,
            error: f64::NAN,
            turn: None,
        }
    }
}

/// What the queue shows of the run-in of a thread.
enum RunIn {
    /// Not enough.
    Unknown,
    /// The lead is never reached.
    TooShort,
    /// The path is so far behind a path that had its lead at once, mm.
    Behind(f64),
}

impl Controller {
    /// True while the axes go by the spindle.
    pub(super) fn is_tied(&self) -> bool {
        let moves = !is_rest(&self.here) || self.fraction > 0.0;
        let next = self.next_set_point().and_then(|next| next.tie);
        self.thread.turn.is_some() || (moves && (self.here.tie.is_some() || next.is_some()))
    }

    /// Direction of rotation: 1 clockwise, -1 counterclockwise; `None` when the spindle is told to stand.
    pub(super) fn rotation(&self) -> Option<f64> {
        match self.spindle {
            SpindleCommand::Stop => None,
            SpindleCommand::Clockwise(_) => Some(1.0),
            SpindleCommand::Counterclockwise(_) => Some(-1.0),
        }
    }

    /// What a set-point's speed is to be called at its lead.
    pub(super) fn is_at_lead(path_speed: f64, tie: &Tie) -> bool {
        path_speed >= AT_LEAD * tie.speed()
    }

    /// Path length where the plan is now, mm.
    pub(super) fn path_here(&self) -> f64 {
        match self.next_set_point() {
            Some(next) => {
                let way: [f64; 3] = core::array::from_fn(|k| next.position[k] - self.here.position[k]);
                next.path_length - (1.0 - self.fraction) * length(way)
            }
            None => self.here.path_length,
        }
    }

    /// At rest before a thread, with the spindle at speed: true in the cycle in which it is to begin.
    pub(super) fn meets_the_mark(&mut self, tie: Tie) -> bool {
        let Some(rotation) = self.rotation() else {
            self.happen(Event::Fault(FaultCause::SpindleLost));
            return false;
        };
        if !self.angle.is_read {
            self.happen(Event::Fault(FaultCause::SpindleAngle));
            return false;
        }
        let behind = match self.run_in(&tie) {
            RunIn::Behind(behind) => behind,
            RunIn::Unknown if self.queue.free() > 0 => return false,
            RunIn::TooShort | RunIn::Unknown => {
                self.happen(Event::Stop(StopCause::ThreadTooShort));
                return false;
            }
        };
        if self.turn_ahead().is_some_and(|turn| !self.has_room(&turn, behind)) {
            self.happen(Event::Stop(StopCause::ThreadTooShort));
            return false;
        }
        let begins_at = self.path_here();
        self.thread = Thread {
            tie: Some(tie),
            ..Thread::default()
        };
        let Some(start) = tie.start else {
            return true;
        };
        let Some(mark) = self.angle.mark.filter(|_| !self.angle.misses_index()) else {
            if self.angle.misses_index() {
                self.happen(Event::Fault(FaultCause::SpindleIndex));
            }
            return false;
        };
        let now = rotation * self.angle.turns;
        let early = behind / tie.lead;
        let begin = rotation * mark + start - early;
        let begin = begin + libm::ceil(now - begin);
        let in_a_cycle = rotation * self.angle.speed * TICK.0;
        let begins = begin - now < in_a_cycle;
        if begins {
            self.thread.law = Some((begins_at, begin + early));
            self.thread.early = -(begin - now) / in_a_cycle;
        }
        begins
    }

    /// How far the path at its lead is behind one that had it from the first moment.
    fn run_in(&self, tie: &Tie) -> RunIn {
        let begins_at = self.path_here();
        let mut cycles = 0.0;
        for command in (0..self.ahead()).map_while(|index| self.queue.get(index)) {
            match command {
                Command::SetPoint(s) if s.tie.is_none_or(|other| other.lead != tie.lead) || is_rest(s) => return RunIn::TooShort,
                Command::SetPoint(s) => {
                    cycles += 1.0;
                    if Self::is_at_lead(s.path_speed, tie) {
                        return RunIn::Behind(tie.speed() * cycles * TICK.0 - (s.path_length - begins_at));
                    }
                }
                other if needs_rest(other) => return RunIn::TooShort,
                _ => {}
            }
        }
        RunIn::Unknown
    }

    /// The rate that a thread needs, at most `highest`.
    pub(super) fn thread_rate(&mut self, tie: Tie, planned: &Planned, highest: f64) -> f64 {
        let rotation = self.rotation().unwrap_or(0.0);
        let turns_now = rotation * self.angle.turns;
        let mut rate = rotation * (self.angle.speed + self.angle.acceleration * TICK.0) / tie.revolutions;
        if self.thread.tie.map(|known| known.lead) != Some(tie.lead) {
            // Another lead follows on: its law begins where it is reached.
            (self.thread.tie, self.thread.law) = (Some(tie), None);
        }
        if Self::is_at_lead(planned.path_speed, &tie) {
            // The path as it will be when this cycle's step is made: the angle is that of now.
            let path = self.path_here() + planned.path_speed * self.rate * TICK.0;
            let (from, angle) = *self.thread.law.get_or_insert((path, turns_now));
            // A groove is met again at every whole turn: a pass that stood in the middle goes on in its own.
            let error = path - (from + tie.lead * (turns_now - angle));
            let error = error - tie.lead * libm::round(error / tie.lead);
            self.thread.error = error;
            let correction = self.thread_gain(planned) * error / planned.path_speed;
            rate -= within(correction, -MOST_CORRECTION, MOST_CORRECTION);
        }
        within(rate, 0.0, highest)
    }

    /// As high as the axes can follow it: a change of 2 % takes them sqrt(0.02 v / j).
    fn thread_gain(&self, planned: &Planned) -> f64 {
        let quickest = self.parameters.axes.iter().enumerate().map(|(k, axis)| {
            let v = planned.velocity[k].abs().max(1e-9);
            0.35 * libm::sqrt(0.6 * axis.j_max.0 / v / 0.02)
        });
        quickest.fold(GAIN, f64::min)
    }

    /// Looks after the spindle of a thread.
    pub(super) fn supervise_thread(&mut self, cycles: u64) {
        self.thread.error = f64::NAN;
        if !self.is_tied() {
            self.thread.lost_for = 0;
            return;
        }
        if !self.angle.is_read {
            return self.happen(Event::Fault(FaultCause::SpindleAngle));
        }
        if self.angle.has_slipped || self.angle.misses_index() {
            return self.happen(Event::Fault(FaultCause::SpindleIndex));
        }
        let planned = self.thread.tie.map_or(0.0, |tie| tie.revolutions);
        let is_slow = self.rotation().unwrap_or(0.0) * self.angle.speed < LOST * planned;
        self.thread.lost_for = if is_slow && self.thread.turn.is_none() {
            self.thread.lost_for + cycles
        } else {
            0
        };
        if self.thread.lost_for > LOST_FOR {
            self.happen(Event::Fault(FaultCause::SpindleLost));
        }
    }
}

//! Motion without a program: the joystick, looking for references, going home, and the ways of a tool change.
//!
//! Each axis has a speed that follows what is wanted of it with limited acceleration and jerk ([`crate::follow`]). An axis whose place is
//! known slows down before the end of its travel; one whose place is not known goes slowly.

use super::*;
use crate::follow::follow;

/// Part of an axis's acceleration and jerk that is used without a program.
const GENTLE: f64 = 0.5;
/// Part of its highest speed for ways that are not a program's.
const UNHURRIED: f64 = 0.5;
/// A joystick this near to its middle is in it.
const MIDDLE: f64 = 0.03;
/// How far before the end of its travel an axis stands, mm.
const BEFORE_THE_END: f64 = 0.05;
/// An axis this near to where it goes is there, mm.
const THERE: f64 = 0.0005;
/// Axes in the order in which they look for their references: the tool leaves the part first.
const HOMING_ORDER: [usize; 3] = [2, 0, 1];

impl Controller {
    /// Takes in what the pad shows, before the cycle. `None`: there is none.
    pub fn look_at_pad(&mut self, pad: Option<PadState>) {
        let before = core::mem::replace(&mut self.hand.pad, pad);
        let Some(pad) = pad else { return };
        if before.is_none_or(|b| b.selector != pad.selector) {
            self.choose_mode(pad.selector);
        }
        if before.is_none_or(|b| b.feed != pad.feed) {
            self.hand.feed = pad.feed;
        }
        // A joystick that is pushed when a program ends, or when the selector is turned, must not move anything.
        self.hand.was_in_the_middle |= !pad.dead_man || pad.joystick.abs() <= MIDDLE;
    }

    /// Takes a mode, unless a program has the machine.
    pub(super) fn choose_mode(&mut self, mode: Mode) {
        let exists = !matches!(mode, Mode::Jog { axis } if usize::from(axis) >= self.commanded.len());
        if exists && mode != self.mode_in_force && !self.is_machining() {
            self.mode_in_force = mode;
            self.hand.was_in_the_middle = false;
            self.notices.mode = Some(mode);
        }
    }

    /// True while a program has the machine.
    pub(super) fn is_machining(&self) -> bool {
        use State::*;
        let idle = matches!(
            self.state,
            Off | NotHomed | Homing { .. } | Jogging { .. } | Ready | EmergencyStop | EmergencyStopReleased | Fault(_)
        );
        self.machining || !idle
    }

    /// The machine is free again: the selector's present position applies.
    pub(super) fn end_machining(&mut self) {
        self.machining = false;
        if let Some(pad) = self.hand.pad {
            self.choose_mode(pad.selector);
        }
    }

    /// Looks for what is not known, then goes home.
    pub(super) fn begin_homing(&mut self) {
        if !self.is_machining() && self.stands() {
            self.next_reference();
        }
    }

    /// One cycle, or several of which the first were lost, of a state without a path; `None` when the state has one.
    pub(super) fn by_hand(&mut self, cycles: u64, feedback: &Feedback) -> Option<[f64; 3]> {
        let wanted = match self.state {
            State::NotHomed | State::Ready => {
                let (axis, deflection) = self.joystick();
                if deflection == 0.0 {
                    return None;
                }
                self.happen(Event::Jog { axis: axis as u8 });
                self.jogged(axis, deflection)
            }
            State::Jogging { axis } => {
                let (chosen, deflection) = self.joystick();
                let deflection = if chosen == usize::from(axis) { deflection } else { 0.0 };
                if deflection == 0.0 && self.stands() {
                    self.notices.joystick_stopped = true;
                    self.happen(Event::AtRest);
                    return Some(self.stand());
                }
                self.jogged(usize::from(axis), deflection)
            }
            State::Homing { axis, stage } => self.homing(usize::from(axis), stage, cycles, feedback),
            State::Stopping(_) if self.hand.moving => [0.0; 3],
            _ => match self.in_work?.wait {
                Wait::ToolAway => self.way_to(self.tool_place(), true),
                Wait::ToolBack => self.way_to(self.back_from_tool_change(), false),
                _ => return None,
            },
        };
        let acceleration = self.steer(wanted, cycles);
        if matches!(self.state, State::Stopping(_)) && !self.hand.moving {
            self.stand_at(self.commanded);
            self.happen(Event::AtRest);
        }
        Some(acceleration)
    }

    /// Which axis the joystick moves, and how far it is pushed, -1 to 1; 0 without a dead-man button held.
    fn joystick(&self) -> (usize, f64) {
        match (self.mode_in_force, self.hand.pad) {
            (Mode::Jog { axis }, Some(pad)) => {
                let may = pad.dead_man && self.hand.was_in_the_middle && !self.machining && pad.joystick.abs() > MIDDLE;
                (usize::from(axis), if may { within(pad.joystick, -1.0, 1.0) } else { 0.0 })
            }
            (Mode::Jog { axis }, None) => (usize::from(axis), 0.0),
            (Mode::Auto, _) => (0, 0.0),
        }
    }

    /// Speeds that a joystick asks for, mm/s: at the jog feed, slow without a reference, and never past the travel.
    fn jogged(&self, axis: usize, deflection: f64) -> [f64; 3] {
        let limits = &self.parameters.axes[axis];
        let speed = deflection * f64::from(self.hand.feed) / 255.0 * limits.v_max.0;
        let mut wanted = [0.0; 3];
        wanted[axis] = if self.is_known[axis] {
            let end = if speed > 0.0 {
                limits.highest.0 - BEFORE_THE_END
            } else {
                limits.lowest.0 + BEFORE_THE_END
            };
            let before_end = (end - self.commanded[axis]) * speed.signum();
            speed.signum() * speed.abs().min(self.speed_before(axis, speed.signum(), before_end))
        } else {
            let slow = self.parameters.slow_jog.0;
            within(speed, -slow, slow)
        };
        wanted
    }

    /// Speeds of one cycle of homing, mm/s.
    fn homing(&mut self, axis: usize, stage: HomingStage, cycles: u64, feedback: &Feedback) -> [f64; 3] {
        let limits = &self.parameters.axes[axis];
        let homing = limits.homing;
        let towards = if homing.upwards { 1.0 } else { -1.0 };
        let is_made = feedback.reference_switch[axis];
        let travel = (limits.highest.0 - limits.lowest.0) / homing.search.0;
        self.hand.cycles += cycles;
        let (speed, next, time) = match stage {
            HomingStage::Search => {
                let next = is_made.then_some(HomingStage::BackOff);
                (homing.search.0, next, homing.time_out.0 + travel)
            }
            HomingStage::BackOff => {
                let next = (!is_made).then_some(HomingStage::SlowSearch);
                (-homing.search.0, next, homing.time_out.0)
            }
            HomingStage::SlowSearch => {
                if let (true, Some(index)) = (is_made, feedback.index[axis]) {
                    self.set_zero(axis, homing.reference.0 - index);
                    self.next_reference();
                    return [0.0; 3];
                }
                (homing.slow_search.0, None, homing.time_out.0)
            }
            HomingStage::GoHome => return self.go_home(axis),
        };
        if let Some(stage) = next {
            self.hand.cycles = 0;
            self.happen(Event::Homing { axis: axis as u8, stage });
        } else if self.hand.cycles > seconds_in_cycles(time) {
            self.happen(Event::Fault(FaultCause::Homing { axis: axis as u8 }));
        }
        let mut wanted = [0.0; 3];
        wanted[axis] = speed * towards;
        wanted
    }

    /// Begins with the next axis that is not known; with none left, the way home.
    fn next_reference(&mut self) {
        self.hand.cycles = 0;
        let unknown = HOMING_ORDER.into_iter().find(|axis| !self.is_known[*axis]);
        let (axis, stage) = unknown.map_or((HOMING_ORDER[0], HomingStage::GoHome), |axis| (axis, HomingStage::Search));
        self.happen(Event::Homing { axis: axis as u8, stage });
    }

    /// Z goes home first, then the others.
    fn go_home(&mut self, axis: usize) -> [f64; 3] {
        let home = self.parameters.axes.map(|a| a.homing.home.0);
        let wanted = self.way_to(home, true);
        if wanted == [0.0; 3] && self.stands() {
            self.notices.home_reached = true;
            self.stand_at(self.commanded);
            self.happen(Event::AtHome);
        } else if axis == HOMING_ORDER[0] && self.is_there(2, home[2]) {
            let (axis, stage) = (HOMING_ORDER[1] as u8, HomingStage::GoHome);
            self.happen(Event::Homing { axis, stage });
        }
        wanted
    }

    /// The encoder of an axis reads this much less than where the axis is, mm: everything that is kept as a place moves with it.
    fn set_zero(&mut self, axis: usize, zero: f64) {
        let by = zero - self.zero[axis];
        self.zero[axis] = zero;
        self.is_known[axis] = true;
        self.commanded[axis] += by;
        self.last_position[axis] += by;
        self.here.position[axis] += by;
        self.tail.position[axis] += by;
    }

    /// Where the axes go before a tool is changed: to the place for it, or up by what the next tool is longer.
    fn tool_place(&self) -> [f64; 3] {
        let longer = (self.length.next - self.length.now).max(0.0);
        let [x, y, z] = self.hand.left_at;
        match self.parameters.tool_change_at {
            Some(place) if self.in_work.is_some_and(|w| w.tool != self.tool) => place.map(|p| p.0),
            _ => [x, y, z + longer],
        }
    }

    /// Where they go afterwards: to where the tip of the new tool is where that of the old one was.
    fn back_from_tool_change(&self) -> [f64; 3] {
        let [x, y, z] = self.hand.left_at;
        [x, y, z + self.hand.lengthened]
    }

    /// True when the axes are where the tool can be changed; they may still be coming to rest.
    pub(super) fn is_at_tool_place(&self) -> bool {
        let place = self.tool_place();
        (0..3).all(|k| self.is_there(k, place[k]))
    }

    /// True when the axes are where the path goes on after a change.
    pub(super) fn is_back_from_tool_change(&self) -> bool {
        let place = self.back_from_tool_change();
        (0..3).all(|k| self.is_there(k, place[k]))
    }

    /// The path goes on from the place that the axes came back to.
    pub(super) fn go_on_from_tool_change(&mut self) {
        self.stand_at(self.back_from_tool_change());
    }

    fn is_there(&self, axis: usize, place: f64) -> bool {
        (self.commanded[axis] - place).abs() <= THERE
    }

    /// Speeds towards a place, mm/s: Z first, or Z last.
    fn way_to(&self, place: [f64; 3], z_first: bool) -> [f64; 3] {
        let flat_is_there = self.is_there(0, place[0]) && self.is_there(1, place[1]);
        let z_goes = if z_first { true } else { flat_is_there };
        let flat_goes = !z_first || self.is_there(2, place[2]);
        core::array::from_fn(|k| {
            let left = place[k] - self.commanded[k];
            let goes = if k == 2 { z_goes } else { flat_goes };
            if !goes || left.abs() <= THERE {
                return 0.0;
            }
            let fastest = UNHURRIED * self.parameters.axes[k].v_max.0;
            left.signum() * fastest.min(self.speed_before(k, left.signum(), left.abs()))
        })
    }

    /// The speed from which an axis can stop within `left` mm, with some of its limits left, and with the acceleration that it has now.
    fn speed_before(&self, axis: usize, direction: f64, left: f64) -> f64 {
        let limits = &self.parameters.axes[axis];
        // Less than what is used to follow it, so that the curve is always caught up with.
        let (a, j) = (GENTLE * GENTLE * limits.a_max.0, GENTLE * GENTLE * GENTLE * limits.j_max.0);
        let (speed, rise) = (
            (self.commanded_velocity[axis] * direction).max(0.0),
            (self.hand.acceleration[axis] * direction).max(0.0),
        );
        // Until the acceleration is taken back it goes on, and gets faster.
        let time = rise / (GENTLE * limits.j_max.0) + TICK.0;
        let left = left - speed * time - rise * time * time / 3.0;
        if left <= 0.0 {
            return 0.0;
        }
        // v^2 / (2 a) + v a / (2 j) = left
        let half = a * a / (2.0 * j);
        libm::sqrt(half * half + 2.0 * a * left) - half
    }

    /// Makes the speeds follow what is wanted, and gives the acceleration.
    fn steer(&mut self, wanted: [f64; 3], cycles: u64) -> [f64; 3] {
        let mut moving = false;
        for (k, wanted) in wanted.into_iter().enumerate() {
            let limits = &self.parameters.axes[k];
            let (a, j) = (GENTLE * limits.a_max.0, GENTLE * limits.j_max.0);
            for _ in 0..cycles {
                let before = self.commanded_velocity[k];
                let acceleration = follow((before, self.hand.acceleration[k]), wanted, (-a, a), j, TICK.0);
                let after = before + acceleration * TICK.0;
                let ends = wanted == 0.0 && after.abs() < 1e-9;
                let after = if ends { 0.0 } else { after };
                self.commanded[k] += (before + after) / 2.0 * TICK.0;
                self.commanded_velocity[k] = after;
                self.hand.acceleration[k] = if ends { 0.0 } else { acceleration };
            }
            moving |= self.commanded_velocity[k] != 0.0;
        }
        self.hand.moving = moving;
        self.path_speed = length(self.commanded_velocity);
        self.hand.acceleration
    }
}

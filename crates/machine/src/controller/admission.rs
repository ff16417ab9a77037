//! Why a command must not be executed after the one before it.

use super::*;

/// Times its jerk limit from which on a plan was made without one.
const WITHOUT_JERK_LIMIT: f64 = 1.5;

impl Controller {
    /// A command as the machine will do it: set-points of a tip become set-points of the gauge point.
    pub(super) fn compensated(&self, command: Command) -> Command {
        match command {
            Command::SetPoint(mut s) => {
                s.position[2] += self.queued_length.now;
                Command::SetPoint(s)
            }
            other => other,
        }
    }

    /// Follows what a command leaves behind for the one after it.
    pub(super) fn follow_queued(&mut self, command: &Command) {
        match *command {
            Command::SetPoint(set_point) => {
                self.is_jerky |= self.jerks(&set_point);
                self.tail = set_point;
            }
            Command::ToolLength { length, .. } => self.queued_length.next = length,
            Command::Tool { .. } => {
                self.tail.position[2] += self.queued_length.next - self.queued_length.now;
                self.queued_length.now = self.queued_length.next;
            }
            _ => {}
        }
    }

    /// True for a set-point to which an axis's acceleration changes faster than its limit of jerk by far.
    pub(super) fn jerks(&self, set_point: &SetPoint) -> bool {
        (0..3).any(|k| {
            let change = (set_point.acceleration[k] - self.tail.acceleration[k]).abs();
            change > WITHOUT_JERK_LIMIT * self.parameters.axes[k].j_max.0 * TICK.0
        })
    }

    /// Why a command must not be executed after the one before it.
    pub(super) fn objection(&self, command: &Command) -> Option<StopCause> {
        match command {
            Command::SetPoint(s) if s.tie.is_some_and(|tie| !tie.can_be()) => Some(StopCause::ThreadTooShort),
            Command::SetPoint(s) => (0..3).find_map(|k| {
                let axis = k as u8;
                let limits = &self.parameters.axes[k];
                let (p, v) = (s.position[k], s.velocity[k]);
                if !(p.is_finite() && v.is_finite() && s.acceleration[k].is_finite() && s.path_speed.is_finite()) {
                    return Some(StopCause::Jump { axis });
                }
                if p < limits.lowest.0 - SLACK || p > limits.highest.0 + SLACK {
                    return Some(StopCause::SoftLimit { axis });
                }
                let step = p - self.tail.position[k];
                let too_far = step.abs() > limits.v_max.0 * TICK.0 * 1.001 + SLACK;
                let disagrees = (step - v * TICK.0).abs() > 2.0 * limits.a_max.0 * TICK.0 * TICK.0 + SLACK;
                (too_far || disagrees).then_some(StopCause::Jump { axis })
            }),
            Command::ToolLength { length, .. } if !length.is_finite() => Some(StopCause::Jump { axis: 2 }),
            Command::Tool { .. } if self.tool_leaves_travel() => Some(StopCause::SoftLimit { axis: 2 }),
            command if needs_rest(command) && !self.resting(&self.tail) => Some(StopCause::SwitchInMotion),
            _ => None,
        }
    }

    /// True when Z would have to leave its travel for the tip of the next tool to be where that of the present one is.
    fn tool_leaves_travel(&self) -> bool {
        let after = self.tail.position[2] + self.queued_length.next - self.queued_length.now;
        let z = &self.parameters.axes[2];
        self.queued_length.next != self.queued_length.now && !(z.lowest.0 - SLACK..=z.highest.0 + SLACK).contains(&after)
    }
}

/// True for commands that the machine executes at rest.
pub(super) fn needs_rest(command: &Command) -> bool {
    match command {
        Command::SetPoint(_)
        | Command::SpindleSpeed(_)
        | Command::ToolLength { .. }
        | Command::Coolant { .. }
        | Command::Workingstep { .. }
        | Command::Watch { .. } => false,
        Command::Spindle { .. } | Command::Tool { .. } | Command::Dwell { .. } | Command::Pause { .. } | Command::End { .. } => {
            true
        }
    }
}

/// True for a set-point at which the path stands still.
pub(super) fn is_rest(set_point: &SetPoint) -> bool {
    set_point.velocity == [0.0; 3]
}

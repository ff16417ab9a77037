//! Why a command must not be executed after the one before it.

use super::*;

/// Times its jerk limit from which on a plan was made without one.
const WITHOUT_JERK_LIMIT: f64 = 1.5;

impl Controller {
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
            command if needs_rest(command) && !self.resting(&self.tail) => Some(StopCause::SwitchInMotion),
            _ => None,
        }
    }
}

/// True for commands that the machine executes at rest.
pub(super) fn needs_rest(command: &Command) -> bool {
    match command {
        Command::SetPoint(_)
        | Command::SpindleSpeed(_)
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

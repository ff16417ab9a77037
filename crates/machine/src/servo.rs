//! The cascaded loop of one axis: position loop with feed-forward over a velocity loop with integral part.
//!
//! The position loop runs in the controller once a cycle, the velocity loop in the drive several times a cycle; both are here so that
//! a drive without a velocity loop of its own can use it.

use crate::parameters::{Mechanics, PositionLaw, ServoGains};
use units::TICK;

/// Time constant with which a standing axis forgets its integral part, s.
const FORGETTING_TIME: f64 = 0.02;

/// The outer loop: from set-point and encoder to a speed and a feed-forward torque.
#[derive(Clone, Copy, Debug)]
pub struct PositionLoop {
    /// mm/s for each mm of following error.
    gain: f64,
    /// Nm for each mm/s^2.
    torque_of_acceleration: f64,
    /// Nm for each mm/s.
    torque_of_velocity: f64,
    /// Coulomb friction and what static friction has on top of it, Nm in plus and in minus direction.
    sliding: [f64; 2],
    breakaway: [f64; 2],
    /// Speed, mm/s, and travel, mm, up to which the extra is given.
    stribeck_speed: f64,
    breakaway_travel: f64,
    /// Where the plan rested or turned round last, mm, and the sign of its speed since.
    turned_at: f64,
    direction: f64,
    /// Half an encoder pulse and a bit, mm: no correction inside it at rest, or stiction and quantisation would make the axis hunt.
    dead_band: f64,
    law: PositionLaw,
}

/// What the position loop asks of the velocity loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpeedOrder {
    /// mm/s.
    pub velocity: f64,
    /// The plan's part of it, mm/s.
    pub planned: f64,
    /// Nm at the motor.
    pub torque: f64,
}

impl PositionLoop {
    /// A loop for an axis with these gains and mechanics, reading an encoder of `pulses_per_mm`.
    pub fn new(gains: &ServoGains, mechanics: &Mechanics, pulses_per_mm: f64) -> Self {
        let rg = mechanics.transmission;
        let torque_per_volt = mechanics.current_gain * mechanics.torque_constant;
        let known = |volts: f64| volts * torque_per_volt * gains.friction_compensation;
        PositionLoop {
            gain: gains.position * rg,
            torque_of_acceleration: mechanics.inertia / rg,
            torque_of_velocity: mechanics.viscous / rg,
            sliding: mechanics.coulomb_friction.map(known),
            breakaway: core::array::from_fn(|side| known(mechanics.static_friction[side] - mechanics.coulomb_friction[side])),
            stribeck_speed: mechanics.stribeck_speed * rg,
            breakaway_travel: gains.breakaway_travel,
            turned_at: 0.0,
            direction: 0.0,
            dead_band: 0.75 / pulses_per_mm,
            law: PositionLaw::default(),
        }
    }

    /// The same by another law.
    pub fn by(self, law: PositionLaw) -> Self {
        PositionLoop { law, ..self }
    }

    /// One cycle. `position`, `velocity`, `acceleration` are commanded (mm, mm/s, mm/s^2), `actual` is by encoder, mm.
    pub fn order(&mut self, position: f64, velocity: f64, acceleration: f64, actual: f64) -> SpeedOrder {
        let mut error = position - actual;
        if velocity == 0.0 && error.abs() <= self.dead_band {
            error = 0.0;
        }
        if self.law == PositionLaw::SpeedSetPoint {
            return SpeedOrder {
                velocity: velocity + self.gain * error,
                planned: velocity,
                torque: 0.0,
            };
        }
        // The order holds for the whole coming cycle, so the speed of its middle is the right one.
        let middle = velocity + acceleration * (0.5 * TICK.0);
        SpeedOrder {
            velocity: middle + self.gain * error,
            planned: middle,
            torque: self.torque_of_acceleration * acceleration
                + self.torque_of_velocity * middle
                + self.friction(position, middle),
        }
    }

    /// What friction takes at a commanded place and speed, mm and mm/s, as far as it is known, Nm.
    ///
    /// It turns round at once with the commanded speed, and is higher over the first micrometres, until the axis has broken away: without
    /// that, the axis sticks at each reversal until the position loop has gathered enough error (the quadrant marks on a circle). The
    /// commanded speed is free of noise, and exactly 0 at rest, so a standing axis is not pushed to and fro.
    fn friction(&mut self, position: f64, velocity: f64) -> f64 {
        let direction = if velocity == 0.0 { 0.0 } else { 1f64.copysign(velocity) };
        if direction != self.direction {
            (self.direction, self.turned_at) = (direction, position);
        }
        let side = usize::from(velocity < 0.0);
        let ratio = velocity / self.stribeck_speed;
        let slow = if ratio.abs() > 5.0 { 0.0 } else { libm::exp(-ratio * ratio) };
        let near = 1.0 - (position - self.turned_at).abs() / self.breakaway_travel;
        direction * (self.sliding[side] + self.breakaway[side] * slow.max(near))
    }
}

/// The inner loop: from a speed to a control voltage, with an integral part that does not wind up.
#[derive(Clone, Copy, Debug)]
pub struct VelocityLoop {
    gain: f64,
    integral_gain: f64,
    volts_per_torque: f64,
    limit: f64,
    /// The integral part, V.
    integral: f64,
    /// Sign of the last planned speed that was not 0.
    direction: f64,
    /// Coulomb friction that the feed-forward does not supply, in plus and in minus direction, V.
    unknown_friction: [f64; 2],
}

impl VelocityLoop {
    /// A loop for an axis with these gains and mechanics.
    pub fn new(gains: &ServoGains, mechanics: &Mechanics) -> Self {
        VelocityLoop {
            gain: gains.velocity,
            integral_gain: gains.velocity / gains.integral_time,
            volts_per_torque: 1.0 / (mechanics.current_gain * mechanics.torque_constant),
            limit: mechanics.peak_current / mechanics.current_gain,
            integral: 0.0,
            direction: 0.0,
            unknown_friction: mechanics
                .coulomb_friction
                .map(|v| v * (1.0 - gains.friction_compensation).max(0.0)),
        }
    }

    /// The plan's speed in the coming cycle, any unit.
    ///
    /// What the integral part has gathered is the friction that the feed-forward does not know, and the force of the cut. At a reversal
    /// the one turns round with the motion, and the other is most likely over: the tool goes back. Without that the integral part would
    /// push against the new direction until it has unlearnt.
    pub fn plan(&mut self, speed: f64) {
        if speed == 0.0 {
            return;
        }
        let direction = 1f64.copysign(speed);
        if direction == -self.direction {
            let (from, to) = (usize::from(direction > 0.0), usize::from(direction < 0.0));
            let friction = within(self.integral, -self.unknown_friction[from], self.unknown_friction[from]);
            self.integral = if friction == 0.0 {
                0.0
            } else {
                -friction * self.unknown_friction[to] / self.unknown_friction[from]
            };
        }
        self.direction = direction;
    }

    /// Control voltage, V, from commanded and real motor speed, rad/s, feed-forward torque, Nm, and the time since the last call, s.
    pub fn voltage(&mut self, commanded: f64, actual: f64, torque: f64, step: f64) -> f64 {
        let error = commanded - actual;
        let wanted = self.gain * error + self.integral + torque * self.volts_per_torque;
        let given = within(wanted, -self.limit, self.limit);
        // Integrate only while the amplifier can follow, or when that brings it back from its limit.
        if wanted == given || (wanted > given) != (error > 0.0) {
            self.integral += self.integral_gain * error * step;
        }
        // A standing axis forgets the friction of its last direction, or it would start the next way against it.
        if commanded == 0.0 && actual == 0.0 {
            self.integral -= self.integral * (step / FORGETTING_TIME).min(1.0);
        }
        given
    }

    /// Forgets the past: the drive was off.
    pub fn reset(&mut self) {
        (self.integral, self.direction) = (0.0, 0.0);
    }
}

/// Like `clamp`, which panics when its bounds are not numbers.
pub(crate) fn within(value: f64, low: f64, high: f64) -> f64 {
    value.max(low).min(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::MachineParameters;

    #[test]
    fn the_published_gains_give_162_7_per_second() {
        let x = MachineParameters::small_machining_centre().axes[0];
        let order = PositionLoop::new(&x.servo, &x.mechanics, 1000.0).order(1.0, 0.0, 0.0, 0.0);
        assert!((order.velocity - 162.65).abs() < 0.01, "{order:?}");
    }

    #[test]
    fn an_error_below_a_pulse_at_rest_is_left_alone() {
        let x = MachineParameters::small_machining_centre().axes[0];
        let mut position = PositionLoop::new(&x.servo, &x.mechanics, 1000.0);
        assert_eq!(position.order(10.0004, 0.0, 0.0, 10.0), SpeedOrder::default());
        assert!(position.order(10.002, 0.0, 0.0, 10.0).velocity > 0.0);
    }

    #[test]
    fn a_saturated_loop_does_not_wind_up() {
        let x = MachineParameters::small_machining_centre().axes[0];
        let mut velocity = VelocityLoop::new(&x.servo, &x.mechanics);
        for _ in 0..10_000 {
            assert!(velocity.voltage(1.0e4, 0.0, 0.0, 2.5e-4) <= 36.0 / 3.1201);
        }
        // The moment the error turns round, so does the voltage.
        assert!(velocity.voltage(-100.0, 0.0, 0.0, 2.5e-4) < 0.0);
    }
}

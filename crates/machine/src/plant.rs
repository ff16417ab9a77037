//! The simulated drives and mechanics: a [`CyclicDrive`] that needs no machine.
//!
//! For each axis J dw/dt = Ka Kt u - B w - T_f(w) - rg F_cut with T_f(w) = sgn(w) (Tc + (Ts - Tc) exp(-(w/ws)^2)), as published with the
//! parameters ([`crate::parameters`]); a standing axis sticks until the torque exceeds static friction (Karnopp's model). On top:
//! amplifier limits, a quantised encoder on the motor, play between motor and slide, a screw that warms up, a spindle limited by torque
//! and power, a rough cutting force, and sensor noise from a seed. Everything it tells is SIMULATED.

use crate::drive::{AxisOrder, CyclicDrive, DriveMode, DriveOrders, Feedback};
use crate::parameters::{CuttingParameters, HomingParameters, MachineParameters, Mechanics, SpindleParameters};
use crate::servo::{VelocityLoop, within};
use crate::{CoolantOutlets, SpindleCommand};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use units::{Machine, Point, TICK, Tick};

/// Integration steps in one servo cycle.
const SUBSTEPS: u32 = 4;
const STEP: f64 = TICK.0 / SUBSTEPS as f64;
/// Cycles beyond those that the controller may lose for which the drives go on without an order before they stop by themselves.
const WATCHDOG: u64 = 3;
/// Noise of reported loads, percent rms: 5 quanta of the record.
const LOAD_NOISE: f64 = 0.5;
/// Noise of reported currents, A rms: 5 quanta of the record.
const CURRENT_NOISE: f64 = 0.05;
/// Noise of reported speeds, mm/s rms.
const VELOCITY_NOISE: f64 = 0.1;
/// Noise of the reported spindle speed, rev/min rms.
const SPINDLE_NOISE: f64 = 0.3;
/// A commanded path speed that changes less than this in a cycle is a steady one, mm/s.
const STEADY: f64 = 0.2;
/// A quick stop brakes harder than any planned motion.
const QUICK_STOP: f64 = 1.3;

/// Drives, axes and spindle of a simulated machine.
#[derive(Clone, Debug)]
pub struct Plant {
    axes: [Axis; 3],
    spindle: Spindle,
    cutting: CuttingParameters,
    cut_force: f64,
    path_speed_before: f64,
    noise: ChaCha8Rng,
    orders: DriveOrders,
    ordered_at: Tick,
    at: Tick,
    emergency_stop: bool,
    watchdog: u64,
    watchdog_tripped: bool,
}

#[derive(Clone, Debug)]
struct Axis {
    mechanics: Mechanics,
    velocity_loop: VelocityLoop,
    torque_per_volt: f64,
    static_torque: [f64; 2],
    coulomb_torque: [f64; 2],
    pulses_per_mm: f64,
    /// Where the encoder counts 0, mm: the machine's zero, or wherever the axis was at power-on.
    counts_from: f64,
    homing: HomingParameters,
    /// Where the axis was at the last reading, mm.
    read_at: f64,
    quick_stop_deceleration: f64,
    /// Middle and width of the travel, mm: where the screw does not grow, and over which it does.
    travel: (f64, f64),
    /// By the motor, mm.
    position: f64,
    /// Motor speed, rad/s.
    speed: f64,
    /// The motor's own encoder: pulses for each mm of travel, and its last reading.
    motor_pulses: (f64, f64),
    /// Ramp of a quick stop, rad/s.
    ramp: f64,
    /// Motor current, A.
    current: f64,
    /// Slide, behind the play, mm.
    slide: f64,
    /// Temperature of the screw above the room, K.
    warmth: f64,
    /// Disturbance: multiplies friction.
    friction_factor: f64,
    /// Disturbance: added to the encoder, pulses.
    encoder_error: i32,
}

#[derive(Clone, Debug)]
struct Spindle {
    parameters: SpindleParameters,
    /// rad/s, positive clockwise.
    speed: f64,
    torque: f64,
    /// Turns since power-on; the index mark is at whole ones.
    angle: f64,
    /// The encoder's last reading, counts.
    counts: f64,
    /// Disturbance: extra braking torque, Nm.
    dip: f64,
    /// Disturbances: the encoder, or only its index pulse, is gone.
    is_blind: bool,
    has_no_index: bool,
}

impl Plant {
    /// A machine at rest without power, its motors at `start`.
    pub fn new(parameters: &MachineParameters, start: Point<Machine>, seed: u64) -> Self {
        Plant {
            axes: core::array::from_fn(|k| Axis::new(&parameters.axes[k], start.xyz[k], parameters.absolute_encoders)),
            spindle: Spindle {
                parameters: parameters.spindle,
                speed: 0.0,
                torque: 0.0,
                // Where it came to rest last is anywhere.
                angle: 0.37,
                counts: libm::floor(0.37 * parameters.spindle.encoder_counts),
                dip: 0.0,
                is_blind: false,
                has_no_index: false,
            },
            cutting: parameters.cutting,
            cut_force: 0.0,
            path_speed_before: 0.0,
            noise: ChaCha8Rng::seed_from_u64(seed),
            orders: DriveOrders::default(),
            ordered_at: Tick(0),
            at: Tick(0),
            emergency_stop: false,
            watchdog: u64::from(parameters.late_ticks_allowed) + WATCHDOG,
            watchdog_tripped: false,
        }
    }

    /// Where the slides really are, mm: behind play and warmth, which the encoders do not see. A real machine cannot know this; only the
    /// simulated part and the simulated gauge may ask.
    pub fn true_position(&self) -> [f64; 3] {
        core::array::from_fn(|k| self.axes[k].true_position())
    }

    /// Which coolant valves are open.
    pub fn coolant(&self) -> CoolantOutlets {
        self.orders.coolant
    }

    /// Presses or releases the emergency stop button.
    pub fn set_emergency_stop(&mut self, pressed: bool) {
        self.emergency_stop = pressed;
    }

    /// Multiplies the friction of an axis; 1 is normal. An axis that does not exist is left alone.
    pub fn set_friction_factor(&mut self, axis: usize, factor: f64) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.friction_factor = if factor.is_finite() { factor.max(0.0) } else { 1.0 };
        }
    }

    /// Adds pulses to what an encoder reads; 0 is normal. An axis that does not exist is left alone.
    pub fn set_encoder_error(&mut self, axis: usize, pulses: i32) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.encoder_error = pulses;
        }
    }

    /// The spindle's true angle, turns since power-on, positive clockwise: what its encoder gives in whole counts.
    pub fn spindle_angle(&self) -> f64 {
        self.spindle.angle
    }

    /// Brakes the spindle by a torque on top of the cut's, Nm; 0 is normal.
    pub fn set_spindle_dip(&mut self, torque: f64) {
        self.spindle.dip = if torque.is_finite() { torque.max(0.0) } else { 0.0 };
    }

    /// Takes the spindle's encoder away, or only its index pulse.
    pub fn set_spindle_encoder_fault(&mut self, is_blind: bool, has_no_index: bool) {
        (self.spindle.is_blind, self.spindle.has_no_index) = (is_blind, has_no_index);
    }

    /// One servo cycle.
    fn cycle(&mut self) {
        let late = self.at - self.ordered_at >= self.watchdog && self.orders.mode == DriveMode::Follow;
        self.watchdog_tripped |= late;
        let mode = if self.emergency_stop || self.watchdog_tripped {
            // SS1 of IEC 61800-5-2: brake, then no power.
            let at_rest = self.axes.iter().all(|a| a.speed == 0.0);
            if self.emergency_stop && at_rest {
                DriveMode::Off
            } else {
                DriveMode::QuickStop
            }
        } else {
            self.orders.mode
        };
        let spindle_order = if self.emergency_stop {
            SpindleCommand::Stop
        } else {
            self.orders.spindle
        };
        let (cut_force, path) = self.cut();
        for (axis, order) in self.axes.iter_mut().zip(&self.orders.axes) {
            let share = if path > 0.0 {
                (axis.speed * axis.mechanics.transmission).abs() / path
            } else {
                0.0
            };
            axis.cycle(mode, order, cut_force * share);
        }
        self.spindle.cycle(spindle_order, cut_force * self.cutting.arm);
    }

    /// Cutting force, N, smoothed over some 20 ms, and the real path speed, mm/s.
    fn cut(&mut self) -> (f64, f64) {
        let path = libm::sqrt(
            self.axes
                .iter()
                .map(|a| {
                    let v = a.speed * a.mechanics.transmission;
                    v * v
                })
                .sum(),
        );
        // A feed is steady; a rapid is slow only while it speeds up or slows down.
        let steady = (self.orders.path_speed - self.path_speed_before).abs() < STEADY;
        self.path_speed_before = self.orders.path_speed;
        let feeds = self.orders.path_speed > 0.0 && self.orders.path_speed <= self.cutting.fastest_feed.0;
        let cuts = self.spindle.speed.abs() > 5.0 && steady && feeds;
        let target = if cuts {
            (self.cutting.force_per_speed * path).min(self.cutting.highest_force)
        } else {
            0.0
        };
        self.cut_force += (target - self.cut_force) * 0.05;
        (self.cut_force, path)
    }

    /// Bell-shaped noise of rms 1: the sum of four 16-bit numbers.
    fn noise(&mut self) -> f64 {
        let bits = self.noise.next_u64();
        let sum = (bits & 0xffff) + (bits >> 16 & 0xffff) + (bits >> 32 & 0xffff) + (bits >> 48);
        const MEAN: f64 = 2.0 * 65_535.0;
        const RMS: f64 = 37_837.227_162_9; // 65536 * sqrt(4 / 12)
        (sum as f64 - MEAN) / RMS
    }
}

impl CyclicDrive for Plant {
    fn read(&mut self, now: Tick) -> Feedback {
        // A realtime loop that was away for long finds the drives stopped: more cycles would change nothing.
        let cycles = (now - self.at).min(60_000);
        for _ in 0..cycles {
            self.cycle();
            self.at += 1;
        }
        self.at = now;
        let mut feedback = Feedback {
            emergency_stop: self.emergency_stop,
            drive_fault: self.watchdog_tripped,
            ..Feedback::default()
        };
        for k in 0..3 {
            feedback.index[k] = self.axes[k].passed_index();
            let axis = &self.axes[k];
            feedback.reference_switch[k] = axis.reference_switch();
            let (position, velocity, current) = (axis.encoder(), axis.speed * axis.mechanics.transmission, axis.current);
            let rated = axis.mechanics.rated_current;
            feedback.position[k] = position;
            feedback.velocity[k] = velocity + VELOCITY_NOISE * self.noise();
            feedback.current[k] = current + CURRENT_NOISE * self.noise();
            feedback.load[k] = 100.0 * current / rated + LOAD_NOISE * self.noise();
        }
        const RPM: f64 = 60.0 / core::f64::consts::TAU;
        let flutter = if self.spindle.speed == 0.0 { 0.0 } else { SPINDLE_NOISE };
        feedback.spindle_speed = self.spindle.speed * RPM + flutter * self.noise();
        (feedback.spindle_angle, feedback.spindle_index) = self.spindle.encoder();
        feedback.spindle_load = 100.0 * self.spindle.torque.abs() / self.spindle.parameters.torque + LOAD_NOISE * self.noise();
        feedback
    }

    fn order(&mut self, now: Tick, orders: &DriveOrders) {
        self.orders = *orders;
        self.ordered_at = now;
        if orders.mode != DriveMode::Follow && self.axes.iter().all(|a| a.speed == 0.0) {
            self.watchdog_tripped = false;
        }
    }
}

impl Axis {
    fn new(parameters: &crate::AxisParameters, start: f64, absolute: bool) -> Self {
        let mechanics = parameters.mechanics;
        let torque_per_volt = mechanics.current_gain * mechanics.torque_constant;
        let (low, high) = (parameters.lowest.0, parameters.highest.0);
        let motor_pulses = mechanics.motor_pulses / (core::f64::consts::TAU * mechanics.transmission);
        Axis {
            mechanics,
            velocity_loop: VelocityLoop::new(&parameters.servo, &mechanics),
            torque_per_volt,
            static_torque: mechanics.static_friction.map(|v| v * torque_per_volt),
            coulomb_torque: mechanics.coulomb_friction.map(|v| v * torque_per_volt),
            pulses_per_mm: parameters.pulses_per_mm,
            counts_from: if absolute { 0.0 } else { start },
            homing: parameters.homing,
            read_at: start,
            quick_stop_deceleration: QUICK_STOP * parameters.a_max.0 / mechanics.transmission,
            travel: ((low + high) / 2.0, (high - low).max(1.0)),
            position: start,
            speed: 0.0,
            motor_pulses: (motor_pulses, libm::round(start * motor_pulses)),
            ramp: 0.0,
            current: 0.0,
            slide: start,
            warmth: 0.0,
            friction_factor: 1.0,
            encoder_error: 0,
        }
    }

    /// Position by the encoder: whole pulses.
    fn encoder(&self) -> f64 {
        self.read_encoder(self.position)
    }

    fn read_encoder(&self, place: f64) -> f64 {
        (libm::round((place - self.counts_from) * self.pulses_per_mm) + f64::from(self.encoder_error)) / self.pulses_per_mm
    }

    /// True where the reference switch is made: from a little before the reference to the end of the axis.
    fn reference_switch(&self) -> bool {
        let (reference, before) = (self.homing.reference.0, self.homing.switch_before.0);
        if self.homing.upwards {
            self.position >= reference - before
        } else {
            self.position <= reference + before
        }
    }

    /// What the encoder read at the index pulse that was passed since the last call: one in each turn of the motor, and one is the reference.
    fn passed_index(&mut self) -> Option<f64> {
        let turn = core::f64::consts::TAU * self.mechanics.transmission;
        let turns = |place: f64| libm::floor((place - self.homing.reference.0) / turn);
        let (before, now) = (turns(self.read_at), turns(self.position));
        self.read_at = self.position;
        (before != now).then(|| self.read_encoder(self.homing.reference.0 + before.max(now) * turn))
    }

    /// Motor speed as the drive knows it, rad/s: whole pulses of the motor's encoder since the last integration step.
    fn measured_speed(&mut self) -> f64 {
        let (pulses_per_mm, last) = self.motor_pulses;
        let pulses = libm::round(self.position * pulses_per_mm);
        self.motor_pulses.1 = pulses;
        (pulses - last) / (pulses_per_mm * self.mechanics.transmission * STEP)
    }

    fn true_position(&self) -> f64 {
        let (middle, width) = self.travel;
        self.slide + self.warmth * self.mechanics.expansion * (self.slide - middle) / width
    }

    /// One servo cycle with an order and a force against the motion (N).
    fn cycle(&mut self, mode: DriveMode, order: &AxisOrder, force: f64) {
        let m = self.mechanics;
        if mode == DriveMode::Follow {
            self.velocity_loop.plan(order.planned);
        }
        let load = force * m.transmission * 1e-3;
        let mut friction_power = 0.0;
        for _ in 0..SUBSTEPS {
            let measured = self.measured_speed();
            let motor = match mode {
                DriveMode::Follow => {
                    self.ramp = self.speed;
                    let u = self
                        .velocity_loop
                        .voltage(order.velocity / m.transmission, measured, order.torque, STEP);
                    u * self.torque_per_volt
                }
                DriveMode::QuickStop => {
                    let fall = self.quick_stop_deceleration * STEP;
                    let before = self.ramp;
                    self.ramp -= within(self.ramp, -fall, fall);
                    let feed_forward = (self.ramp - before) / STEP * m.inertia + m.viscous * self.ramp;
                    let u = self.velocity_loop.voltage(self.ramp, measured, feed_forward, STEP);
                    u * self.torque_per_volt
                }
                DriveMode::Off => {
                    self.velocity_loop.reset();
                    self.ramp = self.speed;
                    0.0
                }
            };
            self.current = motor / m.torque_constant;
            // The holding brake closes when power goes: worth a rated torque.
            let brake = if mode == DriveMode::Off {
                m.rated_current * m.torque_constant
            } else {
                0.0
            };
            let factor = self.friction_factor;
            let drag = |side: usize, speed: f64| {
                let (stick, slide) = (self.static_torque[side] * factor, self.coulomb_torque[side] * factor);
                let ratio = speed / m.stribeck_speed;
                let stribeck = if ratio.abs() > 5.0 { 0.0 } else { libm::exp(-ratio * ratio) };
                slide + (stick - slide) * stribeck + brake
            };
            let before = self.speed;
            if before == 0.0 {
                // Sticks until the torque exceeds static friction.
                let side = usize::from(motor < 0.0);
                let excess = motor.abs() - drag(side, 0.0);
                if excess > 0.0 {
                    self.speed = excess.copysign(motor) / m.inertia * STEP;
                }
            } else {
                let side = usize::from(before < 0.0);
                let against = (drag(side, before) + load).copysign(before);
                let after = before + (motor - m.viscous * before - against) / m.inertia * STEP;
                // Friction stops an axis, it never turns it round.
                self.speed = if after * before < 0.0 { 0.0 } else { after };
                friction_power += (against * before).abs();
            }
            self.position += (self.speed + before) / 2.0 * m.transmission * STEP;
        }
        let play = m.backlash / 2.0;
        self.slide = within(self.slide, self.position - play, self.position + play);
        self.warmth += (m.heating * friction_power / f64::from(SUBSTEPS) - self.warmth / m.cooling_time) * TICK.0;
    }
}

impl Spindle {
    /// One servo cycle; `cut` is the braking torque of the cut, Nm.
    fn cycle(&mut self, order: SpindleCommand, cut: f64) {
        let p = &self.parameters;
        const RAD_PER_SEC: f64 = core::f64::consts::TAU / 60.0;
        let target = match order {
            SpindleCommand::Stop => 0.0,
            SpindleCommand::Clockwise(n) => n.min(p.highest).0 * RAD_PER_SEC,
            SpindleCommand::Counterclockwise(n) => -n.min(p.highest).0 * RAD_PER_SEC,
        };
        let limit = p.torque.min(p.power / self.speed.abs().max(1.0));
        let drag = if self.speed == 0.0 {
            0.0
        } else {
            (p.friction + cut + self.dip).copysign(self.speed) + p.viscous * self.speed
        };
        let holding = if target == 0.0 {
            0.0
        } else {
            p.friction.copysign(target) + p.viscous * self.speed
        };
        self.torque = within(p.inertia / p.response.0 * (target - self.speed) + holding, -limit, limit);
        let before = self.speed;
        self.speed += (self.torque - drag) / p.inertia * TICK.0;
        if target == 0.0 && self.speed.abs() < 0.5 {
            (self.speed, self.torque) = (0.0, 0.0);
        }
        self.angle += (before + self.speed) / 2.0 / core::f64::consts::TAU * TICK.0;
    }

    /// Angle in whole counts, and where the index mark was passed since the last call, turns.
    fn encoder(&mut self) -> (Option<f64>, Option<f64>) {
        let counts_per_turn = self.parameters.encoder_counts;
        if counts_per_turn <= 0.0 || self.is_blind {
            return (None, None);
        }
        let (before, now) = (self.counts, libm::floor(self.angle * counts_per_turn));
        self.counts = now;
        let turn = |counts: f64| libm::floor(counts / counts_per_turn);
        let passed = turn(before) != turn(now) && !self.has_no_index;
        (Some(now / counts_per_turn), passed.then(|| turn(before.max(now))))
    }
}

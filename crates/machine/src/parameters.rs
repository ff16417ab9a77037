//! What kind of machine it is: limits, gains and mechanics, with their units in the types or the names.
//!
//! The mechanical values are those of a published small machining centre (Chinese Journal of Mechanical Engineering 2023, doi
//! 10.1186/s10033-023-00946-x, table 1); its servo gains are where ours begin, and where we left them is said beside them. What that
//! source does not give (travels, rated currents, motor encoders, spindle, thermal behaviour, cutting) is assumed and says so here;
//! nothing in it is a measurement of a real machine's.

use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Rpm, Seconds};

/// Everything the realtime half and the simulated mechanics need to know about one machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineParameters {
    /// X, Y, Z.
    pub axes: [AxisParameters; 3],
    /// The main spindle.
    pub spindle: SpindleParameters,
    /// Time for one tool change.
    pub tool_change: Seconds,
    /// True when the changer needs the spindle to stand (a mill's arm), false for a turret. The spindle gets back to its speed before the
    /// program goes on.
    pub tool_change_stops_spindle: bool,
    /// How the axes are kept on their set-points.
    pub position_law: PositionLaw,
    /// Following error that is counted and reported.
    pub following_warning: Millimetres,
    /// Following error at which the drives are stopped.
    pub following_fault: Millimetres,
    /// Where the path is at rest the program goes on when every axis is this near, as the in-position width of a control.
    pub in_position: Millimetres,
    /// It goes on after this time in any case; that is counted.
    pub in_position_time_out: Seconds,
    /// True when the axes know where they are at power-on. Else they have to be homed before a program runs.
    pub absolute_encoders: bool,
    /// Highest speed by hand as long as an axis's place is not known.
    pub slow_jog: MmPerSec,
    /// Where tools are changed: Z goes there first and comes back last. `None`: on the spot.
    pub tool_change_at: Option<[Millimetres; 3]>,
    /// Servo cycles that may be lost in a row before the machine makes a controlled stop.
    pub late_ticks_allowed: u32,
    /// How much cutting loads the axes; simulation only.
    pub cutting: CuttingParameters,
}

/// One linear axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisParameters {
    /// Lowest allowed position, machine frame.
    pub lowest: Millimetres,
    /// Highest allowed position, machine frame.
    pub highest: Millimetres,
    /// Highest speed.
    pub v_max: MmPerSec,
    /// Highest acceleration.
    pub a_max: MmPerSec2,
    /// Highest jerk: of hold, override and jog. Assumed.
    pub j_max: MmPerSec3,
    /// Encoder resolution, pulses per millimetre.
    pub pulses_per_mm: f64,
    /// How its reference is found.
    pub homing: HomingParameters,
    /// Position and velocity loop.
    pub servo: ServoGains,
    /// Motor, screw and slide.
    pub mechanics: Mechanics,
}

/// How the reference of an axis is found: fast onto the switch, off it again, slowly onto it and on to the next index pulse of the encoder,
/// which is a known place. All assumed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomingParameters {
    /// True when the switch is at the upper end.
    pub upwards: bool,
    /// Speed of the search, and back off the switch.
    pub search: MmPerSec,
    /// Speed of the slow search.
    pub slow_search: MmPerSec,
    /// Where the index pulse behind the switch is, machine frame.
    pub reference: Millimetres,
    /// Where home is, machine frame.
    pub home: Millimetres,
    /// How far before the index pulse the switch is made; the simulated axis has it there.
    pub switch_before: Millimetres,
    /// After this time backing off or searching slowly it is a fault. The fast search may take as long as its speed takes over the travel
    /// on top of it.
    pub time_out: Seconds,
}

/// How an axis is kept on its set-points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PositionLaw {
    /// Position loop with feed-forward of speed, acceleration and friction: for drives that take a torque on top of a speed.
    #[default]
    FeedForward,
    /// The set-point's speed, corrected by the error of the position, and nothing else: the loop of the published CAM-controlled machine, for
    /// drives that take a speed.
    SpeedSetPoint,
}

/// Gains of the cascaded loop of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoGains {
    /// Position loop, rad/s of motor speed for each mm of following error (Kp).
    pub position: f64,
    /// Velocity loop, V for each rad/s (Kv).
    pub velocity: f64,
    /// Integral time of the velocity loop, s (Tv).
    pub integral_time: f64,
    /// Part of the friction that the feed-forward supplies, 0..=1: what is known of it. The rest is for the loop to find.
    pub friction_compensation: f64,
    /// Travel after a rest or a reversal over which the feed-forward supplies static friction, falling to Coulomb friction, mm. Long enough
    /// for the axis to break away, so short that it does not push a sliding axis off its course.
    pub breakaway_travel: f64,
}

/// Motor, transmission and slide of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mechanics {
    /// Amplifier, A for each V of control voltage (Ka).
    pub current_gain: f64,
    /// Motor, Nm/A (Kt).
    pub torque_constant: f64,
    /// Travel for each radian of the motor, mm/rad (rg).
    pub transmission: f64,
    /// Inertia seen by the motor, kg m^2 (J).
    pub inertia: f64,
    /// Viscous friction, Nm s/rad (B).
    pub viscous: f64,
    /// Static friction as control voltage, V, for motion in plus and in minus direction, both positive.
    pub static_friction: [f64; 2],
    /// Coulomb friction as control voltage, V, for motion in plus and in minus direction, both positive.
    pub coulomb_friction: [f64; 2],
    /// Motor speed at which static friction has gone over into Coulomb friction, rad/s.
    pub stribeck_speed: f64,
    /// Current that counts as 100 % load, A. Assumed.
    pub rated_current: f64,
    /// Current at which the amplifier limits, A. Assumed.
    pub peak_current: f64,
    /// Pulses in a turn of the motor by its own encoder, from which the drive has its speed. Assumed.
    pub motor_pulses: f64,
    /// Play between motor and slide, mm. Assumed. The encoder sits on the motor and does not see it.
    pub backlash: f64,
    /// Screw expansion for each kelvin at full travel, mm/K. Assumed.
    pub expansion: f64,
    /// Screw heating by friction power, K/J. Assumed.
    pub heating: f64,
    /// Time constant of cooling, s. Assumed.
    pub cooling_time: f64,
}

/// The main spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleParameters {
    /// Highest speed.
    pub highest: Rpm,
    /// Inertia, kg m^2.
    pub inertia: f64,
    /// Highest torque, Nm; counts as 100 % load.
    pub torque: f64,
    /// Highest power, W.
    pub power: f64,
    /// Bearing friction that does not depend on speed, Nm.
    pub friction: f64,
    /// Bearing friction that does, Nm s/rad.
    pub viscous: f64,
    /// Speed counts as reached within this part of the command.
    pub tolerance: f64,
    /// After this time without reaching its speed it is a fault.
    pub time_out: Seconds,
    /// Counts in a turn of its encoder, which also gives an index pulse once a turn; 0 without one: no thread can be cut.
    pub encoder_counts: f64,
    /// How much later than its command it has a speed: time constant of its drive.
    pub response: Seconds,
    /// How fast it is slowed and turned round in a rigid tap, rad/s^2.
    pub reversal: f64,
}

/// A rough cutting force: proportional to path speed while the spindle turns and the path speed is steady and can be a feed. All assumed:
/// the machine does not know the stock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CuttingParameters {
    /// Force against the motion, N for each mm/s of path speed.
    pub force_per_speed: f64,
    /// Highest force, N.
    pub highest_force: f64,
    /// Faster than this is no cut.
    pub fastest_feed: MmPerSec,
    /// Arm at which the force brakes the spindle, m.
    pub arm: f64,
}

impl MachineParameters {
    /// A small vertical machining centre: the published axes, everything else assumed. Travels are wide, so that a program whose work
    /// offset had to be assumed still fits.
    pub fn small_machining_centre() -> Self {
        let x = Mechanics {
            current_gain: 3.1201,
            torque_constant: 0.8910,
            transmission: 1.5915,
            inertia: 3.3177e-3,
            viscous: 0.0192,
            static_friction: [0.648, 0.824],
            coulomb_friction: [0.533, 0.646],
            stribeck_speed: 0.2,
            rated_current: 12.0,
            peak_current: 36.0,
            motor_pulses: 1.0e6,
            backlash: 0.002,
            expansion: 0.004,
            heating: 2.0e-4,
            cooling_time: 1800.0,
        };
        let y = Mechanics {
            inertia: 3.8650e-3,
            viscous: 0.0219,
            static_friction: [0.819, 0.907],
            coulomb_friction: [0.695, 0.874],
            ..x
        };
        let z = Mechanics {
            transmission: 6.3662,
            inertia: 15.974e-3,
            viscous: 0.0041,
            static_friction: [1.041, 0.221],
            coulomb_friction: [0.960, 0.161],
            ..x
        };
        let axis = |mechanics, position, velocity| AxisParameters {
            lowest: Millimetres(-1000.0),
            highest: Millimetres(1000.0),
            v_max: MmPerSec(500.0),
            a_max: MmPerSec2(3000.0),
            j_max: MmPerSec3(50_000.0),
            pulses_per_mm: 1000.0,
            homing: HomingParameters {
                upwards: true,
                search: MmPerSec(50.0),
                slow_search: MmPerSec(2.0),
                reference: Millimetres(990.0),
                home: Millimetres(0.0),
                switch_before: Millimetres(4.0),
                time_out: Seconds(10.0),
            },
            servo: ServoGains {
                position,
                velocity,
                integral_time: 0.04,
                friction_compensation: 0.9,
                breakaway_travel: 0.01,
            },
            mechanics,
        };
        MachineParameters {
            // Published position gains are 102.2, 102.2 and 50, velocity gains 0.1846, 0.2151 and 0.35, integral time 0.12 s. With them this
            // model's velocity loops are no faster than its position loops: damping 0.49, and 0.22 for Z, which rings at a 1 ms cycle. Twice
            // the velocity gain makes X and Y a textbook 0.7; Z gets the same damping and the position gain that all three then share,
            // 160/s, so that they follow a curve alike. The velocity loop is now at 310 rad/s, and an integral time of a dozen of its time
            // constants takes up the force of a cut in 40 ms without rocking it.
            axes: [axis(x, 102.2, 0.37), axis(y, 102.2, 0.43), axis(z, 25.0, 1.8)],
            spindle: SpindleParameters {
                highest: Rpm(24_000.0),
                inertia: 0.004,
                torque: 20.0,
                power: 9000.0,
                friction: 0.3,
                viscous: 2.0e-4,
                tolerance: 0.01,
                time_out: Seconds(20.0),
                encoder_counts: 4096.0,
                response: Seconds(0.04),
                reversal: 1000.0,
            },
            tool_change: Seconds(2.5),
            tool_change_stops_spindle: true,
            position_law: PositionLaw::FeedForward,
            following_warning: Millimetres(0.1),
            following_fault: Millimetres(0.5),
            in_position: Millimetres(0.01),
            in_position_time_out: Seconds(0.2),
            absolute_encoders: true,
            slow_jog: MmPerSec(5.0),
            tool_change_at: None,
            late_ticks_allowed: 5,
            cutting: CuttingParameters {
                force_per_speed: 4.0,
                highest_force: 300.0,
                fastest_feed: MmPerSec(120.0),
                arm: 0.004,
            },
        }
    }

    /// A small lathe with the same drives; its spindle carries a chuck and is slower. All but the drives is assumed.
    pub fn small_lathe() -> Self {
        let mill = Self::small_machining_centre();
        MachineParameters {
            spindle: SpindleParameters {
                highest: Rpm(6000.0),
                inertia: 0.03,
                torque: 80.0,
                power: 15_000.0,
                friction: 1.5,
                viscous: 2.0e-3,
                reversal: 400.0,
                ..mill.spindle
            },
            tool_change: Seconds(0.8),
            tool_change_stops_spindle: false,
            cutting: CuttingParameters {
                force_per_speed: 60.0,
                highest_force: 900.0,
                fastest_feed: MmPerSec(30.0),
                arm: 0.02,
            },
            ..mill
        }
    }

    /// Whether the numbers make a machine: everything finite, what has to be positive is.
    ///
    /// # Errors
    /// The first value that is not usable, by name and axis.
    pub fn check(&self) -> Result<(), ParameterError> {
        for (axis, a) in self.axes.iter().enumerate() {
            let m = &a.mechanics;
            let positive = [
                ("highest - lowest", a.highest.0 - a.lowest.0),
                ("v_max", a.v_max.0),
                ("a_max", a.a_max.0),
                ("j_max", a.j_max.0),
                ("homing.search", a.homing.search.0),
                ("homing.slow_search", a.homing.slow_search.0),
                ("homing.switch_before", a.homing.switch_before.0),
                ("homing.time_out", a.homing.time_out.0),
                ("highest - homing.home", a.highest.0 - a.homing.home.0 + SMALLEST),
                ("homing.home - lowest", a.homing.home.0 - a.lowest.0 + SMALLEST),
                ("pulses_per_mm", a.pulses_per_mm),
                ("servo.velocity", a.servo.velocity),
                ("servo.integral_time", a.servo.integral_time),
                ("servo.breakaway_travel", a.servo.breakaway_travel),
                ("mechanics.current_gain", m.current_gain),
                ("mechanics.torque_constant", m.torque_constant),
                ("mechanics.transmission", m.transmission),
                ("mechanics.inertia", m.inertia),
                ("mechanics.stribeck_speed", m.stribeck_speed),
                ("mechanics.rated_current", m.rated_current),
                ("mechanics.peak_current", m.peak_current),
                ("mechanics.motor_pulses", m.motor_pulses),
                ("mechanics.cooling_time", m.cooling_time),
            ];
            let not_negative = [
                ("servo.position", a.servo.position),
                ("servo.friction_compensation", a.servo.friction_compensation),
                ("mechanics.viscous", m.viscous),
                ("mechanics.static_friction", m.static_friction[0].min(m.static_friction[1])),
                ("mechanics.coulomb_friction", m.coulomb_friction[0].min(m.coulomb_friction[1])),
                ("mechanics.backlash", m.backlash),
                ("mechanics.expansion", m.expansion),
                ("mechanics.heating", m.heating),
            ];
            require(Some(axis as u8), &positive, &not_negative)?;
        }
        let (s, c) = (&self.spindle, &self.cutting);
        let positive = [
            ("spindle.highest", s.highest.0),
            ("spindle.inertia", s.inertia),
            ("spindle.torque", s.torque),
            ("spindle.power", s.power),
            ("spindle.tolerance", s.tolerance),
            ("spindle.time_out", s.time_out.0),
            ("spindle.response", s.response.0),
            ("spindle.reversal", s.reversal),
            ("following_warning", self.following_warning.0),
            ("following_fault", self.following_fault.0),
            ("in_position", self.in_position.0),
            ("slow_jog", self.slow_jog.0),
        ];
        let not_negative = [
            ("spindle.friction", s.friction),
            ("spindle.viscous", s.viscous),
            ("spindle.encoder_counts", s.encoder_counts),
            ("tool_change", self.tool_change.0),
            ("in_position_time_out", self.in_position_time_out.0),
            ("cutting.force_per_speed", c.force_per_speed),
            ("cutting.highest_force", c.highest_force),
            ("cutting.fastest_feed", c.fastest_feed.0),
            ("cutting.arm", c.arm),
        ];
        require(None, &positive, &not_negative)
    }
}

/// A border may be reached: what has to be above 0 is this much more, mm.
const SMALLEST: f64 = 1e-6;

fn require(
    axis: Option<u8>,
    positive: &[(&'static str, f64)],
    not_negative: &[(&'static str, f64)],
) -> Result<(), ParameterError> {
    let bad = |name, value, expected| {
        Err(ParameterError {
            name,
            axis,
            value,
            expected,
        })
    };
    for &(name, value) in positive {
        if !(value > 0.0 && value.is_finite()) {
            return bad(name, value, "above 0");
        }
    }
    for &(name, value) in not_negative {
        if !(value >= 0.0 && value.is_finite()) {
            return bad(name, value, "0 or above");
        }
    }
    Ok(())
}

/// A machine that cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterError {
    /// Which value.
    pub name: &'static str,
    /// Of which axis, 0 is X; `None` when it belongs to no axis.
    pub axis: Option<u8>,
    /// What it is.
    pub value: f64,
    /// What it has to be.
    pub expected: &'static str,
}

impl core::fmt::Display for ParameterError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if let Some(axis) = self.axis {
            write!(f, "axis {}: ", ["X", "Y", "Z"].get(usize::from(axis)).unwrap_or(&"?"))?;
        }
        write!(f, "{} is {}, it has to be {}", self.name, self.value, self.expected)
    }
}
impl core::error::Error for ParameterError {}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;

    #[test]
    fn both_machines_are_sound() {
        assert_eq!(MachineParameters::small_machining_centre().check(), Ok(()));
        assert_eq!(MachineParameters::small_lathe().check(), Ok(()));
    }

    #[test]
    fn a_value_that_makes_no_machine_is_named_with_its_axis() {
        let mut machine = MachineParameters::small_machining_centre();
        machine.axes[1].a_max = MmPerSec2(-1.0);
        let said = machine.check().expect_err("negative").to_string();
        assert_eq!(said, "axis Y: a_max is -1, it has to be above 0");
    }
}

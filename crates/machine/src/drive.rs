//! The border to the drives: what they are told and what they tell, every servo cycle.
//!
//! A driver (the simulated plant, a register card, a field bus) implements [`CyclicDrive`]. Controllers that plan themselves are another
//! kind of driver and not here.

use crate::SpindleCommand;
use units::Tick;

/// Drives that take an order each servo cycle and report back.
pub trait CyclicDrive {
    /// What the drives measure at the beginning of cycle `now`. Called once a cycle, before [`CyclicDrive::order`].
    fn read(&mut self, now: Tick) -> Feedback;

    /// What the drives shall do during cycle `now`.
    ///
    /// A cycle without an order is a late one: the drives go on for a few cycles and then stop by themselves.
    fn order(&mut self, now: Tick, orders: &DriveOrders);
}

/// What the drives are told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveOrders {
    /// What the axis drives do.
    pub mode: DriveMode,
    /// X, Y, Z.
    pub axes: [AxisOrder; 3],
    /// The main spindle.
    pub spindle: SpindleCommand,
    /// Coolant valves.
    pub coolant: crate::CoolantOutlets,
    /// Commanded speed along the path, mm/s: the simulated cut follows it.
    pub path_speed: f64,
}

/// What the axis drives do, in the terms of IEC 61800-7-201 (CiA 402).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveMode {
    /// No power: brakes closed (switch on disabled).
    #[default]
    Off,
    /// Follow the orders (operation enabled).
    Follow,
    /// Brake by yourself to standstill and hold (quick stop active).
    QuickStop,
}

/// What one axis drive is told. A drive uses what its mode needs: cyclic position, velocity or torque.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisOrder {
    /// Target position, mm, as [`Feedback::position`] counts.
    pub position: f64,
    /// Speed from the position loop, feed-forward included, mm/s.
    pub velocity: f64,
    /// The plan's part of that speed, mm/s (CiA 402: velocity offset). Its sign tells the drive when friction turns round.
    pub planned: f64,
    /// Feed-forward torque, Nm at the motor.
    pub torque: f64,
}

/// What the drives tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Feedback {
    /// Position by encoder, mm: in the machine frame when the encoders are absolute ([`crate::MachineParameters::absolute_encoders`]),
    /// else from wherever the axis was at power-on.
    pub position: [f64; 3],
    /// Speed as the drive sees it, mm/s.
    pub velocity: [f64; 3],
    /// Motor torque, percent of rated.
    pub load: [f64; 3],
    /// Motor current, A.
    pub current: [f64; 3],
    /// Spindle speed, rev/min, positive clockwise.
    pub spindle_speed: f64,
    /// Spindle torque, percent of rated.
    pub spindle_load: f64,
    /// Angle of the spindle by its encoder, turns, counted on over whole turns, positive clockwise; `None` without such an encoder.
    pub spindle_angle: Option<f64>,
    /// Where that encoder passed its index pulse since the last cycle, turns, as [`Feedback::spindle_angle`] counts.
    pub spindle_index: Option<f64>,
    /// True where the reference switch of an axis is made.
    pub reference_switch: [bool; 3],
    /// Where the encoder passed its index pulse since the last cycle, mm, as [`Feedback::position`] counts.
    pub index: [Option<f64>; 3],
    /// True while the emergency stop button is pressed or its circuit is open.
    pub emergency_stop: bool,
    /// True when a drive reports a fault of its own.
    pub drive_fault: bool,
}

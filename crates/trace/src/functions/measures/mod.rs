//! The quantities of `get_<x>` and `get_<x>_points`: one file each, with what is measured and both functions.

use crate::sensor::Component;
use crate::unit::Dimension;

pub mod acoustic_emission;
pub mod axial_cutting_depth;
pub mod axis_acceleration;
pub mod axis_displacement;
pub mod axis_speed;
pub mod bearing_acceleration;
pub mod coolant_flow;
pub mod coolant_level;
pub mod coolant_pressure;
pub mod coolant_temperature;
pub mod cutting_speed;
pub mod drive_load;
pub mod encoder_position;
pub mod feedrate;
pub mod interpolated_position;
pub mod machine_force;
pub mod motor_current;
pub mod motor_power;
pub mod motor_torque;
pub mod radial_cutting_depth;
pub mod spindle_acceleration;
pub mod spindle_speed;
pub mod tool_tip_temperature;
pub mod tool_tip_vibration;
pub mod tool_wear;

/// A quantity that can be asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// The `<x>` of `get_<x>`: an alias of the stream's name.
    pub name: &'static str,
    /// Where it is measured.
    pub component: Component,
    /// MTConnect type and subtype.
    pub quantity: &'static str,
    /// What it measures, with the unit of records.
    pub dimension: Dimension,
    /// What a machine without that sensor gives.
    pub without_sensor: &'static str,
}

/// All of them, in the order of the reference.
pub const MEASURES: &[&Measure] = &[
    &cutting_speed::MEASURE,
    &spindle_speed::MEASURE,
    &feedrate::MEASURE,
    &axis_speed::MEASURE,
    &axis_acceleration::MEASURE,
    &bearing_acceleration::MEASURE,
    &spindle_acceleration::MEASURE,
    &axial_cutting_depth::MEASURE,
    &radial_cutting_depth::MEASURE,
    &coolant_pressure::MEASURE,
    &coolant_level::MEASURE,
    &coolant_temperature::MEASURE,
    &coolant_flow::MEASURE,
    &interpolated_position::MEASURE,
    &encoder_position::MEASURE,
    &axis_displacement::MEASURE,
    &motor_current::MEASURE,
    &motor_power::MEASURE,
    &drive_load::MEASURE,
    &machine_force::MEASURE,
    &motor_torque::MEASURE,
    &tool_tip_temperature::MEASURE,
    &tool_tip_vibration::MEASURE,
    &acoustic_emission::MEASURE,
    &tool_wear::MEASURE,
];

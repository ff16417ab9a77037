//! `get_motor_current` and `get_motor_current_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, MOTOR, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "motor_current",
    component: Component::Axis,
    quantity: "AMPERAGE",
    dimension: Dimension::Current,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_motor_current",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, MOTOR],
    doc: "Current of a motor.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_motor_current its_axis=X",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_motor_current_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, MOTOR],
    doc: "Current of a motor: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_motor_current_points its_axis=X number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

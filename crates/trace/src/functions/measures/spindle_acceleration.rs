//! `get_spindle_acceleration` and `get_spindle_acceleration_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE, SPINDLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "spindle_acceleration",
    component: Component::Spindle,
    quantity: "ANGULAR_ACCELERATION",
    dimension: Dimension::AngularAcceleration,
    without_sensor: "the derivative of its speed, quality derived",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_spindle_acceleration",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, SPINDLE],
    doc: "Angular acceleration of the spindle.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_spindle_acceleration",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_spindle_acceleration_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, SPINDLE],
    doc: "Angular acceleration of the spindle: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_spindle_acceleration_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

//! `get_spindle_speed` and `get_spindle_speed_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE, SPINDLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "spindle_speed",
    component: Component::Spindle,
    quantity: "ROTARY_VELOCITY.ACTUAL",
    dimension: Dimension::RotarySpeed,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_spindle_speed",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, SPINDLE],
    doc: "Speed of the spindle.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_spindle_speed",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_spindle_speed_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, SPINDLE],
    doc: "Speed of the spindle: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_spindle_speed_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

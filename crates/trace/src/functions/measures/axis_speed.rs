//! `get_axis_speed` and `get_axis_speed_points`.

use super::Measure;
use crate::functions::{AXIS, Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "axis_speed",
    component: Component::Axis,
    quantity: "AXIS_FEEDRATE.ACTUAL",
    dimension: Dimension::Speed,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_axis_speed",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, AXIS],
    doc: "Speed of an axis.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_axis_speed its_axis=X",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_axis_speed_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, AXIS],
    doc: "Speed of an axis: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_axis_speed_points its_axis=X number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

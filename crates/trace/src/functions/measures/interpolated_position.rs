//! `get_interpolated_position` and `get_interpolated_position_points`.

use super::Measure;
use crate::functions::{AXIS, Block, Call, DIRECTION, Definition, FRAME, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "interpolated_position",
    component: Component::Axis,
    quantity: "POSITION.COMMANDED",
    dimension: Dimension::Length,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_interpolated_position",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, AXIS, FRAME],
    doc: "Position as the control interpolates it, machine frame.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_interpolated_position its_axis=X",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_interpolated_position_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, AXIS, FRAME],
    doc: "Position as the control interpolates it, machine frame: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_interpolated_position_points its_axis=X number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

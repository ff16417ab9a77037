//! `get_axis_displacement` and `get_axis_displacement_points`.

use super::Measure;
use crate::functions::{AXIS, Block, Call, DIRECTION, Definition, FRAME, LOG, POINTS, SINGLE, TOLERANCE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "axis_displacement",
    component: Component::Axis,
    quantity: "DISPLACEMENT",
    dimension: Dimension::Length,
    without_sensor: "computed, quality derived",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_axis_displacement",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, AXIS, FRAME, TOLERANCE],
    doc: "Encoder position minus interpolated position.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_axis_displacement its_axis=X",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path: its tolerance is the distance to the points.
pub const POINTS_OF: Definition = Definition {
    name: "get_axis_displacement_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, AXIS, FRAME],
    doc: "Encoder position minus interpolated position: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_axis_displacement_points its_axis=X number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

//! `get_tool_wear` and `get_tool_wear_points`.

use super::Measure;
use crate::functions::{Block, CRITERION, Call, DIRECTION, Definition, LOG, POINTS, SENSOR_ID, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "tool_wear",
    component: Component::One("TOOL"),
    quantity: "DISPLACEMENT",
    dimension: Dimension::Length,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_tool_wear",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, SENSOR_ID, CRITERION],
    doc: "Wear of the tool.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_tool_wear",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_tool_wear_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, SENSOR_ID, CRITERION],
    doc: "Wear of the tool: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_tool_wear_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

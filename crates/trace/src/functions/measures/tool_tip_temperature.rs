//! `get_tool_tip_temperature` and `get_tool_tip_temperature_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, POINTS, SENSOR_ID, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "tool_tip_temperature",
    component: Component::One("TOOL"),
    quantity: "TEMPERATURE",
    dimension: Dimension::Temperature,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_tool_tip_temperature",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, SENSOR_ID],
    doc: "Temperature at the tool tip.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_tool_tip_temperature",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_tool_tip_temperature_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, SENSOR_ID],
    doc: "Temperature at the tool tip: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_tool_tip_temperature_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

//! `get_coolant_level` and `get_coolant_level_points`.

use super::Measure;
use crate::functions::{Block, CIRCUIT, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "coolant_level",
    component: Component::One("COOLANT"),
    quantity: "FILL_LEVEL",
    dimension: Dimension::Percent,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_coolant_level",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, CIRCUIT],
    doc: "Level in the coolant tank.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_coolant_level",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_coolant_level_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, CIRCUIT],
    doc: "Level in the coolant tank: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_coolant_level_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

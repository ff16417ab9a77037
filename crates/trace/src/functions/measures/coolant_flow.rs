//! `get_coolant_flow` and `get_coolant_flow_points`.

use super::Measure;
use crate::functions::{Block, CIRCUIT, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "coolant_flow",
    component: Component::One("COOLANT"),
    quantity: "FLOW",
    dimension: Dimension::Flow,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_coolant_flow",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, CIRCUIT],
    doc: "Flow of the coolant.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_coolant_flow",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_coolant_flow_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, CIRCUIT],
    doc: "Flow of the coolant: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_coolant_flow_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

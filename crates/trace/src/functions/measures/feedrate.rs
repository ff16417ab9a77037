//! `get_feedrate` and `get_feedrate_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "feedrate",
    component: Component::One("PATH"),
    quantity: "PATH_FEEDRATE.ACTUAL",
    dimension: Dimension::Speed,
    without_sensor: "computed from the axes' speeds, quality derived",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_feedrate",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION],
    doc: "Speed of the tool along the path.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_feedrate",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_feedrate_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION],
    doc: "Speed of the tool along the path: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_feedrate_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

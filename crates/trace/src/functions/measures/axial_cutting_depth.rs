//! `get_axial_cutting_depth` and `get_axial_cutting_depth_points`.

use super::Measure;
use crate::functions::{Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "axial_cutting_depth",
    component: Component::One("PATH"),
    quantity: "AXIAL_CUTTING_DEPTH",
    dimension: Dimension::Length,
    without_sensor: "unavailable (T-05): it takes a simulation of the removal",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_axial_cutting_depth",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION],
    doc: "Depth of the cut along the tool's axis.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_axial_cutting_depth",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_axial_cutting_depth_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION],
    doc: "Depth of the cut along the tool's axis: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_axial_cutting_depth_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

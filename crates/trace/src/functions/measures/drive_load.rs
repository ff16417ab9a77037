//! `get_drive_load` and `get_drive_load_points`.

use super::Measure;
use crate::functions::{AXIS, Block, Call, DIRECTION, Definition, LOG, POINTS, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "drive_load",
    component: Component::Axis,
    quantity: "LOAD",
    dimension: Dimension::Percent,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_drive_load",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, AXIS],
    doc: "Load of a drive, of its rated torque.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_drive_load its_axis=X",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_drive_load_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, AXIS],
    doc: "Load of a drive, of its rated torque: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_drive_load_points its_axis=X number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

//! `get_acoustic_emission` and `get_acoustic_emission_points`.

use super::Measure;
use crate::functions::{BAND, Block, Call, DIRECTION, Definition, LOG, POINTS, SENSOR_ID, SINGLE};
use crate::sensor::Component;
use crate::unit::Dimension;

/// What is measured.
pub const MEASURE: Measure = Measure {
    name: "acoustic_emission",
    component: Component::One("TOOL"),
    quantity: "SOUND_LEVEL",
    dimension: Dimension::Level,
    without_sensor: "unavailable (T-05)",
};

/// One value.
pub const GET: Definition = Definition {
    name: "get_acoustic_emission",
    also: &[],
    block: Block::Sensors,
    groups: &[SINGLE, DIRECTION, SENSOR_ID, BAND],
    doc: "Acoustic emission of the cut; one value each cycle.",
    record: "value with unit and quality, cycle",
    example: "trace:1 get_acoustic_emission",
    is_action: true,
    measure: Some(&MEASURE),
    call: |given| Call::Get(given.measurement(&MEASURE)),
};

/// Values along a path.
pub const POINTS_OF: Definition = Definition {
    name: "get_acoustic_emission_points",
    also: &[],
    block: Block::Sensors,
    groups: &[POINTS, LOG, DIRECTION, SENSOR_ID, BAND],
    doc: "Acoustic emission of the cut; one value each cycle: a bounded number of values along what follows.",
    record: "samples with unit, quality and context; points that were missed",
    example: "trace:1 get_acoustic_emission_points number_of_points=100",
    is_action: false,
    measure: Some(&MEASURE),
    call: |given| Call::GetPoints(given.measurement(&MEASURE)),
};

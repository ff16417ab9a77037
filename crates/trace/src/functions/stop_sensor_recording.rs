//! `stop_sensor_recording`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "stop_sensor_recording",
    also: &[],
    block: Block::Sensors,
    groups: &[&[required("its_function_id", Kind::Text, "as at its start")], LOG],
    doc: "Ends start_sensor_recording.",
    record: "samples taken and lost",
    example: "trace:1 stop_sensor_recording its_function_id=1",
    is_action: false,
    measure: None,
    call: |given| Call::StopSensorRecording {
        id: given.id("its_function_id"),
    },
};

//! `read_sensor_value`.

use super::{Block, Call, Definition, REQUIRED, SINGLE, key, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "read_sensor_value",
    also: &[],
    block: Block::Sensors,
    groups: &[
        &[
            required("its_sensor", Kind::Text, "a stream as X.LOAD, or an alias as drive_load"),
            key("its_axes", Kind::List, "axes, where the name has none"),
        ],
        SINGLE,
        REQUIRED,
    ],
    doc: "One sample of a sensor.",
    record: "value with unit and quality, cycle",
    example: "trace:1 read_sensor_value its_sensor=drive_load its_axes=X,Y,Z",
    is_action: true,
    measure: None,
    call: |given| Call::ReadSensorValue {
        sensor: given.text("its_sensor").unwrap_or_default(),
        axes: given.list("its_axes"),
    },
};

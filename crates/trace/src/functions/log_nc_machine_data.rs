//! `log_nc_machine_data`.

use super::{Block, Call, Definition, LOG, key};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_nc_machine_data",
    also: &[],
    block: Block::General,
    groups: &[
        &[key("its_items", Kind::List, "names of items; none is the standard set")],
        LOG,
    ],
    doc: "Which machine this is. Written at the start of every job too.",
    record: "brand, model, serial number, control and its version, axes, kinematics, work offsets",
    example: "trace:1 log_nc_machine_data its_items=serial_number,model",
    is_action: true,
    measure: None,
    call: |given| Call::LogNcMachineData {
        items: given.list("its_items"),
    },
};

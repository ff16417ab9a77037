//! `get_execution_time`.

use super::{Block, Call, Definition, SINGLE, key};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "get_execution_time",
    also: &[],
    block: Block::General,
    groups: &[
        &[key(
            "its_executable",
            Kind::Text,
            "name or #entity of what was executed; by default the last completed workingstep",
        )],
        SINGLE,
    ],
    doc: "How long something took. The variable gets seconds.",
    record: "begin, end, duration in s, time in the cut in s (from feed motion, estimated)",
    example: "trace:1 get_execution_time its_executable=roughing",
    is_action: true,
    measure: None,
    call: |given| Call::GetExecutionTime {
        executable: given.text("its_executable"),
    },
};

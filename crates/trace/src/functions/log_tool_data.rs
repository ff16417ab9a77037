//! `log_tool_data`.

use super::{Block, Call, Definition, LOG, key};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_tool_data",
    also: &[],
    block: Block::General,
    groups: &[
        &[key(
            "its_tool",
            Kind::Text,
            "number of the tool; by default the one in the spindle",
        )],
        LOG,
    ],
    doc: "What the tool table holds of a tool.",
    record: "tool, length, radius, wear offsets in mm, asset, what differs from the plan",
    example: "trace:1 log_tool_data",
    is_action: true,
    measure: None,
    call: |given| Call::LogToolData {
        tool: given.text("its_tool"),
    },
};

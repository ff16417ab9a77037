//! `stop_tool_logging`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "stop_tool_logging",
    also: &[],
    block: Block::General,
    groups: &[&[required("its_function_id", Kind::Text, "as at its start")], LOG],
    doc: "Ends start_tool_logging.",
    record: "changes recorded",
    example: "trace:1 stop_tool_logging its_function_id=T1",
    is_action: false,
    measure: None,
    call: |given| Call::StopToolLogging {
        id: given.id("its_function_id"),
    },
};

//! `start_tool_logging`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "start_tool_logging",
    also: &[],
    block: Block::General,
    groups: &[&[required("its_function_id", Kind::Text, "names it, for its stop")], LOG],
    doc: "Records the tool at every tool change from here on.",
    record: "as log_tool_data, at each change",
    example: "trace:1 start_tool_logging its_function_id=T1",
    is_action: false,
    measure: None,
    call: |given| Call::StartToolLogging {
        id: given.id("its_function_id"),
    },
};

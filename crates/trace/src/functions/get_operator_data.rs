//! `get_operator_data`.

use super::{Block, Call, Definition, LOG};

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "get_operator_data",
    also: &[],
    block: Block::General,
    groups: &[LOG],
    doc: "Who is signed in now.",
    record: "name, role, level, how the person was identified",
    example: "trace:1 get_operator_data",
    is_action: true,
    measure: None,
    call: |_| Call::GetOperatorData,
};

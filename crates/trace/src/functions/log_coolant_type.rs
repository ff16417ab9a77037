//! `log_coolant_type`.

use super::{Block, Call, Definition, LOG};

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_coolant_type",
    also: &[],
    block: Block::General,
    groups: &[LOG],
    doc: "Which coolant is in the machine: a declaration, no measurement.",
    record: "product and kind, quality declared",
    example: "trace:1 log_coolant_type",
    is_action: true,
    measure: None,
    call: |_| Call::LogCoolantType,
};

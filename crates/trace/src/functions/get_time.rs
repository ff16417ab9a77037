//! `get_time`.

use super::{Block, Call, Definition, SINGLE, key};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "get_time",
    also: &[],
    block: Block::General,
    groups: &[
        &[key("its_label", Kind::Text, "what the moment is called in the record")],
        SINGLE,
    ],
    doc: "The present moment. The variable gets milliseconds since 1970-01-01 UTC.",
    record: "moment, milliseconds since the program began",
    example: "trace:1 get_time its_label=\"first part\"",
    is_action: true,
    measure: None,
    call: |given| Call::GetTime {
        label: given.text("its_label"),
    },
};

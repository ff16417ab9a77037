//! `log_event`.

use super::{Block, Call, Definition, LOG, key, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_event",
    also: &[],
    block: Block::General,
    groups: &[
        &[
            required("its_kind", Kind::Text, "the kind, a word of your own"),
            key("its_text", Kind::Text, "a sentence"),
            key("its_values", Kind::List, "NC variables whose values are recorded"),
        ],
        LOG,
    ],
    doc: "Writes an event of your own into the log.",
    record: "kind, text, values",
    example: "trace:1 log_event its_kind=clamped its_text=\"second clamping\"",
    is_action: true,
    measure: None,
    call: |given| Call::LogEvent {
        kind: given.text("its_kind").unwrap_or_default(),
        text: given.text("its_text"),
        values: given.list("its_values"),
    },
};

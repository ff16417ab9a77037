//! `display_message`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "display_message",
    also: &[],
    block: Block::General,
    groups: &[&[required("its_text", Kind::Text, "what the operator reads")], LOG],
    doc: "A text for the operator; the standard's own function, written here as an action.",
    record: "text",
    example: "trace:1 display_message its_text=\"check the chips\"",
    is_action: true,
    measure: None,
    call: |given| Call::DisplayMessage {
        text: given.text("its_text").unwrap_or_default(),
    },
};

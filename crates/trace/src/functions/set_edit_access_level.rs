//! `set_edit_access_level`.

use super::{Block, Call, Definition, LOG, key};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "set_edit_access_level",
    also: &["set_authorization_level", "set_edit_acces_level"],
    block: Block::General,
    groups: &[
        &[
            key(
                "its_level",
                Kind::Integer(1, 10),
                "1 is the highest; left out: back to the default",
            ),
            key(
                "its_scope",
                Kind::Word(&["rest_of_program", "workplan"]),
                "how far it holds; by default rest_of_program",
            ),
        ],
        LOG,
    ],
    doc: "Which level an operator needs to edit what follows.",
    record: "old and new level, what it covers",
    example: "trace:1 set_edit_access_level its_level=3",
    is_action: false,
    measure: None,
    call: |given| Call::SetEditAccessLevel {
        level: given.integer("its_level").and_then(|level| u8::try_from(level).ok()),
        workplan_only: given.word("its_scope") == Some("workplan"),
    },
};

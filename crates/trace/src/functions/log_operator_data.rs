//! `log_operator_data`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_operator_data",
    also: &[],
    block: Block::General,
    groups: &[
        &[
            required("its_function_id", Kind::Text, "names it, for OFF"),
            required("its_state", Kind::State, "on or off"),
        ],
        LOG,
    ],
    doc: "Records the operator now and at every sign-in from here on.",
    record: "as get_operator_data",
    example: "trace:1 log_operator_data its_function_id=P1 its_state=ON",
    is_action: false,
    measure: None,
    call: |given| Call::LogOperatorData {
        id: given.id("its_function_id"),
        on: given.state("its_state"),
    },
};

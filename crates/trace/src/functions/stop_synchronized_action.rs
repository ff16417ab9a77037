//! `stop_synchronized_action`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "stop_synchronized_action",
    also: &[],
    block: Block::SynchronizedActions,
    groups: &[&[required("its_id", Kind::Text, "as at its start")], LOG],
    doc: "Ends start_synchronized_action.",
    record: "how often it fired",
    example: "trace:1 stop_synchronized_action its_id=1",
    is_action: false,
    measure: None,
    call: |given| Call::StopSynchronizedAction { id: given.id("its_id") },
};

//! `log_nc_events`.

use super::{Block, Call, Definition, LOG, key, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_nc_events",
    also: &[],
    block: Block::General,
    groups: &[
        &[
            required("its_function_id", Kind::Text, "names it, for OFF"),
            required("its_state", Kind::State, "on or off"),
            key("its_kinds", Kind::List, "kinds of events (below); none is all of them"),
        ],
        LOG,
    ],
    doc: "Records the control's own events from here on: states, stops, holds, overrides, alarms.",
    record: "kind and data of each event",
    example: "trace:1 log_nc_events its_function_id=E1 its_state=ON its_kinds=hold,cycle-start",
    is_action: false,
    measure: None,
    call: |given| Call::LogNcEvents {
        id: given.id("its_function_id"),
        on: given.state("its_state"),
        kinds: given.list("its_kinds"),
    },
};

//! `clear_alarm`.

use super::{Block, Call, Definition, LOG, required};
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "clear_alarm",
    also: &[],
    block: Block::General,
    groups: &[&[required("its_alarm_id", Kind::Integer(1, 999), "its number")], LOG],
    doc: "Ends an alarm. One that is not active is a warning (T-03).",
    record: "number, how long it was active in s",
    example: "trace:1 clear_alarm its_alarm_id=1",
    is_action: true,
    measure: None,
    call: |given| Call::ClearAlarm {
        id: given.small("its_alarm_id"),
    },
};

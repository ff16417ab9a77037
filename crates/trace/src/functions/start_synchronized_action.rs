//! `start_synchronized_action`.

use super::TraceId;
use super::{Block, Call, Definition, LOG, key, required};
use crate::function::Function;
use crate::value::Kind;
use plan::Expression;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "start_synchronized_action",
    also: &[],
    block: Block::SynchronizedActions,
    groups: &[
        &[
            required("its_id", Kind::Text, "names it, for its stop"),
            required(
                "its_mode_scope",
                Kind::Word(&["AUTOMATIC", "ALL"]),
                "AUTOMATIC ends with the program, ALL goes on in every mode",
            ),
            key(
                "its_frequency",
                Kind::Word(&["NONE", "WHENEVER", "FROM", "WHEN", "EVERY"]),
                "when the actions are done; left out is NONE: every cycle",
            ),
            key("its_condition", Kind::Condition, "what is checked every cycle"),
            required("its_actions", Kind::Actions, "functions, each in quotes"),
        ],
        LOG,
    ],
    doc: "Checks a condition every servo cycle from here on and does its actions.",
    record: "each firing: cycle, actions, values",
    example: "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"ws_time > 3600 s\" its_actions=\"read_sensor_value its_sensor=position its_axes=X,Y,Z\",\"set_alarm its_alarm_id=1 its_text=over_time\"",
    is_action: false,
    measure: None,
    call: |given| {
        Call::StartSynchronizedAction(SynchronizedAction {
            id: given.id("its_id"),
            all_modes: given.word("its_mode_scope") == Some("ALL"),
            frequency: match given.word("its_frequency") {
                Some("WHENEVER") => Frequency::Whenever,
                Some("FROM") => Frequency::From,
                Some("WHEN") => Frequency::When,
                Some("EVERY") => Frequency::Every,
                _ => Frequency::None,
            },
            condition: given.condition("its_condition"),
            actions: given.actions("its_actions"),
        })
    },
};

/// A condition with what is done about it.
#[derive(Clone, Debug, PartialEq)]
pub struct SynchronizedAction {
    /// Its name.
    pub id: TraceId,
    /// It goes on in every mode of the machine; else it ends with the program.
    pub all_modes: bool,
    /// When the actions are done.
    pub frequency: Frequency,
    /// What is checked; `None` with [`Frequency::None`] only.
    pub condition: Option<Expression>,
    /// What is done, in order.
    pub actions: Vec<Function>,
}

/// When the actions of a condition are done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frequency {
    /// No condition: every cycle.
    #[default]
    None,
    /// Every cycle in which the condition is true.
    Whenever,
    /// From the first such cycle on, every cycle.
    From,
    /// In the first such cycle, once.
    When,
    /// Each time the condition becomes true.
    Every,
}

impl Frequency {
    /// The word of `its_frequency`.
    pub const fn word(self) -> &'static str {
        match self {
            Frequency::None => "NONE",
            Frequency::Whenever => "WHENEVER",
            Frequency::From => "FROM",
            Frequency::When => "WHEN",
            Frequency::Every => "EVERY",
        }
    }
}

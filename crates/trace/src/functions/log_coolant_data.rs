//! `log_coolant_data`.

use super::{Block, Call, Definition, LOG, key};
use crate::unit::Dimension;
use crate::value::Kind;

/// Its row of the table.
pub const FUNCTION: Definition = Definition {
    name: "log_coolant_data",
    also: &[],
    block: Block::General,
    groups: &[
        &[
            key("product", Kind::Text, "what it is called"),
            key("its_kind", Kind::Text, "emulsion, oil, ..."),
            key("concentration", Kind::Number(Dimension::Percent), "share of concentrate"),
            key("ph", Kind::Number(Dimension::None), "pH"),
            key("batch", Kind::Text, "batch"),
            key("filled", Kind::Moment, "when it was filled, RFC 3339"),
        ],
        LOG,
    ],
    doc: "Data of the coolant: what the line declares, else what the operator entered.",
    record: "product, kind, concentration in %, pH, batch, quality declared",
    example: "trace:1 log_coolant_data product=\"Blaser B\" concentration=8% ph=9.1 batch=K17",
    is_action: true,
    measure: None,
    call: |given| {
        Call::LogCoolantData(Coolant {
            product: given.text("product"),
            kind: given.text("its_kind"),
            concentration: given.number("concentration"),
            ph: given.number("ph"),
            batch: given.text("batch"),
            filled: given.text("filled"),
        })
    },
};

/// What a line declares of the coolant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coolant {
    /// What it is called.
    pub product: Option<String>,
    /// Emulsion, oil.
    pub kind: Option<String>,
    /// Share of concentrate, %.
    pub concentration: Option<f64>,
    /// pH.
    pub ph: Option<f64>,
    /// Batch.
    pub batch: Option<String>,
    /// When it was filled.
    pub filled: Option<String>,
}

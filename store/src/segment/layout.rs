//! Layouts: what columns a recording has. A record of samples, a wider one of many sensors, a table of observations.

use crate::record::schema;
use arrow_schema::{DataType, Field, Schema, SchemaRef, TimeUnit};
use machine::CHANNELS;
use std::collections::HashMap;
use std::sync::Arc;

/// A column.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub holds: Holds,
    /// May a value be missing?
    pub nullable: bool,
}

/// What a column holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Holds {
    /// A time, microseconds UTC.
    Time,
    /// A large whole number: a tick, a sequence.
    Count,
    /// A whole number.
    Number,
    /// One of a few words or states, as a small number.
    State,
    /// A reading as an integer: `value = raw * scale + offset`.
    Reading {
        /// Its unit, in MTConnect's words.
        unit: String,
        /// One quantum.
        scale: f64,
        /// The value of raw 0.
        offset: f64,
    },
    /// A number as it came, where no scale is known.
    Value,
    /// One of few texts, again and again.
    Word,
    /// Any text.
    Text,
}

impl Column {
    /// A column that always has a value.
    pub fn new(name: &str, holds: Holds) -> Column {
        Column {
            name: name.to_owned(),
            holds,
            nullable: false,
        }
    }

    /// The same, where a value may be missing.
    pub fn nullable(mut self) -> Column {
        self.nullable = true;
        self
    }

    /// A reading; null is unavailable.
    pub fn reading(name: &str, unit: &str, scale: f64, offset: f64) -> Column {
        let unit = unit.to_owned();
        Column::new(name, Holds::Reading { unit, scale, offset }).nullable()
    }

    fn field(&self) -> Field {
        let data_type = match &self.holds {
            Holds::Time => DataType::Timestamp(TimeUnit::Microsecond, Some("UTC".into())),
            Holds::Count => DataType::Int64,
            Holds::Number | Holds::Reading { .. } => DataType::Int32,
            Holds::State => DataType::UInt8,
            Holds::Value => DataType::Float64,
            Holds::Word => DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8)),
            Holds::Text => DataType::Utf8,
        };
        let field = Field::new(&self.name, data_type, self.nullable);
        match &self.holds {
            Holds::Reading { unit, scale, offset } => field.with_metadata(HashMap::from([
                (schema::key::UNIT.to_owned(), unit.clone()),
                (schema::key::SCALE.to_owned(), scale.to_string()),
                (schema::key::OFFSET.to_owned(), offset.to_string()),
            ])),
            _ => field,
        }
    }
}

/// The columns of a recording, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// The columns.
    pub columns: Vec<Column>,
}

impl Layout {
    /// A record of samples: time, tick, step, workingstep, tool, phase and quality, then readings. [`crate::record::Reader`] reads it,
    /// whatever the readings are.
    pub fn samples(readings: impl IntoIterator<Item = Column>) -> Layout {
        let mut columns = vec![
            Column::new(schema::TS, Holds::Time),
            Column::new(schema::TICK, Holds::Count),
            Column::new(schema::STEP, Holds::Number),
            Column::new(schema::WORKINGSTEP, Holds::Number),
            Column::new(schema::TOOL, Holds::Number),
            Column::new(schema::PHASE, Holds::State),
            Column::new(schema::QUALITY, Holds::State),
        ];
        columns.extend(readings);
        Layout { columns }
    }

    /// What our own machine reports: `machine::CHANNELS`.
    pub fn machine() -> Layout {
        let readings = CHANNELS.iter().map(|c| Column::reading(c.name, c.unit, c.scale, 0.0));
        Layout::samples(readings)
    }

    /// What an MTConnect agent reports: one row an observation.
    pub fn observations() -> Layout {
        Layout {
            columns: vec![
                Column::new(schema::TS, Holds::Time),
                Column::new("sequence", Holds::Count),
                Column::new("data_item", Holds::Word),
                Column::new("type", Holds::Word),
                Column::new("value", Holds::Value).nullable(),
                Column::new("text", Holds::Text).nullable(),
                Column::new("condition", Holds::Word).nullable(),
            ],
        }
    }

    /// As Arrow has it.
    pub fn schema(&self) -> SchemaRef {
        Arc::new(Schema::new(self.columns.iter().map(Column::field).collect::<Vec<_>>()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layout_of_our_machine_is_the_schema_of_a_record() {
        assert_eq!(Layout::machine().schema(), schema::arrow_schema());
    }
}

//! Observations of other people's machines as a table: one row an observation, in the order of the agent's numbers, gaps among them.
//!
//! The columns are plain text where the standard has words, so that any tool reads them; `value` is the text as a number where it is one.
//! A gap is a row whose category is `GAP`: its sequence is the first missing one, its type the cause, its text the rest as JSON.

use crate::segment::{Column, Holds, Layout};
use crate::{StoreError, Table};
use arrow_array::cast::AsArray;
use arrow_array::types::{Int32Type, Int64Type, TimestampMicrosecondType};
use arrow_array::{Array, ArrayRef, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray, TimestampMicrosecondArray};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use units::Timestamp;

/// The category of a row that is a gap.
pub const GAP: &str = "GAP";

/// The columns that always hold a text, in order.
const TEXTS: [&str; 10] = [
    "device",
    "device_uuid",
    "component",
    "component_name",
    "component_id",
    "data_item",
    "name",
    "type",
    "sub_type",
    "category",
];
/// The columns that may hold one.
const MAYBE: [&str; 3] = ["text", "condition", "attributes"];

/// A row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row<'a> {
    /// When it was true.
    pub at: Timestamp,
    /// The agent's number.
    pub sequence: u64,
    /// Which start of the agent: its `instanceId`.
    pub instance: u64,
    /// Device, its unique id, component, its name and id, data item, its name, type, sub-type, category.
    pub texts: [Cow<'a, str>; 10],
    /// As the agent wrote it; `None` is UNAVAILABLE.
    pub text: Option<Cow<'a, str>>,
    /// Level of a condition.
    pub condition: Option<Cow<'a, str>>,
    /// Its other attributes.
    pub attributes: Option<Cow<'a, str>>,
}

/// How far a recording of an agent is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reached {
    /// Which start of the agent: its `instanceId`.
    pub instance: u64,
    /// The sequence number to ask for next.
    pub next: u64,
    /// Time of the last observation recorded.
    pub last: Option<Timestamp>,
}

impl Reached {
    /// Where a recording goes on behind a row.
    pub fn after(row: &Row<'_>) -> Reached {
        // A gap's row has the first missing number; how far it goes is in its text. To an unknown end: the agent was started anew.
        let to = row.text.as_deref().filter(|_| row.texts[9] == GAP);
        let to = to.and_then(|text| serde_json::from_str::<serde_json::Value>(text).ok());
        let next = match to {
            Some(said) => said["to_sequence"].as_u64().map_or(row.sequence, |to| to + 1),
            None => row.sequence + 1,
        };
        Reached {
            instance: row.instance,
            next,
            last: Some(row.at),
        }
    }
}

/// The columns.
pub fn layout() -> Layout {
    let mut columns = vec![
        Column::new("ts", Holds::Time),
        // Nanoseconds beyond the microsecond of `ts`.
        Column::new("ns", Holds::Number),
        Column::new("sequence", Holds::Count),
        Column::new("instance", Holds::Count),
    ];
    columns.extend(TEXTS.map(|name| Column::new(name, Holds::Text)));
    columns.push(Column::new("value", Holds::Value).nullable());
    columns.extend(MAYBE.map(|name| Column::new(name, Holds::Text).nullable()));
    Layout { columns }
}

/// Rows as columns.
///
/// # Errors
/// A number is beyond what a column holds.
pub fn batch(rows: &[Row<'_>], path: &Path) -> Result<RecordBatch, StoreError> {
    let unwritable = |what: String| StoreError::Unwritable {
        path: path.to_owned(),
        what,
    };
    let count = |of: fn(&Row<'_>) -> u64| -> Result<ArrayRef, StoreError> {
        let numbers: Result<Vec<i64>, _> = rows.iter().map(|r| i64::try_from(of(r))).collect();
        Ok(Arc::new(Int64Array::from(numbers.map_err(|e| unwritable(e.to_string()))?)))
    };
    let times: Vec<i64> = rows.iter().map(|r| r.at.micros()).collect();
    let rest: Vec<i32> = rows.iter().map(|r| r.at.0.rem_euclid(1000) as i32).collect();
    let mut columns: Vec<ArrayRef> = vec![
        Arc::new(TimestampMicrosecondArray::from(times).with_timezone("UTC")),
        Arc::new(Int32Array::from(rest)),
        count(|r| r.sequence)?,
        count(|r| r.instance)?,
    ];
    for k in 0..TEXTS.len() {
        columns.push(Arc::new(StringArray::from_iter_values(rows.iter().map(|r| &*r.texts[k]))));
    }
    let value = |r: &Row<'_>| r.text.as_ref().and_then(|t| t.parse::<f64>().ok()).filter(|v| v.is_finite());
    columns.push(Arc::new(Float64Array::from_iter(rows.iter().map(value))));
    columns.push(Arc::new(StringArray::from_iter(rows.iter().map(|r| r.text.as_deref()))));
    columns.push(Arc::new(StringArray::from_iter(rows.iter().map(|r| r.condition.as_deref()))));
    columns.push(Arc::new(StringArray::from_iter(rows.iter().map(|r| r.attributes.as_deref()))));
    RecordBatch::try_new(layout().schema(), columns).map_err(|e| unwritable(e.to_string()))
}

/// The rows of columns.
///
/// # Errors
/// They are others: what is missing.
pub fn rows(batch: &RecordBatch) -> Result<Vec<Row<'static>>, String> {
    let column = |name: &str| batch.column_by_name(name).ok_or(format!("it has no column {name}"));
    let wrong = |name: &str| format!("its column {name} holds something else");
    let ts = column("ts")?;
    let ts = ts.as_primitive_opt::<TimestampMicrosecondType>().ok_or_else(|| wrong("ts"))?;
    let ns = column("ns")?.as_primitive_opt::<Int32Type>().ok_or_else(|| wrong("ns"))?;
    let sequence = column("sequence")?
        .as_primitive_opt::<Int64Type>()
        .ok_or_else(|| wrong("sequence"))?;
    let instance = column("instance")?
        .as_primitive_opt::<Int64Type>()
        .ok_or_else(|| wrong("instance"))?;
    let string = |name: &str| column(name)?.as_string_opt::<i32>().ok_or_else(|| wrong(name));
    let texts = TEXTS.iter().map(|name| string(name)).collect::<Result<Vec<_>, _>>()?;
    let maybe = MAYBE.iter().map(|name| string(name)).collect::<Result<Vec<_>, _>>()?;
    let optional = |k: usize, row: usize| maybe[k].is_valid(row).then(|| maybe[k].value(row).to_owned().into());
    let row = |k: usize| Row {
        at: Timestamp(ts.value(k).saturating_mul(1000).saturating_add(ns.value(k).into())),
        sequence: sequence.value(k).unsigned_abs(),
        instance: instance.value(k).unsigned_abs(),
        texts: std::array::from_fn(|c| texts[c].value(k).to_owned().into()),
        text: optional(0, k),
        condition: optional(1, k),
        attributes: optional(2, k),
    };
    Ok((0..batch.num_rows()).map(row).collect())
}

/// True for a Parquet file of observations; false for any other table of ours.
pub fn is_of_observations(table: &Table) -> bool {
    ["sequence", "instance", "data_item", "category"]
        .iter()
        .all(|name| table.schema().column_with_name(name).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_as_they_were() {
        let row = |sequence, text: Option<&'static str>| Row {
            at: Timestamp(-1_234_567),
            sequence,
            instance: 7,
            texts: TEXTS.map(Cow::Borrowed),
            text: text.map(Cow::Borrowed),
            condition: None,
            attributes: Some("nativeCode=\"1\"".into()),
        };
        let all = [row(1, Some("1.5")), row(2, None), row(3, Some("a b"))];
        let batch = batch(&all, Path::new("f")).expect("it fits");
        assert_eq!(rows(&batch).expect("the same columns"), all);
        let values = batch.column_by_name("value").expect("a column").null_count();
        assert_eq!(values, 2);
        assert!(self::batch(&[row(u64::MAX, None)], Path::new("f")).is_err());
    }
}

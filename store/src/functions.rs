//! What functions of a program recorded: one row a value, long and narrow, because each recording has streams and times of its own.
//!
//! Rows go through a [`crate::segment::Recorder`] while the job runs and become `functions.parquet` in its folder. A row says when, which
//! run of which recording, which stream with its unit, the value (null is unavailable), its quality, and the step, workingstep and tool
//! it belongs to. Values taken for `count:` come at the end of their recording.

use crate::segment::{Column, Holds, Layout, Rows};
use crate::{StoreError, Table};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int32Type, Int64Type};
use arrow_array::{Array, ArrayRef, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray, TimestampMicrosecondArray};
use arrow_schema::SchemaRef;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use units::{StepId, Tick, Timestamp, ToolNumber, WorkingstepId};

/// The file in a job's folder.
pub const FILE: &str = "functions.parquet";

/// A stream of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamName {
    /// Which run of the function: ids may come again.
    pub run: u32,
    /// The recording's id.
    pub recording: String,
    /// The stream, as `X.LOAD`.
    pub stream: String,
    /// Its unit, in MTConnect's words; empty for a plain number.
    pub unit: String,
    /// Worked out of others, not measured.
    pub derived: bool,
}

/// A value on its way to the disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FunctionRow {
    /// The cycle.
    pub tick: Tick,
    /// Place of its stream in [`Streams`].
    pub stream: u32,
    /// The value; not-a-number is unavailable.
    pub value: f64,
    /// What the machine's measurements are worth.
    pub quality: machine::Quality,
    /// The step in execution.
    pub step: StepId,
    /// The workingstep in execution.
    pub workingstep: WorkingstepId,
    /// The tool in the spindle.
    pub tool: ToolNumber,
}

/// The streams that rows speak of, known to both sides of the recording.
#[derive(Clone, Debug, Default)]
pub struct Streams(Arc<Mutex<BTreeMap<u32, StreamName>>>);

impl Streams {
    /// Makes sure that the stream with a number is known. They come in any order: a recording of points may have its first value long
    /// after those that began behind it.
    pub fn know(&self, number: u32, name: impl FnOnce() -> StreamName) {
        let mut names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        names.entry(number).or_insert_with(name);
    }

    fn of(&self, number: u32) -> Option<StreamName> {
        let names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        names.get(&number).cloned()
    }
}

/// Gathers values for a segment.
pub struct FunctionRows {
    start: Timestamp,
    path: PathBuf,
    streams: Streams,
    schema: SchemaRef,
    rows: Vec<(FunctionRow, StreamName)>,
}

impl FunctionRows {
    /// For a machine whose tick 0 was at `start`; `path` is what messages call the file.
    pub fn new(start: Timestamp, path: &Path, streams: Streams) -> FunctionRows {
        FunctionRows {
            start,
            path: path.to_owned(),
            streams,
            schema: layout().schema(),
            rows: Vec::new(),
        }
    }
}

/// The columns.
pub fn layout() -> Layout {
    Layout {
        columns: vec![
            Column::new("ts", Holds::Time),
            Column::new("tick", Holds::Count),
            Column::new("run", Holds::Number),
            Column::new("recording", Holds::Text),
            Column::new("stream", Holds::Text),
            Column::new("unit", Holds::Text),
            Column::new("value", Holds::Value).nullable(),
            Column::new("quality", Holds::Text),
            Column::new("step", Holds::Number),
            Column::new("workingstep", Holds::Number),
            Column::new("tool", Holds::Number),
        ],
    }
}

/// In words, as the records of functions say it.
fn quality(row: &FunctionRow, derived: bool) -> &'static str {
    match (row.quality, row.value.is_nan(), derived) {
        (_, true, _) | (machine::Quality::Unavailable, ..) => "unavailable",
        (machine::Quality::Simulated, _, true) => "simulated, derived",
        (machine::Quality::Simulated, ..) => "simulated",
        (machine::Quality::Stale, ..) => "stale",
        (machine::Quality::Good, _, true) => "derived",
        (machine::Quality::Good, ..) => "ok",
    }
}

impl Rows for FunctionRows {
    type Row = FunctionRow;

    fn number(row: &FunctionRow) -> u64 {
        row.tick.0
    }
    fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }
    fn push(&mut self, row: &FunctionRow) -> Result<(), StoreError> {
        let name = self.streams.of(row.stream).ok_or_else(|| StoreError::Unwritable {
            path: self.path.clone(),
            what: format!("stream {} of a recording has no name", row.stream),
        })?;
        self.rows.push((*row, name));
        Ok(())
    }
    fn len(&self) -> usize {
        self.rows.len()
    }
    fn take(&mut self) -> Result<RecordBatch, StoreError> {
        let rows = std::mem::take(&mut self.rows);
        let unwritable = |what: String| StoreError::Unwritable {
            path: self.path.clone(),
            what,
        };
        let times: Vec<i64> = rows.iter().map(|(r, _)| self.start.at(r.tick).micros()).collect();
        let ticks: Result<Vec<i64>, _> = rows.iter().map(|(r, _)| i64::try_from(r.tick.0)).collect();
        let ticks = ticks.map_err(|e| unwritable(e.to_string()))?;
        let number = |of: &dyn Fn(&(FunctionRow, StreamName)) -> u32| -> Result<ArrayRef, StoreError> {
            let numbers: Result<Vec<i32>, _> = rows.iter().map(|r| i32::try_from(of(r))).collect();
            Ok(Arc::new(Int32Array::from(numbers.map_err(|e| unwritable(e.to_string()))?)))
        };
        let columns: Vec<ArrayRef> = vec![
            Arc::new(TimestampMicrosecondArray::from(times).with_timezone("UTC")),
            Arc::new(Int64Array::from(ticks)),
            number(&|(_, n)| n.run)?,
            Arc::new(StringArray::from_iter_values(rows.iter().map(|(_, n)| &n.recording))),
            Arc::new(StringArray::from_iter_values(rows.iter().map(|(_, n)| &n.stream))),
            Arc::new(StringArray::from_iter_values(rows.iter().map(|(_, n)| &n.unit))),
            Arc::new(Float64Array::from_iter(
                rows.iter().map(|(r, _)| (!r.value.is_nan()).then_some(r.value)),
            )),
            Arc::new(StringArray::from_iter_values(rows.iter().map(|(r, n)| quality(r, n.derived)))),
            number(&|(r, _)| r.step.0)?,
            number(&|(r, _)| r.workingstep.0)?,
            number(&|(r, _)| r.tool.0)?,
        ];
        RecordBatch::try_new(Arc::clone(&self.schema), columns).map_err(|e| unwritable(e.to_string()))
    }
}

/// A value that was read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// The cycle.
    pub tick: u64,
    /// Which run of the function.
    pub run: i32,
    /// The recording's id.
    pub recording: String,
    /// The stream.
    pub stream: String,
    /// Its unit.
    pub unit: String,
    /// The value; `None` is unavailable.
    pub value: Option<f64>,
    /// What it is worth.
    pub quality: String,
    /// The step in execution.
    pub step: i32,
    /// The workingstep in execution.
    pub workingstep: i32,
    /// The tool in the spindle.
    pub tool: i32,
}

/// Reads a file of functions, a value at a time.
///
/// # Errors
/// It is not there, damaged, or another kind of table.
pub fn read(path: &Path, each: &mut dyn FnMut(Recorded)) -> Result<(), StoreError> {
    let table = Table::open(path)?;
    if *table.schema().fields() != *layout().schema().fields() {
        return Err(StoreError::Unwritable {
            path: path.to_owned(),
            what: "it is no file of recordings of functions".to_owned(),
        });
    }
    for batch in table.batches()? {
        let batch = batch?;
        let text = |k: usize| batch.column(k).as_string::<i32>();
        let number = |k: usize| batch.column(k).as_primitive::<Int32Type>();
        let (ticks, values) = (
            batch.column(1).as_primitive::<Int64Type>(),
            batch.column(6).as_primitive::<Float64Type>(),
        );
        for row in 0..batch.num_rows() {
            each(Recorded {
                tick: u64::try_from(ticks.value(row)).unwrap_or(0),
                run: number(2).value(row),
                recording: text(3).value(row).to_owned(),
                stream: text(4).value(row).to_owned(),
                unit: text(5).value(row).to_owned(),
                value: values.is_valid(row).then(|| values.value(row)),
                quality: text(7).value(row).to_owned(),
                step: number(8).value(row),
                workingstep: number(9).value(row),
                tool: number(10).value(row),
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_streams_that_come_out_of_their_order_are_kept() {
        let streams = Streams::default();
        let mut rows = FunctionRows::new(Timestamp(0), Path::new("functions.parquet"), streams.clone());
        for (tick, stream) in [(0, 2), (1, 0), (2, 2), (3, 1)] {
            streams.know(stream, || StreamName {
                run: stream + 1,
                recording: "r".to_owned(),
                stream: format!("stream {stream}"),
                unit: String::new(),
                derived: false,
            });
            rows.push(&FunctionRow {
                tick: Tick(tick),
                stream,
                value: 1.0,
                quality: machine::Quality::Good,
                step: StepId(1),
                workingstep: WorkingstepId(0),
                tool: ToolNumber(0),
            })
            .expect("its stream is known");
        }
        let batch = rows.take().expect("all of it can be written");
        let names: Vec<_> = batch.column(4).as_string::<i32>().iter().flatten().collect();
        assert_eq!(names, ["stream 2", "stream 0", "stream 2", "stream 1"]);
    }
}

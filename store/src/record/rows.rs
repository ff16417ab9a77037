//! Samples as columns: scaled to integers, some thousand at a time.

use super::schema;
use crate::StoreError;
use crate::segment::{Rows, unwritable};
use arrow_array::builder::{Int32Builder, Int64Builder, TimestampMicrosecondBuilder, UInt8Builder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::SchemaRef;
use machine::{CHANNELS, Sample};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use units::{StepId, Tick, Timestamp, ToolNumber, WorkingstepId};

/// The columns that every record of samples has, for rows that were not given on yet.
pub(crate) struct Base {
    path: PathBuf,
    start: Timestamp,
    last: Option<Tick>,
    ts: TimestampMicrosecondBuilder,
    tick: Int64Builder,
    step: Int32Builder,
    workingstep: Int32Builder,
    tool: Int32Builder,
    phase: UInt8Builder,
    quality: UInt8Builder,
}

/// What a row says in them.
pub(crate) struct BaseRow {
    pub(crate) tick: Tick,
    pub(crate) step: StepId,
    pub(crate) workingstep: WorkingstepId,
    pub(crate) tool: ToolNumber,
    pub(crate) phase: u8,
    pub(crate) quality: u8,
}

impl Base {
    /// `path` is what errors name.
    pub(crate) fn new(start: Timestamp, path: &Path) -> Base {
        Base {
            path: path.to_owned(),
            start,
            last: None,
            ts: TimestampMicrosecondBuilder::new().with_timezone("UTC"),
            tick: Int64Builder::new(),
            step: Int32Builder::new(),
            workingstep: Int32Builder::new(),
            tool: Int32Builder::new(),
            phase: UInt8Builder::new(),
            quality: UInt8Builder::new(),
        }
    }

    pub(crate) fn push(&mut self, row: &BaseRow) -> Result<(), StoreError> {
        if let Some(last) = self.last
            && row.tick <= last
        {
            return Err(StoreError::OutOfOrder {
                path: self.path.clone(),
                last,
                found: row.tick,
            });
        }
        let too_large = |column, value: u64| StoreError::TooLarge {
            path: self.path.clone(),
            column,
            value,
        };
        let number = |column, value: u32| i32::try_from(value).map_err(|_| too_large(column, u64::from(value)));
        let tick = i64::try_from(row.tick.0).map_err(|_| too_large(schema::TICK, row.tick.0))?;
        // i64 nanoseconds, as `Timestamp::at` counts them, end in 2262.
        let at = tick
            .checked_mul(1_000_000)
            .and_then(|ns| ns.checked_add(self.start.0))
            .ok_or_else(|| too_large(schema::TS, row.tick.0))?;
        let step = number(schema::STEP, row.step.0)?;
        let workingstep = number(schema::WORKINGSTEP, row.workingstep.0)?;
        let tool = number(schema::TOOL, row.tool.0)?;

        self.ts.append_value(Timestamp(at).micros());
        self.tick.append_value(tick);
        self.step.append_value(step);
        self.workingstep.append_value(workingstep);
        self.tool.append_value(tool);
        self.phase.append_value(row.phase);
        self.quality.append_value(row.quality);
        self.last = Some(row.tick);
        Ok(())
    }

    pub(crate) fn len(&self) -> usize {
        arrow_array::builder::ArrayBuilder::len(&self.tick)
    }

    /// Takes the rows out, with their readings, in the order of the schema.
    pub(crate) fn take(&mut self, schema: SchemaRef, readings: &mut [Int32Builder]) -> Result<RecordBatch, StoreError> {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.ts.finish()),
            Arc::new(self.tick.finish()),
            Arc::new(self.step.finish()),
            Arc::new(self.workingstep.finish()),
            Arc::new(self.tool.finish()),
            Arc::new(self.phase.finish()),
            Arc::new(self.quality.finish()),
        ];
        columns.extend(readings.iter_mut().map(|c| Arc::new(c.finish()) as ArrayRef));
        RecordBatch::try_new(schema, columns).map_err(unwritable(&self.path))
    }
}

/// Samples of our own machine.
pub struct SampleRows {
    base: Base,
    channels: Vec<Int32Builder>,
    schema: SchemaRef,
}

impl SampleRows {
    /// For a machine whose tick 0 was at `start`; `path` is what errors name.
    pub fn new(start: Timestamp, path: &Path) -> SampleRows {
        SampleRows {
            base: Base::new(start, path),
            channels: CHANNELS.iter().map(|_| Int32Builder::new()).collect(),
            schema: schema::arrow_schema(),
        }
    }
}

impl Rows for SampleRows {
    type Row = Sample;

    fn number(row: &Sample) -> u64 {
        row.tick.0
    }
    fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }
    fn push(&mut self, sample: &Sample) -> Result<(), StoreError> {
        self.base.push(&BaseRow {
            tick: sample.tick,
            step: sample.step,
            workingstep: sample.workingstep,
            tool: sample.tool,
            phase: sample.phase as u8,
            quality: sample.quality as u8,
        })?;
        for (channel, column) in CHANNELS.iter().zip(&mut self.channels) {
            let quanta = (channel.read)(sample) / channel.scale;
            if quanta.abs() <= f64::from(i32::MAX) {
                column.append_value(channel.quantise(sample));
            } else {
                column.append_null();
            }
        }
        Ok(())
    }
    fn len(&self) -> usize {
        self.base.len()
    }
    fn take(&mut self) -> Result<RecordBatch, StoreError> {
        self.base.take(Arc::clone(&self.schema), &mut self.channels)
    }
}

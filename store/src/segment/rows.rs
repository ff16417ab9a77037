//! Rows on their way to a segment: how what is sampled becomes columns.

use super::layout::{Holds, Layout};
use crate::StoreError;
use crate::record::rows::{Base, BaseRow};
use arrow_array::RecordBatch;
use arrow_array::builder::Int32Builder;
use arrow_schema::SchemaRef;
use std::path::Path;
use std::sync::Arc;
use units::{StepId, Tick, Timestamp, ToolNumber, WorkingstepId};

/// Gathers rows of one kind and gives them as columns.
pub trait Rows: Send + 'static {
    /// What the sampling thread hands over: of fixed size, so that handing it over takes no memory.
    type Row: Copy + Send + 'static;

    /// The number that gaps are told in: a tick, a sequence.
    fn number(row: &Self::Row) -> u64;
    /// The columns.
    fn schema(&self) -> SchemaRef;
    /// Adds a row.
    ///
    /// # Errors
    /// It cannot be kept: its number does not rise, or a column does not hold it. It is not among the rows then.
    fn push(&mut self, row: &Self::Row) -> Result<(), StoreError>;
    /// The number of rows that were not taken.
    fn len(&self) -> usize;
    /// True when all rows were taken.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Takes the rows out.
    ///
    /// # Errors
    /// They do not fit together, which is a fault of the implementation.
    fn take(&mut self) -> Result<RecordBatch, StoreError>;
}

/// A row of `N` readings of any machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<const N: usize> {
    /// Which cycle.
    pub tick: Tick,
    /// The step in execution; 0 is none.
    pub step: StepId,
    /// The workingstep in execution; 0 is none.
    pub workingstep: WorkingstepId,
    /// The tool in the spindle; 0 is none.
    pub tool: ToolNumber,
    /// What the machine was doing.
    pub phase: machine::Phase,
    /// How far the row can be trusted.
    pub quality: machine::Quality,
    /// The readings in their units, in the order of the layout; not a number is unavailable.
    pub values: [f64; N],
}

/// Rows of `N` readings, by a layout of [`Layout::samples`].
pub struct ReadingRows<const N: usize> {
    base: Base,
    /// One quantum and the value of 0 of each column.
    scales: Vec<(f64, f64)>,
    columns: Vec<Int32Builder>,
    schema: SchemaRef,
}

impl<const N: usize> ReadingRows<N> {
    /// For a machine whose tick 0 was at `start`. `None` when the layout has not `N` readings.
    pub fn new(readings: &[super::Column], start: Timestamp, path: &Path) -> Option<ReadingRows<N>> {
        let scale = |column: &super::Column| match &column.holds {
            Holds::Reading { scale, offset, .. } => Some((*scale, *offset)),
            _ => None,
        };
        let scales: Vec<(f64, f64)> = readings.iter().map(scale).collect::<Option<_>>()?;
        (scales.len() == N).then(|| ReadingRows {
            base: Base::new(start, path),
            scales,
            columns: (0..N).map(|_| Int32Builder::new()).collect(),
            schema: Layout::samples(readings.iter().cloned()).schema(),
        })
    }
}

impl<const N: usize> Rows for ReadingRows<N> {
    type Row = Reading<N>;

    fn number(row: &Reading<N>) -> u64 {
        row.tick.0
    }
    fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }
    fn push(&mut self, row: &Reading<N>) -> Result<(), StoreError> {
        self.base.push(&BaseRow {
            tick: row.tick,
            step: row.step,
            workingstep: row.workingstep,
            tool: row.tool,
            phase: row.phase as u8,
            quality: row.quality as u8,
        })?;
        for ((value, (scale, offset)), column) in row.values.iter().zip(&self.scales).zip(&mut self.columns) {
            let quanta = ((value - offset) / scale).round();
            column.append_option((quanta.abs() <= f64::from(i32::MAX)).then_some(quanta as i32));
        }
        Ok(())
    }
    fn len(&self) -> usize {
        self.base.len()
    }
    fn take(&mut self) -> Result<RecordBatch, StoreError> {
        self.base.take(Arc::clone(&self.schema), &mut self.columns)
    }
}

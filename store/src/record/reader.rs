//! Reads a record back, batch by batch or row by row.

use super::schema::{self, Header, key};
use super::writer::Finished;
use crate::StoreError;
use crate::table::Table;
use crate::whole_file::hash_of_file;
use arrow_array::cast::AsArray;
use arrow_array::types::{Int32Type, Int64Type, TimestampMicrosecondType, UInt8Type};
use arrow_array::{Array, Int32Array, RecordBatch};
use arrow_schema::{DataType, Schema};
use ledger::{Event, Hash};
use machine::{Phase, Quality};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use units::{StepId, Tick, Timestamp, ToolNumber, WorkingstepId};

/// An open record.
pub struct Reader {
    path: PathBuf,
    table: Table,
    header: Header,
    columns: Vec<Column>,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Reader({}, {} rows)", self.path.display(), self.len())
    }
}

/// A column of readings: `value = raw * scale + offset`, in `unit`.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its name, as in `machine::CHANNELS`.
    pub name: String,
    /// Its unit, in MTConnect's words.
    pub unit: String,
    /// One quantum.
    pub scale: f64,
    /// The value of raw 0.
    pub offset: f64,
}

impl Column {
    /// The reading behind a raw number.
    ///
    /// Most scales are decimal fractions, which have no exact double; dividing by their inverse gives the double nearest to the decimal
    /// number, so that 123457 at 0.001 is 123.457 and not 123.45700000000001.
    pub fn value(&self, raw: i32) -> f64 {
        let raw = f64::from(raw);
        let inverse = (1.0 / self.scale).round();
        let scaled = if inverse >= 1.0 && 1.0 / inverse == self.scale {
            raw / inverse
        } else {
            raw * self.scale
        };
        scaled + self.offset
    }

    /// The least and the greatest reading behind the least and the greatest raw number; a negative scale turns them round.
    pub(crate) fn ordered(&self, min: i32, max: i32) -> (f64, f64) {
        let (a, b) = (self.value(min), self.value(max));
        (a.min(b), a.max(b))
    }
}

/// One row: a servo cycle. Positions are gauge-point axis positions in the machine frame, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// When.
    pub at: Timestamp,
    /// Which cycle.
    pub tick: Tick,
    /// The step in execution.
    pub step: StepId,
    /// The workingstep in execution.
    pub workingstep: WorkingstepId,
    /// The tool in the spindle.
    pub tool: ToolNumber,
    /// What the machine was doing.
    pub phase: Phase,
    /// How far the row can be trusted.
    pub quality: Quality,
    /// Commanded position; `None` when an axis has none.
    pub commanded: Option<[f64; 3]>,
    /// Position by the encoders; `None` when an axis has none.
    pub actual: Option<[f64; 3]>,
}

const COMMANDED: [&str; 3] = ["X.POSITION.COMMANDED", "Y.POSITION.COMMANDED", "Z.POSITION.COMMANDED"];
const ACTUAL: [&str; 3] = ["X.POSITION.ACTUAL", "Y.POSITION.ACTUAL", "Z.POSITION.ACTUAL"];

impl Reader {
    /// Opens a record, holds its content against the hashes it carries, and reads what it says about itself.
    ///
    /// # Errors
    /// It cannot be opened, it is no Parquet file, it is cut or changed, or it is Parquet but not a record of ours.
    pub fn open(path: &Path) -> Result<Reader, StoreError> {
        let not_ours = |what: String| StoreError::NotARecord {
            path: path.to_owned(),
            what,
        };
        let table = Table::open_if(path, |metadata| header_of(metadata).map(drop))?;
        let header = header_of(table.metadata()).map_err(not_ours)?;
        let columns = columns_of(table.schema()).map_err(not_ours)?;
        Ok(Reader {
            path: path.to_owned(),
            table,
            header,
            columns,
        })
    }

    /// Machine, start, seed, and whether a simulator made it.
    pub fn header(&self) -> &Header {
        &self.header
    }
    /// Everything that the file says about itself, by key.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        self.table.metadata()
    }
    /// The columns of readings, in file order.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }
    /// All columns, as Arrow has them.
    pub(super) fn arrow_schema(&self) -> &Schema {
        self.table.schema()
    }
    /// The number of rows.
    pub fn len(&self) -> u64 {
        self.table.len()
    }
    /// True for a record without rows.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    /// The events of the job, in order, their chain checked.
    ///
    /// # Errors
    /// They are not readable, or the chain is broken.
    pub fn events(&self) -> Result<Vec<Event>, StoreError> {
        let damaged = |what: String| StoreError::Damaged {
            path: self.path.clone(),
            what,
        };
        let text = self.metadata().get(key::EVENTS).map_or("[]", String::as_str);
        let events: Vec<Event> = serde_json::from_str(text).map_err(|e| damaged(format!("its events: {e}")))?;
        ledger::verify(&events).map_err(|broken| damaged(format!("its events: {broken}")))?;
        Ok(events)
    }

    /// The hash of the whole file, to be held against the catalogue.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn hash(&self) -> Result<Hash, StoreError> {
        hash_of_file(&self.path)
    }

    /// What the writer would have said of it, for a record that was finished by a process that could not catalogue it any more.
    ///
    /// # Errors
    /// The disk refuses, or the file is damaged.
    pub fn finished(&self) -> Result<Finished, StoreError> {
        let mut span_us = None;
        for batch in self.batches()? {
            let rows = batch?.rows();
            if let (Some(first), Some(last)) = (rows.first(), rows.last()) {
                let (from, _) = span_us.unwrap_or((first.at.micros(), 0));
                span_us = Some((from, last.at.micros()));
            }
        }
        Ok(Finished {
            path: self.path.clone(),
            rows: self.len(),
            span_us,
            bytes: self.path.metadata().map_err(StoreError::io("read", &self.path))?.len(),
            hash: self.hash()?,
            unavailable: self
                .metadata()
                .get(key::UNAVAILABLE)
                .and_then(|n| n.parse().ok())
                .unwrap_or(0),
        })
    }

    /// All rows, in order.
    ///
    /// # Errors
    /// The file is damaged; each item may say so too, when the damage is met later, and is the last one then.
    pub fn rows(&self) -> Result<impl Iterator<Item = Result<Row, StoreError>> + use<>, StoreError> {
        let batches = self.batches()?;
        Ok(batches.flat_map(|batch| {
            let (rows, error) = match batch {
                Ok(batch) => (batch.rows(), None),
                Err(error) => (Vec::new(), Some(Err(error))),
            };
            rows.into_iter().map(Ok).chain(error)
        }))
    }

    /// All rows by column, some thousand at a time.
    ///
    /// # Errors
    /// As [`Reader::rows`].
    pub fn batches(&self) -> Result<impl Iterator<Item = Result<Batch, StoreError>> + use<>, StoreError> {
        let (path, columns, batches) = (self.path.clone(), self.columns.clone(), self.table.batches()?);
        Ok(batches.map(move |next| next.and_then(|arrow| Batch::new(&path, arrow, columns.clone()))))
    }
}

/// Some thousand rows of a record, by column.
#[derive(Clone, Debug)]
pub struct Batch {
    arrow: RecordBatch,
    columns: Vec<Column>,
    positions: [[Option<usize>; 3]; 2],
}

impl Batch {
    pub(crate) fn new(path: &Path, arrow: RecordBatch, columns: Vec<Column>) -> Result<Batch, StoreError> {
        // The file's footer gave the schema, and `columns_of` checked it; a reader that gives another one is met here.
        columns_of(&arrow.schema()).map_err(|what| StoreError::Damaged {
            path: path.to_owned(),
            what,
        })?;
        let positions = [COMMANDED, ACTUAL].map(|names| names.map(|name| columns.iter().position(|c| c.name == name)));
        Ok(Batch {
            arrow,
            columns,
            positions,
        })
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.arrow.num_rows()
    }
    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// All of it, as Arrow has it.
    pub fn arrow(&self) -> &RecordBatch {
        &self.arrow
    }
    /// The raw numbers of a column of readings; null is unavailable. `None` when there is no such column.
    pub fn raw(&self, name: &str) -> Option<&Int32Array> {
        self.arrow.column_by_name(name)?.as_primitive_opt::<Int32Type>()
    }
    /// The readings of a column, in its unit. `None` when there is no such column.
    pub fn values(&self, name: &str) -> Option<impl Iterator<Item = Option<f64>>> {
        let column = self.columns.iter().find(|c| c.name == name)?;
        Some(self.raw(name)?.iter().map(|raw| raw.map(|raw| column.value(raw))))
    }

    /// Its rows.
    pub fn rows(&self) -> Vec<Row> {
        let column = |name: &str| self.arrow.column_by_name(name).expect("checked when the batch was made");
        let ts = column(schema::TS).as_primitive::<TimestampMicrosecondType>();
        let tick = column(schema::TICK).as_primitive::<Int64Type>();
        let [step, workingstep, tool] =
            [schema::STEP, schema::WORKINGSTEP, schema::TOOL].map(|name| column(name).as_primitive::<Int32Type>());
        let [phase, quality] = [schema::PHASE, schema::QUALITY].map(|name| column(name).as_primitive::<UInt8Type>());
        let positions = self
            .positions
            .map(|axes| axes.map(|k| k.and_then(|k| Some((&self.columns[k], self.raw(&self.columns[k].name)?)))));
        let position = |axes: &[Option<(&Column, &Int32Array)>; 3], row: usize| -> Option<[f64; 3]> {
            let mut xyz = [0.0; 3];
            for (coordinate, axis) in xyz.iter_mut().zip(axes) {
                let (column, raw) = axis.as_ref()?;
                *coordinate = raw.is_valid(row).then(|| column.value(raw.value(row)))?;
            }
            Some(xyz)
        };
        (0..self.len())
            .map(|row| Row {
                at: Timestamp(ts.value(row).saturating_mul(1000)),
                tick: Tick(tick.value(row) as u64),
                step: StepId(step.value(row) as u32),
                workingstep: WorkingstepId(workingstep.value(row) as u32),
                tool: ToolNumber(tool.value(row) as u32),
                phase: phase_of(phase.value(row)),
                quality: quality_of(quality.value(row)),
                commanded: position(&positions[0], row),
                actual: position(&positions[1], row),
            })
            .collect()
    }
}

fn header_of(metadata: &BTreeMap<String, String>) -> Result<Header, String> {
    let text = |key: &str| {
        metadata
            .get(key)
            .ok_or_else(|| format!("its metadata has no {key}; for other Parquet files use a query"))
    };
    let number = |key: &str, text: &str| format!("its {key} is {text:?}, which is no number");
    match text(key::LAYOUT)?.as_str() {
        schema::LAYOUT => {}
        other => {
            return Err(format!(
                "its layout is {other:?}, this program reads {:?}: use the newer toolmark",
                schema::LAYOUT
            ));
        }
    }
    match text(key::FRAME)?.as_str() {
        "machine" => {}
        other => return Err(format!("its positions are in frame {other:?}, a record's are in \"machine\"")),
    }
    match text(key::LENGTH_UNIT)?.as_str() {
        "mm" => {}
        other => return Err(format!("its lengths are in {other:?}, a record's are in \"mm\"")),
    }
    let (start, seed) = (text(key::START_NS)?, text(key::SEED)?);
    Ok(Header {
        machine: text(key::MACHINE)?.clone(),
        simulated: text(key::SIMULATED)? == "true",
        start: Timestamp(start.parse().map_err(|_| number(key::START_NS, start))?),
        seed: seed.parse().map_err(|_| number(key::SEED, seed))?,
    })
}

pub(crate) fn columns_of(schema: &Schema) -> Result<Vec<Column>, String> {
    let is = |name: &str, wanted: &DataType| match schema.field_with_name(name) {
        Ok(field) if field.data_type() == wanted && !field.is_nullable() => Ok(()),
        Ok(field) => Err(format!("its column {name} is {}, expected {wanted}", field.data_type())),
        Err(_) => Err(format!("it has no column {name}")),
    };
    let expected = schema::arrow_schema();
    for field in expected.fields().iter().filter(|field| !field.is_nullable()) {
        is(field.name(), field.data_type())?;
    }
    let mut columns = Vec::new();
    for field in schema.fields().iter().filter(|f| f.metadata().contains_key(key::SCALE)) {
        let text = |key: &str| field.metadata().get(key).map_or("", String::as_str);
        let number = |key: &str| match text(key).parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!(
                "column {}: {key} is {:?}, which is no number",
                field.name(),
                text(key)
            )),
        };
        if field.data_type() != &DataType::Int32 {
            return Err(format!("column {} is {}, expected Int32", field.name(), field.data_type()));
        }
        let column = Column {
            name: field.name().clone(),
            unit: text(key::UNIT).to_owned(),
            scale: number(key::SCALE)?,
            offset: number(key::OFFSET)?,
        };
        let is_position = COMMANDED.contains(&column.name.as_str()) || ACTUAL.contains(&column.name.as_str());
        if is_position && column.unit != "MILLIMETER" {
            return Err(format!("column {} is in {:?}, expected MILLIMETER", column.name, column.unit));
        }
        columns.push(column);
    }
    Ok(columns)
}

fn phase_of(number: u8) -> Phase {
    use Phase::*;
    // A phase that a newer program wrote: the machine certainly was not following set-points as we know them.
    [
        Ready,
        Running,
        Waiting,
        Paused,
        Stopped,
        EmergencyStop,
        Fault,
        Jogging,
        Homing,
    ]
    .into_iter()
    .find(|p| *p as u8 == number)
    .unwrap_or(Fault)
}

fn quality_of(number: u8) -> Quality {
    use Quality::*;
    [Good, Simulated, Stale, Unavailable]
        .into_iter()
        .find(|q| *q as u8 == number)
        .unwrap_or(Unavailable)
}

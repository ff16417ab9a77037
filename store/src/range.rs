//! Rows of a moment: those of a machine or of a job between two times, over all files that hold some, in the order of time, each once.
//!
//! Memory is constant: a page or so of each file that is open, and only files that overlap in time are open together. Where the rows
//! themselves were removed by age, what their buckets came to is given instead, and says so.

use crate::record::{Column, schema};
use crate::rollup::{Rollup, Summary, known_channel};
use crate::sources::{OpenRaw, Source};
use crate::{DataDirectory, Of, Span, StoreError};
use arrow_array::cast::AsArray;
use arrow_array::types::{Int32Type, TimestampMicrosecondType};
use arrow_array::{ArrayRef, Int32Array, RecordBatch, new_null_array};
use arrow_schema::{Field, Schema, SchemaRef};
use std::collections::VecDeque;
use std::sync::Arc;
use units::Timestamp;

/// A piece of a range, in the order of time.
#[derive(Clone, Debug)]
pub enum Piece {
    /// Rows as they were recorded.
    Rows(Rows),
    /// Rows that were removed by age: what they came to.
    RolledUp(RolledUp),
}

/// Rows as they were recorded, some thousand at most.
#[derive(Clone, Debug)]
pub struct Rows {
    /// The column `ts`, then those that were asked for, in that order. A column that the record lacks is all null.
    pub arrow: RecordBatch,
    columns: Arc<[Option<Column>]>,
}

/// What rows came to that were removed by age: up to 256 of them.
#[derive(Clone, Debug, PartialEq)]
pub struct RolledUp {
    /// Time of the first row.
    pub first: Timestamp,
    /// Time of the last row. The first and the last piece of a range may reach beyond it.
    pub last: Timestamp,
    /// How many rows.
    pub rows: u64,
    /// The columns that were asked for, in that order; `None` for one that is no channel of readings, of which nothing is left.
    pub columns: Vec<Option<Rest>>,
}

/// What is left of a channel's readings, in its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Readings that were there.
    pub count: u64,
    /// Rows whose reading was unavailable.
    pub missing: u64,
    /// The least; `None` without readings.
    pub min: Option<f64>,
    /// The greatest.
    pub max: Option<f64>,
    /// The first.
    pub first: Option<f64>,
    /// The last.
    pub last: Option<f64>,
    /// The mean.
    pub mean: Option<f64>,
}

impl Rows {
    /// The number of rows.
    pub fn len(&self) -> usize {
        self.arrow.num_rows()
    }
    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// When each row was, microseconds UTC.
    pub fn times_us(&self) -> &[i64] {
        self.arrow.column(0).as_primitive::<TimestampMicrosecondType>().values()
    }
    /// The raw numbers of the `n`-th column that was asked for; `None` when it is no channel of readings.
    pub fn raw(&self, n: usize) -> Option<&Int32Array> {
        self.columns.get(n)?.as_ref()?;
        self.arrow.column(n + 1).as_primitive_opt::<Int32Type>()
    }
    /// The readings of the `n`-th column that was asked for, in its unit; `None` when it is no channel of readings.
    pub fn values(&self, n: usize) -> Option<impl Iterator<Item = Option<f64>>> {
        let column = self.columns.get(n)?.as_ref()?;
        Some(self.raw(n)?.iter().map(|raw| raw.map(|raw| column.value(raw))))
    }
}

impl DataDirectory {
    /// The rows of a span with the columns that are named: channels, or `tick`, `step`, `workingstep`, `tool`, `phase`, `quality`.
    /// Rows of equal time come record by record.
    ///
    /// # Errors
    /// No record has such a column, a file is damaged, or the disk refuses; each piece may say so too, and is the last one then.
    pub fn range(&self, of: Of<'_>, span: Span, columns: &[&str]) -> Result<Range, StoreError> {
        let (from_us, to_us) = span.micros();
        let sources = self.sources(of, from_us, to_us)?;
        let fixed = schema::arrow_schema();
        let is_fixed = |name: &str| fixed.field_with_name(name).is_ok_and(|f| !f.is_nullable());
        for name in columns.iter().filter(|name| !is_fixed(name)) {
            known_channel(&sources, name)?;
        }
        Ok(Range {
            from_us,
            to_us,
            names: columns.iter().map(|&n| n.to_owned()).collect(),
            waiting: sources.into(),
            open: Vec::new(),
            failed: false,
        })
    }
}

/// The pieces of a range, one after the other.
pub struct Range {
    from_us: i64,
    to_us: i64,
    names: Vec<String>,
    waiting: VecDeque<Source>,
    /// Files that are being read, in the order of the catalogue; more than one where records overlap in time.
    open: Vec<Open>,
    failed: bool,
}

/// A file that is being read.
struct Open {
    pieces: Box<dyn Iterator<Item = Result<Piece, StoreError>>>,
    head: Piece,
}

impl std::fmt::Debug for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Range({}..{} of {:?})", self.from_us, self.to_us, self.names)
    }
}

impl Iterator for Range {
    type Item = Result<Piece, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let piece = self.advance().transpose();
        self.failed = matches!(piece, Some(Err(_)));
        piece
    }
}

impl Range {
    fn advance(&mut self) -> Result<Option<Piece>, StoreError> {
        while let Some(source) = self.waiting.front() {
            let earliest = self.open.iter().map(|o| o.head.first_us()).min();
            if earliest.is_some_and(|at| at < source.span_us().0) {
                break;
            }
            let source = self.waiting.pop_front().expect("looked at above");
            let mut pieces = self.pieces_of(source)?;
            if let Some(head) = pieces.next().transpose()? {
                self.open.push(Open { pieces, head });
            }
        }
        let Some(n) = (0..self.open.len()).min_by_key(|&n| self.open[n].head.first_us()) else {
            return Ok(None);
        };
        // Up to where nobody else has an earlier row; of equal times, those of the record that comes first.
        let others = self.open.iter().enumerate().filter(|(k, _)| *k != n);
        let until = others
            .map(|(k, other)| other.head.first_us().saturating_add(i64::from(k > n)))
            .chain(self.waiting.front().map(|s| s.span_us().0.saturating_add(1)))
            .min();
        let open = &mut self.open[n];
        let (piece, rest) = open.head.split(until.unwrap_or(i64::MAX));
        match rest {
            Some(rest) => open.head = rest,
            None => match open.pieces.next().transpose()? {
                Some(next) => open.head = next,
                None => {
                    self.open.remove(n);
                }
            },
        }
        Ok(Some(piece))
    }

    fn pieces_of(&self, source: Source) -> Result<Box<dyn Iterator<Item = Result<Piece, StoreError>>>, StoreError> {
        Ok(match source.raw.open()? {
            Some(file) => Box::new(self.rows_of(&file, source.rollup.rows())?),
            None => Box::new(self.buckets_of(source.rollup)),
        })
    }

    /// The first `count` rows of a file as far as they are inside of the span: a segment may have got more meanwhile.
    fn rows_of(&self, file: &OpenRaw, count: u64) -> Result<impl Iterator<Item = Result<Piece, StoreError>> + use<>, StoreError> {
        let mut names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        names.push(schema::TS);
        let near = file.rows_near(self.from_us, self.to_us);
        let batches = file.read(near.start..near.end.min(count), &names)?;
        let all = file.schema();
        let lacking = |name: &String| Field::new(name, arrow_schema::DataType::Int32, true);
        let mut fields = vec![all.field_with_name(schema::TS).expect("every record has times").clone()];
        fields.extend(self.names.iter().map(|name| match all.field_with_name(name) {
            Ok(field) => field.clone(),
            Err(_) => lacking(name),
        }));
        let shape: SchemaRef = Arc::new(Schema::new(fields));
        // A channel that the record lacks is a channel of readings without a reading.
        let column = |name: &String| {
            let there = file.columns().iter().find(|c| c.name == *name).cloned();
            there.or_else(|| {
                all.field_with_name(name).is_err().then(|| Column {
                    name: name.clone(),
                    unit: String::new(),
                    scale: 1.0,
                    offset: 0.0,
                })
            })
        };
        let columns: Arc<[Option<Column>]> = self.names.iter().map(column).collect();
        let (from_us, to_us, path) = (self.from_us, self.to_us, file.path().to_owned());
        let piece = move |batch: RecordBatch| -> Result<Option<Piece>, StoreError> {
            let arrays: Vec<ArrayRef> = (shape.fields().iter())
                .map(|field| match batch.column_by_name(field.name()) {
                    Some(array) => array.clone(),
                    None => new_null_array(field.data_type(), batch.num_rows()),
                })
                .collect();
            let arrow = RecordBatch::try_new(shape.clone(), arrays).map_err(|e| StoreError::Damaged {
                path: path.clone(),
                what: e.to_string(),
            })?;
            let times = arrow.column(0).as_primitive::<TimestampMicrosecondType>().values();
            let from = times.partition_point(|&t| t < from_us);
            let to = times.partition_point(|&t| t < to_us);
            let rows = Rows {
                arrow: arrow.slice(from, to.saturating_sub(from)),
                columns: columns.clone(),
            };
            Ok((!rows.is_empty()).then_some(Piece::Rows(rows)))
        };
        Ok(batches.filter_map(move |batch| batch.and_then(&piece).transpose()))
    }

    fn buckets_of(&self, rollup: Rollup) -> impl Iterator<Item = Result<Piece, StoreError>> + use<> {
        let channels: Vec<Option<usize>> = self.names.iter().map(|name| rollup.channel(name)).collect();
        let (from_us, to_us) = (self.from_us, self.to_us);
        let blocks = rollup.blocks_between(from_us, to_us);
        blocks.flat_map(move |block| {
            let pieces = pieces_of_block(&rollup, block, &channels, from_us, to_us);
            let (pieces, error) = match pieces {
                Ok(pieces) => (pieces, None),
                Err(error) => (Vec::new(), Some(Err(error))),
            };
            pieces.into_iter().map(Ok).chain(error)
        })
    }
}

/// What the finest buckets of a block tell, those that touch the span.
fn pieces_of_block(
    rollup: &Rollup,
    block: usize,
    channels: &[Option<usize>],
    from_us: i64,
    to_us: i64,
) -> Result<Vec<Piece>, StoreError> {
    let times = rollup.times(0, block)?;
    let mut readings = Vec::with_capacity(channels.len());
    for channel in channels {
        readings.push(match channel {
            Some(n) => Some((rollup.column(*n), rollup.readings(0, block, *n, &times)?)),
            None => None,
        });
    }
    let at = |us: i64| Timestamp(us.saturating_mul(1000));
    let inside = (0..times.first_us.len()).filter(|&k| times.last_us[k] >= from_us && times.first_us[k] < to_us);
    let piece = |k: usize| {
        Piece::RolledUp(RolledUp {
            first: at(times.first_us[k]),
            last: at(times.last_us[k]),
            rows: times.row[k + 1] - times.row[k],
            columns: readings
                .iter()
                .map(|r| r.as_ref().map(|(column, readings)| Rest::of(&readings.buckets[k], column)))
                .collect(),
        })
    };
    Ok(inside.map(piece).collect())
}

impl Piece {
    fn first_us(&self) -> i64 {
        match self {
            Piece::Rows(rows) => rows.times_us()[0],
            Piece::RolledUp(bucket) => bucket.first.micros(),
        }
    }

    /// What lies before a moment, at least one row of it, and the rest.
    fn split(&self, until_us: i64) -> (Piece, Option<Piece>) {
        let Piece::Rows(rows) = self else {
            return (self.clone(), None);
        };
        let n = rows.times_us().partition_point(|&t| t < until_us).max(1);
        let part = |from: usize, count: usize| {
            Piece::Rows(Rows {
                arrow: rows.arrow.slice(from, count),
                columns: rows.columns.clone(),
            })
        };
        let rest = (n < rows.len()).then(|| part(n, rows.len() - n));
        (part(0, n), rest)
    }
}

impl Rest {
    fn of(raw: &Summary, column: &Column) -> Rest {
        let there = |value: f64| (raw.count > 0).then_some(value);
        let (min, max) = column.ordered(raw.min, raw.max);
        Rest {
            count: raw.count,
            missing: raw.missing,
            min: there(min),
            max: there(max),
            first: there(column.value(raw.first)),
            last: there(column.value(raw.last)),
            mean: there(raw.sum as f64 / raw.count as f64 * column.scale + column.offset),
        }
    }
}

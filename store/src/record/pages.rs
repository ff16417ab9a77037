//! Some rows of a record, without reading the rest: by place, and only the pages and columns that are asked for.
//!
//! What is read here is not held against the hash of the whole file, which would cost reading the whole file: the decoder finds what
//! makes no sense, a roll-up finds readings that differ from what was summed up, `verify` finds everything.

use super::reader::{Column, columns_of};
use super::schema::{self, key};
use crate::StoreError;
use crate::table::guarded;
use arrow_array::RecordBatch;
use arrow_schema::SchemaRef;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder, RowSelection, RowSelector,
};
use parquet::file::metadata::{PageIndexPolicy, ParquetMetaDataReader};
use parquet::file::page_index::column_index::ColumnIndexMetaData;
use parquet::file::statistics::Statistics;
use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An open record of which parts are read.
pub(crate) struct Pages {
    path: PathBuf,
    file: File,
    arrow: ArrowReaderMetadata,
    columns: Vec<Column>,
}

impl Pages {
    /// Opens a record without reading its rows.
    ///
    /// # Errors
    /// It cannot be opened, or its footer is damaged or not of a record.
    pub(crate) fn open(path: &Path) -> Result<Pages, StoreError> {
        let file = File::open(path).map_err(StoreError::io("open", path))?;
        let footer = guarded(path, || {
            ParquetMetaDataReader::new()
                .with_page_index_policy(PageIndexPolicy::Optional)
                .parse_and_finish(&file)
        })?;
        let pairs = footer.file_metadata().key_value_metadata().into_iter().flatten();
        let metadata: BTreeMap<String, String> = pairs
            .map(|kv| (kv.key.clone(), kv.value.clone().unwrap_or_default()))
            .collect();
        // The Arrow schema in the metadata is decoded by something that panics on a flipped bit.
        if metadata.get(key::DIGEST) != Some(&schema::digest(&metadata).to_string()) {
            return Err(StoreError::Damaged {
                path: path.to_owned(),
                what: "its metadata is not what was written".to_owned(),
            });
        }
        let arrow = guarded(path, || {
            ArrowReaderMetadata::try_new(Arc::new(footer), ArrowReaderOptions::new())
        })?;
        let columns = columns_of(arrow.schema()).map_err(|what| StoreError::NotARecord {
            path: path.to_owned(),
            what,
        })?;
        Ok(Pages {
            path: path.to_owned(),
            file,
            arrow,
            columns,
        })
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
    /// The columns of readings.
    pub(crate) fn columns(&self) -> &[Column] {
        &self.columns
    }
    /// All columns, as Arrow has them.
    pub(crate) fn schema(&self) -> &SchemaRef {
        self.arrow.schema()
    }

    /// Rows among which are all with a time in `from_us..to_us`: whole pages, found by the statistics of the file.
    pub(crate) fn rows_near(&self, from_us: i64, to_us: i64) -> Range<u64> {
        let metadata = self.arrow.metadata();
        let (mut first, mut end, mut at) = (u64::MAX, 0, 0);
        let mut take = |rows: Range<u64>, lowest: Option<i64>, highest: Option<i64>| {
            let before = highest.is_some_and(|t| t < from_us);
            let behind = lowest.is_some_and(|t| t >= to_us);
            if !before && !behind && !rows.is_empty() {
                first = first.min(rows.start);
                end = end.max(rows.end);
            }
        };
        // The column of times is the first one of every record.
        for (n, group) in metadata.row_groups().iter().enumerate() {
            let rows = at..at + u64::try_from(group.num_rows()).unwrap_or(0);
            at = rows.end;
            let pages = metadata.column_index().and_then(|i| i.get(n)?.first());
            let places = metadata.offset_index().and_then(|i| i.get(n)?.first());
            if let (Some(ColumnIndexMetaData::INT64(times)), Some(places)) = (pages, places) {
                let places = places.page_locations();
                for (k, place) in places.iter().enumerate() {
                    let row = |place: i64| rows.start + u64::try_from(place).unwrap_or(0);
                    let end = places.get(k + 1).map_or(rows.end, |next| row(next.first_row_index));
                    let (lowest, highest) = (times.min_value(k).copied(), times.max_value(k).copied());
                    take(row(place.first_row_index)..end, lowest, highest);
                }
            } else if let Some(Statistics::Int64(times)) = group.column(0).statistics() {
                take(rows, times.min_opt().copied(), times.max_opt().copied());
            } else {
                take(rows, None, None);
            }
        }
        if first > end { 0..0 } else { first..end }
    }

    /// Rows by place, with the columns that are named and there, in file order.
    ///
    /// # Errors
    /// The file is damaged; each item may say so too and is the last one then.
    pub(crate) fn read(
        &self,
        rows: Range<u64>,
        names: &[&str],
    ) -> Result<impl Iterator<Item = Result<RecordBatch, StoreError>> + use<>, StoreError> {
        let (mut groups, mut selectors, mut at) = (Vec::new(), Vec::new(), 0);
        for (n, group) in self.arrow.metadata().row_groups().iter().enumerate() {
            let count = u64::try_from(group.num_rows()).unwrap_or(0);
            let (from, to) = (rows.start.clamp(at, at + count) - at, rows.end.clamp(at, at + count) - at);
            at += count;
            if from < to {
                groups.push(n);
                selectors.push(RowSelector::skip(from as usize));
                selectors.push(RowSelector::select((to - from) as usize));
                selectors.push(RowSelector::skip((count - to) as usize));
            }
        }
        let path = self.path.clone();
        let mut reader = Some(guarded(&path, || {
            let parquet = self.arrow.parquet_schema();
            let wanted = (0..parquet.num_columns()).filter(|&k| names.contains(&parquet.column(k).name()));
            ParquetRecordBatchReaderBuilder::new_with_metadata(self.file.try_clone()?, self.arrow.clone())
                .with_projection(ProjectionMask::leaves(parquet, wanted))
                .with_row_groups(groups)
                .with_row_selection(RowSelection::from(selectors))
                .with_batch_size(schema::PAGE)
                .build()
        })?);
        Ok(std::iter::from_fn(move || {
            let next = guarded(&path, || Ok(reader.as_mut().and_then(Iterator::next).transpose()?)).transpose()?;
            if next.is_err() {
                reader = None;
            }
            Some(next)
        }))
    }
}

//! The catalogue of record files that are whole.

use crate::events::insert_event;
use crate::record::Finished;
use crate::{DataDirectory, JobId, Log, StoreError};
use ledger::Hash;
use rusqlite::{OptionalExtension, Row, params};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use units::Timestamp;

/// One record file.
#[derive(Clone, Debug, PartialEq)]
pub struct CatalogueRow {
    /// Its place in the catalogue, from 1.
    pub sequence: u64,
    /// Where it is.
    pub path: PathBuf,
    /// The job it belongs to.
    pub job: JobId,
    /// The machine it is of.
    pub machine: String,
    /// Time of its first and last row, microseconds UTC; `None` without rows.
    pub span_us: Option<(i64, i64)>,
    /// Its number of rows.
    pub rows: u64,
    /// Its length.
    pub bytes: u64,
    /// The hash of the file.
    pub hash: Hash,
    /// The hash of the file before it in the catalogue; zeros for the first.
    pub previous: Hash,
    /// Its path as it stands in the table: relative where it lies in the data directory.
    pub(crate) text: String,
}

impl DataDirectory {
    /// Puts a finished record into the catalogue and tells so in the log, in one transaction.
    ///
    /// # Errors
    /// There is no such job, or the disk refuses. The file is whole in any case and can be put in later.
    pub fn catalogue(&mut self, job: JobId, record: &Finished, at: Timestamp) -> Result<CatalogueRow, StoreError> {
        self.catalogue_with(job, record, at, None)
    }

    /// The same, with another event before it in the same transaction.
    pub(crate) fn catalogue_with(
        &mut self,
        job: JobId,
        record: &Finished,
        at: Timestamp,
        before: Option<(&str, BTreeMap<String, Value>)>,
    ) -> Result<CatalogueRow, StoreError> {
        self.must_hold()?;
        let machine = self.job(job)?.machine;
        let path = self.path_to_text(&record.path)?;
        self.in_transaction(|transaction, chain| {
            let last: Option<(i64, String)> = transaction
                .query_row(
                    "SELECT sequence, sha256 FROM records ORDER BY sequence DESC LIMIT 1",
                    [],
                    |row| Ok((row.get(0)?, row.get(1)?)),
                )
                .optional()?;
            let (sequence, previous) = last.map_or((1, Hash::default().to_string()), |(n, hash)| (n + 1, hash));
            let (first, last) = record.span_us.unzip();
            transaction.execute(
                "INSERT INTO records (sequence, path, job, machine, first_us, last_us, rows, bytes, sha256, previous_sha256)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
                params![
                    sequence,
                    path,
                    job.0,
                    machine,
                    first,
                    last,
                    record.rows as i64,
                    record.bytes as i64,
                    record.hash.to_string(),
                    previous
                ],
            )?;
            if let Some((kind, detail)) = before {
                insert_event(transaction, Log::Directory, &chain.append(at, kind, detail))?;
            }
            // The event holds the whole row, so that a changed row is found by the chain.
            let row = transaction.query_row("SELECT * FROM records WHERE sequence = ?1", [sequence], detail_of)?;
            let event = chain.append(at, "record-catalogued", row);
            insert_event(transaction, Log::Directory, &event)
        })?;
        let newest = self.records()?.pop();
        let newest = newest.expect("a row was put in above, and rows are never deleted");
        // The record is kept, whatever becomes of its roll-up: one that cannot be made now (a full disk) is made when it is first asked
        // for, and who asks then is told why it cannot.
        let _ = self.roll_up(&newest);
        Ok(newest)
    }

    /// All record files, in the order in which they were put in.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn records(&self) -> Result<Vec<CatalogueRow>, StoreError> {
        let all = || -> rusqlite::Result<Vec<CatalogueRow>> {
            let mut statement = self.database.prepare("SELECT * FROM records ORDER BY sequence")?;
            statement.query_map([], |row| self.catalogue_row_of(row))?.collect()
        };
        all().map_err(self.failed())
    }

    pub(crate) fn catalogue_row_of(&self, row: &Row<'_>) -> rusqlite::Result<CatalogueRow> {
        let hash = |column: &str| -> rusqlite::Result<Hash> {
            let odd = || rusqlite::Error::InvalidColumnType(0, column.to_owned(), rusqlite::types::Type::Text);
            Hash::parse(&row.get::<_, String>(column)?).ok_or_else(odd)
        };
        let count = |column: &str| -> rusqlite::Result<u64> {
            let number: i64 = row.get(column)?;
            u64::try_from(number).map_err(|_| rusqlite::Error::IntegralValueOutOfRange(0, number))
        };
        let (first, last): (Option<i64>, Option<i64>) = (row.get("first_us")?, row.get("last_us")?);
        let text: String = row.get("path")?;
        Ok(CatalogueRow {
            sequence: count("sequence")?,
            path: self.place_of(&text, &row.get::<_, String>("sha256")?),
            job: JobId(row.get("job")?),
            machine: row.get("machine")?,
            span_us: first.zip(last),
            rows: count("rows")?,
            bytes: count("bytes")?,
            hash: hash("sha256")?,
            previous: hash("previous_sha256")?,
            text,
        })
    }
}

/// A catalogue row as the detail of its event.
pub(crate) fn detail_of(row: &Row<'_>) -> rusqlite::Result<BTreeMap<String, Value>> {
    let mut detail = BTreeMap::new();
    for name in ["sequence", "job", "first_us", "last_us", "rows", "bytes"] {
        detail.insert(
            name.to_owned(),
            row.get::<_, Option<i64>>(name)?.map_or(Value::Null, Value::from),
        );
    }
    for name in ["path", "machine", "sha256", "previous_sha256"] {
        detail.insert(name.to_owned(), Value::from(row.get::<_, String>(name)?));
    }
    Ok(detail)
}

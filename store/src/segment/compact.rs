//! From segments to Parquet: a part of a long recording on its way, and all of a recording at its end.
//!
//! Every step can be killed and done again. A Parquet file is written under another name, synced and renamed before anything that it is
//! made of goes; where a segment and its Parquet part both stand, they hold the same rows and one of them is read. Rows carry their
//! number in the recording, so that none is taken twice and a hole is seen.

use super::gap::{Cause, Gap};
use super::reader::{Lost, Recovered, read};
use super::writer::FIRST_ROW;
use crate::record::{Finished, schema::key, writer};
use crate::table::{Table, TableWriter};
use crate::{StoreError, whole_file};
use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use arrow_schema::SchemaRef;
use ledger::Event;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A recording as one Parquet file.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The file.
    pub finished: Finished,
    /// Rows that are not in it, and why.
    pub gaps: Vec<Gap>,
    /// Bytes of its segments that could not be read.
    pub lost: Vec<(PathBuf, String)>,
}

/// Compacts one closed segment to a Parquet file beside it, and removes it.
pub(super) fn part(segment: &Path) -> Result<PathBuf, StoreError> {
    let target = segment.with_extension("parquet");
    let found = Part::Segment(Box::new(read(segment)?));
    write(&[found], &target, Some(u64::MAX), &[], &[])?;
    remove(segment)?;
    Ok(target)
}

/// Makes a Parquet file of a closed segment at `target`, without its rows from number `until` on. The segment stays.
pub(crate) fn part_until(segment: &Path, until: u64, target: &Path, more: &[(String, String)]) -> Result<Merged, StoreError> {
    let found = Part::Segment(Box::new(read(segment)?));
    write(&[found], target, Some(until), &[], more)
}

/// Makes one Parquet file of all rows of a recording, with the events of its job and what else is to be said in its metadata. The
/// recording stays as it is: [`discard`] it when the file is in the catalogue.
///
/// # Errors
/// The disk refuses; there is no file then. Damage is no error: it is said in the answer and in the file.
pub fn merge(folder: &Path, target: &Path, events: &[Event], more: &[(&str, String)]) -> Result<Merged, StoreError> {
    let mut parts = Vec::new();
    let mut unreadable = Vec::new();
    for path in paths(folder)? {
        match Part::open_either(&path)? {
            Ok(part) => parts.push(part),
            Err(what) => unreadable.push((path, what)),
        }
    }
    let mut merged = write(&parts, target, None, events, &more_of(more, &unreadable))?;
    merged.lost.extend(unreadable);
    // A Parquet file of a recording is finished here and nowhere else: what is to be built beside it (roll-ups) is built at this place,
    // from `target`, before it is catalogued.
    Ok(merged)
}

fn more_of(more: &[(&str, String)], unreadable: &[(PathBuf, String)]) -> Vec<(String, String)> {
    let mut more: Vec<(String, String)> = more.iter().map(|(k, v)| ((*k).to_owned(), v.clone())).collect();
    if !unreadable.is_empty() {
        let names: Vec<String> = unreadable
            .iter()
            .map(|(path, what)| format!("{}: {what}", name_of(path)))
            .collect();
        more.push(("toolmark.unreadable_segments".to_owned(), names.join("; ")));
    }
    more
}

/// Removes a recording that is in the catalogue, or that nobody wants.
///
/// # Errors
/// The disk refuses; calling again goes on.
pub fn discard(folder: &Path) -> Result<(), StoreError> {
    if !folder.exists() {
        return Ok(());
    }
    // From the last part to the first: killed on the way, what is left is a recording that ends early, and never one with a hole.
    for path in paths(folder)?.iter().rev() {
        remove(&path.with_extension("segment"))?;
        remove(&path.with_extension("parquet"))?;
    }
    std::fs::remove_dir_all(folder).map_err(StoreError::io("remove", folder))?;
    whole_file::sync_folder_of(folder)
}

/// The parts of a recording, in order. Where a segment and its Parquet file both stand, the file.
pub(crate) fn paths(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut by_name: BTreeMap<PathBuf, PathBuf> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(StoreError::io("read", folder))? {
        let path = entry.map_err(StoreError::io("read", folder))?.path();
        let extension = path.extension().and_then(|e| e.to_str());
        match extension {
            Some("parquet") => drop(by_name.insert(path.with_extension(""), path)),
            Some("segment") => drop(by_name.entry(path.with_extension("")).or_insert(path)),
            _ => {}
        }
    }
    Ok(by_name.into_values().collect())
}

/// Removes a file and makes that last. One that is gone already is as good.
pub(crate) fn remove(path: &Path) -> Result<(), StoreError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(StoreError::io("remove", path)(error)),
        _ => {}
    }
    whole_file::sync_folder_of(path)
}

/// Rows of a recording, wherever they stand.
pub(super) enum Part {
    Segment(Box<Recovered>),
    Parquet(PathBuf, Table),
}

impl Part {
    pub(super) fn open(path: &Path) -> Result<Part, StoreError> {
        if path.extension().is_some_and(|e| e == "parquet") {
            return Ok(Part::Parquet(path.to_owned(), Table::open(path)?));
        }
        read(path).map(|found| Part::Segment(Box::new(found)))
    }

    /// Opens a part, or its segment when that is still there and the Parquet file of it is damaged. The inner error says what is wrong
    /// with it.
    pub(super) fn open_either(path: &Path) -> Result<Result<Part, String>, StoreError> {
        let damage = |error: StoreError| match error {
            StoreError::Damaged { what, .. } | StoreError::NotARecord { what, .. } => Ok(what),
            other => Err(other),
        };
        let what = match Part::open(path) {
            Ok(part) => return Ok(Ok(part)),
            Err(error) => damage(error)?,
        };
        let segment = path.with_extension("segment");
        if segment != path && segment.exists() {
            return match Part::open(&segment) {
                Ok(part) => Ok(Ok(part)),
                Err(error) => damage(error).map(Err),
            };
        }
        Ok(Err(what))
    }

    fn path(&self) -> &Path {
        match self {
            Part::Segment(found) => &found.path,
            Part::Parquet(path, _) => path,
        }
    }

    fn schema(&self) -> SchemaRef {
        match self {
            Part::Segment(found) => SchemaRef::clone(&found.schema),
            // The writer put the file's own pairs into it.
            Part::Parquet(_, table) => table.schema().as_ref().clone().with_metadata(Default::default()).into(),
        }
    }

    fn metadata(&self) -> &BTreeMap<String, String> {
        match self {
            Part::Segment(found) => &found.metadata,
            Part::Parquet(_, table) => table.metadata(),
        }
    }

    fn first_row(&self) -> u64 {
        self.metadata().get(FIRST_ROW).and_then(|n| n.parse().ok()).unwrap_or(0)
    }

    fn gaps(&self) -> Result<Vec<Gap>, StoreError> {
        match self {
            Part::Segment(found) => Ok(found.gaps.clone()),
            Part::Parquet(path, table) => {
                let text = table.metadata().get(key::GAPS).map_or("[]", String::as_str);
                serde_json::from_str(text).map_err(|e| StoreError::Damaged {
                    path: path.clone(),
                    what: format!("its gaps: {e}"),
                })
            }
        }
    }

    fn lost(&self) -> Option<String> {
        match self {
            // A clean tail that was never acknowledged is no damage, but it is said.
            Part::Segment(found) => found.lost.as_ref().map(Lost::to_string),
            Part::Parquet(_, table) => table.metadata().get(key::LOST).cloned(),
        }
    }

    fn batches(&self) -> Result<Box<dyn Iterator<Item = Result<RecordBatch, StoreError>>>, StoreError> {
        Ok(match self {
            Part::Segment(found) => Box::new(found.batches()?),
            Part::Parquet(_, table) => Box::new(table.batches()?),
        })
    }
}

/// `part_until` is given for one part of a recording: the number of the first row that is not in it any more.
fn write(
    parts: &[Part],
    target: &Path,
    part_until: Option<u64>,
    events: &[Event],
    more: &[(String, String)],
) -> Result<Merged, StoreError> {
    let Some(first) = parts.first() else {
        return Err(StoreError::Damaged {
            path: target.to_owned(),
            what: "none of its segments is readable".to_owned(),
        });
    };
    let mut metadata = first.metadata().clone();
    let late = [
        key::ROWS,
        key::UNAVAILABLE,
        key::EVENTS,
        key::DATA,
        key::DIGEST,
        key::ARROW_SCHEMA,
        key::GAPS,
        key::LOST,
        FIRST_ROW,
    ];
    for key in late {
        metadata.remove(key);
    }
    let from = first.first_row();
    let (is_part, until) = (part_until.is_some(), part_until.unwrap_or(u64::MAX));
    if is_part {
        metadata.insert(FIRST_ROW.to_owned(), from.to_string());
    }
    let schema = first.schema();
    let mut table = TableWriter::create(target, &schema, metadata)?;
    let mut gaps: Vec<Gap> = Vec::new();
    let mut lost = Vec::new();
    let mut next = if is_part { from } else { 0 };
    let mut last_number = None;
    for part in parts {
        let (mut at, mut shut) = (part.first_row(), None);
        for batch in part.batches()? {
            let mut batch = match batch {
                Ok(batch) => batch,
                Err(StoreError::Damaged { what, .. }) => {
                    shut = Some(what);
                    break;
                }
                Err(other) => return Err(other),
            };
            if at >= until {
                break;
            }
            batch = batch.slice(0, batch.num_rows().min(usize::try_from(until - at).unwrap_or(usize::MAX)));
            let end = at + batch.num_rows() as u64;
            if end <= next {
                at = end;
                continue;
            }
            if at < next {
                batch = batch.slice((next - at) as usize, (end - next) as usize);
            } else if at > next {
                let first = number_of(&batch, 0);
                gaps.push(Gap {
                    from: last_number.map_or(next, |n: u64| n + 1),
                    to: first.map_or(at, |n| n.saturating_sub(1)),
                    count: at - next,
                    cause: Cause::Damage,
                });
            }
            last_number = number_of(&batch, batch.num_rows() - 1).or(last_number);
            table.write(&batch)?;
            (at, next) = (end, end);
        }
        // Told twice when a gap went into a second segment after the first one's sync failed.
        let new: Vec<Gap> = part.gaps()?.into_iter().filter(|gap| !gaps.contains(gap)).collect();
        gaps.extend(new);
        if let Some(what) = part.lost().or(shut) {
            lost.push((part.path().to_owned(), what));
        }
    }
    gaps.sort_by_key(|gap| gap.from);
    let mut late: Vec<(&str, String)> = more.iter().map(|(k, v)| (k.as_str(), v.clone())).collect();
    if !gaps.is_empty() {
        late.push((
            key::GAPS,
            serde_json::to_string(&gaps).expect("numbers and words are always JSON"),
        ));
    }
    if !lost.is_empty() {
        let texts: Vec<String> = lost.iter().map(|(path, what)| format!("{}: {what}", name_of(path))).collect();
        late.push((key::LOST, texts.join("; ")));
    }
    let finished = writer::finish(target, table, events, &late)?;
    Ok(Merged { finished, gaps, lost })
}

fn name_of(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

/// Tick or sequence of a row.
fn number_of(batch: &RecordBatch, row: usize) -> Option<u64> {
    let column = ["tick", "sequence"].iter().find_map(|name| batch.column_by_name(name))?;
    let column = column.as_primitive_opt::<Int64Type>()?;
    u64::try_from(column.value(row)).ok()
}

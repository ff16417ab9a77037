//! Every observation as a sink: segments while it is recorded, one Parquet file at the end.
//!
//! Beside `F.parquet` stands the folder `F.parquet.recording` with the segments, until the recording is closed. A recorder that was
//! killed is started again with the same file: it goes on in the next segment behind the last row that was acknowledged.

use super::segments::{From, Segments, disk, position_of};
use super::{Refused, Sink, Tally};
use crate::failure::Failure;
use crate::shop;
use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::session::Position;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::observations::{Reached, rows};
use store::segment::{cut, discard, merge, read};
use units::Timestamp;

/// Rows of one segment: a longer recording is several.
const SEGMENT_ROWS: u64 = 4_000_000;

/// A recording of observations in the making.
pub struct ObservationsSink {
    target: PathBuf,
    folder: PathBuf,
    segments: Segments,
}

impl ObservationsSink {
    /// Opens a recording, or goes on with one that was not closed.
    ///
    /// # Errors
    /// The file is there already, or the disk refuses, or what was begun is a recording of another agent.
    pub fn open(target: &Path, source: &str) -> Result<ObservationsSink, Failure> {
        let mut folder = target.as_os_str().to_owned();
        folder.push(".recording");
        let folder = PathBuf::from(folder);
        if target.exists() && !folder.exists() {
            return Err(Failure::usage(format_args!(
                "{}: the file is there already, and its recording was closed; give another --out",
                target.display()
            )));
        }
        let from = left_in(&folder, source)?;
        let metadata = BTreeMap::from([("toolmark.source".to_owned(), source.to_owned())]);
        let segments = Segments::begin(&folder, from, SEGMENT_ROWS, move |_| metadata.clone());
        Ok(ObservationsSink {
            target: target.to_owned(),
            folder,
            segments: segments.map_err(Refused::into_failure)?,
        })
    }
}

/// Looks at what a killed process left: cuts off what was never acknowledged, and finds the last row.
fn left_in(folder: &Path, source: &str) -> Result<From, Failure> {
    let mut from = From {
        segment: 1,
        rows: 0,
        position: None,
    };
    let mut segments = Vec::new();
    if folder.is_dir() {
        let entries = std::fs::read_dir(folder).map_err(|e| Failure::writing(folder, e))?;
        segments.extend(
            entries
                .flatten()
                .map(|e| e.path())
                .filter(|p| p.extension().is_some_and(|e| e == "segment")),
        );
    }
    segments.sort();
    for path in segments {
        let found = read(&path).map_err(shop::failure)?;
        let begun = found.metadata.get("toolmark.source").map_or("", String::as_str);
        if begun != source {
            return Err(Failure::usage(format_args!(
                "{}: a recording of {begun} was begun there, not of {source}; give another --out",
                folder.display()
            )));
        }
        if let Some(lost) = found.lost.as_ref().filter(|lost| !lost.is_unfinished_write()) {
            eprintln!("warning: {}: {lost}", path.display());
        }
        cut(&found).map_err(shop::failure)?;
        for batch in found.batches().map_err(shop::failure)? {
            let batch = batch.map_err(shop::failure)?;
            // The last row of each is enough; what comes before it has smaller numbers.
            let last = batch.slice(batch.num_rows().saturating_sub(1), batch.num_rows().min(1));
            let last = rows(&last).map_err(|what| Failure::unreadable(format_args!("{}: {what}", path.display())))?;
            from.position = last.last().map(|row| position_of(Reached::after(row))).or(from.position);
        }
        from.rows = from.rows.max(found.first_row + found.rows);
        let name = path.file_stem().and_then(|n| n.to_str()).and_then(|n| n.parse::<u32>().ok());
        from.segment = from.segment.max(name.unwrap_or(0) + 1);
    }
    Ok(from)
}

impl Sink for ObservationsSink {
    fn kept(&self) -> Option<Position> {
        self.segments.position()
    }

    fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused> {
        self.segments.observations(told, items)
    }

    fn gap(&mut self, gap: &Gap) -> Result<(), Refused> {
        self.segments.gap(gap)
    }

    fn reached(&mut self, position: Position) -> Result<(), Refused> {
        self.segments.reached(position);
        Ok(())
    }

    fn rest(&mut self) -> Result<(), Refused> {
        Ok(())
    }

    fn sync(&mut self) -> Result<(), Refused> {
        self.segments.sync()
    }

    fn close(&mut self, _now: Timestamp) -> Result<(), Refused> {
        self.segments.end()?;
        merge(&self.folder, &self.target, &[], &[]).map_err(disk)?;
        discard(&self.folder).map_err(disk)?;
        if let Ok(file) = std::fs::metadata(&self.target) {
            self.segments.set_bytes(file.len());
        }
        Ok(())
    }

    fn tally(&self) -> &Tally {
        self.segments.tally()
    }
}

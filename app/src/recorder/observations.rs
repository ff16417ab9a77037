//! Every observation as a sink: segments while it is recorded, one Parquet file at the end.
//!
//! Beside `F.parquet` stands the folder `F.parquet.recording` with the segments, until the recording is closed. A recorder that was
//! killed is started again with the same file: it goes on in the next segment behind the last row that was acknowledged.

use super::{Refused, Sink, Tally};
use crate::failure::Failure;
use crate::shop;
use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::session::Position;
use mtconnect::streams::{Category, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::StoreError;
use store::observations::{GAP, Row, batch, layout, rows};
use store::segment::{Options, RealDisk, Writer, cut, discard, merge, read};
use units::Timestamp;

/// Rows of one segment: a longer recording is several.
const SEGMENT_ROWS: u64 = 4_000_000;

/// A recording of observations in the making.
pub struct ObservationsSink {
    target: PathBuf,
    folder: PathBuf,
    metadata: BTreeMap<String, String>,
    /// The segment that is written; `None` after one had to be given up.
    writer: Option<Writer>,
    /// Number of the next segment.
    segment: u32,
    rows: u64,
    position: Option<Position>,
    tally: Tally,
    /// What is on the medium.
    synced: (u64, Option<Position>, Tally),
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
        let mut sink = ObservationsSink {
            target: target.to_owned(),
            folder,
            metadata: BTreeMap::from([("toolmark.source".to_owned(), source.to_owned())]),
            writer: None,
            segment: 1,
            rows: 0,
            position: None,
            tally: Tally::default(),
            synced: (0, None, Tally::default()),
        };
        sink.recover(source)?;
        sink.begin().map_err(|refused| match refused {
            Refused::Disk(why) => Failure::machine(why),
            Refused::Never(failure) => failure,
        })?;
        sink.synced.0 = sink.rows;
        sink.synced.1 = sink.position;
        Ok(sink)
    }

    /// Looks at what a killed process left: cuts off what was never acknowledged, and finds the last row.
    fn recover(&mut self, source: &str) -> Result<(), Failure> {
        let mut segments = Vec::new();
        if self.folder.is_dir() {
            let entries = std::fs::read_dir(&self.folder).map_err(|e| Failure::writing(&self.folder, e))?;
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
            let from = found.metadata.get("toolmark.source").map_or("", String::as_str);
            if from != source {
                return Err(Failure::usage(format_args!(
                    "{}: a recording of {from} was begun there, not of {source}; give another --out",
                    self.folder.display()
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
                self.position = last.last().map(position_after).or(self.position);
            }
            self.rows = self.rows.max(found.first_row + found.rows);
            let name = path.file_stem().and_then(|n| n.to_str()).and_then(|n| n.parse::<u32>().ok());
            self.segment = self.segment.max(name.unwrap_or(0) + 1);
        }
        Ok(())
    }

    fn begin(&mut self) -> Result<&mut Writer, Refused> {
        if self.writer.as_ref().is_some_and(|w| w.rows() - w.first_row() > SEGMENT_ROWS)
            && let Some(mut full) = self.writer.take()
        {
            full.end().map_err(disk)?;
        }
        let writer = match self.writer.take() {
            Some(writer) => writer,
            None => {
                let path = self.folder.join(format!("{:04}.segment", self.segment));
                let options = Options {
                    first_row: self.rows,
                    ..Options::default()
                };
                let begun = Writer::begin(&RealDisk, &path, &layout().schema(), &self.metadata, &options).map_err(disk)?;
                self.segment += 1;
                begun
            }
        };
        Ok(self.writer.insert(writer))
    }

    fn append(&mut self, new: &[Row<'_>]) -> Result<(), Refused> {
        let columns = batch(new, &self.folder).map_err(|e| Refused::Never(shop::failure(e)))?;
        let appended = self.begin().and_then(|writer| writer.append(&columns).map_err(disk));
        if appended.is_err() {
            self.give_up();
        }
        appended?;
        self.rows += new.len() as u64;
        Ok(())
    }

    /// What was acknowledged stands; the rest is asked for again, and goes into a segment of its own.
    fn give_up(&mut self) {
        if let Some(writer) = self.writer.take() {
            // Frames that are whole and were never acknowledged would come twice.
            let file = std::fs::File::options().write(true).open(writer.path());
            let cut = file.and_then(|file| file.set_len(writer.bytes()));
            if let Err(error) = cut {
                eprintln!("warning: {}: {error}", writer.path().display());
            }
        }
        let tally = self.synced.2.clone();
        (self.rows, self.position, self.tally) = (self.synced.0, self.synced.1, tally);
    }
}

impl Sink for ObservationsSink {
    fn kept(&self) -> Option<Position> {
        self.position
    }

    fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused> {
        let new: Vec<Row<'_>> = told.iter().map(|t| row_of(t, items)).collect();
        self.append(&new)?;
        for t in told {
            self.tally.count(t.instance, t.sequence, t.at);
        }
        self.position = new.last().map(position_after).or(self.position);
        Ok(())
    }

    fn gap(&mut self, gap: &Gap) -> Result<(), Refused> {
        let said = serde_json::json!({
            "to_sequence": gap.to_sequence,
            "from": gap.from.map(crate::clock::utc),
            "to": gap.to.map(crate::clock::utc),
        });
        let mut texts: [std::borrow::Cow<'_, str>; 10] = Default::default();
        texts[7] = gap.cause.word().into();
        texts[9] = GAP.into();
        let row = Row {
            at: gap.from.or(gap.to).unwrap_or(Timestamp(0)),
            sequence: gap.from_sequence,
            instance: gap.instance,
            texts,
            text: Some(said.to_string().into()),
            condition: None,
            attributes: None,
        };
        self.append(&[row])?;
        self.tally.gaps.push(gap.clone());
        Ok(())
    }

    fn reached(&mut self, position: Position) -> Result<(), Refused> {
        self.position = Some(position);
        Ok(())
    }

    fn rest(&mut self) -> Result<(), Refused> {
        Ok(())
    }

    fn sync(&mut self) -> Result<(), Refused> {
        if self.rows > self.synced.0 || self.position != self.synced.1 {
            let synced = self
                .begin()
                .and_then(|writer| writer.sync().map(|_| writer.bytes()).map_err(disk));
            if synced.is_err() {
                self.give_up();
            }
            self.tally.bytes = synced?;
            self.synced = (self.rows, self.position, self.tally.clone());
        }
        Ok(())
    }

    fn close(&mut self, _now: Timestamp) -> Result<(), Refused> {
        self.sync()?;
        if let Some(mut writer) = self.writer.take() {
            writer.end().map_err(disk)?;
        }
        merge(&self.folder, &self.target, &[], &[]).map_err(disk)?;
        discard(&self.folder).map_err(disk)?;
        self.tally.bytes = std::fs::metadata(&self.target).map_or(self.tally.bytes, |m| m.len());
        Ok(())
    }

    fn tally(&self) -> &Tally {
        &self.tally
    }
}

fn disk(error: StoreError) -> Refused {
    Refused::Disk(shop::failure(error).message.trim_start_matches("error: ").to_owned())
}

/// Where a recording goes on behind a row.
fn position_after(row: &Row<'_>) -> Position {
    // A gap's row has the first missing number; how far it goes is in its text. To an unknown end: the agent was started anew.
    let to = row.text.as_deref().filter(|_| row.texts[9] == GAP);
    let to = to.and_then(|text| serde_json::from_str::<serde_json::Value>(text).ok());
    let next = match to {
        Some(said) => said["to_sequence"].as_u64().map_or(row.sequence, |to| to + 1),
        None => row.sequence + 1,
    };
    Position {
        instance: row.instance,
        next,
        last: Some(row.at),
    }
}

fn row_of<'a>(told: &'a Told, items: &'a Items) -> Row<'a> {
    let item = items.get(told.item);
    let category = match item.category {
        Category::Sample => "SAMPLE",
        Category::Event => "EVENT",
        Category::Condition => "CONDITION",
    };
    let source = &item.source;
    Row {
        at: told.at,
        sequence: told.sequence,
        instance: told.instance,
        texts: [
            &source.device,
            &source.device_uuid,
            &source.component,
            &source.name,
            &source.id,
            &item.id,
            &item.name,
            &item.kind,
            &item.sub_type,
            category,
        ]
        .map(|text: &str| text.into()),
        text: match &told.value {
            Value::Unavailable => None,
            Value::Text(text) => Some(text.into()),
        },
        condition: told.level.map(|level| level.word().into()),
        attributes: (!told.attributes.is_empty()).then(|| told.attributes.as_str().into()),
    }
}

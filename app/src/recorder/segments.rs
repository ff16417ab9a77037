//! Observations on their way to the disk: a row of segments in a folder, whatever becomes of them at the end.

use super::{Refused, Tally};
use crate::{clock, shop};
use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::session::Position;
use mtconnect::streams::{Category, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::StoreError;
use store::observations::{GAP, Reached, Row, batch, layout};
use store::segment::{Options, RealDisk, Writer};
use units::Timestamp;

/// Segments being written. What is acknowledged is on the medium; after a refusal of the disk everything is as it was at the last
/// acknowledgement.
pub struct Segments {
    folder: PathBuf,
    /// What a segment says about itself, by the moment at which it is begun.
    metadata: Box<dyn Fn(Timestamp) -> BTreeMap<String, String>>,
    /// Rows after which a segment is closed.
    longest: u64,
    /// The segment that is written; `None` after one was closed or had to be given up.
    writer: Option<Writer>,
    /// Number of the next segment.
    next: u32,
    rows: u64,
    position: Option<Position>,
    tally: Tally,
    /// What is on the medium.
    synced: (u64, Option<Position>, Tally),
    closed: Vec<Closed>,
    closed_bytes: u64,
}

/// A segment that nothing is added to any more.
#[derive(Clone, Debug)]
pub struct Closed {
    /// Where.
    pub path: PathBuf,
    /// The number of the first row that is not in it, or stands in a later one.
    pub until: u64,
}

/// Where a recording is taken up.
#[derive(Clone, Copy, Debug)]
pub struct From {
    /// Number of the next segment.
    pub segment: u32,
    /// Number of the next row.
    pub rows: u64,
    /// How far the agent was recorded.
    pub position: Option<Position>,
}

impl Segments {
    /// Begins the first segment.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn begin(
        folder: &Path,
        from: From,
        longest: u64,
        metadata: impl Fn(Timestamp) -> BTreeMap<String, String> + 'static,
    ) -> Result<Segments, Refused> {
        let mut segments = Segments {
            folder: folder.to_owned(),
            metadata: Box::new(metadata),
            longest,
            writer: None,
            next: from.segment,
            rows: from.rows,
            position: from.position,
            tally: Tally::default(),
            synced: (from.rows, from.position, Tally::default()),
            closed: Vec::new(),
            closed_bytes: 0,
        };
        segments.open()?;
        Ok(segments)
    }

    /// How far the recording is.
    pub fn position(&self) -> Option<Position> {
        self.position
    }

    /// What was kept.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// For whoever knows better how many bytes there are.
    pub fn set_bytes(&mut self, bytes: u64) {
        self.tally.bytes = bytes;
    }

    /// Segments that were closed since this was asked last, oldest first.
    pub fn take_closed(&mut self) -> Vec<Closed> {
        std::mem::take(&mut self.closed)
    }

    /// As [`super::Sink::observations`].
    ///
    /// # Errors
    /// None of them is kept then.
    pub fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused> {
        let new: Vec<Row<'_>> = told.iter().map(|t| row_of(t, items)).collect();
        self.append(&new)?;
        for t in told {
            self.tally.count(t.instance, t.sequence, t.at);
        }
        self.position = new.last().map(|row| position_of(Reached::after(row))).or(self.position);
        Ok(())
    }

    /// As [`super::Sink::gap`].
    ///
    /// # Errors
    /// It is not kept then.
    pub fn gap(&mut self, gap: &Gap) -> Result<(), Refused> {
        let said = serde_json::json!({
            "to_sequence": gap.to_sequence,
            "from": gap.from.map(clock::utc),
            "to": gap.to.map(clock::utc),
        });
        let mut texts: [std::borrow::Cow<'_, str>; 10] = Default::default();
        texts[7] = gap.cause.word().into();
        texts[9] = GAP.into();
        let now = || clock::start_time(None).map_err(Refused::Never);
        let row = Row {
            at: gap.from.or(gap.to).map_or_else(now, Ok)?,
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

    /// The agent has told everything up to there.
    pub fn reached(&mut self, position: Position) {
        self.position = Some(position);
    }

    /// As [`super::Sink::sync`]; closes the segment when it is long enough.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn sync(&mut self) -> Result<(), Refused> {
        if self.rows > self.synced.0 {
            let synced = self
                .open()
                .and_then(|writer| writer.sync().map(|_| writer.bytes()).map_err(disk));
            if synced.is_err() {
                self.give_up();
            }
            self.tally.bytes = self.closed_bytes + synced?;
        }
        self.synced = (self.rows, self.position, self.tally.clone());
        if self.writer.as_ref().is_some_and(|w| w.rows() - w.first_row() >= self.longest) {
            self.close_segment();
        }
        Ok(())
    }

    /// Makes everything last and closes the segment in work.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn end(&mut self) -> Result<(), Refused> {
        self.sync()?;
        self.close_segment();
        Ok(())
    }

    fn open(&mut self) -> Result<&mut Writer, Refused> {
        let writer = match self.writer.take() {
            Some(writer) => writer,
            None => {
                let path = self.folder.join(format!("{:04}.segment", self.next));
                let options = Options {
                    first_row: self.rows,
                    ..Options::default()
                };
                let metadata = (self.metadata)(clock::start_time(None).map_err(Refused::Never)?);
                let begun = Writer::begin(&RealDisk, &path, &layout().schema(), &metadata, &options).map_err(disk)?;
                self.next += 1;
                begun
            }
        };
        Ok(self.writer.insert(writer))
    }

    fn append(&mut self, new: &[Row<'_>]) -> Result<(), Refused> {
        let columns = batch(new, &self.folder).map_err(|e| Refused::Never(shop::failure(e)))?;
        let appended = self.open().and_then(|writer| writer.append(&columns).map_err(disk));
        if appended.is_err() {
            self.give_up();
        }
        appended?;
        self.rows += new.len() as u64;
        Ok(())
    }

    /// After a sync: nothing in it waits.
    fn close_segment(&mut self) {
        if let Some(mut writer) = self.writer.take() {
            let bytes = writer.bytes();
            if writer.end().is_err() {
                // Every row of it is on the medium; that there is no more room for its last frame takes nothing away.
                cut(&writer, bytes);
            }
            self.closed_bytes += bytes;
            self.closed.push(Closed {
                path: writer.path().to_owned(),
                until: self.synced.0,
            });
        }
    }

    /// What was acknowledged stands; the rest is asked for again, and goes into a segment of its own.
    fn give_up(&mut self) {
        if let Some(writer) = self.writer.take() {
            // Frames that are whole and were never acknowledged would come twice.
            cut(&writer, writer.bytes());
            self.closed_bytes += writer.bytes();
            self.closed.push(Closed {
                path: writer.path().to_owned(),
                until: self.synced.0,
            });
        }
        (self.rows, self.position, self.tally) = self.synced.clone();
    }
}

fn cut(writer: &Writer, bytes: u64) {
    let file = std::fs::File::options().write(true).open(writer.path());
    if let Err(error) = file.and_then(|file| file.set_len(bytes)) {
        eprintln!("warning: {}: {error}", writer.path().display());
    }
}

/// What the store says, as a sink says it.
pub fn disk(error: StoreError) -> Refused {
    Refused::Disk(shop::failure(error).message.trim_start_matches("error: ").to_owned())
}

/// A position in the words of the client.
pub fn position_of(reached: Reached) -> Position {
    Position {
        instance: reached.instance,
        next: reached.next,
        last: reached.last,
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

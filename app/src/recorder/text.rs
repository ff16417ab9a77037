//! The text form as a sink: one position a line, each on the disk as it comes.
//!
//! The file alone says where a recording goes on: its last whole line, and the start of the agent that it belongs to. So a recorder that
//! was killed is simply started again.

use super::{Refused, Sink, Tally};
use crate::failure::Failure;
use mtconnect::TextWriter;
use mtconnect::TrackPoint;
use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::live::{LivePlaces, Place};
use mtconnect::client::session::Position;
use mtconnect::text::HEAD;
use plan::{Diagnostic, Diagnostics};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// A text recording in the making.
pub struct TextSink {
    path: PathBuf,
    file: File,
    source: String,
    /// What is in the file.
    state: State,
    /// What is on the medium of it.
    synced: State,
    dirty: bool,
    diagnostics: Diagnostics,
}

/// Everything that is taken back when a write fails.
#[derive(Clone, Debug, Default)]
struct State {
    length: u64,
    position: Option<Position>,
    /// `None` before the first line, which gives the start.
    writer: Option<TextWriter>,
    places: LivePlaces,
    /// The start of the agent that the last rows belong to, as the file says.
    instance: Option<u64>,
    /// The start of the agent that observations come from.
    told_instance: u64,
    /// Lines that wait for the first one.
    before_head: String,
    item: String,
    tally: Tally,
}

impl TextSink {
    /// Opens a recording, or goes on with one. `source` is what its first line says about where it comes from.
    ///
    /// # Errors
    /// The file cannot be written, or is no recording of that source.
    pub fn open(path: &Path, source: &str) -> Result<TextSink, Failure> {
        let writing = |e| Failure::writing(path, e);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(writing)?;
        let state = recovered(path, &file, source)?;
        // What was cut off by a kill was never acknowledged, and comes again.
        file.set_len(state.length).map_err(writing)?;
        file.sync_all().map_err(writing)?;
        if let Some(folder) = path.parent() {
            let folder = if folder.as_os_str().is_empty() {
                Path::new(".")
            } else {
                folder
            };
            File::open(folder).and_then(|f| f.sync_all()).map_err(writing)?;
        }
        Ok(TextSink {
            path: path.to_owned(),
            file,
            source: source.to_owned(),
            synced: state.clone(),
            state,
            dirty: false,
            diagnostics: Diagnostics::new(),
        })
    }

    /// Writes what `next` has to say, and takes it over when that went well.
    fn write(&mut self, mut next: State, lines: &str) -> Result<(), Refused> {
        if let Err(error) = self.file.write_all_at(lines.as_bytes(), self.state.length) {
            // Whatever half of a line is there: it goes, now or with the next write.
            let _ = self.file.set_len(self.state.length);
            return Err(Refused::Disk(format!("{}: {error}", self.path.display())));
        }
        next.length += lines.len() as u64;
        next.tally.bytes += lines.len() as u64;
        self.dirty |= !lines.is_empty();
        self.state = next;
        Ok(())
    }

    fn row(next: &mut State, source: &str, place: &Place, lines: &mut String) {
        if next.writer.is_none() {
            let (writer, head) = TextWriter::begin(None, place.at, source);
            lines.push_str(&head);
            lines.push_str(&std::mem::take(&mut next.before_head));
            next.writer = Some(writer);
        }
        if next.instance != Some(next.told_instance) {
            lines.push_str(&TextWriter::instance(next.told_instance, &next.item));
            next.instance = Some(next.told_instance);
        }
        if let Some(writer) = &mut next.writer {
            lines.push_str(&match place.position {
                Some(position) => writer.point(&TrackPoint {
                    at: place.at,
                    position,
                    sequence: place.sequence,
                }),
                None => writer.unavailable(place.at, place.sequence),
            });
        }
        next.tally.count(next.told_instance, place.sequence, place.at);
    }
}

impl Sink for TextSink {
    fn kept(&self) -> Option<Position> {
        self.state.position
    }

    fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused> {
        let mut next = self.state.clone();
        let mut lines = String::new();
        let chosen = next.places.choose(items, &mut self.diagnostics);
        next.item = chosen.map_err(|why| Refused::Never(Failure::unreadable(why)))?;
        for t in told {
            if t.instance != next.told_instance {
                // Places of the agent before are complete: no more axes come for them.
                if let Some(place) = next.places.rest() {
                    Self::row(&mut next, &self.source, &place, &mut lines);
                }
                next.places.forget();
                next.told_instance = t.instance;
            }
            if let Some(place) = next.places.take(t, items, &mut self.diagnostics) {
                Self::row(&mut next, &self.source, &place, &mut lines);
            }
            next.position = Some(Position {
                instance: t.instance,
                next: t.sequence + 1,
                last: Some(t.at),
            });
        }
        self.write(next, &lines)
    }

    fn gap(&mut self, gap: &Gap) -> Result<(), Refused> {
        let mut next = self.state.clone();
        let mut lines = String::new();
        if let Some(place) = next.places.rest() {
            Self::row(&mut next, &self.source, &place, &mut lines);
        }
        let line = TextWriter::gap(gap);
        if next.writer.is_some() {
            lines.push_str(&line);
        } else {
            next.before_head.push_str(&line);
        }
        if let (Some(to), Some(position)) = (gap.to_sequence, &mut next.position)
            && position.instance == gap.instance
        {
            position.next = position.next.max(to + 1);
        }
        next.tally.gaps.push(gap.clone());
        self.write(next, &lines)
    }

    fn reached(&mut self, position: Position) -> Result<(), Refused> {
        self.state.position = Some(position);
        Ok(())
    }

    fn rest(&mut self) -> Result<(), Refused> {
        let mut next = self.state.clone();
        let Some(place) = next.places.rest() else { return Ok(()) };
        let mut lines = String::new();
        Self::row(&mut next, &self.source, &place, &mut lines);
        self.write(next, &lines)
    }

    fn sync(&mut self) -> Result<(), Refused> {
        if self.dirty
            && let Err(error) = self.file.sync_data()
        {
            // What did not get there is asked for again.
            self.state = self.synced.clone();
            let _ = self.file.set_len(self.state.length);
            return Err(Refused::Disk(format!("{}: {error}", self.path.display())));
        }
        self.dirty = false;
        self.synced = self.state.clone();
        Ok(())
    }

    fn close(&mut self, now: Timestamp) -> Result<(), Refused> {
        self.rest()?;
        let mut next = self.state.clone();
        if next.writer.is_none() && !next.before_head.is_empty() {
            let (writer, mut lines) = TextWriter::begin(None, now, &self.source);
            lines.push_str(&std::mem::take(&mut next.before_head));
            next.writer = Some(writer);
            self.write(next, &lines)?;
        }
        self.sync()
    }

    fn tally(&self) -> &Tally {
        &self.state.tally
    }

    fn remarks(&self) -> &[Diagnostic] {
        self.diagnostics.as_slice()
    }
}

/// What a file holds already: up to its last whole line.
fn recovered(path: &Path, file: &File, source: &str) -> Result<State, Failure> {
    let mut state = State::default();
    let mut reader = BufReader::new(file);
    let mut line = Vec::new();
    let (mut number, mut time, mut last_row) = (0u32, None::<i128>, None::<[f64; 3]>);
    loop {
        line.clear();
        let count = reader
            .read_until(b'\n', &mut line)
            .map_err(|e| Failure::unreadable(format_args!("{}: {e}", path.display())))?;
        if count == 0 || line.last() != Some(&b'\n') {
            break;
        }
        number += 1;
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end();
        let not_ours = |what: &str| {
            Failure::usage(format_args!(
                "{}:{number}:1: {what}; give another --out, or take this file away",
                path.display()
            ))
        };
        if number == 1 {
            let head = text
                .strip_prefix(HEAD)
                .ok_or_else(|| not_ours("the file is there already and is no text recording of ours"))?;
            let (words, from) = head.split_once("source=").unwrap_or((head, ""));
            if from != source {
                return Err(not_ours(&format!("the file is a recording of {from}, not of {source}")));
            }
            let start = words.split_whitespace().find_map(|w| w.strip_prefix("start="));
            let start = start.and_then(mtconnect::instant::parse);
            time = Some(
                start
                    .ok_or_else(|| not_ours("its first line does not say when it began"))?
                    .0
                    .into(),
            );
        } else if let Some(words) = text.strip_prefix("# instance=") {
            let (instance, item) = words.split_once(" item=").unwrap_or((words, ""));
            state.instance = instance.trim().parse().ok();
            state.item = item.to_owned();
            last_row = None;
        } else if let (Some(words), Some(position)) = (text.strip_prefix("# gap "), &mut state.position) {
            let value = |name: &str| {
                words
                    .split_whitespace()
                    .find_map(|w| w.strip_prefix(name)?.parse::<u64>().ok())
            };
            if let (Some(instance), Some(to)) = (value("instance="), value("to_sequence="))
                && instance == position.instance
            {
                position.next = position.next.max(to + 1);
            }
        } else if !text.starts_with('#') {
            let (dt, sequence, position) =
                mtconnect::text::row(text).ok_or_else(|| not_ours("this line is no row of a recording"))?;
            let instance = state
                .instance
                .ok_or_else(|| not_ours("no line before says which agent this row is of"))?;
            let at = time.unwrap_or(0) + dt;
            time = Some(at);
            last_row = position;
            let at = i64::try_from(at).map_err(|_| not_ours("the times add up to more than 292 years"))?;
            state.position = Some(Position {
                instance,
                next: sequence + 1,
                last: Some(Timestamp(at)),
            });
        }
        state.length += line.len() as u64;
    }
    if let Some(time) = time {
        state.writer = Some(TextWriter::resume(Timestamp(i64::try_from(time).unwrap_or(0))));
    }
    if !state.item.is_empty() {
        state.places = LivePlaces::resume(&state.item, last_row);
    }
    state.told_instance = state.instance.unwrap_or(0);
    Ok(state)
}

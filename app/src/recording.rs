//! Recordings from disk: our own Parquet, or whatever `mtconnect` reads.

use crate::cli::{DisplayUnits, FrameName};
use crate::failure::Failure;
use crate::shop;
use asrun::{InForce, RecordFrame, RecordGap, RecordPoint, Recording};
use mtconnect::streams::{Category, Observation, Source, Streams, Value};
use mtconnect::{GapCause, LengthUnit, ReadOptions, Reading, StatedFrame};
use plan::{Diagnostic, Severity};
use std::collections::BTreeMap;
use std::path::Path;
use store::{StoreError, observations};
use units::{StepId, Timestamp};

/// What a person says about a recording that it may not say itself.
#[derive(Clone, Debug, Default)]
pub struct Said {
    /// The frame of its positions.
    pub frame: Option<FrameName>,
    /// The unit of its numbers.
    pub units: Option<DisplayUnits>,
    /// The device whose positions count.
    pub device: Option<String>,
}

/// Reads a recording of any form.
///
/// # Errors
/// It is not there, or nothing in it can be used.
pub fn read(path: &Path, said: &Said) -> Result<(Recording, Vec<Diagnostic>), Failure> {
    let name = path
        .file_name()
        .map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let unreadable = |error: &dyn std::fmt::Display| Failure::unreadable(format_args!("{}: {error}", path.display()));
    let bytes = std::fs::read(path).map_err(|e| unreadable(&e))?;
    if bytes.is_empty() {
        return Err(Failure::unreadable(format_args!(
            "{}:1:1: the file is empty; a recording was expected",
            path.display()
        )));
    }
    if bytes.starts_with(b"PAR1") {
        drop(bytes);
        // What cannot be opened at all is named by the reader of records below.
        if let Ok(table) = store::Table::open(path)
            && store::observations::is_of_observations(&table)
        {
            let mut gathered = Gathered::default();
            gathered.add(&table, path)?;
            let (streams, lost) = gathered.finish();
            let reading = mtconnect::of_observations(&streams, &name, &options_of(said));
            let (mut recording, diagnostics) = recording_of(reading, path, &name, said)?;
            recording.gaps.extend(lost);
            recording.gaps.sort_by_key(|g| g.from);
            return Ok((recording, diagnostics));
        }
        if said.frame == Some(FrameName::Setup) || said.device.is_some() {
            return Err(Failure::usage(format_args!(
                "{}: it is a record of one machine, in machine positions; leave --frame setup and --device out",
                path.display()
            )));
        }
        return Ok((of_record(path)?, vec![]));
    }
    recording_of(mtconnect::read(&bytes, &name, &options_of(said)), path, &name, said)
}

/// Reads what a job of the data directory recorded, all its files as one.
///
/// # Errors
/// There is no such job, or nothing of it can be used.
pub fn read_job(root: &Path, job: &str, said: &Said) -> Result<(Recording, Vec<Diagnostic>), Failure> {
    let (files, gone) = crate::commands::trace::record_files(root, job)?;
    for what in gone {
        eprintln!("warning: {what}");
    }
    let mut gathered = Gathered::default();
    for file in &files {
        match store::Table::open(file) {
            Ok(table) if observations::is_of_observations(&table) => gathered.add(&table, file)?,
            // The record of a run is one file.
            Ok(_) | Err(StoreError::NotARecord { .. }) => return read(file, said),
            Err(error) => return Err(shop::failure(error)),
        }
    }
    let (streams, lost) = gathered.finish();
    let name = format!("job {job}");
    let reading = mtconnect::of_observations(&streams, &name, &options_of(said));
    let (mut recording, diagnostics) = recording_of(reading, Path::new(&name), &name, said)?;
    recording.gaps.extend(lost);
    recording.gaps.sort_by_key(|g| g.from);
    Ok((recording, diagnostics))
}

fn options_of(said: &Said) -> ReadOptions {
    ReadOptions {
        unit: said.units.map(|u| {
            if u == DisplayUnits::Inch {
                LengthUnit::Inch
            } else {
                LengthUnit::Millimetre
            }
        }),
        frame: said.frame.map(|f| {
            if f == FrameName::Machine {
                StatedFrame::Machine
            } else {
                StatedFrame::Setup
            }
        }),
        item: None,
        device: said.device.clone(),
    }
}

/// What was read, for the rebuilding.
fn recording_of(reading: Reading, path: &Path, name: &str, said: &Said) -> Result<(Recording, Vec<Diagnostic>), Failure> {
    let diagnostics = reading.diagnostics.as_slice().to_vec();
    let track = reading.track;
    if track.points.is_empty() {
        let worst = diagnostics
            .iter()
            .find(|d| d.severity == Severity::Error)
            .or(diagnostics.first());
        let message = worst.map_or_else(
            || format!("error: {}: no positions in it", path.display()),
            ToString::to_string,
        );
        return Err(Failure {
            exit: crate::failure::Exit::Unreadable,
            message,
        });
    }
    let frame = match said.frame {
        Some(FrameName::Machine) => RecordFrame::Machine,
        Some(FrameName::Setup) => RecordFrame::Setup,
        None => match track.frame {
            Some(StatedFrame::Machine) => RecordFrame::Machine,
            Some(StatedFrame::Setup) => RecordFrame::Setup,
            None => RecordFrame::Unknown,
        },
    };
    // The track is in order; an agent's own numbers begin again when the agent does.
    let point = |(k, p): (usize, &mtconnect::TrackPoint)| RecordPoint {
        at: p.at,
        position: p.position,
        step: StepId::NONE,
        sequence: k as u64 + 1,
    };
    let gap = |g: &mtconnect::Gap| RecordGap {
        from: g.from,
        to: g.to,
        cause: match g.cause {
            GapCause::Unavailable => "the agent said UNAVAILABLE".to_owned(),
            GapCause::Silent => "nothing was told".to_owned(),
            GapCause::Lost => "the recorder could not have it".to_owned(),
        },
    };
    let recording = Recording {
        points: track.points.iter().enumerate().map(point).collect(),
        frame,
        source: if track.source.is_empty() {
            name.to_owned()
        } else {
            track.source.clone()
        },
        simulated: false,
        gaps: track.gaps.iter().map(gap).collect(),
        events: vec![],
    };
    Ok((recording, diagnostics))
}

/// Observations of tables as a streams document has them, and the gaps among them.
#[derive(Default)]
struct Gathered {
    streams: Streams,
    sources: BTreeMap<Source, usize>,
    lost: Vec<RecordGap>,
    /// Starts of the agent.
    start: u32,
    instance: Option<u64>,
    last: Option<Timestamp>,
    /// A gap lasts until the next observation.
    open: Option<RecordGap>,
    /// The number of the next row, where there was one.
    next_row: Option<u64>,
}

impl Gathered {
    /// Adds the next file of a recording.
    fn add(&mut self, table: &store::Table, path: &Path) -> Result<(), Failure> {
        let unreadable = |what: String| Failure::unreadable(format_args!("{}: {what}", path.display()));
        if self.next_row.is_some_and(|next| next != table.first_row())
            && let Some(last) = self.last
        {
            self.open
                .get_or_insert(gap_from(last, last, "rows of the recording are not there any more"));
        }
        self.next_row = Some(table.first_row() + table.len());
        for batch in table.batches().map_err(shop::failure)? {
            let batch = batch.map_err(shop::failure)?;
            for row in observations::rows(&batch).map_err(unreadable)? {
                self.take(row).map_err(unreadable)?;
            }
        }
        Ok(())
    }

    fn take(&mut self, row: observations::Row<'static>) -> Result<(), String> {
        let [
            device,
            device_uuid,
            component,
            component_name,
            component_id,
            item,
            name,
            kind,
            sub_type,
            category,
        ] = row.texts.map(std::borrow::Cow::into_owned);
        if category == observations::GAP {
            // An agent that was started anew may even keep its instance id.
            if kind == "agent-restart" {
                self.start += 1;
                self.instance = None;
            }
            let why = format!("the recorder could not have it ({kind})");
            let from = self.last.unwrap_or(row.at);
            self.open.get_or_insert(gap_from(from, row.at, &why));
            return Ok(());
        }
        if self.instance.is_some_and(|before| before != row.instance) {
            self.start += 1;
        }
        self.instance = Some(row.instance);
        self.last = Some(row.at);
        self.lost.extend(self.open.take().map(|gap| RecordGap { to: row.at, ..gap }));
        let source = Source {
            device,
            device_uuid,
            component,
            name: component_name,
            id: component_id,
        };
        let streams = &mut self.streams;
        let next = streams.sources.len();
        let source = *self.sources.entry(source).or_insert_with_key(|source| {
            streams.sources.push(source.clone());
            next
        });
        let category = match category.as_str() {
            "SAMPLE" => Category::Sample,
            "EVENT" => Category::Event,
            "CONDITION" => Category::Condition,
            other => return Err(format!("an observation has the category {other}")),
        };
        streams.observations.push(Observation {
            sequence: row.sequence,
            instance: self.start,
            at: row.at,
            category,
            kind,
            sub_type,
            item,
            name,
            source,
            value: row.text.map_or(Value::Unavailable, |text| Value::Text(text.into_owned())),
            place: (0, 0),
        });
        Ok(())
    }

    fn finish(mut self) -> (Streams, Vec<RecordGap>) {
        self.lost.extend(self.open);
        (self.streams, self.lost)
    }
}

fn gap_from(from: Timestamp, to: Timestamp, cause: &str) -> RecordGap {
    RecordGap {
        from,
        to,
        cause: cause.to_owned(),
    }
}

/// Reads a record that we wrote.
///
/// # Errors
/// It is damaged, or no record of ours.
pub fn of_record(path: &Path) -> Result<Recording, Failure> {
    let reader = store::record::Reader::open(path).map_err(shop::failure)?;
    let header = reader.header().clone();
    let mut points = Vec::with_capacity(usize::try_from(reader.len()).unwrap_or(0));
    let mut missing = 0u64;
    for row in reader.rows().map_err(shop::failure)? {
        let row = row.map_err(shop::failure)?;
        match row.actual {
            Some(position) => points.push(RecordPoint {
                at: row.at,
                position,
                step: row.step,
                sequence: row.tick.0,
            }),
            None => missing += 1,
        }
    }
    let mut events = vec![];
    for event in reader.events().map_err(shop::failure)? {
        match InForce::from_event(&event.kind, &event.detail, event.at()) {
            None => {}
            Some(Ok(setting)) => events.push(setting),
            Some(Err(found)) => return Err(Failure::unreadable(format_args!("{}: {found}", path.display()))),
        }
    }
    if missing > 0 {
        eprintln!(
            "warning: {}: {missing} rows have no position; they are left out",
            path.display()
        );
    }
    let source = if header.simulated {
        format!("SIMULATED {} seed {}", header.machine, header.seed)
    } else {
        header.machine.clone()
    };
    Ok(Recording {
        points,
        frame: RecordFrame::Machine,
        source,
        simulated: header.simulated,
        gaps: vec![],
        events,
    })
}

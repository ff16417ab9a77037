//! Every observation into the data directory as a sink: a recording without end, in files that are whole one by one.
//!
//! A segment that is full is compacted to its Parquet file by a thread of its own, and catalogued with how far the recording is, while
//! the next segment is written. What a killed process left is made the same by the next one that opens the data directory.

use super::segments::{Closed, From, Segments, disk, position_of};
use super::{Refused, Sink, Tally};
use crate::shop;
use crate::{clock, failure::Failure};
use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::session::Position;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};
use store::observations::Reached;
use store::{DataDirectory, Ending, Job, JobId, MachineFile, NewRecording, Part, Recorded, StoreError};
use units::Timestamp;

/// Pause before a segment is compacted again whose Parquet file the disk refused.
const PAUSE: Duration = Duration::from_secs(5);
/// How often old records are looked for while a recording goes on.
const RETAIN: Duration = Duration::from_secs(3600);

/// A recording in the data directory.
pub struct StoreSink {
    directory: DataDirectory,
    of: Recorded,
    /// The device, where the address or an earlier recording names it; else the first observation does.
    device: Option<String>,
    who: String,
    machine: MachineFile,
    rows_of_a_file: u64,
    /// Where an earlier recording of the same agent ended.
    from: Option<(JobId, Reached)>,
    /// How far the agent had told everything before there was something to be kept.
    reached: Option<Position>,
    /// Gaps before the first observation: there is no job yet that they could be kept in.
    early: Vec<Gap>,
    /// A job whose first segment the disk refused.
    refused: Option<Job>,
    open: Option<Open>,
    tally: Tally,
    retained: Instant,
}

/// A recording that has begun.
struct Open {
    job: Job,
    segments: Segments,
    waiting: VecDeque<Closed>,
    at_work: Option<(Closed, Receiver<Result<Part, StoreError>>)>,
    /// After a refusal.
    not_before: Option<Instant>,
    files: Vec<PathBuf>,
}

/// What a recording needs to know.
pub struct Wanted {
    /// What is recorded.
    pub of: Recorded,
    /// The device in the address.
    pub device: Option<String>,
    /// Who records.
    pub who: String,
    /// The machine file with the ages of records.
    pub machine: MachineFile,
    /// Rows of one file.
    pub rows_of_a_file: u64,
}

impl StoreSink {
    /// Goes on where the last recording of the same agent ended. Nothing is written before the agent tells something.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn open(directory: DataDirectory, wanted: Wanted) -> Result<StoreSink, Failure> {
        let from = directory.recording_reached(&wanted.of).map_err(shop::failure)?;
        let before = from.map(|(job, _)| directory.job(job)).transpose().map_err(shop::failure)?;
        Ok(StoreSink {
            device: wanted.device.or(before.map(|job| job.machine)),
            of: wanted.of,
            who: wanted.who,
            machine: wanted.machine,
            rows_of_a_file: wanted.rows_of_a_file,
            reached: from.map(|(_, reached)| position_of(reached)),
            from,
            early: Vec::new(),
            refused: None,
            open: None,
            tally: Tally::default(),
            retained: Instant::now(),
            directory,
        })
    }

    /// The job from which the recording goes on, and where.
    pub fn from(&self) -> Option<(JobId, Reached)> {
        self.from
    }

    /// The job of the recording; `None` as long as nothing was told.
    pub fn job(&self) -> Option<JobId> {
        self.open.as_ref().map(|open| open.job.id)
    }

    /// The files that are catalogued.
    pub fn files(&self) -> &[PathBuf] {
        self.open.as_ref().map_or(&[], |open| &open.files)
    }

    /// Ends the recording as failed, with everything that was told until then.
    pub fn fail(&mut self) {
        let ended = clock::start_time(None)
            .map_err(Refused::Never)
            .and_then(|now| self.end(now, Ending::Failed));
        if let Err(refused) = ended {
            // The failure at hand is said by the caller; the next command that works in the data directory ends the recording.
            eprintln!("warning: {}", refused.into_failure().message);
        }
    }

    /// The recording, begun at the latest now.
    fn begun(&mut self, device: impl FnOnce() -> String) -> Result<&mut Open, Refused> {
        if self.open.is_none() {
            let start = clock::start_time(None).map_err(Refused::Never)?;
            let device = self.device.get_or_insert_with(device);
            let new = NewRecording {
                of: &self.of,
                device,
                start,
                who: &self.who,
                from: self.from,
            };
            let job = match self.refused.take() {
                Some(job) => job,
                None => self.directory.begin_recording(&new).map_err(disk)?,
            };
            let from = From {
                segment: 1,
                rows: 0,
                position: self.reached,
            };
            let (folder, of) = (self.directory.recording_folder(job.id), self.of.clone());
            let segments = Segments::begin(&folder, from, self.rows_of_a_file, move |at| {
                DataDirectory::segment_metadata(&of, at)
            });
            let segments = match segments {
                Ok(segments) => segments,
                Err(refused) => {
                    self.refused = Some(job);
                    return Err(refused);
                }
            };
            self.open = Some(Open {
                job,
                segments,
                waiting: VecDeque::new(),
                at_work: None,
                not_before: None,
                files: Vec::new(),
            });
        }
        let open = self.open.as_mut().expect("it was put there above");
        while let Some(gap) = self.early.first() {
            open.segments.gap(gap)?;
            self.early.remove(0);
        }
        Ok(open)
    }

    /// Compacts what was closed and catalogues what was compacted, without waiting for either; with `all`, until nothing is left.
    fn compact(&mut self, all: bool, now: Timestamp) -> Result<(), StoreError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        open.waiting.extend(open.segments.take_closed());
        loop {
            if let Some((closed, done)) = open.at_work.take() {
                let part = if all {
                    done.recv().map_err(|_| TryRecvError::Disconnected)
                } else {
                    done.try_recv()
                };
                let part = match part {
                    Err(TryRecvError::Empty) => {
                        open.at_work = Some((closed, done));
                        return Ok(());
                    }
                    Err(TryRecvError::Disconnected) => panic!("the thread that makes Parquet files ended without an answer"),
                    Ok(part) => part,
                };
                let kept = part.and_then(|part| self.directory.keep_part(open.job.id, &closed.path, &part, now));
                match kept {
                    Ok(row) => open.files.push(row.path),
                    Err(error) => {
                        // The same one first: how far the recording is is told by its newest part.
                        open.waiting.push_front(closed);
                        open.not_before = Some(Instant::now() + PAUSE);
                        return Err(error);
                    }
                }
            }
            let must_wait = !all && open.not_before.is_some_and(|at| Instant::now() < at);
            let Some(closed) = open.waiting.front().filter(|_| !must_wait).cloned() else {
                return Ok(());
            };
            let found = store::segment::read(&closed.path)?;
            open.waiting.pop_front();
            open.not_before = None;
            if found.rows == 0 || closed.until <= found.first_row {
                std::fs::remove_file(&closed.path).map_err(|source| StoreError::Io {
                    doing: "remove",
                    path: closed.path.clone(),
                    source,
                })?;
                continue;
            }
            let (send, done) = channel();
            let target = self.directory.part_path(&open.job, &closed.path)?;
            let work = closed.clone();
            std::thread::spawn(move || {
                // Nobody listens any more when the process is about to end: the next one does it again.
                let _ = send.send(store::part_of(&work.path, work.until, &target));
            });
            open.at_work = Some((closed, done));
        }
    }

    /// The Parquet files can wait for the disk, and are said to wait; what is acknowledged is in the segments.
    fn compact_or_say(&mut self, now: Timestamp) {
        let waited = self.open.as_ref().is_some_and(|open| open.not_before.is_some());
        if let Err(error) = self.compact(false, now)
            && !waited
        {
            eprintln!("warning: {error}: the rows stay in their segment until there is room for a record of them");
        }
    }

    fn end(&mut self, now: Timestamp, ending: Ending) -> Result<(), Refused> {
        if !self.early.is_empty() {
            let name = self.of.source.clone();
            self.begun(|| name)?;
        }
        if let Some(job) = self.refused.take() {
            self.directory
                .end_recording(job.id, None, now, Ending::Failed)
                .map_err(disk)?;
        }
        let Some(open) = &mut self.open else { return Ok(()) };
        open.segments.end()?;
        self.compact(true, now).map_err(disk)?;
        let open = self.open.as_mut().expect("it was there before");
        let reached = open.segments.position().map(|position| Reached {
            instance: position.instance,
            next: position.next,
            last: position.last,
        });
        self.directory
            .end_recording(open.job.id, reached, now, ending)
            .map_err(disk)?;
        let bytes = open
            .files
            .iter()
            .filter_map(|file| file.metadata().ok())
            .map(|m| m.len())
            .sum();
        open.segments.set_bytes(bytes);
        Ok(())
    }
}

impl Sink for StoreSink {
    fn kept(&self) -> Option<Position> {
        match &self.open {
            Some(open) => open.segments.position(),
            None => self.reached,
        }
    }

    fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused> {
        let Some(first) = told.first() else { return Ok(()) };
        let device = || {
            let source = &items.get(first.item).source;
            let name = if source.device.is_empty() {
                &source.device_uuid
            } else {
                &source.device
            };
            if name.is_empty() { "unnamed".to_owned() } else { name.clone() }
        };
        self.begun(device)?.segments.observations(told, items)
    }

    fn gap(&mut self, gap: &Gap) -> Result<(), Refused> {
        match &mut self.open {
            Some(open) => open.segments.gap(gap),
            None => {
                self.early.push(gap.clone());
                Ok(())
            }
        }
    }

    fn reached(&mut self, position: Position) -> Result<(), Refused> {
        match &mut self.open {
            Some(open) => open.segments.reached(position),
            None => self.reached = Some(position),
        }
        Ok(())
    }

    fn rest(&mut self) -> Result<(), Refused> {
        Ok(())
    }

    fn sync(&mut self) -> Result<(), Refused> {
        if let Some(open) = &mut self.open {
            open.segments.sync()?;
        }
        let now = clock::start_time(None).map_err(Refused::Never)?;
        self.compact_or_say(now);
        if self.retained.elapsed() >= RETAIN {
            self.retained = Instant::now();
            if let Err(failure) = shop::retain(&mut self.directory, &self.machine, now) {
                eprintln!("warning: {}", failure.message);
            }
        }
        Ok(())
    }

    fn close(&mut self, now: Timestamp) -> Result<(), Refused> {
        self.end(now, Ending::Done)
    }

    fn tally(&self) -> &Tally {
        self.open.as_ref().map_or(&self.tally, |open| open.segments.tally())
    }
}

//! Rows from a sampling thread to the disk, without the one ever waiting for the other.
//!
//! ```text
//! sampling thread --offer--> ring (bounded, made beforehand) --> writing thread: one frame, one write, one sync each 100 ms
//!                                                                     |--> acknowledged rows, latencies, health (Watch)
//!                                                                     `--> closed segments --> compacting thread
//! ```
//!
//! A full ring is a gap: counted where it happens, and written among the rows where it belongs when there is room again. While the disk
//! is full or refuses, nothing is acknowledged and everybody can see it; rows wait in the ring, then they are lost and counted.
//!
//! On a machine ([`Pace::Real`]) the sampling side never waits, takes no lock and no memory. In simulated time ([`Pace::Simulated`]) it
//! may wait for a good disk: a world a thousand times faster than real would only outrun it.

use super::compact;
use super::disk::{Disk, RealDisk, is_full};
use super::gap::{Cause, Gap};
use super::health::{Condition, Health, Watch};
use super::parts::Parts;
use super::rows::Rows;
use super::writer::FRAME_ROWS;
use crate::StoreError;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TryRecvError, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Whose time it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// A machine's: the sampling side never waits.
    Real,
    /// A simulator's: the sampling side waits while the ring is full and the disk is good.
    Simulated,
}

/// How a recording is made.
#[derive(Clone)]
pub struct Settings {
    /// Whose time it is.
    pub pace: Pace,
    /// Rows that the ring holds: at least two seconds of them.
    pub ring: usize,
    /// Longest time from one sync to the next: what a power loss may cost.
    pub interval: Duration,
    /// Rows of a segment; a longer recording goes on in the next one while this one is compacted.
    pub segment_rows: u64,
    /// Compress rows with zstd.
    pub compress: bool,
    /// How long the end of a recording waits for a disk that refuses.
    pub patience: Duration,
    /// The disk.
    pub disk: Arc<dyn Disk>,
}

impl Settings {
    /// 100 ms, 8 s of rows at 1 kHz, 1 M rows a segment.
    pub fn new(pace: Pace) -> Settings {
        Settings {
            pace,
            ring: 8192,
            interval: Duration::from_millis(100),
            segment_rows: 1_000_000,
            compress: true,
            patience: Duration::from_secs(5),
            disk: Arc::new(RealDisk),
        }
    }
}

/// What became of a row that was offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "a row that was not taken is a gap in the recording"]
pub enum Offered {
    /// It is on its way.
    Taken,
    /// The ring is full: it is lost, and counted in a gap.
    Missed,
}

enum Item<T> {
    /// A row, and when it was offered, microseconds since the recording began.
    Row(T, u64),
    Gap(Gap),
}

/// A recording in the making: the sampling side of it.
pub struct Recorder<R: Rows> {
    sender: Option<SyncSender<Item<R::Row>>>,
    writing: Option<JoinHandle<Result<(), StoreError>>>,
    pace: Pace,
    ring: usize,
    began: Instant,
    /// The gap that is open: it goes into the ring before the next row.
    missed: Option<Gap>,
    offered: u64,
    waits: u64,
    watch: Watch,
    ending: Arc<AtomicBool>,
    folder: PathBuf,
}

/// A recording that ended: all of its rows are acknowledged, in segments or parts of Parquet in its folder.
#[derive(Clone, Debug)]
pub struct Ended {
    /// Its folder: what [`super::merge`] takes.
    pub folder: PathBuf,
    /// How it went.
    pub health: Health,
    /// How often the sampling side waited; never on a machine.
    pub waits: u64,
}

impl<R: Rows> Recorder<R> {
    /// Begins a recording in a new `folder`. The metadata is what the finished file will say about itself.
    ///
    /// # Errors
    /// The folder has a recording already, or the disk refuses.
    pub fn begin(
        folder: &Path,
        rows: R,
        metadata: BTreeMap<String, String>,
        settings: &Settings,
    ) -> Result<Recorder<R>, StoreError> {
        let disk = Arc::clone(&settings.disk);
        let parts = Parts::begin(
            Arc::clone(&disk),
            folder,
            rows.schema(),
            metadata,
            settings.compress,
            settings.segment_rows,
        )?;
        let (sender, receiver) = sync_channel(settings.ring.max(2));
        let watch = Watch::default();
        let began = Instant::now();
        let ending = Arc::new(AtomicBool::new(false));
        let writing = Writing {
            parts,
            rows,
            receiver,
            watch: watch.clone(),
            began,
            interval: settings.interval,
            patience: settings.patience,
            last: None,
            waits: Vec::with_capacity(settings.ring),
            unreadable: None,
            ending: Arc::clone(&ending),
            disk,
            folder: folder.to_owned(),
            compacting: None,
        };
        let writing = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || writing.run())
            .map_err(StoreError::io("start the thread for", folder))?;
        Ok(Recorder {
            sender: Some(sender),
            writing: Some(writing),
            pace: settings.pace,
            ring: settings.ring.max(2),
            began,
            missed: None,
            offered: 0,
            waits: 0,
            watch,
            ending,
            folder: folder.to_owned(),
        })
    }

    /// Hands a row over. On a machine this never waits.
    pub fn offer(&mut self, row: &R::Row) -> Offered {
        self.offered += 1;
        if self.pace == Pace::Simulated && self.offered.is_multiple_of(self.ring as u64 / 2) {
            self.wake();
        }
        let sender = self.sender.as_ref().expect("it is taken at the end only");
        if let Some(gap) = self.missed.take() {
            match sender.try_send(Item::Gap(gap)) {
                Ok(()) => {}
                Err(TrySendError::Full(Item::Gap(gap)) | TrySendError::Disconnected(Item::Gap(gap))) => {
                    self.missed = Some(gap);
                    let cause = self.watch.cause();
                    return self.miss(R::number(row), cause);
                }
                Err(_) => unreachable!("what comes back is what was sent"),
            }
        }
        let mut item = Item::Row(*row, self.began.elapsed().as_micros() as u64);
        loop {
            match sender.try_send(item) {
                Ok(()) => return Offered::Taken,
                Err(TrySendError::Full(back)) if self.pace == Pace::Simulated && self.watch.cause() == Cause::RingFull => {
                    item = back;
                    self.waits += 1;
                    self.wake();
                    std::thread::sleep(Duration::from_micros(100));
                }
                Err(_) => {
                    let cause = self.watch.cause();
                    return self.miss(R::number(row), cause);
                }
            }
        }
    }

    /// Says that the source itself lost rows.
    pub fn source_gap(&mut self, from: u64, to: u64) {
        let count = to.saturating_sub(from) + 1;
        let gap = match self.missed.take() {
            Some(open) => Gap {
                to,
                count: open.count + count,
                ..open
            },
            None => Gap {
                from,
                to,
                count,
                cause: Cause::Source,
            },
        };
        self.missed = Some(gap);
    }

    fn miss(&mut self, number: u64, cause: Cause) -> Offered {
        match &mut self.missed {
            Some(gap) => {
                gap.to = number;
                gap.count += 1;
                // A disk that is full says more than a ring that is.
                if gap.cause == Cause::RingFull {
                    gap.cause = cause;
                }
            }
            None => {
                self.missed = Some(Gap {
                    from: number,
                    to: number,
                    count: 1,
                    cause,
                });
            }
        }
        Offered::Missed
    }

    fn wake(&self) {
        if let Some(writing) = &self.writing {
            writing.thread().unpark();
        }
    }

    /// Rows that were offered.
    pub fn offered(&self) -> u64 {
        self.offered
    }
    /// How often [`Recorder::offer`] waited.
    pub fn waits(&self) -> u64 {
        self.waits
    }
    /// A look at it for other threads.
    pub fn watch(&self) -> Watch {
        self.watch.clone()
    }
    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Ends the recording; every row that was taken is acknowledged when this returns. It waits for the disk: stop the machine before.
    ///
    /// # Errors
    /// The disk refuses for longer than the patience of the settings. What was acknowledged stays in the folder.
    pub fn end(mut self) -> Result<Ended, StoreError> {
        let sender = self.sender.take().expect("it is taken here only, and in drop");
        self.ending.store(true, SeqCst);
        self.wake();
        if let Some(gap) = self.missed.take() {
            // The last rows were lost. The ring is emptied by a good disk; one that refuses for too long ends the other side.
            let _ = sender.send(Item::Gap(gap));
        }
        drop(sender);
        let writing = self.writing.take().expect("it is taken here only, and in drop");
        match writing.join() {
            Ok(done) => done?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        Ok(Ended {
            folder: self.folder.clone(),
            health: self.watch.health(),
            waits: self.waits,
        })
    }
}

impl<R: Rows> Drop for Recorder<R> {
    /// Given up: what was taken is written, and stays for the next start to recover.
    fn drop(&mut self) {
        self.sender = None;
        self.ending.store(true, SeqCst);
        self.wake();
        if let Some(writing) = self.writing.take() {
            let _ = writing.join();
        }
    }
}

/// The writing side.
struct Writing<R: Rows> {
    parts: Parts,
    rows: R,
    receiver: Receiver<Item<R::Row>>,
    watch: Watch,
    began: Instant,
    interval: Duration,
    patience: Duration,
    /// Number of the last row that was taken out of the ring.
    last: Option<u64>,
    /// When the rows of this group were offered.
    waits: Vec<u64>,
    /// Rows that could not be kept, not told yet.
    unreadable: Option<Gap>,
    ending: Arc<AtomicBool>,
    disk: Arc<dyn Disk>,
    folder: PathBuf,
    compacting: Option<(Sender<PathBuf>, JoinHandle<()>)>,
}

/// What is left in the ring.
#[derive(PartialEq)]
enum Ring {
    Empty,
    More,
    Closed,
}

/// Rows that may wait for one sync, at most; in simulated time there are as many. Of 64 channels they take 8 MiB.
const GROUP_ROWS: u64 = 4 * FRAME_ROWS as u64;

impl<R: Rows> Writing<R> {
    fn run(mut self) -> Result<(), StoreError> {
        let done = self.write();
        if let Err(error) = &done {
            // Whoever still looks must see that nothing is acknowledged any more.
            self.refused(error);
        }
        if let Some((sender, compacting)) = self.compacting.take() {
            drop(sender);
            let _ = compacting.join();
        }
        done
    }

    fn write(&mut self) -> Result<(), StoreError> {
        let mut synced = Instant::now();
        let mut refusing = false;
        let mut left = Ring::Empty;
        let mut ending: Option<Instant> = None;
        loop {
            if self.ending.load(SeqCst) {
                ending.get_or_insert_with(Instant::now);
                if refusing || left == Ring::Empty {
                    std::thread::sleep(Duration::from_millis(1).max(if refusing { self.interval / 10 } else { Duration::ZERO }));
                }
            } else {
                std::thread::park_timeout(self.interval.saturating_sub(synced.elapsed()));
            }
            if left != Ring::Closed {
                left = Ring::More;
            }
            // While the disk refuses, rows stay in the ring: what waits in memory stays bounded, and the gap is where the ring ends.
            while !refusing && left == Ring::More && self.parts.unacknowledged() < GROUP_ROWS {
                left = self.drain()?;
            }
            let due = left == Ring::Closed || synced.elapsed() >= self.interval || self.parts.unacknowledged() >= GROUP_ROWS;
            if !due {
                continue;
            }
            let mut done = self.sync();
            if left == Ring::Closed {
                done = done.and_then(|()| self.parts.end());
            }
            synced = Instant::now();
            match done {
                Ok(()) if left == Ring::Closed => return Ok(()),
                Ok(()) => refusing = false,
                Err(error) => {
                    refusing = true;
                    self.refused(&error);
                    if ending.is_some_and(|since| since.elapsed() >= self.patience) {
                        return Err(error);
                    }
                }
            }
        }
    }

    /// Takes a frame's worth of rows out of the ring.
    fn drain(&mut self) -> Result<Ring, StoreError> {
        loop {
            if self.rows.len() >= FRAME_ROWS {
                self.frame()?;
                return Ok(Ring::More);
            }
            match self.receiver.try_recv() {
                Ok(Item::Row(row, offered)) => {
                    let number = R::number(&row);
                    match self.rows.push(&row) {
                        Ok(()) => {
                            if let Some(gap) = self.unreadable.take() {
                                self.tell(gap)?;
                            }
                            self.last = Some(number);
                            self.waits.push(offered);
                        }
                        Err(_) => match &mut self.unreadable {
                            Some(gap) => (gap.to, gap.count) = (number, gap.count + 1),
                            none => {
                                *none = Some(Gap {
                                    from: number,
                                    to: number,
                                    count: 1,
                                    cause: Cause::Unreadable,
                                });
                            }
                        },
                    }
                }
                Ok(Item::Gap(gap)) => {
                    self.frame()?;
                    self.tell(gap)?;
                }
                Err(ended) => {
                    self.frame()?;
                    if let Some(gap) = self.unreadable.take() {
                        self.tell(gap)?;
                    }
                    return Ok(match ended {
                        TryRecvError::Empty => Ring::Empty,
                        TryRecvError::Disconnected => Ring::Closed,
                    });
                }
            }
        }
    }

    fn frame(&mut self) -> Result<(), StoreError> {
        if self.rows.is_empty() {
            return Ok(());
        }
        let batch = self.rows.take()?;
        self.parts.append(batch)
    }

    fn tell(&mut self, gap: Gap) -> Result<(), StoreError> {
        self.watch.gap(&gap);
        self.parts.gap(gap)
    }

    fn sync(&mut self) -> Result<(), StoreError> {
        let (rows, closed) = self.parts.sync()?;
        let now = self.began.elapsed().as_micros() as u64;
        let waits = self.waits.drain(..).map(|offered| (now.saturating_sub(offered), 1));
        self.watch.acknowledge(rows, self.last, waits);
        if let Some(segment) = closed {
            self.compact(segment);
        }
        Ok(())
    }

    fn refused(&self, error: &StoreError) {
        let condition = match error {
            StoreError::Io { source, .. } if is_full(source) => Condition::DiskFull,
            _ => Condition::DiskFailing,
        };
        let free = self.disk.free_space(&self.folder);
        self.watch.refuse(condition, error.to_string(), free);
    }

    /// Compacts a closed segment on a thread of its own: this one has the next rows to write.
    fn compact(&mut self, segment: PathBuf) {
        if self.compacting.is_none() {
            let (sender, receiver) = channel::<PathBuf>();
            let watch = self.watch.clone();
            let work = move || {
                for segment in receiver {
                    if let Err(error) = compact::part(&segment) {
                        watch.not_compacted(&error);
                    }
                }
            };
            match std::thread::Builder::new().name("compacting".to_owned()).spawn(work) {
                Ok(thread) => self.compacting = Some((sender, thread)),
                Err(error) => self
                    .watch
                    .not_compacted(&StoreError::io("start the thread for", &segment)(error)),
            }
        }
        if let Some((sender, _)) = &self.compacting {
            // A thread that is gone leaves the segment as it is; the end of the recording reads it.
            let _ = sender.send(segment);
        }
    }
}

//! Disks with troubles planted in them, for tests and benches: slow, full, failing. Underneath is a [`RealDisk`].

use super::disk::{Disk, DiskFile, RealDisk};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A disk with troubles. Clones are the same disk: one for the recorder, one to plant troubles with.
#[derive(Clone, Default)]
pub struct TroubledDisk(Arc<Troubles>);

#[derive(Default)]
struct Troubles {
    /// Waits of the next syncs, the last one repeated.
    delays: Mutex<Vec<Duration>>,
    syncs: AtomicU64,
    limited: AtomicBool,
    room: AtomicU64,
    written: AtomicU64,
    write_fails: AtomicBool,
    sync_fails: AtomicU64,
}

impl TroubledDisk {
    /// Each sync takes as long as the next of `delays`; the last one stays.
    pub fn slow(&self, delays: &[Duration]) {
        let mut delays = delays.to_vec();
        delays.reverse();
        *self.0.delays.lock().expect("nobody panics with it") = delays;
    }

    /// Only so many bytes fit in; `None` for as many as on the disk underneath.
    pub fn room(&self, bytes: Option<u64>) {
        self.0.room.store(bytes.unwrap_or(0), SeqCst);
        self.0.written.store(0, SeqCst);
        self.0.limited.store(bytes.is_some(), SeqCst);
    }

    /// Every write fails, or none any more.
    pub fn fail_writes(&self, fail: bool) {
        self.0.write_fails.store(fail, SeqCst);
    }

    /// The next `times` syncs fail.
    pub fn fail_syncs(&self, times: u64) {
        self.0.sync_fails.store(times, SeqCst);
    }

    /// How many syncs there were.
    pub fn syncs(&self) -> u64 {
        self.0.syncs.load(SeqCst)
    }
}

impl Disk for TroubledDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        let file = RealDisk.create(path)?;
        Ok(Box::new(TroubledFile(Arc::clone(&self.0), file)))
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        RealDisk.rename(from, to)
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        RealDisk.remove(path)
    }
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        RealDisk.sync_folder(folder)
    }
    fn free_space(&self, folder: &Path) -> Option<u64> {
        if self.0.limited.load(SeqCst) {
            return Some(self.0.room.load(SeqCst).saturating_sub(self.0.written.load(SeqCst)));
        }
        RealDisk.free_space(folder)
    }
    fn size(&self, path: &Path) -> io::Result<u64> {
        RealDisk.size(path)
    }
}

struct TroubledFile(Arc<Troubles>, Box<dyn DiskFile>);

impl DiskFile for TroubledFile {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let Self(troubles, file) = self;
        if troubles.write_fails.load(SeqCst) {
            return Err(io::Error::other("a planted failure of the write"));
        }
        if troubles.limited.load(SeqCst) {
            let room = troubles.room.load(SeqCst).saturating_sub(troubles.written.load(SeqCst));
            if (bytes.len() as u64) > room {
                // As a real one does: what fits is written, the rest is refused.
                file.write_at(offset, &bytes[..room as usize])?;
                return Err(io::Error::new(io::ErrorKind::StorageFull, "planted: no space left"));
            }
        }
        file.write_at(offset, bytes)?;
        troubles.written.fetch_add(bytes.len() as u64, SeqCst);
        Ok(())
    }
    fn sync(&mut self) -> io::Result<()> {
        let Self(troubles, file) = self;
        troubles.syncs.fetch_add(1, SeqCst);
        let delay = {
            let mut delays = troubles.delays.lock().expect("nobody panics with it");
            match delays.len() {
                0 => None,
                1 => delays.last().copied(),
                _ => delays.pop(),
            }
        };
        if let Some(delay) = delay {
            std::thread::sleep(delay);
        }
        let fails = |left: u64| left.checked_sub(1);
        if troubles.sync_fails.fetch_update(SeqCst, SeqCst, fails).is_ok() {
            return Err(io::Error::other("a planted failure of the sync"));
        }
        file.sync()
    }
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.1.cut(length)
    }
}

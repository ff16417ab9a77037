//! What segments ask of a disk, so that tests can plant a slow, a full and a broken one. [`RealDisk`] is the file system.

use crate::StoreError;
use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

/// A disk as segments see it.
pub trait Disk: Send + Sync {
    /// Makes a new file; one that is there already is an error.
    ///
    /// # Errors
    /// The disk refuses.
    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>>;

    /// Gives a file another name.
    ///
    /// # Errors
    /// The disk refuses.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a file.
    ///
    /// # Errors
    /// The disk refuses.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Makes the names in a folder last over a power loss.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;

    /// Bytes that may still be written in a folder; `None` when the system does not tell.
    fn free_space(&self, folder: &Path) -> Option<u64>;

    /// Length of a file.
    ///
    /// # Errors
    /// The disk refuses.
    fn size(&self, path: &Path) -> io::Result<u64>;
}

/// A file that is being written.
pub trait DiskFile: Send {
    /// Writes all of `bytes` at `offset`. Writing at a place and not at the end: what a full disk took of a write is written over.
    ///
    /// # Errors
    /// The disk refuses; some of the bytes may be there then.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;

    /// Returns when the content is on the medium.
    ///
    /// # Errors
    /// The disk refuses; nobody knows what is on it then.
    fn sync(&mut self) -> io::Result<()>;

    /// Cuts the file.
    ///
    /// # Errors
    /// The disk refuses.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealDisk;

impl Disk for RealDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn DiskFile>> {
        Ok(Box::new(RealFile(
            OpenOptions::new().write(true).create_new(true).open(path)?,
        )))
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match crate::whole_file::sync_folder_of(&folder.join("any")) {
            Err(StoreError::Io { source, .. }) => Err(source),
            _ => Ok(()),
        }
    }
    fn free_space(&self, folder: &Path) -> Option<u64> {
        free_space(folder)
    }
    fn size(&self, path: &Path) -> io::Result<u64> {
        Ok(path.metadata()?.len())
    }
}

#[cfg(unix)]
fn free_space(folder: &Path) -> Option<u64> {
    let space = rustix::fs::statvfs(folder).ok()?;
    space.f_bavail.checked_mul(space.f_frsize)
}

#[cfg(not(unix))]
fn free_space(_folder: &Path) -> Option<u64> {
    None
}

struct RealFile(File);

impl DiskFile for RealFile {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.0.seek(SeekFrom::Start(offset))?;
        self.0.write_all(bytes)
    }
    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)
    }
}

/// True for an error that goes away when somebody makes room.
pub(crate) fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

//! Files that appear whole or not at all: written under another name, synced, renamed, and the folder synced.
//!
//! The order matters. A rename that reaches the disk before the content does leaves an empty file under the good name after a power
//! loss; a rename without syncing the folder may be forgotten.

use crate::StoreError;
use ledger::Hash;
use sha2::{Digest, Sha256};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// A file in the making. Dropped before [`WholeFile::finish`], it is removed; killed, it stays as `.tmp`.
pub struct WholeFile {
    path: PathBuf,
    temporary: Option<PathBuf>,
    file: BufWriter<File>,
    hasher: Sha256,
    length: u64,
    finished: bool,
}

impl WholeFile {
    /// Starts a file that will stand at `path`. What is no regular file (a pipe, `/dev/stdout`) is written directly.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn create(path: &Path) -> Result<WholeFile, StoreError> {
        let special = path.metadata().is_ok_and(|m| !m.is_file());
        let temporary = (!special).then(|| temporary_name(path));
        let opened = temporary.as_deref().unwrap_or(path);
        if temporary.is_some()
            && let Some(folder) = path.parent()
        {
            std::fs::create_dir_all(folder).map_err(StoreError::io("create", folder))?;
        }
        let file = OpenOptions::new()
            .write(true)
            .create(!special)
            .truncate(!special)
            .open(opened)
            .map_err(StoreError::io("create", opened))?;
        Ok(WholeFile {
            path: path.to_owned(),
            temporary,
            file: BufWriter::with_capacity(1 << 16, file),
            hasher: Sha256::new(),
            length: 0,
            finished: false,
        })
    }

    /// Length and hash of what was written so far.
    pub(crate) fn so_far(&self) -> (u64, Hash) {
        (self.length, Hash(self.hasher.clone().finalize().into()))
    }

    /// Makes it last: content, then name. Gives length and hash.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn finish(mut self) -> Result<(u64, Hash), StoreError> {
        let opened = self.temporary.clone().unwrap_or_else(|| self.path.clone());
        self.file.flush().map_err(StoreError::io("write", &opened))?;
        if let Some(temporary) = &self.temporary {
            self.file.get_ref().sync_all().map_err(StoreError::io("sync", temporary))?;
            std::fs::rename(temporary, &self.path).map_err(StoreError::io("rename", temporary))?;
            sync_folder_of(&self.path)?;
        }
        self.finished = true;
        Ok((self.length, Hash(self.hasher.finalize_reset().into())))
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        self.length += written as u64;
        Ok(written)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if !self.finished
            && let Some(temporary) = &self.temporary
        {
            // The caller has an error already, or gave up; a file that cannot be removed either is found by its `.tmp`.
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// `record.parquet` is made as `record.parquet.tmp`.
pub(crate) fn temporary_name(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    PathBuf::from(name)
}

/// Makes a new name in the folder of `path` last over a power loss.
pub(crate) fn sync_folder_of(path: &Path) -> Result<(), StoreError> {
    // Windows has no such call and keeps names by its journal.
    if cfg!(unix) {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let opened = File::open(folder).map_err(StoreError::io("open", folder))?;
        opened.sync_all().map_err(StoreError::io("sync", folder))?;
    }
    Ok(())
}

/// The hash of a file's content, read in windows.
pub(crate) fn hash_of_file(path: &Path) -> Result<Hash, StoreError> {
    let mut file = File::open(path).map_err(StoreError::io("open", path))?;
    hash_of(&mut file).map_err(StoreError::io("read", path))
}

/// The hash of everything that a reader gives, read in windows.
pub(crate) fn hash_of(reader: &mut impl Read) -> io::Result<Hash> {
    let mut hasher = Sha256::new();
    let mut window = vec![0; 1 << 16];
    loop {
        match reader.read(&mut window) {
            Ok(0) => return Ok(Hash(hasher.finalize().into())),
            Ok(n) => hasher.update(&window[..n]),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

//! Backup and restore: a whole copy of a data directory that says of itself that it is whole.
//!
//! A backup is the same tree as the data directory, so that `trace` can look into it, with a manifest `backup.json` written last: every
//! file with length and hash, and the end of the chain of events. Files of jobs that wrote outside of the data directory lie in
//! `outside/<hash>/<name>`. While it is made, `backup-unfinished` stands in the folder and no manifest; killed at any moment, the copy is
//! recognised as not whole. Made again, only what differs is written; a file whose source was damaged keeps its good copy.
//!
//! [`DataDirectory::backup`](crate::DataDirectory::backup) makes one, [`restore`] brings one back.

mod copy;
mod manifest;
mod restore;

pub use copy::Backup;
pub use manifest::{Manifest, ManifestFile};
pub use restore::{Restored, restore};

use crate::StoreError;
use std::path::{Path, PathBuf};

/// The manifest's name.
pub(crate) const MANIFEST: &str = "backup.json";
/// Stands in a backup that is being made.
pub(crate) const UNFINISHED: &str = "backup-unfinished";
/// Stands in a folder that is being restored into.
pub(crate) const RESTORING: &str = "restore-unfinished";

/// Where a file from outside of the data directory lies in a backup.
pub(crate) fn outside(path: &Path, hash: &str) -> PathBuf {
    let name = path.file_name().map_or_else(|| "file".into(), ToOwned::to_owned);
    Path::new("outside").join(hash).join(name)
}

/// Nobody works in a backup, nor in a folder that is half restored.
pub(crate) fn refuse_to_work_in(root: &Path) -> Result<(), StoreError> {
    refuse_half(root)?;
    if root.join(MANIFEST).exists() {
        return Err(StoreError::IsBackup(root.to_owned()));
    }
    Ok(())
}

/// What is not whole is not looked at as if it were.
pub(crate) fn refuse_half(root: &Path) -> Result<(), StoreError> {
    if root.join(RESTORING).exists() {
        return Err(StoreError::HalfRestore(root.to_owned()));
    }
    if root.join(UNFINISHED).exists() && !root.join(MANIFEST).exists() {
        return Err(StoreError::HalfBackup(root.to_owned()));
    }
    Ok(())
}

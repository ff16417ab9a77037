//! `server.json`: where the process that holds a data directory can be talked to.
//!
//! The holder writes it when it begins to answer and removes it when it goes; a process that was killed leaves it behind. The lock tells
//! which of the two it is: whoever gets the lock finds a stale notice and removes it.

use crate::{DataDirectory, StoreError, whole_file};
use serde::{Deserialize, Serialize};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file's name in the data directory.
pub(crate) const FILE: &str = "server.json";

/// What others need to talk to the holder.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ServerNotice {
    /// Where it answers: `http://127.0.0.1:8470`.
    pub address: String,
    /// What a caller on this computer shows to be let in. Only the owner of the data directory can read it.
    pub token: String,
    /// The holder's process number.
    pub process: u32,
}

impl std::fmt::Debug for ServerNotice {
    /// Without the token, which belongs into no log.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ServerNotice({}, process {})", self.address, self.process)
    }
}

impl ServerNotice {
    /// The notice of a data directory; `None` when nobody serves there.
    ///
    /// It may be stale: it is true only while its process holds the lock, as [`StoreError::Locked`] tells.
    ///
    /// # Errors
    /// It is there and cannot be read.
    pub fn read(root: &Path) -> Result<Option<ServerNotice>, StoreError> {
        let path = root.join(FILE);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(StoreError::io("read", &path)(e)),
        };
        let odd = |e: serde_json::Error| std::io::Error::new(std::io::ErrorKind::InvalidData, e);
        serde_json::from_slice(&bytes)
            .map(Some)
            .map_err(|e| StoreError::io("read", &path)(odd(e)))
    }
}

impl DataDirectory {
    /// Tells others where this process can be talked to. The file is readable for its owner alone from its first byte, and is removed
    /// with [`DataDirectory::withdraw`] or when the directory is dropped.
    ///
    /// # Errors
    /// The directory is only being read, or the disk refuses.
    pub fn announce(&mut self, address: &str, token: &str) -> Result<ServerNotice, StoreError> {
        self.must_hold()?;
        let notice = ServerNotice {
            address: address.to_owned(),
            token: token.to_owned(),
            process: std::process::id(),
        };
        let path = self.root().join(FILE);
        let temporary = whole_file::temporary_name(&path);
        remove(&temporary)?;
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let mut file = options.open(&temporary).map_err(StoreError::io("create", &temporary))?;
        let text = serde_json::to_string_pretty(&notice).expect("texts and a number are always JSON");
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(StoreError::io("write", &temporary))?;
        std::fs::rename(&temporary, &path).map_err(StoreError::io("rename", &temporary))?;
        Ok(notice)
    }

    /// Takes the notice back: nobody answers any more.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn withdraw(&mut self) -> Result<(), StoreError> {
        self.must_hold()?;
        remove(&self.root().join(FILE))
    }
}

/// Removes a notice that a killed process left; called by whoever has the lock.
pub(crate) fn remove_stale(root: &Path) -> Result<(), StoreError> {
    remove(&root.join(FILE))?;
    remove(&whole_file::temporary_name(&root.join(FILE)))
}

/// The address of the holder with this process number; `None` when nobody serves, or somebody else did.
pub(crate) fn address_of(root: &Path, holder: Option<u32>) -> Option<String> {
    let notice = ServerNotice::read(root).ok().flatten()?;
    (Some(notice.process) == holder).then_some(notice.address)
}

fn remove(path: &PathBuf) -> Result<(), StoreError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(StoreError::io("remove", path)(e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_process_is_told_where_the_holder_answers() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut holder = DataDirectory::open(folder.path(), "toolmark serve").expect("free");
        let notice = holder.announce("http://127.0.0.1:8470", "a secret").expect("written");
        assert_eq!(ServerNotice::read(folder.path()).expect("reads"), Some(notice.clone()));
        assert!(!format!("{notice:?}").contains("a secret"));
        let refused = DataDirectory::open(folder.path(), "toolmark run").expect_err("held");
        assert_eq!(refused.exit_code(), 4);
        let text = refused.to_string();
        assert!(text.contains("in use by toolmark serve (process"), "{text}");
        assert!(text.contains("answers at http://127.0.0.1:8470"), "{text}");
        holder.withdraw().expect("removed");
        assert_eq!(ServerNotice::read(folder.path()).expect("reads"), None);
        let refused = DataDirectory::open(folder.path(), "toolmark run").expect_err("held");
        assert!(!refused.to_string().contains("answers at"), "{refused}");
    }

    #[cfg(unix)]
    #[test]
    fn the_token_can_be_read_by_its_owner_alone() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let mut holder = DataDirectory::open(folder.path(), "test").expect("free");
        holder.announce("http://127.0.0.1:1", "x").expect("written");
        let mode = folder.path().join(FILE).metadata().expect("there").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn the_notice_goes_with_its_holder_and_a_stale_one_is_removed_by_the_next() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(FILE);
        let mut holder = DataDirectory::open(folder.path(), "test").expect("free");
        holder.announce("http://127.0.0.1:1", "x").expect("written");
        let left_by_a_kill = std::fs::read(&path).expect("there");
        drop(holder);
        assert!(!path.exists());

        std::fs::write(&path, left_by_a_kill).expect("as a kill leaves it");
        let next = DataDirectory::open(folder.path(), "test").expect("free");
        assert!(!path.exists(), "its process is gone");
        drop(next);

        // Somebody else's number in it: it is not the notice of the process that holds the lock now.
        let _holder = DataDirectory::open(folder.path(), "test").expect("free");
        let strange = r#"{"address":"http://127.0.0.1:2","token":"x","process":1}"#;
        std::fs::write(&path, strange).expect("written");
        let refused = DataDirectory::open(folder.path(), "test").expect_err("held");
        assert!(!refused.to_string().contains("127.0.0.1:2"), "{refused}");
    }
}

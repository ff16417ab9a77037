//! Files that are evidence: programs, what a job wrote, copies of the database. Each is told by an event with its length and hash, so that
//! a changed byte is found, and who opened the directory is told the same way.
//!
//! There is one chain for all of it (`docs/decisions/0004-one-log.md`): what was done with the directory and what happened in it cannot
//! be told apart by a forger who would like to change one and leave the other.

use crate::directory::{DATABASE, folder_name};
use crate::whole_file::{WholeFile, hash_of_file};
use crate::{DataDirectory, JobId, Log, StoreError};
use ledger::{Event, Hash};
use rusqlite::OptionalExtension;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// Kind of the event that tells of a file.
pub(crate) const FILE_KEPT: &str = "file-kept";

/// A file that the log tells of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptFile {
    /// Where it is.
    pub path: PathBuf,
    /// The job that wrote it; `None` for programs and copies of the database.
    pub job: Option<JobId>,
    /// Its length.
    pub bytes: u64,
    /// Its hash.
    pub hash: Hash,
    /// The event that tells of it.
    pub event: u64,
    /// As it stands in the log: relative where it lies in the data directory.
    pub(crate) text: String,
}

impl DataDirectory {
    /// Tells who works here with which command. Called by whoever opens the directory to change it.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn opened(&mut self, at: Timestamp, who: &str, command: &str) -> Result<Event, StoreError> {
        let mut detail = BTreeMap::from([
            ("who".to_owned(), Value::from(who)),
            ("command".to_owned(), Value::from(command)),
            ("version".to_owned(), Value::from(env!("CARGO_PKG_VERSION"))),
        ]);
        if let Some(problem) = self.wal_problem() {
            detail.insert("write_ahead_log".to_owned(), Value::from(problem));
        }
        let event = self.append(at, "opened", detail)?;
        // A migration copies the database before anybody is there who knows the time.
        for copy in self.database_copies() {
            self.tell_of_file(&copy, None, at)?;
        }
        Ok(event)
    }

    /// Keeps the bytes of a program under their hash, so that a job's program can be looked up after the file was edited:
    /// `programs/<hash>/<name>`. Kept already, it stays as it is.
    ///
    /// # Errors
    /// The bytes are not those of `hash`: the file was edited meanwhile. The disk refuses.
    pub fn keep_program(&mut self, name: &str, bytes: &mut dyn Read, hash: Hash, at: Timestamp) -> Result<PathBuf, StoreError> {
        self.must_hold()?;
        let path = self.programs().join(hash.to_string()).join(folder_name(name));
        if !(path.exists() && hash_of_file(&path)? == hash) {
            let mut file = WholeFile::create(&path)?;
            std::io::copy(bytes, &mut file).map_err(StoreError::io("write", &path))?;
            if file.so_far().1 != hash {
                let edited = std::io::Error::new(
                    std::io::ErrorKind::InvalidData,
                    "it was edited while it was read; start again",
                );
                return Err(StoreError::io("read", Path::new(name))(edited));
            }
            file.finish()?;
        }
        self.tell_of_file(&path, None, at)?;
        Ok(path)
    }

    /// Tells of the files that a job wrote, wherever they are. A record has its place in the catalogue instead.
    ///
    /// # Errors
    /// A file is not there, or the disk refuses.
    pub fn keep_files(&mut self, job: JobId, files: &[PathBuf], at: Timestamp) -> Result<(), StoreError> {
        files.iter().try_for_each(|file| self.tell_of_file(file, Some(job), at))
    }

    fn tell_of_file(&mut self, path: &Path, job: Option<JobId>, at: Timestamp) -> Result<(), StoreError> {
        let text = self.path_to_text(path)?;
        let hash = hash_of_file(path)?;
        let bytes = path.metadata().map_err(StoreError::io("read", path))?.len();
        let last: Option<Option<String>> = self
            .database
            .query_row(
                "SELECT json_extract(detail, '$.sha256') FROM events
                 WHERE log = 0 AND kind = ?1 AND json_extract(detail, '$.path') = ?2 ORDER BY sequence DESC LIMIT 1",
                [FILE_KEPT, &text],
                |row| row.get(0),
            )
            .optional()
            .map_err(self.failed())?;
        if job.is_none() && last.flatten() == Some(hash.to_string()) {
            return Ok(());
        }
        let detail = BTreeMap::from([
            ("path".to_owned(), Value::from(text)),
            ("job".to_owned(), job.map_or(Value::Null, |job| Value::from(job.0))),
            ("bytes".to_owned(), Value::from(bytes)),
            ("sha256".to_owned(), Value::from(hash.to_string())),
        ]);
        self.append(at, FILE_KEPT, detail).map(|_| ())
    }

    /// The files that the log tells of, by path; where a path was written several times, as it was written last.
    ///
    /// # Errors
    /// The disk refuses, or an event is not readable.
    pub fn kept_files(&self) -> Result<Vec<KeptFile>, StoreError> {
        let mut kept = BTreeMap::new();
        let mut from = 1;
        loop {
            let events = self.events(Log::Directory, from, 1000)?;
            for event in events.iter().filter(|e| e.kind == FILE_KEPT) {
                if let Some(file) = self.kept_file_of(event) {
                    kept.insert(file.text.clone(), file);
                }
            }
            match events.last() {
                Some(last) => from = last.sequence + 1,
                None => return Ok(kept.into_values().collect()),
            }
        }
    }

    pub(crate) fn kept_file_of(&self, event: &Event) -> Option<KeptFile> {
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str);
        let (path, hash) = (text("path")?, text("sha256")?);
        Some(KeptFile {
            path: self.place_of(path, hash),
            job: event.detail.get("job").and_then(Value::as_i64).map(JobId),
            bytes: event.detail.get("bytes").and_then(Value::as_u64)?,
            hash: Hash::parse(hash)?,
            event: event.sequence,
            text: path.to_owned(),
        })
    }

    /// The copies that migrations made of the database.
    fn database_copies(&self) -> Vec<PathBuf> {
        let prefix = format!("{DATABASE}.version-");
        let entries = std::fs::read_dir(self.root()).into_iter().flatten().flatten();
        let mut copies: Vec<PathBuf> = entries
            .filter(|e| {
                e.file_name()
                    .to_str()
                    .is_some_and(|n| n.starts_with(&prefix) && !n.ends_with(".tmp"))
            })
            .map(|e| e.path())
            .collect();
        copies.sort();
        copies
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_kept_by_its_hash_and_mended_when_it_was_changed() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let hash = Hash::of(b"G0 X0");
        let mut keep = || directory.keep_program("a/part.nc", &mut &b"G0 X0"[..], hash, Timestamp(1));
        let path = keep().expect("kept");
        assert!(path.ends_with(format!("programs/{hash}/a_part.nc")), "{}", path.display());
        std::fs::write(&path, "G0 X1").expect("edited");
        assert_eq!(keep().expect("kept"), path);
        assert_eq!(std::fs::read(&path).expect("reads"), b"G0 X0");
        let told = directory.kept_files().expect("reads");
        assert_eq!((told.len(), told[0].event, told[0].hash), (1, 1, hash), "told once");
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_program_that_is_edited_while_it_is_kept_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let refused = directory
            .keep_program("part.nc", &mut &b"G0 X1"[..], Hash::of(b"G0 X0"), Timestamp(1))
            .expect_err("other bytes");
        assert_eq!(refused.exit_code(), 3);
        assert!(refused.to_string().contains("it was edited while it was read"), "{refused}");
        assert_eq!(directory.kept_files().expect("reads"), []);
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn who_opened_the_directory_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        std::fs::write(folder.path().join("toolmark.sqlite.version-1"), "a copy").expect("as a migration leaves it");
        let event = directory.opened(Timestamp(7), "Maria", "run").expect("told");
        assert_eq!(
            (event.kind.as_str(), &event.detail["who"], &event.detail["command"]),
            ("opened", &"Maria".into(), &"run".into())
        );
        let kept = directory.kept_files().expect("reads");
        assert_eq!(kept[0].text, "toolmark.sqlite.version-1");
        directory.opened(Timestamp(8), "Maria", "run").expect("told");
        assert_eq!(directory.kept_files().expect("reads"), kept, "a copy is told once");
    }
}

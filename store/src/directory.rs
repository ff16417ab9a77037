//! The data directory: its tree, its lock, and the way to its database.
//!
//! ```text
//! toolmark.sqlite                         jobs, events, process values, catalogue of records
//! programs/                               programs that were loaded
//! jobs/<job>/                             what a job wrote: as-executed program, report
//! records/<machine>/<yyyy-mm-dd>/*.parquet  records
//! segments/                               records in the making
//! rollups/<hash of record>.rollup         what the records come to, kept when their rows are removed
//! outside/<hash>/<name>                   in backups and what was restored from them: files of jobs that wrote elsewhere
//! lock                                    held by the one process that works here
//! server.json                             where that process can be talked to
//! ```

use crate::{JobId, StoreError, backup, schema, server_notice, wal};
use rusqlite::Connection;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use units::Timestamp;

/// Where the data directory is: `--data`, else `$TOOLMARK_DATA`, else `$XDG_DATA_HOME/toolmark`, else `~/.local/share/toolmark`.
///
/// `variable` reads the environment; pass `|name| std::env::var_os(name)`.
///
/// # Errors
/// None of the four is there.
pub fn data_directory_path(data: Option<&Path>, variable: impl Fn(&str) -> Option<OsString>) -> Result<PathBuf, StoreError> {
    let set = |name| variable(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    if let Some(data) = data {
        return Ok(data.to_owned());
    }
    set("TOOLMARK_DATA")
        // The XDG base directory specification: a relative path is to be ignored.
        .or_else(|| set("XDG_DATA_HOME").filter(|p| p.is_absolute()).map(|p| p.join("toolmark")))
        .or_else(|| set("HOME").map(|p| p.join(".local/share/toolmark")))
        .ok_or(StoreError::NoPlace)
}

/// A data directory that this process holds, one process at a time, or only reads. Dropped, it is free again.
pub struct DataDirectory {
    root: PathBuf,
    pub(crate) database: Connection,
    /// Jobs begun by this process: they run, and were not interrupted.
    pub(crate) begun: BTreeSet<JobId>,
    /// What was wrong with the write-ahead log when it was opened.
    pub(crate) wal_problem: Option<wal::Problem>,
    // Last: the database is closed before others are let in.
    lock: Lock,
}

impl std::fmt::Debug for DataDirectory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "DataDirectory({})", self.root.display())
    }
}

impl DataDirectory {
    /// Opens the data directory at `root`, making it when it is not there. `holder` is what others are told while it is held:
    /// `toolmark serve`.
    ///
    /// # Errors
    /// Another process holds it; its database is newer than this program, damaged, or not ours; it is a backup, or a restore into it
    /// did not end; the disk refuses.
    pub fn open(root: &Path, holder: &str) -> Result<DataDirectory, StoreError> {
        let root = std::path::absolute(root).map_err(StoreError::io("find", root))?;
        // Before the folder is touched: a backup stays as it is.
        backup::refuse_to_work_in(&root)?;
        std::fs::create_dir_all(&root).map_err(StoreError::io("create", &root))?;
        let lock = Lock::take(&root, holder)?;
        server_notice::remove_stale(&root)?;
        for folder in ["programs", "jobs", "segments", "records"] {
            let folder = root.join(folder);
            std::fs::create_dir_all(&folder).map_err(StoreError::io("create", &folder))?;
        }
        let path = root.join(DATABASE);
        let wal_problem = wal::problem(&path)?;
        let database = schema::open(&path, schema::MIGRATIONS)?;
        crate::whole_file::sync_folder_of(&path)?;
        let directory = DataDirectory {
            root,
            database,
            begun: BTreeSet::new(),
            wal_problem,
            lock,
        };
        directory.check_last_event()?;
        Ok(directory)
    }

    /// Opens a data directory, or a backup of one, only to look at it: nothing in it is made, changed or migrated, and whatever would
    /// write is refused. Several readers may look at the same time, but not while a process works in it.
    ///
    /// # Errors
    /// It is no data directory; a process works in it; its database is newer than this program, damaged, or not ours; it is a backup
    /// that did not come to its end.
    pub fn read(root: &Path) -> Result<DataDirectory, StoreError> {
        let root = std::path::absolute(root).map_err(StoreError::io("find", root))?;
        let path = root.join(DATABASE);
        backup::refuse_half(&root)?;
        if !path.is_file() {
            return Err(StoreError::NoDirectory(root));
        }
        let lock = Lock::share(&root)?;
        let wal_problem = wal::problem(&path)?;
        let database = schema::read(&path, schema::MIGRATIONS)?;
        Ok(DataDirectory {
            root,
            database,
            begun: BTreeSet::new(),
            wal_problem,
            lock,
        })
    }

    /// True when this process holds the directory, false when it only reads it.
    pub fn is_held(&self) -> bool {
        self.lock.exclusive
    }

    /// What was wrong with the database's write-ahead log when it was opened: changes that SQLite drops without a word.
    pub fn wal_problem(&self) -> Option<&str> {
        self.wal_problem.as_ref().map(|problem| problem.text.as_str())
    }

    /// Refuses what a reader may not do.
    pub(crate) fn must_hold(&self) -> Result<(), StoreError> {
        if self.is_held() {
            Ok(())
        } else {
            Err(StoreError::OnlyRead(self.root.clone()))
        }
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where programs are kept.
    pub fn programs(&self) -> PathBuf {
        self.root.join("programs")
    }

    /// Where the record of a job goes: `records/<machine>/<yyyy-mm-dd>/job-000007.parquet`, the day in UTC.
    pub fn record_path(&self, machine: &str, start: Timestamp, job: JobId) -> PathBuf {
        self.root
            .join("records")
            .join(folder_name(machine))
            .join(day_of(start))
            .join(format!("job-{:06}.parquet", job.0))
    }

    /// A path as it is written into tables: relative where it lies in the data directory.
    pub(crate) fn path_to_text(&self, path: &Path) -> Result<String, StoreError> {
        let whole = std::path::absolute(path).map_err(StoreError::io("find", path))?;
        let short = whole.strip_prefix(&self.root).unwrap_or(&whole);
        short
            .to_str()
            .map(str::to_owned)
            .ok_or_else(|| StoreError::NotUnicode(path.to_owned()))
    }

    /// The way back. An absolute text replaces the root.
    pub(crate) fn path_from_text(&self, text: &str) -> PathBuf {
        self.root.join(text)
    }

    /// Where a file of known content is: at its place, or, when that is outside of the data directory and this is a backup or was
    /// restored from one, below `outside/`.
    pub(crate) fn place_of(&self, text: &str, hash: &str) -> PathBuf {
        let place = self.path_from_text(text);
        if !place.starts_with(&self.root) {
            let copy = self.root.join(backup::outside(&place, hash));
            if copy.exists() {
                return copy;
            }
        }
        place
    }

    /// For `map_err` of anything SQLite says.
    pub(crate) fn failed(&self) -> impl Fn(rusqlite::Error) -> StoreError + use<> {
        let path = self.root.join(DATABASE);
        move |source| StoreError::Database {
            path: path.clone(),
            source,
        }
    }
}

/// The name of the database in a data directory.
pub(crate) const DATABASE: &str = "toolmark.sqlite";

/// A path with something appended to its name: `toolmark.sqlite-wal`.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// The lock on a data directory: the operating system's lock on the file, so that it ends with the process however that ends. The
/// file's text only tells who it is.
struct Lock {
    /// `None` for a reader of a folder that has no lock file: a backup.
    file: Option<File>,
    exclusive: bool,
    root: PathBuf,
}

impl Lock {
    fn take(root: &Path, holder: &str) -> Result<Lock, StoreError> {
        let path = root.join("lock");
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(StoreError::io("open", &path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(locked(root, &mut file)),
            Err(TryLockError::Error(source)) => return Err(StoreError::io("lock", &path)(source)),
        }
        let text = format!("{}\n{}\n", std::process::id(), holder.lines().next().unwrap_or_default());
        file.set_len(0)
            .and_then(|()| file.write_all(text.as_bytes()))
            .map_err(StoreError::io("write", &path))?;
        Ok(Lock {
            file: Some(file),
            exclusive: true,
            root: root.to_owned(),
        })
    }

    /// Keeps holders out, but not other readers.
    fn share(root: &Path) -> Result<Lock, StoreError> {
        let path = root.join("lock");
        let mut file = match File::open(&path) {
            Ok(file) => Some(file),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(e) => return Err(StoreError::io("open", &path)(e)),
        };
        if let Some(file) = &mut file {
            match file.try_lock_shared() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(locked(root, file)),
                Err(TryLockError::Error(source)) => return Err(StoreError::io("lock", &path)(source)),
            }
        }
        Ok(Lock {
            file,
            exclusive: false,
            root: root.to_owned(),
        })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Nothing here can be told to anybody any more, and what stays behind is recognised as stale by the next holder.
        if self.exclusive {
            let _ = server_notice::remove_stale(&self.root);
            // So that nobody reads our name under the next holder's lock; closing the file frees the lock in any case.
            let _ = self.file.as_ref().map(|f| f.set_len(0));
        }
        let _ = self.file.as_ref().map(File::unlock);
    }
}

/// Who holds it. The holder takes the lock first and writes its name then, so an empty file is worth a second look.
fn locked(root: &Path, file: &mut File) -> StoreError {
    let mut text = String::new();
    for _ in 0..20 {
        text.clear();
        let _ = file.rewind().and_then(|()| file.read_to_string(&mut text));
        if text.ends_with('\n') {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let mut lines = text.lines();
    let pid = lines.next().and_then(|line| line.parse().ok());
    // A reader has no name there: its lock is not worth a write.
    let holder = lines.next().filter(|h| !h.is_empty()).unwrap_or("another process");
    StoreError::Locked {
        path: root.to_owned(),
        holder: holder.to_owned(),
        pid,
        address: server_notice::address_of(root, pid),
    }
}

/// The UTC day as `yyyy-mm-dd`.
fn day_of(at: Timestamp) -> String {
    match jiff::Timestamp::from_nanosecond(i128::from(at.0)) {
        Ok(time) => time.to_zoned(jiff::tz::TimeZone::UTC).strftime("%Y-%m-%d").to_string(),
        // 64-bit nanoseconds reach from 1677 to 2262, far inside what jiff knows.
        Err(_) => "unknown-day".to_owned(),
    }
}

/// A name as a folder: what a file system may not like becomes `_`.
pub(crate) fn folder_name(name: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let folder: String = name.chars().map(safe).collect();
    // `.` and `..` are no names, and a leading dot hides.
    if folder.is_empty() || folder.starts_with('.') {
        format!("_{folder}")
    } else {
        folder
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_path(data: Option<&str>, variables: &[(&str, &str)], expected: &str) {
        let variable = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| OsString::from(v));
        let found = data_directory_path(data.map(Path::new), variable);
        let found = found.map_or_else(|e| e.to_string(), |p| p.display().to_string());
        assert!(found.starts_with(expected), "{found}");
    }

    #[test]
    fn the_data_directory_is_found_in_the_order_of_the_contract() {
        let all = [("TOOLMARK_DATA", "/t"), ("XDG_DATA_HOME", "/x"), ("HOME", "/h")];
        check_path(Some("/d"), &all, "/d");
        check_path(None, &all, "/t");
        check_path(None, &all[1..], "/x/toolmark");
        check_path(None, &all[2..], "/h/.local/share/toolmark");
        check_path(
            None,
            &[("TOOLMARK_DATA", ""), ("XDG_DATA_HOME", "relative"), ("HOME", "/h")],
            "/h/.local",
        );
        check_path(None, &[], "no data directory");
    }

    #[test]
    fn a_second_holder_is_told_who_holds_it_and_the_next_one_gets_in() {
        let folder = tempfile::tempdir().expect("a folder");
        let first = DataDirectory::open(folder.path(), "toolmark serve").expect("free");
        let refused = DataDirectory::open(folder.path(), "toolmark run").expect_err("held");
        match &refused {
            StoreError::Locked { holder, pid, .. } => {
                assert_eq!((holder.as_str(), *pid), ("toolmark serve", Some(std::process::id())));
            }
            other => panic!("{other}"),
        }
        assert_eq!(refused.exit_code(), 4);
        assert!(refused.to_string().contains("in use by toolmark serve (process"), "{refused}");
        drop(first);
        DataDirectory::open(folder.path(), "toolmark run").expect("free again");
    }

    #[test]
    fn readers_look_together_but_not_while_a_process_works_there() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(matches!(DataDirectory::read(folder.path()), Err(StoreError::NoDirectory(_))));
        let holder = DataDirectory::open(folder.path(), "toolmark run").expect("free");
        let refused = DataDirectory::read(folder.path()).expect_err("held");
        assert!(refused.to_string().contains("in use by toolmark run (process"), "{refused}");
        drop(holder);
        let mut one = DataDirectory::read(folder.path()).expect("free");
        let two = DataDirectory::read(folder.path()).expect("a second reader");
        assert!(matches!(
            DataDirectory::open(folder.path(), "toolmark run"),
            Err(StoreError::Locked { .. })
        ));
        let refused = one
            .append(Timestamp(1), "noted", std::collections::BTreeMap::new())
            .expect_err("only read");
        assert!(matches!(refused, StoreError::OnlyRead(_)), "{refused}");
        drop((one, two));
        DataDirectory::open(folder.path(), "toolmark run").expect("free again");
    }

    #[test]
    fn the_tree_is_made_and_records_lie_by_machine_and_day() {
        let folder = tempfile::tempdir().expect("a folder");
        let directory = DataDirectory::open(folder.path(), "test").expect("free");
        for name in ["toolmark.sqlite", "programs", "jobs", "segments", "records", "lock"] {
            assert!(folder.path().join(name).exists(), "{name}");
        }
        let path = directory.record_path("../odd name", Timestamp(1_795_132_800_000_000_000), JobId(7));
        let short = path.strip_prefix(directory.root()).expect("inside");
        assert_eq!(short, Path::new("records/_.._odd_name/2026-11-20/job-000007.parquet"));
    }
}

//! Makes a backup.

use super::{MANIFEST, Manifest, ManifestFile, RESTORING, UNFINISHED, outside};
use crate::directory::{DATABASE, beside};
use crate::whole_file::{WholeFile, hash_of_file, sync_folder_of, temporary_name};
use crate::{DataDirectory, Log, StoreError, verify};
use ledger::Hash;
use rusqlite::{Connection, OpenFlags};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use units::Timestamp;

/// A backup that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Backup {
    /// Its manifest; `problems` in it says what could not be copied as it was told.
    pub manifest: Manifest,
    /// Files written now.
    pub copied: u64,
    /// Their bytes.
    pub copied_bytes: u64,
    /// Files that were there already, with the same content.
    pub unchanged: u64,
    /// Files of earlier backups that the data directory has no more; they stay and are not in the manifest.
    pub left_over: Vec<String>,
}

/// A file to be copied.
struct Source {
    from: PathBuf,
    /// What the log says of its content; `None` for what the log does not tell of.
    told: Option<Hash>,
}

impl DataDirectory {
    /// Makes a whole copy of this directory at `to`, or brings the one there up to date. Nobody else works here meanwhile, because this
    /// process holds the directory.
    ///
    /// What was damaged or is gone does not stop it: it is in the manifest's `problems`, and a good copy from before is kept.
    ///
    /// # Errors
    /// `to` is not empty and no backup of this directory, or lies in it; the disk refuses. The copy is not whole then, and says so.
    pub fn backup(&mut self, to: &Path, at: Timestamp, who: &str, mut progress: impl FnMut(&str)) -> Result<Backup, StoreError> {
        self.must_hold()?;
        let to = &std::path::absolute(to).map_err(StoreError::io("find", to))?;
        std::fs::create_dir_all(to).map_err(StoreError::io("create", to))?;
        self.check_place(to)?;
        let whom = |more: &[(&str, Value)]| -> BTreeMap<String, Value> {
            let both = [("who", Value::from(who)), ("to", Value::from(to.display().to_string()))];
            both.iter().chain(more).map(|(k, v)| ((*k).to_owned(), v.clone())).collect()
        };
        // Told before the database is copied, so that the copy says itself what it is.
        self.append(at, "backup-begun", whom(&[]))?;
        let identity = self.identity()?.expect("an event was written above");
        self.check_identity(to, &identity)?;
        begin(to, &identity)?;

        let mut problems = Vec::new();
        let sources = self.files_to_copy(&mut problems)?;
        let mut files = Vec::new();
        let (mut copied, mut copied_bytes, mut unchanged) = (0, 0, 0);
        for (path, source) in &sources {
            progress(path);
            match copy_file(source, &to.join(path))? {
                Copy::Written(bytes, hash) => {
                    if source.told.is_some_and(|told| told != hash) {
                        problems.push(format!("{path}: its content is not what was recorded"));
                    }
                    (copied, copied_bytes) = (copied + 1, copied_bytes + bytes);
                    files.push(manifest_file(path, bytes, hash));
                }
                Copy::Unchanged(bytes, hash) => {
                    if source.told.is_some_and(|told| told != hash) {
                        problems.push(format!("{path}: its content is not what was recorded"));
                    }
                    unchanged += 1;
                    files.push(manifest_file(path, bytes, hash));
                }
                Copy::KeptGood(bytes, hash) => {
                    problems.push(format!(
                        "{path}: its content is not what was recorded; the good copy of an earlier backup was kept"
                    ));
                    unchanged += 1;
                    files.push(manifest_file(path, bytes, hash));
                }
                Copy::Gone => problems.push(format!("{path}: is gone")),
            }
        }
        progress(DATABASE);
        let (bytes, hash) = self.copy_database(&to.join(DATABASE))?;
        (copied, copied_bytes) = (copied + 1, copied_bytes + bytes);
        files.push(manifest_file(DATABASE, bytes, hash));
        files.sort_by(|a, b| a.path.cmp(&b.path));

        let end = self.last_event(Log::Directory)?.expect("an event was written above");
        let manifest = Manifest::new(at, who, self.root(), identity, (end.sequence, end.hash), files, problems);
        manifest.write(to)?;
        remove(&to.join(UNFINISHED))?;
        sync_folder_of(&to.join(UNFINISHED))?;
        self.append(
            at,
            "backup-made",
            whom(&[
                ("files", manifest.files.len().into()),
                ("manifest_sha256", manifest.manifest_sha256.as_str().into()),
                ("problems", manifest.problems.len().into()),
            ]),
        )?;
        let paths = manifest.paths();
        let left_over = verify::files_below(to)
            .into_iter()
            .filter_map(|p| Some(p.strip_prefix(to).ok()?.to_str()?.to_owned()))
            .filter(|p| p != MANIFEST && !paths.contains(p.as_str()))
            .collect();
        Ok(Backup {
            manifest,
            copied,
            copied_bytes,
            unchanged,
            left_over,
        })
    }

    /// Hash of the first event: no two directories share it.
    pub(crate) fn identity(&self) -> Result<Option<String>, StoreError> {
        Ok(self.events(Log::Directory, 1, 1)?.pop().map(|event| event.hash))
    }

    fn check_place(&self, to: &Path) -> Result<(), StoreError> {
        let real = |path: &Path| path.canonicalize().map_err(StoreError::io("find", path));
        let bad = |what: &str| StoreError::BadPlace {
            path: to.to_owned(),
            what: what.to_owned(),
        };
        let (here, there) = (real(self.root())?, real(to)?);
        if there.starts_with(&here) || here.starts_with(&there) {
            return Err(bad(
                "a backup lies outside of its data directory: give another folder, best on another disk",
            ));
        }
        if there.join(RESTORING).exists() || (!there.join(MANIFEST).exists() && there.join(DATABASE).exists()) {
            let half = there.join(UNFINISHED).exists();
            if !half {
                return Err(bad(
                    "it is a data directory itself: give an empty folder, or one that holds a backup",
                ));
            }
        }
        let mut entries = std::fs::read_dir(to).map_err(StoreError::io("read", to))?;
        let is_backup = there.join(MANIFEST).exists() || there.join(UNFINISHED).exists();
        if !is_backup && entries.next().is_some() {
            return Err(bad(
                "it is neither empty nor a backup: give an empty folder, or one that holds a backup",
            ));
        }
        Ok(())
    }

    fn check_identity(&self, to: &Path, identity: &str) -> Result<(), StoreError> {
        // A manifest that cannot be read any more says nothing; then the copy is simply made whole again.
        let manifest = std::fs::read(to.join(MANIFEST)).ok();
        let manifest: Option<Value> = manifest.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let half = std::fs::read_to_string(to.join(UNFINISHED)).ok();
        let held = manifest.and_then(|m| Some(m.get("identity")?.as_str()?.to_owned())).or(half);
        match held {
            Some(held) if !held.trim().is_empty() && held.trim() != identity => Err(StoreError::BadPlace {
                path: to.to_owned(),
                what: "it holds a backup of another data directory: give a folder for this one".to_owned(),
            }),
            _ => Ok(()),
        }
    }

    /// What is to be copied, by its path in the backup.
    fn files_to_copy(&self, problems: &mut Vec<String>) -> Result<BTreeMap<String, Source>, StoreError> {
        let mut sources = BTreeMap::new();
        let told = self.told_files()?;
        for (text, hash) in &told {
            let from = self.place_of(text, hash);
            let inside = from.strip_prefix(self.root()).ok().map(Path::to_owned);
            let path = inside.unwrap_or_else(|| outside(&from, hash));
            let Some(path) = path.to_str() else {
                problems.push(format!("{}: its name is not Unicode", from.display()));
                continue;
            };
            let told = Hash::parse(hash);
            sources.insert(path.to_owned(), Source { from, told });
        }
        // What the log does not tell of: segments in the making, records of interrupted jobs, the machine file.
        for from in verify::files_below(self.root()) {
            let short = from.strip_prefix(self.root()).expect("it was found below");
            let Some(path) = short.to_str() else {
                problems.push(format!("{}: its name is not Unicode", from.display()));
                continue;
            };
            if !verify::is_of_the_directory_itself(path) && !path.ends_with(".tmp") && !sources.contains_key(path) {
                sources.insert(path.to_owned(), Source { from, told: None });
            }
        }
        Ok(sources)
    }

    /// Every file that the log tells of, as text of its path, with its hash; where a path was written several times, the last.
    fn told_files(&self) -> Result<BTreeMap<String, String>, StoreError> {
        let mut told = BTreeMap::new();
        for file in self.kept_files()? {
            told.insert(file.text, file.hash.to_string());
        }
        for row in self.records()? {
            // Removed by age: its roll-up is what is kept of it.
            if self.is_raw_gone(&row)? && !row.path.exists() {
                continue;
            }
            told.insert(row.text, row.hash.to_string());
        }
        Ok(told)
    }

    /// A copy of the database in one file, without the log that a running database has beside it.
    fn copy_database(&self, to: &Path) -> Result<(u64, Hash), StoreError> {
        let temporary = temporary_name(to);
        remove(&temporary)?;
        let text = temporary.to_str().ok_or_else(|| StoreError::NotUnicode(temporary.clone()))?;
        self.database.execute("VACUUM INTO ?1", [text]).map_err(self.failed())?;
        let failed = |source| StoreError::Database {
            path: temporary.clone(),
            source,
        };
        let copy = Connection::open_with_flags(&temporary, OpenFlags::SQLITE_OPEN_READ_WRITE).map_err(failed)?;
        // So that the copy can be read on a medium that cannot be written.
        copy.query_row("PRAGMA journal_mode = DELETE", [], |_| Ok(()))
            .map_err(failed)?;
        drop(copy);
        File::open(&temporary)
            .and_then(|f| f.sync_all())
            .map_err(StoreError::io("sync", &temporary))?;
        let hash = hash_of_file(&temporary)?;
        let bytes = temporary.metadata().map_err(StoreError::io("read", &temporary))?.len();
        for old in ["-wal", "-shm", "-journal"] {
            remove(&beside(to, old))?;
        }
        std::fs::rename(&temporary, to).map_err(StoreError::io("rename", &temporary))?;
        sync_folder_of(to)?;
        Ok((bytes, hash))
    }
}

enum Copy {
    Written(u64, Hash),
    Unchanged(u64, Hash),
    /// The source is damaged, and an earlier backup has it whole.
    KeptGood(u64, Hash),
    Gone,
}

/// Copies a file unless the same content is there already.
fn copy_file(source: &Source, to: &Path) -> Result<Copy, StoreError> {
    let there = match to.metadata() {
        Ok(found) if found.is_file() => Some((found.len(), hash_of_file(to)?)),
        _ => None,
    };
    let mut from = match File::open(&source.from) {
        Ok(from) => from,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            let good = there.filter(|(_, hash)| source.told == Some(*hash));
            return Ok(good.map_or(Copy::Gone, |(bytes, hash)| Copy::KeptGood(bytes, hash)));
        }
        Err(e) => return Err(StoreError::io("open", &source.from)(e)),
    };
    if let Some((bytes, hash)) = there {
        let now = hash_of_file(&source.from)?;
        if now == hash {
            return Ok(Copy::Unchanged(bytes, hash));
        }
        if source.told == Some(hash) {
            return Ok(Copy::KeptGood(bytes, hash));
        }
    }
    let mut file = WholeFile::create(to)?;
    std::io::copy(&mut from, &mut file).map_err(StoreError::io("copy", &source.from))?;
    let (bytes, hash) = file.finish()?;
    Ok(Copy::Written(bytes, hash))
}

/// From here on until the manifest is written the copy is not whole.
fn begin(to: &Path, identity: &str) -> Result<(), StoreError> {
    let marker = to.join(UNFINISHED);
    let mut file = WholeFile::create(&marker)?;
    file.write_all(identity.as_bytes())
        .map_err(StoreError::io("write", &marker))?;
    file.finish()?;
    remove(&to.join(MANIFEST))?;
    sync_folder_of(&marker)
}

fn manifest_file(path: &str, bytes: u64, hash: Hash) -> ManifestFile {
    ManifestFile {
        path: path.to_owned(),
        bytes,
        sha256: hash.to_string(),
    }
}

fn remove(path: &Path) -> Result<(), StoreError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(StoreError::io("remove", path)(e)),
        _ => Ok(()),
    }
}

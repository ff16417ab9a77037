//! Brings a backup back.

use super::{Manifest, RESTORING};
use crate::whole_file::{WholeFile, sync_folder_of};
use crate::{DataDirectory, Finding, StoreError};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use units::Timestamp;

/// A backup that was brought back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Restored {
    /// Its manifest.
    pub manifest: Manifest,
    /// Bytes written.
    pub bytes: u64,
    /// What the check of the restored directory found; empty is good.
    pub findings: Vec<Finding>,
}

/// Brings the backup `from` back as a data directory at `to`, which is empty or not there. The backup is checked whole before the first
/// byte is written, every file while it is written, and the restored directory as a whole afterwards.
///
/// # Errors
/// The backup is not whole, `to` is not empty, or the disk refuses. A restore that was cut short is recognised: nobody works in it.
pub fn restore(from: &Path, to: &Path, at: Timestamp, who: &str, mut progress: impl FnMut(&str)) -> Result<Restored, StoreError> {
    let from = &std::path::absolute(from).map_err(StoreError::io("find", from))?;
    let to = &std::path::absolute(to).map_err(StoreError::io("find", to))?;
    let manifest = Manifest::read(from)?;
    let problems = manifest.check(from, &mut progress)?;
    if !problems.is_empty() {
        return Err(StoreError::NotWhole {
            path: from.clone(),
            problems: problems.iter().map(|(path, problem)| format!("{path} {problem}")).collect(),
        });
    }
    std::fs::create_dir_all(to).map_err(StoreError::io("create", to))?;
    if to.join(RESTORING).exists() {
        return Err(StoreError::HalfRestore(to.clone()));
    }
    if std::fs::read_dir(to).map_err(StoreError::io("read", to))?.next().is_some() {
        return Err(StoreError::BadPlace {
            path: to.clone(),
            what: "it is not empty: a restore never writes over anything; give an empty or a new folder with --data".to_owned(),
        });
    }
    let marker = to.join(RESTORING);
    let mut file = WholeFile::create(&marker)?;
    file.write_all(manifest.manifest_sha256.as_bytes())
        .map_err(StoreError::io("write", &marker))?;
    file.finish()?;
    let mut bytes = 0;
    for file in &manifest.files {
        progress(&file.path);
        let (source, target) = (from.join(&file.path), to.join(&file.path));
        let mut read = File::open(&source).map_err(StoreError::io("open", &source))?;
        let mut whole = WholeFile::create(&target)?;
        std::io::copy(&mut read, &mut whole).map_err(StoreError::io("copy", &source))?;
        let (length, hash) = whole.finish()?;
        if hash.to_string() != file.sha256 {
            return Err(StoreError::NotWhole {
                path: from.clone(),
                problems: vec![format!("{} was changed while it was read", file.path)],
            });
        }
        bytes += length;
    }
    std::fs::remove_file(&marker).map_err(StoreError::io("remove", &marker))?;
    sync_folder_of(&marker)?;
    let mut directory = DataDirectory::open(to, "toolmark restore")?;
    let detail = BTreeMap::from([
        ("who".to_owned(), Value::from(who)),
        ("from".to_owned(), Value::from(from.display().to_string())),
        ("manifest_sha256".to_owned(), Value::from(manifest.manifest_sha256.as_str())),
        ("last_event".to_owned(), Value::from(manifest.last_event)),
    ]);
    directory.append(at, "restored", detail)?;
    let findings = directory.verify()?;
    Ok(Restored {
        manifest,
        bytes,
        findings,
    })
}

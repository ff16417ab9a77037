//! The manifest of a backup.

use super::MANIFEST;
use crate::whole_file::{WholeFile, hash_of_file};
use crate::{StoreError, whole_file};
use ledger::Hash;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Component, Path};
use units::Timestamp;

/// Version of this layout.
const LAYOUT: u32 = 1;

/// What a backup holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the layout of this file.
    pub toolmark_backup: u32,
    /// When it was made, nanoseconds UTC.
    pub at_ns: i64,
    /// Who made it.
    pub who: String,
    /// The data directory it was made of.
    pub source: String,
    /// Hash of the first event of that directory: two directories never share it.
    pub identity: String,
    /// Number of the last event in the directory's chain.
    pub last_event: u64,
    /// Hash of that event: written down elsewhere, it shows whether the chain was cut later.
    pub last_event_sha256: String,
    /// Every file, by path.
    pub files: Vec<ManifestFile>,
    /// What could not be copied, and why.
    pub problems: Vec<String>,
    /// Hash of everything above.
    pub manifest_sha256: String,
}

/// A file in a backup.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ManifestFile {
    /// Its place in the backup, with `/` between folders.
    pub path: String,
    /// Its length.
    pub bytes: u64,
    /// Its hash.
    pub sha256: String,
}

impl Manifest {
    /// Reads the manifest of the backup at `root`.
    ///
    /// # Errors
    /// There is none, it is not readable, newer, or not what was written.
    pub fn read(root: &Path) -> Result<Manifest, StoreError> {
        super::refuse_half(root)?;
        let path = root.join(MANIFEST);
        let bad = |what: String| StoreError::NotWhole {
            path: root.to_owned(),
            problems: vec![format!("{MANIFEST}: {what}")],
        };
        let text = match std::fs::read(&path) {
            Ok(bytes) => String::from_utf8(bytes).map_err(|e| bad(e.to_string()))?,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(StoreError::BadPlace {
                    path: root.to_owned(),
                    what: format!("it holds no {MANIFEST}, so it is no backup: give the folder that toolmark backup wrote"),
                });
            }
            Err(e) => return Err(StoreError::io("read", &path)(e)),
        };
        let manifest: Manifest = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
        if manifest.toolmark_backup != LAYOUT {
            return Err(bad(format!(
                "its layout is {}, this program reads {LAYOUT}: use the newer toolmark",
                manifest.toolmark_backup
            )));
        }
        // The text itself, so that not even a blank can be changed in it.
        if manifest.sealed().text() != text {
            return Err(bad("it is not what was written".to_owned()));
        }
        if let Some(file) = manifest.files.iter().find(|f| !is_inside(&f.path)) {
            return Err(bad(format!("{} leads out of the backup", file.path)));
        }
        Ok(manifest)
    }

    /// Holds every file against the manifest; gives what is missing or changed, and what else lies there.
    ///
    /// # Errors
    /// A file is there and cannot be read.
    pub fn check(&self, root: &Path, mut progress: impl FnMut(&str)) -> Result<Vec<(String, String)>, StoreError> {
        let mut problems = Vec::new();
        for file in &self.files {
            progress(&file.path);
            let path = root.join(&file.path);
            let problem = match path.metadata() {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => Some("is missing".to_owned()),
                Err(e) => return Err(StoreError::io("read", &path)(e)),
                Ok(found) if found.len() != file.bytes => Some(format!("has {} bytes, {} were written", found.len(), file.bytes)),
                Ok(_) => {
                    (hash_of_file(&path)?.to_string() != file.sha256).then(|| "its content is not what was written".to_owned())
                }
            };
            problems.extend(problem.map(|problem| (file.path.clone(), problem)));
        }
        Ok(problems)
    }

    /// The paths of all files.
    pub(crate) fn paths(&self) -> BTreeSet<&str> {
        self.files.iter().map(|f| f.path.as_str()).collect()
    }

    pub(super) fn new(
        at: Timestamp,
        who: &str,
        source: &Path,
        identity: String,
        last: (u64, String),
        files: Vec<ManifestFile>,
        problems: Vec<String>,
    ) -> Manifest {
        Manifest {
            toolmark_backup: LAYOUT,
            at_ns: at.0,
            who: who.to_owned(),
            source: source.display().to_string(),
            identity,
            last_event: last.0,
            last_event_sha256: last.1,
            files,
            problems,
            manifest_sha256: String::new(),
        }
        .sealed()
    }

    pub(super) fn write(&self, root: &Path) -> Result<(), StoreError> {
        let path = root.join(MANIFEST);
        let mut file = WholeFile::create(&path)?;
        file.write_all(self.text().as_bytes())
            .map_err(StoreError::io("write", &path))?;
        file.finish()?;
        whole_file::sync_folder_of(&path)
    }

    fn sealed(&self) -> Manifest {
        let mut sealed = self.clone();
        sealed.manifest_sha256 = String::new();
        sealed.manifest_sha256 = Hash::of(sealed.text().as_bytes()).to_string();
        sealed
    }

    fn text(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("texts and numbers are always JSON");
        text.push('\n');
        text
    }
}

/// A manifest comes from outside: nothing may be read or written beside the folder.
fn is_inside(path: &str) -> bool {
    !path.is_empty() && Path::new(path).components().all(|c| matches!(c, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written() -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().expect("a folder");
        let file = ManifestFile {
            path: "programs/a".into(),
            bytes: 1,
            sha256: Hash::of(b"a").to_string(),
        };
        let manifest = Manifest::new(
            Timestamp(1),
            "Maria",
            Path::new("/data"),
            "i".into(),
            (1, "h".into()),
            vec![file],
            vec![],
        );
        manifest.write(folder.path()).expect("written");
        assert_eq!(Manifest::read(folder.path()).expect("reads"), manifest);
        let text = std::fs::read_to_string(folder.path().join(MANIFEST)).expect("reads");
        (folder, text)
    }

    #[test]
    fn any_changed_byte_of_a_manifest_is_found() {
        let (folder, text) = written();
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            std::fs::write(folder.path().join(MANIFEST), bytes).expect("written");
            let refused = Manifest::read(folder.path()).expect_err("changed");
            assert!(matches!(refused, StoreError::NotWhole { .. }), "byte {at}: {refused}");
        }
    }

    #[test]
    fn a_manifest_that_leads_out_of_its_folder_is_refused() {
        for path in ["../x", "/etc/x", "a/../../x", ""] {
            assert!(!is_inside(path), "{path}");
        }
        assert!(is_inside("records/sim-mill/2026-11-20/job-000001.parquet"));
    }
}

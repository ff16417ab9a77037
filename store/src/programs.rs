//! What is known of program files: their hash from the last edit or cycle start, so that an edit made outside is seen at the next one.
//!
//! It is evidence, not secrecy: a file can be edited by anything. What is found is told in the log, with both hashes.

use crate::events::insert_event;
use crate::{DataDirectory, Log, StoreError};
use ledger::{Event, Hash};
use rusqlite::{Connection, OptionalExtension, params};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use units::Timestamp;

/// An edit of a program by its named changes.
#[derive(Clone, Debug)]
pub struct ProgramEdit<'a> {
    /// The file that was read.
    pub from: &'a Path,
    /// The file that is written.
    pub to: &'a Path,
    /// Hash of the bytes that were read.
    pub before: Hash,
    /// Hash of the bytes that are written.
    pub after: Hash,
    /// The named differences, one for each change, in order.
    pub edits: Value,
    /// Who, why, and by which right, beside the fields above.
    pub by: BTreeMap<String, Value>,
    /// When.
    pub at: Timestamp,
}

/// What is known of a program file.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownProgram {
    /// Its hash then.
    pub hash: Hash,
    /// The event that tells it.
    pub event: Event,
}

/// Where a program lies, as the log calls it: without detours, so that two ways to a file are one file. A name that is no Unicode is
/// written with escapes.
pub fn program_key(path: &Path) -> Result<String, StoreError> {
    let whole = match path.canonicalize() {
        Ok(whole) => whole,
        // It is about to be written.
        Err(_) => {
            let whole = std::path::absolute(path).map_err(StoreError::io("find", path))?;
            match (whole.parent().map(Path::canonicalize), whole.file_name()) {
                (Some(Ok(folder)), Some(name)) => folder.join(name),
                _ => whole,
            }
        }
    };
    Ok(whole.to_str().map_or_else(|| format!("{whole:?}"), str::to_owned))
}

impl DataDirectory {
    /// What is known of a program file; `None` when it was never edited or run with this data directory.
    ///
    /// # Errors
    /// The disk refuses, or the event is not readable.
    pub fn known_program(&self, path: &Path) -> Result<Option<KnownProgram>, StoreError> {
        let key = program_key(path)?;
        let row: Option<(String, i64)> = self
            .database
            .query_row("SELECT sha256, event FROM programs WHERE path = ?1", [&key], |row| {
                Ok((row.get(0)?, row.get(1)?))
            })
            .optional()
            .map_err(self.failed())?;
        let Some((text, sequence)) = row else {
            return Ok(None);
        };
        let bad = |what: &str| StoreError::BadEvent {
            log: Log::Directory,
            sequence,
            what: what.to_owned(),
        };
        let hash = Hash::parse(&text).ok_or_else(|| bad("the hash of a known program is not 64 hexadecimal digits"))?;
        let event = self
            .event(sequence.unsigned_abs())?
            .ok_or_else(|| bad("it tells of a known program and is gone"))?;
        Ok(Some(KnownProgram { hash, event }))
    }

    /// Tells of an edit, before its file takes its name: killed in between, the next cycle start sees that the file is not what the log
    /// says.
    ///
    /// # Errors
    /// The disk refuses; nothing was told then.
    pub fn keep_edit(&mut self, edit: &ProgramEdit<'_>) -> Result<Event, StoreError> {
        let mut detail = edit.by.clone();
        detail.extend([
            ("from".to_owned(), Value::from(program_key(edit.from)?)),
            ("before_sha256".to_owned(), Value::from(edit.before.to_string())),
            ("edits".to_owned(), edit.edits.clone()),
        ]);
        self.tell_program(EDITED, edit.to, edit.after, detail, edit.at)
    }

    /// Tells of a program at its first cycle start here.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn keep_known(&mut self, path: &Path, hash: Hash, who: &str, at: Timestamp) -> Result<Event, StoreError> {
        let detail = BTreeMap::from([("who".to_owned(), Value::from(who))]);
        self.tell_program(KNOWN, path, hash, detail, at)
    }

    /// Tells of a program that is another one than was known, and is run all the same; from here on it is the known one.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn keep_changed_outside(
        &mut self,
        path: &Path,
        (before, found): (Hash, Hash),
        mut detail: BTreeMap<String, Value>,
        at: Timestamp,
    ) -> Result<Event, StoreError> {
        detail.insert("before_sha256".to_owned(), before.to_string().into());
        self.tell_program(CHANGED_OUTSIDE, path, found, detail, at)
    }

    fn tell_program(
        &mut self,
        kind: &str,
        path: &Path,
        hash: Hash,
        mut detail: BTreeMap<String, Value>,
        at: Timestamp,
    ) -> Result<Event, StoreError> {
        let (key, hash) = (program_key(path)?, hash.to_string());
        detail.insert("path".to_owned(), key.as_str().into());
        detail.insert("sha256".to_owned(), hash.as_str().into());
        self.in_transaction(|transaction, chain| {
            let event = chain.append(at, kind, detail);
            insert_event(transaction, Log::Directory, &event)?;
            transaction.execute(
                "INSERT INTO programs (path, sha256, event) VALUES (?1, ?2, ?3)
                 ON CONFLICT (path) DO UPDATE SET sha256 = excluded.sha256, event = excluded.event",
                params![key, hash, event.sequence as i64],
            )?;
            Ok(event)
        })
    }
}

const EDITED: &str = "program-edited";
const KNOWN: &str = "program-known";
const CHANGED_OUTSIDE: &str = "program-changed-outside";

/// True for the events after which a program's hash is known.
pub(crate) fn tells_a_program(kind: &str) -> bool {
    [EDITED, KNOWN, CHANGED_OUTSIDE].contains(&kind)
}

/// All rows: hash and event by path.
pub(crate) fn read_all(connection: &Connection) -> rusqlite::Result<BTreeMap<String, (String, u64)>> {
    let mut statement = connection.prepare("SELECT path, sha256, event FROM programs")?;
    let rows = statement.query_map([], |row| {
        Ok((row.get(0)?, (row.get(1)?, row.get::<_, i64>(2)?.unsigned_abs())))
    })?;
    rows.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_known_by_where_it_lies_whatever_the_way_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(&folder.path().join("data"), "test").expect("free");
        let path = folder.path().join("a.nc");
        std::fs::write(&path, "G0").expect("written");
        assert_eq!(directory.known_program(&path).expect("reads"), None);
        let hash = Hash::of(b"G0");
        directory.keep_known(&path, hash, "Maria", Timestamp(1)).expect("kept");
        let detour = folder.path().join("data/../a.nc");
        assert_eq!(directory.known_program(&detour).expect("reads").map(|k| k.hash), Some(hash));
        let other = Hash::of(b"G1");
        directory
            .keep_changed_outside(&path, (hash, other), BTreeMap::new(), Timestamp(2))
            .expect("kept");
        let known = directory.known_program(&path).expect("reads").expect("known");
        assert_eq!((known.hash, known.event.kind.as_str()), (other, CHANGED_OUTSIDE));
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn an_edit_makes_its_file_known_before_it_is_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(&folder.path().join("data"), "test").expect("free");
        let (from, to) = (folder.path().join("a.stpnc"), folder.path().join("b.stpnc"));
        std::fs::write(&from, "a").expect("written");
        let edit = ProgramEdit {
            from: &from,
            to: &to,
            before: Hash::of(b"a"),
            after: Hash::of(b"b"),
            edits: Value::Null,
            by: BTreeMap::from([("who".to_owned(), "Maria".into())]),
            at: Timestamp(1),
        };
        directory.keep_edit(&edit).expect("kept");
        std::fs::write(&to, "b").expect("written");
        assert_eq!(
            directory.known_program(&to).expect("reads").map(|k| k.hash),
            Some(Hash::of(b"b"))
        );
        assert_eq!(directory.known_program(&from).expect("reads"), None);
        for sql in ["UPDATE programs SET sha256 = 'x'", "DELETE FROM programs"] {
            assert!(directory.database.execute_batch(sql).is_err(), "{sql}");
        }
        assert_eq!(directory.verify().expect("verifies"), []);
    }
}

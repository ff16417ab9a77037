//! The tables, and how an older database becomes a newer one.
//!
//! The version stands in `PRAGMA user_version`, a mark that the file is ours in `PRAGMA application_id`. A step of migration is one
//! entry of [`MIGRATIONS`] and is never edited once released; the database is copied before the first step touches it.

use crate::{StoreError, whole_file};
use rusqlite::{Connection, OpenFlags};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// "TMRK": tells our files from other SQLite files.
const APPLICATION_ID: i64 = 0x544d_524b;

/// One entry a version: entry 0 makes version 1 of an empty file.
pub(crate) const MIGRATIONS: &[&str] = &[
    include_str!("schema/1.sql"),
    include_str!("schema/holds.sql"),
    include_str!("schema/sizing.sql"),
    include_str!("schema/operators.sql"),
    include_str!("schema/programs.sql"),
];

/// Opens the database at `path`, making or migrating it.
pub(crate) fn open(path: &Path, migrations: &[&str]) -> Result<Connection, StoreError> {
    let failed = |source| StoreError::Database {
        path: path.to_owned(),
        source,
    };
    let mut connection = Connection::open(path).map_err(failed)?;
    settings(&connection).map_err(failed)?;
    let found = version(&connection).map_err(failed)?;
    let known = migrations.len() as i64;
    if !is_ours(&connection, found).map_err(failed)? {
        return Err(StoreError::NotOurs { path: path.to_owned() });
    }
    if found > known {
        return Err(StoreError::Newer {
            path: path.to_owned(),
            found,
            known,
        });
    }
    if found > 0 && found < known {
        copy(&connection, path, found)?;
    }
    migrate(&mut connection, found, migrations).map_err(failed)?;
    // WAL: readers (a person's own sqlite3, a report) never stop the writer, and a commit is one sequential write. Set last, because
    // it changes the file: a database that we refuse is left as it was.
    connection.pragma_update(None, "journal_mode", "WAL").map_err(failed)?;
    Ok(connection)
}

fn migrate(connection: &mut Connection, found: i64, migrations: &[&str]) -> rusqlite::Result<()> {
    // One transaction, the version number inside it: killed at any moment, the file has the old version or the new one, and one that
    // is made has never a version in between that the next start would copy.
    let transaction = connection.transaction()?;
    for step in migrations.iter().skip(found.max(0) as usize) {
        transaction.execute_batch(step)?;
    }
    transaction.pragma_update(None, "user_version", migrations.len() as i64)?;
    transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
    transaction.commit()
}

/// Opens the database at `path` to be read, without a change to its file. An older one is migrated in memory.
pub(crate) fn read(path: &Path, migrations: &[&str]) -> Result<Connection, StoreError> {
    let failed = |source| StoreError::Database {
        path: path.to_owned(),
        source,
    };
    let text = path.to_str().ok_or_else(|| StoreError::NotUnicode(path.to_owned()))?;
    let wal = crate::directory::beside(path, "-wal");
    // Without a log to be read the file alone is the database, also on a medium that cannot be written; the caller keeps writers out.
    let alone = wal.metadata().map_or(true, |m| m.len() == 0);
    let uri = format!(
        "file:{}?mode=ro{}",
        text.replace('%', "%25").replace('?', "%3f").replace('#', "%23"),
        if alone { "&immutable=1" } else { "" }
    );
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let disk = Connection::open_with_flags(uri, flags).map_err(failed)?;
    disk.busy_timeout(Duration::from_secs(5)).map_err(failed)?;
    disk.pragma_update(None, "trusted_schema", false).map_err(failed)?;
    let found = version(&disk).map_err(failed)?;
    let known = migrations.len() as i64;
    if !is_ours(&disk, found).map_err(failed)? {
        return Err(StoreError::NotOurs { path: path.to_owned() });
    }
    if found > known {
        return Err(StoreError::Newer {
            path: path.to_owned(),
            found,
            known,
        });
    }
    if found == known {
        return Ok(disk);
    }
    let mut memory = Connection::open_in_memory().map_err(failed)?;
    rusqlite::backup::Backup::new(&disk, &mut memory)
        .and_then(|copy| copy.run_to_completion(1000, Duration::ZERO, None))
        .map_err(failed)?;
    migrate(&mut memory, found, migrations).map_err(failed)?;
    memory.pragma_update(None, "query_only", true).map_err(failed)?;
    Ok(memory)
}

/// The tables, triggers and indexes as this program makes them, for comparison.
pub(crate) fn fresh() -> rusqlite::Result<Connection> {
    let mut memory = Connection::open_in_memory()?;
    migrate(&mut memory, 0, MIGRATIONS)?;
    Ok(memory)
}

fn settings(connection: &Connection) -> rusqlite::Result<()> {
    // The lock file keeps other writers out; what is waited for is a person's own reader during a checkpoint.
    connection.busy_timeout(Duration::from_secs(5))?;
    // FULL: an acknowledged commit is on disk. NORMAL, the usual companion of WAL, may forget the last commits at a power loss, and
    // an offset change that was shown as applied must not be forgotten.
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    // Without it, INSERT OR REPLACE deletes a row without asking the DELETE trigger.
    connection.pragma_update(None, "recursive_triggers", true)?;
    // A database is data, not a program: its own triggers may not call functions with side effects.
    connection.pragma_update(None, "trusted_schema", false)
}

fn version(connection: &Connection) -> rusqlite::Result<i64> {
    connection.pragma_query_value(None, "user_version", |row| row.get(0))
}

fn is_ours(connection: &Connection, version: i64) -> rusqlite::Result<bool> {
    let mark: i64 = connection.pragma_query_value(None, "application_id", |row| row.get(0))?;
    let tables: i64 = connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
    Ok(mark == APPLICATION_ID || (mark == 0 && version == 0 && tables == 0))
}

/// Copies the database beside itself as `toolmark.sqlite.version-1`, `...version-1.2` and so on; an older copy is never replaced.
fn copy(connection: &Connection, path: &Path, version: i64) -> Result<PathBuf, StoreError> {
    let name = |n: u32| {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".version-{version}"));
        if n > 1 {
            name.push(format!(".{n}"));
        }
        PathBuf::from(name)
    };
    let copy = (1..)
        .map(name)
        .find(|p| !p.exists())
        .expect("there are more numbers than files");
    let temporary = whole_file::temporary_name(&copy);
    if temporary.exists() {
        std::fs::remove_file(&temporary).map_err(StoreError::io("remove", &temporary))?;
    }
    let text = temporary.to_str().ok_or_else(|| StoreError::NotUnicode(temporary.clone()))?;
    connection
        .execute("VACUUM INTO ?1", [text])
        .map_err(|source| StoreError::Database {
            path: path.to_owned(),
            source,
        })?;
    std::fs::File::open(&temporary)
        .and_then(|f| f.sync_all())
        .map_err(StoreError::io("sync", &temporary))?;
    std::fs::rename(&temporary, &copy).map_err(StoreError::io("rename", &temporary))?;
    whole_file::sync_folder_of(&copy)?;
    Ok(copy)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What there was first.
    const FIRST: &[&str] = &[MIGRATIONS[0]];
    const LATER: &[&str] = &[MIGRATIONS[0], "ALTER TABLE jobs ADD COLUMN part TEXT;"];

    fn tables_of(connection: &Connection) -> i64 {
        connection
            .query_row("SELECT count(*) FROM pragma_table_info('jobs')", [], |row| row.get(0))
            .expect("asks")
    }

    #[test]
    fn an_older_database_is_copied_and_then_migrated() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("toolmark.sqlite");
        let old = open(&path, FIRST).expect("made");
        let columns = tables_of(&old);
        old.execute("INSERT INTO jobs (program, program_sha256, machine, seed, start_ns, state, folder) VALUES ('a', 'b', 'c', '1', 2, 'done', 'd')", [])
            .expect("a row");
        drop(old);

        let new = open(&path, LATER).expect("migrated");
        assert_eq!((version(&new).expect("asks"), tables_of(&new)), (2, columns + 1));
        assert_eq!(
            new.query_row("SELECT program FROM jobs", [], |r| r.get::<_, String>(0))
                .expect("kept"),
            "a"
        );
        let copy = Connection::open(folder.path().join("toolmark.sqlite.version-1")).expect("the copy");
        assert_eq!((version(&copy).expect("asks"), tables_of(&copy)), (1, columns));
        assert_eq!(
            copy.query_row("SELECT program FROM jobs", [], |r| r.get::<_, String>(0))
                .expect("kept"),
            "a"
        );
    }

    #[test]
    fn a_migration_that_fails_leaves_the_old_version_and_its_data() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("toolmark.sqlite");
        drop(open(&path, FIRST).expect("made"));
        let broken = [MIGRATIONS[0], "ALTER TABLE jobs ADD COLUMN part TEXT; SELECT * FROM nowhere;"];
        assert!(matches!(open(&path, &broken), Err(StoreError::Database { .. })));
        let old = open(&path, FIRST).expect("still version 1");
        assert_eq!(
            old.query_row(
                "SELECT count(*) FROM pragma_table_info('jobs') WHERE name = 'part'",
                [],
                |r| r.get::<_, i64>(0)
            )
            .expect("asks"),
            0
        );
    }

    #[test]
    fn a_newer_database_is_refused_and_not_touched() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("toolmark.sqlite");
        drop(open(&path, LATER).expect("made by a newer program"));
        let before = std::fs::read(&path).expect("reads");
        let refused = open(&path, FIRST).expect_err("too new");
        assert_eq!(refused.exit_code(), 3);
        assert!(
            refused.to_string().contains("schema 2, this program knows up to 1"),
            "{refused}"
        );
        assert_eq!(std::fs::read(&path).expect("reads"), before);
    }

    #[test]
    fn somebody_elses_database_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("toolmark.sqlite");
        Connection::open(&path)
            .expect("made")
            .execute_batch("CREATE TABLE theirs (x)")
            .expect("a table");
        assert!(matches!(open(&path, FIRST), Err(StoreError::NotOurs { .. })));
    }
}

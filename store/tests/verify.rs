//! A changed byte anywhere in a data directory is found and named: in any file, in any cell of any table, on any page of the database.
//!
//! `SEED` picks other places; a seed that finds a hole becomes a named test.

mod common;

use common::{files_below, populate};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use rusqlite::types::Value;
use rusqlite::{Connection, params};
use std::path::Path;
use store::{DataDirectory, StoreError, verify};

fn seed() -> u64 {
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    println!("SEED={seed}");
    seed
}

fn findings(root: &Path) -> Vec<String> {
    match verify(root, |_| {}) {
        Ok(done) => done.findings.iter().map(ToString::to_string).collect(),
        // A changed version number looks like a newer program's; it is refused by name.
        Err(error @ StoreError::Newer { .. }) => vec![error.to_string()],
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn a_populated_directory_is_good_and_says_what_was_looked_at() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    populate(folder.path(), outside.path());
    let done = verify(folder.path(), |_| {}).expect("verifies");
    assert_eq!((&done.findings, &done.remarks), (&vec![], &vec![]));
    assert_eq!((done.jobs, done.records, done.values), (3, 3, 3));
    // Two records (one was removed by age), three reports, one program: the three jobs ran the same one.
    assert_eq!(done.files, 6);
    let directory = DataDirectory::read(folder.path()).expect("reads");
    let last = directory.last_event(store::Log::Directory).expect("reads").expect("there");
    assert_eq!((done.last_event, done.last_event_sha256), (last.sequence, last.hash));
    assert_eq!(done.events, last.sequence + 15);
}

#[test]
fn a_flipped_bit_in_any_file_is_found_and_the_file_is_named() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    populate(folder.path(), outside.path());
    let mut random = ChaCha8Rng::seed_from_u64(seed());
    let mut files = files_below(folder.path());
    files.retain(|name, _| !name.starts_with("toolmark.sqlite") && name != "lock");
    files.extend(files_below(outside.path()));
    // The same, and three roll-ups.
    assert_eq!(files.len(), 9, "{files:?}");
    for (name, path) in &files {
        let whole = std::fs::read(path).expect("reads");
        for _ in 0..12 {
            let at = random.next_u64() as usize % whole.len();
            let mut changed = whole.clone();
            changed[at] ^= 1 << (random.next_u32() % 8);
            std::fs::write(path, changed).expect("written");
            let found = findings(folder.path());
            assert_eq!(found.len(), 1, "byte {at} of {name}: {found:?}");
            let place = path.display().to_string();
            assert!(found[0].contains(&place), "{found:?}");
            let rollup = name.ends_with(".rollup");
            assert!(
                rollup || found[0].ends_with("its content is not what was recorded"),
                "{found:?}"
            );
        }
        if name.ends_with(".rollup") {
            // A roll-up can be made again from its record.
            std::fs::write(path, whole).expect("as it was");
            continue;
        }
        std::fs::remove_file(path).expect("removed");
        let found = findings(folder.path());
        assert!(found.len() == 1 && found[0].ends_with("is gone"), "{name}: {found:?}");
        std::fs::write(path, whole).expect("as it was");
    }
    std::fs::write(folder.path().join("jobs/strange.txt"), "x").expect("written");
    assert!(findings(folder.path())[0].contains("jobs/strange.txt: the log tells nothing of it"));
}

/// Every table with its columns and the words by which a finding names its rows.
const TABLES: &[(&str, &str)] = &[
    ("events", "table events, log"),
    ("holds", "(table holds)"),
    ("jobs", "(table jobs)"),
    ("operators", "(table operators)"),
    ("programs", "(table programs)"),
    ("registers", "(table registers)"),
    ("records", "(table records)"),
    ("removals", "(table removals)"),
    ("sizing_entries", "(table sizing_entries)"),
    ("sizing_jobs", "(table sizing_jobs)"),
    ("sqlite_sequence", "(table sqlite_sequence)"),
];

#[test]
fn a_change_in_any_cell_of_any_table_is_found_and_its_table_is_named() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    populate(folder.path(), outside.path());
    let path = folder.path().join("toolmark.sqlite");
    let whole = std::fs::read(&path).expect("reads");
    let strings = |sql: &str| -> Vec<String> {
        let connection = Connection::open(&path).expect("opens");
        let mut statement = connection.prepare(sql).expect("asks");
        let rows = statement.query_map([], |row| row.get(0)).expect("asks");
        rows.collect::<Result<_, _>>().expect("lists")
    };
    let tables = strings("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name");
    assert_eq!(tables.len(), TABLES.len(), "a new table is tried here too: {tables:?}");
    let triggers = strings("SELECT sql FROM sqlite_schema WHERE type = 'trigger'");
    let names = strings("SELECT name FROM sqlite_schema WHERE type = 'trigger'");
    let mut tried = 0;
    for (table, words) in TABLES {
        for column in strings(&format!("SELECT name FROM pragma_table_info('{table}')")) {
            let rows = strings(&format!("SELECT count(*) || '' FROM {table}"))[0]
                .parse::<i64>()
                .expect("a number");
            // The first, the last and one in the middle of each column.
            for row in [0, rows / 2, rows - 1] {
                let forger = Connection::open(&path).expect("opens");
                forger.pragma_update(None, "foreign_keys", false).expect("set");
                for name in &names {
                    forger.execute_batch(&format!("DROP TRIGGER {name}")).expect("dropped");
                }
                let cell: Value = forger
                    .query_row(&format!("SELECT {column} FROM {table} LIMIT 1 OFFSET ?1"), [row], |r| {
                        r.get(0)
                    })
                    .expect("reads");
                let forged = match (cell, column.as_str()) {
                    // Another one that the table allows.
                    (Value::Integer(n), "level") => Value::Integer(n % 10 + 1),
                    (Value::Integer(n), _) => Value::Integer(n + 1000),
                    (Value::Real(x), _) => Value::Real(-x),
                    (Value::Null, _) => Value::Integer(5),
                    (Value::Text(t), "detail") => Value::Text(t.replacen(':', ": ", 1)),
                    (Value::Text(t), "state") if t == "removed" => Value::Text("marked".to_owned()),
                    (Value::Text(t), "state") => Value::Text(if t == "done" { "failed" } else { "done" }.to_owned()),
                    (Value::Text(t), _) => {
                        Value::Text(format!("{}{}", &t[..t.len() - 1], if t.ends_with('x') { 'y' } else { 'x' }))
                    }
                    (Value::Blob(_), _) => unreachable!("no table holds a blob"),
                };
                let key = strings(&format!(
                    "SELECT coalesce(group_concat(name, ' || ''/'' || '), 'name') FROM (SELECT name FROM pragma_table_info('{table}') WHERE pk > 0 ORDER BY pk)"
                ));
                let key = &key[0];
                let changed = forger
                    .execute(
                        &format!(
                            "UPDATE {table} SET {column} = ?1 WHERE ({key}) = (SELECT {key} FROM {table} LIMIT 1 OFFSET ?2)"
                        ),
                        params![forged, row],
                    )
                    .unwrap_or_else(|e| panic!("{table}.{column} = {forged:?}: {e}"));
                assert_eq!(changed, 1, "{table}.{column} row {row}");
                for sql in &triggers {
                    forger.execute_batch(sql).expect("made again");
                }
                drop(forger);
                let found = findings(folder.path());
                assert!(
                    found.iter().any(|f| f.contains(words)),
                    "{table}.{column} row {row} = {forged:?}: {found:?}"
                );
                std::fs::write(&path, &whole).expect("as it was");
                tried += 1;
            }
        }
    }
    println!("{tried} cells");
    assert_eq!(findings(folder.path()), Vec::<String>::new());
}

/// Everything that a person can read out of a database.
fn content(path: &Path) -> Option<Vec<String>> {
    let connection = Connection::open_with_flags(path, rusqlite::OpenFlags::SQLITE_OPEN_READ_ONLY).ok()?;
    let mut all = Vec::new();
    for table in [
        "sqlite_schema",
        "events",
        "holds",
        "jobs",
        "operators",
        "programs",
        "registers",
        "records",
        "removals",
        "sqlite_sequence",
    ] {
        let columns = if table == "sqlite_schema" {
            "type, name, tbl_name, sql"
        } else {
            "*"
        };
        let mut statement = connection.prepare(&format!("SELECT {columns} FROM {table}")).ok()?;
        let count = statement.column_count();
        let mut rows = statement.query([]).ok()?;
        while let Some(row) = rows.next().ok()? {
            let cells: Option<Vec<String>> = (0..count).map(|k| row.get_ref(k).ok().map(|v| format!("{v:?}"))).collect();
            all.push(format!("{table}: {}", cells?.join("|")));
        }
    }
    Some(all)
}

#[test]
fn a_flipped_bit_in_the_database_is_found_or_lies_where_nothing_is_recorded() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    populate(folder.path(), outside.path());
    let path = folder.path().join("toolmark.sqlite");
    let whole = std::fs::read(&path).expect("reads");
    let before = content(&path).expect("reads");
    let mut random = ChaCha8Rng::seed_from_u64(seed());
    let (mut found_count, mut harmless) = (0, 0);
    // Every byte of the head once, then places at random.
    let head = (0..100).map(|at| (at, 1u8 << (at % 8)));
    let places: Vec<(usize, u8)> = head
        .chain((0..700).map(|_| (random.next_u64() as usize % whole.len(), 1 << (random.next_u32() % 8))))
        .collect();
    for (at, bit) in places {
        let mut changed = whole.clone();
        changed[at] ^= bit;
        std::fs::write(&path, changed).expect("written");
        let found = findings(folder.path());
        for rest in ["-wal", "-shm", "-journal"] {
            let _ = std::fs::remove_file(folder.path().join(format!("toolmark.sqlite{rest}")));
        }
        if found.is_empty() {
            assert_eq!(
                content(&path).as_ref(),
                Some(&before),
                "byte {at}, bit {bit}: a change that nobody found"
            );
            harmless += 1;
        } else {
            let named = |f: &String| {
                f.contains("toolmark.sqlite") || f.contains("table ") || f.contains("trigger ") || f.contains("index ")
            };
            assert!(found.iter().any(named), "{found:?}");
            found_count += 1;
        }
    }
    println!("{found_count} found, {harmless} where nothing is recorded");
    assert!(found_count > 200, "{found_count}");
    std::fs::write(&path, &whole).expect("as it was");
    assert_eq!(findings(folder.path()), Vec::<String>::new());
}

#[test]
fn a_changed_byte_in_the_write_ahead_log_of_a_killed_process_is_found() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let copy = tempfile::tempdir().expect("a folder");
    populate(folder.path(), outside.path());
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    for n in 0..5 {
        directory
            .append(
                common::START,
                "noted",
                std::collections::BTreeMap::from([("n".to_owned(), n.into())]),
            )
            .expect("written");
    }
    // What a kill leaves: database and log as they are on disk now.
    let whole = std::fs::read(folder.path().join("toolmark.sqlite-wal")).expect("a log");
    for (name, path) in files_below(folder.path()) {
        let to = copy.path().join(&name);
        std::fs::create_dir_all(to.parent().expect("a folder")).expect("made");
        if !name.ends_with("-shm") {
            std::fs::copy(path, to).expect("copied");
        }
    }
    let log = copy.path().join("toolmark.sqlite-wal");
    let mut random = ChaCha8Rng::seed_from_u64(seed());
    for _ in 0..40 {
        let at = random.next_u64() as usize % whole.len();
        let mut changed = whole.clone();
        changed[at] ^= 1 << (random.next_u32() % 8);
        std::fs::write(&log, changed).expect("written");
        let found = findings(copy.path());
        assert!(
            found.iter().any(|f| f.starts_with("toolmark.sqlite-wal: ")),
            "byte {at}: {found:?}"
        );
    }
    std::fs::write(&log, whole).expect("as it was");
    assert_eq!(findings(copy.path()), Vec::<String>::new());
}

#[test]
fn unfinished_files_are_a_remark() {
    let (folder, outside) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    populate(folder.path(), outside.path());
    std::fs::write(folder.path().join("records/x.parquet.tmp"), "half").expect("written");
    let done = verify(folder.path(), |_| {}).expect("verifies");
    assert_eq!(done.findings, []);
    assert!(
        done.remarks[0].to_string().contains("records/x.parquet.tmp: is unfinished"),
        "{:?}",
        done.remarks
    );
}

#[test]
fn what_is_no_data_directory_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = verify(folder.path(), |_| {}).expect_err("empty");
    assert_eq!(refused.exit_code(), 3);
    assert!(
        refused.to_string().contains("it is neither a data directory nor a backup"),
        "{refused}"
    );
    std::fs::write(
        folder.path().join("toolmark.sqlite"),
        "not SQLite at all, but long enough to be looked at as one",
    )
    .expect("written");
    assert!(
        findings(folder.path())[0].starts_with("toolmark.sqlite: "),
        "{:?}",
        findings(folder.path())
    );
}

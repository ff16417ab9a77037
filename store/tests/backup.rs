//! Backups: whole or recognised as not whole, brought back as they were, and never worse for a damaged source.

mod common;

use common::{START, files_below, populate, run_a_job};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use store::backup::{Manifest, restore};
use store::{DataDirectory, Log, StoreError, verify};
use tempfile::TempDir;
use units::Timestamp;

const CHILD: &str = "STORE_TEST_BACKUP_CHILD";

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

fn backup(root: &Path, to: &Path) -> store::backup::Backup {
    let mut directory = DataDirectory::open(root, "test").expect("free");
    directory.backup(to, START, "Maria", |_| {}).expect("backed up")
}

#[track_caller]
fn good(root: &Path) -> store::Verification {
    let done = verify(root, |_| {}).expect("verifies");
    assert_eq!((&done.findings, &done.remarks), (&vec![], &vec![]));
    done
}

#[test]
fn a_backup_is_whole_can_be_looked_into_and_comes_back() {
    let (data, outside, to, back) = (folder(), folder(), folder(), folder());
    populate(data.path(), outside.path());
    let made = backup(data.path(), to.path());
    assert_eq!(made.manifest.problems, [""; 0]);
    assert_eq!(
        (made.copied, made.unchanged),
        (10, 0),
        "six files, three roll-ups and the database"
    );
    good(to.path());
    good(data.path());
    // The disk that held the data and what lay outside of it are gone.
    drop((data, outside));
    let looked = good(to.path());
    assert_eq!((looked.jobs, looked.records, looked.files), (3, 3, 6));
    let directory = DataDirectory::read(to.path()).expect("reads");
    for row in directory.records().expect("reads") {
        if row.job.0 == 2 {
            continue; // its rows were removed by age
        }
        assert!(row.path.starts_with(to.path()), "{}", row.path.display());
        assert_eq!(store::record::Reader::open(&row.path).expect("ours").len(), row.rows);
    }
    drop(directory);

    let done = restore(to.path(), back.path(), Timestamp(START.0 + 1), "Maria", |_| {}).expect("restored");
    assert_eq!(done.findings, []);
    let restored = good(back.path());
    assert_eq!((restored.jobs, restored.records, restored.files), (3, 3, 6));
    let mut directory = DataDirectory::open(back.path(), "test").expect("a data directory again");
    let last = directory.last_event(Log::Directory).expect("reads").expect("there");
    assert_eq!(
        (last.kind.as_str(), last.sequence),
        ("restored", made.manifest.last_event + 1)
    );
    run_a_job(&mut directory, None, 100);
    drop(directory);
    good(back.path());
}

#[test]
fn a_second_backup_copies_only_what_is_new() {
    let (data, outside, to) = (folder(), folder(), folder());
    populate(data.path(), outside.path());
    backup(data.path(), to.path());
    let mut directory = DataDirectory::open(data.path(), "test").expect("free");
    run_a_job(&mut directory, None, 100);
    drop(directory);
    let again = backup(data.path(), to.path());
    assert_eq!(
        (again.copied, again.unchanged),
        (4, 9),
        "the new record, its roll-up, its report and the database"
    );
    good(to.path());
}

#[test]
fn a_place_that_cannot_be_a_backup_is_refused_and_left_alone() {
    let (data, outside, strange, other) = (folder(), folder(), folder(), folder());
    populate(data.path(), outside.path());
    std::fs::write(strange.path().join("letter.txt"), "dear").expect("written");
    populate(other.path(), folder().path());
    let of_another = folder();
    let mut second = DataDirectory::open(&other.path().join("second"), "test").expect("free");
    second
        .append(Timestamp(3), "noted", std::collections::BTreeMap::new())
        .expect("written");
    second.backup(of_another.path(), START, "Maria", |_| {}).expect("backed up");
    drop(second);
    let mut directory = DataDirectory::open(data.path(), "test").expect("free");
    let mut refused = |to: &Path| {
        let error = directory.backup(to, START, "Maria", |_| {}).expect_err("no place");
        assert_eq!(error.exit_code(), 2);
        error.to_string()
    };
    assert!(refused(strange.path()).contains("neither empty nor a backup"));
    assert!(refused(other.path()).contains("a data directory itself"));
    assert!(refused(&data.path().join("backup")).contains("outside of its data directory"));
    assert!(refused(data.path()).contains("outside of its data directory"));
    assert!(refused(of_another.path()).contains("a backup of another data directory"));
    assert_eq!(files_below(strange.path()).len(), 1);
    good(of_another.path());
}

#[test]
fn nobody_works_in_a_backup() {
    let (data, outside, to) = (folder(), folder(), folder());
    populate(data.path(), outside.path());
    backup(data.path(), to.path());
    let refused = DataDirectory::open(to.path(), "test").expect_err("a backup");
    assert!(
        matches!(refused, StoreError::IsBackup(_)) && refused.exit_code() == 2,
        "{refused}"
    );
    good(to.path());
}

#[test]
fn a_damaged_source_does_not_spoil_the_good_copy() {
    let (data, outside, to) = (folder(), folder(), folder());
    populate(data.path(), outside.path());
    backup(data.path(), to.path());
    let (name, path) = files_below(data.path())
        .into_iter()
        .find(|(name, _)| name.ends_with(".parquet"))
        .expect("a record");
    let mut bytes = std::fs::read(&path).expect("reads");
    bytes[99] ^= 1;
    std::fs::write(&path, bytes).expect("written");
    let again = backup(data.path(), to.path());
    assert_eq!(
        again.manifest.problems,
        [format!(
            "{name}: its content is not what was recorded; the good copy of an earlier backup was kept"
        )]
    );
    good(to.path());
    // Without an earlier copy the damaged one is all there is, and the manifest says so.
    let first = folder();
    let made = backup(data.path(), first.path());
    assert_eq!(
        made.manifest.problems,
        [format!("{name}: its content is not what was recorded")]
    );
    std::fs::remove_file(&path).expect("removed");
    let gone = folder();
    let made = backup(data.path(), gone.path());
    assert_eq!(made.manifest.problems, [format!("{name}: is gone")]);
}

#[test]
fn a_restore_checks_first_and_says_what_is_missing() {
    let (data, outside, to, back) = (folder(), folder(), folder(), folder());
    populate(data.path(), outside.path());
    backup(data.path(), to.path());
    let there = files_below(to.path());
    for (name, path) in there.iter().filter(|(name, _)| *name != "backup.json") {
        let whole = std::fs::read(path).expect("reads");
        let mut changed = whole.clone();
        let middle = changed.len() / 2;
        changed[middle] ^= 4;
        std::fs::write(path, changed).expect("written");
        let found = verify(to.path(), |_| {}).expect("verifies").findings;
        assert!(
            found.iter().any(|f| f.to_string().contains(name.as_str())),
            "{name}: {found:?}"
        );
        let refused = restore(to.path(), back.path(), START, "Maria", |_| {}).expect_err("changed");
        assert!(
            refused.to_string().contains(&format!("{name} its content is not")),
            "{refused}"
        );
        std::fs::remove_file(path).expect("removed");
        let refused = restore(to.path(), back.path(), START, "Maria", |_| {}).expect_err("missing");
        assert_eq!(refused.exit_code(), 3);
        assert!(refused.to_string().contains(&format!("{name} is missing")), "{refused}");
        std::fs::write(path, whole).expect("as it was");
    }
    assert_eq!(files_below(back.path()).len(), 0, "nothing was written");
    std::fs::write(back.path().join("x"), "x").expect("written");
    let refused = restore(to.path(), back.path(), START, "Maria", |_| {}).expect_err("not empty");
    assert!(refused.to_string().contains("never writes over anything"), "{refused}");
    assert_eq!(refused.exit_code(), 2);
    let refused = restore(data.path(), folder().path(), START, "Maria", |_| {}).expect_err("no backup");
    assert!(refused.to_string().contains("so it is no backup"), "{refused}");
}

/// The child: backs up, or restores, until it is killed.
#[test]
fn child() {
    let Ok(what) = std::env::var(CHILD) else {
        return; // run as an ordinary test it has nothing to do
    };
    let parts: Vec<&str> = what.split('\n').collect();
    let slowly = |_: &str| std::thread::sleep(Duration::from_millis(15));
    match parts[..] {
        ["backup", data, to] => {
            let mut directory = DataDirectory::open(Path::new(data), "test").expect("free");
            directory.backup(Path::new(to), START, "Maria", slowly).expect("backed up");
        }
        ["restore", from, to] => {
            restore(Path::new(from), Path::new(to), START, "Maria", slowly).expect("restored");
        }
        _ => panic!("{what}"),
    }
}

fn kill_in_the_middle(words: &[&str], until: impl Fn() -> bool) {
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "child", "--nocapture", "--test-threads=1"])
        .env(CHILD, words.join("\n"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let begun = (0..2000).any(|_| {
        std::thread::sleep(Duration::from_millis(5));
        until()
    });
    child.kill().expect("killed");
    child.wait().expect("gone");
    assert!(begun, "it began to write");
}

#[test]
fn a_backup_that_was_killed_is_recognised_and_made_whole_by_the_next() {
    let (data, outside, to, back) = (folder(), folder(), folder(), folder());
    populate(data.path(), outside.path());
    let [from, there] = [data.path(), to.path()].map(|p| p.to_str().expect("Unicode"));
    let some_files = || files_below(to.path()).keys().any(|name| name.ends_with("report.json"));
    kill_in_the_middle(&["backup", from, there], some_files);
    assert!(!to.path().join("backup.json").exists());
    let refused = restore(to.path(), back.path(), START, "Maria", |_| {}).expect_err("half");
    assert!(
        matches!(refused, StoreError::HalfBackup(_)) && refused.exit_code() == 3,
        "{refused}"
    );
    assert!(matches!(verify(to.path(), |_| {}), Err(StoreError::HalfBackup(_))));
    let again = backup(data.path(), to.path());
    assert!(again.unchanged > 0, "what was copied whole is not copied twice");
    good(to.path());

    // A whole backup that is being brought up to date is not whole meanwhile either.
    kill_in_the_middle(&["backup", from, there], || !to.path().join("backup.json").exists());
    assert!(matches!(Manifest::read(to.path()), Err(StoreError::HalfBackup(_))));
    backup(data.path(), to.path());
    good(to.path());
}

#[test]
fn a_restore_that_was_killed_is_recognised() {
    let (data, outside, to, back) = (folder(), folder(), folder(), folder());
    populate(data.path(), outside.path());
    backup(data.path(), to.path());
    let [from, there] = [to.path(), back.path()].map(|p| p.to_str().expect("Unicode"));
    kill_in_the_middle(&["restore", from, there], || files_below(back.path()).len() > 2);
    let refused = DataDirectory::open(back.path(), "test").expect_err("half");
    assert!(matches!(refused, StoreError::HalfRestore(_)), "{refused}");
    assert!(
        refused.to_string().contains("empty the folder and restore again"),
        "{refused}"
    );
    assert!(matches!(verify(back.path(), |_| {}), Err(StoreError::HalfRestore(_))));
}

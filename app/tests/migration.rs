//! A data directory of an older program is copied and migrated; one of a newer program is refused and left as it is.

use rusqlite::Connection;
use std::path::Path;
use std::process::{Command, Output};

/// Version 1 as it was released. A copy and not the program's own file: what lies on people's disks does not change with ours.
const VERSION_1: &str = include_str!("data/version-1.sql");

fn toolmark(args: &[&str], data: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(args)
        .env("TOOLMARK_DATA", data)
        .output()
        .expect("the binary starts")
}

fn words(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn version_of(path: &Path) -> i64 {
    let connection = Connection::open(path).expect("opens");
    connection
        .pragma_query_value(None, "user_version", |row| row.get(0))
        .expect("asks")
}

fn an_old_directory() -> tempfile::TempDir {
    let data = tempfile::tempdir().expect("a folder");
    let connection = Connection::open(data.path().join("toolmark.sqlite")).expect("made");
    connection.execute_batch(VERSION_1).expect("the tables of version 1");
    connection.pragma_update(None, "user_version", 1).expect("set");
    connection.pragma_update(None, "application_id", 0x544d_524b).expect("set");
    let mut chain = ledger::Chain::default();
    let mut put = |kind: &str, at: i64, detail: serde_json::Value| {
        let serde_json::Value::Object(detail) = detail else {
            panic!("a map")
        };
        let event = chain.append(units::Timestamp(at), kind, detail.into_iter().collect());
        let detail = serde_json::to_string(&event.detail).expect("JSON");
        connection
            .execute(
                "INSERT INTO events VALUES (0, ?1, ?2, ?3, ?4, ?5, ?6)",
                rusqlite::params![
                    event.sequence as i64,
                    event.at_ns,
                    event.kind,
                    detail,
                    event.previous,
                    event.hash
                ],
            )
            .expect("an event");
    };
    let zeros = "0".repeat(64);
    let job = serde_json::json!({ "job": 1, "program": "old.nc", "program_sha256": zeros, "machine": "sim-mill", "seed": 1,
                                  "folder": "jobs/000001", "who": "Maria" });
    put("job-started", 1_795_132_800_000_000_000, job);
    let end = serde_json::json!({ "job": 1, "state": "done", "events": 0, "last_hash": zeros });
    put("job-ended", 1_795_132_801_000_000_000, end);
    let job = "INSERT INTO jobs VALUES (1, 'old.nc', ?1, 'sim-mill', '1', 1795132800000000000, 1795132801000000000, 'done', 'jobs/000001')";
    connection.execute(job, [zeros]).expect("a job");
    data
}

#[test]
fn an_older_directory_is_read_as_it_is_and_migrated_after_a_copy_by_who_works_in_it() {
    let data = an_old_directory();
    let database = data.path().join("toolmark.sqlite");
    let before = std::fs::read(&database).expect("reads");
    for verb in ["list", "verify"] {
        let output = toolmark(&["trace", verb], data.path());
        assert_eq!(output.status.code(), Some(0), "{verb}: {}", words(&output));
    }
    assert!(words(&toolmark(&["trace", "list"], data.path())).contains("old.nc"));
    assert_eq!(
        std::fs::read(&database).expect("reads"),
        before,
        "who only looks changes nothing"
    );

    let plate = format!("{}/../corpus/plate.nc", env!("CARGO_MANIFEST_DIR"));
    let output = toolmark(&["run", &plate, "--fast"], data.path());
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(version_of(&database) > 1);
    assert_eq!(version_of(&data.path().join("toolmark.sqlite.version-1")), 1);
    let output = toolmark(&["trace", "verify"], data.path());
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    let listed = words(&toolmark(&["trace", "list"], data.path()));
    assert!(listed.contains("old.nc") && listed.contains("plate.nc"), "{listed}");
}

#[test]
fn a_newer_directory_is_refused_with_3_and_left_as_it_is() {
    let data = an_old_directory();
    let database = data.path().join("toolmark.sqlite");
    let connection = Connection::open(&database).expect("opens");
    connection.pragma_update(None, "user_version", 99).expect("set");
    drop(connection);
    let before = std::fs::read(&database).expect("reads");
    let plate = format!("{}/../corpus/plate.nc", env!("CARGO_MANIFEST_DIR"));
    let to = data.path().with_extension("copy");
    for args in [
        &["run", &plate, "--fast"][..],
        &["trace", "list"],
        &["trace", "verify"],
        &["backup", to.to_str().expect("Unicode")],
    ] {
        let output = toolmark(args, data.path());
        assert_eq!(output.status.code(), Some(3), "{args:?}: {}", words(&output));
        assert!(
            words(&output).contains("has schema 99, this program knows up to"),
            "{}",
            words(&output)
        );
    }
    assert_eq!(std::fs::read(&database).expect("reads"), before);
    assert!(!to.exists());
}

//! Old rows go, a job on hold keeps its own.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const PROGRAM: &str = "G21 G90\nG54\nT1 M6\nS1000 M3\nG0 X0 Y0 Z5\nG1 Z0 F300\nG1 X5\nG0 Z5\nM30\n";

fn toolmark(args: &[&str], data: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(args)
        .env("TOOLMARK_DATA", data)
        .output()
        .expect("the binary starts")
}

#[track_caller]
fn json(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}\n{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn rows_of_long_ago_are_removed_but_not_those_of_a_job_on_hold() {
    let data = tempfile::tempdir().expect("a folder");
    let program = data.path().join("part.nc");
    std::fs::write(&program, PROGRAM).expect("written");
    let run = |start: &str| -> Output {
        let program = program.display().to_string();
        let args = ["run", &program, "--fast", "--machine", "sim-mill", "--start", start, "--json"];
        toolmark(&args, data.path())
    };
    let folder = |output: &Output| json(output)["folder"].as_str().expect("a folder").to_owned();
    let first = folder(&run("2026-01-05T08:00:00Z"));
    let second = folder(&run("2026-01-06T08:00:00Z"));
    let is_there = |folder: &str| Path::new(folder).join("record.parquet").exists();
    assert!(is_there(&first) && is_there(&second));

    let without_reason = toolmark(&["hold", "1"], data.path());
    assert_eq!(without_reason.status.code(), Some(2));
    let unknown = toolmark(&["hold", "77", "--reason", "x"], data.path());
    assert_eq!(unknown.status.code(), Some(2));
    let last = json(&toolmark(&["hold", "last", "--reason", "looked at", "--json"], data.path()));
    assert_eq!(last["job"], Value::from(2));
    toolmark(&["hold", "last", "--release", "--reason", "settled"], data.path());
    let held = toolmark(
        &["hold", "1", "--reason", "the customer asked", "--operator", "Maria", "--json"],
        data.path(),
    );
    let held = json(&held);
    assert_eq!(
        (&held["job"], &held["held"], &held["who"]),
        (&Value::from(1), &Value::from(true), &Value::from("Maria"))
    );

    let third = run("2026-11-21T08:00:00Z");
    let said = String::from_utf8_lossy(&third.stderr).into_owned();
    assert!(said.contains("was removed, its last row is more than 90 days old"), "{said}");
    assert!(is_there(&first) && !is_there(&second) && is_there(&folder(&third)));

    let released = toolmark(&["hold", "1", "--release", "--reason", "settled", "--json"], data.path());
    assert_eq!(json(&released)["held"], Value::from(false));
    run("2026-11-21T09:00:00Z");
    assert!(!is_there(&first));
}

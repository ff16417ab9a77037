//! `toolmark backup` and `toolmark restore`: the real binary, a real run, another disk.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

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

#[track_caller]
fn ends(output: &Output, code: i32) -> Value {
    assert_eq!(output.status.code(), Some(code), "{}", words(output));
    serde_json::from_slice(&output.stdout).unwrap_or_default()
}

#[test]
fn a_backup_can_be_looked_into_and_comes_back_on_another_disk() {
    let folder = tempfile::tempdir().expect("a folder");
    let place = |name: &str| folder.path().join(name);
    let text = |name: &str| place(name).to_str().expect("Unicode").to_owned();
    let plate = format!("{}/../corpus/plate.nc", env!("CARGO_MANIFEST_DIR"));
    let data = place("data");
    // One job in the data directory, one that wrote elsewhere.
    ends(&toolmark(&["run", &plate, "--fast"], &data), 0);
    ends(&toolmark(&["run", &plate, "--fast", "--out", &text("elsewhere")], &data), 0);
    let told = ends(&toolmark(&["backup", &text("copy"), "--json"], &data), 0);
    assert_eq!((&told["problems"], &told["unchanged"]), (&serde_json::json!([]), &0.into()));
    let again = ends(&toolmark(&["backup", &text("copy"), "--json"], &data), 0);
    assert_eq!(
        (&again["copied"], &again["files"]),
        (&1.into(), &told["files"]),
        "the database alone"
    );

    std::fs::remove_dir_all(&data).expect("the disk is gone");
    std::fs::remove_dir_all(place("elsewhere")).expect("and the other");
    ends(&toolmark(&["trace", "verify", &text("copy")], &data), 0);
    let listed = ends(&toolmark(&["trace", "list", &text("copy"), "--json"], &data), 0);
    assert_eq!(listed["jobs"].as_array().map(Vec::len), Some(2));
    for job in ["1", "2"] {
        let csv = text("from-copy.csv");
        ends(&toolmark(&["trace", "export", job, &text("copy"), "--out", &csv], &data), 0);
        ends(&toolmark(&["trace", "show", job, &text("copy")], &data), 0);
    }
    let refused = toolmark(&["run", &plate, "--fast", "--data", &text("copy")], &data);
    ends(&refused, 2);
    assert!(
        words(&refused).contains("is a backup and stays as it is"),
        "{}",
        words(&refused)
    );

    let restored = ends(
        &toolmark(&["restore", &text("copy"), "--data", &text("back"), "--json"], &data),
        0,
    );
    assert_eq!(restored["verified"], true);
    ends(&toolmark(&["trace", "verify", &text("back")], &data), 0);
    ends(&toolmark(&["run", &plate, "--fast", "--data", &text("back")], &data), 0);
    ends(&toolmark(&["trace", "verify", &text("back")], &data), 0);

    let twice = toolmark(&["restore", &text("copy"), "--data", &text("back")], &data);
    ends(&twice, 2);
    assert!(words(&twice).contains("never writes over anything"), "{}", words(&twice));
    std::fs::remove_file(place("copy/jobs/000001/report.html")).expect("removed");
    let missing = toolmark(&["restore", &text("copy"), "--data", &text("new")], &data);
    ends(&missing, 3);
    assert!(
        words(&missing).contains("jobs/000001/report.html is missing"),
        "{}",
        words(&missing)
    );
    assert!(!place("new").exists());
}

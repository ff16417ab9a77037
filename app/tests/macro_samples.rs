//! Macro programs of other people through the binary: interpreted, checked, planned and run.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/samples");

#[track_caller]
fn run(data: &Path, exit: i32, words: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(words)
        .args(["--json", "--data"])
        .arg(data)
        .output()
        .expect("the binary starts");
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert_eq!(output.status.code(), Some(exit), "{words:?}: {out}{err}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{words:?}: {e}: {out}{err}"))
}

/// `reaches` is false for a program that leaves the travel of the simulated mill: it must be refused before anything moves.
#[track_caller]
fn check(sample: &str, reaches: bool) {
    let path = format!("{SAMPLES}/{sample}");
    if !Path::new(&path).exists() {
        println!("skipped: no sample {path}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let name = |file: &str| folder.path().join(file).display().to_string();
    let interpreted = run(&data, 0, &["macro", "run", &path]);
    let moves = interpreted["path"].as_array().map_or(0, Vec::len);
    assert!(moves > 0, "{sample} moves");
    run(&data, i32::from(!reaches), &["check", &path]);
    let planned = run(&data, 0, &["plan", &path, "--out", &name("plan.parquet")]);
    assert!(planned["samples"].as_u64() > Some(0));
    if reaches {
        let ran = run(&data, 0, &["run", &path, "--fast", "--out", &name("out")]);
        assert_eq!(
            (&ran["ended"], &ran["report"]["verdict"]),
            (&Value::from("completed"), &Value::from("good"))
        );
    }
}

#[test]
fn a_main_program_that_computes_its_own_addresses_runs() {
    check("macro-b/macro_b.nc", true);
}

#[test]
fn a_macro_that_mills_a_face_runs() {
    check("macro-b/macro_face_milling.nc", true);
}

#[test]
fn a_thread_that_leaves_the_travel_is_refused() {
    check("macro-b/macro_thread_milling.nc", false);
}

#[test]
fn two_set_ups_of_a_part_that_was_really_made_run() {
    check("mtconnect/nist-sms/827-9999-904-OP1.NC", true);
    check("mtconnect/nist-sms/827-9999-904-OP2.NC", true);
}

//! Cases of Custom Macro B through the program itself: `toolmark macro run PROGRAM --setup S.json --json`.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn every_shared_case_behaves_as_it_says() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/reference/macro-cases.jsonl");
    match std::fs::read_to_string(path) {
        Ok(cases) => check(&cases),
        Err(why) => println!("skipped: {path}: {why}; it stands beside the repository in shared/"),
    }
}

#[test]
fn every_case_of_ours_behaves_as_it_says() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/macro-cases.jsonl");
    check(&std::fs::read_to_string(path).expect("it belongs to the repository"));
}

fn check(cases: &str) {
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = Vec::new();
    let mut count = 0;
    for line in cases.lines().filter(|l| !l.trim().is_empty()) {
        let case: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        let name = case["name"].as_str().expect("a name");
        let (answer, exit) = run(&case, folder.path());
        let expect = &case["expect"];
        let alarms = !expect["alarm"].is_null();
        if exit != i32::from(alarms) {
            wrong.push(format!("{name}: exit {exit}"));
        }
        wrong.extend(differences(expect, &answer).into_iter().map(|d| format!("{name}: {d}")));
        count += 1;
    }
    println!("{count} cases run");
    assert!(count > 0, "no case was found");
    assert!(wrong.is_empty(), "of {count} cases:\n{}", wrong.join("\n"));
}

fn run(case: &Value, folder: &Path) -> (Value, i32) {
    let (program, setup) = (folder.join("case.nc"), folder.join("setup.json"));
    std::fs::write(&program, case["program"].as_str().expect("a program")).unwrap();
    std::fs::write(&setup, case["setup"].to_string()).unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(["macro", "run"])
        .arg(&program)
        .arg("--setup")
        .arg(&setup)
        .arg("--json")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let answer = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}{}", String::from_utf8_lossy(&out.stderr)));
    (answer, out.status.code().unwrap_or(-1))
}

fn differences(expect: &Value, found: &Value) -> Vec<String> {
    let tolerance = expect["tol"].as_f64().unwrap_or(1e-6);
    let near = |a: &Value, b: &Value| match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => (a - b).abs() <= tolerance,
        _ => a == b,
    };
    let flat = |v: &Value| -> Vec<Value> {
        let rows = v.as_array().cloned().unwrap_or_default();
        rows.iter().flat_map(|r| r.as_array().cloned().unwrap_or_default()).collect()
    };
    let mut wrong = Vec::new();
    for (key, expected) in expect.as_object().expect("an object") {
        let found = &found[key];
        let same = match key.as_str() {
            "tol" => true,
            "vars" => expected
                .as_object()
                .expect("variables")
                .iter()
                .all(|(n, e)| near(e, &found[n])),
            "path" => {
                let (a, b) = (flat(expected), flat(found));
                a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| near(a, b))
            }
            _ => expected == found,
        };
        if !same {
            wrong.push(format!("{key}: expected {expected}, found {found}"));
        }
    }
    wrong
}

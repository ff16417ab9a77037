//! Behaviour cases of Custom Macro B: each a program, what it is started with, and what it leaves behind.

mod common;

use gcode::{Setup, interpret};
use serde_json::Value;

#[test]
fn every_shared_case_behaves_as_it_says() {
    let path = format!("{}/../../../shared/reference/macro-cases.jsonl", env!("CARGO_MANIFEST_DIR"));
    let Some(bytes) = common::read_or_skip(&path) else { return };
    check(&String::from_utf8(bytes).unwrap());
}

#[test]
fn every_case_of_ours_behaves_as_it_says() {
    let path = format!("{}/../../corpus/macro-cases.jsonl", env!("CARGO_MANIFEST_DIR"));
    check(&String::from_utf8(common::read_or_skip(&path).expect("it belongs to the repository")).unwrap());
}

fn check(cases: &str) {
    let mut wrong = Vec::new();
    let mut count = 0;
    for line in cases.lines().filter(|l| !l.trim().is_empty()) {
        let case: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        count += 1;
        for difference in differences(&case) {
            wrong.push(format!("{}: {difference}", case["name"].as_str().unwrap_or("?")));
        }
    }
    assert!(wrong.is_empty(), "{} of {count} cases:\n{}", wrong.len(), wrong.join("\n"));
    assert!(count > 0, "no case was found");
}

fn differences(case: &Value) -> Vec<String> {
    let setup: Setup = serde_json::from_value(case["setup"].clone()).expect("a set-up");
    let found = serde_json::to_value(interpret(case["program"].as_str().expect("a program"), &setup)).expect("json");
    let expect = &case["expect"];
    let tolerance = expect["tol"].as_f64().unwrap_or(1e-6);
    let near = |a: &Value, b: &Value| match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => (a - b).abs() <= tolerance,
        _ => a == b,
    };
    let mut wrong = Vec::new();
    let mut tell =
        |what: &str, expected: &Value, found: &Value| wrong.push(format!("{what}: expected {expected}, found {found}"));
    for (key, expected) in expect.as_object().expect("an object") {
        let found = &found[key];
        match key.as_str() {
            "tol" => {}
            "vars" => {
                for (number, expected) in expected.as_object().expect("variables") {
                    if !near(expected, &found[number]) {
                        tell(&format!("#{number}"), expected, &found[number]);
                    }
                }
            }
            "path" => {
                let flat = |v: &Value| -> Vec<Value> {
                    let rows = v.as_array().cloned().unwrap_or_default();
                    rows.iter().flat_map(|r| r.as_array().cloned().unwrap_or_default()).collect()
                };
                let (a, b) = (flat(expected), flat(found));
                if a.len() != b.len() || !a.iter().zip(&b).all(|(a, b)| near(a, b)) {
                    tell("path", expected, found);
                }
            }
            _ if expected == found => {}
            _ => tell(key, expected, found),
        }
    }
    if !wrong.is_empty() && !found["fault"].is_null() {
        wrong.push(found["fault"].to_string());
    }
    wrong
}

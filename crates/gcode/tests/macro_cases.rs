//! Behaviour cases of Custom Macro B: each a program, what it is started with, and what it leaves behind.

mod common;

use gcode::{Setup, interpret};
use plan::{Answer, Next, ProgramStream, Question};
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

#[test]
fn programs_of_other_authors_run_to_their_end() {
    for path in [
        "macro-b/macro_b.nc",
        "macro-b/macro_boss_milling.nc",
        "macro-b/macro_face_milling.nc",
        "macro-b/macro_thread_milling.nc",
        "mtconnect/nist-sms/827-9999-904-OP1.NC",
        "mtconnect/nist-sms/827-9999-904-OP2.NC",
    ] {
        let Some(bytes) = common::sample(path) else { return };
        let found = interpret(&String::from_utf8_lossy(&bytes), &Setup::default());
        assert_eq!(found.fault, None, "{path}");
        assert!(!found.path.is_empty() || !found.vars.is_empty(), "{path} does something");
    }
}

#[test]
fn the_machine_is_asked_only_where_the_program_reads_it_and_answers_in_its_own_frame() {
    let text = "O1\nG54\n#1=5\nWHILE[#1GT0]DO1\n#1=#1-1\nEND1\nG90G0X10.Z5.\n#100=#5021\n#101=#5043\n#102=#3001\nM30";
    let mut program = common::open_with(
        text.as_bytes(),
        "fanuc-mill",
        common::mill_tables(),
        gcode::Options::default(),
    )
    .unwrap();
    let (mut asked, mut answer) = (Vec::new(), None);
    loop {
        match program.next(answer.take()) {
            Next::Step(_) => {}
            Next::Ask(Question::Number(name)) => {
                answer = Some(Answer::Number(Some(match name.as_str() {
                    "X.POSITION.ACTUAL" => -290.002,
                    "Z.POSITION.ACTUAL" => -394.5,
                    _ => 2.5,
                })));
                asked.push(name);
            }
            Next::End => break,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(asked, ["X.POSITION.ACTUAL", "Z.POSITION.ACTUAL", "EQUIPMENT_TIMER.POWERED"]);
    assert_eq!(program.variable(100), gcode::Value::Number(-290.002));
    assert_eq!(
        program.variable(101),
        gcode::Value::Number(5.5),
        "work position: the offset of G54 is -400"
    );
    assert_eq!(program.variable(102), gcode::Value::Number(2500.0));
}

#[test]
fn a_kept_variable_is_told_once_before_the_next_step() {
    let text = "O1\n#500=1\n#500=2\n#501=7\nG90G0X1.\n#500=3\nM30";
    let mut program = common::open_with(
        text.as_bytes(),
        "fanuc-mill",
        common::mill_tables(),
        gcode::Options::default(),
    )
    .unwrap();
    let (steps, alarm) = common::run(&mut program);
    assert_eq!(alarm, None);
    let told: Vec<String> = steps
        .iter()
        .map(|s| common::spell(&s.kind))
        .filter(|t| t.starts_with("register"))
        .collect();
    assert_eq!(
        told,
        [
            "register #500 None -> Some(\"2\")",
            "register #501 None -> Some(\"7\")",
            "register #500 Some(\"2\") -> Some(\"3\")"
        ]
    );
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

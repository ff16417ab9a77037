//! `toolmark post` as a person calls it.

use std::path::Path;
use std::process::{Command, Output};

const BRACKET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/bracket.stpnc");
const PLATE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/plate.nc");

fn toolmark(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(words)
        .current_dir(folder)
        .output()
        .expect("the binary starts")
}

fn code(output: &Output) -> Option<i32> {
    output.status.code()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_program_goes_to_stdout_or_a_file_and_the_table_beside_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let shown = toolmark(at, &["post", PLATE, "--control", "fanuc"]);
    assert_eq!(code(&shown), Some(0), "{}", text(&shown.stderr));
    assert!(text(&shown.stdout).starts_with("%\nO1100(PLATE 60 X 40 X 12)\n"));
    let written = toolmark(
        at,
        &["post", PLATE, "--control", "fanuc", "--number", "77", "--out", "plate.nc"],
    );
    assert_eq!(code(&written), Some(0));
    let file = std::fs::read_to_string(at.join("plate.nc")).expect("it was written");
    assert!(file.starts_with("%\nO0077(O1100 PLATE 60 X 40 X 12)\n"), "{file}");
    for control in ["siemens-840d", "heidenhain", "haas", "linuxcnc"] {
        let output = toolmark(at, &["post", BRACKET, "--control", control, "--json"]);
        assert_eq!(code(&output), Some(0), "{control}: {}", text(&output.stderr));
        let answer: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(answer["functions"], serde_json::json!([]));
        assert_eq!(answer["tools"].as_array().map(Vec::len), Some(3), "{control}");
    }
}

#[test]
fn a_function_in_the_answer_has_name_grade_reason_and_verified() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let insert = [
        "edit",
        BRACKET,
        "--out",
        "traced.stpnc",
        "--insert",
        "face top",
        "trace:1 set_edit_access_level its_level=3",
    ];
    let edited = toolmark(at, &insert);
    assert_eq!(code(&edited), Some(0), "{}", text(&edited.stderr));
    let output = toolmark(
        at,
        &["post", "traced.stpnc", "--control", "linuxcnc", "--json", "--out", "t.ngc"],
    );
    assert_eq!(
        code(&output),
        Some(1),
        "a refused function is exit 1: {}",
        text(&output.stderr)
    );
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let row = &answer["functions"][0];
    assert_eq!(row["name"], "set_edit_access_level");
    assert_eq!(row["grade"], "refused");
    assert_eq!(row["verified"], true);
    assert_eq!(row["reason"], "this control has no protection of programs");
    let file = std::fs::read_to_string(at.join("t.ngc")).expect("the program is written all the same");
    assert!(file.contains("FUNCTION set_edit_access_level: REFUSED"), "{file}");
    assert!(file.ends_with("M2\n"));
}

#[test]
fn what_cannot_be_posted_is_named_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(
        at.join("branch.nc"),
        "O1\nG21 G90 G54\nT1 M6\nIF[#500GT2]GOTO9\nG0 X1.\nN9 M30\n",
    )
    .expect("it can be written");
    let output = toolmark(at, &["post", "branch.nc", "--control", "haas", "--out", "h.nc"]);
    assert_eq!(code(&output), Some(1));
    assert!(text(&output.stderr).contains("line 4: IF"), "{}", text(&output.stderr));
    assert!(!at.join("h.nc").exists());
    std::fs::write(
        at.join("comp.nc"),
        "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X0 Y0\nG43 H1 Z5.\nG1 G41 D1 X10. F100.\nY20.\nG40 X0\nM30\n",
    )
    .expect("it can be written");
    let output = toolmark(at, &["post", "comp.nc", "--control", "fanuc", "--out", "c.nc"]);
    assert_eq!(code(&output), Some(1));
    assert!(text(&output.stderr).contains("radius 0"), "{}", text(&output.stderr));
    assert!(!at.join("c.nc").exists());
    let output = toolmark(at, &["post", PLATE, "--control", "okuma"]);
    assert_eq!(code(&output), Some(2));
    assert!(text(&output.stderr).contains("siemens-840d, fanuc, heidenhain, haas, linuxcnc"));
}

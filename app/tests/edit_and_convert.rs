//! `toolmark edit` and `toolmark convert` as a person calls them.

use std::path::Path;
use std::process::{Command, Output};

const BRACKET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/bracket.stpnc");
const PLATE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/plate.nc");
const FLANGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/flange.nc");

fn toolmark(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(words)
        .current_dir(folder)
        .env("TOOLMARK_DATA", folder.join("data"))
        .output()
        .expect("the binary starts")
}

#[track_caller]
fn good(folder: &Path, words: &[&str]) -> String {
    let output = toolmark(folder, words);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(
        output.status.code(),
        Some(0),
        "{words:?}: {text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).expect("it was written")
}

#[test]
fn an_edit_and_its_opposite_give_the_same_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let original = std::fs::read(BRACKET).expect("the corpus");
    good(at, &["edit", BRACKET, "--out", "same.stpnc"]);
    assert_eq!(bytes(at, "same.stpnc"), original);
    let there = [
        "--disable",
        "face top",
        "--rename",
        "OP20 side/drill holes=Löcher 1/2",
        "--move",
        "wave groove=round pocket",
    ];
    let back = [
        "--move",
        "round pocket=wave groove",
        "--rename",
        "Löcher 1\\/2=drill holes",
        "--enable",
        "face top",
    ];
    good(at, &[&["edit", BRACKET, "--out", "a.stpnc"], &there[..]].concat());
    assert_ne!(bytes(at, "a.stpnc"), original);
    good(at, &[&["edit", "a.stpnc", "--out", "b.stpnc"], &back[..]].concat());
    assert_eq!(bytes(at, "b.stpnc"), original);
}

#[test]
fn edits_are_made_in_the_order_of_the_command_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let words = [
        "--insert",
        "face top",
        "workplan: NEW",
        "--move",
        "round pocket=NEW/",
        "--rename",
        "NEW=POCKETS",
        "--feed",
        "POCKETS/round pocket=300",
    ];
    good(at, &[&["edit", BRACKET, "--out", "a.stpnc"], &words[..]].concat());
    let tree = good(at, &["inspect", "a.stpnc", "--json", "--select", "POCKETS"]);
    let tree: serde_json::Value = serde_json::from_str(&tree).expect("one JSON object");
    let step = &tree["tree"][0]["children"][0];
    assert_eq!(step["name"], "round pocket");
    let feeds: Vec<f64> = step["toolpaths"]
        .as_array()
        .expect("it has paths")
        .iter()
        .filter_map(|path| path["feed_mm_s"].as_f64())
        .collect();
    assert!(
        !feeds.is_empty() && feeds.iter().any(|feed| (feed - 5.0).abs() < 1e-9),
        "{feeds:?}"
    );
}

#[test]
fn a_function_line_that_cannot_be_read_is_not_put_in() {
    let folder = tempfile::tempdir().expect("a folder");
    for (line, says) in [
        ("trace:1 log_event its_knd=k", "its_knd"),
        ("trace:1 set_edit_access_level its_level=0", "its_level"),
        ("trace:1 start_synchronized_action its_id=1", "its_"),
    ] {
        let output = toolmark(
            folder.path(),
            &["edit", BRACKET, "--out", "a.stpnc", "--insert", "face top", line],
        );
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(says) && told.contains("nothing was written"), "{told}");
        assert!(!folder.path().join("a.stpnc").exists());
    }
    // A function of a vocabulary to come is kept.
    let unknown = ["--insert", "face top", "trace:1 weigh_chips its_scale=1"];
    good(
        folder.path(),
        &[&["edit", BRACKET, "--out", "a.stpnc"], &unknown[..]].concat(),
    );
}

#[test]
fn a_path_that_means_nothing_or_too_much_is_exit_2_and_writes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    for (words, says) in [
        (["--delete", "no such step"], "nothing in the program is called"),
        (["--feed", "face top=fast"], "a number above 0 was expected"),
        (["--move", "face top"], "P=P was expected"),
        (["--delete", "BRACKET"], "not in an ordered place"),
    ] {
        let output = toolmark(folder.path(), &[&["edit", BRACKET, "--out", "a.stpnc"], &words[..]].concat());
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(says), "{told}");
        assert!(!folder.path().join("a.stpnc").exists());
    }
}

#[test]
fn a_converted_program_is_planned_to_the_same_set_points() {
    // The plate's helices become splines, which are within a nanometre of them but have another length.
    for (program, within) in [(FLANGE, 1e-6), (PLATE, 2e-3)] {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        good(
            at,
            &["convert", program, "--out", "p.stpnc", "--start", "2026-11-21T00:00:00Z"],
        );
        good(at, &["plan", program, "--out", "a.csv"]);
        good(at, &["plan", "p.stpnc", "--out", "b.csv"]);
        let numbers = |name: &str| -> Vec<Vec<f64>> {
            let text = String::from_utf8(bytes(at, name)).expect("text");
            text.lines()
                .skip(1)
                .map(|line| line.split(',').take(4).map(|cell| cell.parse().expect("a number")).collect())
                .collect()
        };
        let (a, b) = (numbers("a.csv"), numbers("b.csv"));
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            assert!(
                a.iter().zip(b).all(|(a, b)| (a - b).abs() <= within),
                "{program}: {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn a_cutter_location_file_is_converted_and_more_than_three_axes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = "$$ made by hand\nUNITS/INCHES\nTOOL PATH/FACE,TOOL,EM1\nTLDATA/MILL,1.0,0.,3.,0.,0.\nLOADTL/3\nSPINDL/RPM,2000,CLW\nCOOLNT/ON\nRAPID\n\
                GOTO/0.,0.,$\n1.\nFEDRAT/IPM,10.\nGOTO/0.,0.,0.\nGOTO/2.,0.,0.\nCIRCLE/2.,-1.,0.,0.,0.,1.,1.0,.06,.5,1.,0.\nGOTO/3.,-1.,0.\nEND-OF-PATH\n\
                TOOL PATH/HOLES,TOOL,DR1\nLOADTL/4\nCYCLE/DRILL,RAPTO,.1,FEDTO,-.5,IPM,5.\nGOTO/1.,1.,0.\nGOTO/2.,1.,0.\nCYCLE/OFF\nSTOP\nFINI\n";
    std::fs::write(at.join("part.cls"), text).expect("it is written");
    good(at, &["convert", "part.cls", "--out", "part.stpnc"]);
    let tree: serde_json::Value = serde_json::from_str(&good(at, &["inspect", "part.stpnc", "--json"])).expect("JSON");
    let summary = &tree["summary"];
    assert_eq!(
        (
            tree["units"].as_str(),
            summary["workingsteps_enabled"].as_u64(),
            summary["tools"].as_u64()
        ),
        (Some("inch"), Some(2), Some(2))
    );
    good(at, &["plan", "part.stpnc", "--out", "a.csv"]);
    std::fs::write(
        at.join("five.cls"),
        text.replace("GOTO/2.,0.,0.\n", "GOTO/2.,0.,0.,0.5,0.,0.866\n"),
    )
    .expect("it is written");
    let output = toolmark(at, &["convert", "five.cls", "--out", "five.stpnc"]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("five.cls:13:1") && told.contains("tool axis"), "{told}");
}

//! A job of sizes proposed from a STEP-NC file: what the file says is in it, what it does not say is open.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

const BRACKET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/bracket.stpnc");

fn run(data: &Path, words: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(words)
        .arg("--data")
        .arg(data)
        .output()
        .expect("the binary starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap_or(-1), text(&output.stdout), text(&output.stderr))
}

/// The bracket with a bore in inches, a distance, a fit and a width, as the tests of `stepnc` read it.
fn with_dimensions() -> String {
    let text = std::fs::read_to_string(BRACKET).expect("it belongs to the repository");
    let end = text.rfind("ENDSEC;").expect("a data section");
    let more = include_str!("../../crates/stepnc/tests/data/bracket-dimensions.p21");
    format!("{}{more}{}", &text[..end], &text[end..]).replace(
        "MACHINING_FEATURE_RELATIONSHIP('','machining',#351,#53)",
        "MACHINING_FEATURE_RELATIONSHIP('','machining',#351,#905)",
    )
}

#[test]
fn a_step_nc_file_becomes_a_job_file_that_loads_when_a_person_has_filled_it_in() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let (plan, job) = (folder.path().join("bracket.stpnc"), folder.path().join("job.toml"));
    std::fs::write(&plan, with_dimensions()).expect("written");
    let (plan, job_name) = (plan.display().to_string(), job.display().to_string());
    let (exit, out, err) = run(&data, &["size", "job", &plan, "--out", &job_name, "--number", "40", "--json"]);
    assert_eq!(exit, 0, "{out}{err}");
    let told: Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(
        (&told["complete"], &told["dimensions"]),
        (&Value::from(false), &Value::from(4))
    );
    let open: Vec<&str> = told["open"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert!(
        open.contains(&"bore wall diameter: offset") && open.contains(&"BORE diameter: tolerance"),
        "{open:?}"
    );
    assert!(
        !open.contains(&"bore wall diameter: kind") && !open.contains(&"bore wall diameter: tool"),
        "{open:?}"
    );
    let left_out = told["left_out"].to_string();
    assert!(left_out.contains("it has no nominal value"), "{left_out}");

    let text = std::fs::read_to_string(&job).expect("written");
    assert_eq!(told["proposal"], text.as_str());
    for line in [
        "nominal = 25.4",
        "tolerance = [-0.0254, 0.02]",
        "kind = \"inside diameter\"    # the feature is a ROUND_HOLE",
        "tolerance = [-0.1, 0.2]",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    // Nothing of it is in force: a person has not looked at it.
    assert!(!data.exists());
    let (exit, out, err) = run(&data, &["size", "job", &job_name, "--machine", "sim-mill"]);
    assert_eq!(exit, 3, "{out}{err}");
    assert!(err.contains("job.toml:"), "with line and column: {err}");

    // Only the bore is kept; its offset and axis are the shop's.
    let end = text.find("\n# #930").expect("the next one");
    let start = text.find("\n# #910").expect("the bore");
    let head = &text[..text.find("\n# #").expect("the first one")];
    let filled = format!("{head}{}", &text[start..end])
        .replace("offset = \"?\"", "offset = 2")
        .replace("axis = \"?\"", "axis = \"radius\"");
    std::fs::write(&job, filled).expect("written");
    let (exit, out, err) = run(&data, &["size", "job", &job_name, "--machine", "sim-mill"]);
    assert_eq!(exit, 0, "{out}{err}");
    let (exit, out, err) = run(
        &data,
        &[
            "size",
            "enter",
            "--dimension",
            "bore wall diameter",
            "25.39",
            "--machine",
            "sim-mill",
        ],
    );
    assert_eq!(exit, 0, "{out}{err}");
}

#[test]
fn a_job_file_takes_no_options_of_a_proposal_and_a_file_without_sizes_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let shaft = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/shaft.toml");
    let (exit, _, err) = run(&data, &["size", "job", shaft, "--number", "7"]);
    assert_eq!(exit, 2, "{err}");
    let none = std::fs::read_to_string(BRACKET)
        .expect("there")
        .replace("DIMENSIONAL_SIZE", "DIMENSIONAL_GUESS");
    let plan = folder.path().join("none.stpnc");
    std::fs::write(&plan, none).expect("written");
    let (exit, _, err) = run(&data, &["size", "job", &plan.display().to_string()]);
    assert_eq!(exit, 1, "{err}");
    assert!(err.contains("no size with a tolerance"), "{err}");
}

#[test]
fn the_proposal_of_the_shared_plate_leaves_open_what_the_plate_does_not_say() {
    let plate = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/samples/stepnc/ap238/plate_mm_e3.stpnc"
    );
    if !Path::new(plate).exists() {
        println!("skipped: no sample {plate}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (exit, out, err) = run(&folder.path().join("data"), &["size", "job", plate]);
    assert_eq!(exit, 0, "{err}");
    for line in [
        "name = \"pocket wall diameter\"",
        "kind = \"?\"    # OPEN: \"outside diameter\" or \"inside diameter\"",
        "nominal = 40.0",
        "tolerance = [0.0, 0.05]",
        "tool = \"?\"    # OPEN: the file ties no workingstep to it",
        "# - #805 \"flatness top\" (FLATNESS_TOLERANCE): no offset makes it",
    ] {
        assert!(out.contains(line), "{line}: {out}");
    }
}

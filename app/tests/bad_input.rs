//! Input that nobody should give: one clear message, the right exit code, never a panic.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A folder with a data directory of its own; everything a test writes goes away with it.
struct Shop {
    folder: TempDir,
}

impl Shop {
    fn new() -> Shop {
        Shop {
            folder: tempfile::tempdir().expect("a folder"),
        }
    }
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
    fn file(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), text).expect("written");
        self.path(name)
    }
    fn toolmark(&self, words: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_toolmark"))
            .args(words)
            .current_dir(self.folder.path())
            .env("TOOLMARK_DATA", self.path("data"))
            .output()
            .expect("started")
    }
    /// Fails with this exit code and a message that holds all of these words.
    #[track_caller]
    fn refuses(&self, words: &[&str], exit: i32, message: &[&str]) {
        let output = self.toolmark(words);
        let said = text(&output.stdout) + &text(&output.stderr);
        assert_eq!(output.status.code(), Some(exit), "{words:?}: {said}");
        for part in message {
            assert!(said.contains(part), "{words:?} should say {part:?}: {said}");
        }
        let json: Vec<&str> = words.iter().copied().chain(["--json"]).collect();
        let output = self.toolmark(&json);
        assert_eq!(output.status.code(), Some(exit), "{json:?}");
        serde_json::from_slice::<Value>(&output.stdout).unwrap_or_else(|e| panic!("{json:?}: {e}"));
    }
    #[track_caller]
    fn json(&self, words: &[&str]) -> Value {
        let json: Vec<&str> = words.iter().copied().chain(["--json"]).collect();
        let output = self.toolmark(&json);
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{json:?}: {e}: {}", text(&output.stderr)))
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn corpus(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus").join(name);
    path.display().to_string()
}

/// A mill program whose tool and offsets the simulated machine has.
fn mill(blocks: &str) -> String {
    format!("G21 G90 G17 G54\nT1 M6\nG43 H1\nS1000 M3\nG0 X0. Y0. Z5.\n{blocks}\nM30\n")
}

#[test]
fn a_program_that_cannot_be_run_is_named_with_its_line() {
    let cases = [
        ("G1 Z0. F100.\nG2 X10. Y0. I3. J0.", "7:4: this arc does not close"),
        ("G1 Z0.", "6:4: a cutting move without a feed"),
        ("G1 Z0. F-100.", "a feed cannot be negative"),
        ("G0 XNaN", "6:4: expected a number behind X"),
        ("G0 X[1/0]", "6:7: 1 divided by 0"),
        ("M98 P1000", "there is no program O1000"),
    ];
    let shop = Shop::new();
    for (blocks, message) in cases {
        shop.file("bad.nc", mill(blocks));
        shop.refuses(&["check", "bad.nc"], 1, &["bad.nc", message]);
        shop.refuses(&["plan", "bad.nc", "--out", "plan.csv"], 1, &["bad.nc", message]);
        assert!(!shop.path("plan.csv").exists(), "half a plan looks like a whole one");
        shop.refuses(&["run", "bad.nc", "--fast"], 1, &["bad.nc", message]);
    }
}

#[test]
fn a_file_that_is_no_program_cannot_be_read() {
    let shop = Shop::new();
    shop.file("empty.nc", "");
    shop.file("empty.stpnc", "");
    shop.file("binary.nc", [0u8, 1, 2, 3, 200]);
    shop.file("binary.stpnc", [0u8, 1, 2, 3, 200]);
    std::fs::create_dir(shop.path("folder.nc")).expect("made");
    for (name, message) in [
        ("empty.nc", "empty.nc:1:1: the file is empty"),
        ("empty.stpnc", "empty.stpnc:1:1: the file is empty"),
        ("binary.nc", "binary.nc:1:1: a byte 0"),
        ("binary.stpnc", "the file is binary"),
        ("folder.nc", "it is a folder"),
        ("missing.nc", "No such file"),
    ] {
        shop.refuses(&["check", name], 3, &[message]);
        shop.refuses(&["inspect", name], 3, &[message]);
        shop.refuses(&["plan", name, "--out", "p.csv"], 3, &[message]);
        shop.refuses(&["rebuild", "--no-plan", name, "--out", "x.stpnc"], 3, &[name]);
    }
}

#[test]
fn a_slip_of_the_pen_that_would_take_days_is_refused_at_once() {
    let shop = Shop::new();
    for (blocks, message) in [
        ("G0 X999999999.", "no machine reaches that far"),
        ("G1 Z0. F0.000001", "would take"),
        ("G4 X9999999.", "longer than a day"),
    ] {
        shop.file("slip.nc", mill(blocks));
        shop.refuses(&["check", "slip.nc"], 1, &["slip.nc:6:", message]);
    }
    let limits = shop.file("slow.json", r#"{"a_max_mm_s2":1e-300}"#);
    let limits = limits.display().to_string();
    let words = ["plan", &corpus("plate.nc"), "--out", "p.csv", "--limits", &limits];
    shop.refuses(&words, 1, &["plate.nc:", "would take", "the limits of the axes"]);
}

#[test]
fn limits_that_cannot_be_are_named_with_line_and_column() {
    let shop = Shop::new();
    for (limits, message) in [
        ("{\n \"v_max_mm_s\":[1,2]}", "limits.json:2:2: v_max_mm_s: a number above 0"),
        ("{\"v\":1}", "limits.json:1:2: v is unknown"),
        ("{\"v_max_mm_s\":", "limits.json:1:14: EOF"),
        ("[1]", "limits.json:1:1: an object was expected"),
        ("", "limits.json:1:1: EOF"),
    ] {
        shop.file("limits.json", limits);
        let words = ["plan", &corpus("plate.nc"), "--out", "p.csv", "--limits", "limits.json"];
        shop.refuses(&words, 3, &[message]);
    }
}

#[test]
fn wrong_usage_is_2_and_says_what_was_expected() {
    let shop = Shop::new();
    let (nc, step) = (corpus("plate.nc"), corpus("bracket.stpnc"));
    shop.refuses(&[], 2, &["subcommand"]);
    shop.refuses(&["check"], 2, &["PROGRAM"]);
    shop.refuses(&["check", &step, "--dialect", "klingon"], 2, &["fanuc-mill"]);
    shop.refuses(&["plan", &nc, "--out", "plan.txt"], 2, &[".csv or .parquet"]);
    shop.refuses(&["inspect", &nc, "--select", "#99999"], 2, &["#99999"]);
    shop.refuses(&["compare", &step, "--tolerance", "-1"], 2, &["above 0"]);
    shop.refuses(&["run", &nc, "--fast", "--as-mtconnect", "100,1e300"], 2, &["milliseconds"]);
    shop.refuses(&["run", &nc, "--fast", "--as-mtconnect", "0"], 2, &["milliseconds"]);
    shop.refuses(&["run", &nc, "--fast", "--plant-shift", "9:0.1,0,0"], 2, &["3 workingsteps"]);
    shop.refuses(
        &["run", &nc, "--fast", "--start", "2262-04-11T23:47:16Z"],
        2,
        &["1678 to 2261"],
    );
}

#[test]
fn a_machine_file_that_cannot_be_used_is_3_and_says_where() {
    let shop = Shop::new();
    let nc = corpus("plate.nc");
    shop.file("m.toml", "name = \"x\"\nkind = \"mill\"\nspeed = 5\n");
    let output = shop.toolmark(&["check", &nc, "--machine", "m.toml"]);
    assert!(
        text(&output.stderr).starts_with("error: m.toml:3:1: "),
        "{}",
        text(&output.stderr)
    );
    shop.refuses(&["check", &nc, "--machine", "m.toml"], 3, &["speed"]);
    shop.file("m.toml", [0xff, 0xfe]);
    shop.refuses(&["check", &nc, "--machine", "m.toml"], 3, &["UTF-8"]);
    shop.refuses(&["check", &nc, "--machine", "nosuch"], 3, &["sim-mill"]);
}

#[test]
fn a_place_that_cannot_be_written_to_is_4_and_leaves_no_job_behind() {
    let shop = Shop::new();
    shop.file("taken", "a file");
    let nc = corpus("plate.nc");
    shop.refuses(&["run", &nc, "--fast", "--out", "taken"], 4, &["taken"]);
    shop.refuses(&["run", &nc, "--fast", "--out", "taken/below"], 4, &["taken"]);
    let output = shop.toolmark(&["run", &nc, "--fast", "--out", "good"]);
    assert!(!text(&output.stderr).contains("interrupted"), "{}", text(&output.stderr));
}

#[test]
fn a_damaged_record_is_refused_and_our_own_knows_its_frame() {
    let shop = Shop::new();
    let step = corpus("bracket.stpnc");
    let output = shop.toolmark(&["run", &step, "--fast", "--out", "run"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let whole = std::fs::read(shop.path("run/record.parquet")).expect("a record");
    let mut flipped = whole.clone();
    flipped[whole.len() / 3] ^= 4;
    for (name, bytes) in [("half.parquet", &whole[..whole.len() / 2]), ("flipped.parquet", &flipped[..])] {
        shop.file(name, bytes);
        shop.refuses(&["rebuild", &step, name, "--out", "x.stpnc"], 3, &[name, "damaged"]);
    }
    let record = "run/record.parquet";
    shop.refuses(
        &["rebuild", &step, record, "--out", "x.stpnc", "--frame", "setup"],
        2,
        &["machine positions"],
    );
}

/// A run as an agent sees it, and the file it leaves, tell the same story.
#[test]
fn what_the_run_reports_is_what_its_file_says_even_from_few_samples() {
    let shop = Shop::new();
    let step = corpus("bracket.stpnc");
    for seen in ["100,20", "300,90"] {
        let run = &shop.json(&["run", &step, "--fast", "--out", "run", "--as-mtconnect", seen])["report"];
        let file = shop.json(&["compare", "run/as-executed.stpnc"]);
        for field in ["feed_runs", "rapid_runs", "verdict", "tolerance_mm"] {
            assert_eq!(run[field], file[field], "{seen}: {field}");
        }
        // Nothing was overridden: an arc is not slower because few samples lie on it.
        for report in [run, &file] {
            let findings = report["findings"].to_string();
            assert!(!findings.contains("of the planned feed"), "{seen}: {findings}");
            assert!(!findings.contains("not executed"), "{seen}: {findings}");
        }
    }
}

#[test]
fn a_run_of_someone_else_without_times_on_its_toolpaths_is_one_pass() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/samples/stepnc/ap238/plate_plan_and_twin_e3.stpnc");
    if !sample.exists() {
        println!("skipped: {} is not there", sample.display());
        return;
    }
    let report = Shop::new().json(&["compare", &sample.display().to_string()]);
    let names: Vec<&str> = report["workingsteps"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|w| w["name"].as_str())
        .collect();
    assert_eq!(names, ["WS 1 face", "WS 3 drill", "WS 2 pocket"]);
}

#[test]
fn a_recording_that_was_cut_off_is_rebuilt_up_to_there_and_ends_1() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/samples/mtconnect/moldy_100ms.xml");
    let Ok(whole) = std::fs::read(&sample) else {
        println!("skipped: {} is not there", sample.display());
        return;
    };
    let shop = Shop::new();
    shop.file("cut.xml", &whole[..whole.len() / 2]);
    let words = ["rebuild", "--no-plan", "cut.xml", "--out", "cut.stpnc"];
    shop.refuses(&words, 1, &["error: cut.xml:5757:11: ", "what stands before was read"]);
    let findings = &shop.json(&words)["findings"];
    assert!(
        findings[0].as_str().is_some_and(|f| f.contains("cut.xml:5757:11")),
        "{findings}"
    );
}

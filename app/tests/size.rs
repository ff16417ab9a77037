//! Sizing from the command line: the published example to the digit, the order of refusals, history, undo, macros, the study.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The example of the article, with the window of its call.
const JOB: &str = "name = \"EXAMPLE\"\nnumber = 200\nunit = \"inch\"\n\n[[dimension]]\nname = \"DIM A\"\nkind = \"outside diameter\"\n\
                   nominal = 3.2342\ntolerance = 0.001\ntarget = 3.2342\nwindow = [3.22, 3.245]\nlargest_step = 0.005\ntool = 5\n";

/// A data directory with a job in force.
struct Shop(tempfile::TempDir);

impl Shop {
    fn new(job: &str) -> Shop {
        let shop = Shop(tempfile::tempdir().expect("a folder"));
        std::fs::write(shop.path("job.toml"), job).expect("written");
        let file = shop.path("job.toml").display().to_string();
        shop.good(0, &["size", "job", &file]);
        shop
    }
    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }
    /// Runs a command `second` seconds after eight o'clock; exit code, standard output, standard error.
    fn run(&self, second: u32, words: &[&str]) -> (i32, String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
            .args(words)
            .args([
                "--operator",
                "Maria",
                "--start",
                &format!("2026-11-21T08:{:02}:{:02}Z", second / 60, second % 60),
                "--data",
            ])
            .arg(self.path("data"))
            .output()
            .expect("the binary starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code().unwrap_or(-1), text(&output.stdout), text(&output.stderr))
    }
    #[track_caller]
    fn good(&self, second: u32, words: &[&str]) -> String {
        let (exit, out, err) = self.run(second, words);
        assert_eq!(exit, 0, "{words:?}: {out}{err}");
        out
    }
    #[track_caller]
    fn json(&self, second: u32, exit: i32, words: &[&str]) -> Value {
        let mut all = words.to_vec();
        all.push("--json");
        let (found, out, err) = self.run(second, &all);
        assert_eq!(found, exit, "{words:?}: {out}{err}");
        serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}"))
    }
    #[track_caller]
    fn enter(&self, second: u32, exit: i32, value: &str, more: &[&str]) -> Value {
        let mut words = vec!["size", "enter", "--dimension", "DIM A", value];
        words.extend(more);
        self.json(second, exit, &words)
    }
}

#[track_caller]
fn near(value: &Value, expected: f64) {
    let found = value.as_f64().unwrap_or_else(|| panic!("{value} is no number"));
    assert!((found - expected).abs() < 1e-9, "{found} and not {expected}");
}

#[test]
fn the_published_example_moves_wear_x_of_offset_five_by_nine_steps() {
    let shop = Shop::new(JOB);
    let told = shop.enter(1, 0, "3.2351", &[]);
    assert_eq!(told["accepted"], true);
    assert_eq!(told["alarm"], Value::Null);
    assert_eq!(told["dimension"], "DIM A");
    assert_eq!(told["register"], "sim-lathe/tool/5/wear/x_mm");
    assert_eq!(told["unit"], "inch");
    near(&told["change"], -0.0009);
    near(&told["before"], 0.0);
    near(&told["after"], -0.0009);
    near(&told["change_mm"], -0.02286);
    let effect = told["effect"].as_str().expect("words");
    assert!(effect.contains("the next diameter will be 0.0009 in smaller"), "{effect}");
    // The same size in the other unit, ten seconds later: on top of the first.
    let again = shop.enter(11, 0, "82.17154", &["--unit", "mm"]);
    assert_eq!(again["unit"], "mm");
    near(&again["change"], -0.02286);
    near(&again["after"], -0.04572);
}

#[test]
fn entries_outside_the_window_are_alarms_and_change_nothing() {
    let shop = Shop::new(JOB);
    let mut second = 0;
    for (value, number) in [
        ("3.22", 100),
        ("3.21", 100),
        ("0", 100),
        ("-3.2351", 100),
        ("3.245", 101),
        ("3.2451", 101),
        ("99", 101),
    ] {
        second += 5;
        let told = shop.enter(second, 1, value, &["--unit", "inch"]);
        assert_eq!(
            (&told["accepted"], &told["rule"]),
            (&Value::from(false), &Value::from("window")),
            "{value}"
        );
        assert_eq!(told["alarm"]["number"], number, "{value}");
        near(&told["after"], 0.0);
    }
    let millimetres = shop.enter(60, 1, "82.17", &[]);
    assert!(
        millimetres["message"]
            .as_str()
            .expect("words")
            .contains("did you mean 82.170 mm?")
    );
    // The refusals are in the history, and the register was never touched.
    let history = shop.json(61, 0, &["size", "history"]);
    let rows = history["history"].as_array().expect("rows");
    assert_eq!(rows.len(), 8);
    assert!(rows.iter().all(|r| r["what"] == "refused"), "{history}");
}

#[test]
fn refusals_come_in_the_order_of_the_screen_and_name_their_rule() {
    let shop = Shop::new(JOB);
    let rule = |second, value: &str, more: &[&str]| {
        shop.enter(second, 1, value, more)["rule"]
            .as_str()
            .expect("a rule")
            .to_owned()
    };
    assert_eq!(rule(1, "", &[]), "empty");
    assert_eq!(rule(2, "abc", &[]), "not-a-number");
    assert_eq!(rule(3, "3,234.5", &[]), "ambiguous");
    shop.enter(10, 0, "3.2351", &[]);
    assert_eq!(rule(10, "99", &[]), "repeated");
    assert_eq!(rule(20, "99", &["--seen", "0"]), "stale");
    assert_eq!(rule(30, "99", &[]), "window");
    assert_eq!(rule(40, "3.2442", &[]), "step");
    shop.enter(50, 0, "3.2442", &["--level", "3"]);
}

#[test]
fn an_offset_entered_at_the_control_is_recorded_as_such() {
    let shop = Shop::new(JOB);
    shop.enter(1, 0, "3.2351", &[]);
    let told = shop.enter(11, 0, "3.2343", &["--at-control", "-0.0020"]);
    near(&told["before"], -0.0020);
    near(&told["after"], -0.0021);
    let history = shop.json(12, 0, &["size", "history"]);
    let found = &history["history"][1];
    assert_eq!(found["what"], "at-control");
    assert_eq!(found["who"], "somebody at the control");
    near(&found["before_mm"], -0.02286);
    near(&found["after_mm"], -0.0508);
}

#[test]
fn an_entry_can_be_taken_back_until_a_part_was_cut_with_it() {
    let shop = Shop::new(JOB);
    let first = shop.enter(1, 0, "3.2351", &["--part", "1"])["entry"]
        .as_u64()
        .expect("a number")
        .to_string();
    let (exit, _, err) = shop.run(2, &["size", "undo", &first]);
    assert_eq!(exit, 2, "{err}");
    assert!(err.contains("needs a reason"), "{err}");
    let undone = shop.json(3, 0, &["size", "undo", &first, "--reason", "wrong part"]);
    near(&undone["after"], 0.0);
    let (exit, _, err) = shop.run(4, &["size", "undo", &first, "--reason", "again"]);
    assert!(exit == 1 && err.contains("was taken back already"), "{exit} {err}");

    let second = shop.enter(20, 0, "3.2351", &["--part", "2"])["entry"]
        .as_u64()
        .expect("a number")
        .to_string();
    shop.enter(30, 0, "3.2345", &["--part", "3"]);
    let (exit, _, err) = shop.run(31, &["size", "undo", &second, "--reason", "gauge was off"]);
    assert!(exit == 1 && err.contains("--opposite"), "{exit} {err}");
    let opposed = shop.json(32, 0, &["size", "undo", &second, "--opposite", "--reason", "gauge was off"]);
    near(&opposed["after"], -0.0003);
    let (exit, _, err) = shop.run(33, &["size", "undo", "9999", "--reason", "x"]);
    assert!(exit == 2 && err.contains("no accepted entry"), "{exit} {err}");
}

#[test]
fn a_trend_is_told_when_there_is_enough_and_begins_anew_with_a_new_tool() {
    let shop = Shop::new(JOB);
    let outlook = |second| shop.json(second, 0, &["size", "list"])["dimensions"][0]["outlook"].clone();
    for (k, value) in ["3.2342", "3.2343", "3.2345", "3.2346"].iter().enumerate() {
        let part = (k * 5).to_string();
        shop.enter(10 * k as u32 + 1, 0, value, &["--part", &part]);
    }
    assert_eq!(outlook(50)["outlook"], "not-enough");
    // Each correction brought the size back; the tool went on wearing by 0.0001 and more a part.
    shop.enter(51, 0, "3.2346", &["--part", "20"]);
    assert_eq!(outlook(55)["outlook"], "wears");
    shop.good(60, &["size", "new-tool", "--offset", "5"]);
    assert_eq!(outlook(61)["have"], 0);
    let text = shop.good(62, &["size", "list", "--units", "mm"]);
    assert!(text.contains("82.1487 mm"), "the target in mm: {text}");
}

#[test]
fn jobs_that_make_no_sense_are_refused_with_line_and_column() {
    let shop = Shop::new(JOB);
    let check = |text: &str, expected: &str| {
        std::fs::write(shop.path("bad.toml"), text).expect("written");
        let file = shop.path("bad.toml").display().to_string();
        let (exit, _, err) = shop.run(1, &["size", "job", &file]);
        assert!(exit == 3 && err.contains(expected), "{exit} {err}");
    };
    let second = JOB[JOB.find("[[dim").expect("there")..].replace("DIM A", "DIM B");
    check(
        &format!("{JOB}{second}"),
        "bad.toml:14:1: dimensions \"DIM A\" and \"DIM B\" both move sim-lathe/tool/5/wear/x_mm",
    );
    check(&JOB.replace("tolerance", "tolerence"), "bad.toml:9:1: unknown field");
    let (exit, _, err) = shop.run(1, &["size", "enter", "--dimension", "DIM Z", "3.2"]);
    assert!(exit == 2 && err.contains("it has DIM A"), "{exit} {err}");
}

fn files_in(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .map(|e| e.expect("reads").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn macros_are_released_with_their_proof_and_fit_the_part_program() {
    let shop = Shop::new(JOB);
    let part = "%\nO0001(PART)\nG20 G18 G99\nN050 T0505\nG97 S1000 M3\nG0 X3.3 Z.1\nG1 Z-1. F.005\nG0 X4. Z1.\nT0500\nM30\n%\n";
    std::fs::write(shop.path("part.nc"), part).expect("written");
    let program = shop.path("part.nc").display().to_string();
    for (method, files) in [
        (
            "t-word",
            vec!["O0200.nc", "O9000.nc", "O9010.nc", "part.nc", "proof.json", "proof.txt"],
        ),
        ("g65", vec!["O0200.nc", "O8002.nc", "part.nc", "proof.json", "proof.txt"]),
    ] {
        let out = shop.path(method);
        let folder = out.display().to_string();
        let words = [
            "size",
            "generate",
            "--control",
            "fanuc-lathe",
            "--out",
            &folder,
            "--method",
            method,
            "--program",
            &program,
        ];
        let told = shop.json(1, 0, &words);
        assert_eq!(told["proof"]["different"], 0, "{told}");
        assert!(told["proof"]["entries"].as_u64().is_some_and(|n| n >= 10_000), "{told}");
        let situations = told["proof"]["situations"].to_string();
        assert!(situations.contains("makes the same 3 moves as before"), "{situations}");
        assert_eq!(files_in(&out), files);
        let proof = std::fs::read_to_string(out.join("proof.txt")).expect("reads");
        assert!(proof.contains("0 differences"), "{proof}");
    }
    let changed = std::fs::read_to_string(shop.path("g65").join("part.nc")).expect("reads");
    assert!(
        changed.contains("N050 G65 P8002 T5. D3.2342 S3.22 B3.245 A2000."),
        "{changed}"
    );
}

#[test]
fn what_cannot_be_generated_writes_nothing() {
    let shop = Shop::new(JOB);
    std::fs::write(shop.path("other.nc"), "O1\nT0303\nM30\n").expect("written");
    let program = shop.path("other.nc").display().to_string();
    let out = shop.path("out");
    let folder = out.display().to_string();
    let words = [
        "size",
        "generate",
        "--control",
        "fanuc-lathe",
        "--out",
        &folder,
        "--method",
        "g65",
        "--program",
        &program,
    ];
    let (exit, _, err) = shop.run(1, &words);
    assert!(exit == 1 && err.contains("never calls offset 5"), "{exit} {err}");
    assert_eq!(files_in(&out), Vec::<String>::new());
    let (exit, _, err) = shop.run(1, &["size", "generate", "--control", "nowhere", "--out", &folder]);
    assert!(exit == 2 && err.contains("fanuc-lathe-base"), "{exit} {err}");
}

#[test]
fn with_sizing_every_part_of_a_hundred_is_good_and_without_it_the_tool_wears_out_of_tolerance() {
    let shop = Shop::new(JOB);
    let out = shop.path("study");
    let folder = out.display().to_string();
    let told = shop.json(1, 0, &["size", "study", "--out", &folder, "--seeds", "20"]);
    for course in told["courses"].as_array().expect("courses") {
        let bad = course["out_of_tolerance"].as_array().expect("parts");
        if course["sizing"] == true {
            assert!(bad.is_empty(), "seed {}: {bad:?}", course["seed"]);
            assert_eq!(course["refused"].as_array().map(Vec::len), Some(1), "the mistyped entry");
        } else {
            let first = bad.first().and_then(Value::as_u64).expect("it wears out");
            assert!(first <= 40, "part {first}");
        }
    }
    let page = std::fs::read_to_string(out.join("study.html")).expect("reads");
    assert!(page.contains("SIMULATED") && page.contains("<svg"));
}

#[test]
fn check_and_plan_use_the_offsets_in_force_and_say_where_they_come_from() {
    let shop = Shop::new(JOB);
    let program = shop.path("seat.nc").display().to_string();
    std::fs::write(
        &program,
        "O1\nG20G18G40G99\nG50S2000\nT0505\nG97S1000M3\nG0X3.5Z.1\nG1Z-.5F.01\nG0X4.\nM30\n",
    )
    .expect("written");
    let planned = |second: u32| {
        let out = shop.path("plan.csv").display().to_string();
        shop.good(
            second,
            &[
                "plan",
                &program,
                "--out",
                &out,
                "--machine",
                "sim-lathe",
                "--frame",
                "machine",
            ],
        );
        let text = std::fs::read_to_string(out).expect("written");
        let last = text.lines().last().expect("rows").to_owned();
        let x = text
            .lines()
            .next()
            .expect("a header")
            .split(',')
            .position(|c| c == "x_mm" || c == "x")
            .expect("a column x");
        last.split(',').nth(x).expect("a value").parse::<f64>().expect("a number")
    };
    let before = planned(1);
    shop.enter(10, 0, "3.2351", &[]);
    // -0.0009 in on the diameter.
    assert!(
        (planned(20) - before + 0.0009 * 25.4 / 2.0).abs() < 1e-6,
        "{before} and {}",
        planned(21)
    );
    let told = shop.json(30, 0, &["check", &program, "--machine", "sim-lathe"]);
    assert!(
        told["offsets"].as_str().is_some_and(|o| o.starts_with("offsets in force")),
        "{told}"
    );
}

/// A slot by the radius of its cutter, and two depths that one length makes.
const MILLED: &str = "name = \"PLATE\"\nnumber = 79\nunit = \"mm\"\n[[dimension]]\nname = \"SLOT\"\nkind = \"inside width\"\nnominal = 12\n\
                      tolerance = 0.05\ntool = 2\naxis = \"radius\"\n[[dimension]]\nname = \"FLOOR\"\nkind = \"depth\"\nnominal = 8\n\
                      tolerance = 0.05\ntool = 2\nrole = \"mean\"\nlargest_step = 0.05\n[[dimension]]\nname = \"STEP\"\nkind = \"depth\"\n\
                      nominal = 3\ntolerance = 0.05\ntool = 2\nrole = \"mean\"\nlargest_step = 0.05\n";

#[test]
fn a_mill_gets_macros_with_their_proof_and_a_lathes_control_is_refused() {
    let shop = Shop::new(MILLED);
    let program = shop.path("PART.nc").display().to_string();
    std::fs::write(
        &program,
        "%\nO1\nG21G90G54\nT2M6\nS500M3\nG43H2G0Z5.\nG1Z-1.F100\nG0Z5.\nM30\n%\n",
    )
    .expect("written");
    for method in ["t-word", "g65"] {
        let out = shop.path(method).display().to_string();
        let words = [
            "size",
            "generate",
            "--control",
            "fanuc-mill",
            "--method",
            method,
            "--out",
            &out,
            "--program",
            &program,
        ];
        let told = shop.json(1, 0, &words);
        assert_eq!(
            (&told["released"], &told["proof"]["different"]),
            (&Value::from(true), &Value::from(0)),
            "{told}"
        );
        let situations = told["proof"]["situations"].to_string();
        assert!(situations.contains("FLOOR and STEP move one register"), "{situations}");
        assert!(situations.contains("same 3 moves as before"), "{situations}");
        let changed = std::fs::read_to_string(shop.path(method).join("PART.nc")).expect("reads");
        assert_eq!(
            changed.matches("G65 P8002").count(),
            if method == "g65" { 3 } else { 0 },
            "{changed}"
        );
    }
    let out = shop.path("lathe").display().to_string();
    let (exit, _, err) = shop.run(2, &["size", "generate", "--control", "fanuc-lathe", "--out", &out]);
    assert!(exit == 2 && err.contains("is the control of a lathe"), "{exit} {err}");
}

//! The commands as their users call them: the real binary, real files, and the numbers that the contract promises.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

fn toolmark(args: &[&str], data: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(args)
        .env("TOOLMARK_DATA", data)
        .output()
        .expect("the binary starts")
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn corpus(name: &str) -> String {
    format!("{}/../corpus/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A file of the samples beside the repository; a message and `None` where they are not.
fn sample(name: &str) -> Option<String> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/samples")
        .join(name);
    if path.exists() {
        return Some(path.display().to_string());
    }
    println!("skipped: {name} is not there; put the samples beside the repository in ../shared/samples");
    None
}

fn words(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

#[track_caller]
fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("no JSON: {e}\n{}", words(output)))
}

#[track_caller]
fn good(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", words(output));
}

fn summary(found: &Value) -> [u64; 7] {
    [
        "workingsteps_enabled",
        "workingsteps_disabled",
        "toolpaths",
        "rapids",
        "dwells",
        "tools",
        "nc_functions",
    ]
    .map(|name| found["summary"][name].as_u64().expect(name))
}

#[test]
fn inspect_counts_what_the_corpus_holds() {
    let data = folder();
    let inspect = |name: &str| json(&toolmark(&["inspect", "--json", &corpus(name)], data.path()));
    assert_eq!(summary(&inspect("bracket.stpnc")), [5, 1, 28, 13, 2, 3, 2]);
    assert_eq!(inspect("plate.nc")["kind"], "gcode");
    assert_eq!(inspect("shaft.nc")["schema"], "fanuc-lathe");
}

#[test]
fn inspect_gives_the_figures_of_the_sample_plate() {
    let Some(plate) = sample("stepnc/ap238/plate_mm_e3.stpnc") else {
        return;
    };
    let found = json(&toolmark(&["inspect", "--json", &plate], folder().path()));
    let [enabled, disabled, toolpaths, rapids, dwells, tools, _] = summary(&found);
    assert_eq!([enabled, disabled, toolpaths, rapids, dwells, tools], [3, 1, 28, 12, 4, 3]);
}

#[test]
fn every_sample_of_ap238_opens() {
    for name in [
        "block_inch_nested_e1",
        "plate_anchored_p21e3",
        "plate_plan_and_twin_e3",
        "plate_trace_functions_e3",
    ] {
        let Some(file) = sample(&format!("stepnc/ap238/{name}.stpnc")) else {
            return;
        };
        let output = toolmark(&["inspect", "--json", &file], folder().path());
        good(&output);
        assert!(summary(&json(&output))[0] > 0, "{name} has workingsteps");
    }
}

#[test]
fn a_part_of_the_tree_is_picked_by_its_name() {
    let data = folder();
    let output = toolmark(
        &["inspect", "--json", "--select", "wave groove", &corpus("bracket.stpnc")],
        data.path(),
    );
    good(&output);
    assert_eq!(json(&output)["tree"][0]["name"], "wave groove");
    let nothing = toolmark(
        &["inspect", "--select", "no such step", &corpus("bracket.stpnc")],
        data.path(),
    );
    assert_eq!(nothing.status.code(), Some(2), "{}", words(&nothing));
}

#[test]
fn a_run_writes_its_four_files_and_they_fit_together() {
    let (data, out) = (folder(), folder());
    let dir = out.path().display().to_string();
    let output = toolmark(
        &["run", &corpus("bracket.stpnc"), "--fast", "--out", &dir, "--json"],
        data.path(),
    );
    good(&output);
    let told = json(&output);
    assert_eq!(told["ended"], "completed");
    assert_eq!(told["report"]["verdict"], "good");

    let twin = out.path().join("as-executed.stpnc").display().to_string();
    let inspected = json(&toolmark(&["inspect", "--json", &twin], data.path()));
    let trees = inspected["tree"].as_array().expect("trees");
    assert_eq!(trees.len(), 2, "the plan and its twin");
    assert_eq!(trees.iter().filter(|t| t["twin"] == true).count(), 1);
    assert_eq!(summary(&inspected), [5, 1, 28, 13, 2, 3, 2], "the counts are the plan's");

    let compared = json(&toolmark(&["compare", "--json", &twin], data.path()));
    assert_eq!(compared["verdict"], "good");
    for (run, file) in told["report"]["workingsteps"]
        .as_array()
        .expect("list")
        .iter()
        .zip(compared["workingsteps"].as_array().expect("list"))
    {
        let p95 = |w: &Value| w["dev_p95_mm"].as_f64().expect("a number");
        assert!(
            (p95(run) - p95(file)).abs() < 0.001,
            "the file says what the run said: {run} {file}"
        );
    }
    let html = std::fs::read_to_string(out.path().join("report.html")).expect("a report");
    assert!(html.contains("SIMULATED") && html.contains("<svg") && !html.contains("http://") && !html.contains("https://"));
    let report: Value = serde_json::from_slice(&std::fs::read(out.path().join("report.json")).expect("json")).expect("json");
    assert_eq!(report["samples"], told["report"]["samples"]);

    let record = out.path().join("record.parquet").display().to_string();
    let again = out.path().join("again.stpnc").display().to_string();
    let rebuilt = json(&toolmark(
        &["rebuild", &corpus("bracket.stpnc"), &record, "--out", &again, "--json"],
        data.path(),
    ));
    assert_eq!(rebuilt["verdict"], "good", "the record alone gives the same answer");
    assert_eq!(rebuilt["feed_runs"], told["report"]["feed_runs"]);
}

#[test]
fn the_same_seed_and_start_give_the_same_bytes_in_every_output() {
    let files = ["as-executed.stpnc", "report.html", "report.json", "record.parquet"];
    let run = |program: &str, seed: &str| -> Vec<Vec<u8>> {
        let (data, out) = (folder(), folder());
        let dir = out.path().display().to_string();
        let args = [
            "run",
            &corpus(program),
            "--fast",
            "--out",
            &dir,
            "--seed",
            seed,
            "--start",
            "2026-11-21T08:00:00Z",
        ];
        let output = toolmark(&args, data.path());
        assert!(matches!(output.status.code(), Some(0 | 1)), "{}", words(&output));
        files.iter().map(|f| std::fs::read(out.path().join(f)).expect(f)).collect()
    };
    for program in ["bracket.stpnc", "shaft.nc"] {
        let (first, second, other) = (run(program, "7"), run(program, "7"), run(program, "8"));
        for (k, file) in files.iter().enumerate() {
            assert!(first[k] == second[k], "{program}: {file} differs");
        }
        assert!(first[3] != other[3], "{program}: another seed gives another record");
    }
}

#[test]
fn a_wrong_set_up_is_found_in_positions_as_an_agent_gives_them() {
    let (data, out) = (folder(), folder());
    let dir = out.path().display().to_string();
    for thinning in ["10", "100,20", "300,50"] {
        let args = [
            "run",
            &corpus("bracket.stpnc"),
            "--fast",
            "--out",
            &dir,
            "--plant-shift",
            "5:0,0.12,0",
            "--as-mtconnect",
            thinning,
            "--json",
        ];
        let output = toolmark(&args, data.path());
        assert_eq!(output.status.code(), Some(1), "{thinning}: {}", words(&output));
        let report = &json(&output)["report"];
        assert_eq!(
            (report["feed_runs"].as_u64(), report["rapid_runs"].as_u64()),
            (Some(6), Some(7)),
            "{thinning}"
        );
        for w in report["workingsteps"].as_array().expect("list") {
            // Seventeen samples of a wave: their p95 is their worst.
            if thinning == "300,50" && w["name"] == "wave groove" {
                continue;
            }
            let expected = if w["name"] == "side slot" {
                "out of tolerance"
            } else {
                "good"
            };
            assert_eq!(w["verdict"], expected, "{thinning}: {}", w["name"]);
        }
    }
}

/// Speed and acceleration of every sample, from the written file alone.
#[track_caller]
fn check_limits(csv: &Path, v_max: f64, a_max: f64) -> usize {
    let text = std::fs::read_to_string(csv).expect("the CSV");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("t_s,x_mm,y_mm,z_mm,step_id,s_mm,feed_mm_s"));
    let rows: Vec<[f64; 4]> = lines
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').take(4).map(|n| n.parse().expect("a number")).collect();
            [numbers[0], numbers[1], numbers[2], numbers[3]]
        })
        .collect();
    let mut worst = (0.0f64, 0.0f64);
    for w in rows.windows(3) {
        // A dwell stands between two samples that are more than a millisecond apart.
        if w[2][0] - w[0][0] > 0.0025 {
            continue;
        }
        let [a, b, c] = [&w[0][1..], &w[1][1..], &w[2][1..]];
        for ((a, b), c) in a.iter().zip(b).zip(c) {
            worst.0 = worst.0.max((c - b).abs() * 1e3 / v_max);
            worst.1 = worst.1.max((c - 2.0 * b + a).abs() * 1e6 / a_max);
        }
    }
    assert!(worst.0 <= 1.001 && worst.1 <= 1.001, "{worst:?}");
    rows.len()
}

#[test]
fn the_nist_programs_are_planned_within_speed_acceleration_and_jerk() {
    for name in ["827-9999-904-OP1.NC", "827-9999-904-OP2.NC"] {
        let Some(program) = sample(&format!("mtconnect/nist-sms/{name}")) else {
            return;
        };
        let out = folder();
        let csv = out.path().join("plan.csv");
        let output = toolmark(
            &[
                "plan",
                &program,
                "--out",
                &csv.display().to_string(),
                "--frame",
                "machine",
                "--json",
            ],
            out.path(),
        );
        good(&output);
        let told = json(&output);
        assert!(told["worst_ratio"]["a"].as_f64().expect("a ratio") <= 1.001);
        assert!(told["worst_ratio"]["j"].as_f64().expect("a ratio") <= 1.001);
        assert_eq!(told["samples"].as_u64(), Some(check_limits(&csv, 500.0, 3000.0) as u64));
    }
}

#[test]
fn plan_obeys_the_limits_it_is_given() {
    let out = folder();
    let (limits, csv) = (out.path().join("limits.json"), out.path().join("plan.csv"));
    std::fs::write(
        &limits,
        r#"{"v_max_mm_s":[100,100,50],"a_max_mm_s2":400,"tolerance_mm":0.002}"#,
    )
    .expect("written");
    let (limits, csv_name) = (limits.display().to_string(), csv.display().to_string());
    let output = toolmark(
        &[
            "plan",
            &corpus("plate.nc"),
            "--out",
            &csv_name,
            "--limits",
            &limits,
            "--frame",
            "machine",
            "--json",
        ],
        out.path(),
    );
    good(&output);
    assert!(json(&output)["max_deviation_mm"].as_f64().expect("a length") <= 0.002);
    check_limits(&csv, 100.0, 400.0);
    let parquet = out.path().join("plan.parquet");
    good(&toolmark(
        &["plan", &corpus("plate.nc"), "--out", &parquet.display().to_string()],
        out.path(),
    ));
    assert!(std::fs::read(parquet).expect("written").starts_with(b"PAR1"));
}

#[test]
fn a_recording_without_a_plan_is_cut_by_its_own_speeds() {
    let Some(recording) = sample("mtconnect/moldy_100ms.xml") else {
        return;
    };
    let out = folder();
    let file = out.path().join("moldy.stpnc").display().to_string();
    let output = toolmark(&["rebuild", "--no-plan", &recording, "--out", &file, "--json"], out.path());
    good(&output);
    let told = json(&output);
    assert_eq!(
        (told["feed_runs"].as_u64(), told["rapid_runs"].as_u64()),
        (Some(33), Some(34))
    );
    let [_, _, toolpaths, rapids, dwells, ..] = summary(&json(&toolmark(&["inspect", "--json", &file], out.path())));
    assert_eq!((rapids, toolpaths - rapids - dwells), (34, 33), "the file holds them");
}

#[test]
fn pandas_reads_the_record() {
    let python = std::env::var("TOOLMARK_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python)
        .args(["-c", "import pandas, pyarrow"])
        .output()
        .is_ok_and(|o| o.status.success());
    if !has {
        println!("skipped: {python} has no pandas and pyarrow; install them with pip, or set TOOLMARK_PYTHON");
        return;
    }
    let (data, out) = (folder(), folder());
    let dir = out.path().display().to_string();
    good(&toolmark(
        &["run", &corpus("bracket.stpnc"), "--fast", "--out", &dir],
        data.path(),
    ));
    let script = "import sys, pandas\nframe = pandas.read_parquet(sys.argv[1])\nprint(len(frame), frame['step'].max() > 10, \
                  frame['ts'].is_monotonic_increasing, 'X.POSITION.ACTUAL' in frame.columns)";
    let read = Command::new(python)
        .args(["-c", script, &format!("{dir}/record.parquet")])
        .output()
        .expect("python starts");
    let text = words(&read);
    assert!(text.trim().ends_with("True True True") && read.status.success(), "{text}");
}

#[test]
fn a_second_process_on_the_same_data_is_told_who_holds_it() {
    let (data, out) = (folder(), folder());
    let dir = out.path().display().to_string();
    let mut first = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(["run", &corpus("bracket.stpnc"), "--out", &dir])
        .env("TOOLMARK_DATA", data.path())
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("the binary starts");
    // The first one runs in real time, so it holds the lock for most of a minute; wait until its record has begun.
    let begun = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(50));
        data.path().join("segments/job-000001/0001.segment").exists()
    });
    let second = toolmark(&["run", &corpus("plate.nc"), "--fast", "--out", &dir], data.path());
    first.kill().expect("it runs");
    first.wait().expect("it ends");
    assert!(begun, "the first run began");
    assert_eq!(second.status.code(), Some(4), "{}", words(&second));
    assert!(words(&second).contains("toolmark run"), "{}", words(&second));
    let third = toolmark(&["run", &corpus("bracket.stpnc"), "--fast", "--out", &dir], data.path());
    assert!(
        words(&third).contains("notice:"),
        "the next start says which job was interrupted: {}",
        words(&third)
    );
}

#[test]
fn wrong_usage_is_exit_2_and_help_teaches() {
    let data = folder();
    for args in [
        &["rebuild", "only-one"][..],
        &["plan", "x.nc"],
        &["nonsense"],
        &["run", "x.nc", "--as-mtconnect", "soon"],
    ] {
        let output = toolmark(args, data.path());
        assert_eq!(output.status.code(), Some(2), "{args:?}: {}", words(&output));
    }
    for command in ["demo", "run", "check", "inspect", "plan", "rebuild", "compare"] {
        let output = toolmark(&[command, "--help"], data.path());
        good(&output);
        assert!(words(&output).len() > 400, "{command} explains itself");
    }
}

#[test]
fn the_corpus_gives_the_figures_that_are_expected_of_it() {
    let out = folder();
    for name in ["bracket.stpnc", "flange.nc", "plate.nc", "shaft.nc", "spindle.nc"] {
        let inspected = json(&toolmark(&["inspect", "--json", &corpus(name)], out.path()));
        let csv = out.path().join("plan.csv").display().to_string();
        let planned = json(&toolmark(&["plan", "--json", &corpus(name), "--out", &csv], out.path()));
        let milliseconds = (planned["time_s"].as_f64().expect("a time") * 1e3).round() as u64;
        let figures = serde_json::json!({
            "schema": inspected["schema"],
            "units": inspected["units"],
            "summary": inspected["summary"],
            "blocks": planned["blocks"],
            "time_ms": milliseconds,
        });
        let path = corpus(&format!("expected/{name}.json"));
        if std::env::var_os("UPDATE_EXPECT").is_some() {
            let text = serde_json::to_string_pretty(&figures).expect("JSON");
            std::fs::write(&path, text + "\n").expect("the corpus can be written");
        }
        let expected: Value = serde_json::from_slice(&std::fs::read(&path).expect(&path)).expect("JSON");
        assert_eq!(figures, expected, "{name}; UPDATE_EXPECT=1 writes the figures anew");
    }
}

//! `toolmark trace`: what was recorded, looked at from outside: the real binary on a data directory with a real run in it.

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
fn ends(output: &Output, code: i32) {
    assert_eq!(output.status.code(), Some(code), "{}", words(output));
}

/// A data directory with one run of the plate in it.
fn with_a_run() -> TempDir {
    let data = tempfile::tempdir().expect("a folder");
    let plate = format!("{}/../corpus/plate.nc", env!("CARGO_MANIFEST_DIR"));
    let output = toolmark(&["run", &plate, "--fast", "--start", "2026-11-21T08:00:00Z"], data.path());
    ends(&output, 0);
    data
}

fn text(path: &Path) -> &str {
    path.to_str().expect("Unicode")
}

fn record_of(data: &Path) -> PathBuf {
    let listed = json(&toolmark(&["trace", "list", "--json"], data));
    data.join(listed["jobs"][0]["records"][0]["path"].as_str().expect("a path"))
}

#[test]
fn list_and_show_tell_what_was_recorded() {
    let data = with_a_run();
    let listed = json(&toolmark(&["trace", "list", "--json"], data.path()));
    let job = &listed["jobs"][0];
    assert_eq!(
        (&job["job"], &job["program"], &job["machine"]),
        (&1.into(), &"plate.nc".into(), &"sim-mill".into())
    );
    assert_eq!((&job["state"], &job["verdict"]), (&"done".into(), &"good".into()));
    assert_eq!(
        (&job["start"], &job["missing_rows"]),
        (&"2026-11-21T08:00:00Z".into(), &0.into())
    );
    assert_eq!(listed["notices"], serde_json::json!([]));
    let rows = job["rows"].as_u64().expect("a number");
    assert!(rows > 1000 && job["duration_s"].as_f64().expect("a number") > 1.0);

    let output = toolmark(&["trace", "show", "last", "--json"], data.path());
    ends(&output, 0);
    let shown = json(&output);
    assert_eq!(shown["rows"], job["rows"]);
    let channels = shown["channels"].as_array().expect("a list");
    let x = channels.iter().find(|c| c["name"] == "X.POSITION.ACTUAL").expect("there");
    assert_eq!(
        (&x["unit"], x["count"].as_u64(), &x["unavailable"]),
        (&"MILLIMETER".into(), Some(rows), &0.into())
    );
    assert!(x["min"].as_f64() < x["mean"].as_f64() && x["mean"].as_f64() < x["max"].as_f64());
    let by_step: u64 = shown["workingsteps"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|w| w["rows"].as_u64().expect("rows"))
        .sum();
    assert_eq!(by_step, rows);
    assert_eq!(shown["events"][0]["kind"], "job-started");

    let words = words(&toolmark(&["trace", "show", "1"], data.path()));
    assert!(
        words.contains("job 1: plate.nc on sim-mill") && words.contains("S1.LOAD") && words.contains('█'),
        "{words}"
    );
    let nothing = toolmark(&["trace", "show", "7"], data.path());
    ends(&nothing, 2);
    assert!(
        self::words(&nothing).contains("holds jobs 1 to 1"),
        "{}",
        self::words(&nothing)
    );
    ends(&toolmark(&["trace", "show", "first"], data.path()), 2);
}

#[test]
fn a_directory_that_is_none_is_said_and_not_made() {
    let folder = tempfile::tempdir().expect("a folder");
    let none = folder.path().join("none");
    let output = toolmark(&["trace", "list", text(&none)], folder.path());
    ends(&output, 3);
    assert!(
        words(&output).contains("it is neither a data directory nor a backup"),
        "{}",
        words(&output)
    );
    assert!(!none.exists());
}

#[test]
fn an_exported_table_reads_back_to_the_same_numbers() {
    let data = with_a_run();
    let csv = data.path().with_extension("csv");
    let lines = data.path().with_extension("jsonl");
    let out = ["trace", "export", "1", "--json", "--out"];
    let told = json(&toolmark(&[&out[..], &[text(&csv)]].concat(), data.path()));
    ends(&toolmark(&[&out[..], &[text(&lines)]].concat(), data.path()), 0);
    let table = std::fs::read_to_string(&csv).expect("written");
    let mut rows = table.lines();
    let head: Vec<&str> = rows.next().expect("a head").split(',').collect();
    assert_eq!(&head[..3], ["ts", "t_s", "tick"]);
    let x = head
        .iter()
        .position(|c| *c == "X.POSITION.ACTUAL [MILLIMETER]")
        .expect("a column with its unit");

    // The record is the judge: scaled whole numbers, read by the store.
    let reader = store::record::Reader::open(&record_of(data.path())).expect("ours");
    let recorded: Vec<store::record::Row> = reader.rows().expect("reads").map(|r| r.expect("a row")).collect();
    assert_eq!(told["rows"].as_u64(), Some(recorded.len() as u64));
    let lines_text = std::fs::read_to_string(&lines).expect("written");
    let mut samples = lines_text
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("JSON"))
        .filter(|line| line.get("sample").is_some());
    let mut count = 0;
    for (row, line) in recorded.iter().zip(rows.by_ref()) {
        let cells: Vec<&str> = line.split(',').collect();
        let actual = row.actual.expect("there")[0];
        assert_eq!(
            cells[x].parse::<f64>().expect("a number").to_bits(),
            actual.to_bits(),
            "row {count}"
        );
        assert_eq!(cells[2].parse::<u64>().expect("a number"), row.tick.0);
        let sample = samples.next().expect("as many lines as rows");
        assert_eq!(sample["sample"]["readings"]["X.POSITION.ACTUAL"].as_f64(), Some(actual));
        count += 1;
    }
    assert_eq!((rows.next(), samples.next(), count), (None, None, recorded.len()));
    let array = data.path().with_extension("json");
    ends(&toolmark(&[&out[..], &[text(&array)]].concat(), data.path()), 0);
    let array: Vec<Value> = serde_json::from_slice(&std::fs::read(&array).expect("written")).expect("one array");
    let objects: Vec<Value> = (lines_text.lines())
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(array, objects, "the same objects");
    let events = lines_text.lines().filter(|l| l.starts_with("{\"event\"")).count();
    let beside = std::fs::read_to_string(csv.with_extension("events.csv")).expect("written");
    assert_eq!(
        (events, beside.lines().count() - 1),
        (reader.events().expect("whole").len(), events)
    );
    for file in [csv.with_extension("events.csv"), csv, lines] {
        std::fs::remove_file(file).expect("removed");
    }
}

#[test]
fn a_whole_record_is_the_same_bytes_and_a_part_is_a_record_too() {
    let data = with_a_run();
    let folder = tempfile::tempdir().expect("a folder");
    let whole = folder.path().join("whole.parquet");
    ends(&toolmark(&["trace", "export", "last", "--out", text(&whole)], data.path()), 0);
    let record = record_of(data.path());
    assert_eq!(
        std::fs::read(&whole).expect("written"),
        std::fs::read(&record).expect("there")
    );

    let part = folder.path().join("part.parquet");
    let asked = ["--from", "0.5", "--to", "2026-11-21T08:00:01Z", "--channels", "S1.LOAD,Z.*"];
    let args = [&["trace", "export", "1", "--json", "--out", text(&part)], &asked[..]].concat();
    let told = json(&toolmark(&args, data.path()));
    assert_eq!(told["rows"], 500);
    let reader = store::record::Reader::open(&part).expect("a record");
    assert_eq!(reader.len(), 500);
    assert!(
        reader
            .columns()
            .iter()
            .all(|c| c.name == "S1.LOAD" || c.name.starts_with("Z."))
    );
    assert_eq!(
        reader.rows().expect("reads").next().expect("a row").expect("good").tick.0,
        500
    );
    let of = &reader.metadata()["toolmark.extract_of_sha256"];
    assert_eq!(
        *of,
        store::record::Reader::open(&record)
            .expect("ours")
            .hash()
            .expect("reads")
            .to_string()
    );

    for (args, said) in [
        (&["--out", "x.xls"][..], "the ending says what is written"),
        (
            &["--out", "x.csv", "--channels", "Q.LOAD"],
            "the record has no such channel; it has X.POSITION.COMMANDED",
        ),
        (&["--out", "x.csv", "--from", "soon"], "seconds since the job's start"),
        (&["--out", "x.csv", "--from", "2", "--to", "1"], "nothing is between them"),
    ] {
        let output = toolmark(&[&["trace", "export", "1"], args].concat(), data.path());
        ends(&output, 2);
        assert!(words(&output).contains(said), "{}", words(&output));
    }
}

#[test]
fn an_mdf_file_is_read_by_asammdf() {
    let data = with_a_run();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.mf4");
    let told = json(&toolmark(
        &["trace", "export", "1", "--json", "--out", text(&file)],
        data.path(),
    ));
    let bytes = std::fs::read(&file).expect("written");
    assert!(bytes.starts_with(b"MDF     4.1"), "{:?}", &bytes[..16]);
    let python = std::env::var("TOOLMARK_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python)
        .args(["-c", "import asammdf"])
        .output()
        .is_ok_and(|o| o.status.success());
    if !has {
        println!("skipped: {python} has no asammdf; install it with pip, or set TOOLMARK_PYTHON");
        return;
    }
    let script = "import sys\nfrom asammdf import MDF\nm = MDF(sys.argv[1])\ns = m.get('X.POSITION.ACTUAL')\n\
                  print(len(s.samples), s.unit, m.header.start_time.isoformat(), float(s.timestamps[1]), float(s.samples.min()))";
    let read = Command::new(python)
        .args(["-c", script, text(&file)])
        .output()
        .expect("python starts");
    let shown = json(&toolmark(&["trace", "show", "1", "--json"], data.path()));
    let x = shown["channels"]
        .as_array()
        .expect("a list")
        .iter()
        .find(|c| c["name"] == "X.POSITION.ACTUAL")
        .expect("there");
    let expected = format!(
        "{} MILLIMETER 2026-11-21T08:00:00+00:00 0.001 {:?}",
        told["rows"],
        x["min"].as_f64().expect("a number")
    );
    assert_eq!(String::from_utf8_lossy(&read.stdout).trim(), expected, "{}", words(&read));
}

#[test]
fn verify_names_what_was_changed_and_ends_with_1() {
    let data = with_a_run();
    let output = toolmark(&["trace", "verify", "--json"], data.path());
    ends(&output, 0);
    let told = json(&output);
    assert_eq!((&told["verified"], &told["findings"]), (&true.into(), &serde_json::json!([])));
    assert!(
        told["files"].as_u64() >= Some(5) && told["events"].as_u64() > Some(10),
        "{told}"
    );
    for path in [record_of(data.path()), data.path().join("jobs/000001/report.html")] {
        let whole = std::fs::read(&path).expect("reads");
        let mut changed = whole.clone();
        let middle = changed.len() / 2;
        changed[middle] ^= 1;
        std::fs::write(&path, changed).expect("written");
        let output = toolmark(&["trace", "verify"], data.path());
        ends(&output, 1);
        let said = words(&output);
        assert!(
            said.contains(text(&path)) && said.contains("its content is not what was recorded"),
            "{said}"
        );
        std::fs::write(&path, whole).expect("as it was");
    }
    // A row, with the triggers out of the way.
    let database = data.path().join("toolmark.sqlite");
    let mut bytes = std::fs::read(&database).expect("reads");
    let at = bytes
        .windows(8)
        .position(|w| w == b"plate.nc")
        .expect("the name of the program");
    bytes[at] = b'P';
    std::fs::write(&database, bytes).expect("written");
    let output = toolmark(&["trace", "verify", "--json"], data.path());
    ends(&output, 1);
    let findings = json(&output)["findings"].to_string();
    assert!(findings.contains("table "), "{findings}");
}

#[test]
fn an_interrupted_job_is_said_by_every_command_until_one_that_works_there_has_said_it() {
    let data = tempfile::tempdir().expect("a folder");
    let bracket = format!("{}/../corpus/bracket.stpnc", env!("CARGO_MANIFEST_DIR"));
    // In real time, so that it can be killed in the middle.
    let mut run = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(["run", &bracket])
        .env("TOOLMARK_DATA", data.path())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("the binary starts");
    let begun = (0..400).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(50));
        data.path().join("jobs/000001").is_dir()
    });
    std::thread::sleep(std::time::Duration::from_millis(1500));
    let held = toolmark(&["trace", "list"], data.path());
    run.kill().expect("it runs");
    run.wait().expect("it ends");
    assert!(begun, "the run began");
    ends(&held, 4);
    assert!(
        words(&held).contains("is in use by toolmark run (process"),
        "{}",
        words(&held)
    );

    let said = |args: &[&str]| {
        let output = toolmark(args, data.path());
        let notices = json(&output)["notices"].to_string();
        let heard = notices.contains("job 1 (bracket.stpnc on sim-mill)") && notices.contains("was interrupted");
        assert_eq!(
            heard,
            String::from_utf8_lossy(&output.stderr).contains("was interrupted"),
            "{}",
            words(&output)
        );
        heard
    };
    let to = tempfile::tempdir().expect("a folder");
    assert!(said(&["trace", "list", "--json"]), "a reader says it");
    assert!(said(&["trace", "show", "1", "--json"]), "and leaves it");
    assert!(said(&["backup", text(to.path()), "--json"]), "who works there says it");
    assert!(!said(&["trace", "list", "--json"]), "and then it is said");
    let listed = json(&toolmark(&["trace", "list", "--json"], data.path()));
    assert_eq!(listed["jobs"][0]["state"], "interrupted");
    ends(&toolmark(&["trace", "verify"], data.path()), 0);
    ends(&toolmark(&["trace", "verify", text(to.path())], data.path()), 0);
}

#[test]
fn the_help_of_each_verb_teaches() {
    let data = tempfile::tempdir().expect("a folder");
    for verb in ["list", "show", "export", "verify"] {
        let output = toolmark(&["trace", verb, "--help"], data.path());
        ends(&output, 0);
        assert!(words(&output).contains("data directory or a backup of one"), "{verb}");
    }
}

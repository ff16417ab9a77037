//! A run whose process was killed: the next one says where it was, nothing resumes by itself, and it is taken up there when a person asks.
//!
//! Real time on a shared computer: a run that the system kept from its processor for longer than the machine file allows ends in a
//! controlled stop, counts it, and is tried again.

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const PLATE: &str = "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nS3000 M3\nM8\nG0 X0. Y0. Z10.\nG1 Z-1. F600.\nN10 X20. F240.\nN20 Y15.\nG3 X10. Y25. I-10. J0.\n\
                     G1 X0.\nY0.\nG0 Z10.\nM9\nM5\nM30\n%\n";

fn toolmark(args: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
    command.args(args).env("TOOLMARK_DATA", data);
    command
}

fn words(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// A mill that forgives a shared computer its gaps.
fn machine_file(folder: &Path) -> String {
    let mill = include_str!("../../store/machines/sim-mill.toml");
    let text = mill.replacen("kind = \"mill\"", "late_ticks_allowed = 90\nkind = \"mill\"", 1);
    let text = text.replacen("tool_change_s = 2.5", "tool_change_s = 0.2", 1);
    let path = folder.join("mill.toml");
    std::fs::write(&path, text).expect("written");
    path.display().to_string()
}

struct Controller {
    child: Child,
    address: String,
}

impl Controller {
    fn begin(machine: &str, more: &[&str], data: &Path) -> Controller {
        let args = [&["controller", "--json", "--machine", machine, "--port", "0"], more].concat();
        let mut child = toolmark(&args, data)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().expect("piped"));
        out.read_line(&mut line).expect("it says where it is");
        // What it says at its end is read by nobody, and has to go somewhere.
        std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"));
        let address = told["address"].as_str().expect("an address").to_owned();
        Controller { child, address }
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs until so many rows of the job are on disk, and kills it there.
fn killed(args: &[&str], data: &Path, job: i64, rows: u64) {
    let mut run = toolmark(args, data)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let segment = data.join(format!("segments/job-{job:06}/0001.segment"));
    let begun = (0..1200).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        store::segment::read(&segment).is_ok_and(|found| found.rows > rows)
    });
    run.kill().expect("it runs"); // SIGKILL on Unix
    run.wait().expect("it ends");
    assert!(begun, "some seconds of the run came to the disk");
}

fn answer_of(done: &Output) -> Value {
    serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(done)))
}

#[test]
fn a_killed_run_is_said_with_its_place_and_taken_up_there_when_a_person_asks() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let machine = machine_file(folder.path());
    killed(&["run", &plate, "--machine", &machine], &data, 1, 4000);

    let run = |more: &[&str]| {
        let args = [&["run", &plate, "--fast", "--json", "--machine", &machine], more].concat();
        toolmark(&args, &data).output().expect("the binary starts")
    };
    let resumed = run(&["--resume", "1"]);
    let answer = answer_of(&resumed);
    assert_eq!(
        (resumed.status.code(), &answer["ended"]),
        (Some(0), &"completed".into()),
        "{}",
        words(&resumed)
    );
    let at = answer["restart"]["at"].as_str().expect("a place").to_owned();
    assert!(
        at.starts_with("N10 (line 10)") && answer["restart"]["after_job"] == 1,
        "{answer}"
    );
    assert_eq!(answer["report"]["verdict"], "good", "{answer}");
    let said = words(&resumed);
    assert!(
        said.contains("job 1 (plate.nc on sim-mill)") && said.contains("was interrupted"),
        "{said}"
    );

    // Job 2 has finished it: nothing is left to say, and nothing to take up.
    let plain = run(&[]);
    assert!(!words(&plain).contains("To take it up there"), "{}", words(&plain));
    assert_eq!(answer_of(&plain)["restart"], Value::Null);
    let again = run(&["--resume", "last"]);
    assert_eq!(again.status.code(), Some(2), "{}", words(&again));
    assert!(words(&again).contains("came to its end"), "{}", words(&again));
    assert_eq!(run(&["--resume", "77"]).status.code(), Some(2));

    killed(&["run", &plate, "--machine", &machine], &data, 4, 4000);
    let plain = run(&[]);
    let said = words(&plain);
    let expected = format!("job 4 of this program was interrupted at {at}; this run begins at the beginning");
    assert!(said.contains(&expected) && said.contains("--resume 4"), "{said}");
    // Other bytes: the step may be another one.
    std::fs::write(&plate, PLATE.replace("X20.", "X21.")).expect("written");
    let edited = run(&["--resume", "4"]);
    assert_eq!(edited.status.code(), Some(2), "{}", words(&edited));
    assert!(words(&edited).contains("other bytes"), "{}", words(&edited));
}

#[test]
fn a_controller_that_a_killed_run_left_in_hold_is_driven_on_from_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path());
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let mut last = String::new();
    for attempt in 0..4 {
        let data = folder.path().join(format!("data-{attempt}"));
        let controller = Controller::begin(&machine, &[], &folder.path().join(format!("other-{attempt}")));
        let behind = ["--machine", &controller.address, "--machine-file", &machine];
        killed(&[&["run", &plate], &behind[..]].concat(), &data, 1, 3000);
        let resume = [
            &["run", &plate, "--json", "--resume", "last", "--feed-override", "150"],
            &behind[..],
        ]
        .concat();
        let done = toolmark(&resume, &data).output().expect("it runs");
        last = words(&done);
        println!("{attempt}: {last}");
        let answer = answer_of(&done);
        if answer["ended"] != "completed" {
            assert!(answer["driven"]["late_ticks"].as_u64() > Some(0), "{last}");
            continue;
        }
        assert_eq!(
            (done.status.code(), &answer["report"]["verdict"]),
            (Some(0), &"good".into()),
            "{last}"
        );
        assert_eq!(answer["restart"]["after_job"], 1, "{last}");
        assert_eq!(answer["overrides"][0]["feed_percent"], 150, "{last}");
        // The next run has the machine's own overrides again.
        let next = [&["run", &plate, "--json"], &behind[..]].concat();
        let done = toolmark(&next, &data).output().expect("it runs");
        let answer = answer_of(&done);
        if answer["ended"] == "completed" {
            assert_eq!(answer["overrides"].as_array().map(Vec::len), Some(0), "{}", words(&done));
            return;
        }
    }
    panic!("four runs were kept from the processor: {last}");
}

#[test]
fn the_text_protocol_takes_a_program_up_after_a_run_that_died() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path());
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let reports = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port");
    let reports = reports.port().to_string();
    let data = folder.path().join("data");
    for attempt in 0..4 {
        let kept = folder.path().join(format!("kept-{attempt}")).display().to_string();
        let more = ["--link", "text", "--report-port", &reports, "--record", &kept];
        let controller = Controller::begin(&machine, &more, &folder.path().join("other"));
        // A run that dies leaves the machine somewhere, with its tool.
        let behind = ["--machine", &controller.address, "--machine-file", &machine];
        let text = ["--link", "text", "--report-port", &reports];
        let mut dying = toolmark(&[&["run", &plate], &behind[..], &text[..]].concat(), &data)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        std::thread::sleep(Duration::from_secs(8));
        dying.kill().expect("it runs");
        dying.wait().expect("it ends");
        let first = Path::new(&kept).join("run-0001.parquet");
        let until = Instant::now() + Duration::from_secs(10);
        while !first.exists() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
        let args = [
            "run",
            &plate,
            "--json",
            "--from",
            "N20",
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
        ];
        let done = toolmark(&[&args[..], &["--link", "text", "--report-port", &reports]].concat(), &data)
            .output()
            .expect("it runs");
        let answer = answer_of(&done);
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &"sent".into()),
            "{}",
            words(&done)
        );
        assert!(
            answer["restart"]["at"].as_str().is_some_and(|at| at.starts_with("N20")),
            "{answer}"
        );
        let record = Path::new(&kept).join("run-0002.parquet");
        let until = Instant::now() + Duration::from_secs(40);
        while !record.exists() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
        // It came to the end of the path, and N10 was not cut: the tip was never at X0 Y0 on the part.
        let Ok(reader) = store::record::Reader::open(&record) else {
            continue;
        };
        let (mut lowest_at_start, mut lowest) = (f64::MAX, f64::MAX);
        for batch in reader.batches().expect("batches") {
            let batch = batch.expect("a batch");
            let axis = |name: &str| -> Vec<f64> {
                let values = batch.values(name).expect("a column");
                values.map(|v| v.expect("a value")).collect()
            };
            let (x, y, z) = (
                axis("X.POSITION.COMMANDED"),
                axis("Y.POSITION.COMMANDED"),
                axis("Z.POSITION.COMMANDED"),
            );
            for k in 0..x.len() {
                let is_there = (x[k] + 490.0).abs() < 0.01 && (y[k] + 350.0).abs() < 0.01;
                lowest = lowest.min(z[k]);
                if is_there {
                    lowest_at_start = lowest_at_start.min(z[k]);
                }
            }
        }
        assert!(lowest_at_start > -100.0, "N10 was cut: {lowest_at_start}");
        if (lowest + 381.0).abs() < 0.01 {
            return;
        }
        println!("{attempt}: it came as deep as {lowest}");
    }
    panic!("four runs were kept from the processor");
}

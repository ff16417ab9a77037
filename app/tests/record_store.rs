//! Recording an agent into the data directory: killed, stopped, taken up again, on a full disk.

#[path = "support/agent.rs"]
mod agent;
#[path = "support/small_disk.rs"]
mod small_disk;

use agent::{Agent, Script};
use mtconnect::streams::read_streams;
use serde_json::Value as Json;
use small_disk::SmallDisk;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use store::observations::{Row, rows};
use tempfile::TempDir;

fn own_recording() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus/slots-recording.xml");
    std::fs::read(path).expect("the corpus is there")
}

/// The numbers of everything that the agent tells, in order.
fn numbers(recording: &[u8]) -> Vec<u64> {
    let mut all: Vec<u64> = read_streams(recording, "f").observations.iter().map(|o| o.sequence).collect();
    all.sort_unstable();
    all
}

/// A gap: from, to, cause.
type Gap = (u64, Option<u64>, String);

/// The numbers of observations, and the gaps among them.
fn rows_of(batches: impl Iterator<Item = Result<Vec<Row<'static>>, String>>) -> (Vec<u64>, Vec<Gap>) {
    let (mut observations, mut gaps) = (vec![], vec![]);
    for rows in batches {
        for row in rows.expect("observations") {
            if row.texts[9] == store::observations::GAP {
                let said: Json = serde_json::from_str(row.text.as_deref().expect("its end")).expect("JSON");
                gaps.push((row.sequence, said["to_sequence"].as_u64(), row.texts[7].to_string()));
            } else {
                observations.push(row.sequence);
            }
        }
    }
    (observations, gaps)
}

struct Shop {
    folder: TempDir,
    child: Option<Child>,
}

impl Shop {
    fn new() -> Shop {
        Shop {
            folder: tempfile::tempdir().expect("a folder"),
            child: None,
        }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn toolmark(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
        command.args(words).env("TOOLMARK_DATA", self.data());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// The JSON answer of a command that ends well.
    #[track_caller]
    fn answer(&self, words: &[&str]) -> Json {
        let output = self.toolmark(words).arg("--json").output().expect("started");
        assert_eq!(output.status.code(), Some(0), "{words:?}: {}", both(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{words:?}: {e}: {}", both(&output)))
    }

    fn record(&mut self, url: &str) {
        let words = [
            "record",
            url,
            "--json",
            "--interval",
            "10",
            "--heartbeat",
            "1000",
            "--file-rows",
            "60",
        ];
        self.child = Some(self.toolmark(&words).spawn().expect("started"));
    }

    /// Waits until something is true of the data directory; two minutes are too long on any machine.
    fn until(&mut self, what: &str, mut is_true: impl FnMut(&Path) -> bool) {
        let (began, data) = (Instant::now(), self.data());
        while !is_true(&data) {
            let child = self.child.as_mut().expect("it runs");
            if child.try_wait().expect("a state").is_some() || began.elapsed() > Duration::from_secs(120) {
                let _ = child.kill();
                let output = self.child.take().expect("it ran").wait_with_output().expect("an end");
                panic!("{what} never came: {}", both(&output));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn kill(&mut self) {
        let mut child = self.child.take().expect("it runs");
        child.kill().expect("killed");
        child.wait().expect("an end");
    }

    /// Ctrl-C; gives the JSON answer.
    #[track_caller]
    fn stop(&mut self) -> Json {
        let child = self.child.take().expect("it runs");
        signal(child.id(), "INT");
        let output = child.wait_with_output().expect("an end");
        assert_eq!(output.status.code(), Some(0), "{}", both(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", both(&output)))
    }

    /// All record files of the catalogue, in its order.
    fn files(&self) -> Vec<PathBuf> {
        let list = self.answer(&["trace", "list"]);
        let jobs = list["jobs"].as_array().expect("jobs").iter();
        let records = jobs.flat_map(|job| job["records"].as_array().expect("records").clone());
        records
            .map(|r| self.data().join(r["path"].as_str().expect("a path")))
            .collect()
    }

    /// Everything in the catalogue, in its order.
    fn catalogued(&self) -> (Vec<u64>, Vec<Gap>) {
        let (mut observations, mut gaps) = (vec![], vec![]);
        for file in self.files() {
            let table = store::Table::open(&file).expect("a table of ours");
            let (o, g) = rows_of(table.batches().expect("rows").map(|b| rows(&b.expect("whole"))));
            observations.extend(o);
            gaps.extend(g);
        }
        (observations, gaps)
    }

    #[track_caller]
    fn verified(&self) {
        let told = self.answer(&["trace", "verify"]);
        assert_eq!(
            (&told["verified"], &told["remarks"]),
            (&true.into(), &serde_json::json!([])),
            "{told}"
        );
    }
}

impl Drop for Shop {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn signal(id: u32, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &id.to_string()]).status();
    assert!(sent.expect("kill is there").success());
}

fn both(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Files below a folder with an ending.
fn below(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let (mut found, mut folders) = (vec![], vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == ending) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The last number that stands in a segment or a file of a data directory.
fn newest(data: &Path) -> Option<u64> {
    let files = below(&data.join("records"), "parquet").into_iter().filter_map(|path| {
        let table = store::Table::open(&path).ok()?;
        rows_of(table.batches().ok()?.flatten().map(|b| rows(&b))).0.pop()
    });
    let segments = below(&data.join("segments"), "segment").into_iter().filter_map(|path| {
        let found = store::segment::read(&path).ok()?;
        rows_of(found.batches().ok()?.flatten().map(|b| rows(&b))).0.pop()
    });
    files.chain(segments).max()
}

#[test]
fn a_recording_is_a_job_whose_files_are_catalogued_one_by_one_while_it_goes_on() {
    let recording = own_recording();
    let all = numbers(&recording);
    let agent = Agent::start(&recording, Script::at_speed(20.0));
    let mut shop = Shop::new();
    shop.record(&agent.url());
    // The first files are whole and their segments gone while the agent still talks.
    shop.until("the second file", |data| {
        below(&data.join("records"), "parquet").len() >= 2
            && !below(&data.join("segments"), "segment")
                .iter()
                .any(|s| s.ends_with("0001.segment"))
    });
    assert!(
        agent.next() <= *all.last().expect("some"),
        "the agent had told everything before"
    );
    let refused = shop.toolmark(&["trace", "list"]).output().expect("started");
    assert_eq!(refused.status.code(), Some(4), "{}", both(&refused));
    assert!(both(&refused).contains("toolmark record"), "{}", both(&refused));
    shop.until("the end", |data| newest(data) == all.last().copied());
    let told = shop.stop();
    assert_eq!(
        (&told["job"], &told["observations"]),
        (&1.into(), &all.len().into()),
        "{told}"
    );
    assert!(told["files"].as_array().map(Vec::len) >= Some(4), "{told}");
    assert_eq!(shop.catalogued(), (all.clone(), vec![]));
    assert_eq!(below(&shop.data().join("segments"), "segment"), Vec::<PathBuf>::new());
    for file in shop.files() {
        let day = file
            .parent()
            .and_then(Path::file_name)
            .expect("a day")
            .to_string_lossy()
            .into_owned();
        assert!(
            file.starts_with(shop.data().join("records/mill")) && day.len() == 10,
            "{}",
            file.display()
        );
    }
    shop.verified();

    let list = shop.answer(&["trace", "list"]);
    assert_eq!(
        (&list["jobs"][0]["kind"], &list["jobs"][0]["state"]),
        (&"recording".into(), &"done".into())
    );
    let show = shop.answer(&["trace", "show", "1"]);
    assert_eq!((&show["rows"], &show["roll_up"]), (&all.len().into(), &Json::Null));
    let items = show["data_items"].as_array().expect("items");
    let counted: u64 = items
        .iter()
        .map(|i| i["count"].as_u64().unwrap() + i["unavailable"].as_u64().unwrap())
        .sum();
    assert_eq!(counted, all.len() as u64);
    assert!(
        show["events"]
            .as_array()
            .expect("events")
            .iter()
            .any(|e| e["kind"] == "recording-part")
    );
    for (name, lines) in [("a.csv", all.len() + 1), ("a.jsonl", 0)] {
        let out = shop.folder.path().join(name);
        let told = shop.answer(&["trace", "export", "1", "--out", &out.display().to_string()]);
        assert_eq!(told["rows"], all.len());
        let text = std::fs::read_to_string(&out).expect("written");
        let events = told["events"].as_u64().expect("a number") as usize;
        assert_eq!(text.lines().count(), if lines > 0 { lines } else { all.len() + events });
    }

    // The whole recording by number, and one file of it by name, are rebuilt.
    let xml = shop.folder.path().join("recording.xml");
    std::fs::write(&xml, &recording).expect("written");
    let out = shop.folder.path().join("out.stpnc").display().to_string();
    let rebuilt = |record: &str| {
        let told = shop.answer(&["rebuild", "--no-plan", record, "--out", &out]);
        (told["samples"].clone(), told["feed_runs"].clone(), told["rapid_runs"].clone())
    };
    assert_eq!(rebuilt("1"), rebuilt(&xml.display().to_string()));
    assert_eq!(rebuilt("last"), rebuilt("1"));
    assert!(rebuilt(&shop.files()[1].display().to_string()).0.as_u64() > Some(20));

    shop.answer(&["hold", "1", "--reason", "the part came back"]);
    let backup = shop.folder.path().join("backup").display().to_string();
    shop.answer(&["backup", &backup]);
    let there = shop.answer(&["trace", "verify", &backup]);
    assert_eq!(
        (&there["verified"], &there["records"]),
        (&true.into(), &shop.files().len().into())
    );
}

#[test]
fn a_recorder_that_is_killed_anywhere_goes_on_as_the_next_job_and_each_row_is_there_once() {
    let recording = own_recording();
    let all = numbers(&recording);
    let agent = Agent::start(&recording, Script::at_speed(10.0));
    let mut shop = Shop::new();
    for kill in 1..=5 {
        shop.record(&agent.url());
        while agent.next() < all[all.len() * kill / 7] {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Anywhere in its work.
        std::thread::sleep(Duration::from_millis(37 * kill as u64));
        let acknowledged = newest(&shop.data());
        shop.kill();
        if kill == 3 {
            // Another command works there next, and says what was interrupted.
            let held = shop
                .toolmark(&["hold", "1", "--reason", "why not"])
                .output()
                .expect("started");
            assert!(
                both(&held).contains("toolmark record of the same agent goes on"),
                "{}",
                both(&held)
            );
            assert!(shop.catalogued().0.last().copied() >= acknowledged);
            shop.verified();
        }
    }
    shop.record(&agent.url());
    shop.until("the end", |data| newest(data) == all.last().copied());
    let told = shop.stop();
    assert_eq!(shop.catalogued(), (all.clone(), vec![]), "{told}");
    shop.verified();
    let list = shop.answer(&["trace", "list"]);
    let states: Vec<&str> = list["jobs"]
        .as_array()
        .expect("jobs")
        .iter()
        .filter_map(|j| j["state"].as_str())
        .collect();
    assert_eq!(states.last(), Some(&"done"), "{states:?}");
    assert!(states[..states.len() - 1].iter().all(|s| *s == "interrupted"), "{states:?}");

    // Stopped and recorded again: nothing is there twice.
    shop.record(&agent.url());
    std::thread::sleep(Duration::from_millis(500));
    let told = shop.stop();
    assert_eq!((&told["observations"], &told["job"]), (&0.into(), &Json::Null), "{told}");
    assert_eq!(shop.catalogued().0, all);
}

#[test]
fn what_the_agent_forgot_while_nobody_recorded_is_a_gap_with_its_numbers() {
    let recording = own_recording();
    let all = numbers(&recording);
    let script = Script {
        buffer: 40,
        ..Script::at_speed(20.0)
    };
    let agent = Agent::start(&recording, script);
    let mut shop = Shop::new();
    shop.record(&agent.url());
    shop.until("the first rows", |data| newest(data) >= Some(all[50]));
    shop.kill();
    while agent.next() <= all[all.len() * 2 / 3] {
        std::thread::sleep(Duration::from_millis(5));
    }
    shop.record(&agent.url());
    shop.until("the end", |data| newest(data) == all.last().copied());
    let told = shop.stop();
    let (had, gaps) = shop.catalogued();
    let [(from, Some(to), cause)] = &gaps[..] else {
        panic!("{gaps:?} {told}")
    };
    assert_eq!(cause, "overrun");
    let expected: Vec<u64> = all.into_iter().filter(|n| n < from || n > to).collect();
    assert_eq!(had, expected);
    assert_eq!(told["gaps"][0]["from_sequence"], *from);
    assert_eq!(shop.answer(&["trace", "show", "last"])["gaps"][0]["to_sequence"], *to);
    shop.verified();
}

#[test]
fn a_full_disk_stops_what_is_acknowledged_is_said_and_recording_goes_on_when_space_returns() {
    if !SmallDisk::is_possible() {
        return;
    }
    let recording = own_recording();
    let all = numbers(&recording);
    let last = *all.last().expect("some");
    let script = Script {
        buffer: 30,
        ..Script::at_speed(10.0)
    };
    let agent = Agent::start(&recording, script);
    let mut shop = Shop::new();
    let words = |data: &Path| {
        let place = data.to_str().expect("a name");
        let words = ["record", &agent.url(), "--json", "--interval", "10", "--heartbeat", "1000"];
        let more = ["--file-rows", "60", "--data", place];
        words.into_iter().chain(more).map(String::from).collect()
    };
    let (mut disk, child) = SmallDisk::start(words, &shop.data());
    shop.child = Some(child);
    shop.until("the first rows", |_| newest(&disk.data()) >= Some(all[40]));
    disk.fill();
    // Something may be acknowledged until the last page in work is full.
    shop.until("two thirds", |_| agent.next() > all[all.len() / 2]);
    let acknowledged = newest(&disk.data());
    shop.until("the agent's end", |_| agent.next() > last);
    assert_eq!(newest(&disk.data()), acknowledged, "nothing is acknowledged on a full disk");
    disk.free();
    shop.until("the end", |_| newest(&disk.data()) == Some(last));
    signal(disk.id, "TERM");
    let output = shop.child.take().expect("it runs").wait_with_output().expect("an end");
    assert_eq!(output.status.code(), Some(0), "{}", both(&output));
    let told: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("nothing is kept any more") && said.contains("recording goes on"),
        "{said}"
    );
    assert!(told["disk_refusals"].as_u64() > Some(0), "{told}");

    // What was copied off the disk is a data directory.
    let (had, gaps) = shop.catalogued();
    let [(from, Some(to), cause)] = &gaps[..] else {
        panic!("{gaps:?} {told}")
    };
    assert_eq!((cause.as_str(), Some(*from - 1)), ("not-stored", acknowledged));
    let expected: Vec<u64> = all.into_iter().filter(|n| n < from || n > to).collect();
    assert_eq!(had, expected);
    shop.verified();
}

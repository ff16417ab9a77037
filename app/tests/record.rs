//! Recording an agent over real sockets, with everything that goes wrong on a shop's network.

#[path = "support/agent.rs"]
mod agent;
#[path = "support/small_disk.rs"]
mod small_disk;

use agent::{Agent, Script};
use mtconnect::streams::{Observation, Value, read_streams};
use serde_json::Value as Json;
use small_disk::SmallDisk;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn own_recording() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus/slots-recording.xml");
    std::fs::read(path).expect("the corpus is there")
}

fn moldy() -> Option<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/samples/mtconnect/moldy_100ms.xml");
    let bytes = std::fs::read(&path).ok();
    if bytes.is_none() {
        println!("skipped: {} is not here", path.display());
    }
    bytes
}

/// Positions of a recording in the order of their numbers: number, nanoseconds, text.
fn positions(recording: &[u8]) -> Vec<(u64, i64, String)> {
    let mut all: Vec<Observation> = read_streams(recording, "f").observations;
    all.retain(|o| o.kind == "PathPosition");
    all.sort_by_key(|o| o.sequence);
    all.into_iter().map(|o| (o.sequence, o.at.0, words(&o.value))).collect()
}

fn words(value: &Value) -> String {
    match value {
        Value::Unavailable => "UNAVAILABLE".to_owned(),
        Value::Text(text) => text.clone(),
    }
}

/// What a text recording says, in the same words; times from its first line on.
fn rows_of(file: &Path) -> Vec<(u64, i64, String)> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let mut at = 0;
    let mut rows = vec![];
    for line in text.split_inclusive('\n').filter(|l| l.ends_with('\n')) {
        let line = line.trim_end();
        if let Some(start) = line.split(" start=").nth(1) {
            at = mtconnect::instant::parse(start.split(' ').next().expect("a time"))
                .expect("a time")
                .0;
        }
        if line.starts_with('#') {
            continue;
        }
        let (dt, sequence, _) = mtconnect::text::row(line).unwrap_or_else(|| panic!("{line}"));
        at += dt as i64;
        let value: Vec<&str> = line.split(' ').collect();
        rows.push((sequence, at, value[..value.len() - 2].join(" ")));
    }
    rows
}

/// What a Parquet recording says: positions as above, all rows, gaps.
fn table_of(file: &Path) -> (Vec<(u64, i64, String)>, usize, Vec<u64>) {
    let table = store::Table::open(file).expect("a table of ours");
    let (mut positions, mut all, mut gaps) = (vec![], 0, vec![]);
    for batch in table.batches().expect("rows") {
        for row in store::observations::rows(&batch.expect("rows")).expect("observations") {
            if row.texts[9] == store::observations::GAP {
                gaps.push(row.sequence);
                continue;
            }
            all += 1;
            if row.texts[7] == "PathPosition" {
                let text = row.text.map_or("UNAVAILABLE".to_owned(), |t| t.into_owned());
                positions.push((row.sequence, row.at.0, text));
            }
        }
    }
    (positions, all, gaps)
}

/// Numbers are written as short as they can be: `5.50` is `5.5`.
fn as_written(mut rows: Vec<(u64, i64, String)>) -> Vec<(u64, i64, String)> {
    for (_, _, text) in &mut rows {
        if text != "UNAVAILABLE" {
            let numbers: Vec<String> = text
                .split(' ')
                .map(|n| n.parse::<f64>().expect("a number").to_string())
                .collect();
            *text = numbers.join(" ");
        }
    }
    rows
}

struct Recorder {
    folder: TempDir,
    file: PathBuf,
    child: Option<Child>,
}

impl Recorder {
    fn into(name: &str) -> Recorder {
        let folder = tempfile::tempdir().expect("a folder");
        Recorder {
            file: folder.path().join(name),
            folder,
            child: None,
        }
    }

    fn command(&self, url: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
        command
            .args(["record", url, "--json", "--interval", "10", "--heartbeat", "1000", "--out"])
            .arg(&self.file)
            .env("TOOLMARK_DATA", self.folder.path().join("data"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn start(&mut self, url: &str) {
        self.child = Some(self.command(url).spawn().expect("started"));
    }

    /// Waits until the last row of the text recording is of that time; two minutes are too long on any machine.
    fn until(&mut self, at: i64) {
        let began = Instant::now();
        while rows_of(&self.file).last().is_none_or(|r| r.1 != at) {
            let child = self.child.as_mut().expect("it runs");
            if child.try_wait().expect("a state").is_some() || began.elapsed() > Duration::from_secs(120) {
                let _ = child.kill();
                let output = self.child.take().expect("it ran").wait_with_output().expect("an end");
                panic!("{at} never came: {:?} {}", rows_of(&self.file).last(), both(&output));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn signal(&self, name: &str) {
        let id = self.child.as_ref().expect("it runs").id().to_string();
        let sent = Command::new("kill")
            .args([&format!("-{name}"), &id])
            .status()
            .expect("kill is there");
        assert!(sent.success());
    }

    /// Ctrl-C; gives the JSON answer.
    #[track_caller]
    fn stop(&mut self) -> Json {
        self.signal("INT");
        let output = self.child.take().expect("it ran").wait_with_output().expect("an end");
        assert_eq!(output.status.code(), Some(0), "{}", both(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", both(&output)))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn both(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Records a whole recording; the rows must be those of the recording.
#[track_caller]
fn check_identical(recording: &[u8], script: Script) -> Json {
    let expected = as_written(positions(recording));
    let agent = Agent::start(recording, script);
    let mut recorder = Recorder::into("record.txt");
    recorder.start(&agent.url());
    recorder.until(expected.last().expect("positions").1);
    let told = recorder.stop();
    assert_eq!(rows_of(&recorder.file), expected);
    assert_eq!(told["observations"].as_u64(), Some(expected.len() as u64));
    assert_eq!(told["gaps"], serde_json::json!([]), "{told}");
    told
}

#[test]
fn what_is_recorded_is_what_the_agent_told() {
    check_identical(&own_recording(), Script::at_speed(100.0));
    let old = Script {
        old_fashioned: true,
        ..Script::at_speed(1000.0)
    };
    check_identical(&own_recording(), old);
}

#[test]
fn ten_cuts_of_the_network_and_garbage_cost_nothing() {
    let script = Script {
        cuts: vec![10, 300, 700, 1000, 1500, 2222, 3000, 3333, 4000, 5000],
        garbage: vec![b"", b"", b"5\r\nhello\r\n", b"\xff\xfe\x00", b"zz\r\n"],
        ..Script::at_speed(100.0)
    };
    let told = check_identical(&own_recording(), script.clone());
    assert!(told["reconnects"].as_u64() >= Some(10), "{told}");
    if let Some(moldy) = moldy() {
        let cuts = (1..=10).map(|k| k * 7001).collect();
        let told = check_identical(&moldy, Script { cuts, ..script });
        assert!(told["reconnects"].as_u64() >= Some(10), "{told}");
    }
}

#[test]
fn answers_that_are_cut_in_the_middle_are_asked_for_again() {
    // The device model twice, then the newest values: in the head, in the document, one byte before its end.
    let script = Script {
        answer_cuts: vec![20, 150, usize::MAX, 10, usize::MAX, 700],
        ..Script::at_speed(100.0)
    };
    let told = check_identical(&own_recording(), script);
    assert!(told["reconnects"].as_u64() >= Some(3), "{told}");
}

#[test]
fn a_slow_agent_is_waited_for() {
    let script = Script {
        slow: Some((997, Duration::from_millis(3))),
        ..Script::at_speed(100.0)
    };
    let told = check_identical(&own_recording(), script);
    assert_eq!(told["reconnects"], 0, "{told}");
}

#[test]
fn a_whole_recording_at_a_hundred_times_its_speed_comes_out_identical() {
    let Some(moldy) = moldy() else { return };
    let told = check_identical(&moldy, Script::at_speed(100.0));
    assert_eq!(told["observations"], 11520);
    assert_eq!(told["first_sequence"], 60949);
    assert_eq!(told["last_sequence"], 72468);
}

#[test]
fn what_the_agents_buffer_lost_is_a_gap_with_its_numbers_and_nothing_else_is_missing() {
    for recording in std::iter::once(own_recording()).chain(moldy()) {
        let expected = as_written(positions(&recording));
        let all = read_streams(&recording, "f").observations.len();
        let script = Script {
            buffer: 50,
            offline: Some((60, all * 2 / 3)),
            ..Script::at_speed(if all > 1000 { 300.0 } else { 30.0 })
        };
        let agent = Agent::start(&recording, script);
        let mut recorder = Recorder::into("record.txt");
        recorder.start(&agent.url());
        recorder.until(expected.last().expect("positions").1);
        let told = recorder.stop();
        let gaps = told["gaps"].as_array().expect("gaps").clone();
        assert!(!gaps.is_empty(), "{told}");
        let missing = |s: u64| {
            gaps.iter().any(|g| {
                g["from_sequence"].as_u64() <= Some(s) && Some(s) <= g["to_sequence"].as_u64() && g["cause"] == "overrun"
            })
        };
        let had: Vec<_> = expected.iter().filter(|r| !missing(r.0)).cloned().collect();
        assert!(had.len() < expected.len());
        assert_eq!(rows_of(&recorder.file), had, "{gaps:?}");
        let text = std::fs::read_to_string(&recorder.file).expect("a recording");
        assert_eq!(text.matches("# gap ").count(), gaps.len(), "the recording says it too");
    }
}

#[test]
fn an_agent_that_is_started_anew_is_recorded_from_its_first_number_and_the_rest_is_a_gap() {
    for recording in std::iter::once(own_recording()).chain(moldy()) {
        let observations = read_streams(&recording, "f").observations.len();
        let restart_at = observations / 2;
        let script = Script {
            restart_at: Some(restart_at),
            ..Script::at_speed(if observations > 1000 { 400.0 } else { 30.0 })
        };
        let expected = as_written(positions(&recording));
        let base = read_streams(&recording, "f")
            .observations
            .iter()
            .map(|o| o.sequence)
            .min()
            .expect("some");
        // After the restart the observation with the number base + restart_at has the number 1.
        let shift = base + restart_at as u64 - 1;
        let agent = Agent::start(&recording, script);
        let mut recorder = Recorder::into("record.txt");
        recorder.start(&agent.url());
        recorder.until(expected.last().expect("positions").1);
        let told = recorder.stop();
        assert_eq!(told["instance_ids"].as_array().map(Vec::len), Some(2), "{told}");
        let gaps = told["gaps"].as_array().expect("gaps").clone();
        assert_eq!(gaps.len(), 1, "{told}");
        assert_eq!(
            (&gaps[0]["cause"], &gaps[0]["to_sequence"]),
            (&"agent-restart".into(), &Json::Null)
        );
        let lost_from = gaps[0]["from_sequence"].as_u64().expect("a number");
        let mut had: Vec<_> = expected.iter().filter(|r| r.0 < lost_from || r.0 > shift).cloned().collect();
        had.iter_mut().filter(|r| r.0 > shift).for_each(|r| r.0 -= shift);
        assert_eq!(rows_of(&recorder.file), had);
        // The reader keeps the two starts apart.
        let bytes = std::fs::read(&recorder.file).expect("a recording");
        let track = mtconnect::read(&bytes, "f", &mtconnect::ReadOptions::default()).track;
        assert!(track.points.windows(2).all(|w| w[0].at <= w[1].at));
        assert!(track.gaps.iter().any(|g| g.cause == mtconnect::GapCause::Lost));
    }
}

#[test]
fn a_killed_recorder_goes_on_where_it_was_without_doubles_and_without_loss() {
    for recording in std::iter::once(own_recording()).chain(moldy()) {
        let expected = as_written(positions(&recording));
        let speed = if expected.len() > 1000 { 400.0 } else { 20.0 };
        let agent = Agent::start(&recording, Script::at_speed(speed));
        let mut recorder = Recorder::into("record.txt");
        for kill in 1..=5 {
            recorder.start(&agent.url());
            let wanted = expected[expected.len() * kill / 7].0;
            let began = Instant::now();
            while rows_of(&recorder.file).last().is_none_or(|r| r.0 < wanted) {
                assert!(began.elapsed() < Duration::from_secs(120), "{wanted} never came");
                std::thread::sleep(Duration::from_millis(3));
            }
            recorder.signal("KILL");
            let acknowledged = rows_of(&recorder.file);
            recorder.child.take().expect("it ran").wait().expect("an end");
            assert!(rows_of(&recorder.file).starts_with(&acknowledged));
            // As a power loss may leave it: half a line.
            let mut half = std::fs::OpenOptions::new()
                .append(true)
                .open(&recorder.file)
                .expect("the file");
            std::io::Write::write_all(&mut half, b"12.5 3").expect("written");
        }
        recorder.start(&agent.url());
        recorder.until(expected.last().expect("positions").1);
        recorder.stop();
        assert_eq!(rows_of(&recorder.file), expected);
    }
}

#[test]
fn a_full_disk_is_said_and_recording_goes_on_when_space_returns() {
    if !Command::new("prlimit")
        .arg("--version")
        .output()
        .is_ok_and(|o| o.status.success())
    {
        println!("skipped: no prlimit here; it is in the package util-linux");
        return;
    }
    let recording = own_recording();
    let expected = as_written(positions(&recording));
    // The agent forgets while the disk is full in the second round, and not in the first.
    for buffer in [131_072, 40] {
        let agent = Agent::start(
            &recording,
            Script {
                buffer,
                ..Script::at_speed(10.0)
            },
        );
        let mut recorder = Recorder::into("record.txt");
        // A file may have 2 KiB: more is refused by the system, as by a full disk.
        let command = recorder.command(&agent.url());
        let mut shell = Command::new("sh");
        shell.args(["-c", "trap '' XFSZ; ulimit -S -f 4; exec \"$0\" \"$@\""]);
        shell.arg(command.get_program()).args(command.get_args());
        shell.stdout(Stdio::piped()).stderr(Stdio::piped());
        recorder.child = Some(shell.spawn().expect("started"));
        let began = Instant::now();
        let last = expected.last().expect("positions").0;
        // Until the agent has told everything: its clock, not ours, says how long that is.
        while agent.next() <= last {
            assert!(began.elapsed() < Duration::from_secs(120));
            std::thread::sleep(Duration::from_millis(50));
        }
        assert!(
            rows_of(&recorder.file).last().is_some_and(|r| r.0 < last),
            "the disk was full"
        );
        let id = recorder.child.as_ref().expect("it runs").id().to_string();
        let freed = Command::new("prlimit")
            .args(["--pid", &id, "--fsize=unlimited:unlimited"])
            .status();
        assert!(freed.expect("prlimit is there").success());
        recorder.until(expected.last().expect("positions").1);
        let told = recorder.stop();
        assert!(told["disk_refusals"].as_u64() > Some(0), "{told}");
        let gaps = told["gaps"].as_array().expect("gaps").clone();
        let missing = |s: u64| {
            gaps.iter()
                .any(|g| g["from_sequence"].as_u64() <= Some(s) && Some(s) <= g["to_sequence"].as_u64())
        };
        let had: Vec<_> = expected.iter().filter(|r| !missing(r.0)).cloned().collect();
        assert_eq!(rows_of(&recorder.file), had, "{told}");
        assert_eq!(gaps.is_empty(), buffer > 1000, "{told}");
        assert!(gaps.iter().all(|g| g["cause"] == "not-stored"), "{told}");
    }
}

/// Samples, feed runs and rapid runs of a recording.
#[track_caller]
fn rebuilt(recording: &Path) -> (Json, Json, Json) {
    let folder = tempfile::tempdir().expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .args(["rebuild", "--no-plan", "--json", "--out"])
        .arg(folder.path().join("out.stpnc"))
        .arg(recording)
        .output()
        .expect("started");
    assert_eq!(output.status.code(), Some(0), "{}", both(&output));
    let told: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    (told["samples"].clone(), told["feed_runs"].clone(), told["rapid_runs"].clone())
}

#[test]
fn what_is_recorded_is_rebuilt_like_the_agents_own_document() {
    let folder = tempfile::tempdir().expect("a folder");
    for recording in std::iter::once(own_recording()).chain(moldy()) {
        let xml = folder.path().join("recording.xml");
        std::fs::write(&xml, &recording).expect("written");
        let last = positions(&recording).last().expect("positions").1;
        let agent = Agent::start(&recording, Script::at_speed(100_000.0));
        let mut recorder = Recorder::into("record.txt");
        recorder.start(&agent.url());
        recorder.until(last);
        recorder.stop();
        assert_eq!(rebuilt(&recorder.file), rebuilt(&xml));
        if recording.len() > 1_000_000 {
            assert_eq!(rebuilt(&xml), (11520.into(), 33.into(), 34.into()));
        }
    }
}

/// The last number that a Parquet recording in the making has on the disk.
fn last_kept(file: &Path) -> Option<u64> {
    let folder = PathBuf::from(format!("{}.recording", file.display()));
    let paths = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    let mut paths: Vec<PathBuf> = paths.filter(|p| p.extension().is_some_and(|e| e == "segment")).collect();
    paths.sort();
    let mut rows = paths.iter().filter_map(|p| store::segment::read(p).ok()).filter_map(|found| {
        let batch = found.batches().ok()?.flatten().last()?;
        store::observations::rows(&batch).ok()?.pop().map(|row| row.sequence)
    });
    rows.next_back()
}

/// Waits until something is true; two minutes are too long on any machine.
#[track_caller]
fn wait_until(what: &str, mut is_true: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_true() {
        assert!(began.elapsed() < Duration::from_secs(120), "{what} never came");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Waits until the agent has told everything, and a little longer for the recorder to hear of it: its own answer says what it has.
fn record_all_into_parquet(recorder: &mut Recorder, agent: &Agent, last: u64) -> Json {
    let asked = agent.requests().len();
    recorder.start(&agent.url());
    wait_until("a question", || agent.requests().len() > asked);
    wait_until("the last row", || last_kept(&recorder.file) == Some(last));
    recorder.stop()
}

#[test]
fn a_parquet_recording_holds_every_observation_and_is_rebuilt_like_the_agents_own_document() {
    for recording in std::iter::once(own_recording()).chain(moldy()) {
        let all = read_streams(&recording, "f").observations;
        let last = all.iter().map(|o| o.sequence).max().expect("some");
        let agent = Agent::start(&recording, Script::at_speed(1000.0));
        let mut recorder = Recorder::into("record.parquet");
        let told = record_all_into_parquet(&mut recorder, &agent, last);
        assert_eq!(told["observations"].as_u64(), Some(all.len() as u64));
        let (had, rows, gaps) = table_of(&recorder.file);
        assert_eq!((had, rows, gaps), (positions(&recording), all.len(), vec![]));
        let xml = recorder.folder.path().join("recording.xml");
        std::fs::write(&xml, &recording).expect("written");
        assert_eq!(rebuilt(&recorder.file), rebuilt(&xml));
    }
}

#[test]
fn a_killed_recorder_of_parquet_goes_on_where_it_was() {
    let recording = own_recording();
    let all = read_streams(&recording, "f").observations;
    let last = all.iter().map(|o| o.sequence).max().expect("some");
    let agent = Agent::start(
        &recording,
        Script {
            restart_at: None,
            ..Script::at_speed(20.0)
        },
    );
    let mut recorder = Recorder::into("record.parquet");
    for kill in 1..=4 {
        recorder.start(&agent.url());
        while agent.next() < last * kill / 6 {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Anywhere in its work.
        std::thread::sleep(Duration::from_millis(100 * kill));
        recorder.signal("KILL");
        recorder.child.take().expect("it ran").wait().expect("an end");
    }
    record_all_into_parquet(&mut recorder, &agent, last);
    let (had, rows, gaps) = table_of(&recorder.file);
    assert_eq!((had, rows, gaps), (positions(&recording), all.len(), vec![]));
    let again = recorder.command(&agent.url()).output().expect("started");
    assert_eq!(
        again.status.code(),
        Some(2),
        "a closed recording is left alone: {}",
        both(&again)
    );
}

#[test]
fn a_parquet_recording_on_a_full_disk_goes_on_with_a_gap_and_can_be_closed_later() {
    if !SmallDisk::is_possible() {
        return;
    }
    let recording = own_recording();
    let all = read_streams(&recording, "f").observations;
    let mut numbers: Vec<u64> = all.iter().map(|o| o.sequence).collect();
    numbers.sort_unstable();
    let last = *numbers.last().expect("some");
    let agent = Agent::start(
        &recording,
        Script {
            buffer: 30,
            ..Script::at_speed(10.0)
        },
    );
    let mut recorder = Recorder::into("record.parquet");
    let words = |url: &str, data: &Path| {
        let file = data.join("record.parquet").display().to_string();
        let words = [
            "record",
            url,
            "--json",
            "--interval",
            "10",
            "--heartbeat",
            "1000",
            "--out",
            &file,
        ];
        words.map(String::from).to_vec()
    };
    let url = agent.url();
    let (mut disk, child) = SmallDisk::start(|data| words(&url, data), recorder.folder.path());
    recorder.child = Some(child);
    let file = disk.data().join("record.parquet");
    wait_until("the first rows", || last_kept(&file) >= Some(numbers[40]));
    disk.fill();
    wait_until("two thirds", || agent.next() > numbers[numbers.len() / 2]);
    let acknowledged = last_kept(&file);
    wait_until("the agent's end", || agent.next() > last);
    assert_eq!(last_kept(&file), acknowledged, "nothing is acknowledged on a full disk");
    disk.free();
    wait_until("the last row", || last_kept(&file) == Some(last));

    // Closing makes the file out of its parts, and there is no room for both now.
    disk.fill();
    let stopped = Command::new("kill").args(["-TERM", &disk.id.to_string()]).status();
    assert!(stopped.expect("kill is there").success());
    let output = recorder.child.take().expect("it ran").wait_with_output().expect("an end");
    assert_eq!(output.status.code(), Some(4), "{}", both(&output));
    let said = String::from_utf8_lossy(&output.stderr);
    let expected = [
        "nothing is kept any more",
        "recording goes on",
        "No space left",
        "record.parquet.recording",
    ];
    assert!(expected.iter().all(|word| said.contains(word)), "{said}");
    assert!(!recorder.file.exists());

    // What was copied off the disk is closed by the same command where there is room.
    let told = record_all_into_parquet(&mut recorder, &agent, last);
    let table = store::Table::open(&recorder.file).expect("a table of ours");
    let (mut had, mut gaps) = (vec![], vec![]);
    for batch in table.batches().expect("rows") {
        for row in store::observations::rows(&batch.expect("rows")).expect("observations") {
            if row.texts[9] == store::observations::GAP {
                let end: Json = serde_json::from_str(row.text.as_deref().expect("its end")).expect("JSON");
                gaps.push((row.sequence, end["to_sequence"].as_u64().expect("a number")));
            } else {
                had.push(row.sequence);
            }
        }
    }
    let [(from, to)] = gaps[..] else { panic!("{gaps:?} {told}") };
    assert_eq!(Some(from - 1), acknowledged);
    let expected: Vec<u64> = numbers.into_iter().filter(|&n| n < from || n > to).collect();
    assert_eq!(had, expected);
}

#[test]
fn a_sample_query_is_taken_apart_and_the_agents_numbers_are_kept() {
    let recording = own_recording();
    let agent = Agent::start(&recording, Script::at_speed(100_000.0));
    agent.begin();
    let mut recorder = Recorder::into("record.txt");
    recorder.start(&format!(
        "{}/sample?from=300?count=10&path=//DataItem[@type=\\\"PATH_POSITION\\\"]\"",
        agent.url()
    ));
    let expected = as_written(positions(&recording));
    recorder.until(expected.last().expect("positions").1);
    recorder.stop();
    let had: Vec<_> = expected.into_iter().filter(|r| r.0 >= 300).collect();
    assert_eq!(rows_of(&recorder.file), had);
    let asked = agent.requests();
    let wanted = "/sample?path=//DataItem%5B@type=%22PATH_POSITION%22%5D&from=300&count=10&interval=10&heartbeat=1000";
    assert!(asked.iter().any(|r| r == wanted), "{asked:?}");
}

/// Ends with this exit code and these words.
#[track_caller]
fn check_refused(words: &[&str], exit: i32, said: &[&str]) {
    let folder = tempfile::tempdir().expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
        .arg("record")
        .args(words)
        .current_dir(folder.path())
        .output()
        .expect("started");
    let text = both(&output);
    assert_eq!(output.status.code(), Some(exit), "{words:?}: {text}");
    for word in said {
        assert!(text.contains(word), "{words:?} should say {word:?}: {text}");
    }
}

#[test]
fn what_cannot_be_recorded_is_said_with_the_right_exit_code() {
    let recording = own_recording();
    let agent = Agent::start(&recording, Script::at_speed(100_000.0));
    let url = agent.url();
    check_refused(&["https://127.0.0.1:1", "--out", "a.txt"], 2, &["https is not supported yet"]);
    check_refused(&["ftp://127.0.0.1", "--out", "a.txt"], 2, &["http:// was expected"]);
    check_refused(&[&url, "--out", "a.pdf"], 2, &[".txt", ".parquet"]);
    check_refused(&[&url, "--out", "a.txt", "--duration", "0"], 2, &["--duration 0"]);
    check_refused(&[&format!("{url}/nowhere"), "--out", "a.txt"], 2, &["INVALID_URI"]);
    check_refused(
        &[&url, "--out", "a.txt", "--from", "999999"],
        2,
        &["999999 does not exist yet"],
    );
    check_refused(&[&url, "--out", "missing/a.txt"], 4, &["missing/a.txt"]);
    // Nobody listens on a port that was just given back.
    let free = std::net::TcpListener::bind("127.0.0.1:0")
        .expect("a port")
        .local_addr()
        .expect("an address")
        .port();
    check_refused(
        &[&format!("http://127.0.0.1:{free}"), "--out", "a.txt", "--duration", "1"],
        4,
        &["no agent was reached"],
    );
    // Somebody else listens.
    let other = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = other.local_addr().expect("an address").port();
    std::thread::spawn(move || {
        for mut stream in other.incoming().flatten() {
            let _ = std::io::Write::write_all(&mut stream, b"SSH-2.0-OpenSSH_9.2\r\n");
        }
    });
    check_refused(&[&format!("http://127.0.0.1:{port}"), "--out", "a.txt"], 3, &["SSH-2.0"]);
}

#[test]
fn a_file_that_is_no_recording_of_this_agent_is_left_alone() {
    let recording = own_recording();
    let agent = Agent::start(&recording, Script::at_speed(100_000.0));
    let folder = tempfile::tempdir().expect("a folder");
    for (text, word) in [
        ("a letter\n", "no text recording of ours"),
        (
            "# toolmark recording units=mm frame=unknown start=2026-01-01T00:00:00Z source=agent other:5000\n1 2 3 0 1\n",
            "agent other:5000",
        ),
    ] {
        let file = folder.path().join("a.txt");
        std::fs::write(&file, text).expect("written");
        check_refused(&[&agent.url(), "--out", &file.display().to_string()], 2, &["a.txt:1:1", word]);
        assert_eq!(std::fs::read_to_string(&file).expect("it is there"), text);
    }
}

//! The process is killed at random moments of recording, compacting and cataloguing: every acknowledged row is there exactly once, in
//! order, with its readings, and so are the gaps.
//!
//! The child is this test program itself, started again with a data directory in its environment.

use ledger::{Chain, Hash};
use machine::Sample;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use store::record::{Header, Reader, SampleRows};
use store::segment::{Gap, Pace, Recorder, Settings};
use store::{DataDirectory, Ending, JobId, NewJob};
use units::{Tick, Timestamp};

const DIRECTORY: &str = "STORE_TEST_KILLED_RECORDING";
const START: Timestamp = Timestamp(1_795_132_800_000_000_000);
/// Every job is this long; with segments of 3000 rows, several of them.
const ROWS: u64 = 20_000;

fn sample(job: i64, tick: u64) -> Sample {
    Sample {
        tick: Tick(tick),
        actual: [tick as f64 * 0.013, (tick % 17) as f64, job as f64],
        ..Sample::default()
    }
}

/// Ticks that the source never gives: what a full ring loses, at known places.
fn is_missing(tick: u64) -> bool {
    tick % 5000 >= 4990
}

/// The child: jobs without end; what is acknowledged is told on standard output.
#[test]
fn recording_child() {
    let Ok(path) = std::env::var(DIRECTORY) else {
        return; // run as an ordinary test it has nothing to do
    };
    let mut directory = DataDirectory::open(Path::new(&path), "the child").expect("the killed one's lock is free");
    for found in directory.recover_interrupted().expect("recovers").interrupted {
        assert_eq!(found.not_recovered, None);
        directory.end_job(found.job.id, START, Ending::Interrupted).expect("ends");
    }
    let settings = Settings {
        ring: 500,
        interval: Duration::from_millis(2),
        segment_rows: 3000,
        ..Settings::new(Pace::Simulated)
    };
    let mut dice = ChaCha8Rng::seed_from_u64(u64::from(std::process::id()));
    loop {
        let new = NewJob {
            program: "part.nc",
            program_hash: Hash::of(b"part"),
            machine: "sim-mill",
            seed: 1,
            start: START,
            folder: None,
            who: "the child",
        };
        let job = directory.begin_job(&new).expect("begins");
        let header = Header {
            machine: "sim-mill".into(),
            simulated: true,
            start: START,
            seed: 1,
        };
        let target = job.folder.join("record.parquet");
        let rows = SampleRows::new(START, &target);
        let mut recorder =
            Recorder::begin(&directory.recording_folder(job.id), rows, header.metadata(), &settings).expect("begun");
        let watch = recorder.watch();
        let mut chain = Chain::default();
        for tick in 0..ROWS {
            if is_missing(tick) {
                if !is_missing(tick + 1) {
                    recorder.source_gap(tick - 9, tick);
                }
                continue;
            }
            let _ = recorder.offer(&sample(job.id.0, tick));
            if tick % 100 == 0 {
                println!("\nrows {} {}", job.id, watch.acknowledged());
                if dice.next_u32() % 4 == 0 {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            if tick % 1000 == 0 {
                let event = chain.append(
                    START.at(Tick(tick)),
                    "step",
                    BTreeMap::from([("step".to_owned(), tick.into())]),
                );
                directory.append_job_events(job.id, &[event]).expect("kept");
            }
        }
        let ended = recorder.end().expect("ended");
        println!("\nrows {} {}", job.id, ended.health.acknowledged);
        let events = directory.events(store::Log::Job(job.id), 1, 1000).expect("reads");
        directory.keep_recording(job.id, &target, &events, START).expect("kept");
        directory.end_job(job.id, START, Ending::Done).expect("ends");
    }
}

/// Rows that the killed child had been told were safe, by job.
fn run_and_kill(directory: &Path, after: Duration) -> BTreeMap<i64, u64> {
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "recording_child", "--nocapture", "--test-threads=1"])
        .env(DIRECTORY, directory)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    // A pipe holds 64 KiB: somebody has to read while it runs.
    let mut out = child.stdout.take().expect("piped");
    let reading = std::thread::spawn(move || {
        let mut said = String::new();
        out.read_to_string(&mut said).expect("reads");
        said
    });
    std::thread::sleep(after);
    assert!(
        child.try_wait().expect("asks").is_none(),
        "the child ended by itself: it failed"
    );
    child.kill().expect("killed"); // SIGKILL on Unix
    child.wait().expect("gone");
    let said = reading.join().expect("read");
    // A line that was cut was not said.
    let whole = &said[..said.rfind('\n').map_or(0, |n| n + 1)];
    let mut acknowledged = BTreeMap::new();
    for line in whole.lines() {
        if let ["rows", job, rows] = line.split(' ').collect::<Vec<_>>()[..] {
            acknowledged.insert(job.parse().expect("a job"), rows.parse().expect("a number"));
        }
    }
    acknowledged
}

/// The record of a job: rows from the first on without a hole but the told ones, each with its readings. Gives their number.
#[track_caller]
fn check_record(path: &Path, job: JobId) -> u64 {
    let reader = Reader::open(path).expect("every catalogued record is whole");
    let mut wanted = (0..ROWS).filter(|tick| !is_missing(*tick));
    let (mut rows, mut last) = (0, 0);
    for row in reader.rows().expect("reads") {
        let row = row.expect("whole");
        assert_eq!(Some(row.tick.0), wanted.next(), "job {job}, row {rows}");
        let expected = sample(job.0, row.tick.0).actual.map(|x| (x * 1000.0).round() / 1000.0);
        assert_eq!(row.actual, Some(expected));
        (rows, last) = (rows + 1, row.tick.0);
    }
    let gaps: Vec<Gap> = serde_json::from_str(reader.metadata().get("toolmark.gaps").map_or("[]", String::as_str)).expect("gaps");
    for gap in &gaps {
        assert!((gap.from..=gap.to).all(is_missing) && gap.count == 10, "{gap}");
    }
    // A gap is told before the first row behind it.
    assert!(
        gaps.len() as u64 >= (last + 10) / 5000,
        "{} gaps up to tick {last}",
        gaps.len()
    );
    assert!(!reader.metadata().contains_key("toolmark.lost") || rows < ROWS);
    rows
}

#[test]
fn a_recording_killed_at_any_moment_has_every_acknowledged_row_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let times: u32 = std::env::var("KILLS").ok().and_then(|s| s.parse().ok()).unwrap_or(10);
    println!("SEED={seed} KILLS={times}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut whole, mut recovered, mut looked_at) = (0, 0, 0);
    let beside = tempfile::tempdir().expect("a folder");
    // On a busy machine the child may get nowhere in that time: a few more, with patience.
    for kill in 1..=times + 5 {
        if kill > times && whole > 0 && recovered > 0 {
            break;
        }
        let patience = if kill > times { 3000 } else { 0 };
        let after = Duration::from_millis(20 + patience + random.next_u64() % 500);
        let acknowledged = run_and_kill(folder.path(), after);

        // Half of the time the recovery is left to the next child, and may be killed as well.
        if random.next_u32() % 2 == 0 && kill < times {
            promised(&acknowledged, beside.path());
            continue;
        }
        let mut directory = DataDirectory::open(folder.path(), "the test").expect("the killed one's lock is free");
        let left = directory.recover_interrupted().expect("recovers");
        assert!(left.of_jobs_over.is_empty());
        for found in &left.interrupted {
            assert_eq!(found.not_recovered, None);
            println!("  {found}");
            let job = found.job.id;
            recovered += usize::from(found.recovery.as_ref().is_some_and(|r| r.rows > 0));
            directory.end_job(job, START, Ending::Interrupted).expect("ends");
        }
        promised(&acknowledged, beside.path());
        let mut of_job = BTreeMap::new();
        for row in directory.records().expect("reads") {
            assert_eq!(
                of_job.insert(row.job, row.sequence),
                None,
                "job {} is catalogued twice",
                row.job
            );
            if row.sequence > looked_at {
                assert_eq!(check_record(&row.path, row.job), row.rows);
                whole += 1;
                let safe = read_promise(beside.path(), row.job.0);
                assert!(
                    row.rows >= safe,
                    "job {}: {safe} rows were acknowledged, {} are there",
                    row.job,
                    row.rows
                );
                looked_at = looked_at.max(row.sequence);
            }
        }
        for job in directory.jobs().expect("reads") {
            let safe = read_promise(beside.path(), job.id.0);
            assert!(
                safe == 0 || of_job.contains_key(&job.id),
                "job {}: {safe} rows were acknowledged, no record",
                job.id
            );
        }
        let segments: Vec<_> = std::fs::read_dir(directory.segments()).expect("reads").flatten().collect();
        assert!(segments.iter().all(|entry| entry.file_name() == "lost"), "{segments:?}");
        assert_eq!(directory.verify().expect("verifies"), []);
        println!("kill {kill} after {after:?}: {whole} records checked, {recovered} of them recovered");
    }
    assert!(
        whole > 0 && recovered > 0,
        "the child never got to anything: give it more time"
    );
}

/// What a child was told is kept in a folder of its own, so that it can be checked after later kills.
fn promised(acknowledged: &BTreeMap<i64, u64>, beside: &Path) {
    for (job, rows) in acknowledged {
        std::fs::write(beside.join(format!("promised-{job}")), rows.to_string()).expect("written");
    }
}

fn read_promise(beside: &Path, job: i64) -> u64 {
    let text = std::fs::read_to_string(beside.join(format!("promised-{job}"))).unwrap_or_default();
    text.parse().unwrap_or(0)
}

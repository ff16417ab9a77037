//! The process is killed at random moments while it removes old rows: what is on hold stays, and nothing is half removed.
//!
//! The child is this test program itself, started again with a data directory in its environment.

use ledger::Hash;
use machine::Sample;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use store::record::{Header, Reader, Writer};
use store::{DataDirectory, Ending, JobId, NewJob, Of, Piece, Retained, Retention, Span};
use units::{Tick, Timestamp};

const DIRECTORY: &str = "STORE_TEST_KILLED_RETENTION";
const OLD: Timestamp = Timestamp(0);
const NOW: Timestamp = Timestamp(1_795_132_800_000_000_000);
const ROWS: u64 = 2000;

/// The child: makes old records, puts every third on hold, removes the others, without end; each told after it was acknowledged.
#[test]
fn child() {
    let Ok(path) = std::env::var(DIRECTORY) else {
        return; // run as an ordinary test it has nothing to do
    };
    let mut directory = DataDirectory::open(Path::new(&path), "the child").expect("the killed one's lock is free");
    for interrupted in directory.interrupted_jobs().expect("reads") {
        directory.end_job(interrupted.job.id, OLD, Ending::Interrupted).expect("ends");
    }
    loop {
        for n in 0..6 {
            let new = NewJob {
                program: "part.nc",
                program_hash: Hash::of(b"part"),
                machine: "sim-mill",
                seed: 1,
                start: OLD,
                folder: None,
                who: "the child",
            };
            let job = directory.begin_job(&new).expect("begins").id;
            let path = directory.record_path("sim-mill", OLD, job);
            let header = Header {
                machine: "sim-mill".into(),
                simulated: true,
                start: OLD,
                seed: 1,
            };
            let mut writer = Writer::create(&path, &header).expect("made");
            for tick in 0..ROWS {
                let sample = Sample {
                    tick: Tick(tick),
                    actual: [tick as f64 * 0.013, 0.0, 0.0],
                    ..Sample::default()
                };
                writer.write(&sample).expect("written");
            }
            let finished = writer.finish(&[]).expect("finished");
            directory.catalogue(job, &finished, OLD).expect("catalogued");
            directory.end_job(job, OLD, Ending::Done).expect("ends");
            if n % 3 == 0 {
                directory.hold_job(job, "the child", "it is to be kept", NOW).expect("held");
                println!("\nheld {job}");
            }
        }
        for removal in directory.retain(&Retention::default(), NOW).expect("retained").removed {
            println!("\nremoved {}", removal.record.job);
        }
    }
}

/// Jobs that were told as held, and as removed.
fn run_and_kill(directory: &Path, after: Duration) -> [BTreeSet<i64>; 2] {
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "child", "--nocapture", "--test-threads=1"])
        .env(DIRECTORY, directory)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    std::thread::sleep(after);
    assert!(
        child.try_wait().expect("asks").is_none(),
        "the child ended by itself: it failed"
    );
    child.kill().expect("killed"); // SIGKILL on Unix
    child.wait().expect("gone");
    let mut said = String::new();
    child.stdout.take().expect("piped").read_to_string(&mut said).expect("reads");
    // A line that was cut was not said.
    let whole = &said[..said.rfind('\n').map_or(0, |n| n + 1)];
    let jobs = |word: &str| {
        let named = whole.lines().filter_map(|line| line.strip_prefix(word));
        named.map(|job| job.trim().parse().expect("a job")).collect()
    };
    [jobs("held "), jobs("removed ")]
}

/// Rows of a job: those that are there, and those of which only the sum is left.
fn count(directory: &DataDirectory, job: JobId) -> (u64, u64) {
    let mut found = (0, 0);
    let pieces = directory.range(Of::Job(job), Span::ALL, &["X.POSITION.ACTUAL"]);
    for piece in pieces.expect("begun") {
        match piece.expect("whole") {
            Piece::Rows(rows) => found.0 += rows.len() as u64,
            Piece::RolledUp(bucket) => found.1 += bucket.rows,
        }
    }
    found
}

fn check(path: &Path, held: &BTreeSet<i64>, removed: &BTreeSet<i64>) {
    let mut directory = DataDirectory::open(path, "the test").expect("the killed one's lock is free");
    for found in directory.interrupted_jobs().expect("reads") {
        for unfinished in &found.unfinished {
            std::fs::remove_file(unfinished).expect("removed");
        }
        if let Some(record) = &found.uncatalogued {
            let finished = Reader::open(record).and_then(|r| r.finished());
            let finished = finished.expect("a record with its name is whole");
            directory.catalogue(found.job.id, &finished, OLD).expect("catalogued");
        }
        directory.end_job(found.job.id, OLD, Ending::Interrupted).expect("ends");
    }
    assert_eq!(directory.verify().expect("verifies"), []);
    let told: BTreeSet<i64> = directory.removals().expect("reads").iter().map(|r| r.record.job.0).collect();
    assert!(told.is_superset(removed), "a removal that was told is in the log");
    for record in directory.records().expect("reads") {
        let (there, rest) = count(&directory, record.job);
        if held.contains(&record.job.0) {
            assert_eq!((there, rest), (ROWS, 0), "job {} is on hold", record.job);
            assert!(Reader::open(&record.path).is_ok());
        } else {
            assert!(
                (there, rest) == (ROWS, 0) || (there, rest) == (0, ROWS),
                "job {} has {there} rows and sums of {rest}",
                record.job
            );
        }
        if told.contains(&record.job.0) {
            assert!(!record.path.exists());
        }
    }
    // What was begun is ended, once.
    directory.retain(&Retention::default(), NOW).expect("goes on");
    assert_eq!(
        directory.retain(&Retention::default(), NOW).expect("nothing left"),
        Retained::default()
    );
    assert_eq!(directory.verify().expect("verifies"), []);
    let on_hold: BTreeSet<i64> = directory.holds().expect("reads").iter().map(|h| h.job.0).collect();
    assert!(on_hold.is_superset(held), "a hold that was told is kept");
    for record in directory.records().expect("reads") {
        assert_eq!(record.path.exists(), on_hold.contains(&record.job.0));
    }
}

#[test]
fn a_process_killed_while_it_removes_old_rows_leaves_nothing_half_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let times: u32 = std::env::var("KILLS").ok().and_then(|s| s.parse().ok()).unwrap_or(10);
    println!("SEED={seed} KILLS={times}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut held, mut removed) = (BTreeSet::new(), BTreeSet::new());
    // On a busy machine the child may get nowhere in that time: a few more, with patience.
    for kill in 1..=times + 5 {
        if kill > times && !held.is_empty() && !removed.is_empty() {
            break;
        }
        let patience = if kill > times { 3000 } else { 0 };
        let after = Duration::from_millis(20 + patience + random.next_u64() % 600);
        let [more_held, more_removed] = run_and_kill(folder.path(), after);
        println!(
            "kill {kill} after {after:?}: {} put on hold, {} removed",
            more_held.len(),
            more_removed.len()
        );
        held.extend(more_held);
        removed.extend(more_removed);
        check(folder.path(), &held, &removed);
    }
    assert!(
        !held.is_empty() && !removed.is_empty(),
        "the child never got to anything: give it more time"
    );
}

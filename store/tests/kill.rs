//! The process is killed at random moments; what it had acknowledged is there exactly once, and nothing half-made is referred to.
//!
//! The child is this test program itself, started again with a data directory in its environment.

use ledger::{Chain, ChangeRequest, Event, Hash};
use machine::Sample;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use store::record::{Header, Reader, Writer};
use store::{DataDirectory, Ending, Log, NewJob};
use units::{Tick, Timestamp};

const DIRECTORY: &str = "STORE_TEST_KILLED_CHILD";
const REGISTER: &str = "sim-mill/tool/5/wear/x_mm";
const START: Timestamp = Timestamp(1_795_132_800_000_000_000);

/// The child: changes, events and records without end, each told on standard output after it was acknowledged.
#[test]
fn child() {
    let Ok(path) = std::env::var(DIRECTORY) else {
        return; // run as an ordinary test it has nothing to do
    };
    let mut directory = DataDirectory::open(Path::new(&path), "the child").expect("the killed one's lock is free");
    for interrupted in directory.interrupted_jobs().expect("reads") {
        directory
            .end_job(interrupted.job.id, START, Ending::Interrupted)
            .expect("ends");
    }
    loop {
        let job = directory
            .begin_job(&NewJob {
                program: "part.nc",
                program_hash: Hash::of(b"part"),
                machine: "sim-mill",
                seed: 1,
                start: START,
                folder: None,
                who: "the child",
            })
            .expect("begins")
            .id;
        println!("\njob {job}");
        let mut chain = Chain::default();
        for n in 1..=5 {
            let before = directory.value(REGISTER).expect("reads");
            let to = before.unwrap_or(0.0) + 1.0;
            directory
                .change_value(&ChangeRequest {
                    path: REGISTER.into(),
                    to,
                    expected: before,
                    who: "the child".into(),
                    why: "one more".into(),
                    when: START,
                })
                .expect("changed");
            println!("\nchange {to}");
            let event = chain.append(START, "step", BTreeMap::from([("step".to_owned(), n.into())]));
            directory.append_job_events(job, &[event]).expect("kept");
            println!("\nevent {job} {n}");
        }
        let path = directory.record_path("sim-mill", START, job);
        let header = Header {
            machine: "sim-mill".into(),
            simulated: true,
            start: START,
            seed: 1,
        };
        let mut writer = Writer::create(&path, &header).expect("made");
        for tick in 0..10_000 {
            let sample = Sample {
                tick: Tick(tick),
                actual: [tick as f64 * 0.013, (tick % 17) as f64, 0.0],
                ..Sample::default()
            };
            writer.write(&sample).expect("written");
        }
        let finished = writer
            .finish(&directory.events(Log::Job(job), 1, 100).expect("reads"))
            .expect("finished");
        directory.catalogue(job, &finished, START).expect("catalogued");
        println!("\nrecord {}", path.display());
        directory.end_job(job, START, Ending::Done).expect("ends");
    }
}

/// What the killed child had been told was safe.
#[derive(Default, Debug)]
struct Acknowledged {
    value: f64,
    events: Vec<(i64, u64)>,
    records: Vec<String>,
}

fn run_and_kill(directory: &Path, after: Duration) -> Acknowledged {
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
    let mut acknowledged = Acknowledged::default();
    // A line that was cut was not said.
    let whole = &said[..said.rfind('\n').map_or(0, |n| n + 1)];
    for line in whole.lines() {
        let words: Vec<&str> = line.splitn(3, ' ').collect();
        match words.as_slice() {
            ["change", value] => acknowledged.value = value.parse().expect("a number"),
            ["event", job, n] => acknowledged
                .events
                .push((job.parse().expect("a job"), n.parse().expect("a number"))),
            ["record", path] => acknowledged.records.push((*path).to_owned()),
            _ => {}
        }
    }
    acknowledged
}

fn check(path: &Path, acknowledged: &Acknowledged, value_before: f64) -> f64 {
    let mut directory = DataDirectory::open(path, "the test").expect("the killed one's lock is free");

    // Exactly once: the value is the last acknowledged one, or the one that was on its way; and there is one event for each step of it.
    let value = directory.value(REGISTER).expect("reads").unwrap_or(0.0);
    let promised = acknowledged.value.max(value_before);
    assert!(
        value == promised || value == promised + 1.0,
        "{value} after {promised} was acknowledged"
    );
    let changes: Vec<Event> = directory
        .events(Log::Directory, 1, usize::MAX)
        .expect("reads")
        .into_iter()
        .filter(|e| e.kind == "change")
        .collect();
    let after: Vec<f64> = changes.iter().filter_map(|e| e.detail["after"].as_f64()).collect();
    assert_eq!(after, (1..=value as u64).map(|n| n as f64).collect::<Vec<_>>());

    for (job, n) in &acknowledged.events {
        let kept = directory.events(Log::Job(store::JobId(*job)), *n, 1).expect("reads");
        assert_eq!(
            kept.first().map(|e| e.sequence),
            Some(*n),
            "event {n} of job {job} was acknowledged"
        );
    }
    let catalogued: Vec<String> = directory
        .records()
        .expect("reads")
        .iter()
        .map(|r| r.path.display().to_string())
        .collect();
    for record in &acknowledged.records {
        assert!(catalogued.contains(record), "{record} was acknowledged");
    }
    for record in &catalogued {
        let reader = Reader::open(Path::new(record)).expect("every catalogued record is whole");
        assert_eq!(reader.rows().expect("reads").filter(Result::is_ok).count(), 10_000);
        assert_eq!(reader.events().expect("whole").len(), 5);
    }

    // One job at most was on its way. Its record may have got its name and not its row; that can be put right.
    let interrupted = directory.interrupted_jobs().expect("reads");
    assert!(interrupted.len() <= 1);
    for found in &interrupted {
        for unfinished in &found.unfinished {
            // Killed between the sync and the new name, all of it is there; else it is refused. Nothing refers to it either way.
            match Reader::open(unfinished) {
                Ok(whole) => assert_eq!(whole.len(), 10_000),
                Err(refused) => assert_eq!(refused.exit_code(), 3, "{refused}"),
            }
            std::fs::remove_file(unfinished).expect("removed");
        }
        if let Some(record) = &found.uncatalogued {
            let finished = Reader::open(record)
                .and_then(|r| r.finished())
                .expect("a record with its name is whole");
            directory.catalogue(found.job.id, &finished, START).expect("catalogued");
        }
        println!("  {found}");
    }
    assert_eq!(directory.verify().expect("verifies"), []);
    value
}

#[test]
fn a_process_killed_at_any_moment_loses_nothing_it_acknowledged() {
    let folder = tempfile::tempdir().expect("a folder");
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let times: u32 = std::env::var("KILLS").ok().and_then(|s| s.parse().ok()).unwrap_or(10);
    println!("SEED={seed} KILLS={times}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut value, mut records): (f64, usize) = (0.0, 0);
    // On a busy machine the child may get nowhere in that time: a few more, with patience.
    for kill in 1..=times + 5 {
        if kill > times && records > 0 {
            break;
        }
        let patience = if kill > times { 3000 } else { 0 };
        let after = Duration::from_millis(20 + patience + random.next_u64() % 400);
        let acknowledged = run_and_kill(folder.path(), after);
        records += acknowledged.records.len();
        println!(
            "kill {kill} after {after:?}: acknowledged {} and {} records",
            acknowledged.value,
            acknowledged.records.len()
        );
        value = check(folder.path(), &acknowledged, value);
    }
    assert!(
        value > 0.0 && records > 0,
        "the child never got to anything: give it more time"
    );
}

//! The process is killed between any two writes of an offset change: the change is there once or not at all, and the log says which.
//!
//! The child is this test program itself, started again with a data directory and the write after which it waits to be killed.

use ledger::{ChangeRequest, Event};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use store::sizing::{NewSize, SizingJob, Written};
use store::{DataDirectory, Log};
use units::Timestamp;

const DIRECTORY: &str = "STORE_TEST_KILLED_SIZING";
const POINT: &str = "STORE_TEST_KILLED_AFTER";
const REGISTER: &str = "sim-lathe/tool/5/wear/x_mm";
const AT: Timestamp = Timestamp(1_795_132_800_000_000_000);
const WAITING: &str = "waiting to be killed";

/// One entry that moves the register by -0.001 from wherever it is.
fn enter(directory: &mut DataDirectory, job: u64, written: &mut dyn FnMut(Written)) {
    let before = directory.value(REGISTER).expect("reads");
    let change = ChangeRequest {
        path: REGISTER.into(),
        to: before.unwrap_or(0.0) - 0.001,
        expected: before,
        who: "the child".into(),
        why: "measured".into(),
        when: AT,
    };
    let entry = NewSize {
        job,
        kind: "size-entered",
        at: AT,
        detail: BTreeMap::from([("dimension".to_owned(), Value::from("DIM A"))]),
        change: Some(&change),
    };
    directory.keep_size(&entry, written).expect("kept");
}

fn job(directory: &mut DataDirectory) -> u64 {
    if let Some(job) = directory.sizing_job(None).expect("reads") {
        return job.id;
    }
    let new = SizingJob {
        id: 0,
        machine: "sim-lathe".into(),
        diameters: "x".into(),
        name: "SHAFT".into(),
        text: String::new(),
    };
    directory.load_sizing_job(&new, "the child", AT).expect("kept").id
}

/// The child: one entry, and a halt after the write that it was told.
#[test]
fn child() {
    let (Ok(path), Ok(point)) = (std::env::var(DIRECTORY), std::env::var(POINT)) else {
        return; // run as an ordinary test it has nothing to do
    };
    let point: usize = point.parse().expect("a number");
    let mut directory = DataDirectory::open(Path::new(&path), "the child").expect("the killed one's lock is free");
    let job = job(&mut directory);
    enter(&mut directory, job, &mut |written| {
        if written == Written::ALL[point] {
            println!("\n{WAITING}");
            loop {
                std::thread::park();
            }
        }
    });
}

/// Starts the child and kills it where it waits.
fn kill_after(directory: &Path, point: usize) {
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "child", "--nocapture", "--test-threads=1"])
        .env(DIRECTORY, directory)
        .env(POINT, point.to_string())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let said = BufReader::new(child.stdout.take().expect("piped"));
    let waits = said.lines().map_while(Result::ok).any(|line| line == WAITING);
    assert!(waits, "the child ended before it came to write {point}");
    child.kill().expect("killed"); // SIGKILL on Unix
    child.wait().expect("gone");
}

fn of_kind(directory: &DataDirectory, kind: &str) -> Vec<Event> {
    let all = directory.events(Log::Directory, 1, usize::MAX).expect("reads");
    all.into_iter().filter(|e| e.kind == kind).collect()
}

#[test]
fn killed_between_any_two_writes_a_change_is_applied_once_or_not_at_all_and_the_log_says_which() {
    let rounds: usize = std::env::var("KILLS").ok().and_then(|s| s.parse().ok()).unwrap_or(10);
    println!("KILLS={rounds}, at each of {} writes", Written::ALL.len());
    for round in 0..rounds {
        let folder = tempfile::tempdir().expect("a folder");
        let mut applied = 0;
        // Every point after every other: what one leaves behind is what the next begins with.
        for k in 0..Written::ALL.len() {
            let point = (k + round) % Written::ALL.len();
            kill_after(folder.path(), point);
            let mut directory = DataDirectory::open(folder.path(), "the test").expect("the killed one's lock is free");
            // Only what was committed counts.
            applied += usize::from(Written::ALL[point] == Written::Committed);
            let (changes, entries) = (of_kind(&directory, "change"), of_kind(&directory, "size-entered"));
            let place = format!("round {round}, killed after {:?}", Written::ALL[point]);
            assert_eq!((changes.len(), entries.len()), (applied, applied), "{place}");
            let value = directory.value(REGISTER).expect("reads").unwrap_or(0.0);
            assert!((value + 0.001 * applied as f64).abs() < 1e-12, "{place}: {value}");
            for (change, entry) in changes.iter().zip(&entries) {
                assert_eq!(entry.detail["change"], change.sequence, "{place}");
            }
            let job = job(&mut directory);
            assert_eq!(directory.sizes(job).expect("reads"), entries, "{place}");
            assert_eq!(directory.verify().expect("verifies"), [], "{place}");
            // The person sees that it is not there and enters it again: then it is there once more.
            enter(&mut directory, job, &mut |_| {});
            applied += 1;
        }
    }
}

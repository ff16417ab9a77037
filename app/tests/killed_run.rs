//! A run that is killed in the middle: the next command says which job it was and where, and its acknowledged rows are a record.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use store::record::Reader;
use store::{DataDirectory, Ending, JobState, Log};
use units::StepId;

fn command(args: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
    command.args(args).env("TOOLMARK_DATA", data);
    command
}

fn words(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

#[test]
fn the_next_command_says_where_a_killed_run_was_and_its_acknowledged_rows_are_kept() {
    let (data, out) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let bracket = format!("{}/../corpus/bracket.stpnc", env!("CARGO_MANIFEST_DIR"));
    let dir = out.path().display().to_string();
    // In real time it takes most of a minute; it is killed when some seconds of it are on disk.
    let run = ["run", &bracket, "--out", &dir, "--start", "2026-11-20T08:00:00Z"];
    let mut killed = command(&run, data.path())
        .stdout(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let segment = data.path().join("segments/job-000001/0001.segment");
    let rows_on_disk = || store::segment::read(&segment).map_or(0, |found| found.rows);
    let begun = (0..1200).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        rows_on_disk() > 3000
    });
    killed.kill().expect("it runs"); // SIGKILL on Unix
    killed.wait().expect("it ends");
    assert!(begun, "some seconds of the run came to the disk");
    let whole = rows_on_disk();

    let plate = format!("{}/../corpus/plate.nc", env!("CARGO_MANIFEST_DIR"));
    let second = tempfile::tempdir().expect("a folder");
    let next = ["run", &plate, "--fast", "--out", &second.path().display().to_string()];
    let next = command(&next, data.path()).output().expect("the binary starts");
    let said = words(&next);
    println!(
        "{}",
        said.lines().find(|line| line.starts_with("notice:")).unwrap_or_default()
    );
    let expected = "notice: job 1 (bracket.stpnc on sim-mill), started 2026-11-20T08:00:00Z, was interrupted at step ";
    assert!(said.contains(expected), "{said}");
    assert!(said.contains(&format!("; {whole} rows up to 2026-11-20T08:00:0")), "{said}");
    assert!(
        !out.path().join("record.parquet").exists(),
        "an interrupted run has no report and no record of a whole run"
    );

    let directory = DataDirectory::open(data.path(), "the test").expect("free");
    let job = &directory.jobs().expect("reads")[0];
    assert_eq!(job.state, JobState::Over(Ending::Interrupted));
    let row = directory
        .records()
        .expect("reads")
        .into_iter()
        .find(|row| row.job == job.id)
        .expect("catalogued");
    assert_eq!(row.path, directory.record_path("sim-mill", job.start, job.id));
    let record = Reader::open(&row.path).expect("whole");
    assert_eq!((record.len(), row.rows), (whole, whole));
    let steps: Vec<StepId> = record.rows().expect("reads").map(|row| row.expect("whole").step).collect();
    assert!(steps.last() > Some(&StepId(0)), "it was in a step");
    assert_eq!(
        record.events().expect("whole"),
        directory.events(Log::Job(job.id), 1, 10_000).expect("reads")
    );
    let told = directory.events(Log::Directory, 1, 100).expect("reads");
    assert!(
        told.iter()
            .any(|event| event.kind == "recording-recovered" && event.detail["rows"] == whole)
    );
    assert_eq!(
        directory.segments().read_dir().expect("reads").count(),
        0,
        "nothing is left in the making"
    );
    assert_eq!(directory.verify().expect("verifies"), []);
}

//! Values that functions of a program recorded, when the run is killed: the next command keeps every one that was acknowledged.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use store::functions::{FILE, Recorded, read};
use store::{DataDirectory, Log};

fn command(args: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
    command.args(args).env("TOOLMARK_DATA", data);
    command
}

fn words(output: &Output) -> String {
    let text = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    text.concat()
}

fn rows_of(path: &Path) -> Vec<Recorded> {
    let mut rows = Vec::new();
    read(path, &mut |row| rows.push(row)).expect("readable");
    rows
}

const PROGRAM: &str = "O1\nG21 G90 G54\nT1 M6\nS3000 M3\nG0 X0 Y0\nG43 H1 Z5.\n\
    (trace:1 start_sensor_recording its_function_id=1 its_sensors=LOAD,POSITION.ACTUAL its_axes=X,Y its_sampling=2)\n\
    G1 X40. F300.\nX0\nX40.\nX0\nX40.\nX0\nM30\n";

#[test]
fn values_of_a_killed_run_are_kept_up_to_the_last_acknowledged_one() {
    let (data, out) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let program = out.path().join("traced.nc").display().to_string();
    std::fs::write(&program, PROGRAM).expect("written");
    let whole = out.path().join("whole").display().to_string();
    let run = ["run", &program, "--start", "2026-11-20T08:00:00Z", "--out"];

    // What an earlier run of the same program left in the folder is evidence, and stays.
    let told = command(&[&run[..], &[&whole, "--fast"]].concat(), data.path())
        .output()
        .expect("the binary starts");
    assert!(told.status.success(), "{}", words(&told));
    let complete = rows_of(&Path::new(&whole).join(FILE));
    let before = std::fs::read(Path::new(&whole).join(FILE)).expect("kept");

    // In real time it takes most of a minute.
    let mut killed = command(&[&run[..], &[&whole]].concat(), data.path())
        .stdout(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let segment = data.path().join("segments/job-000002/functions/0001.segment");
    let on_disk = || store::segment::read(&segment).map_or(0, |found| found.rows);
    let begun = (0..1200).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        on_disk() > 2000
    });
    killed.kill().expect("it runs"); // SIGKILL on Unix
    killed.wait().expect("it ends");
    assert!(begun, "a second of the recording came to the disk");
    let acknowledged = on_disk();

    let next = command(&["tool", "list"], data.path()).output().expect("the binary starts");
    let said = words(&next);
    // Looking recovers nothing; the next command that works here does.
    assert!(!said.contains("values of its functions"), "{said}");
    let next = command(&["run", &program, "--fast", "--out", &format!("{whole}-next")], data.path());
    let said = words(&{ next }.output().expect("the binary starts"));
    assert!(
        said.contains(&format!("; {acknowledged} values of its functions are kept as ")),
        "{said}"
    );

    let directory = DataDirectory::open(data.path(), "the test").expect("free");
    let killed = &directory.jobs().expect("reads")[1];
    let kept = directory.values_of(killed.id).expect("reads").expect("kept");
    assert_eq!(
        kept,
        directory
            .record_path("sim-mill", killed.start, killed.id)
            .with_extension(FILE)
    );
    let rows = rows_of(&kept);
    assert_eq!(rows.len() as u64, acknowledged);
    assert_eq!(
        rows,
        complete[..rows.len()],
        "the same seed: what was kept is how the whole run begins"
    );
    assert_eq!(std::fs::read(Path::new(&whole).join(FILE)).expect("kept"), before);
    let first = directory.jobs().expect("reads")[0].id;
    let of_first = directory.values_of(first).expect("reads").expect("kept");
    assert_eq!(std::fs::read(of_first).expect("kept"), before);
    let told = directory.events(Log::Directory, 1, 1000).expect("reads");
    assert!(
        told.iter()
            .any(|event| event.kind == "values-recovered" && event.detail["rows"] == acknowledged)
    );
    assert_eq!(directory.segments().read_dir().expect("reads").count(), 0);
    assert_eq!(directory.verify().expect("verifies"), []);
    drop(directory);

    let csv = out.path().join("killed.csv").display().to_string();
    let export = command(&["trace", "export", "2", "--out", &csv], data.path())
        .output()
        .expect("the binary starts");
    assert!(export.status.success(), "{}", words(&export));
    let exported = std::fs::read_to_string(out.path().join("killed.functions.csv")).expect("exported");
    assert_eq!(exported.lines().count() as u64, acknowledged + 1);
}

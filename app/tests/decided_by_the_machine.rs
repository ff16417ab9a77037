//! Programs whose way the machine decides: by what a function measured, by a sensor, by the time. They are checked, run, and held against the
//! way that they took.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

struct Shop(tempfile::TempDir);

impl Shop {
    fn new() -> Shop {
        Shop(tempfile::tempdir().expect("a folder"))
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn program(&self, name: &str, text: &str) -> String {
        std::fs::write(self.path(name), text).expect("written");
        self.path(name).display().to_string()
    }
    /// What a command says on stdout and stderr; it has to end with `exit`.
    #[track_caller]
    fn told(&self, exit: i32, words: &[&str]) -> (String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_toolmark"))
            .args(words)
            .args(["--start", "2026-11-22T06:00:00Z", "--data"])
            .arg(self.path("data"))
            .output()
            .expect("the binary starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (said, warned) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(exit), "{said}{warned}");
        (said, warned)
    }
    /// The records of functions in the report of a run.
    #[track_caller]
    fn run(&self, program: &str) -> Value {
        let out = self.path("out").display().to_string();
        let (said, _) = self.told(
            0,
            &["run", program, "--machine", "sim-mill", "--fast", "--out", &out, "--json"],
        );
        serde_json::from_str(&said).expect("JSON")
    }
}

const MEASURED: &str = "O1\nG21 G17 G90 G54\nT1 M6\nS1000 M3\nG0 G43 H1 X0 Y0 Z5.\nG1 X10. F600.\n\
    (trace:1 get_spindle_speed its_variable=#100)\n(trace:1 get_interpolated_position its_axis=X frame=work its_variable=#101)\n\
    IF [#100 LT 500] GOTO 50\nG1 X20.\nN50 G1 X[#101+3.]\n#102=7.\n\
    N60 (trace:1 log_event its_kind=way)\nN70 (trace:+ its_values=#100,#101,#102)\nM5\nM30\n";

#[test]
fn a_program_goes_on_with_what_a_function_measured() {
    let shop = Shop::new();
    let program = shop.program("measured.nc", MEASURED);
    let (said, _) = shop.told(0, &["check", &program, "--machine", "sim-mill"]);
    assert!(said.contains("a function writes #100 while the program runs"), "{said}");
    let run = shop.run(&program);
    // Over X20 to X13, and that is the plan too.
    assert_eq!(
        (&run["report"]["verdict"], &run["report"]["unmatched"]),
        (&Value::from("good"), &Value::from(1)),
        "{run:#}"
    );
    let (said, _) = shop.told(0, &["trace", "show", "last", "--events"]);
    let event = said
        .lines()
        .find(|line| line.contains("log_event") && line.contains("kind way"));
    let event = event.unwrap_or_else(|| panic!("{said}"));
    assert!(event.contains("#101 = 10") && event.contains("#102 = 7"), "{event}");
}

#[test]
fn conditions_of_step_nc_on_what_the_machine_knows_are_checked_and_run() {
    let shop = Shop::new();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/decided.stp");
    let program = data.display().to_string();
    let (said, _) = shop.told(0, &["check", &program, "--machine", "sim-mill"]);
    assert!(
        said.contains("the condition is decided by the machine: here it is taken as not fulfilled"),
        "{said}"
    );
    shop.run(&program);
    let (said, _) = shop.told(0, &["trace", "show", "last", "--events"]);
    let found = |text: &str| said.matches(text).count();
    // The spindle stands at first and turns behind the workingstep's technology; the initial value of the variable is above both.
    assert_eq!((found("it is fast"), found("it is slow")), (0, 2), "{said}");
    assert_eq!((found("short enough"), found("more than a second")), (1, 1), "{said}");
}

#[test]
fn values_of_recordings_are_kept_whatever_they_began_behind() {
    let shop = Shop::new();
    let text = "O1\nG21 G17 G90 G54\nT1 M6\n(trace:1 get_feedrate_points number_of_points=5)\n\
        (trace:1 start_sensor_recording its_function_id=2 its_sensors=X.LOAD,Y.LOAD its_sampling=100)\nS1000 M3\nG0 G43 H1 X0 Y0 Z5.\n\
        G1 X10. F600.\n(trace:1 stop_sensor_recording its_function_id=2)\nM5\nM30\n";
    shop.run(&shop.program("order.nc", text));
    let mut rows = std::collections::BTreeMap::new();
    store::functions::read(&shop.path("out").join(store::functions::FILE), &mut |row| {
        *rows.entry(row.stream).or_insert(0) += 1;
    })
    .expect("a file of recordings");
    assert_eq!(
        (
            rows["PATH.PATH_FEEDRATE.ACTUAL"],
            rows["X.LOAD"] == rows["Y.LOAD"],
            rows["X.LOAD"] > 20
        ),
        (5, true, true),
        "{rows:?}"
    );
}

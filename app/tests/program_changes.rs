//! What a program writes into the control's registers while `toolmark run` executes it: kept once, with the line that wrote it, whatever
//! becomes of the run.

use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use store::{DataDirectory, Log, MachineFile, MachineKind};

/// A data directory, and programs beside it.
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
    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
        command
            .args(words)
            .args(["--operator", "Maria", "--data"])
            .arg(self.path("data"));
        command
    }
    #[track_caller]
    fn run(&self, exit: i32, words: &[&str]) -> Value {
        let output = self.command(words).arg("--json").output().expect("the binary starts");
        assert_eq!(output.status.code(), Some(exit), "{}", words_of(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", words_of(&output)))
    }
    /// Runs a lathe's program as fast as possible; its answer.
    #[track_caller]
    fn turn(&self, exit: i32, program: &str, job: &str) -> Value {
        let out = self.path(job).display().to_string();
        self.run(exit, &["run", program, "--machine", "sim-lathe", "--fast", "--out", &out])
    }
    fn directory(&self) -> DataDirectory {
        DataDirectory::open(&self.path("data"), "the test").expect("free")
    }
}

fn words_of(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

const WRITES: &str = "%\nO100(WRITES)\nG21 G18 G40 G99\nSETVN 501[DIM A]\n#501=3.25\n#502=7\n#502=#0\nG0 X100. Z5.\n#2003=-0.02\n\
                      #2803=38.5\nG10 P3 W-0.1\nG10 L2 P2 X-479.5\n#5242=-401.25\n#3901=#3901+1\n#1100=1\nPOPEN\n\
                      DPRNT[PART*#3901[30]*WEAR*#2003[13]]\nPCLOS\nM30\n%\n";

#[test]
fn what_a_program_changes_the_next_run_begins_with() {
    let shop = Shop::new();
    let writes = shop.program("writes.nc", WRITES);
    let told = shop.turn(0, &writes, "one");
    assert_eq!(told["printed"].as_array().map(Vec::len), Some(1));
    let lathe = MachineFile::simulated(MachineKind::Lathe);
    let directory = shop.directory();
    let value = |path: &str| directory.value(&format!("sim-lathe/{path}")).expect("reads");
    assert_eq!(value("tool/3/wear/x_mm"), Some(-0.02));
    assert_eq!(value("tool/3/wear/z_mm"), Some(-0.1));
    assert_eq!(value("tool/3/geometry/z_mm"), Some(38.5));
    assert_eq!(value("offset/G55/x_mm"), Some(-479.5));
    assert_eq!(value("offset/G55/z_mm"), Some(-401.25));
    let kept: Vec<(u32, f64)> = directory.variables(&lathe).expect("reads").into_iter().collect();
    assert_eq!(
        kept,
        [(501, 3.25), (3901, 1.0)],
        "#502 is vacant again, an output is not kept"
    );

    let events = directory.events(Log::Directory, 1, 10_000).expect("reads");
    let change = |path: &str| -> Vec<&ledger::Event> {
        let path = format!("sim-lathe/{path}");
        let last = events
            .iter()
            .filter(|e| e.kind == "change" && e.detail["path"] == path.as_str());
        last.filter(|e| e.detail.contains_key("job")).collect()
    };
    let [wear] = *change("tool/3/wear/x_mm") else {
        panic!("one change of the wear: {:?}", change("tool/3/wear/x_mm"))
    };
    assert_eq!(wear.detail["who"], "writes.nc line 9");
    assert_eq!(
        (&wear.detail["before"], &wear.detail["after"]),
        (&Value::Null, &Value::from(-0.02))
    );
    assert_eq!(
        wear.detail["why"],
        "tool 3 wear X was written by the program, in job 1 of Maria"
    );
    assert_eq!(change("variable/501")[0].detail["line"], 5);
    assert_eq!(change("offset/G55/z_mm")[0].detail["line"], 13);
    assert_eq!(directory.verify().expect("verifies"), []);
    drop(directory);

    let again = shop.program(
        "again.nc",
        "%\nO101(AGAIN)\nG21 G18 G40 G99\nG0 X90. Z5.\n#503=#501+#2003\n#504=#5242\n#3901=#3901+1\nM30\n%\n",
    );
    shop.turn(0, &again, "two");
    let kept = shop.directory().variables(&lathe).expect("reads");
    assert!((kept[&503] - 3.23).abs() < 1e-9, "{kept:?}");
    assert_eq!((kept[&504], kept[&3901]), (-401.25, 2.0));
}

#[test]
fn a_killed_run_keeps_once_what_was_executed_and_nothing_that_was_read_ahead() {
    let shop = Shop::new();
    // In real time: everything up to the long dwell is done in the first two seconds.
    let program = shop.program(
        "long.nc",
        "%\nO102(LONG)\nG21 G18 G40 G99\n#2003=#2003-0.01\n#3901=#3901+1\nG4 X0.5\n#501=#501+1\nG4 X60.\n#2003=#2003-0.5\n#501=50\nM30\n%\n",
    );
    for time in 1..=2 {
        let words = ["run", &program, "--machine", "sim-lathe"];
        let mut killed = shop.command(&words).stdout(Stdio::null()).spawn().expect("the binary starts");
        let segment = shop.path(&format!("data/segments/job-{time:06}/0001.segment"));
        let begun = (0..1200).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            store::segment::read(&segment).map_or(0, |found| found.rows) > 4000
        });
        killed.kill().expect("it runs"); // SIGKILL on Unix
        killed.wait().expect("it ends");
        assert!(begun, "some seconds of the run came to the disk");
        let directory = shop.directory();
        let value = |path: &str| directory.value(&format!("sim-lathe/{path}")).expect("reads");
        let times = f64::from(time);
        assert_eq!(value("tool/3/wear/x_mm"), Some(-0.01 * times));
        assert_eq!((value("variable/501"), value("variable/3901")), (Some(times), Some(times)));
        let changes = directory.changes_of("sim-lathe/tool/3/wear/x_mm", 0).expect("reads");
        assert_eq!(changes.len() as u32, time, "each write is one change");
    }
}

#[test]
fn a_run_that_alarms_keeps_what_it_had_executed() {
    let shop = Shop::new();
    // The machine's own clock decides; who only looks through the program counts a millisecond for each block.
    let program = shop.program(
        "alarms.nc",
        "%\nO103(ALARMS)\nG21 G18 G40 G98\n#3001=0\nT0303\nM3 S500\nG0 X100. Z5.\n#501=1\nG1 Z-20. F200.\nIF[#3001LT2000]GOTO20\n\
         #502=2\n#3000=5(TOO LATE)\nN20\n#503=3\nM30\n%\n",
    );
    let told = shop.turn(1, &program, "one");
    assert_eq!(told["ended"], "alarm", "{told}");
    let lathe = MachineFile::simulated(MachineKind::Lathe);
    let kept: Vec<(u32, f64)> = shop.directory().variables(&lathe).expect("reads").into_iter().collect();
    assert_eq!(kept, [(501, 1.0), (502, 2.0)]);
}

#[test]
fn printed_lines_are_a_file_of_the_job_and_no_functions() {
    let shop = Shop::new();
    let writes = shop.program("writes.nc", WRITES);
    shop.turn(0, &writes, "one");
    let text = std::fs::read_to_string(shop.path("one/DPRNT.txt")).expect("written");
    let report: Value = serde_json::from_slice(&std::fs::read(shop.path("one/report.json")).expect("written")).expect("JSON");
    assert_eq!(report["printed"], serde_json::json!([text.trim_end_matches('\n')]));
    assert!(text.starts_with("PART"), "{text}");
    assert!(text.contains(".020"), "{text}");
    assert_eq!(report["variable_names"], serde_json::json!({ "501": "DIM A" }));
    assert!(report["verdict"].is_string(), "the report is all there");
    let tree = shop.run(0, &["inspect", &writes]);
    assert_eq!(tree["summary"]["nc_functions"], 0);
    assert_eq!(shop.directory().verify().expect("verifies"), []);
}

#[test]
fn the_history_of_a_size_shows_that_a_program_changed_its_offset() {
    let shop = Shop::new();
    let job = shop.program(
        "job.toml",
        "name = \"SHAFT\"\nnumber = 40\nunit = \"mm\"\n[[dimension]]\nname = \"SEAT\"\nkind = \"outside diameter\"\nnominal = 40\n\
         tolerance = [-0.05, 0.05]\ntool = 3\n",
    );
    shop.run(0, &["size", "job", &job]);
    shop.run(0, &["size", "enter", "--dimension", "SEAT", "40.01"]);
    let writes = shop.program("writes.nc", WRITES);
    shop.turn(0, &writes, "one");
    let history = shop.run(0, &["size", "history"]);
    let rows = history["history"].as_array().expect("rows");
    let last = rows.last().expect("a row");
    assert_eq!(last["what"], "changed-by-program");
    assert_eq!((&last["file"], &last["line"]), (&Value::from("writes.nc"), &Value::from(9)));
    assert_eq!(last["who"], "writes.nc line 9");
    assert_eq!(last["before_mm"], rows[0]["after_mm"]);
    assert_eq!(last["after_mm"], -0.02);
    let lines = shop.command(&["size", "history"]).output().expect("the binary starts");
    assert!(
        words_of(&lines).contains("changed by program; writes.nc line 9:"),
        "{}",
        words_of(&lines)
    );
}

#[test]
fn a_control_parameter_of_the_machine_file_makes_t_words_call_their_macro() {
    let shop = Shop::new();
    let lathe = include_str!("../../store/machines/sim-lathe.toml");
    let machine = shop.program("lathe.toml", &format!("{lathe}\n[control_parameters]\n\"6001.5\" = 1\n"));
    shop.program("O9000.nc", "%\nO9000\n#510=#149\n#2003=0.02\nT#149\nM99\n%\n");
    let part = shop.program("part.nc", "%\nO1\nG21 G18 G40 G99\nT0303\nG0 X100. Z5.\nM30\n%\n");
    let out = shop.path("out").display().to_string();
    shop.run(0, &["check", &part, "--machine", &machine]);
    shop.run(0, &["run", &part, "--machine", &machine, "--fast", "--out", &out]);
    let directory = shop.directory();
    assert_eq!(directory.value("sim-lathe/variable/510").expect("reads"), Some(303.0));
    let told = directory.changes_of("sim-lathe/tool/3/wear/x_mm", 0).expect("reads");
    assert_eq!(told[0].detail["who"], "O9000 line 4");
    drop(directory);
    let bad = shop.program("bad.toml", &format!("{lathe}\n[control_parameters]\n\"TCS\" = 1\n"));
    let refused = shop
        .command(&["check", &part, "--machine", &bad])
        .output()
        .expect("the binary starts");
    assert_eq!(refused.status.code(), Some(3));
    assert!(
        words_of(&refused).contains("control parameter \"TCS\""),
        "{}",
        words_of(&refused)
    );
}

//! What a machinist asks of `toolmark run`: to take a program up in its middle, to turn overrides and hold, to be told how long it takes.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn corpus(name: &str) -> String {
    format!("{}/../corpus/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn words(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

struct Shop {
    folder: tempfile::TempDir,
}

impl Shop {
    fn new() -> Shop {
        Shop {
            folder: tempfile::tempdir().expect("a folder"),
        }
    }
    fn path(&self) -> &Path {
        self.folder.path()
    }
    fn file(&self, name: &str, text: &str) -> String {
        let path = self.path().join(name);
        std::fs::write(&path, text).expect("written");
        path.display().to_string()
    }
    fn toolmark(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
        command.args(args).env("TOOLMARK_DATA", self.path().join("data"));
        command.output().expect("the binary starts")
    }
    /// A run as fast as it goes that ends well: its answer, and where its files are.
    #[track_caller]
    fn run(&self, out: &str, args: &[&str]) -> (Value, PathBuf) {
        let folder = self.path().join(out);
        let text = folder.display().to_string();
        let all = [&["run", "--fast", "--json", "--out", &text], args].concat();
        let done = self.toolmark(&all);
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &"completed".into()),
            "{}",
            words(&done)
        );
        (answer, folder)
    }
    #[track_caller]
    fn refused(&self, args: &[&str], exit: i32, says: &[&str]) {
        let done = self.toolmark(args);
        let said = words(&done);
        assert_eq!(done.status.code(), Some(exit), "{args:?}: {said}");
        says.iter()
            .for_each(|part| assert!(said.contains(part), "{args:?}: {part}: {said}"));
        assert!(!said.contains("fault of toolmark"), "{said}");
    }
    /// Rows of a job's record: time, step, phase-free columns by name.
    fn rows(&self, folder: &Path) -> Vec<store::record::Row> {
        let reader = store::record::Reader::open(&folder.join("record.parquet")).expect("a record");
        reader.rows().expect("rows").map(|row| row.expect("a row")).collect()
    }
}

fn names(report: &Value) -> Vec<&str> {
    let all = report["workingsteps"].as_array().expect("workingsteps");
    all.iter().filter_map(|w| w["name"].as_str()).collect()
}

fn texts(list: &Value) -> Vec<&str> {
    list.as_array().expect("a list").iter().filter_map(Value::as_str).collect()
}

#[test]
fn a_program_is_taken_up_at_a_block_with_all_that_is_in_force_there_and_nothing_left_out_is_missing() {
    let shop = Shop::new();
    let (whole, whole_folder) = shop.run("whole", &[&corpus("plate.nc")]);
    let (part, folder) = shop.run("part", &[&corpus("plate.nc"), "--from", "N380"]);
    let report = &part["report"];
    assert_eq!(report["verdict"], "good", "{report}");
    let all = names(&whole["report"]);
    assert_eq!(names(report), all[all.len() - 2..], "the face is left out");
    let restart = &part["restart"];
    assert!(
        restart["at"]
            .as_str()
            .is_some_and(|at| at.starts_with("N380 (line 42) in workingstep 2")),
        "{restart}"
    );
    let restored = texts(&restart["restored"]);
    let order = [
        "T2",
        "G54",
        "tool offset 2",
        "spindle 8000 rev/min clockwise",
        "coolant flood",
    ];
    let at = |part: &str| {
        restored
            .iter()
            .position(|r| r.starts_with(part))
            .unwrap_or_else(|| panic!("{part}: {restored:?}"))
    };
    assert!(order.windows(2).all(|pair| at(pair[0]) < at(pair[1])), "{restored:?}");
    assert_eq!(texts(&restart["left_out"]).len(), 2, "{restart}");
    let findings = texts(&report["findings"]).join("\n");
    assert!(
        findings.contains("taken up at N380") && findings.contains("left out by the restart"),
        "{findings}"
    );
    let page = std::fs::read_to_string(folder.join("report.html")).expect("a page");
    assert!(page.contains("taken up at N380"));
    // What ran there is what ran there the first time: the last place is the same, and from its step on the same path.
    let (before, after) = (shop.rows(&whole_folder), shop.rows(&folder));
    let step = restart["step"].as_u64().expect("a step") as u32;
    assert!(
        after.iter().all(|row| row.step.0 == 0 || row.step.0 + 1 >= step),
        "nothing before it ran"
    );
    let (a, b) = (before.last().expect("rows"), after.last().expect("rows"));
    assert_eq!(a.step, b.step);
    // As-executed holds only what ran.
    let twin = std::fs::read_to_string(folder.join("as-executed.stpnc")).expect("a twin");
    let twin_whole = std::fs::read_to_string(whole_folder.join("as-executed.stpnc")).expect("a twin");
    let count = |text: &str| text.matches("MACHINING_WORKINGSTEP(").count();
    assert_eq!((count(&twin), count(&twin_whole)), (2, 3));
    // The log says who.
    let shown = words(&shop.toolmark(&["trace", "show", "last", "--events"]));
    assert!(shown.contains("taken_up") && shown.contains("N380"), "{shown}");
}

#[test]
fn workingsteps_are_named_numbered_and_told_apart() {
    let shop = Shop::new();
    let bracket = corpus("bracket.stpnc");
    let (whole, _) = shop.run("whole", &[&bracket]);
    let all: Vec<String> = names(&whole["report"]).iter().map(|n| (*n).to_owned()).collect();
    let third = all[2].clone();
    let (named, _) = shop.run("named", &[&bracket, "--from", &third]);
    assert_eq!(names(&named["report"]), all[2..].iter().collect::<Vec<_>>());
    assert_eq!(named["report"]["verdict"], "good");
    let (numbered, _) = shop.run("numbered", &[&bracket, "--from", "3"]);
    assert_eq!(numbered["restart"]["step"], named["restart"]["step"]);
    let id = named["report"]["workingsteps"][0]["id"].as_u64().expect("an instance");
    let (by_path, _) = shop.run("by-path", &[&bracket, "--from", &format!("OP10 top/{third}")]);
    assert_eq!(by_path["restart"]["step"], named["restart"]["step"]);
    let restored = texts(&named["restart"]["restored"]).join(", ");
    assert!(restored.contains("T2 ") && restored.contains("spindle"), "{restored}");
    let (drilled, _) = shop.run("drilled", &[&bracket, "--from", "4"]);
    let restored = texts(&drilled["restart"]["restored"]).join(", ");
    assert!(restored.contains("(by the program itself)"), "{restored}");
    let (by_id, _) = shop.run("by-id", &[&bracket, "--from", &format!("#{id}")]);
    assert_eq!(by_id["restart"]["step"], named["restart"]["step"]);
    let (first, _) = shop.run("first", &[&bracket, "--from", "1"]);
    assert_eq!(first["restart"], Value::Null, "that is the beginning");
    shop.refused(
        &["run", &bracket, "--fast", "--from", "no such step"],
        2,
        &["there is no such step", &format!("3 'BRACKET/OP10 top/{third}'")],
    );
    shop.refused(&["run", &bracket, "--fast", "--from", "99"], 2, &["there is no such step"]);
    shop.refused(
        &["run", &bracket, "--fast", "--from", "line:5"],
        2,
        &["there is no such step"],
    );
    shop.refused(&["run", &bracket, "--fast", "--from", "N10"], 2, &["there is no such step"]);
    shop.refused(&["run", &bracket, "--fast", "--from", ""], 2, &["there is no such step"]);
    shop.refused(
        &["run", &bracket, "--fast", "--from", &format!("{third}[2]")],
        2,
        &["there are only 1"],
    );
    shop.refused(
        &["run", &bracket, "--fast", "--from", "3", "--resume", "1"],
        2,
        &["cannot be used with"],
    );
}

const LOOP: &str = "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nS3000 M3\nG0 X0. Y0. Z10.\nG1 Z-1. F600.\n#1=0\nWHILE[#1LT3]DO1\nX[20+#1] F900.\nY[10+#1]\nX0.\nY0.\n\
                    #1=#1+1\nEND1\nG0 Z10.\nN7 M5\nN7 M30\n%\n";

#[test]
fn a_line_of_a_loop_is_said_with_which_of_its_passes() {
    let shop = Shop::new();
    let program = shop.file("loop.nc", LOOP);
    let args = ["run", &program, "--fast", "--from", "line:12"];
    shop.refused(&args, 2, &["it comes 3 times", "'line:12[2]' is line 12"]);
    shop.refused(
        &["run", &program, "--fast", "--from", "N7"],
        2,
        &["N7 stands in several lines", "line:18, line:19"],
    );
    let (second, _) = shop.run("second", &[&program, "--from", "line:12[2]"]);
    assert_eq!(second["report"]["verdict"], "good");
    // A block that does nothing itself: the next one, and it is said.
    let (next, _) = shop.run("next", &[&program, "--from", "line:15[1]"]);
    let at = next["restart"]["at"].as_str().expect("a place");
    assert!(at.contains("line 15 itself does nothing"), "{at}");
    shop.refused(
        &["run", &program, "--fast", "--from", "line:500"],
        2,
        &["there is no such step"],
    );
}

#[test]
fn a_lathe_program_is_taken_up_with_its_surface_speed() {
    let shop = Shop::new();
    let (part, _) = shop.run("part", &[&corpus("shaft.nc"), "--from", "N490"]);
    assert_eq!(part["report"]["verdict"], "good");
    let restored = texts(&part["restart"]["restored"]).join("; ");
    assert!(
        restored.contains("spindle 280 m/min clockwise, at most 3000 rev/min"),
        "{restored}"
    );
}

#[test]
fn only_a_level_that_may_takes_a_program_up_and_a_refusal_is_in_the_log() {
    let shop = Shop::new();
    let add = |args: &[&str]| {
        let done = shop.toolmark(&[&["operator", "add"], args].concat());
        assert!(done.status.success(), "{}", words(&done));
    };
    add(&["Maria", "--level", "1"]);
    add(&["Jo", "--level", "6", "--operator", "Maria", "--reason", "new here"]);
    let plate = corpus("plate.nc");
    shop.refused(
        &["run", &plate, "--fast", "--from", "N380", "--operator", "Jo"],
        1,
        &["to start in the middle of a program takes level 5 or better"],
    );
    let (run, _) = shop.run("maria", &[&plate, "--from", "N380", "--operator", "Maria"]);
    assert_eq!(run["restart"]["by"]["name"], "Maria");
    let (plain, _) = shop.run("jo", &[&plate, "--operator", "Jo"]);
    assert_eq!(plain["restart"], Value::Null);
}

const RECORDED: &str = "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nS3000 M3\nG0 X0. Y0. Z10.\n\
(trace:1 start_sensor_recording its_function_id=load its_sensors=X.LOAD)\n\
(trace:1 start_sensor_recording its_function_id=gone its_sensors=Y.LOAD)\n\
(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.POSITION.ACTUAL > -495\" \
its_actions=\"read_sensor_value its_sensor=Z.LOAD\")\n\
G1 Z-1. F600.\n(trace:1 stop_sensor_recording its_function_id=gone)\nX20. F900.\nN50 Y15.\nX0.\nY0.\n(trace:1 stop_sensor_recording its_function_id=load)\nG0 Z10.\nM5\nM30\n%\n";

#[test]
fn what_functions_had_begun_goes_on_after_the_restart() {
    let shop = Shop::new();
    let program = shop.file("recorded.nc", RECORDED);
    let (run, _) = shop.run("part", &[&program, "--from", "N50"]);
    let restored = texts(&run["restart"]["restored"]).join("\n");
    assert!(
        restored.contains("its_function_id=load") && restored.contains("start_synchronized_action"),
        "{restored}"
    );
    assert!(!restored.contains("gone"), "{restored}");
    let told = run["functions"].as_array().expect("records");
    assert!(told.iter().all(|t| t["data"].get("error").is_none()), "{told:#?}");
    assert!(told.iter().any(|t| t["data"]["state"] == "fired"), "{told:#?}");
}

#[test]
fn a_recording_along_a_path_records_what_is_left_of_it() {
    let sample = "../../shared/samples/stepnc/ap238/plate_trace_functions_e3.stpnc";
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join(sample);
    if !sample.exists() {
        println!("skipped: put the samples beside the repository in ../shared/samples");
        return;
    }
    let shop = Shop::new();
    // Its toolpath 'cut recorded' begins at step 20, what is along it at 21, and its first move is 22.
    let (run, _) = shop.run("part", &[&sample.display().to_string(), "--from", "step:22"]);
    let restored = texts(&run["restart"]["restored"]).join("\n");
    assert!(restored.contains("functions along 'cut recorded'"), "{restored}");
    let told = run["functions"].as_array().expect("records");
    let ended = told
        .iter()
        .find(|t| t["data"]["why"] == "end of the path")
        .expect("it ends with its path");
    assert!(ended["data"]["samples"].as_u64().is_some_and(|n| n > 5_000), "{ended}");
}

#[test]
fn a_run_as_an_agent_saw_it_begins_where_it_was_taken_up() {
    let shop = Shop::new();
    let (run, _) = shop.run("part", &[&corpus("plate.nc"), "--from", "N380", "--as-mtconnect", "20"]);
    assert_eq!(run["report"]["verdict"], "good", "{}", run["report"]["findings"]);
}

#[test]
fn overrides_and_holds_of_a_script_are_in_force_when_it_says_and_stand_in_record_and_report() {
    let shop = Shop::new();
    let plate = corpus("plate.nc");
    let script = shop.file(
        "script.txt",
        "# try it\n12 feed=150 rapid=50\n13.5 hold\n17 resume\n20 feed=60 spindle=90\n25 feed=100\n",
    );
    let (plain, _) = shop.run("plain", &[&plate]);
    let (run, folder) = shop.run("turned", &[&plate, "--overrides", &script]);
    assert_eq!(run["report"]["verdict"], "good");
    assert_eq!(plain["overrides"].as_array().map(Vec::len), Some(0));
    let told = run["overrides"].as_array().expect("overrides");
    let of = |name: &str| -> Vec<f64> { told.iter().filter_map(|o| o[name].as_f64()).collect() };
    assert_eq!(of("feed_percent"), [100.0, 150.0, 60.0, 100.0], "{told:?}");
    assert_eq!(of("rapid_percent"), [100.0, 50.0, 50.0, 50.0]);
    assert_eq!(of("spindle_percent"), [100.0, 100.0, 90.0, 90.0]);
    for (from, asked) in of("from_s").iter().zip([0.0, 12.0, 20.0, 25.0]) {
        assert!((from - asked).abs() < 0.005, "{told:?}");
    }
    let held = run["held_s"].as_f64().expect("a time");
    assert!((held - 3.5).abs() < 0.1 && run["holds"] == 1, "{held}");
    let page = std::fs::read_to_string(folder.join("report.html")).expect("a page");
    assert!(page.contains("Overrides and holds") && page.contains("Feed held once"));
    let reader = store::record::Reader::open(&folder.join("record.parquet")).expect("a record");
    let mut highest = 0.0f64;
    for batch in reader.batches().expect("batches") {
        let batch = batch.expect("a batch");
        let values = batch.values("PATH.PATH_FEEDRATE_OVERRIDE.PROGRAMMED").expect("a column");
        highest = values.flatten().fold(highest, f64::max);
    }
    assert_eq!(highest, 150.0);
}

#[test]
fn constant_overrides_make_a_run_slower_or_faster_and_what_is_none_is_refused() {
    let shop = Shop::new();
    let plate = corpus("plate.nc");
    let time = |out: &str, args: &[&str]| {
        let (run, _) = shop.run(out, &[&[plate.as_str()], args].concat());
        assert_eq!(run["report"]["verdict"], "good", "{args:?}");
        run["machine_time_s"].as_f64().expect("a time")
    };
    let plain = time("plain", &[]);
    assert!(time("half", &["--feed-override", "50"]) > plain * 1.2);
    assert!(time("double", &["--feed-override", "200%"]) < plain * 0.95);
    assert!(time("slow-rapids", &["--rapid-override", "25"]) > plain * 1.02);
    time("spindle", &["--spindle-override", "120"]);
    let refused = |args: &[&str], says: &str| shop.refused(&[&["run", &plate, "--fast"], args].concat(), 2, &[says]);
    refused(&["--feed-override", "201"], "whole percents from 0 to 200");
    refused(&["--feed-override", "-5"], "whole percents from 0 to 200");
    refused(&["--feed-override", "12.5"], "whole percents from 0 to 200");
    refused(&["--rapid-override", "101"], "whole percents from 0 to 100");
    refused(&["--spindle-override", "49"], "whole percents from 50 to 150");
    refused(&["--feed-override", "0"], "never comes to its end");
    refused(&["--approach", "5"], "--approach is for a machine behind tcp://");
    let script = shop.file("script.txt", "1 hold\n");
    shop.refused(
        &["run", &plate, "--fast", "--overrides", &script],
        3,
        &["script.txt:1:1: this hold is never resumed"],
    );
    shop.refused(&["run", &plate, "--fast", "--overrides", "/no/such"], 3, &["/no/such"]);
    let behind = ["--machine", "tcp://127.0.0.1:9", "--overrides", &script];
    shop.refused(&[&["run", &plate], &behind[..]].concat(), 3, &["never resumed"]);
}

#[test]
fn a_run_says_how_long_it_was_foreseen_to_take_and_how_long_it_took() {
    let shop = Shop::new();
    for name in ["plate.nc", "bracket.stpnc", "shaft.nc"] {
        let (run, folder) = shop.run(name, &[&corpus(name)]);
        let time = &run["time"];
        println!("{name}: {time}");
        let percent = |field: &str| time[field].as_f64().unwrap_or_else(|| panic!("{field}: {time}")).abs();
        assert!(percent("real_against_foreseen_percent") < 3.0, "{name}: {time}");
        assert!(percent("real_against_tenth_percent") < 5.0, "{name}: {time}");
        let page = std::fs::read_to_string(folder.join("report.html")).expect("a page");
        assert!(page.contains("foreseen at the start"));
        let json = std::fs::read_to_string(folder.join("report.json")).expect("JSON");
        assert!(json.contains("foreseen_after_a_tenth_s"));
    }
}

#[test]
fn a_tool_change_at_the_beginning_says_nothing_of_the_pace() {
    let shop = Shop::new();
    let program = shop.file(
        "short.nc",
        "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nG0 X0. Y0. Z5.\nG1 X10. F500.\nX20.\nM30\n%\n",
    );
    let (run, _) = shop.run("short", &[&program]);
    let off = run["time"]["real_against_tenth_percent"].as_f64().expect("a tenth");
    assert!(off.abs() < 10.0, "{}", run["time"]);
}

#[test]
fn a_planned_path_begins_where_the_machine_stands() {
    let shop = Shop::new();
    let out = shop.path().join("plan.csv").display().to_string();
    let done = shop.toolmark(&["plan", &corpus("plate.nc"), "--out", &out, "--frame", "machine"]);
    assert!(done.status.success(), "{}", words(&done));
    let text = std::fs::read_to_string(&out).expect("a plan");
    let rows: Vec<&str> = text.lines().skip(1).take(2).collect();
    assert_eq!(rows[0], "0,0,0,0,0,0,0", "{rows:?}");
    assert!(rows[1].starts_with("0.001,"), "{rows:?}");
}

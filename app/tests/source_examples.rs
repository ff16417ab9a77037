//! The two examples of the functions' source, in its own words, through the program: on the simulated machine, in log and report, and as
//! a Siemens program.
//!
//! The first records the load of the drives during workingstep 1. The second: if workingstep 1 takes longer than a limit, record positions
//! and loads of X, Y and Z and set an alarm (`WS_TIME > TIME_LIMIT`, WHEN, in ALL MODES).

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use store::functions::{FILE, Recorded};
use store::record::Reader;

/// A data directory with Maria (level 1), Jo (6) and Tim (7).
struct Shop(tempfile::TempDir);

impl Shop {
    fn new() -> Shop {
        let shop = Shop(tempfile::tempdir().expect("a folder"));
        shop.good(&["operator", "add", "Maria"]);
        shop.good(&["operator", "add", "Jo", "--level", "6", "--operator", "Maria"]);
        shop.good(&["operator", "add", "Tim", "--level", "7", "--operator", "Maria"]);
        shop
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn run(&self, words: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_toolmark"))
            .args(words)
            .current_dir(self.0.path())
            .env("TOOLMARK_DATA", self.path("data"))
            .output()
            .expect("the binary starts")
    }
    #[track_caller]
    fn good(&self, words: &[&str]) -> String {
        let output = self.run(words);
        assert!(output.status.success(), "{words:?}: {}", text(&output));
        text(&output)
    }
    #[track_caller]
    fn json(&self, words: &[&str]) -> Value {
        let output = self.run(&[words, &["--json"]].concat());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{words:?}: {e}: {}", text(&output)))
    }

    /// The bracket with functions around its first workingstep; `TIME_LIMIT` is a variable of the program, 5 s.
    fn bracket(&self, start: &str, stop: &str) -> String {
        let corpus = repository("corpus/bracket.stpnc").display().to_string();
        let traced = self.path("bracket.stpnc").display().to_string();
        let edit = [
            "edit",
            &corpus,
            "--out",
            &traced,
            "--operator",
            "Maria",
            "--reason",
            "watch the time",
        ];
        self.good(&[&edit[..], &["--insert", "face top", start, "--insert", "round pocket", stop]].concat());
        let text = std::fs::read_to_string(&traced).expect("edited");
        let limit = "#90001=EXPRESSION_ITEM_REPRESENTATION_ITEM('TIME_LIMIT',#90002);\n#90002=REAL_NUMERIC_VARIABLE();\n\
                     #90003=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#90004);\n#90004=REAL_LITERAL(5.);\n\
                     #90005=REPRESENTATION_ITEM_RELATIONSHIP('initial value','',#90001,#90003);\n";
        let (before, after) = text.rsplit_once("ENDSEC;").expect("a data section");
        let path = self.path("limited.stpnc");
        std::fs::write(&path, format!("{before}{limit}ENDSEC;{after}")).expect("written");
        path.display().to_string()
    }

    /// The plate in G-code with functions around its first tool.
    fn plate(&self, start: &str, stop: &str) -> String {
        let text = std::fs::read_to_string(repository("corpus/plate.nc")).expect("the corpus");
        let text = text.replacen("N100 T1 M6", &format!("{start}\nN100 T1 M6"), 1);
        let text = text.replacen("N200 T2 M6", &format!("{stop}\nN200 T2 M6"), 1);
        assert!(text.contains(start) && text.contains(stop));
        let path = self.path("plate.nc");
        std::fs::write(&path, text).expect("written");
        path.display().to_string()
    }
}

fn text(output: &Output) -> String {
    let both = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    both.concat()
}

fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

/// The source's actions: read_sensor_value (1) to (n), and an alarm.
const ACTIONS: &str = "its_actions=\"read_sensor_value its_sensor=position its_axes=X,Y,Z\",\
                       \"read_sensor_value its_sensor=drive_load its_axes=X,Y,Z\",\"set_alarm its_alarm_id=1 its_text=over_time\"";

fn over_time(condition: &str) -> String {
    format!(
        "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"{condition}\" {ACTIONS}"
    )
}

#[track_caller]
fn column<'r>(record: &'r Reader, name: &str) -> &'r store::record::Column {
    let found = record.columns().iter().find(|column| column.name == name);
    found.unwrap_or_else(|| panic!("no column {name}: {:?}", record.columns()))
}

/// Values of a column in a cycle.
fn reading(record: &Reader, tick: u64, column: &str) -> f64 {
    for batch in record.batches().expect("readable") {
        let batch = batch.expect("whole");
        let place = batch.rows().iter().position(|row| row.tick.0 == tick);
        if let Some(place) = place {
            let mut values = batch.values(column).expect("the column");
            return values.nth(place).expect("the row").expect("a value");
        }
    }
    panic!("no row of cycle {tick}");
}

/// Runs it, and checks the second example in every place where it is told: cycle, values, alarm, log, report, export.
#[track_caller]
fn check_over_time(shop: &Shop, program: &str, limit_s: f64) {
    let out = shop.path("out").display().to_string();
    let told = shop.json(&["run", program, "--fast", "--operator", "Jo", "--out", &out]);
    assert_eq!(told["ended"], "completed", "{told:#}");
    let all = told["functions"].as_array().expect("records");
    let of = |state: &str| -> Vec<&Value> {
        let is = |r: &&Value| r["data"]["id"] == "1" && r["data"]["state"] == state;
        all.iter().filter(is).collect()
    };
    let (started, fired, ended) = (of("started"), of("fired"), of("ended"));
    assert_eq!(
        (started.len(), fired.len(), ended.len()),
        (1, 1, 1),
        "WHEN fires once: {all:#?}"
    );
    assert_eq!(
        (&started[0]["data"]["scope"], &ended[0]["data"]["why"]),
        (&"ALL".into(), &"stop".into())
    );
    let fired = &fired[0]["data"];

    // The condition came true in the first cycle in which the workingstep was older than the limit.
    let record = Reader::open(&Path::new(&out).join("record.parquet")).expect("a record");
    let began = record
        .rows()
        .expect("readable")
        .map(|row| row.expect("whole"))
        .find(|row| row.workingstep.0 == 1)
        .expect("workingstep 1")
        .tick
        .0;
    let cycle = fired["cycle_of_condition"].as_u64().expect("a cycle");
    let late = cycle as f64 - began as f64 - limit_s * 1000.0;
    assert!((0.0..=2.0).contains(&late), "{began} {cycle}");

    // Positions and loads are those of that very cycle in the record.
    for (action, quantity) in [(0, "POSITION.ACTUAL"), (1, "LOAD")] {
        let values = fired["actions"][action]["values"].as_array().expect("values");
        assert_eq!(values.len(), 3);
        for (value, axis) in values.iter().zip(["X", "Y", "Z"]) {
            assert_eq!(value["stream"], format!("{axis}.{quantity}"));
            assert_eq!(value["quality"], "simulated");
            let column = column(&record, &format!("{axis}.{quantity}"));
            let recorded = reading(&record, cycle, &column.name);
            let said = value["value"].as_f64().expect("a number");
            assert!(
                (said - recorded).abs() <= column.scale,
                "{axis}.{quantity}: {said} {recorded}"
            );
        }
    }
    let alarm = &fired["actions"][2];
    assert_eq!(
        (&alarm["alarm"], &alarm["text"], &alarm["state"]),
        (&1.into(), &"over_time".into(), &"set".into())
    );

    // In the log, in the report, in the export.
    let actions = shop.json(&["trace", "actions", "last"]);
    let action = &actions["actions"][0];
    assert_eq!(
        (&action["scope"], &action["fired"], &action["why"]),
        (&"ALL".into(), &1.into(), &"stop".into())
    );
    let shown = shop.good(&["trace", "show", "last"]);
    assert!(
        shown.contains("start_synchronized_action") && shown.contains("over_time"),
        "{shown}"
    );
    let report = std::fs::read_to_string(Path::new(&out).join("report.html")).expect("a report");
    assert!(report.contains("over_time") && report.contains("X.LOAD"));
    let csv = shop.path("export.csv").display().to_string();
    shop.good(&["trace", "export", "last", "--out", &csv]);
    let events = std::fs::read_to_string(shop.path("export.events.csv")).expect("exported");
    assert!(events.contains("over_time") && events.contains("cycle_of_condition"));
}

/// The lines of the posted program, and the grade of each function.
fn posted(shop: &Shop, program: &str) -> (String, Value) {
    let out = shop.path("posted.mpf").display().to_string();
    let words = ["post", program, "--control", "siemens-840d", "--out", &out];
    let told = shop.json(&words);
    (std::fs::read_to_string(&out).expect("posted"), told)
}

#[track_caller]
fn check_posted_over_time(shop: &Shop, program: &str, condition: &str) {
    let (text, told) = posted(shop, program);
    let action = text
        .lines()
        .find(|line| line.starts_with("IDS="))
        .unwrap_or_else(|| panic!("{text}"));
    assert!(action.contains(&format!("WHEN $AC_TIMER[1]>{condition} DO ")), "{action}");
    for captured in ["$AA_LOAD[X]", "$AA_LOAD[Y]", "$AA_LOAD[Z]", "SETAL(65001)"] {
        assert!(action.contains(captured), "{captured}: {action}");
    }
    // The encoders' positions are asked for: `position` is their alias.
    for axis in ["X", "Y", "Z"] {
        assert!(action.contains(&format!("=$VA_IM[{axis}]")), "{action}");
    }
    assert!(text.contains("CANCEL(") && text.contains("$AC_TIMER[1]=0"), "{text}");
    let grades = told["functions"].as_array().expect("a table");
    let grade = grades
        .iter()
        .find(|row| row["name"] == "start_synchronized_action")
        .expect("its row");
    assert_eq!(grade["grade"], "native");
}

#[test]
fn a_workingstep_over_its_time_limit_is_told_with_positions_loads_and_an_alarm() {
    let shop = Shop::new();
    let program = shop.bracket(
        &over_time("WS_TIME > TIME_LIMIT"),
        "trace:1 stop_synchronized_action its_id=1",
    );
    check_over_time(&shop, &program, 5.0);
    check_posted_over_time(&shop, &program, "R1");
    let (text, _) = posted(&shop, &program);
    assert!(
        text.lines().any(|line| line == "R1=5"),
        "the limit is a variable there too: {text}"
    );
}

#[test]
fn the_same_in_g_code_where_the_limit_stands_in_the_condition() {
    let shop = Shop::new();
    let start = format!(
        "(trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN)\n(trace:+ its_condition=\"ws_time > 3 s\")\n(trace:+ {ACTIONS})"
    );
    let program = shop.plate(&start, "(trace:1 stop_synchronized_action its_id=1)");
    check_over_time(&shop, &program, 3.0);
    check_posted_over_time(&shop, &program, "3");
}

#[test]
fn who_is_not_of_level_6_does_not_start_an_action_that_outlives_the_program() {
    let shop = Shop::new();
    let program = shop.bracket(
        &over_time("WS_TIME > TIME_LIMIT"),
        "trace:1 stop_synchronized_action its_id=1",
    );
    let tim = shop.run(&["run", &program, "--fast", "--operator", "Tim"]);
    assert_eq!(tim.status.code(), Some(1), "{}", text(&tim));
    assert!(
        text(&tim).contains("T-11") && text(&tim).contains("level 6"),
        "{}",
        text(&tim)
    );
    // Nobody is signed in: the system's user is no operator here.
    let nobody = shop.run(&["run", &program, "--fast"]);
    assert_eq!(nobody.status.code(), Some(1), "{}", text(&nobody));
    let checked = shop.json(&["check", &program]);
    assert!(checked.to_string().contains("T-11"), "{checked:#}");
    // Neither of them moved anything.
    let jobs = shop.json(&["trace", "list"]);
    assert_eq!(jobs["jobs"].as_array().map(Vec::len), Some(0), "{jobs:#}");
    // The same without ALL MODES is anybody's.
    let program = shop.bracket(
        &over_time("WS_TIME > TIME_LIMIT").replace("=ALL", "=AUTOMATIC"),
        "trace:1 stop_synchronized_action its_id=1",
    );
    shop.good(&["run", &program, "--fast", "--operator", "Tim"]);
}

#[test]
fn a_limit_that_nothing_sets_is_named_before_anything_moves() {
    let shop = Shop::new();
    let program = shop.bracket(&over_time("WS_TIME > TIME_LIMT"), "trace:1 stop_synchronized_action its_id=1");
    let refused = shop.run(&["run", &program, "--fast", "--operator", "Jo"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        text(&refused).contains("T-06") && text(&refused).contains("nothing is called TIME_LIMT"),
        "{}",
        text(&refused)
    );
}

/// Rows of X.LOAD, and what was told of the recording.
#[track_caller]
fn check_loads(shop: &Shop, program: &str) {
    let out = shop.path("out").display().to_string();
    let told = shop.json(&["run", program, "--fast", "--operator", "Tim", "--out", &out]);
    assert_eq!(told["ended"], "completed", "{told:#}");
    let record = Reader::open(&Path::new(&out).join("record.parquet")).expect("a record");
    let mut rows: Vec<Recorded> = Vec::new();
    store::functions::read(&Path::new(&out).join(FILE), &mut |row| rows.push(row)).expect("readable");
    let of_record: Vec<(u64, u32)> = record
        .rows()
        .expect("readable")
        .map(|row| row.expect("whole"))
        .map(|row| (row.tick.0, row.workingstep.0))
        .collect();
    let first = of_record
        .iter()
        .find(|(_, workingstep)| *workingstep == 1)
        .expect("workingstep 1")
        .0;
    let last = of_record
        .iter()
        .rfind(|(_, workingstep)| *workingstep == 1)
        .expect("workingstep 1")
        .0;
    for axis in ["X", "Y", "Z"] {
        let stream = format!("{axis}.LOAD");
        let ticks: Vec<u64> = rows.iter().filter(|row| row.stream == stream).map(|row| row.tick).collect();
        assert!(ticks.windows(2).all(|pair| pair[1] - pair[0] == 10), "every tenth cycle");
        assert!(ticks[0] <= first && first - ticks[0] < 5000, "{} {first}", ticks[0]);
        assert!(
            ticks
                .last()
                .is_some_and(|tick| *tick <= last + 10 && last - tick.min(&last) <= 20),
            "{ticks:?} {last}"
        );
    }
    for row in rows.iter().filter(|row| row.stream == "X.LOAD").step_by(97) {
        let column = column(&record, "X.LOAD");
        let recorded = reading(&record, row.tick, &column.name);
        assert!(
            (row.value.expect("a load") - recorded).abs() <= column.scale,
            "{row:?} {recorded}"
        );
        assert_eq!((row.unit.as_str(), row.quality.as_str()), ("PERCENT", "simulated"));
    }
    let report = std::fs::read_to_string(Path::new(&out).join("report.html")).expect("a report");
    assert!(report.contains("start_sensor_recording") && report.contains("Z.LOAD"));
    assert!(
        report.contains("Recorded by the program") && report.contains("aria-label='X.LOAD of"),
        "its course is drawn"
    );
    let told = std::fs::read(Path::new(&out).join("report.json")).expect("a report");
    let told: serde_json::Value = serde_json::from_slice(&told).expect("JSON");
    let streams = told["recordings"][0]["streams"].as_array().expect("streams");
    assert_eq!(streams[0]["stream"], "X.LOAD", "{}", told["recordings"]);
    assert!(
        streams
            .iter()
            .all(|s| s["values"].as_u64() > Some(100) && s["mean"].is_number())
    );
    let (text, told) = posted(shop, program);
    for line in [
        "$AC_FIFO1[0]=$AA_LOAD[X]",
        "$AC_FIFO2[0]=$AA_LOAD[Y]",
        "$AC_FIFO3[0]=$AA_LOAD[Z]",
    ] {
        assert!(text.contains(line), "{text}");
    }
    assert!(text.contains("CANCEL(101,102)"), "{text}");
    let grades = told["functions"].as_array().expect("a table");
    let grade = grades
        .iter()
        .find(|row| row["name"] == "start_sensor_recording")
        .expect("its row");
    assert_eq!(grade["grade"], "native");
}

const RECORD: &str = "trace:1 start_sensor_recording its_function_id=1 its_sensors=drive_load its_sampling=10";
const RECORDED: &str = "trace:1 stop_sensor_recording its_function_id=1";

#[test]
fn the_load_of_the_drives_is_recorded_during_workingstep_1() {
    let shop = Shop::new();
    check_loads(&shop, &shop.bracket(RECORD, RECORDED));
}

#[test]
fn the_load_of_the_drives_is_recorded_while_the_first_tool_of_g_code_cuts() {
    let shop = Shop::new();
    check_loads(&shop, &shop.plate(&format!("({RECORD})"), &format!("({RECORDED})")));
}

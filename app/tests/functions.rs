//! Every function of the vocabulary through the program: loaded, run, recorded, exported and in the manual; and what a check says of them.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use trace::{Call, FUNCTIONS, parse};

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().expect("a temporary folder"))
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_toolmark"))
            .args(arguments)
            .arg("--data")
            .arg(self.path("data"))
            .output()
            .expect("the binary starts")
    }
    #[track_caller]
    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| {
            let (out, err) = (
                String::from_utf8_lossy(&output.stdout),
                String::from_utf8_lossy(&output.stderr),
            );
            panic!("{e}: {out}{err}")
        })
    }
    fn program(&self, name: &str, text: &str) -> String {
        std::fs::write(self.path(name), text).expect("written");
        self.path(name).display().to_string()
    }
}

const CONTROLS: [&str; 5] = ["siemens-840d", "fanuc", "heidenhain", "haas", "linuxcnc"];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Names of functions in the records of a run, actions among them.
fn recorded(told: &Value) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for record in told["functions"].as_array().expect("records of functions") {
        names.insert(record["function"].as_str().unwrap_or_default().to_owned());
        for action in record["data"]["actions"].as_array().into_iter().flatten() {
            names.insert(action["function"].as_str().unwrap_or_default().to_owned());
        }
    }
    names
}

#[test]
fn every_function_is_loaded_run_recorded_exported_posted_and_in_the_manual() {
    let manual = std::fs::read_to_string(repository().join("docs/functions.md")).expect("the manual's page");
    for program in ["corpus/functions.nc", "corpus/functions.stpnc"] {
        let place = Place::new();
        let file = repository().join(program).display().to_string();
        let out = place.path("out").display().to_string();
        let checked = place.json(&["check", &file]);
        let lines = checked["checks"].as_array().expect("checks");
        let of_functions: Vec<&str> = lines
            .iter()
            .filter(|line| line["name"] == "functions")
            .filter_map(|line| line["text"].as_str())
            .collect();
        assert!(!lines.iter().any(|line| line["state"] == "fail"), "{program}: {lines:#?}");
        let told = place.json(&["run", &file, "--fast", "--out", &out, "--start", "2026-11-21T08:00:00Z"]);
        assert_eq!(told["ended"], "completed", "{program}: {told:#}");
        let records = recorded(&told);
        let csv = place.path("export.csv").display().to_string();
        place.json(&["trace", "export", "last", "--out", &csv]);
        let exported = std::fs::read_to_string(place.path("export.events.csv")).expect("exported");
        // Each control gives each function a grade, with a reason where it is not the control's own, and its line stands in the program.
        let posted = CONTROLS.map(|control| {
            let to = place.path(&format!("posted.{control}")).display().to_string();
            let told = place.json(&["post", &file, "--control", control, "--out", &to]);
            (control, told, std::fs::read_to_string(&to).expect("posted"))
        });
        for function in FUNCTIONS {
            let name = function.name;
            for (control, told, text) in &posted {
                let rows = told["functions"].as_array().expect("a table");
                let row = rows.iter().find(|row| row["name"] == name);
                // Its one place is among the actions, whose row is the action's.
                let Some(row) = row else {
                    assert_eq!(name, "display_message", "{program} for {control}: {rows:#?}");
                    continue;
                };
                let grade = row["grade"].as_str().unwrap_or_default();
                let known = ["native", "block-boundary", "external", "refused"].contains(&grade);
                let reason = row["reason"].as_str().unwrap_or_default();
                assert!(known && (grade == "native" || !reason.is_empty()), "{control}: {row:#}");
                let letters = |text: &str| text.to_lowercase().replace('-', "_");
                assert!(
                    letters(text).contains(name),
                    "{program} for {control}: {name} does not stand in it"
                );
            }
            let loaded = of_functions
                .iter()
                .any(|text| text.split([' ', ',']).any(|word| word == name));
            // Its one place is among the actions.
            assert!(
                loaded || name == "display_message",
                "{program}: {name} is not loaded: {of_functions:?}"
            );
            assert!(records.contains(name), "{program}: {name} is not recorded: {records:?}");
            assert!(exported.contains(name), "{program}: {name} is not exported");
            assert!(manual.contains(&format!("### `{name}`")), "{name} has no page");
        }
        // The seed's second example: positions and loads at the firing, and the alarm.
        let fired = told["functions"]
            .as_array()
            .into_iter()
            .flatten()
            .find(|r| r["function"] == "start_synchronized_action" && r["data"]["state"] == "fired")
            .expect("it fires");
        let actions = fired["data"]["actions"].as_array().expect("actions");
        assert_eq!(actions[0]["values"].as_array().map(Vec::len), Some(3));
        assert_eq!(actions[1]["values"][0]["stream"], "X.LOAD");
        assert_eq!(
            (&actions[2]["alarm"], &actions[2]["state"]),
            (&Value::from(1), &Value::from("set"))
        );
        let report = std::fs::read_to_string(place.path("out").join("report.html")).expect("a report");
        assert!(report.contains("Functions of the program") && report.contains("over_time"));
        // Three tool changes were seen while tool logging was on.
        let changes: Vec<u64> = told["functions"]
            .as_array()
            .into_iter()
            .flatten()
            .filter(|r| r["function"] == "start_tool_logging")
            .filter_map(|r| r["data"]["tool_number"].as_u64())
            .collect();
        assert_eq!(changes, [1, 2, 3], "{program}");
        // The values of the recording are a table of their own, and go with an export.
        let mut loads = 0;
        store::functions::read(&place.path("out").join(store::functions::FILE), &mut |row| {
            loads += u32::from(row.recording == "R1" && row.stream == "X.LOAD");
        })
        .expect("readable");
        assert!(loads > 1000, "{loads}");
        let values = std::fs::read_to_string(place.path("export.functions.csv")).expect("exported");
        assert!(values.lines().count() > 3000 && values.contains("X.LOAD"));
        // Single values stand on the twin.
        let twin = std::fs::read_to_string(place.path("out").join("as-executed.stpnc")).expect("a twin");
        assert!(twin.contains("S1.ROTARY_VELOCITY.ACTUAL") && twin.contains("get_time first cut"));
    }
}

#[test]
fn the_sample_runs_and_keeps_what_it_says() {
    let sample = repository().join("../shared/samples/stepnc/ap238/plate_trace_functions_e3.stpnc");
    if !sample.exists() {
        eprintln!("skipped: ../shared/samples is not there");
        return;
    }
    let place = Place::new();
    let told = place.json(&["run", &sample.display().to_string(), "--fast"]);
    let records = recorded(&told);
    for name in [
        "log_nc_machine_data",
        "get_operator_data",
        "set_edit_access_level",
        "start_tool_logging",
        "start_synchronized_action",
        "stop_synchronized_action",
        "start_sensor_recording",
        "stop_sensor_recording",
        "get_time",
    ] {
        assert!(records.contains(name), "{name}: {records:?}");
    }
    // Along one path: loads of X and Y, every fourth cycle.
    let along = told["functions"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|r| r["data"]["id"] == "path" && r["data"]["state"] == "started")
        .expect("a recording along a path");
    assert_eq!(
        (&along["data"]["cycles"], &along["data"]["streams"][1]["name"]),
        (&4.into(), &"Y.LOAD".into())
    );
}

#[test]
fn a_check_names_code_and_place_of_what_is_wrong() {
    let place = Place::new();
    let around = |functions: &str| format!("O1\nG21 G90 G54\n{functions}\nG0 X10.\nM30\n");
    for (functions, code, line) in [
        ("(trace:1 stop_sensor_recording its_function_id=1)", "T-01", 3),
        (
            "(trace:1 start_tool_logging its_function_id=1)\n(trace:1 start_tool_logging its_function_id=1)",
            "T-02",
            4,
        ),
        (
            "(trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"humidity > 3\" its_actions=\"get_time\")",
            "T-06",
            3,
        ),
        ("(trace:1 get_drive_load its_axis=X its_variable=sensor:X.LOAD)", "T-07", 3),
        (
            "(trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_actions=\"stop_tool_logging its_function_id=1\")",
            "T-08",
            3,
        ),
        ("(trace:1 read_sensor_value its_sensor=coolant_flow required=ON)", "T-05", 3),
        ("G81 X1. Z-1. R1. F100.\n(trace:1 get_time)\nG80", "T-12", 4),
    ] {
        let file = place.program("bad.nc", &around(functions));
        let checked = place.json(&["check", &file]);
        let fails: Vec<String> = checked["checks"]
            .as_array()
            .into_iter()
            .flatten()
            .filter(|c| c["state"] == "fail")
            .filter_map(|c| c["text"].as_str().map(str::to_owned))
            .collect();
        let place_of = format!("bad.nc:{line}:");
        assert!(
            fails.iter().any(|text| text.contains(&place_of) && text.contains(code)),
            "{code}: {fails:?}"
        );
        let run = place.run(&["run", &file, "--fast"]);
        assert_eq!(run.status.code(), Some(1), "{code}: nothing is moved");
    }
    let file = place.program(
        "odd.nc",
        &around("(trace:1 paint_part colour=red)\n(trace:1 get_time its_lable=x)"),
    );
    let checked = place.json(&["check", &file]).to_string();
    assert!(
        checked.contains("paint_part") && checked.contains("is kept and shown"),
        "{checked}"
    );
    assert!(
        checked.contains("odd.nc:4:19") && checked.contains("write its_label"),
        "{checked}"
    );
}

/// The bracket with these instances behind its own; `@LINE@` in them is the function that was put before `face top`.
fn bracket_with(place: &Place, line: Option<&str>, instances: &str) -> String {
    let corpus = repository().join("corpus/bracket.stpnc").display().to_string();
    let edited = place.path("edited.stpnc").display().to_string();
    let mut words = vec!["edit", &corpus, "--out", &edited];
    words.extend(line.into_iter().flat_map(|line| ["--insert", "face top", line]));
    let output = place.run(&words);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(&edited).expect("edited");
    let function = text.lines().rfind(|line| line.contains("MACHINING_NC_FUNCTION("));
    let id = function.and_then(|line| line.split('=').next()).unwrap_or("#748");
    let (before, after) = text.rsplit_once("ENDSEC;").expect("a data section");
    place.program(
        "typed.stpnc",
        &format!("{before}{}ENDSEC;{after}", instances.replace("@LINE@", id)),
    )
}

/// A typed condition `ws_time > so many seconds` of the function.
fn typed_over(seconds: f64) -> String {
    format!(
        "#90000=ACTION_PROPERTY('condition','',@LINE@);\n#90001=ACTION_PROPERTY_REPRESENTATION('','',#90000,#90002);\n\
         #90002=REPRESENTATION('',(#90003),#90009);\n#90003=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#90004);\n\
         #90004=COMPARISON_LESS((#90005,#90006));\n#90005=REAL_LITERAL({seconds:?});\n#90006=REAL_NUMERIC_VARIABLE();\n\
         #90007=EXPRESSION_ITEM_REPRESENTATION_ITEM('trace:ws_time',#90006);\n#90009=REPRESENTATION_CONTEXT('','');\n"
    )
}

#[test]
fn a_typed_condition_is_the_line_s_or_takes_its_place_or_is_refused() {
    let place = Place::new();
    let line = |condition: &str| {
        format!(
            "trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN {condition} its_actions=\"set_alarm its_alarm_id=1 its_text=late\""
        )
    };
    let with_text = line("its_condition=\"ws_time > 5 s\"");
    // The same, turned round and without unit.
    let same = bracket_with(&place, Some(&with_text), &typed_over(5.0));
    let checked = place.json(&["check", &same]).to_string();
    assert!(!checked.contains("T-06"), "{checked}");
    // Only the typed one: it fires, it is posted, and an edit keeps it.
    let only = bracket_with(&place, Some(&line("")), &typed_over(5.0));
    let told = place.json(&["run", &only, "--fast"]);
    let fired = told["functions"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|r| r["data"]["state"] == "fired")
        .unwrap_or_else(|| panic!("it fires: {told:#}"));
    assert_eq!(fired["data"]["condition"], "5 < trace:ws_time");
    let posted = place.path("p.mpf").display().to_string();
    place.json(&["post", &only, "--control", "siemens-840d", "--out", &posted]);
    let text = std::fs::read_to_string(&posted).expect("posted");
    assert!(text.contains("WHEN $AC_TIMER[1]>5 DO"), "{text}");
    let saved = place.path("saved.stpnc").display().to_string();
    let edited = place.run(&["edit", &only, "--out", &saved, "--disable", "wave groove"]);
    assert!(edited.status.success());
    let text = std::fs::read_to_string(&saved).expect("edited");
    assert!(typed_over(5.0).lines().skip(1).all(|line| text.contains(line)));
    // Another one.
    let other = bracket_with(&place, Some(&with_text), &typed_over(6.0));
    let text = std::fs::read_to_string(&other).expect("written");
    let line = text
        .lines()
        .position(|line| line.contains("'extended function'"))
        .expect("the function")
        + 1;
    let place_of = format!("typed.stpnc:{line}:");
    for command in ["check", "run"] {
        let output = place.run(&[command, &other]);
        let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{command}: {said}");
        for part in ["T-06", &place_of, "ws_time > 5 s", "6 < trace:ws_time"] {
            assert!(said.contains(part), "{command}: no {part}: {said}");
        }
    }
}

#[test]
fn an_assignment_to_what_is_the_machine_s_is_refused_by_check_and_run_with_its_place() {
    let place = Place::new();
    // First in workplan `OP10 top`, behind a condition that is not fulfilled.
    let assignment = |variable: &str| {
        format!(
            "#90100=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#748,#90101,0.5);\n#90101=MACHINING_PROCESS_EXECUTABLE('never','if statement','','');\n\
             #90102=ACTION_PROPERTY('condition','',#90101);\n#90103=ACTION_PROPERTY_REPRESENTATION('','',#90102,#90104);\n\
             #90104=REPRESENTATION('',(#90105),#90009);\n#90105=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#90106);\n#90106=BOOLEAN_LITERAL(.F.);\n\
             #90107=MACHINING_PROCESS_BRANCH_RELATIONSHIP('true branch','',#90101,#90110);\n\
             #90110=MACHINING_PROCESS_EXECUTABLE('set the load','assignment','','');\n\
             #90111=ACTION_PROPERTY('lvalue','',#90110);\n#90112=ACTION_PROPERTY_REPRESENTATION('','',#90111,#90113);\n\
             #90113=REPRESENTATION('',(#90114),#90009);\n#90114=EXPRESSION_ITEM_REPRESENTATION_ITEM('{variable}',#90115);\n\
             #90115=REAL_NUMERIC_VARIABLE();\n#90121=ACTION_PROPERTY('rvalue','',#90110);\n\
             #90122=ACTION_PROPERTY_REPRESENTATION('','',#90121,#90123);\n#90123=REPRESENTATION('',(#90124),#90009);\n\
             #90124=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#90125);\n#90125=REAL_LITERAL(1.);\n#90009=REPRESENTATION_CONTEXT('','');\n"
        )
    };
    for variable in ["sensor:X.LOAD", "trace:ws_time"] {
        let program = bracket_with(&place, None, &assignment(variable));
        let text = std::fs::read_to_string(&program).expect("written");
        let line = text
            .lines()
            .position(|line| line.starts_with("#90110="))
            .expect("it is there")
            + 1;
        for command in ["check", "run"] {
            let output = place.run(&[command, &program]);
            let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{command}: {said}");
            for part in ["T-07", &format!("typed.stpnc:{line}:"), "'set the load'", variable] {
                assert!(said.contains(part), "{command}: no {part}: {said}");
            }
        }
        let jobs = place.json(&["trace", "list"]);
        assert_eq!(jobs["jobs"].as_array().map(Vec::len), Some(0), "nothing was moved: {jobs:#}");
    }
    let own = bracket_with(&place, None, &assignment("LOAD_LIMIT"));
    let output = place.run(&["check", &own]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn a_function_that_is_unknown_here_is_kept_when_a_program_is_saved_converted_run_and_posted() {
    let place = Place::new();
    let line = "trace:1 paint_part colour=red  shade=\"x y\"";
    let bracket = repository().join("corpus/bracket.stpnc").display().to_string();
    let [first, second, converted, posted] =
        ["a.stpnc", "b.stpnc", "c.stpnc", "d.nc"].map(|name| place.path(name).display().to_string());
    let good = |words: &[&str]| {
        let output = place.run(words);
        assert!(
            output.status.success(),
            "{words:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    };
    good(&["edit", &bracket, "--out", &first, "--insert", "face top", line]);
    good(&["edit", &first, "--out", &second, "--disable", "wave groove"]);
    let text = |path: &str| std::fs::read_to_string(path).expect("written");
    assert!(
        text(&first).contains(line) && text(&second).contains(line),
        "an edit elsewhere leaves it as it stands"
    );
    let out = place.path("out").display().to_string();
    let told = place.json(&["run", &second, "--fast", "--out", &out]);
    assert!(recorded(&told).contains("paint_part"), "{told:#}");
    assert!(text(&format!("{out}/as-executed.stpnc")).contains(line));

    let program = place.program("p.nc", &format!("O1\nG21 G90 G54\n({line})\nG0 X10.\nM30\n"));
    good(&["convert", &program, "--out", &converted]);
    assert!(text(&converted).contains(line), "{}", text(&converted));
    place.run(&["post", &program, "--control", "fanuc", "--out", &posted]);
    assert!(text(&posted).contains("PAINT"), "{}", text(&posted));
}

#[test]
fn actions_of_the_table_are_what_the_manual_says() {
    // A function line in the manual's examples is what it says it is.
    for function in FUNCTIONS {
        let parsed = parse(function.example).expect("an example is read");
        assert_ne!(parsed.call, Call::Unknown, "{}", function.name);
    }
}

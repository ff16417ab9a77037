//! Live jobs on a controller in its own process: cut while they are still coming, as good as from a file, stopped, and harmed by nothing
//! that an add-in says.

#[path = "support/machine_side.rs"]
mod machine_side;

use machine_side::{AddIn, Controller, files_of, machine_file, operation, report, toolmark, words};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Stdio};

/// `toolmark live` on a controller, with an add-in that has said who it is.
struct Live {
    child: Child,
    told: BufReader<ChildStdout>,
    add_in: AddIn,
    out: PathBuf,
}

impl Live {
    fn begin(controller: &Controller, machine: &str, folder: &Path, name: &str) -> Live {
        let out = folder.join(name);
        let args = [
            "live",
            "--machine",
            &controller.address,
            "--machine-file",
            machine,
            "--listen",
            "127.0.0.1:0",
            "--json",
        ];
        let mut child = toolmark(&args, &folder.join("data"))
            .arg("--out")
            .arg(&out)
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts");
        let mut told = BufReader::new(child.stdout.take().expect("piped"));
        let mut line = String::new();
        told.read_line(&mut line).expect("it says where it is");
        let first: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line}"));
        let mut add_in = AddIn::connect(first["address"].as_str().expect("an address"));
        add_in.say("what is this?");
        assert!(add_in.hear("refused").is_some_and(|r| r["line"] == 1));
        add_in.say(r#"{"connect":{"client":"a test","job":"plate"}}"#);
        let connected = add_in.hear("connected").expect("an answer");
        assert_eq!(
            (&connected["machine"], &connected["simulated"]),
            (&Value::from("sim-mill"), &Value::from(true))
        );
        add_in.say(r#"{"start":{}}"#);
        Live {
            child,
            told,
            add_in,
            out,
        }
    }

    /// Waits until an operation is being cut.
    fn cuts(&mut self, operation: u64) -> Value {
        loop {
            let progress = self.add_in.hear("progress").expect("the job goes on");
            if progress["operation"] == operation {
                return progress;
            }
        }
    }

    #[track_caller]
    fn check_refused(&mut self, line: &str, expected: &str) {
        self.add_in.say(line);
        let refused = self.add_in.hear("refused").expect("an answer");
        let why = refused["why"].as_str().expect("a reason");
        assert!(why.contains(expected), "{expected:?} was expected: {why}");
    }

    /// Its last word, its answer and its exit code.
    fn ends(mut self) -> (Value, Value, Option<i32>) {
        let done = self.add_in.hear("done").expect("its last word");
        let mut rest = String::new();
        self.told.read_to_string(&mut rest).expect("its answer");
        let code = self.child.wait().expect("it ends").code();
        let answer: Value = serde_json::from_str(&rest).unwrap_or_else(|e| panic!("{e}: {rest}"));
        println!("{} {}", answer["ended"], answer["driven"]);
        (done, answer, code)
    }
}

/// The tree of a STEP-NC file without numbers and times: what is in what, of which kind, with which name and tool.
fn shape(file: &Path, data: &Path) -> Value {
    fn of(part: &Value) -> Value {
        let all = |name: &str| -> Vec<Value> { part[name].as_array().into_iter().flatten().map(of).collect() };
        json!({
            "type": part["type"],
            "name": part["name"],
            "enabled": part["enabled"],
            "tool": part["tool"],
            "children": all("children"),
            "toolpaths": all("toolpaths"),
        })
    }
    let done = toolmark(&["inspect", &file.display().to_string(), "--json"], data)
        .output()
        .expect("it runs");
    let told: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
    Value::from(told["tree"].as_array().expect("a tree").iter().map(of).collect::<Vec<_>>())
}

#[test]
fn a_job_cut_while_it_comes_is_as_good_as_from_its_file_and_no_file_is_written_before_its_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let data = folder.path().join("data");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let mut live = Live::begin(&controller, &machine, folder.path(), "live");
    live.add_in.say(&operation("one", -1.0, 20.0));
    assert!(live.add_in.hear("accepted").is_some_and(|a| a["operation"] == 1));
    live.check_refused(&operation("wrong", -1.0, 90_000.0), "axis X would have to go to");
    for (number, name) in [(1, "two"), (2, "three")] {
        // It is cutting the operation before, and only then the next one is said.
        let progress = live.cuts(number);
        assert_eq!(progress["operations"], number, "nothing more has been said yet");
        let programs = files_of(folder.path(), &["stpnc", "nc", "mpf", "ngc"]);
        assert!(programs.is_empty(), "no file passes between: {programs:?}");
        live.add_in.say(&operation(name, -1.0 - number as f64, 20.0));
    }
    live.add_in.say(r#"{"end":{}}"#);
    let out = live.out.clone();
    let (done, answer, code) = live.ends();
    assert_eq!(code, Some(0), "{answer}");
    assert_eq!(
        (&done["ended"], &done["verdict"]),
        (&Value::from("completed"), &Value::from("good"))
    );
    let steps = answer["report"]["workingsteps"].as_array().expect("workingsteps");
    let names: Vec<&str> = steps.iter().filter_map(|w| w["name"].as_str()).collect();
    assert_eq!(names, ["one", "two", "three"]);

    // Rebuilding from its plan, which is a file now, says the same.
    let again = folder.path().join("again.stpnc");
    let plan = out.join("plan.stpnc").display().to_string();
    let record = out.join("record.parquet").display().to_string();
    let rebuilt = toolmark(&["rebuild", &plan, &record, "--json"], &data)
        .arg("--out")
        .arg(&again)
        .output()
        .expect("it runs");
    let rebuilt: Value = serde_json::from_slice(&rebuilt.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&rebuilt)));
    for (a, b) in steps.iter().zip(rebuilt["workingsteps"].as_array().expect("workingsteps")) {
        assert_eq!((&a["name"], &a["dev_max_mm"]), (&b["name"], &b["dev_max_mm"]));
    }
    let both = out.join("as-executed.stpnc");
    let compare = ["compare", &both.display().to_string(), "--json", "--tolerance", "0.05"];
    let compared = toolmark(&compare, &data).output().expect("it runs");
    assert_eq!(compared.status.code(), Some(0), "{}", words(&compared));

    // A run of that file: the same verdict, deviations as of another part on the same machine, and an as-executed program of the same shape.
    let from_file = folder.path().join("from-file");
    let run = ["run", &plan, "--machine", &machine, "--fast", "--json"];
    let run = toolmark(&run, &data).arg("--out").arg(&from_file).output().expect("it runs");
    assert_eq!(run.status.code(), Some(0), "{}", words(&run));
    let filed = report(&from_file);
    assert_eq!(
        (&filed["verdict"], filed["feed_runs"].as_u64()),
        (&Value::from("good"), answer["report"]["feed_runs"].as_u64())
    );
    let filed_steps = filed["workingsteps"].as_array().expect("workingsteps");
    assert_eq!(filed_steps.len(), steps.len());
    for (a, b) in steps.iter().zip(filed_steps) {
        assert_eq!(
            (&a["name"], &a["verdict"], &a["tolerance_mm"]),
            (&b["name"], &b["verdict"], &b["tolerance_mm"])
        );
        // A planner that knows more of what comes rounds corners otherwise, within the same tolerance.
        for what in ["dev_p95_mm", "dev_rms_mm", "dev_max_mm"] {
            let [live, filed] = [a, b].map(|w| w[what].as_f64().expect("a number"));
            assert!(
                (live - filed).abs() <= 0.005,
                "{what} of {}: {live} live, {filed} from the file",
                a["name"]
            );
        }
    }
    assert_eq!(shape(&both, &data), shape(&from_file.join("as-executed.stpnc"), &data));
    assert_eq!(controller.end()["at_rest"], true);
}

#[test]
fn stop_in_the_middle_is_a_controlled_one_and_record_report_and_as_executed_say_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let data = folder.path().join("data");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    for (name, says_stop) in [("asked", true), ("gone", false)] {
        let mut live = Live::begin(&controller, &machine, folder.path(), name);
        live.add_in.say(&operation("one", -1.0, 60.0));
        assert!(live.add_in.hear("accepted").is_some());
        live.cuts(1);
        if says_stop {
            live.add_in.say(r#"{"stop":{}}"#);
        } else {
            // An add-in that crashes says nothing any more; the answer of the machine's side is heard all the same.
            live.add_in.hang_up();
        }
        let out = live.out.clone();
        let (done, answer, code) = live.ends();
        assert_eq!(code, Some(1), "{answer}");
        let text = "controlled stop: stop was asked";
        assert_eq!((&done["ended"], &done["text"]), (&Value::from("stopped"), &Value::from(text)));
        let findings = report(&out)["findings"].to_string();
        assert!(
            findings.contains("the run did not come to its end: controlled stop"),
            "{findings}"
        );
        assert!(answer["rows"].as_u64() > Some(100) && out.join("record.parquet").is_file());
        let executed = std::fs::read_to_string(out.join("as-executed.stpnc")).expect("what came until then");
        assert!(executed.contains(text), "the as-executed program says how it ended");
        let shown = toolmark(&["trace", "list", "--json"], &data).output().expect("it runs");
        let jobs: Value = serde_json::from_slice(&shown.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&shown)));
        assert!(jobs.to_string().contains("plate.stpnc"), "{jobs}");
    }
    assert_eq!(controller.end()["at_rest"], true);
}

#[test]
fn whatever_an_add_in_says_wrong_is_refused_with_the_reason_and_the_job_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let mut live = Live::begin(&controller, &machine, folder.path(), "live");
    live.add_in.say(&operation("one", -1.0, 20.0));
    assert!(live.add_in.hear("accepted").is_some_and(|a| a["operation"] == 1));
    live.cuts(1);
    let with = |head: &str, moves: &str| format!(r#"{{"operation":{{"name":"bad",{head},"moves":[{moves}]}}}}"#);
    let turns = r#""tool":{"number":1},"spindle":{"rpm":6000}"#;
    let line = r#"{"line":{"to":[1,1,1],"feed_mm_min":100}}"#;
    live.check_refused(
        &with(r#""tool":{"number":4711},"spindle":{"rpm":6000}"#, line),
        "does not know tool 4711: give its length_mm",
    );
    live.check_refused(
        &with(r#""tool":{"number":1,"length_mm":80},"spindle":{"rpm":6000}"#, line),
        "tool 1 is 120 mm long on this machine",
    );
    live.check_refused(
        &with(r#""tool":{"number":1}"#, line),
        "move 1 is a feed move and the spindle stands",
    );
    live.check_refused(
        &with(r#""tool":{"number":1},"spindle":{"rpm":1e9}"#, line),
        "at most 18000 are needed",
    );
    live.check_refused(&with(turns, r#"{"rapid":{"to":[0,0,9000]}}"#), "axis Z would have to go to");
    live.check_refused(&with(turns, r#"{"rapid":{"to":[0,0,NaN]}}"#), "column");
    live.check_refused(&with(turns, r#"{"rapid":{"to":[0,0,1e999]}}"#), "number out of range");
    live.check_refused(&with(turns, r#"{"rapid":{"to":[0,0,null]}}"#), "expected f64");
    live.check_refused(
        &with(turns, r#"{"line":{"to":[1,1,1],"feed_mm_min":-100}}"#),
        "a feed of -100 mm/min",
    );
    live.check_refused(&with(turns, r#"{"fly":{"to":[1,1,1]}}"#), "unknown variant `fly`");
    live.check_refused(&with(turns, ""), "1 to 1000000 moves");
    live.check_refused(&format!("{}1{}", "[".repeat(100_000), "]".repeat(100_000)), "column");
    live.check_refused(
        &format!(r#"{{"connect":{{"client":"{}","job":"x"}}}}"#, "a".repeat(1 << 20)),
        "connect was said before",
    );
    // Longer than any line may be; what is behind its end counts again.
    live.check_refused(
        &"x".repeat((128 << 20) + 5),
        "does not end within 134217728 bytes: split the operation",
    );
    live.add_in.say(&operation("two", -2.0, 20.0));
    assert!(
        live.add_in.hear("accepted").is_some_and(|a| a["operation"] == 2),
        "nothing of it is part of the job"
    );
    live.add_in.say(r#"{"end":{}}"#);
    let (done, answer, code) = live.ends();
    assert_eq!(
        (code, &done["ended"], &done["verdict"]),
        (Some(0), &Value::from("completed"), &Value::from("good")),
        "{answer}"
    );
    let end = controller.end();
    assert_eq!(
        (&end["at_rest"], &end["starvations"].is_u64()),
        (&Value::from(true), &true),
        "{end}"
    );
}

//! The machine side as a process of its own: driven over both links, by a live job, refused, stopped, and over certificates.
//!
//! Real time on a shared computer: a run that the system kept from its processor for longer than the machine file allows ends in a
//! controlled stop, counts it, and is tried again. What a run must be when it completes is asserted, never how long it takes.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

const PLATE: &str = "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nS3000 M3\nM8\nG0 X0. Y0. Z10.\nG1 Z-1. F600.\nX20. F1500.\nY15.\nG3 X10. Y25. I-10. J0.\n\
                     G1 X0.\nY0.\nG0 Z10.\nM9\nM5\nM30\n%\n";

fn toolmark(args: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
    command.args(args).env("TOOLMARK_DATA", data);
    command
}

fn words(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// A mill that forgives a shared computer its gaps, and whatever else is said.
fn machine_file(folder: &Path, more: &str) -> String {
    let mill = include_str!("../../store/machines/sim-mill.toml");
    let text = mill.replacen("kind = \"mill\"", "late_ticks_allowed = 60\nkind = \"mill\"", 1);
    let text = text.replacen("tool_change_s = 2.5", "tool_change_s = 0.2", 1);
    let path = folder.join("mill.toml");
    std::fs::write(&path, format!("{text}\n{more}")).expect("written");
    path.display().to_string()
}

struct Controller {
    child: Child,
    out: BufReader<ChildStdout>,
    address: String,
}

impl Controller {
    fn begin(machine: &str, more: &[&str], data: &Path) -> Controller {
        let mut args = vec!["controller", "--json", "--machine", machine];
        if !more.contains(&"--port") {
            args.extend(["--port", "0"]);
        }
        args.extend(more);
        let mut child = toolmark(&args, data)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        let mut out = BufReader::new(child.stdout.take().expect("piped"));
        let mut line = String::new();
        out.read_line(&mut line).expect("it says where it is");
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"));
        let address = told["address"].as_str().expect("an address").to_owned();
        assert!(told["lacks"].is_array() && told["simulated"] == true, "{told}");
        Controller { child, out, address }
    }

    /// Ctrl-C: what it says at its end.
    fn end(mut self) -> Value {
        interrupt(&self.child);
        let mut text = String::new();
        self.out.read_to_string(&mut text).expect("it says how it was");
        let status = self.child.wait().expect("it ends");
        assert!(status.success(), "{status} {text}");
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"))
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn interrupt(child: &Child) {
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "kill -INT");
}

fn report(folder: &Path) -> Value {
    let text = std::fs::read(folder.join("report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

/// True for a run that only the shared computer has ended.
fn was_late(answer: &Value) -> bool {
    answer["ended"] != "completed" && answer["driven"]["late_ticks"].as_u64() > Some(0)
}

#[test]
fn two_processes_machine_parts_over_the_default_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let data = folder.path().join("data");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let mut completed = 0;
    for attempt in 0..6 {
        let out = folder.path().join(format!("out-{attempt}"));
        let args = [
            "run",
            &plate.display().to_string(),
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--json",
        ];
        let done = toolmark(&args, &data).arg("--out").arg(&out).output().expect("it runs");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        println!("{attempt}: {} {}", answer["ended"], answer["driven"]);
        if was_late(&answer) {
            continue;
        }
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &Value::from("completed")),
            "{}",
            words(&done)
        );
        let told = report(&out);
        assert_eq!(
            (&told["verdict"], &told["simulated"]),
            (&Value::from("good"), &Value::from(true)),
            "{told}"
        );
        let driven = &told["driven"];
        assert_eq!(driven["controller"], controller.address);
        assert!(
            driven["following_error_max_mm"]
                .as_array()
                .is_some_and(|axes| axes.iter().all(|mm| mm.as_f64() < Some(0.5))),
            "{driven}"
        );
        assert!(driven["following_error_rms_mm"][0].as_f64() > Some(0.0), "{driven}");
        assert!(
            driven["buffer_mean_ms"].as_f64() > Some(50.0) && driven["late_ticks"].is_u64(),
            "{driven}"
        );
        let page = std::fs::read_to_string(out.join("report.html")).expect("a page");
        assert!(page.contains("following error X, Y, Z") && page.contains("SIMULATED"));
        assert!(out.join("as-executed.stpnc").is_file() && out.join("record.parquet").is_file());
        completed += 1;
        // The second part begins where the first one left the machine.
        if completed == 2 {
            break;
        }
    }
    assert_eq!(completed, 2, "of six runs");
    let end = controller.end();
    assert_eq!(
        (&end["at_rest"], &end["refused"]),
        (&Value::from(true), &Value::from(0)),
        "{end}"
    );
    assert!(
        end["senders"].as_u64() >= Some(2) && end["lateness"]["cycles"].as_u64() > Some(1000),
        "{end}"
    );
    assert!(
        end["lateness"]["histogram"].as_array().is_some_and(|bars| !bars.is_empty()),
        "{end}"
    );
}

#[test]
fn the_text_protocol_machines_the_same_part_and_the_controller_keeps_the_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    // A port that was free a moment ago.
    let reports = TcpListener::bind("127.0.0.1:0")
        .and_then(|l| l.local_addr())
        .expect("a port")
        .port()
        .to_string();
    let records = folder.path().join("records");
    let data = folder.path().join("data");
    let mut verdict = String::new();
    for attempt in 0..5 {
        let kept = records.join(attempt.to_string());
        let kept_text = kept.display().to_string();
        let more = ["--link", "text", "--report-port", &reports, "--record", &kept_text];
        let controller = Controller::begin(&machine, &more, &folder.path().join("other"));
        let plate_text = plate.display().to_string();
        let mut args = vec![
            "run",
            &plate_text,
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--json",
        ];
        args.extend(["--link", "text", "--report-port", &reports]);
        let done = toolmark(&args, &data).output().expect("it runs");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &Value::from("sent")),
            "{}",
            words(&done)
        );
        assert!(answer["lines"].as_u64() > Some(1000), "{answer}");
        // It cuts on for the time that lines were ahead, and for tool and spindle; then its record is closed.
        let record = kept.join("run-0001.parquet");
        let until = Instant::now() + Duration::from_secs(40);
        while !record.exists() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
        let end = controller.end();
        println!("{attempt}: {end}");
        let rebuilt = folder.path().join("rebuilt.stpnc");
        let args = [
            "rebuild",
            &plate.display().to_string(),
            &record.display().to_string(),
            "--machine",
            &machine,
            "--json",
        ];
        let done = toolmark(&args, &data).arg("--out").arg(&rebuilt).output().expect("it runs");
        let told: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        verdict = told["verdict"].as_str().unwrap_or_default().to_owned();
        if verdict == "good" {
            break;
        }
        println!("{told}");
        assert!(
            end["late_ticks"].as_u64() > Some(0),
            "only a late machine may leave it incomplete: {told}"
        );
    }
    assert_eq!(verdict, "good");
}

/// A CAM add-in.
struct AddIn {
    out: TcpStream,
    lines: BufReader<TcpStream>,
}

impl AddIn {
    fn connect(address: &str) -> AddIn {
        let out = TcpStream::connect(address).expect("it listens");
        out.set_read_timeout(Some(Duration::from_secs(60))).expect("a time-out");
        let lines = BufReader::new(out.try_clone().expect("a second handle"));
        AddIn { out, lines }
    }
    fn say(&mut self, line: &str) {
        self.out
            .write_all(format!("{}\n", line.replace('\n', " ")).as_bytes())
            .expect("it hears");
    }
    /// The next line of this kind; those of another are passed over.
    fn hear(&mut self, kind: &str) -> Option<Value> {
        loop {
            let mut line = String::new();
            if self.lines.read_line(&mut line).ok()? == 0 {
                return None;
            }
            let mut heard: Value = serde_json::from_str(&line).expect("a line of JSON");
            if heard.get(kind).is_some() {
                return Some(heard[kind].take());
            }
            if kind != "done" && heard.get("done").is_some() {
                println!("{heard}");
                return None;
            }
        }
    }
}

fn operation(name: &str, z: f64, size: f64) -> String {
    format!(
        r#"{{"operation":{{"name":"{name}","tool":{{"number":1,"length_mm":120}},"spindle":{{"rpm":6000}},"coolant":{{"flood":true}},
        "moves":[{{"rapid":{{"to":[0,0,5]}}}},{{"line":{{"to":[0,0,{z}],"feed_mm_min":600}}}},{{"line":{{"to":[{size},0,{z}],"feed_mm_min":1500}}}},
        {{"arc":{{"to":[{size},10,{z}],"centre":[{size},5,{z}],"direction":"ccw","feed_mm_min":1200}}}},
        {{"line":{{"to":[0,10,{z}],"feed_mm_min":1500}}}},{{"line":{{"to":[0,0,{z}],"feed_mm_min":1500}}}},{{"rapid":{{"to":[0,0,5]}}}}]}}}}"#
    )
}

#[test]
fn a_scripted_add_in_gives_operations_while_the_machine_is_cutting() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let data = folder.path().join("data");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    for attempt in 0..5 {
        let out = folder.path().join(format!("live-{attempt}"));
        let args = [
            "live",
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--listen",
            "127.0.0.1:0",
            "--json",
        ];
        let mut live = toolmark(&args, &data)
            .arg("--out")
            .arg(&out)
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts");
        let mut told = BufReader::new(live.stdout.take().expect("piped"));
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
        add_in.say(&operation("one", -1.0, 20.0));
        assert!(add_in.hear("accepted").is_some_and(|a| a["operation"] == 1));
        add_in.say(&operation("wrong", -1.0, 90_000.0));
        let why = add_in.hear("refused").expect("an answer");
        assert!(
            why["why"]
                .as_str()
                .is_some_and(|why| why.contains("axis X would have to go to")),
            "{why}"
        );
        let mut cut_while_coming = true;
        for (number, name) in [(1, "two"), (2, "three")] {
            // It is cutting the operation before, and only then the next one is said.
            loop {
                match add_in.hear("progress") {
                    Some(progress) if progress["operation"] == number => {
                        assert_eq!(progress["operations"], number, "nothing more has been said yet");
                        break;
                    }
                    Some(_) => {}
                    None => {
                        cut_while_coming = false;
                        break;
                    }
                }
            }
            if cut_while_coming {
                add_in.say(&operation(name, -1.0 - f64::from(number), 20.0));
            }
        }
        if cut_while_coming {
            add_in.say(r#"{"end":{}}"#);
        }
        let done = add_in.hear("done");
        let mut rest = String::new();
        told.read_to_string(&mut rest).expect("its answer");
        let status = live.wait().expect("it ends");
        let answer: Value = serde_json::from_str(&rest).unwrap_or_else(|e| panic!("{e}: {rest}"));
        println!("{attempt}: {} {}", answer["ended"], answer["driven"]);
        if was_late(&answer) {
            continue;
        }
        assert!(cut_while_coming && status.success(), "{status} {answer}");
        assert!(done.is_some_and(|done| done["ended"] == "completed" && done["verdict"] == "good"));
        let steps = answer["report"]["workingsteps"].as_array().expect("workingsteps");
        let names: Vec<&str> = steps.iter().filter_map(|w| w["name"].as_str()).collect();
        assert_eq!(names, ["one", "two", "three"]);

        // As good as from a file: the plan is a file now, and rebuilding from it says the same.
        let again = folder.path().join("again.stpnc");
        let (plan, record) = (
            out.join("plan.stpnc").display().to_string(),
            out.join("record.parquet").display().to_string(),
        );
        let rebuilt = toolmark(&["rebuild", &plan, &record, "--json"], &data)
            .arg("--out")
            .arg(&again)
            .output()
            .expect("it runs");
        let rebuilt: Value = serde_json::from_slice(&rebuilt.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&rebuilt)));
        for (a, b) in steps.iter().zip(rebuilt["workingsteps"].as_array().expect("workingsteps")) {
            assert_eq!((&a["name"], &a["dev_max_mm"]), (&b["name"], &b["dev_max_mm"]));
        }
        let both = out.join("as-executed.stpnc").display().to_string();
        let compared = toolmark(&["compare", &both, "--json", "--tolerance", "0.05"], &data)
            .output()
            .expect("it runs");
        assert_eq!(compared.status.code(), Some(0), "{}", words(&compared));
        return;
    }
    panic!("five live jobs were kept from the processor");
}

#[test]
fn a_stop_by_ctrl_c_is_a_controlled_one_and_a_second_driver_is_told_who_drives() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE.replace("F1500.", "F60.")).expect("written");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let plate_text = plate.display().to_string();
    let args = [
        "run",
        &plate_text,
        "--machine",
        &controller.address,
        "--machine-file",
        &machine,
        "--json",
    ];
    for attempt in 0..4 {
        let data = folder.path().join(format!("data-{attempt}"));
        let mut first = toolmark(&args, &data)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        std::thread::sleep(Duration::from_secs(5));
        let second = toolmark(&args, &folder.path().join("data-of-another"))
            .output()
            .expect("it runs");
        assert_eq!(second.status.code(), Some(4), "{}", words(&second));
        assert!(words(&second).contains("is driven by 'plate.nc of"), "{}", words(&second));
        interrupt(&first);
        let mut text = String::new();
        first
            .stdout
            .take()
            .expect("piped")
            .read_to_string(&mut text)
            .expect("its answer");
        let status = first.wait().expect("it ends");
        let answer: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
        println!("{attempt}: {}", answer["text"]);
        assert_eq!(status.code(), Some(1), "{answer}");
        if answer["text"] == "controlled stop: stop was asked" {
            return;
        }
        assert!(was_late(&answer), "{answer}");
    }
    panic!("four runs were kept from the processor");
}

#[test]
fn what_cannot_be_driven_says_why_with_its_exit_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let data = folder.path().join("data");
    let check = |args: &[&str], exit: i32, expected: &str| {
        let done = toolmark(args, &data).output().expect("it runs");
        assert_eq!(done.status.code(), Some(exit), "{args:?}: {}", words(&done));
        assert!(words(&done).contains(expected), "{args:?}: {}", words(&done));
    };
    let closed = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port");
    check(
        &["run", &plate, "--machine", &format!("tcp://{closed}")],
        4,
        "is toolmark controller running there?",
    );
    check(&["run", &plate, "--machine", "tcp://127.0.0.1"], 2, "the port is missing");
    check(&["run", &plate, "--machine", "udp://127.0.0.1:1"], 2, "only tcp:// is known");
    check(
        &["run", &plate, "--machine", "tcp://127.0.0.1:1", "--fast"],
        2,
        "a controller runs in real time",
    );
    check(
        &["run", &plate, "--link", "text"],
        2,
        "--link text is for a machine behind tcp://",
    );
    check(
        &["check", &plate, "--machine", "tcp://127.0.0.1:1"],
        2,
        "only run and live drive a controller",
    );
    check(
        &["controller", "--listen", "0.0.0.0", "--port", "0"],
        2,
        "give certificate, key and authority in [link]",
    );
    check(
        &["controller", "--listen", "0.0.0.0", "--link", "text"],
        2,
        "give certificate, key and authority",
    );
    check(&["controller", "--pad", "/dev/input/no-such"], 4, "--pad /dev/input/no-such");
    check(&["live", "--listen", "0.0.0.0:0"], 2, "for programs on this computer");

    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    // Another machine: its X is slower.
    let slower = folder.path().join("slower.toml");
    let text = std::fs::read_to_string(&machine)
        .expect("the file")
        .replacen("v_max_mm_s = 500.0", "v_max_mm_s = 400.0", 1);
    std::fs::write(&slower, text).expect("written");
    let slower = slower.display().to_string();
    check(
        &["run", &plate, "--machine", &controller.address, "--machine-file", &slower],
        4,
        "has other limits than the plan was made for",
    );
    // Garbage on the line harms nobody.
    let host = controller.address.trim_start_matches("tcp://").to_owned();
    let mut stranger = TcpStream::connect(&host).expect("it listens");
    stranger.write_all(b"GET / HTTP/1.1\r\n\r\n").expect("sent");
    let mut said = Vec::new();
    stranger.set_read_timeout(Some(Duration::from_secs(10))).expect("a time-out");
    let _ = stranger.read_to_end(&mut said);
    let end = controller.end();
    assert_eq!(
        (&end["at_rest"], &end["senders"]),
        (&Value::from(true), &Value::from(0)),
        "{end}"
    );
}

#[test]
fn certificates_of_the_shop_let_in_and_others_do_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let openssl = |args: &[&str]| {
        let done = Command::new("openssl").args(args).current_dir(folder.path()).output();
        done.is_ok_and(|done| done.status.success())
    };
    let authority = |name: &str| {
        let (key, pem, subject) = (format!("{name}.key"), format!("{name}.pem"), format!("/CN={name}"));
        openssl(&[
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "2",
            "-subj",
            &subject,
            "-keyout",
            &key,
            "-out",
            &pem,
        ])
    };
    let signed = |name: &str, by: &str| {
        let (key, csr, pem, subject) = (
            format!("{name}.key"),
            format!("{name}.csr"),
            format!("{name}.pem"),
            format!("/CN={name}"),
        );
        let (ca, ca_key, ext) = (format!("{by}.pem"), format!("{by}.key"), format!("{name}.ext"));
        std::fs::write(
            folder.path().join(&ext),
            "subjectAltName=IP:127.0.0.1\nbasicConstraints=CA:FALSE\n",
        )
        .expect("written");
        openssl(&[
            "req",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-subj",
            &subject,
            "-keyout",
            &key,
            "-out",
            &csr,
        ]) && openssl(&[
            "x509",
            "-req",
            "-in",
            &csr,
            "-CA",
            &ca,
            "-CAkey",
            &ca_key,
            "-CAcreateserial",
            "-days",
            "2",
            "-extfile",
            &ext,
            "-out",
            &pem,
        ])
    };
    if !(authority("shop")
        && authority("elsewhere")
        && signed("mill", "shop")
        && signed("planner", "shop")
        && signed("stranger", "elsewhere"))
    {
        println!("skipped: the program openssl makes the certificates of this test; install it");
        return;
    }
    let file = |name: &str| {
        let sub = folder.path().join(name);
        std::fs::create_dir_all(&sub).expect("a folder");
        machine_file(
            &sub,
            &format!("[link]\ncertificate = \"../{name}.pem\"\nkey = \"../{name}.key\"\nauthority = \"../shop.pem\"\n"),
        )
    };
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let plate = plate.display().to_string();
    let controller = Controller::begin(&file("mill"), &[], &folder.path().join("other"));
    let run = |machine: &str| {
        let args = [
            "run",
            &plate,
            "--machine",
            &controller.address,
            "--machine-file",
            machine,
            "--json",
        ];
        toolmark(&args, &folder.path().join("data")).output().expect("it runs")
    };
    let stranger = run(&file("stranger"));
    assert_eq!(stranger.status.code(), Some(4), "{}", words(&stranger));
    let plain = run(&machine_file(folder.path(), ""));
    assert_eq!(plain.status.code(), Some(4), "{}", words(&plain));
    let mut ended = Value::Null;
    for _ in 0..4 {
        let done = run(&file("planner"));
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        ended = answer["ended"].clone();
        if !was_late(&answer) {
            break;
        }
    }
    assert_eq!(ended, "completed");
    assert_eq!(controller.end()["at_rest"], true);
}

/// The plate, with a condition that holds the feed while it is cut and takes a value when it does.
fn watched_plate() -> String {
    let action = "(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN \
                  its_condition=\"prog_time > 1 s and X.AXIS_FEEDRATE.ACTUAL > 5\" \
                  its_actions=\"set_alarm its_alarm_id=7 its_text=look its_reaction=feed_hold\",\"read_sensor_value its_sensor=S1.CUTTING_SPEED\")";
    PLATE.replacen("G0 X0. Y0. Z10.\n", &format!("G0 X0. Y0. Z10.\n{action}\n"), 1)
}

#[test]
fn a_synchronized_action_fires_on_a_controller_in_its_own_process_and_is_in_the_log() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, watched_plate()).expect("written");
    let (plate, data) = (plate.display().to_string(), folder.path().join("data"));
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let run = [
        "run",
        &plate,
        "--machine",
        &controller.address,
        "--machine-file",
        &machine,
        "--json",
    ];
    for attempt in 0..6 {
        let done = toolmark(&run, &data).output().expect("it runs");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        println!("{attempt}: {} {}", answer["ended"], answer["driven"]);
        if was_late(&answer) {
            continue;
        }
        assert_eq!(answer["ended"], "completed", "{}", words(&done));
        let told = answer["functions"].as_array().expect("records of functions");
        let of = |state: &str| -> Vec<&Value> { told.iter().filter(|r| r["data"]["state"] == state).collect() };
        let fired = of("fired");
        assert_eq!(fired.len(), 1, "{answer:#}");
        assert_eq!(fired[0]["data"]["actions"][0]["alarm"], 7, "{answer:#}");
        // The machine acted on it by itself, in the cycle of the condition or the next.
        let effect = of("effect");
        let cycle = |record: &Value, name: &str| record["data"][name].as_u64().expect("a cycle");
        let waited = cycle(effect[0], "cycle_of_effect") - cycle(effect[0], "cycle_of_condition");
        assert!(waited <= 1, "{answer:#}");
        assert_eq!(of("cleared").len(), 1, "cycle start ended the alarm: {answer:#}");
        let csv = folder.path().join("export.csv").display().to_string();
        let exported = toolmark(&["trace", "export", "last", "--out", &csv], &data)
            .output()
            .expect("it runs");
        assert!(exported.status.success(), "{}", words(&exported));
        let events = std::fs::read_to_string(folder.path().join("export.events.csv")).expect("exported");
        assert!(
            events.contains("start_synchronized_action") && events.contains("fired") && events.contains("hold"),
            "{events}"
        );
        controller.end();
        return;
    }
    panic!("no run of six was in time");
}

#[test]
fn the_text_protocol_takes_no_program_with_conditions_and_says_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, watched_plate()).expect("written");
    let plate = plate.display().to_string();
    // Nobody has to be there for it.
    let run = [
        "run",
        &plate,
        "--machine",
        "tcp://127.0.0.1:9",
        "--machine-file",
        &machine,
        "--link",
        "text",
    ];
    let done = toolmark(&run, &folder.path().join("data")).output().expect("it runs");
    let said = words(&done);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(
        said.contains("start_synchronized_action") && said.contains("default link") && said.contains("nothing was moved"),
        "{said}"
    );
}

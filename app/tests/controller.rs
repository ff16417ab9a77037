//! The machine side as a process of its own: driven over both links, refused, stopped, and over certificates.
//!
//! Real time on a shared computer: late cycles are counted, simulated drives wait for them, and a run completes. What a run must be is
//! asserted, never how long it takes.

#[path = "support/machine_side.rs"]
mod machine_side;

use machine_side::{Controller, PLATE, corpus_part, interrupt, machine_file, report, toolmark, was_late, words};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// What a report says of a run over a link, whichever.
#[track_caller]
fn check_driven(driven: &Value, link: &str, controller: &str) {
    assert_eq!(
        (&driven["link"], &driven["controller"]),
        (&Value::from(link), &Value::from(controller))
    );
    let axes = driven["following_error_max_mm"].as_array().expect("three axes");
    assert!(axes.iter().all(|mm| mm.as_f64() < Some(0.05)), "{driven}");
    assert!(driven["following_error_rms_mm"][0].as_f64() > Some(0.0), "{driven}");
    assert!(driven["buffer_median_ms"].as_u64() > Some(50), "{driven}");
    assert!(
        driven["buffer_fewest_ms"].as_u64() <= driven["buffer_median_ms"].as_u64(),
        "{driven}"
    );
    for count in ["late_ticks", "late_gaps", "starvations", "link_cuts", "resumed"] {
        assert!(driven[count].is_u64(), "{count} in {driven}");
    }
    assert!(driven["leases"].as_u64() > driven["link_cuts"].as_u64(), "{driven}");
}

#[test]
fn two_processes_machine_the_corpus_part_and_the_next_part_over_the_default_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc").display().to_string();
    std::fs::write(&plate, PLATE).expect("written");
    let data = folder.path().join("data");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    // The second part begins where the first one left the machine.
    for (program, name) in [(corpus_part(folder.path(), "wave groove"), "first"), (plate, "second")] {
        let out = folder.path().join(name);
        let args = [
            "run",
            &program,
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--json",
        ];
        let done = toolmark(&args, &data).arg("--out").arg(&out).output().expect("it runs");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        println!("{name}: {} {}", answer["ended"], answer["driven"]);
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
        check_driven(&told["driven"], "default", &controller.address);
        let page = std::fs::read_to_string(out.join("report.html")).expect("a page");
        for words in [
            "following error X, Y, Z at most",
            "buffer in motion",
            "ms median",
            "default link",
            "SIMULATED",
        ] {
            assert!(page.contains(words), "{words}");
        }
        assert!(out.join("as-executed.stpnc").is_file() && out.join("record.parquet").is_file());
    }
    let end = controller.end();
    assert_eq!(
        (&end["at_rest"], &end["refused"], &end["senders"]),
        (&Value::from(true), &Value::from(0), &Value::from(2)),
        "{end}"
    );
    assert!(end["lateness"]["cycles"].as_u64() > Some(1000), "{end}");
    assert!(
        end["lateness"]["histogram"].as_array().is_some_and(|bars| !bars.is_empty()),
        "{end}"
    );
}

#[test]
fn on_a_busy_computer_without_realtime_rights_it_says_what_is_tolerated_and_the_part_is_finished() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc").display().to_string();
    std::fs::write(&plate, PLATE).expect("written");
    let without = [
        "setpriv",
        "--bounding-set",
        "-sys_nice,-ipc_lock",
        "--inh-caps",
        "-sys_nice,-ipc_lock",
    ];
    let can_drop = Command::new(without[0]).args(&without[1..]).arg("true").output();
    let by: &[&str] = if can_drop.is_ok_and(|done| done.status.success()) {
        &without
    } else {
        &[]
    };
    let controller = Controller::begin_as(by, &machine, &[], &folder.path().join("other"));
    println!("{}", controller.told);
    assert_eq!(controller.told["late_ticks_made_up"], 500);
    if by.is_empty() {
        println!("setpriv cannot take rights away here: the controller keeps those that it has");
    } else {
        assert!(
            controller.told["lacks"].to_string().contains("without SCHED_FIFO"),
            "{}",
            controller.told
        );
        assert_eq!(controller.told["punctual"], false);
    }
    // Other people's work, on every processor twice.
    let over = Arc::new(AtomicBool::new(false));
    let processors = std::thread::available_parallelism().map_or(2, usize::from);
    let load: Vec<_> = (0..2 * processors)
        .map(|_| {
            let over = Arc::clone(&over);
            std::thread::spawn(move || {
                while !over.load(Relaxed) {
                    std::hint::spin_loop()
                }
            })
        })
        .collect();
    let args = [
        "run",
        &plate,
        "--machine",
        &controller.address,
        "--machine-file",
        &machine,
        "--json",
    ];
    let done = toolmark(&args, &folder.path().join("data")).output().expect("it runs");
    over.store(true, Relaxed);
    load.into_iter().for_each(|thread| thread.join().expect("a loop"));
    let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
    println!("{}", answer["driven"]);
    assert_eq!(
        (&answer["ended"], &answer["report"]["verdict"]),
        (&Value::from("completed"), &Value::from("good")),
        "{}",
        words(&done)
    );
    assert!(controller.end()["late_ticks"].is_u64());
}

#[test]
fn the_text_protocol_machines_the_corpus_part_and_the_report_comes_from_the_controllers_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let part = corpus_part(folder.path(), "wave groove");
    // A port that was free a moment ago.
    let reports = TcpListener::bind("127.0.0.1:0")
        .and_then(|l| l.local_addr())
        .expect("a port")
        .port()
        .to_string();
    let data = folder.path().join("data");
    let kept = folder.path().join("records");
    let kept_text = kept.display().to_string();
    let more = ["--link", "text", "--report-port", &reports, "--record", &kept_text];
    let controller = Controller::begin(&machine, &more, &folder.path().join("other"));
    let mut args = vec![
        "run",
        &part,
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
    // It cuts on for the time that lines were ahead, and for tool and spindle; then its record is closed.
    let record = kept.join("run-0001.parquet");
    let until = Instant::now() + Duration::from_secs(60);
    while !record.exists() && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(50));
    }
    let address = controller.address.clone();
    let end = controller.end();
    println!("{end}");
    let (rebuilt, out) = (folder.path().join("rebuilt.stpnc"), folder.path().join("report"));
    let args = [
        "rebuild",
        &part,
        &record.display().to_string(),
        "--machine",
        &machine,
        "--json",
    ];
    let done = toolmark(&args, &data)
        .arg("--out")
        .arg(&rebuilt)
        .arg("--report")
        .arg(&out)
        .output()
        .expect("it runs");
    let told: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
    assert_eq!(told["verdict"], "good", "{told}");
    // The groove has some 6.7 s of set-points, a line each.
    assert!(answer["lines"].as_u64() > Some(6000), "{}", answer["lines"]);
    check_driven(&told["driven"], "text", &address);
    assert_eq!(report(&out)["driven"], told["driven"]);
    let page = std::fs::read_to_string(out.join("report.html")).expect("a page");
    assert!(page.contains("text link") && page.contains("ms median"));
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
fn a_controller_that_was_away_for_two_seconds_does_not_refuse_its_own_sender() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let plate = folder.path().join("plate.nc").display().to_string();
    std::fs::write(&plate, PLATE.replace("F1500.", "F60.")).expect("written");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let args = [
        "run",
        &plate,
        "--machine",
        &controller.address,
        "--machine-file",
        &machine,
        "--json",
    ];
    let mut run = toolmark(&args, &folder.path().join("data"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("it starts");
    std::thread::sleep(Duration::from_secs(5));
    for (signal, then) in [("-STOP", 2000), ("-CONT", 3000)] {
        let id = controller.child.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status();
        assert!(sent.is_ok_and(|status| status.success()), "kill {signal}");
        std::thread::sleep(Duration::from_millis(then));
    }
    interrupt(&run);
    let mut text = String::new();
    run.stdout
        .take()
        .expect("piped")
        .read_to_string(&mut text)
        .expect("its answer");
    let code = run.wait().expect("it ends").code();
    let answer: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
    println!("{} {} {}", answer["ended"], answer["text"], answer["driven"]);
    // It stood still for longer than even simulated drives wait, and everybody reads that.
    assert_eq!(code, Some(1), "{answer}");
    assert!(["stopped", "fault"].iter().any(|word| answer["ended"] == *word), "{answer}");
    let text = answer["text"].as_str().expect("a sentence");
    assert!(
        text.contains("the controller was away for ") && text.contains(" servo cycles at once; 500 are tolerated"),
        "{text}"
    );
    assert!(
        answer["report"]["findings"].to_string().contains("500 are tolerated"),
        "{answer}"
    );
    assert!(answer["driven"]["late_ticks"].as_u64() > Some(1500), "{answer}");
    assert!(answer["driven"]["leases"].as_u64() > Some(1), "{answer}");
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
    // A program that turns, on a mill.
    let shaft = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/shaft.nc");
    check(
        &["run", shaft, "--machine", &controller.address],
        4,
        "has other limits than the plan was made for: use its machine file on both sides (here it is 'sim-lathe': the program turns)",
    );
    let port = controller.address.rsplit(':').next().expect("a port").to_owned();
    check(
        &["controller", "--machine", &machine, "--port", &port],
        4,
        "is another controller running? --port takes another",
    );
    check(
        &[
            "run",
            &plate,
            "--machine",
            &controller.address,
            "--machine-file",
            &machine,
            "--link",
            "text",
        ],
        4,
        "it was started without --link text",
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
    // Who only asks shows the same certificates.
    let asked = |address: &str, machine: &str, code: i32, why: &str| {
        let args = ["trace", "actions", "--machine", address, "--machine-file", machine];
        let done = toolmark(&args, &folder.path().join("data")).output().expect("it runs");
        assert!(
            done.status.code() == Some(code) && words(&done).contains(why),
            "{}",
            words(&done)
        );
    };
    asked(&controller.address, &file("planner"), 0, "no synchronized action lives in");
    asked(&controller.address, &file("stranger"), 4, "error: tcp://");
    asked(
        &controller.address,
        &machine_file(folder.path(), ""),
        4,
        "encrypted connections only",
    );
    let stranger = run(&file("stranger"));
    assert_eq!(stranger.status.code(), Some(4), "{}", words(&stranger));
    let plain = run(&machine_file(folder.path(), ""));
    assert_eq!(plain.status.code(), Some(4), "{}", words(&plain));
    assert!(
        words(&plain).contains("encrypted connections only: give certificate, key and authority"),
        "{}",
        words(&plain)
    );
    let without = tempfile::tempdir().expect("a folder");
    let open = Controller::begin(&machine_file(without.path(), ""), &[], &folder.path().join("third"));
    let to_open = [
        "run",
        &plate,
        "--machine",
        &open.address,
        "--machine-file",
        &file("planner"),
        "--json",
    ];
    let to_open = toolmark(&to_open, &folder.path().join("data")).output().expect("it runs");
    asked(&open.address, &file("planner"), 4, "it closed the encrypted connection");
    assert_eq!(to_open.status.code(), Some(4), "{}", words(&to_open));
    assert!(
        words(&to_open).contains("it closed the encrypted connection"),
        "{}",
        words(&to_open)
    );
    drop(open);
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

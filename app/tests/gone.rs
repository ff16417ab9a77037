//! A controller or a run that is gone: who is still there says it, and a person is never left waiting.

#[path = "support/machine_side.rs"]
mod machine_side;

use machine_side::{Controller, PLATE, interrupt, machine_file, rows_came, toolmark, was_late};
use serde_json::Value;
use std::fs::File;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

/// A run in its own process that cuts for minutes, and what it says.
struct Run {
    child: Child,
    said: PathBuf,
    answer: PathBuf,
}

impl Run {
    fn begin(folder: &Path, address: &str, machine: &str, data: &Path) -> Run {
        let plate = folder.join("plate.nc");
        std::fs::write(&plate, PLATE.replace("F1500.", "F60.")).expect("written");
        std::fs::create_dir_all(data).expect("a folder");
        let (said, answer) = (data.join("said"), data.join("answer"));
        let args = ["run", &plate.display().to_string(), "--machine", address, "--json"];
        let child = toolmark(&args, data)
            .args(["--machine-file", machine])
            .stdout(Stdio::from(File::create(&answer).expect("a file")))
            .stderr(Stdio::from(File::create(&said).expect("a file")))
            .spawn()
            .expect("it starts");
        Run { child, said, answer }
    }

    fn said(&self) -> String {
        std::fs::read_to_string(&self.said).expect("a file")
    }

    /// One that is under way, and its data. On a shared computer a run may be over before: then another one is begun.
    fn under_way(folder: &Path, address: &str, machine: &str) -> (Run, PathBuf) {
        for attempt in 0..6 {
            let data = folder.join(format!("data-{attempt}"));
            let mut run = Run::begin(folder, address, machine, &data);
            if rows_came(&data, 1, 1500, &mut run.child) {
                return (run, data);
            }
            println!("{attempt}: {}", run.said());
        }
        panic!("six runs were kept from the processor");
    }

    /// Waits until it has said this; false when it never does.
    fn says(&self, what: &str) -> bool {
        (0..600).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            self.said().contains(what)
        })
    }

    /// Its exit code; `None` when it does not end.
    fn exit(&mut self) -> Option<i32> {
        let ended = (0..1200).find_map(|_| {
            std::thread::sleep(Duration::from_millis(50));
            self.child.try_wait().expect("it was started")
        });
        ended.and_then(|status| status.code())
    }

    fn answer(&self) -> Value {
        let text = std::fs::read(&self.answer).expect("a file");
        serde_json::from_slice(&text).unwrap_or(Value::Null)
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn free_port() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr());
    listener.expect("a port").port().to_string()
}

#[test]
fn the_first_ctrl_c_ends_a_run_whose_controller_was_started_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let port = free_port();
    let other = folder.path().join("other");
    for attempt in 0..4 {
        let first = Controller::begin(&machine, &["--port", &port], &other);
        let place = folder.path().join(attempt.to_string());
        std::fs::create_dir_all(&place).expect("a folder");
        let (mut run, _) = Run::under_way(&place, &first.address, &machine);
        // Killed, and started again at the same place: it knows nothing of the run, and waits for a person.
        drop(first);
        let second = Controller::begin(&machine, &["--port", &port], &other);
        if !run.says("the link to the controller is back after") {
            println!("{attempt}: {}", run.said());
            continue;
        }
        interrupt(&run.child);
        let (code, answer) = (run.exit(), run.answer());
        println!("{attempt}: {code:?} {} {}", answer["text"], run.said());
        assert_eq!(code, Some(1), "one Ctrl-C is enough: {}", run.said());
        assert!(run.said().contains("notice: controlled stop on the path"), "{}", run.said());
        if was_late(&answer) {
            continue;
        }
        assert_eq!(answer["text"], "controlled stop: stop was asked", "{answer}");
        // The machine was given back: nobody has to wait for it.
        let end = second.end();
        assert_eq!(
            (&end["at_rest"], &end["refused"]),
            (&Value::from(true), &Value::from(0)),
            "{end}"
        );
        return;
    }
    panic!("four runs were kept from the processor");
}

#[test]
fn the_first_ctrl_c_ends_a_run_whose_controller_is_gone_and_says_that_nobody_knows_where_the_machine_stands() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let (mut run, _) = Run::under_way(folder.path(), &controller.address, &machine);
    drop(controller);
    assert!(run.says("the link to the controller is cut"), "{}", run.said());
    interrupt(&run.child);
    let code = run.exit();
    let said = run.said();
    assert_eq!(code, Some(4), "{said}");
    // Not because nobody came back for half a minute.
    assert!(
        said.contains("stop was asked while the link to the controller is cut") && said.contains("--resume last"),
        "{said}"
    );
}

#[test]
fn a_run_with_the_start_of_a_killed_one_begins_at_the_beginning_all_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    let controller = Controller::begin(&machine, &[], &folder.path().join("other"));
    let plate = folder.path().join("plate.nc");
    std::fs::write(&plate, PLATE).expect("written");
    let start = |data: &str| {
        let mut command = toolmark(&["run", &plate.display().to_string(), "--json"], &folder.path().join(data));
        command.args(["--machine", &controller.address, "--machine-file", &machine]);
        command.args(["--start", "2026-11-22T09:00:00Z"]);
        command
    };
    let was_killed = (0..6).any(|attempt| {
        let data = format!("data-{attempt}");
        let mut killed = start(&data)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let begun = rows_came(&folder.path().join(&data), 1, 1500, &mut killed);
        killed.kill().expect("it runs"); // SIGKILL on Unix
        killed.wait().expect("it ends");
        begun
    });
    assert!(was_killed, "six runs were kept from the processor");
    for attempt in 0..4 {
        let done = start(&format!("again-{attempt}")).output().expect("it runs");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or(Value::Null);
        println!("{attempt}: {} {}", answer["text"], answer["driven"]);
        if was_late(&answer) {
            continue;
        }
        assert_eq!(
            (done.status.code(), &answer["ended"]),
            (Some(0), &Value::from("completed")),
            "{answer}"
        );
        assert_eq!(answer["report"]["verdict"], "good", "{answer}");
        return;
    }
    panic!("four runs were kept from the processor");
}

#[test]
fn a_machine_that_is_kept_for_a_killed_run_is_waited_for_and_who_had_it_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let machine = machine_file(folder.path(), "");
    for attempt in 0..4 {
        let place = folder.path().join(attempt.to_string());
        std::fs::create_dir_all(&place).expect("a folder");
        let controller = Controller::begin(&machine, &[], &place.join("other"));
        let (mut killed, _) = Run::under_way(&place, &controller.address, &machine);
        killed.child.kill().expect("it runs"); // SIGKILL on Unix
        killed.child.wait().expect("it ends");
        let mut next = Run::begin(&place, &controller.address, &machine, &place.join("another"));
        assert!(next.says("the machine is free after"), "{}", next.said());
        let said = next.said();
        assert!(
            said.contains("notice: the machine is kept for 'plate.nc of ")
                && said.contains("which is gone: it is free in some seconds"),
            "{said}"
        );
        assert_eq!(said.matches("is kept for").count(), 1, "it is said once: {said}");
        // It has the machine now, and one that lives is not waited for.
        let mut third = Run::begin(&place, &controller.address, &machine, &place.join("third"));
        let code = third.exit();
        if next.child.try_wait().expect("it was started").is_some() {
            println!("{attempt}: the one that has the machine ended before: {}", next.said());
            continue;
        }
        assert_eq!(code, Some(4), "{}", third.said());
        assert!(
            third.said().contains("is driven by 'plate.nc of") && !third.said().contains("waiting for it"),
            "{}",
            third.said()
        );
        interrupt(&next.child);
        assert_eq!(next.exit(), Some(1), "{}", next.said());
        return;
    }
    panic!("four runs were kept from the processor");
}

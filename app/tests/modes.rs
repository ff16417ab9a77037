//! Synchronized actions in all modes outlive their program: with real processes, from the run that starts one to the operator who ends it.

#[path = "support/machine_side.rs"]
mod machine_side;

use machine_side::{Controller, PLATE, machine_file, toolmark, was_late, words};
use serde_json::Value;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A condition that is always true and does nothing but tell; the second one fires once and goes with the program.
const ACTIONS: &str = "(trace:1 start_synchronized_action its_id=still its_mode_scope=ALL its_frequency=WHENEVER)\n\
                       (trace:+ its_condition=\"X.POSITION.ACTUAL > -10000 mm\" its_actions=\"log_event its_kind=there\")\n\
                       (trace:1 start_synchronized_action its_id=here its_mode_scope=AUTOMATIC its_frequency=WHEN)\n\
                       (trace:+ its_condition=\"X.POSITION.ACTUAL > 5 mm\" its_actions=\"log_event its_kind=here\")\n";

/// The plate with them; the lasting one by its id.
fn with_actions(id: &str) -> String {
    let actions = ACTIONS.replace("its_id=still", &format!("its_id={id}"));
    PLATE.replace("G0 X0. Y0. Z10.\n", &format!("G0 X0. Y0. Z10.\n{actions}"))
}

struct Shop {
    folder: tempfile::TempDir,
    machine: String,
    program: String,
    data: PathBuf,
}

impl Shop {
    /// Three operators: Ada of level 1, Four and Five of theirs.
    fn new() -> Shop {
        let folder = tempfile::tempdir().expect("a folder");
        let machine = machine_file(folder.path(), "");
        let program = folder.path().join("plate.nc").display().to_string();
        std::fs::write(&program, with_actions("still")).expect("written");
        let data = folder.path().join("data");
        let shop = Shop {
            folder,
            machine,
            program,
            data,
        };
        shop.good(&["operator", "add", "Ada", "--level", "1"]);
        for (name, level) in [("Four", "4"), ("Five", "5")] {
            shop.good(&["operator", "add", name, "--level", level, "--operator", "Ada"]);
        }
        shop
    }

    fn good(&self, args: &[&str]) -> String {
        let done = toolmark(args, &self.data).output().expect("it runs");
        assert_eq!(done.status.code(), Some(0), "{args:?}: {}", words(&done));
        words(&done)
    }

    fn json(&self, args: &[&str]) -> Value {
        let done = toolmark(args, &self.data).arg("--json").output().expect("it runs");
        assert_eq!(done.status.code(), Some(0), "{args:?}: {}", words(&done));
        serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)))
    }

    #[track_caller]
    fn refused(&self, args: &[&str], code: i32, why: &[&str]) {
        let done = toolmark(args, &self.data).output().expect("it runs");
        assert_eq!(done.status.code(), Some(code), "{args:?}: {}", words(&done));
        why.iter()
            .for_each(|why| assert!(words(&done).contains(why), "{why}: {}", words(&done)));
    }

    /// The words of a run of the program by somebody of level 5.
    fn run_words<'a>(&'a self, address: &'a str) -> [&'a str; 9] {
        let (program, machine) = (&self.program, &self.machine);
        [
            "run",
            program,
            "--machine",
            address,
            "--machine-file",
            machine,
            "--operator",
            "Five",
            "--json",
        ]
    }

    /// That run, begun again where only the shared computer has ended it.
    fn run(&self, address: &str) -> (Value, String) {
        let before = self.living(address).len();
        for _ in 0..6 {
            let args = self.run_words(address);
            let done = toolmark(&args, &self.data).output().expect("it runs");
            let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
            if !was_late(&answer) {
                assert_eq!(answer["ended"], "completed", "{}", words(&done));
                return (answer, words(&done));
            }
            println!("the computer was away: {}", answer["text"]);
            // What that run has left would stand in the way of the next one; it may have been ended before it started anything.
            for own in self.living(address).split_off(before) {
                let number = own["number"].to_string();
                self.good(&["trace", "end", &number, "--machine", address, "--operator", "Four"]);
            }
        }
        panic!("the computer was away in six runs");
    }

    /// The numbers and what is told of what lives there.
    fn living(&self, address: &str) -> Vec<Value> {
        let told = self.json(&["trace", "actions", "--machine", address]);
        assert_eq!(told["controller"], address);
        told["actions"].as_array().expect("a list").clone()
    }

    /// Events of the directory's own log of these kinds.
    fn events(&self, kinds: &[&str]) -> Vec<(String, Value)> {
        let directory = store::DataDirectory::read(&self.data).expect("a data directory");
        let events = directory.events(store::Log::Directory, 1, 10_000).expect("a log");
        let of_these = events.into_iter().filter(|event| kinds.contains(&event.kind.as_str()));
        of_these.map(|event| (event.kind, Value::from_iter(event.detail))).collect()
    }
}

/// A gamepad whose events come out of a pipe.
struct Gamepad {
    path: String,
    pipe: File,
}

impl Gamepad {
    fn in_folder(folder: &Path) -> Gamepad {
        let path = folder.join("pad").display().to_string();
        let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo is there");
        assert!(made.success());
        // Both ends, so that neither side waits for the other to open.
        let pipe = OpenOptions::new().read(true).write(true).open(&path).expect("a pipe");
        Gamepad { path, pipe }
    }

    /// Both middle buttons are the emergency stop.
    fn press(&mut self, pressed: bool) {
        for (kind, code, value) in [
            (1u16, 0x13au16, i32::from(pressed)),
            (1, 0x13b, i32::from(pressed)),
            (0, 0, 0),
        ] {
            let event = [&[0; 16][..], &kind.to_ne_bytes(), &code.to_ne_bytes(), &value.to_ne_bytes()].concat();
            self.pipe.write_all(&event).expect("room");
        }
    }
}

fn fired(action: &Value) -> u64 {
    action["fired"].as_u64().expect("a count")
}

#[test]
fn an_action_in_all_modes_lives_on_in_the_controller_until_somebody_of_level_4_ends_it() {
    let shop = Shop::new();
    let mut pad = Gamepad::in_folder(shop.folder.path());
    let controller = Controller::begin(&shop.machine, &["--pad", &pad.path], &shop.folder.path().join("other"));
    let at = controller.address.clone();
    assert_eq!(shop.living(&at), Vec::<Value>::new());
    assert!(
        shop.good(&["trace", "actions", "--machine", &at])
            .contains("no synchronized action lives in")
    );

    // Nobody is signed in: the same look, whoever looks.
    let (_, said) = shop.run(&at);
    assert!(!said.contains("of earlier runs live"), "{said}");
    let living = shop.living(&at);
    let [action] = &living[..] else { panic!("{living:?}") };
    let number = action["number"].to_string();
    assert_eq!(
        (&action["id"], &action["scope"], &action["frequency"], &action["by"]),
        (&"still".into(), &"ALL".into(), &"WHENEVER".into(), &"plate.nc of Five".into())
    );
    assert_eq!(action["condition"], "X.POSITION.ACTUAL > -10000 mm");
    assert!(
        action["line"].as_str().is_some_and(|line| line.contains("log_event")),
        "{action}"
    );
    let text = shop.good(&["trace", "actions", "--machine", &at]);
    assert!(text.contains("all modes") && text.contains("of plate.nc of Five"), "{text}");
    // The job says that it goes on, and the other one ended with the program.
    let told = shop.json(&["trace", "actions", "last"]);
    let of_job = |id: &str| {
        let all = told["actions"].as_array().expect("a list");
        all.iter().find(|action| action["id"] == id).cloned().expect("it was started")
    };
    assert_eq!(of_job("still")["ended_s"], Value::Null);
    assert_eq!(of_job("still")["why"], "it is in all modes, and the machine goes on");
    assert_eq!(of_job("here")["why"], "program end");
    assert!(fired(&of_job("still")) <= fired(action));

    // It goes on firing with nobody connected, and through an emergency stop.
    pad.press(true);
    let pressed = fired(&shop.living(&at)[0]);
    let more = (0..500).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        let now = fired(&shop.living(&at)[0]);
        (now > pressed + 50).then_some(now)
    });
    assert!(more.is_some(), "it stands at {pressed}");
    pad.press(false);

    // The same id is taken while it lives: nothing moves.
    let again = shop.run_words(&at);
    let end_it = format!("toolmark trace end {number}");
    shop.refused(
        &again,
        1,
        &["T-02", "still is active as a synchronized action in all modes", &end_it],
    );
    assert_eq!(shop.living(&at).len(), 1);

    // Another one is told of it before it begins, and starts its own.
    std::fs::write(&shop.program, with_actions("other")).expect("written");
    let (_, said) = shop.run(&at);
    assert!(
        said.contains("of earlier runs live") && said.contains("(of 'plate.nc of Five')"),
        "{said}"
    );
    let both = shop.living(&at);
    let last = both.last().expect("its own")["number"].to_string();
    assert!(both.len() == 2 && last != number, "{both:?}");

    // Who may not, and what is not there.
    let end = |which: &str, operator: &str| -> Vec<String> {
        [
            "trace",
            "end",
            which,
            "--machine",
            &at,
            "--operator",
            operator,
            "--reason",
            "the part is done",
        ]
        .map(str::to_owned)
        .to_vec()
    };
    let refused = |args: Vec<String>, code, why: &[&str]| {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        shop.refused(&args, code, why);
    };
    refused(end(&number, "Five"), 1, &["level 4", "Five cannot do it"]);
    refused(end("all", "Five"), 1, &["level 4"]);
    refused(end(&number, "Nobody"), 2, &["Nobody is no operator here"]);
    refused(end("4000000", "Four"), 2, &["no action 4000000 lives", &number]);
    for wrong in ["still", "0", "-1", "1.5", ""] {
        refused(end(wrong, "Four"), 2, &[]);
    }
    shop.refused(&["trace", "end", &number], 2, &["the address of a controller"]);
    shop.refused(&["trace", "actions"], 2, &["give the number of a job"]);
    shop.refused(&["trace", "actions", "last", "--machine", &at], 2, &["not both"]);
    shop.refused(
        &["trace", "actions", "--machine", "tcp://127.0.0.1:1"],
        4,
        &["toolmark controller"],
    );
    assert_eq!(shop.living(&at).len(), both.len(), "nothing was ended");
    let refusals = shop.events(&["refused"]);
    let refusals: Vec<&Value> = refusals
        .iter()
        .map(|(_, detail)| detail)
        .filter(|d| d["action"] == "end-all-modes")
        .collect();
    assert_eq!(refusals.len(), 3, "{refusals:?}");
    assert_eq!((&refusals[0]["who"], &refusals[0]["needed"]), (&"Five".into(), &4.into()));

    let args = end(&number, "Four");
    let answer = shop.json(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!((&answer["who"], &answer["why"]), (&"Four".into(), &"the part is done".into()));
    assert_eq!(answer["actions"][0]["number"].to_string(), number);
    let left = shop.living(&at);
    assert!(
        left.len() + 1 == both.len() && left.iter().all(|a| a["number"] != both[0]["number"]),
        "{left:?}"
    );
    let args = end("all", "Four");
    let said = shop.good(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(said.contains("ended by Four (level 4)"), "{said}");
    assert_eq!(shop.living(&at), Vec::<Value>::new());
    // Nothing is left to be ended, and that is no fault.
    assert!(
        shop.good(&args.iter().map(String::as_str).collect::<Vec<_>>())
            .contains("nothing was ended: no synchronized action in all modes lives")
    );
    refused(end(&number, "Four"), 2, &["none of all modes lives there"]);

    let told = shop.events(&["action-end-asked", "action-ended"]);
    assert_eq!(told.len(), 2 * both.len(), "{told:?}");
    let ((asked, before), (ended, after)) = (&told[0], &told[1]);
    assert_eq!((asked.as_str(), ended.as_str()), ("action-end-asked", "action-ended"));
    for detail in [before, after] {
        assert_eq!(
            (
                &detail["who"],
                &detail["level"],
                &detail["number"],
                &detail["id"],
                &detail["controller"],
                &detail["why"]
            ),
            (
                &"Four".into(),
                &4.into(),
                &number.parse::<u32>().expect("a number").into(),
                &"still".into(),
                &at.as_str().into(),
                &"the part is done".into()
            )
        );
    }
    assert!(after["fired"].as_u64() >= before["fired"].as_u64());
    shop.good(&["trace", "verify"]);
    controller.end();
}

#[test]
fn a_simulated_machine_ends_with_its_run_and_the_log_says_so() {
    let shop = Shop::new();
    shop.good(&[
        "run",
        &shop.program,
        "--fast",
        "--operator",
        "Five",
        "--machine",
        &shop.machine,
    ]);
    let told = shop.json(&["trace", "actions", "last"]);
    let still = &told["actions"][0];
    assert_eq!(
        (&still["id"], &still["why"]),
        (
            &"still".into(),
            &"the machine was simulated for this run and ended with it".into()
        )
    );
    assert!(still["ended_s"].is_number(), "{still}");
}

#[test]
fn a_run_records_that_its_action_was_ended_while_it_was_under_way() {
    let shop = Shop::new();
    // Long enough for another process to come in between.
    let program = std::fs::read_to_string(&shop.program).expect("written");
    std::fs::write(&shop.program, program.replace("M9\n", "G4 P8000\nM9\n")).expect("written");
    let other = shop.folder.path().join("other");
    let controller = Controller::begin(&shop.machine, &[], &other);
    let at = controller.address.clone();
    for _ in 0..6 {
        let run = toolmark(&shop.run_words(&at), &shop.data)
            .stdout(std::process::Stdio::piped())
            .spawn()
            .expect("it begins");
        // The data directory is the run's: somebody elsewhere, with one of their own, ends it. There is no operator yet there.
        let list = || {
            let done = toolmark(&["trace", "actions", "--machine", &at, "--json"], &other)
                .output()
                .expect("it runs");
            assert_eq!(done.status.code(), Some(0), "{}", words(&done));
            let told: Value = serde_json::from_slice(&done.stdout).expect("JSON");
            told["actions"].as_array().expect("a list").clone()
        };
        let both = (0..1200).find_map(|_| {
            std::thread::sleep(std::time::Duration::from_millis(10));
            Some(list()).filter(|all| all.len() == 2)
        });
        let both = both.expect("both of them live while the program runs");
        let number = |id: &str| both.iter().find(|a| a["id"] == id).expect("it lives")["number"].to_string();
        let done = toolmark(&["trace", "end", &number("here"), "--machine", &at], &other)
            .output()
            .expect("it runs");
        assert_eq!(done.status.code(), Some(2), "{}", words(&done));
        assert!(words(&done).contains("in automatic"), "{}", words(&done));
        let done = toolmark(&["trace", "end", &number("still"), "--machine", &at], &other)
            .output()
            .expect("it runs");
        assert_eq!(done.status.code(), Some(0), "{}", words(&done));
        let done = run.wait_with_output().expect("it ends");
        let answer: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {}", words(&done)));
        if was_late(&answer) {
            println!("the computer was away: {}", answer["text"]);
            continue;
        }
        assert_eq!(answer["ended"], "completed", "{answer}");
        let told = shop.json(&["trace", "actions", "last"]);
        let still = &told["actions"][0];
        assert_eq!(
            (&still["id"], &still["why"]),
            (&"still".into(), &"by hand, from the list of what lives in the machine".into())
        );
        assert!(still["ended_s"].is_number() && fired(still) > 10, "{still}");
        assert_eq!(shop.living(&at), Vec::<Value>::new());
        return;
    }
    panic!("the computer was away in six runs");
}

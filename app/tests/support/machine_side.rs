//! A controller in its own process, a CAM add-in, and what both are given: for the tests of the machine side.

#![allow(dead_code, reason = "each file of tests uses its part")]

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::Duration;

/// A small plate.
pub const PLATE: &str = "%\nO1\nG21 G90 G54\nT1 M6\nG43 H1\nS3000 M3\nM8\nG0 X0. Y0. Z10.\nG1 Z-1. F600.\nX20. F1500.\nY15.\nG3 X10. Y25. I-10. J0.\n\
                     G1 X0.\nY0.\nG0 Z10.\nM9\nM5\nM30\n%\n";

/// The program, with a data directory of its own.
pub fn toolmark(args: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_toolmark"));
    command.args(args).env("TOOLMARK_DATA", data);
    command
}

/// What it said.
pub fn words(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// The built-in mill with a quick tool change, and whatever else is said.
pub fn machine_file(folder: &Path, more: &str) -> String {
    let mill = include_str!("../../../store/machines/sim-mill.toml");
    let text = mill.replacen("tool_change_s = 2.5", "tool_change_s = 0.2", 1);
    let path = folder.join("mill.toml");
    std::fs::write(&path, format!("{text}\n{more}")).expect("written");
    path.display().to_string()
}

/// The corpus part with everything but one of its workingsteps left out.
pub fn corpus_part(folder: &Path, workingstep: &str) -> String {
    let bracket = concat!(env!("CARGO_MANIFEST_DIR"), "/../corpus/bracket.stpnc");
    let path = folder.join("part.stpnc").display().to_string();
    let mut args = vec!["edit", bracket, "--out", &path];
    for name in ["face top", "round pocket", "wave groove", "drill holes", "side slot"] {
        if name != workingstep {
            args.extend(["--disable", name]);
        }
    }
    let done = toolmark(&args, &folder.join("of-the-editor")).output().expect("it runs");
    assert!(done.status.success(), "{}", words(&done));
    path
}

/// The files of these kinds in a folder and all below it.
pub fn files_of(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let is_one = path.extension().is_some_and(|e| extensions.iter().any(|wanted| e == *wanted));
            if path.is_dir() {
                open.push(path);
            } else if is_one {
                found.push(path);
            }
        }
    }
    found
}

/// A controller in its own process, killed when it is dropped.
pub struct Controller {
    pub child: Child,
    out: BufReader<ChildStdout>,
    /// Where it listens.
    pub address: String,
    /// What it said at its start.
    pub told: Value,
}

impl Controller {
    /// Starts one on any free port.
    pub fn begin(machine: &str, more: &[&str], data: &Path) -> Controller {
        Controller::begin_as(&[], machine, more, data)
    }

    /// The same behind words of another program, which starts it.
    pub fn begin_as(by: &[&str], machine: &str, more: &[&str], data: &Path) -> Controller {
        let mut args = vec!["controller", "--json", "--machine", machine];
        if !more.contains(&"--port") {
            args.extend(["--port", "0"]);
        }
        args.extend(more);
        let command = match by {
            [] => toolmark(&args, data),
            [program, words @ ..] => {
                let mut command = Command::new(program);
                command
                    .args(words)
                    .arg(env!("CARGO_BIN_EXE_toolmark"))
                    .args(&args)
                    .env("TOOLMARK_DATA", data);
                command
            }
        };
        let mut child = { command }
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        let mut out = BufReader::new(child.stdout.take().expect("piped"));
        let mut line = String::new();
        out.read_line(&mut line).expect("it says where it is");
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"));
        let address = told["address"].as_str().expect("an address").to_owned();
        assert!(told["lacks"].is_array() && told["simulated"].is_boolean(), "{told}");
        Controller {
            child,
            out,
            address,
            told,
        }
    }

    /// Ctrl-C: what it says at its end.
    pub fn end(mut self) -> Value {
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

/// Waits until so many rows of the data directory's job are on disk; false when its run is over before, or they never come.
pub fn rows_came(data: &Path, job: u32, rows: u64, run: &mut Child) -> bool {
    let segment = data.join(format!("segments/job-{job:06}/0001.segment"));
    let came = |_| {
        std::thread::sleep(Duration::from_millis(50));
        match run.try_wait() {
            Ok(None) => store::segment::read(&segment)
                .is_ok_and(|found| found.rows > rows)
                .then_some(true),
            _ => Some(false),
        }
    };
    (0..1200).find_map(came).unwrap_or(false)
}

/// Ctrl-C.
pub fn interrupt(child: &Child) {
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "kill -INT");
}

/// The numbers of a report.
pub fn report(folder: &Path) -> Value {
    let text = std::fs::read(folder.join("report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

/// True for a run that only the shared computer has ended: it was away for longer than simulated drives wait.
pub fn was_late(answer: &Value) -> bool {
    let text = answer["text"].as_str().unwrap_or_default();
    (answer["ended"] == "stopped" && text.contains("was away for")) || answer["ended"] == "fault"
}

/// A CAM add-in.
pub struct AddIn {
    out: TcpStream,
    lines: BufReader<TcpStream>,
}

impl AddIn {
    /// Connects.
    pub fn connect(address: &str) -> AddIn {
        let out = TcpStream::connect(address).expect("it listens");
        out.set_read_timeout(Some(Duration::from_secs(60))).expect("a time-out");
        let lines = BufReader::new(out.try_clone().expect("a second handle"));
        AddIn { out, lines }
    }
    /// Says a line.
    pub fn say(&mut self, line: &str) {
        self.out
            .write_all(format!("{}\n", line.replace('\n', " ")).as_bytes())
            .expect("it hears");
    }
    /// Says nothing any more, and hears on.
    pub fn hang_up(&mut self) {
        self.out.shutdown(std::net::Shutdown::Write).expect("it was connected");
    }
    /// The next line of this kind; those of another are passed over.
    pub fn hear(&mut self, kind: &str) -> Option<Value> {
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

/// An operation as a line.
pub fn operation(name: &str, z: f64, size: f64) -> String {
    format!(
        r#"{{"operation":{{"name":"{name}","tool":{{"number":1,"length_mm":120}},"spindle":{{"rpm":6000}},"coolant":{{"flood":true}},
        "moves":[{{"rapid":{{"to":[0,0,5]}}}},{{"line":{{"to":[0,0,{z}],"feed_mm_min":600}}}},{{"line":{{"to":[{size},0,{z}],"feed_mm_min":1500}}}},
        {{"arc":{{"to":[{size},10,{z}],"centre":[{size},5,{z}],"direction":"ccw","feed_mm_min":1200}}}},
        {{"line":{{"to":[0,10,{z}],"feed_mm_min":1500}}}},{{"line":{{"to":[0,0,{z}],"feed_mm_min":1500}}}},{{"rapid":{{"to":[0,0,5]}}}}]}}}}"#
    )
}

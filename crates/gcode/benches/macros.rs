//! How fast macro programs are gone through: loops of arithmetic, loops with a move, and the million-line file of `read`.
//!
//! `cargo bench -p gcode --bench macros`. The budget is 5 million passes of the loop and 2 million lines a second; where `rs274` of
//! LinuxCNC is on the path, the same programs go through it and the ratio is told.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock and runs a peer"
)]

use gcode::{GcodeProgram, Options, profile::FANUC_MILL};
use plan::{MemorySource, Next, NoOtherFiles, ProgramStream, Tables};
use std::time::Instant;

const PASSES: u32 = 1_000_000;

fn ours(text: &str) -> f64 {
    let started = Instant::now();
    let mut program = GcodeProgram::open(
        Box::new(MemorySource(text.as_bytes().to_vec())),
        "loop.nc",
        &FANUC_MILL,
        Box::new(NoOtherFiles),
        Tables::empty(),
        Options::default(),
    )
    .expect("it is a program");
    loop {
        match program.next(None) {
            Next::Step(_) => {}
            Next::End => return started.elapsed().as_secs_f64(),
            other => panic!("{other:?}"),
        }
    }
}

/// Seconds that LinuxCNC's interpreter needs; `None` where it is not installed.
fn peer(text: &str) -> Option<f64> {
    let file = std::env::temp_dir().join("toolmark-bench-macros.ngc");
    let out = std::env::temp_dir().join("toolmark-bench-macros.out");
    std::fs::write(&file, text).ok()?;
    let started = Instant::now();
    let status = std::process::Command::new("rs274")
        .args(["-g"])
        .arg(&file)
        .arg(&out)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .status()
        .ok()?;
    status.success().then(|| started.elapsed().as_secs_f64())
}

fn measure(what: &str, body: &str, budget: Option<f64>) {
    let fanuc = format!("O1\n#1=0\n#2=0\nF1000\nWHILE[#1LT{PASSES}]DO1\n{body}END1\nM30\n");
    let linuxcnc = format!("#1=0\n#2=0\nF1000\no1 while [#1 LT {PASSES}]\n{body}o1 endwhile\nM2\n");
    for _ in 0..3 {
        let seconds = ours(&fanuc);
        let rate = f64::from(PASSES) / seconds / 1e6;
        let verdict = match budget {
            Some(budget) if rate >= budget => format!("budget {budget}: kept"),
            Some(budget) => format!("budget {budget}: MISSED"),
            None => String::new(),
        };
        println!("{what:<24} {rate:.2} M passes/s  {verdict}");
    }
    match peer(&linuxcnc) {
        Some(theirs) => println!(
            "{what:<24} rs274 {:.3} M passes/s, ours is {:.1} times as fast",
            f64::from(PASSES) / theirs / 1e6,
            theirs / ours(&fanuc)
        ),
        None => println!("{what:<24} rs274 is not installed: no ratio"),
    }
}

fn main() {
    measure("arithmetic", "#2=[#2+[#1*0.5]-[#1/3]]\n#1=[#1+1]\n", Some(5.0));
    measure(
        "with sin, cos and a move",
        "#2=[#1*0.001]\nG1 X[50*COS[#2]] Y[50*SIN[#2]] Z[#2*0.01]\n#1=[#1+1]\n",
        None,
    );
}

//! How fast programs are gone through, fully interpreted, and in how much memory: the million-line file of three axes and loops of
//! Custom Macro B, each written to a file first and read from it in windows, as a job is.
//!
//! `cargo bench -p gcode`; words behind `--` choose rows by their beginning, `alone` is one run without the peer, for a profiler. Where `rs274` of LinuxCNC is on
//! the path, the same program goes through it in the same run. Rates are counted by the processor time of the process, which other work
//! on the machine changes little, and by the clock on the wall. A budget that is missed makes the exit code 1.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock, writes files and runs a peer"
)]

use gcode::profile::{FANUC_MILL, Profile, RS274};
use gcode::{GcodeProgram, Options};
use plan::{ByteSource, Next, NoOtherFiles, ProgramStream, ReadError, Tables};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// Lines of the file, passes of a loop.
const COUNT: u32 = 1_000_000;
/// Runs of ours; the time of processors is known to a hundredth of a second only.
const RUNS: u32 = 5;
/// Resident memory at its highest, MiB.
const MOST_RESIDENT: f64 = 64.0;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// A row of the table.
struct Row {
    name: &'static str,
    unit: &'static str,
    /// Millions a second.
    budget: Option<f64>,
    profile: &'static Profile,
    write: fn(&mut dyn Write, ours: bool) -> std::io::Result<()>,
}

const ROWS: [Row; 4] = [
    Row {
        name: "moves of three axes",
        unit: "lines",
        budget: Some(2.0),
        profile: &RS274,
        write: spiral,
    },
    Row {
        name: "loop, arithmetic",
        unit: "passes",
        budget: Some(5.0),
        profile: &FANUC_MILL,
        write: |to, ours| a_loop(to, ours, "#2=[#2+[#1*0.5]-[#1/3]]\n#1=[#1+1]\n"),
    },
    Row {
        name: "loop, sin, cos and a move",
        unit: "passes",
        budget: None,
        profile: &FANUC_MILL,
        write: |to, ours| {
            let body = "#2=[#1*0.001]\nG1 X[50*COS[#2]] Y[50*SIN[#2]] Z[#2*0.01]\n#1=[#1+1]\n";
            a_loop(to, ours, body)
        },
    },
    Row {
        name: "assignments without a loop",
        unit: "lines",
        budget: None,
        profile: &RS274,
        write: assignments,
    },
];

fn spiral(to: &mut dyn Write, _ours: bool) -> std::io::Result<()> {
    to.write_all(b"G17 G21 G90 G94 G54\nG0 X0 Y0 Z5\nF1000\n")?;
    for i in 0..COUNT {
        let t = 0.001 * f64::from(i);
        let r = 50.0 + 20.0 * libm::sin(0.013 * t);
        let (x, y, z) = (r * libm::cos(t), r * libm::sin(t), -5.0 * libm::sin(0.37 * t));
        writeln!(to, "G1 X{x:.4} Y{y:.4} Z{z:.4}")?;
    }
    to.write_all(b"M2\n")
}

fn a_loop(to: &mut dyn Write, ours: bool, body: &str) -> std::io::Result<()> {
    let begin = "#1=0\n#2=0\nG21\nF1000\n";
    match ours {
        true => write!(to, "O1\n{begin}WHILE[#1LT{COUNT}]DO1\n{body}END1\nM30\n"),
        false => write!(to, "{begin}o1 while [#1 LT {COUNT}]\n{body}o1 endwhile\nM2\n"),
    }
}

fn assignments(to: &mut dyn Write, _ours: bool) -> std::io::Result<()> {
    to.write_all(b"#1=1\n")?;
    for _ in 0..COUNT / 2 {
        to.write_all(b"#2=[#2+[#1*0.5]-[#1/3]]\n#1=[#1+1]\n")?;
    }
    to.write_all(b"M2\n")
}

/// A file, read where the program asks.
struct Windows(File, u64);

impl ByteSource for Windows {
    fn length(&self) -> u64 {
        self.1
    }
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, ReadError> {
        self.0.read_at(buffer, offset).map_err(|e| ReadError(e.to_string()))
    }
}

/// Seconds of user time on the processor, and on the wall.
#[derive(Clone, Copy)]
struct Needed {
    user: f64,
    wall: f64,
}

fn ours(path: &Path, profile: &'static Profile, runs: u32) -> Outcome<Needed> {
    let (started, before) = (Instant::now(), user_seconds()?.0);
    for _ in 0..runs {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let mut program = GcodeProgram::open(
            Box::new(Windows(file, length)),
            "budget.nc",
            profile,
            Box::new(NoOtherFiles),
            Tables::empty(),
            Options::default(),
        )
        .map_err(|d| d.to_string())?;
        loop {
            match program.next(None) {
                Next::Step(step) => drop(std::hint::black_box(step)),
                Next::End => break,
                other => return Err(format!("{other:?}").into()),
            }
        }
    }
    Ok(Needed {
        user: (user_seconds()?.0 - before) / f64::from(runs),
        wall: started.elapsed().as_secs_f64() / f64::from(runs),
    })
}

/// What LinuxCNC's interpreter needs; `None` where it is not installed.
fn peer(path: &Path) -> Outcome<Option<Needed>> {
    let out = path.with_extension("out");
    let (started, before) = (Instant::now(), user_seconds()?.1);
    let mut command = Command::new("rs274");
    command
        .arg("-g")
        .arg(path)
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(status) = command.status() else { return Ok(None) };
    if !status.success() {
        return Err(format!("rs274 ended with {status}").into());
    }
    Ok(Some(Needed {
        user: user_seconds()?.1 - before,
        wall: started.elapsed().as_secs_f64(),
    }))
}

/// User time of this process and of the ones it waited for, as the kernel counts it in hundredths of a second.
fn user_seconds() -> Outcome<(f64, f64)> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    // The name in parentheses may hold anything; utime is the 12th field behind it, cutime the 14th.
    let behind = text.rsplit(')').next().unwrap_or_default();
    let ticks: Vec<f64> = behind
        .split_whitespace()
        .skip(11)
        .take(3)
        .filter_map(|t| t.parse().ok())
        .collect();
    match ticks[..] {
        [own, _, children] => Ok((own / 100.0, children / 100.0)),
        _ => Err("/proc/self/stat has other fields than expected".into()),
    }
}

/// Highest resident memory since it was reset, MiB.
fn peak_resident() -> Outcome<f64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).ok_or("no VmHWM")?;
    let kib: f64 = line.split_whitespace().next().unwrap_or_default().parse()?;
    Ok(kib / 1024.0)
}

/// Prints a row; false when it misses its budget.
fn measure(row: &Row, folder: &Path, alone: bool) -> Outcome<bool> {
    let path = folder.join("budget.nc");
    (row.write)(&mut BufWriter::new(File::create(&path)?), true)?;
    std::fs::write("/proc/self/clear_refs", "5")?; // the highest resident memory counts from here
    let needed = ours(&path, row.profile, if alone { 1 } else { RUNS })?;
    let resident = peak_resident()?;
    let theirs = match alone {
        true => None,
        false => {
            let path = folder.join("peer.ngc");
            (row.write)(&mut BufWriter::new(File::create(&path)?), false)?;
            peer(&path)?
        }
    };
    let rate = |seconds: f64| f64::from(COUNT) / seconds / 1e6;
    let (peers, ratio) = match theirs {
        Some(theirs) => (
            format!("{:.3}", rate(theirs.user)),
            format!("{:.1}, {:.1}", theirs.user / needed.user, theirs.wall / needed.wall),
        ),
        None => ("not run".to_owned(), "-".to_owned()),
    };
    let kept = row.budget.is_none_or(|budget| rate(needed.user) >= budget) && resident < MOST_RESIDENT;
    println!(
        "| {:<26} | {:<6} | {:>6} | {:>8.2} | {:>8.2} | {peers:>10} | {ratio:>18} | {resident:>8.1} | {} |",
        row.name,
        row.unit,
        row.budget.map_or("-".to_owned(), |b| format!(">= {b}")),
        rate(needed.user),
        rate(needed.wall),
        if kept { "kept" } else { "MISSED" },
    );
    Ok(kept)
}

fn main() -> Outcome<ExitCode> {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let alone = words.iter().any(|w| w == "alone");
    let chosen: Vec<&String> = words.iter().filter(|w| *w != "alone").collect();
    let folder = tempfile::tempdir()?;
    println!("Millions a second, mean of {RUNS} runs; resident memory at its highest, budget < {MOST_RESIDENT} MiB\n");
    println!(
        "| program                    | unit   | budget | by user time | on the wall | rs274 by user time | times as fast: user, wall | MiB | |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut all_kept = true;
    for row in &ROWS {
        if chosen.is_empty() || chosen.iter().any(|w| row.name.starts_with(w.as_str())) {
            all_kept &= measure(row, folder.path(), alone)?;
        }
    }
    Ok(if all_kept { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

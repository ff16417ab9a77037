//! How fast a long program is read, fully interpreted, and how much memory that takes.
//!
//! `cargo bench -p gcode`. The program is the million-line spiral that peers are measured with: `X50*cos ...` in three axes, four
//! decimals. It is written out before the clock starts, and read through the same windows as a file.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock and the process's memory"
)]

use gcode::{GcodeProgram, Options, profile::RS274};
use plan::{ByteSource, Next, NoOtherFiles, ProgramStream, ReadError, Tables};
use std::fmt::Write as _;
use std::rc::Rc;
use std::time::Instant;

/// Bytes that are shared with the bench, so that reading makes no copy of them beyond the window.
struct Shared(Rc<Vec<u8>>);

impl ByteSource for Shared {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, ReadError> {
        let rest = &self.0[(offset as usize).min(self.0.len())..];
        let count = rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&rest[..count]);
        Ok(count)
    }
}

fn spiral(lines: u32) -> Vec<u8> {
    let mut text = String::from("G17 G21 G90 G94 G54\nG0 X0 Y0 Z5\nF1000\n");
    for i in 0..lines {
        let t = 0.001 * f64::from(i);
        let r = 50.0 + 20.0 * libm::sin(0.013 * t);
        let _ = writeln!(
            text,
            "G1 X{:.4} Y{:.4} Z{:.4}",
            r * libm::cos(t),
            r * libm::sin(t),
            -5.0 * libm::sin(0.37 * t)
        );
    }
    text.push_str("M2\n");
    text.into_bytes()
}

fn assignments(lines: u32) -> Vec<u8> {
    let mut text = String::from("#1=1\n");
    for _ in 0..lines / 2 {
        text.push_str("#2=[#2+[#1*0.5]-[#1/3]]\n#1=[#1+1]\n");
    }
    text.push_str("M2\n");
    text.into_bytes()
}

fn measure(what: &str, text: Vec<u8>, lines: u32) {
    let text = Rc::new(text);
    let before = resident_kib();
    let started = Instant::now();
    let mut program = GcodeProgram::open(
        Box::new(Shared(Rc::clone(&text))),
        "spiral.nc",
        &RS274,
        Box::new(NoOtherFiles),
        Tables::empty(),
        Options::default(),
    )
    .expect("it is a program");
    let mut steps = 0_u64;
    loop {
        match program.next(None) {
            Next::Step(_) => steps += 1,
            Next::End => break,
            other => panic!("{other:?}"),
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{what:<12} {lines} lines, {:.1} MB: {seconds:.3} s, {:.2} M lines/s, {steps} steps, {} KiB more resident",
        text.len() as f64 / 1e6,
        f64::from(lines) / seconds / 1e6,
        resident_kib().saturating_sub(before)
    );
}

/// Resident memory of this process, KiB; 0 where the system does not say.
fn resident_kib() -> u64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|s| s.lines().find_map(|l| l.strip_prefix("VmRSS:").map(str::to_owned)))
        .and_then(|v| v.split_whitespace().next().and_then(|n| n.parse().ok()))
        .unwrap_or(0)
}

fn main() {
    for _ in 0..3 {
        measure("moves", spiral(1_000_000), 1_000_000);
    }
    measure("assignments", assignments(1_000_000), 1_000_000);
}

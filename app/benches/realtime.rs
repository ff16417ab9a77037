//! How late the realtime task wakes up on this machine under load, beside `cyclictest` in the same run.
//!
//! `cargo bench -p toolmark --bench realtime -- --seconds 60`: controller and simulated plant machine `corpus/bracket.stpnc` in real time,
//! again and again, on a thread with the privileges that the system grants, while other threads load every processor, memory and disk. Then
//! `cyclictest` (Debian: rt-tests) does the same time under the same load. With SCHED_FIFO, p99 above [`BUDGET_US`] or any allocation on
//! the thread is exit code 1.

#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write")]

#[allow(
    dead_code,
    unused_imports,
    reason = "the program uses all of it, the bench what it measures, and its tests are not run here"
)]
#[path = "../src/controller/realtime/mod.rs"]
mod realtime;

use cell::{Ended, OfficeHalf, Operator};
use ledger::Chain;
use machine::{MachineParameters, Plant, Quality, RealtimeHalf, Request};
use motion::{Limits, Trajectory};
use realtime::lateness::Lateness;
use realtime::{AtOnce, Privileges, Punctuality, Queued, Servo, Told, every_cycle};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::error::Error;
use std::hint::black_box;
use std::io::Write;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use stepnc::{Program, StepNcStream, StreamOptions};
use store::{MachineFile, MachineKind};
use units::{Machine, Millimetres, Point, Timestamp};

/// p99 with SCHED_FIFO, microseconds (DESIGN section 9).
const BUDGET_US: f64 = 50.0;
const PROGRAM: &str = "bracket.stpnc";
/// As many late cycles in a row as a machine file without a word of it lets simulated drives wait for.
const MADE_UP: u64 = 500;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged; the counter neither allocates nor panics.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let seconds = seconds()?;
    let load = Load::begin()?;
    println!(
        "{PROGRAM} by controller and plant, 1 ms, {seconds} s, {} threads of load, load average {}",
        load.threads.len(),
        std::fs::read_to_string("/proc/loadavg").unwrap_or_default().trim()
    );
    let good = our_loop(seconds)?;
    cyclictest(seconds);
    load.end();
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// `--seconds N`; what cargo adds is passed over.
fn seconds() -> Result<u64, Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    match words.iter().position(|word| word == "--seconds") {
        None => Ok(10),
        Some(at) => {
            let given = words.get(at + 1).ok_or("--seconds needs a number")?;
            Ok(given
                .parse()
                .map_err(|_| format!("--seconds {given}: a number was expected"))?)
        }
    }
}

fn our_loop(seconds: u64) -> Result<bool, Box<dyn Error>> {
    let program = Arc::new(Program::read(PROGRAM, std::fs::read(corpus())?)?);
    let parameters = MachineParameters::small_machining_centre();
    let plant = Plant::new(&parameters, Point::ORIGIN, 1);
    let (mut servo, mut ends) = Servo::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated), None);
    let (punctuality, stop) = (Punctuality::default(), AtomicBool::new(false));
    let (allocations, privileges, cost, parts, counted) = std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            let privileges = Privileges::take();
            let cost = Lateness::default();
            let before = ALLOCATIONS.get();
            every_cycle(&punctuality, &stop, MADE_UP, |tick, late| {
                let began = Instant::now();
                servo.late_cycle(tick, late);
                cost.add(began.elapsed());
            });
            (ALLOCATIONS.get() - before, privileges, cost.summary())
        });
        ends.at_once
            .push(AtOnce::Request(Request::PowerOn))
            .expect("the ring is empty");
        let until = Instant::now() + Duration::from_secs(seconds);
        let (mut parts, mut position, mut counted) = (0, Point::ORIGIN, None);
        'parts: loop {
            let limits = Limits {
                v_max: parameters.axes.map(|a| a.v_max),
                a_max: parameters.axes.map(|a| a.a_max),
                j_max: None,
                tolerance: Millimetres(0.01),
            };
            let mut office = OfficeHalf::new(
                Trajectory::new(stream(&program, position), position, limits),
                Operator::default(),
                Timestamp(0),
                Chain::default(),
            );
            // What an earlier part was counted as done is not this one's.
            let before = counted.map_or(0, |c: machine::Counters| c.completed);
            loop {
                office.refill(|command| ends.queued.push(Queued::Command(command)).map_err(|_| command));
                while let Ok(Told { mut report, .. }) = ends.told.pop() {
                    counted = Some(report.counters);
                    position = Point::from_xyz(report.sample.commanded);
                    report.counters.completed -= before;
                    if let Some(request) = office.receive(&report, None, &mut ()) {
                        // Asked again with the next report when there is no place now.
                        let _ = ends.at_once.push(AtOnce::Request(request));
                    }
                }
                if Instant::now() >= until {
                    break 'parts;
                }
                match office.ended() {
                    None => {}
                    Some(Ended::Completed) => break,
                    Some(other) => {
                        println!("the run ended early: {}", other.text());
                        break 'parts;
                    }
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            parts += 1;
        }
        stop.store(true, Relaxed);
        let (allocations, privileges, cost) = thread.join().expect("the realtime thread does not panic");
        (allocations, privileges, cost, parts, counted)
    });
    let summary = punctuality.cycles.summary();
    println!("toolmark: {privileges}");
    println!("woken up by the system: {}", punctuality.wake_ups.summary());
    println!("cycles began: {summary}");
    summary.bars().iter().for_each(|line| println!("{line}"));
    println!(
        "one cycle takes p50 {:.1} us, p99.9 {:.1} us, at most {:.1} us",
        cost.p50_us, cost.p999_us, cost.max_us
    );
    if let Some(counted) = counted {
        println!(
            "{parts} parts whole; {} commands done, {} late ticks, {} starvations",
            counted.completed, counted.late_ticks, counted.starvations
        );
    }
    privileges.lacks().iter().for_each(|line| println!("{line}"));
    println!("{allocations} allocations or releases on the thread");
    let punctual = !privileges.complete() || summary.p99_us <= BUDGET_US;
    if privileges.complete() {
        println!(
            "budget: p99 <= {BUDGET_US} us with SCHED_FIFO, {}",
            if punctual { "kept" } else { "MISSED" }
        );
    } else {
        println!("budget: not judged without SCHED_FIFO, locked memory and a processor");
    }
    Ok(punctual && allocations == 0)
}

fn corpus() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus").join(PROGRAM)
}

/// The next part begins where the last one left the machine.
fn stream(program: &Arc<Program>, position: Point<Machine>) -> Box<StepNcStream> {
    let file = MachineFile::simulated(MachineKind::Mill);
    let mut tables = store::registers::tables(&file, &Default::default()).expect("the built-in machine has good offsets");
    tables.position = position;
    Box::new(StepNcStream::new(
        Arc::clone(program),
        StreamOptions {
            tables,
            ..StreamOptions::default()
        },
    ))
}

/// The peer: the same time with the same priority, under the same load.
fn cyclictest(seconds: u64) {
    let time = format!("-D{seconds}s");
    let called = Command::new("cyclictest")
        .args(["--policy=fifo", "-p80", "-m", "-t1", "-i1000", "-q", "-h20000", &time])
        .stderr(Stdio::inherit())
        .output();
    let output = match called {
        Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout).into_owned(),
        Ok(output) => return println!("cyclictest: skipped: it ended with {}", output.status),
        Err(error) => return println!("cyclictest: skipped: {error}; install the Debian package rt-tests"),
    };
    let lateness = Lateness::default();
    for line in output.lines() {
        let mut words = line.split_whitespace().map(str::parse::<u64>);
        if let (Some(Ok(late)), Some(Ok(count))) = (words.next(), words.next()) {
            (0..count).for_each(|_| lateness.add(Duration::from_micros(late)));
        }
    }
    println!("cyclictest --policy=fifo -p80 -m: {}", lateness.summary());
    let words = |name: &str| output.lines().find(|line| line.contains(name)).unwrap_or_default().to_owned();
    println!("its own words: {}; {}", words("Max Latencies"), words("Histogram Overflows"));
}

/// Threads that load every processor, the memory and the disk.
struct Load {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Load {
    fn begin() -> Result<Load, Box<dyn Error>> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut threads = Vec::new();
        let processors = std::thread::available_parallelism()?.get();
        // One to a processor works in its cache, as a compiler does; one copies between memory that no cache holds.
        for words in [1 << 15; 64].into_iter().take(processors).chain([4 << 20]) {
            let stop = Arc::clone(&stop);
            threads.push(std::thread::spawn(move || {
                let (mut from, mut to) = (vec![1u64; words], vec![0u64; words]);
                while !stop.load(Relaxed) {
                    for (to, from) in to.iter_mut().zip(&from) {
                        *to = from.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(*to);
                    }
                    std::mem::swap(&mut from, black_box(&mut to));
                }
            }));
        }
        let mut file = tempfile::tempfile()?;
        let stopped = Arc::clone(&stop);
        threads.push(std::thread::spawn(move || {
            let block = vec![7u8; 1 << 20];
            while !stopped.load(Relaxed) {
                let written = file
                    .write_all(&block)
                    .and_then(|()| file.sync_data())
                    .and_then(|()| file.set_len(0));
                if let Err(error) = written {
                    return println!("the disk is not loaded: {error}");
                }
                let _ = std::io::Seek::rewind(&mut file);
                std::thread::sleep(Duration::from_millis(10));
            }
        }));
        Ok(Load { stop, threads })
    }

    fn end(self) {
        self.stop.store(true, Relaxed);
        for thread in self.threads {
            thread.join().expect("a thread of load does not panic");
        }
    }
}

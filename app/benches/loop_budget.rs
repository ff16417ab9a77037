//! How much faster than real time the simulated world runs on one thread, with and without its record on disk: rows acknowledged in
//! segments by a thread of their own, merged into one Parquet file at the end.
//!
//! `cargo bench -p toolmark --bench loop_budget`: plans, executes and records `corpus/bracket.stpnc` with all channels at 1 kHz into a
//! temporary folder, five times each, and prints medians. Below [`BUDGET`] with the record attached the exit code is 1.

use cell::{Ended, Operator, Outcome, RecordSink, World, WorldConfig};
use ledger::{Event, Hash};
use machine::{CHANNELS, Sample};
use motion::{Limits, Trajectory};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;
use stepnc::{Program, StepNcStream, StreamOptions};
use store::record::{Header, SampleRows};
use store::segment::{self, Pace, Recorder, Settings};
use store::{MachineFile, MachineKind};
use units::{Millimetres, Timestamp};

/// Seconds of machine time that a second on the wall has to be worth, with the record attached.
const BUDGET: f64 = 200.0;
/// Runs of each kind.
const RUNS: usize = 5;

const PROGRAM: &str = "bracket.stpnc";

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus").join(PROGRAM);
    let program = Arc::new(Program::read(PROGRAM, std::fs::read(path)?)?);
    let folder = tempfile::tempdir()?;
    println!(
        "{PROGRAM}, {} channels at 1 kHz, one thread, median of {RUNS}",
        CHANNELS.len()
    );
    let mut ratio = 0.0;
    for recorded in [false, true] {
        let mut runs = Vec::new();
        for _ in 0..RUNS {
            let record = recorded.then(|| folder.path().join("record.parquet"));
            runs.push(run(&program, record.as_deref())?);
        }
        runs.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (machine, wall) = runs[RUNS / 2];
        ratio = machine / wall;
        println!(
            "{:<15} {machine:7.2} s of machine time in {wall:.3} s: {ratio:5.0} x real time",
            if recorded { "with record" } else { "without record" }
        );
    }
    let good = ratio >= BUDGET;
    println!("budget with record: {BUDGET:.0} x, {}", if good { "kept" } else { "MISSED" });
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Seconds of machine time and on the wall, from the first step read to the last byte on disk.
fn run(program: &Arc<Program>, record: Option<&Path>) -> Result<(f64, f64), Box<dyn Error>> {
    let file = MachineFile::simulated(MachineKind::Mill);
    let tables = store::registers::tables(&file, &Default::default())?;
    let config = WorldConfig {
        operator: Operator {
            optional_stop: false,
            cycle_start_after: Some(1000),
        },
        ..WorldConfig::default()
    };
    let limits = Limits {
        v_max: config.machine.axes.map(|a| a.v_max),
        a_max: config.machine.axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    };
    let began = Instant::now();
    let stream = Box::new(StepNcStream::new(
        Arc::clone(program),
        StreamOptions {
            tables,
            ..StreamOptions::default()
        },
    ));
    let trajectory = Trajectory::new(stream, config.position, limits);
    let mut world = World::new(config, trajectory)?;
    let outcome: Outcome = match record {
        None => world.run(&mut ()),
        Some(path) => {
            let header = Header {
                machine: file.name.clone(),
                simulated: true,
                start: Timestamp(0),
                seed: 1,
            };
            let folder = path.with_extension("recording");
            let rows = SampleRows::new(header.start, path);
            let mut rows = Rows(
                Recorder::begin(&folder, rows, header.metadata(), &Settings::new(Pace::Simulated))?,
                vec![],
            );
            let outcome = world.run(&mut rows);
            let Rows(recorder, events) = rows;
            let ended = recorder.end()?;
            let merged = segment::merge(&folder, path, &events, &[])?;
            segment::discard(&folder)?;
            assert_eq!((merged.finished.rows, ended.health.missed), (outcome.samples, 0));
            assert!(merged.finished.hash != Hash::default());
            outcome
        }
    };
    let wall = began.elapsed().as_secs_f64();
    assert_eq!(outcome.ended, Ended::Completed);
    Ok((outcome.time.0, wall))
}

/// What a run of the program `toolmark` does with its samples and events.
struct Rows(Recorder<SampleRows>, Vec<Event>);

impl RecordSink for Rows {
    fn sample(&mut self, sample: &Sample) {
        // A missed row would be missing in the count at the end.
        let _ = self.0.offer(sample);
    }
    fn event(&mut self, event: &Event) {
        self.1.push(event.clone());
    }
}

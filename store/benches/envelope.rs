//! How long a curve takes: 2000 pixels over 100 million rows of one channel, at any zoom, and what the roll-ups cost on disk.
//!
//! `cargo bench -p store --bench envelope`. ROWS sets another number of rows, SEED other ranges, DIRECTORY a folder that is kept and used
//! again (the rows of another number are not looked at).

use arrow_array::{ArrayRef, Int32Array, Int64Array, RecordBatch, TimestampMicrosecondArray, UInt8Array};
use ledger::Hash;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use store::record::{ColumnsWriter, Header};
use store::segment::{Column, Layout};
use store::{DataDirectory, Ending, NewJob, Of, Span};
use units::Timestamp;

const START: Timestamp = Timestamp(1_795_132_800_000_000_000);
const MACHINE: &str = "bench-mill";
/// 17 minutes at 1 kHz, as records are cut.
const ROWS_OF_A_FILE: u64 = 1_000_000;
const PAGE: u64 = 8192;
const PIXELS: usize = 2000;
const RANGES: usize = 200;
const BUDGET_MS: f64 = 20.0;

fn from_environment(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(otherwise)
}

fn main() {
    let rows = from_environment("ROWS", 100_000_000);
    let mut random = ChaCha8Rng::seed_from_u64(from_environment("SEED", 1));
    let temporary = tempfile::tempdir().expect("a folder");
    let kept = std::env::var_os("DIRECTORY").map(std::path::PathBuf::from);
    let folder = kept.as_deref().unwrap_or(temporary.path());
    let mut directory = DataDirectory::open(folder, "bench").expect("free");
    let there: u64 = directory.records().expect("reads").iter().map(|r| r.rows).sum();
    if there < rows {
        let began = Instant::now();
        fill(&mut directory, &mut random, there, rows);
        println!("{rows} rows written and rolled up in {:.0} s", began.elapsed().as_secs_f64());
    }
    let records = directory.records().expect("reads");
    let raw: u64 = records.iter().map(|r| r.bytes).sum();
    let rolled: u64 = (records.iter())
        .map(|r| directory.rollup_path(r).metadata().expect("made with the record").len())
        .sum();
    // Building alone, of one file that the system has read already.
    let one = &records[0];
    let again = folder.join("again.rollup");
    let began = Instant::now();
    store::rollup::build(&one.path, one.hash, &again).expect("built");
    let building = began.elapsed().as_secs_f64();

    let end_ns = START.0 + rows as i64 * 1_000_000;
    let whole = (START.0, end_ns);
    let mut part = || random.next_u64() as f64 / u64::MAX as f64;
    let mut uniform = Vec::new();
    let mut zoomed = Vec::new();
    let mut awkward = Vec::new();
    for _ in 0..RANGES {
        let (a, b) = (part(), part());
        let at = |part: f64| START.0 + (part * (end_ns - START.0) as f64) as i64;
        uniform.push((at(a.min(b)), at(a.max(b)) + 1));
        // From two seconds to everything, each zoom as often as any other.
        let width = (2e9_f64.ln() + part() * ((end_ns - START.0) as f64 / 2e9).ln()).exp() as i64;
        let from = START.0 + (part() * (end_ns - START.0 - width) as f64) as i64;
        zoomed.push((from, from + width));
        // Pixels of 257 to 511 rows: little wider than the finest bucket, the dearest zooms that there are.
        let width = (PIXELS as f64 * (257.0 + part() * 254.0) * 1e6) as i64;
        let from = START.0 + (part() * (end_ns - START.0 - width) as f64) as i64;
        awkward.push((from, from + width));
    }
    println!(
        "\n{} files, {:.1} MB of records, {:.1} MB of roll-ups\n",
        records.len(),
        raw as f64 / 1e6,
        rolled as f64 / 1e6
    );
    println!("| what | p50 | p95 | worst | budget | | mean of processor time |\n|---|---|---|---|---|---|---|");
    let mut good = true;
    for (name, spans) in [
        ("whole range", vec![whole; 20]),
        ("random ranges", uniform),
        ("random zooms", zoomed),
        ("zooms to pixels of 1 to 2 buckets", awkward),
    ] {
        let (before, count) = (processor_ms(), spans.len() as f64);
        let mut took: Vec<f64> = spans.iter().map(|span| draw(&directory, *span)).collect();
        let processor = (processor_ms() - before) / count;
        took.sort_by(f64::total_cmp);
        let at = |part: f64| took[((took.len() - 1) as f64 * part) as usize];
        let (p50, p95, worst) = (at(0.5), at(0.95), at(1.0));
        good &= p95 <= BUDGET_MS;
        let word = if p95 <= BUDGET_MS { "good" } else { "OVER" };
        println!(
            "| {name}, {PIXELS} pixels, ms | {p50:.1} | {p95:.1} | {worst:.1} | p95 <= {BUDGET_MS} | {word} | {processor:.1} |"
        );
    }
    let ratio = rolled as f64 / raw as f64 * 100.0;
    let word = if ratio <= 5.0 { "good" } else { "OVER" };
    println!("| roll-ups, % of the records | {ratio:.2} | | | <= 5 | {word} | |");
    println!("| building one of {} rows, s | {building:.2} | | | | | |", one.rows);
    if !good || ratio > 5.0 {
        std::process::exit(1);
    }
}

/// What this process has taken of the processors so far: on a busy machine it tells more than the clock on the wall. 0 where the system
/// does not say.
fn processor_ms() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    // Fields 14 and 15 of proc(5), in ticks of 10 ms.
    let ticks = after_name.split_whitespace().skip(11).take(2);
    ticks.filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() * 10.0
}

/// Draws one curve; gives milliseconds.
fn draw(directory: &DataDirectory, (from, to): (i64, i64)) -> f64 {
    let span = Span {
        from: Timestamp(from),
        to: Timestamp(to),
    };
    let began = Instant::now();
    let curve = directory
        .envelope(Of::Machine(MACHINE), "X.LOAD", span, PIXELS)
        .expect("drawn");
    let took = began.elapsed().as_secs_f64() * 1e3;
    assert!(curve.pixels.iter().all(|p| !p.coarse) && curve.pixels.iter().map(|p| p.rows).sum::<u64>() > 0);
    took
}

/// Rows at 1 kHz: a load that drifts with noise of four quanta rms, a position on an arc with the noise of an encoder.
fn fill(directory: &mut DataDirectory, random: &mut ChaCha8Rng, from: u64, to: u64) {
    let layout = Layout::samples([
        Column::reading("X.LOAD", "PERCENT", 0.1, 0.0),
        Column::reading("X.POSITION.ACTUAL", "MILLIMETER", 0.001, 0.0),
    ]);
    let schema = layout.schema();
    // The sum of four bytes: near to a normal distribution, and fast.
    let mut noise = || {
        let word = random.next_u32().to_le_bytes();
        // Mean 510, standard deviation 148.
        (word.iter().map(|b| i32::from(*b)).sum::<i32>() - 510) / 37
    };
    let mut at = from;
    while at < to {
        let end = (at + ROWS_OF_A_FILE).min(to);
        let start = Timestamp(START.0 + at as i64 * 1_000_000);
        let job = directory
            .begin_job(&NewJob {
                program: "part.nc",
                program_hash: Hash::of(b"part"),
                machine: MACHINE,
                seed: 1,
                start,
                folder: None,
                who: "bench",
            })
            .expect("begins")
            .id;
        let path = directory.record_path(MACHINE, start, job);
        let header = Header {
            machine: MACHINE.into(),
            simulated: true,
            start,
            seed: 1,
        };
        let mut writer = ColumnsWriter::create(Path::new(&path), &header, &layout).expect("made");
        let first = at;
        while at < end {
            let n = (end - at).min(PAGE);
            let numbers = at..at + n;
            let small = |number: i32| Arc::new(Int32Array::from(vec![number; n as usize])) as ArrayRef;
            let state = || Arc::new(UInt8Array::from(vec![1u8; n as usize])) as ArrayRef;
            let times = numbers.clone().map(|k| START.0 / 1000 + k as i64 * 1000);
            let swing = |k: u64| (40_000.0 * (k as f64 * 0.0005).sin()) as i32;
            let columns: Vec<ArrayRef> = vec![
                Arc::new(TimestampMicrosecondArray::from_iter_values(times).with_timezone("UTC")),
                Arc::new(Int64Array::from_iter_values(numbers.clone().map(|k| (k - first) as i64))),
                small((at / 5000) as i32),
                small((at / 60_000 % 50) as i32 + 1),
                small(4),
                state(),
                state(),
                Arc::new(Int32Array::from_iter_values(
                    numbers.clone().map(|k| 200 + (k / 100_000 % 300) as i32 + noise()),
                )),
                Arc::new(Int32Array::from_iter_values(numbers.map(|k| swing(k) + noise() / 8))),
            ];
            writer
                .write(&RecordBatch::try_new(schema.clone(), columns).expect("as the layout says"))
                .expect("written");
            at += n;
        }
        let finished = writer.finish(&[]).expect("finished");
        directory.catalogue(job, &finished, start).expect("catalogued");
        directory.end_job(job, start, Ending::Done).expect("ends");
    }
}

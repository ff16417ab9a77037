//! Sixty-four channels at 1 kHz through segments to Parquet: bytes a value, memory, speed, beside CSV and SQLite rows of the same data;
//! and how long rows wait for their acknowledgement on a slow disk.
//!
//! `cargo bench -p store --bench record_budget`: two simulated hours; `HOURS=8` for more. Above a byte a value, with a reading that came
//! back changed, or with a sampling side that waited on a slow disk, the exit code is 1.

#[path = "../tests/common/wide.rs"]
mod wide;

use std::error::Error;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};
use store::record::{Header, Reader};
use store::segment::trouble::TroubledDisk;
use store::segment::{self, Holds, Offered, Pace, ReadingRows, Recorder, Settings};
use units::Timestamp;
use wide::CHANNELS;

/// Bytes of a value on disk.
const BUDGET: f64 = 1.0;
/// Rows for the peers: they are slow, and their bytes a value do not depend on it.
const PEER_ROWS: u64 = 60_000;
/// Resident memory may grow by this much from the first hour on, KiB.
const MEMORY: u64 = 16 * 1024;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let hours: u64 = std::env::var("HOURS").ok().and_then(|h| h.parse().ok()).unwrap_or(2);
    let folder = tempfile::tempdir()?;
    println!("{CHANNELS} channels at 1 kHz, {hours} simulated hours\n");
    println!("| what | bytes a value | budget | values/s | kept |\n|---|---|---|---|---|");
    let mut good = ours(folder.path(), hours)?;
    let (bytes, seconds) = csv(&folder.path().join("peer.csv"))?;
    peer("CSV, shortest decimals", bytes, seconds);
    let (bytes, seconds) = sqlite(&folder.path().join("peer.sqlite"))?;
    peer("SQLite, one REAL a value", bytes, seconds);
    good &= slow_disk(folder.path())?;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn peer(what: &str, bytes: u64, seconds: f64) {
    let values = (PEER_ROWS * CHANNELS as u64) as f64;
    println!(
        "| {what} | {:.2} | - | {:.1} M | - |",
        bytes as f64 / values,
        values / seconds / 1e6
    );
}

fn header() -> Header {
    Header {
        machine: "wide".into(),
        simulated: true,
        start: Timestamp(0),
        seed: 1,
    }
}

fn ours(folder: &Path, hours: u64) -> Result<bool, Box<dyn Error>> {
    let place = folder.join("recording");
    let rows = hours * 3_600_000;
    let columns = wide::columns();
    let began = Instant::now();
    let gather = ReadingRows::<CHANNELS>::new(&columns, Timestamp(0), &place).ok_or("64 readings")?;
    let mut recorder = Recorder::begin(&place, gather, header().metadata(), &Settings::new(Pace::Simulated))?;
    let mut machine = wide::Machine::new();
    let (mut memory, mut most_on_disk) = (Vec::new(), 0);
    for k in 0..rows {
        if recorder.offer(&machine.row()) == Offered::Missed {
            return Err("a row was lost".into());
        }
        if k % 900_000 == 899_999 {
            memory.push(resident());
            most_on_disk = most_on_disk.max(bytes_in(&place)?);
        }
    }
    recorder.end()?;
    let recorded = began.elapsed().as_secs_f64();
    let merged = segment::merge(&place, &folder.join("record.parquet"), &[], &[])?;
    memory.push(resident());
    segment::discard(&place)?;
    let seconds = began.elapsed().as_secs_f64();
    let values = (rows * CHANNELS as u64) as f64;
    let each = merged.finished.bytes as f64 / values;
    let same = bit_equal(&merged.finished.path)?;
    println!(
        "| record.parquet | {each:.3} | {BUDGET:.1} | {:.1} M | {} |",
        values / seconds / 1e6,
        if each <= BUDGET { "yes" } else { "MISSED" }
    );
    println!(
        "| most on disk on the way | {:.2} | - | {:.1} M | - |",
        most_on_disk as f64 / values,
        values / recorded / 1e6
    );
    // The first hour fills what is kept for ever: rings, pages, the allocator's holes.
    let early = memory.iter().take(4).max().copied().unwrap_or(0);
    let late = memory.iter().max().copied().unwrap_or(0);
    let constant = late <= early + MEMORY;
    println!(
        "\n{} rows, decoded {}; resident memory every 15 minutes, MiB: {:?}: {}\n",
        merged.finished.rows,
        if same { "bit-equal" } else { "DIFFERENT" },
        memory.iter().map(|kib| kib / 1024).collect::<Vec<_>>(),
        if constant { "constant" } else { "GROWING" }
    );
    println!("| peer, {PEER_ROWS} rows | bytes a value | budget | values/s | kept |\n|---|---|---|---|---|");
    Ok(each <= BUDGET && same && constant && merged.finished.rows == rows)
}

fn bit_equal(path: &Path) -> Result<bool, Box<dyn Error>> {
    let (columns, mut machine) = (wide::columns(), wide::Machine::new());
    for batch in Reader::open(path)?.batches()? {
        let batch = batch?;
        let raw: Vec<_> = columns
            .iter()
            .map(|c| batch.raw(&c.name).ok_or("a column"))
            .collect::<Result<_, _>>()?;
        for k in 0..batch.len() {
            let row = machine.row();
            for ((column, raw), value) in columns.iter().zip(&raw).zip(row.values) {
                if let Holds::Reading { scale, offset, .. } = &column.holds
                    && raw.value(k) != ((value - offset) / scale).round() as i32
                {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

fn csv(path: &Path) -> Result<(u64, f64), Box<dyn Error>> {
    let began = Instant::now();
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let (scales, mut machine) = (scales(), wide::Machine::new());
    for _ in 0..PEER_ROWS {
        let row = machine.row();
        write!(file, "{}", row.tick.0)?;
        for (value, scale) in row.values.iter().zip(&scales) {
            write!(file, ",{}", decimal(*value, *scale))?;
        }
        writeln!(file)?;
    }
    file.into_inner()?.sync_all()?;
    Ok((path.metadata()?.len(), began.elapsed().as_secs_f64()))
}

fn sqlite(path: &Path) -> Result<(u64, f64), Box<dyn Error>> {
    let began = Instant::now();
    let mut database = rusqlite::Connection::open(path)?;
    let columns: Vec<String> = (0..CHANNELS).map(|k| format!("c{k} REAL")).collect();
    database.execute_batch(&format!(
        "CREATE TABLE samples (tick INTEGER PRIMARY KEY, {})",
        columns.join(", ")
    ))?;
    let places = vec!["?"; CHANNELS + 1].join(", ");
    let (scales, mut machine) = (scales(), wide::Machine::new());
    for _ in 0..PEER_ROWS / 1000 {
        let transaction = database.transaction()?;
        {
            let mut insert = transaction.prepare_cached(&format!("INSERT INTO samples VALUES ({places})"))?;
            for _ in 0..1000 {
                let row = machine.row();
                let values = row.values.iter().zip(&scales).map(|(value, scale)| decimal(*value, *scale));
                insert.execute(rusqlite::params_from_iter(std::iter::once(row.tick.0 as f64).chain(values)))?;
            }
        }
        transaction.commit()?;
    }
    drop(database);
    Ok((path.metadata()?.len(), began.elapsed().as_secs_f64()))
}

fn scales() -> Vec<f64> {
    let scale = |column: segment::Column| match column.holds {
        Holds::Reading { scale, .. } => scale,
        _ => 1.0,
    };
    wide::columns().into_iter().map(scale).collect()
}

/// The decimal number that the channel resolves: 123.457 and not 123.45700000000001.
fn decimal(value: f64, scale: f64) -> f64 {
    (value / scale).round() / (1.0 / scale).round()
}

/// Ten seconds of a machine in real time on a disk whose syncs take what an SD card's do.
fn slow_disk(folder: &Path) -> Result<bool, Box<dyn Error>> {
    let disk = TroubledDisk::default();
    let settings = Settings {
        disk: Arc::new(disk.clone()),
        ..Settings::new(Pace::Real)
    };
    let place = folder.join("slow");
    let gather = ReadingRows::<CHANNELS>::new(&wide::columns(), Timestamp(0), &place).ok_or("64 readings")?;
    let mut recorder = Recorder::begin(&place, gather, header().metadata(), &settings)?;
    let delays = [8, 8, 165, 8, 8, 40, 900, 8, 8, 300, 8, 8, 8, 60, 8, 8, 8, 500, 8, 8];
    disk.slow(&delays.map(Duration::from_millis));
    let mut machine = wide::Machine::new();
    let (began, mut longest) = (Instant::now(), Duration::ZERO);
    for k in 0..10_000_u64 {
        std::thread::sleep(Duration::from_millis(k).saturating_sub(began.elapsed()));
        let row = machine.row();
        let offered = Instant::now();
        let _ = recorder.offer(&row);
        longest = longest.max(offered.elapsed());
    }
    let watch = recorder.watch();
    let ended = recorder.end()?;
    println!("\na slow disk, syncs of {delays:?} ms, group commit each 100 ms, 10 s at 1 kHz:");
    println!("  {}", watch.latencies());
    println!(
        "  the sampling side waited {} times; {} rows missed; its longest hand-over took {} us",
        ended.waits,
        ended.health.missed,
        longest.as_micros()
    );
    Ok(ended.waits == 0 && ended.health.missed == 0)
}

fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        // A segment may go away between the list and the look at it.
        bytes += entry?.metadata().map_or(0, |m| m.len());
    }
    Ok(bytes)
}

/// Memory of this process now, KiB; 0 where the system does not tell.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"));
    line.and_then(|l| l.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}

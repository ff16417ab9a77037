//! Sixty-four channels through segments to Parquet: the memory stays the same however long it gets, and the readings are the same bits.
//! A program of its own, so that no other test is counted.

#[path = "common/wide.rs"]
mod wide;

use std::path::Path;
use store::record::{Header, Reader};
use store::segment::{self, Merged, Offered, Pace, ReadingRows, Recorder, Settings};
use units::Timestamp;

fn header() -> Header {
    Header {
        machine: "wide".into(),
        simulated: true,
        start: Timestamp(0),
        seed: 1,
    }
}

/// Records so many rows; gives the record and the most memory that was taken at half of it, at its end and when it was merged, KiB.
fn record(folder: &Path, rows: u64) -> (Merged, [Option<u64>; 3]) {
    let settings = Settings {
        segment_rows: 20_000,
        ..Settings::new(Pace::Simulated)
    };
    let columns = ReadingRows::<64>::new(&wide::columns(), Timestamp(0), folder).expect("64 readings");
    let mut recorder = Recorder::begin(folder, columns, header().metadata(), &settings).expect("begun");
    let mut machine = wide::Machine::new();
    let mut half = None;
    for row in 0..rows {
        assert_eq!(recorder.offer(&machine.row()), Offered::Taken);
        if row == rows / 2 {
            half = peak();
        }
    }
    recorder.end().expect("ended");
    let end = peak();
    let merged = segment::merge(folder, &folder.with_extension("parquet"), &[], &[]).expect("merged");
    segment::discard(folder).expect("discarded");
    (merged, [half, end, peak()])
}

/// The most that this process ever had in memory, KiB.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches(" kB").parse().ok()
}

#[test]
fn sixty_four_channels_take_a_byte_a_value_and_the_same_memory_however_long() {
    let folder = tempfile::tempdir().expect("a folder");
    let (long, memory) = record(&folder.path().join("long"), 1_200_000);
    let (short, _) = record(&folder.path().join("short"), 100_000);
    for merged in [&short, &long] {
        let values = merged.finished.rows * wide::CHANNELS as u64;
        let each = merged.finished.bytes as f64 / values as f64;
        println!("{} rows: {each:.3} bytes per value", merged.finished.rows);
        assert!(each <= 1.0, "{each} bytes per value");
        assert_eq!((merged.finished.unavailable, merged.gaps.len()), (0, 0));
    }
    let reader = Reader::open(&short.finished.path).expect("ours");
    let (columns, mut machine) = (wide::columns(), wide::Machine::new());
    for batch in reader.batches().expect("reads") {
        let batch = batch.expect("whole");
        let raw: Vec<_> = columns.iter().map(|c| batch.raw(&c.name).expect("a column")).collect();
        for k in 0..batch.len() {
            let row = machine.row();
            for ((column, raw), value) in columns.iter().zip(&raw).zip(row.values) {
                let segment::Holds::Reading { scale, offset, .. } = &column.holds else {
                    unreachable!("all are readings");
                };
                assert_eq!(raw.value(k), ((value - offset) / scale).round() as i32, "{}", column.name);
            }
        }
    }
    let [Some(half), Some(end), Some(merged)] = memory else {
        println!("skipped: this system does not tell the peak of memory in /proc/self/status");
        return;
    };
    println!("peak {half} KiB after 600 000 rows, {end} KiB after 1 200 000, {merged} KiB when they were merged");
    // The second half is 146 MiB of readings and 17 MiB of the finished file. Merging has a row group of that file in memory, 8 MiB.
    assert!(end < half + 16 * 1024, "{half} KiB grew to {end} KiB");
    assert!(merged < end + 32 * 1024, "{end} KiB grew to {merged} KiB");
}

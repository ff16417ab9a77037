//! A record takes the same memory however long it gets. A program of its own, so that no other test is counted.

use machine::Sample;
use std::path::Path;
use store::record::{Header, Writer};
use units::{Tick, Timestamp};

fn write(path: &Path, rows: u64) {
    let header = Header {
        machine: "sim-mill".into(),
        simulated: true,
        start: Timestamp(0),
        seed: 1,
    };
    let mut writer = Writer::create(path, &header).expect("made");
    let mut random = 1_u64;
    for tick in 0..rows {
        // Knuth's MMIX generator: noise that does not compress away.
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let noise = (random >> 54) as f64;
        let sample = Sample {
            tick: Tick(tick),
            actual: [noise * 0.001, tick as f64 * 0.001, 0.0],
            load: [noise * 0.1; 3],
            current: [noise * 0.01; 3],
            ..Sample::default()
        };
        writer.write(&sample).expect("written");
    }
    writer.finish(&[]).expect("finished");
}

/// The most that this process ever had in memory, KiB.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches(" kB").parse().ok()
}

#[test]
fn a_record_four_times_as_long_takes_no_more_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("record.parquet");
    // More than one row group; twice, because the allocator keeps some of the first writer's holes.
    write(&path, 300_000);
    write(&path, 300_000);
    let Some(short) = peak() else {
        println!("skipped: this system does not tell the peak of memory in /proc/self/status");
        return;
    };
    write(&path, 1_200_000);
    let long = peak().expect("it did a moment ago");
    println!("peak {short} KiB with 300 000 rows, {long} KiB with 1 200 000");
    assert!(long < short + 4096, "{short} KiB grew to {long} KiB");
}

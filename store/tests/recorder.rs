//! The recorder: what is acknowledged is on disk, the sampling side never waits on a machine, and what is lost is counted.

use ledger::Hash;
use machine::Sample;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use store::record::{Header, Reader, SampleRows, Writer};
use store::segment::trouble::TroubledDisk;
use store::segment::{self, Cause, Condition, Merged, Notice, Offered, Pace, Recorder, Settings, Watch};
use store::{DataDirectory, Ending, NewJob, StoreError};
use units::{Tick, Timestamp};

fn header() -> Header {
    Header {
        machine: "sim-mill".into(),
        simulated: true,
        start: Timestamp(1_795_132_800_000_000_000),
        seed: 7,
    }
}

fn sample(tick: u64) -> Sample {
    Sample {
        tick: Tick(tick),
        actual: [tick as f64 * 0.013, (tick % 17) as f64, -0.001],
        load: [(tick % 7919 * 7919 % 101) as f64 * 0.1; 3],
        ..Sample::default()
    }
}

fn begin(folder: &Path, settings: &Settings) -> Recorder<SampleRows> {
    Recorder::begin(folder, SampleRows::new(header().start, folder), header().metadata(), settings).expect("begun")
}

fn merge(folder: &Path) -> (Merged, PathBuf) {
    let target = folder.with_extension("parquet");
    let merged = segment::merge(folder, &target, &[], &[]).expect("merged");
    assert_eq!(merged.lost, []);
    (merged, target)
}

/// The ticks of a record, each with the readings that belong to it.
fn ticks_of(path: &Path) -> Vec<u64> {
    let reader = Reader::open(path).expect("ours");
    let rows = reader.rows().expect("reads").map(|row| row.expect("whole"));
    rows.map(|row| {
        let expected = sample(row.tick.0).actual.map(|x| (x * 1000.0).round() / 1000.0);
        assert_eq!(row.actual, Some(expected), "tick {}", row.tick.0);
        row.tick.0
    })
    .collect()
}

/// Waits until something is so; a minute is for ever.
#[track_caller]
fn until(watch: &Watch, what: &str, so: impl Fn(&Watch) -> bool) {
    for _ in 0..60_000 {
        if so(watch) {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("{what} never came: {}", watch.health());
}

/// Rows and gaps together are every tick exactly once.
#[track_caller]
fn check_accounted(ticks: &[u64], merged: &Merged, offered: u64) {
    assert!(ticks.windows(2).all(|t| t[0] < t[1]), "in order, none twice");
    let mut all: Vec<u64> = ticks.to_vec();
    for gap in &merged.gaps {
        assert_eq!(gap.count, gap.to - gap.from + 1, "{gap}");
        all.extend(gap.from..=gap.to);
    }
    all.sort_unstable();
    assert!(
        all.into_iter().eq(0..offered),
        "every row is there or in a gap, once: {:?}",
        merged.gaps
    );
}

#[test]
fn the_same_rows_give_the_same_bytes_however_they_were_framed() {
    let folder = tempfile::tempdir().expect("a folder");
    let direct = folder.path().join("direct.parquet");
    let mut writer = Writer::create(&direct, &header()).expect("made");
    (0..50_000).for_each(|tick| writer.write(&sample(tick)).expect("written"));
    writer.finish(&[]).expect("finished");
    let expected = std::fs::read(&direct).expect("reads");

    for (n, (ring, interval_ms, segment_rows, compress)) in
        [(8192, 100, 1_000_000, true), (100, 1, 7_000, false), (3000, 5, 20_000, true)]
            .into_iter()
            .enumerate()
    {
        let settings = Settings {
            ring,
            interval: Duration::from_millis(interval_ms),
            segment_rows,
            compress,
            ..Settings::new(Pace::Simulated)
        };
        let place = folder.path().join(format!("{n}"));
        let mut recorder = begin(&place, &settings);
        for tick in 0..50_000 {
            assert_eq!(recorder.offer(&sample(tick)), Offered::Taken);
        }
        let ended = recorder.end().expect("ended");
        assert_eq!((ended.health.acknowledged, ended.health.gaps), (50_000, 0));
        let (merged, target) = merge(&place);
        assert_eq!(merged.finished.rows, 50_000);
        assert!(std::fs::read(target).expect("reads") == expected, "case {n}");
        segment::discard(&place).expect("discarded");
        assert!(!place.exists());
    }
}

#[test]
fn a_slow_disk_costs_counted_rows_and_never_the_sampling_side() {
    let folder = tempfile::tempdir().expect("a folder");
    let disk = TroubledDisk::default();
    let settings = Settings {
        ring: 500,
        interval: Duration::from_millis(5),
        disk: Arc::new(disk.clone()),
        ..Settings::new(Pace::Real)
    };
    let place = folder.path().join("slow");
    let mut recorder = begin(&place, &settings);
    disk.slow(&[5, 5, 400, 5, 40, 300, 5].map(Duration::from_millis));
    let mut missed = 0;
    for tick in 0..20_000 {
        if recorder.offer(&sample(tick)) == Offered::Missed {
            missed += 1;
        }
        if tick % 20 == 0 {
            std::thread::sleep(Duration::from_millis(1)); // a fast machine; time for the disk to get somewhere
        }
    }
    assert_eq!(recorder.waits(), 0);
    let watch = recorder.watch();
    let ended = recorder.end().expect("ended");
    let (merged, target) = merge(&place);
    let ticks = ticks_of(&target);
    println!(
        "{} rows offered, {missed} missed in {} gaps, the sampling side waited {} times",
        20_000, ended.health.gaps, ended.waits
    );
    println!("{}", watch.latencies());
    assert_eq!(ended.waits, 0);
    assert!(missed > 0, "a disk that slow fills a ring of 500");
    assert_eq!(ended.health.missed, missed);
    assert_eq!(ended.health.acknowledged + missed, 20_000);
    assert_eq!(watch.latencies().count(), ended.health.acknowledged);
    assert!(merged.gaps.iter().all(|gap| gap.cause == Cause::RingFull));
    check_accounted(&ticks, &merged, 20_000);
}

#[test]
fn a_full_disk_is_seen_and_recording_goes_on_with_a_gap_when_there_is_room_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let disk = TroubledDisk::default();
    let settings = Settings {
        ring: 256,
        interval: Duration::from_millis(2),
        compress: false,
        disk: Arc::new(disk.clone()),
        ..Settings::new(Pace::Real)
    };
    let place = folder.path().join("full");
    let mut recorder = begin(&place, &settings);
    let watch = recorder.watch();
    let mut tick = 0;
    let mut offer = |recorder: &mut Recorder<SampleRows>, count: u64| {
        for _ in 0..count {
            let _ = recorder.offer(&sample(tick));
            tick += 1;
        }
        tick
    };
    offer(&mut recorder, 100);
    until(&watch, "the first hundred rows", |w| w.acknowledged() == 100);

    disk.room(Some(1000));
    offer(&mut recorder, 100);
    until(&watch, "the full disk", |w| w.health().condition == Condition::DiskFull);
    assert_eq!(watch.acknowledged(), 100, "what is not on disk is not acknowledged");
    // The machine runs on, and the stop of it as well: nothing waits.
    offer(&mut recorder, 2000);
    assert_eq!(recorder.waits(), 0);
    let text = watch.health().to_string();
    assert!(
        text.starts_with("NOT RECORDING since row 100: the disk is full (1000 bytes free)"),
        "{text}"
    );

    disk.room(None);
    until(&watch, "the room", |w| w.health().condition == Condition::Good);
    until(&watch, "an empty ring", |w| w.acknowledged() >= 300);
    let offered = offer(&mut recorder, 50);
    let ended = recorder.end().expect("ended");
    let notices = watch.take_notices();
    assert!(
        matches!(&notices[..], [Notice::Stopped(_), Notice::Resumed(_), Notice::Gap(gap)] if gap.cause == Cause::DiskFull),
        "{notices:?}"
    );
    let (merged, target) = merge(&place);
    let ticks = ticks_of(&target);
    assert_eq!(ticks.len() as u64, ended.health.acknowledged);
    assert_eq!(ticks.last(), Some(&(offered - 1)), "recording went on");
    check_accounted(&ticks, &merged, offered);
    let metadata = Reader::open(&target).expect("ours").metadata().clone();
    assert!(
        metadata["toolmark.gaps"].contains("\"cause\":\"disk-full\""),
        "{}",
        metadata["toolmark.gaps"]
    );
}

#[test]
fn a_sync_that_failed_is_not_believed_the_second_time_and_no_row_is_there_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let disk = TroubledDisk::default();
    let settings = Settings {
        interval: Duration::from_millis(1),
        disk: Arc::new(disk.clone()),
        ..Settings::new(Pace::Real)
    };
    let place = folder.path().join("failing");
    let mut recorder = begin(&place, &settings);
    let watch = recorder.watch();
    for tick in 0..3000 {
        assert_eq!(recorder.offer(&sample(tick)), Offered::Taken);
        if tick % 1000 == 500 {
            until(&watch, "all rows", |w| w.acknowledged() == tick + 1);
            disk.fail_syncs(3);
        }
    }
    recorder.end().expect("ended");
    let segments = std::fs::read_dir(&place).expect("reads").count();
    assert!(segments > 3, "a segment is given up after a failed sync: {segments}");
    let (merged, target) = merge(&place);
    assert_eq!(ticks_of(&target), (0..3000).collect::<Vec<_>>());
    assert_eq!(merged.gaps, []);
}

#[test]
fn a_recording_that_cannot_end_says_so_and_keeps_what_was_acknowledged() {
    let folder = tempfile::tempdir().expect("a folder");
    let disk = TroubledDisk::default();
    let settings = Settings {
        interval: Duration::from_millis(1),
        patience: Duration::from_millis(20),
        disk: Arc::new(disk.clone()),
        ..Settings::new(Pace::Simulated)
    };
    let place = folder.path().join("refusing");
    let mut recorder = begin(&place, &settings);
    let watch = recorder.watch();
    for tick in 0..1000 {
        assert_eq!(recorder.offer(&sample(tick)), Offered::Taken);
    }
    until(&watch, "all rows", |w| w.acknowledged() == 1000);
    disk.fail_writes(true);
    // More than the ring holds: in simulated time a refusing disk is not waited for either.
    for tick in 1000..20_000 {
        let _ = recorder.offer(&sample(tick));
    }
    let refused = recorder.end().expect_err("the disk refuses");
    assert!(matches!(refused, StoreError::Io { doing: "write", .. }), "{refused}");
    assert_eq!(watch.health().condition, Condition::DiskFailing);
    let (_, target) = merge(&place);
    assert_eq!(ticks_of(&target), (0..1000).collect::<Vec<_>>());
}

#[test]
fn a_row_that_cannot_be_kept_is_a_gap_and_the_rest_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let place = folder.path().join("odd");
    let mut recorder = begin(&place, &Settings::new(Pace::Simulated));
    for tick in [0, 1, u64::MAX, 2, 3] {
        assert_eq!(recorder.offer(&sample(tick)), Offered::Taken);
    }
    assert_eq!(recorder.end().expect("ended").health.acknowledged, 4);
    let (merged, target) = merge(&place);
    assert_eq!(ticks_of(&target), [0, 1, 2, 3]);
    assert_eq!(merged.gaps.len(), 1);
    assert_eq!((merged.gaps[0].from, merged.gaps[0].cause), (u64::MAX, Cause::Unreadable));
}

#[test]
fn a_record_that_was_whole_before_its_catalogue_row_is_catalogued_where_it_stands() {
    let folder = tempfile::tempdir().expect("a folder");
    let begin_and_merge = || {
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let new = NewJob {
            program: "part.nc",
            program_hash: Hash::of(b"G0 X0"),
            machine: &header().machine,
            seed: header().seed,
            start: header().start,
            folder: Some(&folder.path().join("jobs/out")),
            who: "Maria",
        };
        let job = directory.begin_job(&new).expect("begins");
        let recording = directory.recording_folder(job.id);
        let mut recorder = begin(&recording, &Settings::new(Pace::Simulated));
        // Rows of the first and the second job differ, as those of two killed runs do.
        for tick in 0..1000 * job.id.0 as u64 {
            assert_eq!(recorder.offer(&sample(tick)), Offered::Taken);
        }
        recorder.end().expect("ended");
        let target = job.folder.join("record.parquet");
        segment::merge(&recording, &target, &[], &[]).expect("merged");
        (job.id, target)
    };
    for rows in [1000, 2000] {
        // Here the process dies: the file is whole, the catalogue does not know it.
        let (job, target) = begin_and_merge();
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let recovery = directory.recover(job).expect("recovers").expect("a recording");
        assert_eq!((recovery.record, recovery.rows), (Some(target.clone()), rows));
        assert_eq!(directory.recover(job).expect("done"), None);
        directory.end_job(job, header().start, Ending::Interrupted).expect("ends");
        assert_eq!(directory.verify().expect("verifies"), []);
        assert_eq!(ticks_of(&target).len() as u64, rows);
    }
}

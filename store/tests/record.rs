//! Records on a real disk: what was written comes back, what was damaged is found out.

use arrow_array::Array;
use ledger::{Chain, Event};
use machine::{CHANNELS, Phase, Quality, Sample};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::record::{Finished, Header, Reader, Writer};
use store::{DataDirectory, Ending, JobId, NewJob, StoreError};
use units::{StepId, Tick, Timestamp, ToolNumber, WorkingstepId};

const START: Timestamp = Timestamp(1_795_132_800_000_000_000);

fn header() -> Header {
    Header {
        machine: "sim-mill".into(),
        simulated: true,
        start: START,
        seed: 7,
    }
}

fn events() -> Vec<Event> {
    let mut chain = Chain::default();
    let step = |n: u32| BTreeMap::from([("step".to_owned(), n.into()), ("dwell_s".to_owned(), 0.1.into())]);
    (1..4)
        .map(|n| chain.append(Timestamp(START.0 + i64::from(n)), "step", step(n)))
        .collect()
}

/// What a machine reports: a path of arcs and straights at 1000 pulses/mm with following error, loads and currents with at least four
/// quanta rms of noise, a spindle that wavers.
fn machine_like(rows: u64) -> impl Iterator<Item = Sample> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut noise = move |rms: f64| {
        // Sum of twelve uniforms: mean 6, variance 1.
        let sum: f64 = (0..12).map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX)).sum();
        (sum - 6.0) * rms
    };
    (0..rows).map(move |k| {
        let t = k as f64 * 0.001;
        let speed = 20.0;
        let place = |t: f64| {
            [
                40.0 * (speed / 40.0 * t).sin() - 300.0,
                40.0 * (speed / 40.0 * t).cos() - 200.0,
                -5.0 - (t / 30.0).floor(),
            ]
        };
        let (commanded, before) = (place(t), place(t - 0.004));
        let velocity: [f64; 3] = std::array::from_fn(|a| (commanded[a] - before[a]) / 0.004);
        Sample {
            tick: Tick(k),
            step: StepId((t / 0.5) as u32 + 1),
            workingstep: WorkingstepId((t / 30.0) as u32 + 1),
            tool: ToolNumber(4),
            phase: Phase::Running,
            quality: Quality::Simulated,
            commanded,
            actual: std::array::from_fn(|a| before[a] + noise(0.0005)),
            velocity: std::array::from_fn(|a| velocity[a] + noise(0.1)),
            load: std::array::from_fn(|a| 20.0 + velocity[a] + noise(0.4)),
            current: std::array::from_fn(|a| 2.0 + 0.1 * velocity[a] + noise(0.04)),
            path_speed: speed,
            spindle_speed: 8000.0 + noise(0.4),
            spindle_load: 35.0 + noise(0.4),
            spindle_angle: f64::NAN,
            // Every other workingstep is a thread.
            thread_error: if ((t / 30.0) as u32).is_multiple_of(2) {
                f64::NAN
            } else {
                noise(0.0004)
            },
            ..Sample::default()
        }
    })
}

fn write(path: &Path, samples: impl Iterator<Item = Sample>) -> Finished {
    let mut writer = Writer::create(path, &header()).expect("made");
    samples.for_each(|s| writer.write(&s).expect("written"));
    assert!(!path.exists(), "half a record must not stand under the name");
    writer.finish(&events()).expect("finished")
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("day/record.parquet");
    (folder, path)
}

#[test]
fn a_hundred_thousand_rows_come_back_bit_equal() {
    let (_folder, path) = folder();
    let finished = write(&path, machine_like(100_000));
    let values = finished.rows * CHANNELS.len() as u64;
    let columns = finished.rows * (CHANNELS.len() as u64 + 7);
    println!(
        "{} rows, {} channels: {} bytes, {:.3} bytes per reading, {:.3} per value with the columns of time and place",
        finished.rows,
        CHANNELS.len(),
        finished.bytes,
        finished.bytes as f64 / values as f64,
        finished.bytes as f64 / columns as f64
    );
    assert!(finished.bytes <= values, "more than a byte per reading");
    // Two of the four workingsteps are no thread, and have no thread error.
    assert_eq!(finished.unavailable, 60_000);

    let reader = Reader::open(&path).expect("ours");
    assert_eq!((reader.header(), reader.len()), (&header(), 100_000));
    assert_eq!(reader.events().expect("whole"), events());
    assert_eq!(reader.finished().expect("reads"), finished);

    let mut samples = machine_like(100_000);
    for batch in reader.batches().expect("reads") {
        let batch = batch.expect("a batch");
        let rows = batch.rows();
        for (k, row) in rows.iter().enumerate() {
            let sample = samples.next().expect("as many rows as samples");
            assert_eq!(row.at, Timestamp(START.0 + sample.tick.0 as i64 * 1_000_000));
            assert_eq!(
                (row.tick, row.step, row.workingstep),
                (sample.tick, sample.step, sample.workingstep)
            );
            assert_eq!(
                (row.tool, row.phase, row.quality),
                (sample.tool, sample.phase, sample.quality)
            );
            for channel in CHANNELS {
                let raw = batch.raw(channel.name).expect("every channel is a column");
                let kept = raw.is_valid(k).then(|| raw.value(k));
                let is_known = !(channel.read)(&sample).is_nan();
                assert_eq!(kept, is_known.then(|| channel.quantise(&sample)), "{}", channel.name);
            }
            let nearest = |x: f64, quanta: f64| (x * quanta).round() / quanta;
            assert!((0..3).all(|a| (row.actual.expect("there")[a] - nearest(sample.actual[a], 1e3)).abs() < 1e-9));
            assert!((0..3).all(|a| (row.commanded.expect("there")[a] - nearest(sample.commanded[a], 1e4)).abs() < 1e-9));
        }
    }
    assert_eq!(samples.next(), None);
    assert_eq!(reader.rows().expect("reads").count(), 100_000);
}

#[test]
fn the_same_rows_give_the_same_bytes() {
    let (_one, first) = folder();
    let (_two, second) = folder();
    let a = write(&first, machine_like(20_000));
    let b = write(&second, machine_like(20_000));
    assert_eq!(a.hash, b.hash);
    assert_eq!(std::fs::read(first).expect("reads"), std::fs::read(second).expect("reads"));
}

#[test]
fn a_position_is_the_decimal_number_it_was_measured_as() {
    let (_folder, path) = folder();
    let sample = Sample {
        actual: [123.457, -0.001, 0.3],
        ..Sample::default()
    };
    write(&path, [sample].into_iter());
    let row = Reader::open(&path)
        .expect("ours")
        .rows()
        .expect("reads")
        .next()
        .expect("one")
        .expect("good");
    assert_eq!(row.actual, Some([123.457, -0.001, 0.3]));
}

#[test]
fn a_reading_that_is_no_number_or_too_large_is_unavailable_and_not_zero() {
    let (_folder, path) = folder();
    let sample = Sample {
        actual: [1.0, f64::NAN, 2.0],
        commanded: [0.0, 0.0, 1e9],
        ..Sample::default()
    };
    let finished = write(&path, [sample].into_iter());
    assert_eq!(finished.unavailable, 2);
    let reader = Reader::open(&path).expect("ours");
    let row = reader.rows().expect("reads").next().expect("one").expect("good");
    assert_eq!((row.actual, row.commanded), (None, None));
    let batch = reader.batches().expect("reads").next().expect("one").expect("good");
    let z: Vec<Option<f64>> = batch.values("Z.POSITION.ACTUAL").expect("a column").collect();
    assert_eq!(z, [Some(2.0)]);
    assert_eq!(reader.metadata()["toolmark.unavailable_values"], "2");
}

#[test]
fn ticks_must_rise_and_numbers_must_fit() {
    let (_folder, path) = folder();
    let mut writer = Writer::create(&path, &header()).expect("made");
    let at = |tick| Sample {
        tick: Tick(tick),
        ..Sample::default()
    };
    writer.write(&at(5)).expect("the first");
    for tick in [5, 4] {
        assert!(
            matches!(writer.write(&at(tick)), Err(StoreError::OutOfOrder { .. })),
            "{tick}"
        );
    }
    assert!(matches!(
        writer.write(&at(u64::MAX)),
        Err(StoreError::TooLarge { column: "tick", .. })
    ));
    let far = Sample {
        step: StepId(u32::MAX),
        ..at(6)
    };
    assert!(matches!(writer.write(&far), Err(StoreError::TooLarge { column: "step", .. })));
    writer.write(&at(7)).expect("refused rows leave no trace");
    let finished = writer.finish(&[]).expect("finished");
    assert_eq!(finished.rows, 2);
    assert_eq!(finished.span_us, Some((START.0 / 1000 + 5000, START.0 / 1000 + 7000)));
}

#[test]
fn an_empty_record_is_a_record() {
    let (_folder, path) = folder();
    let finished = write(&path, std::iter::empty());
    assert_eq!((finished.rows, finished.span_us), (0, None));
    let reader = Reader::open(&path).expect("ours");
    assert!(reader.is_empty());
    assert_eq!(reader.rows().expect("reads").count(), 0);
    assert_eq!(reader.events().expect("whole").len(), 3);
}

/// Opens a file and reads all of it.
fn read_whole(path: &Path) -> Result<u64, StoreError> {
    let reader = Reader::open(path)?;
    reader.events()?;
    let mut rows = 0;
    for row in reader.rows()? {
        row?;
        rows += 1;
    }
    Ok(rows)
}

#[test]
fn a_record_cut_anywhere_is_refused() {
    let (_folder, path) = folder();
    let finished = write(&path, machine_like(3000));
    let whole = std::fs::read(&path).expect("reads");
    for part in [
        0,
        1,
        4,
        8,
        100,
        whole.len() / 2,
        whole.len() - 9,
        whole.len() - 8,
        whole.len() - 1,
    ] {
        std::fs::write(&path, &whole[..part]).expect("cut");
        let refused = read_whole(&path).expect_err("cut");
        assert_eq!(refused.exit_code(), 3, "{refused}");
        assert!(refused.to_string().contains("record.parquet"), "{refused}");
    }
    let mut zero_tailed = whole.clone();
    zero_tailed.resize(whole.len() + 100, 0);
    std::fs::write(&path, zero_tailed).expect("written");
    assert!(matches!(read_whole(&path), Err(StoreError::Damaged { .. })));
    std::fs::write(&path, &whole).expect("restored");
    assert_eq!(read_whole(&path).expect("whole"), finished.rows);
}

#[test]
fn a_flipped_bit_in_the_rows_is_always_refused_and_one_elsewhere_never_a_panic() {
    let (_folder, path) = folder();
    let finished = write(&path, machine_like(3000));
    let whole = std::fs::read(&path).expect("reads");
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    println!("SEED={seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Only the page index between data and footer, which is not read here, is left to the catalogue's hash.
    let reader = Reader::open(&path).expect("whole");
    let data: usize = reader.metadata()["toolmark.data"]
        .split(' ')
        .next()
        .and_then(|n| n.parse().ok())
        .expect("a length");
    assert!(data > whole.len() / 2);
    let mut refused = 0;
    for _ in 0..400 {
        let mut changed = whole.clone();
        let place = random.next_u64() as usize % changed.len();
        changed[place] ^= 1 << (random.next_u32() % 8);
        std::fs::write(&path, &changed).expect("written");
        let found = read_whole(&path);
        assert!(place >= data || found.is_err(), "byte {place} was read as good");
        refused += u32::from(found.is_err());
        assert_ne!(ledger::Hash::of(&changed), finished.hash);
    }
    println!("{refused} of 400 flipped bits were refused by the reader itself; the catalogue's hash finds all");
}

#[test]
fn other_files_are_told_apart_by_what_they_lack() {
    let (folder, path) = folder();
    let check = |path: &Path, expected: &str| {
        let refused = Reader::open(path).expect_err(expected).to_string();
        assert!(refused.contains(expected), "{refused}");
    };
    check(&path, "cannot open");
    let text = folder.path().join("a.txt");
    std::fs::write(&text, "x y z").expect("written");
    check(&text, "is not a toolmark record: it does not begin as a Parquet file");
    let plan = folder.path().join("plan.parquet");
    let mut writer = store::trajectory::Writer::create(&plan).expect("made");
    writer.write(&store::trajectory::Point::default()).expect("written");
    writer.finish().expect("finished");
    check(&plan, "is not a toolmark record: its metadata has no toolmark.record");
}

fn job() -> NewJob<'static> {
    NewJob {
        program: "plate.stpnc",
        program_hash: ledger::Hash::of(b"plate"),
        machine: "sim-mill",
        seed: 7,
        start: START,
        folder: None,
        who: "Maria",
    }
}

fn run_a_job(directory: &mut DataDirectory) -> (JobId, PathBuf) {
    let job = directory.begin_job(&job()).expect("begins").id;
    directory.append_job_events(job, &events()).expect("kept");
    let path = directory.record_path("sim-mill", START, job);
    let finished = write(&path, machine_like(1000));
    directory.catalogue(job, &finished, START).expect("catalogued");
    directory.end_job(job, START, Ending::Done).expect("ends");
    (job, path)
}

#[test]
fn the_catalogue_chains_files_and_verify_names_what_was_changed() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let (_, first) = run_a_job(&mut directory);
    let (_, second) = run_a_job(&mut directory);
    let rows = directory.records().expect("reads");
    assert_eq!(rows.iter().map(|r| r.path.as_path()).collect::<Vec<_>>(), [&first, &second]);
    assert_eq!((rows[0].previous, rows[1].previous), (ledger::Hash::default(), rows[0].hash));
    assert_eq!(rows[1].span_us, Some((START.0 / 1000, START.0 / 1000 + 999_000)));
    assert_eq!(directory.verify().expect("verifies"), []);

    let findings = |directory: &DataDirectory| -> Vec<String> {
        directory
            .verify()
            .expect("verifies")
            .iter()
            .map(|f| f.to_string().replace(&*folder.path().to_string_lossy(), "DIR"))
            .collect()
    };
    let whole = std::fs::read(&first).expect("reads");
    let mut changed = whole.clone();
    changed[500] ^= 1;
    std::fs::write(&first, changed).expect("written");
    assert_eq!(
        findings(&directory),
        ["record DIR/records/sim-mill/2026-11-20/job-000001.parquet: its content is not what was recorded"]
    );
    std::fs::write(&first, whole).expect("restored");
    std::fs::copy(&first, folder.path().join("records/strange.parquet")).expect("copied");
    assert!(findings(&directory)[0].starts_with("file DIR/records/strange.parquet: the log tells nothing of it"));
}

#[test]
fn verify_names_rows_that_were_changed_with_the_triggers_out_of_the_way() {
    let forge = |sql: &str| -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        run_a_job(&mut directory);
        drop(directory);
        let forger = rusqlite::Connection::open(folder.path().join("toolmark.sqlite")).expect("opens");
        let triggers: Vec<String> = forger
            .prepare("SELECT name FROM sqlite_schema WHERE type = 'trigger'")
            .and_then(|mut s| s.query_map([], |row| row.get(0))?.collect())
            .expect("lists");
        triggers
            .iter()
            .for_each(|t| forger.execute_batch(&format!("DROP TRIGGER {t}")).expect("dropped"));
        forger.execute_batch(sql).expect(sql);
        drop(forger);
        let directory = DataDirectory::open(folder.path(), "test").expect("free");
        let all: Vec<String> = directory
            .verify()
            .expect("verifies")
            .iter()
            .map(ToString::to_string)
            .collect();
        let (gone, changed): (Vec<String>, Vec<String>) = all.into_iter().partition(|f| f.starts_with("trigger "));
        assert_eq!(gone.len(), triggers.len(), "every trigger that was taken away is named");
        changed
    };
    assert_eq!(
        forge("UPDATE records SET rows = 999"),
        ["catalogue row 1 (table records): is not the row that was put in"]
    );
    assert_eq!(
        forge("UPDATE events SET kind = 'x' WHERE log = 0 AND sequence = 1")[0],
        "the log of the data directory (table events, log 0): event 1 was changed after it was written"
    );
    assert_eq!(
        forge("DELETE FROM events WHERE log = 1 AND sequence = 3"),
        ["the log of job 1 (table events, log 1): has 2 events with another end than the 3 it had when the job ended"]
    );
    assert_eq!(
        forge("UPDATE events SET detail = '{}' WHERE log = 1 AND sequence = 2")[0],
        "the log of job 1 (table events, log 1): event 2 was changed after it was written"
    );
}

//! What is read through roll-ups is what the rows come to: curves, ranges and statistics are held against all rows, one by one.

use machine::Sample;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::record::{Header, Reader, SampleRows, Writer};
use store::rollup::{Pixel, Rollup};
use store::segment::{Offered, Pace, Recorder, Settings};
use store::{CatalogueRow, DataDirectory, Ending, JobId, NewJob, Of, Piece, Retention, Span, StoreError};
use units::{Tick, Timestamp, WorkingstepId};

const START: Timestamp = Timestamp(1_795_132_800_000_000_000);
const MACHINE: &str = "sim-mill";
/// The channels that are looked at: one with missing readings and one without.
const LOAD: &str = "X.LOAD";
const PLACE: &str = "Y.POSITION.ACTUAL";
const DAY_NS: i64 = 86_400_000_000_000;

fn header(start: Timestamp) -> Header {
    Header {
        machine: MACHINE.into(),
        simulated: true,
        start,
        seed: 7,
    }
}

/// Rows as a machine reports them: one a millisecond, now and then some are lost, now and then a sensor fails.
fn samples(random: &mut ChaCha8Rng, rows: usize) -> Vec<Sample> {
    let (mut tick, mut workingstep, mut load, mut blind) = (random.next_u64() % 10, 1, 0.0, 0);
    (0..rows)
        .map(|_| {
            tick += 1;
            if random.next_u32().is_multiple_of(300) {
                tick += random.next_u64() % 3000;
            }
            if random.next_u32().is_multiple_of(900) {
                workingstep = random.next_u32() % 4;
            }
            if random.next_u32().is_multiple_of(500) {
                blind = random.next_u32() % 600;
            }
            blind = blind.saturating_sub(1);
            load += f64::from(random.next_u32() % 201) * 0.1 - 10.0;
            Sample {
                tick: Tick(tick),
                workingstep: WorkingstepId(workingstep),
                load: [if blind > 0 { f64::NAN } else { load }; 3],
                actual: [0.0, load * 0.01, 0.0],
                ..Sample::default()
            }
        })
        .collect()
}

fn begin(directory: &mut DataDirectory, start: Timestamp) -> JobId {
    let job = NewJob {
        program: "plate.stpnc",
        program_hash: ledger::Hash::of(b"plate"),
        machine: MACHINE,
        seed: 7,
        start,
        folder: None,
        who: "Maria",
    };
    directory.begin_job(&job).expect("begins").id
}

/// A job with a record of these rows; gives the time of its end.
fn run(directory: &mut DataDirectory, start: Timestamp, samples: &[Sample]) -> (JobId, CatalogueRow) {
    let job = begin(directory, start);
    let path = directory.record_path(MACHINE, start, job);
    let mut writer = Writer::create(&path, &header(start)).expect("made");
    samples.iter().for_each(|s| writer.write(s).expect("written"));
    let finished = writer.finish(&[]).expect("finished");
    let row = directory.catalogue(job, &finished, start).expect("catalogued");
    directory.end_job(job, start, Ending::Done).expect("ends");
    (job, row)
}

/// A row as it is in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    at_us: i64,
    workingstep: u32,
    load: Option<f64>,
    place: Option<f64>,
    /// True when time is missing before it.
    gap: bool,
}

/// All rows of a file, read one by one.
fn rows_of(path: &Path, gap_us: i64, before: Option<i64>) -> Vec<Seen> {
    let reader = Reader::open(path).expect("ours");
    let (mut seen, mut last) = (Vec::new(), before);
    for batch in reader.batches().expect("reads") {
        let batch = batch.expect("whole");
        let [load, place] = [LOAD, PLACE].map(|name| batch.values(name).expect("a channel").collect::<Vec<_>>());
        for (k, row) in batch.rows().iter().enumerate() {
            let at_us = row.at.micros();
            seen.push(Seen {
                at_us,
                workingstep: row.workingstep.0,
                load: load[k],
                place: place[k],
                gap: last.is_some_and(|last| at_us - last > gap_us),
            });
            last = Some(at_us);
        }
    }
    seen
}

/// Some jobs of a machine, one after the other, and all of their rows.
fn machine_with_history(folder: &Path, seed: u64, sizes: &[usize]) -> (DataDirectory, Vec<JobId>, Vec<Seen>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut directory = DataDirectory::open(folder, "test").expect("free");
    let (mut start, mut jobs, mut all) = (START, Vec::new(), Vec::<Seen>::new());
    for &size in sizes {
        let samples = samples(&mut random, size);
        let (job, row) = run(&mut directory, start, &samples);
        jobs.push(job);
        if let Some((_, last)) = row.span_us {
            let gap_us = Rollup::open(&directory.rollup_path(&row))
                .expect("made with the record")
                .gap_us();
            all.extend(rows_of(&row.path, gap_us, all.last().map(|s| s.at_us)));
            start = Timestamp((last + 1 + (random.next_u64() % 5_000_000) as i64) * 1000);
        }
    }
    (directory, jobs, all)
}

fn micros(us: i64) -> Timestamp {
    Timestamp(us * 1000)
}

/// Holds a curve against all rows.
#[track_caller]
fn check_curve(pixels: &[Pixel], span: Span, rows: &[Seen], value: impl Fn(&Seen) -> Option<f64>) {
    assert_eq!(pixels.first().map(|p| p.from), Some(span.from));
    assert_eq!(pixels.last().map(|p| p.to), Some(span.to));
    assert!(pixels.windows(2).all(|two| two[0].to == two[1].from), "contiguous");
    for pixel in pixels {
        let inside: Vec<&Seen> = (rows.iter())
            .filter(|s| micros(s.at_us) >= pixel.from && micros(s.at_us) < pixel.to)
            .collect();
        let readings: Vec<f64> = inside.iter().filter_map(|s| value(s)).collect();
        let first_inside = rows.iter().find(|s| micros(s.at_us) >= span.from).map(|s| s.at_us);
        let expected = Pixel {
            from: pixel.from,
            to: pixel.to,
            rows: inside.len() as u64,
            missing: (inside.len() - readings.len()) as u64,
            min: readings.iter().copied().reduce(f64::min),
            max: readings.iter().copied().reduce(f64::max),
            first: readings.first().copied(),
            last: readings.last().copied(),
            gaps: inside.iter().skip(1).filter(|s| s.gap).count() as u64,
            // What was before the span is not looked at.
            after_gap: inside.first().is_some_and(|s| s.gap && Some(s.at_us) != first_inside),
            coarse: false,
        };
        assert_eq!(*pixel, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn any_curve_is_what_all_rows_come_to(
        seed in any::<u64>(),
        sizes in proptest::collection::vec(prop_oneof![0usize..40, 0usize..20_000], 1..5),
        spans in proptest::collection::vec((-0.1..1.1_f64, -0.1..1.1_f64, 1usize..2000), 8),
    ) {
        let folder = tempfile::tempdir().expect("a folder");
        let (directory, jobs, rows) = machine_with_history(folder.path(), seed, &sizes);
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Ok(()) };
        let extent = directory.extent(Of::Machine(MACHINE)).expect("reads");
        prop_assert_eq!(extent, Some(Span { from: micros(first.at_us), to: micros(last.at_us + 1) }));
        for (a, b, pixels) in spans {
            let at = |part: f64| first.at_us + (part * (last.at_us - first.at_us + 1) as f64) as i64;
            let (from, to) = (at(a.min(b)), at(a.max(b)) + 1);
            let span = Span { from: micros(from), to: micros(to) };
            let curve = directory.envelope(Of::Machine(MACHINE), LOAD, span, pixels).expect("drawn");
            check_curve(&curve.pixels, span, &rows, |s| s.load);
            prop_assert!(curve.pixels.len() <= pixels);
            // An edge moves by less than half a pixel.
            if curve.pixels.len() == pixels {
                for (k, pixel) in curve.pixels.iter().enumerate() {
                    let edge = from as f64 + k as f64 * (to - from) as f64 / pixels as f64;
                    let moved = pixel.from.micros() as f64 - edge;
                    prop_assert!((0.0..=0.5 * (to - from) as f64 / pixels as f64 + 2.0).contains(&moved), "{moved}");
                }
            }

            let mut seen = Vec::new();
            for piece in directory.range(Of::Machine(MACHINE), span, &[PLACE, "workingstep", LOAD]).expect("begun") {
                let Piece::Rows(part) = piece.expect("whole") else { panic!("nothing was removed") };
                let workingsteps: &arrow_array::Int32Array = part.arrow.column(2).as_any().downcast_ref().expect("numbers");
                let values = part.values(0).expect("a channel").zip(part.values(2).expect("a channel"));
                for (k, (place, load)) in values.enumerate() {
                    seen.push((part.times_us()[k], workingsteps.value(k) as u32, place, load));
                }
            }
            let expected: Vec<_> = rows.iter()
                .filter(|s| s.at_us >= from && s.at_us < to)
                .map(|s| (s.at_us, s.workingstep, s.place, s.load))
                .collect();
            prop_assert_eq!(seen, expected);
        }
        for job in jobs {
            check_statistics(&directory, job);
        }
    }
}

/// Holds the statistics of a job against all of its rows.
#[track_caller]
fn check_statistics(directory: &DataDirectory, job: JobId) {
    let mut by_workingstep: BTreeMap<u32, Vec<Seen>> = BTreeMap::new();
    for record in directory.records().expect("reads").iter().filter(|r| r.job == job) {
        for row in rows_of(&record.path, i64::MAX, None) {
            by_workingstep.entry(row.workingstep).or_default().push(row);
        }
    }
    if by_workingstep.is_empty() {
        return;
    }
    let told = directory.workingstep_statistics(job, &[LOAD, PLACE]).expect("told");
    assert_eq!(
        told.iter().map(|s| s.workingstep.0).collect::<Vec<_>>(),
        by_workingstep.keys().copied().collect::<Vec<_>>()
    );
    for (told, rows) in told.iter().zip(by_workingstep.values()) {
        assert_eq!(told.rows, rows.len() as u64);
        assert_eq!(
            (told.first, told.last),
            (micros(rows[0].at_us), micros(rows[rows.len() - 1].at_us))
        );
        for (channel, value) in told.channels.iter().zip([|s: &Seen| s.load, |s: &Seen| s.place]) {
            let readings: Vec<f64> = rows.iter().filter_map(value).collect();
            assert_eq!(channel.count, readings.len() as u64);
            assert_eq!(channel.missing, (rows.len() - readings.len()) as u64);
            assert_eq!(channel.min, readings.iter().copied().reduce(f64::min));
            assert_eq!(channel.max, readings.iter().copied().reduce(f64::max));
            let mean = readings.iter().sum::<f64>() / readings.len() as f64;
            let off = channel.mean.map_or(0.0, |m| (m - mean).abs());
            assert!(off <= 1e-9 * mean.abs().max(1.0), "{mean} off by {off}");
        }
    }
}

#[test]
fn a_curve_of_wide_pixels_is_exact_where_its_edges_moved() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, ..) = machine_with_history(folder.path(), 1, &[150_000, 100_000]);
    let rows: Vec<Seen> = (directory.records().expect("reads").iter())
        .flat_map(|r| rows_of(&r.path, 1500, None))
        .collect();
    let span = Span {
        from: micros(rows[70].at_us),
        to: micros(rows[rows.len() - 100].at_us),
    };
    let curve = directory.envelope(Of::Machine(MACHINE), PLACE, span, 50).expect("drawn");
    let moved = (curve.pixels.iter().enumerate())
        .filter(|(k, p)| {
            let width = span.to.micros() - span.from.micros();
            p.from.micros() != span.from.micros() + (*k as i64 * width + 49) / 50
        })
        .count();
    assert!(moved > 0, "no edge moved: nothing was taken from the roll-ups");
    assert_eq!(curve.pixels.iter().map(|p| p.rows).sum::<u64>(), rows.len() as u64 - 170);
    for pixel in &curve.pixels {
        let inside = rows
            .iter()
            .filter(|s| micros(s.at_us) >= pixel.from && micros(s.at_us) < pixel.to);
        let readings: Vec<f64> = inside.filter_map(|s| s.place).collect();
        assert_eq!(pixel.min, readings.iter().copied().reduce(f64::min));
        assert_eq!(pixel.max, readings.iter().copied().reduce(f64::max));
        assert_eq!(
            (pixel.first, pixel.last),
            (readings.first().copied(), readings.last().copied())
        );
    }
}

/// Some buckets of 256 rows then fit into a pixel and some do not, and those that do are read with their neighbours.
#[test]
fn a_curve_whose_pixels_are_little_wider_than_a_bucket_is_exact() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, _, rows) = machine_with_history(folder.path(), 9, &[60_000, 300, 25_000]);
    let (first, last) = (rows[0].at_us, rows[rows.len() - 1].at_us);
    for rows_of_a_pixel in [257, 300, 384, 450, 500, 511, 513, 700] {
        let span = Span {
            from: micros(first + 13_000),
            to: micros(last - 7_000),
        };
        let pixels = rows.len() / rows_of_a_pixel;
        let curve = directory.envelope(Of::Machine(MACHINE), LOAD, span, pixels).expect("drawn");
        check_curve(&curve.pixels, span, &rows, |s| s.load);
    }
}

#[test]
fn a_single_lost_row_is_a_gap_at_any_resolution() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let ticks = (0..100_000).filter(|t| *t != 50_001);
    let rows: Vec<Sample> = ticks
        .map(|t| Sample {
            tick: Tick(t),
            ..Sample::default()
        })
        .collect();
    run(&mut directory, START, &rows);
    let gaps = |from_ms: i64, to_ms: i64, pixels| -> u64 {
        let at = |ms: i64| Timestamp(START.0 + ms * 1_000_000);
        let span = Span {
            from: at(from_ms),
            to: at(to_ms),
        };
        let curve = directory.envelope(Of::Machine(MACHINE), LOAD, span, pixels).expect("drawn");
        curve.pixels.iter().map(|p| p.gaps + u64::from(p.after_gap)).sum()
    };
    for pixels in [1, 7, 2000] {
        assert_eq!((gaps(0, 100_000, pixels), gaps(0, 50_000, pixels)), (1, 0), "{pixels} pixels");
    }
}

#[test]
fn a_roll_up_is_a_twentieth_of_its_record_at_most() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut noise = move |rms: f64| {
        // Sum of twelve uniforms: mean 6, variance 1.
        let sum: f64 = (0..12).map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX)).sum();
        (sum - 6.0) * rms
    };
    // As in record.rs: a path of arcs at 20 mm/s with following error, loads and currents with four quanta rms of noise.
    let rows: Vec<Sample> = (0..200_000u64)
        .map(|k| {
            let t = k as f64 * 0.001;
            let place = |t: f64| {
                [
                    40.0 * (0.5 * t).sin() - 300.0,
                    40.0 * (0.5 * t).cos() - 200.0,
                    -5.0 - (t / 30.0).floor(),
                ]
            };
            let (commanded, before) = (place(t), place(t - 0.004));
            let velocity: [f64; 3] = std::array::from_fn(|a| (commanded[a] - before[a]) / 0.004);
            Sample {
                tick: Tick(k),
                workingstep: WorkingstepId((t / 30.0) as u32 + 1),
                commanded,
                actual: std::array::from_fn(|a| before[a] + noise(0.0005)),
                velocity: std::array::from_fn(|a| velocity[a] + noise(0.1)),
                load: std::array::from_fn(|a| 20.0 + velocity[a] + noise(0.4)),
                current: std::array::from_fn(|a| 2.0 + 0.1 * velocity[a] + noise(0.04)),
                path_speed: 20.0,
                spindle_speed: 8000.0 + noise(0.4),
                spindle_load: 35.0 + noise(0.4),
                ..Sample::default()
            }
        })
        .collect();
    let (_, row) = run(&mut directory, START, &rows);
    let rollup = directory.rollup_path(&row).metadata().expect("made with the record").len();
    let part = rollup as f64 / row.bytes as f64;
    println!("{rollup} of {} bytes: {:.2} %", row.bytes, part * 100.0);
    assert!(part <= 0.05, "{part}");
}

fn rollup_of_only_record(directory: &DataDirectory) -> PathBuf {
    directory.rollup_path(&directory.records().expect("reads")[0])
}

#[test]
fn a_roll_up_made_again_is_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, ..) = machine_with_history(folder.path(), 3, &[9000]);
    let path = rollup_of_only_record(&directory);
    let first = std::fs::read(&path).expect("made with the record");
    std::fs::remove_file(&path).expect("removed");
    directory
        .roll_up(&directory.records().expect("reads")[0])
        .expect("made again");
    assert_eq!(std::fs::read(&path).expect("there"), first);
}

#[test]
fn a_flipped_bit_in_a_roll_up_is_found_and_the_roll_up_is_made_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, jobs, rows) = machine_with_history(folder.path(), 4, &[9000]);
    let path = rollup_of_only_record(&directory);
    let whole = std::fs::read(&path).expect("made with the record");
    let seed = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    println!("SEED={seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let span = Span {
        from: micros(rows[0].at_us),
        to: micros(rows[rows.len() - 1].at_us + 1),
    };
    for _ in 0..200 {
        let mut changed = whole.clone();
        let place = random.next_u64() as usize % changed.len();
        changed[place] ^= 1 << (random.next_u32() % 8);
        std::fs::write(&path, &changed).expect("written");
        let found = Rollup::open(&path).and_then(|r| r.check());
        assert!(
            matches!(found, Err(StoreError::DamagedRollup { .. })),
            "byte {place}: {found:?}"
        );
        let curve = directory
            .envelope(Of::Job(jobs[0]), LOAD, span, 10)
            .expect("the record is still there");
        check_curve(&curve.pixels, span, &rows, |s| s.load);
    }
    std::fs::write(&path, &whole[..whole.len() / 2]).expect("cut");
    check_statistics(&directory, jobs[0]);
    assert_eq!(std::fs::read(&path).expect("made again"), whole);
    assert_eq!(directory.verify().expect("verifies"), []);
}

#[test]
fn a_changed_record_is_not_drawn() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, jobs, rows) = machine_with_history(folder.path(), 5, &[5000]);
    let (other, ..) = machine_with_history(&folder.path().join("other"), 6, &[5000]);
    let path = &directory.records().expect("reads")[0].path;
    std::fs::copy(&other.records().expect("reads")[0].path, path).expect("exchanged");
    let span = Span {
        from: micros(rows[10].at_us),
        to: micros(rows[4000].at_us),
    };
    let refused = directory
        .envelope(Of::Job(jobs[0]), LOAD, span, 2000)
        .expect_err("other rows");
    assert!(matches!(refused, StoreError::Damaged { .. }), "{refused}");
}

#[test]
fn an_unknown_channel_is_refused_with_the_known_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    let (directory, jobs, _) = machine_with_history(folder.path(), 5, &[50]);
    for refused in [
        directory
            .envelope(Of::Job(jobs[0]), "X.LAOD", Span::ALL, 10)
            .expect_err("unknown"),
        directory
            .range(Of::Job(jobs[0]), Span::ALL, &["X.LAOD"])
            .expect_err("unknown"),
        directory.workingstep_statistics(jobs[0], &["X.LAOD"]).expect_err("unknown"),
    ] {
        assert!(
            refused.to_string().starts_with("no record has a channel X.LAOD: there are "),
            "{refused}"
        );
        assert_eq!(refused.exit_code(), 2);
    }
}

fn count(directory: &DataDirectory, job: JobId) -> (usize, usize) {
    let mut found = (0, 0);
    for piece in directory.range(Of::Job(job), Span::ALL, &[LOAD]).expect("begun") {
        match piece.expect("whole") {
            Piece::Rows(rows) => found.0 += rows.len(),
            Piece::RolledUp(bucket) => found.1 += bucket.rows as usize,
        }
    }
    found
}

#[test]
fn rows_are_read_once_while_they_are_recorded_compacted_and_catalogued() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let samples = samples(&mut ChaCha8Rng::seed_from_u64(9), 30_000);
    let job = begin(&mut directory, START);
    let settings = Settings {
        segment_rows: 8000,
        ..Settings::new(Pace::Simulated)
    };
    let recording = directory.recording_folder(job);
    let rows = SampleRows::new(START, &recording);
    let mut recorder = Recorder::begin(&recording, rows, header(START).metadata(), &settings).expect("begun");
    for sample in &samples[..20_000] {
        assert_eq!(recorder.offer(sample), Offered::Taken);
    }
    // Whatever is acknowledged by now: each row once, from the first on.
    let (seen, _) = count(&directory, job);
    assert!(seen <= 20_000);
    for sample in &samples[20_000..] {
        assert_eq!(recorder.offer(sample), Offered::Taken);
    }
    recorder.end().expect("ended");
    assert_eq!(count(&directory, job), (30_000, 0));
    let told = directory.workingstep_statistics(job, &[LOAD]).expect("told");
    let curve = |directory: &DataDirectory| {
        let span = Span {
            from: START,
            to: START.at(Tick(samples[29_999].tick.0 + 1)),
        };
        let mut pixels = directory.envelope(Of::Job(job), LOAD, span, 100).expect("drawn").pixels;
        // The parts of a recording and its record have their buckets elsewhere, so edges may move elsewhere: what they sum up to is
        // the same.
        pixels.retain(|p| p.rows > 0);
        let least = pixels.iter().filter_map(|p| p.min).reduce(f64::min);
        let most = pixels.iter().filter_map(|p| p.max).reduce(f64::max);
        (
            pixels
                .iter()
                .map(|p| (p.rows, p.missing))
                .fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1)),
            least,
            most,
        )
    };
    let before = curve(&directory);

    // As a process leaves it that is killed between catalogue and discard: record and parts both stand.
    let path = directory.record_path(MACHINE, START, job);
    let merged = store::segment::merge(&recording, &path, &[], &[]).expect("merged");
    directory.catalogue(job, &merged.finished, START).expect("catalogued");
    assert!(recording.is_dir());
    assert_eq!(count(&directory, job), (30_000, 0));
    assert_eq!(curve(&directory), before);
    assert_eq!(before.0.0, 30_000);
    store::segment::discard(&recording).expect("gone");
    assert_eq!(count(&directory, job), (30_000, 0));
    for (before, after) in told.iter().zip(directory.workingstep_statistics(job, &[LOAD]).expect("told")) {
        let (a, b) = (&before.channels[0], &after.channels[0]);
        assert_eq!((a.count, a.missing, a.min, a.max), (b.count, b.missing, b.min, b.max));
    }
    check_statistics(&directory, job);
}

#[test]
fn records_that_overlap_in_time_are_merged_row_by_row() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut all = Vec::new();
    for shift in [0, 400, 700] {
        let samples = samples(&mut random, 3000);
        let (_, row) = run(&mut directory, Timestamp(START.0 + shift * 1_000_000), &samples);
        all.extend(rows_of(&row.path, 1500, None));
    }
    let mut times = Vec::new();
    for piece in directory.range(Of::Machine(MACHINE), Span::ALL, &[LOAD]).expect("begun") {
        let Piece::Rows(rows) = piece.expect("whole") else {
            panic!("nothing was removed")
        };
        times.extend_from_slice(rows.times_us());
    }
    assert!(times.is_sorted());
    assert_eq!(times.len(), 9000);
    let span = Span {
        from: START,
        to: micros(all.iter().map(|s| s.at_us).max().expect("rows") + 1),
    };
    for pixels in [5, 300] {
        let curve = directory.envelope(Of::Machine(MACHINE), LOAD, span, pixels).expect("drawn");
        for pixel in &curve.pixels {
            let inside = all
                .iter()
                .filter(|s| micros(s.at_us) >= pixel.from && micros(s.at_us) < pixel.to);
            let readings: Vec<f64> = inside.clone().filter_map(|s| s.load).collect();
            assert_eq!(pixel.rows as usize, inside.count());
            assert_eq!(pixel.min, readings.iter().copied().reduce(f64::min));
            assert_eq!(pixel.max, readings.iter().copied().reduce(f64::max));
        }
    }
}

// -- retention and holds

/// Two old jobs and a young one; the time of asking.
fn aged(folder: &Path) -> (DataDirectory, [JobId; 3], Timestamp) {
    let mut directory = DataDirectory::open(folder, "test").expect("free");
    let now = Timestamp(START.0 + 100 * DAY_NS);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let jobs = [0, 1, 99].map(|day| {
        let samples = samples(&mut random, 5000);
        run(&mut directory, Timestamp(START.0 + day * DAY_NS), &samples).0
    });
    (directory, jobs, now)
}

#[test]
fn old_rows_go_and_what_they_came_to_stays() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut directory, jobs, now) = aged(folder.path());
    let before = directory.workingstep_statistics(jobs[0], &[LOAD]).expect("told");
    let bytes: u64 = directory.records().expect("reads").iter().map(|r| r.bytes).sum();
    let removed = directory.retain(&Retention::default(), now).expect("retained").removed;
    assert_eq!(removed.iter().map(|r| r.record.job).collect::<Vec<_>>(), jobs[..2]);
    assert_eq!(removed[0].why, "its last row is more than 90 days old");
    assert_eq!(directory.removals().expect("reads"), removed);
    assert!(removed.iter().all(|r| !r.record.path.exists()));
    assert_eq!(directory.records().expect("reads").len(), 3, "the catalogue keeps them");
    assert_eq!(directory.verify().expect("verifies"), []);
    assert_eq!(directory.retain(&Retention::default(), now).expect("again").removed, []);

    assert_eq!(directory.workingstep_statistics(jobs[0], &[LOAD]).expect("told"), before);
    assert_eq!(
        (count(&directory, jobs[0]), count(&directory, jobs[2])),
        ((0, 5000), (5000, 0))
    );
    let (first, last) = removed[0].record.span_us.expect("rows");
    let span = Span {
        from: micros(first),
        to: micros(last + 1),
    };
    let curve = directory.envelope(Of::Job(jobs[0]), LOAD, span, 2000).expect("drawn");
    assert_eq!(curve.pixels.iter().map(|p| p.rows).sum::<u64>(), 5000);
    assert!(curve.pixels.iter().any(|p| p.coarse), "narrow pixels say what was lost");
    let curve = directory.envelope(Of::Job(jobs[0]), LOAD, span, 3).expect("drawn");
    assert!(curve.pixels.iter().all(|p| !p.coarse), "wide pixels lose nothing");

    // A changed roll-up cannot be made again: it is reported.
    let path = directory.rollup_path(&removed[0].record);
    let mut changed = std::fs::read(&path).expect("reads");
    changed[40] ^= 1;
    std::fs::write(&path, changed).expect("written");
    let refused = directory.envelope(Of::Job(jobs[0]), LOAD, span, 3).err();
    let findings = directory.verify().expect("verifies");
    assert!(
        matches!(refused, None | Some(StoreError::DamagedRollup { .. })),
        "{refused:?}"
    );
    assert!(directory.roll_up(&removed[0].record).is_err());
    assert!(
        findings[0]
            .to_string()
            .contains("is not what was kept when its record was removed"),
        "{findings:?}"
    );
    println!("{bytes} bytes of records");
}

#[test]
fn a_job_on_hold_or_running_keeps_its_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut directory, jobs, now) = aged(folder.path());
    let running = begin(&mut directory, START);
    let path = directory.record_path(MACHINE, START, running);
    let mut writer = Writer::create(&path, &header(START)).expect("made");
    writer.write(&Sample::default()).expect("written");
    let finished = writer.finish(&[]).expect("finished");
    directory.catalogue(running, &finished, START).expect("catalogued");

    assert!(matches!(
        directory.hold_job(jobs[0], "Maria", " ", now),
        Err(StoreError::NobodyStandsBehind)
    ));
    assert!(matches!(
        directory.hold_job(JobId(77), "Maria", "x", now),
        Err(StoreError::NoSuchJob(_))
    ));
    let hold = directory.hold_job(jobs[0], "Maria", "the customer asked", now).expect("held");
    assert!(matches!(
        directory.hold_job(jobs[0], "Maria", "again", now),
        Err(StoreError::HeldAlready(_))
    ));
    assert_eq!(directory.holds().expect("reads"), [hold]);
    let removed = directory.retain(&Retention::default(), now).expect("retained").removed;
    assert_eq!(removed.iter().map(|r| r.record.job).collect::<Vec<_>>(), [jobs[1]]);
    assert_eq!(directory.verify().expect("verifies"), []);
    directory
        .release_job(jobs[0], "Maria", "the part is back", now)
        .expect("released");
    assert!(matches!(
        directory.release_job(jobs[0], "Maria", "again", now),
        Err(StoreError::NotHeld(_))
    ));
    let removed = directory.retain(&Retention::default(), now).expect("retained").removed;
    assert_eq!(removed.iter().map(|r| r.record.job).collect::<Vec<_>>(), [jobs[0]]);
    assert_eq!(directory.verify().expect("verifies"), []);
    assert!(path.exists(), "an open job keeps its rows");
}

#[test]
fn above_four_fifths_of_the_quota_the_oldest_go() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut directory, jobs, _) = aged(folder.path());
    let young = Timestamp(START.0 + 99 * DAY_NS);
    let patient = |quota_bytes| Retention {
        raw_days: 1000.0,
        quota_bytes,
    };
    assert_eq!(directory.retain(&patient(None), young).expect("retained").removed, []);
    assert_eq!(
        directory.retain(&patient(Some(1 << 40)), young).expect("retained").removed,
        []
    );
    let taken: u64 = directory.records().expect("reads").iter().map(|r| r.bytes).sum();
    // The database and its log count as well; they alone are more than this.
    let removed = directory.retain(&patient(Some(taken)), young).expect("retained").removed;
    assert_eq!(removed.iter().map(|r| r.record.job).collect::<Vec<_>>(), jobs);
    assert!(removed[0].why.contains("more than 80 % of its quota"), "{}", removed[0].why);
    assert_eq!(directory.verify().expect("verifies"), []);
}

#[test]
fn a_record_that_was_asked_for_elsewhere_is_not_ours_to_remove() {
    let (folder, elsewhere) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
    let job = begin(&mut directory, START);
    let path = elsewhere.path().join("record.parquet");
    let mut writer = Writer::create(&path, &header(START)).expect("made");
    writer.write(&Sample::default()).expect("written");
    let finished = writer.finish(&[]).expect("finished");
    directory.catalogue(job, &finished, START).expect("catalogued");
    directory.end_job(job, START, Ending::Done).expect("ends");
    let now = Timestamp(START.0 + 1000 * DAY_NS);
    assert_eq!(directory.retain(&Retention::default(), now).expect("retained").removed, []);
    assert!(path.exists());
}

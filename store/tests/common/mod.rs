//! A data directory with something of everything in it.

use ledger::{Chain, ChangeRequest, Hash, Level, Operator};
use machine::{Quality, Sample};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use store::record::{Header, Writer};
use store::sizing::{NewSize, SizingJob};
use store::{Assignment, DataDirectory, Ending, JobId, NewJob, Retention};
use units::{StepId, Tick, Timestamp};

pub const START: Timestamp = Timestamp(1_795_132_800_000_000_000);
pub const PROGRAM: &[u8] = b"G0 X0\nG1 X10 F100\nM30\n";

/// One job with its program, events, record and report. `folder` is where its files go; `None` for the job's own.
pub fn run_a_job(directory: &mut DataDirectory, folder: Option<&Path>, rows: u64) -> JobId {
    let program_hash = Hash::of(PROGRAM);
    directory
        .keep_program("part.nc", &mut &PROGRAM[..], program_hash, START)
        .expect("kept");
    let job = directory
        .begin_job(&NewJob {
            program: "part.nc",
            program_hash,
            machine: "sim-mill",
            seed: u64::MAX - 7,
            start: START,
            folder,
            who: "Maria",
        })
        .expect("begins");
    let mut chain = Chain::default();
    let events: Vec<_> = (1..=5u32)
        .map(|n| {
            let detail = BTreeMap::from([
                ("step".to_owned(), n.into()),
                ("length_mm".to_owned(), (0.1 * f64::from(n)).into()),
            ]);
            chain.append(Timestamp(START.0 + i64::from(n) * 1_000_000), "step", detail)
        })
        .collect();
    directory.append_job_events(job.id, &events).expect("kept");
    let path = match folder {
        Some(folder) => folder.join("record.parquet"),
        None => directory.record_path("sim-mill", START, job.id),
    };
    let header = Header {
        machine: "sim-mill".into(),
        simulated: true,
        start: START,
        seed: u64::MAX - 7,
    };
    let mut writer = Writer::create(&path, &header).expect("made");
    for tick in 0..rows {
        let sample = Sample {
            tick: Tick(tick),
            step: StepId(1 + (tick / 100) as u32),
            quality: Quality::Simulated,
            actual: [tick as f64 * 0.013, (tick % 17) as f64, -1.5],
            ..Sample::default()
        };
        writer.write(&sample).expect("written");
    }
    let finished = writer.finish(&events).expect("finished");
    directory.catalogue(job.id, &finished, START).expect("catalogued");
    let report = job.folder.join("report.json");
    std::fs::write(&report, r#"{"verdict":"good"}"#).expect("written");
    directory.keep_files(job.id, &[report], START).expect("kept");
    directory
        .end_job(job.id, Timestamp(START.0 + rows as i64 * 1_000_000), Ending::Done)
        .expect("ends");
    job.id
}

/// Two operators, and two programs that were run from `folder`.
fn people(directory: &mut DataDirectory, folder: &Path) {
    for (name, level) in [("Maria", 1), ("Jo", 6)] {
        let mut operator = Operator::new(name, Level::new(level).expect("a level"));
        for text in [
            &mut operator.experience,
            &mut operator.organization,
            &mut operator.role,
            &mut operator.shift,
        ] {
            *text = format!("known of {name}");
        }
        operator.qualified_until = (level > 1).then_some(Timestamp(START.0 + 1));
        let assignment = Assignment {
            after: &operator,
            by_level: Some(Level::HIGHEST),
            who: "local",
            why: "new here",
            at: START,
            undoes: None,
        };
        directory.assign_operator(&assignment).expect("assigned");
    }
    for name in ["one.nc", "two.nc"] {
        let hash = Hash::of(name.as_bytes());
        directory.keep_known(&folder.join(name), hash, "Maria", START).expect("kept");
    }
}

/// A job of sizes with two entries.
fn size_a_part(directory: &mut DataDirectory) {
    let job = SizingJob {
        id: 0,
        machine: "sim-mill".into(),
        diameters: "x".into(),
        name: "BRACKET".into(),
        text: "name = \"BRACKET\"".into(),
    };
    let job = directory.load_sizing_job(&job, "Maria", START).expect("kept");
    for dimension in ["SLOT", "STEP"] {
        let entry = NewSize {
            job: job.id,
            kind: "size-entered",
            at: START,
            detail: BTreeMap::from([("dimension".to_owned(), dimension.into())]),
            change: None,
        };
        directory.keep_size(&entry, &mut |_| {}).expect("kept");
    }
}

/// A job on hold, one whose rows were removed by age, one that wrote outside of the directory, some process values.
pub fn populate(root: &Path, outside: &Path) {
    let mut directory = DataDirectory::open(root, "test").expect("free");
    directory.opened(START, "Maria", "test").expect("told");
    run_a_job(&mut directory, None, 500);
    let mut before = None;
    for (n, to) in [0.25, 0.0, -0.0, -0.0229].into_iter().enumerate() {
        directory
            .change_value(&ChangeRequest {
                path: "sim-mill/tool/5/wear/x_mm".into(),
                to,
                expected: before,
                who: "Maria".into(),
                why: format!("measured part {n}"),
                when: START,
            })
            .expect("changed");
        before = Some(to);
    }
    size_a_part(&mut directory);
    let programs = directory.root().join("programs");
    people(&mut directory, &programs);
    run_a_job(&mut directory, None, 300);
    run_a_job(&mut directory, Some(outside), 200);
    directory
        .hold_job(JobId(1), "Maria", "the customer asked", START)
        .expect("held");
    let retention = Retention {
        raw_days: 1.0,
        quota_bytes: None,
    };
    let later = Timestamp(START.0 + 2 * 86_400_000_000_000);
    let removed = directory.retain(&retention, later).expect("removed");
    // The first is on hold, the last is not in the directory.
    assert_eq!(removed.removed.iter().map(|r| r.record.job).collect::<Vec<_>>(), [JobId(2)]);
}

/// Every file below a folder, by its path in it.
#[allow(dead_code, reason = "not every test file that shares this needs it")]
pub fn files_below(root: &Path) -> BTreeMap<String, PathBuf> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("reads") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let short = path.strip_prefix(root).expect("below").display().to_string();
                files.insert(short, path);
            }
        }
    }
    files
}

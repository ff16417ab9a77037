//! Recordings of agents in the data directory, at every step at which a recorder can be killed, and their age.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use store::observations::{GAP, Reached, Row, batch, layout, rows};
use store::segment::{Options, RealDisk, Writer};
use store::{DataDirectory, Ending, Job, NewRecording, Of, Recorded, Retention, Span, Table, part_of};
use units::Timestamp;

/// Long after what the agent's clock says.
const NOW: Timestamp = Timestamp(1_795_132_800_000_000_000);
const DAY: i64 = 86_400_000_000_000;

fn of() -> Recorded {
    Recorded {
        source: "agent mill-3:5000".into(),
        items: "//DataItem[@type=\"PATH_POSITION\"]".into(),
    }
}

fn open(root: &Path) -> DataDirectory {
    DataDirectory::open(root, "test").expect("free")
}

fn begin(directory: &mut DataDirectory) -> Job {
    let from = directory.recording_reached(&of()).expect("asked");
    let new = NewRecording {
        of: &of(),
        device: "mill-3",
        start: NOW,
        who: "Maria",
        from,
    };
    directory.begin_recording(&new).expect("begins")
}

fn row(sequence: u64) -> Row<'static> {
    let mut texts: [std::borrow::Cow<'static, str>; 10] = Default::default();
    texts[0] = "mill-3".into();
    texts[5] = "x".into();
    texts[9] = "SAMPLE".into();
    Row {
        // 1 ms apart, in 1970: the agent's clock was never set.
        at: Timestamp(sequence as i64 * 1_000_000),
        sequence,
        // Beyond what JSON numbers hold everywhere.
        instance: u64::MAX / 2,
        texts,
        text: Some("1.5".into()),
        condition: None,
        attributes: None,
    }
}

/// A segment with the rows of these numbers, the first of which is row `first_row`; it ends, or not.
fn segment(
    directory: &DataDirectory,
    job: &Job,
    number: u32,
    first_row: u64,
    sequences: std::ops::Range<u64>,
    ends: bool,
) -> PathBuf {
    let path = directory.recording_folder(job.id).join(format!("{number:04}.segment"));
    let metadata = DataDirectory::segment_metadata(&of(), NOW);
    let options = Options {
        first_row,
        ..Options::default()
    };
    let mut writer = Writer::begin(&RealDisk, &path, &layout().schema(), &metadata, &options).expect("begun");
    for sequence in sequences {
        writer
            .append(&batch(&[row(sequence)], &path).expect("it fits"))
            .expect("taken");
        writer.sync().expect("acknowledged");
    }
    if ends {
        writer.end().expect("ended");
    }
    path
}

fn catalogued(directory: &DataDirectory) -> Vec<u64> {
    let mut all = Vec::new();
    for record in directory.records().expect("the catalogue") {
        for batch in Table::open(&record.path).expect("whole").batches().expect("rows") {
            all.extend(
                rows(&batch.expect("whole"))
                    .expect("observations")
                    .iter()
                    .map(|row| row.sequence),
            );
        }
    }
    all
}

/// What the next process makes of it.
#[track_caller]
fn check_recovered(root: &Path, expected: std::ops::Range<u64>) -> DataDirectory {
    let mut directory = open(root);
    let left = directory.recover_interrupted().expect("recovered");
    let [interrupted] = &left.interrupted[..] else {
        panic!("{left:?}")
    };
    assert!(
        interrupted.is_recording && interrupted.not_recovered.is_none(),
        "{interrupted}"
    );
    let recovery = interrupted.recovery.as_ref().expect("it left a recording");
    assert_eq!(recovery.rows, expected.end - expected.start, "{interrupted}");
    assert_eq!(catalogued(&directory), expected.clone().collect::<Vec<_>>());
    let (job, reached) = directory.recording_reached(&of()).expect("asked").expect("it has parts");
    let last = Some(Timestamp((expected.end as i64 - 1) * 1_000_000));
    let instance = u64::MAX / 2;
    let next = expected.end;
    assert_eq!((job, reached), (interrupted.job.id, Reached { instance, next, last }));
    directory.end_job(job, NOW, Ending::Interrupted).expect("ends");
    assert!(!directory.recording_folder(job).exists());
    // A second look finds nothing to do, and nothing is odd.
    assert!(directory.recover_interrupted().expect("looked").interrupted.is_empty());
    assert_eq!(directory.verify().expect("verifies"), []);
    directory
}

#[test]
fn killed_at_any_step_every_acknowledged_row_is_catalogued_once() {
    for step in 0..5 {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(folder.path());
        let job = begin(&mut directory);
        let first = segment(&directory, &job, 1, 0, 10..40, true);
        let target = directory.part_path(&job, &first).expect("a place");
        if step >= 1 {
            // The Parquet file is half written, or whole and not in the catalogue.
            std::fs::create_dir_all(target.parent().expect("a folder")).expect("made");
            std::fs::write(target.with_extension("parquet.tmp"), "PAR1").expect("written");
        }
        if step >= 2 {
            let part = part_of(&first, 30, &target).expect("made");
            if step >= 3 {
                directory.keep_part(job.id, &first, &part, NOW).expect("catalogued");
            }
        }
        if step == 4 {
            // Catalogued, and its segment is still there.
            segment(&directory, &job, 1, 0, 10..40, true);
        }
        let second = segment(&directory, &job, 2, 30, 40..55, false);
        // Half a frame that was never acknowledged.
        let mut file = OpenOptions::new().append(true).open(&second).expect("there");
        file.write_all(&[7; 100]).expect("written");
        drop(directory);
        let directory = check_recovered(folder.path(), 10..55);
        assert_eq!(directory.records().expect("the catalogue").len(), 2, "step {step}");
    }
}

#[test]
fn rows_that_came_again_after_a_failed_sync_are_there_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = open(folder.path());
    let job = begin(&mut directory);
    // 25 rows were acknowledged; nobody could cut the others off before they came again.
    segment(&directory, &job, 1, 0, 10..40, false);
    segment(&directory, &job, 2, 25, 35..60, false);
    drop(directory);
    check_recovered(folder.path(), 10..60);
}

#[test]
fn a_recording_that_was_stopped_tells_how_far_the_agent_had_told_everything() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = open(folder.path());
    assert_eq!(directory.recording_reached(&of()).expect("asked"), None);
    let job = begin(&mut directory);
    let path = segment(&directory, &job, 1, 0, 10..40, true);
    let end = Reached {
        instance: 7,
        next: 5000,
        last: None,
    };
    let early = directory.end_recording(job.id, Some(end), NOW, Ending::Done);
    assert!(
        early
            .expect_err("rows are not in the catalogue")
            .to_string()
            .contains("not in the catalogue yet")
    );
    let part = part_of(&path, u64::MAX, &directory.part_path(&job, &path).expect("a place")).expect("made");
    directory.keep_part(job.id, &path, &part, NOW).expect("catalogued");
    directory.end_recording(job.id, Some(end), NOW, Ending::Done).expect("ends");
    assert_eq!(directory.recording_reached(&of()).expect("asked"), Some((job.id, end)));
    // Other data items of the same agent are another recording.
    let other = Recorded {
        items: String::new(),
        ..of()
    };
    assert_eq!(directory.recording_reached(&other).expect("asked"), None);
    assert_eq!(directory.verify().expect("verifies"), []);
}

#[test]
fn behind_a_gap_the_recording_goes_on_behind_its_last_number() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = open(folder.path());
    let job = begin(&mut directory);
    let path = segment(&directory, &job, 1, 0, 10..12, false);
    let mut gap = row(12);
    (gap.texts[7], gap.texts[9]) = ("overrun".into(), GAP.into());
    gap.text = Some("{\"to_sequence\":99}".into());
    assert_eq!(Reached::after(&gap).next, 100);
    let part = part_of(&path, u64::MAX, &directory.part_path(&job, &path).expect("a place")).expect("made");
    assert_eq!((part.gaps, part.reached.map(|r| r.next)), (0, Some(12)));
}

#[test]
fn parts_age_from_the_day_they_were_recorded_also_while_the_recording_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut directory = open(folder.path());
    let job = begin(&mut directory);
    let path = segment(&directory, &job, 1, 0, 10..40, true);
    let part = part_of(&path, u64::MAX, &directory.part_path(&job, &path).expect("a place")).expect("made");
    let row = directory.keep_part(job.id, &path, &part, NOW).expect("catalogued");
    assert_eq!(directory.roll_up(&row).expect("asked"), None, "observations have no roll-up");
    let removed = |directory: &mut DataDirectory, days: i64| {
        let retained = directory
            .retain(&Retention::default(), Timestamp(NOW.0 + days * DAY))
            .expect("looked");
        assert_eq!(retained.left, []);
        retained.removed.len()
    };
    assert_eq!(removed(&mut directory, 89), 0, "its clock says 1970, but it was recorded now");
    directory.hold_job(job.id, "Maria", "the part came back", NOW).expect("held");
    assert_eq!(removed(&mut directory, 91), 0);
    directory.release_job(job.id, "Maria", "settled", NOW).expect("released");
    assert_eq!(removed(&mut directory, 91), 1);
    assert!(!row.path.exists());
    // Where the recording goes on is still known, and curves of the machine can be asked for.
    assert_eq!(
        directory.recording_reached(&of()).expect("asked").map(|(_, r)| r.next),
        Some(40)
    );
    directory
        .envelope(Of::Machine("mill-3"), "X.LOAD", Span::ALL, 10)
        .map(drop)
        .unwrap_or_else(|error| {
            assert!(error.to_string().contains("X.LOAD"), "{error}");
        });
    assert_eq!(directory.verify().expect("verifies"), []);
}

//! Segments on a real disk: what was acknowledged comes back, what was damaged is found out.

use arrow_array::builder::{StringBuilder, StringDictionaryBuilder};
use arrow_array::cast::AsArray;
use arrow_array::types::Int32Type;
use arrow_array::{Array, ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray, TimestampMicrosecondArray};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use store::Table;
use store::segment::frame::BadFrame;
use store::segment::{self, Cause, Gap, Layout, Options, RealDisk, Writer};

fn metadata() -> BTreeMap<String, String> {
    BTreeMap::from([("toolmark.machine".to_owned(), "sim-mill".to_owned())])
}

/// Observations number `from` to `from + count`, no two the same.
fn observations(from: i64, count: i64) -> RecordBatch {
    let numbers = || from..from + count;
    let mut words = StringDictionaryBuilder::<Int32Type>::new();
    let mut types = StringDictionaryBuilder::<Int32Type>::new();
    let mut conditions = StringDictionaryBuilder::<Int32Type>::new();
    let mut texts = StringBuilder::new();
    for n in numbers() {
        words.append_value(["x_load", "execution", "spindle"][n as usize % 3]);
        types.append_value("LOAD");
        conditions.append_option((n % 5 == 0).then_some("NORMAL"));
        texts.append_option((n % 3 == 1).then(|| format!("text {n}")));
    }
    let columns: Vec<ArrayRef> = vec![
        Arc::new(TimestampMicrosecondArray::from_iter_values(numbers().map(|n| n * 1000)).with_timezone("UTC")),
        Arc::new(Int64Array::from_iter_values(numbers())),
        Arc::new(words.finish()),
        Arc::new(types.finish()),
        Arc::new(
            numbers()
                .map(|n| (n % 3 == 0).then_some(n as f64 * 0.1))
                .collect::<Float64Array>(),
        ),
        Arc::new(texts.finish()),
        Arc::new(conditions.finish()),
    ];
    RecordBatch::try_new(Layout::observations().schema(), columns).expect("fits its layout")
}

/// Three groups of ten rows, a gap between the first two; each group synced. Gives the length of the file after each sync.
fn write(path: &Path, compress: bool, end: bool) -> Vec<u64> {
    let options = Options {
        compress,
        ..Options::default()
    };
    let schema = Layout::observations().schema();
    let mut writer = Writer::begin(&RealDisk, path, &schema, &metadata(), &options).expect("begun");
    let mut lengths = Vec::new();
    for group in 0..3 {
        writer.append(&observations(group * 10, 10)).expect("appended");
        if group == 1 {
            writer.gap(&gap()).expect("told");
        }
        assert_eq!(
            writer.acknowledged(),
            group as u64 * 10,
            "nothing is acknowledged before its sync"
        );
        assert_eq!(writer.sync().expect("synced"), (group as u64 + 1) * 10);
        lengths.push(writer.bytes());
        assert_eq!(path.metadata().expect("there").len(), writer.bytes());
    }
    if end {
        writer.end().expect("ended");
    }
    lengths
}

fn gap() -> Gap {
    Gap {
        from: 20,
        to: 24,
        count: 5,
        cause: Cause::Source,
    }
}

/// The rows that come back are the first ones that were written, unchanged; gives how many.
#[track_caller]
fn rows_of(path: &Path) -> u64 {
    let found = segment::read(path).expect("a segment");
    let mut rows = 0;
    for batch in found.batches().expect("reads") {
        let batch = batch.expect("whole");
        assert_eq!(batch, observations(rows, batch.num_rows() as i64));
        rows += batch.num_rows() as i64;
    }
    assert_eq!(rows as u64, found.rows);
    found.rows
}

#[test]
fn rows_gaps_and_metadata_come_back_as_they_were_appended() {
    let folder = tempfile::tempdir().expect("a folder");
    for compress in [false, true] {
        let path = folder.path().join(format!("{compress}.segment"));
        write(&path, compress, true);
        let found = segment::read(&path).expect("a segment");
        assert_eq!((found.rows, found.ended, found.lost.clone()), (30, true, None));
        assert_eq!(found.gaps, [gap()]);
        assert_eq!(found.metadata["toolmark.machine"], "sim-mill");
        assert_eq!(found.schema, Layout::observations().schema());
        assert_eq!(found.span_us().expect("reads"), Some((0, 29_000)));
        assert_eq!(rows_of(&path), 30);
    }
}

#[test]
fn a_segment_whose_writer_went_away_has_all_acknowledged_rows_and_no_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("1.segment");
    write(&path, true, false);
    let found = segment::read(&path).expect("a segment");
    assert_eq!((found.rows, found.ended, found.lost), (30, false, None));
}

#[test]
fn observations_become_parquet_with_their_words_numbers_and_gaps() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("agent");
    write(&recording.join("0001.segment"), true, true);
    let target = folder.path().join("agent.parquet");
    let merged = segment::merge(&recording, &target, &[], &[("toolmark.source", "agent".to_owned())]).expect("merged");
    assert_eq!((merged.finished.rows, merged.finished.span_us), (30, Some((0, 29_000))));
    assert_eq!((merged.gaps, merged.lost), (vec![gap()], vec![]));
    let table = Table::open(&target).expect("ours");
    assert_eq!((table.len(), table.metadata()["toolmark.source"].as_str()), (30, "agent"));
    let batches: Vec<RecordBatch> = table.batches().expect("reads").map(|batch| batch.expect("whole")).collect();
    let [batch] = &batches[..] else {
        panic!("a few rows are one batch")
    };
    let expected = observations(0, 30);
    for (k, field) in expected.schema().fields().iter().enumerate() {
        let texts = |batch: &RecordBatch| {
            let column = batch.column(k);
            (0..30).map(|row| text_of(column, row)).collect::<Vec<_>>()
        };
        assert_eq!(texts(batch), texts(&expected), "{}", field.name());
    }
    // A changed byte is found in it as in any record.
    let mut bytes = std::fs::read(&target).expect("reads");
    bytes[100] ^= 4;
    std::fs::write(&target, bytes).expect("damaged");
    assert_eq!(Table::open(&target).expect_err("damaged").exit_code(), 3);
}

/// A value in words: dictionaries may number them otherwise.
fn text_of(column: &ArrayRef, row: usize) -> String {
    if let Some(words) = column.as_dictionary_opt::<Int32Type>() {
        let words = words.downcast_dict::<StringArray>().expect("words");
        return words
            .into_iter()
            .nth(row)
            .flatten()
            .map_or_else(|| "null".to_owned(), str::to_owned);
    }
    format!("{:?}", column.slice(row, 1))
}

#[test]
fn a_second_writer_does_not_touch_a_segment_that_is_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("1.segment");
    write(&path, true, true);
    let schema = Layout::observations().schema();
    assert!(Writer::begin(&RealDisk, &path, &schema, &metadata(), &Options::default()).is_err());
    assert_eq!(rows_of(&path), 30);
}

#[test]
fn rows_of_other_columns_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("1.segment");
    let schema = Layout::machine().schema();
    let mut writer = Writer::begin(&RealDisk, &path, &schema, &metadata(), &Options::default()).expect("begun");
    assert!(writer.append(&observations(0, 1)).is_err());
    assert_eq!(writer.end().expect("ended"), 0);
    assert_eq!(segment::read(&path).expect("a segment").rows, 0);
}

#[test]
fn zeros_behind_the_last_frame_are_no_clean_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("1.segment");
    let lengths = write(&path, true, false);
    std::fs::File::options()
        .write(true)
        .open(&path)
        .and_then(|f| f.set_len(lengths[2] + 4096))
        .expect("longer");
    let lost = segment::read(&path).expect("a segment").lost.expect("found");
    assert_eq!((lost.at_byte, lost.bytes, &lost.why), (lengths[2], 4096, &BadFrame::Zeros));
    assert!(lost.is_unfinished_write());
    let found = segment::read(&path).expect("a segment");
    assert_eq!(segment::cut(&found).expect("cut"), None, "zeros are not worth keeping");
    assert_eq!(segment::read(&path).expect("a segment").lost, None);
    assert_eq!(rows_of(&path), 30);
}

#[test]
fn what_is_cut_off_is_kept_aside() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("1.segment");
    let lengths = write(&path, true, true);
    let mut bytes = std::fs::read(&path).expect("reads");
    bytes[lengths[1] as usize + 40] ^= 1;
    std::fs::write(&path, &bytes).expect("damaged");
    let found = segment::read(&path).expect("a segment");
    let lost = found.lost.clone().expect("found");
    assert!(
        matches!(lost.why, BadFrame::Checksum { .. }) && !lost.is_unfinished_write(),
        "{lost}"
    );
    assert_eq!((found.rows, lost.at_byte), (20, lengths[1]));
    let aside = segment::cut(&found).expect("cut").expect("worth keeping");
    assert_eq!(std::fs::read(aside).expect("reads"), bytes[lengths[1] as usize..]);
    assert_eq!(rows_of(&path), 20);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Cut, zeroed from a place on, or one bit flipped: every row before the damage is there, none behind it, and the damage is said.
    #[test]
    fn damage_anywhere_is_found_and_costs_nothing_before_it(at in any::<prop::sample::Index>(), harm in 0..3, bit in 0_u8..8, compress: bool, end: bool) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("1.segment");
        let lengths = write(&path, compress, end);
        let good = std::fs::read(&path).expect("reads");
        let place = at.index(good.len());
        let mut bytes = good.clone();
        match harm {
            0 => bytes.truncate(place),
            1 => bytes[place..].fill(0),
            _ => bytes[place] ^= 1_u8 << bit,
        }
        std::fs::write(&path, &bytes).expect("damaged");
        let safe = lengths.iter().filter(|l| **l <= place as u64).count() as u64 * 10;
        match segment::read(&path) {
            // Head and schema are one sync: before it there was nothing to lose.
            Err(refused) => prop_assert!(safe == 0 && refused.exit_code() == 3, "{refused}"),
            Ok(found) => {
                let whole = if bytes == good { 30 } else { safe };
                // A frame of rows is whole before the gap's frame behind it is.
                prop_assert!(found.rows >= whole, "{} of {whole}", found.rows);
                if harm == 0 && found.lost.is_none() {
                    // Cut between two frames: what is missing is the end.
                    prop_assert!(!found.ended);
                } else if bytes != good {
                    prop_assert!(found.lost.is_some(), "not found");
                }
                prop_assert_eq!(rows_of(&path), found.rows);
            }
        }
    }
}

//! Samples as ASAM MDF 4, for measurement programs.
//!
//! One channel group with time as its master channel; readings are doubles in their unit, and a reading that was not available is not a
//! number, as those programs expect it.

use super::export::Selection;
use super::seconds_since;
use crate::failure::Failure;
use mdf4_rs::{DataType, DecodedValue, MdfWriter};
use std::path::Path;

/// Where the start time stands in the file: the head block begins at byte 64, its start time 72 bytes into it (MDF 4.1, HDBLOCK).
const START_TIME: u64 = 64 + 72;

/// Writes the file and gives the number of rows.
///
/// # Errors
/// A record is damaged, or the file cannot be written.
pub fn write(selection: &Selection<'_>, path: &Path) -> Result<u64, Failure> {
    let failed = |e: mdf4_rs::Error| Failure::writing(path, e);
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    let temporary = Path::new(&name);
    let text = temporary
        .to_str()
        .ok_or_else(|| Failure::usage(format_args!("--out {}: the name is not valid Unicode", path.display())))?;
    let mut file = MdfWriter::new(text).map_err(failed)?;
    let rows = fill(&mut file, selection, &failed);
    let rows = rows.and_then(|rows| file.finalize().map_err(failed).map(|()| rows));
    drop(file);
    let moved = rows.and_then(|rows| {
        let last = std::fs::File::open(temporary).and_then(|f| f.sync_all());
        last.and_then(|()| std::fs::rename(temporary, path))
            .map_err(|e| Failure::writing(path, e))
            .map(|()| rows)
    });
    if moved.is_err() {
        // The failure at hand is the one to be told.
        let _ = std::fs::remove_file(temporary);
    }
    moved
}

fn fill<W: mdf4_rs::writer::MdfWrite>(
    file: &mut MdfWriter<W>,
    selection: &Selection<'_>,
    failed: &impl Fn(mdf4_rs::Error) -> Failure,
) -> Result<u64, Failure> {
    file.init_mdf_file().map_err(failed)?;
    file.update_link(START_TIME, selection.start.0.unsigned_abs())
        .map_err(failed)?;
    let group = file.add_channel_group(None, |_| {}).map_err(failed)?;
    let mut last: Option<String> = None;
    let mut add = |name: &str, unit: &str, kind: DataType, bits: u32| -> Result<String, mdf4_rs::Error> {
        let channel = file.add_channel(&group, last.as_deref(), |channel| {
            channel.data_type = kind;
            channel.name = Some(name.to_owned());
            channel.bit_count = bits;
        })?;
        file.set_channel_unit(&channel, unit)?;
        last = Some(channel.clone());
        Ok(channel)
    };
    let time = add("time", "s", DataType::FloatLE, 64).map_err(failed)?;
    for (name, bits) in [
        ("tick", 64),
        ("step", 32),
        ("workingstep", 32),
        ("tool", 32),
        ("phase", 8),
        ("quality", 8),
    ] {
        add(name, "", DataType::UnsignedIntegerLE, bits).map_err(failed)?;
    }
    for column in selection.columns {
        add(&column.name, &column.unit, DataType::FloatLE, 64).map_err(failed)?;
    }
    file.set_time_channel(&time).map_err(failed)?;
    file.start_data_block_for_cg(&group, 0).map_err(failed)?;
    let mut record = Vec::new();
    let rows = selection.each(|row, readings| {
        record.clear();
        record.push(DecodedValue::Float(seconds_since(selection.start, row.at.0)));
        let numbers = [
            row.tick.0,
            u64::from(row.step.0),
            u64::from(row.workingstep.0),
            u64::from(row.tool.0),
            u64::from(row.phase as u8),
            u64::from(row.quality as u8),
        ];
        record.extend(numbers.map(DecodedValue::UnsignedInteger));
        record.extend(readings.iter().map(|x| DecodedValue::Float(x.unwrap_or(f64::NAN))));
        file.write_record(&group, &record).map_err(failed)
    })?;
    file.finish_data_block(&group).map_err(failed)?;
    Ok(rows)
}

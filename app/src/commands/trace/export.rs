//! `toolmark trace export`: a job's samples and events for other programs.

use super::{Found, find, mdf, observations, open, seconds_since};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::progress::Progress;
use crate::{clock, say, shop};
use ledger::{Event, Hash};
use serde_json::{Map, Value, json};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use store::record::{Column, Reader, Row, extract};
use store::{CatalogueRow, Job, WholeFile};
use units::Timestamp;

/// What is asked for.
pub struct Wanted<'a> {
    /// Where to.
    pub out: &'a Path,
    /// From this time on, as it was typed.
    pub from: Option<&'a str>,
    /// Before this time, as it was typed.
    pub to: Option<&'a str>,
    /// These channels; all when empty.
    pub channels: &'a [String],
}

/// What was written.
#[derive(Default)]
pub struct Written {
    /// Rows.
    pub rows: u64,
    /// Events.
    pub events: u64,
    /// Files, the one that was asked for first.
    pub files: Vec<PathBuf>,
    /// The hash, where the bytes are those of the record.
    pub hash: Option<Hash>,
}

/// The samples that are written.
pub struct Selection<'a> {
    /// The records of the job, in order.
    pub readers: &'a [Reader],
    /// The chosen channels.
    pub columns: &'a [Column],
    /// The chosen time, microseconds UTC.
    pub span: Range<i64>,
    /// Start of the job.
    pub start: Timestamp,
}

/// Runs the command.
///
/// # Errors
/// There is no such job, channel or time, a record is damaged, or the file cannot be written.
pub fn export(root: &Path, job: &str, wanted: &Wanted<'_>, common: &Common) -> Done {
    let ending = wanted.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if !["csv", "json", "jsonl", "parquet", "mf4"].contains(&ending) {
        return Err(Failure::usage(format_args!(
            "--out {}: the ending says what is written: .csv, .json, .jsonl, .parquet or .mf4 was expected",
            wanted.out.display()
        )));
    }
    let directory = shop::read_data(root)?;
    let found = &mut find(&directory, job)?;
    if found.readable().next().is_none() {
        let why = found.gone.values().next();
        let why = why.map_or("it was interrupted, or nothing moved", String::as_str);
        return Err(Failure::usage(format_args!(
            "job {} has no rows that could be exported: {why}",
            found.job.id
        )));
    }
    let mut done = Written::default();
    if found.recorded.is_some() {
        let span = span_of(wanted, found.job.start)?;
        observations::export(&directory, found, wanted, span, &mut done)?;
        return answer(&done, &found.job, None, common);
    }
    let readers = found.readable().map(open).collect::<Result<Vec<_>, Failure>>()?;
    let all = columns_of(&readers);
    let columns = chosen(&all, wanted.channels)?;
    let span = span_of(wanted, found.job.start)?;
    let whole = wanted.channels.is_empty() && wanted.from.is_none() && wanted.to.is_none();
    let selection = Selection {
        readers: &readers,
        columns: &columns,
        span,
        start: found.job.start,
    };
    match ending {
        "csv" => csv(&selection, wanted.out, &mut done)?,
        "json" | "jsonl" => json_objects(&selection, found, wanted.out, &mut done)?,
        "mf4" => done.rows = mdf::write(&selection, wanted.out)?,
        _ => parquet(&selection, found, whole, wanted.out, &mut done)?,
    }
    done.files.insert(0, wanted.out.to_owned());
    if ["csv", "mf4"].contains(&ending) {
        let beside = wanted.out.with_extension("events.csv");
        done.events = events_csv(&selection, &found.events, &beside)?;
        done.files.push(beside);
    }
    if let Some(values) = directory.values_of(found.job.id).map_err(shop::failure)? {
        let beside = wanted.out.with_extension("functions.csv");
        functions_csv(&values, &beside)?;
        done.files.push(beside);
    }
    answer(&done, &found.job, Some(&columns), common)
}

/// The values that functions of the program recorded, one a line.
fn functions_csv(values: &Path, beside: &Path) -> Result<(), Failure> {
    use std::fmt::Write as _;
    let quoted = |text: &str| match text.contains([',', '"', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    };
    let mut text = "tick,run,recording,stream,unit,value,quality,step,workingstep,tool\n".to_owned();
    store::functions::read(values, &mut |row| {
        let value = row.value.map_or_else(String::new, |v| v.to_string());
        let _ = writeln!(
            text,
            "{},{},{},{},{},{value},{},{},{},{}",
            row.tick,
            row.run,
            quoted(&row.recording),
            quoted(&row.stream),
            quoted(&row.unit),
            quoted(&row.quality),
            row.step,
            row.workingstep,
            row.tool
        );
    })
    .map_err(shop::failure)?;
    crate::files::write(beside, text.as_bytes())
}

/// What was written, for the person. Observations have no channels.
fn answer(done: &Written, job: &Job, columns: Option<&[Column]>, common: &Common) -> Done {
    if done.rows == 0 {
        shop::notice("no sample lies in the time that was asked for; the file holds its head only");
    }
    if common.json {
        print_json(&json!({
            "job": job.id.0,
            "files": done.files,
            "rows": done.rows,
            "events": done.events,
            "channels": columns.unwrap_or_default().iter().map(|c| &c.name).collect::<Vec<_>>(),
            "sha256": done.hash.map(|h| h.to_string()),
        }))?;
    } else {
        let files: Vec<String> = done.files.iter().map(|f| f.display().to_string()).collect();
        let of = columns.map_or("observations".to_owned(), |columns| {
            format!("rows of {} channels", columns.len())
        });
        say(&format!(
            "job {}: {} {of} and {} events to {}",
            job.id,
            done.rows,
            done.events,
            files.join(", ")
        ));
        if let Some(hash) = done.hash {
            say(&format!("the same bytes as the record, SHA-256 {hash}"));
        }
    }
    Ok(Exit::Good)
}

fn columns_of(readers: &[Reader]) -> Vec<Column> {
    let mut all: Vec<Column> = Vec::new();
    for column in readers.iter().flat_map(Reader::columns) {
        if !all.iter().any(|c| c.name == column.name) {
            all.push(column.clone());
        }
    }
    all
}

/// The channels that are asked for, by name or by beginning (`X.*`), in the order of the record.
fn chosen(all: &[Column], wanted: &[String]) -> Result<Vec<Column>, Failure> {
    if wanted.is_empty() {
        return Ok(all.to_vec());
    }
    let matches = |column: &Column, pattern: &str| match pattern.strip_suffix('*') {
        Some(beginning) => column.name.starts_with(beginning),
        None => column.name == pattern,
    };
    for pattern in wanted {
        if !all.iter().any(|c| matches(c, pattern.trim())) {
            let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
            return Err(Failure::usage(format_args!(
                "--channels {pattern}: the record has no such channel; it has {}",
                names.join(", ")
            )));
        }
    }
    let is_wanted = |c: &&Column| wanted.iter().any(|pattern| matches(c, pattern.trim()));
    Ok(all.iter().filter(is_wanted).cloned().collect())
}

fn span_of(wanted: &Wanted<'_>, start: Timestamp) -> Result<Range<i64>, Failure> {
    let time = |option: &str, text: &str| -> Result<i64, Failure> {
        if let Some(at) = clock::parse(text) {
            return Ok(at.micros());
        }
        match text.parse::<f64>() {
            // A year is more than any job takes, and far from where a count of microseconds ends.
            Ok(seconds) if seconds.abs() < 31_557_600.0 => Ok(start.micros() + (seconds * 1e6).round() as i64),
            _ => Err(Failure::usage(format_args!(
                "{option} {text}: seconds since the job's start, like 12.5, or a time like 2026-11-21T08:30:00Z were expected"
            ))),
        }
    };
    let from = wanted.from.map(|text| time("--from", text)).transpose()?.unwrap_or(i64::MIN);
    let to = wanted.to.map(|text| time("--to", text)).transpose()?.unwrap_or(i64::MAX);
    if from >= to {
        return Err(Failure::usage("--from lies at or behind --to: nothing is between them"));
    }
    Ok(from..to)
}

impl Selection<'_> {
    /// Gives every chosen row with its readings, in the order of the columns.
    pub fn each(&self, mut take: impl FnMut(&Row, &[Option<f64>]) -> Result<(), Failure>) -> Result<u64, Failure> {
        let mut progress = Progress::new("export");
        let mut count = 0;
        for reader in self.readers {
            for batch in reader.batches().map_err(shop::failure)? {
                let batch = batch.map_err(shop::failure)?;
                let rows = batch.rows();
                let mut columns: Vec<_> = self.columns.iter().map(|c| batch.values(&c.name)).collect();
                let mut readings = vec![None; columns.len()];
                for row in &rows {
                    for (reading, values) in readings.iter_mut().zip(&mut columns) {
                        *reading = values.as_mut().and_then(|v| v.next().flatten());
                    }
                    if self.span.contains(&row.at.micros()) {
                        take(row, &readings)?;
                        count += 1;
                    }
                }
                progress.at(|| format!("{count} rows"));
            }
        }
        Ok(count)
    }

    /// The events in the chosen time.
    fn events<'e>(&self, all: &'e [Event]) -> impl Iterator<Item = &'e Event> + use<'e> {
        let span = self.span.clone();
        all.iter().filter(move |event| span.contains(&event.at().micros()))
    }
}

pub(super) fn create(path: &Path) -> Result<BufWriter<WholeFile>, Failure> {
    Ok(BufWriter::new(WholeFile::create(path).map_err(shop::failure)?))
}

pub(super) fn finish(file: BufWriter<WholeFile>, path: &Path) -> Result<(), Failure> {
    let whole = file.into_inner().map_err(|e| Failure::writing(path, e.error()))?;
    whole.finish().map(|_| ()).map_err(shop::failure)
}

/// The columns before the channels; `t_s` counts from the job's start.
const HEAD: &str = "ts,t_s,tick,step,workingstep,tool,phase,quality";

fn csv(selection: &Selection<'_>, path: &Path, done: &mut Written) -> Result<(), Failure> {
    let mut file = create(path)?;
    let failed = |e: std::io::Error| Failure::writing(path, e);
    write!(file, "{HEAD}").map_err(failed)?;
    for column in selection.columns {
        write!(file, ",{}", quoted(&format!("{} [{}]", column.name, column.unit))).map_err(failed)?;
    }
    writeln!(file).map_err(failed)?;
    done.rows = selection.each(|row, readings| {
        let mut line = format!(
            "{},{},{},{},{},{},{:?},{:?}",
            clock::utc(row.at),
            seconds_since(selection.start, row.at.0),
            row.tick.0,
            row.step.0,
            row.workingstep.0,
            row.tool.0,
            row.phase,
            row.quality
        );
        for reading in readings {
            line.push(',');
            // The shortest text that reads back to the same double; nothing where the reading was not available.
            if let Some(x) = reading {
                line += &x.to_string();
            }
        }
        writeln!(file, "{line}").map_err(failed)
    })?;
    finish(file, path)
}

pub(super) fn events_csv(selection: &Selection<'_>, all: &[Event], path: &Path) -> Result<u64, Failure> {
    let mut file = create(path)?;
    let failed = |e: std::io::Error| Failure::writing(path, e);
    let mut count = 0;
    writeln!(file, "ts,t_s,sequence,kind,detail,sha256").map_err(failed)?;
    for event in selection.events(all) {
        let detail = serde_json::to_string(&event.detail).expect("a map with text keys is always JSON");
        let line = format!(
            "{},{},{},{},{},{}",
            clock::utc(event.at()),
            seconds_since(selection.start, event.at_ns),
            event.sequence,
            quoted(&event.kind),
            quoted(&detail),
            event.hash
        );
        writeln!(file, "{line}").map_err(failed)?;
        count += 1;
    }
    finish(file, path)?;
    Ok(count)
}

/// A text as a cell of a CSV file (RFC 4180).
pub(super) fn quoted(text: &str) -> String {
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// JSON objects, each on a line of its own: as they are, or as the elements of one array.
pub(super) struct Objects<'a> {
    file: BufWriter<WholeFile>,
    path: &'a Path,
    is_array: bool,
    before: &'static str,
}

impl<'a> Objects<'a> {
    /// An array where the file's ending is `.json`.
    pub(super) fn create(path: &'a Path) -> Result<Objects<'a>, Failure> {
        let is_array = path.extension().is_some_and(|e| e == "json");
        Ok(Objects {
            file: create(path)?,
            path,
            is_array,
            before: if is_array { "[\n" } else { "" },
        })
    }

    pub(super) fn put(&mut self, object: &Value) -> Result<(), Failure> {
        let before = std::mem::replace(&mut self.before, if self.is_array { ",\n" } else { "\n" });
        write!(self.file, "{before}{object}").map_err(|e| Failure::writing(self.path, e))
    }

    pub(super) fn finish(mut self) -> Result<(), Failure> {
        let end = match (self.is_array, self.before) {
            (true, "[\n") => "[]\n",
            (true, _) => "\n]\n",
            (false, "") => "",
            (false, _) => "\n",
        };
        write!(self.file, "{end}").map_err(|e| Failure::writing(self.path, e))?;
        finish(self.file, self.path)
    }
}

fn json_objects(selection: &Selection<'_>, found: &Found, path: &Path, done: &mut Written) -> Result<(), Failure> {
    let mut file = Objects::create(path)?;
    let channels: Vec<Value> = selection
        .columns
        .iter()
        .map(|c| json!({ "name": c.name, "unit": c.unit }))
        .collect();
    let header = selection.readers[0].header();
    let head = json!({ "record": {
        "job": found.job.id.0,
        "program": found.job.program,
        "program_sha256": found.job.program_hash.to_string(),
        "machine": header.machine,
        "simulated": header.simulated,
        "seed": header.seed,
        "start": clock::utc(found.job.start),
        "frame": "machine",
        "records_sha256": found.records.iter().map(|r| r.hash.to_string()).collect::<Vec<_>>(),
        "channels": channels,
    }});
    file.put(&head)?;
    let mut events = selection.events(&found.events).peekable();
    let mut count = 0;
    done.rows = selection.each(|row, readings| {
        while let Some(event) = events.next_if(|event| event.at_ns <= row.at.0) {
            file.put(&json!({ "event": event }))?;
            count += 1;
        }
        let readings: Map<String, Value> = selection
            .columns
            .iter()
            .zip(readings)
            .map(|(c, x)| (c.name.clone(), x.map_or(Value::Null, Value::from)))
            .collect();
        let sample = json!({ "sample": {
            "ts": clock::utc(row.at),
            "t_s": seconds_since(selection.start, row.at.0),
            "tick": row.tick.0,
            "step": row.step.0,
            "workingstep": row.workingstep.0,
            "tool": row.tool.0,
            "phase": format!("{:?}", row.phase),
            "quality": format!("{:?}", row.quality),
            "readings": readings,
        }});
        file.put(&sample)
    })?;
    for event in events {
        file.put(&json!({ "event": event }))?;
        count += 1;
    }
    done.events = count;
    file.finish()
}

fn parquet(selection: &Selection<'_>, found: &Found, whole: bool, path: &Path, done: &mut Written) -> Result<(), Failure> {
    let rows: Vec<&CatalogueRow> = found.readable().collect();
    let ([reader], [row]) = (selection.readers, &rows[..]) else {
        return Err(Failure::usage(format_args!(
            "job {} has {} records, which are Parquet files already; copy them from where toolmark trace show says they are, or \
             export .csv, .json, .jsonl or .mf4, which hold them in one file",
            found.job.id,
            rows.len()
        )));
    };
    done.events = found.events.len() as u64;
    if !whole {
        let names: Vec<&str> = selection.columns.iter().map(|c| c.name.as_str()).collect();
        done.rows = extract(reader, &names, selection.span.clone(), path)
            .map_err(shop::failure)?
            .rows;
        return Ok(());
    }
    copy(row, path, done)
}

/// The record itself, byte for byte.
pub(super) fn copy(row: &CatalogueRow, path: &Path, done: &mut Written) -> Result<(), Failure> {
    let mut from = File::open(&row.path).map_err(|e| Failure::unreadable(format_args!("{}: {e}", row.path.display())))?;
    let mut to = WholeFile::create(path).map_err(shop::failure)?;
    std::io::copy(&mut from, &mut to).map_err(|e| Failure::writing(path, e))?;
    let (_, hash) = to.finish().map_err(shop::failure)?;
    if hash != row.hash {
        return Err(Failure::unreadable(format_args!(
            "{}: it was changed while it was read: toolmark trace verify",
            row.path.display()
        )));
    }
    (done.rows, done.hash) = (row.rows, Some(hash));
    Ok(())
}

//! What an agent told, in the words of `toolmark trace`: numbers of each data item, and exports.

use super::Found;
use super::export::{self, Selection, Wanted, Written};
use super::list::brief;
use super::show::{events, head, short};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::progress::Progress;
use crate::{clock, say, shop};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::ops::Range;
use std::path::Path;
use store::observations::{GAP, Row, rows};
use store::{CatalogueRow, DataDirectory, Log, Recorded, Table};

/// Numbers of a data item.
#[derive(Clone, Debug, Default, Serialize)]
struct Item {
    device: String,
    data_item: String,
    name: String,
    #[serde(rename = "type")]
    kind: String,
    sub_type: String,
    category: String,
    count: u64,
    unavailable: u64,
    /// Values that are a number.
    numbers: u64,
    min: Option<f64>,
    max: Option<f64>,
    mean: Option<f64>,
    #[serde(skip)]
    sum: f64,
}

/// Shows a recording.
///
/// # Errors
/// A record of it is damaged.
pub fn show(root: &Path, directory: &DataDirectory, found: &Found, of: &Recorded, all_events: bool, common: &Common) -> Done {
    let told = told_of(directory, found)?;
    let (mut items, mut gaps) = (BTreeMap::<[String; 2], Item>::new(), Vec::new());
    each(found, "show", |row| {
        if row.texts[9] == GAP {
            gaps.push(gap_json(row));
        } else {
            let key = [row.texts[0].to_string(), row.texts[5].to_string()];
            items.entry(key).or_default().add(row);
        }
        Ok(())
    })?;
    if common.json {
        let mut answer = brief(root, found);
        answer["source"] = json!(of.source);
        answer["path"] = json!(of.items);
        answer["events"] = serde_json::to_value(&told.events).expect("events are always JSON");
        answer["gaps"] = Value::from(gaps);
        answer["data_items"] =
            serde_json::to_value(items.values().collect::<Vec<_>>()).expect("texts and numbers are always JSON");
        answer["roll_up"] = Value::Null;
        print_json(&answer)?;
        return Ok(Exit::Good);
    }
    head(root, found);
    if !of.items.is_empty() {
        say(&format!("  data items {}", of.items));
    }
    say("  no roll-up: observations come when something changes, not at even distances");
    say(&format!(
        "  {:16} {:24} {:24} {:>9} {:>9} {:>10} {:>10} {:>10}",
        "device", "data item", "type", "count", "unavail.", "min", "max", "mean"
    ));
    for item in items.values() {
        let name = if item.name.is_empty() { &item.data_item } else { &item.name };
        say(&format!(
            "  {:16} {:24} {:24} {:>9} {:>9} {:>10} {:>10} {:>10}",
            item.device,
            name,
            item.kind,
            item.count,
            item.unavailable,
            short(item.min),
            short(item.max),
            short(item.mean)
        ));
    }
    for gap in &gaps {
        let to = gap["to_sequence"].as_u64().map_or("unknown".to_owned(), |to| to.to_string());
        say(&format!(
            "gap: sequence {} to {to} of instance {} could not be had ({})",
            gap["from_sequence"],
            gap["instance_id"],
            gap["cause"].as_str().unwrap_or_default()
        ));
    }
    events(&told, all_events);
    Ok(Exit::Good)
}

/// The job with the events of the directory's log that tell of it.
fn told_of(directory: &DataDirectory, found: &Found) -> Result<Found, Failure> {
    let mut told = Vec::new();
    let mut from = 1;
    loop {
        let more = directory.events(Log::Directory, from, 1000).map_err(shop::failure)?;
        let Some(last) = more.last() else { break };
        from = last.sequence + 1;
        let of_job = |event: &ledger::Event| event.detail.get("job").and_then(Value::as_i64) == Some(found.job.id.0);
        told.extend(more.into_iter().filter(of_job));
    }
    Ok(Found {
        job: found.job.clone(),
        events: told,
        records: found.records.clone(),
        gone: found.gone.clone(),
        hold: found.hold.clone(),
        verdict: None,
        recorded: found.recorded.clone(),
    })
}

/// Gives every row of a recording, in the order of the agent's numbers.
fn each(found: &Found, doing: &'static str, mut take: impl FnMut(&Row<'_>) -> Result<(), Failure>) -> Result<(), Failure> {
    let (mut progress, mut count) = (Progress::new(doing), 0);
    for record in found.readable() {
        let table = open(record)?;
        for batch in table.batches().map_err(shop::failure)? {
            let batch = batch.map_err(shop::failure)?;
            let rows = rows(&batch).map_err(|what| Failure::unreadable(format_args!("{}: {what}", record.path.display())))?;
            count += rows.len();
            rows.iter().try_for_each(&mut take)?;
            progress.at(|| format!("{count} rows"));
        }
    }
    Ok(())
}

fn open(row: &CatalogueRow) -> Result<Table, Failure> {
    let table = Table::open(&row.path).map_err(shop::failure)?;
    if table.hash().map_err(shop::failure)? != row.hash {
        return Err(super::changed(row));
    }
    Ok(table)
}

impl Item {
    fn add(&mut self, row: &Row<'_>) {
        if self.count + self.unavailable == 0 {
            let text = |k: usize| row.texts[k].to_string();
            (self.device, self.data_item, self.name) = (text(0), text(5), text(6));
            (self.kind, self.sub_type, self.category) = (text(7), text(8), text(9));
        }
        let Some(text) = &row.text else {
            self.unavailable += 1;
            return;
        };
        self.count += 1;
        if let Some(x) = text.parse::<f64>().ok().filter(|x| x.is_finite()) {
            self.numbers += 1;
            self.sum += x;
            self.min = Some(self.min.map_or(x, |m| m.min(x)));
            self.max = Some(self.max.map_or(x, |m| m.max(x)));
            self.mean = Some(self.sum / self.numbers as f64);
        }
    }
}

fn gap_json(row: &Row<'_>) -> Value {
    let said: Value = row
        .text
        .as_deref()
        .and_then(|t| serde_json::from_str(t).ok())
        .unwrap_or_default();
    json!({
        "instance_id": row.instance,
        "from_sequence": row.sequence,
        "to_sequence": said["to_sequence"],
        "cause": row.texts[7],
        "from": said["from"],
        "to": said["to"],
    })
}

/// The columns of an export.
const HEAD: &str = "ts,sequence,instance,device,device_uuid,component,component_name,component_id,data_item,name,type,sub_type,category,\
                    text,condition,attributes";

/// Writes a recording to a file.
///
/// # Errors
/// A record of it is damaged, the ending is none for observations, or the file cannot be written.
pub fn export(
    directory: &DataDirectory,
    found: &mut Found,
    wanted: &Wanted<'_>,
    span: Range<i64>,
    done: &mut Written,
) -> Result<(), Failure> {
    *found = told_of(directory, found)?;
    done.files.push(wanted.out.to_owned());
    let ending = wanted.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    match ending {
        "parquet" => return parquet(found, wanted, done),
        "mf4" => {
            return Err(Failure::usage(
                "a recording of observations has no rows at even distances, which MDF 4 wants: export .csv, .json, .jsonl or .parquet",
            ));
        }
        _ => {}
    }
    if ending == "csv" {
        return csv(found, wanted, span, done);
    }
    let mut file = export::Objects::create(wanted.out)?;
    done.rows = each_wanted(found, wanted, &span, |row| file.put(&json_line(row)))?;
    for event in found.events.iter().filter(|event| span.contains(&event.at().micros())) {
        file.put(&json!({ "event": event }))?;
        done.events += 1;
    }
    file.finish()
}

/// Gives every observation that is asked for.
fn each_wanted(
    found: &Found,
    wanted: &Wanted<'_>,
    span: &Range<i64>,
    mut take: impl FnMut(&Row<'_>) -> Result<(), Failure>,
) -> Result<u64, Failure> {
    let mut count = 0;
    each(found, "export", |row| {
        if span.contains(&row.at.micros()) && is_wanted(row, wanted.channels) {
            count += 1;
            take(row)?;
        }
        Ok(())
    })?;
    Ok(count)
}

fn csv(found: &Found, wanted: &Wanted<'_>, span: Range<i64>, done: &mut Written) -> Result<(), Failure> {
    let mut file = export::create(wanted.out)?;
    let failed = |e: std::io::Error| Failure::writing(wanted.out, e);
    writeln!(file, "{HEAD}").map_err(failed)?;
    done.rows = each_wanted(found, wanted, &span, |row| {
        writeln!(file, "{}", csv_line(row)).map_err(failed)
    })?;
    export::finish(file, wanted.out)?;
    let beside = wanted.out.with_extension("events.csv");
    let selection = Selection {
        readers: &[],
        columns: &[],
        span,
        start: found.job.start,
    };
    done.events = export::events_csv(&selection, &found.events, &beside)?;
    done.files.push(beside);
    Ok(())
}

fn parquet(found: &Found, wanted: &Wanted<'_>, done: &mut Written) -> Result<(), Failure> {
    let rows: Vec<&CatalogueRow> = found.readable().collect();
    let whole = wanted.channels.is_empty() && wanted.from.is_none() && wanted.to.is_none();
    match &rows[..] {
        [row] if whole => {
            done.events = 0;
            export::copy(row, wanted.out, done)
        }
        _ => Err(Failure::usage(format_args!(
            "job {} has {} records of observations, which are Parquet files already; copy them from where toolmark trace show says \
             they are, or export .csv, .json or .jsonl, which hold them, or a choice of them, in one file",
            found.job.id,
            rows.len()
        ))),
    }
}

/// By data item, its name or its type, or the beginning of one of them; gaps always.
fn is_wanted(row: &Row<'_>, channels: &[String]) -> bool {
    let is = |pattern: &str| {
        [5, 6, 7].iter().any(|k| match pattern.strip_suffix('*') {
            Some(beginning) => row.texts[*k].starts_with(beginning),
            None => row.texts[*k] == pattern,
        })
    };
    channels.is_empty() || row.texts[9] == GAP || channels.iter().any(|pattern| is(pattern.trim()))
}

fn csv_line(row: &Row<'_>) -> String {
    let mut cells = vec![clock::utc(row.at), row.sequence.to_string(), row.instance.to_string()];
    cells.extend(row.texts.iter().map(|text| export::quoted(text)));
    // An empty cell is UNAVAILABLE where the category is not CONDITION.
    cells.extend([&row.text, &row.condition, &row.attributes].map(|text| export::quoted(text.as_deref().unwrap_or_default())));
    cells.join(",")
}

fn json_line(row: &Row<'_>) -> Value {
    if row.texts[9] == GAP {
        return json!({ "gap": gap_json(row) });
    }
    let names = [
        "device",
        "device_uuid",
        "component",
        "component_name",
        "component_id",
        "data_item",
        "name",
        "type",
        "sub_type",
        "category",
    ];
    let mut observation = json!({
        "ts": clock::utc(row.at),
        "sequence": row.sequence,
        "instance": row.instance,
        "text": row.text,
        "condition": row.condition,
        "attributes": row.attributes,
    });
    for (name, text) in names.iter().zip(&row.texts) {
        observation[*name] = json!(text);
    }
    json!({ "observation": observation })
}

//! `toolmark trace show`: one job.

use super::list::brief;
use super::statistics::{self, Statistics};
use super::{Found, find, observations, open, seconds_since, shown};
use crate::cli::Common;
use crate::commands::backup::size;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::survey::minutes;
use crate::{clock, functions, say, shop};
use ledger::Event;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Events that are shown without `--events`.
const LAST_EVENTS: usize = 20;

/// Runs the command.
///
/// # Errors
/// There is no such job, or a record of it is damaged.
pub fn show(root: &Path, job: &str, all_events: bool, common: &Common) -> Done {
    let directory = shop::read_data(root)?;
    let found = find(&directory, job)?;
    if let Some(of) = &found.recorded {
        return observations::show(root, &directory, &found, of, all_events, common);
    }
    let readers = found.readable().map(open).collect::<Result<Vec<_>, Failure>>()?;
    let ends = found.readable().filter_map(|r| r.span_us);
    let span = ends.reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
    let numbers = match span {
        Some(span) => statistics::of(&readers, span)?,
        None => Statistics::default(),
    };
    let names = workingstep_names(&found.events);
    if common.json {
        let mut answer = brief(root, &found);
        answer["events"] = serde_json::to_value(&found.events).expect("events are always JSON");
        answer["gaps"] = gaps(&numbers);
        answer["function_records"] =
            serde_json::to_value(functions::told(&found.events)).expect("texts and numbers are always JSON");
        let values = directory.values_of(found.job.id).map_err(shop::failure)?;
        answer["function_values"] = json!(values);
        answer["channels"] = serde_json::to_value(&numbers.channels).expect("texts and numbers are always JSON");
        answer["workingsteps"] = workingsteps(&found, &numbers, &names);
        print_json(&answer)?;
    } else {
        head(root, &found);
        table(&numbers);
        by_workingstep(&found, &numbers, &names);
        for gap in &numbers.missing {
            say(&format!(
                "gap: {} rows are missing from {:.3} to {:.3} s",
                gap.rows,
                seconds_since(found.job.start, gap.from_ns),
                seconds_since(found.job.start, gap.to_ns)
            ));
        }
        let told = functions::told(&found.events);
        if !told.is_empty() {
            say(&format!("  {} records of functions", told.len()));
            functions::print(&told);
        }
        if let Some(values) = directory.values_of(found.job.id).map_err(shop::failure)? {
            say(&format!("  values of functions {}", shown(root, &values)));
        }
        events(&found, all_events);
    }
    Ok(Exit::Good)
}

pub(super) fn head(root: &Path, found: &Found) {
    let job = &found.job;
    say(&format!(
        "job {}: {} on {}, {} ({}), {}, verdict {}",
        job.id,
        job.program,
        job.machine,
        clock::local(job.start),
        minutes(found.duration()),
        job.state.word(),
        found.verdict.as_deref().unwrap_or("-")
    ));
    say(&format!("  program SHA-256 {}, seed {}", job.program_hash, job.seed));
    say(&format!("  files {}", shown(root, &job.folder)));
    for row in &found.records {
        say(&format!(
            "  record {}: {} rows, {}, SHA-256 {}",
            shown(root, &row.path),
            row.rows,
            size(row.bytes),
            row.hash
        ));
    }
    for row in &found.records {
        if let Some(why) = found.gone.get(&row.sequence) {
            say(&format!("  its rows are gone: {why} (catalogue row {})", row.sequence));
        }
    }
    if let Some(hold) = &found.hold {
        say(&format!(
            "  on hold since {} by {}: {}",
            clock::local(hold.at),
            hold.who,
            hold.why
        ));
    }
    if found.records.is_empty() {
        say("  no record is in the catalogue");
    }
}

fn table(numbers: &Statistics) {
    if numbers.channels.is_empty() {
        return;
    }
    say(&format!(
        "  {:26} {:>10} {:>10} {:>10} {:>10}  {:50} unit",
        "channel", "min", "max", "mean", "rms", "course"
    ));
    for channel in &numbers.channels {
        let n = &channel.all;
        say(&format!(
            "  {:26} {:>10} {:>10} {:>10} {:>10}  {:50} {}{}",
            channel.name,
            short(n.min),
            short(n.max),
            short(n.mean),
            short(n.rms),
            statistics::line(&channel.course),
            channel.unit,
            if n.unavailable > 0 {
                format!(", {} readings unavailable", n.unavailable)
            } else {
                String::new()
            }
        ));
    }
}

fn by_workingstep(found: &Found, numbers: &Statistics, names: &BTreeMap<u32, String>) {
    let loads: Vec<_> = numbers.channels.iter().filter(|c| c.name.ends_with(".LOAD")).collect();
    if numbers.workingsteps.is_empty() {
        return;
    }
    let heads: String = loads.iter().map(|c| format!(" {:>16}", format!("{} max", c.name))).collect();
    say(&format!(
        "  {:>4} {:24} {:>9} {:>9} {:>9}{heads}",
        "no", "workingstep", "from s", "to s", "rows"
    ));
    for (number, (first, last, rows)) in &numbers.workingsteps {
        let name = match number {
            0 => "(outside of any)",
            n => names.get(n).map_or("", String::as_str),
        };
        let cells: String = loads
            .iter()
            .map(|c| format!(" {:>16}", short(c.workingsteps.get(number).and_then(|n| n.max))))
            .collect();
        say(&format!(
            "  {number:>4} {name:24} {:>9.3} {:>9.3} {rows:>9}{cells}",
            seconds_since(found.job.start, *first),
            seconds_since(found.job.start, *last)
        ));
    }
}

pub(super) fn events(found: &Found, all: bool) {
    let skipped = if all {
        0
    } else {
        found.events.len().saturating_sub(LAST_EVENTS)
    };
    say(&format!("  {} events", found.events.len()));
    if skipped > 0 {
        say(&format!("  ... {skipped} earlier ones: --events shows all"));
    }
    for event in &found.events[skipped..] {
        let detail: Vec<String> = event.detail.iter().map(|(k, v)| format!("{k} {}", plain(v))).collect();
        say(&format!(
            "  {:>9.3} s  {:18} {}",
            seconds_since(found.job.start, event.at_ns),
            event.kind,
            detail.join(", ")
        ));
    }
}

/// A text without its quotes, anything else as JSON.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Three digits behind the point, and more where the number is small.
pub(super) fn short(number: Option<f64>) -> String {
    match number {
        None => "-".to_owned(),
        Some(x) if x != 0.0 && x.abs() < 0.01 => format!("{x:.2e}"),
        Some(x) => format!("{x:.3}"),
    }
}

fn gaps(numbers: &Statistics) -> Value {
    let all = numbers.missing.iter();
    all.map(|g| json!({ "from": clock::utc(units::Timestamp(g.from_ns)), "to": clock::utc(units::Timestamp(g.to_ns)), "rows": g.rows }))
        .collect()
}

fn workingsteps(found: &Found, numbers: &Statistics, names: &BTreeMap<u32, String>) -> Value {
    let all = numbers.workingsteps.iter();
    all.map(|(number, (first, last, rows))| {
        json!({
            "number": number,
            "name": names.get(number),
            "from_s": seconds_since(found.job.start, *first),
            "to_s": seconds_since(found.job.start, *last),
            "rows": rows,
        })
    })
    .collect()
}

/// Names of the workingsteps in the order of their numbers, as the job's events tell them.
fn workingstep_names(events: &[Event]) -> BTreeMap<u32, String> {
    let told = events.iter().filter_map(|event| {
        let number = event.detail.get("workingstep")?.as_u64()?;
        let name = event.detail.get("name")?.as_str()?;
        Some((u32::try_from(number).ok(), name.to_owned()))
    });
    told.filter_map(|(number, name)| Some((number?, name))).collect()
}

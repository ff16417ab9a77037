//! `toolmark size history`: every entry, refusal, undo and new tool, and changes of the offsets that were made past sizing.

use super::args::HistoryArgs;
use super::{Bench, shown_in};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::Exit;
use crate::{clock, say, shop};
use ledger::Event;
use serde_json::{Value, json};
use sizing::Dimension;
use sizing::history::{Row, What};
use std::collections::{BTreeMap, BTreeSet};
use units::Millimetres;

/// Runs the command.
pub(super) fn history(args: &HistoryArgs, common: &Common) -> Done {
    let directory = shop::data_directory(common)?;
    let bench = Bench::open(&directory, common)?;
    let only = args.dimension.as_deref().map(|name| bench.dimension(name)).transpose()?;
    let wanted = |d: &&Dimension| only.is_none_or(|o| o.name == d.name);
    let dimensions: Vec<&Dimension> = bench.job.dimensions.iter().filter(wanted).collect();

    let ours: BTreeSet<u64> = directory
        .sizes(bench.kept.id)
        .map_err(shop::failure)?
        .iter()
        .filter_map(|e| e.detail.get("change").and_then(Value::as_u64))
        .collect();
    let mut lines: BTreeMap<u64, (Value, String)> = BTreeMap::new();
    for row in bench
        .history
        .iter()
        .filter(|r| dimensions.iter().any(|d| d.name == r.dimension))
    {
        let dimension = bench.dimension(&row.dimension)?;
        let value = serde_json::to_value(row).expect("a row is JSON");
        lines.insert(row.entry, (value, words(row, &shown_in(dimension, common))));
    }
    for dimension in dimensions {
        let changes = directory
            .changes_of(&dimension.register, bench.kept.id)
            .map_err(shop::failure)?;
        for event in changes.iter().filter(|e| !ours.contains(&e.sequence)) {
            lines.insert(event.sequence, past_sizing(event, &shown_in(dimension, common)));
        }
    }
    if common.json {
        let rows: Vec<Value> = lines.into_values().map(|(value, _)| value).collect();
        print_json(&json!({ "job": bench.kept.id, "name": bench.job.name, "history": rows }))?;
    } else if lines.is_empty() {
        say("nothing was entered yet: toolmark size enter --dimension NAME VALUE");
    } else {
        lines.into_values().for_each(|(_, line)| say(&line));
    }
    Ok(Exit::Good)
}

fn words(row: &Row, dimension: &Dimension) -> String {
    let length = |mm: Option<f64>| dimension.unit.words(Millimetres(mm.unwrap_or(0.0)));
    let typed = || {
        format!(
            "{} {}",
            row.typed.as_deref().unwrap_or_default(),
            row.unit.as_deref().unwrap_or_default()
        )
    };
    let moved = || format!("{} -> {}", length(row.before_mm), length(row.after_mm));
    let of = row.of.unwrap_or_default();
    let what = match row.what {
        What::Entered => format!("{}, offset {} {}", typed(), dimension.offset, moved()),
        What::Refused => format!("{} refused ({})", typed(), row.rule.as_deref().unwrap_or_default()),
        What::Undone => format!("entry {of} taken back, offset {} {}", dimension.offset, moved()),
        What::Opposed => format!("entry {of} answered by its opposite, offset {} {}", dimension.offset, moved()),
        What::AtControl => format!("offset {} {} found", dimension.offset, moved()),
        What::NewTool => format!("new tool, offset {} {}", dimension.offset, moved()),
    };
    let part = row.part.map_or(String::new(), |p| format!(" part {p}"));
    format!(
        "{:>5} {} {}{part}: {what}; {}: {}",
        row.entry,
        clock::utc(units::Timestamp(row.at_ns)),
        row.dimension,
        row.who,
        row.why
    )
}

/// Somebody changed the offset by another way than an entry of a size.
fn past_sizing(event: &Event, dimension: &Dimension) -> (Value, String) {
    let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default();
    let number = |name: &str| event.detail.get(name).and_then(Value::as_f64);
    let length = |mm: Option<f64>| dimension.unit.words(Millimetres(mm.unwrap_or(0.0)));
    // A program's line leaves its job behind; a person does not.
    let job = event.detail.get("job").and_then(Value::as_i64);
    let mut value = json!({
        "entry": event.sequence,
        "at_ns": event.at_ns,
        "what": if job.is_some() { "changed-by-program" } else { "changed-directly" },
        "dimension": dimension.name,
        "register": dimension.register,
        "who": text("who"),
        "why": text("why"),
        "before_mm": number("before"),
        "after_mm": number("after"),
    });
    if job.is_some() {
        for key in ["job", "file", "line"] {
            value[key] = event.detail.get(key).cloned().unwrap_or_default();
        }
    }
    let line = format!(
        "{:>5} {} {}: offset {} {} -> {} changed {}; {}: {}",
        event.sequence,
        clock::utc(event.at()),
        dimension.name,
        dimension.offset,
        length(number("before")),
        length(number("after")),
        if job.is_some() { "by program" } else { "directly" },
        text("who"),
        text("why")
    );
    (value, line)
}

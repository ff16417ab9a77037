//! `toolmark size list`: the sizes of the job in force, and how each stands.

use super::enter::{LAST, verdict_words};
use super::{Bench, number_in, shown_in, unit_name};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::Exit;
use crate::{say, shop};
use serde_json::{Value, json};
use sizing::history::{self, What};
use sizing::{Dimension, Verdict, trend};
use units::Millimetres;

/// Runs the command.
pub(super) fn list(common: &Common) -> Done {
    let directory = shop::data_directory(common)?;
    let bench = Bench::open(&directory, common)?;
    let mut answers = Vec::new();
    if !common.json {
        say(&format!(
            "job {} ({}) on {}",
            bench.job.name, bench.job.number, bench.kept.machine
        ));
    }
    for dimension in &bench.job.dimensions {
        let register = directory.value(&dimension.register).map_err(shop::failure)?;
        let sizes = history::sizes(dimension, &bench.history);
        let outlook = trend::outlook(dimension, &sizes, LAST, register.unwrap_or(0.0));
        let marks = trend::marks(dimension, &sizes);
        let last = bench.last(&dimension.name, What::Entered);
        let measured = last.and_then(|r| r.measured_mm);
        let verdict = measured.map(|m| judged(dimension, m));
        if common.json {
            let mut answer = declared(dimension);
            let more = json!({
                "value": number_in(dimension.unit, register.unwrap_or(0.0)),
                "last": measured.map(|m| number_in(dimension.unit, m)),
                "part": last.and_then(|r| r.part),
                "verdict": verdict.map(verdict_words),
                "outlook": outlook,
                "marks": marks.iter().map(|(entry, rule)| json!({ "entry": entry, "rule": rule })).collect::<Vec<_>>(),
            });
            if let (Value::Object(all), Value::Object(more)) = (&mut answer, more) {
                all.extend(more);
            }
            answers.push(answer);
            continue;
        }
        let shown = shown_in(dimension, common);
        let words = |mm: f64| shown.unit.words(Millimetres(mm));
        say(&format!("  {}", declared_words(&shown)));
        say(&format!(
            "    {} = {}; last {}",
            dimension.register,
            words(register.unwrap_or(0.0)),
            match (measured, verdict) {
                (Some(m), Some(v)) => format!("{} ({})", words(m), verdict_words(v)),
                _ => "never".to_owned(),
            }
        ));
        say(&format!("    {}", outlook.words(&shown)));
        for (entry, rule) in marks {
            say(&format!("    mark: entry {entry}, {}", rule.words()));
        }
    }
    if common.json {
        print_json(&json!({
            "job": bench.kept.id,
            "name": bench.job.name,
            "number": bench.job.number,
            "machine": bench.kept.machine,
            "dimensions": answers,
        }))?;
    }
    Ok(Exit::Good)
}

fn judged(dimension: &Dimension, mm: f64) -> Verdict {
    if mm < dimension.low.0 {
        Verdict::TooSmall
    } else if mm > dimension.high.0 {
        Verdict::TooLarge
    } else {
        Verdict::Good
    }
}

/// What a job declares of a dimension, for programs.
pub(super) fn declared(dimension: &Dimension) -> Value {
    let unit = dimension.unit;
    let number = |length: Millimetres| number_in(unit, length.0);
    json!({
        "dimension": dimension.name,
        "kind": dimension.kind.words(),
        "unit": unit_name(unit),
        "nominal": number(dimension.nominal),
        "low": number(dimension.low),
        "high": number(dimension.high),
        "target": number(dimension.target),
        "window": [number(dimension.window.0), number(dimension.window.1)],
        "largest_step": number(dimension.largest_step),
        "increment": number(dimension.increment),
        "tool": dimension.tool.0,
        "offset": dimension.offset,
        "register": dimension.register,
        "factor": dimension.response.size_per_register(),
        "role": dimension.role.words(),
        "every": dimension.every,
    })
}

/// The same, for people.
pub(super) fn declared_words(dimension: &Dimension) -> String {
    let words = |length| dimension.unit.words(length);
    format!(
        "{:12} {}, {} to {}, aim {}; entries above {} and below {}; {} by {} of offset {}, T{}",
        dimension.name,
        dimension.kind.words(),
        words(dimension.low),
        words(dimension.high),
        words(dimension.target),
        words(dimension.window.0),
        words(dimension.window.1),
        dimension.role.words(),
        dimension.column,
        dimension.offset,
        dimension.tool.0
    )
}

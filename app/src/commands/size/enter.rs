//! `toolmark size enter`: the checks, the change, and what it does, in words.

use super::args::EnterArgs;
use super::{Bench, number_in, shown_in, unit_name, unit_of};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::{clock, say, shop};
use ledger::{Action, ChangeRequest, Level};
use serde_json::{Value, json};
use sizing::history::{self, Row, What};
use sizing::{Correction, Dimension, Entry, EntryError, Present, Unit, Verdict, trend};
use store::DataDirectory;
use units::Timestamp;

/// One entry, as a person makes it.
pub struct Entering<'a> {
    /// Which dimension.
    pub dimension: &'a str,
    /// What was measured.
    pub entry: Entry,
    /// The measured part; the one that is due when `None`.
    pub part: Option<u64>,
    /// What the person saw in the register, mm.
    pub seen: Option<f64>,
}

/// Checks an entry, makes its change and keeps both, or keeps the refusal.
///
/// # Errors
/// There is no such dimension, or the disk refuses. A refused entry is no error: it is the inner one.
pub fn enter_size(
    bench: &mut Bench,
    directory: &mut DataDirectory,
    entering: &Entering<'_>,
    common: &Common,
) -> Result<Result<(Correction, Row), EntryError>, Failure> {
    let kept = bench.dimension(entering.dimension)?.clone();
    let entry = &entering.entry;
    let last = bench.last(&kept.name, What::Entered);
    let part = entering
        .part
        .unwrap_or_else(|| last.and_then(|r| r.part).map_or(1, |p| p + u64::from(kept.every)));
    let present = Present {
        register: directory.value(&kept.register).map_err(shop::failure)?,
        seen: entering.seen,
        last_entry: last.map(|r| Timestamp(r.at_ns)),
        others: history::others(&kept, &bench.job.dimensions, &bench.history),
    };
    // The words are in the unit that the person wants to read; the law does not know the unit.
    let dimension = shown_in(&kept, common);
    match sizing::enter(&dimension, entry, &present) {
        Ok(correction) => {
            let why = correction.request.as_ref().map_or("measured", |r| r.why.as_str()).to_owned();
            let row = Row {
                measured_mm: Some(correction.measured.0),
                asked_mm: Some(sizing::correction::asked(&kept, correction.measured)),
                before_mm: present.register,
                after_mm: Some(correction.after),
                ..Row::new(What::Entered, &kept, &entry.who, &why, entry.when)
            }
            .typed(&entry.text, entry.unit, part);
            let row = bench.keep(directory, &row, correction.request.as_ref())?;
            Ok(Ok((correction, row)))
        }
        Err(refused) => {
            let row = Row {
                rule: Some(refused.rule().to_owned()),
                ..Row::new(What::Refused, &kept, &entry.who, &refused.to_string(), entry.when)
            }
            .typed(&entry.text, entry.unit, part);
            bench.keep(directory, &row, None)?;
            Ok(Err(refused))
        }
    }
}

/// Runs the command.
pub(super) fn enter(args: &EnterArgs, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::EnterSize, &mut directory, at)?;
    let mut bench = Bench::open(&directory, common)?;
    let dimension = bench.dimension(&args.dimension)?.clone();
    let unit = args.unit.map_or(dimension.unit, unit_of);
    let level = level_of(&acting, args.level, &mut directory, at)?;
    let length = |option: &str, text: &Option<String>| -> Result<Option<f64>, Failure> {
        let read = |text: &String| sizing::entry::number(text).map(|n| tidy(unit.length(n).0));
        text.as_ref()
            .map(read)
            .transpose()
            .map_err(|e| Failure::usage(format_args!("--{option}: {e}")))
    };
    let found = length("at-control", &args.at_control)?;
    let noticed = match found {
        Some(found) => at_control(&mut bench, &mut directory, &dimension, found, at)?,
        None => None,
    };
    let entering = Entering {
        dimension: &dimension.name,
        entry: Entry {
            text: args.value.clone(),
            unit,
            who: acting.name.clone(),
            level,
            remark: common.reason.clone().unwrap_or_default(),
            when: at,
        },
        part: args.part,
        seen: length("seen", &args.seen)?,
    };
    let register = directory.value(&dimension.register).map_err(shop::failure)?;
    match enter_size(&mut bench, &mut directory, &entering, common)? {
        Ok((correction, row)) => {
            accepted(&bench, &dimension, unit, &correction, &row, noticed.as_ref(), common)?;
            Ok(Exit::Good)
        }
        Err(refused) => {
            let words = format!("refused ({}): {refused}", refused.rule());
            if common.json {
                let before = number_in(unit, register.unwrap_or(0.0));
                print_json(&json!({
                    "accepted": false,
                    "alarm": refused.alarm().map(|(number, message)| json!({ "type": "MACRO", "number": number, "message": message })),
                    "rule": refused.rule(),
                    "message": refused.to_string(),
                    "dimension": dimension.name,
                    "register": dimension.register,
                    "before": before,
                    "after": before,
                    "change": 0.0,
                    "unit": unit_name(unit),
                    "at_control": noticed,
                }))?;
                eprintln!("{words}");
            } else {
                say_noticed(noticed.as_ref(), &dimension, common);
                say(&words);
                say("nothing was changed");
            }
            Ok(Exit::Negative)
        }
    }
}

/// The level that an entry is made with: 5 unless a person says to use the own one, and never one beyond that.
fn level_of(acting: &Acting, asked: Option<u8>, directory: &mut DataDirectory, at: Timestamp) -> Result<u8, Failure> {
    let own = acting.level.map_or(Level::LOWEST.number(), Level::number);
    match asked {
        None => Ok(own.max(USUAL_LEVEL)),
        Some(asked) if asked >= own => Ok(asked),
        Some(_) => {
            // Whoever claims a stronger level than the own one is told and logged, whatever the size.
            acting.must(Action::ExceedStep, directory, at)?;
            Ok(own)
        }
    }
}

/// Without `--level` an entry is made with this one: a large step is made on purpose only.
const USUAL_LEVEL: u8 = 5;

/// What the control shows is not what the log says: somebody entered it there. It is recorded as found, by nobody we know.
fn at_control(
    bench: &mut Bench,
    directory: &mut DataDirectory,
    dimension: &Dimension,
    found: f64,
    at: Timestamp,
) -> Result<Option<Row>, Failure> {
    let before = directory.value(&dimension.register).map_err(shop::failure)?;
    if (before.unwrap_or(0.0) - found).abs() < 1e-6 {
        return Ok(None);
    }
    let request = ChangeRequest {
        path: dimension.register.clone(),
        to: found,
        expected: before,
        who: "somebody at the control".to_owned(),
        why: "entered directly at the control, found when the next size was entered".to_owned(),
        when: at,
    };
    let row = Row {
        before_mm: before,
        after_mm: Some(found),
        ..Row::new(What::AtControl, dimension, &request.who, &request.why, at)
    };
    bench.keep(directory, &row, Some(&request)).map(Some)
}

fn say_noticed(noticed: Option<&Row>, dimension: &Dimension, common: &Common) {
    if let Some(row) = noticed {
        let words = |mm: Option<f64>| shown_in(dimension, common).unit.words(units::Millimetres(mm.unwrap_or(0.0)));
        say(&format!(
            "notice: {} was {} by the log and is {} at the control: recorded as entered there (entry {})",
            dimension.register,
            words(row.before_mm),
            words(row.after_mm),
            row.entry
        ));
    }
}

fn accepted(
    bench: &Bench,
    dimension: &Dimension,
    unit: Unit,
    correction: &Correction,
    row: &Row,
    noticed: Option<&Row>,
    common: &Common,
) -> Result<(), Failure> {
    let sizes = history::sizes(dimension, &bench.history);
    let outlook = trend::outlook(dimension, &sizes, LAST, correction.after);
    let marks: Vec<trend::Rule> = trend::marks(dimension, &sizes)
        .into_iter()
        .filter(|(entry, _)| *entry == row.entry)
        .map(|(_, rule)| rule)
        .collect();
    if common.json {
        return print_json(&json!({
            "accepted": true,
            "alarm": Value::Null,
            "dimension": correction.dimension,
            "register": correction.register,
            "before": number_in(unit, correction.before),
            "after": number_in(unit, correction.after),
            "change": number_in(unit, correction.change),
            "unit": unit_name(unit),
            "before_mm": correction.before,
            "after_mm": correction.after,
            "change_mm": correction.change,
            "measured": number_in(unit, correction.measured.0),
            "target": number_in(unit, correction.target.0),
            "next_part": number_in(unit, correction.next_part.0),
            "verdict": verdict_words(correction.verdict),
            "effect": correction.effect,
            "entry": row.entry,
            "part": row.part,
            "tool": correction.tool.0,
            "offset": dimension.offset,
            "who": row.who,
            "why": row.why,
            "outlook": outlook,
            "marks": marks,
            "at_control": noticed,
        }));
    }
    say_noticed(noticed, dimension, common);
    let shown = shown_in(dimension, common);
    say(&size_words(&shown, correction.measured, correction.verdict));
    say(&correction.effect);
    for mark in marks {
        say(&format!("mark: {}", mark.words()));
    }
    say(&outlook.words(&shown));
    say(&format!(
        "entry {}, part {}, by {}; take it back: toolmark size undo {} --reason TEXT",
        row.entry,
        row.part.unwrap_or_default(),
        row.who,
        row.entry
    ));
    Ok(())
}

/// How many sizes a trend looks back on.
pub(super) const LAST: usize = 30;

/// A measured size against its limits, in words.
pub fn size_words(dimension: &Dimension, measured: units::Millimetres, verdict: Verdict) -> String {
    let words = |length| dimension.unit.words(length);
    format!(
        "{} measured {} ({} to {}, aim {}): {}",
        dimension.name,
        words(measured),
        words(dimension.low),
        words(dimension.high),
        words(dimension.target),
        verdict_words(verdict)
    )
}

/// A verdict as people and scripts read it.
pub fn verdict_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Good => "good",
        Verdict::TooSmall => "too small",
        Verdict::TooLarge => "too large",
    }
}

/// What a control shows is a decimal number: the dust of the conversion from inches is none.
fn tidy(mm: f64) -> f64 {
    (mm * 1e9).round() / 1e9
}

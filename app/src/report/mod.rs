//! Reports for people: lines on the screen, and one HTML file that needs nothing else, with its numbers beside it as JSON.

pub mod page;
pub mod plot;
pub mod recorded;

use crate::cli::DisplayUnits;
use crate::execution::Course;
use crate::failure::Failure;
use crate::files;
use crate::link::driving::Driven;
use crate::printed::Printed;
use crate::say;
use asrun::{Report, ToleranceSource, Verdict, WorkingstepReport};
use recorded::Recorded;
use std::path::Path;
use units::MM_PER_INCH;

/// What a report page tells.
pub struct Page<'a> {
    /// The program; empty when there was none.
    pub program: &'a str,
    /// The machine, or where the record came from.
    pub machine: &'a str,
    /// What only a run on a machine behind the link tells.
    pub driven: Option<&'a Driven>,
    /// Where it began, how long it took and what overrides were in force, when we ran it.
    pub course: Option<&'a Course>,
    /// How the run ended, when we ran it.
    pub ended: Option<String>,
    /// What proves it: hashes, seed, start.
    pub provenance: Vec<(String, String)>,
    /// The numbers.
    pub report: &'a Report,
    /// What the program printed while it ran, and its names of variables.
    pub printed: &'a Printed,
    /// What its functions recorded.
    pub recorded: &'a [Recorded],
}

/// `report.json`.
#[derive(serde::Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    report: &'a Report,
    #[serde(flatten)]
    printed: &'a Printed,
    #[serde(rename = "recordings", skip_serializing_if = "<[Recorded]>::is_empty")]
    recorded: &'a [Recorded],
    #[serde(skip_serializing_if = "Option::is_none")]
    driven: Option<&'a Driven>,
    #[serde(flatten)]
    course: Option<&'a Course>,
}

/// Writes `report.html` and `report.json` into a folder.
///
/// # Errors
/// A file cannot be written.
pub fn write(page: &Page<'_>, folder: &Path) -> Result<(), Failure> {
    let told = Told {
        report: page.report,
        printed: page.printed,
        recorded: page.recorded,
        driven: page.driven,
        course: page.course,
    };
    let json = serde_json::to_vec_pretty(&told).map_err(|e| Failure::machine(format_args!("the report is no JSON: {e}")))?;
    files::write(&folder.join("report.json"), &json)?;
    files::write(&folder.join("report.html"), page::html(page).as_bytes())
}

/// The report as lines on the screen.
pub fn print(report: &Report, units: DisplayUnits) {
    let (scale, unit, digits) = match units {
        DisplayUnits::Mm => (1.0, "mm", 3),
        DisplayUnits::Inch => (1.0 / MM_PER_INCH, "inch", 4),
    };
    let length = |mm: Option<f64>| mm.map_or_else(|| "-".to_owned(), |v| format!("{:.digits$}", v * scale));
    let time = |s: Option<f64>| s.map_or_else(|| "-".to_owned(), |v| format!("{v:.1}"));
    if !report.workingsteps.is_empty() {
        say(&format!(
            "  {:24} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9}  verdict",
            "workingstep", "plan s", "real s", "p95", "max", "rms", "allowed"
        ));
    }
    for w in &report.workingsteps {
        say(&format!(
            "  {:24} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9}  {}",
            shortened(&w.name, 24),
            time(w.time_planned_s),
            time(w.time_real_s),
            length(w.dev_p95_mm),
            length(w.dev_max_mm),
            length(w.dev_rms_mm),
            length(Some(w.tolerance_mm)),
            verdict_of(w)
        ));
    }
    say(&format!(
        "  {} samples ({} unmatched), {} feed runs, {} rapid runs; deviations in {unit}",
        report.samples, report.unmatched, report.feed_runs, report.rapid_runs
    ));
    for finding in &report.findings {
        say(&format!("  finding: {finding}"));
    }
    say(&format!("  verdict: {}", report.verdict.word()));
}

fn verdict_of(w: &WorkingstepReport) -> String {
    let word = w.verdict.word();
    if w.verdict != Verdict::NotJudged && w.tolerance_source == ToleranceSource::Default {
        format!("{word} (tolerance is the default)")
    } else {
        word.to_owned()
    }
}

fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most - 1).chain(['…']).collect()
    }
}

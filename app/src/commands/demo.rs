//! `toolmark demo`: the one story that must always be true.
//!
//! A part is made from STEP-NC on the simulated machine with a wrong set-up planted in one workingstep; the rebuild finds and names it,
//! from the whole record and from positions as an MTConnect agent gives them. A shaft is turned from G-code with a worn tool; its
//! measured size becomes one offset change, and the next shaft is better. A recording and a synchronized action are put into the bracket's
//! program, done by the machine and posted. A controller in a process of its own machines a part of the bracket in real time. Every number
//! that is printed is computed here and now.

mod asked;
mod two_processes;

use super::size::{self, Bench, Entering};
use super::{Done, print_json};
use crate::cli::{Common, DemoArgs, DisplayUnits};
use crate::execution::{self, Asked, Drives, Order, Run, Work};
use crate::failure::{Exit, Failure};
use crate::program::{Program, machine_for};
use crate::survey::minutes;
use crate::{clock, files, report, say, shop};
use asrun::{Report, Verdict, WorkingstepReport};
use cell::sim::measure::{Feature, Gauge, Measurement, Part};
use cell::{Ended, Fault, WorkingstepSelector};
use serde_json::{Value, json};
use sizing::{Dimension, Entry, Unit};
use std::path::{Path, PathBuf};
use store::DataDirectory;
use units::{Millimetres, Seconds, Timestamp, ToolNumber};

const BRACKET: &str = include_str!("../../../corpus/bracket.stpnc");
const SHAFT: &str = include_str!("../../../corpus/shaft.nc");
const SIZES: &str = include_str!("../../../corpus/shaft.toml");

/// The workingstep of the bracket whose set-up is wrong, and by how much, mm in the machine frame.
const WRONG_WORKINGSTEP: &str = "side slot";
const WRONG_BY: [f64; 3] = [0.0, 0.12, 0.0];

/// How far the finishing tool of the shaft is worn, and how well the gauge repeats.
const WEAR: Millimetres = Millimetres(0.021);
const GAUGE: Millimetres = Millimetres(0.0005);

/// Runs the command.
///
/// # Errors
/// A file cannot be written. A story that does not come true is a negative exit.
pub fn demo(args: &DemoArgs, common: &Common) -> Done {
    let quiet = common.json;
    let tell = |line: &str| {
        if !quiet {
            say(line);
        }
    };
    tell("Toolmark demo. Everything below is SIMULATED: two machines, one seed, no file prepared beforehand.");
    let start = clock::start_time(common.start.as_deref())?;
    let folder = match &args.out {
        Some(folder) => folder.clone(),
        None => fresh_folder()?,
    };
    std::fs::create_dir_all(&folder).map_err(|e| Failure::writing(&folder, e))?;
    let data = common.data.clone().unwrap_or_else(|| folder.join("data"));
    let mut directory = shop::open_data(&data, common)?;
    let mut story = Story {
        common,
        start,
        folder: &folder,
        directory: &mut directory,
        tell: &tell,
    };

    let bracket = story.bracket()?;
    let shaft = story.shaft()?;
    let asked = story.asked()?;
    let two_processes = story.two_processes()?;
    let findings = directory.verify().map_err(shop::failure)?;
    tell("");
    tell("5. The proof");
    tell(&format!(
        "   the data directory holds {} jobs, {} records and their chained events; verified: {}",
        directory.jobs().map_err(shop::failure)?.len(),
        directory.records().map_err(shop::failure)?.len(),
        if findings.is_empty() {
            "nothing was changed afterwards".to_owned()
        } else {
            format!("{} findings", findings.len())
        }
    ));
    tell(&format!("   files: {}", folder.display()));
    tell("   look at bracket/report.html first; run it on your own program: toolmark run PROGRAM --fast --out DIR");
    let chapters = [&bracket, &shaft, &asked, &two_processes];
    let true_story = chapters.iter().all(|chapter| chapter.came_true) && findings.is_empty();
    if quiet {
        print_json(&json!({
            "simulated": true,
            "seed": common.seed,
            "start": clock::utc(start),
            "folder": folder,
            "bracket": bracket.numbers,
            "shaft": shaft.numbers,
            "asked": asked.numbers,
            "two_processes": two_processes.numbers,
            "verified": findings.is_empty(),
            "came_true": true_story,
        }))?;
    }
    if !true_story {
        return Err(Failure::negative(
            "error: the demo's story did not come true with this seed; please report it",
        ));
    }
    Ok(Exit::Good)
}

/// What one chapter gives.
struct Chapter {
    came_true: bool,
    numbers: Value,
}

struct Story<'a> {
    common: &'a Common,
    start: Timestamp,
    folder: &'a Path,
    directory: &'a mut DataDirectory,
    tell: &'a dyn Fn(&str),
}

impl Story<'_> {
    /// Plan, run with a fault, rebuild twice, find the fault.
    fn bracket(&mut self) -> Result<Chapter, Failure> {
        let program = self.program("bracket.stpnc", BRACKET)?;
        let fault = Fault::SetupShift {
            workingstep: WorkingstepSelector::Name(WRONG_WORKINGSTEP.to_owned()),
            shift: WRONG_BY,
        };
        (self.tell)("");
        (self.tell)("1. A bracket from STEP-NC: plan, run, record, rebuild, compare");
        let run = self.run(&program, "bracket", vec![fault], None, self.start, None)?;
        let report = &run.rebuild.report;
        (self.tell)(&format!(
            "   {} rows recorded in {} of machine time, one each millisecond; as-executed.stpnc holds plan and run",
            run.record.rows,
            minutes(run.outcome.time.0)
        ));
        if !self.common.json {
            report::print(report, DisplayUnits::Mm);
        }
        let shift = self.say_what_was_found(report);
        let told = self.say_twin(&run.folder.join("as-executed.stpnc"))?;

        // The same machine, seen only by positions every 100 ms, times off by up to 20 ms.
        let thin = self.run(
            &program,
            "bracket-as-mtconnect",
            vec![Fault::SetupShift {
                workingstep: WorkingstepSelector::Name(WRONG_WORKINGSTEP.to_owned()),
                shift: WRONG_BY,
            }],
            Some((100, Seconds(0.02))),
            self.start + Seconds(600.0),
            None,
        )?;
        let thinned = &thin.rebuild.report;
        (self.tell)(&format!(
            "   the same run from {} positions as an MTConnect agent gives them (100 ms, times off by up to 20 ms): {} feed and {} rapid \
             runs, '{WRONG_WORKINGSTEP}' {}",
            thinned.samples,
            thinned.feed_runs,
            thinned.rapid_runs,
            verdict_of(thinned, WRONG_WORKINGSTEP).map_or("not found", Verdict::word)
        ));
        let judged = |report: &Report| {
            let wrong = verdict_of(report, WRONG_WORKINGSTEP) == Some(Verdict::OutOfTolerance);
            let others = report.workingsteps.iter().filter(|w| w.name != WRONG_WORKINGSTEP);
            wrong && others.clone().count() > 0 && others.into_iter().all(|w| w.verdict == Verdict::Good)
        };
        let named = shift.is_some_and(|s| (s - 0.12).abs() < 0.005);
        let same_cut = (report.feed_runs, report.rapid_runs) == (thinned.feed_runs, thinned.rapid_runs);
        Ok(Chapter {
            came_true: told && run.outcome.ended == Ended::Completed && judged(report) && judged(thinned) && named && same_cut,
            numbers: json!({
                "rows": run.record.rows,
                "machine_time_s": run.outcome.time.0,
                "digest": run.outcome.digest.to_string(),
                "planted": { "workingstep": WRONG_WORKINGSTEP, "shift_mm": WRONG_BY },
                "found_shift_mm": shift,
                "report": brief(report),
                "as_mtconnect": brief(thinned),
            }),
        })
    }

    /// The run as it stands in the file, read from it: workplans in workplans, each part with the one of the plan that it is a run of.
    /// False when a part is missing or points at nothing.
    fn say_twin(&self, path: &Path) -> Result<bool, Failure> {
        let bytes = std::fs::read(path).map_err(|e| Failure::unreadable(format_args!("{}: {e}", path.display())))?;
        let file = stepnc::Program::read("as-executed.stpnc", bytes)
            .map_err(|e| Failure::unreadable(format_args!("{}: {e}", path.display())))?;
        let Some(twin) = file.projects().iter().find(|project| project.is_twin) else {
            return Ok(false);
        };
        (self.tell)(
            "   the run in as-executed.stpnc, workplan in workplan, each part with how long it took and what it is a run of:",
        );
        let mut whole = true;
        let mut open = vec![(twin.main_workplan, 0)];
        while let Some((id, depth)) = open.pop() {
            let Some(part) = file.executable(id) else { continue };
            let facts = part.twin.as_ref();
            let planned = facts.and_then(|facts| file.executable(facts.plan?));
            whole &= planned.is_some();
            let time = facts.and_then(|facts| Some(facts.end?.since(facts.start?).0)).unwrap_or(0.0);
            (self.tell)(&format!(
                "     {:indent$}{} {:width$} {time:5.1} s   {}",
                "",
                part.kind_word(),
                part.name,
                planned.map_or("nothing", |planned| planned.name.as_str()),
                indent = 2 * depth,
                width = 44 - 2 * depth - part.kind_word().len(),
            ));
            open.extend(part.children().into_iter().rev().map(|child| (child, depth + 1)));
        }
        Ok(whole)
    }

    /// Size of the shift that the report itself found, mm; said in words.
    fn say_what_was_found(&self, report: &Report) -> Option<f64> {
        let shift = workingstep(report, WRONG_WORKINGSTEP).and_then(|w| w.shift.as_ref())?;
        let size = shift.vector_mm.iter().map(|v| v * v).sum::<f64>().sqrt();
        (self.tell)(&format!(
            "   planted: the work offset of '{WRONG_WORKINGSTEP}' was 0.120 mm off; found: a shift of {size:.3} mm, and with it taken out \
             p95 falls from {:.3} to {:.3} mm",
            shift.p95_before_mm, shift.p95_after_mm
        ));
        Some(size)
    }

    /// One measured size, one offset change, a better part.
    fn shaft(&mut self) -> Result<Chapter, Failure> {
        (self.tell)("");
        (self.tell)("2. Two shafts from G-code: measured size in, offset out");
        let program = self.program("shaft.nc", SHAFT)?;
        // The demo's machines are the built-in ones, whatever --machine says.
        let common = Common {
            machine: "sim".to_owned(),
            ..self.common.clone()
        };
        let mut bench = Bench::load(self.directory, SIZES, Path::new("shaft.toml"), &common)?;
        let seat = bench.dimension("SEAT D40")?.clone();
        // A data directory that was used before holds the correction of the last demo: a new insert begins without wear.
        let insert = self.start + Seconds(1100.0);
        size::put_in(&mut bench, self.directory, seat.offset, &self.who(), None, insert)?;
        let feature = Feature::TurnedDiameter {
            z_from: Millimetres(-44.0),
            z_to: Millimetres(-28.0),
        };
        let mut gauge = Gauge::new(GAUGE, self.common.seed);

        let first = self.turn(&program, "shaft-1", feature, &mut gauge, self.start + Seconds(1200.0))?;
        self.say_size("first shaft", &first, &seat);
        let entering = Entering {
            dimension: &seat.name,
            entry: Entry {
                text: format!("{:.3}", first.value.0),
                unit: Unit::Mm,
                who: self.who(),
                level: 5,
                remark: "demo".into(),
                when: self.start + Seconds(1300.0),
            },
            part: Some(1),
            seen: None,
        };
        let entered = size::enter_size(&mut bench, self.directory, &entering, &common)?;
        let (correction, row) = entered.map_err(|e| Failure::negative(format_args!("error: {e}")))?;
        (self.tell)(&format!("   {}", correction.effect));
        (self.tell)(&format!(
            "   recorded as entry {} of the chain, by {}: {}",
            row.entry, row.who, row.why
        ));
        let second = self.turn(&program, "shaft-2", feature, &mut gauge, self.start + Seconds(1800.0))?;
        self.say_size("second shaft", &second, &seat);

        let off = |m: &Measurement| (m.value - seat.target).abs();
        let good = |m: &Measurement| m.value >= seat.low && m.value <= seat.high;
        let better = off(&second) < off(&first) && good(&second) && !good(&first);
        Ok(Chapter {
            came_true: better && correction.request.is_some(),
            numbers: json!({
                "dimension": seat.name,
                "target_mm": seat.target.0,
                "first_mm": first.value.0,
                "register": correction.register,
                "entry": row.entry,
                "before_mm": correction.before,
                "after_mm": correction.after,
                "change_mm": correction.change,
                "second_mm": second.value.0,
            }),
        })
    }

    fn say_size(&self, which: &str, m: &Measurement, seat: &Dimension) {
        let verdict = if m.value < seat.low {
            sizing::Verdict::TooSmall
        } else if m.value > seat.high {
            sizing::Verdict::TooLarge
        } else {
            sizing::Verdict::Good
        };
        (self.tell)(&format!("   {which}: {}", size::size_words(seat, m.value, verdict)));
    }

    fn turn(
        &mut self,
        program: &Program,
        name: &str,
        feature: Feature,
        gauge: &mut Gauge,
        start: Timestamp,
    ) -> Result<Measurement, Failure> {
        let faults = vec![Fault::ToolWear {
            tool: ToolNumber(3),
            radial: WEAR,
        }];
        let mut part = Part::new(feature, &faults);
        let run = self.run(program, name, faults, None, start, Some(&mut part))?;
        if run.outcome.ended != Ended::Completed {
            return Err(Failure::negative(format_args!(
                "error: {}: {}",
                program.name,
                run.outcome.ended.text()
            )));
        }
        part.measure(gauge)
            .ok_or_else(|| Failure::negative("error: nothing was cut where the seat is measured"))
    }

    fn run(
        &mut self,
        program: &Program,
        name: &str,
        faults: Vec<Fault>,
        thinned: Option<(u64, Seconds)>,
        start: Timestamp,
        part: Option<&mut Part>,
    ) -> Result<Run, Failure> {
        let machine = machine_for("sim", program.turns())?;
        let who = self.who();
        self.directory.take_over(&machine, &who, start).map_err(shop::failure)?;
        let order = Order {
            work: Work::Program(program),
            machine: &machine,
            tables: self.directory.tables(&machine).map_err(shop::failure)?,
            seed: self.common.seed,
            start,
            faults,
            thinned,
            out: Some(&self.folder.join(name)),
            tolerance: None,
            fast: true,
            who: &who,
            drives: Drives::World,
            stop: None,
            person: json!({ "level": ledger::Level::HIGHEST.number(), "authenticated_by": "none" }),
            found: None,
            asked: Asked::default(),
        };
        execution::run(&order, self.directory, part)
    }

    /// A program of the corpus, written down and opened as any other.
    fn program(&self, name: &str, text: &str) -> Result<Program, Failure> {
        let path: PathBuf = self.folder.join(name);
        files::write(&path, text.as_bytes())?;
        Program::open(&path, None, None)
    }

    fn who(&self) -> String {
        self.common.operator.clone().unwrap_or_else(|| "demo".to_owned())
    }
}

fn workingstep<'r>(report: &'r Report, name: &str) -> Option<&'r WorkingstepReport> {
    report.workingsteps.iter().find(|w| w.name == name)
}

fn verdict_of(report: &Report, name: &str) -> Option<Verdict> {
    workingstep(report, name).map(|w| w.verdict)
}

/// The numbers of a report without its drawings.
fn brief(report: &Report) -> Value {
    let workingsteps: Vec<Value> = report
        .workingsteps
        .iter()
        .map(|w| json!({ "name": w.name, "dev_p95_mm": w.dev_p95_mm, "dev_max_mm": w.dev_max_mm, "verdict": w.verdict }))
        .collect();
    json!({
        "samples": report.samples,
        "unmatched": report.unmatched,
        "feed_runs": report.feed_runs,
        "rapid_runs": report.rapid_runs,
        "verdict": report.verdict,
        "workingsteps": workingsteps,
        "findings": report.findings,
    })
}

/// A folder of its own in the system's place for temporary files; it stays, so that a person can look into it.
fn fresh_folder() -> Result<PathBuf, Failure> {
    let base = std::env::temp_dir();
    for n in 0..1000u32 {
        let folder = base.join(format!("toolmark-demo-{}-{n}", std::process::id()));
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(Failure::writing(&folder, e)),
        }
    }
    Err(Failure::machine(format_args!(
        "{} has no room for another demo folder",
        base.display()
    )))
}

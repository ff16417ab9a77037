//! Taking a program up in the middle: which step a person means by a name, a number, a block or a line; what is in force there; and where an
//! earlier run of it was left.
//!
//! The program is read twice from its beginning without moving anything: once to find the step, once to know what was begun before it. Its
//! questions on the way are answered as in the run that is taken up, or as without a machine.

mod answers;
mod step;

use crate::commands::trace::job_named;
use crate::failure::Failure;
use crate::people::Acting;
use crate::program::Program;
use crate::shop;
pub use answers::Answers;
use answers::{each_event, walk};
use cell::{Approach, Restarted};
use plan::{CoolantState, Level, Marker, Modal, ProgramStream, RawNcFunction, SpindleMode, SpindleState, StepKind, Tables};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeSet;
use step::{Candidate, Heads, Meant, block_number, look, meant};
use store::machine_file::{HomeEnd, MachineKind};
use store::{DataDirectory, Ending, Job, JobState, MachineFile};
use trace::survey::Survey;
use units::{Axis, Millimetres, MmPerSec, StepId};

/// How far above the path the rapid of the way in ends.
const CLEARANCE: Millimetres = Millimetres(2.0);
/// Feed from there, and of the link's own way back to a path.
const ONTO_THE_PATH: MmPerSec = MmPerSec(10.0);
/// Names in a message at most.
const SHOWN: usize = 12;

/// Where a program is taken up, and with what.
#[derive(Clone, Debug)]
pub struct TakeUp {
    /// The first step that is run.
    pub at: StepId,
    /// Where that is, for people.
    pub place: String,
    /// Workingsteps that are left out, whole or with their beginning.
    pub left_out: Vec<String>,
    /// The job whose run is taken up.
    pub after_job: Option<i64>,
    /// Functions that were begun before and go on, with the number of parts that lie open around them.
    functions: Vec<(usize, RawNcFunction)>,
    answers: Answers,
    approach: Approach,
}

/// What a report says of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakenUp {
    /// Where.
    pub at: String,
    /// The number of the first step that was run.
    pub step: u32,
    /// By whom.
    pub by: Value,
    /// The job whose run was taken up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after_job: Option<i64>,
    /// What was put in force again, or by the program itself before it moved, in order.
    pub restored: Vec<String>,
    /// What the run left out.
    pub left_out: Vec<String>,
}

impl TakenUp {
    /// In a sentence.
    pub fn line(&self) -> String {
        let name = self.by.get("name").and_then(Value::as_str).unwrap_or("somebody");
        let level = self.by.get("level").and_then(Value::as_u64);
        let level = level.map_or_else(String::new, |level| format!(", level {level}"));
        let after = self.after_job.map_or_else(String::new, |job| format!(" of job {job}"));
        format!(
            "taken up{after} at {} by {name}{level}; restored: {}",
            self.at,
            self.restored.join(", ")
        )
    }

    /// What was not run, in a sentence.
    pub fn left_out_line(&self) -> Option<String> {
        (!self.left_out.is_empty()).then(|| format!("left out by the restart, and not judged: {}", listed(&self.left_out)))
    }
}

impl TakeUp {
    /// The program from there on.
    ///
    /// # Errors
    /// It does not come that far.
    pub fn stream<'a>(&self, program: Box<dyn ProgramStream + 'a>) -> Result<Restarted<'a>, Failure> {
        let mut answers = self.answers.clone();
        let taken = Restarted::new(program, self.at, self.approach, &self.functions, &mut |q| answers.answer(q));
        taken.map_err(|why| Failure::negative(format_args!("error: {} cannot be taken up: {why}", self.place)))
    }

    /// What a report says of it.
    ///
    /// # Errors
    /// The program does not come that far.
    pub fn told(&self, program: Box<dyn ProgramStream + '_>, acting: &Acting) -> Result<TakenUp, Failure> {
        let stream = self.stream(program)?;
        let mut restored: Vec<String> = vec![];
        for (put_in, kind) in stream.until_it_moves() {
            let Some(words) = words_of(kind) else { continue };
            if put_in {
                restored.push(words);
            } else if !matches!(kind, StepKind::NcFunction(_)) && !restored.contains(&words) {
                restored.push(format!("{words} (by the program itself)"));
            }
        }
        Ok(TakenUp {
            at: self.place.clone(),
            step: self.at.0,
            by: acting.json(),
            after_job: self.after_job,
            restored,
            left_out: self.left_out.clone(),
        })
    }
}

/// What was put in, for people; `None` for what only leads there.
fn words_of(kind: &StepKind) -> Option<String> {
    Some(match kind {
        StepKind::Tool(tool) if tool.name.is_empty() => tool.number.to_string(),
        StepKind::Tool(tool) => format!("{} {}", tool.number, tool.name),
        StepKind::Frame(frame) if frame.name.is_empty() => "the set-up".to_owned(),
        StepKind::Frame(frame) => frame.name.clone(),
        StepKind::ToolOffset(offset) if offset.number == 0 => return None,
        StepKind::ToolOffset(offset) => format!("tool offset {}", offset.number),
        StepKind::Spindle(spindle) => spindle_words(spindle),
        StepKind::Coolant(coolant) => coolant_words(coolant),
        StepKind::NcFunction(function) if function.text.trim().is_empty() => format!("functions along '{}'", function.name),
        StepKind::NcFunction(function) => function.text.trim().to_owned(),
        _ => return None,
    })
}

fn spindle_words(spindle: &SpindleState) -> String {
    let (mode, way) = match spindle {
        SpindleState::Stopped => return "spindle stopped".to_owned(),
        SpindleState::Oriented => return "spindle oriented".to_owned(),
        SpindleState::Clockwise(mode) => (mode, "clockwise"),
        SpindleState::Counterclockwise(mode) => (mode, "counterclockwise"),
    };
    match mode {
        SpindleMode::Revolutions(n) => format!("spindle {:.0} rev/min {way}", n.0),
        SpindleMode::Surface { speed, limit } => {
            format!("spindle {:.0} m/min {way}, at most {:.0} rev/min", speed.0 * 0.06, limit.0)
        }
    }
}

fn coolant_words(coolant: &CoolantState) -> String {
    let open = [
        (coolant.flood, "flood"),
        (coolant.mist, "mist"),
        (coolant.through, "through the spindle"),
    ];
    let open: Vec<&str> = open.iter().filter(|(on, _)| *on).map(|(_, name)| *name).collect();
    if open.is_empty() {
        "coolant off".to_owned()
    } else {
        format!("coolant {}", open.join(" and "))
    }
}

/// What a person asked for by `--from`; `None` when that is the beginning.
///
/// # Errors
/// There is no such step, or several, with what there is; or the program cannot be read.
pub fn from(asked: &str, program: &Program, tables: &Tables, machine: &MachineFile) -> Result<Option<TakeUp>, Failure> {
    let (mut wanted, pick) = meant(asked);
    let usage = |what: String| Err(Failure::usage(format_args!("--from {asked}: {what}")));
    let block = block_number(asked.trim().split('[').next().unwrap_or_default().trim_end());
    if let Some(number) = block {
        let lines = Heads::of(program).lines_of(number);
        if lines.len() > 1 {
            let lines: Vec<String> = lines.iter().map(|line| format!("line:{line}")).collect();
            return usage(format!("N{number} stands in several lines; say which: {}", listed(&lines)));
        }
        wanted.extend(lines.into_iter().map(Meant::Line));
    }
    let answers = Answers::default();
    let found = look(program, tables, &answers, &wanted)?;
    let Some(mut candidates) = found.candidates.into_iter().find(|c| !c.is_empty()) else {
        let mut there = match found.workingsteps.is_empty() {
            true => "the program has no workingsteps".to_owned(),
            false => format!("workingsteps are {}", listed(&found.workingsteps)),
        };
        if let Some((first, last)) = found.lines {
            there += &format!("; lines line:{first} to line:{last}, or their N numbers");
        }
        if let Some(alarm) = found.alarm {
            there += &format!("; beyond them the program cannot be read without the machine: {alarm}");
        }
        return usage(format!("there is no such step in {}; {there}", program.name));
    };
    let at = match pick {
        Some(n) if n <= candidates.len() => n - 1,
        Some(_) => {
            let places: Vec<String> = candidates.iter().map(|c| c.place.clone()).collect();
            return usage(format!("there are only {}: {}", candidates.len(), listed(&places)));
        }
        None if candidates.len() == 1 => 0,
        None => {
            let bare = asked.trim();
            let places: Vec<String> = (candidates.iter().enumerate())
                .map(|(k, c)| format!("'{bare}[{}]' is {}, step {}", k + 1, c.place, c.step.0))
                .collect();
            return usage(format!("it comes {} times; say which: {}", candidates.len(), listed(&places)));
        }
    };
    take_up(program, tables, machine, candidates.swap_remove(at), answers, None)
}

/// The run of a job taken up where it was left; `None` when it had not begun.
///
/// # Errors
/// It was another program, it came to its end, nothing is known of where it was, or the program cannot be read.
pub fn resumed(
    name: &str,
    program: &Program,
    tables: &Tables,
    machine: &MachineFile,
    directory: &DataDirectory,
) -> Result<Option<TakeUp>, Failure> {
    let job = job_named(directory, name)?;
    if job.program_hash != program.hash {
        return Err(Failure::usage(format_args!(
            "--resume {name}: job {} ran {} with other bytes than {} has now; take this one up with --from STEP",
            job.id, job.program, program.name
        )));
    }
    if job.state == JobState::Over(Ending::Done) {
        return Err(Failure::usage(format_args!(
            "--resume {name}: job {} came to its end; there is nothing left of it to run",
            job.id
        )));
    }
    let Some(step) = last_step(directory, &job)? else {
        return Err(Failure::usage(format_args!(
            "--resume {name}: nothing is known of where job {} was; start from the beginning, or with --from STEP",
            job.id
        )));
    };
    let answers = Answers::of(directory, &job)?;
    let mut found = look(program, tables, &answers, &[Meant::Step(step.0)])?;
    match found.candidates.swap_remove(0).pop() {
        Some(candidate) => take_up(program, tables, machine, candidate, answers, Some(job.id.0)),
        None => Err(Failure::negative(format_args!(
            "error: --resume {name}: the program does not come to step {} again: {}",
            step.0,
            found.alarm.unwrap_or_else(|| "it ends before".to_owned())
        ))),
    }
}

/// The step in which a run was last seen: of its record, else of its log.
fn last_step(directory: &DataDirectory, job: &Job) -> Result<Option<StepId>, Failure> {
    let mut last = StepId::NONE;
    let records = directory.records().map_err(shop::failure)?;
    for row in records.into_iter().filter(|row| row.job == job.id) {
        let reader = store::record::Reader::open(&row.path).map_err(shop::failure)?;
        for row in reader.rows().map_err(shop::failure)? {
            let row = row.map_err(shop::failure)?;
            if row.step != StepId::NONE {
                last = row.step;
            }
        }
    }
    if last == StepId::NONE {
        each_event(directory, job, |event| {
            let step = event.detail.get("step").and_then(Value::as_u64);
            if let Some(step) = step.and_then(|s| u32::try_from(s).ok()).filter(|s| *s > 0) {
                last = StepId(step);
            }
        })?;
    }
    Ok((last != StepId::NONE).then_some(last))
}

/// What is to be said of an earlier run of this program on this machine that did not come to its end: it was the last job there.
///
/// # Errors
/// The disk refuses, or the program cannot be read.
pub fn left_over(
    program: &Program,
    tables: &Tables,
    machine: &MachineFile,
    directory: &DataDirectory,
) -> Result<Option<String>, Failure> {
    let jobs = directory.jobs().map_err(shop::failure)?;
    let last = jobs.iter().rev().find(|job| job.machine == machine.name);
    let Some(job) = last.filter(|job| {
        let left = matches!(job.state, JobState::Over(Ending::Interrupted | Ending::Failed));
        left && job.program_hash == program.hash
    }) else {
        return Ok(None);
    };
    let Some(step) = last_step(directory, job)? else {
        return Ok(None);
    };
    let answers = Answers::of(directory, job)?;
    let mut found = look(program, tables, &answers, &[Meant::Step(step.0)])?;
    let place = found.candidates.swap_remove(0).pop();
    let place = place.map_or_else(|| format!("step {}", step.0), |candidate| candidate.place);
    let was = match job.state {
        JobState::Over(Ending::Interrupted) => "was interrupted",
        _ => "came to a stop",
    };
    Ok(Some(format!(
        "job {} of this program {was} at {place}; this run begins at the beginning. To take it up there: toolmark run {} --resume {}, or \
         --from STEP for another place",
        job.id,
        program.path.display(),
        job.id
    )))
}

fn take_up(
    program: &Program,
    tables: &Tables,
    machine: &MachineFile,
    candidate: Candidate,
    answers: Answers,
    after_job: Option<i64>,
) -> Result<Option<TakeUp>, Failure> {
    let Candidate { step: at, place } = candidate;
    if at.0 <= 1 {
        return Ok(None);
    }
    let mut survey = Survey::new(&program.name);
    let mut begun: Vec<(String, Vec<Marker>, RawNcFunction)> = vec![];
    // What is along the present toolpath ends with it, and belongs to all that is left of it.
    let mut along: Vec<(Vec<Marker>, RawNcFunction)> = vec![];
    let mut left_out: Vec<String> = vec![];
    let (mut moved, mut there) = (false, Modal::default());
    walk(program, tables, &answers, |step, modal| {
        if step.id >= at {
            there = modal.clone();
            return false;
        }
        survey.step(step);
        match &step.kind {
            StepKind::Begin(marker) if marker.level == Level::Workingstep => left_out.push(marker.name.clone()),
            StepKind::Move(_) | StepKind::MachineMove(_) | StepKind::Dwell(_) => moved = true,
            StepKind::Begin(Marker {
                level: Level::Toolpath, ..
            })
            | StepKind::End(Level::Toolpath) => along.clear(),
            StepKind::NcFunction(function) if function.kind == trace::survey::ALONG => {
                along.push((modal.open.clone(), function.clone()));
            }
            StepKind::NcFunction(function) => {
                let active = active(&survey);
                begun.retain(|(key, ..)| active.contains(key));
                let known: BTreeSet<&String> = begun.iter().map(|(key, ..)| key).collect();
                let new: Vec<String> = active.iter().filter(|key| !known.contains(key)).cloned().collect();
                begun.extend(new.into_iter().map(|key| (key, modal.open.clone(), function.clone())));
            }
            StepKind::End(Level::Workplan) => {
                let active = active(&survey);
                begun.retain(|(key, ..)| active.contains(key));
            }
            _ => {}
        }
        true
    })?;
    if !moved {
        // Nothing is left out that moves: the program says the rest itself.
        return Ok(None);
    }
    if there.within(Level::Workingstep).is_some()
        && let Some(last) = left_out.last_mut()
    {
        *last = format!("the beginning of {last}");
    }
    let axis = match machine.kind {
        MachineKind::Mill => 2,
        MachineKind::Lathe => 0,
    };
    let around = |open: &[Marker]| open.iter().zip(&there.open).take_while(|(a, b)| a == b).count();
    Ok(Some(TakeUp {
        at,
        place,
        left_out,
        after_job,
        functions: begun
            .into_iter()
            .map(|(_, open, function)| (open, function))
            .chain(along)
            .map(|(open, function)| (around(&open), function))
            .collect(),
        answers,
        approach: Approach {
            axis,
            free: free_of(machine, axis).max(Millimetres(tables.position.xyz[axis])),
            clearance: CLEARANCE,
            feed: ONTO_THE_PATH,
        },
    }))
}

/// What the survey has as begun, as one word each.
fn active(survey: &Survey) -> BTreeSet<String> {
    survey.begun().map(|(kind, id)| format!("{kind} {id}")).collect()
}

/// Where an axis is free of the part: at home, which on a machine whose home is at the other end is the far end of its travel.
fn free_of(machine: &MachineFile, axis: usize) -> Millimetres {
    machine
        .axis(Axis::ALL[axis])
        .map_or(Millimetres(0.0), |file| match file.home {
            HomeEnd::Max => Millimetres(0f64.clamp(file.travel_min.0, file.travel_max.0)),
            HomeEnd::Min => file.travel_max,
        })
}

/// The first of many, and how many more there are.
fn listed(all: &[String]) -> String {
    let shown = all.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    match all.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

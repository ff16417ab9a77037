//! One run of one program, on the simulated machine or on one behind the link: executed, recorded, rebuilt from the record, written down.
//!
//! The rebuild reads the record file, not the samples in memory: what the report says is what the file says.

pub use crate::course::{Asked, Course};
use crate::failure::Failure;
use crate::foreseen::Foresight;
use crate::functions::{self, Values};
use crate::link::driving::{self, Driven};
use crate::link::remote::{Machine, Remote};
use crate::live::job::LiveJob;
use crate::overriding::{Act, Overridden};
use crate::printed::{self, Printed};
use crate::program::Program;
use crate::progress::Progress;
use crate::report::recorded::{self, Recorded};
use crate::report::{self, Page};
use crate::survey::minutes;
use crate::{clock, files, recording, shop};
use asrun::{PlanOptions, PlannedProgram, Rebuild, RecordFrame, RecordPoint, Recording};
use cell::link::Load;
use cell::observe::Thinned;
use cell::sim::measure::Part;
use cell::{CommandSource, Ended, Fault, OfficeHalf, Operator, Outcome, RecordSink, World, WorldConfig};
use ledger::{Chain, Event, Hash};
use machine::{Quality, Report, Request, Sample};
use motion::Trajectory;
use plan::{ProgramStream, Tables, executed::AsExecuted};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use stepnc::twin::TwinOptions;
use store::record::{Finished, Header, SampleRows};
use store::segment::{Gap, Notice, Offered, Pace, Recorder, Settings, Watch};
use store::{DataDirectory, Ending, Job, MachineFile, NewJob};
use trace::record::{Recorder as Functions, Row, Stream};
use trace::survey::Found;
use units::{Millimetres, Seconds, StepId, Timestamp};

/// What is to be run.
pub struct Order<'a> {
    /// The program, or the job that is still coming.
    pub work: Work<'a>,
    /// The machine.
    pub machine: &'a MachineFile,
    /// Its offsets and tools now.
    pub tables: Tables,
    /// Seed of the simulation.
    pub seed: u64,
    /// When it starts.
    pub start: Timestamp,
    /// What goes wrong in it.
    pub faults: Vec<Fault>,
    /// Rebuild from the record thinned to this interval (ticks) and jitter.
    pub thinned: Option<(u64, Seconds)>,
    /// Where its files go; the data directory's own folder for the job when `None`.
    pub out: Option<&'a Path>,
    /// Tolerance where the program gives none.
    pub tolerance: Option<Millimetres>,
    /// As fast as possible instead of in real time.
    pub fast: bool,
    /// Who runs it.
    pub who: &'a str,
    /// Who moves the axes.
    pub drives: Drives<'a>,
    /// A person wants it to stop.
    pub stop: Option<&'a AtomicBool>,
    /// What is known of them: level, organization, role, shift, and how they were identified.
    pub person: serde_json::Value,
    /// What was found at cycle start, for the report.
    pub found: Option<String>,
    /// How it is run otherwise than from its beginning and as programmed.
    pub asked: Asked<'a>,
}

/// What is executed.
#[derive(Clone, Copy)]
pub enum Work<'a> {
    /// A program on disk.
    Program(&'a Program),
    /// Operations that come one at a time.
    Live(&'a LiveJob),
}

/// Who moves the axes.
#[derive(Clone, Copy)]
pub enum Drives<'a> {
    /// The simulated world in this process.
    World,
    /// A controller behind a link.
    Behind(&'a Remote, &'a Machine),
}

impl Drives<'_> {
    /// What the measurements are worth.
    pub fn quality(self) -> Quality {
        match self {
            Drives::World => Quality::Simulated,
            Drives::Behind(_, machine) => machine.quality,
        }
    }

    /// True when nothing of it is real.
    pub fn is_simulated(self) -> bool {
        self.quality() == Quality::Simulated
    }
}

impl<'a> Work<'a> {
    fn name(self) -> &'a str {
        match self {
            Work::Program(program) => &program.name,
            Work::Live(job) => job.name(),
        }
    }

    fn hash(self) -> Hash {
        match self {
            Work::Program(program) => program.hash,
            Work::Live(job) => job.hash(),
        }
    }
}

/// A run that is over.
pub struct Run {
    /// How it went.
    pub outcome: Outcome,
    /// Its record.
    pub record: Finished,
    /// Rows that are not in it, and why.
    pub gaps: Vec<Gap>,
    /// Plan against run.
    pub rebuild: Rebuild,
    /// What the program printed, and what its functions recorded.
    pub printed: Printed,
    /// What only a run on a machine behind the link tells.
    pub driven: Option<Driven>,
    /// Where it began, how long it took, and what overrides were in force.
    pub course: Course,
    /// Where its files are.
    pub folder: PathBuf,
}

/// Runs a program, records it, rebuilds it and writes everything down. `part` watches what is made, for the gauge.
///
/// # Errors
/// A file cannot be written, or the machine's parameters are unusable. A run that ends badly is no error: it is in the outcome.
pub fn run(order: &Order<'_>, directory: &mut DataDirectory, part: Option<&mut Part>) -> Result<Run, Failure> {
    let new = NewJob {
        program: order.work.name(),
        program_hash: order.work.hash(),
        machine: &order.machine.name,
        seed: order.seed,
        start: order.start,
        folder: order.out,
        who: order.who,
    };
    if let Work::Program(program) = order.work {
        let mut bytes = std::fs::File::open(&program.path)
            .map_err(|e| Failure::unreadable(format_args!("{}: {e}", program.path.display())))?;
        directory
            .keep_program(&program.name, &mut bytes, program.hash, order.start)
            .map_err(shop::failure)?;
    }
    let job = directory.begin_job(&new).map_err(shop::failure)?;
    let done = run_job(order, directory, &job, part);
    if done.is_err() {
        // The reason is the failure at hand; that the job cannot be ended either would only hide it.
        let _ = directory.end_job(job.id, order.start, Ending::Failed);
    }
    done
}

fn run_job(order: &Order<'_>, directory: &mut DataDirectory, job: &Job, part: Option<&mut Part>) -> Result<Run, Failure> {
    let folder = job.folder.clone();
    std::fs::create_dir_all(&folder).map_err(|e| Failure::writing(&folder, e))?;

    let record_path = folder.join("record.parquet");
    let header = Header {
        machine: order.machine.name.clone(),
        simulated: order.drives.is_simulated(),
        start: order.start,
        seed: order.seed,
    };
    // The recording is made in the data directory, whatever becomes of the folder that was asked for: what is acknowledged there is
    // recovered by the next start. With `--fast` the time is simulated, and may wait for the disk.
    let pace = if order.fast { Pace::Simulated } else { Pace::Real };
    let recording = Recorder::begin(
        &directory.recording_folder(job.id),
        SampleRows::new(order.start, &record_path),
        header.metadata(),
        &Settings::new(pace),
    );
    let recording = recording.map_err(shop::failure)?;
    let watch = recording.watch();
    let mut rows = RunRows {
        recording,
        events: vec![],
        thinned: order
            .thinned
            .map(|(interval, jitter)| Thinned::new(order.start, interval, jitter, order.seed)),
        part,
        last: None,
        values: Values::new(directory.values_folder(job.id), &folder, order.start, pace),
    };
    let mut told = 0;
    let far = RefCell::new(Foresight::of(order.asked.plan));
    let (outcome, driven) = execute(order, &far, &mut rows, &mut |now, events| {
        tell_notices(directory, &watch, now)?;
        // What happened is on disk while the job runs: after a power loss the next start can say where it was interrupted.
        let new = &events[told..];
        told = events.len();
        if new.is_empty() {
            return Ok(());
        }
        // What the program wrote into the control's registers is there for the next one, whatever becomes of this run.
        directory
            .append_run_events(job.id, order.machine, order.who, new)
            .map_err(shop::failure)?;
        Ok(())
    })?;
    let RunRows {
        recording,
        events,
        thinned,
        values,
        ..
    } = rows;
    let end = order.start.at(outcome.ticks);
    // Before the recording's folder goes, in which they are made.
    let values_file = values.end(directory, job.id, end)?;
    let ended = recording.end();
    tell_notices(directory, &watch, end)?;
    ended.map_err(shop::failure)?;
    let kept = directory
        .keep_recording(job.id, &record_path, &events, end)
        .map_err(shop::failure)?;
    for (path, what) in &kept.lost {
        eprintln!("warning: {} of the recording is damaged: {what}", path.display());
    }
    let (record, gaps) = (kept.finished, kept.gaps);

    let mut record_read = recording::of_record(&record_path)?;
    if let Some(thinned) = thinned {
        let first = order.asked.take_up.map_or(StepId::NONE, |(take_up, _)| take_up.at);
        let begins = record_read.points.iter().find(|point| point.step >= first);
        let begins = begins.map_or(order.start, |point| point.at);
        as_an_agent_saw_it(&mut record_read, &thinned, begins);
    }
    // A live job is a program on disk now.
    let written_now;
    let (program, tables) = match order.work {
        Work::Program(program) => (program, order.tables.clone()),
        Work::Live(job) => {
            written_now = job.written(&folder)?;
            (&written_now, job.tables())
        }
    };
    let mut rebuild = rebuild(order, (program, &tables), &record_read, &outcome)?;
    functions::results(&events, &mut rebuild.executed);
    let printed = Printed::of(&events);
    let recorded = values_file.map_or_else(|| Ok(vec![]), |file| recorded::read(&file))?;
    rebuild.report.findings.extend(functions::alarms(&printed.functions));
    let course = Course {
        restart: order.asked.take_up.map(|(_, told)| told.clone()),
        time: far.borrow().told(outcome.time).filter(|_| outcome.ended == Ended::Completed),
        overridden: Overridden::of(&events, outcome.time.0),
    };
    write_down(
        order,
        program,
        &folder,
        (&outcome, driven.as_ref(), &course),
        (&record, &gaps),
        (&rebuild, &printed, &recorded),
    )?;
    let mut written = ["as-executed.stpnc", "report.json", "report.html"]
        .map(|name| folder.join(name))
        .to_vec();
    if matches!(order.work, Work::Live(_)) {
        written.push(program.path.clone());
    }
    if !printed.lines.is_empty() {
        let path = folder.join(printed::FILE);
        files::write(&path, &printed.bytes)?;
        written.push(path);
    }
    directory.keep_files(job.id, &written, end).map_err(shop::failure)?;

    let ending = if outcome.ended == Ended::Completed {
        Ending::Done
    } else {
        Ending::Failed
    };
    directory.end_job(job.id, end, ending).map_err(shop::failure)?;
    Ok(Run {
        outcome,
        record,
        gaps,
        rebuild,
        printed,
        driven,
        course,
        folder,
    })
}

/// Only positions and times are left, as in an agent's stream; what the machine knew about steps and offsets is gone. What is before
/// `begins` is the way to where a program is taken up.
fn as_an_agent_saw_it(record: &mut Recording, thinned: &Thinned, begins: Timestamp) {
    let point = |(k, o): (usize, &cell::observe::Observation)| RecordPoint {
        at: o.at,
        position: o.position,
        step: StepId::NONE,
        sequence: k as u64 + 1,
    };
    let seen = thinned.observations.iter().enumerate();
    record.points = seen.map(point).filter(|point| point.at >= begins).collect();
    record.frame = RecordFrame::Machine;
    record.events.clear();
}

/// Keeps the events so far; called with the machine's time now and then.
type Keep<'a> = dyn FnMut(Timestamp, &[Event]) -> Result<(), Failure> + 'a;

/// The program, from where it is taken up.
fn stream_of<'a>(order: &'a Order<'_>, program: &Program) -> Result<Box<dyn ProgramStream + 'a>, Failure> {
    let whole = cell::faults::planted(program.stream(&order.tables)?, &order.faults);
    Ok(match order.asked.take_up {
        Some((take_up, _)) => Box::new(take_up.stream(whole)?),
        None => whole,
    })
}

fn execute(
    order: &Order<'_>,
    far: &RefCell<Foresight<'_>>,
    rows: &mut RunRows<'_>,
    keep: &mut Keep<'_>,
) -> Result<(Outcome, Option<Driven>), Failure> {
    let source: Box<dyn CommandSource + '_> = match order.work {
        Work::Program(program) => {
            let stream = stream_of(order, program)?;
            Box::new(Trajectory::new(stream, order.tables.position, shop::limits(order.machine)))
        }
        Work::Live(job) => Box::new(job.source(order.tables.position, shop::limits(order.machine))),
    };
    match order.drives {
        Drives::World => execute_here(order, source, far, rows, keep).map(|outcome| (outcome, None)),
        Drives::Behind(remote, machine) => {
            execute_there(order, (remote, machine), source, far, rows, keep).map(|(outcome, driven)| (outcome, Some(driven)))
        }
    }
}

/// What the functions of the program come to; operations of a live job have none.
fn functions_of(order: &Order<'_>) -> Result<Found, Failure> {
    match order.work {
        Work::Program(program) => Ok(functions::look_at(&mut *stream_of(order, program)?, program)),
        Work::Live(_) => Ok(Found::default()),
    }
}

/// Somebody stands at the simulated machine: a program stop gets its cycle start after a second.
fn operator(drives: Drives<'_>) -> Operator {
    Operator {
        optional_stop: false,
        cycle_start_after: drives.is_simulated().then_some(1000),
    }
}

/// In the simulated world of this process.
fn execute_here(
    order: &Order<'_>,
    source: Box<dyn CommandSource + '_>,
    far: &RefCell<Foresight<'_>>,
    rows: &mut RunRows<'_>,
    keep: &mut Keep<'_>,
) -> Result<Outcome, Failure> {
    let config = WorldConfig {
        seed: order.seed,
        start: order.start,
        machine: shop::parameters(order.machine),
        machine_name: order.machine.name.clone(),
        position: order.tables.position,
        program_hash: order.work.hash(),
        faults: order.faults.clone(),
        operator: operator(order.drives),
        chain: Chain::default(),
    };
    let found = functions_of(order)?;
    let recorder = Functions::new(&config.machine, order.start, functions::known(order), &found);
    let diameters = functions::diameters(&order.tables);
    let world = World::new(config, source).map_err(|e| Failure::unreadable(format_args!("{}: {e}", order.machine.name)))?;
    let mut world = world
        .with_functions(&found, recorder, &diameters)
        .with_start(started_from(order));
    if let Some(overrides) = order.asked.overriding.constant {
        world.request(Request::Override(overrides));
    }
    let mut script = order.asked.overriding.script.iter().copied().peekable();
    let mut progress = Progress::new("running");
    let mut kept = 0;
    let mut stop_asked = false;
    let began = Instant::now();
    // As a controller is looked at; what waits for operations waits in real time.
    let stretch = if order.fast { 100 } else { 20 };
    loop {
        while let Some((_, act)) = script.next_if(|(at, _)| *at <= world.now()) {
            do_act(&mut world, act, operator(order.drives));
        }
        // Up to the next whole stretch, or what comes before it.
        let until = stretch - world.now().0 % stretch;
        let until = script.peek().map_or(until, |(at, _)| until.min(*at - world.now()));
        let outcome = world.advance(until, rows);
        let path_length = world.realtime().controller().path_length();
        far.borrow_mut().at(world.now(), rows.last.as_ref(), path_length);
        // A changed offset is kept before the machine goes on; everything else once in a second.
        let changed = rows.events[kept..].iter().any(|event| event.kind == "register");
        if changed || outcome.is_some() || world.now().0 % 1000 == 0 {
            kept = rows.events.len();
            keep(order.start.at(world.now()), &rows.events)?;
        }
        if let Some(outcome) = outcome {
            return Ok(outcome);
        }
        if let Work::Live(job) = order.work {
            if let Some(sample) = rows.last {
                job.watch_sample(&sample);
            }
            while let Some(request) = job.request() {
                world.request(request);
            }
        }
        if !stop_asked && order.stop.is_some_and(|stop| stop.load(Relaxed)) {
            stop_asked = true;
            world.request(Request::Stop);
        }
        let simulated = world.now().seconds();
        progress.at(|| format!("{}{} of machine time", far.borrow().words(), minutes(simulated.0)));
        if !order.fast {
            let due = Duration::from_secs_f64(simulated.0);
            std::thread::sleep(due.saturating_sub(began.elapsed()));
        }
    }
}

/// Turns or presses what a script says.
fn do_act<S: CommandSource>(world: &mut World<'_, S>, act: Act, operator: Operator) {
    match act {
        Act::Turn(overrides) => world.request(Request::Override(overrides)),
        Act::Hold => {
            // Who has pressed hold stands there until cycle start is pressed.
            world.attended_by(Operator {
                cycle_start_after: Some(u64::MAX),
                ..operator
            });
            world.request(Request::Hold);
        }
        Act::Resume => {
            world.attended_by(operator);
            world.request(Request::CycleStart);
        }
    }
}

/// On a machine behind the link.
fn execute_there(
    order: &Order<'_>,
    (remote, machine): (&Remote, &Machine),
    source: Box<dyn CommandSource + '_>,
    far: &RefCell<Foresight<'_>>,
    rows: &mut RunRows<'_>,
    keep: &mut Keep<'_>,
) -> Result<(Outcome, Driven), Failure> {
    let never = AtomicBool::new(false);
    let found = functions_of(order)?;
    let parameters = shop::parameters(order.machine);
    let recorder = Functions::new(&parameters, order.start, functions::known(order), &found).on_a_machine_that_goes_on();
    let tools = functions::diameters(&order.tables).into_iter();
    let tools = tools.map(|(tool, diameter)| Load::Tool { tool, diameter });
    let conditions = found
        .conditions
        .iter()
        .map(|(line, compiled)| Load::condition(line, compiled));
    let office = OfficeHalf::new(source, operator(order.drives), order.start, Chain::default()).with_functions(recorder);
    let (program, name) = (order.work.hash().to_string(), machine.name.clone());
    let live = match order.work {
        Work::Program(_) => None,
        Work::Live(job) => Some(job),
    };
    let drive = driving::Drive {
        remote,
        stop: order.stop.unwrap_or(&never),
        requests: &|| live.and_then(LiveJob::request),
        loads: tools.chain(conditions).collect(),
        overrides: order.asked.overriding.constant,
        approach: order.asked.approach,
        far,
        watch: &|report: &Report| {
            if let Some(job) = live {
                job.watch(report);
            }
        },
    };
    let seed = order.seed;
    let mut started = cell::events::Detail::from([
        ("program_sha256".to_owned(), program.into()),
        ("seed".to_owned(), seed.into()),
        ("machine".to_owned(), name.into()),
        ("source".to_owned(), driving::source_word(machine.quality).into()),
        ("controller".to_owned(), remote.address.to_string().into()),
    ]);
    started.extend(started_from(order));
    let mut kept = 0;
    driving::run(&drive, office, started, rows, &mut |now, rows, last| {
        let changed = rows.events[kept..].iter().any(|event| event.kind == "register");
        if changed || last || now.0 % 1000 < 100 {
            kept = rows.events.len();
            keep(order.start.at(now), &rows.events)?;
        }
        Ok(())
    })
}

/// What the first event of a run says of where it begins.
fn started_from(order: &Order<'_>) -> cell::events::Detail {
    let told = order.asked.take_up.and_then(|(_, told)| serde_json::to_value(told).ok());
    told.map(|told| ("taken_up".to_owned(), told)).into_iter().collect()
}

/// Says what happened to the recording, to the person and to the log. A full disk does not stop the machine: the part is worth more than
/// its record, and the record tells of the gap.
fn tell_notices(directory: &mut DataDirectory, watch: &Watch, now: Timestamp) -> Result<(), Failure> {
    for notice in watch.take_notices() {
        eprintln!("notice: {notice}");
        // A full disk may refuse the log as well; the person was told, and the record tells of its gaps itself.
        if let Err(error) = directory.append(now, notice.kind(), notice.detail())
            && !matches!(notice, Notice::Stopped(_))
        {
            return Err(shop::failure(error));
        }
    }
    Ok(())
}

/// Takes samples to the recording and keeps the events.
struct RunRows<'p> {
    recording: Recorder<SampleRows>,
    events: Vec<Event>,
    thinned: Option<Thinned>,
    part: Option<&'p mut Part>,
    last: Option<Sample>,
    values: Values,
}

impl RecordSink for RunRows<'_> {
    fn sample(&mut self, sample: &Sample) {
        self.last = Some(*sample);
        match self.recording.offer(sample) {
            // A missed row is counted in a gap that the record, the log and the report tell of.
            Offered::Taken | Offered::Missed => {}
        }
        if let Some(thinned) = &mut self.thinned {
            thinned.sample(sample);
        }
        if let Some(part) = &mut self.part {
            part.sample(sample);
        }
    }
    fn event(&mut self, event: &Event) {
        self.events.push(event.clone());
        if let Some(part) = &mut self.part {
            part.event(event);
        }
    }
    fn recorded(&mut self, row: &Row, stream: &Stream) {
        self.values.take(row, stream);
    }
    fn truth(&mut self, sample: &Sample, position: [f64; 3]) {
        if let Some(part) = &mut self.part {
            part.truth(sample, position);
        }
    }
}

fn rebuild(
    order: &Order<'_>,
    (program, tables): (&Program, &Tables),
    record: &Recording,
    outcome: &Outcome,
) -> Result<Rebuild, Failure> {
    let mut stream = program.stream(tables)?;
    if let Some((take_up, _)) = order.asked.take_up {
        // Held against what was to be run: what was left out is not missing, and the way in is nobody's path.
        stream = Box::new(take_up.stream(stream)?.without_the_way_in());
    }
    let options = PlanOptions {
        rapid: shop::limits(order.machine).v_max,
        ..PlanOptions::default()
    };
    let plan = PlannedProgram::read(&mut *stream, &program.name, &options, &mut crate::survey::beforehand);
    let options = asrun::Options {
        name: "run 1".to_owned(),
        tolerance: order.tolerance,
        ..asrun::Options::default()
    };
    let mut rebuild = asrun::rebuild(Some(&plan), record, &options);
    rebuild.report.findings.splice(0..0, order.found.clone());
    if let Some((_, told)) = order.asked.take_up {
        let lines = std::iter::once(told.line()).chain(told.left_out_line());
        rebuild.report.findings.splice(0..0, lines);
    }
    if outcome.ended != Ended::Completed {
        let text = outcome.ended.text();
        rebuild
            .report
            .findings
            .insert(0, format!("the run did not come to its end: {text}"));
        rebuild.executed.exception = Some(text);
    }
    Ok(rebuild)
}

fn write_down(
    order: &Order<'_>,
    program: &Program,
    folder: &Path,
    (outcome, driven, course): (&Outcome, Option<&Driven>, &Course),
    (record, gaps): (&Finished, &[Gap]),
    (rebuild, printed, recorded): (&Rebuild, &Printed, &[Recorded]),
) -> Result<(), Failure> {
    let options = TwinOptions {
        machine: Some((
            order.machine.name.clone(),
            if order.drives.is_simulated() { "simulated" } else { "" }.to_owned(),
        )),
        operator: Some(order.who.to_owned()),
        ..TwinOptions::at(order.start.at(outcome.ticks))
    };
    let bytes = as_executed(program, &rebuild.executed, &options)?;
    files::write(&folder.join("as-executed.stpnc"), &bytes)?;
    let page = Page {
        program: &program.name,
        machine: &order.machine.name,
        driven,
        course: Some(course),
        ended: Some(outcome.ended.text()),
        provenance: vec![
            ("program SHA-256".into(), program.hash.to_string()),
            ("record SHA-256".into(), record.hash.to_string()),
            ("record".into(), record_line(record, gaps)),
            ("end of the event chain".into(), outcome.chain.hash.to_string()),
            ("seed".into(), order.seed.to_string()),
            ("start".into(), clock::utc(order.start)),
            ("run by".into(), order.who.to_owned()),
        ],
        report: &rebuild.report,
        printed,
        recorded,
    };
    report::write(&page, folder)
}

/// The record in a line, with every gap.
fn record_line(record: &Finished, gaps: &[Gap]) -> String {
    let mut line = format!("record.parquet, {} rows", record.rows);
    for gap in gaps {
        line.push_str("; ");
        line.push_str(&gap.to_string());
    }
    line
}

/// The as-executed STEP-NC of a run: added to its plan, or a file of its own when the program is not STEP-NC.
///
/// # Errors
/// The run does not fit the plan's file.
pub fn as_executed(program: &Program, run: &AsExecuted, options: &TwinOptions) -> Result<Vec<u8>, Failure> {
    match program.step_nc() {
        Some(plan) => {
            let saved = stepnc::twin::append(plan, run, options).map_err(|e| Failure::negative(format_args!("error: {e}")))?;
            saved.notices.iter().for_each(|notice| eprintln!("notice: {notice}"));
            Ok(saved.bytes)
        }
        None => stepnc::write_new(run, options).map_err(|e| Failure::negative(format_args!("error: {e}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cell::sim::measure::{Feature, Gauge};

    /// One data directory, one lathe whose T words call O9000.
    struct Shop {
        folder: tempfile::TempDir,
        machine: MachineFile,
    }

    impl Shop {
        fn new() -> Shop {
            let text = format!(
                "{}\n[control_parameters]\n\"6001.5\" = 1\n",
                include_str!("../../store/machines/sim-lathe.toml")
            );
            Shop {
                folder: tempfile::tempdir().expect("a folder"),
                machine: MachineFile::parse(&text, "lathe.toml").expect("a machine"),
            }
        }

        /// Turns one seat and puts it on the gauge: its true diameter, mm.
        fn turned(&self, head: &str, name: &str) -> f64 {
            let write = |file: &str, text: &str| {
                let path = self.folder.path().join(file);
                std::fs::write(&path, text).expect("written");
                path
            };
            // The macro: an entry of a measured size becomes wear of the offset that the T word names, before the turret indexes.
            write(
                "O9000.nc",
                "%\nO9000\nIF[#501EQ#0]GOTO9\nIF[#501EQ0]GOTO9\n#101=#501\n#501=0\n#102=2000+[#149-FIX[#149/100]*100]\n\
                 #[#102]=#[#102]+[40.000-#101]\nN9T#149\nM99\n%\n",
            );
            let seat = "T0303\nG97 S2400 M3\nG0 X42. Z1.\nX40.\nG1 Z-6. F0.3\nU1.\nG0 Z1.\nM5\nM30\n%\n";
            let path = write("seat.nc", &format!("%\nO40(SEAT)\nG21 G18 G40 G99\nG50 S3000\n{head}{seat}"));
            let mut directory = DataDirectory::open(&self.folder.path().join("data"), "test").expect("free");
            let start = Timestamp(1_795_132_800_000_000_000);
            directory.take_over(&self.machine, "Maria", start).expect("taken over");
            let mut program = Program::open(&path, None, Some(&self.machine)).expect("a program");
            program.variables = directory.variables(&self.machine).expect("reads");
            let order = Order {
                work: Work::Program(&program),
                machine: &self.machine,
                tables: directory.tables(&self.machine).expect("reads"),
                seed: 1,
                start,
                faults: vec![],
                thinned: None,
                out: Some(&self.folder.path().join(name)),
                tolerance: None,
                fast: true,
                who: "Maria",
                drives: Drives::World,
                stop: None,
                person: serde_json::json!({ "level": 1 }),
                found: None,
                asked: Asked::default(),
            };
            let feature = Feature::TurnedDiameter {
                z_from: Millimetres(-5.0),
                z_to: Millimetres(-1.0),
            };
            let mut part = Part::new(feature, &[]);
            let done = super::run(&order, &mut directory, Some(&mut part)).expect("runs");
            assert_eq!(done.outcome.ended, Ended::Completed);
            let reading = part.measure(&mut Gauge::new(Millimetres(0.0), 1));
            reading.expect("something was cut").true_value.0
        }
    }

    #[test]
    fn a_macro_that_the_t_word_calls_changes_the_diameter_that_is_turned() {
        let shop = Shop::new();
        let first = shop.turned("", "one");
        let sized = shop.turned("#501=40.100\n", "two");
        let next = shop.turned("", "three");
        println!("{first:.4} {sized:.4} {next:.4}");
        assert!((first - 40.0).abs() < 0.01, "{first}");
        assert!((first - sized - 0.1).abs() < 0.002, "{first} -> {sized}");
        assert!(
            (sized - next).abs() < 0.002,
            "the wear is there, and the entry was taken once: {sized} -> {next}"
        );
    }
}

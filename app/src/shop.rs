//! What a run stands on: the machine with its limits and plant, the data directory, and who stands behind it.

use crate::cli::Common;
use crate::clock;
use crate::failure::{Exit, Failure};
use crate::people::{self, Acting};
use machine::MachineParameters;
use motion::Limits;
use plan::Tables;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use store::{DataDirectory, Ending, MachineFile, StoreError};
use units::{Axis, Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Timestamp};

/// A blend may leave the path this far where the program does not say.
pub const DEFAULT_PATH_TOLERANCE: Millimetres = Millimetres(0.01);

/// A failure of the store, with its own exit code.
pub fn failure(error: StoreError) -> Failure {
    let exit = match error.exit_code() {
        1 => Exit::Negative,
        2 => Exit::Usage,
        3 => Exit::Unreadable,
        // What the store calls a fault of ours is one: let the panic hook say so.
        70 => panic!("{error}"),
        _ => Exit::Machine,
    };
    let message = match error {
        // It is a diagnostic, which says itself how bad it is.
        StoreError::MachineFile(found) => found.to_string(),
        error => format!("error: {error}"),
    };
    Failure { exit, message }
}

/// Speed, acceleration and jerk of the axes, for the planner. An axis that the machine does not have does not limit.
pub fn limits(machine: &MachineFile) -> Limits {
    let of = |read: fn(&store::machine_file::AxisFile) -> f64| Axis::ALL.map(|a| machine.axis(a).map_or(1e6, read));
    Limits {
        v_max: of(|a| a.v_max.0).map(MmPerSec),
        a_max: of(|a| a.a_max.0).map(MmPerSec2),
        j_max: Some(of(|a| a.j_max.0).map(MmPerSec3)),
        tolerance: DEFAULT_PATH_TOLERANCE,
    }
}

/// What the realtime half and the simulated iron need to know of a machine file.
pub fn parameters(machine: &MachineFile) -> MachineParameters {
    machine.parameters()
}

/// Where the data directory is that the settings mean.
///
/// # Errors
/// Nothing says where it is.
pub fn data_path(common: &Common) -> Result<PathBuf, Failure> {
    match &common.data {
        Some(given) => Ok(given.clone()),
        None => store::data_directory_path(None, |name| std::env::var_os(name)).map_err(failure),
    }
}

/// Opens the data directory that the settings mean, to work in it, and says which jobs a power loss ended.
///
/// # Errors
/// It cannot be opened, or another process holds it.
pub fn data_directory(common: &Common) -> Result<DataDirectory, Failure> {
    open_data(&data_path(common)?, common)
}

/// Opens a data directory to work in it. Who does, and with which command, is told in its log.
///
/// # Errors
/// It cannot be opened, or another process holds it.
pub fn open_data(root: &Path, common: &Common) -> Result<DataDirectory, Failure> {
    let at = clock::start_time(common.start.as_deref())?;
    let command = command_word();
    let holder = format!("toolmark {command}");
    let mut directory = patiently(|| DataDirectory::open(root, holder.trim()))?;
    let opener = Acting::of(&directory, common)?.opener();
    directory.opened(at, &opener, &command).map_err(failure)?;
    say_log_problem(&directory);
    let left = directory.recover_interrupted().map_err(failure)?;
    for (job, recovery) in left.of_jobs_over {
        notice(&match recovery {
            Ok(recovery) => format!("job {job} could not keep its recording when it ended; {recovery}"),
            Err(error) => format!("job {job} left a recording, and no record could be made of it yet: {error}"),
        });
    }
    for interrupted in left.interrupted {
        notice(&interrupted.to_string());
        let job = &interrupted.job;
        if interrupted.not_recovered.is_some() {
            // It stays on the list, and its recording where it is, until there is room for a record of it.
            continue;
        }
        let last = interrupted.last_event.as_ref().map_or(job.start, ledger::Event::at);
        let recorded = interrupted.recovery.as_ref().filter(|_| interrupted.is_recording);
        let recorded = recorded
            .and_then(|recovery| recovery.last_us)
            .map(|us| Timestamp(us.saturating_mul(1000)));
        let last = recorded.map_or(last, |recorded| last.max(recorded));
        // Said once: from here on the job is over.
        directory.end_job(job.id, last, Ending::Interrupted).map_err(failure)?;
    }
    Ok(directory)
}

/// Before something is recorded: removes rows that are older than the machine file allows, and says so.
///
/// # Errors
/// The disk refuses.
pub fn retain(directory: &mut DataDirectory, machine: &MachineFile, now: Timestamp) -> Result<(), Failure> {
    let retained = directory.retain(&machine.retention, now).map_err(failure)?;
    for removal in &retained.removed {
        let (path, why) = (removal.record.path.display(), &removal.why);
        let left = if directory.rollup_path(&removal.record).exists() {
            "what its rows came to is kept"
        } else {
            "a recording of observations has no roll-up: its catalogue row is what is left of it"
        };
        notice(&format!("{path} was removed, {why}; {left}"));
    }
    for (record, why) in &retained.left {
        let path = record.path.display();
        eprintln!("warning: {path} is too old, but what its rows come to cannot be kept, so it stays: {why}");
    }
    Ok(())
}

/// Opens a data directory, or a backup of one, to look at it. Interrupted jobs are said, and stay what they are.
///
/// # Errors
/// There is none, a process works in it, or it cannot be read.
pub fn read_data(root: &Path) -> Result<DataDirectory, Failure> {
    let directory = patiently(|| DataDirectory::read(root))?;
    say_log_problem(&directory);
    let interrupted = directory.interrupted_jobs().map_err(failure)?;
    interrupted.iter().for_each(|job| notice(&job.to_string()));
    Ok(directory)
}

/// The data directory that the settings mean, to look at it; `None` where there is none. Changes nothing.
///
/// # Errors
/// A process works in it, or it cannot be read.
pub fn directory_to_look(common: &Common) -> Result<Option<DataDirectory>, Failure> {
    // Without a place for data there is none.
    let Ok(root) = data_path(common) else {
        return Ok(None);
    };
    if !root.join("toolmark.sqlite").is_file() {
        return Ok(None);
    }
    let directory = patiently(|| DataDirectory::read(&root))?;
    say_log_problem(&directory);
    Ok(Some(directory))
}

/// A command that only sets a value holds the data directory for a few milliseconds: worth waiting for. A longer holder is told.
fn patiently(open: impl Fn() -> Result<DataDirectory, StoreError>) -> Result<DataDirectory, Failure> {
    let began = std::time::Instant::now();
    loop {
        match open() {
            Err(StoreError::Locked { address: None, .. }) if began.elapsed() < LONGEST_WAIT => {
                std::thread::sleep(std::time::Duration::from_millis(20));
            }
            opened => return opened.map_err(failure),
        }
    }
}

/// How long a command waits for another one to leave the data directory.
const LONGEST_WAIT: std::time::Duration = std::time::Duration::from_secs(2);

/// What a program meets on a machine now: its tools and offsets, and the variables that its control has kept.
pub struct InForce {
    /// Tools and offsets.
    pub tables: Tables,
    /// #500 and on.
    pub variables: BTreeMap<u32, f64>,
    /// Where they come from, for people.
    pub source: String,
}

/// The offsets in force: of the data directory, where there is one; else those of the machine file. Changes nothing.
///
/// # Errors
/// A process works in the data directory, or it cannot be read.
pub fn in_force(common: &Common, machine: &MachineFile) -> Result<InForce, Failure> {
    match directory_to_look(common)? {
        Some(directory) => Ok(InForce {
            tables: directory.tables(machine).map_err(failure)?,
            variables: directory.variables(machine).map_err(failure)?,
            source: format!("offsets in force, from {}", directory.root().display()),
        }),
        None => Ok(InForce {
            tables: store::registers::tables(machine, &BTreeMap::new()).map_err(failure)?,
            variables: BTreeMap::new(),
            source: format!("offsets of the machine file of {}: there is no data directory", machine.name),
        }),
    }
}

/// From here on a data directory is open, and the JSON answer has its notices.
fn say_log_problem(directory: &DataDirectory) {
    notices_lock().get_or_insert_default();
    if let Some(problem) = directory.wal_problem() {
        notice(&format!("the write-ahead log of the database: {problem}"));
    }
}

/// What was said about the data directory, for the JSON answer; `None` before one was opened.
static NOTICES: Mutex<Option<Vec<String>>> = Mutex::new(None);

/// Says something on stderr, and in the JSON answer under `notices`.
pub fn notice(text: &str) {
    eprintln!("notice: {text}");
    notices_lock().get_or_insert_default().push(text.to_owned());
}

/// What was said so far; `None` when the command opened no data directory and said nothing.
pub fn notices() -> Option<Vec<String>> {
    notices_lock().clone()
}

fn notices_lock() -> std::sync::MutexGuard<'static, Option<Vec<String>>> {
    // A panic of another thread is told by itself; the list is whole after each push.
    NOTICES.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The command, as the lock and the log name it: `run`, `trace list`.
fn command_word() -> String {
    // Words up to the first option: settings may stand before the command, and then its name is all there is to say.
    let words: Vec<String> = std::env::args().skip(1).take_while(|w| !w.starts_with('-')).take(1).collect();
    words.join(" ")
}

/// Who is named behind something that asks for no right: `--operator`, marked as claimed, else the user that the system signed in.
pub fn operator(common: &Common) -> String {
    let name = people::unchecked_name(common);
    let named = common.operator.as_deref().is_some_and(|name| !name.trim().is_empty());
    if named { format!("{name} (claimed)") } else { name }
}

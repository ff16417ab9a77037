//! What a run stands on: the machine with its limits and plant, the data directory, and who stands behind it.

use crate::cli::Common;
use crate::failure::{Exit, Failure};
use machine::MachineParameters;
use motion::Limits;
use std::path::Path;
use store::machine_file::MachineKind;
use store::{DataDirectory, Ending, MachineFile, StoreError};
use units::{Axis, Millimetres, MmPerSec, MmPerSec2, MmPerSec3};

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

/// Speed and acceleration of the axes, for the planner. An axis that the machine does not have does not limit.
pub fn limits(machine: &MachineFile) -> Limits {
    let of = |read: fn(&store::machine_file::AxisFile) -> f64| Axis::ALL.map(|a| machine.axis(a).map_or(1e6, read));
    Limits {
        v_max: of(|a| a.v_max.0).map(MmPerSec),
        a_max: of(|a| a.a_max.0).map(MmPerSec2),
        j_max: Some(of(|a| a.j_max.0).map(MmPerSec3)),
        tolerance: DEFAULT_PATH_TOLERANCE,
    }
}

/// The simulated iron of a machine file: its travels and limits on the drives of the built-in model.
pub fn parameters(machine: &MachineFile) -> MachineParameters {
    let mut parameters = match machine.kind {
        MachineKind::Mill => MachineParameters::small_machining_centre(),
        MachineKind::Lathe => MachineParameters::small_lathe(),
    };
    for (axis, model) in Axis::ALL.into_iter().zip(&mut parameters.axes) {
        if let Some(file) = machine.axis(axis) {
            (model.lowest, model.highest) = (file.travel_min, file.travel_max);
            (model.v_max, model.a_max) = (file.v_max, file.a_max);
            model.pulses_per_mm = file.pulses_per_mm;
        }
    }
    parameters.spindle.highest = machine.spindle.max;
    parameters.tool_change = machine.tool_change;
    parameters
}

/// Opens the data directory that the settings mean, and says which jobs a power loss ended.
///
/// # Errors
/// It cannot be opened, or another process holds it.
pub fn data_directory(common: &Common) -> Result<DataDirectory, Failure> {
    let root = match &common.data {
        Some(given) => given.clone(),
        None => store::data_directory_path(None, |name| std::env::var_os(name)).map_err(failure)?,
    };
    open_data(&root)
}

/// Opens a data directory.
///
/// # Errors
/// It cannot be opened, or another process holds it.
pub fn open_data(root: &Path) -> Result<DataDirectory, Failure> {
    let words: Vec<String> = std::env::args().take(2).collect();
    let holder = format!("toolmark {}", words.get(1).map_or("", String::as_str));
    let mut directory = DataDirectory::open(root, holder.trim()).map_err(failure)?;
    let left = directory.recover_interrupted().map_err(failure)?;
    for (job, recovery) in left.of_jobs_over {
        match recovery {
            Ok(recovery) => eprintln!("notice: job {job} could not keep its recording when it ended; {recovery}"),
            Err(error) => eprintln!("warning: job {job} left a recording, and no record could be made of it yet: {error}"),
        }
    }
    for interrupted in left.interrupted {
        eprintln!("notice: {interrupted}");
        let job = &interrupted.job;
        if interrupted.not_recovered.is_some() {
            // It stays on the list, and its recording where it is, until there is room for a record of it.
            continue;
        }
        let last = interrupted.last_event.as_ref().map_or(job.start, ledger::Event::at);
        // Said once: from here on the job is over.
        directory.end_job(job.id, last, Ending::Interrupted).map_err(failure)?;
    }
    Ok(directory)
}

/// Who stands behind a change: `--operator`, else the user that the system signed in.
pub fn operator(common: &Common) -> String {
    common.operator.clone().unwrap_or_else(|| {
        let user = std::env::var("USER")
            .or_else(|_| std::env::var("LOGNAME"))
            .unwrap_or_else(|_| "local".to_owned());
        format!("{user} (authenticated by the system)")
    })
}

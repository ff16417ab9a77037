//! A live job as its run and its session see it: the session adds operations, the run executes them, both know how far the other is.

use super::planner::{self, LiveSource, Steps};
use super::program::LivePlan;
use super::protocol::{Operation, Progress};
use crate::failure::Failure;
use crate::files;
use crate::program::Program;
use ledger::Hash;
use machine::{Report, Request, Sample};
use motion::Limits;
use plan::Tables;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use units::{Machine, Point, Timestamp};

/// A job whose operations come one at a time.
pub struct LiveJob {
    name: String,
    hash: Hash,
    steps: Steps,
    inside: Mutex<Inside>,
}

struct Inside {
    plan: LivePlan,
    requests: VecDeque<Request>,
    progress: Progress,
    ended: bool,
}

impl LiveJob {
    /// A job without operations.
    pub fn new(name: &str, client: &str, start: Timestamp, plan: LivePlan) -> LiveJob {
        LiveJob {
            name: format!("{name}.stpnc"),
            // The program is known when the job is over; until then it is this job of this client.
            hash: Hash::of(format!("live job {name} of {client} at {}", start.0).as_bytes()),
            steps: Steps::default(),
            inside: Mutex::new(Inside {
                plan,
                requests: VecDeque::new(),
                progress: Progress {
                    state: "ready".to_owned(),
                    operation: 0,
                    operations: 0,
                    time_s: 0.0,
                    position_mm: [0.0; 3],
                    worst_following_error_mm: 0.0,
                },
                ended: false,
            }),
        }
    }

    /// Its name in the data directory.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What stands for its program's hash until there is one.
    pub fn hash(&self) -> Hash {
        self.hash
    }

    /// Takes an operation; gives its number and how many steps it has.
    ///
    /// # Errors
    /// It cannot be done, or no more was to come.
    pub fn add(&self, operation: &Operation) -> Result<(usize, usize), String> {
        let mut inside = self.lock();
        if inside.ended {
            return Err("the job was said to be complete; begin a new one".to_owned());
        }
        let steps = inside.plan.add(operation)?;
        let count = steps.len();
        self.steps.give(steps);
        let number = inside.plan.operations();
        inside.progress.operations = number;
        Ok((number, count))
    }

    /// No more comes.
    ///
    /// # Errors
    /// There was no operation, or it was said before.
    pub fn end(&self) -> Result<(), String> {
        let mut inside = self.lock();
        if inside.ended {
            return Err("that was said before".to_owned());
        }
        let steps = inside.plan.finish()?;
        inside.ended = true;
        self.steps.give(steps);
        self.steps.end();
        Ok(())
    }

    /// The run is over: what is said now is not for it.
    pub fn close(&self) {
        self.lock().ended = true;
        self.steps.end();
    }

    /// True when no more comes, or nothing is wanted any more.
    pub fn is_over(&self) -> bool {
        self.lock().ended
    }

    /// Asks the machine for something.
    pub fn ask(&self, request: Request) {
        self.lock().requests.push_back(request);
    }

    /// What is asked of the machine next.
    pub fn request(&self) -> Option<Request> {
        self.lock().requests.pop_front()
    }

    /// The run hears of a cycle.
    pub fn watch(&self, report: &Report) {
        self.watch_sample(&report.sample);
        self.lock().progress.state = format!("{:?}", report.state);
    }

    /// The same where there is no report.
    pub fn watch_sample(&self, sample: &Sample) {
        let mut inside = self.lock();
        let progress = &mut inside.progress;
        progress.state = format!("{:?}", sample.phase);
        progress.operation = sample.workingstep.0;
        progress.time_s = sample.tick.seconds().0;
        progress.position_mm = sample.actual;
        for k in 0..3 {
            let error = (sample.commanded[k] - sample.actual[k]).abs();
            progress.worst_following_error_mm = progress.worst_following_error_mm.max(error);
        }
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        self.lock().progress.clone()
    }

    /// How many operations there are.
    pub fn operations(&self) -> usize {
        self.lock().plan.operations()
    }

    /// Begins to plan.
    pub fn source(&self, start: Point<Machine>, limits: Limits) -> LiveSource {
        planner::begin(&self.steps, start, limits)
    }

    /// Offsets of the machine, with the lengths of tools that came with operations.
    pub fn tables(&self) -> Tables {
        self.lock().plan.tables().clone()
    }

    /// The plan as a file in a folder, opened as any other.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn written(&self, folder: &Path) -> Result<Program, Failure> {
        // A planner that still waits is let go.
        self.steps.end();
        let inside = self.lock();
        let file = inside.plan.file();
        let file = file.ok_or_else(|| Failure::negative("error: no operation came, so there is no plan"))?;
        let path = folder.join("plan.stpnc");
        files::write(&path, &file.bytes)?;
        Program::open(&path, None, None)
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        // What panicked left the plan as it was before.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

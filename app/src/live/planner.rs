//! The planner of a live job, on a thread of its own: steps go in as operations come, commands come out while it waits for more.
//!
//! Where no more steps are there, the path comes to rest: the machine never stands in the middle of a path because the next operation has
//! not come yet.

use cell::{CommandSource, Output};
use motion::{Limits, Trajectory};
use plan::{Alarm, Answer, Diagnostic, FileId, Next, ProgramStream, Question, Step};
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use units::{Machine, Point};

/// Commands that are planned ahead at most, two seconds of motion: what is planned is not planned again when an override is turned.
const AHEAD: usize = 2000;
/// What the stream says when it has nothing more for now. It is answered in this file and never reaches a machine.
const MORE: &str = "the next operation of the live job";

/// Steps for the planner; given by the session, taken by the planning thread.
#[derive(Clone, Default)]
pub struct Steps(Arc<(Mutex<Waiting>, Condvar)>);

#[derive(Default)]
struct Waiting {
    steps: VecDeque<Step>,
    over: bool,
}

impl Steps {
    /// More to do.
    pub fn give(&self, steps: Vec<Step>) {
        self.lock().steps.extend(steps);
        self.0.1.notify_all();
    }

    /// No more comes.
    pub fn end(&self) {
        self.lock().over = true;
        self.0.1.notify_all();
    }

    /// Waits until there is something to do, or no more comes.
    fn wait(&self) {
        let waiting = self.lock();
        let nothing = |waiting: &mut Waiting| waiting.steps.is_empty() && !waiting.over;
        drop(self.0.1.wait_while(waiting, nothing));
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        // Each change is one call on the queue: it is whole whoever panicked.
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The planner's end of [`Steps`].
struct LiveStream(Steps);

impl ProgramStream for LiveStream {
    fn next(&mut self, _answer: Option<Answer>) -> Next {
        let mut waiting = self.0.lock();
        match waiting.steps.pop_front() {
            Some(step) => Next::Step(step),
            None if waiting.over => Next::End,
            None => Next::Ask(Question::Number(MORE.to_owned())),
        }
    }
    fn rewind(&mut self) {
        unreachable!("nobody can rewind a job that is still coming")
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "plan.stpnc"
    }
}

/// What comes out of the planner, for the office half.
pub struct LiveSource {
    outputs: Receiver<Output>,
    /// Looked at, and not taken yet.
    next: Option<Output>,
}

/// Begins to plan on a thread of its own. It ends when no more steps come, or when the source is dropped and the steps are at an end.
pub fn begin(steps: &Steps, start: Point<Machine>, limits: Limits) -> LiveSource {
    let (outputs, source) = sync_channel(AHEAD);
    let steps = steps.clone();
    std::thread::spawn(move || plan(&steps, start, limits, &outputs));
    LiveSource {
        outputs: source,
        next: None,
    }
}

fn plan(steps: &Steps, start: Point<Machine>, limits: Limits, outputs: &SyncSender<Output>) {
    let mut trajectory = Trajectory::new(Box::new(LiveStream(steps.clone())), start, limits);
    let mut answer = None;
    loop {
        let output = trajectory.next(answer.take());
        if matches!(&output, Output::Ask(Question::Number(what)) if what == MORE) {
            steps.wait();
            answer = Some(Answer::Unknown);
            continue;
        }
        let last = matches!(output, Output::End | Output::Alarm(_));
        // The source was dropped: nobody wants any more of it.
        if outputs.send(output).is_err() || last {
            return;
        }
    }
}

impl LiveSource {
    fn look(&mut self) {
        if self.next.is_some() {
            return;
        }
        self.next = match self.outputs.try_recv() {
            Ok(output) => Some(output),
            Err(TryRecvError::Empty) => None,
            // It says how it ended before it goes; without that it broke.
            Err(TryRecvError::Disconnected) => Some(Output::Alarm(Alarm::from(Diagnostic::error(
                "live-planner",
                "the planner of the live job ended without a word: this is a fault of toolmark",
            )))),
        };
    }
}

impl CommandSource for LiveSource {
    fn is_ready(&mut self) -> bool {
        self.look();
        self.next.is_some()
    }

    fn next(&mut self, _answer: Option<Answer>) -> Output {
        self.look();
        match self.next.take() {
            Some(output) => output,
            None => self.outputs.recv().unwrap_or(Output::End),
        }
    }

    fn file_name(&self, _file: FileId) -> &str {
        "plan.stpnc"
    }
}

//! A program as a conversation: the machine asks for the next step, the program may ask the machine something back.
//!
//! No reader collects its steps into a list: a program may be ten million blocks long, or endless, or decide by a measured value what
//! comes next. Everything that is not a question may be looked ahead.

use crate::{Alarm, Diagnostic, Expression, Feed, FileId, Modal, Step};
use std::fmt;
use thiserror::Error;
use units::{Point, Setup, StepId};

/// What a program says when asked for its next step.
#[derive(Clone, Debug, PartialEq)]
pub enum Next {
    /// Do this.
    Step(Step),
    /// Answer this first, when everything said before is done: a synchronisation point.
    Ask(Question),
    /// The program is over.
    End,
    /// The program cannot go on. Asking again gives the same alarm.
    Alarm(Alarm),
}

/// What a program can ask the machine.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// Is the optional-stop switch on? ([`Answer::Truth`])
    OptionalStop,
    /// Is this true now? ([`Answer::Truth`])
    Condition(Expression),
    /// What is the value of this variable or sensor now? ([`Answer::Number`])
    Number(String),
    /// On a straight move of the tip from here to there at this speed, where does the skip signal stop it? ([`Answer::Place`]; `None`
    /// when no signal comes on the way.) The move itself follows as a step that ends there. [`Answer::Unknown`]: there is no probe.
    Skip {
        /// Where the tip is.
        from: Point<Setup>,
        /// Where the program sends it.
        to: Point<Setup>,
        /// How fast.
        feed: Feed,
    },
}

/// The machine's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// A number; `None` when the thing exists and has no value now.
    Number(Option<f64>),
    /// True or false.
    Truth(bool),
    /// A place of the tip; `None` when what was asked for did not happen.
    Place(Option<Point<Setup>>),
    /// There is no machine yet: a look at a program before it runs. What depends on the answer is assumed, and the program says so.
    NotAsked,
    /// The machine does not know that: the program alarms, or goes on with its own count and says so.
    Unknown,
}

/// A program that is being read.
pub trait ProgramStream {
    /// The next thing. `answer` is `Some` just after a [`Next::Ask`], and only then.
    fn next(&mut self, answer: Option<Answer>) -> Next;

    /// Back to before the first step, as if just opened.
    fn rewind(&mut self);

    /// What was found wrong, odd or assumed up to here, one entry a kind.
    fn diagnostics(&self) -> &[Diagnostic];

    /// The name of a file that an [`crate::Origin`] speaks of.
    fn file_name(&self, file: FileId) -> &str;
}

/// Runs through a program without moving, so that its next step is `step`, and gives what is in force there.
///
/// Questions on the way are answered by `answer`: the record of the interrupted run knows what was answered then.
///
/// # Errors
/// The program ends or alarms before it comes to `step`.
pub fn restart_at(
    stream: &mut dyn ProgramStream,
    step: StepId,
    answer: &mut dyn FnMut(&Question) -> Answer,
) -> Result<Modal, RestartError> {
    stream.rewind();
    let mut modal = Modal::default();
    let mut reply = None;
    while modal.step.0 + 1 < step.0 {
        match stream.next(reply.take()) {
            Next::Step(done) => modal.follow(&done),
            Next::Ask(question) => reply = Some(answer(&question)),
            Next::End => return Err(RestartError::NoSuchStep { step, last: modal.step }),
            Next::Alarm(alarm) => return Err(RestartError::Alarm(Box::new(alarm))),
        }
    }
    Ok(modal)
}

/// Why a program cannot be taken up at a step.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RestartError {
    /// It is shorter than that.
    #[error("{step} does not exist: the program ends after {last}")]
    NoSuchStep {
        /// The step asked for.
        step: StepId,
        /// The program's last step.
        last: StepId,
    },
    /// It alarms before.
    #[error("the program does not come that far: {0}")]
    Alarm(Box<Alarm>),
}

/// The bytes of a program, read by position; a file in the shell, a slice in a test.
pub trait ByteSource {
    /// Number of bytes.
    fn length(&self) -> u64;
    /// Fills `buffer` from `offset` on and gives how many bytes there were; fewer than asked for only at the end.
    ///
    /// # Errors
    /// The file can no longer be read.
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, ReadError>;
}

/// A program's bytes could not be read; the text says why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError(pub String);

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
impl std::error::Error for ReadError {}

/// Finds the subprograms and referenced files of a program.
pub trait Resolver {
    /// The bytes of what the program calls `name` (`O9000`, `setup.stpnc`); `None` when there is no such thing.
    fn open(&mut self, name: &str) -> Option<Box<dyn ByteSource>>;
}

/// A resolver for programs that stand alone.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoOtherFiles;

impl Resolver for NoOtherFiles {
    fn open(&mut self, _name: &str) -> Option<Box<dyn ByteSource>> {
        None
    }
}

/// Bytes that are in memory anyway.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemorySource(pub Vec<u8>);

impl ByteSource for MemorySource {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, ReadError> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX).min(self.0.len());
        let count = buffer.len().min(self.0.len() - start);
        buffer[..count].copy_from_slice(&self.0[start..start + count]);
        Ok(count)
    }
}

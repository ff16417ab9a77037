//! Where the office half gets its commands: a planner over a program, or a job that is still being written.

use motion::Trajectory;
use plan::{Answer, FileId};

pub use motion::Output;

/// A stream of commands in order of execution.
pub trait CommandSource {
    /// The next thing. `answer` is `Some` just after an [`Output::Ask`], and only then.
    fn next(&mut self, answer: Option<Answer>) -> Output;

    /// False when there is nothing to give now and more may come: a live job whose next operation is not there yet. Not to be asked for
    /// the next thing then.
    fn is_ready(&mut self) -> bool {
        true
    }

    /// Plans what was not given out yet for these overrides, 1 is 100 %. A source that cannot leaves it: the machine never runs faster than
    /// what it is given, so nothing but time is lost.
    fn set_override(&mut self, _feed: f64, _rapid: f64) {}

    /// The name of a file that a step's origin speaks of; empty where there is none.
    fn file_name(&self, _file: FileId) -> &str {
        ""
    }
}

impl CommandSource for Trajectory<'_> {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        Trajectory::next(self, answer)
    }
    fn set_override(&mut self, feed: f64, rapid: f64) {
        Trajectory::set_override(self, feed, rapid);
    }
    fn file_name(&self, file: FileId) -> &str {
        self.stream().file_name(file)
    }
}

impl<S: CommandSource + ?Sized> CommandSource for Box<S> {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        (**self).next(answer)
    }
    fn is_ready(&mut self) -> bool {
        (**self).is_ready()
    }
    fn set_override(&mut self, feed: f64, rapid: f64) {
        (**self).set_override(feed, rapid);
    }
    fn file_name(&self, file: FileId) -> &str {
        (**self).file_name(file)
    }
}

impl<S: CommandSource + ?Sized> CommandSource for &mut S {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        (**self).next(answer)
    }
    fn is_ready(&mut self) -> bool {
        (**self).is_ready()
    }
    fn set_override(&mut self, feed: f64, rapid: f64) {
        (**self).set_override(feed, rapid);
    }
    fn file_name(&self, file: FileId) -> &str {
        (**self).file_name(file)
    }
}

/// What is planned already, played in order: a test's program, a transcript. Questions in it are asked, their answers ignored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planned {
    /// What is left to say.
    pub outputs: std::collections::VecDeque<Output>,
}

impl CommandSource for Planned {
    fn next(&mut self, _answer: Option<Answer>) -> Output {
        self.outputs.pop_front().unwrap_or(Output::End)
    }
}

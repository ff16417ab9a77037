//! Where the office half gets its commands: a planner over a program, or a job that is still being written.

use machine::Command;
use plan::{Alarm, Answer, Question, Step};

/// What a source says when asked to go on.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Do this next.
    Command(Command),
    /// A step that is no motion begins here: comes just before the commands it causes.
    Passed(Step),
    /// Answer this when everything before is done and the machine stands.
    Ask(Question),
    /// Nothing follows.
    End,
    /// The program cannot go on.
    Alarm(Alarm),
}

/// A stream of commands in order of execution.
pub trait CommandSource {
    /// The next thing. `answer` is `Some` just after an [`Output::Ask`], and only then.
    fn next(&mut self, answer: Option<Answer>) -> Output;
}

impl<S: CommandSource + ?Sized> CommandSource for Box<S> {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        (**self).next(answer)
    }
}

impl<S: CommandSource + ?Sized> CommandSource for &mut S {
    fn next(&mut self, answer: Option<Answer>) -> Output {
        (**self).next(answer)
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

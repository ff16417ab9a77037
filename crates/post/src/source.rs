//! Programs that are streams and nothing more, as structured programs: G-code and cutter-location files, whose control flow the
//! reader has decided. What the machine would have to decide is refused, unless the person wants the program as it runs without a machine.

use plan::flow::{Part, StructuredProgram};
use plan::{Alarm, Answer, Diagnostic, FileId, Next, Origin, Place, ProgramStream, Question, Step, StepKind, StopKind};
use units::StepId;

/// A stream as a program without structure.
pub struct Interpreted<S> {
    stream: S,
    /// Where the reader decided something that a program of another control would have to decide again; `None` as long as it did not.
    decided: fn(&S) -> Option<String>,
    as_interpreted: bool,
    reply: Option<Answer>,
    after_stop: bool,
}

impl<S: ProgramStream> Interpreted<S> {
    /// The program of a stream. `decided` tells of branches and loops that were decided while reading; with `as_interpreted` they and
    /// the machine's values are taken as they come without a machine.
    pub fn new(stream: S, decided: fn(&S) -> Option<String>, as_interpreted: bool) -> Self {
        Interpreted {
            stream,
            decided,
            as_interpreted,
            reply: None,
            after_stop: false,
        }
    }

    fn refused(&self, code: &'static str, what: String) -> Alarm {
        Alarm::from(
            Diagnostic::error(code, what).remedy(
                "post it from STEP-NC, whose conditions are kept, or post with --as-interpreted what the program does without a machine",
            ),
        )
    }
}

impl<S: ProgramStream> StructuredProgram for Interpreted<S> {
    fn next_part(&mut self) -> Result<Option<Part>, Alarm> {
        loop {
            let next = self.stream.next(self.reply.take());
            if !self.as_interpreted
                && let Some(what) = (self.decided)(&self.stream)
            {
                return Err(self.refused(
                    "control-flow",
                    format!("{what}: a branch of a macro would be decided here and not at the machine"),
                ));
            }
            match next {
                Next::Step(step) => return Ok(Some(Part::Step(step))),
                Next::Ask(Question::OptionalStop) => {
                    // It becomes an optional stop of the other control, whose switch decides.
                    self.reply = Some(Answer::Truth(false));
                    self.after_stop = true;
                    return Ok(Some(Part::Step(Step {
                        id: StepId(0),
                        origin: Origin {
                            file: FileId(0),
                            place: Place::Given,
                        },
                        kind: StepKind::Stop(StopKind::Optional),
                    })));
                }
                Next::Ask(Question::Skip { .. }) => {
                    return Err(Alarm::from(
                        Diagnostic::error(
                            "probing",
                            "the program probes (G31), and where it goes next is the probe's word",
                        )
                        .remedy("probe with the control's own cycles"),
                    ));
                }
                Next::Ask(question) => {
                    if !self.as_interpreted {
                        let what = match question {
                            Question::Number(name) => format!("the program asks the machine for {name}"),
                            other => format!("the program asks the machine: {other:?}"),
                        };
                        return Err(self.refused("asks-machine", what));
                    }
                    self.reply = Some(Answer::Unknown);
                }
                Next::End => return Ok(None),
                Next::Alarm(alarm) => return Err(alarm),
            }
        }
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.stream.diagnostics()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.stream.file_name(file)
    }
}

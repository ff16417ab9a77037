//! A program taken up at one of its steps: what is in force there is put in force again in the order a person would do it, and the tool
//! comes to the path from where it is free.
//!
//! Order: away from the part, tool, frame, offset, spindle, coolant, what lies open of the structure; then across, close to the part, and with
//! a feed onto the path. What is put in has the number of the step before and is marked `derived` where a step can be. Who may restart a
//! program is for the caller to check.

use plan::{
    Answer, Diagnostic, Feed, FileId, MachineMove, Modal, Move, Next, Origin, Path, Place, ProgramStream, Question, Speed, Step,
    StepKind, restart_at, stream::RestartError,
};
use std::collections::VecDeque;
use units::{Machine, Millimetres, MmPerSec, Point, StepId, Transform};

/// How the tool comes back to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// The axis that takes the tool away from the part: 2 (Z) on a mill, 0 (X) on a lathe.
    pub axis: usize,
    /// Where that axis is free of everything, machine frame: the gauge point goes there first.
    pub free: Millimetres,
    /// How far before the path the rapid ends, in the direction of that axis.
    pub clearance: Millimetres,
    /// Feed from there onto the path.
    pub feed: MmPerSec,
}

/// A program that begins at one of its steps.
pub struct Restarted<'a> {
    inner: Box<dyn ProgramStream + 'a>,
    at: StepId,
    ready: VecDeque<Step>,
}

impl<'a> Restarted<'a> {
    /// Takes `program` up at a step. Questions of what was run already are answered by `answer`.
    ///
    /// # Errors
    /// The program has no such step, or does not come that far.
    pub fn new(
        mut program: Box<dyn ProgramStream + 'a>,
        at: StepId,
        approach: Approach,
        answer: &mut dyn FnMut(&Question) -> Answer,
    ) -> Result<Self, RestartError> {
        let mut modal = restart_at(&mut *program, at, answer)?;
        let mut restarted = Restarted {
            inner: program,
            at,
            ready: VecDeque::new(),
        };
        restarted.restore(&modal, approach);
        // The approach is to the first move: what comes before that is put in force first.
        let mut reply = None;
        loop {
            match restarted.inner.next(reply.take()) {
                Next::Step(step) => {
                    if let StepKind::Move(first) = &step.kind {
                        restarted.approach(&modal, first.path.start(), approach);
                    }
                    let moves = matches!(step.kind, StepKind::Move(_) | StepKind::MachineMove(_));
                    modal.follow(&step);
                    restarted.ready.push_back(step);
                    if moves {
                        return Ok(restarted);
                    }
                }
                Next::Ask(question) => reply = Some(answer(&question)),
                Next::End => return Ok(restarted),
                Next::Alarm(alarm) => return Err(RestartError::Alarm(alarm.into())),
            }
        }
    }

    fn put(&mut self, kind: StepKind) {
        self.ready.push_back(Step {
            id: StepId(self.at.0.saturating_sub(1)),
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            kind,
        });
    }

    fn restore(&mut self, modal: &Modal, approach: Approach) {
        self.put(away(approach));
        if let Some(tool) = &modal.tool {
            self.put(StepKind::Tool(tool.clone()));
        }
        if let Some(frame) = &modal.frame {
            self.put(StepKind::Frame(frame.clone()));
        }
        self.put(StepKind::ToolOffset(modal.tool_offset));
        self.put(StepKind::PathMode(modal.path_mode));
        self.put(StepKind::Spindle(modal.spindle));
        self.put(StepKind::Coolant(modal.coolant));
        for marker in &modal.open {
            self.put(StepKind::Begin(marker.clone()));
        }
    }

    /// Across, close to the part, onto the path.
    fn approach(&mut self, modal: &Modal, start: Point<units::Setup>, approach: Approach) {
        let machine_from_setup = modal.frame.as_ref().map_or(Transform::IDENTITY, |f| f.machine_from_setup);
        let offset = modal.tool_offset.total();
        let there: Point<Machine> = machine_from_setup * start + offset;
        let mut before = there.xyz;
        before[approach.axis] += approach.clearance.0;
        self.put(StepKind::MachineMove(MachineMove {
            to: std::array::from_fn(|k| (k != approach.axis).then_some(Millimetres(there.xyz[k]))),
        }));
        self.put(StepKind::MachineMove(MachineMove {
            to: std::array::from_fn(|k| (k == approach.axis).then_some(Millimetres(before[k]))),
        }));
        self.put(StepKind::Move(Move {
            path: Path::Line {
                from: machine_from_setup.inverse() * (Point::<Machine>::from_xyz(before) + -offset),
                to: start,
            },
            speed: Speed::Feed(Feed::PerTime(approach.feed)),
            profile: None,
            derived: true,
        }));
    }
}

fn away(approach: Approach) -> StepKind {
    StepKind::MachineMove(MachineMove {
        to: std::array::from_fn(|k| (k == approach.axis).then_some(approach.free)),
    })
}

impl ProgramStream for Restarted<'_> {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        match self.ready.pop_front() {
            Some(step) => Next::Step(step),
            None => self.inner.next(answer),
        }
    }

    /// To the beginning of the whole program: a restart is made once.
    fn rewind(&mut self) {
        self.ready.clear();
        self.inner.rewind();
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.inner.diagnostics()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.inner.file_name(file)
    }
}

//! A program taken up at one of its steps: what is in force there is put in force again in the order a person would do it, and the tool
//! comes to the path from where it is free.
//!
//! Order: away from the part, tool, frame, offset, spindle, coolant, what lies open of the structure, functions that were begun before; then
//! what the program itself says before its first move; then across, close to the part, and with a feed onto the path. What the program says
//! itself before that move (its tool, its spindle speed) is not put in before it. What is put in has the number of the step before and is
//! marked `derived` where a step can be. Who may restart a program is for the caller to check.

use plan::{
    Answer, Diagnostic, Feed, FileId, MachineMove, Modal, Move, Next, Origin, Path, Place, ProgramStream, Question,
    RawNcFunction, Speed, Step, StepKind, restart_at, stream::RestartError,
};
use std::collections::VecDeque;
use units::{Machine, Millimetres, MmPerSec, Point, StepId, ToolNumber, Transform};

/// How the tool comes back to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// The axis that takes the tool away from the part: 2 (Z) on a mill, 0 (X) on a lathe.
    pub axis: usize,
    /// Where that axis is free of everything, machine frame: the gauge point goes there first. When the path itself begins further out, it
    /// goes that far.
    pub free: Millimetres,
    /// How far before the path the rapid ends, in the direction of that axis; less where the axis would have to go beyond `free`.
    pub clearance: Millimetres,
    /// Feed from there onto the path.
    pub feed: MmPerSec,
}

/// A program that begins at one of its steps.
pub struct Restarted<'a> {
    inner: Box<dyn ProgramStream + 'a>,
    /// What comes before the rest of the program.
    first: Vec<Step>,
    ready: VecDeque<Step>,
    in_force: Modal,
    /// Answers to what the program asked up to there: it goes the same way again.
    answers: Vec<Answer>,
    /// The last step that was taken from the program.
    taken: StepId,
}

impl<'a> Restarted<'a> {
    /// Takes `program` up at a step. Questions of what was run already are answered by `answer`; `functions` were begun before it and
    /// go on, each with the number of open parts around it.
    ///
    /// # Errors
    /// The program has no such step, or does not come that far.
    pub fn new(
        mut program: Box<dyn ProgramStream + 'a>,
        at: StepId,
        approach: Approach,
        functions: &[(usize, RawNcFunction)],
        answer: &mut dyn FnMut(&Question) -> Answer,
    ) -> Result<Self, RestartError> {
        let mut answers = vec![];
        let mut asked = |question: &Question| {
            let given = answer(question);
            answers.push(given);
            given
        };
        let in_force = restart_at(&mut *program, at, &mut asked)?;
        // The approach is to the first move: what comes before that is done first.
        let mut own = vec![];
        let mut there = in_force.clone();
        let mut reply = None;
        let begins = loop {
            match program.next(reply.take()) {
                Next::Step(step) => {
                    let begins = match &step.kind {
                        StepKind::Move(first) => Some(Some(first.path.start())),
                        StepKind::MachineMove(_) => Some(None),
                        _ => None,
                    };
                    if begins.is_none() {
                        there.follow(&step);
                    }
                    own.push(step);
                    if let Some(begins) = begins {
                        break begins;
                    }
                }
                Next::Ask(question) => reply = Some(asked(&question)),
                Next::End => break None,
                Next::Alarm(alarm) => return Err(RestartError::Alarm(alarm.into())),
            }
        };
        let taken = own.last().map_or(in_force.step, |step| step.id);
        let put = PutIn(StepId(at.0.saturating_sub(1)));
        let way = begins.map_or_else(Vec::new, |start| way_in(&there, start, approach));
        let free = way.iter().filter_map(|kind| furthest(kind, approach.axis));
        let free = free.fold(approach.free.0, f64::max);
        let mut first = vec![put.step(along(approach.axis, free))];
        first.extend(restored(&in_force, &own, functions).into_iter().map(|kind| put.step(kind)));
        let moves = own.pop_if(|step| matches!(step.kind, StepKind::Move(_) | StepKind::MachineMove(_)));
        first.extend(own);
        first.extend(way.into_iter().map(|kind| put.step(kind)));
        first.extend(moves);
        Ok(Restarted {
            inner: program,
            ready: first.iter().cloned().collect(),
            first,
            in_force,
            answers,
            taken,
        })
    }

    /// What was in force before the step at which it is taken up.
    pub fn in_force(&self) -> &Modal {
        &self.in_force
    }

    /// What is in force when the program moves first, in the order in which it comes about; with each whether it was put in, or the program
    /// says it itself.
    pub fn until_it_moves(&self) -> impl Iterator<Item = (bool, &StepKind)> {
        let all = self.first.iter().map(|step| (self.is_put_in(step), &step.kind));
        all.take_while(|(put_in, kind)| *put_in || !matches!(kind, StepKind::Move(_) | StepKind::MachineMove(_)))
    }

    /// The tool with which it begins, put in or called by the program itself.
    pub fn tool(&self) -> Option<ToolNumber> {
        self.first.iter().rev().find_map(|step| match &step.kind {
            StepKind::Tool(tool) => Some(tool.number),
            _ => None,
        })
    }

    fn is_put_in(&self, step: &Step) -> bool {
        step.origin.place == Place::Given && step.id <= self.in_force.step
    }

    /// The same program without the moves that were put in: what the run is held against. The way in is nobody's path.
    pub fn without_the_way_in(mut self) -> Self {
        let moves = |kind: &StepKind| matches!(kind, StepKind::Move(_) | StepKind::MachineMove(_));
        let first = std::mem::take(&mut self.first).into_iter();
        self.first = first.filter(|step| !(self.is_put_in(step) && moves(&step.kind))).collect();
        self.ready = self.first.iter().cloned().collect();
        self
    }
}

/// Makes steps that the program does not say.
struct PutIn(StepId);

impl PutIn {
    fn step(&self, kind: StepKind) -> Step {
        Step {
            id: self.0,
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            kind,
        }
    }
}

/// What is put in force again, but for what the program says itself before it moves.
fn restored(in_force: &Modal, own: &[Step], functions: &[(usize, RawNcFunction)]) -> Vec<StepKind> {
    let says = |what: fn(&StepKind) -> bool| own.iter().any(|step| what(&step.kind));
    let mut kinds = vec![];
    if let Some(tool) = in_force.tool.as_ref().filter(|_| !says(|k| matches!(k, StepKind::Tool(_)))) {
        kinds.push(StepKind::Tool(tool.clone()));
    }
    kinds.extend(in_force.frame.clone().map(StepKind::Frame));
    kinds.push(StepKind::ToolOffset(in_force.tool_offset));
    kinds.push(StepKind::PathMode(in_force.path_mode));
    if !says(|k| matches!(k, StepKind::Spindle(_))) {
        kinds.push(StepKind::Spindle(in_force.spindle));
    }
    if !says(|k| matches!(k, StepKind::Coolant(_))) {
        kinds.push(StepKind::Coolant(in_force.coolant));
    }
    // A recording ends with the workplan in which it began.
    for depth in 0..=in_force.open.len() {
        kinds.extend(depth.checked_sub(1).map(|k| StepKind::Begin(in_force.open[k].clone())));
        let here = functions.iter().filter(|(around, _)| *around == depth);
        kinds.extend(here.map(|(_, function)| StepKind::NcFunction(function.clone())));
    }
    kinds
}

/// Across, close to the part, onto the path.
fn way_in(there: &Modal, start: Point<units::Setup>, approach: Approach) -> Vec<StepKind> {
    let machine_from_setup = there.frame.as_ref().map_or(Transform::IDENTITY, |f| f.machine_from_setup);
    let offset = there.tool_offset.total();
    let begins: Point<Machine> = machine_from_setup * start + offset;
    let mut before = begins.xyz;
    let out = approach.free.0.max(begins.xyz[approach.axis]);
    before[approach.axis] = (begins.xyz[approach.axis] + approach.clearance.0).min(out);
    let mut way = vec![
        StepKind::MachineMove(MachineMove {
            to: std::array::from_fn(|k| (k != approach.axis).then_some(Millimetres(begins.xyz[k]))),
        }),
        along(approach.axis, before[approach.axis]),
    ];
    let path = Path::Line {
        from: machine_from_setup.inverse() * (Point::<Machine>::from_xyz(before) + -offset),
        to: start,
    };
    if before[approach.axis] > begins.xyz[approach.axis] {
        way.push(StepKind::Move(Move {
            path,
            speed: Speed::Feed(Feed::PerTime(approach.feed)),
            profile: None,
            derived: true,
        }));
    }
    way
}

fn along(axis: usize, to: f64) -> StepKind {
    StepKind::MachineMove(MachineMove {
        to: std::array::from_fn(|k| (k == axis).then_some(Millimetres(to))),
    })
}

/// How far out a machine move goes along an axis.
fn furthest(kind: &StepKind, axis: usize) -> Option<f64> {
    match kind {
        StepKind::MachineMove(m) => m.to[axis].map(|to| to.0),
        _ => None,
    }
}

impl ProgramStream for Restarted<'_> {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        match self.ready.pop_front() {
            Some(step) => Next::Step(step),
            None => self.inner.next(answer),
        }
    }

    /// To before the first step of what is taken up: the way there is the same again.
    fn rewind(&mut self) {
        self.inner.rewind();
        let mut answers = self.answers.iter().copied();
        let mut reply = None;
        let mut at = StepId::NONE;
        while at < self.taken {
            match self.inner.next(reply.take()) {
                Next::Step(step) => at = step.id,
                // It asks what it asked before.
                Next::Ask(_) => reply = Some(answers.next().unwrap_or(Answer::Unknown)),
                Next::End | Next::Alarm(_) => break,
            }
        }
        self.ready = self.first.iter().cloned().collect();
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.inner.diagnostics()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.inner.file_name(file)
    }
}

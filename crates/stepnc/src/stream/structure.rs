//! A program told with both ways of its branches: what a post-processor reads.
//!
//! Each branch begins with what is in force where the ways part. Behind it, what differs between the two ends is no longer known and is
//! said again by the next path that needs it; of a loop's body nothing is known at its beginning, because its second turn begins where
//! the first one ended. Variables and conditions stay as they are written.

use super::*;
use plan::flow::{Part, StructuredProgram};

/// A STEP-NC program as a [`StructuredProgram`].
pub struct StructuredStream {
    stream: StepNcStream,
}

impl StructuredStream {
    /// The parts of a program.
    pub fn new(program: Arc<Program>, options: StreamOptions) -> Self {
        let mut stream = StepNcStream::new(program, options);
        stream.run.structured = true;
        stream.run.place = TipPlace::Anywhere;
        Self { stream }
    }
}

impl StructuredProgram for StructuredStream {
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>> {
        loop {
            if let Some((_, Said::Flow(_))) = self.stream.run.queue.front()
                && let Some((origin, Said::Flow(flow))) = self.stream.run.queue.pop_front()
            {
                return Ok(Some(Part::Flow(origin, flow)));
            }
            match self.stream.next_said(None) {
                Some(Next::Step(step)) => return Ok(Some(Part::Step(step))),
                Some(Next::End) => return Ok(None),
                Some(Next::Alarm(alarm)) => return Err(Box::new(alarm)),
                // Nothing is asked where both ways are told; a border of the flow is first in the queue now.
                Some(Next::Ask(_)) | None => {}
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

/// What one way leaves behind.
#[derive(Clone)]
pub(super) struct State {
    gauge: Point<Machine>,
    frame: Option<Transform<Machine, Setup>>,
    setup: Option<String>,
    tool: Option<ToolNumber>,
    offset: ToolOffset,
    own_offset: ToolOffset,
    spindle: Option<SpindleState>,
    coolant: Option<CoolantState>,
    path_mode: Option<PathMode>,
    clearance: Option<Millimetres>,
    place: TipPlace,
}

/// Where a way that was told comes to its end.
pub(super) enum Meeting {
    /// The true branch of an `If`, what was in force before it, and the other branch.
    Then { id: u64, before: State, otherwise: Option<u64> },
    /// The false branch, and how the true one ended.
    Otherwise { id: u64, then: State },
    /// A loop's body, and what was in force before it.
    Body { id: u64, before: State },
}

/// The condition as it is written.
pub(super) fn readable(executable: &Executable, condition: &Result<Expression, String>) -> Result<Expression, Fault> {
    condition.clone().map_err(|why| {
        Fault::new(
            executable.id,
            "condition",
            format!("the condition of '{}' cannot be read: {why}", executable.name),
            EXPRESSION_REMEDY,
        )
    })
}

impl Walker<'_> {
    pub(super) fn say_flow(&mut self, entity: u64, flow: Flow) {
        let place = if entity == 0 { Place::Given } else { Place::Entity(entity) };
        self.run
            .queue
            .push_back((Origin { file: FileId(0), place }, Said::Flow(flow)));
    }

    pub(super) fn say_initial_values(&mut self) {
        for (variable, value) in self.program.initial_values().clone() {
            let value = Expression::Number(value, None);
            self.say_flow(0, Flow::Assign { variable, value });
        }
    }

    pub(super) fn both_ways(&mut self, id: u64, condition: Expression, then: Option<u64>, otherwise: Option<u64>) {
        self.say_flow(id, Flow::If(condition));
        let before = self.state();
        self.run
            .tasks
            .push(Task::Meet(Box::new(Meeting::Then { id, before, otherwise })));
        self.run.tasks.extend(then.map(Task::Execute));
    }

    pub(super) fn the_body(&mut self, id: u64, condition: Expression, body: Option<u64>) {
        self.say_flow(id, Flow::While(condition));
        let before = self.state();
        self.run.place = TipPlace::Anywhere;
        self.run.frame = None;
        self.run.tool = None;
        self.run.offset = UNKNOWN_OFFSET;
        self.run.own_offset = UNKNOWN_OFFSET;
        (self.run.spindle, self.run.coolant, self.run.path_mode) = (None, None, None);
        self.run.tasks.push(Task::Meet(Box::new(Meeting::Body { id, before })));
        self.run.tasks.extend(body.map(Task::Execute));
    }

    pub(super) fn meet(&mut self, meeting: Meeting) {
        match meeting {
            Meeting::Then {
                id,
                before,
                otherwise: Some(otherwise),
            } => {
                let then = self.state();
                self.say_flow(id, Flow::Otherwise);
                self.restore(before);
                self.run.tasks.push(Task::Meet(Box::new(Meeting::Otherwise { id, then })));
                self.run.tasks.push(Task::Execute(otherwise));
            }
            Meeting::Then { id, before, .. } => {
                self.join(&before);
                self.say_flow(id, Flow::EndIf);
            }
            Meeting::Otherwise { id, then } => {
                self.join(&then);
                self.say_flow(id, Flow::EndIf);
            }
            Meeting::Body { id, before } => {
                self.join(&before);
                self.say_flow(id, Flow::EndWhile);
            }
        }
    }

    /// Out of the way, where the structure is told: nobody knows from where the link would go.
    pub(super) fn lift(&mut self, entity: u64) {
        if self.run.structured && self.run.place != TipPlace::Lifted {
            self.run.place = TipPlace::Lifted;
            self.say_flow(entity, Flow::Retract);
        }
    }

    /// Another set-up is another clamping: how it lies to the one before, the file says and the machine does not know. The tool goes there
    /// from out of the way. True when the set-up is to be said.
    pub(super) fn another_setup(&mut self, id: u64, name: &str) -> bool {
        if !self.run.structured || self.run.setup.as_deref() == Some(name) {
            return false;
        }
        if self.run.setup.is_some() {
            self.lift(id);
        }
        true
    }

    /// From out of the way to where a path begins: across, and in. Both pieces are always said.
    pub(super) fn come_down(&mut self, id: u64, start: Point<Setup>, retract_axis: usize) {
        let mut above = start;
        if let Some(height) = self.run.clearance.take().filter(|_| retract_axis == 2) {
            above.xyz[2] = above.xyz[2].max(height.0);
        }
        for (from, to) in [(above, above), (above, start)] {
            self.say(
                id,
                StepKind::Move(Move {
                    path: Path::Line { from, to },
                    speed: Speed::Rapid,
                    profile: None,
                    derived: true,
                }),
            );
        }
        self.run.place = TipPlace::Known;
    }

    fn state(&self) -> State {
        let run = &*self.run;
        State {
            gauge: run.gauge,
            frame: run.frame,
            setup: run.setup.clone(),
            tool: run.tool,
            offset: run.offset,
            own_offset: run.own_offset,
            spindle: run.spindle,
            coolant: run.coolant,
            path_mode: run.path_mode,
            clearance: run.clearance,
            place: run.place,
        }
    }

    fn restore(&mut self, state: State) {
        let run = &mut *self.run;
        run.gauge = state.gauge;
        (run.frame, run.setup) = (state.frame, state.setup);
        run.tool = state.tool;
        (run.offset, run.own_offset) = (state.offset, state.own_offset);
        (run.spindle, run.coolant, run.path_mode) = (state.spindle, state.coolant, state.path_mode);
        (run.clearance, run.place) = (state.clearance, state.place);
    }

    /// What is left when two ways meet: what both have left.
    fn join(&mut self, other: &State) {
        let run = &mut *self.run;
        if run.place != other.place || (run.place == TipPlace::Known && run.gauge != other.gauge) {
            run.place = TipPlace::Anywhere;
        }
        if run.frame != other.frame || run.setup != other.setup {
            (run.frame, run.setup) = (None, None);
            run.place = TipPlace::Anywhere;
        }
        if run.tool != other.tool {
            run.tool = None;
        }
        if run.offset != other.offset || run.own_offset != other.own_offset || run.tool.is_none() {
            (run.offset, run.own_offset) = (UNKNOWN_OFFSET, UNKNOWN_OFFSET);
        }
        run.spindle = run.spindle.filter(|_| run.spindle == other.spindle);
        run.coolant = run.coolant.filter(|_| run.coolant == other.coolant);
        run.path_mode = run.path_mode.filter(|_| run.path_mode == other.path_mode);
        run.clearance = match (run.clearance, other.clearance) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
    }
}

/// Equal to no offset of a machine: what is in force depends on the way that was taken.
const UNKNOWN_OFFSET: ToolOffset = ToolOffset {
    number: u32::MAX,
    ..ToolOffset::NONE
};

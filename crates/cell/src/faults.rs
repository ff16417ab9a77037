//! What can be made to go wrong, by hand or from a seed.

use machine::QUEUE;
use plan::{Answer, Diagnostic, FileId, FrameChange, Level, Move, Next, Path, ProgramStream, Speed, Step, StepKind};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::VecDeque;
use units::{Machine, Millimetres, Point, Setup, Tick, ToolNumber, Transform};

/// One thing that goes wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The realtime loop does not run for some cycles.
    LostTicks {
        /// The first of them.
        at: Tick,
        /// How many.
        count: u32,
    },
    /// An encoder reads wrong for a while.
    EncoderGlitch {
        /// From when.
        at: Tick,
        /// How long.
        ticks: u64,
        /// Which axis, 0 is X.
        axis: usize,
        /// By how many pulses.
        pulses: i32,
    },
    /// An axis is hard to move for a while.
    FrictionSpike {
        /// From when.
        at: Tick,
        /// How long.
        ticks: u64,
        /// Which axis, 0 is X.
        axis: usize,
        /// How many times its normal friction.
        factor: f64,
    },
    /// The office half delivers nothing for a while.
    LinkStall {
        /// From when.
        at: Tick,
        /// How long.
        ticks: u64,
    },
    /// Somebody presses feed hold, and cycle start later.
    FeedHold {
        /// When.
        at: Tick,
        /// When cycle start comes, counted from the hold.
        ticks: u64,
    },
    /// Somebody presses stop.
    ControlledStop {
        /// When.
        at: Tick,
    },
    /// Somebody hits the emergency stop.
    EmergencyStop {
        /// When.
        at: Tick,
    },
    /// The tip of a tool is not where the table says: seen only by the gauge ([`crate::sim::measure`]).
    ToolWear {
        /// Which tool.
        tool: ToolNumber,
        /// On a lathe: how much further from the axis the tip stands. On a mill: how much smaller the radius is.
        radial: Millimetres,
    },
    /// The operator set a wrong work offset for one workingstep: plant it in the program with [`planted`].
    SetupShift {
        /// Which workingstep.
        workingstep: WorkingstepSelector,
        /// The error in the machine frame, mm.
        shift: [f64; 3],
    },
}

/// Picks a workingstep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WorkingstepSelector {
    /// Every one of this name.
    Name(String),
    /// The n-th that begins, from 1.
    Number(u32),
}

impl Fault {
    /// One to three faults within the first `horizon` ticks, all decided by the seed. Only such as need no knowledge of the program.
    pub fn from_seed(seed: u64, horizon: Tick) -> Vec<Fault> {
        let mut dice = ChaCha8Rng::seed_from_u64(seed ^ 0x0070_6f6f_6c6b_7261);
        let mut up_to = |n: u64| dice.next_u64() % n.max(1);
        (0..=up_to(3))
            .map(|_| {
                let at = Tick(1 + up_to(horizon.0));
                let axis = up_to(3) as usize;
                match up_to(7) {
                    0 => Fault::LostTicks {
                        at,
                        count: 1 + up_to(20) as u32,
                    },
                    1 => Fault::EncoderGlitch {
                        at,
                        ticks: 1 + up_to(6),
                        axis,
                        pulses: up_to(4001) as i32 - 2000,
                    },
                    2 => Fault::FrictionSpike {
                        at,
                        ticks: 1 + up_to(500),
                        axis,
                        factor: 1.0 + up_to(40) as f64,
                    },
                    3 => Fault::LinkStall {
                        at,
                        ticks: 1 + up_to(2 * QUEUE as u64),
                    },
                    4 => Fault::FeedHold {
                        at,
                        ticks: 1 + up_to(500),
                    },
                    5 => Fault::ControlledStop { at },
                    _ => Fault::EmergencyStop { at },
                }
            })
            .collect()
    }
}

/// A program with the set-up faults of a list planted in it.
pub fn planted<'a>(program: Box<dyn ProgramStream + 'a>, faults: &[Fault]) -> Box<dyn ProgramStream + 'a> {
    faults.iter().fold(program, |program, fault| match fault {
        Fault::SetupShift { workingstep, shift } => Box::new(ShiftedSetup::new(program, workingstep.clone(), *shift)),
        _ => program,
    })
}

/// A program in which one workingstep is run with a wrong work offset.
///
/// It puts a [`FrameChange`] after the workingstep's begin and before its end. All steps keep their numbers; what is put in has the number
/// of the marker it stands at. The first move after each change starts where the tip really is: a straight move is lengthened to there,
/// before any other a straight link is put in, marked `derived`.
pub struct ShiftedSetup<'a> {
    inner: Box<dyn ProgramStream + 'a>,
    which: WorkingstepSelector,
    shift: [f64; 3],
    /// The frame that the program says; `None` before the first.
    frame: Option<FrameChange>,
    /// Workingsteps that began.
    begun: u32,
    /// Open workingsteps, and whether each is the shifted one.
    open: Vec<bool>,
    /// Where the tip is in the machine, tool offset left out.
    tip: Option<Point<Machine>>,
    /// The frame was changed by us: the next move has to be joined.
    joint: bool,
    ready: VecDeque<Step>,
}

impl<'a> ShiftedSetup<'a> {
    /// Shifts the picked workingstep by `shift` mm in the machine frame.
    pub fn new(inner: Box<dyn ProgramStream + 'a>, which: WorkingstepSelector, shift: [f64; 3]) -> Self {
        ShiftedSetup {
            inner,
            which,
            shift,
            frame: None,
            begun: 0,
            open: Vec::new(),
            tip: None,
            joint: false,
            ready: VecDeque::new(),
        }
    }

    fn is_shifted(&self) -> bool {
        self.open.contains(&true)
    }

    /// The frame that points are in now: the program's, with the fault.
    fn in_force(&self) -> FrameChange {
        let mut frame = self.frame.clone().unwrap_or(FrameChange {
            name: String::new(),
            machine_from_setup: Transform::IDENTITY,
            assumed: true,
        });
        if self.is_shifted() {
            for (origin, error) in frame.machine_from_setup.origin.iter_mut().zip(self.shift) {
                *origin += error;
            }
        }
        frame
    }

    fn take(&mut self, mut step: Step) {
        match &mut step.kind {
            StepKind::Begin(marker) if marker.level == Level::Workingstep => {
                self.begun += 1;
                let hit = match &self.which {
                    WorkingstepSelector::Name(name) => *name == marker.name,
                    WorkingstepSelector::Number(number) => *number == self.begun,
                };
                let before = self.is_shifted();
                self.open.push(hit);
                let frame = (self.is_shifted() != before).then(|| self.frame_step(&step));
                self.ready.push_back(step);
                self.ready.extend(frame);
            }
            StepKind::End(Level::Workingstep) => {
                let before = self.is_shifted();
                self.open.pop();
                let frame = (self.is_shifted() != before).then(|| self.frame_step(&step));
                self.ready.extend(frame);
                self.ready.push_back(step);
            }
            StepKind::Frame(frame) => {
                self.frame = Some(frame.clone());
                step.kind = StepKind::Frame(self.in_force());
                self.joint |= self.is_shifted();
                self.ready.push_back(step);
            }
            StepKind::Move(_) => self.take_move(step),
            StepKind::MachineMove(_) => {
                self.tip = None;
                self.ready.push_back(step);
            }
            _ => self.ready.push_back(step),
        }
    }

    fn frame_step(&mut self, marker: &Step) -> Step {
        self.joint = true;
        Step {
            kind: StepKind::Frame(self.in_force()),
            ..marker.clone()
        }
    }

    fn take_move(&mut self, mut step: Step) {
        let machine_from_setup = self.in_force().machine_from_setup;
        let StepKind::Move(this) = &mut step.kind else { return };
        let joint = std::mem::take(&mut self.joint);
        if let (true, Some(tip)) = (joint, self.tip) {
            let here: Point<Setup> = machine_from_setup.inverse() * tip;
            if here.distance(this.path.start()) > 1e-9 {
                match &mut this.path {
                    Path::Line { from, .. } => *from = here,
                    other => {
                        let link = Move {
                            path: Path::Line {
                                from: here,
                                to: other.start(),
                            },
                            speed: Speed::Rapid,
                            profile: None,
                            derived: true,
                        };
                        self.ready.push_back(Step {
                            id: step.id,
                            origin: step.origin,
                            kind: StepKind::Move(link),
                        });
                    }
                }
            }
        }
        self.tip = Some(machine_from_setup * this.path.end());
        self.ready.push_back(step);
    }
}

impl ProgramStream for ShiftedSetup<'_> {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        if let Some(step) = self.ready.pop_front() {
            return Next::Step(step);
        }
        match self.inner.next(answer) {
            Next::Step(step) => {
                self.take(step);
                self.ready.pop_front().map_or(Next::End, Next::Step)
            }
            other => other,
        }
    }

    fn rewind(&mut self) {
        self.inner.rewind();
        (self.frame, self.begun, self.tip, self.joint) = (None, 0, None, false);
        self.open.clear();
        self.ready.clear();
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.inner.diagnostics()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.inner.file_name(file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{Arc, Feed, Marker, Origin, Place};
    use units::{MmPerSec, Radians, StepId, Vector};

    /// A program from a list.
    struct Listed(Vec<StepKind>, usize);

    impl ProgramStream for Listed {
        fn next(&mut self, _answer: Option<Answer>) -> Next {
            let Some(kind) = self.0.get(self.1).cloned() else {
                return Next::End;
            };
            self.1 += 1;
            Next::Step(Step {
                id: StepId(self.1 as u32),
                origin: Origin {
                    file: FileId(0),
                    place: Place::Given,
                },
                kind,
            })
        }
        fn rewind(&mut self) {
            self.1 = 0;
        }
        fn diagnostics(&self) -> &[Diagnostic] {
            &[]
        }
        fn file_name(&self, _file: FileId) -> &str {
            "listed"
        }
    }

    fn line(from: [f64; 3], to: [f64; 3]) -> StepKind {
        moved(Path::Line {
            from: Point::from_xyz(from),
            to: Point::from_xyz(to),
        })
    }

    fn moved(path: Path<Setup>) -> StepKind {
        StepKind::Move(Move {
            path,
            speed: Speed::Feed(Feed::PerTime(MmPerSec(10.0))),
            profile: None,
            derived: false,
        })
    }

    fn begin(name: &str) -> StepKind {
        StepKind::Begin(Marker {
            level: Level::Workingstep,
            name: name.to_owned(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        })
    }

    fn program() -> Listed {
        let frame = FrameChange {
            name: "G54".to_owned(),
            machine_from_setup: Transform::shift([100.0, 0.0, 0.0]),
            assumed: false,
        };
        Listed(
            vec![
                StepKind::Frame(frame),
                begin("first"),
                line([0.0; 3], [10.0, 0.0, 0.0]),
                StepKind::End(Level::Workingstep),
                begin("second"),
                line([10.0, 0.0, 0.0], [20.0, 0.0, 0.0]),
                StepKind::End(Level::Workingstep),
                begin("third"),
                moved(Path::Arc(Arc {
                    from: Point::new(20.0, 0.0, 0.0),
                    centre: Point::new(20.0, 5.0, 0.0),
                    normal: Vector::Z,
                    sweep: Radians(1.0),
                    rise: 0.0,
                })),
                StepKind::End(Level::Workingstep),
            ],
            0,
        )
    }

    fn all(stream: &mut dyn ProgramStream) -> Vec<Step> {
        let mut steps = Vec::new();
        while let Next::Step(step) = stream.next(None) {
            steps.push(step);
        }
        steps
    }

    /// Moves in the machine frame, as a planner would see them.
    fn machine_moves(steps: &[Step]) -> Vec<(u32, [f64; 3], [f64; 3])> {
        let mut frame = Transform::<Machine, Setup>::IDENTITY;
        let mut moves = Vec::new();
        for step in steps {
            match &step.kind {
                StepKind::Frame(change) => frame = change.machine_from_setup,
                StepKind::Move(m) => {
                    moves.push((step.id.0, (frame * m.path.start()).xyz, (frame * m.path.end()).xyz));
                }
                _ => {}
            }
        }
        moves
    }

    #[test]
    fn one_workingstep_is_shifted_the_path_has_no_jump_and_numbers_stay() {
        for which in [WorkingstepSelector::Name("second".to_owned()), WorkingstepSelector::Number(2)] {
            let mut shifted = ShiftedSetup::new(Box::new(program()), which, [0.0, 0.3, 0.0]);
            let steps = all(&mut shifted);
            let ids: Vec<u32> = steps.iter().map(|s| s.id.0).collect();
            assert_eq!(ids, [1, 2, 3, 4, 5, 5, 6, 7, 7, 8, 9, 9, 10]);
            let moves = machine_moves(&steps);
            assert!(moves.windows(2).all(|m| m[0].2 == m[1].1), "a jump in {moves:?}");
            assert_eq!(moves[0].2, [110.0, 0.0, 0.0]);
            assert_eq!(moves[1].2, [120.0, 0.3, 0.0]);
            // Back again, by a link before the arc, which itself is where the program wants it.
            assert_eq!(moves[2], (9, [120.0, 0.3, 0.0], [120.0, 0.0, 0.0]));
            shifted.rewind();
            assert_eq!(all(&mut shifted), steps);
        }
    }

    #[test]
    fn a_workingstep_that_does_not_exist_changes_nothing() {
        let mut shifted = ShiftedSetup::new(Box::new(program()), WorkingstepSelector::Number(9), [1.0; 3]);
        assert_eq!(all(&mut shifted), all(&mut program()));
    }

    #[test]
    fn the_same_seed_gives_the_same_faults() {
        assert_eq!(Fault::from_seed(5, Tick(1000)), Fault::from_seed(5, Tick(1000)));
        assert_ne!(Fault::from_seed(5, Tick(1000)), Fault::from_seed(6, Tick(1000)));
    }
}

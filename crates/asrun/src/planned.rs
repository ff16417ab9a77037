//! The plan, laid out for comparison: every toolpath of a program in order, with what the record can be held against.
//!
//! A program is a stream and may be endless; this is the bounded copy that a rebuild needs. Paths are tool-tip paths in the set-up
//! frame, curves kept as what they are.

use plan::executed::PathKind;
use plan::{
    Alarm, Answer, Diagnostic, Diagnostics, Feed, FrameChange, Level, Modal, Next, Path, PathMode, ProgramStream, Question,
    Speed, Step, StepKind, ToolOffset,
};
use std::ops::Range;
use units::{Machine, Millimetres, MmPerSec, Point, Seconds, Setup, StepId, ToolNumber, Transform};

/// A program's toolpaths, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedProgram {
    /// The program's name: its main workplan's, or what the caller gave.
    pub name: String,
    /// STEP instance of the main workplan.
    pub main_workplan: Option<u64>,
    /// In order; one that is run twice stands here twice.
    pub workingsteps: Vec<PlannedWorkingstep>,
    /// In order, those between workingsteps too.
    pub toolpaths: Vec<PlannedToolpath>,
    /// All moves, in order.
    pub segments: Vec<PlannedSegment>,
    /// The frames used, in order of first use.
    pub frames: Vec<FrameChange>,
    /// How the reading ended.
    pub ended: PlanEnd,
    /// What the program's reader and this one found.
    pub diagnostics: Vec<Diagnostic>,
}

/// How the reading of a program ended.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanEnd {
    /// At its end.
    Complete,
    /// The program alarmed; what stands before is there.
    Alarm(Box<Alarm>),
    /// It has more steps than were asked for; what stands before is there.
    TooLong,
}

/// A workingstep of the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedWorkingstep {
    /// Its name; not unique.
    pub name: String,
    /// Its STEP instance.
    pub entity: Option<u64>,
    /// The workplans around it, outer first.
    pub within: Vec<(String, Option<u64>)>,
    /// The tool of its first move.
    pub tool: Option<ToolNumber>,
    /// Its toolpaths.
    pub toolpaths: Vec<usize>,
    /// Lengths over feeds, and dwells; without acceleration and without tool changes.
    pub time: Seconds,
    /// The strictest path maximum deviation of its feed paths.
    pub maximum_deviation: Option<Millimetres>,
}

/// A toolpath: moves of one kind that belong together, or a dwell.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedToolpath {
    /// Its name in the program, or one made of kind and number.
    pub name: String,
    /// Its STEP instance.
    pub entity: Option<u64>,
    /// Index of its workingstep; `None` for links between workingsteps.
    pub workingstep: Option<usize>,
    /// Rapid, feed or dwell.
    pub kind: PathKind,
    /// True for a link that the program does not say.
    pub derived: bool,
    /// Index into [`PlannedProgram::frames`]; `None` when the program never said one and the machine's frame holds.
    pub frame: Option<usize>,
    /// The tool offset that the plan counts with.
    pub tool_offset: ToolOffset,
    /// How far the machine may leave it.
    pub maximum_deviation: Option<Millimetres>,
    /// Its moves; empty for a dwell.
    pub segments: Range<usize>,
    /// Where the tip stands in a dwell.
    pub place: Option<Point<Setup>>,
    /// Length over feed, or the dwell.
    pub time: Seconds,
    /// Its steps, from the first to the last.
    pub steps: (StepId, StepId),
}

/// One move.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedSegment {
    /// Its step.
    pub step: StepId,
    /// Tool-tip path in the set-up.
    pub path: Path<Setup>,
    /// Its length.
    pub length: Millimetres,
    /// Mean speed along it.
    pub speed: MmPerSec,
    /// Index of its toolpath.
    pub toolpath: usize,
}

/// How a program is read for comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanOptions {
    /// Speed of each axis in rapid moves.
    pub rapid: [MmPerSec; 3],
    /// Read no more steps than this.
    pub most_steps: u64,
}

impl Default for PlanOptions {
    /// 500 mm/s on each axis; two million steps.
    fn default() -> Self {
        PlanOptions {
            rapid: [MmPerSec(500.0); 3],
            most_steps: 2_000_000,
        }
    }
}

impl PlannedProgram {
    /// Reads a program from its beginning to its end. Questions are answered by `answer`: the record of the run knows what was
    /// answered, or the caller decides.
    pub fn read(
        stream: &mut dyn ProgramStream,
        name: &str,
        options: &PlanOptions,
        answer: &mut dyn FnMut(&Question) -> Answer,
    ) -> PlannedProgram {
        stream.rewind();
        let mut builder = Builder::new(name, options);
        let mut reply = None;
        // An endless program may also ask for ever.
        let mut left = options.most_steps.saturating_mul(2);
        let ended = loop {
            if builder.steps >= options.most_steps || left == 0 {
                break PlanEnd::TooLong;
            }
            left -= 1;
            match stream.next(reply.take()) {
                Next::Step(step) => builder.step(&step),
                Next::Ask(question) => reply = Some(answer(&question)),
                Next::End => break PlanEnd::Complete,
                Next::Alarm(alarm) => break PlanEnd::Alarm(Box::new(alarm)),
            }
        };
        let mut program = builder.finish();
        for found in stream.diagnostics() {
            program.diagnostics.push(found.clone());
        }
        match &ended {
            PlanEnd::Complete => {}
            PlanEnd::Alarm(alarm) => program.diagnostics.push(alarm.diagnostic.clone()),
            PlanEnd::TooLong => {
                let message = format!(
                    "the program has more than {} steps; it is compared up to there",
                    options.most_steps
                );
                program.diagnostics.push(Diagnostic::warning("plan-too-long", message));
            }
        }
        program.ended = ended;
        program
    }

    /// The toolpath that a step belongs to, and its move; `None` for steps that are no move and no dwell.
    pub fn toolpath_of(&self, step: StepId) -> Option<usize> {
        if step == StepId::NONE {
            return None;
        }
        let after = self.toolpaths.partition_point(|t| t.steps.0 <= step);
        let found = after.checked_sub(1)?;
        let toolpath = &self.toolpaths[found];
        if step > toolpath.steps.1 {
            return None;
        }
        if toolpath.kind == PathKind::Dwell {
            return Some(found);
        }
        let moves = &self.segments[toolpath.segments.clone()];
        moves.binary_search_by_key(&step, |m| m.step).is_ok().then_some(found)
    }

    /// Takes points of a toolpath's set-up into the machine.
    pub fn machine_from_setup(&self, toolpath: usize) -> Transform<Machine, Setup> {
        match self.toolpaths[toolpath].frame {
            Some(frame) => self.frames[frame].machine_from_setup,
            None => Transform::IDENTITY,
        }
    }

    /// The name of a toolpath's set-up: `G54`; empty when the program never said one.
    pub fn frame_name(&self, toolpath: usize) -> &str {
        self.toolpaths[toolpath]
            .frame
            .map_or("", |frame| self.frames[frame].name.as_str())
    }

    /// Length of a toolpath.
    pub fn length(&self, toolpath: usize) -> Millimetres {
        self.segments[self.toolpaths[toolpath].segments.clone()]
            .iter()
            .map(|s| s.length)
            .sum()
    }
}

/// What must be the same for two moves to belong to one toolpath.
#[derive(Clone, Copy, PartialEq)]
struct Together {
    /// Number of the open toolpath marker; 0 is none.
    marker: u64,
    kind: PathKind,
    derived: bool,
    workingstep: Option<usize>,
    frame: Option<usize>,
    tool_offset: ToolOffset,
}

struct Builder<'a> {
    options: &'a PlanOptions,
    program: PlannedProgram,
    modal: Modal,
    steps: u64,
    markers: u64,
    /// Number of the innermost open toolpath marker.
    open_marker: u64,
    workingstep: Option<usize>,
    together: Option<Together>,
    frame: Option<usize>,
    /// Gauge point of each axis, as far as known.
    gauge: [Option<f64>; 3],
    numbers: [u32; 3],
    diagnostics: Diagnostics,
}

impl<'a> Builder<'a> {
    fn new(name: &str, options: &'a PlanOptions) -> Self {
        Builder {
            options,
            program: PlannedProgram {
                name: name.to_owned(),
                main_workplan: None,
                workingsteps: Vec::new(),
                toolpaths: Vec::new(),
                segments: Vec::new(),
                frames: Vec::new(),
                ended: PlanEnd::Complete,
                diagnostics: Vec::new(),
            },
            modal: Modal::default(),
            steps: 0,
            markers: 0,
            open_marker: 0,
            workingstep: None,
            together: None,
            frame: None,
            gauge: [None; 3],
            numbers: [0; 3],
            diagnostics: Diagnostics::new(),
        }
    }

    fn step(&mut self, step: &Step) {
        self.steps += 1;
        match &step.kind {
            StepKind::Move(m) => {
                if m.path.is_sound() {
                    let kind = match m.speed {
                        Speed::Rapid => PathKind::Rapid,
                        Speed::Feed(_) => PathKind::Feed,
                    };
                    self.segment(step, m.path.clone(), kind, m.derived, |b, length| b.speed_of(m, length));
                    self.gauge_follows(m.path.end());
                } else {
                    let found = Diagnostic::warning(
                        "unsound-path",
                        format!("{} has a path that is no curve; it is not compared", step.id),
                    );
                    self.diagnostics.add(found);
                }
            }
            StepKind::MachineMove(m) => {
                let from = self.gauge;
                for (known, to) in self.gauge.iter_mut().zip(m.to) {
                    *known = to.map(|to| to.0).filter(|to| to.is_finite()).or(*known);
                }
                if let ([Some(a), Some(b), Some(c)], [Some(x), Some(y), Some(z)]) = (from, self.gauge) {
                    let tip = |gauge: [f64; 3]| {
                        let frame = self
                            .frame
                            .map_or(Transform::IDENTITY, |f| self.program.frames[f].machine_from_setup);
                        frame.inverse() * (Point::from_xyz(gauge) - self.modal.tool_offset.total())
                    };
                    let path = Path::Line {
                        from: tip([a, b, c]),
                        to: tip([x, y, z]),
                    };
                    self.segment(step, path.clone(), PathKind::Rapid, false, |b, _| b.rapid_speed(&path));
                }
            }
            StepKind::Dwell(time) => self.dwell(step, *time),
            StepKind::Frame(frame) => {
                let known = self.program.frames.iter().position(|f| f == frame);
                self.frame = Some(known.unwrap_or_else(|| {
                    self.program.frames.push(frame.clone());
                    self.program.frames.len() - 1
                }));
            }
            StepKind::Begin(marker) => match marker.level {
                Level::Toolpath => {
                    self.markers += 1;
                    self.open_marker = self.markers;
                }
                Level::Workingstep => {
                    let within = self.modal.open.iter().filter(|m| m.level == Level::Workplan);
                    self.workingstep = Some(self.program.workingsteps.len());
                    self.program.workingsteps.push(PlannedWorkingstep {
                        name: marker.name.clone(),
                        entity: marker.entity,
                        within: within.map(|m| (m.name.clone(), m.entity)).collect(),
                        tool: None,
                        toolpaths: Vec::new(),
                        time: Seconds(0.0),
                        maximum_deviation: None,
                    });
                    self.numbers = [0; 3];
                }
                Level::Workplan if self.program.main_workplan.is_none() => {
                    self.program.main_workplan = marker.entity;
                    if !marker.name.is_empty() {
                        self.program.name = marker.name.clone();
                    }
                }
                _ => {}
            },
            StepKind::End(Level::Toolpath) => self.open_marker = 0,
            StepKind::End(Level::Workingstep) => self.workingstep = None,
            _ => {}
        }
        self.modal.follow(step);
    }

    fn gauge_follows(&mut self, tip: Point<Setup>) {
        let frame = self
            .frame
            .map_or(Transform::IDENTITY, |f| self.program.frames[f].machine_from_setup);
        self.gauge = (frame * tip + self.modal.tool_offset.total()).xyz.map(Some);
    }

    /// The toolpath that a move of this kind belongs to; a new one when something that matters has changed.
    fn toolpath(&mut self, step: &Step, kind: PathKind, derived: bool) -> usize {
        if self.workingstep.is_none() && !derived {
            self.workingstep = Some(self.program.workingsteps.len());
            let name = if self.program.workingsteps.is_empty() {
                "program"
            } else {
                "between workingsteps"
            };
            let within = self.modal.open.iter().filter(|m| m.level == Level::Workplan);
            self.program.workingsteps.push(PlannedWorkingstep {
                name: name.to_owned(),
                entity: None,
                within: within.map(|m| (m.name.clone(), m.entity)).collect(),
                tool: None,
                toolpaths: Vec::new(),
                time: Seconds(0.0),
                maximum_deviation: None,
            });
        }
        let together = Together {
            marker: self.open_marker,
            kind,
            derived,
            workingstep: self.workingstep,
            frame: self.frame,
            tool_offset: self.modal.tool_offset,
        };
        // A dwell is one step: the next dwell is another one.
        if self.together == Some(together) && kind != PathKind::Dwell {
            let last = self.program.toolpaths.len() - 1;
            self.program.toolpaths[last].steps.1 = step.id;
            return last;
        }
        self.together = Some(together);
        let marker = self
            .modal
            .within(Level::Toolpath)
            .filter(|_| self.open_marker > 0 && !derived);
        let number = &mut self.numbers[kind as usize];
        *number += 1;
        let name = match marker {
            Some(marker) if !marker.name.is_empty() => marker.name.clone(),
            _ if derived => format!("link {number}"),
            _ => format!("{} {number}", kind.word()),
        };
        let said = self.modal.open.iter().rev().find_map(|m| m.maximum_deviation);
        let maximum_deviation = said.or(match self.modal.path_mode {
            PathMode::Tolerance(tolerance) => tolerance,
            _ => None,
        });
        let index = self.program.toolpaths.len();
        let entity = marker.and_then(|m| m.entity);
        let end = self.program.segments.len();
        self.program.toolpaths.push(PlannedToolpath {
            name,
            entity,
            workingstep: self.workingstep,
            kind,
            derived,
            frame: self.frame,
            tool_offset: self.modal.tool_offset,
            maximum_deviation,
            segments: end..end,
            place: None,
            time: Seconds(0.0),
            steps: (step.id, step.id),
        });
        if let Some(workingstep) = self.workingstep {
            let workingstep = &mut self.program.workingsteps[workingstep];
            workingstep.toolpaths.push(index);
            if workingstep.tool.is_none() {
                workingstep.tool = self.modal.tool.as_ref().map(|t| t.number);
            }
            if kind == PathKind::Feed
                && let Some(deviation) = maximum_deviation.filter(|d| d.0 > 0.0)
            {
                let strictest = workingstep.maximum_deviation.map_or(deviation, |d| d.min(deviation));
                workingstep.maximum_deviation = Some(strictest);
            }
        }
        index
    }

    fn segment(&mut self, step: &Step, path: Path<Setup>, kind: PathKind, derived: bool, speed: impl Fn(&Self, f64) -> f64) {
        let length = path.length();
        let toolpath = self.toolpath(step, kind, derived);
        let speed = speed(self, length);
        let speed = if speed.is_finite() && speed > 0.0 {
            speed
        } else {
            let found = Diagnostic::warning(
                "no-feed",
                format!("{} moves without a feed; 1 mm/s is assumed for its time", step.id),
            );
            self.diagnostics.add(found);
            1.0
        };
        self.program.segments.push(PlannedSegment {
            step: step.id,
            path,
            length: Millimetres(length),
            speed: MmPerSec(speed),
            toolpath,
        });
        self.program.toolpaths[toolpath].segments.end = self.program.segments.len();
        self.add_time(toolpath, Seconds(length / speed));
    }

    fn dwell(&mut self, step: &Step, time: Seconds) {
        let time = if time.0.is_finite() {
            time.max(Seconds(0.0))
        } else {
            Seconds(0.0)
        };
        let toolpath = self.toolpath(step, PathKind::Dwell, false);
        self.program.toolpaths[toolpath].place = self.modal.tip;
        self.add_time(toolpath, time);
    }

    fn add_time(&mut self, toolpath: usize, time: Seconds) {
        self.program.toolpaths[toolpath].time += time;
        if let Some(workingstep) = self.program.toolpaths[toolpath].workingstep {
            self.program.workingsteps[workingstep].time += time;
        }
    }

    /// Mean speed of a move, mm/s.
    fn speed_of(&self, m: &plan::Move, length: f64) -> f64 {
        let feed = match m.speed {
            Speed::Rapid => return self.rapid_speed(&m.path),
            Speed::Feed(Feed::PerTime(speed)) => speed.0,
            Speed::Feed(Feed::PerRevolution(advance) | Feed::Thread(plan::Thread { advance, .. })) => {
                let radius = Millimetres(m.path.at(0.5).xyz[0]);
                advance.0 * self.modal.spindle.revolutions(radius).0 / 60.0
            }
            Speed::Feed(Feed::WholeMove(time)) => length / time.0,
        };
        let Some(profile) = &m.profile else { return feed };
        // Mean of the slowness over the length, by the midpoint rule.
        const PARTS: usize = 64;
        let slowness: f64 = (0..PARTS)
            .map(|k| 1.0 / profile.factor((k as f64 + 0.5) / PARTS as f64).max(1e-3))
            .sum::<f64>()
            / PARTS as f64;
        feed / slowness
    }

    /// Speed of a rapid move such that no axis is faster than it can, mm/s.
    fn rapid_speed(&self, path: &Path<Setup>) -> f64 {
        let frame = self
            .frame
            .map_or(Transform::IDENTITY, |f| self.program.frames[f].machine_from_setup);
        let Some(direction) = (frame * (path.end() - path.start())).unit() else {
            return self.options.rapid[0].0;
        };
        direction
            .xyz
            .iter()
            .zip(self.options.rapid)
            .filter(|(d, _)| d.abs() > 1e-9)
            .map(|(d, v)| v.0 / d.abs())
            .fold(f64::INFINITY, f64::min)
    }

    fn finish(mut self) -> PlannedProgram {
        self.program.diagnostics = self.diagnostics.as_slice().to_vec();
        self.program
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{FileId, Marker, Move, Origin, Place, ToolCall};
    use units::Vector;

    /// A program in memory; an endless one begins again.
    struct Script {
        kinds: Vec<StepKind>,
        at: usize,
        endless: bool,
        asks: bool,
    }

    impl ProgramStream for Script {
        fn next(&mut self, answer: Option<Answer>) -> Next {
            if self.asks && answer.is_none() {
                return Next::Ask(Question::OptionalStop);
            }
            if self.at >= self.kinds.len() && !self.endless {
                return Next::End;
            }
            let kind = self.kinds[self.at % self.kinds.len()].clone();
            self.at += 1;
            let origin = Origin {
                file: FileId(0),
                place: Place::Given,
            };
            Next::Step(Step {
                id: StepId(self.at as u32),
                origin,
                kind,
            })
        }
        fn rewind(&mut self) {
            self.at = 0;
        }
        fn diagnostics(&self) -> &[Diagnostic] {
            &[]
        }
        fn file_name(&self, _file: FileId) -> &str {
            ""
        }
    }

    fn read(kinds: Vec<StepKind>) -> PlannedProgram {
        let mut script = Script {
            kinds,
            at: 0,
            endless: false,
            asks: false,
        };
        PlannedProgram::read(&mut script, "test", &PlanOptions::default(), &mut |_| Answer::Unknown)
    }

    fn line(from: [f64; 3], to: [f64; 3], feed: Option<f64>, derived: bool) -> StepKind {
        let speed = feed.map_or(Speed::Rapid, |f| Speed::Feed(Feed::PerTime(MmPerSec(f))));
        let path = Path::Line {
            from: Point::from_xyz(from),
            to: Point::from_xyz(to),
        };
        StepKind::Move(Move {
            path,
            speed,
            profile: None,
            derived,
        })
    }

    fn begin(level: Level, name: &str, entity: u64, deviation: Option<f64>) -> StepKind {
        let maximum_deviation = deviation.map(Millimetres);
        StepKind::Begin(Marker {
            level,
            name: name.into(),
            entity: Some(entity),
            maximum_deviation,
            derived: false,
        })
    }

    fn told(program: &PlannedProgram) -> Vec<String> {
        let one = |t: &PlannedToolpath| {
            let workingstep = t.workingstep.map_or("-", |w| program.workingsteps[w].name.as_str());
            format!(
                "{workingstep}/{} {} {:?} {}",
                t.name,
                t.kind.word(),
                t.entity,
                t.segments.len()
            )
        };
        program.toolpaths.iter().map(one).collect()
    }

    #[test]
    fn markers_of_a_program_make_its_toolpaths_and_links_stay_apart() {
        let o = [0.0; 3];
        let program = read(vec![
            begin(Level::Workplan, "main", 1, None),
            begin(Level::Workplan, "first side", 2, None),
            begin(Level::Workingstep, "pocket", 3, None),
            begin(Level::Toolpath, "approach", 4, None),
            line(o, [0.0, 0.0, 5.0], None, true),
            line([0.0, 0.0, 5.0], [9.0, 0.0, 5.0], None, false),
            StepKind::End(Level::Toolpath),
            begin(Level::Toolpath, "cut", 5, Some(0.02)),
            line([9.0, 0.0, 5.0], [9.0, 9.0, 5.0], Some(10.0), false),
            line([9.0, 9.0, 5.0], [0.0, 9.0, 5.0], Some(10.0), false),
            StepKind::End(Level::Toolpath),
            begin(Level::Toolpath, "", 6, None),
            StepKind::Dwell(Seconds(0.5)),
            StepKind::End(Level::Toolpath),
            StepKind::End(Level::Workingstep),
            line([0.0, 9.0, 5.0], o, None, true),
        ]);
        assert_eq!(
            told(&program),
            [
                "pocket/link 1 rapid None 1",
                "pocket/approach rapid Some(4) 1",
                "pocket/cut feed Some(5) 2",
                "pocket/dwell 1 dwell Some(6) 0",
                "-/link 3 rapid None 1"
            ]
        );
        let pocket = &program.workingsteps[0];
        assert_eq!(
            pocket.within,
            [("main".to_owned(), Some(1)), ("first side".to_owned(), Some(2))]
        );
        assert_eq!(pocket.maximum_deviation, Some(Millimetres(0.02)));
        assert!(
            (pocket.time.0 - (5.0 / 500.0 + 9.0 / 500.0 + 1.8 + 0.5)).abs() < 1e-12,
            "{}",
            pocket.time
        );
        assert_eq!((program.name.as_str(), program.main_workplan), ("main", Some(1)));
        assert_eq!(program.toolpath_of(StepId(9)), Some(2));
        assert_eq!(program.toolpath_of(StepId(10)), Some(2));
        assert_eq!(program.toolpath_of(StepId(13)), Some(3));
        assert_eq!(program.toolpath_of(StepId(11)), None);
        assert_eq!(program.toolpath_of(StepId::NONE), None);
    }

    #[test]
    fn without_markers_runs_of_one_kind_are_toolpaths_and_a_new_offset_begins_another() {
        let o = [0.0; 3];
        let x = [9.0, 0.0, 0.0];
        let program = read(vec![
            line(o, x, None, false),
            line(x, o, None, false),
            StepKind::Tool(ToolCall {
                number: ToolNumber(4),
                name: String::new(),
                diameter: None,
            }),
            line(o, x, Some(10.0), false),
            StepKind::ToolOffset(ToolOffset {
                number: 4,
                geometry: Vector::Z,
                wear: Vector::ZERO,
                assumed: false,
            }),
            line(x, o, Some(10.0), false),
        ]);
        assert_eq!(
            told(&program),
            [
                "program/rapid 1 rapid None 2",
                "program/feed 1 feed None 1",
                "program/feed 2 feed None 1"
            ]
        );
        assert_eq!(program.workingsteps.len(), 1);
    }

    #[test]
    fn machine_moves_are_rapids_once_the_place_is_known() {
        let z = |z: f64| {
            StepKind::MachineMove(plan::MachineMove {
                to: [None, None, Some(Millimetres(z))],
            })
        };
        let program = read(vec![z(0.0), line([0.0; 3], [9.0, 0.0, 0.0], Some(10.0), false), z(50.0)]);
        assert_eq!(told(&program), ["program/feed 1 feed None 1", "program/rapid 1 rapid None 1"]);
        assert_eq!(program.segments[1].path.end().xyz, [9.0, 0.0, 50.0]);
    }

    #[test]
    fn an_endless_program_is_read_up_to_the_limit() {
        let kinds = vec![line([0.0; 3], [9.0, 0.0, 0.0], Some(10.0), false)];
        let options = PlanOptions {
            most_steps: 1000,
            ..PlanOptions::default()
        };
        for asks in [false, true] {
            let mut script = Script {
                kinds: kinds.clone(),
                at: 0,
                endless: true,
                asks,
            };
            let program = PlannedProgram::read(&mut script, "test", &options, &mut |_| Answer::Unknown);
            assert_eq!(program.ended, PlanEnd::TooLong);
            assert_eq!(program.segments.len(), 1000);
            assert_eq!(program.diagnostics[0].code, "plan-too-long");
        }
    }
}

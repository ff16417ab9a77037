//! The stream of steps becomes a stream of commands: what is at rest, what stands between two moves, and the motion itself.

use crate::pieces::{looked_at, over_parameter, product, shifted, smooth_parts, starting_at};
use crate::planner::{Planned, Planner};
use crate::smooth::{Corner, EXACT_PATH_TOLERANCE, Piece};
use crate::{Limits, Statistics};
use machine::{Command, CoolantOutlets, SetPoint, SpindleCommand, Tie};
use plan::{
    Alarm, Answer, Diagnostic, Feed, Level, MachineMove, Move, Next, Origin, Path, PathMode, Place, ProgramStream, Question,
    Speed, SpindleMode, SpindleState, Step, StepKind, Thread,
};
use std::collections::VecDeque;
use units::{Machine, Millimetres, Point, Rpm, Seconds, Setup, StepId, TICK, Transform, Vector, WorkingstepId};

/// Largest gap between the end of one move and the start of the next that is closed without a word, mm: programs round their numbers,
/// and an arc's end differs from the written one by as much.
const ROUNDING: f64 = 0.05;

/// Shorter moves have no direction, mm: a hundredth of what a double tells apart at ten kilometres.
const NO_LENGTH: f64 = 1e-9;

/// No machine reaches a kilometre: a coordinate beyond is a slip of the pen, and would be planned for hours.
const FARTHEST: f64 = 1e6;

/// The longest single move or dwell, s: a day.
const LONGEST: f64 = 86_400.0;

/// Largest sweep of one arc, rad: its limits are looked at each 0.05 rad, all in memory.
const LARGEST_SWEEP: f64 = 1e4;

/// Largest feed override.
const LARGEST_OVERRIDE: f64 = 2.0;

/// Slowest feed, mm/s: its square stays far within a double's range on the longest move.
const SLOWEST_FEED: f64 = 1e-12;

/// Steps between two moves that are kept while the second move is not known; behind more of them the machine comes to rest.
const MOST_MARKS: usize = 10_000;

/// What comes out, in the order in which the machine has to do it.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// For the realtime half.
    Command(Command),
    /// A step that is no motion; what it makes the machine do follows at once.
    Passed(Step),
    /// The program asks: everything before has been given out; answer in the next call, when the machine has done it.
    Ask(Question),
    /// The program is over.
    End,
    /// The program cannot go on; everything before has been given out.
    Alarm(Alarm),
}

/// A program being turned into commands. Memory is bounded by the look-ahead, whatever the program's length.
pub struct Trajectory<'a> {
    stream: Box<dyn ProgramStream + 'a>,
    limits: Limits,
    planner: Planner,
    /// Steps that stand between moves, in order; the profile's marks come out in the same order.
    marks: VecDeque<Vec<Output>>,
    ready: VecDeque<Output>,
    /// What comes when the motion at hand has come to rest.
    at_rest: Option<AtRest>,
    /// Where the planned path ends, and where the program says that it does: after moves without length and shifted circles that is a
    /// little further.
    position: Point<Machine>,
    aim: Point<Machine>,
    last_feed: (f64, bool),
    last_move: StepId,
    machine_from_setup: Transform<Machine, Setup>,
    tool_offset: Vector<Machine>,
    spindle: SpindleState,
    /// What holds for the set-points that are given out now: the program is read ahead of them.
    given: Given,
    path_mode: PathMode,
    workingsteps: u32,
    spindle_told: (Rpm, u64),
    history: [[f64; 3]; 3],
    statistics: Statistics,
    gaps: f64,
    /// What overrides are for the set-points from a step on; the first is that of the set-points at hand.
    kinds: VecDeque<(StepId, Kind)>,
}

/// Which override is for a move.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kind {
    rapid: bool,
    /// None is: it goes by the spindle.
    tie: Option<Tie>,
    /// The multiplier of its feed, where set-points do not tell it.
    feed_scale: Option<f64>,
}

/// Path parameters and the multiplier of the feed there, as in [`Piece::feed_factors`].
type Factors = Vec<(f64, f64)>;

/// What a change at rest sets for the motion behind it.
#[derive(Clone, Copy)]
struct Given {
    spindle: SpindleState,
    setup_from_machine: Transform<Setup, Machine>,
    tool_offset: Vector<Machine>,
}

impl Default for Given {
    fn default() -> Self {
        Given {
            spindle: SpindleState::Stopped,
            setup_from_machine: Transform::IDENTITY,
            tool_offset: Vector::ZERO,
        }
    }
}

impl Given {
    /// Speed of a spindle that follows the radius, with the gauge point at `gauge`.
    fn surface_revolutions(&self, gauge: [f64; 3]) -> Option<Rpm> {
        let tip = self.setup_from_machine * (Point::<Machine>::from_xyz(gauge) - self.tool_offset);
        has_surface_speed(&self.spindle).then(|| self.spindle.revolutions(Millimetres(tip.xyz[0])))
    }
}

fn has_surface_speed(spindle: &SpindleState) -> bool {
    matches!(
        spindle,
        SpindleState::Clockwise(SpindleMode::Surface { .. }) | SpindleState::Counterclockwise(SpindleMode::Surface { .. })
    )
}

enum AtRest {
    Outputs(Vec<Output>),
    Ask(Question),
    End,
    Alarm(Box<Alarm>),
}

impl<'a> Trajectory<'a> {
    /// Reads `stream` from a machine that stands at `start`.
    pub fn new(stream: Box<dyn ProgramStream + 'a>, start: Point<Machine>, limits: Limits) -> Self {
        Trajectory {
            stream,
            planner: Planner::new(&limits, start.xyz),
            limits,
            marks: VecDeque::new(),
            ready: VecDeque::new(),
            at_rest: None,
            position: start,
            aim: start,
            last_feed: (f64::INFINITY, true),
            last_move: StepId::NONE,
            machine_from_setup: Transform::IDENTITY,
            tool_offset: Vector::ZERO,
            spindle: SpindleState::Stopped,
            given: Given::default(),
            path_mode: PathMode::Tolerance(None),
            workingsteps: 0,
            spindle_told: (Rpm::ZERO, 0),
            history: [start.xyz; 3],
            statistics: Statistics::default(),
            gaps: 0.0,
            kinds: VecDeque::new(),
        }
    }

    /// Plans under a limit of jerk on a grid that is this many times finer than usual, and with all of the limits: a reference for how fast
    /// the smoothed path can be travelled. Many times slower, and no sample is looked at.
    pub fn with_fine_grid(mut self, fineness: f64) -> Self {
        if let Planner::Jerk(planner) = &mut self.planner {
            planner.fineness = fineness.clamp(1.0, 100.0);
        }
        self
    }

    /// From here on plans for these overrides, as shares of the programmed feeds and of rapids; 1 is 100 %, more than 2 is 2.
    ///
    /// Below 100 % nothing is planned again: the machine slows down what it has at once and on its path, by time, and goes on as fast as
    /// before when the override is taken back. Above it programmed feeds are multiplied, up to what the axes can do, from where set-points
    /// have been given out: with a limit of jerk a few milliseconds behind the last of them, without one behind the look-ahead. Rapids are as
    /// fast as the axes already, and the feed of a thread is that of the spindle. [`SetPoint::planned_override`] tells what each set-point was
    /// planned for; a machine whose override is less than that slows down by their ratio.
    pub fn set_override(&mut self, feed: f64, rapid: f64) {
        let _ = rapid;
        if feed.is_finite() {
            self.planner.set_feed_scale(feed.clamp(1.0, LARGEST_OVERRIDE));
        }
    }

    /// The next thing for the machine. `answer` is `Some` just after an [`Output::Ask`].
    pub fn next(&mut self, answer: Option<Answer>) -> Output {
        let mut answer = answer;
        if answer.is_some() && matches!(self.at_rest, Some(AtRest::Ask(_))) {
            self.at_rest = None;
        }
        loop {
            if let Some(output) = self.ready.pop_front() {
                return output;
            }
            match self.planner.next() {
                Some(Planned::SetPoint(point)) => return self.give(point),
                Some(Planned::Mark) => self.ready.extend(self.marks.pop_front().into_iter().flatten()),
                None if self.at_rest.is_some() => {
                    // What is left of the way has no length.
                    self.position = self.aim;
                    if let Some(point) = self.planner.rest(self.position.xyz, self.last_move) {
                        return self.give(point);
                    }
                    match self.at_rest.as_ref() {
                        Some(AtRest::Ask(question)) => return Output::Ask(question.clone()),
                        Some(AtRest::End) => return Output::End,
                        Some(AtRest::Alarm(alarm)) => return Output::Alarm((**alarm).clone()),
                        Some(AtRest::Outputs(_)) | None => {
                            if let Some(AtRest::Outputs(outputs)) = self.at_rest.take() {
                                self.change_given(&outputs);
                                self.ready.extend(outputs);
                            }
                        }
                    }
                }
                None => self.pull(answer.take()),
            }
        }
    }

    /// The program behind it, for its remarks and file names.
    pub fn stream(&self) -> &dyn ProgramStream {
        &*self.stream
    }

    /// What has been given out so far.
    pub fn statistics(&self) -> Statistics {
        Statistics {
            path_length: Millimetres(self.planner.path_length()),
            max_deviation: Millimetres(self.planner.max_deviation().max(self.gaps)),
            ..self.statistics
        }
    }

    /// Takes one thing from the program.
    fn pull(&mut self, answer: Option<Answer>) {
        match self.stream.next(answer) {
            Next::End => self.come_to_rest(AtRest::End),
            Next::Ask(question) => self.come_to_rest(AtRest::Ask(question)),
            Next::Alarm(alarm) => self.come_to_rest(AtRest::Alarm(Box::new(alarm))),
            Next::Step(step) => {
                if let Err(found) = self.take(step) {
                    self.come_to_rest(AtRest::Alarm(Box::new(Alarm::from(*found))));
                }
            }
        }
    }

    fn take(&mut self, step: Step) -> Result<(), Box<Diagnostic>> {
        let id = step.id;
        let command = |c: Command| Output::Command(c);
        match &step.kind {
            StepKind::Move(m) => {
                self.statistics.blocks += 1;
                self.take_move(m, &step)?;
            }
            StepKind::MachineMove(MachineMove { to }) => {
                let target = std::array::from_fn(|k| to[k].map_or(self.position.xyz[k], |v| v.0));
                let path = Path::Line {
                    from: self.position,
                    to: Point::from_xyz(target),
                };
                let length = path.length();
                self.reachable(&path, length, f64::INFINITY, step.origin)?;
                self.aim = path.end();
                self.add(Piece {
                    path,
                    length,
                    feed: f64::INFINITY,
                    feed_factors: vec![],
                    rapid: true,
                    tie: None,
                    step: id,
                    corner: Corner::Stop,
                });
            }
            StepKind::PathMode(mode) => {
                self.path_mode = *mode;
                self.mark(vec![Output::Passed(step)]);
            }
            StepKind::Begin(marker) if marker.level == Level::Workingstep => {
                self.workingsteps += 1;
                let workingstep = WorkingstepId(self.workingsteps);
                self.mark(vec![
                    Output::Passed(step),
                    command(Command::Workingstep { workingstep, step: id }),
                ]);
            }
            StepKind::End(Level::Workingstep) => {
                let workingstep = WorkingstepId(0);
                self.mark(vec![
                    Output::Passed(step),
                    command(Command::Workingstep { workingstep, step: id }),
                ]);
            }
            StepKind::Coolant(coolant) => {
                let outlets = CoolantOutlets {
                    flood: coolant.flood,
                    mist: coolant.mist,
                    through: coolant.through,
                };
                self.mark(vec![Output::Passed(step), command(Command::Coolant { outlets, step: id })]);
            }
            StepKind::Begin(_) | StepKind::End(_) | StepKind::Message(_) | StepKind::Register(_) | StepKind::NcFunction(_) => {
                self.mark(vec![Output::Passed(step)]);
            }
            StepKind::Dwell(time) => {
                if !(time.0 >= 0.0 && time.is_finite()) {
                    return Err(self.finding("bad-dwell", format!("a dwell of {time} cannot be done"), step.origin));
                }
                if time.0 > LONGEST {
                    let found = self.finding("long-dwell", format!("a dwell of {time} is longer than a day"), step.origin);
                    return Err(with_remedy(found, "correct the time, and its unit"));
                }
                let cycles = libm::ceil(time.0 / TICK.0 - 1e-9).min(f64::from(u32::MAX)) as u32;
                self.statistics.time += Seconds(f64::from(cycles) * TICK.0);
                self.come_to_rest(AtRest::Outputs(vec![
                    Output::Passed(step),
                    command(Command::Dwell { cycles, step: id }),
                ]));
            }
            StepKind::Tool(tool) => {
                let number = tool.number;
                self.come_to_rest(AtRest::Outputs(vec![
                    Output::Passed(step),
                    command(Command::Tool { tool: number, step: id }),
                ]));
            }
            StepKind::Spindle(spindle) => {
                self.spindle = *spindle;
                let speed = spindle.revolutions(Millimetres(self.tip(self.position).xyz[0]));
                let spindle = match spindle {
                    // The command has no angle: the plant's spindle stops where it comes to rest.
                    SpindleState::Stopped | SpindleState::Oriented => SpindleCommand::Stop,
                    SpindleState::Clockwise(_) => SpindleCommand::Clockwise(speed),
                    SpindleState::Counterclockwise(_) => SpindleCommand::Counterclockwise(speed),
                };
                self.come_to_rest(AtRest::Outputs(vec![
                    Output::Passed(step),
                    command(Command::Spindle { spindle, step: id }),
                ]));
            }
            StepKind::Frame(frame) => {
                self.machine_from_setup = frame.machine_from_setup;
                self.come_to_rest(AtRest::Outputs(vec![Output::Passed(step)]));
            }
            StepKind::ToolOffset(offset) => {
                self.tool_offset = offset.total();
                self.come_to_rest(AtRest::Outputs(vec![Output::Passed(step)]));
            }
            StepKind::Stop(_) => {
                self.come_to_rest(AtRest::Outputs(vec![
                    Output::Passed(step),
                    command(Command::Pause { step: id }),
                ]));
            }
        }
        Ok(())
    }

    /// Adds a move: the parts of its path between corners, in machine coordinates, each closed up to where the last one ended.
    fn take_move(&mut self, m: &Move, step: &Step) -> Result<(), Box<Diagnostic>> {
        let origin = step.origin;
        if !m.path.is_sound() {
            return Err(self.finding(
                "bad-geometry",
                "the path has a coordinate that is not a number, or counts that do not fit",
                origin,
            ));
        }
        let length = m.path.length();
        let sweep = if let Path::Arc(arc) = &m.path {
            arc.sweep.0.abs()
        } else {
            0.0
        };
        if sweep > LARGEST_SWEEP {
            let message = format!("an arc of {sweep:.0} rad is longer than any machine's");
            return Err(self.finding("bad-geometry", message, origin));
        }
        let (feed, factors) = self.feed_along(m, length, origin)?;
        let top = feed * factors.iter().map(|f| f.1).reduce(f64::max).unwrap_or(1.0);
        let whole = shifted(m.path.in_frame(&self.machine_from_setup), self.tool_offset);
        self.reachable(&whole, length, top, origin)?;
        let tie = self.tie(m, &whole, origin)?;
        let corner = match self.path_mode {
            PathMode::ExactStop => Corner::Stop,
            PathMode::ExactPath => Corner::Within(EXACT_PATH_TOLERANCE),
            PathMode::Tolerance(t) => Corner::Within(t.unwrap_or(self.limits.tolerance).0.max(0.0)),
        };
        let parts = smooth_parts(&m.path);
        let last = parts.len() - 1;
        for (k, (part, range)) in parts.into_iter().enumerate() {
            let width = range[1] - range[0];
            let path = shifted(part.in_frame(&self.machine_from_setup), self.tool_offset);
            self.aim = path.end();
            let path = self.closed_up(path, origin)?;
            self.add(Piece {
                length: path.length(),
                path,
                feed,
                feed_factors: factors.iter().map(|(u, f)| ((u - range[0]) / width, *f)).collect(),
                rapid: m.speed == Speed::Rapid,
                tie,
                step: step.id,
                // A corner inside a move is not its end: exact stop does not stop there, but it does not leave the path either.
                corner: match corner {
                    Corner::Stop if k < last => Corner::Within(EXACT_PATH_TOLERANCE),
                    corner => corner,
                },
            });
        }
        Ok(())
    }

    /// The path, started where the axes are, when that is a rounding away.
    fn closed_up(&mut self, path: Path<Machine>, origin: Origin) -> Result<Path<Machine>, Box<Diagnostic>> {
        let gap = path.start().distance(self.position);
        if gap <= ROUNDING {
            // Gaps without length come from moves without length; they close without being told.
            self.gaps = self.gaps.max(if gap > 2.0 * NO_LENGTH { gap } else { 0.0 });
            return Ok(if gap > 0.0 { starting_at(path, self.position) } else { path });
        }
        let message = format!(
            "the path starts {gap:.3} mm away from where the tip is: at {:.3?}, tip at {:.3?}",
            (self.machine_from_setup.inverse() * (path.start() - self.tool_offset)).xyz,
            self.tip(self.position).xyz
        );
        Err(self.finding("path-gap", message, origin))
    }

    /// Feed of a move, mm/s, and its multiplier over the path's parameter.
    fn feed_along(&self, m: &Move, length: f64, origin: Origin) -> Result<(f64, Factors), Box<Diagnostic>> {
        let bad_feed = |v: f64| {
            let message = format!("a feed of {v} mm/s cannot be moved at");
            with_remedy(self.finding("bad-feed", message, origin), "give the path a feed above 0")
        };
        let Speed::Feed(feed) = m.speed else {
            return Ok((f64::INFINITY, vec![]));
        };
        let multiplier = m.profile.as_ref();
        if let Some(profile) = multiplier {
            let points = &profile.points;
            let wrong = points.iter().find(|p| !(p.1 >= 0.0 && p.1.is_finite() && p.0.is_finite()));
            // One place of rest can be moved through; a stretch of it cannot.
            let stretch = |p: &[(f64, f64)]| p[0].1 * p[0].1 + p[1].1 * p[1].1 == 0.0 && p[0].0 < p[1].0;
            let at_ends =
                points.first().is_some_and(|p| p.1 == 0.0 && p.0 > 0.0) || points.last().is_some_and(|p| p.1 == 0.0 && p.0 < 1.0);
            if let Some(p) = wrong {
                return Err(bad_feed(p.1));
            }
            if at_ends || points.windows(2).any(stretch) || points.windows(2).any(|p| p[0].0 > p[1].0) {
                return Err(bad_feed(0.0));
            }
        }
        let usable = |v: f64| {
            if v >= SLOWEST_FEED && v.is_finite() {
                Ok(v)
            } else {
                Err(bad_feed(v))
            }
        };
        match feed {
            Feed::PerTime(v) => Ok((
                usable(v.0)?,
                multiplier.map_or(vec![], |p| over_parameter(p, &m.path, length)),
            )),
            // A move without length takes no time, whatever is asked.
            Feed::WholeMove(_) if length <= NO_LENGTH => Ok((1.0, vec![])),
            Feed::WholeMove(time) => Ok((
                usable(length / time.0)?,
                multiplier.map_or(vec![], |p| over_parameter(p, &m.path, length)),
            )),
            Feed::PerRevolution(f) | Feed::Thread(Thread { advance: f, .. }) => {
                let at = |u: f64| f.0 * self.spindle.revolutions(Millimetres(m.path.at(u).xyz[0])).0 / 60.0;
                let constant = !has_surface_speed(&self.spindle);
                let factors = multiplier.map_or(vec![], |p| over_parameter(p, &m.path, length));
                let speeds = if constant { vec![(0.0, at(0.0))] } else { looked_at(&at) };
                if speeds.iter().any(|(_, v)| !(*v >= SLOWEST_FEED && v.is_finite())) {
                    let found = self.finding(
                        "feed-without-spindle",
                        "a feed per revolution needs a turning spindle",
                        origin,
                    );
                    return Err(with_remedy(found, "start the spindle (M3 S...) before this move"));
                }
                Ok(if constant {
                    (speeds[0].1, factors)
                } else if factors.is_empty() {
                    (1.0, speeds)
                } else {
                    (1.0, product(&factors, &speeds))
                })
            }
        }
    }

    /// How a thread is tied to the spindle. Axes that are too slow for its lead would spoil it, so it is refused.
    fn tie(&self, m: &Move, path: &Path<Machine>, origin: Origin) -> Result<Option<Tie>, Box<Diagnostic>> {
        let Speed::Feed(Feed::Thread(thread)) = m.speed else {
            return Ok(None);
        };
        let tie = Tie {
            lead: thread.advance.0,
            revolutions: self.spindle.revolutions(Millimetres(m.path.start().xyz[0])).0 / 60.0,
            start: thread.start.map(|angle| angle.0 / std::f64::consts::TAU),
        };
        let along = path.derivatives(0.0).0.unit().map_or([1.0; 3], |way| way.xyz.map(f64::abs));
        if let Some(k) = (0..3).find(|k| tie.speed() * along[*k] > self.limits.v_max[*k].0) {
            let (wanted, v_max) = (tie.speed() * along[k], self.limits.v_max[k].0);
            let axis = ["X", "Y", "Z"][k];
            let message = format!("a thread that needs {wanted:.1} mm/s of {axis}, which goes {v_max:.1} mm/s at most");
            let found = self.finding("thread-too-fast", message, origin);
            return Err(with_remedy(found, "write a lower spindle speed before the thread"));
        }
        Ok(Some(tie))
    }

    /// A move that stays within a kilometre and takes less than a day; `top` is its highest feed, mm/s.
    fn reachable(&self, path: &Path<Machine>, length: f64, top: f64, origin: Origin) -> Result<(), Box<Diagnostic>> {
        let far = path.end().xyz.into_iter().map(f64::abs).fold(length, f64::max);
        if far > FARTHEST {
            let [x, y, z] = path.end().xyz;
            let message = format!("a move of {length:.3e} mm to X {x:.3e} Y {y:.3e} Z {z:.3e}: no machine reaches that far");
            let found = self.finding("out-of-reach", message, origin);
            return Err(with_remedy(found, "correct the coordinates, and their unit"));
        }
        let most = |limits: [f64; 3]| limits.into_iter().map(|v| v * v).sum::<f64>().sqrt();
        let (v_max, a_max) = (most(self.limits.v_max.map(|v| v.0)), most(self.limits.a_max.map(|a| a.0)));
        let least = (length / v_max.min(top)).max(2.0 * (length / a_max).sqrt());
        if least > LONGEST {
            let message = format!("a move of {length:.3} mm would take {:.1} days", least / LONGEST);
            let found = self.finding("endless-move", message, origin);
            return Err(with_remedy(
                found,
                "correct the feed, and its unit, or the limits of the axes",
            ));
        }
        Ok(())
    }

    fn add(&mut self, piece: Piece) {
        self.last_move = piece.step;
        // What may be left of the way at rest is short, so a feed that falls to nothing does not matter there, but it has to arrive.
        let last_factor = piece.feed_factors.last().map_or(1.0, |p| p.1.max(0.01));
        self.last_feed = (piece.feed * last_factor, piece.rapid);
        // A move without length has no direction. The axes stay where they are, and the next move starts from there: a million of such
        // moves still are a way.
        if piece.length <= NO_LENGTH {
            return;
        }
        self.position = piece.path.end();
        let kind = Kind {
            rapid: piece.rapid,
            tie: piece.tie,
            feed_scale: self.planner.feed_scale_of_next(),
        };
        if self.kinds.back().is_none_or(|last| last.1 != kind) {
            self.kinds.push_back((piece.step, kind));
        }
        self.planner.push(piece);
    }

    fn mark(&mut self, outputs: Vec<Output>) {
        self.marks.push_back(outputs);
        self.planner.mark();
        if self.marks.len() > MOST_MARKS {
            self.planner.finish();
        }
    }

    fn come_to_rest(&mut self, then: AtRest) {
        let (length, (feed, rapid)) = (self.position.distance(self.aim), self.last_feed);
        if length > NO_LENGTH {
            let path = Path::Line {
                from: self.position,
                to: self.aim,
            };
            self.add(Piece {
                path,
                length,
                feed,
                feed_factors: vec![],
                rapid,
                tie: None,
                step: self.last_move,
                corner: Corner::Stop,
            });
        }
        self.planner.finish();
        self.at_rest = Some(then);
    }

    /// The motion before a change at rest has been given out; from here on the change holds.
    fn change_given(&mut self, outputs: &[Output]) {
        for output in outputs {
            if let Output::Command(Command::Spindle { spindle, .. }) = output {
                let speed = match spindle {
                    SpindleCommand::Stop => Rpm::ZERO,
                    SpindleCommand::Clockwise(n) | SpindleCommand::Counterclockwise(n) => *n,
                };
                self.spindle_told = (speed, self.statistics.samples);
            }
        }
        self.given = Given {
            spindle: self.spindle,
            setup_from_machine: self.machine_from_setup.inverse(),
            tool_offset: self.tool_offset,
        };
    }

    /// The tool tip in the set-up when the gauge point is at `gauge`.
    fn tip(&self, gauge: Point<Machine>) -> Point<Setup> {
        self.machine_from_setup.inverse() * (gauge - self.tool_offset)
    }

    /// Counts a set-point and holds it against the limits. With constant surface speed the spindle is told first when it has to change
    /// by 1 % or ten cycles have passed.
    fn give(&mut self, mut point: SetPoint) -> Output {
        while self.kinds.get(1).is_some_and(|next| next.0 <= point.step) {
            self.kinds.pop_front();
        }
        if let Some((_, kind)) = self.kinds.front() {
            point.rapid = kind.rapid;
            point.tie = kind.tie;
            point.planned_override = match kind {
                Kind { tie: Some(_), .. } => 0.0,
                Kind { rapid: true, .. } => 1.0,
                Kind { feed_scale, .. } => feed_scale.unwrap_or(point.planned_override),
            };
        }
        let v_max = self.limits.v_max;
        let a_max = self.limits.a_max;
        let j_max = self.limits.j_max;
        let statistics = &mut self.statistics;
        statistics.samples += 1;
        statistics.time += TICK;
        let [last, before, first] = self.history;
        for k in 0..3 {
            let p = point.position[k];
            let v = (p - last[k]) / TICK.0;
            let a = (p - 2.0 * last[k] + before[k]) / (TICK.0 * TICK.0);
            statistics.worst_speed_ratio = statistics.worst_speed_ratio.max(v.abs() / v_max[k].0);
            statistics.worst_acceleration_ratio = statistics.worst_acceleration_ratio.max(a.abs() / a_max[k].0);
            if let Some(j_max) = j_max {
                let j = (p - 3.0 * last[k] + 3.0 * before[k] - first[k]) / (TICK.0 * TICK.0 * TICK.0);
                let worst = statistics.worst_jerk_ratio.unwrap_or(0.0);
                statistics.worst_jerk_ratio = Some(worst.max(j.abs() / j_max[k].0));
            }
        }
        self.history = [point.position, last, before];
        if let Some(wanted) = self.given.surface_revolutions(point.position) {
            let (told, at) = self.spindle_told;
            let due = (wanted - told).abs().0 > 0.01 * told.0 || (wanted != told && self.statistics.samples >= at + 10);
            if due {
                self.spindle_told = (wanted, self.statistics.samples);
                self.ready.push_front(Output::Command(Command::SetPoint(point)));
                return Output::Command(Command::SpindleSpeed(wanted));
            }
        }
        Output::Command(Command::SetPoint(point))
    }

    fn finding(&self, code: &'static str, message: impl Into<String>, origin: Origin) -> Box<Diagnostic> {
        let mut found = Diagnostic::error(code, message).in_file(self.stream.file_name(origin.file));
        match origin.place {
            Place::Text { line, .. } => found = found.at_line(line, 1),
            Place::Entity(id) => found = found.at_entity(id),
            Place::Given => {}
        }
        Box::new(found)
    }
}

fn with_remedy(mut found: Box<Diagnostic>, remedy: &str) -> Box<Diagnostic> {
    found.remedy = remedy.into();
    found
}

//! The stream of steps becomes a stream of commands: what is at rest, what stands between two moves, and the motion itself.

use crate::profile::{Profile, Profiled};
use crate::sample::{Sampled, Sampler};
use crate::smooth::{Corner, EXACT_PATH_TOLERANCE, Piece, Smoothed, Smoother};
use crate::{Limits, Statistics};
use machine::{Command, CoolantOutlets, SetPoint, SpindleCommand};
use plan::{
    Alarm, Answer, Diagnostic, Feed, Level, MachineMove, Move, Next, Origin, Path, PathMode, Place, ProgramStream, Question,
    Speed, SpindleMode, SpindleState, Step, StepKind,
};
use std::collections::VecDeque;
use units::{Machine, Millimetres, Point, Rpm, Seconds, Setup, StepId, TICK, Transform, Vector, WorkingstepId};

/// Largest gap between the end of one move and the start of the next that is closed without a word, mm: programs round their numbers,
/// and an arc's end differs from the written one by as much.
const ROUNDING: f64 = 0.05;

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
    smoother: Smoother,
    profile: Profile,
    sampler: Sampler,
    /// Steps that stand between moves, in order; the profile's marks come out in the same order.
    marks: VecDeque<Vec<Output>>,
    ready: VecDeque<Output>,
    /// What comes when the motion at hand has come to rest.
    at_rest: Option<AtRest>,
    position: Point<Machine>,
    last_move: StepId,
    machine_from_setup: Transform<Machine, Setup>,
    tool_offset: Vector<Machine>,
    spindle: SpindleState,
    path_mode: PathMode,
    workingsteps: u32,
    spindle_told: (Rpm, u64),
    history: Option<([f64; 3], [f64; 3])>,
    statistics: Statistics,
    gaps: f64,
}

/// No machine reaches a kilometre: a coordinate beyond is a slip of the pen, and would be planned for hours.
const FARTHEST: f64 = 1e6;

/// The longest single move or dwell, s: a day.
const LONGEST: f64 = 86_400.0;

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
            profile: Profile::new(&limits),
            limits,
            smoother: Smoother::default(),
            sampler: Sampler::new(start.xyz),
            marks: VecDeque::new(),
            ready: VecDeque::new(),
            at_rest: None,
            position: start,
            last_move: StepId::NONE,
            machine_from_setup: Transform::IDENTITY,
            tool_offset: Vector::ZERO,
            spindle: SpindleState::Stopped,
            path_mode: PathMode::Tolerance(None),
            workingsteps: 0,
            spindle_told: (Rpm::ZERO, 0),
            history: Some((start.xyz, start.xyz)),
            statistics: Statistics::default(),
            gaps: 0.0,
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
            if let Sampled::SetPoint(point) = self.sampler.tick() {
                return self.give(point);
            }
            match self.profile.advance() {
                Some(Profiled::Phase(phase)) => self.sampler.feed(phase),
                Some(Profiled::Mark(_)) => self.ready.extend(self.marks.pop_front().into_iter().flatten()),
                None if self.at_rest.is_some() => {
                    if let Some(point) = self.sampler.rest(self.position.xyz, self.last_move) {
                        return self.give(point);
                    }
                    match self.at_rest.as_ref() {
                        Some(AtRest::Ask(question)) => return Output::Ask(question.clone()),
                        Some(AtRest::End) => return Output::End,
                        Some(AtRest::Alarm(alarm)) => return Output::Alarm((**alarm).clone()),
                        Some(AtRest::Outputs(_)) | None => {
                            if let Some(AtRest::Outputs(outputs)) = self.at_rest.take() {
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
            path_length: Millimetres(self.sampler.path_length()),
            max_deviation: Millimetres(self.smoother.max_deviation.max(self.gaps)),
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
                let piece = self.piece(m, &step)?;
                self.add(piece);
            }
            StepKind::MachineMove(MachineMove { to }) => {
                let target = std::array::from_fn(|k| to[k].map_or(self.position.xyz[k], |v| v.0));
                let path = Path::Line {
                    from: self.position,
                    to: Point::from_xyz(target),
                };
                if !path.is_sound() {
                    return Err(self.finding("bad-coordinate", "a machine coordinate is not a number", step.origin));
                }
                let length = path.length();
                self.reachable(&path, length, f64::INFINITY, step.origin)?;
                self.add(Piece {
                    path,
                    length,
                    feed: f64::INFINITY,
                    feed_factors: vec![],
                    rapid: true,
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
            StepKind::Begin(_) | StepKind::End(_) | StepKind::Message(_) | StepKind::NcFunction(_) => {
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
                    SpindleState::Stopped => SpindleCommand::Stop,
                    SpindleState::Clockwise(_) => SpindleCommand::Clockwise(speed),
                    SpindleState::Counterclockwise(_) => SpindleCommand::Counterclockwise(speed),
                };
                self.spindle_told = (speed, self.statistics.samples);
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

    /// A move in machine coordinates, closed up to where the last one ended.
    fn piece(&mut self, m: &Move, step: &Step) -> Result<Piece, Box<Diagnostic>> {
        let origin = step.origin;
        if !m.path.is_sound() {
            return Err(self.finding(
                "bad-geometry",
                "the path has a coordinate that is not a number, or counts that do not fit",
                origin,
            ));
        }
        let in_machine = m.path.in_frame(&self.machine_from_setup);
        let offset = self.tool_offset;
        let path = shifted(in_machine, offset);
        let gap = path.start().distance(self.position);
        let programmed_feed = match m.speed {
            Speed::Rapid => None,
            Speed::Feed(feed) => Some(feed),
        };
        let path = if gap <= 1e-9 {
            path
        } else if gap <= ROUNDING {
            self.gaps = self.gaps.max(gap);
            starting_at(path, self.position)
        } else {
            let from = self.tip(self.position);
            let message = format!(
                "the path starts {gap:.3} mm away from where the tip is: at {:.3?}, tip at {:.3?}",
                m.path.start().xyz,
                from.xyz
            );
            return Err(self.finding("path-gap", message, origin));
        };
        let length = path.length();
        self.statistics.blocks += 1;
        let profile = |fraction: f64| m.profile.as_ref().map_or(1.0, |p| p.factor(fraction));
        let bad_feed = |v: f64| {
            let message = format!("a feed of {v} mm/s cannot be moved at");
            with_remedy(self.finding("bad-feed", message, origin), "give the path a feed above 0")
        };
        let (feed, feed_factors) = match programmed_feed {
            None => (f64::INFINITY, vec![]),
            Some(Feed::PerTime(v)) => {
                if !(v.0 > 0.0 && v.is_finite()) {
                    return Err(bad_feed(v.0));
                }
                (
                    v.0,
                    m.profile
                        .as_ref()
                        .map_or(vec![], |_| (0..=32).map(|k| profile(f64::from(k) / 32.0)).collect()),
                )
            }
            Some(Feed::WholeMove(time)) => {
                let v = length / time.0;
                if !(v > 0.0 && v.is_finite()) && length > 0.0 {
                    return Err(bad_feed(v));
                }
                (v, vec![])
            }
            Some(Feed::PerRevolution(f)) => {
                let at = |fraction: f64| {
                    let radius = self.tip(path.at(fraction)).xyz[0];
                    f.0 * self.spindle.revolutions(Millimetres(radius)).0 / 60.0 * profile(fraction)
                };
                let constant = m.profile.is_none() && !self.surface_speed();
                let count: u32 = if constant { 0 } else { 32 };
                let speeds: Vec<f64> = (0..=count).map(|k| at(f64::from(k) / f64::from(count.max(1)))).collect();
                if speeds.iter().any(|v| !(*v > 0.0 && v.is_finite())) {
                    let found = self.finding(
                        "feed-without-spindle",
                        "a feed per revolution needs a turning spindle",
                        origin,
                    );
                    return Err(with_remedy(found, "start the spindle (M3 S...) before this move"));
                }
                if constant { (speeds[0], vec![]) } else { (1.0, speeds) }
            }
        };
        let fastest = feed_factors.iter().copied().fold(0.0, f64::max);
        let top = if feed_factors.is_empty() { feed } else { feed * fastest };
        self.reachable(&path, length, top, origin)?;
        let corner = match self.path_mode {
            PathMode::ExactStop => Corner::Stop,
            PathMode::ExactPath => Corner::Within(EXACT_PATH_TOLERANCE),
            PathMode::Tolerance(t) => Corner::Within(t.unwrap_or(self.limits.tolerance).0),
        };
        Ok(Piece {
            path,
            length,
            feed,
            feed_factors,
            rapid: programmed_feed.is_none(),
            step: step.id,
            corner,
        })
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
        self.position = piece.path.end();
        self.last_move = piece.step;
        // A move without length has no direction; it only names the place where the axes are.
        if piece.length <= 1e-9 {
            return;
        }
        let profile = &mut self.profile;
        self.smoother.push(piece, &mut |s| forward(profile, s));
    }

    fn mark(&mut self, outputs: Vec<Output>) {
        let profile = &mut self.profile;
        self.marks.push_back(outputs);
        self.smoother.mark(0, &mut |s| forward(profile, s));
    }

    fn come_to_rest(&mut self, then: AtRest) {
        let profile = &mut self.profile;
        self.smoother.finish(&mut |s| forward(profile, s));
        self.profile.close();
        self.at_rest = Some(then);
    }

    fn surface_speed(&self) -> bool {
        matches!(
            self.spindle,
            SpindleState::Clockwise(SpindleMode::Surface { .. }) | SpindleState::Counterclockwise(SpindleMode::Surface { .. })
        )
    }

    /// The tool tip in the set-up when the gauge point is at `gauge`.
    fn tip(&self, gauge: Point<Machine>) -> Point<Setup> {
        self.machine_from_setup.inverse() * (gauge - self.tool_offset)
    }

    /// Counts a set-point and holds it against the limits. With constant surface speed the spindle is told first when it has to change
    /// by 1 % or ten cycles have passed.
    fn give(&mut self, point: SetPoint) -> Output {
        let v_max = self.limits.v_max;
        let a_max = self.limits.a_max;
        let statistics = &mut self.statistics;
        statistics.samples += 1;
        statistics.time += TICK;
        if let Some((last, before)) = self.history {
            for k in 0..3 {
                let v = (point.position[k] - last[k]) / TICK.0;
                let a = (point.position[k] - 2.0 * last[k] + before[k]) / (TICK.0 * TICK.0);
                statistics.worst_speed_ratio = statistics.worst_speed_ratio.max(v.abs() / v_max[k].0);
                statistics.worst_acceleration_ratio = statistics.worst_acceleration_ratio.max(a.abs() / a_max[k].0);
            }
            self.history = Some((point.position, last));
        }
        if self.surface_speed() {
            let wanted = self
                .spindle
                .revolutions(Millimetres(self.tip(Point::from_xyz(point.position)).xyz[0]));
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

fn forward(profile: &mut Profile, smoothed: Smoothed) {
    match smoothed {
        Smoothed::Segment(segment) => profile.push(segment),
        Smoothed::Mark(mark) => profile.mark(mark),
    }
}

/// The same path, moved by the tool offset: where the gauge point goes.
fn shifted(path: Path<Machine>, by: Vector<Machine>) -> Path<Machine> {
    if by == Vector::ZERO {
        return path;
    }
    path.in_frame(&Transform::shift(by.xyz))
}

/// The same path, started a rounding away.
fn starting_at(path: Path<Machine>, place: Point<Machine>) -> Path<Machine> {
    match path {
        Path::Line { to, .. } => Path::Line { from: place, to },
        Path::Arc(mut arc) => {
            // The start moves in the arc's plane and the plane moves with it; the centre stays above its place.
            let d = place - arc.from;
            arc.centre = arc.centre + arc.normal * d.dot(arc.normal);
            arc.from = place;
            Path::Arc(arc)
        }
        Path::Spline(mut spline) => {
            if let Some(first) = spline.poles.first_mut() {
                *first = place;
            }
            Path::Spline(spline)
        }
    }
}

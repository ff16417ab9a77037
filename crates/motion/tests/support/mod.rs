//! A program from a generator, and the set-points it becomes: what the tests and the example share.
#![allow(dead_code, reason = "each user takes a part of it")]

pub mod laws;

use machine::{Command, SetPoint};
use motion::{Limits, Output, Statistics, Trajectory};
use plan::{
    Answer, Diagnostic, Feed, FileId, Move, Next, Origin, Path, PathMode, Place, ProgramStream, Question, Speed, Step, StepKind,
};
use units::{Machine, Millimetres, MmPerSec, MmPerSec2, Point, Setup, StepId};

/// A program whose steps come from a function of their index.
pub struct Generated<F> {
    pub step: F,
    pub next: u32,
    pub ask_at: Option<u32>,
    pub answers: Vec<Answer>,
}

impl<F: FnMut(u32) -> Option<StepKind>> Generated<F> {
    pub fn new(step: F) -> Self {
        Generated {
            step,
            next: 0,
            ask_at: None,
            answers: vec![],
        }
    }
}

impl<F: FnMut(u32) -> Option<StepKind>> ProgramStream for Generated<F> {
    fn next(&mut self, answer: Option<Answer>) -> Next {
        self.answers.extend(answer);
        if self.ask_at == Some(self.next) {
            self.ask_at = None;
            return Next::Ask(Question::OptionalStop);
        }
        match (self.step)(self.next) {
            None => Next::End,
            Some(kind) => {
                self.next += 1;
                Next::Step(Step {
                    id: StepId(self.next),
                    origin: Origin {
                        file: FileId(0),
                        place: Place::Given,
                    },
                    kind,
                })
            }
        }
    }
    fn rewind(&mut self) {
        self.next = 0;
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "generated"
    }
}

pub fn program(steps: Vec<StepKind>) -> Generated<impl FnMut(u32) -> Option<StepKind>> {
    Generated::new(move |k| steps.get(k as usize).cloned())
}

pub fn feed_move(path: Path<Setup>, mm_per_min: f64) -> StepKind {
    let speed = Speed::Feed(Feed::PerTime(MmPerSec::from_mm_per_min(mm_per_min)));
    StepKind::Move(Move {
        path,
        speed,
        profile: None,
        derived: false,
    })
}

pub fn line(from: [f64; 3], to: [f64; 3]) -> Path<Setup> {
    Path::Line {
        from: Point::from_xyz(from),
        to: Point::from_xyz(to),
    }
}

/// The reference machine of `motion-references`: 500 mm/s, 3000 mm/s^2 each axis.
pub fn reference(tolerance: f64) -> Limits {
    Limits::uniform(MmPerSec(500.0), MmPerSec2(3000.0), Millimetres(tolerance))
}

/// The same with its jerk, 50 000 mm/s^3 each axis.
pub fn jerk_limited(tolerance: f64) -> Limits {
    Limits {
        j_max: Some([units::MmPerSec3(50_000.0); 3]),
        ..reference(tolerance)
    }
}

/// Lines through points at one feed.
pub fn polyline(points: &[[f64; 3]], mm_per_min: f64, mode: PathMode) -> Vec<StepKind> {
    std::iter::once(StepKind::PathMode(mode))
        .chain(points.windows(2).map(|p| feed_move(line(p[0], p[1]), mm_per_min)))
        .collect()
}

pub struct Planned {
    pub points: Vec<SetPoint>,
    pub others: Vec<Output>,
    pub statistics: Statistics,
}

/// Everything a program becomes from `start`.
pub fn plan(stream: impl ProgramStream, start: [f64; 3], limits: Limits) -> Planned {
    all_of(Trajectory::new(Box::new(stream), Point::<Machine>::from_xyz(start), limits))
}

/// Everything that a trajectory gives.
pub fn all_of(mut trajectory: Trajectory<'_>) -> Planned {
    let (mut points, mut others) = (vec![], vec![]);
    let mut answer = None;
    loop {
        match trajectory.next(answer.take()) {
            Output::Command(Command::SetPoint(p)) => points.push(p),
            end @ (Output::End | Output::Alarm(_)) => {
                others.push(end);
                break;
            }
            other => {
                if matches!(other, Output::Ask(_)) {
                    answer = Some(Answer::Truth(true));
                }
                others.push(other);
            }
        }
    }
    Planned {
        points,
        others,
        statistics: trajectory.statistics(),
    }
}

/// Places of a path no farther apart than this, mm, behind the first.
const APART: f64 = 0.003;

fn evenly(path: &Path<Setup>, [from, to]: [f64; 2], places: &mut Vec<[f64; 3]>) {
    let end = path.at(to);
    // A long part may begin and end at one place.
    let middle = 0.5 * (from + to);
    let far = path.at(from).distance(end).max(2.0 * path.at(middle).distance(end));
    let looked_at = to - from < 0.01 || matches!(path, Path::Line { .. });
    if (far <= APART && looked_at) || middle <= from || middle >= to {
        places.push(end.xyz);
    } else {
        evenly(path, [from, middle], places);
        evenly(path, [middle, to], places);
    }
}

/// The largest distance of a set-point from the paths.
pub fn distance(planned: &Planned, paths: &[Path<Setup>]) -> f64 {
    let mut places = vec![];
    for path in paths {
        places.push(path.start().xyz);
        evenly(path, [0.0, 1.0], &mut places);
    }
    // Set-points go along the path, so the nearest place is not far from that of the one before; it is looked for ahead and a little back.
    let (mut at, mut worst) = (0usize, 0.0f64);
    for point in &planned.points {
        let squared = |k: usize| {
            let (a, b) = (places[k], places[(k + 1).min(places.len() - 1)]);
            let (mut along, mut long) = (0.0, 0.0);
            for axis in 0..3 {
                along += (point.position[axis] - a[axis]) * (b[axis] - a[axis]);
                long += (b[axis] - a[axis]) * (b[axis] - a[axis]);
            }
            let share = if long > 0.0 { (along / long).clamp(0.0, 1.0) } else { 0.0 };
            let off = (0..3).map(|axis| point.position[axis] - a[axis] - share * (b[axis] - a[axis]));
            off.map(|d| d * d).sum::<f64>()
        };
        let range = at.saturating_sub(50)..(at + 800).min(places.len());
        at = range
            .min_by(|a, b| squared(*a).total_cmp(&squared(*b)))
            .expect("there are places");
        worst = worst.max(squared(at).sqrt());
    }
    worst
}

/// Plans paths that follow each other; limits hold, and the end is reached.
#[track_caller]
pub fn planned(paths: &[Path<Setup>], mm_per_min: f64, mode: PathMode) -> Planned {
    let moves = paths.iter().map(|path| feed_move(path.clone(), mm_per_min));
    let steps = std::iter::once(StepKind::PathMode(mode)).chain(moves).collect();
    let planned = plan(program(steps), paths[0].start().xyz, jerk_limited(0.01));
    assert!(
        matches!(planned.others.last(), Some(Output::End)),
        "{:?}",
        planned.others.last()
    );
    let s = planned.statistics;
    for (what, ratio) in [
        ("speed", s.worst_speed_ratio),
        ("acceleration", s.worst_acceleration_ratio),
        ("jerk", s.worst_jerk_ratio.expect("there is a limit")),
    ] {
        assert!(ratio <= 1.001, "{what} {ratio} of its limit");
    }
    let end = paths[paths.len() - 1].end().xyz;
    let last = planned.points.last().expect("it moves").position;
    assert!(
        (0..3).all(|k| (last[k] - end[k]).abs() < 1e-9),
        "ends at {last:?}, not at {end:?}"
    );
    planned
}

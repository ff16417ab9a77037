//! A machine for tests: runs a program under constant acceleration, knows the truth of every millisecond, and is sampled like an agent
//! samples.
#![allow(dead_code, reason = "each test uses its part")]

use asrun::{PlanOptions, PlannedProgram, RecordFrame, RecordPoint, Recording};
use plan::executed::PathKind;
use plan::{
    Answer, Arc, Diagnostic, Feed, FileId, FrameChange, Level, Marker, Move, Next, Origin, Path, Place, ProgramStream, Speed,
    Spline, Step, StepKind, ToolCall, ToolOffset,
};
use std::collections::BTreeMap;
use units::{Machine, Millimetres, MmPerSec, Point, Radians, Seconds, Setup, StepId, Timestamp, ToolNumber, Transform, Vector};

/// Random numbers from a seed (SplitMix64).
pub struct Dice(pub u64);

impl Dice {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    /// Even in 0..1.
    pub fn even(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.even()
    }
    /// About normal, mean 0, deviation 1.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.even()).sum::<f64>() - 6.0
    }
}

/// A program held in memory.
#[derive(Clone, Default)]
pub struct Script {
    pub steps: Vec<Step>,
    at: usize,
    tip: [f64; 3],
}

impl ProgramStream for Script {
    fn next(&mut self, _answer: Option<Answer>) -> Next {
        self.at += 1;
        self.steps.get(self.at - 1).map_or(Next::End, |s| Next::Step(s.clone()))
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

impl Script {
    pub fn push(&mut self, kind: StepKind) -> StepId {
        let id = StepId(self.steps.len() as u32 + 1);
        let origin = Origin {
            file: FileId(0),
            place: Place::Given,
        };
        self.steps.push(Step { id, origin, kind });
        id
    }
    pub fn frame(&mut self, name: &str, origin: [f64; 3]) {
        self.push(StepKind::Frame(FrameChange {
            name: name.into(),
            machine_from_setup: Transform::<Machine, Setup>::shift(origin),
            assumed: false,
        }));
    }
    pub fn tool(&mut self, number: u32, length: f64, wear: f64) {
        self.push(StepKind::Tool(ToolCall {
            number: ToolNumber(number),
            name: String::new(),
            diameter: None,
        }));
        self.push(StepKind::ToolOffset(ToolOffset {
            number,
            geometry: Vector::new(0.0, 0.0, length),
            wear: Vector::new(0.0, 0.0, wear),
            assumed: false,
        }));
    }
    pub fn begin(&mut self, level: Level, name: &str, entity: u64) {
        self.push(StepKind::Begin(Marker {
            level,
            name: name.into(),
            entity: Some(entity),
            maximum_deviation: None,
            derived: false,
        }));
    }
    pub fn end(&mut self, level: Level) {
        self.push(StepKind::End(level));
    }
    pub fn path(&mut self, path: Path<Setup>, feed: Option<f64>) -> StepId {
        self.tip = path.end().xyz;
        let speed = feed.map_or(Speed::Rapid, |f| Speed::Feed(Feed::PerTime(MmPerSec(f))));
        self.push(StepKind::Move(Move {
            path,
            speed,
            profile: None,
            derived: false,
        }))
    }
    pub fn line(&mut self, to: [f64; 3], feed: Option<f64>) -> StepId {
        let from = Point::from_xyz(self.tip);
        self.path(
            Path::Line {
                from,
                to: Point::from_xyz(to),
            },
            feed,
        )
    }
    /// A full circle in XY around a centre, from where the tip is.
    pub fn circle(&mut self, centre: [f64; 2], feed: f64) -> StepId {
        let from = Point::from_xyz(self.tip);
        let centre = Point::new(centre[0], centre[1], self.tip[2]);
        self.path(
            Path::Arc(Arc {
                from,
                centre,
                normal: Vector::Z,
                sweep: Radians(std::f64::consts::TAU),
                rise: 0.0,
            }),
            Some(feed),
        )
    }
    pub fn spline(&mut self, poles: &[[f64; 3]], feed: f64) -> StepId {
        let mut all = vec![Point::from_xyz(self.tip)];
        all.extend(poles.iter().map(|p| Point::from_xyz(*p)));
        let inner = all.len() - 4;
        let mut knots = vec![0.0; 4];
        knots.extend((1..=inner).map(|k| k as f64));
        knots.extend([inner as f64 + 1.0; 4]);
        self.path(
            Path::Spline(Spline {
                degree: 3,
                poles: all,
                weights: vec![],
                knots,
            }),
            Some(feed),
        )
    }
    pub fn tip(&self) -> [f64; 3] {
        self.tip
    }
    pub fn plan(&self) -> PlannedProgram {
        let options = PlanOptions {
            rapid: [MmPerSec(RAPID); 3],
            ..PlanOptions::default()
        };
        PlannedProgram::read(&mut self.clone(), "test", &options, &mut |_| Answer::Unknown)
    }
}

pub const RAPID: f64 = 400.0;
const ACCELERATION: f64 = 3000.0;

/// A part with faces, pockets, drilled holes, arcs and a spline; two set-ups, three tools. Dimensions from the dice.
pub fn part(dice: &mut Dice) -> Script {
    let mut s = Script::default();
    s.begin(Level::Workplan, "main", 10);
    s.frame("G54", [-300.0, -200.0, -150.0]);
    let feed = dice.between(6.0, 20.0);
    s.tool(1, 80.0, 0.0);
    s.begin(Level::Workingstep, "face", 20);
    s.line([-10.0, 0.0, 50.0], None);
    s.line([-10.0, 0.0, 2.0], None);
    s.line([-10.0, 0.0, -1.0], Some(feed / 2.0));
    let step = dice.between(4.0, 9.0);
    for k in 0..4 {
        let y = f64::from(k) * step;
        s.line([60.0, y, -1.0], Some(feed));
        s.line([60.0, y, 2.0], None);
        s.line([-10.0, y + step, 2.0], None);
        s.line([-10.0, y + step, -1.0], Some(feed / 2.0));
    }
    s.line([60.0, 4.0 * step, -1.0], Some(feed));
    s.line([60.0, 4.0 * step, 50.0], None);
    s.end(Level::Workingstep);
    s.tool(2, 110.0, -0.02);
    s.begin(Level::Workingstep, "holes", 30);
    for k in 0..6 {
        let (x, y) = (5.0 + f64::from(k) * 9.0, dice.between(3.0, 25.0));
        s.line([x, y, 5.0], None);
        s.line([x, y, 1.0], None);
        s.line([x, y, -dice.between(3.0, 8.0)], Some(feed / 3.0));
        if k % 2 == 0 {
            s.push(StepKind::Dwell(Seconds(0.5)));
        }
        s.line([x, y, 5.0], None);
    }
    s.line([30.0, 15.0, 50.0], None);
    s.end(Level::Workingstep);
    s.frame("G55", [-100.0, -200.0, -150.0]);
    s.tool(3, 95.0, 0.0);
    s.begin(Level::Workingstep, "pocket", 40);
    // The same place of the machine, seen from the other set-up.
    let back = s.tip();
    s.tip = [back[0] - 200.0, back[1], back[2]];
    s.line([20.0, 20.0, 50.0], None);
    s.line([20.0, 20.0, 1.0], None);
    for depth in 1..=3 {
        let z = -f64::from(depth);
        s.line([20.0, 20.0, z], Some(feed / 3.0));
        s.line([28.0, 20.0, z], Some(feed));
        s.circle([20.0, 20.0], feed);
        s.line([20.0, 20.0, z], Some(feed));
    }
    s.line([20.0, 20.0, 2.0], None);
    s.line([50.0, 0.0, 2.0], None);
    s.line([50.0, 0.0, -2.0], Some(feed / 3.0));
    s.spline(
        &[
            [60.0, 10.0, -2.0],
            [40.0, 20.0, -3.0],
            [70.0, 30.0, -2.0],
            [55.0, 40.0, -1.0],
            [50.0, 50.0, -2.0],
        ],
        feed,
    );
    s.line([50.0, 50.0, 50.0], None);
    s.end(Level::Workingstep);
    s.end(Level::Workplan);
    s
}

/// One millisecond of truth.
#[derive(Clone, Copy)]
pub struct Truth {
    pub tip: [f64; 3],
    pub gauge: [f64; 3],
    pub step: StepId,
    pub kind: Option<PathKind>,
}

/// Runs a program; tool changes take two seconds. `ratio` is the feed override.
pub fn run(script: &Script, ratio: f64) -> Vec<Truth> {
    run_with(script, ratio, ACCELERATION)
}

pub fn run_with(script: &Script, ratio: f64, acceleration: f64) -> Vec<Truth> {
    let mut truth: Vec<Truth> = Vec::new();
    let mut machine_from_setup = Transform::<Machine, Setup>::IDENTITY;
    let mut offset = Vector::<Machine>::ZERO;
    // Moves in one breath: joined without a stop.
    let mut breath: Vec<(StepId, Path<Setup>, f64, PathKind)> = Vec::new();
    let gauge_of = |m: &Transform<Machine, Setup>, o: Vector<Machine>, p: Point<Setup>| (*m * p + o).xyz;
    fn flush(
        breath: &mut Vec<(StepId, Path<Setup>, f64, PathKind)>,
        m: &Transform<Machine, Setup>,
        o: Vector<Machine>,
        truth: &mut Vec<Truth>,
        a: f64,
    ) {
        let n = breath.len();
        if n == 0 {
            return;
        }
        let mut joint = vec![0.0f64; n + 1];
        for k in 1..n {
            let (before, after) = (&breath[k - 1], &breath[k]);
            let t0 = before.1.derivatives(1.0).0.unit();
            let t1 = after.1.derivatives(0.0).0.unit();
            if let (Some(t0), Some(t1)) = (t0, t1)
                && t0.dot(t1) > 0.999
            {
                joint[k] = before.2.min(after.2);
            }
        }
        let lengths: Vec<f64> = breath.iter().map(|b| b.1.length()).collect();
        for k in (0..n).rev() {
            joint[k] = joint[k].min((joint[k + 1] * joint[k + 1] + 2.0 * a * lengths[k]).sqrt());
        }
        for k in 0..n {
            joint[k + 1] = joint[k + 1].min((joint[k] * joint[k] + 2.0 * a * lengths[k]).sqrt());
        }
        // Time left over from the move before, so that ticks stay a millisecond apart.
        let mut rest = 0.0;
        for k in 0..n {
            let (step, path, speed, kind) = &breath[k];
            let (v0, v1, length) = (joint[k], joint[k + 1], lengths[k]);
            let top = (a * length + (v0 * v0 + v1 * v1) / 2.0).sqrt().min(*speed).max(v0).max(v1);
            let (up, down) = ((top - v0) / a, (top - v1) / a);
            let (rise, fall) = ((top * top - v0 * v0) / (2.0 * a), (top * top - v1 * v1) / (2.0 * a));
            let flat = if top > 0.0 {
                (length - rise - fall).max(0.0) / top
            } else {
                0.0
            };
            let total = up + flat + down;
            let table = LengthTable::new(path, length);
            let mut t = rest;
            while t < total {
                let s = if t < up {
                    v0 * t + a * t * t / 2.0
                } else if t < up + flat {
                    rise + top * (t - up)
                } else {
                    let left = total - t;
                    length - v1 * left - a * left * left / 2.0
                };
                let p = path.at(table.parameter(s));
                truth.push(Truth {
                    tip: p.xyz,
                    gauge: (*m * p + o).xyz,
                    step: *step,
                    kind: Some(*kind),
                });
                t += 1e-3;
            }
            rest = t - total;
        }
        breath.clear();
    }
    let mut tip = Point::<Setup>::ORIGIN;
    for step in &script.steps {
        match &step.kind {
            StepKind::Move(m) => {
                let (speed, kind) = match m.speed {
                    Speed::Rapid => (RAPID, PathKind::Rapid),
                    Speed::Feed(Feed::PerTime(v)) => (v.0 * ratio, PathKind::Feed),
                    Speed::Feed(_) => unreachable!("the tests give feeds per time"),
                };
                tip = m.path.end();
                breath.push((step.id, m.path.clone(), speed, kind));
            }
            StepKind::Dwell(time) => {
                flush(&mut breath, &machine_from_setup, offset, &mut truth, acceleration);
                let gauge = gauge_of(&machine_from_setup, offset, tip);
                let ticks = (time.0 * 1000.0) as usize;
                truth.extend((0..ticks).map(|_| Truth {
                    tip: tip.xyz,
                    gauge,
                    step: step.id,
                    kind: Some(PathKind::Dwell),
                }));
            }
            StepKind::Tool(_) => {
                flush(&mut breath, &machine_from_setup, offset, &mut truth, acceleration);
                // Before the first move nobody knows where the machine stands.
                if let Some(last) = truth.last().copied() {
                    truth.extend((0..2000).map(|_| Truth {
                        step: step.id,
                        kind: None,
                        ..last
                    }));
                }
            }
            StepKind::ToolOffset(o) => {
                flush(&mut breath, &machine_from_setup, offset, &mut truth, acceleration);
                offset = o.total();
            }
            StepKind::Frame(f) => {
                flush(&mut breath, &machine_from_setup, offset, &mut truth, acceleration);
                machine_from_setup = f.machine_from_setup;
            }
            _ => {}
        }
    }
    flush(&mut breath, &machine_from_setup, offset, &mut truth, acceleration);
    truth
}

/// Parameter by length, for curves whose parameter is not their length.
struct LengthTable(Vec<(f64, f64)>);

impl LengthTable {
    fn new(path: &Path<Setup>, length: f64) -> Self {
        let Path::Spline(spline) = path else {
            return LengthTable(vec![(0.0, 0.0), (length, 1.0)]);
        };
        LengthTable(
            (0..=400)
                .map(|k| f64::from(k) / 400.0)
                .map(|u| (if u > 0.0 { spline.length_between(0.0, u) } else { 0.0 }, u))
                .collect(),
        )
    }
    fn parameter(&self, s: f64) -> f64 {
        let after = self.0.partition_point(|e| e.0 < s).clamp(1, self.0.len() - 1);
        let (a, b) = (self.0[after - 1], self.0[after]);
        if b.0 > a.0 {
            (a.1 + (b.1 - a.1) * (s - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
        } else {
            a.1
        }
    }
}

/// How the truth is sampled.
#[derive(Clone, Copy)]
pub struct Sampling {
    pub milliseconds: f64,
    /// Share of the interval by which samples come early or late.
    pub jitter: f64,
    /// Noise of each coordinate, mm.
    pub noise: f64,
    pub frame: RecordFrame,
    pub with_steps: bool,
}

/// A record of a run, and the index of the truth behind each of its points.
pub fn sample(truth: &[Truth], sampling: &Sampling, dice: &mut Dice) -> (Recording, Vec<usize>) {
    let mut points = Vec::new();
    let mut from = Vec::new();
    let mut k = 0u64;
    loop {
        let nominal = k as f64 * sampling.milliseconds + sampling.milliseconds / 2.0;
        let at = (nominal + sampling.jitter * sampling.milliseconds * dice.between(-0.5, 0.5)).round() as usize;
        if at >= truth.len() {
            break;
        }
        k += 1;
        if from.last() == Some(&at) {
            continue;
        }
        let place = if sampling.frame == RecordFrame::Machine {
            truth[at].gauge
        } else {
            truth[at].tip
        };
        points.push(RecordPoint {
            at: Timestamp(1_700_000_000_000_000_000 + at as i64 * 1_000_000),
            position: place.map(|c| c + sampling.noise * dice.normal()),
            step: if sampling.with_steps { truth[at].step } else { StepId::NONE },
            sequence: k,
        });
        from.push(at);
    }
    let recording = Recording {
        points,
        frame: sampling.frame,
        source: "SIMULATED test".into(),
        simulated: true,
        gaps: Vec::new(),
        events: Vec::new(),
    };
    (recording, from)
}

/// The kind that a rebuild gave each sample, by its time.
pub fn kinds_of(executed: &plan::executed::AsExecuted) -> BTreeMap<i64, PathKind> {
    let mut kinds = BTreeMap::new();
    for toolpath in executed.workingsteps.iter().flat_map(|w| &w.toolpaths) {
        for point in &toolpath.points {
            kinds.insert(point.at.0, toolpath.kind);
        }
    }
    kinds
}

/// Hits, false alarms and misses of one class.
#[derive(Clone, Copy, Default, Debug)]
pub struct Score {
    pub hit: u32,
    pub false_alarm: u32,
    pub miss: u32,
}

impl Score {
    pub fn f1(&self) -> f64 {
        let (hit, off) = (f64::from(self.hit), f64::from(self.false_alarm + self.miss));
        2.0 * hit / (2.0 * hit + off)
    }
    pub fn add(&mut self, truth: bool, said: bool) {
        self.hit += u32::from(truth && said);
        self.false_alarm += u32::from(said && !truth);
        self.miss += u32::from(truth && !said);
    }
}

pub fn millimetres(v: f64) -> Millimetres {
    Millimetres(v)
}

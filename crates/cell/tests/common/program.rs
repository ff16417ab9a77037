//! A program as a stream of steps, for the real planner.
#![allow(dead_code, reason = "each test uses a part of it")]

use plan::{
    Answer, Arc, Diagnostic, Feed, FileId, FrameChange, Level, Marker, Move, Next, Origin, Path, Place, ProgramStream, Speed,
    SpindleMode, SpindleState, Step, StepKind, ToolCall, ToolOffset,
};
use units::{Millimetres, MmPerSec, Point, Radians, Rpm, Seconds, Setup, StepId, ToolNumber, Transform, Vector};

/// A program from a list.
pub struct Listed(pub Vec<StepKind>, pub usize);

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

/// Where the set-up stands in the machine.
pub const ORIGIN: [f64; 3] = [-100.0, 50.0, -80.0];
/// From tip to gauge point.
pub const LENGTH: f64 = 60.0;

struct Writer {
    steps: Vec<StepKind>,
    tip: Point<Setup>,
}

impl Writer {
    fn to(&mut self, x: f64, y: f64, z: f64, feed: Option<f64>) {
        let end = Point::new(x, y, z);
        let path = Path::Line { from: self.tip, to: end };
        self.push(path, feed);
    }

    fn push(&mut self, path: Path<Setup>, feed: Option<f64>) {
        self.tip = path.end();
        self.steps.push(StepKind::Move(Move {
            path,
            speed: feed.map_or(Speed::Rapid, |f| Speed::Feed(Feed::PerTime(MmPerSec(f)))),
            profile: None,
            derived: false,
        }));
    }

    fn begin(&mut self, name: &str) {
        self.steps.push(StepKind::Begin(Marker {
            level: Level::Workingstep,
            name: name.to_owned(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        }));
    }

    fn end(&mut self) {
        self.steps.push(StepKind::End(Level::Workingstep));
    }
}

/// Three workingsteps, `times` over: a square with blended corners, a helix, a zig-zag of short blocks.
pub fn program(times: u32) -> Listed {
    let frame = Transform::shift(ORIGIN);
    let home: Point<Setup> = frame.inverse() * Point::new(0.0, 0.0, -LENGTH);
    let mut w = Writer {
        steps: vec![
            StepKind::Frame(FrameChange {
                name: "G54".to_owned(),
                machine_from_setup: frame,
                assumed: false,
            }),
            StepKind::Tool(ToolCall {
                number: ToolNumber(2),
                name: "end mill 10".to_owned(),
                diameter: Some(Millimetres(10.0)),
            }),
            StepKind::ToolOffset(ToolOffset {
                number: 2,
                geometry: Vector::new(0.0, 0.0, LENGTH),
                ..ToolOffset::NONE
            }),
            StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(8000.0)))),
        ],
        tip: home,
    };
    for _ in 0..times {
        w.begin("square");
        w.to(0.0, 0.0, 5.0, None);
        w.to(0.0, 0.0, -1.0, Some(20.0));
        for (x, y) in [(30.0, 0.0), (30.0, 20.0), (0.0, 20.0), (0.0, 0.0)] {
            w.to(x, y, -1.0, Some(100.0));
        }
        w.to(0.0, 0.0, 5.0, None);
        w.end();
        w.begin("helix");
        w.to(25.0, 10.0, 5.0, None);
        let helix = Path::Arc(Arc {
            from: w.tip,
            centre: Point::new(15.0, 10.0, 5.0),
            normal: Vector::Z,
            sweep: Radians(4.0 * std::f64::consts::PI),
            rise: -6.0,
        });
        w.push(helix, Some(80.0));
        w.to(25.0, 10.0, 5.0, None);
        w.end();
        w.steps.push(StepKind::Dwell(Seconds(0.1)));
        w.begin("zig-zag");
        for k in 0..40 {
            let x = f64::from(k) * 0.5;
            w.to(x, if k % 2 == 0 { 0.0 } else { 1.0 }, -1.0, Some(50.0));
        }
        w.to(0.0, 0.0, 50.0, None);
        w.end();
    }
    Listed(w.steps, 0)
}

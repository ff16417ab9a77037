//! A hand-made program: straight moves from rest to rest with trapezoidal speed, and everything else that a run can meet.
#![allow(dead_code, reason = "each test uses a part of it")]

use cell::Output;
use cell::source::Planned;
use machine::{Command, CoolantOutlets, SetPoint, SpindleCommand};
use plan::{
    CoolantState, FileId, FrameChange, Level, Marker, Origin, Place, SpindleMode, SpindleState, Step, StepKind, ToolCall,
    ToolOffset,
};
use units::{Millimetres, Rpm, StepId, ToolNumber, Transform, Vector, WorkingstepId};

const T: f64 = 0.001;

/// Writes a planned program.
#[derive(Default)]
pub struct Writer {
    outputs: Vec<Output>,
    step: u32,
    workingsteps: u32,
    at: [f64; 3],
    length: f64,
}

impl Writer {
    pub fn finish(self) -> Planned {
        Planned {
            outputs: self.outputs.into(),
        }
    }

    pub fn pass(&mut self, kind: StepKind) -> StepId {
        self.step += 1;
        let id = StepId(self.step);
        self.outputs.push(Output::Passed(Step {
            id,
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            kind,
        }));
        id
    }

    pub fn say(&mut self, output: Output) {
        self.outputs.push(output);
    }

    pub fn command(&mut self, command: Command) {
        self.outputs.push(Output::Command(command));
    }

    pub fn frame(&mut self, origin: [f64; 3]) {
        self.pass(StepKind::Frame(FrameChange {
            name: "G54".to_owned(),
            machine_from_setup: Transform::shift(origin),
            assumed: false,
        }));
    }

    pub fn tool(&mut self, number: u32, diameter: f64) {
        let tool = ToolNumber(number);
        let step = self.pass(StepKind::Tool(ToolCall {
            number: tool,
            name: format!("tool {number}"),
            diameter: Some(Millimetres(diameter)),
        }));
        self.command(Command::Tool { tool, step });
    }

    pub fn tool_offset(&mut self, geometry: [f64; 3], wear: [f64; 3]) {
        self.pass(StepKind::ToolOffset(ToolOffset {
            number: 1,
            geometry: Vector::from_xyz(geometry),
            wear: Vector::from_xyz(wear),
            assumed: false,
        }));
    }

    pub fn spindle(&mut self, rpm: f64) {
        let step = self.pass(StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(rpm)))));
        let spindle = SpindleCommand::Clockwise(Rpm(rpm));
        self.command(Command::Spindle { spindle, step });
    }

    pub fn coolant(&mut self, flood: bool) {
        let step = self.pass(StepKind::Coolant(CoolantState {
            flood,
            ..CoolantState::default()
        }));
        let outlets = CoolantOutlets {
            flood,
            ..CoolantOutlets::default()
        };
        self.command(Command::Coolant { outlets, step });
    }

    pub fn begin(&mut self, name: &str) {
        self.workingsteps += 1;
        let step = self.pass(StepKind::Begin(Marker {
            level: Level::Workingstep,
            name: name.to_owned(),
            entity: Some(u64::from(100 * self.workingsteps)),
            maximum_deviation: None,
            derived: false,
        }));
        let workingstep = WorkingstepId(self.workingsteps);
        self.command(Command::Workingstep { workingstep, step });
    }

    pub fn end(&mut self) {
        let step = self.pass(StepKind::End(Level::Workingstep));
        let workingstep = WorkingstepId(0);
        self.command(Command::Workingstep { workingstep, step });
    }

    /// A straight move to a machine position, from rest to rest.
    pub fn go(&mut self, to: [f64; 3], speed: f64) {
        self.step += 1;
        let acceleration = 2000.0;
        let from = self.at;
        let way: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
        let length = way.iter().map(|d| d * d).sum::<f64>().sqrt();
        let speed = speed.min((length * acceleration).sqrt());
        let ramp = speed / acceleration;
        let total = length / speed + ramp;
        for n in 1..=(total / T).ceil() as u32 {
            let t = (f64::from(n) * T).min(total);
            let (s, v, a) = if t < ramp {
                (acceleration * t * t / 2.0, acceleration * t, acceleration)
            } else if t > total - ramp {
                let left = total - t;
                (length - acceleration * left * left / 2.0, acceleration * left, -acceleration)
            } else {
                (speed * (t - ramp / 2.0), speed, 0.0)
            };
            let part = |q: f64| std::array::from_fn(|k| way[k] / length * q);
            self.command(Command::SetPoint(SetPoint {
                position: std::array::from_fn(|k| from[k] + way[k] / length * s),
                velocity: part(v),
                acceleration: part(a),
                step: StepId(self.step),
                path_length: self.length + s,
                path_speed: v,
                ..SetPoint::default()
            }));
        }
        self.length += length;
        self.at = to;
    }

    /// A rectangle of feed moves between two rapids.
    pub fn rectangle(&mut self, name: &str, corner: [f64; 2], size: [f64; 2], depth: f64) {
        self.begin(name);
        let ([x, y], [w, h]) = (corner, size);
        self.go([x, y, 20.0], 400.0);
        self.go([x, y, depth], 30.0);
        for [px, py] in [[x + w, y], [x + w, y + h], [x, y + h], [x, y]] {
            self.go([px, py, depth], 60.0);
        }
        self.go([x, y, 20.0], 400.0);
        self.end();
    }
}

/// Two workingsteps with two tools, some five seconds.
pub fn small_program() -> Planned {
    let mut w = Writer::default();
    w.frame([0.0; 3]);
    w.tool(1, 10.0);
    w.tool_offset([0.0; 3], [0.0; 3]);
    w.spindle(6000.0);
    w.coolant(true);
    w.rectangle("outside", [10.0, 10.0], [20.0, 15.0], -1.0);
    w.command(Command::Dwell {
        cycles: 100,
        step: StepId(w.step),
    });
    w.rectangle("inside", [15.0, 15.0], [8.0, 6.0], -2.0);
    w.finish()
}

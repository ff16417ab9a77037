//! What a program can ask of a machine, one [`Step`] at a time.
//!
//! Places are tool-tip points in the set-up frame ([`units::Setup`]); lathe X is a radius. Speeds are per second, spindle speeds per
//! minute. A step never carries text that a later stage has to parse, except [`RawNcFunction`], whose meaning belongs to `trace`.

use crate::expression::Expression;
use crate::path::Path;
use std::collections::BTreeMap;
use units::{Machine, Millimetres, MmPerSec, Radians, Rpm, Seconds, Setup, StepId, ToolNumber, Transform, Vector};

/// One thing to do, with where it was said.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Its number in the stream, from 1, without gaps.
    pub id: StepId,
    /// Where the program says it.
    pub origin: Origin,
    /// What to do.
    pub kind: StepKind,
}

/// The n-th file a program is made of, as its reader numbers them; 0 is the program itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct FileId(pub u16);

/// Where a step was said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Which file.
    pub file: FileId,
    /// Where in it.
    pub place: Place,
}

/// A place in a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A block of text: its 1-based line and its bytes.
    Text {
        /// 1-based line.
        line: u32,
        /// Offset of the first byte.
        start: u64,
        /// Length in bytes.
        length: u32,
    },
    /// A STEP instance.
    Entity(u64),
    /// Nowhere in a file: an operation of a live job, or a step that was put in by us.
    Given,
}

impl Origin {
    /// The STEP instance, when it is one.
    pub fn entity(&self) -> Option<u64> {
        match self.place {
            Place::Entity(id) => Some(id),
            _ => None,
        }
    }
}

/// What to do.
#[derive(Clone, Debug, PartialEq)]
pub enum StepKind {
    /// Move the tool tip along a path in the set-up.
    Move(Move),
    /// Move axes to machine coordinates (G53, G28): no set-up, no tool offset.
    MachineMove(MachineMove),
    /// Stand still, exactly, for a time.
    Dwell(Seconds),
    /// Put a tool in the spindle.
    Tool(ToolCall),
    /// From here this offset lies between gauge point and tip.
    ToolOffset(ToolOffset),
    /// Turn the spindle, or stop it.
    Spindle(SpindleState),
    /// Set all coolant outlets.
    Coolant(CoolantState),
    /// From here points are written in this frame.
    Frame(FrameChange),
    /// From here paths are followed this closely.
    PathMode(PathMode),
    /// A part of the program's structure begins.
    Begin(Marker),
    /// The innermost open part of this level ends.
    End(Level),
    /// Text for the operator; the machine does not wait.
    Message(String),
    /// The machine stops and waits for cycle start.
    Stop(StopKind),
    /// The program writes a register of the machine: later moves use it, and it is a record.
    Register(RegisterChange),
    /// A function whose meaning is not the motion's: traceability, or something unknown that is kept and shown.
    NcFunction(RawNcFunction),
}

/// A register of the machine's tables written by the program. Lengths are mm, X of a lathe as a radius.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisterChange {
    /// Which.
    pub register: Register,
    /// What it held, as far as the program knows; `None` is vacant.
    pub before: Option<f64>,
    /// What it holds from here.
    pub after: Option<f64>,
}

/// A register of the machine's tables.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Register {
    /// Origin of a work offset (`G54`, `G54.1 P1`, `EXT`) along an axis, 0 to 2.
    WorkOffset {
        /// The offset's name.
        name: String,
        /// 0 to 2.
        axis: usize,
    },
    /// Geometry of a tool offset along an axis.
    ToolGeometry {
        /// The offset's number.
        tool: u32,
        /// 0 to 2.
        axis: usize,
    },
    /// Wear of a tool offset along an axis.
    ToolWear {
        /// The offset's number.
        tool: u32,
        /// 0 to 2.
        axis: usize,
    },
    /// The radius register of a tool offset.
    ToolRadius {
        /// The offset's number.
        tool: u32,
    },
    /// Its wear.
    ToolRadiusWear {
        /// The offset's number.
        tool: u32,
    },
    /// Tip direction, 0 to 9.
    TipDirection {
        /// The offset's number.
        tool: u32,
    },
    /// A variable that the control keeps: #500 to #999, parts counters, outputs. In the program's own unit.
    Variable(u32),
}

impl Register {
    /// The register that [`Register::name`] names so.
    pub fn named(text: &str) -> Option<Register> {
        let axis_of = |letter: &str| ["X", "Y", "Z"].iter().position(|l| *l == letter);
        if let Some(number) = text.strip_prefix('#') {
            return number.parse().ok().map(Register::Variable);
        }
        if let Some((number, rest)) = text.strip_prefix("tool ").and_then(|rest| rest.split_once(' ')) {
            let tool = number.parse().ok()?;
            return Some(match rest {
                "radius" => Register::ToolRadius { tool },
                "radius wear" => Register::ToolRadiusWear { tool },
                "tip direction" => Register::TipDirection { tool },
                _ => match rest.split_once(' ')? {
                    ("geometry", letter) => Register::ToolGeometry {
                        tool,
                        axis: axis_of(letter)?,
                    },
                    ("wear", letter) => Register::ToolWear {
                        tool,
                        axis: axis_of(letter)?,
                    },
                    _ => return None,
                },
            });
        }
        let (name, letter) = text.rsplit_once(' ')?;
        Some(Register::WorkOffset {
            name: name.to_owned(),
            axis: axis_of(letter)?,
        })
    }

    /// Its name in logs: `G54 X`, `tool 5 wear X`, `#501`.
    pub fn name(&self) -> String {
        const AXES: [&str; 3] = ["X", "Y", "Z"];
        match self {
            Register::WorkOffset { name, axis } => format!("{name} {}", AXES[*axis]),
            Register::ToolGeometry { tool, axis } => format!("tool {tool} geometry {}", AXES[*axis]),
            Register::ToolWear { tool, axis } => format!("tool {tool} wear {}", AXES[*axis]),
            Register::ToolRadius { tool } => format!("tool {tool} radius"),
            Register::ToolRadiusWear { tool } => format!("tool {tool} radius wear"),
            Register::TipDirection { tool } => format!("tool {tool} tip direction"),
            Register::Variable(number) => format!("#{number}"),
        }
    }
}

/// A move of the tool tip.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Where along, from where the tip is to where it shall be.
    pub path: Path<Setup>,
    /// How fast.
    pub speed: Speed,
    /// Multiplier of the feed along the path; `None` is 1 everywhere.
    pub profile: Option<SpeedProfile>,
    /// True when the program does not say this move: a link that we put in between two of its paths.
    pub derived: bool,
}

/// How fast a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// As fast as the axes can; not cutting.
    Rapid,
    /// At a feed.
    Feed(Feed),
}

/// A feed in one of the ways programs give it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feed {
    /// Path speed of the tool tip.
    PerTime(MmPerSec),
    /// Path length for each revolution of the spindle.
    PerRevolution(Millimetres),
    /// The whole move takes this long (inverse time).
    WholeMove(Seconds),
    /// Tied to the angle of the spindle: a thread or a rigid tap.
    Thread(Thread),
}

/// A move that belongs to an angle of the spindle, so that a second one cuts in the groove of the first.
///
/// The step says what has to be so; how closely it is held is the machine's. A planner that does not see the spindle's encoder plans
/// it at advance times revolutions and says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thread {
    /// Path length for each revolution. (A program gives the lead along one axis; on a taper the path is longer.)
    pub advance: Millimetres,
    /// Angle of the spindle, from its index mark in the direction of rotation, at which the move begins; `None` follows on from the
    /// thread before without waiting for the mark.
    pub start: Option<Radians>,
}

/// A feed multiplier along a path.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeedProfile {
    /// Fraction of the path length (0 to 1, rising) and factor there; linear between.
    pub points: Vec<(f64, f64)>,
}

impl SpeedProfile {
    /// The factor at a fraction of the path length; constant before the first and after the last point.
    pub fn factor(&self, fraction: f64) -> f64 {
        let after = self.points.partition_point(|p| p.0 < fraction);
        match (after.checked_sub(1).map(|i| self.points[i]), self.points.get(after)) {
            (None, None) => 1.0,
            (None, Some(p)) => p.1,
            (Some(p), None) => p.1,
            (Some(a), Some(b)) if b.0 > a.0 => a.1 + (b.1 - a.1) * (fraction - a.0) / (b.0 - a.0),
            (Some(_), Some(b)) => b.1,
        }
    }
}

/// A move of axes in machine coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineMove {
    /// Target of each axis in the machine frame; `None` stays where it is.
    pub to: [Option<Millimetres>; 3],
}

/// A tool by its number, with what the program knows of it.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolCall {
    /// The number by which the magazine knows it.
    pub number: ToolNumber,
    /// The program's words for it; may be empty.
    pub name: String,
    /// Cutting diameter, when the program gives one.
    pub diameter: Option<Millimetres>,
}

/// The vector from tool tip to gauge point: `gauge = machine_from_setup * tip + geometry + wear`.
///
/// On a mill only Z is set (G43); on a lathe X (a radius) and Z. Geometry and wear stay apart, so that wear can be taken out of a
/// comparison of plan and run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolOffset {
    /// The offset's register; 0 is "no offset".
    pub number: u32,
    /// Measured with a new tool.
    pub geometry: Vector<Machine>,
    /// Corrections since.
    pub wear: Vector<Machine>,
    /// True when the table had no entry and zero was assumed.
    pub assumed: bool,
}

impl ToolOffset {
    /// The tip is the gauge point.
    pub const NONE: ToolOffset = ToolOffset {
        number: 0,
        geometry: Vector::ZERO,
        wear: Vector::ZERO,
        assumed: false,
    };

    /// Geometry and wear together.
    pub fn total(&self) -> Vector<Machine> {
        self.geometry + self.wear
    }
}

/// What the spindle does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SpindleState {
    /// It stands.
    #[default]
    Stopped,
    /// It stands at its own fixed angle (M19, and boring cycles that move the tool's point off the wall).
    Oriented,
    /// M3: clockwise, seen from the spindle towards the workpiece.
    Clockwise(SpindleMode),
    /// M4.
    Counterclockwise(SpindleMode),
}

/// How the speed of a turning spindle is set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpindleMode {
    /// Constant revolutions (G97).
    Revolutions(Rpm),
    /// Constant surface speed (G96): revolutions follow the X radius.
    Surface {
        /// Speed of the surface at the tip.
        speed: MmPerSec,
        /// Never faster than this.
        limit: Rpm,
    },
}

impl SpindleState {
    /// Revolutions with the tip at `radius`; surface speed at radius 0 gives the limit.
    pub fn revolutions(&self, radius: Millimetres) -> Rpm {
        match self {
            SpindleState::Stopped | SpindleState::Oriented => Rpm::ZERO,
            SpindleState::Clockwise(mode) | SpindleState::Counterclockwise(mode) => match *mode {
                SpindleMode::Revolutions(n) => n,
                SpindleMode::Surface { speed, limit } => {
                    let circumference = 2.0 * std::f64::consts::PI * radius.0.abs();
                    if circumference > 0.0 {
                        Rpm(speed.0 / circumference * 60.0).min(limit)
                    } else {
                        limit
                    }
                }
            },
        }
    }
}

/// Which coolant outlets are open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CoolantState {
    /// Flood (M8).
    pub flood: bool,
    /// Mist (M7).
    pub mist: bool,
    /// Through the spindle.
    pub through: bool,
}

/// A new frame for the points that follow.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameChange {
    /// G54, or the set-up's name.
    pub name: String,
    /// Takes points of the program into the machine.
    pub machine_from_setup: Transform<Machine, Setup>,
    /// True when nobody said it and the machine's origin was assumed.
    pub assumed: bool,
}

/// How closely a path is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathMode {
    /// Come to rest at the end of every move (G61.1, G09).
    ExactStop,
    /// Never leave the path, slow down where it bends (G61).
    ExactPath,
    /// Corners may be blended within this distance (G64 P, path maximum deviation); `None` is the machine's default.
    Tolerance(Option<Millimetres>),
}

/// Levels of a program's structure, outer first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The whole.
    Program,
    /// A sequence of executables.
    Workplan,
    /// One operation on one feature with one tool.
    Workingstep,
    /// What the workingstep does.
    Operation,
    /// One path, all rapid or all feed, or a dwell.
    Toolpath,
}

/// The beginning of a part of the program's structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Which level.
    pub level: Level,
    /// Its name as people read it; not unique.
    pub name: String,
    /// Its STEP instance, when there is one.
    pub entity: Option<u64>,
    /// How far the machine may leave it, when the program says so.
    pub maximum_deviation: Option<Millimetres>,
    /// True when the program has no such structure and we made it: a tool call of G-code begins a workingstep.
    pub derived: bool,
}

/// Why the machine waits for cycle start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopKind {
    /// M0, program stop.
    Program,
    /// M1 with the switch on.
    Optional,
}

/// A function as the program spells it. Its meaning belongs to the crate that knows the vocabulary; unknown ones are kept and shown.
#[derive(Clone, Debug, PartialEq)]
pub struct RawNcFunction {
    /// The kind as the file names it: `extended function`, `exchange pallet`, ...
    pub kind: String,
    /// The function's own name in the file.
    pub name: String,
    /// Its text line, for extended functions: `trace:1 get_time ...`.
    pub text: String,
    /// The condition that the file has as an expression beside the line, or why it cannot be read.
    pub condition: Option<Result<Expression, String>>,
    /// Other named data.
    pub properties: BTreeMap<String, String>,
}

impl RawNcFunction {
    /// The kind of a line that the control prints (DPRNT, BPRNT); its text is the line.
    pub const PRINT: &str = "print";
    /// The kind of a name that the program gives to a variable (SETVN).
    pub const VARIABLE_NAME: &str = "variable name";

    /// What the name of a property begins with that holds the present value of a variable of the program that the text names.
    pub const VARIABLE: &str = "variable ";

    /// The kind of a line of the vocabulary in a comment or an extended function; its text is the line.
    pub const EXTENDED: &str = "extended function";

    /// True for what every control does with lines of its own, printing and naming: they are no functions of the vocabulary.
    pub fn is_of_the_control(&self) -> bool {
        [Self::PRINT, Self::VARIABLE_NAME].contains(&self.kind.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_register_is_found_by_its_name_in_the_log() {
        for register in [
            Register::Variable(501),
            Register::ToolGeometry { tool: 5, axis: 2 },
            Register::ToolWear { tool: 12, axis: 0 },
            Register::ToolRadius { tool: 1 },
            Register::ToolRadiusWear { tool: 1 },
            Register::TipDirection { tool: 3 },
            Register::WorkOffset {
                name: "G54.1 P12".to_owned(),
                axis: 1,
            },
        ] {
            assert_eq!(Register::named(&register.name()), Some(register));
        }
        assert_eq!(Register::named("tool five wear X"), None);
    }
}

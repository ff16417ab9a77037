//! What a program says, ready to be spelled: numbers are rounded, frames are resolved, what does not change is left out.

use plan::{CoolantState, Expression, PathMode, RegisterChange, SpindleState, StopKind};

/// One thing to write.
#[derive(Clone, Debug, PartialEq)]
pub enum Statement<'s> {
    /// The beginning of the file.
    Begin(&'s Head),
    /// The end of the program and of the file.
    End,
    /// Text for people.
    Comment(&'s str),
    /// A part of the structure begins; its name.
    Section(&'s str),
    /// Straight on.
    Line(&'s Line),
    /// Along a circle or a helix, less than a full turn.
    Arc(&'s Arc),
    /// Straight on, tied to the angle of the spindle.
    Thread {
        /// Where to.
        line: &'s Line,
        /// Length along the path for each revolution, mm.
        advance: f64,
        /// The same along the axis that goes farthest, X of a lathe as a radius.
        lead: f64,
        /// The axis that goes farthest.
        axis: usize,
        /// Degrees from the spindle's mark; `None` follows on.
        start: Option<f64>,
    },
    /// A tapped hole along Z; the tool is above it, and there again afterwards.
    Tap {
        /// Depth, in units of words.
        bottom: i64,
        /// Where the tool comes out.
        back: i64,
        /// X and Y.
        at: [i64; 2],
        /// mm for each revolution.
        pitch: f64,
        /// A left-hand thread.
        left: bool,
        /// rev/min.
        speed: f64,
    },
    /// Axes to machine coordinates, mm, at rapid; X of a lathe as a diameter.
    Machine([Option<f64>; 3]),
    /// Out of the way along the tool axis, or out of the chuck's reach.
    Retract,
    /// A tool into the spindle, or to the cut.
    Tool {
        /// Its number; 0 empties the spindle.
        number: u32,
        /// Words for it.
        name: &'s str,
    },
    /// The tool's length, or a lathe tool's offset, from here on.
    Offset {
        /// Its number; 0 is none.
        number: u32,
        /// It counts the other way (G44).
        negative: bool,
    },
    /// The spindle.
    Spindle(SpindleState),
    /// All outlets; `before` where it is known.
    Coolant {
        /// What was open.
        before: Option<CoolantState>,
        /// What is open from here.
        now: CoolantState,
    },
    /// The n-th work offset, from 1: 1 to 6 are G54 to G59.
    Work(u32),
    /// How closely paths are followed.
    PathMode(PathMode),
    /// Stand still, s.
    Dwell(f64),
    /// Text on the screen; the machine does not wait.
    Message(&'s str),
    /// Wait for cycle start.
    Stop(StopKind),
    /// A register of the control gets a value.
    Register(&'s RegisterChange),
    /// Up to `Else` or `EndIf` when this holds.
    If(&'s Expression),
    /// Up to `EndIf` when it does not.
    Else,
    /// Ways meet.
    EndIf,
    /// Again and again up to `EndWhile`.
    While(&'s Expression),
    /// The end of a loop.
    EndWhile,
    /// A variable of the program gets a value.
    Assign {
        /// Its name.
        variable: &'s str,
        /// The value.
        value: &'s Expression,
    },
}

/// How fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// As fast as the axes can.
    Rapid,
    /// mm/min.
    PerMinute(f64),
    /// mm for each revolution.
    PerRevolution(f64),
}

/// A straight move. Coordinates are in units of the last decimal of lengths; X of a lathe is a diameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The axes that are written.
    pub words: [Option<i64>; 3],
    /// How fast.
    pub pace: Pace,
}

/// A piece of a circle or helix, at most 300 degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// The axis that is square to the circle's plane.
    pub normal: usize,
    /// Seen from the tip of that axis.
    pub counterclockwise: bool,
    /// Where to, all axes.
    pub to: [i64; 3],
    /// The axis square to the plane moves too.
    pub rises: bool,
    /// Where from.
    pub from: [i64; 3],
    /// From the start to the centre, mm; radii on a lathe.
    pub to_centre: [f64; 3],
    /// Degrees, not negative.
    pub sweep: f64,
    /// How fast.
    pub pace: Pace,
}

/// What stands at the beginning of a program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Head {
    /// The program's name for people.
    pub name: String,
    /// The number of the program, where programs have numbers.
    pub number: u32,
    /// The file it was made from.
    pub source: String,
    /// Lines of the head behind the name: tools, work offsets, functions and their grades, what to verify.
    pub text: Vec<String>,
    /// The program needs a file for what it logs.
    pub logs: bool,
}

//! What the machine is told: set-points, one a cycle, and the switching in between.

use crate::watch::WatchOrder;
use units::{Rpm, StepId, ToolNumber, WorkingstepId};

/// Where the axes shall be at one servo cycle.
///
/// Carries speed and acceleration for the feed-forward of the servo loop, the step for the record, and the path length, so that hold
/// and stop can slow time along the path instead of leaving it.
///
/// One whose velocity is zero is a rest: it is done, and what stands behind it begins, when the axes are in position
/// ([`crate::MachineParameters::in_position`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPoint {
    /// Gauge-point position of each axis, machine frame, mm.
    pub position: [f64; 3],
    /// Speed of each axis, mm/s.
    pub velocity: [f64; 3],
    /// Acceleration of each axis, mm/s^2.
    pub acceleration: [f64; 3],
    /// The step this belongs to.
    pub step: StepId,
    /// Path length since the start of the program, mm; never falls.
    pub path_length: f64,
    /// Speed along the path, mm/s.
    pub path_speed: f64,
    /// It belongs to a rapid: the rapid override is for it, not the feed override.
    pub rapid: bool,
    /// The override it was planned for, 1 is 100 %: the machine runs slower than the plan where the override is below this. 0 where none
    /// acts on it: a thread is tied to the spindle and runs as planned, with the spindle at 100 %.
    pub planned_override: f64,
    /// It belongs to an angle of the spindle: a thread. The machine then goes by the spindle's encoder, not by time.
    pub tie: Option<Tie>,
}

/// How a set-point is tied to the angle of the spindle.
///
/// Planned time counts as angle: a cycle of the plan is the angle that the spindle turns in it at [`Tie::revolutions`]. Where the plan has
/// reached its lead, path length less lead times angle is the same on every pass ([`Tie::start`]), whatever the spindle does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tie {
    /// Path length for each revolution, mm.
    pub lead: f64,
    /// Spindle speed that the plan was made for, rev/s, without sign.
    pub revolutions: f64,
    /// Angle from the index mark in the direction of rotation, turns, at which the path's first point is passed; `None` goes on from the
    /// thread before.
    pub start: Option<f64>,
}

impl Tie {
    /// True when its numbers make a thread.
    pub(crate) fn can_be(&self) -> bool {
        let usable = |number: f64| number > 0.0 && number.is_finite();
        usable(self.lead) && usable(self.revolutions) && self.start.is_none_or(f64::is_finite)
    }

    /// Speed along the path that keeps the lead at the planned spindle speed, mm/s.
    pub fn speed(&self) -> f64 {
        self.lead * self.revolutions
    }
}

impl Default for SetPoint {
    /// At rest in the machine's zero, planned for 100 %.
    fn default() -> Self {
        SetPoint {
            position: [0.0; 3],
            velocity: [0.0; 3],
            acceleration: [0.0; 3],
            step: StepId::NONE,
            path_length: 0.0,
            path_speed: 0.0,
            rapid: false,
            planned_override: 1.0,
            tie: None,
        }
    }
}

impl SetPoint {
    /// True where no override acts: a thread. A feed hold waits for its end.
    pub fn is_locked(&self) -> bool {
        self.planned_override <= 0.0
    }
}

/// One entry of the stream from planner to machine, in order of execution. Switching is done at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Be here at the next cycle.
    SetPoint(SetPoint),
    /// Turn the spindle and wait until it is at speed.
    Spindle {
        /// How.
        spindle: SpindleCommand,
        /// The step that says so.
        step: StepId,
    },
    /// Follow this spindle speed without waiting: constant surface speed along a path.
    SpindleSpeed(Rpm),
    /// Open and close coolant outlets; not waited for.
    Coolant {
        /// Which are open.
        outlets: CoolantOutlets,
        /// The step that says so.
        step: StepId,
    },
    /// The tool that comes in next is this long, and from its change on set-points are places of its tip: the machine adds the length to Z,
    /// against the home position, as the published text protocol has it. Without this set-points are places of the gauge point.
    ToolLength {
        /// Its length, mm.
        length: f64,
        /// The step that says so.
        step: StepId,
    },
    /// Change the tool; takes the machine's tool-change time, and the way to where tools are changed.
    Tool {
        /// Which comes in.
        tool: ToolNumber,
        /// The step that says so.
        step: StepId,
    },
    /// Stand still for a number of cycles.
    Dwell {
        /// How many.
        cycles: u32,
        /// The step that says so.
        step: StepId,
    },
    /// From here on samples belong to this workingstep.
    Workingstep {
        /// Which; 0 is none.
        workingstep: WorkingstepId,
        /// The step that says so.
        step: StepId,
    },
    /// Something for the watches: takes no time, needs no rest, and happens with the set-point before it.
    Watch {
        /// What.
        order: WatchOrder,
        /// The step that says so.
        step: StepId,
    },
    /// Stop and wait for cycle start.
    Pause {
        /// The step that says so.
        step: StepId,
    },
    /// The program is over: spindle and coolant off.
    End {
        /// The last step.
        step: StepId,
    },
}

/// What the spindle is told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SpindleCommand {
    /// Stand.
    #[default]
    Stop,
    /// Turn clockwise (M3).
    Clockwise(Rpm),
    /// Turn counterclockwise (M4).
    Counterclockwise(Rpm),
}

/// Which coolant outlets are open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CoolantOutlets {
    /// Flood.
    pub flood: bool,
    /// Mist.
    pub mist: bool,
    /// Through the spindle.
    pub through: bool,
}

//! Program steps to machine set-points, one a millisecond.
//!
//! [`Trajectory`] asks a [`plan::ProgramStream`] for steps and gives [`Output`]s: commands for the realtime half, and every step that
//! is not a motion in its place among them. Three stages, each a module:
//!
//! 1. [`smooth`]: programmed paths become one curve with a continuous tangent. Corners are blended within the tolerance in force; arcs,
//!    helices and splines stay what they are; dense chords become a chain of parabolas, whose curvature is that of the curve they stand
//!    for.
//! 2. [`profile`]: the fastest speed along that curve under each axis's speed and acceleration and the programmed feed, in a receding
//!    window that always ends at rest.
//! 3. [`sample`]: that motion, looked at every millisecond.
//!
//! Acceleration holds at every instant, not only at the samples; the second difference of samples is a weighted mean of the
//! acceleration over two cycles, so it holds there too.
//!
//! A move that is tied to the spindle's angle ([`plan::Feed::Thread`]) is planned at advance times programmed revolutions, from rest to
//! rest; its set-points say so ([`machine::Tie`]), and the realtime half, which sees the spindle's encoder, goes by them as it turns.
//!
//! With a limit of jerk ([`Limits::j_max`]) another planner takes the place of the three stages, behind the same [`Trajectory`]: the path
//! becomes a curve with a continuous curvature, and the window is solved for the fastest motion under speed, acceleration and jerk of each
//! axis. The jerk is looked at between samples too, and so holds at their third differences; what rare programs are over it stands in
//! [`Statistics::worst_jerk_ratio`]. Why it is made so: `docs/decisions/0010-jerk.md`; what it reaches: `cargo bench -p motion`.

mod blend;
mod jerk;
mod pieces;
mod planner;
pub mod profile;
mod remaining;
pub mod sample;
pub mod smooth;
mod trajectory;

pub use remaining::RemainingTime;
pub use trajectory::{Output, Trajectory};

use units::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Seconds};

/// What the axes can do, X Y Z, and how closely paths are followed by default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed of each axis.
    pub v_max: [MmPerSec; 3],
    /// Largest acceleration of each axis.
    pub a_max: [MmPerSec2; 3],
    /// Largest jerk of each axis; `None` is unlimited.
    pub j_max: Option<[MmPerSec3; 3]>,
    /// How far a blend may leave the programmed path where the program does not say.
    pub tolerance: Millimetres,
}

impl Limits {
    /// All axes alike.
    pub fn uniform(v_max: MmPerSec, a_max: MmPerSec2, tolerance: Millimetres) -> Limits {
        Limits {
            v_max: [v_max; 3],
            a_max: [a_max; 3],
            j_max: None,
            tolerance,
        }
    }
}

/// What has been planned and given out so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Moves of the program.
    pub blocks: u64,
    /// Set-points given.
    pub samples: u64,
    /// Time of all commands whose duration the plan decides: motion and dwells.
    pub time: Seconds,
    /// Length of the smoothed path.
    pub path_length: Millimetres,
    /// Largest distance between the smoothed path and the programmed one.
    pub max_deviation: Millimetres,
    /// Largest speed of a sample against the axis's limit: 1 is at the limit. Backward difference of positions.
    pub worst_speed_ratio: f64,
    /// Largest acceleration of a sample against the axis's limit. Second backward difference of positions, at rest before and after.
    pub worst_acceleration_ratio: f64,
    /// Largest jerk of a sample against the axis's limit, where there is one. Third backward difference, at rest before and after.
    pub worst_jerk_ratio: Option<f64>,
}

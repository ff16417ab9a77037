//! The ground everything stands on: quantities with their unit, the three clocks, the identifiers that cross every border, and
//! points that know their frame.
//!
//! A bare `f64` named `feed` has been mm/min, in/min and mm/s in the same machine; here the type says which. Text in other units is
//! converted once, where it is read. No allocation, no `std`: the realtime half uses this crate too.
//!
//! Read on: [`quantity`] for numbers, [`clock`] for time, [`frame`] for points and transforms, [`id`] for step and tool numbers.

#![no_std]

pub mod clock;
pub mod frame;
pub mod id;
pub mod quantity;

pub use clock::{Tick, Timestamp};
pub use frame::{Frame, Machine, Part, Point, Setup, Transform, Vector};
pub use id::{Axis, StepId, ToolNumber, WorkingstepId};
pub use quantity::{Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Radians, Rpm, Seconds};

/// Millimetres in one inch, exact by definition (ISO 31-1).
pub const MM_PER_INCH: f64 = 25.4;

/// Length of one servo cycle. Every tick of the machine, every set-point and every recorded row is one of these apart.
pub const TICK: Seconds = Seconds(0.001);

//! What the machine has ready when a program starts: tools, their offsets, work offsets, and where the axes stand.
//!
//! Readers are given a copy and never write it back: a program's own `G10` changes the copy inside the reader and is told to the
//! machine by a step.

use std::collections::BTreeMap;
use units::{Machine, Millimetres, Point, Setup, ToolNumber, Transform, Vector};

/// What to do when a program needs something that the tables do not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// Assume zero, mark the step `assumed` and give a warning: the simulated machine.
    Assume,
    /// Alarm: every real machine.
    Fail,
}

/// The tables.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// Gauge point at the start.
    pub position: Point<Machine>,
    /// Tools and their offsets, by the number that T, H and D words use.
    pub tools: BTreeMap<ToolNumber, ToolEntry>,
    /// Work offsets by name: `G54` to `G59`, `G54.1 P1`, or the name of a STEP-NC set-up.
    pub work_offsets: BTreeMap<String, Transform<Machine, Setup>>,
    /// What to do about gaps.
    pub missing: Missing,
}

/// One tool of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolEntry {
    /// Words for people.
    pub name: String,
    /// From tip to gauge point, measured with a new tool; on a mill only Z, on a lathe X as a radius and Z.
    pub geometry: Offset,
    /// Corrections since.
    pub wear: Offset,
    /// Cutting diameter.
    pub diameter: Option<Millimetres>,
    /// The radius register, geometry: with `radius_wear`, by how much G41 and G42 move the centre off the programmed path. On a mill it
    /// is D, the operator's own entry, which says nothing about the tool: 0 when the program is written for the centre. On a lathe it
    /// is R, the nose radius.
    pub radius: Millimetres,
    /// The radius register, wear.
    pub radius_wear: Millimetres,
    /// Where the imaginary tip of a turning tool lies, seen from the centre of its nose: 1 to 8 as the controls number it, 0 and 9 in
    /// the centre.
    pub tip_direction: u8,
}

/// An offset vector in the machine frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset(pub Vector<Machine>);

impl Default for Offset {
    fn default() -> Self {
        Offset(Vector::ZERO)
    }
}

impl Tables {
    /// Nothing known: everything a program needs is assumed and said so.
    pub fn empty() -> Self {
        Tables {
            position: Point::ORIGIN,
            tools: BTreeMap::new(),
            work_offsets: BTreeMap::new(),
            missing: Missing::Assume,
        }
    }
}

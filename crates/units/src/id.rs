//! Identifiers that cross every border of the house: from the program through the set-point into the record and the report.

use core::fmt;

/// The n-th step that a program's stream gave, counted from 1; 0 is "no step": the machine moves by hand or stands.
///
/// The same program, answered the same way, gives the same numbers: a run can be restarted at one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StepId(pub u32);

impl StepId {
    /// No step of a program.
    pub const NONE: StepId = StepId(0);
}
impl fmt::Display for StepId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "step {}", self.0)
    }
}

/// The n-th workingstep that was begun in a run, counted from 1; 0 is "outside any workingstep".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WorkingstepId(pub u32);

/// The number by which a program calls a tool; 0 is an empty spindle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ToolNumber(pub u32);

impl fmt::Display for ToolNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "T{}", self.0)
    }
}

/// A linear axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    /// Lathe: across the spindle, a radius.
    X,
    /// Across X and Z.
    Y,
    /// Along the spindle.
    Z,
}

impl Axis {
    /// All of them, in the order in which coordinates stand.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];
    /// Its place among coordinates.
    pub const fn index(self) -> usize {
        self as usize
    }
    /// The small letter of registers and keys.
    pub const fn letter(self) -> char {
        match self {
            Axis::X => 'x',
            Axis::Y => 'y',
            Axis::Z => 'z',
        }
    }
}
impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["X", "Y", "Z"][self.index()])
    }
}

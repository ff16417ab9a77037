//! Families of controls as data: which codes they know and how they read numbers.
//!
//! A family is one [`Profile`] and one line in [`PROFILES`]. Nothing else in the crate asks for a family by its name: behaviour that
//! differs is a field here.

mod lathe;
mod mill;
mod rs274;

pub use lathe::FANUC_LATHE;
pub use mill::FANUC_MILL;
pub use rs274::RS274;

use crate::cycles::roughing::ContourCycle;
use crate::cycles::turning::SingleKind;
use crate::macro_b::{Digits, MacroRules};
use plan::PathMode;

/// How a family of controls reads a program.
#[derive(Debug)]
pub struct Profile {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is, for people.
    pub about: &'static str,
    /// X words are diameters, U and W are incremental, T words carry station and offset: G-code system A.
    pub turning: bool,
    /// Its preparatory codes: number times ten, meaning.
    pub g: &'static [(u16, G)],
    /// Its miscellaneous codes: number, meaning.
    pub m: &'static [(u16, M)],
    /// The laws of its variables and expressions.
    pub macros: MacroRules,
    /// Largest size of an offset entry, millimetres and inches; alarm 032 beyond.
    pub largest_offset: [f64; 2],
    /// Parameters 5013 and 5014, the limits of wear entries, count least increments; else they are lengths (30i).
    pub limits_in_increments: bool,
    /// Least input increment, millimetres and inches. Words whose value comes from a variable are rounded to it.
    pub increment: [f64; 2],
    /// False when words are taken as computed (LinuxCNC).
    pub rounds_words: bool,
    /// K says how far a thread goes along its path in a revolution; else F says it for the axis that goes farther.
    pub lead_in_k: bool,
    /// Seconds that a whole number behind the P of a dwell stands for.
    pub dwell_unit: f64,
    /// True when P of a dwell is a number of `dwell_unit` even with a point; else a point makes it seconds.
    pub dwell_point_too: bool,
    /// M6 waits for the moves of its own block (Fanuc); else it comes first (RS274).
    pub tool_change_after_motion: bool,
    /// `(MSG,text)` is shown to the operator.
    pub message_comments: bool,
    /// G43 without H takes the number of the tool in the spindle (RS274); else the H in force.
    pub length_of_the_tool: bool,
    /// G53 goes at the modal speed (RS274); else always rapid.
    pub machine_moves_at_feed: bool,
    /// Clearance above the last peck (G83) and retract of a chip break (G73), mm.
    pub peck_clearance: f64,
    /// First plane at the start.
    pub plane: Plane,
    /// Its axis words.
    pub axes: &'static [AxisWord],
    /// Axes in the order of the control's system variables.
    pub variable_axes: &'static [usize],
    /// Letters of its words.
    pub letters: &'static [u8],
    /// A length without a point may mean least increments on this family (Fanuc parameter 3401.0), so it deserves a warning.
    pub point_matters: bool,
    /// G10 L2 P0 is the external offset that is added to all others; else the one in force.
    pub external_offset: bool,
    /// G10 L2 adds to the offset with G91; else it always sets it.
    pub offsets_add: bool,
    /// A tip below R goes up to R before it goes to the hole's place; else after.
    pub raises_before_hole: bool,
    /// P behind G64 is a tolerance.
    pub tolerance_word: bool,
    /// P behind G2 and G3 is a number of turns.
    pub arc_turns: bool,
    /// Tool offset registers as system variables.
    pub offset_variables: &'static [OffsetVariables],
    /// The same with parameter 6000.3 V15=1, the layout of a series 15; empty where there is no such setting.
    pub series_15_variables: &'static [OffsetVariables],
}

/// A word that names a place along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisWord {
    /// Its letter.
    pub letter: u8,
    /// 0 to 2.
    pub axis: usize,
    /// Millimetres along the axis for each millimetre written: one half for diameters.
    pub factor: f64,
    /// `Some(true)` is incremental, `Some(false)` absolute, `None` as G90 and G91 say.
    pub incremental: Option<bool>,
}

/// Where a kind of tool offset register lies among the system variables.
#[derive(Debug)]
pub struct OffsetVariables {
    /// Variable of offset 1.
    pub first: u32,
    /// How many.
    pub count: u32,
    /// Which register.
    pub register: Register,
}

impl OffsetVariables {
    const fn new(first: u32, count: u32, register: Register) -> Self {
        OffsetVariables { first, count, register }
    }
}

/// A number of a tool's table entry, as system variables show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// Geometry of an axis, 0 to 2.
    Geometry(usize),
    /// Wear of an axis.
    Wear(usize),
    /// Radius: D of a mill, the nose radius R of a lathe.
    Radius,
    /// Correction of the radius.
    RadiusWear,
    /// Where the imaginary tip lies, 0 to 9.
    TipDirection,
}

/// The plane of arcs, compensation and drilling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// G17.
    Xy,
    /// G18.
    Zx,
    /// G19.
    Yz,
}

impl Profile {
    /// Millimetres along an axis for each millimetre that words and registers say.
    pub(crate) fn factor(&self, axis: usize) -> f64 {
        self.axes.iter().find(|w| w.axis == axis).map_or(1.0, |w| w.factor)
    }
}

impl Plane {
    /// First and second axis of the plane and the axis square to it; right-handed.
    pub(crate) fn axes(self) -> [usize; 3] {
        match self {
            Plane::Xy => [0, 1, 2],
            Plane::Zx => [2, 0, 1],
            Plane::Yz => [1, 2, 0],
        }
    }
}

/// How tool-tip moves go: group 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// G0.
    Rapid,
    /// G1.
    Straight,
    /// G2.
    Clockwise,
    /// G3.
    Counterclockwise,
    /// G32, on mills G33: tied to the spindle.
    Thread,
    /// G33.1: tied to the spindle, in and out again.
    RigidTap,
}

/// What F means: group 5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedMode {
    /// Length a minute.
    PerMinute,
    /// Length a revolution.
    PerRevolution,
    /// One over the minutes of the whole move.
    InverseTime,
}

/// A drilling cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drilling {
    /// G73: pecks that only break the chip.
    ChipBreak,
    /// G74: tap with a left-hand thread.
    LeftTap,
    /// G81.
    Plain,
    /// G82: with a dwell at the bottom.
    Dwell,
    /// G83: pecks that come out of the hole.
    Peck,
    /// G84: tap.
    Tap,
    /// G85: ream, out at feed.
    Ream,
    /// G86: bore, out at rapid with the spindle stopped.
    Bore,
    /// G89: ream with a dwell at the bottom.
    ReamDwell,
    /// G76: bore, and off the wall with the spindle oriented.
    FineBore,
    /// G87: bore upwards from below.
    BackBore,
    /// G88: bore, and out by hand.
    ManualBore,
}

/// Where the side of the tool stays: group 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// G40: the tool's centre is on the path.
    On,
    /// G41.
    Left,
    /// G42.
    Right,
}

/// Codes that act in their own block only: group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Once {
    /// G4.
    Dwell,
    /// G9: stop at the end of this move.
    ExactStop,
    /// G10.
    SetOffset,
    /// G28.
    Home,
    /// G30.
    SecondReference,
    /// G52.
    LocalShift,
    /// G53.
    MachineCoordinates,
    /// G92, on turning machines G50: this place is called so from now on; with S the highest spindle speed.
    SetPosition,
    /// G92.1: takes `SetPosition` back.
    ClearPosition,
    /// G31.
    Skip,
    /// G70 to G73 of a lathe.
    Contour(ContourCycle),
    /// G74 of a lathe, pecks along Z (2), and G75, along X (0).
    PeckColumns(usize),
    /// G76 of a lathe.
    ThreadCycle,
    /// G68.
    Rotate,
    /// G51.
    Scale,
    /// G50 of a mill.
    ScaleOff,
    /// G51.1.
    Mirror,
    /// G50.1.
    MirrorOff,
}

/// What a G code means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum G {
    /// Group 1.
    Motion(Motion),
    /// Group 2.
    Plane(Plane),
    /// Group 3: incremental or not.
    Incremental(bool),
    /// Group 4 of RS274: centres of arcs are absolute or not.
    AbsoluteCentres(bool),
    /// Group 5.
    Feed(FeedMode),
    /// Group 6: inches or not.
    Inches(bool),
    /// Group 7.
    Side(Side),
    /// Group 8: sign of the length offset; 0 cancels it.
    Length(i8),
    /// Group 9.
    Drill(Drilling),
    /// Group 10 of a lathe: along X instead of Z.
    SideDrill(Drilling),
    /// Group 1 of a lathe: G90, G92, G94.
    Single(SingleKind),
    /// Group 9: none.
    DrillEnd,
    /// Group 10: back to the R level or not.
    ReturnToR(bool),
    /// Group 12 or 14: G54 to G59 as 1 to 6.
    Work(u8),
    /// Group 14: G54.1 P.
    MoreWork,
    /// Group 13 or 15; a P word makes it a tolerance.
    Path(PathMode),
    /// G96 or not: group 2 of a lathe.
    SurfaceSpeed(bool),
    /// Group 17 of a mill: places by radius and angle or not.
    Polar(bool),
    /// G69.
    RotationOff,
    /// Group 0, and codes that take all axis words of their block.
    Once(Once),
    /// Known, and without effect on what is modelled here: the reason.
    Harmless(&'static str),
    /// Known, and an alarm until it is there.
    NotYet(&'static str),
}

impl G {
    /// The modal group; two codes of one group in a block contradict each other. `None` may stand beside anything.
    pub(crate) fn group(self) -> Option<u8> {
        Some(match self {
            G::Once(Once::ExactStop) | G::Harmless(_) | G::NotYet(_) => return None,
            // A cancel may stand beside anything.
            G::Once(Once::ScaleOff | Once::MirrorOff) => 11,
            G::Once(_) => 0,
            G::Motion(_) | G::Single(_) => 1,
            G::Plane(_) => 2,
            G::Incremental(_) => 3,
            G::AbsoluteCentres(_) => 4,
            G::Feed(_) => 5,
            G::Inches(_) => 6,
            G::Side(_) => 7,
            G::Length(_) => 8,
            G::Drill(_) | G::SideDrill(_) | G::DrillEnd => 9,
            G::ReturnToR(_) => 10,
            G::Work(_) | G::MoreWork => 14,
            G::Path(_) => 15,
            G::RotationOff => 16,
            G::Polar(_) => 18,
            G::SurfaceSpeed(_) => 17,
        })
    }
}

/// What an M code means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum M {
    /// M0.
    Stop,
    /// M1.
    OptionalStop,
    /// M2, M30.
    End,
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
    /// M5.
    SpindleStop,
    /// M19: the spindle stops at its fixed angle.
    Orient,
    /// M6.
    ToolChange,
    /// M7.
    Mist,
    /// M8.
    Flood,
    /// M88 and the like.
    ThroughCoolant,
    /// M9.
    CoolantOff,
    /// M29: the tapping cycle of this block or the next turns the spindle itself.
    RigidTapping,
    /// M98: run a subprogram.
    Call,
    /// M99: back to the caller.
    Return,
    /// M97 of Haas: run the blocks of this program from a sequence number on, until M99.
    LocalCall,
    /// Known, and without effect on what is modelled here: the reason.
    Harmless(&'static str),
}

/// All families. A new one is one more line.
pub const PROFILES: &[&Profile] = &[
    &FANUC_MILL,
    &FANUC_LATHE,
    &RS274,
    &FANUC_30I_MILL,
    &FANUC_30I_LATHE,
    &FANUC_8_DIGITS,
    &HAAS_MILL,
];

/// The family of that name.
pub fn by_name(name: &str) -> Option<&'static Profile> {
    PROFILES.iter().copied().find(|p| p.name == name)
}

const FANUC_MACROS: MacroRules = MacroRules {
    unset_is_zero: false,
    deepest_bracket: 5,
    angles_from_zero: true,
    floored: false,
    fanuc_ranges: true,
    compares: true,
    digits: Digits::Double,
    bad_arc_alarm: 111,
    deepest_macro: 4,
    deepest_subprogram: 4,
    longest_name: 8,
    printed_field_grows: false,
    named_programs: false,
    local_subprograms: false,
};

/// 30i, 31i, 32i and 0i-F.
const FANUC_30I_MACROS: MacroRules = MacroRules {
    bad_arc_alarm: 119,
    deepest_macro: 5,
    deepest_subprogram: 10,
    longest_name: 31,
    named_programs: true,
    ..FANUC_MACROS
};

const HAAS_MACROS: MacroRules = MacroRules {
    printed_field_grows: true,
    local_subprograms: true,
    deepest_macro: 9,
    deepest_subprogram: 9,
    ..FANUC_MACROS
};

/// Fanuc 30i family on a milling machine.
pub const FANUC_30I_MILL: Profile = Profile {
    name: "fanuc-30i-mill",
    about: "Fanuc 30i/31i/32i/0i-F on a milling machine, Custom Macro B",
    macros: FANUC_30I_MACROS,
    largest_offset: [9999.999, 999.9999],
    limits_in_increments: false,
    ..FANUC_MILL
};

/// Fanuc 30i family on a lathe.
pub const FANUC_30I_LATHE: Profile = Profile {
    name: "fanuc-30i-lathe",
    about: "Fanuc 30i/31i/32i/0i-F on a lathe, G-code system A, Custom Macro B",
    macros: FANUC_30I_MACROS,
    largest_offset: [9999.999, 999.9999],
    limits_in_increments: false,
    ..FANUC_LATHE
};

/// Fanuc 16i and older with their own arithmetic.
pub const FANUC_8_DIGITS: Profile = Profile {
    name: "fanuc-mill-8-digits",
    about: "Fanuc 16i and older on a milling machine, with the rounding of their arithmetic of 8 digits",
    macros: MacroRules {
        digits: Digits::Eight,
        ..FANUC_MACROS
    },
    ..FANUC_MILL
};

/// Haas on a milling machine.
pub const HAAS_MILL: Profile = Profile {
    name: "haas-mill",
    about: "Haas on a milling machine: offset variables as on a series 15, printed fields that grow",
    macros: HAAS_MACROS,
    largest_offset: [9999.999, 999.9999],
    offset_variables: mill::MILL_OFFSETS_15,
    ..FANUC_MILL
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_family_lists_each_code_once_in_rising_order() {
        for p in PROFILES {
            assert!(p.g.windows(2).all(|w| w[0].0 < w[1].0), "{} G", p.name);
            assert!(p.m.windows(2).all(|w| w[0].0 < w[1].0), "{} M", p.name);
            assert_eq!(by_name(p.name).map(|q| q.name), Some(p.name));
        }
    }
}

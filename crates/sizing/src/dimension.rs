//! What a job declares about a size that is measured.

use crate::Unit;
use std::fmt;
use thiserror::Error;
use units::{Axis, Millimetres, ToolNumber};

/// A size of the part, and the register that moves it. Lengths are sizes as measured: a diameter is a diameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// What the operator calls it: `DIM A`.
    pub name: String,
    /// What kind of size it is.
    pub kind: Kind,
    /// The unit in which it is measured and shown.
    pub unit: Unit,
    /// The size on the drawing.
    pub nominal: Millimetres,
    /// Smallest good size.
    pub low: Millimetres,
    /// Largest good size.
    pub high: Millimetres,
    /// The size to aim at; need not be the middle: tools wear to one side.
    pub target: Millimetres,
    /// The tool that makes it.
    pub tool: ToolNumber,
    /// The number of the offset whose register moves it; need not be the tool's number.
    pub offset: u32,
    /// Which register of that offset.
    pub column: Column,
    /// The whole path of the register: `sim-lathe/tool/5/wear/x_mm`.
    pub register: String,
    /// What the register does to the size.
    pub response: Response,
    /// Entries at or outside these are a slip of the finger or of the gauge. Not the tolerance.
    pub window: (Millimetres, Millimetres),
    /// The largest change of the register that anybody may enter; beyond it takes a level 3.
    pub largest_step: Millimetres,
    /// The finest step of the register: the control's least increment.
    pub increment: Millimetres,
    /// Whether it moves the register or is only watched.
    pub role: Role,
    /// True when wear of the tool makes the size larger: it decides where in the band to aim.
    pub grows_with_wear: bool,
    /// Every how many parts it is to be measured.
    pub every: u32,
}

/// Kinds of sizes. The kind decides what a register does to the size and which way it wears, unless the job says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A shaft, or a boss by a cutter.
    OutsideDiameter,
    /// A bore.
    InsideDiameter,
    /// From a face that the tool cuts to something that it does not: material is left beyond it as the tool wears.
    Length,
    /// From the surface down to what the tool cuts.
    Depth,
    /// Across two walls, material between them.
    OutsideWidth,
    /// Across two walls, air between them: a groove, a pocket.
    InsideWidth,
}

impl Kind {
    /// All of them, with their words in job files.
    pub const ALL: [(&'static str, Kind); 6] = [
        ("outside diameter", Kind::OutsideDiameter),
        ("inside diameter", Kind::InsideDiameter),
        ("length", Kind::Length),
        ("depth", Kind::Depth),
        ("outside width", Kind::OutsideWidth),
        ("inside width", Kind::InsideWidth),
    ];
    /// Its word in job files.
    pub fn words(self) -> &'static str {
        Kind::ALL[self as usize].0
    }
    /// What a person calls such a size.
    pub fn noun(self) -> &'static str {
        match self {
            Kind::OutsideDiameter => "diameter",
            Kind::InsideDiameter => "bore",
            Kind::Length => "length",
            Kind::Depth => "depth",
            Kind::OutsideWidth | Kind::InsideWidth => "width",
        }
    }
    /// A worn tool leaves material standing: outside sizes and lengths grow, bores, depths and grooves shrink.
    pub fn grows_with_wear(self) -> bool {
        matches!(self, Kind::OutsideDiameter | Kind::Length | Kind::OutsideWidth)
    }
    /// What a register does to such a size, where the kind alone decides it.
    pub fn response(self, column: Column, counts_diameters: bool) -> Option<Response> {
        let is_diameter = matches!(self, Kind::OutsideDiameter | Kind::InsideDiameter);
        Some(match (self, column) {
            // The register moves the tip and not the wall, so a bore answers as a shaft does.
            (_, Column::Wear(Axis::X)) if is_diameter && counts_diameters => Response::Same,
            (_, Column::Wear(Axis::X)) if is_diameter => Response::Twice,
            (Kind::Length, Column::Wear(_)) => Response::Same,
            (Kind::Depth, Column::Wear(_)) => Response::Opposite,
            (Kind::OutsideDiameter | Kind::OutsideWidth, Column::CutterRadius) => Response::Twice,
            (Kind::InsideDiameter | Kind::InsideWidth, Column::CutterRadius) => Response::OppositeTwice,
            _ => return None,
        })
    }
}

/// Which register of an offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Column {
    /// Wear along an axis.
    Wear(Axis),
    /// Wear of the cutter's radius.
    CutterRadius,
}

impl Column {
    /// The path of the register: `sim-lathe/tool/5/wear/x_mm`.
    pub fn path(self, machine: &str, offset: u32) -> String {
        match self {
            Column::Wear(axis) => format!("{machine}/tool/{offset}/wear/{}_mm", axis.letter()),
            Column::CutterRadius => format!("{machine}/tool/{offset}/radius_wear_mm"),
        }
    }
}
impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Column::Wear(axis) => write!(f, "wear {}", axis.letter().to_ascii_uppercase()),
            Column::CutterRadius => f.write_str("wear of the radius"),
        }
    }
}

/// What one millimetre more in the register does to the size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Response {
    /// The size grows by one: a register in diameters and a diameter, outside or inside; a length.
    Same,
    /// The size grows by two: a register in radii and a diameter; cutter radius and the width of a boss.
    Twice,
    /// The size shrinks by one: a reversed axis, boring from the far side, a depth.
    Opposite,
    /// The size shrinks by two: cutter radius and the width of a pocket.
    OppositeTwice,
    /// Any other: a size across a taper. Not 0.
    Times(f64),
}

impl Response {
    /// Millimetres of size for a millimetre of register.
    pub fn size_per_register(self) -> f64 {
        match self {
            Response::Same => 1.0,
            Response::Twice => 2.0,
            Response::Opposite => -1.0,
            Response::OppositeTwice => -2.0,
            Response::Times(factor) => factor,
        }
    }
}

/// What a dimension is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Its entries move the register.
    Controls,
    /// Its entries are judged and kept, and change nothing.
    Watch,
    /// Several sizes made by one register: when all of them were entered, it moves by the mean of what they ask for.
    Mean,
}

impl Role {
    /// All of them, with their words in job files.
    pub const ALL: [(&'static str, Role); 3] = [("controls", Role::Controls), ("watch", Role::Watch), ("mean", Role::Mean)];
    /// Its word in job files.
    pub fn words(self) -> &'static str {
        Role::ALL[self as usize].0
    }
}

/// Why a dimension cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("dimension {name:?}: {what}")]
pub struct DimensionError {
    /// Which.
    pub name: String,
    /// What is wrong and what is needed.
    pub what: String,
}

impl Dimension {
    /// Checks that it makes sense; [`crate::enter`] does so each time.
    ///
    /// # Errors
    /// A number is missing or not finite, limits or window are upside down, the target is not in both, a step is not above 0.
    pub fn check(&self) -> Result<(), DimensionError> {
        let shown = |length| self.unit.words(length);
        let (from, to) = self.window;
        let lengths = [
            self.nominal,
            self.low,
            self.high,
            self.target,
            from,
            to,
            self.largest_step,
            self.increment,
        ];
        let what = if self.name.trim().is_empty() {
            "it needs a name".to_owned()
        } else if self.register.trim().is_empty() {
            "it needs the register that it moves".to_owned()
        } else if !self.response.size_per_register().is_finite() || self.response.size_per_register() == 0.0 {
            "its factor, the change of the size for a change of the register, must be a number and not 0".to_owned()
        } else if !lengths.iter().all(|l| l.is_finite()) {
            "every size must be a finite number".to_owned()
        } else if self.low >= self.high {
            format!(
                "its low limit {} must be below its high limit {}",
                shown(self.low),
                shown(self.high)
            )
        } else if self.target < self.low || self.target > self.high {
            format!(
                "its target {} must lie in its limits {} .. {}",
                shown(self.target),
                shown(self.low),
                shown(self.high)
            )
        } else if self.target <= from || self.target >= to {
            format!(
                "its target {} must lie inside its entry window {} .. {}",
                shown(self.target),
                shown(from),
                shown(to)
            )
        } else if self.largest_step.0 <= 0.0 {
            "its largest single step must be above 0".to_owned()
        } else if self.increment.0 <= 0.0 {
            "the finest step of its register must be above 0".to_owned()
        } else {
            return Ok(());
        };
        Err(DimensionError {
            name: self.name.clone(),
            what,
        })
    }
}

/// Dimensions would move one register, and each would correct what the other has corrected.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Conflict {
    /// Two move it.
    #[error(
        "dimensions {first:?} and {second:?} both move {register}: let one control it and mark the other `watch`, or mark both `mean`"
    )]
    Two {
        /// The one.
        first: String,
        /// The other.
        second: String,
        /// What they share.
        register: String,
    },
    /// A mean of one.
    #[error("dimension {0:?} moves its register by a mean, but no other dimension of the job does: mark it `controls`")]
    MeanOfOne(String),
}

/// Checks that each register of a job is moved by one dimension, or by the mean of several; never by their sum.
///
/// # Errors
/// The first two that would move one register on their own, or a mean of one.
pub fn one_controls_each_register(dimensions: &[Dimension]) -> Result<(), Conflict> {
    let moves = |d: &&Dimension| d.role != Role::Watch;
    for (k, second) in dimensions.iter().enumerate().filter(|(_, d)| moves(d)) {
        let mut others = dimensions[..k].iter().filter(moves).filter(|d| d.register == second.register);
        if let Some(first) = others.find(|first| first.role == Role::Controls || second.role == Role::Controls) {
            return Err(Conflict::Two {
                first: first.name.clone(),
                second: second.name.clone(),
                register: second.register.clone(),
            });
        }
        let alone = |other: &Dimension| other.register != second.register || other.role != Role::Mean;
        if second.role == Role::Mean && dimensions.iter().enumerate().all(|(j, d)| j == k || alone(d)) {
            return Err(Conflict::MeanOfOne(second.name.clone()));
        }
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The published example: 3.2342 in to aim at, tool 5, believable between 3.22 and 3.245.
    pub(crate) fn published() -> Dimension {
        let inch = |n| Unit::Inch.length(n);
        Dimension {
            name: "DIM A".into(),
            kind: Kind::OutsideDiameter,
            unit: Unit::Inch,
            nominal: inch(3.2342),
            low: inch(3.2332),
            high: inch(3.2352),
            target: inch(3.2342),
            tool: ToolNumber(5),
            offset: 5,
            column: Column::Wear(Axis::X),
            register: "lathe/tool/5/wear/x_mm".into(),
            response: Response::Same,
            window: (inch(3.22), inch(3.245)),
            largest_step: inch(0.005),
            increment: inch(0.0001),
            role: Role::Controls,
            grows_with_wear: true,
            every: 1,
        }
    }

    #[track_caller]
    fn check_refused(change: impl Fn(&mut Dimension), expected: &str) {
        let mut dimension = published();
        dimension.check().expect("good before the change");
        change(&mut dimension);
        let refused = dimension.check().expect_err(expected).to_string();
        assert!(refused.contains(expected), "{refused}");
    }

    #[test]
    fn a_dimension_that_makes_no_sense_is_refused_with_what_is_needed() {
        check_refused(|d| d.name = " ".into(), "needs a name");
        check_refused(|d| d.register.clear(), "needs the register");
        check_refused(|d| d.nominal = Millimetres(f64::NAN), "finite");
        check_refused(
            |d| d.high = d.low,
            "its low limit 3.2332 in must be below its high limit 3.2332 in",
        );
        check_refused(
            |d| d.target = Unit::Inch.length(3.236),
            "its target 3.2360 in must lie in its limits 3.2332 in .. 3.2352 in",
        );
        check_refused(|d| d.window.1 = d.target, "inside its entry window 3.2200 in .. 3.2342 in");
        check_refused(|d| d.largest_step = Millimetres(0.0), "largest single step");
        check_refused(|d| d.increment = Millimetres(-1.0), "finest step");
    }

    #[test]
    fn only_one_dimension_moves_a_register() {
        let other = |register: &str, role| Dimension {
            name: "DIM B".into(),
            register: register.into(),
            role,
            ..published()
        };
        let same = &published().register;
        assert_eq!(
            one_controls_each_register(&[published(), other("lathe/tool/5/wear/z_mm", Role::Controls)]),
            Ok(())
        );
        assert_eq!(one_controls_each_register(&[published(), other(same, Role::Watch)]), Ok(()));
        let conflict = one_controls_each_register(&[published(), other(same, Role::Controls)]).expect_err("two");
        assert_eq!(
            conflict.to_string(),
            "dimensions \"DIM A\" and \"DIM B\" both move lathe/tool/5/wear/x_mm: let one control it and mark the other `watch`, or mark both `mean`"
        );
    }

    #[test]
    fn a_mean_takes_two_and_does_not_mix_with_one_that_controls() {
        let named = |name: &str, role| Dimension {
            name: name.into(),
            role,
            ..published()
        };
        let (a, b) = (named("A", Role::Mean), named("B", Role::Mean));
        assert_eq!(one_controls_each_register(&[a.clone(), b.clone()]), Ok(()));
        assert_eq!(
            one_controls_each_register(std::slice::from_ref(&a)),
            Err(Conflict::MeanOfOne("A".into()))
        );
        let mixed = one_controls_each_register(&[a, b, named("C", Role::Controls)]);
        assert!(matches!(mixed, Err(Conflict::Two { .. })), "{mixed:?}");
    }

    #[test]
    fn words_of_kinds_and_roles_stand_at_their_own_place() {
        assert!(Kind::ALL.iter().all(|(words, kind)| kind.words() == *words));
        assert!(Role::ALL.iter().all(|(words, role)| role.words() == *words));
    }
}

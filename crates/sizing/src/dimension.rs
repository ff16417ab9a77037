//! What a job declares about a size that is measured.

use crate::Unit;
use thiserror::Error;
use units::{Axis, Millimetres, ToolNumber};

/// A size of the part, and the register that moves it. Lengths are sizes as measured: a diameter is a diameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// What the operator calls it: `DIM A`.
    pub name: String,
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
    /// The axis that the register moves.
    pub axis: Axis,
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
}

/// What one millimetre more in the register does to the size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// The size grows by one: a register in diameters and a diameter, outside or inside; a length.
    Same,
    /// The size grows by two: a register in radii and a diameter; cutter radius and the width of a boss.
    Twice,
    /// The size shrinks by one: a reversed axis, boring from the far side, a depth.
    Opposite,
    /// The size shrinks by two: cutter radius and the width of a pocket.
    OppositeTwice,
}

impl Response {
    /// Millimetres of size for a millimetre of register.
    pub fn size_per_register(self) -> f64 {
        match self {
            Response::Same => 1.0,
            Response::Twice => 2.0,
            Response::Opposite => -1.0,
            Response::OppositeTwice => -2.0,
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

/// Two dimensions would move one register, and each would correct what the other has corrected.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("dimensions {first:?} and {second:?} both move {register}: let one control it and mark the other `watch`")]
pub struct Conflict {
    /// The one.
    pub first: String,
    /// The other.
    pub second: String,
    /// What they share.
    pub register: String,
}

/// Checks that no register is moved by more than one dimension of a job.
///
/// # Errors
/// The first two that share one.
pub fn one_controls_each_register(dimensions: &[Dimension]) -> Result<(), Conflict> {
    let controls = |d: &&Dimension| d.role == Role::Controls;
    for (k, second) in dimensions.iter().enumerate() {
        let same = |first: &&Dimension| first.register == second.register;
        if controls(&second)
            && let Some(first) = dimensions[..k].iter().filter(controls).find(same)
        {
            return Err(Conflict {
                first: first.name.clone(),
                second: second.name.clone(),
                register: second.register.clone(),
            });
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
            unit: Unit::Inch,
            nominal: inch(3.2342),
            low: inch(3.2332),
            high: inch(3.2352),
            target: inch(3.2342),
            tool: ToolNumber(5),
            axis: Axis::X,
            register: "lathe/tool/5/wear/x_mm".into(),
            response: Response::Same,
            window: (inch(3.22), inch(3.245)),
            largest_step: inch(0.005),
            increment: inch(0.0001),
            role: Role::Controls,
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
            "dimensions \"DIM A\" and \"DIM B\" both move lathe/tool/5/wear/x_mm: let one control it and mark the other `watch`"
        );
    }
}

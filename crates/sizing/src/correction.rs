//! The checks of an entry, in the order in which a person meets them, and the law of the correction.
//!
//! Not here: what several entries tell together, [`crate::trend`].

use crate::{Dimension, DimensionError, NotASize, Role, Unit, entry};
use ledger::ChangeRequest;
use std::cmp::Ordering;
use thiserror::Error;
use units::{Millimetres, Timestamp, ToolNumber};

/// What a person entered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The measured size as it was typed.
    pub text: String,
    /// The unit it was typed in.
    pub unit: Unit,
    /// Who.
    pub who: String,
    /// The person's level, 1 (highest) to 10.
    pub level: u8,
    /// The person's own words, may be empty.
    pub remark: String,
    /// When.
    pub when: Timestamp,
}

/// What is known of register and dimension at that moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Present {
    /// What stands in the register, mm; `None` when it was never set, which counts as 0.
    pub register: Option<f64>,
    /// What the person saw there, when the person was shown it.
    pub seen: Option<f64>,
    /// When this dimension was last entered.
    pub last_entry: Option<Timestamp>,
    /// For a dimension whose register moves by a mean: how the others of it stand.
    pub others: Others,
}

/// The other dimensions that share a register by their mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Others {
    /// By how many millimetres each that was entered since the register last moved wants it moved.
    pub asked: Vec<f64>,
    /// Names of those that were not entered since.
    pub missing: Vec<String>,
}

/// A measured size against its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Within the limits.
    Good,
    /// Below the low limit.
    TooSmall,
    /// Above the high limit.
    TooLarge,
}

/// What an entry comes to. Nothing has been changed: hand `request` to the one function that does.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// The dimension's name.
    pub dimension: String,
    /// The tool.
    pub tool: ToolNumber,
    /// The register's path.
    pub register: String,
    /// What was measured.
    pub measured: Millimetres,
    /// What was aimed at.
    pub target: Millimetres,
    /// The part against its limits.
    pub verdict: Verdict,
    /// The register before, mm.
    pub before: f64,
    /// The register after, mm.
    pub after: f64,
    /// The difference, in whole steps of the register, mm.
    pub change: f64,
    /// The size that the next part will have if nothing else changes; derived.
    pub next_part: Millimetres,
    /// The effect in words.
    pub effect: String,
    /// The change to be made; `None` when there is none to make: the size is only watched, or within half a step of the target.
    pub request: Option<ChangeRequest>,
}

/// Why an entry was refused; nothing was changed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum EntryError {
    /// The dimension itself is not usable.
    #[error(transparent)]
    Dimension(#[from] DimensionError),
    /// The text is no size.
    #[error(transparent)]
    NotASize(#[from] NotASize),
    /// The same dimension was entered a moment ago.
    #[error(
        "{dimension} was entered less than a second ago: this entry was not used; look whether the first one was, then measure the next part"
    )]
    Repeated {
        /// Which dimension.
        dimension: String,
    },
    /// The register is not what the person saw.
    #[error(
        "{register} is {found} mm and no longer {seen} mm: somebody changed it meanwhile; look at it and enter the size again"
    )]
    Stale {
        /// Which register.
        register: String,
        /// What was seen.
        seen: f64,
        /// What stands there.
        found: f64,
    },
    /// The register holds no number.
    #[error("{register} holds {found}: set it to a number first")]
    BadRegister {
        /// Which register.
        register: String,
        /// What stands there.
        found: f64,
    },
    /// Outside the window, alarm 100 of the published macros.
    #[error("alarm 100 DIMENSION ENTERED TOO SMALL: {dimension} {measured} is not above {limit}{}; measure again, or widen the entry window",
        meant.as_ref().map(|m| format!("; did you mean {m}?")).unwrap_or_default())]
    TooSmall {
        /// Which dimension.
        dimension: String,
        /// What was entered, in the entry's unit.
        measured: String,
        /// The end of the window.
        limit: String,
        /// The same number in the other unit, when that would fit.
        meant: Option<String>,
    },
    /// Outside the window, alarm 101 of the published macros.
    #[error("alarm 101 DIMENSION ENTERED TOO BIG: {dimension} {measured} is not below {limit}{}; measure again, or widen the entry window",
        meant.as_ref().map(|m| format!("; did you mean {m}?")).unwrap_or_default())]
    TooBig {
        /// Which dimension.
        dimension: String,
        /// What was entered, in the entry's unit.
        measured: String,
        /// The end of the window.
        limit: String,
        /// The same number in the other unit, when that would fit.
        meant: Option<String>,
    },
    /// The change is larger than the person may make.
    #[error(
        "{dimension} {measured} would change {register} by {change}, more than {largest} in one step: measure again; if it is right, \
             a person of level 3 or better must enter it"
    )]
    StepTooLarge {
        /// Which dimension.
        dimension: String,
        /// What was entered.
        measured: String,
        /// Which register.
        register: String,
        /// The change.
        change: String,
        /// The largest allowed.
        largest: String,
    },
}

impl EntryError {
    /// A short name of the rule that refused it, stable for scripts.
    pub fn rule(&self) -> &'static str {
        match self {
            EntryError::Dimension(_) => "dimension",
            EntryError::NotASize(NotASize::Empty) => "empty",
            EntryError::NotASize(NotASize::NotANumber(_)) => "not-a-number",
            EntryError::NotASize(NotASize::BothSeparators(_) | NotASize::Ambiguous { .. }) => "ambiguous",
            EntryError::Repeated { .. } => "repeated",
            EntryError::Stale { .. } => "stale",
            EntryError::BadRegister { .. } => "register",
            EntryError::TooSmall { .. } | EntryError::TooBig { .. } => "window",
            EntryError::StepTooLarge { .. } => "step",
        }
    }
    /// The alarm number and text of the published macros, where there is one.
    pub fn alarm(&self) -> Option<(u32, &'static str)> {
        match self {
            EntryError::TooSmall { .. } => Some((100, "DIMENSION ENTERED TOO SMALL")),
            EntryError::TooBig { .. } => Some((101, "DIMENSION ENTERED TOO BIG")),
            _ => None,
        }
    }
}

/// The level that may make a change beyond the largest single step.
const LEVEL_FOR_LARGE_STEPS: u8 = 3;
/// A second entry within this time is the same keystroke.
const REPEATED_WITHIN: f64 = 1.0;

/// Checks an entry and works out what it does to the register.
///
/// # Errors
/// In this order: the dimension makes no sense; the text is no size or has two meanings; it was entered a moment ago, or the register
/// is not what the person saw; it is outside the entry window; the change is larger than the person may make.
///
/// ```
/// # use sizing::{Column, Dimension, Entry, Kind, Present, Response, Role, Unit, enter};
/// # use units::{Axis, Millimetres, Timestamp, ToolNumber};
/// let dimension = Dimension {
///     name: "DIM A".into(),
///     kind: Kind::OutsideDiameter,
///     unit: Unit::Mm,
///     nominal: Millimetres(20.0),
///     low: Millimetres(19.98),
///     high: Millimetres(20.02),
///     target: Millimetres(19.995),
///     tool: ToolNumber(3),
///     offset: 3,
///     column: Column::Wear(Axis::X),
///     register: "sim-lathe/tool/3/wear/x_mm".into(),
///     response: Response::Same,
///     window: (Millimetres(19.8), Millimetres(20.2)),
///     largest_step: Millimetres(0.1),
///     increment: Millimetres(0.001),
///     role: Role::Controls,
///     grows_with_wear: true,
///     every: 1,
/// };
/// let entry = Entry {
///     text: "20.015".into(),
///     unit: Unit::Mm,
///     who: "Maria".into(),
///     level: 5,
///     remark: String::new(),
///     when: Timestamp(0),
/// };
/// let correction = enter(&dimension, &entry, &Present { register: Some(-0.1), ..Present::default() })?;
/// assert_eq!((correction.before, correction.after), (-0.1, -0.12));
/// # Ok::<(), sizing::EntryError>(())
/// ```
pub fn enter(dimension: &Dimension, entry: &Entry, present: &Present) -> Result<Correction, EntryError> {
    dimension.check()?;
    let number = entry::number(&entry.text)?;
    let measured = entry.unit.length(number);
    check_fresh(dimension, entry, present)?;
    check_window(dimension, entry.unit, number)?;

    let asked = asked(dimension, measured);
    let change = match dimension.role {
        Role::Controls => in_whole_steps(dimension, asked),
        Role::Mean if present.others.missing.is_empty() => {
            let all = asked + present.others.asked.iter().sum::<f64>();
            in_whole_steps(dimension, all / (1 + present.others.asked.len()) as f64)
        }
        Role::Mean | Role::Watch => 0.0,
    };
    check_step(dimension, entry, measured, change)?;

    let before = present.register.unwrap_or(0.0);
    let after = tidy(before + change);
    let next_part = measured + Millimetres(change * dimension.response.size_per_register());
    let request = (change != 0.0).then(|| ChangeRequest {
        path: dimension.register.clone(),
        to: after,
        expected: present.register,
        who: entry.who.clone(),
        why: reason(dimension, entry, measured),
        when: entry.when,
    });
    Ok(Correction {
        dimension: dimension.name.clone(),
        tool: dimension.tool,
        register: dimension.register.clone(),
        measured,
        target: dimension.target,
        verdict: verdict(dimension, measured),
        before,
        after,
        change,
        next_part,
        effect: effect(dimension, &present.others, measured, before, after, change, next_part),
        request,
    })
}

/// By how much a size wants its register moved, mm; not yet in whole steps of the register.
pub fn asked(dimension: &Dimension, measured: Millimetres) -> f64 {
    (dimension.target - measured).0 / dimension.response.size_per_register()
}

/// A register takes whole steps. A thousandth of a step is the dust of binary fractions: half a step that the dust made smaller is still
/// half a step, and goes away from 0. Generated macros count the same way.
fn in_whole_steps(dimension: &Dimension, mm: f64) -> f64 {
    let steps = libm::round(libm::round(mm / dimension.increment.0 * 1e3) / 1e3);
    tidy(steps * dimension.increment.0)
}

fn check_fresh(dimension: &Dimension, entry: &Entry, present: &Present) -> Result<(), EntryError> {
    if let Some(last) = present.last_entry {
        // A clock that was set back makes the time negative; a size entered twice is worse than one entered again.
        let apart = entry.when.0.abs_diff(last.0) as f64 * 1e-9;
        if apart < REPEATED_WITHIN {
            return Err(EntryError::Repeated {
                dimension: dimension.name.clone(),
            });
        }
    }
    let (register, found) = (dimension.register.clone(), present.register.unwrap_or(0.0));
    if !found.is_finite() {
        return Err(EntryError::BadRegister { register, found });
    }
    match present.seen {
        Some(seen) if seen != found => Err(EntryError::Stale { register, seen, found }),
        _ => Ok(()),
    }
}

/// The ends of the window are outside, as in the published macros (`GT`, `LT`).
fn check_window(dimension: &Dimension, unit: Unit, number: f64) -> Result<(), EntryError> {
    let (from, to) = dimension.window;
    let fits = |size: Millimetres| size > from && size < to;
    let measured = unit.length(number);
    if fits(measured) {
        return Ok(());
    }
    let other = unit.other().length(number);
    let meant = fits(other).then(|| unit.other().words(other));
    let name = dimension.name.clone();
    let shown = unit.words(measured);
    Err(if measured <= from {
        EntryError::TooSmall {
            dimension: name,
            measured: shown,
            limit: dimension.unit.words(from),
            meant,
        }
    } else {
        EntryError::TooBig {
            dimension: name,
            measured: shown,
            limit: dimension.unit.words(to),
            meant,
        }
    })
}

fn check_step(dimension: &Dimension, entry: &Entry, measured: Millimetres, change: f64) -> Result<(), EntryError> {
    // A billionth more is the dust of a decimal fraction and not a larger step.
    let too_large = change.abs() > dimension.largest_step.0 * (1.0 + 1e-9);
    let allowed = (1..=LEVEL_FOR_LARGE_STEPS).contains(&entry.level);
    if !too_large || allowed {
        return Ok(());
    }
    Err(EntryError::StepTooLarge {
        dimension: dimension.name.clone(),
        measured: entry.unit.words(measured),
        register: dimension.register.clone(),
        change: dimension.unit.words(Millimetres(change)),
        largest: dimension.unit.words(dimension.largest_step),
    })
}

fn verdict(dimension: &Dimension, measured: Millimetres) -> Verdict {
    if measured < dimension.low {
        Verdict::TooSmall
    } else if measured > dimension.high {
        Verdict::TooLarge
    } else {
        Verdict::Good
    }
}

fn reason(dimension: &Dimension, entry: &Entry, measured: Millimetres) -> String {
    let mut why = format!(
        "{} measured {}, target {}",
        dimension.name,
        entry.unit.words(measured),
        dimension.unit.words(dimension.target)
    );
    if !entry.remark.trim().is_empty() {
        why.push_str(": ");
        why.push_str(entry.remark.trim());
    }
    why
}

fn effect(
    dimension: &Dimension,
    others: &Others,
    measured: Millimetres,
    before: f64,
    after: f64,
    change: f64,
    next_part: Millimetres,
) -> String {
    let shown = |mm: f64| dimension.unit.words(Millimetres(mm));
    if dimension.role == Role::Watch {
        return format!("changes nothing: {} is only watched", dimension.name);
    }
    if dimension.role == Role::Mean && !others.missing.is_empty() {
        let missing = others.missing.join(", ");
        return format!(
            "changes nothing yet: {} and {missing} move their register by their mean",
            dimension.name
        );
    }
    let direction = match next_part.0.partial_cmp(&measured.0) {
        Some(Ordering::Less) => "smaller",
        Some(Ordering::Greater) => "larger",
        _ => {
            return format!(
                "changes nothing: {} is within half a step of the target {}",
                shown(measured.0),
                shown(dimension.target.0)
            );
        }
    };
    format!(
        "{}, offset {}: {} -> {} ({}{}): the next {} will be {} {direction}, about {}",
        dimension.column,
        dimension.offset,
        shown(before),
        shown(after),
        if change > 0.0 { "+" } else { "" },
        shown(change),
        dimension.kind.noun(),
        shown((next_part - measured).0.abs()),
        shown(next_part.0)
    )
}

/// A millionth of a micrometre is the dust of binary fractions: what people enter and controls hold are decimal numbers.
fn tidy(mm: f64) -> f64 {
    let rounded = libm::round(mm * 1e9) / 1e9;
    // 1e9 times a large number may overflow; such a register is as good as it was.
    if rounded.is_finite() { rounded } else { mm }
}

#[cfg(test)]
mod tests;

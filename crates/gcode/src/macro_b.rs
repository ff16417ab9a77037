//! Custom Macro B: values, the laws that differ between controls, and plain memory.
//!
//! The main type is [`Value`]: *vacant* is neither zero nor false but a kind of its own, with laws of its own. Expressions are taken apart
//! in `expression` and carried out in `evaluate`; statements are in `statement`, calls in `calls`, system variables in
//! `system_variables`. Where families of controls differ, [`MacroRules`] says which law holds.
//!
//! Sources: Fanuc 16/18-C and 16i operator's manuals, custom macro chapters; their alarm numbers are used throughout.

use crate::fault::Fault;
use plan::{Origin, Question};

/// What a variable holds.
///
/// | expression | `#1` vacant | `#1 = 0` |
/// | --- | --- | --- |
/// | `#2=#1` | `#2` vacant | 0 |
/// | `#2=#1*5`, `#2=#1+#1` | 0 | 0 |
/// | `X#1` | word dropped | X0 |
/// | `#1 EQ #0` | true | false |
/// | `#1 EQ 0` | false | true |
/// | `#1 NE #0` | false | true |
/// | `#1 NE 0` | true | false |
/// | `#1 GE 0`, `#1 LE 0`, also with `#0` | true | true |
/// | `#1 GT 0`, `#1 LT 0` | false | false |
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Value {
    /// Nothing was put there yet.
    #[default]
    Vacant,
    /// A number.
    Number(f64),
}

impl Value {
    /// What arithmetic sees: vacant counts as 0.
    pub fn number(self) -> f64 {
        match self {
            Value::Vacant => 0.0,
            Value::Number(n) => n,
        }
    }

    /// From the form that expressions work on: a NaN is vacant.
    pub(crate) fn of(plain: f64) -> Self {
        if plain.is_nan() { Value::Vacant } else { Value::Number(plain) }
    }

    /// To that form.
    #[cfg(test)]
    pub(crate) fn raw(self) -> f64 {
        match self {
            Value::Vacant => VACANT,
            Value::Number(n) => n,
        }
    }
}

/// Vacant as expressions see it.
pub(crate) const VACANT: f64 = f64::NAN;

/// What arithmetic sees: vacant counts as 0.
#[inline]
pub(crate) fn plain(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}

/// The laws that differ between families of controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MacroRules {
    /// A variable never written reads 0 instead of vacant (LinuxCNC).
    pub unset_is_zero: bool,
    /// Deepest nesting of brackets; one more is alarm 118.
    pub deepest_bracket: u8,
    /// `ATAN[a]/[b]` answers 0 to 360 and `ASIN` 270 to 90 (Fanuc parameter 6004.0 NAT=0); else -180 to 180 and -90 to 90.
    pub angles_from_zero: bool,
    /// `FIX` and `FUP` go down and up instead of toward and away from zero, and `MOD` works on fractions with the sign of the divisor
    /// (LinuxCNC).
    pub floored: bool,
    /// Variables #100-#199 and #500-#999 are split as on Fanuc; else #1-#5000 are all alike (LinuxCNC).
    pub fanuc_ranges: bool,
    /// AND, OR, XOR work bit by bit with the ranks of `*` and `+`, and a comparison is no number. LinuxCNC has other ranks and logical
    /// operators; they are not there yet, and refused rather than computed in the Fanuc way.
    pub compares: bool,
    /// How numbers are kept.
    pub digits: Digits,
    /// Alarm for the argument of ASIN, ACOS and LN: 111 on a 16i, 119 on a 30i.
    pub bad_arc_alarm: u32,
    /// Macro calls inside macro calls; one more is alarm 077.
    pub deepest_macro: u8,
    /// Subprograms inside subprograms.
    pub deepest_subprogram: u8,
    /// Characters of a name given by SETVN.
    pub longest_name: usize,
    /// A printed number with more digits than its field makes the field grow (Haas); else its front is cut.
    pub printed_field_grows: bool,
    /// A program may have a name, `<PART_A>`, instead of a number (30i).
    pub named_programs: bool,
    /// M97 P calls the blocks from sequence number P on as a subprogram (Haas).
    pub local_subprograms: bool,
}

/// How many digits a control keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Digits {
    /// IEEE double, about 15 digits.
    Double,
    /// A binary mantissa of 31 bits, cut, about 8 to 9 digits: `0.002*1000` is below 2 and FIX of it is 1, as the manuals of the 8-digit
    /// controls warn.
    Eight,
}

impl Digits {
    /// A number as the control keeps it.
    #[inline]
    pub(crate) fn keep(self, value: f64) -> f64 {
        match self {
            Digits::Double => value,
            // A double has 53 bits of mantissa.
            Digits::Eight => f64::from_bits(value.to_bits() & !((1 << (53 - 31)) - 1)),
        }
    }
}

/// Why a variable cannot be read or written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Refusal {
    pub number: u32,
    pub message: String,
    pub remedy: &'static str,
    /// Only the machine knows it: the block waits for the answer.
    pub ask: Option<Question>,
}

impl Refusal {
    pub(crate) fn new(number: u32, message: String, remedy: &'static str) -> Self {
        Refusal {
            number,
            message,
            remedy,
            ask: None,
        }
    }
    pub(crate) fn at(self, at: usize) -> Box<Fault> {
        let mut fault = Fault::new(at, self.number, "macro-variable", self.message, self.remedy);
        fault.ask = self.ask;
        fault
    }
    /// The machine has to be asked.
    pub(crate) fn asks(question: Question) -> Self {
        Refusal {
            ask: Some(question),
            ..Refusal::new(0, String::new(), "")
        }
    }
    /// Alarm 115.
    pub(crate) fn illegal(variable: u32) -> Self {
        Refusal::new(
            115,
            format!("#{variable} is no variable of this control"),
            "use #1-#33, #100-#199 or #500-#999",
        )
    }
    /// Alarm 116.
    pub(crate) fn write_protected(variable: u32) -> Self {
        Refusal::new(
            116,
            format!("#{variable} cannot be written"),
            "write to #1-#33, #100-#199 or #500-#999",
        )
    }
}

/// A kept variable that was written; what it holds now is in the memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KeptWrite {
    pub number: u32,
    /// What it held when it was told last; a NaN is vacant.
    pub before: f64,
    /// The line that wrote it last.
    pub origin: Origin,
}

/// Variables that are plain memory; a NaN is vacant.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    values: Vec<f64>,
    rules: MacroRules,
    /// Counts writes that changed something: a loop that changes nothing is endless.
    pub changes: u64,
    /// Kept variables written since they were told last, in the order of their first writes.
    pub kept_writes: Vec<KeptWrite>,
}

/// First system variable of Fanuc; LinuxCNC's parameters end before its own.
const FIRST_SYSTEM: u32 = 1000;
const LAST_LINUXCNC: u32 = 5000;
/// Variables that are kept when the power goes off.
pub(crate) const KEPT: std::ops::RangeInclusive<u32> = 500..=999;
/// Locals, with #0.
pub(crate) const LOCALS: usize = 34;
/// The locals of a level.
pub(crate) type Locals = [f64; LOCALS];

/// True for numbers that are plain memory; others are system variables or nothing.
pub(crate) fn is_memory(number: u32, rules: &MacroRules) -> bool {
    match number {
        1..=33 | 100..=199 | 500..=999 => true,
        0 => false,
        _ => !rules.fanuc_ranges && number <= LAST_LINUXCNC,
    }
}

impl Memory {
    pub(crate) fn new(rules: MacroRules) -> Self {
        let count = if rules.fanuc_ranges { FIRST_SYSTEM } else { LAST_LINUXCNC + 1 };
        let values = vec![if rules.unset_is_zero { 0.0 } else { VACANT }; count as usize];
        Memory {
            values,
            rules,
            changes: 0,
            kept_writes: Vec::new(),
        }
    }

    pub(crate) fn has(&self, number: u32) -> bool {
        is_memory(number, &self.rules)
    }

    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    pub(crate) fn read(&self, number: u32) -> Value {
        Value::of(self.values.get(number as usize).copied().unwrap_or(VACANT))
    }

    /// Writes a variable that [`Memory::has`], by a line; a NaN makes it vacant.
    #[inline]
    pub(crate) fn put(&mut self, number: u32, value: f64, origin: Origin) {
        let place = &mut self.values[number as usize];
        if place.to_bits() == value.to_bits() || (place.is_nan() && value.is_nan()) {
            return;
        }
        // LinuxCNC's parameters above #500 are as volatile as those below.
        if number >= *KEPT.start() && self.rules.fanuc_ranges {
            match self.kept_writes.iter_mut().rev().find(|w| w.number == number) {
                Some(write) => write.origin = origin,
                None => self.kept_writes.push(KeptWrite {
                    number,
                    before: *place,
                    origin,
                }),
            }
        }
        *place = if value.is_nan() && self.rules.unset_is_zero {
            0.0
        } else {
            value
        };
        self.changes += 1;
    }

    /// A new set of locals; gives back the old one.
    pub(crate) fn enter(&mut self, locals: &Locals) -> Locals {
        let mut old = [VACANT; LOCALS];
        old.copy_from_slice(&self.values[..LOCALS]);
        self.values[..LOCALS].copy_from_slice(locals);
        self.changes += 1;
        old
    }
}

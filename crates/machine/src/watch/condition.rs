//! Conditions as bounded programs: operations in postfix order, checked once when they are loaded, evaluated without a question after.
//!
//! A truth is 1 or 0, what is not known is not-a-number, and logic with three values falls out of arithmetic: `and` is false when one
//! side is, `or` true when one side is, else not known stays not known. A number divided by zero is not known either.

use super::signal::{MOST_SIGNALS, SIGNALS};

/// Values that a condition may have on its way at once.
pub const DEPTH: usize = 16;
/// Operations of one condition.
pub const LONGEST: usize = 128;

/// A step of a condition, working on a stack of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operation {
    /// Puts the value of a signal on the stack.
    Signal(u8),
    /// Puts a number there.
    Constant(f64),
    /// Puts true or false there.
    Truth(bool),
    /// Puts there whether an alarm is active.
    Alarm(u16),
    /// Puts there how a signal compares with a number: what nearly every condition is made of, in one operation.
    Compare(u8, Relation, f64),
    /// Compares the upper two numbers.
    Relate(Relation),
    /// The upper two numbers.
    Add,
    /// The lower minus the upper.
    Subtract,
    /// The upper two numbers.
    Multiply,
    /// The lower by the upper.
    Divide,
    /// The upper number.
    Negate,
    /// The upper truth.
    Not,
    /// The upper two truths.
    And,
    /// The upper two truths.
    Or,
    /// The upper two truths.
    Xor,
}

/// How two values compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Relation {
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterOrEqual,
    /// `=`
    Equal,
    /// `<>`
    NotEqual,
}

/// What is wrong with a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadCondition {
    /// It has more than [`LONGEST`] operations.
    TooLong,
    /// It keeps more than [`DEPTH`] values at once.
    TooDeep,
    /// An operation finds a number where it needs a truth, or the reverse, or nothing.
    Operands {
        /// Which operation, from 0.
        at: u16,
    },
    /// It asks for a signal or an alarm that does not exist.
    Number {
        /// Which operation, from 0.
        at: u16,
    },
    /// It leaves something else than one truth.
    Result,
}

impl BadCondition {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            BadCondition::TooLong => "the condition has too many operations",
            BadCondition::TooDeep => "the condition is nested too deep",
            BadCondition::Operands { .. } => "an operation of the condition finds a number for a truth, or a truth for a number",
            BadCondition::Number { .. } => "the condition asks for a signal or an alarm that does not exist",
            BadCondition::Result => "the condition is neither true nor false",
        }
    }
}

/// Checks that a condition can be evaluated in every cycle: its length, its depth, and the kind of every operand.
///
/// # Errors
/// The first thing that is wrong.
pub fn check(operations: &[Operation]) -> Result<(), BadCondition> {
    if operations.len() > LONGEST {
        return Err(BadCondition::TooLong);
    }
    // True where a truth stands.
    let mut stack = [false; DEPTH];
    let mut height = 0;
    for (at, operation) in (0u16..).zip(operations) {
        let (takes, of_truths, gives_truth) = match operation {
            Operation::Signal(_) | Operation::Constant(_) => (0, false, false),
            Operation::Truth(_) | Operation::Alarm(_) | Operation::Compare(..) => (0, false, true),
            Operation::Relate(_) => (2, false, true),
            Operation::Add | Operation::Subtract | Operation::Multiply | Operation::Divide => (2, false, false),
            Operation::Negate => (1, false, false),
            Operation::Not => (1, true, true),
            Operation::And | Operation::Or | Operation::Xor => (2, true, true),
        };
        let exists = match operation {
            Operation::Signal(number) | Operation::Compare(number, ..) => {
                usize::from(*number) < SIGNALS.len() || *number == super::signal::NO_SENSOR
            }
            Operation::Alarm(id) => (1..=super::MOST_ALARMS).contains(id),
            _ => true,
        };
        if !exists {
            return Err(BadCondition::Number { at });
        }
        if takes > height || stack[height - takes..height].iter().any(|truth| *truth != of_truths) {
            return Err(BadCondition::Operands { at });
        }
        height -= takes;
        if height == DEPTH {
            return Err(BadCondition::TooDeep);
        }
        stack[height] = gives_truth;
        height += 1;
    }
    if height == 1 && stack[0] {
        Ok(())
    } else {
        Err(BadCondition::Result)
    }
}

/// An operation as it is kept: code, signal, and the place of its number among the constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Packed(u32);

impl Packed {
    /// What stands where nothing is loaded.
    pub(super) const NONE: Packed = Packed(0);
}

const SIGNAL: u8 = 0;
const CONSTANT: u8 = 1;
const ALARM: u8 = 2;
const ADD: u8 = 3;
const SUBTRACT: u8 = 4;
const MULTIPLY: u8 = 5;
const DIVIDE: u8 = 6;
const NEGATE: u8 = 7;
const NOT: u8 = 8;
const AND: u8 = 9;
const OR: u8 = 10;
const XOR: u8 = 11;
/// Plus the relation.
const COMPARE: u8 = 16;
/// Plus the relation.
const RELATE: u8 = 32;

impl Packed {
    /// The place of its number among the constants, if it has one.
    pub(super) fn constant(self) -> Option<u16> {
        let code = self.0 as u8;
        (code == CONSTANT || (COMPARE..RELATE).contains(&code)).then_some((self.0 >> 16) as u16)
    }

    /// The same with its number at another place.
    pub(super) fn with_constant(self, place: u16) -> Packed {
        Packed(self.0 & 0xffff | u32::from(place) << 16)
    }

    /// Packs an operation; `constant` gives the place of a number.
    pub(super) fn of(operation: Operation, mut constant: impl FnMut(f64) -> Option<u16>) -> Option<Packed> {
        let word = |code: u8, signal: u8, number: u16| Packed(u32::from(code) | u32::from(signal) << 8 | u32::from(number) << 16);
        Some(match operation {
            Operation::Signal(signal) => word(SIGNAL, signal, 0),
            Operation::Constant(value) => word(CONSTANT, 0, constant(value)?),
            Operation::Truth(truth) => word(CONSTANT, 0, constant(f64::from(u8::from(truth)))?),
            Operation::Alarm(id) => word(ALARM, 0, id),
            Operation::Compare(signal, relation, value) => word(COMPARE + relation as u8, signal, constant(value)?),
            Operation::Relate(relation) => word(RELATE + relation as u8, 0, 0),
            Operation::Add => word(ADD, 0, 0),
            Operation::Subtract => word(SUBTRACT, 0, 0),
            Operation::Multiply => word(MULTIPLY, 0, 0),
            Operation::Divide => word(DIVIDE, 0, 0),
            Operation::Negate => word(NEGATE, 0, 0),
            Operation::Not => word(NOT, 0, 0),
            Operation::And => word(AND, 0, 0),
            Operation::Or => word(OR, 0, 0),
            Operation::Xor => word(XOR, 0, 0),
        })
    }
}

/// How two numbers compare, as a truth; not known when one of them is not.
#[inline(always)]
fn compare(relation: u8, a: f64, b: f64) -> f64 {
    let truth = match relation & 7 {
        0 => a < b,
        1 => a <= b,
        2 => a > b,
        3 => a >= b,
        4 => a == b,
        _ => a != b,
    };
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        f64::from(u8::from(truth))
    }
}

/// How a relation comes out where the one number is below, equal to and above the other: bits 0, 1 and 2.
const OUTCOMES: [u8; 8] = [0b001, 0b011, 0b100, 0b110, 0b010, 0b101, 0b101, 0b101];

/// Brings the comparisons of a condition to its front, where all of them have to hold and nothing else is in it: the usual condition. Their
/// order does not matter then. Gives how many there are; 0 for every other condition, which is left as it is.
pub(super) fn only_comparisons(operations: &mut [Packed]) -> u16 {
    let is_compare = |packed: &Packed| (COMPARE..RELATE).contains(&(packed.0 as u8));
    if !operations.iter().all(|packed| is_compare(packed) || packed.0 as u8 == AND) {
        return 0;
    }
    let mut front = 0;
    for at in 0..operations.len() {
        if is_compare(&operations[at]) {
            operations.swap(front, at);
            front += 1;
        }
    }
    front as u16
}

/// A comparison by itself, with its number beside it: what decided a condition in the cycle before is likely to decide it again.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deciding {
    number: f64,
    signal: u8,
    /// Bits as in [`OUTCOMES`].
    outcomes: u8,
}

impl Deciding {
    /// Decides nothing.
    pub(super) const NOTHING: Deciding = Deciding {
        number: 0.0,
        signal: 0,
        outcomes: 0b111,
    };

    #[inline(always)]
    fn of(Packed(word): Packed, constants: &[f64]) -> Deciding {
        let (code, signal, number) = (word as u8, (word >> 8) as u8, (word >> 16) as u16);
        Deciding {
            number: constants.get(usize::from(number)).copied().unwrap_or(f64::NAN),
            signal,
            outcomes: OUTCOMES[usize::from(code.wrapping_sub(COMPARE) & 7)],
        }
    }

    /// Both numbers are known, and the comparison holds.
    #[inline(always)]
    fn known_and_holds(self, values: &[f64; MOST_SIGNALS]) -> (bool, bool) {
        let (a, b) = (values[usize::from(self.signal)], self.number);
        let above = u8::from(a >= b) + u8::from(a > b);
        (!a.is_nan() & !b.is_nan(), self.outcomes >> above & 1 != 0)
    }

    /// True where it is known not to hold.
    #[inline(always)]
    pub(super) fn is_false(self, values: &[f64; MOST_SIGNALS]) -> bool {
        let (known, holds) = self.known_and_holds(values);
        known & !holds
    }
}

/// [`evaluate`] for comparisons that all have to hold, without a branch for each: one that is false decides, and if none is, one that is not
/// known. With the one that decided.
#[inline]
pub(super) fn evaluate_all(comparisons: &[Packed], constants: &[f64], values: &[f64; MOST_SIGNALS]) -> (f64, Deciding) {
    let (mut is_false, mut is_unknown) = (false, false);
    let mut deciding = Deciding::NOTHING;
    for packed in comparisons {
        let comparison = Deciding::of(*packed, constants);
        let (known, holds) = comparison.known_and_holds(values);
        if known & !holds {
            deciding = comparison;
        }
        is_false |= known & !holds;
        is_unknown |= !known;
    }
    let truth = match (is_false, is_unknown) {
        (true, _) => 0.0,
        (false, true) => f64::NAN,
        (false, false) => 1.0,
    };
    (truth, deciding)
}

/// Evaluates what was checked and packed: 1, 0, or not-a-number.
#[inline]
pub(super) fn evaluate(
    operations: &[Packed],
    constants: &[f64],
    values: &[f64; MOST_SIGNALS],
    alarm: impl Fn(u16) -> bool,
) -> f64 {
    let mut stack = [0.0f64; DEPTH];
    // The place above the upper value; the check keeps it within the stack, the mask tells the compiler.
    let mut top = 0usize;
    for Packed(word) in operations {
        let (code, signal, number) = (*word as u8, (*word >> 8) as u8, (*word >> 16) as u16);
        let constant = || constants.get(usize::from(number)).copied().unwrap_or(f64::NAN);
        let value = if code >= RELATE {
            top = top.wrapping_sub(2);
            compare(code - RELATE, stack[top % DEPTH], stack[(top + 1) % DEPTH])
        } else if code >= COMPARE {
            compare(code - COMPARE, values[usize::from(signal)], constant())
        } else {
            match code {
                SIGNAL => values[usize::from(signal)],
                CONSTANT => constant(),
                ALARM => f64::from(u8::from(alarm(number))),
                NEGATE | NOT => {
                    top = top.wrapping_sub(1);
                    let a = stack[top % DEPTH];
                    if code == NOT { 1.0 - a } else { -a }
                }
                _ => {
                    top = top.wrapping_sub(2);
                    let (a, b) = (stack[top % DEPTH], stack[(top + 1) % DEPTH]);
                    match code {
                        AND if a == 0.0 || b == 0.0 => 0.0,
                        AND => a * b,
                        OR if a == 1.0 || b == 1.0 => 1.0,
                        OR => a + b,
                        XOR => (a - b).abs(),
                        ADD => a + b,
                        SUBTRACT => a - b,
                        MULTIPLY => a * b,
                        DIVIDE if b == 0.0 => f64::NAN,
                        _ => a / b,
                    }
                }
            }
        };
        stack[top % DEPTH] = value;
        top += 1;
    }
    stack[0]
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    fn value(operations: &[Operation], x: f64) -> Option<bool> {
        assert_eq!(check(operations), Ok(()));
        let mut constants = Vec::new();
        let packed: Vec<Packed> = operations
            .iter()
            .map(|operation| {
                Packed::of(*operation, |value| {
                    constants.push(value);
                    Some(constants.len() as u16 - 1)
                })
                .expect("room")
            })
            .collect();
        let mut values = [f64::NAN; MOST_SIGNALS];
        values[0] = x;
        let truth = evaluate(&packed, &constants, &values, |id| id == 7);
        (!truth.is_nan()).then_some(truth == 1.0)
    }

    use Operation::*;

    #[test]
    fn comparisons_are_decided_by_the_present_value() {
        for (relation, expected) in [
            (Relation::Less, [true, false, false]),
            (Relation::LessOrEqual, [true, true, false]),
            (Relation::Greater, [false, false, true]),
            (Relation::GreaterOrEqual, [false, true, true]),
            (Relation::Equal, [false, true, false]),
            (Relation::NotEqual, [true, false, true]),
        ] {
            for (x, expected) in [1.0, 2.0, 3.0].into_iter().zip(expected) {
                assert_eq!(value(&[Compare(0, relation, 2.0)], x), Some(expected));
                assert_eq!(value(&[Signal(0), Constant(2.0), Relate(relation)], x), Some(expected));
            }
        }
    }

    #[test]
    fn what_is_not_known_decides_nothing_that_it_does_not_have_to() {
        let unknown = Compare(1, Relation::Less, 0.0);
        for (operations, expected) in [
            (&[unknown][..], None),
            (&[unknown, Not], None),
            (&[Truth(false), unknown, And], Some(false)),
            (&[unknown, Truth(false), And], Some(false)),
            (&[unknown, Truth(true), And], None),
            (&[unknown, Truth(true), Or], Some(true)),
            (&[Truth(false), unknown, Or], None),
            (&[Truth(true), unknown, Xor], None),
            (
                &[Signal(0), Constant(0.0), Divide, Constant(0.0), Relate(Relation::Equal)],
                None,
            ),
        ] {
            assert_eq!(value(operations, 1.0), expected, "{operations:?}");
        }
    }

    #[test]
    fn arithmetic_and_alarms_work() {
        // -(x - 1) * 2 / 4 + 3 = 2 with x = 3
        let operations = [
            Signal(0),
            Constant(1.0),
            Subtract,
            Negate,
            Constant(2.0),
            Multiply,
            Constant(4.0),
            Divide,
            Constant(3.0),
            Add,
            Constant(2.0),
            Relate(Relation::Equal),
        ];
        assert_eq!(value(&operations, 3.0), Some(true));
        assert_eq!(value(&[Alarm(7), Alarm(8), Xor], 0.0), Some(true));
    }

    #[test]
    fn what_could_go_wrong_in_a_cycle_is_refused_before() {
        assert_eq!(check(&[]), Err(BadCondition::Result));
        assert_eq!(check(&[Signal(0)]), Err(BadCondition::Result));
        assert_eq!(check(&[Truth(true), Truth(true)]), Err(BadCondition::Result));
        assert_eq!(check(&[And]), Err(BadCondition::Operands { at: 0 }));
        assert_eq!(
            check(&[Truth(true), Constant(1.0), Add]),
            Err(BadCondition::Operands { at: 2 })
        );
        assert_eq!(check(&[Constant(1.0), Not]), Err(BadCondition::Operands { at: 1 }));
        assert_eq!(check(&[Signal(200), Not]), Err(BadCondition::Number { at: 0 }));
        assert_eq!(check(&[Alarm(1000)]), Err(BadCondition::Number { at: 0 }));
        assert_eq!(check(&[Truth(true); DEPTH + 1]), Err(BadCondition::TooDeep));
        assert_eq!(check(&[Truth(true); LONGEST + 1]), Err(BadCondition::TooLong));
    }

    #[test]
    fn comparisons_that_all_have_to_hold_come_out_as_any_condition_in_whatever_order_they_are_joined() {
        let relations = [
            Relation::Less,
            Relation::LessOrEqual,
            Relation::Greater,
            Relation::GreaterOrEqual,
            Relation::Equal,
            Relation::NotEqual,
        ];
        let readings = [f64::NAN, -1.0, 0.0, -0.0, 2.0, f64::INFINITY];
        let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
        for first in relations {
            for second in relations {
                let joined_last = [
                    Operation::Compare(0, first, 0.0),
                    Operation::Compare(1, second, 2.0),
                    Operation::Compare(0, second, f64::INFINITY),
                    Operation::And,
                    Operation::And,
                ];
                let joined_each = [joined_last[0], joined_last[1], Operation::And, joined_last[2], Operation::And];
                for operations in [joined_last, joined_each] {
                    let mut constants = Vec::new();
                    let mut packed = operations.map(|operation| {
                        let place = |value| {
                            constants.push(value);
                            Some(constants.len() as u16 - 1)
                        };
                        Packed::of(operation, place).expect("room")
                    });
                    for x in readings {
                        for y in readings {
                            let mut values = [f64::NAN; MOST_SIGNALS];
                            (values[0], values[1]) = (x, y);
                            let any = evaluate(&packed, &constants, &values, |_| false);
                            let mut sorted = packed;
                            assert_eq!(only_comparisons(&mut sorted), 3);
                            let (all, deciding) = evaluate_all(&sorted[..3], &constants, &values);
                            assert!(same(any, all), "{operations:?} of {x} and {y}: {any} and {all}");
                            assert_eq!(deciding.is_false(&values), any == 0.0, "{operations:?} of {x} and {y}");
                        }
                    }
                    packed[4] = Packed::of(Operation::Or, |_| None).expect("room");
                    let before = packed.map(|p| p.0);
                    assert_eq!(only_comparisons(&mut packed), 0);
                    assert_eq!(packed.map(|p| p.0), before, "another condition is left as it is");
                }
            }
        }
    }
}

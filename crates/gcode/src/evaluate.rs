//! Carrying out the operations of an [`Expression`] on a stack of plain numbers.

use crate::expression::{Binary, Code, DEEPEST_STACK, Expression, Function, Op};
use crate::fault::{Fault, Outcome};
use crate::macro_b::{MacroRules, Refusal, VACANT, plain};

/// Where expressions get their values from.
pub(crate) trait Variables {
    /// Plain memory by variable number; a NaN is vacant.
    fn memory(&self) -> &[f64];
    /// The value of any variable that is not plain memory, or why it has none. A NaN is vacant.
    fn read(&self, number: u32) -> Result<f64, Refusal>;
    /// Whether plain memory holds what is in a variable that is found by its name or by the value of another one; lines that name a
    /// variable by its number are looked at before.
    fn known(&self, _number: u32) -> Result<(), Refusal> {
        Ok(())
    }
    /// The number of a variable that SETVN named.
    fn named(&self, name: &str) -> Option<u32>;
    /// A control parameter, or one bit or axis of it.
    fn parameter(&self, number: u32, bit: Option<u8>, axis: Option<u8>) -> f64;
    /// What ADP makes of an argument: its value as written, without the least increment.
    fn with_point(&self, argument: f64) -> f64;
}

/// Place for the operands below the one that is being worked on; one is kept for all expressions.
pub(crate) type Stack = [f64; DEEPEST_STACK];

/// The value of an expression; a NaN is vacant. A truth is 1 or 0.
pub(crate) fn evaluate<V: Variables>(
    code: &Code,
    expression: Expression,
    rules: &MacroRules,
    variables: &V,
    stack: &mut Stack,
) -> Outcome<f64> {
    let (ops, places) = code.of(expression);
    let memory = variables.memory();
    // The operand put last; those before it are on the stack. The parser counted: no expression needs more than the stack holds, and
    // none takes more than was put. What the first operand puts aside means nothing.
    let mut last = VACANT;
    let mut top = 0_usize;
    for (op, place) in ops.iter().zip(places) {
        let at = *place as usize;
        match *op {
            Op::Number(n) => {
                stack[top] = last;
                top += 1;
                last = n;
            }
            Op::Memory(n) => {
                stack[top] = last;
                top += 1;
                last = memory[usize::from(n)];
            }
            // Of vacant it is 0, as all arithmetic is; never -0.
            Op::Negate => last = 0.0 - counted(last),
            Op::NegateWord => last = 0.0 - last,
            Op::WithNumber(binary, n) => last = binary_result(rules, binary, last, n, at)?,
            Op::WithMemory(binary, n) => last = binary_result(rules, binary, last, memory[usize::from(n)], at)?,
            Op::Two(binary) => {
                top -= 1;
                last = binary_result(rules, binary, stack[top], last, at)?;
            }
            op => (last, top) = rarer(op, code, rules, variables, stack, (last, top), at)?,
        }
    }
    Ok(last)
}

/// The operations that loops are not made of; apart, so that the others stay short.
#[inline(never)]
fn rarer<V: Variables>(
    op: Op,
    code: &Code,
    rules: &MacroRules,
    variables: &V,
    stack: &mut Stack,
    (mut last, mut top): (f64, usize),
    at: usize,
) -> Outcome<(f64, usize)> {
    let mut put_aside = |last: f64, top: &mut usize| {
        stack[*top] = last;
        *top += 1;
    };
    match op {
        Op::Vacant => {
            put_aside(last, &mut top);
            last = VACANT;
        }
        Op::Variable(n) => {
            put_aside(last, &mut top);
            last = variables.read(n).map_err(|r| r.at(at))?;
        }
        Op::Named(name) => {
            let name = &code.names[usize::from(name)];
            let number = variables.named(name).ok_or_else(|| no_such_name(name, at))?;
            put_aside(last, &mut top);
            last = read_any(variables, rules, number).map_err(|r| r.at(at))?;
        }
        Op::Indirect => {
            let number = variable_number(counted(last), at)?;
            last = read_any(variables, rules, number).map_err(|r| r.at(at))?;
        }
        Op::Function(Function::AddPoint) => last = variables.with_point(counted(last)),
        Op::Function(function) => last = bounded(rules, apply(rules, function, counted(last), None, at)?, at)?,
        Op::Function2(function) => {
            top -= 1;
            let (a, b) = (counted(stack[top]), counted(last));
            last = bounded(rules, apply(rules, function, a, Some(b), at)?, at)?;
        }
        Op::Parameter => last = variables.parameter(whole(last), None, None),
        Op::ParameterBit => {
            top -= 1;
            last = variables.parameter(whole(stack[top]), Some(whole(last) as u8), None);
        }
        Op::ParameterAxis => {
            top -= 1;
            last = variables.parameter(whole(stack[top]), None, Some(whole(last) as u8));
        }
        Op::ParameterBitAxis => {
            top -= 2;
            let (bit, axis) = (whole(stack[top + 1]) as u8, whole(last) as u8);
            last = variables.parameter(whole(stack[top]), Some(bit), Some(axis));
        }
        Op::Number(_) | Op::Memory(_) | Op::Negate | Op::NegateWord | Op::WithNumber(..) | Op::WithMemory(..) | Op::Two(_) => {
            unreachable!("carried out by evaluate")
        }
    }
    Ok((last, top))
}

/// EQ and NE tell vacant from 0; for all else vacant counts as 0.
#[inline(always)]
fn binary_result(rules: &MacroRules, binary: Binary, left: f64, right: f64, at: usize) -> Outcome<f64> {
    let (a, b) = (counted(left), counted(right));
    let truth = |truth: bool| Ok(if truth { 1.0 } else { 0.0 });
    let result = match binary {
        Binary::Add => a + b,
        Binary::Subtract => a - b,
        Binary::Multiply => a * b,
        Binary::Divide if b != 0.0 => a / b,
        Binary::Divide | Binary::Modulo | Binary::And | Binary::Or | Binary::Xor => rarer_result(rules, binary, a, b, at)?,
        Binary::Equal => return truth(left == right || (left.is_nan() && right.is_nan())),
        Binary::NotEqual => return truth(!(left == right || (left.is_nan() && right.is_nan()))),
        Binary::Greater => return truth(a > b),
        Binary::GreaterOrEqual => return truth(a >= b),
        Binary::Less => return truth(a < b),
        Binary::LessOrEqual => return truth(a <= b),
        Binary::Both => return truth(left != 0.0 && right != 0.0),
        Binary::Either => return truth(left != 0.0 || right != 0.0),
        Binary::OneOf => return truth((left != 0.0) != (right != 0.0)),
    };
    bounded(rules, result, at)
}

#[inline(never)]
fn rarer_result(rules: &MacroRules, binary: Binary, a: f64, b: f64, at: usize) -> Outcome<f64> {
    Ok(match binary {
        Binary::Modulo => modulo(rules, a, b, at)?,
        Binary::And => f64::from(bits(a, at)? & bits(b, at)?),
        Binary::Or => f64::from(bits(a, at)? | bits(b, at)?),
        Binary::Xor => f64::from(bits(a, at)? ^ bits(b, at)?),
        _ => return Err(division_by_zero(at, format!("{a} divided by 0"))),
    })
}

fn read_any<V: Variables>(variables: &V, rules: &MacroRules, number: u32) -> Result<f64, Refusal> {
    if crate::macro_b::is_memory(number, rules) {
        variables.known(number)?;
        Ok(variables.memory()[number as usize])
    } else if number == 0 && !rules.unset_is_zero {
        Ok(VACANT)
    } else {
        variables.read(number)
    }
}

/// The variable that `#[index]` means.
pub(crate) fn variable_number(index: f64, at: usize) -> Outcome<u32> {
    let index = libm::round(index);
    if !(0.0..=999_999_999.0).contains(&index) {
        return Err(Fault::new(
            at,
            115,
            "macro-variable",
            format!("{index} is no variable number"),
            "use #1-#33, #100-#199 or #500-#999",
        ));
    }
    Ok(index as u32)
}

pub(crate) fn no_such_name(name: &str, at: usize) -> Box<Fault> {
    Fault::new(
        at,
        115,
        "macro-variable",
        format!("no variable has the name {name}"),
        "give it by SETVN first",
    )
}

/// What arithmetic sees: vacant counts as 0.
#[inline]
fn counted(value: f64) -> f64 {
    plain(value)
}

fn whole(value: f64) -> u32 {
    libm::round(counted(value)).clamp(0.0, f64::from(u32::MAX)) as u32
}

/// Keeps a result within what the controls can hold: 1e-29 to 1e47, and 0; and to the digits they keep.
#[inline]
fn bounded(rules: &MacroRules, result: f64, at: usize) -> Outcome<f64> {
    let size = result.abs();
    if size <= 1e47 {
        return Ok(if size < 1e-29 { 0.0 } else { rules.digits.keep(result) });
    }
    Err(overflow(at, result))
}

fn bits(value: f64, at: usize) -> Outcome<i32> {
    let n = libm::round(value);
    if n < f64::from(i32::MIN) || n > f64::from(u32::MAX) {
        return Err(overflow(at, value));
    }
    Ok(n as i64 as i32)
}

fn modulo(rules: &MacroRules, a: f64, b: f64, at: usize) -> Outcome<f64> {
    let (a, b) = if rules.floored {
        (a, b)
    } else {
        (libm::round(a), libm::round(b))
    };
    if b == 0.0 {
        return Err(division_by_zero(at, format!("{a} MOD 0")));
    }
    let rest = libm::fmod(a, b); // sign of the dividend
    let other_side = rest != 0.0 && (rest < 0.0) != (b < 0.0);
    Ok(if rules.floored && other_side { rest + b } else { rest })
}

fn apply(rules: &MacroRules, function: Function, a: f64, b: Option<f64>, at: usize) -> Outcome<f64> {
    let illegal = |number: u32, what: &str, allowed: &str| {
        Fault::new(
            at,
            number,
            "macro-argument",
            format!("the argument of {what} is {a}; {allowed}"),
            "check the value before it is used",
        )
    };
    let from_zero = |degrees: f64| {
        if rules.angles_from_zero && degrees < 0.0 {
            degrees + 360.0
        } else {
            degrees
        }
    };
    Ok(match function {
        Function::Sin => sin_degrees(a),
        Function::Cos => sin_degrees(90.0 - a),
        Function::Tan => {
            let cos = sin_degrees(90.0 - a);
            if cos.abs() < 1e-12 {
                return Err(division_by_zero(at, format!("TAN of a right angle, {a} degrees")));
            }
            sin_degrees(a) / cos
        }
        Function::Asin if a.abs() > 1.0 => return Err(illegal(rules.bad_arc_alarm, "ASIN", "-1 to 1 is allowed")),
        Function::Asin => from_zero(libm::asin(a).to_degrees()),
        Function::Acos if a.abs() > 1.0 => return Err(illegal(rules.bad_arc_alarm, "ACOS", "-1 to 1 is allowed")),
        Function::Acos => libm::acos(a).to_degrees(),
        Function::Atan => match b {
            Some(b) => from_zero(libm::atan2(a, b).to_degrees()),
            None => libm::atan(a).to_degrees(),
        },
        Function::Sqrt if a < 0.0 => return Err(illegal(119, "SQRT", "0 or more is allowed")),
        Function::Sqrt => libm::sqrt(a),
        Function::Abs => a.abs(),
        Function::Ln if a <= 0.0 => return Err(illegal(rules.bad_arc_alarm, "LN", "more than 0 is allowed")),
        Function::Ln => libm::log(a),
        Function::Exp => libm::exp(a),
        Function::Round => libm::round(a), // half away from zero
        Function::Fix if rules.floored => libm::floor(a),
        Function::Fix => libm::trunc(a),
        Function::Fup if rules.floored => libm::ceil(a),
        Function::Fup if a < 0.0 => libm::floor(a),
        Function::Fup => libm::ceil(a),
        Function::Bin => {
            recode(a, 16, 10).ok_or_else(|| illegal(119, "BIN", "decimal digits packed as hexadecimal are allowed"))?
        }
        Function::Bcd => recode(a, 10, 16).ok_or_else(|| illegal(119, "BCD", "0 to 99999999 is allowed"))?,
        Function::Pow => libm::pow(a, b.unwrap_or_default()),
        Function::AddPoint => a,
    })
}

/// Sine of an angle in degrees, exact at multiples of 90: a program that moves by `COS[90]` must not move by 6e-17.
pub(crate) fn sin_degrees(angle: f64) -> f64 {
    let turn = if angle.abs() < 360.0 {
        angle
    } else {
        libm::fmod(angle, 360.0)
    };
    let quarters = libm::round(turn / 90.0);
    let rest = (turn - 90.0 * quarters).to_radians();
    match (quarters as i32).rem_euclid(4) {
        0 => libm::sin(rest),
        1 => libm::cos(rest),
        2 => -libm::sin(rest),
        _ => -libm::cos(rest),
    }
}

/// The digits of a whole number in base `from`, read in base `to`; `None` when they are no digits there.
fn recode(value: f64, from: u64, to: u64) -> Option<f64> {
    let value = libm::round(value);
    if !(0.0..=4_294_967_295.0).contains(&value) {
        return None;
    }
    let mut rest = value as u64;
    let (mut result, mut place) = (0_u64, 1_u64);
    while rest > 0 {
        let digit = rest % from;
        if digit > 9 {
            return None;
        }
        result = result.checked_add(digit.checked_mul(place)?)?;
        place = place.saturating_mul(to);
        rest /= from;
    }
    (result <= 0xffff_ffff).then_some(result as f64)
}

#[cold]
fn overflow(at: usize, value: f64) -> Box<Fault> {
    Fault::new(
        at,
        111,
        "macro-overflow",
        format!("the result {value:e} is larger than 1E47, or larger than a bit operation takes, or no number"),
        "check the values before they are used",
    )
}

#[cold]
fn division_by_zero(at: usize, what: String) -> Box<Fault> {
    Fault::new(
        at,
        112,
        "macro-division",
        what,
        "test the divisor first; a vacant variable counts as 0",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::{Kind, Parser};
    use crate::macro_b::{Memory, Value};
    use plan::{FileId, Origin, Place};

    const HERE: Origin = Origin {
        file: FileId(0),
        place: Place::Text {
            line: 1,
            start: 0,
            length: 1,
        },
    };

    fn rules(name: &str) -> MacroRules {
        crate::profile::by_name(name).expect("a family").macros
    }

    struct Given(Memory);
    impl Variables for Given {
        fn memory(&self) -> &[f64] {
            self.0.values()
        }
        fn read(&self, number: u32) -> Result<f64, Refusal> {
            Err(Refusal::illegal(number))
        }
        fn named(&self, name: &str) -> Option<u32> {
            (name == "DIM_A").then_some(103)
        }
        fn parameter(&self, number: u32, bit: Option<u8>, _axis: Option<u8>) -> f64 {
            f64::from(number) + f64::from(bit.unwrap_or(0)) / 10.0
        }
        fn with_point(&self, argument: f64) -> f64 {
            argument
        }
    }

    fn evaluated(text: &str, rules: MacroRules, first: Value) -> String {
        let mut memory = Memory::new(rules);
        memory.put(1, first.raw(), HERE);
        memory.put(2, 3.0, HERE);
        memory.put(103, 7.0, HERE);
        memory.put(100, 103.0, HERE);
        let mut code = Code::default();
        let mut parser = Parser::new(text.as_bytes(), 0, &rules, &mut code);
        let parsed = parser.any();
        if parsed.is_ok() && parser.at_next() < text.len() {
            return format!("stopped at {}", parser.at);
        }
        let mut stack = [0.0; DEEPEST_STACK];
        let result = parsed.and_then(|(e, kind)| Ok((evaluate(&code, e, &rules, &Given(memory), &mut stack)?, kind)));
        match result {
            Ok((truth, Kind::Truth)) => (truth != 0.0).to_string(),
            Ok((n, Kind::Plain)) if n.is_nan() => "vacant".to_owned(),
            Ok((n, Kind::Plain)) => {
                let rounded = libm::round(n * 1e9) / 1e9;
                (rounded + 0.0).to_string()
            }
            Err(fault) => format!("alarm {} at {}", fault.number, fault.at),
        }
    }

    #[track_caller]
    fn check(name: &str, first: Value, cases: &[(&str, &str)]) {
        for (text, expected) in cases {
            assert_eq!(evaluated(text, rules(name), first), *expected, "{text}");
        }
    }

    #[test]
    fn a_vacant_variable_is_neither_zero_nor_a_number() {
        check(
            "fanuc-mill",
            Value::Vacant,
            &[
                ("#1", "vacant"),
                ("-#1", "0"),
                ("#1*5", "0"),
                ("#1+#1", "0"),
                ("#1-2.5", "-2.5"),
                ("#1 EQ #0", "true"),
                ("#1EQ0", "false"),
                ("#1NE#0", "false"),
                ("#1NE0", "true"),
                ("#1GE#0", "true"),
                ("#1LE#0", "true"),
                ("#1GE0", "true"),
                ("#1LE0", "true"),
                ("#1GT0", "false"),
                ("#1LT0", "false"),
                ("5/#1", "alarm 112 at 1"),
            ],
        );
    }

    #[test]
    fn a_variable_that_holds_zero_is_not_vacant() {
        check(
            "fanuc-mill",
            Value::Number(0.0),
            &[
                ("#1", "0"),
                ("#1EQ#0", "false"),
                ("#1EQ0", "true"),
                ("#1NE#0", "true"),
                ("#1NE0", "false"),
                ("#1GE#0", "true"),
                ("#1LE0", "true"),
                ("#1GT0", "false"),
                ("#1LT0", "false"),
            ],
        );
    }

    #[test]
    fn ranks_go_from_left_to_right() {
        check(
            "fanuc-mill",
            Value::Number(2.0),
            &[
                ("2+3*4", "14"),
                ("[2+3]*4", "20"),
                ("10-4-3", "3"),
                ("2*3 AND 6", "6"),
                ("1 OR 2+1", "4"),
                ("8 XOR 3*2", "14"),
                ("12/4/3", "1"),
                ("-2+5", "3"),
                ("- -2", "2"),
                ("[#1EQ2]AND[#2GT2]", "true"),
                ("[#1EQ3]OR[#2GT2]", "true"),
                ("#[100]", "103"),
                ("#[#[99+1]]", "7"),
                ("#[0.6]", "2"),
            ],
        );
    }

    #[test]
    fn functions_count_in_degrees_and_round_the_shop_way() {
        check(
            "fanuc-mill",
            Value::Number(2.0),
            &[
                ("SIN[30]", "0.5"),
                ("COS[90]", "0"),
                ("cos[60.]", "0.5"),
                ("TAN[45]", "1"),
                ("TAN[90.]", "alarm 112 at 0"),
                ("TAN[-270]", "alarm 112 at 0"),
                ("ASIN[-0.5]", "330"),
                ("ASIN[1.1]", "alarm 111 at 0"),
                ("ACOS[-1]", "180"),
                ("ATAN[1]/[-1]", "135"),
                ("ATAN[-1]/[1]", "315"),
                ("ATAN[1] / [0]", "90"),
                ("ATAN[-1,1]", "315"),
                ("ATAN[-1]", "-45"),
                ("ATAN[1]/#1", "22.5"),
                ("SQRT[16]", "4"),
                ("SQRT[4-9]", "alarm 119 at 0"),
                ("ABS[-4.25]", "4.25"),
                ("LN[EXP[2]]", "2"),
                ("LN[0]", "alarm 111 at 0"),
                ("EXP[200]", "alarm 111 at 0"),
                ("ROUND[1.5]", "2"),
                ("ROUND[-1.5]", "-2"),
                ("RO[2.4]", "2"),
                ("FIX[-1.7]", "-1"),
                ("FUP[-1.2]", "-2"),
                ("FUP[3.]", "3"),
                ("BCD[25]", "37"),
                ("BIN[37]", "25"),
                ("BIN[10]", "alarm 119 at 0"),
                ("17 MOD 5", "2"),
                ("-17 MOD 5", "-2"),
                ("17MOD[-5]", "2"),
                ("7.6 MOD 3.2", "2"),
                ("12AND 10", "8"),
                ("POW[2,10]", "1024"),
            ],
        );
    }

    #[test]
    fn linuxcnc_has_laws_of_its_own() {
        check(
            "rs274",
            Value::Vacant,
            &[
                ("#1 EQ 0", "alarm 0 at 3"),
                ("1 AND 1", "alarm 0 at 2"),
                ("#4999", "0"),
                ("FIX[-1.7]", "-2"),
                ("FUP[-1.2]", "-1"),
                ("-17 MOD 5", "3"),
                ("ATAN[-1]/[1]", "-45"),
            ],
        );
    }

    #[test]
    fn a_broken_expression_is_an_alarm_at_its_place() {
        check(
            "fanuc-mill",
            Value::Number(2.0),
            &[
                ("[1+2", "alarm 114 at 4"),
                ("1+", "alarm 125 at 2"),
                ("##1", "alarm 114 at 1"),
                ("SINUS[1]", "alarm 114 at 0"),
                ("SIN 30", "alarm 114 at 4"),
                ("#34", "alarm 115 at 0"),
                ("#99999", "alarm 115 at 0"),
                ("#[-3]", "alarm 115 at 0"),
                ("[[[[[1]]]]]", "1"),
                ("[[[[[[1]]]]]]", "alarm 118 at 5"),
                ("SIN[[[[[1]]]]]", "0.017452406"),
                ("ATAN[[[[[[1]]]]]]", "alarm 118 at 9"),
                ("[#1EQ2]+1", "alarm 114 at 7"),
                ("1E5", "stopped at 1"),
                ("1 AND 1E", "stopped at 7"),
            ],
        );
    }
}

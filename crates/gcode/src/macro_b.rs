//! Custom Macro B: values, variables and expressions.
//!
//! The main type is [`Value`]: *vacant* is neither zero nor false but a kind of its own, with laws of its own (see [`Value`]).
//! Expressions are evaluated straight from the text by a reader that goes down one function a rank: comparison, sum, product, operand.
//! Assignment, variables as words and conditions are here; branches, loops and calls are not there yet and are refused by the
//! block reader. Where families of controls differ, [`MacroRules`] says which law holds.
//!
//! Sources: Fanuc 16/18-C and 16i operator's manuals, custom macro chapters; their alarm numbers are used throughout.

use crate::fault::{Fault, Outcome};
use crate::text::number_at;

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
}

/// The laws that differ between families of controls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
}

/// Where expressions get the values of variables from.
pub(crate) trait Variables {
    /// The value of variable `number`, or why it has none.
    fn read(&self, number: u32) -> Result<Value, Refusal>;
}

/// Why a variable cannot be read or written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub number: u32,
    pub message: String,
    pub remedy: &'static str,
}

impl Refusal {
    pub(crate) fn at(self, at: usize) -> Box<Fault> {
        Fault::new(at, self.number, "macro-variable", self.message, self.remedy)
    }
    /// Alarm 115.
    pub(crate) fn illegal(variable: u32) -> Self {
        Refusal {
            number: 115,
            message: format!("#{variable} is no variable of this control"),
            remedy: "use #1-#33, #100-#199 or #500-#999",
        }
    }
    /// Alarm 115 for a system variable that real controls have.
    pub(crate) fn not_there_yet(variable: u32) -> Self {
        Refusal {
            number: 115,
            message: format!("system variable #{variable} is not there yet"),
            remedy: "leave it out",
        }
    }
    /// Alarm 116.
    pub(crate) fn write_protected(variable: u32) -> Self {
        Refusal {
            number: 116,
            message: format!("#{variable} cannot be written"),
            remedy: "write to #1-#33, #100-#199 or #500-#999",
        }
    }
}

/// Variables that are plain memory.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    values: Vec<Value>,
    rules: MacroRules,
}

/// First system variable of Fanuc; LinuxCNC's parameters end before its own.
const FIRST_SYSTEM: u32 = 1000;
const LAST_LINUXCNC: u32 = 5000;

impl Memory {
    pub(crate) fn new(rules: MacroRules) -> Self {
        let count = if rules.fanuc_ranges { FIRST_SYSTEM } else { LAST_LINUXCNC + 1 };
        let values = vec![Value::Vacant; count as usize];
        Memory { values, rules }
    }

    /// True for numbers that are memory; others are system variables or nothing.
    pub(crate) fn has(&self, number: u32) -> bool {
        match number {
            1..=33 | 100..=199 | 500..=999 => true,
            0 => false,
            _ => !self.rules.fanuc_ranges && number <= LAST_LINUXCNC,
        }
    }

    pub(crate) fn read(&self, number: u32) -> Value {
        match self.values.get(number as usize).copied().unwrap_or_default() {
            Value::Vacant if self.rules.unset_is_zero => Value::Number(0.0),
            value => value,
        }
    }

    pub(crate) fn write(&mut self, number: u32, value: Value) {
        if let Some(place) = self.values.get_mut(number as usize) {
            *place = value;
        }
    }
}

/// What an expression comes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Operand {
    Plain(Value),
    /// Of a comparison; cannot be stored or counted with.
    Truth(bool),
}

/// `#i = expression`, as read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Assignment {
    pub variable: u32,
    pub value: Value,
    /// The byte behind the expression.
    pub end: usize,
}

/// Reads expressions out of a line and evaluates them.
pub(crate) struct Reader<'a, V: Variables> {
    text: &'a [u8],
    at: usize,
    depth: u8,
    rules: MacroRules,
    variables: &'a V,
}

impl<'a, V: Variables> Reader<'a, V> {
    pub(crate) fn new(text: &'a [u8], at: usize, rules: MacroRules, variables: &'a V) -> Self {
        Reader {
            text,
            at,
            depth: 0,
            rules,
            variables,
        }
    }

    /// The byte behind what was read.
    pub(crate) fn end(&self) -> usize {
        self.at
    }

    /// `#i = expression`, from its `#` on.
    pub(crate) fn assignment(&mut self) -> Outcome<Assignment> {
        let variable = self.variable_number()?;
        if self.peek() != Some(b'=') {
            return Err(self.format_error("expected = behind the variable", "a macro statement reads #100=expression"));
        }
        self.at += 1;
        let value = self.value()?;
        Ok(Assignment {
            variable,
            value,
            end: self.at,
        })
    }

    /// An expression whose value is a number or vacant.
    pub(crate) fn value(&mut self) -> Outcome<Value> {
        let start = self.at;
        match self.comparison()? {
            Operand::Plain(value) => Ok(value),
            Operand::Truth(_) => Err(truth_as_number(start)),
        }
    }

    /// What a word carries: a signed variable `#1`, `-#1`, or `[expression]`.
    pub(crate) fn word_value(&mut self) -> Outcome<Value> {
        let start = self.at;
        match self.operand()? {
            Operand::Plain(value) => Ok(value),
            Operand::Truth(_) => Err(truth_as_number(start)),
        }
    }

    /// Rank 4: at most one comparison.
    fn comparison(&mut self) -> Outcome<Operand> {
        let start = self.at;
        let left = self.sum()?;
        let Some(compare) = self.operator(&COMPARISONS)? else {
            return Ok(left);
        };
        let right = self.sum()?;
        let (Operand::Plain(left), Operand::Plain(right)) = (left, right) else {
            return Err(truth_as_number(start));
        };
        Ok(Operand::Truth(compare(left, right)))
    }

    /// Rank 3: + - OR XOR, from left to right.
    fn sum(&mut self) -> Outcome<Operand> {
        let mut left = self.product()?;
        loop {
            let at = self.at_next();
            left = if let Some(operation) = self.sign(b'+', Sum::Add).or_else(|| self.sign(b'-', Sum::Subtract)) {
                let right = self.product()?;
                let (a, b) = (self.counted(left, at)?, self.counted(right, at)?);
                number(at, if operation == Sum::Add { a + b } else { a - b })?
            } else if self.operator(&[("XOR", ())])?.is_some() {
                let right = self.product()?;
                self.bitwise(at, left, right, |a, b| a ^ b, |a, b| a != b)?
            } else if self.operator(&[("OR", ())])?.is_some() {
                let right = self.product()?;
                self.bitwise(at, left, right, |a, b| a | b, |a, b| a || b)?
            } else {
                return Ok(left);
            };
        }
    }

    /// Rank 2: * / AND MOD, from left to right.
    fn product(&mut self) -> Outcome<Operand> {
        let mut left = self.operand()?;
        loop {
            let at = self.at_next();
            left = if self.sign(b'*', ()).is_some() {
                let right = self.operand()?;
                number(at, self.counted(left, at)? * self.counted(right, at)?)?
            } else if self.sign(b'/', ()).is_some() {
                let right = self.operand()?;
                let (a, b) = (self.counted(left, at)?, self.counted(right, at)?);
                if b == 0.0 {
                    return Err(division_by_zero(at, "division by 0"));
                }
                number(at, a / b)?
            } else if self.operator(&[("AND", ())])?.is_some() {
                let right = self.operand()?;
                self.bitwise(at, left, right, |a, b| a & b, |a, b| a && b)?
            } else if self.operator(&[("MOD", ())])?.is_some() {
                let right = self.operand()?;
                let (a, b) = (self.counted(left, at)?, self.counted(right, at)?);
                number(at, self.modulo(a, b, at)?)?
            } else {
                return Ok(left);
            };
        }
    }

    /// Rank 1: a signed number, variable, bracket or function.
    fn operand(&mut self) -> Outcome<Operand> {
        let start = self.at_next();
        let mut negative = false;
        let mut signed = false;
        while let Some(sign @ (b'+' | b'-')) = self.peek() {
            negative ^= sign == b'-';
            signed = true;
            self.at += 1;
        }
        let operand = match self.peek() {
            Some(b'0'..=b'9' | b'.') => match number_at(self.text, self.at) {
                Some(n) => {
                    self.at = n.end;
                    Operand::Plain(Value::Number(n.value))
                }
                None => {
                    return Err(Fault::new(
                        self.at,
                        3,
                        "number",
                        "this number is a lone point or has more than 18 digits",
                        "controls read 8 to 12 digits",
                    ));
                }
            },
            Some(b'#') => {
                let at = self.at;
                let variable = self.variable_number()?;
                let value = match variable {
                    0 if !self.rules.unset_is_zero => Value::Vacant,
                    _ => self.variables.read(variable).map_err(|r| r.at(at))?,
                };
                Operand::Plain(value)
            }
            Some(b'[') => self.bracket()?,
            Some(c) if c.is_ascii_alphabetic() => self.function()?,
            _ => return Err(self.format_error("expected a number, #, [ or a function", "complete the expression")),
        };
        match operand {
            // A vacant word stays a dropped word behind a sign: `X-#1` with #1 vacant moves nothing.
            Operand::Plain(Value::Number(n)) if negative => Ok(Operand::Plain(Value::Number(-n))),
            Operand::Truth(_) if signed => Err(truth_as_number(start)),
            other => Ok(other),
        }
    }

    /// `[ expression ]`.
    fn bracket(&mut self) -> Outcome<Operand> {
        let open = self.open_bracket()?;
        let inside = self.comparison()?;
        self.close_bracket(open)?;
        Ok(inside)
    }

    /// Takes a `[` and gives its place.
    fn open_bracket(&mut self) -> Outcome<usize> {
        let open = self.at_next();
        if self.peek() != Some(b'[') {
            return Err(self.format_error("expected [", "put the operand of a function in brackets"));
        }
        self.at += 1;
        self.depth += 1;
        if self.depth > self.rules.deepest_bracket {
            let deepest = self.rules.deepest_bracket;
            return Err(Fault::new(
                open,
                118,
                "macro-brackets",
                format!("brackets are nested more than {deepest} deep"),
                "put a part of the expression into a variable first",
            ));
        }
        Ok(open)
    }

    fn close_bracket(&mut self, open: usize) -> Outcome<()> {
        if self.peek() != Some(b']') {
            let column = open + 1;
            return Err(self.format_error(&format!("expected ] for the [ in column {column}"), "close the bracket"));
        }
        self.at += 1;
        self.depth -= 1;
        Ok(())
    }

    /// `#12` or `#[expression]`, from its `#` on: the variable's number.
    fn variable_number(&mut self) -> Outcome<u32> {
        let at = self.at_next();
        if self.peek() != Some(b'#') {
            return Err(self.format_error("expected a variable", "variables are written #100 or #[#1+100]"));
        }
        self.at += 1;
        match self.peek() {
            Some(b'0'..=b'9') => {
                let start = self.at;
                let mut variable = 0_u32;
                while let Some(digit @ b'0'..=b'9') = self.text.get(self.at) {
                    variable = variable.saturating_mul(10).saturating_add(u32::from(digit - b'0'));
                    self.at += 1;
                }
                if self.at - start > 9 {
                    return Err(Refusal::illegal(variable).at(at));
                }
                Ok(variable)
            }
            Some(b'[') => {
                let inside = self.bracket()?;
                let index = libm::round(self.counted(inside, at)?);
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
            Some(b'<') => Err(Fault::not_there_yet(at, "a named parameter #<...>")),
            _ => Err(self.format_error(
                "expected a number or [ behind #",
                "an indirect variable is written #[#1], not ##1",
            )),
        }
    }

    fn function(&mut self) -> Outcome<Operand> {
        let at = self.at;
        let end = self.text[at..]
            .iter()
            .position(|c| !c.is_ascii_alphabetic())
            .map_or(self.text.len(), |n| at + n);
        let name: Vec<u8> = self.text[at..end].to_ascii_uppercase();
        let Some(function) = FUNCTIONS.iter().find(|(full, _)| is_name(&name, full)).map(|(_, f)| *f) else {
            let name = String::from_utf8_lossy(&name).into_owned();
            let remedy = "functions are SIN COS TAN ASIN ACOS ATAN SQRT ABS LN EXP ROUND FIX FUP BIN BCD POW";
            return Err(self.format_error(&format!("{name} is no function"), remedy));
        };
        self.at = end;
        let argument = self.argument(at, function)?;
        let result = self.apply(function, argument, at)?;
        number(at, result)
    }

    /// One operand in brackets; two for `POW[a,b]`, `ATAN[a,b]` and `ATAN[a]/[b]`.
    fn argument(&mut self, at: usize, function: Function) -> Outcome<(f64, Option<f64>)> {
        let open = self.open_bracket()?;
        let first = self.comparison()?;
        let first = self.counted(first, at)?;
        if matches!(function, Function::Pow | Function::Atan) && self.peek() == Some(b',') {
            self.at += 1;
            let second = self.comparison()?;
            self.close_bracket(open)?;
            return Ok((first, Some(self.counted(second, at)?)));
        }
        self.close_bracket(open)?;
        if function == Function::Atan && self.peek() == Some(b'/') && self.peek_behind(b'/') == Some(b'[') {
            self.at = self.at_next() + 1;
            let second = self.bracket()?;
            return Ok((first, Some(self.counted(second, at)?)));
        }
        Ok((first, None))
    }

    fn apply(&self, function: Function, (a, b): (f64, Option<f64>), at: usize) -> Outcome<f64> {
        let illegal = |what: &str| {
            Fault::new(
                at,
                119,
                "macro-argument",
                format!("the argument of {what} is {a}"),
                "check the value before it is used",
            )
        };
        Ok(match function {
            Function::Sin => sin_degrees(a),
            Function::Cos => sin_degrees(90.0 - a),
            Function::Tan => {
                let cos = sin_degrees(90.0 - a);
                if cos.abs() < 1e-12 {
                    return Err(division_by_zero(at, "TAN of a right angle"));
                }
                sin_degrees(a) / cos
            }
            Function::Asin if a.abs() > 1.0 => return Err(illegal("ASIN")),
            Function::Asin => self.above_zero(libm::asin(a).to_degrees()),
            Function::Acos if a.abs() > 1.0 => return Err(illegal("ACOS")),
            Function::Acos => libm::acos(a).to_degrees(),
            Function::Atan => match b {
                Some(b) => self.above_zero(libm::atan2(a, b).to_degrees()),
                None => libm::atan(a).to_degrees(),
            },
            Function::Sqrt if a < 0.0 => return Err(illegal("SQRT")),
            Function::Sqrt => libm::sqrt(a),
            Function::Abs => a.abs(),
            Function::Ln if a <= 0.0 => return Err(illegal("LN")),
            Function::Ln => libm::log(a),
            Function::Exp => libm::exp(a),
            Function::Round => libm::round(a), // half away from zero
            Function::Fix if self.rules.floored => libm::floor(a),
            Function::Fix => libm::trunc(a),
            Function::Fup if self.rules.floored => libm::ceil(a),
            Function::Fup if a < 0.0 => libm::floor(a),
            Function::Fup => libm::ceil(a),
            Function::Bin => recode(a, 16, 10).ok_or_else(|| illegal("BIN"))?,
            Function::Bcd => recode(a, 10, 16).ok_or_else(|| illegal("BCD"))?,
            Function::Pow => match b {
                Some(b) => libm::pow(a, b),
                None => return Err(self.format_error("POW needs two operands", "write POW[base,exponent]")),
            },
        })
    }

    fn above_zero(&self, degrees: f64) -> f64 {
        if self.rules.angles_from_zero && degrees < 0.0 {
            degrees + 360.0
        } else {
            degrees
        }
    }

    fn modulo(&self, a: f64, b: f64, at: usize) -> Outcome<f64> {
        let (a, b) = if self.rules.floored {
            (a, b)
        } else {
            (libm::round(a), libm::round(b))
        };
        if b == 0.0 {
            return Err(division_by_zero(at, "MOD by 0"));
        }
        let rest = libm::fmod(a, b); // sign of the dividend
        let other_side = rest != 0.0 && (rest < 0.0) != (b < 0.0);
        Ok(if self.rules.floored && other_side { rest + b } else { rest })
    }

    /// AND, OR, XOR: bit by bit on two numbers, logical on two comparisons.
    fn bitwise(
        &self,
        at: usize,
        left: Operand,
        right: Operand,
        bits: fn(i32, i32) -> i32,
        truths: fn(bool, bool) -> bool,
    ) -> Outcome<Operand> {
        if let (Operand::Truth(a), Operand::Truth(b)) = (left, right) {
            return Ok(Operand::Truth(truths(a, b)));
        }
        let whole = |operand| -> Outcome<i32> {
            let n = libm::round(self.counted(operand, at)?);
            if n < f64::from(i32::MIN) || n > f64::from(i32::MAX) {
                return Err(overflow(at));
            }
            Ok(n as i32)
        };
        number(at, f64::from(bits(whole(left)?, whole(right)?)))
    }

    fn counted(&self, operand: Operand, at: usize) -> Outcome<f64> {
        match operand {
            Operand::Plain(value) => Ok(value.number()),
            Operand::Truth(_) => Err(truth_as_number(at)),
        }
    }

    /// Takes the word operator that stands here, whatever follows it: `#1EQ0`, `12AND 10`.
    fn operator<T: Copy>(&mut self, operators: &[(&str, T)]) -> Outcome<Option<T>> {
        self.peek();
        let here = &self.text[self.at..];
        let found = operators.iter().find(|(name, _)| {
            here.get(..name.len())
                .is_some_and(|t| t.eq_ignore_ascii_case(name.as_bytes()))
        });
        let Some((name, meaning)) = found else { return Ok(None) };
        if !self.rules.compares && *name != "MOD" {
            return Err(Fault::not_there_yet(self.at, &format!("{name} of this dialect")));
        }
        self.at += name.len();
        Ok(Some(*meaning))
    }

    fn sign<T>(&mut self, sign: u8, meaning: T) -> Option<T> {
        if self.peek() != Some(sign) {
            return None;
        }
        self.at += 1;
        Some(meaning)
    }

    /// The next byte that is no blank.
    fn peek(&mut self) -> Option<u8> {
        while let Some(b' ' | b'\t') = self.text.get(self.at) {
            self.at += 1;
        }
        self.text.get(self.at).copied()
    }

    fn at_next(&mut self) -> usize {
        self.peek();
        self.at
    }

    /// The byte that follows when the next one is `first`.
    fn peek_behind(&mut self, first: u8) -> Option<u8> {
        if self.peek() != Some(first) {
            return None;
        }
        self.text[self.at + 1..].iter().copied().find(|c| !matches!(c, b' ' | b'\t'))
    }

    fn format_error(&self, message: &str, remedy: &str) -> Box<Fault> {
        let found = match self.text.get(self.at) {
            Some(c) if c.is_ascii_graphic() => format!(", found {}", char::from(*c)),
            Some(_) => String::new(),
            None => ", found the end of the block".to_owned(),
        };
        Fault::new(self.at, 114, "macro-format", format!("{message}{found}"), remedy)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Sum {
    Add,
    Subtract,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Function {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sqrt,
    Abs,
    Ln,
    Exp,
    Round,
    Fix,
    Fup,
    Bin,
    Bcd,
    Pow,
}

const FUNCTIONS: [(&str, Function); 16] = [
    ("SIN", Function::Sin),
    ("COS", Function::Cos),
    ("TAN", Function::Tan),
    ("ASIN", Function::Asin),
    ("ACOS", Function::Acos),
    ("ATAN", Function::Atan),
    ("SQRT", Function::Sqrt),
    ("ABS", Function::Abs),
    ("LN", Function::Ln),
    ("EXP", Function::Exp),
    ("ROUND", Function::Round),
    ("FIX", Function::Fix),
    ("FUP", Function::Fup),
    ("BIN", Function::Bin),
    ("BCD", Function::Bcd),
    ("POW", Function::Pow),
];

type Comparison = fn(Value, Value) -> bool;

/// EQ and NE are the only operators that tell vacant from 0.
const COMPARISONS: [(&str, Comparison); 6] = [
    ("EQ", |a, b| a == b),
    ("NE", |a, b| a != b),
    ("GT", |a, b| a.number() > b.number()),
    ("GE", |a, b| a.number() >= b.number()),
    ("LT", |a, b| a.number() < b.number()),
    ("LE", |a, b| a.number() <= b.number()),
];

/// Names may be shortened to their first two letters, except POW.
fn is_name(written: &[u8], full: &str) -> bool {
    let full = full.as_bytes();
    written == full || (written.len() >= 2 && full != b"POW" && full.starts_with(written))
}

/// Keeps a result within what the controls can hold: 1e-29 to 1e47, and 0.
fn number(at: usize, result: f64) -> Outcome<Operand> {
    if result.is_nan() || result.abs() > 1e47 {
        return Err(overflow(at));
    }
    Ok(Operand::Plain(Value::Number(if result.abs() < 1e-29 { 0.0 } else { result })))
}

/// Sine of an angle in degrees, exact at multiples of 90: a program that moves by `COS[90]` must not move by 6e-17.
fn sin_degrees(angle: f64) -> f64 {
    let turn = libm::fmod(angle, 360.0);
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
    if !(0.0..=4_294_967_295.0).contains(&value) {
        return None;
    }
    let mut rest = libm::round(value) as u64;
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
    Some(result as f64)
}

fn overflow(at: usize) -> Box<Fault> {
    Fault::new(
        at,
        111,
        "macro-overflow",
        "the result is larger than 1E47 or not a number",
        "check the values before they are used",
    )
}

fn division_by_zero(at: usize, what: &str) -> Box<Fault> {
    Fault::new(
        at,
        112,
        "macro-division",
        what,
        "test the divisor first; a vacant variable counts as 0",
    )
}

fn truth_as_number(at: usize) -> Box<Fault> {
    Fault::new(
        at,
        114,
        "macro-format",
        "a comparison has no value that can be stored or counted with",
        "use it in IF[...] or WHILE[...]",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const FANUC: MacroRules = MacroRules {
        unset_is_zero: false,
        deepest_bracket: 5,
        angles_from_zero: true,
        floored: false,
        fanuc_ranges: true,
        compares: true,
    };
    const LINUXCNC: MacroRules = MacroRules {
        unset_is_zero: true,
        deepest_bracket: 30,
        angles_from_zero: false,
        floored: true,
        fanuc_ranges: false,
        compares: false,
    };

    struct Given(Memory);
    impl Variables for Given {
        fn read(&self, number: u32) -> Result<Value, Refusal> {
            if self.0.has(number) {
                Ok(self.0.read(number))
            } else {
                Err(Refusal::illegal(number))
            }
        }
    }

    fn evaluate(text: &str, rules: MacroRules, first: Value) -> String {
        let mut memory = Memory::new(rules);
        memory.write(1, first);
        memory.write(2, Value::Number(3.0));
        memory.write(103, Value::Number(7.0));
        memory.write(100, Value::Number(103.0));
        let given = Given(memory);
        let mut reader = Reader::new(text.as_bytes(), 0, rules, &given);
        match reader.comparison() {
            Ok(_) if reader.at_next() < text.len() => format!("stopped at {}", reader.at),
            Ok(Operand::Truth(t)) => t.to_string(),
            Ok(Operand::Plain(Value::Vacant)) => "vacant".to_owned(),
            Ok(Operand::Plain(Value::Number(n))) => {
                let rounded = libm::round(n * 1e9) / 1e9;
                (rounded + 0.0).to_string()
            }
            Err(fault) => format!("alarm {} at {}", fault.number, fault.at),
        }
    }

    #[track_caller]
    fn check(rules: MacroRules, first: Value, cases: &[(&str, &str)]) {
        for (text, expected) in cases {
            assert_eq!(evaluate(text, rules, first), *expected, "{text}");
        }
    }

    #[test]
    fn a_vacant_variable_is_neither_zero_nor_a_number() {
        check(
            FANUC,
            Value::Vacant,
            &[
                ("#1", "vacant"),
                ("-#1", "vacant"),
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
            FANUC,
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
            FANUC,
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
            FANUC,
            Value::Number(2.0),
            &[
                ("SIN[30]", "0.5"),
                ("COS[90]", "0"),
                ("cos[60.]", "0.5"),
                ("TAN[45]", "1"),
                ("TAN[90.]", "alarm 112 at 0"),
                ("TAN[-270]", "alarm 112 at 0"),
                ("ASIN[-0.5]", "330"),
                ("ASIN[1.1]", "alarm 119 at 0"),
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
                ("LN[0]", "alarm 119 at 0"),
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
            LINUXCNC,
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
            FANUC,
            Value::Number(2.0),
            &[
                ("[1+2", "alarm 114 at 4"),
                ("1+", "alarm 114 at 2"),
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

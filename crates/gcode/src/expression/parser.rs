//! Reading expressions: one function a rank.

use super::*;

/// Reads expressions out of a line.
pub(crate) struct Parser<'a> {
    pub text: &'a [u8],
    pub at: usize,
    brackets: u8,
    stack: usize,
    /// The operand read next is the whole value of a word.
    whole_word: bool,
    pub rules: &'a MacroRules,
    pub code: &'a mut Code,
}

impl<'a> Parser<'a> {
    pub(crate) fn new(text: &'a [u8], at: usize, rules: &'a MacroRules, code: &'a mut Code) -> Self {
        Parser {
            text,
            at,
            brackets: 0,
            stack: 0,
            whole_word: false,
            rules,
            code,
        }
    }

    fn part(&mut self, read: impl FnOnce(&mut Self) -> Outcome<Kind>) -> Outcome<(Expression, Kind)> {
        self.stack = 0;
        let first = self.code.ops.len() as u32;
        let kind = read(self)?;
        let end = self.code.ops.len() as u32;
        Ok((Expression { first, end }, kind))
    }

    /// An expression whose value is a number or vacant.
    pub(crate) fn value(&mut self) -> Outcome<Expression> {
        let start = self.at_next();
        match self.part(Self::comparison)? {
            (expression, Kind::Plain) => Ok(expression),
            (_, Kind::Truth) => Err(truth_as_number(start)),
        }
    }

    /// Any expression, with what it comes to.
    #[cfg(test)]
    pub(crate) fn any(&mut self) -> Outcome<(Expression, Kind)> {
        self.part(Self::comparison)
    }

    /// What a word carries: a signed variable `#1`, `-#1`, or `[expression]`.
    pub(crate) fn word_value(&mut self) -> Outcome<Expression> {
        let start = self.at;
        self.whole_word = true;
        match self.part(Self::operand)? {
            (expression, Kind::Plain) => Ok(expression),
            (_, Kind::Truth) => Err(truth_as_number(start)),
        }
    }

    /// `[comparison]`, as IF and WHILE want it.
    pub(crate) fn condition(&mut self) -> Outcome<Expression> {
        let start = self.at_next();
        match self.part(Self::bracket)? {
            (expression, Kind::Truth) => Ok(expression),
            (_, Kind::Plain) => Err(Fault::new(
                start,
                114,
                "macro-format",
                "a condition compares: EQ NE GT GE LT LE were expected",
                "write IF[#1 EQ 0]; = and < are not known here",
            )),
        }
    }

    /// `#12`, `#[expression]` or `[#NAME]`, to be written.
    pub(crate) fn target(&mut self) -> Outcome<Target> {
        if self.peek() == Some(b'[') {
            return self.name().map(Target::Named);
        }
        let at = self.at_next();
        self.at += 1;
        match self.peek() {
            Some(b'0'..=b'9') => {
                let variable = self.number_of_variable(at)?;
                Ok(match is_memory(variable, self.rules) {
                    true => Target::Memory(variable as u16),
                    false => Target::Variable(variable),
                })
            }
            Some(b'[') => {
                let (expression, kind) = self.part(Self::bracket)?;
                if kind == Kind::Truth {
                    return Err(truth_as_number(at));
                }
                Ok(Target::Indirect(expression))
            }
            _ => Err(self.not_a_variable()),
        }
    }

    /// Rank 4: at most one comparison.
    fn comparison(&mut self) -> Outcome<Kind> {
        let start = self.at_next();
        let left = self.sum()?;
        let at = self.at_next();
        let Some(compare) = self.operator(&COMPARISONS)? else {
            return Ok(left);
        };
        let right = self.sum()?;
        if left == Kind::Truth || right == Kind::Truth {
            return Err(truth_as_number(start));
        }
        self.two(compare, at);
        Ok(Kind::Truth)
    }

    /// Rank 3: + - OR XOR, from left to right.
    fn sum(&mut self) -> Outcome<Kind> {
        let mut left = self.product()?;
        loop {
            let at = self.at_next();
            left = if let Some(op) = self.sign(b'+', Binary::Add).or_else(|| self.sign(b'-', Binary::Subtract)) {
                let right = self.product()?;
                self.numbers(op, left, right, at)?
            } else if self.operator(&[("XOR", ())])?.is_some() {
                let right = self.product()?;
                self.logic(Binary::Xor, Binary::OneOf, left, right, at)?
            } else if self.operator(&[("OR", ())])?.is_some() {
                let right = self.product()?;
                self.logic(Binary::Or, Binary::Either, left, right, at)?
            } else {
                return Ok(left);
            };
        }
    }

    /// Rank 2: * / AND MOD, from left to right.
    fn product(&mut self) -> Outcome<Kind> {
        let mut left = self.operand()?;
        loop {
            let at = self.at_next();
            left = if let Some(op) = self.sign(b'*', Binary::Multiply).or_else(|| self.sign(b'/', Binary::Divide)) {
                let right = self.operand()?;
                self.numbers(op, left, right, at)?
            } else if self.operator(&[("AND", ())])?.is_some() {
                let right = self.operand()?;
                self.logic(Binary::And, Binary::Both, left, right, at)?
            } else if self.operator(&[("MOD", ())])?.is_some() {
                let right = self.operand()?;
                self.numbers(Binary::Modulo, left, right, at)?
            } else {
                return Ok(left);
            };
        }
    }

    /// Rank 1: a signed number, variable, bracket or function.
    fn operand(&mut self) -> Outcome<Kind> {
        let start = self.at_next();
        let whole_word = std::mem::take(&mut self.whole_word);
        let mut negative = false;
        let mut signed = false;
        while let Some(sign @ (b'+' | b'-')) = self.peek() {
            negative ^= sign == b'-';
            signed = true;
            self.at += 1;
        }
        let at = self.at_next();
        let kind = match self.peek() {
            Some(b'0'..=b'9' | b'.') => match number_at(self.text, self.at) {
                Some(n) => {
                    self.at = n.end;
                    let value = self.rules.digits.keep(n.value);
                    self.one(Op::Number(if negative { -value } else { value }), at)?;
                    return Ok(Kind::Plain);
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
                self.variable()?;
                Kind::Plain
            }
            Some(b'[') if self.names_a_variable() => {
                let name = self.name()?;
                self.one(Op::Named(name), at)?;
                Kind::Plain
            }
            Some(b'[') => self.bracket()?,
            Some(c) if c.is_ascii_alphabetic() => self.function()?,
            _ => {
                let mut fault = self.format_error("expected a number, #, [ or a function", "complete the expression");
                fault.number = 125;
                return Err(fault);
            }
        };
        if kind == Kind::Truth && signed {
            return Err(truth_as_number(start));
        }
        if negative {
            self.code.push(if whole_word { Op::NegateWord } else { Op::Negate }, at);
        }
        Ok(kind)
    }

    /// `[ expression ]`.
    fn bracket(&mut self) -> Outcome<Kind> {
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
        self.brackets += 1;
        if self.brackets > self.rules.deepest_bracket {
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
        self.brackets -= 1;
        Ok(())
    }

    /// `#12` or `#[expression]`, from its `#` on, to be read.
    fn variable(&mut self) -> Outcome<()> {
        let at = self.at_next();
        self.at += 1;
        match self.peek() {
            Some(b'0'..=b'9') => {
                let variable = self.number_of_variable(at)?;
                let op = match variable {
                    0 if !self.rules.unset_is_zero => Op::Vacant,
                    _ if is_memory(variable, self.rules) => Op::Memory(variable as u16),
                    _ => Op::Variable(variable),
                };
                self.one(op, at)
            }
            Some(b'[') => {
                if self.bracket()? == Kind::Truth {
                    return Err(truth_as_number(at));
                }
                self.code.push(Op::Indirect, at);
                Ok(())
            }
            _ => Err(self.not_a_variable()),
        }
    }

    fn not_a_variable(&self) -> Box<Fault> {
        match self.text.get(self.at) {
            Some(b'<') => Fault::not_there_yet(self.at, "a named parameter #<...>"),
            _ => self.format_error(
                "expected a number or [ behind #",
                "an indirect variable is written #[#1], not ##1",
            ),
        }
    }

    fn number_of_variable(&mut self, at: usize) -> Outcome<u32> {
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

    /// True at `[#` and a letter.
    fn names_a_variable(&self) -> bool {
        let mut behind = self.text[self.at + 1..].iter().filter(|c| !matches!(c, b' ' | b'\t'));
        behind.next() == Some(&b'#') && behind.next().is_some_and(|c| c.is_ascii_alphabetic() || *c == b'_')
    }

    /// `[#NAME]`.
    fn name(&mut self) -> Outcome<u16> {
        let at = self.at_next();
        let Some(length) = self.text[at..].iter().position(|c| *c == b']') else {
            return Err(self.format_error("expected ] behind the name", "close the bracket"));
        };
        let inside = &self.text[at + 1..at + length];
        let name: String = inside
            .iter()
            .filter(|c| !matches!(c, b'#' | b' ' | b'\t'))
            .map(|c| char::from(c.to_ascii_uppercase()))
            .collect();
        if !inside.contains(&b'#') || name.is_empty() {
            return Err(self.format_error("expected [#NAME]", "write the name that SETVN gave"));
        }
        self.at = at + length + 1;
        self.code.names.push(name);
        Ok((self.code.names.len() - 1) as u16)
    }

    fn function(&mut self) -> Outcome<Kind> {
        let at = self.at;
        let end = self.text[at..]
            .iter()
            .position(|c| !c.is_ascii_alphabetic())
            .map_or(self.text.len(), |n| at + n);
        let name = self.text[at..end].to_ascii_uppercase();
        if name == b"PRM" {
            self.at = end;
            return self.parameter(at);
        }
        let Some(function) = FUNCTIONS.iter().find(|(full, _)| is_name(&name, full)).map(|(_, f)| *f) else {
            let name = String::from_utf8_lossy(&name).into_owned();
            let remedy = "functions are SIN COS TAN ASIN ACOS ATAN SQRT ABS LN EXP ROUND FIX FUP BIN BCD POW ADP PRM";
            return Err(self.format_error(&format!("{name} is no function"), remedy));
        };
        self.at = end;
        let open = self.open_bracket()?;
        self.plain(at)?;
        let mut two = false;
        if matches!(function, Function::Pow | Function::Atan) && self.peek() == Some(b',') {
            self.at += 1;
            self.plain(at)?;
            two = true;
        }
        self.close_bracket(open)?;
        if function == Function::Atan && !two && self.peek() == Some(b'/') && self.peek_behind() == Some(b'[') {
            self.at = self.at_next() + 1;
            if self.bracket()? == Kind::Truth {
                return Err(truth_as_number(at));
            }
            two = true;
        }
        if function == Function::Pow && !two {
            return Err(self.format_error("POW needs two operands", "write POW[base,exponent]"));
        }
        match two {
            true => {
                self.code.push(Op::Function2(function), at);
                self.stack -= 1;
            }
            false => self.code.push(Op::Function(function), at),
        }
        Ok(Kind::Plain)
    }

    /// `PRM[n]`, `PRM[n,bit]`, each with `/[axis]`.
    fn parameter(&mut self, at: usize) -> Outcome<Kind> {
        let open = self.open_bracket()?;
        self.plain(at)?;
        let bit = self.peek() == Some(b',');
        if bit {
            self.at += 1;
            self.plain(at)?;
        }
        self.close_bracket(open)?;
        let axis = self.peek() == Some(b'/') && self.peek_behind() == Some(b'[');
        if axis {
            self.at = self.at_next() + 1;
            if self.bracket()? == Kind::Truth {
                return Err(truth_as_number(at));
            }
        }
        let (op, operands) = match (bit, axis) {
            (false, false) => (Op::Parameter, 1),
            (true, false) => (Op::ParameterBit, 2),
            (false, true) => (Op::ParameterAxis, 2),
            (true, true) => (Op::ParameterBitAxis, 3),
        };
        self.code.push(op, at);
        self.stack -= operands - 1;
        Ok(Kind::Plain)
    }

    /// An expression that is no truth.
    fn plain(&mut self, at: usize) -> Outcome<()> {
        match self.comparison()? {
            Kind::Plain => Ok(()),
            Kind::Truth => Err(truth_as_number(at)),
        }
    }

    fn one(&mut self, op: Op, at: usize) -> Outcome<()> {
        self.stack += 1;
        if self.stack > DEEPEST_STACK {
            return Err(Fault::new(
                at,
                118,
                "macro-brackets",
                "this expression holds too many values at once",
                "put a part of it into a variable first",
            ));
        }
        self.code.push(op, at);
        Ok(())
    }

    /// An operation on the two operands read last. One that ends in a number or a variable takes it along.
    fn two(&mut self, binary: Binary, at: usize) {
        let op = match self.code.ops.last() {
            Some(Op::Number(n)) => Op::WithNumber(binary, *n),
            Some(Op::Memory(n)) => Op::WithMemory(binary, *n),
            _ => Op::Two(binary),
        };
        if !matches!(op, Op::Two(_)) {
            self.code.pop();
        }
        self.code.push(op, at);
        self.stack -= 1;
    }

    fn numbers(&mut self, op: Binary, left: Kind, right: Kind, at: usize) -> Outcome<Kind> {
        if left == Kind::Truth || right == Kind::Truth {
            return Err(truth_as_number(at));
        }
        self.two(op, at);
        Ok(Kind::Plain)
    }

    /// AND, OR, XOR: bit by bit on two numbers, logical on two comparisons.
    fn logic(&mut self, bits: Binary, truths: Binary, left: Kind, right: Kind, at: usize) -> Outcome<Kind> {
        if left == Kind::Truth && right == Kind::Truth {
            self.two(truths, at);
            return Ok(Kind::Truth);
        }
        self.numbers(bits, left, right, at)
    }

    /// Takes the word operator that stands here, whatever follows it: `#1EQ0`, `12AND 10`.
    fn operator<T: Copy>(&mut self, operators: &[(&str, T)]) -> Outcome<Option<T>> {
        if !self.peek().is_some_and(|c| c.is_ascii_alphabetic()) {
            return Ok(None);
        }
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

    /// The next byte that is no blank and in no comment.
    pub(crate) fn peek(&mut self) -> Option<u8> {
        loop {
            match self.text.get(self.at) {
                Some(b' ' | b'\t' | b'\r') => self.at += 1,
                Some(b'(') => match self.text[self.at..].iter().position(|c| *c == b')') {
                    Some(length) => self.at += length + 1,
                    None => return Some(b'('),
                },
                other => return other.copied(),
            }
        }
    }

    pub(crate) fn at_next(&mut self) -> usize {
        self.peek();
        self.at
    }

    /// The byte that follows the next one.
    fn peek_behind(&mut self) -> Option<u8> {
        self.peek();
        self.text
            .get(self.at + 1..)?
            .iter()
            .copied()
            .find(|c| !matches!(c, b' ' | b'\t'))
    }

    pub(crate) fn format_error(&self, message: &str, remedy: &str) -> Box<Fault> {
        let found = match self.text.get(self.at) {
            Some(c) if c.is_ascii_graphic() => format!(", found {}", char::from(*c)),
            Some(_) => String::new(),
            None => ", found the end of the block".to_owned(),
        };
        Fault::new(self.at, 114, "macro-format", format!("{message}{found}"), remedy)
    }
}

/// EQ and NE are the only operators that tell vacant from 0.
const COMPARISONS: [(&str, Binary); 6] = [
    ("EQ", Binary::Equal),
    ("NE", Binary::NotEqual),
    ("GT", Binary::Greater),
    ("GE", Binary::GreaterOrEqual),
    ("LT", Binary::Less),
    ("LE", Binary::LessOrEqual),
];

/// Names may be shortened to their first two letters, except POW.
pub(crate) fn is_name(written: &[u8], full: &str) -> bool {
    let full = full.as_bytes();
    written == full || (written.len() >= 2 && full != b"POW" && full.starts_with(written))
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

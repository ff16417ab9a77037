//! Conditions as text: comparisons, `and`, `or`, `xor`, `not`, arithmetic, brackets of either kind, a unit where the quantity has one.
//!
//! The result is a [`plan::Expression`], the same that STEP-NC's typed conditions are read into. What the names mean is
//! [`crate::sensor`]'s; whether they fit together is found when a condition is compiled.

use crate::fault::{Fault, fault};
use crate::unit;
use plan::Expression;
use plan::expression::Operator;

/// Deepest nesting of brackets and `not`: who writes more has lost count himself.
const DEEPEST: u32 = 32;
/// Most operations in one condition.
const MOST_PARTS: u32 = 64;

/// Reads a condition. Columns in the fault are those of `text`.
pub(crate) fn parse(text: &str) -> Result<Expression, Box<Fault>> {
    let mut parser = Parser {
        characters: text.chars().collect(),
        at: 0,
        depth: 0,
        parts: 0,
    };
    let expression = parser.or()?;
    parser.blanks();
    match parser.peek() {
        None => Ok(expression),
        Some(_) => parser.expected("an operator or the end of the condition"),
    }
}

/// The condition as `parse` reads it back: small words, units as written, brackets where a reader would want them.
pub fn print(expression: &Expression) -> String {
    match expression {
        Expression::Number(number, None) => format!("{number}"),
        Expression::Number(number, Some(unit)) => format!("{number} {unit}"),
        Expression::Truth(truth) => format!("{truth}"),
        Expression::Name(name) => name.clone(),
        Expression::Not(inner) => format!("not {}", inside(inner)),
        Expression::Negate(inner) => format!("-{}", inside(inner)),
        Expression::Binary(operator, left, right) => {
            let word = match operator {
                Operator::And => "and",
                Operator::Or => "or",
                Operator::Xor => "xor",
                Operator::Equal => "=",
                Operator::NotEqual => "<>",
                Operator::Less => "<",
                Operator::LessOrEqual => "<=",
                Operator::Greater => ">",
                Operator::GreaterOrEqual => ">=",
                Operator::Add => "+",
                Operator::Subtract => "-",
                Operator::Multiply => "*",
                Operator::Divide => "/",
            };
            let side = |side: &Expression, right: bool| match side {
                Expression::Binary(inner, ..) if binds(*inner) > binds(*operator) => print(side),
                // Chains lean to the left, as they are read.
                Expression::Binary(inner, ..) if !right && inner == operator && binds(*inner) != COMPARISON => print(side),
                other => inside(other),
            };
            format!("{} {word} {}", side(left, false), side(right, true))
        }
    }
}

fn inside(expression: &Expression) -> String {
    match expression {
        Expression::Binary(..) | Expression::Negate(_) | Expression::Not(_) => format!("({})", print(expression)),
        plain => print(plain),
    }
}

const COMPARISON: u8 = 4;

/// How strongly an operator binds.
fn binds(operator: Operator) -> u8 {
    match operator {
        Operator::Or => 1,
        Operator::Xor => 2,
        Operator::And => 3,
        Operator::Add | Operator::Subtract => 5,
        Operator::Multiply | Operator::Divide => 6,
        _ => COMPARISON,
    }
}

struct Parser {
    characters: Vec<char>,
    at: usize,
    depth: u32,
    parts: u32,
}

type Read = Result<Expression, Box<Fault>>;

impl Parser {
    fn or(&mut self) -> Read {
        self.chain(&[("or", Operator::Or)], Self::xor)
    }
    fn xor(&mut self) -> Read {
        self.chain(&[("xor", Operator::Xor)], Self::and)
    }
    fn and(&mut self) -> Read {
        self.chain(&[("and", Operator::And)], Self::comparison)
    }
    fn sum(&mut self) -> Read {
        self.chain(&[("+", Operator::Add), ("-", Operator::Subtract)], Self::product)
    }
    fn product(&mut self) -> Read {
        self.chain(&[("*", Operator::Multiply), ("/", Operator::Divide)], Self::operand)
    }

    fn comparison(&mut self) -> Read {
        let left = self.sum()?;
        let Some(operator) = self.comparison_sign() else {
            return Ok(left);
        };
        let right = self.sum()?;
        let column = self.column();
        if self.comparison_sign().is_some() {
            return fault(
                "trace-condition",
                column,
                "one comparison follows another",
                "write a < b and b < c",
            );
        }
        self.binary(operator, left, right)
    }

    fn comparison_sign(&mut self) -> Option<Operator> {
        const SIGNS: [(&str, Operator); 8] = [
            (">=", Operator::GreaterOrEqual),
            ("<=", Operator::LessOrEqual),
            ("<>", Operator::NotEqual),
            ("!=", Operator::NotEqual),
            ("==", Operator::Equal),
            ("=", Operator::Equal),
            (">", Operator::Greater),
            ("<", Operator::Less),
        ];
        self.blanks();
        let (sign, operator) = SIGNS.into_iter().find(|(sign, _)| self.stands(sign))?;
        self.at += sign.len();
        Some(operator)
    }

    fn chain(&mut self, words: &[(&str, Operator)], next: fn(&mut Self) -> Read) -> Read {
        let mut left = next(self)?;
        loop {
            self.blanks();
            let Some((word, operator)) = words.iter().find(|(word, _)| self.stands(word)) else {
                return Ok(left);
            };
            self.at += word.len();
            let right = next(self)?;
            left = self.binary(*operator, left, right)?;
        }
    }

    fn binary(&mut self, operator: Operator, left: Expression, right: Expression) -> Read {
        self.parts += 1;
        if self.parts > MOST_PARTS {
            return fault(
                "trace-condition",
                self.column(),
                format!("the condition has more than {MOST_PARTS} operations"),
                "split it into several synchronized actions",
            );
        }
        Ok(Expression::Binary(operator, Box::new(left), Box::new(right)))
    }

    fn operand(&mut self) -> Read {
        self.blanks();
        self.depth += 1;
        if self.depth > DEEPEST {
            return fault(
                "trace-condition",
                self.column(),
                "the condition is nested too deep",
                "use fewer brackets",
            );
        }
        let read = match self.peek() {
            Some('-') => {
                self.at += 1;
                match self.operand()? {
                    Expression::Number(number, unit) => Ok(Expression::Number(-number, unit)),
                    other => Ok(Expression::Negate(Box::new(other))),
                }
            }
            Some(open @ ('(' | '[')) => {
                self.at += 1;
                let inner = self.or()?;
                self.blanks();
                let close = if open == '(' { ')' } else { ']' };
                if self.peek() == Some(close) {
                    self.at += 1;
                    Ok(inner)
                } else {
                    self.expected(&format!("an operator or '{close}'"))
                }
            }
            _ if self.stands("not") => {
                self.at += 3;
                // Not binds weaker than a comparison: `not a > b` is `not (a > b)`.
                Ok(Expression::Not(Box::new(self.comparison()?)))
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            Some('#') => self.variable_of_g_code(),
            _ => self.expected("a number, a sensor, a predefined value, 'not' or '('"),
        };
        self.depth -= 1;
        read
    }

    fn number(&mut self) -> Read {
        let start = self.at;
        while let Some(c) = self.peek() {
            let exponent = matches!(c, 'e' | 'E')
                && self
                    .characters
                    .get(self.at + 1)
                    .is_some_and(|n| n.is_ascii_digit() || *n == '-' || *n == '+')
                && self.characters[start..self.at]
                    .iter()
                    .all(|c| c.is_ascii_digit() || *c == '.');
            if exponent {
                self.at += 2;
            } else if c.is_ascii_digit() || c == '.' {
                self.at += 1;
            } else {
                break;
            }
        }
        let text: String = self.characters[start..self.at].iter().collect();
        let number = match text.parse::<f64>() {
            Ok(number) if number.is_finite() => number,
            _ => {
                return fault(
                    "trace-condition",
                    start as u32 + 1,
                    format!("'{text}' is no number"),
                    "write it with digits and one point",
                );
            }
        };
        let unit = self.unit();
        if unit.is_none() {
            self.no_other_word()?;
        }
        Ok(Expression::Number(number, unit))
    }

    /// Behind a number without unit stands an operator or nothing; another word was meant as its unit.
    fn no_other_word(&self) -> Result<(), Box<Fault>> {
        let behind = self.characters[self.at..].iter();
        let blanks = behind.clone().take_while(|c| c.is_whitespace()).count();
        let word: String = behind.skip(blanks).take_while(|c| c.is_alphanumeric()).collect();
        let operators = ["and", "or", "xor", "not"];
        if !word.starts_with(char::is_alphabetic) || operators.contains(&word.to_ascii_lowercase().as_str()) {
            return Ok(());
        }
        fault(
            "trace-condition",
            (self.at + blanks) as u32 + 1,
            format!("'{word}' is no unit that is known here"),
            "write mm, s, %, rpm, ... as in ws_time > 3600 s",
        )
    }

    /// The unit behind a number; nothing is taken when the word there is none.
    fn unit(&mut self) -> Option<String> {
        let before = self.at;
        self.blanks();
        let start = self.at;
        let of_unit = |c: char| c.is_alphanumeric() || matches!(c, '%' | '/' | '.');
        while self.peek().is_some_and(of_unit) {
            self.at += 1;
        }
        let longest = self.at;
        // The longest text that is a unit: in `10 mm/s` all of it, in `10 s/2` only the s.
        for end in (start + 1..=longest).rev() {
            let text: String = self.characters[start..end].iter().collect();
            let cut = self.characters.get(end).is_some_and(|c| c.is_alphanumeric() || *c == '_');
            if let Some(unit) = unit::find(&text)
                && !cut
            {
                self.at = end;
                return Some(unit.spelling.to_owned());
            }
        }
        self.at = before;
        None
    }

    fn name(&mut self) -> Read {
        let start = self.at;
        while self
            .peek()
            .is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | '.' | ':'))
        {
            self.at += 1;
        }
        // alarm[3] is the one name with an index.
        let word: String = self.characters[start..self.at].iter().collect();
        let small = word.to_ascii_lowercase();
        if small == "alarm" || small == "trace:alarm" {
            let close = self.characters[self.at..].iter().position(|c| *c == ']');
            let index = close.map(|n| self.characters[self.at..=self.at + n].iter().collect::<String>());
            let digits = index.as_deref().and_then(|i| i.strip_prefix('[')?.strip_suffix(']'));
            return match digits.and_then(|d| d.trim().parse::<u16>().ok()) {
                Some(id @ 1..=999) => {
                    self.at += close.unwrap_or(0) + 1;
                    Ok(Expression::Name(format!("{word}[{id}]")))
                }
                _ => self.expected("the number of an alarm, 1 to 999, as in alarm[3]"),
            };
        }
        Ok(match small.as_str() {
            "true" => Expression::Truth(true),
            "false" => Expression::Truth(false),
            "and" | "or" | "xor" => {
                self.at = start;
                return self.expected("an operand before the operator");
            }
            _ => Expression::Name(word),
        })
    }

    /// `#100`: its value changes with the blocks, and the machine that checks the condition in every cycle does not know it.
    fn variable_of_g_code(&self) -> Read {
        let rest = &self.characters[self.at + 1..];
        let length = match rest.first() {
            Some(c) if c.is_ascii_digit() => rest.iter().take_while(|c| c.is_ascii_digit()).count(),
            Some(open @ ('<' | '[')) => {
                let close = if *open == '<' { '>' } else { ']' };
                rest.iter().position(|c| *c == close).map_or(rest.len(), |at| at + 1)
            }
            _ => return self.expected("the number of a variable behind the #"),
        };
        let variable: String = rest[..length].iter().collect();
        fault(
            "T-06",
            self.column(),
            format!("#{variable} is a variable of the program, which the machine does not know in the cycle of the condition"),
            "write numbers, sensors as X.LOAD, aliases as coolant_pressure, ws_time, op_time, prog_time, mode, tool, feed_override, \
             path_deviation, and alarm[1] to alarm[999]; a STEP-NC program may name a variable, which has the value it has where the action is \
             started",
        )
    }

    /// True when the word or sign stands here; a word only as a whole.
    fn stands(&self, word: &str) -> bool {
        let end = self.at + word.len();
        let Some(here) = self.characters.get(self.at..end) else {
            return false;
        };
        let letters = word.starts_with(|c: char| c.is_ascii_alphabetic());
        let ends = !letters
            || !self
                .characters
                .get(end)
                .is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | '.' | ':'));
        ends && here.iter().zip(word.chars()).all(|(c, w)| c.to_ascii_lowercase() == w)
    }

    fn blanks(&mut self) {
        while self.peek().is_some_and(char::is_whitespace) {
            self.at += 1;
        }
    }
    fn peek(&self) -> Option<char> {
        self.characters.get(self.at).copied()
    }
    fn column(&self) -> u32 {
        self.at as u32 + 1
    }
    fn expected<T>(&self, what: &str) -> Result<T, Box<Fault>> {
        let found = match self.peek() {
            None => "the end".to_owned(),
            Some(c) => format!("'{c}'"),
        };
        fault(
            "trace-condition",
            self.column(),
            format!("expected {what}, found {found}"),
            "write a condition like ws_time > 3600 s and X.LOAD >= 80 %",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: &str) {
        let shown = match parse(text) {
            Ok(expression) => {
                let printed = print(&expression);
                assert_eq!(parse(&printed).as_ref(), Ok(&expression), "{printed}");
                expression.to_string()
            }
            Err(fault) => format!("{}: {}", fault.column, fault.message),
        };
        assert_eq!(shown, expected);
    }

    #[test]
    fn conditions_are_read_with_the_usual_strength_of_operators() {
        check(
            "ws_time > 3600 s and X.LOAD >= 80 %",
            "(ws_time > 3600 s) AND (X.LOAD >= 80 %)",
        );
        check("a > 1 or b > 2 and c > 3", "(a > 1) OR ((b > 2) AND (c > 3))");
        check(
            "not a > 1 and b = 2",
            "(NOT (a > 1)) AND (b = 2)".replace("(NOT (a > 1))", "NOT (a > 1)").as_str(),
        );
        check("a - 1 - 2 > 3*b", "((a - 1) - 2) > (3 * b)");
        check("[a > 1 mm] XOR (b < -2)", "(a > 1 mm) XOR (b < -2)");
        check("not(a>1)", "NOT (a > 1)");
        check("-(a+b) < 0", "-(a + b) < 0");
    }

    #[test]
    fn units_stand_behind_numbers_with_or_without_a_blank() {
        check("ws_time>20ms", "ws_time > 20 ms");
        check("feed > 10 mm/min", "feed > 10 mm/min");
        check("t > 10 s/2", "t > (10 s / 2)");
        check("X.LOAD >= 80%", "X.LOAD >= 80 %");
        check("WS_TIME > 1 H", "WS_TIME > 1 h");
        check("a > 1e3 and b > 2E-3 mm", "(a > 1000) AND (b > 0.002 mm)");
    }

    #[test]
    fn an_alarm_is_asked_by_its_number() {
        check("trace:alarm[3] or not alarm[12]", "trace:alarm[3] OR NOT alarm[12]");
        check(
            "alarm[0]",
            "6: expected the number of an alarm, 1 to 999, as in alarm[3], found '['",
        );
        check(
            "alarm",
            "6: expected the number of an alarm, 1 to 999, as in alarm[3], found the end",
        );
    }

    #[test]
    fn what_is_no_condition_is_told_with_its_column() {
        check(
            "",
            "1: expected a number, a sensor, a predefined value, 'not' or '(', found the end",
        );
        check(
            "a >",
            "4: expected a number, a sensor, a predefined value, 'not' or '(', found the end",
        );
        check("(a > 1", "7: expected an operator or ')', found the end");
        check("a > 1 b", "7: 'b' is no unit that is known here");
        check("a > 3 parsec", "7: 'parsec' is no unit that is known here");
        check(
            "a > 3 not b",
            "7: expected an operator or the end of the condition, found 'n'",
        );
        check("a < b < c", "7: one comparison follows another");
        check("1.2.3 > a", "1: '1.2.3' is no number");
        check(
            "#100 > 5",
            "1: #100 is a variable of the program, which the machine does not know in the cycle of the condition",
        );
        check(
            "X.LOAD > #[#1+2]",
            "10: #[#1+2] is a variable of the program, which the machine does not know in the cycle of the condition",
        );
        check(
            "#<limit> > 1",
            "1: #<limit> is a variable of the program, which the machine does not know in the cycle of the condition",
        );
        check("#", "1: expected the number of a variable behind the #, found '#'");
        check("and > 1", "1: expected an operand before the operator, found 'a'");
        check(&"(".repeat(100_000), "33: the condition is nested too deep");
        check(&"-".repeat(100_000), "33: the condition is nested too deep");
    }
}

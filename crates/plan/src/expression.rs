//! Boolean and number expressions that a program or a condition asks the machine to evaluate.
//!
//! STEP-NC conditions, loop tests and the conditions of synchronized actions are all this type; Custom Macro B has its own evaluator,
//! because its vacant value obeys other laws.

use thiserror::Error;

/// An expression tree.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// A number, with its unit as written when it has one.
    Number(f64, Option<String>),
    /// True or false.
    Truth(bool),
    /// The present value of a named thing: an NC variable, a sensor.
    Name(String),
    /// Logical negation.
    Not(Box<Expression>),
    /// Change of sign.
    Negate(Box<Expression>),
    /// Two operands.
    Binary(Operator, Box<Expression>, Box<Expression>),
}

/// Operators with two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `=`
    Equal,
    /// `<>`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterOrEqual,
    /// Both.
    And,
    /// At least one.
    Or,
    /// Just one.
    Xor,
}

impl std::fmt::Display for Operator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Operator::Add => "+",
            Operator::Subtract => "-",
            Operator::Multiply => "*",
            Operator::Divide => "/",
            Operator::Equal => "=",
            Operator::NotEqual => "<>",
            Operator::Less => "<",
            Operator::LessOrEqual => "<=",
            Operator::Greater => ">",
            Operator::GreaterOrEqual => ">=",
            Operator::And => "AND",
            Operator::Or => "OR",
            Operator::Xor => "XOR",
        })
    }
}

impl std::fmt::Display for Expression {
    /// The expression as a person writes it: operators between operands, what is inside in parentheses.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        struct Inside<'e>(&'e Expression);
        impl std::fmt::Display for Inside<'_> {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self.0 {
                    Expression::Binary(..) => write!(f, "({})", self.0),
                    plain => write!(f, "{plain}"),
                }
            }
        }
        match self {
            Expression::Number(number, None) => write!(f, "{number}"),
            Expression::Number(number, Some(unit)) => write!(f, "{number} {unit}"),
            Expression::Truth(true) => f.write_str("TRUE"),
            Expression::Truth(false) => f.write_str("FALSE"),
            Expression::Name(name) => f.write_str(name),
            Expression::Not(inner) => write!(f, "NOT {}", Inside(inner)),
            Expression::Negate(inner) => write!(f, "-{}", Inside(inner)),
            Expression::Binary(operator, left, right) => write!(f, "{} {operator} {}", Inside(left), Inside(right)),
        }
    }
}

/// What an expression evaluates to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// A number.
    Number(f64),
    /// True or false.
    Truth(bool),
}

/// Why an expression has no value.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ExpressionError {
    /// Nobody knows this name.
    #[error("nothing here is called '{0}': check the name, or whether this machine has that sensor")]
    Unknown(String),
    /// A number where a truth is due, or the reverse.
    #[error("{0} needs {1}")]
    Kind(&'static str, &'static str),
    /// Division by zero.
    #[error("division by zero")]
    DivisionByZero,
}

impl Expression {
    /// The expression's value; `lookup` gives the present value of a name.
    ///
    /// # Errors
    /// An unknown name, operands of the wrong kind, or a division by zero. `And` and `Or` do not look at the right side when the left
    /// one decides.
    pub fn evaluate(&self, lookup: &dyn Fn(&str) -> Option<Value>) -> Result<Value, ExpressionError> {
        Ok(match self {
            Expression::Number(n, _) => Value::Number(*n),
            Expression::Truth(t) => Value::Truth(*t),
            Expression::Name(name) => lookup(name).ok_or_else(|| ExpressionError::Unknown(name.clone()))?,
            Expression::Not(inner) => Value::Truth(!inner.evaluate(lookup)?.truth("NOT")?),
            Expression::Negate(inner) => Value::Number(-inner.evaluate(lookup)?.number("minus")?),
            Expression::Binary(Operator::And, l, r) => {
                Value::Truth(l.evaluate(lookup)?.truth("AND")? && r.evaluate(lookup)?.truth("AND")?)
            }
            Expression::Binary(Operator::Or, l, r) => {
                Value::Truth(l.evaluate(lookup)?.truth("OR")? || r.evaluate(lookup)?.truth("OR")?)
            }
            Expression::Binary(Operator::Xor, l, r) => {
                Value::Truth(l.evaluate(lookup)?.truth("XOR")? != r.evaluate(lookup)?.truth("XOR")?)
            }
            Expression::Binary(op, l, r) => {
                let (l, r) = (l.evaluate(lookup)?, r.evaluate(lookup)?);
                if let (Value::Truth(l), Value::Truth(r)) = (l, r) {
                    return match op {
                        Operator::Equal => Ok(Value::Truth(l == r)),
                        Operator::NotEqual => Ok(Value::Truth(l != r)),
                        _ => Err(ExpressionError::Kind("this operator", "numbers")),
                    };
                }
                let (l, r) = (l.number("this operator")?, r.number("this operator")?);
                match op {
                    Operator::Add => Value::Number(l + r),
                    Operator::Subtract => Value::Number(l - r),
                    Operator::Multiply => Value::Number(l * r),
                    Operator::Divide if r == 0.0 => return Err(ExpressionError::DivisionByZero),
                    Operator::Divide => Value::Number(l / r),
                    Operator::Equal => Value::Truth(l == r),
                    Operator::NotEqual => Value::Truth(l != r),
                    Operator::Less => Value::Truth(l < r),
                    Operator::LessOrEqual => Value::Truth(l <= r),
                    Operator::Greater => Value::Truth(l > r),
                    Operator::GreaterOrEqual => Value::Truth(l >= r),
                    Operator::And | Operator::Or | Operator::Xor => unreachable!("matched above"),
                }
            }
        })
    }
}

impl Value {
    fn number(self, what: &'static str) -> Result<f64, ExpressionError> {
        match self {
            Value::Number(n) => Ok(n),
            Value::Truth(_) => Err(ExpressionError::Kind(what, "a number")),
        }
    }
    fn truth(self, what: &'static str) -> Result<bool, ExpressionError> {
        match self {
            Value::Truth(t) => Ok(t),
            Value::Number(_) => Err(ExpressionError::Kind(what, "true or false")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_over_a_sensor_is_decided_by_its_present_value() {
        let over = Expression::Binary(
            Operator::GreaterOrEqual,
            Box::new(Expression::Name("X.LOAD".into())),
            Box::new(Expression::Number(80.0, Some("%".into()))),
        );
        let load = |percent: f64| move |name: &str| (name == "X.LOAD").then_some(Value::Number(percent));
        assert_eq!(over.evaluate(&load(81.0)), Ok(Value::Truth(true)));
        assert_eq!(over.evaluate(&load(79.0)), Ok(Value::Truth(false)));
        assert_eq!(over.evaluate(&|_| None), Err(ExpressionError::Unknown("X.LOAD".into())));
    }

    #[test]
    fn an_expression_reads_as_a_person_writes_it() {
        let name = |name: &str| Box::new(Expression::Name(name.into()));
        let hot = Expression::Binary(
            Operator::Greater,
            name("S1.TEMPERATURE"),
            Box::new(Expression::Number(60.5, None)),
        );
        let open = Expression::Not(name("DOOR"));
        let both = Expression::Binary(Operator::And, Box::new(hot), Box::new(open));
        assert_eq!(both.to_string(), "(S1.TEMPERATURE > 60.5) AND NOT DOOR");
    }
}

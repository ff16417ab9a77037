//! An expression as the AIM writes it: ISO 13584-20 entities behind an EXPRESSION_ITEM_REPRESENTATION_ITEM. [`crate::expression`] reads them.

use super::sheet::Sheet;
use part21::text::{encode, real};
use plan::Expression;
use plan::expression::Operator;

impl Sheet {
    /// The representation of a condition; the answer is its identifier.
    pub(super) fn condition(&mut self, condition: &Expression) -> u64 {
        let expression = self.expression(condition, true);
        let item = self.add(format!("EXPRESSION_ITEM_REPRESENTATION_ITEM('condition',#{expression})"));
        let no_units = self.no_units;
        self.add(format!("REPRESENTATION('',(#{item}),#{no_units})"))
    }

    /// `truth`: a truth stands here, so a name is that of a variable that is one.
    fn expression(&mut self, expression: &Expression, truth: bool) -> u64 {
        match expression {
            // Expressions of the AIM have no units; who reads them takes those of the other side.
            Expression::Number(number, _) => self.add(format!("REAL_LITERAL({})", real(*number))),
            Expression::Truth(truth) => self.add(format!("BOOLEAN_LITERAL(.{}.)", if *truth { 'T' } else { 'F' })),
            Expression::Name(name) => self.variable(name, truth),
            Expression::Not(inner) => {
                let inner = self.expression(inner, true);
                self.add(format!("NOT_EXPRESSION(#{inner})"))
            }
            Expression::Negate(inner) => {
                let inner = self.expression(inner, false);
                self.add(format!("MINUS_FUNCTION(#{inner})"))
            }
            Expression::Binary(operator, left, right) => {
                let (entity, of_truths) = match operator {
                    Operator::And => ("AND_EXPRESSION", true),
                    Operator::Or => ("OR_EXPRESSION", true),
                    Operator::Xor => ("XOR_EXPRESSION", true),
                    Operator::Add => ("PLUS_EXPRESSION", false),
                    Operator::Subtract => ("MINUS_EXPRESSION", false),
                    Operator::Multiply => ("MULT_EXPRESSION", false),
                    Operator::Divide => ("SLASH_EXPRESSION", false),
                    Operator::Equal => ("COMPARISON_EQUAL", false),
                    Operator::NotEqual => ("COMPARISON_NOT_EQUAL", false),
                    Operator::Less => ("COMPARISON_LESS", false),
                    Operator::LessOrEqual => ("COMPARISON_LESS_EQUAL", false),
                    Operator::Greater => ("COMPARISON_GREATER", false),
                    Operator::GreaterOrEqual => ("COMPARISON_GREATER_EQUAL", false),
                };
                let (left, right) = (self.expression(left, of_truths), self.expression(right, of_truths));
                self.add(format!("{entity}((#{left},#{right}))"))
            }
        }
    }

    /// A variable has no name of its own: the item around it has. One for each name.
    fn variable(&mut self, name: &str, truth: bool) -> u64 {
        let kind = if truth { "BOOLEAN_VARIABLE" } else { "REAL_NUMERIC_VARIABLE" };
        if let Some(&id) = self.variables.get(&(kind, name.to_owned())) {
            return id;
        }
        let id = self.add(format!("{kind}()"));
        self.add(format!("EXPRESSION_ITEM_REPRESENTATION_ITEM({},#{id})", encode(name)));
        self.variables.insert((kind, name.to_owned()), id);
        id
    }
}

//! Expressions of Custom Macro B, taken apart once: text becomes a short list of operations for a stack.
//!
//! One function a rank: comparison, sum, product, operand. What is a number and what is a truth is known when the text is read, so the
//! operations themselves work on plain numbers. Carrying them out is [`crate::evaluate`]'s part.

mod parser;

pub(crate) use parser::{Parser, is_name};

use crate::fault::{Fault, Outcome};
use crate::macro_b::{MacroRules, Refusal, is_memory};
use crate::text::number_at;

/// One operation on the stack. Vacant is a NaN there: no result of arithmetic is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Op {
    Number(f64),
    Vacant,
    /// A variable that is plain memory.
    Memory(u16),
    /// Any other variable.
    Variable(u32),
    /// The variable whose number is on the stack.
    Indirect,
    /// `[#NAME]`, by its place in [`Code::names`].
    Named(u16),
    Negate,
    /// The sign in front of a word's value: `X-#1` with #1 vacant is no word at all.
    NegateWord,
    /// On two operands of the stack.
    Two(Binary),
    /// The right operand is a number.
    WithNumber(Binary, f64),
    /// The right operand is a variable that is plain memory.
    WithMemory(Binary, u16),
    Function(Function),
    /// A function of two operands.
    Function2(Function),
    /// PRM[n].
    Parameter,
    /// PRM[n,bit].
    ParameterBit,
    /// PRM[n]/[axis].
    ParameterAxis,
    /// PRM[n,bit]/[axis].
    ParameterBitAxis,
}

/// What stands between two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Modulo,
    And,
    Or,
    Xor,
    Equal,
    NotEqual,
    Greater,
    GreaterOrEqual,
    Less,
    LessOrEqual,
    /// On truths.
    Both,
    Either,
    OneOf,
}

/// Functions of one or two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Function {
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
    AddPoint,
}

const FUNCTIONS: [(&str, Function); 17] = [
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
    ("ADP", Function::AddPoint),
];

/// Deepest stack an expression may need; brackets limit it on every control.
pub(crate) const DEEPEST_STACK: usize = 64;

/// The operations of all expressions of a line.
#[derive(Clone, Debug, Default)]
pub(crate) struct Code {
    ops: Vec<Op>,
    /// The byte of the line that each operation is about.
    places: Vec<u32>,
    /// Names of variables.
    pub names: Vec<String>,
}

/// A part of a [`Code`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Expression {
    first: u32,
    end: u32,
}

impl Code {
    pub(crate) fn clear(&mut self) {
        self.ops.clear();
        self.places.clear();
        self.names.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.ops.is_empty()
    }

    /// All operations of the line.
    pub(crate) fn ops(&self) -> &[Op] {
        &self.ops
    }

    /// The operations of an expression, and their places.
    pub(crate) fn of(&self, expression: Expression) -> (&[Op], &[u32]) {
        let range = expression.first as usize..expression.end as usize;
        (&self.ops[range.clone()], &self.places[range])
    }

    fn push(&mut self, op: Op, at: usize) {
        self.ops.push(op);
        self.places.push(at as u32);
    }

    fn pop(&mut self) {
        self.ops.pop();
        self.places.pop();
    }
}

/// What an expression comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A number or vacant.
    Plain,
    /// Of a comparison; cannot be stored or counted with.
    Truth,
}

/// What stands on the left of `=`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    Memory(u16),
    Variable(u32),
    /// `#[expression]`.
    Indirect(Expression),
    /// `[#NAME]`.
    Named(u16),
}

//! Conditions and assignments as [`plan::Expression`]s.
//!
//! The AIM stores an expression as a tree of ISO 13584-20 entities, either behind an EXPRESSION_ITEM_REPRESENTATION_ITEM or, in older
//! files, in a complex instance that is item and expression at once. What is not understood is an error text, not a guess.

use crate::aim::{Aim, Links};
use part21::{Instance, Value};
use plan::Expression;
use plan::expression::Operator;

const DEEPEST: u32 = 64;

/// The expression that a property holds.
pub(crate) fn of_property(aim: Aim, links: &Links, property: &str) -> Result<Expression, String> {
    let item = item(aim, links, property)?;
    read(aim, item, 0)
}

/// The name of the variable that a property holds.
pub(crate) fn variable_name(aim: Aim, links: &Links, property: &str) -> Option<String> {
    match read(aim, item(aim, links, property).ok()?, 0).ok()? {
        Expression::Name(name) => Some(name),
        _ => None,
    }
}

fn item(aim: Aim, links: &Links, property: &str) -> Result<u64, String> {
    let representation = links.property(property).ok_or_else(|| format!("it has no {property}"))?;
    let representation = aim.representation(representation).map_err(|fault| fault.message)?;
    representation
        .items
        .first()
        .copied()
        .ok_or_else(|| format!("its {property} is empty"))
}

fn read(aim: Aim, id: u64, depth: u32) -> Result<Expression, String> {
    if depth > DEEPEST {
        return Err("an expression is nested too deep, or contains itself".into());
    }
    let instance = aim.instance(id).map_err(|fault| fault.message)?;
    let is = |name: &str| aim.is(id, name);
    if is("EXPRESSION_ITEM_REPRESENTATION_ITEM") {
        let inner = arguments(&instance, "EXPRESSION_ITEM_REPRESENTATION_ITEM")
            .iter()
            .find_map(Value::reference);
        let inner = inner.ok_or_else(|| format!("#{id} wraps no expression"))?;
        // A variable has no name of its own: the item around it has.
        if is_variable(aim, inner) {
            return name(aim, inner, Some(id));
        }
        return read(aim, inner, depth + 1);
    }
    if is_variable(aim, id) {
        return name(aim, id, None);
    }
    let operands = || -> Result<Vec<Expression>, String> {
        let mut ids: Vec<u64> = Vec::new();
        for record in instance.records() {
            for argument in &record.arguments {
                ids.extend(argument.reference());
                ids.extend(argument.references());
            }
        }
        ids.into_iter().map(|id| read(aim, id, depth + 1)).collect()
    };
    let value = |name: &str| arguments(&instance, name).iter().rev().find_map(|v| v.number());
    for literal in [
        "REAL_LITERAL",
        "INT_LITERAL",
        "REAL_REPRESENTATION_ITEM",
        "INTEGER_REPRESENTATION_ITEM",
        "LITERAL_NUMBER",
    ] {
        if is(literal) {
            let number = instance
                .records()
                .iter()
                .flat_map(|record| &record.arguments)
                .find_map(Value::number);
            return number
                .or_else(|| value(literal))
                .map(|number| Expression::Number(number, None))
                .ok_or_else(|| format!("#{id} holds no number"));
        }
    }
    if is("BOOLEAN_LITERAL") || is("BOOLEAN_REPRESENTATION_ITEM") {
        let truth = instance
            .records()
            .iter()
            .flat_map(|record| &record.arguments)
            .find_map(Value::boolean);
        return truth
            .map(Expression::Truth)
            .ok_or_else(|| format!("#{id} is neither .T. nor .F."));
    }
    const CHAINS: [(&str, Operator); 14] = [
        ("AND_EXPRESSION", Operator::And),
        ("OR_EXPRESSION", Operator::Or),
        ("XOR_EXPRESSION", Operator::Xor),
        ("PLUS_EXPRESSION", Operator::Add),
        ("MULT_EXPRESSION", Operator::Multiply),
        ("MINUS_EXPRESSION", Operator::Subtract),
        ("SLASH_EXPRESSION", Operator::Divide),
        ("COMPARISON_EQUAL", Operator::Equal),
        ("EQUALS_EXPRESSION", Operator::Equal),
        ("COMPARISON_NOT_EQUAL", Operator::NotEqual),
        ("COMPARISON_LESS", Operator::Less),
        ("COMPARISON_LESS_EQUAL", Operator::LessOrEqual),
        ("COMPARISON_GREATER", Operator::Greater),
        ("COMPARISON_GREATER_EQUAL", Operator::GreaterOrEqual),
    ];
    for (keyword, operator) in CHAINS {
        if is(keyword) {
            let mut operands = operands()?.into_iter();
            let first = operands.next().ok_or_else(|| format!("{keyword} #{id} has no operands"))?;
            return Ok(operands.fold(first, |left, right| {
                Expression::Binary(operator, Box::new(left), Box::new(right))
            }));
        }
    }
    if is("NOT_EXPRESSION") || is("UNARY_MINUS_EXPRESSION") || is("MINUS_FUNCTION") {
        let inner = operands()?
            .into_iter()
            .next()
            .ok_or_else(|| format!("#{id} has no operand"))?;
        return Ok(if is("NOT_EXPRESSION") {
            Expression::Not(Box::new(inner))
        } else {
            Expression::Negate(Box::new(inner))
        });
    }
    Err(format!("{} #{id} is no expression that is understood", aim.keyword(id)))
}

fn is_variable(aim: Aim, id: u64) -> bool {
    let keyword = aim.keyword(id);
    keyword.split(' ').any(|part| part.ends_with("_VARIABLE"))
}

/// The name of a variable: of the item around it, of itself when it is an item, or of the item that wraps it elsewhere.
fn name(aim: Aim, id: u64, around: Option<u64>) -> Result<Expression, String> {
    let of_item = |item: u64| Some(aim.item_name(item)).filter(|name| !name.is_empty());
    let wrapped = || {
        let mut wraps = aim.users_by(id, "EXPRESSION_ITEM_REPRESENTATION_ITEM", 1);
        wraps.find_map(|(item, _)| of_item(item))
    };
    let own = || {
        if aim.is(id, "REPRESENTATION_ITEM") {
            of_item(id)
        } else {
            None
        }
    };
    let name = around.and_then(of_item).or_else(own).or_else(wrapped);
    name.map(Expression::Name)
        .ok_or_else(|| format!("variable #{id} has no name"))
}

/// The arguments of a part, or of the simple instance.
fn arguments<'i>(instance: &'i Instance<'_>, part: &str) -> &'i [Value<'i>] {
    instance.part(part).unwrap_or(&[])
}

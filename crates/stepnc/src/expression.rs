//! Conditions and assignments as [`plan::Expression`]s.
//!
//! The AIM stores an expression as a tree of ISO 13584-20 entities, either behind an EXPRESSION_ITEM_REPRESENTATION_ITEM or, in older
//! files, in a complex instance that is item and expression at once. What is not understood is an error text, not a guess.

use crate::aim::{Aim, Links};
use part21::{Instance, Value};
use plan::Expression;
use plan::expression::Operator;
use std::cell::Cell;
use std::collections::BTreeMap;

const DEEPEST: u32 = 64;

/// Parts of one expression, at most: shared operands can make few instances a tree without end, and a long chain is as deep
/// as it is long.
const MOST_PARTS: u32 = 1_000;

/// The expression that a property holds.
pub(crate) fn of_property(aim: Aim, links: &Links, property: &str) -> Result<Expression, String> {
    let item = item(aim, links, property)?;
    read(aim, item, 0, &Cell::new(0))
}

/// The name of the variable that a property holds.
pub(crate) fn variable_name(aim: Aim, links: &Links, property: &str) -> Option<String> {
    match read(aim, item(aim, links, property).ok()?, 0, &Cell::new(0)).ok()? {
        Expression::Name(name) => Some(name),
        _ => None,
    }
}

/// The expression that an attribute is or refers to (ISO 14649).
pub(crate) fn of_value(aim: Aim, value: Option<&Value>) -> Result<Expression, String> {
    match value {
        Some(Value::Reference(id)) => read(aim, *id, 0, &Cell::new(0)),
        Some(value) => operand(value).ok_or_else(|| "it is missing".to_string()),
        None => Err("it is missing".into()),
    }
}

/// The values that variables of the AIM have before the program: `initial value` between a variable's item and a literal's.
pub(crate) fn initial_values(aim: Aim) -> BTreeMap<String, f64> {
    let mut values = BTreeMap::new();
    for row in aim.file.by_keyword("REPRESENTATION_ITEM_RELATIONSHIP") {
        let Ok(relation) = aim.parsed(row) else { continue };
        if !(0..2).any(|n| relation.argument(n).text() == Some("initial value")) {
            continue;
        }
        let (Some(variable), Some(value)) = (relation.argument(2).reference(), relation.argument(3).reference()) else {
            continue;
        };
        if let (Ok(Expression::Name(name)), Ok(Expression::Number(number, _))) =
            (read(aim, variable, 0, &Cell::new(0)), read(aim, value, 0, &Cell::new(0)))
        {
            values.insert(name, number);
        }
    }
    values
}

/// A literal that stands where an expression is due.
fn operand(value: &Value) -> Option<Expression> {
    match value.boolean() {
        Some(truth) => Some(Expression::Truth(truth)),
        None => value.number().map(|number| Expression::Number(number, None)),
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

fn read(aim: Aim, id: u64, depth: u32, parts: &Cell<u32>) -> Result<Expression, String> {
    parts.set(parts.get() + 1);
    if depth > DEEPEST || parts.get() > MOST_PARTS {
        return Err("an expression is nested too deep, has too many parts, or contains itself".into());
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
        return read(aim, inner, depth + 1, parts);
    }
    if is_variable(aim, id) {
        return name(aim, id, None);
    }
    let operands = || -> Result<Vec<Expression>, String> {
        let mut found = Vec::new();
        for argument in instance.records().iter().flat_map(|record| &record.arguments) {
            for id in argument.reference().into_iter().chain(argument.references()) {
                found.push(read(aim, id, depth + 1, parts)?);
            }
            found.extend(operand(argument));
        }
        Ok(found)
    };
    // ISO 14649: a constant has a name and a value, a variable a name and perhaps a value before the program.
    if is("NC_CONSTANT") {
        let value = arguments(&instance, "NC_CONSTANT").iter().find_map(Value::number);
        return value
            .map(|number| Expression::Number(number, None))
            .ok_or_else(|| format!("constant #{id} has no value"));
    }
    if is("NC_VARIABLE") {
        let name = arguments(&instance, "NC_VARIABLE")
            .first()
            .and_then(Value::text)
            .unwrap_or_default();
        return match name {
            "" => Err(format!("variable #{id} has no name")),
            name => Ok(Expression::Name(name.to_string())),
        };
    }
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
    keyword != "NC_VARIABLE" && keyword.split(' ').any(|part| part.ends_with("_VARIABLE"))
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

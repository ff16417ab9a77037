//! The lines of the vocabulary in what a program has: the text of an extended function, a comment, or what stands along a path.

use crate::condition::print;
use crate::sensor::{Meaning, meaning, streams};
use crate::{Function, is_line, parse, typed};
use plan::{Diagnostic, Expression, RawNcFunction};

/// The kind of a function along a path.
pub const ALONG: &str = "other functions";

/// Name of a condition along a path that names sensors to record; what stands under it are aliases with axes, as `drive-load-x`.
pub const ALONG_RECORD: &str = "trace.record";
/// Name of the one that says when: `every 4 cycles`, or what `its_sampling` takes.
pub const ALONG_SAMPLING: &str = "trace.sampling";

/// The functions of the vocabulary in one that the program has: its line, or the lines along a path.
///
/// The condition of a line may stand beside it as a typed expression (STEP-NC). Variables of the program have their present values in it: a
/// condition is made when it is started, and what the program assigns later changes it no more.
pub fn functions(raw: &RawNcFunction) -> Vec<Result<Function, Box<Diagnostic>>> {
    if raw.kind == ALONG {
        return along(raw).iter().map(|line| parse(line)).collect();
    }
    if is_line(&raw.text) {
        vec![with_condition(raw)]
    } else {
        vec![]
    }
}

/// The lines of the vocabulary in it as they are written.
pub(crate) fn lines_of(raw: &RawNcFunction) -> Vec<&str> {
    if raw.kind == ALONG {
        plan::line::along(&raw.properties)
    } else if is_line(&raw.text) {
        vec![&raw.text]
    } else {
        vec![]
    }
}

fn with_condition(raw: &RawNcFunction) -> Result<Function, Box<Diagnostic>> {
    let mut function = parse(&raw.text)?;
    if let Some(typed) = &raw.condition {
        function = typed::joined(function, typed)?;
    }
    let value = |name: &str| -> Option<f64> {
        let value = raw.properties.get(&format!("{}{name}", RawNcFunction::VARIABLE))?;
        // A variable of G-code changes while the action runs: it may not stand in a condition, whatever it holds now.
        let is_constant = meaning(name) == Meaning::Unknown && !name.starts_with('#');
        is_constant.then(|| value.parse().ok())?
    };
    if raw.properties.keys().any(|name| name.starts_with(RawNcFunction::VARIABLE)) {
        function = function.with_changed_condition(|condition| {
            put_in(condition, &value);
            *condition = typed::folded(condition);
        });
    }
    writable(function)
}

/// So much of a condition is shown where it is too long for a line.
const SHOWN: usize = 120;

/// A function is told, loaded and found again by its line: what no line can say is refused.
fn writable(function: Function) -> Result<Function, Box<Diagnostic>> {
    let Some(condition) = function.condition() else {
        return Ok(function);
    };
    match parse(&function.to_string()) {
        Ok(again) if again == function => Ok(function),
        _ => {
            let mut said = print(condition);
            if let Some((end, _)) = said.char_indices().nth(SHOWN) {
                said.truncate(end);
                said.push_str(" ...");
            }
            let text = format!("the condition \"{said}\" cannot be written in a line");
            Err(Box::new(Diagnostic::error("T-06", text).remedy(
                "name its variables with letters, digits and _, write finite numbers and no more than 64 operations",
            )))
        }
    }
}

/// What stands along a path: its lines, and the recording that the short form of [`ALONG_RECORD`] means.
fn along(raw: &RawNcFunction) -> Vec<String> {
    let mut found: Vec<String> = plan::line::along(&raw.properties).into_iter().map(str::to_owned).collect();
    if let Some(sensors) = raw.properties.get(ALONG_RECORD) {
        let sensors: Vec<String> = sensors.split(',').map(along_sensor).collect();
        let sampling = raw.properties.get(ALONG_SAMPLING).map_or_else(String::new, |said| {
            let words: Vec<&str> = said.split_whitespace().collect();
            match words[..] {
                ["every", n, "cycles" | "cycle"] => format!(" its_sampling={n}"),
                _ => format!(" its_sampling={}", said.replace(' ', "")),
            }
        });
        found.push(format!(
            "{} start_sensor_recording its_function_id=path its_sensors={}{sampling}",
            crate::PREFIX,
            sensors.join(",")
        ));
    }
    found
}

/// Puts values in the place of names.
fn put_in(expression: &mut Expression, value: &dyn Fn(&str) -> Option<f64>) {
    match expression {
        Expression::Name(name) => {
            if let Some(number) = value(name) {
                *expression = Expression::Number(number, None);
            }
        }
        Expression::Not(inner) | Expression::Negate(inner) => put_in(inner, value),
        Expression::Binary(_, left, right) => {
            put_in(left, value);
            put_in(right, value);
        }
        Expression::Number(..) | Expression::Truth(_) => {}
    }
}

/// `drive-load-x` is the drive load of X; anything else is a name as it stands.
fn along_sensor(written: &str) -> String {
    let written = written.trim();
    let name = written.replace('-', "_");
    if let Some((alias, axis)) = name.rsplit_once('_')
        && axis.len() <= 2
        && let Ok(found) = streams(alias, &[axis.to_ascii_uppercase()])
        && let Some(sensor) = found.first()
    {
        return sensor.to_string();
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::expression::Operator;
    use std::collections::BTreeMap;

    fn over(limit: Expression) -> Expression {
        let time = Expression::Name("trace:ws_time".into());
        Expression::Binary(Operator::Greater, Box::new(time), Box::new(limit))
    }

    fn read(condition: &str, typed: Option<Expression>, variables: &[(&str, &str)]) -> Result<String, String> {
        let given = if condition.is_empty() {
            String::new()
        } else {
            format!(" its_condition=\"{condition}\"")
        };
        let raw = RawNcFunction {
            kind: RawNcFunction::EXTENDED.to_owned(),
            name: String::new(),
            text: format!(
                "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN{given} its_actions=get_time"
            ),
            condition: typed.map(Ok),
            properties: variables
                .iter()
                .map(|(name, value)| (format!("{}{name}", RawNcFunction::VARIABLE), (*value).to_owned()))
                .collect::<BTreeMap<_, _>>(),
        };
        match functions(&raw).pop().expect("one") {
            Ok(function) => Ok(print(function.condition().expect("a condition"))),
            Err(found) => Err(format!("{} {}", found.code, found.message)),
        }
    }

    #[test]
    fn variables_have_their_values_in_both_kinds_of_condition() {
        let limit = || Expression::Name("TIME LIMIT".into());
        let values: &[(&str, &str)] = &[("TIME LIMIT", "5"), ("LIMIT", "-3")];
        assert_eq!(read("", Some(over(limit())), values), Ok("trace:ws_time > 5".into()));
        assert_eq!(read("ws_time > -LIMIT", None, values), Ok("ws_time > 3".into()));
        // They are held against each other by their names: two variables may have one value by chance.
        assert_eq!(
            read("ws_time > LIMIT", Some(over(Expression::Name("LIMIT".into()))), values),
            Ok("ws_time > -3".into())
        );
        assert_eq!(
            read("ws_time > -3", Some(over(Expression::Name("LIMIT".into()))), values),
            Err("T-06 the line of start_synchronized_action says the condition \"ws_time > -3\", and the file's typed condition says \"trace:ws_time > LIMIT\"".into())
        );
    }

    #[test]
    fn a_line_along_a_path_may_have_blanks_of_any_script_before_it() {
        for blank in ["", " ", "\u{a0}", "\u{3000}"] {
            let line = format!("{blank}trace:1 get_time");
            let raw = RawNcFunction {
                kind: ALONG.to_owned(),
                name: String::new(),
                text: String::new(),
                condition: None,
                properties: BTreeMap::from([("note".to_owned(), format!("{line},{line}"))]),
            };
            let read = functions(&raw).into_iter().map(|function| function.map(|f| f.to_string()));
            let expected = [Ok("trace:1 get_time".to_owned()), Ok("trace:1 get_time".to_owned())];
            assert_eq!(read.collect::<Vec<_>>(), expected, "{blank:?}");
        }
    }

    #[test]
    fn a_condition_that_no_line_can_say_is_t_06() {
        for odd in [
            Expression::Name("TIME LIMIT".into()),
            Expression::Name("true".into()),
            Expression::Name(String::new()),
            Expression::Number(f64::INFINITY, None),
        ] {
            let refused = read("", Some(over(odd)), &[]).expect_err("no line says that");
            assert!(refused.starts_with("T-06 the condition"), "{refused}");
        }
    }
}

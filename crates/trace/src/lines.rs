//! The lines of the vocabulary in what a program has: the text of an extended function, a comment, or what stands along a path.

use crate::sensor::{Meaning, meaning, streams};
use crate::{is_line, parse};
use plan::{Expression, RawNcFunction};

/// The kind of a function along a path.
pub const ALONG: &str = "other functions";

/// Name of a condition along a path that names sensors to record; what stands under it are aliases with axes, as `drive-load-x`.
pub const ALONG_RECORD: &str = "trace.record";
/// Name of the one that says when: `every 4 cycles`, or what `its_sampling` takes.
pub const ALONG_SAMPLING: &str = "trace.sampling";

/// The lines of the vocabulary in a function as the program has it: its text, or what stands along a path.
///
/// Along a path a line is the name of a condition, or its mode; several of one name come joined by commas. The short form of
/// [`ALONG_RECORD`] becomes the recording that it means.
pub fn lines(raw: &RawNcFunction) -> Vec<String> {
    if raw.kind != ALONG {
        return if is_line(&raw.text) {
            vec![with_variables(raw)]
        } else {
            vec![]
        };
    }
    let mut found = Vec::new();
    for (name, mode) in &raw.properties {
        if is_line(name) {
            found.push(name.clone());
        } else if is_line(mode) {
            let mut rest = mode.as_str();
            while let Some(at) = rest[1..].find(",trace:") {
                found.push(rest[..=at].to_owned());
                rest = &rest[at + 2..];
            }
            found.push(rest.to_owned());
        }
    }
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

/// The line with the present values of the program's variables in its condition: a condition is made when it is started, and what the
/// program assigns later changes it no more.
fn with_variables(raw: &RawNcFunction) -> String {
    let value = |name: &str| -> Option<f64> {
        let value = raw.properties.get(&format!("{}{name}", RawNcFunction::VARIABLE))?;
        (meaning(name) == Meaning::Unknown).then(|| value.parse().ok())?
    };
    if !raw.properties.keys().any(|name| name.starts_with(RawNcFunction::VARIABLE)) {
        return raw.text.clone();
    }
    let Ok(mut function) = parse(&raw.text) else {
        return raw.text.clone();
    };
    let mut changed = false;
    for argument in &mut function.arguments {
        if let crate::Value::Condition(condition) = &mut argument.value {
            changed |= put_in(condition, &value);
        }
    }
    if changed { function.to_string() } else { raw.text.clone() }
}

/// Puts values in the place of names; true when there was one.
fn put_in(expression: &mut Expression, value: &dyn Fn(&str) -> Option<f64>) -> bool {
    match expression {
        Expression::Name(name) => match value(name) {
            Some(number) => {
                *expression = Expression::Number(number, None);
                true
            }
            None => false,
        },
        Expression::Not(inner) | Expression::Negate(inner) => put_in(inner, value),
        Expression::Binary(_, left, right) => put_in(left, value) | put_in(right, value),
        Expression::Number(..) | Expression::Truth(_) => false,
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

//! Which variables of the program a function's line writes. From there on only the machine knows them, so a reader that goes ahead asks.

use std::str::Chars;

/// A variable that a function writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// As the line spells it: `#100`, `LIMIT`.
    pub name: String,
    /// It is written each time an action is done, and not once.
    pub again: bool,
}

/// The variables that a line of the vocabulary writes (`its_variable`), in order.
pub fn written(line: &str) -> Vec<Written> {
    if is_action(line) {
        let actions = values_of("actions", line);
        let names = actions.iter().flat_map(|action| values_of("variable", action));
        return names.map(|name| Written { name, again: true }).collect();
    }
    let names = values_of("variable", line).into_iter();
    names.map(|name| Written { name, again: false }).collect()
}

/// True for a line that starts a synchronized action: what stands in it is done later.
pub fn is_action(line: &str) -> bool {
    const NAME: &str = "start_synchronized_action";
    line.split_whitespace()
        .nth(1)
        .is_some_and(|name| name.eq_ignore_ascii_case(NAME))
}

/// The values behind a key, without their quotes. `its_` may be left out, and case does not matter. A line that cannot be read is gone
/// through to its end all the same: its error is told by whoever reads it.
fn values_of(wanted: &str, line: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut rest = line.chars();
    while !rest.as_str().is_empty() {
        skip_blanks(&mut rest);
        let key = until(&mut rest, |c| c.is_whitespace() || c == '=').to_ascii_lowercase();
        skip_blanks(&mut rest);
        if !skip(&mut rest, '=') {
            continue;
        }
        let is_wanted = key.strip_prefix("its_").unwrap_or(&key) == wanted;
        loop {
            skip_blanks(&mut rest);
            let value = value(&mut rest);
            if is_wanted && !value.is_empty() {
                found.push(value);
            }
            let here = rest.clone();
            skip_blanks(&mut rest);
            if !skip(&mut rest, ',') {
                rest = here;
                break;
            }
        }
    }
    found
}

/// A value of a list: in quotes up to the closing one, a quote inside being written twice; or up to a blank, a comma or a quote.
fn value(rest: &mut Chars<'_>) -> String {
    if !skip(rest, '"') {
        return until(rest, |c| c.is_whitespace() || matches!(c, ',' | '"')).to_owned();
    }
    let mut text = String::new();
    loop {
        text.push_str(until(rest, |c| c == '"'));
        if !(skip(rest, '"') && skip(rest, '"')) {
            return text;
        }
        text.push('"');
    }
}

fn skip_blanks(rest: &mut Chars<'_>) {
    *rest = rest.as_str().trim_start().chars();
}

/// True when this character stood next, which is passed then.
fn skip(rest: &mut Chars<'_>, wanted: char) -> bool {
    let behind = rest.as_str().strip_prefix(wanted);
    *rest = behind.unwrap_or(rest.as_str()).chars();
    behind.is_some()
}

fn until<'l>(rest: &mut Chars<'l>, end: impl Fn(char) -> bool) -> &'l str {
    let text = rest.as_str();
    let (before, behind) = text.split_at(text.find(end).unwrap_or(text.len()));
    *rest = behind.chars();
    before
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(line: &str, expected: &[(&str, bool)]) {
        let found: Vec<_> = written(line).into_iter().map(|w| (w.name, w.again)).collect();
        let expected: Vec<_> = expected.iter().map(|(name, again)| ((*name).to_owned(), *again)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_variable_that_a_line_writes_is_found_however_it_is_spelt() {
        check("trace:1 get_feedrate its_variable=#100", &[("#100", false)]);
        check("TRACE:1 GET_FEEDRATE VARIABLE = \"#7\" LOG=x", &[("#7", false)]);
        check(
            "\u{3000}trace:1 get_feedrate its_tolerance=0.5 mm its_variable=#1",
            &[("#1", false)],
        );
        check("trace:1 get_feedrate its_log=variable", &[]);
        check("trace:1 get_time its_label=\"a variable=#1 in words\"", &[]);
        check(
            "trace:1 get_time its_label=\"an \"\" variable=#1 \"\" more\" variable=#2",
            &[("#2", false)],
        );
        check("trace:1 get_time", &[]);
        check("trace:1 get_time its_variable=", &[]);
        check("trace:1 get_time its_variable=\"\"", &[]);
        check(
            "trace:1 start_sensor_recording its_sensors=a , b variable=#3",
            &[("#3", false)],
        );
    }

    #[test]
    fn a_name_in_quotes_goes_to_the_closing_one() {
        check("trace:1 get_time its_variable=\"TIME LIMIT\"", &[("TIME LIMIT", false)]);
        check("trace:1 get_time its_variable=\"A, B\" its_log=x", &[("A, B", false)]);
        check(
            "trace:1 get_time its_variable=\"THE \"\"LIMIT\"\"\"",
            &[("THE \"LIMIT\"", false)],
        );
        check(
            "trace:1 get_time its_variable=\"ÜBER\u{3000}MASS\"",
            &[("ÜBER\u{3000}MASS", false)],
        );
        // A quote that nothing closes: the line is refused by whoever reads it.
        check("trace:1 get_time its_variable=\"TIME LIMIT", &[("TIME LIMIT", false)]);
        check("\"=\",,\"\"\" =\"", &[]);
    }

    #[test]
    fn what_an_action_writes_is_written_again_and_again() {
        check(
            "trace:1 start_synchronized_action its_id=1 its_actions=\"get_time its_variable=T\",\"get_feedrate variable=#2\"",
            &[("T", true), ("#2", true)],
        );
        check(
            "trace:1 start_synchronized_action its_id=1 its_condition=\"a variable=7\" \
             ACTIONS = \"trace:1 get_time its_variable=\"\"TIME LIMIT\"\" its_label=\"\"a variable=#1\"\"\" , get_time its_log=x",
            &[("TIME LIMIT", true)],
        );
    }
}

//! Which variables of the program a function's line writes. From there on only the machine knows them, so a reader that goes ahead asks.

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
    let again = is_action(line);
    let mut found = Vec::new();
    let mut quoted = false;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        quoted ^= c == '"';
        // What stands in quotes is a text, but for actions.
        if (before.is_whitespace() || before == '"')
            && (again || !quoted)
            && let Some(name) = value_of_variable(&line[at..])
        {
            found.push(Written {
                name: name.to_owned(),
                again,
            });
        }
        before = c;
    }
    found
}

/// True for a line that starts a synchronized action: what stands in it is done later.
pub fn is_action(line: &str) -> bool {
    const NAME: &str = "start_synchronized_action";
    line.split_whitespace()
        .nth(1)
        .is_some_and(|name| name.eq_ignore_ascii_case(NAME))
}

/// The value when a text begins with `its_variable=`; the prefix may be left out, and case does not matter.
fn value_of_variable(text: &str) -> Option<&str> {
    let after = |text: &str, word: &str| text.get(..word.len())?.eq_ignore_ascii_case(word).then_some(word.len());
    let start = after(text, "its_").unwrap_or(0);
    let end = start + after(&text[start..], "variable")?;
    let value = text[end..]
        .trim_start()
        .strip_prefix('=')?
        .trim_start()
        .trim_start_matches('"');
    let name = value.split(|c: char| c.is_whitespace() || matches!(c, ',' | '"')).next()?;
    (!name.is_empty()).then_some(name)
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
        check("trace:1 get_feedrate its_log=variable", &[]);
        check("trace:1 get_time its_label=\"a variable=#1 in words\"", &[]);
        check("trace:1 get_time", &[]);
        check("trace:1 get_time its_variable=", &[]);
    }

    #[test]
    fn what_an_action_writes_is_written_again_and_again() {
        check(
            "trace:1 start_synchronized_action its_id=1 its_actions=\"get_time its_variable=T\",\"get_feedrate variable=#2\"",
            &[("T", true), ("#2", true)],
        );
    }
}

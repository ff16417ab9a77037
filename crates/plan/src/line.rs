//! Which texts of a program are lines of the vocabulary (`trace:1 get_time`). What they mean is not known here.

use std::collections::BTreeMap;

/// True when a text is meant as one of our lines, of whatever version.
pub fn is_line(text: &str) -> bool {
    let text = text.trim_start();
    text.get(..6).is_some_and(|start| start.eq_ignore_ascii_case("trace:")) && !text[6..].starts_with('+')
}

/// True for the name of a variable that is bound to a sensor or a value of the machine (`sensor:...`, `trace:...`): nobody writes it.
pub fn is_of_the_machine(variable: &str) -> bool {
    let small = variable.trim_start().to_ascii_lowercase();
    small.starts_with("sensor:") || small.starts_with("trace:")
}

/// The lines that stand along a path.
///
/// A line is the name of a condition, or its mode; several of one name come joined by commas.
pub fn along(properties: &BTreeMap<String, String>) -> Vec<&str> {
    let mut found = Vec::new();
    for (name, mode) in properties {
        if is_line(name) {
            found.push(name.as_str());
        } else if is_line(mode) {
            joined(mode, &mut found);
        }
    }
    found
}

/// A comma parts two lines where another line begins behind it; a text in quotes may say the same.
fn joined<'m>(mode: &'m str, found: &mut Vec<&'m str>) {
    let (mut start, mut quoted) = (0, false);
    for (at, c) in mode.char_indices() {
        quoted ^= c == '"';
        if c == ',' && !quoted && is_line(&mode[at + 1..]) {
            found.push(&mode[start..at]);
            start = at + 1;
        }
    }
    found.push(&mode[start..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(name: &str, mode: &str, expected: &[&str]) {
        let properties = BTreeMap::from([(name.to_owned(), mode.to_owned())]);
        assert_eq!(along(&properties), expected);
    }

    #[test]
    fn a_line_may_have_blanks_of_any_script_before_it() {
        for blank in ["", " ", "\t\n", "\u{a0}", "\u{3000}", "\u{2003}\u{3000}"] {
            assert!(is_line(&format!("{blank}trace:1 get_time")), "{blank:?}");
            let line = format!("{blank}trace:1 get_time");
            check("note", &line, &[&line]);
            check("note", &format!("{line},{line}"), &[&line, &line]);
        }
        for none in [
            "",
            "trace",
            "trace:+ its_label=x",
            "\u{3000}",
            "träce:1",
            "x trace:1 get_time",
        ] {
            assert!(!is_line(none), "{none}");
            check("note", none, &[]);
        }
    }

    #[test]
    fn lines_of_one_name_are_parted_and_a_text_stays_whole() {
        check("trace:1 get_time", "on", &["trace:1 get_time"]);
        check(
            "a",
            "trace:1 get_time,TRACE:1 get_time",
            &["trace:1 get_time", "TRACE:1 get_time"],
        );
        check(
            "a",
            "trace:1 log_event its_kind=a its_values=b,c,trace:1 get_time",
            &["trace:1 log_event its_kind=a its_values=b,c", "trace:1 get_time"],
        );
        let text = "trace:1 log_event its_kind=a its_text=\"so,trace:1 get_time\"";
        check("a", text, &[text]);
    }
}

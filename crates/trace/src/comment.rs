//! Functions as comments of G-code: [`plan::comment`] for what we know of their lines.

use crate::function::Function;

pub use plan::comment::{Comment, LONGEST, joined, read, write_line};

/// The comments that write a function, each with its brackets; as many as it takes.
pub fn write(function: &Function) -> Vec<String> {
    write_line(&function.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::function::parse;

    #[track_caller]
    fn there_and_back(line: &str) -> Vec<String> {
        let function = parse(line).expect("a line");
        let comments = write(&function);
        let mut text = String::new();
        for (k, comment) in comments.iter().enumerate() {
            let inner = comment.strip_prefix('(').and_then(|c| c.strip_suffix(')')).expect("brackets");
            assert!(!inner.contains(['(', ')']), "{inner}");
            match read(inner) {
                Comment::Begins(start) if k == 0 => text = start,
                Comment::GoesOn(more) if k > 0 => text = joined(&text, &more),
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(parse(&text).as_ref().map(ToString::to_string), Ok(function.to_string()));
        comments
    }

    #[test]
    fn brackets_and_percent_signs_survive_a_comment() {
        assert_eq!(
            there_and_back("trace:1 get_time its_label=\"a (b) 100%28 %25\""),
            ["(trace:1 get_time its_label=\"a %28b%29 100%2528 %2525\")"]
        );
    }

    #[test]
    fn a_long_line_goes_on_in_comments_of_at_most_a_hundred_characters() {
        let comments = there_and_back(
            "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"ws_time > 3600 s and \
             (X.LOAD > 80 % or Y.LOAD > 80 %)\" its_actions=\"read_sensor_value its_sensor=position its_axes=X,Y,Z\",\"set_alarm \
             its_alarm_id=1 its_text=\"\"over  time\"\"\"",
        );
        assert_eq!(comments.len(), 4);
        assert!(comments.iter().all(|c| c.chars().count() <= LONGEST), "{comments:#?}");
    }
}

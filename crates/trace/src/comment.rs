//! The same lines in G-code: `(trace:1 ...)` in a block of its own, which other controls skip as a comment.
//!
//! A comment ends at its first round bracket, so those inside are written `[ ]`, in quotes `%28 %29` (and `%25` for a percent sign that
//! could be taken for one of these). A line of more than [`LONGEST`] characters goes on in `(trace:+ ...)`; the parts are joined by one
//! blank. Text in quotes may be in capitals where the control knows no other.

use crate::function::Function;

/// Longest comment, brackets included: what older controls show and keep.
pub const LONGEST: usize = 100;

/// What a comment says to the vocabulary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Comment {
    /// A line begins.
    Begins(String),
    /// The line before goes on.
    GoesOn(String),
    /// It is an ordinary comment.
    Other,
}

/// Reads the text between the brackets of a comment.
pub fn read(comment: &str) -> Comment {
    let text = comment.trim();
    let starts = |word: &str| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word));
    if starts("trace:+") {
        Comment::GoesOn(decoded(text[7..].trim_start()))
    } else if starts("trace:") {
        Comment::Begins(decoded(text))
    } else {
        Comment::Other
    }
}

/// A line joined with what it goes on with.
pub fn joined(line: &str, more: &str) -> String {
    format!("{line} {more}")
}

/// The comments that write a function, each with its brackets; as many as it takes.
pub fn write(function: &Function) -> Vec<String> {
    write_line(&function.to_string())
}

/// The same for a line as it stands.
pub fn write_line(line: &str) -> Vec<String> {
    let encoded = encoded(line);
    let mut comments = Vec::new();
    let mut rest = encoded.as_str();
    let mut start = "";
    loop {
        let room = LONGEST - 2 - start.len();
        let Some(cut) = cut(rest, room) else {
            comments.push(format!("({start}{rest})"));
            return comments;
        };
        comments.push(format!("({start}{})", &rest[..cut]));
        rest = &rest[cut + 1..];
        start = "trace:+ ";
    }
}

/// The last single blank within `room` characters; the next one where there is none; `None` when the rest fits or cannot be cut.
fn cut(text: &str, room: usize) -> Option<usize> {
    if text.chars().count() <= room {
        return None;
    }
    let bytes = text.as_bytes();
    let single =
        |at: usize| bytes[at] == b' ' && at > 0 && bytes[at - 1] != b' ' && bytes.get(at + 1).is_some_and(|next| *next != b' ');
    // Behind the first word: `trace:1` alone says nothing.
    let candidates = || (8..bytes.len()).filter(|at| single(*at));
    let within = candidates().take_while(|at| text[..*at].chars().count() <= room).last();
    within.or_else(|| candidates().next())
}

fn encoded(line: &str) -> String {
    let mut text = String::with_capacity(line.len());
    let mut in_quotes = false;
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '"' => {
                in_quotes = !in_quotes;
                text.push('"');
            }
            '(' if in_quotes => text.push_str("%28"),
            ')' if in_quotes => text.push_str("%29"),
            '%' if in_quotes && rest.peek() == Some(&'2') => text.push_str("%25"),
            '(' => text.push('['),
            ')' => text.push(']'),
            c => text.push(c),
        }
    }
    text
}

fn decoded(comment: &str) -> String {
    let mut text = String::with_capacity(comment.len());
    let mut rest = comment;
    while let Some(at) = rest.find('%') {
        text.push_str(&rest[..at]);
        let (character, length) = match rest.get(at..at + 3) {
            Some("%28") => ('(', 3),
            Some("%29") => (')', 3),
            Some("%25") => ('%', 3),
            _ => ('%', 1),
        };
        text.push(character);
        rest = &rest[at + length..];
    }
    text.push_str(rest);
    text
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

    #[test]
    fn an_ordinary_comment_is_none_of_ours() {
        assert_eq!(read("TRACE THE CONTOUR"), Comment::Other);
        assert_eq!(read(" TRACE:1 GET_TIME "), Comment::Begins("TRACE:1 GET_TIME".into()));
    }
}

//! A function's line as a comment between round brackets, as programs in words carry it: `(trace:1 ...)` in a block of its own, which
//! other controls skip.
//!
//! A comment ends at its first round bracket, so those inside are written `[ ]`, in quotes `%28 %29` (and `%25` for a percent sign that
//! could be taken for one of these). A line of more than [`LONGEST`] characters goes on in `(trace:+ ...)`; the parts are joined by one
//! blank. Text in quotes may be in capitals where the control knows no other.

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

/// The comments that write a line, each with its brackets; as many as it takes.
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

    #[test]
    fn an_ordinary_comment_is_none_of_ours() {
        assert_eq!(read("TRACE THE CONTOUR"), Comment::Other);
        assert_eq!(read(" TRACE:1 GET_TIME "), Comment::Begins("TRACE:1 GET_TIME".into()));
        assert_eq!(read("trace:+ its_label=x"), Comment::GoesOn("its_label=x".into()));
    }

    #[test]
    fn a_line_that_cannot_be_cut_is_written_whole() {
        let line = format!("trace:1 get_time its_label={}", "x".repeat(200));
        assert_eq!(
            write_line(&line),
            [
                "(trace:1 get_time)".to_owned(),
                format!("(trace:+ its_label={})", "x".repeat(200))
            ]
        );
    }
}

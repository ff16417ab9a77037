//! What is wrong in a line, with the column in it.

use plan::Diagnostic;

/// Something wrong in a line of text; becomes a [`Diagnostic`] at the border.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub code: &'static str,
    /// 1-based, in characters of the line.
    pub column: u32,
    pub message: String,
    pub remedy: String,
}

/// A fault at a column.
pub(crate) fn fault<T>(
    code: &'static str,
    column: u32,
    message: impl Into<String>,
    remedy: impl Into<String>,
) -> Result<T, Box<Fault>> {
    Err(Box::new(Fault {
        code,
        column,
        message: message.into(),
        remedy: remedy.into(),
    }))
}

impl Fault {
    /// The finding, as an error in line 1: a function is one line, and who has it in a file adds the place.
    pub(crate) fn diagnostic(self) -> Diagnostic {
        Diagnostic::error(self.code, self.message)
            .at_line(1, self.column)
            .remedy(self.remedy)
    }

    /// The same fault in a text that begins further right.
    pub(crate) fn shifted(mut self: Box<Self>, by: u32) -> Box<Self> {
        self.column += by;
        self
    }
}

/// The likeliest of the words that was meant, for a remedy: within two changes of a letter.
pub(crate) fn nearest<'w>(written: &str, words: impl Iterator<Item = &'w str>) -> Option<&'w str> {
    words
        .map(|word| (changes(&written.to_ascii_lowercase(), &word.to_ascii_lowercase()), word))
        .filter(|(changes, word)| *changes <= 2 && *changes < word.len())
        .min()
        .map(|(_, word)| word)
}

/// Letters to put in, take out or exchange between two words.
fn changes(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, left) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, right) in b.iter().enumerate() {
            let here = diagonal + usize::from(left != *right);
            diagonal = row[j + 1];
            row[j + 1] = here.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_pen_finds_its_word() {
        let words = ["its_sensors", "its_axes", "max_samples"];
        assert_eq!(nearest("its_sensor", words.into_iter()), Some("its_sensors"));
        assert_eq!(nearest("speed", words.into_iter()), None);
    }
}

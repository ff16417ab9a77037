//! Lines of a cutter-location file as statements: `MAJOR/words`, continued by `$`, commented by `$$`.

/// One statement.
#[derive(Clone, Debug, PartialEq)]
pub struct Statement {
    /// The word before the slash, upper case: `GOTO`, `TOOL PATH`.
    pub major: String,
    /// What follows it, between commas; numbers and words as they stand, trimmed.
    pub words: Vec<String>,
    /// Everything behind the slash as it stands, for texts.
    pub rest: String,
    /// Line of its first character, from 1.
    pub line: u32,
    /// Offset of its first byte, and its length in bytes.
    pub span: (u64, u32),
}

impl Statement {
    /// The numbers up to the first word.
    pub fn numbers(&self) -> Vec<f64> {
        self.words.iter().map_while(|word| number(word)).collect()
    }

    /// Is this word among its words?
    pub fn has(&self, wanted: &str) -> bool {
        self.words.iter().any(|word| word.eq_ignore_ascii_case(wanted))
    }

    /// The number behind a word: `RPM,1000`.
    pub fn number_after(&self, wanted: &str) -> Option<f64> {
        let place = self.words.iter().position(|word| word.eq_ignore_ascii_case(wanted))?;
        number(self.words.get(place + 1)?)
    }
}

/// A number as APT writes it: `1.`, `-.5`, `1.5E-3`, `2.D+01`.
pub fn number(word: &str) -> Option<f64> {
    let plain = word.replace(['D', 'd'], "E");
    let begins = plain.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.'));
    let value = begins.then(|| plain.parse::<f64>().ok()).flatten()?;
    value.is_finite().then_some(value)
}

/// The next statement from `at` on, and where the one behind it begins; comments and empty lines are passed. `line` counts along.
pub fn next(text: &str, at: &mut usize, line: &mut u32) -> Option<Statement> {
    loop {
        let begin = *at;
        let first_line = *line;
        let mut whole = String::new();
        loop {
            let rest = &text[*at..];
            if rest.is_empty() {
                break;
            }
            let length = rest.find('\n').map_or(rest.len(), |end| end + 1);
            let raw = rest[..length].trim_end_matches(['\n', '\r']);
            *at += length;
            *line += 1;
            // A text may hold a `$`; only PPRINT, INSERT and the like carry text, and they are not continued.
            let is_text = TEXTS
                .iter()
                .any(|major| raw.trim_start().to_ascii_uppercase().starts_with(major));
            let code = if is_text {
                raw
            } else {
                raw.find("$$").map_or(raw, |comment| &raw[..comment])
            };
            match code.trim_end().strip_suffix('$').filter(|_| !is_text) {
                Some(head) => whole.push_str(head),
                None => {
                    whole.push_str(code);
                    break;
                }
            }
        }
        let statement = whole.trim();
        if statement.is_empty() {
            if *at >= text.len() {
                return None;
            }
            continue;
        }
        let (major, rest) = statement.split_once('/').unwrap_or((statement, ""));
        let length = (*at - begin).min(u32::MAX as usize) as u32;
        return Some(Statement {
            major: major.trim().to_ascii_uppercase(),
            words: rest
                .split(',')
                .map(|word| word.trim().to_string())
                .filter(|word| !word.is_empty())
                .collect(),
            rest: rest.trim().to_string(),
            line: first_line,
            span: (begin as u64, length),
        });
    }
}

/// Statements whose rest is a text.
const TEXTS: [&str; 4] = ["PPRINT", "INSERT", "PARTNO", "REMARK"];

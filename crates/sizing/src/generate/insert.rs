//! Changing an existing program: calls before its turret indexes, or the line that says which job it is.
//!
//! Every byte of the program stays but for what is put in; a sequence number of a changed block goes to the line that is put in before it,
//! so that a jump to it does not pass the call by.

use super::{GenerateError, Generated, Method, call, t_word};
use crate::control::Control;

/// Puts into a program what a job's sizing needs there.
///
/// # Errors
/// [`GenerateError::Program`] with the line: a T word that is computed, an offset that the secondary offsets need, a dimension whose offset
/// the program never calls, no program at all.
pub fn insert(program: &str, generated: &Generated, control: &Control) -> Result<String, GenerateError> {
    match generated.method {
        Method::TWord => job_line(program, generated, control),
        Method::G65 => calls(program, generated, control),
    }
}

fn job_line(program: &str, generated: &Generated, control: &Control) -> Result<String, GenerateError> {
    let mut out = String::with_capacity(program.len() + 64);
    let mut done = false;
    for line in program.split_inclusive('\n') {
        let block = Block::of(line);
        // Behind `%` and the O number, before the first block that does anything.
        let head = block.is_program_start || block.words.trim().is_empty() || block.words.trim_start().starts_with('%');
        if !done && !head {
            out.push_str(&t_word::job_line(control, generated.job));
            out.push_str(line_end(line));
            done = true;
        }
        // A T word calls behind the other words of its block: M6 in the same block would change before the tool is named.
        match block.tool_and_rest().filter(|_| control.mill) {
            Some((tool, rest)) => {
                out.push_str(block.skip);
                out.push_str(block.label);
                out.push_str(&tool);
                out.push_str(line_end(line));
                out.push_str(block.skip);
                out.push_str(&rest);
            }
            None => out.push_str(line),
        }
    }
    if done {
        Ok(out)
    } else {
        Err(GenerateError::Program(
            "the program has no block: give the part program".to_owned(),
        ))
    }
}

fn calls(program: &str, generated: &Generated, control: &Control) -> Result<String, GenerateError> {
    let refuse = |number: usize, what: &str| Err(GenerateError::Program(format!("line {number}: {what}")));
    let mut out = String::with_capacity(program.len() + 1024);
    let mut called = vec![false; generated.dimensions.len()];
    for (number, line) in (1..).zip(program.split_inclusive('\n')) {
        let block = Block::of(line);
        let called_as = match block.tool(control.mill) {
            ToolWord::None => {
                out.push_str(line);
                continue;
            }
            ToolWord::Computed => {
                return refuse(
                    number,
                    "this T word is computed, so its offset is not known here: use the method t-word",
                );
            }
            ToolWord::Called(number) => number,
        };
        let secondary = |k: usize| call::entry_offset(&generated.dimensions, k, control) == called_as;
        if !control.mill && (0..generated.dimensions.len()).any(secondary) {
            let what = format!(
                "offset {called_as} is in use, and sizes are to be typed into it: set `secondary` in the control's profile"
            );
            return refuse(number, &what);
        }
        let mut label = block.label;
        for (k, _) in generated
            .dimensions
            .iter()
            .enumerate()
            .filter(|(_, d)| control.called_by(d) == called_as)
        {
            called[k] = true;
            out.push_str(block.skip);
            out.push_str(std::mem::take(&mut label));
            out.push_str(&call::call(k + 1, &generated.dimensions, generated.job, control));
            out.push_str(line_end(line));
        }
        if label.is_empty() {
            out.push_str(block.skip);
            out.push_str(&line[block.skip.len() + block.label.len()..]);
        } else {
            out.push_str(line);
        }
    }
    match generated.dimensions.iter().zip(&called).find(|(_, called)| !**called) {
        Some((missing, _)) => Err(GenerateError::Program(format!(
            "the program never calls {} {}, so dimension {:?} would not be sized",
            if control.mill { "tool" } else { "offset" },
            control.called_by(missing),
            missing.name
        ))),
        None => Ok(out),
    }
}

fn line_end(line: &str) -> &str {
    if line.ends_with("\r\n") { "\r\n" } else { "\n" }
}

/// A block as far as this needs it.
struct Block<'a> {
    /// `/` and the blanks behind it.
    skip: &'a str,
    /// `N50` and the blanks behind it.
    label: &'a str,
    /// The rest without comments.
    words: String,
    /// The rest as it is.
    rest: &'a str,
    /// An O number or `:`.
    is_program_start: bool,
}

enum ToolWord {
    None,
    Computed,
    /// The offset on a lathe, the tool on a mill.
    Called(u32),
}

impl<'a> Block<'a> {
    fn of(line: &'a str) -> Block<'a> {
        let run = |text: &'a str, first: &[char]| -> usize {
            match text.find(|c: char| !c.is_whitespace()) {
                Some(at) if text[at..].starts_with(first) => {
                    let digits = &text[at + 1..];
                    let end = digits
                        .find(|c: char| !c.is_ascii_digit() && !c.is_whitespace())
                        .unwrap_or(digits.len());
                    at + 1 + end
                }
                _ => 0,
            }
        };
        let (skip, rest) = line.split_at(run(line, &['/']));
        let (label, rest) = rest.split_at(run(rest, &['N', 'n']));
        let mut words = String::new();
        let mut depth = 0u32;
        for c in rest.chars() {
            match c {
                '(' => depth += 1,
                ')' => depth = depth.saturating_sub(1),
                c if depth == 0 => words.push(c.to_ascii_uppercase()),
                _ => {}
            }
        }
        let is_program_start = words.trim_start().starts_with(['O', ':']);
        Block {
            skip,
            label,
            words,
            rest,
            is_program_start,
        }
    }

    /// The T word of a block that holds more, and the block without it.
    fn tool_and_rest(&self) -> Option<(String, String)> {
        if !matches!(self.tool(true), ToolWord::Called(_)) {
            return None;
        }
        let mut depth = 0u32;
        let at = self.rest.find(|c: char| {
            match c {
                '(' => depth += 1,
                ')' => depth = depth.saturating_sub(1),
                _ => {}
            }
            depth == 0 && c.eq_ignore_ascii_case(&'T')
        })?;
        let behind = &self.rest[at + 1..];
        let length = behind.find(|c: char| !c.is_ascii_digit() && c != ' ').unwrap_or(behind.len());
        let tool = self.rest[at..at + 1 + length].trim_end().to_owned();
        let rest = format!("{}{}", &self.rest[..at], &behind[length..]);
        let others = self.words.chars().filter(|c| !c.is_whitespace()).count();
        let own = tool.chars().filter(|c| !c.is_whitespace()).count();
        (others > own).then_some((tool, rest))
    }

    /// What a T word says: on a lathe the last two digits, the offset; on a mill the tool.
    fn tool(&self, mill: bool) -> ToolWord {
        let words: String = self.words.chars().filter(|c| !c.is_whitespace()).collect();
        // T is an argument of a macro call, or a letter of a macro statement or of DPRNT's text.
        let no_tool = [
            "G65", "G66", "DPRNT", "BPRNT", "SETVN", "IF", "WH", "GOTO", "#", "%", "POPEN", "PCLOS", "O", ":",
        ];
        let Some(at) = words
            .find('T')
            .filter(|_| !no_tool.iter().any(|w| words.starts_with(w) || words.contains("G65")))
        else {
            return ToolWord::None;
        };
        let digits: String = words[at + 1..].chars().take_while(char::is_ascii_digit).collect();
        match digits.parse::<u64>() {
            Ok(number) if mill => ToolWord::Called(number.min(u64::from(u32::MAX)) as u32),
            Ok(number) => ToolWord::Called((number % 100) as u32),
            Err(_) if words[at + 1..].starts_with(['#', '[']) => ToolWord::Computed,
            Err(_) => ToolWord::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Job;
    use crate::generate::{SetupEnd, generate};
    use crate::job::tests::{PUBLISHED, lathe};

    fn changed(program: &str, method: Method) -> Result<String, String> {
        let job = Job::parse(PUBLISHED, "job.toml", &lathe()).expect("good");
        let control = Control::find("fanuc-lathe").expect("built in");
        let generated = generate(&job, &control, method, SetupEnd::M30).expect("possible");
        insert(program, &generated, &control).map_err(|e| e.to_string())
    }

    const CALL: &str = "G65 P8002 T5. D3.2342 S3.22 B3.245 A2000. E2025. F10000. Q50. J200. K1. M1. C1. R10000. H20.";

    #[test]
    fn a_call_comes_before_the_index_and_takes_the_sequence_number() {
        let program =
            "%\r\nO0001(T0505)\r\nN050 T0505 (FINISH)\r\nG65 P1 T5.\r\n/N60 T0303\r\n/N70T1505M8\r\nT0500\r\nM30\r\n%\r\n";
        let expected = format!(
            "%\r\nO0001(T0505)\r\nN050 {CALL}\r\nT0505 (FINISH)\r\nG65 P1 T5.\r\n/N60 T0303\r\n/N70{CALL}\r\n/T1505M8\r\nT0500\r\nM30\r\n%\r\n"
        );
        assert_eq!(changed(program, Method::G65), Ok(expected));
    }

    #[test]
    fn what_cannot_be_changed_safely_is_refused_at_its_line() {
        let check = |program: &str, expected: &str| {
            let refused = changed(program, Method::G65).expect_err(expected);
            assert!(refused.contains(expected), "{refused}");
        };
        check("O1\nT0505\nT#5\n", "line 3: this T word is computed");
        check("O1\nT0505\nT2525\n", "line 3: offset 25 is in use");
        check("O1\nT0303\nM30\n", "never calls offset 5, so dimension \"DIM A\"");
    }

    #[test]
    fn a_program_says_its_job_before_its_first_block() {
        assert_eq!(
            changed("%\nO1(PART)\n(COMMENT)\nN10 G21\nM30\n%\n", Method::TWord),
            Ok("%\nO1(PART)\n(COMMENT)\n#140=200 (JOB, FOR SIZING)\nN10 G21\nM30\n%\n".to_owned())
        );
        assert!(changed("%\n", Method::TWord).is_err());
    }

    #[test]
    fn on_a_mill_a_tool_is_named_in_a_block_before_its_change() {
        let mut job = Job::parse(PUBLISHED, "job.toml", &lathe()).expect("good");
        job.dimensions[0].column = crate::Column::CutterRadius;
        let control = Control::find("fanuc-mill").expect("built in");
        let generated = generate(&job, &control, Method::TWord, SetupEnd::M30).expect("possible");
        let program = "O1\nN5 T2 M6 (T2 CUTTER)\n/M6T03\nT4\nG43H2Z1.\n(T9)M6\nM30\n";
        assert_eq!(
            insert(program, &generated, &control).expect("fits"),
            "O1\n#140=200 (JOB, FOR SIZING)\nN5 T2\nM6 (T2 CUTTER)\n/T03\n/M6\nT4\nG43H2Z1.\n(T9)M6\nM30\n"
        );
    }
}

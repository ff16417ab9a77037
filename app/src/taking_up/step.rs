//! Which step a person means by a name, a number, a block or a line, and where a step is, for people.

use super::answers::{Answers, walk};
use crate::failure::Failure;
use crate::files::FileSource;
use crate::program::{Kind, Program};
use plan::{ByteSource, Level, Marker, Modal, Place, Step, StepKind, Tables};
use units::StepId;

/// What a person means by a step.
#[derive(Clone, Debug, PartialEq)]
pub enum Meant {
    /// A workingstep by its name, and those of the workplans around it before.
    Names(Vec<String>),
    /// The n-th workingstep.
    Number(u32),
    /// A STEP instance.
    Entity(u64),
    /// A line of the program's own file.
    Line(u32),
    /// A step of the stream.
    Step(u32),
}

/// A step that could be meant.
pub struct Candidate {
    /// Its number.
    pub step: StepId,
    /// Where it is.
    pub place: String,
}

/// Reads `--from`: what is meant, in order of preference, and which of several.
pub fn meant(asked: &str) -> (Vec<Meant>, Option<usize>) {
    let asked = asked.trim();
    let (text, pick) = match asked.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')) {
        Some((text, n)) if n.parse::<usize>().is_ok_and(|n| n > 0) => (text.trim_end(), n.parse().ok()),
        _ => (asked, None),
    };
    let number = |prefix: &str| {
        let head = text.get(..prefix.len()).filter(|head| head.eq_ignore_ascii_case(prefix))?;
        text[head.len()..].trim_start().strip_prefix(':')?.trim().parse::<u32>().ok()
    };
    // A name with a slash in it may be said as it is.
    let mut all = vec![Meant::Names(vec![text.to_owned()]), Meant::Names(names(text))];
    all.extend(number("line").map(Meant::Line));
    all.extend(number("step").map(Meant::Step));
    all.extend(text.strip_prefix('#').and_then(|id| id.parse().ok()).map(Meant::Entity));
    all.extend(text.parse().ok().map(Meant::Number));
    (all, pick)
}

/// Names joined by `/`; `\/` is one within a name.
fn names(text: &str) -> Vec<String> {
    let mut names = vec![String::new()];
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        let last = names.len() - 1;
        match letter {
            '\\' if letters.peek() == Some(&'/') => names[last].extend(letters.next()),
            '/' => names.push(String::new()),
            letter => names[last].push(letter),
        }
    }
    names
}

/// The number of a block, `N120`.
pub fn block_number(text: &str) -> Option<u32> {
    let digits = text.strip_prefix(['N', 'n'])?;
    digits.parse().ok().filter(|_| digits.chars().all(|c| c.is_ascii_digit()))
}

/// What is found of a step in a program.
pub struct Found {
    /// For each meaning, in order of preference.
    pub candidates: Vec<Vec<Candidate>>,
    /// Number and name of each workingstep.
    pub workingsteps: Vec<String>,
    /// First and last line of the program's own file that does something.
    pub lines: Option<(u32, u32)>,
    /// Why the program was not read to its end.
    pub alarm: Option<String>,
}

/// Looks for what is wanted in the whole program.
///
/// # Errors
/// It cannot be read.
pub fn look(program: &Program, tables: &Tables, answers: &Answers, wanted: &[Meant]) -> Result<Found, Failure> {
    let heads = Heads::of(program);
    let mut candidates: Vec<Vec<Candidate>> = wanted.iter().map(|_| vec![]).collect();
    let (mut workingsteps, mut number) = (vec![], 0);
    let mut lines: Option<(u32, u32)> = None;
    let mut last_line = None;
    // The first step of a later line, where a line has no step of its own.
    let mut after: Vec<Option<Candidate>> = wanted.iter().map(|_| None).collect();
    let alarm = walk(program, tables, answers, |step, modal| {
        let line = line_of(step);
        if let Some(line) = line {
            lines = Some(lines.map_or((line, line), |(a, b)| (a.min(line), b.max(line))));
        }
        let begins = match &step.kind {
            StepKind::Begin(marker) if marker.level == Level::Workingstep => Some(marker),
            _ => None,
        };
        if let Some(marker) = begins {
            number += 1;
            let within = modal.open.iter().filter(|m| m.level == Level::Workplan).map(|m| &m.name);
            let path: Vec<String> = within.chain([&marker.name]).map(|name| name.replace('/', "\\/")).collect();
            workingsteps.push(format!("{number} '{}'", path.join("/")));
        }
        for ((meant, found), after) in wanted.iter().zip(&mut candidates).zip(&mut after) {
            let is_it = match (meant, begins, &step.kind) {
                (Meant::Names(names), Some(marker), _) => is_named(names, marker, modal),
                (Meant::Number(n), Some(_), _) => *n == number,
                (Meant::Entity(id), _, StepKind::Begin(marker)) => marker.entity == Some(*id),
                (Meant::Line(n), _, _) => line == Some(*n) && last_line != line,
                (Meant::Step(n), _, _) => step.id.0 == *n,
                _ => false,
            };
            if is_it {
                found.push(Candidate {
                    step: step.id,
                    place: place_words(program, &heads, step, begins, modal, number),
                });
            }
            if let Meant::Line(n) = meant
                && after.is_none()
                && line.is_some_and(|line| line > *n)
            {
                let place = place_words(program, &heads, step, begins, modal, number);
                *after = Some(Candidate {
                    step: step.id,
                    place: format!("{place}; line {n} itself does nothing"),
                });
            }
        }
        last_line = line;
        true
    })?;
    for ((meant, found), after) in wanted.iter().zip(&mut candidates).zip(after) {
        if let Meant::Line(n) = meant
            && found.is_empty()
            && heads.has_line(*n)
        {
            found.extend(after);
        }
    }
    Ok(Found {
        candidates,
        workingsteps,
        lines,
        alarm,
    })
}

/// True for a workingstep of that name, within workplans of the names before it.
fn is_named(names: &[String], marker: &Marker, modal: &Modal) -> bool {
    let within = modal
        .open
        .iter()
        .filter(|m| m.level == Level::Workplan)
        .map(|m| m.name.as_str());
    let whole: Vec<&str> = within.chain([marker.name.as_str()]).collect();
    let same = |(name, asked): (&&str, &String)| **name == *asked;
    names.len() <= whole.len() && whole[whole.len() - names.len()..].iter().zip(names).all(same)
}

/// The line of the program's own file that a step stands in.
fn line_of(step: &Step) -> Option<u32> {
    match step.origin.place {
        Place::Text { line, .. } if step.origin.file.0 == 0 => Some(line),
        _ => None,
    }
}

fn place_words(program: &Program, heads: &Heads, step: &Step, begins: Option<&Marker>, modal: &Modal, number: u32) -> String {
    let mut words = String::new();
    if let Some(line) = line_of(step) {
        words = format!("line {line}");
        if let Some(block) = heads.number_of(line) {
            words = format!("N{block} ({words})");
        }
    }
    let inside = begins.or_else(|| modal.within(Level::Workingstep));
    let name = inside.map(|marker| format!("workingstep {number} '{}'", marker.name));
    let path = modal
        .within(Level::Toolpath)
        .filter(|m| begins.is_none() && !m.name.is_empty());
    match (name, words.is_empty()) {
        (Some(name), true) => match path {
            Some(path) => format!("step {} on '{}' in {name}", step.id.0, path.name),
            None if begins.is_some() => name,
            None => format!("step {} in {name}", step.id.0),
        },
        (Some(name), false) if begins.is_some() => format!("{name}, {words}"),
        (Some(name), false) => format!("{words} in {name}"),
        (None, true) => format!("step {} of {}", step.id.0, program.name),
        (None, false) => words,
    }
}

/// Numbers of blocks of a text program, `N120`, by line.
#[derive(Default)]
pub struct Heads {
    numbers: Vec<(u32, u32)>,
    lines: u32,
}

impl Heads {
    /// Reads them in windows; a program that has no blocks, or cannot be read any more, has none: its stream says why.
    pub fn of(program: &Program) -> Heads {
        let mut heads = Heads::default();
        if program.step_nc().is_some() {
            return heads;
        }
        let Ok(mut source) = FileSource::open(&program.path) else {
            return heads;
        };
        let (mut window, mut offset) = (vec![0; 1 << 16], 0);
        // The beginning of the line that is being read.
        let mut head = Vec::with_capacity(16);
        let mut empty = true;
        while let Ok(count) = source.read_at(offset, &mut window)
            && count > 0
        {
            for byte in &window[..count] {
                if *byte == b'\n' {
                    heads.line(&head);
                    head.clear();
                    empty = true;
                } else {
                    empty = false;
                    if head.len() < 16 && !byte.is_ascii_whitespace() {
                        head.push(*byte);
                    }
                }
            }
            offset += count as u64;
        }
        if !empty {
            heads.line(&head);
        }
        if !matches!(program.kind, Kind::Gcode { .. }) {
            heads.numbers.clear();
        }
        heads
    }

    fn line(&mut self, head: &[u8]) {
        self.lines += 1;
        // `/N120`: a block that can be skipped.
        let head = head.strip_prefix(b"/").unwrap_or(head);
        if let Some((b'N' | b'n', digits)) = head.split_first() {
            let count = digits.iter().take_while(|d| d.is_ascii_digit()).count();
            let number = std::str::from_utf8(&digits[..count]).ok().and_then(|d| d.parse().ok());
            self.numbers.extend(number.map(|n: u32| (self.lines, n)));
        }
    }

    fn number_of(&self, line: u32) -> Option<u32> {
        let at = self.numbers.binary_search_by_key(&line, |(line, _)| *line).ok()?;
        Some(self.numbers[at].1)
    }

    /// The lines with that block number.
    pub fn lines_of(&self, number: u32) -> Vec<u32> {
        self.numbers
            .iter()
            .filter(|(_, n)| *n == number)
            .map(|(line, _)| *line)
            .collect()
    }

    fn has_line(&self, line: u32) -> bool {
        (1..=self.lines).contains(&line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(asked: &str, last: &Meant, pick: Option<usize>) {
        let (all, picked) = meant(asked);
        assert_eq!((all.last(), picked), (Some(last), pick), "{asked}");
    }

    #[test]
    fn a_step_is_said_in_several_ways() {
        let named = |names: &[&str]| Meant::Names(names.iter().map(|n| (*n).to_owned()).collect());
        check("round pocket", &named(&["round pocket"]), None);
        check("round pocket[2]", &named(&["round pocket"]), Some(2));
        check("MAIN/a\\/b", &named(&["MAIN", "a/b"]), None);
        check("line:57", &Meant::Line(57), None);
        check("LINE : 57[3]", &Meant::Line(57), Some(3));
        check("step:9", &Meant::Step(9), None);
        check("#255", &Meant::Entity(255), None);
        check("2", &Meant::Number(2), None);
        check("line:x", &named(&["line:x"]), None);
        check("[0]", &named(&["[0]"]), None);
        check("", &named(&[""]), None);
        check("ä:1", &named(&["ä:1"]), None);
        assert_eq!(block_number("N0120"), Some(120));
        assert_eq!(block_number("N12x"), None);
        assert_eq!(block_number("N"), None);
        assert_eq!(block_number("N+5"), None);
    }
}

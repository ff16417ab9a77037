//! Where the blocks of a program are: its files, the lines of loops kept taken apart, sequence numbers, and ends of loops.
//!
//! A program is read once from its window. Only what is gone through again is kept: the lines of a loop or of a subprogram, up to a
//! limit. Sequence numbers and ends of loops are looked up when the first jump needs them.

use crate::fault::Fault;
use crate::line::{Line, Reading};
use crate::program::Here;
use crate::statement::Statement;
use crate::text::Lines;
use plan::Origin;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// The beginning of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    /// Byte of the file.
    pub offset: u64,
    /// Lines before it.
    pub lines: u32,
}

/// A file that a program is made of.
pub(crate) struct File {
    pub name: String,
    pub lines: Lines,
    /// Where each program of this file begins; made when the first one is looked for.
    pub programs: Option<BTreeMap<u32, Place>>,
}

/// A line that was gone through more than once.
pub(crate) struct Kept {
    pub text: Box<[u8]>,
    pub line: Line,
    /// Its place, ready to be taken over.
    pub here: Here,
    pub origin: Origin,
    /// The kept line that follows, when it is known.
    pub next: Cell<Option<u32>>,
    /// Where its GOTO went last: the sequence number, the kept line there, and the byte it begins at.
    pub jump: Cell<Option<(u32, u32)>>,
}

/// The kept lines of all files.
#[derive(Default)]
pub(crate) struct KeptLines {
    lines: Vec<Rc<Kept>>,
    by_place: BTreeMap<(usize, u64), u32>,
    bytes: usize,
}

/// Kept lines and their text are bounded: a longer loop is read again and again.
const MOST_KEPT: usize = 50_000;
const MOST_BYTES: usize = 8 * 1024 * 1024;

impl KeptLines {
    pub(crate) fn get(&self, index: u32) -> &Rc<Kept> {
        &self.lines[index as usize]
    }

    pub(crate) fn find(&self, file: usize, offset: u64) -> Option<u32> {
        self.by_place.get(&(file, offset)).copied()
    }

    /// Keeps a line; false when there is no room.
    pub(crate) fn keep(&mut self, file: usize, kept: impl FnOnce(u32) -> Kept, offset: u64) -> bool {
        if self.lines.len() >= MOST_KEPT || self.bytes >= MOST_BYTES {
            return false;
        }
        if self.find(file, offset).is_none() {
            let kept = kept(self.lines.len() as u32);
            self.bytes += kept.text.len() + 64 * kept.line.words.len();
            self.by_place.insert((file, offset), self.lines.len() as u32);
            self.lines.push(Rc::new(kept));
        }
        true
    }
}

/// Sequence numbers of one program: number, lines before, byte; in rising order.
type Numbers = Vec<(u32, u32, u64)>;
/// A program with more numbered blocks than this is searched block by block.
const MOST_NUMBERS: usize = 2_000_000;

/// What was looked up about jumps.
#[derive(Default)]
pub(crate) struct Targets {
    numbers: BTreeMap<(usize, u64), Option<Numbers>>,
    ends: BTreeMap<(usize, u64), LoopEnd>,
}

/// Where a loop ends: its END line, and the line behind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LoopEnd {
    pub end: Place,
    pub after: Place,
}

impl Targets {
    /// The block `N number` of the program that begins at `start`: the first from `after` on, else the first of all. Where the file is
    /// read goes elsewhere.
    pub(crate) fn block(&mut self, files: &mut [File], file: usize, start: Place, after: Place, number: u32) -> Option<Place> {
        let index = self.numbers.entry((file, start.offset)).or_insert_with(|| {
            let mut all = Numbers::new();
            blocks(&mut files[file].lines, start, |place, text| {
                if let Some(n) = sequence_of(text) {
                    all.push((n, place.lines, place.offset));
                }
                all.len() <= MOST_NUMBERS
            });
            all.sort_unstable_by_key(|(n, _, offset)| (*n, *offset));
            (all.len() <= MOST_NUMBERS).then_some(all)
        });
        if let Some(index) = index {
            let first = index.partition_point(|(n, _, _)| *n < number);
            let behind = index.partition_point(|(n, _, offset)| (*n, *offset) < (number, after.offset));
            return [behind, first].iter().find_map(|at| {
                let (n, lines, offset) = *index.get(*at)?;
                (n == number).then_some(Place { offset, lines })
            });
        }
        let (mut found, mut first) = (None, None);
        blocks(&mut files[file].lines, start, |place, text| {
            if sequence_of(text) == Some(number) {
                first.get_or_insert(place);
                if place >= after {
                    found = Some(place);
                }
            }
            found.is_none()
        });
        found.or(first)
    }

    /// The END of the loop whose DO line begins at `place`. Where the file is read goes elsewhere.
    pub(crate) fn loop_end(
        &mut self,
        files: &mut [File],
        file: usize,
        (place, after): (Place, Place),
        (label, at): (u8, usize),
        reading: &Reading,
    ) -> Result<LoopEnd, Box<Fault>> {
        if let Some(known) = self.ends.get(&(file, place.offset)) {
            return Ok(*known);
        }
        let mut open = vec![label];
        let mut line = Line::default();
        let mut end = None;
        let mut wrong = None;
        let lines = &mut files[file].lines;
        blocks(lines, after, |here, text| {
            if !may_loop(text) || line.read(text, reading).is_err() {
                return true;
            }
            match &line.statement {
                Some(Statement::Do { label, .. }) => {
                    if open.contains(label) {
                        wrong = Some(format!("DO{label} begins again in line {} before its END", here.lines + 1));
                    }
                    open.push(*label);
                }
                Some(Statement::End { label, .. }) => {
                    if open.pop() != Some(*label) {
                        wrong = Some(format!("END{label} in line {} crosses another loop", here.lines + 1));
                    } else if open.is_empty() {
                        end = Some(here);
                    }
                }
                _ => {}
            }
            end.is_none() && wrong.is_none()
        });
        let Some(end) = end else {
            let message = wrong.unwrap_or_else(|| format!("DO{label} has no END{label} in this program"));
            return Err(Fault::new(
                at,
                124,
                "loop-pairs",
                message,
                "loops lie one in the other: each DO needs its END behind it",
            ));
        };
        lines.seek(end.offset, end.lines);
        let _ = lines.next();
        let (offset, count) = lines.position();
        let found = LoopEnd {
            end,
            after: Place { offset, lines: count },
        };
        self.ends.insert((file, place.offset), found);
        Ok(found)
    }
}

/// Goes through the lines of a program from `start` on, which may be its O line, until its end or until `each` has enough.
fn blocks(lines: &mut Lines, start: Place, mut each: impl FnMut(Place, &[u8]) -> bool) {
    lines.seek(start.offset, start.lines);
    loop {
        let (offset, before) = lines.position();
        let Ok(Some(line)) = lines.next() else { return };
        let text = lines.bytes(line);
        let place = Place { offset, lines: before };
        if place != start && (program_number(text).is_some() || text.trim_ascii_start().first() == Some(&b'%')) {
            return;
        }
        if !each(place, text) {
            return;
        }
    }
}

/// The text behind blanks, block skip and sequence number.
fn behind_head(text: &[u8]) -> &[u8] {
    let mut rest = text.trim_ascii_start();
    while let [b'/', behind @ ..] = rest {
        rest = match behind {
            [b'1'..=b'9', behind @ ..] => behind,
            other => other,
        }
        .trim_ascii_start();
    }
    rest
}

/// The sequence number at the head of a block.
fn sequence_of(text: &[u8]) -> Option<u32> {
    let [b'N' | b'n', rest @ ..] = behind_head(text) else {
        return None;
    };
    let rest = rest.trim_ascii_start();
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    match digits {
        1..=9 => Some(rest[..digits].iter().fold(0, |n, d| n * 10 + u32::from(d - b'0'))),
        _ => None,
    }
}

/// True when a block may begin with WHILE, DO or END.
fn may_loop(text: &[u8]) -> bool {
    let mut rest = behind_head(text);
    if let [b'N' | b'n', behind @ ..] = rest {
        let behind = behind.trim_ascii_start();
        let digits = behind.iter().take_while(|b| b.is_ascii_digit()).count();
        rest = behind[digits..].trim_ascii_start();
    }
    matches!(rest, [b'W' | b'w' | b'D' | b'd' | b'E' | b'e', second, ..] if second.is_ascii_alphabetic())
}

/// Programs with a name have numbers from here on, made of their names; numbers that are written have eight digits at most.
const FIRST_NAMED: u32 = 1 << 31;

/// The number that stands for a program's name. Two names would have to agree in 31 bits of FNV-1a to be taken for one.
pub(crate) fn number_of_name(name: &[u8]) -> u32 {
    let hash = name.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
        (h ^ u64::from(b.to_ascii_uppercase())).wrapping_mul(0x0100_0000_01b3)
    });
    FIRST_NAMED | ((hash >> 32 ^ hash) as u32 & (FIRST_NAMED - 1))
}

/// The value of a word that is a name: a half behind the point, which no program number has.
pub(crate) fn word_of_name(name: &[u8]) -> f64 {
    f64::from(number_of_name(name)) + 0.5
}

/// The number behind such a word.
pub(crate) fn named_program(value: f64) -> Option<u32> {
    let named = value >= f64::from(FIRST_NAMED) && value - libm::trunc(value) == 0.5;
    named.then(|| libm::trunc(value).min(f64::from(u32::MAX)) as u32)
}

/// True for the number of a program with a name.
pub(crate) fn is_named(number: u32) -> bool {
    number >= FIRST_NAMED
}

/// The name between `<` and `>` at a byte, and the byte behind it: letters, digits, `-`, `+`, `_` and `.`, 32 at most.
pub(crate) fn name_at(text: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let inside = text.get(at..)?.strip_prefix(b"<")?;
    let length = inside.iter().position(|b| *b == b'>')?;
    let name = &inside[..length];
    let good = |b: &u8| b.is_ascii_alphanumeric() || b"-+_.".contains(b);
    ((1..=32).contains(&length) && name.iter().all(good)).then_some((name, at + length + 2))
}

/// The number of the program that this line begins: `O1234`, `:1234`, `<NAME>`.
pub(crate) fn program_number(text: &[u8]) -> Option<u32> {
    let rest = match text.trim_ascii_start() {
        [b'O' | b'o' | b':', rest @ ..] => rest.trim_ascii_start(),
        named @ [b'<', ..] => return name_at(named, 0).map(|(name, _)| number_of_name(name)),
        _ => return None,
    };
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    match digits {
        1..=8 => Some(rest[..digits].iter().fold(0, |n, d| n * 10 + u32::from(d - b'0'))),
        _ => None,
    }
}

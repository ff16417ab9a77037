//! A file in memory with its index: [`File`].
//!
//! Instances are rows of a table sorted by identifier ([`Row`]). The table costs about a third to a half of the file's size.

use crate::column::Column;
use crate::keywords::{Keywords, holds};
use crate::problem::{Position, Problem, ReadError};
use crate::scan::{Scan, next_reference, scan};
use crate::text::string_end;
use crate::value::{Instance, Parser, Value};
use std::collections::BTreeSet;
use std::ops::Range;

/// An instance's place in the table of its file, which is sorted by identifier.
///
/// It means something to the [`File`] it came from only: another one panics on it, or gives another instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Row(u32);

/// An entry of the HEADER section.
#[derive(Clone, Debug, PartialEq)]
pub struct HeaderEntry {
    /// `FILE_NAME`, `FILE_SCHEMA` ...
    pub keyword: String,
    /// Its parameters.
    pub arguments: Vec<Value<'static>>,
    /// Where it stands, semicolon included.
    pub span: Range<usize>,
}

/// A DATA section.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSection {
    /// Edition 2 and later: name and schema; mostly empty.
    pub parameters: Vec<Value<'static>>,
    /// Offset of its keyword.
    pub start: usize,
    /// Offset of its ENDSEC; `None` when the file ends before.
    pub end: Option<usize>,
}

/// An entry of the ANCHOR section: a name by which other files may point in here.
#[derive(Clone, Debug, PartialEq)]
pub struct Anchor {
    /// The name, without angle brackets.
    pub name: String,
    /// What it names.
    pub value: Value<'static>,
    /// Its tags `{name:value}`, in the order of the file.
    pub tags: Vec<(String, Value<'static>)>,
    /// Where it stands.
    pub offset: usize,
}

/// What an entry of the REFERENCE section defines in this file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExternalName {
    /// `#id`, an instance elsewhere.
    Entity(u64),
    /// `@id`, a value elsewhere.
    Value(u64),
}

/// An entry of the REFERENCE section: something that another file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct External {
    /// The name it has in here.
    pub name: ExternalName,
    /// Where it is, such as `plan.stpnc#main`.
    pub uri: String,
    /// Its tags `{name:value}`, in the order of the file. The standard gives tags to anchors only; some writers put them here as well.
    pub tags: Vec<(String, Value<'static>)>,
    /// Where it stands.
    pub offset: usize,
}

/// A Part 21 file: its bytes and the index over them.
pub struct File {
    pub(crate) bytes: Vec<u8>,
    ids: Column,
    offsets: Column,
    keywords: Vec<u16>,
    names: Keywords,
    /// `users[user_starts[row]..user_starts[row + 1]]` refer to `row`.
    user_starts: Vec<u32>,
    users: Vec<Row>,
    header: Vec<HeaderEntry>,
    data_sections: Vec<DataSection>,
    anchors: Vec<Anchor>,
    externals: Vec<External>,
    pub(crate) signatures: Vec<Range<usize>>,
    unclosed_comment: Option<usize>,
    highest_id: u64,
    problems: Vec<Problem>,
}

impl File {
    /// Indexes `bytes`; what is wrong with single instances is in [`File::problems`].
    ///
    /// # Errors
    /// When the bytes are no Part 21 file at all.
    pub fn read(bytes: Vec<u8>) -> Result<Self, ReadError> {
        let mut scan = scan(&bytes)?;
        let ranks = sort(&mut scan);
        let (user_starts, users, dangling) = invert(&scan, ranks.as_deref());
        if let Some((row, target)) = dangling.first {
            let offset = scan.offsets.get(row) as usize;
            let id = scan.ids.get(row);
            scan.problems.add("missing-instance", offset, || {
                format!(
                    "#{id} refers to #{target}, which the file does not hold; {} such references",
                    dangling.count
                )
            });
        }
        let Scan {
            ids,
            offsets,
            keywords,
            names,
            highest_id,
            header,
            data_sections,
            anchors,
            externals,
            signatures,
            unclosed_comment,
            problems,
            ..
        } = scan;
        Ok(Self {
            problems: problems.finish(&bytes),
            bytes,
            ids,
            offsets,
            keywords,
            names,
            user_starts,
            users,
            header,
            data_sections,
            anchors,
            externals,
            signatures,
            unclosed_comment,
            highest_id,
        })
    }

    /// The bytes as they were read.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// How many instances the index holds.
    pub fn len(&self) -> usize {
        self.keywords.len()
    }

    /// True when there are no instances.
    pub fn is_empty(&self) -> bool {
        self.keywords.is_empty()
    }

    /// All instances, by identifier.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = Row> + use<> {
        (0..self.keywords.len() as u32).map(Row)
    }

    /// The instance `#id`.
    pub fn row(&self, id: u64) -> Option<Row> {
        self.ids.find(id, 0, self.ids.len()).map(|place| Row(place as u32))
    }

    /// The identifier of an instance.
    pub fn id(&self, row: Row) -> u64 {
        self.ids.get(row.0 as usize)
    }

    /// Where an instance begins, in bytes from the start of the file.
    pub fn offset(&self, row: Row) -> usize {
        self.offsets.get(row.0 as usize) as usize
    }

    /// The entity name in upper case; of a complex instance all its names, blank-separated, in the order of the file.
    pub fn keyword(&self, row: Row) -> &str {
        self.names.name(self.keywords[row.0 as usize])
    }

    /// True when the instance is a `name` (upper case), or a complex one with that part.
    pub fn is(&self, row: Row, name: &str) -> bool {
        holds(self.keyword(row), name)
    }

    /// All instances that are a `name` (upper case), complex ones included, by identifier.
    pub fn by_keyword(&self, name: &str) -> impl Iterator<Item = Row> + '_ {
        self.by_name(|keyword| holds(keyword, name))
    }

    /// All instances whose keyword (see [`File::keyword`]) is one that `is_wanted` wants, by identifier; each name is asked for once.
    pub fn by_name(&self, is_wanted: impl Fn(&str) -> bool) -> impl Iterator<Item = Row> + '_ {
        let wanted = self.names.wanted(is_wanted);
        self.keywords
            .iter()
            .enumerate()
            .filter(move |(_, number)| wanted[usize::from(**number)])
            .map(|(place, _)| Row(place as u32))
    }

    /// The instances that refer to `row`, by identifier, each once.
    pub fn users(&self, row: Row) -> &[Row] {
        let place = row.0 as usize;
        &self.users[self.user_starts[place] as usize..self.user_starts[place + 1] as usize]
    }

    /// The instances that refer to `#id`; nothing for an unknown one.
    pub fn inverse(&self, id: u64) -> &[Row] {
        self.row(id).map_or(&[], |row| self.users(row))
    }

    /// Parses an instance.
    ///
    /// # Errors
    /// When its parameters are not well formed; the index only knows that its strings and parentheses are closed.
    pub fn instance(&self, row: Row) -> Result<Instance<'_>, Problem> {
        let mut parser = self.behind_equals(row);
        parser.instance().map_err(|fault| {
            let Position { line, column } = self.position(fault.offset);
            Problem {
                code: fault.code,
                message: format!("#{}: {}", self.id(row), fault.message),
                offset: fault.offset as u64,
                line,
                column,
                count: 1,
            }
        })
    }

    /// The bytes of an instance, from `#` to its semicolon.
    pub fn span(&self, row: Row) -> Range<usize> {
        let mut parser = self.behind_equals(row);
        while let Some(byte) = parser.peek() {
            match byte {
                b'\'' => parser.at = string_end(&self.bytes, parser.at + 1).unwrap_or(self.bytes.len()),
                b'/' if self.bytes.get(parser.at + 1) == Some(&b'*') => parser.skip_blanks(),
                _ => parser.at += 1,
            }
            if byte == b';' {
                break;
            }
        }
        self.offset(row)..parser.at
    }

    fn behind_equals(&self, row: Row) -> Parser<'_> {
        let mut parser = Parser::new(&self.bytes, self.offset(row) + 1);
        parser.unclosed_comment = self.unclosed_comment;
        parser.skip_blanks();
        parser.digits();
        parser.skip_blanks();
        parser.at += 1;
        parser
    }

    /// Line and column of an offset.
    pub fn position(&self, offset: usize) -> Position {
        Position::of(&self.bytes, offset)
    }

    /// The entries of the HEADER section.
    pub fn header(&self) -> &[HeaderEntry] {
        &self.header
    }

    /// The schema names of FILE_SCHEMA, upper case, without object identifiers in braces.
    pub fn schemas(&self) -> Vec<String> {
        let entry = self.header.iter().find(|entry| entry.keyword == "FILE_SCHEMA");
        let names = entry.and_then(|entry| entry.arguments.first()).map_or(&[][..], Value::items);
        names
            .iter()
            .filter_map(Value::text)
            .map(|name| name.split('{').next().unwrap_or("").trim().to_ascii_uppercase())
            .collect()
    }

    /// The DATA sections in order; identifiers are unique over all of them.
    pub fn data_sections(&self) -> &[DataSection] {
        &self.data_sections
    }

    /// The entries of the ANCHOR section.
    pub fn anchors(&self) -> &[Anchor] {
        &self.anchors
    }

    /// The entries of the REFERENCE section.
    pub fn externals(&self) -> &[External] {
        &self.externals
    }

    /// The uri behind `#id` when the REFERENCE section defines it.
    pub fn external(&self, id: u64) -> Option<&str> {
        let external = self
            .externals
            .iter()
            .find(|external| external.name == ExternalName::Entity(id))?;
        Some(&external.uri)
    }

    /// True when the file is signed; a changed one loses its signature.
    pub fn is_signed(&self) -> bool {
        !self.signatures.is_empty()
    }

    /// The highest identifier that the file uses anywhere, broken instances included.
    pub fn highest_id(&self) -> u64 {
        self.highest_id
    }

    /// What was wrong, one entry per kind, in the order of the file.
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }
}

/// Sorts the table by identifier; the answer is the rank of each instance of the file order, or `None` when it was sorted.
///
/// Of two instances with the same identifier the first is kept.
fn sort(scan: &mut Scan) -> Option<Vec<u32>> {
    if scan.ascending {
        return None;
    }
    let count = scan.ids.len();
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.sort_by_key(|&place| scan.ids.get(place as usize)); // stable: equal ones stay in file order
    let mut ranks = vec![u32::MAX; count];
    let mut kept: Vec<u32> = Vec::with_capacity(count);
    for &place in &order {
        let id = scan.ids.get(place as usize);
        if kept.last().is_some_and(|&last| scan.ids.get(last as usize) == id) {
            let offset = scan.offsets.get(place as usize) as usize;
            scan.problems.add("duplicate-identifier", offset, || {
                format!("#{id} is defined twice: the first definition holds")
            });
            continue;
        }
        ranks[place as usize] = kept.len() as u32;
        kept.push(place);
    }
    drop(order);
    // The forward stream stays in file order, so the identifiers that it is relative to are looked up through the ranks.
    scan.ids = std::mem::replace(&mut scan.ids, Column::new()).reordered(&kept);
    scan.offsets = std::mem::replace(&mut scan.offsets, Column::new()).reordered(&kept);
    scan.keywords = kept.iter().map(|&old| scan.keywords[old as usize]).collect();
    Some(ranks)
}

/// References to instances that neither the file holds nor its REFERENCE section names.
#[derive(Default)]
struct Dangling {
    /// Row of the first user, and its target.
    first: Option<(usize, u64)>,
    count: u64,
}

/// Turns "refers to" into "is referred to by": the starts and the users, each list sorted and without repetition.
fn invert(scan: &Scan, ranks: Option<&[u32]>) -> (Vec<u32>, Vec<Row>, Dangling) {
    let rows = scan.ids.len();
    let mut starts = vec![0u32; rows + 1];
    let mut dangling = Dangling::default();
    let elsewhere: BTreeSet<u64> = scan
        .externals
        .iter()
        .filter_map(|external| match external.name {
            ExternalName::Entity(id) => Some(id),
            ExternalName::Value(_) => None,
        })
        .collect();
    each_reference(scan, ranks, |user, target, found| match found {
        Some(row) => starts[row + 1] += 1,
        None if elsewhere.contains(&target) => {}
        None => {
            dangling.count += 1;
            dangling.first.get_or_insert((user, target));
        }
    });
    for row in 0..rows {
        starts[row + 1] += starts[row];
    }
    let mut users = vec![Row(0); starts[rows] as usize];
    // Each start serves as the cursor of its list and ends up as the next list's start.
    each_reference(scan, ranks, |user, _, found| {
        if let Some(row) = found {
            users[starts[row] as usize] = Row(user as u32);
            starts[row] += 1;
        }
    });
    let mut write = 0usize;
    let mut read = 0usize;
    for start in starts.iter_mut().take(rows) {
        let end = *start as usize;
        if ranks.is_some() {
            users[read..end].sort_unstable();
        }
        *start = write as u32;
        let first = write;
        for place in read..end {
            let user = users[place];
            if write == first || users[write - 1] != user {
                users[write] = user;
                write += 1;
            }
        }
        read = end;
    }
    starts[rows] = write as u32;
    users.truncate(write);
    users.shrink_to_fit();
    (starts, users, dangling)
}

/// Calls `visit(user row, target identifier, target row)` for every reference of every indexed instance.
fn each_reference(scan: &Scan, ranks: Option<&[u32]>, mut visit: impl FnMut(usize, u64, Option<usize>)) {
    let mut at = 0usize;
    let count = ranks.map_or(scan.ids.len(), <[u32]>::len);
    for place in 0..count {
        let user = ranks.map_or(place, |ranks| ranks[place] as usize);
        if user == u32::MAX as usize {
            // A second definition of an identifier: its references do not count, but must be read over.
            while next_reference(&scan.forward, &mut at, 0).is_some() {}
            continue;
        }
        let id = scan.ids.get(user);
        while let Some(target) = next_reference(&scan.forward, &mut at, id) {
            visit(user, target, near(&scan.ids, user, id, target));
        }
    }
}

/// The row of `target`, which is at most as many rows away from `user` as the identifiers differ.
fn near(ids: &Column, user: usize, id: u64, target: u64) -> Option<usize> {
    let count = ids.len();
    if target >= id {
        let far = usize::try_from(target - id).map_or(count - 1, |d| user.saturating_add(d).min(count - 1));
        if ids.get(far) == target {
            return Some(far);
        }
        ids.find(target, user, far)
    } else {
        let far = usize::try_from(id - target).map_or(0, |d| user.saturating_sub(d));
        if ids.get(far) == target {
            return Some(far);
        }
        ids.find(target, far, user)
    }
}

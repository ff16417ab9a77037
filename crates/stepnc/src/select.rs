//! Finding a part of a program by what a person calls it: [`select`].
//!
//! A path is `#id`, or names joined by `/` that end at the part meant: `WS 1 face`, `PLATE MAIN/WS 1 face/face pass 1`. In a name `\/` is
//! a slash, and `[2]` behind it picks the second of equally named neighbours.

use crate::model::{ExecutableKind, Program};

/// A part of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Something that is executed.
    Executable(u64),
    /// A toolpath.
    Toolpath(u64),
}

impl Part {
    /// Its instance.
    pub fn id(self) -> u64 {
        match self {
            Part::Executable(id) | Part::Toolpath(id) => id,
        }
    }
}

/// A part where it stands: what is executed at several places is one part with several of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The part.
    pub part: Part,
    /// What it stands in: an executable, or the operation of a toolpath; `None` for a main workplan.
    pub parent: Option<u64>,
    /// Which of the places in that parent, from 0.
    pub turn: usize,
}

/// Why a path leads nowhere, or to too many places.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SelectError {
    /// Nothing is called that.
    #[error("nothing in the program is called '{0}'")]
    NotFound(String),
    /// Several things are; the paths that tell them apart.
    #[error("'{path}' could be any of: {}", candidates.join(", "))]
    Ambiguous {
        /// What was asked for.
        path: String,
        /// Full paths with identifiers.
        candidates: Vec<String>,
    },
}

/// The part of the plans (or, without any, of the twins) that `path` means.
///
/// # Errors
/// When nothing, or more than one thing, is called that.
pub fn select(program: &Program, path: &str) -> Result<Part, SelectError> {
    let found = find(program, path);
    // A shared part is one part, however often it is executed.
    let mut parts: Vec<Part> = Vec::new();
    for (spot, _) in &found {
        if !parts.contains(&spot.part) {
            parts.push(spot.part);
        }
    }
    match parts.as_slice() {
        [] => Err(SelectError::NotFound(path.to_string())),
        [only] => Ok(*only),
        _ => Err(ambiguous(path, found)),
    }
}

/// The one place that `path` means: a shared part has to be told by the names around it.
///
/// # Errors
/// When nothing, or more than one place, is called that.
pub fn select_spot(program: &Program, path: &str) -> Result<Spot, SelectError> {
    let found = find(program, path);
    let Some(&(spot, _)) = found.first() else {
        return Err(SelectError::NotFound(path.to_string()));
    };
    // What stands in a workplan that is executed twice stands there once.
    if found.iter().all(|(other, _)| *other == spot) {
        return Ok(spot);
    }
    Err(ambiguous(path, found))
}

/// A name as a path has it.
fn spelled(name: &str, rank: usize) -> String {
    let rank = if rank > 1 { format!("[{rank}]") } else { String::new() };
    name.replace('/', "\\/") + &rank
}

fn ambiguous(path: &str, found: Vec<(Spot, String)>) -> SelectError {
    SelectError::Ambiguous {
        path: path.to_string(),
        candidates: found
            .into_iter()
            .map(|(spot, name)| format!("{name} (#{})", spot.part.id()))
            .collect(),
    }
}

fn find(program: &Program, path: &str) -> Vec<(Spot, String)> {
    let entity = path.strip_prefix('#').and_then(|id| id.parse::<u64>().ok());
    if let Some(id) = entity {
        let found = find_wanted(program, Wanted::Entity(id));
        if !found.is_empty() {
            return found;
        }
    }
    find_wanted(program, Wanted::Names(split(path)))
}

fn find_wanted(program: &Program, wanted: Wanted) -> Vec<(Spot, String)> {
    let mut search = Search {
        program,
        wanted,
        found: Vec::new(),
        visited: 0,
    };
    let only_twins = program.plan().is_none();
    let roots = program.projects().iter().filter(|project| only_twins || !project.is_twin);
    let roots: Vec<Part> = roots.map(|project| Part::Executable(project.main_workplan)).collect();
    search.level(&roots, None, &mut Vec::new());
    search.found
}

enum Wanted {
    Entity(u64),
    Names(Vec<WantedName>),
}

/// A name of a path. Parts may really be called `hole[2]`, so both readings fit.
struct WantedName {
    /// The whole of it.
    whole: String,
    /// Without `[n]`, and which of equals, from 1.
    ranked: Option<(String, usize)>,
}

/// Splits at slashes that are not escaped.
fn split(path: &str) -> Vec<WantedName> {
    let mut names = vec![String::new()];
    let mut characters = path.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '\\' if characters.peek() == Some(&'/') => {
                characters.next();
                names.last_mut().expect("it began with one").push('/');
            }
            '/' => names.push(String::new()),
            _ => names.last_mut().expect("it began with one").push(character),
        }
    }
    let wanted = |whole: String| {
        let split = whole.strip_suffix(']').and_then(|head| head.rsplit_once('['));
        let ranked = split.and_then(|(head, n)| Some((head.to_string(), n.parse::<usize>().ok()?)));
        WantedName { whole, ranked }
    };
    names.into_iter().map(wanted).collect()
}

struct Search<'p> {
    program: &'p Program,
    wanted: Wanted,
    found: Vec<(Spot, String)>,
    visited: u64,
}

impl Search<'_> {
    /// Looks at neighbours; `above` are the names and ranks of what is around them.
    fn level(&mut self, parts: &[Part], parent: Option<u64>, above: &mut Vec<(String, usize, u64)>) {
        let mut seen: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
        for (place, &part) in parts.iter().enumerate() {
            self.visited += 1;
            if self.visited > 1_000_000 || above.iter().any(|around| around.2 == part.id()) {
                continue;
            }
            let (name, inside, below) = self.open(part);
            let rank = seen.entry(name.clone()).or_insert(0);
            *rank += 1;
            above.push((name, *rank, part.id()));
            if self.fits(part, above) {
                let names: Vec<String> = above.iter().map(|(name, rank, _)| spelled(name, *rank)).collect();
                let turn = parts[..place].iter().filter(|before| **before == part).count();
                self.found.push((Spot { part, parent, turn }, names.join("/")));
            }
            self.level(&below, Some(inside), above);
            above.pop();
        }
    }

    /// A part's name, what holds the parts below it, and these.
    fn open(&self, part: Part) -> (String, u64, Vec<Part>) {
        match part {
            Part::Toolpath(id) => {
                let name = self
                    .program
                    .aim()
                    .instance(id)
                    .map(|path| crate::aim::text(path.argument(0)).into_owned());
                (name.unwrap_or_default(), id, Vec::new())
            }
            Part::Executable(id) => {
                let Some(executable) = self.program.executable(id) else {
                    return Default::default();
                };
                let mut inside = id;
                let below = match executable.kind {
                    ExecutableKind::Workingstep { operation, .. } => {
                        inside = operation.unwrap_or(id);
                        let operation = operation.and_then(|id| self.program.operation(id));
                        operation
                            .map_or(&[][..], |operation| &operation.toolpaths)
                            .iter()
                            .map(|&id| Part::Toolpath(id))
                            .collect()
                    }
                    _ => executable.children().into_iter().map(Part::Executable).collect(),
                };
                (executable.name.clone(), inside, below)
            }
        }
    }

    fn fits(&self, part: Part, above: &[(String, usize, u64)]) -> bool {
        match &self.wanted {
            Wanted::Entity(id) => part.id() == *id,
            Wanted::Names(names) => {
                names.len() <= above.len()
                    && names.iter().rev().zip(above.iter().rev()).all(|(name, (around, rank, _))| {
                        let ranked = |(head, n): &(String, usize)| head == around && n == rank;
                        name.whole == *around || name.ranked.as_ref().is_some_and(ranked)
                    })
            }
        }
    }
}

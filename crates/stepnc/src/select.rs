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
    let wanted = match path.strip_prefix('#').and_then(|id| id.parse::<u64>().ok()) {
        Some(id) => Wanted::Entity(id),
        None => Wanted::Names(split(path)),
    };
    let mut search = Search {
        program,
        wanted,
        found: Vec::new(),
        visited: 0,
    };
    let only_twins = program.plan().is_none();
    let roots = program.projects().iter().filter(|project| only_twins || !project.is_twin);
    let roots: Vec<Part> = roots.map(|project| Part::Executable(project.main_workplan)).collect();
    search.level(&roots, &mut Vec::new());
    // A shared part is one part, however often it is executed.
    let mut parts: Vec<Part> = Vec::new();
    for (part, _) in &search.found {
        if !parts.contains(part) {
            parts.push(*part);
        }
    }
    match parts.as_slice() {
        [] => Err(SelectError::NotFound(path.to_string())),
        [only] => Ok(*only),
        _ => Err(SelectError::Ambiguous {
            path: path.to_string(),
            candidates: search
                .found
                .into_iter()
                .map(|(part, name)| format!("{name} (#{})", part.id()))
                .collect(),
        }),
    }
}

enum Wanted {
    Entity(u64),
    /// Name and, when given, which of equals, from 1.
    Names(Vec<(String, Option<usize>)>),
}

/// Splits at slashes that are not escaped and takes `[n]` off.
fn split(path: &str) -> Vec<(String, Option<usize>)> {
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
    let number = |name: String| {
        let split = name.strip_suffix(']').and_then(|head| head.rsplit_once('['));
        match split.and_then(|(head, n)| Some((head.to_string(), n.parse::<usize>().ok()?))) {
            Some((head, n)) => (head, Some(n)),
            None => (name, None),
        }
    };
    names.into_iter().map(number).collect()
}

struct Search<'p> {
    program: &'p Program,
    wanted: Wanted,
    found: Vec<(Part, String)>,
    visited: u64,
}

impl Search<'_> {
    /// Looks at neighbours; `above` are the names and ranks of what is around them.
    fn level(&mut self, parts: &[Part], above: &mut Vec<(String, usize, u64)>) {
        let mut seen: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
        for &part in parts {
            self.visited += 1;
            if self.visited > 1_000_000 || above.iter().any(|around| around.2 == part.id()) {
                continue;
            }
            let (name, below) = self.open(part);
            let rank = seen.entry(name.clone()).or_insert(0);
            *rank += 1;
            above.push((name, *rank, part.id()));
            if self.fits(part, above) {
                let names: Vec<String> = above.iter().map(|around| around.0.replace('/', "\\/")).collect();
                self.found.push((part, names.join("/")));
            }
            self.level(&below, above);
            above.pop();
        }
    }

    fn open(&self, part: Part) -> (String, Vec<Part>) {
        match part {
            Part::Toolpath(id) => {
                let name = self
                    .program
                    .aim()
                    .instance(id)
                    .map(|path| crate::aim::text(path.argument(0)).into_owned());
                (name.unwrap_or_default(), Vec::new())
            }
            Part::Executable(id) => {
                let Some(executable) = self.program.executable(id) else {
                    return Default::default();
                };
                let below = match executable.kind {
                    ExecutableKind::Workingstep { operation, .. } => {
                        let operation = operation.and_then(|id| self.program.operation(id));
                        operation
                            .map_or(&[][..], |operation| &operation.toolpaths)
                            .iter()
                            .map(|&id| Part::Toolpath(id))
                            .collect()
                    }
                    _ => executable.children().into_iter().map(Part::Executable).collect(),
                };
                (executable.name.clone(), below)
            }
        }
    }

    fn fits(&self, part: Part, above: &[(String, usize, u64)]) -> bool {
        match &self.wanted {
            Wanted::Entity(id) => part.id() == *id,
            Wanted::Names(names) => {
                names.len() <= above.len()
                    && names
                        .iter()
                        .rev()
                        .zip(above.iter().rev())
                        .all(|((name, rank), around)| *name == around.0 && rank.is_none_or(|rank| rank == around.1))
            }
        }
    }
}

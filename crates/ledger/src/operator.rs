//! Operators: who has which level, how long, and who may give it.
//!
//! Where they are kept is the store's; what may be done with them is decided here, so that every way to it decides the same.

use crate::rights::{self, Action, Level, NotAllowed};
use thiserror::Error;
use units::Timestamp;

/// Somebody who works at the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Operator {
    /// The name: what signs in, and what stands in the log.
    pub name: String,
    /// The level that was given; `None` when it was taken away again.
    pub level: Option<Level>,
    /// What the person has learned, in words.
    pub experience: String,
    /// Company or department.
    pub organization: String,
    /// What the person does there: setter, shift leader.
    pub role: String,
    /// When the person works: early, late, night.
    pub shift: String,
    /// When the qualification ends; `None` when it does not.
    pub qualified_until: Option<Timestamp>,
}

impl Operator {
    /// A new operator of a level, of whom nothing else is known.
    pub fn new(name: &str, level: Level) -> Operator {
        Operator {
            name: name.to_owned(),
            level: Some(level),
            experience: String::new(),
            organization: String::new(),
            role: String::new(),
            shift: String::new(),
            qualified_until: None,
        }
    }

    /// True when the qualification is over.
    pub fn has_lapsed(&self, now: Timestamp) -> bool {
        self.qualified_until.is_some_and(|until| now >= until)
    }

    /// The level in force: a lapsed qualification counts as 10, a level that was taken away is none.
    pub fn level_at(&self, now: Timestamp) -> Option<Level> {
        self.level
            .map(|level| if self.has_lapsed(now) { Level::LOWEST } else { level })
    }
}

/// Why a name cannot be an operator's.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NameError {
    /// There is nothing to read.
    #[error("an operator needs a name")]
    Empty,
    /// Nobody reads so much.
    #[error("the name has {0} characters; {MOST_CHARACTERS} are enough for a name")]
    TooLong(usize),
    /// A line break, or a mark that makes it look like another name.
    #[error("the name {0:?} has a character that nobody can see: leave it out")]
    Unseen(String),
    /// It stands for something else.
    #[error("the name {0:?} is what the program itself writes for somebody: choose another one")]
    Reserved(String),
}

/// The longest name.
pub const MOST_CHARACTERS: usize = 80;
/// Who acts where there are no operators yet.
pub const LOCAL: &str = "local";
/// Behind the name of a system user that acts where there are no operators yet.
pub const BY_THE_SYSTEM: &str = "(authenticated by the system)";

/// A name as it is kept: without blanks around it.
///
/// # Errors
/// It is empty, too long, reserved, or looks like another one.
pub fn checked_name(name: &str) -> Result<String, NameError> {
    let name = name.trim();
    if name.is_empty() {
        return Err(NameError::Empty);
    }
    let count = name.chars().count();
    if count > MOST_CHARACTERS {
        return Err(NameError::TooLong(count));
    }
    if name.chars().any(is_unseen) {
        return Err(NameError::Unseen(name.to_owned()));
    }
    let lower = name.to_lowercase();
    let reserved = [LOCAL, "nobody", "system", "demo"];
    if reserved.contains(&lower.as_str()) || lower.contains("authenticated by") || lower.starts_with("somebody at") {
        return Err(NameError::Reserved(name.to_owned()));
    }
    Ok(name.to_owned())
}

/// Control characters, and marks of Unicode without a shape: they make two names look alike.
fn is_unseen(c: char) -> bool {
    c.is_control()
        || matches!(u32::from(c), 0xAD | 0x34F | 0x61C | 0x115F..=0x1160 | 0x17B4..=0x17B5 | 0x180B..=0x180F | 0x200B..=0x200F
            | 0x2028..=0x202E | 0x2060..=0x206F | 0x3164 | 0xFE00..=0xFE0F | 0xFEFF | 0xFFA0 | 0xFFF0..=0xFFFB | 0xE0000..=0xE0FFF)
}

/// Why an operator is not made or changed so.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AssignError {
    /// The level does not allow it.
    #[error(transparent)]
    NotAllowed(#[from] NotAllowed),
    /// The first one has to be able to make all others.
    #[error(
        "the first operator has level 1 and a qualification without an end: from then on only levels 1 and 2 give levels, and \
         somebody has to be there who can"
    )]
    FirstIsHighest,
    /// A level beyond the giver's.
    #[error("level {given} is stronger than level {own} of who gives it: nobody gives, changes or takes away a stronger level")]
    Stronger {
        /// The level in question.
        given: Level,
        /// Who gives it.
        own: Level,
    },
    /// Nobody would be left.
    #[error(
        "{0} is the last operator of level 1 whose qualification does not end: without one, nobody could give levels any more; make \
         another one first"
    )]
    LastOfTheHighest(String),
    /// A name that a person would mix up with it.
    #[error("there is an operator {0} already, which looks the same: choose a name that can be told apart")]
    LooksTheSame(String),
}

/// Asks whether `after` may stand among `people`, given by somebody of level `by`; `None` is not signed in. Where there are no operators
/// yet, `by` is the `local` user's level 1.
///
/// # Errors
/// Why not.
pub fn may_assign(people: &[Operator], after: &Operator, by: Option<Level>) -> Result<(), AssignError> {
    rights::may(by, Action::Assign)?;
    let lower = after.name.to_lowercase();
    if let Some(other) = people.iter().find(|p| p.name != after.name && p.name.to_lowercase() == lower) {
        return Err(AssignError::LooksTheSame(other.name.clone()));
    }
    let endless = |person: &Operator| person.level == Some(Level::HIGHEST) && person.qualified_until.is_none();
    if people.is_empty() {
        return if endless(after) {
            Ok(())
        } else {
            Err(AssignError::FirstIsHighest)
        };
    }
    let before = people.iter().find(|p| p.name == after.name);
    let own = by.unwrap_or(Level::LOWEST);
    for given in before.and_then(|b| b.level).into_iter().chain(after.level) {
        if !own.reaches(given) {
            return Err(AssignError::Stronger { given, own });
        }
    }
    let others = people.iter().filter(|p| p.name != after.name);
    if before.is_some_and(endless) && !endless(after) && !others.into_iter().any(endless) {
        return Err(AssignError::LastOfTheHighest(after.name.clone()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(number: u8) -> Level {
        Level::new(number).expect("a level")
    }
    fn person(name: &str, number: u8) -> Operator {
        Operator::new(name, level(number))
    }

    #[track_caller]
    fn check(people: &[Operator], after: &Operator, by: u8, expected: &str) {
        let found = may_assign(people, after, Level::new(by)).map_or_else(|e| e.to_string(), |()| "allowed".to_owned());
        assert!(found.contains(expected), "{found}");
    }

    #[test]
    fn the_first_operator_is_the_highest_and_stays_so() {
        check(&[], &person("Maria", 1), 1, "allowed");
        check(&[], &person("Maria", 2), 1, "the first operator has level 1");
        let mut dated = person("Maria", 1);
        dated.qualified_until = Some(Timestamp(5));
        check(&[], &dated, 1, "without an end");
        let people = [person("Maria", 1), person("Jo", 2)];
        check(&people, &person("Maria", 3), 1, "the last operator of level 1");
        check(&people, &dated, 1, "the last operator of level 1");
        let gone = Operator {
            level: None,
            ..person("Maria", 1)
        };
        check(&people, &gone, 1, "the last operator of level 1");
        let two = [person("Maria", 1), person("Jo", 1)];
        check(&two, &gone, 1, "allowed");
    }

    #[test]
    fn only_levels_one_and_two_assign_and_never_beyond_their_own() {
        let people = [person("Maria", 1), person("Jo", 2), person("Ann", 5)];
        check(&people, &person("New", 10), 2, "allowed");
        check(&people, &person("New", 10), 3, "takes level 2 or better, and this is level 3");
        check(&people, &person("New", 1), 2, "level 1 is stronger than level 2");
        check(&people, &person("Maria", 10), 2, "level 1 is stronger than level 2");
        check(&people, &person("Ann", 2), 2, "allowed");
        check(&people, &person("New", 10), 0, "nobody is signed in");
    }

    #[test]
    fn names_that_look_alike_are_one_name() {
        let people = [person("Maria", 1)];
        check(&people, &person("MARIA", 5), 1, "there is an operator Maria already");
        assert_eq!(checked_name("  Jörg Ø 李  "), Ok("Jörg Ø 李".to_owned()));
        assert_eq!(
            checked_name("Robert'); DROP TABLE operators;--"),
            Ok("Robert'); DROP TABLE operators;--".to_owned())
        );
        assert_eq!(checked_name(" \t "), Err(NameError::Empty));
        for odd in ["Ma\u{200b}ria", "Maria\u{202e}", "a\nb", "nul\0", "\u{feff}Maria"] {
            assert!(matches!(checked_name(odd), Err(NameError::Unseen(_))), "{odd:?}");
        }
        for taken in [
            "local",
            "LOCAL",
            "root (authenticated by the system)",
            "somebody at the control",
        ] {
            assert!(matches!(checked_name(taken), Err(NameError::Reserved(_))), "{taken:?}");
        }
        assert!(matches!(checked_name(&"x".repeat(81)), Err(NameError::TooLong(81))));
    }

    #[test]
    fn a_lapsed_qualification_counts_as_ten_from_its_moment_on() {
        let mut operator = person("Maria", 3);
        operator.qualified_until = Some(Timestamp(100));
        assert_eq!(operator.level_at(Timestamp(99)), Some(level(3)));
        assert_eq!(operator.level_at(Timestamp(100)), Some(Level::LOWEST));
        operator.level = None;
        assert_eq!(operator.level_at(Timestamp(1)), None);
    }
}

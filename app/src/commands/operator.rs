//! `toolmark operator`: who works here, with which level, and who gave it.

use super::{Done, print_json};
use crate::cli::Common;
use crate::failure::{Exit, Failure};
use crate::people::{Acting, system_user};
use crate::{clock, say, shop};
use clap::{Args, Subcommand};
use ledger::operator::checked_name;
use ledger::{Action, Level, Operator};
use serde_json::{Value, json};
use store::operators::operator_of;
use store::{Assignment, DataDirectory, KeptOperator, StoreError};
use units::Timestamp;

/// `toolmark operator ...`
#[derive(Debug, Subcommand)]
pub enum OperatorCommand {
    /// Make an operator. The first one gets level 1; from then on only levels 1 and 2 give levels, and never one beyond their own.
    Add(AddArgs),
    /// Change what is known of an operator: the level, the qualification.
    Change(ChangeArgs),
    /// Take an operator's level away: the name stays in the log, and nobody can act by it any more.
    Remove(NameArgs),
    /// Take back what an event did to an operator, as long as nothing was done under that name since.
    Undo(UndoArgs),
    /// All operators, their levels and who gave them.
    List,
    /// What each level may, as a table.
    Rights,
}

/// `toolmark operator add`
#[derive(Debug, Args)]
pub struct AddArgs {
    /// The name: what signs in, and what stands in the log. A name of the system's user signs in by itself.
    pub name: String,
    /// 1 (highest) to 10 [default: 10; 1 for the first operator].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=10))]
    pub level: Option<u8>,
    /// What else is known.
    #[command(flatten)]
    pub known: KnownArgs,
}

/// `toolmark operator change`
#[derive(Debug, Args)]
pub struct ChangeArgs {
    /// The operator.
    pub name: String,
    /// 1 (highest) to 10.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=10))]
    pub level: Option<u8>,
    /// What else is known.
    #[command(flatten)]
    pub known: KnownArgs,
}

/// What is known of an operator besides the level.
#[derive(Debug, Args)]
pub struct KnownArgs {
    /// What the person has learned.
    #[arg(long, value_name = "TEXT")]
    pub experience: Option<String>,
    /// When the qualification ends: a day (until its end, UTC) or a time, RFC 3339; `never` takes an end away. Past it, level 10 counts.
    #[arg(long, value_name = "DATE")]
    pub qualified_until: Option<String>,
    /// Company or department.
    #[arg(long, value_name = "TEXT")]
    pub organization: Option<String>,
    /// What the person does: setter, shift leader.
    #[arg(long, value_name = "TEXT")]
    pub role: Option<String>,
    /// When the person works.
    #[arg(long, value_name = "TEXT")]
    pub shift: Option<String>,
}

/// An operator by name.
#[derive(Debug, Args)]
pub struct NameArgs {
    /// The operator.
    pub name: String,
}

/// `toolmark operator undo`
#[derive(Debug, Args)]
pub struct UndoArgs {
    /// Number of the event, as `operator list` shows it.
    pub event: u64,
}

/// Runs the command.
///
/// # Errors
/// Wrong usage, no right to it, or the data directory is in use.
pub fn operator(command: &OperatorCommand, common: &Common) -> Done {
    match command {
        OperatorCommand::Add(args) => add(args, common),
        OperatorCommand::Change(args) => change(args, common),
        OperatorCommand::Remove(args) => remove(args, common),
        OperatorCommand::Undo(args) => undo(args, common),
        OperatorCommand::List => list(common),
        OperatorCommand::Rights => rights(common),
    }
}

fn add(args: &AddArgs, common: &Common) -> Done {
    let name = checked_name(&args.name).map_err(Failure::usage)?;
    let mut desk = Desk::open(common)?;
    let first = desk.people.is_empty();
    let before = desk.find(&name).cloned();
    if let Some(known) = before.as_ref().filter(|known| known.operator.level.is_some()) {
        return Err(Failure::usage(format_args!(
            "there is an operator {} already (level {}): toolmark operator change alters it",
            known.operator.name,
            words_of_level(known.operator.level)
        )));
    }
    let level = args.level.unwrap_or(if first { 1 } else { 10 });
    let mut after = Operator::new(&name, Level::new(level).expect("the command line asks for 1 to 10"));
    args.known.put_into(&mut after)?;
    let why = if first { "the first operator" } else { "a new operator" };
    desk.assign(&after, why, None, common)
}

fn change(args: &ChangeArgs, common: &Common) -> Done {
    let mut desk = Desk::open(common)?;
    let kept = desk.known(&args.name)?;
    let mut after = kept.operator.clone();
    if let Some(level) = args.level {
        after.level = Level::new(level);
    }
    args.known.put_into(&mut after)?;
    if after == kept.operator {
        return Err(Failure::usage(format_args!(
            "nothing would change of {}: give --level, --qualified-until, --experience ...",
            kept.operator.name
        )));
    }
    desk.assign(&after, "changed", None, common)
}

fn remove(args: &NameArgs, common: &Common) -> Done {
    let mut desk = Desk::open(common)?;
    let kept = desk.known(&args.name)?;
    if kept.operator.level.is_none() {
        return Err(Failure::usage(format_args!("{} has no level any more", kept.operator.name)));
    }
    let after = Operator {
        level: None,
        ..kept.operator
    };
    desk.assign(&after, "taken away", None, common)
}

fn undo(args: &UndoArgs, common: &Common) -> Done {
    let mut desk = Desk::open(common)?;
    let event = desk.directory.event(args.event).map_err(shop::failure)?;
    let told = event.filter(|event| event.kind == "operator-assigned");
    let Some((after, event)) = told.and_then(|event| Some((operator_of(&json!(event.detail))?, event))) else {
        return Err(Failure::usage(format_args!(
            "event {} made or changed no operator: toolmark operator list shows their numbers",
            args.event
        )));
    };
    let kept = desk.known(&after.name)?;
    if kept.event != event.sequence {
        return Err(Failure::negative(format_args!(
            "error: event {} changed {} since: take that one back first",
            kept.event, after.name
        )));
    }
    if let Some(deed) = desk.directory.last_deed(&after.name, event.sequence).map_err(shop::failure)? {
        return Err(Failure::negative(format_args!(
            "error: {} has acted since (event {}, {}): it stays in the log; change or remove the operator instead",
            after.name, deed.sequence, deed.kind
        )));
    }
    let Some(reason) = common.reason.as_deref().filter(|reason| !reason.trim().is_empty()) else {
        return Err(Failure::usage("taking something back needs a reason: give --reason TEXT"));
    };
    let why = format!("undo of event {}: {reason}", event.sequence);
    // Made by that event: there was none before, and there is none again.
    let before = event.detail.get("before").and_then(operator_of);
    let back = before.unwrap_or(Operator { level: None, ..after });
    desk.assign(&back, &why, Some(event.sequence), common)
}

/// The data directory, who acts, and who there is.
struct Desk {
    directory: DataDirectory,
    acting: Acting,
    people: Vec<KeptOperator>,
    at: Timestamp,
}

impl Desk {
    fn open(common: &Common) -> Result<Desk, Failure> {
        let at = clock::start_time(common.start.as_deref())?;
        let mut directory = shop::data_directory(common)?;
        let acting = Acting::of(&directory, common)?;
        acting.must(Action::Assign, &mut directory, at)?;
        let people = directory.operators().map_err(shop::failure)?;
        Ok(Desk {
            directory,
            acting,
            people,
            at,
        })
    }

    fn find(&self, name: &str) -> Option<&KeptOperator> {
        self.people.iter().find(|kept| kept.operator.name == name)
    }

    fn known(&self, name: &str) -> Result<KeptOperator, Failure> {
        let name = name.trim();
        self.find(name).cloned().ok_or_else(|| {
            let names: Vec<&str> = self.people.iter().map(|kept| kept.operator.name.as_str()).collect();
            Failure::usage(match names.as_slice() {
                [] => format!("there is no operator {name:?}; there are none yet, toolmark operator add makes the first"),
                names => format!("there is no operator {name:?}; there are {}", names.join(", ")),
            })
        })
    }

    fn assign(&mut self, after: &Operator, otherwise: &str, undoes: Option<u64>, common: &Common) -> Done {
        let reason = common.reason.as_deref().filter(|reason| !reason.trim().is_empty());
        let why = if undoes.is_some() {
            otherwise
        } else {
            reason.unwrap_or(otherwise)
        };
        let before = self.find(&after.name).map(|kept| kept.operator.clone());
        let event = self.directory.assign_operator(&Assignment {
            after,
            by_level: self.acting.level,
            who: &self.acting.name,
            why,
            at: self.at,
            undoes,
        });
        let event = match event {
            Ok(event) => event,
            Err(error) => {
                // The rule that a person met stands in the log, as every refusal of a right; a slip of usage does not.
                if matches!(error, StoreError::Assign(_)) && error.exit_code() == 1 {
                    let mut detail = self.acting.detail();
                    detail.insert("action".to_owned(), Action::Assign.word().into());
                    detail.insert("operator".to_owned(), after.name.as_str().into());
                    detail.insert("because".to_owned(), error.to_string().into());
                    self.directory.append(self.at, "refused", detail).map_err(shop::failure)?;
                }
                return Err(shop::failure(error));
            }
        };
        if common.json {
            print_json(&json!({
                "operator": told(after, &self.acting.name, event.sequence, self.at),
                "before": before.as_ref().map(|b| b.level.map(Level::number)),
                "by": self.acting.json(),
                "why": why,
                "event": event.sequence,
            }))?;
            return Ok(Exit::Good);
        }
        say(&format!(
            "{}: level {} -> {}, by {}; {why} (event {})",
            after.name,
            before.map_or("none".to_owned(), |b| words_of_level(b.level)),
            words_of_level(after.level),
            self.acting.words(),
            event.sequence
        ));
        if let Some(until) = after.qualified_until {
            say(&format!("  qualified until {}", clock::utc(until)));
            if after.has_lapsed(self.at) {
                say("  warning: that is over already, and counts as level 10");
            }
        }
        if self.people.is_empty() {
            say("  from now on only operators of levels 1 and 2 give levels, and who is no operator looks, stops and holds only");
            let user = system_user();
            if after.name != user {
                say(&format!(
                    "  {user} is the system's user and no operator: give --operator, or add it by that name"
                ));
            }
        }
        Ok(Exit::Good)
    }
}

impl KnownArgs {
    fn put_into(&self, operator: &mut Operator) -> Result<(), Failure> {
        let text = |option: &str, given: &Option<String>, into: &mut String| -> Result<(), Failure> {
            let Some(given) = given else { return Ok(()) };
            let given = given.trim();
            if given.chars().count() > MOST_TEXT || given.chars().any(|c| c.is_control() && c != '\n' && c != '\t') {
                return Err(Failure::usage(format_args!(
                    "--{option}: at most {MOST_TEXT} characters of text were expected"
                )));
            }
            given.clone_into(into);
            Ok(())
        };
        text("experience", &self.experience, &mut operator.experience)?;
        text("organization", &self.organization, &mut operator.organization)?;
        text("role", &self.role, &mut operator.role)?;
        text("shift", &self.shift, &mut operator.shift)?;
        if let Some(date) = &self.qualified_until {
            operator.qualified_until = end_of_qualification(date)?;
        }
        Ok(())
    }
}

/// The longest text about a person.
const MOST_TEXT: usize = 2000;

/// A day ends with its last moment: the first of the next day is the first without it.
fn end_of_qualification(text: &str) -> Result<Option<Timestamp>, Failure> {
    let text = text.trim();
    if text.eq_ignore_ascii_case("never") {
        return Ok(None);
    }
    let wrong = || {
        Failure::usage(format_args!(
            "--qualified-until {text}: a day like 2027-06-30, a time like 2027-06-30T12:00:00Z, or never was expected"
        ))
    };
    if let Some(at) = clock::parse(text) {
        return Ok(Some(at));
    }
    let day: jiff_std::civil::Date = text.parse().map_err(|_| wrong())?;
    let after = day.tomorrow().map_err(|_| wrong())?;
    clock::parse(&format!("{after}T00:00:00Z")).map(Some).ok_or_else(wrong)
}

fn words_of_level(level: Option<Level>) -> String {
    level.map_or_else(|| "none".to_owned(), |level| level.to_string())
}

fn told(operator: &Operator, assigned_by: &str, event: u64, now: Timestamp) -> Value {
    json!({
        "name": operator.name,
        "level": operator.level.map(Level::number),
        "level_in_force": operator.level_at(now).map(Level::number),
        "lapsed": operator.has_lapsed(now),
        "experience": operator.experience,
        "organization": operator.organization,
        "role": operator.role,
        "shift": operator.shift,
        "qualified_until": operator.qualified_until.map(clock::utc),
        "assigned_by": assigned_by,
        "event": event,
    })
}

fn list(common: &Common) -> Done {
    let directory = shop::directory_to_look(common)?;
    let now = clock::start_time(common.start.as_deref())?.max(clock::start_time(None)?);
    let people = match &directory {
        Some(directory) => directory.operators().map_err(shop::failure)?,
        None => Vec::new(),
    };
    if common.json {
        let all: Vec<Value> = (people.iter())
            .map(|kept| told(&kept.operator, &kept.assigned_by, kept.event, now))
            .collect();
        print_json(&json!({ "operators": all, "local": people.is_empty(), "system_user": system_user() }))?;
        return Ok(Exit::Good);
    }
    if people.is_empty() {
        say("there are no operators yet: whoever sits here acts as local, level 1; toolmark operator add NAME makes the first");
    }
    for kept in &people {
        let person = &kept.operator;
        let mut facts = vec![format!("{:<20} level {:<4}", person.name, words_of_level(person.level))];
        if let Some(until) = person.qualified_until {
            let word = if person.has_lapsed(now) {
                "LAPSED, counts as 10, since"
            } else {
                "qualified until"
            };
            facts.push(format!("{word} {}", clock::utc(until)));
        }
        for (name, text) in [
            ("", &person.experience),
            ("", &person.role),
            ("", &person.organization),
            ("shift ", &person.shift),
        ] {
            if !text.is_empty() {
                facts.push(format!("{name}{text}"));
            }
        }
        facts.push(format!("by {} (event {})", kept.assigned_by, kept.event));
        say(&facts.join("; "));
    }
    Ok(Exit::Good)
}

fn rights(common: &Common) -> Done {
    if common.json {
        let all: Vec<Value> = (Action::ALL.iter())
            .map(|action| json!({ "action": action.word(), "words": action.words(), "needs": action.needs().map(Level::number) }))
            .collect();
        print_json(&json!({ "actions": all }))?;
    } else {
        say(ledger::rights::table().trim_end());
        say(
            "+ allowed, . refused, - nobody is signed in; an element of a program has the level that the program gives it, else 10",
        );
    }
    Ok(Exit::Good)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_qualification_lasts_to_the_end_of_its_day() {
        let end = |text| end_of_qualification(text).map_err(|f| f.message);
        assert_eq!(end("never"), Ok(None));
        assert_eq!(end("2026-12-31"), Ok(clock::parse("2027-01-01T00:00:00Z")));
        assert_eq!(end(" 2028-02-28 "), Ok(clock::parse("2028-02-29T00:00:00Z")));
        assert_eq!(end("2027-06-30T12:00:00+02:00"), Ok(clock::parse("2027-06-30T10:00:00Z")));
        for odd in [
            "",
            "tomorrow",
            "2026-02-30",
            "2026-13-01",
            "31.12.2026",
            "9999-12-31",
            "0000-01-01",
            "-1",
            "2300-01-01",
        ] {
            assert!(end(odd).is_err(), "{odd}");
        }
    }
}

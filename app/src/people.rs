//! Who acts, and whether that person may: every command that changes something asks here, and a refusal is in the log.
//!
//! `--operator NAME` names an operator of the data directory. Without it the user that the system signed in acts: as the operator of that
//! name. Where there are no operators yet, whoever sits here acts as `local`, with level 1. Who is none of these is not signed in: that is
//! no level, which is enough to look, to stop and to hold the feed.

use crate::cli::Common;
use crate::failure::{Exit, Failure};
use crate::{clock, shop};
use ledger::operator::{BY_THE_SYSTEM, LOCAL};
use ledger::{Action, Level, NotAllowed, Operator};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use store::DataDirectory;
use units::Timestamp;

/// Somebody who acts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Acting {
    /// As it stands in the log.
    pub name: String,
    /// The level in force; `None` is not signed in.
    pub level: Option<Level>,
    /// True where there are no operators yet.
    pub is_local: bool,
    /// The operator, where one is signed in.
    pub person: Option<Operator>,
    /// Named by `--operator`; nobody has proven it.
    named: bool,
    /// The user that the system signed in.
    system_user: String,
    /// When the qualification ended, if it did.
    lapsed: Option<Timestamp>,
    /// Operators there are, for who mistypes a name.
    known: Vec<String>,
}

impl Acting {
    /// Who acts in a data directory.
    ///
    /// # Errors
    /// The name cannot be one, `--start` is no time, or the disk refuses.
    pub fn of(directory: &DataDirectory, common: &Common) -> Result<Acting, Failure> {
        let operators = directory.operators().map_err(shop::failure)?;
        let system_user = system_user();
        let named = common.operator.as_deref().map(str::trim);
        if named == Some("") {
            return Err(Failure::usage("--operator needs a name"));
        }
        let mut acting = Acting {
            name: named.map_or_else(|| local_name(&system_user), str::to_owned),
            level: Some(Level::HIGHEST),
            is_local: true,
            person: None,
            named: named.is_some(),
            system_user,
            lapsed: None,
            known: Vec::new(),
        };
        if operators.is_empty() {
            return Ok(acting);
        }
        // The later of the two: a run may be dated back, a qualification may not.
        let now = clock::start_time(common.start.as_deref())?.max(clock::start_time(None)?);
        let wanted = named.unwrap_or(&acting.system_user).to_owned();
        let found = operators.iter().find(|kept| kept.operator.name == wanted);
        let person = found.map(|kept| &kept.operator).filter(|person| person.level.is_some());
        acting.level = person.and_then(|person| person.level_at(now));
        acting.person = person.cloned();
        acting.lapsed = person.filter(|p| p.has_lapsed(now)).and_then(|p| p.qualified_until);
        acting.known = (operators.iter().filter(|k| k.operator.level.is_some()))
            .map(|kept| kept.operator.name.clone())
            .collect();
        acting.name = wanted;
        acting.is_local = false;
        Ok(acting)
    }

    /// Asks whether this person may do something. A refusal is told in the log.
    ///
    /// # Errors
    /// No, and why; or the disk refuses.
    pub fn must(&self, action: Action, directory: &mut DataDirectory, at: Timestamp) -> Result<(), Failure> {
        match self.ask(action, directory, at)? {
            Ok(()) => Ok(()),
            Err(refused) => Err(self.refusal(refused)),
        }
    }

    /// The same, where a refusal is one of several reasons: it is told in the log, and the caller says it.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn ask(&self, action: Action, directory: &mut DataDirectory, at: Timestamp) -> Result<Result<(), NotAllowed>, Failure> {
        let answer = ledger::may(self.level, action);
        if let Err(refused) = answer {
            let mut detail = self.detail();
            detail.insert("action".to_owned(), action.word().into());
            detail.insert("needed".to_owned(), refused.needed.number().into());
            directory.append(at, "refused", detail).map_err(shop::failure)?;
        }
        Ok(answer)
    }

    /// What is said to somebody who may not.
    pub fn refusal(&self, refused: NotAllowed) -> Failure {
        let exit = if self.level.is_none() && self.named {
            Exit::Usage
        } else {
            Exit::Negative
        };
        Failure {
            exit,
            message: format!("error: {refused}: {}", self.why_not()),
        }
    }

    fn why_not(&self) -> String {
        let names = self.known.join(", ");
        match (self.level, self.named) {
            (None, true) => format!("{} is no operator here; operators are {names}", self.name),
            (None, false) => format!(
                "the system's user {} is no operator here; give --operator NAME, operators are {names}",
                self.name
            ),
            (Some(_), _) => match self.lapsed {
                Some(until) => format!(
                    "the qualification of {} ended {} and counts as level 10 since; toolmark operator change renews it",
                    self.name,
                    clock::utc(until)
                ),
                None => format!("{} cannot do it; ask somebody of that level", self.name),
            },
        }
    }

    /// Who, and by which right, in words.
    pub fn words(&self) -> String {
        match (self.is_local, self.level) {
            (true, _) if self.named => format!("{} (as {LOCAL}, level 1: there are no operators yet)", self.name),
            (true, _) => format!("{} (level 1: there are no operators yet)", self.name),
            (false, Some(level)) if self.lapsed.is_some() => {
                format!("{} (level {level}: the qualification has lapsed)", self.name)
            }
            (false, Some(level)) => format!("{} (level {level})", self.name),
            (false, None) => format!("{} (not signed in)", self.name),
        }
    }

    /// How it is known who it is: `none` for a name that was only given.
    pub fn authenticated_by(&self) -> &'static str {
        if self.named { "none" } else { "system" }
    }

    /// Who, by which right and how that is known, for an event.
    pub fn detail(&self) -> BTreeMap<String, Value> {
        BTreeMap::from([
            ("who".to_owned(), Value::from(self.name.as_str())),
            ("level".to_owned(), self.level.map_or(Value::Null, |l| l.number().into())),
            ("authenticated_by".to_owned(), self.authenticated_by().into()),
            ("claimed".to_owned(), self.named.into()),
            ("system_user".to_owned(), Value::from(self.system_user.as_str())),
        ])
    }

    /// The same for a JSON answer.
    pub fn json(&self) -> Value {
        json!({
            "name": self.name,
            "level": self.level.map(Level::number),
            "local": self.is_local,
            "organization": self.person.as_ref().map(|person| &person.organization),
            "role": self.person.as_ref().map(|person| &person.role),
            "shift": self.person.as_ref().map(|person| &person.shift),
            "authenticated_by": self.authenticated_by(),
            "claimed": self.named,
        })
    }

    /// The name in the log of who opened the directory.
    pub fn opener(&self) -> String {
        match (self.is_local, self.named) {
            (false, true) => format!("{} (named by the system's user {})", self.name, self.system_user),
            _ => self.name.clone(),
        }
    }
}

/// How whoever sits here is called where there are no operators yet.
fn local_name(system_user: &str) -> String {
    format!("{LOCAL}: {system_user} {BY_THE_SYSTEM}")
}

/// The name in a log that knows no operators: `--operator`, which is claimed and not proven, else the system's user.
pub fn unchecked_name(common: &Common) -> String {
    let named = common.operator.as_deref().map(str::trim).filter(|name| !name.is_empty());
    named.map_or_else(|| format!("{} {BY_THE_SYSTEM}", system_user()), str::to_owned)
}

/// The same in the few words that another one reads who wants the machine, too.
pub fn shown_to_others(common: &Common) -> String {
    let named = common.operator.as_deref().map(str::trim).filter(|name| !name.is_empty());
    named.map_or_else(system_user, str::to_owned)
}

/// The user that the system signed in. Not what the environment says, which anybody can set: the number that the kernel knows this
/// process by, and its name in the list of users.
pub fn system_user() -> String {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        if let Ok(process) = std::fs::metadata("/proc/self") {
            let number = process.uid();
            let users = std::fs::read_to_string("/etc/passwd").unwrap_or_default();
            return named_in(&users, number).map_or_else(|| format!("user {number}"), str::to_owned);
        }
    }
    let user = std::env::var("USER").or_else(|_| std::env::var("LOGNAME"));
    user.unwrap_or_else(|_| "somebody".to_owned())
}

/// The name behind a number in a list like `/etc/passwd`.
fn named_in(users: &str, number: u32) -> Option<&str> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next().filter(|name| !name.is_empty())?;
        let found: u32 = fields.nth(1)?.parse().ok()?;
        (found == number).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_systems_user_is_who_the_kernel_says() {
        let users = "root:x:0:0:root:/root:/bin/sh\nbroken\n:x:5:\nmaria:x:1000:1000::/home/maria:/bin/sh\n";
        assert_eq!(named_in(users, 1000), Some("maria"));
        assert_eq!(named_in(users, 5), None);
        assert_eq!(named_in(users, 7), None);
        assert!(!system_user().is_empty());
    }
}

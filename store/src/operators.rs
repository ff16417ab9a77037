//! Operators in SQLite: the level is a process value and changes through `ledger::change`; what else is known of a person stands in the
//! event beside it and in a table that finds it again. All of it is one transaction.
//!
//! Who may assign is asked inside that transaction: of two processes that take level 1 away from each other's operator, the second one
//! is refused.

use crate::events::{apply_change, end_of, event_of, insert_event, read_value};
use crate::{DataDirectory, Log, StoreError};
use ledger::operator::{AssignError, may_assign};
use ledger::{ChangeRequest, Event, Level, Operator};
use rusqlite::{Connection, Row, TransactionBehavior, params};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use units::Timestamp;

/// An operator as it stands in the data directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptOperator {
    /// The person.
    pub operator: Operator,
    /// Who gave the level.
    pub assigned_by: String,
    /// The event that did.
    pub event: u64,
}

/// An operator to be made or changed.
#[derive(Clone, Debug)]
pub struct Assignment<'a> {
    /// As the operator shall be.
    pub after: &'a Operator,
    /// The level of who gives it; `None` is not signed in.
    pub by_level: Option<Level>,
    /// Who gives it.
    pub who: &'a str,
    /// Why.
    pub why: &'a str,
    /// When.
    pub at: Timestamp,
    /// The event that is taken back by it.
    pub undoes: Option<u64>,
}

/// Path of the register that holds an operator's level; 0 is a level that was taken away.
pub fn level_path(name: &str) -> String {
    format!("operator/{}/level", name.replace('%', "%25").replace('/', "%2F"))
}

impl DataDirectory {
    /// All operators by name, also those whose level was taken away.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn operators(&self) -> Result<Vec<KeptOperator>, StoreError> {
        read_all(&self.database).map_err(self.failed())
    }

    /// Makes or changes an operator: the change of the level, the event with what was before and after, and the row.
    ///
    /// # Errors
    /// It may not be assigned so, nobody stands behind it, or the disk refuses. Nothing was changed then.
    pub fn assign_operator(&mut self, new: &Assignment<'_>) -> Result<Event, StoreError> {
        self.must_hold()?;
        let failed = self.failed();
        let transaction = self
            .database
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(&failed)?;
        let kept = read_all(&transaction).map_err(&failed)?;
        let people: Vec<Operator> = kept.into_iter().map(|k| k.operator).collect();
        may_assign(&people, new.after, new.by_level)?;
        let before = people.iter().find(|p| p.name == new.after.name);
        let mut chain = end_of(&transaction, Log::Directory).map_err(&failed)??;
        let path = level_path(&new.after.name);
        let present = read_value(&transaction, &path).map_err(&failed)?;
        let to = new.after.level.map_or(0.0, |level| f64::from(level.number()));
        let mut detail = detail_of(new.after);
        if present != Some(to) {
            let request = ChangeRequest {
                path,
                to,
                expected: present,
                who: new.who.to_owned(),
                why: new.why.to_owned(),
                when: new.at,
            };
            let change = apply_change(&transaction, &mut chain, (&request, None), &failed, &mut || {})?;
            detail.insert("change".to_owned(), change.event.sequence.into());
        }
        let earlier = before.map_or(Value::Null, |b| json!(detail_of(b)));
        detail.insert("before".to_owned(), earlier);
        detail.insert("who".to_owned(), new.who.into());
        detail.insert("why".to_owned(), new.why.into());
        if let Some(undone) = new.undoes {
            detail.insert("undoes".to_owned(), undone.into());
        }
        let event = chain.append(new.at, ASSIGNED, detail);
        insert_event(&transaction, Log::Directory, &event).map_err(&failed)?;
        let after = new.after;
        transaction
            .execute(
                "INSERT INTO operators (name, level, experience, organization, role, shift, qualified_until_ns, assigned_by, event)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)
                 ON CONFLICT (name) DO UPDATE SET level = excluded.level, experience = excluded.experience,
                     organization = excluded.organization, role = excluded.role, shift = excluded.shift,
                     qualified_until_ns = excluded.qualified_until_ns, assigned_by = excluded.assigned_by, event = excluded.event",
                params![
                    after.name,
                    after.level.map(Level::number),
                    after.experience,
                    after.organization,
                    after.role,
                    after.shift,
                    after.qualified_until.map(|t| t.0),
                    new.who,
                    event.sequence as i64
                ],
            )
            .map_err(&failed)?;
        transaction.commit().map_err(&failed)?;
        Ok(event)
    }

    /// The events that made or changed an operator, in order.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn assignments(&self, name: &str) -> Result<Vec<Event>, StoreError> {
        self.told(
            "kind = 'operator-assigned' AND json_extract(detail, '$.operator') = ?1",
            name,
            1,
        )
    }

    /// The last thing that was done under a name, after event `from`; `None` when nothing was.
    ///
    /// # Errors
    /// The disk refuses, or a row is not readable.
    pub fn last_deed(&self, name: &str, from: u64) -> Result<Option<Event>, StoreError> {
        Ok(self.told("json_extract(detail, '$.who') = ?1", name, from + 1)?.pop())
    }

    /// One event of the directory's own chain.
    ///
    /// # Errors
    /// The disk refuses, or the row is not readable.
    pub fn event(&self, sequence: u64) -> Result<Option<Event>, StoreError> {
        Ok(self
            .events(Log::Directory, sequence, 1)?
            .pop()
            .filter(|e| e.sequence == sequence))
    }

    /// Events of the directory's chain from `from` on that fulfil a condition over `?1`.
    pub(crate) fn told(&self, which: &str, value: &str, from: u64) -> Result<Vec<Event>, StoreError> {
        let failed = self.failed();
        let mut statement = self
            .database
            .prepare(&format!(
                "SELECT * FROM events WHERE log = 0 AND sequence >= ?2 AND {which} ORDER BY sequence"
            ))
            .map_err(&failed)?;
        let rows = statement
            .query_map(params![value, i64::try_from(from).unwrap_or(i64::MAX)], |row| {
                Ok(event_of(Log::Directory, row))
            })
            .map_err(&failed)?;
        rows.map(|row| row.map_err(&failed)?).collect()
    }
}

/// Kind of the event that makes or changes an operator.
pub(crate) const ASSIGNED: &str = "operator-assigned";

/// The words of an operator in an event, without who and why.
fn detail_of(operator: &Operator) -> BTreeMap<String, Value> {
    BTreeMap::from([
        ("operator".to_owned(), Value::from(operator.name.as_str())),
        (
            "level".to_owned(),
            operator.level.map_or(Value::Null, |level| level.number().into()),
        ),
        ("experience".to_owned(), Value::from(operator.experience.as_str())),
        ("organization".to_owned(), Value::from(operator.organization.as_str())),
        ("role".to_owned(), Value::from(operator.role.as_str())),
        ("shift".to_owned(), Value::from(operator.shift.as_str())),
        (
            "qualified_until_ns".to_owned(),
            operator.qualified_until.map_or(Value::Null, |t| t.0.into()),
        ),
    ])
}

/// An operator as an event tells it; `None` when it does not tell one.
pub fn operator_of(detail: &Value) -> Option<Operator> {
    let text = |name: &str| detail.get(name).and_then(Value::as_str).map(str::to_owned);
    let level = match detail.get("level")? {
        Value::Null => None,
        number => Some(Level::new(u8::try_from(number.as_u64()?).ok()?)?),
    };
    Some(Operator {
        name: text("operator")?,
        level,
        experience: text("experience")?,
        organization: text("organization")?,
        role: text("role")?,
        shift: text("shift")?,
        qualified_until: detail.get("qualified_until_ns")?.as_i64().map(Timestamp),
    })
}

pub(crate) fn read_all(connection: &Connection) -> rusqlite::Result<Vec<KeptOperator>> {
    let mut statement = connection.prepare("SELECT * FROM operators ORDER BY name")?;
    let kept = |row: &Row<'_>| {
        let level: Option<u8> = row.get("level")?;
        Ok(KeptOperator {
            operator: Operator {
                name: row.get("name")?,
                level: level.and_then(Level::new),
                experience: row.get("experience")?,
                organization: row.get("organization")?,
                role: row.get("role")?,
                shift: row.get("shift")?,
                qualified_until: row.get::<_, Option<i64>>("qualified_until_ns")?.map(Timestamp),
            },
            assigned_by: row.get("assigned_by")?,
            event: row.get::<_, i64>("event")?.unsigned_abs(),
        })
    };
    statement.query_map([], kept)?.collect()
}

impl From<AssignError> for StoreError {
    fn from(error: AssignError) -> StoreError {
        StoreError::Assign(Box::new(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(folder: &tempfile::TempDir) -> DataDirectory {
        DataDirectory::open(folder.path(), "test").expect("free")
    }

    fn assign(directory: &mut DataDirectory, after: &Operator, by: u8) -> Result<Event, StoreError> {
        directory.assign_operator(&Assignment {
            after,
            by_level: Level::new(by),
            who: "local",
            why: "new here",
            at: Timestamp(7),
            undoes: None,
        })
    }

    fn person(name: &str, level: u8) -> Operator {
        Operator::new(name, Level::new(level).expect("a level"))
    }

    #[test]
    fn an_operator_is_there_after_reopening_with_change_event_and_row() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        for name in ["Maria", "Robert'); DROP TABLE operators;--", "李/50%", "a\"b'c;--"] {
            let mut one = person(name, 1);
            one.experience = "5 years; \"lathe\"".to_owned();
            assign(&mut directory, &one, 1).expect("allowed");
            drop(directory);
            directory = open(&folder);
            let kept = directory.operators().expect("reads");
            let kept = kept.iter().find(|k| k.operator.name == name).expect("kept");
            assert_eq!((&kept.operator, kept.assigned_by.as_str()), (&one, "local"));
            assert_eq!(directory.value(&level_path(name)).expect("reads"), Some(1.0));
            let told = directory.event(kept.event).expect("reads").expect("there");
            assert_eq!(operator_of(&json!(told.detail)), Some(one));
        }
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn what_may_not_be_assigned_changes_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        assert!(matches!(
            assign(&mut directory, &person("Jo", 4), 1),
            Err(StoreError::Assign(_))
        ));
        assert_eq!(
            (
                directory.operators().expect("reads").len(),
                directory.values("").expect("reads").len()
            ),
            (0, 0)
        );
        assign(&mut directory, &person("Maria", 1), 1).expect("the first");
        let last = directory.last_event(Log::Directory).expect("reads");
        assert!(assign(&mut directory, &person("Jo", 4), 3).is_err());
        assert!(
            assign(
                &mut directory,
                &Operator {
                    level: None,
                    ..person("Maria", 1)
                },
                1
            )
            .is_err()
        );
        assert_eq!(directory.last_event(Log::Directory).expect("reads"), last);
    }

    #[test]
    fn a_level_that_was_taken_away_is_none_and_the_row_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        assign(&mut directory, &person("Maria", 1), 1).expect("the first");
        assign(&mut directory, &person("Jo", 4), 1).expect("another");
        let gone = Operator {
            level: None,
            ..person("Jo", 4)
        };
        let event = assign(&mut directory, &gone, 1).expect("taken away");
        assert_eq!(event.detail["before"]["level"], 4);
        assert_eq!(directory.operators().expect("reads")[0].operator, gone);
        assert_eq!(directory.value(&level_path("Jo")).expect("reads"), Some(0.0));
        assert_eq!(directory.assignments("Jo").expect("reads").len(), 2);
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn operators_cannot_be_changed_by_hand_and_verify_names_who_was() {
        for sql in [
            "UPDATE operators SET level = 1 WHERE name = 'Jo'",
            "UPDATE operators SET level = 1, event = event + 1 WHERE name = 'Jo'",
            "DELETE FROM operators",
            "INSERT INTO operators VALUES ('Eve', 1, '', '', '', '', NULL, 'x', 1)",
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            let mut directory = open(&folder);
            assign(&mut directory, &person("Maria", 1), 1).expect("the first");
            assign(&mut directory, &person("Jo", 9), 1).expect("another");
            assert!(directory.database.execute_batch(sql).is_err(), "{sql}");
        }
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = open(&folder);
        assign(&mut directory, &person("Maria", 1), 1).expect("the first");
        assign(&mut directory, &person("Jo", 9), 1).expect("another");
        directory
            .database
            .execute_batch("DROP TRIGGER operators_change_with_an_event; UPDATE operators SET level = 1 WHERE name = 'Jo'")
            .expect("as a forger would");
        let found = directory.verify().expect("verifies");
        assert!(
            found.iter().any(|f| f.what.contains("operator Jo (table operators)")),
            "{found:?}"
        );
    }
}

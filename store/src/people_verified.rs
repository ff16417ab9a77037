//! Operators and known programs held against what the log tells of them.

use crate::operators::{self, ASSIGNED, KeptOperator};
use crate::programs::{self, tells_a_program};
use crate::verify::{Finding, finding};
use crate::{DataDirectory, StoreError};
use ledger::Event;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// What the directory's chain says of people and of the programs that they edit.
#[derive(Default)]
pub(crate) struct ToldOfPeople {
    operators: BTreeMap<String, KeptOperator>,
    programs: BTreeMap<String, (String, u64)>,
}

impl ToldOfPeople {
    /// Takes in the next event of the chain.
    pub(crate) fn hear(&mut self, event: &Event) {
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        if event.kind == ASSIGNED {
            if let Some(operator) = operators::operator_of(&json!(event.detail)) {
                let kept = KeptOperator {
                    operator,
                    assigned_by: text("who"),
                    event: event.sequence,
                };
                self.operators.insert(kept.operator.name.clone(), kept);
            }
        } else if tells_a_program(&event.kind) {
            self.programs.insert(text("path"), (text("sha256"), event.sequence));
        }
    }
}

impl DataDirectory {
    pub(crate) fn verify_people(&self, told: &ToldOfPeople, findings: &mut Vec<Finding>) -> Result<(), StoreError> {
        let rows = operators::read_all(&self.database).map_err(self.failed())?;
        let operators = rows.into_iter().map(|row| (row.operator.name.clone(), row)).collect();
        compare("operator", "operators", &operators, &told.operators, findings);
        let programs = programs::read_all(&self.database).map_err(self.failed())?;
        compare("program", "programs", &programs, &told.programs, findings);
        Ok(())
    }
}

fn compare<T: PartialEq>(
    word: &str,
    table: &str,
    rows: &BTreeMap<String, T>,
    told: &BTreeMap<String, T>,
    findings: &mut Vec<Finding>,
) {
    for name in rows.keys().chain(told.keys()).collect::<BTreeSet<_>>() {
        let what = format!("{word} {name} (table {table})");
        match (rows.get(name), told.get(name)) {
            (Some(row), Some(said)) if row == said => {}
            (Some(_), Some(_)) => findings.push(finding(what, "is not what the log tells")),
            (Some(_), None) => findings.push(finding(what, "no event of the log tells of it")),
            (None, _) => findings.push(finding(what, "is gone")),
        }
    }
}

//! What is kept of entries: each is one event of the data directory's chain, and a row is that event read back.

use crate::Unit;
use ledger::Event;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use units::{Millimetres, Timestamp};

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum What {
    /// A size was entered and used.
    Entered,
    /// An entry was refused; nothing was changed.
    Refused,
    /// An entry was taken back before the tool cut with it.
    Undone,
    /// An entry was answered by its opposite.
    Opposed,
    /// The register was found changed: somebody entered it directly at the control.
    AtControl,
    /// A new tool or insert came in: sizes before it tell nothing about it.
    NewTool,
}

impl What {
    /// All of them, with the kinds of their events.
    pub const ALL: [(&'static str, What); 6] = [
        ("size-entered", What::Entered),
        ("size-refused", What::Refused),
        ("size-undone", What::Undone),
        ("size-opposed", What::Opposed),
        ("size-at-control", What::AtControl),
        ("size-new-tool", What::NewTool),
    ];
    /// The kind of its event.
    pub fn event_kind(self) -> &'static str {
        What::ALL[self as usize].0
    }
}

/// One line of the history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The number of the entry: of its event in the directory's chain. 0 before it is kept.
    pub entry: u64,
    /// When.
    pub at_ns: i64,
    /// What.
    pub what: What,
    /// Which dimension.
    pub dimension: String,
    /// Which register.
    pub register: String,
    /// Who.
    pub who: String,
    /// Why, in the person's words or the house's.
    pub why: String,
    /// The part that was measured.
    pub part: Option<u64>,
    /// What was typed, and in which unit.
    pub typed: Option<String>,
    /// `mm` or `in`.
    pub unit: Option<String>,
    /// The measured size, mm.
    pub measured_mm: Option<f64>,
    /// By how much it wanted the register moved, mm.
    pub asked_mm: Option<f64>,
    /// The register before, mm; `None` when it was never set.
    pub before_mm: Option<f64>,
    /// The register after, mm.
    pub after_mm: Option<f64>,
    /// What refused the entry.
    pub rule: Option<String>,
    /// The entry that is taken back or answered.
    pub of: Option<u64>,
}

impl Row {
    /// A line about `dimension` with nothing in it yet.
    pub fn new(what: What, dimension: &crate::Dimension, who: &str, why: &str, at: Timestamp) -> Row {
        Row {
            entry: 0,
            at_ns: at.0,
            what,
            dimension: dimension.name.clone(),
            register: dimension.register.clone(),
            who: who.to_owned(),
            why: why.to_owned(),
            part: None,
            typed: None,
            unit: None,
            measured_mm: None,
            asked_mm: None,
            before_mm: None,
            after_mm: None,
            rule: None,
            of: None,
        }
    }

    /// Adds what was typed.
    pub fn typed(mut self, text: &str, unit: Unit, part: u64) -> Row {
        (self.typed, self.unit, self.part) = (Some(text.to_owned()), Some(unit.to_string()), Some(part));
        self
    }

    /// What its event holds besides time and kind.
    pub fn detail(&self) -> BTreeMap<String, Value> {
        let number = |n: Option<f64>| n.map(Value::from);
        let fields = [
            ("dimension", Some(Value::from(self.dimension.as_str()))),
            ("register", Some(Value::from(self.register.as_str()))),
            ("who", Some(Value::from(self.who.as_str()))),
            ("why", Some(Value::from(self.why.as_str()))),
            ("part", self.part.map(Value::from)),
            ("typed", self.typed.as_deref().map(Value::from)),
            ("unit", self.unit.as_deref().map(Value::from)),
            ("measured_mm", number(self.measured_mm)),
            ("asked_mm", number(self.asked_mm)),
            ("before_mm", number(self.before_mm)),
            ("after_mm", number(self.after_mm)),
            ("rule", self.rule.as_deref().map(Value::from)),
            ("of", self.of.map(Value::from)),
        ];
        let present = fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?)));
        present.collect()
    }

    /// Reads the event of an entry; `None` for any other event.
    pub fn from_event(event: &Event) -> Option<Row> {
        let what = What::ALL.into_iter().find(|(kind, _)| *kind == event.kind)?.1;
        let text = |name: &str| event.detail.get(name).and_then(Value::as_str).map(str::to_owned);
        let number = |name: &str| event.detail.get(name).and_then(Value::as_f64);
        let count = |name: &str| event.detail.get(name).and_then(Value::as_u64);
        Some(Row {
            entry: event.sequence,
            at_ns: event.at_ns,
            what,
            dimension: text("dimension")?,
            register: text("register")?,
            who: text("who")?,
            why: text("why")?,
            part: count("part"),
            typed: text("typed"),
            unit: text("unit"),
            measured_mm: number("measured_mm"),
            asked_mm: number("asked_mm"),
            before_mm: number("before_mm"),
            after_mm: number("after_mm"),
            rule: text("rule"),
            of: count("of"),
        })
    }

    /// The change of the register, mm; 0 when there was none.
    pub fn change(&self) -> f64 {
        match self.after_mm {
            Some(after) => libm::round((after - self.before_mm.unwrap_or(0.0)) * 1e9) / 1e9,
            None => 0.0,
        }
    }
}

/// How the other dimensions stand that move a register by their mean, from the history in order.
pub fn others(dimension: &crate::Dimension, job: &[crate::Dimension], history: &[Row]) -> crate::Others {
    let mut others = crate::Others::default();
    if dimension.role != crate::Role::Mean {
        return others;
    }
    let moved = |row: &&Row| row.register == dimension.register && (row.change() != 0.0 || row.what == What::NewTool);
    let since = history.iter().rposition(|row| moved(&row)).map_or(0, |k| k + 1);
    let shares =
        |d: &&crate::Dimension| d.role == crate::Role::Mean && d.register == dimension.register && d.name != dimension.name;
    for other in job.iter().filter(shares) {
        let last = history[since..]
            .iter()
            .rev()
            .find(|row| row.what == What::Entered && row.dimension == other.name);
        match last.and_then(|row| row.asked_mm) {
            Some(asked) => others.asked.push(asked),
            None => others.missing.push(other.name.clone()),
        }
    }
    others
}

/// The sizes since the tool was new, oldest first, for [`crate::trend`].
pub fn sizes(dimension: &crate::Dimension, history: &[Row]) -> Vec<crate::trend::Sized> {
    let since = history
        .iter()
        .rposition(|row| row.what == What::NewTool && row.register == dimension.register)
        .map_or(0, |k| k + 1);
    let undone: Vec<u64> = history
        .iter()
        .filter(|r| r.what == What::Undone)
        .filter_map(|r| r.of)
        .collect();
    history[since..]
        .iter()
        .filter(|row| row.what == What::Entered && row.dimension == dimension.name && !undone.contains(&row.entry))
        .filter_map(|row| {
            Some(crate::trend::Sized {
                entry: row.entry,
                part: row.part? as f64,
                measured: Millimetres(row.measured_mm?),
                register: row.before_mm.unwrap_or(0.0),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::tests::published;
    use crate::{Dimension, Role};
    use ledger::Chain;

    fn entered(name: &str, asked: f64, change: f64) -> Row {
        Row {
            dimension: name.into(),
            measured_mm: Some(82.0),
            asked_mm: Some(asked),
            before_mm: Some(0.0),
            after_mm: Some(change),
            ..Row::new(What::Entered, &published(), "Maria", "measured", Timestamp(7)).typed("3.2351", Unit::Inch, 12)
        }
    }

    #[test]
    fn a_row_reads_back_from_its_event() {
        for (kind, what) in What::ALL {
            assert_eq!(what.event_kind(), kind);
            let row = Row {
                what,
                ..entered("DIM A", -0.02286, -0.02286)
            };
            let event = Chain::default().append(Timestamp(7), kind, row.detail());
            assert_eq!(Row::from_event(&event), Some(Row { entry: 1, ..row }));
        }
        assert_eq!(
            Row::from_event(&Chain::default().append(Timestamp(0), "job-started", BTreeMap::new())),
            None
        );
    }

    #[test]
    fn a_mean_waits_for_those_that_were_not_entered_since_the_register_moved() {
        let named = |name: &str| Dimension {
            name: name.into(),
            role: Role::Mean,
            ..published()
        };
        let job = [named("DIM A"), named("DIM B")];
        let stand = |history: &[Row]| others(&job[0], &job, history);
        assert_eq!(stand(&[]).missing, ["DIM B"]);
        let mut history = vec![entered("DIM B", -0.01, 0.0)];
        assert_eq!((stand(&history).asked, stand(&history).missing), (vec![-0.01], vec![]));
        history.push(entered("DIM A", -0.02, -0.015));
        assert_eq!(stand(&history).missing, ["DIM B"], "its entry was used up");
    }

    #[test]
    fn sizes_begin_anew_with_a_new_tool() {
        let mut history = vec![entered("DIM A", 0.0, 0.0), entered("DIM B", 0.0, 0.0)];
        assert_eq!(sizes(&published(), &history).len(), 1);
        history.push(Row::new(What::NewTool, &published(), "Maria", "worn", Timestamp(8)));
        assert_eq!(sizes(&published(), &history), []);
    }
}

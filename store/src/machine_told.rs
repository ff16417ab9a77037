//! The values of a machine file one by one, each with the place where it stands: what `toolmark machine show` tells.
//!
//! [`MachineFile::parse`] says whether a file is good and what it comes to; here is what it literally says, so that a person finds the
//! line of a value.

use crate::{MachineFile, StoreError};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value of a machine file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Told {
    /// Its key, tables and all: `axes.x.v_max_mm_s`, `tools[5].diameter_mm` (a tool by its number).
    pub key: String,
    /// The value as the file spells it.
    pub value: String,
    /// Its line, from 1.
    pub line: u32,
    /// Its column, from 1.
    pub column: u32,
}

/// What a key that is left out comes to.
pub const DEFAULTS: &[(&str, &str)] = &[
    ("nameplate.brand", "unavailable"),
    ("nameplate.model", "the machine's name"),
    ("nameplate.serial_number", "unavailable"),
    ("coolant.product", "nothing is declared of it"),
    ("control", "found out from each program, with the reason"),
    ("control_parameters", "none"),
    ("axes.x.diameter", "false"),
    ("store.raw_days", "90"),
    ("store.quota_bytes", "no limit"),
    ("programs.edited_outside", "\"warn\""),
    ("late_ticks_allowed", "5"),
    ("card.registers", "none: driver = \"sim\""),
    ("late_ticks_made_up", "500"),
];

impl MachineFile {
    /// Every value that a text of a machine file says, in its order.
    ///
    /// # Errors
    /// As [`MachineFile::parse`]: what cannot be used is not told either.
    pub fn told(text: &str, file: &str) -> Result<Vec<Told>, StoreError> {
        Self::parse(text, file)?;
        Ok(values(text))
    }

    /// What the keys come to that a file leaves out, for this machine.
    pub fn defaults(&self) -> Vec<(String, String)> {
        let fixed = DEFAULTS.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
        fixed.chain(self.model_in_force()).collect()
    }
}

/// Every value of a text, as far as it is TOML, in its order.
pub(crate) fn values(text: &str) -> Vec<Told> {
    let mut found = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        walk(text, "", table.get_ref(), &mut found);
    }
    found.sort_by_key(|(at, _)| *at);
    found.into_iter().map(|(_, told)| told).collect()
}

fn walk(text: &str, above: &str, table: &DeTable<'_>, found: &mut Vec<(usize, Told)>) {
    for (name, value) in table.iter() {
        let name = spelled(name.get_ref());
        let key = if above.is_empty() { name } else { format!("{above}.{name}") };
        inside(text, key, value, found);
    }
}

fn inside(text: &str, key: String, value: &Spanned<DeValue<'_>>, found: &mut Vec<(usize, Told)>) {
    match value.get_ref() {
        DeValue::Table(table) => walk(text, &key, table, found),
        DeValue::Array(items) if items.iter().all(|item| matches!(item.get_ref(), DeValue::Table(_))) => {
            for (place, item) in items.iter().enumerate() {
                let DeValue::Table(table) = item.get_ref() else { continue };
                let number = table.get("number").and_then(|number| text.get(number.span()));
                let name = number.map_or_else(|| (place + 1).to_string(), str::to_owned);
                walk(text, &format!("{key}[{name}]"), table, found);
            }
        }
        _ => {
            let span = value.span();
            let (line, column) = crate::machine_file::place(text, span.start);
            let value = text.get(span.clone()).unwrap_or_default().to_owned();
            found.push((
                span.start,
                Told {
                    key,
                    value,
                    line,
                    column,
                },
            ));
        }
    }
}

/// A key as TOML wants it: in quotes where it is no bare one.
fn spelled(name: &str) -> String {
    let bare = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if bare { name.to_owned() } else { format!("{name:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_file::BUILT_IN;

    fn of(key: &str, text: &str) -> Option<(String, u32, u32)> {
        let all = MachineFile::told(text, "m.toml").expect("a good file");
        all.into_iter().find(|t| t.key == key).map(|t| (t.value, t.line, t.column))
    }

    #[test]
    fn every_value_stands_where_its_line_says() {
        for (_, text) in BUILT_IN {
            let lines: Vec<&str> = text.lines().collect();
            let all = MachineFile::told(text, "m.toml").expect("a good file");
            assert!(all.len() > 30);
            for told in all {
                let line = lines[told.line as usize - 1];
                assert!(line[told.column as usize - 1..].starts_with(&told.value), "{told:?}: {line}");
                let last = told.key.rsplit('.').next().unwrap_or_default();
                assert!(line.starts_with(last), "{told:?}: {line}");
            }
        }
    }

    #[test]
    fn tools_are_called_by_their_numbers_and_odd_keys_are_quoted() {
        let text = format!("{}\n[control_parameters]\n\"6001.5\" = 1\n", BUILT_IN[1].1);
        assert_eq!(of("tools[5].geometry_x_mm", &text).map(|t| t.0), Some("80.0".to_owned()));
        assert_eq!(of("control_parameters.\"6001.5\"", &text).map(|t| t.0), Some("1".to_owned()));
        assert_eq!(of("tools[9].geometry_x_mm", &text), None);
    }

    #[test]
    fn a_wrong_value_is_refused_and_not_told() {
        let text = BUILT_IN[0].1.replacen("v_max_mm_s = 500.0", "v_max_mm_s = -5", 1);
        let refused = MachineFile::told(&text, "m.toml").expect_err("no speed").to_string();
        assert!(refused.starts_with("error: m.toml:14:14: -5 cannot be"), "{refused}");
    }
}

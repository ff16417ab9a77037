//! Which common variables the generated programs use, and their names on the control's screen.

use super::{GenerateError, Method};
use crate::Dimension;
use crate::control::Control;
use std::collections::BTreeMap;

/// The variables of a job on a control. A field of dimension k (from 1) is at `field + k`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of the job whose set-up was run; vacant while a set-up runs.
    pub job: u32,
    /// Entries: what the operator types ([`Method::TWord`]).
    pub entry: u32,
    /// The dimension whose entry was taken and is not finished; else 0.
    pub taken: u32,
    /// Entries that were used, counted.
    pub count: u32,
    /// The table of [`Method::TWord`]; all 0 else.
    pub table: Table,
    /// Names for SETVN.
    pub names: BTreeMap<u32, String>,
}

/// What a T word's worker looks up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// How many dimensions.
    pub dimensions: u32,
    /// Steps of a register in one unit of the control.
    pub steps_per_unit: u32,
    /// 20 or 21, as #4006 tells the unit.
    pub unit: u32,
    /// Offset numbers.
    pub offset: u32,
    /// Targets.
    pub target: u32,
    /// Lower ends of the windows.
    pub low: u32,
    /// Upper ends.
    pub high: u32,
    /// Steps of the register for one unit of size, with sign.
    pub gain: u32,
    /// Largest single steps, in whole steps.
    pub largest: u32,
    /// System variables of offset 0.
    pub base: u32,
}

impl Layout {
    pub(super) fn new(dimensions: &[Dimension], control: &Control, method: Method) -> Result<Layout, GenerateError> {
        let n = dimensions.len() as u32;
        let mut next = control.kept[0];
        let mut names = BTreeMap::new();
        let mut one = |name: &str| {
            let here = next;
            next += 1;
            names.insert(here, name.to_owned());
            here
        };
        let job = one("SZ JOB");
        let mut field = |name: &str| {
            let before = one(&format!("{name}1")) - 1;
            (2..=n).for_each(|k| {
                one(&format!("{name}{k}"));
            });
            before
        };
        let shown = names_of(dimensions, control.name_length);
        let entry = if method == Method::TWord { field("DIM") } else { 0 };
        let count = field("DONE");
        let table = if method == Method::TWord {
            Table {
                offset: field("OFS"),
                target: field("TGT"),
                low: field("LOW"),
                high: field("HIGH"),
                gain: field("GAIN"),
                largest: field("STEP"),
                base: field("REG"),
                dimensions: one("SZ DIMS"),
                steps_per_unit: one("SZ STEPS"),
                unit: one("SZ UNIT"),
            }
        } else {
            Table::default()
        };
        let taken = one("SZ TAKEN");
        if method == Method::TWord {
            names.extend((1..).map(|k| entry + k).zip(shown));
        }
        let (have, need) = (control.kept[1] - control.kept[0] + 1, next - control.kept[0]);
        if need > have {
            return Err(GenerateError::NoRoom {
                control: control.name.clone(),
                have,
                first: control.kept[0],
                last: control.kept[1],
                dimensions: dimensions.len(),
                need,
            });
        }
        Ok(Layout {
            job,
            entry,
            taken,
            count,
            table,
            names,
        })
    }
}

/// The dimensions' names as the control can show them: short, and each once.
fn names_of(dimensions: &[Dimension], longest: usize) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for dimension in dimensions {
        let plain: String = dimension
            .name
            .chars()
            .map(|c| {
                if c.is_ascii_alphanumeric() || c == '-' {
                    c.to_ascii_uppercase()
                } else {
                    ' '
                }
            })
            .collect();
        let cut: String = plain.trim().chars().take(longest).collect();
        let numbered = |k: usize| {
            let tail = k.to_string();
            let head: String = cut.chars().take(longest.saturating_sub(tail.len())).collect();
            head + &tail
        };
        let known = |name: &String| names.contains(name) || name.trim().is_empty();
        let name = std::iter::once(cut.trim_end().to_owned())
            .chain((2..).map(numbered))
            .find(|name| !known(name))
            .expect("there are more numbers than dimensions");
        names.push(name);
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::tests::published;

    #[test]
    fn names_are_short_and_each_is_there_once() {
        let named = |name: &str| Dimension {
            name: name.into(),
            ..published()
        };
        let dimensions = ["Seat D40 front", "Seat D40 rear", "ø20", "ø"].map(named);
        assert_eq!(names_of(&dimensions, 8), ["SEAT D40", "SEAT D42", "20", "2"]);
    }

    #[test]
    fn ten_dimensions_have_their_entries_where_the_article_has_them_and_no_variable_twice() {
        let dimensions: Vec<Dimension> = (1..=10)
            .map(|k| Dimension {
                name: format!("DIM {k}"),
                offset: k,
                ..published()
            })
            .collect();
        let control = Control::find("fanuc-lathe").expect("built in");
        let layout = Layout::new(&dimensions, &control, Method::TWord).expect("room");
        assert_eq!((layout.job, layout.entry), (500, 500));
        assert_eq!(layout.names[&501], "DIM 1");
        assert_eq!(layout.names[&510], "DIM 10");
        let last = layout.taken;
        assert_eq!(
            layout.names.len() as u32,
            last - 500 + 1,
            "every variable between is named, none twice"
        );
    }
}

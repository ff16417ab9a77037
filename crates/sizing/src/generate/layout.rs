//! Which common variables the generated programs use, and their names on the control's screen.

use super::GenerateError;
use crate::Dimension;
use crate::control::Control;
use std::collections::BTreeMap;

/// The variables of a job on a control. A field of dimension k (from 1) is at `field + k`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of the job whose set-up was run; vacant while a set-up runs.
    pub job: u32,
    /// Entries: what the operator types ([`super::Method::TWord`]).
    pub entry: u32,
    /// The dimension whose entry was taken and is not finished; else 0.
    pub taken: u32,
    /// Entries that were used, counted.
    pub count: u32,
    /// The table of [`super::Method::TWord`].
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

/// Fields of each dimension, and numbers that stand once.
const FIELDS: u32 = 9;
const SINGLE: u32 = 5;
/// The article's ten dimensions.
const MOST: u32 = 10;

impl Layout {
    /// What each G65 call has found: by how many steps its size wants the register moved. Scratch of [`super::Method::G65`], which types
    /// its sizes elsewhere.
    pub fn asked(&self) -> u32 {
        self.entry
    }

    /// Where each G65 call found its size. Scratch like [`Layout::asked`].
    pub fn place(&self) -> u32 {
        self.table.offset
    }

    /// The places depend on the control alone and not on job or method, so that macros that were loaded once find every job's set-up
    /// where they look for it. With room for ten dimensions entries, offsets and targets are where the article has them.
    pub(super) fn new(dimensions: &[Dimension], control: &Control) -> Result<Layout, GenerateError> {
        let [first, last] = control.kept;
        let have = last - first + 1;
        let slots = (have.saturating_sub(SINGLE) / FIELDS).min(MOST);
        let n = dimensions.len() as u32;
        if n > slots {
            return Err(GenerateError::NoRoom {
                control: control.name.clone(),
                have,
                first,
                last,
                dimensions: dimensions.len(),
                most: slots,
                need: SINGLE + FIELDS * n,
            });
        }
        let mut names = BTreeMap::from([(first, "SZ JOB".to_owned())]);
        let mut next = first;
        let mut field = |name: &str| {
            let before = next;
            names.extend((1..=n).map(|k| (before + k, format!("{name}{k}"))));
            next += slots;
            before
        };
        let (entry, count, offset, target) = (field("DIM"), field("DONE"), field("OFS"), field("TGT"));
        let (low, high, gain, largest, base) = (field("LOW"), field("HIGH"), field("GAIN"), field("STEP"), field("REG"));
        let mut one = |name: &str| {
            next += 1;
            names.insert(next, name.to_owned());
            next
        };
        let table = Table {
            dimensions: one("SZ DIMS"),
            steps_per_unit: one("SZ STEPS"),
            unit: one("SZ UNIT"),
            offset,
            target,
            low,
            high,
            gain,
            largest,
            base,
        };
        let taken = one("SZ TAKEN");
        names.extend((1..).map(|k| entry + k).zip(names_of(dimensions, control.name_length)));
        Ok(Layout {
            job: first,
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
    fn places_do_not_depend_on_the_number_of_dimensions() {
        let two = [
            published(),
            Dimension {
                offset: 6,
                ..published()
            },
        ];
        for control in Control::built_in() {
            let places = |dimensions: &[Dimension]| {
                let layout = Layout::new(dimensions, &control).expect("room");
                (layout.job, layout.entry, layout.taken, layout.count, layout.table)
            };
            assert_eq!(places(&two), places(&two[..1]), "{}", control.name);
        }
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
        let layout = Layout::new(&dimensions, &control).expect("room");
        assert_eq!(
            (layout.job, layout.entry, layout.table.offset, layout.table.target),
            (500, 500, 520, 530)
        );
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

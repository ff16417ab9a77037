//! Where parts stand, and putting them elsewhere.
//!
//! A place is a relationship with a sequence number. Numbers need not be whole nor without gaps, so what is put between two neighbours
//! gets a number between theirs, and a move among neighbours deals the same numbers out anew: moving back gives the same bytes.

use super::{ChangeError, ProgramEdits, unfit};
use crate::model::{Executable, ExecutableKind};
use crate::select::{Part, Spot};
use part21::text::real;

pub(super) const SEQUENCE: &str = "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP";
pub(super) const TOOLPATHS: &str = "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP";
/// Places of executables without an order: branches, and what is done together or in any order.
const UNORDERED: [&str; 3] = [
    "MACHINING_PROCESS_BRANCH_RELATIONSHIP",
    "MACHINING_PROCESS_CONCURRENT_RELATIONSHIP",
    "MACHINING_PROCESS_BODY_RELATIONSHIP",
];

/// The link that puts a part at its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) relationship: u64,
    pub(super) keyword: &'static str,
    pub(super) parent: u64,
    pub(super) sequence: Option<f64>,
}

/// Where a part is put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Before this one.
    Before(Spot),
    /// Behind the last one in this workplan, or the last toolpath of this workingstep.
    EndOf(Part),
}

impl ProgramEdits<'_> {
    /// Puts a part somewhere else.
    ///
    /// # Errors
    /// When one of them has no place in a workplan or operation, they are of different kinds, or a workplan would come to stand in
    /// itself.
    pub fn move_to(&mut self, from: Spot, to: Target) -> Result<(), ChangeError> {
        let place = self.ordered(from)?;
        let (parent, before) = self.target(from.part, to)?;
        let keyword = if let Part::Toolpath(_) = from.part {
            TOOLPATHS
        } else {
            SEQUENCE
        };
        if let Part::Executable(moved) = from.part {
            let mut inside = false;
            self.program
                .walk(moved, &mut |executable, _| inside |= executable.id == parent);
            if inside {
                return unfit(from.part, "moved into itself", "choose a place outside of it");
            }
        }
        if parent != place.parent {
            let sequence = self.number_before(parent, keyword, before)?;
            self.set(place.relationship, 4, &sequence)?;
            return self.set(place.relationship, 2, &format!("#{parent}"));
        }
        let mut order = self.in_order(parent, keyword);
        let numbers: Vec<Option<f64>> = order.iter().map(|place| place.sequence).collect();
        let texts: Vec<String> = order
            .iter()
            .map(|place| self.spelled(place.relationship, 4).unwrap_or_default().to_string())
            .collect();
        let Some(at) = order.iter().position(|other| other.relationship == place.relationship) else {
            return Ok(());
        };
        let moved = order.remove(at);
        let to = match before {
            Some(before) if before == place.relationship => at,
            Some(before) => order
                .iter()
                .position(|other| other.relationship == before)
                .unwrap_or(order.len()),
            None => order.len(),
        };
        order.insert(to, moved);
        // Equal numbers tell no order, so they cannot be dealt out.
        let rising = numbers.windows(2).all(|pair| matches!(pair, [Some(a), Some(b)] if a < b));
        for (n, place) in order.iter().enumerate() {
            let text = if rising { texts[n].clone() } else { real((n + 1) as f64) };
            if self.spelled(place.relationship, 4) != Some(text.as_str()) {
                self.set(place.relationship, 4, &text)?;
            }
        }
        Ok(())
    }

    /// Parent and relationship that a target means; `None` is the end.
    pub(super) fn target(&self, part: Part, to: Target) -> Result<(u64, Option<u64>), ChangeError> {
        match (part, to) {
            (_, Target::Before(other)) => {
                let place = self.ordered(other)?;
                let same_kind = matches!(part, Part::Toolpath(_)) == (place.keyword == TOOLPATHS);
                if !same_kind {
                    return unfit(
                        part,
                        "of another kind than its new neighbour",
                        "move workingsteps among workingsteps, toolpaths among toolpaths",
                    );
                }
                Ok((place.parent, Some(place.relationship)))
            }
            (Part::Executable(_), Target::EndOf(around)) => match self.executable(around).map(|found| &found.kind) {
                Some(ExecutableKind::Workplan(_)) => Ok((around.id(), None)),
                _ => unfit(
                    around,
                    "no workplan",
                    "put workingsteps, functions and workplans into a workplan",
                ),
            },
            (Part::Toolpath(_), Target::EndOf(around)) => match self.executable(around).map(|found| &found.kind) {
                Some(ExecutableKind::Workingstep {
                    operation: Some(operation),
                    ..
                }) => Ok((*operation, None)),
                _ => unfit(around, "no workingstep with an operation", "put toolpaths into a workingstep"),
            },
        }
    }

    fn executable(&self, part: Part) -> Option<&Executable> {
        self.program.executable(part.id())
    }

    /// The sequence number, as text, for something new before `before`, or at the end.
    pub(super) fn number_before(
        &mut self,
        parent: u64,
        keyword: &'static str,
        before: Option<u64>,
    ) -> Result<String, ChangeError> {
        let order = self.in_order(parent, keyword);
        let at = before.and_then(|before| order.iter().position(|place| place.relationship == before));
        let at = at.unwrap_or(order.len());
        let number = |n: usize| order[n].sequence;
        let between = match (at.checked_sub(1).map(number), order.get(at).map(|place| place.sequence)) {
            (None, None) => Some(1.0),
            (None, Some(next)) => next.map(|next| next - 1.0),
            (Some(last), None) => last.map(|last| last.floor() + 1.0),
            (Some(last), Some(next)) => last
                .zip(next)
                .map(|(a, b)| (a + b) / 2.0)
                .filter(|middle| number(at - 1).is_some_and(|a| a < *middle) && number(at).is_some_and(|b| *middle < b)),
        };
        if let Some(number) = between.filter(|number| number.is_finite()) {
            return Ok(real(number));
        }
        // No room: all get whole numbers, with one left out.
        for (n, place) in order.iter().enumerate() {
            let number = n + 1 + usize::from(n >= at);
            self.set(place.relationship, 4, &real(number as f64))?;
        }
        Ok(real((at + 1) as f64))
    }

    /// All places in a parent in the order of execution.
    pub(super) fn in_order(&self, parent: u64, keyword: &'static str) -> Vec<Place> {
        let links = self.program.aim().links(parent);
        let mut found: Vec<Place> = links
            .relations
            .iter()
            .filter(|relation| relation.keyword == keyword)
            .map(|relation| Place {
                relationship: relation.id,
                keyword,
                parent,
                sequence: relation.sequence,
            })
            .collect();
        let number = |place: &Place| place.sequence.unwrap_or(f64::INFINITY);
        found.sort_by(|a, b| number(a).total_cmp(&number(b)));
        found
    }

    pub(super) fn ordered(&self, spot: Spot) -> Result<Place, ChangeError> {
        let place = self.place(spot)?;
        if place.keyword == SEQUENCE || place.keyword == TOOLPATHS {
            return Ok(place);
        }
        unfit(
            spot.part,
            "not in an ordered place of a workplan or operation",
            "choose a child of a workplan, or a toolpath",
        )
    }

    /// The place that a spot means; without a parent the only one.
    pub(super) fn place(&self, spot: Spot) -> Result<Place, ChangeError> {
        let keywords: &[&'static str] = match spot.part {
            Part::Executable(_) => &[SEQUENCE, UNORDERED[0], UNORDERED[1], UNORDERED[2]],
            Part::Toolpath(_) => &[TOOLPATHS],
        };
        let file = self.program.file();
        let mut found: Vec<Place> = file
            .inverse(spot.part.id())
            .iter()
            .filter_map(|&row| {
                let keyword = keywords.iter().copied().find(|keyword| *keyword == file.keyword(row))?;
                let relationship = file.instance(row).ok()?;
                (relationship.argument(3).reference() == Some(spot.part.id())).then_some(())?;
                let parent = relationship.argument(2).reference()?;
                Some(Place {
                    relationship: file.id(row),
                    keyword,
                    parent,
                    sequence: relationship.argument(4).number(),
                })
            })
            .filter(|place| spot.parent.is_none_or(|parent| parent == place.parent))
            .collect();
        let number = |place: &Place| place.sequence.unwrap_or(f64::INFINITY);
        found.sort_by(|a, b| number(a).total_cmp(&number(b)));
        match (found.get(spot.turn), found.len()) {
            (Some(_), n) if n > 1 && spot.parent.is_none() => unfit(
                spot.part,
                "executed at several places",
                "say which one by the names around it",
            ),
            (Some(place), _) => Ok(*place),
            (None, _) => unfit(
                spot.part,
                "not in an ordered place of a workplan or operation",
                "choose a child of a workplan, or a toolpath",
            ),
        }
    }

    /// Sets a parameter of a relationship or property.
    pub(super) fn set(&mut self, id: u64, parameter: usize, literal: &str) -> Result<(), ChangeError> {
        let Some(row) = self.program.file().row(id) else {
            return Err(ChangeError::Unfit {
                id,
                what: "not in the file",
                instead: "repair the file first",
            });
        };
        Ok(self.edits.set_parameter(row, None, parameter, literal)?)
    }

    pub(super) fn spelled(&self, id: u64, parameter: usize) -> Option<&str> {
        self.edits.parameter(self.program.file().row(id)?, None, parameter)
    }
}

impl From<Part> for Spot {
    /// The only place of a part.
    fn from(part: Part) -> Spot {
        Spot {
            part,
            parent: None,
            turn: 0,
        }
    }
}

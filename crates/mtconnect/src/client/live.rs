//! Places as they come, for the text form: what [`crate::track`] makes of a whole recording, one observation at a time.
//!
//! The data item is chosen once, from what the agent observes: there is no counting of values beforehand. Axes that are told for the
//! same moment are one place, so a place of axes is given out when the next moment begins, or when the agent says that there is no more.

use super::document::Told;
use super::items::{Item, Items};
use crate::candidate::{Candidate, Named, axis_of, candidate_of};
use crate::streams::{Category, Value};
use crate::track::{number, three_numbers};
use plan::{Diagnostic, Diagnostics};
use units::Timestamp;

/// A place, or that none is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// When.
    pub at: Timestamp,
    /// The agent's number of the last observation in it.
    pub sequence: u64,
    /// X, Y, Z in millimetres; `None` when nobody knows.
    pub position: Option<[f64; 3]>,
}

/// Makes places of observations.
#[derive(Clone, Debug, Default)]
pub struct LivePlaces {
    /// As [`LivePlaces::choose`] gave it to the process before.
    wanted: Option<String>,
    chosen: Option<Candidate>,
    /// What each item is to the chosen candidate, as far as they were looked at.
    roles: Vec<Role>,
    axes: [Option<f64>; 3],
    known: bool,
    waiting: Option<Place>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    None,
    Path,
    Axis(usize),
}

impl LivePlaces {
    /// Takes up what another process did: its choice, and its last place.
    pub fn resume(chosen: &str, last: Option<[f64; 3]>) -> LivePlaces {
        LivePlaces {
            wanted: Some(chosen.to_owned()),
            axes: last.map_or([None; 3], |p| p.map(Some)),
            known: last.is_some(),
            ..LivePlaces::default()
        }
    }

    /// The data item that positions are taken from; chosen with the first call.
    ///
    /// # Errors
    /// The agent observes no position, or no longer the one that was chosen before.
    pub fn choose(&mut self, items: &Items, diagnostics: &mut Diagnostics) -> Result<String, String> {
        if let Some(chosen) = &self.chosen {
            return Ok(chosen.to_string());
        }
        let is_whole = |c: &Candidate| {
            let axes = items.all().iter().filter(|i| candidate(i).as_ref() == Some(c));
            let mut there = [false; 3];
            axes.filter_map(|i| axis_of(&named(i))).for_each(|k| there[k] = true);
            !c.axes || there == [true; 3]
        };
        let mut candidates: Vec<Candidate> = items.all().iter().filter_map(candidate).filter(is_whole).collect();
        candidates.sort();
        candidates.dedup();
        let fits = |c: &&Candidate| self.wanted.as_ref().is_none_or(|wanted| c.to_string() == *wanted);
        let best = candidates
            .iter()
            .filter(fits)
            .max_by_key(|c| (c.rank(), std::cmp::Reverse(*c)))
            .cloned();
        let all: Vec<String> = candidates.iter().map(Candidate::to_string).collect();
        let Some(best) = best else {
            return Err(match &self.wanted {
                Some(wanted) => format!("the agent has no position {wanted} any more; it has: {}", all.join(", ")),
                None => "the agent observes no position: a PATH_POSITION, or the POSITION of linear axes X, Y and Z".to_owned(),
            });
        };
        if candidates.len() > 1 && self.wanted.is_none() {
            let message = format!("positions are taken from {best}; the agent has: {}", all.join(", "));
            let remedy = "select another with --path, or record all of them into a .parquet file";
            diagnostics.add(Diagnostic::remark("several-positions", message).remedy(remedy));
        }
        let name = best.to_string();
        self.chosen = Some(best);
        Ok(name)
    }

    /// Takes an observation; gives the place that is complete by it. What is no position is passed over.
    pub fn take(&mut self, told: &Told, items: &Items, diagnostics: &mut Diagnostics) -> Option<Place> {
        let position = match (self.role(told.item, items), &told.value) {
            (Role::None, _) => return None,
            (Role::Path, Value::Unavailable) => None,
            (Role::Path, Value::Text(text)) => match three_numbers(text) {
                Some(position) => Some(position),
                None => return bad(told, text, "three numbers", diagnostics),
            },
            (Role::Axis(axis), value) => {
                match value {
                    Value::Unavailable => self.axes[axis] = None,
                    Value::Text(text) => match number(text) {
                        Some(value) => self.axes[axis] = Some(value),
                        None => return bad(told, text, "a number", diagnostics),
                    },
                }
                match self.axes {
                    [Some(x), Some(y), Some(z)] => Some([x, y, z]),
                    // Before all three were told once, nothing is missing yet.
                    _ if !self.known => return None,
                    _ => None,
                }
            }
        };
        self.known = true;
        let place = Place {
            at: told.at,
            sequence: told.sequence,
            position,
        };
        if self.chosen.as_ref().is_some_and(|c| !c.axes) {
            return Some(place);
        }
        let before = self.waiting.replace(place);
        before.filter(|b| b.at != place.at)
    }

    /// Nothing more is told at the moment: the place that waits for its other axes, if there is one.
    pub fn rest(&mut self) -> Option<Place> {
        self.waiting.take()
    }

    /// The agent was started anew, or something is missing: what axes were told before does not count any more.
    pub fn forget(&mut self) {
        self.axes = [None; 3];
        self.known = false;
    }

    fn role(&mut self, item: u32, items: &Items) -> Role {
        while self.roles.len() <= item as usize {
            let next = &items.all()[self.roles.len()];
            let role = match &self.chosen {
                Some(chosen) if candidate(next).as_ref() == Some(chosen) => {
                    axis_of(&named(next)).filter(|_| chosen.axes).map_or(Role::Path, Role::Axis)
                }
                _ => Role::None,
            };
            self.roles.push(role);
        }
        self.roles[item as usize]
    }
}

fn bad(told: &Told, text: &str, expected: &str, diagnostics: &mut Diagnostics) -> Option<Place> {
    let shown: String = text.chars().take(40).collect();
    let message = format!(
        "sequence {} is \"{shown}\" where {expected} or UNAVAILABLE was expected; it was left out",
        told.sequence
    );
    diagnostics.add(Diagnostic::warning("bad-position", message));
    None
}

fn named(item: &Item) -> Named<'_> {
    Named {
        kind: &item.kind,
        sub_type: &item.sub_type,
        id: &item.id,
        name: &item.name,
        source: &item.source,
    }
}

fn candidate(item: &Item) -> Option<Candidate> {
    let is_position = item.category == Category::Sample && (item.kind == "PathPosition" || item.kind == "Position");
    is_position.then(|| candidate_of(&named(item))).flatten()
}

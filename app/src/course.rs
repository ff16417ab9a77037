//! How a run is run otherwise than from its beginning and as programmed, and what that came to.

use crate::foreseen::Foreseen;
use crate::overriding::{Overridden, Overriding};
use crate::taking_up::{TakeUp, TakenUp};
use motion::RemainingTime;
use serde::Serialize;

/// What was asked of a run beside the program.
#[derive(Default)]
pub struct Asked<'a> {
    /// It is taken up in its middle; with what the report says of it.
    pub take_up: Option<(&'a TakeUp, &'a TakenUp)>,
    /// Overrides and holds.
    pub overriding: Overriding,
    /// The plan made beforehand.
    pub plan: Option<&'a RemainingTime>,
    /// How far from its path the machine may be led back to it by itself after a cut, mm.
    pub approach: Option<f64>,
}

/// What a run came to beside its record.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Course {
    /// Where it was taken up, and by whom.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restart: Option<TakenUp>,
    /// How long it took, against what was foreseen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<Foreseen>,
    /// Overrides and holds.
    #[serde(flatten)]
    pub overridden: Overridden,
}

impl Course {
    /// In sentences.
    pub fn lines(&self) -> Vec<String> {
        // Where it was taken up is among the findings.
        let time = self.time.map(|time| time.line());
        time.into_iter().chain(self.overridden.line()).collect()
    }
}

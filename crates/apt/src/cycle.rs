//! Drilling cycles, told move by move: each place behind `CYCLE/DRILL,...` is a hole, until `CYCLE/OFF`.
//!
//! Heights count from the place along the tool: `RAPTO` where the feed begins, `FEDTO` where it ends (below is negative), `RTRCTO` where
//! the tool goes when the hole is done. `DEPTH`, `CLEAR` and `RETURN` say the same with positive numbers.

use super::acting::{fault, plan_feed};
use super::statement::Statement;
use super::{AptProgram, Fault, Feed};
use plan::{Speed, SpindleState, StepKind};
use units::Seconds;

/// A cycle in force. Lengths in mm.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cycle {
    kind: Kind,
    rapid_to: f64,
    feed_to: f64,
    retract_to: Option<f64>,
    step: Option<f64>,
    dwell: f64,
    feed: Option<Feed>,
}

/// How the tool comes out, and whether it does so on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Rapid out.
    Drill,
    /// Out of the hole after each step.
    Deep,
    /// A little back after each step.
    BreakChip,
    /// Out at the feed.
    Bore,
    /// Out with the spindle turning backwards.
    Tap,
}

/// How far the tool goes back to break the chip, and stays above the last depth when it comes back, mm.
const BACK: f64 = 0.5;

/// More pecks in one hole are a slip of the pen.
const MOST_PECKS: f64 = 10_000.0;

impl Cycle {
    pub(super) fn of(program: &AptProgram, statement: &Statement) -> Result<Cycle, Fault> {
        let name = statement
            .words
            .first()
            .map(|word| word.to_ascii_uppercase())
            .unwrap_or_default();
        let kind = match name.as_str() {
            "DRILL" | "FACE" | "CSINK" | "SPOT" | "CDRILL" => Kind::Drill,
            "DEEP" | "PECK" => Kind::Deep,
            "BRKCHP" => Kind::BreakChip,
            "BORE" | "REAM" => Kind::Bore,
            "TAP" => Kind::Tap,
            other => {
                return fault(
                    "cycle",
                    format!("the cycle '{other}' is not known"),
                    "use DRILL, FACE, CSINK, DEEP, BRKCHP, BORE, REAM or TAP, or let the CAM system write its moves",
                );
            }
        };
        let unit = program.unit();
        let length = |words: &[&str]| words.iter().find_map(|word| statement.number_after(word)).map(|n| n * unit);
        let feed_to = length(&["FEDTO"]).or(length(&["DEPTH"]).map(|depth| -depth.abs()));
        let Some(feed_to) = feed_to else {
            return fault(
                "cycle",
                "a cycle needs FEDTO or DEPTH".into(),
                "write CYCLE/DRILL,RAPTO,3,FEDTO,-20",
            );
        };
        let rapid_to = length(&["RAPTO", "CLEAR"]).unwrap_or(0.0);
        let step = length(&["STEP", "INCR"]).map(f64::abs).filter(|step| *step > 0.0);
        if matches!(kind, Kind::Deep | Kind::BreakChip) && step.is_none() {
            return fault("cycle", format!("{name} needs STEP, the depth of one peck"), "write STEP,5");
        }
        if feed_to > rapid_to {
            return fault(
                "cycle",
                format!("the hole ends {feed_to} mm above the place and begins at {rapid_to} mm"),
                "FEDTO below the place is negative",
            );
        }
        if step.is_some_and(|step| (rapid_to - feed_to) / step > MOST_PECKS) {
            return fault(
                "cycle",
                "the steps of the cycle are too small for its depth".into(),
                "give a larger STEP",
            );
        }
        let feed = ["MMPM", "IPM", "MMPR", "IPR"]
            .iter()
            .find_map(|word| statement.number_after(word))
            .filter(|feed| *feed > 0.0)
            .map(|number| program.feed_of(statement, number));
        Ok(Cycle {
            kind,
            rapid_to,
            feed_to,
            retract_to: length(&["RTRCTO", "RETURN"]),
            step,
            dwell: statement.number_after("DWELL").unwrap_or(0.0).max(0.0),
            feed,
        })
    }
}

impl AptProgram {
    /// Makes one hole.
    pub(super) fn hole(&mut self, place: [f64; 3]) -> Result<(), Fault> {
        self.run.state.rapid = false;
        let Some(cycle) = self.run.state.cycle.clone() else {
            return Ok(());
        };
        let feed = match cycle.feed {
            Some(feed) => Speed::Feed(plan_feed(feed)),
            None => self.speed()?,
        };
        let [x, y, z] = place;
        let at = |height: f64| [x, y, z + height];
        // Across at whichever is higher, so that nothing is in the way.
        let height = self.tip()[2].max(z + cycle.rapid_to);
        self.line([x, y, height], Speed::Rapid);
        self.line(at(cycle.rapid_to), Speed::Rapid);
        let mut depth = cycle.rapid_to;
        if let Some(step) = cycle.step.filter(|_| matches!(cycle.kind, Kind::Deep | Kind::BreakChip)) {
            let mut next = 0.0_f64.min(cycle.rapid_to) - step;
            while next > cycle.feed_to {
                self.line(at(next), feed);
                match cycle.kind {
                    Kind::Deep => {
                        self.line(at(cycle.rapid_to), Speed::Rapid);
                        self.line(at((next + BACK).min(cycle.rapid_to)), Speed::Rapid);
                    }
                    _ => self.line(at((next + BACK).min(depth)), Speed::Rapid),
                }
                depth = next;
                next -= step;
            }
        }
        self.line(at(cycle.feed_to), feed);
        if cycle.dwell > 0.0 {
            self.say(StepKind::Dwell(Seconds(cycle.dwell)));
        }
        let out = cycle.retract_to.unwrap_or(cycle.rapid_to);
        match cycle.kind {
            Kind::Drill | Kind::Deep | Kind::BreakChip => self.line(at(out.max(cycle.rapid_to)), Speed::Rapid),
            Kind::Bore => {
                self.line(at(cycle.rapid_to), feed);
                self.line(at(out.max(cycle.rapid_to)), Speed::Rapid);
            }
            Kind::Tap => {
                let forward = self.run.state.spindle;
                let backward = match forward {
                    SpindleState::Clockwise(mode) => SpindleState::Counterclockwise(mode),
                    SpindleState::Counterclockwise(mode) => SpindleState::Clockwise(mode),
                    still => still,
                };
                self.turn(backward);
                self.line(at(cycle.rapid_to), feed);
                self.turn(forward);
                self.line(at(out.max(cycle.rapid_to)), Speed::Rapid);
            }
        }
        Ok(())
    }
}

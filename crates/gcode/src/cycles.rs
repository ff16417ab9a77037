//! Canned cycles: a block that stands for many moves.
//!
//! A cycle checks all its words first; what can be wrong is an alarm before anything moves. Then it becomes an [`Expansion`], which
//! tells its moves a hole or a pass at a time as they are asked for: never is a whole cycle kept. All its steps have the cycle's line
//! as their origin.
//!
//! Each family is a file: [`drilling`] for G73 to G89, [`turning`] for the single cycles G90 and G94, [`threading`] for G32, G92 and
//! G76 of lathes, [`grooving`] for G74 and G75, [`roughing`] and [`levels`] for G70 to G73 over a contour of the program.
//!
//! Alarm numbers are those of the 16i family: 061 to 066 for the cycles of lathes, 045 for a missing Q of drilling.

pub(crate) mod drilling;
pub(crate) mod grooving;
pub(crate) mod levels;
pub(crate) mod roughing;
pub(crate) mod threading;
pub(crate) mod turning;

use crate::block::Word;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, MOST_ITEMS};
use plan::{Feed, Severity, Speed};

/// A cycle that is being told. Its words are checked: telling it cannot fail.
pub(crate) trait Expansion: Send {
    /// Tells the next part; false when there is none.
    fn next(&mut self, interpreter: &mut Interpreter) -> bool;
}

/// What the cycles of a lathe keep from block to block.
#[derive(Debug, Default)]
pub(crate) struct TurningCycles {
    /// G90, G92 or G94 in force.
    pub single: Option<turning::Single>,
    /// What the first blocks of two-block forms said.
    pub rough: roughing::RoughSettings,
    pub thread: threading::ThreadSettings,
    /// Return of G74 and G75, mm.
    pub peck_return: f64,
    /// A contour has to be read before the cycle can begin.
    pub request: Option<roughing::ContourRequest>,
}

impl Interpreter {
    /// Takes up a cycle. Compensation is interrupted: cycles go where their words say.
    pub(crate) fn begin_expansion(&mut self, expansion: impl Expansion + 'static) {
        self.interrupt_compensation();
        self.compensation.suspended = true;
        self.expansion = Some(Box::new(expansion));
    }

    /// True when nothing is to be given on before the next line is executed.
    pub(crate) fn has_said_nothing(&self) -> bool {
        self.out.is_empty() && self.expansion.is_none()
    }

    /// Tells the next part of the cycle being told; false when there is none.
    pub(crate) fn go_on(&mut self) -> bool {
        let Some(mut expansion) = self.expansion.take() else {
            return false;
        };
        if expansion.next(self) {
            self.expansion = Some(expansion);
        } else {
            self.compensation.suspended = false;
        }
        true
    }

    /// Tells a whole cycle at once, where something of its block comes behind it.
    pub(crate) fn go_on_to_the_end(&mut self) -> Outcome<()> {
        while self.go_on() {
            if self.out.len() > MOST_ITEMS {
                return Err(Fault::new(
                    0,
                    0,
                    "cycle-too-long",
                    format!("this block makes more than {MOST_ITEMS} moves and has an M code behind them"),
                    "give the M code a block of its own",
                ));
            }
        }
        Ok(())
    }

    /// Moves the tip straight, one or two axes of it.
    pub(crate) fn go(&mut self, to: [(usize, f64); 2], speed: Speed) {
        let mut place = self.tip;
        for (axis, value) in to {
            place[axis] = value;
        }
        self.line(place, speed);
    }

    /// A length of P, Q or D of a lathe's cycle, where no decimal point is allowed: least increments; with a point it is what it says.
    pub(crate) fn increments(&self, word: Word) -> f64 {
        let unit = if word.has_point || word.computed {
            1.0
        } else {
            self.profile.increment[usize::from(self.inches)]
        };
        word.value * unit * self.unit()
    }

    /// The cutting feed of a cycle.
    pub(crate) fn cutting(&self, at: usize) -> Outcome<Speed> {
        Ok(Speed::Feed(self.feed(at)?))
    }

    /// Says once that a cycle takes no account of the nose radius.
    pub(crate) fn note_no_compensation(&mut self, cycle: &str, at: usize, site: Site<'_>) {
        if self.compensation.is_wanted() {
            self.note(Severity::Warning, "cycle-without-compensation", site, at, || {
                (
                    format!("the radius of the tool is not taken account of in {cycle}"),
                    "cancel G41 and G42 before it, and write the contour for the tip".to_owned(),
                )
            });
        }
    }
}

/// The same feed with another length a revolution or a minute.
pub(crate) fn faster(speed: Speed, times: f64) -> Speed {
    match speed {
        Speed::Feed(Feed::PerTime(v)) => Speed::Feed(Feed::PerTime(v * times)),
        Speed::Feed(Feed::PerRevolution(v)) => Speed::Feed(Feed::PerRevolution(v * times)),
        other => other,
    }
}

/// Alarm 062: a word of G71 to G76 that makes no sense.
pub(crate) fn illegal(at: usize, message: impl Into<String>, remedy: &str) -> Box<Fault> {
    Fault::new(at, 62, "cycle-word", message, remedy)
}

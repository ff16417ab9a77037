//! Moves tied to the angle of the spindle: threads of a lathe as they are, the steps of a tapped hole put together again, because written
//! one by one they would break the tap.

use crate::posting::Posting;
use crate::sheet::Refusal;
use crate::statement::{Line, Pace, Statement};
use plan::{Path, SpindleState, StepKind};
use units::Setup;

/// A tapped hole of which the way in was told.
pub(crate) struct Tap {
    from: [i64; 3],
    bottom: i64,
    advance: f64,
    spindle: SpindleState,
    /// The spindle was turned round, the tool is out.
    reversed: bool,
    out: bool,
}

impl Posting<'_, '_> {
    /// A move tied to the angle of the spindle.
    pub(crate) fn thread(&mut self, path: &Path<Setup>, thread: plan::Thread) -> Result<(), Refusal> {
        let Path::Line { from, to } = path else {
            return Err(Refusal::new(
                "thread",
                "a thread along a curve",
                "only straight threads are posted",
            ));
        };
        let (start, end) = (self.rounded(*from)?, self.rounded(*to)?);
        let length = from.distance(*to);
        if !self.options.turning || (start[0] == 0 && end[0] == 0) {
            let along_z = start[0] == end[0] && start[1] == end[1] && start[2] != end[2];
            if along_z && self.tap.is_none() && end[2] < start[2] {
                self.tap = Some(Tap {
                    from: start,
                    bottom: end[2],
                    advance: thread.advance.0,
                    spindle: self.spindle,
                    reversed: false,
                    out: false,
                });
                return Ok(());
            }
            return Err(Refusal::new(
                "thread",
                "a move tied to the spindle that is no tapped hole",
                "let the program use a tapping cycle (G74, G84)",
            ));
        }
        let delta = *to - *from;
        let axis = (0..3)
            .max_by(|a, b| delta.xyz[*a].abs().total_cmp(&delta.xyz[*b].abs()))
            .unwrap_or(2);
        if !(thread.advance.0.is_finite() && thread.advance.0 > 0.0) {
            return Err(Refusal::new(
                "thread",
                format!("a thread of {} mm for each revolution", thread.advance.0),
                "give the thread its lead",
            ));
        }
        if length <= 0.0 {
            return Ok(());
        }
        let mut words = [None; 3];
        for k in [0, 2] {
            if self.at[k].unwrap_or(start[k]) != end[k] {
                words[k] = Some(end[k]);
            }
            self.at[k] = Some(end[k]);
        }
        let line = Line {
            words,
            pace: Pace::PerRevolution(thread.advance.0),
        };
        let lead = thread.advance.0 * delta.xyz[axis].abs() / length;
        self.write(&Statement::Thread {
            line: &line,
            advance: thread.advance.0,
            lead,
            axis,
            start: thread.start.map(|angle| angle.0.to_degrees()),
        })
    }

    /// Takes a step that belongs to a tapped hole; false when the hole is done and the step is another's.
    pub(crate) fn tapping(&mut self, kind: &StepKind) -> Result<bool, Refusal> {
        let Some(tap) = &mut self.tap else { return Ok(false) };
        match kind {
            StepKind::Dwell(_) if !tap.out => {
                self.sheet.notice("dwells at the bottom of tapped holes are left out");
                Ok(true)
            }
            StepKind::Spindle(state) if !tap.reversed => {
                tap.reversed = true;
                self.spindle = *state;
                Ok(true)
            }
            StepKind::Move(go) if tap.reversed && !tap.out => {
                let back = matches!(go.speed, plan::Speed::Feed(plan::Feed::Thread(_)));
                let end = go.path.in_frame(&self.base_from_setup).end();
                let end = self.rounded(end)?;
                let Some(tap) = &mut self.tap else { return Ok(false) };
                if !back || end != tap.from {
                    return Err(Refusal::new(
                        "thread",
                        "a tapped hole that is not left the way it was entered",
                        "let the program use a tapping cycle (G74, G84)",
                    ));
                }
                tap.out = true;
                Ok(true)
            }
            StepKind::Spindle(state) if tap.out => {
                let same = *state == tap.spindle;
                self.spindle = *state;
                self.finish_tap()?;
                // The cycle leaves the spindle as it was; anything else is said.
                Ok(same)
            }
            _ => {
                self.finish_tap()?;
                Ok(false)
            }
        }
    }

    pub(crate) fn finish_tap(&mut self) -> Result<(), Refusal> {
        let Some(tap) = self.tap.take() else { return Ok(()) };
        let (left, mode) = match tap.spindle {
            SpindleState::Clockwise(mode) => (false, mode),
            SpindleState::Counterclockwise(mode) => (true, mode),
            SpindleState::Stopped | SpindleState::Oriented => {
                return Err(Refusal::new(
                    "thread",
                    "a hole is tapped and the spindle stands",
                    "start the spindle before",
                ));
            }
        };
        if !tap.out {
            return Err(Refusal::new(
                "thread",
                "a tapped hole that is not left the way it was entered",
                "let the program use a tapping cycle (G74, G84)",
            ));
        }
        let plan::SpindleMode::Revolutions(speed) = mode else {
            return Err(Refusal::new(
                "thread",
                "a hole is tapped at a surface speed",
                "give revolutions",
            ));
        };
        self.write(&Statement::Tap {
            bottom: tap.bottom,
            back: tap.from[2],
            at: [tap.from[0], tap.from[1]],
            pitch: tap.advance,
            left,
            speed: speed.0,
        })?;
        self.at[2] = Some(tap.from[2]);
        Ok(())
    }
}

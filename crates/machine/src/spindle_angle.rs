//! The angle of the spindle out of whole counts of its encoder: where it is, how fast it turns, and where its index mark is.
//!
//! A tracking filter of third order with three equal poles (fading memory, Morrison 1969): an even acceleration leaves no lag, and what a
//! count is coarse shows by a tenth in the angle and by a fiftieth of a count each cycle in the speed.

use crate::Feedback;
use units::TICK;

/// The poles: a change is followed within some ten cycles.
const POLE: f64 = 0.85;
const OF_ANGLE: f64 = 1.0 - POLE * POLE * POLE;
const OF_SPEED: f64 = 1.5 * (1.0 - POLE * POLE) * (1.0 - POLE);
const OF_ACCELERATION: f64 = (1.0 - POLE) * (1.0 - POLE) * (1.0 - POLE);
/// A reading this far from where the spindle was going to be is no reading of the same count, turns: the filter begins anew.
const JUMP: f64 = 0.25;
/// An index mark may be this far from where it was, turns: the pulse has a width.
const SLIP: f64 = 0.01;
/// Turns without a pulse after which it is missing.
const MISSING: f64 = 2.5;

/// What is known of the spindle's angle.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SpindleAngle {
    /// Turns, as the encoder counts; turns each second; turns each second squared.
    pub turns: f64,
    pub speed: f64,
    pub acceleration: f64,
    /// Something is read.
    pub is_read: bool,
    /// What the encoder reads at the index mark, within a turn; `None` until it was passed.
    pub mark: Option<f64>,
    /// A pulse came where there was none.
    pub has_slipped: bool,
    /// What was read at the last pulse, or where waiting for it began.
    last_pulse: f64,
}

impl SpindleAngle {
    /// Takes what the drives tell in a cycle that is `cycles` after the one before.
    pub fn take(&mut self, feedback: &Feedback, cycles: u64) {
        let Some(reading) = feedback.spindle_angle.filter(|turns| turns.is_finite()) else {
            *self = SpindleAngle::default();
            return;
        };
        let time = cycles.max(1) as f64 * TICK.0;
        let expected = self.turns + (self.speed + self.acceleration * time / 2.0) * time;
        let off = reading - expected;
        if !self.is_read || off.abs() > JUMP {
            *self = SpindleAngle {
                turns: reading,
                is_read: true,
                last_pulse: reading,
                ..SpindleAngle::default()
            };
        } else {
            self.turns = expected + OF_ANGLE * off;
            self.speed += self.acceleration * time + OF_SPEED / time * off;
            self.acceleration += OF_ACCELERATION / (time * time) * off;
        }
        if let Some(pulse) = feedback.spindle_index.filter(|turns| turns.is_finite()) {
            let mark = pulse - libm::floor(pulse);
            let moved = self.mark.map_or(0.0, |known| mark - known);
            self.has_slipped |= (moved - libm::round(moved)).abs() > SLIP;
            self.mark = Some(mark);
            self.last_pulse = pulse;
        }
    }

    /// True when the spindle has turned too far without a pulse.
    pub fn misses_index(&self) -> bool {
        (self.turns - self.last_pulse).abs() > MISSING
    }

    /// Forgets a slip that was told.
    pub fn acknowledge(&mut self) {
        self.has_slipped = false;
        self.last_pulse = self.turns;
    }

    /// Degrees from the index mark, clockwise, 0 to below 360; not a number while it is not known.
    pub fn degrees(&self) -> f64 {
        match self.mark {
            Some(mark) if self.is_read => {
                let turns = self.turns - mark;
                (turns - libm::floor(turns)) * 360.0
            }
            _ => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(turns: f64) -> Feedback {
        const COUNTS: f64 = 4096.0;
        Feedback {
            spindle_angle: Some(libm::floor(turns * COUNTS) / COUNTS),
            ..Feedback::default()
        }
    }

    #[test]
    fn an_even_acceleration_is_followed_without_lag() {
        let mut angle = SpindleAngle::default();
        let place = |t: f64| 10.0 * t + 40.0 * t * t;
        for n in 0..400 {
            angle.take(&reading(place(f64::from(n) * 1e-3)), 1);
        }
        let t = 0.399;
        // Readings are rounded down: half a count behind on average.
        assert!((angle.turns - place(t)).abs() < 1.0 / 4096.0, "{angle:?} {}", place(t));
        assert!((angle.speed - (10.0 + 80.0 * t)).abs() < 0.1, "{angle:?}");
    }

    #[test]
    fn a_mark_that_moves_is_noticed_and_one_at_every_turn_is_not() {
        let mut angle = SpindleAngle::default();
        for n in 0..50 {
            let index = (n % 10 == 0).then(|| f64::from(n / 10) + 0.25);
            let turns = f64::from(n) * 0.1 + 0.25;
            angle.take(
                &Feedback {
                    spindle_index: index,
                    ..reading(turns)
                },
                1,
            );
        }
        assert_eq!(
            (angle.mark, angle.has_slipped, angle.misses_index()),
            (Some(0.25), false, false)
        );
        angle.take(
            &Feedback {
                spindle_index: Some(5.3),
                ..reading(5.25)
            },
            1,
        );
        assert!(angle.has_slipped);
    }
}

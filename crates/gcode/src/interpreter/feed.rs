//! Feed, spindle and coolant of a block.

use super::*;

impl Interpreter {
    pub(super) fn set_feed(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        if self.feed_mode == FeedMode::InverseTime {
            self.feed = None; // must stand in every block
        }
        let Some(f) = block.take(b'F') else { return Ok(()) };
        if f.value < 0.0 {
            return Err(Fault::new(f.at, 0, "feed-negative", "a feed cannot be negative", "correct F"));
        }
        if f.value == 0.0 {
            self.feed = None;
            self.note(Severity::Warning, "feed-zero", site, f.at, || {
                (
                    "F0 takes the feed away".to_owned(),
                    "write a feed before the next cutting move".to_owned(),
                )
            });
            return Ok(());
        }
        self.last_f = Some(f.value * self.unit());
        self.feed = Some(match self.feed_mode {
            FeedMode::PerMinute => f.value * self.unit() / 60.0,
            FeedMode::PerRevolution => f.value * self.unit(),
            FeedMode::InverseTime => 60.0 / f.value,
        });
        Ok(())
    }

    /// The feed in force.
    pub(crate) fn feed(&self, at: usize) -> Outcome<Feed> {
        let Some(feed) = self.feed else {
            let remedy = match self.feed_mode {
                FeedMode::PerMinute => "write F, the feed a minute",
                FeedMode::PerRevolution => "write F, the feed a revolution",
                FeedMode::InverseTime => "with G93 every cutting block has its own F",
            };
            return Err(Fault::new(at, 11, "no-feed", "a cutting move without a feed", remedy));
        };
        Ok(match self.feed_mode {
            FeedMode::PerMinute => Feed::PerTime(MmPerSec(feed)),
            FeedMode::PerRevolution => {
                if self.turning == Turning::Stopped && !self.rigid_tapping {
                    return Err(Fault::new(
                        at,
                        0,
                        "spindle-stopped",
                        "a feed per revolution while the spindle stands: the axes would never move",
                        "start the spindle with M3 or M4 first",
                    ));
                }
                Feed::PerRevolution(Millimetres(feed))
            }
            FeedMode::InverseTime => Feed::WholeMove(units::Seconds(feed)),
        })
    }

    pub(super) fn set_spindle(&mut self, block: &mut Block, said: &Said, m_codes: &[Code], site: Site<'_>) -> Outcome<()> {
        if let Some(on) = said.surface {
            match (on, self.surface) {
                (true, None) => self.surface = Some(self.surface_speed),
                (false, Some(_)) => {
                    // G97 without S goes on at the speed that turns now.
                    self.revolutions = self.spindle.revolutions(Millimetres(self.tip[0])).0;
                    self.surface = None;
                }
                _ => {}
            }
            if on
                && !self.profile.turning
                && let Some(d) = block.take(b'D')
            {
                self.spindle_limit = Some(Rpm(d.value.max(0.0)));
            }
        }
        let limits = matches!(said.once, Some((Once::SetPosition, _)));
        if let Some(s) = block.take(b'S') {
            if s.value < 0.0 {
                return Err(Fault::new(
                    s.at,
                    0,
                    "speed-negative",
                    "a spindle speed cannot be negative",
                    "use M4 to turn the other way",
                ));
            }
            self.last_s = Some(s.value);
            if limits {
                self.spindle_limit = Some(Rpm(s.value));
            } else if self.surface.is_some() {
                // m/min, or ft/min with G20
                self.surface_speed = s.value * if self.inches { 304.8 } else { 1000.0 } / 60.0;
                self.surface = Some(self.surface_speed);
            } else {
                self.revolutions = s.value;
            }
        }
        let mut oriented = self.spindle == SpindleState::Oriented;
        for m in m_codes {
            match self.m_meaning(*m)? {
                M::Clockwise => self.start_spindle(Turning::Clockwise, m.at, site),
                M::Counterclockwise => self.start_spindle(Turning::Counterclockwise, m.at, site),
                M::SpindleStop => self.turning = Turning::Stopped,
                M::RigidTapping => self.rigid_tapping = true,
                M::Orient => {
                    self.orient();
                    oriented = true;
                }
                _ => {}
            }
        }
        if self.turning != Turning::Stopped && self.surface.is_some() && self.spindle_limit.is_none() {
            let limit = self.options.spindle_limit;
            self.spindle_limit = Some(limit);
            self.note(Severity::Warning, "no-spindle-limit", site, 0, || {
                (
                    format!("surface speed without a highest spindle speed: {:.0} is assumed", limit),
                    "write G50 S before G96".to_owned(),
                )
            });
        }
        // An oriented spindle stays so until something turns it.
        if !(oriented && self.turning == Turning::Stopped) {
            self.say_spindle();
        }
        Ok(())
    }

    pub(super) fn start_spindle(&mut self, way: Turning, at: usize, site: Site<'_>) {
        self.turning = way;
        self.rigid_tapping = false;
        if self.surface.unwrap_or(self.revolutions) == 0.0 {
            self.note(Severity::Warning, "no-spindle-speed", site, at, || {
                (
                    "the spindle is started without a speed".to_owned(),
                    "write S before M3 or M4".to_owned(),
                )
            });
        }
    }

    /// Tells the spindle's state when it differs from what was told last.
    pub(crate) fn say_spindle(&mut self) {
        let mode = match self.surface {
            Some(speed) => SpindleMode::Surface {
                speed: MmPerSec(speed),
                limit: self.spindle_limit.unwrap_or(self.options.spindle_limit),
            },
            None => SpindleMode::Revolutions(match self.spindle_limit {
                Some(limit) => Rpm(self.revolutions).min(limit),
                None => Rpm(self.revolutions),
            }),
        };
        let state = match self.turning {
            Turning::Stopped => SpindleState::Stopped,
            Turning::Clockwise => SpindleState::Clockwise(mode),
            Turning::Counterclockwise => SpindleState::Counterclockwise(mode),
        };
        if state != self.spindle {
            self.spindle = state;
            self.emit(StepKind::Spindle(state));
        }
    }

    pub(super) fn set_coolant(&mut self, state: CoolantState) {
        if state != self.coolant {
            self.coolant = state;
            self.emit(StepKind::Coolant(state));
        }
    }
}

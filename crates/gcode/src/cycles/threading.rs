//! Threads: G32 (a mill's G33), G33.1 of RS274, the pass of G92, and the cycle G76 in its two-block and one-block forms.
//!
//! F is the lead along the axis that goes farther; RS274 says by K how far a revolution goes along the path. A thread's moves carry
//! [`plan::Feed::Thread`]: they are tied to the spindle, from its index mark plus Q.
//!
//! G76: the depth after pass n is `first * sqrt(n)`, by at least the least depth, down to the depth less the finishing allowance; then
//! the finishing passes go to the full depth. The tool feeds in along one flank: a pass at depth h begins `h * tan(angle / 2)` farther
//! along. That every finishing pass goes to the full depth, and the way in along the leading flank, are read from manuals' figures and
//! not verified on a control.

use crate::block::Block;
use crate::cycles::{Expansion, illegal};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, Turning, missing_word};
use plan::{Feed, Severity, Speed, Thread};
use units::{Millimetres, Radians};

/// What stays set from one G76 to the next: Fanuc parameters 5130 and 5140 to 5143.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ThreadSettings {
    finishing: u32,
    /// Leads over which the tool leaves the thread, G92 too.
    pub chamfer: f64,
    /// Angle of the tip, degrees.
    angle: u32,
    least: f64,
    allowance: f64,
}

impl Default for ThreadSettings {
    fn default() -> Self {
        ThreadSettings {
            finishing: 1,
            chamfer: 0.0,
            angle: 0,
            least: 0.0,
            allowance: 0.0,
        }
    }
}

/// Passes that a thread may have: a least depth far too small.
const MOST_PASSES: f64 = 10_000.0;

/// One pass: rapid in, the thread, out, and home. Places are X (a radius) and Z.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass {
    pub begin: [f64; 2],
    pub end: [f64; 2],
    pub home: [f64; 2],
    pub lead: f64,
    pub angle: Radians,
    /// Length along Z over which the tool is drawn out at 45 degrees before the end.
    pub chamfer: f64,
}

impl Expansion for Pass {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        let [x0, z0] = self.begin;
        let [x1, z1] = self.end;
        i.go([(2, z0), (2, z0)], Speed::Rapid);
        i.go([(0, x0), (2, z0)], Speed::Rapid);
        let way_z = (z1 - z0).signum();
        let out = (self.home[0] - x1).signum();
        // The tool is drawn out no farther than it came from, and not before the thread began.
        let chamfer = self.chamfer.min((self.home[0] - x1).abs()).min((z1 - z0).abs());
        if chamfer > 0.0 {
            let share = 1.0 - chamfer / (z1 - z0).abs();
            let (x, z) = (x0 + (x1 - x0) * share, z1 - way_z * chamfer);
            i.thread_line([x, z], self.lead, Some(self.angle));
            i.thread_line([x + out * chamfer, z1], self.lead, None);
        } else {
            i.thread_line([x1, z1], self.lead, Some(self.angle));
        }
        i.go([(0, self.home[0]); 2], Speed::Rapid);
        i.go([(2, self.home[1]); 2], Speed::Rapid);
        false
    }
}

/// The passes of G76.
struct Thread76 {
    /// The last pass: full depth, without the way along the flank.
    full: Pass,
    /// From the thread's ground outwards along X, 1 or -1.
    out: f64,
    depth: f64,
    first: f64,
    least: f64,
    allowance: f64,
    finishing: u32,
    tangent: f64,
    /// Passes done, and the depth reached.
    done: u32,
    reached: f64,
}

impl Expansion for Thread76 {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        let rough = self.depth - self.allowance;
        if self.reached < rough {
            self.done += 1;
            let by_root = self.first * libm::sqrt(f64::from(self.done));
            self.reached = by_root.max(self.reached + self.least).min(rough);
        } else if self.finishing > 0 {
            self.finishing -= 1;
            self.reached = self.depth;
        } else {
            return false;
        }
        let mut pass = self.full;
        let above = self.out * (self.depth - self.reached);
        let along = (pass.end[1] - pass.begin[1]).signum() * self.reached * self.tangent;
        pass.begin = [pass.begin[0] + above, pass.begin[1] + along];
        pass.end[0] += above;
        pass.next(i);
        true
    }
}

impl Interpreter {
    /// The lead that F says, mm.
    pub(crate) fn lead(&mut self, at: usize, site: Site<'_>) -> Outcome<f64> {
        self.check_thread_spindle(at, site)?;
        match self.last_f {
            Some(lead) if lead > 0.0 => Ok(lead),
            _ => Err(Fault::new(at, 11, "no-feed", "a thread without a lead", "write F, the lead")),
        }
    }

    /// A thread needs a spindle that turns, and keeps its speed.
    fn check_thread_spindle(&mut self, at: usize, site: Site<'_>) -> Outcome<()> {
        if self.turning == Turning::Stopped {
            return Err(Fault::new(
                at,
                0,
                "spindle-stopped",
                "a thread while the spindle stands: the axes would never move",
                "start the spindle with G97 S and M3 or M4 first",
            ));
        }
        if self.surface.is_some() {
            self.note(Severity::Warning, "thread-surface-speed", site, at, || {
                (
                    "a thread with constant surface speed: the spindle changes its speed from pass to pass".to_owned(),
                    "write G97 S before the thread".to_owned(),
                )
            });
        }
        Ok(())
    }

    /// How far a thread goes along its path in a revolution, for a move that goes `d` along the axes.
    fn advance(&mut self, d: [f64; 3], at: usize, block: &mut Block, site: Site<'_>) -> Outcome<Millimetres> {
        if self.profile.lead_in_k {
            self.check_thread_spindle(at, site)?;
            let k = block
                .take(b'K')
                .ok_or_else(|| missing_word(at, "a thread", "K, the way in a revolution"))?;
            let advance = self.length(b'K', k, site);
            return match advance > 0.0 {
                true => Ok(Millimetres(advance)),
                false => Err(Fault::new(k.at, 0, "no-feed", "a thread without a lead", "write a K above 0")),
            };
        }
        let lead = self.lead(at, site)?;
        let longer = d.iter().copied().fold(0.0, f64::max);
        let length = libm::sqrt(d.iter().map(|v| v * v).sum());
        Ok(Millimetres(if longer > 0.0 { lead * length / longer } else { lead }))
    }

    /// Q of a thread: thousandths of a degree from the spindle's index mark.
    pub(crate) fn start_angle(&self, block: &mut Block) -> Radians {
        let degrees = block
            .take(b'Q')
            .map_or(0.0, |q| if q.has_point { q.value } else { q.value / 1000.0 });
        Radians(libm::fmod(degrees, 360.0).to_radians())
    }

    /// A thread to X (a radius) and Z.
    pub(crate) fn thread_line(&mut self, to: [f64; 2], lead: f64, start: Option<Radians>) {
        let (dx, dz) = ((to[0] - self.tip[0]).abs(), (to[1] - self.tip[2]).abs());
        let longer = dx.max(dz);
        if longer <= 0.0 {
            return;
        }
        // F counts along the axis that goes farther; at 45 degrees along Z.
        let advance = Millimetres(lead * libm::sqrt(dx * dx + dz * dz) / longer);
        self.go([(0, to[0]), (2, to[1])], Speed::Feed(Feed::Thread(Thread { advance, start })));
    }

    /// G32, G33: one thread move; a second one right behind it follows on.
    pub(crate) fn thread_to(&mut self, to: [f64; 3], at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let d: [f64; 3] = std::array::from_fn(|k| (to[k] - self.tip[k]).abs());
        let advance = self.advance(d, at, block, site)?;
        let angle = match self.profile.lead_in_k {
            true => Radians(0.0),
            false => self.start_angle(block),
        };
        let start = (!self.threading).then_some(angle);
        self.note_no_compensation("threading", at, site);
        self.interrupt_compensation();
        if d == [0.0; 3] {
            return Ok(());
        }
        self.compensation.suspended = true;
        self.line(to, Speed::Feed(Feed::Thread(Thread { advance, start })));
        self.compensation.suspended = false;
        Ok(())
    }

    /// G33.1: in to `to`, the spindle turns round, out to where it began, and turns as before.
    pub(crate) fn tap_to(&mut self, to: [f64; 3], at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let from = self.tip;
        let d: [f64; 3] = std::array::from_fn(|k| (to[k] - from[k]).abs());
        let advance = self.advance(d, at, block, site)?;
        if d == [0.0; 3] {
            return Err(Fault::new(
                at,
                0,
                "word-missing",
                "G33.1 without a way to go",
                "write the bottom of the hole",
            ));
        }
        self.note_no_compensation("tapping", at, site);
        self.interrupt_compensation();
        let before = self.turning;
        let back = match before {
            Turning::Clockwise => Turning::Counterclockwise,
            _ => Turning::Clockwise,
        };
        let [down, up] = [Some(Radians(0.0)), None].map(|start| Speed::Feed(Feed::Thread(Thread { advance, start })));
        self.compensation.suspended = true;
        self.line(to, down);
        self.turn(back);
        self.line(from, up);
        self.turn(before);
        self.compensation.suspended = false;
        Ok(())
    }

    /// G76.
    pub(crate) fn thread_cycle(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let one_block = block.has_any(b"KD");
        if !one_block && !block.has_any(b"XUZW") {
            return self.thread_settings(at, block, site);
        }
        let mut settings = self.turning_cycles.thread;
        let start = self.tip;
        let taper_letter = if one_block { b'I' } else { b'R' };
        let to = self.target(block, site)?.unwrap_or(start);
        let taper = match block.take(taper_letter) {
            Some(w) => self.length(taper_letter, w, site),
            None => 0.0,
        };
        let (depth_letter, first_letter) = if one_block { (b'K', b'D') } else { (b'P', b'Q') };
        let mut depth_of = |letter: u8| -> Outcome<f64> {
            let word = block.take(letter).ok_or_else(|| {
                illegal(
                    at,
                    format!("G76 without {}", char::from(letter)),
                    "add the depth of the thread",
                )
            })?;
            let value = match letter {
                b'K' => self.length(letter, word, site),
                _ => self.increments(word),
            };
            if value <= 0.0 {
                let what = if letter == depth_letter {
                    "the depth of the thread"
                } else {
                    "the depth of the first pass"
                };
                return Err(illegal(
                    word.at,
                    format!("{what} is {value} mm: it must be above 0"),
                    "correct it; P and Q without a point count least increments",
                ));
            }
            Ok(value)
        };
        let (depth, first) = (depth_of(depth_letter)?, depth_of(first_letter)?);
        if one_block {
            if let Some(a) = block.take(b'A') {
                settings.angle = tip_angle(Self::whole(a, 'A', 120)?, a.at)?;
            }
            if let Some(p) = block.take(b'P')
                && Self::whole(p, 'P', 4)? > 1
            {
                return Err(Fault::not_there_yet(p.at, "G76 with another way of infeed than P1"));
            }
        }
        if settings.least > depth || settings.allowance >= depth {
            return Err(illegal(
                at,
                format!(
                    "the least depth of a pass ({:.3} mm) or the finishing allowance ({:.3} mm) is more than the thread is deep ({depth:.3} mm)",
                    settings.least, settings.allowance
                ),
                "correct the first block of G76",
            ));
        }
        // With only the square root, pass n takes about first / (2 sqrt(n)).
        if (depth / first) * (depth / first) > MOST_PASSES && depth / settings.least.max(1e-12) > MOST_PASSES {
            return Err(illegal(
                at,
                format!("passes of {first} mm are too many for a depth of {depth} mm"),
                "check Q and the least depth of a pass",
            ));
        }
        if start[0] == to[0] || start[2] == to[2] {
            return Err(illegal(
                at,
                "a thread without a length or without a side to start from",
                "check X, Z and the place before it",
            ));
        }
        let lead = self.lead(at, site)?;
        let angle = match one_block {
            true => self.start_angle(block),
            false => Radians(0.0), // Q is the depth of the first pass
        };
        self.note_no_compensation("G76", at, site);
        self.prepare_move(at, site)?;
        let out = (start[0] - to[0]).signum();
        self.begin_expansion(Thread76 {
            full: Pass {
                begin: [to[0] + taper, start[2]],
                end: [to[0], to[2]],
                home: [start[0], start[2]],
                lead,
                angle,
                chamfer: settings.chamfer * lead,
            },
            out,
            depth,
            first,
            least: settings.least,
            allowance: settings.allowance,
            finishing: settings.finishing,
            tangent: libm::tan(f64::from(settings.angle).to_radians() / 2.0),
            done: 0,
            reached: 0.0,
        });
        Ok(())
    }

    /// `G76 P mm rr aa Q least R allowance`.
    fn thread_settings(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mut settings = self.turning_cycles.thread;
        if !block.has_any(b"PQR") {
            return Err(missing_word(at, "G76", "P, Q and R, or X, Z, P and Q"));
        }
        if let Some(p) = block.take(b'P') {
            let value = Self::whole(p, 'P', 999_999)?;
            (settings.finishing, settings.chamfer) = (value / 10_000, f64::from(value / 100 % 100) / 10.0);
            settings.angle = tip_angle(value % 100, p.at)?;
            if settings.finishing == 0 {
                return Err(illegal(
                    p.at,
                    "P of G76 asks for no finishing pass",
                    "write six digits: passes, chamfer in tenths of the lead, angle: P021060",
                ));
            }
        }
        if let Some(q) = block.take(b'Q') {
            settings.least = self.increments(q).max(0.0);
        }
        if let Some(r) = block.take(b'R') {
            settings.allowance = self.length(b'R', r, site).max(0.0);
        }
        self.turning_cycles.thread = settings;
        Ok(())
    }
}

fn tip_angle(angle: u32, at: usize) -> Outcome<u32> {
    match angle {
        80 | 60 | 55 | 30 | 29 | 0 => Ok(angle),
        _ => Err(illegal(
            at,
            format!("{angle} is no angle of a thread tool that G76 knows"),
            "write 80, 60, 55, 30, 29 or 0",
        )),
    }
}

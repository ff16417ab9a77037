//! Drilling, tapping and boring: G73, G74, G76, G80 to G89 of mills in all planes, G83 to G85 (face) and G87 to G89 (side) of lathes.
//!
//! On a lathe R is always counted from the initial level, and the tool always goes back there.

use crate::block::Block;
use crate::cycles::{Expansion, faster};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, MOST_ITEMS, Turning, g_name, missing_word};
use crate::profile::{Drilling, FeedMode};
use plan::{Feed, Speed, SpindleState, StepKind, StopKind, Thread};
use units::{Millimetres, Radians, Seconds};

/// A drilling cycle in force, with the words that hold from hole to hole.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    kind: Drilling,
    /// Its G number.
    pub code: u16,
    /// The axis it goes along.
    axis: usize,
    /// Level of the tip along the drilling axis when the cycle began.
    initial: f64,
    /// R, mm, and whether it counts from the initial level.
    r: Option<(f64, bool)>,
    /// Depth, mm, and whether it counts from R.
    depth: Option<(f64, bool)>,
    /// Q: a peck, or by how much a boring tool is moved off the wall.
    peck: f64,
    dwell: f64,
}

/// The holes of one block.
struct Holes {
    cycle: Cycle,
    place: [f64; 3],
    step: [f64; 3],
    left: u32,
    r: f64,
    bottom: f64,
    level: f64,
    feed: Speed,
    /// Down and up of a rigid tap.
    thread: Option<[Speed; 2]>,
}

impl Interpreter {
    /// Takes up a cycle; words of an earlier one of the same run hold on.
    pub(crate) fn begin_cycle(&mut self, kind: Drilling, code: u16, side: bool) {
        let axis = match self.profile.turning {
            true if side => 0,
            true => 2,
            false => self.plane.axes()[2],
        };
        let initial = self.tip[axis];
        match &mut self.cycle {
            Some(cycle) if cycle.axis == axis => (cycle.kind, cycle.code) = (kind, code),
            cycle => {
                *cycle = Some(Cycle {
                    kind,
                    code,
                    axis,
                    initial,
                    r: None,
                    depth: None,
                    peck: 0.0,
                    dwell: 0.0,
                });
            }
        }
    }

    /// A block with a drilling cycle in force: a hole wherever it names a place, a depth or R.
    pub(crate) fn drill(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(mut cycle) = self.cycle.clone() else { return Ok(()) };
        let at = self.axis_at(block);
        let c = cycle.axis;
        let drills = block.has_any(b"XYZUWR");
        // R counts from the initial level and the depth from R when they are incremental.
        if let Some(w) = block.take(b'R') {
            let factor = if self.profile.turning { 1.0 } else { self.profile.factor(c) };
            cycle.r = Some((self.length(b'R', w, site) * factor, self.incremental || self.profile.turning));
        }
        for word in self.profile.axes.iter().filter(|w| w.axis == c) {
            if let Some(w) = block.take(word.letter) {
                let adds = word.incremental.unwrap_or(self.incremental);
                cycle.depth = Some((self.length(word.letter, w, site) * word.factor, adds));
            }
        }
        if let Some(q) = block.take(b'Q') {
            cycle.peck = match self.profile.turning {
                true => self.increments(q),
                false => self.length(b'Q', q, site),
            };
            if cycle.peck < 0.0 {
                return Err(Fault::new(q.at, 0, "peck-negative", "a peck cannot be negative", "correct Q"));
            }
        }
        if let Some(p) = block.take(b'P') {
            cycle.dwell = (p.value * self.dwell_factor(p)).max(0.0);
        }
        let count = match block.take(b'K').or_else(|| block.take(b'L')) {
            Some(k) => Self::whole(k, 'K', 9999)?,
            None => 1,
        };
        let result = if drills {
            self.holes(&cycle, count, at, block, site)
        } else {
            Ok(())
        };
        self.cycle = Some(cycle);
        result
    }

    fn holes(&mut self, cycle: &Cycle, count: u32, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let c = cycle.axis;
        let name = g_name(cycle.code * 10);
        let r_given = cycle.r.or(self.profile.turning.then_some((0.0, true)));
        let (Some((r, r_adds)), Some((depth, depth_adds))) = (r_given, cycle.depth) else {
            return Err(missing_word(at, &name, "R and a depth"));
        };
        let r = if r_adds { cycle.initial + r } else { r };
        let bottom = if depth_adds { r + depth } else { depth };
        let upwards = cycle.kind == Drilling::BackBore;
        if (bottom > r) != upwards && bottom != r && !(self.profile.turning && cycle.axis == 2) {
            let (where_, wrong) = if upwards {
                ("below", "goes up")
            } else {
                ("above", "goes down")
            };
            return Err(Fault::new(
                at,
                0,
                "cycle-depth",
                format!("the bottom of the hole ({bottom:.4} mm) lies {where_} R ({r:.4} mm), and {name} {wrong} from R"),
                "correct R or the depth",
            ));
        }
        let needs_q = match cycle.kind {
            Drilling::ChipBreak | Drilling::FineBore | Drilling::BackBore => true,
            Drilling::Peck => !self.profile.turning, // a lathe's G83 without Q goes down at once
            _ => false,
        };
        if needs_q && cycle.peck <= 0.0 {
            let what = match cycle.kind {
                Drilling::FineBore | Drilling::BackBore => "add Q, the way off the wall",
                _ => "add Q, the depth of a peck",
            };
            return Err(Fault::new(at, 45, "word-missing", format!("{name} without Q"), what));
        }
        if cycle.peck > 0.0
            && matches!(
                cycle.kind,
                Drilling::Peck | Drilling::ChipBreak | Drilling::Tap | Drilling::LeftTap
            )
        {
            let deep = (r - bottom).abs();
            if deep / cycle.peck * 3.0 > MOST_ITEMS as f64 || bottom + cycle.peck == bottom || r - cycle.peck == r {
                return Err(Fault::new(
                    at,
                    0,
                    "cycle-too-long",
                    format!("pecks of {} mm are too many for a hole of {deep:.3} mm", cycle.peck),
                    "check Q",
                ));
            }
        }
        let taps = matches!(cycle.kind, Drilling::Tap | Drilling::LeftTap);
        let feed = self.drilling_feed(taps, at)?;
        let thread = match taps && self.rigid_tapping {
            true => Some(self.tapping(feed)),
            false => None,
        };
        self.prepare_move(at, site)?;
        self.interrupt_compensation();
        let level = if self.return_to_r && !self.profile.turning && !upwards {
            r
        } else if self.profile.turning || upwards {
            cycle.initial
        } else {
            cycle.initial.max(r)
        };
        if self.shaping.is_scaled() && self.shaping.way([1.0; 3])[c] != 1.0 {
            return Err(Fault::not_there_yet(at, "a drilling cycle with a scale along its own axis"));
        }
        if self.shaping.is_polar() && self.incremental && count > 1 {
            return Err(Fault::not_there_yet(
                at,
                "K with incremental polar coordinates, holes on a circle in one block,",
            ));
        }
        let place = self.places(c, block, site)?;
        let step = std::array::from_fn(|k| if self.incremental { place[k] - self.tip[k] } else { 0.0 });
        self.begin_expansion(Holes {
            cycle: cycle.clone(),
            place,
            step,
            left: count,
            r,
            bottom,
            level,
            feed,
            thread,
        });
        Ok(())
    }

    /// Where the block's words for the plane point; the drilling axis stays.
    fn places(&mut self, c: usize, block: &mut Block, site: Site<'_>) -> Outcome<[f64; 3]> {
        let said = self.said(block, site, Some(c))?;
        if said == [None; 3] {
            return Ok(self.tip);
        }
        let mut to = self.place_of(said);
        to[c] = self.tip[c];
        Ok(to)
    }

    fn drilling_feed(&mut self, taps: bool, at: usize) -> Outcome<Speed> {
        if taps && self.feed_mode != FeedMode::InverseTime && self.spindle_is_slow() {
            return Err(Fault::new(
                at,
                0,
                "no-spindle-speed",
                "tapping without a spindle speed",
                "write S, with M29 or M3, before the cycle",
            ));
        }
        self.cutting(at)
    }

    /// True when the tap would not turn: a rigid one turns by itself at S.
    fn spindle_is_slow(&self) -> bool {
        match self.spindle {
            SpindleState::Stopped | SpindleState::Oriented => !(self.rigid_tapping && self.revolutions > 0.0),
            other => other.revolutions(Millimetres(self.tip[0])).0 <= 0.0,
        }
    }

    /// Speeds of a rigid tap, tied to the spindle: down from its index mark, up without waiting for it.
    fn tapping(&self, feed: Speed) -> [Speed; 2] {
        let advance = match feed {
            Speed::Feed(Feed::PerTime(v)) if self.revolutions > 0.0 => Millimetres(v.0 * 60.0 / self.revolutions),
            Speed::Feed(Feed::PerRevolution(f)) => f,
            other => return [other; 2], // inverse time says how long, whatever the spindle does
        };
        [Some(Radians(0.0)), None].map(|start| Speed::Feed(Feed::Thread(Thread { advance, start })))
    }

    /// Moves one axis.
    pub(crate) fn along(&mut self, axis: usize, to: f64, speed: Speed) {
        self.go([(axis, to); 2], speed);
    }

    pub(crate) fn turn(&mut self, state: Turning) {
        self.turning = state;
        self.say_spindle();
    }

    /// Stops the spindle at its fixed angle.
    pub(crate) fn orient(&mut self) {
        self.turning = Turning::Stopped;
        self.spindle = SpindleState::Oriented;
        self.emit(StepKind::Spindle(SpindleState::Oriented));
    }
}

impl Expansion for Holes {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        if self.left == 0 {
            return false;
        }
        self.left -= 1;
        let c = self.cycle.axis;
        if i.profile.raises_before_hole && i.tip[c] < self.r {
            i.along(c, self.r, Speed::Rapid);
        }
        let mut place = self.place;
        place[c] = i.tip[c];
        i.line(place, Speed::Rapid);
        if self.cycle.kind == Drilling::BackBore {
            self.back_bore(i);
        } else {
            i.along(c, self.r, Speed::Rapid);
            self.hole(i);
        }
        self.place = std::array::from_fn(|k| self.place[k] + self.step[k]);
        true
    }
}

impl Holes {
    fn dwell(&self, i: &mut Interpreter) {
        if self.cycle.dwell > 0.0 {
            i.emit(StepKind::Dwell(Seconds(self.cycle.dwell)));
        }
    }

    /// One hole, from R down and back.
    fn hole(&self, i: &mut Interpreter) {
        let c = self.cycle.axis;
        let before = i.turning;
        let [down, up] = self.thread.unwrap_or([self.feed; 2]);
        match self.cycle.kind {
            Drilling::Tap => i.turn(Turning::Clockwise),
            Drilling::LeftTap => i.turn(Turning::Counterclockwise),
            _ => {}
        }
        match self.cycle.kind {
            Drilling::Peck | Drilling::ChipBreak if self.cycle.peck > 0.0 => self.pecks(i),
            Drilling::Tap | Drilling::LeftTap if self.cycle.peck > 0.0 => self.tap_in_pecks(i, [down, up]),
            _ => i.along(c, self.bottom, down),
        }
        let turning = i.profile.turning;
        match self.cycle.kind {
            Drilling::Plain | Drilling::ChipBreak => {}
            Drilling::Peck if !turning => {}
            Drilling::Peck | Drilling::Dwell => self.dwell(i),
            // A lathe reams out at twice its feed.
            Drilling::Ream if turning => {
                self.dwell(i);
                i.along(c, self.r, faster(self.feed, 2.0));
            }
            Drilling::Ream => i.along(c, self.r, self.feed),
            Drilling::ReamDwell => {
                self.dwell(i);
                i.along(c, self.r, if turning { faster(self.feed, 2.0) } else { self.feed });
            }
            Drilling::Bore => i.turn(Turning::Stopped),
            Drilling::Tap | Drilling::LeftTap => {
                self.dwell(i);
                let back = match i.turning {
                    Turning::Clockwise => Turning::Counterclockwise,
                    _ => Turning::Clockwise,
                };
                i.turn(back);
                i.along(c, self.r, up);
                i.turn(before);
            }
            Drilling::FineBore => {
                self.dwell(i);
                i.orient();
                let off = self.off_the_wall(i);
                i.line(off, Speed::Rapid);
            }
            Drilling::ManualBore => {
                self.dwell(i);
                i.turn(Turning::Stopped);
                i.emit(StepKind::Message("take the tool out of the hole by hand".to_owned()));
                i.emit(StepKind::Stop(StopKind::Program));
            }
            Drilling::BackBore => {}
        }
        i.along(c, self.level, Speed::Rapid);
        if self.cycle.kind == Drilling::FineBore {
            self.back_in_place(i);
        }
        if matches!(self.cycle.kind, Drilling::Bore | Drilling::FineBore | Drilling::ManualBore) {
            i.turn(before);
        }
    }

    /// G87: down beside the hole with the spindle oriented, into place, and up at feed.
    fn back_bore(&self, i: &mut Interpreter) {
        let c = self.cycle.axis;
        let before = i.turning;
        i.orient();
        let off = self.off_the_wall(i);
        i.line(off, Speed::Rapid);
        i.along(c, self.r, Speed::Rapid);
        self.back_in_place(i);
        i.turn(before);
        i.along(c, self.bottom, self.feed);
        self.dwell(i);
        i.orient();
        let off = self.off_the_wall(i);
        i.line(off, Speed::Rapid);
        i.along(c, self.level, Speed::Rapid);
        self.back_in_place(i);
        i.turn(before);
    }

    /// Q along the first axis of the plane (Fanuc parameter 5148 chooses the direction; plus is its usual setting).
    fn off_the_wall(&self, i: &Interpreter) -> [f64; 3] {
        let a = i.plane.axes()[0];
        let mut place = i.tip;
        place[a] += self.cycle.peck;
        place
    }

    fn back_in_place(&self, i: &mut Interpreter) {
        let a = i.plane.axes()[0];
        i.along(a, self.place[a], Speed::Rapid);
    }

    /// G84 and G74 with Q: the spindle turns back after each peck, and out to R (parameter 5200.5 PCP=1) or a little (PCP=0).
    fn tap_in_pecks(&self, i: &mut Interpreter, [down, up]: [Speed; 2]) {
        let c = self.cycle.axis;
        let way = if self.bottom < self.r { -1.0 } else { 1.0 };
        let whole = i.settings.all.bit(5200, 5).unwrap_or(false);
        let clearance = i.profile.peck_clearance.min(self.cycle.peck);
        let forth = i.turning;
        let back = match forth {
            Turning::Clockwise => Turning::Counterclockwise,
            _ => Turning::Clockwise,
        };
        let mut reached = self.r;
        let mut speed = down;
        loop {
            let next = reached + way * self.cycle.peck;
            let last = (next - self.bottom) * way >= 0.0;
            reached = if last { self.bottom } else { next };
            i.along(c, reached, speed);
            if last {
                return;
            }
            i.turn(back);
            i.along(c, if whole { self.r } else { reached - way * clearance }, up);
            i.turn(forth);
            // From R it begins at the index mark again; inside the thread it goes on in it.
            speed = if whole { down } else { up };
        }
    }

    /// Down in pecks: out to R after each (G83), or back a little (G73).
    fn pecks(&self, i: &mut Interpreter) {
        let c = self.cycle.axis;
        let way = if self.bottom < self.r { -1.0 } else { 1.0 };
        let clearance = i.profile.peck_clearance.min(self.cycle.peck);
        let mut reached = self.r;
        loop {
            let next = reached + way * self.cycle.peck;
            let last = (next - self.bottom) * way >= 0.0;
            reached = if last { self.bottom } else { next };
            i.along(c, reached, self.feed);
            if last {
                return;
            }
            if self.cycle.kind == Drilling::Peck {
                i.along(c, self.r, Speed::Rapid);
            }
            i.along(c, reached - way * clearance, Speed::Rapid);
        }
    }
}

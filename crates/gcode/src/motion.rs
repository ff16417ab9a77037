//! Moves: straight ones, arcs, drilling cycles, and moves of the machine's axes.

use crate::arc::{ArcFault, Circle, Request, solve};
use crate::block::Block;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, MOST_ITEMS, Turning, g_name, missing_word};
use crate::profile::{Drilling, FeedMode, Motion};
use plan::{MachineMove, Move, Path, PathMode, Severity, Speed, SpindleState, StepKind};
use units::{Millimetres, Point, Seconds, Setup};

/// A drilling cycle in force, with the words that hold from hole to hole.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    kind: Drilling,
    /// Its G number.
    pub code: u16,
    /// Level of the tip along the drilling axis when the cycle began.
    initial: f64,
    /// R, mm, and whether it counts from the initial level.
    r: Option<(f64, bool)>,
    /// Depth, mm, and whether it counts from R.
    depth: Option<(f64, bool)>,
    peck: f64,
    dwell: f64,
}

/// How a hole is left.
#[derive(Clone, Copy, PartialEq)]
enum Retract {
    Rapid,
    Feed,
    Stopped,
    Reversed,
}

impl Interpreter {
    // ---- straight moves and arcs

    /// The places that the block's axis words name; `None` when there are none.
    fn target(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<Option<[f64; 3]>> {
        let mut to = self.tip;
        let mut named = [false; 3];
        let mut any = false;
        for word in self.profile.axes {
            let Some(w) = block.take(word.letter) else { continue };
            if named[word.axis] {
                let letter = char::from(word.letter);
                return Err(Fault::new(
                    w.at,
                    0,
                    "axis-twice",
                    format!("{letter} names an axis that another word of this block names"),
                    "keep one of them",
                ));
            }
            let value = self.length(word.letter, w, site) * word.factor;
            let adds = word.incremental.unwrap_or(self.incremental);
            to[word.axis] = if adds { self.tip[word.axis] + value } else { value };
            (named[word.axis], any) = (true, true);
            if !adds {
                self.carried[word.axis] = 0.0;
            }
        }
        self.moved |= any;
        self.moved_since_stop |= any;
        Ok(any.then_some(to))
    }

    /// The block's own move, by the motion code in force or the drilling cycle.
    pub(crate) fn move_tip(&mut self, block: &mut Block, exact_stop: bool, site: Site<'_>) -> Outcome<()> {
        if self.cycle.is_some() {
            return self.drill(block, site);
        }
        let at = self.axis_at(block);
        let arc = matches!(self.motion, Motion::Clockwise | Motion::Counterclockwise);
        let circle_words = arc && block.has_any(b"IJKR");
        let to = self.target(block, site)?;
        if to.is_none() && !circle_words {
            return Ok(());
        }
        let to = to.unwrap_or(self.tip);
        if !self.motion_said {
            self.motion_said = true;
            self.note(Severity::Remark, "no-motion-code", site, at, || {
                (
                    "a move before any G0 or G1: rapid is assumed".to_owned(),
                    "write G0 or G1".to_owned(),
                )
            });
        }
        self.prepare_move(at, site)?;
        let traced = self.trace.path.len();
        if exact_stop {
            self.emit(StepKind::PathMode(PathMode::ExactStop));
        }
        match self.motion {
            Motion::Rapid => self.line(to, Speed::Rapid),
            Motion::Straight => {
                let feed = Speed::Feed(self.feed(at)?);
                self.line(to, feed);
            }
            Motion::Clockwise => self.arc(to, false, at, block, site)?,
            Motion::Counterclockwise => self.arc(to, true, at, block, site)?,
        }
        if exact_stop {
            self.emit(StepKind::PathMode(self.path_mode));
        }
        if self.options.trace && self.trace.path.len() == traced {
            self.trace_move(self.motion as u8); // the tip was there already
        }
        Ok(())
    }

    /// What has to be so before the tip moves in the frame.
    fn prepare_move(&mut self, at: usize, site: Site<'_>) -> Outcome<()> {
        if !self.units_said {
            self.units_said = true;
            self.note(Severity::Remark, "no-units", site, at, || {
                (
                    "neither G20 nor G21 before the first move: millimetres are assumed".to_owned(),
                    "write G21 or G20".to_owned(),
                )
            });
        }
        self.check_frame(at, site)?;
        self.ensure_workingstep();
        self.forget_comments();
        Ok(())
    }

    /// Column of the block's first axis word, or of the block.
    fn axis_at(&self, block: &Block) -> usize {
        self.profile
            .axes
            .iter()
            .filter_map(|w| block.look(w.letter))
            .map(|w| w.at)
            .min()
            .unwrap_or(0)
    }

    /// A straight move of the tip; none when it is there already.
    fn line(&mut self, to: [f64; 3], speed: Speed) {
        let from = self.tip;
        if from == to {
            return;
        }
        self.follow_path(
            Path::Line {
                from: Point::from_xyz(from),
                to: Point::from_xyz(to),
            },
            speed,
            to,
        );
    }

    fn follow_path(&mut self, path: Path<Setup>, speed: Speed, to: [f64; 3]) {
        self.tip = to;
        if self.options.trace {
            self.nominal += nominal_seconds(&path, speed);
            self.trace_move(match (&path, speed) {
                (Path::Arc(_), _) => self.motion as u8,
                (_, Speed::Rapid) => 0,
                _ => 1,
            });
        }
        self.emit(StepKind::Move(Move {
            path,
            speed,
            profile: None,
            derived: false,
        }));
    }

    /// Takes down where a move ends, as the program would write it.
    fn trace_move(&mut self, code: u8) {
        let mut end = vec![f64::from(code)];
        end.extend(
            self.profile
                .variable_axes
                .iter()
                .map(|axis| self.in_program(*axis, self.programmed(*axis))),
        );
        self.trace.path.push(end);
    }

    fn arc(&mut self, to: [f64; 3], counterclockwise: bool, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let feed = Speed::Feed(self.feed(at)?);
        let [a, b, _] = self.plane.axes();
        let letters = [b'I', b'J', b'K'];
        let mut centre = [self.tip[a], self.tip[b]];
        let mut has_centre = false;
        for (index, axis) in [a, b].into_iter().enumerate() {
            if let Some(w) = block.take(letters[axis]) {
                let value = self.length(letters[axis], w, site);
                centre[index] = if self.absolute_centres { value } else { centre[index] + value };
                has_centre = true;
            }
        }
        let circle = match block.take(b'R') {
            Some(r) => {
                if has_centre {
                    self.note(Severity::Warning, "arc-two-forms", site, r.at, || {
                        (
                            "both a radius and a centre: the radius counts".to_owned(),
                            "keep one of them".to_owned(),
                        )
                    });
                }
                Circle::Radius(self.length(b'R', r, site))
            }
            None if has_centre => Circle::Centre(centre),
            None => {
                return Err(Fault::new(
                    at,
                    22,
                    "arc-without-circle",
                    "an arc without centre and without radius",
                    format!(
                        "write {} and {}, from the start to the centre, or R",
                        char::from(letters[a]),
                        char::from(letters[b])
                    ),
                ));
            }
        };
        let turns = match self.profile.arc_turns.then(|| block.take(b'P')).flatten() {
            Some(p) => Self::whole(p, 'P', 100_000)?.max(1),
            None => 1,
        };
        let solved = solve(Request {
            from: self.tip,
            to,
            plane: self.plane,
            counterclockwise,
            circle,
            turns,
            tolerance: self.options.arc_tolerance.0,
        });
        let solved = match solved {
            Ok(solved) => solved,
            Err(ArcFault::NoWay) => {
                self.note(Severity::Warning, "arc-zero", site, at, || {
                    (
                        "an arc given by R that ends where it starts: the tool stays".to_owned(),
                        "give a full circle by its centre".to_owned(),
                    )
                });
                self.line(to, feed);
                return Ok(());
            }
            Err(fault) => return Err(self.arc_fault(fault, at)),
        };
        let rounding = 1.5 * self.profile.increment[usize::from(self.inches)] * self.unit();
        if solved.mismatch > rounding {
            let mismatch = solved.mismatch;
            self.note(Severity::Remark, "arc-radius", site, at, || {
                (
                    format!(
                        "the radii at start and end of this arc differ by {mismatch:.4} mm; the difference is spread over the arc"
                    ),
                    "have the program written with more decimals".to_owned(),
                )
            });
        }
        match solved.second {
            None => self.follow_path(solved.first, feed, to),
            Some(second) => {
                let joint = second.start().xyz;
                self.follow_path(solved.first, feed, joint);
                self.follow_path(second, feed, to);
            }
        }
        Ok(())
    }

    fn arc_fault(&self, fault: ArcFault, at: usize) -> Box<Fault> {
        let (unit, name) = (self.unit(), if self.inches { "inch" } else { "mm" });
        let shown = |mm: f64| format!("{:.4}", mm / unit);
        match fault {
            ArcFault::DoesNotClose { start, end, allowed } => Fault::new(
                at,
                20,
                "arc-radius",
                format!(
                    "this arc does not close: its radius is {} {name} at the start and {} {name} at the end, {} {name} apart and {} {name} allowed",
                    shown(start),
                    shown(end),
                    shown((start - end).abs()),
                    shown(allowed)
                ),
                "correct the end point or the centre; the centre counts from the start of the arc, and the plane must be the right one",
            ),
            ArcFault::TooFar { distance, radius } => Fault::new(
                at,
                20,
                "arc-radius",
                format!(
                    "this arc does not close: its end is {} {name} from its start, more than twice the radius of {} {name}",
                    shown(distance),
                    shown(radius.abs())
                ),
                "correct the end point or R",
            ),
            ArcFault::NoRadius => Fault::new(
                at,
                22,
                "arc-without-circle",
                "the centre of this arc is its start",
                "correct the words of the centre, or the plane (G17, G18, G19)",
            ),
            ArcFault::NoWay => Fault::new(
                at,
                22,
                "arc-zero",
                "an arc given by R that ends where it starts",
                "give it by its centre",
            ),
        }
    }

    // ---- the machine's axes

    /// G53.
    pub(crate) fn machine_move(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        if self.incremental {
            return Err(Fault::new(
                at,
                0,
                "machine-incremental",
                "G53 names places in the machine and has no meaning with G91",
                "write G90 before it",
            ));
        }
        let mut to = [None; 3];
        for word in self.profile.axes.iter().filter(|w| w.incremental != Some(true)) {
            if let Some(w) = block.take(word.letter) {
                to[word.axis] = Some(Millimetres(self.length(word.letter, w, site) * word.factor));
            }
        }
        if to == [None; 3] && self.macros.fanuc_ranges {
            // Alone it moves nothing and stops the read-ahead: the usual word for "wait until all moves are done".
            self.moved_since_stop = false;
            return Ok(());
        }
        if to == [None; 3] {
            return Err(missing_word(at, "G53", "an axis word"));
        }
        if self.profile.machine_moves_at_feed && self.motion == Motion::Straight {
            let feed = Speed::Feed(self.feed(at)?);
            self.prepare_move(at, site)?;
            let before = self.tip;
            for (axis, target) in to.into_iter().enumerate() {
                if let Some(target) = target {
                    self.place_axis(axis, target.0);
                }
            }
            let there = std::mem::replace(&mut self.tip, before);
            self.line(there, feed);
            return Ok(());
        }
        self.move_machine(to);
        Ok(())
    }

    fn move_machine(&mut self, to: [Option<Millimetres>; 3]) {
        for (axis, target) in to.into_iter().enumerate() {
            if let Some(target) = target {
                self.place_axis(axis, target.0);
                self.carried[axis] = 0.0;
            }
        }
        self.moved = true;
        self.moved_since_stop = false; // controls finish all moves before it
        if self.options.trace {
            self.trace_move(0);
        }
        self.emit(StepKind::MachineMove(MachineMove { to }));
    }

    /// G28, and G30 with its own place: through the place that the words name, then to `home`, each for the named axes.
    pub(crate) fn home(&mut self, at: usize, home: [f64; 3], block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let named: [bool; 3] = std::array::from_fn(|axis| {
            self.profile
                .axes
                .iter()
                .any(|w| w.axis == axis && block.look(w.letter).is_some())
        });
        let via = self.target(block, site)?;
        let axes = match via {
            Some(via) => {
                if via != self.tip {
                    self.prepare_move(at, site)?;
                    self.line(via, Speed::Rapid);
                }
                named
            }
            None => {
                self.note(Severity::Warning, "home-all-axes", site, at, || {
                    (
                        "no axis is named: all of them go home".to_owned(),
                        "name the axes: G91 G28 Z0".to_owned(),
                    )
                });
                let mut all = [false; 3];
                for axis in self.profile.variable_axes {
                    all[*axis] = true;
                }
                all
            }
        };
        self.move_machine(std::array::from_fn(|axis| axes[axis].then_some(Millimetres(home[axis]))));
        Ok(())
    }

    /// G30.
    pub(crate) fn second_reference(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        if let Some(p) = block.take(b'P')
            && Self::whole(p, 'P', 4)? != 2
        {
            return Err(Fault::not_there_yet(p.at, "a third or fourth reference position"));
        }
        let place = match self.options.second_reference {
            Some(place) => place.xyz,
            None => {
                self.missing(
                    "missing-reference",
                    site,
                    at,
                    "the second reference position",
                    "the machine's zero",
                )?;
                [0.0; 3]
            }
        };
        self.home(at, place, block, site)
    }

    // ---- drilling

    /// Takes up a cycle; words of an earlier one of the same run hold on.
    pub(crate) fn begin_cycle(&mut self, kind: Drilling, code: u16) {
        let initial = self.tip[self.plane.axes()[2]];
        match &mut self.cycle {
            Some(cycle) => (cycle.kind, cycle.code) = (kind, code),
            None => {
                self.cycle = Some(Cycle {
                    kind,
                    code,
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
    fn drill(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(mut cycle) = self.cycle.clone() else { return Ok(()) };
        let at = self.axis_at(block);
        let [_, _, c] = self.plane.axes();
        let depth_letter = [b'X', b'Y', b'Z'][c];
        let drills = block.has_any(b"XYZR");
        // R counts from the initial level and the depth from R when they are incremental.
        let words: [(u8, &mut Option<(f64, bool)>); 2] = [(b'R', &mut cycle.r), (depth_letter, &mut cycle.depth)];
        for (letter, place) in words {
            if let Some(w) = block.take(letter) {
                *place = Some((self.length(letter, w, site), self.incremental));
            }
        }
        if let Some(q) = block.take(b'Q') {
            cycle.peck = self.length(b'Q', q, site);
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
        let [_, _, c] = self.plane.axes();
        let name = g_name(cycle.code * 10);
        let (Some((r, r_adds)), Some((depth, depth_adds))) = (cycle.r, cycle.depth) else {
            return Err(missing_word(at, &name, "R and a depth"));
        };
        let r = if r_adds { cycle.initial + r } else { r };
        let bottom = if depth_adds { r + depth } else { depth };
        if bottom > r {
            return Err(Fault::new(
                at,
                0,
                "cycle-depth",
                format!("the bottom of the hole ({bottom:.4} mm) lies above R ({r:.4} mm)"),
                "correct R or the depth",
            ));
        }
        if matches!(cycle.kind, Drilling::Peck | Drilling::ChipBreak) && cycle.peck <= 0.0 {
            return Err(Fault::new(
                at,
                45,
                "word-missing",
                format!("{name} without Q"),
                "add Q, the depth of a peck",
            ));
        }
        self.prepare_move(at, site)?;
        let level = if self.return_to_r { r } else { cycle.initial.max(r) };
        let first_place = self.places(block, site)?;
        let step: [f64; 3] = std::array::from_fn(|k| if self.incremental { first_place[k] - self.tip[k] } else { 0.0 });
        let mut place = first_place;
        for hole in 0..count {
            if hole > 0 {
                place = std::array::from_fn(|k| place[k] + step[k]);
            }
            if self.profile.raises_before_hole && self.tip[c] < r {
                self.along(c, r, Speed::Rapid);
            }
            place[c] = self.tip[c];
            self.line(place, Speed::Rapid);
            self.along(c, r, Speed::Rapid);
            self.hole(cycle, r, bottom, level, at)?;
        }
        Ok(())
    }

    /// Where the block's words for the plane point; the drilling axis stays.
    fn places(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<[f64; 3]> {
        let c = self.plane.axes()[2];
        let mut to = self.tip;
        for word in self.profile.axes.iter().filter(|w| w.axis != c) {
            if let Some(w) = block.take(word.letter) {
                let value = self.length(word.letter, w, site) * word.factor;
                let adds = word.incremental.unwrap_or(self.incremental);
                to[word.axis] = if adds { self.tip[word.axis] + value } else { value };
            }
        }
        Ok(to)
    }

    /// Moves one axis.
    fn along(&mut self, axis: usize, to: f64, speed: Speed) {
        let mut place = self.tip;
        place[axis] = to;
        self.line(place, speed);
    }

    /// One hole, from R down and back.
    fn hole(&mut self, cycle: &Cycle, r: f64, bottom: f64, level: f64, at: usize) -> Outcome<()> {
        let c = self.plane.axes()[2];
        let (dwells, retract) = match cycle.kind {
            Drilling::Plain | Drilling::Peck | Drilling::ChipBreak => (false, Retract::Rapid),
            Drilling::Dwell => (true, Retract::Rapid),
            Drilling::Ream => (false, Retract::Feed),
            Drilling::ReamDwell => (true, Retract::Feed),
            Drilling::Bore => (false, Retract::Stopped),
            Drilling::Tap | Drilling::LeftTap => (true, Retract::Reversed),
        };
        let before = self.turning;
        if retract == Retract::Reversed {
            // Rigid tapping turns the spindle for the hole only; else it turns already.
            self.turning = if cycle.kind == Drilling::Tap {
                Turning::Clockwise
            } else {
                Turning::Counterclockwise
            };
            self.say_spindle();
        }
        let feed = self.drilling_feed(cycle, at)?;
        match cycle.kind {
            Drilling::Peck | Drilling::ChipBreak => self.pecks(cycle, r, bottom, feed, at)?,
            _ => self.along(c, bottom, feed),
        }
        if dwells && cycle.dwell > 0.0 {
            self.emit(StepKind::Dwell(Seconds(cycle.dwell)));
        }
        match retract {
            Retract::Rapid => {}
            Retract::Feed => self.along(c, r, feed),
            Retract::Stopped => {
                self.turning = Turning::Stopped;
                self.say_spindle();
            }
            Retract::Reversed => {
                self.turning = match self.turning {
                    Turning::Clockwise => Turning::Counterclockwise,
                    _ => Turning::Clockwise,
                };
                self.say_spindle();
                self.along(c, r, feed);
                self.turning = before;
                self.say_spindle();
            }
        }
        self.along(c, level, Speed::Rapid);
        if retract == Retract::Stopped {
            self.turning = before;
            self.say_spindle();
        }
        if self.out.len() > MOST_ITEMS {
            return Err(Fault::new(
                at,
                0,
                "cycle-too-long",
                format!("this block makes more than {MOST_ITEMS} moves"),
                "check Q and the number of holes",
            ));
        }
        Ok(())
    }

    fn drilling_feed(&mut self, cycle: &Cycle, at: usize) -> Outcome<Speed> {
        let taps = matches!(cycle.kind, Drilling::Tap | Drilling::LeftTap);
        if taps && self.feed_mode != FeedMode::InverseTime && self.spindle_is_slow() {
            return Err(Fault::new(
                at,
                0,
                "no-spindle-speed",
                "tapping without a spindle speed",
                "write S, with M29 or M3, before the cycle",
            ));
        }
        Ok(Speed::Feed(self.feed(at)?))
    }

    fn spindle_is_slow(&self) -> bool {
        match self.spindle {
            SpindleState::Stopped => true,
            other => other.revolutions(Millimetres(self.tip[0])).0 <= 0.0,
        }
    }

    /// Down in pecks: out to R after each (G83), or back a little (G73).
    fn pecks(&mut self, cycle: &Cycle, r: f64, bottom: f64, feed: Speed, at: usize) -> Outcome<()> {
        let c = self.plane.axes()[2];
        let clearance = self.profile.peck_clearance.min(cycle.peck);
        if (r - bottom) / cycle.peck * 3.0 > MOST_ITEMS as f64 {
            return Err(Fault::new(
                at,
                0,
                "cycle-too-long",
                format!("pecks of {} mm are too many for a hole of {:.3} mm", cycle.peck, r - bottom),
                "check Q",
            ));
        }
        let mut reached = r;
        loop {
            let next = (reached - cycle.peck).max(bottom);
            if next >= reached && reached > bottom {
                return Err(Fault::new(
                    at,
                    0,
                    "cycle-too-long",
                    "this peck is lost in the size of the numbers",
                    "check Q, R and the depth",
                ));
            }
            self.along(c, next, feed);
            reached = next;
            if reached <= bottom {
                return Ok(());
            }
            match cycle.kind {
                Drilling::Peck => {
                    self.along(c, r, Speed::Rapid);
                    self.along(c, reached + clearance, Speed::Rapid);
                }
                _ => self.along(c, reached + clearance, Speed::Rapid),
            }
        }
    }
}

/// About how long a move takes where no machine is asked: rapids at 10 m/min.
fn nominal_seconds(path: &Path<Setup>, speed: Speed) -> f64 {
    let length = path.length();
    match speed {
        Speed::Rapid => length / (10_000.0 / 60.0),
        Speed::Feed(plan::Feed::PerTime(v)) if v.0 > 0.0 => length / v.0,
        Speed::Feed(plan::Feed::WholeMove(time)) => time.0,
        Speed::Feed(_) => length / (100.0 / 60.0),
    }
}

//! Moves: straight ones, arcs, the skip function, and moves of the machine's axes.

use crate::arc::{ArcFault, Circle, Request, solve};
use crate::block::Block;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, Item, missing_word};
use crate::profile::Motion;
use plan::{Answer, Feed, MachineMove, Path, PathMode, Question, Severity, Speed, StepKind};
use units::{Millimetres, Point, Setup};

impl Interpreter {
    // ---- straight moves and arcs

    /// The places that the block's axis words name; `None` when there are none.
    pub(crate) fn target(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<Option<[f64; 3]>> {
        let mut said = [None; 3];
        let mut any = false;
        if block.has_any(b"XYZUW") {
            said = self.said(block, site, None)?;
            for (axis, word) in said.iter().enumerate() {
                if let Some((_, adds)) = word {
                    any = true;
                    if !adds {
                        self.carried[axis] = 0.0;
                    }
                }
            }
        }
        let to = match self.shaping.is_plain() {
            true => std::array::from_fn(|k| match said[k] {
                None => self.tip[k],
                Some((value, true)) => self.tip[k] + value,
                Some((value, false)) => value,
            }),
            false if any => self.place_of(said),
            false => self.tip,
        };
        self.moved |= any;
        self.moved_since_stop |= any;
        Ok(any.then_some(to))
    }

    /// The block's own move, by the motion code in force or the drilling cycle.
    pub(crate) fn move_tip(&mut self, block: &mut Block, exact_stop: bool, site: Site<'_>) -> Outcome<()> {
        if self.cycle.is_some() {
            return self.drill(block, site);
        }
        if self.turning_cycles.single.is_some() {
            return self.single_cycle(block, site);
        }
        let at = self.axis_at(block);
        let arc = matches!(self.motion, Motion::Clockwise | Motion::Counterclockwise);
        let circle_words = arc && block.has_any(b"IJKR");
        let to = self.target(block, site)?;
        if to.is_none() && !circle_words {
            return Ok(());
        }
        let mut to = to.unwrap_or(self.tip);
        if self.motion == Motion::Straight {
            self.take_angle(&mut to, block)?;
        }
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
                self.take_corner(block, site)?;
                self.line(to, feed);
                if self.corner.asked.take().is_some() {
                    return Err(Fault::new(
                        at,
                        55,
                        "corner",
                        "a corner behind a move without length",
                        "take the corner out",
                    ));
                }
            }
            Motion::Clockwise => self.arc(to, false, at, block, site)?,
            Motion::Counterclockwise => self.arc(to, true, at, block, site)?,
            Motion::Thread => self.thread_to(to, at, block, site)?,
            Motion::RigidTap => self.tap_to(to, at, block, site)?,
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
    pub(crate) fn prepare_move(&mut self, at: usize, site: Site<'_>) -> Outcome<()> {
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
    pub(crate) fn axis_at(&self, block: &Block) -> usize {
        self.profile
            .axes
            .iter()
            .filter_map(|w| block.look(w.letter))
            .map(|w| w.at)
            .min()
            .unwrap_or(0)
    }

    /// `,A`, on a lathe also A: the angle of a straight move from the first axis of the plane, with one of its ends.
    fn take_angle(&mut self, to: &mut [f64; 3], block: &mut Block) -> Outcome<()> {
        let letter = if self.profile.turning { block.take(b'A') } else { None };
        let Some(angle) = block.angle.take().or(letter) else {
            return Ok(());
        };
        let [a, b, _] = self.plane.axes();
        let from = self.tip;
        let named = |axis: usize| {
            self.profile
                .axes
                .iter()
                .any(|w| w.axis == axis && block.look(w.letter).is_some())
        };
        if !self.shaping.is_plain() {
            return Err(Fault::not_there_yet(
                angle.at,
                "an angle of a contour (,A) with G16, G51 or G68",
            ));
        }
        let (sine, cosine) = (
            crate::evaluate::sin_degrees(angle.value),
            crate::evaluate::sin_degrees(angle.value + 90.0),
        );
        let way = match (named(a), named(b)) {
            (true, false) if cosine.abs() > 1e-9 => (to[a] - from[a]) / cosine,
            (false, true) if sine.abs() > 1e-9 => (to[b] - from[b]) / sine,
            (false, false) => {
                return Err(Fault::not_there_yet(
                    angle.at,
                    "a line given by its angle alone, up to the next line,",
                ));
            }
            (true, true) => {
                return Err(Fault::new(
                    angle.at,
                    0,
                    "angle-twice",
                    "the end of this move is given by both axes, and an angle too",
                    "keep the angle and one axis, or both axes",
                ));
            }
            _ => {
                return Err(Fault::new(
                    angle.at,
                    0,
                    "angle-parallel",
                    format!("a line at {} degrees never comes to that place", angle.value),
                    "give the other axis, or correct the angle",
                ));
            }
        };
        // An angle points to one side only.
        if way < -1e-9 {
            return Err(Fault::new(
                angle.at,
                0,
                "angle-back",
                format!("a line at {} degrees leads away from that place", angle.value),
                "turn the angle by 180 degrees, or correct the place",
            ));
        }
        (to[a], to[b]) = (from[a] + way * cosine, from[b] + way * sine);
        Ok(())
    }

    /// How many words of the block name an axis.
    fn axis_words(&self, block: &Block) -> usize {
        self.profile.axes.iter().filter(|w| block.look(w.letter).is_some()).count()
    }

    /// A straight move of the tip; none when it is there already.
    pub(crate) fn line(&mut self, to: [f64; 3], speed: Speed) {
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

    pub(crate) fn follow_path(&mut self, path: Path<Setup>, speed: Speed, to: [f64; 3]) {
        self.tip = to;
        if self.options.trace {
            self.nominal += nominal_seconds(&path, speed);
            self.trace_move(match (&path, speed) {
                (Path::Arc(_), _) => self.motion as u8,
                (_, Speed::Rapid) => 0,
                _ => 1,
            });
        }
        self.moved = true;
        self.moved_since_stop = true;
        self.threading = matches!(speed, Speed::Feed(Feed::Thread(_)));
        if let Err(fault) = self.round(path, speed) {
            self.compensation.fault.get_or_insert(fault);
        }
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

    fn arc(&mut self, to: [f64; 3], mut counterclockwise: bool, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let feed = Speed::Feed(self.feed(at)?);
        let [a, b, _] = self.plane.axes();
        let letters = [b'I', b'J', b'K'];
        let mut centre = [self.tip[a], self.tip[b]];
        let mut has_centre = false;
        let mut way = [0.0; 3];
        for (index, axis) in [a, b].into_iter().enumerate() {
            if let Some(w) = block.take(letters[axis]) {
                let value = self.length(letters[axis], w, site);
                way[axis] = value;
                centre[index] = if self.absolute_centres { value } else { centre[index] + value };
                has_centre = true;
            }
        }
        let mut grown = 1.0;
        if !self.shaping.is_plain() {
            let Some(factor) = self.shaping.radius_factor(self.plane) else {
                return Err(Fault::not_there_yet(at, "an arc with different scales along its axes"));
            };
            grown = factor;
            way = self.shaping.way(way);
            centre = [self.tip[a] + way[a], self.tip[b] + way[b]];
            counterclockwise ^= self.shaping.turns_round(self.plane);
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
                Circle::Radius(self.length(b'R', r, site) * grown)
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
        let alone = self.axis_words(block) == 0;
        if self.incremental && !(alone && self.macros.fanuc_ranges) {
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
        self.interrupt_compensation();
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
        self.threading = false;
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
        const ORDER: [&str; 3] = ["second", "third", "fourth"];
        let which = match block.take(b'P') {
            None => 2,
            Some(p) => match Self::whole(p, 'P', 4)? {
                which @ 2..=4 => which,
                other => {
                    return Err(Fault::new(
                        p.at,
                        46,
                        "word-range",
                        format!("G30 P{other}: reference positions are P2, P3 and P4"),
                        "write P2, P3 or P4, or no P for the second",
                    ));
                }
            },
        };
        let index = which as usize - 2;
        let by_axis: [Option<f64>; 3] = std::array::from_fn(|axis| {
            let said = self.settings.all.of_axis(1239 + which, axis);
            said.map(|mm| mm * self.profile.factor(axis))
        });
        let place = match self.options.references[index] {
            Some(place) => place.xyz,
            None if by_axis.iter().any(Option::is_some) => by_axis.map(Option::unwrap_or_default),
            None => {
                let what = format!("the {} reference position (parameter {})", ORDER[index], 1239 + which);
                self.missing("missing-reference", site, at, &what, "the machine's zero")?;
                [0.0; 3]
            }
        };
        self.home(at, place, block, site)
    }

    // ---- the skip function

    /// G31: straight towards a place until the skip signal comes. The machine is asked where that is; it answers when all is done.
    pub(crate) fn skip(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        if self.compensation.is_wanted() {
            return Err(Fault::new(
                at,
                36,
                "skip-compensated",
                "G31 while cutter compensation is in force",
                "cancel it with G40 first",
            ));
        }
        self.interrupt_compensation();
        let Some(to) = self.target(block, site)? else {
            return Err(missing_word(at, "G31", "an axis word"));
        };
        let feed = self.feed(at)?;
        self.prepare_move(at, site)?;
        self.push(Item::Ask(
            self.origin,
            Question::Skip {
                from: Point::from_xyz(self.tip),
                to: Point::from_xyz(to),
                feed,
            },
        ));
        Ok(())
    }

    /// Goes where the machine says the signal came, or all the way.
    pub(crate) fn skip_answered(&mut self, question: &Question, answer: Answer) {
        let Question::Skip { to, feed, .. } = question else { return };
        let line = match self.origin.place {
            plan::Place::Text { line, .. } => line,
            _ => 0,
        };
        let site = Site { text: b"", number: line };
        let stopped = match answer {
            Answer::Place(Some(place)) => place,
            Answer::Place(None) => {
                self.note(Severity::Warning, "skip-no-signal", site, 0, || {
                    (
                        "no skip signal came on the way of G31: its end point is taken".to_owned(),
                        "test #5061 against the end point in the program".to_owned(),
                    )
                });
                *to
            }
            _ => {
                self.note(Severity::Warning, "skip-no-probe", site, 0, || {
                    (
                        "this machine has no skip signal: G31 goes to its end point, and that is what #5061 shows".to_owned(),
                        "what the program measures here is not measured".to_owned(),
                    )
                });
                *to
            }
        };
        self.skip_position = stopped.xyz;
        self.line(stopped.xyz, Speed::Feed(*feed));
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

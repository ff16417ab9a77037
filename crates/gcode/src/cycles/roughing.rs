//! G70 to G73: cycles over a contour that stands in the program, from the block P to the block Q.
//!
//! The contour is read once, before anything moves, and kept (at most [`MOST_BLOCKS`] blocks); its passes are told one at a time.
//! G71 cuts along Z level by level, G72 along X; what is left of the steps between the levels is taken by a last pass along the contour
//! with the allowances. Type I: X and Z never turn back (alarm 064). Type II, when the first block of the contour names both axes: the
//! depth may turn back, and each pocket is cut to its ground before the next. A pocket is entered straight down at its near wall.
//!
//! After G71 to G73 the program goes on behind the contour when that follows, else behind the cycle's block. Compensation is left out of
//! roughing and applied by G70. F, S of the contour's blocks are for G70 only.

use crate::block::Block;
use crate::compensation::Offset;
use crate::corner::Corner;
use crate::cycles::{Expansion, illegal};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Flow, Interpreter, Item, Turning, missing_word};
use crate::profile::{Motion, Side};
use plan::{Arc, Path, Speed, SpindleState, StepKind};
use std::f64::consts::TAU;
use units::{Radians, Setup, Vector};

/// Blocks that a contour may have.
pub(crate) const MOST_BLOCKS: usize = 1000;
/// Levels that a cycle may have.
const MOST_LEVELS: f64 = 20_000.0;
/// Turning back that is rounding of written numbers, mm.
const ROUNDING: f64 = 2e-3;

/// Which cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContourCycle {
    /// G70.
    Finish,
    /// G71: roughing along Z.
    Turn,
    /// G72: roughing along X.
    Face,
    /// G73: the contour again and again, nearer each time.
    Pattern,
}

impl ContourCycle {
    pub(crate) fn name(self) -> &'static str {
        match self {
            ContourCycle::Finish => "G70",
            ContourCycle::Turn => "G71",
            ContourCycle::Face => "G72",
            ContourCycle::Pattern => "G73",
        }
    }
}

/// What stays set from one cycle to the next: Fanuc parameters 5132, 5133, 5135 to 5137.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RoughSettings {
    depth: Option<f64>,
    escape: f64,
    /// Way of the first pass of G73 from the last: X (a radius) and Z.
    pattern: [f64; 2],
    passes: u32,
}

/// A contour to be read, for a cycle whose words are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContourRequest {
    pub cycle: ContourCycle,
    pub first: u32,
    pub last: u32,
    /// Byte of the cycle's code in its line.
    pub at: usize,
    depth: f64,
    escape: f64,
    pattern: [f64; 2],
    passes: u32,
    /// Finishing allowance: X (a radius) and Z.
    allowance: [f64; 2],
    feed: Option<Speed>,
}

/// Blocks of a contour, as they are read.
#[derive(Debug, Default)]
pub(crate) struct Contour {
    pieces: Vec<Piece>,
    /// The first block names both axes.
    both_axes: bool,
    /// It names an axis of infeed.
    names_depth: bool,
    blocks: usize,
}

/// One step of a contour with what is in force for it.
#[derive(Clone, Debug)]
struct Piece {
    kind: StepKind,
    wanted: Option<Offset>,
}

/// What reading a contour changes and a roughing cycle must not.
pub(crate) struct Before {
    tip: [f64; 3],
    motion: Motion,
    feed: Option<f64>,
    last_f: Option<f64>,
    side: Side,
    wanted: Option<Offset>,
    revolutions: f64,
    surface: Option<f64>,
    surface_speed: f64,
    turning: Turning,
    spindle: SpindleState,
}

impl Interpreter {
    /// G70 to G73: the first block of a two-block form is taken down, the other asks for its contour.
    pub(crate) fn contour_cycle(&mut self, cycle: ContourCycle, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let name = cycle.name();
        let mut rough = self.turning_cycles.rough;
        let (p, q) = (block.take(b'P'), block.take(b'Q'));
        let (first, last) = match (p, q) {
            (Some(p), Some(q)) => (Self::whole(p, 'P', 99_999)?, Self::whole(q, 'Q', 99_999)?),
            (None, None) if cycle != ContourCycle::Finish && block.has_any(b"UWRD") => {
                return self.rough_settings(cycle, at, block, site);
            }
            _ => {
                return Err(Fault::new(
                    at,
                    61,
                    "contour-without-blocks",
                    format!("{name} needs P and Q, the first and the last block of its contour"),
                    "write the sequence numbers: P10 Q20",
                ));
            }
        };
        let mut allowance = [0.0; 2];
        if cycle != ContourCycle::Finish {
            for (value, (letter, factor)) in allowance.iter_mut().zip([(b'U', self.profile.factor(0)), (b'W', 1.0)]) {
                if let Some(w) = block.take(letter) {
                    *value = self.length(letter, w, site) * factor;
                }
            }
        }
        // The one-block form.
        if let Some(d) = block.take(b'D') {
            match cycle {
                ContourCycle::Pattern => rough.passes = Self::whole(d, 'D', 9999)?,
                _ => rough.depth = Some(self.increments(d)),
            }
        }
        if cycle == ContourCycle::Pattern {
            for (value, letter) in rough.pattern.iter_mut().zip([b'I', b'K']) {
                if let Some(w) = block.take(letter) {
                    *value = self.length(letter, w, site);
                }
            }
        }
        let depth = rough.depth.unwrap_or(0.0);
        match cycle {
            ContourCycle::Turn | ContourCycle::Face if depth <= 0.0 => {
                return Err(illegal(
                    at,
                    format!("the depth of cut of {name} is {depth} mm: it must be above 0"),
                    "write the first block: G71 U2. R1., or G72 W2. R1.",
                ));
            }
            ContourCycle::Pattern if rough.passes == 0 => {
                return Err(illegal(
                    at,
                    "G73 has no number of passes",
                    "write the first block: G73 U5. W2. R3, R is how many",
                ));
            }
            _ => {}
        }
        self.turning_cycles.rough = rough;
        let feed = match cycle {
            ContourCycle::Finish => None,
            _ => {
                self.note_no_compensation(name, at, site);
                Some(self.cutting(at)?)
            }
        };
        self.prepare_move(at, site)?;
        self.turning_cycles.request = Some(ContourRequest {
            cycle,
            first,
            last,
            at,
            depth,
            escape: rough.escape,
            pattern: rough.pattern,
            passes: rough.passes,
            allowance,
            feed,
        });
        Ok(())
    }

    fn rough_settings(&mut self, cycle: ContourCycle, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mut rough = self.turning_cycles.rough;
        let mut length = |letter: u8| block.take(letter).map(|w| (self.length(letter, w, site), w.at));
        match cycle {
            ContourCycle::Pattern => {
                let (u, w) = (length(b'U'), length(b'W'));
                rough.pattern = [u.map_or(0.0, |u| u.0), w.map_or(0.0, |w| w.0)];
                let Some(r) = block.take(b'R') else {
                    return Err(missing_word(at, "G73", "R, the number of passes"));
                };
                // Some write the number as thousandths: R0.005 is 5 passes on controls that count increments.
                rough.passes = Self::whole(r, 'R', 9999)?;
                if rough.passes == 0 {
                    return Err(illegal(r.at, "G73 with no pass at all", "correct R"));
                }
            }
            _ => {
                let letter = if cycle == ContourCycle::Turn { b'U' } else { b'W' };
                if let Some((depth, at)) = length(letter) {
                    if depth <= 0.0 {
                        return Err(illegal(
                            at,
                            format!("the depth of cut of {} is {depth} mm: it must be above 0", cycle.name()),
                            "write it without sign",
                        ));
                    }
                    rough.depth = Some(depth);
                }
                if let Some((escape, at)) = length(b'R') {
                    if escape < 0.0 {
                        return Err(illegal(at, "the escape of a roughing cycle is negative", "correct R"));
                    }
                    rough.escape = escape;
                }
            }
        }
        self.turning_cycles.rough = rough;
        Ok(())
    }

    // ---- reading the contour

    pub(crate) fn begin_contour(&mut self) -> Before {
        self.interrupt_compensation();
        self.compensation.suspended = true;
        Before {
            tip: self.tip,
            motion: self.motion,
            feed: self.feed,
            last_f: self.last_f,
            side: self.side,
            wanted: self.compensation.wanted(),
            revolutions: self.revolutions,
            surface: self.surface,
            surface_speed: self.surface_speed,
            turning: self.turning,
            spindle: self.spindle,
        }
    }

    /// Takes a block of the contour: it is executed, and what it says is kept back.
    pub(crate) fn contour_block(
        &mut self,
        contour: &mut Contour,
        request: &ContourRequest,
        block: &mut Block,
        site: Site<'_>,
    ) -> Outcome<()> {
        let unfit = |what: &str, remedy: &str| Fault::new(0, 66, "contour-block", what.to_owned(), remedy.to_owned());
        contour.blocks += 1;
        if contour.blocks > MOST_BLOCKS {
            return Err(illegal(
                0,
                format!("the contour has more than {MOST_BLOCKS} blocks"),
                "is Q its last block?",
            ));
        }
        if contour.blocks == 1 {
            let (x, z) = (block.has_any(b"XU"), block.has_any(b"ZW"));
            contour.both_axes = x && z;
            contour.names_depth = if request.cycle == ContourCycle::Face { z } else { x };
        }
        let told = std::mem::take(&mut self.out);
        let flow = self.execute(block, site);
        let items = std::mem::replace(&mut self.out, told);
        if self.expansion.take().is_some() || self.turning_cycles.request.take().is_some() {
            return Err(unfit(
                "a cycle inside the contour of another",
                "write the contour with G0 to G3",
            ));
        }
        if flow? != Flow::NextBlock {
            return Err(unfit(
                "a call or the program's end inside a contour",
                "check Q, the last block of the contour",
            ));
        }
        for item in items {
            match item {
                Item::Step(_, StepKind::MachineMove(_) | StepKind::Frame(_) | StepKind::Tool(_) | StepKind::ToolOffset(_)) => {
                    return Err(unfit(
                        "a contour may not change the tool or its frame, or go to the machine's places",
                        "leave G0 to G3, F, S and G40 to G42",
                    ));
                }
                Item::Step(_, kind) => contour.pieces.push(Piece {
                    kind,
                    wanted: self.compensation.wanted(),
                }),
                Item::Ask(..) => return Err(unfit("an optional stop inside a contour", "take M1 out of it")),
            }
        }
        if contour.blocks == 1 {
            let straight = matches!(self.motion, Motion::Rapid | Motion::Straight)
                && contour.pieces.iter().any(|p| matches!(p.kind, StepKind::Move(_)));
            let face_or_turn = matches!(request.cycle, ContourCycle::Turn | ContourCycle::Face);
            if request.cycle != ContourCycle::Finish && (!straight || face_or_turn && !contour.names_depth) {
                return Err(Fault::new(
                    0,
                    65,
                    "contour-start",
                    format!(
                        "the first block of the contour of {} must be a G0 or G1 that names {}",
                        request.cycle.name(),
                        if request.cycle == ContourCycle::Face { "Z" } else { "X" }
                    ),
                    "begin the contour with the way from the start point to its first point",
                ));
            }
        }
        Ok(())
    }

    /// The contour is read: the cycle begins. What the reading changed is as before, except by G70, which did those blocks.
    pub(crate) fn begin_contour_cycle(&mut self, request: &ContourRequest, contour: Contour, before: Before) -> Outcome<()> {
        let modal_after = (self.motion, self.feed, self.last_f);
        let cut_short = self.corner.holds();
        self.restore(before);
        if cut_short {
            return Err(Fault::new(
                request.at,
                51,
                "corner",
                "the last block of the contour asks for a corner, and no move follows in it",
                "take the corner out, or let Q name the next block",
            ));
        }
        match request.cycle {
            ContourCycle::Finish => {
                (self.motion, self.feed, self.last_f) = modal_after;
                let home = self.tip;
                let suspended = self.compensation.wanted();
                self.compensation.suspended = false;
                self.expansion = Some(Box::new(Finishing {
                    pieces: contour.pieces,
                    next: 0,
                    home,
                    wanted: suspended,
                }));
                Ok(())
            }
            ContourCycle::Pattern => {
                let paths = contour.paths();
                let feed = request.feed.unwrap_or(Speed::Rapid);
                let home = self.tip;
                self.begin_expansion(Pattern {
                    paths,
                    feed,
                    home,
                    request: *request,
                    pass: 0,
                });
                Ok(())
            }
            ContourCycle::Turn | ContourCycle::Face => {
                let levels = Levels::new(request, &contour, self.tip)?;
                self.begin_expansion(levels);
                Ok(())
            }
        }
    }

    /// Puts back what reading a contour changed.
    pub(crate) fn restore(&mut self, before: Before) {
        self.corner = Corner::default();
        self.tip = before.tip;
        self.motion = before.motion;
        (self.feed, self.last_f, self.side) = (before.feed, before.last_f, before.side);
        self.compensation.restore(before.wanted);
        self.compensation.suspended = false;
        (self.revolutions, self.surface, self.surface_speed) = (before.revolutions, before.surface, before.surface_speed);
        (self.turning, self.spindle) = (before.turning, before.spindle);
    }
}

impl Contour {
    fn paths(&self) -> Vec<(Path<Setup>, bool)> {
        self.pieces
            .iter()
            .filter_map(|p| match &p.kind {
                StepKind::Move(m) => Some((m.path.clone(), m.speed == Speed::Rapid)),
                _ => None,
            })
            .collect()
    }
}

/// G70.
struct Finishing {
    pieces: Vec<Piece>,
    next: usize,
    home: [f64; 3],
    /// Compensation before and after.
    wanted: Option<Offset>,
}

impl Expansion for Finishing {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        if let Some(piece) = self.pieces.get(self.next) {
            self.next += 1;
            i.compensation.restore(piece.wanted);
            match piece.kind.clone() {
                StepKind::Move(m) => {
                    let to = m.path.end().xyz;
                    i.follow_path(m.path, m.speed, to);
                }
                StepKind::Spindle(state) => {
                    i.spindle = state;
                    i.emit(StepKind::Spindle(state));
                }
                other => i.emit(other),
            }
            return true;
        }
        // Home without compensation, whatever the contour left in force.
        let _ = i.compensation.set_aside();
        i.line(self.home, Speed::Rapid);
        i.interrupt_compensation();
        i.compensation.restore(self.wanted);
        i.say_spindle();
        false
    }
}

/// G73.
struct Pattern {
    paths: Vec<(Path<Setup>, bool)>,
    feed: Speed,
    home: [f64; 3],
    request: ContourRequest,
    pass: u32,
}

impl Expansion for Pattern {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        let r = &self.request;
        if self.pass == r.passes {
            i.line(self.home, Speed::Rapid);
            return false;
        }
        self.pass += 1;
        let share = match r.passes {
            1 => 0.0,
            n => f64::from(n - self.pass) / f64::from(n - 1),
        };
        let shift = Vector::new(
            r.allowance[0] + r.pattern[0] * share,
            0.0,
            r.allowance[1] + r.pattern[1] * share,
        );
        for (path, rapid) in &self.paths {
            let path = shifted(path, shift);
            if i.tip != path.start().xyz {
                i.line(path.start().xyz, Speed::Rapid);
            }
            let to = path.end().xyz;
            i.follow_path(path, if *rapid { Speed::Rapid } else { self.feed }, to);
        }
        true
    }
}

/// A place on a contour: piece and parameter.
type At = (usize, f64);

/// A part of a level to be cut, between two places of the contour; without a first one it begins at the cycle's start.
#[derive(Clone, Copy, Debug)]
struct Cut {
    level: u32,
    from: Option<At>,
    to: At,
}

/// G71, G72.
struct Levels {
    /// The contour with the allowances, from its first point on.
    paths: Vec<Path<Setup>>,
    /// The way to its first point, with the allowances; rapid or not.
    approach: ([f64; 3], bool),
    /// Axis of infeed and of the cuts, with the signs that make the infeed and the cuts go down.
    deep: (usize, f64),
    along: (usize, f64),
    home: [f64; 3],
    depth: f64,
    escape: f64,
    feed: Speed,
    pockets: bool,
    waiting: Vec<Cut>,
    begun: bool,
}

impl Levels {
    fn new(request: &ContourRequest, contour: &Contour, home: [f64; 3]) -> Outcome<Levels> {
        let (deep, along) = if request.cycle == ContourCycle::Turn { (0, 2) } else { (2, 0) };
        let mut all = contour.paths().into_iter();
        let Some((approach, rapid)) = all.next() else {
            return Err(illegal(request.at, "the contour has no moves", "check P and Q"));
        };
        let shift = Vector::new(request.allowance[0], 0.0, request.allowance[1]);
        let first = shifted(&approach, shift).end().xyz;
        let paths: Vec<_> = all.map(|(path, _)| shifted(&path, shift)).collect();
        let Some(last) = paths.last().map(|p| p.end().xyz) else {
            return Err(illegal(request.at, "the contour has only one move", "check P and Q"));
        };
        // Infeed goes from the start towards the contour; the cuts go from its first point to its last.
        let towards = first[deep] - home[deep];
        let whole = paths.iter().flat_map(|p| extent(p, deep)).map(|v| v - home[deep]);
        let farthest = whole.fold(towards, |a, b| if b.abs() > a.abs() { b } else { a });
        let way = last[along] - first[along];
        if farthest == 0.0 || way == 0.0 {
            return Err(illegal(
                request.at,
                "there is nothing to cut between the start point and the contour",
                "move to a start point outside the stock before the cycle",
            ));
        }
        let mut levels = Levels {
            paths,
            approach: (first, rapid),
            deep: (deep, -farthest.signum()),
            along: (along, -way.signum()),
            home,
            depth: request.depth,
            escape: request.escape,
            feed: request.feed.unwrap_or(Speed::Rapid),
            pockets: contour.both_axes,
            waiting: Vec::new(),
            begun: false,
        };
        if farthest.abs() / request.depth > MOST_LEVELS {
            return Err(illegal(
                request.at,
                format!(
                    "cuts of {} mm are too many for {:.3} mm of stock",
                    request.depth,
                    farthest.abs()
                ),
                "check the depth of cut",
            ));
        }
        levels.check_shape(request)?;
        levels.waiting = levels.cuts(1, None);
        levels.waiting.reverse();
        Ok(levels)
    }

    /// Alarm 064 where an axis turns back that may not.
    fn check_shape(&self, request: &ContourRequest) -> Outcome<()> {
        for (axis, sign, checked) in [(self.along.0, self.along.1, true), (self.deep.0, -self.deep.1, !self.pockets)] {
            if !checked {
                continue;
            }
            let mut lowest = f64::INFINITY;
            for path in &self.paths {
                let (start, end) = (path.start().xyz[axis], path.end().xyz[axis]);
                for value in std::iter::once(start).chain(extent(path, axis)).chain([end]) {
                    let value = value * sign;
                    if value > lowest + ROUNDING {
                        return Err(Fault::new(
                            request.at,
                            64,
                            "contour-turns-back",
                            format!(
                                "the contour of {} turns back along {}",
                                request.cycle.name(),
                                ["X", "Y", "Z"][axis]
                            ),
                            "name both axes in its first block (type II) for pockets; along the cuts it may never turn back",
                        ));
                    }
                    lowest = lowest.min(value);
                }
            }
        }
        Ok(())
    }

    /// Height of a level in the direction that infeed goes down.
    fn height(&self, level: u32) -> f64 {
        self.home[self.deep.0] * self.deep.1 - f64::from(level) * self.depth
    }

    fn place(&self, at: At) -> [f64; 3] {
        self.paths[at.0].at(at.1).xyz
    }

    /// The parts of a level where the contour lies below it, between two places of the contour, in the order of the cuts.
    fn cuts(&self, level: u32, within: Option<(Option<At>, At)>) -> Vec<Cut> {
        let (axis, sign) = self.deep;
        let height = self.height(level);
        let end_of_all = (self.paths.len() - 1, 1.0);
        let (from, to) = within.unwrap_or((None, end_of_all));
        let first = from.unwrap_or((0, 0.0));
        let below = |value: f64| value * sign < height - 1e-9;
        // Without a first place the cut comes from the start point: open when the contour begins below the level.
        let mut open: Option<Option<At>> = match from {
            None if below(self.place((0, 0.0))[axis]) => Some(None),
            _ => None,
        };
        let mut cuts = Vec::new();
        for index in first.0..=to.0 {
            let path = &self.paths[index];
            let low = if index == first.0 { first.1 } else { 0.0 };
            let high = if index == to.0 { to.1 } else { 1.0 };
            let mut breaks: Vec<f64> = crossings(path, axis, height * sign)
                .into_iter()
                .filter(|u| *u > low && *u < high)
                .collect();
            breaks.push(low);
            breaks.push(high);
            breaks.sort_by(f64::total_cmp);
            for pair in breaks.windows(2) {
                if pair[1] - pair[0] < 1e-12 {
                    continue;
                }
                let inside = below(path.at((pair[0] + pair[1]) / 2.0).xyz[axis]);
                match (inside, open) {
                    (true, None) => open = Some(Some((index, pair[0]))),
                    (false, Some(from)) => {
                        cuts.push(Cut {
                            level,
                            from,
                            to: (index, pair[0]),
                        });
                        open = None;
                    }
                    _ => {}
                }
            }
        }
        if let Some(from) = open {
            cuts.push(Cut { level, from, to });
        }
        if !self.pockets {
            cuts.truncate(1);
        }
        cuts
    }

    fn cut(&self, i: &mut Interpreter, cut: Cut) {
        let (deep, sign) = self.deep;
        let (along, way) = self.along;
        let at = |height: f64| height * sign;
        let (level, above) = (self.height(cut.level), self.height(cut.level - 1));
        // From wherever the last cut ended, up to where the level before is already clear.
        let clear = (above + self.escape).min(self.home[deep] * sign);
        if i.tip[deep] * sign < clear {
            i.go([(deep, at(clear)); 2], Speed::Rapid);
        }
        let end = self.place(cut.to)[along];
        let infeed = match cut.from {
            None => {
                i.go([(along, self.home[along]); 2], Speed::Rapid);
                if self.approach.1 { Speed::Rapid } else { self.feed }
            }
            Some(from) => {
                i.go([(along, self.place(from)[along]); 2], Speed::Rapid);
                self.feed
            }
        };
        let begin = i.tip[along];
        i.go([(deep, at(level)); 2], infeed);
        i.go([(along, end); 2], self.feed);
        // Off at 45 degrees, but not into the other wall of a narrow pocket.
        let off = self.escape.min((end - begin).abs() / 2.0);
        i.go([(deep, at(level + off)), (along, end + way * off)], self.feed);
    }
}

impl Expansion for Levels {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        if let Some(cut) = self.waiting.pop() {
            self.begun = true;
            self.cut(i, cut);
            let mut deeper = self.cuts(cut.level + 1, Some((cut.from, cut.to)));
            deeper.reverse();
            self.waiting.append(&mut deeper);
            return true;
        }
        let (deep, along) = (self.deep.0, self.along.0);
        if self.begun {
            i.go([(deep, self.home[deep]); 2], Speed::Rapid);
            i.go([(along, self.home[along]); 2], Speed::Rapid);
        }
        // The pass along the contour, with the allowances left.
        i.line(self.approach.0, if self.approach.1 { Speed::Rapid } else { self.feed });
        for path in &self.paths {
            let to = path.end().xyz;
            i.follow_path(path.clone(), self.feed, to);
        }
        i.go([(deep, self.home[deep]); 2], Speed::Rapid);
        i.go([(along, self.home[along]); 2], Speed::Rapid);
        false
    }
}

fn shifted(path: &Path<Setup>, by: Vector<Setup>) -> Path<Setup> {
    match path {
        Path::Line { from, to } => Path::Line {
            from: *from + by,
            to: *to + by,
        },
        Path::Arc(arc) => Path::Arc(Arc {
            from: arc.from + by,
            centre: arc.centre + by,
            ..*arc
        }),
        Path::Spline(spline) => {
            let mut spline = spline.clone();
            for pole in &mut spline.poles {
                *pole = *pole + by;
            }
            Path::Spline(spline)
        }
    }
}

/// Centre, cosine part and sine part of an arc's coordinate along an axis.
fn wave(arc: &Arc<Setup>, axis: usize) -> (f64, f64, f64) {
    let out = (arc.from - arc.centre).xyz;
    let n = arc.normal.xyz;
    let across = [
        n[1] * out[2] - n[2] * out[1],
        n[2] * out[0] - n[0] * out[2],
        n[0] * out[1] - n[1] * out[0],
    ];
    (arc.centre.xyz[axis], out[axis], across[axis])
}

/// Parameters at which a path is at `value` along an axis.
fn crossings(path: &Path<Setup>, axis: usize, value: f64) -> Vec<f64> {
    match path {
        Path::Line { from, to } => {
            let (a, b) = (from.xyz[axis], to.xyz[axis]);
            if a == b { Vec::new() } else { vec![(value - a) / (b - a)] }
        }
        Path::Arc(arc) => {
            let (centre, cosine, sine) = wave(arc, axis);
            let size = libm::sqrt(cosine * cosine + sine * sine);
            let share = (value - centre) / size;
            if size <= 0.0 || share.abs() > 1.0 {
                return Vec::new();
            }
            let (middle, half) = (libm::atan2(sine, cosine), libm::acos(share));
            on_the_way(arc.sweep, &[middle + half, middle - half])
        }
        Path::Spline(_) => Vec::new(), // G-code makes none
    }
}

/// The farthest values of a path along an axis, its start left out, in the order of the path.
fn extent(path: &Path<Setup>, axis: usize) -> Vec<f64> {
    let mut values = Vec::new();
    if let Path::Arc(arc) = path {
        let (_, cosine, sine) = wave(arc, axis);
        let top = libm::atan2(sine, cosine);
        let mut at = on_the_way(arc.sweep, &[top, top + TAU / 2.0]);
        at.sort_by(f64::total_cmp);
        values.extend(at.into_iter().map(|u| path.at(u).xyz[axis]));
    }
    values.push(path.end().xyz[axis]);
    values
}

/// Angles from the start of an arc that lie on it, as parameters.
fn on_the_way(sweep: Radians, angles: &[f64]) -> Vec<f64> {
    let mut found = Vec::new();
    for angle in angles {
        let mut turned = libm::fmod(*angle, TAU);
        if turned * sweep.0 < 0.0 {
            turned += TAU * sweep.0.signum();
        }
        while turned.abs() <= sweep.0.abs() {
            found.push(turned / sweep.0);
            turned += TAU * sweep.0.signum();
        }
    }
    found
}

/// The start of a contour, for messages.
pub(crate) fn not_found(at: usize, number: u32, cycle: ContourCycle) -> Box<Fault> {
    Fault::new(
        at,
        63,
        "contour-not-found",
        format!("{} looks for block N{number}, which is not in this program", cycle.name()),
        "correct P and Q, or number the blocks of the contour",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use units::Point;

    fn arc(from: [f64; 3], centre: [f64; 3], degrees: f64) -> Path<Setup> {
        Path::Arc(Arc {
            from: Point::from_xyz(from),
            centre: Point::from_xyz(centre),
            normal: Vector::new(0.0, 1.0, 0.0),
            sweep: Radians(degrees.to_radians()),
            rise: 0.0,
        })
    }

    #[test]
    fn an_arc_is_met_where_its_coordinate_says() {
        // A quarter from X10 Z0 about the origin: counterclockwise about Y goes from X to -Z.
        for degrees in [90.0, -90.0] {
            let path = arc([10.0, 0.0, 0.0], [0.0; 3], degrees);
            let u = crossings(&path, 0, 6.0);
            assert_eq!(u.len(), 1, "{degrees}");
            let p = path.at(u[0]).xyz;
            assert!((p[0] - 6.0).abs() < 1e-9 && (p[2].abs() - 8.0).abs() < 1e-9, "{p:?}");
        }
        let half = arc([0.0, 0.0, 10.0], [0.0; 3], 180.0);
        assert_eq!(crossings(&half, 0, 6.0).len(), 2);
        assert!((extent(&half, 0)[0] - 10.0).abs() < 1e-12);
    }
}

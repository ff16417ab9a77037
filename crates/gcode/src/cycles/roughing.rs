//! G70 to G73: cycles over a contour that stands in the program, from the block P to the block Q.
//!
//! The contour is read once, before anything moves, and kept (at most [`MOST_BLOCKS`] blocks); its passes are told one at a time. How
//! G71 and G72 cut is in [`levels`](super::levels).
//!
//! After G71 to G73 the program goes on behind the contour when that follows, else behind the cycle's block. Compensation is left out of
//! roughing and applied by G70. F, S of the contour's blocks are for G70 only.

use crate::block::Block;
use crate::compensation::Offset;
use crate::corner::Corner;
use crate::cycles::levels::{Levels, shifted};
use crate::cycles::{Expansion, illegal};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Flow, Interpreter, Item, Turning, missing_word};
use crate::profile::{Motion, Side};
use plan::{Path, Speed, SpindleState, StepKind};
use units::{Setup, Vector};

/// Blocks that a contour may have.
pub(crate) const MOST_BLOCKS: usize = 1000;

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
    pub depth: f64,
    pub escape: f64,
    pattern: [f64; 2],
    passes: u32,
    /// Finishing allowance: X (a radius) and Z.
    pub allowance: [f64; 2],
    pub feed: Option<Speed>,
}

/// Blocks of a contour, as they are read.
#[derive(Debug, Default)]
pub(crate) struct Contour {
    pieces: Vec<Piece>,
    /// The first block names both axes.
    pub both_axes: bool,
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
    pub fn paths(&self) -> Vec<(Path<Setup>, bool)> {
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

/// Alarm 063.
pub(crate) fn not_found(at: usize, number: u32, cycle: ContourCycle) -> Box<Fault> {
    Fault::new(
        at,
        63,
        "contour-not-found",
        format!("{} looks for block N{number}, which is not in this program", cycle.name()),
        "correct P and Q, or number the blocks of the contour",
    )
}

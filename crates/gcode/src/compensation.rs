//! G40, G41, G42: the path of the tool's centre (mill, D) or of the imaginary tip (lathe, nose radius R and tip direction T) beside a
//! programmed contour.
//!
//! The offset path of a move is known only when the next move is: so one move is held back, with everything said behind it, until the
//! next one in the plane comes. The main type is [`Compensation`]; [`Interpreter::take_move`] is the one way in.
//!
//! Laws (those of Fanuc's type A start-up; parameter 5003.0 SUP=0):
//! - The start-up move ends square to the start of the next one, whatever the corner; the cancelling move begins square to the end of the
//!   one before it. Both are straight: else alarm 034.
//! - Inside a corner the two offset curves meet; where they do not, alarm 033. Where an offset move would run backwards, or an arc is
//!   smaller than the tool, alarm 041: it would cut into the contour.
//! - Outside a corner of up to 90 degrees the tangents are lengthened to their meeting point; outside a sharper one the tool goes on by
//!   its radius, across, and comes back by its radius.
//!
//! What it deliberately does not see: interference of moves that are not neighbours (a slot narrower than the tool), and it does not
//! apply inside canned cycles, threads and G31; there it is interrupted and begins anew with the next move.

mod joint;

use crate::fault::{Fault, Outcome};
use crate::interpreter::{Interpreter, Item};
use crate::macro_b::Value;
use crate::profile::{Plane, Side};
use joint::{beside, check_arc, distance3, dot, joint, length_in, point, subtract, tangent, turned};
use plan::{Arc, Move, Origin, Path, Register, RegisterChange, Speed, StepKind};
use std::collections::VecDeque;
use std::f64::consts::PI;
use units::{Point, Radians, Setup};

/// Things said behind the held move; more than that ends the waiting, as on the control two blocks without a move do.
const MOST_HELD: usize = 100;
/// Moves shorter than this in the plane do not turn the offset, mm.
const NO_LENGTH: f64 = 1e-7;
/// Rounding of written numbers that is no interference, mm.
const ROUNDING: f64 = 1.5e-3;

type V2 = [f64; 2];

/// By how much and to which side the path is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Offset {
    /// 1 to the left of the path (G41), -1 to its right.
    side: f64,
    radius: f64,
    /// From the programmed point of the tool to the centre of its rounding, in the plane; 0 on a mill.
    to_centre: V2,
    plane: Plane,
}

/// A move whose offset path waits for the next move.
#[derive(Clone, Debug)]
struct Piece {
    path: Path<Setup>,
    speed: Speed,
    origin: Origin,
    /// The start-up move: it goes straight from where the tool is.
    lead: bool,
}

#[derive(Clone, Debug)]
enum Held {
    Item(Item),
    /// A move square to the plane, to this level.
    Along {
        origin: Origin,
        speed: Speed,
        level: f64,
    },
}

/// The tool is beside the contour.
#[derive(Clone, Debug)]
struct Engaged {
    offset: Offset,
    /// Where the steps given so far have brought the tip.
    at: [f64; 3],
    pending: Option<Piece>,
    held: VecDeque<Held>,
}

/// The state of compensation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Compensation {
    /// As G41 and G42 say.
    wanted: Option<Offset>,
    engaged: Option<Engaged>,
    /// A cycle goes its own way.
    pub suspended: bool,
    /// What went wrong where nothing could be returned; raised at the end of the block.
    pub fault: Option<Box<Fault>>,
}

impl Compensation {
    /// True when G41 or G42 asks for a radius other than 0.
    pub(crate) fn is_wanted(&self) -> bool {
        self.wanted.is_some()
    }

    /// Alarm 037 where the plane in force is not the one that G41 or G42 was said in.
    pub(crate) fn check_plane(&self, plane: Plane) -> Outcome<()> {
        match (&self.engaged, self.wanted) {
            (Some(engaged), _) if engaged.offset.plane != plane => Err(plane_alarm()),
            (_, Some(wanted)) if wanted.plane != plane => Err(plane_alarm()),
            _ => Ok(()),
        }
    }

    /// What G41 or G42 asks for; give it back to [`Compensation::restore`].
    pub(crate) fn wanted(&self) -> Option<Offset> {
        self.wanted
    }

    pub(crate) fn set_aside(&mut self) -> Option<Offset> {
        self.wanted.take()
    }

    pub(crate) fn restore(&mut self, wanted: Option<Offset>) {
        self.wanted = wanted;
    }

    /// G41, G42 with this radius; a radius of 0 asks for nothing. A negative one changes sides.
    pub(crate) fn ask(&mut self, side: Side, radius: f64, tip_direction: u8, plane: Plane) {
        let side = match side {
            Side::On => 0.0,
            Side::Left => radius.signum(),
            Side::Right => -radius.signum(),
        };
        let radius = radius.abs();
        let to_tip = tip_of(tip_direction);
        self.wanted = (side != 0.0 && radius > 0.0).then_some(Offset {
            side,
            radius,
            to_centre: [-to_tip[0] * radius, -to_tip[1] * radius],
            plane,
        });
    }
}

/// From the centre of the nose to the imaginary tip, in nose radii along Z and X, as the controls number the directions for a turret
/// behind the axis (X upwards, Z to the right): 3 is the outside turning tool that cuts towards the chuck, 2 the boring bar.
fn tip_of(direction: u8) -> V2 {
    match direction {
        1 => [1.0, 1.0],
        2 => [-1.0, 1.0],
        3 => [-1.0, -1.0],
        4 => [1.0, -1.0],
        5 => [1.0, 0.0],
        6 => [0.0, 1.0],
        7 => [-1.0, 0.0],
        8 => [0.0, -1.0],
        _ => [0.0, 0.0],
    }
}

impl Interpreter {
    /// A move of the tip as programmed; what is given on is beside it when compensation is in force.
    pub(crate) fn take_move(&mut self, path: Path<Setup>, speed: Speed) -> Outcome<()> {
        if self.compensation.suspended || (self.compensation.wanted.is_none() && self.compensation.engaged.is_none()) {
            self.push(Item::Step(self.origin, a_move(path, speed)));
            return Ok(());
        }
        let Some(mut engaged) = self.compensation.engaged.take() else {
            return self.start_up(path, speed);
        };
        let plane = engaged.offset.plane;
        let [_, _, c] = plane.axes();
        let result = match self.compensation.wanted {
            _ if length_in(plane, &path) <= NO_LENGTH => {
                let (origin, level) = (self.origin, path.end().xyz[c]);
                match engaged.pending {
                    Some(_) => engaged.held.push_back(Held::Along { origin, speed, level }),
                    None => self.along_level(&mut engaged, origin, speed, level),
                }
                if engaged.held.len() > MOST_HELD {
                    self.end_square(&mut engaged)
                } else {
                    Ok(())
                }
            }
            Some(wanted) => self.follow_on(&mut engaged, wanted, path, speed),
            None => {
                if matches!(path, Path::Line { .. }) {
                    let to = path.end();
                    let ended = self.end_square(&mut engaged);
                    let from = Point::from_xyz(engaged.at);
                    self.push(Item::Step(self.origin, a_move(Path::Line { from, to }, speed)));
                    return ended;
                }
                Err(not_straight("cancelled"))
            }
        };
        self.compensation.engaged = Some(engaged);
        result
    }

    fn start_up(&mut self, path: Path<Setup>, speed: Speed) -> Outcome<()> {
        let Some(offset) = self.compensation.wanted else {
            return Ok(());
        };
        if length_in(offset.plane, &path) <= NO_LENGTH {
            self.push(Item::Step(self.origin, a_move(path, speed)));
            return Ok(());
        }
        if !matches!(path, Path::Line { .. }) {
            return Err(not_straight("begun"));
        }
        self.compensation.engaged = Some(Engaged {
            offset,
            at: path.start().xyz,
            pending: Some(Piece {
                path,
                speed,
                origin: self.origin,
                lead: true,
            }),
            held: VecDeque::new(),
        });
        Ok(())
    }

    /// The next move in the plane: the one before gets its end.
    fn follow_on(&mut self, engaged: &mut Engaged, wanted: Offset, path: Path<Setup>, speed: Speed) -> Outcome<()> {
        let [a, b, _] = wanted.plane.axes();
        let corner = [path.start().xyz[a], path.start().xyz[b]];
        let start = tangent(wanted.plane, &path, 0.0);
        let square = beside(corner, start, wanted);
        check_arc(&path, wanted)?;
        let mut to = vec![square];
        match engaged.pending.take() {
            Some(piece) if piece.lead => self.give_path(engaged, piece, square)?,
            Some(piece) if wanted != engaged.offset => {
                let end = tangent(wanted.plane, &piece.path, 1.0);
                let offset = engaged.offset;
                self.give_path(engaged, piece, beside(corner, end, offset))?;
            }
            Some(piece) => {
                let joint = joint(&piece.path, &path, corner, wanted)?;
                self.give_path(engaged, piece, joint.end)?;
                to = joint.via.into_iter().flatten().collect();
            }
            None => {}
        }
        self.let_go(engaged);
        engaged.offset = wanted;
        for place in to {
            self.link(engaged, place, speed);
        }
        engaged.pending = Some(Piece {
            path,
            speed,
            origin: self.origin,
            lead: false,
        });
        Ok(())
    }

    /// A straight link at the same level, given at once; the pending move is taken out before.
    fn link(&mut self, engaged: &mut Engaged, centre: V2, speed: Speed) {
        let to = engaged.tip_at(centre, engaged.at[engaged.offset.plane.axes()[2]]);
        if distance3(engaged.at, to) <= NO_LENGTH {
            return;
        }
        let path = Path::Line {
            from: Point::from_xyz(engaged.at),
            to: Point::from_xyz(to),
        };
        engaged.at = to;
        self.out.push_back(Item::Step(self.origin, a_move(path, speed)));
    }

    /// Gives a held move its offset path, which ends with the centre at `end`.
    fn give_path(&mut self, engaged: &mut Engaged, piece: Piece, end: V2) -> Outcome<()> {
        let plane = engaged.offset.plane;
        let [a, b, c] = plane.axes();
        let level = piece.path.end().xyz[c];
        let to = engaged.tip_at(end, level);
        let from = engaged.at;
        let begin = [from[a] + engaged.offset.to_centre[0], from[b] + engaged.offset.to_centre[1]];
        let path = match piece.path {
            Path::Arc(arc) if !piece.lead => {
                let centre = [arc.centre.xyz[a], arc.centre.xyz[b]];
                // Along an arc the offset ends may lie before or behind the programmed ones.
                let way = arc.sweep.0.signum();
                let begun = turned(centre, point(plane, &piece.path, 0.0), begin);
                let ended = turned(centre, point(plane, &piece.path, 1.0), end);
                let sweep = arc.sweep.0 - begun + ended;
                if sweep * way * arc.radius() < -ROUNDING {
                    return Err(interference());
                }
                let mut middle = from;
                (middle[a], middle[b]) = (
                    centre[0] - engaged.offset.to_centre[0],
                    centre[1] - engaged.offset.to_centre[1],
                );
                Path::Arc(Arc {
                    from: Point::from_xyz(from),
                    centre: Point::from_xyz(middle),
                    normal: arc.normal,
                    sweep: Radians(sweep),
                    rise: level - from[c],
                })
            }
            other => {
                let along = tangent(plane, &other, 0.0);
                if !piece.lead && dot(subtract(end, begin), along) < -ROUNDING {
                    return Err(interference());
                }
                Path::Line {
                    from: Point::from_xyz(from),
                    to: Point::from_xyz(to),
                }
            }
        };
        engaged.at = to;
        if distance3(from, to) > NO_LENGTH || matches!(path, Path::Arc(ref arc) if arc.sweep.0.abs() > PI) {
            self.out.push_back(Item::Step(piece.origin, a_move(path, piece.speed)));
        }
        Ok(())
    }

    /// Ends the pending move square to the contour, and lets go what waited behind it.
    fn end_square(&mut self, engaged: &mut Engaged) -> Outcome<()> {
        let mut result = Ok(());
        if let Some(piece) = engaged.pending.take() {
            let plane = engaged.offset.plane;
            let corner = point(plane, &piece.path, 1.0);
            let end = tangent(plane, &piece.path, 1.0);
            let offset = engaged.offset;
            result = self.give_path(engaged, piece, beside(corner, end, offset));
        }
        self.let_go(engaged);
        result
    }

    fn let_go(&mut self, engaged: &mut Engaged) {
        while let Some(held) = engaged.held.pop_front() {
            match held {
                Held::Item(item) => self.out.push_back(item),
                Held::Along { origin, speed, level } => self.along_level(engaged, origin, speed, level),
            }
        }
    }

    fn along_level(&mut self, engaged: &mut Engaged, origin: Origin, speed: Speed, level: f64) {
        let from = Point::from_xyz(engaged.at);
        engaged.at[engaged.offset.plane.axes()[2]] = level;
        let to = Point::from_xyz(engaged.at);
        if from != to {
            self.out.push_back(Item::Step(origin, a_move(Path::Line { from, to }, speed)));
        }
    }

    /// Hands an item on, or behind the move that waits.
    #[inline]
    pub(crate) fn push(&mut self, item: Item) {
        if self.corner.holds() && !matches!(item, Item::Step(_, StepKind::Move(_))) {
            self.end_corner();
        }
        match &mut self.compensation.engaged {
            Some(engaged) if engaged.pending.is_some() => {
                engaged.held.push_back(Held::Item(item));
                if engaged.held.len() > MOST_HELD {
                    self.settle();
                }
            }
            _ => self.out.push_back(item),
        }
    }

    /// Hands on what is said between two moves without parting them: behind the move that a corner or compensation holds, which waits on.
    pub(crate) fn tell_behind(&mut self, origin: Origin, kind: StepKind) {
        let waits = self
            .compensation
            .engaged
            .as_ref()
            .is_some_and(|engaged| engaged.pending.is_some());
        if !self.corner.holds() && !waits {
            return self.out.push_back(Item::Step(origin, kind));
        }
        self.functions.push_back((origin, kind));
        if self.functions.len() > MOST_HELD {
            self.settle();
        }
    }

    /// Tells the kept variables that were written, behind the moves that were said before: one of them may be held, and a variable that
    /// was written behind it is written when the machine has made it.
    pub(crate) fn tell_writes(&mut self) {
        while let Some((origin, kind)) = self.untold_write() {
            let item = Item::Step(origin, kind);
            match &mut self.compensation.engaged {
                // However many they are, they must not end the waiting for the next move.
                Some(engaged) if engaged.pending.is_some() => engaged.held.push_back(Held::Item(item)),
                _ => self.out.push_back(item),
            }
        }
    }

    /// The next kept variable that was written and not told.
    pub(crate) fn untold_write(&mut self) -> Option<(Origin, StepKind)> {
        if self.memory.kept_writes.is_empty() {
            return self.functions.pop_front();
        }
        let write = self.memory.kept_writes.remove(0);
        let held = |value| match value {
            Value::Vacant => None,
            Value::Number(n) => Some(n),
        };
        let change = RegisterChange {
            register: Register::Variable(write.number),
            before: held(Value::of(write.before)),
            after: held(self.memory.read(write.number)),
        };
        Some((write.origin, StepKind::Register(change)))
    }

    /// Waits no longer for a next move: what is held is given on. A fault is raised at the end of the block.
    pub(crate) fn settle(&mut self) {
        self.end_corner();
        self.tell_writes();
        let Some(mut engaged) = self.compensation.engaged.take() else {
            return;
        };
        if let Err(fault) = self.end_square(&mut engaged) {
            self.compensation.fault.get_or_insert(fault);
        }
        self.compensation.engaged = Some(engaged);
    }

    /// Interrupts compensation where the tool is: the tip is counted from there, and the next move in the plane begins anew.
    pub(crate) fn interrupt_compensation(&mut self) {
        self.settle();
        if let Some(engaged) = self.compensation.engaged.take() {
            self.tip = engaged.at;
        }
    }
}

impl Engaged {
    /// The tip's place when the centre of the rounding is at `centre`.
    fn tip_at(&self, centre: V2, level: f64) -> [f64; 3] {
        let [a, b, c] = self.offset.plane.axes();
        let mut tip = self.at;
        tip[a] = centre[0] - self.offset.to_centre[0];
        tip[b] = centre[1] - self.offset.to_centre[1];
        tip[c] = level;
        tip
    }
}

fn a_move(path: Path<Setup>, speed: Speed) -> StepKind {
    StepKind::Move(Move {
        path,
        speed,
        profile: None,
        derived: false,
    })
}

fn alarm(number: u32, code: &'static str, message: impl Into<String>, remedy: &str) -> Box<Fault> {
    Fault::new(0, number, code, message, remedy)
}

fn plane_alarm() -> Box<Fault> {
    alarm(
        37,
        "compensation-plane",
        "the plane changes while cutter compensation is in force",
        "cancel with G40 first",
    )
}

fn interference() -> Box<Fault> {
    alarm(
        41,
        "compensation-interference",
        "the offset path of the move before this one would run backwards: the tool is too large for it",
        "use a smaller tool, or check the radius in the offset table",
    )
}

fn not_straight(what: &str) -> Box<Fault> {
    alarm(
        34,
        "compensation-arc",
        format!("cutter compensation is {what} with an arc"),
        "begin and cancel it with a straight move (G0, G1)",
    )
}

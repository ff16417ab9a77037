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

use crate::fault::{Fault, Outcome};
use crate::interpreter::{Interpreter, Item};
use crate::profile::{Plane, Side};
use plan::{Arc, Move, Origin, Path, Speed, StepKind};
use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};
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

/// Where two neighbouring offset moves meet: the end of the first, places between, and the start of the second is the last of all.
struct Joint {
    end: V2,
    via: [Option<V2>; 3],
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

    /// Waits no longer for a next move: what is held is given on. A fault is raised at the end of the block.
    pub(crate) fn settle(&mut self) {
        self.end_corner();
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

/// Where two moves of one offset meet at `corner`.
fn joint(first: &Path<Setup>, second: &Path<Setup>, corner: V2, offset: Offset) -> Outcome<Joint> {
    let plane = offset.plane;
    let (t1, t2) = (tangent(plane, first, 1.0), tangent(plane, second, 0.0));
    let (end, start) = (beside(corner, t1, offset), beside(corner, t2, offset));
    let turn = cross(t1, t2) * offset.side;
    let radius = offset.radius;
    if turn.abs() < 1e-9 && dot(t1, t2) > 0.0 {
        return Ok(Joint { end, via: [None; 3] });
    }
    if turn > 0.0 {
        let meeting = meeting(curve_of(first, offset), curve_of(second, offset), corner).ok_or_else(|| {
            alarm(
                33,
                "compensation-no-intersection",
                "the offset paths of this move and the one before it do not meet inside their corner",
                "use a smaller tool, or change the contour",
            )
        })?;
        return Ok(Joint {
            end: meeting,
            via: [None; 3],
        });
    }
    let straight = |p: &Path<Setup>| !matches!(p, Path::Arc(_));
    let cosine = dot(t1, t2);
    if cosine >= -1e-9 {
        // The tangents meet at P + r (n1 + n2) / (1 + n1 n2).
        let (n1, n2) = (normal(t1, offset.side), normal(t2, offset.side));
        let k = radius / (1.0 + cosine);
        let tip = [corner[0] + (n1[0] + n2[0]) * k, corner[1] + (n1[1] + n2[1]) * k];
        return Ok(match (straight(first), straight(second)) {
            (true, true) => Joint {
                end: tip,
                via: [None; 3],
            },
            (true, false) => Joint {
                end: tip,
                via: [Some(start), None, None],
            },
            (false, true) => Joint {
                end,
                via: [Some(tip), None, None],
            },
            (false, false) => Joint {
                end,
                via: [Some(tip), Some(start), None],
            },
        });
    }
    // On by the radius, across, and back by the radius; an arc has its own end, a line is lengthened.
    let past = [end[0] + t1[0] * radius, end[1] + t1[1] * radius];
    let ahead = [start[0] - t2[0] * radius, start[1] - t2[1] * radius];
    let last = (!straight(second)).then_some(start);
    Ok(match straight(first) {
        true => Joint {
            end: past,
            via: [Some(ahead), last, None],
        },
        false => Joint {
            end,
            via: [Some(past), Some(ahead), last],
        },
    })
}

/// Refuses an arc whose inner side is smaller than the tool.
fn check_arc(path: &Path<Setup>, offset: Offset) -> Outcome<()> {
    match path {
        Path::Arc(arc) if arc.radius() - offset.side * arc.sweep.0.signum() * offset.radius <= 1e-9 => Err(alarm(
            41,
            "compensation-interference",
            format!(
                "an arc of radius {:.4} mm is too small for a tool of radius {:.4} mm on its inner side",
                arc.radius(),
                offset.radius
            ),
            "use a smaller tool, or check the radius in the offset table",
        )),
        _ => Ok(()),
    }
}

/// An offset curve, as far as it takes to meet another.
#[derive(Clone, Copy)]
enum Curve {
    Line { through: V2, along: V2 },
    Circle { centre: V2, radius: f64 },
}

fn curve_of(path: &Path<Setup>, offset: Offset) -> Curve {
    let plane = offset.plane;
    match path {
        Path::Arc(arc) => {
            let [a, b, _] = plane.axes();
            Curve::Circle {
                centre: [arc.centre.xyz[a], arc.centre.xyz[b]],
                radius: arc.radius() - offset.side * arc.sweep.0.signum() * offset.radius,
            }
        }
        other => {
            let along = tangent(plane, other, 0.0);
            Curve::Line {
                through: beside(point(plane, other, 0.0), along, offset),
                along,
            }
        }
    }
}

/// The meeting point of two curves that is nearest to `corner`.
fn meeting(first: Curve, second: Curve, corner: V2) -> Option<V2> {
    let found: Vec<V2> = match (first, second) {
        (Curve::Line { through: p, along: d }, Curve::Line { through: q, along: e }) => {
            let turn = cross(d, e);
            if turn.abs() < 1e-12 {
                return None;
            }
            let k = cross(subtract(q, p), e) / turn;
            vec![[p[0] + d[0] * k, p[1] + d[1] * k]]
        }
        (Curve::Line { through, along }, Curve::Circle { centre, radius })
        | (Curve::Circle { centre, radius }, Curve::Line { through, along }) => line_and_circle(through, along, centre, radius),
        (Curve::Circle { centre: c1, radius: r1 }, Curve::Circle { centre: c2, radius: r2 }) => {
            let between = subtract(c2, c1);
            let apart = length(between);
            if apart < 1e-12 {
                return None;
            }
            let along = (apart * apart + r1 * r1 - r2 * r2) / (2.0 * apart);
            let square = r1 * r1 - along * along;
            let height = if square < -1e-9 {
                return None;
            } else {
                libm::sqrt(square.max(0.0))
            };
            let e = [between[0] / apart, between[1] / apart];
            [1.0, -1.0]
                .map(|s| {
                    [
                        c1[0] + e[0] * along - e[1] * height * s,
                        c1[1] + e[1] * along + e[0] * height * s,
                    ]
                })
                .to_vec()
        }
    };
    found
        .into_iter()
        .min_by(|p, q| length(subtract(*p, corner)).total_cmp(&length(subtract(*q, corner))))
}

/// Where a line meets a circle; none, one or two places.
pub(crate) fn line_and_circle(through: V2, along: V2, centre: V2, radius: f64) -> Vec<V2> {
    let k = dot(subtract(centre, through), along);
    let foot = [through[0] + along[0] * k, through[1] + along[1] * k];
    let square = radius * radius - dot(subtract(foot, centre), subtract(foot, centre));
    if square < -1e-9 {
        return Vec::new();
    }
    let half = libm::sqrt(square.max(0.0));
    [half, -half]
        .map(|h| [foot[0] + along[0] * h, foot[1] + along[1] * h])
        .to_vec()
}

fn point(plane: Plane, path: &Path<Setup>, u: f64) -> V2 {
    let [a, b, _] = plane.axes();
    let p = if u == 0.0 { path.start() } else { path.end() };
    [p.xyz[a], p.xyz[b]]
}

/// Direction in the plane, length 1.
fn tangent(plane: Plane, path: &Path<Setup>, u: f64) -> V2 {
    let [a, b, _] = plane.axes();
    let d = path.derivatives(u).0.xyz;
    let (x, y) = (d[a], d[b]);
    let l = libm::sqrt(x * x + y * y);
    if l > 0.0 { [x / l, y / l] } else { [0.0, 0.0] }
}

fn length_in(plane: Plane, path: &Path<Setup>) -> f64 {
    match path {
        Path::Arc(arc) => arc.radius() * arc.sweep.0.abs(),
        other => length(subtract(point(plane, other, 1.0), point(plane, other, 0.0))),
    }
}

fn normal(t: V2, side: f64) -> V2 {
    [-t[1] * side, t[0] * side]
}

/// The place of the centre square to a path through `p` in direction `t`.
fn beside(p: V2, t: V2, offset: Offset) -> V2 {
    let n = normal(t, offset.side);
    [p[0] + n[0] * offset.radius, p[1] + n[1] * offset.radius]
}

/// Angle from `from` to `to` about a centre, -PI to PI.
fn turned(centre: V2, from: V2, to: V2) -> f64 {
    let (f, t) = (subtract(from, centre), subtract(to, centre));
    let angle = libm::atan2(cross(f, t), dot(f, t));
    if angle > PI { angle - TAU } else { angle }
}

fn subtract(a: V2, b: V2) -> V2 {
    [a[0] - b[0], a[1] - b[1]]
}
fn dot(a: V2, b: V2) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
fn cross(a: V2, b: V2) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
fn length(v: V2) -> f64 {
    libm::sqrt(dot(v, v))
}
fn distance3(a: [f64; 3], b: [f64; 3]) -> f64 {
    Point::<Setup>::from_xyz(a).distance(Point::from_xyz(b))
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

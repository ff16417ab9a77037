//! Curves of toolpaths as [`plan::Path`]s, one at a time: a polyline of a million points is never a list of a million lines.
//!
//! Polylines with via points, trimmed lines, circles, ellipses and B-splines, composite curves, and B-splines of all four knot kinds,
//! rational or not. Lines and circles stay what they are; an ellipse becomes a rational B-spline, which is exact.
//!
//! A curve that does not fit together is a fault and not a repaired curve: an arc that misses its circle by more than
//! [`FIT_TOLERANCE`] would cut another shape. Smaller gaps come from rounded numbers and are closed by moving the centre.

mod arc;
mod spline;
mod trimmed;

use crate::aim::{Aim, Fault, text};
use crate::unit::ContextUnits;
use arc::{arc_through, distance_from_axis};
use part21::{Instance, Value};
use plan::{Arc, Path, Spline};
use std::f64::consts::{FRAC_PI_2, TAU};
use units::{Millimetres, Point, Radians, Setup, Transform, Vector};

/// Gaps up to this are rounding of the file's numbers (four decimals in inches give 0.0025 mm, three give 0.025 mm).
pub const FIT_TOLERANCE: Millimetres = Millimetres(0.03);

/// Points nearer than this are the same, mm.
const SAME: f64 = 1e-6;

/// Composite curves inside composite curves, at most.
const DEEPEST: usize = 16;

/// Pieces of one toolpath, at most, besides four for each instance of the file: nested composites can ask for more than anybody could mill.
const MOST_PIECES: u64 = 100_000;

type P = Point<Setup>;
type V = Vector<Setup>;

/// The pieces of a curve in the order in which the tool runs them.
pub(crate) struct Pieces<'f> {
    aim: Aim<'f>,
    state: PiecesState,
}

/// How far [`Pieces`] have come; borrows nothing, so that a stream can keep it.
#[derive(Clone)]
pub(crate) struct PiecesState {
    units: ContextUnits,
    stack: Vec<Item>,
    last_end: Option<P>,
    count: u64,
}

#[derive(Clone)]
enum Item {
    Curve {
        id: u64,
        reversed: bool,
    },
    Polyline {
        curve: u64,
        points: Vec<u64>,
        next: usize,
        /// Where `points[next]` is, once it was read as the end of the piece before.
        reached: Option<P>,
    },
    Composite {
        segments: Vec<u64>,
        next: usize,
        reversed: bool,
    },
}

impl<'f> Pieces<'f> {
    pub(crate) fn new(aim: Aim<'f>, curve: u64, units: ContextUnits, reversed: bool) -> Self {
        Self {
            aim,
            state: PiecesState {
                units,
                stack: vec![Item::Curve { id: curve, reversed }],
                last_end: None,
                count: 0,
            },
        }
    }

    /// Goes on where [`Pieces::into_state`] left off.
    pub(crate) fn resume(aim: Aim<'f>, state: PiecesState) -> Self {
        Self { aim, state }
    }

    pub(crate) fn into_state(self) -> PiecesState {
        self.state
    }

    fn step(&mut self) -> Option<Result<Path<Setup>, Fault>> {
        loop {
            match self.state.stack.last_mut()? {
                Item::Polyline {
                    curve,
                    points,
                    next,
                    reached,
                } => {
                    let (curve, from, reached) = (*curve, *next, *reached);
                    let Some(after) = points.get(from + 1..).filter(|rest| !rest.is_empty()) else {
                        self.state.stack.pop();
                        continue;
                    };
                    let via = after.iter().take_while(|&&point| is_via(self.aim, point)).count();
                    let Some(&end) = after.get(via) else {
                        self.state.stack.pop();
                        return Some(Err(Fault::new(
                            curve,
                            "via-point",
                            "a via point ends the polyline",
                            VIA_REMEDY,
                        )));
                    };
                    let group: Vec<u64> = after[..via].to_vec();
                    let start = points[from];
                    *next = from + via + 1;
                    let ends = match reached {
                        Some(place) => Ok(place),
                        None => self.point(start),
                    };
                    let ends = ends.and_then(|from| Ok((from, self.point(end)?)));
                    let (from, to) = match ends {
                        Ok(ends) => ends,
                        Err(fault) => return Some(Err(fault)),
                    };
                    if let Some(Item::Polyline { reached, .. }) = self.state.stack.last_mut() {
                        *reached = Some(to);
                    }
                    match self.span(curve, from, &group, to) {
                        Ok(Some(path)) => return Some(Ok(path)),
                        Ok(None) => {}
                        Err(fault) => return Some(Err(fault)),
                    }
                }
                Item::Composite {
                    segments,
                    next,
                    reversed,
                } => {
                    let reversed = *reversed;
                    let Some(&segment) = segments.get(*next) else {
                        self.state.stack.pop();
                        continue;
                    };
                    *next += 1;
                    let instance = match self.aim.instance(segment) {
                        Ok(instance) => instance,
                        Err(fault) => return Some(Err(fault)),
                    };
                    let (same_sense, curve) = (instance.argument(1).boolean(), instance.argument(2).reference());
                    let Some(curve) = curve else {
                        return Some(Err(Fault::new(
                            segment,
                            "composite-segment",
                            "the segment has no curve",
                            CURVE_REMEDY,
                        )));
                    };
                    if self.state.stack.len() >= DEEPEST {
                        return Some(Err(Fault::new(
                            curve,
                            "curve-nesting",
                            "composite curves are nested too deep",
                            CURVE_REMEDY,
                        )));
                    }
                    let against = same_sense == Some(false);
                    self.state.stack.push(Item::Curve {
                        id: curve,
                        reversed: reversed != against,
                    });
                }
                Item::Curve { id, reversed } => {
                    let (id, reversed) = (*id, *reversed);
                    self.state.stack.pop();
                    match self.open(id, reversed) {
                        Ok(Some(path)) => return Some(Ok(path)),
                        Ok(None) => {}
                        Err(fault) => return Some(Err(fault)),
                    }
                }
            }
        }
    }

    /// Puts a list-like curve on the stack, or gives the path of a single one.
    fn open(&mut self, id: u64, reversed: bool) -> Result<Option<Path<Setup>>, Fault> {
        let instance = self.aim.instance(id)?;
        let kind = self.aim.keyword(id);
        match kind {
            "POLYLINE" => {
                let mut points: Vec<u64> = instance.argument(1).references().collect();
                if points.len() < 2 {
                    return Err(Fault::new(id, "polyline", "a polyline needs two points", CURVE_REMEDY));
                }
                if points.first().is_some_and(|&point| is_via(self.aim, point)) {
                    return Err(Fault::new(id, "via-point", "a via point begins the polyline", VIA_REMEDY));
                }
                if reversed {
                    points.reverse();
                }
                self.state.stack.push(Item::Polyline {
                    curve: id,
                    points,
                    next: 0,
                    reached: None,
                });
                Ok(None)
            }
            "COMPOSITE_CURVE" => {
                let mut segments: Vec<u64> = instance.argument(1).references().collect();
                if segments.is_empty() {
                    return Err(Fault::new(
                        id,
                        "composite-segment",
                        "a composite curve has no segments",
                        CURVE_REMEDY,
                    ));
                }
                if reversed {
                    segments.reverse();
                }
                self.state.stack.push(Item::Composite {
                    segments,
                    next: 0,
                    reversed,
                });
                Ok(None)
            }
            _ => {
                let path = self.single(id, &instance)?;
                if !path.is_sound() {
                    return Err(Fault::new(
                        id,
                        "curve-numbers",
                        format!("the numbers of this {kind} do not fit together"),
                        CURVE_REMEDY,
                    ));
                }
                Ok(Some(if reversed { path.reversed() } else { path }))
            }
        }
    }

    fn single(&self, id: u64, instance: &Instance) -> Result<Path<Setup>, Fault> {
        if self.aim.keyword(id) == "TRIMMED_CURVE" {
            return self.trimmed(id, instance);
        }
        match self.spline(id, instance)? {
            Some(spline) => Ok(Path::Spline(spline)),
            None => Err(Fault::new(
                id,
                "curve-kind",
                format!("a toolpath cannot run along a {}", self.aim.keyword(id)),
                "use a polyline, a trimmed curve, a composite curve or a B-spline",
            )),
        }
    }

    pub(crate) fn point(&self, id: u64) -> Result<P, Fault> {
        point(self.aim, id, self.state.units.millimetres)
    }

    /// The piece of a polyline from one point over via points to the next.
    fn span(&self, curve: u64, from: P, via: &[u64], to: P) -> Result<Option<Path<Setup>>, Fault> {
        let line = Path::Line { from, to };
        let mut places = Vec::with_capacity(via.len());
        for &id in via {
            let place = self.point(id)?;
            if place.distance(from) > SAME && place.distance(to) > SAME {
                places.push(place);
            }
        }
        // Via points that coincide with a neighbour mean straight (ISO 10303-238, 5.2.4.1).
        if places.is_empty() {
            return Ok((from.distance(to) > 0.0).then_some(line));
        }
        let helix = via.iter().any(|&id| self.aim.keyword(id) == "VIA_HELIX_POINT");
        let arc = if helix {
            // The text gives no axis; "when projected to the plane" is read as the XY plane of the path.
            let flat = |p: P| Point::new(p.xyz[0], p.xyz[1], from.xyz[2]);
            let flat_places: Vec<P> = places.iter().copied().map(flat).collect();
            arc_through(from, &flat_places, flat(to)).map(|arc| Arc {
                normal: if arc.normal.xyz[2] < 0.0 { -arc.normal } else { arc.normal },
                sweep: if arc.normal.xyz[2] < 0.0 { -arc.sweep } else { arc.sweep },
                rise: to.xyz[2] - from.xyz[2],
                ..arc
            })
        } else {
            arc_through(from, &places, to)
        };
        match arc {
            Some(arc) => {
                let path = Path::Arc(arc);
                let off = |place: &P| distance_from_axis(&arc, *place) - arc.radius();
                if let Some(worst) = places.iter().map(|place| off(place).abs()).reduce(f64::max)
                    && worst > FIT_TOLERANCE.0
                {
                    return Err(Fault::new(
                        curve,
                        "via-point",
                        format!("the via points of one arc do not lie on one circle: {worst:.4} mm off"),
                        VIA_REMEDY,
                    ));
                }
                Ok(Some(path))
            }
            None if helix => Err(Fault::new(
                curve,
                "via-point",
                "a helix needs points that do not lie above a line",
                VIA_REMEDY,
            )),
            None if from.distance(to) <= SAME => Err(Fault::new(
                curve,
                "via-point",
                "a full circle needs two via points: one does not say in which plane it lies",
                VIA_REMEDY,
            )),
            None => {
                // Three points on a line: straight, when the via point lies between.
                let along = (to - from).unit().unwrap_or(Vector::X);
                let beyond = |place: &P| {
                    let s = (*place - from).dot(along);
                    s < -SAME || s > from.distance(to) + SAME
                };
                if places.iter().any(beyond) {
                    return Err(Fault::new(
                        curve,
                        "via-point",
                        "a via point lies on the line of its arc's ends, outside of them",
                        VIA_REMEDY,
                    ));
                }
                Ok(Some(line))
            }
        }
    }
}

impl Iterator for Pieces<'_> {
    type Item = Result<Path<Setup>, Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut piece = self.step()?;
        self.state.count += 1;
        if self.state.count > MOST_PIECES + 4 * self.aim.file.len() as u64 {
            self.state.stack.clear();
            return Some(Err(Fault::new(
                0,
                "curve-nesting",
                "composite curves repeat their parts over and over: the curve has more pieces than the file could tell",
                CURVE_REMEDY,
            )));
        }
        if let Ok(path) = &mut piece {
            if !path.is_sound() {
                piece = Err(Fault::new(
                    0,
                    "curve-numbers",
                    "a coordinate is no finite number",
                    CURVE_REMEDY,
                ));
            } else {
                if let Some(end) = self.state.last_end {
                    let gap = end.distance(path.start());
                    if gap > FIT_TOLERANCE.0 {
                        self.state.stack.clear();
                        return Some(Err(Fault::new(
                            0,
                            "curve-gap",
                            format!("the pieces of the curve do not meet: a gap of {gap:.4} mm"),
                            CURVE_REMEDY,
                        )));
                    }
                    if let Path::Line { from, .. } = path {
                        *from = end;
                    }
                }
                self.state.last_end = Some(path.end());
            }
        }
        if piece.is_err() {
            self.state.stack.clear();
        }
        Some(piece)
    }
}

const CURVE_REMEDY: &str = "correct the curve in the CAM system and export again";
const VIA_REMEDY: &str = "place via points between two points of the polyline, on the arc";

fn is_via(aim: Aim, point: u64) -> bool {
    matches!(aim.keyword(point), "VIA_ARC_POINT" | "VIA_HELIX_POINT")
}

/// The place of a cartesian point, mm.
pub(crate) fn point(aim: Aim, id: u64, millimetres: f64) -> Result<P, Fault> {
    let instance = aim.instance(id)?;
    let coordinates = instance.argument(1).items();
    let at = |n: usize| coordinates.get(n).and_then(Value::number).map(|c| c * millimetres);
    match (at(0), at(1), at(2), coordinates.len()) {
        (Some(x), Some(y), Some(z), 3) => Ok(Point::new(x, y, z)),
        _ => Err(Fault::new(
            id,
            "point",
            format!("{} is no point with three coordinates", aim.keyword(id)),
            CURVE_REMEDY,
        )),
    }
}

/// A direction; `None` for `$`.
fn direction(aim: Aim, value: &Value) -> Result<Option<V>, Fault> {
    let Some(id) = value.reference() else { return Ok(None) };
    let instance = aim.instance(id)?;
    let ratios = instance.argument(1).items();
    let at = |n: usize| ratios.get(n).and_then(Value::number).unwrap_or(0.0);
    let direction = Vector::new(at(0), at(1), at(2)).unit();
    direction
        .map(Some)
        .ok_or_else(|| Fault::new(id, "direction", "a direction has no length", CURVE_REMEDY))
}

/// What an axis placement does: takes its own coordinates into the frame it is written in.
pub(crate) fn placement(aim: Aim, id: u64, millimetres: f64) -> Result<Transform<Setup, Setup>, Fault> {
    let instance = aim.instance(id)?;
    let missing = || {
        Fault::new(
            id,
            "placement",
            "an axis placement has no location or its axis no direction",
            CURVE_REMEDY,
        )
    };
    let location = instance.argument(1).reference().ok_or_else(missing)?;
    let origin = point(aim, location, millimetres)?;
    let axis = direction(aim, instance.argument(2))?.unwrap_or(Vector::Z);
    let reference = direction(aim, instance.argument(3))?.unwrap_or(Vector::X);
    let frame = Transform::from_axes(origin, axis, reference).ok_or_else(missing)?;
    if frame.origin.iter().all(|c| c.is_finite()) {
        Ok(frame)
    } else {
        Err(missing())
    }
}

/// True for an instance that places axes.
pub(crate) fn is_placement(aim: Aim, id: u64) -> bool {
    aim.keyword(id) == "AXIS2_PLACEMENT_3D"
}

/// The numbers of a one-dimensional polyline or B-spline: the feed multiplier along a path.
///
/// Spread evenly over the path: the standard says along which curve they lie and not by which parameter.
pub(crate) fn numbers_along(aim: Aim, id: u64) -> Result<Vec<f64>, Fault> {
    let instance = aim.instance(id)?;
    let points: Vec<u64> = match &instance {
        Instance::Simple(record) => {
            let list = record
                .arguments
                .iter()
                .find(|argument| argument.references().next().is_some());
            list.map(Value::references).into_iter().flatten().collect()
        }
        Instance::Complex(_) => {
            let poles = instance.part("B_SPLINE_CURVE").and_then(|arguments| arguments.get(1));
            poles.map(Value::references).into_iter().flatten().collect()
        }
    };
    let numbers: Result<Vec<f64>, Fault> = points
        .into_iter()
        .map(|id| {
            let point = aim.instance(id)?;
            let number = point.argument(1).items().first().and_then(Value::number);
            let number = number.filter(|number| *number > 0.0 && number.is_finite());
            number.ok_or_else(|| {
                Fault::new(
                    id,
                    "speed-profile",
                    "a feed multiplier is not above 0",
                    "correct the speed profile",
                )
            })
        })
        .collect();
    let numbers = numbers?;
    if numbers.is_empty() {
        let name = text(instance.argument(0)).into_owned();
        return Err(Fault::new(
            id,
            "speed-profile",
            format!("the speed curve {name:?} has no points"),
            "correct the speed profile",
        ));
    }
    Ok(numbers)
}

/// Is a tool axis anything but +Z? Only polylines are looked into; another curve of axes is taken for tilted.
pub(crate) fn is_tilted(aim: Aim, curve: u64) -> bool {
    let upright = |id: u64| {
        let axis = point(aim, id, 1.0).ok().map(|axis| axis.xyz);
        axis.is_some_and(|[i, j, k]| k > 0.0 && i.abs() <= 1e-9 * k && j.abs() <= 1e-9 * k)
    };
    let Ok(instance) = aim.instance(curve) else { return true };
    aim.keyword(curve) != "POLYLINE" || !instance.argument(1).references().all(upright)
}

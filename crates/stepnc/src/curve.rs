//! Curves of toolpaths as [`plan::Path`]s, one at a time: a polyline of a million points is never a list of a million lines.
//!
//! Polylines with via points, trimmed lines, circles, ellipses and B-splines, composite curves, and B-splines of all four knot kinds,
//! rational or not. Lines and circles stay what they are; an ellipse becomes a rational B-spline, which is exact.
//!
//! A curve that does not fit together is a fault and not a repaired curve: an arc that misses its circle by more than
//! [`FIT_TOLERANCE`] would cut another shape. Smaller gaps come from rounded numbers and are closed by moving the centre.

use crate::aim::{Aim, Fault, text};
use crate::unit::ContextUnits;
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

/// Pieces of one toolpath, at most: a file of nested composites can ask for more than anybody could mill.
const MOST_PIECES: u64 = 50_000_000;

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
                Item::Polyline { curve, points, next } => {
                    let (curve, from) = (*curve, *next);
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
                    match self.span(curve, start, &group, end) {
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
    fn span(&self, curve: u64, start: u64, via: &[u64], end: u64) -> Result<Option<Path<Setup>>, Fault> {
        let (from, to) = (self.point(start)?, self.point(end)?);
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

    fn trimmed(&self, id: u64, instance: &Instance) -> Result<Path<Setup>, Fault> {
        let fault = |code, message: String| Fault::new(id, code, message, CURVE_REMEDY);
        let Some(basis) = instance.argument(1).reference() else {
            return Err(fault("trimmed-curve", "a trimmed curve has no basis curve".into()));
        };
        let sense = instance.argument(4).boolean().unwrap_or(true);
        let first = self.trim(id, instance.argument(2))?;
        let second = self.trim(id, instance.argument(3))?;
        let base = self.aim.instance(basis)?;
        match self.aim.keyword(basis) {
            "LINE" => {
                let origin = self.reference_point(basis, base.argument(1))?;
                let vector = base
                    .argument(2)
                    .reference()
                    .ok_or_else(|| fault("trimmed-curve", "the line has no vector".into()))?;
                let vector = self.aim.instance(vector)?;
                let magnitude = vector.argument(2).number().unwrap_or(1.0) * self.state.units.millimetres;
                let direction = self.direction(vector.argument(1))?.unwrap_or(Vector::X);
                let place = |trim: Trim| match trim {
                    Trim::At(place) => place,
                    Trim::Parameter(t) => origin + direction * (t * magnitude),
                };
                Ok(Path::Line {
                    from: place(first),
                    to: place(second),
                })
            }
            "CIRCLE" => {
                let frame = self.placement(base.argument(1))?;
                let radius = self.length(basis, base.argument(2), "the radius")?;
                let place = |trim: Trim| -> Result<P, Fault> {
                    Ok(match trim {
                        Trim::At(place) => place,
                        Trim::Parameter(t) => {
                            let (sin, cos) = libm::sincos(self.angle(id, t)?);
                            frame * Point::new(radius * cos, radius * sin, 0.0)
                        }
                    })
                };
                let full = matches!((first, second), (Trim::Parameter(a), Trim::Parameter(b)) if a != b
                    && (self.angle(id, (b - a).abs())? - TAU).abs() < 1e-9);
                circle_arc(id, &frame, radius, place(first)?, place(second)?, sense, full)
            }
            "ELLIPSE" => {
                let frame = self.placement(base.argument(1))?;
                let a = self.length(basis, base.argument(2), "the first half axis")?;
                let b = self.length(basis, base.argument(3), "the second half axis")?;
                let here_from_setup = frame.inverse();
                let angle = |trim: Trim| -> Result<f64, Fault> {
                    match trim {
                        Trim::Parameter(t) => self.angle(id, t),
                        Trim::At(place) => {
                            let [x, y, z] = (here_from_setup * place).xyz;
                            let t = libm::atan2(y / b, x / a);
                            let (sin, cos) = libm::sincos(t);
                            let off = Point::<Setup>::new(a * cos, b * sin, 0.0).distance(Point::new(x, y, z));
                            if off > FIT_TOLERANCE.0 {
                                return Err(fault("ellipse-fit", format!("a trim point lies {off:.4} mm off its ellipse")));
                            }
                            Ok(t)
                        }
                    }
                };
                let (from, to) = (angle(first)?, angle(second)?);
                let mut sweep = libm::fmod(to - from, TAU);
                if sense && sweep <= 1e-9 {
                    sweep += TAU;
                } else if !sense && sweep >= -1e-9 {
                    sweep -= TAU;
                }
                Ok(Path::Spline(ellipse(&frame, a, b, from, sweep)))
            }
            kind => {
                let Some(spline) = self.spline(basis, &base)? else {
                    return Err(Fault::new(
                        id,
                        "curve-kind",
                        format!("a toolpath cannot run along a trimmed {kind}"),
                        "trim a line, a circle, an ellipse or a B-spline",
                    ));
                };
                if !spline.is_sound() {
                    return Err(fault(
                        "curve-numbers",
                        "the numbers of the basis spline do not fit together".into(),
                    ));
                }
                let (low, high) = (spline.knots[spline.degree], spline.knots[spline.poles.len()]);
                let parameter = |trim: Trim| match trim {
                    Trim::Parameter(t) => Ok(t.clamp(low, high)),
                    Trim::At(place) => nearest_parameter(&spline, place)
                        .map(|u| low + u * (high - low))
                        .ok_or_else(|| fault("spline-fit", "a trim point does not lie on its spline".into())),
                };
                let (from, to) = (parameter(first)?, parameter(second)?);
                let part = sub_spline(&spline, from.min(to), from.max(to))
                    .ok_or_else(|| fault("trimmed-curve", "the trimmed part of the spline is empty".into()))?;
                let path = Path::Spline(part);
                Ok(if from > to { path.reversed() } else { path })
            }
        }
    }

    fn trim(&self, id: u64, value: &Value) -> Result<Trim, Fault> {
        if let Some(point) = value.references().next() {
            return Ok(Trim::At(self.point(point)?));
        }
        let parameter = value.items().iter().find_map(Value::number);
        parameter.map(Trim::Parameter).ok_or_else(|| {
            Fault::new(
                id,
                "trimmed-curve",
                "a trim has neither a point nor a parameter",
                CURVE_REMEDY,
            )
        })
    }

    /// An angle in radians, given in the unit of the context.
    fn angle(&self, id: u64, angle: f64) -> Result<f64, Fault> {
        let radians = self.state.units.radians.ok_or_else(|| {
            Fault::new(
                id,
                "no-angle-unit",
                "an angle stands in a context without an angle unit",
                "give the context an angle unit, or trim by points",
            )
        })?;
        Ok(angle * radians)
    }

    fn length(&self, id: u64, value: &Value, what: &str) -> Result<f64, Fault> {
        let length = value.number().unwrap_or(0.0) * self.state.units.millimetres;
        if length > 0.0 && length.is_finite() {
            return Ok(length);
        }
        Err(Fault::new(
            id,
            "curve-numbers",
            format!("{what} is not above 0"),
            CURVE_REMEDY,
        ))
    }

    fn reference_point(&self, id: u64, value: &Value) -> Result<P, Fault> {
        let point = value.reference();
        self.point(point.ok_or_else(|| Fault::new(id, "point", "a point is missing", CURVE_REMEDY))?)
    }

    fn direction(&self, value: &Value) -> Result<Option<V>, Fault> {
        direction(self.aim, value)
    }

    fn placement(&self, value: &Value) -> Result<Transform<Setup, Setup>, Fault> {
        let id = value.reference();
        let id = id.ok_or_else(|| Fault::new(0, "placement", "a placement is missing", CURVE_REMEDY))?;
        placement(self.aim, id, self.state.units.millimetres)
    }

    /// The B-spline that an instance is; `None` when it is another curve.
    fn spline(&self, id: u64, instance: &Instance) -> Result<Option<Spline<Setup>>, Fault> {
        const KINDS: [&str; 4] = [
            "B_SPLINE_CURVE_WITH_KNOTS",
            "BEZIER_CURVE",
            "UNIFORM_CURVE",
            "QUASI_UNIFORM_CURVE",
        ];
        let Some(kind) = KINDS.into_iter().find(|kind| self.aim.is(id, kind)) else {
            return Ok(None);
        };
        // Simple: name, degree, poles, form, closed, self intersect [, multiplicities, knots, spec]; complex: parts without the name.
        let (base, knots): (&[Value], &[Value]) = match instance {
            Instance::Simple(record) => (
                record.arguments.get(1..).unwrap_or(&[]),
                record.arguments.get(6..).unwrap_or(&[]),
            ),
            Instance::Complex(_) => (
                instance.part("B_SPLINE_CURVE").unwrap_or(&[]),
                instance.part("B_SPLINE_CURVE_WITH_KNOTS").unwrap_or(&[]),
            ),
        };
        let fault = |message: &str| Fault::new(id, "spline", message, CURVE_REMEDY);
        let degree = base.first().and_then(Value::number).unwrap_or(0.0);
        if !(1.0..=25.0).contains(&degree) {
            return Err(fault("the degree of a B-spline must be 1 to 25"));
        }
        let degree = degree as usize;
        let poles = base.get(1).map(Value::references).into_iter().flatten();
        let poles: Vec<P> = poles.map(|pole| self.point(pole)).collect::<Result<_, _>>()?;
        let count = poles.len();
        if count <= degree {
            return Err(fault("a B-spline needs more control points than its degree"));
        }
        let spread = |multiplicities: &[usize], values: &[f64]| -> Vec<f64> {
            let pairs = multiplicities.iter().zip(values);
            pairs.flat_map(|(&times, &value)| std::iter::repeat_n(value, times)).collect()
        };
        let knots = match kind {
            "BEZIER_CURVE" => {
                if !(count - 1).is_multiple_of(degree) {
                    return Err(fault("the control points of a Bezier curve do not make whole segments"));
                }
                let segments = (count - 1) / degree;
                let times: Vec<usize> = (0..=segments)
                    .map(|k| if k == 0 || k == segments { degree + 1 } else { degree })
                    .collect();
                spread(&times, &(0..=segments).map(|k| k as f64).collect::<Vec<_>>())
            }
            "UNIFORM_CURVE" => (0..count + degree + 1).map(|k| k as f64 - degree as f64).collect(),
            "QUASI_UNIFORM_CURVE" => {
                let spans = count - degree;
                let times: Vec<usize> = (0..=spans)
                    .map(|k| if k == 0 || k == spans { degree + 1 } else { 1 })
                    .collect();
                spread(&times, &(0..=spans).map(|k| k as f64).collect::<Vec<_>>())
            }
            _ => {
                let times = knots
                    .first()
                    .map_or(&[][..], Value::items)
                    .iter()
                    .map(|m| m.number().unwrap_or(0.0));
                let times: Vec<usize> = times.map(|m| m.clamp(0.0, 1000.0) as usize).collect();
                let values: Vec<f64> = knots
                    .get(1)
                    .map_or(&[][..], Value::items)
                    .iter()
                    .filter_map(Value::number)
                    .collect();
                if times.len() != values.len()
                    || times.iter().try_fold(0usize, |sum, &m| sum.checked_add(m)) != Some(count + degree + 1)
                {
                    return Err(fault(
                        "multiplicities, knots and control points of a B-spline do not fit together",
                    ));
                }
                spread(&times, &values)
            }
        };
        let weights = instance
            .part("RATIONAL_B_SPLINE_CURVE")
            .and_then(|arguments| arguments.first());
        let weights: Vec<f64> = weights
            .map_or(&[][..], Value::items)
            .iter()
            .filter_map(Value::number)
            .collect();
        Ok(Some(Spline {
            degree,
            poles,
            weights,
            knots,
        }))
    }
}

impl Iterator for Pieces<'_> {
    type Item = Result<Path<Setup>, Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut piece = self.step()?;
        self.state.count += 1;
        if self.state.count > MOST_PIECES {
            self.state.stack.clear();
            return None;
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

#[derive(Clone, Copy)]
enum Trim {
    At(P),
    Parameter(f64),
}

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

/// The arc from `a` over the via points to `c`; the full circle when `a` and `c` coincide. `None` when they lie on a line.
fn arc_through(a: P, via: &[P], c: P) -> Option<Arc<Setup>> {
    let full = a.distance(c) <= SAME;
    let b = *via.get(via.len() / 2)?;
    let third = if full {
        *via.iter().find(|place| place.distance(b) > SAME)?
    } else {
        c
    };
    // Order along the arc: for a full circle the two via points in file order, else via and end.
    let (b, d) = if full { (third, b) } else { (b, third) };
    let (u, v) = (b - a, d - a);
    let normal = u.cross(v);
    let size = normal.dot(normal);
    let flat = u.length() * v.length();
    if libm::sqrt(size) <= 1e-9 * flat || size == 0.0 {
        return None;
    }
    // Circumcentre of a, b, d.
    let centre = a + (normal.cross(u) * v.dot(v) - normal.cross(v) * u.dot(u)) * (0.5 / size);
    let normal = normal.unit()?;
    let sweep = if full {
        TAU
    } else {
        angle_between(a - centre, c - centre, normal)
    };
    Some(Arc {
        from: a,
        centre,
        normal,
        sweep: Radians(sweep),
        rise: 0.0,
    })
}

/// Counterclockwise angle from `a` to `b` about `normal`, in (0, 2 pi].
fn angle_between(a: V, b: V, normal: V) -> f64 {
    let angle = libm::atan2(normal.dot(a.cross(b)), a.dot(b));
    if angle <= 0.0 { angle + TAU } else { angle }
}

fn distance_from_axis(arc: &Arc<Setup>, place: P) -> f64 {
    let out = place - arc.centre;
    (out - arc.normal * out.dot(arc.normal)).length()
}

fn circle_arc(
    id: u64,
    frame: &Transform<Setup, Setup>,
    radius: f64,
    from: P,
    to: P,
    sense: bool,
    full: bool,
) -> Result<Path<Setup>, Fault> {
    let centre = Point::from_xyz(frame.origin);
    let normal = *frame * Vector::<Setup>::Z;
    for (place, which) in [(from, "first"), (to, "second")] {
        let out = place - centre;
        let height = out.dot(normal);
        let off = libm::sqrt({
            let miss = (out - normal * height).length() - radius;
            miss * miss + height * height
        });
        if off.is_nan() || off > FIT_TOLERANCE.0 {
            return Err(Fault::new(
                id,
                "arc-radius",
                format!(
                    "the {which} trim point of an arc is {:.4} mm from the centre in a circle of radius {radius:.4} mm: {off:.4} mm off",
                    out.length()
                ),
                "correct centre, radius or end points; the tolerance is 0.03 mm",
            ));
        }
    }
    let full = full || from.distance(to) <= SAME;
    // Rounded end points: move the centre along the chord so that both lie on one circle, and into the plane of the start.
    let mut middle = centre + normal * (from - centre).dot(normal);
    let rise = if full { 0.0 } else { (to - from).dot(normal) };
    if !full && let Some(along) = (to - from - normal * rise).unit() {
        middle = middle + along * (from.toward(to, 0.5) - middle).dot(along);
    }
    let end = to - normal * rise;
    let sweep = match (full, sense) {
        (true, true) => TAU,
        (true, false) => -TAU,
        (false, true) => angle_between(from - middle, end - middle, normal),
        (false, false) => -angle_between(end - middle, from - middle, normal),
    };
    Ok(Path::Arc(Arc {
        from,
        centre: middle,
        normal,
        sweep: Radians(sweep),
        rise,
    }))
}

/// Part of an ellipse as a rational quadratic B-spline: each piece of at most a quarter is the affine image of a circle's.
fn ellipse(frame: &Transform<Setup, Setup>, a: f64, b: f64, from: f64, sweep: f64) -> Spline<Setup> {
    let pieces = (libm::ceil(sweep.abs() / FRAC_PI_2 - 1e-9) as usize).max(1);
    let half = sweep / pieces as f64 / 2.0;
    let weight = libm::cos(half);
    let place = |t: f64, scale: f64| {
        let (sin, cos) = libm::sincos(t);
        *frame * Point::new(a * cos * scale, b * sin * scale, 0.0)
    };
    let mut poles = vec![place(from, 1.0)];
    let mut weights = vec![1.0];
    let mut knots = vec![0.0; 3];
    for piece in 0..pieces {
        let start = from + half * 2.0 * piece as f64;
        poles.push(place(start + half, 1.0 / weight));
        poles.push(place(start + half * 2.0, 1.0));
        weights.extend([weight, 1.0]);
        let knot = (piece + 1) as f64;
        knots.extend(if piece + 1 == pieces { vec![knot; 3] } else { vec![knot; 2] });
    }
    Spline {
        degree: 2,
        poles,
        weights,
        knots,
    }
}

/// The parameter (0 to 1) at which a spline is at `place`, or `None` when it is nowhere within [`FIT_TOLERANCE`].
fn nearest_parameter(spline: &Spline<Setup>, place: P) -> Option<f64> {
    let path = Path::Spline(spline.clone());
    let probes = 32 * (spline.poles.len() - spline.degree).min(2000);
    let far = |u: f64| path.at(u).distance(place);
    let best = (0..=probes)
        .map(|k| k as f64 / probes as f64)
        .min_by(|a, b| far(*a).total_cmp(&far(*b)))?;
    // Golden section around the best probe.
    let (mut low, mut high) = ((best - 1.0 / probes as f64).max(0.0), (best + 1.0 / probes as f64).min(1.0));
    for _ in 0..60 {
        let (m1, m2) = (low + (high - low) * 0.382, low + (high - low) * 0.618);
        if far(m1) <= far(m2) {
            high = m2;
        } else {
            low = m1;
        }
    }
    let found = (low + high) / 2.0;
    let candidates = [0.0, 1.0, found];
    let nearest = candidates.into_iter().min_by(|a, b| far(*a).total_cmp(&far(*b)))?;
    (far(nearest) <= FIT_TOLERANCE.0).then_some(nearest)
}

/// The part of a spline between two knot values, by inserting knots until both have full multiplicity (The NURBS Book, 5.2).
fn sub_spline(spline: &Spline<Setup>, low: f64, high: f64) -> Option<Spline<Setup>> {
    let p = spline.degree;
    if high - low <= 1e-12 * (spline.knots[spline.poles.len()] - spline.knots[p]) {
        return None;
    }
    let mut knots = spline.knots.clone();
    let mut poles: Vec<[f64; 4]> = spline
        .poles
        .iter()
        .enumerate()
        .map(|(n, pole)| {
            let w = spline.weights.get(n).copied().unwrap_or(1.0);
            [pole.xyz[0] * w, pole.xyz[1] * w, pole.xyz[2] * w, w]
        })
        .collect();
    for t in [low, high] {
        while knots.iter().filter(|knot| **knot == t).count() < p {
            let span = knots
                .partition_point(|knot| *knot <= t)
                .saturating_sub(1)
                .clamp(p, poles.len() - 1);
            let mut fresh = Vec::with_capacity(poles.len() + 1);
            for n in 0..=poles.len() {
                let pole = if n + p <= span {
                    poles[n]
                } else if n > span {
                    poles[n - 1]
                } else {
                    let width = knots[n + p] - knots[n];
                    let share = if width > 0.0 { (t - knots[n]) / width } else { 0.0 };
                    std::array::from_fn(|c| poles[n - 1][c] * (1.0 - share) + poles[n][c] * share)
                };
                fresh.push(pole);
            }
            poles = fresh;
            knots.insert(span + 1, t);
        }
    }
    // The first pole of the part is the one that the curve passes at `low`.
    let first = knots.partition_point(|knot| *knot <= low).checked_sub(p + 1)?;
    let last = knots.partition_point(|knot| *knot < high).checked_sub(1)?;
    let poles = poles.get(first..=last)?.to_vec();
    let mut part_knots = vec![low; p + 1];
    part_knots.extend(knots.iter().filter(|knot| **knot > low && **knot < high));
    part_knots.extend(vec![high; p + 1]);
    let rational = !spline.weights.is_empty();
    let part = Spline {
        degree: p,
        poles: poles
            .iter()
            .map(|h| Point::new(h[0] / h[3], h[1] / h[3], h[2] / h[3]))
            .collect(),
        weights: if rational {
            poles.iter().map(|h| h[3]).collect()
        } else {
            Vec::new()
        },
        knots: part_knots,
    };
    part.is_sound().then_some(part)
}

//! Trimmed curves: parts of lines, circles, ellipses and B-splines.

use super::arc::{circle_arc, helix};
use super::spline::{ellipse, nearest_parameter, sub_spline};
use super::*;

#[derive(Clone, Copy)]
pub(super) enum Trim {
    At(P),
    Parameter(f64),
}

impl Pieces<'_> {
    pub(super) fn trimmed(&self, id: u64, instance: &Instance) -> Result<Path<Setup>, Fault> {
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
            // ISO 14649: position, radius and the height of one turn.
            "HELIX" => {
                let frame = self.placement(base.argument(1))?;
                let radius = self.length(basis, base.argument(2), "the radius")?;
                let pitch = self.length(basis, base.argument(3), "the pitch")?;
                let place = |trim: Trim| -> Result<P, Fault> {
                    Ok(match trim {
                        Trim::At(place) => place,
                        Trim::Parameter(t) => {
                            let angle = self.angle(id, t)?;
                            let (sin, cos) = libm::sincos(angle);
                            frame * Point::new(radius * cos, radius * sin, pitch * angle / TAU)
                        }
                    })
                };
                helix(id, &frame, radius, pitch, place(first)?, place(second)?, sense)
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

    pub(super) fn trim(&self, id: u64, value: &Value) -> Result<Trim, Fault> {
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
    pub(super) fn angle(&self, id: u64, angle: f64) -> Result<f64, Fault> {
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

    pub(super) fn length(&self, id: u64, value: &Value, what: &str) -> Result<f64, Fault> {
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

    pub(super) fn reference_point(&self, id: u64, value: &Value) -> Result<P, Fault> {
        let point = value.reference();
        self.point(point.ok_or_else(|| Fault::new(id, "point", "a point is missing", CURVE_REMEDY))?)
    }

    pub(super) fn direction(&self, value: &Value) -> Result<Option<V>, Fault> {
        direction(self.aim, value)
    }

    pub(super) fn placement(&self, value: &Value) -> Result<Transform<Setup, Setup>, Fault> {
        let id = value.reference();
        let id = id.ok_or_else(|| Fault::new(0, "placement", "a placement is missing", CURVE_REMEDY))?;
        placement(self.aim, id, self.state.units.millimetres)
    }
}

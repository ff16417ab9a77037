//! B-splines of all four knot kinds, ellipses as B-splines, and parts of B-splines.

use super::*;

impl Pieces<'_> {
    /// The B-spline that an instance is; `None` when it is another curve.
    pub(super) fn spline(&self, id: u64, instance: &Instance) -> Result<Option<Spline<Setup>>, Fault> {
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

/// Part of an ellipse as a rational quadratic B-spline: each piece of at most a quarter is the affine image of a circle's.
pub(super) fn ellipse(frame: &Transform<Setup, Setup>, a: f64, b: f64, from: f64, sweep: f64) -> Spline<Setup> {
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
pub(super) fn nearest_parameter(spline: &Spline<Setup>, place: P) -> Option<f64> {
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
pub(super) fn sub_spline(spline: &Spline<Setup>, low: f64, high: f64) -> Option<Spline<Setup>> {
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

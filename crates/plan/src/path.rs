//! Geometry of moves: lines, arcs and helices, and splines, as parametric curves over `u` in 0..=1.
//!
//! Curves are kept as what they are: an arc is never a list of chords before the planner or a picture asks for them. Generic over the
//! frame, so that a path of the set-up becomes one of the machine by [`Path::in_frame`].

use units::{Frame, Point, Radians, Transform, Vector};

/// A curve from a start to an end.
#[derive(Clone, Debug, PartialEq)]
pub enum Path<F: Frame> {
    /// Straight.
    Line {
        /// Start.
        from: Point<F>,
        /// End.
        to: Point<F>,
    },
    /// Part of a circle, a full circle or several turns; with a rise, a helix.
    Arc(Arc<F>),
    /// A B-spline, rational or not.
    Spline(Spline<F>),
}

/// Part of a circle or helix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc<F: Frame> {
    /// Start.
    pub from: Point<F>,
    /// A point of the axis, in the plane of the start.
    pub centre: Point<F>,
    /// Direction of the axis, length 1.
    pub normal: Vector<F>,
    /// Angle travelled: positive is counterclockwise seen against `normal`, that is from its tip.
    pub sweep: Radians,
    /// Millimetres travelled along `normal` over the whole sweep; 0 is a flat arc.
    pub rise: f64,
}

/// A B-spline curve over its whole knot range.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline<F: Frame> {
    /// Degree, at least 1.
    pub degree: usize,
    /// Control points, at least `degree + 1`.
    pub poles: Vec<Point<F>>,
    /// One weight a pole, all above 0; empty when the curve is not rational.
    pub weights: Vec<f64>,
    /// `poles + degree + 1` knots, never falling.
    pub knots: Vec<f64>,
}

impl<F: Frame> Path<F> {
    /// Where it starts.
    pub fn start(&self) -> Point<F> {
        match self {
            Path::Line { from, .. } => *from,
            Path::Arc(arc) => arc.from,
            Path::Spline(s) => s.at(0.0),
        }
    }

    /// Where it ends.
    pub fn end(&self) -> Point<F> {
        match self {
            Path::Line { to, .. } => *to,
            Path::Arc(arc) => arc.at(1.0),
            Path::Spline(s) => s.at(1.0),
        }
    }

    /// The place at parameter `u` in 0..=1. On lines and arcs `u` is the fraction of the length; on splines it is not.
    pub fn at(&self, u: f64) -> Point<F> {
        match self {
            Path::Line { from, to } => from.toward(*to, u),
            Path::Arc(arc) => arc.at(u),
            Path::Spline(s) => s.at(u),
        }
    }

    /// First and second derivative by `u`, mm.
    pub fn derivatives(&self, u: f64) -> (Vector<F>, Vector<F>) {
        match self {
            Path::Line { from, to } => (*to - *from, Vector::ZERO),
            Path::Arc(arc) => arc.derivatives(u),
            Path::Spline(s) => s.derivatives(u),
        }
    }

    /// Length, mm; exact for lines and helices, for splines by Gauss-Legendre quadrature on each knot span.
    pub fn length(&self) -> f64 {
        match self {
            Path::Line { from, to } => from.distance(*to),
            Path::Arc(arc) => arc.length(),
            Path::Spline(s) => s.length_between(0.0, 1.0),
        }
    }

    /// Points on the path, the first at its start and the last at its end, such that chords between them stay within `tolerance` mm
    /// of it; at most `most` chords.
    pub fn flatten(&self, tolerance: f64, most: usize, mut point: impl FnMut(f64, Point<F>)) {
        let chords = self.chords(tolerance).clamp(1, most.max(1));
        for k in 0..=chords {
            let u = k as f64 / chords as f64;
            point(
                u,
                if k == 0 {
                    self.start()
                } else if k == chords {
                    self.end()
                } else {
                    self.at(u)
                },
            );
        }
    }

    /// Number of equal steps of `u` such that chords stay within `tolerance` mm: h = sqrt(8 e / |second derivative|).
    fn chords(&self, tolerance: f64) -> usize {
        let tolerance = tolerance.max(1e-9);
        match self {
            Path::Line { .. } => 1,
            Path::Arc(arc) => {
                let radius = arc.radius();
                if radius <= tolerance {
                    return 8;
                }
                let step = 2.0 * libm::acos(1.0 - tolerance / radius);
                (libm::ceil(arc.sweep.0.abs() / step) as usize).max(1)
            }
            Path::Spline(s) => {
                let spans = s.poles.len().saturating_sub(s.degree).max(1);
                let probes = 16 * spans;
                let bend = (0..=probes)
                    .map(|k| self.derivatives(k as f64 / probes as f64).1.length())
                    .fold(0.0, f64::max);
                (libm::ceil(libm::sqrt(bend / (8.0 * tolerance))) as usize).max(spans)
            }
        }
    }

    /// The same curve in another frame.
    pub fn in_frame<T: Frame>(&self, target_from_here: &Transform<T, F>) -> Path<T> {
        let t = *target_from_here;
        match self {
            Path::Line { from, to } => Path::Line {
                from: t * *from,
                to: t * *to,
            },
            Path::Arc(a) => Path::Arc(Arc {
                from: t * a.from,
                centre: t * a.centre,
                normal: t * a.normal,
                sweep: a.sweep,
                rise: a.rise,
            }),
            Path::Spline(s) => Path::Spline(Spline {
                degree: s.degree,
                poles: s.poles.iter().map(|p| t * *p).collect(),
                weights: s.weights.clone(),
                knots: s.knots.clone(),
            }),
        }
    }

    /// The same curve run backwards.
    pub fn reversed(&self) -> Path<F> {
        match self {
            Path::Line { from, to } => Path::Line { from: *to, to: *from },
            Path::Arc(a) => Path::Arc(Arc {
                from: a.at(1.0),
                centre: a.centre + a.normal * a.rise,
                normal: a.normal,
                sweep: -a.sweep,
                rise: -a.rise,
            }),
            Path::Spline(s) => {
                let (first, last) = (
                    s.knots.first().copied().unwrap_or(0.0),
                    s.knots.last().copied().unwrap_or(1.0),
                );
                Path::Spline(Spline {
                    degree: s.degree,
                    poles: s.poles.iter().rev().copied().collect(),
                    weights: s.weights.iter().rev().copied().collect(),
                    knots: s.knots.iter().rev().map(|k| first + last - k).collect(),
                })
            }
        }
    }

    /// False when a number in it is infinite or not a number, or a spline's counts do not fit together.
    pub fn is_sound(&self) -> bool {
        match self {
            Path::Line { from, to } => from.is_finite() && to.is_finite(),
            Path::Arc(a) => {
                a.from.is_finite()
                    && a.centre.is_finite()
                    && (a.normal.length() - 1.0).abs() < 1e-6
                    && a.sweep.is_finite()
                    && a.rise.is_finite()
            }
            Path::Spline(s) => s.is_sound(),
        }
    }
}

impl<F: Frame> Arc<F> {
    /// Distance from the axis, mm.
    pub fn radius(&self) -> f64 {
        (self.from - self.centre).length()
    }
    /// Length along the helix, mm.
    pub fn length(&self) -> f64 {
        let around = self.radius() * self.sweep.0;
        libm::sqrt(around * around + self.rise * self.rise)
    }
    fn at(&self, u: f64) -> Point<F> {
        let out = self.from - self.centre;
        let side = self.normal.cross(out);
        let (sin, cos) = libm::sincos(self.sweep.0 * u);
        self.centre + out * cos + side * sin + self.normal * (self.rise * u)
    }
    fn derivatives(&self, u: f64) -> (Vector<F>, Vector<F>) {
        let out = self.from - self.centre;
        let side = self.normal.cross(out);
        let w = self.sweep.0;
        let (sin, cos) = libm::sincos(w * u);
        (
            side * (w * cos) - out * (w * sin) + self.normal * self.rise,
            (out * cos + side * sin) * (-w * w),
        )
    }
}

impl<F: Frame> Spline<F> {
    /// True when counts fit together and all numbers are finite.
    pub fn is_sound(&self) -> bool {
        self.degree >= 1
            && self.poles.len() > self.degree
            && self.knots.len() == self.poles.len() + self.degree + 1
            && (self.weights.is_empty() || self.weights.len() == self.poles.len())
            && self.weights.iter().all(|w| *w > 0.0 && w.is_finite())
            && self.knots.iter().all(|k| k.is_finite())
            && self.knots.windows(2).all(|k| k[0] <= k[1])
            && self.domain().0 < self.domain().1
            && self.poles.iter().all(|p| p.is_finite())
    }

    /// The parameter range in knots.
    fn domain(&self) -> (f64, f64) {
        (self.knots[self.degree], self.knots[self.poles.len()])
    }

    fn at(&self, u: f64) -> Point<F> {
        let [p, _, _] = self.homogeneous(u);
        Point::new(p[0] / p[3], p[1] / p[3], p[2] / p[3])
    }

    /// Quotient rule on the homogeneous curve (Piegl and Tiller, The NURBS Book, 4.3).
    fn derivatives(&self, u: f64) -> (Vector<F>, Vector<F>) {
        let [a, a1, a2] = self.homogeneous(u);
        let w = a[3];
        let c: [f64; 3] = std::array::from_fn(|k| a[k] / w);
        let c1: [f64; 3] = std::array::from_fn(|k| (a1[k] - a1[3] * c[k]) / w);
        let c2 = std::array::from_fn(|k| (a2[k] - 2.0 * a1[3] * c1[k] - a2[3] * c[k]) / w);
        (Vector::from_xyz(c1), Vector::from_xyz(c2))
    }

    /// Value, first and second derivative by `u` of the curve in homogeneous coordinates (x w, y w, z w, w), by de Boor's scheme.
    fn homogeneous(&self, u: f64) -> [[f64; 4]; 3] {
        let p = self.degree;
        let (low, high) = self.domain();
        let scale = high - low;
        let t = low + scale * u.clamp(0.0, 1.0);
        let last = self.poles.len() - 1;
        let span = self.knots.partition_point(|k| *k <= t).saturating_sub(1).clamp(p, last);
        let pole = |i: usize| {
            let w = self.weights.get(i).copied().unwrap_or(1.0);
            let [x, y, z] = self.poles[i].xyz;
            [x * w, y * w, z * w, w]
        };
        let value = de_boor(p, span, &self.knots, t, (0..=p).map(|j| pole(span - p + j)).collect());
        // The derivative of a B-spline is a B-spline of differences of its poles, one degree lower.
        let differences = |degree: usize, poles: &[[f64; 4]], shift: usize| -> Vec<[f64; 4]> {
            (0..degree)
                .map(|j| {
                    let i = span - p + j + shift;
                    let width = self.knots[i + degree + 1] - self.knots[i + 1];
                    let k = if width > 0.0 { degree as f64 / width } else { 0.0 };
                    std::array::from_fn(|c| (poles[j + 1][c] - poles[j][c]) * k)
                })
                .collect()
        };
        let all: Vec<[f64; 4]> = (0..=p).map(|j| pole(span - p + j)).collect();
        let d1 = differences(p, &all, 0);
        let first = de_boor(p - 1, span, &self.knots, t, d1.clone());
        let second = if p >= 2 {
            de_boor(p - 2, span, &self.knots, t, differences(p - 1, &d1, 1))
        } else {
            [0.0; 4]
        };
        [value, first.map(|c| c * scale), second.map(|c| c * scale * scale)]
    }

    /// Length between two parameters: 5-point Gauss-Legendre on eighths of each knot span.
    pub fn length_between(&self, from: f64, to: f64) -> f64 {
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let (low, high) = self.domain();
        let mut breaks: Vec<f64> = self
            .knots
            .iter()
            .map(|k| (k - low) / (high - low))
            .filter(|u| *u > from && *u < to)
            .collect();
        breaks.insert(0, from);
        breaks.push(to);
        breaks.dedup();
        let mut sum = 0.0;
        for pair in breaks.windows(2) {
            let step = (pair[1] - pair[0]) / 8.0;
            for k in 0..8 {
                let middle = pair[0] + step * (k as f64 + 0.5);
                sum += NODES
                    .iter()
                    .map(|(x, w)| w * self.derivatives(middle + x * step / 2.0).0.length())
                    .sum::<f64>()
                    * step
                    / 2.0;
            }
        }
        sum
    }
}

/// de Boor's scheme for the poles that are alive in a knot span.
fn de_boor(degree: usize, span: usize, knots: &[f64], t: f64, mut d: Vec<[f64; 4]>) -> [f64; 4] {
    for r in 1..=degree {
        for j in (r..=degree).rev() {
            let i = span - degree + j;
            let width = knots[i + degree + 1 - r] - knots[i];
            let a = if width > 0.0 { (t - knots[i]) / width } else { 0.0 };
            d[j] = std::array::from_fn(|c| d[j - 1][c] * (1.0 - a) + d[j][c] * a);
        }
    }
    d[degree]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};
    use units::Setup;

    fn quarter_spline() -> Path<Setup> {
        // A quarter of a circle of radius 10 as a rational quadratic.
        Path::Spline(Spline {
            degree: 2,
            poles: vec![
                Point::new(10.0, 0.0, 0.0),
                Point::new(10.0, 10.0, 0.0),
                Point::new(0.0, 10.0, 0.0),
            ],
            weights: vec![1.0, SQRT_2 / 2.0, 1.0],
            knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
        })
    }

    fn helix() -> Path<Setup> {
        Path::Arc(Arc {
            from: Point::new(5.0, 0.0, 0.0),
            centre: Point::ORIGIN,
            normal: Vector::Z,
            sweep: Radians(TAU),
            rise: 3.0,
        })
    }

    #[test]
    fn a_rational_quadratic_is_a_true_circle() {
        let p = quarter_spline();
        for k in 0..=20 {
            assert!((p.at(f64::from(k) / 20.0).distance(Point::ORIGIN) - 10.0).abs() < 1e-12);
        }
        assert!((p.length() - 10.0 * FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for p in [quarter_spline(), helix(), p_cubic()] {
            for u in [0.1, 0.35, 0.52, 0.77, 0.9] {
                let h = 1e-5;
                let (d1, d2) = p.derivatives(u);
                let n1 = (p.at(u + h) - p.at(u - h)) * (0.5 / h);
                let n2 = (p.derivatives(u + h).0 - p.derivatives(u - h).0) * (0.5 / h);
                assert!((d1 - n1).length() < 1e-6 * (1.0 + d1.length()), "{p:?} {u}");
                assert!((d2 - n2).length() < 1e-5 * (1.0 + d2.length()), "{p:?} {u}: {d2:?} {n2:?}");
            }
        }
    }

    fn p_cubic() -> Path<Setup> {
        Path::Spline(Spline {
            degree: 3,
            poles: [
                [0., 0., 0.],
                [1., 2., 0.],
                [3., 3., 1.],
                [5., 0., 2.],
                [6., 1., 0.],
                [8., 2., 1.],
            ]
            .map(Point::from_xyz)
            .to_vec(),
            weights: vec![],
            knots: vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 2.0, 2.0, 2.0, 2.0],
        })
    }

    #[test]
    fn a_helix_rises_evenly_and_ends_above_its_start() {
        let p = helix();
        assert!(p.end().distance(Point::new(5.0, 0.0, 3.0)) < 1e-12);
        assert!((p.length() - libm::sqrt(100.0 * PI * PI + 9.0)).abs() < 1e-12);
    }

    #[test]
    fn reversing_runs_the_same_places_backwards() {
        for p in [quarter_spline(), helix(), p_cubic()] {
            let back = p.reversed();
            for u in [0.0, 0.3, 1.0] {
                assert!(p.at(u).distance(back.at(1.0 - u)) < 1e-9, "{p:?}");
            }
        }
    }

    #[test]
    fn chords_stay_within_the_tolerance() {
        for p in [quarter_spline(), helix(), p_cubic()] {
            let mut last: Option<(f64, Point<Setup>)> = None;
            p.flatten(0.01, 100_000, |u, point| {
                if let Some((u0, p0)) = last {
                    let middle = p.at((u + u0) / 2.0);
                    assert!(p0.toward(point, 0.5).distance(middle) < 0.011);
                }
                last = Some((u, point));
            });
            assert_eq!(last.expect("a path has points").1, p.end());
        }
    }
}

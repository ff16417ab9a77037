//! Nearest places on true curves: what a chord finds is made exact on the line, arc or spline that it stands for.

use crate::vec3::{V3, distance, dot, sub};
use plan::Path;
use units::{Point, Setup};

/// The parameter and distance of the place nearest to `p`, looking between parameters `low` and `high` from `guess` on: Newton on the
/// square of the distance, held inside the bracket, falling back on halving.
pub(crate) fn nearest(path: &Path<Setup>, p: V3, guess: f64, low: f64, high: f64) -> (f64, f64) {
    if let Path::Line { from, to } = path {
        let (t, square) = crate::vec3::nearest_on_chord(p, from.xyz, sub(to.xyz, from.xyz));
        return (t, square.sqrt());
    }
    // f' of half the square distance; its sign says on which side the nearest place lies.
    let slope = |u: f64| {
        let (d1, d2) = path.derivatives(u);
        let out = sub(path.at(u).xyz, p);
        (dot(out, d1.xyz), dot(d1.xyz, d1.xyz) + dot(out, d2.xyz))
    };
    let (mut low, mut high) = (low.clamp(0.0, 1.0), high.clamp(0.0, 1.0));
    let mut u = guess.clamp(low, high);
    for _ in 0..30 {
        let (first, second) = slope(u);
        if first > 0.0 {
            high = u;
        } else {
            low = u;
        }
        let step = if second > 0.0 { u - first / second } else { f64::NAN };
        let next = if step >= low && step <= high {
            step
        } else {
            (low + high) / 2.0
        };
        if (next - u).abs() < 1e-13 {
            u = next;
            break;
        }
        u = next;
    }
    let mut best = (u, distance(path.at(u).xyz, p));
    // Newton can end at a place that is worse than where it began when the bracket holds two minima.
    for other in [guess.clamp(0.0, 1.0), low, high] {
        let d = distance(path.at(other).xyz, p);
        if d < best.1 {
            best = (other, d);
        }
    }
    best
}

/// Direction of a curve at a parameter, length 1; `None` where it has none.
pub(crate) fn direction(path: &Path<Setup>, u: f64) -> Option<V3> {
    path.derivatives(u).0.unit().map(|d| d.xyz)
}

/// A point of a triple.
pub(crate) fn point(p: V3) -> Point<Setup> {
    Point::from_xyz(p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{Arc, Spline};
    use units::{Radians, Vector};

    #[track_caller]
    fn check(path: &Path<Setup>) {
        for k in 0..60 {
            let k = f64::from(k);
            let p = [k * 0.37 - 9.0, 8.0 - k * 0.21, (k - 30.0) * 0.05];
            // Brute force finds the stretch, as the chords do.
            let n = 4000;
            let best = (0..=n)
                .map(|i| {
                    (
                        f64::from(i) / f64::from(n),
                        distance(path.at(f64::from(i) / f64::from(n)).xyz, p),
                    )
                })
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .expect("some");
            let (u, d) = nearest(path, p, best.0, best.0 - 0.01, best.0 + 0.01);
            assert!(d <= best.1 + 1e-12 && d > best.1 - 0.02, "{p:?}: {d} against {}", best.1);
            if u > 0.0 && u < 1.0 {
                let out = sub(path.at(u).xyz, p);
                let t = direction(path, u).expect("a direction");
                assert!(dot(out, t).abs() < 1e-6, "{p:?}: not square to the curve: {}", dot(out, t));
            }
        }
    }

    #[test]
    fn the_nearest_place_is_square_to_arcs_and_splines() {
        check(&Path::Arc(Arc {
            from: Point::new(5.0, 0.0, 0.0),
            centre: Point::ORIGIN,
            normal: Vector::Z,
            sweep: Radians(4.0),
            rise: 2.0,
        }));
        check(&Path::Spline(Spline {
            degree: 3,
            poles: [[-8., -2., 0.], [-4., 6., 0.], [3., 3., 1.], [5., -4., 2.], [8., 1., 0.]]
                .map(Point::from_xyz)
                .to_vec(),
            weights: vec![],
            knots: vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0],
        }));
    }
}

//! The rigid shift that lays a run on its plan best.
//!
//! Point to curve, as in iterative closest point with normals (Chen and Medioni 1992): a sample says nothing about a shift along its
//! path, so only the part square to the path counts. Far samples count less, so that corners cut by the machine do not pull.

use crate::vec3::{V3, add, dot, scale, sub};

/// A sample's nearest place on the plan and the path's direction there (length 1; zero where there is none).
pub(crate) struct Foot {
    pub(crate) place: V3,
    pub(crate) direction: V3,
}

/// The shift from plan to run over `samples`; `foot` finds the nearest place of the plan for the k-th sample moved to a place.
pub(crate) fn fit(samples: &[V3], start: V3, rounds: usize, foot: &mut dyn FnMut(usize, V3) -> Option<Foot>) -> V3 {
    let mut shift = start;
    for _ in 0..rounds {
        let mut feet: Vec<(V3, V3, f64)> = Vec::with_capacity(samples.len());
        for (k, sample) in samples.iter().enumerate() {
            let moved = sub(*sample, shift);
            if let Some(foot) = foot(k, moved) {
                let out = sub(moved, foot.place);
                feet.push((sub(*sample, foot.place), foot.direction, dot(out, out).sqrt()));
            }
        }
        let mut sizes: Vec<f64> = feet.iter().map(|f| f.2).collect();
        let usual = crate::vec3::quantile(&mut sizes, 0.5).max(1e-4);
        let mut a = [[0.0; 3]; 3];
        let mut b = [0.0; 3];
        for (out, direction, size) in &feet {
            let ratio = size / (3.0 * usual);
            let weight = 1.0 / (1.0 + ratio * ratio);
            let along = dot(*out, *direction);
            for r in 0..3 {
                for c in 0..3 {
                    let unit = f64::from(u8::from(r == c));
                    a[r][c] += weight * (unit - direction[r] * direction[c]);
                }
                b[r] += weight * (out[r] - along * direction[r]);
            }
        }
        // A little of the present shift, so that a direction of which no sample says anything stays as it is.
        let hold = 1e-4 * (a[0][0] + a[1][1] + a[2][2]).max(1e-9);
        for k in 0..3 {
            a[k][k] += hold;
            b[k] += hold * shift[k];
        }
        let Some(next) = solve(a, b) else { break };
        let step = sub(next, shift);
        shift = next;
        // Ten nanometres.
        if dot(step, step) < 1e-10 {
            break;
        }
    }
    shift
}

/// Three equations by Cramer's rule.
fn solve(a: [[f64; 3]; 3], b: V3) -> Option<V3> {
    let cross = |x: V3, y: V3| {
        [
            x[1] * y[2] - x[2] * y[1],
            x[2] * y[0] - x[0] * y[2],
            x[0] * y[1] - x[1] * y[0],
        ]
    };
    // `a` is symmetric: its rows are its columns.
    let determinant = dot(a[0], cross(a[1], a[2]));
    if determinant == 0.0 || determinant.is_nan() {
        return None;
    }
    let x = add(
        add(scale(cross(a[1], a[2]), b[0]), scale(cross(a[2], a[0]), b[1])),
        scale(cross(a[0], a[1]), b[2]),
    );
    let x = scale(x, 1.0 / determinant);
    x.iter().all(|c| c.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_square_is_found_and_the_free_direction_stays() {
        // Four sides of a square in XY: X and Y are told, and Z too, because all sides are level.
        let mut samples = Vec::new();
        for k in 0..100 {
            let u = f64::from(k) / 100.0 * 10.0;
            samples.extend([[u, 0.0, 0.0], [u, 10.0, 0.0], [0.0, u, 0.0], [10.0, u, 0.0]]);
        }
        let moved: Vec<V3> = samples.iter().map(|p| add(*p, [0.12, -0.05, 0.03])).collect();
        let sides = [
            ([0.0, 0.0, 0.0], [10.0, 0.0, 0.0]),
            ([0.0, 10.0, 0.0], [10.0, 0.0, 0.0]),
            ([0.0, 0.0, 0.0], [0.0, 10.0, 0.0]),
            ([10.0, 0.0, 0.0], [0.0, 10.0, 0.0]),
        ];
        let shift = fit(&moved, [0.0; 3], 20, &mut |_, p| {
            let best = sides
                .iter()
                .map(|(a, d)| (crate::vec3::nearest_on_chord(p, *a, *d), a, d))
                .min_by(|x, y| x.0.1.total_cmp(&y.0.1))?;
            let ((t, _), a, d) = best;
            Some(Foot {
                place: add(*a, scale(*d, t)),
                direction: scale(*d, 0.1),
            })
        });
        for (found, true_one) in shift.iter().zip([0.12, -0.05, 0.03]) {
            assert!((found - true_one).abs() < 1e-3, "{shift:?}");
        }
        // A single line along X tells nothing about X.
        let line: Vec<V3> = (0..50).map(|k| [f64::from(k), 0.2, 0.0]).collect();
        let shift = fit(&line, [0.0; 3], 20, &mut |_, p| {
            Some(Foot {
                place: [p[0], 0.0, 0.0],
                direction: [1.0, 0.0, 0.0],
            })
        });
        assert!(shift[0].abs() < 1e-9 && (shift[1] - 0.2).abs() < 1e-3, "{shift:?}");
    }
}

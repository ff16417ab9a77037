//! The curve that rounds a corner: a cubic Bezier that touches both neighbours in direction.
//!
//! Between two straight lines its handles make it the parabola that constant acceleration draws, which is the fastest way round a
//! corner for axes with limited acceleration.

use units::{Machine, Point, Vector};

/// A cubic Bezier curve, parameter 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend {
    poles: [Point<Machine>; 4],
}

impl Blend {
    /// From `start` leaving in direction `out` to `end` arriving in direction `into` (both of length 1), round `corner`.
    pub fn round(
        start: Point<Machine>,
        out: Vector<Machine>,
        corner: Point<Machine>,
        end: Point<Machine>,
        into: Vector<Machine>,
    ) -> Blend {
        let first = start + out * (2.0 / 3.0 * start.distance(corner));
        let second = end - into * (2.0 / 3.0 * end.distance(corner));
        Blend {
            poles: [start, first, second, end],
        }
    }

    /// The place at `u`.
    pub fn at(&self, u: f64) -> Point<Machine> {
        let w = 1.0 - u;
        let k = [w * w * w, 3.0 * w * w * u, 3.0 * w * u * u, u * u * u];
        Point::from_xyz(std::array::from_fn(|c| (0..4).map(|i| k[i] * self.poles[i].xyz[c]).sum()))
    }

    /// First and second derivative by `u`.
    pub fn derivatives(&self, u: f64) -> (Vector<Machine>, Vector<Machine>) {
        let w = 1.0 - u;
        let [a, b, c] = [0, 1, 2].map(|i| self.poles[i + 1] - self.poles[i]);
        let first = (a * (w * w) + b * (2.0 * w * u) + c * (u * u)) * 3.0;
        let second = ((b - a) * w + (c - b) * u) * 6.0;
        (first, second)
    }
}

//! How a joint of the programmed path is made smooth: two functions with a bounded support that are added to the path.
//!
//! The path over its length has a tangent that steps by `turn` in a corner and a curvature that steps by `bend` where a line meets an arc.
//! Added to it are `turn * Rounding` and `bend * Easing`: they take the steps away, reach `half` to both sides, and end there with no
//! value, slope or curvature. What is added at several joints adds up, so dense chords need no curve of their own: where the supports of
//! many corners overlap, their sum is the smooth curve that the chords stand for.

/// Value and first three derivatives.
pub(super) type Jet = [f64; 4];

/// Largest value of a rounding, as a share of its half width: 7/60.
pub(super) const ROUNDING_PEAK: f64 = 7.0 / 60.0;

/// Largest value of an easing, as a share of its half width squared.
pub(super) const EASING_PEAK: f64 = 0.014_520;

/// Where that is, as a share of the half width: 1 - (2 + sqrt 2) (1 - 2^(-1/3)).
pub(super) const EASING_PLACE: f64 = 0.295_661;

/// A corner spread by a cubic B-spline: the second derivative of what comes out is that B-spline, of area 1. It is near to the path on
/// which one axis brakes and another one accelerates at the full jerk, which is the fastest way round.
pub(super) fn rounding(d: f64, half: f64) -> Jet {
    let w = 0.5 * half;
    let over = 1.0 / w;
    let x = d.abs() * over;
    if x >= 2.0 {
        return [0.0; 4];
    }
    let side = if d < 0.0 { -1.0 } else { 1.0 };
    let (value, slope, second, third) = if x >= 1.0 {
        let y = 2.0 - x;
        let y2 = y * y;
        (
            y2 * y2 * y * (1.0 / 120.0),
            y2 * y2 * (1.0 / 24.0),
            y2 * y * (1.0 / 6.0),
            -0.5 * y2,
        )
    } else {
        let x2 = x * x;
        (
            7.0 / 30.0 - 0.5 * x + x2 * (1.0 / 3.0) - x2 * x2 * (1.0 / 12.0) + x2 * x2 * x * (1.0 / 40.0),
            0.5 - 2.0 / 3.0 * x + x2 * x * (1.0 / 3.0) - x2 * x2 * 0.125,
            2.0 / 3.0 - x2 + 0.5 * x2 * x,
            -2.0 * x + 1.5 * x2,
        )
    };
    [value * w, -side * slope, second * over, side * third * (over * over)]
}

/// Largest value of a swing, as a share of its half width.
pub(super) const SWING_PEAK: f64 = 0.125;

/// A corner spread by the curve on which the speed along the one leg falls to rest while the one along the other rises from it, both at a
/// constant jerk: (1 - u)^3 and u^3. It is the fastest way round a sharp corner, and too uneven where many overlap.
pub(super) fn swing(d: f64, half: f64) -> Jet {
    let x = d / half;
    if x.abs() >= 1.0 {
        return [0.0; 4];
    }
    // x = u^3 - (1 - u)^3, solved for u.
    let u = 0.5 + libm::sinh(libm::asinh(2.0 * x) / 3.0);
    let w = 1.0 - u;
    let sum = u * u + w * w;
    let near = if x < 0.0 { u } else { w };
    let slope = if x < 0.0 { u * u } else { -w * w };
    let product = u * w;
    let cube = sum * sum * sum;
    [
        near * near * near * half,
        slope / sum,
        2.0 / 3.0 * product / cube / half,
        2.0 / 9.0 * (w - u) * (sum + 6.0 * product) / (cube * sum * sum) / (half * half),
    ]
}

/// The value of a rounding alone.
pub(super) fn rounding_value(d: f64, half: f64) -> f64 {
    rounding_value_over(d, 0.5 * half, 2.0 / half)
}

/// The same, for half the half width and one over that.
#[inline(always)]
pub(super) fn rounding_value_over(d: f64, w: f64, over: f64) -> f64 {
    let x = d.abs() * over;
    if x >= 2.0 {
        return 0.0;
    }
    if x >= 1.0 {
        let y = 2.0 - x;
        let y2 = y * y;
        y2 * y2 * y * w * (1.0 / 120.0)
    } else {
        let x2 = x * x;
        w * (7.0 / 30.0 - 0.5 * x + x2 * (1.0 / 3.0) - x2 * x2 * (1.0 / 12.0) + x2 * x2 * x * (1.0 / 40.0))
    }
}

/// Where the third derivative of an easing changes its sign, from the edge: 1 - 2^(-1/3), so that its value is 0 at the joint.
pub(super) const TURNING: f64 = 0.2062994740159002;
/// Its third derivative: 1 / (2 - 4 TURNING), so that its second derivative steps by 1.
const THIRD: f64 = 0.8512071919596574;

/// A step of curvature made a ramp that leaves the path beyond it where it is: the third derivative has one magnitude all along, which is
/// the least that does it.
pub(super) fn easing(d: f64, half: f64) -> Jet {
    let z = 1.0 - d.abs() / half;
    if z <= 0.0 {
        return [0.0; 4];
    }
    let a = TURNING;
    let (value, slope, second, third) = if z < a {
        (-z * z * z / 6.0, -0.5 * z * z, -z, -1.0)
    } else {
        (
            z * (z * (z / 6.0 - a) + a * a) - a * a * a / 3.0,
            z * (0.5 * z - 2.0 * a) + a * a,
            z - 2.0 * a,
            1.0,
        )
    };
    // Odd about the joint: value and second derivative change their sign, the others do not.
    let side = if d < 0.0 { 1.0 } else { -1.0 };
    [
        side * THIRD * value * half * half,
        THIRD * slope * half,
        side * THIRD * second,
        THIRD * third / half,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn each_is_the_derivative_of_the_one_before(of: fn(f64, f64) -> Jet) {
        for half in [0.3, 2.0] {
            for k in -99..100 {
                let d = (f64::from(k) + 0.5) * 0.01007 * half;
                let h = 1e-6 * half;
                let (before, here, after) = (of(d - h, half), of(d, half), of(d + h, half));
                for n in 0..3 {
                    let slope = (after[n] - before[n]) / (2.0 * h);
                    let scale = half * half / libm::pow(half, n as f64 + 1.0);
                    // The third derivative of an easing steps; beside its steps it is what the second one's slope is.
                    let near_step = n == 2 && (after[3] - before[3]).abs() > 1e-3 * scale;
                    assert!(
                        near_step || (slope - here[n + 1]).abs() < 2e-5 * scale.max(1.0),
                        "{n} at {d} of {half}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_derivatives_of_both_are_derivatives() {
        each_is_the_derivative_of_the_one_before(rounding);
        each_is_the_derivative_of_the_one_before(easing);
        each_is_the_derivative_of_the_one_before(swing);
    }

    #[test]
    fn a_rounding_takes_a_step_of_the_tangent_away_and_an_easing_one_of_the_curvature() {
        let tiny = 1e-12;
        let step = |of: fn(f64, f64) -> Jet, n: usize| of(tiny, 1.5)[n] - of(-tiny, 1.5)[n];
        assert!((step(rounding, 1) + 1.0).abs() < 1e-9 && step(rounding, 0).abs() < 1e-9 && step(rounding, 2).abs() < 1e-9);
        assert!((step(swing, 1) + 1.0).abs() < 1e-9 && step(swing, 0).abs() < 1e-9 && step(swing, 2).abs() < 1e-9);
        assert!((step(easing, 2) + 1.0).abs() < 1e-9 && step(easing, 0).abs() < 1e-9 && step(easing, 1).abs() < 1e-9);
    }

    #[test]
    fn their_peaks_are_what_the_tolerance_is_divided_by() {
        let peak = |of: fn(f64, f64) -> Jet| {
            (0..=2000)
                .map(|k| of(f64::from(k) * 0.001 - 1.0, 1.0)[0].abs())
                .fold(0.0, f64::max)
        };
        assert!((peak(rounding) - ROUNDING_PEAK).abs() < 1e-9 && (peak(easing) - EASING_PEAK).abs() < 2e-6);
        assert!((peak(swing) - SWING_PEAK).abs() < 1e-9);
        assert!((rounding_value(0.37, 1.1) - rounding(0.37, 1.1)[0]).abs() < 1e-15);
    }
}

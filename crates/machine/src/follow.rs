//! A speed that follows a target with limited acceleration and limited jerk: of an axis by hand, and of time along a path.

/// The next acceleration of a speed that is to become `target`: as fast as the limits allow, without passing it.
///
/// One step of `step` seconds; the speed after it is `speed + acceleration * step`. `acceleration` is that of the last step; `lowest` and
/// `highest` bound the new one (at most 0, at least 0), `jerk` its change for each second.
pub(crate) fn follow((speed, acceleration): (f64, f64), target: f64, (lowest, highest): (f64, f64), jerk: f64, step: f64) -> f64 {
    let left = target - speed;
    // What one step of jerk makes of the speed. An acceleration of n such steps takes n (n + 1) / 2 of them until it is gone, so this many
    // whole steps are still needed; their acceleration falls evenly and is gone exactly at the target.
    let share = left.abs() / (jerk * step * step);
    let steps = libm::ceil(libm::sqrt(0.25 + 2.0 * share) - 0.5).max(1.0);
    let wanted = (2.0 * share / (steps + 1.0) * jerk * step).copysign(left);
    let change = jerk * step;
    wanted
        .max(acceleration - change)
        .min(acceleration + change)
        .max(lowest)
        .min(highest)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn a_speed_gets_to_its_target_within_its_limits_and_never_past_it() {
        for (from, target) in [(0.0, 100.0), (100.0, 0.0), (0.0, 0.03), (5.0, -250.0), (1.0, 1.0), (0.0, 3.3)] {
            let (mut speed, mut acceleration) = (from, 0.0);
            let mut steps = 0;
            while speed != target || acceleration != 0.0 {
                let next = follow((speed, acceleration), target, (-3000.0, 3000.0), 50_000.0, 0.001);
                assert!((next - acceleration).abs() <= 50.0 + 1e-9 && next.abs() <= 3000.0);
                acceleration = next;
                speed += acceleration * 0.001;
                if (speed - target).abs() < 1e-9 {
                    speed = target;
                }
                assert!(
                    (speed - from) * (target - from) >= 0.0 && (target - speed) * (target - from) >= -1e-6,
                    "{from} {target}: {speed}"
                );
                steps += 1;
                assert!(steps < 1000, "{from} to {target} does not end: {speed} {acceleration}");
            }
            let change = (target - from).abs();
            let ideal = if change >= 180.0 {
                change / 3000.0 + 0.06
            } else {
                2.0 * libm::sqrt(change / 50_000.0)
            };
            assert!(f64::from(steps) * 0.001 <= ideal + 0.004, "{from} to {target}: {steps} ms");
        }
    }
}

//! What a move's path and feed become before they are planned: cut at inner corners, started where the axes are, looked at over the
//! parameter.

use plan::{Path, SpeedProfile, Spline};
use units::{Machine, Point, Setup, Transform, Vector};

/// Chord of an arc, as a share of its radius, from which on its end can stay where it is when its start moves: no place of it moves by
/// more than twice as much.
const SHORTEST_CHORD: f64 = 1.0;

/// Parts of a path between which a feed that follows the radius is looked at before halving begins; halvings; and how far the line
/// between two looks may be off, as a share.
const FEED_LOOKS: u32 = 4;
const FEED_HALVINGS: u8 = 9;
const FEED_ERROR: f64 = 0.0004;

/// The same path, moved by the tool offset: where the gauge point goes.
pub(crate) fn shifted(path: Path<Machine>, by: Vector<Machine>) -> Path<Machine> {
    if by == Vector::ZERO {
        return path;
    }
    path.in_frame(&Transform::shift(by.xyz))
}

/// The same path, started a rounding away.
pub(crate) fn starting_at(path: Path<Machine>, place: Point<Machine>) -> Path<Machine> {
    match path {
        Path::Line { to, .. } => Path::Line { from: place, to },
        Path::Arc(mut arc) => {
            // Lengthwise the rise takes it up. In the plane, turn and size change such that the end stays: chord and angle make a circle.
            let d = place - arc.from;
            let up = d.dot(arc.normal);
            let end = Path::Arc(arc).end();
            let chord = arc.from - (end - arc.normal * arc.rise);
            let flat = arc.normal * up;
            let moved = place - flat - (end - arc.normal * arc.rise);
            // A nearly closed circle would be carried away by many times the gap; it is shifted as it is, and the next move closes the
            // rest.
            if chord.length() < SHORTEST_CHORD * arc.radius() {
                arc.centre = arc.centre + d;
                arc.from = place;
                return Path::Arc(arc);
            }
            // Rotation and scale that take the old chord to the new one, about the end.
            let (scale, sine) = (
                moved.dot(chord) / chord.dot(chord),
                arc.normal.dot(chord.cross(moved)) / chord.dot(chord),
            );
            let to_centre = arc.centre - (end - arc.normal * arc.rise);
            arc.centre = end - arc.normal * arc.rise + to_centre * scale + arc.normal.cross(to_centre) * sine + flat;
            arc.from = place;
            arc.rise -= up;
            Path::Arc(arc)
        }
        Path::Spline(mut spline) => {
            // The start of a clamped spline is its first pole; that of another one is a mean of as many poles as its degree.
            let d = place - Path::Spline(spline.clone()).start();
            let clamped = spline.knots[..=spline.degree].windows(2).all(|k| k[0] == k[1]);
            let count = if clamped { 1 } else { spline.degree };
            spline.poles.iter_mut().take(count).for_each(|p| *p = *p + d);
            Path::Spline(spline)
        }
    }
}

/// A path cut at its inner corners, with the parameters of each part: a spline whose knot is as multiple as its degree may turn there.
pub(crate) fn smooth_parts(path: &Path<Setup>) -> Vec<(Path<Setup>, [f64; 2])> {
    let whole = || vec![(path.clone(), [0.0, 1.0])];
    let Path::Spline(spline) = path else { return whole() };
    let degree = spline.degree;
    let (low, high) = (spline.knots[degree], spline.knots[spline.poles.len()]);
    let mut parts = vec![];
    let (mut poles, mut knots, mut from) = (0, spline.knots[..=degree].to_vec(), low);
    let mut k = degree + 1;
    while k < spline.knots.len() {
        let knot = spline.knots[k];
        let after = k + spline.knots[k..].iter().take_while(|other| **other == knot).count();
        if knot > from && knot < high && after - k >= degree {
            let mut inner = knots.clone();
            inner.extend(std::iter::repeat_n(knot, degree + 1));
            parts.push((
                part(spline, poles..k, inner),
                [(from - low) / (high - low), (knot - low) / (high - low)],
            ));
            poles = after - degree - 1;
            knots = vec![knot; degree + 1];
            from = knot;
        } else {
            knots.extend(&spline.knots[k..after]);
        }
        k = after;
    }
    if parts.is_empty() {
        return whole();
    }
    parts.push((
        part(spline, poles..spline.poles.len(), knots),
        [(from - low) / (high - low), 1.0],
    ));
    parts
}

fn part(spline: &Spline<Setup>, poles: std::ops::Range<usize>, knots: Vec<f64>) -> Path<Setup> {
    Path::Spline(Spline {
        degree: spline.degree,
        weights: spline.weights.get(poles.clone()).map_or(vec![], <[f64]>::to_vec),
        poles: spline.poles[poles].to_vec(),
        knots,
    })
}

/// A speed profile over the path's parameter instead of its length.
pub(crate) fn over_parameter(profile: &SpeedProfile, path: &Path<Setup>, length: f64) -> Vec<(f64, f64)> {
    let points = profile.points.iter().copied();
    let Path::Spline(spline) = path else { return points.collect() };
    // Length at equal parameters, many for each span; between them length and parameter are nearly proportional.
    let count = 64 * (spline.poles.len() - spline.degree);
    let mut table = vec![(0.0, 0.0)];
    for k in 1..=count {
        let (before, u) = ((k - 1) as f64 / count as f64, k as f64 / count as f64);
        let (_, sum) = table[k - 1];
        table.push((u, sum + spline.length_between(before, u) / length));
    }
    let total = table[count].1;
    let share = |s: f64| s * total;
    let inverse = |s: f64| {
        let after = table.partition_point(|t| t.1 < share(s)).clamp(1, count);
        let (a, b) = (table[after - 1], table[after]);
        a.0 + (b.0 - a.0) * ((share(s) - a.1) / (b.1 - a.1).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    };
    let mut along: Vec<(f64, f64)> = vec![];
    for (s, factor) in points {
        // The factor is linear in the length and so not in the parameter: follow it over the table.
        if let (Some(last), true) = (along.last().copied(), s > 0.0) {
            let u = inverse(s.min(1.0));
            let inner = table.iter().filter(|t| t.0 > last.0 && t.0 < u);
            let inner: Vec<(f64, f64)> = inner.map(|t| (t.0, profile.factor(t.1 / total))).collect();
            along.extend(inner);
        }
        along.push((inverse(s.clamp(0.0, 1.0)), factor));
    }
    along
}

/// A feed that follows the radius, as points with straight lines between them.
pub(crate) fn looked_at(at: &dyn Fn(f64) -> f64) -> Vec<(f64, f64)> {
    fn halve(at: &dyn Fn(f64) -> f64, a: (f64, f64), b: (f64, f64), depth: u8, points: &mut Vec<(f64, f64)>) {
        let middle = (a.0 + b.0) / 2.0;
        let m = (middle, at(middle));
        if depth > 0 && ((a.1 + b.1) / 2.0 - m.1).abs() > FEED_ERROR * m.1 {
            halve(at, a, m, depth - 1, points);
            halve(at, m, b, depth - 1, points);
        } else {
            points.push(b);
        }
    }
    let look = |k: u32| {
        let u = f64::from(k) / f64::from(FEED_LOOKS);
        (u, at(u))
    };
    let mut points = vec![look(0)];
    for k in 0..FEED_LOOKS {
        halve(at, look(k), look(k + 1), FEED_HALVINGS, &mut points);
    }
    points
}

/// Two multipliers at once: at the points of both; between them their product bends upwards or downwards, so it is looked at more often.
pub(crate) fn product(steps: &[(f64, f64)], smooth: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let value = |points: &[(f64, f64)], u: f64| SpeedProfile { points: points.to_vec() }.factor(u);
    let mut all: Vec<(f64, f64)> = steps.iter().map(|(u, f)| (*u, f * value(smooth, *u))).collect();
    let others = smooth.iter().map(|p| p.0).chain((0..=64).map(|k| f64::from(k) / 64.0));
    all.extend(
        others
            .filter(|u| steps.iter().all(|p| p.0 != *u))
            .map(|u| (u, value(steps, u) * value(smooth, u))),
    );
    // Stable: the two points of a step stay in their order.
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

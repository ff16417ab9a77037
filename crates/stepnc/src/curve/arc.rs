//! Arcs from three points, and from a circle with its ends.

use super::*;

/// The arc from `a` over the via points to `c`; the full circle when `a` and `c` coincide. `None` when they lie on a line.
pub(super) fn arc_through(a: P, via: &[P], c: P) -> Option<Arc<Setup>> {
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
pub(super) fn angle_between(a: V, b: V, normal: V) -> f64 {
    let angle = libm::atan2(normal.dot(a.cross(b)), a.dot(b));
    if angle <= 0.0 { angle + TAU } else { angle }
}

pub(super) fn distance_from_axis(arc: &Arc<Setup>, place: P) -> f64 {
    let out = place - arc.centre;
    (out - arc.normal * out.dot(arc.normal)).length()
}

pub(super) fn circle_arc(
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

/// Part of a helix: how often it goes round follows from the height and the pitch.
pub(super) fn helix(
    id: u64,
    frame: &Transform<Setup, Setup>,
    radius: f64,
    pitch: f64,
    from: P,
    to: P,
    sense: bool,
) -> Result<Path<Setup>, Fault> {
    let normal = *frame * Vector::<Setup>::Z;
    let foot = Point::from_xyz(frame.origin);
    let height = |place: P| (place - foot).dot(normal);
    let centre = foot + normal * height(from);
    let rise = height(to) - height(from);
    let flat_end = to - normal * rise;
    for (place, which) in [(from, "first"), (flat_end, "second")] {
        let off = ((place - centre).length() - radius).abs();
        if off.is_nan() || off > FIT_TOLERANCE.0 {
            let message = format!("the {which} trim point of a helix lies {off:.4} mm off its cylinder");
            return Err(Fault::new(id, "arc-radius", message, CURVE_REMEDY));
        }
    }
    // Rounded end points: move the centre along the chord so that both lie on one cylinder.
    let centre = match (flat_end - from).unit() {
        Some(along) => centre + along * (from.toward(flat_end, 0.5) - centre).dot(along),
        None => centre,
    };
    let part = match sense {
        true => angle_between(from - centre, flat_end - centre, normal),
        false => angle_between(flat_end - centre, from - centre, normal),
    };
    let wanted = if pitch.abs() > 0.0 { (rise / pitch).abs() * TAU } else { part };
    let turns = libm::round((wanted - part) / TAU).max(0.0);
    let sweep = part + turns * TAU;
    // A pitch that is rounded in its last digit is as good as one that is not; another number of turns is another helix.
    let off = (sweep - wanted).abs() / TAU * pitch.abs();
    if !sweep.is_finite() || turns > MOST_TURNS || off > FIT_TOLERANCE.0 {
        let message = format!("a helix of pitch {pitch:.4} mm misses its second trim point by {off:.4} mm of height");
        return Err(Fault::new(id, "helix-pitch", message, "correct the pitch or the trim points"));
    }
    Ok(Path::Arc(Arc {
        from,
        centre,
        normal,
        sweep: Radians(if sense { sweep } else { -sweep }),
        rise,
    }))
}

/// Turns of one helix, at most.
const MOST_TURNS: f64 = 1e6;

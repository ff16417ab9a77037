//! Plain triples, for the inner loops where the frame is the same for all: the frame is named at the border.

pub(crate) type V3 = [f64; 3];

pub(crate) fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
pub(crate) fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
pub(crate) fn scale(a: V3, k: f64) -> V3 {
    [a[0] * k, a[1] * k, a[2] * k]
}
pub(crate) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
pub(crate) fn length(a: V3) -> f64 {
    dot(a, a).sqrt()
}
pub(crate) fn distance(a: V3, b: V3) -> f64 {
    length(sub(a, b))
}
pub(crate) fn toward(a: V3, b: V3, t: f64) -> V3 {
    add(a, scale(sub(b, a), t))
}

/// Fraction of the way from `a` along `d` that is nearest to `p`, within 0..=1, and the squared distance there.
pub(crate) fn nearest_on_chord(p: V3, a: V3, d: V3) -> (f64, f64) {
    let square = dot(d, d);
    let t = if square > 0.0 {
        (dot(sub(p, a), d) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let rest = sub(p, add(a, scale(d, t)));
    (t, dot(rest, rest))
}

/// The value below which the fraction `share` of the values lies; the values are reordered. 0 for none.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share.clamp(0.0, 1.0)).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

//! Three numbers, one an axis.

pub(super) type V3 = [f64; 3];

pub(super) fn minus(a: V3, b: V3) -> V3 {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(super) fn scaled(a: V3, by: f64) -> V3 {
    a.map(|c| c * by)
}

pub(super) fn add_scaled(to: &mut V3, a: V3, by: f64) {
    for k in 0..3 {
        to[k] += a[k] * by;
    }
}

pub(super) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn length(a: V3) -> f64 {
    libm::sqrt(dot(a, a))
}

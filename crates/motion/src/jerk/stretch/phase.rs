//! A part of the planned motion: how the path goes with time inside one interval of the grid, in closed form.

use super::super::limits::{Begin, Interval, Window};

/// A part of the planned motion.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Phase {
    /// Where it begins and its length, mm.
    pub(in super::super) s: f64,
    pub(in super::super) width: f64,
    pub(in super::super) law: Law,
    /// Duration, s.
    pub(in super::super) time: f64,
    /// The coefficient of b in its interval.
    value: f64,
    /// The multiplier of the programmed feeds that it was planned with.
    pub(in super::super) feed_scale: f64,
}

/// How s goes in a phase.
#[derive(Clone, Copy, Debug)]
pub(in super::super) enum Law {
    /// b is quadratic: the second derivative of s by time is g + h (s - start); begins with this speed.
    Quadratic {
        speed: f64,
        g: f64,
        h: f64,
    },
    /// From rest, or to rest, at this constant third derivative.
    FromRest(f64),
    ToRest(f64),
}

/// The motion in interval `i` that begins at `s`.
pub(super) fn phase(window: &Window<'_>, i: usize, s: f64, at_end: bool, feed_scale: f64) -> Phase {
    let n = window.intervals.len();
    let Interval { width, value, .. } = window.intervals[i];
    if i == 0 && window.begin == Begin::Rest {
        let v = libm::sqrt(window.motion(1).b);
        let time = 3.0 * width / v;
        return Phase {
            s,
            width,
            law: Law::FromRest(6.0 * width / (time * time * time)),
            time,
            value,
            feed_scale,
        };
    }
    if i + 1 == n && at_end {
        let v = libm::sqrt(window.motion(n - 1).b);
        let time = 3.0 * width / v;
        return Phase {
            s,
            width,
            law: Law::ToRest(6.0 * width / (time * time * time)),
            time,
            value,
            feed_scale,
        };
    }
    let (here, next) = (window.motion(i), window.motion(i + 1));
    let h = (next.g - here.g) / width;
    let (v, end) = (libm::sqrt(here.b), libm::sqrt(next.b));
    let law = Law::Quadratic { speed: v, g: here.g, h };
    let mut time = 2.0 * width / (v + end);
    for _ in 0..30 {
        let (x, speed, _) = law.at(time);
        let change = (width - x) / speed.max(1e-3 * v.min(end));
        time += change;
        if change.abs() <= 1e-15 * time {
            break;
        }
    }
    Phase {
        s,
        width,
        law,
        time,
        value,
        feed_scale,
    }
}

impl Law {
    /// Length, speed and acceleration after a time in the phase; to rest, length is counted from the phase's beginning too.
    pub(in super::super) fn at(&self, t: f64) -> (f64, f64, f64) {
        match *self {
            Law::Quadratic { speed, g, h } => {
                let z = h * t * t;
                // sinh(sqrt z)/sqrt z, and (cosh(sqrt z) - 1)/z; for negative z the same series is sin and cos.
                let (sine, cosine) = if z.abs() < 1.0 {
                    let mut term = 1.0;
                    let (mut sine, mut cosine) = (0.0, 0.0);
                    let mut k = 1.0;
                    while k < 24.0 {
                        sine += term;
                        cosine += term / (k + 1.0);
                        term *= z / ((k + 1.0) * (k + 2.0));
                        k += 2.0;
                    }
                    (sine, cosine)
                } else if z > 0.0 {
                    let w = libm::sqrt(z);
                    (libm::sinh(w) / w, (libm::cosh(w) - 1.0) / z)
                } else {
                    let w = libm::sqrt(-z);
                    (libm::sin(w) / w, (libm::cos(w) - 1.0) / z)
                };
                let x = speed * t * sine + g * t * t * cosine;
                (x, speed * (1.0 + z * cosine) + g * t * sine, g + h * x)
            }
            Law::FromRest(j) => (j * t * t * t / 6.0, 0.5 * j * t * t, j * t),
            Law::ToRest(j) => (j * t * t * t / 6.0, 0.5 * j * t * t, -j * t),
        }
    }
}

impl Phase {
    /// The interval that it was made of.
    pub(super) fn interval(&self) -> Interval {
        Interval {
            width: self.width,
            cap: f64::INFINITY,
            value: self.value,
            share: 1.0,
        }
    }

    /// Length from its beginning, speed and acceleration along the path, `t` after it began.
    pub(in super::super) fn at(&self, t: f64) -> (f64, f64, f64) {
        if let Law::ToRest(_) = self.law {
            let (left, speed, change) = self.law.at((self.time - t).max(0.0));
            (self.width - left, speed, change)
        } else {
            self.law.at(t)
        }
    }
}

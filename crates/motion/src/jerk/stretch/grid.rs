//! The grid on which a window is solved: its intervals are as wide as the speed and the bends allow.

use super::super::limits::{Border, Interval};
use super::forward;
use super::window::Ahead;
use super::{CRUISE, Cell, FIRST, GROWTH, INTERVAL, MOST_INTERVALS, Stretch};

/// Share of an interval by which two places may differ that are the same: a last digit of a coordinate must not make another grid.
const HAIR: f64 = 1e-6;

/// Intervals that a window is to plan for good where the override has changed: it may change again, and all of them are solved again with
/// it. Elsewhere a window is as long as it may be: two programs that differ by a last digit are alike only within one window.
const AT_ONCE_AGAIN: usize = 400;

/// Intervals at least behind these.
const LEAST_BEHIND: usize = 64;

/// How much more of the grid than a rest at its end slows down is laid, so that one round is enough.
const ROOM: f64 = 1.5;

impl Stretch {
    /// Lays borders of the grid as far as the end of what is known has no influence; all the way when it is the end of the stretch.
    pub(super) fn lay_grid(&mut self, crowded: bool) {
        let n = self.sights.len();
        if n < 2 {
            return;
        }
        let to = if self.closed || crowded {
            self.sights[n - 1].s
        } else {
            let free = (0..n)
                .rev()
                .find(|i| self.sights[*i].ending >= self.sights[*i].open * (1.0 - 1e-9) && self.sights[*i].open > 0.0);
            free.map_or(self.grid_end, |i| self.sights[i].s)
        };
        if self.grid.is_empty() {
            let cell = self.cell(0.0, 0.0);
            self.grid.push_back(cell);
            self.grid_end = 0.0;
        }
        // The last cell is the end of the grid.
        let (start, end) = (self.sights[0].s, self.sights[n - 1].s);
        let total = end - start;
        let mut i = 0;
        let mut s = self.grid_end;
        let most = if self.fineness > 1.0 { usize::MAX } else { MOST_INTERVALS };
        // A window longer than it needs to be is solved no better, and all of it again at each change of the override.
        let at_once = match self.replanned {
            _ if self.fineness > 1.0 => usize::MAX,
            true => AT_ONCE_AGAIN,
            false => usize::MAX,
        };
        let mut ahead = Ahead::behind(self.grid.iter().skip(at_once));
        while s < to && self.grid.len() < most {
            if self.grid.len() > at_once.saturating_add(LEAST_BEHIND) && ahead.is_enough(ROOM * self.patience) {
                break;
            }
            while i + 2 < n && self.sights[i + 1].s <= s + HAIR * (self.sights[i + 1].s - self.sights[i].s) {
                i += 1;
            }
            let width = self.width_at(i, s, to, total).max(forward(s));
            let hair = HAIR * width;
            let mut next = s + width;
            // Not over a place that has to be a border, and nothing tiny before it.
            let mut m = i + 1;
            while m < n {
                let other = &self.sights[m];
                if other.s > next + 0.5 * width + hair {
                    break;
                }
                if (other.border || m + 1 == n || other.s >= to) && other.s > s {
                    next = if other.s > next + hair {
                        s + 0.5 * (other.s - s)
                    } else {
                        other.s
                    };
                    break;
                }
                m += 1;
            }
            let next = next.min(to);
            let (y, _) = {
                let mut m = i;
                while m + 2 < n && self.sights[m + 1].s <= next + hair {
                    m += 1;
                }
                Self::between(&self.sights[m], &self.sights[m + 1], next)
            };
            let mut cell = self.cell(next, libm::cbrt(y) * y);
            let behind = self.grid.back_mut().expect("it begins with one");
            behind.interval.width = next - s;
            let mut cap = f64::INFINITY;
            for sight in self.sights.range(i..).take_while(|sight| sight.s < next - hair) {
                cap = cap.min(sight.cap_behind);
            }
            let mut before = *behind;
            before.interval.share = 1.0;
            self.cap(&mut before, &mut cell, cap);
            *self.grid.back_mut().expect("it begins with one") = before;
            if self.grid.len() > at_once {
                ahead.add(&before, &cell);
            }
            self.grid.push_back(cell);
            s = next;
        }
        self.grid_end = s;
    }

    /// The feed of an interval: `cap` is the square of the slowest one in it.
    ///
    /// The feed is that of the path; where the curve cuts a corner s runs a little faster than the path.
    pub(super) fn cap(&self, behind: &mut Cell, cell: &mut Cell, cap: f64) {
        let speed = |c: &Cell| {
            let along = c.border.acceleration.iter().zip(&self.a_max).map(|(r, a)| r[1] * a);
            along.map(|q| q * q).sum::<f64>().max(1e-18)
        };
        let (first, second) = (speed(behind), speed(cell));
        behind.interval.cap = (cap / first.max(second)).min(behind.border.cap.max(cell.border.cap));
        cell.border.cap = cell.border.cap.min(cap / second);
        behind.border.cap = behind.border.cap.min(cap / first);
    }

    /// How wide an interval may be that begins at `s` behind sight `i`.
    fn width_at(&self, i: usize, s: f64, to: f64, total: f64) -> f64 {
        let n = self.sights.len();
        let wide = |i: usize, s: f64| {
            let (a, b) = (&self.sights[i], &self.sights[i + 1]);
            let (y, slope) = Self::between(a, b, s);
            let v = libm::cbrt(y);
            let v = v * v;
            let steady = (a.steady + slope * (s - a.s)).min(b.steady + slope * (b.s - s)).max(y);
            let interval = INTERVAL / self.fineness;
            let time = (interval * steady / y.max(1e-30)).clamp(interval, CRUISE / self.fineness);
            (v * time).min(GROWTH / self.fineness * steady / slope).min(a.detail)
        };
        let rest = FIRST / self.fineness;
        let first = {
            let (a, b) = (&self.sights[0], &self.sights[1]);
            (a.jerk.min(b.jerk) * rest * rest * rest / 6.0).min(total / 300.0)
        };
        // The last interval has a constant jerk of s, so it must not be wider than the bends there.
        let mut last = first;
        for (a, b) in self.sights.iter().zip(self.sights.iter().skip(1)).rev() {
            if b.s <= to - last {
                break;
            }
            last = last.min(a.detail.max(to - b.s));
        }
        if self.closed && to - s <= 1.5 * last {
            return if to - s <= 1.01 * last { to - s } else { 0.5 * (to - s) };
        }
        let here = wide(i, s);
        // From rest.
        let mut width = if here <= 0.0 || (s == 0.0 && !self.moving && self.grid.len() == 1) {
            let (a, b) = (&self.sights[i], &self.sights[i + 1]);
            (a.jerk.min(b.jerk) * rest * rest * rest / 6.0)
                .min(total / 300.0)
                .min(a.detail)
        } else {
            here
        };
        // Where the speed falls the end of the interval decides.
        for _ in 0..3 {
            let mut m = i;
            let end = s + width;
            let mut narrow = width;
            while m + 2 < n && self.sights[m + 1].s <= end + HAIR * width {
                m += 1;
                narrow = narrow.min(self.sights[m].detail.max(self.sights[m].s - s));
            }
            let there = wide(m, end.min(self.sights[n - 1].s));
            let closing = if self.closed {
                (to - end).max(0.0).max(last)
            } else {
                f64::INFINITY
            };
            let by_speed = there.max(last.min(closing)).max(0.2 * here.min(width));
            narrow = narrow.min(by_speed);
            if narrow >= width {
                break;
            }
            width = narrow;
        }
        width
    }

    /// The limits at a border of the grid.
    pub(super) fn cell(&self, s: f64, estimate: f64) -> Cell {
        let k = self.course.span_at(s).min(self.course.len().saturating_sub(1));
        let ([_, q1, q2, q3], before) = self.course.sides(k, s);
        let mut cap = f64::INFINITY;
        let mut border = Border::default();
        for axis in 0..3 {
            let (v, a, j) = (self.v_max[axis], self.a_max[axis], self.j_max[axis]);
            let over = v / q1[axis].abs().max(1e-9);
            cap = cap.min(over * over);
            border.acceleration[axis] = [q2[axis] / a, q1[axis] / a];
            border.third_before[axis] = before[axis] / j;
            border.jerk[axis] = [q3[axis] / j, 3.0 * q2[axis] / j, q1[axis] / j];
        }
        border.cap = cap;
        Cell {
            s,
            border,
            interval: Interval::default(),
            estimate,
            feed_scale: self.feed_scale,
        }
    }
}

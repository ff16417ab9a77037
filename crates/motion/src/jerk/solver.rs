//! The fastest speed along a window of the curve, under limits of speed, acceleration and jerk of every axis.
//!
//! Unknown is b(s) = (ds/dt)^2, a quadratic B-spline with one coefficient for each interval of a grid. With g = b'/2 and h = b''/2 axis k
//! has the speed q'_k sqrt(b), the acceleration q''_k b + q'_k g, and the jerk (q'''_k b + 3 q''_k g + q'_k h) sqrt(b) (Verscheure and
//! others 2009; for the jerk Debrouwere and others 2013). The time, the integral of b^(-1/2), is convex in b; only the factor sqrt(b) of the
//! jerk is not, and it is made linear at each step: |q''' b + ...| <= j b^(-1/2), whose right side is convex, so that its tangent is on the
//! safe side: the length of a step that keeps every limit follows from the tangents, and is not searched for.
//!
//! The solution goes through the interior: Newton's method on the time and a logarithmic barrier that shrinks, with the multipliers of the
//! limits kept beside the values. Every step keeps what was kept before, so that the search can end at any step; the matrix has five
//! diagonals ([`Matrix`]), so that a step costs the same for each interval.
//!
//! At a rest the speed begins as s^(2/3), which no polynomial is: the first and the last interval of a stretch have a constant jerk of s.

use super::limits::{Begin, Border, Motion, Window, tie};
use super::matrix::{Local, Maps, Matrix};

/// Largest number of Newton steps; a window takes some twenty.
const MOST_STEPS: usize = 160;

/// Share of itself that a limit has as room at first where the guess exceeds it.
const SLACK: f64 = 0.1;

/// Share of the way to the nearest limit that a step goes at most.
const NEAR: f64 = 0.97;

/// Short steps after which a search from above the limits is given up.
const STALLED: u32 = 4;

/// One number for each limit at a border and in the interval behind it: two caps, then the three axes' acceleration upwards and downwards,
/// then their jerk at the first and at the second end of the interval, each upwards and downwards.
type Each = [f64; 20];
const ACCELERATION: usize = 2;
const JERK: [usize; 2] = [8, 14];

/// What a search needs beside the window; kept from one to the next, so that a search can go on where it ended.
#[derive(Debug, Default)]
pub(super) struct Search {
    motions: Vec<Motion>,
    /// b^(-1/2) at each border.
    roots: Vec<f64>,
    /// One over the room that each limit leaves, and its multiplier.
    over: Vec<Each>,
    prices: Vec<Each>,
    /// How each room grows with the step at hand.
    growth: Vec<Each>,
    /// What is missing of the rooms that limits are given which are exceeded: 0 or less.
    missing: Vec<Each>,
    feasible: bool,
    step: Vec<f64>,
    matrix: Matrix,
    /// The largest share of itself that a value loses with the step at hand.
    positive: f64,
    /// Axes that move at all.
    axes: Vec<usize>,
    /// Newton steps made in all, each times the intervals that it went over.
    pub(super) work: u64,
}

/// Where a search begins and ends: the barrier as a share of the mean time of an interval, and what is kept of the last search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Again {
    pub(super) first: f64,
    pub(super) last: f64,
    /// Share of itself that a limit has as room at first where the guess exceeds it.
    pub(super) slack: f64,
    /// The multipliers are those of the search before.
    pub(super) kept: bool,
}

/// From a guess far below the limits.
pub(super) const COLD: Again = Again {
    first: 0.1,
    last: 2e-4,
    slack: SLACK,
    kept: false,
};

impl Again {
    /// From a solution whose limits have become a little less.
    pub(super) const ROUND: Again = Again {
        first: 4e-3,
        last: 2e-4,
        slack: 0.003,
        kept: true,
    };
    /// From a little below a solution.
    pub(super) const BELOW: Again = Again {
        first: 1e-2,
        last: 2e-4,
        slack: 0.01,
        kept: false,
    };
}

impl Search {
    /// Makes the intervals' values the fastest ones within the limits, from the guess in them; `false` if a limit is still exceeded.
    ///
    /// Where the guess exceeds a limit, the limit is given a room that it does not have, and each step takes as much of the difference away
    /// as it has length.
    pub(super) fn run(&mut self, window: &mut Window<'_>, again: Again) -> bool {
        let n = window.count();
        self.begin(window, again.slack);
        let mut time = self.time(window);
        let mut barrier_share = again.first;
        let (mut fresh, mut growing) = (!again.kept, true);
        let (mut full, mut stalled) = (0, 0);
        for _ in 0..MOST_STEPS {
            let unit = time / n as f64;
            self.price(barrier_share * unit, fresh);
            self.assemble(window, barrier_share * unit);
            self.fold(window);
            self.matrix.solve();
            if !fresh && barrier_share > again.last {
                // How far the step without a barrier would get says how much of it is still needed.
                self.direct(window, 0.0);
                let (along, prices) = self.room(0.0);
                let short = 1.0 - along.min(prices).min(1.0);
                let product = self.product() / unit;
                barrier_share = (product * short * short * short)
                    .clamp(0.05 * barrier_share, barrier_share)
                    .max(again.last);
            }
            let barrier = barrier_share * unit;
            self.direct(window, barrier);
            let (along, prices) = self.room(barrier);
            // Far below the limits Newton's step is too small by a factor.
            let share = along.min(if growing && self.feasible { 8.0 } else { 1.0 });
            for (interval, step) in window.intervals.iter_mut().zip(&self.step) {
                interval.value += share * step;
            }
            window.tie_ends();
            self.move_prices(barrier, prices.min(1.0));
            if self.feasible {
                self.measure(window);
            } else {
                self.approach(window, share);
                stalled += u32::from(share < 0.1);
                if stalled > STALLED && !self.feasible {
                    return false;
                }
            }
            let now = self.time(window);
            fresh = !again.kept && share >= 0.6 && now < 0.85 * time;
            growing = share >= 0.8 && now < 0.94 * time;
            let settled = (now - time).abs() < 1e-7 * now;
            time = now;
            self.work += n as u64;
            full = if share >= 0.9 && barrier_share <= again.last {
                full + 1
            } else {
                0
            };
            if self.feasible && (full >= 8 || (full >= 1 && settled)) {
                break;
            }
        }
        self.feasible
    }

    fn begin(&mut self, window: &mut Window<'_>, slack: f64) {
        let n = window.count();
        window.tie_ends();
        self.prices.resize(n, [1.0; 20]);
        self.over.resize(n, [1.0; 20]);
        self.growth.resize(n, [0.0; 20]);
        self.step.resize(n, 0.0);
        self.motions.resize(n, Motion::default());
        self.roots.resize(n, 1.0);
        self.axes.clear();
        let moves = |k: &usize| {
            let rows = |b: &Border| b.jerk[*k] != [0.0; 3] || b.acceleration[*k] != [0.0; 2] || b.third_before[*k] != 0.0;
            window.borders.iter().any(rows)
        };
        self.axes.extend((0..3).filter(moves));
        // Of the axes that stand still, and behind the last border.
        self.over.iter_mut().for_each(|over| *over = [1.0; 20]);
        self.measure(window);
        // What is exceeded gets a room.
        let mut feasible = true;
        self.missing.clear();
        self.missing.resize(n, [0.0; 20]);
        for i in 1..n {
            let whole = self.whole(window, i);
            let (over, missing) = (&mut self.over[i], &mut self.missing[i]);
            for at in 0..20 {
                let (room, least) = (1.0 / over[at], slack * whole[at]);
                if !(room > 1e-7 * whole[at] && room.is_finite()) {
                    over[at] = 1.0 / least;
                    missing[at] = room - least;
                    feasible = false;
                }
            }
        }
        self.feasible = feasible;
    }

    /// What the rooms at border `i` are parts of.
    fn whole(&self, window: &Window<'_>, i: usize) -> Each {
        let mut whole = [1.0; 20];
        whole[0] = window.borders[i].cap;
        whole[1] = window.intervals[i].cap;
        for (end, at) in JERK.into_iter().enumerate() {
            let root = self.roots.get(i + end).copied().unwrap_or(1.0);
            whole[at..at + 6].fill(root);
        }
        whole
    }

    /// Looks at the rooms behind a step of this length: what was missing is less by as much.
    fn approach(&mut self, window: &Window<'_>, share: f64) {
        let n = window.count();
        let before = self.over.clone();
        self.measure(window);
        self.feasible = true;
        for i in 1..n {
            let whole = self.whole(window, i);
            for at in 0..20 {
                let room = 1.0 / self.over[i][at];
                let given = 1.0 / before[i][at] + share * self.growth[i][at];
                let missing = &mut self.missing[i][at];
                *missing = 0.0;
                if room < given * (1.0 - 1e-6) && (room < 1e-7 * whole[at] || before[i][at] * room < 0.03) {
                    *missing = room - given;
                    self.over[i][at] = 1.0 / given;
                    self.feasible = false;
                }
            }
        }
    }

    /// The mean of multiplier times room.
    fn product(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (prices, over) in self.prices.iter().zip(&self.over).skip(1) {
            for at in [0, 1]
                .into_iter()
                .chain(self.axes.iter().flat_map(|k| [2, 5, 8, 11, 14, 17].map(|a| a + k)))
            {
                sum += prices[at] / over[at];
                count += 1.0;
            }
        }
        sum / count
    }

    fn time(&self, window: &Window<'_>) -> f64 {
        window
            .intervals
            .iter()
            .zip(&self.roots)
            .skip(1)
            .map(|(i, root)| i.width * root)
            .sum()
    }

    /// Looks at the room that the values leave.
    fn measure(&mut self, window: &Window<'_>) {
        let n = window.count();
        for i in 1..n {
            let motion = window.motion(i);
            self.motions[i] = motion;
            self.roots[i] = 1.0 / libm::sqrt(motion.b.max(1e-300));
        }
        for i in 1..n {
            let (border, interval) = (&window.borders[i], &window.intervals[i]);
            let here = self.motions[i];
            let over = &mut self.over[i];
            over[0] = 1.0 / (border.cap - here.b);
            over[1] = 1.0 / (interval.cap - interval.value);
            let most = interval.share;
            for k in &self.axes {
                let row = border.acceleration[*k];
                let load = row[0] * here.b + row[1] * here.g;
                let (up, down) = (most - load, most + load);
                let both = most / (up * down);
                over[ACCELERATION + k] = down * both;
                over[ACCELERATION + 3 + k] = up * both;
            }
            if i + 1 < n {
                let next = self.motions[i + 1];
                let h = (next.g - here.g) / interval.width;
                for (end, motion) in [here, next].into_iter().enumerate() {
                    let root = self.roots[i + end];
                    let most = interval.share;
                    let root = root * most;
                    for k in &self.axes {
                        let row = window.borders[i + end].jerk_row(end, *k);
                        let load = row[0] * motion.b + row[1] * motion.g + row[2] * h;
                        let (up, down) = (root - load, root + load);
                        let both = most / (up * down);
                        over[JERK[end] + k] = down * both;
                        over[JERK[end] + 3 + k] = up * both;
                    }
                }
            }
        }
    }

    /// Keeps multipliers in sight of what the barrier makes of them; `fresh` ones are that.
    fn price(&mut self, barrier: f64, fresh: bool) {
        for (prices, over) in self.prices.iter_mut().zip(&self.over).skip(1) {
            for (price, over) in prices.iter_mut().zip(over) {
                let middle = barrier * over;
                *price = if fresh {
                    middle
                } else {
                    price.max(middle * 1e-3).min(middle * 1e3)
                };
            }
        }
    }

    /// Gradients and matrix of time and barrier.
    fn assemble(&mut self, window: &Window<'_>, barrier: f64) {
        let n = window.count();
        self.matrix.clear(n);
        let axes = &self.axes[..];
        let mut e = 1.0 / (window.intervals[0].width + window.intervals[1].width);
        for i in 1..n {
            let (a, interval) = (&window.intervals[i - 1], &window.intervals[i]);
            let (border, over, prices, missing) = (&window.borders[i], &self.over[i], &self.prices[i], &self.missing[i]);
            let root = self.roots[i];
            let mut local = Local::default();
            // The time. An interval with constant jerk takes 3 width / speed.
            let rest_before = if i == 1 && window.begin == Begin::Rest { 3.0 } else { 0.5 };
            let rest_behind = if i == n - 1 { 3.0 } else { 0.5 };
            let weight = rest_before * a.width + rest_behind * interval.width;
            let over_b = root * root;
            let slow = root * over_b;
            local.time[0] = -0.5 * weight * slow;
            local.gradient[0] = over[0];
            local.matrix[0] = 0.75 * weight * slow * over_b + prices[0] * over[0];
            let scale = 1.0 / interval.share;
            for k in axes {
                let row = border.acceleration[*k];
                let (x, y) = (row[0] * scale, row[1] * scale);
                let (p, m) = (over[ACCELERATION + k], over[ACCELERATION + 3 + k]);
                let first = p - m;
                let second = prices[ACCELERATION + k] * p + prices[ACCELERATION + 3 + k] * m;
                local.gradient[0] += first * x;
                local.gradient[1] += first * y;
                if !self.feasible {
                    let (up, down) = (ACCELERATION + k, ACCELERATION + 3 + k);
                    let push = missing[down] * prices[down] * m - missing[up] * prices[up] * p;
                    local.time[0] += push * x;
                    local.time[1] += push * y;
                }
                local.matrix[0] += second * x * x;
                local.matrix[1] += second * x * y;
                local.matrix[3] += second * y * y;
            }
            if !self.feasible {
                local.time[0] -= missing[0] * prices[0] * over[0];
                self.matrix.right[i][0] -= missing[1] * prices[1] * over[1];
            }
            // The coefficient itself.
            let value = 1.0 / interval.value;
            self.matrix.right[i][1] += over[1] - 0.01 * value;
            self.matrix.diagonal[i] += prices[1] * over[1] + barrier * 0.01 * value * value;
            // What the coefficients make of b and g here.
            let p = interval.width * e;
            if i + 1 < n {
                let next_e = 1.0 / (interval.width + window.intervals[i + 1].width);
                let over_width = 1.0 / interval.width;
                let h = [e * over_width, -(e + next_e) * over_width, next_e * over_width];
                let maps = Maps {
                    b: [p, 1.0 - p, 0.0],
                    g: [-e, e, 0.0],
                    h,
                };
                let jerk = |local: &mut Local, end: usize| {
                    let fall = -0.5 * self.roots[i + end] * self.roots[i + end] * self.roots[i + end];
                    let over_b = self.roots[i + end] * self.roots[i + end];
                    let scale = 1.0 / interval.share;
                    let at = JERK[end];
                    for k in axes {
                        let row = window.borders[i + end].jerk_row(end, *k);
                        let (x, y, z) = (row[0] * scale, row[1] * scale, row[2] * scale);
                        let (p, m) = (over[at + k], over[at + 3 + k]);
                        let along = p - m;
                        let (pp, mm) = (prices[at + k] * p, prices[at + 3 + k] * m);
                        let both = pp + mm;
                        let mixed = (mm - pp) * fall;
                        local.gradient[0] += along * x - (p + m) * fall - over_b;
                        local.gradient[1] += along * y;
                        local.gradient[2] += along * z;
                        if !self.feasible {
                            let (pushed, pulled) = (-missing[at + k] * pp, -missing[at + 3 + k] * mm);
                            let push = pushed - pulled;
                            local.time[0] += push * x - (pushed + pulled) * fall;
                            local.time[1] += push * y;
                            local.time[2] += push * z;
                        }
                        local.matrix[0] += both * (x * x + fall * fall) + 2.0 * mixed * x + barrier * over_b * over_b;
                        local.matrix[1] += both * x * y + mixed * y;
                        local.matrix[2] += both * x * z + mixed * z;
                        local.matrix[3] += both * y * y;
                        local.matrix[4] += both * y * z;
                        local.matrix[5] += both * z * z;
                    }
                };
                jerk(&mut local, 0);
                self.matrix.add(i - 1, &local, &maps);
                let mut end = Local::default();
                jerk(&mut end, 1);
                let p = window.intervals[i + 1].width * next_e;
                let maps = Maps {
                    b: [0.0, p, 1.0 - p],
                    g: [0.0, -next_e, next_e],
                    h,
                };
                self.matrix.add(i - 1, &end, &maps);
                e = next_e;
            } else {
                self.matrix.add_two(i - 1, &local, [p, 1.0 - p], [-e, e]);
            }
        }
    }

    /// Takes the coefficients out of the equations that others determine.
    fn fold(&mut self, window: &Window<'_>) {
        let n = window.count();
        match window.begin {
            Begin::Rest => self
                .matrix
                .tie_first(tie(window.intervals[0].width, window.intervals[1].width)),
            Begin::Moving => {
                self.matrix.fix(0);
                self.matrix.fix(1);
            }
        }
        self.matrix
            .tie_last(tie(window.intervals[n - 1].width, window.intervals[n - 2].width));
        if window.begin == Begin::Moving && n - 2 <= 1 {
            self.matrix.fix(n - 2);
        }
    }

    /// The step with this barrier, and how the room of each limit grows with it.
    fn direct(&mut self, window: &Window<'_>, barrier: f64) {
        let n = window.count();
        for (step, right) in self.step.iter_mut().zip(&self.matrix.right) {
            *step = -(right[0] + barrier * right[1]);
        }
        if window.begin == Begin::Rest {
            self.step[0] = tie(window.intervals[0].width, window.intervals[1].width) * self.step[1];
        }
        self.step[n - 1] = tie(window.intervals[n - 1].width, window.intervals[n - 2].width) * self.step[n - 2];
        let moved_at = |i: usize| {
            let (a, c) = (window.intervals[i - 1].width, window.intervals[i].width);
            let (x, y) = (self.step[i - 1], self.step[i]);
            let over = 1.0 / (a + c);
            Motion {
                b: (c * x + a * y) * over,
                g: (y - x) * over,
            }
        };
        let mut moved = moved_at(1);
        for i in 1..n {
            let (border, interval) = (&window.borders[i], &window.intervals[i]);
            let growth = &mut self.growth[i];
            growth[0] = -moved.b;
            growth[1] = -self.step[i];
            let scale = 1.0 / interval.share;
            for k in &self.axes {
                let row = border.acceleration[*k];
                let change = (row[0] * moved.b + row[1] * moved.g) * scale;
                growth[ACCELERATION + k] = -change;
                growth[ACCELERATION + 3 + k] = change;
            }
            if i + 1 < n {
                let next_moved = moved_at(i + 1);
                let h = (next_moved.g - moved.g) / interval.width;
                for (end, moved) in [moved, next_moved].into_iter().enumerate() {
                    let root = self.roots[i + end];
                    let fall = -0.5 * root * root * root * moved.b;
                    let scale = 1.0 / interval.share;
                    for k in &self.axes {
                        let row = window.borders[i + end].jerk_row(end, *k);
                        let change = (row[0] * moved.b + row[1] * moved.g + row[2] * h) * scale;
                        growth[JERK[end] + k] = fall - change;
                        growth[JERK[end] + 3 + k] = fall + change;
                    }
                }
                moved = next_moved;
            }
        }
        if !self.feasible {
            for (growth, missing) in self.growth.iter_mut().zip(&self.missing) {
                for (growth, missing) in growth.iter_mut().zip(missing) {
                    *growth += missing;
                }
            }
        }
        self.positive = 0.0;
        for (interval, step) in window.intervals.iter().zip(&self.step) {
            self.positive = f64::max(self.positive, -step / interval.value);
        }
    }

    /// How much of the step the values and the multipliers can go.
    fn room(&self, barrier: f64) -> (f64, f64) {
        let (mut nearest, mut price_nearest) = ([0.0f64; 2], [0.0f64; 2]);
        for ((over, growth), prices) in self.over.iter().zip(&self.growth).zip(&self.prices).skip(1) {
            for k in 0..10 {
                for lane in 0..2 {
                    let at = 2 * k + lane;
                    let shrinks = growth[at] * over[at];
                    nearest[lane] = larger(nearest[lane], -shrinks);
                    // Its change over itself.
                    let price = prices[at];
                    let change = (price - barrier * over[at]) + price * shrinks;
                    price_nearest[lane] = larger(price_nearest[lane], change / price);
                }
            }
        }
        let along = nearest[0].max(nearest[1]).max(self.positive / 0.98 * NEAR);
        let prices = price_nearest[0].max(price_nearest[1]);
        (NEAR / along.max(1e-9), NEAR / prices.max(1e-9))
    }

    /// Moves the multipliers by a share of their own step.
    fn move_prices(&mut self, barrier: f64, share: f64) {
        for ((over, growth), prices) in self.over.iter().zip(&self.growth).zip(&mut self.prices).skip(1) {
            for at in 0..20 {
                let change = barrier * over[at] - prices[at] - prices[at] * over[at] * growth[at];
                prices[at] += share * change;
            }
        }
    }
}

/// The larger of two numbers, the first one beside what is none: one instruction, where [`f64::max`] is three.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

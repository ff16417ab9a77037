//! The fastest speed along a window of the curve, under limits of speed, acceleration and jerk of every axis.
//!
//! Unknown is b(s) = (ds/dt)^2, a quadratic B-spline with one coefficient for each interval of a grid. With g = b'/2 and h = b''/2 axis k
//! has the speed q'_k sqrt(b), the acceleration q''_k b + q'_k g, and the jerk (q'''_k b + 3 q''_k g + q'_k h) sqrt(b) (Verscheure and
//! others 2009; for the jerk Debrouwere and others 2013). The time, the integral of b^(-1/2), is convex in b; only the factor sqrt(b) of the
//! jerk is not, and it is made linear at each step: |q''' b + ...| <= j b^(-1/2), whose right side is convex, so that its tangent is on the
//! safe side.
//!
//! The solution goes through the interior: Newton's method on the time and a logarithmic barrier that shrinks. Every step keeps what was
//! kept before, so that the search can end at any step; the matrix has five diagonals, so that a step costs the same for each interval.
//!
//! At a rest the speed begins as s^(2/3), which no polynomial is: the first and the last interval of a stretch have a constant jerk of s.

/// Rows of one border of the grid: what the axes' limits are, as multiples of (b, g) and of (b, g, h).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Border {
    /// Largest b.
    pub(super) cap: f64,
    /// q'' and q' of each axis over its acceleration limit.
    pub(super) acceleration: [[f64; 2]; 3],
    /// q''', 3 q'' and q' of each axis over its jerk limit.
    pub(super) jerk: [[f64; 3]; 3],
}

/// An interval of the grid.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Interval {
    /// Its width, mm.
    pub(super) width: f64,
    /// Largest b in it.
    pub(super) cap: f64,
    /// Its coefficient of b: first a guess, then the solution.
    pub(super) value: f64,
    /// How much less than the limits it may take, 1 or less: what lies between two borders is made up by it.
    pub(super) share: f64,
}

/// How the window begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Begin {
    /// At rest.
    Rest,
    /// The first two intervals are given: they determine speed and acceleration at the second border.
    Moving,
}

/// b, g and h of an interval at its first border, or of the last border.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub(super) b: f64,
    pub(super) g: f64,
}

/// Ratio of the first two coefficients where b begins as s^(4/3) over an interval of width `first`.
fn tie(first: f64, second: f64) -> f64 {
    1.0 / (3.0 + 2.0 * second / first)
}

/// Largest number of Newton steps; a window takes some twenty.
const MOST_STEPS: usize = 80;

/// The barrier at the start and at the end, as a share of the mean time of an interval.
const BARRIER_FIRST: f64 = 0.1;
const BARRIER_LAST: f64 = 2e-4;

/// A limit that the guess exceeds begins this much above it and comes down with it.
const SLACK: f64 = 1.15;

/// What is measured of a guess against its limits.
#[derive(Clone, Copy, Debug, Default)]
struct Loads {
    /// b at the border and in the interval behind it against their caps.
    cap: [f64; 2],
    acceleration: f64,
    /// At both ends of the interval behind the border.
    jerk: [f64; 2],
}

impl Loads {
    fn map2(self, other: Loads, f: impl Fn(f64, f64) -> f64) -> Loads {
        Loads {
            cap: [f(self.cap[0], other.cap[0]), f(self.cap[1], other.cap[1])],
            acceleration: f(self.acceleration, other.acceleration),
            jerk: [f(self.jerk[0], other.jerk[0]), f(self.jerk[1], other.jerk[1])],
        }
    }
    fn worst(&self) -> f64 {
        let [a, b] = self.cap;
        let [c, d] = self.jerk;
        a.max(b).max(c).max(d).max(self.acceleration)
    }
    fn all(self, f: impl Fn(f64) -> bool) -> bool {
        f(self.cap[0]) && f(self.cap[1]) && f(self.acceleration) && f(self.jerk[0]) && f(self.jerk[1])
    }
}

const ONE: Loads = Loads {
    cap: [1.0; 2],
    acceleration: 1.0,
    jerk: [1.0; 2],
};

/// Multipliers of the limits at a border and in the interval behind it, each for both signs.
#[derive(Clone, Copy, Debug, Default)]
struct Prices {
    cap: [f64; 2],
    acceleration: [[f64; 2]; 3],
    jerk: [[[f64; 2]; 3]; 2],
}

/// A window being solved.
pub(super) struct Window<'a> {
    /// n + 1 of them.
    pub(super) borders: &'a [Border],
    /// n of them, at least 4.
    pub(super) intervals: &'a mut [Interval],
    pub(super) begin: Begin,
}

impl Window<'_> {
    fn count(&self) -> usize {
        self.intervals.len()
    }

    /// b and g at border `i`, 1 to n - 1.
    pub(super) fn motion(&self, i: usize) -> Motion {
        let (a, c) = (&self.intervals[i - 1], &self.intervals[i]);
        let sum = a.width + c.width;
        Motion {
            b: (c.width * a.value + a.width * c.value) / sum,
            g: (c.value - a.value) / sum,
        }
    }

    fn tie_ends(&mut self) {
        let n = self.count();
        if self.begin == Begin::Rest {
            self.intervals[0].value = tie(self.intervals[0].width, self.intervals[1].width) * self.intervals[1].value;
        }
        self.intervals[n - 1].value = tie(self.intervals[n - 1].width, self.intervals[n - 2].width) * self.intervals[n - 2].value;
    }

    /// How much of each limit is used at each border and in the interval behind it.
    fn loads(&self, loads: &mut Vec<Loads>) {
        let n = self.count();
        loads.clear();
        loads.push(Loads::default());
        let mut here = self.motion(1);
        for i in 1..n {
            let border = &self.borders[i];
            let interval = &self.intervals[i];
            let mut load = Loads {
                cap: [here.b / border.cap, interval.value / interval.cap],
                ..Loads::default()
            };
            for row in &border.acceleration {
                load.acceleration = load.acceleration.max((row[0] * here.b + row[1] * here.g).abs());
            }
            load.acceleration /= interval.share;
            if i + 1 < n {
                let next = self.motion(i + 1);
                let h = (next.g - here.g) / interval.width;
                for (k, motion) in [here, next].into_iter().enumerate() {
                    let mut jerk = 0.0f64;
                    for row in &self.borders[i + k].jerk {
                        jerk = jerk.max((row[0] * motion.b + row[1] * motion.g + row[2] * h).abs());
                    }
                    load.jerk[k] = jerk * libm::sqrt(motion.b.max(0.0)) / interval.share;
                }
                here = next;
            }
            loads.push(load);
        }
    }

    /// Largest load from interval `from` on.
    pub(super) fn worst_from(&mut self, from: usize) -> f64 {
        self.tie_ends();
        let mut loads = vec![];
        self.loads(&mut loads);
        loads[from..].iter().map(Loads::worst).fold(0.0, f64::max)
    }

    /// Makes the intervals' values the fastest ones within the limits, from the guess in them.
    pub(super) fn solve(&mut self) {
        let n = self.count();
        self.tie_ends();
        let (mut loads, mut relaxed, mut matrix) = (Vec::with_capacity(n), vec![ONE; n], Matrix::new(n));
        self.loads(&mut loads);
        for (limit, load) in relaxed.iter_mut().zip(&loads) {
            *limit = load.map2(ONE, |l, one| if l < 0.9999 * one { one } else { l * SLACK });
        }
        let time = |w: &Self| -> f64 {
            (1..n)
                .map(|i| w.intervals[i].width / libm::sqrt(w.motion(i).b.max(1e-300)))
                .sum()
        };
        let mut share_of_time = BARRIER_FIRST;
        let mut last_time = time(self);
        let mut prices = vec![Prices::default(); n];
        let mut before: Vec<f64> = vec![0.0; n];
        let mut steps = 0;
        let (mut fresh, mut growing) = (true, true);
        loop {
            let barrier = share_of_time * last_time / n as f64;
            self.price(&mut prices, &relaxed, barrier, fresh);
            self.assemble(barrier, &relaxed, &prices, &mut matrix);
            self.fold(&mut matrix);
            matrix.solve();
            if self.begin == Begin::Rest {
                matrix.gradient[0] = tie(self.intervals[0].width, self.intervals[1].width) * matrix.gradient[1];
            }
            matrix.gradient[n - 1] = tie(self.intervals[n - 1].width, self.intervals[n - 2].width) * matrix.gradient[n - 2];
            self.follow(&mut prices, &relaxed, barrier, &matrix.gradient);
            for (b, interval) in before.iter_mut().zip(self.intervals.iter()) {
                *b = interval.value;
            }
            // Far below the limits Newton's step is too small by a factor.
            let mut share = if growing { 16.0 } else { 1.0 };
            let mut moved = false;
            for _ in 0..40 {
                let fits = (0..n).all(|i| {
                    self.intervals[i].value = before[i] - share * matrix.gradient[i];
                    self.intervals[i].value > 0.02 * before[i]
                });
                if fits {
                    self.tie_ends();
                    self.loads(&mut loads);
                    if loads
                        .iter()
                        .zip(&relaxed)
                        .all(|(load, limit)| load.map2(*limit, |l, r| l / r).all(|l| l < 1.0 - 1e-7))
                    {
                        moved = true;
                        break;
                    }
                }
                share *= if share > 1.0 { 0.5 } else { 0.8 };
            }
            if !moved {
                for (interval, b) in self.intervals.iter_mut().zip(&before) {
                    interval.value = *b;
                }
                self.loads(&mut loads);
            }
            steps += 1;
            let mut infeasible = false;
            for (limit, load) in relaxed.iter_mut().zip(&loads) {
                *limit = limit.map2(*load, |r, l| if r > 1.0 { (l + 0.3 * (r - l)).max(1.0) } else { 1.0 });
                infeasible |= !limit.all(|r| r <= 1.0);
            }
            let now = time(self);
            fresh = fresh && now < 0.8 * last_time;
            let settled = now > 0.97 * last_time;
            growing = share >= 0.8 && now < 0.94 * last_time;
            last_time = now;
            let done = share_of_time <= BARRIER_LAST && !infeasible && share >= 0.7;
            if done || steps >= MOST_STEPS || (!moved && share_of_time <= BARRIER_LAST) {
                break;
            }
            if !fresh && !infeasible {
                let fall = match share {
                    s if s >= 0.8 && settled => 0.3,
                    s if s >= 0.4 && settled => 0.6,
                    _ => 1.0,
                };
                share_of_time = (share_of_time * fall).max(BARRIER_LAST);
            }
        }
    }

    /// Keeps multipliers in sight of what the barrier makes of them; `fresh` ones are that.
    fn price(&self, prices: &mut [Prices], relaxed: &[Loads], barrier: f64, fresh: bool) {
        self.walk(relaxed, None, |i, at, room, _| {
            let price = price_of(&mut prices[i], at);
            let middle = barrier / room;
            *price = if fresh {
                middle
            } else {
                price.clamp(middle * 1e-3, middle * 1e3)
            };
        });
    }

    /// Moves the multipliers along with a step of the values; gives the share of their own step that was made.
    fn follow(&self, prices: &mut [Prices], relaxed: &[Loads], barrier: f64, gradient: &[f64]) -> f64 {
        let mut share = 1.0f64;
        let mut change = vec![Prices::default(); prices.len()];
        self.walk(relaxed, Some(gradient), |i, at, room, growth| {
            let price = *price_of(&mut prices[i], at);
            let delta = barrier / room - price - price / room * growth;
            *price_of(&mut change[i], at) = delta;
            if delta < 0.0 {
                share = share.min(-0.99 * price / delta);
            }
        });
        self.walk(relaxed, None, |i, at, _, _| {
            let delta = *price_of(&mut change[i], at);
            *price_of(&mut prices[i], at) += share * delta;
        });
        share
    }

    /// Calls back for each limit with its room, and how that grows with the step that `gradient` is the negative of.
    fn walk(&self, relaxed: &[Loads], gradient: Option<&[f64]>, mut each: impl FnMut(usize, At, f64, f64)) {
        let n = self.count();
        let step = |i: usize| gradient.map_or(0.0, |g| -g[i]);
        let step_motion = |i: usize| {
            let (a, c) = (self.intervals[i - 1].width, self.intervals[i].width);
            let (x, y) = (step(i - 1), step(i));
            Motion {
                b: (c * x + a * y) / (a + c),
                g: (y - x) / (a + c),
            }
        };
        let (mut here, mut moved) = (self.motion(1), step_motion(1));
        for i in 1..n {
            let (border, interval, limit) = (&self.borders[i], &self.intervals[i], &relaxed[i]);
            each(i, At::Cap(0), border.cap * limit.cap[0] - here.b, -moved.b);
            each(i, At::Cap(1), interval.cap * limit.cap[1] - interval.value, -step(i));
            let scale = 1.0 / (interval.share * limit.acceleration);
            for (k, row) in border.acceleration.iter().enumerate() {
                let load = (row[0] * here.b + row[1] * here.g) * scale;
                let change = (row[0] * moved.b + row[1] * moved.g) * scale;
                each(i, At::Acceleration(k, 0), 1.0 - load, -change);
                each(i, At::Acceleration(k, 1), 1.0 + load, change);
            }
            if i + 1 < n {
                let (next, next_moved) = (self.motion(i + 1), step_motion(i + 1));
                let over = 1.0 / interval.width;
                let (h, h_moved) = ((next.g - here.g) * over, (next_moved.g - moved.g) * over);
                for (end, (motion, moved)) in [(here, moved), (next, next_moved)].into_iter().enumerate() {
                    let root = 1.0 / libm::sqrt(motion.b);
                    let fall = -0.5 * root / motion.b * moved.b;
                    let scale = 1.0 / (interval.share * limit.jerk[end]);
                    for (k, row) in self.borders[i + end].jerk.iter().enumerate() {
                        let load = (row[0] * motion.b + row[1] * motion.g + row[2] * h) * scale;
                        let change = (row[0] * moved.b + row[1] * moved.g + row[2] * h_moved) * scale;
                        each(i, At::Jerk(end, k, 0), root - load, fall - change);
                        each(i, At::Jerk(end, k, 1), root + load, fall + change);
                    }
                }
                (here, moved) = (next, next_moved);
            }
        }
    }

    /// Gradient and matrix of time and barrier.
    fn assemble(&self, barrier: f64, relaxed: &[Loads], prices: &[Prices], matrix: &mut Matrix) {
        let n = self.count();
        matrix.clear();
        let sum = |i: usize| 1.0 / (self.intervals[i - 1].width + self.intervals[i].width);
        let mut here = self.motion(1);
        let mut e = sum(1);
        // Of the terms in b, g and h at a border: gradient and matrix.
        let mut carried = Local::default();
        for i in 1..n {
            let (a, interval) = (&self.intervals[i - 1], &self.intervals[i]);
            let border = &self.borders[i];
            let mut local = carried;
            // The time. An interval with constant jerk takes 3 width / speed.
            let rest_before = if i == 1 && self.begin == Begin::Rest { 3.0 } else { 0.5 };
            let rest_behind = if i == n - 1 { 3.0 } else { 0.5 };
            let weight = rest_before * a.width + rest_behind * interval.width;
            let slow = 1.0 / (here.b * libm::sqrt(here.b));
            local.gradient[0] -= 0.5 * weight * slow;
            local.matrix[0] += 0.75 * weight * slow / here.b;
            // Speed.
            let cap = border.cap * relaxed[i].cap[0];
            let free = 1.0 / (cap - here.b);
            local.gradient[0] += barrier * free;
            local.matrix[0] += prices[i].cap[0] * free;
            // Acceleration.
            let scale = 1.0 / (interval.share * relaxed[i].acceleration);
            for (row, price) in border.acceleration.iter().zip(&prices[i].acceleration) {
                let (x, y) = (row[0] * scale, row[1] * scale);
                let load = x * here.b + y * here.g;
                let (p, m) = (1.0 / (1.0 - load), 1.0 / (1.0 + load));
                let first = barrier * (p - m);
                let second = price[0] * p + price[1] * m;
                local.gradient[0] += first * x;
                local.gradient[1] += first * y;
                local.matrix[0] += second * x * x;
                local.matrix[1] += second * x * y;
                local.matrix[3] += second * y * y;
            }
            // What the coefficients make of b and g here.
            let p = interval.width * e;
            let to_b = [p, 1.0 - p, 0.0];
            let to_g = [-e, e, 0.0];
            // The coefficient itself.
            let cap = interval.cap * relaxed[i].cap[1];
            let free = 1.0 / (cap - interval.value);
            matrix.gradient[i] += barrier * (free - 0.01 / interval.value);
            matrix.diagonal[i] += prices[i].cap[1] * free + barrier * 0.01 / (interval.value * interval.value);
            carried = Local::default();
            if i + 1 < n {
                let next = self.motion(i + 1);
                let next_e = sum(i + 1);
                let h = (next.g - here.g) / interval.width;
                let over = 1.0 / interval.width;
                let to_h = [e * over, -(e + next_e) * over, next_e * over];
                local.jerk(
                    here,
                    h,
                    &border.jerk,
                    barrier,
                    &prices[i].jerk[0],
                    interval.share * relaxed[i].jerk[0],
                );
                matrix.add(i - 1, &local, &[to_b, to_g, to_h]);
                let mut end = Local::default();
                end.jerk(
                    next,
                    h,
                    &self.borders[i + 1].jerk,
                    barrier,
                    &prices[i].jerk[1],
                    interval.share * relaxed[i].jerk[1],
                );
                let p = self.intervals[i + 1].width * next_e;
                matrix.add(i - 1, &end, &[[0.0, p, 1.0 - p], [0.0, -next_e, next_e], to_h]);
                here = next;
                e = next_e;
            } else {
                matrix.add_two(i - 1, &local, &[to_b, to_g]);
            }
        }
    }

    /// Takes the coefficients out of the equations that others determine.
    fn fold(&self, matrix: &mut Matrix) {
        let n = self.count();
        match self.begin {
            Begin::Rest => {
                let r = tie(self.intervals[0].width, self.intervals[1].width);
                matrix.gradient[1] += r * matrix.gradient[0];
                matrix.diagonal[1] += 2.0 * r * matrix.next[0] + r * r * matrix.diagonal[0];
                matrix.next[1] += r * matrix.after[0];
                matrix.fix(0);
            }
            Begin::Moving => {
                matrix.fix(0);
                matrix.fix(1);
            }
        }
        let r = tie(self.intervals[n - 1].width, self.intervals[n - 2].width);
        matrix.gradient[n - 2] += r * matrix.gradient[n - 1];
        matrix.diagonal[n - 2] += 2.0 * r * matrix.next[n - 2] + r * r * matrix.diagonal[n - 1];
        matrix.next[n - 3] += r * matrix.after[n - 3];
        matrix.fix(n - 1);
        if self.begin == Begin::Moving && n - 2 <= 1 {
            matrix.fix(n - 2);
        }
    }
}

/// Which limit.
#[derive(Clone, Copy)]
enum At {
    Cap(usize),
    Acceleration(usize, usize),
    Jerk(usize, usize, usize),
}

fn price_of(prices: &mut Prices, at: At) -> &mut f64 {
    match at {
        At::Cap(k) => &mut prices.cap[k],
        At::Acceleration(k, sign) => &mut prices.acceleration[k][sign],
        At::Jerk(end, k, sign) => &mut prices.jerk[end][k][sign],
    }
}

/// Gradient and upper half of the matrix in (b, g, h) at one border.
#[derive(Clone, Copy, Debug, Default)]
struct Local {
    gradient: [f64; 3],
    /// bb, bg, bh, gg, gh, hh.
    matrix: [f64; 6],
}

impl Local {
    /// The jerk of each axis: -log(1 - load^2), with the curvature of b^(-1/2) left out, which makes its matrix larger and positive.
    fn jerk(&mut self, motion: Motion, h: f64, rows: &[[f64; 3]; 3], barrier: f64, prices: &[[f64; 2]; 3], limit: f64) {
        let root = 1.0 / libm::sqrt(motion.b);
        let scale = 1.0 / limit;
        // How b^(-1/2) falls with b.
        let fall = -0.5 * root / motion.b;
        let over_b = 1.0 / motion.b;
        for (row, price) in rows.iter().zip(prices) {
            let [x, y, z] = row.map(|c| c * scale);
            let load = x * motion.b + y * motion.g + z * h;
            let (p, m) = (1.0 / (root - load), 1.0 / (root + load));
            let along = barrier * (p - m);
            let (pp, mm) = (price[0] * p, price[1] * m);
            let both = pp + mm;
            let mixed = (mm - pp) * fall;
            self.gradient[0] += along * x - barrier * ((p + m) * fall + over_b);
            self.gradient[1] += along * y;
            self.gradient[2] += along * z;
            self.matrix[0] += both * (x * x + fall * fall) + 2.0 * mixed * x + barrier * over_b * over_b;
            self.matrix[1] += both * x * y + mixed * y;
            self.matrix[2] += both * x * z + mixed * z;
            self.matrix[3] += both * y * y;
            self.matrix[4] += both * y * z;
            self.matrix[5] += both * z * z;
        }
    }
}

/// A symmetric matrix with five diagonals, and a right side that the solution replaces.
struct Matrix {
    diagonal: Vec<f64>,
    next: Vec<f64>,
    after: Vec<f64>,
    gradient: Vec<f64>,
}

impl Matrix {
    fn new(n: usize) -> Matrix {
        let zero = || vec![0.0; n];
        Matrix {
            diagonal: zero(),
            next: zero(),
            after: zero(),
            gradient: zero(),
        }
    }

    fn clear(&mut self) {
        for part in [&mut self.diagonal, &mut self.next, &mut self.after, &mut self.gradient] {
            part.iter_mut().for_each(|v| *v = 0.0);
        }
    }

    /// Adds terms in (b, g, h), which the three coefficients from `first` on make by `maps`.
    fn add(&mut self, first: usize, local: &Local, maps: &[[f64; 3]; 3]) {
        let [bb, bg, bh, gg, gh, hh] = local.matrix;
        let square = [[bb, bg, bh], [bg, gg, gh], [bh, gh, hh]];
        let columns: [[f64; 3]; 3] =
            std::array::from_fn(|c| std::array::from_fn(|r| (0..3).map(|m| square[r][m] * maps[m][c]).sum()));
        let entry = |r: usize, c: usize| -> f64 { (0..3).map(|m| maps[m][r] * columns[c][m]).sum() };
        for c in 0..3 {
            self.gradient[first + c] += (0..3).map(|m| maps[m][c] * local.gradient[m]).sum::<f64>();
            self.diagonal[first + c] += entry(c, c);
        }
        self.next[first] += entry(0, 1);
        self.next[first + 1] += entry(1, 2);
        self.after[first] += entry(0, 2);
    }

    /// The same for terms in (b, g) of two coefficients.
    fn add_two(&mut self, first: usize, local: &Local, maps: &[[f64; 3]; 2]) {
        let [bb, bg, _, gg, _, _] = local.matrix;
        let entry = |r: usize, c: usize| {
            maps[0][r] * (bb * maps[0][c] + bg * maps[1][c]) + maps[1][r] * (bg * maps[0][c] + gg * maps[1][c])
        };
        for c in 0..2 {
            self.gradient[first + c] += maps[0][c] * local.gradient[0] + maps[1][c] * local.gradient[1];
            self.diagonal[first + c] += entry(c, c);
        }
        self.next[first] += entry(0, 1);
    }

    /// Row and column `i` leave the equations: its solution is 0.
    fn fix(&mut self, i: usize) {
        self.diagonal[i] = 1.0;
        self.gradient[i] = 0.0;
        self.next[i] = 0.0;
        self.after[i] = 0.0;
        if i > 0 {
            self.next[i - 1] = 0.0;
        }
        if i > 1 {
            self.after[i - 2] = 0.0;
        }
    }

    /// Solves by L D L^T; the solution is in `gradient`.
    fn solve(&mut self) {
        let n = self.diagonal.len();
        for i in 0..n {
            let d = self.diagonal[i];
            let (a, b) = (self.next[i] / d, self.after[i] / d);
            if i + 1 < n {
                self.diagonal[i + 1] -= a * self.next[i];
                self.gradient[i + 1] -= a * self.gradient[i];
                self.next[i + 1] -= a * self.after[i];
            }
            if i + 2 < n {
                self.diagonal[i + 2] -= b * self.after[i];
                self.gradient[i + 2] -= b * self.gradient[i];
            }
            self.next[i] = a;
            self.after[i] = b;
            self.gradient[i] /= d;
        }
        for i in (0..n).rev() {
            if i + 1 < n {
                self.gradient[i] -= self.next[i] * self.gradient[i + 1];
            }
            if i + 2 < n {
                self.gradient[i] -= self.after[i] * self.gradient[i + 2];
            }
        }
    }
}

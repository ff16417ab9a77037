//! What a window of the grid is: its borders with the rows of the limits, its intervals with the coefficients of b, and how much of the
//! limits they use. The equations are those of [`super::solver`].

/// Rows of one border of the grid: what the axes' limits are, as multiples of (b, g) and of (b, g, h).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Border {
    /// Largest b.
    pub(super) cap: f64,
    /// q'' and q' of each axis over its acceleration limit.
    pub(super) acceleration: [[f64; 2]; 3],
    /// q''', 3 q'' and q' of each axis over its jerk limit.
    pub(super) jerk: [[f64; 3]; 3],
    /// The first of them just before the border, for the interval that ends there: the third derivative may step.
    pub(super) third_before: [f64; 3],
}

impl Border {
    /// The row of jerk of an axis for the interval behind the border (0) or before it (1).
    #[inline(always)]
    pub(super) fn jerk_row(&self, end: usize, axis: usize) -> [f64; 3] {
        let [x, y, z] = self.jerk[axis];
        [if end == 0 { x } else { self.third_before[axis] }, y, z]
    }

    /// True where the path is no straight line on one side.
    pub(super) fn is_bent(&self) -> bool {
        self.jerk.iter().any(|r| r[0] != 0.0 || r[1] != 0.0) || self.third_before != [0.0; 3]
    }
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

impl Begin {
    /// Number of coefficients that are given.
    pub(super) fn fixed(self) -> usize {
        if self == Begin::Moving { 2 } else { 0 }
    }
}

/// b and g at a border.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    pub(super) b: f64,
    pub(super) g: f64,
}

/// Ratio of the first two coefficients where b begins as s^(4/3) over an interval of width `first`.
pub(super) fn tie(first: f64, second: f64) -> f64 {
    1.0 / (3.0 + 2.0 * second / first)
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
    pub(super) fn count(&self) -> usize {
        self.intervals.len()
    }

    /// b and g at border `i`, 1 to n - 1.
    pub(super) fn motion(&self, i: usize) -> Motion {
        let (a, c) = (&self.intervals[i - 1], &self.intervals[i]);
        let over = 1.0 / (a.width + c.width);
        Motion {
            b: (c.width * a.value + a.width * c.value) * over,
            g: (c.value - a.value) * over,
        }
    }

    pub(super) fn tie_ends(&mut self) {
        let n = self.count();
        if self.begin == Begin::Rest {
            self.intervals[0].value = tie(self.intervals[0].width, self.intervals[1].width) * self.intervals[1].value;
        }
        self.intervals[n - 1].value = tie(self.intervals[n - 1].width, self.intervals[n - 2].width) * self.intervals[n - 2].value;
    }

    /// How much of each limit is used at each border and in the interval behind it.
    pub(super) fn loads(&mut self, loads: &mut Vec<Loads>) {
        self.tie_ends();
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
                    for axis in 0..3 {
                        let row = self.borders[i + k].jerk_row(k, axis);
                        jerk = jerk.max((row[0] * motion.b + row[1] * motion.g + row[2] * h).abs());
                    }
                    load.jerk[k] = jerk * libm::sqrt(motion.b.max(0.0)) / interval.share;
                }
                here = next;
            }
            loads.push(load);
        }
    }
}

/// What is measured of a guess against its limits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Loads {
    /// b at the border and in the interval behind it against their caps.
    pub(super) cap: [f64; 2],
    pub(super) acceleration: f64,
    /// At both ends of the interval behind the border.
    pub(super) jerk: [f64; 2],
}

impl Loads {
    pub(super) fn worst(&self) -> f64 {
        let [a, b] = self.cap;
        let [c, d] = self.jerk;
        a.max(b).max(c).max(d).max(self.acceleration)
    }
}

//! A window of the grid is solved, and what the rest at its end does not slow down becomes phases.

use super::super::limits::{Begin, Border, Interval, Loads, Window};
use super::super::solver::{Again, COLD};
use super::phase::phase;
use super::{Cell, MOST_INTERVALS, Stretch};

/// Largest load between two borders that is left as it is.
const TOLERATED: f64 = 1.0018;

/// Load that is aimed at where one is above that.
const AIMED: f64 = 1.0010;

/// Times that a window is solved again with less of the limits where more than them was used between borders.
const MOST_ROUNDS: u32 = 12;

/// The limits at a share of an interval.
struct Look {
    interval: usize,
    share: f64,
    border: Border,
}

/// How far beside a step of the third derivative it is looked at, as a share of the interval.
const BESIDE: f64 = 1e-6;

/// Shares of an interval at which it is looked at.
const PLACES: [f64; 3] = [0.17, 0.5, 0.83];

/// Stopping distances from the end of the grid within which nothing is planned for good: where the path bends the axes have less to brake
/// with.
const STOPS: f64 = 2.2;

/// Times to build up the acceleration within which nothing is planned for good.
const SWINGS: f64 = 2.5;

/// Share of the jerk with which a rest is approached that is only the end of what is known.
const PROVISIONAL: f64 = 0.3;

/// Intervals over which a guess is made even, to both sides.
const EVEN: usize = 8;

/// Load between borders up to which the search goes on where it ended.
const NEAR_ENOUGH: f64 = 1.01;

/// Load up to which a guess may exceed limits.
const GUESS_ABOVE: f64 = 3.0;

impl Cell {
    /// Length, mm, of a stop from here with b as it is, and the time, s, that building up the acceleration takes.
    fn stop(&self, b: f64) -> (f64, f64) {
        let (mut a, mut j) = (f64::INFINITY, f64::INFINITY);
        for axis in 0..3 {
            a = a.min(1.0 / self.border.acceleration[axis][1].abs().max(1e-15));
            j = j.min(1.0 / self.border.jerk[axis][2].abs().max(1e-18));
        }
        let v = libm::sqrt(b);
        let stop = if v < a * a / j {
            v * libm::sqrt(v / j)
        } else {
            0.5 * v * (v / a + a / j)
        };
        (stop, a / j)
    }
}

/// How far the grid reaches behind its first intervals: behind these only what a rest at its end slows down is of use.
#[derive(Debug, Default)]
pub(super) struct Ahead {
    left: f64,
    time: f64,
    stop: f64,
    swing: f64,
}

impl Ahead {
    /// What the grid reaches behind interval `first`, as fast as it could go.
    pub(super) fn behind<'a>(cells: impl Iterator<Item = &'a Cell>) -> Ahead {
        let (mut ahead, mut last) = (Ahead::default(), None);
        for cell in cells {
            if let Some(last) = last {
                ahead.add(last, cell);
            }
            last = Some(cell);
        }
        ahead
    }

    /// Goes on by the interval between two cells.
    pub(super) fn add(&mut self, cell: &Cell, next: &Cell) {
        let b = cell.estimate.max(next.estimate).max(cell.interval.value);
        if self.left == 0.0 {
            (self.stop, self.swing) = cell.stop(b);
        }
        self.left += cell.interval.width;
        self.time += cell.interval.width / libm::sqrt(b.max(1e-300));
    }

    /// True when a rest at the end does not slow down what is before, with this much room to spare.
    pub(super) fn is_enough(&self, room: f64) -> bool {
        self.left > room * STOPS * self.stop && self.time > room * SWINGS * self.swing
    }
}

impl Stretch {
    /// Plans the window and gives out what the rest at its end does not slow down. Gives the number of intervals given out.
    pub(super) fn solve(&mut self, crowded: bool) -> usize {
        let n = self.grid.len().saturating_sub(1);
        if n < 4 {
            return 0;
        }
        let at_end = self.closed && self.grid_end >= self.course.length;
        let begin = if self.moving { Begin::Moving } else { Begin::Rest };
        let mut borders: Vec<Border> = self.grid.iter().map(|c| c.border).collect();
        let mut intervals: Vec<Interval> = self.grid.iter().take(n).map(|c| c.interval).collect();
        self.rest_caps(&mut borders, &intervals, begin, at_end);
        for k in 1..n {
            intervals[k].cap = intervals[k].cap.min(borders[k].cap.max(borders[k + 1].cap));
        }
        let between = self.between_borders(&intervals);
        for look in &between {
            let cap = &mut intervals[look.interval].cap;
            *cap = cap.min(look.border.cap);
        }
        self.search_within(&borders, &mut intervals, &between, begin);
        // What no longer window helps goes on with the rest at its end, more slowly than it could, but it goes on.
        let longest = self.fineness == 1.0 && self.grid.len() >= MOST_INTERVALS || crowded && self.sees_no_more();
        let upto = if at_end {
            n
        } else {
            let free = self.slowed_from(&intervals, n);
            if longest { free.max(n / 2) } else { free }
        };
        let first = if self.moving { 1 } else { 0 };
        if !at_end && upto < first + 4 {
            for (cell, interval) in self.grid.iter_mut().zip(&intervals) {
                cell.interval = *interval;
            }
            return 0;
        }
        let window = Window {
            borders: &borders,
            intervals: &mut intervals,
            begin,
        };
        for i in first..upto {
            let phase = phase(&window, i, self.grid[i].s, at_end, self.grid[i].feed_scale);
            self.phases.push_back(phase);
        }
        for (cell, interval) in self.grid.iter_mut().zip(&intervals) {
            cell.interval = *interval;
        }
        if at_end {
            self.planned = true;
            self.grid.clear();
        } else {
            self.grid.drain(..upto - 1);
            self.moving = true;
        }
        upto - first
    }

    /// The fastest motion in the window that keeps the limits between borders too.
    fn search_within(&mut self, borders: &[Border], intervals: &mut [Interval], between: &[Look], begin: Begin) {
        let known = intervals
            .iter()
            .rposition(|i| i.value > 0.0)
            .map_or(0, |k| k + 1)
            .max(begin.fixed());
        let from_below: Vec<f64> = intervals.iter().map(|i| i.value).collect();
        let mut search = std::mem::take(&mut self.search);
        let mut window = Window {
            borders,
            intervals,
            begin,
        };
        let shaped = self.shape(&mut window, known);
        let found = shaped && search.run(&mut window, COLD);
        if !found {
            for (interval, old) in window.intervals.iter_mut().zip(&from_below) {
                interval.value = *old;
            }
            self.creep(&mut window, known);
            search.run(&mut window, COLD);
        }
        let mut loads = vec![];
        for round in 1..MOST_ROUNDS {
            let mut tightened = false;
            loads_between(&window, between, &mut loads);
            for (i, load) in loads.iter().enumerate() {
                if *load > TOLERATED {
                    // What a few rounds did not mend is taken harder.
                    let more = 1.0 + 0.5 * f64::from(round);
                    window.intervals[i].share *= (1.0 - more * (load - AIMED)).max(0.5);
                    tightened = true;
                }
            }
            if !tightened {
                break;
            }
            let before: Vec<f64> = window.intervals.iter().map(|i| i.value).collect();
            let worst = loads.iter().copied().fold(0.0, f64::max);
            let again = worst < NEAR_ENOUGH && search.run(&mut window, Again::ROUND) || {
                // From a little below what was found.
                let fixed = window.begin.fixed();
                let less = 1.0 - 1.0 / libm::pow(worst, 1.5);
                for (k, (interval, old)) in window.intervals.iter_mut().zip(&before).enumerate().skip(fixed) {
                    let x = if fixed == 0 {
                        1.0
                    } else {
                        ((k + 1 - fixed) as f64 / 24.0).min(1.0)
                    };
                    interval.value = old * (1.0 - (0.005 + less) * x * x * (3.0 - 2.0 * x));
                }
                search.run(&mut window, Again::BELOW)
            };
            if !again {
                // From far below, which always arrives.
                for (interval, old) in window.intervals.iter_mut().zip(&from_below) {
                    interval.value = *old;
                }
                self.creep(&mut window, known);
                if !search.run(&mut window, COLD) {
                    for (interval, old) in window.intervals.iter_mut().zip(&before) {
                        interval.value = *old;
                    }
                }
            }
        }
        self.search = search;
    }

    /// A motion to begin the search with, as near to the fastest one as can be told at once; `false` if it is too far above the limits.
    ///
    /// The estimate is lowered to what it has around it and made even by a mean, so that it stays below itself, and scaled: all loads fall
    /// with a motion that is slower everywhere. Where the window goes on from another one the two are blended.
    fn shape(&self, window: &mut Window<'_>, known: usize) -> bool {
        let n = window.intervals.len();
        if n < 4 * EVEN {
            return false;
        }
        let fixed = window.begin.fixed();
        let mut raw: Vec<f64> = (0..n)
            .map(|k| {
                let estimate = self.grid[k].estimate.min(self.grid[k + 1].estimate).max(1e-12);
                0.8 * estimate.min(window.intervals[k].cap).min(window.borders[k + 1].cap)
            })
            .collect();
        raw[0] = raw[0].max(1e-12);
        // From rest to rest, at part of the jerk and acceleration along the path.
        let grow = |from: f64, cell: &Cell, width: f64| {
            let (mut a, mut j) = (f64::INFINITY, f64::INFINITY);
            for axis in 0..3 {
                a = a.min(1.0 / cell.border.acceleration[axis][1].abs().max(1e-15));
                j = j.min(1.0 / cell.border.jerk[axis][2].abs().max(1e-18));
            }
            let y = super::sights::three_quarters(from) + 1.2 * libm::sqrt(j) * width;
            (libm::cbrt(y) * y).min(from + a * width)
        };
        let mut b = 0.0;
        for k in (0..n).rev() {
            b = grow(b, &self.grid[k], window.intervals[k].width);
            raw[k] = raw[k].min(b);
            b = raw[k];
        }
        if window.begin == Begin::Rest {
            b = 0.0;
            for k in 0..n {
                b = grow(b, &self.grid[k], window.intervals[k].width);
                raw[k] = raw[k].min(b);
                b = raw[k];
            }
        }
        let around = |values: &[f64], k: usize| (k.saturating_sub(EVEN), (k + EVEN + 1).min(values.len()));
        let low: Vec<f64> = (0..n)
            .map(|k| {
                let (from, to) = around(&raw, k);
                raw[from..to].iter().copied().fold(f64::INFINITY, f64::min)
            })
            .collect();
        let even: Vec<f64> = (0..n)
            .map(|k| {
                let (from, to) = around(&low, k);
                low[from..to].iter().sum::<f64>() / (to - from) as f64
            })
            .collect();
        let old: Vec<f64> = window.intervals.iter().map(|i| i.value).collect();
        for (interval, even) in window.intervals.iter_mut().zip(&even).skip(fixed) {
            interval.value = *even;
        }
        let mut loads = vec![];
        let mut scale = 0.9f64;
        let worst = |loads: &[Loads], from: usize| {
            let mut scale = f64::INFINITY;
            for load in &loads[from.min(loads.len())..] {
                let jerk = load.jerk[0].max(load.jerk[1]).max(1e-30);
                let even = load.cap[0].max(load.cap[1]).max(load.acceleration).max(1e-30);
                scale = scale.min(1.0 / even).min(1.0 / libm::cbrt(jerk * jerk));
            }
            scale
        };
        window.loads(&mut loads);
        scale *= worst(&loads, if fixed > 0 { fixed + 2 } else { 0 }).min(1.0);
        if fixed == 0 {
            for (interval, even) in window.intervals.iter_mut().zip(&even) {
                interval.value = even * scale;
            }
            return true;
        }
        // The old plan brakes from somewhere on; it is left where that exceeds the limits least.
        let top = old[1].max(old[fixed.min(n - 1)]);
        let braked = (fixed..known).find(|k| old[*k] < 0.3 * top).unwrap_or(known);
        let ways = [0.2, 0.4, 0.6, 0.8].map(|share| fixed + (share * (known - fixed) as f64) as usize);
        let mut best = (GUESS_ABOVE, vec![]);
        for upto in ways.into_iter().chain([braked]).filter(|upto| *upto >= fixed + EVEN) {
            let from = upto.saturating_sub(4 * EVEN).max(fixed);
            for k in fixed..n {
                let x = ((k + 1).saturating_sub(from) as f64 / (upto - from) as f64).min(1.0);
                let share = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
                window.intervals[k].value = (1.0 - share) * old[k] + share * even[k] * scale;
            }
            window.loads(&mut loads);
            let most = loads.iter().map(|load| load.worst()).fold(0.0, f64::max);
            if most < best.0 {
                best = (most, window.intervals.iter().map(|i| i.value).collect());
            }
        }
        for (interval, value) in window.intervals.iter_mut().zip(&best.1) {
            interval.value = *value;
        }
        !best.1.is_empty()
    }

    /// A motion within all limits to begin the search with: what was planned before, and behind it a creep.
    fn creep(&self, window: &mut Window<'_>, known: usize) {
        let mut creep = f64::INFINITY;
        for k in known..window.intervals.len() {
            let (border, interval) = (&window.borders[k + 1], &window.intervals[k]);
            creep = creep.min(border.cap).min(interval.cap);
            for axis in 0..3 {
                let [x, y] = border.acceleration[axis].map(f64::abs);
                creep = creep.min(1.0 / (x + y / interval.width));
                let [x, y, z] = border.jerk[axis].map(f64::abs);
                let x = x.max(border.third_before[axis].abs());
                let most = 1.0 / (x + y / interval.width + z / (interval.width * interval.width));
                creep = creep.min(libm::cbrt(most * most));
            }
        }
        creep *= 0.3;
        let mut before = f64::INFINITY;
        let mut loads = vec![];
        for _ in 0..40 {
            for interval in &mut window.intervals[known..] {
                interval.value = creep;
            }
            window.loads(&mut loads);
            let worst = loads[known.saturating_sub(3)..].iter().map(|l| l.worst()).fold(0.0, f64::max);
            // What does not become less is not the creep's.
            if worst < 0.9995 || worst > 0.98 * before {
                break;
            }
            before = worst;
            creep *= 0.3;
        }
    }

    /// True when the grid reaches as far as what is known.
    fn sees_no_more(&self) -> bool {
        self.sights.back().is_none_or(|sight| self.grid_end >= sight.s)
    }

    /// The first interval from which on the rest at the end of the grid may slow the plan down: nearer to it than a few times what it takes
    /// to stop.
    fn slowed_from(&self, intervals: &[Interval], n: usize) -> usize {
        let (mut left, mut time) = (0.0, 0.0);
        for k in (0..n).rev() {
            let (cell, interval) = (&self.grid[k], &intervals[k]);
            left += interval.width;
            let (stop, swing) = cell.stop(interval.value);
            // As fast as it could go if the end were not there.
            time += interval.width / libm::sqrt(cell.estimate.max(self.grid[k + 1].estimate).max(interval.value));
            if left > STOPS * stop && time > SWINGS * swing && n - k > 8 {
                return k;
            }
        }
        0
    }

    /// Largest b at the first and last inner border by the jerk of the intervals at rest.
    ///
    /// Where the grid goes on later the end is slower: the same coefficients then have to do without the constant jerk.
    fn rest_caps(&self, borders: &mut [Border], intervals: &[Interval], begin: Begin, at_end: bool) {
        let n = intervals.len();
        let mut limit = |at: usize, rest: usize, width: f64, direction: f64, share: f64| {
            // With b = 1 there: s is a cube of the time, so t = 3 width / speed.
            let t = 3.0 * width;
            let (g, third) = (direction * 2.0 / t, 2.0 / (t * t));
            let (mut jerk, mut acceleration) = (0.0f64, 0.0f64);
            let mut look = |border: &Border, time: f64| {
                let v2 = time * time * time * time;
                for (row, before) in border.jerk.iter().zip(border.third_before) {
                    let row = if row[0].abs() > before.abs() {
                        *row
                    } else {
                        [before, row[1], row[2]]
                    };
                    jerk = jerk.max((row[0] * v2 * time * time + row[1] * time * time * time * g + row[2] * third).abs());
                }
                for row in &border.acceleration {
                    acceleration = acceleration.max((row[0] * v2 + row[1] * time * g).abs());
                }
            };
            look(&borders[at], 1.0);
            look(&borders[rest], 0.0);
            if borders[at].is_bent() || borders[rest].is_bent() {
                for k in 1..8 {
                    let time = f64::from(k) / 8.0;
                    let s = self.grid[rest].s + direction * width * time * time * time;
                    look(&self.cell(s, 0.0).border, time);
                }
            }
            let most = share / jerk.max(1e-300);
            borders[at].cap = borders[at]
                .cap
                .min(libm::cbrt(most * most))
                .min(1.0 / acceleration.max(1e-300));
        };
        if begin == Begin::Rest {
            limit(1, 0, intervals[0].width, 1.0, 1.0);
        }
        limit(n - 1, n, intervals[n - 1].width, -1.0, if at_end { 1.0 } else { PROVISIONAL });
    }

    /// The limits inside intervals, where they are others than at their borders, in order.
    fn between_borders(&self, intervals: &[Interval]) -> Vec<Look> {
        // Straight ahead nothing happens between borders that does not happen at them.
        let mut looks = vec![];
        let (first, last) = (self.grid[0].s, self.grid[intervals.len()].s);
        let steps = self.course.steps_between(first, last);
        let mut step = 0;
        let mut shares = vec![];
        for (i, interval) in intervals.iter().enumerate() {
            let (begin, end) = (self.grid[i].s, self.grid[i + 1].s);
            shares.clear();
            if self.grid[i].border.is_bent() || self.grid[i + 1].border.is_bent() {
                shares.extend(PLACES);
            }
            // A border sees what is behind it.
            while step < steps.len() && steps[step] <= end + BESIDE * interval.width {
                let share = ((steps[step] - begin) / interval.width).min(1.0);
                shares.extend([share - BESIDE, share + BESIDE].into_iter().filter(|x| *x > 0.0 && *x < 1.0));
                step += 1;
            }
            looks.extend(shares.iter().map(|share| Look {
                interval: i,
                share: *share,
                border: self.cell(begin + share * interval.width, 0.0).border,
            }));
        }
        looks
    }
}

/// Largest loads of acceleration and jerk inside each interval.
fn loads_between(window: &Window<'_>, looks: &[Look], loads: &mut Vec<f64>) {
    let n = window.intervals.len();
    loads.clear();
    loads.resize(n, 0.0);
    let mut looks = looks.iter().skip_while(|look| look.interval == 0).peekable();
    for i in 1..n - 1 {
        let (here, next) = (window.motion(i), window.motion(i + 1));
        let width = window.intervals[i].width;
        let h = (next.g - here.g) / width;
        let worst = &mut loads[i];
        // The speed may be more between the borders than at both.
        let vertex = -here.g / h;
        if h < 0.0 && vertex > 0.0 && vertex < width {
            let root = libm::sqrt((here.b + here.g * vertex).max(0.0));
            for [x, y, z] in window.borders[i].jerk {
                if x == 0.0 && y == 0.0 {
                    *worst = worst.max((z * h).abs() * root);
                }
            }
        }
        while let Some(look) = looks.next_if(|look| look.interval == i) {
            let d = look.share * width;
            let (b, g) = (here.b + 2.0 * here.g * d + h * d * d, here.g + h * d);
            let root = libm::sqrt(b.max(0.0));
            for axis in 0..3 {
                let [x, y] = look.border.acceleration[axis];
                *worst = worst.max((x * b + y * g).abs());
                // Beside a step both sides count: which of them this is may be rounding.
                let [x, y, z] = look.border.jerk[axis];
                for x in [x, look.border.third_before[axis]] {
                    *worst = worst.max((x * b + y * g + z * h).abs() * root);
                }
            }
        }
    }
}

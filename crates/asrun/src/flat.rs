//! The plan as one long chain of short chords, with a tree of boxes over it for nearest-place questions.
//!
//! The tree is implicit: box `k` of a level covers the chords `k * width ..`, in the order of the program. So a question may be limited
//! to a stretch of the program, and answers come in the program's order. Every chord knows when it would be reached under a plain
//! constant-acceleration motion: the matching weighs what may hide between two samples by time.

use crate::planned::PlannedProgram;
use crate::vec3::{V3, add, distance, dot, length, nearest_on_chord, scale, sub};
use plan::executed::PathKind;
use std::ops::Range;

/// Chords stay within this of the true curve, mm. Distances are measured on the true curve afterwards.
const FLATNESS: f64 = 0.005;
/// One move never becomes more chords than this.
const MOST_CHORDS: usize = 20_000;
/// Chords in a leaf, and boxes in a box.
const LEAF: usize = 4;
const FAN: usize = 8;

/// In which frame the chain is laid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Space {
    /// Tool tip, each toolpath in its own set-up.
    Tip,
    /// Gauge point in the machine, by the plan's frames and tool offsets.
    Gauge,
}

/// A straight piece of the plan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chord {
    pub(crate) from: V3,
    pub(crate) along: V3,
    pub(crate) length: f64,
    /// Path length of the plan up to its start.
    pub(crate) s: f64,
    /// Time of its start, s.
    pub(crate) time: f64,
    /// Speed at its start and end, and the highest on it, mm/s.
    speeds: [f64; 3],
    pub(crate) segment: u32,
    pub(crate) toolpath: u32,
    /// Parameters of its ends on the segment's path.
    pub(crate) u: [f64; 2],
    pub(crate) rapid: bool,
}

/// A place on the chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    pub(crate) chord: u32,
    /// Fraction of the chord.
    pub(crate) t: f64,
    pub(crate) distance: f64,
}

#[derive(Clone, Copy)]
struct Bounds {
    low: V3,
    high: V3,
}

impl Bounds {
    const NONE: Bounds = Bounds {
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
    };
    fn take(&mut self, other: &Bounds) {
        for k in 0..3 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }
    fn square_distance(&self, p: V3) -> f64 {
        let mut sum = 0.0;
        for ((low, high), c) in self.low.iter().zip(self.high).zip(p) {
            let out = (low - c).max(c - high).max(0.0);
            sum += out * out;
        }
        sum
    }
}

pub(crate) struct Flat {
    pub(crate) chords: Vec<Chord>,
    /// Chords of each toolpath.
    pub(crate) toolpaths: Vec<Range<usize>>,
    levels: Vec<Vec<Bounds>>,
    acceleration: f64,
    /// Dwells: the chord before which they stand, and how long they are.
    waits: Vec<(usize, f64)>,
    /// The highest speed of each chord, as planned.
    limits: Vec<f64>,
}

impl Flat {
    /// Lays a plan out. `acceleration` of the machine along a path, mm/s^2; only the nominal times depend on it.
    pub(crate) fn new(plan: &PlannedProgram, space: Space, acceleration: f64) -> Flat {
        let mut chords: Vec<Chord> = Vec::with_capacity(plan.segments.len());
        let mut toolpaths = Vec::with_capacity(plan.toolpaths.len());
        let mut s = 0.0;
        // Time to add before the next chord: dwells.
        let mut waits: Vec<(usize, f64)> = Vec::new();
        for (index, toolpath) in plan.toolpaths.iter().enumerate() {
            let begin = chords.len();
            if toolpath.kind == PathKind::Dwell {
                waits.push((begin, toolpath.time.0));
            }
            let machine_from_setup = plan.machine_from_setup(index);
            let offset = toolpath.tool_offset.total();
            for at in toolpath.segments.clone() {
                let segment = &plan.segments[at];
                let mut last: Option<(f64, V3)> = None;
                segment.path.flatten(FLATNESS, MOST_CHORDS, |u, point| {
                    let place = match space {
                        Space::Tip => point.xyz,
                        Space::Gauge => (machine_from_setup * point + offset).xyz,
                    };
                    if let Some((u0, from)) = last {
                        let along = sub(place, from);
                        let size = length(along);
                        if size <= 0.0 {
                            return;
                        }
                        chords.push(Chord {
                            from,
                            along,
                            length: size,
                            s,
                            time: 0.0,
                            speeds: [0.0, 0.0, segment.speed.0],
                            segment: at as u32,
                            toolpath: index as u32,
                            u: [u0, u],
                            rapid: toolpath.kind == PathKind::Rapid,
                        });
                        s += size;
                    }
                    last = Some((u, place));
                });
            }
            toolpaths.push(begin..chords.len());
        }
        let mut flat = Flat {
            levels: Vec::new(),
            chords,
            toolpaths,
            acceleration: acceleration.max(1.0),
            waits,
            limits: Vec::new(),
        };
        flat.limits = flat.chords.iter().map(|c| c.speeds[2]).collect();
        flat.time_it();
        flat.levels = flat.boxes();
        flat
    }

    /// Times the chain anew, for another acceleration, mm/s^2.
    pub(crate) fn retime(&mut self, acceleration: f64) {
        self.acceleration = acceleration.max(1.0);
        self.time_it();
    }

    /// Constant-acceleration motion over the chain: speeds at the joints by a backward and a forward pass, then times.
    fn time_it(&mut self) {
        for (chord, limit) in self.chords.iter_mut().zip(&self.limits) {
            chord.speeds = [0.0, 0.0, *limit];
        }
        let n = self.chords.len();
        if n == 0 {
            return;
        }
        let mut joint = vec![0.0; n + 1];
        let mut pause = vec![0.0; n + 1];
        for (at, time) in &self.waits {
            pause[*at] += time;
        }
        for k in 1..n {
            let (a, b) = (&self.chords[k - 1], &self.chords[k]);
            let end = add(a.from, a.along);
            if pause[k] > 0.0 || distance(end, b.from) > 1e-3 || a.rapid != b.rapid {
                continue;
            }
            let cosine = dot(a.along, b.along) / (a.length * b.length);
            // Full speed along a smooth joint, a stop at a corner of 45 degrees or more; what corners a machine really takes at speed
            // is its own affair and not needed here.
            let share = ((cosine - 0.7) / 0.29).clamp(0.0, 1.0);
            joint[k] = a.speeds[2].min(b.speeds[2]) * share;
        }
        let gain = 2.0 * self.acceleration;
        for k in (0..n).rev() {
            joint[k] = joint[k].min((joint[k + 1] * joint[k + 1] + gain * self.chords[k].length).sqrt());
        }
        for k in 0..n {
            joint[k + 1] = joint[k + 1].min((joint[k] * joint[k] + gain * self.chords[k].length).sqrt());
        }
        let mut time = 0.0;
        for k in 0..n {
            time += pause[k];
            let top =
                (self.acceleration * self.chords[k].length + (joint[k] * joint[k] + joint[k + 1] * joint[k + 1]) / 2.0).sqrt();
            let chord = &mut self.chords[k];
            chord.time = time;
            chord.speeds = [
                joint[k],
                joint[k + 1],
                top.min(chord.speeds[2]).max(joint[k]).max(joint[k + 1]),
            ];
            time += self.time_within(k, self.chords[k].length);
        }
    }

    /// Time from a chord's start to `x` mm along it.
    fn time_within(&self, chord: usize, x: f64) -> f64 {
        let a = self.acceleration;
        let [v0, v1, top] = self.chords[chord].speeds;
        if top <= 0.0 {
            return 0.0;
        }
        let total = self.chords[chord].length;
        let rise = (top * top - v0 * v0) / (2.0 * a);
        let fall = (top * top - v1 * v1) / (2.0 * a);
        if x <= rise {
            return ((v0 * v0 + 2.0 * a * x).sqrt() - v0) / a;
        }
        let up = (top - v0) / a;
        let flat = (total - rise - fall).max(0.0);
        if x <= rise + flat {
            return up + (x - rise) / top;
        }
        let rest = (x - rise - flat).min(fall);
        up + flat / top + (top - (top * top - 2.0 * a * rest).max(0.0).sqrt()) / a
    }

    pub(crate) fn s_at(&self, hit: &Hit) -> f64 {
        let chord = &self.chords[hit.chord as usize];
        chord.s + chord.length * hit.t
    }
    pub(crate) fn time_at(&self, hit: &Hit) -> f64 {
        let chord = &self.chords[hit.chord as usize];
        chord.time + self.time_within(hit.chord as usize, chord.length * hit.t)
    }
    pub(crate) fn place(&self, hit: &Hit) -> V3 {
        let chord = &self.chords[hit.chord as usize];
        add(chord.from, scale(chord.along, hit.t))
    }
    /// Parameter on the segment's own path.
    pub(crate) fn u_at(&self, hit: &Hit) -> f64 {
        let [u0, u1] = self.chords[hit.chord as usize].u;
        u0 + (u1 - u0) * hit.t
    }
    pub(crate) fn length(&self) -> f64 {
        self.chords.last().map_or(0.0, |c| c.s + c.length)
    }
    /// First chord that begins at `s` or later, less one: the chord that `s` lies on.
    pub(crate) fn chord_at(&self, s: f64) -> usize {
        self.chords.partition_point(|c| c.s <= s).saturating_sub(1)
    }
    /// The chord that is run at a nominal time.
    pub(crate) fn chord_at_time(&self, time: f64) -> usize {
        self.chords.partition_point(|c| c.time <= time).saturating_sub(1)
    }
    /// Size of the whole chain: the diagonal of its box.
    pub(crate) fn diagonal(&self) -> f64 {
        self.levels
            .last()
            .and_then(|top| top.first())
            .map_or(0.0, |b| distance(b.low, b.high))
    }

    fn boxes(&self) -> Vec<Vec<Bounds>> {
        let leaf = |chords: &[Chord]| {
            let mut bounds = Bounds::NONE;
            for chord in chords {
                let to = add(chord.from, chord.along);
                for end in [chord.from, to] {
                    bounds.take(&Bounds { low: end, high: end });
                }
            }
            bounds
        };
        let mut levels: Vec<Vec<Bounds>> = vec![self.chords.chunks(LEAF).map(leaf).collect()];
        while levels.last().is_some_and(|l| l.len() > 1) {
            let below = levels.last().expect("just seen");
            let above = below
                .chunks(FAN)
                .map(|parts| {
                    parts.iter().fold(Bounds::NONE, |mut all, part| {
                        all.take(part);
                        all
                    })
                })
                .collect();
            levels.push(above);
        }
        levels
    }

    /// Calls `leaf` for each leaf within the square distance that `limit` says now, in the program's order, limited to `range` chords.
    fn walk(&self, p: V3, range: &Range<usize>, limit: &mut f64, leaf: &mut dyn FnMut(Range<usize>, &mut f64)) {
        if range.is_empty() || self.chords.is_empty() {
            return;
        }
        self.walk_box(self.levels.len() - 1, 0, p, range, limit, leaf);
    }

    fn walk_box(
        &self,
        level: usize,
        index: usize,
        p: V3,
        range: &Range<usize>,
        limit: &mut f64,
        leaf: &mut dyn FnMut(Range<usize>, &mut f64),
    ) {
        let width = LEAF * FAN.pow(level as u32);
        let covered = index * width..((index + 1) * width).min(self.chords.len());
        if covered.start >= range.end || covered.end <= range.start || self.levels[level][index].square_distance(p) > *limit {
            return;
        }
        if level == 0 {
            leaf(covered.start.max(range.start)..covered.end.min(range.end), limit);
            return;
        }
        let children = index * FAN..((index + 1) * FAN).min(self.levels[level - 1].len());
        for child in children {
            self.walk_box(level - 1, child, p, range, limit, leaf);
        }
    }

    /// The nearest place within `range` chords and `radius` mm. `guess` is a chord that is likely near; it only saves time.
    pub(crate) fn nearest(&self, p: V3, range: Range<usize>, radius: f64, guess: Option<usize>) -> Option<Hit> {
        let range = range.start..range.end.min(self.chords.len());
        let mut best: Option<Hit> = None;
        let mut limit = radius * radius;
        if let Some(chord) = guess.filter(|g| range.contains(g)) {
            let (t, square) = nearest_on_chord(p, self.chords[chord].from, self.chords[chord].along);
            if square <= limit {
                limit = square;
                best = Some(Hit {
                    chord: chord as u32,
                    t,
                    distance: square.sqrt(),
                });
            }
        }
        if !range.is_empty() {
            self.descend(self.levels.len() - 1, 0, p, &range, &mut limit, &mut best);
        }
        best
    }

    /// Looks into the nearest boxes first.
    fn descend(&self, level: usize, index: usize, p: V3, range: &Range<usize>, limit: &mut f64, best: &mut Option<Hit>) {
        if level == 0 {
            let chords = (index * LEAF).max(range.start)..((index + 1) * LEAF).min(range.end);
            for k in chords {
                let (t, square) = nearest_on_chord(p, self.chords[k].from, self.chords[k].along);
                if square < *limit || (best.is_none() && square <= *limit) {
                    *limit = square;
                    *best = Some(Hit {
                        chord: k as u32,
                        t,
                        distance: square.sqrt(),
                    });
                }
            }
            return;
        }
        let width = LEAF * FAN.pow(level as u32 - 1);
        let below = &self.levels[level - 1];
        let mut near = [(f64::INFINITY, 0usize); FAN];
        let mut count = 0;
        for (child, bounds) in below.iter().enumerate().skip(index * FAN).take(FAN) {
            if child * width >= range.end || (child + 1) * width <= range.start {
                continue;
            }
            let square = bounds.square_distance(p);
            if square <= *limit {
                near[count] = (square, child);
                count += 1;
            }
        }
        near[..count].sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (square, child) in &near[..count] {
            if *square <= *limit {
                self.descend(level - 1, *child, p, range, limit, best);
            }
        }
    }

    /// Places where the distance along the chain has a minimum below `radius`, in the program's order. A stretch of the chain that
    /// runs past the point gives one place, two legs of a corner give two.
    pub(crate) fn minima(&self, p: V3, range: Range<usize>, radius: f64, found: &mut Vec<Hit>) {
        let mut limit = radius * radius;
        // The hit before, and whether the distance was falling towards it.
        let mut last: Option<Hit> = None;
        let mut falling = true;
        let range = range.start..range.end.min(self.chords.len());
        self.walk(p, &range, &mut limit, &mut |chords, limit| {
            for k in chords {
                let (t, square) = nearest_on_chord(p, self.chords[k].from, self.chords[k].along);
                if square > *limit {
                    continue;
                }
                let hit = Hit {
                    chord: k as u32,
                    t,
                    distance: square.sqrt(),
                };
                match last {
                    Some(before) if before.chord + 1 == hit.chord && self.joined(k) => {
                        // Between the two nearest places the distance rises unless they share the joint.
                        if falling && !(before.t >= 1.0 && hit.t > 0.0) {
                            found.push(before);
                        }
                        falling = hit.t > 0.0;
                    }
                    Some(before) => {
                        if falling {
                            found.push(before);
                        }
                        falling = true;
                    }
                    None => {}
                }
                last = Some(hit);
            }
        });
        if let Some(before) = last.filter(|_| falling) {
            found.push(before);
        }
    }

    /// True when chord `k` begins where the one before ends.
    fn joined(&self, k: usize) -> bool {
        let before = &self.chords[k - 1];
        distance(add(before.from, before.along), self.chords[k].from) < 1e-6
    }
}

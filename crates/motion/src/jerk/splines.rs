//! Splines as curves over their length.
//!
//! A limit of jerk needs the first three derivatives by the length, which no spline has in closed form. A spline is cut into parts, and each
//! becomes the polynomial of degree 5 over the length that has place, direction and curvature of the spline at both ends of the part; parts
//! are halved until they are within [`FIT`] of it. So any knots, weights and parameters are treated alike, and nothing is used of the
//! tolerance but where the curvature of the spline itself steps. What has no direction, or turns within a hair, becomes chords.

use super::course::Onset;
use super::vector::{V3, add_scaled, dot, length, minus, scaled};
use crate::smooth::{Corner, Piece};
use plan::{Path, Spline};
use units::Point;

/// Largest distance of a part from its spline, mm, and the largest share of a tolerance that it may be.
const FIT: f64 = 5e-5;
const FIT_SHARE: f64 = 0.04;
const LEAST_FIT: f64 = 1e-7;

/// Largest turn along a part, rad.
const TURN: f64 = 0.5;

/// Cells that a span between two knots is looked at in, and halvings of one of them. Where the spline has no direction a halving counts twice:
/// nothing says that it ever has one.
const CELLS: usize = 4;
const HALVINGS: u32 = 24;

/// How exactly a length is known, as a share; and halvings for it.
const LENGTH_ERROR: f64 = 1e-10;
const LENGTH_HALVINGS: u32 = 24;

/// Largest turn of a chord where the spline has no direction, rad.
const CHORD_TURN: f64 = 0.12;

/// Parts shorter than this, mm, that do not fit become chords: a sharper bend is a corner.
const SHORTEST: f64 = 2e-4;

/// Largest share of a part's length between two looks.
const WIDEST_GAP: f64 = 0.6;

/// Shares of a cell at which a part that is no longer is looked at.
const LOOKS: [f64; 3] = [0.25, 0.5, 0.75];

/// Difference of curvature, 1/mm, that is a last digit: at 500 mm/s it is an acceleration of 0.0003 mm/s^2.
const SAME_CURVATURE: f64 = 1e-9;

/// A derivative shorter than this share of the mean one gives no direction.
const NO_DIRECTION: f64 = 1e-10;

/// 5-point Gauss-Legendre: places in -1..1 and weights.
const NODES: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// A part of a spline, and how it goes on from what is before it.
pub(super) struct Part {
    pub(super) piece: Piece,
    pub(super) onset: Onset,
}

/// Direction and curvature by the length.
#[derive(Clone, Copy)]
struct Bearing {
    along: V3,
    bend: V3,
}

/// A place of the spline.
#[derive(Clone, Copy)]
struct Node {
    u: f64,
    /// Length from the beginning, mm.
    s: f64,
    place: V3,
    /// Before it and behind it: at a knot the curvature may step.
    sides: [Bearing; 2],
    /// It has a direction of its own, and the curvature goes on.
    smooth: bool,
    directed: bool,
    knot: bool,
}

/// The parts of a spline, and how far they are off it, mm.
pub(super) fn of(piece: &Piece) -> (Vec<Part>, f64) {
    let Path::Spline(spline) = &piece.path else {
        let (piece, onset) = (piece.clone(), Onset::Move);
        return (vec![Part { piece, onset }], 0.0);
    };
    let within = match piece.corner {
        Corner::Stop => Corner::Within(crate::smooth::EXACT_PATH_TOLERANCE),
        within => within,
    };
    let mut fitting = Fitting {
        piece,
        within,
        mean: piece.length,
        fit: FIT.min(FIT_SHARE * within.tolerance()).max(LEAST_FIT),
        parts: vec![],
        off: 0.0,
    };
    if spline.degree == 1 && spline.poles.len() == 2 {
        let nodes = [0.0, 1.0].map(|u| fitting.node(u, u * piece.length, false));
        fitting.chord(&nodes[0], &nodes[1]);
    } else {
        let nodes = fitting.nodes(spline);
        fitting.within(&nodes);
    }
    if let Some(last) = fitting.parts.last_mut() {
        last.piece.corner = piece.corner;
    }
    if let Some(first) = fitting.parts.first_mut() {
        first.onset = Onset::Move;
    }
    (fitting.parts, fitting.off)
}

struct Fitting<'a> {
    piece: &'a Piece,
    /// How far joints of parts may be rounded.
    within: Corner,
    /// Mean length of the derivative by the parameter, mm.
    mean: f64,
    fit: f64,
    parts: Vec<Part>,
    off: f64,
}

impl Fitting<'_> {
    /// Places at all knots and between them.
    fn nodes(&self, spline: &Spline<units::Machine>) -> Vec<Node> {
        let (low, high) = (spline.knots[spline.degree], spline.knots[spline.poles.len()]);
        let inner = spline.knots.iter().map(|k| (k - low) / (high - low));
        let mut nodes = vec![self.node(0.0, 0.0, false)];
        for end in inner.filter(|u| *u > 1e-12 && *u < 1.0 - 1e-12).chain([1.0]) {
            let from = nodes[nodes.len() - 1];
            let width = end - from.u;
            if width <= 1e-12 {
                continue;
            }
            for k in 1..=CELLS {
                let u = if k == CELLS {
                    end
                } else {
                    from.u + width * k as f64 / CELLS as f64
                };
                let last = nodes[nodes.len() - 1];
                let s = last.s + self.length_between(last.u, u);
                nodes.push(self.node(u, s, k == CELLS && end < 1.0));
            }
        }
        nodes
    }

    fn node(&self, u: f64, s: f64, knot: bool) -> Node {
        let place = self.piece.path.at(u).xyz;
        // On a knot the spline itself is the one behind it.
        let hair = 1e-11;
        let mut sides = [self.bearing(if knot { u - hair } else { u }), self.bearing(u)];
        let (mut smooth, directed) = (true, sides.iter().all(Option::is_some));
        for (side, forward) in [(0, -1.0), (1, 1.0)] {
            if sides[side].is_none() {
                // No direction of its own: that of a chord.
                let step = if (u == 0.0) || (u < 1.0 && forward > 0.0) {
                    1e-5
                } else {
                    -1e-5
                };
                let chord = minus(self.piece.path.at((u + step).clamp(0.0, 1.0)).xyz, place);
                let long = length(chord).max(1e-300);
                sides[side] = Some(Bearing {
                    along: scaled(chord, step.signum() / long),
                    bend: [0.0; 3],
                });
                smooth = false;
            }
        }
        let [Some(before), Some(mut behind)] = sides else {
            unreachable!("both are there by now")
        };
        if length(minus(before.bend, behind.bend)) > SAME_CURVATURE + 1e-7 * length(behind.bend) {
            smooth = false;
        } else if smooth {
            behind = before;
        }
        Node {
            u,
            s,
            place,
            sides: [before, behind],
            smooth,
            directed,
            knot,
        }
    }

    fn bearing(&self, u: f64) -> Option<Bearing> {
        let (first, second) = self.piece.path.derivatives(u);
        let speed = first.length();
        if speed.is_nan() || speed <= NO_DIRECTION * self.mean {
            return None;
        }
        let along = scaled(first.xyz, 1.0 / speed);
        let mut bend = second.xyz;
        add_scaled(&mut bend, along, -dot(second.xyz, along));
        let bend = scaled(bend, 1.0 / (speed * speed));
        bend.iter().all(|x| x.is_finite()).then_some(Bearing { along, bend })
    }

    fn length_between(&self, from: f64, to: f64) -> f64 {
        self.length_within(from, to, self.gauss(from, to), LENGTH_HALVINGS)
    }

    fn length_within(&self, from: f64, to: f64, about: f64, depth: u32) -> f64 {
        let middle = (from + to) / 2.0;
        let (first, second) = (self.gauss(from, middle), self.gauss(middle, to));
        let sum = first + second;
        // No curve is shorter than its chord: what moves within a hair of the parameter is not seen otherwise.
        let least = || self.piece.path.at(from).distance(self.piece.path.at(to));
        if depth == 0 || (sum - about).abs() <= LENGTH_ERROR * sum + 1e-13 && sum >= least() * (1.0 - 1e-9) - 1e-12 {
            return sum;
        }
        self.length_within(from, middle, first, depth - 1) + self.length_within(middle, to, second, depth - 1)
    }

    fn gauss(&self, from: f64, to: f64) -> f64 {
        let (half, middle) = ((to - from) / 2.0, (from + to) / 2.0);
        let speeds = NODES
            .iter()
            .map(|(x, w)| w * self.piece.path.derivatives(middle + half * x).0.length());
        half * speeds.sum::<f64>()
    }

    /// Parts between the first and the last of these places.
    fn within(&mut self, nodes: &[Node]) {
        let last = nodes.len() - 1;
        if last == 1 {
            self.within_cell(&nodes[0], &nodes[1], HALVINGS);
            return;
        }
        if are_spread(nodes.iter())
            && let Some(terms) = self.polynomial(&nodes[0], &nodes[last])
            && let Some(off) = self.distance(
                &terms,
                &nodes[0],
                &nodes[last],
                nodes[last / 2..last].iter().chain(&nodes[1..last / 2]),
            )
        {
            self.off = self.off.max(off);
            self.add(&terms, nodes);
            return;
        }
        // At the knot that is nearest to the middle: the third derivative steps there.
        let away = |k: &usize| k.abs_diff(last / 2);
        let middle = (1..last).filter(|k| nodes[*k].knot).min_by_key(away).unwrap_or(last / 2);
        self.within(&nodes[..=middle]);
        self.within(&nodes[middle..]);
    }

    /// The same between two neighbours.
    fn within_cell(&mut self, from: &Node, to: &Node, depth: u32) {
        let looks = LOOKS.map(|share| {
            let u = from.u + (to.u - from.u) * share;
            Node {
                s: from.s + self.length_between(from.u, u),
                place: self.piece.path.at(u).xyz,
                ..*from
            }
        });
        if are_spread([from].into_iter().chain(&looks).chain([to]))
            && let Some(terms) = self.polynomial(from, to)
            && let Some(off) = self.distance(&terms, from, to, looks.iter())
        {
            self.off = self.off.max(off);
            self.add(&terms, &[*from, *to]);
            return;
        }
        let directed = from.directed && to.directed;
        let off = off_chord(from, to, &looks);
        let long = (to.s - from.s).max(length(minus(to.place, from.place)));
        if depth == 0 || long < SHORTEST || !directed && off <= self.fit && is_even(from, to, &looks) {
            self.off = self.off.max(off);
            self.chord(from, to);
            return;
        }
        let u = (from.u + to.u) / 2.0;
        let s = (from.s + self.length_between(from.u, u)).clamp(from.s, to.s);
        let middle = self.node(u, s, false);
        let less = depth.saturating_sub(if directed { 1 } else { 2 });
        self.within_cell(from, &middle, less);
        self.within_cell(&middle, to, less);
    }

    /// The polynomial between two places over the share of the length: its Bezier points from the first one on.
    fn polynomial(&self, from: &Node, to: &Node) -> Option<[V3; 6]> {
        let long = to.s - from.s;
        let (a, b) = (&from.sides[1], &to.sides[0]);
        let turn = length(minus(b.along, a.along));
        if long <= 1e-9 || turn > TURN || (length(a.bend) + length(b.bend)) * long > 4.0 * TURN {
            return None;
        }
        let point = |node: &Node, bearing: &Bearing, step: f64, share: f64| {
            let mut p = minus(node.place, from.place);
            add_scaled(&mut p, bearing.along, step);
            add_scaled(&mut p, bearing.bend, share * long * long);
            p
        };
        Some([
            [0.0; 3],
            point(from, a, long / 5.0, 0.0),
            point(from, a, long * 0.4, 0.05),
            point(to, b, -long * 0.4, 0.05),
            point(to, b, -long / 5.0, 0.0),
            minus(to.place, from.place),
        ])
    }

    /// The largest distance of the polynomial from these places, if that is little enough.
    fn distance<'n>(&self, points: &[V3; 6], from: &Node, to: &Node, looks: impl Iterator<Item = &'n Node>) -> Option<f64> {
        let mut worst = 0.0f64;
        for look in looks {
            let share = (look.s - from.s) / (to.s - from.s);
            let (x, y) = (share, 1.0 - share);
            let weights = [
                y * y * y * y * y,
                5.0 * y * y * y * y * x,
                10.0 * y * y * y * x * x,
                10.0 * y * y * x * x * x,
                5.0 * y * x * x * x * x,
                x * x * x * x * x,
            ];
            let mut off = minus(from.place, look.place);
            for (point, weight) in points.iter().zip(weights) {
                add_scaled(&mut off, *point, weight);
            }
            worst = worst.max(length(off));
            if worst.is_nan() || worst > self.fit {
                return None;
            }
        }
        Some(worst)
    }

    /// Adds the part between the first and the last of these places.
    fn add(&mut self, points: &[V3; 6], nodes: &[Node]) {
        let (from, to) = (&nodes[0], &nodes[nodes.len() - 1]);
        let long = to.s - from.s;
        let share = |u: f64| {
            let near = &nodes[nodes.partition_point(|n| n.u <= u).clamp(1, nodes.len() - 1) - 1];
            ((near.s + self.length_between(near.u, u) - from.s) / long).clamp(0.0, 1.0)
        };
        let feed_factors = factors_between(&self.piece.feed_factors, from.u, to.u, share);
        let poles = points.map(|p| {
            let mut place = from.place;
            add_scaled(&mut place, p, 1.0);
            Point::from_xyz(place)
        });
        let mut poles = poles.to_vec();
        poles[5] = Point::from_xyz(to.place);
        let path = Path::Spline(Spline {
            degree: 5,
            poles,
            weights: vec![],
            knots: [[0.0; 6], [1.0; 6]].concat(),
        });
        self.push(path, long, feed_factors, from);
    }

    fn chord(&mut self, from: &Node, to: &Node) {
        let path = Path::Line {
            from: self
                .parts
                .last()
                .map_or(Point::from_xyz(from.place), |last| last.piece.path.end()),
            to: Point::from_xyz(to.place),
        };
        let long = path.length();
        if long > 1e-9 {
            let share = |u: f64| (u - from.u) / (to.u - from.u);
            let feed_factors = factors_between(&self.piece.feed_factors, from.u, to.u, share);
            self.push(path, long, feed_factors, from);
        }
    }

    fn push(&mut self, path: Path<units::Machine>, length: f64, feed_factors: Vec<(f64, f64)>, from: &Node) {
        let is_curve = |path: &Path<units::Machine>| matches!(path, Path::Spline(_));
        let goes_on = from.smooth && is_curve(&path) && self.parts.last().is_some_and(|last| is_curve(&last.piece.path));
        let piece = Piece {
            path,
            length,
            feed_factors,
            corner: self.within,
            feed: self.piece.feed,
            rapid: self.piece.rapid,
            tie: self.piece.tie,
            step: self.piece.step,
        };
        let onset = if goes_on { Onset::Smooth } else { Onset::Inside };
        self.parts.push(Part { piece, onset });
    }
}

/// True when looks at these places miss no large part of the length: wild weights move along within a hair of the parameter.
fn are_spread<'n>(nodes: impl Iterator<Item = &'n Node>) -> bool {
    let (mut first, mut last, mut gap) = (None, 0.0f64, 0.0f64);
    for node in nodes {
        gap = gap.max(node.s - first.map_or(node.s, |_| last));
        first = first.or(Some(node.s));
        last = node.s;
    }
    gap <= WIDEST_GAP * (last - first.unwrap_or(last))
}

/// The largest distance of these places from a chord, mm.
fn off_chord(from: &Node, to: &Node, looks: &[Node]) -> f64 {
    let chord = minus(to.place, from.place);
    let squared = dot(chord, chord).max(1e-300);
    let off = looks.iter().map(|look| {
        let mut off = minus(look.place, from.place);
        let along = (dot(off, chord) / squared).clamp(0.0, 1.0);
        add_scaled(&mut off, chord, -along);
        length(off)
    });
    off.fold(0.0, f64::max)
}

/// True when a chord turns little from its first part to its last.
fn is_even(from: &Node, to: &Node, looks: &[Node]) -> bool {
    let (out, into) = (
        minus(looks[0].place, from.place),
        minus(to.place, looks[looks.len() - 1].place),
    );
    let sizes = length(out) * length(into);
    sizes == 0.0 || dot(out, into) >= sizes * (1.0 - 0.5 * CHORD_TURN * CHORD_TURN)
}

/// The multipliers of the feed between two parameters, over the share of the length between them.
fn factors_between(factors: &[(f64, f64)], from: f64, to: f64, share: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    if factors.is_empty() {
        return vec![];
    }
    // On a step, that of the side that is inside.
    const SAME: f64 = 1e-12;
    let between = |u: f64, at: usize| match (at.checked_sub(1).map(|k| factors[k]), factors.get(at)) {
        (Some(a), Some(b)) if b.0 - a.0 > SAME => a.1 + (b.1 - a.1) * ((u - a.0) / (b.0 - a.0)).clamp(0.0, 1.0),
        (Some(a), _) => a.1,
        (None, b) => b.map_or(1.0, |b| b.1),
    };
    let (first, last) = (
        factors.partition_point(|p| p.0 <= from + SAME),
        factors.partition_point(|p| p.0 < to - SAME),
    );
    let mut inside = vec![(0.0, between(from, first))];
    inside.extend(factors[first.min(last)..last].iter().map(|p| (share(p.0), p.1)));
    inside.push((1.0, between(to, last)));
    inside
}

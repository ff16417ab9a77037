//! Which place of the plan each sample is: a monotone alignment of a record with the plan's path, by position and time.
//!
//! Every sample has candidates: the places where the plan passes near it. A path through the candidates is chosen that costs least
//! (Viterbi): distance from the plan costs, path that must be hidden between two samples costs by the time the machine would have needed
//! for it, going back in the program costs much, and being nowhere on the plan (a tool change, a retract, what was recorded before the
//! program began) costs a fixed price a sample. No speed is compared with a threshold, so a rapid of two samples is found by where it
//! lies, and feed override, pauses and jitter do no harm.

use crate::flat::{Flat, Hit};
use crate::vec3::{V3, distance};
use libm::log;

/// A sample as the alignment sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    /// Seconds since the first sample.
    pub(crate) time: f64,
    pub(crate) place: V3,
}

/// Distances that count as noise on a feed path and on a rapid path, mm. Only ratios of costs depend on them.
const NOISE: f64 = 0.02;
const NOISE_RAPID: f64 = 0.1;
/// Cost of a jump forward over any length of plan, and of a jump back.
const JUMP: f64 = 20.0;
const JUMP_BACK: f64 = 40.0;
/// Times shorter than this are not compared, s.
const SHORT: f64 = 0.02;
/// Candidates kept for a sample.
const MOST: usize = 16;
/// Candidates this much dearer than the best are given up.
const BEAM: f64 = 50.0;
/// Samples after which everything but the last [`TAIL`] is decided, so that memory does not grow with the record.
const BLOCK: usize = 40_000;
const TAIL: usize = 2_000;

/// Where on the plan each sample is; `None` for nowhere.
pub(crate) struct Alignment {
    pub(crate) hits: Vec<Option<Hit>>,
}

#[derive(Clone, Copy)]
struct Node {
    /// `None` is nowhere.
    hit: Option<Hit>,
    /// Path length and nominal time of the last place on the plan.
    s: f64,
    time: f64,
    /// The sample that was there; `u32::MAX` for none yet.
    anchor: u32,
    cost: f64,
    back: u8,
}

/// Aligns a record with a plan. `radius`: samples further from the plan than this are nowhere on it, mm.
pub(crate) fn align(flat: &Flat, spots: &[Spot], radius: f64) -> Alignment {
    let mut hits = vec![None; spots.len()];
    if flat.chords.is_empty() || spots.is_empty() {
        return Alignment { hits };
    }
    let nowhere = log(1.0 + (radius / NOISE) * (radius / NOISE));
    let mut columns: Vec<Vec<Node>> = Vec::new();
    let mut first = 0;
    let mut found: Vec<Hit> = Vec::new();
    for (k, spot) in spots.iter().enumerate() {
        let before = columns.last().map_or(&[][..], |c| &c[..]);
        candidates(flat, spots, k, before, radius, &mut found);
        let mut column: Vec<Node> = Vec::with_capacity(found.len() + 1);
        for hit in &found {
            let noise = if flat.chords[hit.chord as usize].rapid {
                NOISE_RAPID
            } else {
                NOISE
            };
            let ratio = hit.distance / noise;
            let own = log(1.0 + ratio * ratio);
            let mut node = Node {
                hit: Some(*hit),
                s: flat.s_at(hit),
                time: flat.time_at(hit),
                anchor: k as u32,
                cost: f64::INFINITY,
                back: 0,
            };
            if before.is_empty() {
                node.cost = own + if node.s > 0.0 { JUMP / 4.0 } else { 0.0 };
            }
            for (b, prior) in before.iter().enumerate() {
                // The column is in order of cost: what follows is dearer before its step is counted.
                if prior.cost + own >= node.cost {
                    break;
                }
                let cost = prior.cost + own + step_cost(spots, prior, &node, spot);
                if cost < node.cost {
                    (node.cost, node.back) = (cost, b as u8);
                }
            }
            column.push(node);
        }
        let mut off = Node {
            hit: None,
            s: 0.0,
            time: 0.0,
            anchor: u32::MAX,
            cost: if before.is_empty() { nowhere } else { f64::INFINITY },
            back: 0,
        };
        for (b, prior) in before.iter().enumerate() {
            let cost = prior.cost + nowhere;
            if cost < off.cost {
                off = Node {
                    hit: None,
                    cost,
                    back: b as u8,
                    ..*prior
                };
            }
        }
        column.push(off);
        let least = column.iter().map(|n| n.cost).fold(f64::INFINITY, f64::min);
        column.retain(|n| n.cost <= least + BEAM);
        column.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        column.truncate(MOST);
        // Costs are only compared: taking the least away keeps them small over millions of samples.
        for node in &mut column {
            node.cost -= least;
        }
        columns.push(column);
        if columns.len() > BLOCK + TAIL {
            decide(&columns, first, &mut hits);
            columns.drain(..BLOCK);
            first += BLOCK;
        }
    }
    decide(&columns, first, &mut hits);
    Alignment { hits }
}

/// Writes the cheapest way through the columns; `first` is the sample of the first column.
fn decide(columns: &[Vec<Node>], first: usize, hits: &mut [Option<Hit>]) {
    let Some(last) = columns.last() else { return };
    let mut at = (0..last.len())
        .min_by(|a, b| last[*a].cost.total_cmp(&last[*b].cost))
        .unwrap_or(0);
    for (k, column) in columns.iter().enumerate().rev() {
        let node = &column[at];
        hits[first + k] = node.hit;
        at = node.back as usize;
    }
}

/// Places of the plan near a sample. For each way that is still alive, those that the machine can have come to since; when that finds
/// nothing near, all of the plan is searched.
fn candidates(flat: &Flat, spots: &[Spot], k: usize, before: &[Node], radius: f64, found: &mut Vec<Hit>) {
    found.clear();
    let p = spots[k].place;
    let all = 0..flat.chords.len();
    // How near the plan the record runs at present: on the path there is no need to hear of everything around.
    let near = before
        .iter()
        .filter_map(|n| n.hit)
        .map(|h| h.distance)
        .fold(f64::INFINITY, f64::min);
    let narrow = if near.is_finite() {
        (near * 3.0 + 0.2).min(radius)
    } else {
        radius
    };
    let mut windows: Vec<std::ops::Range<usize>> = Vec::with_capacity(before.len());
    for node in before.iter().filter(|n| n.anchor != u32::MAX) {
        let anchor = &spots[node.anchor as usize];
        let by_way = flat.chord_at(node.s + 1.5 * distance(anchor.place, p) + 0.5);
        let by_time = flat.chord_at_time(node.time + 3.0 * (spots[k].time - anchor.time) + 0.1);
        // After a tool change anything may have passed; what lies far ahead is found by the search over all.
        let to = by_way.max(by_time.min(by_way + FAR_AHEAD));
        windows.push(flat.chord_at(node.s - 0.05)..to + 1);
    }
    windows.sort_by_key(|w| w.start);
    let mut end = 0;
    for window in &windows {
        // Places are looked for once; the nearest of each window is always among the candidates.
        let from = window.start.max(end);
        if from < window.end {
            let before = found.len();
            flat.minima(p, from..window.end, narrow, found);
            if found.len() == before
                && let Some(hit) = flat.nearest(p, window.clone(), radius, None)
            {
                found.push(hit);
            }
            end = window.end;
        }
    }
    let lost = !found.iter().any(|h| h.distance <= near * 3.0 + 0.1) || before.first().is_none_or(|n| n.hit.is_none());
    if lost {
        let known = found.len();
        flat.minima(p, all.clone(), narrow, found);
        if found.len() == known && narrow < radius {
            flat.minima(p, all, radius, found);
        }
        // Nearest first, and the next few in the program's order: of many passes over the same place the next is as likely as the
        // nearest.
        let ahead = before.first().map_or(0.0, |n| n.s);
        let mut next: Vec<Hit> = found[known..]
            .iter()
            .filter(|h| flat.s_at(h) >= ahead - 0.05)
            .take(MOST / 2)
            .copied()
            .collect();
        found.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        found.truncate(2 * MOST);
        found.append(&mut next);
    }
    found.sort_by(|a, b| a.chord.cmp(&b.chord).then(a.t.total_cmp(&b.t)));
    found.dedup_by(|a, b| a.chord == b.chord && (a.t - b.t).abs() < 1e-9);
    // `back` is a byte.
    found.truncate(200);
}

/// Chords that are looked ahead by time.
const FAR_AHEAD: usize = 2000;

/// What it costs to come from one candidate to the next.
fn step_cost(spots: &[Spot], prior: &Node, node: &Node, spot: &Spot) -> f64 {
    if prior.anchor == u32::MAX {
        return JUMP / 4.0;
    }
    let anchor = &spots[prior.anchor as usize];
    let elapsed = spot.time - anchor.time;
    let moved = distance(anchor.place, spot.place);
    let travelled = node.s - prior.s;
    let off = prior.hit.map_or(0.0, |h| h.distance) + node.hit.map_or(0.0, |h| h.distance);
    // Standing, noise lets the place swing by a little.
    if travelled < 0.0 {
        let back = -travelled;
        return if back <= 2.0 * off + 0.02 { back * 20.0 } else { JUMP_BACK };
    }
    let nominal = (node.time - prior.time).max(0.0);
    let hidden = (travelled - moved - off).max(0.0);
    let hidden_time = if travelled > 0.0 { nominal * hidden / travelled } else { 0.0 };
    let ratio = hidden_time / (elapsed + SHORT);
    let jump = 4.0 * ratio * ratio;
    let pace = log((nominal + SHORT) / (elapsed + SHORT));
    let pace = if pace > 0.0 { pace.min(3.0) } else { (-pace).min(2.0) };
    // From nowhere there is no pace: a tool change takes its own time.
    let pace = if prior.hit.is_none() { 0.0 } else { pace };
    (jump + pace).min(JUMP)
}

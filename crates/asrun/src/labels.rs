//! From places on the plan to toolpaths: which samples belong to which toolpath, with the borders put where time says.
//!
//! A sample near a border lies as near to the toolpath before as to the one after. There, motion decides: when the machine must have
//! left the one and come to the other, counted from the last sample that is clearly on the way and from the next.

use crate::align::{Spot, align};
use crate::flat::{Flat, Hit};
use crate::planned::PlannedProgram;
use crate::vec3::{V3, distance, length, quantile, scale, sub};
use plan::executed::PathKind;

/// What a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Label {
    /// On this toolpath of the plan.
    On(usize),
    /// Standing between two toolpaths, or in a step that is no move: part of the run, on no toolpath.
    Between,
    /// Nowhere on the plan.
    Nowhere,
}

impl Label {
    pub(crate) fn toolpath(self) -> Option<usize> {
        match self {
            Label::On(toolpath) => Some(toolpath),
            _ => None,
        }
    }
}

/// Labels for a record without steps.
pub(crate) fn by_position(plan: &PlannedProgram, flat: &Flat, spots: &[Spot], noise: f64) -> Vec<Label> {
    let radius = (flat.diagonal() * 0.05).clamp(1.0, 20.0);
    let hits = align(flat, spots, radius).hits;
    let mut labels: Vec<Label> = hits
        .iter()
        .map(|hit| hit.map_or(Label::Nowhere, |h| Label::On(flat.chords[h.chord as usize].toolpath as usize)))
        .collect();
    loose_rapids(plan, flat, spots, &hits, &mut labels);
    borders(plan, flat, spots, &hits, noise, &mut labels);
    labels
}

/// The noise of positions, per axis, as the record shows it: second differences of an even motion are nothing but noise.
pub(crate) fn noise_of(spots: &[Spot]) -> f64 {
    let mut seconds: Vec<f64> = Vec::new();
    for w in spots.windows(3) {
        let (before, after) = (w[1].time - w[0].time, w[2].time - w[1].time);
        if before <= 0.0 || after <= 0.0 {
            continue;
        }
        // What an even motion from the first to the third would have given for the second.
        let share = before / (before + after);
        for k in 0..3 {
            let expected = w[0].place[k] + (w[2].place[k] - w[0].place[k]) * share;
            let off = (w[1].place[k] - expected).abs();
            if off > 0.0 {
                seconds.push(off);
            }
        }
    }
    // Half of the samples are quieter; for normal noise the median of |x| is 0.67 sigma, and the difference above has 1.22 sigma.
    let median = quantile(&mut seconds, 0.5) / (0.6745 * 1.2247);
    // Curved paths bend between samples: that is not noise.
    median.min(0.01)
}

/// Samples off the plan between two places of it, where the plan moves at rapid: machines do not run rapids along the straight line
/// (each axis at its own speed), so being beside it is no deviation.
fn loose_rapids(plan: &PlannedProgram, flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], labels: &mut [Label]) {
    let mut k = 0;
    while k < hits.len() {
        if hits[k].is_some() {
            k += 1;
            continue;
        }
        let begin = k;
        while k < hits.len() && hits[k].is_none() {
            k += 1;
        }
        let (Some(before), Some(after)) = (begin.checked_sub(1).and_then(|b| hits[b]), hits.get(k).copied().flatten()) else {
            continue;
        };
        if after.chord < before.chord {
            continue;
        }
        let nominal = flat.time_at(&after) - flat.time_at(&before);
        if spots[k].time - spots[begin - 1].time > 3.0 * nominal + 1.0 {
            continue;
        }
        let mut first = flat.chords[before.chord as usize].toolpath as usize;
        let last = flat.chords[after.chord as usize].toolpath as usize;
        for (spot, label) in spots[begin..k].iter().zip(&mut labels[begin..k]) {
            let around = (first..=last)
                .find(|toolpath| plan.toolpaths[*toolpath].kind == PathKind::Rapid && in_box(flat, *toolpath, spot.place));
            if let Some(toolpath) = around {
                *label = Label::On(toolpath);
                first = toolpath;
            }
        }
    }
}

fn in_box(flat: &Flat, toolpath: usize, p: V3) -> bool {
    let chords = &flat.chords[flat.toolpaths[toolpath].clone()];
    (0..3).all(|k| {
        let ends = chords.iter().flat_map(|c| [c.from[k], c.from[k] + c.along[k]]);
        let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let margin = 1.0 + 0.1 * (high - low);
        p[k] >= low - margin && p[k] <= high + margin
    })
}

/// A border between two toolpaths of the plan that both have a length.
struct Border {
    /// Path length of the plan there.
    s: f64,
    before: usize,
    after: usize,
    /// The dwell that stands there.
    dwell: Option<usize>,
    place: V3,
    /// Nominal times of leaving the one and beginning the other.
    leave: f64,
    begin: f64,
}

fn borders_of(plan: &PlannedProgram, flat: &Flat) -> Vec<Border> {
    let mut borders = Vec::new();
    let mut before: Option<usize> = None;
    let mut dwell = None;
    for (toolpath, chords) in flat.toolpaths.iter().enumerate() {
        if chords.is_empty() {
            if plan.toolpaths[toolpath].kind == PathKind::Dwell {
                dwell = dwell.or(Some(toolpath));
            }
            continue;
        }
        if let Some(before) = before {
            let first = &flat.chords[chords.start];
            let end = Hit {
                chord: chords.start as u32 - 1,
                t: 1.0,
                distance: 0.0,
            };
            borders.push(Border {
                s: first.s,
                before,
                after: toolpath,
                dwell,
                place: first.from,
                leave: flat.time_at(&end),
                begin: first.time,
            });
        }
        before = Some(toolpath);
        dwell = None;
    }
    borders
}

fn borders(plan: &PlannedProgram, flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], noise: f64, labels: &mut [Label]) {
    let all = borders_of(plan, flat);
    if all.is_empty() {
        return;
    }
    let near = (4.0 * noise + 0.002).min(0.05);
    // The border that a sample lies at, if any.
    let at_border = |k: usize| -> Option<usize> {
        let hit = hits[k]?;
        let s = flat.s_at(&hit);
        let after = all.partition_point(|b| b.s < s);
        [after.checked_sub(1), Some(after)]
            .into_iter()
            .flatten()
            .filter(|b| {
                *b < all.len()
                    && (all[*b].s - s).abs() <= near + hit.distance
                    && distance(all[*b].place, flat.place(&hit)) <= near
            })
            .min_by(|a, b| (all[*a].s - s).abs().total_cmp(&(all[*b].s - s).abs()))
    };
    let mut k = 0;
    while k < hits.len() {
        let Some(border) = at_border(k) else {
            k += 1;
            continue;
        };
        let begin = k;
        while k < hits.len() && at_border(k) == Some(border) {
            k += 1;
        }
        let border = &all[border];
        let cluster = begin..k;
        // When the machine came and when it went, by the samples that are clearly on the way.
        let arrival = begin.checked_sub(1).and_then(|b| {
            let hit = hits[b]?;
            let time = flat.time_at(&hit);
            (time <= border.leave).then(|| spots[b].time + pace(flat, spots, hits, b, false) * (border.leave - time))
        });
        let departure = hits.get(k).copied().flatten().and_then(|hit| {
            let time = flat.time_at(&hit);
            (time >= border.begin).then(|| spots[k].time - (time - border.begin))
        });
        let (first, last) = (spots[begin].time, spots[k - 1].time);
        let arrival = arrival.unwrap_or(first);
        let departure = departure.unwrap_or(last);
        for i in cluster {
            let time = spots[i].time;
            labels[i] = if let Some(dwell) = border.dwell.filter(|_| time >= arrival - 1e-9 && time <= departure + 1e-9) {
                Label::On(dwell)
            } else if departure - arrival > STAND && time > arrival + STAND / 2.0 && time < departure - STAND / 2.0 {
                Label::Between
            } else if time - arrival < departure - time {
                Label::On(border.before)
            } else {
                Label::On(border.after)
            };
        }
    }
}

/// A stop at a border that lasts longer is a stop of its own (a tool change, a spindle start), not the corner between two moves, s.
const STAND: f64 = 0.05;

/// Real over nominal time just before (or after) a sample, from its own neighbours; 1 when they tell nothing.
fn pace(flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], k: usize, after: bool) -> f64 {
    let (a, b) = if after { (k, k + 1) } else { (k.wrapping_sub(1), k) };
    let (Some(Some(from)), Some(Some(to))) = (hits.get(a), hits.get(b)) else {
        return 1.0;
    };
    if flat.chords[from.chord as usize].toolpath != flat.chords[to.chord as usize].toolpath {
        return 1.0;
    }
    let nominal = flat.time_at(to) - flat.time_at(from);
    let real = spots[b].time - spots[a].time;
    if nominal > 0.0 && real > 0.0 {
        (real / nominal).clamp(0.3, 3.0)
    } else {
        1.0
    }
}

/// Velocity between two spots, mm/s.
pub(crate) fn speed(from: &Spot, to: &Spot) -> f64 {
    let elapsed = to.time - from.time;
    if elapsed > 0.0 {
        length(scale(sub(to.place, from.place), 1.0 / elapsed))
    } else {
        0.0
    }
}

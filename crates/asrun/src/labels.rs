//! From places on the plan to toolpaths: which samples belong to which toolpath, with the borders put where time says.
//!
//! A sample near a border lies as near to the toolpath before as to the one after. There, motion decides: when the machine must have
//! left the one and come to the other, counted from the last sample that is clearly on the way and from the next.

use crate::align::{Spot, align};
use crate::flat::{Flat, Hit};
use crate::planned::PlannedProgram;
use crate::shift::{Foot, fit};
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
pub(crate) fn by_position(plan: &PlannedProgram, flat: &mut Flat, spots: &[Spot], noise: f64, acceleration: f64) -> Vec<Label> {
    let radius = (flat.diagonal() * 0.05).clamp(1.0, 20.0);
    let mut hits = align(flat, spots, radius).hits;
    let timed = refine_acceleration(flat, spots, &hits, acceleration);
    let unshifted = take_shifts_out(plan, flat, spots, &hits, noise);
    let spots = unshifted.as_deref().unwrap_or(spots);
    if timed || unshifted.is_some() {
        hits = align(flat, spots, radius).hits;
    }
    let flat = &*flat;
    let mut labels: Vec<Label> = hits
        .iter()
        .map(|hit| hit.map_or(Label::Nowhere, |h| Label::On(flat.chords[h.chord as usize].toolpath as usize)))
        .collect();
    loose_rapids(plan, flat, spots, &hits, &mut labels);
    borders(plan, flat, spots, &hits, noise, &mut labels);
    ends(flat, spots, &hits, noise, &mut labels);
    settle(spots, noise, &mut labels);
    labels
}

/// A machine that stands at a border, for a tool change, seems to go to and fro over it by the noise of its encoders. What leaves a
/// toolpath and comes back to it without having gone anywhere has not left it.
fn settle(spots: &[Spot], noise: f64, labels: &mut [Label]) {
    let nowhere = 2.0 * near(noise) + 0.01;
    let extent = |run: &std::ops::Range<usize>| {
        let first = spots[run.start].place;
        spots[run.clone()]
            .iter()
            .map(|spot| distance(first, spot.place))
            .fold(0.0, f64::max)
    };
    let mut settled: Vec<std::ops::Range<usize>> = Vec::new();
    let mut begin = 0;
    while begin < labels.len() {
        let label = labels[begin];
        let end = (begin..labels.len()).find(|k| labels[*k] != label).unwrap_or(labels.len());
        let mut run = begin..end;
        while let [.., same, away] = settled.as_slice() {
            let other = labels[away.start].toolpath().is_some();
            if labels[same.start] != label || label.toolpath().is_none() || !other || extent(away) > nowhere {
                break;
            }
            labels[away.clone()].fill(label);
            run.start = same.start;
            settled.truncate(settled.len() - 2);
        }
        settled.push(run);
        begin = end;
    }
}

/// Spots laid on the plan: a shift that a whole workingstep has in common (a set-up that is off) is taken out, so that it does not blur
/// where toolpaths begin and end. Only labels come from these spots; deviations are measured on the true ones. `None` when there is no
/// such shift.
fn take_shifts_out(plan: &PlannedProgram, flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], noise: f64) -> Option<Vec<Spot>> {
    const MOST: usize = 400;
    let toolpath = |hit: &Hit| flat.chords[hit.chord as usize].toolpath as usize;
    let mut shifts: Vec<Option<V3>> = vec![None; plan.workingsteps.len()];
    let mut samples: Vec<Vec<usize>> = vec![Vec::new(); plan.workingsteps.len()];
    for (k, hit) in hits.iter().enumerate() {
        let Some(hit) = hit else { continue };
        let toolpath = &plan.toolpaths[toolpath(hit)];
        if let Some(workingstep) = toolpath.workingstep.filter(|_| toolpath.kind == PathKind::Feed) {
            samples[workingstep].push(k);
        }
    }
    for (shift, all) in shifts.iter_mut().zip(&samples) {
        let few: Vec<usize> = all.iter().copied().step_by(all.len().div_ceil(MOST).max(1)).collect();
        let spread = |shift: V3| {
            let mut off: Vec<f64> = few
                .iter()
                .filter_map(|k| {
                    let range = flat.toolpaths[toolpath(&hits[*k]?)].clone();
                    Some(
                        flat.nearest(sub(spots[*k].place, shift), range, f64::MAX.sqrt(), None)?
                            .distance,
                    )
                })
                .collect();
            quantile(&mut off, 0.5)
        };
        let before = spread([0.0; 3]);
        if few.len() < 8 || before < 0.005 + 3.0 * noise.min(0.01) {
            continue;
        }
        let places: Vec<V3> = few.iter().map(|k| spots[*k].place).collect();
        let found = fit(&places, [0.0; 3], 8, &mut |k, place| {
            let range = flat.toolpaths[toolpath(&hits[few[k]]?)].clone();
            let hit = flat.nearest(place, range, f64::MAX.sqrt(), None)?;
            let along = flat.chords[hit.chord as usize].along;
            Some(Foot {
                place: flat.place(&hit),
                direction: scale(along, 1.0 / length(along)),
            })
        });
        if spread(found) < 0.5 * before {
            *shift = Some(found);
        }
    }
    if shifts.iter().all(Option::is_none) {
        return None;
    }
    let mut present = shifts
        .iter()
        .flatten()
        .next()
        .copied()
        .filter(|_| shifts[0].is_some())
        .unwrap_or_default();
    let unshifted = spots.iter().zip(hits).map(|(spot, hit)| {
        if let Some(workingstep) = hit.and_then(|hit| plan.toolpaths[toolpath(&hit)].workingstep) {
            present = shifts[workingstep].unwrap_or_default();
        }
        Spot {
            time: spot.time,
            place: sub(spot.place, present),
        }
    });
    Some(unshifted.collect())
}

/// Times the plan with the acceleration that fits the record's own rapids best; true when it is another one than before.
///
/// Rapids are where it matters, and a first alignment knows nearly all of them.
fn refine_acceleration(flat: &mut Flat, spots: &[Spot], hits: &[Option<Hit>], acceleration: f64) -> bool {
    const FACTORS: [f64; 9] = [1.0, 0.71, 1.41, 0.5, 2.0, 0.35, 2.83, 0.25, 4.0];
    // Ways with a rapid in them, from sample to sample.
    let ways: Vec<(Hit, Hit, f64)> = hits
        .windows(2)
        .zip(spots.windows(2))
        .filter_map(|(h, s)| {
            let (from, to) = (h[0]?, h[1]?);
            let rapid = flat.chords[from.chord as usize].rapid || flat.chords[to.chord as usize].rapid;
            (rapid && from.chord <= to.chord && flat.place(&from) != flat.place(&to)).then_some((from, to, s[1].time - s[0].time))
        })
        .take(4000)
        .collect();
    if ways.len() < 20 || flat.chords.len() > 300_000 {
        return false;
    }
    let mut best = (f64::INFINITY, 1.0);
    for factor in FACTORS {
        flat.retime(acceleration * factor);
        let mut off: Vec<f64> = ways
            .iter()
            .map(|(from, to, real)| (flat.time_at(to) - flat.time_at(from) - real).abs())
            .collect();
        // The half that fits best: stops and tool changes take their own time.
        let score = quantile(&mut off, 0.5);
        if score < best.0 * 0.95 {
            best = (score, factor);
        }
    }
    flat.retime(acceleration * best.1);
    best.1 != 1.0
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
    quantile(&mut seconds, 0.5) / (0.6745 * 1.2247)
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
    /// Where the one ends and where the other begins: not the same when a tool or set-up change lies between.
    places: [V3; 2],
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
                places: [flat.place(&end), first.from],
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
    let near = near(noise);
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
                    && all[*b].places.iter().any(|p| distance(*p, flat.place(&hit)) <= near)
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
            (time <= border.leave).then(|| spots[b].time + pace(flat, spots, hits, b.wrapping_sub(1)) * (border.leave - time))
        });
        let departure = hits.get(k).copied().flatten().and_then(|hit| {
            let time = flat.time_at(&hit);
            (time >= border.begin).then(|| spots[k].time - pace(flat, spots, hits, k) * (time - border.begin))
        });
        let (first, last) = (spots[begin].time, spots[k - 1].time);
        let arrival = arrival.unwrap_or(first);
        let departure = departure.unwrap_or(last);
        // A feed is even, so its side of the border is known well; a rapid's side hangs on an acceleration that nobody said.
        let feed = |toolpath: usize| plan.toolpaths[toolpath].kind == PathKind::Feed;
        let (feed_before, feed_after) = (feed(border.before), feed(border.after));
        let passed = match (feed_before, feed_after) {
            (true, false) => arrival,
            (false, true) => departure,
            _ => (arrival + departure) / 2.0,
        };
        let from_border = |i: usize| hits[i].map_or(0.0, |hit| flat.s_at(&hit) - border.s);
        for i in cluster {
            let time = spots[i].time;
            // Within the noise of the border the machine is for a few milliseconds only, unless it stands there.
            let stands = border.dwell.is_some() || departure - arrival > STAND;
            // The first sample may still be coming and the last one going: then it is further off than noise makes likely.
            let coming = (feed_before && time < arrival) || (i == begin && from_border(i) < -2.5 * noise);
            let going = (feed_after && time > departure) || (i + 1 == k && from_border(i) > 2.5 * noise);
            labels[i] = if stands && coming {
                Label::On(border.before)
            } else if stands && going {
                Label::On(border.after)
            } else if let Some(dwell) = border.dwell {
                Label::On(dwell)
            } else if stands {
                Label::Between
            } else if time < passed {
                Label::On(border.before)
            } else {
                Label::On(border.after)
            };
        }
    }
}

/// Standing at the first place of the plan before it begins, and at its last after it has ended, is on no toolpath.
fn ends(flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], noise: f64, labels: &mut [Label]) {
    let near = near(noise);
    let (Some(first), Some(last)) = (hits.iter().position(Option::is_some), hits.iter().rposition(Option::is_some)) else {
        return;
    };
    let at = |k: usize, s: f64| hits[k].is_some_and(|hit| (flat.s_at(&hit) - s).abs() <= near && hit.distance <= near);
    let begun = (first..=last).find(|k| !at(*k, 0.0)).unwrap_or(last);
    let departure = hits[begun].map_or(spots[begun].time, |hit| {
        spots[begun].time - pace(flat, spots, hits, begun) * flat.time_at(&hit)
    });
    for k in first..begun {
        if spots[k].time < departure {
            labels[k] = Label::Between;
        }
    }
    let ended = (first..=last).rfind(|k| !at(*k, flat.length())).unwrap_or(first);
    let whole = Hit {
        chord: flat.chords.len() as u32 - 1,
        t: 1.0,
        distance: 0.0,
    };
    let arrival = hits[ended].map_or(spots[ended].time, |hit| {
        spots[ended].time + pace(flat, spots, hits, ended.wrapping_sub(1)) * (flat.time_at(&whole) - flat.time_at(&hit))
    });
    for k in ended + 1..=last {
        if spots[k].time > arrival {
            labels[k] = Label::Between;
        }
    }
}

/// Along the path, samples this near to a border may be on either side of it.
fn near(noise: f64) -> f64 {
    // Curved paths bend between samples: that is not noise.
    4.0 * noise.min(0.01) + 0.002
}

/// A stop at a border that lasts longer is a stop of its own (a tool change, a spindle start), not the corner between two moves, s.
const STAND: f64 = 0.05;

/// Real over nominal time between sample `k` and the next, when both are on one toolpath; 1 when they tell nothing.
fn pace(flat: &Flat, spots: &[Spot], hits: &[Option<Hit>], k: usize) -> f64 {
    let (Some(Some(from)), Some(Some(to))) = (hits.get(k), hits.get(k.wrapping_add(1))) else {
        return 1.0;
    };
    if flat.chords[from.chord as usize].toolpath != flat.chords[to.chord as usize].toolpath {
        return 1.0;
    }
    let nominal = flat.time_at(to) - flat.time_at(from);
    let real = spots[k + 1].time - spots[k].time;
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

#[cfg(test)]
mod standing {
    use super::*;

    /// One letter a sample: the toolpath it is labelled with, `-` for between; upper case stands where the last one was, lower case moves on.
    #[track_caller]
    fn check(samples: &str, settled: &str) {
        let mut x = 0.0;
        let mut spots = Vec::new();
        let mut labels = Vec::new();
        for (k, c) in samples.chars().enumerate() {
            if c.is_ascii_lowercase() {
                x += 1.0;
            }
            spots.push(Spot {
                time: k as f64 * 0.01,
                place: [x, 0.0, 0.0],
            });
            labels.push(if c == '-' {
                Label::Between
            } else {
                Label::On((c.to_ascii_lowercase() as u8 - b'a') as usize)
            });
        }
        settle(&spots, 0.001, &mut labels);
        let told: String = labels
            .iter()
            .map(|l| l.toolpath().map_or('-', |t| char::from(b'a' + t as u8)))
            .collect();
        assert_eq!(told, settled);
    }

    #[test]
    fn going_to_and_fro_without_moving_is_standing() {
        check("aaABABA-ABBbb", "aaaaaaa-abbbb");
    }

    #[test]
    fn a_tool_change_between_two_toolpaths_stays_between() {
        check("aa----bb", "aa----bb");
    }

    #[test]
    fn really_going_back_is_kept() {
        check("aabbbaa", "aabbbaa");
    }
}

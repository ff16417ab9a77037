//! How far samples are from the plan's path: single ones, workingsteps, speeds, and a shift that explains them.

use super::Sample;
use crate::curve;
use crate::flat::Flat;
use crate::labels::Label;
use crate::planned::PlannedProgram;
use crate::report::{Settings, Shift};
use crate::shift::{Foot, fit};
use crate::vec3::{V3, distance, length, quantile, sub};
use plan::Path;
use plan::executed::{Deviation, PathKind};
use units::{Millimetres, Point, Setup};

/// Numbers over the distances of some samples; `None` for none.
pub(super) fn deviation(distances: &[f64]) -> Option<Deviation> {
    if distances.is_empty() {
        return None;
    }
    let mut sorted = distances.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    // Nearest rank: the smallest value that at least 95 % do not exceed.
    let rank = (sorted.len() * 95).div_ceil(100).max(1) - 1;
    let squares: f64 = sorted.iter().map(|d| d * d).sum();
    Some(Deviation {
        max: Millimetres(sorted[sorted.len() - 1]),
        p95: Millimetres(sorted[rank]),
        rms: Millimetres((squares / sorted.len() as f64).sqrt()),
        samples: sorted.len() as u64,
    })
}

/// Distance of a tip from the planned path of its toolpath. At an end of it the neighbours count too: in a blended corner the machine is
/// on neither.
pub(super) fn off_path(plan: &PlannedProgram, flat: &Flat, toolpath: usize, tip: V3) -> Option<Off> {
    let own = foot(plan, flat, toolpath, tip)?;
    let mut least = own.distance;
    if own.at_end {
        let has_length = |t: &usize| !flat.toolpaths[*t].is_empty();
        let neighbours = [
            (0..toolpath).rev().find(has_length),
            (toolpath + 1..plan.toolpaths.len()).find(has_length),
        ];
        for neighbour in neighbours.into_iter().flatten() {
            // The neighbour may be in another set-up: the machine's frame joins them.
            let there = if plan.toolpaths[neighbour].frame == plan.toolpaths[toolpath].frame {
                tip
            } else {
                let machine = plan.machine_from_setup(toolpath) * Point::from_xyz(tip);
                (plan.machine_from_setup(neighbour).inverse() * machine).xyz
            };
            if let Some(other) = foot(plan, flat, neighbour, there) {
                least = least.min(other.distance);
            }
        }
    }
    Some(Off {
        distance: least,
        segment: own.segment,
        u: own.u,
    })
}

/// How far a sample is from its path, and which move it is on.
#[derive(Clone, Copy)]
pub(super) struct Off {
    pub(super) distance: f64,
    /// `None` in a dwell.
    pub(super) segment: Option<u32>,
    /// Where on that move, 0 to 1.
    pub(super) u: f64,
}

pub(super) struct PathFoot {
    pub(super) distance: f64,
    pub(super) segment: Option<u32>,
    pub(super) u: f64,
    pub(super) place: V3,
    pub(super) direction: V3,
    /// The nearest place is the toolpath's first or last.
    pub(super) at_end: bool,
}

pub(super) fn foot(plan: &PlannedProgram, flat: &Flat, toolpath: usize, tip: V3) -> Option<PathFoot> {
    let range = flat.toolpaths[toolpath].clone();
    if range.is_empty() {
        // A dwell, or moves without a length.
        let place = plan.toolpaths[toolpath].place?.xyz;
        return Some(PathFoot {
            distance: distance(place, tip),
            segment: None,
            u: 0.0,
            place,
            direction: [0.0; 3],
            at_end: true,
        });
    }
    let hit = flat.nearest(tip, range.clone(), f64::MAX.sqrt(), None)?;
    let chord = &flat.chords[hit.chord as usize];
    let path = &plan.segments[chord.segment as usize].path;
    let width = chord.u[1] - chord.u[0];
    let (u, off) = curve::nearest(path, tip, flat.u_at(&hit), chord.u[0] - width, chord.u[1] + width);
    let first = hit.chord as usize == range.start && u <= chord.u[0] + 1e-9;
    let last = hit.chord as usize + 1 == range.end && u >= chord.u[1] - 1e-9;
    Some(PathFoot {
        distance: off,
        segment: Some(chord.segment),
        u,
        place: path.at(u).xyz,
        direction: curve::direction(path, u).unwrap_or_default(),
        at_end: first || last,
    })
}

/// One run of a workingstep: which samples, and which runs of toolpaths.
pub(super) struct Pass {
    pub(super) workingstep: usize,
    /// Runs of samples of one toolpath: toolpath and indices of samples.
    pub(super) runs: Vec<(usize, Vec<usize>)>,
}

/// Cuts samples into passes of workingsteps and runs of toolpaths.
pub(super) fn passes(plan: &PlannedProgram, samples: &[Sample]) -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    // The toolpath of the sample before, links between workingsteps included.
    let mut last: Option<usize> = None;
    for (k, sample) in samples.iter().enumerate() {
        let Label::On(toolpath) = sample.label else { continue };
        let before = last.replace(toolpath);
        let Some(workingstep) = plan.toolpaths[toolpath].workingstep else {
            continue;
        };
        let again = before.is_some_and(|before| toolpath < before);
        let same = passes.last().is_some_and(|p| p.workingstep == workingstep) && !again;
        if !same {
            passes.push(Pass {
                workingstep,
                runs: Vec::new(),
            });
        }
        let pass = passes.last_mut().expect("just made");
        match pass.runs.last_mut() {
            Some((running, indices)) if *running == toolpath && before == Some(toolpath) => indices.push(k),
            _ => pass.runs.push((toolpath, vec![k])),
        }
    }
    passes
}

/// Time that belongs to some samples: half of the way to each neighbour, nothing across a pause in the record.
pub(super) fn time_of(samples: &[Sample], indices: impl Iterator<Item = usize>, longest: f64) -> f64 {
    let half = |a: usize, b: usize| {
        let dt = samples[b].time - samples[a].time;
        if dt <= longest { dt / 2.0 } else { 0.0 }
    };
    indices
        .map(|k| (if k > 0 { half(k - 1, k) } else { 0.0 }) + (if k + 1 < samples.len() { half(k, k + 1) } else { 0.0 }))
        .sum()
}

/// Real over planned feed, and the range that the median lies in with about 95 % certainty.
#[derive(Clone, Copy)]
pub(super) struct FeedRatio {
    pub(super) median: f64,
    pub(super) lowest: f64,
    pub(super) highest: f64,
}

/// Real over planned feed: the median over pairs of samples on the same move, far enough apart that their noise does not matter. Near the
/// ends of a move the machine speeds up, slows down and stands; pairs there say nothing about the feed.
pub(super) fn feed_ratio(
    plan: &PlannedProgram,
    samples: &[Sample],
    offs: &[Option<Off>],
    pass: &Pass,
    settings: &Settings,
    acceleration: f64,
) -> Option<FeedRatio> {
    let mut ratios = Vec::new();
    for (toolpath, indices) in &pass.runs {
        let planned = &plan.toolpaths[*toolpath];
        if planned.kind != PathKind::Feed {
            continue;
        }
        let slowest = plan.segments[planned.segments.clone()]
            .iter()
            .map(|s| s.speed.0)
            .fold(f64::INFINITY, f64::min);
        let step = (slowest * settings.interval_s).max(1e-9);
        let apart = ((30.0 * settings.noise_mm / step).ceil() as usize).clamp(1, 100);
        for (k, &first) in indices.iter().enumerate() {
            let Some(&second) = indices.get(k + apart) else { break };
            let (Some(from), Some(to)) = (offs[first], offs[second]) else {
                continue;
            };
            let Some(segment) = from.segment.filter(|s| Some(*s) == to.segment && second == first + apart) else {
                continue;
            };
            let (a, b) = (&samples[first], &samples[second]);
            let move_ = &plan.segments[segment as usize];
            let (path, feed) = (&move_.path, move_.speed.0);
            let ramp = feed * feed / acceleration + 3.0 * settings.noise_mm;
            let steady = |tip: V3| distance(tip, path.start().xyz) > ramp && distance(tip, path.end().xyz) > ramp;
            let dt = b.time - a.time;
            // Down a hole and up again is one line: only what goes ahead on it is this move for certain.
            let slack = 3.0 * settings.noise_mm / path.length().max(1e-9);
            let no_turn = |w: &[usize]| matches!((offs[w[0]], offs[w[1]]), (Some(p), Some(q)) if q.u >= p.u - slack);
            let ahead = to.u > from.u && indices[k..=k + apart].windows(2).all(no_turn);
            if dt > 0.0 && ahead && steady(a.tip) && steady(b.tip) {
                ratios.push(way(path, from.u, to.u) / dt / feed);
            }
        }
    }
    if ratios.len() < 5 {
        return None;
    }
    let median = quantile(&mut ratios, 0.5);
    ratios.sort_unstable_by(f64::total_cmp);
    // Of n values, about sqrt(n)/2 more or fewer than half lie below the true median; twice that is rarely exceeded.
    let (n, spread) = (ratios.len(), (ratios.len() as f64).sqrt());
    let rank = |r: f64| r.clamp(0.0, (n - 1) as f64) as usize;
    Some(FeedRatio {
        median,
        lowest: ratios[rank((n as f64 / 2.0 - spread).floor())],
        highest: ratios[rank((n as f64 / 2.0 + spread).ceil())],
    })
}

/// Length of a path between two places of it: round a circle, not across.
fn way(path: &Path<Setup>, from: f64, to: f64) -> f64 {
    match path {
        Path::Line { .. } | Path::Arc(_) => (to - from).abs() * path.length(),
        Path::Spline(_) => {
            let places: Vec<V3> = (0..=16)
                .map(|k| path.at(from + (to - from) * f64::from(k) / 16.0).xyz)
                .collect();
            places.windows(2).map(|w| distance(w[0], w[1])).sum()
        }
    }
}

/// Looks for a shift that explains the deviation of a workingstep's feed samples.
pub(super) fn shift_of(
    plan: &PlannedProgram,
    flat: &Flat,
    samples: &[Sample],
    feed: &[usize],
    distances: &[Option<f64>],
) -> Option<Shift> {
    const MOST: usize = 3000;
    if feed.len() < 8 {
        return None;
    }
    let stride = feed.len().div_ceil(MOST);
    let chosen: Vec<usize> = feed
        .iter()
        .copied()
        .step_by(stride)
        .filter(|k| distances[*k].is_some())
        .collect();
    let before = deviation(&chosen.iter().filter_map(|k| distances[*k]).collect::<Vec<_>>())?;
    if before.p95.0 < 0.005 {
        return None;
    }
    let tips: Vec<V3> = chosen.iter().map(|k| samples[*k].tip).collect();
    let shift = fit(&tips, [0.0; 3], 12, &mut |k, place| {
        let toolpath = samples[chosen[k]].label.toolpath()?;
        let foot = foot(plan, flat, toolpath, place)?;
        // At an end of the path the nearest place says nothing: another sample may lie beyond it.
        (!foot.at_end).then_some(Foot {
            place: foot.place,
            direction: foot.direction,
        })
    });
    let after: Vec<f64> = chosen
        .iter()
        .zip(&tips)
        .filter_map(|(k, tip)| Some(off_path(plan, flat, samples[*k].label.toolpath()?, sub(*tip, shift))?.distance))
        .collect();
    let after = deviation(&after)?;
    (length(shift) > 0.004 && after.p95.0 < 0.5 * before.p95.0).then_some(Shift {
        vector_mm: shift,
        p95_before_mm: before.p95.0,
        p95_after_mm: after.p95.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::Arc;
    use units::{Radians, Vector};

    #[test]
    fn between_far_samples_on_an_arc_the_way_is_the_arc_and_not_the_chord() {
        let arc = Path::Arc(Arc {
            from: Point::new(10.0, 0.0, 0.0),
            centre: Point::ORIGIN,
            normal: Vector::Z,
            sweep: Radians(6.0),
            rise: 0.0,
        });
        assert!((way(&arc, 0.0, 0.25) - 15.0).abs() < 1e-9);
    }
}

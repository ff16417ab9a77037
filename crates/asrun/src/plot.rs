//! Thinning of lines and curves to what a page can show.

use crate::report::PlotLine;
use crate::vec3::{V3, distance, nearest_on_chord, sub};
use std::collections::BTreeMap;

/// Keeps a polyline within a tolerance that doubles until no more than `most` points are left over all lines.
pub(crate) fn thin(lines: Vec<PlotLine>, most: usize) -> Vec<PlotLine> {
    let count = |lines: &[PlotLine]| lines.iter().map(|l| l.points.len()).sum::<usize>();
    if count(&lines) <= most {
        return lines;
    }
    let size = extent(&lines);
    let mut tolerance = (size / 8000.0).max(1e-4);
    let mut thinned = lines;
    for _ in 0..24 {
        for line in &mut thinned {
            line.points = simplify(&line.points, tolerance);
        }
        if count(&thinned) <= most {
            break;
        }
        tolerance *= 2.0;
    }
    // Very many short lines: each keeps its ends only, and then every so many lines are left out.
    let lines = thinned.len();
    if count(&thinned) > most && lines > 1 {
        let stride = count(&thinned).div_ceil(most.max(1));
        thinned = thinned.into_iter().step_by(stride).collect();
    }
    thinned
}

fn extent(lines: &[PlotLine]) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in lines.iter().flat_map(|l| &l.points) {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    if low[0] > high[0] { 0.0 } else { distance(low, high) }
}

/// Points such that those left out lie within `tolerance` of the line between kept ones.
fn simplify(points: &[V3], tolerance: f64) -> Vec<V3> {
    // Looking back over no more than this many points keeps the work linear.
    const LOOK: usize = 100;
    let Some(first) = points.first() else { return Vec::new() };
    let mut kept = vec![*first];
    let mut from = 0;
    let mut at = 1;
    while at + 1 < points.len() {
        let next = points[at + 1];
        let along = sub(next, points[from]);
        let fits = at + 1 - from <= LOOK
            && points[from + 1..=at]
                .iter()
                .all(|p| nearest_on_chord(*p, points[from], along).1 <= tolerance * tolerance);
        if !fits {
            kept.push(points[at]);
            from = at;
        }
        at += 1;
    }
    if points.len() > 1 {
        kept.push(points[points.len() - 1]);
    }
    kept
}

/// Keeps the largest value of each stretch, in order: a peak is never thinned away.
pub(crate) fn peaks(values: Vec<[f64; 2]>, most: usize) -> Vec<[f64; 2]> {
    if values.len() <= most || most == 0 {
        return values;
    }
    let stretch = values.len().div_ceil(most);
    let mut kept: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
    for (k, value) in values.into_iter().enumerate() {
        let best = kept.entry(k / stretch).or_insert(value);
        if value[1] > best[1] {
            *best = value;
        }
    }
    kept.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_run_is_two_points_and_a_corner_is_kept() {
        let points: Vec<V3> = (0..5000)
            .map(|k| [f64::from(k), 0.0, 0.0])
            .chain((0..5000).map(|k| [4999.0, f64::from(k), 0.0]))
            .collect();
        let thinned = thin(vec![PlotLine { kind: "feed", points }], 500);
        assert!(thinned[0].points.len() <= 500);
        assert!(thinned[0].points.contains(&[4999.0, 0.0, 0.0]));
        assert_eq!(thinned[0].points.last(), Some(&[4999.0, 4999.0, 0.0]));
    }

    #[test]
    fn the_peak_survives() {
        let values: Vec<[f64; 2]> = (0..10_000)
            .map(|k| [f64::from(k), if k == 7777 { 9.0 } else { 1.0 }])
            .collect();
        let kept = peaks(values, 100);
        assert!(kept.len() <= 100);
        assert!(kept.contains(&[7777.0, 9.0]));
    }
}

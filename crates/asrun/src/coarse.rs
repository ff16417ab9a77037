//! The constant shift of a record against a plan when nobody knows it: tried from several guesses, refined, and the best kept.

use crate::align::Spot;
use crate::flat::Flat;
use crate::shift::{Foot, fit};
use crate::vec3::{V3, add, distance, length, quantile, scale, sub, toward};

/// Samples that the fit looks at.
const LOOKED_AT: usize = 600;

/// What has to be added to the record's positions, and how well they lie then: 80 % of the samples are nearer than this.
pub(crate) fn fit_shift(flat: &Flat, spots: &[Spot]) -> Option<(f64, V3)> {
    if flat.chords.is_empty() || spots.is_empty() {
        return None;
    }
    // Moving samples only: a machine that stands says one thing many times.
    let mut moving: Vec<V3> = vec![spots[0].place];
    for spot in spots {
        if moving.last().is_some_and(|last| distance(*last, spot.place) > 0.01) {
            moving.push(spot.place);
        }
    }
    let thinned = |most: usize| -> Vec<V3> { moving.iter().copied().step_by(moving.len().div_ceil(most)).collect() };
    let (few, many) = (thinned(FIRST_LOOK), thinned(LOOKED_AT));
    // A short look at every guess, a long one at the best.
    let mut tried: Vec<(f64, V3)> = guesses(flat, &moving)
        .into_iter()
        .map(|guess| refine(flat, &few, guess, 8))
        .collect();
    // The guesses are in order of how simple they are, and the sort keeps that for equals.
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried.truncate(3);
    let mut best: Option<(f64, V3)> = None;
    for (_, shift) in tried {
        let (score, shift) = refine(flat, &many, shift, 40);
        if best.is_none_or(|(least, _)| score < least * 0.8 - 1e-3) {
            best = Some((score, shift));
        }
    }
    best
}

/// Samples that a first guess is tried on.
const FIRST_LOOK: usize = 150;

/// Refines what has to be added to `samples`; gives how well they lie then, and the shift.
fn refine(flat: &Flat, samples: &[V3], guess: V3, rounds: usize) -> (f64, V3) {
    let radius = f64::MAX.sqrt();
    let mut last: Vec<Option<usize>> = vec![None; samples.len()];
    // `fit` gives the shift from plan to run; what is added to the run is its opposite.
    let shift = fit(samples, scale(guess, -1.0), rounds, &mut |k, place| {
        let hit = flat.nearest(place, 0..flat.chords.len(), radius, last[k])?;
        last[k] = Some(hit.chord as usize);
        let along = flat.chords[hit.chord as usize].along;
        Some(Foot {
            place: flat.place(&hit),
            direction: scale(along, 1.0 / length(along)),
        })
    });
    let mut off: Vec<f64> = samples
        .iter()
        .zip(&last)
        .map(|(p, last)| {
            flat.nearest(sub(*p, shift), 0..flat.chords.len(), radius, *last)
                .map_or(f64::INFINITY, |h| h.distance)
        })
        .collect();
    (quantile(&mut off, 0.8), scale(shift, -1.0))
}

/// First guesses: none; boxes laid on each other by their middles and by each corner; and places at equal shares of the way travelled.
fn guesses(flat: &Flat, moving: &[V3]) -> Vec<V3> {
    let plan: Vec<V3> = {
        let n = 2000.0;
        (0..=2000)
            .map(|k| {
                let s = flat.length() * f64::from(k) / n;
                let chord = &flat.chords[flat.chord_at(s)];
                add(chord.from, scale(chord.along, ((s - chord.s) / chord.length).clamp(0.0, 1.0)))
            })
            .collect()
    };
    let mut way = vec![0.0];
    for pair in moving.windows(2) {
        way.push(way[way.len() - 1] + distance(pair[0], pair[1]));
    }
    let total = way[way.len() - 1];
    let run: Vec<V3> = (0..=2000)
        .map(|k| {
            let s = total * f64::from(k) / 2000.0;
            let after = way.partition_point(|w| *w < s).clamp(1, moving.len().max(2) - 1);
            if moving.len() < 2 {
                return moving[0];
            }
            let (a, b) = (way[after - 1], way[after]);
            toward(moving[after - 1], moving[after], if b > a { (s - a) / (b - a) } else { 0.0 })
        })
        .collect();
    let axis = |points: &[V3], k: usize, share: f64| {
        let mut values: Vec<f64> = points.iter().map(|p| p[k]).collect();
        quantile(&mut values, share)
    };
    let by = |share: [f64; 3]| std::array::from_fn(|k| axis(&plan, k, share[k]) - axis(&run, k, share[k]));
    let mut all: Vec<V3> = vec![[0.0; 3]];
    all.push(std::array::from_fn(|k| {
        (axis(&plan, k, 0.0) + axis(&plan, k, 1.0) - axis(&run, k, 0.0) - axis(&run, k, 1.0)) / 2.0
    }));
    all.push(by([0.5; 3]));
    for corner in 0..8 {
        all.push(by(std::array::from_fn(|k| if corner >> k & 1 == 0 { 0.0 } else { 1.0 })));
    }
    all.push(std::array::from_fn(|k| {
        let mut off: Vec<f64> = plan.iter().zip(&run).map(|(p, r)| p[k] - r[k]).collect();
        quantile(&mut off, 0.5)
    }));
    all
}

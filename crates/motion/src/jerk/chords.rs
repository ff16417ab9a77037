//! Splines as dense chords: any spline, whatever its knots, weights and parameter do, becomes a curve with the derivatives that a limit of
//! jerk needs by the same means as programmed chords do.

use crate::smooth::{Corner, Piece};
use plan::Path;
use units::{Machine, Point};

/// Share of the tolerance that chords may be off; what is left is for their joints.
const SHARE: f64 = 0.04;

/// Largest turn from one chord to the next, rad.
const TURN: f64 = 0.12;

/// Halvings of a span between two knots.
const HALVINGS: u32 = 12;

/// The chords of a spline, and how far they are off it, mm.
pub(super) fn of(piece: &Piece, corner: Corner) -> (Vec<Piece>, f64) {
    let Path::Spline(spline) = &piece.path else {
        return (vec![piece.clone()], 0.0);
    };
    let tolerance = SHARE * corner.tolerance();
    let (low, high) = (spline.knots[spline.degree], spline.knots[spline.poles.len()]);
    let mut places = vec![(0.0, piece.path.at(0.0))];
    let knots = spline
        .knots
        .iter()
        .map(|k| (k - low) / (high - low))
        .filter(|u| *u > 1e-9 && *u < 1.0 - 1e-9);
    let mut off = 0.0f64;
    for end in knots.chain([1.0]) {
        let from = *places.last().expect("it begins with one");
        if end > from.0 {
            halve(
                &piece.path,
                from,
                (end, piece.path.at(end)),
                tolerance,
                HALVINGS,
                &mut places,
                &mut off,
            );
        }
    }
    let count = places.len() - 1;
    let within = match corner {
        Corner::Within(t) => Corner::Within((t - off).max(0.5 * t)),
        Corner::Stop => Corner::Stop,
    };
    let mut chords: Vec<Piece> = Vec::with_capacity(count);
    for pair in places.windows(2) {
        let ((u, mut from), (v, to)) = (pair[0], pair[1]);
        if let Some(last) = chords.last() {
            from = last.path.end();
        }
        let length = from.distance(to);
        if length <= 1e-9 {
            continue;
        }
        let feed_factors = if piece.feed_factors.is_empty() {
            vec![]
        } else {
            let at = |w: f64| piece.feed_at(w) / piece.feed;
            vec![(0.0, at(u)), (1.0, at(v))]
        };
        chords.push(Piece {
            path: Path::Line { from, to },
            length,
            feed: piece.feed,
            feed_factors,
            rapid: piece.rapid,
            tie: piece.tie,
            step: piece.step,
            corner: within,
        });
    }
    if let Some(last) = chords.last_mut() {
        last.corner = piece.corner;
    }
    (chords, off)
}

fn halve(
    path: &Path<Machine>,
    from: (f64, Point<Machine>),
    to: (f64, Point<Machine>),
    tolerance: f64,
    depth: u32,
    places: &mut Vec<(f64, Point<Machine>)>,
    off: &mut f64,
) {
    let looks = [0.25, 0.5, 0.75].map(|share| {
        let u = from.0 + (to.0 - from.0) * share;
        (u, path.at(u))
    });
    let chord = to.1 - from.1;
    let length = chord.length();
    let distance = |place: Point<Machine>| {
        let d = place - from.1;
        if length > 0.0 {
            let along = (d.dot(chord) / (length * length)).clamp(0.0, 1.0);
            (d - chord * along).length()
        } else {
            d.length()
        }
    };
    let far = looks.iter().map(|look| distance(look.1)).fold(0.0, f64::max);
    // The tangents need not exist at the ends; chords of the quarters do.
    let (out, into) = (looks[0].1 - from.1, to.1 - looks[2].1);
    let turn = libm::atan2(out.cross(into).length(), out.dot(into));
    if depth == 0 || length < 1e-6 || (far <= tolerance && turn <= TURN) {
        *off = off.max(far);
        places.push(to);
    } else {
        halve(path, from, looks[1], tolerance, depth - 1, places, off);
        halve(path, looks[1], to, tolerance, depth - 1, places, off);
    }
}

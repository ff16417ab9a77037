//! How far a place is from a path.

/// Pieces of a path by the half millimetre that they lie in.
pub struct PathIndex(std::collections::BTreeMap<[i64; 3], Vec<Piece>>);

/// From here to there, mm.
type Piece = ([f64; 3], [f64; 3]);

impl PathIndex {
    fn cell(p: [f64; 3]) -> [i64; 3] {
        p.map(|c| (c * 2.0).floor() as i64)
    }

    pub fn new(points: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut index = PathIndex(std::collections::BTreeMap::new());
        let mut last = None;
        for to in points {
            let from = last.replace(to).unwrap_or(to);
            if from == to && !index.0.is_empty() {
                continue;
            }
            // Pieces are at most half a millimetre long.
            for place in [from, to] {
                let here = index.0.entry(Self::cell(place)).or_default();
                if here.last() != Some(&(from, to)) {
                    here.push((from, to));
                }
            }
        }
        index
    }

    pub fn distance(&self, p: [f64; 3]) -> f64 {
        let [x, y, z] = Self::cell(p);
        let mut nearest = f64::MAX;
        for i in x - 1..=x + 1 {
            for j in y - 1..=y + 1 {
                for pieces in self.0.range([i, j, z - 1]..=[i, j, z + 1]) {
                    for (from, to) in pieces.1 {
                        nearest = nearest.min(squared_distance(p, *from, *to));
                    }
                }
            }
        }
        nearest.sqrt()
    }
}

fn squared_distance(p: [f64; 3], from: [f64; 3], to: [f64; 3]) -> f64 {
    let (mut along, mut length) = (0.0, 0.0);
    for k in 0..3 {
        along += (p[k] - from[k]) * (to[k] - from[k]);
        length += (to[k] - from[k]) * (to[k] - from[k]);
    }
    let t = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
    let mut sum = 0.0;
    for k in 0..3 {
        let off = p[k] - from[k] - (to[k] - from[k]) * t;
        sum += off * off;
    }
    sum
}

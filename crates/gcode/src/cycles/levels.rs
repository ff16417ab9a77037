//! How G71 and G72 cut: along Z or along X, level by level, and last along the contour with the allowances, which takes what is left of
//! the steps between the levels.
//!
//! Type I: neither axis ever turns back (alarm 064). Type II, when the first block of the contour names both axes: the depth may turn
//! back, and each pocket is cut to its ground before the next. A pocket is entered straight down at its near wall.

use crate::cycles::roughing::{Contour, ContourCycle, ContourRequest};
use crate::cycles::{Expansion, illegal};
use crate::fault::{Fault, Outcome};
use crate::interpreter::Interpreter;
use plan::{Arc, Path, Speed};
use std::f64::consts::TAU;
use units::{Radians, Setup, Vector};

/// Levels that a cycle may have.
const MOST_LEVELS: f64 = 20_000.0;
/// Turning back that is rounding of written numbers, mm.
const ROUNDING: f64 = 2e-3;

/// A place on a contour: piece and parameter.
type At = (usize, f64);

/// A part of a level to be cut, between two places of the contour; without a first one it begins at the cycle's start.
#[derive(Clone, Copy, Debug)]
struct Cut {
    level: u32,
    from: Option<At>,
    to: At,
}

/// G71, G72.
pub(crate) struct Levels {
    /// The contour with the allowances, from its first point on.
    paths: Vec<Path<Setup>>,
    /// The way to its first point, with the allowances; rapid or not.
    approach: ([f64; 3], bool),
    /// Axis of infeed and of the cuts, with the signs that make the infeed and the cuts go down.
    deep: (usize, f64),
    along: (usize, f64),
    home: [f64; 3],
    depth: f64,
    escape: f64,
    feed: Speed,
    pockets: bool,
    waiting: Vec<Cut>,
    begun: bool,
}

impl Levels {
    pub(crate) fn new(request: &ContourRequest, contour: &Contour, home: [f64; 3]) -> Outcome<Levels> {
        let (deep, along) = if request.cycle == ContourCycle::Turn { (0, 2) } else { (2, 0) };
        let mut all = contour.paths().into_iter();
        let Some((approach, rapid)) = all.next() else {
            return Err(illegal(request.at, "the contour has no moves", "check P and Q"));
        };
        let shift = Vector::new(request.allowance[0], 0.0, request.allowance[1]);
        let first = shifted(&approach, shift).end().xyz;
        let paths: Vec<_> = all.map(|(path, _)| shifted(&path, shift)).collect();
        let Some(last) = paths.last().map(|p| p.end().xyz) else {
            return Err(illegal(request.at, "the contour has only one move", "check P and Q"));
        };
        // Infeed goes from the start towards the contour; the cuts go from its first point to its last.
        let towards = first[deep] - home[deep];
        let whole = paths.iter().flat_map(|p| extent(p, deep)).map(|v| v - home[deep]);
        let farthest = whole.fold(towards, |a, b| if b.abs() > a.abs() { b } else { a });
        let way = last[along] - first[along];
        if farthest == 0.0 || way == 0.0 {
            return Err(illegal(
                request.at,
                "there is nothing to cut between the start point and the contour",
                "move to a start point outside the stock before the cycle",
            ));
        }
        let mut levels = Levels {
            paths,
            approach: (first, rapid),
            deep: (deep, -farthest.signum()),
            along: (along, -way.signum()),
            home,
            depth: request.depth,
            escape: request.escape,
            feed: request.feed.unwrap_or(Speed::Rapid),
            pockets: contour.both_axes,
            waiting: Vec::new(),
            begun: false,
        };
        if farthest.abs() / request.depth > MOST_LEVELS {
            return Err(illegal(
                request.at,
                format!(
                    "cuts of {} mm are too many for {:.3} mm of stock",
                    request.depth,
                    farthest.abs()
                ),
                "check the depth of cut",
            ));
        }
        levels.check_shape(request)?;
        levels.waiting = levels.cuts(1, None);
        levels.waiting.reverse();
        Ok(levels)
    }

    /// Alarm 064 where an axis turns back that may not.
    fn check_shape(&self, request: &ContourRequest) -> Outcome<()> {
        for (axis, sign, checked) in [(self.along.0, self.along.1, true), (self.deep.0, -self.deep.1, !self.pockets)] {
            if !checked {
                continue;
            }
            let mut lowest = f64::INFINITY;
            for path in &self.paths {
                let (start, end) = (path.start().xyz[axis], path.end().xyz[axis]);
                for value in std::iter::once(start).chain(extent(path, axis)).chain([end]) {
                    let value = value * sign;
                    if value > lowest + ROUNDING {
                        return Err(Fault::new(
                            request.at,
                            64,
                            "contour-turns-back",
                            format!(
                                "the contour of {} turns back along {}",
                                request.cycle.name(),
                                ["X", "Y", "Z"][axis]
                            ),
                            "name both axes in its first block (type II) for pockets; along the cuts it may never turn back",
                        ));
                    }
                    lowest = lowest.min(value);
                }
            }
        }
        Ok(())
    }

    /// Height of a level in the direction that infeed goes down.
    fn height(&self, level: u32) -> f64 {
        self.home[self.deep.0] * self.deep.1 - f64::from(level) * self.depth
    }

    fn place(&self, at: At) -> [f64; 3] {
        self.paths[at.0].at(at.1).xyz
    }

    /// The parts of a level where the contour lies below it, between two places of the contour, in the order of the cuts.
    fn cuts(&self, level: u32, within: Option<(Option<At>, At)>) -> Vec<Cut> {
        let (axis, sign) = self.deep;
        let height = self.height(level);
        let end_of_all = (self.paths.len() - 1, 1.0);
        let (from, to) = within.unwrap_or((None, end_of_all));
        let first = from.unwrap_or((0, 0.0));
        let below = |value: f64| value * sign < height - 1e-9;
        // Without a first place the cut comes from the start point: open when the contour begins below the level.
        let mut open: Option<Option<At>> = match from {
            None if below(self.place((0, 0.0))[axis]) => Some(None),
            _ => None,
        };
        let mut cuts = Vec::new();
        for index in first.0..=to.0 {
            let path = &self.paths[index];
            let low = if index == first.0 { first.1 } else { 0.0 };
            let high = if index == to.0 { to.1 } else { 1.0 };
            let mut breaks: Vec<f64> = crossings(path, axis, height * sign)
                .into_iter()
                .filter(|u| *u > low && *u < high)
                .collect();
            breaks.push(low);
            breaks.push(high);
            breaks.sort_by(f64::total_cmp);
            for pair in breaks.windows(2) {
                if pair[1] - pair[0] < 1e-12 {
                    continue;
                }
                let inside = below(path.at((pair[0] + pair[1]) / 2.0).xyz[axis]);
                match (inside, open) {
                    (true, None) => open = Some(Some((index, pair[0]))),
                    (false, Some(from)) => {
                        cuts.push(Cut {
                            level,
                            from,
                            to: (index, pair[0]),
                        });
                        open = None;
                    }
                    _ => {}
                }
            }
        }
        if let Some(from) = open {
            cuts.push(Cut { level, from, to });
        }
        if !self.pockets {
            cuts.truncate(1);
        }
        cuts
    }

    fn cut(&self, i: &mut Interpreter, cut: Cut) {
        let (deep, sign) = self.deep;
        let (along, way) = self.along;
        let at = |height: f64| height * sign;
        let (level, above) = (self.height(cut.level), self.height(cut.level - 1));
        // From wherever the last cut ended, up to where the level before is already clear.
        let clear = (above + self.escape).min(self.home[deep] * sign);
        if i.tip[deep] * sign < clear {
            i.go([(deep, at(clear)); 2], Speed::Rapid);
        }
        let end = self.place(cut.to)[along];
        let infeed = match cut.from {
            None => {
                i.go([(along, self.home[along]); 2], Speed::Rapid);
                if self.approach.1 { Speed::Rapid } else { self.feed }
            }
            Some(from) => {
                i.go([(along, self.place(from)[along]); 2], Speed::Rapid);
                self.feed
            }
        };
        let begin = i.tip[along];
        i.go([(deep, at(level)); 2], infeed);
        i.go([(along, end); 2], self.feed);
        // Off at 45 degrees, but not into the other wall of a narrow pocket.
        let off = self.escape.min((end - begin).abs() / 2.0);
        i.go([(deep, at(level + off)), (along, end + way * off)], self.feed);
    }
}

impl Expansion for Levels {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        if let Some(cut) = self.waiting.pop() {
            self.begun = true;
            self.cut(i, cut);
            let mut deeper = self.cuts(cut.level + 1, Some((cut.from, cut.to)));
            deeper.reverse();
            self.waiting.append(&mut deeper);
            return true;
        }
        let (deep, along) = (self.deep.0, self.along.0);
        if self.begun {
            i.go([(deep, self.home[deep]); 2], Speed::Rapid);
            i.go([(along, self.home[along]); 2], Speed::Rapid);
        }
        // The pass along the contour, with the allowances left.
        i.line(self.approach.0, if self.approach.1 { Speed::Rapid } else { self.feed });
        for path in &self.paths {
            let to = path.end().xyz;
            i.follow_path(path.clone(), self.feed, to);
        }
        i.go([(deep, self.home[deep]); 2], Speed::Rapid);
        i.go([(along, self.home[along]); 2], Speed::Rapid);
        false
    }
}

/// A path moved without turning it.
pub(crate) fn shifted(path: &Path<Setup>, by: Vector<Setup>) -> Path<Setup> {
    match path {
        Path::Line { from, to } => Path::Line {
            from: *from + by,
            to: *to + by,
        },
        Path::Arc(arc) => Path::Arc(Arc {
            from: arc.from + by,
            centre: arc.centre + by,
            ..*arc
        }),
        Path::Spline(spline) => {
            let mut spline = spline.clone();
            for pole in &mut spline.poles {
                *pole = *pole + by;
            }
            Path::Spline(spline)
        }
    }
}

/// Centre, cosine part and sine part of an arc's coordinate along an axis.
fn wave(arc: &Arc<Setup>, axis: usize) -> (f64, f64, f64) {
    let out = (arc.from - arc.centre).xyz;
    let n = arc.normal.xyz;
    let across = [
        n[1] * out[2] - n[2] * out[1],
        n[2] * out[0] - n[0] * out[2],
        n[0] * out[1] - n[1] * out[0],
    ];
    (arc.centre.xyz[axis], out[axis], across[axis])
}

/// Parameters at which a path is at `value` along an axis.
fn crossings(path: &Path<Setup>, axis: usize, value: f64) -> Vec<f64> {
    match path {
        Path::Line { from, to } => {
            let (a, b) = (from.xyz[axis], to.xyz[axis]);
            if a == b { Vec::new() } else { vec![(value - a) / (b - a)] }
        }
        Path::Arc(arc) => {
            let (centre, cosine, sine) = wave(arc, axis);
            let size = libm::sqrt(cosine * cosine + sine * sine);
            let share = (value - centre) / size;
            if size <= 0.0 || share.abs() > 1.0 {
                return Vec::new();
            }
            let (middle, half) = (libm::atan2(sine, cosine), libm::acos(share));
            on_the_way(arc.sweep, &[middle + half, middle - half])
        }
        Path::Spline(_) => Vec::new(), // G-code makes none
    }
}

/// The farthest values of a path along an axis, its start left out, in the order of the path.
fn extent(path: &Path<Setup>, axis: usize) -> Vec<f64> {
    let mut values = Vec::new();
    if let Path::Arc(arc) = path {
        let (_, cosine, sine) = wave(arc, axis);
        let top = libm::atan2(sine, cosine);
        let mut at = on_the_way(arc.sweep, &[top, top + TAU / 2.0]);
        at.sort_by(f64::total_cmp);
        values.extend(at.into_iter().map(|u| path.at(u).xyz[axis]));
    }
    values.push(path.end().xyz[axis]);
    values
}

/// Angles from the start of an arc that lie on it, as parameters.
fn on_the_way(sweep: Radians, angles: &[f64]) -> Vec<f64> {
    let mut found = Vec::new();
    for angle in angles {
        let mut turned = libm::fmod(*angle, TAU);
        if turned * sweep.0 < 0.0 {
            turned += TAU * sweep.0.signum();
        }
        while turned.abs() <= sweep.0.abs() {
            found.push(turned / sweep.0);
            turned += TAU * sweep.0.signum();
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use units::Point;

    fn arc(from: [f64; 3], centre: [f64; 3], degrees: f64) -> Path<Setup> {
        Path::Arc(Arc {
            from: Point::from_xyz(from),
            centre: Point::from_xyz(centre),
            normal: Vector::new(0.0, 1.0, 0.0),
            sweep: Radians(degrees.to_radians()),
            rise: 0.0,
        })
    }

    #[test]
    fn an_arc_is_met_where_its_coordinate_says() {
        // A quarter from X10 Z0 about the origin: counterclockwise about Y goes from X to -Z.
        for degrees in [90.0, -90.0] {
            let path = arc([10.0, 0.0, 0.0], [0.0; 3], degrees);
            let u = crossings(&path, 0, 6.0);
            assert_eq!(u.len(), 1, "{degrees}");
            let p = path.at(u[0]).xyz;
            assert!((p[0] - 6.0).abs() < 1e-9 && (p[2].abs() - 8.0).abs() < 1e-9, "{p:?}");
        }
        let half = arc([0.0, 0.0, 10.0], [0.0; 3], 180.0);
        assert_eq!(crossings(&half, 0, 6.0).len(), 2);
        assert!((extent(&half, 0)[0] - 10.0).abs() < 1e-12);
    }
}

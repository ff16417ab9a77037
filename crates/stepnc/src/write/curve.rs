//! Paths as bounded curves: lines as polylines, arcs as trimmed circles, helices over via points, splines as they are.

use super::sheet::Sheet;
use part21::text::real;
use plan::{Arc, Path, Spline};
use std::f64::consts::{PI, TAU};
use units::{Point, Radians, Setup};

/// Chords of what no curve of the standard can say stay this close to it, mm.
const CHORD: f64 = 0.0005;

/// Writes the curve of a path of at least one piece; the answer is the curve.
pub(super) fn curve(sheet: &mut Sheet, pieces: &[Path<Setup>]) -> u64 {
    let mut parts: Vec<u64> = Vec::new();
    let mut run = Run::default();
    for piece in pieces {
        match piece {
            Path::Line { from, to } => {
                run.begin(sheet, *from);
                run.to(sheet, *to);
            }
            Path::Arc(arc) if is_flat(arc) => {
                parts.extend(run.take(sheet));
                parts.extend(circles(sheet, arc));
            }
            Path::Arc(arc) if is_upright(arc) => {
                run.begin(sheet, arc.from);
                helix(sheet, &mut run, arc);
            }
            Path::Arc(_) => {
                run.begin(sheet, piece.start());
                piece.flatten(CHORD, 100_000, |u, place| {
                    if u > 0.0 {
                        run.to(sheet, place);
                    }
                });
            }
            Path::Spline(spline) => {
                parts.extend(run.take(sheet));
                parts.push(b_spline(sheet, spline));
            }
        }
    }
    parts.extend(run.take(sheet));
    if let [only] = parts[..] {
        return only;
    }
    let last = parts.len() - 1;
    let segments: Vec<String> = parts
        .iter()
        .enumerate()
        .map(|(n, part)| {
            let transition = if n == last { "DISCONTINUOUS" } else { "CONTINUOUS" };
            format!(
                "#{}",
                sheet.add(format!("COMPOSITE_CURVE_SEGMENT(.{transition}.,.T.,#{part})"))
            )
        })
        .collect();
    sheet.add(format!("COMPOSITE_CURVE('',({}),.F.)", segments.join(",")))
}

/// A polyline that is growing.
#[derive(Default)]
struct Run {
    points: Vec<u64>,
    end: Option<Point<Setup>>,
}

impl Run {
    fn begin(&mut self, sheet: &mut Sheet, from: Point<Setup>) {
        if self.points.is_empty() {
            self.points.push(sheet.point("CARTESIAN_POINT", from));
            self.end = Some(from);
        }
    }

    fn to(&mut self, sheet: &mut Sheet, place: Point<Setup>) {
        self.points.push(sheet.point("CARTESIAN_POINT", place));
        self.end = Some(place);
    }

    fn take(&mut self, sheet: &mut Sheet) -> Option<u64> {
        if self.points.len() < 2 {
            self.points.clear();
            return None;
        }
        let list: Vec<String> = self.points.drain(..).map(|id| format!("#{id}")).collect();
        Some(sheet.add(format!("POLYLINE('',({}))", list.join(","))))
    }
}

fn is_flat(arc: &Arc<Setup>) -> bool {
    arc.rise.abs() <= 1e-9
}

/// The standard's helix has no axis of its own: it is read as standing on the XY plane.
fn is_upright(arc: &Arc<Setup>) -> bool {
    arc.normal.xyz[2].abs() > 1.0 - 1e-12
}

/// Trimmed circles: one, or as many as there are turns.
fn circles(sheet: &mut Sheet, arc: &Arc<Setup>) -> Vec<u64> {
    let sign = if arc.sweep.0 < 0.0 { -1.0 } else { 1.0 };
    let sense = if sign < 0.0 { ".F." } else { ".T." };
    let axis = arc.normal.xyz;
    let placement = sheet.placement("", arc.centre.xyz, axis, None);
    let radius = sheet.number(arc.radius());
    let circle = sheet.add(format!("CIRCLE('',#{placement},{radius})"));
    let mut parts = Vec::new();
    for (from, to) in turns(arc, TAU) {
        let first = sheet.point("CARTESIAN_POINT", from);
        // Equal points are a full circle: they must be equal to the last digit.
        let second = if from.distance(to) <= 1e-9 {
            first
        } else {
            sheet.point("CARTESIAN_POINT", to)
        };
        parts.push(sheet.add(format!(
            "TRIMMED_CURVE('',#{circle},(#{first}),(#{second}),{sense},.CARTESIAN.)"
        )));
    }
    parts
}

/// A helix over via points: one between start and end of less than a turn, two in a whole one.
fn helix(sheet: &mut Sheet, run: &mut Run, arc: &Arc<Setup>) {
    let whole = arc.sweep.0.abs();
    let count = pieces_of(whole, TAU);
    for n in 0..count {
        let (from, to) = (n as f64 / count as f64, (n + 1) as f64 / count as f64);
        let at = |share: f64| Path::Arc(*arc).at(from + (to - from) * share);
        let turn = whole / count as f64;
        let via: &[f64] = if turn > TAU - 1e-9 { &[1.0 / 3.0, 2.0 / 3.0] } else { &[0.5] };
        for share in via {
            let point = sheet.point("VIA_HELIX_POINT", at(*share));
            run.points.push(point);
        }
        run.to(sheet, at(1.0));
    }
}

/// Start and end of the parts of an arc that are at most `most` long.
fn turns(arc: &Arc<Setup>, most: f64) -> Vec<(Point<Setup>, Point<Setup>)> {
    let path = |sweep: f64| {
        Path::Arc(Arc {
            sweep: Radians(sweep),
            ..*arc
        })
    };
    let (whole, sign) = (arc.sweep.0.abs(), arc.sweep.0.signum());
    if whole <= most + 1e-9 {
        // Nearly a whole turn, and not one: the end is where it is.
        let end = if whole > TAU - 1e-9 { arc.from } else { Path::Arc(*arc).end() };
        return vec![(arc.from, end)];
    }
    let mut parts = Vec::new();
    let full = libm::floor((whole + 1e-9) / TAU) as usize;
    parts.extend(std::iter::repeat_n((arc.from, arc.from), full));
    let rest = whole - full as f64 * TAU;
    if rest > 1e-9 {
        parts.push((arc.from, path(sign * rest).end()));
    }
    parts
}

fn pieces_of(whole: f64, most: f64) -> usize {
    (libm::ceil((whole - 1e-9) / most) as usize).max(1)
}

fn b_spline(sheet: &mut Sheet, spline: &Spline<Setup>) -> u64 {
    let poles: Vec<String> = spline
        .poles
        .iter()
        .map(|pole| format!("#{}", sheet.point("CARTESIAN_POINT", *pole)))
        .collect();
    let poles = poles.join(",");
    let mut knots: Vec<(f64, usize)> = Vec::new();
    for &knot in &spline.knots {
        match knots.last_mut() {
            Some((last, count)) if *last == knot => *count += 1,
            _ => knots.push((knot, 1)),
        }
    }
    let multiplicities: Vec<String> = knots.iter().map(|(_, count)| count.to_string()).collect();
    let values: Vec<String> = knots.iter().map(|(knot, _)| real(*knot)).collect();
    let (degree, multiplicities, values) = (spline.degree, multiplicities.join(","), values.join(","));
    if spline.weights.is_empty() {
        return sheet.add(format!(
            "B_SPLINE_CURVE_WITH_KNOTS('',{degree},({poles}),.UNSPECIFIED.,.F.,.F.,({multiplicities}),({values}),.UNSPECIFIED.)"
        ));
    }
    let weights: Vec<String> = spline.weights.iter().copied().map(real).collect();
    sheet.add(format!(
        "(BOUNDED_CURVE() B_SPLINE_CURVE({degree},({poles}),.UNSPECIFIED.,.F.,.F.) \
         B_SPLINE_CURVE_WITH_KNOTS(({multiplicities}),({values}),.UNSPECIFIED.) CURVE() GEOMETRIC_REPRESENTATION_ITEM() \
         RATIONAL_B_SPLINE_CURVE(({})) REPRESENTATION_ITEM(''))",
        weights.join(",")
    ))
}

/// True when chords stand for a piece, because the standard has no curve of its kind.
pub(super) fn is_flattened(piece: &Path<Setup>) -> bool {
    matches!(piece, Path::Arc(arc) if !is_flat(arc) && !is_upright(arc) && arc.sweep.0.abs() > PI * 1e-12)
}

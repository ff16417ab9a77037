//! From observations to places over time.
//!
//! A `PathPosition` has all three coordinates in one observation. Separate `Position` observations of linear axes X, Y and Z are put
//! together: a place each time one of them is told, with the other two as they were last told (an agent tells changes only). Data
//! items are never mixed: `ACTUAL` is taken before `COMMANDED`, and among several items of the same kind (an agent may publish one in
//! the work frame and one in the machine frame) the one with most values, unless the caller names one.

use crate::candidate::{Candidate, Named, axis_of, candidate_of};
use crate::streams::{Category, Observation, Streams, Value};
use plan::{Diagnostic, Diagnostics};
use std::collections::BTreeMap;
use units::{MM_PER_INCH, Timestamp};

/// Places over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// In order.
    pub points: Vec<TrackPoint>,
    /// Where something is missing between them.
    pub gaps: Vec<Gap>,
    /// The frame that the recording states; `None` when it does not say.
    pub frame: Option<StatedFrame>,
    /// The unit that its numbers were written in; points are millimetres always.
    pub unit: LengthUnit,
    /// True when the recording or the caller said the unit; false when millimetres were assumed.
    pub unit_stated: bool,
    /// False when the recording has only durations: its times count from 1970-01-01T00:00:00Z.
    pub start_stated: bool,
    /// Where it came from: the device and data item, or what the text form's first line says.
    pub source: String,
}

/// One place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// When.
    pub at: Timestamp,
    /// X, Y, Z in millimetres, in the recording's frame.
    pub position: [f64; 3],
    /// The agent's number of it. Rises along a track, except where the agent was started anew.
    pub sequence: u64,
}

/// A stretch without places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// It lies between this point of the track and the one before; 0 is before the first, `points.len()` after the last.
    pub before: usize,
    /// Last thing known before it.
    pub from: Timestamp,
    /// First thing known after it.
    pub to: Timestamp,
    /// Why.
    pub cause: GapCause,
}

/// Why places are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GapCause {
    /// The agent said UNAVAILABLE.
    Unavailable,
    /// Nothing was told for much longer than between other rows: the machine stood still, or the connection was gone.
    Silent,
    /// The recorder could not have it: it says so.
    Lost,
}

/// Which frame a recording says its numbers are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatedFrame {
    /// Axis positions from home.
    Machine,
    /// Tool-tip positions in the work offset in force.
    Setup,
}

/// The unit of a recording's numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LengthUnit {
    /// MTConnect's unit for positions.
    #[default]
    Millimetre,
    /// 25.4 mm.
    Inch,
}

impl LengthUnit {
    /// Millimetres in one of it.
    pub fn in_mm(self) -> f64 {
        match self {
            LengthUnit::Millimetre => 1.0,
            LengthUnit::Inch => MM_PER_INCH,
        }
    }
}

/// What a row of any form says: a place, or that none is known.
pub(crate) struct Row {
    pub(crate) at: Timestamp,
    pub(crate) sequence: u64,
    pub(crate) instance: u32,
    /// In the recording's unit.
    pub(crate) position: Option<[f64; 3]>,
    /// The recording says that something is missing before it.
    pub(crate) lost: bool,
}

/// Puts rows in order and makes a track of them.
pub(crate) fn track_of(mut rows: Vec<Row>, unit: Option<LengthUnit>, file: &str, diagnostics: &mut Diagnostics) -> Track {
    let scale = unit.unwrap_or_default().in_mm();
    let before = rows.len();
    // 1e308 inches are no number of millimetres.
    rows.retain(|row| row.position.is_none_or(|p| p.iter().all(|c| (c * scale).is_finite())));
    if rows.len() < before {
        let message = format!(
            "{} rows are too far away to be a position; they were left out",
            before - rows.len()
        );
        diagnostics.add(Diagnostic::warning("bad-position", message).in_file(file));
    }
    let key = |row: &Row| (row.instance, row.sequence);
    let numbered = rows.iter().all(|row| row.sequence > 0);
    let disorder = if numbered {
        rows.windows(2).filter(|w| key(&w[1]) < key(&w[0])).count()
    } else {
        0
    };
    if disorder > 0 {
        diagnostics.add(
            Diagnostic::remark(
                "unsorted",
                format!("{disorder} rows stand before rows with smaller sequence numbers; they were sorted"),
            )
            .in_file(file),
        );
        rows.sort_by_key(key);
    }
    if numbered {
        let before = rows.len();
        let mut contradictions = 0;
        rows.dedup_by(|later, kept| {
            let same = key(later) == key(kept);
            contradictions += usize::from(same && (later.at != kept.at || later.position != kept.position));
            same
        });
        let doubles = before - rows.len();
        if contradictions > 0 {
            let message =
                format!("{contradictions} sequence numbers come twice with different contents; the first of each was kept");
            diagnostics.add(Diagnostic::warning("contradicting-sequence", message).in_file(file));
        } else if doubles > 0 {
            let message = format!("{doubles} rows come twice with the same sequence number; one of each was kept");
            diagnostics.add(Diagnostic::remark("duplicate-sequence", message).in_file(file));
        }
    }
    let backwards = rows.windows(2).filter(|w| w[1].at < w[0].at).count();
    if backwards > 0 {
        let message = format!("time goes backwards {backwards} times along the sequence numbers");
        diagnostics.add(
            Diagnostic::warning("time-backwards", message)
                .in_file(file)
                .remedy("the clock of the machine or of the agent was set; look at the times around there"),
        );
    }
    let mut intervals: Vec<i64> = rows
        .windows(2)
        .map(|w| w[1].at.0.saturating_sub(w[0].at.0))
        .filter(|dt| *dt > 0)
        .collect();
    intervals.sort_unstable();
    let usual = intervals.get(intervals.len() / 2).copied().unwrap_or(i64::MAX);
    let mut track = Track {
        unit: unit.unwrap_or_default(),
        unit_stated: unit.is_some(),
        start_stated: true,
        ..Track::default()
    };
    let mut last: Option<Timestamp> = None;
    let mut unavailable_since: Option<Timestamp> = None;
    for row in &rows {
        let silent = last.is_some_and(|last| row.at.0.saturating_sub(last.0) > usual.saturating_mul(SILENCE));
        match row.position {
            None => {
                unavailable_since.get_or_insert(last.unwrap_or(row.at));
            }
            Some(position) => {
                let before = track.points.len();
                if let Some(from) = unavailable_since.take() {
                    track.gaps.push(Gap {
                        before,
                        from,
                        to: row.at,
                        cause: GapCause::Unavailable,
                    });
                } else if silent || row.lost {
                    let from = last.unwrap_or(row.at);
                    track.gaps.push(Gap {
                        before,
                        from,
                        to: row.at,
                        cause: if row.lost { GapCause::Lost } else { GapCause::Silent },
                    });
                }
                track.points.push(TrackPoint {
                    at: row.at,
                    position: position.map(|c| c * scale),
                    sequence: row.sequence,
                });
            }
        }
        last = Some(row.at);
    }
    if let (Some(from), Some(to)) = (unavailable_since, last) {
        track.gaps.push(Gap {
            before: track.points.len(),
            from,
            to,
            cause: GapCause::Unavailable,
        });
    }
    if track.points.is_empty() {
        diagnostics.add(
            Diagnostic::error("no-positions", "the recording holds no position")
                .in_file(file)
                .remedy("record the data item PATH_POSITION, or the POSITION of the axes X, Y and Z"),
        );
    }
    track
}

/// A row is called late when it comes after this many usual intervals.
const SILENCE: i64 = 20;

/// Three numbers separated by blanks (or commas).
pub(crate) fn three_numbers(text: &str) -> Option<[f64; 3]> {
    let mut numbers = text
        .split(|c: char| c.is_whitespace() || c == ',')
        .filter(|word| !word.is_empty());
    let mut next = || numbers.next().and_then(number);
    let place = [next()?, next()?, next()?];
    numbers.next().is_none().then_some(place)
}

/// A finite decimal number.
pub(crate) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

/// The positions of a streams document.
///
/// `item` picks a data item by id or name; `device` a device by name or uuid.
pub(crate) fn of_streams(
    streams: &Streams,
    item: Option<&str>,
    device: Option<&str>,
    unit: Option<LengthUnit>,
    file: &str,
    diagnostics: &mut Diagnostics,
) -> Track {
    let wanted_device = |o: &Observation| {
        let source = &streams.sources[o.source];
        device.is_none_or(|wanted| source.device == wanted || source.device_uuid == wanted)
    };
    let positions: Vec<&Observation> = streams
        .observations
        .iter()
        .filter(|o| o.category == Category::Sample && (o.kind == "PathPosition" || o.kind == "Position") && wanted_device(o))
        .collect();
    // Candidates: one a PathPosition item, and one a (device, sub-type) with all three axes.
    let mut candidates: BTreeMap<Candidate, usize> = BTreeMap::new();
    for o in &positions {
        if let Some(candidate) = candidate_of(&named(o, streams)) {
            *candidates.entry(candidate).or_default() += 1;
        }
    }
    let matches_item = |c: &Candidate| {
        item.is_none_or(|wanted| {
            positions
                .iter()
                .any(|o| candidate_of(&named(o, streams)).as_ref() == Some(c) && (o.item == wanted || o.name == wanted))
        })
    };
    let best = candidates
        .iter()
        .filter(|(c, _)| matches_item(c))
        .max_by_key(|(c, count)| (c.rank(), **count, std::cmp::Reverse(*c)))
        .map(|(c, _)| c.clone());
    let Some(best) = best else {
        if let Some(wanted) = item {
            let known: Vec<&str> = candidates.keys().map(|c| c.item.as_str()).collect();
            let message = format!(
                "no position comes from the data item \"{wanted}\"; there are: {}",
                known.join(", ")
            );
            diagnostics.add(Diagnostic::error("no-such-item", message).in_file(file));
        } else if let Some(wanted) = device {
            let known: Vec<&str> = streams.sources.iter().map(|s| s.device.as_str()).collect();
            let mut known = known;
            known.dedup();
            let message = format!(
                "no position comes from the device \"{wanted}\"; there are: {}",
                known.join(", ")
            );
            diagnostics.add(Diagnostic::error("no-such-device", message).in_file(file));
        }
        return track_of(Vec::new(), unit, file, diagnostics);
    };
    if candidates.len() > 1 && item.is_none() {
        let others: Vec<String> = candidates.keys().filter(|c| **c != best).map(Candidate::to_string).collect();
        let message = format!("positions are taken from {best}; there are also: {}", others.join(", "));
        diagnostics.add(
            Diagnostic::remark("several-positions", message)
                .in_file(file)
                .remedy("name the data item to take another"),
        );
    }
    let mut chosen: Vec<&Observation> = positions
        .into_iter()
        .filter(|o| candidate_of(&named(o, streams)).as_ref() == Some(&best))
        .collect();
    let rows = if best.axes {
        // Axes are put together in the agent's order, so the observations are sorted first.
        if chosen.iter().all(|o| o.sequence > 0) {
            let disorder = chosen
                .windows(2)
                .any(|w| (w[1].instance, w[1].sequence) < (w[0].instance, w[0].sequence));
            if disorder && chosen.windows(2).any(|w| w[1].at < w[0].at) {
                diagnostics.add(
                    Diagnostic::remark(
                        "unsorted",
                        "axis positions are not in the order of their sequence numbers; they were sorted",
                    )
                    .in_file(file),
                );
            }
            chosen.sort_by_key(|o| (o.instance, o.sequence));
        }
        axis_rows(&chosen, streams, file, diagnostics)
    } else {
        chosen.iter().filter_map(|o| path_row(o, file, diagnostics)).collect()
    };
    // Standard: positions of a document are millimetres, the agent has converted them.
    let mut track = track_of(rows, unit.or(Some(LengthUnit::Millimetre)), file, diagnostics);
    track.source = best.to_string();
    track
}

fn named<'a>(o: &'a Observation, streams: &'a Streams) -> Named<'a> {
    Named {
        kind: &o.kind,
        sub_type: &o.sub_type,
        id: &o.item,
        name: &o.name,
        source: &streams.sources[o.source],
    }
}

fn path_row(o: &Observation, file: &str, diagnostics: &mut Diagnostics) -> Option<Row> {
    let position = match &o.value {
        Value::Unavailable => None,
        Value::Text(text) => match three_numbers(text) {
            Some(position) => Some(position),
            None => {
                bad_position(o, text, "three numbers", file, diagnostics);
                return None;
            }
        },
    };
    Some(Row {
        at: o.at,
        sequence: o.sequence,
        instance: o.instance,
        position,
        lost: false,
    })
}

fn axis_rows(chosen: &[&Observation], streams: &Streams, file: &str, diagnostics: &mut Diagnostics) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    let mut axes: [Option<f64>; 3] = [None; 3];
    let mut known = false;
    for o in chosen {
        let Some(axis) = axis_of(&named(o, streams)) else { continue };
        match &o.value {
            Value::Unavailable => axes[axis] = None,
            Value::Text(text) => match number(text) {
                Some(value) => axes[axis] = Some(value),
                None => {
                    bad_position(o, text, "a number", file, diagnostics);
                    continue;
                }
            },
        }
        let position = match axes {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            // Before all three were told once, nothing is missing yet.
            _ if !known => continue,
            _ => None,
        };
        known = true;
        let row = Row {
            at: o.at,
            sequence: o.sequence,
            instance: o.instance,
            position,
            lost: false,
        };
        match rows.last_mut() {
            // The axes of one moment are one place.
            Some(last) if last.at == row.at && last.instance == row.instance => *last = row,
            _ => rows.push(row),
        }
    }
    if rows.is_empty() && !chosen.is_empty() {
        let told: Vec<&str> = (0..3).filter(|k| axes[*k].is_some()).map(|k| ["X", "Y", "Z"][k]).collect();
        let message = format!(
            "a place needs the positions of X, Y and Z; the recording has: {}",
            told.join(", ")
        );
        diagnostics.add(Diagnostic::error("missing-axis", message).in_file(file));
    }
    rows
}

fn bad_position(o: &Observation, text: &str, expected: &str, file: &str, diagnostics: &mut Diagnostics) {
    let shown: String = text.chars().take(40).collect();
    let message = format!(
        "<{}> is \"{shown}\" where {expected} or UNAVAILABLE was expected; it was left out",
        o.kind
    );
    diagnostics.add(
        Diagnostic::warning("bad-position", message)
            .in_file(file)
            .at_line(o.place.0, o.place.1),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::read_streams;

    fn document(components: &str) -> String {
        format!(
            "<MTConnectStreams><Header instanceId=\"1\"/><Streams><DeviceStream name=\"d\" uuid=\"u\">{components}</DeviceStream></Streams></MTConnectStreams>"
        )
    }

    fn path(rows: &[(&str, u64, &str)]) -> String {
        let rows: String = rows
            .iter()
            .map(|(second, sequence, value)| {
                format!("<PathPosition dataItemId=\"p\" sequence=\"{sequence}\" timestamp=\"2020-01-01T00:00:{second}Z\">{value}</PathPosition>")
            })
            .collect();
        document(&format!(
            "<ComponentStream component=\"Path\" componentId=\"c\"><Samples>{rows}</Samples></ComponentStream>"
        ))
    }

    fn read(xml: &str) -> (Track, Diagnostics) {
        let streams = read_streams(xml.as_bytes(), "a.xml");
        let mut diagnostics = streams.diagnostics.clone();
        let track = of_streams(&streams, None, None, None, "a.xml", &mut diagnostics);
        (track, diagnostics)
    }

    fn codes(diagnostics: &Diagnostics) -> Vec<&str> {
        diagnostics.as_slice().iter().map(|d| d.code).collect()
    }

    #[test]
    fn rows_out_of_order_are_sorted_and_doubles_are_dropped_with_a_remark() {
        let (track, diagnostics) = read(&path(&[
            ("02", 3, "3 0 0"),
            ("00", 1, "1 0 0"),
            ("01", 2, "2 0 0"),
            ("01", 2, "2 0 0"),
        ]));
        let xs: Vec<f64> = track.points.iter().map(|p| p.position[0]).collect();
        assert_eq!(xs, [1.0, 2.0, 3.0]);
        assert_eq!(codes(&diagnostics), ["unsorted", "duplicate-sequence"]);
    }

    #[test]
    fn a_sequence_number_with_two_contents_is_a_warning() {
        let (track, diagnostics) = read(&path(&[("00", 1, "1 0 0"), ("00", 1, "9 0 0")]));
        assert_eq!(track.points.len(), 1);
        assert_eq!(track.points[0].position[0], 1.0);
        assert_eq!(codes(&diagnostics), ["contradicting-sequence"]);
    }

    #[test]
    fn unavailable_is_a_gap_between_its_neighbours() {
        let (track, _) = read(&path(&[
            ("00", 1, "1 0 0"),
            ("01", 2, "UNAVAILABLE"),
            ("04", 3, "2 0 0"),
            ("05", 4, "UNAVAILABLE"),
        ]));
        assert_eq!(track.points.len(), 2);
        let gaps: Vec<(usize, f64, GapCause)> = track.gaps.iter().map(|g| (g.before, g.to.since(g.from).0, g.cause)).collect();
        assert_eq!(gaps, [(1, 4.0, GapCause::Unavailable), (2, 1.0, GapCause::Unavailable)]);
    }

    #[test]
    fn two_numbers_are_no_place() {
        let (track, diagnostics) = read(&path(&[("00", 1, "1 0"), ("01", 2, "1 2 3"), ("02", 3, "1 2 nan")]));
        assert_eq!(track.points.len(), 1);
        assert_eq!(codes(&diagnostics), ["bad-position"]);
        assert_eq!(diagnostics.as_slice()[0].count, 2);
    }

    fn axis(name: &str, sub_type: &str, item: &str, rows: &[(&str, u64, &str)]) -> String {
        let rows: String = rows
            .iter()
            .map(|(second, sequence, value)| {
                format!(
                    "<Position dataItemId=\"{item}\" subType=\"{sub_type}\" name=\"{item}\" sequence=\"{sequence}\" timestamp=\"2020-01-01T00:00:{second}Z\">{value}</Position>"
                )
            })
            .collect();
        format!(
            "<ComponentStream component=\"Linear\" name=\"{name}\" componentId=\"{name}\"><Samples>{rows}</Samples></ComponentStream>"
        )
    }

    #[test]
    fn separate_axes_are_put_together_and_hold_their_last_value() {
        let (track, _) = read(&document(
            &[
                axis("X", "ACTUAL", "Xpos", &[("00", 1, "1"), ("01", 4, "2")]),
                axis("Y", "ACTUAL", "Ypos", &[("00", 2, "5")]),
                axis("Z", "ACTUAL", "Zpos", &[("00", 3, "7"), ("02", 5, "8")]),
            ]
            .concat(),
        ));
        let places: Vec<[f64; 3]> = track.points.iter().map(|p| p.position).collect();
        assert_eq!(places, [[1.0, 5.0, 7.0], [2.0, 5.0, 7.0], [2.0, 5.0, 8.0]]);
    }

    #[test]
    fn actual_and_commanded_and_two_frames_are_never_mixed() {
        let both = |sub: &str, tail: &str, shift: f64, s: u64| {
            ["X", "Y", "Z"]
                .iter()
                .enumerate()
                .map(|(k, a)| {
                    axis(
                        a,
                        sub,
                        &format!("{a}{tail}"),
                        &[("00", s + k as u64, &format!("{}", shift + k as f64))],
                    )
                })
                .collect::<String>()
        };
        let (track, diagnostics) = read(&document(
            &[
                both("COMMANDED", "cmd", 100.0, 1),
                both("ACTUAL", "work", 0.0, 10),
                both("ACTUAL", "mach", 500.0, 20),
            ]
            .concat(),
        ));
        assert_eq!(
            track.points.iter().map(|p| p.position).collect::<Vec<_>>(),
            [[500.0, 501.0, 502.0]]
        );
        assert_eq!(codes(&diagnostics), ["several-positions"]);
        assert!(diagnostics.as_slice()[0].message.contains("*work"), "{:?}", diagnostics);
    }

    #[test]
    fn a_missing_axis_is_said() {
        let (track, diagnostics) = read(&document(&axis("X", "ACTUAL", "Xpos", &[("00", 1, "1")])));
        assert!(track.points.is_empty());
        assert_eq!(codes(&diagnostics), ["missing-axis", "no-positions"]);
    }
}

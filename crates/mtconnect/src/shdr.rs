//! SHDR logs: what an adapter sends to its agent, one line a moment: `timestamp|key|value|key|value...`.
//!
//! SHDR does not say which keys are positions, nor their unit: a key whose values are three numbers is a path position; keys that
//! differ only in the letter X, Y or Z and speak of a position are axes. Units are as the adapter sends them, and without the device
//! model nobody knows which: the caller says, or millimetres are assumed with a warning.

use crate::instant;
use crate::track::{LengthUnit, Row, Track, number, three_numbers, track_of};
use plan::{Diagnostic, Diagnostics};
use std::collections::BTreeMap;
use units::Timestamp;

/// True when a line looks like SHDR: a date before the first bar, and a key.
pub(crate) fn looks_like(line: &str) -> bool {
    line.split_once('|')
        .is_some_and(|(date, rest)| instant::parse(moment(date)).is_some() && !rest.is_empty())
}

/// The date of `date@duration`.
fn moment(field: &str) -> &str {
    field.split_once('@').map_or(field, |(date, _)| date)
}

/// What one key said, in order.
#[derive(Default)]
struct Key<'a> {
    values: Vec<(Timestamp, u64, &'a str)>,
    triples: usize,
    numbers: usize,
}

pub(crate) fn read_shdr(
    text: &str,
    item: Option<&str>,
    unit: Option<LengthUnit>,
    file: &str,
    diagnostics: &mut Diagnostics,
) -> Track {
    let mut keys: BTreeMap<&str, Key<'_>> = BTreeMap::new();
    let mut order = 0u64;
    for (line, content) in text.lines().enumerate() {
        let content = content.trim();
        // Lines that begin with a star are the protocol's own commands.
        if content.is_empty() || content.starts_with('*') {
            continue;
        }
        let mut fields = content.split('|');
        let date = fields.next().unwrap_or_default();
        let Some(at) = instant::parse(moment(date)) else {
            let shown: String = content.chars().take(60).collect();
            let message = format!("\"{shown}\" does not begin with a date; the line was left out");
            diagnostics.add(
                Diagnostic::warning("bad-line", message)
                    .in_file(file)
                    .at_line(line as u32 + 1, 1),
            );
            continue;
        };
        while let (Some(key), Some(value)) = (fields.next(), fields.next()) {
            // `device:key` names the device.
            let key = key.rsplit(':').next().unwrap_or(key).trim();
            if key.is_empty() {
                continue;
            }
            order += 1;
            let value = value.trim();
            let entry = keys.entry(key).or_default();
            entry.triples += usize::from(three_numbers(value).is_some());
            entry.numbers += usize::from(number(value).is_some());
            entry.values.push((at, order, value));
        }
    }
    let (rows, source) = match choose(&keys, item) {
        Some(Choice::Path(key)) => {
            let rows = keys[key].values.iter().filter_map(|(at, sequence, value)| {
                let position = three_numbers(value);
                (position.is_some() || unavailable(value)).then_some(Row {
                    at: *at,
                    sequence: *sequence,
                    instance: 0,
                    position,
                    lost: false,
                })
            });
            (rows.collect(), key.to_owned())
        }
        Some(Choice::Axes(axes)) => (put_together(&keys, axes), axes.join(" ")),
        None => {
            if let Some(wanted) = item {
                let message = format!("no key \"{wanted}\" with three numbers a value, nor with axis letters, is in the log");
                diagnostics.add(Diagnostic::error("no-such-item", message).in_file(file));
            }
            (Vec::new(), String::new())
        }
    };
    if unit.is_none() && !rows.is_empty() {
        diagnostics.add(
            Diagnostic::warning("unit-assumed", "an SHDR log does not say its unit: millimetres were assumed")
                .in_file(file)
                .remedy("say the unit; the device model's nativeUnits know it"),
        );
    }
    let mut track = track_of(rows, unit, file, diagnostics);
    track.source = source;
    track
}

fn unavailable(value: &str) -> bool {
    value.eq_ignore_ascii_case("UNAVAILABLE")
}

enum Choice<'a> {
    Path(&'a str),
    Axes([&'a str; 3]),
}

fn choose<'a>(keys: &BTreeMap<&'a str, Key<'a>>, item: Option<&str>) -> Option<Choice<'a>> {
    let wanted = |key: &str| item.is_none_or(|item| item == key);
    let path = keys
        .iter()
        .filter(|(key, k)| k.triples > 0 && wanted(key))
        .max_by_key(|(key, k)| (k.triples, std::cmp::Reverse(**key)));
    if let Some((key, _)) = path {
        return Some(Choice::Path(key));
    }
    // `Xposition`, `Xact`, `Xabs`: the other two axes must be there.
    let mut best: Option<(usize, [&str; 3])> = None;
    for (x, k) in keys.iter().filter(|(_, k)| k.numbers > 0) {
        let lower = x.to_ascii_lowercase();
        let speaks_of_position = ["pos", "act", "abs", "mach", "work"].iter().any(|word| lower.contains(word)) || lower == "x";
        let Some(at) = lower.find('x').filter(|_| speaks_of_position) else {
            continue;
        };
        let other = |letter: u8| {
            let letter = if x.as_bytes()[at] == b'X' {
                letter
            } else {
                letter.to_ascii_lowercase()
            };
            let name = format!("{}{}{}", &x[..at], char::from(letter), &x[at + 1..]);
            keys.get_key_value(name.as_str())
                .filter(|(_, k)| k.numbers > 0)
                .map(|(key, k)| (*key, k.numbers))
        };
        if let (Some((y, ny)), Some((z, nz))) = (other(b'Y'), other(b'Z'))
            && (wanted(x) || wanted(y) || wanted(z))
        {
            let count = k.numbers + ny + nz;
            if best.is_none_or(|(most, _)| count > most) {
                best = Some((count, [x, y, z]));
            }
        }
    }
    best.map(|(_, axes)| Choice::Axes(axes))
}

fn put_together(keys: &BTreeMap<&str, Key<'_>>, axes: [&str; 3]) -> Vec<Row> {
    let mut all: Vec<(u64, Timestamp, usize, &str)> = Vec::new();
    for (axis, key) in axes.iter().enumerate() {
        all.extend(keys[key].values.iter().map(|(at, order, value)| (*order, *at, axis, *value)));
    }
    all.sort_unstable();
    let mut rows: Vec<Row> = Vec::new();
    let mut place: [Option<f64>; 3] = [None; 3];
    let mut known = false;
    for (order, at, axis, value) in all {
        place[axis] = number(value);
        let position = match place {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ if !known => continue,
            _ => None,
        };
        known = true;
        let row = Row {
            at,
            sequence: order,
            instance: 0,
            position,
            lost: false,
        };
        match rows.last_mut() {
            Some(last) if last.at == at => *last = row,
            _ => rows.push(row),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, unit: Option<LengthUnit>) -> (Track, Vec<&'static str>) {
        let mut diagnostics = Diagnostics::new();
        let track = read_shdr(text, None, unit, "a.log", &mut diagnostics);
        (track, diagnostics.as_slice().iter().map(|d| d.code).collect())
    }

    #[test]
    fn a_path_position_is_found_by_its_three_numbers() {
        let log = "2016-05-13T05:00:00.0Z|path_pos|UNAVAILABLE\n2016-05-13T05:00:01Z|line|12|path_pos|1.0 2.0 3.0\n* PONG 1\n2016-05-13T05:00:02Z|m:path_pos|2 2 3\n";
        let (track, codes) = read(log, Some(LengthUnit::Inch));
        assert_eq!(track.points.len(), 2);
        assert_eq!(track.points[1].position[0], 50.8);
        assert_eq!(track.gaps.len(), 1);
        assert!(codes.is_empty());
    }

    #[test]
    fn axes_are_put_together_by_their_letters_and_the_unit_is_asked_for() {
        let log = "2016-05-13T05:00:00Z|Xabs|1|Yabs|2\n2016-05-13T05:00:00Z|Zabs|3|Xload|9\n2016-05-13T05:00:01Z|Xabs|4\n";
        let (track, codes) = read(log, None);
        let places: Vec<[f64; 3]> = track.points.iter().map(|p| p.position).collect();
        assert_eq!(places, [[1.0, 2.0, 3.0], [4.0, 2.0, 3.0]]);
        assert_eq!(codes, ["unit-assumed"]);
    }

    #[test]
    fn lines_without_a_date_are_counted() {
        let (_, codes) = read("hello\n2016-05-13T05:00:00Z|a|1 2 3\n", Some(LengthUnit::Millimetre));
        assert_eq!(codes, ["bad-line"]);
    }
}

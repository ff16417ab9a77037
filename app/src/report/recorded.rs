//! What the functions of a program recorded, as the report shows it: numbers of each stream, and its course over the run.

use crate::failure::Failure;
use crate::shop;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use units::TICK;

/// One run of a recording, or the values that a synchronized action took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recorded {
    /// Its id, as the program gave it; `action A1` for those of an action.
    pub recording: String,
    /// Which run of the function: ids may come again.
    pub run: i32,
    /// What it recorded.
    pub streams: Vec<Stream>,
}

/// One stream of a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stream {
    /// Its name, as `X.LOAD`.
    pub stream: String,
    /// Its unit, in MTConnect's words.
    pub unit: String,
    /// What its values are worth; several words where that changed.
    pub quality: String,
    /// Values, those that are unavailable among them.
    pub values: u64,
    /// Values that the machine could not give.
    pub unavailable: u64,
    /// Smallest, in the unit.
    pub min: Option<f64>,
    /// Arithmetic mean of the values, not weighted by time.
    pub mean: Option<f64>,
    /// Largest.
    pub max: Option<f64>,
    /// How it went.
    #[serde(skip)]
    pub course: Envelope,
}

/// Reads what was recorded.
///
/// # Errors
/// The file is not there, or damaged.
pub fn read(path: &Path) -> Result<Vec<Recorded>, Failure> {
    let mut found: BTreeMap<(i32, String), Vec<(Stream, f64)>> = BTreeMap::new();
    store::functions::read(path, &mut |row| {
        let streams = found.entry((row.run, row.recording)).or_default();
        let at = streams.iter().position(|(s, _)| s.stream == row.stream).unwrap_or_else(|| {
            streams.push((Stream::new(row.stream, row.unit), 0.0));
            streams.len() - 1
        });
        let (stream, sum) = &mut streams[at];
        stream.take(row.tick, row.value, &row.quality);
        *sum += row.value.unwrap_or(0.0);
    })
    .map_err(shop::failure)?;
    let recorded = found.into_iter().map(|((run, recording), streams)| Recorded {
        recording,
        run,
        streams: streams.into_iter().map(|(stream, sum)| stream.with_mean(sum)).collect(),
    });
    Ok(recorded.collect())
}

impl Stream {
    fn new(stream: String, unit: String) -> Stream {
        Stream {
            stream,
            unit,
            quality: String::new(),
            values: 0,
            unavailable: 0,
            min: None,
            mean: None,
            max: None,
            course: Envelope::default(),
        }
    }

    fn take(&mut self, tick: u64, value: Option<f64>, quality: &str) {
        self.values += 1;
        match value {
            None => self.unavailable += 1,
            Some(value) => {
                self.min = Some(self.min.map_or(value, |min| min.min(value)));
                self.max = Some(self.max.map_or(value, |max| max.max(value)));
            }
        }
        if !self.quality.split("; ").any(|word| word == quality) {
            let between = if self.quality.is_empty() { "" } else { "; " };
            self.quality = format!("{}{between}{quality}", self.quality);
        }
        self.course.take(tick, value);
    }

    fn with_mean(mut self, sum: f64) -> Stream {
        let known = self.values - self.unavailable;
        self.mean = (known > 0).then(|| sum / known as f64);
        self
    }
}

/// The course of a stream of any length in bounded room: lowest and highest value in equal stretches of time, which double when there are
/// too many of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Envelope {
    first: u64,
    /// Cycles of a stretch are two to this power.
    power: u32,
    stretches: Vec<Stretch>,
}

/// One stretch of time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    /// Which, from the first value on.
    number: u64,
    /// Its lowest and its highest value, each with the cycle; `None` where there was none.
    range: Option<[(u64, f64); 2]>,
    /// A value was missing in it.
    missing: bool,
}

impl Envelope {
    /// More cannot be told apart in a picture.
    const MOST: usize = 600;

    /// Takes a value. They come in order of time but for those that are told at the end of their recording.
    fn take(&mut self, tick: u64, value: Option<f64>) {
        if self.stretches.is_empty() {
            self.first = tick;
        }
        let stretch = Stretch {
            number: tick.saturating_sub(self.first) >> self.power,
            range: value.map(|value| [(tick, value); 2]),
            missing: value.is_none(),
        };
        self.put(stretch);
        while self.stretches.len() > Self::MOST {
            self.power += 1;
            for mut stretch in std::mem::take(&mut self.stretches) {
                stretch.number >>= 1;
                self.put(stretch);
            }
        }
    }

    fn put(&mut self, new: Stretch) {
        match self.stretches.last_mut() {
            Some(last) if last.number >= new.number => {
                last.missing |= new.missing;
                last.range = match (last.range, new.range) {
                    (Some([low, high]), Some([new_low, new_high])) => Some([
                        if new_low.1 < low.1 { new_low } else { low },
                        if new_high.1 > high.1 { new_high } else { high },
                    ]),
                    (a, b) => a.or(b),
                };
            }
            _ => self.stretches.push(new),
        }
    }

    /// Connected points `[s since the start, value]`; a line ends where a value is missing.
    pub fn pieces(&self) -> Vec<Vec<[f64; 2]>> {
        let point = |(tick, value): (u64, f64)| [tick as f64 * TICK.0, value];
        let mut pieces = vec![vec![]];
        for stretch in &self.stretches {
            if let (Some([low, high]), Some(piece)) = (stretch.range, pieces.last_mut()) {
                let (first, second) = if high.0 < low.0 { (high, low) } else { (low, high) };
                piece.push(point(first));
                if second != first {
                    piece.push(point(second));
                }
            }
            if stretch.missing {
                pieces.push(vec![]);
            }
        }
        pieces.retain(|piece| !piece.is_empty());
        pieces
    }

    /// True when there is something to see: two moments at least.
    pub fn is_a_course(&self) -> bool {
        self.stretches.iter().filter(|stretch| stretch.range.is_some()).count() > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: impl IntoIterator<Item = (u64, Option<f64>)>) -> Envelope {
        let mut envelope = Envelope::default();
        for (tick, value) in values {
            envelope.take(tick, value);
        }
        envelope
    }

    #[test]
    fn a_short_course_is_drawn_value_by_value_and_ends_where_one_is_missing() {
        let envelope = of([(1000, Some(1.0)), (1001, Some(3.0)), (1002, None), (1003, Some(2.0))]);
        let expected = [vec![[1.0, 1.0], [1.001, 3.0]], vec![[1.003, 2.0]]];
        for (piece, expected) in envelope.pieces().iter().zip(&expected) {
            assert_eq!(piece.len(), expected.len());
            for (point, expected) in piece.iter().zip(expected) {
                assert!((point[0] - expected[0]).abs() < 1e-9 && point[1] == expected[1], "{point:?}");
            }
        }
        assert_eq!(envelope.pieces().len(), 2);
    }

    #[test]
    fn a_course_of_hours_stays_small_and_keeps_its_highest_and_lowest_value() {
        let value = |tick: u64| match tick {
            1_234_567 => 99.0,
            2_345_678 => -99.0,
            tick => (tick % 100) as f64 / 100.0,
        };
        let envelope = of((5_000..3_600_000).map(|tick| (tick, Some(value(tick)))));
        assert!((300..=Envelope::MOST).contains(&envelope.stretches.len()));
        let pieces = envelope.pieces();
        let points: Vec<[f64; 2]> = pieces.into_iter().flatten().collect();
        let at = |value: f64| points.iter().find(|p| p[1] == value).map(|p| p[0]);
        assert_eq!((at(99.0), at(-99.0)), (Some(1234.567), Some(2345.678)));
        assert!(points.windows(2).all(|p| p[0][0] <= p[1][0]), "time does not go back");
        assert!((points.last().expect("points")[0] - 3600.0).abs() < 10.0);
    }
}

//! A curve at the resolution of a screen: for each pixel the least, greatest, first and last reading of all rows in it.
//!
//! Exact: a pixel is what its rows come to, none left out and none counted twice. Where pixels are wide, their edges move to the next
//! edge of a bucket, by less than a [`SNAP`]-th of a pixel, and each pixel says where it really begins and ends; so a month is drawn
//! without reading a row. Where pixels are narrow, the rows themselves are read. The ends of the whole span do not move.

use super::build::summary_of;
use super::file::Summary;
use super::walk::{Bucket, Next, walk};
use crate::record::{Column, schema};
use crate::sources::{OpenRaw, Raw, Source};
use crate::{DataDirectory, Of, Span, StoreError};
use arrow_array::Int32Array;
use arrow_array::cast::AsArray;
use arrow_array::types::{Int32Type, TimestampMicrosecondType};
use units::Timestamp;

/// A bucket is taken whole when it is no longer than this part of a pixel.
const SNAP: i64 = 2;
/// Pixels that nobody's screen has.
const MOST_PIXELS: usize = 100_000;

/// A curve, ready to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    /// The channel.
    pub channel: String,
    /// Its unit, in MTConnect's words.
    pub unit: String,
    /// Contiguous, covering the span that was asked for; fewer than were asked for where a pixel would have no width.
    pub pixels: Vec<Pixel>,
}

/// What the rows of a moment come to.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixel {
    /// Where it begins.
    pub from: Timestamp,
    /// Where it ends: the next one's beginning.
    pub to: Timestamp,
    /// Rows in it.
    pub rows: u64,
    /// Rows whose reading is unavailable.
    pub missing: u64,
    /// The least reading; `None` without readings.
    pub min: Option<f64>,
    /// The greatest.
    pub max: Option<f64>,
    /// The first one that is there.
    pub first: Option<f64>,
    /// The last one that is there.
    pub last: Option<f64>,
    /// How often time is missing between two rows inside.
    pub gaps: u64,
    /// True when time is missing between its first row and the row before, in whatever pixel that is: do not draw a line there.
    pub after_gap: bool,
    /// True when the rows themselves were removed by age and their buckets are longer than was asked for: the pixel is longer then, and
    /// may reach beyond the span.
    pub coarse: bool,
}

impl DataDirectory {
    /// The curve of a channel over a span, in `pixels` of equal width.
    ///
    /// Rows are taken in the order of time. Where records of one machine overlap in time, which only simulated ones do, a pixel takes
    /// them record by record.
    ///
    /// # Errors
    /// No record has the channel, a file is damaged, or the disk refuses.
    pub fn envelope(&self, of: Of<'_>, channel: &str, span: Span, pixels: usize) -> Result<Envelope, StoreError> {
        let (from_us, to_us) = span.micros();
        self.with_sources(of, (from_us, to_us), |sources| {
            let unit = known_channel(sources, channel)?;
            let mut plot = Plot::new(from_us, to_us, pixels.clamp(1, MOST_PIXELS));
            let overlap = sources.windows(2).any(|two| two[1].span_us().0 <= two[0].span_us().1);
            for source in sources.iter().filter(|_| from_us < to_us) {
                plot.begin(source, source.rollup.channel(channel), overlap);
                draw(&mut plot, source, channel)?;
            }
            Ok(Envelope {
                channel: channel.to_owned(),
                unit: unit.clone(),
                pixels: plot.pixels(),
            })
        })
    }
}

/// The unit of a channel that one of the sources has. Without sources any channel will do.
pub(crate) fn known_channel(sources: &[Source], channel: &str) -> Result<String, StoreError> {
    let newest = sources
        .iter()
        .rev()
        .find_map(|s| Some(s.rollup.column(s.rollup.channel(channel)?)));
    match newest {
        Some(column) => Ok(column.unit),
        None if sources.is_empty() => Ok(String::new()),
        None => {
            let mut known: Vec<String> = sources.iter().flat_map(|s| s.rollup.columns()).map(|c| c.name).collect();
            known.sort();
            known.dedup();
            Err(StoreError::NoSuchChannel {
                name: channel.to_owned(),
                known,
            })
        }
    }
}

/// Puts one record into the pixels.
fn draw(plot: &mut Plot, source: &Source, channel: &str) -> Result<(), StoreError> {
    // A record that lacks the channel has rows without readings: any other channel tells of its rows.
    let there = source.rollup.channel(channel);
    let mut rows = match &source.raw {
        Raw::Gone => None,
        raw => Some(RawRows::new(raw, there.map(|_| channel))),
    };
    if there.is_none() && source.rollup.columns().is_empty() {
        return Err(source.rollup.damaged("it has no channel at all"));
    }
    walk(
        &source.rollup,
        there.unwrap_or(0),
        plot.from_us,
        plot.to_us,
        &mut |mut bucket| {
            if there.is_none() {
                bucket.summary = Summary {
                    missing: bucket.rows,
                    ..Summary::default()
                };
            }
            if plot.takes(&bucket) {
                match &mut rows {
                    Some(rows) => rows.whole(bucket, plot)?,
                    None => plot.add_whole(&bucket),
                }
                return Ok(Next::Done);
            }
            if bucket.level > 0 {
                return Ok(Next::Finer);
            }
            match &mut rows {
                Some(rows) => rows.want(bucket, plot)?,
                None => plot.add_coarse(&bucket),
            }
            Ok(Next::Done)
        },
    )?;
    match rows {
        Some(mut rows) => rows.flush(plot),
        None => Ok(()),
    }
}

/// Buckets whose rows are to be read, neighbours together.
struct RawRows<'a> {
    raw: &'a Raw,
    channel: Option<&'a str>,
    open: Option<OpenRaw>,
    wanted: Vec<Bucket>,
    /// How many of the last ones need not be read: they are only when one behind them is.
    whole: usize,
}

/// So many buckets are read at once at most.
const AT_ONCE: usize = 4096;
/// To begin reading anew costs as much as the rows of so many buckets. Where a pixel is little wider than a bucket, every second bucket
/// fits into one, and reading around each of those made such a curve ten times as slow.
const BRIDGE: usize = 64;

impl<'a> RawRows<'a> {
    fn new(raw: &'a Raw, channel: Option<&'a str>) -> Self {
        RawRows {
            raw,
            channel,
            open: None,
            wanted: Vec::new(),
            whole: 0,
        }
    }

    /// The rows of a bucket are to be read.
    fn want(&mut self, bucket: Bucket, plot: &mut Plot) -> Result<(), StoreError> {
        if !self.follows(&bucket) {
            self.flush(plot)?;
        }
        self.wanted.push(bucket);
        self.whole = 0;
        Ok(())
    }

    /// A bucket can be taken whole.
    fn whole(&mut self, bucket: Bucket, plot: &mut Plot) -> Result<(), StoreError> {
        if self.wanted.is_empty() || bucket.level > 0 || self.whole == BRIDGE || !self.follows(&bucket) {
            self.flush(plot)?;
            plot.add_whole(&bucket);
            return Ok(());
        }
        self.wanted.push(bucket);
        self.whole += 1;
        Ok(())
    }

    fn follows(&self, bucket: &Bucket) -> bool {
        let last = self.wanted.last();
        last.is_none_or(|last| last.row + last.rows == bucket.row) && self.wanted.len() < AT_ONCE
    }

    /// Puts everything that waits into the plot.
    fn flush(&mut self, plot: &mut Plot) -> Result<(), StoreError> {
        let mut wanted = std::mem::take(&mut self.wanted);
        let whole = wanted.split_off(wanted.len() - std::mem::take(&mut self.whole));
        self.read(wanted, plot)?;
        whole.iter().for_each(|bucket| plot.add_whole(bucket));
        Ok(())
    }

    fn read(&mut self, wanted: Vec<Bucket>, plot: &mut Plot) -> Result<(), StoreError> {
        let (Some(first), Some(last)) = (wanted.first(), wanted.last()) else {
            return Ok(());
        };
        if self.open.is_none() {
            self.open = self.raw.open()?;
        }
        let Some(file) = &self.open else {
            return Ok(());
        };
        // Times are only read where they do not follow from the bucket's own.
        let read_times = wanted.iter().any(|b| !b.even);
        let mut names = Vec::from_iter(self.channel);
        if read_times || names.is_empty() {
            names.push(schema::TS);
        }
        let damaged = |what: &str| StoreError::Damaged {
            path: file.path().to_owned(),
            what: what.to_owned(),
        };
        let mut buckets = wanted.iter();
        let mut open: Option<(Bucket, u64)> = None;
        let mut whole = Summary::default();
        for batch in file.read(first.row..last.row + last.rows, &names)? {
            let batch = batch?;
            let times = batch
                .column_by_name(schema::TS)
                .map(|c| c.as_primitive::<TimestampMicrosecondType>().values());
            let readings = match self.channel {
                Some(name) => batch
                    .column_by_name(name)
                    .and_then(|c| c.as_primitive_opt::<Int32Type>())
                    .cloned()
                    .ok_or_else(|| damaged("it lacks a column that its roll-up has"))?,
                None => Int32Array::new_null(batch.num_rows()),
            };
            let mut at = 0;
            while at < batch.num_rows() {
                let (bucket, done) = match open.take() {
                    Some(begun) => begun,
                    None => {
                        whole = Summary::default();
                        (
                            *buckets.next().ok_or_else(|| damaged("it has more rows than its roll-up"))?,
                            0,
                        )
                    }
                };
                let n = (batch.num_rows() - at).min((bucket.rows - done) as usize);
                let step = if bucket.rows > 1 {
                    (bucket.last_us - bucket.first_us) / (bucket.rows as i64 - 1)
                } else {
                    0
                };
                let time = |k: usize| match times {
                    Some(times) => times[at + k],
                    None => bucket.first_us + (done as i64 + k as i64) * step,
                };
                plot.add_rows(n, time, |from, to| summary_of(&readings, at + from, at + to));
                whole.add(&summary_of(&readings, at, at + n));
                at += n;
                if done + (n as u64) < bucket.rows {
                    open = Some((bucket, done + n as u64));
                } else if whole != bucket.summary {
                    return Err(damaged("its readings are not those that its roll-up was made of"));
                }
            }
        }
        if open.is_some() || buckets.next().is_some() {
            return Err(damaged("it has fewer rows than its roll-up"));
        }
        Ok(())
    }
}

/// The pixels in the making.
struct Plot {
    from_us: i64,
    to_us: i64,
    pixels: Vec<Option<Drawn>>,
    column: Column,
    gap_us: i64,
    overlap: bool,
    /// The pixel that the last rows went into.
    current: usize,
    /// Time of the last row that was put in.
    last_us: Option<i64>,
}

/// What was put into a pixel, and when its rows were.
struct Drawn {
    first_us: i64,
    last_us: i64,
    pixel: Pixel,
}

impl Plot {
    fn new(from_us: i64, to_us: i64, count: usize) -> Plot {
        Plot {
            from_us,
            to_us: to_us.max(from_us),
            pixels: (0..count).map(|_| None).collect(),
            column: Column {
                name: String::new(),
                unit: String::new(),
                scale: 1.0,
                offset: 0.0,
            },
            gap_us: 0,
            overlap: false,
            current: 0,
            last_us: None,
        }
    }

    /// Goes on with another record.
    fn begin(&mut self, source: &Source, channel: Option<usize>, overlap: bool) {
        if let Some(channel) = channel {
            self.column = source.rollup.column(channel);
        }
        self.gap_us = source.rollup.gap_us();
        self.overlap = overlap;
        if overlap {
            self.last_us = None;
        }
    }

    fn width(&self) -> i128 {
        i128::from(self.to_us) - i128::from(self.from_us)
    }

    /// The pixel that a moment inside of the span is in.
    fn pixel_at(&self, at: i64) -> usize {
        let since = i128::from(at.clamp(self.from_us, self.to_us - 1)) - i128::from(self.from_us);
        (since * self.pixels.len() as i128 / self.width()) as usize
    }

    /// The first moment of a pixel, before its edge moves.
    fn edge(&self, pixel: usize) -> i64 {
        let (count, pixel) = (self.pixels.len() as i128, pixel as i128);
        (i128::from(self.from_us) + (pixel * self.width() + count - 1) / count) as i64
    }

    /// True when a bucket can be taken whole.
    fn takes(&self, bucket: &Bucket) -> bool {
        if bucket.first_us < self.from_us || bucket.last_us >= self.to_us {
            return false;
        }
        let length = i128::from(bucket.last_us) - i128::from(bucket.first_us);
        let is_short = length * i128::from(SNAP) * self.pixels.len() as i128 <= self.width();
        (is_short && !self.overlap) || self.pixel_at(bucket.first_us) == self.pixel_at(bucket.last_us)
    }

    /// Puts in what rows from `first_us` to `last_us` come to; they go into the pixel of the first.
    fn add(&mut self, first_us: i64, last_us: i64, gaps: u32, raw: &Summary) -> &mut Pixel {
        let follows = self.last_us.is_some_and(|last| first_us <= last);
        if self.overlap {
            self.current = self.pixel_at(first_us);
        } else if !follows {
            // An edge that has moved may have moved over this moment already.
            self.current = self.current.max(self.pixel_at(first_us));
        }
        let after_gap = self.last_us.is_some_and(|last| first_us.saturating_sub(last) > self.gap_us);
        self.last_us = Some(self.last_us.map_or(last_us, |last| last.max(last_us)));
        let column = &self.column;
        let drawn = match &mut self.pixels[self.current] {
            Some(drawn) => {
                drawn.pixel.gaps += u64::from(after_gap);
                drawn.last_us = drawn.last_us.max(last_us);
                drawn
            }
            none => none.insert(Drawn {
                first_us,
                last_us,
                pixel: Pixel {
                    after_gap,
                    ..Pixel::empty()
                },
            }),
        };
        drawn.pixel.gaps += u64::from(gaps);
        drawn.pixel.add(raw, column);
        &mut drawn.pixel
    }

    /// Puts in a bucket that is not cut by the edge of a pixel, or whose edge moves.
    fn add_whole(&mut self, bucket: &Bucket) {
        self.add(bucket.first_us, bucket.last_us, bucket.gaps, &bucket.summary);
    }

    /// Puts in a bucket of the finest level whose rows are gone, though it does not fit.
    fn add_coarse(&mut self, bucket: &Bucket) {
        self.add(bucket.first_us, bucket.last_us, bucket.gaps, &bucket.summary).coarse = true;
    }

    /// Puts in `count` rows with rising times, those that are inside of the span; `summary` tells what some of them come to.
    fn add_rows(&mut self, count: usize, time: impl Fn(usize) -> i64, summary: impl Fn(usize, usize) -> Summary) {
        // The first row from `k` on that is not before a moment.
        let first_from = |mut k: usize, at: i64| {
            let mut end = count;
            while k < end {
                let middle = k + (end - k) / 2;
                if time(middle) < at { k = middle + 1 } else { end = middle }
            }
            k
        };
        let end = first_from(0, self.to_us);
        let mut from = first_from(0, self.from_us);
        while from < end {
            let edge = self.edge(self.pixel_at(time(from)) + 1);
            let to = first_from(from, edge).clamp(from + 1, end);
            self.add(time(from), time(to - 1), 0, &summary(from, to));
            from = to;
        }
    }

    fn pixels(self) -> Vec<Pixel> {
        let count = self.pixels.len();
        let edges: Vec<i64> = (0..=count).map(|k| self.edge(k)).collect();
        let at = |us: i64| Timestamp(us.saturating_mul(1000));
        let mut pixels = Vec::with_capacity(count);
        let mut from = self.from_us;
        for (drawn, edge) in self.pixels.into_iter().zip(&edges[1..]) {
            let mut to = from.max(*edge);
            let mut pixel = Pixel::empty();
            if let Some(drawn) = drawn {
                from = from.min(drawn.first_us);
                to = to.max(drawn.last_us + 1);
                pixel = drawn.pixel;
            }
            if from < to {
                (pixel.from, pixel.to) = (at(from), at(to));
                pixels.push(pixel);
            }
            from = to;
        }
        pixels
    }
}

impl Pixel {
    fn empty() -> Pixel {
        Pixel {
            from: Timestamp(0),
            to: Timestamp(0),
            rows: 0,
            missing: 0,
            min: None,
            max: None,
            first: None,
            last: None,
            gaps: 0,
            after_gap: false,
            coarse: false,
        }
    }

    fn add(&mut self, raw: &Summary, column: &Column) {
        self.rows += raw.count + raw.missing;
        self.missing += raw.missing;
        if raw.count == 0 {
            return;
        }
        let [first, last] = [raw.first, raw.last].map(|raw| column.value(raw));
        let (min, max) = column.ordered(raw.min, raw.max);
        self.min = Some(self.min.map_or(min, |m| m.min(min)));
        self.max = Some(self.max.map_or(max, |m| m.max(max)));
        self.first.get_or_insert(first);
        self.last = Some(last);
    }
}

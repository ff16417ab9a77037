//! Recordings: which streams, when a sample is due, what is kept between two, and why it ended.

use super::context::{Context, Coordinates, Scope};
use crate::compile::{signal_of, unit_of};
use crate::functions::{CoordinateFrame, Measurement, TraceId};
use crate::sensor::{Sensor, Statistic};
use crate::value::Sampling;
use machine::watch::{Readings, SIGNALS};
use machine::{Quality, Sample};
use serde_json::{Value, json};
use units::{Millimetres, StepId, TICK, Tick, ToolNumber, WorkingstepId};

/// How near a point the tool has to pass, mm, when nothing is said.
const NEAR: f64 = 0.05;
/// Values of a `get_<x>_points` that says neither points nor a number.
const SOME: u32 = 100;

/// One value of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The cycle.
    pub tick: Tick,
    /// Which stream of which recording: [`super::Recorder::stream`].
    pub stream: u32,
    /// The value; `None` is unavailable.
    pub value: Option<f64>,
    /// What the machine's measurements are worth.
    pub quality: Quality,
    /// The step in execution.
    pub step: StepId,
    /// The workingstep in execution.
    pub workingstep: WorkingstepId,
    /// The tool in the spindle.
    pub tool: ToolNumber,
}

/// A stream of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// Which run of the function: ids may come again.
    pub run: u32,
    /// The recording's id.
    pub id: String,
    /// The stream's name, with its statistic.
    pub name: String,
    /// MTConnect's word for the unit; empty for a plain number.
    pub unit: &'static str,
    /// Worked out, not measured.
    pub derived: bool,
    /// This machine has it.
    pub available: bool,
}

/// A recording that is asked for.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    pub id: TraceId,
    sampling: Sampling,
    statistic: Statistic,
    max_samples: Option<u32>,
    /// It ends with its path.
    along: bool,
    filter: Option<String>,
    frame: CoordinateFrame,
    with_direction: bool,
}

impl Wanted {
    pub(super) fn of(recording: &crate::functions::Recording, along: bool) -> Self {
        Wanted {
            id: recording.id.clone(),
            sampling: recording.sampling.clone(),
            statistic: recording.statistic,
            max_samples: recording.max_samples,
            along,
            filter: recording.filter.clone(),
            frame: CoordinateFrame::Machine,
            with_direction: false,
        }
    }

    pub(super) fn of_points(measurement: &Measurement, id: TraceId, along: bool) -> Self {
        let sampling = match &measurement.points {
            Some(curve) => Sampling::ByPoints {
                curve: curve.clone(),
                tolerance: measurement.tolerance,
            },
            None => Sampling::ByCount(measurement.number_of_points.unwrap_or(SOME)),
        };
        let of_points = measurement.points.is_some();
        Wanted {
            id,
            sampling,
            statistic: Statistic::Last,
            max_samples: measurement.number_of_points.filter(|_| of_points),
            along,
            filter: None,
            frame: measurement.frame,
            with_direction: measurement.with_direction,
        }
    }

    /// The geometry that it needs.
    pub(super) fn points(&self) -> Option<&str> {
        match &self.sampling {
            Sampling::ByPoints { curve, .. } => Some(curve),
            _ => None,
        }
    }
}

/// A recording that is over.
pub(super) struct Ended {
    pub tick: Tick,
    pub data: Value,
}

/// All recordings of a run.
#[derive(Debug, Default)]
pub(super) struct Recordings {
    active: Vec<Active>,
    streams: Vec<Stream>,
    rows: Vec<Row>,
}

#[derive(Debug)]
struct Active {
    wanted: Wanted,
    run: u32,
    depth: usize,
    began: Tick,
    last: Tick,
    channels: Vec<Channel>,
    points: Vec<[f64; 3]>,
    next_point: usize,
    tip: Option<[f64; 3]>,
    travelled: f64,
    /// Distance at which the next sample is due, where distance decides, mm.
    next_step: f64,
    samples: u64,
    lost: u64,
    /// Count sampling: every so many cycles for now, and what was taken; thinned when it is far too much.
    stride: u64,
    kept: Vec<Vec<Row>>,
}

#[derive(Debug)]
struct Channel {
    stream: u32,
    source: Source,
    statistic: Statistic,
    window: Window,
}

/// Where the values of a channel come from.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// A signal of the machine; `None`: it has none.
    Signal(Option<u8>),
    /// A coordinate in a frame of the program's.
    Coordinate(Coordinates, CoordinateFrame, usize),
    /// The direction of the commanded path.
    Direction(usize),
}

/// What a cycle is seen by.
#[derive(Clone, Copy)]
pub(super) struct Seen<'c> {
    pub sample: &'c Sample,
    /// The cycle before, when it is the neighbour.
    pub previous: Option<&'c Sample>,
    pub readings: &'c Readings,
    pub context: &'c Context,
}

impl Seen<'_> {
    fn value(&self, source: Source) -> Option<f64> {
        match source {
            Source::Signal(signal) => self.readings.value(signal?),
            Source::Coordinate(quantity, frame, axis) => Some(self.context.coordinates(self.sample, quantity, frame)?[axis]),
            Source::Direction(axis) => Some(direction(self.previous?, self.sample)?[axis]),
        }
    }
}

/// The unit tangent of the commanded path between two cycles; `None` at rest.
pub(super) fn direction(before: &Sample, now: &Sample) -> Option<[f64; 3]> {
    let way: [f64; 3] = std::array::from_fn(|k| now.commanded[k] - before.commanded[k]);
    let length = libm::sqrt(way.iter().map(|v| v * v).sum());
    (length > 1e-9).then(|| way.map(|v| v / length))
}

/// What is kept of the cycles since the last sample.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    count: u64,
    last: f64,
    low: f64,
    high: f64,
    sum: f64,
    squares: f64,
}

impl Window {
    fn add(&mut self, value: f64) {
        if self.count == 0 {
            (self.low, self.high) = (value, value);
        }
        self.count += 1;
        self.last = value;
        self.low = self.low.min(value);
        self.high = self.high.max(value);
        self.sum += value;
        self.squares += value * value;
    }
    fn take(&mut self, statistic: Statistic) -> Option<f64> {
        let window = std::mem::take(self);
        let count = window.count as f64;
        (window.count > 0).then(|| match statistic {
            Statistic::Last => window.last,
            Statistic::Minimum => window.low,
            Statistic::Maximum => window.high,
            Statistic::Average => window.sum / count,
            Statistic::Rms => libm::sqrt(window.squares / count),
        })
    }
}

impl Recordings {
    /// Makes a stream known and gives its number.
    pub(super) fn declare(&mut self, run: u32, id: &str, sensor: &Sensor) -> u32 {
        self.declare_in(CoordinateFrame::Machine, run, id, sensor)
    }

    fn declare_in(&mut self, frame: CoordinateFrame, run: u32, id: &str, sensor: &Sensor) -> u32 {
        let signal = signal_of(sensor);
        self.streams.push(Stream {
            run,
            id: id.to_owned(),
            name: frame.named(sensor),
            unit: unit_of(sensor),
            derived: frame != CoordinateFrame::Machine || signal.is_some_and(|s| SIGNALS[usize::from(s)].derived),
            available: signal.is_some(),
        });
        self.streams.len() as u32 - 1
    }

    pub(super) fn stream(&self, number: u32) -> Option<&Stream> {
        self.streams.get(number as usize)
    }

    pub(super) fn take_rows(&mut self) -> Vec<Row> {
        std::mem::take(&mut self.rows)
    }

    /// A value outside of any recording.
    pub(super) fn row(&mut self, stream: u32, sample: &Sample, value: Option<f64>) {
        self.rows.push(row(stream, sample, value));
    }

    /// Begins one; `None` when the id is active. Gives what is told of it.
    pub(super) fn start(
        &mut self,
        wanted: Wanted,
        sensors: Vec<Sensor>,
        points: Vec<[f64; 3]>,
        run: u32,
        depth: usize,
        tick: Tick,
    ) -> Option<Value> {
        if self.active.iter().any(|a| a.wanted.id == wanted.id) {
            return None;
        }
        let mut channels = Vec::new();
        for mut sensor in sensors {
            if sensor.statistic == Statistic::Last {
                sensor.statistic = wanted.statistic;
            }
            let source = match (wanted.frame, Coordinates::of(&sensor), sensor.linear_axis()) {
                (CoordinateFrame::Machine, ..) | (_, None, _) | (.., None) => Source::Signal(signal_of(&sensor)),
                (frame, Some(quantity), Some(axis)) => Source::Coordinate(quantity, frame, axis),
            };
            channels.push(Channel {
                stream: self.declare_in(wanted.frame, run, &wanted.id.0, &sensor),
                source,
                statistic: sensor.statistic,
                window: Window::default(),
            });
        }
        for axis in 0..if wanted.with_direction { 3 } else { 0 } {
            self.streams.push(Stream {
                run,
                id: wanted.id.0.clone(),
                name: format!("PATH.DIRECTION.{}", ["X", "Y", "Z"][axis]),
                unit: "",
                derived: true,
                available: true,
            });
            channels.push(Channel {
                stream: self.streams.len() as u32 - 1,
                source: Source::Direction(axis),
                statistic: Statistic::Last,
                window: Window::default(),
            });
        }
        let streams: Vec<Value> = channels
            .iter()
            .filter_map(|c| self.stream(c.stream))
            .map(|s| {
                let quality = if s.available { None } else { Some("unavailable") };
                json!({ "name": s.name, "unit": s.unit, "derived": s.derived, "quality": quality })
            })
            .collect();
        let interval = cycles_of(&wanted.sampling);
        let rounded = match &wanted.sampling {
            Sampling::ByTime(asked) => {
                let real = interval.unwrap_or(1) as f64 * TICK.0;
                ((real - asked.0).abs() > 1e-9).then_some(real)
            }
            _ => None,
        };
        let begun = json!({
            "id": wanted.id.0, "state": "started", "run": run, "sampling": wanted.sampling.to_string(),
            "statistic": wanted.statistic.word(), "filter": wanted.filter, "streams": streams,
            "cycles": interval, "rounded_to_s": rounded, "points": (!points.is_empty()).then_some(points.len()),
            "max_samples": wanted.max_samples,
            "frame": (wanted.frame != CoordinateFrame::Machine).then(|| wanted.frame.word()),
        });
        self.active.push(Active {
            kept: vec![vec![]; channels.len()],
            wanted,
            run,
            depth,
            began: tick,
            last: tick,
            channels,
            points,
            next_point: 0,
            tip: None,
            travelled: 0.0,
            next_step: 0.0,
            samples: 0,
            lost: 0,
            stride: 1,
        });
        Some(begun)
    }

    /// Ends one by its id; `None` when none is active.
    pub(super) fn stop(&mut self, id: &TraceId, tick: Tick) -> Option<Ended> {
        let at = self.active.iter().position(|a| a.wanted.id == *id)?;
        let mut active = self.active.remove(at);
        active.last = tick;
        Some(self.end(active, "stop"))
    }

    /// Ends what belongs to a scope.
    pub(super) fn end_scope(&mut self, scope: Scope, tick: Tick) -> Vec<Ended> {
        let why = match scope {
            Scope::Workplan(_) => "end of the workplan",
            Scope::Path => "end of the path",
        };
        let ends = |active: &Active| match scope {
            Scope::Workplan(depth) => !active.wanted.along && active.depth >= depth,
            Scope::Path => active.wanted.along,
        };
        let (over, stay) = std::mem::take(&mut self.active).into_iter().partition(ends);
        self.active = stay;
        let over: Vec<Active> = over;
        over.into_iter()
            .map(|mut active| {
                active.last = tick;
                self.end(active, why)
            })
            .collect()
    }

    /// Those that are not ended: id, run, samples so far.
    pub(super) fn open(&self) -> impl Iterator<Item = (&TraceId, u32, u64)> {
        self.active.iter().map(|a| (&a.wanted.id, a.run, a.samples))
    }

    /// Ends all.
    pub(super) fn end_all(&mut self, why: &'static str) -> Vec<Ended> {
        let over = std::mem::take(&mut self.active);
        over.into_iter().map(|active| self.end(active, why)).collect()
    }

    /// Cycles were lost: counted in each. True when there is one.
    pub(super) fn lost(&mut self, cycles: u64) -> bool {
        self.active.iter_mut().for_each(|a| a.lost += cycles);
        !self.active.is_empty()
    }

    /// A cycle; gives what ended in it.
    pub(super) fn cycle(&mut self, seen: Seen<'_>) -> Vec<Ended> {
        if self.active.is_empty() {
            return Vec::new();
        }
        let (sample, previous) = (seen.sample, seen.previous);
        let tip = seen.context.tip(sample.actual);
        let mut ended = Vec::new();
        let mut at = 0;
        while at < self.active.len() {
            let active = &mut self.active[at];
            active.last = sample.tick;
            for channel in &mut active.channels {
                if let Some(value) = seen.value(channel.source) {
                    channel.window.add(value);
                }
            }
            for _ in 0..active.due(sample, previous, tip) {
                active.take(sample, &mut self.rows);
            }
            let most = active.wanted.max_samples.map(u64::from);
            let all_points = !active.points.is_empty() && active.next_point == active.points.len();
            if most.is_some_and(|most| active.samples >= most) || all_points {
                let active = self.active.remove(at);
                let why = if all_points { "all points" } else { "max_samples" };
                ended.push(self.end(active, why));
            } else {
                at += 1;
            }
        }
        ended
    }

    fn end(&mut self, mut active: Active, why: &'static str) -> Ended {
        if let Sampling::ByCount(samples) = active.wanted.sampling {
            active.samples = 0;
            for rows in &active.kept {
                let chosen = evenly(rows, samples as usize);
                active.samples = active.samples.max(chosen.len() as u64);
                self.rows.extend(chosen);
            }
        }
        let missed = active.points.len() - active.next_point;
        let data = json!({
            "function": "stop_sensor_recording", "id": active.wanted.id.0, "state": "ended", "run": active.run, "why": why,
            "samples": active.samples, "lost_cycles": (active.lost > 0).then_some(active.lost),
            "missed_points": (missed > 0).then_some(missed), "from_cycle": active.began.0, "to_cycle": active.last.0,
        });
        Ended { tick: active.last, data }
    }
}

impl Active {
    /// How many samples are due in a cycle: one, none, or a point each when several were passed.
    fn due(&mut self, sample: &Sample, previous: Option<&Sample>, tip: Option<[f64; 3]>) -> u32 {
        let since = sample.tick - self.began;
        match &self.wanted.sampling {
            Sampling::ByCycle(_) | Sampling::ByTime(_) => {
                u32::from(since.is_multiple_of(cycles_of(&self.wanted.sampling).unwrap_or(1)))
            }
            Sampling::ByCount(_) => u32::from(since.is_multiple_of(self.stride)),
            Sampling::ByDistance(Millimetres(step)) => {
                if since > 0
                    && let Some(previous) = previous
                {
                    self.travelled += distance(previous.commanded, sample.commanded);
                }
                // The first sample is at distance 0. Several steps within one cycle's way are one sample, and no debt for later.
                let due = self.travelled >= self.next_step;
                if due {
                    let next = (libm::floor(self.travelled / step) + 1.0) * step;
                    // A step below the last digit of the way comes with every way.
                    self.next_step = next.max(self.travelled.next_up());
                }
                u32::from(due)
            }
            Sampling::ByPoints { tolerance, .. } => {
                let near = tolerance.map_or(NEAR, |t| t.0);
                let Some(tip) = tip else { return 0 };
                let from = self.tip.replace(tip).unwrap_or(tip);
                let mut passed = 0;
                while let Some(point) = self.points.get(self.next_point)
                    && from_segment(from, tip, *point) <= near
                {
                    self.next_point += 1;
                    passed += 1;
                }
                passed
            }
        }
    }

    fn take(&mut self, sample: &Sample, rows: &mut Vec<Row>) {
        self.samples += 1;
        let by_count = match self.wanted.sampling {
            Sampling::ByCount(samples) => Some(samples as usize),
            _ => None,
        };
        for (channel, kept) in self.channels.iter_mut().zip(&mut self.kept) {
            let value = channel.window.take(channel.statistic);
            let row = row(channel.stream, sample, value);
            if by_count.is_some() { kept.push(row) } else { rows.push(row) }
        }
        // Far too much: every second goes, and from here on only every second comes.
        if let Some(samples) = by_count
            && self.kept.first().is_some_and(|k| k.len() > 8 * samples)
        {
            self.stride *= 2;
            for kept in &mut self.kept {
                let mut keep = false;
                kept.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
        }
    }
}

fn row(stream: u32, sample: &Sample, value: Option<f64>) -> Row {
    Row {
        tick: sample.tick,
        stream,
        value,
        quality: sample.quality,
        step: sample.step,
        workingstep: sample.workingstep,
        tool: sample.tool,
    }
}

/// Whole cycles of a sampling by cycles or time.
fn cycles_of(sampling: &Sampling) -> Option<u64> {
    match sampling {
        Sampling::ByCycle(factor) => Some(u64::from(*factor)),
        Sampling::ByTime(interval) => Some((libm::round(interval.0 / TICK.0) as u64).max(1)),
        _ => None,
    }
}

/// So many of the rows, the first and the last among them, as even as they come.
fn evenly(rows: &[Row], count: usize) -> Vec<Row> {
    if rows.len() <= count {
        return rows.to_vec();
    }
    if count == 1 {
        return rows[..1].to_vec();
    }
    let last = rows.len() - 1;
    (0..count).map(|k| rows[(k * last + (count - 1) / 2) / (count - 1)]).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares: f64 = (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum();
    libm::sqrt(squares)
}

/// Distance of a point from the way between two places.
fn from_segment(from: [f64; 3], to: [f64; 3], point: [f64; 3]) -> f64 {
    let way: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
    let length: f64 = way.iter().map(|v| v * v).sum();
    let along: f64 = (0..3).map(|k| (point[k] - from[k]) * way[k]).sum();
    let part = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
    distance(std::array::from_fn(|k| from[k] + way[k] * part), point)
}

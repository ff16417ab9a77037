//! Feed and rapid without a plan: told apart by speed, with a threshold that the record gives itself.
//!
//! Everything is done on logarithms of speed and in units of the record's own sampling, so that inches or another clock change nothing.
//!
//! 1. Two classes by Otsu's criterion (N. Otsu 1979: the split that explains most of the variance), each speed weighted by the way
//!    travelled at it: feed takes most of the time and rapids most of the speed, by way they are about even.
//! 2. When the upper class falls apart again, clearly and by more than a factor of four, the lower part of it was a fast feed: the split
//!    moves up. Rapids differ by less: by how many axes move, and by how fast each axis is.
//! 3. The threshold is laid into the lowest stretch without speeds (or the emptiest) above the fastest speed that is *held*: ramps pass every speed, but
//!    only a feed stays at one.
//! 4. Hysteresis: an interval beside a rapid belongs to it down to half way (in ratio) from the threshold to the fastest held feed.
//! 5. A slow stretch between two rapids is a feed only when enough intervals in it agree on a speed, or when it is too long to be the
//!    stop between them: the published method asks the same of the last three positions.

use crate::align::Spot;
use crate::labels::noise_of;
use crate::plot::{peaks, thin};
use crate::rebuild::{Options, Rebuild, interval_of, runs_of, spots_of, tolerance_of};
use crate::recording::{RecordFrame, Recording};
use crate::report::{Plot, PlotLine, Report, Settings, ToolpathReport, Verdict, WorkingstepReport};
use crate::vec3::{V3, distance, quantile};
use libm::{exp, log};
use plan::executed::{AsExecuted, ExecutedPoint, ExecutedToolpath, ExecutedWorkingstep, PathKind};
use units::{MmPerSec, Point, Seconds, Timestamp};

/// A record cut by speed.
pub(crate) struct SpeedSplit {
    /// Kind of each interval between two samples.
    pub(crate) kinds: Vec<PathKind>,
    /// Faster is rapid, mm/s; `None` when there is only one class.
    pub(crate) threshold: Option<f64>,
    /// Share of the spread of log speeds that the two classes explain.
    pub(crate) separation: f64,
    /// Fastest speed that is held below the threshold, mm/s.
    pub(crate) feed: f64,
}

/// Intervals that must agree on a speed to be a feed between two rapids; the published method's number.
const AGREE: usize = 3;
/// Speeds agree within this ratio.
const ALIKE: f64 = 1.15;
/// Positions within this many times their noise of each other are one place.
const SWAY: f64 = 6.0;
/// Two classes need this much of the spread of speeds between them: a single bell has 0.64 in its two halves.
const TWO_CLASSES: f64 = 0.6;
/// The slower class must be held for this share of the time: corners are slow too, but no feed.
const HELD: f64 = 0.05;

/// One interval: its speed and how far it goes.
#[derive(Clone, Copy)]
struct Pace {
    speed: f64,
    way: f64,
    time: f64,
}

pub(crate) fn split(spots: &[Spot]) -> SpeedSplit {
    let usual = interval_of(spots);
    let paces: Vec<Pace> = spots
        .windows(2)
        .map(|w| {
            let time = w[1].time - w[0].time;
            let way = distance(w[0].place, w[1].place);
            // Two samples with nearly the same time stamp are a jitter of the stamps, not a speed.
            let speed = if usual > 0.0 { way / time.max(usual / 2.0) } else { 0.0 };
            Pace { speed, way, time }
        })
        .collect();
    // A pause in the record says nothing about speed.
    let known = |p: &Pace| p.speed > 0.0 && p.time <= 20.0 * usual;
    // On a ramp a speed is only passed through: it says what the acceleration is, not what was asked for.
    let on_ramp = |k: usize| {
        k > 0 && k + 1 < paces.len() && {
            let (a, b, c) = (paces[k - 1].speed, paces[k].speed, paces[k + 1].speed);
            (a * ALIKE < b && b * ALIKE < c) || (c * ALIKE < b && b * ALIKE < a)
        }
    };
    let mut moving: Vec<(f64, f64)> = (0..paces.len())
        .filter(|k| known(&paces[*k]) && !on_ramp(*k))
        .map(|k| (log(paces[k].speed), paces[k].way))
        .collect();
    moving.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let whole = otsu(&moving);
    let (low, high) = whole.map_or((0.0, 0.0), |(cut, _)| (mean(&moving[..cut]), mean(&moving[cut..])));
    let one_class = |separation: f64| {
        let feed = moving.last().map_or(0.0, |m| exp(m.0));
        let standing = standing(spots, feed * usual);
        let kinds = standing
            .iter()
            .map(|s| if *s { PathKind::Dwell } else { PathKind::Feed })
            .collect();
        SpeedSplit {
            kinds,
            threshold: None,
            separation,
            feed,
        }
    };
    let Some((mut cut, mut separation)) = whole else {
        return one_class(0.0);
    };
    let border = (moving[cut - 1].0 + moving[cut].0) / 2.0;
    let time_held = held(&paces, exp(border)).len() as f64 / paces.len() as f64;
    if separation < TWO_CLASSES || high - low < log(2.0) || time_held < HELD {
        return one_class(separation);
    }
    while let Some((higher, clear)) = otsu(&moving[cut..]) {
        let (low, high) = moving[cut..].split_at(higher);
        // A fast feed is held; what is not held are rapids, and faster still are leaps of the record.
        let between = (exp(low[0].0), exp(high[0].0));
        let held_there = held(&paces, between.1).iter().filter(|v| **v >= between.0).count() as f64;
        if clear < 0.9 || mean(high) - mean(low) < log(4.0) || held_there < HELD * paces.len() as f64 {
            break;
        }
        cut += higher;
        separation = explained(&moving, cut);
    }
    let low = mean(&moving[..cut]);
    // A quarter of the way at rapid is slower than this: leaps of the record at the other end do not move it.
    let high = quartile(&moving[cut..]);
    let border = (moving[cut - 1].0 + moving[cut].0) / 2.0;
    let mut held = held(&paces, exp(border));
    // The fastest 2 % may be chance.
    let feed = if held.is_empty() {
        exp(low)
    } else {
        quantile(&mut held, 0.98)
    };
    let threshold = exp(emptiest(&moving, log(feed), high));
    SpeedSplit {
        kinds: label(&paces, &standing(spots, feed * usual), threshold, feed, usual),
        threshold: Some(threshold),
        separation,
        feed,
    }
}

/// Mean of log speeds, weighted by way.
fn mean(values: &[(f64, f64)]) -> f64 {
    let (sum, weight) = values.iter().fold((0.0, 0.0), |(s, w), v| (s + v.0 * v.1, w + v.1));
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// The log speed below which a quarter of the way was travelled. The values are sorted.
fn quartile(values: &[(f64, f64)]) -> f64 {
    let quarter = values.iter().map(|v| v.1).sum::<f64>() / 4.0;
    let mut way = 0.0;
    for (value, weight) in values {
        way += weight;
        if way >= quarter {
            return *value;
        }
    }
    0.0
}

/// The number of values below the best split, and the share of variance it explains. The values are sorted.
fn otsu(values: &[(f64, f64)]) -> Option<(usize, f64)> {
    let weight: f64 = values.iter().map(|v| v.1).sum();
    let all = mean(values);
    let variance: f64 = values.iter().map(|v| v.1 * (v.0 - all) * (v.0 - all)).sum();
    if weight <= 0.0 || variance <= 0.0 || variance.is_nan() {
        return None;
    }
    let (mut w, mut sum) = (0.0, 0.0);
    let mut best: Option<(usize, f64)> = None;
    for k in 1..values.len() {
        w += values[k - 1].1;
        sum += values[k - 1].1 * values[k - 1].0;
        let rest = weight - w;
        if w <= 0.0 || rest <= 0.0 || values[k].0 <= values[k - 1].0 {
            continue;
        }
        let apart = sum / w - (all * weight - sum) / rest;
        let between = w * rest / weight * apart * apart / variance;
        if best.is_none_or(|(_, most)| between > most) {
            best = Some((k, between.min(1.0)));
        }
    }
    best
}

/// Share of the variance that a split explains.
fn explained(values: &[(f64, f64)], cut: usize) -> f64 {
    let within = |part: &[(f64, f64)]| {
        let m = mean(part);
        part.iter().map(|v| v.1 * (v.0 - m) * (v.0 - m)).sum::<f64>()
    };
    let total = within(values);
    if total > 0.0 {
        1.0 - (within(&values[..cut]) + within(&values[cut..])) / total
    } else {
        0.0
    }
}

/// The speeds below `border` at which three intervals in a row agree.
fn held(paces: &[Pace], border: f64) -> Vec<f64> {
    paces
        .windows(3)
        .filter(|w| w.iter().all(|p| p.speed > 0.0 && p.speed <= border) && agree(w))
        .map(|w| w[1].speed)
        .collect()
}

/// Intervals in which the machine stands: at least [`AGREE`] in a row that stay within the noise of one place. `step` is the way from
/// sample to sample at the fastest feed: a slower feed must still get away.
fn standing(spots: &[Spot], step: f64) -> Vec<bool> {
    let radius = (SWAY * noise_of(spots)).min(step / 4.0);
    let mut standing = vec![false; spots.len().saturating_sub(1)];
    let mut k = 0;
    while k < standing.len() {
        let begin = k;
        while k < standing.len() && distance(spots[begin].place, spots[k + 1].place) <= radius {
            k += 1;
        }
        if k - begin >= AGREE {
            standing[begin..k].fill(true);
        } else {
            k = begin + 1;
        }
    }
    standing
}

fn agree(paces: &[Pace]) -> bool {
    let (low, high) = paces
        .iter()
        .fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), p| (l.min(p.speed), h.max(p.speed)));
    high <= low * ALIKE
}

/// A stretch of a third of an octave is wide: feeds that are held scatter by less.
const WIDE: usize = 4;

/// The middle of the emptiest stretch of log speeds between two: a histogram in steps of a twelfth of an octave.
fn emptiest(values: &[(f64, f64)], low: f64, high: f64) -> f64 {
    let step = log(2.0) / 12.0;
    let bins = ((high - low) / step) as usize;
    if bins < 3 {
        return (low + high) / 2.0;
    }
    let mut counts = vec![0usize; bins];
    for (value, _) in values {
        let at = (value - low) / step;
        if at >= 0.0 && (at as usize) < bins {
            counts[at as usize] += 1;
        }
    }
    // The bins at the two ends hold the flanks of the classes themselves.
    let smooth: Vec<usize> = (0..bins)
        .map(|k| counts[k.saturating_sub(1)..(k + 2).min(bins)].iter().sum())
        .collect();
    let least = smooth[1..].iter().copied().min().unwrap_or(0);
    let (mut best, mut length) = (bins / 2, 0);
    let mut k = 1;
    while k < bins {
        let begin = k;
        while k < bins && smooth[k] == least {
            k += 1;
        }
        if k - begin > length {
            (best, length) = (begin + k, k - begin);
        }
        // The lowest stretch that is wide enough: higher up, speeds are apart because there are few of them.
        if length >= WIDE {
            break;
        }
        k += 1;
    }
    if length == 0 {
        (low + high) / 2.0
    } else {
        low + step * best as f64 / 2.0
    }
}

fn label(paces: &[Pace], standing: &[bool], threshold: f64, feed: f64, usual: f64) -> Vec<PathKind> {
    let low = (threshold * feed.min(threshold)).sqrt();
    let mut rapid: Vec<bool> = paces.iter().map(|p| p.speed > threshold).collect();
    for k in 1..rapid.len() {
        rapid[k] |= rapid[k - 1] && paces[k].speed > low;
    }
    for k in (1..rapid.len()).rev() {
        rapid[k - 1] |= rapid[k] && paces[k - 1].speed > low;
    }
    // How quickly this machine gets from standing to the threshold, by its own ramps: the stop between two rapids lasts twice that.
    let mut ramps: Vec<f64> = Vec::new();
    for k in 1..rapid.len() {
        if rapid[k] != rapid[k - 1] {
            let rise = (paces[k].speed - paces[k - 1].speed).abs();
            ramps.push(rise / ((paces[k].time + paces[k - 1].time) / 2.0).max(usual / 2.0));
        }
    }
    let ramp = quantile(&mut ramps, 0.5);
    let stop = if ramp > 0.0 { 2.0 * threshold / ramp } else { 0.0 } + AGREE as f64 * usual;
    let mut kinds: Vec<PathKind> = (0..paces.len())
        .map(|k| match (rapid[k], standing[k]) {
            (true, _) => PathKind::Rapid,
            (false, true) => PathKind::Dwell,
            (false, false) => PathKind::Feed,
        })
        .collect();
    let mut k = 0;
    while k < kinds.len() {
        if rapid[k] {
            k += 1;
            continue;
        }
        let begin = k;
        while k < kinds.len() && !rapid[k] {
            k += 1;
        }
        let beside_rapid = begin > 0 || k < kinds.len();
        let moving: Vec<usize> = (begin..k).filter(|i| !standing[*i]).collect();
        let time: f64 = moving.iter().map(|i| paces[*i].time.min(20.0 * usual)).sum();
        // A feed holds its speed; a stop passes through all of them.
        let holds = (begin..k.saturating_sub(AGREE - 1)).any(|i| {
            let few = &paces[i..i + AGREE];
            (i..i + AGREE).all(|j| !standing[j]) && agree(few)
        });
        let is_feed = time > stop || (holds && time > stop - usual);
        if beside_rapid && !is_feed {
            for i in moving {
                kinds[i] = PathKind::Rapid;
            }
        }
    }
    kinds
}

pub(crate) fn without_plan(record: &Recording, options: &Options) -> Rebuild {
    let ordered = record.ordered();
    let mut findings = ordered.findings;
    let points = ordered.points;
    let spots = spots_of(&points, [0.0; 3]);
    let found = split(&spots);
    let usual = interval_of(&spots);
    match found.threshold {
        Some(threshold) => {
            let sure = if found.separation > 0.9 {
                "clearly apart"
            } else {
                "not clearly apart: look at the speeds"
            };
            findings.push(format!(
                "faster than {threshold:.1} mm/s is taken for rapid: found in the record itself, between feeds up to {:.1} mm/s and the rapids; the two explain {:.1} % of the spread of speeds, they are {sure}",
                found.feed,
                100.0 * found.separation
            ));
        }
        None if points.len() > 1 => {
            findings.push("the record shows one class of speeds only: all of it is taken for feed".to_owned())
        }
        None => findings.push("the record has fewer than two samples: nothing can be told from it".to_owned()),
    }
    findings.push("there is no plan to compare with: nothing is judged".to_owned());
    let mut toolpaths: Vec<ExecutedToolpath> = Vec::new();
    let mut reports = Vec::new();
    let mut numbers = 0;
    let mut k = 0;
    while k < found.kinds.len() {
        let kind = found.kinds[k];
        let begin = k;
        while k < found.kinds.len() && found.kinds[k] == kind {
            k += 1;
        }
        numbers += 1;
        // Standing noise is one place.
        let run = &points[begin..=k];
        let time = run[run.len() - 1].at.since(run[0].at).0;
        let way: f64 = run.windows(2).map(|w| distance(w[0].position, w[1].position)).sum();
        let toolpath = ExecutedToolpath {
            name: format!("run {numbers} {}", kind.word()),
            plan: None,
            kind,
            start: run[0].at,
            end: run[run.len() - 1].at,
            points: run
                .iter()
                .map(|p| ExecutedPoint {
                    at: p.at,
                    position: Point::from_xyz(p.position),
                })
                .collect(),
            speed: MmPerSec(if time > 0.0 { way / time } else { 0.0 }),
            deviation: None,
        };
        reports.push(ToolpathReport {
            id: None,
            name: toolpath.name.clone(),
            workingstep: 0,
            kind: kind.word(),
            samples: run.len() as u64,
            dev_max_mm: None,
            dev_p95_mm: None,
            speed_mm_s: toolpath.speed.0,
        });
        toolpaths.push(toolpath);
    }
    let worktime = Seconds(
        toolpaths
            .iter()
            .filter(|t| t.kind == PathKind::Feed)
            .map(|t| t.end.since(t.start).0)
            .sum(),
    );
    let (feed_runs, rapid_runs) = runs_of(toolpaths.iter().map(|t| t.kind));
    let (start, end) = (
        points.first().map_or(Timestamp(0), |p| p.at),
        points.last().map_or(Timestamp(0), |p| p.at),
    );
    let (tolerance, tolerance_source) = tolerance_of(None, options);
    let lines = toolpaths
        .iter()
        .map(|t| PlotLine {
            kind: t.kind.word(),
            points: t.points.iter().map(|p| p.position.xyz).collect::<Vec<V3>>(),
        })
        .collect();
    let speeds = spots
        .windows(2)
        .map(|w| [w[1].time, crate::labels::speed(&w[0], &w[1])])
        .collect();
    let name = "recorded path".to_owned();
    let workingstep = WorkingstepReport {
        name: name.clone(),
        id: None,
        executed: true,
        time_planned_s: None,
        time_real_s: Some(end.since(start).0),
        dev_max_mm: None,
        dev_p95_mm: None,
        dev_rms_mm: None,
        samples: 0,
        offsets: String::new(),
        tolerance_mm: tolerance.0,
        tolerance_source,
        verdict: Verdict::NotJudged,
        worst: None,
        shift: None,
        feed_ratio: None,
        plot: Plot {
            plan: Vec::new(),
            executed: thin(lines, options.most_plot_points),
            deviation: Vec::new(),
            speed: peaks(speeds, options.most_plot_points),
        },
    };
    let report = Report {
        name: options.name.clone(),
        program: String::new(),
        source: record.source.clone(),
        simulated: record.simulated,
        start_ns: start.0,
        end_ns: end.0,
        samples: points.len() as u64,
        unmatched: 0,
        feed_runs,
        rapid_runs,
        verdict: Verdict::NotJudged,
        tolerance_mm: tolerance.0,
        tolerance_source,
        workingsteps: vec![workingstep],
        toolpaths: reports,
        settings: Settings {
            matching: "by speed",
            frame: if record.frame == RecordFrame::Machine {
                "machine"
            } else {
                "setup"
            },
            frame_quality: if record.frame == RecordFrame::Unknown {
                "assumed"
            } else {
                "stated"
            },
            shift_mm: None,
            interval_s: usual,
            noise_mm: noise_of(&spots),
            threshold_mm_s: found.threshold,
            separation: Some(found.separation),
        },
        findings,
    };
    let executed = AsExecuted {
        name: options.name.clone(),
        source: record.source.clone(),
        simulated: record.simulated,
        start,
        end,
        worktime,
        exception: None,
        plan: None,
        workingsteps: if toolpaths.is_empty() {
            Vec::new()
        } else {
            vec![ExecutedWorkingstep {
                name,
                plan: None,
                within: Vec::new(),
                start,
                end,
                worktime,
                planned: None,
                exception: None,
                tool: None,
                deviation: None,
                toolpaths,
                results: Vec::new(),
            }]
        },
    };
    Rebuild { executed, report }
}

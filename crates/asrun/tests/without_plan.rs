//! Feed and rapid by speed alone.
#![allow(clippy::disallowed_methods, reason = "sample recordings are read from the shared folder")]

mod simulator;

use asrun::{Options, RecordFrame, RecordPoint, Recording, rebuild};
use plan::executed::PathKind;
use simulator::{Dice, Sampling, Score, kinds_of, part, run, sample};
use units::{StepId, Timestamp};

fn moldy() -> Option<Recording> {
    let path = format!(
        "{}/../../../shared/samples/mtconnect/moldy_100ms.xml",
        env!("CARGO_MANIFEST_DIR")
    );
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: {path} is not here");
        return None;
    };
    let track = mtconnect::read(&bytes, "moldy_100ms.xml", &mtconnect::ReadOptions::default()).track;
    Some(Recording {
        points: track
            .points
            .iter()
            .map(|p| RecordPoint {
                at: p.at,
                position: p.position,
                step: StepId::NONE,
                sequence: p.sequence,
            })
            .collect(),
        frame: RecordFrame::Setup,
        source: track.source,
        simulated: false,
        gaps: Vec::new(),
        events: Vec::new(),
    })
}

#[test]
fn the_recorded_mill_has_33_feed_runs_and_34_rapid_runs() {
    let Some(record) = moldy() else { return };
    let result = rebuild(None, &record, &Options::default());
    assert_eq!(
        (result.report.feed_runs, result.report.rapid_runs),
        (33, 34),
        "{:?}",
        result.report.findings
    );
    let threshold = result.report.settings.threshold_mm_s.expect("two classes");
    assert!((7.0..25.0).contains(&threshold), "{threshold}");
    assert!(result.report.settings.separation.expect("two classes") > 0.9);
    println!("{:?}", result.report.findings);
}

#[test]
fn units_and_clock_change_nothing() {
    let Some(record) = moldy() else { return };
    let runs = |record: &Recording| -> Vec<(PathKind, usize)> {
        let result = rebuild(None, record, &Options::default());
        result.executed.workingsteps[0]
            .toolpaths
            .iter()
            .map(|t| (t.kind, t.points.len()))
            .collect()
    };
    let plain = runs(&record);
    for scale in [25.4, 1.0 / 25.4, 1000.0] {
        let mut scaled = record.clone();
        for point in &mut scaled.points {
            point.position = point.position.map(|c| c * scale);
        }
        assert_eq!(runs(&scaled), plain, "positions times {scale}");
    }
    for slow in [2, 10] {
        let mut slowed = record.clone();
        let start = slowed.points[0].at.0;
        for point in &mut slowed.points {
            point.at = Timestamp(start + (point.at.0 - start) * slow);
        }
        assert_eq!(runs(&slowed), plain, "time times {slow}");
    }
}

#[track_caller]
fn check(ratio: f64, milliseconds: f64, least: f64) {
    let mut feed = Score::default();
    for seed in 0..6 {
        let mut dice = Dice(seed);
        let script = part(&mut dice);
        let truth = run(&script, ratio);
        let sampling = Sampling {
            milliseconds,
            jitter: 0.3,
            noise: 0.001,
            frame: RecordFrame::Machine,
            with_steps: false,
        };
        let (record, from) = sample(&truth, &sampling, &mut dice);
        let result = rebuild(None, &record, &Options::default());
        let kinds = kinds_of(&result.executed);
        for (point, at) in record.points.iter().zip(&from) {
            let said = kinds.get(&point.at.0).copied();
            feed.add(truth[*at].kind == Some(PathKind::Feed), said == Some(PathKind::Feed));
        }
        println!("seed {seed} {milliseconds} ms: {:?}", result.report.findings[0]);
    }
    println!("{milliseconds} ms ratio {ratio}: feed F1 {:.4} {feed:?}", feed.f1());
    assert!(
        feed.f1() >= least,
        "{} at {milliseconds} ms, feed times {ratio}: {feed:?}",
        feed.f1()
    );
}

#[test]
fn known_feeds_and_rapids_are_told_apart_at_every_sampling() {
    for milliseconds in [10.0, 50.0, 100.0, 300.0] {
        for ratio in [0.3, 1.0, 2.0] {
            check(ratio, milliseconds, 0.9);
        }
    }
}

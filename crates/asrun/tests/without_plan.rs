//! Feed and rapid by speed alone.
#![allow(clippy::disallowed_methods, reason = "sample recordings are read from the shared folder")]

mod simulator;

use asrun::{Options, RecordFrame, RecordPoint, Recording, rebuild};
use plan::executed::PathKind;
use simulator::{Dice, Sampling, Score, Script, kinds_of, part, run, sample};
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

#[test]
fn leaps_of_the_record_do_not_make_its_rapids_a_feed() {
    // Thirty parts one after the other, recorded without the way from the end of one to the beginning of the next.
    let mut script = Script::default();
    for seed in 0..30 {
        for step in part(&mut Dice(seed)).steps {
            script.push(step.kind);
        }
    }
    let sampling = Sampling {
        milliseconds: 100.0,
        jitter: 0.3,
        noise: 0.002,
        frame: RecordFrame::Machine,
        with_steps: false,
    };
    let (record, _) = sample(&run(&script, 1.0), &sampling, &mut Dice(1));
    let report = rebuild(None, &record, &Options::default()).report;
    let threshold = report.settings.threshold_mm_s.expect("two classes");
    assert!((20.0..80.0).contains(&threshold), "{threshold}");
}

#[test]
fn a_record_of_one_feed_has_no_rapids() {
    let mut script = Script::default();
    script.line([50.0, 0.0, 0.0], Some(10.0));
    script.line([50.0, 30.0, 0.0], Some(10.0));
    script.circle([40.0, 30.0], 10.0);
    script.line([0.0, 30.0, 0.0], Some(10.0));
    for milliseconds in [10.0, 100.0] {
        let sampling = Sampling {
            milliseconds,
            jitter: 0.3,
            noise: 0.001,
            frame: RecordFrame::Machine,
            with_steps: false,
        };
        let (record, _) = sample(&run(&script, 1.0), &sampling, &mut Dice(1));
        let report = rebuild(None, &record, &Options::default()).report;
        assert_eq!((report.feed_runs, report.rapid_runs), (1, 0), "{:?}", report.findings);
    }
}

#[test]
fn a_slow_and_a_fast_feed_are_both_feed() {
    let mut script = Script::default();
    script.line([0.0, -60.0, 30.0], None);
    for k in 0..8 {
        let y = f64::from(k) * 5.0;
        script.line([0.0, y, 2.0], None);
        script.line([0.0, y, -1.0], Some(2.0));
        script.line([80.0, y, -1.0], Some(20.0));
        script.line([80.0, y, 30.0], None);
    }
    for milliseconds in [10.0, 100.0] {
        let sampling = Sampling {
            milliseconds,
            jitter: 0.3,
            noise: 0.001,
            frame: RecordFrame::Machine,
            with_steps: false,
        };
        let (record, _) = sample(&run(&script, 1.0), &sampling, &mut Dice(1));
        let report = rebuild(None, &record, &Options::default()).report;
        assert_eq!(
            (report.feed_runs, report.rapid_runs),
            (8, 9),
            "{milliseconds} ms: {:?}",
            report.findings
        );
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
    // Least F1 of feed. Coarse sampling of fast feeds leaves less to tell by: a feed of the test part then lasts one or two samples.
    for (milliseconds, least) in [
        (10.0, [0.999, 0.997, 0.99]),
        (50.0, [0.998, 0.99, 0.96]),
        (100.0, [0.996, 0.99, 0.97]),
        (300.0, [0.99, 0.965, 0.92]),
    ] {
        for (ratio, least) in [0.3, 1.0, 2.0].into_iter().zip(least) {
            check(ratio, milliseconds, least);
        }
    }
}

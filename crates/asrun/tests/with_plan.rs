//! Records of a simulated machine, matched with their plan.

mod simulator;

use asrun::{Options, PlannedProgram, RecordFrame, RecordPoint, Recording, Report, Verdict, compare, rebuild};
use plan::executed::PathKind;
use plan::{Level, StepKind};
use proptest::prelude::*;
use simulator::{Dice, Sampling, Score, Script, Truth, kinds_of, part, run, run_with, sample};
use std::collections::BTreeMap;
use units::{StepId, Timestamp};

const MACHINE_100: Sampling = Sampling {
    milliseconds: 100.0,
    jitter: 0.3,
    noise: 0.002,
    frame: RecordFrame::Machine,
    with_steps: false,
};

fn f1(sampling: Sampling, seeds: u64, ratio: f64, acceleration: f64, spoil: fn(&mut Vec<Truth>)) -> (f64, f64) {
    let (mut feed, mut rapid) = (Score::default(), Score::default());
    for seed in 0..seeds {
        let mut dice = Dice(seed);
        let script = part(&mut dice);
        let mut truth = run_with(&script, ratio, acceleration);
        spoil(&mut truth);
        let (record, from) = sample(&truth, &sampling, &mut dice);
        let result = rebuild(Some(&script.plan()), &record, &Options::default());
        let kinds = kinds_of(&result.executed);
        for (point, at) in record.points.iter().zip(&from) {
            let (said, real) = (kinds.get(&point.at.0).copied(), truth[*at].kind);
            feed.add(real == Some(PathKind::Feed), said == Some(PathKind::Feed));
            rapid.add(real == Some(PathKind::Rapid), said == Some(PathKind::Rapid));
        }
    }
    println!(
        "{} ms {:?}, feed x {ratio}, {acceleration} mm/s2: feed F1 {:.5} {feed:?}, rapid F1 {:.5} {rapid:?}",
        sampling.milliseconds,
        sampling.frame,
        feed.f1(),
        rapid.f1()
    );
    (feed.f1(), rapid.f1())
}

#[track_caller]
fn check_f1(sampling: Sampling, ratio: f64, acceleration: f64) {
    let (feed, rapid) = f1(sampling, 8, ratio, acceleration, |_| {});
    assert!(feed >= 0.995, "feed F1 {feed}");
    assert!(rapid >= 0.98, "rapid F1 {rapid}");
}

#[test]
fn feed_and_rapid_are_right_at_every_sampling() {
    for milliseconds in [10.0, 50.0, 100.0, 300.0] {
        check_f1(
            Sampling {
                milliseconds,
                ..MACHINE_100
            },
            1.0,
            3000.0,
        );
    }
}

#[test]
fn standing_at_the_beginning_and_after_the_end_is_on_no_toolpath() {
    let script = the_part();
    let mut truth = run(&script, 1.0);
    let (first, last) = (truth[0], truth[truth.len() - 1]);
    truth.splice(0..0, vec![Truth { kind: None, ..first }; 3000]);
    truth.extend(vec![Truth { kind: None, ..last }; 3000]);
    let (record, from) = sample(&truth, &MACHINE_100, &mut Dice(2));
    let result = rebuild(Some(&script.plan()), &record, &Options::default());
    let kinds = kinds_of(&result.executed);
    let wrong = record
        .points
        .iter()
        .zip(&from)
        .filter(|(p, at)| kinds.get(&p.at.0).copied() != truth[**at].kind)
        .count();
    assert!(wrong <= 3, "{wrong}");
    assert_eq!(result.report.verdict, Verdict::Good);
}

#[test]
fn feed_override_and_another_acceleration_do_no_harm() {
    for ratio in [0.4, 1.5] {
        check_f1(MACHINE_100, ratio, 3000.0);
    }
    for acceleration in [800.0, 8000.0] {
        check_f1(MACHINE_100, 1.0, acceleration);
    }
}

#[test]
fn a_shift_of_all_set_ups_a_lagging_servo_and_blended_corners_keep_feed_and_rapid_apart() {
    let shifted = |truth: &mut Vec<Truth>| {
        for t in truth {
            t.gauge = [t.gauge[0] + 0.3, t.gauge[1] - 0.2, t.gauge[2]];
        }
    };
    // The step runs ahead of the axes by 5 ms.
    let lagging = |truth: &mut Vec<Truth>| {
        for k in (5..truth.len()).rev() {
            truth[k].gauge = truth[k - 5].gauge;
        }
    };
    // Corners rounded by a mean over 21 ms.
    let blended = |truth: &mut Vec<Truth>| {
        let sharp: Vec<[f64; 3]> = truth.iter().map(|t| t.gauge).collect();
        for (k, around) in sharp.windows(21).enumerate() {
            truth[k + 10].gauge = std::array::from_fn(|axis| around.iter().map(|p| p[axis]).sum::<f64>() / 21.0);
        }
    };
    for (spoil, least_rapid) in [(shifted as fn(&mut Vec<Truth>), 0.99), (lagging, 0.98), (blended, 0.985)] {
        let (feed, rapid) = f1(MACHINE_100, 6, 1.0, 3000.0, spoil);
        assert!(feed >= 0.995 && rapid >= least_rapid, "feed F1 {feed}, rapid F1 {rapid}");
    }
}

#[test]
fn records_in_the_set_ups_own_frame_match_as_well() {
    check_f1(
        Sampling {
            frame: RecordFrame::Setup,
            ..MACHINE_100
        },
        1.0,
        3000.0,
    );
}

/// A record of a part run by a machine that may differ from the plan.
fn record_of(plan: &Script, machine: &Script, sampling: &Sampling) -> (PlannedProgram, Recording) {
    let (record, _) = sample(&run(machine, 1.0), sampling, &mut Dice(7));
    (plan.plan(), record)
}

fn the_part() -> Script {
    part(&mut Dice(3))
}

/// The part with the second set-up moved on the machine.
fn shifted(by: [f64; 3]) -> Script {
    let mut script = the_part();
    for step in &mut script.steps {
        if let StepKind::Frame(frame) = &mut step.kind
            && frame.name == "G55"
        {
            for (origin, by) in frame.machine_from_setup.origin.iter_mut().zip(by) {
                *origin += by;
            }
        }
    }
    script
}

#[track_caller]
fn has(report: &Report, words: &[&str]) {
    assert!(
        report.findings.iter().any(|f| words.iter().all(|w| f.contains(w))),
        "no finding has {words:?}:\n{}",
        report.findings.join("\n")
    );
}

fn named<'a>(report: &'a Report, name: &str) -> &'a asrun::WorkingstepReport {
    report
        .workingsteps
        .iter()
        .find(|w| w.name == name)
        .expect("a workingstep of that name")
}

#[test]
fn a_good_run_is_good_and_complete() {
    for with_steps in [true, false] {
        let (plan, record) = record_of(
            &the_part(),
            &the_part(),
            &Sampling {
                with_steps,
                ..MACHINE_100
            },
        );
        let report = rebuild(Some(&plan), &record, &Options::default()).report;
        assert_eq!(report.verdict, Verdict::Good, "{:?}", report.findings);
        assert_eq!(report.unmatched, 0, "{:?}", report.findings);
        assert_eq!(report.workingsteps.len(), 3);
        for workingstep in &report.workingsteps {
            assert!(workingstep.dev_p95_mm.expect("judged") < 0.006, "{}", workingstep.name);
            assert!(workingstep.shift.is_none());
        }
        assert!(report.findings.is_empty(), "{:?}", report.findings);
    }
}

#[test]
fn a_shifted_set_up_is_found_and_named_within_5_micrometres() {
    let by = [0.12, -0.05, 0.03];
    for with_steps in [true, false] {
        let (plan, record) = record_of(
            &the_part(),
            &shifted(by),
            &Sampling {
                with_steps,
                ..MACHINE_100
            },
        );
        let report = rebuild(Some(&plan), &record, &Options::default()).report;
        assert_eq!(report.verdict, Verdict::OutOfTolerance);
        assert_eq!(named(&report, "face").verdict, Verdict::Good);
        let pocket = named(&report, "pocket");
        assert_eq!(pocket.verdict, Verdict::OutOfTolerance);
        let shift = pocket.shift.as_ref().expect("a shift explains it");
        for (found, real) in shift.vector_mm.iter().zip(by) {
            assert!((found - real).abs() < 0.005, "{:?}", shift.vector_mm);
        }
        assert!(shift.p95_after_mm < 0.01, "{shift:?}");
        has(&report, &["workingstep 'pocket'", "a shift of X +0.1", "explains"]);
    }
}

#[test]
fn the_machines_own_frame_is_compared_with_the_plans() {
    let machine = shifted([0.12, 0.0, 0.0]);
    let (plan, mut record) = record_of(
        &the_part(),
        &machine,
        &Sampling {
            with_steps: true,
            ..MACHINE_100
        },
    );
    for step in &machine.steps {
        if let StepKind::Frame(frame) = &step.kind {
            let detail: BTreeMap<String, serde_json::Value> = serde_json::from_value(serde_json::json!({
                "name": frame.name, "origin": frame.machine_from_setup.origin, "rotation": frame.machine_from_setup.rotation,
                "assumed": false, "step": step.id.0,
            }))
            .expect("an object");
            record.events.push(
                asrun::InForce::from_event("frame", &detail, Timestamp(0))
                    .expect("a frame")
                    .expect("whole"),
            );
        }
    }
    let report = rebuild(Some(&plan), &record, &Options::default()).report;
    has(
        &report,
        &["set-up G55 of workingstep 'pocket' was 0.120 mm off in X", "on the machine"],
    );
    assert!(
        !report.findings.iter().any(|f| f.contains("set-up G54")),
        "{:?}",
        report.findings
    );
}

#[test]
fn offsets_in_force_are_taken_out_and_named() {
    // The machine runs with another wear than the plan knew; its events say so.
    let mut machine = the_part();
    for step in &mut machine.steps {
        if let StepKind::ToolOffset(offset) = &mut step.kind
            && offset.number == 3
        {
            offset.wear.xyz[2] = 0.25;
        }
    }
    let (plan, mut record) = record_of(
        &the_part(),
        &machine,
        &Sampling {
            with_steps: true,
            ..MACHINE_100
        },
    );
    let untold = rebuild(Some(&plan), &record, &Options::default()).report;
    assert!(named(&untold, "pocket").dev_max_mm.expect("judged") > 0.2);
    assert!(named(&untold, "pocket").offsets.contains("by the plan"));
    for step in &machine.steps {
        if let StepKind::ToolOffset(offset) = &step.kind {
            record.events.push(asrun::InForce {
                at: Timestamp(0),
                step: step.id,
                setting: asrun::Setting::ToolOffset(*offset),
            });
        }
    }
    let report = rebuild(Some(&plan), &record, &Options::default()).report;
    assert_eq!(report.verdict, Verdict::Good);
    assert_eq!(
        named(&report, "pocket").offsets,
        "G55, offset 3 geometry Z 95.000 wear Z 0.250 mm"
    );
}

/// A run with the truth of some steps left out or put in again.
fn cut(truth: &[Truth], script: &Script, name: &str) -> (usize, usize) {
    let begin = script
        .steps
        .iter()
        .position(|s| matches!(&s.kind, StepKind::Begin(m) if m.name == name))
        .expect("there");
    let end = begin
        + script.steps[begin..]
            .iter()
            .position(|s| s.kind == StepKind::End(Level::Workingstep))
            .expect("closed");
    let (first, last) = (script.steps[begin].id, script.steps[end].id);
    let from = truth.iter().position(|t| t.step > first).expect("run");
    let to = truth.iter().position(|t| t.step > last).unwrap_or(truth.len());
    (from, to)
}

#[test]
fn a_workingstep_that_was_not_executed_is_named() {
    for with_steps in [true, false] {
        let script = the_part();
        let mut truth = run(&script, 1.0);
        let (from, to) = cut(&truth, &script, "holes");
        truth.drain(from..to);
        let (record, _) = sample(
            &truth,
            &Sampling {
                with_steps,
                ..MACHINE_100
            },
            &mut Dice(1),
        );
        let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
        assert_eq!(report.verdict, Verdict::Incomplete, "{:?}", report.findings);
        has(&report, &["workingstep 'holes' was not executed"]);
        assert!(!named(&report, "holes").executed);
        assert!(named(&report, "pocket").dev_p95_mm.expect("judged") < 0.006);
    }
}

#[test]
fn a_workingstep_that_was_run_twice_is_named() {
    for with_steps in [true, false] {
        let script = the_part();
        let mut truth = run(&script, 1.0);
        let (from, to) = cut(&truth, &script, "holes");
        let again: Vec<Truth> = truth[from..to].to_vec();
        truth.splice(to..to, again);
        let (record, _) = sample(
            &truth,
            &Sampling {
                with_steps,
                ..MACHINE_100
            },
            &mut Dice(1),
        );
        let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
        has(&report, &["workingstep 'holes' was begun twice"]);
        assert_eq!(report.workingsteps.iter().filter(|w| w.name == "holes").count(), 2);
        assert_eq!(report.verdict, Verdict::Good, "{:?}", report.findings);
    }
}

#[test]
fn a_slow_run_shows_its_feed() {
    let script = the_part();
    let (record, _) = sample(&run(&script, 0.5), &MACHINE_100, &mut Dice(1));
    let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
    has(&report, &["workingstep 'face' ran at 50 % of the planned feed"]);
    assert_eq!(report.verdict, Verdict::Good);
}

#[test]
fn a_bad_start_and_a_missing_end_are_told_and_harm_nothing_else() {
    let script = the_part();
    let truth = run(&script, 1.0);
    let (from, _) = cut(&truth, &script, "pocket");
    let (mut record, _) = sample(&truth[..from + 12_000], &MACHINE_100, &mut Dice(1));
    // Retracts and a wait of hours before the program began, as in the published recording.
    let start = record.points[0].at.0;
    let bad: Vec<RecordPoint> = (0..9)
        .map(|k| RecordPoint {
            at: Timestamp(start - 9_815_000_000_000 + k * 307_000_000),
            position: [-355.578, -54.624, 115.682 + k as f64 * 100.0],
            step: StepId::NONE,
            sequence: 0,
        })
        .collect();
    record.points.splice(0..0, bad);
    for (k, point) in record.points.iter_mut().enumerate() {
        point.sequence = k as u64 + 1;
    }
    let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
    assert_eq!(report.unmatched, 9, "{:?}", report.findings);
    has(&report, &["9 of", "lie nowhere on the plan", "9 of them before"]);
    has(&report, &["workingstep 'pocket' has no sample on"]);
    assert_eq!(report.verdict, Verdict::Incomplete);
    assert!(
        report
            .workingsteps
            .iter()
            .filter(|w| w.executed)
            .all(|w| w.verdict == Verdict::Good)
    );
}

#[test]
fn an_unknown_frame_is_fitted_and_marked_estimated() {
    for frame in [RecordFrame::Machine, RecordFrame::Setup] {
        let (plan, mut record) = record_of(&the_part(), &the_part(), &Sampling { frame, ..MACHINE_100 });
        let by = [37.5, -12.25, 8.125];
        for point in &mut record.points {
            for (c, by) in point.position.iter_mut().zip(by) {
                *c -= by;
            }
        }
        record.frame = RecordFrame::Unknown;
        let report = rebuild(Some(&plan), &record, &Options::default()).report;
        assert_eq!(report.settings.frame_quality, "estimated");
        let shift = report.settings.shift_mm.expect("fitted");
        for (found, real) in shift.iter().zip(by) {
            assert!((found - real).abs() < 0.005, "{frame:?}: {shift:?}");
        }
        has(&report, &["does not state its frame", "estimated"]);
        assert_eq!(report.verdict, Verdict::Good, "{:?}", report.findings);
    }
}

#[test]
fn a_scrambled_record_gives_the_same_result() {
    let (plan, record) = record_of(&the_part(), &the_part(), &MACHINE_100);
    let sorted = rebuild(Some(&plan), &record, &Options::default());
    let mut scrambled = record.clone();
    let mut dice = Dice(9);
    for k in (1..scrambled.points.len()).rev() {
        let other = (dice.bits() % (k as u64 + 1)) as usize;
        scrambled.points.swap(k, other);
    }
    let result = rebuild(Some(&plan), &scrambled, &Options::default());
    assert_eq!(result.executed, sorted.executed);
    has(&result.report, &["were not in the order of their sequence numbers"]);
}

#[test]
fn toolpaths_begin_and_end_within_one_sample_of_the_truth() {
    let script = the_part();
    let plan = script.plan();
    let truth = run(&script, 1.0);
    let (record, _) = sample(&truth, &MACHINE_100, &mut Dice(5));
    let result = rebuild(Some(&plan), &record, &Options::default());
    let start = 1_700_000_000_000_000_000i64;
    let mut checked = 0;
    for workingstep in &result.executed.workingsteps {
        for toolpath in &workingstep.toolpaths {
            let planned = plan
                .toolpaths
                .iter()
                .find(|p| p.name == toolpath.name && p.workingstep.is_some_and(|w| plan.workingsteps[w].name == workingstep.name))
                .expect("planned");
            let inside = |t: &Truth| t.step >= planned.steps.0 && t.step <= planned.steps.1;
            let first = truth.iter().position(inside).expect("run") as i64;
            let last = truth.iter().rposition(inside).expect("run") as i64;
            let (from, to) = ((toolpath.start.0 - start) / 1_000_000, (toolpath.end.0 - start) / 1_000_000);
            assert!(
                from >= first - 10 && from <= first + 140,
                "{}: begins at {from}, truth {first}",
                toolpath.name
            );
            assert!(
                to <= last + 10 && to >= last - 140,
                "{}: ends at {to}, truth {last}",
                toolpath.name
            );
            checked += 1;
        }
    }
    assert!(checked > 25, "{checked}");
}

#[test]
fn a_circle_turned_too_large_deviates_by_just_that() {
    let mut script = Script::default();
    script.begin(Level::Workingstep, "bore", 1);
    script.line([10.0, 0.0, 0.0], None);
    script.circle([0.0, 0.0], 5.0);
    script.end(Level::Workingstep);
    let mut truth = run(&script, 1.0);
    for t in &mut truth {
        if t.kind == Some(PathKind::Feed) {
            let out = 10.03 / 10.0;
            t.tip = [t.tip[0] * out, t.tip[1] * out, t.tip[2]];
        }
    }
    let sampling = Sampling {
        noise: 0.0,
        frame: RecordFrame::Setup,
        with_steps: true,
        ..MACHINE_100
    };
    let (record, _) = sample(&truth, &sampling, &mut Dice(1));
    let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
    let bore = named(&report, "bore");
    assert!((bore.dev_max_mm.expect("judged") - 0.03).abs() < 1e-6, "{bore:?}");
    assert!((bore.dev_rms_mm.expect("judged") - 0.03).abs() < 1e-6);
    // No shift explains a wrong size.
    assert!(bore.shift.is_none(), "{:?}", bore.shift);
    assert_eq!(bore.verdict, Verdict::Good);
    let strict = Options {
        tolerance: Some(simulator::millimetres(0.02)),
        ..Options::default()
    };
    let report = rebuild(Some(&script.plan()), &record, &strict).report;
    assert_eq!(report.verdict, Verdict::OutOfTolerance);
    assert_eq!(report.tolerance_source, asrun::ToleranceSource::Given);
    has(
        &report,
        &["workingstep 'bore' is out of tolerance: p95 0.030 mm against 0.020 mm"],
    );
}

#[test]
fn a_corner_cut_between_two_toolpaths_counts_to_the_nearer() {
    let mut script = Script::default();
    script.begin(Level::Workingstep, "corner", 1);
    script.line([0.0, 0.0, 0.0], None);
    script.line([50.0, 0.0, 0.0], Some(10.0));
    // A dwell lies between the two, as between any two toolpaths it may.
    script.push(StepKind::Dwell(units::Seconds(0.2)));
    script.line([50.0, 50.0, 0.0], Some(10.0));
    script.end(Level::Workingstep);
    let plan = script.plan();
    let first = plan.segments.iter().find(|s| s.speed.0 == 10.0).expect("a feed").step;
    // The machine is on the second leg already, the step is still the first.
    let points = [[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [49.9, 0.0, 0.0], [50.0, 3.0, 0.0]];
    let record = Recording {
        points: points
            .iter()
            .enumerate()
            .map(|(k, p)| RecordPoint {
                at: Timestamp(k as i64 * 100_000_000),
                position: *p,
                step: first,
                sequence: k as u64,
            })
            .collect(),
        frame: RecordFrame::Setup,
        source: String::new(),
        simulated: false,
        gaps: Vec::new(),
        events: Vec::new(),
    };
    let report = rebuild(Some(&plan), &record, &Options::default()).report;
    assert!(named(&report, "corner").dev_max_mm.expect("judged") < 1e-9);
}

#[test]
fn comparing_the_rebuilt_run_gives_the_numbers_of_the_rebuild() {
    let (plan, record) = record_of(
        &the_part(),
        &shifted([0.12, 0.0, 0.0]),
        &Sampling {
            with_steps: true,
            ..MACHINE_100
        },
    );
    let result = rebuild(Some(&plan), &record, &Options::default());
    let report = compare(&plan, &result.executed, &Options::default());
    assert_eq!(report.verdict, result.report.verdict);
    for (a, b) in report.workingsteps.iter().zip(&result.report.workingsteps) {
        assert_eq!(
            (&a.name, a.dev_max_mm, a.dev_p95_mm, a.dev_rms_mm),
            (&b.name, b.dev_max_mm, b.dev_p95_mm, b.dev_rms_mm)
        );
    }
    assert_eq!(
        (report.feed_runs, report.rapid_runs),
        (result.report.feed_runs, result.report.rapid_runs)
    );
}

#[test]
fn a_run_that_names_no_plan_is_compared_by_position() {
    let (plan, record) = record_of(&the_part(), &the_part(), &MACHINE_100);
    let mut executed = rebuild(Some(&plan), &record, &Options::default()).executed;
    for workingstep in &mut executed.workingsteps {
        workingstep.name = "unnamed".into();
        workingstep.plan = None;
        for toolpath in &mut workingstep.toolpaths {
            toolpath.name.clear();
        }
    }
    let report = compare(&plan, &executed, &Options::default());
    has(&report, &["matched by position and time"]);
    assert_eq!(report.verdict, Verdict::Good, "{:?}", report.findings);
    assert_eq!(report.workingsteps.len(), 3);
}

#[test]
fn frozen_positions_are_named_as_stale_data() {
    let script = the_part();
    let (mut record, from) = sample(
        &run(&script, 1.0),
        &Sampling {
            noise: 0.0,
            ..MACHINE_100
        },
        &mut Dice(1),
    );
    let truth = run(&script, 1.0);
    let begin = (0..from.len())
        .find(|k| truth[from[*k]].kind == Some(PathKind::Feed) && truth[from[*k + 14]].step == truth[from[*k]].step)
        .expect("a long feed");
    let held = record.points[begin].position;
    for point in &mut record.points[begin..begin + 10] {
        point.position = held;
    }
    let report = rebuild(Some(&script.plan()), &record, &Options::default()).report;
    has(&report, &["stale data"]);
}

#[test]
fn an_empty_record_and_an_empty_plan_are_not_judged() {
    let (plan, mut record) = record_of(&the_part(), &the_part(), &MACHINE_100);
    let empty = Script::default().plan();
    let report = rebuild(Some(&empty), &record, &Options::default()).report;
    assert_eq!((report.verdict, report.unmatched), (Verdict::NotJudged, report.samples));
    record.points.clear();
    for plan in [Some(&plan), Some(&empty), None] {
        let result = rebuild(plan, &record, &Options::default());
        assert_eq!(result.report.verdict, Verdict::NotJudged);
        assert!(result.executed.workingsteps.is_empty());
        serde_json::to_string(&result.report).expect("a report is JSON");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_record_breaks_the_rebuild(
        rows in prop::collection::vec((any::<i64>(), prop::array::uniform3(prop_oneof![-400.0..400.0f64, any::<f64>()]), 0u32..100, any::<u64>()), 0..40),
        frame in 0usize..3,
        quiet in any::<bool>(),
    ) {
        let record = Recording {
            points: rows.iter().map(|(at, position, step, sequence)| RecordPoint {
                at: Timestamp(*at),
                position: *position,
                step: if quiet { StepId::NONE } else { StepId(*step) },
                sequence: *sequence,
            }).collect(),
            frame: [RecordFrame::Machine, RecordFrame::Setup, RecordFrame::Unknown][frame],
            source: String::new(),
            simulated: false,
            gaps: Vec::new(),
            events: Vec::new(),
        };
        let plan = the_part().plan();
        let with = rebuild(Some(&plan), &record, &Options::default());
        prop_assert!(with.report.samples <= rows.len() as u64);
        let without = rebuild(None, &record, &Options::default());
        serde_json::to_string(&(&with.report, &without.report)).expect("reports are JSON");
        compare(&plan, &with.executed, &Options::default());
    }

    #[test]
    fn any_small_shift_is_found_within_5_micrometres(x in -0.4..0.4f64, y in -0.4..0.4f64, z in -0.4..0.4f64, seed in 0u64..1000) {
        prop_assume!((x * x + y * y + z * z).sqrt() > 0.02);
        let (record, _) = sample(&run(&shifted([x, y, z]), 1.0), &MACHINE_100, &mut Dice(seed));
        let report = rebuild(Some(&the_part().plan()), &record, &Options::default()).report;
        let shift = named(&report, "pocket").shift.clone().expect("a shift explains it");
        for (found, real) in shift.vector_mm.iter().zip([x, y, z]) {
            prop_assert!((found - real).abs() < 0.005, "{:?} for {:?}", shift.vector_mm, [x, y, z]);
        }
    }
}

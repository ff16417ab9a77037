//! Records of a simulated machine, matched with their plan.

mod simulator;

use asrun::{Options, RecordFrame, rebuild};
use plan::executed::PathKind;
use simulator::{Dice, Sampling, Score, kinds_of, part, run, sample};

fn f1(milliseconds: f64, frame: RecordFrame, seeds: u64, ratio: f64) -> (Score, Score) {
    let (mut feed, mut rapid) = (Score::default(), Score::default());
    for seed in 0..seeds {
        let mut dice = Dice(seed);
        let script = part(&mut dice);
        let plan = script.plan();
        let truth = run(&script, ratio);
        let sampling = Sampling {
            milliseconds,
            jitter: 0.3,
            noise: 0.002,
            frame,
            with_steps: false,
        };
        let (record, from) = sample(&truth, &sampling, &mut dice);
        let result = rebuild(Some(&plan), &record, &Options::default());
        let kinds = kinds_of(&result.executed);
        for (k, (point, at)) in record.points.iter().zip(&from).enumerate() {
            let said = kinds.get(&point.at.0).copied();
            let real = truth[*at].kind;
            if std::env::var("SHOW").is_ok() && said != real {
                println!(
                    "seed {seed} sample {k} at {at}: truth {real:?} {:?} said {said:?} {:?}",
                    truth[*at].step, point.position
                );
            }
            feed.add(real == Some(PathKind::Feed), said == Some(PathKind::Feed));
            rapid.add(real == Some(PathKind::Rapid), said == Some(PathKind::Rapid));
        }
    }
    println!(
        "{milliseconds} ms {frame:?} x{ratio}: feed F1 {:.5}, rapid F1 {:.5} {feed:?} {rapid:?}",
        feed.f1(),
        rapid.f1()
    );
    (feed, rapid)
}

#[test]
fn feed_and_rapid_are_right_at_every_sampling() {
    for milliseconds in [10.0, 50.0, 100.0, 300.0] {
        let (feed, rapid) = f1(milliseconds, RecordFrame::Machine, 20, 1.0);
        assert!(
            feed.f1() >= 0.995 && rapid.f1() >= 0.9,
            "{milliseconds} ms: {} {}",
            feed.f1(),
            rapid.f1()
        );
    }
}

mod simulator;
use asrun::*;
use simulator::*;
#[test]
fn dbg() {
    let seed: u64 = std::env::var("SEED").unwrap().parse().unwrap();
    let around: usize = std::env::var("AT").unwrap().parse().unwrap();
    let ms: f64 = std::env::var("MS").unwrap().parse().unwrap();
    let mut dice = Dice(seed);
    let script = part(&mut dice);
    let plan = script.plan();
    let truth = run(&script, 1.0);
    let sampling = Sampling {
        milliseconds: ms,
        jitter: 0.3,
        noise: 0.002,
        frame: RecordFrame::Machine,
        with_steps: false,
    };
    let (record, from) = sample(&truth, &sampling, &mut dice);
    let result = rebuild(Some(&plan), &record, &Options::default());
    let kinds = kinds_of(&result.executed);
    for k in around - 4..around + 5 {
        println!(
            "{k} at {} {:?} truth {:?} {:?} said {:?}",
            from[k],
            record.points[k].position,
            truth[from[k]].step,
            truth[from[k]].kind,
            kinds.get(&record.points[k].at.0)
        );
    }
    for f in &result.report.findings {
        println!("{f}");
    }
}

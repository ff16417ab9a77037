//! What a live job has to be: the same plan, the same steps, and the same motion as from its own file.

use super::planner::{self, Steps};
use super::program::{LivePlan, write_options};
use super::protocol::{Coolant, Go, Operation, Spindle, Tool, Turn};
use cell::{CommandSource, Output};
use machine::Command;
use motion::Trajectory;
use plan::{Level, Next, ProgramStream, StepKind};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::sync::Arc;
use stepnc::{Program, StepNcStream, StreamOptions};
use store::{MachineFile, MachineKind};
use units::{Point, Timestamp};

fn plan() -> LivePlan {
    let machine = MachineFile::simulated(MachineKind::Mill);
    let tables = store::registers::tables(&machine, &Default::default()).expect("good offsets");
    let options = write_options("a job", "a test", "Maria", Timestamp(0));
    LivePlan::new(machine, tables, "G54", options).expect("G54 is there")
}

fn operation(name: &str, tool: u32, moves: Vec<Go>) -> Operation {
    Operation {
        name: name.to_owned(),
        tool: Tool {
            number: tool,
            name: String::new(),
            diameter_mm: None,
            length_mm: None,
        },
        spindle: Some(Spindle {
            rpm: 6000.0,
            direction: Turn::Cw,
        }),
        standing_spindle: false,
        coolant: Coolant::default(),
        tolerance_mm: None,
        moves,
    }
}

/// Any operations, as a generator of test parts would give them.
fn any_operations(seed: u64) -> Vec<Operation> {
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut number = |most: u64| dice.next_u64() % most;
    let mut all = Vec::new();
    for n in 0..number(6) + 1 {
        let mut moves = vec![Go::Rapid { to: [0.0, 0.0, 50.0] }];
        let mut at = [0.0, 0.0, 50.0];
        for _ in 0..number(12) + 1 {
            let place = |number: &mut dyn FnMut(u64) -> u64| {
                [number(1000) as f64 / 10.0, number(800) as f64 / 10.0, number(60) as f64 - 5.0]
            };
            let feed_mm_min = 60.0 + number(2000) as f64;
            moves.push(match number(8) {
                0 => Go::Dwell {
                    time_s: number(500) as f64 / 1000.0,
                },
                1 | 2 => {
                    at = place(&mut number);
                    Go::Rapid { to: at }
                }
                3 | 4 => {
                    let radius = 1.0 + number(100) as f64 / 10.0;
                    let centre = [at[0] + radius, at[1], at[2]];
                    let direction = if number(2) == 0 { Turn::Cw } else { Turn::Ccw };
                    at = match number(3) {
                        0 => at,
                        1 => [centre[0], centre[1] + radius, at[2]],
                        _ => [centre[0] + radius, centre[1], at[2] - 0.5],
                    };
                    Go::Arc {
                        to: at,
                        centre,
                        normal: [0.0, 0.0, 1.0],
                        direction,
                        feed_mm_min,
                    }
                }
                _ => {
                    at = place(&mut number);
                    Go::Line { to: at, feed_mm_min }
                }
            });
        }
        let mut one = operation(
            &format!("operation {}", if number(4) == 0 { 0 } else { n }),
            1 + number(3) as u32,
            moves,
        );
        one.coolant.flood = number(2) == 0;
        one.coolant.through = number(4) == 0;
        one.tolerance_mm = [None, Some(0.02), Some(0.1)][number(3) as usize];
        one.spindle = [
            None,
            one.spindle,
            Some(Spindle {
                rpm: 1200.0,
                direction: Turn::Ccw,
            }),
        ][number(3) as usize];
        one.standing_spindle = one.spindle.is_none();
        all.push(one);
    }
    all
}

#[test]
fn the_steps_of_any_live_job_are_those_of_its_own_file() {
    let from: u64 = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
    for seed in from..from + 60 {
        let mut live = plan();
        let mut given = Vec::new();
        for operation in any_operations(seed) {
            let new = live
                .add(&operation)
                .unwrap_or_else(|why| panic!("seed {seed}: {}: {why}", operation.name));
            assert!(!new.is_empty(), "seed {seed}");
            given.extend(new);
        }
        given.extend(live.finish().expect("a plan"));
        let bytes = live.file().expect("a plan").bytes.clone();
        let options = StreamOptions {
            tables: live.tables().clone(),
            ..StreamOptions::default()
        };
        let mut stream = StepNcStream::new(Arc::new(Program::read("plan.stpnc", bytes).expect("reads")), options);
        let mut n = 0;
        while let Next::Step(step) = stream.next(None) {
            let mine = &given[n];
            assert_eq!(mine.id, step.id, "seed {seed}");
            match (&mine.kind, &step.kind) {
                // The instances of what encloses the operations are known when the last one is there.
                (StepKind::Begin(mine), StepKind::Begin(step)) if mine.level <= Level::Workplan => {
                    assert_eq!(
                        (mine.level, &mine.name, mine.entity),
                        (step.level, &step.name, None),
                        "seed {seed}"
                    );
                }
                (StepKind::Begin(_) | StepKind::End(Level::Workingstep) | StepKind::Move(_), _) => {
                    assert_eq!(
                        (&mine.kind, mine.origin),
                        (&step.kind, step.origin),
                        "seed {seed}, {}",
                        step.id
                    );
                }
                _ => assert_eq!(mine.kind, step.kind, "seed {seed}, {}", step.id),
            }
            n += 1;
        }
        assert_eq!(n, given.len(), "seed {seed}");
    }
}

fn set_points(source: &mut dyn FnMut() -> Output) -> Vec<[f64; 3]> {
    let mut all = Vec::new();
    loop {
        match source() {
            Output::Command(Command::SetPoint(point)) => all.push(point.position),
            Output::End => return all,
            Output::Alarm(alarm) => panic!("{alarm}"),
            Output::Ask(question) => panic!("{question:?}"),
            _ => {}
        }
    }
}

#[test]
fn what_is_planned_while_operations_come_goes_where_the_file_goes() {
    let machine = MachineFile::simulated(MachineKind::Mill);
    for seed in 0..10 {
        let (mut live, steps) = (plan(), Steps::default());
        let limits = crate::shop::limits(&machine);
        let mut source = planner::begin(&steps, Point::ORIGIN, limits);
        let mut ends = Vec::new();
        for operation in any_operations(seed) {
            let new = live.add(&operation).expect("a good operation");
            steps.give(new);
            // Everything of it is planned to its end before the next one comes.
            let mut last: Option<machine::SetPoint> = None;
            let mut idle = 0;
            // A window that is being planned may take its time; one that never comes to rest is what the next lines find.
            while idle < 20 || (idle < 5000 && last.is_some_and(|last| last.velocity != [0.0; 3])) {
                if source.is_ready() {
                    idle = 0;
                    if let Output::Command(Command::SetPoint(point)) = source.next(None) {
                        last = Some(point);
                    }
                } else {
                    idle += 1;
                    std::thread::sleep(std::time::Duration::from_millis(2));
                }
            }
            if let Some(last) = last {
                assert_eq!(last.velocity, [0.0; 3], "seed {seed}: it stands where nothing more is known");
                ends.push(last.position);
            }
        }
        steps.give(live.finish().expect("a plan"));
        steps.end();
        set_points(&mut || source.next(None));

        let options = StreamOptions {
            tables: live.tables().clone(),
            ..StreamOptions::default()
        };
        let program = Program::read("plan.stpnc", live.file().expect("a plan").bytes.clone()).expect("reads");
        let mut whole = Trajectory::new(Box::new(StepNcStream::new(Arc::new(program), options)), Point::ORIGIN, limits);
        let points = set_points(&mut || whole.next(None));
        for end in ends {
            let near = points
                .iter()
                .map(|p| (0..3).map(|k| (p[k] - end[k]).powi(2)).sum::<f64>())
                .fold(f64::MAX, f64::min);
            assert!(
                near.sqrt() < 0.05,
                "seed {seed}: {end:?} is {} mm beside the file's path",
                near.sqrt()
            );
        }
    }
}

#[track_caller]
fn check_refused(operation: &Operation, expected: &str) {
    let mut live = plan();
    let good = self::operation("first", 1, vec![Go::Rapid { to: [0.0, 0.0, 50.0] }]);
    live.add(&good).expect("a good one");
    let bytes = live.file().expect("a plan").bytes.clone();
    let why = live.add(operation).expect_err(expected);
    assert!(why.contains(expected), "{why}");
    assert_eq!(
        (live.operations(), &live.file().expect("a plan").bytes),
        (1, &bytes),
        "nothing has changed"
    );
    let next = self::operation("next", 1, vec![Go::Rapid { to: [1.0, 0.0, 50.0] }]);
    live.add(&next).expect("the next good one is taken");
}

#[test]
fn an_operation_that_cannot_be_done_is_refused_and_changes_nothing() {
    let line = |to, feed_mm_min| Go::Line { to, feed_mm_min };
    let bad = |moves| operation("bad", 1, moves);
    check_refused(&bad(vec![]), "1 to 1000000 moves, this one 0");
    check_refused(&operation(" ", 1, vec![line([0.0; 3], 1.0)]), "needs a name");
    check_refused(&bad(vec![line([0.0; 3], 0.0)]), "move 1: a feed of 0 mm/min");
    check_refused(
        &bad(vec![line([0.0; 3], 100.0), line([5000.0, 0.0, 0.0], 100.0)]),
        "move 2: axis X would have to go to 4500.000 mm",
    );
    check_refused(&bad(vec![Go::Dwell { time_s: -1.0 }]), "a dwell of -1 s");
    check_refused(
        &bad(vec![
            Go::Dwell { time_s: 1.0 },
            Go::Rapid {
                to: [0.0, f64::NAN, 0.0],
            },
        ]),
        "would have to go to NaN mm",
    );
    let arc = |to, centre, normal| Go::Arc {
        to,
        centre,
        normal,
        direction: Turn::Cw,
        feed_mm_min: 100.0,
    };
    check_refused(
        &bad(vec![arc([10.0, 0.0, 50.0], [4.0, 0.0, 50.0], [0.0, 0.0, 1.0])]),
        "begins 4.0000 mm from its centre and ends 6.0000",
    );
    check_refused(
        &bad(vec![arc([10.0, 0.0, 50.0], [5.0, 0.0, 50.0], [0.0; 3])]),
        "the normal of an arc",
    );
    check_refused(&operation("bad", 0, vec![line([0.0; 3], 1.0)]), "tool 0 is the empty spindle");
    let mut one = bad(vec![line([0.0; 3], 100.0)]);
    one.tool.length_mm = Some(118.0);
    check_refused(&one, "tool 1 is 120 mm long on this machine, the operation says 118 mm");
    one.tool.length_mm = Some(120.0);
    one.spindle = Some(Spindle {
        rpm: 30_000.0,
        direction: Turn::Cw,
    });
    check_refused(&one, "at most 18000 are needed");
    one.spindle = None;
    check_refused(&one, "move 1 is a feed move and the spindle stands");
    one.standing_spindle = true;
    one.tolerance_mm = Some(-0.1);
    check_refused(&one, "a tolerance of -0.1 mm");
    check_refused(&bad(vec![Go::Dwell { time_s: 1e308 }]), "a dwell of");
}

#[test]
fn a_tool_that_the_machine_does_not_know_has_the_length_that_the_add_in_gives() {
    let mut live = plan();
    let mut one = operation("drill", 77, vec![Go::Rapid { to: [0.0, 0.0, 50.0] }]);
    let why = live.add(&one).expect_err("nobody knows how long it is");
    assert!(why.contains("does not know tool 77: give its length_mm"), "{why}");
    one.tool.length_mm = Some(88.5);
    live.add(&one).expect("taken");
    assert_eq!(live.tables().tools[&units::ToolNumber(77)].geometry.0.xyz[2], 88.5);
    one.tool.length_mm = Some(90.0);
    assert!(live.add(&one).expect_err("another length").contains("88.5 mm long"));
}

//! The text protocol damaged: a defined controlled stop, and what cannot be noticed is counted.
#![allow(clippy::disallowed_methods, reason = "SEED picks one random run")]

mod common;
#[path = "common/text_world.rs"]
mod text_world;

use cell::link::TextNotice;
use cell::link::channel::Damage;
use cell::source::Planned;
use common::small_program;
use machine::{Command, FaultCause, Request, SetPoint, State, StopCause, Wait};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use text_world::{TextWorld, commands};
use units::Tick;

/// A place this far from the path is a wrong one, mm.
const WRONG: f64 = 0.05;
/// As far as a place is moved that no line shows: two lines whose steps an axis can do, and the half pulse of each.
const HIDDEN: f64 = 0.005;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Cut,
    CutNoticed,
    Stall,
    Bit,
    Bytes,
    Twice,
    Missing,
    Reordered,
    SenderKilled,
    ControllerRestarted,
    LateTicks,
}
use Kind::*;

const KINDS: [Kind; 11] = [
    Cut,
    CutNoticed,
    Stall,
    Bit,
    Bytes,
    Twice,
    Missing,
    Reordered,
    SenderKilled,
    ControllerRestarted,
    LateTicks,
];

impl Kind {
    fn damage(self) -> Option<Damage> {
        match self {
            Bit => Some(Damage::Bit),
            Bytes => Some(Damage::Bytes),
            Twice => Some(Damage::Twice),
            Missing => Some(Damage::Missing),
            Reordered => Some(Damage::Swapped),
            _ => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Fault {
    kind: Kind,
    at: Tick,
    /// Late cycles, where it is those.
    late: u64,
}

/// What came of runs.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    runs: u64,
    completed: u64,
    stopped: u64,
    starved: u64,
    waits: u64,
    faults: u64,
    unnoticed: u64,
    wrong_path: u64,
    wrong_switching: u64,
    furthest: f64,
    hidden: f64,
}

impl Row {
    fn add(&mut self, other: &Row) {
        for (sum, one) in [
            (&mut self.runs, other.runs),
            (&mut self.completed, other.completed),
            (&mut self.stopped, other.stopped),
            (&mut self.starved, other.starved),
            (&mut self.waits, other.waits),
            (&mut self.faults, other.faults),
            (&mut self.unnoticed, other.unnoticed),
            (&mut self.wrong_path, other.wrong_path),
            (&mut self.wrong_switching, other.wrong_switching),
        ] {
            *sum += one;
        }
        self.furthest = self.furthest.max(other.furthest);
        self.hidden = self.hidden.max(other.hidden);
    }
}

/// The places of a plan, for asking how far another is from it.
fn distance(plan: &[SetPoint], from: &mut usize, p: [f64; 3]) -> f64 {
    let mut best = (f64::INFINITY, *from);
    let place = |n: usize| if n == 0 { [0.0; 3] } else { plan[n - 1].position };
    for n in from.saturating_sub(50)..(*from + 300).min(plan.len()) {
        let (a, b) = (place(n), place(n + 1));
        let d: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let t: [f64; 3] = std::array::from_fn(|k| p[k] - a[k]);
        let length: f64 = d.iter().map(|x| x * x).sum();
        let u = if length > 0.0 {
            (0..3).map(|k| t[k] * d[k]).sum::<f64>() / length
        } else {
            0.0
        };
        let beside = (0..3).map(|k| (t[k] - u.clamp(0.0, 1.0) * d[k]).powi(2)).sum::<f64>().sqrt();
        if beside < best.0 - 1e-9 {
            best = (beside, n);
        }
    }
    *from = best.1;
    best.0
}

/// A program with what a run without faults makes of it.
struct Bench {
    program: Planned,
    plan: Vec<SetPoint>,
    switching: Vec<Command>,
    /// A person holds the feed here, and lets it go on.
    hold: Option<[Tick; 2]>,
}

impl Bench {
    fn new(program: Planned, hold: Option<[Tick; 2]>) -> Self {
        let set_point = |c: &Command| if let Command::SetPoint(s) = c { Some(*s) } else { None };
        let plan = commands(&program).iter().filter_map(set_point).collect();
        let mut bench = Bench {
            program,
            plan,
            switching: Vec::new(),
            hold,
        };
        let mut world = TextWorld::new(&bench.program, 1, (0, 0));
        while !world.is_over() {
            bench.person(&mut world);
            world.advance();
        }
        bench.switching = world.spindle;
        bench
    }

    fn person(&self, world: &mut TextWorld) {
        let [hold, start] = self.hold.unwrap_or([Tick(u64::MAX); 2]);
        if world.now == hold {
            world.half.request(Request::Hold);
        } else if world.now == start {
            world.half.request(Request::CycleStart);
        }
    }

    /// The middle of each phase in a run without faults.
    fn phases(&self) -> BTreeMap<&'static str, Tick> {
        let mut phases: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
        let mut world = TextWorld::new(&self.program, 1, (0, 0));
        let (mut before, mut held) = (None, 0);
        while !world.is_over() {
            self.person(&mut world);
            let now = world.now.0;
            let Some(report) = world.advance() else { continue };
            let stands = before == Some(report.sample.commanded);
            before = Some(report.sample.commanded);
            if report.state == State::Held {
                held = now;
            }
            let name = match report.state {
                _ if now < 3 => "the first lines",
                State::Waiting(Wait::Tool | Wait::ToolAway) => "tool change",
                State::Waiting(Wait::Spindle) => "spindle",
                State::Holding => "slowing down to a hold",
                State::Held => "hold",
                State::Resuming => "going on",
                State::Running if held > 0 && now < held + 60 => "going on",
                State::Running if stands => "dwell",
                State::Running => "cut",
                _ => "other",
            };
            phases.entry(name).or_insert([now, now])[1] = now;
        }
        phases.into_iter().map(|(name, [a, b])| (name, Tick((a + b) / 2))).collect()
    }

    /// One run; `what` for who reads a failure.
    fn run(&self, faults: &[Fault], seed: u64, tell: bool) -> Row {
        let what = format!("seed {seed}, {faults:?}");
        let mut world = TextWorld::new(&self.program, seed, (seed % 3, seed % 7));
        let (mut place, mut furthest, mut before) = (0, 0.0f64, None);
        let mut still = 0;
        while !world.is_over() && still < 3_000 && world.now.0 < 60_000 {
            let now = world.now;
            for fault in faults.iter().filter(|fault| fault.at == now) {
                begin(&mut world, fault);
            }
            self.person(&mut world);
            let Some(report) = world.advance() else { continue };
            if before == Some(report.sample.commanded) {
                still += 1;
            } else {
                still = 0;
                // Over the start the tool is changed, and the gauge point taken back to where it was.
                let [x, y, _] = report.sample.commanded;
                if report.orders.mode == machine::DriveMode::Follow && (x, y) != (0.0, 0.0) {
                    furthest = furthest.max(distance(&self.plan, &mut place, report.sample.commanded));
                }
            }
            before = Some(report.sample.commanded);
        }
        let state = world.last.map(|r| r.state);
        let counters = world.half.controller().counters();
        assert_eq!(counters.off_path_stops, 0, "{what}: {state:?} {:?}", world.notices);
        let told = world.notices.iter().any(|n| matches!(n, TextNotice::Stopped(_)));
        let mut row = Row {
            runs: 1,
            furthest,
            ..Row::default()
        };
        match state {
            Some(State::Ready) if !told => row.completed = 1,
            Some(State::Stopped(StopCause::Starved)) => row.starved = 1,
            // And a stop asked of a machine at rest that has nothing to do.
            Some(State::Stopped(_) | State::Ready) => row.stopped = 1,
            Some(State::Waiting(Wait::Commands) | State::Held) => row.waits = 1,
            Some(State::Fault(FaultCause::Drive | FaultCause::Away { .. })) => row.faults = 1,
            other => panic!("{what}: no defined end: {other:?}, {:?}", world.notices),
        }
        // Another speed, tool or length that nobody sees moves everything after it.
        let switching = !self.switching.starts_with(&world.spindle);
        row.wrong_path = u64::from(furthest > WRONG);
        row.wrong_switching = u64::from(switching);
        row.unnoticed = u64::from((furthest > WRONG || switching) && !told);
        if tell {
            println!("{what}: {state:?}, {furthest} mm, {:?} {:?}", world.notices, world.spindle);
        }
        let drives_stopped = row.faults > 0;
        if !switching && !told && !drives_stopped {
            row.hidden = furthest;
            assert!(
                furthest <= HIDDEN,
                "{what}: {furthest} mm beside the path, and nobody said so"
            );
        }
        if faults.iter().all(|fault| fault.kind.damage().is_none()) {
            assert_eq!((row.wrong_path, row.wrong_switching), (0, 0), "{what}");
        }
        row
    }
}

fn begin(world: &mut TextWorld, fault: &Fault) {
    match fault.kind {
        Cut | CutNoticed => {
            world.way.cut();
            if let Some(connection) = world.connection.take()
                && fault.kind == CutNoticed
            {
                world.receiver.disconnected(connection);
            }
        }
        Stall => world.way.hold_until(world.now + 100),
        SenderKilled => {
            world.sender = None;
            if let Some(connection) = world.connection.take() {
                world.receiver.disconnected(connection);
            }
        }
        ControllerRestarted => {
            // It stops on the path before it ends; what comes after it speaks to nobody.
            world.half.request(Request::Stop);
            world.connection = None;
            world.sender = None;
        }
        LateTicks => world.late = fault.late,
        damaged => damaged.damage().into_iter().for_each(|damage| world.way.damage(damage)),
    }
}

fn table<K: std::fmt::Display>(first: &str, rows: &BTreeMap<K, Row>) {
    println!(
        "\n| {first} | runs | completed | stop, said why | starved on the path | waits at rest | drives' own stop | path > 0.05 mm | wrong switching | of these unnoticed | furthest, mm | furthest that nobody said, mm |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (name, r) in rows {
        println!(
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {:.4} | {:.4} |",
            r.runs,
            r.completed,
            r.stopped,
            r.starved,
            r.waits,
            r.faults,
            r.wrong_path,
            r.wrong_switching,
            r.unnoticed,
            r.furthest,
            r.hidden
        );
    }
}

#[test]
fn a_damaged_text_link_ends_in_a_defined_stop_and_what_cannot_be_noticed_is_counted() {
    let number = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<u64>().ok());
    let seeds: Vec<u64> = number("SEED").map_or_else(|| (1..=number("SEEDS").unwrap_or(100)).collect(), |seed| vec![seed]);
    let bench = Bench::new(small_program(), None);
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    for &seed in &seeds {
        let mut dice = ChaCha8Rng::seed_from_u64(seed);
        let mut up_to = |n: u64| dice.next_u64() % n;
        // One in three has a second one, most of them close behind.
        let mut at = Tick(1 + up_to(4500));
        let mut faults = Vec::new();
        for _ in 0..1 + u64::from(up_to(3) == 0) {
            faults.push(Fault {
                kind: KINDS[up_to(KINDS.len() as u64) as usize],
                at,
                late: 1 + up_to(10),
            });
            at = at + 1 + up_to(300);
        }
        let row = bench.run(&faults, seed, seeds.len() == 1);
        let mut kinds: Vec<String> = faults.iter().map(|fault| format!("{:?}", fault.kind)).collect();
        kinds.push(
            if faults.len() > 1 {
                "all of two faults"
            } else {
                "all of one fault"
            }
            .to_owned(),
        );
        kinds.dedup();
        for kind in kinds {
            rows.entry(kind).or_default().add(&row);
        }
    }
    table("text link, fault", &rows);
}

#[test]
fn any_fault_in_any_phase_of_a_text_run_is_a_defined_end() {
    let bench = Bench::new(small_program(), Some([Tick(2_500), Tick(2_700)]));
    let phases = bench.phases();
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    for phase in [
        "the first lines",
        "tool change",
        "spindle",
        "cut",
        "dwell",
        "slowing down to a hold",
        "hold",
        "going on",
    ] {
        let at = *phases.get(phase).unwrap_or_else(|| panic!("no {phase} in {phases:?}"));
        for (n, kind) in KINDS.into_iter().enumerate() {
            for late in [4, 9] {
                let fault = Fault { kind, at, late };
                let stall = Fault {
                    kind: Stall,
                    at: at + 1,
                    late,
                };
                for faults in [&[fault][..], &[stall, fault]] {
                    rows.entry(phase.to_owned())
                        .or_default()
                        .add(&bench.run(faults, n as u64 + late, false));
                }
            }
        }
    }
    table("text link, phase", &rows);
}

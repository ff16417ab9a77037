//! What conditions cost in a cycle: 4096 of three comparisons on different signals each, all frequencies, 1 % firing.
//!
//! `cargo bench -p machine --bench watch`: time of a cycle at p50, p99 and p99.9 against a tenth of the servo cycle.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a bench measures time")]

use machine::watch::{Frequency, Mode, Operation, Readings, Relation, SIGNALS, Situation, Watch, WatchOrder, Watches};
use machine::{MachineParameters, Phase, Sample};
use std::hint::black_box;
use std::time::Instant;
use units::{Tick, WorkingstepId};

const CONDITIONS: usize = 4096;
const CYCLES: u64 = 20_000;
const TRUE: usize = 61;
/// A tenth of the cycle, microseconds.
const BUDGET: f64 = 100.0;

fn main() {
    let machine = MachineParameters::small_machining_centre();
    let mut watches = Box::new(Watches::<CONDITIONS, 24_576>::new());
    let kinds = [
        Frequency::Whenever,
        Frequency::EveryEdge,
        Frequency::WhenOnce,
        Frequency::FromFirst,
        Frequency::NoKeyword,
    ];
    let signals = SIGNALS.len() as u8 - 2;
    for n in 0..CONDITIONS {
        let signal = |k: usize| ((n * 7 + k * 11) % usize::from(signals)) as u8;
        // One in 61 is true in every cycle: those of EVERY and WHEN among them fire once only, so that one in a hundred fires.
        let fires = n % TRUE == 0;
        let limit = if fires { -1e9 } else { 1e9 };
        let condition = [
            Operation::Compare(signal(0), Relation::GreaterOrEqual, -1e9 - n as f64),
            Operation::Compare(signal(1), Relation::Less, 1e9 + n as f64),
            Operation::And,
            Operation::Compare(signal(2), Relation::Greater, limit),
            Operation::And,
        ];
        // Every cycle needs no condition; few of them are among the firing ones.
        let frequency = if fires { kinds[n / TRUE % 5] } else { kinds[n % 4] };
        let operations: &[Operation] = if frequency == Frequency::NoKeyword { &[] } else { &condition };
        let number = watches.load(&Watch {
            frequency,
            all_modes: n % 2 == 0,
            condition: operations,
            alarms: &[],
        });
        watches.obey(WatchOrder::Start(number.expect("room for all")));
    }
    let mut readings = Readings::new();
    let mut times = Vec::with_capacity(CYCLES as usize);
    let (mut fired, mut operations) = (0u64, 0u64);
    for tick in 0..CYCLES {
        let wave = (tick % 997) as f64 / 10.0;
        let sample = Sample {
            tick: Tick(tick),
            phase: Phase::Running,
            workingstep: WorkingstepId(1),
            load: [wave, -wave, 2.0 * wave],
            velocity: [wave, 1.0, -wave],
            ..Sample::default()
        };
        let begin = Instant::now();
        readings.take(&sample, &machine, Situation::default());
        let verdict = watches.cycle(Tick(tick), &readings, Mode::Automatic);
        times.push(begin.elapsed().as_nanos() as f64 / 1e3);
        operations += u64::from(black_box(verdict).operations);
        while watches.firing().is_some() {
            fired += 1;
        }
    }
    times.sort_by(f64::total_cmp);
    let at = |part: f64| times[((times.len() - 1) as f64 * part) as usize];
    println!("{CONDITIONS} conditions of three comparisons, {CYCLES} cycles, signals worked out in each");
    println!(
        "{:.0} operations and {:.1} firings a cycle, {:.2} ns an operation at the median",
        operations as f64 / CYCLES as f64,
        fired as f64 / CYCLES as f64,
        at(0.5) * 1e3 / (operations as f64 / CYCLES as f64)
    );
    println!("| p50 us | p99 us | p99.9 us | budget us |\n|---|---|---|---|");
    println!("| {:.1} | {:.1} | {:.1} | {BUDGET} |", at(0.5), at(0.99), at(0.999));
}

//! What conditions cost in a cycle: 4096 of three comparisons on different signals each, all frequencies, 1 % firing.
//!
//! Twice: as conditions are, where what made one false makes it false in the next cycle too, and at the worst, where in every cycle another of
//! the three comparisons is the false one, so that all three are always looked at.
//!
//! `cargo bench -p machine --bench watch`: time of a cycle at p50, p99 and p99.9 against a tenth of the servo cycle. Beside each cycle runs
//! arithmetic of the same length that touches no memory and takes the same steps every time: what its tail is longer than its median is the
//! computer's, not the conditions'.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a bench measures time")]

use machine::watch::{Frequency, Mode, Operation, Readings, Relation, SIGNALS, Situation, Watch, WatchOrder, Watches, signal};
use machine::{MachineParameters, Phase, Sample};
use std::hint::black_box;
use std::time::Instant;
use units::{Tick, WorkingstepId};

const CONDITIONS: usize = 4096;
const CYCLES: u64 = 20_000;
const TRUE: usize = 61;
/// Steps of the arithmetic beside each cycle: about as long as one.
const STEPS: u32 = 10_000;
/// A tenth of the cycle, microseconds.
const BUDGET: f64 = 100.0;

/// What was seen of all cycles.
struct Seen {
    /// Times of a cycle, ascending, us.
    times: Vec<f64>,
    /// The same of the arithmetic beside it.
    beside: Vec<f64>,
    fired: u64,
    operations: u64,
}

/// All of them, started. Of those that never hold it is always the third comparison that is false, or, where `changing` is set, another one
/// in each cycle.
fn conditions(changing: bool) -> Box<Watches<CONDITIONS, 24_576>> {
    let mut watches = Box::new(Watches::new());
    let kinds = [
        Frequency::Whenever,
        Frequency::EveryEdge,
        Frequency::WhenOnce,
        Frequency::FromFirst,
        Frequency::NoKeyword,
    ];
    let [x, y, z] = ["X.LOAD", "Y.LOAD", "Z.LOAD"].map(|name| signal(name).expect("a signal"));
    let signals = SIGNALS.len() - 2;
    for n in 0..CONDITIONS {
        // One in 61 is true in every cycle: those of EVERY and WHEN among them fire once only, so that one in a hundred fires.
        let fires = n % TRUE == 0;
        let number = 1e9 + n as f64;
        let compared = if changing && !fires {
            // Each cycle turns another load below 0 and no other one.
            [x, y, z].map(|load| (load, Relation::Greater, -1.0 / (n + 1) as f64))
        } else {
            let signal = |k: usize| ((n * 7 + k * 11) % signals) as u8;
            let limit = if fires { -1e9 } else { 1e9 };
            [
                (signal(0), Relation::GreaterOrEqual, -number),
                (signal(1), Relation::Less, number),
                (signal(2), Relation::Greater, limit),
            ]
        };
        let [a, b, c] = compared.map(|(signal, relation, number)| Operation::Compare(signal, relation, number));
        let condition = [a, b, Operation::And, c, Operation::And];
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
    watches
}

fn measure(changing: bool) -> Seen {
    let machine = MachineParameters::small_machining_centre();
    let mut watches = conditions(changing);
    let mut readings = Readings::new();
    let (mut times, mut beside) = (Vec::with_capacity(CYCLES as usize), Vec::with_capacity(CYCLES as usize));
    let (mut fired, mut operations) = (0u64, 0u64);
    for tick in 0..CYCLES {
        let wave = (tick % 997) as f64 / 10.0;
        let load = if changing {
            std::array::from_fn(|k| if tick % 3 == k as u64 { -1e3 } else { 1e3 })
        } else {
            [wave, -wave, 2.0 * wave]
        };
        let sample = Sample {
            tick: Tick(tick),
            phase: Phase::Running,
            workingstep: WorkingstepId(1),
            load,
            velocity: [wave, 1.0, -wave],
            ..Sample::default()
        };
        let begin = Instant::now();
        readings.take(&sample, &machine, Situation::default());
        let verdict = watches.cycle(Tick(tick), &readings, Mode::Automatic);
        times.push(begin.elapsed().as_nanos() as f64 / 1e3);
        operations += u64::from(black_box(verdict).operations);
        let begin = Instant::now();
        // Each step needs the one before it.
        black_box((0..STEPS).fold(black_box(1.0f64), |x, _| x * 0.999_999 + 1e-9));
        beside.push(begin.elapsed().as_nanos() as f64 / 1e3);
        while watches.firing().is_some() {
            fired += 1;
        }
    }
    times.sort_by(f64::total_cmp);
    beside.sort_by(f64::total_cmp);
    Seen {
        times,
        beside,
        fired,
        operations,
    }
}

fn main() {
    println!("{CONDITIONS} conditions of three comparisons, {CYCLES} cycles, signals worked out in each");
    println!(
        "| conditions | operations a cycle | firings a cycle | p50 us | p99 us | p99.9 us | budget us |\n|---|---|---|---|---|---|---|"
    );
    for (what, changing) in [("as they are", false), ("at the worst", true)] {
        let seen = measure(changing);
        let a_cycle = |n: u64| n as f64 / CYCLES as f64;
        let row = |times: &[f64]| [0.5, 0.99, 0.999].map(|part| times[((times.len() - 1) as f64 * part) as usize]);
        let [p50, p99, p999] = row(&seen.times);
        let (operations, fired) = (a_cycle(seen.operations), a_cycle(seen.fired));
        println!("| {what} | {operations:.0} | {fired:.1} | {p50:.1} | {p99:.1} | {p999:.1} | {BUDGET} |");
        let [p50, p99, p999] = row(&seen.beside);
        println!("| arithmetic beside them | | | {p50:.1} | {p99:.1} | {p999:.1} | |");
    }
}

//! The realtime half cannot allocate: its sources do not name an allocator, and a counting one on the thread sees nothing.
#![allow(
    unsafe_code,
    clippy::disallowed_methods,
    reason = "an allocator is unsafe to write, and the test reads the crate's own sources"
)]

use machine::{
    Command, ControlPad, MachineParameters, Mode, Overrides, PadState, Phase, Plant, Quality, RealtimeHalf, RegisterCard,
    Registers, Request, SetPoint, SpindleCommand,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use units::{Millimetres, Point, Rpm, StepId, Tick, ToolNumber};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged; the counter neither allocates nor panics.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

#[test]
fn the_counter_counts() {
    let before = allocations();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(allocations() - before, 2);
}

#[test]
fn a_whole_run_with_stops_and_faults_allocates_nothing() {
    let parameters = MachineParameters::small_machining_centre();
    let mut half = Box::new(RealtimeHalf::new(
        &parameters,
        Plant::new(&parameters, Point::ORIGIN, 1),
        Quality::Simulated,
    ));
    let step = StepId(1);
    let mut program: Vec<Command> = vec![
        Command::Tool {
            tool: ToolNumber(1),
            step,
        },
        Command::Spindle {
            spindle: SpindleCommand::Clockwise(Rpm(6000.0)),
            step,
        },
    ];
    // X there and back as a sine: starts and ends at rest.
    let (amplitude, w) = (20.0, 5.0);
    program.extend((1..=2_513).map(|n| {
        let t = f64::from(n) * 0.001;
        Command::SetPoint(SetPoint {
            position: [amplitude * (1.0 - libm::cos(w * t)), 0.0, 0.0],
            velocity: [amplitude * w * libm::sin(w * t), 0.0, 0.0],
            acceleration: [amplitude * w * w * libm::cos(w * t), 0.0, 0.0],
            step: StepId(2),
            path_length: 0.0,
            path_speed: (amplitude * w * libm::sin(w * t)).abs(),
            ..SetPoint::default()
        })
    }));
    program.push(Command::Dwell { cycles: 20, step });
    program.push(Command::End { step });

    half.request(Request::PowerOn);
    let mut next = 0;
    let mut moved: f64 = 0.0;
    let before = allocations();
    for n in 0..12_000u64 {
        while next < program.len() && half.push(program[next]).is_ok() {
            next += 1;
        }
        match n {
            4_000 => half.request(Request::Hold),
            4_500 => half.request(Request::CycleStart),
            8_000 => half.drive_mut().set_emergency_stop(true),
            8_500 => half.drive_mut().set_emergency_stop(false),
            9_000 => half.request(Request::Reset),
            _ => {}
        }
        half.tick(Tick(n));
        while let Some(report) = half.report() {
            moved = moved.max(report.sample.actual[0]);
        }
    }
    let count = allocations() - before;
    assert_eq!(count, 0, "{count} allocations or releases in 12000 cycles");
    assert_eq!(
        (next, half.controller().counters().completed),
        (program.len(), program.len() as u64)
    );
    assert!((moved - 40.0).abs() < 0.1, "it has to have moved: {moved}");
}

/// A pad whose joystick is always somewhere else.
struct Pad;

impl ControlPad for Pad {
    fn read(&mut self, now: Tick) -> Option<PadState> {
        (now.0 % 9_000 > 100).then(|| PadState {
            selector: if (now.0 / 3_000).is_multiple_of(2) {
                Mode::Auto
            } else {
                Mode::Jog { axis: 1 }
            },
            joystick: libm::sin(now.0 as f64 * 0.002),
            feed: 90,
            emergency_stop: now.0 % 50_000 == 49_990,
            dead_man: now.0 % 700 > 50,
        })
    }
}

/// The registers of a card that counts what it is told to go.
#[derive(Default)]
struct Words([i32; 32]);

impl Registers for Words {
    fn read(&mut self, register: u16) -> i32 {
        self.0[usize::from(register)]
    }
    fn write(&mut self, register: u16, value: i32) {
        self.0[usize::from(register)] = value;
        if (16..19).contains(&register) {
            self.0[usize::from(register) - 16] += value / 65;
        }
        self.0[7] = 0b11000;
    }
}

#[test]
fn homing_jog_overrides_and_tool_changes_allocate_nothing() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.absolute_encoders = false;
    parameters.tool_change_at = Some([Millimetres(0.0), Millimetres(0.0), Millimetres(50.0)]);
    for axis in &mut parameters.axes {
        axis.homing.reference = Millimetres(90.0);
    }
    let plant = Plant::new(&parameters, Point::ORIGIN, 1);
    let mut half = Box::new(RealtimeHalf::with_pad(&parameters, plant, Pad, Quality::Simulated));
    let step = StepId(1);
    let program = [
        Command::ToolLength { length: 12.0, step },
        Command::Tool {
            tool: ToolNumber(3),
            step,
        },
        Command::Spindle {
            spindle: SpindleCommand::Clockwise(Rpm(6000.0)),
            step,
        },
        Command::Dwell { cycles: 1_000, step },
        Command::End { step },
    ];
    half.request(Request::PowerOn);
    half.request(Request::Home);
    let mut next = 0;
    let before = allocations();
    let mut phases = [false; 16];
    for n in 0..60_000u64 {
        if half.push(program[next % program.len()]).is_ok() {
            next += 1;
        }
        match n % 2_000 {
            _ if n < 30_000 => {}
            1 => half.request(Request::Home),
            300 => half.request(Request::Override(Overrides {
                feed: (n / 1_000) as u8,
                rapid: 50,
                spindle: 120,
            })),
            700 => half.request(Request::Hold),
            800 => half.request(Request::StopSpindle),
            900 => half.request(Request::CycleStart),
            1_500 => half.request(Request::Reset),
            _ => {}
        }
        half.tick(Tick(n));
        while let Some(report) = half.report() {
            phases[report.sample.phase as usize] = true;
        }
    }
    let mut card = RealtimeHalf::new(&parameters, RegisterCard::new(&parameters, Words::default()), Quality::Good);
    card.request(Request::PowerOn);
    for n in 0..2_000 {
        card.tick(Tick(n));
        while card.report().is_some() {}
    }
    let count = allocations() - before;
    assert_eq!(count, 0, "{count} allocations or releases");
    let visited = [
        Phase::Jogging,
        Phase::Homing,
        Phase::Waiting,
        Phase::Paused,
        Phase::EmergencyStop,
    ];
    assert!(visited.iter().all(|p| phases[*p as usize]), "{phases:?}");
    assert!(next >= program.len(), "no program was run");
}

#[test]
fn the_realtime_end_of_the_link_allocates_nothing() {
    use machine::link::{Entry, Follower, LoadPart, Order, Urgent, UrgentOrder};
    use machine::watch::{Frequency, WatchOrder};
    let parameters = MachineParameters::small_machining_centre();
    let plant = Plant::new(&parameters, Point::ORIGIN, 1);
    let mut half = Box::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated));
    let mut follower = Box::new(Follower::new());
    half.request(Request::PowerOn);
    half.tick(Tick(0));
    let session = UrgentOrder::NewSession {
        session: 1,
        same_plan: false,
    };
    let at = |n: u64| Entry {
        command: Command::SetPoint(SetPoint {
            position: [n as f64 * 0.01, 0.0, 0.0],
            velocity: [10.0, 0.0, 0.0],
            ..SetPoint::default()
        }),
        done: n,
    };
    let before = allocations();
    follower.take_urgent(session, &mut half);
    follower.take_urgent(UrgentOrder::Urgent(Urgent::Resume { epoch: 1, done: 0 }), &mut half);
    for number in 0..20 {
        let watch = LoadPart::Watch {
            frequency: Frequency::NoKeyword,
            all_modes: true,
            mark: number + 1,
        };
        follower.take_urgent(UrgentOrder::Load(watch), &mut half);
        follower.take_urgent(UrgentOrder::Load(LoadPart::Whole { number }), &mut half);
        half.watches().obey(WatchOrder::Start(number as u16));
    }
    let mut lived = 0;
    for tick in 1..2_000u64 {
        if tick % 100 == 50 {
            follower.take_urgent(UrgentOrder::Living, &mut half);
            let mark = (tick / 100) as u32;
            follower.take_urgent(UrgentOrder::End { mark }, &mut half);
        }
        // Blocks of ten with tails of thirty; after the hundredth the sender is gone.
        if tick % 10 == 1 && tick < 1_000 {
            assert_eq!(
                follower.take(
                    Order::Block {
                        epoch: 1,
                        first: tick - 1
                    },
                    &mut half
                ),
                Ok(())
            );
            for n in tick..tick + 40 {
                let (epoch, entry) = (1, at(n));
                let order = if n < tick + 10 {
                    Order::Body { epoch, entry }
                } else {
                    Order::Tail { epoch, entry }
                };
                assert_eq!(follower.take(order, &mut half), Ok(()));
            }
        }
        if tick == 1_400 {
            follower.take_urgent(UrgentOrder::LinkLost, &mut half);
        }
        half.tick(Tick(tick));
        follower.after_tick(&mut half);
        while let Some(lives) = follower.lives(&mut half) {
            std::hint::black_box(lives);
            lived += 1;
        }
        while let Some(report) = half.report() {
            std::hint::black_box(follower.translated(report));
        }
    }
    let count = allocations() - before;
    assert_eq!((count, follower.too_late()), (0, 0));
    // Twenty lists of twenty, of which each end but the first takes one; with each a beginning, an end, and what became of the end.
    assert_eq!((lived, half.watches().running()), (20 * 3 + (1..=20).sum::<i32>(), 1));
    let status = follower.status();
    assert!(status.needs_resume && status.done.is_some_and(|n| n >= 1_000), "{status:?}");
}

#[test]
fn no_source_of_the_realtime_half_names_an_allocator() {
    let mut files = 0;
    let mut folders = vec!["src".into(), "../units/src".into()];
    while let Some(folder) = folders.pop() {
        let folder: std::path::PathBuf = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        for entry in std::fs::read_dir(&folder).expect("the crate's sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("a source file");
            // Unit tests stand at the end of a file and may use std.
            let product = text.split("#[cfg(test)]").next().unwrap_or_default();
            for word in ["extern crate alloc", "extern crate std", "alloc::", "std::"] {
                assert!(!product.contains(word), "{} says {word}", path.display());
            }
            if path.ends_with("lib.rs") {
                assert!(text.contains("\n#![no_std]\n"), "{} is not no_std", path.display());
            }
            files += 1;
        }
    }
    assert!(files > 10, "only {files} files looked at");
}

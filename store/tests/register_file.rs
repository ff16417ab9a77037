//! A controller on a register file, with another thread that plays the card and its iron on the same file.

use machine::registers::{FULL_SPEED, input, output, register};
use machine::{
    AxisOrder, Command, CyclicDrive, DriveMode, DriveOrders, FaultCause, MachineParameters, Plant, PositionLaw, Quality,
    RealtimeHalf, RegisterCard, Request, SetPoint, SpindleCommand, State,
};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use store::register_file::{RegisterFile, WORDS};
use units::{Point, Rpm, StepId, Tick};

/// The other side, by its own means: words at their places in the file.
struct Card {
    file: File,
    plant: Plant,
    parameters: MachineParameters,
    now: Tick,
    index_count: i32,
}

impl Card {
    fn new(path: &Path, parameters: &MachineParameters) -> Card {
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .expect("a file");
        file.set_len((WORDS * 4) as u64).expect("its length");
        Card {
            file,
            plant: Plant::new(parameters, Point::ORIGIN, 5),
            parameters: *parameters,
            now: Tick(0),
            index_count: 0,
        }
    }

    fn word(&self, register: u16) -> i32 {
        let mut bytes = [0; 4];
        self.file.read_exact_at(&mut bytes, u64::from(register) * 4).expect("a word");
        i32::from_le_bytes(bytes)
    }

    fn put(&self, register: u16, value: i32) {
        self.file
            .write_all_at(&value.to_le_bytes(), u64::from(register) * 4)
            .expect("a place");
    }

    fn cycle(&mut self) {
        let outputs = self.word(register::OUTPUTS);
        let part = |r: u16| f64::from(self.word(r)) / FULL_SPEED;
        let rpm = Rpm(part(register::SPINDLE) * self.parameters.spindle.highest.0);
        let orders = DriveOrders {
            mode: if outputs & output::ENABLE != 0 {
                DriveMode::Follow
            } else {
                DriveMode::Off
            },
            axes: std::array::from_fn(|k| {
                let velocity = part(register::SPEED[k]) * self.parameters.axes[k].v_max.0;
                AxisOrder {
                    velocity,
                    planned: velocity,
                    ..AxisOrder::default()
                }
            }),
            spindle: match outputs & (output::CLOCKWISE | output::COUNTERCLOCKWISE) {
                output::CLOCKWISE => SpindleCommand::Clockwise(rpm),
                output::COUNTERCLOCKWISE => SpindleCommand::Counterclockwise(rpm),
                _ => SpindleCommand::Stop,
            },
            ..DriveOrders::default()
        };
        self.plant.order(self.now, &orders);
        self.now += 1;
        let feedback = self.plant.read(self.now);
        for k in 0..3 {
            self.put(
                register::POSITION[k],
                (feedback.position[k] * self.parameters.axes[k].pulses_per_mm).round() as i32,
            );
        }
        let counts = self.parameters.spindle.encoder_counts;
        self.put(
            register::SPINDLE_POSITION,
            (feedback.spindle_angle.expect("it has one") * counts).round() as i32,
        );
        if let Some(index) = feedback.spindle_index {
            self.put(register::SPINDLE_INDEX, (index * counts).round() as i32);
            self.index_count = self.index_count.wrapping_add(1 << 24);
            self.put(register::INDEX_COUNT, self.index_count);
        }
        self.put(register::SPINDLE_SPEED, feedback.spindle_speed.round() as i32);
        self.put(register::CARD_ALIVE, self.now.0 as i32);
        self.put(register::INPUTS, input::EMERGENCY_STOP_CLOSED | input::DRIVES_READY);
    }
}

fn parameters() -> MachineParameters {
    MachineParameters {
        position_law: PositionLaw::SpeedSetPoint,
        ..MachineParameters::small_machining_centre()
    }
}

/// From rest to rest along X, gently.
fn there(to: f64) -> Vec<Command> {
    let cycles = 1000;
    (1..=cycles)
        .map(|n| {
            let u = f64::from(n) / f64::from(cycles);
            let smooth = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            let speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) * to;
            let acceleration = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) * to;
            Command::SetPoint(SetPoint {
                position: [to * smooth, 0.0, 0.0],
                velocity: [speed, 0.0, 0.0],
                acceleration: [acceleration, 0.0, 0.0],
                step: StepId(1),
                path_length: to * smooth,
                path_speed: speed,
                ..SetPoint::default()
            })
        })
        .collect()
}

#[test]
fn a_controller_drives_iron_behind_a_file_and_a_card_that_falls_silent_is_a_fault() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("registers");
    let parameters = parameters();
    let mut card = Card::new(&path, &parameters);
    card.cycle();
    let registers = RegisterFile::open(&path).expect("it is there");
    // Both sides run by turns, so that no scheduler decides what is seen: a turn of the controller is odd, one of the card even.
    let (turn, over) = (Arc::new(AtomicU64::new(1)), Arc::new(AtomicBool::new(false)));
    let playing = std::thread::spawn({
        let (turn, over) = (Arc::clone(&turn), Arc::clone(&over));
        move || {
            while !over.load(Ordering::Acquire) {
                if turn.load(Ordering::Acquire) % 2 == 0 {
                    card.cycle();
                    turn.fetch_add(1, Ordering::AcqRel);
                } else {
                    std::thread::yield_now();
                }
            }
        }
    });
    let mut half = Box::new(RealtimeHalf::new(
        &parameters,
        RegisterCard::new(&parameters, registers),
        Quality::Good,
    ));
    half.request(Request::PowerOn);
    let mut tick = 0;
    let mut queue = there(40.0).into_iter().peekable();
    let mut last = None;
    while tick < 4000 {
        while turn.load(Ordering::Acquire) % 2 == 0 {
            std::thread::yield_now();
        }
        while tick > 0
            && let Some(command) = queue.peek()
            && half.push(*command).is_ok()
        {
            queue.next();
        }
        half.tick(Tick(tick));
        let report = half.report().expect("a report each cycle");
        // A card measures neither load nor current: not a number, which a record keeps as missing.
        assert!(report.sample.load.iter().chain(&report.sample.current).all(|v| v.is_nan()));
        let following = (report.sample.commanded[0] - report.sample.actual[0]).abs();
        assert!(following < 0.4, "{tick}: {following}");
        last = Some(report);
        tick += 1;
        turn.fetch_add(1, Ordering::AcqRel);
        if tick > 1500 && report.idle {
            break;
        }
    }
    let sample = last.expect("it ran").sample;
    assert!((sample.actual[0] - 40.0).abs() < 0.005, "{sample:?}");
    over.store(true, Ordering::Release);
    playing.join().expect("it plays on");
    // Nobody plays any more: what the file says is of the past.
    for _ in 0..40 {
        half.tick(Tick(tick));
        tick += 1;
    }
    assert_eq!(half.controller().state(), State::Fault(FaultCause::Drive));
    assert_eq!(half.drive_mut().registers_mut().failures(), 0);
}

#[test]
fn a_file_that_is_missing_or_too_short_is_named_and_one_that_is_cut_off_is_an_emergency_stop() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("registers");
    let refused = RegisterFile::open(&path).expect_err("nobody made it").to_string();
    assert!(refused.contains("registers"), "{refused}");
    std::fs::write(&path, [0; 100]).expect("a short one");
    let refused = RegisterFile::open(&path).expect_err("too short").to_string();
    assert!(refused.contains("100 bytes") && refused.contains("128 bytes"), "{refused}");

    let parameters = parameters();
    let mut card = Card::new(&path, &parameters);
    card.cycle();
    let mut drive = RegisterCard::new(&parameters, RegisterFile::open(&path).expect("whole"));
    assert!(!drive.read(Tick(0)).emergency_stop);
    card.file.set_len(10).expect("cut off");
    let feedback = drive.read(Tick(1));
    assert!(feedback.emergency_stop && feedback.drive_fault);
    assert_eq!(drive.registers_mut().failures(), 1);
}

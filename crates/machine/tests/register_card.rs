//! A card with registers in front of simulated iron: what it is told, what it tells, and a circle machined through it.
#![allow(clippy::disallowed_methods, reason = "tests may square a number")]

use machine::registers::{FULL_SPEED, input, output, register};
use machine::{
    AxisOrder, Command, CoolantOutlets, CyclicDrive, DriveMode, DriveOrders, Feedback, MachineParameters, Plant, PositionLaw,
    Quality, RealtimeHalf, RegisterCard, Registers, Report, Request, SetPoint, SpindleCommand, State,
};
use units::{Millimetres, Point, Rpm, StepId, Tick};

/// The registers of a card with the simulated iron behind it: the iron lives on once a cycle.
struct Iron {
    words: [i32; 32],
    plant: Plant,
    parameters: MachineParameters,
    now: Tick,
    /// Where the counters of the encoders stand at power-on.
    count_from: i32,
}

impl Iron {
    fn new(parameters: &MachineParameters, start: [f64; 3], count_from: i32) -> Iron {
        let mut iron = Iron {
            words: [0; 32],
            plant: Plant::new(parameters, Point::from_xyz(start), 3),
            parameters: *parameters,
            now: Tick(0),
            count_from,
        };
        iron.show(Feedback::default());
        iron
    }

    /// Drives follow the speeds in the registers for a cycle.
    fn cycle(&mut self) {
        let outputs = self.words[usize::from(register::OUTPUTS)];
        let speed =
            |k: usize| f64::from(self.words[usize::from(register::SPEED[k])]) / FULL_SPEED * self.parameters.axes[k].v_max.0;
        let rpm = Rpm(f64::from(self.words[usize::from(register::SPINDLE)]) / FULL_SPEED * self.parameters.spindle.highest.0);
        let orders = DriveOrders {
            mode: if outputs & output::ENABLE != 0 {
                DriveMode::Follow
            } else {
                DriveMode::Off
            },
            axes: std::array::from_fn(|k| AxisOrder {
                velocity: speed(k),
                planned: speed(k),
                ..AxisOrder::default()
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
        self.show(feedback);
    }

    fn show(&mut self, feedback: Feedback) {
        for k in 0..3 {
            let counts = |mm: f64| {
                self.count_from
                    .wrapping_add((mm * self.parameters.axes[k].pulses_per_mm).round() as i32)
            };
            self.words[usize::from(register::POSITION[k])] = counts(feedback.position[k]);
            if let Some(index) = feedback.index[k] {
                self.words[usize::from(register::INDEX[k])] = counts(index);
                let count = &mut self.words[usize::from(register::INDEX_COUNT)];
                let shift = 8 * k as i32;
                let next = ((*count >> shift) + 1) & 0xff;
                *count = *count & !(0xff << shift) | next << shift;
            }
        }
        let mut inputs = input::EMERGENCY_STOP_CLOSED | input::DRIVES_READY;
        for (k, bit) in input::REFERENCE.iter().enumerate() {
            inputs |= if feedback.reference_switch[k] { *bit } else { 0 };
        }
        self.words[usize::from(register::INPUTS)] = inputs;
        self.words[usize::from(register::SPINDLE_SPEED)] = feedback.spindle_speed.round() as i32;
    }
}

impl Registers for Iron {
    fn read(&mut self, register: u16) -> i32 {
        self.words[usize::from(register)]
    }
    fn write(&mut self, register: u16, value: i32) {
        self.words[usize::from(register)] = value;
        if register == register::ALIVE {
            self.cycle();
        }
    }
}

fn by_speed() -> MachineParameters {
    MachineParameters {
        position_law: PositionLaw::SpeedSetPoint,
        ..MachineParameters::small_machining_centre()
    }
}

fn circle(radius: f64, speed: f64) -> Vec<Command> {
    let (length, acceleration) = (std::f64::consts::TAU * radius, 500.0);
    let ramp = speed / acceleration;
    let total = length / speed + ramp;
    (1..=(total / 0.001).ceil() as u32)
        .map(|n| {
            let t = (f64::from(n) * 0.001).min(total);
            let (s, v, a) = if t < ramp {
                (acceleration * t * t / 2.0, acceleration * t, acceleration)
            } else if t > total - ramp {
                let left = total - t;
                (length - acceleration * left * left / 2.0, acceleration * left, -acceleration)
            } else {
                (speed * (t - ramp / 2.0), speed, 0.0)
            };
            let (sin, cos) = (s / radius).sin_cos();
            let normal = v * v / radius;
            Command::SetPoint(SetPoint {
                position: [radius * (cos - 1.0), radius * sin, 0.0],
                velocity: [-v * sin, v * cos, 0.0],
                acceleration: [-a * sin - normal * cos, a * cos - normal * sin, 0.0],
                step: StepId(1),
                path_length: s,
                path_speed: v,
                ..SetPoint::default()
            })
        })
        .collect()
}

/// Runs commands to the end and gives all reports.
fn run<D: CyclicDrive>(half: &mut RealtimeHalf<D>, commands: Vec<Command>) -> Vec<Report> {
    let mut queue: std::collections::VecDeque<Command> = commands.into();
    let mut reports = Vec::new();
    half.request(Request::PowerOn);
    for n in 0..20_000 {
        while n > 0
            && let Some(command) = queue.pop_front()
        {
            if let Err(back) = half.push(command) {
                queue.push_front(back);
                break;
            }
        }
        half.tick(Tick(n));
        reports.extend(half.report());
        if n > 10 && queue.is_empty() && reports.last().is_some_and(|r| r.idle) {
            return reports;
        }
    }
    panic!("does not end: {:?}", half.controller().state());
}

/// Largest distance of the encoders from a circle, mm.
fn off_circle(radius: f64, reports: &[Report]) -> f64 {
    let moving = reports.iter().filter(|r| r.sample.path_speed > 0.0);
    let off = moving.map(|r| {
        let [x, y, z] = r.sample.actual;
        (((x + radius).powi(2) + y * y).sqrt() - radius).abs().max(z.abs())
    });
    off.fold(0.0, f64::max)
}

#[test]
fn both_laws_machine_a_circle_on_the_simulated_drives_and_the_sources_through_a_card_too() {
    let (radius, speed) = (20.0, 33.0);
    let ours = MachineParameters::small_machining_centre();
    let plant = |p: &MachineParameters| Plant::new(p, Point::ORIGIN, 3);
    let feed_forward = run(
        &mut Box::new(RealtimeHalf::new(&ours, plant(&ours), Quality::Simulated)),
        circle(radius, speed),
    );
    let source = by_speed();
    let speed_set_point = run(
        &mut Box::new(RealtimeHalf::new(&source, plant(&source), Quality::Simulated)),
        circle(radius, speed),
    );
    let card = RegisterCard::new(&source, Iron::new(&source, [0.0; 3], 0));
    let through_card = run(
        &mut Box::new(RealtimeHalf::new(&source, card, Quality::Simulated)),
        circle(radius, speed),
    );
    let off = [&feed_forward, &speed_set_point, &through_card].map(|reports| off_circle(radius, reports));
    println!(
        "off the circle: feed-forward {:.4}, speed set-point {:.4}, through a card {:.4} mm",
        off[0], off[1], off[2]
    );
    assert!(off[0] < 0.005 && off[1] < 0.03 && off[2] < 0.03, "{off:?}");
    assert!(off[0] < off[1], "the feed-forward has to be worth it: {off:?}");
    for reports in [&feed_forward, &speed_set_point, &through_card] {
        let c = reports.last().expect("it ran").counters;
        assert_eq!((c.off_path_stops, c.following_warnings, c.starvations), (0, 0, 0));
    }
}

#[test]
fn a_machine_with_a_card_is_homed_through_it_and_counters_may_wrap() {
    let mut parameters = by_speed();
    parameters.absolute_encoders = false;
    for axis in &mut parameters.axes {
        (axis.lowest, axis.highest) = (Millimetres(-300.0), Millimetres(100.0));
        axis.homing.reference = Millimetres(90.0);
    }
    // The counters of the encoders pass their end on the way.
    let card = RegisterCard::new(&parameters, Iron::new(&parameters, [-50.0, 10.0, 85.0], i32::MAX - 20_000));
    let mut half = Box::new(RealtimeHalf::new(&parameters, card, Quality::Good));
    half.request(Request::PowerOn);
    half.tick(Tick(0));
    half.request(Request::Home);
    let mut home = false;
    for n in 1..60_000 {
        half.tick(Tick(n));
        home |= half.report().is_some_and(|r| r.notices.home_reached);
        while half.report().is_some() {}
        if home {
            break;
        }
    }
    assert!(home, "{:?}", half.controller().state());
    assert_eq!(half.controller().state(), State::Ready);
    let truth = half.drive_mut().registers_mut().plant.true_position();
    assert!(truth.iter().all(|p| p.abs() < 0.02), "{truth:?}");
}

/// Registers that keep what was written.
#[derive(Default)]
struct Words([i32; 32]);

impl Registers for Words {
    fn read(&mut self, register: u16) -> i32 {
        self.0[usize::from(register)]
    }
    fn write(&mut self, register: u16, value: i32) {
        self.0[usize::from(register)] = value;
    }
}

#[test]
fn speeds_are_parts_of_the_highest_and_never_more_and_a_quick_stop_is_a_ramp() {
    let parameters = MachineParameters::small_machining_centre();
    let mut card = RegisterCard::new(&parameters, Words::default());
    let order = |velocity: [f64; 3]| DriveOrders {
        mode: DriveMode::Follow,
        axes: velocity.map(|velocity| AxisOrder {
            velocity,
            ..AxisOrder::default()
        }),
        spindle: SpindleCommand::Counterclockwise(Rpm(12_000.0)),
        coolant: CoolantOutlets {
            flood: true,
            through: true,
            ..CoolantOutlets::default()
        },
        path_speed: 0.0,
    };
    card.order(Tick(0), &order([250.0, -900.0, f64::NAN]));
    let words = card.registers_mut().0;
    // Half of 32767 is rounded away from 0. A speed that is no number is none.
    assert_eq!([words[16], words[17], words[18]], [16_384, -32_767, 0]);
    assert_eq!((words[19], words[20], words[21]), (16_384, 0b10_1101, 1));
    card.order(Tick(1), &order([250.0, -500.0, 0.0]));
    let stop = DriveOrders {
        mode: DriveMode::QuickStop,
        ..DriveOrders::default()
    };
    let mut last = [250.0, -500.0];
    for n in 0..200 {
        card.order(Tick(2 + n), &stop);
        let words = card.registers_mut().0;
        for k in 0..2 {
            let speed = f64::from(words[16 + k]) / FULL_SPEED * 500.0;
            assert!(
                (speed - last[k]).abs() < 3.95 && speed.abs() <= f64::abs(last[k]),
                "{speed} after {}",
                last[k]
            );
            last[k] = speed;
        }
    }
    assert_eq!(last, [0.0, 0.0]);
    card.order(Tick(300), &DriveOrders::default());
    assert_eq!(card.registers_mut().0[20], 0, "without power nothing is enabled");
}

#[test]
fn a_broken_wire_is_an_emergency_stop_and_what_is_not_measured_is_no_number() {
    let parameters = MachineParameters::small_machining_centre();
    let mut card = RegisterCard::new(&parameters, Words::default());
    let feedback = card.read(Tick(0));
    assert!(feedback.emergency_stop && feedback.drive_fault);
    assert!(feedback.load.iter().chain(&feedback.current).all(|v| v.is_nan()) && feedback.spindle_load.is_nan());
    card.registers_mut().0[7] = input::EMERGENCY_STOP_CLOSED | input::DRIVES_READY | input::REFERENCE[1];
    card.registers_mut().0[0] = 5;
    let feedback = card.read(Tick(1));
    assert!(!feedback.emergency_stop && !feedback.drive_fault);
    assert_eq!(feedback.reference_switch, [false, true, false]);
    assert_eq!((feedback.position[0], feedback.index), (0.005, [None; 3]));
    assert!((feedback.velocity[0] - 5.0).abs() < 1e-9, "5 pulses in a millisecond");
}

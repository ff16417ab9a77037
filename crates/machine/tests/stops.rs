//! Every way to stop, on the simulated plant: where the machine comes to rest, and whether it was on the path.
#![allow(clippy::disallowed_methods, reason = "tests may square a number")]

use machine::{
    Command, Counters, FaultCause, MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, SetPoint, SpindleCommand,
    State, StopCause,
};
use units::{Millimetres, Point, Rpm, StepId, Tick, ToolNumber, WorkingstepId};

const T: f64 = 0.001;

/// A machine with its program, one cycle at a time.
struct Bench {
    // On the heap: its queues and conditions are large for the stack of a test.
    half: Box<RealtimeHalf<Plant>>,
    now: Tick,
    queue: std::collections::VecDeque<Command>,
    reports: Vec<Report>,
    stalled: bool,
}

impl Bench {
    fn new(commands: Vec<Command>) -> Bench {
        Bench::with(MachineParameters::small_machining_centre(), commands)
    }

    fn with(parameters: MachineParameters, commands: Vec<Command>) -> Bench {
        parameters.check().expect("a sound machine");
        let plant = Plant::new(&parameters, Point::ORIGIN, 7);
        let mut bench = Bench {
            half: Box::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated)),
            now: Tick(0),
            queue: std::collections::VecDeque::new(),
            reports: Vec::new(),
            stalled: false,
        };
        bench.half.request(Request::PowerOn);
        bench.run(1);
        bench.queue.extend(commands);
        bench
    }

    fn run(&mut self, cycles: u64) -> &mut Self {
        for _ in 0..cycles {
            while !self.stalled
                && let Some(command) = self.queue.pop_front()
            {
                if let Err(back) = self.half.push(command) {
                    self.queue.push_front(back);
                    break;
                }
            }
            self.half.tick(self.now);
            self.reports.extend(self.half.report());
            self.now += 1;
        }
        self
    }

    fn state(&self) -> State {
        self.half.controller().state()
    }

    fn counters(&self) -> Counters {
        self.half.controller().counters()
    }

    fn last(&self) -> &Report {
        self.reports.last().expect("it ran")
    }

    /// Largest commanded acceleration of any axis, by second differences, mm/s^2.
    fn worst_acceleration(&self) -> f64 {
        self.reports
            .windows(3)
            .flat_map(|w| {
                (0..3).map(move |k| {
                    let p = |i: usize| w[i].sample.commanded[k];
                    (p(2) - 2.0 * p(1) + p(0)).abs() / (T * T)
                })
            })
            .fold(0.0, f64::max)
    }

    fn worst_following_error(&self) -> f64 {
        self.reports
            .iter()
            .flat_map(|r| (0..3).map(|k| (r.sample.commanded[k] - r.sample.actual[k]).abs()))
            .fold(0.0, f64::max)
    }

    #[track_caller]
    fn stands(&self) {
        let n = self.reports.len();
        let moved = (0..3)
            .map(|k| (self.reports[n - 20].sample.actual[k] - self.reports[n - 1].sample.actual[k]).abs())
            .fold(0.0, f64::max);
        // The integral part settles a pulse or two after the stop.
        assert!(moved < 0.0035, "still moves: {moved} mm in 20 ms");
    }
}

/// A circle of `radius` about (-radius, 0), begun and ended at rest in the origin, with trapezoidal speed.
fn circle(radius: f64, speed: f64, acceleration: f64) -> Vec<Command> {
    let length = std::f64::consts::TAU * radius;
    let ramp = speed / acceleration;
    let total = length / speed + ramp;
    let cycles = (total / T).ceil() as u32;
    (1..=cycles)
        .map(|n| {
            let t = (f64::from(n) * T).min(total);
            let (s, v, a) = if t < ramp {
                (acceleration * t * t / 2.0, acceleration * t, acceleration)
            } else if t > total - ramp {
                let left = total - t;
                (length - acceleration * left * left / 2.0, acceleration * left, -acceleration)
            } else {
                (speed * (t - ramp / 2.0), speed, 0.0)
            };
            let angle = s / radius;
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            let normal = v * v / radius;
            Command::SetPoint(SetPoint {
                position: [radius * (cos - 1.0), radius * sin, 0.0],
                velocity: [-v * sin, v * cos, 0.0],
                acceleration: [-a * sin - normal * cos, a * cos - normal * sin, 0.0],
                step: StepId(n),
                path_length: s,
                path_speed: v,
                ..SetPoint::default()
            })
        })
        .collect()
}

/// Distance of a commanded place from the circle, mm.
fn off_circle(radius: f64, p: [f64; 3]) -> f64 {
    let x = p[0] + radius;
    ((x * x + p[1] * p[1]).sqrt() - radius).abs().max(p[2].abs())
}

fn ordinary() -> Vec<Command> {
    circle(50.0, 200.0, 1500.0)
}

#[test]
fn an_undisturbed_circle_gives_every_set_point_in_its_cycle_and_follows_it() {
    let program = ordinary();
    let mut bench = Bench::new(program.clone());
    bench.run(program.len() as u64 + 100);
    let commanded: Vec<_> = bench.reports.iter().map(|r| r.sample.commanded).collect();
    let first = bench.reports.iter().position(|r| r.sample.step == StepId(1)).expect("it ran");
    for (k, command) in program.iter().enumerate() {
        let Command::SetPoint(s) = command else { continue };
        assert_eq!(commanded[first + k], s.position);
    }
    let error = bench.worst_following_error();
    println!("worst following error {error:.4} mm");
    assert!(error < 0.03, "following error {error} mm");
    assert_eq!(bench.counters().completed, program.len() as u64);
    bench.stands();
}

#[test]
fn hold_stops_on_the_circle_and_cycle_start_finishes_it() {
    let mut bench = Bench::new(ordinary());
    bench.run(700);
    bench.half.request(Request::Hold);
    bench.run(400);
    assert_eq!(bench.state(), State::Held);
    bench.stands();
    bench.half.request(Request::CycleStart);
    bench.run(3000);
    assert!(bench.last().idle);
    for r in &bench.reports {
        assert!(
            off_circle(50.0, r.sample.commanded) < 0.001,
            "left the path at {:?}",
            r.sample
        );
    }
    // Rate and bend together may exceed one axis a little, because a stop has to end.
    let worst = bench.worst_acceleration();
    println!("worst commanded acceleration {worst:.0} mm/s^2");
    assert!(worst < 3300.0, "{worst} mm/s^2");
    assert!(off_circle(50.0, bench.last().sample.commanded) < 1e-9);
    assert!(bench.last().sample.commanded[1].abs() < 0.001);
}

#[test]
fn a_stop_ends_at_rest_on_the_path_and_only_a_reset_leads_out() {
    let mut bench = Bench::new(ordinary());
    bench.run(700);
    bench.half.request(Request::Stop);
    bench.run(300);
    assert_eq!(bench.state(), State::Stopped(StopCause::Asked));
    bench.half.request(Request::CycleStart);
    bench.run(50);
    assert_eq!(bench.state(), State::Stopped(StopCause::Asked));
    bench.stands();
    assert!(off_circle(50.0, bench.last().sample.commanded) < 0.001);
    bench.queue.clear();
    bench.half.request(Request::Reset);
    bench.run(10);
    let counters = bench.counters();
    assert_eq!(bench.state(), State::Ready);
    assert_eq!(counters.accepted, counters.completed + counters.discarded);
}

#[test]
fn a_queue_that_runs_dry_stops_on_what_is_left_of_the_path_and_goes_on_later() {
    let mut bench = Bench::new(ordinary());
    bench.run(300);
    bench.stalled = true;
    bench.run(1500);
    assert_eq!(bench.state(), State::Stopped(StopCause::Starved));
    assert_eq!(bench.counters().off_path_stops, 0);
    bench.stands();
    bench.stalled = false;
    bench.run(5);
    bench.half.request(Request::CycleStart);
    bench.run(3000);
    assert!(bench.last().idle, "{:?}", bench.state());
    assert!(bench.reports.iter().all(|r| off_circle(50.0, r.sample.commanded) < 0.001));
}

#[test]
fn a_stutter_of_the_sender_only_slows_the_machine() {
    let mut bench = Bench::new(ordinary());
    bench.run(300);
    bench.stalled = true;
    bench.run(445);
    bench.stalled = false;
    bench.run(4000);
    assert!(bench.counters().starved_ticks > 0);
    assert!(bench.last().idle, "{:?}", bench.state());
    assert!(bench.reports.iter().all(|r| off_circle(50.0, r.sample.commanded) < 0.001));
}

#[test]
fn a_set_point_beyond_the_travel_stops_the_machine_before_it() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.axes[1].highest = Millimetres(30.0);
    let mut bench = Bench::with(parameters, ordinary());
    bench.run(2000);
    assert_eq!(bench.state(), State::Stopped(StopCause::SoftLimit { axis: 1 }));
    let highest = bench.reports.iter().map(|r| r.sample.actual[1]).fold(f64::MIN, f64::max);
    assert!(highest <= 30.0 && highest > 10.0, "{highest}");
    assert!(bench.reports.iter().all(|r| off_circle(50.0, r.sample.commanded) < 0.001));
    bench.stands();
}

#[test]
fn a_jump_in_the_set_points_is_not_executed() {
    let mut program = ordinary();
    if let Command::SetPoint(s) = &mut program[600] {
        s.position[0] += 2.0;
    }
    let mut bench = Bench::new(program);
    bench.run(2000);
    assert_eq!(bench.state(), State::Stopped(StopCause::Jump { axis: 0 }));
    assert!(bench.last().sample.step < StepId(601));
    bench.stands();
}

#[test]
fn numbers_that_are_none_are_not_executed() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut program = ordinary();
        if let Command::SetPoint(s) = &mut program[300] {
            s.velocity[2] = bad;
        }
        let mut bench = Bench::new(program);
        bench.run(2000);
        assert_eq!(bench.state(), State::Stopped(StopCause::Jump { axis: 2 }));
        assert!(bench.reports.iter().all(|r| r.sample.commanded.iter().all(|p| p.is_finite())));
    }
}

#[test]
fn a_tool_change_in_motion_is_refused_by_a_stop_before_it() {
    let mut program = ordinary();
    let tool = Command::Tool {
        tool: ToolNumber(3),
        step: StepId(9000),
    };
    program.insert(800, tool);
    let mut bench = Bench::new(program);
    bench.run(2000);
    assert_eq!(bench.state(), State::Stopped(StopCause::SwitchInMotion));
    assert_eq!(bench.last().sample.tool, ToolNumber(0));
    bench.stands();
}

#[test]
fn a_few_lost_cycles_are_counted_and_harmless() {
    let mut bench = Bench::new(ordinary());
    for _ in 0..20 {
        bench.run(50);
        bench.now += 5;
    }
    bench.run(2000);
    assert_eq!((bench.counters().late_gaps, bench.counters().late_ticks), (20, 100));
    assert!(bench.last().idle, "{:?}", bench.state());
    let error = bench.worst_following_error();
    println!("worst following error {error:.4} mm");
    assert!(error < 0.1, "{error}");
}

#[test]
fn six_lost_cycles_are_a_controlled_stop_and_a_long_absence_a_fault() {
    let late = State::Stopped(StopCause::Late { cycles: 6, tolerated: 5 });
    let away = State::Fault(FaultCause::Away {
        cycles: 60,
        tolerated: 5,
    });
    for (lost, expected) in [(6, late), (60, away)] {
        let mut bench = Bench::new(ordinary());
        bench.run(500);
        bench.now += lost;
        bench.run(800);
        assert_eq!(bench.state(), expected);
        bench.stands();
    }
}

#[test]
fn who_was_away_reads_how_long_and_what_to_do_and_a_fault_of_a_drive_stays_one() {
    let mut bench = Bench::new(ordinary());
    bench.half.made_up_for(500);
    bench.run(500);
    bench.now += 2013;
    bench.run(800);
    let State::Fault(cause) = bench.state() else {
        panic!("{:?}", bench.state())
    };
    let text = cause.to_string();
    assert!(
        text.starts_with("the controller was away for 2013 servo cycles at once; 500 are tolerated, and the drives stopped by themselves (see what"),
        "{text}"
    );
    assert!(text.contains("realtime rights"), "{text}");
    assert_eq!(FaultCause::Drive.to_string(), "a drive reports a fault");
    assert_eq!(StopCause::Asked.to_string(), StopCause::Asked.text());
}

#[test]
fn the_emergency_stop_brakes_takes_power_away_and_asks_for_release_and_reset() {
    let mut bench = Bench::new(ordinary());
    bench.run(700);
    bench.half.drive_mut().set_emergency_stop(true);
    bench.run(400);
    assert_eq!(bench.state(), State::EmergencyStop);
    bench.stands();
    assert!(bench.last().orders.axes.iter().all(|a| a.velocity == 0.0));
    bench.half.request(Request::Reset);
    bench.run(5);
    assert_eq!(bench.state(), State::EmergencyStop);
    bench.half.drive_mut().set_emergency_stop(false);
    bench.run(2);
    bench.queue.clear();
    bench.half.request(Request::Reset);
    bench.run(5);
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn a_jammed_axis_warns_first_and_then_faults() {
    let mut bench = Bench::new(ordinary());
    bench.run(500);
    bench.half.drive_mut().set_friction_factor(0, 30.0);
    bench.run(800);
    assert_eq!(bench.state(), State::Fault(FaultCause::FollowingError { axis: 0 }));
    assert!(bench.counters().following_warnings >= 1);
    bench.stands();
}

#[test]
fn a_short_encoder_glitch_is_bridged_and_a_lasting_one_is_a_fault() {
    for (cycles, fault) in [(2, false), (10, true)] {
        let mut bench = Bench::new(ordinary());
        bench.run(500);
        bench.half.drive_mut().set_encoder_error(1, 700);
        bench.run(cycles);
        bench.half.drive_mut().set_encoder_error(1, 0);
        bench.run(3000);
        assert_eq!(
            matches!(bench.state(), State::Fault(FaultCause::Encoder { axis: 1 })),
            fault,
            "{:?}",
            bench.state()
        );
        assert!(bench.counters().bridged_readings > 0);
        bench.stands();
    }
}

#[test]
fn switching_takes_its_time_and_in_order() {
    let step = StepId(1);
    let program = vec![
        Command::Tool {
            tool: ToolNumber(4),
            step,
        },
        Command::Spindle {
            spindle: SpindleCommand::Clockwise(Rpm(12_000.0)),
            step,
        },
        Command::Dwell { cycles: 250, step },
        Command::Pause { step },
        Command::Spindle {
            spindle: SpindleCommand::Stop,
            step,
        },
        Command::End { step },
    ];
    let mut bench = Bench::new(program);
    bench.run(8000);
    assert_eq!(bench.state(), State::Paused);
    let phases: Vec<State> = bench.reports.iter().map(|r| r.state).collect();
    let during = |s: State| phases.iter().filter(|p| **p == s).count();
    use machine::Wait::*;
    assert_eq!(during(State::Waiting(Tool)), 2500);
    assert_eq!(during(State::Waiting(Dwell)), 250);
    let spin_up = during(State::Waiting(Spindle));
    println!("{spin_up} ms to speed");
    assert!((200..3000).contains(&spin_up), "{spin_up} ms to 12000 rev/min");
    let speed = bench.last().sample.spindle_speed;
    assert!((speed - 12_000.0).abs() < 120.0, "{speed}");
    bench.half.request(Request::CycleStart);
    bench.run(5000);
    assert_eq!((bench.state(), bench.last().sample.spindle_speed), (State::Ready, 0.0));
    assert_eq!(bench.counters().completed, 6);
}

#[test]
fn loads_and_currents_carry_noise_of_at_least_four_quanta() {
    let mut bench = Bench::new(vec![]);
    bench.run(2000);
    for name in ["X.LOAD", "Y.AMPERAGE", "Z.LOAD", "S1.LOAD"] {
        let channel = machine::CHANNELS.iter().find(|c| c.name == name).expect("it is one");
        let values: Vec<f64> = bench.reports.iter().map(|r| f64::from(channel.quantise(&r.sample))).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let rms = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        assert!(rms >= 4.0, "{name}: {rms} quanta");
    }
}

#[test]
fn a_path_is_not_begun_before_there_is_enough_of_it_to_stop_on() {
    let mut bench = Bench::new(ordinary());
    let later = bench.queue.split_off(5);
    bench.run(100);
    assert_eq!(bench.state(), State::Waiting(machine::Wait::Commands));
    assert_eq!(bench.last().sample.commanded, bench.reports[0].sample.commanded);
    bench.queue = later;
    bench.run(3000);
    assert!(bench.last().idle, "{:?}", bench.state());
    assert_eq!(bench.counters().starved_ticks, 0);
}

#[test]
fn switching_that_is_not_waited_for_is_done_at_rest_though_nothing_follows_it() {
    let mut program = ordinary();
    program.push(Command::Workingstep {
        workingstep: WorkingstepId(2),
        step: StepId(9000),
    });
    let count = program.len() as u64;
    let mut bench = Bench::new(program);
    bench.run(3000);
    assert!(bench.last().idle, "{:?}", bench.state());
    assert_eq!((bench.counters().completed, bench.counters().starvations), (count, 0));
    assert_eq!(bench.last().sample.workingstep, WorkingstepId(2));
}

/// A circle whose bend alone takes all of the acceleration that an axis has: 200 mm/s on radius 13.33 mm.
fn tight() -> Vec<Command> {
    circle(40.0 / 3.0, 200.0, 1500.0)
}

#[test]
fn holds_and_stalls_anywhere_on_a_bend_at_the_limit_stay_on_it() {
    let mut worst: f64 = 0.0;
    for at in (8..530).step_by(7) {
        for stall in [false, true] {
            let mut bench = Bench::new(tight());
            if stall {
                // Only what was queued by then is there: the rest comes later.
                let later = bench.queue.split_off(at);
                bench.run(1500);
                bench.stands();
                // Hardly begun, it waits for more; further on it is a stop.
                let waits = at < 12 && bench.state() == State::Waiting(machine::Wait::Commands);
                assert!(
                    waits || bench.state() == State::Stopped(StopCause::Starved),
                    "stall at {at}: {:?}",
                    bench.state()
                );
                bench.queue = later;
                bench.run(2);
            } else {
                bench.run(at as u64);
                bench.half.request(Request::Hold);
                bench.run(400);
                assert_eq!(bench.state(), State::Held, "hold at {at}");
                bench.stands();
            }
            bench.half.request(Request::CycleStart);
            bench.run(1500);
            assert!(bench.last().idle, "{at} {stall}: {:?}", bench.state());
            assert_eq!(bench.counters().off_path_stops, 0, "{at} {stall}");
            for r in &bench.reports {
                let off = off_circle(40.0 / 3.0, r.sample.commanded);
                assert!(off < 0.002, "{at} {stall}: {off} mm off at {:?}", r.sample);
            }
            worst = worst.max(bench.worst_acceleration());
        }
    }
    // The ramps of this path itself, 1500 along and up to 3000 across, reach 3354.
    println!("worst commanded acceleration {worst:.0} mm/s^2");
    assert!(worst < 3800.0, "{worst}");
}

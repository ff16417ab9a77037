//! Overrides, holds and resumes of a program, threads, and tool changes with their ways and lengths.

use machine::{
    Command, CoolantOutlets, MachineParameters, Overrides, Plant, Quality, RealtimeHalf, Report, Request, SetPoint,
    SpindleCommand, State, StopCause, Wait,
};
use units::{Millimetres, Point, Rpm, StepId, Tick, ToolNumber};

const T: f64 = 0.001;
const A: f64 = 2000.0;
const J: f64 = 40_000.0;

struct Bench {
    // On the heap: its queues and conditions are large for the stack of a test.
    half: Box<RealtimeHalf<Plant>>,
    now: Tick,
    queue: std::collections::VecDeque<Command>,
    reports: Vec<Report>,
}

impl Bench {
    fn new(commands: Vec<Command>) -> Bench {
        Bench::with(&MachineParameters::small_machining_centre(), commands)
    }

    fn with(parameters: &MachineParameters, commands: Vec<Command>) -> Bench {
        parameters.check().expect("a sound machine");
        let plant = Plant::new(parameters, Point::ORIGIN, 7);
        let mut bench = Bench {
            half: Box::new(RealtimeHalf::new(parameters, plant, Quality::Simulated)),
            now: Tick(0),
            queue: std::collections::VecDeque::new(),
            reports: Vec::new(),
        };
        bench.half.request(Request::PowerOn);
        bench.run(1);
        bench.queue.extend(commands);
        bench
    }

    fn run(&mut self, cycles: u64) -> &mut Self {
        for _ in 0..cycles {
            while let Some(command) = self.queue.pop_front() {
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

    fn run_until(&mut self, longest: u64, done: impl Fn(&Report) -> bool) -> u64 {
        for n in 0..longest {
            if done(self.run(1).last()) {
                return n;
            }
        }
        panic!("not in {longest} ms: {:?}", self.last());
    }

    fn set(&mut self, feed: u8, rapid: u8, spindle: u8) -> &mut Self {
        self.half.request(Request::Override(Overrides { feed, rapid, spindle }));
        self
    }

    fn state(&self) -> State {
        self.half.controller().state()
    }

    fn last(&self) -> &Report {
        self.reports.last().expect("it ran")
    }

    fn speed(&self) -> f64 {
        self.last().sample.path_speed
    }

    fn worst_jerk(&self) -> f64 {
        let jerk = |w: &[Report], k: usize| {
            let p = |i: usize| w[i].sample.commanded[k];
            (p(3) - 3.0 * p(2) + 3.0 * p(1) - p(0)).abs() / (T * T * T)
        };
        self.reports
            .windows(4)
            .flat_map(|w| (0..3).map(move |k| jerk(w, k)))
            .fold(0.0, f64::max)
    }
}

/// Speed and acceleration at a time of a motion with limited jerk that gets from rest to `speed`; `None` when it is there.
fn speeding_up(t: f64, speed: f64) -> Option<(f64, f64, f64)> {
    // Jerk, no acceleration constant: short enough for the speeds used here.
    assert!(speed <= A * A / J, "a test's speed");
    let half = (speed / J).sqrt();
    if t <= half {
        Some((J * t * t * t / 6.0, J * t * t / 2.0, J * t))
    } else if t <= 2.0 * half {
        let left = 2.0 * half - t;
        let s = speed * half - (speed * left - J * left * left * left / 6.0);
        Some((s, speed - J * left * left / 2.0, J * left))
    } else {
        None
    }
}

/// A straight move along X from rest to rest with limited jerk.
fn line(from: f64, to: f64, speed: f64, shape: impl Fn(&mut SetPoint)) -> Vec<Command> {
    let length = (to - from).abs();
    let way = (to - from).signum();
    let ramp = 2.0 * (speed / J).sqrt();
    let total = length / speed + ramp;
    (1..=(total / T).ceil() as u32)
        .map(|n| {
            let t = (f64::from(n) * T).min(total);
            let (s, v, a) = match (speeding_up(t, speed), speeding_up(total - t, speed)) {
                (Some(up), _) => up,
                (None, Some((s, v, a))) => (length - s, v, -a),
                (None, None) => (speed * (t - ramp / 2.0), speed, 0.0),
            };
            let v = if t == total { 0.0 } else { v };
            let mut point = SetPoint {
                position: [from + way * s, 0.0, 0.0],
                velocity: [way * v, 0.0, 0.0],
                acceleration: [way * a, 0.0, 0.0],
                step: StepId(1),
                path_length: s,
                path_speed: v,
                ..SetPoint::default()
            };
            shape(&mut point);
            Command::SetPoint(point)
        })
        .collect()
}

fn feed(from: f64, to: f64, speed: f64) -> Vec<Command> {
    line(from, to, speed, |_| {})
}

fn spindle(rpm: f64) -> Command {
    Command::Spindle {
        spindle: SpindleCommand::Clockwise(Rpm(rpm)),
        step: StepId(1),
    }
}

#[test]
fn a_hold_and_every_override_below_100_percent_are_steady_within_50_ms_at_a_cutting_feed() {
    for percent in [0, 10, 50, 90, 99] {
        // 1 m/min.
        let mut bench = Bench::new(feed(0.0, 60.0, 16.7));
        bench.run(500).set(percent, 100, 100);
        let wanted = 16.7 * f64::from(percent) / 100.0;
        let time = bench.run_until(100, |r| (r.sample.path_speed - wanted).abs() < 1e-3);
        assert!(time < 50, "{percent} %: {time} ms");
        bench.run(300);
        assert!(
            (bench.speed() - wanted).abs() < 1e-6 && bench.state() == State::Running,
            "{percent} %: {}",
            bench.speed()
        );
        bench.set(100, 100, 100);
        let time = bench.run_until(100, |r| (r.sample.path_speed - 16.7).abs() < 1e-3);
        assert!(time < 50, "back from {percent} %: {time} ms");
        bench.run_until(6000, |r| r.idle);
        assert_eq!(bench.last().sample.commanded[0], 60.0);
        assert!(bench.worst_jerk() < 51_000.0, "{}", bench.worst_jerk());
    }
    let mut bench = Bench::new(feed(0.0, 60.0, 16.7));
    bench.run(500).half.request(Request::Hold);
    let time = bench.run_until(100, |r| r.state == State::Held);
    assert!(time < 50, "held after {time} ms");
    assert!(bench.worst_jerk() < 51_000.0, "{}", bench.worst_jerk());
}

#[test]
fn feed_0_stands_on_the_path_and_is_no_hold() {
    let mut bench = Bench::new(feed(0.0, 30.0, 50.0));
    bench.run(300).set(0, 100, 100).run(2000);
    assert_eq!((bench.state(), bench.speed()), (State::Running, 0.0));
    let at = bench.last().sample.commanded[0];
    assert!(at > 5.0 && at < 25.0 && bench.last().sample.velocity[0].abs() < 1.0);
    bench.set(100, 100, 100).run_until(3000, |r| r.idle);
    assert_eq!(bench.last().sample.commanded[0], 30.0);
    // From the beginning it does not even start.
    let mut bench = Bench::new(feed(0.0, 30.0, 50.0));
    bench.set(0, 100, 100).run(500);
    assert_eq!(bench.last().sample.commanded[0], 0.0);
    bench.set(10, 100, 100).run(1000);
    assert!((bench.speed() - 5.0).abs() < 1e-9, "{}", bench.speed());
}

#[test]
fn rapids_go_by_the_rapid_override_alone_and_never_faster_than_planned() {
    let mut bench = Bench::new(line(0.0, 60.0, 90.0, |s| s.rapid = true));
    bench.set(0, 50, 100).run(400);
    assert!((bench.speed() - 45.0).abs() < 1e-6, "{}", bench.speed());
    bench.set(0, 200, 100).run(300);
    assert!((bench.speed() - 90.0).abs() < 1e-6, "{}", bench.speed());
    assert_eq!(bench.last().overrides.rapid, 100);
}

#[test]
fn what_was_planned_for_150_percent_runs_at_that_and_slower_below() {
    let planned = |s: &mut SetPoint| s.planned_override = 1.5;
    for (percent, speed) in [(150, 60.0), (200, 60.0), (100, 40.0), (75, 30.0)] {
        let mut bench = Bench::new(line(0.0, 60.0, 60.0, planned));
        bench.set(percent, 100, 100).run(500);
        assert!((bench.speed() - speed).abs() < 1e-6, "{percent} %: {}", bench.speed());
    }
}

#[test]
fn a_thread_ignores_overrides_and_a_hold_waits_for_its_end_but_a_stop_does_not() {
    let program = || {
        let mut program = vec![spindle(1000.0)];
        program.extend(line(0.0, 20.0, 25.0, |s| s.planned_override = 0.0));
        program.extend(feed(20.0, 40.0, 25.0));
        program
    };
    let mut bench = Bench::new(program());
    bench.set(50, 100, 50);
    // The spindle comes to half its speed, and to all of it for the thread.
    bench.run_until(4000, |r| r.sample.path_speed > 24.9);
    assert!(
        (bench.last().sample.spindle_speed - 1000.0).abs() < 12.0,
        "{}",
        bench.last().sample.spindle_speed
    );
    bench.half.request(Request::Hold);
    bench.run(300);
    assert!((bench.speed() - 25.0).abs() < 1e-9);
    bench.run_until(2000, |r| r.state == State::Held);
    assert!((bench.last().sample.commanded[0] - 20.0).abs() < 0.001);
    bench.half.request(Request::CycleStart);
    bench.run_until(4000, |r| r.sample.path_speed > 12.4);
    bench.run(1000);
    assert!((bench.speed() - 12.5).abs() < 1e-6);
    assert!(
        (bench.last().sample.spindle_speed - 500.0).abs() < 30.0,
        "{}",
        bench.last().sample.spindle_speed
    );

    let mut bench = Bench::new(program());
    bench.run_until(4000, |r| r.sample.path_speed > 24.9);
    bench.half.request(Request::Stop);
    bench.run(100);
    assert_eq!(bench.state(), State::Stopped(StopCause::Asked));
}

#[test]
fn the_spindle_override_scales_what_is_programmed_within_what_the_spindle_can() {
    let mut bench = Bench::new(vec![spindle(8000.0)]);
    bench.run(4000);
    for (percent, rpm) in [(50, 4000.0), (120, 9600.0), (0, 0.0), (200, 16_000.0)] {
        bench.set(100, 100, percent).run(4000);
        let n = bench.last().sample.spindle_speed;
        assert!((n - rpm).abs() < 10.0, "{percent} %: {n}");
    }
    let mut bench = Bench::new(vec![spindle(20_000.0)]);
    bench.set(100, 100, 200).run(9000);
    assert_eq!(bench.last().orders.spindle, SpindleCommand::Clockwise(Rpm(24_000.0)));
    // Beyond 200 % there is nothing.
    bench.set(255, 255, 255).run(1);
    let highest = Overrides {
        feed: 200,
        rapid: 100,
        spindle: 200,
    };
    assert_eq!(bench.last().overrides, highest);
}

#[test]
fn a_resume_brings_spindle_and_coolant_back_before_the_path_goes_on() {
    let flood = CoolantOutlets {
        flood: true,
        ..CoolantOutlets::default()
    };
    let mut program = vec![
        spindle(6000.0),
        Command::Coolant {
            outlets: flood,
            step: StepId(1),
        },
    ];
    program.extend(feed(0.0, 60.0, 30.0));
    let mut bench = Bench::new(program);
    bench.run_until(4000, |r| r.sample.commanded[0] > 10.0);
    // Nobody stops the spindle of a tool that cuts.
    bench.half.request(Request::StopSpindle);
    bench.run(20);
    assert!(bench.last().sample.spindle_speed > 5900.0);
    bench.half.request(Request::Hold);
    bench.run_until(500, |r| r.state == State::Held);
    bench.half.request(Request::StopSpindle);
    bench.run(3000);
    assert_eq!(
        (bench.last().sample.spindle_speed, bench.last().orders.coolant),
        (0.0, CoolantOutlets::default())
    );
    let at = bench.last().sample.commanded;
    bench.half.request(Request::CycleStart);
    bench.run(2);
    assert_eq!((bench.state(), bench.last().orders.coolant), (State::Resuming, flood));
    bench.run_until(4000, |r| r.state == State::Running);
    assert!(bench.last().sample.spindle_speed > 5900.0);
    let waited: Vec<&Report> = bench.reports.iter().filter(|r| r.state == State::Resuming).collect();
    assert!(waited.len() > 100 && waited.iter().all(|r| r.sample.commanded == at));
    // A hold while it waits is a hold.
    bench.run_until(4000, |r| r.idle);
    assert_eq!(bench.last().sample.commanded[0], 60.0);
}

fn tool(number: u32) -> Command {
    Command::Tool {
        tool: ToolNumber(number),
        step: StepId(2),
    }
}

fn length(length: f64) -> Command {
    Command::ToolLength { length, step: StepId(2) }
}

/// X as [`feed`], seen from the tip of a tool.
fn tip(from: f64, to: f64) -> Vec<Command> {
    feed(from, to, 40.0)
}

#[test]
fn a_tool_change_goes_to_its_place_z_first_and_comes_back_by_the_difference_of_the_lengths_z_last() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.tool_change_at = Some([Millimetres(-50.0), Millimetres(30.0), Millimetres(80.0)]);
    let mut program = tip(0.0, 10.0);
    program.extend([length(34.0), tool(1)]);
    program.extend(tip(10.0, 20.0));
    program.extend([length(30.0), tool(2)]);
    program.extend(tip(20.0, 30.0));
    let mut bench = Bench::with(&parameters, program);
    bench.run_until(60_000, |r| r.idle && r.sample.commanded[0] == 30.0);
    assert_eq!(bench.half.controller().counters().off_path_stops, 0);
    let waits: Vec<State> = bench.reports.iter().map(|r| r.state).collect();
    for wait in [Wait::ToolAway, Wait::Tool, Wait::ToolBack] {
        assert!(waits.contains(&State::Waiting(wait)), "{wait:?} is not seen");
    }
    let during = |wait: Wait| bench.reports.iter().filter(move |r| r.state == State::Waiting(wait));
    assert!(during(Wait::Tool).all(|r| {
        r.sample
            .commanded
            .iter()
            .zip([-50.0, 30.0, 80.0])
            .all(|(c, p)| (c - p).abs() < 0.001)
    }));
    // X and Y move only while Z is up.
    let low: Vec<&Report> = during(Wait::ToolAway)
        .chain(during(Wait::ToolBack))
        .filter(|r| r.sample.commanded[2] < 79.9)
        .collect();
    let on_the_path = |r: &&Report| {
        let [x, y, _] = r.sample.commanded;
        ((x - 10.0).abs() < 0.001 || (x - 20.0).abs() < 0.001) && y.abs() < 0.001
    };
    assert!(low.len() > 100 && low.iter().all(on_the_path));
    // The tip is where it was: gauge at 34, then at 30.
    let z_at = |x: f64| {
        bench
            .reports
            .iter()
            .find(|r| (r.sample.commanded[0] - x).abs() < 0.3 && r.sample.path_speed > 39.0)
    };
    assert_eq!(z_at(5.0).map(|r| r.sample.commanded[2]), Some(0.0));
    assert_eq!(z_at(15.0).map(|r| r.sample.commanded[2]), Some(34.0));
    assert_eq!(z_at(25.0).map(|r| r.sample.commanded[2]), Some(30.0));
    assert_eq!(bench.last().sample.tool, ToolNumber(2));
}

#[test]
fn without_a_place_for_it_a_longer_tool_is_lifted_before_and_a_shorter_one_lowered_after_the_change() {
    let program = vec![length(20.0), tool(1), length(5.0), tool(2)];
    let mut bench = Bench::new(program);
    bench.run_until(20_000, |r| r.idle && r.sample.tool == ToolNumber(2));
    let exchanging: Vec<&Report> = bench
        .reports
        .iter()
        .filter(|r| r.state == State::Waiting(Wait::Tool))
        .collect();
    assert!(exchanging.len() > 4900 && exchanging.iter().all(|r| (r.sample.commanded[2] - 20.0).abs() < 0.001));
    assert!((bench.last().sample.commanded[2] - 5.0).abs() < 0.001);
}

#[test]
fn a_tool_so_long_that_z_would_leave_its_travel_is_a_controlled_stop_before_the_change() {
    for bad in [1500.0, -1500.0, f64::NAN] {
        let mut bench = Bench::new(vec![length(bad), tool(1)]);
        bench.run(500);
        assert!(
            matches!(
                bench.state(),
                State::Stopped(StopCause::SoftLimit { axis: 2 } | StopCause::Jump { axis: 2 })
            ),
            "{bad}: {:?}",
            bench.state()
        );
        assert_eq!(bench.last().sample.commanded, [0.0; 3]);
    }
}

#[test]
fn a_hold_in_a_tool_change_finishes_it_and_a_stop_on_its_way_stops_the_axes() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.tool_change_at = Some([Millimetres(-50.0), Millimetres(30.0), Millimetres(80.0)]);
    let mut program = vec![tool(1)];
    program.extend(feed(0.0, 10.0, 40.0));
    let mut bench = Bench::with(&parameters, program.clone());
    bench.run(200).half.request(Request::Hold);
    bench.run_until(10_000, |r| r.state == State::Held);
    assert_eq!(
        (bench.last().sample.tool, bench.last().sample.commanded),
        (ToolNumber(1), [0.0; 3])
    );
    bench.half.request(Request::CycleStart);
    bench.run_until(10_000, |r| r.idle);
    assert_eq!(bench.last().sample.commanded[0], 10.0);

    let mut bench = Bench::with(&parameters, program);
    bench.run(200).half.request(Request::Stop);
    bench.run(300);
    assert_eq!(bench.state(), State::Stopped(StopCause::Asked));
    let z = bench.last().sample.commanded[2];
    assert!(z > 1.0 && z < 79.0 && bench.last().sample.path_speed == 0.0, "{z}");
    bench.queue.clear();
    bench.half.request(Request::Reset);
    bench.run(20);
    assert_eq!(bench.state(), State::Ready);
    assert!((bench.last().sample.commanded[2] - z).abs() < 0.001);
    let c = bench.half.controller().counters();
    assert_eq!(c.accepted, c.completed + c.discarded + bench.half.controller().outstanding());
}

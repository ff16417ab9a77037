//! How well the axes follow: circles, reversals, ends of rapids; and the wait until they are in position.
#![allow(clippy::disallowed_methods, reason = "tests may square a number")]

use machine::{
    Command, MachineParameters, Phase, Plant, Quality, RealtimeHalf, Report, Request, SetPoint, SpindleCommand, State, StopCause,
    Wait,
};
use units::{Millimetres, Point, Rpm, Seconds, StepId, Tick, ToolNumber};

const T: f64 = 0.001;

/// Runs commands until the machine is idle or `cycles` are over.
struct Run {
    // On the heap: its queues and conditions are large for the stack of a test.
    half: Box<RealtimeHalf<Plant>>,
    now: Tick,
    queue: std::collections::VecDeque<Command>,
    reports: Vec<Report>,
}

impl Run {
    fn new(parameters: &MachineParameters, commands: Vec<Command>) -> Run {
        let mut half = Box::new(RealtimeHalf::new(
            parameters,
            Plant::new(parameters, Point::ORIGIN, 7),
            Quality::Simulated,
        ));
        half.request(Request::PowerOn);
        half.tick(Tick(0));
        half.report();
        Run {
            half,
            now: Tick(1),
            queue: commands.into(),
            reports: Vec::new(),
        }
    }

    fn cycles(&mut self, cycles: u64) -> &mut Self {
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

    fn state(&self) -> State {
        self.half.controller().state()
    }

    /// Cycles in which it waited for the axes.
    fn waited(&self) -> usize {
        let waits = |r: &&Report| {
            matches!(
                r.state,
                State::Waiting(Wait::Position) | State::WaitingThenHold(Wait::Position)
            )
        };
        self.reports.iter().filter(waits).count()
    }

    /// Largest following error of any axis in a step, mm.
    fn worst_error_in(&self, step: u32) -> f64 {
        let rows = self
            .reports
            .iter()
            .filter(|r| r.sample.step == StepId(step) && r.sample.path_speed > 0.0);
        rows.map(error).fold(0.0, f64::max)
    }

    #[track_caller]
    fn nothing_is_lost(&self) {
        let c = self.half.controller().counters();
        assert_eq!(c.accepted, c.completed + c.discarded + self.half.controller().outstanding());
    }

    fn run_to_end(&mut self) -> &mut Self {
        for _ in 0..600 {
            self.cycles(100);
            if self.queue.is_empty() && self.reports.last().is_some_and(|r| r.idle) {
                return self;
            }
        }
        panic!("does not end: {:?}", self.half.controller().state());
    }
}

/// Largest following error of any axis, mm.
fn error(report: &Report) -> f64 {
    let s = &report.sample;
    (0..3).map(|k| (s.commanded[k] - s.actual[k]).abs()).fold(0.0, f64::max)
}

/// Motion along a curve by its length, from rest to rest with trapezoidal speed.
fn along(length: f64, speed: f64, acceleration: f64, step: u32, place: impl Fn(f64) -> [[f64; 3]; 3]) -> Vec<Command> {
    let speed = speed.min((length * acceleration).sqrt());
    let ramp = speed / acceleration;
    let total = length / speed + ramp;
    (1..=(total / T).ceil() as u32)
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
            let [position, tangent, bend] = place(s);
            Command::SetPoint(SetPoint {
                position,
                velocity: tangent.map(|d| d * v),
                acceleration: std::array::from_fn(|k| tangent[k] * a + bend[k] * v * v),
                step: StepId(step),
                path_length: s,
                path_speed: v,
                ..SetPoint::default()
            })
        })
        .collect()
}

fn line(from: [f64; 3], to: [f64; 3], speed: f64, step: u32) -> Vec<Command> {
    let way: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
    let length = way.iter().map(|d| d * d).sum::<f64>().sqrt();
    let unit = way.map(|d| d / length);
    along(length, speed, 2900.0, step, move |s| {
        [std::array::from_fn(|k| from[k] + unit[k] * s), unit, [0.0; 3]]
    })
}

/// `turns` of a circle in the plane of two axes that begins in the origin.
fn circle(axes: [usize; 2], radius: f64, speed: f64, turns: f64) -> Vec<Command> {
    let [i, j] = axes;
    along(std::f64::consts::TAU * radius * turns, speed, 1000.0, 1, move |s| {
        let (sin, cos) = libm::sincos(s / radius);
        let mut out = [[0.0; 3]; 3];
        (out[0][i], out[0][j]) = (radius * (cos - 1.0), radius * sin);
        (out[1][i], out[1][j]) = (-sin, cos);
        (out[2][i], out[2][j]) = (-cos / radius, -sin / radius);
        out
    })
}

/// Deviation of the encoders from a circle, mm: 95 % of it and the largest.
fn off_circle(parameters: &MachineParameters, axes: [usize; 2], radius: f64, speed: f64) -> (f64, f64) {
    let mut run = Run::new(parameters, circle(axes, radius, speed, 3.0));
    run.run_to_end();
    let mut off: Vec<f64> = run
        .reports
        .iter()
        .filter(|r| r.sample.phase == Phase::Running && r.sample.path_speed > 0.99 * speed)
        .map(|r| {
            let p = r.sample.actual;
            ((p[axes[0]] + radius).hypot(p[axes[1]]) - radius).abs()
        })
        .collect();
    off.sort_by(f64::total_cmp);
    (off[off.len() * 95 / 100], off[off.len() - 1])
}

#[test]
fn circles_show_their_quadrants_by_a_few_micrometres() {
    let parameters = MachineParameters::small_machining_centre();
    // Radius, speed; 95 % and all of the rows are nearer to the circle than this, um.
    for (radius, speed, most, all) in [
        (2.0, 5.0, 1.5, 6.0),
        (7.0, 16.0, 1.5, 5.0),
        (10.0, 5.0, 1.5, 6.0),
        (10.0, 20.0, 1.5, 5.0),
        (10.0, 100.0, 3.0, 5.0),
        (30.0, 300.0, 7.0, 9.0),
    ] {
        for axes in [[0, 1], [0, 2], [1, 2]] {
            let (p95, worst) = off_circle(&parameters, axes, radius, speed);
            println!(
                "{axes:?} R {radius} at {speed} mm/s: p95 {:.2} um, max {:.2} um",
                p95 * 1e3,
                worst * 1e3
            );
            assert!(
                p95 * 1e3 < most && worst * 1e3 < all,
                "{axes:?} R {radius} at {speed} mm/s: {p95}, {worst} mm"
            );
        }
    }
}

#[test]
fn with_half_of_the_friction_unknown_a_circle_is_still_a_circle() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.axes.iter_mut().for_each(|a| a.servo.friction_compensation = 0.5);
    let (p95, worst) = off_circle(&parameters, [0, 1], 10.0, 20.0);
    println!("p95 {:.2} um, max {:.2} um", p95 * 1e3, worst * 1e3);
    assert!(p95 < 0.004 && worst < 0.015, "{p95}, {worst} mm");
}

#[test]
fn the_force_of_a_cut_and_the_way_back_out_of_it_are_taken_up() {
    for (name, parameters, feed, allowed) in [
        ("mill", MachineParameters::small_machining_centre(), 20.0, 0.010),
        // 660 N, on a screw of 40 mm a turn.
        ("lathe", MachineParameters::small_lathe(), 11.0, 0.025),
    ] {
        for axis in 0..3 {
            let to = |q: f64| std::array::from_fn(|k| if k == axis { q } else { 0.0 });
            let mut program = vec![Command::Spindle {
                spindle: SpindleCommand::Clockwise(Rpm(2000.0)),
                step: StepId(0),
            }];
            program.extend(line(to(0.0), to(-20.0), 400.0, 1));
            program.extend(line(to(-20.0), to(-30.0), feed, 2));
            program.extend(line(to(-30.0), to(-20.0), feed, 3));
            program.extend(line(to(-20.0), to(20.0), 400.0, 4));
            let mut run = Run::new(&parameters, program);
            run.run_to_end();
            let worst = [1, 2, 3, 4].map(|step| run.worst_error_in(step));
            println!("{name}, axis {axis}: {worst:.4?}");
            assert!(worst.iter().all(|e| *e < allowed), "{name}, axis {axis}: {worst:.4?}");
        }
    }
}

#[test]
fn the_tail_of_a_rapid_is_gone_before_the_feed_begins() {
    let parameters = MachineParameters::small_machining_centre();
    for to in [[-30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, -30.0], [-10.0, 0.0, 40.0]] {
        let mut program = line([0.0; 3], to, 400.0, 1);
        program.extend(line(to, to.map(|t| t / 2.0), 5.0, 2));
        let mut run = Run::new(&parameters, program);
        run.run_to_end();
        println!(
            "{to:?}: rapid {:.4}, feed {:.4} mm",
            run.worst_error_in(1),
            run.worst_error_in(2)
        );
        assert!(run.worst_error_in(1) < 0.010 && run.worst_error_in(2) < 0.006);
    }
}

/// Where the rapid ends: between two pulses.
const END: f64 = 20.0004;

/// A rapid and a feed from where it rests, on an axis so weak that friction keeps it away from its end for a while.
fn rapid_then_feed() -> (MachineParameters, Vec<Command>) {
    let mut parameters = MachineParameters::small_machining_centre();
    let servo = &mut parameters.axes[0].servo;
    (servo.friction_compensation, servo.velocity, servo.integral_time) = (0.0, 0.15, 0.12);
    let mut program = line([0.0; 3], [END, 0.0, 0.0], 400.0, 1);
    program.extend(line([END, 0.0, 0.0], [END, 5.0, 0.0], 20.0, 2));
    (parameters, program)
}

#[test]
fn a_feed_behind_a_rapid_waits_until_the_axes_are_in_position() {
    let (parameters, program) = rapid_then_feed();
    let count = program.len() as u64;
    let mut run = Run::new(&parameters, program);
    run.run_to_end();
    let waiting: Vec<&Report> = run
        .reports
        .iter()
        .filter(|r| r.state == State::Waiting(Wait::Position))
        .collect();
    println!("waited {} ms", waiting.len());
    assert!((3..200).contains(&waiting.len()), "{}", waiting.len());
    for r in &waiting {
        // Held where it came to rest, in the name of the rapid.
        assert_eq!((r.sample.phase, r.sample.path_speed), (Phase::Waiting, 0.0));
        assert!(r.sample.commanded == [END, 0.0, 0.0] && r.sample.step == StepId(1) || r.sample.step == StepId(2));
        assert!(error(r) > 0.010);
    }
    let first = run.reports.iter().find(|r| r.sample.step == StepId(2)).expect("it feeds");
    assert!(error(first) <= 0.0101, "{}", error(first));
    let c = run.half.controller().counters();
    assert_eq!(
        (c.completed, c.in_position_time_outs, c.off_path_stops, c.starvations),
        (count, 0, 0, 0)
    );
}

#[test]
fn a_blended_corner_does_not_wait() {
    let (parameters, program) = rapid_then_feed();
    // The same way, but slowed down to 1 mm/s only.
    let program: Vec<Command> = program
        .into_iter()
        .map(|c| match c {
            Command::SetPoint(mut s) if s.velocity == [0.0; 3] => {
                s.velocity[0] = 1.0;
                Command::SetPoint(s)
            }
            c => c,
        })
        .collect();
    let mut run = Run::new(&parameters, program);
    run.cycles(1_000);
    assert_eq!(run.waited(), 0);
}

#[test]
fn at_standstill_a_rest_costs_nothing() {
    let parameters = MachineParameters::small_machining_centre();
    let stay = Command::SetPoint(SetPoint::default());
    let mut run = Run::new(&parameters, vec![stay; 300]);
    run.cycles(302);
    assert_eq!((run.waited(), run.half.controller().counters().completed), (0, 300));
}

#[test]
fn an_axis_that_never_gets_there_is_counted_and_the_program_goes_on() {
    let (mut parameters, mut program) = rapid_then_feed();
    // Less than a pulse is never reached.
    parameters.in_position = Millimetres(1e-6);
    parameters.in_position_time_out = Seconds(0.05);
    program.truncate(program.len() - 10);
    program.retain(|c| matches!(c, Command::SetPoint(s) if s.step == StepId(1)));
    let mut run = Run::new(&parameters, program);
    run.cycles(500);
    assert_eq!((run.waited(), run.state()), (50, State::Waiting(Wait::Commands)));
    assert_eq!(run.half.controller().counters().in_position_time_outs, 1);
    run.nothing_is_lost();
}

#[test]
fn a_tool_change_begins_in_position_and_a_starved_queue_waits_too() {
    let (parameters, program) = rapid_then_feed();
    let (rapid, feed): (Vec<Command>, Vec<Command>) = program
        .into_iter()
        .partition(|c| matches!(c, Command::SetPoint(s) if s.step == StepId(1)));
    let mut run = Run::new(&parameters, rapid);
    run.run_to_end();
    assert!(run.waited() > 3);
    assert_eq!(run.state(), State::Waiting(Wait::Commands));
    let before = run.waited();
    run.queue.push_back(Command::Tool {
        tool: ToolNumber(1),
        step: StepId(9),
    });
    run.queue.extend(feed);
    run.run_to_end();
    let changing = run
        .reports
        .iter()
        .find(|r| r.state == State::Waiting(Wait::Tool))
        .expect("it changes");
    assert!(error(changing) < 0.0101);
    println!("waited {before}, then {} ms", run.waited() - before);
    run.nothing_is_lost();
    assert_eq!(run.half.controller().counters().discarded, 0);
}

#[test]
fn a_hold_or_a_stop_while_it_waits_takes_effect_and_loses_nothing() {
    for stop in [false, true] {
        let (parameters, program) = rapid_then_feed();
        let mut run = Run::new(&parameters, program);
        while run.waited() == 0 {
            assert!(run.cycles(1).now < Tick(1_000), "it does not wait");
        }
        run.half.request(if stop { Request::Stop } else { Request::Hold });
        run.cycles(300);
        run.nothing_is_lost();
        if stop {
            assert_eq!(run.state(), State::Stopped(StopCause::Asked));
            assert_eq!(run.half.controller().counters().discarded, 0);
            continue;
        }
        assert_eq!(run.state(), State::Held);
        run.half.request(Request::CycleStart);
        run.run_to_end();
        run.nothing_is_lost();
        assert_eq!(run.reports.last().map(|r| r.sample.commanded), Some([END, 5.0, 0.0]));
    }
}

//! Without a program: homing, going home, the joystick, and what a person is told of it.

use machine::{
    Command, ControlPad, DriveMode, FaultCause, HomingStage, MachineParameters, Mode, Notices, PadState, Plant, Quality,
    RealtimeHalf, Report, Request, SetPoint, SpindleCommand, State,
};
use units::{Millimetres, Point, Rpm, StepId, Tick};

/// A pad that shows what the test sets.
#[derive(Default)]
struct Pad(Option<PadState>);

impl ControlPad for Pad {
    fn read(&mut self, _now: Tick) -> Option<PadState> {
        self.0
    }
}

struct Bench {
    // On the heap: its queues and conditions are large for the stack of a test.
    half: Box<RealtimeHalf<Plant, Pad>>,
    now: Tick,
    reports: Vec<Report>,
}

impl Bench {
    fn new(parameters: &MachineParameters, start: [f64; 3]) -> Bench {
        parameters.check().expect("a sound machine");
        let plant = Plant::new(parameters, Point::from_xyz(start), 7);
        let mut bench = Bench {
            half: Box::new(RealtimeHalf::with_pad(parameters, plant, Pad::default(), Quality::Simulated)),
            now: Tick(0),
            reports: Vec::new(),
        };
        bench.half.request(Request::PowerOn);
        bench.run(1);
        bench
    }

    fn run(&mut self, cycles: u64) -> &mut Self {
        for _ in 0..cycles {
            self.half.tick(self.now);
            self.reports.extend(self.half.report());
            self.now += 1;
        }
        self
    }

    fn run_until(&mut self, longest: u64, done: impl Fn(&Report) -> bool) -> u64 {
        for n in 0..longest {
            self.run(1);
            if done(self.last()) {
                return n;
            }
        }
        panic!("not in {longest} ms: {:?} at {:?}", self.state(), self.last().sample.actual);
    }

    /// Shows a state of the pad; a joystick that goes to another axis passes its middle.
    fn pad(&mut self, pad: PadState) -> &mut Self {
        let before = self.half.pad_mut().0;
        if before.is_none_or(|b| b.selector != pad.selector || b.emergency_stop) && !pad.emergency_stop {
            self.half.pad_mut().0 = Some(PadState { joystick: 0.0, ..pad });
            self.run(1);
        }
        self.half.pad_mut().0 = Some(pad);
        self
    }

    fn state(&self) -> State {
        self.half.controller().state()
    }

    fn last(&self) -> &Report {
        self.reports.last().expect("it ran")
    }

    fn notices(&self) -> Vec<Notices> {
        self.reports.iter().map(|r| r.notices).filter(|n| !n.is_empty()).collect()
    }

    /// Largest speed and acceleration of any axis by differences of what was commanded; a cycle in which a reference was found is no motion.
    fn worst(&self) -> (f64, f64) {
        let (mut v_most, mut a_most) = (0f64, 0f64);
        for w in self.reports.windows(3) {
            for k in 0..3 {
                let p = |i: usize| w[i].sample.commanded[k];
                if (p(2) - p(1)).abs() < 1.0 && (p(1) - p(0)).abs() < 1.0 {
                    v_most = v_most.max((p(2) - p(1)).abs() / 1e-3);
                    a_most = a_most.max((p(2) - 2.0 * p(1) + p(0)).abs() / 1e-6);
                }
            }
        }
        (v_most, a_most)
    }
}

fn incremental() -> MachineParameters {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.absolute_encoders = false;
    for axis in &mut parameters.axes {
        (axis.lowest, axis.highest) = (Millimetres(-400.0), Millimetres(100.0));
        axis.homing.reference = Millimetres(90.0);
    }
    parameters.axes[0].homing.upwards = false;
    parameters.axes[0].homing.reference = Millimetres(-390.0);
    parameters
}

fn jog(axis: u8, joystick: f64) -> PadState {
    PadState {
        selector: Mode::Jog { axis },
        joystick,
        feed: 100,
        emergency_stop: false,
        dead_man: true,
    }
}

#[test]
fn homing_finds_every_reference_to_a_pulse_from_anywhere_and_ends_at_home() {
    for start in [
        [-200.0, -100.0, 20.0],
        [-398.5, 97.0, 89.0],
        [-386.0, 86.01, 85.9],
        [99.0, -399.0, -399.0],
    ] {
        let mut bench = Bench::new(&incremental(), start);
        assert_eq!(bench.state(), State::NotHomed);
        assert_eq!(
            bench.last().sample.actual,
            [0.0; 3],
            "an incremental encoder counts from power-on"
        );
        bench.half.request(Request::Home);
        bench.run_until(60_000, |r| r.notices.home_reached);
        bench.run(200);
        assert_eq!(bench.state(), State::Ready);
        for k in 0..3 {
            let truth = bench.half.drive().true_position()[k];
            let actual = bench.last().sample.actual[k];
            // Half the play, a pulse, and what the screw has grown.
            assert!(
                (truth - actual).abs() < 0.0025,
                "from {start:?} axis {k} reads {actual} at {truth}"
            );
            assert!(actual.abs() < 0.005, "from {start:?} axis {k} is at {actual}");
        }
        let stages: Vec<State> = bench.reports.iter().map(|r| r.state).collect();
        let order: Vec<u8> = stages
            .iter()
            .filter_map(|s| match s {
                State::Homing {
                    axis,
                    stage: HomingStage::SlowSearch,
                } => Some(*axis),
                _ => None,
            })
            .collect();
        assert!(
            order.is_sorted_by_key(|axis| [1, 2, 0][usize::from(*axis)]),
            "Z first, then X, then Y"
        );
        let (v, a) = bench.worst();
        assert!(v <= 250.5 && a <= 1501.0, "{v} mm/s, {a} mm/s^2");
        assert_eq!(bench.notices().iter().filter(|n| n.home_reached).count(), 1);
    }
}

#[test]
fn a_reference_that_is_not_found_in_time_is_a_fault_and_the_axis_stands() {
    let mut parameters = incremental();
    // The switch is behind the end that the search can reach in its time.
    parameters.axes[2].homing.reference = Millimetres(5000.0);
    let mut bench = Bench::new(&parameters, [0.0; 3]);
    bench.half.request(Request::Home);
    bench.run(40_000);
    assert_eq!(bench.state(), State::Fault(FaultCause::Homing { axis: 2 }));
    assert!(bench.last().sample.velocity.iter().all(|v| v.abs() < 1.0));
    bench.half.request(Request::Reset);
    bench.run(5);
    assert_eq!(bench.state(), State::NotHomed);
}

#[test]
fn a_stop_or_a_hold_in_homing_stops_it_and_leaves_the_machine_not_homed() {
    for request in [Request::Stop, Request::Hold] {
        let mut bench = Bench::new(&incremental(), [-200.0, -100.0, -300.0]);
        bench.half.request(Request::Home);
        bench.run(1000);
        bench.half.request(request);
        bench.run(200);
        assert!(matches!(bench.state(), State::Stopped(_)), "{:?}", bench.state());
        bench.half.request(Request::Reset);
        bench.run(5);
        assert_eq!(bench.state(), State::NotHomed);
        bench.half.request(Request::Home);
        bench.run_until(60_000, |r| r.notices.home_reached);
        assert!(bench.half.controller().is_homed());
    }
}

#[test]
fn without_references_no_program_is_taken_and_the_joystick_is_slow() {
    let mut bench = Bench::new(&incremental(), [0.0; 3]);
    let command = Command::SetPoint(SetPoint::default());
    assert_eq!(bench.half.push(command), Err(command));
    bench
        .pad(PadState {
            feed: 255,
            ..jog(1, 1.0)
        })
        .run(2000);
    assert_eq!(bench.state(), State::Jogging { axis: 1 });
    let speed = bench.last().sample.path_speed;
    assert!((speed - 5.0).abs() < 1e-9, "{speed} mm/s");
    bench.pad(jog(1, 0.0)).run(300);
    assert_eq!(bench.state(), State::NotHomed);
}

#[test]
fn the_joystick_moves_its_axis_at_the_feed_and_tells_its_place_once_when_it_stops() {
    let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
    bench.pad(jog(0, 0.5)).run(1500);
    // Half of 100/255 of 500 mm/s.
    assert!((bench.last().sample.path_speed - 0.5 * 100.0 / 255.0 * 500.0).abs() < 1e-6);
    bench.pad(jog(0, 0.0)).run(500);
    assert_eq!(bench.state(), State::Ready);
    assert_eq!(bench.last().sample.path_speed, 0.0);
    let stopped: Vec<&Report> = bench.reports.iter().filter(|r| r.notices.joystick_stopped).collect();
    assert_eq!(stopped.len(), 1);
    assert!((stopped[0].sample.actual[0] - bench.last().sample.actual[0]).abs() < 0.01);
    assert!(bench.last().sample.actual[0] > 100.0 && bench.last().sample.actual[1].abs() < 0.01);
    // The selector is told once, too.
    let modes: Vec<Mode> = bench.notices().iter().filter_map(|n| n.mode).collect();
    assert_eq!(modes, [Mode::Jog { axis: 0 }]);
    let (_, a) = bench.worst();
    assert!(a <= 1501.0, "{a} mm/s^2");
}

#[test]
fn a_released_dead_man_button_a_lost_pad_and_another_axis_stop_the_jog() {
    let released = PadState {
        dead_man: false,
        ..jog(0, 1.0)
    };
    for show in [
        Some(released),
        None,
        Some(jog(1, 0.0)),
        Some(PadState {
            selector: Mode::Auto,
            ..jog(0, 1.0)
        }),
    ] {
        let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
        bench.pad(jog(0, 1.0)).run(1000);
        let speed = bench.last().sample.path_speed;
        bench.half.pad_mut().0 = show;
        bench.run(350);
        assert!(speed > 190.0 && bench.last().sample.path_speed == 0.0, "{show:?}");
        assert_eq!(bench.state(), State::Ready, "{show:?}");
    }
}

#[test]
fn the_joystick_slows_down_before_the_end_of_the_travel_and_never_passes_it() {
    let mut parameters = MachineParameters::small_machining_centre();
    for axis in &mut parameters.axes {
        (axis.lowest, axis.highest) = (Millimetres(-50.0), Millimetres(60.0));
    }
    for axis in 0..3u8 {
        for n in 0..24 {
            let feed = [255, 200, 120, 40, 3][n % 5];
            let joystick = [1.0, -1.0, 0.3, -0.7][n % 4];
            let mut bench = Bench::new(&parameters, [0.0; 3]);
            let state = PadState {
                feed,
                ..jog(axis, joystick)
            };
            // To and fro before it, so that it arrives in the middle of speeding up.
            for way in [1.0, -1.0, 1.0] {
                bench
                    .pad(PadState {
                        joystick: joystick * way,
                        ..state
                    })
                    .run(170);
            }
            bench.pad(state).run(20_000);
            let k = usize::from(axis);
            for r in &bench.reports {
                let at = r.sample.commanded[k];
                assert!((-50.0..=60.0).contains(&at), "{at} with {state:?}");
            }
            let at = bench.last().sample.commanded[k];
            let end = if joystick > 0.0 { 60.0 - at } else { at + 50.0 };
            assert!(end < 0.06 || feed < 10, "stands {end} mm before the end with {state:?}");
            assert!(bench.worst().1 <= 1501.0);
            // And back again.
            bench
                .pad(PadState {
                    joystick: -joystick,
                    ..state
                })
                .run(500);
            assert!((bench.last().sample.commanded[k] - at).abs() > 0.2);
        }
    }
}

#[test]
fn the_selector_is_ignored_while_machining_and_its_present_position_applies_afterwards() {
    let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
    bench.pad(PadState::default()).run(5);
    bench.half.request(Request::BeginMachining);
    bench.pad(jog(2, 1.0)).run(500);
    assert_eq!(
        (bench.state(), bench.half.controller().mode_in_force()),
        (State::Ready, Mode::Auto)
    );
    let step = StepId(1);
    bench.half.push(Command::Dwell { cycles: 300, step }).expect("taken");
    bench.run(100);
    assert_eq!(bench.half.controller().mode_in_force(), Mode::Auto);
    bench.half.push(Command::End { step }).expect("taken");
    bench
        .pad(PadState {
            joystick: 0.0,
            ..jog(2, 0.0)
        })
        .run(400);
    assert_eq!(bench.half.controller().mode_in_force(), Mode::Jog { axis: 2 });
    assert_eq!(bench.notices().iter().filter_map(|n| n.mode).count(), 1);
    // Now a program waits until the selector is back.
    let command = Command::Dwell { cycles: 3, step };
    assert_eq!(bench.half.push(command), Err(command));
    bench.pad(PadState::default()).run(2);
    assert_eq!(bench.half.push(command), Ok(()));
}

#[test]
fn the_pads_emergency_stop_takes_all_output_away_and_is_told_once_each_way() {
    let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
    bench
        .half
        .request(Request::JogSpindle(SpindleCommand::Clockwise(Rpm(3000.0))));
    bench.pad(jog(0, 1.0)).run(1200);
    assert!(bench.last().sample.spindle_speed > 2500.0);
    bench
        .pad(PadState {
            emergency_stop: true,
            ..jog(0, 1.0)
        })
        .run(1);
    assert_eq!(bench.state(), State::EmergencyStop);
    bench.run(600);
    for r in &bench.reports[1206..] {
        assert_eq!(r.orders.spindle, SpindleCommand::Stop);
        assert!(
            r.orders
                .axes
                .iter()
                .all(|a| a.velocity == 0.0 && a.torque == 0.0 && a.planned == 0.0),
            "{:?}",
            r.orders
        );
    }
    assert_eq!(bench.last().orders.mode, DriveMode::Off);
    let at = bench.last().sample.actual;
    bench.pad(jog(0, 1.0)).run(500);
    assert_eq!(bench.state(), State::EmergencyStopReleased);
    assert_eq!(bench.last().sample.actual, at);
    bench.half.request(Request::Reset);
    bench.pad(jog(0, 0.0)).run(10);
    assert_eq!(
        (bench.state(), bench.last().orders.spindle),
        (State::Ready, SpindleCommand::Stop)
    );
    let told: Vec<bool> = bench.notices().iter().filter_map(|n| n.emergency_stop).collect();
    assert_eq!(told, [true, false]);
}

#[test]
fn a_joystick_that_is_pushed_when_a_program_ends_or_the_selector_turns_moves_nothing_until_it_was_in_the_middle() {
    let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
    bench.half.pad_mut().0 = Some(jog(2, 1.0));
    bench.run(300);
    assert_eq!((bench.state(), bench.last().sample.commanded), (State::Ready, [0.0; 3]));
    bench.pad(PadState::default()).run(5);
    let step = StepId(1);
    bench.half.push(Command::Dwell { cycles: 100, step }).expect("taken");
    bench.half.push(Command::End { step }).expect("taken");
    bench.run(10);
    bench.half.pad_mut().0 = Some(jog(2, 1.0));
    bench.run(500);
    assert_eq!((bench.state(), bench.last().sample.commanded), (State::Ready, [0.0; 3]));
    bench.half.pad_mut().0 = Some(jog(2, 0.0));
    bench.run(1);
    bench.half.pad_mut().0 = Some(jog(2, 1.0));
    bench.run(100);
    assert_eq!(bench.state(), State::Jogging { axis: 2 });
}

#[test]
fn an_axis_that_does_not_exist_is_not_selected() {
    let mut bench = Bench::new(&MachineParameters::small_machining_centre(), [0.0; 3]);
    bench.half.request(Request::Mode(Mode::Jog { axis: 3 }));
    bench.pad(jog(9, 1.0)).run(100);
    assert_eq!(bench.half.controller().mode_in_force(), Mode::Auto);
    assert_eq!(bench.state(), State::Ready);
}

#[test]
fn home_of_a_homed_machine_goes_there_z_first() {
    let mut parameters = MachineParameters::small_machining_centre();
    parameters.axes[2].homing.home = Millimetres(30.0);
    let mut bench = Bench::new(&parameters, [40.0, -60.0, -20.0]);
    bench.half.request(Request::Home);
    let lifted = bench.run_until(5000, |r| (r.sample.commanded[2] - 30.0).abs() < 0.001);
    assert!(lifted > 100 && (bench.last().sample.commanded[0] - 40.0).abs() < 1e-9);
    bench.run_until(5000, |r| r.notices.home_reached);
    bench.run(50);
    assert_eq!(bench.state(), State::Ready);
    let at = bench.last().sample.actual;
    assert!((0..3).all(|k| (at[k] - [0.0, 0.0, 30.0][k]).abs() < 0.003), "{at:?}");
}

//! The rows of the state table that could hurt somebody, on the whole realtime half: every state is brought about as it comes about on the
//! machine, every thing that can happen to it happens, and for half a second afterwards it is looked at what moves and what is on.

use machine::state::next_state;
use machine::{
    Command, ControlPad, CoolantOutlets, DriveMode, Event, MachineParameters, Mode, PadState, Plant, Quality, RealtimeHalf,
    Report, Request, SetPoint, SpindleCommand, State, StopCause, Wait,
};
use units::{Millimetres, Point, Rpm, StepId, Tick, ToolNumber};

struct Pad(Option<PadState>);

impl ControlPad for Pad {
    fn read(&mut self, _now: Tick) -> Option<PadState> {
        self.0
    }
}

struct Bench {
    half: Box<RealtimeHalf<Plant, Pad>>,
    now: Tick,
    queue: std::collections::VecDeque<Command>,
}

impl Bench {
    fn new(parameters: &MachineParameters) -> Bench {
        let plant = Plant::new(parameters, Point::ORIGIN, 7);
        let mut bench = Bench {
            half: Box::new(RealtimeHalf::with_pad(parameters, plant, Pad(None), Quality::Simulated)),
            now: Tick(0),
            queue: Default::default(),
        };
        bench.cycle();
        bench
    }

    fn cycle(&mut self) -> Report {
        while let Some(command) = self.queue.pop_front() {
            if let Err(back) = self.half.push(command) {
                self.queue.push_front(back);
                break;
            }
        }
        self.half.tick(self.now);
        self.now += 1;
        self.half.report().expect("one a cycle")
    }

    fn state(&self) -> State {
        self.half.controller().state()
    }

    #[track_caller]
    fn comes_to(&mut self, is: impl Fn(State) -> bool) {
        for _ in 0..20_000 {
            if is(self.state()) {
                return;
            }
            self.cycle();
        }
        panic!("it is {:?}", self.state());
    }

    fn jogs(&mut self, deflection: f64) {
        let pad = PadState {
            selector: Mode::Jog { axis: 0 },
            joystick: 0.0,
            feed: 100,
            emergency_stop: false,
            dead_man: true,
        };
        self.half.pad_mut().0 = Some(pad);
        self.cycle();
        self.half.pad_mut().0 = Some(PadState {
            joystick: deflection,
            ..pad
        });
    }
}

const STEP: StepId = StepId(3);

/// From rest to rest along X in a second.
fn motion() -> Vec<Command> {
    let length = 20.0;
    (1..=1000)
        .map(|n| {
            let u = f64::from(n) / 1000.0;
            let speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) * length;
            let place = length * u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            Command::SetPoint(SetPoint {
                position: [place, 0.0, 0.0],
                velocity: [speed, 0.0, 0.0],
                acceleration: [60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) * length, 0.0, 0.0],
                step: STEP,
                path_length: place,
                path_speed: speed,
                ..SetPoint::default()
            })
        })
        .collect()
}

fn spindle() -> Command {
    Command::Spindle {
        spindle: SpindleCommand::Clockwise(Rpm(1000.0)),
        step: STEP,
    }
}

fn flood() -> Command {
    let outlets = CoolantOutlets {
        flood: true,
        ..CoolantOutlets::default()
    };
    Command::Coolant { outlets, step: STEP }
}

/// A machine in a state, with spindle and coolant on where a program could have turned them on.
fn brought_to(wanted: State) -> Bench {
    let mut incremental = MachineParameters::small_machining_centre();
    incremental.absolute_encoders = false;
    for axis in &mut incremental.axes {
        axis.homing.reference = Millimetres(20.0);
    }
    let not_homed = matches!(wanted, State::NotHomed | State::Homing { .. });
    let mut bench = Bench::new(&if not_homed {
        incremental
    } else {
        MachineParameters::small_machining_centre()
    });
    if wanted == State::Off {
        return bench;
    }
    bench.half.request(Request::PowerOn);
    bench.cycle();
    let program = |then: Vec<Command>| {
        let mut all = vec![flood(), spindle()];
        all.extend(then);
        all
    };
    match wanted {
        State::Homing { .. } => bench.half.request(Request::Home),
        State::Jogging { .. } => bench.jogs(0.5),
        State::Waiting(Wait::Spindle) => bench.queue.extend(program(vec![])),
        State::Waiting(Wait::Tool) | State::WaitingThenHold(_) => bench.queue.extend(program(vec![Command::Tool {
            tool: ToolNumber(2),
            step: STEP,
        }])),
        State::Waiting(Wait::Dwell) => bench.queue.extend(program(vec![Command::Dwell {
            cycles: 60_000,
            step: STEP,
        }])),
        State::Paused => bench.queue.extend(program(vec![Command::Pause { step: STEP }])),
        State::Ready | State::NotHomed => {}
        _ => bench.queue.extend(program(motion())),
    }
    match wanted {
        State::WaitingThenHold(_) => {
            bench.comes_to(|s| s == State::Waiting(Wait::Tool));
            bench.half.request(Request::Hold);
        }
        State::Holding
        | State::Held
        | State::Resuming
        | State::Stopping(_)
        | State::Stopped(StopCause::Asked)
        | State::EmergencyStop
        | State::EmergencyStopReleased
        | State::Fault(_) => {
            while bench.cycle().sample.path_speed < 20.0 {}
            match wanted {
                State::Holding | State::Held | State::Resuming => bench.half.request(Request::Hold),
                State::Stopping(_) | State::Stopped(_) => bench.half.request(Request::Stop),
                State::Fault(_) => bench.half.drive_mut().set_encoder_error(0, 5000),
                _ => bench.half.drive_mut().set_emergency_stop(true),
            }
        }
        State::Stopped(StopCause::Starved) => {
            while bench.cycle().sample.path_speed < 20.0 {}
            bench.queue.clear();
        }
        _ => {}
    }
    match wanted {
        State::Resuming => {
            bench.comes_to(|s| s == State::Held);
            bench.half.request(Request::StopSpindle);
            for _ in 0..400 {
                bench.cycle();
            }
            bench.half.request(Request::CycleStart);
        }
        State::EmergencyStopReleased => {
            bench.comes_to(|s| s == State::EmergencyStop);
            bench.half.drive_mut().set_emergency_stop(false);
        }
        _ => {}
    }
    let same = |s: State| match (s, wanted) {
        (State::Fault(_), State::Fault(_)) | (State::Homing { .. }, State::Homing { .. }) => true,
        (s, wanted) => s == wanted,
    };
    bench.comes_to(same);
    bench
}

/// Things that can happen to a machine from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Happens {
    Asked(Request),
    EmergencyStop,
    PadsEmergencyStop,
    Joystick,
    Program,
    DeadManReleased,
}

const HAPPENS: &[Happens] = &[
    Happens::Asked(Request::PowerOn),
    Happens::Asked(Request::PowerOff),
    Happens::Asked(Request::CycleStart),
    Happens::Asked(Request::Hold),
    Happens::Asked(Request::Stop),
    Happens::Asked(Request::Reset),
    Happens::Asked(Request::Home),
    Happens::Asked(Request::BeginMachining),
    Happens::Asked(Request::StopSpindle),
    Happens::Asked(Request::JogSpindle(SpindleCommand::Counterclockwise(Rpm(500.0)))),
    Happens::Asked(Request::Mode(Mode::Jog { axis: 1 })),
    Happens::EmergencyStop,
    Happens::PadsEmergencyStop,
    Happens::Joystick,
    Happens::Program,
    Happens::DeadManReleased,
];

fn states() -> Vec<State> {
    use machine::{FaultCause, HomingStage};
    vec![
        State::Off,
        State::NotHomed,
        State::Homing {
            axis: 2,
            stage: HomingStage::Search,
        },
        State::Jogging { axis: 0 },
        State::Ready,
        State::Running,
        State::Waiting(Wait::Commands),
        State::Waiting(Wait::Spindle),
        State::Waiting(Wait::Tool),
        State::Waiting(Wait::Dwell),
        State::WaitingThenHold(Wait::Tool),
        State::Holding,
        State::Held,
        State::Paused,
        State::Resuming,
        State::Stopping(StopCause::Asked),
        State::Stopped(StopCause::Asked),
        State::Stopped(StopCause::Starved),
        State::EmergencyStop,
        State::EmergencyStopReleased,
        State::Fault(FaultCause::Encoder { axis: 0 }),
    ]
}

impl Happens {
    /// The event of the table, where it is one.
    fn event(self) -> Option<Event> {
        Some(match self {
            Happens::Asked(Request::PowerOn) => Event::PowerOn,
            Happens::Asked(Request::PowerOff) => Event::PowerOff,
            Happens::Asked(Request::CycleStart) => Event::CycleStart,
            Happens::Asked(Request::Hold) => Event::Hold,
            Happens::Asked(Request::Stop) => Event::Stop(StopCause::Asked),
            Happens::EmergencyStop | Happens::PadsEmergencyStop => Event::EmergencyStop,
            _ => return None,
        })
    }

    fn happen(self, bench: &mut Bench) {
        match self {
            Happens::Asked(request) => bench.half.request(request),
            Happens::EmergencyStop => bench.half.drive_mut().set_emergency_stop(true),
            Happens::PadsEmergencyStop => {
                let pad = bench.half.pad_mut().0.unwrap_or_default();
                bench.half.pad_mut().0 = Some(PadState {
                    emergency_stop: true,
                    ..pad
                });
            }
            Happens::Joystick => bench.jogs(1.0),
            Happens::Program => bench.queue.extend(motion()),
            Happens::DeadManReleased => {
                let pad = bench.half.pad_mut().0.unwrap_or_default();
                bench.half.pad_mut().0 = Some(PadState { dead_man: false, ..pad });
            }
        }
    }
}

#[test]
fn no_row_of_the_table_moves_or_turns_on_what_it_must_not() {
    let mut rows = 0;
    for state in states() {
        for what in HAPPENS {
            let row = format!("{state:?} {what:?}");
            let mut bench = brought_to(state);
            // No machine runs on with what a test left in its queue.
            if !matches!(
                state,
                State::Running | State::Holding | State::Held | State::Resuming | State::Stopping(_)
            ) {
                bench.queue.clear();
            }
            let before = bench.state();
            what.happen(&mut bench);
            if let Some(event) = what.event().filter(|_| matches!(what, Happens::Asked(_))) {
                let mut next = next_state(before, event);
                if next == State::NotHomed && bench.half.controller().is_homed() {
                    next = next_state(next, Event::ReferencesKnown);
                }
                assert_eq!(bench.state(), next, "{row}");
            }
            let is_emergency = matches!(what, Happens::EmergencyStop | Happens::PadsEmergencyStop) && state != State::Off;
            let first = bench.cycle();
            if is_emergency {
                assert_eq!(first.state, State::EmergencyStop, "{row}");
            }
            let mut last = first.state;
            for n in 0..500 {
                let report = bench.cycle();
                // The cycle in which it comes to rest still has the end of its braking in its orders.
                let stays = core::mem::replace(&mut last, report.state) == report.state;
                check(&row, &report, (n, stays), bench.half.controller().is_homed());
                if is_emergency {
                    assert_eq!(report.state, State::EmergencyStop, "{row} after {n} ms");
                }
                // A tool change is finished in any case.
                let changes = matches!(state, State::Waiting(Wait::Tool) | State::WaitingThenHold(Wait::Tool));
                if *what == Happens::Asked(Request::Stop) && n > 300 && !changes {
                    assert!(report.orders.axes.iter().all(|a| a.planned == 0.0), "{row}: moves");
                    assert_eq!(report.orders.spindle, SpindleCommand::Stop, "{row}: {:?}", report.state);
                    assert_eq!(report.orders.coolant, CoolantOutlets::default(), "{row}");
                }
                if *what == Happens::DeadManReleased && matches!(state, State::Jogging { .. }) && n > 200 {
                    assert_eq!(report.orders.axes[0].planned, 0.0, "{row}");
                }
                let held = *what == Happens::Asked(Request::Hold) && !matches!(report.state, State::WaitingThenHold(_));
                if held && n > 300 {
                    assert!(report.orders.axes.iter().all(|a| a.planned == 0.0), "{row}: moves");
                }
            }
            rows += 1;
        }
    }
    assert_eq!(rows, states().len() * HAPPENS.len());
}

/// What holds in every cycle of every row.
#[track_caller]
fn check(row: &str, report: &Report, (n, stays): (u64, bool), is_homed: bool) {
    let orders = &report.orders;
    let moves = stays && orders.axes.iter().any(|a| a.planned != 0.0);
    match report.state {
        State::Off | State::EmergencyStop | State::EmergencyStopReleased | State::Fault(_) => {
            assert_ne!(orders.mode, DriveMode::Follow, "{row} after {n} ms");
            assert_eq!(orders.spindle, SpindleCommand::Stop, "{row} after {n} ms");
            assert_eq!(orders.coolant, CoolantOutlets::default(), "{row} after {n} ms");
        }
        State::Ready
        | State::NotHomed
        | State::Held
        | State::Paused
        | State::Stopped(_)
        | State::Resuming
        | State::Waiting(Wait::Dwell | Wait::Spindle | Wait::Commands) => {
            assert!(!moves, "{row} after {n} ms: {:?} moves", report.state);
        }
        _ => {}
    }
    if !is_homed && !matches!(report.state, State::Homing { .. } | State::Stopping(_)) {
        let slow = MachineParameters::small_machining_centre().slow_jog.0;
        assert!(
            // The order is for the middle of the coming cycle.
            orders.axes.iter().all(|a| a.planned.abs() <= 1.1 * slow),
            "{row} after {n} ms"
        );
        assert!(
            !matches!(report.state, State::Running | State::Ready),
            "{row}: {:?} without references",
            report.state
        );
    }
    if matches!(report.state, State::Stopped(cause) if !cause.can_go_on()) {
        assert_eq!(
            (orders.spindle, orders.coolant),
            (SpindleCommand::Stop, CoolantOutlets::default()),
            "{row} after {n} ms"
        );
    }
}

#[test]
fn a_hold_stops_the_joystick_and_it_moves_nothing_until_a_reset_and_its_middle() {
    let mut bench = brought_to(State::Jogging { axis: 0 });
    for _ in 0..300 {
        bench.cycle();
    }
    bench.half.request(Request::Hold);
    bench.comes_to(|s| s == State::Stopped(StopCause::Asked));
    bench.half.request(Request::Reset);
    for _ in 0..300 {
        assert_eq!(bench.cycle().orders.axes[0].planned, 0.0);
    }
    bench.jogs(0.5);
    bench.comes_to(|s| s == State::Jogging { axis: 0 });
}

#[test]
fn a_stop_of_a_machine_that_only_turns_its_spindle_by_hand_stops_it() {
    let mut bench = brought_to(State::Ready);
    bench.half.request(Request::JogSpindle(SpindleCommand::Clockwise(Rpm(800.0))));
    for _ in 0..1000 {
        bench.cycle();
    }
    assert!(bench.cycle().sample.spindle_speed > 700.0);
    bench.half.request(Request::Stop);
    assert_eq!(bench.cycle().orders.spindle, SpindleCommand::Stop);
}

#[test]
fn a_card_condition_on_what_is_not_measured_is_told_as_not_known_once_and_does_not_fire() {
    use machine::watch::{FiringKind, Frequency, Operation, Relation, Watch, WatchOrder, signal::signal};
    use machine::{RegisterCard, Registers, registers::input, registers::register};

    /// A card with nothing behind it that is in order.
    struct Still;
    impl Registers for Still {
        fn read(&mut self, register: u16) -> i32 {
            if register == register::INPUTS {
                input::EMERGENCY_STOP_CLOSED | input::DRIVES_READY
            } else {
                0
            }
        }
        fn write(&mut self, _register: u16, _value: i32) {}
    }

    let parameters = MachineParameters::small_machining_centre();
    let mut half = Box::new(RealtimeHalf::new(
        &parameters,
        RegisterCard::new(&parameters, Still),
        Quality::Good,
    ));
    half.request(Request::PowerOn);
    let load = signal("X.LOAD").expect("in the table");
    let number = half.watches().load(&Watch {
        frequency: Frequency::EveryEdge,
        all_modes: true,
        condition: &[Operation::Compare(load, Relation::Less, 1e9)],
        alarms: &[],
    });
    half.tick(Tick(0));
    let order = WatchOrder::Start(number.expect("room"));
    half.push(Command::Watch { order, step: STEP }).expect("it takes it");
    let mut told = Vec::new();
    for n in 1..200 {
        half.tick(Tick(n));
        while let Some(firing) = half.firing(Tick(n)) {
            told.push(firing.kind);
        }
        let sample = half.report().map(|r| r.sample);
        assert!(n < 2 || sample.is_none_or(|s| s.load[0].is_nan()));
    }
    assert_eq!(told, [FiringKind::Unknown]);
}

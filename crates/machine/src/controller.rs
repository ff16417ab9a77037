//! The controller: takes commands from a bounded queue and gives the drives an order every servo cycle.
//!
//! Its states and the one table in which they change are in [`crate::state`]. What is behind them:
//!
//! - **Admission**: a command is checked when it enters the queue ([`Controller::push`]). The first one that must not be executed (outside
//!   the travel, a jump, a switch in motion) becomes a barrier; the machine stops on the path before it.
//! - **Stopping on the path**: hold, stop and a queue that runs dry slow down *time* along the queued set-points (s(t) becomes s(tau),
//!   dtau/dt = `rate`), never each axis by itself. Only when there is no path left does it brake along its present direction; that is
//!   counted. The last speed is never held.
//! - **In position**: where the path is at rest (a set-point with velocity zero) the last set-point is held until every axis is within
//!   its window, for a bounded time. Blended corners have no such set-point and are passed.
//! - **Late cycles**: set-points are taken by time; a few lost cycles are counted, more are a controlled stop.
//! - **Supervision**: impossible encoder readings, following error at two levels, spindle time-out, drive faults, the emergency stop.

mod admission;
mod hand;
mod path;
mod rate;
mod supervision;
mod switching;
mod thread;
mod turning;
mod withdraw;

use crate::drive::{AxisOrder, DriveMode, DriveOrders, Feedback};
use crate::overrides::Overrides;
use crate::pad::{Mode, Notices, PadState};
use crate::parameters::{AxisParameters, MachineParameters};
use crate::ring::Ring;
use crate::sample::{Quality, Sample};
use crate::servo::{PositionLoop, within};
use crate::spindle_angle::SpindleAngle;
use crate::state::{Event, FaultCause, HomingStage, State, StopCause, Wait, next_state};
use crate::watch::Ordered;
use crate::{Command, CoolantOutlets, SetPoint, SpindleCommand, Tie};
use admission::{is_rest, needs_rest};
use thread::Thread;
use units::{Rpm, StepId, TICK, Tick, ToolNumber, WorkingstepId};

/// Commands that the queue takes: half a second of set-points.
pub const QUEUE: usize = 512;

/// Commands without duration that are done in one cycle at most; more of them wait for the next.
const INSTANT_COMMANDS: u32 = 32;
/// Orders for watches in one cycle: those before its set-point and those behind it.
const WATCH_ORDERS: usize = 2 * INSTANT_COMMANDS as usize;
/// Slack of positions at admission, mm: an encoder pulse and rounding.
const SLACK: f64 = 0.002;
/// Impossible encoder readings in a row that are bridged; the next is a fault.
const BRIDGED_READINGS: u32 = 3;
/// An encoder reading is impossible when it is this far from where position and speed of the last cycle lead, mm.
const IMPOSSIBLE: f64 = 0.05;
/// Set-points that have to be there before a path is begun.
const LEAST_AHEAD: f64 = 8.0;
/// Lost cycles beyond which drives have stopped by themselves.
const MOST_LOST: u64 = 16;
/// Below this a measured speed is noise, mm/s.
const STANDSTILL: f64 = 2.0;
/// A spindle within this of its commanded speed is there, whatever the tolerance, rev/min.
const SPINDLE_AT_SPEED: f64 = 5.0;

/// What a person, or the office on a person's behalf, can ask of the controller at any time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// Power on.
    PowerOn,
    /// Power off.
    PowerOff,
    /// Go on, or take up a held program.
    CycleStart,
    /// Stop on the path; cycle start goes on.
    Hold,
    /// Stop on the path for good.
    Stop,
    /// Acknowledge a stop, a fault or a released emergency stop: the queue is emptied.
    Reset,
    /// Feed, rapid and spindle override.
    Override(Overrides),
    /// Find the references that are not known, and go home.
    Home,
    /// Programs, or the joystick on an axis; until the pad's selector is turned. Ignored while machining.
    Mode(Mode),
    /// Feed of the joystick, 0 to 255 of the axis's highest speed; until the pad's is changed.
    JogFeed(u8),
    /// The spindle in jog mode. Ignored while machining.
    JogSpindle(SpindleCommand),
    /// Machining begins: programs have the machine until the next [`Command::End`], whatever the selector says.
    BeginMachining,
    /// The spindle stands and the coolant is closed while the program is held; cycle start brings both back first.
    StopSpindle,
}

/// Things that are counted and never only happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Commands taken into the queue.
    pub accepted: u64,
    /// Commands that are done, in order.
    pub completed: u64,
    /// Commands thrown away by a reset.
    pub discarded: u64,
    /// Servo cycles that did not take place in time.
    pub late_ticks: u64,
    /// Times that happened.
    pub late_gaps: u64,
    /// Cycles in which time was slowed because set-points were few.
    pub starved_ticks: u64,
    /// Times that began.
    pub starvations: u64,
    /// Stops for which there was no path left to stop on.
    pub off_path_stops: u64,
    /// Encoder readings that were not possible and were bridged.
    pub bridged_readings: u64,
    /// Times the following error exceeded its first level.
    pub following_warnings: u64,
    /// Rests at which an axis did not come into position in time; the program went on.
    pub in_position_time_outs: u64,
    /// Spindle commands above the highest speed, executed at the highest.
    pub spindle_limited: u64,
}

/// The controller of one machine.
#[derive(Clone, Debug)]
pub struct Controller {
    parameters: MachineParameters,
    loops: [PositionLoop; 3],
    state: State,
    queue: Ring<Command, QUEUE>,
    /// Number of queued commands before the first that must not be executed, and why.
    barrier: Option<(usize, StopCause)>,
    /// The last set-point that entered the queue, or where the axes were when it was empty.
    tail: SetPoint,
    /// The last set-point that was reached.
    here: SetPoint,
    /// How far towards the next one, in cycles of planned time.
    fraction: f64,
    /// Planned time for each real time, 0..=[`Controller::highest_rate`].
    rate: f64,
    /// How fast that changes, 1/s.
    rate_change: f64,
    /// What the rate may be at most: above 1 only where a thread follows its spindle.
    highest_rate: f64,
    /// The program's plan jerks more than the axes should: it was made without that limit.
    is_jerky: bool,
    overrides: Overrides,
    /// The last cycle was no motion.
    standing: bool,
    /// Braking beside the path, because there is none left.
    astray: bool,
    /// What was given to the drives.
    commanded: [f64; 3],
    commanded_velocity: [f64; 3],
    /// Its last three places, the newest first.
    trail: [[f64; 3]; 3],
    path_speed: f64,
    step: StepId,
    workingstep: WorkingstepId,
    tool: ToolNumber,
    spindle: SpindleCommand,
    coolant: CoolantOutlets,
    /// What the program said to its watches in this cycle.
    watch_orders: Ring<Ordered, WATCH_ORDERS>,
    /// Both are off as long as the program is held.
    spindle_rests: bool,
    /// What a resumed program still waits for the spindle, cycles.
    restoring: u64,
    /// Cycles for which a thread has waited for it.
    thread_waits: u64,
    /// The angle of the spindle, and the thread that goes by it.
    angle: SpindleAngle,
    thread: Thread,
    /// Tool lengths that set-points are compensated by, of what is executed and of what is queued.
    length: Lengths,
    queued_length: Lengths,
    /// What is moved by hand, and by what finds references.
    hand: Hand,
    /// The mode in force, and whether programs keep the selector from changing it.
    mode_in_force: Mode,
    machining: bool,
    /// What an encoder reads is this far from where its axis is, mm; and whether that is known.
    zero: [f64; 3],
    is_known: [bool; 3],
    notices: Notices,
    /// The emergency stop has taken the power away.
    powerless: bool,
    /// The command that is being waited for.
    in_work: Option<Work>,
    last_tick: Option<Tick>,
    /// Lost cycles in a row that its caller makes up for: they never come here as lost.
    made_up: u32,
    last_position: [f64; 3],
    last_velocity: [f64; 3],
    bridged_in_a_row: [u32; 3],
    warned: bool,
    starving: bool,
    /// The commanded position is to be taken from the encoders before anything is executed.
    synchronise: bool,
    counters: Counters,
}

impl Controller {
    /// A controller without power. Parameters are to be checked before ([`MachineParameters::check`]).
    pub fn new(parameters: &MachineParameters) -> Self {
        Controller {
            parameters: *parameters,
            loops: core::array::from_fn(|k| {
                let a = &parameters.axes[k];
                PositionLoop::new(&a.servo, &a.mechanics, a.pulses_per_mm).by(parameters.position_law)
            }),
            state: State::Off,
            queue: Ring::new(),
            barrier: None,
            tail: SetPoint::default(),
            here: SetPoint::default(),
            fraction: 0.0,
            rate: 1.0,
            rate_change: 0.0,
            highest_rate: 1.0,
            is_jerky: false,
            overrides: Overrides::default(),
            standing: true,
            astray: false,
            commanded: [0.0; 3],
            commanded_velocity: [0.0; 3],
            trail: [[0.0; 3]; 3],
            path_speed: 0.0,
            step: StepId::NONE,
            workingstep: WorkingstepId(0),
            tool: ToolNumber(0),
            spindle: SpindleCommand::Stop,
            coolant: CoolantOutlets::default(),
            watch_orders: Ring::new(),
            spindle_rests: false,
            restoring: 0,
            thread_waits: 0,
            angle: SpindleAngle::default(),
            thread: Thread::default(),
            length: Lengths::default(),
            queued_length: Lengths::default(),
            hand: Hand::default(),
            mode_in_force: Mode::Auto,
            machining: false,
            zero: [0.0; 3],
            is_known: [parameters.absolute_encoders; 3],
            notices: Notices::default(),
            powerless: false,
            in_work: None,
            last_tick: None,
            made_up: 0,
            last_position: [0.0; 3],
            last_velocity: [0.0; 3],
            bridged_in_a_row: [0; 3],
            warned: false,
            starving: false,
            synchronise: true,
            counters: Counters::default(),
        }
    }

    /// Takes a command into the queue.
    ///
    /// # Errors
    /// Gives it back when the queue is full, or when the machine is in no state to take programs: keep it and try again.
    pub fn push(&mut self, command: Command) -> Result<(), Command> {
        let takes_programs = matches!(
            self.state,
            State::Ready
                | State::Running
                | State::Waiting(_)
                | State::WaitingThenHold(_)
                | State::Holding
                | State::Held
                | State::Paused
                | State::Resuming
                | State::Stopped(StopCause::Starved)
        );
        if !takes_programs || self.synchronise || self.mode_in_force != Mode::Auto {
            return Err(command);
        }
        let index = self.queue.len();
        let given = command;
        let command = self.compensated(command);
        self.queue.push(command).map_err(|_| given)?;
        self.counters.accepted += 1;
        if self.barrier.is_none()
            && let Some(cause) = self.objection(&command)
        {
            self.barrier = Some((index, cause));
        }
        self.follow_queued(&command);
        Ok(())
    }

    /// How many more commands the queue takes.
    pub fn free(&self) -> usize {
        self.queue.free()
    }

    /// How many commands were taken in and are neither done nor thrown away.
    pub fn outstanding(&self) -> u64 {
        self.queue.len() as u64 + u64::from(self.in_work.is_some())
    }

    /// What it is doing.
    pub fn state(&self) -> State {
        self.state
    }

    /// What was counted since power-on.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The overrides in force.
    pub fn overrides(&self) -> Overrides {
        self.overrides
    }

    /// True when nothing is queued or in work: everything taken in is done, and the axes are commanded to stand.
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.in_work.is_none() && self.stands()
    }

    /// Path length of the program where the machine is, mm.
    pub fn path_length(&self) -> f64 {
        self.here.path_length
    }

    /// The next thing that the program said to its watches in this cycle.
    pub fn watch_order(&mut self) -> Option<Ordered> {
        self.watch_orders.pop()
    }

    /// A request of a person.
    pub fn request(&mut self, request: Request) {
        match request {
            Request::PowerOn => self.happen(Event::PowerOn),
            Request::PowerOff => self.happen(Event::PowerOff),
            Request::CycleStart => self.happen(Event::CycleStart),
            Request::Hold => self.happen(Event::Hold),
            Request::Stop => {
                if matches!(self.state, State::Ready | State::NotHomed) {
                    // Nothing moves that a stop could end, but what a person turned on by hand.
                    (self.spindle, self.coolant) = (SpindleCommand::Stop, CoolantOutlets::default());
                }
                self.happen(Event::Stop(StopCause::Asked));
            }
            // Nothing is acknowledged while something still moves.
            Request::Reset if self.last_velocity.iter().all(|v| v.abs() < STANDSTILL) => self.happen(Event::Reset),
            Request::Reset => {}
            Request::Override(overrides) => self.overrides = overrides.limited(),
            Request::Home => self.begin_homing(),
            Request::Mode(mode) => self.choose_mode(mode),
            Request::JogFeed(feed) => self.hand.feed = feed,
            Request::JogSpindle(spindle) if !self.is_machining() => self.spindle = self.limited(spindle),
            Request::JogSpindle(_) => {}
            Request::BeginMachining => {
                self.choose_mode(Mode::Auto);
                self.machining = true;
            }
            Request::StopSpindle => {
                self.spindle_rests |= matches!(self.state, State::Held | State::Paused | State::Stopped(StopCause::Starved));
            }
        }
    }

    /// The mode in force.
    pub fn mode_in_force(&self) -> Mode {
        self.mode_in_force
    }

    /// True when where every axis is is known.
    pub fn is_homed(&self) -> bool {
        self.is_known == [true; 3]
    }

    /// What a person is to be told since this was asked last.
    pub fn take_notices(&mut self) -> Notices {
        core::mem::take(&mut self.notices)
    }

    /// Whoever calls runs up to so many lost cycles in a row after all; beyond it [`MachineParameters::late_ticks_allowed`] holds.
    pub fn made_up_for(&mut self, cycles: u32) {
        self.made_up = cycles;
    }

    /// Counts cycles that come too late, one after another, on drives that have waited for them: simulated ones. No time was lost to the
    /// motion, and none is passed over.
    pub fn count_late(&mut self, cycles: u64) {
        if cycles > 0 {
            self.counters.late_ticks += cycles;
            self.counters.late_gaps += 1;
        }
    }

    /// One servo cycle: `feedback` was measured at its beginning, the orders are for its duration.
    pub fn tick(&mut self, now: Tick, feedback: &Feedback) -> DriveOrders {
        let lost = self.last_tick.map_or(0, |last| (now - last).saturating_sub(1));
        self.last_tick = Some(now);
        let feedback = &self.in_machine_frame(feedback);
        let position = self.supervise(feedback, lost);
        self.angle.take(feedback, 1 + lost);
        self.supervise_thread(1 + lost);
        if lost > 0 {
            self.counters.late_ticks += lost;
            self.counters.late_gaps += 1;
            if lost > u64::from(self.parameters.late_ticks_allowed) {
                let (cycles, tolerated) = self.away(lost);
                self.happen(Event::Stop(StopCause::Late { cycles, tolerated }));
            }
        }
        let acceleration = if self.mode() == DriveMode::Follow && !self.synchronise {
            // Set-points are taken by time: the lost ones are passed over. Drives that were left alone for longer have stopped.
            let acceleration = self.advance(1 + lost.min(MOST_LOST), feedback);
            self.check_following(self.last_position);
            acceleration
        } else {
            self.synchronise = false;
            self.stand_at(position);
            [0.0; 3]
        };
        self.orders(acceleration, self.last_position)
    }

    /// The row of the record for the cycle that was just made.
    pub fn sample(&self, now: Tick, feedback: &Feedback, quality: Quality) -> Sample {
        Sample {
            tick: now,
            step: self.step,
            workingstep: self.workingstep,
            tool: self.tool,
            phase: self.state.phase(),
            quality,
            commanded: self.commanded,
            actual: core::array::from_fn(|k| feedback.position[k] + self.zero[k]),
            velocity: feedback.velocity,
            load: feedback.load,
            current: feedback.current,
            path_speed: self.path_speed,
            spindle_speed: feedback.spindle_speed,
            spindle_load: feedback.spindle_load,
            overrides: self.overrides,
            spindle_angle: self.angle.degrees(),
            thread_error: self.thread.error,
        }
    }
}

/// Tool lengths, mm: of the tool in the spindle, and of the one that comes next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Lengths {
    now: f64,
    next: f64,
}

/// What moves axes without a program.
#[derive(Clone, Copy, Debug, Default)]
struct Hand {
    /// What the pad showed last; `None` without one.
    pad: Option<PadState>,
    /// Jog feed, 0 to 255.
    feed: u8,
    /// The joystick was in its middle since the mode changed.
    was_in_the_middle: bool,
    /// Commanded acceleration, mm/s^2.
    acceleration: [f64; 3],
    /// The axes move by it.
    moving: bool,
    /// Cycles that the present stage of homing has taken.
    cycles: u64,
    /// Where the axes were when they left for a tool change, mm.
    left_at: [f64; 3],
    /// By how much the new tool is longer than the old one, mm.
    lengthened: f64,
}

/// A command that takes time, in work.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Work {
    wait: Wait,
    /// Cycles that it still takes; for a spindle, until it is a fault.
    cycles: u64,
    /// The tool that comes in.
    tool: ToolNumber,
}

/// Position, velocity and acceleration of the plan at a moment: mm, mm/s, mm/s^2 of planned time.
struct Planned {
    position: [f64; 3],
    velocity: [f64; 3],
    acceleration: [f64; 3],
    path_speed: f64,
}

fn seconds_in_cycles(seconds: f64) -> u64 {
    libm::ceil(seconds / TICK.0) as u64
}

fn length(v: [f64; 3]) -> f64 {
    libm::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
}

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

use crate::drive::{AxisOrder, DriveMode, DriveOrders, Feedback};
use crate::parameters::MachineParameters;
use crate::ring::Ring;
use crate::sample::{Quality, Sample};
use crate::servo::{PositionLoop, within};
use crate::state::{Event, FaultCause, State, StopCause, Wait, next_state};
use crate::{Command, CoolantOutlets, SetPoint, SpindleCommand};
use units::{Rpm, StepId, TICK, Tick, ToolNumber, WorkingstepId};

mod withdraw;

/// Commands that the queue takes: half a second of set-points.
pub const QUEUE: usize = 512;

/// Commands without duration that are done in one cycle at most; more of them wait for the next.
const INSTANT_COMMANDS: u32 = 32;
/// Slack of positions at admission, mm: an encoder pulse and rounding.
const SLACK: f64 = 0.002;
/// Impossible encoder readings in a row that are bridged; the next is a fault.
const BRIDGED_READINGS: u32 = 3;
/// An encoder reading is impossible when it is this far from where position and speed of the last cycle lead, mm.
const IMPOSSIBLE: f64 = 0.05;
/// A stop on a bend must not exceed axis limits, but it must end: at least this part of the weakest axis's acceleration is used.
const LEAST_BRAKING: f64 = 0.3;
/// Set-points that have to be there before a path is begun.
const LEAST_AHEAD: f64 = 8.0;
/// Lost cycles beyond which drives have stopped by themselves.
const MOST_LOST: u64 = 16;
/// Below this a measured speed is noise, mm/s.
const STANDSTILL: f64 = 2.0;
/// A spindle within this of its commanded speed is there, whatever the tolerance, rev/min.
const SPINDLE_AT_SPEED: f64 = 5.0;

/// What a person, or the office on a person's behalf, can ask of the controller at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Servo cycles that did not take place.
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
    /// Planned time for each real time, 0..=1.
    rate: f64,
    /// The last cycle was no motion.
    standing: bool,
    /// Braking beside the path, because there is none left.
    astray: bool,
    /// What was given to the drives.
    commanded: [f64; 3],
    commanded_velocity: [f64; 3],
    path_speed: f64,
    step: StepId,
    workingstep: WorkingstepId,
    tool: ToolNumber,
    spindle: SpindleCommand,
    coolant: CoolantOutlets,
    /// The command that is being waited for.
    in_work: Option<Work>,
    last_tick: Option<Tick>,
    last_position: [f64; 3],
    last_velocity: [f64; 3],
    bridged_in_a_row: [u32; 3],
    warned: bool,
    starving: bool,
    /// The commanded position is to be taken from the encoders before anything is executed.
    synchronise: bool,
    weakest_acceleration: f64,
    counters: Counters,
}

impl Controller {
    /// A controller without power. Parameters are to be checked before ([`MachineParameters::check`]).
    pub fn new(parameters: &MachineParameters) -> Self {
        let weakest = parameters.axes.iter().map(|a| a.a_max.0).fold(f64::INFINITY, f64::min);
        Controller {
            parameters: *parameters,
            loops: core::array::from_fn(|k| {
                let a = &parameters.axes[k];
                PositionLoop::new(&a.servo, &a.mechanics, a.pulses_per_mm)
            }),
            state: State::Off,
            queue: Ring::new(),
            barrier: None,
            tail: SetPoint::default(),
            here: SetPoint::default(),
            fraction: 0.0,
            rate: 1.0,
            standing: true,
            astray: false,
            commanded: [0.0; 3],
            commanded_velocity: [0.0; 3],
            path_speed: 0.0,
            step: StepId::NONE,
            workingstep: WorkingstepId(0),
            tool: ToolNumber(0),
            spindle: SpindleCommand::Stop,
            coolant: CoolantOutlets::default(),
            in_work: None,
            last_tick: None,
            last_position: [0.0; 3],
            last_velocity: [0.0; 3],
            bridged_in_a_row: [0; 3],
            warned: false,
            starving: false,
            synchronise: true,
            weakest_acceleration: weakest,
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
                | State::Stopped(StopCause::Starved)
        );
        if !takes_programs || self.synchronise {
            return Err(command);
        }
        let index = self.queue.len();
        self.queue.push(command)?;
        self.counters.accepted += 1;
        if self.barrier.is_none()
            && let Some(cause) = self.objection(&command)
        {
            self.barrier = Some((index, cause));
        }
        if let Command::SetPoint(set_point) = command {
            self.tail = set_point;
        }
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

    /// True when nothing is queued or in work: everything taken in is done, and the axes are commanded to stand.
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.in_work.is_none() && self.stands()
    }

    /// A request of a person.
    pub fn request(&mut self, request: Request) {
        match request {
            Request::PowerOn => self.happen(Event::PowerOn),
            Request::PowerOff => self.happen(Event::PowerOff),
            Request::CycleStart => self.happen(Event::CycleStart),
            Request::Hold => self.happen(Event::Hold),
            Request::Stop => self.happen(Event::Stop(StopCause::Asked)),
            // Nothing is acknowledged while something still moves.
            Request::Reset if self.last_velocity.iter().all(|v| v.abs() < STANDSTILL) => self.happen(Event::Reset),
            Request::Reset => {}
        }
    }

    /// One servo cycle: `feedback` was measured at its beginning, the orders are for its duration.
    pub fn tick(&mut self, now: Tick, feedback: &Feedback) -> DriveOrders {
        let lost = self.last_tick.map_or(0, |last| (now - last).saturating_sub(1));
        self.last_tick = Some(now);
        let position = self.supervise(feedback, lost);
        if lost > 0 {
            self.counters.late_ticks += lost;
            self.counters.late_gaps += 1;
            if lost > u64::from(self.parameters.late_ticks_allowed) {
                self.happen(Event::Stop(StopCause::Late));
            }
        }
        let acceleration = if self.mode() == DriveMode::Follow && !self.synchronise {
            // Set-points are taken by time: the lost ones are passed over. Drives that were left alone for longer have stopped.
            let acceleration = self.advance(1 + lost.min(MOST_LOST), feedback);
            self.check_following(position);
            acceleration
        } else {
            self.synchronise = false;
            self.stand_at(position);
            [0.0; 3]
        };
        self.orders(acceleration, position)
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
            actual: feedback.position,
            velocity: feedback.velocity,
            load: feedback.load,
            current: feedback.current,
            path_speed: self.path_speed,
            spindle_speed: feedback.spindle_speed,
            spindle_load: feedback.spindle_load,
        }
    }
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

/// Supervision and states.
impl Controller {
    /// Changes the state by the table, and does what entering the new one means.
    fn happen(&mut self, event: Event) {
        let before = self.state;
        self.state = next_state(before, event);
        if self.state == before {
            return;
        }
        match self.state {
            State::Ready => {
                self.spindle = SpindleCommand::Stop;
                self.coolant = CoolantOutlets::default();
                if event != Event::ProgramEnd {
                    self.forget_program();
                }
            }
            State::Running if matches!(before, State::Ready) => self.rate = 1.0,
            _ => {}
        }
    }

    /// Empties the queue and stands where the axes are commanded to be.
    fn forget_program(&mut self) {
        self.counters.discarded += self.queue.clear() as u64 + u64::from(self.in_work.take().is_some());
        self.barrier = None;
        self.stand_at(self.commanded);
        (self.step, self.workingstep) = (StepId::NONE, WorkingstepId(0));
    }

    /// Makes a place the commanded one, at rest.
    fn stand_at(&mut self, position: [f64; 3]) {
        self.here = SetPoint {
            position,
            step: self.step,
            path_length: self.here.path_length,
            ..SetPoint::default()
        };
        if self.queue.is_empty() {
            self.tail = self.here;
        }
        self.commanded = position;
        self.commanded_velocity = [0.0; 3];
        self.path_speed = 0.0;
        self.fraction = 0.0;
        self.rate = 1.0;
        self.astray = false;
    }

    /// Looks at what the drives tell, and gives the positions to go by: an impossible reading is bridged a few times.
    fn supervise(&mut self, feedback: &Feedback, lost: u64) -> [f64; 3] {
        self.happen(if feedback.emergency_stop {
            Event::EmergencyStop
        } else {
            Event::EmergencyStopReleased
        });
        if feedback.drive_fault {
            self.happen(Event::Fault(FaultCause::Drive));
        }
        let comparable = self.mode() == DriveMode::Follow && lost == 0 && !self.synchronise;
        let mut position = feedback.position;
        for (k, reading) in position.iter_mut().enumerate() {
            let expected = self.last_position[k] + self.last_velocity[k] * TICK.0;
            let possible = (*reading - expected).abs() <= IMPOSSIBLE;
            if comparable && !possible {
                self.counters.bridged_readings += 1;
                self.bridged_in_a_row[k] += 1;
                if self.bridged_in_a_row[k] > BRIDGED_READINGS {
                    self.happen(Event::Fault(FaultCause::Encoder { axis: k as u8 }));
                } else {
                    *reading = expected;
                }
            } else {
                self.bridged_in_a_row[k] = 0;
            }
        }
        self.last_position = position;
        self.last_velocity = feedback.velocity;
        position
    }

    /// Two levels: the first is counted, the second is a fault.
    fn check_following(&mut self, position: [f64; 3]) {
        let mut warn = false;
        for (k, actual) in position.iter().enumerate() {
            let error = (self.commanded[k] - actual).abs();
            warn |= error > self.parameters.following_warning.0;
            if error > self.parameters.following_fault.0 || error.is_nan() {
                self.happen(Event::Fault(FaultCause::FollowingError { axis: k as u8 }));
            }
        }
        self.counters.following_warnings += u64::from(warn && !self.warned);
        self.warned = warn;
    }

    /// What the drives shall do in the present state.
    fn mode(&self) -> DriveMode {
        match self.state {
            State::Off => DriveMode::Off,
            State::EmergencyStop | State::EmergencyStopReleased | State::Fault(_) => DriveMode::QuickStop,
            _ => DriveMode::Follow,
        }
    }

    fn orders(&mut self, acceleration: [f64; 3], position: [f64; 3]) -> DriveOrders {
        let mode = self.mode();
        let stopped = mode != DriveMode::Follow || matches!(self.state, State::Stopped(cause) if !cause.can_go_on());
        let changing_tool = self.in_work.is_some_and(|w| w.wait == Wait::Tool) && self.parameters.tool_change_stops_spindle;
        DriveOrders {
            mode,
            axes: core::array::from_fn(|k| {
                let (p, v) = (self.commanded[k], self.commanded_velocity[k]);
                let order = self.loops[k].order(p, v, acceleration[k], position[k]);
                AxisOrder {
                    position: p,
                    velocity: order.velocity,
                    planned: order.planned,
                    torque: order.torque,
                }
            }),
            spindle: if stopped || changing_tool {
                SpindleCommand::Stop
            } else {
                self.spindle
            },
            coolant: if stopped { CoolantOutlets::default() } else { self.coolant },
            path_speed: self.path_speed,
        }
    }

    /// True when the axes are commanded to stand.
    fn stands(&self) -> bool {
        self.commanded_velocity == [0.0; 3]
    }
}

/// Motion along the queue.
impl Controller {
    /// Moves on by a number of cycles and gives the commanded acceleration, mm/s^2.
    fn advance(&mut self, cycles: u64, feedback: &Feedback) -> [f64; 3] {
        self.go_on_with_work(cycles, feedback);
        let too_few =
            self.state == State::Waiting(Wait::Commands) && self.barrier.is_none() && self.rate == 0.0 && self.is_short(0.0);
        if !self.queue.is_empty() && self.in_work.is_none() && !too_few {
            self.happen(Event::Work);
        }
        if !matches!(self.state, State::Running | State::Holding | State::Stopping(_)) || self.in_work.is_some() {
            return self.stand();
        }
        if self.astray {
            return self.brake_astray();
        }
        let before = self.rate;
        self.choose_rate();
        // From a rest the drives get the feed-forward of the first set-point in the cycle before it, as of every other.
        let at_rest = core::mem::take(&mut self.standing) && self.fraction == 0.0 && is_rest(&self.here);
        let begins = at_rest && self.next_set_point().is_some();
        self.fraction += self.rate * (cycles - u64::from(begins)) as f64;
        self.consume();
        if self.fraction > 0.0 && !self.resting(&self.here) && self.next_set_point().is_none() {
            self.end_of_path(self.barrier.map_or(StopCause::OffPath, |(_, cause)| cause));
        }
        if self.astray {
            return self.brake_astray();
        }
        if self.rate == 0.0 {
            self.came_to_rest();
        }
        let planned = self.planned();
        let rate = self.rate;
        let change = (rate - before) / TICK.0;
        self.commanded = planned.position;
        self.commanded_velocity = planned.velocity.map(|v| v * rate);
        self.path_speed = planned.path_speed * rate;
        let coming = self.coming_acceleration(&planned);
        core::array::from_fn(|k| coming[k] * rate * rate + planned.velocity[k] * change)
    }

    fn stand(&mut self) -> [f64; 3] {
        self.standing = true;
        self.commanded_velocity = [0.0; 3];
        self.path_speed = 0.0;
        [0.0; 3]
    }

    /// Time along the path has come to a standstill.
    fn came_to_rest(&mut self) {
        let between = self.fraction > 0.0 || !self.resting(&self.here);
        if self.state == State::Running {
            self.happen(if between {
                Event::Stop(StopCause::Starved)
            } else {
                Event::Wait(Wait::Commands)
            });
        }
        self.happen(Event::AtRest);
    }

    /// Slows time down or brings it back, as fast as the axes can.
    fn choose_rate(&mut self) {
        let planned = self.planned();
        let speed = length(planned.velocity);
        let short = self.is_short(speed);
        if short && let Some((_, cause)) = self.barrier {
            self.happen(Event::Stop(cause));
        }
        let starved = short && self.state == State::Running;
        let slowed = starved && speed > 0.0;
        self.counters.starved_ticks += u64::from(slowed);
        self.counters.starvations += u64::from(slowed && !self.starving);
        self.starving = slowed;
        let down = starved || self.state != State::Running;
        let (fall, rise) = self.rate_steps(&planned, speed);
        if down {
            // What an axis can do within one cycle needs no ramp.
            let abrupt = (0..3).all(|k| (planned.velocity[k] * self.rate).abs() <= self.parameters.axes[k].a_max.0 * TICK.0);
            self.rate = if abrupt { 0.0 } else { (self.rate - fall).max(0.0) };
        } else {
            self.rate = (self.rate + rise).min(1.0);
        }
    }

    /// How much `rate` may fall and rise in a cycle such that no axis exceeds its acceleration: |rate^2 q'' + rate' q'| <= a.
    fn rate_steps(&self, planned: &Planned, speed: f64) -> (f64, f64) {
        let (mut lowest, mut highest) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            let (v, a) = (planned.velocity[k], self.parameters.axes[k].a_max.0);
            if v.abs() > 1e-9 {
                let already = self.rate * self.rate * planned.acceleration[k];
                let (one, other) = ((-a - already) / v, (a - already) / v);
                lowest = lowest.max(one.min(other));
                highest = highest.min(one.max(other));
            }
        }
        let unit = self.weakest_acceleration / speed;
        (
            (-lowest).max(LEAST_BRAKING * unit) * TICK.0,
            highest.max(0.02 * unit) * TICK.0,
        )
    }

    /// True when so few set-points are left that the machine has to slow down now to stop on them.
    fn is_short(&self, speed: f64) -> bool {
        let ahead = self.barrier.map_or(self.queue.len(), |(index, _)| index);
        // Stopping from rate r at constant deceleration passes over r^2 v / (2 a) of planned time; twice that for bends.
        let needed = self.rate * self.rate * speed / (self.weakest_acceleration * TICK.0) + LEAST_AHEAD;
        if ahead as f64 >= needed || (ahead == 0 && self.barrier.is_none() && self.resting(&self.here)) {
            return false;
        }
        // Few, but the path comes to rest by itself: not at a slow set-point from which it speeds up.
        let speed_at = |index: Option<usize>| match index.map(|i| self.queue.get(i)) {
            None => length(self.here.velocity),
            Some(Some(Command::SetPoint(s))) => length(s.velocity),
            Some(_) => 0.0,
        };
        let rests = |index: usize| match self.queue.get(index) {
            Some(Command::SetPoint(s)) => self.resting(s) && speed_at(index.checked_sub(1)) >= length(s.velocity),
            Some(command) => needs_rest(command),
            None => false,
        };
        let at_rest_already = self.resting(&self.here) && self.next_set_point().is_none();
        let comes_to_rest = (0..ahead).rev().any(rests) || at_rest_already;
        !comes_to_rest
    }

    /// Takes from the queue what is due.
    fn consume(&mut self) {
        let mut instant = 0;
        while self.fraction >= 1.0 {
            if let Some((0, cause)) = self.barrier {
                self.end_of_path(cause);
                return;
            }
            match self.queue.front().copied() {
                None => {
                    if self.resting(&self.here) {
                        self.fraction = 0.0;
                        self.happen(Event::Wait(Wait::Commands));
                    } else {
                        self.end_of_path(StopCause::OffPath);
                    }
                    return;
                }
                Some(Command::SetPoint(next)) => {
                    self.pop();
                    self.here = next;
                    self.step = next.step;
                    self.fraction -= 1.0;
                    // A hold or a stop comes to rest here by itself.
                    if self.state == State::Running && is_rest(&next) && !self.is_in_position() {
                        self.fraction = 0.0;
                        let time_out = self.parameters.in_position_time_out;
                        self.wait(Wait::Position, seconds_in_cycles(time_out.0), self.tool);
                        return;
                    }
                    self.counters.completed += 1;
                }
                Some(command) if needs_rest(&command) => {
                    self.fraction = 0.0;
                    if self.state == State::Running {
                        self.pop();
                        self.begin(command);
                    } else {
                        self.rate = 0.0;
                    }
                    return;
                }
                Some(command) => {
                    if instant == INSTANT_COMMANDS {
                        self.fraction = 1.0;
                        return;
                    }
                    instant += 1;
                    self.pop();
                    self.begin(command);
                }
            }
        }
    }

    /// Nothing more can be executed here.
    fn end_of_path(&mut self, cause: StopCause) {
        self.happen(Event::Stop(cause));
        self.fraction = 0.0;
        if self.resting(&self.here) {
            self.rate = 0.0;
        } else {
            self.counters.off_path_stops += 1;
            self.astray = true;
        }
    }

    /// Brakes along the present direction at the highest deceleration that no axis exceeds.
    fn brake_astray(&mut self) -> [f64; 3] {
        let velocity = self.commanded_velocity;
        let speed = length(velocity);
        let mut deceleration = f64::INFINITY;
        for (k, v) in velocity.iter().enumerate() {
            if *v != 0.0 {
                deceleration = deceleration.min(self.parameters.axes[k].a_max.0 * speed / v.abs());
            }
        }
        let left = (speed - deceleration * TICK.0).max(0.0);
        let share = if speed > 0.0 && left > 0.0 { left / speed } else { 0.0 };
        let mut acceleration = [0.0; 3];
        for k in 0..3 {
            let after = velocity[k] * share;
            self.commanded[k] += (velocity[k] + after) / 2.0 * TICK.0;
            acceleration[k] = (after - velocity[k]) / TICK.0;
            self.commanded_velocity[k] = after;
        }
        self.path_speed = left;
        if share == 0.0 {
            let rate = 0.0;
            self.stand_at(self.commanded);
            self.rate = rate;
            self.happen(Event::AtRest);
        }
        acceleration
    }

    /// Executes a command that is not a set-point.
    fn begin(&mut self, command: Command) {
        let mut work = None;
        match command {
            Command::SetPoint(_) => {}
            Command::Spindle { spindle, step } => {
                self.step = step;
                self.spindle = self.limited(spindle);
                work = Some((
                    Wait::Spindle,
                    seconds_in_cycles(self.parameters.spindle.time_out.0),
                    self.tool,
                ));
            }
            Command::SpindleSpeed(speed) => {
                self.spindle = self.limited(match self.spindle {
                    SpindleCommand::Stop => SpindleCommand::Stop,
                    SpindleCommand::Clockwise(_) => SpindleCommand::Clockwise(speed),
                    SpindleCommand::Counterclockwise(_) => SpindleCommand::Counterclockwise(speed),
                });
            }
            Command::Coolant { outlets, step } => {
                self.step = step;
                self.coolant = outlets;
            }
            Command::Tool { tool, step } => {
                self.step = step;
                let time = if tool == self.tool {
                    0
                } else {
                    seconds_in_cycles(self.parameters.tool_change.0)
                };
                work = Some((Wait::Tool, time, tool));
            }
            Command::Dwell { cycles, step } => {
                self.step = step;
                work = Some((Wait::Dwell, u64::from(cycles), self.tool));
            }
            Command::Workingstep { workingstep, step } => {
                self.step = step;
                self.workingstep = workingstep;
            }
            Command::Pause { step } => {
                self.step = step;
                self.happen(Event::Pause);
            }
            Command::End { step } => {
                self.step = step;
                self.happen(Event::ProgramEnd);
            }
        }
        match work {
            None => self.counters.completed += 1,
            Some((wait, cycles, tool)) => self.wait(wait, cycles, tool),
        }
    }

    /// The command that was just taken needs time.
    fn wait(&mut self, wait: Wait, cycles: u64, tool: ToolNumber) {
        self.in_work = Some(Work { wait, cycles, tool });
        self.happen(Event::Wait(wait));
    }

    /// True when every axis is as near to the set-point that was reached last as the window says.
    fn is_in_position(&self) -> bool {
        (0..3).all(|k| (self.here.position[k] - self.last_position[k]).abs() <= self.parameters.in_position.0)
    }

    /// Goes on with a command that takes time. A stop abandons a dwell or a spindle wait; a tool change is finished in any case, and a
    /// set-point was reached already.
    fn go_on_with_work(&mut self, cycles: u64, feedback: &Feedback) {
        let Some(work) = self.in_work else { return };
        let stopping = matches!(self.state, State::Stopping(_));
        let left = work.cycles.saturating_sub(cycles);
        self.in_work = Some(Work { cycles: left, ..work });
        let done = match work.wait {
            Wait::Tool => left == 0,
            Wait::Position => {
                let there = self.is_in_position();
                self.counters.in_position_time_outs += u64::from(!there && left == 0 && !stopping);
                there || left == 0 || stopping
            }
            _ if stopping => {
                self.in_work = None;
                self.counters.discarded += 1;
                return;
            }
            Wait::Spindle => {
                let there = self.spindle_is_there(feedback.spindle_speed);
                if !there && left == 0 {
                    self.happen(Event::Fault(FaultCause::Spindle));
                }
                there
            }
            Wait::Dwell | Wait::Commands => left == 0,
        };
        if !done {
            return;
        }
        self.tool = work.tool;
        if work.wait == Wait::Tool && !stopping && !self.spindle_is_there(feedback.spindle_speed) {
            // The change stopped the spindle; it comes back before the program goes on.
            let cycles = seconds_in_cycles(self.parameters.spindle.time_out.0);
            self.wait(Wait::Spindle, cycles, work.tool);
            return;
        }
        self.in_work = None;
        self.counters.completed += 1;
        self.happen(Event::WaitOver);
    }

    fn spindle_is_there(&self, speed: f64) -> bool {
        let (target, tolerance) = match self.spindle {
            SpindleCommand::Stop => (0.0, 0.0),
            SpindleCommand::Clockwise(n) => (n.0, self.parameters.spindle.tolerance * n.0),
            SpindleCommand::Counterclockwise(n) => (-n.0, self.parameters.spindle.tolerance * n.0),
        };
        (speed - target).abs() <= tolerance.max(SPINDLE_AT_SPEED)
    }

    /// A spindle command within what the spindle can do; a faster one is counted.
    fn limited(&mut self, spindle: SpindleCommand) -> SpindleCommand {
        let highest = self.parameters.spindle.highest;
        let mut limit = |n: Rpm| {
            self.counters.spindle_limited += u64::from(n > highest);
            Rpm(within(n.0, 0.0, highest.0))
        };
        match spindle {
            SpindleCommand::Stop => SpindleCommand::Stop,
            SpindleCommand::Clockwise(n) => SpindleCommand::Clockwise(limit(n)),
            SpindleCommand::Counterclockwise(n) => SpindleCommand::Counterclockwise(limit(n)),
        }
    }

    fn pop(&mut self) {
        self.queue.pop();
        if let Some((index, _)) = &mut self.barrier {
            *index = index.saturating_sub(1);
        }
    }

    /// Where the plan is now: on the last set-point, or between it and the next by Hermite's cubic.
    fn planned(&self) -> Planned {
        let a = &self.here;
        let next = if self.fraction > 0.0 { self.next_set_point() } else { None };
        let (u, b) = match next {
            Some(b) => (self.fraction, b),
            None => {
                return Planned {
                    position: a.position,
                    velocity: a.velocity,
                    acceleration: a.acceleration,
                    path_speed: a.path_speed,
                };
            }
        };
        let between = |from: f64, to: f64| from + (to - from) * u;
        let (u2, u3) = (u * u, u * u * u);
        Planned {
            position: core::array::from_fn(|k| {
                let (p, q) = (a.position[k], b.position[k]);
                let (m, n) = (a.velocity[k] * TICK.0, b.velocity[k] * TICK.0);
                (2.0 * u3 - 3.0 * u2 + 1.0) * p + (u3 - 2.0 * u2 + u) * m + (3.0 * u2 - 2.0 * u3) * q + (u3 - u2) * n
            }),
            velocity: core::array::from_fn(|k| between(a.velocity[k], b.velocity[k])),
            acceleration: core::array::from_fn(|k| between(a.acceleration[k], b.acceleration[k])),
            path_speed: between(a.path_speed, b.path_speed),
        }
    }

    /// Mean acceleration of the plan over the cycle to come, mm/s^2 of planned time.
    ///
    /// The orders are for that cycle. With the acceleration of the set-point just reached, the feed-forward would be a cycle late wherever
    /// the plan begins or ends to accelerate: 3 mm/s of speed at 3000 mm/s^2, and a following error of 20 um.
    fn coming_acceleration(&self, planned: &Planned) -> [f64; 3] {
        if self.in_work.is_some() {
            return [0.0; 3];
        }
        match self.next_set_point() {
            Some(next) => core::array::from_fn(|k| (next.velocity[k] - self.here.velocity[k]) / TICK.0),
            None if is_rest(&self.here) => [0.0; 3],
            None => planned.acceleration,
        }
    }

    /// The set-point that the present one is left towards; `None` when the path ends here.
    fn next_set_point(&self) -> Option<&SetPoint> {
        let usable = self.barrier.map_or(self.queue.len(), |(index, _)| index);
        let ahead = (0..usable.min(INSTANT_COMMANDS as usize + 1)).map_while(|index| self.queue.get(index));
        for command in ahead {
            match command {
                Command::SetPoint(next) => return Some(next),
                other if needs_rest(other) => return None,
                _ => {}
            }
        }
        None
    }

    /// True when a set-point is as good as standing: an axis can take away its speed within a cycle.
    fn resting(&self, set_point: &SetPoint) -> bool {
        (0..3).all(|k| set_point.velocity[k].abs() <= self.parameters.axes[k].a_max.0 * TICK.0)
    }

    /// Why a command must not be executed after the one before it.
    fn objection(&self, command: &Command) -> Option<StopCause> {
        match command {
            Command::SetPoint(s) => (0..3).find_map(|k| {
                let axis = k as u8;
                let limits = &self.parameters.axes[k];
                let (p, v) = (s.position[k], s.velocity[k]);
                if !(p.is_finite() && v.is_finite() && s.acceleration[k].is_finite() && s.path_speed.is_finite()) {
                    return Some(StopCause::Jump { axis });
                }
                if p < limits.lowest.0 - SLACK || p > limits.highest.0 + SLACK {
                    return Some(StopCause::SoftLimit { axis });
                }
                let step = p - self.tail.position[k];
                let too_far = step.abs() > limits.v_max.0 * TICK.0 * 1.001 + SLACK;
                let disagrees = (step - v * TICK.0).abs() > 2.0 * limits.a_max.0 * TICK.0 * TICK.0 + SLACK;
                (too_far || disagrees).then_some(StopCause::Jump { axis })
            }),
            command if needs_rest(command) && !self.resting(&self.tail) => Some(StopCause::SwitchInMotion),
            _ => None,
        }
    }
}

/// True for commands that the machine executes at rest.
fn needs_rest(command: &Command) -> bool {
    match command {
        Command::SetPoint(_) | Command::SpindleSpeed(_) | Command::Coolant { .. } | Command::Workingstep { .. } => false,
        Command::Spindle { .. } | Command::Tool { .. } | Command::Dwell { .. } | Command::Pause { .. } | Command::End { .. } => {
            true
        }
    }
}

/// True for a set-point at which the path stands still.
fn is_rest(set_point: &SetPoint) -> bool {
    set_point.velocity == [0.0; 3]
}

fn seconds_in_cycles(seconds: f64) -> u64 {
    libm::ceil(seconds / TICK.0) as u64
}

fn length(v: [f64; 3]) -> f64 {
    libm::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn without_any_path_left_it_brakes_along_its_direction_and_never_holds_the_last_speed() {
        let mut controller = Controller::new(&MachineParameters::small_machining_centre());
        controller.state = State::Running;
        controller.here.velocity = [300.0, 400.0, 0.0];
        controller.commanded_velocity = controller.here.velocity;
        let feedback = Feedback::default();
        let mut speeds = std::vec![500.0];
        while controller.state != State::Stopped(StopCause::OffPath) {
            controller.advance(1, &feedback);
            let v = controller.commanded_velocity;
            assert!((v[0] * 4.0 - v[1] * 3.0).abs() < 1e-9, "left its direction: {v:?}");
            speeds.push(length(v));
            assert!(speeds.len() < 1000, "does not stop");
        }
        // Y limits: 3000 mm/s^2 of its 4/5 share are 3750 along the direction.
        for pair in speeds.windows(2) {
            assert!(pair[0] - pair[1] > 0.0 && pair[0] - pair[1] < 3.751);
        }
        assert_eq!((controller.counters.off_path_stops, controller.stands()), (1, true));
        assert!((length(controller.commanded) - 500.0 * 500.0 / 2.0 / 3750.0).abs() < 0.01);
    }
}

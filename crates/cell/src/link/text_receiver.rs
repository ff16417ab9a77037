//! The controller's side of the published text protocol: lines become commands for the machine's queue.
//!
//! Places are those of the tool tip: a `T` line tells the machine the tool's length, which it adds against the home position
//! ([`Command::ToolLength`]), so the tip of the new tool comes to where that of the old one was.
//!
//! One client at a time. A line that is none, a step above what an axis can do in a millisecond or after the one before it, one that
//! disagrees with its speed, an operation that ends in motion and a connection that closes in the middle are a controlled stop: what was queued is not gone on with,
//! spindle and coolant go off, and nothing is taken until the person has reset the machine and a client says `M1` again.

use super::receiver::Connection;
use machine::link::text::{FULL, Line, LineError, LineReader, Movement, PULSES_PER_MM, Told};
use machine::pad::Mode;
use machine::{Command, CoolantOutlets, MachineParameters, Report, Request, SetPoint, SpindleCommand, State};
use std::collections::VecDeque;
use units::{Axis, Rpm, StepId, TICK, ToolNumber, WorkingstepId};

/// Orders that wait for the realtime thread before bytes are left in the socket: with the machine's own queue a bit more than what a
/// sender may be ahead.
const WAITING_ORDERS: usize = 256;
/// Lines on both sides of one by which its speed is measured: a speed number is 2 mm/s of a fast axis, a pulse in a millisecond 1 mm/s.
const AROUND: usize = 2;
/// Lines for a person that nobody has taken.
const KEPT_LINES: usize = 256;

/// What the lines come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TextOrder {
    /// For the machine's queue, in order.
    Command(Command),
    /// `M1`: the mode selector is ignored from here on.
    MachiningBegins,
    /// The mode that is asked for. It moves nothing.
    Mode(Mode),
    /// Jog feed, 0 to 255.
    JogFeed(u8),
    /// The spindle outside machining: in jog.
    Spindle(SpindleCommand),
    /// Go home.
    Home,
}

impl TextOrder {
    /// What is asked of the machine by it; `None` for a command, which goes into the queue.
    pub fn request(self) -> Option<Request> {
        match self {
            TextOrder::Command(_) => None,
            TextOrder::MachiningBegins => Some(Request::BeginMachining),
            TextOrder::Mode(mode) => Some(Request::Mode(mode)),
            TextOrder::JogFeed(feed) => Some(Request::JogFeed(feed)),
            TextOrder::Spindle(spindle) => Some(Request::JogSpindle(spindle)),
            TextOrder::Home => Some(Request::Home),
        }
    }
}

/// Why machining was given up.
#[derive(Clone, Debug, PartialEq)]
pub enum TextStop {
    /// What came is no line, or none here.
    Line(LineError),
    /// A whole line that must not be followed.
    Rule {
        /// Which line of the connection, from 1.
        line: u64,
        /// What is wrong with it.
        what: TextRule,
    },
    /// The connection was closed in the middle of machining.
    Closed,
}

/// What a whole line can be against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TextRule {
    /// A step above what the axis can do in a millisecond.
    Step {
        /// 0 is X.
        axis: u8,
        /// Pulses.
        step: i64,
    },
    /// A step that is not what its speed says.
    Speed {
        /// 0 is X.
        axis: u8,
        /// Pulses.
        step: i64,
        /// The number.
        speed: i16,
    },
    /// A step that differs from the one before it by more than the axis can speed up or brake.
    Acceleration {
        /// 0 is X.
        axis: u8,
        /// Pulses.
        step: i64,
        /// Pulses of the one before.
        before: i64,
    },
    /// Machining only.
    NotMachining,
    /// Not while machining.
    Machining,
    /// At rest only.
    InMotion,
}

impl std::fmt::Display for TextStop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let letter = |axis: u8| ["X", "Y", "Z"].get(usize::from(axis)).copied().unwrap_or("?");
        match self {
            TextStop::Line(error) => error.fmt(f),
            TextStop::Closed => write!(f, "the connection was closed before M0"),
            TextStop::Rule { line, what } => {
                write!(f, "line {line}: ")?;
                match *what {
                    TextRule::Step { axis, step } => {
                        write!(
                            f,
                            "{} moves {step} pulses in a millisecond, which is faster than it can",
                            letter(axis)
                        )
                    }
                    TextRule::Speed { axis, step, speed } => {
                        write!(
                            f,
                            "{} moves {step} pulses, and its speed {speed} says otherwise",
                            letter(axis)
                        )
                    }
                    TextRule::Acceleration { axis, step, before } => {
                        write!(
                            f,
                            "{} moves {step} pulses after {before}, which is a harder start or stop than it can do",
                            letter(axis)
                        )
                    }
                    TextRule::NotMachining => write!(f, "send M1 before"),
                    TextRule::Machining => write!(f, "this is not for the time between M1 and M0"),
                    TextRule::InMotion => write!(f, "the last movement has to come to rest (speeds 0) before"),
                }
            }
        }
    }
}

/// Something for the controller's log.
#[derive(Clone, Debug, PartialEq)]
pub enum TextNotice {
    /// A client has connected.
    Connected(Connection),
    /// Another one is there: it was refused.
    Refused(Connection),
    /// Machining was given up: controlled stop.
    Stopped(TextStop),
    /// Lines that came after that and were not followed.
    Ignored(u64),
}

impl std::fmt::Display for TextNotice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TextNotice::Connected(n) => write!(f, "connection {n} drives the machine"),
            TextNotice::Refused(n) => write!(f, "connection {n} was refused: another one drives the machine"),
            TextNotice::Stopped(why) => write!(f, "controlled stop: {why}"),
            TextNotice::Ignored(n) => write!(f, "{n} lines after the stop were not followed"),
        }
    }
}

/// A movement that waits for those after it.
#[derive(Clone, Copy, Debug)]
struct Place {
    axes: [Movement; 3],
}

/// The controller's side of the text protocol.
#[derive(Clone, Debug)]
pub struct TextReceiver {
    parameters: MachineParameters,
    client: Option<Connection>,
    reader: LineReader,
    line: u64,
    machining: bool,
    /// Nothing is followed until the next `M1`.
    given_up: bool,
    ignored: u64,
    /// Operations so far: their number is step and workingstep.
    operations: u32,
    length: u32,
    /// Movements before those in `places`, the last at the end.
    before: VecDeque<Place>,
    places: VecDeque<Place>,
    velocity: [f64; 3],
    path_length: f64,
    orders: VecDeque<TextOrder>,
    urgent: VecDeque<Request>,
    told: VecDeque<Told>,
    lost_lines: u64,
    state: State,
    notices: VecDeque<TextNotice>,
}

impl TextReceiver {
    /// A controller that nobody has connected to.
    pub fn new(parameters: &MachineParameters) -> Self {
        TextReceiver {
            parameters: *parameters,
            client: None,
            reader: LineReader::new(),
            line: 0,
            machining: false,
            given_up: false,
            ignored: 0,
            operations: 0,
            length: 0,
            before: VecDeque::new(),
            places: VecDeque::new(),
            velocity: [0.0; 3],
            path_length: 0.0,
            orders: VecDeque::new(),
            urgent: VecDeque::new(),
            told: VecDeque::new(),
            lost_lines: 0,
            state: State::Off,
            notices: VecDeque::new(),
        }
    }

    /// Somebody connected. False: refuse it, another one is there.
    pub fn connected(&mut self, connection: Connection) -> bool {
        if self.client.is_some() {
            self.notices.push_back(TextNotice::Refused(connection));
            return false;
        }
        self.client = Some(connection);
        self.reader = LineReader::new();
        self.line = 0;
        self.notices.push_back(TextNotice::Connected(connection));
        true
    }

    /// Bytes came.
    pub fn receive(&mut self, connection: Connection, bytes: &[u8]) {
        if self.client != Some(connection) {
            return;
        }
        for &byte in bytes {
            let Some(line) = self.reader.take(byte) else { continue };
            self.line += 1;
            match line {
                Ok(Line::MachiningBegins) => self.begin(),
                _ if self.given_up => self.ignored += 1,
                Ok(line) => {
                    if let Err(what) = self.follow(line) {
                        self.give_up(TextStop::Rule { line: self.line, what });
                    }
                }
                Err(error) => self.give_up(TextStop::Line(error)),
            }
        }
    }

    /// The connection is gone.
    pub fn disconnected(&mut self, connection: Connection) {
        if self.client == Some(connection) {
            self.client = None;
            if self.machining && !self.given_up {
                self.give_up(TextStop::Closed);
            }
        }
    }

    /// True while bytes are taken; false: leave them in the socket.
    pub fn reads(&self) -> bool {
        self.orders.len() < WAITING_ORDERS
    }

    /// The next order for the realtime thread.
    pub fn order(&mut self) -> Option<TextOrder> {
        self.orders.pop_front()
    }

    /// An order found no place: it is the next again.
    pub fn give_back(&mut self, order: TextOrder) {
        self.orders.push_front(order);
    }

    /// The next request, which does not wait behind orders.
    pub fn urgent(&mut self) -> Option<Request> {
        self.urgent.pop_front()
    }

    /// The next line for the other side.
    pub fn told(&mut self) -> Option<Told> {
        self.told.pop_front()
    }

    /// Lines for the other side that nobody took.
    pub fn lost_lines(&self) -> u64 {
        self.lost_lines
    }

    /// The next thing for the log.
    pub fn notice(&mut self) -> Option<TextNotice> {
        self.notices.pop_front()
    }

    /// True between `M1` and `M0`: the mode selector is ignored.
    pub fn machining(&self) -> bool {
        self.machining
    }

    /// The realtime thread has made a cycle.
    pub fn reported(&mut self, report: &Report) {
        let (before, after) = (self.state, report.state);
        self.state = after;
        let pressed = |state| state == State::EmergencyStop;
        if pressed(after) != pressed(before) {
            self.tell(Told::EmergencyStop(pressed(after)));
            if pressed(after) {
                self.forget();
                (self.given_up, self.machining) = (true, false);
            }
        }
        if let Some(mode) = report.notices.mode {
            self.tell(match mode {
                Mode::Auto => Told::Automatic,
                Mode::Jog { axis } => Told::Jog(Axis::ALL[usize::from(axis).min(2)]),
            });
        }
        if report.notices.joystick_stopped {
            let tip = |k: usize| report.sample.actual[k] - if k == 2 { f64::from(self.length) } else { 0.0 };
            // A cast of a float saturates.
            let place = std::array::from_fn(|k| libm::round(tip(k) * PULSES_PER_MM) as i32);
            self.tell(Told::Position(place));
        }
        if report.notices.home_reached {
            self.tell(Told::Home);
        }
    }

    fn tell(&mut self, line: Told) {
        if self.told.len() >= KEPT_LINES {
            self.told.pop_front();
            self.lost_lines += 1;
        }
        self.told.push_back(line);
    }

    fn begin(&mut self) {
        if self.ignored > 0 {
            self.notices.push_back(TextNotice::Ignored(std::mem::take(&mut self.ignored)));
        }
        if self.machining && !self.given_up {
            let (line, what) = (self.line, TextRule::Machining);
            return self.give_up(TextStop::Rule { line, what });
        }
        // What was said before is still to be done.
        self.begin_motion();
        (self.machining, self.given_up) = (true, false);
        self.orders.push_back(TextOrder::MachiningBegins);
    }

    /// A controlled stop: nothing that came goes on.
    fn give_up(&mut self, why: TextStop) {
        if self.machining || !matches!(why, TextStop::Line(_) | TextStop::Rule { .. }) {
            self.urgent.push_back(Request::Stop);
            self.given_up = true;
        }
        self.machining = false;
        self.forget();
        self.notices.push_back(TextNotice::Stopped(why));
    }

    fn forget(&mut self) {
        self.orders.clear();
        self.begin_motion();
    }

    fn begin_motion(&mut self) {
        self.before.clear();
        self.places.clear();
        self.velocity = [0.0; 3];
    }

    fn follow(&mut self, line: Line) -> Result<(), TextRule> {
        let step = StepId(self.operations);
        let machining = if self.machining { Ok(()) } else { Err(TextRule::NotMachining) };
        match line {
            Line::MachiningBegins => {}
            Line::Movement(axes) => {
                machining?;
                self.check(&axes)?;
                self.places.push_back(Place { axes });
                while self.places.len() > AROUND {
                    self.set_point(AROUND);
                }
            }
            Line::OperationBegins { coolant } => {
                machining?;
                self.rest()?;
                self.operations += 1;
                let step = StepId(self.operations);
                self.command(Command::Workingstep {
                    workingstep: WorkingstepId(self.operations),
                    step,
                });
                self.coolant(coolant, step);
            }
            Line::OperationEnds => {
                machining?;
                self.rest()?;
                self.coolant(false, step);
                self.command(Command::Workingstep {
                    workingstep: WorkingstepId(0),
                    step,
                });
            }
            Line::Tool { number, length } => {
                machining?;
                self.rest()?;
                self.length = length;
                // The machine takes the tip of the new tool to where that of the old one was.
                self.command(Command::ToolLength {
                    length: f64::from(length),
                    step,
                });
                self.command(Command::Tool {
                    tool: ToolNumber(number),
                    step,
                });
            }
            Line::Spindle(number) => {
                let speed = Rpm(f64::from(number) / f64::from(FULL) * self.parameters.spindle.highest.0);
                let spindle = if number == 0 {
                    SpindleCommand::Stop
                } else {
                    SpindleCommand::Clockwise(speed)
                };
                if !self.machining {
                    self.orders.push_back(TextOrder::Spindle(spindle));
                } else if self.rest().is_ok() {
                    self.command(Command::Spindle { spindle, step });
                } else {
                    self.flush();
                    self.command(Command::SpindleSpeed(speed));
                }
            }
            Line::MachiningEnds => {
                machining?;
                self.rest()?;
                self.command(Command::End { step });
                self.machining = false;
            }
            Line::Automatic | Line::Jog(_) | Line::JogFeed(_) | Line::Home if self.machining => return Err(TextRule::Machining),
            Line::Automatic => self.orders.push_back(TextOrder::Mode(Mode::Auto)),
            Line::Jog(axis) => self.orders.push_back(TextOrder::Mode(Mode::Jog {
                axis: axis.index() as u8,
            })),
            Line::JogFeed(feed) => self.orders.push_back(TextOrder::JogFeed(feed)),
            Line::Home => self.orders.push_back(TextOrder::Home),
        }
        Ok(())
    }

    /// That the movements have come to rest; what waited goes on its way.
    fn rest(&mut self) -> Result<(), TextRule> {
        let last = self.places.back().or(self.before.back());
        if last.is_some_and(|place| place.axes.iter().any(|axis| axis.speed != 0)) {
            return Err(TextRule::InMotion);
        }
        self.flush();
        Ok(())
    }

    fn flush(&mut self) {
        while !self.places.is_empty() {
            let behind = self.places.len() - 1;
            self.set_point(behind);
        }
    }

    fn command(&mut self, command: Command) {
        self.orders.push_back(TextOrder::Command(command));
    }

    fn coolant(&mut self, flood: bool, step: StepId) {
        let outlets = CoolantOutlets {
            flood,
            ..CoolantOutlets::default()
        };
        self.command(Command::Coolant { outlets, step });
    }

    /// What a movement must not be.
    fn check(&self, axes: &[Movement; 3]) -> Result<(), TextRule> {
        let Some(before) = self.places.back().or(self.before.back()) else {
            // The controller itself looks whether the first lies where the axes stand.
            return Ok(());
        };
        let earlier = self.places.iter().rev().chain(self.before.iter().rev()).nth(1);
        for (k, (now, was)) in axes.iter().zip(&before.axes).enumerate() {
            let limits = &self.parameters.axes[k];
            let axis = k as u8;
            let step = i64::from(now.position) - i64::from(was.position);
            let speed = step as f64 / PULSES_PER_MM / TICK.0;
            // One pulse is rounding.
            let pulse = 1.0 / PULSES_PER_MM / TICK.0;
            if speed.abs() > limits.v_max.0 + pulse {
                return Err(TextRule::Step { axis, step });
            }
            // The number is rounded, it is that of the end of the step, and the step is in whole pulses.
            let said = f64::from(now.speed) / f64::from(FULL) * limits.v_max.0;
            let slack = 0.5 / f64::from(FULL) * limits.v_max.0 + pulse + limits.a_max.0 * TICK.0;
            if (speed - said).abs() > slack {
                return Err(TextRule::Speed {
                    axis,
                    step,
                    speed: now.speed,
                });
            }
            // Each of the three places is rounded, the middle one counts twice; a plan under a change of its rate uses 1.05 of the limit.
            let Some(earlier) = earlier else { continue };
            let step_before = i64::from(was.position) - i64::from(earlier.axes[k].position);
            let possible = 1.05 * limits.a_max.0 * TICK.0 * TICK.0 * PULSES_PER_MM + 2.0;
            if (step - step_before).abs() as f64 > possible {
                let before = step_before;
                return Err(TextRule::Acceleration { axis, step, before });
            }
        }
        Ok(())
    }

    /// Makes a set-point of the oldest waiting movement, with `behind` more to look at.
    fn set_point(&mut self, behind: usize) {
        let Some(place) = self.places.pop_front() else { return };
        let stands = place.axes.iter().all(|axis| axis.speed == 0);
        let around = behind.min(self.before.len()).min(AROUND);
        let mut velocity = [0.0; 3];
        let mut position = [0.0; 3];
        let mut step = 0.0;
        for k in 0..3 {
            let number = |place: &Place| f64::from(place.axes[k].position) / PULSES_PER_MM;
            position[k] = number(&place);
            let quantum = self.parameters.axes[k].v_max.0 / f64::from(FULL);
            let said = f64::from(place.axes[k].speed) * quantum;
            let measured = match around {
                0 => said,
                n => {
                    let (from, to) = (&self.before[self.before.len() - n], &self.places[n - 1]);
                    (number(to) - number(from)) / (2.0 * n as f64 * TICK.0)
                }
            };
            // Measured over the lines around it, as far as the number allows; numbers that are all 0 say that it stands.
            velocity[k] = if stands {
                0.0
            } else {
                measured.clamp(said - quantum / 2.0, said + quantum / 2.0)
            };
            let d = self.before.back().map_or(0.0, |before| number(&place) - number(before));
            step += d * d;
        }
        self.path_length += step.sqrt();
        let acceleration = std::array::from_fn(|k| (velocity[k] - self.velocity[k]) / TICK.0);
        let set_point = SetPoint {
            position,
            velocity,
            acceleration,
            step: StepId(self.operations),
            path_length: self.path_length,
            path_speed: velocity.iter().map(|v| v * v).sum::<f64>().sqrt(),
            rapid: false,
            planned_override: 1.0,
            tie: None,
        };
        self.velocity = velocity;
        self.command(Command::SetPoint(set_point));
        self.before.push_back(place);
        if self.before.len() > AROUND {
            self.before.pop_front();
        }
    }
}

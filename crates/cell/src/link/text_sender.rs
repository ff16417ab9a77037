//! The office's side of the published text protocol: a stream of commands as lines, at most 200 ms ahead.
//!
//! The order is that of the source: `M1`, for each operation `P`, `T`, `S`, movements, `#`, at the end `M0`. A workingstep is an operation,
//! and so is what lies between two changes of tool or coolant. What the protocol cannot carry is either refused (a spindle turning
//! counterclockwise) or done as nearly as it goes, and told ([`TextSender::losses`]).
//!
//! Positions go out as places of the tool tip: the whole millimetres of tool length that a `T` line carries are taken off Z here and added
//! again by the controller, so rounding the length moves nothing. With a tool change the machine takes the tip of the new tool to where
//! that of the old one was; our plans go on where the *gauge point* was, so the sender takes it back there, along Z and slowly.

use super::scaled::{Pose, Scaler};
use super::stock::Stock;
use machine::link::text::{FULL, Line, LineError, Movement, PULSES_PER_MM, Told, ToldReader};
use machine::pad::Mode;
use machine::{Command, MachineParameters, Request, SetPoint, SpindleCommand};
use std::collections::{BTreeMap, VecDeque};
use units::{Axis, StepId, TICK, Tick, ToolNumber};

/// Lines that may be ahead of the time.
pub const LINES_AHEAD: u64 = 200;
/// Cycles without a new command after which what is there is all there is for now.
const DRY: u64 = 20;
/// Highest speed of the way back to the gauge point after a tool change, mm/s.
const WAY_BACK: f64 = 50.0;

/// Why the sender does not go on.
#[derive(Clone, Debug, PartialEq)]
pub enum TextRefusal {
    /// The protocol turns spindles clockwise only.
    Counterclockwise {
        /// The step that asks for it.
        step: StepId,
    },
    /// A place that whole pulses of 32 bits do not reach.
    Position {
        /// The step.
        step: StepId,
    },
    /// What came back is no line.
    Told(LineError),
}

impl std::fmt::Display for TextRefusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TextRefusal::Counterclockwise { step } => write!(
                f,
                "step {}: the text protocol turns the spindle clockwise only: use the default link for M4",
                step.0
            ),
            TextRefusal::Position { step } => write!(f, "step {}: a position that the text protocol has no number for", step.0),
            TextRefusal::Told(error) => write!(f, "from the controller, {error}"),
        }
    }
}
impl std::error::Error for TextRefusal {}

/// What the protocol could not carry as it was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Losses {
    /// Tools whose length is not whole millimetres: number, length, and what was sent. Z is not moved by it.
    pub tool_lengths: BTreeMap<u32, (f64, u32)>,
    /// Tools of unknown length, sent as 0.
    pub unknown_lengths: Vec<u32>,
    /// Largest rounding of a spindle speed, rev/min.
    pub spindle: f64,
    /// Largest rounding of a place, mm.
    pub position: f64,
    /// Coolant changes that came in motion, and were done at the next rest.
    pub coolant_later: u64,
    /// Operations with mist or coolant through the spindle, sent as coolant.
    pub outlets: u64,
    /// Conditions of synchronized actions: the protocol has no word for them, so nobody checks them.
    pub watches: u64,
}

impl Losses {
    /// In words, one line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for (tool, (length, sent)) in &self.tool_lengths {
            lines.push(format!(
                "tool {tool}: its length of {length} mm went out as {sent} mm; Z is not moved by it"
            ));
        }
        for tool in &self.unknown_lengths {
            lines.push(format!("tool {tool}: its length is not known and went out as 0 mm"));
        }
        if self.spindle > 0.0 {
            lines.push(format!(
                "spindle speeds are off by up to {:.1} rev/min: there are 255 of them",
                self.spindle
            ));
        }
        if self.position > 0.0 {
            lines.push(format!(
                "places are off by up to {:.4} mm: they are whole pulses",
                self.position
            ));
        }
        if self.coolant_later > 0 {
            lines.push(format!("{} coolant changes waited for the next rest", self.coolant_later));
        }
        if self.watches > 0 {
            lines.push(format!(
                "{} synchronized actions are not checked: the text protocol has no word for them",
                self.watches
            ));
        }
        if self.outlets > 0 {
            lines.push(format!(
                "{} operations asked for mist or coolant through the spindle and got coolant",
                self.outlets
            ));
        }
        lines
    }
}

/// The office's side of the text protocol.
#[derive(Clone, Debug)]
pub struct TextSender {
    parameters: MachineParameters,
    /// Lengths of tools, mm, by number.
    lengths: BTreeMap<u32, f64>,
    stock: Stock,
    /// Number of the next command of the plan.
    next: u64,
    begun: bool,
    ended: bool,
    /// The operation that is open, and its coolant.
    operation: Option<bool>,
    coolant: bool,
    tool: Option<(u32, u32)>,
    spindle: Option<u8>,
    /// A new operation is to begin at the next rest.
    split: bool,
    /// Tool length in force at the machine, whole mm.
    length: u32,
    /// Set-points back to the gauge point after a tool change.
    way_back: VecDeque<SetPoint>,
    /// The last movement: of which cycle of the plan, and its set-point.
    last: Option<(u64, SetPoint)>,
    rests: bool,
    /// Standing lines still to be sent; before the first movement there is no place to stand at, and nothing is sent until then.
    dwell: u32,
    silent_until: Tick,
    paused: bool,
    stop_asked: bool,
    /// Since when lines are counted, and how many went out.
    clock: Option<Tick>,
    counted: u64,
    /// How many went out in all.
    lines: u64,
    pushed: bool,
    pushed_at: Tick,
    reader: ToldReader,
    emergency_stop: bool,
    losses: Losses,
}

impl TextSender {
    /// A sender for a machine; `lengths` are the tools' lengths in mm by number.
    pub fn new(parameters: &MachineParameters, lengths: BTreeMap<u32, f64>) -> Self {
        TextSender {
            parameters: *parameters,
            lengths,
            stock: Stock::new(),
            next: 1,
            begun: false,
            ended: false,
            operation: None,
            coolant: false,
            tool: None,
            spindle: None,
            split: false,
            length: 0,
            way_back: VecDeque::new(),
            last: None,
            rests: true,
            dwell: 0,
            silent_until: Tick(0),
            paused: false,
            stop_asked: false,
            clock: None,
            counted: 0,
            lines: 0,
            pushed: false,
            pushed_at: Tick(0),
            reader: ToldReader::new(),
            emergency_stop: false,
            losses: Losses::default(),
        }
    }

    /// The machine has a tool of this length, in whole mm: what was said by `T` in a run before. Without it, 0.
    pub fn with_length(mut self, length: u32) -> Self {
        self.length = length;
        self
    }

    /// A tool and its length as the protocol has them: whole mm.
    pub fn tool_line(&mut self, tool: ToolNumber) -> Line {
        Line::Tool {
            number: tool.0,
            length: self.whole_length(tool),
        }
    }

    /// Takes the next command of the plan.
    ///
    /// # Errors
    /// Gives it back when there are enough: keep it and try again.
    pub fn push(&mut self, command: Command) -> Result<(), Command> {
        self.stock.push(command)?;
        self.pushed = true;
        Ok(())
    }

    /// A request of a person: a stop becomes decelerating lines, `#` and `M0`; cycle start goes on after a program stop. The protocol knows
    /// no others.
    pub fn request(&mut self, request: Request) {
        match request {
            Request::Stop => self.stop_asked = true,
            Request::CycleStart => self.paused = false,
            _ => {}
        }
    }

    /// The line that asks for a mode of the machine; outside machining only.
    pub fn mode(mode: Mode) -> Line {
        match mode {
            Mode::Auto => Line::Automatic,
            Mode::Jog { axis } => Line::Jog(Axis::ALL[usize::from(axis).min(2)]),
        }
    }

    /// True when `M0` has gone out, or an emergency stop has ended it all.
    pub fn ended(&self) -> bool {
        self.ended
    }

    /// The controller said that the emergency stop is pressed.
    pub fn emergency_stop(&self) -> bool {
        self.emergency_stop
    }

    /// True while it waits for cycle start at a program stop.
    pub fn paused(&self) -> bool {
        self.paused
    }

    /// Movement lines that went out.
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// Commands of the plan that went out.
    pub fn sent(&self) -> u64 {
        self.next - 1
    }

    /// What could not be carried as it was.
    pub fn losses(&self) -> &Losses {
        &self.losses
    }

    /// Bytes came back.
    ///
    /// # Errors
    /// They are no line.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<Vec<Told>, TextRefusal> {
        let mut told = Vec::new();
        for &byte in bytes {
            if let Some(line) = self.reader.take(byte) {
                let line = line.map_err(TextRefusal::Told)?;
                if let Told::EmergencyStop(on) = line {
                    self.emergency_stop = on;
                    // The machine forgets what was sent: nothing of this run goes on.
                    self.ended |= on && self.begun;
                }
                told.push(line);
            }
        }
        Ok(told)
    }

    /// Appends what is to be written. Call it when everything before has been written: a machine that waits does not read.
    ///
    /// # Errors
    /// The plan asks for what the protocol does not have: stop and end the run.
    pub fn output(&mut self, now: Tick, out: &mut Vec<u8>) -> Result<(), TextRefusal> {
        if std::mem::take(&mut self.pushed) {
            self.pushed_at = now;
        }
        while !self.ended && self.may_send(now) {
            if self.stop_asked {
                self.stop(now, out)?;
                return Ok(());
            }
            if let Some(set_point) = self.way_back.pop_front() {
                let (speeds, place) = self.numbers(&set_point)?;
                self.movement(now, speeds, place, out);
                continue;
            }
            if self.dwell > 0 {
                let Some((_, last)) = self.last else {
                    self.silent_until = now + u64::from(std::mem::take(&mut self.dwell));
                    continue;
                };
                self.open(&last, out);
                if !self.way_back.is_empty() {
                    continue;
                }
                self.dwell -= 1;
                let (_, place) = self.numbers(&last)?;
                self.movement(now, [0; 3], place, out);
                continue;
            }
            if self.paused || now < self.silent_until {
                return Ok(());
            }
            // What follows a movement decides whether it can be stopped behind it: some of the plan is kept back.
            let dry = now.0.saturating_sub(self.pushed_at.0) >= DRY;
            if self.stock.end() < self.next + LINES_AHEAD && !dry && !self.is_over() {
                return Ok(());
            }
            let Some(command) = self.stock.command(self.next).copied() else {
                return Ok(());
            };
            if let Command::SetPoint(set_point) = command {
                self.begin_machining(out);
                let stands = self.last.map_or(set_point, |(_, last)| last);
                self.open(&stands, out);
                if !self.way_back.is_empty() {
                    continue;
                }
            }
            self.say(now, command, out)?;
            self.stock.done(self.next);
            self.next += 1;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.stock
            .end()
            .checked_sub(1)
            .and_then(|n| self.stock.command(n))
            .is_some_and(|c| matches!(c, Command::End { .. }))
    }

    fn may_send(&self, now: Tick) -> bool {
        self.clock
            .is_none_or(|clock| self.counted < now.0.saturating_sub(clock.0) + LINES_AHEAD)
    }

    fn say(&mut self, now: Tick, command: Command, out: &mut Vec<u8>) -> Result<(), TextRefusal> {
        self.begin_machining(out);
        match command {
            Command::SetPoint(set_point) => {
                let (speeds, place) = self.numbers(&set_point)?;
                let cycle = self.stock.cycle_of(self.next);
                self.movement(now, speeds, place, out);
                self.last = Some((cycle, set_point));
                self.rests = set_point.velocity == [0.0; 3];
            }
            Command::Spindle { spindle, step } => {
                self.spindle = Some(match spindle {
                    SpindleCommand::Stop => 0,
                    SpindleCommand::Clockwise(speed) => self.spindle_number(speed.0),
                    SpindleCommand::Counterclockwise(_) => return Err(TextRefusal::Counterclockwise { step }),
                });
            }
            Command::SpindleSpeed(speed) => {
                self.spindle = Some(self.spindle_number(speed.0));
            }
            Command::Coolant { outlets, .. } => {
                let wanted = outlets.flood || outlets.mist || outlets.through;
                self.losses.outlets += u64::from(outlets.mist || outlets.through);
                self.losses.coolant_later += u64::from(wanted != self.coolant && !self.rests);
                self.coolant = wanted;
            }
            Command::Tool { tool, .. } => self.tool = Some((tool.0, self.whole_length(tool))),
            Command::Dwell { cycles, .. } => self.dwell = cycles,
            Command::Workingstep { workingstep, .. } => self.split |= workingstep.0 != 0,
            Command::Pause { .. } => self.paused = true,
            Command::Watch { order, .. } => {
                self.losses.watches += u64::from(matches!(order, machine::WatchOrder::Start(_)));
            }
            // Goes with the tool line, from the table of lengths.
            Command::ToolLength { .. } => {}
            Command::End { .. } => {
                self.close(out);
                put(Line::MachiningEnds, out);
                self.ended = true;
            }
        }
        Ok(())
    }

    fn begin_machining(&mut self, out: &mut Vec<u8>) {
        if !self.begun {
            self.begun = true;
            put(Line::MachiningBegins, out);
        }
    }

    /// Before a movement: the operation that it belongs to, its tool and its spindle speed. `stands` is where the axes stand if this is at
    /// rest; a tool of another length has its way back from there.
    fn open(&mut self, stands: &SetPoint, out: &mut Vec<u8>) {
        let other = self.operation != Some(self.coolant) || self.tool.is_some() || self.split;
        if self.operation.is_none() || (other && self.rests) {
            self.close(out);
            put(Line::OperationBegins { coolant: self.coolant }, out);
            self.operation = Some(self.coolant);
            self.split = false;
        }
        let waits = self.rests && (self.tool.is_some() || self.spindle.is_some());
        if let Some((number, length)) = self.tool.take() {
            put(Line::Tool { number, length }, out);
            self.lead_back(stands, f64::from(length) - f64::from(self.length));
            self.length = length;
        }
        if let Some(speed) = self.spindle.take() {
            put(Line::Spindle(speed), out);
        }
        if waits {
            // How long the machine takes for it, nobody tells: lines are counted anew.
            (self.clock, self.counted) = (None, 0);
        }
    }

    /// The machine has gone up by as much as the new tool is longer: down again, from rest to rest with the least jerk.
    fn lead_back(&mut self, stands: &SetPoint, longer: f64) {
        let z = &self.parameters.axes[2];
        let way = longer.abs();
        if way == 0.0 {
            return;
        }
        // 10 u^3 - 15 u^4 + 6 u^5 is fastest at 15/8, accelerates by 5.78 and jerks by 60 at most.
        let by_speed = 1.875 * way / WAY_BACK.min(0.5 * z.v_max.0);
        let by_acceleration = (5.78 * way / (0.5 * z.a_max.0)).sqrt();
        let by_jerk = libm::cbrt(60.0 * way / z.j_max.0);
        let cycles = (by_speed.max(by_acceleration).max(by_jerk) / TICK.0).ceil();
        for i in 1..=cycles as u64 {
            let u = i as f64 / cycles;
            let left = 1.0 - u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            let speed = -30.0 * u * u * (1.0 - u) * (1.0 - u) / (cycles * TICK.0);
            let ends = i as f64 == cycles;
            let mut set_point = SetPoint {
                velocity: [0.0, 0.0, if ends { 0.0 } else { longer * speed }],
                ..*stands
            };
            set_point.position[2] += if ends { 0.0 } else { longer * left };
            self.way_back.push_back(set_point);
        }
    }

    fn close(&mut self, out: &mut Vec<u8>) {
        if self.operation.take().is_some() {
            put(Line::OperationEnds, out);
        }
    }

    fn movement(&mut self, now: Tick, speeds: [i16; 3], place: [i32; 3], out: &mut Vec<u8>) {
        self.clock.get_or_insert(now);
        self.counted += 1;
        self.lines += 1;
        let axes = std::array::from_fn(|k| Movement {
            speed: speeds[k],
            position: place[k],
        });
        put(Line::Movement(axes), out);
    }

    /// A set-point in numbers of the protocol.
    fn numbers(&mut self, set_point: &SetPoint) -> Result<([i16; 3], [i32; 3]), TextRefusal> {
        let length = self.length;
        let (mut speeds, mut place) = ([0; 3], [0; 3]);
        for k in 0..3 {
            let position = set_point.position[k] - if k == 2 { f64::from(length) } else { 0.0 };
            let pulses = libm::round(position * PULSES_PER_MM);
            if pulses.is_nan() || pulses.abs() > f64::from(i32::MAX) {
                return Err(TextRefusal::Position { step: set_point.step });
            }
            self.losses.position = self.losses.position.max((position - pulses / PULSES_PER_MM).abs());
            place[k] = pulses as i32;
            let speed = libm::round(set_point.velocity[k] / self.parameters.axes[k].v_max.0 * f64::from(FULL));
            speeds[k] = speed.clamp(-f64::from(FULL), f64::from(FULL)) as i16;
        }
        Ok((speeds, place))
    }

    fn spindle_number(&mut self, speed: f64) -> u8 {
        let highest = self.parameters.spindle.highest.0;
        // Whatever shall turn, turns.
        let number = libm::round(speed / highest * f64::from(FULL)).clamp(if speed > 0.0 { 1.0 } else { 0.0 }, f64::from(FULL));
        self.losses.spindle = self.losses.spindle.max((number / f64::from(FULL) * highest - speed).abs());
        number as u8
    }

    fn whole_length(&mut self, tool: ToolNumber) -> u32 {
        let Some(&length) = self.lengths.get(&tool.0) else {
            self.losses.unknown_lengths.push(tool.0);
            return 0;
        };
        let whole = libm::round(length).clamp(0.0, 9999.0);
        if whole != length {
            self.losses.tool_lengths.insert(tool.0, (length, whole as u32));
        }
        whole as u32
    }

    /// Decelerating lines on the path, `#`, `M0`.
    fn stop(&mut self, now: Tick, out: &mut Vec<u8>) -> Result<(), TextRefusal> {
        if !self.way_back.is_empty() {
            // It is half a second at most, and ends at rest: shorter than any other stop on it would be to plan.
            for set_point in std::mem::take(&mut self.way_back) {
                let (speeds, place) = self.numbers(&set_point)?;
                self.movement(now, speeds, place, out);
            }
        }
        if let Some((cycle, _)) = self.last.filter(|_| !self.rests) {
            let from = Pose {
                phase: cycle as f64,
                rate: 1.0,
            };
            let ramp = Scaler::new(&self.stock, &self.parameters).tail(from, self.next - 1);
            for posed in ramp.entries {
                if let Command::SetPoint(set_point) = posed.entry.command {
                    let (speeds, place) = self.numbers(&set_point)?;
                    self.movement(now, speeds, place, out);
                }
            }
        }
        self.close(out);
        if self.begun {
            put(Line::MachiningEnds, out);
        }
        self.ended = true;
        Ok(())
    }
}

fn put(line: Line, out: &mut Vec<u8>) {
    out.extend_from_slice(line.text().bytes());
}

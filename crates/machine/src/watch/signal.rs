//! What conditions and recordings can look at: one table of signals, worked out once in a cycle from its sample.

use crate::{MachineParameters, Phase, Sample};
use units::{TICK, Tick, WorkingstepId};

/// Most signals: their number fits a byte, so that looking one up cannot miss.
pub const MOST_SIGNALS: usize = 256;
/// Tools whose diameter is known at once.
pub const TOOLS: usize = 64;

/// One signal. Its name is the stream's in program, log, agent and conditions.
#[derive(Clone, Copy)]
pub struct Signal {
    /// `component.TYPE.SUBTYPE` with MTConnect's type names; `trace:` before the values that every machine has.
    pub name: &'static str,
    /// Unit, in MTConnect's words; empty for a plain number.
    pub unit: &'static str,
    /// Worked out of others, not measured.
    pub derived: bool,
    read: fn(&Cycle<'_>) -> f64,
}

/// The number that stands for a sensor that this machine has not: its value is never known.
pub const NO_SENSOR: u8 = 255;

/// What a signal is worked out of.
struct Cycle<'c> {
    now: &'c Sample,
    /// The cycle before, when it is the neighbour.
    before: Option<&'c Sample>,
    machine: &'c MachineParameters,
    times: Times,
    situation: Situation,
    diameter: f64,
}

/// Times since something began, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Times {
    workingstep: f64,
    operation: f64,
    program: f64,
}

/// What the controller knows beside the sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Situation {
    /// Which mode the machine is in.
    pub mode: Mode,
    /// Feed override, %.
    pub feed_override: f64,
    /// What conditions took in the last cycle.
    pub cost: WatchCost,
}

/// What the conditions of one cycle cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchCost {
    /// Operations that were evaluated.
    pub operations: u32,
    /// Time that they took, ns; 0 where nobody measures it.
    pub nanoseconds: u32,
}

impl Default for Situation {
    /// Automatic at 100 %, no conditions.
    fn default() -> Self {
        Situation {
            mode: Mode::Automatic,
            feed_override: 100.0,
            cost: WatchCost::default(),
        }
    }
}

/// Modes of operation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// A program runs, or could.
    #[default]
    Automatic = 0,
    /// Single blocks by hand.
    ManualDataInput = 1,
    /// Axes by hand.
    Jog = 2,
}

const fn measured(name: &'static str, unit: &'static str, read: fn(&Cycle<'_>) -> f64) -> Signal {
    Signal {
        name,
        unit,
        derived: false,
        read,
    }
}

const fn derived(name: &'static str, unit: &'static str, read: fn(&Cycle<'_>) -> f64) -> Signal {
    Signal {
        name,
        unit,
        derived: true,
        read,
    }
}

/// Rate of change of what two neighbouring cycles hold.
fn rate(cycle: &Cycle<'_>, of: fn(&Sample) -> f64) -> f64 {
    cycle.before.map_or(f64::NAN, |before| (of(cycle.now) - of(before)) / TICK.0)
}

fn torque(cycle: &Cycle<'_>, axis: usize) -> f64 {
    cycle.now.current[axis] * cycle.machine.axes[axis].mechanics.torque_constant
}

/// N: the motor's torque by the travel for each radian, mm/rad.
fn force(cycle: &Cycle<'_>, axis: usize) -> f64 {
    torque(cycle, axis) * 1e3 / cycle.machine.axes[axis].mechanics.transmission
}

/// W: mm/s are thousandths of m/s.
fn power(cycle: &Cycle<'_>, axis: usize) -> f64 {
    force(cycle, axis) * cycle.now.velocity[axis] * 1e-3
}

fn spindle_torque(cycle: &Cycle<'_>) -> f64 {
    cycle.now.spindle_load / 100.0 * cycle.machine.spindle.torque
}

fn length(v: [f64; 3]) -> f64 {
    libm::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
}

/// Radians in a second for each revolution in a minute.
const RADIANS: f64 = core::f64::consts::PI / 30.0;

/// All signals. A new one is one line here.
pub const SIGNALS: &[Signal] = &[
    measured("X.POSITION.COMMANDED", "MILLIMETER", |c| c.now.commanded[0]),
    measured("Y.POSITION.COMMANDED", "MILLIMETER", |c| c.now.commanded[1]),
    measured("Z.POSITION.COMMANDED", "MILLIMETER", |c| c.now.commanded[2]),
    measured("X.POSITION.ACTUAL", "MILLIMETER", |c| c.now.actual[0]),
    measured("Y.POSITION.ACTUAL", "MILLIMETER", |c| c.now.actual[1]),
    measured("Z.POSITION.ACTUAL", "MILLIMETER", |c| c.now.actual[2]),
    derived("X.DISPLACEMENT", "MILLIMETER", |c| c.now.actual[0] - c.now.commanded[0]),
    derived("Y.DISPLACEMENT", "MILLIMETER", |c| c.now.actual[1] - c.now.commanded[1]),
    derived("Z.DISPLACEMENT", "MILLIMETER", |c| c.now.actual[2] - c.now.commanded[2]),
    measured("X.AXIS_FEEDRATE.ACTUAL", "MILLIMETER/SECOND", |c| c.now.velocity[0]),
    measured("Y.AXIS_FEEDRATE.ACTUAL", "MILLIMETER/SECOND", |c| c.now.velocity[1]),
    measured("Z.AXIS_FEEDRATE.ACTUAL", "MILLIMETER/SECOND", |c| c.now.velocity[2]),
    derived("X.ACCELERATION", "MILLIMETER/SECOND^2", |c| rate(c, |s| s.velocity[0])),
    derived("Y.ACCELERATION", "MILLIMETER/SECOND^2", |c| rate(c, |s| s.velocity[1])),
    derived("Z.ACCELERATION", "MILLIMETER/SECOND^2", |c| rate(c, |s| s.velocity[2])),
    measured("X.LOAD", "PERCENT", |c| c.now.load[0]),
    measured("Y.LOAD", "PERCENT", |c| c.now.load[1]),
    measured("Z.LOAD", "PERCENT", |c| c.now.load[2]),
    measured("X.AMPERAGE", "AMPERE", |c| c.now.current[0]),
    measured("Y.AMPERAGE", "AMPERE", |c| c.now.current[1]),
    measured("Z.AMPERAGE", "AMPERE", |c| c.now.current[2]),
    derived("X.TORQUE", "NEWTON_METER", |c| torque(c, 0)),
    derived("Y.TORQUE", "NEWTON_METER", |c| torque(c, 1)),
    derived("Z.TORQUE", "NEWTON_METER", |c| torque(c, 2)),
    derived("X.LINEAR_FORCE", "NEWTON", |c| force(c, 0)),
    derived("Y.LINEAR_FORCE", "NEWTON", |c| force(c, 1)),
    derived("Z.LINEAR_FORCE", "NEWTON", |c| force(c, 2)),
    derived("X.WATTAGE", "WATT", |c| power(c, 0)),
    derived("Y.WATTAGE", "WATT", |c| power(c, 1)),
    derived("Z.WATTAGE", "WATT", |c| power(c, 2)),
    measured("PATH.PATH_FEEDRATE.COMMANDED", "MILLIMETER/SECOND", |c| c.now.path_speed),
    derived("PATH.PATH_FEEDRATE.ACTUAL", "MILLIMETER/SECOND", |c| length(c.now.velocity)),
    derived("PATH.FOLLOWING_ERROR_LINEAR", "MILLIMETER", |c| c.now.thread_error),
    measured("S1.ANGLE.ACTUAL", "DEGREE", |c| c.now.spindle_angle),
    measured("S1.ROTARY_VELOCITY.ACTUAL", "REVOLUTION/MINUTE", |c| c.now.spindle_speed),
    measured("S1.LOAD", "PERCENT", |c| c.now.spindle_load),
    derived("S1.ANGULAR_ACCELERATION", "RADIAN/SECOND^2", |c| {
        rate(c, |s| s.spindle_speed) * RADIANS
    }),
    derived("S1.TORQUE", "NEWTON_METER", spindle_torque),
    derived("S1.WATTAGE", "WATT", |c| {
        spindle_torque(c) * c.now.spindle_speed.abs() * RADIANS
    }),
    // Half the diameter times the angular speed; without a diameter it is not known.
    derived("S1.CUTTING_SPEED", "MILLIMETER/SECOND", |c| {
        c.now.spindle_speed.abs() * RADIANS * c.diameter / 2.0
    }),
    measured("PATH.PATH_FEEDRATE_OVERRIDE.PROGRAMMED", "PERCENT", |c| {
        f64::from(c.now.overrides.feed)
    }),
    measured("PATH.PATH_FEEDRATE_OVERRIDE.RAPID", "PERCENT", |c| {
        f64::from(c.now.overrides.rapid)
    }),
    measured("S1.ROTARY_VELOCITY_OVERRIDE", "PERCENT", |c| {
        f64::from(c.now.overrides.spindle)
    }),
    measured("trace:ws_time", "SECOND", |c| c.times.workingstep),
    measured("trace:op_time", "SECOND", |c| c.times.operation),
    measured("trace:prog_time", "SECOND", |c| c.times.program),
    measured("trace:mode", "", |c| f64::from(c.situation.mode as u8)),
    measured("trace:tool", "", |c| f64::from(c.now.tool.0)),
    measured("trace:feed_override", "PERCENT", |c| c.situation.feed_override),
    derived("trace:path_deviation", "MILLIMETER", |c| {
        length(core::array::from_fn(|k| c.now.actual[k] - c.now.commanded[k]))
    }),
    // What the conditions themselves cost, as a value that can be recorded and watched like any other.
    measured("CONTROLLER.WATCH_OPERATIONS", "COUNT", |c| {
        f64::from(c.situation.cost.operations)
    }),
    measured("CONTROLLER.WATCH_TIME", "NANOSECOND", |c| {
        match c.situation.cost.nanoseconds {
            0 => f64::NAN,
            measured => f64::from(measured),
        }
    }),
];

const _: () = assert!(SIGNALS.len() < NO_SENSOR as usize);

/// The number of the signal with that name; `None` when this machine has no such sensor.
pub fn signal(name: &str) -> Option<u8> {
    let at = SIGNALS.iter().position(|signal| signal.name.eq_ignore_ascii_case(name))?;
    u8::try_from(at).ok()
}

/// The values of all signals in a cycle. One that is not known is not-a-number.
#[derive(Clone, Debug)]
pub struct Readings {
    values: [f64; MOST_SIGNALS],
    before: Option<Sample>,
    workingstep_began: Option<Tick>,
    operation_began: Option<Tick>,
    program_began: Option<Tick>,
    diameters: [(u32, f64); TOOLS],
    tools: usize,
}

impl Default for Readings {
    fn default() -> Self {
        Readings::new()
    }
}

impl Readings {
    /// Nothing is known yet.
    pub const fn new() -> Self {
        Readings {
            values: [f64::NAN; MOST_SIGNALS],
            before: None,
            workingstep_began: None,
            operation_began: None,
            program_began: None,
            diameters: [(0, 0.0); TOOLS],
            tools: 0,
        }
    }

    /// Tells the diameter of a tool; false when there is no place for more.
    pub fn know_tool(&mut self, tool: u32, diameter_mm: f64) -> bool {
        let known = self.diameters[..self.tools].iter().position(|(number, _)| *number == tool);
        let at = known.unwrap_or(self.tools);
        if at == TOOLS {
            return false;
        }
        self.diameters[at] = (tool, diameter_mm);
        self.tools = self.tools.max(at + 1);
        true
    }

    /// Another program: no operation has begun, and of no tool is the diameter known.
    pub fn new_program(&mut self) {
        (self.operation_began, self.tools) = (None, 0);
    }

    /// An operation begins, or is over, in the coming cycle.
    pub fn operation(&mut self, now: Tick, begins: bool) {
        self.operation_began = begins.then_some(now);
    }

    /// An operation is under way: it begins in the coming cycle if nobody knows since when.
    pub fn operation_under_way(&mut self, now: Tick) {
        self.operation_began.get_or_insert(now);
    }

    /// Works out the signals of a cycle.
    pub fn take(&mut self, sample: &Sample, machine: &MachineParameters, situation: Situation) {
        let now = sample.tick;
        let before = self.before.replace(*sample);
        if before.is_none_or(|b| b.workingstep != sample.workingstep) {
            self.workingstep_began = (sample.workingstep.0 != 0).then_some(now);
        }
        match sample.phase {
            Phase::Ready => self.program_began = None,
            Phase::Running | Phase::Waiting => {
                self.program_began.get_or_insert(now);
            }
            _ => {}
        }
        // Outside of one it is 0: nothing lasts too long that is not there.
        let since = |began: Option<Tick>| began.map_or(0.0, |began| (now - began) as f64 * TICK.0);
        let tool = self.diameters[..self.tools]
            .iter()
            .find(|(number, _)| *number == sample.tool.0);
        let cycle = Cycle {
            now: sample,
            before: before.as_ref().filter(|b| b.tick + 1 == now),
            machine,
            times: Times {
                workingstep: since(self.workingstep_began),
                operation: since(self.operation_began.or(self.workingstep_began)),
                program: since(self.program_began),
            },
            situation,
            diameter: tool.map_or(f64::NAN, |(_, diameter)| *diameter),
        };
        for (value, signal) in self.values.iter_mut().zip(SIGNALS) {
            *value = (signal.read)(&cycle);
        }
    }

    /// The workingstep of the cycle that was taken last.
    pub fn workingstep(&self) -> WorkingstepId {
        self.before.map_or(WorkingstepId(0), |before| before.workingstep)
    }

    /// The value of a signal; `None` when it is not known.
    pub fn value(&self, signal: u8) -> Option<f64> {
        let value = self.values[usize::from(signal)];
        (!value.is_nan()).then_some(value)
    }

    /// All values, by number.
    pub(crate) fn values(&self) -> &[f64; MOST_SIGNALS] {
        &self.values
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use units::ToolNumber;

    fn value(readings: &Readings, name: &str) -> Option<f64> {
        readings.value(signal(name).expect("in the table"))
    }

    #[test]
    fn every_channel_of_the_record_is_a_signal_with_the_same_unit() {
        for channel in crate::CHANNELS {
            let at = signal(channel.name).expect(channel.name);
            assert_eq!(SIGNALS[usize::from(at)].unit, channel.unit, "{}", channel.name);
        }
    }

    #[test]
    fn names_are_unique() {
        for (k, a) in SIGNALS.iter().enumerate() {
            assert!(SIGNALS[..k].iter().all(|b| b.name != a.name), "{}", a.name);
        }
    }

    #[test]
    fn times_count_from_where_a_workingstep_and_a_program_began() {
        let machine = MachineParameters::small_machining_centre();
        let mut readings = Readings::new();
        let mut at = |tick: u64, workingstep: u32, phase: Phase| {
            let sample = Sample {
                tick: Tick(tick),
                workingstep: WorkingstepId(workingstep),
                phase,
                ..Sample::default()
            };
            readings.take(&sample, &machine, Situation::default());
            (value(&readings, "trace:ws_time"), value(&readings, "trace:prog_time"))
        };
        assert_eq!(at(10, 0, Phase::Ready), (Some(0.0), Some(0.0)));
        assert_eq!(at(11, 0, Phase::Running), (Some(0.0), Some(0.0)));
        assert_eq!(at(111, 1, Phase::Running), (Some(0.0), Some(0.1)));
        assert_eq!(at(211, 1, Phase::Paused), (Some(0.1), Some(0.2)));
        assert_eq!(at(311, 2, Phase::Running), (Some(0.0), Some(0.3)));
        assert_eq!(at(312, 0, Phase::Ready), (Some(0.0), Some(0.0)));
    }

    #[test]
    fn what_is_derived_follows_from_what_is_measured() {
        let machine = MachineParameters::small_machining_centre();
        let mut readings = Readings::new();
        assert!(readings.know_tool(3, 20.0));
        let mut sample = Sample {
            tick: Tick(1),
            tool: ToolNumber(3),
            velocity: [3.0, 4.0, 0.0],
            current: [2.0, 0.0, 0.0],
            commanded: [1.0, 0.0, 0.0],
            actual: [1.003, 0.004, 0.0],
            spindle_speed: 3000.0,
            ..Sample::default()
        };
        readings.take(&sample, &machine, Situation::default());
        assert_eq!(value(&readings, "X.ACCELERATION"), None, "one cycle has no rate");
        assert_eq!(value(&readings, "PATH.PATH_FEEDRATE.ACTUAL"), Some(5.0));
        assert!((value(&readings, "trace:path_deviation").unwrap() - 0.005).abs() < 1e-12);
        assert!((value(&readings, "X.TORQUE").unwrap() - 2.0 * 0.8910).abs() < 1e-12);
        // 3000 rev/min at 20 mm: pi * 20 * 50 mm/s.
        assert!((value(&readings, "S1.CUTTING_SPEED").unwrap() - 3141.59).abs() < 0.01);
        sample.tick = Tick(2);
        sample.velocity[0] = 4.0;
        sample.tool = ToolNumber(4);
        readings.take(&sample, &machine, Situation::default());
        assert!((value(&readings, "X.ACCELERATION").unwrap() - 1000.0).abs() < 1e-9);
        assert_eq!(value(&readings, "S1.CUTTING_SPEED"), None, "nobody knows the diameter");
        assert_eq!(readings.value(NO_SENSOR), None);
    }
}

//! A motion card behind registers: speeds out, encoder counts in, as the card of the published CAM-controlled machine.
//!
//! The card has no position loop of its own: the controller's is closed over it, and what is written is a speed
//! ([`crate::PositionLaw::SpeedSetPoint`], or the other law's speed without its torque). Where the registers are, in a mapped file or on a
//! bus, is the shell's business behind [`Registers`].
//!
//! Inputs are wired fail-safe: a broken wire reads as an emergency stop and as a fault. What such a card does not measure (currents, loads)
//! is not a number in the feedback, and never 0.

use crate::drive::{CyclicDrive, DriveMode, DriveOrders, Feedback};
use crate::parameters::MachineParameters;
use crate::servo::within;
use crate::{CoolantOutlets, SpindleCommand};
use units::{TICK, Tick};

/// Numbered 32-bit registers. Neither call may block.
pub trait Registers {
    /// What stands in a register.
    fn read(&mut self, register: u16) -> i32;
    /// Puts a value into a register.
    fn write(&mut self, register: u16, value: i32);
}

/// Register numbers of the card.
pub mod register {
    /// In: encoder counts of X, Y, Z; they wrap around.
    pub const POSITION: [u16; 3] = [0, 1, 2];
    /// In: encoder counts at the last index pulse of X, Y, Z.
    pub const INDEX: [u16; 3] = [3, 4, 5];
    /// In: index pulses seen, X in bits 0 to 7, Y in 8 to 15, Z in 16 to 23, the spindle in 24 to 31; each counts on by one at a pulse and
    /// wraps around.
    pub const INDEX_COUNT: u16 = 6;
    /// In: switches, see [`super::input`].
    pub const INPUTS: u16 = 7;
    /// In: spindle speed, rev/min, positive clockwise.
    pub const SPINDLE_SPEED: u16 = 8;
    /// In: encoder counts of the spindle, and those at its last index pulse; they wrap around.
    pub const SPINDLE_POSITION: u16 = 9;
    /// See [`SPINDLE_POSITION`].
    pub const SPINDLE_INDEX: u16 = 10;
    /// In: counts on as long as the card works. 0 for ever on a card that cannot.
    pub const CARD_ALIVE: u16 = 11;
    /// Out: speeds of X, Y, Z; [`super::FULL_SPEED`] is the highest speed of the axis.
    pub const SPEED: [u16; 3] = [16, 17, 18];
    /// Out: spindle speed without sign; [`super::FULL_SPEED`] is the highest.
    pub const SPINDLE: u16 = 19;
    /// Out: switches, see [`super::output`].
    pub const OUTPUTS: u16 = 20;
    /// Out: counts on with every order, so that the card can stop by itself when none comes.
    pub const ALIVE: u16 = 21;
}

/// Bits of the inputs.
pub mod input {
    /// The reference switch of X is made; Y and Z follow.
    pub const REFERENCE: [i32; 3] = [1, 1 << 1, 1 << 2];
    /// The emergency stop circuit is closed. Not set: stop.
    pub const EMERGENCY_STOP_CLOSED: i32 = 1 << 3;
    /// All drives are in order. Not set: fault.
    pub const DRIVES_READY: i32 = 1 << 4;
}

/// Bits of the outputs.
pub mod output {
    /// Power to the drives.
    pub const ENABLE: i32 = 1;
    /// Spindle clockwise.
    pub const CLOCKWISE: i32 = 1 << 1;
    /// Spindle counterclockwise.
    pub const COUNTERCLOCKWISE: i32 = 1 << 2;
    /// Flood coolant.
    pub const FLOOD: i32 = 1 << 3;
    /// Mist coolant.
    pub const MIST: i32 = 1 << 4;
    /// Coolant through the spindle.
    pub const THROUGH: i32 = 1 << 5;
}

/// The number that stands for the highest speed: a 16-bit converter with sign.
pub const FULL_SPEED: f64 = 32_767.0;
/// Cycles for which a card that counts may stand still before its drives are in fault.
const CARD_SILENT: u64 = 20;
/// A quick stop brakes harder than any planned motion.
const QUICK_STOP: f64 = 1.3;

/// Drives behind the registers of a card.
#[derive(Clone, Debug)]
pub struct RegisterCard<R> {
    registers: R,
    axes: [CardAxis; 3],
    highest_spindle: f64,
    spindle: CardSpindle,
    /// What the card counted last, and when that changed; `None` until it counts.
    card_alive: Option<(i32, Tick)>,
    index_count: Option<i32>,
    alive: i32,
    read_at: Option<Tick>,
}

#[derive(Clone, Copy, Debug)]
struct CardSpindle {
    /// 0 without an encoder.
    counts_per_turn: f64,
    last_count: i32,
    count: i64,
}

#[derive(Clone, Copy, Debug)]
struct CardAxis {
    pulses_per_mm: f64,
    v_max: f64,
    quick_stop: f64,
    /// The last count as the card gave it, and the same without wrapping around.
    last_count: i32,
    count: i64,
    /// The speed that was written, mm/s.
    speed: f64,
}

impl<R: Registers> RegisterCard<R> {
    /// A card for a machine with these parameters.
    pub fn new(parameters: &MachineParameters, registers: R) -> Self {
        RegisterCard {
            registers,
            axes: core::array::from_fn(|k| {
                let axis = &parameters.axes[k];
                CardAxis {
                    pulses_per_mm: axis.pulses_per_mm,
                    v_max: axis.v_max.0,
                    quick_stop: QUICK_STOP * axis.a_max.0 * TICK.0,
                    last_count: 0,
                    count: 0,
                    speed: 0.0,
                }
            }),
            highest_spindle: parameters.spindle.highest.0,
            spindle: CardSpindle {
                counts_per_turn: parameters.spindle.encoder_counts,
                last_count: 0,
                count: 0,
            },
            card_alive: None,
            index_count: None,
            alive: 0,
            read_at: None,
        }
    }

    /// The registers.
    pub fn registers_mut(&mut self) -> &mut R {
        &mut self.registers
    }
}

impl<R: Registers> RegisterCard<R> {
    /// True when a card that counted does not count any more: what it tells is of the past.
    fn is_silent(&mut self, now: Tick) -> bool {
        let count = self.registers.read(register::CARD_ALIVE);
        match self.card_alive {
            None if count == 0 => false,
            Some((last, since)) if last == count => now - since > CARD_SILENT,
            _ => {
                self.card_alive = Some((count, now));
                false
            }
        }
    }
}

impl<R: Registers> CyclicDrive for RegisterCard<R> {
    fn read(&mut self, now: Tick) -> Feedback {
        let inputs = self.registers.read(register::INPUTS);
        let mut feedback = Feedback {
            load: [f64::NAN; 3],
            current: [f64::NAN; 3],
            spindle_load: f64::NAN,
            spindle_speed: f64::from(self.registers.read(register::SPINDLE_SPEED)),
            emergency_stop: inputs & input::EMERGENCY_STOP_CLOSED == 0,
            drive_fault: inputs & input::DRIVES_READY == 0,
            ..Feedback::default()
        };
        let index_count = self.registers.read(register::INDEX_COUNT);
        let seen = self.index_count.replace(index_count).unwrap_or(index_count);
        let cycles = self.read_at.map_or(0, |at| now - at);
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let count = self.registers.read(register::POSITION[k]);
            // The difference of wrapping counts is right as long as an axis goes less than half of them in a cycle.
            let moved = i64::from(count.wrapping_sub(axis.last_count));
            axis.last_count = count;
            axis.count += moved;
            feedback.position[k] = axis.count as f64 / axis.pulses_per_mm;
            if cycles > 0 {
                feedback.velocity[k] = moved as f64 / axis.pulses_per_mm / (TICK.0 * cycles as f64);
            }
            feedback.reference_switch[k] = inputs & input::REFERENCE[k] != 0;
            if (index_count ^ seen) >> (8 * k) & 0xff != 0 {
                let behind = count.wrapping_sub(self.registers.read(register::INDEX[k]));
                feedback.index[k] = Some((axis.count - i64::from(behind)) as f64 / axis.pulses_per_mm);
            }
        }
        if self.spindle.counts_per_turn > 0.0 {
            let spindle = &mut self.spindle;
            let count = self.registers.read(register::SPINDLE_POSITION);
            spindle.count += i64::from(count.wrapping_sub(spindle.last_count));
            spindle.last_count = count;
            feedback.spindle_angle = Some(spindle.count as f64 / spindle.counts_per_turn);
            if (index_count ^ seen) >> 24 & 0xff != 0 {
                let behind = count.wrapping_sub(self.registers.read(register::SPINDLE_INDEX));
                feedback.spindle_index = Some((spindle.count - i64::from(behind)) as f64 / spindle.counts_per_turn);
            }
        }
        feedback.drive_fault |= self.is_silent(now);
        self.read_at = Some(now);
        feedback
    }

    fn order(&mut self, _now: Tick, orders: &DriveOrders) {
        for (k, axis) in self.axes.iter_mut().enumerate() {
            axis.speed = match orders.mode {
                DriveMode::Follow if orders.axes[k].velocity.is_finite() => {
                    within(orders.axes[k].velocity, -axis.v_max, axis.v_max)
                }
                DriveMode::Follow => 0.0,
                DriveMode::QuickStop => axis.speed - within(axis.speed, -axis.quick_stop, axis.quick_stop),
                DriveMode::Off => 0.0,
            };
            // A cast of a float saturates, and not-a-number becomes 0.
            let counts = libm::round(axis.speed / axis.v_max * FULL_SPEED) as i32;
            self.registers.write(register::SPEED[k], counts);
        }
        let (turning, speed) = match orders.spindle {
            SpindleCommand::Stop => (0, 0.0),
            SpindleCommand::Clockwise(n) => (output::CLOCKWISE, n.0),
            SpindleCommand::Counterclockwise(n) => (output::COUNTERCLOCKWISE, n.0),
        };
        let share = within(speed / self.highest_spindle, 0.0, 1.0);
        self.registers
            .write(register::SPINDLE, libm::round(share * FULL_SPEED) as i32);
        let enable = if orders.mode == DriveMode::Off { 0 } else { output::ENABLE };
        self.registers
            .write(register::OUTPUTS, enable | turning | coolant_bits(orders.coolant));
        self.alive = self.alive.wrapping_add(1);
        self.registers.write(register::ALIVE, self.alive);
    }
}

fn coolant_bits(coolant: CoolantOutlets) -> i32 {
    let bit = |is_open: bool, bit: i32| if is_open { bit } else { 0 };
    bit(coolant.flood, output::FLOOD) | bit(coolant.mist, output::MIST) | bit(coolant.through, output::THROUGH)
}

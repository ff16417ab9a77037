//! System variables: what a program reads and writes of the control by number, from #1000 on.
//!
//! What the program itself decides (modal codes, end points, offsets) is answered at once. What only the machine knows (where it stands
//! now, the time, signals) is asked for; the block waits and is executed again. Without a machine the program's own count serves.

use crate::awaited::number_of;
use crate::evaluate::Variables;
use crate::fault::{Fault, Outcome, Site};
use crate::interpretation::Stop;
use crate::interpreter::{Interpreter, round_to};
use crate::macro_b::{Refusal, VACANT, Value, plain};
use crate::offsets::WorkKey;
use crate::profile::{FeedMode, Motion, Register};
use crate::text::characters;
use plan::{Missing, Question, RegisterChange, Severity, StepKind, StopKind};
use units::ToolNumber;

/// Largest size of a work offset, mm and inch.
const LARGEST_WORK_OFFSET: [f64; 2] = [99_999.999, 9999.9999];
/// #3001 begins anew here, milliseconds.
const TIMER_WRAP: f64 = 2_147_483_648.0;
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Places of an axis that the machine is asked for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    Machine,
    Work,
    Deviation,
}

impl Variables for Interpreter {
    fn memory(&self) -> &[f64] {
        self.memory.values()
    }

    fn read(&self, number: u32) -> Result<f64, Refusal> {
        self.system_variable(number)
    }

    fn known(&self, number: u32) -> Result<(), Refusal> {
        self.asks_for(number)
    }

    fn named(&self, name: &str) -> Option<u32> {
        self.names
            .iter()
            .find(|(_, n)| n.chars().filter(|c| *c != ' ').eq(name.chars()) || *n == name || n.replace(' ', "_") == name)
            .map(|(number, _)| *number)
    }

    fn parameter(&self, number: u32, bit: Option<u8>, axis: Option<u8>) -> f64 {
        let of_axis = axis
            .and_then(|k| self.profile.variable_axes.get(usize::from(k.wrapping_sub(1))))
            .and_then(|axis| self.settings.all.of_axis(number, *axis));
        match bit {
            None if of_axis.is_some() => of_axis.unwrap_or_default(),
            Some(bit) => f64::from(self.settings.all.bit(number, bit.min(7)).unwrap_or(false)),
            None => self.settings.all.value(number),
        }
    }

    fn with_point(&self, argument: f64) -> f64 {
        let increment = self.profile.increment[usize::from(self.inches)];
        if libm::trunc(argument) == argument {
            argument
        } else {
            round_to(argument / increment, 1.0)
        }
    }
}

impl Interpreter {
    // ---- writing

    /// Carries out `#i = value`; `end` is the byte behind the `=`.
    pub(crate) fn assign(&mut self, variable: u32, value: f64, at: usize, end: usize, site: Site<'_>) -> Outcome<()> {
        if self.memory.has(variable) {
            self.await_no_more(variable, at)?;
            self.memory.put(variable, value, self.origin);
            return Ok(());
        }
        self.memory.changes += 1;
        self.note_read_ahead(variable, at, site);
        match variable {
            // The program is over with it: what is kept has to be known first.
            3000 if self.macros.fanuc_ranges => Err(match self.kept_to_ask() {
                Some(question) => Refusal::asks(question).at(at),
                None => self.macro_alarm(plain(value), end, site),
            }),
            3006 if self.macros.fanuc_ranges => {
                let message = comment_behind(site.text, end);
                if self.options.trace {
                    self.trace.stops.push(Stop {
                        number: libm::round(plain(value)).clamp(0.0, 4095.0) as u32,
                        message: message.clone(),
                    });
                }
                self.emit(StepKind::Message(message));
                self.emit(StepKind::Stop(StopKind::Program));
                self.moved_since_stop = false;
                Ok(())
            }
            _ => {
                self.write_system_variable(variable, plain(value), at)?;
                if self.options.trace {
                    self.written.insert(variable);
                }
                Ok(())
            }
        }
    }

    /// `#3000=n(TEXT)`: the program alarms by itself.
    fn macro_alarm(&self, value: f64, end: usize, site: Site<'_>) -> Box<Fault> {
        let number = libm::round(value).clamp(0.0, 4095.0) as u32;
        let text = comment_behind(site.text, end);
        Fault::new(0, 3000 + number, "macro-alarm", text, "the program itself says so")
    }

    /// Machine positions read and offsets written while moves may be under way differ between controls: those that read ahead do it
    /// early.
    pub(crate) fn note_read_ahead(&mut self, variable: u32, at: usize, site: Site<'_>) {
        let matters = matches!(variable, 5021..=5080 | 5101..=5120 | 2001..=2999 | 5201..=5340 | 7001..=7960 | 10_001..=20_000);
        if matters && self.moved_since_stop && self.macros.fanuc_ranges {
            self.note(Severity::Warning, "read-ahead", site, at, || {
                (
                    format!("#{variable} is used while earlier moves may be under way: controls that read ahead do it too early"),
                    "put G53, G31 or an M code that stops the read-ahead before it".to_owned(),
                )
            });
        }
    }

    /// Writes a system variable; the value is in the program's unit.
    pub(crate) fn write_system_variable(&mut self, number: u32, value: f64, at: usize) -> Outcome<()> {
        if !self.macros.fanuc_ranges {
            return Err(Refusal::illegal(number).at(at));
        }
        let increment = self.profile.increment[usize::from(self.inches)];
        if let Some((tool, register)) = self.register_of(number) {
            let value = match register {
                Register::TipDirection => value,
                Register::Wear(_) | Register::RadiusWear => {
                    self.check_offset(value, self.largest_wear(), at)?;
                    round_to(value, increment)
                }
                _ => {
                    self.check_offset(value, self.largest_offset(), at)?;
                    round_to(value, increment)
                }
            };
            self.write_register(tool, register, value);
            return self.follow_tool_offset(tool);
        }
        if let Some((key, index)) = WorkKey::of_variable(number)
            && let Some(axis) = self.profile.variable_axes.get(index).copied()
        {
            self.check_offset(value, LARGEST_WORK_OFFSET[usize::from(self.inches)], at)?;
            let mm = round_to(value, increment) * self.unit() * self.profile.factor(axis);
            self.write_work_offset(key, axis, mm);
            self.follow_work_offsets();
            return Ok(());
        }
        match number {
            3001 => {
                self.timer_zero = self.powered_seconds().unwrap_or(self.nominal) - value / 1000.0;
                Ok(())
            }
            3002 => {
                self.given.insert(number, value);
                Ok(())
            }
            1132 => {
                let bits = libm::round(value) as i64;
                for k in 0..16 {
                    self.write_system_variable(1100 + k, ((bits >> k) & 1) as f64, at)?;
                }
                Ok(())
            }
            1100..=1115 | 1133 | 3003 | 3004 | 3005 | 3901 | 3902 => {
                let before = self.given.get(&number).copied().unwrap_or(0.0);
                self.given.insert(number, value);
                if before != value {
                    self.tell_register(plan::Register::Variable(number), before, value);
                }
                Ok(())
            }
            0 | 1000..=1035 | 3007 | 3008 | 3011 | 3012 | 3100..=3102 | 4001..=4530 | 5001..=5199 | 100_001..=100_250 => {
                Err(Refusal::write_protected(number).at(at))
            }
            _ => Err(Refusal::illegal(number).at(at)),
        }
    }

    /// A variable given before the start: read-only ones are what the machine would answer.
    pub(crate) fn give(&mut self, number: u32, value: f64) -> Outcome<()> {
        if self.memory.has(number) {
            self.memory.put(number, value, self.origin);
            return Ok(());
        }
        self.written.insert(number);
        match self.write_system_variable(number, value, 0) {
            Err(fault) if fault.number == 116 && number != 0 => {
                self.given.insert(number, value);
                Ok(())
            }
            other => other,
        }
    }

    fn write_register(&mut self, tool: u32, register: Register, value: f64) {
        let unit = self.unit();
        let along = |axis: usize| self.offset_factor(axis) * unit;
        let (mm, axis) = match register {
            Register::Geometry(axis) | Register::Wear(axis) => (value * along(axis), axis),
            Register::TipDirection => (value, 0),
            _ => (value * unit, 0),
        };
        let entry = self.tables.tools.entry(ToolNumber(tool)).or_default();
        let (before, changed) = match register {
            Register::Geometry(_) => (
                std::mem::replace(&mut entry.geometry.0.xyz[axis], mm),
                plan::Register::ToolGeometry { tool, axis },
            ),
            Register::Wear(_) => (
                std::mem::replace(&mut entry.wear.0.xyz[axis], mm),
                plan::Register::ToolWear { tool, axis },
            ),
            Register::Radius => (
                std::mem::replace(&mut entry.radius.0, mm),
                plan::Register::ToolRadius { tool },
            ),
            Register::RadiusWear => (
                std::mem::replace(&mut entry.radius_wear.0, mm),
                plan::Register::ToolRadiusWear { tool },
            ),
            Register::TipDirection => {
                let direction = libm::round(mm).clamp(0.0, 9.0) as u8;
                let before = f64::from(std::mem::replace(&mut entry.tip_direction, direction));
                (before, plan::Register::TipDirection { tool })
            }
        };
        self.tell_register(changed, before, mm);
    }

    /// Tells the machine what of a tool's entry was written.
    pub(crate) fn tell_tool(&mut self, tool: u32, was: &plan::ToolEntry) {
        let Some(now) = self.tables.tools.get(&ToolNumber(tool)).cloned() else {
            return;
        };
        let mut changes = Vec::new();
        for axis in 0..3 {
            let geometry = plan::Register::ToolGeometry { tool, axis };
            changes.push((geometry, was.geometry.0.xyz[axis], now.geometry.0.xyz[axis]));
            let wear = plan::Register::ToolWear { tool, axis };
            changes.push((wear, was.wear.0.xyz[axis], now.wear.0.xyz[axis]));
        }
        changes.push((plan::Register::ToolRadius { tool }, was.radius.0, now.radius.0));
        changes.push((plan::Register::ToolRadiusWear { tool }, was.radius_wear.0, now.radius_wear.0));
        let tips = (f64::from(was.tip_direction), f64::from(now.tip_direction));
        changes.push((plan::Register::TipDirection { tool }, tips.0, tips.1));
        for (register, before, after) in changes {
            if before != after {
                self.tell_register(register, before, after);
            }
        }
    }

    /// Tells the machine that a register of its tables was written.
    pub(crate) fn tell_register(&mut self, register: plan::Register, before: f64, after: f64) {
        self.emit(StepKind::Register(RegisterChange {
            register,
            before: Some(before),
            after: Some(after),
        }));
    }

    /// The offset entry that a variable shows.
    fn register_of(&self, number: u32) -> Option<(u32, Register)> {
        let ranges = match self.settings.series_15 && !self.profile.series_15_variables.is_empty() {
            true => self.profile.series_15_variables,
            false => self.profile.offset_variables,
        };
        ranges
            .iter()
            .find(|r| number >= r.first && number - r.first < r.count)
            .map(|r| (number - r.first + 1, r.register))
    }

    /// Millimetres of an axis for each millimetre that an offset register says.
    pub(crate) fn offset_factor(&self, axis: usize) -> f64 {
        if self.settings.radius_offsets {
            1.0
        } else {
            self.profile.factor(axis)
        }
    }

    // ---- reading

    pub(crate) fn system_variable(&self, number: u32) -> Result<f64, Refusal> {
        if !self.macros.fanuc_ranges {
            return match number {
                5420..=5422 => Ok(self.in_program(number as usize - 5420, self.tip[number as usize - 5420])),
                _ => Err(Refusal::illegal(number)),
            };
        }
        // Positions of controls with many axes lie in ranges of fifty.
        let number = match number {
            100_001..=100_250 => 5001 + (number - 100_001) / 50 * 20 + (number - 100_001) % 50,
            other => other,
        };
        if let Some(value) = self.given.get(&number) {
            return Ok(*value);
        }
        match number {
            4001..=4130 => self.modal_variable(number).ok_or_else(|| Refusal::illegal(number)),
            4201..=4330 => self.modal_variable(number - 200).ok_or_else(|| Refusal::illegal(number)),
            4401..=4530 => self.modal_variable(number - 400).ok_or_else(|| Refusal::illegal(number)),
            5001..=5120 => self.position(number),
            3001 => {
                let seconds = self.asked_for("EQUIPMENT_TIMER.POWERED")? - self.timer_zero;
                Ok(libm::fmod(libm::floor(seconds * 1000.0 + 1e-6), TIMER_WRAP))
            }
            3002 => Ok(self.asked_for("EQUIPMENT_TIMER.WORKING")? / 3600.0),
            3011 => Ok(date_of(self.asked_for("CLOCK_TIME")?)),
            3012 => Ok(time_of(self.asked_for("CLOCK_TIME")?)),
            3005 => Ok(if self.inches { 4.0 } else { 0.0 }),
            3003 | 3004 | 3007 | 3008 | 3901 | 3902 | 1100..=1115 | 1133 => Ok(0.0),
            1132 => Ok(self.word_of(1100)),
            3100 => Ok(VACANT),
            3101 => Ok(std::f64::consts::PI),
            3102 => Ok(std::f64::consts::E),
            1000..=1015 if self.given.contains_key(&1032) => {
                let word = self.given.get(&1032).copied().unwrap_or_default();
                Ok(((libm::round(word) as i64) >> (number - 1000) & 1) as f64)
            }
            1032 if self.given.range(1000..=1015).next().is_some() => Ok(self.word_of(1000)),
            1000..=1015 | 1032..=1035 => self.asked_for(&format!("PMC.INPUT.{number}")),
            _ => self.offset_variable(number),
        }
    }

    /// Sixteen signals from `first` on as the bits of one number.
    fn word_of(&self, first: u32) -> f64 {
        let on = |k: &u32| self.given.get(&(first + k)).is_some_and(|v| *v != 0.0);
        (0..16).filter(on).map(|k| f64::from(1_u32 << k)).sum()
    }

    /// Largest geometry entry, in the program's unit.
    pub(crate) fn largest_offset(&self) -> f64 {
        self.profile.largest_offset[usize::from(self.inches)]
    }

    /// Largest wear entry: parameter 5013 may narrow it.
    pub(crate) fn largest_wear(&self) -> f64 {
        self.narrowed(self.settings.largest_wear)
    }

    /// Largest change of a wear entry by an incremental word: parameter 5014.
    pub(crate) fn largest_wear_step(&self) -> f64 {
        self.narrowed(self.settings.largest_wear_step)
    }

    fn narrowed(&self, parameter: f64) -> f64 {
        let counted = match self.profile.limits_in_increments {
            true => parameter * self.profile.increment[usize::from(self.inches)],
            false => parameter,
        };
        match counted > 0.0 {
            true => counted.min(self.largest_offset()),
            false => self.largest_offset(),
        }
    }

    /// Alarm 032 for what an offset cannot hold; both in the program's unit.
    pub(crate) fn check_offset(&self, value: f64, largest: f64, at: usize) -> Outcome<()> {
        // A millionth of a step is the dust of a sum of decimals.
        if value.abs() <= largest + 1e-9 {
            return Ok(());
        }
        Err(Fault::new(
            at,
            32,
            "offset-range",
            format!("{} is too large an offset: {largest} is the most here", cleaned(value)),
            "check the value before it is written; parameters 5013 and 5014 limit wear",
        ))
    }

    fn offset_variable(&self, number: u32) -> Result<f64, Refusal> {
        let Some((tool, register)) = self.register_of(number) else {
            return self.work_offset_variable(number);
        };
        let Some(entry) = self.tables.tools.get(&ToolNumber(tool)) else {
            return Ok(0.0); // an entry that nobody made shows 0 on the control too
        };
        let shown = |mm: f64| cleaned(mm / self.unit());
        let along = |axis: usize, mm: f64| cleaned(mm / self.offset_factor(axis) / self.unit());
        Ok(match register {
            Register::Geometry(axis) => along(axis, entry.geometry.0.xyz[axis]),
            Register::Wear(axis) => along(axis, entry.wear.0.xyz[axis]),
            Register::Radius => shown(entry.radius.0),
            Register::RadiusWear => shown(entry.radius_wear.0),
            Register::TipDirection => f64::from(entry.tip_direction),
        })
    }

    fn work_offset_variable(&self, number: u32) -> Result<f64, Refusal> {
        if let Some((key, index)) = WorkKey::of_variable(number)
            && let Some(axis) = self.profile.variable_axes.get(index)
        {
            let origin = self.tables.work_offsets.get(&key.name()).map_or(0.0, |t| t.origin[*axis]);
            if !self.is_known(key) && self.tables.missing == Missing::Fail && key != WorkKey::External {
                return Err(Refusal::new(
                    115,
                    format!("#{number} shows work offset {}, which is not in the tables", key.name()),
                    "enter it first",
                ));
            }
            return Ok(self.in_program(*axis, origin));
        }
        Err(Refusal::illegal(number))
    }

    /// A length along an axis as the program writes it.
    pub(crate) fn in_program(&self, axis: usize, mm: f64) -> f64 {
        cleaned(mm / self.profile.factor(axis) / self.unit())
    }

    /// Where the program says the tip is: offsets that came into force since do not show.
    pub(crate) fn programmed(&self, axis: usize) -> f64 {
        self.tip[axis] + self.carried[axis]
    }

    /// #5001 to #5120.
    fn position(&self, number: u32) -> Result<f64, Refusal> {
        let (range, index) = ((number - 5001) / 20, (number - 5001) % 20);
        let Some(axis) = self.profile.variable_axes.get(index as usize).copied() else {
            return Err(Refusal::illegal(number));
        };
        match range {
            0 => Ok(self.in_program(axis, self.programmed(axis))),
            1 => self.machine_place(axis, Asked::Machine),
            2 => self.machine_place(axis, Asked::Work),
            3 => Ok(self.in_program(axis, self.skip_position[axis])),
            4 => Ok(self.in_program(axis, self.offset.total().xyz[axis])),
            5 => self.machine_place(axis, Asked::Deviation),
            _ => Err(Refusal::illegal(number)),
        }
    }

    fn machine_place(&self, axis: usize, asked: Asked) -> Result<f64, Refusal> {
        let letter = AXES[axis];
        match asked {
            Asked::Deviation => Ok(self.in_program(axis, self.asked_for(&format!("{letter}.POSITION.DEVIATION"))?)),
            Asked::Machine => Ok(self.in_program(axis, self.asked_for(&format!("{letter}.POSITION.ACTUAL"))?)),
            Asked::Work => {
                let machine = self.asked_for(&format!("{letter}.POSITION.ACTUAL"))?;
                Ok(self.in_program(axis, machine - self.frame.origin()[axis]))
            }
        }
    }

    /// What the machine answered, in mm or seconds; asks it when it was not asked yet.
    pub(crate) fn asked_for(&self, name: &str) -> Result<f64, Refusal> {
        match self.answers.get(name) {
            Some(value) => Ok(*value),
            None => Err(Refusal::asks(Question::Number(name.to_owned()))),
        }
    }

    fn powered_seconds(&self) -> Option<f64> {
        self.answers.get("EQUIPMENT_TIMER.POWERED").copied().or(self.last_powered)
    }

    /// What the program itself makes of a question that no machine answers, and whether that is a mere assumption.
    pub(crate) fn own_count(&self, name: &str) -> (f64, bool) {
        if let Some(number) = number_of(name) {
            return (self.memory.values().get(number as usize).copied().unwrap_or(VACANT), true);
        }
        for (axis, letter) in AXES.iter().enumerate() {
            if let Some(rest) = name.strip_prefix(letter) {
                match rest {
                    ".POSITION.ACTUAL" => return (self.gauge()[axis], false),
                    ".POSITION.DEVIATION" => return (0.0, false),
                    _ => {}
                }
            }
        }
        match name {
            "EQUIPMENT_TIMER.POWERED" | "EQUIPMENT_TIMER.WORKING" | "CLOCK_TIME" => (self.nominal, false),
            _ => (0.0, true),
        }
    }

    /// #4001 and on: what is in force. Group numbers differ between mills and lathes.
    pub(crate) fn modal_variable(&self, number: u32) -> Option<f64> {
        let mill = !self.profile.turning;
        let either = |on: bool, yes: f64, no: f64| if on { yes } else { no };
        Some(match number {
            4001 => match (self.turning_cycles.single, self.motion) {
                (Some(single), _) => f64::from(single.code()),
                (None, Motion::Thread) if mill => 33.0,
                (None, Motion::Thread) => 32.0,
                (None, Motion::RigidTap) => 33.1,
                (None, motion) => f64::from(motion as u8),
            },
            4002 if mill => f64::from(17 + self.plane as u8),
            4002 => either(self.surface.is_some(), 96.0, 97.0),
            4003 if mill => either(self.incremental, 91.0, 90.0),
            4005 => match (mill, self.feed_mode) {
                (true, FeedMode::InverseTime) => 93.0,
                (true, FeedMode::PerMinute) => 94.0,
                (true, FeedMode::PerRevolution) => 95.0,
                (false, FeedMode::PerRevolution) => 99.0,
                (false, _) => 98.0,
            },
            4006 => either(self.inches, 20.0, 21.0),
            4007 => f64::from(40 + self.side as u8),
            4008 if mill => match self.length_sign {
                0 => 49.0,
                1 => 43.0,
                _ => 44.0,
            },
            4009 if mill => self.cycle.as_ref().map_or(80.0, |c| f64::from(c.code)),
            4010 if mill => either(self.return_to_r, 99.0, 98.0),
            4011 if mill => either(self.shaping.is_scaled(), 51.0, 50.0),
            4012 => either(self.modal.is_empty(), 67.0, 66.0),
            4013 if mill => either(self.surface.is_some(), 96.0, 97.0),
            4014 => match self.frame.key {
                WorkKey::Standard(n) => 53.0 + f64::from(n),
                _ => 54.1,
            },
            4015 if mill => either(self.path_mode == plan::PathMode::ExactStop, 61.0, 64.0),
            4016 if !mill => f64::from(17 + self.plane as u8),
            4016 => either(self.shaping.is_rotated(), 68.0, 69.0),
            4017 if mill => either(self.shaping.is_polar(), 16.0, 15.0),
            4022 if mill => either(self.shaping.is_mirrored(), 51.1, 50.1),
            4107 => f64::from(self.d),
            4108 | 4102 => 0.0,
            4109 => self.feed.map_or(0.0, |f| match self.feed_mode {
                FeedMode::PerMinute => cleaned(f * 60.0 / self.unit()),
                FeedMode::PerRevolution => cleaned(f / self.unit()),
                FeedMode::InverseTime => cleaned(60.0 / f),
            }),
            4111 => f64::from(self.h),
            4113 => f64::from(self.last_m),
            4114 => f64::from(self.last_n),
            4115 => f64::from(self.program_number),
            4119 => self.last_s.unwrap_or(self.revolutions),
            4120 => f64::from(self.trace.tool.unwrap_or(0)),
            4130 => match self.frame.key {
                WorkKey::More(p) => f64::from(p),
                _ => 0.0,
            },
            4004 | 4017..=4022 => 0.0,
            _ => return None,
        })
    }

    /// What the report shows of the system variables that were given or written.
    pub(crate) fn written_variables(&self) -> Vec<(u32, Value)> {
        let value = |n: u32| match n {
            3001 => Ok(libm::floor(
                (self.powered_seconds().unwrap_or(self.nominal) - self.timer_zero) * 1000.0 + 1e-6,
            )),
            _ => self.system_variable(n),
        };
        self.written
            .iter()
            .filter_map(|n| value(*n).ok().map(|v| (*n, Value::of(v))))
            .collect()
    }
}

/// A decimal that went through another unit: what the program wrote comes back as it was written.
fn cleaned(value: f64) -> f64 {
    let steps = value * 1e9;
    if steps.abs() < 9e15 { libm::round(steps) / 1e9 } else { value }
}

/// Year, month, day as one number, of seconds since 1970.
fn date_of(seconds: f64) -> f64 {
    // Days to civil date, after Howard Hinnant's algorithm; eras of 400 years.
    let days = libm::floor(seconds / 86_400.0) as i64 + 719_468;
    let era = days.div_euclid(146_097);
    let of_era = days.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (month, year) = if month < 10 {
        (month + 3, year_of_era + era * 400)
    } else {
        (month - 9, year_of_era + era * 400 + 1)
    };
    (year * 10_000 + month * 100 + day) as f64
}

/// Hour, minute, second as one number.
fn time_of(seconds: f64) -> f64 {
    let of_day = (libm::floor(seconds) as i64).rem_euclid(86_400);
    (of_day / 3600 * 10_000 + of_day / 60 % 60 * 100 + of_day % 60) as f64
}

/// The first comment behind a byte.
pub(crate) fn comment_behind(text: &[u8], end: usize) -> String {
    let rest = text.get(end..).unwrap_or_default();
    let open = rest.iter().position(|b| *b == b'(');
    let close = rest.iter().position(|b| *b == b')');
    match (open, close) {
        (Some(open), Some(close)) if open < close => characters(&rest[open + 1..close]).trim().to_owned(),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_the_date_and_time_of_the_control() {
        assert_eq!((date_of(0.0), time_of(0.0)), (19_700_101.0, 0.0));
        assert_eq!((date_of(951_827_696.0), time_of(951_827_696.0)), (20_000_229.0, 123_456.0));
    }
}

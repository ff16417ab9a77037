//! System variables: what a program reads and writes of the control by number, from #1000 on.

use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::Interpreter;
use crate::macro_b::{Refusal, Value};
use crate::offsets::WorkKey;
use crate::profile::{FeedMode, Motion, Register};
use crate::text::characters;
use plan::{Missing, StepKind, StopKind};
use units::ToolNumber;

impl Interpreter {
    // ---- macro statements

    /// Carries out `#i = value`; `end` is the byte behind it.
    pub(crate) fn assign(&mut self, variable: u32, value: Value, at: usize, end: usize, site: Site<'_>) -> Outcome<()> {
        if self.memory.has(variable) {
            self.memory.write(variable, value);
            return Ok(());
        }
        match variable {
            3000 => Err(self.macro_alarm(value, end, site)),
            3006 => {
                let text = comment_behind(site.text, end);
                self.emit(StepKind::Message(text));
                self.emit(StepKind::Stop(StopKind::Program));
                Ok(())
            }
            _ => self.write_system_variable(variable, value, at),
        }
    }

    /// `#3000=n(TEXT)`: the program alarms by itself.
    fn macro_alarm(&self, value: Value, end: usize, site: Site<'_>) -> Box<Fault> {
        let number = libm::round(value.number()).clamp(0.0, 4095.0) as u32;
        let text = comment_behind(site.text, end);
        Fault::new(0, 3000 + number, "macro-alarm", text, "the program itself says so")
    }

    /// #4001 and on: what is in force. Group numbers differ between mills and lathes; where they do, the lathe's are left out.
    pub(crate) fn modal_variable(&self, number: u32) -> Option<f64> {
        let mill = !self.profile.turning;
        Some(match number {
            4001 => match (self.turning_cycles.single, self.motion) {
                (Some(single), _) => f64::from(single.code()),
                (None, Motion::Thread) if mill => 33.0,
                (None, Motion::Thread) => 32.0,
                (None, motion) => f64::from(motion as u8),
            },
            4002 if mill => f64::from(17 + self.plane as u8),
            4002 => {
                if self.surface.is_some() {
                    96.0
                } else {
                    97.0
                }
            }
            4003 if mill => {
                if self.incremental {
                    91.0
                } else {
                    90.0
                }
            }
            4005 => match (mill, self.feed_mode) {
                (true, FeedMode::InverseTime) => 93.0,
                (true, FeedMode::PerMinute) => 94.0,
                (true, FeedMode::PerRevolution) => 95.0,
                (false, FeedMode::PerRevolution) => 99.0,
                (false, _) => 98.0,
            },
            4006 => {
                if self.inches {
                    20.0
                } else {
                    21.0
                }
            }
            4007 => f64::from(40 + self.side as u8),
            4008 if mill => match self.length_sign {
                0 => 49.0,
                1 => 43.0,
                _ => 44.0,
            },
            4009 if mill => self.cycle.as_ref().map_or(80.0, |c| f64::from(c.code)),
            4010 if mill => {
                if self.return_to_r {
                    99.0
                } else {
                    98.0
                }
            }
            4014 => match self.frame.key {
                WorkKey::Standard(n) => 53.0 + f64::from(n),
                _ => 54.1,
            },
            4107 => f64::from(self.d),
            4109 => self.feed.map_or(0.0, |f| match self.feed_mode {
                FeedMode::PerMinute => f * 60.0 / self.unit(),
                FeedMode::PerRevolution => f / self.unit(),
                FeedMode::InverseTime => 60.0 / f,
            }),
            4111 => f64::from(self.h),
            4113 => f64::from(self.last_m),
            4114 => f64::from(self.last_n),
            4115 => f64::from(self.program_number),
            4119 => self.revolutions,
            4120 => match &self.preselected {
                Some((number, _)) => f64::from(*number),
                None => {
                    f64::from(self.tool.unwrap_or(0) * if mill { 1 } else { 100 } + if mill { 0 } else { self.offset.number })
                }
            },
            _ => return None,
        })
    }

    // ---- system variables

    pub(crate) fn system_variable(&self, number: u32) -> Result<Value, Refusal> {
        let in_program = |axis: usize, mm: f64| Value::Number(mm / self.profile.factor(axis) / self.unit());
        if let Some(value) = self.modal_variable(number) {
            return Ok(Value::Number(value));
        }
        if let 5001..=5020 = number
            && let Some(axis) = self.profile.variable_axes.get((number - 5001) as usize)
        {
            return Ok(in_program(*axis, self.tip[*axis]));
        }
        if let Some((key, index)) = WorkKey::of_variable(number)
            && let Some(axis) = self.profile.variable_axes.get(index)
            && self.profile.macros.fanuc_ranges
        {
            let origin = self.tables.work_offsets.get(&key.name()).map_or(0.0, |t| t.origin[*axis]);
            if !self.is_known(key) && self.tables.missing == Missing::Fail && key != WorkKey::External {
                return Err(Refusal {
                    number: 115,
                    message: format!("#{number} shows work offset {}, which is not in the tables", key.name()),
                    remedy: "enter it first",
                });
            }
            return Ok(in_program(*axis, origin));
        }
        for range in self.profile.offset_variables {
            if number >= range.first && number - range.first < range.count {
                let tool = number - range.first + 1;
                let Some(entry) = self.tables.tools.get(&ToolNumber(tool)) else {
                    // An entry that nobody made shows 0 on the control too.
                    return Ok(Value::Number(0.0));
                };
                return Ok(match range.register {
                    Register::Geometry(axis) => in_program(axis, entry.geometry.0.xyz[axis]),
                    Register::Wear(axis) => in_program(axis, entry.wear.0.xyz[axis]),
                    Register::Radius => Value::Number(entry.diameter.map_or(0.0, |d| d.0 / 2.0) / self.unit()),
                    Register::RadiusWear => Value::Number(entry.radius_wear.0 / self.unit()),
                });
            }
        }
        Err(match number {
            1000.. => Refusal::not_there_yet(number),
            _ => Refusal::illegal(number),
        })
    }

    pub(crate) fn write_system_variable(&mut self, number: u32, value: Value, at: usize) -> Outcome<()> {
        if let Some((key, index)) = WorkKey::of_variable(number)
            && let Some(axis) = self.profile.variable_axes.get(index).copied()
            && self.profile.macros.fanuc_ranges
        {
            let mm = value.number() * self.unit() * self.profile.factor(axis);
            self.write_work_offset(key, axis, mm);
            self.follow_work_offsets();
            return Ok(());
        }
        Err(match number {
            0 | 4001..=4130 | 5001..=5120 => Refusal::write_protected(number),
            1000.. => Refusal::not_there_yet(number),
            _ => Refusal::illegal(number),
        }
        .at(at))
    }
}

fn comment_behind(text: &[u8], end: usize) -> String {
    let rest = text.get(end..).unwrap_or_default();
    let open = rest.iter().position(|b| *b == b'(');
    let close = rest.iter().position(|b| *b == b')');
    match (open, close) {
        (Some(open), Some(close)) if open < close => characters(&rest[open + 1..close]).trim().to_owned(),
        _ => String::new(),
    }
}

//! Haas NGC, mills and lathes: Fanuc's language with its own smoothness (G187), work offsets (G154 P) and sensor variables.

use crate::alike;
use crate::control::Control;
use crate::functions::{Item, NO_SOURCE, OWN_SENSOR, Reading};
use crate::grade::Verdict;
use crate::macro_b::{self, Series, statements};
use crate::sheet::{Paper, Refusal, Sheet};
use crate::statement::Statement;
use plan::{Expression, PathMode};
use trace::{Call, Function};

/// The control.
pub struct Haas;

const SERIES: Series = Series {
    times_verified: true,
    largest_alarm: (999, true),
    longest_alarm: 31,
};

const BESIDE: &str = "a recorder over MTConnect or the machine data port";

impl Control for Haas {
    fn name(&self) -> &'static str {
        "haas"
    }
    fn about(&self) -> &'static str {
        "Haas NGC, macros"
    }
    fn ending(&self) -> &'static str {
        "nc"
    }
    fn paper(&self) -> Paper {
        Paper {
            line_end: "\r\n",
            most_labels: 99_999,
            ..statements::PAPER
        }
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                statements::begin(head, 5, " ", sheet)?;
                statements::rely_on(sheet);
                Ok(())
            }
            Statement::End => {
                sheet.line("M30");
                sheet.line("%");
                Ok(())
            }
            Statement::PathMode(mode) => {
                match mode {
                    PathMode::ExactStop => sheet.line("G61"),
                    PathMode::ExactPath => {
                        sheet.notice("a path that may not be left is run with exact stop (G61)");
                        sheet.line("G61");
                    }
                    PathMode::Tolerance(tolerance) => {
                        sheet.line("G64");
                        match tolerance {
                            Some(tolerance) => {
                                let tolerance = sheet.length(tolerance.0)?;
                                sheet.line(&format!("G187 E{tolerance}"));
                                sheet.verify("G187 E for the tolerance of corners");
                                sheet.modal.tolerance_on = true;
                            }
                            None if sheet.modal.tolerance_on => {
                                sheet.line("G187");
                                sheet.modal.tolerance_on = false;
                            }
                            None => {}
                        }
                    }
                }
                Ok(())
            }
            Statement::Dwell(time) => {
                let seconds = sheet.length(*time)?;
                sheet.line(&format!("G4 P{seconds}"));
                Ok(())
            }
            Statement::Work(number) => {
                let name = self.work_name(*number);
                if *number > 105 {
                    return Err(alike::no_work_offset(format!("work offset {name} is beyond G154 P99")));
                }
                sheet.line(&name);
                Ok(())
            }
            Statement::Retract if !sheet.turning => {
                sheet.line("G53 G0 Z0.");
                sheet.modal.motion = None;
                Ok(())
            }
            Statement::Register(change) if matches!(&change.register, plan::Register::WorkOffset { name, .. } if name.starts_with("G54.1")) => {
                Err(Refusal::new(
                    "register",
                    format!("{} has another number on a Haas", change.register.name()),
                    "enter the offset at the machine",
                ))
            }
            Statement::Tap {
                bottom,
                back,
                pitch,
                left,
                speed,
                ..
            } => {
                let words = statements::tap(*bottom, *back, *pitch, *left, *speed, sheet)?;
                sheet.line(&format!("{} S{}", words.cycle, words.turns));
                sheet.line("G80");
                sheet.verify("tapping by G84 with a feed per revolution");
                sheet.modal.forget();
                Ok(())
            }
            other => statements::write(other, self, sheet),
        }
    }

    fn work_name(&self, number: u32) -> String {
        match number {
            1..=6 => format!("G{}", 53 + number),
            more => format!("G154 P{}", more - 6),
        }
    }
    fn variable(&self, number: u32) -> Result<String, Refusal> {
        macro_b::variable(number)
    }
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
        macro_b::value(expression, self, sheet)
    }

    fn reading(&self, stream: &str, turning: bool) -> Reading {
        if let Some(timer) = macro_b::timer(stream) {
            return Reading::Value(timer);
        }
        if let Some(position) = macro_b::position(stream, turning) {
            return Reading::Value(position);
        }
        let (component, kind) = stream.split_once('.').unwrap_or((stream, ""));
        let axis = alike::linear(component);
        match (kind, axis) {
            ("", _) if stream == "trace:tool" => Reading::unsure("#3026"),
            ("POSITION.ACTUAL", Some(axis)) => {
                let index = if turning && axis == 2 { 1 } else { axis };
                Reading::unsure(format!("#{}", 5041 + index))
            }
            ("LOAD", Some(axis)) => Reading::known(format!("#{}", 1064 + axis)),
            ("LOAD", None) if component == "S1" => Reading::known("#1098"),
            // Which of the filtered analog values is which motor is the machine's.
            (kind, Some(axis)) if kind.starts_with("AMPERAGE") => Reading::unsure(format!("#{}", 1090 + axis)),
            ("LINEAR_FORCE", Some(axis)) => Reading::unsure(format!("#{}", 1080 + axis)),
            ("PRESSURE", None) => Reading::unsure("#1083"),
            ("FILL_LEVEL", None) => Reading::unsure("#1084"),
            ("TEMPERATURE", None) if component == "COOLANT" => Reading::unsure("#1085"),
            ("FLOW", None) => Reading::unsure("#1086"),
            ("ACCELERATION", None) if component == "TOOL" => Reading::Outside(
                "#1801 to #2000 hold the largest vibration of each tool, not the present one: an external sensor",
            ),
            ("ACCELERATION" | "SOUND_LEVEL" | "TEMPERATURE", None) => OWN_SENSOR,
            ("DISPLACEMENT", None) => Reading::unsure("#[2200+#3026]"),
            _ => NO_SOURCE,
        }
    }

    fn start_timer(&self, timer: usize) -> Vec<String> {
        macro_b::start_timer(timer)
    }
    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        sheet.verify("DPRNT: where lines go is a setting");
        macro_b::dprnt(items, sheet)
    }
    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        let index = tool.map_or("#3026".to_owned(), |number| number.to_string());
        Some(vec![
            ("NUMBER", Reading::unsure(index.clone())),
            ("LENGTH", Reading::unsure(format!("#[2000+{index}]"))),
            (
                "WEAR",
                match tool {
                    Some(_) => Reading::known(format!("#[2200+{index}]")),
                    None => Reading::unsure(format!("#[2200+{index}]")),
                },
            ),
        ])
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }
    fn polls(&self) -> bool {
        true
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        if let Call::SetEditAccessLevel { .. } = function.call {
            return Ok(Some(Verdict::external(
                "edit protection is the control's (settings 7 and 8, memory lock), not the program's",
            )));
        }
        macro_b::function(function, &SERIES, self, sheet)
    }
}

//! Fanuc 0i, 16i to 32i and relatives, mills and lathes (G-code system A), with Custom Macro B.
//!
//! Macro statements are executed when the block is read, which is ahead of the tool: nothing here runs in the servo cycle.

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
pub struct Fanuc;

/// Older series take alarms 0 to 200 with 26 letters.
const SERIES: Series = Series {
    times_verified: false,
    largest_alarm: (200, false),
    longest_alarm: 26,
};

const BESIDE: &str = "a recorder over FOCAS (loads and positions about every 250 ms) or MTConnect";

impl Control for Fanuc {
    fn name(&self) -> &'static str {
        "fanuc"
    }
    fn about(&self) -> &'static str {
        "Fanuc 0i to 32i, Custom Macro B"
    }
    fn ending(&self) -> &'static str {
        "nc"
    }
    fn paper(&self) -> Paper {
        statements::PAPER
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                statements::begin(head, 4, "", sheet)?;
                if head.logs {
                    sheet.line("POPEN");
                    sheet.verify("POPEN, DPRNT and PCLOS: where lines go is set by parameters");
                }
                statements::rely_on(sheet);
                sheet.notes.insert("logs".to_owned(), vec![u32::from(head.logs)]);
                Ok(())
            }
            Statement::End => {
                if sheet.notes.get("logs") == Some(&vec![1]) {
                    sheet.line("PCLOS");
                }
                sheet.line("M30");
                sheet.line("%");
                Ok(())
            }
            Statement::PathMode(mode) => {
                let word = match mode {
                    PathMode::ExactStop => "G61",
                    PathMode::ExactPath => {
                        sheet.notice("a path that may not be left is run with exact stop (G61)");
                        "G61"
                    }
                    PathMode::Tolerance(tolerance) => {
                        if tolerance.is_some() {
                            sheet.notice("tolerances of paths are set by parameters of the control, not by the program");
                        }
                        "G64"
                    }
                };
                if sheet
                    .notes
                    .insert("path mode".to_owned(), word.bytes().map(u32::from).collect())
                    != Some(word.bytes().map(u32::from).collect())
                {
                    sheet.line(word);
                }
                Ok(())
            }
            Statement::Dwell(time) => {
                let milliseconds = (time * 1000.0).round();
                if milliseconds >= 1.0 {
                    sheet.line(&format!("G4 P{milliseconds}"));
                }
                Ok(())
            }
            Statement::Work(number) => {
                let name = self.work_name(*number);
                if *number > 54 {
                    return Err(alike::no_work_offset(format!("work offset {name} is beyond G54.1 P48")));
                }
                sheet.line(&name);
                Ok(())
            }
            Statement::Tap {
                bottom,
                back,
                pitch,
                left,
                speed,
                ..
            } => {
                // R of a lathe counts from where the tool stands, and it stands there.
                let r = if sheet.turning { 0 } else { *back };
                let words = statements::tap(*bottom, r, *pitch, *left, *speed, sheet)?;
                sheet.line(&format!("M29 S{}", words.turns));
                sheet.line(&words.cycle);
                sheet.line("G80");
                sheet.verify("M29 for rigid tapping");
                sheet.modal.forget();
                Ok(())
            }
            other => statements::write(other, self, sheet),
        }
    }

    fn work_name(&self, number: u32) -> String {
        match number {
            1..=6 => format!("G{}", 53 + number),
            more => format!("G54.1 P{}", more - 6),
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
            return Reading::Value(position.verified());
        }
        let kind = stream.split_once('.').map_or(stream, |(_, kind)| kind);
        match kind {
            "trace:tool" => Reading::known("#4120"),
            _ if kind.starts_with("POSITION") => {
                Reading::Outside("the encoders' position needs the servo lag: a recorder over FOCAS (cnc_rdaxisdata)")
            }
            "DISPLACEMENT" if stream.starts_with("TOOL.") => {
                let registers = if turning {
                    "#[2000+#4120-FIX[#4120/100]*100]"
                } else {
                    "#[10000+#4111]"
                };
                Reading::unsure(registers)
            }
            "DISPLACEMENT" => Reading::Outside("the following error is srvdelay of FOCAS"),
            "LOAD" => Reading::Outside("loads are no macro variables: cnc_rdaxisdata of FOCAS"),
            _ if kind.starts_with("AMPERAGE") => Reading::Outside("currents: cnc_rdaxisdata of FOCAS, class 2"),
            _ if kind.starts_with("PATH_FEEDRATE") => Reading::Outside("the actual feed: actf of FOCAS"),
            _ if kind.starts_with("AXIS_FEEDRATE") => Reading::Outside("motor speeds: cnc_rdaxisdata of FOCAS, class 5"),
            _ if kind.starts_with("ROTARY_VELOCITY") => Reading::Outside("the actual spindle speed: acts of FOCAS"),
            "LINEAR_FORCE" => Reading::Outside("an analog input of the PMC"),
            "PRESSURE" | "FILL_LEVEL" | "TEMPERATURE" | "FLOW" if stream.starts_with("COOLANT.") => {
                Reading::Outside("inputs of the PMC (R, D), by its window or interface bits from #1000")
            }
            "ACCELERATION" | "SOUND_LEVEL" | "TEMPERATURE" if stream.starts_with("TOOL.") || stream.starts_with("BEARING.") => {
                OWN_SENSOR
            }
            _ => NO_SOURCE,
        }
    }

    fn start_timer(&self, timer: usize) -> Vec<String> {
        macro_b::start_timer(timer)
    }
    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        macro_b::dprnt(items, sheet)
    }
    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        let index = tool.map_or("#4120".to_owned(), |number| number.to_string());
        Some(vec![
            ("NUMBER", Reading::known(index.clone())),
            ("LENGTH", Reading::unsure(format!("#[11000+{index}]"))),
            ("WEAR", Reading::unsure(format!("#[10000+{index}]"))),
        ])
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        if let Call::SetEditAccessLevel { .. } = function.call {
            return Ok(Some(Verdict::external(
                "edit protection is the control's (O8000 and O9000 lock bits, 8-level protection), not the program's",
            )));
        }
        macro_b::function(function, &SERIES, self, sheet)
    }
}

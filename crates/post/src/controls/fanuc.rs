//! Fanuc 0i, 16i to 32i and relatives, mills and lathes (G-code system A), with Custom Macro B.
//!
//! Lengths carry their point, because a whole number may be least increments (parameter 3401.0). Macro statements are executed when
//! the block is read, which is ahead of the tool: nothing here runs in the servo cycle.

use crate::control::Control;
use crate::functions::{Item, Reading, Source};
use crate::grade::Verdict;
use crate::iso::{self, Codes};
use crate::letters::Letters;
use crate::macro_b::{self, MacroJumps};
use crate::number::Decimals;
use crate::sheet::{Paper, Refusal, Sheet};
use crate::statement::Statement;
use plan::{Expression, PathMode, SpindleMode, StopKind};
use trace::{Call, Function};

/// The control.
pub struct Fanuc;

const LENGTHS: Decimals = Decimals {
    places: 3,
    point: true,
    plus: false,
};

pub(super) const PAPER: Paper = Paper {
    lengths: LENGTHS,
    feeds: [
        LENGTHS,
        Decimals {
            places: 4,
            point: true,
            plus: false,
        },
    ],
    speeds: Decimals {
        places: 0,
        point: false,
        plus: false,
    },
    largest: 99_999.999,
    line_end: "\n",
    longest: 128,
    longest_comment: 68,
    comment: ("(", ")"),
    letters: Letters {
        capitals: true,
        instead: &[
            ('(', "["),
            (')', "]"),
            ('%', " PCT"),
            (';', ","),
            ('~', "-"),
            ('^', "-"),
            ('`', "'"),
            ('{', "["),
            ('}', "]"),
            ('|', "/"),
            ('\\', "/"),
            ('_', "-"),
        ],
    },
    brackets: ("[", "]"),
    numbered: false,
    most_labels: 9999,
};

pub(super) fn codes(sheet: &Sheet<'_>) -> Codes {
    match sheet.turning {
        true => Codes {
            per_minute: "G98",
            per_revolution: "G99",
        },
        false => Codes {
            per_minute: "G94",
            per_revolution: "G95",
        },
    }
}

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
        PAPER
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                if !(1..=9999).contains(&head.number) {
                    return Err(Refusal::new(
                        "program-number",
                        format!("O{} is no program number of four digits", head.number),
                        "give --number 1 to 9999",
                    ));
                }
                sheet.line("%");
                let name = head.name.strip_prefix(&format!("O{:04}", head.number)).unwrap_or(&head.name);
                let name = sheet.short(name, 24);
                let name = if name.is_empty() { name } else { format!("({name})") };
                sheet.line(&format!("O{:04}{name}", head.number));
                head.text.iter().for_each(|line| sheet.comment(line));
                if head.logs {
                    sheet.line("POPEN");
                    sheet.verify("POPEN, DPRNT and PCLOS: where lines go is set by parameters");
                }
                sheet.line(if sheet.turning {
                    "G18 G21 G40 G97"
                } else {
                    "G17 G21 G40 G49 G80 G90 G94"
                });
                sheet.modal.plane = Some(if sheet.turning { "G18" } else { "G17" });
                sheet.modal.feed_mode = (!sheet.turning).then_some("G94");
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
                    return Err(Refusal::new(
                        "work-offset",
                        format!("work offset {name} is beyond G54.1 P48"),
                        "use fewer set-ups in one program",
                    ));
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
                let codes = codes(sheet);
                let turns = iso::speed(*speed, sheet)?;
                let feed = sheet.number(*pitch, PAPER.feeds[1])?;
                let (down, up) = (LENGTHS.spell(*bottom), LENGTHS.spell(*back));
                let code = if *left { "G74" } else { "G84" };
                if *left && sheet.turning {
                    return Err(Refusal::new(
                        "thread",
                        "a left-hand tap on a lathe",
                        "tap it with the machine's own cycle",
                    ));
                }
                sheet.line(&format!("M29 S{turns}"));
                let level = if sheet.turning { "" } else { "G99 " };
                sheet.line(&format!("{} {level}{code} Z{down} R{up} F{feed}", codes.per_revolution));
                sheet.line("G80");
                sheet.verify("M29 for rigid tapping");
                sheet.modal.forget();
                Ok(())
            }
            other => write_shared(other, self, sheet),
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
    fn assignment(&self, variable: &str, value: &str) -> String {
        format!("{variable}={value}")
    }
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
        macro_b::value(expression, self, sheet)
    }

    fn reading(&self, stream: &str, turning: bool) -> Reading {
        if let Some(timer) = macro_b::timer(stream) {
            return Reading::Value(timer);
        }
        if let Some(position) = macro_b::position(stream, turning) {
            return Reading::Value(Source {
                verified: true,
                ..position
            });
        }
        let kind = stream.split_once('.').map_or(stream, |(_, kind)| kind);
        match kind {
            "trace:tool" => Reading::Value(Source {
                verified: true,
                ..Source::of("#4120")
            }),
            _ if kind.starts_with("POSITION") => {
                Reading::Outside("the encoders' position needs the servo lag: a recorder over FOCAS (cnc_rdaxisdata)")
            }
            "DISPLACEMENT" if stream.starts_with("TOOL.") => {
                let registers = if turning {
                    "#[2000+#4120-FIX[#4120/100]*100]"
                } else {
                    "#[10000+#4111]"
                };
                Reading::Value(Source::of(registers))
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
                Reading::Outside("a sensor of its own beside the control")
            }
            _ => Reading::Nothing("no source for it is known on this control"),
        }
    }

    fn start_timer(&self, timer: usize) -> Vec<String> {
        macro_b::start_timer(timer)
    }
    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        macro_b::dprnt(items, sheet)
    }
    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        let number = match tool {
            Some(number) => Source {
                verified: true,
                ..Source::of(format!("{number}"))
            },
            None => Source {
                verified: true,
                ..Source::of("#4120")
            },
        };
        let index = tool.map_or("#4120".to_owned(), |number| number.to_string());
        Some(vec![
            ("NUMBER", Reading::Value(number)),
            ("LENGTH", Reading::Value(Source::of(format!("#[11000+{index}]")))),
            ("WEAR", Reading::Value(Source::of(format!("#[10000+{index}]")))),
        ])
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }
    fn polls(&self) -> bool {
        false
    }
    fn checks(&self) -> bool {
        true
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        if let Call::SetEditAccessLevel { .. } = function.call {
            return Ok(Some(Verdict::external(
                "edit protection is the control's (O8000 and O9000 lock bits, 8-level protection), not the program's",
            )));
        }
        macro_b::function(function, false, self, sheet)
    }
}

/// What Fanuc and Haas write alike.
pub(super) fn write_shared(statement: &Statement<'_>, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let codes = codes(sheet);
    match statement {
        Statement::Comment(text) => sheet.comment(text),
        Statement::Section(name) => {
            sheet.comment(name);
        }
        Statement::Line(line) => iso::line(line, codes, sheet)?,
        Statement::Arc(arc) => iso::arc(arc, codes, sheet)?,
        Statement::Thread { line, lead, start, .. } => {
            let mut words = vec!["G32".to_owned()];
            words.extend(iso::axis_words(line.words, sheet));
            let decimals = Decimals { places: 6, ..LENGTHS };
            words.push(format!("F{}", sheet.number(*lead, decimals)?));
            if let Some(angle) = start.filter(|angle| *angle != 0.0) {
                words.push(format!("Q{}", (angle.rem_euclid(360.0) * 1000.0).round()));
            }
            sheet.words(&words);
            sheet.modal.motion = None;
            sheet.modal.feed = None;
        }
        Statement::Machine(to) => {
            let mut words = vec![if sheet.turning { "G53" } else { "G90 G53 G0" }.to_owned()];
            for (letter, to) in ["X", "Y", "Z"].iter().zip(to) {
                if let Some(to) = to {
                    words.push(format!("{letter}{}", sheet.length(*to)?));
                }
            }
            if sheet.turning {
                words.insert(0, "G0".to_owned());
            }
            sheet.words(&words);
            sheet.modal.motion = None;
        }
        Statement::Retract => {
            sheet.line(if sheet.turning { "G28 U0. W0." } else { "G91 G28 Z0." });
            if !sheet.turning {
                sheet.line("G90");
            }
            sheet.modal.motion = None;
        }
        Statement::Tool { number, name } => {
            sheet.modal.tool = Some(*number);
            sheet.modal.length = None;
            if sheet.turning {
                // The station comes with its offset; without one it is turned in alone.
                sheet.notes.insert("station".to_owned(), vec![*number]);
                if *number > 99 {
                    return Err(Refusal::new(
                        "tool-number",
                        format!("T{number} on a lathe"),
                        "use stations 1 to 99",
                    ));
                }
                sheet.line(&format!("T{number:02}00"));
            } else {
                let _ = name;
                sheet.line(&format!("T{number} M6"));
            }
        }
        Statement::Offset { number, negative } => {
            if sheet.turning {
                let station = sheet.notes.get("station").and_then(|s| s.first()).copied().unwrap_or(0);
                if *number > 99 {
                    return Err(Refusal::new(
                        "offset-number",
                        format!("offset {number} on a lathe"),
                        "use offsets 1 to 99",
                    ));
                }
                sheet.line(&format!("T{station:02}{number:02}"));
            } else if *number == 0 {
                if sheet.modal.length_on || sheet.modal.length.is_some() {
                    sheet.modal.length = Some("G49".to_owned());
                }
                sheet.modal.length_on = false;
            } else {
                let code = if *negative { "G44" } else { "G43" };
                sheet.modal.length = Some(format!("{code} H{number}"));
                sheet.modal.length_on = true;
            }
        }
        Statement::Spindle(state) => {
            let (word, mode) = iso::spindle(*state, "M19", sheet)?;
            match mode {
                None => sheet.line(&word),
                Some(SpindleMode::Revolutions(speed)) => {
                    let g97 = if sheet.turning { "G97 " } else { "" };
                    let speed = iso::speed(speed.0, sheet)?;
                    sheet.line(&format!("{g97}S{speed} {word}"));
                }
                Some(SpindleMode::Surface { speed, limit }) if sheet.turning => {
                    let limit = iso::speed(limit.0, sheet)?;
                    let metres = iso::speed(speed.0 * 0.06, sheet)?;
                    sheet.line(&format!("G50 S{limit}"));
                    sheet.line(&format!("G96 S{metres} {word}"));
                }
                Some(SpindleMode::Surface { .. }) => {
                    return Err(Refusal::new("surface-speed", "a surface speed on a mill", "give revolutions"));
                }
            }
        }
        Statement::Coolant { before, now } => iso::coolant(*before, *now, "M88", sheet),
        Statement::Message(text) => {
            sheet.notice("messages that do not wait are comments: #3006 would stop the machine");
            let text = format!("MSG {text}");
            sheet.comment(&text);
        }
        Statement::Stop(StopKind::Program) => sheet.line("M0"),
        Statement::Stop(StopKind::Optional) => sheet.line("M1"),
        Statement::Register(change) => macro_b::register(change, sheet)?,
        Statement::Assign { variable, value } => {
            let number = sheet.variable(variable);
            let (text, verified) = control.expression(value, sheet)?;
            macro_b::note_unverified(verified, sheet);
            sheet.line(&format!("{}={text}", macro_b::variable(number)?));
        }
        other => {
            macro_b::flow(other, &MacroJumps, control, sheet)?;
        }
    }
    Ok(())
}

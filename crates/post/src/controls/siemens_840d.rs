//! Siemens SINUMERIK 840D, 840D sl, ONE, 828D: synchronized actions in the servo cycle, recordings through FIFO variables, SETAL.
//!
//! G58 and G59 are programmable shifts here: behind G57 work offsets go on as G505.

mod actions;

use crate::alike::{self, Turn};
use crate::condition::{Style, source_of, spell};
use crate::control::Control;
use crate::functions::{Item, NO_SOURCE, OWN_SENSOR, Reading, Source, streams_of};
use crate::grade::Verdict;
use crate::iso;
use crate::letters::Letters;
use crate::number::Decimals;
use crate::sheet::{Paper, Refusal, Sheet, Way};
use crate::statement::Statement;
use actions::{start_action, start_recording, stop_action, stop_recording};
use plan::expression::Operator;
use plan::{Expression, PathMode, Register, StopKind};
use trace::functions::{Frequency, Recording, SynchronizedAction};
use trace::sensor::{Sensor, Statistic, streams};
use trace::{Call, Function, Sampling};

/// The control.
pub struct Siemens840d;

const NUMBERS: Decimals = Decimals::plain(6);

const OPERATORS: &[(Operator, &str)] = &[
    (Operator::Add, "+"),
    (Operator::Subtract, "-"),
    (Operator::Multiply, "*"),
    (Operator::Divide, "/"),
    (Operator::Equal, "=="),
    (Operator::NotEqual, "<>"),
    (Operator::Less, "<"),
    (Operator::LessOrEqual, "<="),
    (Operator::Greater, ">"),
    (Operator::GreaterOrEqual, ">="),
    (Operator::And, " AND "),
    (Operator::Or, " OR "),
    (Operator::Xor, " XOR "),
];

const STYLE: Style = Style {
    operators: OPERATORS,
    brackets: ("(", ")"),
    not: Some("NOT "),
    truth: Some(("TRUE", "FALSE")),
    numbers: NUMBERS,
    realtime: false,
};

const IN_ACTION: Style = Style { realtime: true, ..STYLE };

const BESIDE: &str = "a recorder over the SINUMERIK's OPC UA server or Edge";

impl Control for Siemens840d {
    fn name(&self) -> &'static str {
        "siemens-840d"
    }
    fn about(&self) -> &'static str {
        "Siemens SINUMERIK 840D, 840D sl, ONE"
    }
    fn ending(&self) -> &'static str {
        "mpf"
    }
    fn paper(&self) -> Paper {
        Paper {
            lengths: Decimals::plain(4),
            feeds: [Decimals::plain(3), Decimals::plain(5)],
            speeds: Decimals::plain(3),
            largest: 999_999.0,
            line_end: "\n",
            longest: 512,
            longest_comment: 120,
            comment: ("; ", ""),
            letters: Letters {
                capitals: false,
                instead: &[('"', "'"), ('%', " percent")],
            },
            brackets: ("(", ")"),
            numbered: false,
            most_labels: 99_999,
        }
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                sheet.line(&format!("%_N_{}_MPF", file_name(&head.name)));
                sheet.line(";$PATH=/_N_MPF_DIR");
                sheet.comment(&head.name);
                head.text.iter().for_each(|line| sheet.comment(line));
                if head.logs {
                    sheet.line("DEF INT TM_ERROR");
                    sheet.verify("the log is the file TM_LOG in the part programs; its size is bounded by MD11420");
                }
                alike::rely_on("G18 G40 G71 G90 G97 DIAMON", "G17 G40 G71 G90 G94", sheet);
                if !sheet.turning {
                    sheet.modal.length = Some("D0".to_owned());
                }
                Ok(())
            }
            Statement::End => {
                sheet.line("M30");
                Ok(())
            }
            Statement::Comment(text) | Statement::Section(text) => {
                sheet.comment(text);
                Ok(())
            }
            Statement::Line(line) => iso::line(line, iso::CODES, sheet),
            Statement::Arc(arc) => iso::arc(arc, iso::CODES, sheet),
            Statement::Thread {
                line, lead, axis, start, ..
            } => {
                let mut words = vec!["G33".to_owned()];
                words.extend(sheet.modal.length.take());
                words.extend(iso::axis_words(line.words, sheet));
                words.push(format!("{}{}", ["I", "J", "K"][*axis], sheet.number(*lead, NUMBERS)?));
                if let Some(angle) = start.filter(|angle| *angle != 0.0) {
                    words.push(format!("SF={}", sheet.number(angle.rem_euclid(360.0), NUMBERS)?));
                }
                sheet.words(&words);
                sheet.modal.motion = None;
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
                let lengths = sheet.paper().lengths;
                let turns = iso::speed(*speed, sheet)?;
                let pitch = sheet.number(if *left { -*pitch } else { *pitch }, NUMBERS)?;
                if let Some(length) = sheet.modal.length.take() {
                    sheet.line(&length);
                }
                sheet.line("SPOS=0");
                sheet.line(&format!("G331 Z{} K{pitch} S{turns}", lengths.spell(*bottom)));
                sheet.line(&format!("G332 Z{} K{pitch} S{turns}", lengths.spell(*back)));
                sheet.line(&format!("S{turns} {}", if *left { "M4" } else { "M3" }));
                sheet.verify("tapping by SPOS, G331 and G332");
                sheet.modal.forget();
                Ok(())
            }
            Statement::Machine(to) => {
                let mut words = alike::machine_words("G0 SUPA", to, sheet)?;
                words.push("D0".to_owned());
                out_of_the_way(&words.join(" "), sheet);
                Ok(())
            }
            Statement::Retract => {
                let words = if sheet.turning { "G0 SUPA X0 D0" } else { "G0 SUPA Z0 D0" };
                sheet.verify("out of the way is machine zero of the tool's axis");
                out_of_the_way(words, sheet);
                Ok(())
            }
            Statement::Tool { number, .. } => {
                sheet.modal.tool = Some(*number);
                sheet.modal.motion = None;
                sheet.modal.length_on = false;
                sheet.line(&format!("T{number}"));
                if !sheet.turning {
                    sheet.line("M6");
                }
                // D1 comes into force with the tool (MD20270): where the program does not ask for it, it is taken out again.
                sheet.modal.length = Some("D0".to_owned());
                Ok(())
            }
            Statement::Offset { number: 0, .. } => {
                sheet.modal.length_on = false;
                sheet.modal.length = None;
                sheet.line("D0");
                Ok(())
            }
            Statement::Offset { number, negative } => {
                alike::own_offset(*number, *negative, "D numbers", sheet)?;
                sheet.modal.length_on = true;
                sheet.modal.length = None;
                sheet.line("D1");
                Ok(())
            }
            Statement::Spindle(state) => {
                match alike::turn(*state, "SPOS=0", sheet)? {
                    Turn::Word(word) => sheet.line(&word),
                    Turn::Revolutions { speed, word } => {
                        let g97 = if sheet.turning { "G97 " } else { "" };
                        sheet.line(&format!("{g97}S{speed} {word}"));
                    }
                    Turn::Surface { metres, limit, word } => {
                        sheet.line(&format!("LIMS={limit}"));
                        sheet.line(&format!("G96 S{metres} {word}"));
                    }
                }
                if sheet.turning {
                    // G96 and G97 are of one group with G94 and G95.
                    sheet.modal.feed_mode = None;
                }
                Ok(())
            }
            Statement::Coolant { before, now } => {
                iso::coolant(*before, *now, "M88", sheet);
                Ok(())
            }
            Statement::Work(number) => {
                if *number > 98 {
                    return Err(alike::no_work_offset("more work offsets than G599"));
                }
                let name = self.work_name(*number);
                sheet.line(&name);
                Ok(())
            }
            Statement::PathMode(mode) => {
                match mode {
                    PathMode::ExactStop => sheet.line("G60"),
                    PathMode::ExactPath => {
                        sheet.notice("a path that may not be left is run with exact stop (G60)");
                        sheet.line("G60");
                    }
                    PathMode::Tolerance(Some(tolerance)) => {
                        let tolerance = sheet.length(tolerance.0)?;
                        sheet.line(&format!("CYCLE832({tolerance},_FINISH,1)"));
                        sheet.verify("CYCLE832 for the tolerance of paths");
                        sheet.modal.tolerance_on = true;
                    }
                    PathMode::Tolerance(None) => {
                        if sheet.modal.tolerance_on {
                            sheet.line("CYCLE832(0,_OFF,1)");
                            sheet.modal.tolerance_on = false;
                        }
                        sheet.line("G64");
                    }
                }
                Ok(())
            }
            Statement::Dwell(time) => {
                let time = sheet.number(*time, NUMBERS)?;
                sheet.line(&format!("G4 F{time}"));
                Ok(())
            }
            Statement::Message(text) => {
                let text = sheet.short(text, 120);
                sheet.line(&format!("MSG(\"{text}\")"));
                Ok(())
            }
            Statement::Stop(StopKind::Program) => {
                sheet.line("M0");
                Ok(())
            }
            Statement::Stop(StopKind::Optional) => {
                sheet.line("M1");
                Ok(())
            }
            Statement::Register(change) => register(change, sheet),
            Statement::If(condition) => self.condition("IF", condition, sheet),
            Statement::Else => {
                sheet.line("ELSE");
                Ok(())
            }
            Statement::EndIf => {
                sheet.line("ENDIF");
                Ok(())
            }
            Statement::While(condition) => {
                if names_of_the_machine(condition) {
                    return self.loop_with_stop(condition, sheet);
                }
                sheet.ways.push(Way::between(0, 0));
                self.condition("WHILE", condition, sheet)
            }
            Statement::EndWhile => {
                match sheet.ways.pop() {
                    Some(way) if way.end > 0 => sheet.line("ENDLOOP"),
                    _ => sheet.line("ENDWHILE"),
                }
                if let Some(label) = sheet.notes.get_mut("loop ends").and_then(Vec::pop).filter(|label| *label > 0) {
                    sheet.line(&format!("TM_LABEL{label}:"));
                }
                Ok(())
            }
            Statement::Assign { variable, value } => {
                let (name, text) = alike::assigned(variable, value, self, sheet)?;
                if text.contains('$') {
                    sheet.line("STOPRE");
                }
                sheet.line(&format!("{name}={text}"));
                Ok(())
            }
        }
    }

    fn work_name(&self, number: u32) -> String {
        match number {
            1..=4 => format!("G{}", 53 + number),
            more => format!("G{}", 500 + more),
        }
    }
    fn variable(&self, number: u32) -> Result<String, Refusal> {
        Ok(format!("R{}", alike::among(number, 90, "use fewer")? + 1))
    }
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
        if let Expression::Truth(truth) = expression {
            return Ok((if *truth { "1" } else { "0" }.to_owned(), true));
        }
        spell(expression, &STYLE, self, sheet)
    }

    fn reading(&self, stream: &str, _turning: bool) -> Reading {
        let value = |text: String, verified: bool, realtime: bool, factor: f64| {
            Reading::Value(Source {
                verified,
                realtime,
                factor,
                ..Source::of(text)
            })
        };
        match stream {
            "trace:ws_time" => return value("$AC_TIMER[1]".into(), true, true, 1.0),
            "trace:op_time" => return value("$AC_TIMER[2]".into(), true, true, 1.0),
            "trace:prog_time" => return value("$AC_TIMER[3]".into(), true, true, 1.0),
            "trace:last_ws_time" => return value("R99".into(), true, false, 1.0),
            "trace:tool" => return value("$P_TOOLNO".into(), false, false, 1.0),
            "trace:feed_override" => return value("$AC_OVR".into(), false, true, 1.0),
            "trace:path_deviation" => return Reading::Outside("the distance of three axes together is the recorder's"),
            _ => {}
        }
        let (component, kind) = stream.split_once('.').unwrap_or((stream, ""));
        let axis = alike::AXES.contains(&component);
        let spindle = component.strip_prefix('S').and_then(|n| n.parse::<u32>().ok());
        let machine = axis || spindle.is_some();
        match kind {
            "POSITION.COMMANDED" if axis => value(format!("$AA_IM[{component}]"), true, true, 1.0),
            "POSITION.ACTUAL" if axis => value(format!("$VA_IM[{component}]"), true, true, 1.0),
            "POSITION.ACTUAL.2" if axis => value(format!("$VA_IM2[{component}]"), true, true, 1.0),
            "DISPLACEMENT" if axis => value(format!("($VA_IM[{component}]-$AA_IM[{component}])"), true, true, 1.0),
            "PATH_FEEDRATE.ACTUAL" => value("$AC_VACTW".into(), false, true, 1.0 / 60.0),
            "AXIS_FEEDRATE.ACTUAL" if axis => value(format!("$AA_VACTB[{component}]"), false, true, 1.0 / 60.0),
            "ROTARY_VELOCITY.ACTUAL" if spindle.is_some() => value(format!("$AA_S[{}]", spindle.unwrap_or(1)), false, true, 1.0),
            "LOAD" if machine => value(format!("$AA_LOAD[{component}]"), false, true, 1.0),
            "AMPERAGE" | "AMPERAGE_AC" | "AMPERAGE_DC" if machine => value(format!("$AA_CURR[{component}]"), true, true, 1.0),
            "WATTAGE" if machine => value(format!("$AA_POWER[{component}]"), true, true, 1.0),
            "TORQUE" if machine => value(format!("$AA_TORQUE[{component}]"), true, true, 1.0),
            // Which analog input a sensor is wired to is the machine's; no two of them are on one.
            "LINEAR_FORCE" => {
                let input = match component {
                    "Y" => 6,
                    "Z" => 7,
                    _ => 1,
                };
                value(format!("$A_INA[{input}]"), false, true, 1.0)
            }
            "PRESSURE" => value("$A_INA[2]".into(), false, true, 1.0),
            "FILL_LEVEL" => value("$A_INA[3]".into(), false, true, 1.0),
            "TEMPERATURE" if component == "COOLANT" => value("$A_INA[4]".into(), false, true, 1.0),
            "FLOW" => value("$A_INA[5]".into(), false, true, 1.0),
            "DISPLACEMENT" => value("$TC_DP12[$P_TOOLNO,1]".into(), false, false, 1.0),
            "ACCELERATION" if axis => Reading::Nothing("$AA_ACC is the limit and not the actual acceleration"),
            "ACCELERATION" | "SOUND_LEVEL" | "TEMPERATURE" => OWN_SENSOR,
            "CUTTING_SPEED" | "ANGULAR_ACCELERATION" => {
                Reading::Outside("it is derived from the spindle's speed beside the control")
            }
            _ => NO_SOURCE,
        }
    }

    fn before_reading(&self, text: &str) -> Option<&'static str> {
        text.contains('$').then_some("STOPRE")
    }

    fn start_timer(&self, timer: usize) -> Vec<String> {
        vec![format!("$AC_TIMER[{}]=0", timer + 1)]
    }

    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        let mut text = String::new();
        let mut values = false;
        for item in items {
            match item {
                Item::Text(words) => text += &format!("{} ", sheet.short(words, 150)),
                Item::Value(name, source) => {
                    values |= source.text.contains('$');
                    text += &format!("{name}=\"<<{}<<\" ", source.in_records(("(", ")")));
                }
            }
        }
        if values {
            sheet.line("STOPRE");
        }
        sheet.line(&format!("WRITE(TM_ERROR,\"TM_LOG\",\"{}\")", text.trim_end()));
        Ok(true)
    }

    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        let number = tool.map_or("$P_TOOLNO".to_owned(), |number| number.to_string());
        Some(vec![
            ("NUMBER", Reading::unsure(number.clone())),
            ("LENGTH", Reading::unsure(format!("$TC_DP3[{number},1]"))),
            ("WEAR", Reading::unsure(format!("$TC_DP12[{number},1]"))),
        ])
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }
    fn checks(&self) -> bool {
        false
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        Ok(match &function.call {
            Call::GetTime { label } => {
                let mut reason = "date and time of the control to the second, quality derived".to_owned();
                if let Some(name) = &function.variable {
                    let number = sheet.variable(name);
                    let variable = self.variable(number)?;
                    sheet.line("STOPRE");
                    sheet.line(&format!("{variable}=$AC_CYCLE_TIME*1000"));
                    reason += "; the variable holds milliseconds since the program began";
                }
                let label = sheet.short(label.as_deref().unwrap_or_default(), 100);
                sheet.line("STOPRE");
                sheet.line(&format!(
                    "WRITE(TM_ERROR,\"TM_LOG\",\"TIME {label} \"<<$A_YEAR<<\"-\"<<$A_MONTH<<\"-\"<<$A_DAY<<\" \"<<$A_HOUR<<\":\"<<$A_MINUTE<<\":\"<<$A_SECOND)"
                ));
                Some(Verdict::between_blocks(false, reason))
            }
            Call::SetAlarm(alarm) => {
                sheet.line(&format!("SETAL({})", 65_000 + u32::from(alarm.id)));
                Some(Verdict::native(
                    false,
                    format!(
                        "what it does ({}) is set by the class of the alarm's number",
                        alarm.reaction.word()
                    ),
                ))
            }
            Call::DisplayMessage { text } => {
                let text = sheet.short(text, 120);
                sheet.line(&format!("MSG(\"{text}\")"));
                Some(Verdict::native(false, "shown until the next message"))
            }
            Call::SetEditAccessLevel { .. } => Some(Verdict::external(
                "edit protection is an attribute of the file or $MM_USER_CLASS_WRITE_PROGRAM for all programs, not a part's",
            )),
            Call::StartSensorRecording(recording) => Some(start_recording(recording, self, sheet)?),
            Call::StopSensorRecording { id } => stop_recording(&id.0, sheet),
            Call::StartSynchronizedAction(action) => Some(start_action(action, self, sheet)?),
            Call::StopSynchronizedAction { id } => stop_action(&id.0, sheet),
            _ => None,
        })
    }
}

impl Siemens840d {
    fn condition(&self, word: &str, condition: &Expression, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        let (text, verified) = spell(condition, &STYLE, self, sheet)?;
        alike::note_unverified(verified, sheet);
        if text.contains('$') {
            sheet.line("STOPRE");
        }
        // A number that stands for a truth: 0 is false.
        let text = if matches!(condition, Expression::Name(_)) {
            format!("{text}<>0")
        } else {
            text
        };
        sheet.line(&format!("{word} {text}"));
        Ok(())
    }

    /// A loop whose condition is the machine's: each turn waits for the motion before it looks.
    fn loop_with_stop(&self, condition: &Expression, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        let label = sheet.label();
        sheet.ways.push(Way::between(0, label));
        sheet.notes.entry("loop ends".to_owned()).or_default().push(label);
        sheet.line("LOOP");
        let opposite = Expression::Not(Box::new(condition.clone()));
        let opposite = crate::condition::without_not(&opposite, true);
        let (text, verified) = spell(&opposite, &STYLE, self, sheet)?;
        alike::note_unverified(verified, sheet);
        sheet.line("STOPRE");
        sheet.line(&format!("IF {text} GOTOF TM_LABEL{label}"));
        Ok(())
    }
}

fn names_of_the_machine(condition: &Expression) -> bool {
    match condition {
        Expression::Name(name) => !matches!(trace::sensor::meaning(name), trace::sensor::Meaning::Unknown),
        Expression::Not(inner) | Expression::Negate(inner) => names_of_the_machine(inner),
        Expression::Binary(_, left, right) => names_of_the_machine(left) || names_of_the_machine(right),
        Expression::Number(..) | Expression::Truth(_) => false,
    }
}

/// A move without frames and without tool; the tool is in force again behind it.
fn out_of_the_way(words: &str, sheet: &mut Sheet<'_>) {
    sheet.line(words);
    sheet.modal.motion = None;
    if sheet.modal.length_on {
        sheet.line("D1");
    }
}

/// A program's name: two letters first, letters, digits and underscores, at most 24.
fn file_name(name: &str) -> String {
    let mut out = alike::file_letters(name);
    if !out.bytes().take(2).all(|b| b.is_ascii_alphabetic()) || out.len() < 2 {
        out = format!("TM_{out}");
        out.truncate(24);
    }
    out
}

fn register(change: &plan::RegisterChange, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let Some(after) = change.after else { return Ok(()) };
    let number = |value: f64| sheet.number(value, NUMBERS);
    let line = match &change.register {
        Register::WorkOffset { name, axis } => {
            let index = match crate::control::work_number(name) {
                Some(number) => number,
                None => {
                    return Err(Refusal::new(
                        "register",
                        format!("{name} is no work offset here"),
                        "enter it at the machine",
                    ));
                }
            };
            let value = number(after * alike::of_diameter(*axis, sheet))?;
            format!("$P_UIFR[{index},{},TR]={value}", ["X", "Y", "Z"][*axis])
        }
        Register::ToolGeometry { tool, axis } => {
            let parameter = match (sheet.turning, axis) {
                (false, 2) | (true, 0) => 3,
                (true, 2) => 4,
                _ => 5,
            };
            format!("$TC_DP{parameter}[{tool},1]={}", number(after)?)
        }
        Register::ToolWear { tool, axis } => {
            let parameter = match (sheet.turning, axis) {
                (false, 2) | (true, 0) => 12,
                (true, 2) => 13,
                _ => 14,
            };
            format!("$TC_DP{parameter}[{tool},1]={}", number(after)?)
        }
        Register::ToolRadius { tool } => format!("$TC_DP6[{tool},1]={}", number(after)?),
        Register::ToolRadiusWear { tool } => format!("$TC_DP15[{tool},1]={}", number(after)?),
        Register::TipDirection { tool } => format!("$TC_DP2[{tool},1]={}", after as i64),
        Register::Variable(number) => {
            alike::left_variable(&format!("#{number}"), &after.to_string(), sheet);
            return Ok(());
        }
    };
    sheet.verify("registers written by $P_UIFR and $TC_DP");
    sheet.line("STOPRE");
    sheet.line(&line);
    Ok(())
}

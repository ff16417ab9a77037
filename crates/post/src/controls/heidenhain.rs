//! Heidenhain TNC 640, TNC7 and iTNC 530 in Klartext: numbered blocks, signs on coordinates, circles by their centre, Q parameters.
//!
//! A tool's length is in force with its call and cannot be switched off; helices are said by their angle; branches are comparisons that
//! jump (FN 9 to FN 12).

use crate::alike::{self, Turn};
use crate::condition::{Comparison, Jumps, Style, spell};
use crate::control::Control;
use crate::functions::{Item, NO_SOURCE, OWN_SENSOR, Reading, Source};
use crate::grade::Verdict;
use crate::iso;
use crate::letters::Letters;
use crate::macro_b;
use crate::number::{Decimals, scale};
use crate::sheet::{Paper, Refusal, Sheet};
use crate::statement::{Arc, Line, Pace, Statement};
use plan::expression::Operator;
use plan::{Expression, PathMode, StopKind};
use trace::functions::Reaction;
use trace::{Call, Function};

/// The control.
pub struct Heidenhain;

/// Q parameters of the program: Q1200 and up are the user's. Timers, scratch and texts behind them.
const FIRST: u32 = 1200;
const TIMERS: u32 = 1400;
const LAST_TIME: u32 = 1403;
const READ: u32 = 1410;
const SCRATCH: u32 = 1490;
const TEXT: u32 = 1800;

const LENGTHS: Decimals = Decimals::signed(4);

const NUMBERS: Decimals = Decimals::signed(6);

static STYLE: Style = Style {
    operators: &[
        (Operator::Add, " + "),
        (Operator::Subtract, " - "),
        (Operator::Multiply, " * "),
        (Operator::Divide, " / "),
    ],
    brackets: ("(", ")"),
    not: None,
    truth: None,
    numbers: NUMBERS,
    realtime: false,
};

const BESIDE: &str = "a recorder over DNC, OPC UA or MTConnect";

struct QJumps;

impl Jumps for QJumps {
    fn style(&self) -> &Style {
        &STYLE
    }
    fn jump(&self, comparison: &Comparison, sheet: &mut Sheet<'_>) {
        let mut sides = Vec::new();
        for (place, side) in [&comparison.left, &comparison.right].into_iter().enumerate() {
            // FN 9 to 12 compare parameters and numbers only.
            if side.contains(['(', ' ']) {
                let scratch = SCRATCH + place as u32;
                sheet.line(&format!("Q{scratch} = {side}"));
                sides.push(format!("+Q{scratch}"));
            } else if side.starts_with('Q') {
                sides.push(format!("+{side}"));
            } else {
                sides.push(side.clone());
            }
        }
        let jumps: &[&str] = match comparison.operator {
            Operator::Equal => &["FN 9: IF", "EQU"],
            Operator::NotEqual => &["FN 10: IF", "NE"],
            Operator::Less => &["FN 12: IF", "LT"],
            Operator::Greater => &["FN 11: IF", "GT"],
            Operator::LessOrEqual => &["FN 12: IF", "LT", "FN 9: IF", "EQU"],
            _ => &["FN 11: IF", "GT", "FN 9: IF", "EQU"],
        };
        for jump in jumps.chunks(2) {
            sheet.line(&format!(
                "{} {} {} {} GOTO LBL {}",
                jump[0], sides[0], jump[1], sides[1], comparison.to
            ));
        }
    }
    fn go(&self, to: u32, sheet: &mut Sheet<'_>) {
        sheet.line(&format!("FN 9: IF +0 EQU +0 GOTO LBL {to}"));
    }
    fn place(&self, label: u32, sheet: &mut Sheet<'_>) {
        sheet.line(&format!("LBL {label}"));
    }
}

impl Control for Heidenhain {
    fn name(&self) -> &'static str {
        "heidenhain"
    }
    fn about(&self) -> &'static str {
        "Heidenhain TNC 640, TNC7, iTNC 530 (Klartext)"
    }
    fn ending(&self) -> &'static str {
        "h"
    }
    fn arc_planes(&self) -> &'static [usize] {
        // Circles beside the plane of the tool have other rules for DR on older series: they become chords.
        &[2]
    }
    fn paper(&self) -> Paper {
        Paper {
            lengths: LENGTHS,
            feeds: [Decimals::plain(3), Decimals::plain(4)],
            speeds: Decimals::plain(3),
            largest: 99_999.999_9,
            line_end: "\r\n",
            longest: 240,
            longest_comment: 100,
            comment: ("; ", ""),
            letters: Letters {
                capitals: false,
                // A tilde at the end of a line joins it with the next one.
                instead: &[('~', "-"), ('"', "'"), ('%', " percent")],
            },
            brackets: ("(", ")"),
            numbered: true,
            most_labels: 65_535,
        }
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                if sheet.turning {
                    return Err(Refusal::new(
                        "turning",
                        "programs that turn: Klartext has them on mill-turn machines only, in a mode of its own",
                        "post to a lathe's control",
                    ));
                }
                let name = program_name(&head.name);
                sheet.line(&format!("BEGIN PGM {name} MM"));
                sheet.texts.insert("name".to_owned(), vec![name]);
                sheet.comment(&head.name);
                head.text.iter().for_each(|line| sheet.comment(line));
                if head.logs {
                    sheet.verify(
                        "FN 16 prints lines of the log by the mask TNC:\\TOOLMARK.A, which holds: M_APPEND; \"%s\",QS1800;",
                    );
                }
            }
            Statement::End => {
                sheet.line("M30");
                let name = sheet.texts.get("name").and_then(|n| n.first()).cloned().unwrap_or_default();
                sheet.line(&format!("END PGM {name} MM"));
            }
            Statement::Comment(text) => sheet.comment(text),
            Statement::Section(name) => {
                let name = sheet.short(name, 80);
                sheet.line(&format!("* - {name}"));
            }
            Statement::Line(line) => straight(line, sheet)?,
            Statement::Arc(arc) => circle(arc, sheet)?,
            Statement::Thread { .. } => {
                return Err(Refusal::new(
                    "thread",
                    "a thread cut with the spindle's angle",
                    "use a thread milling cycle",
                ));
            }
            Statement::Tap {
                bottom,
                back,
                pitch,
                left,
                ..
            } => {
                let depth = LENGTHS.spell(*bottom - *back);
                let pitch = sheet.number(if *left { -*pitch } else { *pitch }, NUMBERS)?;
                let surface = LENGTHS.spell(*back);
                sheet.line(&format!(
                    "CYCL DEF 207 RIGID TAPPING NEW Q200=+0 Q201={depth} Q239={pitch} Q203={surface} Q204=+0"
                ));
                sheet.line("CYCL CALL");
                sheet.verify("CYCL DEF 207 for rigid tapping");
            }
            Statement::Machine(to) => {
                let mut words = alike::machine_words("L", to, sheet)?;
                words.push("R0 FMAX M91".to_owned());
                sheet.words(&words);
            }
            Statement::Retract => {
                sheet.line("L Z+0 R0 FMAX M91");
                sheet.verify("out of the way is machine zero of Z (M91)");
            }
            Statement::Tool { number, .. } => {
                sheet.modal.tool = Some(*number);
                sheet.modal.length_on = false;
                sheet.line(&format!("TOOL CALL {number} Z"));
            }
            Statement::Offset { number: 0, .. } => sheet.modal.length_on = false,
            Statement::Offset { number, negative } => {
                alike::own_offset(*number, *negative, "lengths", sheet)?;
                sheet.modal.length_on = true;
            }
            Statement::Spindle(state) => match alike::turn(*state, "M19", sheet)? {
                Turn::Word(word) => {
                    if word == "M19" {
                        sheet.verify("M19 for an oriented stop of the spindle");
                    }
                    sheet.line(&word);
                }
                Turn::Revolutions { speed, word } => {
                    sheet.line(&format!("TOOL CALL Z S{speed}"));
                    sheet.line(&word);
                }
                Turn::Surface { .. } => return Err(alike::no_surface_speed()),
            },
            Statement::Coolant { before, now } => {
                if now.mist {
                    sheet.verify("mist is M7");
                }
                iso::coolant(*before, *now, "M88", sheet);
            }
            Statement::Work(number) => {
                sheet.line(&format!("CYCL DEF 247 DATUM SETTING Q339=+{number}"));
                sheet.verify("rows of the preset table stand for work offsets (CYCL DEF 247)");
            }
            Statement::PathMode(mode) => {
                let tolerance = match mode {
                    PathMode::Tolerance(Some(tolerance)) => Some(tolerance.0),
                    PathMode::Tolerance(None) => None,
                    PathMode::ExactStop | PathMode::ExactPath => {
                        sheet.notice("exact stop and exact path have no words here: the tolerance is 0.001 mm");
                        Some(0.001)
                    }
                };
                if tolerance.is_some() || sheet.modal.tolerance_on {
                    sheet.line("CYCL DEF 32.0 TOLERANCE");
                    match tolerance {
                        Some(tolerance) => {
                            let text = sheet.number(tolerance, Decimals::plain(6))?;
                            sheet.line(&format!("CYCL DEF 32.1 T{text}"));
                        }
                        None => sheet.line("CYCL DEF 32.1"),
                    }
                    sheet.verify("CYCL DEF 32 for the tolerance of paths");
                }
                sheet.modal.tolerance_on = tolerance.is_some();
            }
            Statement::Dwell(time) => {
                let time = sheet.number(*time, Decimals::plain(3))?;
                sheet.line("CYCL DEF 9.0 DWELL TIME");
                sheet.line(&format!("CYCL DEF 9.1 DWELL {time}"));
            }
            Statement::Message(text) => {
                sheet.notice("messages are comments: FN 16 to the screen needs a mask of its own");
                let text = format!("MESSAGE {text}");
                sheet.comment(&text);
            }
            Statement::Stop(StopKind::Program) => sheet.line("STOP"),
            Statement::Stop(StopKind::Optional) => sheet.line("M1"),
            Statement::Register(change) => {
                let (name, after) = (change.register.name(), change.after);
                if !matches!(change.register, plan::Register::Variable(_)) {
                    return Err(Refusal::new(
                        "register",
                        format!("the program writes {name}: tables are written by the operator here"),
                        "take the G10 out of the program and enter the value at the machine",
                    ));
                }
                let value = after.map_or("vacant".to_owned(), |v| v.to_string());
                alike::left_variable(&name, &value, sheet);
            }
            Statement::Assign { variable, value } => {
                let (name, text) = alike::assigned(variable, value, self, sheet)?;
                sheet.line(&format!("{name} = {text}"));
            }
            other => {
                macro_b::flow(other, &QJumps, self, sheet)?;
            }
        }
        Ok(())
    }

    fn work_name(&self, number: u32) -> String {
        format!("DATUM {number}")
    }
    fn variable(&self, number: u32) -> Result<String, Refusal> {
        Ok(format!("Q{}", FIRST + alike::among(number, TIMERS - FIRST, "use fewer")?))
    }
    fn assignment(&self, variable: &str, value: &str) -> String {
        format!("{variable} = {value}")
    }
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
        if let Expression::Truth(truth) = expression {
            return Ok((if *truth { "+1" } else { "+0" }.to_owned(), true));
        }
        spell(expression, &STYLE, self, sheet)
    }

    fn reading(&self, stream: &str, _turning: bool) -> Reading {
        let read = |place: u32, what: &str| {
            Reading::Value(Source {
                before: vec![format!("FN 18: SYSREAD Q{place} = {what}")],
                ..Source::of(format!("Q{place}")).verified()
            })
        };
        let since = |timer: u32| {
            let place = READ + timer;
            Reading::Value(Source {
                before: vec![
                    format!("FN 18: SYSREAD Q{place} = ID320 NR1"),
                    format!("Q{place} = Q{place} - Q{}", TIMERS + timer),
                ],
                ..Source::of(format!("Q{place}")).verified()
            })
        };
        match stream {
            "trace:ws_time" => return since(0),
            "trace:op_time" => return since(1),
            "trace:prog_time" => return since(2),
            "trace:last_ws_time" => {
                return Reading::known(format!("Q{LAST_TIME}"));
            }
            "trace:tool" => return read(READ + 3, "ID20 NR1"),
            _ => {}
        }
        let (component, kind) = stream.split_once('.').unwrap_or((stream, ""));
        let axis = alike::AXES.iter().position(|axis| *axis == component);
        match (kind, axis) {
            ("POSITION.COMMANDED", Some(axis)) => read(READ + 4 + axis as u32, &format!("ID240 NR1 IDX{}", axis + 1)),
            ("POSITION.ACTUAL", Some(_)) => Reading::Outside("encoders' positions: DNC or OPC UA only"),
            ("PATH_FEEDRATE.ACTUAL", _) => Reading::Nothing("FN 18 tells the programmed feed and not the actual one"),
            ("ROTARY_VELOCITY.ACTUAL", _) => Reading::Nothing("FN 18 tells the programmed spindle speed and not the actual one"),
            ("LOAD", _) => Reading::Outside("loads are the PLC's and DNC's, no FN 18 is known for them"),
            ("AMPERAGE" | "AMPERAGE_AC" | "AMPERAGE_DC", None) => {
                Reading::Outside("process monitoring (option 168) looks at the spindle's current by itself")
            }
            ("LINEAR_FORCE" | "PRESSURE" | "FILL_LEVEL" | "FLOW", _) => Reading::Outside("inputs of the PLC"),
            ("TEMPERATURE", _) if component == "COOLANT" => Reading::Outside("inputs of the PLC"),
            ("DISPLACEMENT", None) => Reading::Outside("the tool table is read by FN 18 ID50, of which no form is at hand"),
            ("ACCELERATION" | "SOUND_LEVEL" | "TEMPERATURE", None) => OWN_SENSOR,
            _ => NO_SOURCE,
        }
    }

    fn start_timer(&self, timer: usize) -> Vec<String> {
        vec![format!("FN 18: SYSREAD Q{} = ID320 NR1", TIMERS + timer as u32)]
    }

    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        let mut first = true;
        let mut add = |text: String, sheet: &mut Sheet<'_>| {
            // One statement for each part: a line of the control is short.
            let before = if first { String::new() } else { format!("QS{TEXT} || ") };
            first = false;
            sheet.line(&format!("QS{TEXT} = {before}{text}"));
        };
        for item in items {
            match item {
                Item::Text(words) => add(format!("\"{} \"", sheet.short(words, 120)), sheet),
                Item::Value(name, source) => {
                    source.before.iter().for_each(|line| sheet.line(line));
                    let value = if source.factor == 1.0 {
                        source.text.clone()
                    } else {
                        sheet.line(&format!("Q{SCRATCH} = {}", source.in_records(("(", ")"))));
                        format!("Q{SCRATCH}")
                    };
                    add(format!("\"{name}=\""), sheet);
                    add(format!("TOCHAR( DAT+{value} DECIMALS3 )"), sheet);
                }
            }
        }
        sheet.line("FN 16: F-PRINT TNC:\\TOOLMARK.A / TNC:\\TOOLMARK.TXT");
        Ok(false)
    }

    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        match tool {
            None => Some(vec![("NUMBER", self.reading("trace:tool", false))]),
            Some(_) => None,
        }
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        Ok(match &function.call {
            Call::GetTime { label } => {
                let place = READ + 15;
                sheet.line(&format!("FN 18: SYSREAD Q{place} = ID320 NR1"));
                if let Some(name) = &function.variable {
                    let number = sheet.variable(name);
                    sheet.line(&format!("{} = Q{place} * +1000", self.variable(number)?));
                }
                let source = Source::of(format!("Q{place}")).verified();
                let label = label.clone().unwrap_or_default();
                let items = [Item::Text(format!("TIME {label}")), Item::Value("SECONDS".to_owned(), source)];
                self.log(&items, sheet)?;
                Some(Verdict::between_blocks(false, "seconds since 1970, without milliseconds"))
            }
            Call::SetAlarm(alarm) if alarm.reaction == Reaction::StopNow => {
                if alarm.id > 299 {
                    return Ok(Some(Verdict::refused(
                        "numbers of FN 14 above 299 are the machine builder's and the control's own",
                    )));
                }
                let text = format!("ALARM {} {}", alarm.id, alarm.text);
                sheet.comment(&text);
                sheet.line(&format!("FN 14: ERROR = {}", alarm.id));
                Some(Verdict::native(
                    true,
                    "the program stops with the number; its text is the control's own",
                ))
            }
            Call::SetAlarm(alarm) => {
                let log = self.log(&[Item::Text(format!("ALARM {} {}", alarm.id, alarm.text))], sheet)?;
                if alarm.reaction == Reaction::None {
                    return Ok(Some(Verdict::between_blocks(
                        log,
                        "FN 14 would stop the program and no reaction is asked for: a line of the log",
                    )));
                }
                sheet.line("STOP");
                Some(Verdict::between_blocks(
                    log,
                    format!(
                        "a line of the log, then the program waits for NC start at this block{}",
                        alike::not_at_the_end(alarm.reaction)
                    ),
                ))
            }
            Call::DisplayMessage { .. } => Some(Verdict::refused(
                "FN 16 to the screen needs a mask for each text; it stands as a comment",
            )),
            Call::StartSensorRecording(recording) => {
                let current = recording.sensors.iter().all(|sensor| {
                    trace::sensor::streams(sensor, &recording.axes)
                        .is_ok_and(|all| all.iter().all(|s| s.component == "S1" && s.quantity.starts_with("AMPERAGE")))
                });
                if !current {
                    return Ok(Some(Verdict::external(
                        "process monitoring records the spindle's current only: a recorder over DNC, OPC UA or MTConnect",
                    )));
                }
                let id = recording.id.0.to_ascii_lowercase();
                sheet.notes.insert(format!("recording {id}"), vec![]);
                sheet.line("SECTION MONITORING START");
                Some(Verdict::native(
                    false,
                    "process monitoring (option 168) records the spindle's current as its tasks say, not by the sampling asked for",
                ))
            }
            Call::StopSensorRecording { id } => {
                let id = id.0.to_ascii_lowercase();
                if sheet.notes.remove(&format!("recording {id}")).is_none() {
                    return Ok(None);
                }
                sheet.line("SECTION MONITORING STOP");
                Some(Verdict::native(false, "process monitoring (option 168)"))
            }
            Call::GetOperatorData | Call::LogOperatorData { .. } => Some(Verdict::external(
                "the user is HEROS's, not the program's: a recorder over DNC, OPC UA or MTConnect",
            )),
            Call::SetEditAccessLevel { .. } => Some(Verdict::external(
                "who may edit programs is a right of the user (NC.EditNCProgram), not of a part of the program",
            )),
            _ => None,
        })
    }
}

/// A program's name: letters, digits, underscores and minus, at most 24.
fn program_name(name: &str) -> String {
    let out = alike::file_letters(name);
    let out = out.trim_matches('_');
    if out.is_empty() {
        "TOOLMARK".to_owned()
    } else {
        out.to_owned()
    }
}

fn coordinates(words: [Option<i64>; 3]) -> Vec<String> {
    let spelled = ["X", "Y", "Z"].iter().zip(words);
    spelled
        .filter_map(|(letter, units)| Some(format!("{letter}{}", LENGTHS.spell(units?))))
        .collect()
}

/// `FMAX`, `F600`, `FU0.2`.
fn feed(pace: Pace, sheet: &mut Sheet<'_>) -> Result<Option<String>, Refusal> {
    let word = match iso::feed_number(pace, sheet)? {
        None => return Ok(Some("FMAX".to_owned())), // for its block only
        Some(number) if matches!(pace, Pace::PerRevolution(_)) => format!("FU{number}"),
        Some(number) => format!("F{number}"),
    };
    if sheet.modal.feed.as_ref() == Some(&word) {
        return Ok(None);
    }
    sheet.modal.feed = Some(word.clone());
    Ok(Some(word))
}

fn straight(line: &Line, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    if line.words[2].is_some() && !sheet.modal.length_on && sheet.modal.tool.is_some_and(|tool| tool != 0) {
        return Err(Refusal::new(
            "tool-length",
            "the tool moves along its axis without its length: a length cannot be switched off on this control",
            "put the length in force (G43 H) before the tool moves along Z",
        ));
    }
    let mut words = vec!["L".to_owned()];
    words.extend(coordinates(line.words));
    words.push("R0".to_owned());
    words.extend(feed(line.pace, sheet)?);
    sheet.words(&words);
    Ok(())
}

fn circle(arc: &Arc, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let centre = |k: usize| {
        let from = arc.from[k] as f64 / scale(LENGTHS.places);
        sheet.length(from + arc.to_centre[k])
    };
    let (x, y) = (centre(0)?, centre(1)?);
    sheet.line(&format!("CC X{x} Y{y}"));
    let direction = if arc.counterclockwise { "DR+" } else { "DR-" };
    let feed = feed(arc.pace, sheet)?.unwrap_or_default();
    if !arc.rises {
        let words = coordinates([Some(arc.to[0]), Some(arc.to[1]), None]).join(" ");
        sheet.words(&[format!("C {words} {direction} R0"), feed]);
        return Ok(());
    }
    let sign = if arc.counterclockwise { 1.0 } else { -1.0 };
    let angle = sheet.number(arc.sweep * sign, NUMBERS)?;
    let rise = LENGTHS.spell(arc.to[2] - arc.from[2]);
    sheet.words(&[format!("CP IPA{angle} IZ{rise} {direction} R0"), feed]);
    Ok(())
}

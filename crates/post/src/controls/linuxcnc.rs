//! LinuxCNC 2.8 and later, the language of `rs274`: structure by o-words, lines of a log by `(LOG,...)`, coordinates with six decimals.

use crate::alike::{self, Turn};
use crate::condition::{Style, spell, without_not};
use crate::control::Control;
use crate::functions::{Item, NO_SOURCE, Reading, Source};
use crate::grade::Verdict;
use crate::iso;
use crate::letters::Letters;
use crate::number::Decimals;
use crate::sheet::{Paper, Refusal, Sheet, Way};
use crate::statement::Statement;
use plan::expression::Operator;
use plan::{CoolantState, Expression, PathMode, Register, StopKind};
use trace::functions::Reaction;
use trace::{Call, Function};

/// The control.
pub struct LinuxCnc;

const NUMBERS: Decimals = Decimals::plain(6);

static STYLE: Style = Style {
    operators: &[
        (Operator::Add, " + "),
        (Operator::Subtract, " - "),
        (Operator::Multiply, " * "),
        (Operator::Divide, " / "),
        (Operator::Equal, " EQ "),
        (Operator::NotEqual, " NE "),
        (Operator::Less, " LT "),
        (Operator::LessOrEqual, " LE "),
        (Operator::Greater, " GT "),
        (Operator::GreaterOrEqual, " GE "),
        (Operator::And, " AND "),
        (Operator::Or, " OR "),
        (Operator::Xor, " XOR "),
    ],
    brackets: ("[", "]"),
    not: None,
    truth: Some(("1", "0")),
    numbers: NUMBERS,
    realtime: false,
};

const BESIDE: &str =
    "HAL beside the program: sampler for recordings (8 FIFOs of 21 pins), comp and and2 or classicladder for conditions";

impl Control for LinuxCnc {
    fn name(&self) -> &'static str {
        "linuxcnc"
    }
    fn about(&self) -> &'static str {
        "LinuxCNC 2.8 and later (rs274)"
    }
    fn ending(&self) -> &'static str {
        "ngc"
    }
    fn paper(&self) -> Paper {
        Paper {
            lengths: NUMBERS,
            feeds: [NUMBERS, NUMBERS],
            speeds: Decimals::plain(3),
            largest: 999_999.0,
            line_end: "\n",
            // LINELEN is 255 with the end of the line.
            longest: 250,
            longest_comment: 120,
            // Never an active comment, whatever the text begins with: `(ABORT,x)` is obeyed with blanks before it too.
            comment: ("(- ", ")"),
            letters: Letters {
                capitals: false,
                instead: &[('(', "["), (')', "]"), ('%', " percent"), (';', ","), ('#', "no.")],
            },
            brackets: ("[", "]"),
            numbered: false,
            most_labels: 99_999,
        }
    }

    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        match statement {
            Statement::Begin(head) => {
                sheet.comment(&head.name);
                head.text.iter().for_each(|line| sheet.comment(line));
                if head.logs {
                    sheet.line("(LOGOPEN,toolmark.log)");
                }
                sheet.notes.insert("logs".to_owned(), vec![u32::from(head.logs)]);
                let plane = if sheet.turning { "G18 G7" } else { "G17" };
                sheet.line(&format!("{plane} G21 G40 G49 G80 G90 G91.1 G94 G97"));
                sheet.modal.plane = Some(if sheet.turning { "G18" } else { "G17" });
                sheet.modal.feed_mode = Some("G94");
            }
            Statement::End => {
                if sheet.notes.get("logs") == Some(&vec![1]) {
                    sheet.line("(LOGCLOSE)");
                }
                sheet.line("M2");
            }
            Statement::Comment(text) | Statement::Section(text) => sheet.comment(text),
            Statement::Line(line) => iso::line(line, iso::CODES, sheet)?,
            Statement::Arc(arc) => iso::arc(arc, iso::CODES, sheet)?,
            Statement::Thread {
                line, advance, start, ..
            } => {
                if start.is_some_and(|angle| angle != 0.0) {
                    return Err(Refusal::new(
                        "thread-start",
                        "a thread that begins at an angle of the spindle: G33 begins at its mark",
                        "shift the start of the thread along the axis instead",
                    ));
                }
                let mut words = vec!["G33".to_owned()];
                words.extend(iso::axis_words(line.words, sheet));
                // K is the way along the path, whatever its direction.
                words.push(format!("K{}", sheet.number(*advance, NUMBERS)?));
                sheet.words(&words);
                sheet.modal.motion = None;
            }
            Statement::Tap { bottom, pitch, left, .. } => {
                let _ = left; // the spindle turns the right way round already
                let words = format!("G33.1 Z{} K{}", NUMBERS.spell(*bottom), sheet.number(*pitch, NUMBERS)?);
                sheet.line(&words);
                sheet.modal.forget();
            }
            Statement::Machine(to) => {
                let words = alike::machine_words("G53 G0", to, sheet)?;
                sheet.words(&words);
                sheet.modal.motion = None;
            }
            Statement::Retract => {
                sheet.line(if sheet.turning { "G53 G0 X0" } else { "G53 G0 Z0" });
                sheet.modal.motion = None;
            }
            Statement::Tool { number, .. } => {
                sheet.modal.tool = Some(*number);
                sheet.modal.motion = None;
                sheet.modal.length = None;
                sheet.line(&format!("T{number} M6"));
            }
            Statement::Offset { negative: true, .. } => {
                return Err(Refusal::new(
                    "tool-offset",
                    "a length that counts the other way (G44)",
                    "enter the length with its sign",
                ));
            }
            Statement::Offset { number: 0, .. } => sheet.line("G49"),
            Statement::Offset { number, .. } => sheet.line(&format!("G43 H{number}")),
            Statement::Spindle(state) => match alike::turn(*state, "M19 R0", sheet)? {
                Turn::Word(word) => sheet.line(&word),
                Turn::Revolutions { speed, word } => sheet.line(&format!("G97 S{speed} {word}")),
                Turn::Surface { metres, limit, word } => sheet.line(&format!("G96 D{limit} S{metres} {word}")),
            },
            Statement::Coolant { before, now } => {
                let mut now = *now;
                if now.through {
                    sheet.notice("coolant through the spindle has no M code here: flood is opened instead");
                    now = CoolantState {
                        flood: true,
                        through: false,
                        ..now
                    };
                }
                let before = before.map(|before| CoolantState {
                    flood: before.flood || before.through,
                    through: false,
                    ..before
                });
                if before != Some(now) {
                    iso::coolant(before, now, "M8", sheet);
                }
            }
            Statement::Work(number) => {
                if *number > 9 {
                    return Err(alike::no_work_offset("more work offsets than G59.3"));
                }
                let name = self.work_name(*number);
                sheet.line(&name);
            }
            Statement::PathMode(mode) => match mode {
                PathMode::ExactStop => sheet.line("G61.1"),
                PathMode::ExactPath => sheet.line("G61"),
                PathMode::Tolerance(None) => sheet.line("G64"),
                PathMode::Tolerance(Some(tolerance)) => {
                    let tolerance = sheet.length(tolerance.0)?;
                    sheet.line(&format!("G64 P{tolerance}"));
                }
            },
            Statement::Dwell(time) => {
                let time = sheet.number(*time, NUMBERS)?;
                sheet.line(&format!("G4 P{time}"));
            }
            Statement::Message(text) => {
                let text = sheet.short(text, 150);
                sheet.line(&format!("(MSG,{text})"));
            }
            Statement::Stop(StopKind::Program) => sheet.line("M0"),
            Statement::Stop(StopKind::Optional) => sheet.line("M1"),
            Statement::Register(change) => register(change, sheet)?,
            Statement::If(condition) => {
                let label = sheet.label();
                sheet.ways.push(Way::between(label, label));
                self.condition(label, "if", condition, sheet)?;
            }
            Statement::Else => {
                let label = sheet.ways.last().map_or(0, |way| way.other);
                sheet.line(&format!("o{label} else"));
            }
            Statement::EndIf => {
                let label = sheet.ways.pop().map_or(0, |way| way.other);
                sheet.line(&format!("o{label} endif"));
            }
            Statement::While(condition) => {
                let label = sheet.label();
                sheet.ways.push(Way::between(label, label));
                if condition_is_of_the_machine(condition, self, sheet) {
                    return Err(Refusal::new(
                        "condition",
                        "a loop as long as a value of the machine holds: it is read once, before the loop, on this control",
                        "let the loop assign the value to a variable and test that",
                    ));
                }
                self.condition(label, "while", condition, sheet)?;
            }
            Statement::EndWhile => {
                let label = sheet.ways.pop().map_or(0, |way| way.other);
                sheet.line(&format!("o{label} endwhile"));
            }
            Statement::Assign { variable, value } => {
                let (name, text) = alike::assigned(variable, value, self, sheet)?;
                sheet.line(&format!("{name} = [{text}]"));
            }
        }
        Ok(())
    }

    fn work_name(&self, number: u32) -> String {
        match number {
            1..=6 => format!("G{}", 53 + number),
            more => format!("G59.{}", more - 6),
        }
    }
    fn variable(&self, number: u32) -> Result<String, Refusal> {
        // Numbered ones can be set before the start and begin as 0; a name that nothing has set is an error.
        Ok(format!("#{}", alike::among(number, 1000, "use fewer")? + 1001))
    }
    fn assignment(&self, variable: &str, value: &str) -> String {
        format!("{variable} = {value}")
    }
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
        spell(&without_not(expression, true), &STYLE, self, sheet)
    }

    fn reading(&self, stream: &str, _turning: bool) -> Reading {
        // `M66` waits for the motion and reads the input then; the wiring is the machine's.
        let input = |number: u32| {
            Reading::Value(Source {
                before: vec![format!("M66 E{number} L0")],
                ..Source::of("#5399")
            })
        };
        let (component, kind) = stream.split_once('.').unwrap_or((stream, ""));
        let axis = alike::linear(component).is_some();
        match kind {
            "" if stream == "trace:tool" => Reading::known("#5400"),
            "" if stream == "trace:last_ws_time" || stream.ends_with("_time") => {
                Reading::Outside("a program has no clock here: the log is stamped by who reads it")
            }
            "POSITION.COMMANDED" if axis => Reading::known(format!("#<_abs_{}>", component.to_ascii_lowercase())),
            "POSITION.ACTUAL" if axis => Reading::Outside("joint.N.motor-pos-fb, a HAL pin"),
            "DISPLACEMENT" if axis => Reading::Outside("joint.N.f-error, a HAL pin"),
            "DISPLACEMENT" => Reading::unsure("#5403"),
            "LINEAR_FORCE" => input(0),
            "PRESSURE" => input(1),
            "FILL_LEVEL" => input(2),
            "TEMPERATURE" if component == "COOLANT" => input(3),
            "FLOW" => input(4),
            "PATH_FEEDRATE.ACTUAL" => Reading::Outside("motion.current-vel, a HAL pin"),
            "AXIS_FEEDRATE.ACTUAL" => Reading::Outside("joint.N.vel-cmd, a HAL pin"),
            "ROTARY_VELOCITY.ACTUAL" => Reading::Outside("spindle.M.speed-in, a HAL pin"),
            "LOAD" | "AMPERAGE" | "WATTAGE" | "TORQUE" => Reading::Outside("a HAL pin of the drive"),
            "ACCELERATION" | "ANGULAR_ACCELERATION" | "CUTTING_SPEED" => {
                Reading::Outside("derived beside the program from HAL pins")
            }
            "SOUND_LEVEL" | "TEMPERATURE" => Reading::Outside("a HAL pin of a sensor"),
            _ => NO_SOURCE,
        }
    }

    fn start_timer(&self, _timer: usize) -> Vec<String> {
        Vec::new()
    }

    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
        let mut text = String::new();
        for item in items {
            match item {
                Item::Text(words) => text += &format!("{} ", sheet.short(words, 120)),
                Item::Value(name, source) => {
                    if source.factor != 1.0 {
                        let scaled = source.in_records(("[", "]"));
                        sheet.line(&format!("#<tm_scaled> = {scaled}"));
                        text += &format!("{name}=#<tm_scaled> ");
                    } else if source.before.is_empty() {
                        text += &format!("{name}={} ", source.text);
                    } else {
                        // Each `M66` leaves its value in the same variable.
                        let number = sheet.own_number();
                        for line in &source.before {
                            sheet.line(line);
                        }
                        sheet.line(&format!("#<tm_read{number}> = {}", source.text));
                        text += &format!("{name}=#<tm_read{number}> ");
                    }
                }
            }
        }
        sheet.line(&format!("(LOG,{})", text.trim_end()));
        Ok(true)
    }

    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>> {
        if tool.is_some() {
            return None; // only the tool in the spindle has variables
        }
        Some(vec![
            ("NUMBER", Reading::known("#5400")),
            ("LENGTH", Reading::unsure("#5403")),
        ])
    }
    fn recorder(&self) -> &'static str {
        BESIDE
    }

    fn function(&self, function: &Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal> {
        let text_of = |text: &str, sheet: &Sheet<'_>| sheet.short(text, 120);
        Ok(match &function.call {
            Call::GetTime { label } => {
                if function.variable.is_some() {
                    return Ok(Some(Verdict::refused(
                        "a program has no clock here, so no variable can have its value",
                    )));
                }
                let items = [Item::Text(format!("TIME {}", label.clone().unwrap_or_default()))];
                self.log(&items, sheet)?;
                Some(Verdict::between_blocks(
                    true,
                    "the line of the log is stamped by who reads it",
                ))
            }
            Call::SetAlarm(alarm) => {
                let text = text_of(&format!("ALARM {} {}", alarm.id, alarm.text), sheet);
                match alarm.reaction {
                    Reaction::StopNow => {
                        sheet.line(&format!("(ABORT,{text})"));
                        Some(Verdict::native(true, "the program is aborted"))
                    }
                    Reaction::FeedHold | Reaction::StopAfterOperation => {
                        sheet.line(&format!("(MSG,{text})"));
                        sheet.line("M0");
                        let when = alike::not_at_the_end(alarm.reaction);
                        Some(Verdict::between_blocks(
                            true,
                            format!("a message, then M0 waits at this block{when}"),
                        ))
                    }
                    Reaction::None => {
                        sheet.line(&format!("(MSG,{text})"));
                        self.log(&[Item::Text(text)], sheet)?;
                        Some(Verdict::between_blocks(true, "a message and a line of the log"))
                    }
                }
            }
            Call::DisplayMessage { text } => {
                let text = text_of(text, sheet);
                sheet.line(&format!("(MSG,{text})"));
                Some(Verdict::native(true, "shown on the screen"))
            }
            Call::SetEditAccessLevel { .. } => Some(Verdict::refused("this control has no protection of programs")),
            _ => None,
        })
    }
}

impl LinuxCnc {
    fn condition(&self, label: u32, word: &str, condition: &Expression, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
        let (text, verified) = self.expression(condition, sheet)?;
        alike::note_unverified(verified, sheet);
        sheet.line(&format!("o{label} {word} [{text}]"));
        Ok(())
    }
}

/// The condition has a value that takes a line of its own to read.
fn condition_is_of_the_machine(condition: &Expression, control: &dyn Control, sheet: &mut Sheet<'_>) -> bool {
    match condition {
        Expression::Name(name) => crate::condition::source_of(name, control, sheet).is_ok_and(|source| !source.before.is_empty()),
        Expression::Not(inner) | Expression::Negate(inner) => condition_is_of_the_machine(inner, control, sheet),
        Expression::Binary(_, left, right) => {
            condition_is_of_the_machine(left, control, sheet) || condition_is_of_the_machine(right, control, sheet)
        }
        Expression::Number(..) | Expression::Truth(_) => false,
    }
}

fn register(change: &plan::RegisterChange, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let Some(after) = change.after else { return Ok(()) };
    let letters = ["X", "Y", "Z"];
    let factor = |axis: usize| alike::of_diameter(axis, sheet);
    let line = match &change.register {
        Register::Variable(number) if (31..=5000).contains(number) => format!("#{number} = {}", sheet.number(after, NUMBERS)?),
        Register::WorkOffset { name, axis } if crate::control::work_number(name).is_some_and(|n| n <= 9) => {
            let number = crate::control::work_number(name).unwrap_or(1);
            format!("G10 L2 P{number} {}{}", letters[*axis], sheet.length(after * factor(*axis))?)
        }
        Register::ToolGeometry { tool, axis } => {
            format!("G10 L1 P{tool} {}{}", letters[*axis], sheet.length(after * factor(*axis))?)
        }
        Register::ToolRadius { tool } => format!("G10 L1 P{tool} R{}", sheet.length(after)?),
        Register::TipDirection { tool } => format!("G10 L1 P{tool} Q{}", after as i64),
        other => {
            return Err(alike::no_register(&other.name()));
        }
    };
    sheet.line(&line);
    Ok(())
}

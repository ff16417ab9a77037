//! What Fanuc and Haas share: Custom Macro B, with jumps for branches, variables from #100 and lines of a log by DPRNT.

pub mod statements;

use crate::alike::{self, note_unverified};
use crate::condition::{Comparison, Jumps, Style, jump_if, spell};
use crate::control::Control;
use crate::functions::{Item, Source};
use crate::grade::Verdict;
use crate::number::Decimals;
use crate::sheet::{Refusal, Sheet, Way};
use crate::statement::Statement;
use plan::Expression;
use plan::expression::Operator;
use trace::functions::Reaction;
use trace::{Call, Function};

/// Variables of the program: #100 to #129. The next ones are timers: of the workingstep, the operation, the program, and the last
/// workingstep's time.
const VARIABLES: u32 = 30;
const FIRST: u32 = 100;

const NUMBERS: Decimals = Decimals::pointed(6);

/// Variables that were given milliseconds, among the texts of a sheet.
const MILLISECONDS: &str = "milliseconds";

/// In what the two differ.
pub struct Series {
    /// What #3011 and #3012 hold is known from a manual.
    pub times_verified: bool,
    /// Largest number of an alarm (`#3000`), and whether the range is known.
    pub largest_alarm: (u16, bool),
    /// Longest text of an alarm that every screen shows.
    pub longest_alarm: usize,
}

/// Expressions; truths are jumps.
pub static STYLE: Style = Style {
    operators: &[
        (Operator::Add, "+"),
        (Operator::Subtract, "-"),
        (Operator::Multiply, "*"),
        (Operator::Divide, "/"),
    ],
    brackets: ("[", "]"),
    not: None,
    truth: None,
    numbers: NUMBERS,
    realtime: false,
};

/// `IF[...]GOTO`.
pub struct MacroJumps;

impl Jumps for MacroJumps {
    fn style(&self) -> &Style {
        &STYLE
    }
    fn jump(&self, comparison: &Comparison, sheet: &mut Sheet<'_>) {
        let operator = match comparison.operator {
            Operator::Equal => "EQ",
            Operator::NotEqual => "NE",
            Operator::Less => "LT",
            Operator::LessOrEqual => "LE",
            Operator::Greater => "GT",
            _ => "GE",
        };
        sheet.line(&format!(
            "IF[{} {operator} {}]GOTO{}",
            comparison.left, comparison.right, comparison.to
        ));
    }
    fn go(&self, to: u32, sheet: &mut Sheet<'_>) {
        sheet.line(&format!("GOTO{to}"));
    }
    fn place(&self, label: u32, sheet: &mut Sheet<'_>) {
        sheet.line(&format!("N{label}"));
    }
}

/// Writes branches and loops with jumps; false when the statement is another.
///
/// # Errors
/// The condition cannot be said.
pub fn flow(statement: &Statement<'_>, jumps: &dyn Jumps, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
    let unopened = || Refusal::new("structure", "a branch ends that did not begin", "correct the program");
    match statement {
        Statement::If(condition) => {
            let way = Way::between(sheet.label(), sheet.label());
            let verified = jump_if(condition, false, way.other, (jumps, control), sheet)?;
            note_unverified(verified, sheet);
            sheet.ways.push(way);
        }
        Statement::Else => {
            let way = sheet.ways.last_mut().ok_or_else(unopened)?;
            way.otherwise = true;
            let (other, end) = (way.other, way.end);
            jumps.go(end, sheet);
            jumps.place(other, sheet);
        }
        Statement::EndIf => {
            let way = sheet.ways.pop().ok_or_else(unopened)?;
            jumps.place(if way.otherwise { way.end } else { way.other }, sheet);
        }
        Statement::While(condition) => {
            let way = Way::between(sheet.label(), sheet.label());
            jumps.place(way.other, sheet);
            let verified = jump_if(condition, false, way.end, (jumps, control), sheet)?;
            note_unverified(verified, sheet);
            sheet.ways.push(way);
        }
        Statement::EndWhile => {
            let way = sheet.ways.pop().ok_or_else(unopened)?;
            jumps.go(way.other, sheet);
            jumps.place(way.end, sheet);
        }
        _ => return Ok(false),
    }
    Ok(true)
}

/// The n-th variable of the program.
///
/// # Errors
/// There are not so many.
pub fn variable(number: u32) -> Result<String, Refusal> {
    let number = alike::among(number, VARIABLES, "use fewer variables, or fewer synchronized actions")?;
    Ok(format!("#{}", FIRST + number))
}

/// A value as an expression.
///
/// # Errors
/// It cannot be said.
pub fn value(expression: &Expression, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
    // A truth is kept as the number that it compares equal to.
    if let Expression::Truth(truth) = expression {
        return Ok((if *truth { "1." } else { "0." }.to_owned(), true));
    }
    spell(expression, &STYLE, control, sheet)
}

/// Seconds since a timer was started, and the last workingstep's.
pub fn timer(stream: &str) -> Option<Source> {
    let names = ["trace:ws_time", "trace:op_time", "trace:prog_time"];
    let milliseconds = |text: String| Source {
        factor: 0.001,
        ..Source::of(text).verified()
    };
    if stream == "trace:last_ws_time" {
        return Some(milliseconds(format!("#{}", FIRST + VARIABLES + 3)));
    }
    let timer = names.iter().position(|name| *name == stream)?;
    Some(milliseconds(format!("[#3001-#{}]", FIRST + VARIABLES + timer as u32)))
}

/// `#130=#3001`
pub fn start_timer(timer: usize) -> Vec<String> {
    vec![format!("#{}=#3001", FIRST + VARIABLES + timer as u32)]
}

/// A line by DPRNT: capitals, digits and blanks; values with their digits.
///
/// # Errors
/// A variable's text is no variable.
pub fn dprnt(items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal> {
    const SCRATCH: u32 = FIRST + VARIABLES + 5;
    let mut line = String::new();
    let mut count = 0;
    for item in items {
        match item {
            Item::Text(text) => push_text(&mut line, text),
            Item::Value(name, source) => {
                let plain = source
                    .text
                    .strip_prefix('#')
                    .is_some_and(|n| n.bytes().all(|b| b.is_ascii_digit()));
                let text = if plain && source.factor == 1.0 {
                    source.text.clone()
                } else {
                    // DPRNT takes variables only.
                    let scratch = format!("#{}", SCRATCH + count);
                    count += 1;
                    if count > 10 {
                        return Err(Refusal::new(
                            "log",
                            "more than ten computed values in a line of the log",
                            "log fewer",
                        ));
                    }
                    sheet.line(&format!("{scratch}={}", source.in_records(("[", "]"))));
                    scratch
                };
                push_text(&mut line, name);
                line.push_str(&format!("{text}{}", digits(&text, sheet)));
            }
        }
    }
    sheet.line(&format!("DPRNT[{line}]"));
    Ok(false)
}

/// Digits before and behind the point, eight at most on a Haas; what is longer is cut off on a Fanuc.
fn digits(variable: &str, sheet: &Sheet<'_>) -> &'static str {
    let milliseconds = sheet
        .texts
        .get(MILLISECONDS)
        .is_some_and(|all| all.iter().any(|name| name == variable));
    match variable {
        "#3011" => "[80]", // yyyymmdd
        "#3012" => "[60]", // hhmmss
        _ if milliseconds => "[80]",
        _ => "[53]",
    }
}

fn push_text(line: &mut String, text: &str) {
    if !line.is_empty() {
        line.push('*');
    }
    for letter in text.to_uppercase().chars() {
        match letter {
            // Capitals and digits are printed; a star is a blank. What could be taken for a variable or a bracket is not.
            'A'..='Z' | '0'..='9' | '+' | '-' | '/' | '.' => line.push(letter),
            _ if line.ends_with('*') => {}
            _ => line.push('*'),
        }
    }
    if !line.ends_with('*') {
        line.push('*');
    }
}

/// What both have of their own for a function.
///
/// # Errors
/// The line does not fit.
pub fn function(
    function: &Function,
    series: &Series,
    control: &dyn Control,
    sheet: &mut Sheet<'_>,
) -> Result<Option<Verdict>, Refusal> {
    Ok(match &function.call {
        Call::GetTime { label } => {
            let mut reason = "date and time to the second from #3011 and #3012, quality derived".to_owned();
            if let Some(name) = &function.variable {
                let name = variable(sheet.variable(name))?;
                sheet.line(&format!("{name}=#3001"));
                sheet.texts.entry(MILLISECONDS.to_owned()).or_default().push(name);
                reason += "; the variable holds milliseconds since power-on (#3001)";
            }
            let items = [
                Item::Text(format!("TIME {}", label.clone().unwrap_or_default())),
                Item::Value("DATE".to_owned(), Source::of("#3011")),
                Item::Value("CLOCK".to_owned(), Source::of("#3012")),
            ];
            let log = control.log(&items, sheet)?;
            Some(Verdict::between_blocks(log && series.times_verified, reason))
        }
        Call::SetAlarm(alarm) => {
            let text = alarm_text(&alarm.text, series, sheet);
            match alarm.reaction {
                Reaction::StopNow => {
                    let (largest, verified) = series.largest_alarm;
                    let mut reason = "the control halts and needs RESET; which numbers it takes depends on the series".to_owned();
                    if alarm.id > largest {
                        // The halt is what counts; its number is in the text.
                        let text = alarm_text(&format!("{} {}", alarm.id, alarm.text), series, sheet);
                        sheet.line(&format!("#3000={largest}({text})"));
                        reason += &format!("; {} is beyond {largest} and stands in the text", alarm.id);
                    } else {
                        sheet.line(&format!("#3000={}({text})", alarm.id));
                    }
                    Some(Verdict::native(verified, reason))
                }
                Reaction::FeedHold | Reaction::StopAfterOperation => {
                    sheet.line(&format!("#3006=1({text})"));
                    let when = alike::not_at_the_end(alarm.reaction);
                    Some(Verdict::between_blocks(
                        true,
                        format!("the control waits for cycle start at this block (#3006){when}"),
                    ))
                }
                Reaction::None => {
                    control.log(&[Item::Text(format!("ALARM {} {}", alarm.id, alarm.text))], sheet)?;
                    Some(Verdict::between_blocks(
                        false,
                        "#3000 would halt the machine and no reaction is asked for: a line of the log",
                    ))
                }
            }
        }
        Call::DisplayMessage { text } => {
            let text = alarm_text(text, series, sheet);
            sheet.line(&format!("#3006=1({text})"));
            Some(Verdict::between_blocks(
                true,
                "the control waits for cycle start at a message (#3006)",
            ))
        }
        _ => None,
    })
}

/// Text of an alarm: short, without brackets.
fn alarm_text(text: &str, series: &Series, sheet: &Sheet<'_>) -> String {
    let text: String = text
        .chars()
        .map(|c| if matches!(c, '(' | ')' | '[' | ']') { ' ' } else { c })
        .collect();
    sheet.short(&text, series.longest_alarm)
}

/// A register of the control.
///
/// # Errors
/// It is none of this control.
pub fn register(change: &plan::RegisterChange, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    use plan::Register;
    let turning = sheet.turning;
    let Some(after) = change.after else {
        if let Register::Variable(number) = change.register {
            sheet.line(&format!("#{number}=#0"));
        }
        return Ok(());
    };
    let letters = ["X", "Y", "Z"];
    let factor = |axis: usize| alike::of_diameter(axis, sheet);
    let line = match &change.register {
        Register::Variable(number) => format!("#{number}={}", sheet.number(after, NUMBERS)?),
        Register::WorkOffset { name, axis } => {
            let value = sheet.length(after * factor(*axis))?;
            let place = match crate::control::work_number(name) {
                Some(number) if number <= 6 => format!("L2 P{number}"),
                Some(number) => format!("L20 P{}", number - 6),
                None => "L2 P0".to_owned(),
            };
            format!("G90 G10 {place} {}{value}", letters[*axis]).replace("G90 ", if turning { "" } else { "G90 " })
        }
        Register::ToolGeometry { tool, axis } if turning => {
            format!(
                "G10 P{} {}{}",
                10_000 + tool,
                letters[*axis],
                sheet.length(after * factor(*axis))?
            )
        }
        Register::ToolWear { tool, axis } if turning => {
            format!("G10 P{tool} {}{}", letters[*axis], sheet.length(after * factor(*axis))?)
        }
        Register::ToolRadius { tool } if turning => format!("G10 P{} R{}", 10_000 + tool, sheet.length(after)?),
        Register::ToolRadiusWear { tool } if turning => format!("G10 P{tool} R{}", sheet.length(after)?),
        Register::TipDirection { tool } => format!("G10 P{tool} Q{}", after as i64),
        Register::ToolGeometry { tool, axis: 2 } => format!("G90 G10 L10 P{tool} R{}", sheet.length(after)?),
        Register::ToolWear { tool, axis: 2 } => format!("G90 G10 L11 P{tool} R{}", sheet.length(after)?),
        Register::ToolRadius { tool } => format!("G90 G10 L12 P{tool} R{}", sheet.length(after)?),
        Register::ToolRadiusWear { tool } => format!("G90 G10 L13 P{tool} R{}", sheet.length(after)?),
        other => {
            return Err(alike::no_register(&other.name()));
        }
    };
    sheet.line(&line);
    Ok(())
}

/// A position of the machine that a macro reads, in the order of the control's axes.
pub fn position(stream: &str, turning: bool) -> Option<Source> {
    let axis = stream.strip_suffix(".POSITION.COMMANDED")?;
    let letters: &[&str] = if turning { &["X", "Z"] } else { &["X", "Y", "Z"] };
    let index = letters.iter().position(|letter| *letter == axis)?;
    Some(Source::of(format!("#{}", 5021 + index)))
}

//! Statements as Fanuc and Haas write them.
//!
//! Lengths carry their point, because a whole number may be least increments (parameter 3401.0).

use super::MacroJumps;
use crate::alike::{self, Turn};
use crate::control::Control;
use crate::iso::{self, Codes};
use crate::letters::Letters;
use crate::number::Decimals;
use crate::sheet::{Paper, Refusal, Sheet};
use crate::statement::{Head, Statement};
use plan::StopKind;

const LENGTHS: Decimals = Decimals::pointed(3);

/// Their paper; Haas ends lines otherwise.
pub const PAPER: Paper = Paper {
    lengths: LENGTHS,
    feeds: [LENGTHS, Decimals::pointed(4)],
    speeds: Decimals::plain(0),
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

/// Their feeds; lathes of G-code system A have their own.
pub fn codes(sheet: &Sheet<'_>) -> Codes {
    match sheet.turning {
        true => Codes {
            per_minute: "G98",
            per_revolution: "G99",
        },
        false => iso::CODES,
    }
}

/// The first lines: number and name, the head, what the program relies on. `digits` is how long a number may be.
///
/// # Errors
/// The number is none of the control.
pub fn begin(head: &Head, digits: usize, between: &str, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let (most, words, remedy) = match digits {
        4 => (9999, "four", "give --number 1 to 9999"),
        _ => (99_999, "five", "give --number 1 to 99999"),
    };
    if !(1..=most).contains(&head.number) {
        return Err(Refusal::new(
            "program-number",
            format!("O{} is no program number of {words} digits", head.number),
            remedy,
        ));
    }
    sheet.line("%");
    let number = format!("O{:0digits$}", head.number);
    let name = head.name.strip_prefix(&number).unwrap_or(&head.name);
    let name = sheet.short(name, 24);
    let name = if name.is_empty() { name } else { format!("{between}({name})") };
    sheet.line(&format!("{number}{name}"));
    head.text.iter().for_each(|line| sheet.comment(line));
    Ok(())
}

/// What the program relies on.
pub fn rely_on(sheet: &mut Sheet<'_>) {
    alike::rely_on("G18 G21 G40 G97", "G17 G21 G40 G49 G80 G90 G94", sheet);
}

/// Tapping: the two levels, the feed of a revolution, and the speed.
pub struct TapWords {
    /// `G95 G99 G84 Z-10. R2. F1.5`; on a lathe `G99 G84 Z-10. R0. F1.5`
    pub cycle: String,
    /// `800`
    pub turns: String,
}

/// The words of tapping, and the modes that it leaves behind forgotten. `r` is where the tool comes out, as the control counts it.
///
/// # Errors
/// A number that the control cannot read, or a left-hand thread on a lathe, where G74 is another cycle.
pub fn tap(bottom: i64, r: i64, pitch: f64, left: bool, speed: f64, sheet: &mut Sheet<'_>) -> Result<TapWords, Refusal> {
    if left && sheet.turning {
        return Err(Refusal::new(
            "thread",
            "a left-hand tap on a lathe",
            "tap it with the machine's own cycle",
        ));
    }
    let turns = iso::speed(speed, sheet)?;
    let feed = sheet.number(pitch, PAPER.feeds[1])?;
    let code = if left { "G74" } else { "G84" };
    let level = if sheet.turning { "" } else { "G99 " };
    let (mode, down, up) = (codes(sheet).per_revolution, LENGTHS.spell(bottom), LENGTHS.spell(r));
    let cycle = format!("{mode} {level}{code} Z{down} R{up} F{feed}");
    Ok(TapWords { cycle, turns })
}

/// What Fanuc and Haas write alike.
///
/// # Errors
/// What none of them can say.
pub fn write(statement: &Statement<'_>, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let codes = codes(sheet);
    match statement {
        Statement::Comment(text) | Statement::Section(text) => sheet.comment(text),
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
            let before = if sheet.turning { "G0 G53" } else { "G90 G53 G0" };
            let words = alike::machine_words(before, to, sheet)?;
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
        Statement::Tool { number, .. } => {
            sheet.modal.tool = Some(*number);
            // What the macro behind a tool change leaves in force is the machine builder's.
            sheet.modal.motion = None;
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
        Statement::Spindle(state) => match alike::turn(*state, "M19", sheet)? {
            Turn::Word(word) => sheet.line(&word),
            Turn::Revolutions { speed, word } => {
                let g97 = if sheet.turning { "G97 " } else { "" };
                sheet.line(&format!("{g97}S{speed} {word}"));
            }
            Turn::Surface { metres, limit, word } if sheet.turning => {
                sheet.line(&format!("G50 S{limit}"));
                sheet.line(&format!("G96 S{metres} {word}"));
            }
            Turn::Surface { .. } => return Err(alike::no_surface_speed()),
        },
        Statement::Coolant { before, now } => iso::coolant(*before, *now, "M88", sheet),
        Statement::Message(text) => {
            sheet.notice("messages that do not wait are comments: #3006 would stop the machine");
            let text = format!("MSG {text}");
            sheet.comment(&text);
        }
        Statement::Stop(StopKind::Program) => sheet.line("M0"),
        Statement::Stop(StopKind::Optional) => sheet.line("M1"),
        Statement::Register(change) => super::register(change, sheet)?,
        Statement::Assign { variable, value } => {
            let (name, text) = alike::assigned(variable, value, control, sheet)?;
            sheet.line(&format!("{name}={text}"));
        }
        other => {
            super::flow(other, &MacroJumps, control, sheet)?;
        }
    }
    Ok(())
}

//! What several controls say alike, each fact once: words of moves, the line that a program begins with, assignments, names of files,
//! and what is refused in the same words.

use crate::control::Control;
use crate::iso;
use crate::sheet::{Refusal, Sheet};
use plan::{Expression, SpindleMode, SpindleState};
use trace::functions::Reaction;

/// Axes whose names controls know.
pub const AXES: [&str; 9] = ["X", "Y", "Z", "A", "B", "C", "U", "V", "W"];

/// The place of a linear axis among X, Y, Z.
pub fn linear(component: &str) -> Option<usize> {
    AXES[..3].iter().position(|axis| *axis == component)
}

/// The line that puts everything in force which the program relies on, for a lathe and for a mill.
pub fn rely_on(lathe: &str, mill: &str, sheet: &mut Sheet<'_>) {
    sheet.line(if sheet.turning { lathe } else { mill });
    sheet.modal.plane = Some(if sheet.turning { "G18" } else { "G17" });
    sheet.modal.feed_mode = (!sheet.turning).then_some("G94");
}

/// `before X1. Y2. Z3.`: a move in the machine's frame.
///
/// # Errors
/// A length that the control cannot read.
pub fn machine_words(before: &str, to: &[Option<f64>; 3], sheet: &Sheet<'_>) -> Result<Vec<String>, Refusal> {
    let mut words = vec![before.to_owned()];
    for (letter, to) in AXES.iter().zip(to) {
        if let Some(to) = to {
            words.push(format!("{letter}{}", sheet.length(*to)?));
        }
    }
    Ok(words)
}

/// What the spindle is told, in the numbers of the control.
pub enum Turn {
    /// It stops or stands at its mark.
    Word(String),
    /// `S1000 M3`
    Revolutions {
        /// Revolutions a minute.
        speed: String,
        /// M3 or M4.
        word: String,
    },
    /// A surface speed: m/min, and the most revolutions a minute.
    Surface {
        /// Metres a minute.
        metres: String,
        /// Revolutions a minute, at most.
        limit: String,
        /// M3 or M4.
        word: String,
    },
}

/// What a state of the spindle is on a control that turns; a mill has no surface speed.
///
/// # Errors
/// A speed that rounds to nothing.
pub fn turn(state: SpindleState, orient: &str, sheet: &Sheet<'_>) -> Result<Turn, Refusal> {
    let (word, mode) = iso::spindle(state, orient);
    Ok(match mode {
        None => Turn::Word(word),
        Some(SpindleMode::Revolutions(speed)) => Turn::Revolutions {
            speed: iso::speed(speed.0, sheet)?,
            word,
        },
        Some(SpindleMode::Surface { speed, limit }) => Turn::Surface {
            limit: iso::speed(limit.0, sheet)?,
            metres: iso::speed(speed.0 * 0.06, sheet)?,
            word,
        },
    })
}

/// The variable and the value of an assignment of the program, as the control writes them.
///
/// # Errors
/// There are too many variables, or the value cannot be said.
pub fn assigned(
    variable: &str,
    value: &Expression,
    control: &dyn Control,
    sheet: &mut Sheet<'_>,
) -> Result<(String, String), Refusal> {
    let number = sheet.variable(variable);
    let name = control.variable(number)?;
    let (text, verified) = control.expression(value, sheet)?;
    note_unverified(verified, sheet);
    Ok((name, text))
}

/// Says that a condition or a value has variables that no manual was at hand for.
pub fn note_unverified(verified: bool, sheet: &mut Sheet<'_>) {
    if !verified {
        sheet.verify("variables in conditions of the program");
    }
}

/// Letters that every control takes for the name of a file: capitals, digits, underscores, at most 24.
pub fn file_letters(name: &str) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_uppercase()
        } else {
            '_'
        }
    };
    name.chars().map(plain).take(24).collect()
}

/// The n-th variable of at most so many.
///
/// # Errors
/// There are not so many.
pub fn among(number: u32, most: u32, remedy: &'static str) -> Result<u32, Refusal> {
    if number < most {
        return Ok(number);
    }
    let what = format!("the program has more than {most} variables");
    Err(Refusal::new("variables", what, remedy))
}

/// A work offset behind the control's last one.
pub fn no_work_offset(what: impl Into<String>) -> Refusal {
    Refusal::new("work-offset", what, "use fewer set-ups in one program")
}

/// Where the length belongs to the tool: an offset of another number, or one that counts the other way.
///
/// # Errors
/// It is such a one; `belong` says what belongs to its tool.
pub fn own_offset(number: u32, negative: bool, belong: &str, sheet: &Sheet<'_>) -> Result<(), Refusal> {
    let tool = sheet.modal.tool.unwrap_or(0);
    if negative || (tool != 0 && tool != number) {
        return Err(Refusal::new(
            "tool-offset",
            format!("offset {number} of tool {tool}: {belong} belong to their tool here"),
            "let each tool use the offset of its own number",
        ));
    }
    Ok(())
}

/// A surface speed where nothing turns the part.
pub fn no_surface_speed() -> Refusal {
    Refusal::new("surface-speed", "a surface speed on a mill", "give revolutions")
}

/// A register that the control has not.
pub fn no_register(name: &str) -> Refusal {
    let what = format!("{name} is no register of this control");
    Refusal::new("register", what, "enter the value at the machine")
}

/// A variable that the program leaves in the control, where the control has none like it.
pub fn left_variable(what: &str, value: &str, sheet: &mut Sheet<'_>) {
    let text = format!("NOT POSTED: {what} = {value}");
    sheet.comment(&text);
    sheet.notice("variables that the program leaves in the control (#500 and up) have no counterpart here");
}

/// What a coordinate is multiplied with in a register: diameters on a lathe.
pub fn of_diameter(axis: usize, sheet: &Sheet<'_>) -> f64 {
    if sheet.turning && axis == 0 { 2.0 } else { 1.0 }
}

/// Said behind a reaction that waits at this block.
pub fn not_at_the_end(reaction: Reaction) -> &'static str {
    if reaction == Reaction::StopAfterOperation {
        ", not at the operation's end"
    } else {
        ""
    }
}

//! What controls that read G-code have in common: words, feeds, arcs by their centre.

use crate::sheet::{Refusal, Sheet};
use crate::statement::{Arc, Line, Pace};
use plan::{CoolantState, SpindleMode, SpindleState};

/// G codes of the feed.
#[derive(Clone, Copy, Debug)]
pub struct Codes {
    /// Length a minute.
    pub per_minute: &'static str,
    /// Length a revolution.
    pub per_revolution: &'static str,
}

/// As most controls have them.
pub const CODES: Codes = Codes {
    per_minute: "G94",
    per_revolution: "G95",
};

const AXES: [&str; 3] = ["X", "Y", "Z"];
const CENTRES: [&str; 3] = ["I", "J", "K"];

/// The words of a straight move.
///
/// # Errors
/// A feed that the control cannot read.
pub fn line(line: &Line, codes: Codes, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let motion = if line.pace == Pace::Rapid { "G0" } else { "G1" };
    let mut words = modal_motion(motion, sheet);
    words.extend(feed_mode(line.pace, codes, sheet));
    if line.words[2].is_some() || sheet.turning {
        words.extend(sheet.modal.length.take());
    }
    words.extend(axis_words(line.words, sheet));
    words.extend(feed(line.pace, sheet)?);
    sheet.words(&words);
    Ok(())
}

/// The words of an arc; its centre is incremental.
///
/// # Errors
/// A number that the control cannot read.
pub fn arc(arc: &Arc, codes: Codes, sheet: &mut Sheet<'_>) -> Result<(), Refusal> {
    let mut words = Vec::new();
    let plane = ["G19", "G18", "G17"][arc.normal];
    if sheet.modal.plane != Some(plane) {
        sheet.modal.plane = Some(plane);
        words.push(plane.to_owned());
    }
    if let Some(length) = sheet.modal.length.take() {
        sheet.line(&length);
    }
    words.extend(modal_motion(if arc.counterclockwise { "G3" } else { "G2" }, sheet));
    words.extend(feed_mode(arc.pace, codes, sheet));
    let mut to = arc.to.map(Some);
    if !arc.rises {
        to[arc.normal] = None;
    }
    words.extend(axis_words(to, sheet));
    for k in (0..3).filter(|k| *k != arc.normal) {
        words.push(format!("{}{}", CENTRES[k], sheet.length(arc.to_centre[k])?));
    }
    words.extend(feed(arc.pace, sheet)?);
    sheet.words(&words);
    Ok(())
}

/// `G1` where it is not in force.
pub fn modal_motion(motion: &'static str, sheet: &mut Sheet<'_>) -> Vec<String> {
    if sheet.modal.motion == Some(motion) {
        return Vec::new();
    }
    sheet.modal.motion = Some(motion);
    vec![motion.to_owned()]
}

/// Axis words.
pub fn axis_words(words: [Option<i64>; 3], sheet: &Sheet<'_>) -> Vec<String> {
    let lengths = sheet.paper().lengths;
    let spelled = AXES.iter().zip(words);
    spelled
        .filter_map(|(letter, units)| Some(format!("{letter}{}", lengths.spell(units?))))
        .collect()
}

/// G94 or G95 where it is not in force; then the feed is written again.
pub fn feed_mode(pace: Pace, codes: Codes, sheet: &mut Sheet<'_>) -> Option<String> {
    let mode = match pace {
        Pace::Rapid => return None,
        Pace::PerMinute(_) => codes.per_minute,
        Pace::PerRevolution(_) => codes.per_revolution,
    };
    if sheet.modal.feed_mode == Some(mode) {
        return None;
    }
    sheet.modal.feed_mode = Some(mode);
    sheet.modal.feed = None;
    Some(mode.to_owned())
}

/// F where it is not in force.
///
/// # Errors
/// A feed that rounds to nothing or is too large.
pub fn feed(pace: Pace, sheet: &mut Sheet<'_>) -> Result<Option<String>, Refusal> {
    let Some(number) = feed_number(pace, sheet)? else {
        return Ok(None);
    };
    let word = format!("F{number}");
    if sheet.modal.feed.as_ref() == Some(&word) {
        return Ok(None);
    }
    sheet.modal.feed = Some(word.clone());
    Ok(Some(word))
}

/// The number of a feed.
///
/// # Errors
/// It rounds to nothing or is too large.
pub fn feed_number(pace: Pace, sheet: &Sheet<'_>) -> Result<Option<String>, Refusal> {
    let (value, decimals) = match pace {
        Pace::Rapid => return Ok(None),
        Pace::PerMinute(value) => (value, sheet.paper().feeds[0]),
        Pace::PerRevolution(value) => (value, sheet.paper().feeds[1]),
    };
    let units = crate::number::units_of(value, decimals.places).unwrap_or(0);
    if units <= 0 || value > 1e6 {
        return Err(Refusal::new(
            "feed",
            format!("a feed of {value} is none that the control reads"),
            "correct the feed",
        ));
    }
    Ok(Some(decimals.spell(units)))
}

/// M3, M4, M5, and how it turns.
pub fn spindle(state: SpindleState, orient: &str) -> (String, Option<SpindleMode>) {
    match state {
        SpindleState::Stopped => ("M5".to_owned(), None),
        SpindleState::Oriented => (orient.to_owned(), None),
        SpindleState::Clockwise(mode) => ("M3".to_owned(), Some(mode)),
        SpindleState::Counterclockwise(mode) => ("M4".to_owned(), Some(mode)),
    }
}

/// S with a speed.
///
/// # Errors
/// It rounds to nothing.
pub fn speed(value: f64, sheet: &Sheet<'_>) -> Result<String, Refusal> {
    let decimals = sheet.paper().speeds;
    match crate::number::units_of(value, decimals.places) {
        Some(units) if units > 0 && value < 1e6 => Ok(decimals.spell(units)),
        _ => Err(Refusal::new(
            "spindle-speed",
            format!("a spindle speed of {value} is none that the control reads"),
            "correct the speed",
        )),
    }
}

/// Coolant words; outlets that close are closed by M9 first.
pub fn coolant(before: Option<CoolantState>, now: CoolantState, through: &'static str, sheet: &mut Sheet<'_>) {
    let closes = before
        .is_none_or(|before| (before.flood && !now.flood) || (before.mist && !now.mist) || (before.through && !now.through));
    if now == CoolantState::default() {
        return sheet.line("M9");
    }
    if closes && before.is_some() {
        sheet.line("M9");
    }
    let before = before.filter(|_| !closes).unwrap_or_default();
    for (open, was, word) in [
        (now.mist, before.mist, "M7"),
        (now.flood, before.flood, "M8"),
        (now.through, before.through, through),
    ] {
        if open && !was {
            sheet.line(word);
        }
    }
    if now.through {
        sheet.verify(format!("coolant through the spindle is {through}"));
    }
}

//! Which family of controls a program was written for, guessed from its first part, with the reason in words.

use crate::profile::{FANUC_LATHE, FANUC_MILL, Profile, RS274};
use plan::{ByteSource, ReadError};

/// A guess and its reason.
#[derive(Clone, Debug)]
pub struct Detected {
    /// The family.
    pub profile: &'static Profile,
    /// Why, as a sentence for people.
    pub because: String,
}

/// Bytes that are looked at.
const FIRST_PART: usize = 64 * 1024;

/// Guesses the family from the first part of the text.
///
/// # Errors
/// The file cannot be read.
pub fn detect(source: &mut dyn ByteSource) -> Result<Detected, ReadError> {
    let mut text = vec![0; FIRST_PART.min(usize::try_from(source.length()).unwrap_or(FIRST_PART))];
    let mut filled = 0;
    while filled < text.len() {
        match source.read_at(filled as u64, &mut text[filled..])? {
            0 => break,
            count => filled += count.min(text.len() - filled),
        }
    }
    text.truncate(filled);
    Ok(detect_in(&text))
}

/// A sign that was met, and where.
struct Sign {
    what: &'static str,
    line: usize,
    weight: i32,
}

fn detect_in(text: &[u8]) -> Detected {
    let mut lathe: Vec<Sign> = Vec::new();
    let mut rs274: Vec<Sign> = Vec::new();
    let mut mill = 0;
    let mut incremental_words = false;
    for (index, line) in text.split(|b| *b == b'\n').enumerate() {
        let line_number = index + 1;
        let add = |to: &mut Vec<Sign>, what: &'static str, weight: i32| {
            if !to.iter().any(|s| s.what == what) {
                to.push(Sign {
                    what,
                    line: line_number,
                    weight,
                });
            }
        };
        let (code, message) = without_comments(line);
        if message {
            add(&mut rs274, "a (MSG, comment", 2);
        }
        if contains(&code, b"#<") {
            add(&mut rs274, "a named parameter #<...>", 2);
        }
        if is_o_word(&code) {
            add(&mut rs274, "an o-word", 2);
        }
        let words = words_of(&code);
        let has = |letter: u8, number: f64| words.contains(&(letter, Some(number)));
        let letter = |letter: u8| words.iter().any(|w| w.0 == letter);
        if has(b'G', 64.0) && letter(b'P') {
            add(&mut rs274, "G64 with P", 2);
        }
        for (number, what) in [
            (96.0, "G96"),
            (50.0, "G50 with S"),
            (18.0, "G18"),
            (71.0, "G71"),
            (70.0, "G70"),
            (76.0, "G76 with P"),
        ] {
            let weight = match number as u8 {
                96 => has(b'G', number).then_some(2),
                50 => (has(b'G', number) && letter(b'S')).then_some(3),
                18 => has(b'G', number).then_some(1),
                76 => (has(b'G', number) && letter(b'P') && !letter(b'Y')).then_some(2),
                _ => has(b'G', number).then_some(2),
            };
            if let Some(weight) = weight {
                add(&mut lathe, what, weight);
            }
        }
        let station = words
            .iter()
            .any(|(l, n)| *l == b'T' && n.is_some_and(|n| (101.0..=9999.0).contains(&n) && n % 100.0 < 65.0));
        if station && four_digit_tool(&code) && !has(b'M', 6.0) {
            add(&mut lathe, "a T word with station and offset", 3);
        }
        incremental_words |= !has(b'G', 4.0) && (letter(b'U') || letter(b'W'));
        if incremental_words && !lathe.iter().any(|s| s.what == "U or W words") {
            add(&mut lathe, "U or W words", 2);
        }
        mill +=
            i32::from(letter(b'Y')) + 3 * i32::from(has(b'G', 43.0)) + 2 * i32::from(has(b'M', 6.0)) + i32::from(has(b'G', 17.0));
    }
    if !rs274.is_empty() {
        return chosen(&RS274, &rs274);
    }
    let turning: i32 = lathe.iter().map(|s| s.weight).sum();
    if turning >= 2 && turning > mill {
        return chosen(&FANUC_LATHE, &lathe);
    }
    let because = if mill > 0 {
        "no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill".to_owned()
    } else {
        "no sign of a lathe or of RS274".to_owned()
    };
    Detected {
        profile: &FANUC_MILL,
        because,
    }
}

fn chosen(profile: &'static Profile, signs: &[Sign]) -> Detected {
    let named: Vec<String> = signs.iter().map(|s| format!("{} in line {}", s.what, s.line)).collect();
    Detected {
        profile,
        because: named.join(", "),
    }
}

/// The line in capitals without comments and blanks, and whether one of them was a message.
fn without_comments(line: &[u8]) -> (Vec<u8>, bool) {
    let mut code = Vec::with_capacity(line.len().min(256));
    let (mut inside, mut message) = (false, false);
    for (at, byte) in line.iter().enumerate() {
        match byte {
            b'(' => {
                inside = true;
                message |= line.get(at + 1..at + 5).is_some_and(|t| t.eq_ignore_ascii_case(b"MSG,"));
            }
            b')' => inside = false,
            b';' if !inside => break,
            _ if inside || byte.is_ascii_whitespace() => {}
            _ => code.push(byte.to_ascii_uppercase()),
        }
    }
    (code, message)
}

/// Letters with the number behind them, where there is one.
fn words_of(code: &[u8]) -> Vec<(u8, Option<f64>)> {
    let mut words = Vec::new();
    for (at, byte) in code.iter().enumerate() {
        if byte.is_ascii_alphabetic() {
            let from = at + 1 + usize::from(matches!(code.get(at + 1), Some(b'-' | b'+')));
            words.push((*byte, crate::text::number_at(code, from).map(|n| n.value)));
        }
    }
    words
}

/// `T0101` or `T1203`: at least three digits, as one writes station and offset.
fn four_digit_tool(code: &[u8]) -> bool {
    code.iter()
        .enumerate()
        .any(|(at, b)| *b == b'T' && (3..=4).contains(&code[at + 1..].iter().take_while(|c| c.is_ascii_digit()).count()))
}

/// `O100SUB`, `O<NAME>CALL`: an O with more than a number behind it.
fn is_o_word(code: &[u8]) -> bool {
    let Some(rest) = code.strip_prefix(b"O") else { return false };
    if rest.first() == Some(&b'<') {
        return true;
    }
    let digits = rest.iter().take_while(|c| c.is_ascii_digit()).count();
    let behind = &rest[digits..];
    digits > 0
        && [
            "SUB",
            "ENDSUB",
            "CALL",
            "IF",
            "ELSE",
            "ELSEIF",
            "ENDIF",
            "WHILE",
            "ENDWHILE",
            "DO",
            "REPEAT",
            "ENDREPEAT",
            "RETURN",
        ]
        .iter()
        .any(|k| behind.starts_with(k.as_bytes()))
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|w| w == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, name: &str, because: &str) {
        let found = detect_in(text.as_bytes());
        assert_eq!((found.profile.name, found.because.as_str()), (name, because), "{text}");
    }

    #[test]
    fn the_family_is_told_from_what_only_it_writes() {
        check(
            "O1\nT0101\nG50 S2500\nG96 S200 M3\nG0 X42. Z2.\nU-2. W-1.",
            "fanuc-lathe",
            "a T word with station and offset in line 2, G50 with S in line 3, G96 in line 4, U or W words in line 6",
        );
        check("G21\nG64 P0.01\nG1 X1 F100", "rs274", "G64 with P in line 2");
        check("o100 sub\no100 endsub", "rs274", "an o-word in line 1");
        check("(MSG, load the blank)\nG0 X0", "rs274", "a (MSG, comment in line 1");
        check(
            "O1001(FACE)\nT1 M6\nG0 G17 G54 X0 Y0\nG43 H1 Z5.",
            "fanuc-mill",
            "no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill",
        );
        check("G0 X1. Z2.", "fanuc-mill", "no sign of a lathe or of RS274");
    }

    #[test]
    fn words_in_comments_are_no_signs() {
        check("(G96 T0101 U1)\nG0 X1.", "fanuc-mill", "no sign of a lathe or of RS274");
    }
}

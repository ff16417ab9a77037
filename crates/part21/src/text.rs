//! Strings and numbers as Part 21 writes them: [`decode`] is tolerant, [`encode`] and [`real`] write what every reader accepts.

use std::borrow::Cow;
use std::fmt::Write;

/// The text of a string literal, given the bytes between its apostrophes.
///
/// Understands `''`, `\\`, `\X\hh`, `\X2\..\X0\`, `\X4\..\X0\`, `\S\c`, `\P?\` and raw UTF-8; bytes that are not UTF-8 are read as
/// ISO 8859-1. The directives `\N\`, `\F\` and `\T\`, by which some systems write a new line, a new page and a tabulator, become these.
/// A directive that is not well formed stays in the text as it is written. Line breaks and other control characters are no part of a
/// string (ISO 10303-21, 6.4.3): a writer may break a long string over two lines.
pub fn decode(raw: &[u8]) -> Cow<'_, str> {
    if let Ok(text) = std::str::from_utf8(raw)
        && !raw.iter().any(|&byte| byte == b'\\' || byte == b'\'' || byte < 0x20)
    {
        return Cow::Borrowed(text);
    }
    Cow::Owned(Decoder { raw, at: 0, page: 1 }.run())
}

/// The offset behind the apostrophe that closes a string whose text begins at `start`; `None` when the bytes end before.
pub(crate) fn string_end(bytes: &[u8], start: usize) -> Option<usize> {
    let mut at = start;
    loop {
        at += bytes[at..].iter().position(|&byte| byte == b'\'')?;
        if !closes(bytes, start, at) {
            at += 1;
        } else if bytes.get(at + 1) == Some(&b'\'') {
            at += 2;
        } else {
            return Some(at + 1);
        }
    }
}

/// Can the apostrophe at `at` close the string whose text begins at `start`?
///
/// It cannot when it is the character of a page directive that somebody did not double: `\S\'x` is a section sign and an x.
pub(crate) fn closes(bytes: &[u8], start: usize, at: usize) -> bool {
    let directive = at >= start + 3 && &bytes[at - 3..at] == b"\\S\\" && (at < start + 4 || bytes[at - 4] != b'\\');
    let followed = bytes.get(at + 1).copied().unwrap_or(b')');
    !directive || matches!(followed, b',' | b')' | b'\'' | b'/' | b';') || followed.is_ascii_whitespace()
}

struct Decoder<'a> {
    raw: &'a [u8],
    at: usize,
    /// The part of ISO 8859 that `\S\` speaks, set by `\P?\`.
    page: usize,
}

impl Decoder<'_> {
    fn run(mut self) -> String {
        let mut text = String::with_capacity(self.raw.len());
        while let Some(&byte) = self.raw.get(self.at) {
            match byte {
                b'\'' => {
                    text.push('\'');
                    self.at += if self.raw.get(self.at + 1) == Some(&b'\'') { 2 } else { 1 };
                }
                b'\\' => {
                    if !self.directive(&mut text) {
                        text.push('\\');
                        self.at += 1;
                    }
                }
                0..0x20 => self.at += 1,
                0x20..0x80 => {
                    text.push(char::from(byte));
                    self.at += 1;
                }
                _ => self.raw_character(&mut text),
            }
        }
        text
    }

    /// One character beyond ASCII: UTF-8 when it is, else ISO 8859-1.
    fn raw_character(&mut self, text: &mut String) {
        let rest = &self.raw[self.at..];
        let length = (2..=4.min(rest.len())).find(|&length| std::str::from_utf8(&rest[..length]).is_ok());
        match length.and_then(|length| std::str::from_utf8(&rest[..length]).ok()) {
            Some(character) => {
                text.push_str(character);
                self.at += character.len();
            }
            None => {
                text.push(char::from(rest[0]));
                self.at += 1;
            }
        }
    }

    /// Reads the directive at the cursor; false, and nothing read, when it is none.
    fn directive(&mut self, text: &mut String) -> bool {
        let rest = &self.raw[self.at..];
        match rest {
            [b'\\', b'\\', ..] => {
                text.push('\\');
                self.at += 2;
            }
            [b'\\', b'S', b'\\', character, ..] if *character < 0x80 && *character >= 0x20 => {
                text.push(on_page(self.page, character + 0x80));
                self.at += if rest[3..].starts_with(b"''") { 5 } else { 4 };
            }
            [b'\\', control @ (b'N' | b'F' | b'T'), b'\\', ..] => {
                text.push(match control {
                    b'N' => '\n',
                    b'F' => '\u{c}',
                    _ => '\t',
                });
                self.at += 3;
            }
            [b'\\', b'P', page @ b'A'..=b'I', b'\\', ..] => {
                self.page = usize::from(page - b'A') + 1;
                self.at += 4;
            }
            [b'\\', b'X', b'\\', high, low, ..] => match (hex(*high), hex(*low)) {
                (Some(high), Some(low)) => {
                    text.push(char::from((high * 16 + low) as u8));
                    self.at += 5;
                }
                _ => return false,
            },
            [b'\\', b'X', width @ (b'2' | b'4'), b'\\', ..] => {
                let digits_per_unit = if *width == b'2' { 4 } else { 8 };
                let digits = rest[4..].iter().take_while(|&&byte| hex(byte).is_some()).count();
                if !rest[4 + digits..].starts_with(b"\\X0\\") || digits % digits_per_unit != 0 {
                    return false;
                }
                let units = rest[4..4 + digits]
                    .chunks(digits_per_unit)
                    .map(|unit| unit.iter().fold(0, |value, &digit| value * 16 + hex(digit).unwrap_or(0)));
                if digits_per_unit == 4 {
                    // UCS-2 by the book, but UTF-16 pairs are seen.
                    text.extend(
                        char::decode_utf16(units.map(|unit| unit as u16)).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)),
                    );
                } else {
                    text.extend(units.map(|unit| char::from_u32(unit).unwrap_or(char::REPLACEMENT_CHARACTER)));
                }
                self.at += 4 + digits + 4;
            }
            _ => return false,
        }
        true
    }
}

fn hex(digit: u8) -> Option<u32> {
    char::from(digit).to_digit(16)
}

/// The string literal of `text`, with its apostrophes, in plain ASCII, for a file of any implementation level.
pub fn encode(text: &str) -> String {
    let mut literal = String::with_capacity(text.len() + 2);
    literal.push('\'');
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '\'' => literal.push_str("''"),
            '\\' => literal.push_str("\\\\"),
            ' '..='~' => literal.push(character),
            '\0'..='\u{ff}' => push_hex(&mut literal, "\\X\\", character, 2),
            _ => {
                let wide = character > '\u{ffff}';
                let same_width = |c: &char| *c > '\u{ff}' && (*c > '\u{ffff}') == wide;
                push_hex(
                    &mut literal,
                    if wide { "\\X4\\" } else { "\\X2\\" },
                    character,
                    if wide { 8 } else { 4 },
                );
                while let Some(next) = characters.next_if(same_width) {
                    push_hex(&mut literal, "", next, if wide { 8 } else { 4 });
                }
                literal.push_str("\\X0\\");
            }
        }
    }
    literal.push('\'');
    literal
}

fn push_hex(literal: &mut String, before: &str, character: char, digits: usize) {
    // Writing to a String cannot fail.
    let _ = write!(literal, "{before}{:0digits$X}", u32::from(character));
}

/// A number as a STEP real: the shortest text that reads back to the same bits, always with a point, exponent `E`.
///
/// Infinities and not-a-number have no form in Part 21; their Rust names come out, which [`crate::Edits`] refuses.
pub fn real(number: f64) -> String {
    let size = number.abs();
    if number.is_finite() && size != 0.0 && !(1e-5..1e15).contains(&size) {
        let text = format!("{number:E}");
        return match text.split_once('E') {
            Some((mantissa, exponent)) if !mantissa.contains('.') => format!("{mantissa}.E{exponent}"),
            _ => text,
        };
    }
    let mut text = format!("{number}");
    if number.is_finite() && !text.contains('.') {
        text.push('.');
    }
    text
}

/// The character that code `code` (0xA0..=0xFF) has in part `page` of ISO 8859.
fn on_page(page: usize, code: u8) -> char {
    match (page.checked_sub(2).and_then(|index| PAGES.get(index)), code.checked_sub(0xa0)) {
        (Some(upper), Some(place)) => upper.chars().nth(usize::from(place)).unwrap_or(char::REPLACEMENT_CHARACTER),
        _ => char::from(code),
    }
}

/// Codes 0xA0..=0xFF of ISO 8859-2 to -9; part 1 is Unicode itself.
#[rustfmt::skip]
const PAGES: [&str; 8] = [
    // ISO 8859-2
    "\u{a0}Ą˘Ł¤ĽŚ§¨ŠŞŤŹ\u{ad}ŽŻ°ą˛ł´ľśˇ¸šşťź˝žżŔÁÂĂÄĹĆÇČÉĘËĚÍÎĎĐŃŇÓÔŐÖ×ŘŮÚŰÜÝŢßŕáâăäĺćçčéęëěíîďđńňóôőö÷řůúűüýţ˙",
    // ISO 8859-3
    "\u{a0}Ħ˘£¤\u{fffd}Ĥ§¨İŞĞĴ\u{ad}\u{fffd}Ż°ħ²³´µĥ·¸ışğĵ½\u{fffd}żÀÁÂ\u{fffd}ÄĊĈÇÈÉÊËÌÍÎÏ\u{fffd}ÑÒÓÔĠÖ×ĜÙÚÛÜŬŜßàáâ\u{fffd}äċĉçèéêëìíîï\u{fffd}ñòóôġö÷ĝùúûüŭŝ˙",
    // ISO 8859-4
    "\u{a0}ĄĸŖ¤ĨĻ§¨ŠĒĢŦ\u{ad}Ž¯°ą˛ŗ´ĩļˇ¸šēģŧŊžŋĀÁÂÃÄÅÆĮČÉĘËĖÍÎĪĐŅŌĶÔÕÖ×ØŲÚÛÜŨŪßāáâãäåæįčéęëėíîīđņōķôõö÷øųúûüũū˙",
    // ISO 8859-5
    "\u{a0}ЁЂЃЄЅІЇЈЉЊЋЌ\u{ad}ЎЏАБВГДЕЖЗИЙКЛМНОПРСТУФХЦЧШЩЪЫЬЭЮЯабвгдежзийклмнопрстуфхцчшщъыьэюя№ёђѓєѕіїјљњћќ§ўџ",
    // ISO 8859-6
    "\u{a0}\u{fffd}\u{fffd}\u{fffd}¤\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}،\u{ad}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}؛\u{fffd}\u{fffd}\u{fffd}؟\u{fffd}ءآأؤإئابةتثجحخدذرزسشصضطظعغ\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}ـفقكلمنهوىيًٌٍَُِّْ\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}",
    // ISO 8859-7
    "\u{a0}‘’£€₯¦§¨©ͺ«¬\u{ad}\u{fffd}―°±²³΄΅Ά·ΈΉΊ»Ό½ΎΏΐΑΒΓΔΕΖΗΘΙΚΛΜΝΞΟΠΡ\u{fffd}ΣΤΥΦΧΨΩΪΫάέήίΰαβγδεζηθικλμνξοπρςστυφχψωϊϋόύώ\u{fffd}",
    // ISO 8859-8
    "\u{a0}\u{fffd}¢£¤¥¦§¨©×«¬\u{ad}®¯°±²³´µ¶·¸¹÷»¼½¾\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}‗אבגדהוזחטיךכלםמןנסעףפץצקרשת\u{fffd}\u{fffd}\u{200e}\u{200f}\u{fffd}",
    // ISO 8859-9
    "\u{a0}¡¢£¤¥¦§¨©ª«¬\u{ad}®¯°±²³´µ¶·¸¹º»¼½¾¿ÀÁÂÃÄÅÆÇÈÉÊËÌÍÎÏĞÑÒÓÔÕÖ×ØÙÚÛÜİŞßàáâãäåæçèéêëìíîïğñòóôõö÷øùúûüışÿ",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(raw: &str, decoded: &str) {
        assert_eq!(decode(raw.as_bytes()), decoded);
    }

    #[test]
    fn directives_become_characters() {
        check("it''s", "it's");
        check("C:\\\\temp", "C:\\temp");
        check("M\\X2\\00FC\\X0\\ller \\X2\\4E2D6587\\X0\\", "Müller 中文");
        check("\\X4\\0001F600\\X0\\ end", "😀 end");
        check("\\X2\\D83DDE00\\X0\\", "😀");
        check("caf\\X\\E9", "café");
        check("\\S\\D page A; \\PB\\\\S\\C page B", "Ä page A; Ă page B");
        check("Größe", "Größe");
        check("broken over\ntwo lines", "broken overtwo lines");
    }

    #[test]
    fn a_broken_directive_stays_as_it_is_written() {
        check("\\X2\\00F", "\\X2\\00F");
        check("\\X\\Z9 \\Q \\", "\\X\\Z9 \\Q \\");
        assert_eq!(decode(b"caf\xe9 \xc3"), "caf\u{e9} \u{c3}");
    }

    #[test]
    fn what_is_encoded_is_ascii_and_decodes_to_itself() {
        for text in ["", "it's", "a\\b", "Größe 中文 😀😀é", "tab\tend"] {
            let literal = encode(text);
            assert!(literal.is_ascii(), "{literal}");
            assert_eq!(decode(&literal.as_bytes()[1..literal.len() - 1]), text);
        }
        assert_eq!(encode("中文"), "'\\X2\\4E2D6587\\X0\\'");
    }

    #[test]
    fn reals_have_a_point_and_read_back() {
        for (number, text) in [
            (0.0, "0."),
            (-1500.0, "-1500."),
            (0.02, "0.02"),
            (1e-6, "1.E-6"),
            (-2.5e300, "-2.5E300"),
            (1e15, "1.E15"),
        ] {
            assert_eq!(real(number), text);
            assert_eq!(text.parse::<f64>(), Ok(number));
        }
    }
}

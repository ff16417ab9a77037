//! Tools of a new file: what the program's words and the machine's table tell of them.

use super::sheet::Sheet;
use part21::text::encode;
use plan::{Tables, ToolCall};
use units::{MM_PER_INCH, Millimetres, ToolNumber};

/// A tool and who uses it.
#[derive(Clone, Debug)]
pub(super) struct UsedTool {
    pub(super) number: ToolNumber,
    words: String,
    diameter: Option<Millimetres>,
    pub(super) users: Vec<u64>,
}

impl UsedTool {
    pub(super) fn new(call: &ToolCall) -> Self {
        UsedTool {
            number: call.number,
            words: call.name.clone(),
            // The program's words go before the machine's table: they say which tool it was written for.
            diameter: diameter_in(&call.name).or(call.diameter),
            users: Vec::new(),
        }
    }

    pub(super) fn write(&self, sheet: &mut Sheet, turning: bool, tables: &Tables) {
        let mut items = Vec::new();
        let kind = kind_in(&self.words, turning);
        let entry = tables.tools.get(&self.number);
        let mut resource = "milling cutting tool";
        if turning {
            // The standard asks a turning tool for its functional length and f dimension; without them it is a tool of no such kind.
            resource = "cutting tool";
            if let Some(offset) = entry.map(|entry| entry.geometry.0.xyz) {
                items.push(sheet.length_item("functional length", Millimetres(offset[2])));
                items.push(sheet.length_item("f dimension", Millimetres(offset[0])));
                resource = "turning cutting tool";
            }
        }
        if let Some(diameter) = self.diameter.filter(|diameter| diameter.0 > 0.0) {
            items.push(sheet.length_item("effective cutting diameter", diameter));
        }
        if !turning && let Some(length) = entry.map(|entry| entry.geometry.0.xyz[2]).filter(|length| *length > 0.0) {
            items.push(sheet.length_item("overall assembly length", Millimetres(length)));
        }
        if let Some(teeth) = teeth_in(&self.words).filter(|_| kind.contains("mill") && kind != "user defined milling tool") {
            items.push(sheet.count_item("number of effective teeth", teeth));
        }
        if kind == "user defined milling tool" && !self.words.is_empty() {
            items.push(sheet.add(format!(
                "DESCRIPTIVE_REPRESENTATION_ITEM('tool description',{})",
                encode(&self.words)
            )));
        }
        let resource = sheet.add(format!("ACTION_RESOURCE_TYPE('{resource}')"));
        let users: Vec<String> = self.users.iter().map(|user| format!("#{user}")).collect();
        let tool = sheet.add(format!(
            "MACHINING_TOOL('{}','{kind}',({}),#{resource})",
            self.number.0,
            users.join(",")
        ));
        if !items.is_empty() {
            let items: Vec<String> = items.iter().map(|item| format!("#{item}")).collect();
            let no_units = sheet.no_units;
            let body = sheet.add(format!(
                "MACHINING_TOOL_BODY_REPRESENTATION('{kind}',({}),#{no_units})",
                items.join(",")
            ));
            let property = sheet.add(format!("RESOURCE_PROPERTY('tool body','',#{tool})"));
            sheet.add(format!("RESOURCE_PROPERTY_REPRESENTATION('','',#{property},#{body})"));
        }
    }
}

/// The standard's kind of a tool that a program calls so. Kinds that ask for dimensions nobody knows (taps, reamers, boring tools) are
/// user defined.
fn kind_in(words: &str, turning: bool) -> &'static str {
    let words = words.to_uppercase();
    let has = |any: &[&str]| any.iter().any(|word| words.contains(word));
    if has(&["DRILL", "BOHRER"]) {
        return match () {
            () if has(&["SPOT", "CENTER", "CENTRE", "NC-A"]) => "spot drill",
            () if turning => "drill",
            () => "twist drill",
        };
    }
    if turning {
        return "general turning tool";
    }
    match () {
        () if has(&["TAP", "REAM", "BOR"]) => "user defined milling tool",
        () if has(&["FACE", "SHELL"]) => "facemill",
        () if has(&["BULL"]) => "user defined milling tool", // its corner radius is not known
        () if has(&["BALL"]) => "ballnose endmill",
        () if has(&["END MILL", "ENDMILL", "SLOT MILL", "FRAESER", "FRÄSER"]) => "endmill",
        () => "user defined milling tool",
    }
}

/// `50 MM`, `D12`, `0.5 INCH`, `0.25"`.
fn diameter_in(words: &str) -> Option<Millimetres> {
    let words = words.to_uppercase();
    for (start, number, rest) in numbers(&words) {
        let unit = rest.trim_start();
        if unit.starts_with("MM") {
            return Some(Millimetres(number));
        }
        if unit.starts_with('"') || unit.starts_with("INCH") || unit.starts_with("IN ") || unit == "IN" {
            return Some(Millimetres(number * MM_PER_INCH));
        }
        let before = words[..start].trim_end_matches(['=', ' ']);
        let ends_word = |mark: &str| {
            before
                .strip_suffix(mark)
                .is_some_and(|head| !head.ends_with(|c: char| c.is_alphanumeric()))
        };
        if ["D", "Ø", "DIA", "DIA."].into_iter().any(ends_word) {
            return Some(Millimetres(number));
        }
    }
    None
}

/// `3 FLUTES`, `Z4` is no such thing.
fn teeth_in(words: &str) -> Option<f64> {
    let words = words.to_uppercase();
    let found = numbers(&words).into_iter().find(|(_, number, rest)| {
        let unit = rest.trim_start_matches([' ', '-']);
        number.fract() == 0.0
            && *number >= 1.0
            && (unit.starts_with("FLUTE") || unit.starts_with("TEETH") || unit.starts_with("FL "))
    });
    found.map(|(_, number, _)| number)
}

/// The numbers in a text: where each begins, and what follows it.
fn numbers(text: &str) -> Vec<(usize, f64, &str)> {
    let mut found = Vec::new();
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let digit = |n: usize| bytes.get(n).is_some_and(u8::is_ascii_digit);
        if digit(at) || (bytes[at] == b'.' && digit(at + 1)) {
            let mut end = at;
            while bytes.get(end).is_some_and(|byte| byte.is_ascii_digit() || *byte == b'.') {
                end += 1;
            }
            let number = text[at..end].trim_end_matches('.').parse();
            found.extend(number.ok().map(|number| (at, number, &text[end..])));
            at = end;
        } else {
            at += 1;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(words: &str, kind: &str, diameter: Option<f64>, teeth: Option<f64>) {
        assert_eq!(kind_in(words, false), kind, "{words}");
        assert_eq!(diameter_in(words).map(|d| d.0), diameter, "{words}");
        assert_eq!(teeth_in(words), teeth, "{words}");
    }

    #[test]
    fn the_words_of_a_program_tell_what_tool_it_wants() {
        check("50 MM FACE MILL", "facemill", Some(50.0), None);
        check("10 mm end mill, 3 flutes", "endmill", Some(10.0), Some(3.0));
        check("6.6MM DRILL", "twist drill", Some(6.6), None);
        check("D12 ENDMILL", "endmill", Some(12.0), None);
        check("Ø8. BALL", "ballnose endmill", Some(8.0), None);
        check(".5\" ENDMILL", "endmill", Some(12.7), None);
        check("M8 TAP", "user defined milling tool", None, None);
        check("CENTRE DRILL", "spot drill", None, None);
        check("", "user defined milling tool", None, None);
    }
}

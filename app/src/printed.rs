//! What a program printed (DPRNT, BPRNT) and how it named its variables (SETVN) in one run, read from the run's events: printed is what
//! was executed, not what was read ahead.

use ledger::Event;
use plan::RawNcFunction;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// The file in a job's folder that the lines go to.
pub const FILE: &str = "DPRNT.txt";

/// What was printed and named.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Printed {
    /// The lines, in order, without their ends.
    #[serde(rename = "printed", skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<String>,
    /// Names by number of the variable; the last one given counts.
    #[serde(rename = "variable_names", skip_serializing_if = "BTreeMap::is_empty")]
    pub names: BTreeMap<u32, String>,
    /// Records of functions of the traceability vocabulary, in order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub functions: Vec<crate::functions::Told>,
    /// What a printer at the port would have got.
    #[serde(skip)]
    pub bytes: Vec<u8>,
}

impl Printed {
    /// Picks it out of the events of a run.
    pub fn of<'e>(events: impl IntoIterator<Item = &'e Event>) -> Printed {
        let events: Vec<&Event> = events.into_iter().collect();
        let mut printed = Printed {
            functions: crate::functions::told(events.iter().copied()),
            ..Printed::default()
        };
        for event in events.into_iter().filter(|event| event.kind == "nc-function") {
            let text = |name: &str| event.detail.get(name).and_then(Value::as_str).unwrap_or_default();
            let property = |name: &str| {
                event
                    .detail
                    .get("properties")
                    .and_then(|p| p.get(name))
                    .and_then(Value::as_str)
            };
            if text("kind") == RawNcFunction::PRINT {
                printed.take(text("text"), text("name") == "BPRNT");
            } else if text("kind") == RawNcFunction::VARIABLE_NAME
                && let (Some(number), Some(name)) = (property("variable").and_then(|n| n.parse().ok()), property("name"))
            {
                printed.names.insert(number, name.to_owned());
            }
        }
        printed
    }

    fn take(&mut self, text: &str, binary: bool) {
        if binary {
            // Each character of such a line is the byte of its number.
            self.bytes
                .extend(text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')));
        } else {
            self.bytes.extend_from_slice(text.as_bytes());
        }
        let line = text.strip_suffix('\n').unwrap_or(text);
        self.lines.push(line.strip_suffix('\r').unwrap_or(line).to_owned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ledger::Chain;
    use serde_json::json;
    use units::Timestamp;

    #[test]
    fn lines_and_names_are_picked_out_of_the_events() {
        let mut chain = Chain::default();
        let mut event = |detail: Value| {
            let detail = detail.as_object().expect("an object").clone().into_iter().collect();
            chain.append(Timestamp(0), "nc-function", detail)
        };
        let events = [
            event(json!({"kind": "print", "name": "DPRNT", "text": "X 1.500\r\n"})),
            event(json!({"kind": "print", "name": "BPRNT", "text": "\u{ff}A\n"})),
            event(json!({"kind": "variable name", "properties": {"variable": "501", "name": "DIM A"}})),
            event(json!({"kind": "extended function", "text": "trace:1 get_time"})),
        ];
        let printed = Printed::of(&events);
        assert_eq!(printed.lines, ["X 1.500", "\u{ff}A"]);
        assert_eq!(printed.bytes, b"X 1.500\r\n\xffA\n");
        assert_eq!(printed.names, BTreeMap::from([(501, "DIM A".to_owned())]));
    }
}

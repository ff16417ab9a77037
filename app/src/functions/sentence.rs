//! What the record of a function says, as a person reads it: what happened first, then values with their units, and nothing left out.

use serde_json::Value;
use std::collections::BTreeMap;
use trace::sensor::TYPES;
use units::Timestamp;

/// Members that stand in columns of their own, or only help to find the record.
const ELSEWHERE: [&str; 7] = ["function", "place", "step", "tick", "unit", "record", "since_cycle"];

/// A record in a line.
pub fn of(detail: &BTreeMap<String, Value>) -> String {
    let mut rest: BTreeMap<&str, &Value> = detail.iter().map(|(key, value)| (key.as_str(), value)).collect();
    rest.retain(|key, _| !ELSEWHERE.contains(key));
    let mut parts = Vec::new();
    first(&mut rest, &mut parts);
    moments(&mut rest, &mut parts);
    tool(&mut rest, &mut parts);
    recording(&mut rest, &mut parts);
    if let Some(values) = rest.remove("values") {
        match values {
            Value::Array(all) => parts.extend(all.iter().map(value)),
            Value::Object(all) => parts.extend(all.iter().map(|(name, value)| format!("{name} = {}", plain(value)))),
            _ => {}
        }
    }
    let actions = rest.remove("actions").and_then(Value::as_array);
    // A measurement of this run is as good as the run, which says at the top what it is.
    rest.retain(|key, value| *key != "quality" || !["ok", "simulated"].contains(&value.as_str().unwrap_or_default()));
    for (key, value) in rest {
        parts.push(format!("{} {}", key.replace('_', " "), members(value)));
    }
    let mut sentence = parts.join(", ");
    for action in actions.into_iter().flatten() {
        let inner: BTreeMap<String, Value> = action.as_object().cloned().unwrap_or_default().into_iter().collect();
        let name = inner.get("function").map_or_else(String::new, plain);
        sentence += &format!("; {name}: {}", of(&inner));
    }
    sentence
}

type Rest<'d> = BTreeMap<&'d str, &'d Value>;

/// The error, whose it is, and what became of it.
fn first(rest: &mut Rest<'_>, parts: &mut Vec<String>) {
    let mut take = |key: &str| rest.remove(key).map(plain);
    parts.extend(take("error"));
    match (take("id"), take("run")) {
        // Values along a path have no id of their own.
        (Some(id), Some(run)) if id.starts_with("get_") && id.ends_with(&format!(" {run}")) => parts.push(format!("run {run}")),
        (Some(id), Some(run)) => parts.push(format!("id {id} (run {run})")),
        (Some(id), None) => parts.push(format!("id {id}")),
        (None, Some(run)) => parts.push(format!("run {run}")),
        (None, None) => {}
    }
    parts.extend(take("alarm").map(|alarm| format!("alarm {alarm}")));
    parts.extend(take("state"));
    parts.extend(take("label"));
    parts.extend(take("name"));
    parts.extend(take("text").map(|text| format!("'{text}'")));
    parts.extend(
        take("reaction")
            .filter(|word| word != "none")
            .map(|word| word.replace('_', " ")),
    );
    parts.extend(take("why"));
    let frequency = take("frequency").filter(|word| word != "NONE");
    if let (Some(frequency), Some(condition)) = (frequency, take("condition")) {
        parts.push(format!("{frequency} {condition}"));
    }
    parts.extend(take("scope").map(|scope| match scope.as_str() {
        "ALL" => "in all modes".to_owned(),
        "AUTOMATIC" => "in automatic".to_owned(),
        "rest_of_program" => "for the rest of the program".to_owned(),
        "workplan" => "to the end of the workplan".to_owned(),
        other => other.to_owned(),
    }));
    parts.extend(take("cycle_of_condition").map(|cycle| format!("condition in cycle {cycle}")));
    parts.extend(take("cycle_of_effect").map(|cycle| format!("effect in cycle {cycle}")));
    parts.extend(take("fired").map(|fired| format!("fired {fired} times").replace("fired 1 times", "fired once")));
    if let Some(new) = take("new") {
        parts.push(format!("level {new}"));
        parts.extend(take("old").map(|old| format!("before {old}")));
        let _ = (take("default"), take("from_step"));
    }
}

/// Times of the clock and durations.
fn moments(rest: &mut Rest<'_>, parts: &mut Vec<String>) {
    let mut number = |key: &str| rest.remove(key).and_then(Value::as_f64);
    if let Some(milliseconds) = number("unix_ms") {
        parts.push(crate::clock::utc(Timestamp(
            (milliseconds.floor() as i64).saturating_mul(1_000_000),
        )));
    }
    let since = number("since_program_began_ms");
    parts.extend(since.map(|ms| format!("{} s after the program began", digits(ms / 1e3))));
    parts.extend(number("duration_s").map(|s| format!("took {} s", digits(s))));
    let _ = (number("begin_ns"), number("end_ns"));
    if let Some(in_cut) = number("in_cut_s") {
        let quality = rest
            .remove("in_cut_quality")
            .map_or_else(String::new, |word| format!(" ({})", plain(word)));
        parts.push(format!("in the cut {} s{quality}", digits(in_cut)));
    }
    let active = rest.remove("active_s").and_then(Value::as_f64);
    parts.extend(active.map(|s| format!("active for {} s", digits(s))));
}

/// What the table holds of a tool.
fn tool(rest: &mut Rest<'_>, parts: &mut Vec<String>) {
    if let Some(number) = rest.remove("tool_number") {
        parts.insert(0, format!("T{}", plain(number)));
        // Length and radius say the same.
        let _ = (rest.remove("geometry_mm"), rest.remove("diameter_mm"));
    }
    for (key, word) in [("length_mm", "length"), ("radius_mm", "radius"), ("wear_mm", "wear")] {
        if let Some(value) = rest.remove(key) {
            parts.push(format!("{word} {} mm", members(value)));
        }
    }
}

/// How a recording samples, and what it came to.
fn recording(rest: &mut Rest<'_>, parts: &mut Vec<String>) {
    let sampling = rest.remove("sampling").map(plain);
    match (rest.remove("cycles").and_then(Value::as_u64), sampling) {
        (Some(1), _) => parts.push("every cycle".to_owned()),
        (Some(cycles), _) => parts.push(format!("every {cycles} cycles")),
        (None, sampling) => parts.extend(sampling),
    }
    let statistic = rest.remove("statistic").map(plain);
    parts.extend(statistic.filter(|word| word != "last"));
    if let (Some(from), Some(to)) = (rest.remove("from_cycle"), rest.remove("to_cycle")) {
        parts.push(format!("cycles {} to {}", plain(from), plain(to)));
    }
    parts.extend(rest.remove("samples").map(|samples| format!("{} samples", plain(samples))));
    if let Some(streams) = rest.remove("streams").and_then(Value::as_array) {
        let name = |stream: &Value| {
            let name = stream.get("name").map_or_else(String::new, plain);
            let missing = stream.get("quality").is_some_and(|quality| quality == "unavailable");
            if missing { format!("{name} (unavailable)") } else { name }
        };
        parts.push(streams.iter().map(name).collect::<Vec<_>>().join(" "));
    }
}

/// `X.LOAD 12.5 %`
fn value(one: &Value) -> String {
    let text = |key: &str| one.get(key).and_then(Value::as_str).unwrap_or_default();
    let Some(number) = one.get("value").and_then(Value::as_f64) else {
        return format!("{} unavailable", text("stream"));
    };
    let symbol = symbol(text("unit"));
    let within = match one.get("within_tolerance") {
        Some(Value::Bool(true)) => " (within)",
        Some(Value::Bool(false)) => " (outside)",
        _ => "",
    };
    format!("{} {} {symbol}{within}", text("stream"), digits(number))
        .trim_end()
        .to_owned()
}

/// A unit as the shop writes it.
pub fn symbol(unit: &str) -> &str {
    let known = TYPES.iter().find(|(_, dimension)| dimension.unit() == unit);
    match (known, unit) {
        (Some((_, dimension)), _) => dimension.symbol(),
        (None, "SECOND") => "s",
        (None, "MILLISECOND") => "ms",
        (None, "NANOSECOND") => "ns",
        (None, "COUNT") => "",
        (None, other) => other,
    }
}

/// Four digits behind the point at most, and none that say nothing.
pub fn digits(number: f64) -> String {
    let text = format!("{number:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A value by itself: texts without quotes.
pub fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// The same with what is in it.
fn members(value: &Value) -> String {
    match value {
        Value::Array(all) => all.iter().map(members).collect::<Vec<_>>().join(" "),
        Value::Object(all) => {
            let each = all
                .iter()
                .map(|(key, value)| format!("{} {}", key.replace('_', " "), members(value)));
            format!("({})", each.collect::<Vec<_>>().join(", "))
        }
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), digits),
        other => plain(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[track_caller]
    fn check(record: Value, expected: &str) {
        let detail = record.as_object().cloned().expect("an object").into_iter().collect();
        assert_eq!(of(&detail), expected);
    }

    #[test]
    fn a_firing_says_its_condition_and_what_was_done() {
        check(
            json!({ "function": "start_synchronized_action", "id": "1", "state": "fired", "frequency": "WHEN",
                "condition": "ws_time > 5 s", "cycle_of_condition": 5001, "fired": 1, "tick": 5001, "step": 3,
                "actions": [
                    { "function": "read_sensor_value", "values": [
                        { "stream": "X.LOAD", "value": 12.50004, "unit": "PERCENT", "quality": "simulated" },
                        { "stream": "TOOL.TEMPERATURE", "unit": "CELSIUS", "quality": "unavailable" } ] },
                    { "function": "set_alarm", "alarm": 1, "text": "over_time", "state": "set", "reaction": "feed_hold" } ] }),
            "id 1, fired, WHEN ws_time > 5 s, condition in cycle 5001, fired once; read_sensor_value: X.LOAD 12.5 %, \
             TOOL.TEMPERATURE unavailable; set_alarm: alarm 1, set, 'over_time', feed hold",
        );
    }

    #[test]
    fn a_recording_says_how_it_samples_and_what_it_came_to() {
        check(
            json!({ "function": "start_sensor_recording", "id": "1", "run": 2, "state": "started", "sampling": "4", "cycles": 4,
                "statistic": "last", "streams": [ { "name": "X.LOAD" }, { "name": "COOLANT.FLOW", "quality": "unavailable" } ] }),
            "id 1 (run 2), started, every 4 cycles, X.LOAD COOLANT.FLOW (unavailable)",
        );
        check(
            json!({ "function": "stop_sensor_recording", "id": "1", "state": "ended", "run": 2, "why": "stop", "samples": 7,
                "from_cycle": 10, "to_cycle": 40, "lost_cycles": 3 }),
            "id 1 (run 2), ended, stop, cycles 10 to 40, 7 samples, lost cycles 3",
        );
    }

    #[test]
    fn moments_tools_and_what_nobody_thought_of_are_told_in_words() {
        check(
            json!({ "function": "get_time", "label": "first cut", "unix_ms": 1_795_248_004_894.0, "unit": "MILLISECOND",
                "since_program_began_ms": 4894.0, "quality": "simulated" }),
            "first cut, 2026-11-21T08:00:04.894Z, 4.894 s after the program began",
        );
        check(
            json!({ "function": "log_tool_data", "tool_number": 1, "name": "end mill 20", "length_mm": 120.0, "radius_mm": 10.0,
                "geometry_mm": [0.0, 0.0, 120.0], "wear_mm": [0.0, 0.0, -0.02], "life_used": "unavailable" }),
            "T1, end mill 20, length 120 mm, radius 10 mm, wear 0 0 -0.02 mm, life used unavailable",
        );
        check(
            json!({ "function": "x", "quality": "declared", "odd_thing": { "a": [1, 2.5] } }),
            "odd thing (a 1 2.5), quality declared",
        );
    }
}

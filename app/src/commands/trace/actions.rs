//! `toolmark trace actions`: the synchronized actions of a job, what they watch, how often they fired, and what ended them.

use super::{find, seconds_since};
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::Exit;
use crate::{functions, say, shop};
use ledger::Event;
use serde::Serialize;
use serde_json::{Value, json};
use std::path::Path;

/// A synchronized action, from its start to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Action {
    id: String,
    /// Which run of a function in the job: ids may come again.
    run: u64,
    /// `ALL` or `AUTOMATIC`.
    scope: String,
    frequency: String,
    condition: Option<String>,
    /// Seconds since the job began.
    started_s: f64,
    fired: u64,
    ended_s: Option<f64>,
    /// What ended it, or why it goes on; `None` when nothing that is on disk did.
    why: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// There is no such directory or job, or it cannot be read.
pub fn actions(root: &Path, job: &str, common: &Common) -> Done {
    let directory = shop::read_data(root)?;
    let found = find(&directory, job)?;
    let at = |event: &Event| seconds_since(found.job.start, event.at_ns);
    let all = of(&found.events, &at);
    if common.json {
        print_json(&json!({ "job": found.job.id.0, "actions": all }))?;
        return Ok(Exit::Good);
    }
    if all.is_empty() {
        say(&format!("job {} started no synchronized action", found.job.id));
    }
    for action in &all {
        let condition = action.condition.as_deref().map_or_else(
            || "every cycle".to_owned(),
            |condition| format!("{} {condition}", action.frequency),
        );
        let modes = if action.scope == "ALL" { "all modes" } else { "automatic" };
        let end = match (action.ended_s, &action.why) {
            (Some(at), Some(why)) => format!("ended at {at:.3} s: {why}"),
            (None, Some(why)) => format!("goes on: {why}"),
            _ => "it ran when the log ends".to_owned(),
        };
        say(&format!(
            "{:>4}  run {:<3} {modes:<9}  from {:.3} s, fired {}, {end}  {condition}",
            action.id, action.run, action.started_s, action.fired
        ));
    }
    Ok(Exit::Good)
}

fn of(events: &[Event], at: &dyn Fn(&Event) -> f64) -> Vec<Action> {
    let mut all: Vec<Action> = Vec::new();
    for event in events.iter().filter(|event| functions::is_of_the_program(event)) {
        let text = |key: &str| event.detail.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
        let number = |key: &str| event.detail.get(key).and_then(Value::as_u64);
        let (function, state, id) = (text("function"), text("state"), text("id"));
        match (function.as_str(), state.as_str()) {
            ("start_synchronized_action", "started") => all.push(Action {
                id,
                run: number("run").unwrap_or(0),
                scope: text("scope"),
                frequency: text("frequency"),
                condition: event.detail.get("condition").and_then(Value::as_str).map(str::to_owned),
                started_s: at(event),
                fired: 0,
                ended_s: None,
                why: None,
            }),
            ("start_synchronized_action", "fired") => {
                let running = all.iter_mut().rev().find(|action| action.id == id && action.why.is_none());
                if let Some(action) = running {
                    action.fired = number("fired").unwrap_or(action.fired);
                }
            }
            ("start_synchronized_action", "goes on") => {
                let run = number("run");
                if let Some(action) = all.iter_mut().find(|action| Some(action.run) == run) {
                    action.fired = number("fired").unwrap_or(action.fired);
                    action.why = Some(text("why"));
                }
            }
            ("stop_synchronized_action", "ended") => {
                let run = number("run");
                if let Some(action) = all.iter_mut().find(|action| Some(action.run) == run) {
                    action.fired = number("fired").unwrap_or(action.fired);
                    action.ended_s = Some(at(event));
                    action.why = Some(text("why"));
                }
            }
            _ => {}
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use ledger::Chain;
    use units::Timestamp;

    #[test]
    fn an_action_is_followed_from_its_start_to_what_ended_it_and_an_id_that_comes_again_is_another() {
        let mut chain = Chain::default();
        let mut event = |at: i64, detail: Value| {
            let detail = detail.as_object().cloned().expect("an object").into_iter().collect();
            chain.append(Timestamp(at), trace::record::EVENT, detail)
        };
        let start = |run: u64, scope: &str| {
            json!({ "function": "start_synchronized_action", "id": "1", "state": "started", "run": run, "scope": scope,
                "frequency": "WHEN", "condition": "ws_time > 5 s" })
        };
        let events = [
            event(1, start(1, "AUTOMATIC")),
            event(
                2,
                json!({ "function": "start_synchronized_action", "id": "1", "state": "fired", "fired": 1 }),
            ),
            event(
                3,
                json!({ "function": "stop_synchronized_action", "id": "1", "state": "ended", "run": 1, "why": "stop", "fired": 1 }),
            ),
            event(4, start(2, "ALL")),
            event(
                5,
                json!({ "function": "start_synchronized_action", "id": "1", "state": "fired", "fired": 4 }),
            ),
            event(6, start(3, "ALL")),
            event(
                7,
                json!({ "function": "start_synchronized_action", "id": "1", "state": "goes on", "run": 3, "why": "all modes", "fired": 9 }),
            ),
        ];
        let all = of(&events, &|event| event.at_ns as f64);
        let shown: Vec<_> = all
            .iter()
            .map(|a| (a.run, a.scope.as_str(), a.fired, a.ended_s, a.why.as_deref()))
            .collect();
        assert_eq!(
            shown,
            [
                (1, "AUTOMATIC", 1, Some(3.0), Some("stop")),
                (2, "ALL", 4, None, None),
                (3, "ALL", 9, None, Some("all modes"))
            ]
        );
    }
}

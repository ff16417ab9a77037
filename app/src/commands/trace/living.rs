//! `toolmark trace actions --machine tcp://HOST:PORT` and `toolmark trace end`: the synchronized actions that live in a controller, and the
//! end of one by hand.
//!
//! An action in all modes outlives its program and its run: it is the controller's then. Ending one is the only verb of `trace` that changes
//! something, so it opens the data directory to work in it: who may is decided there, and a refusal and an end are events of its log.

use crate::cli::Common;
use crate::commands::run::machine_file_behind;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::link::address::{self, Address};
use crate::link::asking::ask;
use crate::link::certificates::{self, Client};
use crate::people::{self, Acting};
use crate::{clock, say, shop};
use cell::link::Lived;
use ledger::Action;
use machine::link::Asked;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use trace::Call;
use trace::survey::Found;
use units::Timestamp;

/// A controller that is asked.
struct Asking<'c> {
    address: Address,
    client: Option<Client>,
    common: &'c Common,
}

/// A synchronized action that lives in a controller.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Living {
    /// The controller's number for it, by which it is ended. No two have the same while the controller runs.
    number: u32,
    /// As the program calls it.
    id: Option<String>,
    /// `ALL` or `AUTOMATIC`.
    scope: &'static str,
    frequency: Option<&'static str>,
    condition: Option<String>,
    /// What is done when it fires, as far as the machine does something.
    actions: Vec<String>,
    /// By the controller's cycles, as this computer's clock has it.
    since: String,
    for_s: f64,
    fired: u64,
    /// The run that started it, as it named itself: the program and who ran it.
    by: String,
    /// The line of the program.
    line: String,
}

/// What a controller answers.
#[derive(Serialize)]
struct List<'a> {
    controller: String,
    machine: &'a str,
    actions: &'a [Living],
}

/// What was ended.
#[derive(Serialize)]
struct Ended<'a> {
    #[serde(flatten)]
    list: List<'a>,
    who: &'a str,
    why: Option<&'a str>,
}

/// Lists what lives in a controller.
///
/// # Errors
/// `--machine` names none, or it does not answer.
pub fn list(file: Option<&Path>, common: &Common) -> Done {
    let (machine, all) = Asking::of(file, common)?.all()?;
    if common.json {
        print_json(&List {
            controller: common.machine.clone(),
            machine: &machine,
            actions: &all,
        })?;
        return Ok(Exit::Good);
    }
    if all.is_empty() {
        say(&format!("no synchronized action lives in {machine} ({})", common.machine));
    }
    all.iter().for_each(tell);
    Ok(Exit::Good)
}

/// Ends one action of all modes, or every one.
///
/// # Errors
/// The person may not, the controller does not answer, or nothing of all modes lives there under that number.
pub fn end(which: &str, file: Option<&Path>, common: &Common) -> Done {
    let number: Option<u32> = match which {
        "all" => None,
        number => Some(number.parse().ok().filter(|number| *number > 0).ok_or_else(|| {
            Failure::usage(format_args!(
                "{which}: a number of toolmark trace actions --machine {}, or all, was expected",
                common.machine
            ))
        })?),
    };
    let asking = Asking::of(file, common)?;
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::EndAllModes, &mut directory, at)?;
    let (machine, all) = asking.all()?;
    let wanted = chosen(&all, number, &common.machine)?;
    let mut ended = Vec::new();
    for action in wanted {
        let mut tell = |kind: &str, action: &Living| -> Result<(), Failure> {
            let detail = asking.detail(&acting, &machine, action);
            directory.append(at, kind, detail).map_err(shop::failure)?;
            Ok(())
        };
        // Before it is done: whatever ends this program in between, the log knows of it.
        tell("action-end-asked", action)?;
        let answer = asking.ask(Asked::End { mark: action.number })?;
        match answer.lived.first() {
            Some(lived) => {
                let last = Living::of(lived, answer.now.0, asking.now()?);
                tell("action-ended", &last)?;
                if !common.json {
                    // At once: who ends several knows which, also where a later one cannot be ended.
                    say(&format!("ended by {}:", acting.words()));
                    self::tell(&last);
                }
                ended.push(last);
            }
            None => shop::notice(&format!(
                "action {} was over before it could be ended: its program or somebody else has ended it",
                action.number
            )),
        }
    }
    let list = List {
        controller: common.machine.clone(),
        machine: &machine,
        actions: &ended,
    };
    if common.json {
        print_json(&Ended {
            list,
            who: &acting.name,
            why: common.reason.as_deref(),
        })?;
        return Ok(Exit::Good);
    }
    if ended.is_empty() {
        say(&format!(
            "nothing was ended: no synchronized action in all modes lives in {machine} ({})",
            common.machine
        ));
    }
    Ok(Exit::Good)
}

/// What earlier runs have left in a controller.
#[derive(Clone, Debug, Default)]
pub struct Left {
    controller: String,
    machine: String,
    actions: Vec<Living>,
}

impl Left {
    /// Asks, before another run begins there.
    ///
    /// # Errors
    /// It does not answer.
    pub fn behind(address: &Address, client: Option<&Client>, name: &str) -> Result<Left, Failure> {
        let answer = ask(address, client, name, Asked::Living)?;
        let now = clock::start_time(None)?;
        let lasting = answer.lived.iter().filter(|lived| lived.living.all_modes);
        Ok(Left {
            controller: address.to_string(),
            machine: answer.machine.clone(),
            actions: lasting.map(|lived| Living::of(lived, answer.now.0, now)).collect(),
        })
    }

    /// What a person should know before anything moves; `None` where nothing is left.
    pub fn notice(&self) -> Option<String> {
        let left: Vec<String> = self.actions.iter().map(|a| format!("{} (of '{}')", a.number, a.by)).collect();
        (!left.is_empty()).then(|| {
            format!(
                "synchronized actions in all modes of earlier runs live in {}: {}. They go on acting on alarms and motion beside this run's \
                 own: toolmark trace actions --machine {} shows them, toolmark trace end ends them",
                self.machine,
                left.join(", "),
                self.controller
            )
        })
    }

    /// Each id that a program starts and that one of these has: T-02, with what to do.
    pub fn clashes(&self, found: &Found) -> Vec<String> {
        let mut clashes = Vec::new();
        for action in &self.actions {
            let Some((kind, id)) = found.started.iter().find(|(_, id)| Some(&id.0) == action.id.as_ref()) else {
                continue;
            };
            clashes.push(format!(
                "T-02: {kind} {id} is started while {id} is active as a synchronized action in all modes, which '{}' has left in {}; \
                 toolmark trace end {} --machine {} ends it, or give one of them another id",
                action.by, self.machine, action.number, self.controller
            ));
        }
        clashes
    }
}

/// What is to be ended.
fn chosen<'a>(all: &'a [Living], number: Option<u32>, machine: &str) -> Result<Vec<&'a Living>, Failure> {
    let lasting = |action: &&Living| action.scope == "ALL";
    let Some(number) = number else {
        return Ok(all.iter().filter(lasting).collect());
    };
    let found = all.iter().find(|action| action.number == number);
    if found.is_some_and(|action| action.scope != "ALL") {
        return Err(Failure::usage(format_args!(
            "action {number} is in automatic: it ends with its program, and cannot be ended before it from here"
        )));
    }
    let numbers: Vec<String> = all.iter().filter(lasting).map(|action| action.number.to_string()).collect();
    let known = match numbers.as_slice() {
        [] => "none of all modes lives there".to_owned(),
        numbers => format!("those of all modes there are {}", numbers.join(", ")),
    };
    found.map(|action| vec![action]).ok_or_else(|| {
        Failure::usage(format_args!(
            "no action {number} lives in {machine}; {known}: toolmark trace actions --machine {machine}"
        ))
    })
}

impl<'c> Asking<'c> {
    fn of(file: Option<&Path>, common: &'c Common) -> Result<Asking<'c>, Failure> {
        if !address::is_address(&common.machine) {
            return Err(Failure::usage(format_args!(
                "--machine {}: the address of a controller was expected, like tcp://127.0.0.1:7450; what a simulated run starts ends with it",
                common.machine
            )));
        }
        let address = address::read(&common.machine)?;
        let machine = machine_file_behind(common, file, false)?;
        let loopback = address.resolve()?.iter().all(|a| a.ip().is_loopback());
        let client = certificates::for_connecting(&address.host, loopback, &machine.link)?;
        Ok(Asking { address, client, common })
    }

    fn ask(&self, what: Asked) -> Result<cell::link::Answer, Failure> {
        let name = people::shown_to_others(self.common);
        ask(&self.address, self.client.as_ref(), &name, what)
    }

    /// The machine's name, and what lives in it.
    fn all(&self) -> Result<(String, Vec<Living>), Failure> {
        let answer = self.ask(Asked::Living)?;
        let now = self.now()?;
        let all = answer
            .lived
            .iter()
            .map(|lived| Living::of(lived, answer.now.0, now))
            .collect();
        Ok((answer.machine, all))
    }

    /// The clock, whatever `--start` says: since when something lives is no part of a run.
    fn now(&self) -> Result<Timestamp, Failure> {
        clock::start_time(None)
    }

    fn detail(&self, acting: &Acting, machine: &str, action: &Living) -> BTreeMap<String, Value> {
        let mut detail = acting.detail();
        let mut put = |key: &str, value: Value| detail.insert(key.to_owned(), value);
        put("controller", self.address.to_string().into());
        put("machine", machine.into());
        put("number", action.number.into());
        put("id", action.id.clone().into());
        put("by", action.by.clone().into());
        put("line", action.line.clone().into());
        put("since", action.since.clone().into());
        put("fired", action.fired.into());
        if let Some(why) = &self.common.reason {
            put("why", why.clone().into());
        }
        detail
    }
}

impl Living {
    fn of(lived: &Lived, cycle: u64, now: Timestamp) -> Living {
        let cycles = cycle.saturating_sub(lived.living.since.0);
        // Cycles of 1 ms; none is so long ago that its nanoseconds find no place.
        let since = now
            .0
            .saturating_sub(i64::try_from(cycles).unwrap_or(i64::MAX).saturating_mul(1_000_000));
        // The answer was under way for some milliseconds: what is finer than one says nothing.
        let since = Timestamp(since - since.rem_euclid(1_000_000));
        let mut living = Living {
            number: lived.living.mark,
            id: None,
            scope: if lived.living.all_modes { "ALL" } else { "AUTOMATIC" },
            frequency: None,
            condition: None,
            actions: Vec::new(),
            since: clock::utc(since),
            for_s: cycles as f64 / 1e3,
            fired: lived.living.fired,
            by: lived.by.clone(),
            line: lived.line.clone(),
        };
        // A line that is too long comes cut, and is shown as it is.
        if let Ok(function) = trace::parse(&lived.line)
            && let Call::StartSynchronizedAction(action) = &function.call
        {
            living.id = Some(action.id.0.clone());
            living.frequency = Some(action.frequency.word());
            living.condition = action.condition.as_ref().map(trace::condition::print);
            living.actions = action.actions.iter().map(trace::Function::without_prefix).collect();
        } else {
            living.id = id_of_cut(&lived.line);
        }
        living
    }
}

/// The id in a line that was cut behind it: it stands in front, and says whether another program may have it.
fn id_of_cut(line: &str) -> Option<String> {
    let (_, behind) = line.split_once(" its_id=")?;
    let (id, rest) = match behind.strip_prefix('"') {
        Some(quoted) => quoted.split_once('"')?,
        None => behind.split_once(' ')?,
    };
    (!rest.trim().is_empty() && rest.trim() != "...").then(|| id.to_owned())
}

fn tell(action: &Living) {
    let modes = if action.scope == "ALL" { "all modes" } else { "automatic" };
    let id = action
        .id
        .as_ref()
        .map_or_else(|| "id unknown".to_owned(), |id| format!("id {id}"));
    let what = match (&action.condition, action.frequency) {
        (Some(condition), Some(frequency)) => format!("{frequency} {condition}"),
        (None, Some(_)) => "every cycle".to_owned(),
        _ => action.line.clone(),
    };
    let by = if action.by.is_empty() { "somebody" } else { &action.by };
    let since = clock::parse(&action.since).map_or_else(|| action.since.clone(), clock::local);
    say(&format!(
        "{:>4}  {id:<6}  {modes:<9}  since {since}, fired {}, of {by}  {what}",
        action.number, action.fired
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use units::Tick;

    fn lived(mark: u32, all_modes: bool, line: &str) -> Lived {
        Lived {
            living: machine::watch::Living {
                mark,
                all_modes,
                since: Tick(1_000),
                fired: 3,
            },
            by: "plate.nc of jo".to_owned(),
            line: line.to_owned(),
        }
    }

    const LINE: &str = "trace:1 start_synchronized_action its_id=over its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 80 %\" \
                        its_actions=\"set_alarm its_alarm_id=1 its_text=load\"";

    #[test]
    fn what_lives_is_told_by_its_line_and_since_when_by_the_cycles_and_a_cut_line_is_shown_as_it_is() {
        let now = clock::parse("2026-11-22T12:00:10Z").expect("a time");
        let living = Living::of(&lived(7, true, LINE), 6_000, now);
        assert_eq!(
            (living.id.as_deref(), living.frequency, living.scope, living.for_s),
            (Some("over"), Some("WHEN"), "ALL", 5.0)
        );
        assert_eq!(clock::parse(&living.since), clock::parse("2026-11-22T12:00:05Z"));
        assert_eq!(living.condition.as_deref(), Some("X.LOAD > 80 %"));
        assert_eq!(living.actions.len(), 1);
        // Also where it is cut between two keys.
        for (line, id) in [
            ("trace:1 start_synchronized_action its_id=ov ...", None),
            ("trace:1 start_synchronized_action its_id=\"over lo ...", None),
            (
                "trace:1 start_synchronized_action its_id=\"over load\" its_ ...",
                Some("over load"),
            ),
            (&format!("{LINE} ..."), Some("over")),
            ("", None),
            ("G1 X0", None),
        ] {
            let cut = Living::of(&lived(8, true, line), 0, now);
            assert_eq!((cut.id.as_deref(), cut.condition, cut.for_s), (id, None, 0.0), "{line}");
        }
    }

    #[test]
    fn what_is_ended_is_of_all_modes_and_a_number_that_is_not_there_says_which_are() {
        let now = Timestamp(0);
        let all: Vec<Living> = [(3, true), (4, false), (9, true)]
            .iter()
            .map(|(mark, all_modes)| Living::of(&lived(*mark, *all_modes, LINE), 0, now))
            .collect();
        let numbers = |number| {
            let chosen = chosen(&all, number, "tcp://127.0.0.1:1")?;
            Ok::<_, Failure>(chosen.iter().map(|action| action.number).collect::<Vec<_>>())
        };
        assert_eq!(numbers(None), Ok(vec![3, 9]));
        assert_eq!(numbers(Some(9)), Ok(vec![9]));
        for (number, why) in [(4, "ends with its program"), (5, "there are 3, 9")] {
            let failure = numbers(Some(number)).expect_err("refused");
            assert!(
                failure.exit == Exit::Usage && failure.message.contains(why),
                "{}",
                failure.message
            );
        }
        assert!(
            chosen(&[], Some(1), "m")
                .expect_err("none")
                .message
                .contains("none of all modes")
        );
    }
}

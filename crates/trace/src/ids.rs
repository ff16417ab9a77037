//! Which ids are taken: one id belongs to one active function of a channel, whatever its kind.
//!
//! Three follow a program with it, each in the program's order: the look before it runs, the reader ahead of the machine, and the recorder
//! behind it. They come to the same answer, so an action that is refused here is refused there. That is why a recording that is full keeps
//! its id until its stop or the end of its scope: the reader ahead does not know when it became full.

use crate::functions::{Call, TraceId};
use std::collections::BTreeMap;

/// Functions that are started and stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Recording,
    Tools,
    Events,
    Operators,
    Synchronized,
}

impl Kind {
    const ALL: [Kind; 5] = [
        Kind::Recording,
        Kind::Tools,
        Kind::Events,
        Kind::Operators,
        Kind::Synchronized,
    ];

    pub(crate) fn word(self) -> &'static str {
        match self {
            Kind::Recording => "sensor recording",
            Kind::Tools => "tool logging",
            Kind::Events => "event logging",
            Kind::Operators => "operator logging",
            Kind::Synchronized => "synchronized action",
        }
    }

    /// With its article, where the language has one.
    fn one(self) -> String {
        match self {
            Kind::Recording | Kind::Synchronized => format!("a {}", self.word()),
            Kind::Tools | Kind::Events | Kind::Operators => self.word().to_owned(),
        }
    }

    /// What stops it.
    fn stop(self) -> &'static str {
        match self {
            Kind::Recording => "stop_sensor_recording",
            Kind::Tools => "stop_tool_logging",
            Kind::Events => "log_nc_events ... its_state=OFF",
            Kind::Operators => "log_operator_data ... its_state=OFF",
            Kind::Synchronized => "stop_synchronized_action",
        }
    }
}

/// What is active, as a program says it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ids {
    active: BTreeMap<(Kind, TraceId), Begun>,
    /// Workplans that are open.
    depth: usize,
}

#[derive(Clone, Copy, Debug)]
struct Begun {
    /// The depth of workplans in which it began.
    depth: usize,
    /// It ends with its path.
    along: bool,
}

/// What is wrong with an id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Clash {
    /// T-02: it is started as the first while it is active as the second.
    Started(TraceId, Kind, Kind),
    /// T-01: it is stopped and not active as this, but perhaps as something else.
    Stopped(TraceId, Kind, Option<Kind>),
}

impl Clash {
    pub(crate) fn code(&self) -> &'static str {
        match self {
            Clash::Started(..) => "T-02",
            Clash::Stopped(..) => "T-01",
        }
    }

    /// What is wrong, in words; `otherwise` is what is said of a stop whose id nothing has.
    pub(crate) fn text(&self, otherwise: &str) -> String {
        match self {
            Clash::Started(id, kind, holder) if kind == holder => format!("{} {id} is started while it is active", kind.word()),
            Clash::Started(id, kind, holder) => {
                format!("{} {id} is started while {id} is active as {}", kind.word(), holder.one())
            }
            Clash::Stopped(id, kind, None) => format!("{} {id} is stopped and {otherwise}", kind.word()),
            Clash::Stopped(id, kind, Some(holder)) => {
                format!("{} {id} is stopped, and {id} is active as {}", kind.word(), holder.one())
            }
        }
    }

    /// What to do.
    pub(crate) fn remedy(&self) -> String {
        match self {
            Clash::Started(..) => "stop it first, or give another id".to_owned(),
            Clash::Stopped(_, _, None) => "start it before, or take the stop out".to_owned(),
            Clash::Stopped(_, kind, Some(holder)) => {
                format!("write {}, or give the id of {}", holder.stop(), kind.one())
            }
        }
    }
}

/// What a function starts.
pub(crate) fn started(call: &Call) -> Option<(Kind, &TraceId)> {
    match call {
        Call::StartSensorRecording(recording) => Some((Kind::Recording, &recording.id)),
        Call::StartToolLogging { id } => Some((Kind::Tools, id)),
        Call::LogNcEvents { id, on: true, .. } => Some((Kind::Events, id)),
        Call::LogOperatorData { id, on: true } => Some((Kind::Operators, id)),
        Call::StartSynchronizedAction(action) => Some((Kind::Synchronized, &action.id)),
        _ => None,
    }
}

/// What a function stops.
fn stopped(call: &Call) -> Option<(Kind, &TraceId)> {
    match call {
        Call::StopSensorRecording { id } => Some((Kind::Recording, id)),
        Call::StopToolLogging { id } => Some((Kind::Tools, id)),
        Call::LogNcEvents { id, on: false, .. } => Some((Kind::Events, id)),
        Call::LogOperatorData { id, on: false } => Some((Kind::Operators, id)),
        Call::StopSynchronizedAction { id } => Some((Kind::Synchronized, id)),
        _ => None,
    }
}

impl Ids {
    /// Follows a function, which may stand along a path.
    ///
    /// # Errors
    /// Its id is taken, or nothing is to be stopped; then nothing happens.
    pub(crate) fn follow(&mut self, call: &Call, along: bool) -> Result<(), Clash> {
        match (started(call), stopped(call)) {
            (Some((kind, id)), _) => {
                let with_path = along && matches!(kind, Kind::Recording | Kind::Synchronized);
                self.start(kind, id, with_path)
            }
            (_, Some((kind, id))) => self.stop(kind, id),
            (None, None) => Ok(()),
        }
    }

    /// A workplan begins.
    pub(crate) fn workplan_begins(&mut self) {
        self.depth += 1;
    }

    /// The innermost workplan ends; gives the recordings that end with it.
    pub(crate) fn workplan_ends(&mut self) -> Vec<(Kind, TraceId)> {
        let over = self.depth.max(1);
        self.depth = over - 1;
        self.end(|kind, begun| kind == Kind::Recording && !begun.along && begun.depth >= over)
    }

    /// A path ends; gives what ends with it.
    pub(crate) fn path_ends(&mut self) -> Vec<(Kind, TraceId)> {
        self.end(|_, begun| begun.along)
    }

    /// What is begun and not over, but for what ends with its path.
    pub(crate) fn begun(&self) -> impl Iterator<Item = (Kind, &TraceId)> {
        let of_the_program = self.active.iter().filter(|(_, begun)| !begun.along);
        of_the_program.map(|((kind, id), _)| (*kind, id))
    }

    fn start(&mut self, kind: Kind, id: &TraceId, along: bool) -> Result<(), Clash> {
        if let Some(holder) = self.holder(id) {
            return Err(Clash::Started(id.clone(), kind, holder));
        }
        let depth = self.depth;
        self.active.insert((kind, id.clone()), Begun { depth, along });
        Ok(())
    }

    fn stop(&mut self, kind: Kind, id: &TraceId) -> Result<(), Clash> {
        match self.active.remove(&(kind, id.clone())) {
            Some(_) => Ok(()),
            None => Err(Clash::Stopped(id.clone(), kind, self.holder(id))),
        }
    }

    fn holder(&self, id: &TraceId) -> Option<Kind> {
        Kind::ALL
            .into_iter()
            .find(|kind| self.active.contains_key(&(*kind, id.clone())))
    }

    fn end(&mut self, ends: impl Fn(Kind, &Begun) -> bool) -> Vec<(Kind, TraceId)> {
        let mut over = Vec::new();
        self.active.retain(|(kind, id), begun| {
            let ends = ends(*kind, begun);
            if ends {
                over.push((*kind, id.clone()));
            }
            !ends
        });
        over
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse;

    const STARTS: [&str; 5] = [
        "start_sensor_recording its_function_id=R1 its_sensors=X.LOAD",
        "start_tool_logging its_function_id=r1",
        "log_nc_events its_function_id=R1 its_state=ON",
        "log_operator_data its_function_id=r1 its_state=ON",
        "start_synchronized_action its_id=R1 its_mode_scope=ALL its_actions=get_time",
    ];
    const STOPS: [&str; 5] = [
        "stop_sensor_recording its_function_id=r1",
        "stop_tool_logging its_function_id=R1",
        "log_nc_events its_function_id=r1 its_state=OFF",
        "log_operator_data its_function_id=R1 its_state=OFF",
        "stop_synchronized_action its_id=r1",
    ];

    fn call(line: &str) -> Call {
        parse(&format!("trace:1 {line}")).expect("a line").call
    }

    #[test]
    fn an_id_is_free_for_any_kind_only_when_no_kind_has_it() {
        for (held, (start, stop)) in Kind::ALL.into_iter().zip(STARTS.into_iter().zip(STOPS)) {
            for (kind, (other, end)) in Kind::ALL.into_iter().zip(STARTS.into_iter().zip(STOPS)) {
                let mut ids = Ids::default();
                assert_eq!(ids.follow(&call(start), false), Ok(()));
                let clash = ids.follow(&call(other), false).expect_err("it is taken");
                assert_eq!(clash, Clash::Started(TraceId("R1".into()), kind, held));
                let said = clash.text("");
                assert!(said.contains(kind.word()) && said.contains(held.word()), "{said}");
                if kind != held {
                    let clash = ids.follow(&call(end), false).expect_err("it is another's");
                    assert_eq!(clash, Clash::Stopped(TraceId("R1".into()), kind, Some(held)));
                    let said = clash.text("");
                    assert!(said.contains(kind.word()) && said.contains(held.word()), "{said}");
                }
                assert_eq!(ids.follow(&call(stop), false), Ok(()));
                assert_eq!(ids.follow(&call(other), false), Ok(()));
            }
        }
    }

    #[test]
    fn what_is_along_a_path_ends_with_it_and_a_recording_with_its_workplan() {
        let mut ids = Ids::default();
        ids.workplan_begins();
        assert_eq!(ids.follow(&call(STARTS[4]), true), Ok(()));
        assert!(ids.follow(&call(STARTS[0]), true).is_err());
        assert_eq!(ids.path_ends(), [(Kind::Synchronized, TraceId("R1".into()))]);
        assert_eq!(ids.follow(&call(STARTS[0]), false), Ok(()));
        assert_eq!(ids.path_ends(), []);
        assert_eq!(ids.workplan_ends(), [(Kind::Recording, TraceId("R1".into()))]);
        // Logging goes on behind its workplan, and one end too many ends nothing of it.
        assert_eq!(ids.follow(&call(STARTS[1]), false), Ok(()));
        assert_eq!(ids.workplan_ends(), []);
        assert_eq!(ids.begun().count(), 1);
    }
}

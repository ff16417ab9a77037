//! Functions that begin on one way of a branch and end on another, or in the body of a loop and behind it: which way was taken is known at
//! the machine only, and what is written into a program is there on all of them. They are left to the recorder and not written wrongly.

use super::*;

/// Where something began that has an end of its own.
#[derive(Clone, Copy, Debug)]
struct Begun {
    way: u32,
    /// It ends with its workplan: how many were open.
    workplans: Option<usize>,
}

/// The ways of branches and loops that are open, and what began on which.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ways {
    open: Vec<u32>,
    counted: u32,
    begun: BTreeMap<String, Begun>,
    /// What turned out to begin and end on different ways.
    pub(crate) across: BTreeSet<String>,
}

impl Ways {
    /// A way begins: of a branch, or the body of a loop.
    pub(crate) fn part(&mut self) {
        self.counted += 1;
        self.open.push(self.counted);
    }

    /// It ends; what began on it would have to go on behind it.
    pub(crate) fn meet(&mut self) {
        let Some(way) = self.open.pop() else { return };
        let (left, rest) = std::mem::take(&mut self.begun)
            .into_iter()
            .partition(|(_, begun)| begun.way == way);
        self.begun = rest;
        let left: BTreeMap<String, Begun> = left;
        self.across.extend(left.into_keys());
    }

    /// A workplan ended, and what ends with it.
    pub(super) fn workplan_ends(&mut self, open: usize) {
        self.begun.retain(|_, begun| begun.workplans.is_none_or(|at| at <= open));
    }

    /// Takes in where a function begins or ends.
    pub(super) fn pass(&mut self, call: &Call, workplans: usize) {
        let Some((key, starts)) = span(call) else { return };
        let way = self.open.last().copied().unwrap_or(0);
        let before = if starts {
            let workplans = matches!(call, Call::StartSensorRecording(_)).then_some(workplans);
            self.begun.insert(key.clone(), Begun { way, workplans })
        } else {
            self.begun.remove(&key)
        };
        if before.is_some_and(|before| before.way != way) {
            self.begun.remove(&key);
            self.across.insert(key);
        }
    }
}

/// What a function begins or ends, and whether it begins it.
pub(super) fn span(call: &Call) -> Option<(String, bool)> {
    let (kind, id, starts) = match call {
        Call::StartToolLogging { id } => ("tools", &id.0, true),
        Call::StopToolLogging { id } => ("tools", &id.0, false),
        Call::StartSensorRecording(recording) => ("recording", &recording.id.0, true),
        Call::StopSensorRecording { id } => ("recording", &id.0, false),
        Call::StartSynchronizedAction(action) => ("action", &action.id.0, true),
        Call::StopSynchronizedAction { id } => ("action", &id.0, false),
        _ => return None,
    };
    Some((format!("{kind} {}", key(id)), starts))
}
